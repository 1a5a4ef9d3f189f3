//! Commands of a suite: the shell that runs one ends with the program, and what it says does not fill memory.

use crate::error::Error;
use crate::progress::Progress;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
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
    let said = Arc::new(Mutex::new(Said::default()));
    let (sender, ended) = mpsc::channel::<()>();
    if let Some(stream) = child.stderr.take() {
        let said = Arc::clone(&said);
        let listen = move || {
            listen_to(stream, &said);
            drop(sender);
        };
        thread::Builder::new().name("command".into()).spawn(listen).map_err(failed)?;
    }
    loop {
        if let Some(status) = child.try_wait().map_err(failed)? {
            // A key that stops the program stops what it has started too, and that may be the first to be noticed.
            if !status.success() && progress.is_cancelled() {
                return Err(Error::Cancelled);
            }
            // Either there is no more, or it is not waited for.
            let _ = ended.recv_timeout(PATIENCE);
            let Said { first, last } = said.lock().unwrap_or_else(PoisonError::into_inner).clone();
            let text = first.or(last).unwrap_or_else(|| "it said nothing".into());
            return Ok((status, text));
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

/// What a command has said.
#[derive(Debug, Clone, Default)]
struct Said {
    /// The first line with an error.
    first: Option<String>,
    /// The last line with anything.
    last: Option<String>,
}

/// Keeps of a stream, to its end, what tells most.
fn listen_to(stream: impl Read, said: &Mutex<Said>) {
    let mut lines = BufReader::new(stream);
    let mut line = Vec::new();
    while matches!(lines.by_ref().take(LINE_MAX).read_until(b'\n', &mut line), Ok(1..)) {
        let text = String::from_utf8_lossy(&line).trim_end().to_string();
        line.clear();
        if !text.is_empty() {
            let mut said = said.lock().unwrap_or_else(PoisonError::into_inner);
            if said.first.is_none() && text.contains("error") {
                said.first = Some(text.clone());
            }
            said.last = Some(text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;
    use std::path::PathBuf;
    use std::time::Instant;

    /// Somebody who wants to stop.
    struct Impatient;

    impl Progress for Impatient {
        fn is_cancelled(&self) -> bool {
            true
        }
    }

    /// Somebody who wants to stop once there is a file, and is slow to say that there is none.
    struct Late(PathBuf);

    impl Progress for Late {
        fn is_cancelled(&self) -> bool {
            let is_there = self.0.exists();
            if !is_there {
                thread::sleep(Duration::from_secs(1));
            }
            is_there
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
        assert_eq!(said("printf 'cannot open a.exr\n\n \n' >&2; exit 1"), "cannot open a.exr");
        // What it leaves holds on to the stream.
        assert_eq!(said("sleep 60 & echo broken >&2; exit 3"), "broken");
        let long = said("head -c 3000000 /dev/zero | tr '\\0' x >&2");
        assert!(long.len() <= LINE_MAX as usize && long.starts_with('x'), "{}", long.len());
        assert!(!run("exit 3", Path::new("."), &Silent).unwrap().0.success());
    }

    #[test]
    fn a_command_ends_with_the_program_and_is_not_waited_for_by_what_it_leaves() {
        let start = Instant::now();
        assert!(run("sleep 60", Path::new("."), &Impatient).unwrap_err().is_cancelled());
        // Stopped by the same key, before anybody asks.
        let marker = std::env::temp_dir().join(format!("curlsmoke-command-{}", std::process::id()));
        let line = format!("sleep 0.5; touch {}; exit 130", marker.display());
        let stopped = run(&line, Path::new("."), &Late(marker.clone()));
        std::fs::remove_file(&marker).unwrap();
        assert!(stopped.unwrap_err().is_cancelled());
        assert!(run("sleep 60 & exit 0", Path::new("."), &Silent).unwrap().0.success());
        assert!(start.elapsed() < Duration::from_secs(30));
    }
}
