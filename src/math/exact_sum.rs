//! Sums of numbers without any rounding.
//!
//! Addition is then associative and commutative to the bit, so that terms may be added in any order and in any number of
//! parts, on several machines too, and give one result. Two numbers of double precision hold most sums exactly (Shewchuk
//! 1997, *Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates*, figure 4); what they cannot
//! hold goes to digits of whole numbers (after Neal 2015, *Fast Exact Summation Using Small and Large Superaccumulators*).

use std::array::from_fn;

/// Several sums, each of numbers in single precision or of squares of such numbers: whole multiples of 2⁻²⁹⁸, and at most 2³²
/// of them.
#[derive(Debug, Clone)]
pub struct ExactSums<const LANES: usize> {
    /// A sum is that of both, and of its digits. NaN once a term was no number.
    high: [f64; LANES],
    low: [f64; LANES],
    /// What two numbers could not hold.
    digits: Option<Box<[Digits; LANES]>>,
}

/// Exponent of the least square of a number in single precision.
const LEAST: i32 = -298;
/// Digits of a sum: sums of the largest squares end in the 19th.
const DIGITS: usize = 19;

/// A whole multiple of 2⁻²⁹⁸: digits of 32 bits, the last one with the sign and with whatever is above.
#[derive(Debug, Clone, Copy)]
struct Digits([i64; DIGITS]);

/// A sum rounded to nearest, and what that leaves: both together are exact.
#[inline]
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let of_b = sum - a;
    (sum, (a - (sum - of_b)) + (b - of_b))
}

/// A product rounded to nearest, and what that leaves. Halves of the digits, as not every processor multiplies and adds in one.
#[inline]
fn two_product(a: f64, b: f64) -> (f64, f64) {
    let halves = |x: f64| {
        let shifted = x * f64::from((1 << 27) + 1);
        let high = shifted - (shifted - x);
        (high, x - high)
    };
    let (product, (a, a_low), (b, b_low)) = (a * b, halves(a), halves(b));
    (product, ((a * b - product) + a * b_low + a_low * b) + a_low * b_low)
}

impl<const LANES: usize> Default for ExactSums<LANES> {
    fn default() -> Self {
        Self { high: [0.0; LANES], low: [0.0; LANES], digits: None }
    }
}

impl<const LANES: usize> ExactSums<LANES> {
    /// Adds a number to each sum. Infinity and NaN make a sum NaN.
    // A call would cost half as much again.
    #[inline(always)]
    pub fn add(&mut self, x: [f64; LANES]) {
        let (mut rest, mut any) = ([0.0; LANES], 0);
        for (lane, rest) in rest.iter_mut().enumerate() {
            (self.high[lane], *rest) = two_sum(self.high[lane], x[lane]);
            any |= rest.to_bits();
        }
        // As a rule for numbers in single precision, seldom for squares.
        if any == 0 {
            return;
        }
        any = 0;
        for (low, rest) in self.low.iter_mut().zip(&mut rest) {
            (*low, *rest) = two_sum(*low, *rest);
            any |= rest.to_bits();
        }
        if any != 0 {
            self.spill(rest);
        }
    }

    /// Puts all sums into digits, with what did not fit.
    #[cold]
    #[inline(never)]
    fn spill(&mut self, lost: [f64; LANES]) {
        let all_digits = self.digits.get_or_insert_with(|| Box::new([Digits([0; DIGITS]); LANES]));
        for (lane, digits) in all_digits.iter_mut().enumerate() {
            let (high, low) = (&mut self.high[lane], &mut self.low[lane]);
            if high.is_finite() {
                [*high, *low, lost[lane]].iter().for_each(|&x| digits.add(x));
                (*high, *low) = (0.0, 0.0);
            } else {
                (*digits, *high, *low) = (Digits([0; DIGITS]), f64::NAN, 0.0);
            }
        }
    }

    /// Adds all that others have.
    pub fn merge(&mut self, other: &Self) {
        for lane in 0..LANES {
            other.each_part(lane, |part| {
                let mut x = [0.0; LANES];
                x[lane] = part;
                self.add(x);
            });
        }
    }

    /// A sum as numbers of which each is what those before it leave, rounded to nearest: equal sums have equal parts.
    fn each_part(&self, lane: usize, mut tell: impl FnMut(f64)) {
        let (high, low) = (self.high[lane], self.low[lane]);
        if high.is_nan() {
            return tell(f64::NAN);
        }
        let Some(digits) = &self.digits else {
            let (high, low) = two_sum(high, low);
            return [high, low].into_iter().filter(|&part| part != 0.0).for_each(tell);
        };
        let mut rest = digits[lane];
        [high, low].iter().for_each(|&x| rest.add(x));
        loop {
            let part = rest.to_f64();
            if part == 0.0 {
                return;
            }
            tell(part);
            rest.add(-part);
        }
    }

    /// The first two parts of a sum.
    #[inline]
    fn two_parts(&self, lane: usize) -> [f64; 2] {
        if self.digits.is_none() {
            return two_sum(self.high[lane], self.low[lane]).into();
        }
        let (mut parts, mut seen) = ([0.0; 2], 0);
        self.each_part(lane, |part| {
            if let Some(place) = parts.get_mut(seen) {
                *place = part;
            }
            seen += 1;
        });
        parts
    }

    /// The sums in double precision, rounded to nearest.
    #[inline]
    pub fn to_f64(&self) -> [f64; LANES] {
        from_fn(|lane| self.two_parts(lane)[0])
    }

    /// `count` Σx² − (Σx)² for the numbers of a sum, of which there are `count` and whose squares are summed in the same lane
    /// of `squares`: to at least seven digits, and exactly 0 where all are equal.
    #[inline]
    pub fn spread(&self, squares: &Self, lane: usize, count: u32) -> f64 {
        let n = f64::from(count);
        let ([sum, sum_low], [squares, squares_low]) = (self.two_parts(lane), squares.two_parts(lane));
        let ((square, square_rest), (squares, squares_rest)) = (two_product(sum, sum), two_product(n, squares));
        let spread = (squares - square) + ((squares_rest - square_rest) + (n * squares_low - 2.0 * sum * sum_low));
        // A number that is not the largest one differs from it by 2⁻²⁴ of it at least. Then the spread is above
        // (count − 1) / count² of 2⁻⁴⁸ of the squares, where this arithmetic errs by some 2⁻¹⁰³ of them.
        const NOTHING: f64 = f64::from_bits((1023 - 90) << 52);
        if spread > NOTHING * squares { spread } else { 0.0 }
    }

    /// Writes the sums at the end of `out`: equal sums give equal bytes.
    pub fn encode(&self, out: &mut Vec<u8>) {
        for lane in 0..LANES {
            let start = out.len();
            out.push(0);
            self.each_part(lane, |part| {
                out.extend(part.to_le_bytes());
                out[start] += 1;
            });
        }
    }

    /// Reads what [`encode`](Self::encode) has written and leaves `bytes` after it; `None` where it is no such sums.
    pub fn decode(bytes: &mut &[u8]) -> Option<Self> {
        let mut sums = Self::default();
        for lane in 0..LANES {
            let (&count, mut rest) = bytes.split_first()?;
            for _ in 0..count {
                let (part, behind) = rest.split_first_chunk()?;
                let part = f64::from_le_bytes(*part);
                if !part.is_nan() && !Digits::can_hold(part) {
                    return None;
                }
                let mut x = [0.0; LANES];
                x[lane] = part;
                sums.add(x);
                rest = behind;
            }
            *bytes = rest;
        }
        Some(sums)
    }
}

impl Digits {
    /// Place of the first digit that a number reaches, and its digits from there on.
    fn split(x: f64) -> (usize, i128) {
        let exponent = (x.to_bits() >> 52) & 0x7ff;
        let mantissa = (x.to_bits() & ((1 << 52) - 1)) | u64::from(exponent != 0) << 52;
        let shift = exponent.max(1) as i32 - 1075 - LEAST;
        let (place, digits) = if shift < 0 {
            (0, i128::from(mantissa.checked_shr(shift.unsigned_abs()).unwrap_or(0)))
        } else {
            (shift as usize / 32, i128::from(mantissa) << (shift % 32))
        };
        (place, if x.is_sign_negative() { -digits } else { digits })
    }

    /// Whether a number is a whole multiple of 2⁻²⁹⁸, and not larger than what may be added.
    fn can_hold(x: f64) -> bool {
        let (place, digits) = Self::split(x);
        // Three digits take all of a number.
        place + 3 <= DIGITS && digits as f64 * power_of_two(32 * place as i32 + LEAST) == x
    }

    fn add(&mut self, x: f64) {
        let (place, mut carried) = Self::split(x);
        for digit in &mut self.0[place..DIGITS - 1] {
            carried += i128::from(*digit);
            *digit = (carried & 0xffff_ffff) as i64;
            carried >>= 32;
        }
        self.0[DIGITS - 1] = self.0[DIGITS - 1].saturating_add(carried as i64);
    }

    /// Rounded to nearest.
    fn to_f64(self) -> f64 {
        if self.0[DIGITS - 1] < 0 {
            let mut opposite = Self([0; DIGITS]);
            let mut carried = 0i64;
            for (digit, own) in opposite.0.iter_mut().zip(self.0) {
                carried = carried.saturating_sub(own);
                *digit = carried & 0xffff_ffff;
                carried >>= 32;
            }
            opposite.0[DIGITS - 1] |= carried << 32;
            return -opposite.to_f64();
        }
        let top = self.0.iter().rposition(|&digit| digit != 0).unwrap_or(0).max(2);
        let digits = self.0[top - 2..=top].iter().rev().fold(0, |above, &digit| above << 32 | digit as u128);
        // What is further below decides only between two halves.
        let is_more = self.0[..top - 2].iter().any(|&digit| digit != 0);
        (digits | u128::from(is_more)) as f64 * power_of_two(32 * (top as i32 - 2) + LEAST)
    }
}

/// Of a normal number in double precision.
fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((exponent + 1023) as u64) << 52)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Any finite numbers, those at the ends of what there is and those of usual size.
    fn numbers() -> impl Strategy<Value = Vec<f32>> {
        let any = any::<u32>().prop_map(f32::from_bits).prop_filter("finite", |x| x.is_finite());
        let usual = (-1e3f32..1e3, -30i32..10).prop_map(|(x, e)| x * 2f32.powi(e));
        let special =
            prop::sample::select(vec![0.0, -0.0, f32::MAX, f32::MIN, f32::from_bits(1), f32::MIN_POSITIVE, 1.0]);
        let mixed = prop_oneof![any, usual.clone(), special];
        prop_oneof![prop::collection::vec(mixed, 0..300), prop::collection::vec(usual, 0..300)]
    }

    /// The sum of numbers, and that of their squares.
    fn sums(values: &[f32]) -> ExactSums<2> {
        let mut sums = ExactSums::default();
        values.iter().for_each(|&x| add(&mut sums, x));
        sums
    }

    /// Of such sums.
    fn spread(sums: &ExactSums<2>, count: u32) -> f64 {
        let lane = |i: usize| {
            let mut lane = ExactSums::<1>::default();
            sums.each_part(i, |part| lane.add([part]));
            lane
        };
        lane(0).spread(&lane(1), 0, count)
    }

    fn add(sums: &mut ExactSums<2>, x: f32) {
        let x = f64::from(x);
        sums.add([x, x * x]);
    }

    fn bytes(sums: &ExactSums<2>) -> Vec<u8> {
        let mut out = Vec::new();
        sums.encode(&mut out);
        out
    }

    fn decoded(bytes: &[u8]) -> ExactSums<2> {
        let mut rest = bytes;
        let sums = ExactSums::decode(&mut rest).unwrap();
        assert!(rest.is_empty());
        sums
    }

    proptest! {
        #[test]
        fn any_order_in_any_parts_gives_equal_bytes(values in numbers(), cuts in prop::collection::vec(0usize..300, 0..4)) {
            let whole = sums(&values);
            let mut backwards = values.clone();
            backwards.reverse();
            prop_assert_eq!(bytes(&whole), bytes(&sums(&backwards)));
            let mut cuts: Vec<usize> = cuts.into_iter().map(|cut| cut.min(values.len())).chain([0, values.len()]).collect();
            cuts.sort();
            let mut joined = ExactSums::default();
            for part in cuts.windows(2).rev() {
                // Over a file, as parts come from other machines.
                joined.merge(&decoded(&bytes(&sums(&values[part[0]..part[1]]))));
            }
            prop_assert_eq!(bytes(&whole), bytes(&joined));
            prop_assert_eq!(whole.to_f64().map(f64::to_bits), joined.to_f64().map(f64::to_bits));
            let spreads = [&whole, &joined].map(|sums| spread(sums, values.len() as u32).to_bits());
            prop_assert_eq!(spreads[0], spreads[1]);
        }

        #[test]
        fn digits_and_two_numbers_are_one_sum(values in numbers()) {
            let (two, mut spilled) = (sums(&values), ExactSums::default());
            // Further apart than two numbers can hold, and taken away again.
            let apart = [f64::from(f32::MAX), f64::from(f32::from_bits(1)), 1.0];
            apart.iter().for_each(|&x| spilled.add([x, x]));
            prop_assert!(spilled.digits.is_some());
            values.iter().for_each(|&x| add(&mut spilled, x));
            apart.iter().for_each(|&x| spilled.add([-x, -x]));
            prop_assert_eq!(bytes(&two), bytes(&spilled));
            prop_assert_eq!(two.two_parts(0), spilled.two_parts(0));
            prop_assert_eq!(two.two_parts(1), spilled.two_parts(1));
        }

        #[test]
        fn sums_are_right(values in prop::collection::vec((-(1i32 << 24)..1 << 24, -20i32..20), 2..200)) {
            // As whole multiples of 2⁻²⁰, in arithmetic that cannot round.
            let values: Vec<(f32, i128)> =
                values.into_iter().map(|(m, e)| (m as f32 * 2f32.powi(e), i128::from(m) << (e + 20))).collect();
            let floats: Vec<f32> = values.iter().map(|v| v.0).collect();
            let (sums, n) = (sums(&floats), values.len());
            let total = values.iter().map(|v| v.1).sum::<i128>();
            prop_assert_eq!(sums.to_f64()[0] * 2f64.powi(20), total as f64);
            let found = spread(&sums, n as u32);
            // Deviations from the first value, so that little cancels.
            let first = f64::from(floats[0]);
            let (s, q) = floats.iter().fold((0.0, 0.0), |(s, q), &x| (s + f64::from(x) - first, q + (f64::from(x) - first).powi(2)));
            let expected = n as f64 * q - s * s;
            prop_assert!(found >= 0.0 && (found - expected).abs() <= 1e-12 * n as f64 * q, "{found} {expected}");
        }

        #[test]
        fn the_least_difference_is_a_spread(x in any::<u32>().prop_map(f32::from_bits), count in 2u32..5000) {
            prop_assume!(x.is_finite() && x != 0.0);
            let less = f32::from_bits(x.to_bits() - 1);
            let (mut different, mut equal) = (sums(&[less]), sums(&[x]));
            for _ in 1..count {
                add(&mut different, x);
                add(&mut equal, x);
            }
            let step = f64::from(x) - f64::from(less);
            let (found, expected) = (spread(&different, count), f64::from(count - 1) * step * step);
            prop_assert!((found - expected).abs() <= 1e-6 * expected, "{found:e} {expected:e}");
            prop_assert_eq!(spread(&equal, count), 0.0);
        }

        #[test]
        fn damaged_bytes_are_no_panic(damaged in prop::collection::vec(any::<u8>(), 0..200), count in 0u8..20) {
            let damaged = [vec![count], damaged].concat();
            if let Some(sums) = ExactSums::<2>::decode(&mut &damaged[..]) {
                let mut other = sums.clone();
                (0..3).for_each(|_| other.merge(&sums));
                let _ = (other.to_f64(), spread(&other, u32::MAX));
            }
        }
    }

    #[test]
    fn equal_numbers_have_no_spread_and_small_ones_are_not_lost() {
        let equal = sums(&[0.3; 1000]);
        assert_eq!((spread(&equal, 1000), equal.to_f64()[0]), (0.0, 1000.0 * f64::from(0.3f32)));
        assert_eq!(sums(&[1e30, 1e-30, -1e30]).to_f64()[0] as f32, 1e-30);
        assert_eq!(sums(&[-2.5, 1.0]).to_f64()[0], -1.5);
        assert_eq!(sums(&[f32::MAX; 300]).to_f64()[0], 300.0 * f64::from(f32::MAX));
        assert_eq!(spread(&sums(&[1.0, 2.0, 4.0, 9.0]), 4), 4.0 * 102.0 - 256.0);
        let none = sums(&[]);
        assert_eq!((none.to_f64(), spread(&none, 0)), ([0.0; 2], 0.0));
    }

    #[test]
    fn the_largest_sums_fit() {
        // What 2³² of the largest squares come to, beside the least one.
        let (most, least) = (f64::from(f32::MAX).powi(2) * 2f64.powi(32), f64::from(f32::from_bits(1)).powi(2));
        let mut sums = ExactSums::<2>::default();
        [least, most, 1.0].iter().for_each(|&x| sums.add([x, -x]));
        assert_eq!(sums.to_f64(), [most, -most]);
        let mut read = decoded(&bytes(&sums));
        [-most, -1.0].iter().for_each(|&x| read.add([x, -x]));
        assert_eq!(read.to_f64(), [least, -least]);
        for no_sum in [2f64.powi(310), 2f64.powi(-299), f64::INFINITY, f64::MAX, f64::from_bits(1)] {
            let bytes = [&[1][..], &no_sum.to_le_bytes()].concat();
            assert!(ExactSums::<1>::decode(&mut &bytes[..]).is_none(), "{no_sum}");
        }
    }

    #[test]
    fn what_is_no_number_stays_so_in_its_lane() {
        let mut sums = ExactSums::<2>::default();
        sums.add([f64::NEG_INFINITY, 2.0]);
        sums.add([1.0, 1.0]);
        let mut other = ExactSums::default();
        other.add([-3.0, 0.5]);
        other.merge(&decoded(&bytes(&sums)));
        assert!(sums.to_f64()[0].is_nan() && other.to_f64()[0].is_nan());
        assert_eq!((sums.to_f64()[1], other.to_f64()[1]), (3.0, 3.5));
    }
}
