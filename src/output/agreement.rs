//! Whether two noisy pictures can be measurements of the same light: a test of hypotheses, not a tolerance.
//!
//! Three tests of the differences d in the channels of a layer, which together raise a false alarm with probability `alpha`:
//!
//! 1. *pixels*: |d| against its standard deviation in each pixel, with Šidák's correction for the number of pixels; a
//!    small share may fail, because the tails of light are heavier than a normal distribution's.
//! 2. *blocks*: the mean of d in each block of 16 × 16 pixels, all of which must pass. Finds faults of a region that are
//!    too small for one pixel's noise.
//! 3. *image*: the mean over the whole picture of d in units of its standard deviation. Finds a small bias everywhere.
//!
//! Under the hypothesis both pictures have the same variance per sample, so where both say how many samples they took
//! the two estimates are pooled; this keeps a low estimate in a pixel that happened to miss its bright paths from
//! raising an alarm.
//!
//! Where variances were measured between a few runs, those of a pixel and its neighbours are joined; where errors of neighbours are
//! alike, as in pictures whose paths are splatted, blocks and the picture are taken to be so much noisier (both: [`noise`]).
//!
//! The variances in our pictures are upper bounds (`docs/decisions.md`), so the test of pixels raises fewer false alarms than
//! `alpha` and finds less; the others measure the noise in the picture itself where that is less.
//!
//! The idea of testing renders against mean and variance is that of Mitsuba 3's render tests and of
//! Subr and Arvo 2007 (*Statistical Hypothesis Testing for Assessing Monte Carlo Estimators*).

use crate::math::statistics::{
    Moments, effective_count, normal_quantile, sidak, sidak_effective, student_t_cdf, z_test,
};
use crate::output::compare::{CompareError, Report, check_finite};
use crate::output::image::{Attribute, Image};
use crate::output::noise;
use std::ops::Range;

/// Attribute that says how many samples a pixel has.
pub const SPP_ATTRIBUTE: &str = "curlsmoke/spp";

/// Attribute of a reference that says between how many pictures its variance was measured.
pub const RUNS_ATTRIBUTE: &str = "curlsmoke/runs";

/// Width of the blocks whose means are tested [pixels].
const BLOCK: usize = 16;

/// Levels of the tests.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StatisticalSettings {
    /// Probability that the tests together raise a false alarm, 0 to 1. Default 0.01.
    pub alpha: f64,
    /// Share of pixels that must pass theirs, 0 to 1. Default 0.9975.
    pub pixel_share: f64,
}

impl Default for StatisticalSettings {
    fn default() -> Self {
        Self { alpha: 0.01, pixel_share: 0.9975 }
    }
}

/// Differences in one channel, with the variance that noise gives them.
struct Channel {
    difference: Vec<f64>,
    /// Variance of the difference, without the floor.
    variance: Vec<f64>,
    /// Degrees of freedom of each variance; infinite when unknown.
    degrees: f64,
    /// Whether the variances were measured between runs: then they are no upper bounds.
    is_measured: bool,
    /// What rounding in the files may add, as a standard deviation.
    rounding: Vec<f64>,
}

/// A noisy layer: what was measured, and what is known of its noise.
pub(crate) struct Measurement<'a> {
    /// The means, channel by channel.
    pub means: Vec<&'a [f32]>,
    /// Variances of the means, in the same order.
    pub variances: Option<Vec<&'a [f32]>>,
    /// Samples of a pixel.
    pub spp: Option<f64>,
    /// Pictures that the variances were measured between; none where each picture measured its own.
    pub runs: Option<f64>,
    /// Whether the file holds 16 bits for each number.
    pub is_half: bool,
}

/// Samples of a pixel, as far as a picture says.
pub(crate) fn spp_of(image: &Image) -> Option<f64> {
    match image.attribute(SPP_ATTRIBUTE) {
        Some(Attribute::Int(spp)) if *spp > 0 => Some(f64::from(*spp)),
        _ => None,
    }
}

/// Pictures that a reference is the mean of, as far as it says.
pub(crate) fn runs_of(image: &Image) -> Option<f64> {
    match image.attribute(RUNS_ATTRIBUTE) {
        Some(Attribute::Int(runs)) if *runs > 1 => Some(f64::from(*runs)),
        _ => None,
    }
}

/// Number of tests that share `alpha`.
const TEST_COUNT: usize = 3;

/// Runs the three tests and adds their findings to `report`; `image` says where pixels are.
///
/// # Errors
/// When nothing says how noisy the layers are, or a level is out of range.
pub(crate) fn test(
    image: &Image,
    ours: &Measurement,
    theirs: &Measurement,
    settings: StatisticalSettings,
    report: &mut Report,
) -> Result<(), CompareError> {
    for (name, value) in [("alpha", settings.alpha), ("pixel share", settings.pixel_share)] {
        if !(value > 0.0 && value < 1.0) {
            return Err(CompareError::Setting { name, allowed: "between 0 and 1", value });
        }
    }
    let noise = Noise { ours, theirs };
    if ours.variances.is_none() && theirs.variances.is_none() {
        return Err(CompareError::NoVariance);
    }
    report.map = vec![0.0; image.pixel_count()];
    check_finite(image, &ours.means, &theirs.means, report);
    if !report.passed() {
        return Ok(());
    }
    let [relative, absolute] = [0, 1].map(|i| rounding_of(ours)[i].max(rounding_of(theirs)[i]));
    let rounding = |a: f32, b: f32| (f64::from(a.abs().max(b.abs())) * relative).max(absolute);
    let channels: Vec<Channel> = (0..ours.means.len())
        .map(|c| {
            let pairs = || ours.means[c].iter().zip(theirs.means[c]);
            let (variance, degrees) = noise.of_difference(c, image.data_size[0] as usize);
            let mut channel = Channel {
                difference: pairs().map(|(&a, &b)| f64::from(a) - f64::from(b)).collect(),
                variance,
                degrees,
                is_measured: noise.runs().is_some(),
                rounding: pairs().map(|(&a, &b)| rounding(a, b)).collect(),
            };
            // What is the same and no number in both has neither difference nor noise.
            for (i, _) in pairs().enumerate().filter(|(_, (a, b))| !a.is_finite() && !b.is_finite()) {
                (channel.difference[i], channel.variance[i], channel.rounding[i]) = (0.0, 0.0, 0.0);
            }
            channel
        })
        .collect();
    check_variances(image, &channels, report);
    if !report.passed() {
        return Ok(());
    }
    let level = sidak(settings.alpha, TEST_COUNT);
    test_pixels(&channels, level, settings.pixel_share, report);
    let units: Vec<Vec<f64>> = channels.iter().map(units).collect();
    // Channels of grey light are the same three times, and must not be paid for three times.
    let count = effective_count(&units);
    let width = image.data_size[0] as usize;
    let correlations: Vec<f64> = units.iter().map(|units| noise::correlation(units, width, BLOCK)).collect();
    test_blocks(image, &channels, &correlations, [level, count], report);
    test_whole(&channels, &units, &correlations, sidak_effective(level, count), report);
    Ok(())
}

/// Fails where a variance is no variance: an infinite one would excuse every difference in its pixel and its block.
fn check_variances(image: &Image, channels: &[Channel], report: &mut Report) {
    let is_bad = |v: f64| !(v.is_finite() && v >= 0.0);
    let any_bad = |&i: &usize| channels.iter().any(|c| is_bad(c.variance[i]));
    let bad: Vec<usize> = (0..image.pixel_count()).filter(any_bad).collect();
    let Some(&first) = bad.first() else { return };
    bad.iter().for_each(|&i| report.map[i] = f32::INFINITY);
    let [x, y] = image.position(first);
    let text = format!(
        "the variance of {} pixels is infinite, negative or not a number, first ({x}, {y}); a picture of 1 sample per \
         pixel has no variance: render with 2 or more",
        bad.len()
    );
    report.find("finite", false, text);
}

/// Largest error that storing a number makes: relative, and absolute near zero.
fn rounding_of(layer: &Measurement) -> [f64; 2] {
    if layer.is_half { [2f64.powi(-11), 2f64.powi(-25)] } else { [2f64.powi(-23), 0.0] }
}

/// What is known of the variance of the means in both pictures.
struct Noise<'m, 'a> {
    ours: &'m Measurement<'a>,
    theirs: &'m Measurement<'a>,
}

impl Noise<'_, '_> {
    /// Pictures that the only variances there are were measured between.
    fn runs(&self) -> Option<f64> {
        match (&self.ours.variances, &self.theirs.variances) {
            (Some(_), None) => self.ours.runs,
            (None, Some(_)) => self.theirs.runs,
            _ => None,
        }
    }

    /// Degrees of freedom of the variance of a difference; infinite when unknown.
    fn degrees(&self) -> f64 {
        let known = |layer: &Measurement| match (&layer.variances, layer.runs.or(layer.spp)) {
            (Some(_), Some(count)) => Some((count - 1.0).max(1.0)),
            _ => None,
        };
        match (known(self.ours), known(self.theirs)) {
            (Some(a), Some(b)) => a + b,
            (Some(a), None) if self.theirs.variances.is_none() => a,
            (None, Some(b)) if self.ours.variances.is_none() => b,
            _ => f64::INFINITY,
        }
    }

    /// Variance of the difference in each pixel of channel `c` of pictures of this width, and its degrees of freedom.
    fn of_difference(&self, c: usize, width: usize) -> (Vec<f64>, f64) {
        let variance = self.of_each_pixel(c);
        match self.runs() {
            // What is no variance is found by who asks for it next.
            Some(runs) if variance.iter().all(|v| v.is_finite() && *v >= 0.0) => {
                let pooled = noise::pooled(&variance, width, (runs - 1.0).max(1.0));
                (pooled.variance, pooled.degrees)
            }
            _ => (variance, self.degrees()),
        }
    }

    fn of_each_pixel(&self, c: usize) -> Vec<f64> {
        fn values<'v>(variance: &[&'v [f32]], c: usize) -> impl Iterator<Item = f64> + use<'v> {
            variance[c].iter().map(|&v| f64::from(v))
        }
        match (&self.ours.variances, &self.theirs.variances, self.ours.spp, self.theirs.spp) {
            (Some(a), Some(b), Some(n), Some(m)) => {
                let pooled = |a: f64, b: f64| {
                    let degrees = [(n - 1.0).max(0.0), (m - 1.0).max(0.0)];
                    let sum = (degrees[0] + degrees[1]).max(1.0);
                    (a * n * degrees[0] + b * m * degrees[1]) / sum * (1.0 / n + 1.0 / m)
                };
                values(a, c).zip(values(b, c)).map(|(a, b)| pooled(a, b)).collect()
            }
            (Some(a), Some(b), ..) => values(a, c).zip(values(b, c)).map(|(a, b)| a + b).collect(),
            (Some(a), None, n, m) => scaled(values(a, c), n, m),
            (None, Some(b), n, m) => scaled(values(b, c), m, n),
            (None, None, ..) => Vec::new(),
        }
    }
}

/// Variance of the difference when only one picture, with `known` samples, says how noisy it is. Without counts the
/// other is taken to be free of noise.
fn scaled(values: impl Iterator<Item = f64>, known: Option<f64>, other: Option<f64>) -> Vec<f64> {
    let factor = match (known, other) {
        (Some(known), Some(other)) => 1.0 + known / other,
        _ => 1.0,
    };
    values.map(|v| v * factor).collect()
}

fn test_pixels(channels: &[Channel], level: f64, pixel_share: f64, report: &mut Report) {
    let count = report.map.len();
    let p = sidak(level, count * channels.len());
    let limits: Vec<f64> = channels.iter().map(|c| critical_value(p, c.degrees)).collect();
    let mut failed = 0usize;
    let mut worst = 0.0f64;
    for i in 0..count {
        let mut has_failed = false;
        for (c, limit) in channels.iter().zip(&limits) {
            // Noise spreads, rounding does not: only what rounding cannot explain counts.
            let excess = (c.difference[i].abs() - c.rounding[i]).max(0.0);
            let score = ratio(excess, c.variance[i].sqrt());
            report.map[i] = report.map[i].max(score as f32);
            has_failed |= score > *limit;
        }
        failed += usize::from(has_failed);
        worst = worst.max(report.map[i].into());
    }
    let share = 1.0 - failed as f64 / count.max(1) as f64;
    let limit = limits.iter().copied().fold(0.0, f64::max);
    let text = format!(
        "{:.3} % of {count} agree, at least {:.2} % must (within {limit:.2} standard deviations; worst {worst:.2})",
        share * 100.0,
        pixel_share * 100.0
    );
    report.find("pixels", share >= pixel_share, text);
}

/// Degrees of freedom beyond which Student's t is normal.
const DEGREES_MANY: f64 = 1e5;

/// Two-sided critical value of Student's t, or of the normal distribution for infinite degrees of freedom.
fn critical_value(p: f64, degrees: f64) -> f64 {
    let normal = -normal_quantile(0.5 * p);
    if degrees > DEGREES_MANY {
        return normal;
    }
    let (mut low, mut high) = (normal, 2.0 * normal);
    while 2.0 * student_t_cdf(-high, degrees) > p && high < 1e12 {
        high *= 2.0;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if 2.0 * student_t_cdf(-middle, degrees) > p { low = middle } else { high = middle }
    }
    high
}

/// x/y, 0 for 0/0.
fn ratio(x: f64, y: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x / y }
}

fn test_blocks(
    image: &Image,
    channels: &[Channel],
    correlations: &[f64],
    [level, channel_count]: [f64; 2],
    report: &mut Report,
) {
    let [width, height] = image.data_size.map(|n| n as usize);
    let (columns, rows) = (width.div_ceil(BLOCK), height.div_ceil(BLOCK));
    let p = sidak_effective(level, (columns * rows) as f64 * channel_count);
    let mut failed = 0usize;
    let mut worst = (1.0f64, 0.0f64, [0, 0]);
    for block in 0..columns * rows {
        let (x0, y0) = (block % columns * BLOCK, block / columns * BLOCK);
        let pixels = || {
            let xs = x0..(x0 + BLOCK).min(width);
            (y0..(y0 + BLOCK).min(height)).flat_map(move |y| xs.clone().map(move |x| y * width + x))
        };
        let scores = channels.iter().zip(correlations).map(|(c, correlation)| block_score(c, *correlation, pixels()));
        let (score, probability) =
            scores.fold((0.0, 1.0), |a, b| if b.1 < a.1 || b.0 > a.0 && b.1 == a.1 { b } else { a });
        failed += usize::from(probability < p);
        if probability < worst.0 || probability == worst.0 && score > worst.1 {
            worst = (probability, score, image.position(y0 * width + x0));
        }
    }
    let text = format!(
        "{failed} of {} blocks of {BLOCK} × {BLOCK} pixels differ; worst by {:.2} standard deviations at ({}, {})",
        columns * rows,
        worst.1,
        worst.2[0],
        worst.2[1]
    );
    report.find("blocks", failed == 0, text);
}

/// Fewest pixels with noise from whose differences the noise of their mean is taken.
const SPREAD_COUNT_MIN: f64 = 30.0;

/// Standard deviations by which the mean difference of the pixels is off, beyond rounding, and how probable that much is.
///
/// The spread of the differences within the block is a measure of noise as well, and a smaller one where stratified samples make
/// pixels quieter than their variance says. It is used where it is less, where enough pixels have noise, and where variances are
/// upper bounds.
fn block_score(channel: &Channel, correlation: f64, pixels: impl Iterator<Item = usize>) -> (f64, f64) {
    let (mut differences, mut variance, mut squares, mut rounding) = (Moments::default(), 0.0, 0.0, 0.0);
    for i in pixels {
        differences.push(channel.difference[i]);
        variance += channel.variance[i];
        squares += channel.variance[i] * channel.variance[i];
        rounding += systematic_rounding(channel, i);
    }
    let count = differences.count() as f64;
    let excess = (differences.mean().abs() * count - rounding).max(0.0);
    let noisy = variance * variance / squares.max(f64::MIN_POSITIVE);
    let spread = differences.variance() * count;
    if !channel.is_measured && noisy >= SPREAD_COUNT_MIN && spread < variance {
        let score = ratio(excess, (spread * correlation).sqrt());
        return (score, probability(score, noisy - 1.0));
    }
    let score = ratio(excess, (variance * correlation).sqrt());
    // Satterthwaite's degrees of freedom of a sum of variances.
    let degrees = if channel.is_measured { noisy.max(1.0) * channel.degrees } else { f64::INFINITY };
    (score, probability(score, degrees))
}

/// Two-sided probability of a score whose standard deviation is known with so many degrees of freedom.
fn probability(score: f64, degrees: f64) -> f64 {
    if degrees > DEGREES_MANY { z_test(score) } else { 2.0 * student_t_cdf(-score, degrees) }
}

/// Rounding averages out in a noisy pixel, but repeats itself where neighbouring pixels have no noise.
fn systematic_rounding(channel: &Channel, i: usize) -> f64 {
    if channel.variance[i].sqrt() < channel.rounding[i] { channel.rounding[i] } else { 0.0 }
}

fn test_whole(channels: &[Channel], units: &[Vec<f64>], correlations: &[f64], p: f64, report: &mut Report) {
    let (mut least, mut worst) = (1.0f64, 0.0f64);
    let mut bias = 0.0;
    for ((channel, units), correlation) in channels.iter().zip(units).zip(correlations) {
        let (score, probability) = whole_score(channel, units, *correlation);
        if score >= worst {
            worst = score;
            bias = channel.difference.iter().sum::<f64>() / channel.difference.len().max(1) as f64;
        }
        least = least.min(probability);
    }
    let text = format!("mean difference {bias:+.3e}, {worst:.2} standard deviations");
    report.find("image", least >= p, text);
}

/// Runs of pixels and the mean noise of each: a measure of a pixel's noise that hardly depends on its own luck.
fn runs(channel: &Channel) -> impl Iterator<Item = (Range<usize>, f64)> {
    let count = channel.difference.len();
    (0..count).step_by(BLOCK * BLOCK).map(move |start| {
        let run = start..(start + BLOCK * BLOCK).min(count);
        let noise = channel.variance[run.clone()].iter().sum::<f64>() / run.len() as f64;
        (run, noise)
    })
}

/// The differences in units of the noise of their run; 0 where there is no noise.
fn units(channel: &Channel) -> Vec<f64> {
    runs(channel)
        .flat_map(|(run, noise)| {
            run.map(move |i| ratio(if noise > 0.0 { channel.difference[i] } else { 0.0 }, noise.sqrt()))
        })
        .collect()
}

/// Standard deviations by which the picture as a whole is off, and how probable that much is.
///
/// The spread of the units across the picture is itself a measure of noise, and a smaller one where stratified samples make
/// pixels quieter than their variance says; so the smaller of the two is used where variances are upper bounds.
fn whole_score(channel: &Channel, units: &[f64], correlation: f64) -> (f64, f64) {
    let (mut noisy, mut expected, mut squares, mut rounding) = (Moments::default(), 0.0, 0.0, 0.0);
    // Without noise there is nothing to measure in; the pixel test has looked at these.
    for (run, noise) in runs(channel).filter(|(_, noise)| *noise > 0.0) {
        for i in run {
            noisy.push(units[i]);
            let own = channel.variance[i] / noise;
            expected += own;
            squares += own * own;
            rounding += systematic_rounding(channel, i) / noise.sqrt();
        }
    }
    let count = noisy.count() as f64;
    if count < 2.0 {
        return (0.0, 1.0);
    }
    let excess = (noisy.mean().abs() - rounding / count).max(0.0);
    let variance_of_mean = expected / count / count;
    if channel.is_measured {
        let score = ratio(excess, (variance_of_mean * correlation).sqrt());
        return (score, probability(score, expected * expected / squares * channel.degrees));
    }
    let score = ratio(excess, (variance_of_mean.min(noisy.variance_of_mean()) * correlation).sqrt());
    (score, z_test(score))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};
    use crate::output::compare::{Mode, compare};
    use crate::output::image::SampleKind;

    const WIDTH: u32 = 64;
    const HEIGHT: u32 = 48;

    /// The light of a made-up scene: a bright disk over a slope, different in each channel.
    fn light(x: f64, y: f64) -> [f64; 3] {
        let disk = if (x - 30.0).hypot(y - 20.0) < 12.0 { 1.0 } else { 0.0 };
        [0.2 + 0.8 * disk, 0.3 + 0.01 * x + 0.4 * disk, 0.6 + 0.005 * y]
    }

    /// A render of `light` with `spp` samples that are exponentially distributed, so skewed as light is.
    fn render(key: u64, spp: u32, of: impl Fn(f64, f64) -> [f64; 3]) -> Image {
        let mut image = Image::new([WIDTH, HEIGHT]);
        let mut rng = CounterRng::new(Seed(key));
        let (mut mean, mut variance) = (Vec::new(), Vec::new());
        for i in 0..WIDTH * HEIGHT {
            let expected = of(f64::from(i % WIDTH), f64::from(i / WIDTH));
            let moments =
                expected.map(|e| (0..spp).map(|_| e * -(1.0 - f64::from(rng.uniform())).ln()).collect::<Moments>());
            mean.push(moments.map(|m| m.mean() as f32));
            variance.push(moments.map(|m| m.variance_of_mean() as f32));
        }
        image.push_rgb("", SampleKind::Half, &mean);
        image.push_rgb("variance", SampleKind::Float, &variance);
        image.set_attribute(SPP_ATTRIBUTE, Attribute::Int(spp as i32));
        image
    }

    fn verdict(image: &Image, reference: &Image) -> Report {
        compare(image, reference, None, Mode::Statistical(StatisticalSettings::default())).unwrap()
    }

    fn failed(report: &Report, check: &str) -> bool {
        report.findings.iter().any(|f| f.check == check && !f.passed)
    }

    #[test]
    fn two_renders_of_the_same_light_agree() {
        let reference = render(1000, 512, light);
        let alarms = (0..50).filter(|&key| !verdict(&render(key, 32, light), &reference).passed()).count();
        // Three tests at 1 % each: 1.5 expected, more than 6 with probability below 0.1 %.
        assert!(alarms <= 6, "{alarms} false alarms in 50");
    }

    #[test]
    fn equally_noisy_renders_agree_too() {
        let alarms =
            (0..30).filter(|&key| !verdict(&render(key, 16, light), &render(key + 500, 16, light)).passed()).count();
        assert!(alarms <= 4, "{alarms} false alarms in 30");
    }

    #[test]
    fn one_percent_brighter_is_found_by_the_whole_picture() {
        let reference = render(1000, 512, light);
        for key in 0..10 {
            let report = verdict(&render(key, 128, |x, y| light(x, y).map(|e| 1.01 * e)), &reference);
            assert!(failed(&report, "image"), "{report}");
        }
    }

    #[test]
    fn a_fault_in_one_corner_is_found_by_its_block() {
        let reference = render(1000, 512, light);
        let dimmed = |x: f64, y: f64| light(x, y).map(|e| if x >= 48.0 && y < 16.0 { 0.93 * e } else { e });
        let report = verdict(&render(1, 128, dimmed), &reference);
        assert!(failed(&report, "blocks"), "{report}");
    }

    #[test]
    fn one_pixel_offset_and_swapped_channels_are_found() {
        let reference = render(1000, 512, light);
        let offset = verdict(&render(1, 128, |x, y| light(x + 1.0, y)), &reference);
        assert!(!offset.passed(), "{offset}");
        let swapped = verdict(
            &render(2, 128, |x, y| {
                let [r, g, b] = light(x, y);
                [b, g, r]
            }),
            &reference,
        );
        assert!(failed(&swapped, "pixels"), "{swapped}");
    }

    #[test]
    fn a_dark_corner_is_held_to_the_same_standard() {
        // An absolute floor on the variance would let this pass.
        let dark = |scale: f64| move |x: f64, y: f64| light(x, y).map(|e| 1e-3 * scale * e);
        let reference = render(1000, 512, dark(1.0));
        assert!(verdict(&render(11, 128, dark(1.0)), &reference).passed());
        assert!(!verdict(&render(11, 128, dark(1.02)), &reference).passed());
    }

    #[test]
    fn without_noise_only_rounding_is_forgiven() {
        let still = |scale: f32| {
            let mut image = Image::new([32, 32]);
            image.push_rgb("", SampleKind::Half, &[[0.3 * scale; 3]; 1024]);
            image.push_rgb("variance", SampleKind::Float, &[[0.0; 3]; 1024]);
            image
        };
        assert!(verdict(&still(1.0), &still(1.0)).passed());
        assert!(verdict(&still(1.0002), &still(1.0)).passed());
        assert!(!verdict(&still(1.01), &still(1.0)).passed());
    }

    #[test]
    fn a_single_bad_number_fails() {
        let reference = render(1000, 64, light);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for channel in ["R", "variance.G"] {
                let mut image = render(1, 64, light);
                image.channels.iter_mut().find(|c| c.name == channel).unwrap().data[7] = bad;
                let report = verdict(&image, &reference);
                assert!(failed(&report, "finite"), "{bad} in {channel}: {report}");
                assert_eq!(report.map[7], f32::INFINITY);
                assert!(failed(&verdict(&reference, &image), "finite"), "{bad} in {channel} of the reference");
            }
        }
    }

    #[test]
    fn pictures_of_one_sample_have_no_variance_and_say_so() {
        let single = |key: u64| {
            let mut image = render(key, 2, light);
            image.set_attribute(SPP_ATTRIBUTE, Attribute::Int(1));
            image
                .channels
                .iter_mut()
                .filter(|c| c.name.starts_with("variance"))
                .for_each(|c| c.data.fill(f32::INFINITY));
            image
        };
        // Wrong by far, and once excused by an infinite variance.
        let mut image = single(1);
        image.channels.iter_mut().filter(|c| c.name.len() == 1).for_each(|c| c.data.fill(100.0));
        for reference in [single(2), render(1000, 64, light)] {
            let report = verdict(&image, &reference);
            assert!(failed(&report, "finite") && report.to_string().contains("1 sample per pixel"), "{report}");
        }
    }

    #[test]
    fn the_variance_may_come_from_one_side_or_from_a_file_of_its_own() {
        let reference = render(1000, 512, light);
        let mut bare = render(11, 64, light);
        bare.channels.retain(|c| !c.name.starts_with("variance"));
        let report = verdict(&bare, &reference);
        assert!(report.passed(), "{report}");
        let mut mean = reference.clone();
        mean.channels.retain(|c| !c.name.starts_with("variance"));
        let mode = Mode::Statistical(StatisticalSettings::default());
        assert!(compare(&bare, &mean, Some(&reference), mode).unwrap().passed());
        assert_eq!(compare(&bare, &mean, None, mode), Err(CompareError::NoVariance));
        // A file that does not fit is no reason to judge by something else.
        let other = Image::new([8, 8]);
        let error = CompareError::VarianceSize { found: [8, 8], expected: [WIDTH, HEIGHT] };
        assert_eq!(compare(&bare, &reference, Some(&other), mode), Err(error));
        let none = compare(&bare, &reference, Some(&Image::new([WIDTH, HEIGHT])), mode);
        assert!(matches!(none, Err(CompareError::NoColour(_))));
        let bright = render(11, 64, |x, y| light(x, y).map(|e| 1.03 * e));
        assert!(!verdict(&bright, &reference).passed());
    }
}
