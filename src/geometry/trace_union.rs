//! Where a ray crosses the surface of a smooth union.
//!
//! Its distance never changes by more than a metre in a metre, so that a step of the distance is always safe (sphere
//! tracing). Two longer steps are tried besides, from outside and where all parts are convex: the slope of each part's
//! distance only rises along a line, and blending lets it fall by no more than the width allows; and where one part is
//! nearer than all others by far, the union is that part, for which Newton's step is safe. What is found is bracketed by
//! a change of sign and refined.

use crate::geometry::along::Along;
use crate::geometry::primitive::Primitive;
use crate::geometry::sdf::{PlacedSdf, Sdf, SmoothUnion};
use crate::geometry::smooth_union::smooth_union;
use crate::math::real::Real;
use glam::DVec3;

/// Steps after which a ray counts as missing. Those that graze a blend need about a hundred.
const MAX_STEPS: u32 = 1000;
/// Shortest step, as part of the size of the union: what is thinner along the ray may be missed.
const SHORTEST: f64 = 1e-6;

/// A ray in the presence of a smooth union.
pub struct UnionLine<'a> {
    /// The union, placed.
    pub sdf: &'a PlacedSdf,
    /// The same.
    pub union: &'a SmoothUnion,
    /// Where the ray begins [m].
    pub origin: DVec3,
    /// Where it goes, length 1.
    pub direction: DVec3,
}

/// What is known of a union at a point of a ray: distances of the union's own space, slopes by the ray parameter.
struct Found {
    /// Its distance [m].
    distance: Along,
    /// That of its nearest part.
    nearest: Along,
    /// The least that any other part is further away [m].
    lead: f64,
}

impl UnionLine<'_> {
    /// Distance [m] at `t` and its slope along the ray.
    #[inline]
    pub fn distance(&self, t: f64) -> (f64, f64) {
        let scale = f64::from(self.sdf.placement().scale);
        let found = self.at(t).distance;
        (found.value * scale, found.slope * scale)
    }

    fn at(&self, t: f64) -> Found {
        let p = self.sdf.to_local(std::array::from_fn(|axis| {
            Along::new(self.origin[axis] + self.direction[axis] * t, self.direction[axis])
        }));
        let mut found: Option<Found> = None;
        for part in self.union.parts() {
            let Sdf::Primitive(primitive) = part.sdf() else { continue };
            let scale = Along::new(f64::from(part.placement().scale), 0.0);
            let own = primitive.distance(part.to_local(p)) * scale;
            found = Some(match found {
                None => Found { distance: own, nearest: own, lead: f64::INFINITY },
                Some(f) => {
                    let behind = own.value - f.nearest.value;
                    Found {
                        distance: smooth_union(f.distance, own, self.union.width()),
                        nearest: f.nearest.min(own),
                        lead: if behind < 0.0 { -behind } else { behind.min(f.lead) },
                    }
                }
            });
        }
        found.expect("a union has parts")
    }

    /// The first change of sign between the ray parameters `start` and `end`.
    pub fn crossing(&self, start: f64, end: f64) -> Option<f64> {
        let parts = self.union.parts();
        let is_inside = self.distance(start).0 < 0.0;
        let side = if is_inside { -1.0 } else { 1.0 };
        let is_convex = |part: &PlacedSdf| !matches!(part.sdf(), Sdf::Primitive(Primitive::Torus(_)));
        let can_leap = !is_inside && parts.iter().all(is_convex);
        let (scale, width) = (f64::from(self.sdf.placement().scale), self.union.width());
        // Each blend's second derivative is at least −1/k times the square of a difference of slopes, which is at most 2.
        let bend = 4.0 * (parts.len() - 1) as f64 / width;
        let shortest = SHORTEST * f64::from(self.sdf.bounding_radius());
        let (mut before, mut t) = (start, start);
        for _ in 0..MAX_STEPS {
            let found = self.at(t);
            let (d, slope) = (found.distance.value * side, found.distance.slope * scale);
            if d <= 0.0 && t > start {
                return Some(self.refined(before, t, side));
            }
            let mut step = d;
            if can_leap {
                step = step.max((slope + (slope * slope + 2.0 * bend * d.max(0.0)).sqrt()) / bend);
                // Any fewer parts than all may have been blended to something smaller by at most the width.
                let alone = 0.5 * (found.lead - 2.0 * width);
                let own_slope = found.nearest.slope * scale;
                let newton = if own_slope < 0.0 { -d / own_slope } else { f64::INFINITY };
                step = step.max(newton.min(alone));
            }
            if t >= end {
                return None;
            }
            before = t;
            t = (t + (step * scale).max(shortest)).min(end);
        }
        None
    }

    /// The crossing between `low`, where `side · distance` is positive, and `high`, where it is not: Newton's method, kept
    /// between both.
    fn refined(&self, mut low: f64, mut high: f64, side: f64) -> f64 {
        let smallest = 1e-12 * (1.0 + high.abs());
        let mut t = high;
        for _ in 0..100 {
            let (d, slope) = self.distance(t);
            if d * side > 0.0 {
                low = t;
            } else {
                high = t;
            }
            let newton = t - d / slope;
            let next = if low < newton && newton < high { newton } else { 0.5 * (low + high) };
            if (next - t).abs() < smallest || high - low < smallest {
                return next;
            }
            t = next;
        }
        t
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitive::{Capsule, Cuboid, Sphere, Torus};
    use crate::geometry::trace::Solid;
    use crate::math::hash::{CounterRng, Seed};
    use crate::math::space::Similarity;
    use glam::{Quat, Vec3};
    use std::sync::Arc;

    fn unions() -> Vec<PlacedSdf> {
        let ball = |x: f64, radius: f64| Primitive::Sphere(Sphere { center: DVec3::X * x, radius });
        let cube = Primitive::Cuboid(Cuboid { center: DVec3::Y * 0.2, half_size: DVec3::splat(0.3), rounding: 0.0 });
        let bar = Primitive::Capsule(Capsule { start: DVec3::NEG_Z * 0.6, end: DVec3::Z * 0.6, radius: 0.12 });
        let ring = Torus { center: DVec3::ZERO, axis: DVec3::Y, major_radius: 0.5, minor_radius: 0.15 };
        let turned = Similarity {
            scale: 1.3,
            rotation: Quat::from_axis_angle(Vec3::new(1.0, 2.0, -0.5).normalize(), 0.9),
            translation: Vec3::new(0.1, -0.2, 0.05),
        };
        let made = |parts: &[Primitive], width: f64, at: Similarity| {
            let parts = parts.iter().map(|&part| (part, Similarity::IDENTITY));
            PlacedSdf::new(Sdf::SmoothUnion(Arc::new(SmoothUnion::new(parts, width))), at)
        };
        vec![
            made(&[ball(-0.3, 0.4), ball(0.35, 0.3)], 0.2, Similarity::IDENTITY),
            made(&[ball(-0.3, 0.4), cube, bar], 0.15, turned),
            made(&[ball(-0.5, 0.3), ball(0.5, 0.3)], 0.002, Similarity::IDENTITY),
            made(&[Primitive::Torus(ring), bar, ball(0.0, 0.2)], 0.2, turned),
        ]
    }

    #[test]
    fn crossings_are_on_the_surface_and_agree_with_bisection() {
        let mut rng = CounterRng::new(Seed(21));
        let mut cube = |half: f32| Vec3::from_array(std::array::from_fn(|_| (rng.uniform() * 2.0 - 1.0) * half));
        for sdf in unions() {
            let solid = Solid::try_new(&sdf, 1.0).expect("a formula");
            let (mut hits, mut disagreements, mut worst) = (0, 0, 0.0f64);
            for i in 0..4000 {
                let origin = cube(if i % 2 == 0 { 2.5 } else { 0.4 });
                let Some(direction) = (cube(0.9) - origin).try_normalize() else { continue };
                let at = |t: f64| (origin.as_dvec3() + direction.as_dvec3() * t).to_array();
                let is_inside = sdf.distance(at(0.0)) < 0.0;
                // Small steps, and bisection of the one with the change of sign.
                let mut low = 0.0;
                let is_before = |t: f64| (sdf.distance(at(t)) < 0.0) == is_inside;
                while low < 10.0 && is_before(low + 1e-3) {
                    low += (0.5 * sdf.distance(at(low)).abs()).max(1e-3);
                }
                let mut high = low + 1e-3;
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if is_before(middle) { low = middle } else { high = middle }
                }
                match solid.crossing(origin, direction, 0.0, 10.0) {
                    Some(t) => {
                        hits += 1;
                        let p = at(f64::from(t));
                        worst = worst.max(sdf.distance(p).abs());
                        disagreements += usize::from((f64::from(t) - low).abs() > 2e-6);
                    }
                    None => disagreements += usize::from(low < 10.0),
                }
            }
            println!("{hits} hits, off the surface by at most {worst:.1e} m, {disagreements} disagreements");
            // Rays that graze: small steps jump over a rim, and both are right to the rounding of f32.
            assert!(hits > 900 && worst < 1e-6 && disagreements <= 8, "{hits} {worst} {disagreements}");
        }
    }

    #[test]
    fn rays_from_far_away_hit_the_near_side() {
        for sdf in unions() {
            let solid = Solid::try_new(&sdf, 1.0).expect("a formula");
            let Sdf::SmoothUnion(union) = sdf.sdf() else { unreachable!() };
            let target = sdf.placement().point_to_world(union.parts()[1].center().0).0;
            for direction in [Vec3::new(0.3, -0.8, 0.2), Vec3::new(-0.5, -0.7, 0.3)].map(Vec3::normalize) {
                let far = solid.crossing(target - direction * 3000.0, direction, 0.0, f32::INFINITY).expect("hits");
                let near = solid.crossing(target - direction * 3.0, direction, 0.0, f32::INFINITY).expect("hits");
                assert!((far - 2997.0 - near).abs() < 2e-3, "{far} {near}");
            }
        }
    }
}
