//! `curlsmoke merge`.

use crate::cli::frames::start_threads;
use crate::cli::values::Memory;
use crate::cli::{command_line, log, print_result};
use crate::error::Error;
use crate::pipeline::merge::{MergeJob, merge};
use crate::progress::Progress;
use clap::Args;
use std::path::PathBuf;

/// Flags of `merge`.
#[derive(Debug, Args)]
pub struct MergeArguments {
    /// The parts (.part), of one frame or several, in any order
    #[arg(required = true)]
    pub parts: Vec<PathBuf>,
    /// The picture (.exr), with #### for the frame where there are several; a preview
    /// that the scene asks for goes beside it
    #[arg(short, long, value_name = "PATTERN", verbatim_doc_comment)]
    pub output: String,
    /// Threads [default: one for each processor]; results never depend on it
    #[arg(short = 'j', long, value_name = "COUNT")]
    pub threads: Option<usize>,
    /// Refuse pictures that need more memory than this [GiB], as 4, 4G or 512M
    #[arg(long, value_name = "AMOUNT", default_value = "8")]
    pub memory_limit: Memory,
}

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
