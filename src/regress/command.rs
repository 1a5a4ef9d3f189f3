//! Commands of a suite: the shell that runs one ends with the program, and what it says does not fill memory.

use crate::error::Error;
use crate::progress::Progress;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

/// Most of a line that is kept [bytes].
const LINE_MAX: u64 = 1 << 10;

/// How often a command is asked whether it has ended.
const PERIOD: Duration = Duration::from_millis(10);

/// How long what a command said last is waited for: what it has started may hold on to its output after it.
const PATIENCE: Duration = Duration::from_secs(1);

/// Runs a line of the shell in a folder. Gives how it ended, and the line of its errors that tells most: what is wrong tends to come
/// first, and its number last.
///
/// # Errors
/// When there is no shell, and stopping, which ends the shell; programs that a line of several has begun end by themselves.
pub fn run(line: &str, folder: &Path, progress: &dyn Progress) -> Result<(ExitStatus, String), Error> {
    let failed = |e: std::io::Error| Error::Usage(format!("`{line}` cannot be run: {e}"));
    let mut command = Command::new("sh");
    command.arg("-c").arg(line).current_dir(folder).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = command.spawn().map_err(failed)?;
    let (sender, said) = mpsc::channel();
    if let Some(stream) = child.stderr.take() {
        let listen = move || {
            // Nobody waits where the command was stopped.
            let _ = sender.send(telling(stream));
        };
        thread::Builder::new().name("command".into()).spawn(listen).map_err(failed)?;
    }
    loop {
        if let Some(status) = child.try_wait().map_err(failed)? {
            let text = said.recv_timeout(PATIENCE).unwrap_or_default();
            return Ok((status, if text.is_empty() { "it said nothing".into() } else { text }));
        }
        if progress.is_cancelled() {
            // One that has just ended by itself cannot be ended.
            let _ = child.kill();
            let _ = child.wait();
            return Err(Error::Cancelled);
        }
        thread::sleep(PERIOD);
    }
}

/// The first line with an error, or else the last one.
fn telling(stream: impl Read) -> String {
    let mut lines = BufReader::new(stream);
    let (mut first, mut last) = (None, String::new());
    loop {
        let mut line = Vec::new();
        match lines.by_ref().take(LINE_MAX).read_until(b'\n', &mut line) {
            Err(_) | Ok(0) => return first.unwrap_or(last),
            Ok(_) => last = String::from_utf8_lossy(&line).trim_end().to_string(),
        }
        if first.is_none() && last.contains("error") {
            first = Some(last.clone());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;
    use std::time::Instant;

    /// Somebody who wants to stop.
    struct Impatient;

    impl Progress for Impatient {
        fn is_cancelled(&self) -> bool {
            true
        }
    }

    fn said(line: &str) -> String {
        run(line, Path::new("."), &Silent).unwrap().1
    }

    #[test]
    fn the_line_that_tells_most_is_found_in_any_amount_of_talk() {
        assert_eq!(said("echo first >&2; echo an error: here >&2; echo last >&2"), "an error: here");
        assert_eq!(said("echo first >&2; echo last >&2"), "last");
        assert_eq!(said("echo to nobody"), "it said nothing");
        let long = said("head -c 3000000 /dev/zero | tr '\\0' x >&2");
        assert!(long.len() <= LINE_MAX as usize && long.starts_with('x'), "{}", long.len());
        assert!(!run("exit 3", Path::new("."), &Silent).unwrap().0.success());
    }

    #[test]
    fn a_command_ends_with_the_program_and_is_not_waited_for_by_what_it_leaves() {
        let start = Instant::now();
        assert!(run("sleep 60", Path::new("."), &Impatient).unwrap_err().is_cancelled());
        assert!(run("sleep 60 & exit 0", Path::new("."), &Silent).unwrap().0.success());
        assert!(start.elapsed() < Duration::from_secs(30));
    }
}
