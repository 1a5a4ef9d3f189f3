//! Points of world and of index space, unit directions, and the similarity transforms between spaces.
//!
//! Points, offsets and directions are different types: adding two points does not compile.

use glam::{Quat, Vec3};
use std::ops::{Add, Deref, Neg, Sub};

/// A position in world space [m].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WorldPoint(pub Vec3);

/// A continuous position in the index space of a grid [voxels]: sample (i, j, k) sits at exactly (i, j, k).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct IndexPoint(pub Vec3);

/// A direction of length 1 to rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnitVec3(Vec3);

impl WorldPoint {
    /// The point with the given coordinates [m].
    pub const fn new(x: f32, y: f32, z: f32) -> Self {
        Self(Vec3::new(x, y, z))
    }
}

impl Add<Vec3> for WorldPoint {
    type Output = Self;
    #[inline]
    fn add(self, offset: Vec3) -> Self {
        Self(self.0 + offset)
    }
}

impl Sub<Vec3> for WorldPoint {
    type Output = Self;
    #[inline]
    fn sub(self, offset: Vec3) -> Self {
        Self(self.0 - offset)
    }
}

impl Sub for WorldPoint {
    type Output = Vec3;
    #[inline]
    fn sub(self, other: Self) -> Vec3 {
        self.0 - other.0
    }
}

impl UnitVec3 {
    /// The direction of +y, up.
    pub const Y: Self = Self(Vec3::Y);

    /// The direction of `v`, or `None` where it has none (zero, infinite or NaN).
    #[inline]
    pub fn try_new(v: Vec3) -> Option<Self> {
        v.try_normalize().map(Self)
    }

    /// Takes `v` as it is.
    ///
    /// # Panics
    /// In builds with debug assertions, where its length is further than 1e-3 from 1.
    #[inline]
    pub fn new_unchecked(v: Vec3) -> Self {
        debug_assert!((v.length() - 1.0).abs() < 1e-3, "not a unit vector: {v}");
        Self(v)
    }

    /// The coordinates.
    #[inline]
    pub fn as_vec3(self) -> Vec3 {
        self.0
    }

    /// Two directions that make a right-handed orthonormal frame with this one as its third axis, without a branch
    /// and continuous but for the sign of z (Duff et al. 2017, *Building an Orthonormal Basis, Revisited*).
    #[inline]
    pub fn orthonormal_pair(self) -> (Vec3, Vec3) {
        let n = self.0;
        let sign = 1f32.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        (Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y))
    }

    /// The direction with coordinates `local` in the frame whose third axis is this one.
    #[inline]
    pub fn from_local(self, local: Vec3) -> Self {
        let (s, t) = self.orthonormal_pair();
        let direction = s * local.x + t * local.y + self.0 * local.z;
        // A step of Newton's for the inverse root, so that thousands of turns in a row do not add up.
        Self(direction * (1.5 - 0.5 * direction.length_squared()))
    }
}

impl Deref for UnitVec3 {
    type Target = Vec3;
    #[inline]
    fn deref(&self) -> &Vec3 {
        &self.0
    }
}

impl Neg for UnitVec3 {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

/// Rotation, uniform scale and translation: takes a shape's own space to world space and keeps distances but for the
/// factor `scale`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    /// Factor on lengths, > 0.
    pub scale: f32,
    /// Applied after the scale.
    pub rotation: Quat,
    /// Applied last [m].
    pub translation: Vec3,
}

impl Similarity {
    /// Leaves everything where it is.
    pub const IDENTITY: Self = Self { scale: 1.0, rotation: Quat::IDENTITY, translation: Vec3::ZERO };

    /// This one first, then `next`.
    pub fn then(&self, next: &Self) -> Self {
        Self {
            scale: self.scale * next.scale,
            rotation: (next.rotation * self.rotation).normalize(),
            translation: next.point_to_world(self.translation).0,
        }
    }

    /// From the shape's space to the world.
    pub fn point_to_world(&self, p: Vec3) -> WorldPoint {
        WorldPoint(self.rotation * (p * self.scale) + self.translation)
    }

    /// From the world to the shape's space.
    pub fn point_to_local(&self, p: WorldPoint) -> Vec3 {
        self.rotation.inverse() * (p.0 - self.translation) / self.scale
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_frame_of_a_direction_is_orthonormal_and_right_handed() {
        for i in 0..1000 {
            let a = i as f32 * 0.737;
            let n = UnitVec3::try_new(Vec3::new(a.sin(), (1.3 * a).cos(), (0.7 * a).sin() - 0.2)).expect("not zero");
            let (s, t) = n.orthonormal_pair();
            assert!((s.length() - 1.0).abs() < 1e-5 && (t.length() - 1.0).abs() < 1e-5);
            assert!(s.dot(t).abs() < 1e-5 && (s.cross(t) - *n).length() < 1e-5);
        }
    }

    #[test]
    fn a_similarity_and_its_inverse_cancel() {
        let m = Similarity { scale: 2.5, rotation: Quat::from_rotation_y(0.7), translation: Vec3::new(1.0, -2.0, 0.5) };
        let p = Vec3::new(0.3, -0.4, 1.2);
        assert!((m.point_to_local(m.point_to_world(p)) - p).length() < 1e-6);
    }
}
