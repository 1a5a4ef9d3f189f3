//! What figures were measured on, and who else was there.

use crate::loops;
use crate::measure::process_seconds;
use std::fs::read_to_string;
use std::time::Instant;

/// Clock ticks a second in `/proc/stat`, the same on all Linux of today.
const TICKS: f64 = 100.0;

/// Model of the processor, as it says itself, and how many numbers it computes at once.
pub fn processor() -> String {
    let info = read_to_string("/proc/cpuinfo").unwrap_or_default();
    let value = |key: &str| {
        let line = info.lines().find(|line| line.split(':').next().is_some_and(|k| k.trim() == key))?;
        Some(line.split_once(':')?.1.trim().to_string())
    };
    let model = value("model name").unwrap_or_else(|| format!("unknown {}", std::env::consts::ARCH));
    let family =
        value("cpu family").zip(value("model")).map_or(String::new(), |(f, m)| format!(", family {f} model {m}"));
    format!("{model}{family}, {} lanes", loops::lane_width())
}

/// A cache of data in this machine [bytes], by its level; `None` where nobody says.
pub fn cache_bytes(level: u32) -> Option<usize> {
    let folder = "/sys/devices/system/cpu/cpu0/cache";
    (0..8).find_map(|i| {
        let read = |key: &str| read_to_string(format!("{folder}/index{i}/{key}")).ok();
        let is_wanted = read("level")?.trim() == level.to_string() && read("type")?.trim() != "Instruction";
        is_wanted.then(|| read("size")?.trim().strip_suffix('K')?.parse::<usize>().ok().map(|k| k << 10))?
    })
}

/// Since when, and what all processors and this program had done by then [s].
pub struct Watch {
    start: Instant,
    busy: Option<f64>,
    own: f64,
}

impl Watch {
    /// From now on.
    pub fn start() -> Self {
        Self { start: Instant::now(), busy: busy_seconds(), own: process_seconds() }
    }

    /// What happened since then.
    pub fn stop(&self) -> Elapsed {
        let (seconds, own) = (self.start.elapsed().as_secs_f64(), process_seconds() - self.own);
        let busy = self.busy.zip(busy_seconds()).map_or(f64::NAN, |(before, after)| after - before);
        Elapsed { seconds, own, others: (busy - own) / seconds }
    }
}

/// What happened in a while.
#[derive(Debug, Clone, Copy, Default)]
pub struct Elapsed {
    /// Time that passed [s].
    pub seconds: f64,
    /// Processor time of all threads of this program [s].
    pub own: f64,
    /// Processors that other programs kept busy; NaN where the system does not tell.
    pub others: f64,
}

/// What all processors together did for anybody since the machine began, and what was taken from it [s].
fn busy_seconds() -> Option<f64> {
    let stat = read_to_string("/proc/stat").ok()?;
    let ticks: Vec<f64> = stat.lines().next()?.split_whitespace().skip(1).filter_map(|t| t.parse().ok()).collect();
    // user, nice, system, idle, waiting, interrupts of two kinds, stolen.
    let [user, nice, system, _, _, irq, soft_irq, stolen] = ticks.get(..8)?.try_into().ok()?;
    let all: f64 = user + nice + system + irq + soft_irq + stolen;
    Some(all / TICKS)
}
