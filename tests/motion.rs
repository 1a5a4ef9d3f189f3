//! The layer of motion: how far what a pixel shows is from where the next picture shows it.

#[allow(dead_code, reason = "what other tests share")]
mod support;

use curlsmoke::flow::{Flow, NoFiles};
use curlsmoke::geometry::Geometry;
use curlsmoke::grid::DensityGrid;
use curlsmoke::pipeline;
use curlsmoke::progress::Silent;
use curlsmoke::render::film::Film;
use curlsmoke::render::motion::FrameMotion;
use curlsmoke::render::{self, tiles};
use curlsmoke::scene::Scene;
use std::path::Path;
use support::{centered_grid, stage};

fn scene(yaml: &str) -> Scene {
    Scene::from_text(&format!("version: 1\n{yaml}"), Path::new("test.yaml")).unwrap_or_else(|e| panic!("{e}"))
}

fn film(scene: &Scene, frame: i32) -> Film {
    pipeline::film(scene, frame, None, &Silent).expect("renders")
}

/// The numbers of a channel.
fn channel(film: &Film, name: &str) -> Vec<f32> {
    let names: Vec<String> = film.layers.iter().flat_map(|layer| layer.channels()).collect();
    let at = names.iter().position(|known| known == name).unwrap_or_else(|| panic!("{name} among {names:?}"));
    film.layer_data.iter().skip(at).step_by(names.len()).copied().collect()
}

fn motion(film: &Film) -> Vec<[f32; 2]> {
    channel(film, "motion.X").into_iter().zip(channel(film, "motion.Y")).map(|(x, y)| [x, y]).collect()
}

/// A ball that goes 0.6 m to the right and 0.3 m up in a second, of 10 frames; 20 pixels a metre.
const BALL: &str = "
frames: {first: 1, last: 11, fps: 10}
camera: {position: [0, 0, 5], look_at: [0, 0, 0], projection: {orthographic: {height: 2}}}
film: {resolution: [64, 40], spp: 4, filter: {box: {radius: 0.5}}}
shapes:
  ball:
    sphere: {center: [-0.3, 0, 0], radius: 0.6}
    motion: {interpolation: linear, keys: [{time: 0, translate: [0, 0, 0]}, {time: 1, translate: [0.6, 0.3, 0]}]}
  wall: {box: {center: [1, 0, -1], size: [1, 4, 0.1]}}
lights: [{environment: {radiance: [1, 1, 1]}}]
output: {aovs: [shape_id, motion]}
";

#[test]
fn a_ball_that_moves_across_has_its_speed_and_all_that_rests_has_none() {
    for frame in [1, 4] {
        let film = film(&scene(BALL), frame);
        let (shapes, mut seen) = (channel(&film, "shape_id"), 0);
        for ([x, y], shape) in motion(&film).into_iter().zip(shapes) {
            // Of pixels at its rim, only the paths that met it count; beside it is the background, behind it the wall.
            let is_at_rest = x == 0.0 && y == 0.0;
            let is_moved = (x - 1.2).abs() < 1e-4 && (y + 0.6).abs() < 1e-4;
            let is_mixed = x > 0.0 && x < 1.2 && (y + 0.5 * x).abs() < 1e-4;
            assert!(is_at_rest || is_moved || is_mixed, "{x} {y}");
            assert!(shape != 1.0 || !is_at_rest, "the ball moves");
            seen += usize::from(is_moved);
        }
        assert!(seen > 400, "{seen}");
    }
    let last = motion(&film(&scene(BALL), 11));
    assert!(last.iter().all(|v| *v == [0.0; 2]), "after the last key nothing moves");
}

#[test]
fn points_of_a_ball_that_grows_go_outwards() {
    let growing = BALL.replace("[-0.3, 0, 0]", "[0, 0, 0]").replace(
        "motion: {interpolation: linear, keys: [{time: 0, translate: [0, 0, 0]}, {time: 1, translate: [0.6, 0.3, 0]}]}",
        "transform: {scale: {1: 1, 3: 1.5, interpolation: linear}}",
    );
    let (film, mut seen) = (film(&scene(&growing), 1), 0);
    let shapes = channel(&film, "shape_id");
    for (i, ([x, y], shape)) in motion(&film).into_iter().zip(shapes).enumerate() {
        let [u, v] = [(i % 64) as f32 - 31.5, (i / 64) as f32 - 19.5];
        if shape != 1.0 || u.hypot(v) > 10.0 {
            continue;
        }
        // A quarter larger by the next frame; places within a pixel differ by half of one.
        assert!((x - 0.25 * u).abs() < 0.13 && (y - 0.25 * v).abs() < 0.13, "{u} {v}: {x} {y}");
        seen += 1;
    }
    assert!(seen > 250, "{seen}");
}

/// Smoke in a wind of 0.5 m/s to the left and 0.25 m/s down, 10 frames a second and 16 pixels a metre.
const WIND: &str = "
frames: {first: 1, last: 11, fps: 10}
camera: {position: [0, 0, 5], look_at: [0, 0, 0], projection: {orthographic: {height: 2}}}
film: {resolution: [32, 32], spp: 16, filter: {box: {radius: 0.5}}}
flow: {potentials: [{uniform: {velocity: [-0.5, -0.25, 0.1]}}]}
smoke:
  emitters: [{sphere: {center: [0, 0, 0], radius: 0.3}, count: 3000, lifetime: 5, mass: 0.1}]
  grid: {voxel_size: 0.1}
  medium: {extinction: 10}
lights: [{environment: {radiance: [1, 1, 1]}}]
output: {aovs: [motion]}
";

#[test]
fn smoke_goes_with_the_flow() {
    let film = film(&scene(WIND), 3);
    let mut seen = 0;
    for [x, y] in motion(&film) {
        let is_moved = (x + 0.8).abs() < 1e-4 && (y - 0.4).abs() < 1e-4;
        assert!(is_moved || (x == 0.0 && y == 0.0), "{x} {y}");
        seen += usize::from(is_moved);
    }
    assert!(seen > 50, "{seen}");
}

#[test]
fn smoke_in_a_whirl_goes_where_its_particles_go() {
    // An eighth of a turn in a frame: far from a straight line.
    let turn = std::f64::consts::FRAC_PI_4;
    let yaml = WIND.replace("{uniform: {velocity: [-0.5, -0.25, 0.1]}}", "{rigid: {angular_velocity: [0, 0, SPIN]}}");
    let stage = stage(&yaml.replace("SPIN", &format!("{}", turn * 10.0)));
    let geometry = Geometry::build(&stage.scene, &Silent).unwrap();
    let flow = Flow::build(&stage.scene, &geometry, &NoFiles).unwrap();
    let grid: DensityGrid = centered_grid([8, 8, 2], 0.2, |_| 1.0);
    let medium = render::build_medium(&stage.scene, grid).unwrap().unwrap();
    let motion_of_frame = FrameMotion::new(&geometry, Some(flow.span(0.0, 0.1)), 0.0, 0.1);
    let view = render::build_view(&stage.scene, 1, None);
    let moving =
        tiles::render_media(&view, &stage.world, Some(&medium).into(), Some(&motion_of_frame), &Silent).unwrap();
    let still = tiles::render(&view, &stage.world, Some(&medium), &Silent).unwrap();
    assert!(motion(&still).iter().all(|v| *v == [0.0; 2]));
    assert_eq!(moving.pixels, still.pixels, "to ask for motion changes no light");
    let mut resting = medium;
    resting.matter.is_carried = false;
    let film =
        tiles::render_media(&view, &stage.world, Some(&resting).into(), Some(&motion_of_frame), &Silent).unwrap();
    assert!(motion(&film).iter().all(|v| *v == [0.0; 2]), "the flow carries smoke and no other volume");
    let (mut worst, mut longest) = (0.0f32, 0.0f32);
    for (i, [x, y]) in motion(&moving).into_iter().enumerate().filter(|(_, v)| *v != [0.0; 2]) {
        let [u, v] = [i % 32, i / 32].map(|at| at as f32 + 0.5 - 16.0);
        // Counterclockwise, of a y that goes down.
        let (sin, cos) = (turn as f32).sin_cos();
        let expected = [u * cos + v * sin - u, v * cos - u * sin - v];
        worst = worst.max((x - expected[0]).abs()).max((y - expected[1]).abs());
        longest = longest.max(x.hypot(y));
    }
    // Places within a pixel differ by up to half of one, and a step of Runge and Kutta is off by a quarter of a per cent. A
    // straight line would be off by five pixels.
    println!("off by {worst:.2} of at most {longest:.1} pixels");
    assert!(worst < 0.6 && longest > 8.0, "{worst} {longest}");
}

/// A ball with a pattern, which shines and so looks the same from everywhere, and which turns while it comes nearer.
const MARBLE: &str = "
frames: {first: 1, last: 3, fps: 2}
camera: {position: [0.4, 0.3, 4], look_at: [0, 0, 0]}
film: {resolution: [96, 72], spp: 16, filter: {box: {radius: 0.5}}}
shapes:
  ball:
    sphere: {center: [0, 0, 0], radius: 1}
    material: {diffuse: {reflectance: [0, 0, 0], emission: {stripes: {along: [3, 1, 0.5], colors: [[0.2, 0.2, 0.2], [1, 1, 1]]}}}}
    motion: {keys: [{time: 0}, {time: 1, translate: [0.3, -0.2, 0.5], rotate_deg: {axis: [0.2, 1, 0.3], angle: 40}}]}
output: {aovs: [shape_id, motion]}
";

#[test]
fn a_picture_moved_by_its_vectors_is_the_next_picture() {
    let scene = scene(MARBLE);
    let [now, next] = [1, 2].map(|frame| film(&scene, frame));
    let (vectors, shapes) = (motion(&now), channel(&now, "shape_id"));
    let value = |film: &Film, x: f32, y: f32| -> Option<f32> {
        let (u, v) = (x - 0.5, y - 0.5);
        let (i, j) = (u.floor(), v.floor());
        (i >= 0.0 && j >= 0.0 && i < 95.0 && j < 71.0).then(|| {
            let at = |dx: usize, dy: usize| film.pixels[(j as usize + dy) * 96 + i as usize + dx].mean.x;
            let (s, t) = (u - i, v - j);
            (at(0, 0) * (1.0 - s) + at(1, 0) * s) * (1.0 - t) + (at(0, 1) * (1.0 - s) + at(1, 1) * s) * t
        })
    };
    // The next picture read where each pixel has gone, against this one; and with vectors that say nothing, or the wrong way.
    let error = |factor: f32| {
        let (mut sum, mut count) = (0.0, 0.0);
        for (i, ([x, y], shape)) in vectors.iter().zip(&shapes).enumerate() {
            let (u, v) = ((i % 96) as f32 + 0.5, (i / 96) as f32 + 0.5);
            let is_well_inside = ((u - 48.0).powi(2) + (v - 36.0).powi(2)).sqrt() < 20.0;
            if *shape == 1.0
                && is_well_inside
                && let Some(found) = value(&next, u + factor * x, v + factor * y)
            {
                sum += (found - now.pixels[i].mean.x).powi(2);
                count += 1.0;
            }
        }
        assert!(count > 1000.0);
        (sum / count).sqrt()
    };
    let (moved, unmoved, backwards) = (error(1.0), error(0.0), error(-1.0));
    println!(
        "moved by the vectors it is off by {moved:.3}, unmoved by {unmoved:.3}, moved backwards by {backwards:.3}"
    );
    assert!(moved < 0.25 * unmoved && moved < 0.25 * backwards);
}
