//! Potentials with their Jacobians, and how they combine. A velocity is always the curl of what comes out, so whatever
//! is combined here stays free of divergence.

use crate::math::jet::Scalar;
use crate::math::real::{Real, cross, dot, triple};

/// A vector potential at a point: its value [m²/s] and `jacobian[c][i]`, the derivative of component c along axis i
/// [m/s].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Psi<L> {
    /// The potential [m²/s].
    pub value: [L; 3],
    /// Row c holds the gradient of component c [m/s].
    pub jacobian: [[L; 3]; 3],
}

impl<L: Real> Psi<L> {
    /// Zero everywhere; `like` says which kind of number.
    #[inline(always)]
    pub fn zero(like: L) -> Self {
        let zero = like.lit(0.0);
        Self { value: [zero; 3], jacobian: [[zero; 3]; 3] }
    }

    /// Both potentials at once: their velocities add up.
    #[inline(always)]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            value: triple!(c => self.value[c] + other.value[c]),
            jacobian: triple!(c => triple!(i => self.jacobian[c][i] + other.jacobian[c][i])),
        }
    }

    /// This potential without the other.
    #[inline(always)]
    pub fn minus(&self, other: &Self) -> Self {
        Self {
            value: triple!(c => self.value[c] - other.value[c]),
            jacobian: triple!(c => triple!(i => self.jacobian[c][i] - other.jacobian[c][i])),
        }
    }

    /// Times a constant.
    #[inline(always)]
    pub fn scaled(&self, factor: L) -> Self {
        Self {
            value: triple!(c => factor * self.value[c]),
            jacobian: triple!(c => triple!(i => factor * self.jacobian[c][i])),
        }
    }

    /// Its part along a direction `n` of length 1, where neither changes along `n`: a stream function.
    #[inline(always)]
    pub fn along(&self, n: [L; 3]) -> Self {
        let value = dot(self.value, n);
        let gradient: [L; 3] = triple!(i => dot([self.jacobian[0][i], self.jacobian[1][i], self.jacobian[2][i]], n));
        let across = dot(gradient, n);
        Self {
            value: triple!(c => value * n[c]),
            jacobian: triple!(c => triple!(i => (gradient[i] - across * n[i]) * n[c])),
        }
    }

    /// Times a scalar field, by the product rule: the velocity fades without a source (curl-noise-2007, 2.3).
    #[inline(always)]
    pub fn modulated(&self, field: &Scalar<L>) -> Self {
        Self {
            value: triple!(c => field.value * self.value[c]),
            jacobian: triple!(c => {
                triple!(i => field.value.mul_add(self.jacobian[c][i], field.gradient[i] * self.value[c]))
            }),
        }
    }
}

/// The point of the plane through the origin across `normal` (length 1) that is below or above `p`.
#[inline(always)]
pub fn flattened<R: Real>(normal: [R; 3], p: [R; 3]) -> [R; 3] {
    let height = dot(normal, p);
    triple!(i => p[i] - height * normal[i])
}

/// The potential `½ V × (x − x0)` of a constant velocity V [m/s].
///
/// Curl-noise-2007 prints it without the ½ in equation 6, which would double the velocity: curl(V × x) = 2V.
#[inline(always)]
pub fn uniform<L: Real>(velocity: [L; 3], origin: [L; 3], p: [L; 3]) -> Psi<L> {
    let half = triple!(i => p[0].lit(0.5) * velocity[i]);
    let zero = p[0].lit(0.0);
    Psi {
        value: cross(half, triple!(i => p[i] - origin[i])),
        jacobian: [[zero, -half[2], half[1]], [half[2], zero, -half[0]], [-half[1], half[0], zero]],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::curl::{central_jacobian, curl};

    #[test]
    fn the_curl_of_the_uniform_potential_is_the_velocity() {
        let v = [0.3, -0.8, 1.7];
        let psi = uniform(v, [0.1, 0.2, 0.3], [4.0f64, -5.0, 6.0]);
        for (a, b) in curl(&psi).into_iter().zip(v) {
            assert!((a - b).abs() < 1e-15);
        }
    }

    #[test]
    fn modulation_follows_the_product_rule() {
        let field = |p: [f64; 3]| {
            let value = p[0] * p[1] + p[2] * p[2];
            Scalar { value, gradient: [p[1], p[0], 2.0 * p[2]] }
        };
        let modulated = |p| uniform([1.0, 2.0, 3.0], [0.0; 3], p).modulated(&field(p));
        let p = [0.3, -0.7, 1.1];
        let difference = central_jacobian(|q| modulated(q).value, p, 1e-5);
        for (a, b) in modulated(p).jacobian.iter().flatten().zip(difference.iter().flatten()) {
            assert!((a - b).abs() < 1e-9);
        }
    }
}
