//! Surfaces in whole scenes, with known answers: metal, glass, plastic, and what the camera sees of shapes.

mod support;

use curlsmoke::geometry::embree::Ray;
use curlsmoke::grid::DensityGrid;
use curlsmoke::math::hash::Seed;
use curlsmoke::math::space::{UnitVec3, WorldPoint};
use curlsmoke::render::film::{PathCounts, Pixel, PixelSum};
use curlsmoke::render::integrator::Integrator;
use curlsmoke::render::media::Media;
use curlsmoke::render::medium::Medium;
use curlsmoke::render::sampler::Sampler;
use curlsmoke::render::sun_shadow::SunShadows;
use curlsmoke::render::{self};
use glam::Vec3;
use support::{Stage, centered_grid, estimate, stage};

const SET: &str = "
camera: {position: [0, 0, 5], look_at: [0, 0, 0]}
film: {resolution: [32, 24], spp: 16}
render: {max_bounces: 100000}
";

fn smoke(medium: &str) -> String {
    format!(
        "smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{{medium}}}}}"
    )
}

fn medium(stage: &Stage, grid: DensityGrid) -> Medium {
    render::build_medium(&stage.scene, grid).expect("not too dense").expect("the scene has smoke")
}

fn ray(origin: [f32; 3], direction: [f32; 3]) -> Ray {
    let direction = UnitVec3::try_new(Vec3::from(direction)).expect("not zero");
    Ray { origin: WorldPoint(Vec3::from(origin)), direction }
}

/// What a pixel that sees the world along one ray holds after `count` paths.
fn pixel(stage: &Stage, medium: Option<&Medium>, count: u32, ray: Ray) -> Pixel {
    let limits = render::build_view(&stage.scene, 1, None).limits;
    let media = Media::from(medium);
    let sun_shadows = &SunShadows::new(&stage.world.lights, media.grids());
    let integrator = Integrator { world: &stage.world, media, sun_shadows, limits, moment: Default::default() };
    let (mut sum, mut counts) = (PixelSum::new(&[]), PathCounts::default());
    for i in 0..count {
        sum.add(&[], &integrator.trace(ray, &mut Sampler::new(Seed(7), 0, 0, i), &mut counts));
    }
    sum.finish()
}

const WHITE: &str = "[1, 1, 1]";

#[test]
fn white_things_vanish_in_white_light() {
    // In even light, surfaces that absorb nothing and white smoke are as bright as the light: inside of glass too.
    for material in [
        "{dielectric: {}}",
        "{dielectric: {ior: 1.33, roughness: 0.4}}",
        "{plastic: {reflectance: [1, 1, 1], roughness: 0.3}}",
        "{principled: {base_color: [1, 1, 1], metallic: 1, roughness: 0.6}}",
        "{principled: {base_color: [1, 1, 1], metallic: 0.2, transmission: 0.6, coat: 1, roughness: 0.3}}",
    ] {
        for light in
            ["sphere: {center: [0, 0, 0], radius: 20, radiance: [1, 1, 1]}", "environment: {radiance: [1, 1, 1]}"]
        {
            let stage = stage(&format!(
                "{SET}
shapes:
  ball: {{sphere: {{center: [0.1, 0, 0], radius: 0.3}}, material: {material}}}
{}
lights: [{{{light}}}]
",
                smoke("extinction: 3, albedo: [1, 1, 1]")
            ));
            let medium = medium(&stage, centered_grid([8, 8, 8], 0.1, |_| 1.0));
            let found = estimate(&stage, Some(&medium), 80_000, 2, |_| ray([0.1, 0.05, 5.0], [0.01, 0.0, -1.0]));
            println!("{material} in {light}: {} ± {}", found.mean, found.standard_error);
            // Tables of what is made up for are good to two in a thousand, some of which are met again and again.
            assert!((found.mean - 1.0).abs() < 3.5 * found.standard_error + 6e-3, "{material}: {}", found.mean);
            assert!(found.standard_error < 1e-2);
        }
    }
}

#[test]
fn a_pane_lets_through_what_two_surfaces_leave() {
    // All ways between both surfaces added up: (1 − R)/(1 + R), with R = 0.04; what is mirrored back is lost in the black
    // board. Tinted by t at each surface: t²(1 − R)²/(1 − R²), for what is mirrored within is not tinted.
    let r = 0.04;
    for (tint, t) in [(WHITE, 1.0), ("[0.8, 0.8, 0.8]", 0.8)] {
        let stage = stage(&format!(
            "{SET}
shapes:
  pane: {{box: {{center: [0, 0, 0], size: [10, 10, 0.5]}}, material: {{dielectric: {{tint: {tint}}}}}}}
  board: {{box: {{center: [0, 0, 7], size: [10, 10, 1]}}, material: {{diffuse: {{reflectance: [0, 0, 0]}}}}}}
lights: [{{environment: {{radiance: [1, 1, 1]}}}}]
"
        ));
        let found = estimate(&stage, None, 400_000, 3, |_| ray([0.0, 0.0, 5.0], [0.0, 0.0, -1.0]));
        let expected = t * t * (1.0 - r) * (1.0 - r) / (1.0 - r * r);
        println!("pane, tint {tint}: {} ± {}, expected {expected}", found.mean, found.standard_error);
        assert!(found.z(expected) < 3.5);
    }
}

#[test]
fn mirrors_show_lights_whole_and_rough_metal_finds_them_both_ways() {
    // A sphere light seen in a mirror of silver: no direct connection finds it, so the path counts in full.
    let mirror = |roughness: f64, light: &str| {
        stage(&format!(
            "{SET}
shapes:
  mirror: {{plane: {{point: [0, 0, 0], normal: [0, 0, 1]}}, material: {{conductor: {{eta: [1.5, 1.5, 1.5], k: [3, 3, 3], roughness: {roughness}}}}}}}
lights: [{light}]
"
        ))
    };
    let f0 = (0.25 + 9.0) / (6.25 + 9.0);
    let lamp = "{sphere: {center: [0, 0, 9], radius: 1, radiance: [5, 5, 5]}}";
    let found = pixel(&mirror(0.0, lamp), None, 64, ray([0.0, 0.0, 5.0], [0.0, 0.0, -1.0]));
    assert!((f64::from(found.mean.x) - 5.0 * f0).abs() < 1e-4, "{}", found.mean);
    // On rough metal, direct connections alone must agree with paths that find the light by themselves: a small sphere as
    // bright as a point, which only connections find.
    let near = "{sphere: {center: [1, 0, 3], radius: 0.05, radiance: [400, 400, 400]}}";
    let intensity = 400.0 * std::f64::consts::PI * 0.05f64.powi(2);
    let point = format!("{{point: {{position: [1, 0, 3], intensity: [{intensity}, {intensity}, {intensity}]}}}}");
    for roughness in [0.5, 0.8] {
        let beam = |_: usize| ray([0.0, 0.0, 5.0], [-0.1, 0.05, -1.0]);
        let ball = estimate(&mirror(roughness, near), None, 400_000, 4, beam);
        let point = estimate(&mirror(roughness, &point), None, 40_960, 4, beam);
        println!("roughness {roughness}: {} ± {}, as a point {}", ball.mean, ball.standard_error, point.mean);
        assert!((ball.mean / point.mean - 1.0).abs() < 3e-3 + 3.5 * ball.standard_error / point.mean);
    }
}

#[test]
fn smoke_in_a_pane_takes_its_share_on_every_way_through() {
    let stage = stage(&format!(
        "{SET}
shapes:
  pane: {{box: {{center: [0, 0, 0], size: [4, 4, 0.5]}}, material: {{dielectric: {{}}}}}}
{}
lights: [{{environment: {{radiance: [1, 1, 1]}}}}]
",
        smoke("extinction: 2, albedo: [0, 0, 0]")
    ));
    // Only inside the pane.
    let medium = medium(&stage, centered_grid([8, 8, 8], 0.05, |_| 1.0));
    let found = estimate(&stage, Some(&medium), 400_000, 3, |_| ray([0.0, 0.0, 5.0], [0.0, 0.0, -1.0]));
    // 8 voxels of 0.05 m, whose outer halves are ramps: 7 whole ones and two halves of half the density.
    let t = (-2.0f64 * 0.05 * (7.0 + 2.0 * 0.5)).exp();
    let r = 0.04;
    // Light from behind, on all ways between the surfaces: (1 − R)² T/(1 − R² T²); from before: R + (1 − R)² R T²/(1 − R² T²).
    let q = (1.0 - r) * (1.0 - r) / (1.0 - r * r * t * t);
    let expected = q * t + r + q * r * t * t;
    println!("smoke in a pane: {} ± {}, expected {expected}", found.mean, found.standard_error);
    assert!(found.z(expected) < 3.5);
}

#[test]
fn a_shape_of_one_side_is_black_inside() {
    let room = |sides: &str| {
        stage(&format!(
            "{SET}
shapes:
  room: {{sphere: {{center: [0, 0, 0], radius: 2}}, {sides} material: {{diffuse: {{reflectance: [0.5, 0.5, 0.5], emission: [1, 1, 1]}}}}}}
"
        ))
    };
    let (inside, outside) = (ray([0.0, 0.0, 0.0], [0.3, 0.0, -1.0]), ray([0.0, 0.0, 5.0], [0.0, 0.0, -1.0]));
    let both = room("");
    assert!((pixel(&both, None, 4096, inside).mean.x - 2.0).abs() < 0.1);
    let one = room("two_sided: false,");
    assert_eq!(pixel(&one, None, 64, inside).mean, Vec3::ZERO);
    assert_eq!(pixel(&one, None, 64, outside).mean, Vec3::ONE);
}

/// A glowing ball behind smoke, as `flag` says.
fn ball_in_smoke(flag: &str) -> Stage {
    stage(&format!(
        "{SET}
shapes:
  ball: {{sphere: {{center: [0, 0, -1], radius: 0.5}}, {flag} material: {{diffuse: {{reflectance: [0, 0, 0], emission: [3, 3, 3]}}}}}}
{}
lights: [{{environment: {{radiance: [1, 1, 1], visible: false}}}}]
",
        smoke("extinction: 2, albedo: [0.8, 0.8, 0.8]")
    ))
}

#[test]
fn a_holdout_over_its_plate_is_the_whole_picture() {
    let lumps = |p: WorldPoint| (0.5 + 0.5 * (9.0 * p.0.x).sin() * (7.0 * p.0.y).cos()).max(0.0);
    let (whole, hole) = (ball_in_smoke(""), ball_in_smoke("holdout: true,"));
    let smoke = medium(&whole, centered_grid([8, 8, 8], 0.1, lumps));
    let mut cut = 0;
    for i in 0..12 {
        let beam = ray([0.08 * i as f32, 0.05, 5.0], [0.0, 0.0, -1.0]);
        let n = 1 << 14;
        let (full, held) = (pixel(&whole, Some(&smoke), n, beam), pixel(&hole, Some(&smoke), n, beam));
        let plate = pixel(&whole, None, 1, beam);
        // The plate is the ball alone; where it is not, both see nothing.
        let over = held.mean.x + (1.0 - held.alpha) * plate.mean.x * plate.alpha;
        // Alpha is a share of paths: its noise is that of a coin.
        let coin = held.alpha * (1.0 - held.alpha) / n as f32 * 9.0;
        let error = (full.variance.x + held.variance.x + coin).sqrt();
        assert!((full.mean.x - over).abs() < 4.0 * error + 1e-6, "{i}: {} and {over} ± {error}", full.mean.x);
        cut += usize::from(plate.alpha == 1.0 && held.alpha < 0.9 && full.alpha == 1.0);
    }
    assert!(cut > 3, "the ball is behind some of the pixels");
}

#[test]
fn what_the_camera_does_not_see_still_casts_shadows() {
    let scene = |flag: &str| {
        stage(&format!(
            "{SET}
shapes:
  floor: {{plane: {{}}, material: {{diffuse: {{reflectance: [0.5, 0.5, 0.5]}}}}}}
  lid: {{box: {{center: [0, 1, 0], size: [1, 0.1, 1]}}, {flag} material: {{diffuse: {{reflectance: [0.9, 0.9, 0.9]}}}}}}
lights: [{{sun: {{direction: [0, -1, 0], irradiance: [3.14159265, 3.14159265, 3.14159265]}}}}]
"
        ))
    };
    let (down, beside) = (ray([0.0, 4.0, 0.0], [0.0, -1.0, 0.0]), ray([3.0, 4.0, 0.0], [0.0, -1.0, 0.0]));
    let seen = scene("");
    assert!(pixel(&seen, None, 1024, down).mean.x > 0.85);
    let hidden = scene("invisible_to_camera: true,");
    let under = pixel(&hidden, None, 1024, down);
    assert!(under.mean.x < 0.2 && under.alpha == 1.0, "{}", under.mean);
    assert!(pixel(&hidden, None, 1024, beside).mean.x > 0.49);
}

#[test]
fn a_shadow_catcher_holds_the_share_of_light_that_is_missing() {
    let catcher = |rest: &str, lights: &str| {
        stage(&format!(
            "{SET}
shapes:
  floor: {{plane: {{}}, shadow_catcher: true, material: {{diffuse: {{reflectance: [0.3, 0.4, 0.5]}}}}}}
{rest}
lights: [{lights}]
"
        ))
    };
    let down = ray([0.0, 4.0, 0.3], [0.0, -1.0, 0.0]);
    let sun = "{sun: {direction: [0.5, -1, 0], irradiance: [3, 3, 3]}}";
    let sky = "{environment: {radiance: [1, 1, 1], visible: false}}";
    // Nothing in the way: no shadow, not even noise.
    for light in [sun, sky, "{sphere: {center: [0, 3, 2], radius: 1, radiance: [3, 2, 1]}}"] {
        let clear = pixel(&catcher("", light), None, 1024, down);
        assert!(clear.alpha < 1e-5 && clear.mean == Vec3::ZERO, "{light}: {}", clear.alpha);
    }
    // A black lid takes all of the sun.
    let lid = "  lid: {box: {center: [-1, 2, 0.3], size: [1, 0.1, 1]}, material: {diffuse: {reflectance: [0, 0, 0]}}}";
    assert_eq!(pixel(&catcher(lid, sun), None, 256, down).alpha, 1.0);
    // A black wall takes half of an even sky from what is at its foot.
    let wall = "  wall: {box: {center: [-500.01, 0, 0], size: [1000, 4000, 4000]}, material: {diffuse: {reflectance: [0, 0, 0]}}}";
    let half = pixel(&catcher(wall, sky), None, 1 << 15, down).alpha;
    assert!((half - 0.5).abs() < 0.015, "{half}");
    // Smoke that only absorbs takes 1 − exp(−τ) of the sun, straight down through 0.8 m; above the camera.
    let above =
        catcher(&smoke("extinction: 1, albedo: [0, 0, 0]"), "{sun: {direction: [0, -1, 0], irradiance: [3, 3, 3]}}");
    let grid = DensityGrid::from_fn(WorldPoint::new(-0.4, 5.0, -0.4), 0.1, glam::UVec3::new(8, 8, 8), 1 << 30, |_| 1.0);
    let smoke = medium(&above, grid.expect("small"));
    let found = pixel(&above, Some(&smoke), 1 << 15, ray([0.0, 4.0, 0.0], [0.0, -1.0, 0.0])).alpha;
    let expected = 1.0 - (-0.8f32).exp();
    assert!((found - expected).abs() < 0.015, "{found}, expected {expected}");
    // And of stripes of smoke that fall between the points of what is tabled of the sun's light.
    let stripe = |p: WorldPoint| f32::from(u8::from((p.0.x * 10.0).floor().rem_euclid(2.0) == 0.0)) * 4.0;
    let grid = DensityGrid::from_fn(WorldPoint::new(-0.4, 5.0, -0.4), 0.1, glam::UVec3::new(8, 8, 8), 1 << 30, stripe);
    let stripes = medium(&above, grid.expect("small"));
    for x in [0.03, 0.1, 0.15] {
        let up = Ray { origin: WorldPoint::new(x, 0.0, 0.0), direction: UnitVec3::Y };
        let expected = 1.0 - Media::from(Some(&stripes)).view_through(&up, 100.0).expect("smoke").transmittance as f32;
        let found = pixel(&above, Some(&stripes), 1 << 17, ray([x, 4.0, 0.0], [0.0, -1.0, 0.0])).alpha;
        assert!((found - expected).abs() < 0.02, "{x}: {found}, expected {expected}");
    }
}
