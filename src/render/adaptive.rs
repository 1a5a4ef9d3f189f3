//! Paths where they are needed: a pixel has as many as the noise of its neighbours asks for, without bias.
//!
//! Ending a sum when its own estimated error is small favours sums that look quiet by chance, which are too dark. So all pixels
//! begin with equally many paths, and how many more a pixel gets follows from those of the pixels round it, not from its own:
//! the number has nothing to do with the values that it counts, so their mean is unbiased, and no path is traced in vain.
//! Neighbours share no sequence of random numbers here, whose errors would have to do with each other.

use crate::render::color::luminance;
use crate::render::film::PixelSum;
use glam::Vec3;

/// Luminance [W/(m² sr)] that counts as much as the pixel's own in what noise is allowed: without it black pixels never end.
const DARK: f32 = 0.05;

/// When a pixel has enough paths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adaptive {
    /// Standard error of a pixel's luminance over that luminance plus 0.05 [W/(m² sr)].
    pub noise: f32,
    /// Fewest paths of a pixel, with which all begin.
    pub min_spp: u32,
}

impl Adaptive {
    /// How many paths bring a pixel to little enough noise, as far as `sum` tells of such pixels; infinite where it cannot.
    pub fn needed(&self, sum: &PixelSum) -> f32 {
        let moments = sum.moments();
        // The shadow that a catcher takes has no variance of its own to judge by.
        if sum.has_caught() || moments.count() < 2 {
            return f32::INFINITY;
        }
        // Channels rise and fall together, or nearly: an upper bound.
        let deviation = luminance(Vec3::powf(moments.variance_of_mean(), 0.5)) * (moments.count() as f32).sqrt();
        (deviation / (self.noise * (luminance(moments.mean()) + DARK))).powi(2)
    }

    /// Paths of a pixel, at most `spp`, by what is `needed` of the pixels round it; those are sorted meanwhile.
    ///
    /// It is the mean of their larger half: at an edge the quiet side says nothing about the other one, and the largest of
    /// all would mostly be large by chance.
    pub fn paths(&self, spp: u32, needed: &mut [f32]) -> u32 {
        needed.sort_by(|a, b| b.total_cmp(a));
        let larger = &needed[..needed.len().div_ceil(2)];
        // No neighbours, or one that cannot tell.
        let mean = if larger.is_empty() { f32::INFINITY } else { larger.iter().sum::<f32>() / larger.len() as f32 };
        // Beyond the largest whole number it stays there.
        (mean.ceil() as u32).clamp(self.min_spp.min(spp), spp)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};
    use crate::render::film::Contribution;

    /// Adds values that are mostly 0.2 and seldom large, on average 1, with a variance of 31.4.
    fn flicker(rng: &mut CounterRng, sum: &mut PixelSum, count: u32) {
        for _ in 0..count {
            let x = if rng.uniform() < 0.02 { 40.2 } else { 0.2 };
            sum.add(&[], &Contribution { radiance: Vec3::splat(x), ..Default::default() });
        }
    }

    #[test]
    fn the_mean_is_unbiased_where_a_sum_that_judges_itself_is_not() {
        let adaptive = Adaptive { noise: 0.25, min_spp: 32 };
        let pixels = 20_000;
        let (mut judged, mut own, mut used) = ([0.0f64; 2], 0.0f64, 0u64);
        for pixel in 0..pixels {
            let begun = |part: u64, count: u32| {
                let (mut rng, mut sum) = (CounterRng::new(Seed(pixel).derive(part)), PixelSum::new(&[]));
                flicker(&mut rng, &mut sum, count);
                (rng, sum)
            };
            let mut needed: Vec<f32> = (1..9).map(|part| adaptive.needed(&begun(part, 32).1)).collect();
            let (mut rng, mut sum) = begun(0, 32);
            flicker(&mut rng, &mut sum, adaptive.paths(4096, &mut needed) - 32);
            let mean = f64::from(sum.finish().mean.x);
            judged[0] += mean;
            judged[1] += mean * mean;
            used += u64::from(sum.moments().count());
            // What one must not do.
            let (mut rng, mut sum) = begun(9, 16);
            while sum.moments().count() < 4096 && (sum.moments().count() as f32) < adaptive.needed(&sum) {
                flicker(&mut rng, &mut sum, 16);
            }
            own += f64::from(sum.finish().mean.x);
        }
        let n = pixels as f64;
        let mean = judged[0] / n;
        let error = ((judged[1] / n - mean * mean) / n).sqrt();
        println!("mean {mean:.4} +- {error:.4}, judged by itself {:.4}, {:.0} paths a pixel", own / n, used as f64 / n);
        assert!((mean - 1.0).abs() < 4.0 * error, "{mean} +- {error}");
        assert!(own / n < 1.0 - 10.0 * error, "the other way must be seen to fail: {}", own / n);
        // By the true variance it would be 31.4 / (0.25 · 1.05)² = 456; few paths mostly see less.
        assert!((200.0..2000.0).contains(&(used as f64 / n)), "{}", used as f64 / n);
    }

    #[test]
    fn pixels_at_an_edge_have_what_the_noisy_side_asks_for() {
        let adaptive = Adaptive { noise: 0.1, min_spp: 4 };
        assert_eq!(adaptive.paths(1000, &mut [100.0, 1.0, 1.0, 100.0, 1.0, 1.0, 100.0, 100.0]), 100);
        assert_eq!(adaptive.paths(1000, &mut [1.0; 8]), 4);
        assert_eq!(adaptive.paths(1000, &mut [5000.0; 3]), 1000);
        assert_eq!(adaptive.paths(1000, &mut [f32::INFINITY, 1.0, 1.0]), 1000, "a catcher nearby");
        assert_eq!(adaptive.paths(1000, &mut []), 1000, "a picture of one pixel");
    }
}
