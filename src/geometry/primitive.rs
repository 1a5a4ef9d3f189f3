//! Solids with a formula: sphere, box, capsule, torus and half space.
//!
//! Every distance is Euclidean, exact inside and outside, negative inside, and written once over [`Real`], so that a
//! [`Jet`](crate::math::jet::Jet) gives its exact gradient and Hessian. Formulas after Hart 1996, *Sphere Tracing*,
//! appendix A. On the few points where a distance has no derivative (a centre, a ridge) the derivatives come out
//! finite: those of one side, or of no side at all at an isolated point.

use crate::math::aabb::Aabb;
use crate::math::real::{Real, dot, length};
use glam::{DVec3, Vec3};

/// A solid with a formula, in its own space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Primitive {
    /// All points within a distance of a point.
    Sphere(Sphere),
    /// A box along the axes.
    Cuboid(Cuboid),
    /// All points within a distance of a segment.
    Capsule(Capsule),
    /// All points within a distance of a circle.
    Torus(Torus),
    /// All points behind a plane.
    HalfSpace(HalfSpace),
}

/// All points within `radius` of `center`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Middle [m].
    pub center: DVec3,
    /// Radius [m], > 0.
    pub radius: f64,
}

/// A box along the axes; edges and corners rounded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cuboid {
    /// Middle [m].
    pub center: DVec3,
    /// Half the edge lengths, rounding included [m], > 0.
    pub half_size: DVec3,
    /// Radius of edges and corners [m], between 0 and the least half size.
    pub rounding: f64,
}

/// All points within `radius` of the segment from `start` to `end`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capsule {
    /// One end [m].
    pub start: DVec3,
    /// The other end [m]; may equal `start`.
    pub end: DVec3,
    /// Radius [m], > 0.
    pub radius: f64,
}

/// All points within `minor_radius` of the circle of `major_radius` about `axis`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Torus {
    /// Middle of the hole [m].
    pub center: DVec3,
    /// Direction of the hole, length 1.
    pub axis: DVec3,
    /// Radius of the circle [m], > 0.
    pub major_radius: f64,
    /// Radius of the tube [m], between 0 and `major_radius`.
    pub minor_radius: f64,
}

/// All points behind the plane through `point`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSpace {
    /// A point of the plane [m].
    pub point: DVec3,
    /// Direction out of the solid, length 1.
    pub normal: DVec3,
}

/// Below this a coordinate counts as on the face of a box [m]: the root of a sum of squares has no derivative at 0,
/// and loses its digits close to it.
const ON_FACE: f64 = 1e-12;

#[inline(always)]
fn relative<R: Real>(p: [R; 3], origin: DVec3) -> [R; 3] {
    [p[0] - p[0].lit(origin.x), p[1] - p[1].lit(origin.y), p[2] - p[2].lit(origin.z)]
}

#[inline(always)]
fn constant<R: Real>(like: R, v: DVec3) -> [R; 3] {
    [like.lit(v.x), like.lit(v.y), like.lit(v.z)]
}

#[inline(always)]
fn minus<R: Real>(a: [R; 3], b: [R; 3], factor: R) -> [R; 3] {
    [a[0] - b[0] * factor, a[1] - b[1] * factor, a[2] - b[2] * factor]
}

impl Sphere {
    /// Signed distance [m].
    #[inline(always)]
    pub fn distance<R: Real>(&self, p: [R; 3]) -> R {
        length(relative(p, self.center)) - p[0].lit(self.radius)
    }
}

impl Cuboid {
    /// Corners of the twelve triangles of a box with sharp edges [m].
    pub fn triangles(&self) -> [[DVec3; 3]; 12] {
        std::array::from_fn(|i| {
            let (axis, side) = (i / 4, if i % 4 < 2 { -1.0 } else { 1.0 });
            let corner = |u: f64, v: f64| {
                let mut p = DVec3::ZERO;
                (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (side, u, v);
                self.center + p * self.half_size
            };
            let half = if i % 2 == 0 { 1.0 } else { -1.0 };
            [corner(-half, -half), corner(half, -half), corner(-half, half)]
        })
    }

    /// Signed distance [m].
    #[inline(always)]
    pub fn distance<R: Real>(&self, p: [R; 3]) -> R {
        let zero = p[0].lit(0.0);
        let v = relative(p, self.center);
        let inner = constant(p[0], self.half_size - self.rounding);
        let q = [v[0].abs() - inner[0], v[1].abs() - inner[1], v[2].abs() - inner[2]];
        let largest = q[0].max(q[1]).max(q[2]);
        let middle = q[0].min(q[1]).max(q[0].max(q[1]).min(q[2]));
        let corner = length([q[0].max(zero), q[1].max(zero), q[2].max(zero)]);
        // Nearest to a face, from inside or outside, where at most one coordinate sticks out: linear there, and
        // written so, because the root of one square would have a noisy Hessian near the wall and none on it.
        middle.select_lt(p[0].lit(ON_FACE), largest, corner) - p[0].lit(self.rounding)
    }
}

impl Capsule {
    /// Signed distance [m].
    #[inline(always)]
    pub fn distance<R: Real>(&self, p: [R; 3]) -> R {
        let along = self.end - self.start;
        let length_sq = along.length_squared();
        let inverse = if length_sq > 0.0 { along / length_sq } else { DVec3::ZERO };
        let v = relative(p, self.start);
        let t = dot(v, constant(p[0], inverse)).clamp(p[0].lit(0.0), p[0].lit(1.0));
        length(minus(v, constant(p[0], along), t)) - p[0].lit(self.radius)
    }
}

impl Torus {
    /// Signed distance [m].
    #[inline(always)]
    pub fn distance<R: Real>(&self, p: [R; 3]) -> R {
        let v = relative(p, self.center);
        let axis = constant(p[0], self.axis);
        let height = dot(v, axis);
        let from_circle = length(minus(v, axis, height)) - p[0].lit(self.major_radius);
        (from_circle.squared() + height.squared()).sqrt() - p[0].lit(self.minor_radius)
    }
}

impl HalfSpace {
    /// Signed distance [m].
    #[inline(always)]
    pub fn distance<R: Real>(&self, p: [R; 3]) -> R {
        dot(relative(p, self.point), constant(p[0], self.normal))
    }
}

impl Primitive {
    /// Signed distance [m].
    #[inline(always)]
    pub fn distance<R: Real>(&self, p: [R; 3]) -> R {
        match self {
            Self::Sphere(s) => s.distance(p),
            Self::Cuboid(s) => s.distance(p),
            Self::Capsule(s) => s.distance(p),
            Self::Torus(s) => s.distance(p),
            Self::HalfSpace(s) => s.distance(p),
        }
    }

    /// A box that holds the solid, or `None` where it has no end. Tight but for a tilted torus, whose box is exact
    /// too, and for rounding to `f32`.
    pub fn bounds(&self) -> Option<Aabb> {
        let (min, max) = match self {
            Self::Sphere(s) => (s.center - s.radius, s.center + s.radius),
            Self::Cuboid(s) => (s.center - s.half_size, s.center + s.half_size),
            Self::Capsule(s) => (s.start.min(s.end) - s.radius, s.start.max(s.end) + s.radius),
            Self::Torus(s) => {
                let reach = (DVec3::ONE - s.axis * s.axis).max(DVec3::ZERO);
                let half = DVec3::new(reach.x.sqrt(), reach.y.sqrt(), reach.z.sqrt()) * s.major_radius + s.minor_radius;
                (s.center - half, s.center + half)
            }
            Self::HalfSpace(_) => return None,
        };
        Some(outward(min, max))
    }
}

/// The smallest `f32` box round an `f64` one.
fn outward(min: DVec3, max: DVec3) -> Aabb {
    let down = |x: f64| if f64::from(x as f32) > x { (x as f32).next_down() } else { x as f32 };
    let up = |x: f64| -down(-x);
    Aabb::new(Vec3::new(down(min.x), down(min.y), down(min.z)), Vec3::new(up(max.x), up(max.y), up(max.z)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};
    use crate::math::jet::Jet;

    fn all() -> Vec<Primitive> {
        vec![
            Primitive::Sphere(Sphere { center: DVec3::new(0.1, -0.2, 0.3), radius: 0.7 }),
            Primitive::Cuboid(Cuboid {
                center: DVec3::new(0.1, 0.2, -0.1),
                half_size: DVec3::new(0.5, 0.3, 0.8),
                rounding: 0.0,
            }),
            Primitive::Cuboid(Cuboid { center: DVec3::ZERO, half_size: DVec3::new(0.5, 0.3, 0.8), rounding: 0.1 }),
            Primitive::Capsule(Capsule {
                start: DVec3::new(-0.3, 0.1, 0.0),
                end: DVec3::new(0.4, 0.5, 0.2),
                radius: 0.25,
            }),
            Primitive::Torus(Torus {
                center: DVec3::new(0.0, 0.1, 0.0),
                axis: DVec3::new(0.2, 1.0, -0.4).normalize(),
                major_radius: 0.6,
                minor_radius: 0.2,
            }),
            Primitive::HalfSpace(HalfSpace { point: DVec3::Y * 0.2, normal: DVec3::new(0.3, 1.0, 0.1).normalize() }),
        ]
    }

    fn points(count: usize) -> Vec<[f64; 3]> {
        let mut rng = CounterRng::new(Seed(5));
        (0..count).map(|_| std::array::from_fn(|_| f64::from(rng.uniform()) * 3.0 - 1.5)).collect()
    }

    #[test]
    fn a_step_of_the_distance_along_the_normal_ends_on_the_surface() {
        for shape in all() {
            for p in points(2000) {
                let jet = shape.distance(Jet::point(p));
                assert!((length(jet.gradient) - 1.0).abs() < 1e-9, "{shape:?} at {p:?}");
                let foot: [f64; 3] = std::array::from_fn(|i| p[i] - jet.value * jet.gradient[i]);
                assert!(shape.distance(foot).abs() < 1e-9, "{shape:?} at {p:?}");
            }
        }
    }

    /// Steps of the distance in any direction never cross the surface: the distance is no larger than the true one.
    #[test]
    fn distances_are_lipschitz_with_constant_one() {
        for shape in all() {
            for pair in points(2000).chunks(2) {
                let apart = length(std::array::from_fn(|i| pair[0][i] - pair[1][i]));
                let change = (shape.distance(pair[0]) - shape.distance(pair[1])).abs();
                assert!(change <= apart + 1e-12, "{shape:?}");
            }
        }
    }

    #[test]
    fn jets_equal_central_differences() {
        let h = 1e-5;
        for shape in all() {
            for p in points(200) {
                let jet = shape.distance(Jet::point(p));
                for axis in 0..3 {
                    let moved = |by: f64| {
                        let mut q = p;
                        q[axis] += by;
                        shape.distance(Jet::point(q))
                    };
                    let (up, down) = (moved(h), moved(-h));
                    // Across a ridge, or from a face to an edge, the difference is not the derivative.
                    let bend = length(std::array::from_fn(|i| up.gradient[i] - down.gradient[i]));
                    if bend > 0.01 || (0..6).any(|k| (up.hessian[k] - down.hessian[k]).abs() > 0.01) {
                        continue;
                    }
                    assert!((jet.gradient[axis] - (up.value - down.value) / (2.0 * h)).abs() < 1e-7, "{shape:?} {p:?}");
                    for i in 0..3 {
                        let second = (up.gradient[i] - down.gradient[i]) / (2.0 * h);
                        assert!((jet.second(i, axis) - second).abs() < 1e-5 * (1.0 + second.abs()), "{shape:?} {p:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_box_has_its_normal_on_the_very_face_and_no_curvature_there() {
        let cube = Cuboid { center: DVec3::ZERO, half_size: DVec3::ONE, rounding: 0.0 };
        for x in [1.0f32, 1.0 + 1e-6, 1.0 - 1e-6, 1.001] {
            let jet = cube.distance(Jet::point([x, 0.3, -0.2]));
            assert_eq!(jet.gradient, [1.0, 0.0, 0.0]);
            assert_eq!(jet.hessian, [0.0; 6]);
        }
    }

    #[test]
    fn derivatives_are_finite_on_singular_points() {
        for shape in all() {
            let Some(bounds) = shape.bounds() else { continue };
            let c = bounds.center();
            for p in [c, c + Vec3::X * 1e-20, c + Vec3::Y * 0.1] {
                let jet = shape.distance(Jet::point([p.x, p.y, p.z]));
                assert!(jet.gradient.iter().chain(&jet.hessian).all(|x| x.is_finite()), "{shape:?}");
            }
        }
    }

    #[test]
    fn bounds_hold_the_solid_and_touch_it() {
        for shape in all() {
            let Some(bounds) = shape.bounds() else { continue };
            for p in points(3000) {
                let inside = Vec3::from_array(p.map(|x| x as f32));
                assert!(shape.distance(p) > 1e-6 || bounds.contains(inside), "{shape:?}");
            }
            // The face x = max touches the solid: somewhere on it the distance is nearly zero.
            let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
            let nearest = (0..=200)
                .flat_map(|i| (0..=200).map(move |j| (f64::from(i) / 200.0, f64::from(j) / 200.0)))
                .map(|(u, v)| shape.distance([max.x, min.y + u * (max.y - min.y), min.z + v * (max.z - min.z)]))
                .fold(f64::INFINITY, f64::min);
            assert!(nearest.abs() < 1e-3, "{shape:?}: {nearest}");
        }
    }
}
