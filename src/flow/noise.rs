//! Three gradient noises at once, with analytic derivatives: the vector potential of random swirls.
//!
//! Perlin 2002 (*Improving Noise*) with its quintic weight, so that value, gradient and second derivatives are
//! continuous and the velocity is C¹. Each lattice point has, instead of a gradient from a table, one of 128 frames
//! hashed from its coordinates, whose axes are the gradients of the three components (see [`crate::flow::flow_noise`]):
//! the components share corner weights and hash, and are uncorrelated.

use crate::flow::flow_noise::{LatticeFrame, Spin, sin_cos_quarter};
use crate::flow::potential::Psi;
use crate::math::interpolate::quintic_step;
use crate::math::real::{Lane, Word, triple};

/// Root mean square speed |∇×ψ| of unit noise, averaged over a cell: √(16·(D·A² + 2·A·B·C)) with A = ∫f²,
/// B = ∫f'², C = ∫f²x², D = ∫f'²x² over [0, 1] and f the falling quintic step.
///
/// With independent gradients of unit length, uniform in direction, E[(∂ψ_c/∂x)²] is 8/3 of the integral over a cell
/// of (∂w/∂x)²|r|² + 2w·∂w/∂x·x + w² with w = f(x)f(y)f(z) the weight of a corner at r; ∫ff'x = −A/2, so the last two
/// cancel, and |∇×ψ|² is six such derivatives. The tests hold it against quadrature and against the noise itself.
pub const RMS_SPEED: f64 = 1.220_077_940_7;

/// Root mean square of |∇f × ∇g| for f and g from [`noise_pair`], averaged over a cell; measured, to a
/// thousandth. While evolving noise changes from pattern to pattern it is up to 2 % less.
pub const RMS_BITANGENT: f64 = 0.644_2;

/// Odd multipliers of the lattice coordinates: large primes without structure among their sums.
const STRIDE: [u32; 3] = [0x9E37_79B1, 0x85EB_CA77, 0xC2B2_AE3D];

/// Which of the many patterns: added to and mixed into the hash of a lattice point.
pub type NoiseSeed = [u32; 2];

/// Hash of the sum of strides of a lattice point: two rounds of multiply and shift (the constants of Wellons 2018,
/// *Prospecting for Hash Functions*, lowest bias found).
#[inline(always)]
fn hash<W: Word>(sum: W, seed: W) -> W {
    let x = sum.xor(sum.shr(16)).mul(sum.lit(0x7FEB_352D));
    let x = x.xor(seed);
    let x = x.xor(x.shr(15)).mul(x.lit(0x846C_A68B));
    x.xor(x.shr(16))
}

/// The words of a seed, in all lanes.
#[inline(always)]
pub fn seed_words<L: Lane>(like: L, seed: NoiseSeed) -> [L::Word; 2] {
    let zero = like.lit(0.0).to_word();
    [zero.lit(seed[0]), zero.lit(seed[1])]
}

/// Noise in four dimensions, the fourth being time: each whole step has a pattern of its own, and between two of them
/// their shares are cosine and sine of an angle that goes by a quintic step from 0 to a right angle. So its mean square is
/// the same at all times, where the usual weights of lattice noise let it sink to a half between steps.
///
/// `time` counts in steps from `step` on.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
pub fn evolving_noise<L: Lane>(p: [L; 3], cell: [u32; 3], seed: NoiseSeed, step: u32, time: L) -> Psi<L> {
    let whole = time.floor();
    let (sin, cos) = sin_cos_quarter(quintic_step(time - whole).0);
    let shares = [cos, sin];
    let [place, pattern] = seed_words(time, seed);
    let now = whole.to_word().add(place.lit(step));
    let still = Spin::advanced(Spin::from_turns(0.0), time.lit(0.0));
    let mut psi = Psi::zero(time);
    for k in 0..2 {
        let step = now.add(now.lit(k as u32));
        let seed = [place, pattern.xor(step.mul(step.lit(STRIDE[0])))];
        psi = psi.plus(&gradient_noise(p, cell, seed, still).scaled(shares[k]));
    }
    psi
}

/// Noise of unit lattice at `p`, where lattice coordinates are counted from `cell`; gradients turned by `spin`.
#[inline(never)]
pub fn gradient_noise<L: Lane>(p: [L; 3], cell: [u32; 3], seed: [L::Word; 2], spin: Spin<L>) -> Psi<L> {
    p[0].outlined(
        #[inline(always)]
        || gradient_noise_here::<L, 3>(p, cell, seed, spin),
    )
}

/// Two noises whose gradients at lattice points are at right angles at all times; the third component is 0.
#[inline(never)]
pub fn noise_pair<L: Lane>(p: [L; 3], cell: [u32; 3], seed: [L::Word; 2], spin: Spin<L>) -> Psi<L> {
    p[0].outlined(
        #[inline(always)]
        || gradient_noise_here::<L, 2>(p, cell, seed, spin),
    )
}

#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
fn gradient_noise_here<L: Lane, const COMPONENTS: usize>(
    p: [L; 3],
    cell: [u32; 3],
    seed: [L::Word; 2],
    spin: Spin<L>,
) -> Psi<L> {
    let one = p[0].lit(1.0);
    let base = triple!(a => p[a].floor());
    let offset: [[L; 2]; 3] = triple!(a => [p[a] - base[a], p[a] - base[a] - one]);
    let stride: [[L::Word; 2]; 3] = triple!(a => {
        let low = base[a].to_word();
        let low = low.add(low.lit(cell[a])).mul(low.lit(STRIDE[a]));
        [low, low.add(low.lit(STRIDE[a]))]
    });
    let step: [(L, L); 3] = triple!(a => quintic_step(offset[a][0]));
    let weight: [[L; 2]; 3] = triple!(a => [one - step[a].0, step[a].0]);
    let slope: [[L; 2]; 3] = triple!(a => [-step[a].1, step[a].1]);

    let mut psi = Psi::zero(one);
    for k in 0..2 {
        let stride_z = stride[2][k].add(seed[0]);
        for j in 0..2 {
            let stride_yz = stride[1][j].add(stride_z);
            let weight_yz = weight[1][j] * weight[2][k];
            let slope_y = slope[1][j] * weight[2][k];
            let slope_z = weight[1][j] * slope[2][k];
            for i in 0..2 {
                let frame = LatticeFrame::new(one, hash(stride[0][i].add(stride_yz), seed[1]));
                let gradients = if COMPONENTS == 2 { frame.pair(spin) } else { frame.gradients(spin) };
                let w = weight[0][i] * weight_yz;
                let dw = [slope[0][i] * weight_yz, weight[0][i] * slope_y, weight[0][i] * slope_z];
                let r = [offset[0][i], offset[1][j], offset[2][k]];
                for c in 0..COMPONENTS {
                    let g = gradients[c];
                    let linear = g[0].mul_add(r[0], g[1].mul_add(r[1], g[2] * r[2]));
                    psi.value[c] = w.mul_add(linear, psi.value[c]);
                    for a in 0..3 {
                        psi.jacobian[c][a] = w.mul_add(g[a], dw[a].mul_add(linear, psi.jacobian[c][a]));
                    }
                }
            }
        }
    }
    psi
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::curl::{central_jacobian, curl};
    use crate::math::hash::{CounterRng, Seed};

    fn noise(p: [f64; 3], turns: f64) -> Psi<f64> {
        gradient_noise(p, [0; 3], seed_words(p[0], [17, 99]), Spin::from_turns(turns))
    }

    fn random_point(rng: &mut CounterRng) -> [f64; 3] {
        std::array::from_fn(|_| f64::from(rng.uniform()) * 500.0 - 250.0)
    }

    #[test]
    fn the_jacobian_equals_central_differences() {
        let mut rng = CounterRng::new(Seed(5));
        for _ in 0..200 {
            let p = random_point(&mut rng);
            let exact = noise(p, 0.3).jacobian;
            let difference = central_jacobian(|q| noise(q, 0.3).value, p, 1e-4);
            for c in 0..3 {
                for i in 0..3 {
                    // Second derivatives are continuous and no more, so cells' faces cost an order.
                    assert!((exact[c][i] - difference[c][i]).abs() < 1e-6, "{p:?} {c} {i}");
                }
            }
        }
    }

    #[test]
    fn the_cross_product_of_two_gradients_has_the_stated_size() {
        for turns in [0.0, 0.125, 0.2, 0.4] {
            let (n, mut square) = (400_000, 0.0);
            let mut rng = CounterRng::new(Seed(6));
            for _ in 0..n {
                let p = random_point(&mut rng);
                let pair = noise_pair(p, [0; 3], seed_words(p[0], [3, 5]), Spin::from_turns(turns));
                assert_eq!(pair.value[2], 0.0);
                let v = crate::math::real::cross(pair.jacobian[0], pair.jacobian[1]);
                square += v.iter().map(|x| x * x).sum::<f64>();
            }
            let rms = (square / f64::from(n)).sqrt();
            println!("RMS |∇f × ∇g| {rms:.6} after {turns} turns");
            assert!((rms / RMS_BITANGENT - 1.0).abs() < 3e-3, "{rms} after {turns} turns");
        }
    }

    #[test]
    fn the_rms_speed_constant_is_its_closed_form() {
        let f = |x: f64| 1.0 - quintic_step(x).0;
        let df = |x: f64| -quintic_step(x).1;
        let n = 20_000;
        let integral =
            |g: &dyn Fn(f64) -> f64| (0..n).map(|i| g((f64::from(i) + 0.5) / f64::from(n))).sum::<f64>() / f64::from(n);
        let a = integral(&|x| f(x).powi(2));
        let b = integral(&|x| df(x).powi(2));
        let c = integral(&|x| (f(x) * x).powi(2));
        let d = integral(&|x| (df(x) * x).powi(2));
        let rms = (16.0 * (d * a * a + 2.0 * a * b * c)).sqrt();
        assert!((rms - RMS_SPEED).abs() < 1e-8, "{rms:.13}");
    }

    #[test]
    fn noise_has_the_rms_speed_mean_zero_and_uncorrelated_components_at_every_phase() {
        for turns in [0.0, 0.1, 0.37] {
            let n = 100_000;
            let mut rng = CounterRng::new(Seed(6));
            let (mut speed_sq, mut mean, mut covariance, mut axis_sq) = (0.0, [0.0; 3], [0.0; 3], [0.0; 3]);
            for _ in 0..n {
                let p = std::array::from_fn(|_| f64::from(rng.uniform()) * 20_000.0 - 10_000.0);
                let psi = noise(p, turns);
                let v = curl(&psi);
                speed_sq += v.iter().map(|x| x * x).sum::<f64>();
                for c in 0..3 {
                    mean[c] += psi.value[c];
                    axis_sq[c] += v[c] * v[c];
                    covariance[c] += psi.value[c] * psi.value[(c + 1) % 3];
                }
            }
            let n = f64::from(n);
            let rms = (speed_sq / n).sqrt();
            println!("rms speed of unit noise at {turns} turns: {rms:.5} (closed form {RMS_SPEED:.5})");
            assert!((rms / RMS_SPEED - 1.0).abs() < 0.01, "{turns}: {rms}");
            for c in 0..3 {
                assert!((mean[c] / n).abs() < 5e-3, "mean {mean:?}");
                assert!((covariance[c] / n).abs() < 2e-3, "covariance {covariance:?}");
                assert!((axis_sq[c] / n / (RMS_SPEED * RMS_SPEED / 3.0) - 1.0).abs() < 0.03, "axes {axis_sq:?}");
            }
        }
    }
}
