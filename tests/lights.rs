//! Lights in pictures: what is known of them, and ways to find them against each other.

#![allow(clippy::print_stdout, reason = "tests say what they measured")]

mod support;

use curlsmoke::geometry::embree::Ray;
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::space::{UnitVec3, WorldPoint};
use curlsmoke::render;
use curlsmoke::render::light::Light;
use curlsmoke::render::medium::Medium;
use glam::Vec3;
use std::f64::consts::PI;
use std::time::Instant;
use support::{Estimate, Stage, centered_grid, estimate, stage};

fn ray(origin: [f32; 3], direction: [f32; 3]) -> Ray {
    let direction = UnitVec3::try_new(Vec3::from(direction)).expect("not zero");
    Ray { origin: WorldPoint(Vec3::from(origin)), direction }
}

/// A scene with these sections, and smoke of some extinction that stands wherever a test puts it.
fn scene(sections: &str, extinction: f64, more: &str) -> Stage {
    stage(&format!(
        "
camera: {{position: [0, 0, 5], look_at: [0, 0, 0]}}
film: {{resolution: [32, 24], spp: 16}}
smoke: {{emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}], grid: {{voxel_size: 1}}, medium: {{extinction: {extinction}, {more}}}}}
{sections}
"
    ))
}

fn medium(stage: &Stage, density: fn(WorldPoint) -> f32) -> Medium {
    let grid = centered_grid([16, 16, 16], 0.125, density);
    render::build_medium(&stage.scene, grid).expect("not too dense").expect("the scene has smoke")
}

fn lumps(p: WorldPoint) -> f32 {
    let p = p.0 * 5.0;
    (0.6 + 0.4 * (p.x.sin() * p.y.cos() + (p.z + 0.3).sin() * 0.5)).clamp(0.0, 1.0)
}

fn check(name: &str, found: Estimate, expected: f64, rounding: f64) {
    println!("{name}: {:.6} ± {:.6}, expected {expected:.6}", found.mean, found.standard_error);
    let is_close = found.z(expected) < 3.3 || (found.mean - expected).abs() < rounding * expected;
    assert!(is_close, "{name}: {found:?}, expected {expected}");
}

fn same(name: &str, a: Estimate, b: Estimate) {
    println!("{name}: {:.6} ± {:.6}, {:.6} ± {:.6}", a.mean, a.standard_error, b.mean, b.standard_error);
    let z = (a.mean - b.mean).abs() / a.standard_error.hypot(b.standard_error);
    assert!(z < 3.3, "{name}: z {z}");
}

#[test]
fn a_wall_that_faces_a_sun_of_any_size_gets_its_irradiance() {
    for diameter in [0.0, 0.53, 20.0, 120.0] {
        let stage = stage(&format!(
            "
camera: {{position: [0, 2, 5], look_at: [0, 0, 0]}}
shapes: {{floor: {{plane: {{}}, material: {{diffuse: {{reflectance: [0.5, 0.5, 0.5]}}}}}}}}
lights: [{{sun: {{direction: [0, -1, 0], irradiance: [3, 3, 3], angular_diameter_deg: {diameter}}}}}]
"
        ));
        let found = estimate(&stage, None, 200_000, 1, |_| ray([0.0, 2.0, 5.0], [0.0, -2.0, -5.0]));
        check(&format!("sun of {diameter}°"), found, 0.5 * 3.0 / PI, 1e-4);
    }
}

#[test]
fn cameras_see_the_lights_that_are_visible() {
    let seen = |light: &str, direction: [f32; 3]| {
        let stage = stage(&format!("\ncamera: {{position: [0, 0, 5], look_at: [0, 0, 0]}}\nlights: [{light}]"));
        estimate(&stage, None, 4096, 1, |_| ray([0.0, 0.0, 5.0], direction)).mean
    };
    let sun = "direction: [0, 0, 1], irradiance: [1, 1, 1], angular_diameter_deg: 2";
    assert_eq!(seen(&format!("{{sun: {{{sun}}}}}"), [0.0, 0.0, -1.0]), 0.0);
    let radiance = 1.0 / (PI * 1f64.to_radians().sin().powi(2));
    let found = seen(&format!("{{sun: {{{sun}, visible: true}}}}"), [0.0, 0.01, -1.0]);
    assert!((found / radiance - 1.0).abs() < 1e-4, "{found} {radiance}");
    assert_eq!(seen(&format!("{{sun: {{{sun}, visible: true}}}}"), [0.0, 0.03, -1.0]), 0.0);
    let disk = "center: [0, 0, 0], radius: 0.5, radiance: [2, 2, 2]";
    let disk = |more: &str| seen(&format!("{{disk: {{{disk}, {more}}}}}"), [0.0, 0.05, -1.0]);
    assert_eq!([disk("normal: [0, 0, 1]"), disk("normal: [0, 0, -1]")], [2.0, 0.0]);
    assert_eq!(disk("normal: [0, 0, -1], two_sided: true"), 2.0);
    assert_eq!(disk("normal: [0, 0, 1], visible: false"), 0.0);
}

#[test]
fn glowing_shapes_give_the_same_light_whether_they_are_asked_or_met() {
    for (name, shape) in [
        ("ball", "sphere: {center: [0.9, 0.3, 0], radius: 0.3}"),
        ("box", "box: {center: [0.9, 0.3, 0], size: [0.5, 0.3, 0.6]}"),
        (
            "moved box",
            "box: {center: [0, 0, 0], size: [1, 1, 2]}\n    transform: {translate: [0.9, 0.2, 0], rotate_deg: {axis: [1, 1, 0], angle: 40}, scale: 0.3}",
        ),
        ("mesh", "mesh: {file: tests/invalid/tetrahedron.obj}\n    transform: {translate: [0.6, 0.1, 0], scale: 0.4}"),
    ] {
        let sections = format!(
            "
shapes:
  floor: {{plane: {{point: [0, -0.6, 0]}}}}
  lamp:
    {shape}
    material: {{diffuse: {{reflectance: [0.3, 0.3, 0.3], emission: [5, 5, 5]}}}}
"
        );
        let asked = scene(&sections, 1.5, "phase: {henyey_greenstein: {g: 0.4}}");
        assert!(matches!(asked.world.lights[..], [Light::Surface(_)]), "{name}");
        let mut met = scene(&sections, 1.5, "phase: {henyey_greenstein: {g: 0.4}}");
        let world = met.world;
        met.world = render::world::World::new(world.surfaces, world.materials, Vec::new());
        let medium = medium(&asked, lumps);
        let beam = |_| ray([0.2, 0.4, 5.0], [0.0, -0.1, -1.0]);
        let (a, b) =
            (estimate(&asked, Some(&medium), 16 * 4096, 1, beam), estimate(&met, Some(&medium), 48 * 4096, 2, beam));
        same(name, a, b);
    }
}

#[test]
fn a_room_that_glows_evenly_is_as_bright_as_its_echo() {
    // L = E + r L, with smoke that swallows nothing; the room is a light that is asked from inside.
    let stage = scene(
        "
render: {max_bounces: 100000}
shapes:
  room: {sphere: {center: [0, 0, 0], radius: 2}, material: {diffuse: {reflectance: [0.5, 0.5, 0.5], emission: [1, 1, 1]}}}
  crate: {box: {center: [0.5, -0.4, 0], size: [0.5, 0.5, 0.5]}, material: {diffuse: {reflectance: [0.5, 0.5, 0.5], emission: [1, 1, 1]}}}
",
        3.0,
        "albedo: [1, 1, 1]",
    );
    assert_eq!(stage.world.lights.len(), 2);
    let found =
        estimate(&stage, Some(&medium(&stage, lumps)), 200_000, 4, |_| ray([-0.9, 0.3, 0.2], [0.7, -0.2, -0.1]));
    check("glowing room", found, 2.0, 0.0);
}

/// Lamps at random places in and about the smoke.
fn lamps(count: usize) -> (String, Vec<(WorldPoint, f64)>) {
    let mut rng = CounterRng::new(Seed(21));
    let mut text = String::from("lights:\n");
    let mut lamps = Vec::new();
    for _ in 0..count {
        let p = Vec3::from([0; 3].map(|_| (rng.uniform() * 2.4 - 1.2) * 100.0)).round() * 0.01;
        let intensity = (rng.uniform() * 10.0).ceil() as f64 * 0.1;
        text += &format!(
            "  - point: {{position: [{}, {}, {}], intensity: [{intensity}, {intensity}, {intensity}]}}\n",
            p.x, p.y, p.z
        );
        lamps.push((WorldPoint(p), intensity));
    }
    (text, lamps)
}

/// Radiance along a beam of light scattered once in even directions, by the midpoint rule on a path parameter that is dense near
/// each lamp's foot.
fn single_scattering(medium: &Medium, beam: &Ray, lamps: &[(WorldPoint, f64)], lit: impl Fn(Vec3) -> f64) -> f64 {
    let density = |p: WorldPoint| f64::from(medium.grid().density(p) * medium.extinction());
    let depth = |from: WorldPoint, direction: Vec3, length: f64, n: usize| -> f64 {
        let at = |i: usize| from + direction * ((i as f64 + 0.5) / n as f64 * length) as f32;
        (0..n).map(|i| density(at(i))).sum::<f64>() * length / n as f64
    };
    let (start, end) = (3.5, 6.5);
    let mut radiance = 0.0;
    for (lamp, intensity) in lamps {
        let offset = *lamp - beam.origin;
        let foot = f64::from(offset.dot(*beam.direction));
        let near = f64::from(offset.cross(*beam.direction).length());
        let (a, b) = (((start - foot) / near).atan(), ((end - foot) / near).atan());
        const N: usize = 400;
        for i in 0..N {
            let angle = a + (b - a) * (i as f64 + 0.5) / N as f64;
            let t = foot + near * angle.tan();
            // dt over the square of the distance is dangle over the nearest.
            let p = beam.at(t as f32);
            let to_lamp = *lamp - p;
            let d = f64::from(to_lamp.length());
            let sigma = density(p);
            if sigma <= 0.0 {
                continue;
            }
            let transmittance = (-depth(beam.at(start as f32), *beam.direction, t - start, 200)
                - depth(p, to_lamp / d as f32, d, 200))
            .exp();
            radiance +=
                sigma * transmittance * intensity * lit(-to_lamp / d as f32) * (b - a) / (N as f64 * near) / (4.0 * PI);
        }
    }
    radiance
}

#[test]
fn lamps_in_smoke_give_what_quadrature_says() {
    let beam = ray([0.11, 0.07, 5.0], [0.01, 0.02, -1.0]);
    for (count, extinction) in [(1, 0.2), (1, 4.0), (3, 1.0), (64, 0.5)] {
        let (text, lamps) = lamps(count);
        let stage = scene(&format!("render: {{max_bounces: 1}}\n{text}"), extinction, "albedo: [1, 1, 1]");
        let medium = medium(&stage, lumps);
        let expected = single_scattering(&medium, &beam, &lamps, |_| 1.0);
        let found = estimate(&stage, Some(&medium), 200_000, 3, |_| beam);
        check(&format!("{count} lamps, extinction {extinction}"), found, expected, 2e-3);
    }
}

#[test]
fn a_spot_in_smoke_gives_what_quadrature_says() {
    let stage = scene(
        "
render: {max_bounces: 1}
lights: [{spot: {position: [0.2, 0.8, 0.1], direction: [0.1, -1, -0.2], intensity: [3, 3, 3], cone_deg: 40, blend: 0.5}}]
",
        0.7,
        "albedo: [1, 1, 1]",
    );
    let medium = medium(&stage, lumps);
    let beam = ray([0.3, 0.1, 5.0], [0.0, 0.01, -1.0]);
    let axis = Vec3::new(0.1, -1.0, -0.2).normalize();
    let lit = |direction: Vec3| {
        let x = ((20.0 - f64::from(direction.angle_between(axis)).to_degrees()) / 10.0).clamp(0.0, 1.0);
        x * x * (3.0 - 2.0 * x)
    };
    let expected = single_scattering(&medium, &beam, &[(WorldPoint::new(0.2, 0.8, 0.1), 3.0)], lit);
    check("spot", estimate(&stage, Some(&medium), 200_000, 3, |_| beam), expected, 2e-3);
}

/// With many scatterings, surfaces and lights of all kinds: distances taken for lamps change nothing but the noise.
#[test]
fn distances_for_lamps_keep_the_light_and_lower_the_noise() {
    let lights = [
        ("point", "{point: {position: [0.1, 0.2, 0], intensity: [1, 1, 1]}}"),
        ("ball", "{sphere: {center: [0.1, 0.2, 0], radius: 0.05, radiance: [80, 80, 80]}}"),
        ("large ball", "{sphere: {center: [0.1, 0.2, 0], radius: 0.4, radiance: [3, 3, 3]}}"),
        ("disk", "{disk: {center: [0.1, 0.6, 0], normal: [0, -1, 0], radius: 0.2, radiance: [10, 10, 10]}}"),
        (
            "rectangle",
            "{rectangle: {center: [0.1, 0.6, 0], half_u: [0.2, 0, 0], half_v: [0, 0, 0.2], radiance: [10, 10, 10], two_sided: true}}",
        ),
        ("spot", "{spot: {position: [0.1, 0.9, 0], direction: [0, -1, 0], intensity: [5, 5, 5]}}"),
        (
            "all",
            "{point: {position: [-0.4, 0.2, 0.3], intensity: [1, 1, 1]}}, {spot: {position: [0.1, 0.9, 0], direction: [0, -1, 0], intensity: [5, 5, 5]}}, {sun: {direction: [1, -1, 0], irradiance: [1, 1, 1], angular_diameter_deg: 5}}",
        ),
    ];
    for (name, lights) in lights {
        for extinction in if name == "all" { vec![0.3, 3.0] } else { vec![1.0] } {
            let sections = format!(
                "
render: {{max_bounces: 1000}}
shapes:
  floor: {{plane: {{point: [0, -0.6, 0]}}}}
  ball: {{sphere: {{center: [-0.5, 0, 0], radius: 0.3}}, material: {{diffuse: {{reflectance: [0.8, 0.8, 0.8]}}}}}}
lights: [{lights}]
"
            );
            let with = scene(&sections, extinction, "phase: {henyey_greenstein: {g: 0.3}}");
            let mut without = scene(&sections, extinction, "phase: {henyey_greenstein: {g: 0.3}}");
            without.world.forget_lamps();
            let medium = medium(&with, lumps);
            // Past the light, and on to the ball or the floor.
            let beam = |_| ray([0.2, 0.42, 5.0], [-0.03, -0.04, -1.0]);
            let time = |stage: &Stage, count: usize| {
                let start = Instant::now();
                (estimate(stage, Some(&medium), count, 5, beam), start.elapsed().as_secs_f64() / count as f64)
            };
            let ((a, time_a), (b, time_b)) = (time(&with, 1 << 16), time(&without, 1 << 16));
            println!("  {name}, extinction {extinction}: {:.2} µs, {:.2} µs a path", time_a * 1e6, time_b * 1e6);
            same(&format!("{name}, extinction {extinction}"), a, b);
        }
    }
}

/// Noise of single paths along one beam past a point light, with and without distances for it, and what they cost.
#[test]
fn thin_smoke_about_a_lamp_is_many_times_less_noisy() {
    for (extinction, near, gain) in [(0.05, 0.05, 30.0), (0.05, 0.3, 8.0), (0.5, 0.1, 4.0)] {
        let sections = format!("lights: [{{point: {{position: [0, {near}, 0], intensity: [1, 1, 1]}}}}]");
        let with = scene(&sections, extinction, "albedo: [0.9, 0.9, 0.9]");
        let mut without = scene(&sections, extinction, "albedo: [0.9, 0.9, 0.9]");
        without.world.forget_lamps();
        let medium = medium(&with, lumps);
        let beam = ray([0.0, 0.0, 5.0], [0.0, 0.0, -1.0]);
        let measure = |stage: &Stage| {
            let start = Instant::now();
            let found = estimate(stage, Some(&medium), 1 << 18, 5, |_| beam);
            (found, found.standard_error.powi(2), start.elapsed().as_secs_f64())
        };
        let ((a, var_a, time_a), (b, var_b, time_b)) = (measure(&with), measure(&without));
        println!(
            "extinction {extinction}, lamp at {near} m: variance {:.1} times less, time {:.2} times, efficiency {:.1}",
            var_b / var_a,
            time_a / time_b,
            var_b * time_b / (var_a * time_a)
        );
        same("point light in thin smoke", a, b);
        assert!(var_b > gain * var_a, "{}", var_b / var_a);
    }
}

/// Sky and sun as lights: a floor under them gets the irradiance that its picture and its sun have.
#[test]
fn a_floor_under_a_clear_sky_gets_all_of_it() {
    let text = "
camera: {position: [0, 2, 5], look_at: [0, 0, 0]}
shapes: {floor: {plane: {}, material: {diffuse: {reflectance: [0.5, 0.5, 0.5]}}}}
lights: [{environment: {sky: {sun_elevation_deg: 35, sun_azimuth_deg: 20, SUN}, rotate_deg: 50, scale: 0.001}}]
";
    let stage_of = |sun: &str| stage(&text.replace("SUN", sun));
    let sky_alone = stage_of("sun: false");
    let [Light::Environment(sky)] = &sky_alone.world.lights[..] else { panic!("a sky") };
    const N: usize = 600;
    let irradiance: f64 = (0..N * N)
        .map(|i| {
            let y = ((i / N) as f64 + 0.5) / N as f64;
            let (s, c) = (((i % N) as f64 + 0.5) / N as f64 * 2.0 * PI).sin_cos();
            let r = (1.0 - y * y).sqrt();
            let d = UnitVec3::try_new(Vec3::new((r * c) as f32, y as f32, (r * s) as f32)).expect("not zero");
            f64::from(sky.radiance(d).x) * y * 2.0 * PI / (N * N) as f64
        })
        .sum();
    let beam = ray([0.0, 2.0, 5.0], [0.0, -2.0, -5.0]);
    check("sky", estimate(&sky_alone, None, 200_000, 1, |_| beam), 0.5 / PI * irradiance, 1e-3);
    let both = stage_of("sun: true");
    let [_, Light::Sun(sun)] = &both.world.lights[..] else { panic!("a sky and a sun") };
    let of_sun = f64::from(sun.irradiance().x) * 35f64.to_radians().sin();
    check("sky and sun", estimate(&both, None, 200_000, 1, |_| beam), 0.5 / PI * (irradiance + of_sun), 1e-3);
    // The sun stands where the sky is brightest: azimuth 20° from −z towards +x, turned by 50° the other way about +y.
    let towards = sun.sample([0.0, 0.0]).direction;
    let ahead = (30f32.to_radians().sin(), 30f32.to_radians().cos());
    let expected = Vec3::new(-ahead.0, 35f32.to_radians().tan(), -ahead.1).normalize();
    assert!((*towards - expected).length() < 1e-2, "{towards:?} {expected}");
    let beside = UnitVec3::try_new(Vec3::new(ahead.0, expected.y, -ahead.1)).expect("not zero");
    assert!(sky.radiance(towards).y > 2.0 * sky.radiance(beside).y);
}
