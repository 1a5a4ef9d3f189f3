//! The flat square that stands for a half space: what rays can hit of it.
//!
//! Floors are in nearly every scene and nearly every ray asks for them, so they are met by their own formula, outside of
//! the tree of all other shapes.

use crate::geometry::primitive::HalfSpace;
use crate::math::space::{Similarity, UnitVec3};
use glam::{DVec3, Vec3};

/// A flat square in the world.
#[derive(Debug, Clone, Copy)]
pub struct Square {
    middle: DVec3,
    normal: DVec3,
    /// Directions of its edges, of length 1.
    edges: [DVec3; 2],
    /// Half the length of an edge [m].
    half_width: f64,
}

impl Square {
    /// The square of half-width `extent` [m, own space] round the point of a half space that stands at `placement`.
    pub fn new(plane: &HalfSpace, extent: f64, placement: &Similarity) -> Self {
        let (rotation, scale) = (placement.rotation.as_dquat(), f64::from(placement.scale));
        let (u, v) = plane.normal.any_orthonormal_pair();
        Self {
            middle: rotation * plane.point * scale + placement.translation.as_dvec3(),
            normal: rotation * plane.normal,
            edges: [u, v].map(|edge| rotation * edge),
            half_width: extent * scale,
        }
    }

    /// The normal of the half space, outwards.
    pub fn normal(&self) -> UnitVec3 {
        UnitVec3::new_unchecked(self.normal.as_vec3().normalize())
    }

    /// Its corners [m].
    pub fn corners(&self) -> [DVec3; 4] {
        let [u, v] = self.edges.map(|edge| edge * self.half_width);
        [u + v, u - v, v - u, -u - v].map(|corner| self.middle + corner)
    }

    /// The ray parameter in `(t_min, t_max)` where the ray crosses the square.
    #[inline]
    pub fn crossing(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> Option<f32> {
        let (origin, direction) = (origin.as_dvec3(), direction.as_dvec3());
        let to_middle = self.middle - origin;
        // Of a ray along the plane it is infinite or no number, and in no range.
        let exact = to_middle.dot(self.normal) / direction.dot(self.normal);
        let t = exact as f32;
        if !(t > t_min && t < t_max) {
            return None;
        }
        let place = direction * exact - to_middle;
        let is_within = |edge: DVec3| place.dot(edge).abs() <= self.half_width;
        (is_within(self.edges[0]) && is_within(self.edges[1])).then_some(t)
    }
}
