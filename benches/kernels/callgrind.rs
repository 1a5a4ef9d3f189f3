//! Instructions of a kernel, counted by callgrind: two processes that run it a few times and more often, so that what comes
//! before the first run cancels. What happens only in a first run does too.

use crate::record::{Record, rounded};
use crate::workload::{Kernel, Role};
use crate::{chosen, compare, machine};
use std::collections::BTreeMap;
use std::error::Error;
use std::process::Command;

/// Runs of a kernel in the two processes.
const FEW: u64 = 1;
const MANY: u64 = 2;

/// Events of one run, by callgrind's names, and how many operations a run has.
pub struct Events {
    counts: BTreeMap<String, f64>,
    /// Operations in a run.
    pub operations: f64,
}

impl Events {
    /// How many events of the kinds named; those that were not counted are 0.
    pub fn sum(&self, kinds: &[&str]) -> f64 {
        kinds.iter().map(|kind| self.counts.get(*kind).copied().unwrap_or(0.0)).sum()
    }
}

/// The version of valgrind.
///
/// # Errors
/// Where there is none.
pub fn version() -> Result<String, Box<dyn Error>> {
    let output = Command::new("valgrind").arg("--version").output();
    let output = output
        .map_err(|e| format!("valgrind: {e}; it counts instructions: install it (Debian: apt install valgrind)"))?;
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_string())
}

/// Counts a run of `kernel`; with caches of this machine's sizes and a simple predictor of branches where `simulates`.
pub fn count(kernel: &Kernel, simulates: bool) -> Result<Events, Box<dyn Error>> {
    let (few, operations) = run(kernel, FEW, simulates)?;
    let (many, _) = run(kernel, MANY, simulates)?;
    let difference = |(name, many): (String, f64)| {
        let count = (many - few.get(&name).copied().unwrap_or(0.0)) / (MANY - FEW) as f64;
        (name, count)
    };
    Ok(Events { counts: many.into_iter().map(difference).collect(), operations })
}

fn run(kernel: &Kernel, runs: u64, simulates: bool) -> Result<(BTreeMap<String, f64>, f64), Box<dyn Error>> {
    let file = std::env::temp_dir().join(format!("kernels.{}.callgrind", std::process::id()));
    let mut command = Command::new("valgrind");
    command.args(["--tool=callgrind", "--quiet"]).arg(format!("--callgrind-out-file={}", file.display()));
    if simulates {
        command.args(["--cache-sim=yes", "--branch-sim=yes"]).args(caches());
    }
    command.arg(std::env::current_exe()?).args(["run", kernel.name, &runs.to_string()]);
    let output = command.output()?;
    if !output.status.success() {
        let text = String::from_utf8_lossy(&output.stderr);
        return Err(format!("callgrind of `{}` failed: {}\n{text}", kernel.name, output.status).into());
    }
    let operations = String::from_utf8_lossy(&output.stdout).split_whitespace().next().and_then(|n| n.parse().ok());
    let text = std::fs::read_to_string(&file)?;
    std::fs::remove_file(&file)?;
    let values = |key: &str| text.lines().find_map(|line| line.strip_prefix(key)).map(str::split_whitespace);
    let (Some(names), Some(totals), Some(operations)) = (values("events:"), values("totals:"), operations) else {
        return Err(format!("callgrind of `{}` wrote no totals", kernel.name).into());
    };
    let totals = names.zip(totals).map(|(name, n)| Ok((name.to_string(), n.parse()?)));
    Ok((totals.collect::<Result<_, std::num::ParseFloatError>>()?, operations))
}

/// First and second level, the third being shared by many and larger than what is simulated here.
fn caches() -> Vec<String> {
    // Of 12 and 16 ways and lines of 64 bytes, as most processors of today have.
    let sets = |bytes: usize, ways: usize| (bytes / (64 * ways)).max(1).next_power_of_two();
    let option =
        |name: &str, bytes: usize, ways: usize| format!("--{name}={},{ways},64", sets(bytes, ways) * ways * 64);
    let first = machine::cache_bytes(1).map(|bytes| option("D1", bytes, 12));
    let second = machine::cache_bytes(2).map(|bytes| option("LL", bytes, 16));
    first.into_iter().chain(second).collect()
}

/// Counts the kernels whose name holds `filter`, prints them beside what was recorded, and records them where wanted. False
/// where one takes more instructions by a thousandth.
pub fn instructions(filter: Option<&str>, is_recording: bool) -> Result<bool, Box<dyn Error>> {
    let version = version()?;
    let mut record: Record = compare::read()?;
    println!("instructions per operation, by {version}\n{:<34}{:>14}{:>14}{:>10}", "", "now", "recorded", "ratio");
    let mut more = 0;
    for kernel in chosen(filter).filter(|k| k.role == Role::Compared) {
        let events = count(kernel, false)?;
        let now = rounded(events.sum(&["Ir"]) / events.operations);
        let figure = record.kernels.get_mut(kernel.name);
        let then = figure.as_ref().and_then(|f| f.instructions);
        let columns = [compare::short(now), then.map_or("–".into(), compare::short)];
        let ratio = then.map_or(String::new(), |then| format!("{:.5}", now / then));
        let is_more = then.is_some_and(|then| now > 1.001 * then);
        more += usize::from(is_more);
        let verdict = if is_more { "  MORE" } else { "" };
        println!("{:<34}{:>14}{:>14}{ratio:>10}{verdict}", kernel.name, columns[0], columns[1]);
        match figure {
            Some(figure) if is_recording => {
                figure.instructions = Some(now);
                record.counted_by = Some(format!("{version} on {}", machine::processor()));
                // At once: all of them take minutes.
                compare::write(&record)?;
            }
            None if is_recording => {
                return Err(format!("no time of `{}` is recorded yet: `make bench RECORD=1` first", kernel.name).into());
            }
            _ => {}
        }
    }
    if is_recording {
        println!("recorded in {}", compare::file().display());
        return Ok(true);
    }
    Ok(more == 0)
}
