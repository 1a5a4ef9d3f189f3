//! Light transport held against known answers, each with its deviation in standard errors: `make verification` writes
//! docs/verification.md and fails where one is off.
//!
//! What is expected never comes from the renderer's own functions: it is a closed form, a published number, or a
//! quadrature or solver written here in f64. A row is a call of `Report::row`; a group of rows is a file with one
//! public function, named in `GROUPS`. `cargo run --release --example verification -- furnace` runs one group, and
//! writes nothing.

#![allow(clippy::print_stdout, reason = "what it is for")]

mod adding_doubling;
mod extinction;
mod form_factors;
mod furnaces;
mod gauss;
mod half_space;
mod reciprocity;
mod report;
mod samplers;
mod setting;
mod single_scattering;
mod skies;
mod slabs;
#[path = "../../tests/support/mod.rs"]
mod support;
mod voxels;

use curlsmoke::output::file::write_atomic;
use report::Report;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

/// Measures the rows of a group.
type Rows = fn(&mut Report);

/// What is verified, by the word that picks it on the command line.
const GROUPS: [(&str, Rows); 9] = [
    ("extinction", extinction::rows),
    ("furnaces", furnaces::rows),
    ("single_scattering", single_scattering::rows),
    ("half_space", half_space::rows),
    ("slabs", slabs::rows),
    ("form_factors", form_factors::rows),
    ("skies", skies::rows),
    ("reciprocity", reciprocity::rows),
    ("samplers", samplers::rows),
];

/// From here on the page is written by another command.
const OTHERS: &str = "<!-- What follows is written by benches/mitsuba_compare.py. -->";

fn main() -> ExitCode {
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let mut report = Report::default();
    let start = Instant::now();
    for (name, rows) in GROUPS {
        if wanted.is_empty() || wanted.iter().any(|word| name.starts_with(word.as_str())) {
            let start = Instant::now();
            rows(&mut report);
            println!("-- {name}: {:.0} s", start.elapsed().as_secs_f64());
        }
    }
    println!("{} in {:.0} s", report.verdict(), start.elapsed().as_secs_f64());
    if wanted.is_empty() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/verification.md");
        let old = std::fs::read_to_string(&file).unwrap_or_default();
        let others = old.find(OTHERS).map_or("", |at| &old[at..]);
        write_atomic(&file, (report.page() + others).as_bytes()).expect("docs/verification.md can be written");
    }
    if report.failures().is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
