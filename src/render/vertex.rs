//! A place where light changes direction: smoke and surfaces behind one face.

use crate::geometry::embree::Hit;
use crate::math::space::{UnitVec3, WorldPoint};
use crate::render::color::Rgb;
use crate::render::film::Contribution;
use crate::render::light_path::FirstEvent;
use crate::render::material::Bsdf;
use crate::render::medium::Medium;
use glam::Vec3;

/// A place where light changes direction.
pub enum Vertex<'a> {
    /// In smoke.
    Smoke {
        /// Where.
        point: WorldPoint,
        /// The smoke.
        medium: &'a Medium,
        /// Direction of travel of the path before.
        before: UnitVec3,
    },
    /// At a surface.
    Surface {
        /// Where.
        hit: Hit,
        /// Direction of travel of the path before.
        before: UnitVec3,
        /// Shading normal on the side that the path came from.
        normal: UnitVec3,
        /// What the surface does to light.
        bsdf: Bsdf,
    },
}

/// A direction to go on along.
pub struct Scattering {
    /// Direction of travel after the scattering.
    pub direction: UnitVec3,
    /// Density over solid angle [1/sr].
    pub pdf: f32,
    /// Scattering function times cosine over density.
    pub weight: Rgb,
}

impl Vertex<'_> {
    /// Where.
    pub fn point(&self) -> WorldPoint {
        match self {
            Vertex::Smoke { point, .. } => *point,
            Vertex::Surface { hit, .. } => hit.position,
        }
    }

    /// Where a ray starts that leaves along `direction`.
    pub fn leave(&self, direction: UnitVec3) -> WorldPoint {
        match self {
            Vertex::Smoke { point, .. } => *point,
            Vertex::Surface { hit, .. } => hit.offset_origin(direction),
        }
    }

    /// Scattering towards `direction`: albedo times phase function [1/sr], or scattering function times cosine.
    pub fn value(&self, direction: UnitVec3) -> Rgb {
        match self {
            Vertex::Smoke { medium, before, .. } => medium.albedo * medium.phase.value(*before, direction),
            Vertex::Surface { hit, before, normal, bsdf } => {
                // Shading normals must not let light through the surface.
                let same_side = hit.normal.dot(*direction) * hit.normal.dot(**before) < 0.0;
                if same_side { bsdf.value(*normal, direction) } else { Vec3::ZERO }
            }
        }
    }

    /// Density [1/sr] with which [`Vertex::sample`] returns `direction`.
    pub fn pdf(&self, direction: UnitVec3) -> f32 {
        match self {
            Vertex::Smoke { medium, before, .. } => medium.phase.value(*before, direction),
            Vertex::Surface { normal, bsdf, .. } => bsdf.pdf(*normal, direction),
        }
    }

    /// A direction to go on along, from two uniform numbers.
    pub fn sample(&self, u: [f32; 2]) -> Scattering {
        match self {
            Vertex::Smoke { medium, before, .. } => {
                let s = medium.phase.sample(*before, u);
                Scattering { direction: s.direction, pdf: s.pdf, weight: medium.albedo }
            }
            Vertex::Surface { hit, before, normal, bsdf } => {
                let s = bsdf.sample(*normal, u);
                let same_side = hit.normal.dot(*s.direction) * hit.normal.dot(**before) < 0.0;
                let weight = if same_side { s.weight } else { Vec3::ZERO };
                Scattering { direction: s.direction, pdf: s.pdf, weight }
            }
        }
    }

    /// Notes the first event for the further layers.
    pub fn describe(&self, out: &mut Contribution) {
        match self {
            Vertex::Smoke { medium, .. } => {
                out.first = FirstEvent::Smoke;
                out.albedo = medium.albedo;
            }
            Vertex::Surface { hit, normal, bsdf, .. } => {
                out.first = FirstEvent::Surface;
                out.shape_idx = Some(hit.shape_idx);
                out.normal = normal.as_vec3();
                out.albedo = bsdf.albedo();
            }
        }
    }
}
