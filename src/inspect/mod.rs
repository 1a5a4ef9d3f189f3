//! What an artist looks at before rendering: the flow of a scene on a plane, and lines along it.

pub mod canvas;
pub mod glyphs;
pub mod lic;
pub mod line_file;
pub mod line_picture;
pub mod palette;
pub mod plane;
pub mod point_file;
pub mod point_plot;
pub mod probe;
pub mod sheet;
pub mod slice;
pub mod slice_picture;
pub mod stream;
pub mod streamlines;
pub mod warp;

use crate::flow::Flow;
use crate::geometry::{Geometry, keys, vector};
use crate::inspect::plane::Perspective;
use crate::inspect::probe::SceneFlow;
use crate::inspect::streamlines::TraceSettings;
use crate::math::hash::Seed;
use crate::particles::emit::{Emitter, Schedule};
use crate::particles::{ParticlesError, build_place, emitter_motion};
use crate::scene::Scene;
use crate::scene::settings;
use glam::DVec3;
use thiserror::Error;

/// Noise and seeds start with this word in the derivation of their keys.
const INSPECT_KEYS: u64 = 0x6C6F_6F6B;

/// Why there is nothing to look at.
#[derive(Debug, Error)]
pub enum InspectError {
    /// Lines cannot start where nothing is emitted.
    #[error(
        "the scene has no smoke.emitters for lines to start from; start them on a plane with --seeds plane, or add an emitter"
    )]
    NoEmitters,
    /// Lines cannot start from an emitter.
    #[error(transparent)]
    Emitter(#[from] ParticlesError),
    /// There is no distance without obstacles.
    #[error(
        "the scene has no flow.obstacles, flow.containers or flow.dfvn.inside, so there is no distance to draw; choose another --quantity"
    )]
    NoObstacles,
    /// No line came of any seed.
    #[error(
        "none of the {seeds} seeds gives a line: they are inside obstacles, or nothing moves there; choose others with --seeds and --plane"
    )]
    NoLines {
        /// How many seeds there were.
        seeds: usize,
    },
    /// More memory than allowed.
    #[error(
        "{what} needs {needed_gib:.2} GiB of memory, more than the limit of {limit_gib} GiB; {advice}, or raise it with --memory-limit"
    )]
    OverMemoryLimit {
        /// What is too large.
        what: String,
        /// Memory that would be needed [GiB].
        needed_gib: f64,
        /// Memory that is allowed [GiB].
        limit_gib: f64,
        /// What makes it smaller.
        advice: &'static str,
    },
}

/// A scene made ready to be looked at, at one frame.
pub struct Inspection {
    flow: Flow,
    geometry: Geometry,
    emitters: Vec<settings::Emitter>,
    camera: Perspective,
    time: f64,
    seed: Seed,
    memory_limit_gib: f64,
    bytes_per_step: u64,
}

impl Inspection {
    /// Looks at a frame of a scene, whose shapes and flow are given.
    ///
    /// # Panics
    /// When the camera looks nowhere, which no valid scene does.
    pub fn build(scene: &Scene, frame: i32, geometry: Geometry, flow: Flow) -> Self {
        let settings = &scene.settings;
        let camera = &settings.camera;
        // As for particles: the first frame is at time 0.
        let time = (f64::from(frame) - f64::from(settings.frames.first)) / settings.frames.fps;
        let [position, look_at, up] =
            [&camera.position, &camera.look_at, &camera.up].map(|v| keys(v, &settings.frames, vector).at(time));
        let fov = keys(&camera.vertical_fov_deg, &settings.frames, |x| *x).at(time);
        Self {
            flow,
            geometry,
            emitters: settings.smoke.as_ref().map(|smoke| smoke.emitters.clone()).unwrap_or_default(),
            camera: Perspective::try_new(position, look_at, up, fov)
                .expect("validation refuses cameras that look nowhere"),
            time,
            seed: Seed(settings.render.seed).derive(INSPECT_KEYS),
            memory_limit_gib: settings.render.memory_limit_gib,
            bytes_per_step: bytes_per_step(&settings.flow),
        }
    }

    /// What is likely a mistake in the meshes of the scene.
    pub fn warnings(&self) -> &[String] {
        &self.geometry.warnings
    }

    /// Time of the frame [s].
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Key of the random numbers of pictures and seeds.
    pub fn seed(&self) -> Seed {
        self.seed
    }

    /// The camera of the scene.
    pub fn camera(&self) -> &Perspective {
        &self.camera
    }

    /// Whether the flow has something to go round.
    pub fn has_obstacles(&self) -> bool {
        !self.flow.walls().obstacles().is_empty()
    }

    /// The flow as it stands at the frame.
    pub fn frozen(&self) -> SceneFlow<'_> {
        SceneFlow::frozen(&self.flow, self.time)
    }

    /// The flow from the frame on, as long as lines with these settings need it.
    pub fn moving(&self, settings: &TraceSettings) -> SceneFlow<'_> {
        SceneFlow::moving(&self.flow, settings.start, settings.even_step(), settings.step_count())
    }

    /// Points all over the emitters of the scene, the same number for each, `count` in all.
    ///
    /// # Errors
    /// Where there is no emitter, or one without a surface.
    pub fn emitter_seeds(&self, count: usize) -> Result<Vec<DVec3>, InspectError> {
        if self.emitters.is_empty() {
            return Err(InspectError::NoEmitters);
        }
        let mut seeds = Vec::with_capacity(count);
        for (i, settings) in self.emitters.iter().enumerate() {
            let own = count * (i + 1) / self.emitters.len() - count * i / self.emitters.len();
            let emitter = self.emitter(settings, i, own as u64)?;
            seeds.extend(
                (0..own as u64)
                    .filter_map(|n| emitter.birth(n))
                    .map(|birth| DVec3::from_array(birth.position.map(f64::from))),
            );
        }
        Ok(seeds)
    }

    fn emitter(&self, e: &settings::Emitter, emitter_idx: usize, count: u64) -> Result<Emitter, InspectError> {
        Ok(Emitter {
            place: build_place(e, emitter_idx, &self.geometry)?,
            strands: None,
            schedule: Schedule::Count(count),
            // Where the shape that it is on has moved to.
            start: self.time,
            stop: f64::INFINITY,
            lifetime: 1.0,
            lifetime_spread: 0.0,
            particle_mass: 1.0,
            fade_in: 0.0,
            fade_out: 0.0,
            seed: self.seed.derive(emitter_idx as u64),
            motion: emitter_motion(e, &self.geometry),
        })
    }

    /// Memory that the flow takes for each step of time that goes on, by a wide margin [bytes].
    pub fn bytes_per_step(&self) -> u64 {
        self.bytes_per_step
    }

    /// An error where something needs more memory than the scene allows.
    ///
    /// # Errors
    /// [`InspectError::OverMemoryLimit`] with what is too large and what makes it smaller.
    pub fn check_memory(&self, what: String, bytes: u64, advice: &'static str) -> Result<(), InspectError> {
        let needed_gib = bytes as f64 / f64::from(1 << 30);
        if needed_gib > self.memory_limit_gib {
            let limit_gib = self.memory_limit_gib;
            return Err(InspectError::OverMemoryLimit { what, needed_gib, limit_gib, advice });
        }
        Ok(())
    }
}

/// A kilobyte for each octave, and another for each obstacle that it goes round.
fn bytes_per_step(flow: &settings::Flow) -> u64 {
    let octaves = |p: &settings::Potential| match p {
        settings::Potential::Noise(noise) => u64::from(noise.octaves),
        _ => 1,
    };
    let walls = (flow.obstacles.len() + flow.holders().count()) as u64;
    1024 * flow.potentials.iter().map(octaves).sum::<u64>() * (1 + walls)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::NoFiles;
    use crate::inspect::probe::Flow as _;
    use crate::progress::Silent;
    use std::path::Path;

    const SCENE: &str = "\
version: 1
frames: {first: 5, last: 9, fps: 10}
camera: {position: [0, 1, 4], look_at: [0, 1, 0]}
film: {resolution: [16, 9]}
shapes:
  ball:
    sphere: {center: [0, 1, 0], radius: 0.3}
flow:
  potentials:
    - uniform: {velocity: [0, 0.7, 0]}
    - noise: {length_scale: 0.5, speed: 0.3, octaves: 2, spin_rate: 0.5, scroll: [0, 0.4, 0]}
  obstacles: [ball]
lights:
  - environment: {radiance: [1, 1, 1]}
smoke:
  emitters:
    - disk: {center: [0, 0.1, 0], radius: 0.2}
      rate: 100
      mass: 1
      lifetime: 2
    - point: {position: [1, 0, 0]}
      rate: 100
      mass: 1
      lifetime: 2
  grid: {voxel_size: 0.1}
  medium: {extinction: 1, albedo: [1, 1, 1], phase: {henyey_greenstein: {g: 0}}}
";

    fn inspection(frame: i32) -> Inspection {
        let scene = Scene::from_text(SCENE, Path::new("test.yaml")).unwrap_or_else(|e| panic!("{e}"));
        let geometry = Geometry::build(&scene, &Silent).unwrap();
        let flow = Flow::build(&scene, &geometry, &NoFiles).unwrap();
        Inspection::build(&scene, frame, geometry, flow)
    }

    #[test]
    fn the_flow_looked_at_is_the_field_of_the_scene_at_the_frame() {
        let inspection = inspection(8);
        let p = DVec3::new(0.3, 0.6, 0.2);
        assert!((inspection.time() - 0.3).abs() < 1e-12 && inspection.has_obstacles());
        let truth = DVec3::from_array(inspection.flow.span(inspection.time(), 0.0).velocity(p.to_array(), 0.0));
        assert_eq!(inspection.frozen().velocity(p, 99.0), truth);
        let settings = TraceSettings { reach: streamlines::Reach::Seconds(1.0), step: 0.01, start: inspection.time() };
        let moving = inspection.moving(&settings);
        for time in [0.3, 0.3049, 0.7, 1.2999] {
            let truth = DVec3::from_array(inspection.flow.span(time, 0.0).velocity(p.to_array(), 0.0));
            let found = moving.velocity(p, time);
            assert!(found.distance(truth) < 1e-5, "{time}: {found} {truth}");
        }
        assert!(moving.velocity(p, 0.3).distance(moving.velocity(p, 1.3)) > 1e-3, "time goes on");
    }

    #[test]
    fn seeds_are_shared_among_emitters_and_repeat() {
        let seeds = inspection(5).emitter_seeds(7).unwrap();
        assert_eq!((seeds.len(), seeds[6]), (7, DVec3::X));
        assert!(seeds[..3].iter().all(|p| (p.y - 0.1).abs() < 1e-6 && p.length() < 0.25));
        assert_eq!(seeds, inspection(9).emitter_seeds(7).unwrap());
    }
}
