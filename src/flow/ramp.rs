//! The boundary ramp and its application to a potential (curl-noise-2007, eq. 4 and 5).

use crate::flow::potential::Psi;
use crate::math::interpolate::quintic_step;
use crate::math::jet::{Jet, Scalar};
use crate::math::real::{Real, dot, triple};

/// Equation 4, `15/8 r − 10/8 r³ + 3/8 r⁵`, and its derivative, for `r` cut to [−1, 1]: odd, 0 at the wall, ±1 with
/// first and second derivatives 0 at the ends.
#[inline(always)]
pub fn ramp<L: Real>(r: L) -> (L, L) {
    let one = r.lit(1.0);
    let r = r.clamp(-one, one);
    let s = r * r;
    let value = r * s.mul_add(s.mul_add(r.lit(0.375), r.lit(-1.25)), r.lit(1.875));
    let free = one - s;
    (value, r.lit(1.875) * free * free)
}

/// A ramp for walls that hold the flow fast, and its derivative: 0 at the wall and behind it, 1 from r = 1 on, with first
/// and second derivatives 0 at both ends.
#[inline(always)]
pub fn flat_ramp<L: Real>(r: L) -> (L, L) {
    quintic_step(r.clamp(r.lit(0.0), r.lit(1.0)))
}

/// A smooth minimum of two positive numbers, and its derivatives with respect to both.
///
/// `a + b − √(a² + b²)`, Rvachev's conjunction: never above the smaller one, zero exactly where one of them is,
/// negative where one of them is, infinitely differentiable but at a = b = 0. Written without cancellation.
#[inline(always)]
pub fn smooth_min<L: Real>(a: L, b: L) -> (L, L, L) {
    let tiny = a.lit(1e-30);
    let root = a.mul_add(a, b * b).max(tiny).sqrt();
    let sum = a + b + root;
    // For a + b < 0 the sum may vanish; there the difference has no cancellation.
    let direct = a + b - root;
    let value = (a + b).select_lt(a.lit(0.0), direct, (a + a) * b / sum.max(tiny));
    let one = a.lit(1.0);
    (value, one - a / root, one - b / root)
}

/// How a wall stands to a point.
#[derive(Debug, Clone, Copy)]
pub struct WallRamp<L> {
    /// The ramp α: 0 on the wall, 1 where it has no influence.
    pub alpha: Scalar<L>,
    /// `None` where the wall's normal is not smooth and equation 3 takes the place of equation 5.
    pub normal: Option<UnitNormal<L>>,
}

/// A wall's unit normal, and `[c][i]`, the derivative of its component c along axis i [1/m].
pub type UnitNormal<L> = ([L; 3], [[L; 3]; 3]);

/// The unit vector along the gradient of a distance, with its derivatives.
///
/// Its curl is perpendicular to it whatever the length of the gradient, so that equation 5 is as tangential for
/// a sampled distance, which is no exact distance, as for an exact one.
#[inline(always)]
pub fn unit_normal<L: Real>(distance: &Jet<L>) -> UnitNormal<L> {
    let gradient = distance.gradient;
    let [xx, yy, zz, xy, xz, yz] = distance.hessian;
    let second = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let one = gradient[0].lit(1.0);
    let inverse = one / dot(gradient, gradient).max(one.lit(1e-20)).sqrt();
    let n = triple!(i => gradient[i] * inverse);
    let along: [L; 3] = triple!(j => n[0].mul_add(second[0][j], n[1].mul_add(second[1][j], n[2] * second[2][j])));
    let derivatives = triple!(c => triple!(j => (second[c][j] - n[c] * along[j]) * inverse));
    (n, derivatives)
}

/// What equation 5 takes away: `(1 − α)·P(ψ − g)`, with P the projection on the wall's tangent plane, or the identity
/// where the wall has no smooth normal (eq. 3). `excess` is ψ − g.
///
/// Whatever `g` is, the flow of what remains is that of `g` on the wall but for something tangential: so `g` must be
/// constant in space, or have a curl that is tangential there.
#[inline(always)]
pub fn removed<L: Real>(excess: &Psi<L>, wall: &WallRamp<L>) -> Psi<L> {
    let one = wall.alpha.value.lit(1.0);
    let weight = Scalar { value: one - wall.alpha.value, gradient: triple!(i => -wall.alpha.gradient[i]) };
    match wall.normal {
        None => excess.modulated(&weight),
        Some((n, dn)) => {
            let s = dot(n, excess.value);
            let ds: [L; 3] = triple!(j => {
                let mut sum = dn[0][j] * excess.value[0];
                for c in 0..3 {
                    sum = n[c].mul_add(excess.jacobian[c][j], sum);
                    if c > 0 {
                        sum = dn[c][j].mul_add(excess.value[c], sum);
                    }
                }
                sum
            });
            let tangential = Psi {
                value: triple!(c => excess.value[c] - s * n[c]),
                jacobian: triple!(c => {
                    triple!(j => excess.jacobian[c][j] - ds[j] * n[c] - s * dn[c][j])
                }),
            };
            tangential.modulated(&weight)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::curl::curl;
    use crate::flow::potential::uniform;
    use crate::math::real::length;

    #[test]
    fn the_ramp_and_its_first_two_derivatives_meet_the_ends() {
        assert_eq!(ramp(0.0f64), (0.0, 1.875));
        assert_eq!(ramp(1.0f64), (1.0, 0.0));
        assert_eq!(ramp(7.0f64), (1.0, 0.0));
        assert_eq!(ramp(-2.0f64), (-1.0, 0.0));
        let h = 1e-6;
        for i in -9..=9 {
            let r = f64::from(i) / 10.0;
            assert!(((ramp(r + h).0 - ramp(r - h).0) / (2.0 * h) - ramp(r).1).abs() < 1e-8);
        }
        assert!((ramp(1.0 - h).1 / h).abs() < 1e-4, "second derivative");
    }

    #[test]
    fn the_smooth_minimum_is_below_both_and_has_the_stated_derivatives() {
        let h = 1e-6;
        for (a, b) in [(1.0f64, 2.0), (0.1, 30.0), (5.0, 5.0), (0.0, 1.0), (2.0, -0.5), (-1.0, -2.0)] {
            let (value, da, db) = smooth_min(a, b);
            assert!(value <= a.min(b) + 1e-12, "{a} {b}: {value}");
            assert!(((smooth_min(a + h, b).0 - smooth_min(a - h, b).0) / (2.0 * h) - da).abs() < 1e-5);
            assert!(((smooth_min(a, b + h).0 - smooth_min(a, b - h).0) / (2.0 * h) - db).abs() < 1e-5);
        }
    }

    #[test]
    fn equation_five_is_tangential_even_for_a_function_that_is_no_distance() {
        // An ellipsoid by a quadratic form: |∇f| differs from point to point.
        let f = |p: [f64; 3]| {
            let [x, y, z] = Jet::point(p);
            x * x + y * y * y.lit(4.0) + z * z * z.lit(9.0) - x.lit(1.0)
        };
        for i in 0..100 {
            let (a, b) = (f64::from(i) * 0.7, f64::from(i) * 0.31 - 1.5);
            let p = [b.cos() * a.cos(), b.cos() * a.sin() / 2.0, b.sin() / 3.0];
            let jet = f(p);
            let normal = unit_normal(&jet);
            let (alpha, slope) = ramp(jet.value / 0.4);
            let alpha = Scalar { value: alpha, gradient: jet.gradient.map(|x| x * slope / 0.4) };
            let psi = uniform([1.0, -2.0, 0.7], [3.0, 1.0, 2.0], p);
            for normal in [Some(normal), None] {
                let v = curl(&psi.minus(&removed(&psi, &WallRamp { alpha, normal })));
                let n = jet.gradient.map(|x| x / length(jet.gradient));
                assert!(dot(v, n).abs() < 1e-12 * length(v).max(1.0), "{}", dot(v, n));
            }
        }
    }
}
