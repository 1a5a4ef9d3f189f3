//! Properties of the velocity field: no divergence, tight walls, no jumps, and lanes that agree with the scalar truth.

#[path = "support/dual.rs"]
mod dual;

use curlsmoke::flow::field::{FieldSpan, VelocityField};
use curlsmoke::flow::obstacles::{Wall, build_obstacles};
use curlsmoke::flow::octaves::{OctavesSettings, kolmogorov_gain, octaves};
use curlsmoke::flow::source::{Potential, Source};
use curlsmoke::geometry::mesh::Mesh;
use curlsmoke::geometry::mesh_sdf::MeshSdf;
use curlsmoke::geometry::primitive::{Capsule, Cuboid, HalfSpace, Primitive, Sphere, Torus};
use curlsmoke::geometry::sdf::{PlacedSdf, Sdf, SmoothUnion};
use curlsmoke::math::dual::Dual;
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::lanes::{Batch, Kernel, run_kernel};
use curlsmoke::math::real::{dot, length};
use curlsmoke::math::space::Similarity;
use dual::divergence;
use glam::{DVec3, Quat, Vec3};
use std::sync::Arc;

fn placed(primitive: Primitive) -> Arc<PlacedSdf> {
    let placement =
        Similarity { scale: 1.1, rotation: Quat::from_rotation_z(0.4), translation: Vec3::new(0.1, -0.2, 0.05) };
    Arc::new(PlacedSdf::new(Sdf::Primitive(primitive), placement))
}

fn sphere(center: DVec3, radius: f64) -> Primitive {
    Primitive::Sphere(Sphere { center, radius })
}

fn swirls(length_scale: f64, speed: f64, count: u32) -> Vec<Source> {
    let settings = OctavesSettings {
        length_scale,
        speed,
        octaves: count,
        lacunarity: 2.0,
        gain: kolmogorov_gain(2.0),
        spin_rate: 0.5,
        scroll: [0.1, 0.2, -0.1],
        seed: Seed(4),
        ..Default::default()
    };
    octaves(&settings).into_iter().map(|o| Potential::Octave(o).into()).collect()
}

fn wind(velocity: [f64; 3]) -> Source {
    Source::wind(velocity)
}

fn wind_and_swirls() -> Vec<Source> {
    let mut sources = swirls(0.6, 0.8, 3);
    sources.push(wind([0.3, 0.9, -0.2]));
    sources
}

/// One scene for each kind of solid, and some with several.
fn scenes() -> Vec<(&'static str, Vec<Primitive>)> {
    let ball = sphere(DVec3::new(0.1, 0.2, 0.0), 0.4);
    let capsule = Primitive::Capsule(Capsule { start: DVec3::ZERO, end: DVec3::new(0.3, 0.5, 0.1), radius: 0.2 });
    let rounded =
        Primitive::Cuboid(Cuboid { center: DVec3::ZERO, half_size: DVec3::new(0.3, 0.4, 0.3), rounding: 0.2 });
    let sharp = Primitive::Cuboid(Cuboid { center: DVec3::ZERO, half_size: DVec3::new(0.3, 0.4, 0.2), rounding: 0.0 });
    let ring = Primitive::Torus(Torus { center: DVec3::ZERO, axis: DVec3::Y, major_radius: 0.5, minor_radius: 0.15 });
    let ground = Primitive::HalfSpace(HalfSpace { point: DVec3::new(0.0, -0.7, 0.0), normal: DVec3::Y });
    vec![
        ("no obstacle", vec![]),
        ("sphere", vec![ball]),
        ("capsule", vec![capsule]),
        ("rounded box", vec![rounded]),
        ("sharp box", vec![sharp]),
        ("torus", vec![ring]),
        ("ground", vec![ground]),
        ("sphere, torus and ground", vec![sphere(DVec3::Y * 0.9, 0.3), ring, ground]),
        ("touching spheres", vec![ball, sphere(DVec3::new(0.7, 0.4, 0.0), 0.35)]),
        ("sphere on the ground", vec![sphere(DVec3::NEG_Y * 0.4, 0.35), ground]),
    ]
}

fn field(sources: Vec<Source>, primitives: &[Primitive]) -> VelocityField {
    VelocityField::new(sources, build_obstacles(primitives.iter().map(|&p| placed(p))))
}

fn random_point(rng: &mut CounterRng) -> [f64; 3] {
    std::array::from_fn(|_| f64::from(rng.uniform()) * 3.0 - 1.5)
}

#[test]
fn the_velocity_has_no_divergence() {
    for (name, primitives) in scenes() {
        let field = field(wind_and_swirls(), &primitives);
        let span = field.span(0.7, 0.1);
        let mut rng = CounterRng::new(Seed(1));
        let (mut worst, mut square, mut count) = (0.0f64, 0.0, 0);
        while count < 3000 {
            let p = random_point(&mut rng);
            if field.distance(p, 0.0) < 0.0 {
                continue;
            }
            let (trace, size) = divergence(span.velocity(Dual::point(p), Dual::constant(0.3)));
            worst = worst.max(trace.abs() / size.sqrt());
            square += size;
            count += 1;
        }
        println!("{name}: |∇·v|/|∇v| at most {worst:.1e}, RMS |∇v| {:.2} 1/s", (square / f64::from(count)).sqrt());
        assert!(worst < 1e-10, "{name}: {worst}");
    }
}

#[test]
fn the_jacobians_that_the_divergence_is_read_from_are_those_of_the_velocity() {
    let field = field(wind_and_swirls(), &scenes()[7].1);
    let span = field.span(0.7, 0.1);
    let mut rng = CounterRng::new(Seed(2));
    for _ in 0..200 {
        let p = random_point(&mut rng);
        let exact = span.velocity(Dual::point(p), Dual::constant(0.3)).map(|x| x.gradient);
        let difference = curlsmoke::flow::curl::central_jacobian(|q| span.velocity(q, 0.3), p, 1e-5);
        let size = exact.iter().flatten().fold(1.0f64, |m, x| m.max(x.abs()));
        for (a, b) in exact.iter().flatten().zip(difference.iter().flatten()) {
            // The velocity's second derivatives jump at cell faces, which costs an order there.
            assert!((a - b).abs() < 2e-3 * size, "{p:?}: {a} {b}");
        }
    }
}

/// A knobbly ball, not convex and not a primitive, as the mesh of a file would be.
fn knobbly_mesh() -> Arc<PlacedSdf> {
    let (rings, sectors) = (48u32, 96u32);
    let point = |i: u32, j: u32| {
        let (theta, phi) = (
            std::f64::consts::PI * f64::from(i) / f64::from(rings),
            std::f64::consts::TAU * f64::from(j % sectors) / f64::from(sectors),
        );
        let radius = 0.4 * (1.0 + 0.25 * theta.sin().powi(3) * (3.0 * phi).cos());
        (radius * DVec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin())).as_vec3()
    };
    let mut positions = vec![point(0, 0), point(rings, 0)];
    positions.extend((1..rings).flat_map(|i| (0..sectors).map(move |j| (i, j))).map(|(i, j)| point(i, j)));
    let index = |i: u32, j: u32| match i {
        0 => 0,
        i if i == rings => 1,
        i => 2 + (i - 1) * sectors + j % sectors,
    };
    let quads = (0..rings).flat_map(|i| (0..sectors).map(move |j| (i, j)));
    let triangles = quads.flat_map(|(i, j)| {
        let [a, b, c, d] = [index(i, j), index(i, j + 1), index(i + 1, j + 1), index(i + 1, j)];
        [[a, b, c], [a, c, d]].into_iter().filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0])
    });
    let mesh = Mesh::try_new(positions, Vec::new(), triangles.collect()).unwrap();
    let sdf = MeshSdf::sample(&mesh, Some(0.02), 1 << 30).unwrap();
    Arc::new(PlacedSdf::new(Sdf::Mesh(Arc::new(sdf)), Similarity::IDENTITY))
}

#[test]
fn a_mesh_is_a_wall_like_any_other() {
    let field = VelocityField::new(wind_and_swirls(), build_obstacles(vec![knobbly_mesh()]));
    let span = field.span(0.7, 0.1);
    let mut rng = CounterRng::new(Seed(12));
    let (worst, rms, fastest) = passing(&field, &span, &mut rng, 500);
    println!(
        "mesh: |v·n| on the wall at most {:.1e} of the RMS speed {rms:.2} m/s there, fastest {fastest:.2}",
        worst / rms
    );
    assert!(worst < 1e-5 * rms && fastest < 8.0, "{worst} {fastest}");

    let (mut divergence, mut square, mut count) = (0.0, 0.0, 0);
    while count < 500 {
        let p = random_point(&mut rng);
        if field.distance(p, 0.0) > 0.01 {
            let j = curlsmoke::flow::curl::central_jacobian(|q| span.velocity(q, 0.3), p, 1e-5);
            divergence += (j[0][0] + j[1][1] + j[2][2]).powi(2);
            square += j.iter().flatten().map(|x| x * x).sum::<f64>();
            count += 1;
        }
    }
    println!("mesh: RMS |∇·v| by differences {:.1e} of RMS |∇v|", (divergence / square).sqrt());
    assert!(divergence < 1e-10 * square, "{divergence} {square}");

    let points: Vec<[f32; 3]> = (0..2000)
        .map(|_| random_point(&mut rng).map(|x| x as f32))
        .filter(|p| field.distance(p.map(f64::from), 0.0) > 1e-3)
        .collect();
    let worst = run_kernel(WorstDifference { span: &span, points: &points });
    println!("mesh: lanes differ by at most {worst:.1e}");
    assert!(worst < 1e-3);
}

/// The largest |v·n| on the walls, the RMS speed there and the largest speed.
fn passing(field: &VelocityField, span: &FieldSpan, rng: &mut CounterRng, count: usize) -> (f64, f64, f64) {
    let points = on_walls(field, rng, count);
    let (mut worst, mut square, mut fastest) = (0.0f64, 0.0, 0.0f64);
    for (p, n) in &points {
        let v = span.velocity(*p, 0.6);
        worst = worst.max(dot(v, *n).abs());
        square += dot(v, v);
        fastest = fastest.max(length(v));
    }
    (worst, (square / count as f64).sqrt(), fastest)
}

fn on_walls(field: &VelocityField, rng: &mut CounterRng, count: usize) -> Vec<([f64; 3], [f64; 3])> {
    let mut points = Vec::new();
    while points.len() < count {
        let mut p = DVec3::from_array(random_point(rng));
        let solids: Vec<_> = field.obstacles().iter().flat_map(|o| o.solids()).collect();
        let pick = (rng.uniform() * solids.len() as f32) as usize;
        for _ in 0..40 {
            let jet = solids[pick].at(p.to_array());
            p -= DVec3::from_array(jet.gradient) * jet.value;
        }
        let others_are_outside = solids.iter().enumerate().all(|(i, s)| i == pick || s.distance(p.to_array()) > 1e-3);
        if p.length() < 3.0 && others_are_outside {
            points.push((p.to_array(), solids[pick].at(p.to_array()).gradient));
        }
    }
    points
}

#[test]
fn nothing_passes_the_walls() {
    for (name, primitives) in scenes().into_iter().skip(1) {
        let field = field(wind_and_swirls(), &primitives);
        let span = field.span(0.7, 0.1);
        let (worst, rms, fastest) = passing(&field, &span, &mut CounterRng::new(Seed(3)), 1000);
        println!(
            "{name}: |v·n| on the wall at most {:.1e} of the RMS speed {rms:.2} m/s there, fastest {fastest:.2}",
            worst / rms
        );
        assert!(worst < 1e-5 * rms, "{name}");
        assert!(fastest < 8.0, "{name}: {fastest} m/s");
    }
}

#[test]
fn the_velocity_does_not_jump_across_the_ridge_between_obstacles() {
    let primitives =
        [sphere(DVec3::ZERO, 0.4), sphere(DVec3::new(1.0, 0.0, 0.0), 0.3), sphere(DVec3::new(0.4, 0.9, 0.0), 0.3)];
    let field = field(wind_and_swirls(), &primitives);
    let solids: Vec<_> = field.obstacles().iter().flat_map(|o| o.solids().to_vec()).collect();
    assert_eq!(field.obstacles().len(), 3);
    let span = field.span(0.2, 0.1);
    let mut rng = CounterRng::new(Seed(9));
    let (mut jump, mut square, mut count) = (0.0f64, 0.0, 0);
    while count < 2000 {
        let mut p = DVec3::from_array(random_point(&mut rng));
        let distances = |p: DVec3| [0, 1, 2].map(|i| solids[i].at(p.to_array()));
        let mut order = [0, 1, 2];
        // To the ridge of the two closest: where their distances are equal.
        for _ in 0..30 {
            let d = distances(p);
            order.sort_by(|&a, &b| d[a].value.total_cmp(&d[b].value));
            let (a, b) = (d[order[0]], d[order[1]]);
            let across = DVec3::from_array(b.gradient) - DVec3::from_array(a.gradient);
            p -= across * ((b.value - a.value) / across.length_squared().max(1e-3));
        }
        let d = distances(p);
        let (a, b) = (d[order[0]], d[order[1]]);
        if (b.value - a.value).abs() > 1e-9 || a.value < 1e-3 || p.length() > 3.0 {
            continue;
        }
        let across = (DVec3::from_array(b.gradient) - DVec3::from_array(a.gradient)).normalize();
        let step = across * 1e-7;
        let (left, right) = (span.velocity((p - step).to_array(), 0.0), span.velocity((p + step).to_array(), 0.0));
        jump = jump.max((DVec3::from_array(left) - DVec3::from_array(right)).length());
        square += dot(left, left);
        count += 1;
    }
    let rms = (square / f64::from(count)).sqrt();
    println!("velocity jump across the ridges of three spheres: {:.1e} of the RMS speed {rms:.2} m/s", jump / rms);
    assert!(jump < 1e-3 * rms);
}

#[test]
fn wind_passes_between_obstacles_through_rings_and_along_the_ground() {
    for width in [0.1, 0.3, 1.0] {
        // Two balls abreast in a wind along y; the flux through the part of the plane y = 0 between them.
        let radius = 0.5;
        let place =
            |x: f64| Arc::new(PlacedSdf::new(Sdf::Primitive(sphere(DVec3::X * x, radius)), Similarity::IDENTITY));
        let half = 0.5 * width;
        let field = VelocityField::new(
            vec![wind([0.0, 1.0, 0.0])],
            build_obstacles(vec![place(-radius - half), place(radius + half)]),
        );
        let n = 400;
        let (mut mean, mut fastest) = (0.0, 0.0f64);
        for i in 0..n {
            let v = field.velocity([half * (2.0 * (f64::from(i) + 0.5) / f64::from(n) - 1.0), 0.0, 0.0], 0.0);
            mean += v[1] / f64::from(n);
            fastest = fastest.max(length(v));
        }
        println!("gap of {width} m between balls of 0.5 m: mean speed {mean:.2} of the wind's, fastest {fastest:.2}");
        assert!(mean > 0.5 && fastest < 8.0, "{width}: {mean} {fastest}");
    }

    let ring = Primitive::Torus(Torus { center: DVec3::ZERO, axis: DVec3::Y, major_radius: 0.5, minor_radius: 0.15 });
    let ring = Arc::new(PlacedSdf::new(Sdf::Primitive(ring), Similarity::IDENTITY));
    let field = VelocityField::new(vec![wind([0.0, 1.0, 0.0])], build_obstacles(vec![ring]));
    let n = 400;
    let flux = (0..n)
        .map(|i| {
            let r = 0.35 * (f64::from(i) + 0.5) / f64::from(n);
            2.0 * r * field.velocity([r * 0.8, 0.0, r * 0.6], 0.0)[1] / 0.35 / f64::from(n)
        })
        .sum::<f64>();
    println!("mean speed through the hole of a ring: {flux:.2} of the wind's");
    assert!(flux > 0.8 && flux < 3.0);

    let ground = Primitive::HalfSpace(HalfSpace { point: DVec3::ZERO, normal: DVec3::Y });
    let ground = Arc::new(PlacedSdf::new(Sdf::Primitive(ground), Similarity::IDENTITY));
    let field = VelocityField::new(vec![wind([1.0, 0.0, 0.5])], build_obstacles(vec![ground]));
    for height in [0.0, 0.1, 3.0] {
        assert_eq!(field.velocity([5.0, height, -7.0], 0.0), [1.0, 0.0, 0.5]);
    }
}

struct WorstDifference<'a, 'b> {
    span: &'a FieldSpan<'b>,
    points: &'a [[f32; 3]],
}

impl Kernel for WorstDifference<'_, '_> {
    type Output = f64;
    #[inline(always)]
    fn run<L: Batch>(self, zero: L) -> f64 {
        let mut worst = 0.0f64;
        for chunk in self.points.chunks(L::WIDTH) {
            let axis = |a: usize| {
                let values: Vec<f32> = chunk.iter().map(|p| p[a]).collect();
                zero.load(&values)
            };
            let v = self.span.velocity([axis(0), axis(1), axis(2)], zero.lit(0.4));
            for (i, p) in chunk.iter().enumerate() {
                let truth = self.span.velocity(p.map(f64::from), 0.4);
                let error: [f64; 3] = std::array::from_fn(|a| v[a].lane(i) - truth[a]);
                worst = worst.max(length(error) / length(truth).max(1.0));
            }
        }
        worst
    }
}

#[test]
fn lanes_agree_with_the_scalar_truth() {
    for (name, primitives) in scenes() {
        let field = field(wind_and_swirls(), &primitives);
        let span = field.span(0.3, 0.05);
        let mut rng = CounterRng::new(Seed(7));
        let points: Vec<[f32; 3]> = (0..4000)
            .map(|_| random_point(&mut rng).map(|x| x as f32))
            .filter(|p| field.distance(p.map(f64::from), 0.0) > 1e-3)
            .collect();
        let worst = run_kernel(WorstDifference { span: &span, points: &points });
        println!("{name}: lanes differ by at most {worst:.1e}");
        assert!(worst < 5e-5, "{name}: {worst}");
    }
}

/// Two balls that melt into one.
fn melted(width: f64) -> Arc<PlacedSdf> {
    let balls = [sphere(DVec3::new(-0.3, 0.1, 0.0), 0.4), sphere(DVec3::new(0.35, -0.1, 0.1), 0.3)];
    let union = SmoothUnion::new(balls.map(|ball| (ball, Similarity::IDENTITY)), width);
    Arc::new(PlacedSdf::new(Sdf::SmoothUnion(Arc::new(union)), Similarity::IDENTITY))
}

#[test]
fn a_smooth_union_is_a_wall_like_any_other() {
    // With a blend that has a normal for equation 5, and with one that is a crease to the flow.
    for width in [0.3, 0.05] {
        let field = VelocityField::new(wind_and_swirls(), build_obstacles(vec![melted(width)]));
        let span = field.span(0.7, 0.1);
        let mut rng = CounterRng::new(Seed(13));
        let (worst, rms, fastest) = passing(&field, &span, &mut rng, 1000);
        println!("width {width}: |v·n| on the wall at most {:.1e} of {rms:.2} m/s, fastest {fastest:.2}", worst / rms);
        assert!(worst < 1e-5 * rms && fastest < 8.0, "{worst} {rms} {fastest}");
        let (mut worst, mut jump, mut count) = (0.0f64, 0.0f64, 0);
        while count < 2000 {
            let p = random_point(&mut rng);
            let d = field.distance(p, 0.0);
            if !(0.0..0.5).contains(&d) {
                continue;
            }
            let (trace, size) = divergence(span.velocity(Dual::point(p), Dual::constant(0.3)));
            worst = worst.max(trace.abs() / size.sqrt());
            // No jump either: over a micrometre the velocity changes as its derivatives say.
            let q = [p[0] + 1e-6, p[1], p[2]];
            let (v, w) = (span.velocity(p, 0.3), span.velocity(q, 0.3));
            jump = jump.max(length([0, 1, 2].map(|i| v[i] - w[i])) / (1e-6 * size.sqrt().max(1.0)));
            count += 1;
        }
        println!("width {width}: |∇·v|/|∇v| at most {worst:.1e}; differences {jump:.2} of what derivatives say");
        assert!(worst < 1e-10 && jump < 1.5, "{worst} {jump}");
        let points: Vec<[f32; 3]> = (0..2000)
            .map(|_| random_point(&mut rng).map(|x| x as f32))
            .filter(|p| field.distance(p.map(f64::from), 0.0) > 1e-3)
            .collect();
        let worst = run_kernel(WorstDifference { span: &span, points: &points });
        println!("width {width}: lanes differ by at most {worst:.1e}");
        assert!(worst < 1e-3);
    }
}

#[test]
fn a_smooth_union_holds_the_flow_as_a_container() {
    let wall = Wall { is_container: true, ..melted(0.3).into() };
    let field = VelocityField::new(wind_and_swirls(), build_obstacles(vec![wall]));
    let span = field.span(0.7, 0.1);
    let (worst, rms, fastest) = passing(&field, &span, &mut CounterRng::new(Seed(14)), 1000);
    println!("inside: |v·n| on the wall at most {:.1e} of {rms:.2} m/s, fastest {fastest:.2}", worst / rms);
    assert!(worst < 1e-5 * rms && rms > 0.05 && fastest < 8.0, "{worst} {rms} {fastest}");
}
