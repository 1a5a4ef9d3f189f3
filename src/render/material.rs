//! Surfaces.

use crate::flow::surface::SurfaceFlow;
use crate::math::space::{Similarity, UnitVec3, WorldPoint};
use crate::render::color::Rgb;
use crate::render::texture::Texture;
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, TAU};
use std::sync::Arc;

/// What a surface does to light. Both sides behave alike.
#[derive(Debug)]
pub struct Material {
    /// How it scatters.
    pub kind: MaterialKind,
    /// Radiance that it gives off [W/(m² sr)], in all directions alike.
    pub emission: Option<Texture>,
    /// Where its shape has moved from where it rests, which is where textures are looked up.
    pub moved: Similarity,
    /// What carries textures along its surface.
    pub flow: Option<Arc<SurfaceFlow>>,
}

/// What light meets at a point of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// How it scatters.
    pub bsdf: Bsdf,
    /// Radiance that it gives off [W/(m² sr)].
    pub emitted: Rgb,
}

/// How a material scatters light.
#[derive(Debug, Clone)]
pub enum MaterialKind {
    /// Lambert: reflects alike in all directions.
    Diffuse {
        /// Share of light reflected, each channel in [0, 1].
        reflectance: Texture,
    },
}

/// How light scatters at a point of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bsdf {
    /// Lambert.
    Diffuse {
        /// Share of light reflected, each channel in [0, 1].
        reflectance: Rgb,
    },
}

/// A sampled direction.
#[derive(Debug, Clone, Copy)]
pub struct BsdfSample {
    /// Direction of travel away from the surface.
    pub direction: UnitVec3,
    /// Density over solid angle [1/sr].
    pub pdf: f32,
    /// Scattering function times cosine over density.
    pub weight: Rgb,
}

impl Material {
    /// The material at a point of the surface with its outward normal.
    ///
    /// What flows brings its own normal along: textures are those of the place that it came from.
    pub fn at(&self, point: WorldPoint, normal: UnitVec3) -> SurfacePoint {
        let MaterialKind::Diffuse { reflectance } = &self.kind;
        let is_patterned = !reflectance.is_constant() || self.emission.as_ref().is_some_and(|e| !e.is_constant());
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
            bsdf: Bsdf::Diffuse { reflectance: reflectance.at(p, normal) },
            emitted: self.emission.as_ref().map_or(Vec3::ZERO, |emission| emission.at(p, normal)),
        }
    }
}

impl Bsdf {
    /// Scattering function times the cosine at the surface [1/sr], for light that leaves along `outgoing`; `normal`
    /// is on the side from which the surface is seen.
    pub fn value(&self, normal: UnitVec3, outgoing: UnitVec3) -> Rgb {
        match self {
            Bsdf::Diffuse { reflectance } => *reflectance * (normal.dot(*outgoing).max(0.0) * FRAC_1_PI),
        }
    }

    /// Density [1/sr] with which [`Bsdf::sample`] returns `outgoing`.
    pub fn pdf(&self, normal: UnitVec3, outgoing: UnitVec3) -> f32 {
        match self {
            Bsdf::Diffuse { .. } => normal.dot(*outgoing).max(0.0) * FRAC_1_PI,
        }
    }

    /// A direction of travel away from the surface, from two uniform numbers.
    pub fn sample(&self, normal: UnitVec3, u: [f32; 2]) -> BsdfSample {
        match self {
            Bsdf::Diffuse { reflectance } => {
                let cosine = (1.0 - u[0]).sqrt();
                let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
                let sine = u[0].sqrt();
                let direction = normal.from_local(Vec3::new(sine * cos_phi, sine * sin_phi, cosine));
                BsdfSample { direction, pdf: cosine * FRAC_1_PI, weight: *reflectance }
            }
        }
    }

    /// The colour for the albedo layer.
    pub fn albedo(&self) -> Rgb {
        match self {
            Bsdf::Diffuse { reflectance } => *reflectance,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};

    #[test]
    fn diffuse_samples_have_the_stated_density_and_weight() {
        let material = Bsdf::Diffuse { reflectance: Vec3::new(0.2, 0.5, 0.8) };
        let normal = UnitVec3::try_new(Vec3::new(0.2, -0.9, 0.4)).expect("not zero");
        let mut rng = CounterRng::new(Seed(2));
        let n = 100_000;
        let mut mean_cosine = 0.0f64;
        for _ in 0..n {
            let s = material.sample(normal, [rng.uniform(), rng.uniform()]);
            assert!((s.pdf - material.pdf(normal, s.direction)).abs() < 1e-4);
            assert!((material.value(normal, s.direction) - s.weight * s.pdf).length() < 1e-4);
            mean_cosine += f64::from(normal.dot(*s.direction)) / n as f64;
        }
        assert!((mean_cosine - 2.0 / 3.0).abs() < 3e-3, "{mean_cosine}");
    }
}
