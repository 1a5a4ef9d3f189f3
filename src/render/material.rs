//! Surfaces: materials, and what light meets at a point of one.

use crate::flow::surface::SurfaceFlow;
use crate::math::space::{Similarity, UnitVec3, WorldPoint};
use crate::render::bsdf::Bsdf;
use crate::render::bsdf::conductor::{Metal, MetalColor};
use crate::render::bsdf::dielectric::Glass;
use crate::render::bsdf::plastic::Plastic;
use crate::render::bsdf::principled::Principled;
use crate::render::color::Rgb;
use crate::render::texture::Texture;
use glam::Vec3;
use std::sync::Arc;

/// What a surface does to light.
#[derive(Debug)]
pub struct Material {
    /// How it scatters.
    pub kind: MaterialKind,
    /// Its colour, each channel in [0, 1]: what that is, is the kind's to say.
    pub color: Texture,
    /// Radiance that it gives off [W/(m² sr)], in all directions alike.
    pub emission: Option<Texture>,
    /// Where its shape has moved from where it rests, which is where textures are looked up.
    pub moved: Similarity,
    /// What carries textures along its surface.
    pub flow: Option<Arc<SurfaceFlow>>,
    /// Whether its inside is black.
    pub is_one_sided: bool,
    /// What the camera sees of it.
    pub sight: Sight,
}

/// What the camera sees of a shape where it looks at it straight. All other light meets it as any.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sight {
    /// The shape.
    Whole,
    /// What is behind it.
    Through,
    /// A hole in the picture.
    Hole,
    /// The shadow on it.
    Shadow,
}

/// What light meets at a point of a surface.
#[derive(Debug, Clone, Copy)]
pub struct SurfacePoint<'a> {
    /// How it scatters.
    pub bsdf: Bsdf<'a>,
    /// Radiance that it gives off [W/(m² sr)].
    pub emitted: Rgb,
}

/// How a material scatters light.
#[derive(Debug)]
pub enum MaterialKind {
    /// Lambert: reflects alike in all directions. Its colour is the share of light reflected.
    Diffuse,
    /// A metal. Its colour is the share of what the bare metal reflects.
    Conductor {
        /// Its roughness.
        metal: Box<Metal>,
        /// What the bare metal reflects.
        color: MetalColor,
    },
    /// Glass. Its colour is the share let through of what is not reflected.
    Dielectric(Box<Glass>),
    /// A diffuse base under a clear coat. Its colour is the share of light that the base reflects.
    Plastic(Box<Plastic>),
    /// A mix. Its colour is that of all parts but the coat.
    Principled(Box<Principled>),
}

impl Material {
    /// The material at a point of the surface with its outward normal, seen `from_outside` or from inside.
    #[inline]
    pub fn seen(&self, point: WorldPoint, normal: UnitVec3, from_outside: bool) -> SurfacePoint<'_> {
        if from_outside {
            return self.at(point, normal);
        }
        if self.is_one_sided {
            return SurfacePoint { bsdf: Bsdf::Diffuse { reflectance: Vec3::ZERO }, emitted: Vec3::ZERO };
        }
        let mut seen = self.at(point, normal);
        if let Bsdf::Dielectric { is_front, .. } | Bsdf::Principled { is_front, .. } = &mut seen.bsdf {
            *is_front = false;
        }
        seen
    }

    /// The material at a point of the surface with its outward normal, seen from outside.
    ///
    /// What flows brings its own normal along: textures are those of the place that it came from.
    pub fn at(&self, point: WorldPoint, normal: UnitVec3) -> SurfacePoint<'_> {
        if let (Texture::Constant(color), None) = (&self.color, &self.emission) {
            return SurfacePoint { bsdf: self.kind.with_color(*color), emitted: Vec3::ZERO };
        }
        let is_patterned = !self.color.is_constant() || self.emission.as_ref().is_some_and(|e| !e.is_constant());
        let mut p = self.moved.point_to_local(point).to_array().map(f64::from);
        let flow = self.flow.as_ref().filter(|_| is_patterned);
        if let Some(flow) = flow {
            p = flow.origin(p);
        }
        let normal = || match flow {
            Some(flow) => flow.normal(p),
            None => (self.moved.rotation.inverse() * normal.as_vec3()).as_dvec3(),
        };
        SurfacePoint {
            bsdf: self.kind.with_color(self.color.at(p, normal)),
            emitted: self.emission.as_ref().map_or(Vec3::ZERO, |emission| emission.at(p, normal)),
        }
    }
}

impl MaterialKind {
    /// How a point scatters light where the colour is `color`, seen from outside.
    #[inline]
    fn with_color(&self, color: Rgb) -> Bsdf<'_> {
        match self {
            Self::Diffuse => Bsdf::Diffuse { reflectance: color },
            Self::Conductor { metal, color: bare } => Bsdf::Conductor { metal, color: *bare, tint: color },
            Self::Dielectric(glass) => Bsdf::Dielectric { glass, tint: color, is_front: true },
            Self::Plastic(plastic) => Bsdf::Plastic { plastic, reflectance: color },
            Self::Principled(model) => Bsdf::Principled { model, base_color: color, is_front: true },
        }
    }
}
