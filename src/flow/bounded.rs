//! Fields that stay inside (Bærentzen et al. 2025, equation 13): one of the functions is the distance to a wall at the wall, and
//! what one likes further in. Functions are blended and never their gradients, so the field stays free of divergence.

use crate::flow::dfvn::{Function, Functions};
use crate::flow::simplex::Slope;
use crate::geometry::sdf::PlacedSdf;
use crate::math::interpolate::quintic_step;
use crate::math::real::Lane;
use std::sync::Arc;

/// `(1 − α) d + α f`, where α goes from 0 at the wall to 1 at a depth of `width`, with two continuous derivatives.
///
/// A curve along which this function keeps its value never passes the wall, where the function is 0 on all sides. The width
/// must be no more than the depth at which the gradient of the distance first jumps, as in the middle of a ball: its radius.
#[derive(Debug, Clone, Copy)]
pub struct Bounded<D, F> {
    /// Signed distance to the wall [m], negative inside.
    pub distance: D,
    /// What the function is deep inside.
    pub inner: F,
    /// Depth from which on it is that alone [m], > 0.
    pub width: f64,
}

impl<D: Function<N>, F: Function<N>, const N: usize> Function<N> for Bounded<D, F> {
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn at<L: Lane>(&self, p: [L; N]) -> Slope<L, N> {
        let (d, f) = (self.distance.at(p), self.inner.at(p));
        let (zero, one) = (p[0].lit(0.0), p[0].lit(1.0));
        let inverse = p[0].lit(-1.0 / self.width);
        let (alpha, slope) = quintic_step((d.value * inverse).clamp(zero, one));
        let by_distance = (one - alpha) + slope * inverse * (f.value - d.value);
        let mut gradient = d.gradient;
        for i in 0..N {
            gradient[i] = by_distance * d.gradient[i] + alpha * f.gradient[i];
        }
        Slope { value: (one - alpha) * d.value + alpha * f.value, gradient }
    }
}

/// The signed distance to a ball in any dimension.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ball<const N: usize> {
    /// Its middle [m].
    pub center: [f64; N],
    /// Its radius [m].
    pub radius: f64,
}

impl<const N: usize> Function<N> for Ball<N> {
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn at<L: Lane>(&self, p: [L; N]) -> Slope<L, N> {
        let mut gradient = p;
        let mut square = p[0].lit(0.0);
        for i in 0..N {
            gradient[i] = p[i] - p[i].lit(self.center[i]);
            square = gradient[i].mul_add(gradient[i], square);
        }
        // In the very middle any direction will do.
        let length = square.sqrt().max(p[0].lit(1e-30));
        for i in 0..N {
            gradient[i] = gradient[i] / length;
        }
        Slope { value: length - length.lit(self.radius), gradient }
    }
}

/// The functions of a field in `N` dimensions, the first of them kept in a ball where there is one.
#[derive(Debug, Clone, Copy)]
pub struct BoundedByBall<F, const N: usize> {
    /// N − 1 functions; the last is unused.
    pub inner: [F; N],
    /// The ball, and how deep below its wall the first function is itself alone [m].
    pub bound: Option<(Ball<N>, f64)>,
}

impl<F: Function<N> + Copy, const N: usize> Functions<N> for BoundedByBall<F, N> {
    #[inline(always)]
    fn one<L: Lane>(&self, i: usize, p: [L; N]) -> Slope<L, N> {
        match self.bound {
            Some((distance, width)) if i == 0 => Bounded { distance, inner: self.inner[0], width }.at(p),
            _ => self.inner[i].at(p),
        }
    }
}

impl Function<3> for PlacedSdf {
    #[inline(always)]
    fn at<L: Lane>(&self, p: [L; 3]) -> Slope<L, 3> {
        let found = self.slope(p);
        Slope { value: found.value, gradient: found.gradient }
    }
}

impl<F: Function<N>, const N: usize> Function<N> for Arc<F> {
    #[inline(always)]
    fn at<L: Lane>(&self, p: [L; N]) -> Slope<L, N> {
        F::at(self, p)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::dfvn::cross;
    use crate::flow::reproject::{Integrator, Repetition, Reprojection, Trace};
    use crate::flow::simplex::Simplex;
    use crate::geometry::primitive::{Primitive, Torus};
    use crate::geometry::sdf::Sdf;
    use crate::math::hash::{CounterRng, Seed};
    use crate::math::space::Similarity;
    use glam::DVec3;

    fn torus() -> PlacedSdf {
        let torus = Torus { center: DVec3::ZERO, axis: DVec3::Y, major_radius: 1.0, minor_radius: 0.4 };
        PlacedSdf::new(Sdf::Primitive(Primitive::Torus(torus)), Similarity::IDENTITY)
    }

    /// Particles wander in a solid for `steps` steps; the largest distance that any has to it at any time.
    fn worst_distance(solid: &(impl Function<3> + Clone), width: f64, steps: u32) -> f64 {
        let inner = Simplex::<3>::new(0.3, Seed(1));
        let functions = (Simplex::<3>::new(0.3, Seed(2)), Bounded { distance: solid.clone(), inner, width });
        let reprojection = Reprojection::LeastNorm(Repetition { steps: 2, tolerance: 0.0 });
        let trace = Trace { steps: 1, integrator: Integrator::RungeKutta, reprojection };
        let (mut rng, mut worst, mut count, mut moved) = (CounterRng::new(Seed(3)), f64::MIN, 0, 0);
        while count < 150 {
            let start: [f64; 3] = std::array::from_fn(|_| f64::from(rng.uniform()) * 3.0 - 1.5);
            // Many of them begin at the wall itself.
            let depth = solid.at(start).value;
            if depth > 0.0 || (count % 2 == 0 && depth < -0.02) {
                continue;
            }
            count += 1;
            let targets = functions.all(start).values;
            let mut p = start;
            for _ in 0..steps {
                p = trace.step(&functions, p, 0.02, &targets);
                worst = worst.max(solid.at(p).value);
            }
            moved += usize::from((DVec3::from_array(p) - DVec3::from_array(start)).length() > 0.1);
        }
        assert!(moved > 60, "{moved}");
        worst
    }

    #[test]
    fn nothing_leaves_a_ball_or_a_torus() {
        let ball = Ball { center: [0.1, 0.0, -0.2], radius: 1.0 };
        for (name, worst) in
            [("ball", worst_distance(&ball, 0.6, 1000)), ("torus", worst_distance(&torus(), 0.39, 1000))]
        {
            println!("{name}: at most {worst:.1e} m beyond the wall");
            assert!(worst < 1e-9, "{name}: {worst}");
        }
    }

    #[test]
    fn the_function_is_the_distance_at_the_wall_and_itself_deep_inside() {
        let (ball, inner) = (Ball { center: [0.0; 3], radius: 1.0 }, Simplex::<3>::new(0.3, Seed(1)));
        let bounded = Bounded { distance: ball, inner, width: 0.5 };
        for q in [[0.6f64, 0.8, 0.0], [1.0, 2.0, 2.0]] {
            let (found, expected) = (bounded.at(q), ball.at(q));
            assert!((found.value - expected.value).abs() < 1e-15);
            assert!((0..3).all(|i| (found.gradient[i] - expected.gradient[i]).abs() < 1e-12));
        }
        assert_eq!(bounded.at([0.1, 0.2, -0.3]), inner.at([0.1, 0.2, -0.3]));
        // At the wall the field is along it.
        let functions = (Simplex::<3>::new(0.3, Seed(2)), bounded);
        let c = cross(&functions.all([0.6f64, 0.0, 0.8]).gradients);
        assert!((c[0] * 0.6 + c[2] * 0.8).abs() < 1e-12 && c.iter().any(|x| x.abs() > 0.05), "{c:?}");
    }
}
