//! Figures that nobody has to believe: every kernel in cycles of a chain that runs beside it, held against what was recorded;
//! in instructions, which repeat; and what bounds them. docs/performance.md says how to use it.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "what it is for")]

mod callgrind;
mod compare;
mod flow;
mod grid;
mod light;
mod loops;
mod machine;
mod measure;
mod record;
mod roofline;
mod scaling;
mod section;
mod whole;
mod workload;

use clap::{Parser, Subcommand};
use std::error::Error;
use std::process::ExitCode;
use workload::{KERNELS, Kernel};

/// Measures the kernels.
#[derive(Parser)]
#[command(name = "kernels")]
struct Args {
    #[command(subcommand)]
    task: Option<Task>,
    /// Given by cargo; without it, every kernel runs once and nothing is measured.
    #[arg(long, hide = true, global = true)]
    bench: bool,
    /// Keeps the figures: times and instructions in benches/recorded.json, sections in docs/performance.md.
    #[arg(long, global = true)]
    record: bool,
}

#[derive(Subcommand)]
enum Task {
    /// Cycles of each kernel, beside what was recorded; fails where one is slower. The same without any task.
    Compare {
        /// Only kernels with this in their name.
        filter: Option<String>,
    },
    /// Instructions of each kernel by valgrind's callgrind, beside what was recorded; fails where one takes more.
    Instructions {
        /// Only kernels with this in their name.
        filter: Option<String>,
    },
    /// What bounds the tracing of light on this machine.
    Roofline {
        /// Only parts with this in their name.
        filter: Option<String>,
    },
    /// Two threads beside one.
    Scaling {
        /// Only kernels with this in their name.
        filter: Option<String>,
    },
    /// Cost of each kernel in this process alone, as JSON.
    Time {
        /// Only kernels with this in their name.
        filter: Option<String>,
    },
    /// Time of an operation on some threads as the clock on the wall says, for comparisons with other programs [ns].
    Wall {
        /// The kernel's name.
        kernel: String,
        /// Threads.
        threads: usize,
    },
    /// Runs a kernel and says how many operations a run has: what callgrind looks at.
    Run {
        /// Its name.
        kernel: String,
        /// How often.
        runs: u64,
    },
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::from(2)
        }
    }
}

/// False where something is worse than recorded.
fn run(args: &Args) -> Result<bool, Box<dyn Error>> {
    // This thread is all of the pool, so that its processor time is that of the work, and callgrind sees no other.
    rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global()?;
    match &args.task {
        None if !args.bench => KERNELS.iter().for_each(|kernel| ((kernel.prepare)().run)()),
        None => return compare::compare(None, args.record),
        Some(Task::Compare { filter }) => return compare::compare(filter.as_deref(), args.record),
        Some(Task::Instructions { filter }) => return callgrind::instructions(filter.as_deref(), args.record),
        Some(Task::Roofline { filter }) => roofline::roofline(filter.as_deref(), args.record)?,
        Some(Task::Scaling { filter }) => scaling::scaling(filter.as_deref(), args.record)?,
        Some(Task::Time { filter }) => println!("{}", serde_json::to_string(&compare::time(filter.as_deref()))?),
        Some(Task::Wall { kernel, threads }) => println!("{}", scaling::wall(kernel, *threads)?),
        Some(Task::Run { kernel, runs }) => {
            let mut workload = (workload::kernel(kernel)?.prepare)();
            (0..*runs).for_each(|_| (workload.run)());
            println!("{}", workload.operations);
        }
    }
    Ok(true)
}

/// The kernels whose name holds `filter`.
fn chosen(filter: Option<&str>) -> impl Iterator<Item = &'static Kernel> {
    KERNELS.iter().filter(move |k| filter.is_none_or(|f| k.name.contains(f)))
}
