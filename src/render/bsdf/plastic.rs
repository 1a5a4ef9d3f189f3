//! A diffuse base under a clear coat: plastic, lacquer, glazed clay.
//!
//! The base receives what the coat lets through, and is dimmed by it in the same way on the way out (Kelemen and
//! Szirmay-Kalos 2001, *A microfacet based coupled specular-matte BRDF model with importance sampling*, eq. 10): the
//! sum is reciprocal, and a white base under any coat reflects all light.

use crate::render::bsdf::LocalSample;
use crate::render::bsdf::diffuse::cosine_direction;
use crate::render::bsdf::gloss::Gloss;
use crate::render::color::Rgb;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// A coat on a diffuse base.
#[derive(Debug, Clone)]
pub struct Plastic {
    gloss: Gloss,
}

impl Plastic {
    /// A coat with index of refraction `ior` ≥ 1 of a roughness in [0, 1].
    pub fn new(ior: f32, roughness: f32) -> Self {
        Self { gloss: Gloss::new(ior, roughness) }
    }

    #[inline]
    fn base(&self, reflectance: Rgb, wo: Vec3, wi: Vec3) -> Rgb {
        let passed = |w: Vec3| 1.0 - self.gloss.reflected(w.z);
        let share = passed(wo) * passed(wi) / (1.0 - self.gloss.mean_reflected()).max(1e-6);
        reflectance * (share * wi.z.max(0.0) * FRAC_1_PI)
    }

    /// Probability of sampling the coat.
    #[inline]
    fn coat_probability(&self, reflectance: Rgb, wo: Vec3) -> f32 {
        let coat = self.gloss.reflected(wo.z);
        let base = (1.0 - coat) * reflectance.element_sum() / 3.0;
        // Clear glass over black, seen where it reflects nothing, does not matter.
        coat / (coat + base).max(f32::MIN_POSITIVE)
    }

    /// Scattering function times the cosine [1/sr], without what a smooth coat mirrors.
    #[inline]
    pub fn value(&self, reflectance: Rgb, wo: Vec3, wi: Vec3) -> Rgb {
        if wi.z <= 0.0 {
            return Vec3::ZERO;
        }
        self.base(reflectance, wo, wi) + self.gloss.value(wo, wi)
    }

    /// Density [1/sr] with which [`Plastic::sample`] returns `wi`.
    #[inline]
    pub fn pdf(&self, reflectance: Rgb, wo: Vec3, wi: Vec3) -> f32 {
        if wi.z <= 0.0 {
            return 0.0;
        }
        let coat = self.coat_probability(reflectance, wo);
        coat * self.gloss.pdf(wo, wi) + (1.0 - coat) * wi.z * FRAC_1_PI
    }

    /// A direction, from three uniform numbers; `None` where the light is lost below the horizon.
    #[inline]
    pub fn sample(&self, reflectance: Rgb, wo: Vec3, u: [f32; 3]) -> Option<LocalSample> {
        let coat = self.coat_probability(reflectance, wo);
        let wi = if u[2] < coat {
            let sample = self.gloss.sample(wo, [u[0], u[1]])?;
            if sample.pdf.is_none() {
                return Some(LocalSample { weight: sample.weight / coat, ..sample });
            }
            sample.wi
        } else {
            cosine_direction([u[0], u[1]])
        };
        let pdf = self.pdf(reflectance, wo, wi);
        (pdf > 0.0).then(|| LocalSample { wi, pdf: Some(pdf), weight: self.value(reflectance, wo, wi) / pdf })
    }
}
