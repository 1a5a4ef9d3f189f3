//! Numbers along a ray, with their derivatives: the slope of a distance comes of its formula.

use crate::math::real::Real;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number and its derivative along the ray.
#[derive(Debug, Clone, Copy)]
pub struct Along {
    /// The number.
    pub value: f64,
    /// Its derivative.
    pub slope: f64,
}

impl Along {
    /// A number that changes by `slope` in a metre.
    #[inline(always)]
    pub fn new(value: f64, slope: f64) -> Self {
        Self { value, slope }
    }
}

impl Add for Along {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self::new(self.value + o.value, self.slope + o.slope)
    }
}

impl Sub for Along {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self::new(self.value - o.value, self.slope - o.slope)
    }
}

impl Neg for Along {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::new(-self.value, -self.slope)
    }
}

impl Mul for Along {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        // The product rule.
        #[allow(clippy::suspicious_arithmetic_impl)]
        Self::new(self.value * o.value, self.value * o.slope + self.slope * o.value)
    }
}

impl Div for Along {
    type Output = Self;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        let quotient = self.value / o.value;
        #[allow(clippy::suspicious_arithmetic_impl)]
        Self::new(quotient, (self.slope - quotient * o.slope) / o.value)
    }
}

impl Real for Along {
    #[inline(always)]
    fn lit(self, x: f64) -> Self {
        Self::new(x, 0.0)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        // Where the root is 0 there is no slope; a falling one keeps the march going.
        Self::new(root, if root > 0.0 { 0.5 * self.slope / root } else { 0.0 })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        if self.value < 0.0 { -self } else { self }
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        if self.value < o.value { self } else { o }
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        if self.value > o.value { self } else { o }
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    #[inline(always)]
    fn select_lt(self, bound: Self, then: Self, otherwise: Self) -> Self {
        if self.value < bound.value { then } else { otherwise }
    }
}
