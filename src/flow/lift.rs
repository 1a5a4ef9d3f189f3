//! Flows of the plane that are made in space and seen from above (Bærentzen et al. 2025, sections 4, 5.4 and 5.5): a point of
//! the plane is lifted, followed along a field in three dimensions, and its height is forgotten.
//!
//! The field has no divergence in space. What is seen of it in the plane may have some.

use crate::flow::dfvn::{Function, Functions};
use crate::flow::simplex::Slope;
use crate::math::real::Lane;

/// The height z. With it as one function, the other one's field stays in its plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Height;

impl Function<3> for Height {
    #[inline(always)]
    fn at<L: Lane>(&self, p: [L; 3]) -> Slope<L, 3> {
        let zero = p[0].lit(0.0);
        Slope { value: p[2], gradient: [zero, zero, p[0].lit(1.0)] }
    }
}

/// A function of the plane, alike at all heights: of a curve's distance it makes that of an upright wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Upright<F>(pub F);

impl<F: Function<2>> Function<3> for Upright<F> {
    #[inline(always)]
    fn at<L: Lane>(&self, p: [L; 3]) -> Slope<L, 3> {
        let found = self.0.at([p[0], p[1]]);
        Slope { value: found.value, gradient: [found.gradient[0], found.gradient[1], p[0].lit(0.0)] }
    }
}

/// `f + slope · z`: noise with a vertical ramp, which drives things across the slope of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ramped<F> {
    /// f.
    pub inner: F,
    /// How much is added for each unit of height.
    pub slope: f64,
}

impl<F: Function<3>> Function<3> for Ramped<F> {
    #[inline(always)]
    fn at<L: Lane>(&self, p: [L; 3]) -> Slope<L, 3> {
        let found = self.inner.at(p);
        let slope = p[0].lit(self.slope);
        let [x, y, z] = found.gradient;
        Slope { value: slope.mul_add(p[2], found.value), gradient: [x, y, z + slope] }
    }
}

/// A field along a surface `z = h(x, y)`: of the gradients of `field` and of the height above the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lifted<F, H> {
    /// What flows along the surface.
    pub field: F,
    /// h, twice continuously differentiable.
    pub height: H,
}

impl<F: Function<3>, H: Function<2>> Lifted<F, H> {
    /// The point of the surface above a point of the plane.
    pub fn lift(&self, [x, y]: [f64; 2]) -> [f64; 3] {
        [x, y, self.height.at([x, y]).value]
    }
}

impl<F: Function<3>, H: Function<2>> Functions<3> for Lifted<F, H> {
    #[inline(always)]
    fn one<L: Lane>(&self, i: usize, p: [L; 3]) -> Slope<L, 3> {
        if i == 0 {
            return self.field.at(p);
        }
        let surface = self.height.at([p[0], p[1]]);
        let [x, y] = surface.gradient;
        Slope { value: p[2] - surface.value, gradient: [-x, -y, p[0].lit(1.0)] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::bounded::{Ball, Bounded};
    use crate::flow::dfvn::{FromFn, field};
    use crate::flow::reproject::{Integrator, Repetition, Reprojection, Trace};
    use crate::flow::simplex::Simplex;
    use crate::math::hash::{CounterRng, Seed};

    fn noise() -> Simplex<3> {
        Simplex::new(0.3, Seed(4))
    }

    /// A plane that rises by these shares of the way along x and y.
    fn plane(x: f64, y: f64) -> FromFn<impl Fn([f64; 2]) -> Slope<f64, 2>> {
        FromFn(move |p: [f64; 2]| Slope { value: x * p[0] + y * p[1], gradient: [x, y] })
    }

    fn points(count: usize) -> impl Iterator<Item = [f64; 2]> {
        let mut rng = CounterRng::new(Seed(8));
        (0..count).map(move |_| [0, 1].map(|_| 20.0 * f64::from(rng.uniform()) - 10.0))
    }

    const TRACE: Trace = Trace {
        steps: 100,
        integrator: Integrator::RungeKutta,
        reprojection: Reprojection::Newton(Repetition { steps: 2, tolerance: 0.0 }),
    };

    #[test]
    fn on_a_level_surface_the_flow_is_that_of_the_plane_whatever_the_ramp() {
        for slope in [0.0, 5.0] {
            let lifted = Lifted { field: Ramped { inner: noise(), slope }, height: plane(0.0, 0.0) };
            for [x, y] in points(50) {
                let found = field(&lifted, [x, y, 0.0]);
                let stream = noise().at([x, y, 0.0]).gradient;
                assert!((found[0] - stream[1]).abs() < 1e-14 && (found[1] + stream[0]).abs() < 1e-14);
                assert!(found[2].abs() < 1e-14);
            }
        }
    }

    #[test]
    fn a_ramp_drives_across_the_slope_as_fast_as_it_is_steep() {
        for (x, y) in [(0.5, 0.0), (0.3, -0.4), (0.0, 2.0)] {
            let still = FromFn(|_: [f64; 3]| Slope { value: 0.0, gradient: [0.0; 3] });
            let lifted = Lifted { field: Ramped { inner: still, slope: 3.0 }, height: plane(x, y) };
            let [u, v, w] = field(&lifted, [1.0, 2.0, x + 2.0 * y]);
            assert!((u * x + v * y).abs() < 1e-14 && w.abs() < 1e-14);
            assert!((u.hypot(v) - 3.0 * f64::hypot(x, y)).abs() < 1e-13);
        }
    }

    #[test]
    fn points_stay_on_the_surface() {
        let bumps = Simplex::<2>::new(1.0, Seed(6));
        let lifted = Lifted { field: Ramped { inner: noise(), slope: 1.0 }, height: bumps };
        let (mut furthest, mut way) = (0.0f64, 0.0f64);
        for p in points(40) {
            let [x, y, z] = TRACE.end(&lifted, lifted.lift(p), 0.5);
            furthest = furthest.max((z - bumps.at([x, y]).value).abs());
            way = way.max((x - p[0]).hypot(y - p[1]));
        }
        println!("{furthest:.1e} off the surface after ways of up to {way:.2}");
        assert!(furthest < 1e-9 && way > 0.2);
    }

    #[test]
    fn a_slope_draws_swirls_out_by_its_cosine() {
        // Along the surface the flow is isotropic; seen from above what goes up the slope is shorter.
        let steep = 1.5f64;
        let lifted = Lifted { field: noise(), height: plane(steep, 0.0) };
        let (mut along, mut across) = (0.0, 0.0);
        for p in points(40_000) {
            let [u, v, _] = field(&lifted, lifted.lift(p));
            along += u * u;
            across += v * v;
        }
        let (ratio, expected) = ((along / across).sqrt(), 1.0 / (1.0 + steep * steep).sqrt());
        println!("{ratio:.4} as fast up the slope as along it, cosine {expected:.4}");
        assert!((ratio - expected).abs() < 0.02 * expected);
    }

    #[test]
    fn beyond_an_upright_wall_distances_to_it_are_kept_and_inside_heights_are() {
        let wall = Upright(Ball { center: [0.0; 2], radius: 1.0 });
        let functions = (noise(), Bounded { distance: wall, inner: Height, width: 0.5 });
        let mut moved = 0;
        for p in points(400).map(|p| p.map(|x| 0.15 * x)) {
            let before = p[0].hypot(p[1]);
            let [x, y, z] = TRACE.end(&functions, [p[0], p[1], 0.0], 0.05);
            let after = x.hypot(y);
            if before >= 1.0 {
                assert!((after - before).abs() < 1e-9, "{before} {after}");
            } else {
                assert!(after <= 1.0 + 1e-9);
            }
            if before.max(after) < 0.3 {
                assert!(z.abs() < 1e-12);
            }
            moved += usize::from((x - p[0]).hypot(y - p[1]) > 0.01);
        }
        assert!(moved > 200, "{moved}");
    }
}
