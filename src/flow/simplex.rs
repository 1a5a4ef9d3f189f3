//! Simplex noise in any number of dimensions, with its gradient (Perlin 2001, *Noise Hardware*; Gustavson 2005): as many
//! terms as a simplex has corners, n + 1, where noise on a lattice of cubes has 2ⁿ.
//!
//! Kernels are (½ − d²)⁴: they end on the faces of the simplices round their point in every dimension, so that noise and
//! its first three derivatives are continuous.

use crate::math::hash::Seed;
use crate::math::real::{Lane, Word};

/// Square of a kernel's radius, in lattice units: the distance of a point to the far faces of the simplices round it.
const RADIUS_SQUARED: f64 = 0.5;
/// Odd multipliers of lattice coordinates.
const STRIDE: [u32; 7] = [0x9E37_79B1, 0x85EB_CA77, 0xC2B2_AE3D, 0x27D4_EB2F, 0x1656_67B1, 0xD3A2_646D, 0xFD70_46C5];

/// A value with its gradient.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slope<L, const N: usize> {
    /// The value.
    pub value: L,
    /// Its derivatives along the axes.
    pub gradient: [L; N],
}

/// Noise of one size in `N` dimensions, 2 to 7, whose gradient has a root mean square length of 1/length whatever N is:
/// left alone, noise gets weaker with every dimension.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Simplex<const N: usize> {
    inverse_length: f64,
    amplitude: f64,
    seed: [u32; 2],
}

impl<const N: usize> Simplex<N> {
    /// Noise with features of size `length`, > 0; `seed` says which.
    pub fn new(length: f64, seed: Seed) -> Self {
        const { assert!(N >= 2 && N <= STRIDE.len()) };
        let words = [seed.word(0) as u32, seed.word(1) as u32];
        Self { inverse_length: 1.0 / length, amplitude: 1.0 / rms_gradient(N as u32), seed: words }
    }

    /// Value and gradient at a point.
    #[inline(never)]
    pub fn at<L: Lane>(&self, p: [L; N]) -> Slope<L, N> {
        p[0].outlined(
            #[inline(always)]
            || self.at_here(p),
        )
    }

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn at_here<L: Lane>(&self, p: [L; N]) -> Slope<L, N> {
        let like = p[0];
        let (zero, one) = (like.lit(0.0), like.lit(1.0));
        let n = N as f64;
        let skew = ((n + 1.0).sqrt() - 1.0) / n;
        let unskew = (1.0 - 1.0 / (n + 1.0).sqrt()) / n;

        let mut q = p;
        let mut sum = zero;
        for i in 0..N {
            q[i] = p[i] * like.lit(self.inverse_length);
            sum = sum + q[i];
        }
        // In skewed coordinates simplices are those of cubes cut along their diagonals.
        let mut base = q;
        let mut fraction = q;
        for i in 0..N {
            let y = sum.mul_add(like.lit(skew), q[i]);
            base[i] = y.floor();
            fraction[i] = y - base[i];
        }
        // How many coordinates are smaller: the corners of the simplex are reached by one after another, largest first.
        let mut rank = [zero; N];
        for i in 0..N {
            for j in i + 1..N {
                let is_less = fraction[i].select_lt(fraction[j], one, zero);
                rank[j] = rank[j] + is_less;
                rank[i] = rank[i] + one - is_less;
            }
        }
        let mut found = Slope { value: zero, gradient: [zero; N] };
        let [first_seed, second_seed] = self.seed;
        for corner in 0..=N {
            let mut d = [zero; N];
            let mut word = zero.to_word();
            word = word.lit(first_seed);
            let mut shift = zero;
            let least = like.lit((N - corner) as f64 - 0.5);
            for i in 0..N {
                let step = rank[i].select_lt(least, zero, one);
                d[i] = fraction[i] - step;
                shift = shift + d[i];
                let place = (base[i] + step).to_word();
                word = word.add(place.mul(place.lit(STRIDE[i])));
            }
            let mut square = zero;
            for i in 0..N {
                d[i] = d[i] - shift * like.lit(unskew);
                square = d[i].mul_add(d[i], square);
            }
            let s = (like.lit(RADIUS_SQUARED) - square).max(zero);
            let gradient = corner_gradient::<L, N>(like, hash(word, word.lit(second_seed)));
            let mut along = zero;
            for i in 0..N {
                along = gradient[i].mul_add(d[i], along);
            }
            let (s3, s4) = (s * s * s, s * s * s * s);
            found.value = s4.mul_add(along, found.value);
            let inward = like.lit(-8.0) * s3 * along;
            for i in 0..N {
                found.gradient[i] = s4.mul_add(gradient[i], inward.mul_add(d[i], found.gradient[i]));
            }
        }
        let amplitude = like.lit(self.amplitude);
        found.value = found.value * amplitude * like.lit(1.0 / self.inverse_length);
        for i in 0..N {
            found.gradient[i] = found.gradient[i] * amplitude;
        }
        found
    }
}

/// Two rounds of multiply and shift (the constants of Wellons 2018, *Prospecting for Hash Functions*).
#[inline(always)]
fn hash<W: Word>(x: W, seed: W) -> W {
    let x = x.xor(x.shr(16)).mul(x.lit(0x7FEB_352D)).xor(seed);
    let x = x.xor(x.shr(15)).mul(x.lit(0x846C_A68B));
    x.xor(x.shr(16))
}

/// The random gradient of a corner: each component uniform and independent, which is isotropic to second order, with a
/// mean square length of 1.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
fn corner_gradient<L: Lane, const N: usize>(like: L, word: L::Word) -> [L; N] {
    let reach = like.lit((3.0 / N as f64).sqrt());
    let mut gradient = [like.lit(0.0); N];
    // Four components from each word, of eight bits each.
    let second = if N > 4 { hash(word, word.lit(STRIDE[0])) } else { word };
    for i in 0..N {
        let word = if i < 4 { word } else { second };
        let unit = like.unit8(word.shr(8 * (i as u32 % 4)));
        gradient[i] = (unit + unit - like.lit(1.0)) * reach;
    }
    gradient
}

/// Root mean square length of the gradient of unit noise in n dimensions: its mean square is the number of lattice points
/// in a unit of volume, √(n + 1), times the integral over a kernel's ball of E|∇(s⁴ g·d)|² = s⁸ − 16 s⁷ρ²/n + 64 s⁶ρ⁴/n,
/// with s = ½ − ρ² and g of mean square length 1.
fn rms_gradient(n: u32) -> f64 {
    let dimension = f64::from(n);
    // ∫ s^p ρ^q dρ from 0 to the radius, by Euler's beta function.
    let moment = |p: u32, q: f64| {
        let a = 0.5 * (q + 1.0);
        let beta = (1..=p).map(f64::from).product::<f64>() / (0..=p).map(|k| a + f64::from(k)).product::<f64>();
        0.5 * RADIUS_SQUARED.powf(f64::from(p) + a) * beta
    };
    // Area of the unit sphere, from two dimensions less.
    let mut area = if n.is_multiple_of(2) { std::f64::consts::TAU } else { 2.0 };
    let mut m = if n.is_multiple_of(2) { 2 } else { 1 };
    while m < n {
        area *= std::f64::consts::TAU / f64::from(m);
        m += 2;
    }
    let integral = moment(8, dimension - 1.0) - 16.0 / dimension * moment(7, dimension + 1.0)
        + 64.0 / dimension * moment(6, dimension + 3.0);
    ((dimension + 1.0).sqrt() * area * integral).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::CounterRng;

    fn points<const N: usize>(count: usize, size: f64) -> impl Iterator<Item = [f64; N]> {
        let mut rng = CounterRng::new(Seed(5));
        (0..count).map(move |_| std::array::from_fn(|_| (f64::from(rng.uniform()) - 0.5) * size))
    }

    #[allow(clippy::needless_range_loop, reason = "rows and columns")]
    fn check<const N: usize>() {
        let noise = Simplex::<N>::new(0.7, Seed(3));
        let (mut square, mut second, count) = (0.0, [[0.0; N]; N], 60_000);
        for p in points::<N>(count, 100.0) {
            let found = noise.at(p);
            square += found.gradient.iter().map(|g| g * g).sum::<f64>() / count as f64;
            for i in 0..N {
                for j in 0..N {
                    second[i][j] += found.gradient[i] * found.gradient[j] / count as f64;
                }
            }
        }
        println!("{N} dimensions: RMS gradient {:.4}", square.sqrt());
        assert!((square.sqrt() - 1.0).abs() < 0.015, "{N}: {}", square.sqrt());
        for i in 0..N {
            for j in 0..N {
                let expected = if i == j { 1.0 / N as f64 } else { 0.0 };
                assert!((second[i][j] - expected).abs() < 0.02, "{N}: {second:?}");
            }
        }
        // The gradient is that of the value, and both are continuous where one simplex ends and the next begins.
        for p in points::<N>(3000, 8.0) {
            let found = noise.at(p);
            for i in 0..N {
                let moved = |by: f64| {
                    let mut q = p;
                    q[i] += by;
                    noise.at(q)
                };
                let (low, high) = (moved(-1e-4), moved(1e-4));
                let difference = (high.value - low.value) / 2e-4;
                assert!((difference - found.gradient[i]).abs() < 1e-5, "{N} dimensions at {p:?}");
                assert!((high.gradient[i] - low.gradient[i]).abs() < 2e-2, "{N} dimensions at {p:?}");
            }
        }
    }

    #[test]
    fn in_every_dimension_the_gradient_is_right_isotropic_and_of_length_one() {
        check::<2>();
        check::<3>();
        check::<4>();
        check::<5>();
        check::<6>();
        check::<7>();
    }

    #[test]
    fn seeds_and_places_far_apart_are_different_noise() {
        let (a, b) = (Simplex::<3>::new(1.0, Seed(1)), Simplex::<3>::new(1.0, Seed(2)));
        let (mut of_seeds, mut of_places, mut own) = (0.0, 0.0, 0.0);
        for p in points::<3>(20_000, 50.0) {
            let value = a.at(p).value;
            own += value * value;
            of_seeds += value * b.at(p).value;
            of_places += value * a.at(p.map(|x| x + 256.0)).value;
        }
        assert!(of_seeds.abs() < 0.03 * own && of_places.abs() < 0.03 * own, "{of_seeds} {of_places} {own}");
    }
}
