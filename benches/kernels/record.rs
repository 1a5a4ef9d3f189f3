//! What was measured before, and when a difference from it counts.
//!
//! A kernel's cost is measured in several processes, because places in memory and the hour change it more than the rounds
//! in a process differ. Slower is what Student's t test of the logarithms says at [`LEVEL`] for all kernels together, and by
//! more than [`DRIFT`], which is what the same program was seen to differ by from one session to another.

use curlsmoke::math::statistics::{sidak, student_t_cdf};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Chance that any kernel at all of an unchanged program is called slower.
pub const LEVEL: f64 = 0.01;
/// Ratio that an unchanged program may reach for reasons that processes of one session share. Measured: docs/performance.md.
pub const DRIFT: f64 = 1.1;

/// What a kernel costs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Figure {
    /// Of what the cost is.
    pub unit: String,
    /// Processor time [ns]; median of processes.
    pub nanoseconds: f64,
    /// In cycles of the chain beside it; geometric mean of processes.
    pub cycles: f64,
    /// Standard deviation of the logarithm of `cycles` between processes.
    pub spread: f64,
    /// Processes.
    pub processes: usize,
    /// Instructions, on the lanes that callgrind has; none where they were not counted.
    pub instructions: Option<f64>,
}

/// The file of recorded figures.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Where times were measured.
    pub processor: String,
    /// Where instructions were counted, and by what.
    pub counted_by: Option<String>,
    /// By name.
    pub kernels: BTreeMap<String, Figure>,
}

impl Record {
    /// Reads the file's text.
    ///
    /// # Errors
    /// Line and column of what does not fit.
    pub fn parse(text: &str) -> Result<Self, String> {
        let record: Self = serde_json::from_str(text).map_err(|e| e.to_string())?;
        let is_cost = |x: f64| x > 0.0 && x.is_finite();
        for (name, f) in &record.kernels {
            let is_sound = is_cost(f.cycles) && is_cost(f.nanoseconds) && f.spread >= 0.0 && f.spread.is_finite();
            if !is_sound || !f.instructions.is_none_or(is_cost) || f.processes == 0 {
                return Err(format!("`{name}`: costs are above 0, spreads at least 0, processes at least 1"));
            }
        }
        Ok(record)
    }

    /// The file's text.
    pub fn to_text(&self) -> String {
        let mut text = serde_json::to_string_pretty(self).unwrap_or_default();
        text.push('\n');
        text
    }
}

/// The figure of one kernel from what each process measured: nanoseconds and cycles.
///
/// # Panics
/// Of no process.
pub fn figure(unit: &str, costs: &[[f64; 2]], instructions: Option<f64>) -> Figure {
    let mut times: Vec<f64> = costs.iter().map(|c| c[0]).collect();
    times.sort_unstable_by(f64::total_cmp);
    let n = costs.len() as f64;
    let mean = costs.iter().map(|c| c[1].ln()).sum::<f64>() / n;
    let squares = costs.iter().map(|c| (c[1].ln() - mean).powi(2)).sum::<f64>();
    Figure {
        unit: unit.into(),
        nanoseconds: rounded(times[times.len() / 2]),
        cycles: rounded(mean.exp()),
        spread: rounded((squares / (n - 1.0).max(1.0)).sqrt()),
        processes: costs.len(),
        instructions: instructions.map(rounded),
    }
}

/// To seven digits: what is written is read back as the same, and is short.
pub fn rounded(x: f64) -> f64 {
    format!("{x:.6e}").parse().unwrap_or(x)
}

/// The ratio of costs above which `now` is called slower than `then`, one of `kernels` that are looked at. Infinite where
/// both are of one process.
pub fn threshold(then: &Figure, now: &Figure, kernels: usize) -> f64 {
    let degrees = |f: &Figure| f.processes.saturating_sub(1) as f64;
    let both = degrees(then) + degrees(now);
    if both < 1.0 {
        return f64::INFINITY;
    }
    let variance = (degrees(then) * then.spread.powi(2) + degrees(now) * now.spread.powi(2)) / both;
    let error = (variance * (1.0 / then.processes as f64 + 1.0 / now.processes as f64)).sqrt();
    let t = student_t_quantile(1.0 - sidak(LEVEL, kernels), both);
    (t * error).exp().max(DRIFT)
}

/// The `t` with a probability `p`, at least one half, of less.
fn student_t_quantile(p: f64, degrees: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1e6);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if student_t_cdf(middle, degrees) < p {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}
