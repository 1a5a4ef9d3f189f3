//! Noise, velocity with its curl, and steps of particles: throughput of one thread, and of all.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use curlsmoke::flow::field::{FieldSpan, VelocityField};
use curlsmoke::flow::flow_noise::Spin;
use curlsmoke::flow::noise::{gradient_noise, seed_words};
use curlsmoke::flow::obstacles::build_obstacles;
use curlsmoke::flow::octaves::{OctavesSettings, kolmogorov_gain, octaves};
use curlsmoke::flow::source::{Potential, Source};
use curlsmoke::geometry::primitive::{Primitive, Sphere};
use curlsmoke::geometry::sdf::{PlacedSdf, Sdf};
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::lanes::{Batch, Kernel, run_kernel};
use curlsmoke::math::space::Similarity;
use curlsmoke::particles::advect::{CLASSICAL, Coordinates, MIDPOINT, advance, advanced, evaluate};
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
    fn run<L: Batch>(self, zero: L) -> f64 {
        let [x, y, z] = self.0;
        let mut sum = zero;
        for i in (0..x.len()).step_by(L::WIDTH) {
            let p = [zero.load(&x[i..]), zero.load(&y[i..]), zero.load(&z[i..])];
            let psi = gradient_noise(p, [0; 3], seed_words(zero, [1, 2]), Spin::advanced(Spin::from_turns(0.1), zero));
            for c in 0..3 {
                sum = sum + psi.value[c] + psi.jacobian[c][0] + psi.jacobian[c][1] + psi.jacobian[c][2];
            }
        }
        sum.lane(0)
    }
}

/// Noise as it is most often had: permutation table, twelve gradients, value alone, one point at a time (Perlin 2002).
struct Perlin([u8; 512]);

impl Perlin {
    fn new(seed: u64) -> Self {
        let mut table: Vec<u8> = (0..=255).collect();
        for i in (1..256).rev() {
            table.swap(i, (Seed(seed).word(i as u64) % (i as u64 + 1)) as usize);
        }
        Self(std::array::from_fn(|i| table[i & 255]))
    }

    fn value(&self, p: [f32; 3]) -> f32 {
        let cell = p.map(|x| x.floor() as i32 as usize & 255);
        let f = p.map(|x| x - x.floor());
        let [u, v, w] = f.map(|t| t * t * t * (t * (t * 6.0 - 15.0) + 10.0));
        let corner = |i: usize, j: usize, k: usize| {
            let at = |n: usize| usize::from(self.0[n & 511]);
            let hash = at(at(at(cell[0] + i) + cell[1] + j) + cell[2] + k) & 15;
            let [x, y, z] = [f[0] - i as f32, f[1] - j as f32, f[2] - k as f32];
            let a = if hash < 8 { x } else { y };
            let b = if hash < 4 {
                y
            } else if hash == 12 || hash == 14 {
                x
            } else {
                z
            };
            (if hash & 1 == 0 { a } else { -a }) + (if hash & 2 == 0 { b } else { -b })
        };
        let mix = |t: f32, a: f32, b: f32| a + t * (b - a);
        let row = |j: usize, k: usize| mix(u, corner(0, j, k), corner(1, j, k));
        mix(w, mix(v, row(0, 0), row(1, 0)), mix(v, row(0, 1), row(1, 1)))
    }
}

/// The curl of four octaves by central differences, as in the paper of 2007.
fn difference_curl(noise: &[Perlin; 3], p: [f32; 3]) -> [f32; 3] {
    const STEP: f32 = 1e-3;
    let slope = |c: usize, axis: usize| {
        let (mut frequency, mut amplitude, mut sum) = (2.0, 0.3, 0.0);
        for _ in 0..4 {
            let (mut a, mut b) = (p, p);
            a[axis] -= STEP;
            b[axis] += STEP;
            sum += amplitude * (noise[c].value(b.map(|x| x * frequency)) - noise[c].value(a.map(|x| x * frequency)));
            frequency *= 2.0;
            amplitude *= 0.4;
        }
        sum / (2.0 * STEP)
    };
    [slope(2, 1) - slope(1, 2), slope(0, 2) - slope(2, 0), slope(1, 0) - slope(0, 1)]
}

/// A midpoint step of all points.
fn difference_step(noise: &[Perlin; 3], p: &mut Coordinates, h: f32) {
    for i in 0..p[0].len() {
        let x = [0, 1, 2].map(|a| p[a][i]);
        let v = difference_curl(noise, x);
        let w = difference_curl(noise, [0, 1, 2].map(|a| x[a] + 0.5 * h * v[a]));
        (0..3).for_each(|a| p[a][i] += h * w[a]);
    }
}

/// A midpoint step of all points, one at a time in double precision.
fn scalar_step(span: &FieldSpan, p: &mut Coordinates, h: f32) {
    for i in 0..p[0].len() {
        let q = advanced(span, MIDPOINT, h, [0, 1, 2].map(|a| f64::from(p[a][i])), 0.0);
        (0..3).for_each(|a| p[a][i] = q[a] as f32);
    }
}

/// As many multiply-adds as the processor can start: chains that do not wait for each other.
struct Peak;

/// Chains, and links of each.
const CHAINS: usize = 16;
const LINKS: usize = 1 << 12;

impl Kernel for Peak {
    /// A number that depends on all, and how many there are side by side.
    type Output = (f64, usize);
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn run<L: Batch>(self, zero: L) -> (f64, usize) {
        let (factor, term) = (zero.lit(black_box(0.999)), zero.lit(black_box(0.001)));
        let mut chains = [zero.lit(0.5); CHAINS];
        for _ in 0..LINKS {
            for k in 0..CHAINS {
                chains[k] = factor.mul_add(chains[k], term);
            }
        }
        let mut sum = chains[0];
        for k in 1..CHAINS {
            sum = sum + chains[k];
        }
        (sum.lane(0), L::WIDTH)
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

/// Steps of the midpoint rule through four octaves without walls: ours, and the ways that others do it.
fn steps(c: &mut Criterion) {
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let mut group = c.benchmark_group("particle steps, rk2, 4 octaves");
    group.throughput(Throughput::Elements(COUNT as u64));
    let (_, width) = run_kernel(Peak);
    group.throughput(Throughput::Elements((CHAINS * LINKS * width) as u64));
    group.bench_function("multiply-adds at peak", |b| b.iter(|| run_kernel(Peak)));
    group.throughput(Throughput::Elements(COUNT as u64));
    let h = 1.0 / 24.0;
    let field = field(4, false);
    let span = field.span(0.3, f64::from(h));
    let mut p = points(COUNT);
    group.bench_function("lanes, one thread", |b| {
        one_thread.install(|| b.iter(|| advance(&span, MIDPOINT, f64::from(h), &mut p, 0..COUNT, None)));
    });
    group.bench_function("lanes, all threads", |b| {
        b.iter(|| advance(&span, MIDPOINT, f64::from(h), &mut p, 0..COUNT, None));
    });
    group.bench_function("scalar f64", |b| b.iter(|| scalar_step(&span, &mut p, h)));
    let noise = [1, 2, 3].map(Perlin::new);
    group.bench_function("central differences of scalar noise", |b| b.iter(|| difference_step(&noise, &mut p, h)));
    group.finish();
}

criterion_group!(benches, flow, steps);
criterion_main!(benches);
