//! Glass and water: what is not reflected goes through, and is bent.
//!
//! Rough glass follows Walter et al. 2007, *Microfacet models for refraction through rough surfaces*. What single
//! scattering loses, a fifth on the roughest glass, is put back by dividing by the share that is left (after Turquin 2019,
//! *Practical multiple scattering compensation for microfacet models*): glass that absorbs nothing then loses nothing,
//! whichever way it is seen; seen from two ways it is no longer quite reciprocal.
//!
//! Radiance grows by the square of the index of refraction on its way into the denser side, as its cone narrows (Veach
//! 1997, *Robust Monte Carlo methods for light transport simulation*, §5.2). Paths run against the light.

use crate::render::bsdf::LocalSample;
use crate::render::bsdf::albedo::Curve;
use crate::render::bsdf::fresnel;
use crate::render::bsdf::microfacet::{Ggx, mirrored, refracted};
use crate::render::color::Rgb;
use glam::Vec3;

/// Indices of refraction this close to that of air bend light less than single precision tells.
const NO_BOUNDARY: f32 = 1e-3;

/// The boundary of a dielectric.
#[derive(Debug, Clone)]
pub struct Glass {
    ior: f32,
    rough: Option<Rough>,
}

#[derive(Debug, Clone)]
struct Rough {
    ggx: Ggx,
    /// Share of light that single scattering keeps, seen from outside and from inside.
    kept: [Curve; 2],
}

impl Glass {
    /// The boundary to an index of refraction `ior` > 0 relative to what is outside, of a roughness in [0, 1].
    pub fn new(ior: f32, roughness: f32) -> Self {
        let rough = Ggx::of_roughness(roughness).filter(|_| (ior - 1.0).abs() >= NO_BOUNDARY).map(|ggx| {
            let kept = [ior, 1.0 / ior].map(|eta| {
                Curve::of_samples(|wo, u| {
                    let h = ggx.sample_seen(wo, u);
                    let f = fresnel::dielectric(wo.dot(h).clamp(0.0, 1.0), eta);
                    let back = mirrored(wo, h);
                    let back = if back.z > 0.0 { ggx.seen_from_both(wo, back) / ggx.seen(wo) } else { 0.0 };
                    let through = refracted(wo, h, eta).filter(|wi| wi.z < 0.0).map_or(0.0, |wi| ggx.seen(wi));
                    f * back + (1.0 - f) * through
                })
            });
            Rough { ggx, kept }
        });
        Self { ior, rough }
    }

    /// Index of refraction behind the boundary over that before it.
    #[inline]
    pub fn eta(&self, is_front: bool) -> f32 {
        if is_front { self.ior } else { 1.0 / self.ior }
    }

    /// Scattering function times the cosine [1/sr], for a path seen from outside (`is_front`) or inside; `tint` is the
    /// share of light let through.
    #[inline]
    pub fn value(&self, tint: Rgb, is_front: bool, wo: Vec3, wi: Vec3) -> Rgb {
        let Some(rough) = &self.rough else { return Vec3::ZERO };
        let eta = self.eta(is_front);
        let kept = rough.kept[usize::from(!is_front)].at(wo.z);
        match half_vector(wo, wi, eta) {
            Some(h) if wi.z > 0.0 => {
                let f = fresnel::dielectric(wo.dot(h).min(1.0), eta);
                Vec3::splat(f * rough.ggx.density(h) * rough.ggx.seen_from_both(wo, wi) / (4.0 * wo.z * kept))
            }
            Some(h) => {
                let f = fresnel::dielectric(wo.dot(h).min(1.0), eta);
                let seen = rough.ggx.seen_density(wo, h) * rough.ggx.seen(wi);
                tint * ((1.0 - f) * seen * bending(wo, wi, h, eta) / (eta * eta * kept))
            }
            None => Vec3::ZERO,
        }
    }

    /// Density [1/sr] with which [`Glass::sample`] returns `wi`; what is lost and what is not rough has none.
    #[inline]
    pub fn pdf(&self, is_front: bool, wo: Vec3, wi: Vec3) -> f32 {
        let Some(rough) = &self.rough else { return 0.0 };
        let eta = self.eta(is_front);
        let Some(h) = half_vector(wo, wi, eta) else { return 0.0 };
        let f = fresnel::dielectric(wo.dot(h).min(1.0), eta);
        if wi.z > 0.0 {
            f * rough.ggx.seen(wo) * rough.ggx.density(h) / (4.0 * wo.z)
        } else {
            (1.0 - f) * rough.ggx.seen_density(wo, h) * bending(wo, wi, h, eta)
        }
    }

    /// A direction, from three uniform numbers; `None` where the light is lost among the mirrors.
    #[inline]
    pub fn sample(&self, tint: Rgb, is_front: bool, wo: Vec3, u: [f32; 3]) -> Option<LocalSample> {
        let eta = self.eta(is_front);
        let h = self.rough.as_ref().map_or(Vec3::Z, |rough| rough.ggx.sample_seen(wo, [u[0], u[1]]));
        let f = fresnel::dielectric(wo.dot(h).clamp(0.0, 1.0), eta);
        let is_reflected = u[2] < f;
        let wi = if is_reflected { mirrored(wo, h) } else { refracted(wo, h, eta)? };
        if (wi.z > 0.0) != is_reflected {
            return None;
        }
        let weight = if is_reflected { Vec3::ONE } else { tint / (eta * eta) };
        let Some(rough) = &self.rough else { return Some(LocalSample { wi, pdf: None, weight }) };
        let seen =
            if is_reflected { rough.ggx.seen_from_both(wo, wi) / rough.ggx.seen(wo) } else { rough.ggx.seen(wi) };
        let pdf = self.pdf(is_front, wo, wi);
        let kept = rough.kept[usize::from(!is_front)].at(wo.z);
        (pdf > 0.0).then_some(LocalSample { wi, pdf: Some(pdf), weight: weight * (seen / kept) })
    }
}

/// The normal of the mirrors that send light from `wi` to `wo`, on the side of `wo`; `None` where none do.
#[inline]
fn half_vector(wo: Vec3, wi: Vec3, eta: f32) -> Option<Vec3> {
    let h = if wi.z > 0.0 { wo + wi } else { wo + wi * eta }.try_normalize()?;
    let h = if h.z < 0.0 { -h } else { h };
    // Both must be on their sides of the mirror too.
    (wo.dot(h) > 0.0 && (wi.dot(h) > 0.0) == (wi.z > 0.0)).then_some(h)
}

/// Solid angle of mirrors over that of light bent by them (eq. 17 of Walter et al.).
#[inline]
fn bending(wo: Vec3, wi: Vec3, h: Vec3, eta: f32) -> f32 {
    let (o, i) = (wo.dot(h), wi.dot(h));
    let denominator = i + o / eta;
    i.abs() / (denominator * denominator)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};

    #[test]
    fn glass_is_reciprocal_but_for_what_it_makes_up_for() {
        // f(wo, wi)/n², n on the side of wo, times the share that is kept, is the same there and back (Veach 1997, eq. 5.14).
        let glass = Glass::new(1.5, 0.5);
        let kept = &glass.rough.as_ref().expect("rough").kept;
        let mut rng = CounterRng::new(Seed(9));
        let outside = Vec3::new(0.6, 0.3, 0.55f32.sqrt());
        let mut compared = 0;
        while compared < 500 {
            let u = [rng.uniform(), rng.uniform(), rng.uniform()];
            let Some(sample) = glass.sample(Vec3::ONE, true, outside, u) else { continue };
            let wi = sample.wi;
            if wi.z > -0.05 {
                continue;
            }
            let there = glass.value(Vec3::ONE, true, outside, wi).x / -wi.z * kept[0].at(outside.z);
            // Seen from inside, the normal is turned over.
            let back = glass.value(Vec3::ONE, false, -wi, -outside).x / outside.z * kept[1].at(-wi.z);
            assert!((there - back / 2.25).abs() < 2e-3 * there, "{there} {}", back / 2.25);
            compared += 1;
        }
    }

    #[test]
    fn smooth_glass_bends_light_in_and_out_again() {
        let glass = Glass::new(1.5, 0.0);
        let wo = Vec3::new(0.6, 0.0, 0.8);
        let inward = glass.sample(Vec3::splat(0.5), true, wo, [0.5, 0.5, 0.99]).expect("goes through");
        assert!(inward.pdf.is_none() && (inward.weight - Vec3::splat(0.5 / 2.25)).length() < 1e-6);
        let outward = glass.sample(Vec3::ONE, false, -inward.wi, [0.5, 0.5, 0.99]).expect("goes through");
        // The normal is turned over: what came along −wo goes on along −wo.
        assert!((outward.wi + wo).length() < 1e-6 && (outward.weight - Vec3::splat(2.25)).length() < 1e-5);
        // Beyond the critical angle all is mirrored.
        let grazing = Vec3::new(0.8, 0.0, 0.6);
        let mirrored = glass.sample(Vec3::ZERO, false, grazing, [0.5, 0.5, 0.999]).expect("is mirrored");
        assert!((mirrored.wi - Vec3::new(-0.8, 0.0, 0.6)).length() < 1e-6 && mirrored.weight == Vec3::ONE);
    }
}
