//! Phase functions: which way light goes on after it scattered.
//!
//! Both directions are directions of *travel*: `g > 0` scatters forward.

use crate::math::circle::on_circle;
use crate::math::space::UnitVec3;
use std::f32::consts::PI;

/// A phase function; its integral over the sphere is 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Phase {
    /// One lobe of Henyey and Greenstein.
    HenyeyGreenstein {
        /// Mean cosine between the directions before and after, in (−1, 1).
        g: f32,
    },
    /// Two lobes side by side.
    Mixture {
        /// The lobes.
        lobes: [Lobe; 2],
        /// Share of the first, in [0, 1].
        share: f32,
    },
}

/// A part of a phase function about the direction before; its integral over the sphere is 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lobe {
    /// Henyey and Greenstein 1941, *Diffuse radiation in the galaxy*, with mean cosine `g`.
    HenyeyGreenstein {
        /// Mean cosine between the directions before and after, in (−1, 1).
        g: f32,
    },
    /// Draine 2003, *Scattering by interstellar dust grains*, equation 9: Henyey and Greenstein's times 1 + α cos², normalised.
    Draine {
        /// Asymmetry, in (−1, 1).
        g: f32,
        /// Weight of the squared cosine, ≥ 0.
        alpha: f32,
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
    /// Two lobes of Henyey and Greenstein, of which the first has `share`.
    pub fn two_lobes(g: [f32; 2], share: f32) -> Self {
        Self::Mixture { lobes: g.map(|g| Lobe::HenyeyGreenstein { g }), share }
    }

    /// Water droplets of a diameter [µm] between 5 and 50, averaged over the rings and fringes of single sizes: the fit of
    /// Jendersie and d'Eon 2023, *An approximate Mie scattering function for fog and cloud rendering*, equations 4 to 7.
    pub fn droplets(diameter: f64) -> Self {
        let d = diameter;
        let forward = (-0.099_056_7 / (d - 1.671_54)).exp();
        let g = (-2.206_79 / (d + 3.910_29) - 0.428_934).exp();
        let alpha = (3.624_89 - 8.292_88 / (d + 5.528_25)).exp();
        let share_of_draine = (-0.599_085 / (d - 0.641_583) - 0.665_888).exp();
        let lobes = [Lobe::HenyeyGreenstein { g: forward as f32 }, Lobe::Draine { g: g as f32, alpha: alpha as f32 }];
        Self::Mixture { lobes, share: 1.0 - share_of_draine as f32 }
    }

    /// The value [1/sr] for light that travelled along `before` and goes on along `after`.
    #[inline]
    pub fn value(self, before: UnitVec3, after: UnitVec3) -> f32 {
        self.at(before.dot(*after))
    }

    #[inline]
    fn at(self, cosine: f32) -> f32 {
        match self {
            Phase::HenyeyGreenstein { g } => henyey_greenstein(g, cosine),
            Phase::Mixture { lobes, share } => share * lobes[0].value(cosine) + (1.0 - share) * lobes[1].value(cosine),
        }
    }

    /// A direction sampled in proportion to the value, from two uniform numbers.
    #[inline]
    pub fn sample(self, before: UnitVec3, u: [f32; 2]) -> PhaseSample {
        let cosine = match self {
            Phase::HenyeyGreenstein { g } => sample_henyey_greenstein(g, u[0]),
            // The number that chose the lobe is uniform again within its share.
            Phase::Mixture { lobes, share } if u[0] < share => lobes[0].sample(u[0] / share),
            Phase::Mixture { lobes, share } => lobes[1].sample(((u[0] - share) / (1.0 - share)).min(1.0)),
        };
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        let direction = before.from_local((sine * on_circle(u[1])).extend(cosine));
        PhaseSample { direction, pdf: self.at(cosine) }
    }
}

impl Lobe {
    #[inline]
    fn value(self, cosine: f32) -> f32 {
        match self {
            Lobe::HenyeyGreenstein { g } => henyey_greenstein(g, cosine),
            Lobe::Draine { g, alpha } => {
                let norm = 1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0;
                henyey_greenstein(g, cosine) * (1.0 + alpha * cosine * cosine) / norm
            }
        }
    }

    /// A cosine with the lobe's density.
    fn sample(self, u: f32) -> f32 {
        match self {
            Lobe::HenyeyGreenstein { g } => sample_henyey_greenstein(g, u),
            Lobe::Draine { g, alpha } => sample_draine(f64::from(g), f64::from(alpha), f64::from(u)) as f32,
        }
    }
}

#[inline]
fn sample_henyey_greenstein(g: f32, u: f32) -> f32 {
    let cosine = if g.abs() < 1e-3 {
        // The general formula cancels here; to first order in g its inverse is this.
        let c = 1.0 - 2.0 * u;
        c + 1.5 * g * (1.0 - c * c)
    } else {
        let s = (1.0 - g * g) / (1.0 + g - 2.0 * g * u);
        (1.0 + g * g - s * s) / (2.0 * g)
    };
    cosine.clamp(-1.0, 1.0)
}

/// The cosine below which lies the share `1 − u` of a lobe of Draine's, to the last digits: its integral has a closed form, a sum
/// of odd powers of √(1 + g² − 2g cos), whose inverse is found by halving and Newton's steps.
fn sample_draine(g: f64, alpha: f64, u: f64) -> f64 {
    // Below it the closed form cancels; the density is then (1 + α cos²)/norm to 4e-4.
    let g = if g.abs() < 1e-4 { 1e-4_f64.copysign(g) } else { g };
    let c = 1.0 + g * g;
    let density = |x: f64| (1.0 + alpha * x * x) / (c - 2.0 * g * x).powf(1.5);
    let integral = |x: f64| {
        let s = (c - 2.0 * g * x).sqrt();
        let quarter = alpha / (4.0 * g * g);
        ((1.0 + quarter * c * c) / s + 2.0 * quarter * c * s - quarter * s.powi(3) / 3.0) / g
    };
    let (low_value, high_value) = (integral(-1.0), integral(1.0));
    let wanted = high_value + (low_value - high_value) * u;
    let (mut low, mut high) = (-1.0, 1.0);
    let mut x = 1.0 - 2.0 * u;
    for _ in 0..60 {
        let error = integral(x) - wanted;
        if error > 0.0 {
            high = x
        } else {
            low = x
        }
        let step = x - error / density(x);
        let next = if step > low && step < high { step } else { 0.5 * (low + high) };
        if (next - x).abs() < 1e-9 {
            return next;
        }
        x = next;
    }
    x
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
    use glam::Vec3;
    use std::f32::consts::TAU;

    const ASYMMETRIES: [f32; 6] = [-0.8, -0.3, 0.0, 0.0005, 0.5, 0.95];

    fn all() -> Vec<Phase> {
        let draine = |g, alpha| Phase::Mixture { lobes: [Lobe::Draine { g, alpha }; 2], share: 0.5 };
        let mut phases = ASYMMETRIES.map(|g| Phase::HenyeyGreenstein { g }).to_vec();
        phases.extend([draine(0.6, 30.0), draine(-0.4, 2.0), draine(1e-6, 5.0), draine(0.01, 250.0), draine(0.7, 0.0)]);
        phases.extend([Phase::two_lobes([0.8, -0.3], 0.7), Phase::two_lobes([0.2, 0.5], 1.0)]);
        phases.push(Phase::droplets(5.0));
        phases
    }

    /// ∫ f over the sphere, by the midpoint rule over angles, which resolves peaks forwards.
    fn over_sphere(phase: Phase, f: impl Fn(f64) -> f64) -> f64 {
        let n = 400_000;
        let term = |i: i32| {
            let (sine, cosine) = (std::f64::consts::PI * (f64::from(i) + 0.5) / f64::from(n)).sin_cos();
            f64::from(phase.at(cosine as f32)) * f(cosine) * sine
        };
        (0..n).map(term).sum::<f64>() * f64::from(TAU) * std::f64::consts::PI / f64::from(n)
    }

    #[test]
    fn the_integral_is_one_and_the_mean_cosine_is_known() {
        for phase in all() {
            let (integral, mean) = (over_sphere(phase, |_| 1.0), over_sphere(phase, |c| c));
            assert!((integral - 1.0).abs() < 2e-3, "{phase:?}: {integral}");
            let lobe = |lobe: Lobe| match lobe {
                Lobe::HenyeyGreenstein { g } => f64::from(g),
                // Draine 2003, equation 10.
                Lobe::Draine { g, alpha } => {
                    let (g, a) = (f64::from(g), f64::from(alpha));
                    g * (1.0 + a * (3.0 + 2.0 * g * g) / 5.0) / (1.0 + a * (1.0 + 2.0 * g * g) / 3.0)
                }
            };
            let expected = match phase {
                Phase::HenyeyGreenstein { g } => f64::from(g),
                Phase::Mixture { lobes, share } => {
                    f64::from(share) * lobe(lobes[0]) + (1.0 - f64::from(share)) * lobe(lobes[1])
                }
            };
            assert!((mean - expected).abs() < 2e-3, "{phase:?}: {mean} of {expected}");
        }
    }

    #[test]
    fn droplets_scatter_ever_more_forwards_as_they_grow() {
        let mean = |d: f64| over_sphere(Phase::droplets(d), |c| c);
        let means = [5.0, 10.0, 20.0, 50.0].map(mean);
        println!("mean cosines of droplets of 5, 10, 20, 50 um: {means:.4?}");
        // Of water in visible light 0.84 to 0.87 by Mie's theory.
        assert!(means.windows(2).all(|w| w[0] < w[1]) && means.iter().all(|m| (0.8..0.9).contains(m)), "{means:?}");
        let peak = |d: f64| Phase::droplets(d).at(1.0);
        assert!(peak(20.0) > 4.0 * peak(5.0));
    }

    #[test]
    fn samples_follow_the_density() {
        let before = UnitVec3::try_new(Vec3::new(0.3, -0.5, 0.8)).expect("not zero");
        for phase in all() {
            let mut rng = CounterRng::new(Seed(11));
            let n = 200_000;
            const BINS: usize = 20;
            let mut counts = [0u32; BINS];
            for _ in 0..n {
                let s = phase.sample(before, [rng.uniform(), rng.uniform()]);
                let c = before.dot(*s.direction).clamp(-1.0, 1.0);
                // Forward peaks turn the rounding of a direction into much.
                if c < 0.99 {
                    assert!((s.pdf - phase.value(before, s.direction)).abs() <= 2e-3 * s.pdf, "{phase:?}");
                }
                counts[(((c + 1.0) * 0.5 * BINS as f32) as usize).min(BINS - 1)] += 1;
            }
            let mut chi_sq = 0.0;
            for (bin, &count) in counts.iter().enumerate() {
                let [from, to] = [bin, bin + 1].map(|b| (-1.0 + 2.0 * b as f64 / BINS as f64).acos());
                let steps = 20_000;
                let expected: f64 = (0..steps)
                    .map(|k| {
                        let (sine, cosine) = (to + (from - to) * (f64::from(k) + 0.5) / f64::from(steps)).sin_cos();
                        f64::from(phase.at(cosine as f32)) * sine * f64::from(TAU) * (from - to) / f64::from(steps)
                    })
                    .sum::<f64>()
                    * n as f64;
                chi_sq += (f64::from(count) - expected).powi(2) / expected.max(1e-9);
            }
            // 19 degrees of freedom: 43.8 is exceeded once in a thousand.
            assert!(chi_sq < 43.8, "{phase:?}: chi square {chi_sq}");
        }
    }
}
