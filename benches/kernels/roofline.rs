//! What bounds the tracing of light on this machine: cycles of each of its parts, beside the least that its instructions,
//! its loads and its mispredicted branches would take by themselves.

use crate::callgrind::{self, Events};
use crate::compare::short;
use crate::measure::{measure, median};
use crate::workload::{
    INSTRUCTIONS, NULLS_FEW, NULLS_MANY, VERTICES_FEW, VERTICES_MANY, WALK_FAR, WALK_NEAR, Workload, kernel,
};
use crate::{grid, loops, machine, section};
use std::error::Error;
use std::fmt::Write as _;

/// A part of the work: kernels that do more and less of it, or one alone.
struct Part {
    what: &'static str,
    more: &'static str,
    less: Option<&'static str>,
}

const PARTS: [Part; 6] = [
    Part { what: "cell of the walk, all occupied", more: WALK_FAR, less: Some(WALK_NEAR) },
    Part { what: "lookup along rays", more: "lookup", less: None },
    Part { what: "lookup anywhere", more: "lookup, scattered", less: None },
    Part { what: "null collision of a connection", more: NULLS_MANY, less: Some(NULLS_FEW) },
    Part { what: "vertex of a path", more: VERTICES_MANY, less: Some(VERTICES_FEW) },
    Part { what: "path", more: "path", less: None },
];

/// Rounds of each measurement, and seconds of each.
const ROUNDS: usize = 5;
const SECONDS: f64 = 0.2;

/// Cycles that little loops take.
struct Machine {
    instructions_a_cycle: f64,
    multiply_adds_a_cycle: f64,
    mispredicted: f64,
    gigahertz: f64,
    /// Latency, and cycles between loads of which eight are under way: in the first and the second level, and beyond.
    loads: [(String, f64, f64); 3],
}

/// Prints the section, and writes it into docs/performance.md where wanted; of parts whose name holds `filter`.
pub fn roofline(filter: Option<&str>, is_recording: bool) -> Result<(), Box<dyn Error>> {
    if is_recording && filter.is_some() {
        return Err("the section is written as a whole: leave out the filter".into());
    }
    let version = callgrind::version()?;
    let machine = look_at_machine()?;
    let mut text =
        format!("Measured on {}, {:.2} GHz by the chain; {version}.\n\n", machine::processor(), machine.gigahertz);
    describe_machine(&mut text, &machine)?;
    describe_parts(&mut text, &machine, filter)?;
    println!("{text}");
    if is_recording {
        section::write("roofline", "make roofline", &text)?;
    }
    Ok(())
}

fn look_at_machine() -> Result<Machine, Box<dyn Error>> {
    let cycles = |prepare: &dyn Fn() -> Workload| cycles_of(&mut prepare());
    let first = machine::cache_bytes(1).ok_or("the system does not say how large the caches are")?;
    let second = machine::cache_bytes(2).ok_or("the system does not say how large the second cache is")?;
    let bricks = grid::memory_bytes();
    let loads = [
        (first / 2, "half of the first level"),
        (second / 2, "half of the second level"),
        (bricks, "the smoke's voxels"),
    ];
    let counted = callgrind::count(kernel(INSTRUCTIONS)?, false)?;
    let clock = measure(&mut loops::cycles(), SECONDS);
    Ok(Machine {
        instructions_a_cycle: counted.sum(&["Ir"]) / counted.operations / cycles(&loops::integer_instructions),
        multiply_adds_a_cycle: 1.0 / cycles(&loops::multiply_adds),
        // Half of the random ones are mispredicted.
        mispredicted: 2.0 * (cycles(&|| loops::branches(true)) - cycles(&|| loops::branches(false))),
        gigahertz: clock.cycles / clock.nanoseconds,
        loads: loads.map(|(bytes, name)| {
            let name = format!("{name} ({:.2} MiB)", bytes as f64 / f64::from(1 << 20));
            (name, cycles(&|| loops::dependent_loads(bytes)), cycles(&|| loops::independent_loads(bytes)))
        }),
    })
}

fn cycles_of(workload: &mut Workload) -> f64 {
    median(&mut (0..ROUNDS).map(|_| measure(workload, SECONDS).cycles).collect::<Vec<_>>())
}

fn describe_machine(text: &mut String, machine: &Machine) -> std::fmt::Result {
    writeln!(text, "| the machine, by little loops | |\n|---|---|")?;
    writeln!(text, "| integer instructions a cycle | {:.2} |", machine.instructions_a_cycle)?;
    let (rate, lanes) = (machine.multiply_adds_a_cycle, loops::lane_width());
    writeln!(text, "| multiply-adds a cycle, in {lanes} lanes | {rate:.1} |")?;
    writeln!(text, "| mispredicted branch [cycles] | {:.1} |", machine.mispredicted)?;
    for (name, latency, interval) in &machine.loads {
        let (latency, interval) = (short_cycles(*latency), short_cycles(*interval));
        writeln!(text, "| load from {name}: latency; one of eight at a time [cycles] | {latency}; {interval} |")?;
    }
    writeln!(text)
}

fn short_cycles(x: f64) -> String {
    if x < 100.0 { format!("{x:.1}") } else { short(x.round()) }
}

/// A row for each part. Lower bounds are what each cause takes if all others took nothing: instructions at the highest rate;
/// misses with eight under way. Next to them what would be if nothing overlapped: misses one after the other, mispredictions.
fn describe_parts(text: &mut String, machine: &Machine, filter: Option<&str>) -> Result<(), Box<dyn Error>> {
    writeln!(
        text,
        "| cycles of | measured | instructions | at the highest rate | misses of level 1; 2 | overlapped | one by one | mispredicted | cost | bound reached |"
    )?;
    writeln!(text, "|---|---|---|---|---|---|---|---|---|---|")?;
    for part in PARTS.iter().filter(|part| filter.is_none_or(|f| part.what.contains(f))) {
        let per_operation = |more: f64, less: f64, operations: f64| (more - less) / operations;
        let (more, less) = (kernel(part.more)?, part.less.map(kernel).transpose()?);
        let (events, fewer) = (callgrind::count(more, true)?, less.map(|k| callgrind::count(k, true)).transpose()?);
        let operations = events.operations - fewer.as_ref().map_or(0.0, |f| f.operations);
        let counted = |kinds: &[&str]| {
            let less = fewer.as_ref().map_or(0.0, |f: &Events| f.sum(kinds));
            per_operation(events.sum(kinds), less, operations)
        };
        let (mut more, mut less) = ((more.prepare)(), less.map(|k| (k.prepare)()));
        let mut rounds: Vec<f64> = (0..ROUNDS)
            .map(|_| {
                let run = |w: &mut Workload| measure(w, SECONDS).cycles * w.operations as f64;
                let all = run(&mut more);
                per_operation(all, less.as_mut().map_or(0.0, run), operations)
            })
            .collect();
        let cycles = median(&mut rounds);
        let instructions = counted(&["Ir"]);
        let (first, second) = (counted(&["D1mr", "D1mw"]), counted(&["DLmr", "DLmw"]));
        let mispredicted = counted(&["Bcm", "Bim"]);
        let [_, level2, beyond] = &machine.loads;
        let wait = |level2: f64, beyond: f64| (first - second) * level2 + second * beyond;
        let (at_rate, overlapped) = (instructions / machine.instructions_a_cycle, wait(level2.2, beyond.2));
        let reached = at_rate.max(overlapped) / cycles;
        let bound = if at_rate > overlapped { "instructions" } else { "loads" };
        let cells =
            [cycles, instructions, at_rate, overlapped, wait(level2.1, beyond.1), mispredicted * machine.mispredicted];
        let [cycles, instructions, at_rate, overlapped, serial, flushed] = cells.map(short_cycles);
        writeln!(
            text,
            "| {} | {cycles} | {instructions} | {at_rate} | {first:.2}; {second:.2} | {overlapped} | {serial} | {mispredicted:.2} | {flushed} | {:.0} % ({bound}) |",
            part.what,
            100.0 * reached,
        )?;
    }
    Ok(())
}
