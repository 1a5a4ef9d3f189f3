//! Particles of smoke: where they come from and where they go.

pub mod advect;
pub mod bend;
pub mod emit;
pub mod follow;
pub mod system;

use crate::flow::Flow;
use crate::geometry::motion::Motion;
use crate::geometry::{Geometry, Shape};
use crate::math::hash::Seed;
use crate::particles::advect::{CLASSICAL, EULER, MIDPOINT};
use crate::particles::bend::Bends;
use crate::particles::emit::{Emitter, Place, Schedule, Surface};
use crate::particles::system::{KernelSize, TimeGrid};
use crate::scene::footprint::{held_count, live_count, particle_bytes};
use crate::scene::settings::{self, Integrator};
use crate::scene::{Scene, settings::Settings};
use glam::DVec3;
use std::f64::consts::PI;
use std::sync::Arc;
use thiserror::Error;

pub use crate::particles::system::ParticleSystem;

/// Particles start with this word in the derivation of their keys.
const PARTICLE_KEYS: u64 = 0x7061_7274;
/// Turn of a wall in a step from which on its ends do not tell which way round it went [rad], but for rounding.
const HALF_TURN: f64 = PI * (1.0 - 1e-9);
/// Part of a turn in a step that times of late steps may lose by rounding, and more.
const ROUNDED: f64 = 1e-6;
/// Pieces of a step in which its largest angular velocity is looked for.
const PIECES: u32 = 16;
/// Most steps of a frame that a scene may ask for.
const SUBSTEPS_MAX: u32 = 1000;
/// The least kernel radius, and the default [voxels].
const KERNEL_VOXELS: f64 = 1.5;

/// The particles alive at a frame, in the order of emitter and index: an array for each quantity.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Particles {
    /// Places [m], an array for each axis.
    pub position: [Vec<f32>; 3],
    /// Velocities at the frame's time [m/s], an array for each axis.
    pub velocity: [Vec<f32>; 3],
    /// How their ways bend while the shutter is open; empty where it is not.
    pub bends: Option<Bends>,
    /// Masses, faded in and out [density unit · m³].
    pub mass: Vec<f32>,
    /// Reach of the kernel to splat with [m].
    pub radius: Vec<f32>,
    /// Time since birth [s].
    pub age: Vec<f32>,
    /// Identity: emitter and index in one word.
    pub id: Vec<u64>,
}

impl Particles {
    /// How many.
    pub fn len(&self) -> usize {
        self.id.len()
    }

    /// True when there is none.
    pub fn is_empty(&self) -> bool {
        self.id.is_empty()
    }

    fn clear(&mut self) {
        self.position.iter_mut().chain(&mut self.velocity).for_each(Vec::clear);
        [&mut self.mass, &mut self.radius, &mut self.age].into_iter().for_each(Vec::clear);
        self.id.clear();
    }
}

/// Why there are no particles.
#[derive(Debug, Error)]
pub enum ParticlesError {
    /// More memory than allowed.
    #[error(
        "up to {count:.0} particles are held at once, which takes {needed_gib:.2} GiB; the limit is {limit_gib} GiB: lower the rate, count or lifetime of smoke.emitters, set smoke.advect.batch, or raise render.memory_limit_gib"
    )]
    OverMemoryLimit {
        /// Most particles held at once.
        count: f64,
        /// Memory for them [GiB].
        needed_gib: f64,
        /// Memory allowed [GiB].
        limit_gib: f64,
    },
    /// An emitter's shape cannot emit.
    #[error(
        "emitter {emitter_idx} (from 0): shape \"{shape}\" has no surface to emit from: it must be a mesh with an area"
    )]
    NoSurface {
        /// Which emitter.
        emitter_idx: usize,
        /// The shape's name.
        shape: String,
    },
    /// The scene has no particles to move.
    #[error("the scene has no smoke.emitters and smoke.grid")]
    NoEmitters,
    /// The velocity field has thrown a particle out of all bounds.
    #[error("a particle's position is not finite at frame {frame}; the speeds of flow.potentials are too large")]
    NotFinite {
        /// Which frame.
        frame: i32,
    },
    /// Stopped on request.
    #[error("cancelled")]
    Cancelled,
}

impl ParticleSystem {
    /// The particles of a scene in its flow.
    ///
    /// # Errors
    /// Too many particles for the memory limit, an emitter whose shape is no mesh, or no emitters at all.
    pub fn build(scene: &Scene, geometry: &Geometry, flow: Flow) -> Result<Self, ParticlesError> {
        let settings = &scene.settings;
        let smoke = settings.smoke.as_ref().ok_or(ParticlesError::NoEmitters)?;
        let grid = smoke.grid.as_ref().ok_or(ParticlesError::NoEmitters)?;
        check_memory(settings, smoke)?;
        let seed = Seed(settings.smoke_seed()).derive(PARTICLE_KEYS);
        let emitters = smoke.emitters.iter().enumerate();
        let emitters = emitters
            .map(|(i, e)| build_emitter(e, i, seed.derive(i as u64), geometry))
            .collect::<Result<Vec<_>, _>>()?;
        let scheme = match smoke.advect.integrator {
            Integrator::Euler => EULER,
            Integrator::Rk2 => MIDPOINT,
            Integrator::Rk4 => CLASSICAL,
        };
        let frames = &settings.frames;
        let time = TimeGrid { first_frame: frames.first, substeps: smoke.advect.substeps, fps: frames.fps };
        let least = KERNEL_VOXELS * grid.voxel_size;
        let kernel =
            KernelSize { initial_radius: grid.kernel_radius.unwrap_or(least).max(least), expansion: grid.expansion };
        let mut system = Self::new(flow, emitters, time, scheme, kernel);
        system.open_shutter(frames.shutter.map(|share| share / frames.fps));
        Ok(system)
    }
}

/// Walls that turn so far in a step of the particles that it is lost which way round, and what to do: a sentence for each,
/// with its place in the scene.
pub fn wall_warnings(scene: &Scene, geometry: &Geometry) -> Vec<String> {
    let settings = &scene.settings;
    let Some(smoke) = settings.smoke.as_ref().filter(|smoke| smoke.grid.is_some()) else { return Vec::new() };
    let frames = &settings.frames;
    let grid = TimeGrid { first_frame: frames.first, substeps: smoke.advect.substeps, fps: frames.fps };
    let oldest = smoke.emitters.iter().map(|e| e.start.max(-e.lifetime * (1.0 + e.lifetime_spread)));
    let steps = grid.step_before(oldest.fold(0.0, f64::min))..grid.step_of_frame(frames.last);
    let is_wall = |name: &String| settings.flow.obstacles.contains(name) || settings.flow.holders().any(|n| n == name);
    let walls = geometry.shapes.iter().filter(|shape| is_wall(&shape.name));
    let moving = walls.filter_map(|shape| Some((shape, shape.motion.as_ref()?)));
    let warning = |(shape, motion): (&Shape, &Arc<Motion>)| {
        // Of millions of steps few walls make anyone look at one.
        if motion.fastest_turning() * grid.step() < HALF_TURN {
            return None;
        }
        let turning = |n: i64| motion.turning(grid.time(n), grid.time(n + 1));
        let [from, to] = motion.turning_course().map(|time| grid.step_before(time));
        let mut steps = steps.start.max(from.saturating_sub(1))..steps.end.min(to.saturating_add(2));
        let turn = steps.clone().map(turning).fold(0.0, f64::max);
        if turn < HALF_TURN {
            return None;
        }
        // The first, where only rounding tells it from others.
        let step = steps.find(|&n| turning(n) >= turn * (1.0 - ROUNDED))?;
        // The frame that it leads to.
        let substeps = i64::from(grid.substeps);
        let frame = i64::from(frames.first) + (step + substeps).div_euclid(substeps);
        // Within a step it may be faster than on average.
        let pieces = (0..PIECES).map(|i| grid.time(step) + grid.step() * f64::from(i) / f64::from(PIECES));
        let piece = pieces.map(|time| motion.turning(time, time + grid.step() / f64::from(PIECES))).fold(0.0, f64::max);
        let needed = (piece * f64::from(PIECES) * f64::from(grid.substeps) / HALF_TURN).floor() + 1.0;
        let advice = match needed <= f64::from(SUBSTEPS_MAX) {
            true => format!("set `smoke.advect.substeps` to {needed} or more, or let it turn more slowly"),
            false => "let it turn more slowly".into(),
        };
        let (name, degrees) = (&shape.name, turn.to_degrees());
        Some(format!(
            "warning: {place}`{name}` turns by {degrees:.0}° in a step of the smoke at frame {frame}, and from half a turn on \
             it is lost which way round, so that its wall drags the smoke wrongly; {advice}",
            place = scene.place(&format!("shapes.{name}")),
        ))
    };
    moving.filter_map(warning).collect()
}

fn check_memory(settings: &Settings, smoke: &settings::Smoke) -> Result<(), ParticlesError> {
    const GIB: f64 = (1u64 << 30) as f64;
    let count = smoke.emitters.iter().map(|e| live_count(e, &settings.frames)).sum::<f64>();
    let count = held_count(count, &smoke.advect);
    let needed_gib = count * particle_bytes(&settings.frames) / GIB;
    let limit_gib = settings.render.memory_limit_gib;
    if needed_gib > limit_gib {
        return Err(ParticlesError::OverMemoryLimit { count, needed_gib, limit_gib });
    }
    Ok(())
}

/// The motion of the shape that an emitter is on, and the point that it turns about where it rests [m].
pub fn emitter_motion(e: &settings::Emitter, geometry: &Geometry) -> Option<(Arc<Motion>, DVec3)> {
    let shape = geometry.shapes.iter().find(|shape| e.mesh.as_ref().is_some_and(|s| s.shape == shape.name))?;
    Some((shape.motion.clone()?, shape.pivot))
}

/// Where an emitter of a scene lets particles start.
///
/// # Errors
/// Where it is a shape without a surface.
pub fn build_place(e: &settings::Emitter, emitter_idx: usize, geometry: &Geometry) -> Result<Place, ParticlesError> {
    let v = DVec3::from_array;
    Ok(if let Some(s) = &e.disk {
        Place::Disk { center: v(s.center), normal: v(s.normal).normalize_or(DVec3::Y), radius: s.radius }
    } else if let Some(s) = &e.sphere {
        Place::Ball { center: v(s.center), radius: s.radius }
    } else if let Some(s) = &e.cuboid {
        Place::Cuboid { center: v(s.center), size: v(s.size) }
    } else if let Some(s) = &e.mesh {
        let mesh = geometry.shapes.iter().find(|shape| shape.name == s.shape).and_then(|shape| shape.mesh.as_ref());
        let triangles = mesh.map(|m| (0..m.triangles().len()).map(|i| m.corners(i)).collect()).unwrap_or_default();
        let surface = Surface::try_new(triangles, s.offset);
        Place::Surface(surface.ok_or(ParticlesError::NoSurface { emitter_idx, shape: s.shape.clone() })?)
    } else {
        Place::Point(e.point.as_ref().map_or(DVec3::ZERO, |s| v(s.position)))
    })
}

fn build_emitter(
    e: &settings::Emitter,
    emitter_idx: usize,
    seed: Seed,
    geometry: &Geometry,
) -> Result<Emitter, ParticlesError> {
    let (schedule, share) = match (e.rate, e.count) {
        (_, Some(count)) => (Schedule::Count(count), 1.0 / count.max(1) as f64),
        (rate, None) => {
            let rate = rate.unwrap_or(0.0);
            (Schedule::Rate(rate), if rate > 0.0 { 1.0 / rate } else { 0.0 })
        }
    };
    Ok(Emitter {
        place: build_place(e, emitter_idx, geometry)?,
        strands: e.strands,
        motion: emitter_motion(e, geometry),
        schedule,
        start: e.start,
        stop: e.stop.unwrap_or(f64::INFINITY),
        lifetime: e.lifetime,
        lifetime_spread: e.lifetime_spread,
        particle_mass: e.mass * share,
        fade_in: e.fade_in,
        fade_out: e.fade_out,
        seed,
    })
}
