//! Numbers that carry their gradient, as a lane: what the flow is differentiated with, to rounding, in tests.

#![allow(dead_code, reason = "each test program uses a part")]

use curlsmoke::math::real::{Lane, Real};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A value and its derivatives along x, y, z, in the precision of `T`.
#[derive(Debug, Clone, Copy)]
pub struct Dual<T> {
    /// The value.
    pub value: T,
    /// Its derivatives.
    pub gradient: [T; 3],
}

impl<T: Lane> Dual<T> {
    pub fn constant(value: T) -> Self {
        Self { value, gradient: [value.lit(0.0); 3] }
    }

    pub fn point(p: [T; 3]) -> [Self; 3] {
        std::array::from_fn(|axis| {
            let mut x = Self::constant(p[axis]);
            x.gradient[axis] = p[axis].lit(1.0);
            x
        })
    }

    fn chain(self, value: T, slope: T) -> Self {
        Self { value, gradient: self.gradient.map(|g| slope * g) }
    }
}

/// Divergence of a velocity with its derivatives, and the square of the length of its Jacobian.
pub fn divergence<T: Lane>(v: [Dual<T>; 3]) -> (f64, f64) {
    let j = v.map(|x| x.gradient.map(|g| g.lane(0)));
    (j[0][0] + j[1][1] + j[2][2], j.iter().flatten().map(|x| x * x).sum())
}

impl<T: Lane> Add for Dual<T> {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self { value: self.value + o.value, gradient: std::array::from_fn(|i| self.gradient[i] + o.gradient[i]) }
    }
}

impl<T: Lane> Sub for Dual<T> {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + -o
    }
}

impl<T: Lane> Neg for Dual<T> {
    type Output = Self;
    fn neg(self) -> Self {
        self.chain(-self.value, -self.value.lit(1.0))
    }
}

#[allow(clippy::suspicious_arithmetic_impl, reason = "the product rule")]
impl<T: Lane> Mul for Dual<T> {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self {
            value: self.value * o.value,
            gradient: std::array::from_fn(|i| self.value * o.gradient[i] + o.value * self.gradient[i]),
        }
    }
}

#[allow(clippy::suspicious_arithmetic_impl, reason = "the quotient rule")]
impl<T: Lane> Div for Dual<T> {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        let inverse = o.value.lit(1.0) / o.value;
        self * o.chain(inverse, -inverse * inverse)
    }
}

impl<T: Lane> Real for Dual<T> {
    fn lit(self, x: f64) -> Self {
        Self::constant(self.value.lit(x))
    }
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, if root.lane(0) > 0.0 { root.lit(0.5) / root } else { root.lit(0.0) })
    }
    fn abs(self) -> Self {
        if self.value.lane(0) < 0.0 { -self } else { self }
    }
    fn min(self, other: Self) -> Self {
        if self.value.lane(0) < other.value.lane(0) { self } else { other }
    }
    fn max(self, other: Self) -> Self {
        if self.value.lane(0) > other.value.lane(0) { self } else { other }
    }
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    fn select_lt(self, bound: Self, then: Self, otherwise: Self) -> Self {
        if self.value.lane(0) < bound.value.lane(0) { then } else { otherwise }
    }
}

impl<T: Lane<Word = u32>> Lane for Dual<T> {
    type Word = u32;
    const WIDTH: usize = 1;
    fn lane(self, _: usize) -> f64 {
        self.value.lane(0)
    }
    fn gather(self, f: impl FnMut(usize) -> f64) -> Self {
        Self::constant(self.value.gather(f))
    }
    fn gather_four<'a>(self, f: impl FnMut(usize) -> &'a [f32]) -> [Self; 4] {
        self.value.gather_four(f).map(Self::constant)
    }
    fn floor(self) -> Self {
        Self::constant(self.value.floor())
    }
    fn to_word(self) -> u32 {
        self.value.to_word()
    }
    fn unit8(self, word: u32) -> Self {
        Self::constant(self.value.unit8(word))
    }
    fn negate_by_top_bit(self, word: u32) -> Self {
        if word >> 31 == 1 { -self } else { self }
    }
    fn any_lt(self, bound: Self) -> bool {
        self.value.any_lt(bound.value)
    }
}
