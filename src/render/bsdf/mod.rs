//! How surfaces scatter light, one kind in each file.
//!
//! All kinds but Lambert's work in a frame whose third axis is the normal on the side of the path, with `wo` towards
//! where the path came from and `wi` along the direction it goes on in; both point away from the surface and have length 1.
//! Values include the cosine at the surface. What is mirrored or bent perfectly has no density: it is never part of a
//! value, and its samples have none.

pub mod albedo;
pub mod conductor;
pub mod dielectric;
pub mod diffuse;
pub mod fresnel;
pub mod gloss;
pub mod metals;
pub mod microfacet;
pub mod plastic;
pub mod principled;
#[cfg(test)]
mod tests;

use crate::math::space::UnitVec3;
use crate::render::bsdf::conductor::{Metal, MetalColor};
use crate::render::bsdf::dielectric::Glass;
use crate::render::bsdf::plastic::Plastic;
use crate::render::bsdf::principled::Principled;
use crate::render::color::Rgb;
use glam::Vec3;

/// How light scatters at a point of a surface.
#[derive(Debug, Clone, Copy)]
pub enum Bsdf<'a> {
    /// Lambert.
    Diffuse {
        /// Share of light reflected, each channel in [0, 1].
        reflectance: Rgb,
    },
    /// A metal.
    Conductor {
        /// Its roughness.
        metal: &'a Metal,
        /// Its reflectance.
        color: MetalColor,
        /// Share of that which is left, each channel in [0, 1].
        tint: Rgb,
    },
    /// Glass.
    Dielectric {
        /// Its boundary.
        glass: &'a Glass,
        /// Share of light that is let through, each channel in [0, 1].
        tint: Rgb,
        /// Whether the path comes from outside.
        is_front: bool,
    },
    /// A diffuse base under a clear coat.
    Plastic {
        /// The coat.
        plastic: &'a Plastic,
        /// Share of light that the base reflects, each channel in [0, 1].
        reflectance: Rgb,
    },
    /// A mix.
    Principled {
        /// Of what.
        model: &'a Principled,
        /// Its colour, each channel in [0, 1].
        base_color: Rgb,
        /// Whether the path comes from outside.
        is_front: bool,
    },
}

/// A sampled direction.
#[derive(Debug, Clone, Copy)]
pub struct BsdfSample {
    /// Direction of travel away from the surface.
    pub direction: UnitVec3,
    /// Density over solid angle [1/sr]; `None` for what is mirrored or bent perfectly.
    pub pdf: Option<f32>,
    /// Scattering function times cosine over density.
    pub weight: Rgb,
}

/// A sampled direction in the frame of the surface.
#[derive(Debug, Clone, Copy)]
pub struct LocalSample {
    /// Direction of travel away from the surface.
    pub wi: Vec3,
    /// As that of a [`BsdfSample`].
    pub pdf: Option<f32>,
    /// As that of a [`BsdfSample`].
    pub weight: Rgb,
}

/// The least cosine to the normal under which a surface is seen; below, light along it has no part in the picture.
const GRAZING: f32 = 1e-6;

impl Bsdf<'_> {
    /// Scattering function times the cosine at the surface [1/sr], for a path that travels along `before` and goes on along
    /// `outgoing`; `normal` is on the side that the path comes from.
    #[inline]
    pub fn value(&self, normal: UnitVec3, before: UnitVec3, outgoing: UnitVec3) -> Rgb {
        if let Bsdf::Diffuse { reflectance } = self {
            return diffuse::value(*reflectance, normal, outgoing);
        }
        let Some([wo, wi]) = local(normal, before, outgoing) else { return Vec3::ZERO };
        match self {
            Bsdf::Diffuse { .. } => Vec3::ZERO,
            Bsdf::Conductor { metal, color, tint } => metal.value(color, wo, wi) * *tint,
            Bsdf::Dielectric { glass, tint, is_front } => glass.value(*tint, *is_front, wo, wi),
            Bsdf::Plastic { plastic, reflectance } => plastic.value(*reflectance, wo, wi),
            Bsdf::Principled { model, base_color, is_front } => model.value(*base_color, *is_front, wo, wi),
        }
    }

    /// Density [1/sr] with which [`Bsdf::sample`] returns `outgoing`.
    #[inline]
    pub fn pdf(&self, normal: UnitVec3, before: UnitVec3, outgoing: UnitVec3) -> f32 {
        if let Bsdf::Diffuse { .. } = self {
            return diffuse::pdf(normal, outgoing);
        }
        let Some([wo, wi]) = local(normal, before, outgoing) else { return 0.0 };
        match self {
            Bsdf::Diffuse { .. } => 0.0,
            Bsdf::Conductor { metal, color, .. } => metal.pdf(color, wo, wi),
            Bsdf::Dielectric { glass, is_front, .. } => glass.pdf(*is_front, wo, wi),
            Bsdf::Plastic { plastic, reflectance } => plastic.pdf(*reflectance, wo, wi),
            Bsdf::Principled { model, base_color, is_front } => model.pdf(*base_color, *is_front, wo, wi),
        }
    }

    /// A direction of travel away from the surface, from three uniform numbers; `None` where the light is absorbed.
    #[inline]
    pub fn sample(&self, normal: UnitVec3, before: UnitVec3, u: [f32; 3]) -> Option<BsdfSample> {
        if let Bsdf::Diffuse { reflectance } = self {
            return Some(diffuse::sample(*reflectance, normal, [u[0], u[1]]));
        }
        let [wo, _] = local(normal, before, before)?;
        let sample = match self {
            Bsdf::Diffuse { .. } => None,
            Bsdf::Conductor { metal, color, tint } => {
                metal.sample(color, wo, u).map(|s| LocalSample { weight: s.weight * *tint, ..s })
            }
            Bsdf::Dielectric { glass, tint, is_front } => glass.sample(*tint, *is_front, wo, u),
            Bsdf::Plastic { plastic, reflectance } => plastic.sample(*reflectance, wo, u),
            Bsdf::Principled { model, base_color, is_front } => model.sample(*base_color, *is_front, wo, u),
        }?;
        Some(BsdfSample { direction: normal.from_local(sample.wi), pdf: sample.pdf, weight: sample.weight })
    }

    /// Index of refraction behind the surface over that before it; 1 where nothing goes through.
    #[inline]
    pub fn eta(&self) -> f32 {
        match self {
            Bsdf::Dielectric { glass, is_front, .. } => glass.eta(*is_front),
            Bsdf::Principled { model, is_front, .. } => model.eta(*is_front),
            _ => 1.0,
        }
    }

    /// Whether it mirrors or bends light, so that its normal must be one by which light does not go astray.
    #[inline]
    pub fn is_glossy(&self) -> bool {
        !matches!(self, Bsdf::Diffuse { .. })
    }

    /// The colour for the albedo layer: the share of light from straight above that goes on, roughly.
    pub fn albedo(&self) -> Rgb {
        match self {
            Bsdf::Diffuse { reflectance } | Bsdf::Plastic { reflectance, .. } => *reflectance,
            Bsdf::Conductor { color, tint, .. } => color.at(1.0) * *tint,
            Bsdf::Dielectric { tint, .. } => *tint,
            Bsdf::Principled { base_color, .. } => *base_color,
        }
    }
}

/// Where the path came from and where it goes on to, in the frame of the normal; `None` where it came along the surface.
#[inline]
fn local(normal: UnitVec3, before: UnitVec3, outgoing: UnitVec3) -> Option<[Vec3; 2]> {
    let (s, t) = normal.orthonormal_pair();
    let turn = |w: Vec3| Vec3::new(w.dot(s), w.dot(t), w.dot(*normal));
    let wo = turn(-before.as_vec3());
    (wo.z > GRAZING).then(|| [wo.normalize(), turn(outgoing.as_vec3())])
}
