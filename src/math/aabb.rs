//! Axis-aligned boxes and the part of a ray inside them.

use glam::{Vec3, Vec3A};

/// A closed axis-aligned box; empty where a minimum exceeds its maximum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aabb {
    /// Smallest coordinates.
    pub min: Vec3,
    /// Largest coordinates.
    pub max: Vec3,
}

impl Aabb {
    /// Holds no point; the neutral element of [`Aabb::union`].
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The box between two corners.
    pub fn new(min: Vec3, max: Vec3) -> Self {
        Self { min, max }
    }

    /// The smallest box around the points.
    pub fn from_points(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| Self::new(b.min.min(p), b.max.max(p)))
    }

    /// True when no point is inside.
    pub fn is_empty(&self) -> bool {
        self.min.cmpgt(self.max).any()
    }

    /// The smallest box around both.
    pub fn union(&self, other: &Self) -> Self {
        Self::new(self.min.min(other.min), self.max.max(other.max))
    }

    /// Grown by `margin` on every side.
    pub fn dilated(&self, margin: f32) -> Self {
        Self::new(self.min - margin, self.max + margin)
    }

    /// Edge lengths.
    pub fn size(&self) -> Vec3 {
        self.max - self.min
    }

    /// The middle.
    pub fn center(&self) -> Vec3 {
        (self.min + self.max) * 0.5
    }

    /// True for points inside or on the faces.
    pub fn contains(&self, p: Vec3) -> bool {
        p.cmpge(self.min).all() && p.cmple(self.max).all()
    }

    /// The parameters `(t0, t1)`, `t0 < t1`, between which `origin + t·direction` is inside, cut to `[t_min, t_max]`;
    /// `None` where the ray misses. Components of `direction` may be zero.
    pub fn ray_interval(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> Option<(f32, f32)> {
        let (mut t0, mut t1) = (t_min, t_max);
        for axis in 0..3 {
            if direction[axis] == 0.0 {
                if origin[axis] < self.min[axis] || origin[axis] > self.max[axis] {
                    return None;
                }
                continue;
            }
            let inverse = 1.0 / direction[axis];
            let a = (self.min[axis] - origin[axis]) * inverse;
            let b = (self.max[axis] - origin[axis]) * inverse;
            t0 = t0.max(a.min(b));
            t1 = t1.min(a.max(b));
        }
        (t0 < t1).then_some((t0, t1))
    }

    /// Whether all of the segment from `origin` to `end` lies beyond the plane of one face, so that it misses the box; false
    /// leaves it open. Where coordinates of `end` are no number, as those of an infinite ray along a face, `origin` decides.
    #[inline]
    pub fn is_beside(&self, origin: Vec3, end: Vec3) -> bool {
        let (a, b) = (Vec3A::from(origin), Vec3A::from(end));
        // The second of two is what comes of a comparison with what is no number.
        (b.min(a).cmpgt(self.max.into()) | b.max(a).cmplt(self.min.into())).any()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_through_the_middle_enters_and_leaves_at_the_faces() {
        let b = Aabb::new(Vec3::splat(-1.0), Vec3::splat(1.0));
        assert_eq!(b.ray_interval(Vec3::new(-3.0, 0.0, 0.0), Vec3::X, 0.0, 10.0), Some((2.0, 4.0)));
        assert_eq!(b.ray_interval(Vec3::ZERO, Vec3::X, 0.0, 10.0), Some((0.0, 1.0)));
        assert_eq!(b.ray_interval(Vec3::new(-3.0, 2.0, 0.0), Vec3::X, 0.0, 10.0), None);
        assert_eq!(b.ray_interval(Vec3::new(3.0, 0.0, 0.0), Vec3::X, 0.0, 10.0), None);
    }

    #[test]
    fn what_is_beside_the_box_never_meets_it() {
        use crate::math::hash::{CounterRng, Seed};
        let b = Aabb::new(Vec3::new(-1.0, 0.0, 0.5), Vec3::new(1.0, 0.3, 2.0));
        let mut rng = CounterRng::new(Seed(3));
        let (mut beside, mut missed) = (0, 0);
        for i in 0..4000 {
            let mut point = || Vec3::from_array([(); 3].map(|()| rng.uniform() * 6.0 - 3.0));
            let (origin, mut direction) = (point(), point());
            direction[i % 5 % 3] *= f32::from(i % 5 < 3);
            let t_max = if i % 2 == 0 { 1.0 } else { f32::INFINITY };
            let meets = b.ray_interval(origin, direction, 0.0, t_max).is_some();
            let is_beside = b.is_beside(origin, origin + direction * t_max);
            assert!(!(meets && is_beside), "{origin} {direction} {t_max}");
            beside += u32::from(is_beside);
            missed += u32::from(!meets);
        }
        assert!(beside > 2000 && missed > beside, "{beside} of {missed}");
        assert!(Aabb::EMPTY.is_beside(Vec3::ZERO, Vec3::ONE));
    }

    #[test]
    fn the_empty_box_is_neutral_in_unions() {
        let b = Aabb::new(Vec3::ZERO, Vec3::ONE);
        assert!(Aabb::EMPTY.is_empty());
        assert_eq!(Aabb::EMPTY.union(&b), b);
    }
}
