//! Particles of smoke: where they come from and where they go.

pub mod advect;
pub mod emit;
pub mod system;

use thiserror::Error;

pub use crate::particles::system::ParticleSystem;

/// The particles alive at a frame, in the order of emitter and index: an array for each quantity.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Particles {
    /// Places [m], an array for each axis.
    pub position: [Vec<f32>; 3],
    /// Velocities at the frame's time [m/s], an array for each axis.
    pub velocity: [Vec<f32>; 3],
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
        "up to {count:.0} particles live at once, which takes {needed_gib:.2} GiB; the limit is {limit_gib} GiB: lower the rate, count or lifetime of smoke.emitters, or raise render.memory_limit_gib"
    )]
    OverMemoryLimit {
        /// Most particles alive at once.
        count: f64,
        /// Memory for them [GiB].
        needed_gib: f64,
        /// Memory allowed [GiB].
        limit_gib: f64,
    },
    /// An emitter's shape cannot emit.
    #[error(
        "smoke.emitters[{emitter_idx}]: shape \"{shape}\" has no surface to emit from: it must be a mesh with an area"
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
    #[error("frame {frame}: a particle's position is not finite; the speeds of flow.potentials are too large")]
    NotFinite {
        /// Which frame.
        frame: i32,
    },
    /// Stopped on request.
    #[error("cancelled")]
    Cancelled,
}
