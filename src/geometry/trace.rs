//! Where a ray crosses the surface of a solid with a formula.
//!
//! Sphere tracing (Hart 1996) with steps lengthened by the slope of the distance along the ray. Along a line the
//! distance of a convex solid is convex, so Newton's step never passes the first crossing from outside; elsewhere a
//! bound on how fast the slope can fall gives the step. Crossings are found to the rounding of `f64`, so that a hit is
//! as accurate as its `f32` ray parameter can say.

use crate::geometry::along::Along;
use crate::geometry::closed::Closed;
use crate::geometry::primitive::{Primitive, Torus};
use crate::geometry::sdf::{PlacedSdf, Sdf};
use crate::geometry::trace_union::UnionLine;
use crate::math::aabb::Aabb;
use crate::math::space::UnitVec3;
use glam::{DVec3, Vec3};

/// Steps after which a ray counts as missing. A ray that grazes a convex solid needs about 30, one that skims the
/// inside of a torus about 60.
const MAX_STEPS: u32 = 200;

/// A crossing is found when a step is shorter than this part of the ray parameter's scale.
const RELATIVE_STEP: f64 = 1e-11;

/// Part of a ray parameter by which the crossing of a box in `f32` may be wrong.
const BOX_SLACK: f64 = 1e-6;

/// A solid with a formula, ready to be hit by rays.
#[derive(Debug, Clone)]
pub struct Solid {
    sdf: PlacedSdf,
    bounds: Aabb,
    /// Half the width of the square of a half space that can be hit, in its own space [m].
    extent: f64,
    closed: Option<Closed>,
}

impl Solid {
    /// `sdf` as a target of rays; of a half space, a square of half-width `extent` round its point [m, own space].
    /// `None` for distances that are not formulas.
    pub fn try_new(sdf: &PlacedSdf, extent: f64) -> Option<Self> {
        if matches!(sdf.sdf(), Sdf::Mesh(_)) {
            return None;
        }
        let closed = Closed::try_new(sdf, extent);
        let bounds = match &closed {
            Some(Closed::Square(square)) => Aabb::from_points(square.corners().map(DVec3::as_vec3)),
            _ => sdf.bounds()?,
        };
        let bounds = bounds.dilated(1e-5 * bounds.min.abs().max(bounds.max.abs()).max_element());
        Some(Self { sdf: sdf.clone(), bounds, extent, closed })
    }

    /// The same solid, placed elsewhere.
    pub fn moved(&self, sdf: &PlacedSdf) -> Option<Self> {
        Self::try_new(sdf, self.extent)
    }

    /// A world-space box that holds the surface.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// The same by a closed form, if there is one.
    pub fn closed(&self) -> Option<&Closed> {
        self.closed.as_ref()
    }

    /// Outward normal at a point of the surface; `None` where the distance has no slope.
    #[inline]
    pub fn normal_at(&self, p: DVec3) -> Option<UnitVec3> {
        match &self.closed {
            Some(closed) => Some(closed.normal_at(p)),
            None => UnitVec3::try_new(DVec3::from_array(self.sdf.at(p.to_array()).gradient).as_vec3()),
        }
    }

    /// The least ray parameter in `(t_min, t_max)` where the ray crosses the surface, from outside or from inside.
    /// `direction` has length 1.
    #[inline]
    pub fn crossing(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> Option<f32> {
        if let Some(closed) = &self.closed {
            return closed.crossing(origin, direction, t_min, t_max);
        }
        let (origin_f64, direction_f64) = (origin.as_dvec3(), direction.as_dvec3());
        let primitive = match self.sdf.sdf() {
            Sdf::Primitive(primitive) => primitive,
            Sdf::SmoothUnion(union) => {
                let (t0, t1) = self.way_through(origin, direction, t_min, t_max)?;
                let line = UnionLine { sdf: &self.sdf, union, origin: origin_f64, direction: direction_f64 };
                return in_range(line.crossing(t0, t1)?, t_min, t_max);
            }
            Sdf::Mesh(_) => return None,
        };
        let line = Line { sdf: &self.sdf, primitive, origin: origin_f64, direction: direction_f64 };
        let (t0, t1) = self.way_through(origin, direction, t_min, t_max)?;
        let is_inside = line.distance(t0).0 < 0.0;
        let bend = Bend::of(primitive, is_inside, f64::from(self.sdf.placement().scale));
        let t = match bend {
            // The way out of a convex solid is the way in, walked from beyond its bounds.
            Bend::Convex if is_inside => {
                let (_, beyond) = self.bounds.ray_interval(origin, direction, t_min, f32::INFINITY)?;
                line.march(f64::from(beyond) + self.bounds.size().max_element() as f64 * 1e-3, t0, 1.0, bend)
            }
            _ => line.march(t0, t1, if is_inside { -1.0 } else { 1.0 }, bend),
        };
        in_range(t?, t_min, t_max)
    }
}

impl Solid {
    /// The ray parameters between which the surface can be met.
    #[inline]
    fn way_through(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> Option<(f64, f64)> {
        let (t0, t1) = self.bounds.ray_interval(origin, direction, t_min, t_max)?;
        // The box is entered and left with the rounding of f32; from far away that could be behind the surface.
        let t0 = (f64::from(t0) * (1.0 - BOX_SLACK)).max(f64::from(t_min));
        let t1 = (f64::from(t1) * (1.0 + BOX_SLACK)).min(f64::from(t_max));
        Some((t0, t1))
    }
}

fn in_range(t: f64, t_min: f32, t_max: f32) -> Option<f32> {
    let t = t as f32;
    (t > t_min && t < t_max).then_some(t)
}

/// How fast the slope of the distance along a line may fall.
#[derive(Debug, Clone, Copy)]
enum Bend {
    /// Never.
    Convex,
    /// By at most `most` [1/m] per metre where the distance is less than `reach` [m], on the way of `reach`.
    Within { most: f64, reach: f64 },
}

impl Bend {
    fn of(primitive: &Primitive, is_inside: bool, scale: f64) -> Self {
        let Primitive::Torus(Torus { major_radius, minor_radius, .. }) = primitive else { return Self::Convex };
        // The Hessian's eigenvalues are 1/d and (ρ − R)/(ρ d), d from the circle, ρ from the axis. Inside, d ≥ r/2 on the
        // way; outside, ρ ≥ (R − r)/2.
        let (r, gap) = (minor_radius * scale, (major_radius - minor_radius).max(0.0) * scale);
        if is_inside {
            Self::Within { most: 2.0 / r, reach: 0.25 * r }
        } else {
            Self::Within { most: 2.0 * major_radius * scale / (gap * r), reach: 0.25 * gap }
        }
    }
}

/// A ray in the presence of a solid.
struct Line<'a> {
    sdf: &'a PlacedSdf,
    primitive: &'a Primitive,
    origin: DVec3,
    direction: DVec3,
}

impl Line<'_> {
    /// Distance at `t` and its slope along the ray.
    #[inline]
    fn distance(&self, t: f64) -> (f64, f64) {
        let local = self.sdf.to_local(std::array::from_fn(|axis| {
            Along::new(self.origin[axis] + self.direction[axis] * t, self.direction[axis])
        }));
        let d = self.primitive.distance(local);
        let scale = f64::from(self.sdf.placement().scale);
        (d.value * scale, d.slope * scale)
    }

    /// The first zero of `side · distance` on the way from `start` to `end`, either of which may be the larger.
    #[inline]
    fn march(&self, start: f64, end: f64, side: f64, bend: Bend) -> Option<f64> {
        let way = (end - start).signum();
        let length = (end - start).abs();
        let smallest = RELATIVE_STEP * (1.0 + start.abs().max(end.abs()));
        let mut s = 0.0;
        for _ in 0..MAX_STEPS {
            let (d, slope) = self.distance(start + way * s);
            let (d, slope) = (d * side, slope * side * way);
            let step = match bend {
                // A convex function that does not fall has no zero ahead.
                Bend::Convex if slope >= 0.0 => return None,
                Bend::Convex => -d / slope,
                Bend::Within { most, reach } if d < reach => {
                    ((slope + (slope * slope + 2.0 * most * d.max(0.0)).sqrt()) / most).clamp(d.max(0.0), reach)
                }
                Bend::Within { .. } => d,
            };
            s += step;
            if s >= length {
                return None;
            }
            if step < smallest && slope < 0.0 {
                return Some(start + way * s);
            }
            s += if step < smallest { smallest } else { 0.0 };
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitive::{Capsule, Cuboid, HalfSpace, Sphere};
    use crate::math::hash::{CounterRng, Seed};
    use crate::math::space::Similarity;
    use glam::Quat;

    fn solids() -> Vec<Solid> {
        let at = Similarity {
            scale: 1.3,
            rotation: Quat::from_axis_angle(Vec3::new(1.0, 2.0, -0.5).normalize(), 0.9),
            translation: Vec3::new(0.1, -0.2, 0.05),
        };
        let primitives = [
            Primitive::Sphere(Sphere { center: DVec3::X * 0.1, radius: 0.5 }),
            Primitive::Cuboid(Cuboid { center: DVec3::ZERO, half_size: DVec3::new(0.5, 0.3, 0.4), rounding: 0.0 }),
            Primitive::Cuboid(Cuboid { center: DVec3::ZERO, half_size: DVec3::new(0.5, 0.3, 0.4), rounding: 0.1 }),
            Primitive::Capsule(Capsule { start: DVec3::X * -0.4, end: DVec3::Y * 0.3, radius: 0.2 }),
            Primitive::Torus(Torus { center: DVec3::ZERO, axis: DVec3::Y, major_radius: 0.45, minor_radius: 0.15 }),
            Primitive::Torus(Torus { center: DVec3::ZERO, axis: DVec3::Z, major_radius: 0.4, minor_radius: 0.38 }),
            Primitive::HalfSpace(HalfSpace { point: DVec3::Y * 0.1, normal: DVec3::new(0.1, 1.0, 0.2).normalize() }),
        ];
        let place = |p, at| Solid::try_new(&PlacedSdf::new(Sdf::Primitive(p), at), 1.0).expect("a formula");
        primitives.into_iter().flat_map(|p| [place(p, at), place(p, Similarity::IDENTITY)]).collect()
    }

    /// The first change of sign by plain small steps: slow, and sure up to the step.
    fn by_small_steps(solid: &Solid, origin: Vec3, direction: Vec3, t_max: f32) -> Option<f64> {
        let at = |t: f64| (origin.as_dvec3() + direction.as_dvec3() * t).to_array();
        let d0 = solid.sdf.distance(at(0.0));
        let step = 1e-3;
        let mut t = 0.0;
        while t < f64::from(t_max) {
            let d = solid.sdf.distance(at(t));
            if (d < 0.0) != (d0 < 0.0) {
                return Some(t - 0.5 * step);
            }
            t += step.max(0.5 * d.abs());
        }
        None
    }

    #[test]
    fn crossings_are_the_first_change_of_sign_from_outside_and_inside() {
        let mut rng = CounterRng::new(Seed(11));
        let mut cube = |half: f32| Vec3::from_array(std::array::from_fn(|_| (rng.uniform() * 2.0 - 1.0) * half));
        for solid in solids() {
            let is_plane = matches!(solid.sdf.sdf(), Sdf::Primitive(Primitive::HalfSpace(_)));
            let (mut hits, mut disagreements) = (0, 0);
            for i in 0..1500 {
                let origin = cube(if i % 2 == 0 { 2.0 } else { 0.5 });
                let Some(direction) = (cube(0.8) - origin).try_normalize() else { continue };
                let t = solid.crossing(origin, direction, 0.0, 10.0);
                let expected = by_small_steps(&solid, origin, direction, 10.0);
                if let Some(t) = t {
                    hits += 1;
                    let p = origin.as_dvec3() + direction.as_dvec3() * f64::from(t);
                    assert!(solid.sdf.distance(p.to_array()).abs() < 1e-6, "{:?}: not on the surface", solid.sdf.sdf());
                }
                match (t, expected) {
                    (Some(t), Some(e)) if (f64::from(t) - e).abs() < 3e-3 => {}
                    (None, None) => {}
                    // The square of a half space ends; small steps can jump over a grazed rim.
                    (None, Some(_)) if is_plane => {}
                    _ => disagreements += 1,
                }
            }
            assert!(hits > 300, "{:?}: {hits}", solid.sdf.sdf());
            assert!(disagreements <= 3, "{:?}: {disagreements}", solid.sdf.sdf());
        }
    }

    #[test]
    fn a_ray_that_leaves_a_surface_does_not_hit_it_again() {
        let mut rng = CounterRng::new(Seed(3));
        let mut unit = || std::array::from_fn(|_| rng.uniform() * 2.0 - 1.0);
        for solid in solids() {
            if matches!(solid.sdf.sdf(), Sdf::Primitive(Primitive::Torus(_))) {
                continue;
            }
            for _ in 0..2000 {
                let origin = Vec3::from_array(unit()) * 3.0;
                let Some(direction) = (Vec3::from_array(unit()) * 0.5 - origin).try_normalize() else { continue };
                let Some(t) = solid.crossing(origin, direction, 0.0, 100.0) else { continue };
                let hit = origin + direction * t;
                let normal = solid.normal_at(hit.as_dvec3()).expect("a slope").as_vec3();
                let away = Vec3::from_array(unit());
                let away = (if away.dot(normal) < 0.0 { -away } else { away }).normalize();
                let outside = hit + normal * 2e-5;
                assert_eq!(solid.crossing(outside, away, 0.0, 100.0), None, "{:?}", solid.sdf.sdf());
            }
        }
    }

    #[test]
    fn rays_from_far_away_hit_the_near_side() {
        for solid in solids() {
            let target = if matches!(solid.sdf.sdf(), Sdf::Primitive(Primitive::Torus(_))) {
                let Sdf::Primitive(Primitive::Torus(t)) = *solid.sdf.sdf() else { unreachable!() };
                let rim = (t.axis.any_orthonormal_vector() * t.major_radius).as_vec3();
                solid.sdf.placement().point_to_world(rim).0
            } else {
                solid.sdf.placement().point_to_world(Vec3::Y * 0.05).0
            };
            for direction in [Vec3::new(0.3, -0.8, 0.2), Vec3::new(-0.5, -0.7, 0.3)].map(Vec3::normalize) {
                let t = solid.crossing(target - direction * 3000.0, direction, 0.0, f32::INFINITY).expect("hits");
                let near = solid.crossing(target - direction * 3.0, direction, 0.0, f32::INFINITY).expect("hits");
                assert!((t - 2997.0 - near).abs() < 2e-3, "{:?}: {t} {near}", solid.sdf.sdf());
            }
        }
    }
}
