//! Smoke whose extinction has a colour, by multiple importance sampling over red, green and blue (Wilkie et al. 2014, *Hero
//! wavelength spectral sampling*; Miller, Georgiev and Jarosz 2019, *A null-scattering path integral formulation of light
//! transport*).
//!
//! One channel, the hero, decides where a path collides, but any of the three could have been it. Each channel's light is
//! divided by the mean of the probabilities that the three would have gone this way. All fly under the same majorant, so that
//! these differ only in whether a candidate was real.

use crate::render::color::Rgb;
use glam::Vec3;

/// How likely a path is for each channel.
#[derive(Debug, Clone)]
pub struct Chroma {
    /// Extinction of each channel over the largest, in [0, 1].
    ratios: Vec3,
    hero: usize,
    /// Probabilities of the way so far, but for a common factor.
    likely: Vec3,
}

impl Chroma {
    /// A path that begins; the uniform number `u` chooses the hero.
    pub fn new(ratios: Vec3, u: f32) -> Self {
        Self { ratios, hero: ((u * 3.0) as usize).min(2), likely: Vec3::ONE }
    }

    /// From here on the path flies through smoke with these ratios.
    pub fn enter(&mut self, ratios: Vec3) {
        self.ratios = ratios;
    }

    /// Extinction of the hero over the largest.
    pub fn hero_ratio(&self) -> f32 {
        self.ratios[self.hero]
    }

    /// The path met smoke.
    pub fn collide(&mut self) {
        self.scale(self.ratios);
    }

    /// The path went through a candidate that was real for the channel of largest extinction with probability `share`.
    pub fn pass(&mut self, share: f32) {
        self.scale(Vec3::ONE - share * self.ratios);
    }

    /// The path went through smoke whose optical depth for the channel of largest extinction is `tau`.
    pub fn pass_exactly(&mut self, tau: f32) {
        // Less the least of the three, which is common: the exponents stay small.
        let least = self.ratios.min_element();
        self.scale(((self.ratios - least) * -tau).exp());
    }

    fn scale(&mut self, factors: Vec3) {
        self.likely *= factors;
        let largest = self.likely.max_element();
        if largest > 0.0 {
            self.likely /= largest;
        }
    }

    /// What each channel's light is multiplied with.
    pub fn weight(&self) -> Rgb {
        let mean = self.likely.element_sum() / 3.0;
        if mean > 0.0 { self.likely / mean } else { Vec3::ZERO }
    }
}
