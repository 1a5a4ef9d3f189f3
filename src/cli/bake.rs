//! `curlsmoke bake`.

use crate::cli::args::BakeArguments;
use crate::cli::frames::{frames, listed, load_scene, start_threads};
use crate::cli::print_result;
use crate::cli::progress::{Reporter, count};
use crate::cli::render::conclude;
use crate::cli::signals::Signals;
use crate::error::Error;
use crate::pipeline::{self, BakeJob};

/// Writes densities; the exit code.
pub(super) fn run(arguments: &BakeArguments) -> Result<u8, Error> {
    let scene = load_scene(&arguments.common, Vec::new(), listed(arguments.common.frames.as_deref())?.as_deref())?;
    let frames = frames(&arguments.common, &scene)?;
    start_threads(arguments.common.threads)?;
    let signals = Signals::listen().map_err(|e| Error::Internal(format!("signals cannot be caught: {e}")))?;
    let reporter = Reporter::new(arguments.common.progress, signals.clone());
    let mut printed = Ok(());
    let job = BakeJob {
        frames,
        volume: arguments.output.as_deref(),
        half: arguments.half,
        grids: arguments.grids.as_ref().map(|names| names.iter().copied().map(Into::into).collect()),
        velocity_units: arguments.velocity_units.map(Into::into),
        particles: arguments.particles.as_deref(),
        obstacles: arguments.obstacles.as_deref(),
    };
    let result = pipeline::bake(&scene, &job, &reporter, &mut |path, record| {
        let mut line = format!("{}  {} voxels", path.display(), count(record.grid.active_voxels as f64));
        // A bake has no sidecar to say it.
        let mass = &record.mass;
        if mass.faded > 0.0 {
            let percent = |part: f64| 100.0 * part / mass.particles;
            line += &format!(", {:.2} % of the mass moved away from obstacles", percent(mass.faded - mass.lost));
            if mass.lost > 0.0 {
                line += &format!(", {:.2e} % lost in them", percent(mass.lost));
            }
        }
        let counts = [
            (record.penetrations, "steps that ended in an obstacle were put back on its wall"),
            (record.born_inside, "particles were born in an obstacle"),
        ];
        let counts = counts.into_iter().filter(|(number, _)| *number > 0);
        let counts: Vec<String> = counts.map(|(number, what)| format!("{} {what}", count(number as f64))).collect();
        if !counts.is_empty() {
            // Of the first frame they hold its run-up, so that they are no property of the frame alone.
            line += &format!("; on the way here {}", counts.join(", "));
        }
        if printed.is_ok() {
            printed = reporter.suspend(|| print_result(&line));
        }
    });
    conclude(result.and(printed), &reporter, &signals)
}
