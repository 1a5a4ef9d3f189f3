//! Smooth steps with their derivatives.

use crate::math::real::Real;

/// The quintic step `6t⁵ − 15t⁴ + 10t³` and its derivative, for `t` in [0, 1]: 0 to 1 with first and second
/// derivatives 0 at both ends (Perlin 2002, *Improving Noise*).
#[inline(always)]
pub fn quintic_step<R: Real>(t: R) -> (R, R) {
    let value = t * t * t * t.mul_add(t.mul_add(t.lit(6.0), t.lit(-15.0)), t.lit(10.0));
    let derivative = t * t * t.mul_add(t.mul_add(t.lit(30.0), t.lit(-60.0)), t.lit(30.0));
    (value, derivative)
}

/// The cubic step `t²(3 − 2t)` with `t` cut to [0, 1].
#[inline]
pub fn cubic_step(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_go_from_zero_to_one_with_the_stated_derivative() {
        assert_eq!(quintic_step(0.0f64), (0.0, 0.0));
        assert_eq!(quintic_step(1.0f64), (1.0, 0.0));
        assert_eq!((cubic_step(-1.0), cubic_step(0.5), cubic_step(2.0)), (0.0, 0.5, 1.0));
        for i in 1..20 {
            let (t, h) = (f64::from(i) / 20.0, 1e-6);
            let difference = (quintic_step(t + h).0 - quintic_step(t - h).0) / (2.0 * h);
            assert!((quintic_step(t).1 - difference).abs() < 1e-8);
        }
    }
}
