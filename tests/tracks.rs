//! Smoke along divergence-free vector noise: it keeps its values, stays inside, and stands alone frame by frame.

use curlsmoke::flow::tracks::Tracks;
use curlsmoke::flow::{Flow, NoFiles};
use curlsmoke::geometry::Geometry;
use curlsmoke::grid::vdb;
use curlsmoke::inspect::probe::SceneFlow;
use curlsmoke::inspect::streamlines::{Reach, TraceSettings, trace};
use curlsmoke::math::dual::Dual;
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::space::WorldPoint;
use curlsmoke::particles::{ParticleSystem, Particles};
use curlsmoke::pipeline::{self, BakeJob};
use curlsmoke::progress::Silent;
use curlsmoke::scene::Scene;
use glam::DVec3;
use std::path::Path;

/// Two shapes of every kind that can confine smoke, and none that is seen.
const SHAPES: &str = "
  ring: {torus: {center: [0, 0, 0], axis: [0, 1, 0], major_radius: 0.6, minor_radius: 0.25}, visible: false}
  pill: {capsule: {start: [-0.5, 0, 0], end: [0.5, 0.2, 0], radius: 0.3}, visible: false}
  stone: {mesh: {file: scenes/meshes/stone.obj, distance_voxel: 0.04}, transform: {scale: 2.5}, visible: false}
";

fn scene(dfvn: &str, emitter: &str, last: u32) -> Scene {
    let text = format!(
        "version: 1
camera: {{position: [0, 0, 3], look_at: [0, 0, 0]}}
film: {{resolution: [16, 9]}}
frames: {{first: 1, last: {last}, fps: 24}}
shapes:{SHAPES}
flow: {{dfvn: {{{dfvn}}}}}
smoke:
  emitters:
    - {emitter}
  grid: {{voxel_size: 0.05}}
lights: [{{environment: {{radiance: [1, 1, 1]}}}}]
"
    );
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("test.yaml");
    Scene::from_text(&text, &path).unwrap_or_else(|error| panic!("{error}"))
}

fn flow(scene: &Scene) -> Flow {
    Flow::build(scene, &Geometry::build(scene, &Silent).unwrap(), &NoFiles).unwrap()
}

fn tracks(dfvn: &str) -> Tracks {
    match flow(&scene(dfvn, EVERYWHERE, 1)) {
        Flow::Tracks(tracks) => tracks,
        Flow::Curl(_) => panic!("a scene with dfvn has tracks"),
    }
}

fn system(scene: &Scene) -> ParticleSystem {
    let geometry = Geometry::build(scene, &Silent).unwrap();
    let flow = Flow::build(scene, &geometry, &NoFiles).unwrap();
    ParticleSystem::build(scene, &geometry, flow).unwrap()
}

/// All at once, all over a box that holds each of the shapes.
const EVERYWHERE: &str = "{box: {center: [0, 0, 0], size: [1.7, 1.2, 1.7]}, count: 3000, lifetime: 1000}";

fn position(particles: &Particles, i: usize) -> [f64; 3] {
    [0, 1, 2].map(|axis| f64::from(particles.position[axis][i]))
}

#[test]
fn a_frame_alone_equals_the_same_frame_of_a_sequence_to_the_bit() {
    let emitter = "{sphere: {center: [0.5, 0, 0], radius: 0.3}, rate: 3000, lifetime: 0.9, start: -0.3}";
    for dfvn in ["length_scale: 0.3, speed: 0.8, inside: ring", "length_scale: 0.3, speed: 0.8, along: stone"] {
        let scene = scene(dfvn, emitter, 40);
        let mut sequence = system(&scene);
        for frame in 1..=40 {
            let in_sequence = sequence.at_frame(frame, &Silent).unwrap().clone();
            if [1, 17, 40].contains(&frame) {
                let alone = system(&scene).at_frame(frame, &Silent).unwrap().clone();
                assert!(alone == in_sequence, "{dfvn}: frame {frame}");
                assert!(in_sequence.len() > 500);
            }
        }
        let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let alone = one_thread.install(|| system(&scene).at_frame(40, &Silent).unwrap().clone());
        assert!(alone == *sequence.at_frame(40, &Silent).unwrap(), "{dfvn}: on one thread");
    }
}

/// By how much the values have changed since birth after so many steps, sorted: the larger change of each particle.
fn drift(dfvn: &str, steps: u32) -> Vec<f64> {
    let scene = scene(dfvn, EVERYWHERE, steps + 2);
    let Flow::Tracks(tracks) = flow(&scene) else { panic!("a scene with dfvn has tracks") };
    let mut system = system(&scene);
    let mut values_at = |frame| {
        let particles = system.at_frame(frame, &Silent).unwrap();
        (0..particles.len()).map(|i| tracks.iso_values(position(particles, i))).collect::<Vec<_>>()
    };
    // All are born within the first step.
    let (born, now) = (values_at(2), values_at(steps as i32 + 2));
    let changes = now.iter().zip(&born).map(|(now, born)| (0..2).map(|i| (now[i] - born[i]).abs()).fold(0.0, f64::max));
    let mut changes: Vec<f64> = changes.collect();
    assert_eq!(changes.len(), 3000);
    changes.sort_by(f64::total_cmp);
    changes
}

#[test]
fn particles_keep_their_values_over_a_thousand_steps_and_drift_without_reprojection() {
    // Steps are long: a twelfth of a swirl at the root mean square speed. The values of noise are about 0.05.
    for dfvn in ["length_scale: 0.3, speed: 0.6", "length_scale: 0.3, speed: 0.6, along: ring"] {
        let of = |how: &str| {
            let changes = drift(&format!("{dfvn}, {how}"), 1000);
            println!(
                "{dfvn}, {how}: changed by {:.1e} in the median, {:.1e} of 99 %, {:.1e} of 99.9 %, {:.1e} at most",
                changes[1500], changes[2970], changes[2997], changes[2999]
            );
            changes
        };
        let (lost, newton) = (of("reprojections: 0"), of("reprojection: newton"));
        let (once, twice) = (of("reprojections: 1"), of("reprojections: 2"));
        assert!(lost[1500] > 1e-3 && lost[2970] > 2e-2, "{dfvn}");
        assert!(newton[2970] < 0.1 * lost[2970] && once[2970] < 0.01 * lost[2970], "{dfvn}");
        assert!(twice[1500] < 2e-7 && twice[2970] < 2e-6 && twice[2997] < 2e-3, "{dfvn}");
    }
}

#[test]
fn nothing_leaves_a_ring_a_capsule_or_a_mesh_over_a_thousand_steps() {
    for name in ["ring", "pill", "stone"] {
        let dfvn = format!("length_scale: 0.2, speed: 0.6, inside: {name}, margin: 0.15");
        let scene = scene(&dfvn, EVERYWHERE, 1001);
        let Flow::Tracks(tracks) = flow(&scene) else { panic!("a scene with dfvn has tracks") };
        let mut system = system(&scene);
        let (mut worst, mut inside_deep, mut seen) = (f64::MIN, 0, 0);
        for frame in 1..=1001 {
            let particles = system.at_frame(frame, &Silent).unwrap();
            for i in 0..particles.len() {
                let distance = -tracks.walls().distance(position(particles, i), 0.0);
                worst = worst.max(distance);
                inside_deep += u64::from(distance < -0.05);
                seen += 1;
            }
        }
        println!(
            "{name}: at most {worst:.1e} m beyond the wall, {} of {} steps corrected, {} of {} born outside",
            system.penetrations(),
            system.particle_steps(),
            system.born_inside(),
            system.born(),
        );
        assert!(worst <= 0.0 && seen > 2_900_000 && inside_deep > seen / 20, "{name}: {worst}");
        assert!(system.born_inside() > 100);
    }
}

#[test]
fn the_root_mean_square_speed_is_as_stated_and_divergence_is_nothing() {
    for dfvn in ["length_scale: 0.1, speed: 0.7", "length_scale: 0.1, speed: 0.7, along: ring"] {
        let mut rng = CounterRng::new(Seed(1));
        let (mut square, mut gradient_square, mut worst) = (0.0, 0.0, 0.0f64);
        let count = 20_000;
        let tracks = tracks(dfvn);
        for _ in 0..count {
            let p: [f64; 3] = std::array::from_fn(|_| f64::from(rng.uniform()) * 6.0 - 3.0);
            let v = tracks.velocity(Dual::point(p));
            square += v.iter().map(|x| x.value * x.value).sum::<f64>() / f64::from(count);
            gradient_square += v.iter().flat_map(|x| x.gradient).map(|x| x * x).sum::<f64>() / f64::from(count);
            worst = worst.max((0..3).map(|i| v[i].gradient[i]).sum::<f64>().abs());
        }
        let rms = f64::sqrt(square);
        println!(
            "{dfvn}: RMS speed {rms:.4} m/s, divergence at most {:.1e} of the RMS gradient",
            worst / gradient_square.sqrt()
        );
        assert!((rms / 0.7 - 1.0).abs() < 0.02, "{dfvn}: {rms}");
        assert!(worst < 1e-12 * gradient_square.sqrt());
    }
}

/// How far from its start a line passes it by after its first round, if it comes round within some time.
fn gap(flow: &SceneFlow, start: DVec3, step: f64) -> Option<f64> {
    let settings = |seconds, step| TraceSettings { reach: Reach::Seconds(seconds), step, start: 0.0 };
    let line = trace(flow, &[start], &settings(30.0, step)).pop()?;
    let ahead = line.points[1].position - start;
    let beyond = |p: DVec3| (p - start).dot(ahead);
    let turned = line.points.iter().position(|point| beyond(point.position) < -0.01 * ahead.length())?;
    let (i, _) = line.points.windows(2).enumerate().skip(turned).find(|(_, pair)| {
        let [a, b] = [pair[0].position, pair[1].position];
        beyond(a) < 0.0 && beyond(b) >= 0.0 && b.distance(start) < 3.0 * ahead.length()
    })?;
    // Where in that step it passes the start: by halving.
    let before = line.points[i].position;
    let (mut low, mut high) = (0.0, step);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        let point = trace(flow, &[before], &settings(middle, middle)).pop()?.points.pop()?.position;
        if beyond(point) < 0.0 { low = middle } else { high = middle }
    }
    Some(trace(flow, &[before], &settings(high, high)).pop()?.points.pop()?.position.distance(start))
}

#[test]
fn closed_stream_lines_close_with_reprojection_and_drift_without() {
    let of = |reprojections: u32| {
        let dfvn = format!("length_scale: 0.3, speed: 0.6, inside: ring, margin: 0.2, reprojections: {reprojections}");
        flow(&scene(&dfvn, EVERYWHERE, 1))
    };
    let (kept, lost) = (of(2), of(0));
    let mut rng = CounterRng::new(Seed(5));
    let (mut gaps, mut drifts) = (Vec::new(), Vec::new());
    while gaps.len() < 12 {
        let start = DVec3::from_array(std::array::from_fn(|_| f64::from(rng.uniform()) * 1.7 - 0.85));
        let found = gap(&SceneFlow::frozen(&kept, 0.0), start, 0.02);
        gaps.extend(found);
        if found.is_some() {
            drifts.push(gap(&SceneFlow::frozen(&lost, 0.0), start, 0.02).unwrap_or(f64::INFINITY));
        }
    }
    gaps.sort_by(f64::total_cmp);
    drifts.sort_by(f64::total_cmp);
    println!(
        "lines come round to {:.1e} m at worst, {:.1e} in the median; without reprojection {:.1e} and {:.1e}",
        gaps[11], gaps[6], drifts[11], drifts[6]
    );
    assert!(gaps[11] < 1e-6 && drifts[6] > 100.0 * gaps[11], "{gaps:?} {drifts:?}");
}

/// Mass of the smoke that is further outside of the ring than a voxel reaches, and all of it, by random points.
fn mass_outside(soft: &str) -> (f64, f64) {
    let emitter = "{sphere: {center: [0.6, 0, 0], radius: 0.24}, count: 20000, lifetime: 100}";
    let mut scene = scene("length_scale: 0.2, speed: 0.4, inside: ring", emitter, 40);
    let grid = scene.settings.smoke.as_mut().unwrap().grid.as_mut().unwrap();
    (grid.voxel_size, grid.kernel_radius) = (0.02, Some(0.08));
    if !soft.is_empty() {
        grid.soft_radius = Some(soft.parse().unwrap());
    }
    let folder = tempfile::tempdir().unwrap();
    let volume = folder.path().join("ring.vdb");
    let job = BakeJob { frames: vec![40], volume: volume.to_str(), ..BakeJob::default() };
    pipeline::bake(&scene, &job, &Silent, &mut |_, _| {}).unwrap();
    let grid = vdb::read_float_grid(&volume, "density", 1 << 30).unwrap();
    let (flow, mut rng) = (flow(&scene), CounterRng::new(Seed(8)));
    let walls = flow.walls().span(0.0, 0.0);
    let (mut outside, mut all) = (0.0, 0.0);
    for _ in 0..400_000 {
        let p: [f64; 3] = std::array::from_fn(|_| f64::from(rng.uniform()) * 2.2 - 1.1);
        let density = f64::from(grid.density(WorldPoint::new(p[0] as f32, p[1] as f32, p[2] as f32)));
        all += density;
        // The corners of a voxel that a point lies in are no further away than its diagonal.
        outside += if walls.distance(p, 0.0) < -0.02 * 3f64.sqrt() { density } else { 0.0 };
    }
    (outside, all)
}

#[test]
fn kernels_do_not_bleed_out_of_the_shape_that_confines_them() {
    let ((kept, all), (bled, _)) = (mass_outside(""), mass_outside("0"));
    println!("outside of the ring: {:.1e} of the mass; without soft particles {:.1e}", kept / all, bled / all);
    assert!(kept == 0.0 && bled > 1e-3 * all && all > 0.0);
}
