//! Numbers that carry their first and second derivatives with respect to position, so that a distance written once
//! yields its exact gradient (the normal) and Hessian (how the normal turns), which the curl of a constrained
//! potential needs.
//!
//! Forward-mode differentiation by truncated Taylor arithmetic (Griewank and Walther 2008, *Evaluating Derivatives*,
//! chapter 13).

use crate::math::real::{Real, triple};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Value, gradient and Hessian of a scalar field at a point.
///
/// The Hessian is stored as xx, yy, zz, xy, xz, yz.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jet<R> {
    /// The value.
    pub value: R,
    /// First derivatives along x, y, z.
    pub gradient: [R; 3],
    /// Second derivatives xx, yy, zz, xy, xz, yz.
    pub hessian: [R; 6],
}

/// Value and gradient of a scalar field at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scalar<R> {
    /// The value.
    pub value: R,
    /// Its derivatives along x, y, z [1/m].
    pub gradient: [R; 3],
}

impl<R: Real> Scalar<R> {
    /// Sum.
    #[inline(always)]
    pub fn plus(&self, other: &Self) -> Self {
        Self { value: self.value + other.value, gradient: triple!(i => self.gradient[i] + other.gradient[i]) }
    }

    /// Difference.
    #[inline(always)]
    pub fn minus(&self, other: &Self) -> Self {
        Self { value: self.value - other.value, gradient: triple!(i => self.gradient[i] - other.gradient[i]) }
    }

    /// Product.
    #[inline(always)]
    pub fn times(&self, other: &Self) -> Self {
        let gradient = triple!(i => self.value.mul_add(other.gradient[i], other.value * self.gradient[i]));
        Self { value: self.value * other.value, gradient }
    }

    /// `then` where `x < bound`, `otherwise` elsewhere.
    #[inline(always)]
    pub fn select_lt(x: R, bound: R, then: Self, otherwise: Self) -> Self {
        Self {
            value: x.select_lt(bound, then.value, otherwise.value),
            gradient: triple!(i => x.select_lt(bound, then.gradient[i], otherwise.gradient[i])),
        }
    }
}

/// First and second index of each stored second derivative.
const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

/// As `triple!`, of six.
macro_rules! sextuple {
    ($k:ident => $e:expr) => {{
        let low = triple!($k => $e);
        let high = triple!(upper => {
            let $k = upper + 3;
            $e
        });
        [low[0], low[1], low[2], high[0], high[1], high[2]]
    }};
}

impl<R: Real> Jet<R> {
    /// A constant.
    #[inline(always)]
    pub fn constant(value: R) -> Self {
        let zero = value.lit(0.0);
        Self { value, gradient: [zero; 3], hessian: [zero; 6] }
    }

    /// The coordinate `axis` (0 = x) at the point where it is `value`.
    #[inline(always)]
    pub fn coordinate(value: R, axis: usize) -> Self {
        let mut jet = Self::constant(value);
        jet.gradient[axis] = value.lit(1.0);
        jet
    }

    /// The three coordinates of a point.
    #[inline(always)]
    pub fn point(p: [R; 3]) -> [Self; 3] {
        [Self::coordinate(p[0], 0), Self::coordinate(p[1], 1), Self::coordinate(p[2], 2)]
    }

    /// The field without its second derivatives.
    #[inline(always)]
    pub fn scalar(self) -> Scalar<R> {
        Scalar { value: self.value, gradient: self.gradient }
    }

    /// Second derivative along axes `i` and `j`.
    #[inline(always)]
    pub fn second(&self, i: usize, j: usize) -> R {
        if i == j { self.hessian[i] } else { self.hessian[2 + i + j] }
    }

    /// `f(self)` by the chain rule, given `f`, `f'` and `f''` at the value.
    #[inline(always)]
    pub fn chain(self, f: R, df: R, ddf: R) -> Self {
        let g = self.gradient;
        Self {
            value: f,
            gradient: triple!(i => df * g[i]),
            hessian: sextuple!(k => {
                let (i, j) = PAIRS[k];
                df.mul_add(self.hessian[k], ddf * g[i] * g[j])
            }),
        }
    }
}

impl<R: Real> Add for Jet<R> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self {
            value: self.value + other.value,
            gradient: triple!(i => self.gradient[i] + other.gradient[i]),
            hessian: sextuple!(k => self.hessian[k] + other.hessian[k]),
        }
    }
}

impl<R: Real> Sub for Jet<R> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self {
            value: self.value - other.value,
            gradient: triple!(i => self.gradient[i] - other.gradient[i]),
            hessian: sextuple!(k => self.hessian[k] - other.hessian[k]),
        }
    }
}

impl<R: Real> Neg for Jet<R> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self {
            value: -self.value,
            gradient: triple!(i => -self.gradient[i]),
            hessian: sextuple!(k => -self.hessian[k]),
        }
    }
}

impl<R: Real> Mul for Jet<R> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self {
            value: self.value * o.value,
            gradient: triple!(i => self.value.mul_add(o.gradient[i], o.value * self.gradient[i])),
            hessian: sextuple!(k => {
                let (i, j) = PAIRS[k];
                self.value * o.hessian[k]
                    + o.value * self.hessian[k]
                    + self.gradient[i] * o.gradient[j]
                    + self.gradient[j] * o.gradient[i]
            }),
        }
    }
}

impl<R: Real> Div for Jet<R> {
    type Output = Self;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        let inverse = o.value.lit(1.0) / o.value;
        let square = inverse * inverse;
        self * o.chain(inverse, -square, (square * inverse) * o.value.lit(2.0))
    }
}

impl<R: Real> Real for Jet<R> {
    #[inline(always)]
    fn lit(self, x: f64) -> Self {
        Self::constant(self.value.lit(x))
    }

    /// Where the value is zero the derivatives of the root do not exist; they come out large but finite.
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        let df = root.lit(0.5) / root.max(root.lit(1e-12));
        let ddf = -(df * df) / root.max(root.lit(1e-12));
        self.chain(root, df, ddf)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        let zero = self.lit(0.0);
        self.select_lt(zero, -self, self)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.select_lt(other, self, other)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.select_lt(other, other, self)
    }

    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }

    #[inline(always)]
    fn select_lt(self, bound: Self, then: Self, otherwise: Self) -> Self {
        let (a, b) = (self.value, bound.value);
        Self {
            value: a.select_lt(b, then.value, otherwise.value),
            gradient: triple!(i => a.select_lt(b, then.gradient[i], otherwise.gradient[i])),
            hessian: sextuple!(k => a.select_lt(b, then.hessian[k], otherwise.hessian[k])),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::real::length;

    /// sqrt(x²+y²+z²)·x / (1 + y²), by jets and by central differences.
    fn field<R: Real>(p: [R; 3]) -> R {
        length(p) * p[0] / (p[1].squared() + p[1].lit(1.0))
    }

    #[test]
    fn derivatives_equal_central_differences() {
        let p = [0.7f64, -0.4, 1.1];
        let jet = field(Jet::point(p));
        let h = 1e-5;
        let moved = |axis: usize, by: f64| {
            let mut q = p;
            q[axis] += by;
            q
        };
        for i in 0..3 {
            let difference = (field(moved(i, h)) - field(moved(i, -h))) / (2.0 * h);
            assert!((jet.gradient[i] - difference).abs() < 1e-8);
            for j in 0..3 {
                let up = field(Jet::point(moved(j, h))).gradient[i];
                let down = field(Jet::point(moved(j, -h))).gradient[i];
                assert!((jet.second(i, j) - (up - down) / (2.0 * h)).abs() < 1e-8, "{i}{j}");
            }
        }
    }
}
