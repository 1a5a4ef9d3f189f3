//! Traces along divergence-free vector noise that stay on their track (Bærentzen et al. 2025, algorithm 1): the exact curve
//! never leaves the values that the functions have at its start, so after each step the point is put back on them.

use crate::flow::dfvn::{Functions, Slopes, field, values_and_field};
use crate::math::real::Lane;

/// Gradients whose angle has a sine below about this are taken for parallel: in double precision, and in lanes of single
/// precision, where less is lost in rounding.
const PARALLEL: [f64; 2] = [1e-5, 3e-3];

/// How a step is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Integrator {
    /// One evaluation, first order.
    Euler,
    /// The midpoint rule: two evaluations, second order.
    Midpoint,
    /// Classical Runge–Kutta: four evaluations, fourth order.
    RungeKutta,
}

/// How a point is put back.
///
/// Where gradients vanish or are parallel there is no way back: such a point stays where the step has brought it, and the
/// next step tries again. A way back that is longer than the step itself is not gone, for then the line that it follows says
/// nothing of the function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reprojection {
    /// Not at all.
    None,
    /// By the shortest way that mends all functions at once to first order (equations 10 and 11).
    LeastNorm(Repetition),
    /// By a Newton step towards one function after the other (equation 12).
    Newton(Repetition),
}

/// How often a point is put back after a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Repetition {
    /// At most so often.
    pub steps: u32,
    /// No more where all functions are as close as this to their values at the start; 0 for always all steps.
    pub tolerance: f64,
}

/// How a curve is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trace {
    /// Steps that the time is cut into.
    pub steps: u32,
    /// How each is taken.
    pub integrator: Integrator,
    /// How the point is put back after each.
    pub reprojection: Reprojection,
}

impl Trace {
    /// Where the point at `start` is after a time; backwards where that is negative.
    #[inline(always)]
    pub fn end<L: Lane, const N: usize>(&self, functions: &impl Functions<N>, start: [L; N], time: L) -> [L; N] {
        let (targets, first) = values_and_field(functions, start);
        self.end_knowing(functions, start, targets, first, time)
    }

    /// The same, where the values of the functions at the start and the field there are known.
    #[inline(always)]
    pub fn end_knowing<L: Lane, const N: usize>(
        &self,
        functions: &impl Functions<N>,
        start: [L; N],
        targets: [L; N],
        mut first: [L; N],
        time: L,
    ) -> [L; N] {
        let mut p = start;
        let h = time * time.lit(1.0 / f64::from(self.steps));
        for step in 0..self.steps {
            if step > 0 {
                first = field(functions, p);
            }
            p = self.step_along(functions, p, first, h, &targets);
        }
        p
    }

    /// One step of length `h` from `p`, which belongs where the functions have the values `targets`.
    #[inline(always)]
    pub fn step<L: Lane, const N: usize>(
        &self,
        functions: &impl Functions<N>,
        p: [L; N],
        h: L,
        targets: &[L; N],
    ) -> [L; N] {
        self.step_along(functions, p, field(functions, p), h, targets)
    }

    /// A step whose first evaluation is known. Compiled once for each kind of functions.
    #[inline(never)]
    fn step_along<L: Lane, const N: usize>(
        &self,
        functions: &impl Functions<N>,
        p: [L; N],
        first: [L; N],
        h: L,
        targets: &[L; N],
    ) -> [L; N] {
        h.outlined(
            #[inline(always)]
            || self.step_here(functions, p, first, h, targets),
        )
    }

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn step_here<L: Lane, const N: usize>(
        &self,
        functions: &impl Functions<N>,
        p: [L; N],
        first: [L; N],
        h: L,
        targets: &[L; N],
    ) -> [L; N] {
        let moved = |slope: &[L; N], by: L| {
            let mut q = p;
            for i in 0..N {
                q[i] = by.mul_add(slope[i], p[i]);
            }
            q
        };
        let half = h * h.lit(0.5);
        let mut slope = first;
        match self.integrator {
            Integrator::Euler => {}
            Integrator::Midpoint => slope = field(functions, moved(&slope, half)),
            Integrator::RungeKutta => {
                let second = field(functions, moved(&slope, half));
                let third = field(functions, moved(&second, half));
                let fourth = field(functions, moved(&third, h));
                for i in 0..N {
                    let middle = second[i] + third[i];
                    slope[i] = (slope[i] + fourth[i] + middle + middle) * h.lit(1.0 / 6.0);
                }
            }
        }
        let mut square = h.lit(0.0);
        for i in 0..N {
            square = slope[i].mul_add(slope[i], square);
        }
        self.reprojection.back(functions, moved(&slope, h), targets, square * h * h)
    }
}

impl Reprojection {
    /// `p` put back to where the functions have the values `targets`; no single correction is longer than the root of
    /// `longest_squared`.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    pub fn back<L: Lane, const N: usize>(
        &self,
        functions: &impl Functions<N>,
        mut p: [L; N],
        targets: &[L; N],
        longest_squared: L,
    ) -> [L; N] {
        let (repetition, is_newton) = match self {
            Self::None => return p,
            Self::LeastNorm(repetition) => (repetition, false),
            Self::Newton(repetition) => (repetition, true),
        };
        let zero = longest_squared.lit(0.0);
        for _ in 0..repetition.steps {
            if is_newton {
                for i in 0..N - 1 {
                    let found = functions.one(i, p);
                    let error = targets[i] - found.value;
                    let mut square = zero;
                    for k in 0..N {
                        square = found.gradient[k].mul_add(found.gradient[k], square);
                    }
                    let factor = quotient(error, square);
                    // Longer than the step: |error|² / |∇f|² above its square.
                    let factor = longest_squared.select_lt(factor * error, zero, factor);
                    for k in 0..N {
                        p[k] = factor.mul_add(found.gradient[k], p[k]);
                    }
                }
                if repetition.tolerance > 0.0 && !any_off(functions, p, targets, repetition.tolerance) {
                    break;
                }
                continue;
            }
            let all = functions.all(p);
            if repetition.tolerance > 0.0 && !is_off(&all.values, targets, repetition.tolerance) {
                break;
            }
            let way = least_norm(&all, targets);
            let mut square = zero;
            for k in 0..N {
                square = way[k].mul_add(way[k], square);
            }
            for k in 0..N {
                p[k] = longest_squared.select_lt(square, p[k], p[k] + way[k]);
            }
        }
        p
    }
}

#[inline(always)]
fn any_off<L: Lane, const N: usize>(f: &impl Functions<N>, p: [L; N], targets: &[L; N], tolerance: f64) -> bool {
    (0..N - 1).any(|i| (targets[i].lit(tolerance) - (f.one(i, p).value - targets[i]).abs()).any_lt(targets[i].lit(0.0)))
}

#[inline(always)]
fn is_off<L: Lane, const N: usize>(values: &[L; N], targets: &[L; N], tolerance: f64) -> bool {
    (0..N - 1).any(|i| (targets[i].lit(tolerance) - (values[i] - targets[i]).abs()).any_lt(targets[i].lit(0.0)))
}

/// `x / y` for y ≥ 0, 0 where y is.
#[inline(always)]
fn quotient<L: Lane>(x: L, y: L) -> L {
    let (zero, one) = (x.lit(0.0), x.lit(1.0));
    zero.select_lt(y, x, zero) / zero.select_lt(y, y, one)
}

/// The shortest v with J v = τ − f: v = Jᵀ(J Jᵀ)⁻¹(τ − f), by Cholesky's decomposition; 0 where rows of J are parallel.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
pub fn least_norm<L: Lane, const N: usize>(f: &Slopes<L, N>, targets: &[L; N]) -> [L; N] {
    let zero = targets[0].lit(0.0);
    let (one, parallel) = (zero.lit(1.0), zero.lit(PARALLEL[usize::from(L::WIDTH > 1)].powi(2)));
    let m = N - 1;
    let mut lower = [[zero; N]; N];
    let mut is_sound = one;
    let mut solved = [zero; N];
    for i in 0..m {
        for j in 0..=i {
            let mut sum = zero;
            for k in 0..N {
                sum = f.gradients[i][k].mul_add(f.gradients[j][k], sum);
            }
            let length = sum;
            for k in 0..j {
                sum = sum - lower[i][k] * lower[j][k];
            }
            if j < i {
                lower[i][j] = sum * lower[j][j];
                continue;
            }
            // What the earlier rows leave of this one; the diagonal keeps inverses.
            let is_free = (parallel * length).select_lt(sum, one, zero);
            is_sound = is_sound * is_free;
            lower[i][i] = one / zero.select_lt(is_free, sum, one).sqrt();
        }
        let mut right = targets[i] - f.values[i];
        for k in 0..i {
            right = right - lower[i][k] * solved[k];
        }
        solved[i] = right * lower[i][i];
    }
    for i in (0..m).rev() {
        for k in i + 1..m {
            solved[i] = solved[i] - lower[k][i] * solved[k];
        }
        solved[i] = solved[i] * lower[i][i];
    }
    let mut way = [zero; N];
    for k in 0..N {
        for i in 0..m {
            way[k] = f.gradients[i][k].mul_add(solved[i], way[k]);
        }
        way[k] = zero.select_lt(is_sound, way[k], zero);
    }
    way
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::dfvn::{FromFn, cross};
    use crate::flow::simplex::{Simplex, Slope};
    use crate::math::hash::{CounterRng, Seed};

    const ONCE: Repetition = Repetition { steps: 1, tolerance: 0.0 };
    const TEN: Repetition = Repetition { steps: 10, tolerance: 0.0 };

    fn trace(steps: u32, integrator: Integrator, reprojection: Reprojection) -> Trace {
        Trace { steps, integrator, reprojection }
    }

    fn noises<const N: usize, const M: usize>() -> [Simplex<N>; M] {
        std::array::from_fn(|i| Simplex::new(1.0, Seed(70 + i as u64)))
    }

    fn random<const N: usize>(rng: &mut CounterRng, size: f64) -> [f64; N] {
        std::array::from_fn(|_| (f64::from(rng.uniform()) - 0.5) * size)
    }

    fn distance<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
        a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    }

    #[allow(clippy::needless_range_loop, reason = "several arrays side by side")]
    fn check_least_norm<const N: usize, const M: usize>() {
        let (functions, mut rng) = (noises::<N, M>(), CounterRng::new(Seed(1)));
        for _ in 0..50 {
            let all = functions.all(random::<N>(&mut rng, 6.0));
            if cross(&all.gradients).iter().map(|x| x * x).sum::<f64>() < 1e-6 {
                continue;
            }
            let targets: [f64; N] = std::array::from_fn(|i| all.values[i] + 0.1 * (i as f64 - 0.7));
            let way = least_norm(&all, &targets);
            // It solves the equations, and is the shortest: along the curve it has no part.
            for i in 0..N - 1 {
                let reached: f64 = (0..N).map(|k| all.gradients[i][k] * way[k]).sum();
                assert!((reached - targets[i] + all.values[i]).abs() < 1e-9, "{N}");
            }
            let along: f64 = cross(&all.gradients).iter().zip(&way).map(|(a, b)| a * b).sum();
            let size = cross(&all.gradients).iter().map(|x| x * x).sum::<f64>().sqrt();
            assert!(along.abs() < 1e-7 * size * way.iter().map(|x| x.abs()).fold(1.0, f64::max), "{N}: {along}");
        }
    }

    #[test]
    fn the_way_back_solves_the_equations_and_is_the_shortest() {
        check_least_norm::<2, 1>();
        check_least_norm::<3, 2>();
        check_least_norm::<4, 3>();
        check_least_norm::<5, 4>();
        check_least_norm::<6, 5>();
    }

    #[test]
    fn where_gradients_are_parallel_or_vanish_points_stay() {
        let slopes = |a: [f64; 3], b: [f64; 3]| Slopes { values: [0.3, -0.2, 0.0], gradients: [a, b, [0.0; 3]] };
        for all in [
            slopes([1.0, 2.0, 3.0], [2.0, 4.0, 6.0]),
            slopes([0.0; 3], [0.0, 1.0, 0.0]),
            slopes([1.0, 0.0, 0.0], [0.0; 3]),
        ] {
            assert_eq!(least_norm(&all, &[0.0; 3]), [0.0; 3]);
        }
        // A function without any slope: nothing moves, nothing is lost.
        let flat = [FromFn(|_: [f64; 2]| Slope { value: 1.0, gradient: [0.0; 2] })];
        for back in [Reprojection::None, Reprojection::Newton(TEN), Reprojection::LeastNorm(TEN)] {
            let end = trace(7, Integrator::RungeKutta, back).end(&flat, [0.3, 0.4], 5.0);
            assert_eq!(end, [0.3, 0.4]);
        }
    }

    /// The curve through a point where x² + 2y² is 1, of which the period is known: c = (4y, −2x), whose square of the
    /// angular frequency is 8.
    #[test]
    fn closed_curves_close_with_reprojection_and_drift_without() {
        let ellipse = [FromFn(|p: [f64; 2]| Slope {
            value: p[0] * p[0] + 2.0 * p[1] * p[1],
            gradient: [2.0 * p[0], 4.0 * p[1]],
        })];
        let period = std::f64::consts::TAU / 8f64.sqrt();
        let start = [0.6, 0.4];
        let gap =
            |steps, integrator, back| distance(trace(steps, integrator, back).end(&ellipse, start, period), start);
        let kept = gap(2048, Integrator::RungeKutta, Reprojection::Newton(ONCE));
        let drift = gap(2048, Integrator::Euler, Reprojection::None);
        let euler = trace(2048, Integrator::Euler, Reprojection::Newton(ONCE)).end(&ellipse, start, period);
        let value = euler[0] * euler[0] + 2.0 * euler[1] * euler[1] - start[0] * start[0] - 2.0 * start[1] * start[1];
        println!(
            "a loop closes to {kept:.1e}; plain Euler misses by {drift:.1e}; Euler put back is off its track by {value:.1e}"
        );
        assert!(kept < 1e-6 && drift > 1e-3 && value.abs() < 1e-6);
    }

    #[test]
    fn closed_lines_of_noise_close_and_stay_on_their_values() {
        // A line round a hill of the noise in two dimensions: followed until it comes by its start again.
        let functions = noises::<2, 1>();
        let trace =
            trace(1, Integrator::RungeKutta, Reprojection::LeastNorm(Repetition { steps: 3, tolerance: 1e-13 }));
        let mut rng = CounterRng::new(Seed(11));
        let mut closed = 0;
        for _ in 0..40 {
            let start = random::<2>(&mut rng, 10.0);
            let targets = functions.all(start).values;
            let (h, mut p, mut nearest, mut has_left) = (2e-3, start, f64::MAX, false);
            for _ in 0..30_000 {
                let before = p;
                p = trace.step(&functions, p, h, &targets);
                let way: [f64; 2] = std::array::from_fn(|i| p[i] - before[i]);
                has_left |= distance(p, start) > 0.2;
                if has_left && distance(p, start) < 2.0 * distance(p, before) {
                    // Closest approach of the chord: across it.
                    let length = distance(p, before);
                    let along: f64 = (0..2).map(|i| (start[i] - before[i]) * way[i] / length).sum();
                    let across = ((distance(start, before)).powi(2) - along * along).max(0.0).sqrt();
                    nearest = nearest.min(across);
                    if (0.0..length).contains(&along) {
                        break;
                    }
                }
            }
            if has_left && nearest < 1e-2 {
                closed += 1;
                // Chords of a curve of curvature κ are off it by κ h²/8.
                assert!(nearest < 1e-5, "{nearest}");
            }
            assert!((functions.all(p).values[0] - targets[0]).abs() < 1e-12);
        }
        println!("{closed} of 40 lines closed");
        assert!(closed > 20);
    }

    fn check_tracks<const N: usize, const M: usize>(time: f64) {
        let (functions, mut rng) = (noises::<N, M>(), CounterRng::new(Seed(2)));
        let worst = |back: Reprojection, rng: &mut CounterRng| {
            let mut worst = 0.0f64;
            for _ in 0..40 {
                let start = random::<N>(rng, 6.0);
                let end = trace(64, Integrator::Euler, back).end(&functions, start, time);
                let (a, b) = (functions.all(start).values, functions.all(end).values);
                worst = worst.max((0..M).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max));
            }
            worst
        };
        let none = worst(Reprojection::None, &mut rng);
        let once = worst(Reprojection::LeastNorm(ONCE), &mut rng);
        let often = worst(Reprojection::LeastNorm(TEN), &mut rng);
        println!("{N} dimensions: off the track by {none:.1e}, put back once {once:.1e}, ten times {often:.1e}");
        assert!(once < 0.1 * none && often < 1e-3 * none, "{N}");
    }

    #[test]
    fn reprojection_keeps_points_on_their_track() {
        check_tracks::<2, 1>(3.0);
        check_tracks::<3, 2>(3.0);
        check_tracks::<4, 3>(0.3);
    }

    #[test]
    fn backwards_is_the_way_that_one_came() {
        let functions = noises::<3, 2>();
        let mut rng = CounterRng::new(Seed(3));
        for back in [Reprojection::None, Reprojection::Newton(ONCE), Reprojection::LeastNorm(ONCE)] {
            let trace = trace(400, Integrator::RungeKutta, back);
            for _ in 0..10 {
                let start = random::<3>(&mut rng, 6.0);
                let there = trace.end(&functions, start, 2.0);
                assert!(distance(trace.end(&functions, there, -2.0), start) < 1e-6);
            }
        }
    }
}
