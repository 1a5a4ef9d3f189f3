//! `curlsmoke streamlines`.

use crate::cli::args::InspectArguments;
use crate::cli::flow::{PlaneArguments, open, rectangle};
use crate::cli::places::{self, Length};
use crate::cli::print_result;
use crate::cli::progress::count as spelled;
use crate::cli::values::Resolution;
use crate::error::Error;
use crate::inspect::line_file::LineFormat;
use crate::inspect::plane::jittered;
use crate::inspect::streamlines::{BYTES_PER_POINT, Line, LineEnd, Reach, TraceSettings, trace};
use crate::inspect::{InspectError, Inspection, line_picture};
use crate::output::extension;
use crate::output::file::{check_writable, write_atomic};
use crate::scene::Scene;
use clap::{Args, ValueEnum};
use glam::DVec3;
use std::path::PathBuf;

/// Pixels of a preview where nothing else is said.
const RESOLUTION: [u32; 2] = [960, 540];
/// Steps of a frame where nothing else is said: a step is then a hundredth of a second, and some millimetres of smoke.
const STEPS_PER_FRAME: f64 = 4.0;

/// Flags of `streamlines`.
#[derive(Debug, Args)]
pub struct StreamlinesArguments {
    /// Flags shared by verbs that look at one frame.
    #[command(flatten)]
    pub common: InspectArguments,
    /// Where to write the lines: .obj, or .ply with speed and time at each vertex
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Draw the lines from the scene's camera, to a .png file
    #[arg(long, value_name = "FILE")]
    pub preview: Option<PathBuf>,
    /// Width and height of the preview in pixels [default: 960x540]
    #[arg(long, visible_alias = "res", value_name = "SIZE")]
    pub resolution: Option<Resolution>,
    /// Let time go on along the lines, as for particles, instead of holding it still
    #[arg(long)]
    pub pathlines: bool,
    /// Where lines begin
    #[arg(long, value_enum, default_value_t = SeedPlace::Emitters)]
    pub seeds: SeedPlace,
    /// How many lines; on a plane about as many
    #[arg(short = 'n', long, value_name = "COUNT", default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..))]
    pub count: u32,
    /// How long lines are, in seconds as in 2s or in metres as in 1.5m [default: the
    /// height that the camera sees at camera.look_at]
    #[arg(long, value_name = "LENGTH", verbatim_doc_comment)]
    pub length: Option<Length>,
    /// Longest step [s] [default: a quarter of a frame]
    #[arg(long, value_name = "SECONDS", value_parser = places::seconds)]
    pub step: Option<f64>,
    /// Where the plane of --seeds plane is.
    #[command(flatten)]
    pub plane: PlaneArguments,
}

/// Where lines begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SeedPlace {
    /// All over the emitters of the scene
    Emitters,
    /// All over a plane, one line in each field of a grid
    Plane,
}

/// Traces lines; the exit code.
pub(super) fn run(arguments: &StreamlinesArguments) -> Result<u8, Error> {
    let format = format_of(arguments)?;
    let (scene, frame, inspection) = open(&arguments.common)?;
    let settings = settings(arguments, &scene, &inspection);
    let size = arguments.resolution.map_or(RESOLUTION, |r| r.pixels(RESOLUTION));
    let seed_count = u64::from(arguments.count);
    let steps = settings.step_count() as u64;
    let what = format!("{seed_count} lines of up to {steps} steps");
    let advice = "choose a smaller --count or --length, or a longer --step";
    // Half as much again, as seeds on a plane may be a few more than asked.
    let bytes_per_step = BYTES_PER_POINT * (seed_count + seed_count / 2 + 1) + inspection.bytes_per_step();
    inspection.check_memory(what, steps.saturating_add(1).saturating_mul(bytes_per_step), advice)?;
    if arguments.preview.is_some() {
        let picture = format!("a preview of {} × {} pixels", size[0], size[1]);
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let bytes = pixels.saturating_mul(line_picture::BYTES_PER_PIXEL);
        inspection.check_memory(picture, bytes, "choose a smaller --resolution")?;
    }
    for path in [&arguments.output].into_iter().chain(&arguments.preview) {
        check_writable(path)?;
    }

    let seeds = seeds(arguments, &inspection, size)?;
    let lines = if arguments.pathlines {
        trace(&inspection.moving(&settings), &seeds, &settings)
    } else {
        trace(&inspection.frozen(), &seeds, &settings)
    };
    if lines.is_empty() {
        return Err(InspectError::NoLines { seeds: seeds.len() }.into());
    }
    write_atomic(&arguments.output, &format.encode(&lines))?;
    if let Some(path) = &arguments.preview {
        let canvas = line_picture::paint(&lines, &inspection.frozen(), inspection.camera(), size);
        write_atomic(path, &canvas.to_png()?)?;
    }
    let kind = if arguments.pathlines { "path lines from" } else { "stream lines at" };
    print_result(&format!("{}: {kind} frame {frame}, {}", arguments.output.display(), summary(&lines, seeds.len())))
        .map(|()| 0)
}

fn format_of(arguments: &StreamlinesArguments) -> Result<LineFormat, Error> {
    if let Some(path) = arguments.preview.as_ref().filter(|path| extension(path) != "png") {
        return Err(Error::Usage(format!("--preview {}: a preview is a .png file", path.display())));
    }
    LineFormat::from_extension(&extension(&arguments.output)).ok_or_else(|| {
        Error::Usage(format!("--output {}: lines are written to .obj or .ply files", arguments.output.display()))
    })
}

fn settings(arguments: &StreamlinesArguments, scene: &Scene, inspection: &Inspection) -> TraceSettings {
    let camera = inspection.camera();
    TraceSettings {
        reach: arguments.length.map_or_else(|| Reach::Metres(camera.height_at(camera.look_at())), |length| length.0),
        step: arguments.step.unwrap_or(1.0 / (STEPS_PER_FRAME * scene.settings.frames.fps)),
        start: inspection.time(),
    }
}

fn seeds(arguments: &StreamlinesArguments, inspection: &Inspection, size: [u32; 2]) -> Result<Vec<DVec3>, Error> {
    let count = arguments.count as usize;
    match arguments.seeds {
        SeedPlace::Emitters => Ok(inspection.emitter_seeds(count)?),
        SeedPlace::Plane => {
            let rectangle = rectangle(inspection, &arguments.plane, size)?;
            Ok(jittered(&rectangle, count, inspection.seed()))
        }
    }
}

fn summary(lines: &[Line], seeds: usize) -> String {
    let points: usize = lines.iter().map(|line| line.points.len()).sum();
    let ended = |end: LineEnd| lines.iter().filter(|line| line.end == end).count();
    let mut text = format!("{} lines of {} points", lines.len(), spelled(points as f64));
    for (end, says) in [
        (LineEnd::Obstacle, "end at obstacles"),
        (LineEnd::Still, "end in still air"),
        (LineEnd::NotFinite, "end where the speed is not finite"),
    ] {
        if ended(end) > 0 {
            text += &format!(", {} {says}", ended(end));
        }
    }
    if seeds > lines.len() {
        text += &format!("; {} seeds are inside obstacles or in still air", seeds - lines.len());
    }
    text
}
