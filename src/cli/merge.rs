//! `curlsmoke merge`.

use crate::cli::args::MergeArguments;
use crate::cli::frames::start_threads;
use crate::cli::{command_line, log, print_result};
use crate::error::Error;
use crate::pipeline::merge::{MergeJob, merge};
use crate::progress::Progress;

/// Tells what should be known, and of no progress: reading is all there is to wait for.
struct Notes;

impl Progress for Notes {
    fn note(&self, text: &str) {
        log(text);
    }
}

/// Joins parts; the exit code.
pub(super) fn run(arguments: &MergeArguments) -> Result<u8, Error> {
    if !arguments.output.ends_with(".exr") {
        return Err(Error::Usage(format!("--output {}: the name must end in .exr", arguments.output)));
    }
    start_threads(arguments.threads)?;
    let job = MergeJob {
        parts: arguments.parts.clone(),
        output: &arguments.output,
        memory_limit: arguments.memory_limit.bytes(),
        arguments: command_line(),
    };
    let mut printed = Ok(());
    merge(&job, &Notes, &mut |path, record| {
        if printed.is_ok() {
            printed = print_result(&format!("{}  from {} parts", path.display(), record.parts.len()));
        }
    })?;
    printed.map(|()| 0)
}
