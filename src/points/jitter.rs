//! Lattices whose points are moved a little: at random, or along divergence-free vector noise, which brings no two of them
//! together, for it has neither sources nor sinks.

use crate::flow::bounded::{Ball, BoundedByBall};
use crate::flow::dfvn::{Function, values_and_field};
use crate::flow::reproject::{Integrator, Repetition, Reprojection, Trace};
use crate::flow::simplex::{Simplex, Slope};
use crate::math::hash::{CounterRng, Seed};
use crate::math::parallel;
use crate::math::real::Lane;
use crate::points::{PointSet, lattice};

/// How a lattice is moved along noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurlJitter {
    /// Size of the noise [lattice spacings], > 0.
    pub length: f64,
    /// Time of the one step, at which noise would have moved points this far, were its speed the root mean square of its
    /// gradients [mean distances to the 3ⁿ − 1 neighbours].
    pub step: f64,
    /// Which noise.
    pub seed: Seed,
    /// How far the noise itself has moved [lattice spacings]: each of its functions goes a way of its own.
    pub drift: f64,
    /// Keeps points in a ball round the middle of the cube, where they begin in it.
    pub ball: Option<BallBound>,
}

/// A ball that points stay in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallBound {
    /// Its radius, in edges of the cube.
    pub radius: f64,
    /// How deep below its wall the noise is free, in edges of the cube; at most the radius.
    pub width: f64,
}

impl CurlJitter {
    /// Settings by measurement for 2 to 7 dimensions and lattices of any size: in three and four dimensions steps about as long
    /// as the published median distance to the closest point allows, beyond four longer ones, which cost it little.
    pub fn best(dimension: usize) -> Self {
        let (length, step) = BEST[dimension - 2];
        Self { length, step, seed: Seed(0), drift: 0.0, ball: None }
    }

    /// The lattice of `per_axis` points along each axis, moved; with a ball only those points that begin in it.
    pub fn apply(&self, dimension: usize, per_axis: u32) -> PointSet {
        let start = lattice(dimension, per_axis);
        match dimension {
            2 => self.moved::<2>(&start, per_axis),
            3 => self.moved::<3>(&start, per_axis),
            4 => self.moved::<4>(&start, per_axis),
            5 => self.moved::<5>(&start, per_axis),
            6 => self.moved::<6>(&start, per_axis),
            _ => self.moved::<7>(&start, per_axis),
        }
    }

    fn moved<const N: usize>(&self, start: &PointSet, per_axis: u32) -> PointSet {
        let spacing = 1.0 / f64::from(per_axis);
        let bound = self.ball.map(|ball| (Ball { center: [0.5; N], radius: ball.radius }, ball.width));
        let mut rng = CounterRng::new(self.seed.derive(DRIFT));
        let inner = std::array::from_fn(|i| Drifted {
            noise: Simplex::new(self.length * spacing, self.seed.derive(i as u64)),
            by: direction(&mut rng).map(|x| x * self.drift * spacing),
        });
        let functions = BoundedByBall { inner, bound };
        // One step that is put back once, as in section 5.1; in a ball several and twice, so that nothing is left beyond its
        // wall and no point comes out elsewhere when the noise has moved a little.
        let is_bound = u32::from(bound.is_some());
        let reprojection = Reprojection::LeastNorm(Repetition { steps: 1 + is_bound, tolerance: 0.0 });
        let trace = Trace { steps: 1 + 63 * is_bound, integrator: Integrator::RungeKutta, reprojection };
        let time = self.step * mean_neighbour_distance(N as u32) * spacing;
        let is_in = |p: &[f64; N]| {
            let square: f64 = p.iter().map(|x| (x - 0.5) * (x - 0.5)).sum();
            self.ball.is_none_or(|ball| square <= ball.radius * ball.radius)
        };
        let end = |p: [f64; N]| {
            let (values, slope) = values_and_field(&functions, p);
            let way = time.abs() * slope.iter().map(|x| x * x).sum::<f64>().sqrt();
            if way < STILL * spacing {
                return std::array::from_fn(|i| p[i] + time * slope[i]);
            }
            trace.end_knowing(&functions, p, values, slope, time)
        };
        let coordinates = parallel::gather(start.len(), |n, coordinates| {
            let point = std::array::from_fn(|i| start.point(n)[i]);
            if is_in(&point) {
                coordinates.extend(end(point));
            }
        });
        PointSet { dimension: N, coordinates }
    }
}

/// Ways shorter than this [lattice spacings] are straight to far below rounding of what one sees of them: from five dimensions on
/// many are.
const STILL: f64 = 1e-6;

/// Root of the directions in which functions drift.
const DRIFT: u64 = 0x0064_7269_6674;

/// Length and step of [`CurlJitter::best`] for 2 to 7 dimensions. Noise as large as the spacing would be alike at all points.
const BEST: [(f64, f64); 6] = [(0.8, 0.3), (0.8, 0.3), (0.8, 0.9), (0.8, 2.0), (0.8, 4.0), (0.8, 8.0)];

/// Noise that has moved.
#[derive(Clone, Copy)]
struct Drifted<const N: usize> {
    noise: Simplex<N>,
    by: [f64; N],
}

impl<const N: usize> Function<N> for Drifted<N> {
    fn at<L: Lane>(&self, mut p: [L; N]) -> Slope<L, N> {
        for (x, by) in p.iter_mut().zip(self.by) {
            *x = *x - x.lit(by);
        }
        self.noise.at(p)
    }
}

/// Uniform on the unit sphere, by rejection.
fn direction<const N: usize>(rng: &mut CounterRng) -> [f64; N] {
    loop {
        let p: [f64; N] = std::array::from_fn(|_| 2.0 * f64::from(rng.uniform()) - 1.0);
        let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length > 0.01 && length <= 1.0 {
            return p.map(|x| x / length);
        }
    }
}

/// Mean distance from a point of a lattice of unit spacing to the 3ⁿ − 1 others round it (section 5.1).
pub fn mean_neighbour_distance(n: u32) -> f64 {
    let mut choose = 1.0;
    let mut sum = 0.0;
    for i in 1..=n {
        choose *= f64::from(n - i + 1) / f64::from(i);
        sum += 2f64.powi(i as i32) * choose * f64::from(i).sqrt();
    }
    sum / (3f64.powi(n as i32) - 1.0)
}

/// The lattice with each point moved at random within the middle of its cell: a cube of `share` of the cell's edge, 0 to 1.
pub fn random_jitter(dimension: usize, per_axis: u32, share: f64, seed: Seed) -> PointSet {
    let mut set = lattice(dimension, per_axis);
    let spacing = 1.0 / f64::from(per_axis);
    parallel::for_each_mut(&mut set.coordinates, |i, x| {
        *x += (f64::from(seed.uniform(i as u64)) - 0.5) * share * spacing;
    });
    set
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::points::nearest::{least_and_median, nearest_distances};

    #[test]
    fn the_mean_distance_to_neighbours_is_that_of_all_of_them() {
        for n in 1..=5u32 {
            let count = 3u32.pow(n);
            let length = |mut i: u32| {
                let mut square = 0;
                for _ in 0..n {
                    square += u32::from(i % 3 != 1);
                    i /= 3;
                }
                f64::from(square).sqrt()
            };
            let mean = (0..count).map(length).sum::<f64>() / f64::from(count - 1);
            assert!((mean_neighbour_distance(n) - mean).abs() < 1e-12, "{n}");
        }
    }

    #[test]
    fn points_keep_their_distances_better_than_by_chance() {
        // Medians that were published (table 1).
        for (dimension, published) in [(3, 0.083), (4, 0.081)] {
            let [curl_least, curl] =
                least_and_median(&mut nearest_distances(&CurlJitter::best(dimension).apply(dimension, 10)));
            let median =
                |seed| least_and_median(&mut nearest_distances(&random_jitter(dimension, 10, 1.0, Seed(seed))))[1];
            let random = (0..8).map(median).sum::<f64>() / 8.0;
            println!("{dimension} dimensions: {curl:.4} ({curl_least:.4}), by chance {random:.4}");
            assert!(curl >= published && curl > 1.1 * random && (random - 0.069).abs() < 0.05 * 0.069);
            // And it is no lattice any more.
            assert!(curl < 0.095);
        }
    }

    /// Largest distance to the middle, and largest move from frame to frame.
    fn animate(dimension: usize, per_axis: u32, frames: u32, speed: f64) -> [f64; 2] {
        let ball = BallBound { radius: 0.4, width: 0.35 };
        let at = |frame: u32| {
            let drift = speed * f64::from(frame);
            CurlJitter { drift, ball: Some(ball), ..CurlJitter::best(dimension) }.apply(dimension, per_axis)
        };
        let (mut before, mut furthest, mut fastest) = (at(0), 0.0f64, 0.0f64);
        assert!(before.len() > 30);
        for frame in 1..frames {
            let now = at(frame);
            assert_eq!(now.len(), before.len());
            for i in 0..now.len() {
                let length = |a: &[f64], b: &dyn Fn(usize) -> f64| {
                    (0..dimension).map(|k| (a[k] - b(k)).powi(2)).sum::<f64>().sqrt()
                };
                furthest = furthest.max(length(now.point(i), &|_| 0.5));
                fastest = fastest.max(length(now.point(i), &|k| before.point(i)[k]));
            }
            before = now;
        }
        [furthest, fastest]
    }

    #[test]
    fn in_a_ball_nothing_appears_vanishes_or_jumps() {
        for (dimension, per_axis, frames) in [(2, 30, 300), (3, 9, 100), (4, 7, 12)] {
            let spacing = 1.0 / f64::from(per_axis);
            let [furthest, fastest] = animate(dimension, per_axis, frames, 0.005);
            // Near a saddle of the flow a little noise makes a large difference, but what moves less in less time is no jump.
            let [_, slow] = animate(dimension, per_axis, frames.div_ceil(4), 0.0005);
            let [fastest, slow] = [fastest, slow].map(|way| way / spacing);
            println!(
                "{dimension} dimensions: {furthest:.9} from the middle, {fastest:.3} and {slow:.4} spacings a frame"
            );
            assert!(furthest <= 0.4 + 1e-9 && fastest < 0.8 && slow < 0.2 * fastest, "{dimension}");
            assert!(fastest > 1e-3);
        }
    }
}
