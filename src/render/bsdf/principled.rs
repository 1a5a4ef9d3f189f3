//! One material for most things, after the parameters of Burley 2012 (*Physically-based shading at Disney*): a mix of
//! metal, plastic and glass under an optional clear coat.
//!
//! The coat takes from what is below the share that it reflects towards the viewer. A white mix then reflects all light
//! from every direction; under a coat it is not quite reciprocal.

use crate::render::bsdf::LocalSample;
use crate::render::bsdf::conductor::{Metal, MetalColor};
use crate::render::bsdf::dielectric::Glass;
use crate::render::bsdf::gloss::Gloss;
use crate::render::bsdf::plastic::Plastic;
use crate::render::color::Rgb;
use glam::Vec3;

/// Index of refraction of the coat.
const COAT_IOR: f32 = 1.5;

/// Numbers of a [`Principled`] surface.
#[derive(Debug, Clone, Copy)]
pub struct PrincipledSettings {
    /// Share of metal, in [0, 1].
    pub metallic: f32,
    /// Roughness of all but the coat, in [0, 1].
    pub roughness: f32,
    /// Index of refraction of what is no metal, ≥ 1.
    pub ior: f32,
    /// Share of glass in what is no metal, in [0, 1].
    pub transmission: f32,
    /// Strength of the coat, in [0, 1].
    pub coat: f32,
    /// Roughness of the coat, in [0, 1].
    pub coat_roughness: f32,
}

/// A mix of metal, plastic and glass under a coat.
#[derive(Debug, Clone)]
pub struct Principled {
    /// Shares of metal, glass and plastic; they add to 1.
    shares: [f32; 3],
    metal: Metal,
    glass: Glass,
    plastic: Plastic,
    coat: f32,
    gloss: Gloss,
}

impl Principled {
    /// The surface with these numbers.
    pub fn new(settings: &PrincipledSettings) -> Self {
        let PrincipledSettings { metallic, roughness, ior, transmission, coat, coat_roughness } = *settings;
        Self {
            shares: [metallic, (1.0 - metallic) * transmission, (1.0 - metallic) * (1.0 - transmission)],
            metal: Metal::new(roughness),
            glass: Glass::new(ior, roughness),
            plastic: Plastic::new(ior, roughness),
            coat,
            gloss: Gloss::new(COAT_IOR, coat_roughness),
        }
    }

    /// Index of refraction behind the surface over that before it.
    #[inline]
    pub fn eta(&self, is_front: bool) -> f32 {
        self.glass.eta(is_front)
    }

    /// Share of light that the coat reflects towards `wo`. It lies outside of what is clear.
    #[inline]
    fn coated(&self, is_front: bool, wo: Vec3) -> f32 {
        if self.coat == 0.0 || !is_front && self.shares[1] > 0.0 { 0.0 } else { self.coat * self.gloss.reflected(wo.z) }
    }

    /// Scattering function times the cosine [1/sr], without what is mirrored or bent perfectly.
    #[inline]
    pub fn value(&self, color: Rgb, is_front: bool, wo: Vec3, wi: Vec3) -> Rgb {
        let coated = self.coated(is_front, wo);
        let [metal, glass, plastic] = self.shares;
        let mut below = Vec3::ZERO;
        if metal > 0.0 {
            below += self.metal.value(&MetalColor::Schlick { f0: color }, wo, wi) * metal;
        }
        if glass > 0.0 {
            below += self.glass.value(color, is_front, wo, wi) * glass;
        }
        if plastic > 0.0 {
            below += self.plastic.value(color, wo, wi) * plastic;
        }
        let coat = if coated > 0.0 { self.coat * self.gloss.value(wo, wi) } else { 0.0 };
        below * (1.0 - coated) + coat
    }

    /// Density [1/sr] with which [`Principled::sample`] returns `wi`.
    #[inline]
    pub fn pdf(&self, color: Rgb, is_front: bool, wo: Vec3, wi: Vec3) -> f32 {
        let coated = self.coated(is_front, wo);
        let [metal, glass, plastic] = self.shares;
        let mut below = 0.0;
        if metal > 0.0 {
            below += self.metal.pdf(&MetalColor::Schlick { f0: color }, wo, wi) * metal;
        }
        if glass > 0.0 {
            below += self.glass.pdf(is_front, wo, wi) * glass;
        }
        if plastic > 0.0 {
            below += self.plastic.pdf(color, wo, wi) * plastic;
        }
        let coat = if coated > 0.0 { coated * self.gloss.pdf(wo, wi) } else { 0.0 };
        below * (1.0 - coated) + coat
    }

    /// A direction, from three uniform numbers; `None` where the light is lost.
    #[inline]
    pub fn sample(&self, color: Rgb, is_front: bool, wo: Vec3, u: [f32; 3]) -> Option<LocalSample> {
        let coated = self.coated(is_front, wo);
        let [metal, glass, plastic] = self.shares.map(|share| share * (1.0 - coated));
        let metal_color = MetalColor::Schlick { f0: color };
        // Each part is sampled with its share, so that the weight of what has no density is that of the part alone.
        let mut rest = u[2];
        let mut falls_in = |share: f32| {
            let falls = rest < share;
            let within = (rest / share).min(1.0 - f32::EPSILON);
            rest -= share;
            falls.then_some([u[0], u[1], within])
        };
        let sample = if let Some(u) = falls_in(coated) {
            let sample = self.gloss.sample(wo, [u[0], u[1]]);
            sample.map(|s| LocalSample { weight: s.weight * (self.coat / coated), ..s })
        } else if let Some(u) = falls_in(metal) {
            self.metal.sample(&metal_color, wo, u)
        } else if let Some(u) = falls_in(glass) {
            self.glass.sample(color, is_front, wo, u)
        } else {
            // Rounding may leave a little for a part that is not there.
            let u = falls_in(plastic).unwrap_or([u[0], u[1], 1.0 - f32::EPSILON]);
            if plastic > 0.0 { self.plastic.sample(color, wo, u) } else { None }
        }?;
        if sample.pdf.is_none() {
            return Some(sample);
        }
        let pdf = self.pdf(color, is_front, wo, sample.wi);
        let weight = self.value(color, is_front, wo, sample.wi) / pdf;
        (pdf > 0.0).then_some(LocalSample { wi: sample.wi, pdf: Some(pdf), weight })
    }
}
