//! Numbers that carry their gradient, as a lane: what the flow is differentiated with, to rounding, in tests.

use curlsmoke::math::real::{Lane, Real};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A value and its derivatives along x, y, z.
#[derive(Debug, Clone, Copy)]
pub struct Dual {
    /// The value.
    pub value: f64,
    /// Its derivatives.
    pub gradient: [f64; 3],
}

impl Dual {
    pub fn constant(value: f64) -> Self {
        Self { value, gradient: [0.0; 3] }
    }

    pub fn point(p: [f64; 3]) -> [Self; 3] {
        std::array::from_fn(|axis| {
            let mut x = Self::constant(p[axis]);
            x.gradient[axis] = 1.0;
            x
        })
    }

    fn chain(self, value: f64, slope: f64) -> Self {
        Self { value, gradient: self.gradient.map(|g| slope * g) }
    }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self { value: self.value + o.value, gradient: std::array::from_fn(|i| self.gradient[i] + o.gradient[i]) }
    }
}

impl Sub for Dual {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + -o
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

#[allow(clippy::suspicious_arithmetic_impl, reason = "the product rule")]
impl Mul for Dual {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self {
            value: self.value * o.value,
            gradient: std::array::from_fn(|i| self.value * o.gradient[i] + o.value * self.gradient[i]),
        }
    }
}

#[allow(clippy::suspicious_arithmetic_impl, reason = "the quotient rule")]
impl Div for Dual {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        self * o.chain(1.0 / o.value, -1.0 / (o.value * o.value))
    }
}

impl Real for Dual {
    fn lit(self, x: f64) -> Self {
        Self::constant(x)
    }
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, if root > 0.0 { 0.5 / root } else { 0.0 })
    }
    fn abs(self) -> Self {
        if self.value < 0.0 { -self } else { self }
    }
    fn min(self, other: Self) -> Self {
        if self.value < other.value { self } else { other }
    }
    fn max(self, other: Self) -> Self {
        if self.value > other.value { self } else { other }
    }
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    fn select_lt(self, bound: Self, then: Self, otherwise: Self) -> Self {
        if self.value < bound.value { then } else { otherwise }
    }
}

impl Lane for Dual {
    type Word = u32;
    const WIDTH: usize = 1;
    fn lane(self, _: usize) -> f64 {
        self.value
    }
    fn gather(self, mut f: impl FnMut(usize) -> f64) -> Self {
        Self::constant(f(0))
    }
    fn gather_four<'a>(self, mut f: impl FnMut(usize) -> &'a [f32]) -> [Self; 4] {
        let found = f(0);
        std::array::from_fn(|k| Self::constant(f64::from(found[k])))
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
        self.value < bound.value
    }
}
