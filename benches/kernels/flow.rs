//! Noise, velocity with its curl, and steps of particles, beside the way in which others do them.

use crate::workload::Workload;
use curlsmoke::flow::field::VelocityField;
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
use curlsmoke::particles::advect::{CLASSICAL, Coordinates, MIDPOINT, Scheme, advance, evaluate};
use glam::DVec3;
use std::hint::black_box;
use std::sync::Arc;

/// Points at once.
const COUNT: usize = 1 << 14;
/// Fewer for what is slow.
const SCALAR_COUNT: usize = 1 << 10;
/// Length of a step [s].
const STEP: f64 = 1.0 / 24.0;
/// Time of the flow [s].
const TIME: f64 = 0.3;

/// The step that particles take unless told otherwise.
pub const MIDPOINT_STEP: Scheme = MIDPOINT;
/// The more exact one.
pub const CLASSICAL_STEP: Scheme = CLASSICAL;

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

/// Three noises with their Jacobian.
pub fn noise() -> Workload {
    let p = points(COUNT);
    Workload::new(COUNT, move || {
        black_box(run_kernel(Noise(black_box(&p))));
    })
}

/// Velocity at points: noise of that many octaves in a wind, perhaps round a sphere.
pub fn velocity(octave_count: u32, has_obstacle: bool) -> Workload {
    let (field, p, mut velocity) = (field(octave_count, has_obstacle), points(COUNT), points(COUNT));
    Workload::new(COUNT, move || evaluate(&field.span(TIME, 0.0), black_box(&p), &mut velocity))
}

/// The same one point at a time in double precision.
pub fn scalar_velocity(octave_count: u32, has_obstacle: bool) -> Workload {
    let (field, p) = (field(octave_count, has_obstacle), points(SCALAR_COUNT));
    Workload::new(SCALAR_COUNT, move || {
        let span = field.span(TIME, 0.0);
        let at = |i: usize| black_box(&p).each_ref().map(|axis| f64::from(axis[i]));
        black_box((0..SCALAR_COUNT).map(|i| span.velocity(at(i), 0.0)[0]).sum::<f64>());
    })
}

/// A step of all points, from the same places each time: particles that went on would come out of reach of the sphere.
pub fn steps(scheme: Scheme, octave_count: u32, has_obstacle: bool) -> Workload {
    let (field, start) = (field(octave_count, has_obstacle), points(COUNT));
    let mut p = start.clone();
    Workload::new(COUNT, move || {
        go_back(&mut p, &start);
        black_box(advance(&field.span(TIME, STEP), scheme, STEP, &mut p, 0..COUNT, None));
    })
}

fn go_back(p: &mut Coordinates, start: &Coordinates) {
    p.iter_mut().zip(start).for_each(|(p, start)| p.copy_from_slice(start));
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

/// Midpoint steps of all points through [`difference_curl`].
pub fn difference_steps() -> Workload {
    let (noise, start) = ([1, 2, 3].map(Perlin::new), points(SCALAR_COUNT));
    let (mut p, h) = (start.clone(), STEP as f32);
    Workload::new(SCALAR_COUNT, move || {
        go_back(&mut p, &start);
        (0..SCALAR_COUNT).for_each(|i| {
            let x = [0, 1, 2].map(|a| p[a][i]);
            let v = difference_curl(&noise, x);
            let w = difference_curl(&noise, [0, 1, 2].map(|a| x[a] + 0.5 * h * v[a]));
            (0..3).for_each(|a| p[a][i] += h * w[a]);
        });
        black_box(&p);
    })
}
