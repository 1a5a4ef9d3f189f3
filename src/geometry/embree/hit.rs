//! Rays, and where they meet surfaces.

use crate::geometry::embree::sys;
use crate::geometry::mesh::Mesh;
use crate::math::space::{UnitVec3, WorldPoint};
use glam::{DVec3, Vec3};

/// A half line.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Where it starts.
    pub origin: WorldPoint,
    /// Where it goes.
    pub direction: UnitVec3,
}

impl Ray {
    /// The point at distance `t` [m].
    #[inline]
    pub fn at(&self, t: f32) -> WorldPoint {
        self.origin + self.direction.as_vec3() * t
    }
}

/// Where a ray meets a surface.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    /// Distance along the ray [m].
    pub t: f32,
    /// The point on the surface, more accurate than `ray.at(t)`.
    pub position: WorldPoint,
    /// Outward normal of the surface itself, whichever side was hit.
    pub normal: UnitVec3,
    /// Outward normal to shade with: interpolated where the mesh has vertex normals, otherwise `normal`.
    pub shading_normal: UnitVec3,
    /// Which shape, by its place in the scene's shapes.
    pub shape_idx: u32,
    /// By how much `position` and later hits of the same surface can be wrong [m].
    error: f32,
}

impl Hit {
    /// Where a ray must start that leaves this surface in `direction`, so that it does not meet it again: a few
    /// rounding errors off the surface, on the side that `direction` points to.
    #[inline]
    pub fn offset_origin(&self, direction: UnitVec3) -> WorldPoint {
        let n = self.normal.as_vec3();
        self.position + n * self.error.copysign(n.dot(*direction))
    }
}

impl Hit {
    /// The same hit of a body that was moved and made `scale` times larger.
    #[inline]
    pub(in crate::geometry) fn moved(
        &self,
        t: f32,
        position: WorldPoint,
        [normal, shading_normal]: [UnitVec3; 2],
        scale: f32,
    ) -> Self {
        // Far from the origin at either place, coordinates are rounded.
        let error = (self.error * scale).max(OFFSET_ROUNDINGS * f32::EPSILON * (position.0.abs().max_element() + t));
        Self { t, position, normal, shading_normal, shape_idx: self.shape_idx, error }
    }
}

/// Rounding errors, relative to the largest coordinate involved, by which new rays are moved off a surface. Fewer let
/// rays meet the surface they leave; more let light through walls thinner than this, 4 µm at one metre.
const OFFSET_ROUNDINGS: f32 = 32.0;

#[inline]
pub(super) fn triangle_hit(mesh: &Mesh, ray: &Ray, found: &sys::RtcRayHit, shape_idx: u32) -> Hit {
    let corners = mesh.triangles()[found.hit.prim_id as usize].map(|i| i as usize);
    let [a, b, c] = corners.map(|i| mesh.positions()[i]);
    let (u, v) = (found.hit.u, found.hit.v);
    let position = a + (b - a) * u + (c - a) * v;
    let normal = UnitVec3::try_new(Vec3::from_array(found.hit.ng)).unwrap_or(-ray.direction);
    let shading_normal = if mesh.normals().is_empty() {
        normal
    } else {
        let [na, nb, nc] = corners.map(|i| mesh.normals()[i]);
        let smooth = na * (1.0 - u - v) + nb * u + nc * v;
        // Files with triangles one way round and normals the other are common.
        UnitVec3::try_new(if smooth.dot(*normal) < 0.0 { -smooth } else { smooth }).unwrap_or(normal)
    };
    let scale = a.abs().max(b.abs()).max(c.abs()).max_element();
    let error = OFFSET_ROUNDINGS * f32::EPSILON * scale;
    Hit { t: found.ray.tfar, position: WorldPoint(position), normal, shading_normal, shape_idx, error }
}

#[inline]
pub(super) fn hit_on_solid(ray: &Ray, t: f32, shape_idx: u32, normal_at: impl FnOnce(DVec3) -> UnitVec3) -> Hit {
    let position = ray.origin.0.as_dvec3() + ray.direction.as_vec3().as_dvec3() * f64::from(t);
    let normal = normal_at(position);
    let position = position.as_vec3();
    let error = OFFSET_ROUNDINGS * f32::EPSILON * (position.abs().max_element() + t);
    Hit { t, position: WorldPoint(position), normal, shading_normal: normal, shape_idx, error }
}
