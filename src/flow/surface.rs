//! Flow along surfaces (Bærentzen et al. 2025, section 5.3): divergence-free vector noise of which one function is the
//! distance of a solid, so that it never leaves the surface.

use crate::flow::dfvn::FromFn;
use crate::flow::reproject::Trace;
use crate::flow::simplex::{Simplex, Slope};
use crate::geometry::sdf::PlacedSdf;
use crate::math::hash::Seed;
use std::sync::Arc;

/// What is left of a gradient of length 1 in the plane of a surface, as a root mean square: √(2/3).
const IN_PLANE: f64 = 0.816_496_580_927_726;

/// A flow on the surface of a solid, that has gone on for some time.
#[derive(Debug, Clone)]
pub struct SurfaceFlow {
    noise: Simplex<3>,
    solid: Arc<PlacedSdf>,
    time: f64,
    trace: Trace,
}

impl SurfaceFlow {
    /// The flow on `solid` with swirls of size `length` [m], once it has moved things by `distance` [m] in the root mean
    /// square, as long as they keep their speed; backwards where that is negative.
    pub fn new(solid: Arc<PlacedSdf>, length: f64, distance: f64, trace: Trace, seed: Seed) -> Self {
        Self { noise: Simplex::new(length, seed), solid, time: distance / IN_PLANE, trace }
    }

    /// Where that which is now at a point of the surface [m] was before the flow began [m].
    pub fn origin(&self, p: [f64; 3]) -> [f64; 3] {
        if self.time == 0.0 {
            return p;
        }
        let distance = FromFn(|p: [f64; 3]| {
            let found = self.solid.slope(p);
            Slope { value: found.value, gradient: found.gradient }
        });
        self.trace.end(&(self.noise, distance), p, -self.time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::reproject::{Integrator, Repetition, Reprojection};
    use crate::geometry::primitive::{Capsule, Cuboid, Primitive, Sphere, Torus};
    use crate::geometry::sdf::Sdf;
    use crate::math::hash::CounterRng;
    use crate::math::space::Similarity;
    use glam::{DVec3, Quat, Vec3};

    const ONCE: Repetition = Repetition { steps: 1, tolerance: 0.0 };

    fn solids() -> Vec<Arc<PlacedSdf>> {
        let turned = Similarity {
            scale: 1.3,
            rotation: Quat::from_axis_angle(Vec3::new(1.0, 2.0, 0.5).normalize(), 0.7),
            translation: Vec3::new(0.3, -0.2, 0.1),
        };
        let torus =
            Primitive::Torus(Torus { center: DVec3::ZERO, axis: DVec3::Y, major_radius: 1.0, minor_radius: 0.4 });
        let rounded = Cuboid { center: DVec3::ZERO, half_size: DVec3::new(0.8, 0.6, 0.7), rounding: 0.3 };
        let capsule = Capsule { start: DVec3::NEG_X, end: DVec3::X, radius: 0.5 };
        let ball = Sphere { center: DVec3::ZERO, radius: 1.0 };
        [torus, Primitive::Cuboid(rounded), Primitive::Capsule(capsule), Primitive::Sphere(ball)]
            .into_iter()
            .zip([Similarity::IDENTITY, turned, Similarity::IDENTITY, turned])
            .map(|(solid, placement)| Arc::new(PlacedSdf::new(Sdf::Primitive(solid), placement)))
            .collect()
    }

    fn on_surface(solid: &PlacedSdf, rng: &mut CounterRng) -> [f64; 3] {
        loop {
            let mut p = DVec3::from_array(std::array::from_fn(|_| f64::from(rng.uniform()) * 3.2 - 1.6));
            for _ in 0..40 {
                let found = solid.slope(p.to_array());
                p -= DVec3::from_array(found.gradient) * found.value;
            }
            if solid.slope(p.to_array()).value.abs() < 1e-12 {
                return p.to_array();
            }
        }
    }

    fn flow(solid: &Arc<PlacedSdf>, distance: f64, steps: u32, reprojection: Reprojection) -> SurfaceFlow {
        let trace = Trace { steps, integrator: Integrator::RungeKutta, reprojection };
        SurfaceFlow::new(solid.clone(), 0.5, distance, trace, Seed(4))
    }

    #[test]
    fn points_stay_on_the_surface_over_thousands_of_steps() {
        let mut rng = CounterRng::new(Seed(1));
        for solid in solids() {
            let flow = flow(&solid, 4.0, 2048, Reprojection::Newton(ONCE));
            for _ in 0..8 {
                let end = flow.origin(on_surface(&solid, &mut rng));
                assert!(solid.slope(end).value.abs() < 1e-6, "{:?}", solid.slope(end));
            }
        }
    }

    #[test]
    fn the_distance_that_things_have_moved_is_as_stated() {
        // A short way, over which speeds are kept.
        let (mut rng, mut square, count) = (CounterRng::new(Seed(2)), 0.0, 4000);
        let torus = &solids()[0];
        let flow = flow(torus, 0.01, 1, Reprojection::None);
        for _ in 0..count {
            let p = on_surface(torus, &mut rng);
            square += (DVec3::from_array(flow.origin(p)) - DVec3::from_array(p)).length_squared() / f64::from(count);
        }
        assert!((square.sqrt() / 0.01 - 1.0).abs() < 0.06, "{}", square.sqrt());
    }

    #[test]
    fn forwards_undoes_backwards_and_errors_fall_faster_with_reprojection() {
        let mut rng = CounterRng::new(Seed(3));
        let torus = &solids()[0];
        let once = Reprojection::Newton(ONCE);
        let starts: Vec<_> = (0..60).map(|_| on_surface(torus, &mut rng)).collect();
        let ends = |steps, back| -> Vec<DVec3> {
            starts.iter().map(|p| DVec3::from_array(flow(torus, 1.0, steps, back).origin(*p))).collect()
        };
        let truth = ends(2048, once);
        for (p, end) in starts.iter().zip(&truth) {
            let back = flow(torus, -1.0, 2048, once).origin(end.to_array());
            assert!((DVec3::from_array(back) - DVec3::from_array(*p)).length() < 1e-5);
        }
        let error = |steps, back| {
            let sum: f64 = ends(steps, back).iter().zip(&truth).map(|(a, b)| (*a - *b).length_squared()).sum();
            (sum / truth.len() as f64).sqrt()
        };
        for steps in [16, 32, 64] {
            let (without, with) = (error(steps, Reprojection::None), error(steps, once));
            println!("{steps} steps: off by {without:.1e} m without reprojection, {with:.1e} m with");
            assert!(with < without, "{steps}");
        }
    }

    #[test]
    fn slopes_are_those_of_the_distance() {
        let mut rng = CounterRng::new(Seed(5));
        for solid in solids() {
            for _ in 0..100 {
                let p: [f64; 3] = std::array::from_fn(|_| f64::from(rng.uniform()) * 4.0 - 2.0);
                let (slope, jet) = (solid.slope(p), solid.at(p));
                assert!((slope.value - jet.value).abs() < 1e-14);
                assert!((0..3).all(|i| (slope.gradient[i] - jet.gradient[i]).abs() < 1e-12));
            }
        }
    }
}
