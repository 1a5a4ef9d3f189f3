//! Single-precision SIMD lanes whose width is chosen at run time, and the one place where it is chosen.
//!
//! Everything is elementwise, so on processors with fused multiply–add a number computed in a lane of eight is the
//! very same as in a lane of sixteen; the tail of an array is padded, never computed by other means.

use crate::math::real::{Lane, MAX_WIDTH, Real, Word};
use fearless_simd::{Bytes, Level, Select, Simd, SimdBase, SimdFloat, SimdFrom};
use std::ops::{Add, Div, Mul, Neg, Sub};

type FloatBits<S> = <<S as Simd>::f32s as SimdFloat<S>>::Bits;

/// As many `f32` side by side as the instruction set `S` has in a register.
#[derive(Clone, Copy, Debug)]
pub struct Lanes<S: Simd> {
    simd: S,
    values: S::f32s,
}

/// The words of [`Lanes`].
#[derive(Clone, Copy, Debug)]
pub struct WordLanes<S: Simd> {
    simd: S,
    values: FloatBits<S>,
}

/// A [`Lane`] that is read from arrays of single precision and written back.
pub trait Batch: Lane {
    /// The first `WIDTH` numbers of `slice`, of the same kind as `self`; the last one again where there are fewer.
    ///
    /// # Panics
    /// When `slice` is empty.
    fn load(self, slice: &[f32]) -> Self;
    /// Writes the first `WIDTH` numbers of `slice`, or as many as there are.
    fn store(self, slice: &mut [f32]);
}

/// Work that is generic over how many numbers are computed side by side.
pub trait Kernel {
    /// What comes out.
    type Output;
    /// Whether it is worth a copy for x86 processors with nothing better than SSE 4.2, ten years old by now. Without,
    /// these do it one number at a time.
    const HAS_FOUR_LANES: bool = false;
    /// Does the work; constants are made from `zero`. Mark implementations `#[inline(always)]`, or the instruction set is
    /// not used.
    fn run<L: Batch>(self, zero: L) -> Self::Output;
}

/// Runs the kernel with the best instruction set this processor has.
pub fn run_kernel<K: Kernel>(kernel: K) -> K::Output {
    let level = Level::new();
    #[cfg(target_arch = "x86_64")]
    {
        if let Some(simd) = level.as_avx512() {
            return simd.vectorize(
                #[inline(always)]
                || kernel.run(Lanes::splat(simd, 0.0)),
            );
        }
        if let Some(simd) = level.as_avx2() {
            return simd.vectorize(
                #[inline(always)]
                || kernel.run(Lanes::splat(simd, 0.0)),
            );
        }
        run_four_lanes(kernel)
    }
    #[cfg(not(target_arch = "x86_64"))]
    fearless_simd::dispatch!(level, simd => kernel.run(Lanes::splat(simd, 0.0)))
}

/// The kernel four numbers at a time, or one by one where it has no such copy or the processor not even SSE 4.2.
#[cfg(target_arch = "x86_64")]
pub(crate) fn run_four_lanes<K: Kernel>(kernel: K) -> K::Output {
    if K::HAS_FOUR_LANES
        && let Some(simd) = Level::new().as_sse4_2()
    {
        return simd.vectorize(
            #[inline(always)]
            || kernel.run(Lanes::splat(simd, 0.0)),
        );
    }
    kernel.run(0.0f64)
}

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    fn wrap(self, values: S::f32s) -> Self {
        Self { simd: self.simd, values }
    }

    /// `x` in every lane.
    #[inline(always)]
    fn splat(simd: S, x: f32) -> Self {
        Self { simd, values: S::f32s::simd_from(simd, x) }
    }
}

impl<S: Simd> Batch for Lanes<S> {
    #[inline(always)]
    fn load(self, slice: &[f32]) -> Self {
        let values = if slice.len() >= Self::WIDTH {
            S::f32s::from_slice(self.simd, &slice[..Self::WIDTH])
        } else {
            S::f32s::from_fn(self.simd, |i| slice[i.min(slice.len() - 1)])
        };
        self.wrap(values)
    }
    #[inline(always)]
    fn store(self, slice: &mut [f32]) {
        if slice.len() >= Self::WIDTH {
            self.values.store_slice(&mut slice[..Self::WIDTH]);
        } else {
            let count = slice.len();
            slice.copy_from_slice(&self.values.as_slice()[..count]);
        }
    }
}

impl Batch for f64 {
    #[inline(always)]
    fn load(self, slice: &[f32]) -> Self {
        f64::from(slice[0])
    }
    #[inline(always)]
    fn store(self, slice: &mut [f32]) {
        slice[0] = self as f32;
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident, $op:tt) => {
        impl<S: Simd> $trait for Lanes<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.wrap(self.values $op other.values)
            }
        }
    };
}

operator!(Add, add, +);
operator!(Sub, sub, -);
operator!(Mul, mul, *);
operator!(Div, div, /);

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.wrap(-self.values)
    }
}

impl<S: Simd> Real for Lanes<S> {
    #[inline(always)]
    fn lit(self, x: f64) -> Self {
        Self::splat(self.simd, x as f32)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.wrap(self.values.sqrt())
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.wrap(self.values.abs())
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
        self.wrap(self.values.mul_add(a.values, b.values))
    }
    #[inline(always)]
    fn select_lt(self, bound: Self, then: Self, otherwise: Self) -> Self {
        self.wrap(self.values.simd_lt(bound.values).select(then.values, otherwise.values))
    }
}

impl<S: Simd> WordLanes<S> {
    #[inline(always)]
    fn wrap(self, values: FloatBits<S>) -> Self {
        Self { simd: self.simd, values }
    }
}

impl<S: Simd> Word for WordLanes<S> {
    #[inline(always)]
    fn lit(self, x: u32) -> Self {
        self.wrap(FloatBits::<S>::simd_from(self.simd, x))
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.wrap(self.values + other.values)
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.wrap(self.values * other.values)
    }
    #[inline(always)]
    fn xor(self, other: Self) -> Self {
        self.wrap(self.values ^ other.values)
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        self.wrap(self.values & other.values)
    }
    #[inline(always)]
    fn shl(self, bits: u32) -> Self {
        self.wrap(self.values << bits)
    }
    #[inline(always)]
    fn shr(self, bits: u32) -> Self {
        self.wrap(self.values >> bits)
    }
}

/// Adding 1.5·2^23 to an integer leaves it in the low bits of the sum's mantissa.
const INTEGER_IN_MANTISSA: f64 = 12_582_912.0;
const ONE_BITS: u32 = 0x3F80_0000;

impl<S: Simd> Lane for Lanes<S> {
    type Word = WordLanes<S>;
    const WIDTH: usize = S::f32s::LEN;

    #[inline(always)]
    fn lane(self, i: usize) -> f64 {
        f64::from(self.values.as_slice()[i])
    }
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn gather(self, mut f: impl FnMut(usize) -> f64) -> Self {
        // A plain loop: the library's `from_fn` leaves a call for each lane.
        let mut numbers = [0.0; MAX_WIDTH];
        for i in 0..Self::WIDTH {
            numbers[i] = f(i) as f32;
        }
        self.wrap(S::f32s::from_slice(self.simd, &numbers[..Self::WIDTH]))
    }
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn gather_four<'a>(self, mut f: impl FnMut(usize) -> &'a [f32]) -> [Self; 4] {
        let mut found = [[0.0; 4]; MAX_WIDTH];
        for i in 0..Self::WIDTH {
            // Element by element, since `copy_from_slice` is not certain to be inlined.
            let four = &f(i)[..4];
            found[i] = [four[0], four[1], four[2], four[3]];
        }
        // Every fourth number, by taking every second one twice.
        let quarters = found.as_flattened();
        let a = S::f32s::from_slice(self.simd, &quarters[..Self::WIDTH]);
        let b = S::f32s::from_slice(self.simd, &quarters[Self::WIDTH..][..Self::WIDTH]);
        let c = S::f32s::from_slice(self.simd, &quarters[2 * Self::WIDTH..][..Self::WIDTH]);
        let d = S::f32s::from_slice(self.simd, &quarters[3 * Self::WIDTH..][..Self::WIDTH]);
        let ((even_low, odd_low), (even_high, odd_high)) = (a.deinterleave(b), c.deinterleave(d));
        let ((first, third), (second, fourth)) = (even_low.deinterleave(even_high), odd_low.deinterleave(odd_high));
        [self.wrap(first), self.wrap(second), self.wrap(third), self.wrap(fourth)]
    }
    #[inline(always)]
    fn floor(self) -> Self {
        self.wrap(self.values.floor())
    }
    #[inline(always)]
    fn to_word(self) -> WordLanes<S> {
        // `bitcast` and not `to_bits`, which leaves a call.
        let bits: FloatBits<S> = (self + self.lit(INTEGER_IN_MANTISSA)).values.bitcast();
        let words = WordLanes { simd: self.simd, values: bits };
        words.add(words.lit((INTEGER_IN_MANTISSA as f32).to_bits().wrapping_neg()))
    }
    #[inline(always)]
    fn unit8(self, word: WordLanes<S>) -> Self {
        let mantissa = word.and(word.lit(0xFF)).shl(15);
        let bits = mantissa.add(word.lit(ONE_BITS));
        self.wrap(bits.values.bitcast()) - self.lit(511.0 / 512.0)
    }
    #[inline(always)]
    fn negate_by_top_bit(self, word: WordLanes<S>) -> Self {
        let sign = word.and(word.lit(0x8000_0000));
        {
            let bits: FloatBits<S> = self.values.bitcast();
            self.wrap((bits ^ sign.values).bitcast())
        }
    }
    #[inline(always)]
    fn any_lt(self, bound: Self) -> bool {
        use fearless_simd::SimdMask;
        self.values.simd_lt(bound.values).any_true()
    }
    #[inline(always)]
    fn outlined<R>(self, f: impl FnOnce() -> R) -> R {
        self.simd.vectorize(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct EqualToScalar<'a>(&'a [f32]);

    impl Kernel for EqualToScalar<'_> {
        type Output = ();
        #[inline(always)]
        fn run<L: Batch>(self, zero: L) {
            for chunk in self.0.chunks(L::WIDTH) {
                let x = zero.load(chunk);
                let word = x.floor().to_word();
                let hashed = word.mul(word.lit(0x7FEB_352D)).xor(word.shr(3)).add(word.shl(5));
                let y = x.sqrt().max(x.unit8(hashed)).negate_by_top_bit(hashed);
                for (i, &s) in chunk.iter().enumerate() {
                    let word = Lane::floor(s).to_word();
                    let hashed = Word::add(Word::mul(word, 0x7FEB_352D).xor(word.shr(3)), word.shl(5));
                    let scalar = Real::max(Real::sqrt(s), s.unit8(hashed)).negate_by_top_bit(hashed);
                    assert_eq!(y.lane(i), f64::from(scalar), "{s}");
                }
            }
        }
    }

    #[test]
    fn lanes_compute_what_scalars_compute() {
        let numbers: Vec<f32> = (0..1003).map(|i| i as f32 * 0.37).collect();
        run_kernel(EqualToScalar(&numbers));
    }

    struct Transposed<'a>(&'a [f32]);

    impl Kernel for Transposed<'_> {
        type Output = ();
        #[inline(always)]
        fn run<L: Batch>(self, zero: L) {
            let at = |lane: usize| &self.0[7 * lane + 3..];
            let found = zero.gather_four(at);
            for lane in 0..L::WIDTH {
                for (n, found) in found.iter().enumerate() {
                    assert_eq!(found.lane(lane), f64::from(at(lane)[n]), "number {n} of lane {lane}");
                }
            }
        }
    }

    #[test]
    fn four_numbers_for_each_lane_come_transposed() {
        let numbers: Vec<f32> = (0..7 * MAX_WIDTH as u16).map(f32::from).collect();
        run_kernel(Transposed(&numbers));
        run_four_lanes(Transposed(&numbers));
    }

    struct WordOf(f32);

    impl Kernel for WordOf {
        type Output = bool;
        #[inline(always)]
        fn run<L: Batch>(self, zero: L) -> bool {
            let x = zero.lit(f64::from(self.0));
            let expected = x.gather(|_| f64::from(self.0.to_word() & 0xFF));
            // Eight bits at a time, as numbers: words themselves cannot be looked at.
            let got = (x.unit8(x.to_word()) * x.lit(256.0)).floor();
            !(got - expected).abs().any_lt(x.lit(0.0)) && (got - expected).abs().any_lt(x.lit(0.5))
        }
    }

    #[test]
    fn negative_integers_become_twos_complement_words() {
        for x in [-1.0, -2.0, -255.0, -256.0, -70_000.0, 0.0, 3.0, 4_000_000.0] {
            assert!(run_kernel(WordOf(x)), "{x}");
        }
    }
}
