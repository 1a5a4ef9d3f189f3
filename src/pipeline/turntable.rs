//! One frame from all round: the camera goes in a circle about what it looks at, and all else stands still.

use crate::error::Error;
use crate::geometry::{keys, vector};
use crate::math::hash::Seed;
use crate::output::frames::check_distinct;
use crate::pipeline::fingerprint::{FileHashes, InputHash};
use crate::pipeline::studio::Studio;
use crate::pipeline::{FrameOutcome, OutputFiles, RenderJob, Shot, check_sums, check_writable, make, time_of};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::scene::settings::Keyed;
use glam::DQuat;
use std::f64::consts::TAU;

/// Renders `frame` of a scene from as many places as the job has frames, whose numbers are those of the views, and writes their files;
/// calls `on_view` after each. From the least number to the one after the largest the camera goes once round the axis `up`
/// through `look_at`, counterclockwise as seen from above.
///
/// # Errors
/// The first that any stage meets. Views finished before it stay.
pub fn turntable(
    scene: &Scene,
    frame: i32,
    job: &RenderJob,
    progress: &dyn Progress,
    on_view: &mut dyn FnMut(&FrameOutcome),
) -> Result<(), Error> {
    let files = OutputFiles::new(scene, job.samples)?;
    check_distinct(&job.frames, |view| files.image(view))?;
    check_writable(job.frames.iter().map(|&view| files.to_write(view)))?;
    check_sums(scene, job, &files)?;
    let [Some(&first), Some(&last)] = [job.frames.iter().min(), job.frames.iter().max()] else { return Ok(()) };
    let (mut studio, mut hashes): (Option<Studio>, _) = (None, FileHashes::default());
    for (index, &view) in job.frames.iter().enumerate() {
        progress.frame(view, index, job.frames.len());
        let turns = (f64::from(view) - f64::from(first)) / (f64::from(last) - f64::from(first) + 1.0);
        let turned = turned(scene, frame, view, turns);
        let fingerprint = InputHash::new(&turned, job.crop, &mut hashes)?.fingerprint(&turned, frame, &mut hashes)?;
        if job.resume && files.is_complete(view, &fingerprint) {
            on_view(&FrameOutcome::Kept { frame: view });
            continue;
        }
        let shot = Shot { scene: &turned, frame, number: view, fingerprint };
        on_view(&make(&shot, job, &files, &mut studio, progress)?);
    }
    Ok(())
}

/// The scene with its camera so many turns further, and noise of its own: that of one frame would stand still on the screen while the
/// picture turns.
fn turned(scene: &Scene, frame: i32, view: i32, turns: f64) -> Scene {
    let mut turned = scene.clone();
    let settings = &mut turned.settings;
    let (frames, time) = (&scene.settings.frames, time_of(scene, frame));
    let camera = &mut settings.camera;
    let [position, look_at, up] =
        [&camera.position, &camera.look_at, &camera.up].map(|keyed| keys(keyed, frames, vector).at(time));
    let rotation = up.try_normalize().map(|axis| DQuat::from_axis_angle(axis, TAU * turns));
    let turned_position = look_at + rotation.unwrap_or_default() * (position - look_at);
    // A camera that moves stands still where it is at the frame.
    let position = if turns == 0.0 { position } else { turned_position };
    for (keyed, value) in [(&mut camera.position, position), (&mut camera.look_at, look_at), (&mut camera.up, up)] {
        *keyed = Keyed::Constant(value.to_array());
    }
    if !settings.render.lock_seed {
        let seed = settings.render.seed;
        // The smoke keeps its own.
        if let Some(smoke) = &mut settings.smoke {
            smoke.seed.get_or_insert(seed);
        }
        settings.render.seed = Seed(seed).derive(view as u32 as u64).0;
    }
    turned
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use std::path::Path;

    #[test]
    fn the_camera_goes_round_what_it_looks_at() {
        let text = "version: 1\ncamera: {position: [1, 2, 5], look_at: [1, 1, 1]}\nlights: [{environment: {radiance: [1, 1, 1]}}]\n";
        let scene = Scene::from_text(text, Path::new("a.yaml")).unwrap_or_else(|e| panic!("{e}"));
        let place = |turns| DVec3::from_array(*turned(&scene, 1, 1, turns).settings.camera.position.first());
        assert_eq!(place(0.0), DVec3::new(1.0, 2.0, 5.0));
        // Counterclockwise from above: from in front (+z) to the right (+x).
        assert!((place(0.25) - DVec3::new(5.0, 2.0, 1.0)).length() < 1e-12, "{}", place(0.25));
        assert!((place(0.5) - DVec3::new(1.0, 2.0, -3.0)).length() < 1e-12);
        let seed = |view| turned(&scene, 1, view, 0.0).settings.render.seed;
        assert_ne!(seed(1), seed(2));
    }
}
