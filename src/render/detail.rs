//! Density finer than voxels: at every point it is multiplied by flow noise (Perlin and Neyret 2001, *Flow Noise*), whose larger
//! swirls carry the smaller ones along and whose gradients turn in place.
//!
//! The factor is 1 + strength · s, with s an odd function of noise that is as often above 0 as below: its mean is 1, and so
//! much smoke there is as before. It is never more than 1 + strength, which makes bounds of the density bounds of the product.
//! Along a ray the product has no integral in closed form. Collisions and transmittances need none; whatever does is left out
//! where there is detail, or taken at random points.

use crate::flow::turbulence::TurbulenceSpan;
use crate::math::space::WorldPoint;

/// What the density is multiplied by.
#[derive(Debug)]
pub struct Detail {
    /// The noise at the time of the frame.
    pub turbulence: TurbulenceSpan,
    /// Most that the factor differs from 1, in [0, 1].
    pub strength: f32,
    /// Factor on the noise before it is cut at −1 and 1, > 0.
    pub contrast: f64,
}

impl Detail {
    /// Largest factor.
    pub fn most(&self) -> f32 {
        1.0 + self.strength
    }

    /// The factor at `p`, from 1 − strength to 1 + strength.
    #[inline(never)]
    pub fn factor(&self, p: WorldPoint) -> f32 {
        let noise = self.contrast * self.turbulence.value(p.0.to_array().map(f64::from));
        1.0 + self.strength * noise.clamp(-1.0, 1.0) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::turbulence::{Turbulence, TurbulenceSettings};
    use crate::math::hash::{CounterRng, Seed};

    #[test]
    fn the_mean_is_one_whatever_the_contrast() {
        for (contrast, displacement, time) in
            [(1.0, [0.0; 3], 0.0), (1.5, [0.05, 0.1, 0.0], 1.7), (20.0, [0.0, 0.2, 0.1], 0.4)]
        {
            let settings = TurbulenceSettings {
                length_scale: 0.3,
                spin_rate: 0.5,
                displacement,
                seed: Seed(4),
                ..Default::default()
            };
            let turbulence = Turbulence::new(&settings).at(time);
            let detail = Detail { turbulence, strength: 0.9, contrast };
            let mut rng = CounterRng::new(Seed(1));
            let n = 200_000;
            let factors =
                (0..n).map(|_| f64::from(detail.factor(WorldPoint([0; 3].map(|_| 300.0 * rng.uniform()).into()))));
            let (mut sum, mut square) = (0.0, 0.0);
            for factor in factors {
                assert!((0.0999..=f64::from(detail.most())).contains(&factor), "{factor}");
                sum += factor - 1.0;
                square += (factor - 1.0).powi(2);
            }
            let (mean, error) = (sum / f64::from(n), square.sqrt() / f64::from(n));
            assert!(mean.abs() < 4.0 * error && square > 0.04 * f64::from(n), "{mean} ± {error}");
        }
    }
}
