//! From flags to a scene, a list of frames and a pool of threads: what `render` and `bake` share.

use crate::cli::args::FrameArguments;
use crate::cli::{log, warn_about};
use crate::error::Error;
use crate::output::frames;
use crate::scene::Scene;
use crate::scene::pattern::spell;
use std::path::Path;

/// The scene with `overrides`, to make its frames, or all where `None`; tells its warnings.
pub fn load_scene(path: &Path, overrides: &[(String, String)], frames: Option<&[i32]>) -> Result<Scene, Error> {
    warn_about(Scene::load_for(path, overrides, frames), |scene| {
        scene.warnings.iter().map(ToString::to_string).collect()
    })
}

/// What the flags of all verbs that make frames set: `--set` after the others, so that it has the last word.
pub fn overrides(arguments: &FrameArguments) -> Vec<(String, String)> {
    [flags(arguments), set_by_hand(arguments)].concat()
}

/// What flags of their own say.
fn flags(arguments: &FrameArguments) -> Vec<(String, String)> {
    let seed = arguments.seed.map(|seed| ("render.seed".into(), seed.to_string()));
    let memory = arguments.memory_limit.map(|memory| ("render.memory_limit_gib".into(), memory.0.to_string()));
    seed.into_iter().chain(memory).collect()
}

/// What `--set` says.
pub fn set_by_hand(arguments: &FrameArguments) -> Vec<(String, String)> {
    arguments.overrides.iter().map(|o| (o.0.clone(), o.1.clone())).collect()
}

/// The frames that `--frames` lists, if it is there, before it is known which the scene has.
pub fn listed(text: Option<&str>) -> Result<Option<Vec<i32>>, Error> {
    Ok(text.map(frames::parse).transpose()?.map(|list| list.frames))
}

/// The frames to make: those of `--frames`, or all of the scene.
pub fn frames(arguments: &FrameArguments, scene: &Scene) -> Result<Vec<i32>, Error> {
    list_of(arguments.frames.as_deref(), scene)
}

/// The same from the text of `--frames`.
pub fn list_of(text: Option<&str>, scene: &Scene) -> Result<Vec<i32>, Error> {
    let (first, last) = (scene.settings.frames.first, scene.settings.frames.last);
    let Some(text) = text else { return Ok((first..=last).collect()) };
    let list = frames::parse(text)?;
    if list.duplicate_count > 0 {
        log(&format!("note: {} frames are listed more than once and made once", list.duplicate_count));
    }
    // Memory was checked for the frames of the scene.
    match list.frames.iter().find(|f| !(first..=last).contains(f)) {
        Some(frame) => Err(Error::Usage(format!(
            "frame {frame} is not one of the scene's frames {}; {}",
            spell(&(first..=last).collect::<Vec<_>>()),
            ways_to_have(&list.frames, first, last)
        ))),
        None => Ok(list.frames),
    }
}

/// What to do to have frames, not all of which are among `first` to `last`.
fn ways_to_have(frames: &[i32], first: i32, last: i32) -> String {
    let (least, most) = frames.iter().fold((first, last), |(least, most), &f| (least.min(f), most.max(f)));
    let mut ways = Vec::new();
    if most > last {
        ways.push(format!("to go on longer, --set frames.last={most}"));
    }
    if least < first {
        ways.push(format!(
            "time 0 is at the first frame, so --set frames.first={least} moves it there and changes every frame; smoke \
             that should be there at frame {first} already needs only an emitter whose `start` is below 0"
        ));
    }
    ways.join("; ")
}

/// Makes the pool of threads that all stages use.
pub fn start_threads(threads: Option<usize>) -> Result<(), Error> {
    /// More threads than this are a slip of the finger.
    const THREADS_MAX: usize = 512;
    let count = threads.unwrap_or(0);
    if threads == Some(0) || count > THREADS_MAX {
        return Err(Error::Usage(format!("--threads {count}: write a number from 1 to {THREADS_MAX}")));
    }
    rayon::ThreadPoolBuilder::new()
        .num_threads(count)
        .build_global()
        .map_err(|e| Error::Usage(format!("--threads {count}: {e}")))
}
