//! Every potential, mask and kind of wall together: no divergence, tight walls that may move, no jumps on ridges.

#[path = "support/dual.rs"]
mod dual;

use curlsmoke::flow::curl::central_jacobian;
use curlsmoke::flow::elements::{Column, Shear};
use curlsmoke::flow::field::{FieldSpan, VelocityField};
use curlsmoke::flow::mask::{Block, Mask, PlacedMask, Wake};
use curlsmoke::flow::noise::RMS_SPEED;
use curlsmoke::flow::obstacles::{Boundary, Wall, build_obstacles};
use curlsmoke::flow::octaves::{Form, OctavesSettings, octaves};
use curlsmoke::flow::source::{Potential, Source};
use curlsmoke::flow::vortex::{Vortex, smooth_curve};
use curlsmoke::geometry::motion::{Motion, Pose};
use curlsmoke::geometry::primitive::{Capsule, Cuboid, HalfSpace, Primitive, Sphere, Torus};
use curlsmoke::geometry::sdf::{PlacedSdf, Sdf};
use curlsmoke::math::dual::Dual;
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::lanes::{Batch, Kernel, run_kernel};
use curlsmoke::math::lattice::Lattice;
use curlsmoke::math::real::{dot, length};
use curlsmoke::math::space::Similarity;
use dual::divergence;
use glam::{DMat3, DQuat, DVec3, UVec3};
use std::sync::Arc;

fn placed(primitive: Primitive) -> Arc<PlacedSdf> {
    Arc::new(PlacedSdf::new(Sdf::Primitive(primitive), Similarity::IDENTITY))
}

fn still(primitive: Primitive, boundary: Boundary) -> Wall {
    Wall { boundary, ..placed(primitive).into() }
}

fn moving(primitive: Primitive, boundary: Boundary) -> Wall {
    let turned = Pose {
        displacement: DVec3::new(0.4, -0.2, 0.3),
        rotation: DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 2.0),
    };
    let motion = Motion::new(vec![(0.0, Pose::REST), (1.0, turned)], true);
    Wall { motion: Some(Arc::new(motion)), ..still(primitive, boundary) }
}

fn container(primitive: Primitive, boundary: Boundary) -> Wall {
    Wall { is_container: true, ..still(primitive, boundary) }
}

fn sphere(x: f64, y: f64, z: f64, radius: f64) -> Primitive {
    Primitive::Sphere(Sphere { center: DVec3::new(x, y, z), radius })
}

fn cuboid(center: DVec3, half: DVec3, rounding: f64) -> Primitive {
    Primitive::Cuboid(Cuboid { center, half_size: half, rounding })
}

fn masks() -> Vec<Mask> {
    let unit = OctavesSettings { length_scale: 0.9, speed: RMS_SPEED / 0.9, octaves: 1, ..Default::default() };
    let samples = (0..6 * 5 * 4).map(|i| (f64::from(i) * 0.7).sin().abs() as f32).collect();
    let samples = Lattice::from_values(UVec3::new(6, 5, 4), samples);
    vec![
        Mask::Height { axis: DVec3::new(0.0, 0.6, 0.8), from: -1.0, to: 0.8 },
        Mask::Shape { sdf: placed(sphere(0.4, 0.0, 0.0, 0.5)), from: 1.0, to: 0.1 },
        Mask::solid(cuboid(DVec3::ZERO, DVec3::splat(0.8), 0.4), 0.7, 0.0),
        Mask::Wake(Wake {
            center: DVec3::new(-0.8, 0.0, 0.0),
            radius: 0.5,
            direction: DVec3::X,
            length: 3.0,
            spread: 0.3,
        }),
        Mask::noise(&octaves(&unit)[0], 0.1, 1.0),
        Mask::Block(Arc::new(Block::new(&samples, DMat3::from_diagonal(DVec3::splat(2.0)), DVec3::splat(2.5)))),
    ]
}

fn noise(settings: OctavesSettings) -> Vec<Potential> {
    octaves(&OctavesSettings { length_scale: 0.7, speed: 0.8, ..settings }).into_iter().map(Potential::Octave).collect()
}

/// Every potential, bare or with masks.
fn sources(is_masked: bool) -> Vec<Source> {
    let v = DVec3::new;
    let curve = smooth_curve(&[v(-0.5, 0.0, 0.0), v(0.3, 0.4, 0.2), v(0.6, -0.3, -0.4)], true, 0.1);
    let mut potentials = vec![
        Potential::Uniform { velocity: v(0.3, 0.7, -0.2), origin: v(0.1, 0.0, 0.0) },
        Potential::Shear(Shear::new(v(1.0, 0.0, 0.2), v(0.0, 1.0, 0.3), 0.4, v(0.0, 0.2, 0.0))),
        Potential::Rigid { velocity: v(0.1, 0.0, 0.2), angular_velocity: v(0.1, 0.4, -0.2), center: v(0.2, 0.0, 0.0) },
        Potential::Column(Column { base: v(0.0, -1.2, 0.1), axis: DVec3::Y, radius: 0.6, speed: 0.8, rise: 0.9 }),
        Potential::Vortex(Vortex::about_point(v(0.4, 0.3, -0.2), v(0.0, 3.0, 1.0), 0.7, v(0.2, 0.0, 0.0))),
        Potential::Vortex(Vortex::along_circle(v(-0.2, 0.1, 0.0), DVec3::Y, 0.6, 0.3, 0.9, v(0.0, 0.3, 0.0))),
        Potential::Vortex(Vortex::along_line(&curve, 0.35, 0.5, DVec3::ZERO)),
    ];
    potentials.extend(noise(OctavesSettings { spin_rate: 0.5, seed: Seed(4), ..Default::default() }));
    potentials.extend(noise(OctavesSettings { evolve_rate: 0.8, seed: Seed(5), ..Default::default() }));
    potentials.extend(noise(OctavesSettings {
        form: Form::Planar(v(0.1, 0.2, 1.0)),
        seed: Seed(6),
        ..Default::default()
    }));
    potentials.extend(noise(OctavesSettings { form: Form::Bitangent, seed: Seed(7), ..Default::default() }));
    let evolving = OctavesSettings { form: Form::Bitangent, evolve_rate: 0.6, seed: Seed(8), ..Default::default() };
    potentials.extend(noise(evolving));
    potentials.extend(noise(OctavesSettings { memory: 1.0, spin_rate: 0.3, seed: Seed(9), ..Default::default() }));
    let masks = masks();
    // One of them alone or two at once.
    let both = |i: usize| [i, i / 2 + 3].map(|k| masks[k % masks.len()].clone()).to_vec();
    let masks_of = |i: usize| if is_masked { both(i)[..1 + i % 2].to_vec() } else { Vec::new() };
    potentials
        .into_iter()
        .enumerate()
        .map(|(i, p)| Source { masks: masks_of(i).into_iter().map(Into::into).collect(), ..p.into() })
        .collect()
}

/// Scenes of walls.
fn rooms() -> Vec<(&'static str, Vec<Wall>)> {
    let v = DVec3::new;
    let ring = Primitive::Torus(Torus { center: DVec3::ZERO, axis: DVec3::Z, major_radius: 0.6, minor_radius: 0.2 });
    let capsule = Primitive::Capsule(Capsule { start: v(-0.3, 0.1, 0.0), end: v(0.3, 0.4, 0.1), radius: 0.2 });
    let ground = Primitive::HalfSpace(HalfSpace { point: v(0.0, -0.9, 0.0), normal: DVec3::Y });
    let sharp = cuboid(v(-0.7, 0.2, 0.3), v(0.2, 0.3, 0.2), 0.0);
    let lower = still(cuboid(v(-0.5, -0.6, 0.2), v(0.3, 0.31, 0.2), 0.0), Boundary::Slip);
    vec![
        ("slip", vec![still(sphere(0.0, 0.0, 0.0, 0.4), Boundary::Slip), still(ring, Boundary::Slip)]),
        ("no slip", vec![still(capsule, Boundary::NoSlip), still(ground, Boundary::NoSlip)]),
        ("moving", vec![moving(capsule, Boundary::Slip), still(sphere(1.0, 0.3, 0.2, 0.3), Boundary::Slip)]),
        ("moving, no slip", vec![moving(sharp, Boundary::NoSlip), still(ground, Boundary::Slip)]),
        ("moving box", vec![moving(sharp, Boundary::Slip)]),
        ("moving ring", vec![moving(ring, Boundary::Slip)]),
        (
            "a ball and a box on the ground",
            vec![still(ground, Boundary::Slip), still(sphere(0.3, -0.5, 0.0, 0.4), Boundary::Slip), lower.clone()],
        ),
        ("the same, no slip", vec![still(ground, Boundary::NoSlip), Wall { boundary: Boundary::NoSlip, ..lower }]),
        ("closed box", vec![container(cuboid(DVec3::ZERO, v(1.2, 1.0, 1.1), 0.0), Boundary::Slip)]),
        (
            "closed ball with a body inside",
            vec![
                container(sphere(0.0, 0.0, 0.0, 1.4), Boundary::Slip),
                still(sphere(0.3, 0.1, 0.0, 0.35), Boundary::Slip),
            ],
        ),
        ("closed box, no slip", vec![container(cuboid(DVec3::ZERO, v(1.2, 1.0, 1.1), 0.0), Boundary::NoSlip)]),
    ]
}

fn random_point(rng: &mut CounterRng) -> [f64; 3] {
    std::array::from_fn(|_| f64::from(rng.uniform()) * 2.6 - 1.3)
}

/// Points where the flow may be.
fn free_points(span: &FieldSpan, seed: u64, count: usize) -> Vec<[f64; 3]> {
    let mut rng = CounterRng::new(Seed(seed));
    let mut points = Vec::new();
    while points.len() < count {
        let p = random_point(&mut rng);
        if span.distance(p, 0.3) > 1e-4 {
            points.push(p);
        }
    }
    points
}

#[test]
fn nothing_makes_divergence() {
    for (name, walls) in rooms() {
        for is_masked in [false, true] {
            let field = VelocityField::new(sources(is_masked), build_obstacles(walls.clone()));
            let span = field.span(0.4, 0.1);
            let (mut worst, mut worst_single, mut square) = (0.0f64, 0.0f64, 0.0);
            let points = free_points(&span, 1, 600);
            for p in &points {
                let (trace, size) = divergence(span.velocity(Dual::point(*p), Dual::constant(0.3)));
                let single = p.map(|x| x as f32);
                let (of_single, _) = divergence(span.velocity(Dual::point(single), Dual::constant(0.3f32)));
                worst = worst.max(trace.abs());
                worst_single = worst_single.max(of_single.abs());
                square += size;
            }
            let rms = (square / points.len() as f64).sqrt();
            println!(
                "{name}, masks {is_masked}: |∇·v| at most {:.1e} of RMS |∇v| {rms:.1} 1/s, {:.1e} in single precision",
                worst / rms,
                worst_single / rms
            );
            assert!(worst < 1e-10 * rms, "{name}, {is_masked}");
            assert!(worst_single < 1e-4 * rms, "{name}, {is_masked}");
        }
    }
}

#[test]
fn the_derivatives_that_the_divergence_is_read_from_are_those_of_the_velocity() {
    for (name, walls) in rooms() {
        let field = VelocityField::new(sources(true), build_obstacles(walls));
        let span = field.span(0.4, 0.1);
        let mut far_off = 0;
        for p in free_points(&span, 2, 60) {
            let v = span.velocity(Dual::point(p), Dual::constant(0.3));
            let difference = central_jacobian(|q| span.velocity(q, 0.3), p, 1e-5);
            let size = v.iter().flat_map(|x| x.gradient).fold(1.0f64, |m, x| m.max(x.abs()));
            let exact = v.iter().flat_map(|x| x.gradient);
            let pairs = exact.zip(difference.iter().flatten());
            far_off += pairs.filter(|(a, b)| (a - *b).abs() > 2e-3 * size).count();
        }
        // Where a second derivative jumps the difference is not the derivative.
        assert!(far_off <= 5, "{name}: {far_off} of 540");
    }
}

/// Points on the walls at phase 0.3, normals, and what the flow does there.
fn on_walls(field: &VelocityField, span: &FieldSpan, count: usize) -> Vec<([f64; 3], [f64; 3], Boundary)> {
    let mut rng = CounterRng::new(Seed(3));
    let mut points = Vec::new();
    let motions: Vec<_> = field.obstacles().iter().map(|o| o.span(0.4, 0.1)).collect();
    while points.len() < count {
        let mut p = DVec3::from_array(random_point(&mut rng));
        // From where the flow is, so that the way does not end on the very edge between two walls, which has no normal.
        if span.distance(p.to_array(), 0.3) < 0.0 {
            continue;
        }
        let pick = (rng.uniform() * motions.len() as f32) as usize;
        let (obstacle, motion) = (&field.obstacles()[pick], motions[pick].as_ref());
        for _ in 0..60 {
            let g = obstacle.gradient(motion, p.to_array(), 0.3);
            p -= g * obstacle.distance(motion, p.to_array(), 0.3);
        }
        let others = field.obstacles().iter().zip(&motions).enumerate();
        let is_free =
            others.into_iter().all(|(i, (o, m))| i == pick || o.distance(m.as_ref(), p.to_array(), 0.3) > 1e-3);
        if p.abs().max_element() < 2.0 && is_free && span.distance(p.to_array(), 0.3).abs() < 1e-9 {
            points.push((p.to_array(), obstacle.gradient(motion, p.to_array(), 0.3).to_array(), obstacle.boundary()));
        }
    }
    points
}

#[test]
fn at_walls_the_flow_moves_as_they_do() {
    for (name, walls) in rooms() {
        for is_masked in [false, true] {
            let field = VelocityField::new(sources(is_masked), build_obstacles(walls.clone()));
            let span = field.span(0.4, 0.1);
            let free: f64 = free_points(&span, 1, 300).iter().map(|p| length(span.velocity(*p, 0.3)).powi(2)).sum();
            let rms = (free / 300.0).sqrt();
            let (mut across, mut held, mut sliding) = (0.0f64, 0.0f64, None::<f64>);
            for (p, n, boundary) in on_walls(&field, &span, 400) {
                let (v, wall) = (span.velocity(p, 0.3), span.wall_velocity(p, 0.3));
                let relative: [f64; 3] = std::array::from_fn(|i| v[i] - wall[i]);
                across = across.max(dot(relative, n).abs());
                match boundary {
                    Boundary::NoSlip => held = held.max(length(relative)),
                    Boundary::Slip => sliding = Some(sliding.unwrap_or(0.0).max(length(relative))),
                }
            }
            println!(
                "{name}, masks {is_masked}: (v − wall)·n at most {:.1e} of the RMS speed {rms:.2} m/s",
                across / rms
            );
            assert!(across < 1e-5 * rms, "{name}, {is_masked}: {across}");
            assert!(held < 1e-5 * rms, "{name}: {held}");
            assert!(sliding.is_none_or(|fastest| fastest > 1e-2 * rms), "{name}: slips by {sliding:?} only");
        }
    }
}

#[test]
fn in_two_dimensions_the_flow_stays_in_its_planes_and_keeps_its_promises() {
    let v = DVec3::new;
    let ground = still(Primitive::HalfSpace(HalfSpace { point: v(0.0, -0.9, 0.0), normal: DVec3::Y }), Boundary::Slip);
    let post = Primitive::Capsule(Capsule { start: v(0.3, 0.2, -5.0), end: v(0.3, 0.2, 5.0), radius: 0.25 });
    let turned = Pose { displacement: v(0.5, -0.3, 0.0), rotation: DQuat::from_axis_angle(DVec3::Z, 1.5) };
    let bar = Wall {
        motion: Some(Arc::new(Motion::new(vec![(0.0, Pose::REST), (1.0, turned)], true))),
        ..still(cuboid(v(-0.5, 0.1, 0.0), v(0.3, 0.12, 4.0), 0.05), Boundary::Slip)
    };
    let rooms = [
        ("a ball and the ground", vec![ground.clone(), still(sphere(0.2, 0.0, 0.1, 0.4), Boundary::Slip)]),
        ("a post and a bar that moves", vec![still(post, Boundary::Slip), bar.clone()]),
        ("no slip", vec![still(post, Boundary::NoSlip), Wall { boundary: Boundary::NoSlip, ..bar }]),
    ];
    let of_two_dimensions = |is_masked| {
        let all = sources(is_masked).into_iter();
        let flat = all.filter(|source| match &source.potential {
            Potential::Column(_) => false,
            Potential::Octave(octave) => octave.form() != Form::Bitangent,
            _ => true,
        });
        flat.collect::<Vec<_>>()
    };
    for (name, walls) in rooms {
        for is_masked in [false, true] {
            let field = VelocityField::new(of_two_dimensions(is_masked), build_obstacles(walls.clone()));
            let field = field.planar(DVec3::Z);
            let span = field.span(0.4, 0.1);
            let points = free_points(&span, 1, 400);
            let (mut worst, mut gradients, mut speeds) = (0.0f64, 0.0, 0.0);
            for p in &points {
                let (trace, size) = divergence(span.velocity(Dual::point(*p), Dual::constant(0.3)));
                let velocity = span.velocity(*p, 0.3);
                assert!(velocity[2].abs() < 1e-14, "{name}: {velocity:?} leaves its plane");
                worst = worst.max(trace.abs());
                gradients += size / 400.0;
                speeds += length(velocity).powi(2) / 400.0;
            }
            let (mut across, mut held) = (0.0f64, 0.0f64);
            for (p, n, boundary) in on_walls(&field, &span, 300) {
                let (v, wall) = (span.velocity(p, 0.3), span.wall_velocity(p, 0.3));
                let relative: [f64; 3] = std::array::from_fn(|i| v[i] - wall[i]);
                across = across.max(dot(relative, n).abs());
                held = held.max(if boundary == Boundary::NoSlip { length(relative) } else { 0.0 });
            }
            // The same in all planes, round prisms at least.
            if name != "a ball and the ground" && !is_masked {
                for p in &points {
                    let (here, far) = (span.velocity(*p, 0.3), span.velocity([p[0], p[1], p[2] + 2.1], 0.3));
                    let change = length([here[0] - far[0], here[1] - far[1], here[2] - far[2]]);
                    assert!(change < 1e-9, "{name}: {change} m/s between planes at {p:?}");
                }
            }
            let (of_gradients, rms) = (worst / gradients.sqrt(), speeds.sqrt());
            println!(
                "{name}, masks {is_masked}: |∇·v| at most {of_gradients:.1e} of RMS |∇v|, (v − wall)·n {:.1e} of RMS",
                across / rms
            );
            assert!(of_gradients < 1e-10 && across < 1e-5 * rms && held < 1e-5 * rms, "{name}: {across} {held}");
        }
    }
}

#[test]
fn wind_and_whirls_have_the_same_velocity_in_two_dimensions() {
    let v = DVec3::new;
    let sources: Vec<Source> = vec![
        Potential::Uniform { velocity: v(0.3, -0.7, 0.9), origin: v(0.1, 0.2, 0.3) }.into(),
        Potential::Rigid { velocity: v(0.1, 0.2, 0.0), angular_velocity: v(0.0, 0.0, 0.8), center: v(0.5, 0.0, 0.0) }
            .into(),
        Potential::Shear(Shear::new(v(1.0, 0.5, 0.0), v(-0.5, 1.0, 0.0), 0.4, v(0.0, 0.2, 0.0))).into(),
        Potential::Vortex(Vortex::about_point(v(0.2, 0.1, 0.0), v(0.0, 0.0, 2.0), 3.0, DVec3::ZERO)).into(),
    ];
    let solid = VelocityField::new(sources.clone(), Vec::new());
    // Wherever along the normal a middle is, and however it moves along it: what counts is its place in the planes.
    let mut lifted = sources;
    lifted[1].potential =
        Potential::Rigid { velocity: v(0.1, 0.2, 0.0), angular_velocity: v(0.0, 0.0, 0.8), center: v(0.5, 0.0, 7.0) };
    lifted[3].potential =
        Potential::Vortex(Vortex::about_point(v(0.2, 0.1, -5.0), v(0.0, 0.0, 2.0), 3.0, v(0.0, 0.0, 9.0)));
    let flat = VelocityField::new(lifted, Vec::new()).planar(DVec3::Z);
    let mut rng = CounterRng::new(Seed(8));
    for _ in 0..100 {
        let p = random_point(&mut rng);
        // In the plane of the middles whirls are the same; of the wind what points out of the plane is gone.
        let (a, b) = (solid.velocity([p[0], p[1], 0.0], 0.0), flat.velocity(p, 0.0));
        assert!((a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12 && b[2] == 0.0, "{a:?} {b:?}");
    }
}

#[test]
fn masks_move_with_their_shapes() {
    let turned = Pose {
        displacement: DVec3::new(0.4, -0.2, 0.3),
        rotation: DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 2.0),
    };
    let motion = Arc::new(Motion::new(vec![(0.0, Pose::REST), (1.0, turned)], false));
    let middle = DVec3::new(0.1, 0.2, 0.0);
    let sdf = placed(cuboid(middle, DVec3::new(0.5, 0.1, 0.2), 0.05));
    let shape = Mask::Shape { sdf, from: 0.6, to: 0.0 };
    let wake = Mask::Wake(Wake { center: middle, radius: 0.3, direction: DVec3::X, length: 2.0, spread: 0.2 });
    let moving = |mask: &Mask| PlacedMask { mask: mask.clone(), motion: Some((motion.clone(), middle)) };
    let (mut rng, mut seen) = (CounterRng::new(Seed(8)), 0);
    for _ in 0..2000 {
        let p = DVec3::from_array(random_point(&mut rng));
        let (carried, trailing) = (moving(&shape), moving(&wake));
        let (carried, trailing) = (carried.span(0.5, 0.5), trailing.span(0.5, 0.5));
        // At the end of the span it is where its last pose brings it.
        let q = turned.rotation * (p - middle) + middle + turned.displacement;
        let (found, rest) = (carried.at(q.to_array(), 1.0), shape.at(p.to_array()));
        assert!((found.value - rest.value).abs() < 1e-9);
        let gradient = turned.rotation * DVec3::from_array(rest.gradient);
        assert!((DVec3::from_array(found.gradient) - gradient).length() < 1e-8);
        // A tail goes along and does not turn.
        let (found, rest) = (trailing.at((p + turned.displacement).to_array(), 1.0), wake.at(p.to_array()));
        assert!((found.value - rest.value).abs() < 1e-9 && (found.gradient[1] - rest.gradient[1]).abs() < 1e-8);
        seen += usize::from(rest.value > 0.1);
    }
    assert!(seen > 20);
}

#[test]
fn wind_stays_as_it_is_far_from_walls_and_stops_at_those_that_hold_it() {
    let ground = Primitive::HalfSpace(HalfSpace { point: DVec3::ZERO, normal: DVec3::Y });
    for boundary in [Boundary::Slip, Boundary::NoSlip] {
        let field = VelocityField::new(vec![Source::wind([1.0, 0.0, 0.5])], build_obstacles([still(ground, boundary)]));
        let at = |x: f64, y: f64| field.velocity([x, y, 3.0], 0.0);
        for x in [0.0, 100.0] {
            assert!(length(std::array::from_fn(|i| at(x, 2.0)[i] - [1.0, 0.0, 0.5][i])) < 1e-9);
            let low = length(at(x, 1e-9));
            assert!(if boundary == Boundary::Slip { low > 1.0 } else { low < 1e-6 }, "{boundary:?} at {x}: {low}");
            assert!(length(std::array::from_fn(|i| at(0.0, 0.3)[i] - at(x, 0.3)[i])) < 1e-9, "alike all along");
        }
    }
}

struct Batches<'a> {
    span: &'a FieldSpan<'a>,
    points: &'a [[f32; 3]],
}

impl Kernel for Batches<'_> {
    type Output = f64;
    #[inline(always)]
    fn run<L: Batch>(self, zero: L) -> f64 {
        let mut worst = 0.0f64;
        let phase = zero.lit(0.3);
        for group in self.points.chunks(L::WIDTH) {
            let axis = |a: usize| group.iter().map(|p| p[a]).collect::<Vec<_>>();
            let p = [0, 1, 2].map(|a| zero.load(&axis(a)));
            let v = self.span.velocity(p, phase);
            for (i, point) in group.iter().enumerate() {
                let exact = self.span.velocity(point.map(f64::from), 0.3);
                let alone = self.span.velocity(point.map(|x| zero.lit(f64::from(x))), phase);
                for a in 0..3 {
                    assert_eq!(v[a].lane(i), alone[a].lane(0), "a lane depends on its neighbours at {point:?}");
                    worst = worst.max((v[a].lane(i) - exact[a]).abs() / (1.0 + exact[a].abs()));
                }
            }
        }
        worst
    }
}

#[test]
fn lanes_agree_with_the_truth_and_do_not_depend_on_their_neighbours() {
    for (name, walls) in rooms() {
        let field = VelocityField::new(sources(true), build_obstacles(walls));
        let span = field.span(0.4, 0.1);
        let points: Vec<[f32; 3]> = free_points(&span, 5, 600)
            .into_iter()
            .filter(|p| span.distance(*p, 0.3) > 2e-3)
            .map(|p| p.map(|x| x as f32))
            .collect();
        let worst = run_kernel(Batches { span: &span, points: &points });
        println!("{name}: lanes differ by at most {worst:.1e} m/s");
        assert!(worst < 5e-5, "{name}: {worst}");
    }
}
