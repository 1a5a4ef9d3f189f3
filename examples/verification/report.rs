//! What was measured: rows with an expected number, and samplers with the probability of their counts.

use crate::support::Estimate;

/// Largest deviation that passes [standard errors]: chance passes it once in 150 000 rows.
const Z_MAX: f64 = 4.5;
/// Smallest probability of a sampler's counts that passes.
const P_MIN: f64 = 1e-5;

/// All that was measured so far.
#[derive(Default)]
pub struct Report {
    text: String,
    failures: Vec<String>,
    scores: Vec<f64>,
    probabilities: Vec<f64>,
}

const INTRODUCTION: &str = "\
# Known answers

Written by `make verification`, which fails where a deviation passes 4.5 standard errors or the counts of a sampler have
a probability below 10⁻⁵. What is expected comes from a closed form, a published number, or a quadrature or solver in
`examples/verification/` that shares no code with the renderer. Means are of camera paths as pictures have them, traced
by the same function; σ is the standard error of the mean, from the spread between blocks of 4096 paths. Rounding counts
as one part in a million, where paths do not differ. Seeds are fixed, so that the figures are the same on every run.
The first column of every table says what was set, the last how far off the mean is.

";

impl Report {
    /// Opens a group: what is verified, and where the expected numbers come from.
    pub fn group(&mut self, heading: &str, source: &str) {
        println!("{heading}");
        self.text.push_str(&format!(
            "## {heading}\n\n{source}\n\n| what | expected | measured | σ | deviation [σ] |\n|---|---|---|---|---|\n"
        ));
    }

    /// A row: what was measured against what is expected.
    pub fn row(&mut self, name: &str, expected: f64, found: Estimate) {
        let z = found.z(expected).copysign(found.mean - expected);
        let error = found.standard_error.max(1e-6 * expected.abs());
        println!("  {name}: {} ± {}, expected {expected}, {z:+.2}", found.mean, found.standard_error);
        self.text.push_str(&format!(
            "| {name} | {} | {} | {:.1e} | {z:+.2} |\n",
            digits(expected, error),
            digits(found.mean, error),
            found.standard_error
        ));
        self.scores.push(z);
        // Also where it is no number.
        if z.is_nan() || z.abs() > Z_MAX {
            self.failures.push(format!("{name}: {z:+.2} standard errors"));
        }
    }

    /// A seed for the next row, so that no two rows share their luck.
    pub fn seed(&self) -> u64 {
        1 + self.scores.len() as u64
    }

    /// Opens a group of samplers.
    pub fn sampler_group(&mut self, heading: &str, source: &str) {
        println!("{heading}");
        self.text.push_str(&format!("## {heading}\n\n{source}\n\n| what | samples | cells | p |\n|---|---|---|---|\n"));
    }

    /// A sampler: probability `p` of counts as far from the density, or farther.
    pub fn sampler(&mut self, name: &str, samples: usize, cells: usize, p: f64) {
        println!("  {name}: p = {p:.4}");
        self.text.push_str(&format!("| {name} | {samples} | {cells} | {p:.3} |\n"));
        self.probabilities.push(p);
        if p.is_nan() || p < P_MIN {
            self.failures.push(format!("{name}: p = {p:.1e}"));
        }
    }

    /// Closes a group.
    pub fn end(&mut self) {
        self.text.push('\n');
    }

    /// What failed, a line each.
    pub fn failures(&self) -> &[String] {
        &self.failures
    }

    /// All of it in a sentence.
    pub fn verdict(&self) -> String {
        let squares = self.scores.iter().map(|z| z * z).sum::<f64>() / self.scores.len().max(1) as f64;
        let worst = self.scores.iter().fold(0.0f64, |worst, z| worst.max(z.abs()));
        let least = self.probabilities.iter().copied().fold(1.0, f64::min);
        let failed = match self.failures.as_slice() {
            [] => "none fails".to_string(),
            failures => format!("FAILED: {}", failures.join("; ")),
        };
        format!(
            "{} answers, the farthest off by {worst:.2} standard errors, the root of the mean square {:.2} (1 where \
             nothing but chance is left); {} samplers, the least probability {least:.3}: {failed}",
            self.scores.len(),
            squares.sqrt(),
            self.probabilities.len()
        )
    }

    /// The whole page.
    pub fn page(&self) -> String {
        format!("{INTRODUCTION}**{}.**\n\n{}", self.verdict(), self.text)
    }
}

/// A number with the digits that its error leaves, and one more.
fn digits(x: f64, error: f64) -> String {
    if x != 0.0 && x.abs() < 1e-3 {
        return format!("{x:.3e}");
    }
    let places = if error > 0.0 { (1.0 - error.log10().floor()).clamp(0.0, 7.0) as usize } else { 6 };
    format!("{x:.places$}")
}
