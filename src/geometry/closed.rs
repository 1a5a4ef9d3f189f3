//! Solids whose crossings with a ray have a closed form: ball, box with sharp edges, and the square of a half space.
//!
//! Floors, walls and balls are in nearly every scene, and nearly every ray asks for them, so where they are few they are met
//! outside of the tree of all other shapes.

use crate::geometry::primitive::{Cuboid, HalfSpace, Primitive, Sphere};
use crate::geometry::sdf::{PlacedSdf, Sdf};
use crate::math::space::{Similarity, UnitVec3};
use glam::{DMat3, DVec3, Vec3};

/// A solid that rays meet by a formula.
#[derive(Debug, Clone, Copy)]
pub enum Closed {
    /// What can be hit of a half space.
    Square(Square),
    /// A sphere.
    Ball(Ball),
    /// A box with sharp edges.
    Block(Block),
}

impl Closed {
    /// `sdf`, if there is a closed form for it; of a half space, a square of half-width `extent` round its point [m, own
    /// space].
    pub fn try_new(sdf: &PlacedSdf, extent: f64) -> Option<Self> {
        let Sdf::Primitive(primitive) = sdf.sdf() else { return None };
        let at = sdf.placement();
        match primitive {
            Primitive::HalfSpace(plane) => Some(Self::Square(Square::new(plane, extent, at))),
            Primitive::Sphere(sphere) => Some(Self::Ball(Ball::new(sphere, at))),
            Primitive::Cuboid(cuboid) if cuboid.rounding == 0.0 => Some(Self::Block(Block::new(cuboid, at))),
            Primitive::Cuboid(_) | Primitive::Capsule(_) | Primitive::Torus(_) => None,
        }
    }

    /// The least ray parameter in `(t_min, t_max)` where the ray crosses the surface, from outside or from inside.
    /// `direction` has length 1.
    #[inline]
    pub fn crossing(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> Option<f32> {
        let (origin, direction) = (origin.as_dvec3(), direction.as_dvec3());
        let candidates = match self {
            Self::Square(square) => [square.crossing(origin, direction); 2],
            Self::Ball(ball) => ball.crossings(origin, direction),
            Self::Block(block) => block.crossings(origin, direction),
        };
        // What is no number, where there is no crossing, is in no range.
        let (near, far) = (candidates[0] as f32, candidates[1] as f32);
        if near > t_min && near < t_max {
            return Some(near);
        }
        (far > t_min && far < t_max).then_some(far)
    }

    /// Outward normal at a point of the surface.
    #[inline]
    pub fn normal_at(&self, p: DVec3) -> UnitVec3 {
        // A point far along a ray is beside the surface by its rounding.
        let normal = match self {
            Self::Square(square) => square.normal,
            Self::Ball(ball) => (p - ball.center).normalize_or(DVec3::Y),
            Self::Block(block) => block.normal_at(p),
        };
        UnitVec3::new_unchecked(normal.as_vec3())
    }
}

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
    fn new(plane: &HalfSpace, extent: f64, placement: &Similarity) -> Self {
        let (rotation, scale) = (placement.rotation.as_dquat(), f64::from(placement.scale));
        let (u, v) = plane.normal.any_orthonormal_pair();
        Self {
            middle: rotation * plane.point * scale + placement.translation.as_dvec3(),
            normal: rotation * plane.normal,
            edges: [u, v].map(|edge| rotation * edge),
            half_width: extent * scale,
        }
    }

    /// Its corners [m].
    pub fn corners(&self) -> [DVec3; 4] {
        let [u, v] = self.edges.map(|edge| edge * self.half_width);
        [u + v, u - v, v - u, -u - v].map(|corner| self.middle + corner)
    }

    #[inline]
    fn crossing(&self, origin: DVec3, direction: DVec3) -> f64 {
        let to_middle = self.middle - origin;
        // Of a ray along the plane it is infinite or no number, and in no range.
        let t = to_middle.dot(self.normal) / direction.dot(self.normal);
        let place = direction * t - to_middle;
        let is_within =
            place.dot(self.edges[0]).abs() <= self.half_width && place.dot(self.edges[1]).abs() <= self.half_width;
        if is_within { t } else { f64::NAN }
    }
}

/// A sphere in the world.
#[derive(Debug, Clone, Copy)]
pub struct Ball {
    center: DVec3,
    radius: f64,
}

impl Ball {
    fn new(sphere: &Sphere, at: &Similarity) -> Self {
        let scale = f64::from(at.scale);
        let center = at.rotation.as_dquat().normalize() * sphere.center * scale + at.translation.as_dvec3();
        Self { center, radius: sphere.radius * scale }
    }

    #[inline]
    fn crossings(&self, origin: DVec3, direction: DVec3) -> [f64; 2] {
        // From the point of the ray nearest to the middle, so that no digits are lost from afar.
        let to_center = self.center - origin;
        let nearest = to_center.dot(direction) / direction.length_squared();
        let miss = direction * nearest - to_center;
        let half = ((self.radius * self.radius - miss.length_squared()) / direction.length_squared()).sqrt();
        [nearest - half, nearest + half]
    }
}

/// A box in the world, with sharp edges.
#[derive(Debug, Clone, Copy)]
pub struct Block {
    /// From world directions to those along its edges.
    to_own: DMat3,
    /// Most boxes are not.
    is_turned: bool,
    center: DVec3,
    /// Half its edge lengths [m].
    half_size: DVec3,
}

impl Block {
    fn new(cuboid: &Cuboid, at: &Similarity) -> Self {
        let (rotation, scale) = (at.rotation.as_dquat().normalize(), f64::from(at.scale));
        let to_own = DMat3::from_quat(rotation).transpose();
        Self {
            to_own,
            is_turned: to_own != DMat3::IDENTITY,
            center: rotation * cuboid.center * scale + at.translation.as_dvec3(),
            half_size: cuboid.half_size * scale,
        }
    }

    #[inline]
    fn crossings(&self, origin: DVec3, direction: DVec3) -> [f64; 2] {
        let (mut origin, mut direction) = (origin - self.center, direction);
        if self.is_turned {
            (origin, direction) = (self.to_own * origin, self.to_own * direction);
        }
        let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            let inverse = 1.0 / direction[axis];
            // Of a ray within the plane of a face one is no number: it passes beside the box, or comparisons pass it over.
            let (a, b) =
                ((-self.half_size[axis] - origin[axis]) * inverse, (self.half_size[axis] - origin[axis]) * inverse);
            let (enter, leave) = if a < b { (a, b) } else { (b, a) };
            near = if enter > near { enter } else { near };
            far = if leave < far { leave } else { far };
        }
        if near <= far { [near, far] } else { [f64::NAN; 2] }
    }

    fn normal_at(&self, p: DVec3) -> DVec3 {
        let own = self.to_own * (p - self.center);
        let beyond = own.abs() - self.half_size;
        let is_x = beyond.x >= beyond.y && beyond.x >= beyond.z;
        let axis = if is_x { 0 } else { 1 + usize::from(beyond.z > beyond.y) };
        self.to_own.row(axis) * own[axis].signum()
    }
}
