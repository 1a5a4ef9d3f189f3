//! Running moments and the tests of hypotheses that comparisons of images and of samplers rest on.
//!
//! Sources: Welford 1962 (*Note on a Method for Calculating Corrected Sums of Squares and Products*) and Chan, Golub and
//! LeVeque 1979 for the moments; the incomplete gamma and beta functions by series and by Lentz's continued fractions
//! as in *Numerical Recipes* §6.2–6.4; Šidák 1967 for many tests at once.

use std::f64::consts::{PI, SQRT_2};

/// Mean and variance of numbers that arrive one after another, without the cancellation of a sum of squares.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Moments {
    count: u64,
    mean: f64,
    /// Sum of squared differences from the mean.
    m2: f64,
}

impl Moments {
    /// Takes in one number.
    #[inline]
    pub fn push(&mut self, x: f64) {
        self.count += 1;
        let delta = x - self.mean;
        self.mean += delta / self.count as f64;
        self.m2 += delta * (x - self.mean);
    }

    /// Takes in all the numbers that `other` has seen. Rounding depends on the order, so merge in a fixed one.
    pub fn merge(&mut self, other: &Self) {
        if other.count == 0 {
            return;
        }
        let (n, m) = (self.count as f64, other.count as f64);
        let delta = other.mean - self.mean;
        self.mean += delta * (m / (n + m));
        self.m2 += other.m2 + delta * delta * (n * m / (n + m));
        self.count += other.count;
    }

    /// How many numbers were taken in.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Their mean; 0 when there are none.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Unbiased variance of one number; 0 for fewer than two.
    pub fn variance(&self) -> f64 {
        if self.count < 2 { 0.0 } else { self.m2 / (self.count - 1) as f64 }
    }

    /// Variance of the mean: that of one number divided by the count; 0 for fewer than two.
    pub fn variance_of_mean(&self) -> f64 {
        if self.count < 2 { 0.0 } else { self.variance() / self.count as f64 }
    }
}

impl FromIterator<f64> for Moments {
    fn from_iter<I: IntoIterator<Item = f64>>(numbers: I) -> Self {
        let mut moments = Self::default();
        for x in numbers {
            moments.push(x);
        }
        moments
    }
}

/// Probability that a standard normal variable is at most `x`; relative error about 1e-12 in the lower tail too.
pub fn normal_cdf(x: f64) -> f64 {
    // erfc(z) = Q(1/2, z²) for z ≥ 0.
    let tail = 0.5 * gamma_q(0.5, 0.5 * x * x);
    if x < 0.0 { tail } else { 1.0 - tail }
}

/// The `x` with [`normal_cdf`]`(x) = p`; infinite at 0 and 1, NaN outside [0, 1].
pub fn normal_quantile(p: f64) -> f64 {
    if !(0.0..=1.0).contains(&p) {
        return f64::NAN;
    }
    if p > 0.5 {
        return -normal_quantile(1.0 - p);
    }
    if p == 0.0 {
        return f64::NEG_INFINITY;
    }
    // Abramowitz and Stegun 26.2.23, good to 4.5e-4, then Halley's iteration on the accurate tail.
    let t = (-2.0 * p.ln()).sqrt();
    let numerator = 2.515517 + t * (0.802853 + t * 0.010328);
    let denominator = 1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308));
    let mut x = numerator / denominator - t;
    for _ in 0..3 {
        let density = (-0.5 * x * x).exp() / (2.0 * PI).sqrt();
        let step = (normal_cdf(x) - p) / density;
        x -= step / (1.0 + 0.5 * x * step);
    }
    x
}

/// Probability that a chi-square variable with `degrees` (> 0) degrees of freedom is at most `x`.
pub fn chi_square_cdf(x: f64, degrees: f64) -> f64 {
    if x <= 0.0 { 0.0 } else { 1.0 - gamma_q(0.5 * degrees, 0.5 * x) }
}

/// Probability that Student's t with `degrees` (> 0) degrees of freedom is at most `t`; about 1e-12 at few degrees, 1e-7
/// at 1e9, where the logarithms of the gamma function cancel.
pub fn student_t_cdf(t: f64, degrees: f64) -> f64 {
    let tail = 0.5 * incomplete_beta(0.5 * degrees, 0.5, degrees / (degrees + t * t));
    if t < 0.0 { tail } else { 1.0 - tail }
}

/// Two-sided p-value of a standard normal score: the probability of one at least as far from 0.
pub fn z_test(z: f64) -> f64 {
    gamma_q(0.5, 0.5 * z * z)
}

/// Two-sided p-value of "the numbers have mean `expected`", their variance being estimated from themselves. 1 for
/// numbers that all equal `expected`, 0 for numbers that all equal something else, 1 for fewer than two.
pub fn t_test(numbers: &Moments, expected: f64) -> f64 {
    let difference = numbers.mean() - expected;
    if numbers.count() < 2 || difference == 0.0 {
        return 1.0;
    }
    let squared = difference * difference / numbers.variance_of_mean();
    let degrees = (numbers.count() - 1) as f64;
    incomplete_beta(0.5 * degrees, 0.5, degrees / (degrees + squared))
}

/// p-value of "the `observed` counts come from a distribution that expects `expected` in each cell". Cells that expect
/// fewer than 5 are pooled, because the statistic is chi-square only for large cells; one that expects none and
/// received some gives 0.
///
/// # Panics
/// When the slices differ in length.
pub fn chi_square_test(observed: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(observed.len(), expected.len(), "one expectation for each cell");
    let (mut statistic, mut cells) = (0.0, 0usize);
    let (mut pooled_observed, mut pooled_expected) = (0.0, 0.0);
    for (&o, &e) in observed.iter().zip(expected) {
        if e <= 0.0 && o > 0.0 {
            return 0.0;
        }
        if e >= 5.0 {
            statistic += (o - e) * (o - e) / e;
            cells += 1;
        } else {
            pooled_observed += o;
            pooled_expected += e;
        }
    }
    if pooled_expected > 0.0 {
        let difference: f64 = pooled_observed - pooled_expected;
        statistic += difference * difference / pooled_expected;
        cells += 1;
    }
    if cells < 2 { 1.0 } else { gamma_q(0.5 * (cells - 1) as f64, 0.5 * statistic) }
}

/// The level at which each of `count` independent tests must be held so that all of them together have level `alpha`
/// (Šidák): 1 − (1 − alpha)^(1/count).
pub fn sidak(alpha: f64, count: usize) -> f64 {
    sidak_effective(alpha, count as f64)
}

/// As [`sidak`] for tests that depend on each other, of which `count` independent ones would do as much.
pub fn sidak_effective(alpha: f64, count: f64) -> f64 {
    -((-alpha).ln_1p() / count.max(1.0)).exp_m1()
}

/// How many independent variables are worth as much as some that correlate: 1 for equal ones, their number for independent ones
/// (Nyholt 2004, *A Simple Correction for Multiple Testing for SNPs in Linkage Disequilibrium*: by the variance of the eigenvalues of
/// their correlations, which needs no eigenvalues). Variables that never vary count as independent.
///
/// # Panics
/// When the variables have different numbers of values.
pub fn effective_count(variables: &[Vec<f64>]) -> f64 {
    let count = variables.len() as f64;
    if variables.len() < 2 {
        return count;
    }
    let moments: Vec<Moments> = variables.iter().map(|values| values.iter().copied().collect()).collect();
    let correlation = |i: usize, j: usize| {
        let scale = (moments[i].variance() * moments[j].variance()).sqrt() * (variables[i].len().max(2) - 1) as f64;
        assert_eq!(variables[i].len(), variables[j].len(), "one value for each");
        let pairs = variables[i].iter().zip(&variables[j]);
        let sum: f64 = pairs.map(|(a, b)| (a - moments[i].mean()) * (b - moments[j].mean())).sum();
        if scale > 0.0 { sum / scale } else { 0.0 }
    };
    let squares: f64 = (0..variables.len())
        .flat_map(|i| (0..variables.len()).map(move |j| (i, j)))
        .map(|(i, j)| if i == j { 1.0 } else { correlation(i, j).powi(2) })
        .sum();
    let spread = (squares - count) / (count - 1.0);
    1.0 + (count - 1.0) * (1.0 - spread / count)
}

/// Natural logarithm of the gamma function for `x` > 0 (Lanczos, g = 7, nine terms; relative error about 1e-14).
fn ln_gamma(x: f64) -> f64 {
    const TERMS: [f64; 9] = [
        0.999_999_999_999_809_9,
        676.520_368_121_885_1,
        -1_259.139_216_722_402_8,
        771.323_428_777_653_1,
        -176.615_029_162_140_6,
        12.507_343_278_686_905,
        -0.138_571_095_265_720_12,
        9.984_369_578_019_572e-6,
        1.505_632_735_149_311_6e-7,
    ];
    if x < 0.5 {
        return (PI / (PI * x).sin()).ln() - ln_gamma(1.0 - x);
    }
    let x = x - 1.0;
    let sum: f64 = TERMS[0] + (1..9).map(|i| TERMS[i] / (x + i as f64)).sum::<f64>();
    let t = x + 7.5;
    0.5 * (2.0 * PI).ln() + (x + 0.5) * t.ln() - t + sum.ln()
}

/// Terms after which series and continued fractions give up; they need about the square root of their arguments.
const TERMS_MAX: usize = 100_000;

/// Upper regularised incomplete gamma function Q(a, x) for a > 0, x ≥ 0.
fn gamma_q(a: f64, x: f64) -> f64 {
    if x.is_nan() {
        return f64::NAN;
    }
    if x == 0.0 {
        return 1.0;
    }
    if x.is_infinite() {
        return 0.0;
    }
    let front = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum) = (1.0 / a, 1.0 / a);
        for i in 1..TERMS_MAX {
            term *= x / (a + i as f64);
            sum += term;
            if term < sum * 1e-16 {
                break;
            }
        }
        return 1.0 - front * sum;
    }
    let mut b = x + 1.0 - a;
    let (mut c, mut d) = (1.0 / TINY, 1.0 / b);
    let mut value = d;
    for i in 1..TERMS_MAX {
        let i = i as f64;
        let numerator = -i * (i - a);
        b += 2.0;
        d = 1.0 / away_from_zero(numerator * d + b);
        c = away_from_zero(b + numerator / c);
        value *= d * c;
        if (d * c - 1.0).abs() < 1e-16 {
            break;
        }
    }
    front * value
}

/// Regularised incomplete beta function I_x(a, b) for a, b > 0.
fn incomplete_beta(a: f64, b: f64, x: f64) -> f64 {
    if x.is_nan() {
        return f64::NAN;
    }
    if x <= 0.0 || x >= 1.0 {
        return x.clamp(0.0, 1.0);
    }
    let front = (ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b) + a * x.ln() + b * (-x).ln_1p()).exp();
    // The fraction converges quickly only on this side of the mean.
    if x < (a + 1.0) / (a + b + 2.0) {
        front * beta_fraction(a, b, x) / a
    } else {
        1.0 - front * beta_fraction(b, a, 1.0 - x) / b
    }
}

fn beta_fraction(a: f64, b: f64, x: f64) -> f64 {
    let (mut c, mut d) = (1.0, 1.0 / away_from_zero(1.0 - (a + b) * x / (a + 1.0)));
    let mut value = d;
    for i in 1..TERMS_MAX {
        let m = i as f64;
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        for numerator in [even, odd] {
            d = 1.0 / away_from_zero(1.0 + numerator * d);
            c = away_from_zero(1.0 + numerator / c);
            value *= d * c;
        }
        if (d * c - 1.0).abs() < 1e-16 {
            break;
        }
    }
    value
}

/// Stands for zero in a denominator of Lentz's method.
const TINY: f64 = 1e-300;

fn away_from_zero(x: f64) -> f64 {
    if x.abs() < TINY { TINY } else { x }
}

/// The error function 2/√π ∫₀ˣ exp(−t²) dt.
pub fn erf(x: f64) -> f64 {
    2.0 * normal_cdf(x * SQRT_2) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::Seed;

    fn close(actual: f64, expected: f64, relative: f64) {
        assert!((actual - expected).abs() <= relative * expected.abs(), "{actual:e} is not {expected:e}");
    }

    #[test]
    fn moments_survive_a_large_offset_and_merging_equals_pushing() {
        let numbers: Vec<f64> = (0..1000).map(|i| 1e9 + f64::from(i % 10)).collect();
        let whole: Moments = numbers.iter().copied().collect();
        close(whole.mean(), 1e9 + 4.5, 1e-15);
        close(whole.variance(), 8.25 * 1000.0 / 999.0, 1e-6);
        close(whole.variance_of_mean(), whole.variance() / 1000.0, 1e-15);
        let mut merged = Moments::default();
        for part in numbers.chunks(77) {
            merged.merge(&part.iter().copied().collect());
        }
        assert_eq!(merged.count(), 1000);
        close(merged.mean(), whole.mean(), 1e-15);
        close(merged.variance(), whole.variance(), 1e-6);
    }

    #[test]
    fn moments_of_nothing_and_of_one_number_are_finite() {
        let mut moments = Moments::default();
        moments.merge(&Moments::default());
        assert_eq!((moments.mean(), moments.variance(), moments.variance_of_mean()), (0.0, 0.0, 0.0));
        moments.push(3.0);
        assert_eq!((moments.mean(), moments.variance()), (3.0, 0.0));
    }

    // Tables: Abramowitz and Stegun, chapters 7 and 26.
    #[test]
    fn normal_distribution_agrees_with_tables() {
        close(normal_cdf(0.0), 0.5, 1e-15);
        close(normal_cdf(1.0), 0.841_344_746_068_542_9, 1e-12);
        close(normal_cdf(-1.96), 0.024_997_895_148_220_4, 1e-11);
        close(normal_cdf(-6.0), 9.865_876_450_376_98e-10, 1e-10);
        close(normal_cdf(-10.0), 7.619_853_024_160_527e-24, 1e-10);
        close(erf(0.5), 0.520_499_877_813_046_5, 1e-12);
        close(z_test(1.959_963_984_540_054), 0.05, 1e-10);
        assert_eq!(z_test(f64::INFINITY), 0.0);
    }

    #[test]
    fn quantile_inverts_the_distribution_far_into_the_tail() {
        close(normal_quantile(0.975), 1.959_963_984_540_054, 1e-12);
        for p in [1e-12, 1e-6, 0.01, 0.3, 0.5, 0.7, 0.999] {
            close(normal_cdf(normal_quantile(p)), p, 1e-11);
        }
        assert_eq!(normal_quantile(0.0), f64::NEG_INFINITY);
        assert_eq!(normal_quantile(1.0), f64::INFINITY);
        assert!(normal_quantile(1.5).is_nan());
    }

    #[test]
    fn chi_square_and_student_agree_with_tables() {
        close(chi_square_cdf(3.841_458_820_694_124, 1.0), 0.95, 1e-10);
        close(chi_square_cdf(18.307_038_053_275_14, 10.0), 0.95, 1e-10);
        close(chi_square_cdf(1000.0, 1000.0), 0.505_947_147_148_7, 1e-6);
        close(student_t_cdf(12.706_204_736_432_1, 1.0), 0.975, 1e-10);
        close(student_t_cdf(2.228_138_851_964_94, 10.0), 0.975, 1e-10);
        close(student_t_cdf(-1.0, 1.0), 0.25, 1e-12);
        close(student_t_cdf(1.959_963_984_540_054, 1e9), 0.975, 1e-6);
    }

    #[test]
    fn t_test_finds_a_shift_and_accepts_none() {
        let numbers: Moments = (0..10_000).map(|i| f64::from(Seed(5).uniform(i))).collect();
        assert!(t_test(&numbers, 0.5) > 1e-3, "{}", t_test(&numbers, 0.5));
        assert!(t_test(&numbers, 0.52) < 1e-6);
        let constant: Moments = [2.0; 10].into_iter().collect();
        assert_eq!((t_test(&constant, 2.0), t_test(&constant, 2.1)), (1.0, 0.0));
    }

    #[test]
    fn chi_square_test_finds_a_wrong_density() {
        let mut counts = [0.0; 20];
        for i in 0..20_000 {
            counts[(Seed(9).uniform(i) * 20.0) as usize] += 1.0;
        }
        assert!(chi_square_test(&counts, &[1000.0; 20]) > 1e-3);
        let tilted: Vec<f64> = (0..20).map(|i| 1000.0 + 10.0 * (f64::from(i) - 9.5)).collect();
        assert!(chi_square_test(&counts, &tilted) < 1e-3);
        assert_eq!(chi_square_test(&[1.0, 99.0], &[0.0, 100.0]), 0.0);
    }

    #[test]
    fn equal_variables_count_once_and_independent_ones_each() {
        let noise = |key: u64| (0..4000).map(|i| f64::from(Seed(key).uniform(i))).collect::<Vec<f64>>();
        let scaled: Vec<f64> = noise(1).iter().map(|x| 3.0 - 2.0 * x).collect();
        close(effective_count(&[noise(1), scaled.clone(), noise(1)]), 1.0, 1e-9);
        close(effective_count(&[noise(1), noise(2), noise(3)]), 3.0, 0.01);
        close(effective_count(&[noise(1), scaled, noise(3)]), 2.333, 0.01);
        close(effective_count(&[vec![0.0; 9], vec![0.0; 9]]), 2.0, 1e-12);
    }

    #[test]
    fn sidak_levels_combine_to_the_whole() {
        close(1.0 - (1.0 - sidak(0.05, 100)).powi(100), 0.05, 1e-12);
        close(sidak(0.01, 1_000_000), 1.005_033_5e-8, 1e-6);
        close(sidak(0.01, 1), 0.01, 1e-15);
    }
}
