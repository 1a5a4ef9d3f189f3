//! Volumes that overlap, and even matter inside shapes, with known answers.

#[allow(dead_code)]
mod support;

use curlsmoke::geometry::Geometry;
use curlsmoke::geometry::embree::Ray;
use curlsmoke::grid::{DensityGrid, vdb};
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::space::{UnitVec3, WorldPoint};
use curlsmoke::pipeline::{self, FrameOutcome, RenderJob};
use curlsmoke::progress::Silent;
use curlsmoke::render;
use curlsmoke::render::even::EvenMedium;
use curlsmoke::render::media::{Media, Volume};
use curlsmoke::render::sampler::Stream;
use curlsmoke::render::sun_shadow::Shadows;
use curlsmoke::scene::Scene;
use glam::{DVec3, Vec3};
use std::collections::HashMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use support::{Estimate, Stage, centered_grid, estimate_colors, stage};

const CAMERA: &str = "
camera: {position: [0, 0, 5], look_at: [0, 0, 0]}
film: {resolution: [16, 12], spp: 16}
render: {max_bounces: 100000}
";

const SKY: &str = "lights: [{environment: {radiance: [1, 1, 1]}}]";

/// A scene with shapes and volumes, and all of its volumes that are inside shapes.
fn filled(text: &str) -> (Stage, Vec<Volume>) {
    let stage = stage(&format!("{CAMERA}{text}"));
    let geometry = Geometry::build(&stage.scene, &Silent).unwrap();
    let even = stage.scene.settings.volumes.values().map(|volume| {
        let container = geometry.container(volume.inside.as_ref().unwrap()).unwrap().expect("it has an inside");
        Volume::Even(render::even_medium(volume, Arc::new(container)).unwrap())
    });
    let volumes = even.collect();
    (stage, volumes)
}

fn even(volumes: &[Volume]) -> &EvenMedium {
    let Volume::Even(medium) = &volumes[0] else { panic!("it is even") };
    medium
}

fn grid_volume(medium: &str, grid: DensityGrid) -> Volume {
    let scene = scene(&format!(
        "{CAMERA}{SKY}\nshapes: {{a: {{sphere: {{center: [0, 0, 0], radius: 1}}}}}}\nvolumes: {{a: {{inside: a, medium: {{{medium}}}}}}}"
    ));
    Volume::Grid(Box::new(render::grid_medium(&scene.settings.volumes["a"].medium, grid).unwrap()))
}

fn ray(origin: [f32; 3], direction: [f32; 3]) -> Ray {
    let direction = UnitVec3::try_new(Vec3::from(direction)).expect("not zero");
    Ray { origin: WorldPoint(Vec3::from(origin)), direction }
}

fn random_rays(count: usize) -> Vec<Ray> {
    let mut rng = CounterRng::new(Seed(11));
    let mut point = move |scale: f32| [0; 3].map(|_| (2.0 * rng.uniform() - 1.0) * scale);
    (0..count).map(|_| ray(point(2.0), point(1.0))).collect()
}

fn lumps(p: WorldPoint) -> f32 {
    let p = p.0 * 5.0;
    (0.5 + 0.5 * (p.x.sin() * p.y.cos() + (p.z + 0.3).sin() * 0.5)).clamp(0.0, 1.0)
}

fn assert_equal(found: Estimate, expected: Estimate, what: &str) {
    let error = found.standard_error.hypot(expected.standard_error);
    assert!((found.mean - expected.mean).abs() < 4.0 * error + 1e-6, "{what}: {found:?} {expected:?}");
}

fn assert_is(found: Estimate, expected: f64, what: &str) {
    assert_equal(found, Estimate { mean: expected, standard_error: 0.0 }, what);
}

/// The surface of a ball about the origin as triangles: an octahedron whose faces were cut in four `levels` times.
fn ball_of_triangles(radius: f64, levels: u32) -> PathBuf {
    let mut points: Vec<DVec3> = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|p| [p, -p]).collect();
    let mut faces = vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    for _ in 0..levels {
        let mut middles = HashMap::new();
        let mut middle = |a: usize, b: usize| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a] + points[b]).normalize());
                points.len() - 1
            })
        };
        let cut = faces.iter().flat_map(|&[a, b, c]| {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        });
        faces = cut.collect();
    }
    let mut text = String::new();
    for p in points {
        let p = p * radius;
        writeln!(text, "v {} {} {}", p.x, p.y, p.z).unwrap();
    }
    for [a, b, c] in faces {
        writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1).unwrap();
    }
    let path = folder().join(format!("ball-{levels}.obj"));
    std::fs::write(&path, text).unwrap();
    path
}

fn folder() -> PathBuf {
    let folder = std::env::temp_dir().join(format!("curlsmoke-volumes-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

const SHAPES: [&str; 6] = [
    "sphere: {center: [0.1, 0, 0.2], radius: 0.9}",
    "box: {center: [0, 0.1, 0], size: [1.2, 0.8, 1.5]}",
    "box: {center: [0, 0.1, 0], size: [1.2, 0.8, 1.5], rounding: 0.2}",
    "capsule: {start: [-0.5, 0, 0], end: [0.4, 0.6, 0.1], radius: 0.4}",
    "torus: {center: [0, 0, 0], axis: [0.2, 1, 0], major_radius: 0.8, minor_radius: 0.25}",
    "smooth_union: {width: 0.4, parts: [{sphere: {center: [-0.6, 0, 0], radius: 0.4}}, {sphere: {center: [0.6, 0, 0], radius: 0.4}}]}",
];

#[test]
fn rays_are_inside_where_the_distance_is_negative() {
    for shape in SHAPES {
        let text = format!("{SKY}\nshapes: {{it: {{{shape}, visible: false}}}}\nvolumes: {{mist: {{inside: it}}}}");
        let (stage, volumes) = filled(&text);
        let geometry = Geometry::build(&stage.scene, &Silent).unwrap();
        let sdf = geometry.shapes[0].sdf.clone().unwrap();
        for ray in random_rays(300) {
            const STEPS: usize = 2000;
            let dt = 5.0 / STEPS as f64;
            let is_inside = |i: usize| {
                let t = (i as f64 + 0.5) * dt;
                let p = ray.origin.0.as_dvec3() + ray.direction.as_vec3().as_dvec3() * t;
                sdf.distance(p.to_array()) < 0.0
            };
            let expected = (0..STEPS).filter(|&i| is_inside(i)).count() as f64 * dt;
            let found = even(&volumes).length_inside(&ray, 5.0);
            assert!((found - expected).abs() < 2.5 * dt, "{shape}, {ray:?}: {found}, expected {expected}");
            // And the same in two parts.
            let (before, after) = (even(&volumes).length_inside(&ray, 1.3), ray.at(1.3));
            let rest = Ray { origin: after, direction: ray.direction };
            let parts = before + even(&volumes).length_inside(&rest, 3.7);
            assert!((parts - found).abs() < 1e-4, "{shape}, {ray:?}: {parts} {found}");
        }
    }
}

#[test]
fn a_ball_dims_light_by_the_law_of_its_chord() {
    let text = |shape: &str| {
        format!(
            "{SKY}\nshapes: {{ball: {{{shape}, visible: false}}}}\n\
             volumes: {{mist: {{inside: ball, density: 0.5, medium: {{extinction: 3, albedo: [0, 0, 0], extinction_tint: [1, 0.5, 0]}}}}}}"
        )
    };
    let (stage, volumes) = filled(&text("sphere: {center: [0, 0, 0], radius: 1}"));
    let mesh = ball_of_triangles(1.0, 6);
    let (_, of_triangles) = filled(&text(&format!("mesh: {{file: {}}}", mesh.display())));
    for height in [0.0, 0.6, 0.99, 1.01] {
        let beam = ray([0.0, height, 5.0], [0.0, 0.0, -1.0]);
        let chord = 2.0 * f64::from((1.0 - height * height).max(0.0).sqrt());
        let expected = [1.0, 0.5, 0.0].map(|ratio| (-1.5 * ratio * chord).exp());
        let mut stream = Stream::new(Seed(1));
        let exact = Media::new(None, &volumes).transmittance(&beam, 100.0, Shadows::NONE, &mut stream);
        let by_mesh = Media::new(None, &of_triangles).transmittance(&beam, 100.0, Shadows::NONE, &mut stream);
        let found = estimate_colors(&stage, Media::new(None, &volumes), 50_000, 3, |_| beam);
        for i in 0..3 {
            assert!((f64::from(exact[i]) - expected[i]).abs() < 3e-6, "{exact} {expected:?}");
            assert!((f64::from(by_mesh[i]) - expected[i]).abs() < 3e-3, "{by_mesh} {expected:?}");
            assert_is(found[i], expected[i], &format!("chord {chord}, channel {i}"));
        }
        // Half of the way, to the middle of the ball.
        let half = Media::new(None, &volumes).transmittance(&beam, 5.0, Shadows::NONE, &mut stream);
        assert!((f64::from(half.x) - (-0.75 * chord).exp()).abs() < 3e-6);
    }
}

#[test]
fn parts_of_a_mesh_that_overlap_hold_what_one_of_them_holds() {
    // Two balls that overlap, and a third apart, within reach of one ray.
    let one = std::fs::read_to_string(ball_of_triangles(1.0, 3)).unwrap();
    let count = one.lines().filter(|line| line.starts_with('v')).count();
    let mut text = String::new();
    for (part, x) in [0.0, 1.2, 4.0].into_iter().enumerate() {
        for line in one.lines() {
            let numbers = || line[2..].split(' ').map(|n| n.parse::<f64>().unwrap());
            if line.starts_with('v') {
                let p: Vec<f64> = numbers().collect();
                writeln!(text, "v {} {} {}", p[0] + x, p[1], p[2]).unwrap();
            } else {
                let f: Vec<f64> = numbers().map(|i| i + (part * count) as f64).collect();
                writeln!(text, "f {} {} {}", f[0], f[1], f[2]).unwrap();
            }
        }
    }
    let path = folder().join("three_balls.obj");
    std::fs::write(&path, text).unwrap();
    let (_, volumes) = filled(&format!(
        "{SKY}\nshapes: {{ball: {{mesh: {{file: {}}}, visible: false}}}}\nvolumes: {{mist: {{inside: ball}}}}",
        path.display()
    ));
    // Along the x axis, a little beside the vertices.
    for (from, expected) in [(-5.0, 5.2), (-0.5, 4.7), (0.8, 3.4), (1.5, 2.7), (2.5, 2.0), (4.5, 0.5), (6.0, 0.0)] {
        let found = even(&volumes).length_inside(&ray([from, 0.003, 0.002], [1.0, 0.0, 0.0]), f32::INFINITY);
        assert!((found - expected).abs() < 0.02, "from {from}: {found}, expected {expected}");
        let back = even(&volumes).length_inside(&ray([10.0, 0.003, 0.002], [-1.0, 0.0, 0.0]), 10.0 - from);
        assert!((back - found).abs() < 1e-4, "from {from}: {found}, the other way {back}");
    }
}

#[test]
fn a_ray_that_starts_on_the_surface_is_inside_at_once() {
    for shape in SHAPES {
        let (_, volumes) =
            filled(&format!("{SKY}\nshapes: {{a: {{{shape}, visible: false}}}}\nvolumes: {{a: {{inside: a}}}}"));
        let rays = [0.11, 0.62].map(|x| ray([x, 0.07, 5.0], [0.0, 0.0, -1.0]));
        let first = |through: Ray| even(&volumes).pieces(&through, 10.0).next().map(|piece| (through, piece));
        let Some((through, [start, end])) = rays.into_iter().find_map(first) else { panic!("{shape}: missed") };
        for from in [start * 0.999_999, start, start * 1.000_001] {
            let inner = Ray { origin: through.at(from), direction: through.direction };
            let found = even(&volumes).pieces(&inner, 10.0).next().map_or(0.0, |[a, b]| b - a);
            assert!((found - (end - start)).abs() < 1e-4, "{shape}: {found} of {}", end - start);
        }
    }
    let (_, box_volume) = filled(&format!(
        "{SKY}\nshapes: {{a: {{box: {{center: [0, 0, 0], size: [2, 2, 2]}}, visible: false}}}}\nvolumes: {{a: {{inside: a}}}}"
    ));
    let found = even(&box_volume).length_inside(&ray([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]), 10.0);
    assert!((found - 2.0).abs() < 1e-5, "{found}");
}

#[test]
fn two_halves_are_a_whole() {
    // Copies that overlap, each of half the extinction: light from all around and from a lamp amid the smoke.
    for (tint, lamp) in [
        ("[1, 1, 1]", "{point: {position: [0.3, 0.1, 0.2], intensity: [1, 1, 1]}}"),
        ("[0.3, 1, 0.7]", "{sun: {direction: [1, -1, 0], irradiance: [3, 3, 3]}}"),
    ] {
        let text = format!("lights: [{{environment: {{radiance: [1, 0.5, 0.2]}}}}, {lamp}]");
        let stage = stage(&format!("{CAMERA}{text}"));
        let grid = || centered_grid([16, 16, 16], 0.1, lumps);
        let medium = |extinction: f64, emission: f64| {
            format!(
                "extinction: {extinction}, extinction_tint: {tint}, albedo: [0.9, 0.8, 0.7], phase: {{henyey_greenstein: {{g: 0.5}}}}, emission: [{emission}, 0, 0]"
            )
        };
        let whole = [grid_volume(&medium(4.0, 0.4), grid())];
        let halves = [grid_volume(&medium(2.0, 0.3), grid()), grid_volume(&medium(2.0, 0.1), grid())];
        let Volume::Grid(smoke) = &whole[0] else { panic!() };
        let beam = ray([0.11, 0.07, 5.0], [0.02, 0.01, -1.0]);
        let expected = estimate_colors(&stage, Some(&**smoke).into(), 200_000, 1, |_| beam);
        let found = estimate_colors(&stage, Media::new(None, &halves), 200_000, 2, |_| beam);
        for i in 0..3 {
            assert_equal(found[i], expected[i], &format!("tint {tint}, channel {i}"));
        }
        let [a, b] =
            [Media::from(Some(&**smoke)), Media::new(None, &halves)].map(|m| m.view_through(&beam, 10.0).unwrap());
        for (a, b) in [(a.first, b.first), (a.mean, b.mean), (a.half, b.half), (a.transmittance, b.transmittance)] {
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
        let [a, b] = [Media::from(Some(&**smoke)), Media::new(None, &halves)].map(|m| m.flight_density(&beam, 5.1));
        assert!((a / b - 1.0).abs() < 1e-4, "{a} {b}");
    }
}

#[test]
fn lamps_near_flights_light_overlapping_volumes_right() {
    // Distances taken for a lamp are another way to the same light: without them, the mean is the same.
    let text = "
lights: [{point: {position: [0.2, 0.4, 0], intensity: [1, 1, 1]}}]
shapes: {ball: {sphere: {center: [0, 0, 0], radius: 0.7}, visible: false}}
volumes: {mist: {inside: ball, medium: {extinction: 0.8, albedo: [1, 1, 1], phase: {henyey_greenstein: {g: 0.6}}}}}
";
    let (mut stage, mut volumes) = filled(text);
    volumes.push(grid_volume("extinction: 1.5, albedo: [0.4, 0.5, 0.6]", centered_grid([16, 16, 16], 0.1, lumps)));
    let beam = |_| ray([0.11, 0.07, 5.0], [0.0, 0.01, -1.0]);
    let found = estimate_colors(&stage, Media::new(None, &volumes), 100_000, 1, beam);
    stage.world.forget_lamps();
    let expected = estimate_colors(&stage, Media::new(None, &volumes), 400_000, 2, beam);
    for i in 0..3 {
        assert_equal(found[i], expected[i], &format!("channel {i}"));
        assert!(
            found[i].standard_error < 2.0 * expected[i].standard_error,
            "they are for less noise, with a quarter of the paths"
        );
    }
}

#[test]
fn white_volumes_vanish_in_white_light() {
    let mesh = ball_of_triangles(0.8, 3);
    for surface in ["visible: false", "material: {dielectric: {ior: 1.4}}"] {
        let text = format!(
            "{SKY}
shapes: {{ball: {{mesh: {{file: {}}}, {surface}}}}}
volumes: {{mist: {{inside: ball, medium: {{extinction: 2, albedo: [1, 1, 1], phase: {{henyey_greenstein: {{g: 0.8}}}}}}}}}}",
            mesh.display()
        );
        let (stage, mut volumes) = filled(&text);
        let white =
            "extinction: 3, albedo: [1, 1, 1], extinction_tint: [1, 0.6, 0.2], phase: {henyey_greenstein: {g: -0.3}}";
        volumes.push(grid_volume(white, centered_grid([16, 16, 16], 0.1, lumps)));
        // From outside, at a grazing angle, and from within both.
        for beam in [
            ray([0.1, 0.2, 5.0], [0.0, 0.0, -1.0]),
            ray([0.1, 0.796, 5.0], [0.0, 0.0, -1.0]),
            ray([0.1, 0.2, 0.3], [0.3, 0.2, -1.0]),
        ] {
            let found = estimate_colors(&stage, Media::new(None, &volumes), 40_000, 5, |_| beam);
            // Within glass radiance is larger by the square of its index of refraction.
            let is_in_glass = surface.contains("dielectric") && beam.origin.0.z < 1.0;
            let expected = if is_in_glass { 1.4 * 1.4 } else { 1.0 };
            for (i, found) in found.into_iter().enumerate() {
                assert_is(found, expected, &format!("{surface}, {beam:?}, channel {i}"));
            }
        }
    }
}

#[test]
fn what_glows_inside_of_a_shape_has_its_closed_form() {
    let text = "
shapes: {ball: {box: {center: [0, 0, 0], size: [2, 2, 2]}, visible: false}}
volumes: {mist: {inside: ball, medium: {extinction: 1.5, albedo: [0, 0, 0], emission: [3, 2, 0]}}}
";
    let (stage, volumes) = filled(text);
    let beam = ray([0.1, 0.2, 5.0], [0.0, 0.0, -1.0]);
    let found = estimate_colors(&stage, Media::new(None, &volumes), 100_000, 5, |_| beam);
    let expected = (1.0 - (-3.0f64).exp()) / 1.5;
    assert_is(found[0], 3.0 * expected, "red");
    assert_is(found[1], 2.0 * expected, "green");
    assert_eq!(found[2].mean, 0.0);
}

fn scene(text: &str) -> Scene {
    Scene::from_text(&format!("version: 1\n{text}"), &folder().join("test.yaml")).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn containers_move_and_layers_see_what_is_in_them() {
    let scene = scene(
        "
frames: {first: 1, last: 3, fps: 1}
camera: {position: [0, 0, 5], look_at: [0, 0, 0], projection: {orthographic: {height: 2}}}
film: {resolution: [4, 2], spp: 4}
lights: [{environment: {radiance: [1, 1, 1]}}]
shapes:
  room:
    box: {center: [0, 0, 0], size: [1, 3, 1]}
    visible: false
    motion: {keys: [{time: 0, translate: [-1.5, 0, 0]}, {time: 1, translate: [1.5, 0, 0]}], interpolation: linear}
volumes:
  mist: {inside: room, medium: {extinction: 2, albedo: [0, 0, 0]}}
output: {aovs: [transmittance, volume_depth]}
",
    );
    // Pixels of 1 m, so that the box fills one of a row.
    let through = (-2.0f32).exp();
    let expected = [through, 4.5, 4.5 + 0.5 - through / (1.0 - through), 4.5 + 0.5 * 2.0f32.ln()];
    for (frame, pixel) in [(1, 0), (2, 3)] {
        let film = pipeline::film(&scene, frame, None, &Silent).unwrap();
        for i in 0..4 {
            let found = &film.layer_data[4 * i..4 * i + 4];
            let expected = if i == pixel { expected } else { [1.0, f32::INFINITY, f32::INFINITY, f32::INFINITY] };
            for (found, expected) in found.iter().zip(expected) {
                assert!(*found == expected || (found - expected).abs() < 2e-3, "frame {frame}, pixel {i}: {film:?}");
            }
        }
    }
}

#[test]
fn files_are_volumes_too_and_belong_to_a_frame() {
    let grid = centered_grid([8, 8, 8], 0.2, |_| 1.0);
    let write = |name: &str, grid: &DensityGrid| {
        let bytes = vdb::write_float_grids(&[("density", grid)], vdb::VdbWriteSettings::default());
        std::fs::write(folder().join(name), bytes).unwrap();
    };
    write("cube.vdb", &grid);
    write("other.vdb", &grid);
    let text = |what: &str| {
        format!(
            "
camera: {{position: [0, 0, 5], look_at: [0, 0, 0]}}
film: {{resolution: [3, 3], spp: 4}}
lights: [{{environment: {{radiance: [1, 1, 1]}}}}]
output: {{image: {}/out.exr, aovs: [transmittance]}}
{what}
",
            folder().display()
        )
    };
    let transmittance = |scene: &Scene| pipeline::film(scene, 1, None, &Silent).unwrap().layer_data[4];
    let alone = transmittance(&scene(&text("smoke: {file: {path: cube.vdb}, medium: {extinction: 1}}")));
    let mixed = scene(&text(
        "smoke: {file: {path: cube.vdb}, medium: {extinction: 0.4}}\nvolumes: {a: {file: {path: other.vdb}, medium: {extinction: 0.6}}}",
    ));
    let both = transmittance(&mixed);
    assert!(alone < 0.5 && (alone - both).abs() < 1e-5, "{alone} {both}");
    // A frame is made again when the file of a volume changes.
    let job = RenderJob { frames: vec![1], resume: true, ..RenderJob::default() };
    let made = || {
        let mut made = false;
        pipeline::render(&mixed, &job, &Silent, &mut |outcome| made = matches!(outcome, FrameOutcome::Made { .. }))
            .unwrap();
        made
    };
    assert_eq!([made(), made()], [true, false]);
    write("other.vdb", &centered_grid([8, 8, 8], 0.2, |_| 0.5));
    assert_eq!([made(), made()], [true, false]);
}

#[test]
fn a_mesh_with_holes_holds_nothing() {
    let path = folder().join("open.obj");
    std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let scene = scene(&format!(
        "{}{SKY}\nshapes: {{tent: {{mesh: {{file: open.obj}}}}}}\nvolumes: {{mist: {{inside: tent}}}}",
        CAMERA
    ));
    let error = pipeline::check(&scene).expect_err("nothing is inside").to_string();
    assert!(error.contains("not closed") && error.contains(":"), "{error}");
    assert!(Path::new(&path).exists());
}
