//! The curl (curl-noise-2007, eq. 1) from an analytic Jacobian. Finite differences are here as the tests' oracle only.

use crate::flow::potential::Psi;
use crate::math::real::Real;

/// The velocity of a potential [m/s].
#[inline(always)]
pub fn curl<L: Real>(psi: &Psi<L>) -> [L; 3] {
    let j = &psi.jacobian;
    [j[2][1] - j[1][2], j[0][2] - j[2][0], j[1][0] - j[0][1]]
}

/// `[c][i]`: derivative of component c of `f` along axis i by central differences of step `h`: a test oracle.
pub fn central_jacobian(f: impl Fn([f64; 3]) -> [f64; 3], p: [f64; 3], h: f64) -> [[f64; 3]; 3] {
    let mut jacobian = [[0.0; 3]; 3];
    for axis in 0..3 {
        let moved = |by: f64| {
            let mut q = p;
            q[axis] += by;
            f(q)
        };
        // Fourth order: the error h⁴ leaves room for a step at which rounding does not matter.
        let (a, b, c, d) = (moved(-2.0 * h), moved(-h), moved(h), moved(2.0 * h));
        for k in 0..3 {
            jacobian[k][axis] = (a[k] - 8.0 * b[k] + 8.0 * c[k] - d[k]) / (12.0 * h);
        }
    }
    jacobian
}
