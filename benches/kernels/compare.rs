//! Time of all kernels now beside what was recorded.

use crate::measure::Cost;
use crate::record::{Figure, Record, figure, threshold};
use crate::workload::{KERNELS, Role};
use crate::{chosen, machine};
use std::collections::BTreeMap;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Processes that measure all kernels, one after the other, to record and to compare.
const PROCESSES_TO_RECORD: usize = 8;
const PROCESSES_TO_COMPARE: usize = 4;

/// The file of recorded figures.
pub fn file() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/recorded.json")
}

/// What was recorded; nothing where there is no file yet.
pub fn read() -> Result<Record, Box<dyn Error>> {
    let file = file();
    if !file.exists() {
        return Ok(Record::default());
    }
    let text = std::fs::read_to_string(&file)?;
    Record::parse(&text).map_err(|e| format!("{}: {e}; `make bench RECORD=1` writes it anew", file.display()).into())
}

/// Writes what is recorded.
pub fn write(record: &Record) -> Result<(), Box<dyn Error>> {
    curlsmoke::output::file::write_atomic(&file(), record.to_text().as_bytes())?;
    Ok(())
}

/// Measures the kernels whose name holds `filter`, prints them beside what was recorded, and records them where wanted.
/// False where one is slower.
pub fn compare(filter: Option<&str>, is_recording: bool) -> Result<bool, Box<dyn Error>> {
    let processor = machine::processor();
    let mut record = read()?;
    let now = measure_in_processes(filter, if is_recording { PROCESSES_TO_RECORD } else { PROCESSES_TO_COMPARE })?;
    if now.is_empty() {
        return Err(format!("no kernel has `{}` in its name", filter.unwrap_or_default()).into());
    }
    println!("now: {processor}\nrecorded: {}", if record.processor.is_empty() { "nothing" } else { &record.processor });
    let is_other = !record.processor.is_empty() && record.processor != processor;
    if is_other {
        println!("Another processor: cycles are compared all the same, and differ for its reasons too.");
    }
    println!("\ncycles per operation\n{:<34}{:>12}{:>12}{:>8}{:>9}", "", "now", "recorded", "ratio", "limit");
    let mut slower = 0;
    for kernel in KERNELS {
        let Some(figure) = now.get(kernel.name) else { continue };
        let Some(then) = record.kernels.get(kernel.name) else {
            println!("{:<34}{:>12}{:>12}", kernel.name, short(figure.cycles), "–");
            continue;
        };
        let (ratio, limit) = (figure.cycles / then.cycles, threshold(then, figure, now.len()));
        let verdict = match ratio {
            r if r > limit => "  SLOWER",
            r if r < 1.0 / limit => "  faster",
            _ => "",
        };
        slower += usize::from(ratio > limit);
        let columns = [short(figure.cycles), short(then.cycles)];
        println!("{:<34}{:>12}{:>12}{ratio:>8.3}{limit:>9.3}{verdict}", kernel.name, columns[0], columns[1]);
    }
    for name in record.kernels.keys().filter(|name| KERNELS.iter().all(|k| k.name != *name)) {
        println!("{name}: recorded, and no kernel any more");
    }
    if is_recording {
        if is_other && filter.is_some() {
            return Err(
                "what was recorded on another processor can only be renewed as a whole: leave out the filter".into()
            );
        }
        record.processor = processor;
        record.kernels.retain(|name, _| KERNELS.iter().any(|k| k.name == name));
        for (name, mut figure) in now {
            figure.instructions = record.kernels.get(&name).and_then(|old| old.instructions);
            record.kernels.insert(name, figure);
        }
        write(&record)?;
        println!("\nrecorded in {}", file().display());
        return Ok(true);
    }
    println!("\n{slower} slower; limits: docs/performance.md, \"Benches\"");
    Ok(slower == 0)
}

/// The figures of the kernels that are compared and whose name holds `filter`.
fn measure_in_processes(filter: Option<&str>, count: usize) -> Result<BTreeMap<String, Figure>, Box<dyn Error>> {
    let mut costs: BTreeMap<String, Vec<[f64; 2]>> = BTreeMap::new();
    for i in 0..count {
        eprintln!("process {} of {count}", i + 1);
        let mut command = Command::new(std::env::current_exe()?);
        command.arg("time").args(filter).stderr(Stdio::inherit());
        let output = command.output()?;
        if !output.status.success() {
            return Err(format!("measuring failed: {}", output.status).into());
        }
        let measured: BTreeMap<String, Cost> = serde_json::from_slice(&output.stdout)?;
        for (name, cost) in measured {
            costs.entry(name).or_default().push([cost.nanoseconds, cost.cycles]);
        }
    }
    let unit = |name: &str| KERNELS.iter().find(|k| k.name == name).map_or("", |k| k.unit);
    Ok(costs.into_iter().map(|(name, costs)| (name.clone(), figure(unit(&name), &costs, None))).collect())
}

/// Cost of the kernels that are compared and whose name holds `filter`, in this process.
pub fn time(filter: Option<&str>) -> BTreeMap<&'static str, Cost> {
    /// For each kernel [s].
    const SECONDS: f64 = 0.3;
    let kernels = chosen(filter).filter(|k| k.role == Role::Compared);
    kernels.map(|k| (k.name, crate::measure::measure(&mut (k.prepare)(), SECONDS))).collect()
}

/// A number with four digits or more.
pub fn short(x: f64) -> String {
    let digits = (3 - x.abs().max(1e-9).log10().floor() as i32).clamp(0, 6) as usize;
    format!("{x:.digits$}")
}
