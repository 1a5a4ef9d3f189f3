//! Metals: rough mirrors that absorb what they do not reflect.
//!
//! Light that one tiny mirror throws onto the next is lost to the model of single scattering, two fifths of it on the
//! roughest metal. It is put back as a second, almost diffuse lobe (Kulla and Conty 2017, *Revisiting physically based
//! shading at Imageworks*, p. 13–19): reciprocal, and a metal that absorbs nothing reflects all.

use crate::render::bsdf::LocalSample;
use crate::render::bsdf::albedo::Curve;
use crate::render::bsdf::diffuse::cosine_direction;
use crate::render::bsdf::fresnel;
use crate::render::bsdf::microfacet::{Ggx, mirrored};
use crate::render::color::Rgb;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// What the shape of a metal's surface does.
#[derive(Debug, Clone)]
pub struct Metal {
    rough: Option<Rough>,
}

#[derive(Debug, Clone)]
struct Rough {
    ggx: Ggx,
    /// Share of light that is reflected at once where nothing is absorbed.
    once: Curve,
}

/// How much of the light that meets it a metal reflects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MetalColor {
    /// By its index of refraction, exactly.
    Measured {
        /// The real part of the index, > 0.
        eta: Rgb,
        /// The imaginary part, ≥ 0.
        k: Rgb,
        /// Mean reflectance for light from everywhere.
        mean: Rgb,
    },
    /// By its reflectance at normal incidence, each channel in [0, 1], approximately.
    Schlick {
        /// The reflectance.
        f0: Rgb,
    },
}

impl MetalColor {
    /// The colour of an index of refraction.
    pub fn measured(eta: Rgb, k: Rgb) -> Self {
        let n = 256;
        let mean = (0..n).map(|i| (i as f32 + 0.5) / n as f32).map(|c| fresnel::conductor(c, eta, k) * c).sum::<Vec3>()
            * (2.0 / n as f32);
        Self::Measured { eta, k, mean }
    }

    /// Share reflected at a cosine of the angle to a mirror's normal.
    #[inline]
    pub fn at(&self, cosine: f32) -> Rgb {
        match self {
            Self::Measured { eta, k, .. } => fresnel::conductor(cosine, *eta, *k),
            Self::Schlick { f0 } => fresnel::schlick(cosine, *f0),
        }
    }

    /// Mean share for light from everywhere: 2 ∫ F(µ) µ dµ.
    #[inline]
    pub fn mean(&self) -> Rgb {
        match self {
            Self::Measured { mean, .. } => *mean,
            Self::Schlick { f0 } => *f0 + (Vec3::ONE - *f0) / 21.0,
        }
    }
}

impl Rough {
    /// Share of light that the lobe of further reflections scatters, over what single scattering misses: the sum of
    /// F̄ᵏ over all further ways among the mirrors.
    #[inline]
    fn again(&self, color: &MetalColor) -> Rgb {
        let (mean, once) = (color.mean(), self.once.mean());
        mean * mean * once / (Vec3::ONE - mean * (1.0 - once))
    }

    /// Probability of sampling the lobe of further reflections.
    #[inline]
    fn again_probability(&self, color: &MetalColor, wo: Vec3) -> f32 {
        let once = self.once.at(wo.z);
        let (first, second) = (once * color.mean().element_sum(), (1.0 - once) * self.again(color).element_sum());
        second / (first + second).max(f32::MIN_POSITIVE)
    }
}

impl Metal {
    /// A metal of a roughness in [0, 1], see [`Ggx::of_roughness`].
    pub fn new(roughness: f32) -> Self {
        let rough = Ggx::of_roughness(roughness).map(|ggx| {
            let once = Curve::of_samples(|wo, u| {
                let wi = mirrored(wo, ggx.sample_seen(wo, u));
                if wi.z > 0.0 { ggx.seen_from_both(wo, wi) / ggx.seen(wo) } else { 0.0 }
            });
            Rough { ggx, once }
        });
        Self { rough }
    }

    /// Scattering function times the cosine [1/sr]; 0 for a perfect mirror, which has no density.
    #[inline]
    pub fn value(&self, color: &MetalColor, wo: Vec3, wi: Vec3) -> Rgb {
        let Some(rough) = self.rough.as_ref().filter(|_| wi.z > 0.0) else { return Vec3::ZERO };
        let h = (wo + wi).normalize();
        let single = rough.ggx.density(h) * rough.ggx.seen_from_both(wo, wi) / (4.0 * wo.z);
        let missed = |w: Vec3| 1.0 - rough.once.at(w.z);
        let share = missed(wo) * missed(wi) / (1.0 - rough.once.mean()).max(1e-6);
        color.at(wo.dot(h).clamp(0.0, 1.0)) * single + rough.again(color) * (share * wi.z * FRAC_1_PI)
    }

    /// Density [1/sr] with which [`Metal::sample`] returns `wi`; what is lost and what is mirrored perfectly has none.
    #[inline]
    pub fn pdf(&self, color: &MetalColor, wo: Vec3, wi: Vec3) -> f32 {
        let Some(rough) = self.rough.as_ref().filter(|_| wi.z > 0.0) else { return 0.0 };
        let h = (wo + wi).normalize();
        let again = rough.again_probability(color, wo);
        let single = rough.ggx.seen(wo) * rough.ggx.density(h) / (4.0 * wo.z);
        (1.0 - again) * single + again * wi.z * FRAC_1_PI
    }

    /// A direction, from three uniform numbers; `None` where the light is lost below the horizon.
    #[inline]
    pub fn sample(&self, color: &MetalColor, wo: Vec3, u: [f32; 3]) -> Option<LocalSample> {
        let Some(rough) = &self.rough else {
            let wi = Vec3::new(-wo.x, -wo.y, wo.z);
            return Some(LocalSample { wi, pdf: None, weight: color.at(wo.z) });
        };
        let wi = if u[2] < rough.again_probability(color, wo) {
            cosine_direction([u[0], u[1]])
        } else {
            mirrored(wo, rough.ggx.sample_seen(wo, [u[0], u[1]]))
        };
        let pdf = self.pdf(color, wo, wi);
        (pdf > 0.0).then(|| LocalSample { wi, pdf: Some(pdf), weight: self.value(color, wo, wi) / pdf })
    }
}
