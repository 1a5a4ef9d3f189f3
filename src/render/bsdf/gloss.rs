//! The clear surface over something else: what it reflects, and the share that it keeps from what is below.

use crate::render::bsdf::LocalSample;
use crate::render::bsdf::albedo::Curve;
use crate::render::bsdf::fresnel;
use crate::render::bsdf::microfacet::{Ggx, mirrored};
use glam::Vec3;

/// A clear coat that reflects, by Fresnel and GGX; what passes it is the business of others.
#[derive(Debug, Clone)]
pub struct Gloss {
    ior: f32,
    ggx: Option<Ggx>,
    reflected: Curve,
}

impl Gloss {
    /// A coat with index of refraction `ior` ≥ 1 of a roughness in [0, 1].
    pub fn new(ior: f32, roughness: f32) -> Self {
        let ggx = Ggx::of_roughness(roughness);
        let reflected = match ggx {
            None => Curve::new(|cosine| fresnel::dielectric(cosine, ior)),
            Some(ggx) => Curve::of_samples(|wo, u| {
                let h = ggx.sample_seen(wo, u);
                let wi = mirrored(wo, h);
                let f = fresnel::dielectric(wo.dot(h).clamp(0.0, 1.0), ior);
                if wi.z > 0.0 { f * ggx.seen_from_both(wo, wi) / ggx.seen(wo) } else { 0.0 }
            }),
        };
        Self { ior, ggx, reflected }
    }

    /// Share of light reflected in all, by the cosine of the direction it is seen from.
    #[inline]
    pub fn reflected(&self, cosine: f32) -> f32 {
        self.reflected.at(cosine)
    }

    /// Mean of that share for light from everywhere.
    #[inline]
    pub fn mean_reflected(&self) -> f32 {
        self.reflected.mean()
    }

    /// Scattering function times the cosine [1/sr]; 0 for a smooth coat.
    #[inline]
    pub fn value(&self, wo: Vec3, wi: Vec3) -> f32 {
        let Some(ggx) = self.ggx.filter(|_| wi.z > 0.0) else { return 0.0 };
        let h = (wo + wi).normalize();
        let f = fresnel::dielectric(wo.dot(h).clamp(0.0, 1.0), self.ior);
        f * ggx.density(h) * ggx.seen_from_both(wo, wi) / (4.0 * wo.z)
    }

    /// Density [1/sr] with which [`Gloss::sample`] returns `wi`.
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        let Some(ggx) = self.ggx.filter(|_| wi.z > 0.0) else { return 0.0 };
        ggx.seen(wo) * ggx.density((wo + wi).normalize()) / (4.0 * wo.z)
    }

    /// A direction, from two uniform numbers; `None` where the light is lost below the horizon.
    #[inline]
    pub fn sample(&self, wo: Vec3, u: [f32; 2]) -> Option<LocalSample> {
        let Some(ggx) = self.ggx else {
            // From the curve, so that what is kept from below is exactly what is reflected.
            let weight = Vec3::splat(self.reflected(wo.z));
            return Some(LocalSample { wi: Vec3::new(-wo.x, -wo.y, wo.z), pdf: None, weight });
        };
        let wi = mirrored(wo, ggx.sample_seen(wo, u));
        let pdf = self.pdf(wo, wi);
        (pdf > 0.0).then(|| LocalSample { wi, pdf: Some(pdf), weight: Vec3::splat(self.value(wo, wi) / pdf) })
    }
}
