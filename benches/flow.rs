//! Noise, velocity with its curl, and steps of particles: throughput of one thread, and of all.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use curlsmoke::flow::field::{FieldSpan, Potential, Source, VelocityField};
use curlsmoke::flow::flow_noise::Spin;
use curlsmoke::flow::noise::{gradient_noise, seed_words};
use curlsmoke::flow::obstacles::build_obstacles;
use curlsmoke::flow::octaves::{OctavesSettings, kolmogorov_gain, octaves};
use curlsmoke::geometry::primitive::{Primitive, Sphere};
use curlsmoke::geometry::sdf::{PlacedSdf, Sdf};
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::lanes::{Kernel, Lanes, run_kernel};
use curlsmoke::math::real::Lane;
use curlsmoke::math::space::Similarity;
use curlsmoke::particles::advect::{CLASSICAL, Coordinates, MIDPOINT, advance, evaluate};
use fearless_simd::Simd;
use glam::DVec3;
use std::hint::black_box;
use std::sync::Arc;

const COUNT: usize = 1 << 14;

fn field(octave_count: u32, has_obstacle: bool) -> VelocityField {
    let settings = OctavesSettings {
        length_scale: 0.5,
        speed: 0.6,
        octaves: octave_count,
        lacunarity: 2.0,
        gain: kolmogorov_gain(2.0),
        spin_rate: 0.5,
        scroll: [0.0; 3],
        seed: Seed(1),
        ..Default::default()
    };
    let mut sources: Vec<Source> = octaves(&settings).into_iter().map(|o| Potential::Octave(o).into()).collect();
    sources.push(Source::wind([0.0, 0.8, 0.0]));
    let ball = Primitive::Sphere(Sphere { center: DVec3::ZERO, radius: 0.4 });
    let solids = has_obstacle.then(|| Arc::new(PlacedSdf::new(Sdf::Primitive(ball), Similarity::IDENTITY)));
    VelocityField::new(sources, build_obstacles(solids))
}

/// Points within a metre of the origin.
fn points(count: usize) -> Coordinates {
    let mut rng = CounterRng::new(Seed(2));
    [0, 1, 2].map(|_| (0..count).map(|_| 2.0 * rng.uniform() - 1.0).collect())
}

struct Noise<'a>(&'a Coordinates);

impl Kernel for Noise<'_> {
    type Output = f64;
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> f64 {
        let [x, y, z] = self.0;
        let zero = Lanes::splat(simd, 0.0);
        let mut sum = zero;
        for i in (0..x.len()).step_by(Lanes::<S>::WIDTH) {
            let p = [Lanes::load(simd, &x[i..]), Lanes::load(simd, &y[i..]), Lanes::load(simd, &z[i..])];
            let psi = gradient_noise(p, [0; 3], seed_words(zero, [1, 2]), Spin::advanced(Spin::from_turns(0.1), zero));
            for c in 0..3 {
                sum = sum + psi.value[c] + psi.jacobian[c][0] + psi.jacobian[c][1] + psi.jacobian[c][2];
            }
        }
        sum.lane(0)
    }
}

fn scalar(span: &FieldSpan, p: &Coordinates) -> f64 {
    (0..p[0].len()).map(|i| span.velocity([0, 1, 2].map(|a| f64::from(p[a][i])), 0.0)[0]).sum()
}

fn flow(c: &mut Criterion) {
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let p = points(COUNT);
    let mut group = c.benchmark_group("flow");
    group.throughput(Throughput::Elements(COUNT as u64));
    group.bench_function("noise, 3 components with Jacobian", |b| b.iter(|| run_kernel(Noise(black_box(&p)))));

    let mut velocity = points(COUNT);
    for (name, octave_count, has_obstacle) in
        [("curl, 3 octaves", 3, false), ("curl, 3 octaves, sphere", 3, true), ("curl, 4 octaves, sphere", 4, true)]
    {
        let field = field(octave_count, has_obstacle);
        let span = field.span(0.3, 0.0);
        // Through the pool once, not once an iteration.
        group.bench_function(name, |b| one_thread.install(|| b.iter(|| evaluate(&span, black_box(&p), &mut velocity))));
        group.bench_function(format!("{name}, scalar f64"), |b| b.iter(|| scalar(&span, black_box(&p))));
    }

    let field = field(3, true);
    let span = field.span(0.3, 1.0 / 24.0);
    for (name, scheme) in [("rk2", MIDPOINT), ("rk4", CLASSICAL)] {
        let mut moving = p.clone();
        group.bench_function(format!("advect {name}, one thread"), |b| {
            one_thread.install(|| b.iter(|| advance(&span, scheme, 1.0 / 24.0, &mut moving, 0..COUNT, None)));
        });
        group.bench_function(format!("advect {name}, all threads"), |b| {
            b.iter(|| advance(&span, scheme, 1.0 / 24.0, &mut moving, 0..COUNT, None));
        });
    }
    group.finish();
}

criterion_group!(benches, flow);
criterion_main!(benches);
