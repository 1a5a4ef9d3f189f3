//! A place where light changes direction: smoke and surfaces behind one face.

use crate::geometry::embree::Hit;
use crate::math::space::{UnitVec3, WorldPoint};
use crate::render::bsdf::Bsdf;
use crate::render::color::Rgb;
use crate::render::film::Contribution;
use crate::render::light_path::FirstEvent;
use crate::render::medium::Matter;
use glam::Vec3;

/// A place where light changes direction.
pub enum Vertex<'a> {
    /// In smoke.
    Smoke {
        /// Where.
        point: WorldPoint,
        /// What scatters there.
        matter: &'a Matter,
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
        bsdf: Bsdf<'a>,
    },
}

/// A direction to go on along.
pub struct Scattering {
    /// Direction of travel after the scattering.
    pub direction: UnitVec3,
    /// Density over solid angle [1/sr]; `None` for a direction that no light could have been sampled in, of what is
    /// mirrored or bent perfectly.
    pub pdf: Option<f32>,
    /// Scattering function times cosine over density.
    pub weight: Rgb,
    /// Square of the index of refraction on the new side over that on the old one: by so much radiance changes for being
    /// there, which roulette leaves alone.
    pub eta_sq: f32,
}

impl Vertex<'_> {
    /// Where.
    #[inline]
    pub fn point(&self) -> WorldPoint {
        match self {
            Vertex::Smoke { point, .. } => *point,
            Vertex::Surface { hit, .. } => hit.position,
        }
    }

    /// Where a ray starts that leaves along `direction`.
    #[inline]
    pub fn leave(&self, direction: UnitVec3) -> WorldPoint {
        match self {
            Vertex::Smoke { point, .. } => *point,
            Vertex::Surface { hit, .. } => hit.offset_origin(direction),
        }
    }

    /// Scattering towards `direction`: albedo times phase function [1/sr], or scattering function times cosine.
    #[inline]
    pub fn value(&self, direction: UnitVec3) -> Rgb {
        match self {
            Vertex::Smoke { matter, before, .. } => matter.albedo * matter.phase.value(*before, direction),
            Vertex::Surface { hit, before, normal, bsdf } => {
                if sides_agree(hit, *before, *normal, direction) {
                    bsdf.value(*normal, *before, direction)
                } else {
                    Vec3::ZERO
                }
            }
        }
    }

    /// Density [1/sr] with which [`Vertex::sample`] returns `direction`.
    #[inline]
    pub fn pdf(&self, direction: UnitVec3) -> f32 {
        match self {
            Vertex::Smoke { matter, before, .. } => matter.phase.value(*before, direction),
            Vertex::Surface { before, normal, bsdf, .. } => bsdf.pdf(*normal, *before, direction),
        }
    }

    /// A direction to go on along, from three uniform numbers; `None` where the light is absorbed.
    #[inline]
    pub fn sample(&self, u: [f32; 3]) -> Option<Scattering> {
        match self {
            Vertex::Smoke { matter, before, .. } => {
                let s = matter.phase.sample(*before, [u[0], u[1]]);
                Some(Scattering { direction: s.direction, pdf: Some(s.pdf), weight: matter.albedo, eta_sq: 1.0 })
            }
            Vertex::Surface { hit, before, normal, bsdf } => {
                let s = bsdf.sample(*normal, *before, u)?;
                let eta_sq = if normal.dot(*s.direction) > 0.0 { 1.0 } else { bsdf.eta() * bsdf.eta() };
                sides_agree(hit, *before, *normal, s.direction).then_some(Scattering {
                    direction: s.direction,
                    pdf: s.pdf,
                    weight: s.weight,
                    eta_sq,
                })
            }
        }
    }

    /// Notes the first event for the further layers.
    #[inline]
    pub fn describe(&self, out: &mut Contribution) {
        out.place = self.point();
        match self {
            Vertex::Smoke { matter, .. } => {
                out.first = FirstEvent::Smoke;
                out.is_carried = matter.is_carried;
                out.albedo = matter.albedo;
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

/// Whether a direction is on the same side of the surface as of the plane it is shaded by: shading normals must neither let
/// light through a surface nor take what goes through for reflected.
#[inline]
fn sides_agree(hit: &Hit, before: UnitVec3, normal: UnitVec3, direction: UnitVec3) -> bool {
    let sides = hit.normal.dot(*direction) * hit.normal.dot(*before);
    if normal.dot(*direction) > 0.0 { sides < 0.0 } else { sides > 0.0 }
}
