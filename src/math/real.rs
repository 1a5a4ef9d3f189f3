//! What the formulas of geometry and flow ask of a number, so that each is written once and evaluated on scalars, on
//! SIMD lanes and on jets (values that carry their derivatives).

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number, or several numbers side by side, that the field operations act on.
///
/// There is no free-standing constant: SIMD numbers can only be made where the processor's features are known, so a
/// constant is made from a number at hand with [`Real::lit`].
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// The constant `x`, of the same kind as `self`.
    fn lit(self, x: f64) -> Self;
    /// The non-negative square root of a non-negative number.
    fn sqrt(self) -> Self;
    /// The absolute value.
    fn abs(self) -> Self;
    /// The smaller one.
    fn min(self, other: Self) -> Self;
    /// The larger one.
    fn max(self, other: Self) -> Self;
    /// `self · a + b`, with one rounding where the hardware has it.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// `then` where `self < bound`, `otherwise` elsewhere.
    fn select_lt(self, bound: Self, then: Self, otherwise: Self) -> Self;
    /// `self` cut to `[low, high]`.
    #[inline(always)]
    fn clamp(self, low: Self, high: Self) -> Self {
        self.max(low).min(high)
    }
    /// `self²`.
    #[inline(always)]
    fn squared(self) -> Self {
        self * self
    }
}

/// The 32-bit words that go with a [`Lane`], for hashing: all operations are modulo 2^32.
pub trait Word: Copy {
    /// The constant `x`, of the same kind as `self`.
    fn lit(self, x: u32) -> Self;
    /// Sum.
    fn add(self, other: Self) -> Self;
    /// Product.
    fn mul(self, other: Self) -> Self;
    /// Exclusive or.
    fn xor(self, other: Self) -> Self;
    /// Bitwise and.
    fn and(self, other: Self) -> Self;
    /// Shifted to the left by `bits`, below 32.
    fn shl(self, bits: u32) -> Self;
    /// Shifted to the right by `bits`, below 32, zeros coming in.
    fn shr(self, bits: u32) -> Self;
}

impl Word for u32 {
    #[inline(always)]
    fn lit(self, x: u32) -> Self {
        x
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.wrapping_add(other)
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.wrapping_mul(other)
    }
    #[inline(always)]
    fn xor(self, other: Self) -> Self {
        self ^ other
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        self & other
    }
    #[inline(always)]
    fn shl(self, bits: u32) -> Self {
        self << bits
    }
    #[inline(always)]
    fn shr(self, bits: u32) -> Self {
        self >> bits
    }
}

/// Numbers in the widest [`Lane`].
pub const MAX_WIDTH: usize = 16;

/// A [`Real`] that is a fixed number of plain numbers side by side: a scalar, or a SIMD register.
pub trait Lane: Real {
    /// As many 32-bit words.
    type Word: Word;
    /// How many numbers.
    const WIDTH: usize;
    /// Number `i`, `i < WIDTH`.
    fn lane(self, i: usize) -> f64;
    /// Numbers `f(0), f(1), …`, of the same kind as `self`: the way to look something up for each lane.
    fn gather(self, f: impl FnMut(usize) -> f64) -> Self;
    /// For each lane the first four numbers of `f(lane)`, transposed: the first ones, the second ones and so on.
    ///
    /// # Panics
    /// When a slice has fewer than four.
    fn gather_four<'a>(self, f: impl FnMut(usize) -> &'a [f32]) -> [Self; 4];
    /// The largest integers not above.
    fn floor(self) -> Self;
    /// Integers as words modulo 2^32; meaningless (but defined) where `|self| ≥ 2^22` or not an integer.
    fn to_word(self) -> Self::Word;
    /// The lowest eight bits b of each word as the number (b + ½)/256, exactly; of the same kind as `self`.
    fn unit8(self, word: Self::Word) -> Self;
    /// `-self` where the highest bit of the word is set.
    fn negate_by_top_bit(self, word: Self::Word) -> Self;
    /// True when any `self < bound`.
    fn any_lt(self, bound: Self) -> bool;
    /// `f()`, in a function of its own that is compiled for this lane's instruction set. Large kernels are cut up so.
    #[inline(always)]
    fn outlined<R>(self, f: impl FnOnce() -> R) -> R {
        f()
    }
}

macro_rules! scalar {
    ($t:ty) => {
        impl Real for $t {
            #[inline(always)]
            fn lit(self, x: f64) -> Self {
                x as $t
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                <$t>::sqrt(self)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                <$t>::abs(self)
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                if self < other { self } else { other }
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if self > other { self } else { other }
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                // The hardware instruction is not in the baseline; the library call would cost fifty times more.
                self * a + b
            }
            #[inline(always)]
            fn select_lt(self, bound: Self, then: Self, otherwise: Self) -> Self {
                if self < bound { then } else { otherwise }
            }
        }

        impl Lane for $t {
            type Word = u32;
            const WIDTH: usize = 1;
            #[inline(always)]
            fn lane(self, _: usize) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn gather(self, mut f: impl FnMut(usize) -> f64) -> Self {
                f(0) as $t
            }
            #[inline(always)]
            fn gather_four<'a>(self, mut f: impl FnMut(usize) -> &'a [f32]) -> [Self; 4] {
                let found = f(0);
                [found[0] as $t, found[1] as $t, found[2] as $t, found[3] as $t]
            }
            #[inline(always)]
            fn floor(self) -> Self {
                <$t>::floor(self)
            }
            #[inline(always)]
            fn to_word(self) -> u32 {
                self as i64 as u32
            }
            #[inline(always)]
            fn unit8(self, word: u32) -> Self {
                ((word & 0xFF) as $t + 0.5) / 256.0
            }
            #[inline(always)]
            fn negate_by_top_bit(self, word: u32) -> Self {
                if word >> 31 == 1 { -self } else { self }
            }
            #[inline(always)]
            fn any_lt(self, bound: Self) -> bool {
                self < bound
            }
        }
    };
}

scalar!(f32);
scalar!(f64);

/// `[e(0), e(1), e(2)]` for `triple!(i => e(i))`, without a closure: a closure that the compiler does not inline is
/// compiled for the baseline processor and makes SIMD code many times slower.
macro_rules! triple {
    ($i:ident => $e:expr) => {
        [
            {
                let $i: usize = 0;
                $e
            },
            {
                let $i: usize = 1;
                $e
            },
            {
                let $i: usize = 2;
                $e
            },
        ]
    };
}
pub(crate) use triple;

/// Scalar product of two triples.
#[inline(always)]
pub fn dot<R: Real>(a: [R; 3], b: [R; 3]) -> R {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// Euclidean length of a triple.
#[inline(always)]
pub fn length<R: Real>(a: [R; 3]) -> R {
    dot(a, a).sqrt()
}

/// Vector product of two triples.
#[inline(always)]
pub fn cross<R: Real>(a: [R; 3], b: [R; 3]) -> [R; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
