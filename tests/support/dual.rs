//! What the flow is differentiated with, to rounding.

use curlsmoke::math::dual::Dual;
use curlsmoke::math::real::Lane;

/// Divergence of a velocity with its derivatives, and the square of the length of its Jacobian.
pub fn divergence<T: Lane>(v: [Dual<T>; 3]) -> (f64, f64) {
    let j = v.map(|x| x.gradient.map(|g| g.lane(0)));
    (j[0][0] + j[1][1] + j[2][2], j.iter().flatten().map(|x| x * x).sum())
}
