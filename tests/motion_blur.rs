//! What moves while the shutter is open: pictures are means over instants, smoke goes its true way, walls move as they are keyed.

use curlsmoke::flow::field::VelocityField;
use curlsmoke::flow::source::{Potential, Source};
use curlsmoke::flow::{Flow, NoFiles};
use curlsmoke::geometry::Geometry;
use curlsmoke::grid::DensityGrid;
use curlsmoke::grid::splat::{SplatInput, SplatSettings, splat};
use curlsmoke::particles::ParticleSystem;
use curlsmoke::particles::emit::{Emitter, Place, Schedule};
use curlsmoke::particles::system::{KernelSize, TimeGrid};
use curlsmoke::particles::{Particles, advect::CLASSICAL};
use curlsmoke::pipeline::{self, RenderJob};
use curlsmoke::progress::Silent;
use curlsmoke::render::film::Film;
use curlsmoke::scene::Scene;
use glam::{DVec3, IVec3};
use std::path::Path;

fn scene_with(yaml: &str, overrides: &[(&str, String)]) -> Scene {
    let overrides: Vec<_> = overrides.iter().map(|(key, value)| (key.to_string(), value.clone())).collect();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/test.yaml");
    Scene::from_text_with(&format!("version: 1\n{yaml}"), &path, &overrides).unwrap_or_else(|e| panic!("{e}"))
}

fn film(scene: &Scene, frame: i32) -> Film {
    pipeline::film(scene, frame, None, &Silent).unwrap_or_else(|e| panic!("{e}"))
}

/// Means and variances of the red of all pixels.
type Picture = Vec<[f64; 2]>;

fn picture(film: &Film) -> Picture {
    film.pixels.iter().map(|p| [f64::from(p.mean.x), f64::from(p.variance.x)]).collect()
}

/// Mean square of the differences of two pictures in standard errors, over the pixels of both that have noise.
fn mean_square_z(a: &Picture, b: &Picture) -> f64 {
    // Rounding, and instants that are not all instants.
    const FLOOR: f64 = 2e-6;
    let z_sq = a.iter().zip(b).map(|(a, b)| (a[0] - b[0]).powi(2) / (a[1] + b[1] + FLOOR));
    let z_sq: Vec<f64> = z_sq.zip(a).filter(|(_, a)| a[1] > 3e-6).map(|(z, _)| z).collect();
    assert!(z_sq.len() > 40, "only {} pixels are blurred", z_sq.len());
    z_sq.iter().sum::<f64>() / z_sq.len() as f64
}

const INSTANTS: usize = 48;

/// The blurred picture of frame 3, the mean of pictures at instants of its shutter, and the picture at the frame's own time.
fn blurred_and_instants(yaml: &str, fps: f64, shutter: [f64; 2]) -> [Picture; 3] {
    let at = |shutter: [f64; 2], spp: usize, seed: usize| {
        let text = |value: [f64; 2]| format!("[{}, {}]", value[0], value[1]);
        let scene = scene_with(
            yaml,
            &[
                ("frames.fps", fps.to_string()),
                ("frames.shutter", text(shutter)),
                ("film.spp", spp.to_string()),
                ("render.seed", seed.to_string()),
            ],
        );
        picture(&film(&scene, 3))
    };
    let blurred = at(shutter, 16 * INSTANTS, 1);
    let mut mean = vec![[0.0; 2]; blurred.len()];
    for i in 0..INSTANTS {
        let instant = shutter[0] + (shutter[1] - shutter[0]) * (i as f64 + 0.5) / INSTANTS as f64;
        for (sum, pixel) in mean.iter_mut().zip(at([instant; 2], 16, 2 + i)) {
            sum[0] += pixel[0] / INSTANTS as f64;
            sum[1] += pixel[1] / (INSTANTS * INSTANTS) as f64;
        }
    }
    [blurred, mean, at([0.0; 2], 256, 100)]
}

/// Compares a blurred picture with instants, at several rates and shutters; says how near they were.
fn check_blur(name: &str, yaml: &str) -> String {
    let mut report = String::new();
    for (fps, shutter) in [(24.0, [-0.25, 0.25]), (25.0, [0.0, 0.6]), (30.0, [-0.8, -0.2])] {
        let [blurred, instants, sharp] = blurred_and_instants(yaml, fps, shutter);
        let (z, z_sharp) = (mean_square_z(&blurred, &instants), mean_square_z(&blurred, &sharp));
        assert!(z < 1.5, "{name} {fps} {shutter:?}: {z}");
        assert!(z_sharp > 4.0 * z && z_sharp > 3.0, "{name} {fps} {shutter:?}: the test would see no blur: {z_sharp}");
        report +=
            &format!("{name}, {fps} fps, {shutter:?}: mean z² {z:.2}, against the frame's own time {z_sharp:.1}\n");
    }
    report
}

const FILM: &str = "
frames: {first: 1, last: 5, fps: 24}
film: {resolution: [24, 16], spp: 4, filter: {box: {radius: 0.5}}}
lights:
  - sun: {direction: [-0.3, -0.6, -0.7], irradiance: [2, 2, 2]}
  - environment: {radiance: [0.3, 0.3, 0.3], visible: false}
";

const STILL: &str = "camera: {position: [0, 0, 5], look_at: [0, 0, 0], vertical_fov_deg: 30}\n";

#[test]
fn a_camera_that_moves_sees_the_mean_of_instants() {
    let camera = "
camera:
  position: {2: [-1, 0.3, 5], 4: [1.5, 0, 4], interpolation: linear}
  look_at: {2: [-0.4, 0, 0], 4: [0.5, 0.3, 0]}
  vertical_fov_deg: {1: 25, 5: 40}
  lens: {radius: 0.02, focus_distance: {1: 4, 5: 6}}
shapes:
  ball: {sphere: {center: [0, 0, 0], radius: 0.5}, material: {diffuse: {reflectance: {checker: {size: 0.2, colors: [[0.1, 0.1, 0.1], [0.9, 0.9, 0.9]]}}}}}
";
    print!("{}", check_blur("camera", &format!("{FILM}{camera}")));
}

#[test]
fn solids_with_a_formula_that_move_are_the_mean_of_instants() {
    let shapes = "
shapes:
  ring:
    torus: {center: [0.2, 0.3, 0], major_radius: 0.5, minor_radius: 0.15}
    transform:
      translate: {1: [-0.6, 0, 0], 5: [0.4, -0.2, 0.3], interpolation: linear}
      rotate_deg: {1: {axis: [1, 0.3, 0.2], angle: 0}, 5: {axis: [1, 0.3, 0.2], angle: 400}, interpolation: linear}
      scale: {1: 0.8, 5: 1.4}
  box:
    box: {center: [0, -0.8, 0], size: [1, 0.3, 0.3]}
    transform: {quaternion: {1: [0, 0, 0, 1], 5: [0, 0.7, 0.2, 0.4]}}
    material: {diffuse: {reflectance: {stripes: {along: [2.5, 0, 0], colors: [[0.1, 0.1, 0.1], [0.9, 0.9, 0.9]]}}}}
";
    print!("{}", check_blur("formula", &format!("{FILM}{STILL}{shapes}")));
}

#[test]
fn meshes_and_shapes_that_shine_are_the_mean_of_instants() {
    let shapes = "
shapes:
  stone:
    mesh: {file: meshes/stone.obj}
    transform: {rotate_deg: {1: {axis: [0, 0.2, 1], angle: 10}, 5: {axis: [0, 0.2, 1], angle: 160}}, scale: 2}
  lamp:
    sphere: {center: [0, 0, 0], radius: 0.2}
    material: {diffuse: {reflectance: [0, 0, 0], emission: [4, 4, 4]}}
    motion: {interpolation: linear, keys: [{time: 0, translate: [-1, 0.6, 0.3]}, {time: 0.2, translate: [1, 0.8, 0.5]}]}
";
    print!("{}", check_blur("mesh", &format!("{FILM}{STILL}{shapes}")));
}

#[test]
fn what_does_not_move_while_the_shutter_is_open_keeps_its_bits() {
    let shapes = "
shapes:
  ball:
    sphere: {center: [0, 0, 0], radius: 0.6}
    transform: {translate: {1: [0, 0, 0], 2: [0.3, 0.1, 0]}}
  box: {box: {center: [0, -0.8, 0], size: [1, 0.3, 0.3]}}
";
    let yaml = format!("{FILM}{STILL}{shapes}");
    let [open, shut] = ["[-0.25, 0.25]", "[0, 0]"].map(|shutter| {
        let film = film(&scene_with(&yaml, &[("frames.shutter", shutter.into())]), 4);
        film.pixels
    });
    assert_eq!(open, shut);
}

/// A flow that turns once in a second about the z axis.
fn whirl() -> VelocityField {
    let turn = Potential::Rigid {
        velocity: DVec3::ZERO,
        angular_velocity: DVec3::Z * std::f64::consts::TAU,
        center: DVec3::ZERO,
    };
    VelocityField::new(vec![Source::from(turn)], Vec::new())
}

fn splatted(particles: &Particles, shutter: [f64; 2]) -> DensityGrid {
    let input = SplatInput {
        position: particles.position.each_ref().map(Vec::as_slice),
        velocity: particles.velocity.each_ref().map(Vec::as_slice),
        bends: particles.bends.as_ref().map(|b| b.each_ref().map(|axes| axes.each_ref().map(Vec::as_slice))),
        mass: &particles.mass,
        radius: &particles.radius,
        carried: &[],
        obstacles: None,
    };
    let settings =
        SplatSettings { voxel_size: 0.04, shutter_seconds: shutter, soft_radius: None, memory_limit_bytes: 1 << 30 };
    let made = splat(&input, &settings).unwrap();
    assert!((made.mass.grid / made.mass.particles - 1.0).abs() < 1e-6, "mass is conserved");
    made.grid
}

/// Densities along both axes of the plane of the whirl.
fn values(grid: &DensityGrid) -> Vec<f64> {
    let voxels = (-40..40).flat_map(|y| (-40..40).map(move |x| IVec3::new(x, y, 0)));
    voxels.map(|voxel| f64::from(grid.voxel(voxel))).collect()
}

#[test]
fn smoke_is_the_mean_of_instants_along_its_true_way() {
    // A tenth of a turn from the instant at most.
    for shutter in [[-0.05, 0.05], [0.0, 0.1], [-0.1, -0.02]] {
        let once = Emitter {
            place: Place::Ball { center: DVec3::X * 0.9, radius: 0.2 },
            strands: None,
            motion: None,
            schedule: Schedule::Count(500),
            start: 0.0,
            stop: f64::INFINITY,
            lifetime: 100.0,
            lifetime_spread: 0.0,
            particle_mass: 1e-3,
            fade_in: 0.0,
            fade_out: 0.0,
            seed: curlsmoke::math::hash::Seed(3),
        };
        let time = TimeGrid { first_frame: 1, substeps: 4, fps: 24.0 };
        let kernel = KernelSize { initial_radius: 0.08, expansion: 0.0 };
        let mut system = ParticleSystem::new(whirl(), vec![once], time, CLASSICAL, kernel);
        system.open_shutter(shutter);
        let particles = system.at_frame(5, &Silent).unwrap().clone();
        assert_eq!(particles.len(), 500);
        let blurred = values(&splatted(&particles, shutter));
        let straight = values(&splatted(&Particles { bends: None, ..particles.clone() }, shutter));
        let mut mean = vec![0.0; blurred.len()];
        for i in 0..128 {
            let s = shutter[0] + (shutter[1] - shutter[0]) * (f64::from(i) + 0.5) / 128.0;
            let (sin, cos) = (std::f64::consts::TAU * s).sin_cos();
            let mut there = Particles { bends: None, ..particles.clone() };
            for n in 0..there.len() {
                let [x, y] = [0, 1].map(|axis| f64::from(particles.position[axis][n]));
                there.position[0][n] = (x * cos - y * sin) as f32;
                there.position[1][n] = (x * sin + y * cos) as f32;
            }
            for (sum, value) in mean.iter_mut().zip(values(&splatted(&there, [0.0; 2]))) {
                *sum += value / 128.0;
            }
        }
        let total: f64 = mean.iter().sum();
        let off = |found: &[f64]| found.iter().zip(&mean).map(|(a, b)| (a - b).abs()).sum::<f64>() / total;
        println!("{shutter:?}: off by {:.4} of the density, straight streaks by {:.4}", off(&blurred), off(&straight));
        // Off by the fourth power of the time: 0.0025 within 0.3 radian of the instant, 0.02 within 0.75.
        assert!(total > 0.0 && off(&blurred) < 0.03, "{}", off(&blurred));
        assert!(off(&straight) > 10.0 * off(&blurred));
    }
}

/// A box that turns about a point beside it while it is carried along, at constant velocity and angular velocity.
const TURNING: &str = "
frames: {first: 1, last: 49, fps: 24, shutter: [-0.25, 0.25]}
camera: {position: [0, 0.5, 5], look_at: [0, 0.5, 0]}
film: {resolution: [24, 16], spp: 4}
shapes:
  bar:
    box: {center: [0.3, 0, 0], size: [1, 0.3, 0.3], rounding: 0.05}
    transform:
      translate: {1: [-0.4, 0.4, 0], 49: [0.2, 0.7, 0], interpolation: linear}
      rotate_deg: {1: {axis: [0, 0, 1], angle: 0}, 49: {axis: [0, 0, 1], angle: 540}, interpolation: linear}
flow:
  potentials:
    - uniform: {velocity: [0, 0.3, 0]}
    - noise: {length_scale: 0.5, speed: 0.3, octaves: 3, spin_rate: 0.2}
  obstacles: [bar]
smoke:
  emitters: [{sphere: {center: [0, 0.4, 0], radius: 0.9}, count: 3000, mass: 0.05, lifetime: 20}]
  advect: {integrator: rk2, substeps: 2}
  grid: {voxel_size: 0.08}
  medium: {extinction: 20}
lights: [{environment: {radiance: [1, 1, 1]}}]
";

#[test]
fn the_flow_at_a_keyed_wall_moves_as_the_wall_does() {
    let velocity = DVec3::new(0.6, 0.3, 0.0) / 2.0;
    let angular_velocity = DVec3::Z * 540f64.to_radians() / 2.0;
    for no_slip in [false, true] {
        let text = if no_slip {
            TURNING.replace("obstacles: [bar]", "obstacles: [bar]\n  no_slip: [bar]")
        } else {
            TURNING.into()
        };
        let scene = scene_with(&text, &[]);
        let geometry = Geometry::build(&scene, &Silent).unwrap();
        let flow = Flow::build(&scene, &geometry, &NoFiles).unwrap();
        let (mut worst, mut checked) = (0.0f64, 0);
        for time in [0.1, 0.77, 1.4] {
            let there = geometry.at(time);
            let solid = there.shapes[0].sdf.as_ref().unwrap();
            let about = DVec3::new(-0.4, 0.4, 0.0) + velocity * time;
            for i in 0..400 {
                let a = f64::from(i);
                let mut p = about + DVec3::new((a * 0.71).sin(), (a * 1.37).cos(), (a * 2.11).sin());
                for _ in 0..4 {
                    let d = solid.at(p.to_array());
                    p -= DVec3::from_array(d.gradient) * d.value;
                }
                let d = solid.at(p.to_array());
                if d.value.abs() > 1e-6 {
                    continue;
                }
                let wall = velocity + angular_velocity.cross(p - about);
                let v = DVec3::from_array(flow.span(time, 0.0).velocity(p.to_array(), 0.0));
                let off = v - wall;
                let off = if no_slip { off.length() } else { off.dot(DVec3::from_array(d.gradient)).abs() };
                (worst, checked) = (worst.max(off), checked + 1);
            }
        }
        println!("no slip {no_slip}: off by at most {worst:.1e} m/s at {checked} points");
        assert!(checked > 300 && worst < 2e-3, "{no_slip}: {worst} at {checked}");
    }
}

#[test]
fn no_particle_ends_inside_a_keyed_wall_that_turns() {
    let scene = scene_with(TURNING, &[]);
    let geometry = Geometry::build(&scene, &Silent).unwrap();
    let flow = Flow::build(&scene, &geometry, &NoFiles).unwrap();
    let mut system = ParticleSystem::build(&scene, &geometry, flow).unwrap();
    let mut deepest = f64::INFINITY;
    for frame in 1..=49 {
        let particles = system.at_frame(frame, &Silent).unwrap().clone();
        let there = geometry.at(f64::from(frame - 1) / 24.0);
        let solid = there.shapes[0].sdf.as_ref().unwrap();
        assert!(particles.len() == 3000 || frame == 1);
        for i in 0..particles.len() {
            deepest = deepest.min(solid.distance([0, 1, 2].map(|axis| f64::from(particles.position[axis][i]))));
        }
    }
    println!("the nearest particle is {deepest:.1e} m from the wall");
    // Where shapes are is rounded to single precision, here as for light.
    assert!(deepest > -2e-6, "{deepest}");
}

#[test]
fn a_frame_made_alone_is_that_of_a_sequence() {
    let folder = tempfile::tempdir().unwrap();
    let made = |name: &str, frames: Vec<i32>| {
        let image = folder.path().join(name).join("####.exr").display().to_string();
        std::fs::create_dir(folder.path().join(name)).unwrap();
        let scene = scene_with(TURNING, &[("output.image", format!("{image:?}"))]);
        let job = RenderJob { frames, ..RenderJob::default() };
        pipeline::render(&scene, &job, &Silent, &mut |_| {}).unwrap();
        std::fs::read(folder.path().join(name).join("0006.exr")).unwrap()
    };
    assert!(made("sequence", vec![4, 5, 6]) == made("alone", vec![6]));
}

#[test]
fn lights_over_time_are_as_they_are_at_the_frame() {
    let yaml = "
frames: {first: 1, last: 5, fps: 24}
camera: {position: [0, 0, 5], look_at: [0, 0, 0]}
film: {resolution: [8, 8], spp: 4, filter: {box: {radius: 0.5}}}
shapes: {wall: {box: {center: [0, 0, 0], size: [9, 9, 1]}}}
lights: [{sun: {direction: {1: [0, 0, -1], 5: [0, -1, -1]}, irradiance: {1: [1, 1, 1], 3: [3, 3, 3], interpolation: step}}}]
";
    let scene = scene_with(yaml, &[]);
    let grey = 0.5 / std::f64::consts::PI;
    for (frame, irradiance, share) in [(1, 1.0, 0.0), (2, 1.0, 0.15625), (3, 3.0, 0.5), (5, 3.0, 1.0f64)] {
        let cosine = 1.0 / (1.0 + share * share).sqrt();
        let pixel = picture(&film(&scene, frame))[27][0];
        assert!((pixel / (grey * irradiance * cosine) - 1.0).abs() < 1e-4, "{frame}: {pixel}");
    }
}

#[test]
fn a_camera_that_passes_its_target_is_an_error_with_its_frame() {
    let yaml = "
frames: {first: 1, last: 5}
camera: {position: {1: [0, 0, 1], 5: [0, 0, -1], interpolation: linear}, look_at: [0, 0, 0]}
lights: [{environment: {radiance: [1, 1, 1]}}]
";
    let Err(error) = pipeline::film(&scene_with(yaml, &[]), 3, None, &Silent) else { panic!("it looks nowhere") };
    let error = error.to_string();
    assert!(error.contains(":4:") && error.contains("frame 3") && error.contains("stands where it looks"), "{error}");
}
