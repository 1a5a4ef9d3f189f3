//! Counter-based randomness: every number is a pure function of a key and a counter, so it depends on no order of
//! evaluation and on no number of threads.
//!
//! The mixer is the finaliser of SplitMix64 (Steele, Lea and Flood 2014, *Fast Splittable Pseudorandom Number
//! Generators*), applied to key and counter.

use glam::Vec3;
use rand_core::{Infallible, TryRng};

/// Odd 64-bit constant nearest to 2^64 divided by the golden ratio: consecutive multiples are spread evenly.
const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

/// A bijection of 64-bit words in which every input bit changes every output bit with probability near one half.
#[inline]
pub fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

/// A 64-bit key from which others are derived; the same parts in the same order give the same key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Seed(pub u64);

impl Seed {
    /// The key for part `part` of this one.
    #[inline]
    pub fn derive(self, part: u64) -> Self {
        Self(mix(self.0.wrapping_add(GOLDEN) ^ mix(part.wrapping_add(GOLDEN))))
    }

    /// Word number `counter` of this key's stream.
    #[inline]
    pub fn word(self, counter: u64) -> u64 {
        mix(self.0.wrapping_add(counter.wrapping_add(1).wrapping_mul(GOLDEN)))
    }

    /// Number `counter` of this key's stream, uniform in [0, 1).
    #[inline]
    pub fn uniform(self, counter: u64) -> f32 {
        unit_f32(self.word(counter))
    }
}

/// The top 24 bits of `word` as a number in [0, 1).
#[inline]
pub fn unit_f32(word: u64) -> f32 {
    (word >> 40) as f32 * (1.0 / (1u64 << 24) as f32)
}

/// A [`Seed`]'s stream read in order.
#[derive(Debug, Clone)]
pub struct CounterRng {
    seed: Seed,
    counter: u64,
}

impl CounterRng {
    /// The stream of `seed` from its start.
    #[inline]
    pub fn new(seed: Seed) -> Self {
        Self { seed, counter: 0 }
    }

    /// The next number, uniform in [0, 1).
    #[inline]
    pub fn uniform(&mut self) -> f32 {
        unit_f32(self.next_word())
    }

    /// The next three numbers, uniform in [0, 1), of 21 bits each: a third of the work where that many do.
    #[inline]
    pub fn coarse_point(&mut self) -> Vec3 {
        const MASK: u64 = (1 << 21) - 1;
        let word = self.next_word();
        let bits = [word & MASK, word >> 21 & MASK, word >> 42 & MASK];
        Vec3::new(bits[0] as i32 as f32, bits[1] as i32 as f32, bits[2] as i32 as f32) * (1.0 / (1u64 << 21) as f32)
    }

    #[inline]
    fn next_word(&mut self) -> u64 {
        let word = self.seed.word(self.counter);
        self.counter += 1;
        word
    }
}

impl TryRng for CounterRng {
    type Error = Infallible;

    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        Ok((self.next_word() >> 32) as u32)
    }

    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        Ok(self.next_word())
    }

    fn try_fill_bytes(&mut self, out: &mut [u8]) -> Result<(), Infallible> {
        for chunk in out.chunks_mut(8) {
            chunk.copy_from_slice(&self.next_word().to_le_bytes()[..chunk.len()]);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_input_bit_changes_about_half_of_the_output() {
        for bit in 0..64 {
            let flipped: u32 = (0..512u64).map(|i| (mix(i) ^ mix(i ^ (1 << bit))).count_ones()).sum();
            let mean = f64::from(flipped) / 512.0;
            assert!((mean - 32.0).abs() < 2.0, "bit {bit}: {mean}");
        }
    }

    #[test]
    fn streams_of_neighbouring_keys_are_uncorrelated() {
        let (a, b) = (Seed(7).derive(0), Seed(7).derive(1));
        let n = 100_000;
        let correlation =
            (0..n).map(|i| (a.uniform(i) as f64 - 0.5) * (b.uniform(i) as f64 - 0.5)).sum::<f64>() / n as f64 * 12.0;
        assert!(correlation.abs() < 4.0 / (n as f64).sqrt(), "{correlation}");
    }

    #[test]
    fn uniform_numbers_have_the_moments_of_a_uniform_distribution() {
        let n = 200_000u64;
        let mean = (0..n).map(|i| Seed(3).uniform(i) as f64).sum::<f64>() / n as f64;
        let square = (0..n).map(|i| (Seed(3).uniform(i) as f64).powi(2)).sum::<f64>() / n as f64;
        assert!((mean - 0.5).abs() < 3e-3 && (square - 1.0 / 3.0).abs() < 3e-3);
    }
}
