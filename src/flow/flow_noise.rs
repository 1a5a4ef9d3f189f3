//! Gradients that turn in time (Perlin and Neyret 2001, *Flow Noise*): swirls that live in place.
//!
//! Each lattice point has a random orthonormal frame, whose axes are the gradients of the three components. The gradients
//! of the first two components turn about the third axis, the third gradient turns in a plane through itself, all of a
//! point one way or the other. A random start angle would add nothing: the frame's orientation is random already. So the angle is the same for
//! all points of an octave, and every instant has the statistics of every other.
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
/// All lanes and the scalar evaluate the same polynomial.
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

/// Sine and cosine of the middle angle: √(2/3) and √(1/3).
const MIDDLE: [f64; 2] = [0.816_496_580_927_726, 0.577_350_269_189_625_8];

/// Mean of the cosines of a sixteenth and of three sixteenths of a turn, and half their difference.
const SIXTEENTHS: [f64; 2] = [0.653_281_482_438_188_3, 0.270_598_050_073_098_5];

/// The random orthonormal frame of a lattice point, by its angles of Euler, and which way its gradients turn.
///
/// The first and last angle are odd multiples of a sixteenth of a turn, the cosine of the middle one is ±1/√3: 128 frames
/// whose axes are isotropic to second order and uncorrelated. As with the twelve gradients of Perlin 2002 few
/// directions do, and these cost no more than some signs.
#[derive(Debug, Clone, Copy)]
pub struct LatticeFrame<L: Lane> {
    /// Cosine and sine of the first angle.
    first: [L; 2],
    /// Cosine and sine of the last angle.
    last: [L; 2],
    /// Cosine of the middle angle.
    middle: L,
    word: L::Word,
}

impl<L: Lane> LatticeFrame<L> {
    /// The frame that a hash says; `like` says which kind of number.
    #[inline(always)]
    pub fn new(like: L, hash: L::Word) -> Self {
        // Bits 8 to 15, into which the hash has mixed the upper ones last.
        let word = hash.shl(16);
        Self {
            first: odd_sixteenth(like, word, word.shl(1), word.shl(2)),
            last: odd_sixteenth(like, word.shl(3), word.shl(4), word.shl(5)),
            middle: like.lit(MIDDLE[1]).negate_by_top_bit(word.shl(6)),
            word: word.shl(7),
        }
    }

    /// The gradients of two components after the turn, at right angles to each other at all times; the third is 0.
    #[inline(always)]
    pub fn pair(&self, spin: Spin<L>) -> [[L; 3]; 3] {
        let [c, s] = self.last;
        let (u, v) = (self.middle * c, self.middle * s);
        // The turn adds to the first angle, or goes the other way: else one component would follow the other.
        let turned = spin.sin.negate_by_top_bit(self.word);
        let cos = self.first[0].mul_add(spin.cos, -(self.first[1] * turned));
        let sin = self.first[1].mul_add(spin.cos, self.first[0] * turned);
        let across = cos.lit(MIDDLE[0]);
        [
            [cos.mul_add(u, -(sin * s)), -cos.mul_add(v, sin * c), cos * across],
            [sin.mul_add(u, cos * s), cos.mul_add(c, -(sin * v)), sin * across],
            [cos.lit(0.0); 3],
        ]
    }

    /// The gradients of the three components after the turn.
    #[inline(always)]
    pub fn gradients(&self, spin: Spin<L>) -> [[L; 3]; 3] {
        let [c, s] = self.last;
        let across = c.lit(MIDDLE[0]);
        let (u, v) = (self.middle * c, self.middle * s);
        let third = [-(across * c), across * s, self.middle];
        // At right angles to the third, half way between its meridian and its parallel: so it is isotropic too.
        let aside = [s - u, v + c, -across];
        let sin = (spin.sin * c.lit(std::f64::consts::FRAC_1_SQRT_2)).negate_by_top_bit(self.word);
        let [first, second, _] = self.pair(spin);
        [first, second, triple!(i => sin.mul_add(aside[i], spin.cos * third[i]))]
    }
}

/// Cosine and sine of an odd multiple of a sixteenth of a turn, by the highest bits of three words.
#[inline(always)]
fn odd_sixteenth<L: Lane>(like: L, swap: L::Word, sign: L::Word, other: L::Word) -> [L; 2] {
    let mean = like.lit(SIXTEENTHS[0]);
    let half = like.lit(SIXTEENTHS[1]).negate_by_top_bit(swap);
    [(mean + half).negate_by_top_bit(sign), (mean - half).negate_by_top_bit(other)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::real::{dot, length};

    /// Each frame, and each way of turning.
    fn frames() -> impl Iterator<Item = LatticeFrame<f64>> {
        (0..256u32).map(|i| LatticeFrame::new(1.0, i << 8))
    }

    #[test]
    fn gradients_have_unit_length_stay_in_their_plane_and_pairs_are_at_right_angles() {
        for frame in frames() {
            let start = frame.gradients(Spin::from_turns(0.0));
            let quarter = frame.gradients(Spin::from_turns(0.25));
            for c in 0..3 {
                assert!(dot(start[c], start[(c + 1) % 3]).abs() < 1e-14);
            }
            for turns in [0.1, 0.4, 0.77] {
                let spin = Spin::from_turns(turns);
                let (now, pair, angle) = (frame.gradients(spin), frame.pair(spin), TAU * turns);
                assert!(dot(pair[0], pair[1]).abs() < 1e-14 && pair[..2] == now[..2]);
                for (c, g) in now.into_iter().enumerate() {
                    assert!((length(g) - 1.0).abs() < 1e-14);
                    assert!((dot(g, start[c]) - angle.cos()).abs() < 1e-14);
                    assert!((dot(g, quarter[c]) - angle.sin()).abs() < 1e-14);
                }
            }
        }
    }

    #[test]
    #[allow(clippy::needless_range_loop, reason = "a tensor")]
    fn gradients_are_isotropic_and_uncorrelated_to_second_order_at_all_times_and_between_any_two() {
        for (earlier, later) in [(0.0, 0.0), (0.15, 0.15), (0.4, 0.4), (0.0, 0.25), (0.3, 0.37)] {
            let mut moment = [[[[0.0f64; 3]; 3]; 3]; 3];
            for frame in frames() {
                let [p, q] = [earlier, later].map(|t| frame.gradients(Spin::from_turns(t)));
                for c in 0..3 {
                    for d in 0..3 {
                        for a in 0..3 {
                            for b in 0..3 {
                                moment[c][d][a][b] += p[c][a] * q[d][b] / 256.0;
                            }
                        }
                    }
                }
            }
            for c in 0..3 {
                for d in 0..3 {
                    for a in 0..3 {
                        for b in 0..3 {
                            let is_same = c == d && a == b;
                            let expected = if is_same { (TAU * (later - earlier)).cos() / 3.0 } else { 0.0 };
                            assert!((moment[c][d][a][b] - expected).abs() < 1e-14, "{c} {d} {a} {b} {earlier} {later}");
                        }
                    }
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
