//! Time of a workload beside that of a chain of single cycles, in turns: what slows the processor down slows both.

use crate::loops;
use crate::workload::Workload;
use rustix::time::{ClockId, Timespec, clock_gettime};

/// Rounds of the workload and the chain.
const ROUNDS_MIN: usize = 7;
const ROUNDS_MAX: usize = 400;

/// What one operation takes.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Cost {
    /// Processor time, the median of rounds [ns].
    pub nanoseconds: f64,
    /// The same over that of a cycle of the chain beside it, the median of rounds' ratios [cycles].
    pub cycles: f64,
}

/// Measures `workload` on this thread for about `seconds`. Time in which other programs had the processor does not count.
pub fn measure(workload: &mut Workload, seconds: f64) -> Cost {
    let mut chain = loops::cycles();
    let time_of = |w: &mut Workload| {
        let start = thread_seconds();
        (w.run)();
        (thread_seconds() - start) / w.operations as f64
    };
    // Caches, tables made at first use, and the clock after a rest.
    time_of(workload);
    time_of(&mut chain);
    let end = thread_seconds() + seconds;
    let (mut times, mut ratios) = (Vec::new(), Vec::new());
    let mut before = time_of(&mut chain);
    while ratios.len() < ROUNDS_MIN || (thread_seconds() < end && ratios.len() < ROUNDS_MAX) {
        let time = time_of(workload);
        let after = time_of(&mut chain);
        times.push(time * 1e9);
        ratios.push(time / (0.5 * (before + after)));
        before = after;
    }
    Cost { nanoseconds: median(&mut times), cycles: median(&mut ratios) }
}

/// The middle one; the larger of two. 0 of none.
pub fn median(values: &mut [f64]) -> f64 {
    quantile(values, 0.5)
}

/// The value that a share `q` of `values` is below. 0 of none.
pub fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(((values.len() as f64 * q) as usize).min(values.len().saturating_sub(1))).copied().unwrap_or(0.0)
}

fn seconds(t: Timespec) -> f64 {
    t.tv_sec as f64 + 1e-9 * t.tv_nsec as f64
}

/// Processor time of this thread [s].
fn thread_seconds() -> f64 {
    seconds(clock_gettime(ClockId::ThreadCPUTime))
}

/// Processor time of all threads of this process [s].
pub fn process_seconds() -> f64 {
    seconds(clock_gettime(ClockId::ProcessCPUTime))
}
