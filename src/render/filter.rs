//! Pixel filters by importance sampling: a sample's place is drawn in proportion to the filter, so each sample of a
//! pixel counts alike and no sample is shared between pixels (Ernst et al. 2006, *Filter importance sampling*).

use glam::Vec2;
use std::f64::consts::TAU;

/// Entries of the tabulated inverse of a filter's integral: finer than an 8-bit sub-pixel position.
const TABLE: usize = 1024;

/// Where in and around a pixel samples fall.
#[derive(Debug, Clone)]
pub enum Filter {
    /// Uniform over a square of half-width `radius` [pixels].
    Box {
        /// Half-width [pixels].
        radius: f32,
    },
    /// Separable, by a table.
    Separable {
        /// Offsets [pixels] at equal steps of the filter's integral.
        inverse: Vec<f32>,
    },
}

impl Filter {
    /// The four-term Blackman–Harris window (Harris 1978, table I, −92 dB) of half-width `radius` [pixels].
    pub fn blackman_harris(radius: f32) -> Self {
        Self::separable(radius, |x| {
            0.35875 - 0.48829 * (TAU * x).cos() + 0.14128 * (2.0 * TAU * x).cos() - 0.01168 * (3.0 * TAU * x).cos()
        })
    }

    /// Falls straight from the middle to 0 at `radius` [pixels].
    pub fn triangle(radius: f32) -> Self {
        Self::separable(radius, |x| 1.0 - (2.0 * x - 1.0).abs())
    }

    /// A bell of standard deviation `radius`/3 [pixels], less its value at `radius`, so that it ends at 0 there.
    pub fn gaussian(radius: f32) -> Self {
        let bell = |s: f64| (-4.5 * s * s).exp();
        Self::separable(radius, move |x| bell(2.0 * x - 1.0) - bell(1.0))
    }

    /// The product of two equal windows over [0, 1], stretched to half-width `radius` [pixels].
    fn separable(radius: f32, window: impl Fn(f64) -> f64) -> Self {
        let fine = 64 * TABLE;
        let total: f64 = (0..fine).map(|i| window((i as f64 + 0.5) / fine as f64)).sum();
        let mut inverse = Vec::with_capacity(TABLE + 1);
        inverse.push(-radius);
        let mut sum = 0.0;
        for i in 0..fine {
            sum += window((i as f64 + 0.5) / fine as f64);
            while inverse.len() < TABLE && sum / total * TABLE as f64 >= inverse.len() as f64 {
                inverse.push(radius * (2.0 * (i as f64 + 1.0) / fine as f64 - 1.0) as f32);
            }
        }
        inverse.push(radius);
        Self::Separable { inverse }
    }

    /// Offset from the middle of the pixel [pixels], from two uniform numbers.
    #[inline]
    pub fn sample(&self, u: [f32; 2]) -> Vec2 {
        match self {
            Filter::Box { radius } => (2.0 * Vec2::from(u) - 1.0) * *radius,
            Filter::Separable { inverse } => Vec2::from(u.map(|u| {
                let place = u * TABLE as f32;
                let i = (place as usize).min(TABLE - 1);
                inverse[i] + (place - i as f32) * (inverse[i + 1] - inverse[i])
            })),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blackman_harris_offsets_have_the_moments_of_the_window() {
        let filter = Filter::blackman_harris(1.5);
        let n = 100_000;
        let (mut mean, mut square) = (0.0f64, 0.0f64);
        for i in 0..n {
            let x = f64::from(filter.sample([(i as f32 + 0.5) / n as f32, 0.5]).x);
            assert!(x.abs() <= 1.5);
            mean += x / n as f64;
            square += x * x / n as f64;
        }
        // ∫ x² w / ∫ w over the unit interval about its middle, from the cosine series: 1/12 + Σ a_k/(2π²k² a_0).
        let a = [0.35875, -0.48829, 0.14128, -0.01168];
        let pi_sq = std::f64::consts::PI.powi(2);
        let second = 1.0 / 12.0 + (1..4).map(|k| a[k] / (2.0 * pi_sq * (k * k) as f64)).sum::<f64>() / a[0];
        assert!(mean.abs() < 1e-4, "{mean}");
        // The first and the last step of the table spread their thousandth of the weight evenly.
        assert!((square - 9.0 * second).abs() < 1e-3, "{square} {}", 9.0 * second);
    }
    #[test]
    fn offsets_have_the_variance_of_their_filter() {
        let n = 100_000;
        let variance = |filter: &Filter| {
            let offsets = (0..n).map(|i| f64::from(filter.sample([0.5, (i as f32 + 0.5) / n as f32]).y));
            offsets.map(|y| y * y / f64::from(n)).sum::<f64>()
        };
        // Of a triangle r²/6. Of the cut bell by parts: ∫ s² (bell − bell(1)) over ∫ (bell − bell(1)).
        let triangle = variance(&Filter::triangle(2.0));
        assert!((triangle - 4.0 / 6.0).abs() < 1e-3, "{triangle}");
        let fine = 1 << 20;
        let (mut weight, mut square) = (0.0f64, 0.0f64);
        for i in 0..fine {
            let s = 2.0 * (f64::from(i) + 0.5) / f64::from(fine) - 1.0;
            let w = (-4.5 * s * s).exp() - (-4.5f64).exp();
            weight += w;
            square += w * s * s;
        }
        let gaussian = variance(&Filter::gaussian(2.0));
        assert!((gaussian - 4.0 * square / weight).abs() < 1e-3, "{gaussian}");
    }
}
