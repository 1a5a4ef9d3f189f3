//! Sums of numbers in single precision, and of their squares, without any rounding: whole numbers of many digits.
//!
//! Addition is then associative and commutative to the bit, so that terms may be added in any order and in any number of
//! parts, on several machines too, and give one result. After Neal 2015, *Fast Exact Summation Using Small and Large
//! Superaccumulators*: digits are wider than their places, and carries wait.

/// Additions after which [`ExactSum::carry`] and [`ExactSquares::carry`] are due: a term is below 2⁵⁵ in its place, whose digit
/// holds 2⁶³.
pub const CARRY_AFTER: u32 = 128;

/// Digits that terms reach; a digit more takes what is carried out of them.
const REACHED: usize = 8;
/// Exponent of the least number in single precision.
const LEAST: i32 = -149;
/// The last digit of a sum with a term that was no number.
const NOT_FINITE: i64 = i64::MIN;

/// A sum: digits of 32 bits from 2⁻¹⁴⁹ on.
#[derive(Debug, Clone, Copy, Default)]
pub struct ExactSum([i64; REACHED + 1]);

/// A sum of squares: digits of 64 bits from 2⁻²⁹⁸ on.
#[derive(Debug, Clone, Copy, Default)]
pub struct ExactSquares([u128; REACHED + 1]);

/// Place, and digits there with their sign apart, of a finite number.
#[inline]
fn split(x: f32) -> (usize, u64) {
    let bits = x.to_bits();
    let exponent = (bits >> 23) & 255;
    let mantissa = (bits & 0x7f_ffff) | u32::from(exponent != 0) << 23;
    let shift = exponent.max(1) - 1;
    // At most 253, for 255 is no number; the mask tells the compiler.
    ((shift >> 5) as usize & (REACHED - 1), u64::from(mantissa) << (shift & 31))
}

/// With the sign of a number, without a branch: signs of some layers are any.
#[inline]
fn signed(digits: u64, x: f32) -> i64 {
    let sign = i64::from((x.to_bits() as i32) >> 31);
    (digits as i64 ^ sign) - sign
}

impl ExactSum {
    /// Adds a number. Infinity and NaN make the sum NaN.
    #[inline]
    pub fn add(&mut self, x: f32) {
        if x.is_finite() {
            let (place, digits) = split(x);
            self.0[place] += signed(digits, x);
        } else {
            self.0[REACHED] = NOT_FINITE;
        }
    }

    /// Brings digits below 2³², once in [`CARRY_AFTER`] additions.
    pub fn carry(&mut self) {
        for place in 0..REACHED {
            let carried = self.0[place] >> 32;
            self.0[place] &= 0xffff_ffff;
            // What is no number stays so: it is as far from 0 as can be, and is told by that.
            self.0[place + 1] = self.0[place + 1].saturating_add(carried);
        }
    }

    /// Adds all that another sum has.
    pub fn merge(&mut self, other: &Self) {
        if self.is_not_finite() || other.is_not_finite() {
            *self = Self::default();
            self.0[REACHED] = NOT_FINITE;
            return;
        }
        self.carry();
        let mut other = *other;
        other.carry();
        self.0.iter_mut().zip(other.0).for_each(|(digit, more)| *digit = digit.saturating_add(more));
        self.carry();
    }

    fn is_not_finite(&self) -> bool {
        // All numbers of a pixel together stay far above.
        self.0[REACHED] < i64::MIN / 2
    }

    /// The sum in double precision, rounded the same way however it came about.
    pub fn to_f64(&self) -> f64 {
        if self.is_not_finite() {
            return f64::NAN;
        }
        if self.0 == [0; REACHED + 1] {
            return 0.0;
        }
        let mut sum = *self;
        sum.carry();
        let places = sum.0.iter().enumerate().rev();
        places.fold(0.0, |above, (place, &digit)| above + digit as f64 * power_of_two(32 * place as i32 + LEAST))
    }

    /// Digits of 32 bits in two's complement.
    fn words(&self) -> [u32; REACHED + 2] {
        let mut sum = *self;
        sum.carry();
        let top = sum.0[REACHED];
        std::array::from_fn(|i| match i {
            REACHED => top as u32,
            i if i > REACHED => (top >> 32) as u32,
            i => sum.0[i] as u32,
        })
    }

    /// Writes the sum at the end of `out`: equal sums give equal bytes.
    pub fn encode(&self, out: &mut Vec<u8>) {
        let words = self.words();
        let start = words.iter().position(|&word| word != 0).unwrap_or(words.len());
        let mut end = words.len();
        // A digit that only repeats the sign of the one below it says nothing.
        while end > start + 1 && words[end - 1] == sign_of(words[end - 2]) {
            end -= 1;
        }
        encode_run(start, end, out, |i, out| out.extend(words[i].to_le_bytes()));
    }

    /// Reads what [`encode`](Self::encode) has written and leaves `bytes` after it; `None` where it is no sum.
    pub fn decode(bytes: &mut &[u8]) -> Option<Self> {
        let mut words = [0u32; REACHED + 2];
        let (start, end) = decode_run(bytes, words.len())?;
        for word in &mut words[start..end] {
            *word = u32::from_le_bytes(take(bytes)?);
        }
        if end > start {
            let sign = sign_of(words[end - 1]);
            words[end..].fill(sign);
        }
        let mut digits = [0i64; REACHED + 1];
        digits[..REACHED].iter_mut().zip(words).for_each(|(digit, word)| *digit = i64::from(word));
        digits[REACHED] = i64::from(words[REACHED + 1] as i32) << 32 | i64::from(words[REACHED]);
        Some(Self(digits))
    }
}

impl ExactSquares {
    /// Adds the square of a finite number to these, and the number to `sum`.
    #[inline]
    pub fn add_both(&mut self, sum: &mut ExactSum, x: f32) {
        debug_assert!(x.is_finite(), "only finite numbers have a square here");
        let (place, digits) = split(x);
        self.0[place] += u128::from(digits) * u128::from(digits);
        sum.0[place] += signed(digits, x);
    }

    /// Brings digits below 2⁶⁴, once in [`CARRY_AFTER`] additions.
    pub fn carry(&mut self) {
        for place in 0..REACHED {
            self.0[place + 1] = self.0[place + 1].saturating_add(self.0[place] >> 64);
            self.0[place] &= u128::from(u64::MAX);
        }
    }

    /// Adds all that another sum has.
    pub fn merge(&mut self, other: &Self) {
        self.carry();
        let mut other = *other;
        other.carry();
        self.0.iter_mut().zip(other.0).for_each(|(digit, more)| *digit = digit.saturating_add(more));
        self.carry();
    }

    /// `count` Σx² − (Σx)² for the numbers of `sum`, of which there are `count`: to nine digits, and exactly 0 where all are
    /// equal.
    pub fn spread(&self, sum: &ExactSum, count: u32) -> f64 {
        let (squares, sum_f64) = (self.to_f64() * f64::from(count), sum.to_f64());
        let spread = squares - sum_f64 * sum_f64;
        // Where few digits are left, they are counted exactly.
        const LEFT: f64 = 1.0 / (1 << 20) as f64;
        if spread > LEFT * squares { spread } else { self.exact_spread(sum, count) }
    }

    /// The sum in double precision, rounded the same way however it came about.
    fn to_f64(self) -> f64 {
        let mut sum = self;
        sum.carry();
        let places = sum.0.iter().enumerate().rev();
        let value = |(place, &digit): (usize, &u128)| {
            // A digit but the top one has 64 bits.
            let value = if place < REACHED { digit as u64 as f64 } else { digit as f64 };
            value * power_of_two(64 * place as i32 + 2 * LEAST)
        };
        places.map(value).fold(0.0, |above, digit| above + digit)
    }

    /// As [`ExactSquares::spread`], exact until it is rounded once.
    #[cold]
    fn exact_spread(&self, sum: &ExactSum, count: u32) -> f64 {
        // Places of 32 bits from 2⁻²⁹⁸ on; sums of products are wider than their place.
        let mut places = [0i128; 2 * REACHED + 6];
        let mut squares = *self;
        squares.carry();
        for (place, &digit) in squares.0.iter().enumerate() {
            let (low, high) = (digit as u64, (digit >> 64) as u64);
            places[2 * place] += i128::from(low) * i128::from(count);
            places[2 * place + 2] += i128::from(high) * i128::from(count);
        }
        let words = magnitude(sum.words());
        let used =
            words.iter().position(|&w| w != 0).unwrap_or(0)..words.iter().rposition(|&w| w != 0).map_or(0, |i| i + 1);
        for i in used.clone() {
            for j in used.clone() {
                places[i + j] -= i128::from(words[i]) * i128::from(words[j]);
            }
        }
        let mut digits = [0u32; 2 * REACHED + 6];
        let mut carried = 0;
        for (digit, place) in digits.iter_mut().zip(places) {
            carried += place;
            *digit = carried as u32;
            carried >>= 32;
        }
        // By Cauchy and Schwarz it is not negative, so that nothing is carried out of the last place.
        let digits = digits.iter().enumerate().rev();
        digits
            .fold(0.0, |above, (place, &digit)| above + f64::from(digit) * power_of_two(32 * place as i32 + 2 * LEAST))
    }

    /// Writes the sum at the end of `out`: equal sums give equal bytes.
    pub fn encode(&self, out: &mut Vec<u8>) {
        let mut sum = *self;
        sum.carry();
        let words: [u64; REACHED + 2] = std::array::from_fn(|i| match i {
            i if i > REACHED => (sum.0[REACHED] >> 64) as u64,
            i => sum.0[i] as u64,
        });
        let start = words.iter().position(|&word| word != 0).unwrap_or(words.len());
        let end = words.iter().rposition(|&word| word != 0).map_or(start, |last| last + 1);
        encode_run(start, end, out, |i, out| out.extend(words[i].to_le_bytes()));
    }

    /// Reads what [`encode`](Self::encode) has written and leaves `bytes` after it; `None` where it is no sum.
    pub fn decode(bytes: &mut &[u8]) -> Option<Self> {
        let mut words = [0u64; REACHED + 2];
        let (start, end) = decode_run(bytes, words.len())?;
        for word in &mut words[start..end] {
            *word = u64::from_le_bytes(take(bytes)?);
        }
        let mut digits: [u128; REACHED + 1] = std::array::from_fn(|i| u128::from(words[i]));
        digits[REACHED] |= u128::from(words[REACHED + 1]) << 64;
        Some(Self(digits))
    }
}

/// The word above a word where it is the last of a number in two's complement.
fn sign_of(word: u32) -> u32 {
    if word >> 31 == 0 { 0 } else { u32::MAX }
}

/// A number in two's complement without its sign.
fn magnitude(mut words: [u32; REACHED + 2]) -> [u32; REACHED + 2] {
    if sign_of(words[REACHED + 1]) == 0 {
        return words;
    }
    let mut carried = true;
    for word in &mut words {
        (*word, carried) = (!*word).overflowing_add(u32::from(carried));
    }
    words
}

/// Of a normal number in double precision.
#[inline]
fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((exponent + 1023) as u64) << 52)
}

/// Writes which words of a number are there, four bits for the first and four for how many, and then each.
fn encode_run(start: usize, end: usize, out: &mut Vec<u8>, word: impl Fn(usize, &mut Vec<u8>)) {
    out.push(if start < end { (start << 4 | (end - start)) as u8 } else { 0 });
    (start..end).for_each(|i| word(i, out));
}

fn decode_run(bytes: &mut &[u8], count: usize) -> Option<(usize, usize)> {
    let [run] = take(bytes)?;
    let (start, length) = (usize::from(run >> 4), usize::from(run & 15));
    (start + length <= count).then_some((start, start + length))
}

fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (first, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*first)
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
        prop::collection::vec(prop_oneof![any, usual, special], 0..300)
    }

    fn sums(values: &[f32]) -> (ExactSum, ExactSquares) {
        let (mut sum, mut squares) = (ExactSum::default(), ExactSquares::default());
        for (i, &x) in values.iter().enumerate() {
            squares.add_both(&mut sum, x);
            if i as u32 % CARRY_AFTER == CARRY_AFTER - 1 {
                sum.carry();
                squares.carry();
            }
        }
        (sum, squares)
    }

    fn bytes((sum, squares): &(ExactSum, ExactSquares)) -> Vec<u8> {
        let mut out = Vec::new();
        sum.encode(&mut out);
        squares.encode(&mut out);
        out
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
            let mut joined = (ExactSum::default(), ExactSquares::default());
            for part in cuts.windows(2).rev() {
                let part = sums(&values[part[0]..part[1]]);
                // Over a file, as parts come from other machines.
                let written = bytes(&part);
                let mut rest = &written[..];
                joined.0.merge(&ExactSum::decode(&mut rest).unwrap());
                joined.1.merge(&ExactSquares::decode(&mut rest).unwrap());
                prop_assert!(rest.is_empty());
            }
            prop_assert_eq!(bytes(&whole), bytes(&joined));
            prop_assert_eq!(whole.0.to_f64().to_bits(), joined.0.to_f64().to_bits());
        }

        #[test]
        fn sums_are_right(values in prop::collection::vec((-(1i32 << 24)..1 << 24, -20i32..20), 2..200)) {
            // As whole multiples of 2⁻²⁰, in arithmetic that cannot round.
            let values: Vec<(f32, i128)> =
                values.into_iter().map(|(m, e)| (m as f32 * 2f32.powi(e), i128::from(m) << (e + 20))).collect();
            let floats: Vec<f32> = values.iter().map(|v| v.0).collect();
            let (sum, squares) = sums(&floats);
            let (total, n) = (values.iter().map(|v| v.1).sum::<i128>(), values.len());
            let close = |a: f64, b: f64| (a - b).abs() <= 1e-15 * b.abs();
            prop_assert!(close(sum.to_f64() * 2f64.powi(20), total as f64), "{} {total}", sum.to_f64());
            let spread = squares.spread(&sum, n as u32);
            // Deviations from the first value, so that little cancels.
            let first = f64::from(floats[0]);
            let (s, q) = floats.iter().fold((0.0, 0.0), |(s, q), &x| (s + f64::from(x) - first, q + (f64::from(x) - first).powi(2)));
            let expected = n as f64 * q - s * s;
            prop_assert!(spread >= 0.0 && (spread - expected).abs() <= 1e-12 * n as f64 * q, "{spread} {expected}");
        }

        #[test]
        fn damaged_bytes_are_no_panic(damaged in prop::collection::vec(any::<u8>(), 0..200)) {
            let (mut a, mut b) = (&damaged[..], &damaged[..]);
            if let (Some(sum), Some(squares)) = (ExactSum::decode(&mut a), ExactSquares::decode(&mut b)) {
                let (mut other, mut more) = (sum, squares);
                (0..3).for_each(|_| (other.merge(&sum), more.merge(&squares)).0);
                let _ = (other.to_f64(), more.spread(&other, u32::MAX));
            }
        }
    }

    #[test]
    fn equal_numbers_have_no_spread_and_small_ones_are_not_lost() {
        let (sum, squares) = sums(&[0.3; 1000]);
        assert_eq!((squares.spread(&sum, 1000), sum.to_f64()), (0.0, 1000.0 * f64::from(0.3f32)));
        let (sum, _) = sums(&[1e30, 1e-30, -1e30]);
        assert_eq!(sum.to_f64() as f32, 1e-30);
        assert_eq!(sums(&[-2.5, 1.0]).0.to_f64(), -1.5);
        assert_eq!(sums(&[f32::MAX; 300]).0.to_f64(), 300.0 * f64::from(f32::MAX));
        let (sum, squares) = sums(&[1.0, 2.0, 4.0, 9.0]);
        assert_eq!(squares.spread(&sum, 4), 4.0 * 102.0 - 256.0);
    }

    #[test]
    fn what_is_no_number_stays_so() {
        let mut sum = ExactSum::default();
        sum.add(f32::NEG_INFINITY);
        sum.add(1.0);
        sum.carry();
        let mut written = Vec::new();
        sum.encode(&mut written);
        let mut other = ExactSum::default();
        other.add(-3.0);
        other.merge(&ExactSum::decode(&mut &written[..]).unwrap());
        other.merge(&sum);
        assert!(sum.to_f64().is_nan() && other.to_f64().is_nan());
    }
}
