//! How much light a rough surface sends on in all, by the direction it is seen from: the numbers that make up for light
//! which the models of single scattering lose.

use glam::Vec3;

/// Pieces of a curve: the error of a parabola is 1e-4.
const PIECES: usize = 64;
/// Points that a node is averaged over, and the step of their lattice: neighbours in Fibonacci's sequence.
const LATTICE: [usize; 2] = [2584, 1597];

/// A share of light in [0, 1] by the cosine of the angle to the normal, linear in the root of the cosine between nodes.
#[derive(Debug, Clone)]
pub struct Curve {
    nodes: [f32; PIECES + 1],
    mean: f32,
}

impl Curve {
    /// The curve through a function of the cosine.
    pub fn new(share: impl Fn(f32) -> f32) -> Self {
        // At a right angle to the normal, shares have a limit but no value.
        let nodes = std::array::from_fn(|i| share((i as f32 / PIECES as f32).powi(2).max(1e-5)));
        let mut curve = Self { nodes, mean: 0.0 };
        curve.mean = curve.integrate();
        curve
    }

    /// The mean of `share` over a square of random numbers, seen under each cosine.
    pub fn of_samples(share: impl Fn(Vec3, [f32; 2]) -> f32) -> Self {
        Self::new(|cosine| {
            let wo = Vec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine);
            let [n, step] = LATTICE;
            let shares = (0..n).map(|i| {
                let (x, y) = ((i as f64 + 0.5) / n as f64, (i * step % n) as f64 / n as f64);
                // Light is lost at the steepest mirrors, which are those of first numbers near 1.
                let (u, weight) = (1.0 - (1.0 - x).powi(3), 3.0 * (1.0 - x).powi(2));
                [weight * f64::from(share(wo, [u as f32, y as f32])), weight]
            });
            let [sum, weights] = shares.fold([0.0, 0.0], |[a, b], [c, d]| [a + c, b + d]);
            (sum / weights) as f32
        })
    }

    /// The share at a cosine in [0, 1].
    #[inline]
    pub fn at(&self, cosine: f32) -> f32 {
        let x = cosine.clamp(0.0, 1.0).sqrt() * PIECES as f32;
        let i = (x as usize).min(PIECES - 1);
        let f = x - i as f32;
        self.nodes[i] * (1.0 - f) + self.nodes[i + 1] * f
    }

    /// Its mean over light that comes evenly from everywhere: 2 ∫ share µ dµ.
    pub fn mean(&self) -> f32 {
        self.mean
    }

    /// With µ = t² this is 4 ∫ share t³ dt; on a piece the integrand is of degree 4, for which three Gauss points are exact.
    fn integrate(&self) -> f32 {
        let gauss =
            [(0.5 - 0.6f64.sqrt() / 2.0, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.5 + 0.6f64.sqrt() / 2.0, 5.0 / 18.0)];
        let mut sum = 0.0;
        for i in 0..PIECES {
            for (f, weight) in gauss {
                let t = (i as f64 + f) / PIECES as f64;
                let share = f64::from(self.nodes[i]) * (1.0 - f) + f64::from(self.nodes[i + 1]) * f;
                sum += 4.0 * share * t * t * t * weight / PIECES as f64;
            }
        }
        sum as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_and_their_means_are_those_of_the_function() {
        let curve = Curve::new(|c| 0.2 + 0.7 * c * c);
        for i in 0..=100 {
            let c = i as f32 / 100.0;
            assert!((curve.at(c) - 0.2 - 0.7 * c * c).abs() < 3e-4, "{c}");
        }
        // 2 ∫ (0.2 + 0.7 µ²) µ dµ
        assert!((curve.mean() - 0.55).abs() < 2e-4, "{}", curve.mean());
        let curve = Curve::of_samples(|wo, u| wo.z * u[0] + u[1]);
        assert!((curve.at(0.5) - 0.75).abs() < 1e-3);
    }
}
