//! Smoke whose extinction has a colour: each channel is what grey smoke of its own extinction gives.

mod support;

use curlsmoke::geometry::embree::Ray;
use curlsmoke::math::hash::Seed;
use curlsmoke::math::space::{UnitVec3, WorldPoint};
use curlsmoke::math::statistics::Moments;
use curlsmoke::progress::Silent;
use curlsmoke::render::film::{Film, PathCounts};
use curlsmoke::render::integrator::Integrator;
use curlsmoke::render::media::Media;
use curlsmoke::render::medium::Medium;
use curlsmoke::render::sampler::Sampler;
use curlsmoke::render::sun_shadow::SunShadows;
use curlsmoke::render::{self, tiles};
use glam::Vec3;
use support::{Stage, centered_grid, estimate, stage};

fn scene(medium: &str, rest: &str) -> Stage {
    stage(&format!(
        "
camera: {{position: [0, 0, 4], look_at: [0, 0, 0]}}
film: {{resolution: [24, 24], spp: 256}}
render: {{max_bounces: 100000}}
smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{{medium}}}}}
{rest}
"
    ))
}

const LIGHTS: &str = "
shapes:
  floor: {plane: {point: [0, -1, 0]}, material: {diffuse: {reflectance: [0.5, 0.5, 0.5]}}}
lights:
  - sun: {direction: [0.3, -1, -0.4], irradiance: [2, 2, 2]}
  - environment: {radiance: [0.3, 0.3, 0.3]}
";

fn smoke(stage: &Stage, density: f32) -> Medium {
    let grid = centered_grid([16, 16, 16], 0.1, |p: WorldPoint| {
        density * (0.6 + 0.4 * (7.0 * p.0.x).sin() * (5.0 * p.0.y).cos()) * f32::from(p.0.length() < 0.8)
    });
    render::build_medium(&stage.scene, grid).expect("not too dense").expect("the scene has smoke")
}

fn picture(medium: &str, density: f32) -> Film {
    let stage = scene(medium, LIGHTS);
    let medium = smoke(&stage, density);
    tiles::render(&render::build_view(&stage.scene, 1, None), &stage.world, Some(&medium), &Silent).expect("renders")
}

#[test]
fn each_channel_is_that_of_grey_smoke_of_its_own_extinction() {
    // Thin, and so dense that pieces are crossed voxel by voxel.
    for density in [1.0, 400.0] {
        // It glows too, each channel in another way than it is absorbed.
        let glow = 0.5 / density;
        let tinted = picture(
            &format!(
                "extinction: 5, extinction_tint: [0.2, 0.6, 1], albedo: [0.9, 0.7, 0.5], emission: [{glow}, {glow}, {glow}]"
            ),
            density,
        );
        for (channel, (factor, albedo)) in [(1.0, 0.9), (3.0, 0.7), (5.0, 0.5)].into_iter().enumerate() {
            let grey = picture(
                &format!(
                    "extinction: {factor}, albedo: [{albedo}, {albedo}, {albedo}], emission: [{glow}, {glow}, {glow}]"
                ),
                density,
            );
            let mut scores = Vec::new();
            for rows in 0..3 {
                // Bands of eight rows.
                let band = rows * 8 * 24..(rows + 1) * 8 * 24;
                let (mut difference, mut variance) = (0.0, 0.0);
                for (a, b) in tinted.pixels[band.clone()].iter().zip(&grey.pixels[band]) {
                    difference += f64::from(a.mean[channel] - b.mean[channel]);
                    variance += f64::from(a.variance[channel] + b.variance[channel]);
                }
                scores.push(difference / variance.sqrt());
            }
            println!("density {density}, channel {channel}: {scores:.2?} standard errors");
            assert!(scores.iter().all(|z| z.abs() < 4.0), "density {density}, channel {channel}: {scores:?}");
        }
    }
}

#[test]
fn what_passes_smoke_falls_by_each_channels_own_extinction() {
    for (extinction, z) in [(1.0f64, 4.0), (300.0, 4.0)] {
        let medium = format!("extinction: {extinction}, extinction_tint: [0, 0.01, 1], albedo: [0, 0, 0]");
        let stage = scene(&medium, "lights: [{environment: {radiance: [1, 1, 1]}}]");
        let grid = centered_grid([16, 16, 16], 0.1, |_| 1.0);
        let medium = render::build_medium(&stage.scene, grid).unwrap().unwrap();
        let view = render::build_view(&stage.scene, 1, None);
        let integrator = Integrator {
            world: &stage.world,
            media: Some(&medium).into(),
            sun_shadows: &SunShadows::new(&stage.world.lights, Media::from(Some(&medium)).grids()),
            limits: view.limits,
            moment: Default::default(),
        };
        let direction = UnitVec3::try_new(Vec3::NEG_Z).unwrap();
        let ray = Ray { origin: WorldPoint::new(0.0, 0.0, 4.0), direction };
        let mut sums: [Moments; 3] = std::array::from_fn(|_| Moments::default());
        for i in 0..100_000 {
            let mut sampler = Sampler::new(Seed(3), i, 0, 0);
            let light = integrator.trace(ray, &mut sampler, &mut PathCounts::default()).radiance;
            (0..3).for_each(|c| sums[c].push(f64::from(light[c])));
        }
        // 1.5 between outermost voxels, and a rising and a falling voxel.
        for (sum, factor) in sums.iter().zip([0.0, 0.01, 1.0]) {
            let expected = (-extinction * factor * 1.6).exp();
            let error = sum.variance_of_mean().sqrt();
            println!("extinction {extinction} x {factor}: {} +- {error:.1e} of {expected}", sum.mean());
            assert!((sum.mean() - expected).abs() < z * error + 1e-6, "{} +- {error} of {expected}", sum.mean());
        }
    }
}

#[test]
fn a_furnace_of_tinted_smoke_is_white() {
    let medium =
        "extinction: 5, extinction_tint: [0.3, 0.7, 1], albedo: [1, 1, 1], phase: {henyey_greenstein: {g: 0.5}}";
    let stage = scene(medium, "lights: [{sphere: {center: [0, 0, 0], radius: 20, radiance: [1, 1, 1]}}]");
    let medium = smoke(&stage, 1.0);
    let view = render::build_view(&stage.scene, 1, None);
    let red = estimate(&stage, Some(&medium), 300_000, 9, |_| view.camera.ray(glam::Vec2::new(11.0, 13.0), [0.5; 2]));
    println!("{red:?}");
    assert!(red.z(1.0) < 4.0 && red.standard_error < 0.02, "{red:?}");
}
