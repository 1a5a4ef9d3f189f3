//! Turbulence: octaves of scalar noise whose gradients turn in place and the larger of which carry the smaller along
//! (Perlin and Neyret 2001, *Flow Noise*), for textures that flow.

use crate::flow::noise::RMS_SPEED;
use crate::flow::octaves::{Octave, OctaveSpan, OctavesSettings, octaves};
use crate::math::hash::Seed;

/// Root mean square of one component of unit noise, averaged over a cell: √(8·C·A²), with A and C the integrals that
/// [`RMS_SPEED`] is made of.
const RMS_VALUE: f64 = 0.190_943_637_9;
/// Root mean square of turbulence: its sums hardly leave −1 to 1.
pub const RMS_TURBULENCE: f64 = 1.0 / 3.0;

/// What turbulence is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct TurbulenceSettings {
    /// Size of the largest features [m], > 0.
    pub length_scale: f64,
    /// Number of sizes.
    pub octaves: u32,
    /// Ratio of neighbouring sizes, > 1.
    pub lacunarity: f64,
    /// Factor on the strength from one size to the next.
    pub gain: f64,
    /// Whether absolute values are added up.
    pub is_folded: bool,
    /// How many times longer features are along each axis.
    pub stretch: [f64; 3],
    /// Turns per second of the gradients of the largest features.
    pub spin_rate: f64,
    /// Replacements per second of the largest features by others. Excludes `spin_rate`.
    pub evolve_rate: f64,
    /// How far features are displaced where the sum of all larger ones is 1 [m]: a direction times amplitude and
    /// structure memory, I·M in the paper.
    pub displacement: [f64; 3],
    /// How far the pattern is moved [m].
    pub offset: [f64; 3],
    /// Velocity of the pattern [m/s].
    pub scroll: [f64; 3],
    /// Which pattern.
    pub seed: Seed,
}

impl Default for TurbulenceSettings {
    fn default() -> Self {
        Self {
            length_scale: 1.0,
            octaves: 4,
            lacunarity: 2.0,
            gain: 0.5,
            is_folded: false,
            stretch: [1.0; 3],
            spin_rate: 0.0,
            evolve_rate: 0.0,
            displacement: [0.0; 3],
            offset: [0.0; 3],
            scroll: [0.0; 3],
            seed: Seed(0),
        }
    }
}

/// A sum of octaves of noise.
#[derive(Debug, Clone, PartialEq)]
pub struct Turbulence {
    octaves: Vec<Octave>,
    is_folded: bool,
    shrink: [f64; 3],
    displacement: [f64; 3],
}

/// A [`Turbulence`] at a moment.
#[derive(Debug, Clone)]
pub struct TurbulenceSpan {
    octaves: Vec<OctaveSpan>,
    is_folded: bool,
    shrink: [f64; 3],
    displacement: [f64; 3],
}

impl Turbulence {
    /// The turbulence of these settings.
    pub fn new(settings: &TurbulenceSettings) -> Self {
        let shrink = settings.stretch.map(|s| 1.0 / s);
        let shrunk = |v: [f64; 3]| std::array::from_fn(|i| v[i] * shrink[i]);
        let gains = (0..settings.octaves).map(|k| settings.gain.powi(k as i32));
        // What has a sign adds up by its squares, what has none by itself.
        let size = if settings.is_folded { gains.sum() } else { gains.map(|g| g * g).sum::<f64>().sqrt() };
        // Octaves are set by their speed, which is their amplitude over their length.
        let amplitude = RMS_TURBULENCE / (RMS_VALUE * size);
        let octaves = octaves(&OctavesSettings {
            length_scale: settings.length_scale,
            speed: amplitude * RMS_SPEED / settings.length_scale,
            octaves: settings.octaves,
            lacunarity: settings.lacunarity,
            gain: settings.gain * settings.lacunarity,
            spin_rate: settings.spin_rate,
            evolve_rate: settings.evolve_rate,
            offset: shrunk(settings.offset),
            scroll: shrunk(settings.scroll),
            seed: settings.seed,
            ..Default::default()
        });
        Self { octaves, is_folded: settings.is_folded, shrink, displacement: settings.displacement }
    }

    /// The turbulence at a time [s].
    pub fn at(&self, time: f64) -> TurbulenceSpan {
        TurbulenceSpan {
            octaves: self.octaves.iter().map(|octave| octave.span(time, 0.0)).collect(),
            is_folded: self.is_folded,
            shrink: self.shrink,
            displacement: self.displacement,
        }
    }
}

impl TurbulenceSpan {
    /// The sum t at `p` [m]: its root mean square is [`RMS_TURBULENCE`]; folded it goes from 0 to about 1, with a mean of
    /// about a quarter.
    ///
    /// Each octave is taken at x − I·M·t(x), with t the sum of all larger ones there.
    pub fn value(&self, p: [f64; 3]) -> f64 {
        let mut sum = 0.0;
        for octave in &self.octaves {
            let q = std::array::from_fn(|i| (p[i] - self.displacement[i] * sum) * self.shrink[i]);
            let one = octave.psi(q, 0.0).value[0];
            sum += if self.is_folded { one.abs() } else { one };
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::CounterRng;

    fn points(n: usize) -> impl Iterator<Item = [f64; 3]> {
        let mut rng = CounterRng::new(Seed(3));
        (0..n).map(move |_| std::array::from_fn(|_| f64::from(rng.uniform()) * 300.0))
    }

    #[test]
    fn the_root_mean_square_is_as_stated_whatever_the_settings() {
        let calm = TurbulenceSettings { seed: Seed(7), ..Default::default() };
        let settings = [
            calm.clone(),
            TurbulenceSettings { octaves: 1, length_scale: 0.3, ..calm.clone() },
            TurbulenceSettings { gain: 0.8, octaves: 6, lacunarity: 1.7, stretch: [1.0, 5.0, 0.4], ..calm.clone() },
            TurbulenceSettings { spin_rate: 0.3, ..calm.clone() },
            TurbulenceSettings { evolve_rate: 0.7, ..calm.clone() },
            TurbulenceSettings { displacement: [0.3, 0.2, 0.0], ..calm.clone() },
        ];
        for settings in settings {
            let turbulence = Turbulence::new(&settings).at(2.3);
            let n = 100_000;
            let (mut square, mut beyond) = (0.0, 0);
            for p in points(n) {
                let t = turbulence.value(p);
                square += t * t / n as f64;
                beyond += usize::from(t.abs() > 1.0);
            }
            println!("root mean square {:.4}, beyond 1: {:.3} %", square.sqrt(), 100.0 * beyond as f64 / n as f64);
            assert!((square.sqrt() / RMS_TURBULENCE - 1.0).abs() < 0.02, "{}", square.sqrt());
            assert!(beyond < n / 100);
        }
    }

    #[test]
    fn folded_turbulence_goes_from_creases_at_zero_to_one_however_many_octaves() {
        for (octaves, gain) in [(1, 0.5), (4, 0.5), (6, 0.62), (16, 1.0)] {
            let settings = TurbulenceSettings { is_folded: true, octaves, gain, ..Default::default() };
            let folded = Turbulence::new(&settings).at(0.0);
            let values: Vec<f64> = points(5000).map(|p| folded.value(p)).collect();
            let mean = values.iter().sum::<f64>() / 5000.0;
            assert!((mean - 0.27).abs() < 0.03, "{octaves} octaves: mean {mean}");
            assert!(values.iter().all(|&t| (0.0..1.3).contains(&t)), "{octaves} octaves");
            let is_creased = values.iter().any(|&t| t < 0.1);
            assert!(octaves > 6 || is_creased && values.iter().any(|&t| t > 0.5), "{octaves} octaves");
        }
    }

    #[test]
    fn smaller_octaves_are_carried_by_the_sum_of_the_larger() {
        let settings =
            TurbulenceSettings { octaves: 2, displacement: [0.0, 0.4, 0.0], seed: Seed(2), ..Default::default() };
        let carried = Turbulence::new(&settings).at(0.0);
        let still = Turbulence::new(&TurbulenceSettings { displacement: [0.0; 3], ..settings }).at(0.0);
        let large = |p: [f64; 3]| still.octaves[0].psi(p, 0.0).value[0];
        let small = |p: [f64; 3]| still.octaves[1].psi(p, 0.0).value[0];
        for p in points(500) {
            let t = large(p);
            assert!((still.value(p) - t - small(p)).abs() < 1e-12);
            let from = [p[0], p[1] - 0.4 * t, p[2]];
            assert!((carried.value(p) - t - small(from)).abs() < 1e-12, "{p:?}");
        }
    }

    #[test]
    fn the_pattern_moves_with_its_scroll_and_is_stretched() {
        let settings = TurbulenceSettings {
            stretch: [1.0, 4.0, 1.0],
            scroll: [0.0, -2.0, 0.5],
            displacement: [0.1, 0.2, 0.0],
            ..Default::default()
        };
        let turbulence = Turbulence::new(&settings);
        let (start, later) = (turbulence.at(0.0), turbulence.at(1.5));
        let plain = Turbulence::new(&TurbulenceSettings {
            stretch: [1.0; 3],
            displacement: [0.1, 0.05, 0.0],
            ..settings.clone()
        });
        for p in points(200) {
            assert!((later.value([p[0], p[1] - 3.0, p[2] + 0.75]) - start.value(p)).abs() < 1e-6, "{p:?}");
            let shrunk = [p[0], p[1] / 4.0, p[2]];
            assert!((plain.at(0.0).value(shrunk) - start.value(p)).abs() < 1e-9);
        }
    }

    #[test]
    fn half_a_turn_negates_the_largest_features_and_a_whole_one_restores_all() {
        let settings = TurbulenceSettings { spin_rate: 0.5, octaves: 1, ..Default::default() };
        let turbulence = Turbulence::new(&settings);
        for p in points(100) {
            let start = turbulence.at(0.0).value(p);
            assert!((turbulence.at(1.0).value(p) + start).abs() < 1e-5);
            assert!((turbulence.at(2.0).value(p) - start).abs() < 1e-5);
        }
    }
}
