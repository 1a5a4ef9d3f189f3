//! Divergence-free velocity: the curl of potentials that are bent round obstacles.

pub mod curl;
pub mod field;
pub mod flow_noise;
pub mod noise;
pub mod obstacles;
pub mod octaves;
pub mod potential;
pub mod ramp;
pub mod walls;

use crate::flow::field::Source;
use crate::flow::obstacles::build_obstacles;
use crate::flow::octaves::{OctavesSettings, kolmogorov_gain, octaves};
use crate::geometry::Geometry;
use crate::math::hash::Seed;
use crate::scene::Scene;
use crate::scene::settings::{Gain, Noise, Potential};

pub use crate::flow::field::VelocityField;

/// Noise starts with this word in the derivation of its keys.
const NOISE_KEYS: u64 = 0x6E6F_6973;

impl VelocityField {
    /// The flow of a scene.
    pub fn build(scene: &Scene, geometry: &Geometry) -> Self {
        let settings = &scene.settings;
        let seed = Seed(settings.render.seed).derive(NOISE_KEYS);
        let potentials = settings.flow.potentials.iter().enumerate();
        let sources = potentials.flat_map(|(i, p)| sources(p, seed.derive(i as u64))).collect();
        let solids = settings.flow.obstacles.iter().filter_map(|name| {
            let shape = geometry.shapes.iter().find(|shape| shape.name == *name);
            shape.and_then(|shape| shape.sdf.clone())
        });
        Self::new(sources, build_obstacles(solids.collect()))
    }
}

fn sources(potential: &Potential, seed: Seed) -> Vec<Source> {
    match potential {
        Potential::Uniform(u) => vec![Source::Uniform { velocity: u.velocity, influence: u.influence_radius }],
        Potential::Noise(n) => octaves(&octaves_settings(n, seed)).into_iter().map(Source::Octave).collect(),
    }
}

fn octaves_settings(n: &Noise, seed: Seed) -> OctavesSettings {
    OctavesSettings {
        length_scale: n.length_scale,
        speed: n.speed,
        octaves: n.octaves,
        lacunarity: n.lacunarity,
        gain: match n.gain {
            Gain::Kolmogorov => kolmogorov_gain(n.lacunarity),
            Gain::Speed(factor) => factor,
        },
        spin_rate: n.spin_rate,
        scroll: n.scroll,
        seed: seed.derive(n.seed),
    }
}
