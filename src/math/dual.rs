//! Numbers that carry their gradient: whatever is written for lanes is differentiated by evaluating it with these.

use crate::math::real::{Lane, Real, triple};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A value and its derivatives along x, y, z; exact to the rounding of `L`.
#[derive(Debug, Clone, Copy)]
pub struct Dual<L> {
    /// The value.
    pub value: L,
    /// Its derivatives.
    pub gradient: [L; 3],
}

impl<L: Real> Dual<L> {
    /// A number that is the same everywhere.
    #[inline(always)]
    pub fn constant(value: L) -> Self {
        Self { value, gradient: [value.lit(0.0); 3] }
    }

    /// The coordinates of a point, with respect to which derivatives are taken.
    #[inline(always)]
    pub fn point(p: [L; 3]) -> [Self; 3] {
        triple!(a => Self { value: p[a], gradient: triple!(i => p[a].lit(if i == a { 1.0 } else { 0.0 })) })
    }

    #[inline(always)]
    fn chain(self, value: L, slope: L) -> Self {
        Self { value, gradient: triple!(i => slope * self.gradient[i]) }
    }
}

impl<L: Real> Add for Dual<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self { value: self.value + o.value, gradient: triple!(i => self.gradient[i] + o.gradient[i]) }
    }
}

impl<L: Real> Sub for Dual<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self { value: self.value - o.value, gradient: triple!(i => self.gradient[i] - o.gradient[i]) }
    }
}

impl<L: Real> Neg for Dual<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { value: -self.value, gradient: triple!(i => -self.gradient[i]) }
    }
}

#[allow(clippy::suspicious_arithmetic_impl, reason = "the product rule")]
impl<L: Real> Mul for Dual<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self {
            value: self.value * o.value,
            gradient: triple!(i => self.value.mul_add(o.gradient[i], o.value * self.gradient[i])),
        }
    }
}

#[allow(clippy::suspicious_arithmetic_impl, reason = "the quotient rule")]
impl<L: Real> Div for Dual<L> {
    type Output = Self;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        let inverse = o.value.lit(1.0) / o.value;
        let value = self.value * inverse;
        Self { value, gradient: triple!(i => (self.gradient[i] - value * o.gradient[i]) * inverse) }
    }
}

impl<L: Real> Real for Dual<L> {
    #[inline(always)]
    fn lit(self, x: f64) -> Self {
        Self::constant(self.value.lit(x))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let (root, zero) = (self.value.sqrt(), self.value.lit(0.0));
        // At 0 there is no derivative, and most who come there multiply by 0.
        self.chain(root, zero.select_lt(root, root.lit(0.5) / root, zero))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.select_lt(self.lit(0.0), -self, self)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.select_lt(other, self, other)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        other.select_lt(self, self, other)
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        Self {
            value: self.value.mul_add(a.value, b.value),
            gradient: triple!(i => {
                self.value.mul_add(a.gradient[i], a.value.mul_add(self.gradient[i], b.gradient[i]))
            }),
        }
    }
    #[inline(always)]
    fn select_lt(self, bound: Self, then: Self, otherwise: Self) -> Self {
        let (a, b) = (self.value, bound.value);
        Self {
            value: a.select_lt(b, then.value, otherwise.value),
            gradient: triple!(i => a.select_lt(b, then.gradient[i], otherwise.gradient[i])),
        }
    }
}

impl<L: Lane> Lane for Dual<L> {
    type Word = L::Word;
    const WIDTH: usize = L::WIDTH;
    #[inline(always)]
    fn lane(self, i: usize) -> f64 {
        self.value.lane(i)
    }
    #[inline(always)]
    fn gather(self, f: impl FnMut(usize) -> f64) -> Self {
        Self::constant(self.value.gather(f))
    }
    #[inline(always)]
    fn gather_four<'a>(self, f: impl FnMut(usize) -> &'a [f32]) -> [Self; 4] {
        let [a, b, c, d] = self.value.gather_four(f);
        [Self::constant(a), Self::constant(b), Self::constant(c), Self::constant(d)]
    }
    #[inline(always)]
    fn floor(self) -> Self {
        Self::constant(self.value.floor())
    }
    #[inline(always)]
    fn to_word(self) -> L::Word {
        self.value.to_word()
    }
    #[inline(always)]
    fn unit8(self, word: L::Word) -> Self {
        Self::constant(self.value.unit8(word))
    }
    #[inline(always)]
    fn negate_by_top_bit(self, word: L::Word) -> Self {
        Self {
            value: self.value.negate_by_top_bit(word),
            gradient: triple!(i => self.gradient[i].negate_by_top_bit(word)),
        }
    }
    #[inline(always)]
    fn any_lt(self, bound: Self) -> bool {
        self.value.any_lt(bound.value)
    }
    #[inline(always)]
    fn outlined<R>(self, f: impl FnOnce() -> R) -> R {
        self.value.outlined(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Everything that a lane can do with a smooth result.
    fn formula<L: Lane>([x, y, z]: [L; 3]) -> L {
        let root = (x * x + y.mul_add(y, z * z)).sqrt();
        let ratio = (x - y) / (root + x.lit(1.5));
        ratio.min(z * z).max(-root) + y.abs().select_lt(x, x * y, -z) - z.floor() * x
    }

    #[test]
    fn derivatives_are_those_of_differences_in_both_precisions_and_twice_over() {
        // Not at 0, where the formula has kinks.
        for i in 1..200 {
            let t = f64::from(i);
            let p = [(0.7 * t).sin(), (1.3 * t).cos(), (0.37 * t).sin() * 2.0];
            let exact = formula(Dual::point(p));
            let single = formula(Dual::point(p.map(|x| x as f32)));
            let twice = formula(Dual::point(Dual::point(p)));
            assert!((exact.value - formula(p)).abs() < 1e-14 && twice.value.value == exact.value);
            let h = 1e-6;
            for a in 0..3 {
                let moved = |by: f64| std::array::from_fn(|i| if i == a { p[i] + by } else { p[i] });
                let difference = (formula(moved(h)) - formula(moved(-h))) / (2.0 * h);
                assert!((exact.gradient[a] - difference).abs() < 1e-5, "{p:?} {a}: {exact:?} {difference}");
                assert!((f64::from(single.gradient[a]) - exact.gradient[a]).abs() < 1e-4);
                for b in 0..3 {
                    let second = (formula(Dual::point(moved(h))).gradient[b]
                        - formula(Dual::point(moved(-h))).gradient[b])
                        / (2.0 * h);
                    assert!((twice.gradient[a].gradient[b] - second).abs() < 1e-4, "{p:?} {a} {b}");
                }
            }
        }
    }
}
