//! Smoke that gives off light, with known answers.

mod support;

use curlsmoke::geometry::embree::Ray;
use curlsmoke::grid::DensityGrid;
use curlsmoke::math::space::{UnitVec3, WorldPoint};
use curlsmoke::render;
use curlsmoke::render::medium::Medium;
use glam::Vec3;
use support::{Stage, centered_grid, estimate, stage};

fn glowing(shapes: &str, medium: &str) -> Stage {
    stage(&format!(
        "
camera: {{position: [0, 0, 5], look_at: [0, 0, 0]}}
film: {{resolution: [32, 24], spp: 16}}
render: {{max_bounces: 100000}}
{shapes}
smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{{medium}}}}}
"
    ))
}

fn medium(stage: &Stage, grid: DensityGrid) -> Medium {
    render::build_medium(&stage.scene, grid).expect("not too dense").expect("the scene has smoke")
}

fn ray(origin: [f32; 3], direction: [f32; 3]) -> Ray {
    let direction = UnitVec3::try_new(Vec3::from(direction)).expect("not zero");
    Ray { origin: WorldPoint(Vec3::from(origin)), direction }
}

fn lumps(p: WorldPoint) -> f32 {
    let p = p.0 * 5.0;
    (0.5 + 0.5 * (p.x.sin() * p.y.cos() + (p.z + 0.3).sin() * 0.5)).clamp(0.0, 1.0) * f32::from(p.x.sin() > -0.5)
}

/// ∫ ρ T dt along a ray between two distances, by the midpoint rule in double precision.
fn glow_along(medium: &Medium, ray: &Ray, t0: f64, t1: f64) -> f64 {
    let steps = 400_000;
    let dt = (t1 - t0) / f64::from(steps);
    let (mut tau, mut sum) = (0.0, 0.0);
    for i in 0..steps {
        let density = f64::from(medium.grid().density(ray.at((t0 + (f64::from(i) + 0.5) * dt) as f32)));
        let piece = density * f64::from(medium.extinction()) * dt;
        sum += density * f64::exp(-tau - 0.5 * piece) * dt;
        tau += piece;
    }
    sum
}

#[test]
fn smoke_that_only_absorbs_has_its_closed_form() {
    // ε/σ · (1 − exp(−σ s)) through 1 m of even density between the outermost centres; the halves of voxels beyond are
    // ramps, for which quadrature answers too.
    for (extinction, density) in
        [(2.0, (|_| 1.0) as fn(WorldPoint) -> f32), (2.0, lumps), (1e-4, lumps), (300.0, lumps), (0.0, lumps)]
    {
        let stage = glowing("", &format!("extinction: {extinction}, albedo: [0, 0, 0], emission: [3, 0, 0]"));
        let medium = medium(&stage, centered_grid([16, 16, 16], 0.1, density));
        let beam = ray([0.11, 0.07, 5.0], [0.02, 0.01, -1.0]);
        let expected = 3.0 * glow_along(&medium, &beam, 3.0, 7.0);
        let found = estimate(&stage, Some(&medium), 300_000, 1, |_| beam);
        println!("extinction {extinction}: {} ± {}, expected {expected}", found.mean, found.standard_error);
        // The sum of many small numbers, and quadrature, are right to some parts in a million.
        let error = (found.mean - expected).abs() / found.standard_error.max(1e-5 * expected);
        assert!(error < 3.3, "{error}");
        if extinction < 1e-3 {
            assert!(found.standard_error < 1e-4 * expected, "thin smoke has next to no noise");
        }
    }
    // And the closed form itself, of smoke thick enough that its faces do not matter.
    let stage = glowing("", "extinction: 40, albedo: [0, 0, 0], emission: [3, 0, 0]");
    let medium = medium(&stage, centered_grid([16, 16, 16], 0.1, |_| 1.0));
    let inside = ray([0.0, 0.0, 0.7], [0.0, 0.0, -1.0]);
    let found = estimate(&stage, Some(&medium), 200_000, 1, |_| inside);
    assert!(found.z(3.0 / 40.0) < 3.3, "{found:?}");
}

#[test]
fn a_closed_white_room_of_glowing_smoke_is_as_bright_as_what_it_gives_off_over_what_it_absorbs() {
    // Wherever light is L = ε/σ_a, absorption takes as much as is given off, however smoke is spread and scatters.
    for (albedo, phase) in [(0.0, 0.0), (0.5, 0.6), (0.8, -0.3)] {
        let stage = glowing(
            "shapes:
  room: {sphere: {center: [0, 0, 0], radius: 1.5}, material: {diffuse: {reflectance: [1, 1, 1]}}}
  ball: {sphere: {center: [0.3, 0, 0], radius: 0.2}, material: {diffuse: {reflectance: [1, 1, 1]}}}",
            &format!(
                "extinction: 3, albedo: [{albedo}, {albedo}, {albedo}], emission: [2, 2, 2], \
                 phase: {{henyey_greenstein: {{g: {phase}}}}}"
            ),
        );
        let medium = medium(&stage, centered_grid([32, 32, 32], 0.1, |p| 0.2 + lumps(p)));
        let expected = 2.0 / (3.0 * (1.0 - albedo));
        let found = estimate(&stage, Some(&medium), 100_000, 4, |_| ray([-0.9, 0.3, 0.2], [0.7, -0.2, -0.1]));
        println!("albedo {albedo}, g {phase}: {} ± {}, expected {expected}", found.mean, found.standard_error);
        assert!(found.z(expected) < 3.3 && found.standard_error < 0.01 * expected);
    }
}

#[test]
fn what_smoke_gives_off_lights_what_is_beside_it() {
    // A ball of thin glowing smoke far above a white floor is a point light of intensity ε ρ V.
    let stage = glowing(
        "shapes: {floor: {plane: {}, material: {diffuse: {reflectance: [0.5, 0.5, 0.5]}}}}",
        "extinction: 0, emission: [1000, 0, 0]",
    );
    let inside = |p: WorldPoint| f32::from(p.0.length() < 0.2);
    let grid = DensityGrid::from_fn(WorldPoint::new(-0.4, 3.6, -0.4), 0.1, glam::UVec3::splat(8), 1 << 24, |p| {
        inside(WorldPoint(p.0 - Vec3::Y * 4.0))
    })
    .unwrap();
    let medium = medium(&stage, grid);
    let volume = 8.0f64.powi(3);
    let sum: f64 = (0..512)
        .map(|i| Vec3::new((i % 8) as f32, (i / 8 % 8) as f32, (i / 64) as f32))
        .map(|i| f64::from(medium.grid().density(WorldPoint(Vec3::new(-0.35, 3.65, -0.35) + i * 0.1))))
        .sum();
    let intensity = 1000.0 * sum / 512.0 * volume * 1e-3;
    let expected = intensity / 16.0 * 0.5 / std::f64::consts::PI;
    let found = estimate(&stage, Some(&medium), 2_000_000, 5, |_| ray([0.0, 1.0, 0.0], [0.0, -1.0, 0.0]));
    println!("lit by smoke: {} ± {}, expected {expected}", found.mean, found.standard_error);
    // The ball is 5 % of its distance wide, so that it is a point to 0.3 %.
    assert!((found.mean - expected).abs() < 3.3 * found.standard_error + 0.004 * expected);
    assert!(found.standard_error < 0.02 * expected);
}

#[test]
fn hot_smoke_shines_as_a_black_body_where_it_is_thick() {
    use curlsmoke::pipeline;
    use curlsmoke::progress::Silent;
    use curlsmoke::render::blackbody::Blackbody;
    use curlsmoke::scene::Scene;
    use std::path::Path;
    // Particles that never cool, black and so many that nothing is seen through them: a black body, whatever their density.
    let scene = |extinction: f64| {
        let text = format!(
            "version: 1
camera: {{position: [0, 0, 5], look_at: [0, 0, 0], vertical_fov_deg: 2}}
film: {{resolution: [4, 4], spp: 64}}
smoke:
  emitters: [{{sphere: {{center: [0, 0, 0], radius: 0.5}}, count: 20000, mass: 1, start: -5, lifetime: 10}}]
  grid: {{voxel_size: 0.05, kernel_radius: 0.15}}
  blackbody: {{temperature: 1800, cooling_time: 1000000, gain: 0.5}}
  medium: {{extinction: {extinction}, albedo: [0, 0, 0]}}
output: {{image: out/hot.exr}}
"
        );
        Scene::from_text(&text, Path::new("test.yaml")).unwrap_or_else(|e| panic!("{e}"))
    };
    let mean = |extinction: f64| {
        let film = pipeline::film(&scene(extinction), 1, None, &Silent).unwrap_or_else(|e| panic!("{e}"));
        film.pixels.iter().map(|p| p.mean).sum::<Vec3>() / film.pixels.len() as f32
    };
    let expected = Blackbody::new().at(1800.0) * 0.5;
    let thick = mean(100.0);
    println!("{thick} of {expected}");
    assert!(((thick - expected) / expected.max_element()).abs().max_element() < 0.03, "{thick} of {expected}");
    // Thin smoke gives off in proportion to what it absorbs.
    let (thin, half) = (mean(1e-3), mean(5e-4));
    assert!((thin / half - 2.0).abs().x < 1e-2 && thin.x < 0.01 * expected.x, "{thin} {half}");
}
