//! `curlsmoke bake`.

use crate::cli::args::FrameArguments;
use crate::cli::frames::{frames, listed, load_scene, overrides, start_threads};
use crate::cli::print_result;
use crate::cli::progress::{Reporter, count};
use crate::cli::render::conclude;
use crate::cli::signals::Signals;
use crate::error::Error;
use crate::pipeline::{self, BakeJob};
use crate::scene::settings::{VelocityUnits, VolumeGrid};
use clap::{Args, ValueEnum};

/// Flags of `bake`.
#[derive(Debug, Args)]
pub struct BakeArguments {
    /// Flags shared with `render`.
    #[command(flatten)]
    pub common: FrameArguments,
    /// File names, with #### for the frame, instead of output.volume
    #[arg(short, long, value_name = "PATTERN")]
    pub output: Option<String>,
    /// Half precision: half the size, what is beyond ±65504 is cut
    #[arg(long)]
    pub half: bool,
    /// Grids beside the density, several with commas, instead of output.volume_grids; with velocity the density is that of one
    /// instant
    #[arg(long, value_enum, value_delimiter = ',', value_name = "GRIDS")]
    pub grids: Option<Vec<GridName>>,
    /// Unit of the velocities: metres a second or a frame [default: output.velocity_units]
    #[arg(long, value_enum, value_name = "UNIT")]
    pub velocity_units: Option<UnitName>,
    /// Write the particles too, as PLY: place, velocity, age, lifetime, mass, radius; #### is the frame
    #[arg(long, value_name = "PATTERN")]
    pub particles: Option<String>,
    /// Write the obstacles too, as a level set [m] on the voxels of the density; with #### of each frame, else of the first
    #[arg(long, value_name = "PATTERN")]
    pub obstacles: Option<String>,
}

/// A grid beside the density.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum GridName {
    /// Velocities, named v
    Velocity,
    /// Temperatures [K], named temperature, of smoke with smoke.blackbody
    Temperature,
}

impl From<GridName> for VolumeGrid {
    fn from(name: GridName) -> Self {
        match name {
            GridName::Velocity => Self::Velocity,
            GridName::Temperature => Self::Temperature,
        }
    }
}

/// Unit of velocities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum UnitName {
    /// Metres a second
    Second,
    /// Metres a frame
    Frame,
}

impl From<UnitName> for VelocityUnits {
    fn from(name: UnitName) -> Self {
        match name {
            UnitName::Second => Self::Second,
            UnitName::Frame => Self::Frame,
        }
    }
}

/// Writes densities; the exit code.
pub(super) fn run(arguments: &BakeArguments) -> Result<u8, Error> {
    let common = &arguments.common;
    let scene = load_scene(&common.scene, &overrides(common), listed(common.frames.as_deref())?.as_deref())?;
    let frames = frames(common, &scene)?;
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
