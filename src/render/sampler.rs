//! Random numbers of a path: Owen-scrambled Sobol' points for the decisions that shape the picture most, a counter-based
//! stream for all others.
//!
//! Every number is a function of (seed, pixel, sample, dimension): no order of evaluation changes it. Pixels are
//! decorrelated by scrambling (Burley 2020, *Practical Hash-based Owen Scrambling*).

use crate::math::hash::{CounterRng, Seed};

/// Bounces whose decisions are taken from Sobol' points; later ones no longer profit from stratification.
const STRATIFIED_BOUNCES: u32 = 4;

/// Longest Sobol' sequence that the generator supports; further samples begin a new scramble.
const SEQUENCE: u32 = 1 << 16;

/// What a group of four numbers decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dimension {
    /// Position on the film (two numbers) and on the lens (two numbers).
    Film,
    /// Optical distance to the next collision (one number), roulette (one number), and at the camera the channel that decides
    /// in smoke with a tint (one number).
    Flight,
    /// Direction after an event (two numbers), and which lobe (one number).
    Direction,
    /// Choice of a light (one number) and of a point on it (two numbers).
    Light,
    /// Choice of a lamp near a flight (one number), of a distance (one number) and of a point on the lamp (two numbers).
    Distance,
}

/// The random numbers of one path.
#[derive(Debug, Clone)]
pub struct Sampler {
    scramble: u32,
    index: u32,
    stream: CounterRng,
}

impl Sampler {
    /// The numbers of sample `sample` of the pixel in column `x` and row `y`.
    pub fn new(seed: Seed, x: u32, y: u32, sample: u32) -> Self {
        let pixel = seed.derive(u64::from(y) << 32 | u64::from(x));
        let block = pixel.derive(u64::from(sample / SEQUENCE));
        Self {
            scramble: (block.0 >> 32) as u32,
            index: sample % SEQUENCE,
            stream: CounterRng::new(block.derive(1 + u64::from(sample % SEQUENCE))),
        }
    }

    /// Four numbers in [0, 1) for a decision at bounce `bounce` (0 at the camera).
    #[inline]
    pub fn numbers(&mut self, dimension: Dimension, bounce: u32) -> [f32; 4] {
        if bounce < STRATIFIED_BOUNCES {
            let set = match dimension {
                Dimension::Film => 0,
                Dimension::Flight => 1 + bounce * 3,
                Dimension::Direction => 2 + bounce * 3,
                Dimension::Light => 3 + bounce * 3,
                Dimension::Distance => 1 + STRATIFIED_BOUNCES * 3 + bounce,
            };
            sobol_burley::sample_4d(self.index, set, self.scramble)
        } else {
            std::array::from_fn(|_| self.stream.uniform())
        }
    }

    /// The stream for decisions of unknown number: null collisions and transmittance.
    #[inline]
    pub fn stream(&mut self) -> &mut CounterRng {
        &mut self.stream
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_points_of_a_pixel_are_stratified() {
        let n = 256;
        let mut cells = vec![0; n];
        for i in 0..n as u32 {
            let u = Sampler::new(Seed(5), 3, 9, i).numbers(Dimension::Film, 0);
            cells[(u[0] * 16.0) as usize * 16 + (u[1] * 16.0) as usize] += 1;
        }
        assert!(cells.iter().all(|&c| c == 1), "a (0, 8, 2)-net has one point in each of 16 x 16 cells");
    }

    #[test]
    fn pixels_samples_and_dimensions_differ() {
        let at = |x, s, d, b| Sampler::new(Seed(5), x, 0, s).numbers(d, b);
        let base = at(0, 0, Dimension::Film, 0);
        assert_ne!(base, at(1, 0, Dimension::Film, 0));
        assert_ne!(base, at(0, 1, Dimension::Film, 0));
        assert_ne!(base, at(0, SEQUENCE, Dimension::Film, 0));
        assert_ne!(at(0, 0, Dimension::Flight, 0), at(0, 0, Dimension::Flight, 1));
        assert_ne!(at(0, 0, Dimension::Light, 7), at(0, 1, Dimension::Light, 7));
    }
}
