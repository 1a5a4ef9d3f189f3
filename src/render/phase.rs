//! Phase functions: which way light goes on after it scattered.
//!
//! Both directions are directions of *travel*: `g > 0` scatters forward.

use crate::math::space::UnitVec3;
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// A phase function; its integral over the sphere is 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Phase {
    /// Henyey and Greenstein 1941, *Diffuse radiation in the galaxy*, with mean cosine `g`.
    HenyeyGreenstein {
        /// Mean cosine between the directions before and after, in (−1, 1).
        g: f32,
    },
}

/// A sampled direction and its density.
#[derive(Debug, Clone, Copy)]
pub struct PhaseSample {
    /// Direction of travel after the scattering.
    pub direction: UnitVec3,
    /// Density [1/sr]; equal to the phase function, so the sample's weight is 1.
    pub pdf: f32,
}

impl Phase {
    /// The value [1/sr] for light that travelled along `before` and goes on along `after`.
    #[inline]
    pub fn value(self, before: UnitVec3, after: UnitVec3) -> f32 {
        match self {
            Phase::HenyeyGreenstein { g } => henyey_greenstein(g, before.dot(*after)),
        }
    }

    /// A direction sampled in proportion to the value, from two uniform numbers.
    #[inline]
    pub fn sample(self, before: UnitVec3, u: [f32; 2]) -> PhaseSample {
        match self {
            Phase::HenyeyGreenstein { g } => {
                let cosine = if g.abs() < 1e-3 {
                    // The general formula cancels here; to first order in g its inverse is this.
                    let c = 1.0 - 2.0 * u[0];
                    c + 1.5 * g * (1.0 - c * c)
                } else {
                    let s = (1.0 - g * g) / (1.0 + g - 2.0 * g * u[0]);
                    (1.0 + g * g - s * s) / (2.0 * g)
                }
                .clamp(-1.0, 1.0);
                let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
                let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
                let direction = before.from_local(Vec3::new(sine * cos_phi, sine * sin_phi, cosine));
                PhaseSample { direction, pdf: henyey_greenstein(g, cosine) }
            }
        }
    }
}

#[inline]
fn henyey_greenstein(g: f32, cosine: f32) -> f32 {
    let d = (1.0 + g * g - 2.0 * g * cosine).max(1e-12);
    (1.0 - g * g) / (4.0 * PI * d * d.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};

    const ASYMMETRIES: [f32; 6] = [-0.8, -0.3, 0.0, 0.0005, 0.5, 0.95];

    #[test]
    fn the_integral_is_one_and_the_mean_cosine_is_g() {
        for g in ASYMMETRIES {
            let n = 400_000;
            let (mut integral, mut mean) = (0.0f64, 0.0f64);
            for i in 0..n {
                let c = -1.0 + 2.0 * (i as f64 + 0.5) / n as f64;
                let value = f64::from(henyey_greenstein(g, c as f32)) * f64::from(TAU) * 2.0 / n as f64;
                integral += value;
                mean += value * c;
            }
            assert!((integral - 1.0).abs() < 1e-3, "g {g}: {integral}");
            assert!((mean - f64::from(g)).abs() < 1e-3, "g {g}: {mean}");
        }
    }

    #[test]
    fn samples_follow_the_density() {
        let before = UnitVec3::try_new(Vec3::new(0.3, -0.5, 0.8)).expect("not zero");
        for g in ASYMMETRIES {
            let phase = Phase::HenyeyGreenstein { g };
            let mut rng = CounterRng::new(Seed(11));
            let n = 200_000;
            const BINS: usize = 20;
            let mut counts = [0u32; BINS];
            for _ in 0..n {
                let s = phase.sample(before, [rng.uniform(), rng.uniform()]);
                assert!((s.pdf - phase.value(before, s.direction)).abs() <= 2e-3 * s.pdf, "g {g}");
                let c = before.dot(*s.direction).clamp(-1.0, 1.0);
                counts[(((c + 1.0) * 0.5 * BINS as f32) as usize).min(BINS - 1)] += 1;
            }
            let mut chi_sq = 0.0;
            for (bin, &count) in counts.iter().enumerate() {
                let steps = 2000;
                let expected: f64 = (0..steps)
                    .map(|k| {
                        let c = -1.0 + 2.0 * (bin as f64 + (k as f64 + 0.5) / steps as f64) / BINS as f64;
                        f64::from(henyey_greenstein(g, c as f32)) * f64::from(TAU) * 2.0 / (BINS * steps) as f64
                    })
                    .sum::<f64>()
                    * n as f64;
                chi_sq += (f64::from(count) - expected).powi(2) / expected.max(1e-9);
            }
            // 19 degrees of freedom: 43.8 is exceeded once in a thousand.
            assert!(chi_sq < 43.8, "g {g}: chi square {chi_sq}");
        }
    }
}
