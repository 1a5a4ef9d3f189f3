//! `curlsmoke turntable`.

use crate::cli::frames::start_threads;
use crate::cli::progress::Reporter;
use crate::cli::render::{Movie, Names, RenderArguments, conclude, crop_of, describe, samples_of, scene_of};
use crate::cli::signals::Signals;
use crate::cli::{command_line, log, print_result};
use crate::error::Error;
use crate::output::frames;
use crate::pipeline::turntable::turntable;
use crate::pipeline::{FrameOutcome, RenderJob};
use crate::progress::Progress;
use clap::Args;

/// Views unless others are listed.
const VIEWS: &str = "1-48";
/// Names of pictures, which must not take the place of frames.
const IMAGE: &str = "out/{scene}.turn.####.exr";

/// Flags of `turntable`.
#[derive(Debug, Args)]
pub struct TurntableArguments {
    /// Flags shared with `render`; --frames lists the views, 1-48 unless it says otherwise, of which the
    /// least to the one after the largest are a turn.
    #[command(flatten)]
    pub render: RenderArguments,
    /// The frame of the scene to look at [default: its first]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    pub at: Option<i32>,
}

/// Renders a frame from all round; the exit code.
pub(super) fn run(mut arguments: TurntableArguments) -> Result<u8, Error> {
    let render = &mut arguments.render;
    render.output.get_or_insert(IMAGE.into());
    for (flag, is_given) in [("--pixel", render.pixel.is_some()), ("--missing", render.missing)] {
        if is_given {
            return Err(Error::Usage(format!("{flag} is for `render`")));
        }
    }
    let list = frames::parse(render.common.frames.as_deref().unwrap_or(VIEWS))?;
    if list.duplicate_count > 0 {
        log(&format!("note: {} views are listed more than once and made once", list.duplicate_count));
    }
    let scene = scene_of(render, arguments.at.as_ref().map(std::slice::from_ref))?;
    let (first, last) = (scene.settings.frames.first, scene.settings.frames.last);
    let frame = arguments.at.unwrap_or(first);
    if !(first..=last).contains(&frame) {
        return Err(Error::Usage(format!("--at {frame}: the scene has frames {first} to {last}")));
    }
    let crop = render.picture.crop.map(|crop| crop_of(crop, &scene)).transpose()?;
    let names = Names::of(&scene)?;
    let movie = render.movie.as_deref().map(|path| Movie::prepare(path, &scene, &names, &list.frames)).transpose()?;
    if render.dry_run {
        return describe(&scene, &list.frames, &names).map(|()| 0);
    }
    start_threads(render.common.threads)?;
    let signals = Signals::listen().map_err(|e| Error::Internal(format!("signals cannot be caught: {e}")))?;
    let reporter = Reporter::new(render.common.progress, signals.clone());
    let samples = render.samples.map(|samples| samples_of(samples, &scene)).transpose()?;
    let job = RenderJob {
        frames: list.frames,
        crop,
        resume: render.picture.resume,
        samples,
        checkpoint: render.picture.checkpoint(),
        arguments: command_line(),
    };
    let mut printed = Ok(());
    let result = turntable(&scene, frame, &job, &reporter, &mut |outcome| {
        if let FrameOutcome::Kept { frame } = outcome {
            reporter.note(&format!("view {frame} is finished already"));
        } else if printed.is_ok() {
            printed = reporter.suspend(|| print_result(&names.line(outcome)));
        }
    });
    let result = result.and(printed).and_then(|()| movie.map_or(Ok(()), |movie| movie.make()));
    conclude(result, &reporter, &signals)
}
