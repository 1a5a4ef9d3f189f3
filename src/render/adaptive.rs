//! Paths where they are needed: a pixel ends once its noise is small enough, without bias.
//!
//! Ending a sum when its own estimated error is small favours sums that look quiet by chance, which are too dark. So a
//! pixel has two halves of independent paths, and *each half ends where the other would have*: the number of paths of a
//! half then has nothing to do with their values, its mean is unbiased, and so is the mean of both. What the half that
//! ends later traced beyond that serves to find the end of the other, and is not used.

use crate::render::RenderError;
use crate::render::color::luminance;
use crate::render::film::PixelSum;
use crate::render::layers::Layer;
use glam::Vec3;
use std::ops::Range;

/// Keys of the two halves' random numbers.
pub const HALVES: [u64; 2] = [0x0068_616c_6631, 0x0068_616c_6632];

/// Paths of a half between two looks at its noise.
const BATCH: u32 = 16;

/// Luminance [W/(m² sr)] that counts as much as the pixel's own in what noise is allowed: without it black pixels never end.
const DARK: f32 = 0.05;

/// When a pixel has enough paths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adaptive {
    /// Standard error of a pixel's luminance over that luminance plus 0.05 [W/(m² sr)].
    pub noise: f32,
    /// Fewest paths of a pixel.
    pub min_spp: u32,
}

impl Adaptive {
    /// All paths of a pixel, at most `spp`, an even number; `trace(half, sum, samples)` adds paths to the sum of a half.
    ///
    /// # Errors
    /// The first of `trace`.
    pub fn paint(
        &self,
        spp: u32,
        layers: &[Layer],
        mut trace: impl FnMut(usize, &mut PixelSum, Range<u32>) -> Result<(), RenderError>,
    ) -> Result<PixelSum, RenderError> {
        let most = (spp / 2).max(1);
        let mut sums = [PixelSum::new(layers), PixelSum::new(layers)];
        let mut ended: [Option<PixelSum>; 2] = [None, None];
        let mut count = 0;
        while ended.iter().any(Option::is_none) {
            let next = if count == 0 { self.min_spp.div_ceil(2).max(2) } else { count + BATCH }.min(most);
            for (half, sum) in sums.iter_mut().enumerate() {
                trace(half, sum, count..next)?;
            }
            count = next;
            for half in 0..2 {
                if ended[half].is_none() && (count == most || self.is_quiet(&sums[1 - half])) {
                    ended[half] = Some(sums[half].clone());
                }
            }
        }
        let [a, b] = ended.map(|half| half.expect("the loop ends with both"));
        Ok(PixelSum::of_halves(&a, &b))
    }

    /// Whether two halves like this one have little enough noise.
    fn is_quiet(&self, half: &PixelSum) -> bool {
        // The shadow that a catcher takes has no variance of its own to judge by.
        if half.has_caught() {
            return false;
        }
        let moments = half.moments();
        // Channels rise and fall together, or nearly: an upper bound.
        let error = luminance(Vec3::powf(moments.variance_of_mean(), 0.5)) * std::f32::consts::FRAC_1_SQRT_2;
        error <= self.noise * (luminance(moments.mean()) + DARK)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};
    use crate::render::film::Contribution;

    /// Adds values that are mostly 0.2 and seldom large, on average 1.
    fn flicker(rng: &mut CounterRng, sum: &mut PixelSum, samples: Range<u32>) -> Result<(), RenderError> {
        for _ in samples {
            let x = if rng.uniform() < 0.02 { 40.2 } else { 0.2 };
            sum.add(&[], &Contribution { radiance: Vec3::splat(x), ..Default::default() });
        }
        Ok(())
    }

    #[test]
    fn the_mean_is_unbiased_where_a_sum_that_judges_itself_is_not() {
        let adaptive = Adaptive { noise: 0.25, min_spp: 32 };
        let pixels = 20_000;
        let (mut crossed, mut own, mut used) = ([0.0f64; 2], 0.0f64, 0u64);
        for pixel in 0..pixels {
            let mut rngs = [1, 2].map(|half| CounterRng::new(Seed(pixel).derive(half)));
            let sum = adaptive.paint(4096, &[], |half, sum, n| flicker(&mut rngs[half], sum, n)).unwrap();
            let mean = f64::from(sum.finish().mean.x);
            crossed[0] += mean;
            crossed[1] += mean * mean;
            used += u64::from(sum.moments().count());
            // What one must not do.
            let mut rng = CounterRng::new(Seed(pixel).derive(3));
            let mut sum = PixelSum::new(&[]);
            flicker(&mut rng, &mut sum, 0..16).unwrap();
            while sum.moments().count() < 2048 && !adaptive.is_quiet(&sum) {
                flicker(&mut rng, &mut sum, 0..16).unwrap();
            }
            own += f64::from(sum.finish().mean.x);
        }
        let n = pixels as f64;
        let mean = crossed[0] / n;
        let error = ((crossed[1] / n - mean * mean) / n).sqrt();
        println!("mean {mean:.4} +- {error:.4}, judged by itself {:.4}, {:.0} paths a pixel", own / n, used as f64 / n);
        assert!((mean - 1.0).abs() < 4.0 * error, "{mean} +- {error}");
        assert!(own / n < 1.0 - 10.0 * error, "the other way must be seen to fail: {}", own / n);
        assert!(used as f64 / n < 3900.0, "it must end early");
    }
}
