//! Light transport with known answers.

mod support;

use curlsmoke::geometry::Geometry;
use curlsmoke::geometry::embree::Ray;
use curlsmoke::grid::DensityGrid;
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::space::{UnitVec3, WorldPoint};
use curlsmoke::math::statistics::{Moments, normal_quantile, sidak};
use curlsmoke::progress::Silent;
use curlsmoke::render::environment::Environment;
use curlsmoke::render::film::Film;
use curlsmoke::render::light::Light;
use curlsmoke::render::medium::Medium;
use curlsmoke::render::picture::Picture;
use curlsmoke::render::world::World;
use curlsmoke::render::{self, TextureStore};
use curlsmoke::scene::Scene;
use glam::Vec3;
use rayon::prelude::*;
use std::f64::consts::PI;
use std::path::Path;
use support::{Stage, centered_grid, estimate, stage, textures};

fn ray(origin: [f32; 3], direction: [f32; 3]) -> Ray {
    Ray {
        origin: WorldPoint(Vec3::from(origin)),
        direction: UnitVec3::try_new(Vec3::from(direction)).expect("not zero"),
    }
}

fn medium(stage: &Stage, grid: DensityGrid) -> Medium {
    render::build_medium(&stage.scene, grid).expect("not too dense").expect("the scene has smoke")
}

/// Optical depth along a ray between two distances by the midpoint rule in double precision.
fn optical_depth(medium: &Medium, ray: &Ray, t0: f64, t1: f64, steps: usize) -> f64 {
    let dt = (t1 - t0) / steps as f64;
    let density = |i: usize| f64::from(medium.grid().density(ray.at((t0 + (i as f64 + 0.5) * dt) as f32)));
    (0..steps).map(density).sum::<f64>() * dt * f64::from(medium.extinction())
}

const SMOKE: &str = "
camera: {position: [0, 0, 5], look_at: [0, 0, 0]}
film: {resolution: [32, 24], spp: 16}
";

/// A lumpy density between 0 and 1.
fn lumps(p: WorldPoint) -> f32 {
    let p = p.0 * 5.0;
    (0.5 + 0.5 * (p.x.sin() * p.y.cos() + (p.z + 0.3).sin() * 0.5)).clamp(0.0, 1.0) * f32::from(p.x.sin() > -0.5)
}

#[test]
fn transmittance_is_that_of_beer_and_lambert() {
    let stage = stage(&format!(
        "{SMOKE}
smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{extinction: 2.5, albedo: [0, 0, 0]}}}}
lights: [{{environment: {{radiance: [1, 1, 1]}}}}]
"
    ));
    for (name, density) in
        [("homogeneous", (|_| 1.0) as fn(WorldPoint) -> f32), ("lumpy", lumps as fn(WorldPoint) -> f32)]
    {
        let medium = medium(&stage, centered_grid([16, 16, 16], 0.1, density));
        let beam = ray([0.11, 0.07, 5.0], [0.02, 0.01, -1.0]);
        let expected = (-optical_depth(&medium, &beam, 3.0, 7.0, 400_000)).exp();
        let found = estimate(&stage, Some(&medium), 10_000_000, 1, |_| beam);
        println!("Beer-Lambert, {name}: {} ± {}, expected {expected}", found.mean, found.standard_error);
        assert!(found.z(expected) < 3.0);
    }
}

#[test]
fn a_white_furnace_stays_white() {
    // A ball that shines all around everything makes paths meet the light, sample it, and weigh both.
    let stage = stage(&format!(
        "{SMOKE}
render: {{max_bounces: 100000}}
shapes:
  ball: {{sphere: {{center: [0.1, 0, 0], radius: 0.15}}, material: {{diffuse: {{reflectance: [1, 1, 1]}}}}}}
smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{extinction: 3, albedo: [1, 1, 1], phase: {{henyey_greenstein: {{g: 0.4}}}}}}}}
lights: [{{sphere: {{center: [0, 0, 0], radius: 20, radiance: [1, 1, 1]}}}}]
"
    ));
    let medium = medium(&stage, centered_grid([8, 8, 8], 0.1, lumps));
    for (name, beam, count) in [
        ("outside", ray([0.1, 0.05, 5.0], [0.0, 0.0, -1.0]), 10_000_000),
        ("inside", ray([-0.25, 0.1, 0.1], [0.7, 0.2, -0.3]), 10_000_000),
    ] {
        let found = estimate(&stage, Some(&medium), count, 2, |_| beam);
        println!("white furnace, camera {name}: {} ± {}", found.mean, found.standard_error);
        assert!(found.z(1.0) < 3.0);
        assert!(found.standard_error < 1e-3);
    }
}

#[test]
fn a_glowing_room_is_as_bright_as_its_echo() {
    // Walls that give off E and reflect a share r of what they receive: L = E + r L. White smoke changes nothing. The
    // brightness of the walls differs from place to place, but not E/(1 − r).
    let walls = |what: &str, scale: f64| {
        let ramp = [(-0.5, 0.9), (0.5, 0.4)].map(|(at, reflectance): (f64, f64)| {
            let color = if what == "reflectance" { reflectance } else { scale * (1.0 - reflectance) };
            format!("{{at: {at}, color: [{color}, {color}, {color}]}}")
        });
        format!("{what}: {{flow_noise: {{length_scale: 1, ramp: [{}]}}}}", ramp.join(", "))
    };
    let stage = stage(&format!(
        "{SMOKE}
render: {{max_bounces: 100000}}
shapes:
  room: {{sphere: {{center: [0, 0, 0], radius: 2}}, material: {{diffuse: {{{}, {}}}}}}}
  ball: {{sphere: {{center: [0.5, 0, 0], radius: 0.2}}, material: {{diffuse: {{reflectance: [1, 1, 1]}}}}}}
smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{extinction: 3, albedo: [1, 1, 1]}}}}
",
        walls("reflectance", 1.0),
        walls("emission", 3.0)
    ));
    let medium = medium(&stage, centered_grid([8, 8, 8], 0.1, lumps));
    let beam = ray([-0.9, 0.3, 0.2], [0.7, -0.2, -0.1]);
    let found = estimate(&stage, Some(&medium), 400_000, 4, |_| beam);
    println!("glowing room: {} ± {}, expected 3", found.mean, found.standard_error);
    assert!(found.z(3.0) < 3.0 && found.standard_error < 1e-2);
}

#[test]
fn a_texture_moves_with_its_shape_and_in_time() {
    let Stage { scene, .. } = stage(&format!(
        "{SMOKE}
shapes:
  ball:
    sphere: {{center: [1, 0, 0], radius: 0.5}}
    motion: {{keys: [{{time: 0}}, {{time: 1, translate: [0, 2, 0], rotate_deg: {{axis: [0, 0, 1], angle: 90}}}}], interpolation: linear}}
    material: {{diffuse: {{reflectance: [0, 0, 0], emission: {{flow_noise: {{length_scale: 0.2, along: [3, 0, 0], ramp: [{{at: 0, color: [0, 0, 0]}}, {{at: 9, color: [1, 0, 0]}}]}}}}}}}}
  still:
    sphere: {{center: [-1, 0, 0], radius: 0.5}}
    material: {{diffuse: {{reflectance: [0, 0, 0], emission: {{flow_noise: {{length_scale: 0.2, scroll: [0, 0.3, 0], along: [3, 0, 0], ramp: [{{at: -9, color: [0, 0, 0]}}, {{at: 9, color: [1, 0, 0]}}]}}}}}}}}
"
    ));
    let geometry = Geometry::build(&scene, &Silent).unwrap();
    let up = UnitVec3::try_new(Vec3::Y).expect("not zero");
    let at = |time: f64| render::build_materials(&scene, &geometry.at(time), &mut textures(&scene), time);
    let emitted = |time: f64, shape: usize, p: [f32; 3]| at(time)[shape].at(WorldPoint(Vec3::from(p)), up).emitted.x;
    // What flows along a surface for a second has gone so far.
    let flowing = |flow: &str, time: f64| {
        let Stage { scene, .. } = stage(&format!(
            "{SMOKE}
shapes:
  ball:
    sphere: {{center: [0, 0, 0], radius: 1}}
    material: {{diffuse: {{reflectance: [0, 0, 0], emission: {{flow_noise: {{length_scale: 0.2, ramp: [{{at: -1, color: [0, 0, 0]}}, {{at: 1, color: [1, 0, 0]}}]}}}}}}}}
    surface_flow: {{length_scale: 0.5, seed: 3, {flow}}}
"
        ));
        let geometry = Geometry::build(&scene, &Silent).unwrap();
        render::build_materials(&scene, &geometry.at(time), &mut textures(&scene), time)[0]
            .at(WorldPoint(Vec3::new(0.6, 0.0, 0.8)), up)
            .emitted
            .x
    };
    let gone = flowing("distance: 0.3, steps: 40, cache_spacing: 0", 0.0);
    let keys = "keys: [{time: 1, distance: 0.1}, {time: 3, distance: 0.5}], steps: 40, cache_spacing: 0";
    assert_eq!(gone, flowing(keys, 2.0));
    assert_eq!(flowing(keys, 7.0), flowing("distance: 0.5, steps: 40, cache_spacing: 0", 0.0));
    assert_eq!(gone, flowing("distance: 0.1, speed: 0.1, steps: 40, cache_spacing: 0", 2.0));
    assert!((gone - flowing("distance: 0.3, steps: 40", 0.0)).abs() < 0.02);
    for other in [
        "distance: 0",
        "distance: -0.3",
        "distance: 0.2",
        "distance: 0.3, integrator: euler",
        "distance: 0.3, reprojections: 0",
    ] {
        assert_ne!(gone, flowing(&format!("{other}, steps: 40, cache_spacing: 0"), 0.0), "{other}");
    }
    // A quarter turn about the ball's middle brings what is to its right to its top.
    let (rest, moved) = (emitted(0.0, 0, [1.5, 0.0, 0.1]), emitted(1.0, 0, [1.0, 2.5, 0.1]));
    assert!((rest - moved).abs() < 1e-5 && rest > 0.0, "{rest} {moved}");
    assert_ne!(rest, emitted(0.0, 0, [1.0, 0.5, 0.1]));
    let (rest, moved) = (emitted(0.0, 1, [-0.5, 0.0, 0.1]), emitted(0.5, 1, [-0.5, 0.15, 0.1]));
    assert!((rest - moved).abs() < 1e-5, "{rest} {moved}");
    assert_ne!(rest, emitted(0.5, 1, [-0.5, 0.0, 0.1]));
}

#[test]
fn a_white_furnace_of_sky_alone_is_white_in_every_path() {
    let stage = stage(&format!(
        "{SMOKE}
render: {{max_bounces: 100000}}
shapes:
  ring: {{torus: {{center: [0, 0, 0], major_radius: 0.5, minor_radius: 0.1}}, material: {{diffuse: {{reflectance: [1, 1, 1]}}}}}}
smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{extinction: 20, albedo: [1, 1, 1]}}}}
lights: [{{environment: {{radiance: [1, 1, 1]}}}}]
"
    ));
    let medium = medium(&stage, centered_grid([16, 16, 16], 0.1, lumps));
    let film = render::tiles::render(&render::build_view(&stage.scene, 1, None), &stage.world, Some(&medium), &Silent)
        .expect("renders");
    for pixel in &film.pixels {
        assert!((pixel.mean - 1.0).abs().max_element() < 1e-4, "{:?}", pixel.mean);
        assert_eq!(pixel.alpha, 1.0);
    }
}

/// Demands that a picture is what it should be within its noise: nearly every pixel, every block of 8 × 8, and the whole.
///
/// Tails are heavy where few paths meet smoke: a pixel that has not yet had a rare path underrates its noise, so a few
/// pixels in a thousand may fail, as in `compare --mode stat`. A pixel's variance is an upper bound, as samples are
/// stratified; the whole is measured by the spread between pixels.
fn check_pixels(name: &str, film: &Film, expected: impl Fn(usize) -> f64) {
    const BLOCK: usize = 8;
    let (width, n) = (film.bounds.width() as usize, film.pixels.len());
    let mut blocks = vec![(0.0, 0.0); n / (BLOCK * BLOCK)];
    let (mut differences, mut scores) = (Moments::default(), Vec::new());
    for (i, pixel) in film.pixels.iter().enumerate() {
        let (difference, variance) = (f64::from(pixel.mean.x) - expected(i), f64::from(pixel.variance.x));
        if variance == 0.0 {
            // Without noise only rounding is left.
            assert!(difference.abs() <= 1e-5 * expected(i), "{name}, pixel {i}: {difference}");
            continue;
        }
        // In units as they are: in those of its own noise, which a pixel's luck lowers with its mean, they would be off.
        differences.push(difference);
        scores.push(difference.abs() / variance.sqrt());
        let block = &mut blocks[i / width / BLOCK * (width / BLOCK) + i % width / BLOCK];
        *block = (block.0 + difference, block.1 + variance);
    }
    let limit = |tests: usize| -normal_quantile(0.5 * sidak(0.001, tests));
    let failed = scores.iter().filter(|score| **score > limit(n)).count();
    let noisy = blocks.iter().filter(|block| block.1 > 0.0);
    let worst = noisy.map(|block| block.0.abs() / block.1.sqrt()).fold(0.0, f64::max);
    let whole = differences.mean() / differences.variance_of_mean().sqrt();
    let found = format!("{failed} pixels, worst block {worst:.2}, whole {whole:+.2} ({:+.2e})", differences.mean());
    assert!(scores.len() > n / 4 && failed * 300 <= n, "{name}: {found}");
    assert!(worst < limit(blocks.len()) && whole.abs() < 3.3, "{name}: {found}");
}

/// The furnace of the tests below, seen by the whole picture.
const FURNACE: &str = "
camera: {position: [0, 0, 3], look_at: [0, 0, 0]}
film: {resolution: [32, 24], spp: 2048}
render: {max_bounces: 100000}
shapes:
  ball: {sphere: {center: [0.2, 0, 0], radius: 0.3}, material: {diffuse: {reflectance: [1, 1, 1]}}}
smoke: {emitters: [{point: {position: [0, 0, 0]}, count: 1, lifetime: 1}], grid: {voxel_size: 1}, medium: {extinction: 3, albedo: [1, 1, 1], phase: {henyey_greenstein: {g: 0.4}}}}
";

fn picture_of(stage: &Stage, world: &World, medium: Option<&Medium>) -> Film {
    render::tiles::render(&render::build_view(&stage.scene, 1, None), world, medium, &Silent).expect("renders")
}

#[test]
fn all_pixels_of_a_furnace_are_white() {
    let stage =
        stage(&format!("{FURNACE}\nlights: [{{sphere: {{center: [0, 0, 0], radius: 20, radiance: [1, 1, 1]}}}}]"));
    let medium = medium(&stage, centered_grid([16, 16, 16], 0.1, lumps));
    check_pixels("furnace of a shining ball", &picture_of(&stage, &stage.world, Some(&medium)), |_| 1.0);
}

/// A dark picture of the sky with one bright pixel, which is sampled; with `rest`, what is missing from it to 1.
fn skies(rest: bool) -> Vec<Light> {
    let dark: Vec<Vec3> = (0..16 * 8).map(|i| Vec3::splat(if i == 37 { 1.0 } else { 0.02 })).collect();
    let light = dark.iter().map(|&p| Vec3::ONE - p).collect();
    let sky = |pixels| Light::Environment(Environment::picture(16, 8, pixels, 33.0, true));
    let mut skies = vec![sky(dark)];
    assert!(skies[0].is_worth_sampling());
    if rest {
        skies.push(sky(light));
    }
    skies
}

#[test]
fn all_pixels_of_a_furnace_of_sampled_sky_are_white() {
    let Stage { scene, world } = stage(&format!("{FURNACE}\nlights: [{{environment: {{radiance: [1, 1, 1]}}}}]"));
    // Two pictures that add up to 1 everywhere, also between their pixels.
    let world = World::new(world.surfaces, world.materials, skies(true));
    let stage = Stage { scene, world };
    let medium = medium(&stage, centered_grid([16, 16, 16], 0.1, lumps));
    check_pixels("furnace of sampled sky", &picture_of(&stage, &stage.world, Some(&medium)), |_| 1.0);
}

#[test]
fn a_ball_under_a_picture_with_one_bright_pixel_equals_quadrature_in_every_pixel() {
    // A convex ball sees nothing but sky, so its radiance is reflectance/π ∫ L cos: all bounces are in it.
    let Stage { scene, world } = stage(
        "
camera: {position: [0, 0, 3], look_at: [0, 0, 0]}
film: {resolution: [24, 24], spp: 1024, filter: {box: {radius: 0}}}
shapes:
  ball: {sphere: {center: [0, 0, 0], radius: 0.8}, material: {diffuse: {reflectance: [0.7, 0.7, 0.7]}}}
lights: [{environment: {radiance: [1, 1, 1]}}]
",
    );
    let world = World::new(world.surfaces, world.materials, skies(false));
    let stage = Stage { scene, world };
    let Light::Environment(sky) = &stage.world.lights[0] else { panic!("a sky") };
    // The midpoint rule over cosine and longitude, fine enough for the tent of the bright pixel.
    const N: usize = 1024;
    let directions: Vec<(Vec3, f64)> = (0..N * N / 2)
        .map(|i| {
            let y = 1.0 - 2.0 * ((i / N) as f64 + 0.5) / (N / 2) as f64;
            let (s, c) = (((i % N) as f64 + 0.5) / N as f64 * 2.0 * PI).sin_cos();
            let r = (1.0 - y * y).sqrt();
            let d = Vec3::new((r * c) as f32, y as f32, (r * s) as f32);
            let direction = UnitVec3::try_new(d).expect("not zero");
            (*direction, f64::from(sky.radiance(direction).x) * 4.0 * PI / (N * N / 2) as f64)
        })
        .collect();
    let camera = render::build_view(&stage.scene, 1, None).camera;
    let expected = |i: usize| {
        let pixel = glam::Vec2::new((i % 24) as f32 + 0.5, (i / 24) as f32 + 0.5);
        let beam = camera.ray(pixel, [0.5, 0.5]);
        let Some(hit) = stage.world.surfaces.intersect(&beam, 0.0, f32::INFINITY) else {
            return f64::from(sky.radiance(beam.direction).x);
        };
        let lit = directions.iter().map(|(d, weight)| weight * f64::from(hit.normal.dot(*d).max(0.0))).sum::<f64>();
        0.7 / PI * lit
    };
    let expected: Vec<f64> = (0..24 * 24).into_par_iter().map(expected).collect();
    check_pixels("ball under a bright pixel", &picture_of(&stage, &stage.world, None), |i| expected[i]);
}

/// Radiance scattered once towards the camera along `beam`, from a light given by its direction, distance and
/// irradiance at a point.
fn single_scattering(
    medium: &Medium,
    beam: &Ray,
    phase: impl Fn(f64) -> f64,
    samples: &[(usize, f64)],
    light: impl Fn(WorldPoint, usize) -> (UnitVec3, f64, f64),
) -> f64 {
    const STEPS: usize = 1500;
    let (t0, t1) = (3.0, 7.0);
    let dt = (t1 - t0) / STEPS as f64;
    let mut tau = 0.0;
    let mut radiance = 0.0;
    for i in 0..STEPS {
        let p = beam.at((t0 + (i as f64 + 0.5) * dt) as f32);
        let sigma = f64::from(medium.grid().density(p)) * f64::from(medium.extinction());
        let transmittance = (-(tau + 0.5 * sigma * dt)).exp();
        tau += sigma * dt;
        if sigma == 0.0 {
            continue;
        }
        for &(which, weight) in samples {
            let (to_light, distance, irradiance) = light(p, which);
            let shadow = Ray { origin: p, direction: to_light };
            let towards = (-optical_depth(medium, &shadow, 0.0, distance.min(4.0), 600)).exp();
            // The cosine between directions of travel: light comes along −to_light and leaves along −beam.
            let cosine = f64::from(to_light.dot(*beam.direction));
            radiance += weight * sigma * dt * transmittance * phase(cosine) * irradiance * towards;
        }
    }
    radiance
}

fn henyey_greenstein(g: f64) -> impl Fn(f64) -> f64 {
    move |c| (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * c).powf(1.5))
}

#[test]
fn single_scattering_equals_quadrature_for_every_light() {
    let setting = |light: &str| {
        stage(&format!(
            "{SMOKE}
render: {{max_bounces: 1}}
smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{extinction: 2, albedo: [0.8, 0.8, 0.8], phase: {{henyey_greenstein: {{g: 0.5}}}}}}}}
lights: [{light}]
"
        ))
    };
    let beam = ray([0.05, 0.12, 5.0], [0.0, 0.0, -1.0]);
    let phase = henyey_greenstein(0.5);
    let check = |name: &str, stage: &Stage, expected: &dyn Fn(&Medium) -> f64| {
        let medium = medium(stage, centered_grid([12, 12, 12], 0.1, lumps));
        let expected = expected(&medium) * 0.8;
        let found = estimate(stage, Some(&medium), 1_000_000, 3, |_| beam);
        println!("single scattering, {name}: {} ± {}, quadrature {expected}", found.mean, found.standard_error);
        // The quadrature itself is good to a few parts in ten thousand.
        assert!((found.mean - expected).abs() < 3.0 * found.standard_error + 5e-4 * expected, "{name}");
    };

    let sun = setting("{sun: {direction: [0.5, -1, 0.25], irradiance: [3, 3, 3]}}");
    let to_sun = UnitVec3::try_new(Vec3::new(-0.5, 1.0, -0.25)).expect("not zero");
    check("sun", &sun, &|m| single_scattering(m, &beam, &phase, &[(0, 1.0)], |_, _| (to_sun, 1e3, 3.0)));

    let point = setting("{point: {position: [1, 1.5, 0.5], intensity: [4, 4, 4]}}");
    let at = WorldPoint::new(1.0, 1.5, 0.5);
    check("point", &point, &|m| {
        single_scattering(m, &beam, &phase, &[(0, 1.0)], |p, _| {
            let d = at - p;
            (UnitVec3::try_new(d).expect("apart"), f64::from(d.length()), 4.0 / f64::from(d.length_squared()))
        })
    });

    let rectangle =
        setting("{rectangle: {center: [0, 1.5, 0], half_u: [0.5, 0, 0], half_v: [0, 0, 0.4], radiance: [5, 5, 5]}}");
    const SIDE: usize = 8;
    let cells: Vec<(usize, f64)> = (0..SIDE * SIDE).map(|i| (i, 1.0 / (SIDE * SIDE) as f64)).collect();
    // half_u × half_v points down, towards the smoke: that is the front.
    check("rectangle", &rectangle, &|m| {
        single_scattering(m, &beam, &phase, &cells, |p, i| {
            let along = |k: usize| (k as f32 + 0.5) / SIDE as f32 * 2.0 - 1.0;
            let q = WorldPoint::new(0.5 * along(i % SIDE), 1.5, 0.4 * along(i / SIDE));
            let d = q - p;
            let (direction, d_sq) = (UnitVec3::try_new(d).expect("apart"), f64::from(d.length_squared()));
            (direction, d_sq.sqrt(), 5.0 * 0.8 * f64::from(direction.y) / d_sq)
        })
    });

    let ball = setting("{sphere: {center: [1, 1.5, 0.5], radius: 0.05, radiance: [400, 400, 400]}}");
    check("small ball", &ball, &|m| {
        single_scattering(m, &beam, &phase, &[(0, 1.0)], |p, _| {
            let d = at - p;
            let d_sq = f64::from(d.length_squared());
            (UnitVec3::try_new(d).expect("apart"), d_sq.sqrt() - 0.05, 400.0 * PI * 0.0025 / d_sq)
        })
    });
}

/// Chandrasekhar's H function for isotropic scattering with single-scattering albedo `albedo`, at `mu` (Chandrasekhar
/// 1960, *Radiative Transfer*, §37–38), by iteration on a Gauss–Legendre-fine midpoint grid.
fn chandrasekhar_h(albedo: f64, mu: f64) -> f64 {
    const N: usize = 2000;
    let nodes: Vec<f64> = (0..N).map(|i| (i as f64 + 0.5) / N as f64).collect();
    let mut h = vec![1.0; N];
    let value = |h: &[f64], mu: f64| {
        let s: f64 = nodes.iter().zip(h).map(|(&m, &hm)| m * hm / (mu + m)).sum::<f64>() / N as f64 * 0.5 * albedo;
        // The form that converges for every albedo: 1/H = sqrt(1 − ω) + (ω/2) ∫ μ' H(μ')/(μ + μ') dμ'.
        1.0 / ((1.0 - albedo).sqrt() + s)
    };
    for _ in 0..60 {
        h = nodes.iter().map(|&m| value(&h, m)).collect();
    }
    value(&h, mu)
}

#[test]
fn a_half_space_of_smoke_reflects_as_chandrasekhar_says() {
    let (albedo, mu0) = (0.9f64, 0.6f64);
    let stage = stage(&format!(
        "{SMOKE}
render: {{max_bounces: 100000}}
smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{extinction: 4, albedo: [{albedo}, {albedo}, {albedo}]}}}}
lights: [{{sun: {{direction: [0.8, -0.6, 0], irradiance: [2, 2, 2]}}}}]
"
    ));
    // 256 mean free paths across and 128 deep: no light reaches the sides or the bottom.
    let medium = medium(&stage, centered_grid([64, 32, 64], 1.0, |_| 1.0));
    let beam = ray([0.3, 40.0, -0.2], [0.0, -1.0, 0.0]);
    let expected =
        albedo * 2.0 / (4.0 * PI) * mu0 / (1.0 + mu0) * chandrasekhar_h(albedo, 1.0) * chandrasekhar_h(albedo, mu0);
    let found = estimate(&stage, Some(&medium), 400_000, 4, |_| beam);
    println!("half space: {} ± {}, Chandrasekhar {expected}", found.mean, found.standard_error);
    assert!(found.z(expected) < 3.0);
    assert!(found.standard_error < 5e-3 * expected);
}

#[test]
fn light_may_go_either_way() {
    // The flux that an irregular cloud scatters from direction a into direction b equals that from −b into −a.
    let (a, b) = (Vec3::new(0.3, -0.8, 0.5), Vec3::new(-0.6, 0.1, 0.75));
    let flux = |incoming: Vec3, outgoing: Vec3, seed: u64| {
        let stage = stage(&format!(
            "{SMOKE}
render: {{max_bounces: 100000}}
smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{extinction: 6, albedo: [0.9, 0.9, 0.9], phase: {{henyey_greenstein: {{g: 0.6}}}}}}}}
lights: [{{sun: {{direction: [{}, {}, {}], irradiance: [1, 1, 1]}}}}]
",
            incoming.x, incoming.y, incoming.z
        ));
        let medium = medium(&stage, centered_grid([12, 12, 12], 0.1, lumps));
        let out = UnitVec3::try_new(outgoing).expect("not zero");
        let (u, v) = out.orthonormal_pair();
        estimate(&stage, Some(&medium), 3_000_000, seed, |block| {
            // Parallel beams all over the cloud's silhouette, one for each block.
            let mut rng = CounterRng::new(Seed(77).derive(block as u64));
            let (x, y) = (rng.uniform() * 2.4 - 1.2, rng.uniform() * 2.4 - 1.2);
            Ray { origin: WorldPoint(u * x + v * y + *out * 4.0), direction: -out }
        })
    };
    let (there, back) = (flux(a, b, 5), flux(-b, -a, 6));
    println!("reciprocity: {there:?} {back:?}");
    let z = (there.mean - back.mean).abs() / there.standard_error.hypot(back.standard_error);
    assert!(z < 3.0);
}

#[test]
fn very_dense_smoke_is_opaque_and_finite() {
    let stage = stage(&format!(
        "{SMOKE}
smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{extinction: 1e6, albedo: [0.5, 0.5, 0.5]}}}}
lights: [{{sun: {{direction: [0, -1, -1], irradiance: [3, 3, 3]}}}}, {{environment: {{radiance: [100, 100, 100]}}}}]
"
    ));
    let medium = medium(&stage, centered_grid([8, 8, 8], 0.5, |_| 1.0));
    let film = render::tiles::render(&render::build_view(&stage.scene, 1, None), &stage.world, Some(&medium), &Silent)
        .expect("renders");
    let middle = film.pixels[12 * 32 + 16];
    assert_eq!(middle.alpha, 1.0);
    assert!(middle.mean.x > 0.0 && middle.mean.x < 100.0, "{:?}", middle.mean);
}

#[test]
fn an_empty_box_equals_no_box_bit_for_bit() {
    let stage = stage(&format!(
        "{SMOKE}
shapes:
  floor: {{plane: {{point: [0, -1, 0]}}}}
  ball: {{sphere: {{center: [0, 0, 0], radius: 0.7}}}}
smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{extinction: 10}}}}
lights:
  - sun: {{direction: [0.3, -1, -0.4], irradiance: [2, 2, 2]}}
  - environment: {{gradient: {{zenith: [0.2, 0.4, 1], horizon: [1, 1, 1], nadir: [0.1, 0.1, 0.1]}}}}
"
    ));
    let view = render::build_view(&stage.scene, 1, None);
    let empty = medium(&stage, centered_grid([16, 16, 16], 0.1, |_| 0.0));
    let with = render::tiles::render(&view, &stage.world, Some(&empty), &Silent).expect("renders");
    let without = render::tiles::render(&view, &stage.world, None, &Silent).expect("renders");
    assert_eq!(with.pixels, without.pixels);
}

#[test]
fn pictures_do_not_depend_on_threads_or_crop() {
    use curlsmoke::render::adaptive::Adaptive;
    use curlsmoke::render::film::PixelBounds;
    use curlsmoke::render::tiles::View;
    let stage = stage(&format!(
        "{SMOKE}
shapes:
  ball: {{sphere: {{center: [0.4, 0, 0], radius: 0.5}}}}
smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{extinction: 10}}}}
lights: [{{sun: {{direction: [0.3, -1, -0.4], irradiance: [2, 2, 2]}}}}, {{environment: {{radiance: [1, 1, 1]}}}}]
"
    ));
    let medium = medium(&stage, centered_grid([16, 16, 16], 0.1, lumps));
    for adaptive in [None, Some(Adaptive { noise: 0.1, min_spp: 4 })] {
        let picture = |threads: usize, crop: Option<PixelBounds>| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let view = View { adaptive, ..render::build_view(&stage.scene, 1, crop) };
            pool.install(|| render::tiles::render(&view, &stage.world, Some(&medium), &Silent)).expect("renders")
        };
        let whole = picture(1, None);
        for threads in [2, 7] {
            let other = picture(threads, None);
            assert_eq!(whole.pixels, other.pixels);
            assert_eq!(whole.paths, other.paths);
        }
        for crop in [[5, 3, 27, 22], [0, 7, 11, 24], [13, 0, 14, 1]] {
            let crop = PixelBounds { x0: crop[0], y0: crop[1], x1: crop[2], y1: crop[3] };
            let part = picture(2, Some(crop));
            for y in crop.y0..crop.y1 {
                for x in crop.x0..crop.x1 {
                    let of_whole = whole.pixels[whole.bounds.index(x, y)];
                    let of_part = part.pixels[crop.index(x, y)];
                    assert_eq!(of_whole, of_part, "({x}, {y}) of {crop:?}");
                }
            }
        }
    }
}

/// The frame keeps its bits whatever is rendered beside it, and what is beside it does not depend on how much of it is rendered.
#[test]
fn overscan_leaves_the_frame_as_it_is() {
    use curlsmoke::render::adaptive::Adaptive;
    use curlsmoke::render::film::{Film, PixelBounds};
    use curlsmoke::render::tiles::View;
    let projections = ["perspective", "lat_long", "{orthographic: {height: 3}}"];
    for (projection, lens) in projections.iter().flat_map(|p| ["", ", lens: {radius: 0.1}"].map(|lens| (p, lens))) {
        let lens = if *projection == "lat_long" { "" } else { lens };
        let picture = |overscan: &str, crop: Option<PixelBounds>, adaptive: Option<Adaptive>| -> Film {
            let text = format!(
                "version: 1
camera: {{position: [0, 0.2, 3], look_at: [0.3, 0, 0], projection: {projection}{lens}}}
film: {{resolution: [20, 12], spp: 8{overscan}}}
shapes:
  ball: {{sphere: {{center: [0.4, 0, 0], radius: 0.9}}}}
smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{extinction: 10}}}}
lights: [{{sun: {{direction: [0.3, -1, -0.4], irradiance: [2, 2, 2]}}}}, {{environment: {{radiance: [1, 1, 1]}}}}]
output: {{image: o.exr, aovs: [depth, normal, variance, samples, motion]}}
"
            );
            let stage = stage(&text);
            let medium = medium(&stage, centered_grid([16, 16, 16], 0.1, lumps));
            let view = View { adaptive, ..render::build_view(&stage.scene, 1, crop) };
            render::tiles::render(&view, &stage.world, Some(&medium), &Silent).expect("renders")
        };
        for adaptive in [None, Some(Adaptive { noise: 0.1, min_spp: 4 })] {
            let frame = picture("", None, adaptive);
            let more = picture(", overscan: [7, 2, 3, 1]", None, adaptive);
            assert_eq!(more.bounds, PixelBounds { x0: -7, y0: -3, x1: 22, y1: 13 });
            let channels: usize = more.layers.iter().map(|layer| layer.channel_count()).sum();
            let agree = |part: &Film| {
                let b = part.bounds;
                for (x, y) in (b.y0..b.y1).flat_map(|y| (b.x0..b.x1).map(move |x| (x, y))) {
                    let (own, of_more) = (b.index(x, y), more.bounds.index(x, y));
                    assert_eq!(part.pixels[own], more.pixels[of_more], "{projection} {adaptive:?} ({x}, {y})");
                    let data = |film: &Film, i: usize| -> Vec<u32> {
                        film.layer_data[i * channels..(i + 1) * channels].iter().map(|x| x.to_bits()).collect()
                    };
                    assert_eq!(data(part, own), data(&more, of_more), "{projection} {adaptive:?} ({x}, {y})");
                }
            };
            agree(&frame);
            let corner = PixelBounds { x0: -7, y0: -3, x1: 5, y1: 2 };
            agree(&picture(", overscan: [7, 2, 3, 1]", Some(corner), adaptive));
            // Nothing beside it is a copy.
            let pixel = |x, y| more.pixels[more.bounds.index(x, y)];
            assert!((-3..13).any(|y| pixel(-1, y) != pixel(0, y)) && (-3..13).any(|y| pixel(-1, y) != pixel(19, y)));
        }
    }
}

/// The same flow in the next frame is the same one, with the ways that it has followed; another flow is not.
#[test]
fn flows_along_surfaces_are_kept_as_long_as_they_stay_the_same() {
    for (flow, is_kept) in [("distance: 0.3", true), ("distance: 0.3, speed: 0.1", false)] {
        let Stage { scene, .. } = stage(&format!(
            "{SMOKE}
shapes:
  ball:
    sphere: {{center: [0, 0, 0], radius: 1}}
    motion: {{keys: [{{time: 0}}, {{time: 1, translate: [0, 2, 0]}}]}}
    surface_flow: {{length_scale: 0.5, {flow}}}
lights: [{{environment: {{radiance: [1, 1, 1]}}}}]
"
        ));
        let geometry = Geometry::build(&scene, &Silent).unwrap();
        let mut store = textures(&scene);
        let mut at = |time: f64| render::build_materials(&scene, &geometry.at(time), &mut store, time).remove(0).flow;
        let (first, second) = (at(0.0).expect("it flows"), at(0.5).expect("it flows"));
        assert_eq!(std::sync::Arc::ptr_eq(&first, &second), is_kept, "{flow}");
    }
}

/// A picture of two halves, red on the left and green on the right, on a shape that is at rest, moved or flowing.
#[test]
fn pictures_on_surfaces_are_seen_where_they_are_laid_and_flow_with_their_own_normal() {
    let seen = |shape: &str, projection: &str, time: f64, p: Vec3, normal: Vec3| {
        let text = format!(
            "version: 1\ncamera: {{position: [0, 0, 5], look_at: [0, 0, 0]}}\nlights: [{{environment: {{radiance: [1, 1, 1]}}}}]
shapes:
  thing:
    {shape}
    material: {{diffuse: {{reflectance: {{image: {{file: tests/data/halves.png, projection: {projection}, scale: 0.5}}}}}}}}
"
        );
        let scene = Scene::from_text(&text, Path::new("test.yaml")).unwrap_or_else(|e| panic!("{e}"));
        let geometry = Geometry::build(&scene, &Silent).unwrap();
        let halves = |_: &Path| {
            let pixels = (0..32).map(|i| if i % 8 < 4 { Vec3::X } else { Vec3::Y }).collect();
            Ok(Picture { width: 8, height: 4, pixels })
        };
        let mut store = TextureStore::load(&scene, &halves).unwrap();
        let materials = render::build_materials(&scene, &geometry.at(time), &mut store, time);
        let normal = UnitVec3::try_new(normal).expect("not zero");
        materials[0].at(WorldPoint(p), normal).bsdf.albedo()
    };
    let (red, green) = (Vec3::new(0.5, 0.0, 0.0), Vec3::new(0.0, 0.5, 0.0));
    let ball = "sphere: {center: [0, 0, 0], radius: 1}";
    let globe = "{lat_long: {center: [0, 0, 0]}}";
    assert_eq!(seen(ball, globe, 0.0, Vec3::X, Vec3::X), green);
    assert_eq!(seen(ball, globe, 0.0, Vec3::NEG_X, Vec3::NEG_X), red);
    // A turn of the shape by half takes its picture along, normals and all.
    let turning = format!(
        "{ball}\n    motion: {{keys: [{{time: 0}}, {{time: 1, rotate_deg: {{axis: [0, 1, 0], angle: 180}}}}]}}"
    );
    assert_eq!(seen(&turning, globe, 1.0, Vec3::X, Vec3::X), red);
    let tiles = "{triplanar: {tile: 4, offset: [-2, 0, 2], sharpness: 64}}";
    assert_eq!(seen(ball, tiles, 0.0, Vec3::new(0.3, 0.0, 0.95), Vec3::Z), green);
    assert_eq!(seen(&turning, tiles, 1.0, Vec3::new(0.3, 0.0, -0.95), Vec3::NEG_Z), red);
    // What flows from one side of a ball to another is seen as it was where it came from, not by where it is now.
    let flowing = format!("{ball}\n    surface_flow: {{length_scale: 1.5, distance: 1.2, cache_spacing: 0}}");
    let mut differs = 0;
    for i in 0..40 {
        let (a, y) = (i as f32 * 0.4, 0.9 - i as f32 * 0.045);
        let p = Vec3::new((1.0 - y * y).sqrt() * a.cos(), y, (1.0 - y * y).sqrt() * a.sin());
        let now = seen(&flowing, tiles, 0.0, p, p);
        // Normals that are handed in do not matter once a flow knows its own.
        assert_eq!(now, seen(&flowing, tiles, 0.0, p, -Vec3::Y));
        differs += usize::from(now != seen(ball, tiles, 0.0, p, p));
    }
    assert!(differs > 5, "{differs} of 40");
}
