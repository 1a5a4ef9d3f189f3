//! What several integration tests share.

use curlsmoke::geometry::Geometry;
use curlsmoke::geometry::embree::Ray;
use curlsmoke::grid::DensityGrid;
use curlsmoke::math::hash::Seed;
use curlsmoke::math::space::WorldPoint;
use curlsmoke::progress::Silent;
use curlsmoke::render::film::PathCounts;
use curlsmoke::render::integrator::Integrator;
use curlsmoke::render::media::Media;
use curlsmoke::render::medium::Medium;
use curlsmoke::render::sampler::Sampler;
use curlsmoke::render::sun_shadow::SunShadows;
use curlsmoke::render::world::World;
use curlsmoke::render::{self, TextureStore};
use curlsmoke::scene::Scene;
use glam::{DVec3, UVec3};
use rayon::prelude::*;
use std::path::Path;

/// A scene with its surfaces and lights ready.
pub struct Stage {
    pub scene: Scene,
    pub world: World,
}

/// Builds a scene from its text; `version` is put in front.
pub fn stage(yaml: &str) -> Stage {
    let scene = Scene::from_text(&format!("version: 1\n{yaml}"), Path::new("test.yaml"))
        .unwrap_or_else(|e| panic!("the test's scene is wrong: {e}"));
    let geometry = Geometry::build(&scene, &Silent).expect("shapes of the test can be built");
    let materials = render::build_materials(&scene, &geometry, &mut textures(&scene), 0.0);
    let world = render::build_world(&scene, &geometry, materials, &|_| Err("tests bring no pictures".into()))
        .expect("lights of the test can be built");
    Stage { scene, world }
}

/// What the textures of a scene without pictures keep.
pub fn textures(scene: &Scene) -> TextureStore {
    TextureStore::load(scene, &|_| Err("tests bring no pictures".into())).expect("no pictures are asked for")
}

/// A grid of `dims` voxels of edge `h` about the origin.
pub fn centered_grid(dims: [u32; 3], h: f32, density: impl Fn(WorldPoint) -> f32 + Sync) -> DensityGrid {
    let dims = UVec3::from(dims);
    let origin = WorldPoint(dims.as_vec3() * (-0.5 * h));
    DensityGrid::from_fn(origin, h, dims, 1 << 30, density).expect("small")
}

/// Mean and standard error of an estimator.
#[derive(Debug, Clone, Copy)]
pub struct Estimate {
    pub mean: f64,
    pub standard_error: f64,
}

impl Estimate {
    /// Distance from `expected` in standard errors; float rounding of the sum counts as one part in a million.
    pub fn z(&self, expected: f64) -> f64 {
        (self.mean - expected).abs() / self.standard_error.max(1e-6 * expected.abs())
    }
}

/// Mean red radiance of `count` paths, whose camera rays are `ray(i)` for the running number of the block.
///
/// Samples within a block are stratified and so not independent; the error is taken from the means of blocks.
pub fn estimate(
    stage: &Stage,
    medium: Option<&Medium>,
    count: usize,
    seed: u64,
    ray: impl Fn(usize) -> Ray + Sync,
) -> Estimate {
    estimate_each(stage, medium, count, seed, |block, _| ray(block))
}

/// As [`estimate`], through more than smoke, of each channel.
#[allow(dead_code)]
pub fn estimate_colors(
    stage: &Stage,
    media: Media,
    count: usize,
    seed: u64,
    ray: impl Fn(usize) -> Ray + Sync,
) -> [Estimate; 3] {
    estimate_media(stage, media, count, seed, |block, _| ray(block))
}

/// As [`estimate`], where the ray is `ray(block, i)` for each path of a block.
pub fn estimate_each(
    stage: &Stage,
    medium: Option<&Medium>,
    count: usize,
    seed: u64,
    ray: impl Fn(usize, u32) -> Ray + Sync,
) -> Estimate {
    estimate_media(stage, medium.into(), count, seed, ray)[0]
}

fn estimate_media(
    stage: &Stage,
    media: Media,
    count: usize,
    seed: u64,
    ray: impl Fn(usize, u32) -> Ray + Sync,
) -> [Estimate; 3] {
    const BLOCK: usize = 4096;
    let view = render::build_view(&stage.scene, 1, None);
    let sun_shadows = &SunShadows::new(&stage.world.lights, media.grids());
    let integrator =
        Integrator { world: &stage.world, media, sun_shadows, limits: view.limits, moment: Default::default() };
    let blocks = count.div_ceil(BLOCK);
    let means: Vec<DVec3> = (0..blocks)
        .into_par_iter()
        .map(|block| {
            let mut counts = PathCounts::default();
            let sum: DVec3 = (0..BLOCK as u32)
                .map(|i| {
                    let mut sampler = Sampler::new(Seed(seed), block as i32, 0, i);
                    integrator.trace(ray(block, i), &mut sampler, &mut counts).radiance.as_dvec3()
                })
                .sum();
            // Tests of single scattering cut on purpose; what is cut comes after the one direct connection they want.
            assert!(counts.truncated == 0 || view.limits.max_bounces == 1, "the test's paths must not be cut");
            sum / BLOCK as f64
        })
        .collect();
    let n = means.len() as f64;
    let mean = means.iter().sum::<DVec3>() / n;
    let variance = means.iter().map(|m| (*m - mean) * (*m - mean)).sum::<DVec3>() / (n - 1.0);
    std::array::from_fn(|i| Estimate { mean: mean[i], standard_error: (variance[i] / n).sqrt() })
}
