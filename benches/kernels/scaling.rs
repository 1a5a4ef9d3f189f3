//! How much faster two threads are than one, in turns.

use crate::machine::{Elapsed, Watch};
use crate::measure::{median, quantile};
use crate::workload::{PICTURE, kernel};
use crate::{machine, section};
use rayon::ThreadPool;
use std::error::Error;
use std::fmt::Write as _;
use std::time::{Duration, Instant};

/// What is made to scale.
const KERNELS: [&str; 4] = [PICTURE, "frame", "midpoint step", "splat"];
/// Pairs of one thread and two that are wanted, the one first and the other first in turns.
const PAIRS: usize = 9;
/// Least time of a measurement with one thread [s].
const SECONDS: f64 = 1.0;
/// Processors that other programs may keep busy in a pair that counts as undisturbed.
const QUIET: f64 = 0.1;
/// How long to wait for other programs to rest, for each kernel, before it is measured beside them [s].
const PATIENCE: f64 = 120.0;

/// Prints the section, and writes it into docs/performance.md where wanted; of kernels whose name holds `filter`.
pub fn scaling(filter: Option<&str>, is_recording: bool) -> Result<(), Box<dyn Error>> {
    if is_recording && filter.is_some() {
        return Err("the section is written as a whole: leave out the filter".into());
    }
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pools = [pool(1)?, pool(2)?];
    let mut text = format!("Measured on {}; medians and quartiles of pairs.\n\n", machine::processor());
    writeln!(
        text,
        "| | two threads over one | processor time of two over that of one | pairs | while others kept busy |"
    )?;
    writeln!(text, "|---|---|---|---|---|")?;
    for name in KERNELS.into_iter().filter(|name| filter.is_none_or(|f| name.contains(f))) {
        let (quiet, disturbed): (Vec<Pair>, Vec<Pair>) =
            pairs(name, &pools)?.into_iter().partition(|p| p.others < QUIET);
        for (pairs, is_quiet) in [(quiet, true), (disturbed, false)] {
            if pairs.is_empty() {
                continue;
            }
            let others = match is_quiet {
                true => format!("less than {QUIET} processors"),
                false => format!("{:.1} processors", median(&mut pairs.iter().map(|p| p.others).collect::<Vec<_>>())),
            };
            let spread = |of: fn(&Pair) -> f64| {
                let mut values: Vec<f64> = pairs.iter().map(of).collect();
                let [low, middle, high] = [0.25, 0.5, 0.75].map(|q| quantile(&mut values, q));
                format!("{middle:.2}, {low:.2} to {high:.2}")
            };
            let (speedup, work) = (spread(|p| p.speedup), spread(|p| p.work));
            writeln!(text, "| {name} | {speedup} | {work} | {} | {others} |", pairs.len())?;
        }
        eprintln!("{name} done");
    }
    println!("{text}");
    if is_recording {
        section::write("scaling", "make scaling", &text)?;
    }
    Ok(())
}

/// One thread and two, right after each other.
struct Pair {
    /// Time of one over that of two.
    speedup: f64,
    /// Processor time of two over that of one: what threads cost each other. Other programs leave it as it is, nearly.
    work: f64,
    /// Processors that other programs kept busy meanwhile.
    others: f64,
}

fn pairs(name: &str, pools: &[ThreadPool; 2]) -> Result<Vec<Pair>, Box<dyn Error>> {
    let mut workload = (kernel(name)?.prepare)();
    let mut time = |pool: &ThreadPool, runs: usize| {
        let watch = Watch::start();
        pool.install(|| (0..runs).for_each(|_| (workload.run)()));
        watch.stop()
    };
    time(&pools[1], 1);
    let runs = (SECONDS / time(&pools[0], 1).seconds).ceil().max(1.0) as usize;
    let (start, mut pairs): (Instant, Vec<Pair>) = (Instant::now(), Vec::new());
    loop {
        let is_late = start.elapsed().as_secs_f64() > PATIENCE;
        let quiet = pairs.iter().filter(|p| p.others < QUIET).count();
        if quiet >= PAIRS || is_late && pairs.len() >= PAIRS {
            return Ok(pairs);
        }
        if !is_late && others_now() >= QUIET {
            continue;
        }
        let mut both = [Elapsed::default(); 2];
        // The one that comes first changes: the clock may fall as the processor warms.
        let first = pairs.len() % 2;
        for turn in [first, 1 - first] {
            both[turn] = time(&pools[turn], runs);
        }
        let [one, two] = both;
        let (speedup, work) = (one.seconds / two.seconds, two.own / one.own);
        pairs.push(Pair { speedup, work, others: one.others.max(two.others) });
    }
}

/// Processors that other programs keep busy at the moment.
fn others_now() -> f64 {
    let watch = Watch::start();
    std::thread::sleep(Duration::from_millis(500));
    watch.stop().others
}

/// Time of an operation on that many threads, as the clock on the wall says: the median of a second [ns].
pub fn wall(name: &str, threads: usize) -> Result<f64, Box<dyn Error>> {
    let mut workload = (kernel(name)?.prepare)();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    pool.install(&mut workload.run);
    let (start, mut times) = (Instant::now(), Vec::new());
    while times.is_empty() || start.elapsed().as_secs_f64() < 1.0 {
        let start = Instant::now();
        pool.install(&mut workload.run);
        times.push(start.elapsed().as_secs_f64() * 1e9 / workload.operations as f64);
    }
    Ok(median(&mut times))
}
