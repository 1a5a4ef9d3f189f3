//! How scenes are set up, and means of what is no path.

use crate::support::{Estimate, Stage, stage};
use curlsmoke::geometry::embree::Ray;
use curlsmoke::grid::DensityGrid;
use curlsmoke::math::hash::Seed;
use curlsmoke::math::space::{UnitVec3, WorldPoint};
use curlsmoke::math::statistics::Moments;
use curlsmoke::render;
use curlsmoke::render::light::Light;
use curlsmoke::render::medium::Medium;
use curlsmoke::render::sampler::Stream;
use curlsmoke::render::world::World;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// A scene whose smoke has `medium`, with further keys; paths end only where chance says so.
pub fn scene(medium: &str, rest: &str) -> Stage {
    scene_of_bounces(100_000, medium, rest)
}

/// A scene whose paths scatter at most so often.
pub fn scene_of_bounces(max_bounces: u32, medium: &str, rest: &str) -> Stage {
    stage(&format!(
        "
camera: {{position: [0, 0, 5], look_at: [0, 0, 0]}}
render: {{max_bounces: {max_bounces}}}
smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{{medium}}}}}
{rest}
"
    ))
}

/// A scene with these lights instead of its own.
pub fn with_lights(stage: Stage, lights: Vec<Light>) -> Stage {
    let Stage { scene, world } = stage;
    Stage { scene, world: World::new(world.surfaces, world.materials, lights) }
}

/// A grid as the smoke of the scene.
pub fn medium(stage: &Stage, grid: DensityGrid) -> Medium {
    render::build_medium(&stage.scene, grid).expect("not too dense").expect("the scene has smoke")
}

/// A direction.
pub fn unit(v: DVec3) -> UnitVec3 {
    UnitVec3::try_new(v.as_vec3()).expect("not zero")
}

/// A ray from a point along a direction of any length.
pub fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
    Ray { origin: WorldPoint(DVec3::from(origin).as_vec3()), direction: unit(DVec3::from(direction)) }
}

/// A lumpy density between 0 and 1, with steps.
pub fn lumps(p: WorldPoint) -> f32 {
    let p = p.0 * 5.0;
    (0.5 + 0.5 * (p.x.sin() * p.y.cos() + (p.z + 0.3).sin() * 0.5)).clamp(0.0, 1.0) * f32::from(p.x.sin() > -0.5)
}

/// Mean of what a function makes of random numbers.
pub fn mean_of(count: usize, seed: u64, value: impl Fn(&mut Stream) -> f64 + Sync) -> Estimate {
    const BLOCK: usize = 4096;
    let blocks: Vec<f64> = (0..count.div_ceil(BLOCK))
        .into_par_iter()
        .map(|block| {
            let mut rng = Stream::new(Seed(seed).derive(block as u64));
            (0..BLOCK).map(|_| value(&mut rng)).sum::<f64>() / BLOCK as f64
        })
        .collect();
    let moments: Moments = blocks.into_iter().collect();
    Estimate { mean: moments.mean(), standard_error: moments.variance_of_mean().sqrt() }
}

/// The same number in all channels, as a scene has it.
pub fn grey(x: f64) -> String {
    format!("[{x}, {x}, {x}]")
}

/// A direction from the cosine with +y and the longitude [rad].
pub fn spherical(cosine: f64, longitude: f64) -> DVec3 {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    DVec3::new(sine * longitude.cos(), cosine, sine * longitude.sin())
}

/// The same in single precision.
pub fn spherical_unit(cosine: f64, longitude: f64) -> UnitVec3 {
    let v: Vec3 = spherical(cosine, longitude).as_vec3();
    UnitVec3::try_new(v).expect("not zero")
}
