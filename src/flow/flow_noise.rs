//! Gradients that turn in time (Perlin and Neyret 2001, *Flow Noise*): swirls that live in place.
//!
//! Each lattice point has a random orthonormal frame (r0, r1, r2). The gradient of component c turns in the plane of
//! r_c and r_{c+1}, that is about the hashed axis r_{c+2}: g_c = ±(r_c cos θ + r_{c+1} sin θ). A random start angle
//! would add nothing: the frame's orientation within that plane is random already. So θ is the same for all points of
//! an octave, and every instant has the statistics of every other.
//!
//! Period and phase: the pattern after half a turn is the negative one, after a whole turn the same one again.

use crate::math::real::{Lane, Real, Word, triple};
use std::f64::consts::TAU;

/// How far the gradients have turned: cosine and sine of the angle.
#[derive(Debug, Clone, Copy)]
pub struct Spin<L> {
    cos: L,
    sin: L,
}

impl Spin<f64> {
    /// Turned by `turns` whole revolutions.
    pub fn from_turns(turns: f64) -> Self {
        let angle = TAU * turns.fract();
        Self { cos: angle.cos(), sin: angle.sin() }
    }
}

impl<L: Lane> Spin<L> {
    /// `start`, and then turned by `turns` revolutions more.
    #[inline(always)]
    pub fn advanced(start: Spin<f64>, turns: L) -> Self {
        let turns = turns - (turns + turns.lit(0.5)).floor();
        let quarter = turns - round_to_half(turns);
        let flip = round_to_half(turns) * turns.lit(2.0);
        let (sin, cos) = sin_cos_quarter(quarter * turns.lit(4.0));
        // Half a turn negates: (−1)^flip = 1 − 2·(flip mod 2), with flip in {−1, 0, 1}.
        let sign = turns.lit(1.0) - (flip * flip) * turns.lit(2.0);
        let (sin, cos) = (sin * sign, cos * sign);
        let (c0, s0) = (turns.lit(start.cos), turns.lit(start.sin));
        Self { cos: c0 * cos - s0 * sin, sin: s0 * cos + c0 * sin }
    }
}

/// −½, 0 or ½, whichever is nearest to `x` in [−¾, ¾].
#[inline(always)]
fn round_to_half<L: Real>(x: L) -> L {
    let (quarter, half, zero) = (x.lit(0.25), x.lit(0.5), x.lit(0.0));
    let positive = quarter.select_lt(x, half, zero);
    x.select_lt(-quarter, -half, positive)
}

/// Sine and cosine of t quarter turns, |t| ≤ 1: Taylor polynomials, absolute error below 4e-6.
///
/// The frames of lattice points need no more, and all lanes and the scalar evaluate the same polynomial.
#[inline(always)]
pub fn sin_cos_quarter<L: Real>(t: L) -> (L, L) {
    let s = t * t;
    let sin = s
        .mul_add(t.lit(1.604_411_847_9e-4), t.lit(-4.681_754_135_3e-3))
        .mul_add(s, t.lit(7.969_262_624_6e-2))
        .mul_add(s, t.lit(-6.459_640_975_1e-1))
        .mul_add(s, t.lit(std::f64::consts::FRAC_PI_2))
        * t;
    let cos = s
        .mul_add(t.lit(-2.520_204_237_3e-5), t.lit(9.192_602_748_4e-4))
        .mul_add(s, t.lit(-2.086_348_076_3e-2))
        .mul_add(s, t.lit(2.536_695_079_0e-1))
        .mul_add(s, t.lit(-1.233_700_550_1))
        .mul_add(s, t.lit(1.0));
    (sin, cos)
}

/// The random frame of a lattice point, and the signs of its three gradients.
#[derive(Debug, Clone, Copy)]
pub struct LatticeFrame<L: Lane> {
    rows: [[L; 3]; 3],
    word: L::Word,
}

impl<L: Lane> LatticeFrame<L> {
    /// The frame that belongs to a hash; `like` says which kind of number.
    ///
    /// A uniformly distributed rotation from three numbers in [0, 1) (Shoemake 1992, *Uniform Random Rotations*), of
    /// eight bits each, and two signs: 2^26 rotations, which with the three signs of the gradients use 29 of the bits.
    #[inline(always)]
    pub fn new(like: L, word: L::Word) -> Self {
        let (one, two) = (like.lit(1.0), like.lit(2.0));
        let u = like.unit8(word);
        let (sin_a, cos_a) = sin_cos_quarter(like.unit8(word.shr(8)).mul_add(two, -one));
        let (sin_b, cos_b) = sin_cos_quarter(like.unit8(word.shr(16)).mul_add(two, -one));
        let (near, far) = ((one - u).sqrt(), u.sqrt());
        let x = near * sin_a;
        let y = (near * cos_a).negate_by_top_bit(word.shl(7));
        let z = far * sin_b;
        let w = (far * cos_b).negate_by_top_bit(word.shl(6));

        let (x2, y2, z2) = (x + x, y + y, z + z);
        let (xx, yy, zz) = (x * x2, y * y2, z * z2);
        let (xy, xz, yz) = (x * y2, x * z2, y * z2);
        let (wx, wy, wz) = (w * x2, w * y2, w * z2);
        let rows = [
            [one - (yy + zz), xy - wz, xz + wy],
            [xy + wz, one - (xx + zz), yz - wx],
            [xz - wy, yz + wx, one - (xx + yy)],
        ];
        Self { rows, word }
    }

    /// The gradients of two components after the turn, at right angles to each other at all times; the third is 0.
    #[inline(always)]
    pub fn pair(&self, spin: Spin<L>) -> [[L; 3]; 3] {
        let (a, b) = (self.rows[0], self.rows[1]);
        let signs = [self.word.shl(5), self.word.shl(4)];
        let (cos, sin) = (spin.cos.negate_by_top_bit(signs[0]), spin.sin.negate_by_top_bit(signs[0]));
        let (cos_across, sin_across) = (spin.cos.negate_by_top_bit(signs[1]), spin.sin.negate_by_top_bit(signs[1]));
        [
            triple!(i => cos.mul_add(a[i], sin * b[i])),
            triple!(i => cos_across.mul_add(b[i], -(sin_across * a[i]))),
            [spin.cos.lit(0.0); 3],
        ]
    }

    /// The gradients of the three components after the turn.
    #[inline(always)]
    pub fn gradients(&self, spin: Spin<L>) -> [[L; 3]; 3] {
        triple!(c => {
            // Bits 26 to 28, each moved to the top.
            let sign = self.word.shl(5 - c as u32);
            let cos = spin.cos.negate_by_top_bit(sign);
            let sin = spin.sin.negate_by_top_bit(sign);
            let (a, b) = (self.rows[c], self.rows[(c + 1) % 3]);
            triple!(i => cos.mul_add(a[i], sin * b[i]))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::mix;
    use crate::math::real::{dot, length};

    #[test]
    fn gradients_have_unit_length_and_stay_in_their_plane() {
        for i in 0..500u64 {
            let frame = LatticeFrame::new(1.0f64, mix(i) as u32);
            let start = frame.gradients(Spin::from_turns(0.0));
            let quarter = frame.gradients(Spin::from_turns(0.25));
            for turns in [0.1, 0.4, 0.77] {
                for (c, g) in frame.gradients(Spin::from_turns(turns)).into_iter().enumerate() {
                    assert!((length(g) - 1.0).abs() < 3e-5);
                    let angle = TAU * turns;
                    let cosine = dot(g, start[c]);
                    assert!((cosine - angle.cos()).abs() < 3e-5 && (dot(g, quarter[c]) - angle.sin()).abs() < 3e-5);
                }
            }
        }
    }

    #[test]
    fn gradients_are_isotropic_to_second_order() {
        let n = 200_000u64;
        let mut moment = [[[0.0f64; 3]; 3]; 3];
        for i in 0..n {
            let gradients = LatticeFrame::new(1.0f64, mix(i) as u32).gradients(Spin::from_turns(0.15));
            for c in 0..3 {
                for a in 0..3 {
                    for b in 0..3 {
                        moment[c][a][b] += gradients[c][a] * gradients[c][b] / n as f64;
                    }
                }
            }
        }
        for m in moment {
            for a in 0..3 {
                for b in 0..3 {
                    let expected = if a == b { 1.0 / 3.0 } else { 0.0 };
                    assert!((m[a][b] - expected).abs() < 4e-3, "{m:?}");
                }
            }
        }
    }

    #[test]
    fn advancing_equals_turning() {
        let start = Spin::from_turns(0.123);
        for i in -149..=149 {
            let turns = f64::from(i) / 100.0;
            let (a, b) = (Spin::advanced(start, turns), Spin::from_turns(2.123 + turns));
            assert!((a.cos - b.cos).abs() < 1e-5 && (a.sin - b.sin).abs() < 1e-5, "{turns}");
        }
    }
}
