//! Whether two pictures agree: to the bit, by a measure of difference, or as two measurements of the same light.
//!
//! The command `compare` and the image tests of this project ask here, so that they give the same verdict.

use crate::output::agreement::{self, Measurement, StatisticalSettings};
use crate::output::flip::{self, FlipSettings};
use crate::output::image::{Image, SampleKind, channel_order};
use crate::output::layers::{BEAUTY, Layer};
use std::fmt;
use thiserror::Error;

/// How pictures are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mode {
    /// Same windows, same channels, same bits in every pixel. Attributes do not count.
    Exact,
    /// A measure over red, green and blue must not pass a threshold.
    Measure(Measure, f64),
    /// Differences must be explained by the noise of both pictures, see [`agreement`].
    Statistical(StatisticalSettings),
    /// The mean of FLIP must not pass a threshold, see [`flip`].
    Flip(FlipSettings, f64),
}

/// A measure of difference between a picture a and a reference b, over all pixels of R, G and B.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// Mean of (a − b)².
    Mse,
    /// Mean of (a − b)² / (b² + 0.01 m²), where m is the mean of b.
    RelMse,
    /// 10 log₁₀(p² / MSE) [dB], where p is the largest value of b. The threshold is a lower one.
    Psnr,
    /// Largest |a − b|.
    Max,
}

/// Pictures that cannot be compared at all.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CompareError {
    /// No R, G and B.
    #[error("{0} has no channels R, G and B")]
    NoColour(&'static str),
    /// A layer that one of the pictures does not have.
    #[error("a picture has no layer `{0}`")]
    NoLayer(String),
    /// A layer that is no colour has no colours to see.
    #[error("the layer `{0}` has no channels R, G and B, which FLIP looks at; take another check for it")]
    NotSeen(String),
    /// Nothing says how noisy the pictures are.
    #[error(
        "neither picture says how noisy it is; render with `variance` among `output.aovs`, name a file with \
         --variance, or choose another --mode"
    )]
    NoVariance,
    /// The file of variances is of other pixels.
    #[error(
        "the variance file has {} × {} pixels, the pictures have {} × {}, or it lies elsewhere in the frame; give one \
         made for this reference",
        found[0], found[1], expected[0], expected[1]
    )]
    VarianceSize {
        /// Width and height of the variance file [pixels].
        found: [u32; 2],
        /// Width and height of the pictures [pixels].
        expected: [u32; 2],
    },
    /// A number that makes no sense.
    #[error("{name} must be {allowed}, not {value}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// What is allowed.
        allowed: &'static str,
        /// What it was.
        value: f64,
    },
}

/// One thing that was looked at.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Name of the check.
    pub check: &'static str,
    /// Whether the pictures pass it.
    pub passed: bool,
    /// What was found, with figures.
    pub text: String,
}

/// The verdict with its reasons.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Report {
    /// All that was looked at.
    pub findings: Vec<Finding>,
    /// Width and height of the map below.
    pub map_size: [u32; 2],
    /// How bad each pixel is: standard deviations, or differences. Empty when the pictures cannot be laid over each
    /// other. Infinite where a pixel is not finite.
    pub map: Vec<f32>,
}

impl Report {
    /// Whether every check passed.
    pub fn passed(&self) -> bool {
        self.findings.iter().all(|f| f.passed)
    }

    pub(crate) fn find(&mut self, check: &'static str, passed: bool, text: String) {
        self.findings.push(Finding { check, passed, text });
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for finding in &self.findings {
            let verdict = if finding.passed { "pass" } else { "FAIL" };
            writeln!(f, "{verdict}  {:<8} {}", finding.check, finding.text)?;
        }
        write!(f, "{}", if self.passed() { "the pictures agree" } else { "the pictures differ" })
    }
}

/// Compares a picture with a reference. `variance` holds the variance of the reference's mean in channels R, G, B or
/// variance.R, variance.G, variance.B; without it the pictures' own `variance` layers are used.
///
/// # Errors
/// When the mode needs what the pictures do not have.
pub fn compare(image: &Image, reference: &Image, variance: Option<&Image>, mode: Mode) -> Result<Report, CompareError> {
    let mut report = Report::default();
    let window = |i: &Image| (i.size, i.data_origin, i.data_size);
    if window(image) != window(reference) {
        let text = format!("{} against {}", window_text(image), window_text(reference));
        report.find("size", false, text);
        return Ok(report);
    }
    report.map_size = image.data_size;
    let beauty = Layer { name: BEAUTY.into(), parts: Vec::new() };
    match mode {
        Mode::Exact => compare_exactly(image, reference, &mut report),
        _ => {
            let ours = image.rgb("").ok_or(CompareError::NoColour("the picture"))?;
            let theirs = reference.rgb("").ok_or(CompareError::NoColour("the reference"))?;
            let separate = variance.map(|v| separate_variance(image, v)).transpose()?;
            let known = |image: &Image, means: [&'_ [f32]; 3]| is_half(image, &means);
            let ours = Measurement {
                means: ours.to_vec(),
                variances: image.rgb("variance").map(|v| v.to_vec()),
                spp: agreement::spp_of(image),
                runs: agreement::runs_of(image),
                is_half: known(image, ours),
            };
            let theirs = Measurement {
                means: theirs.to_vec(),
                variances: separate.or_else(|| reference.rgb("variance")).map(|v| v.to_vec()),
                spp: agreement::spp_of(reference).or_else(|| variance.and_then(agreement::spp_of)),
                runs: agreement::runs_of(reference).or_else(|| variance.and_then(agreement::runs_of)),
                is_half: known(reference, theirs),
            };
            compare_measurements(image, &beauty, &ours, &theirs, mode, &mut report)?;
        }
    }
    Ok(report)
}

/// Whether any of the channels is kept in 16 bits.
fn is_half(image: &Image, means: &[&[f32]]) -> bool {
    let is_one = |data: &[f32]| means.iter().any(|mean| std::ptr::eq(*mean, data));
    image.channels.iter().any(|c| c.kind == SampleKind::Half && is_one(&c.data))
}

/// The channels of a file of variances, which must cover the very pixels of the pictures.
fn separate_variance<'a>(image: &Image, variance: &'a Image) -> Result<[&'a [f32]; 3], CompareError> {
    let window = |i: &Image| (i.data_origin, i.data_size);
    if window(variance) != window(image) {
        return Err(CompareError::VarianceSize { found: variance.data_size, expected: image.data_size });
    }
    variance.rgb("variance").or_else(|| variance.rgb("")).ok_or(CompareError::NoColour("the variance file"))
}

/// Compares one layer of two pictures, which both have; their variances are the layers `variance`.
///
/// # Errors
/// When the mode needs what the pictures do not have.
///
/// # Panics
/// When the windows differ.
pub fn compare_layer(image: &Image, reference: &Image, layer: &Layer, mode: Mode) -> Result<Report, CompareError> {
    assert_eq!(image.data_size, reference.data_size, "windows are compared before layers");
    let mut report = Report { map_size: image.data_size, ..Report::default() };
    let (ours, theirs) = (measurement(image, layer)?, measurement(reference, layer)?);
    if mode == Mode::Exact {
        let names = layer.channel_names();
        let pairs = names.iter().zip(ours.means.iter().zip(&theirs.means)).map(|(n, (a, b))| (n.as_str(), *a, *b));
        compare_bits(image, pairs, &mut report);
    } else {
        compare_measurements(image, layer, &ours, &theirs, mode, &mut report)?;
    }
    Ok(report)
}

/// What a picture says of a layer.
fn measurement<'i>(image: &'i Image, layer: &Layer) -> Result<Measurement<'i>, CompareError> {
    let means: Vec<&[f32]> = layer.channels(image).ok_or_else(|| CompareError::NoLayer(layer.name.clone()))?;
    let is_half = is_half(image, &means);
    let (spp, runs) = (agreement::spp_of(image), agreement::runs_of(image));
    Ok(Measurement { means, variances: layer.variances(image), spp, runs, is_half })
}

/// The findings of any mode but the exact one.
fn compare_measurements(
    image: &Image,
    layer: &Layer,
    ours: &Measurement,
    theirs: &Measurement,
    mode: Mode,
    report: &mut Report,
) -> Result<(), CompareError> {
    match mode {
        Mode::Exact => unreachable!("compared bit by bit"),
        Mode::Measure(measure, threshold) => compare_by_measure(image, ours, theirs, measure, threshold, report),
        Mode::Statistical(settings) => agreement::test(image, ours, theirs, settings, report),
        Mode::Flip(settings, threshold) => {
            let [Some(a), Some(b)] = [ours, theirs].map(|m| <[&[f32]; 3]>::try_from(m.means.clone()).ok()) else {
                return Err(CompareError::NotSeen(layer.name.clone()));
            };
            if !layer.parts.is_empty() && layer.parts != ["R", "G", "B"] {
                return Err(CompareError::NotSeen(layer.name.clone()));
            }
            flip::test(image, a, b, settings, threshold, report)
        }
    }
}

fn window_text(image: &Image) -> String {
    let ([w, h], [x, y], [dw, dh]) = (image.size, image.data_origin, image.data_size);
    format!("{w} × {h} pixels (of which {dw} × {dh} from {x}, {y})")
}

fn compare_exactly(image: &Image, reference: &Image, report: &mut Report) {
    let names = |i: &Image| {
        let mut names: Vec<String> = i.channels.iter().map(|c| c.name.clone()).collect();
        names.sort_by_key(|n| channel_order(n));
        names
    };
    let (ours, theirs) = (names(image), names(reference));
    report.find(
        "channels",
        ours == theirs,
        if ours == theirs { ours.join(" ") } else { format!("{} against {}", ours.join(" "), theirs.join(" ")) },
    );
    let pairs = image.channels.iter().filter_map(|channel| {
        Some((channel.name.as_str(), channel.data.as_slice(), reference.channel(&channel.name)?))
    });
    compare_bits(image, pairs, report);
}

/// Compares channels bit by bit: name, ours and theirs. What is not a number in both is the same.
fn compare_bits<'a>(
    image: &Image,
    channels: impl Iterator<Item = (&'a str, &'a [f32], &'a [f32])>,
    report: &mut Report,
) {
    report.map = vec![0.0; image.pixel_count()];
    for (name, ours, theirs) in channels {
        let different =
            |i: &usize| ours[*i].to_bits() != theirs[*i].to_bits() && !(ours[*i].is_nan() && theirs[*i].is_nan());
        let mut count = 0u64;
        let mut first = None;
        for i in (0..theirs.len()).filter(different) {
            count += 1;
            first = first.or(Some(i));
            let difference = (ours[i] - theirs[i]).abs();
            report.map[i] = report.map[i].max(if difference.is_nan() { f32::INFINITY } else { difference });
        }
        if let Some(i) = first {
            let [x, y] = image.position(i);
            let (total, a, b) = (theirs.len(), ours[i], theirs[i]);
            let text = format!("{name}: {count} of {total} pixels differ; first at ({x}, {y}): {a} against {b}");
            report.find("pixels", false, text);
        }
    }
    if report.passed() {
        report.find("pixels", true, format!("all {} are the same to the bit", image.pixel_count()));
    }
}

/// Whether two numbers are the same and none: both not a number, or the same infinity.
fn is_none_in_both(a: f32, b: f32) -> bool {
    a.is_nan() && b.is_nan() || a.is_infinite() && a == b
}

/// Fails on pixels that are infinite or not a number in one picture and not so in the other. Where both are, nothing is
/// compared, and the report says how often.
pub(crate) fn check_finite(image: &Image, ours: &[&[f32]], theirs: &[&[f32]], report: &mut Report) {
    let (mut bad, mut none) = (0u64, 0u64);
    let mut first = None;
    for i in 0..image.pixel_count() {
        let pairs = || ours.iter().zip(theirs).map(|(a, b)| (a[i], b[i]));
        if pairs().all(|(a, b)| a.is_finite() && b.is_finite()) {
            continue;
        }
        if pairs().all(|(a, b)| a.is_finite() && b.is_finite() || is_none_in_both(a, b)) {
            none += 1;
            continue;
        }
        report.map[i] = f32::INFINITY;
        first = first.or(Some(i));
        bad += 1;
    }
    if let Some(i) = first {
        let [x, y] = image.position(i);
        report.find("finite", false, format!("{bad} pixels are infinite or not a number, first ({x}, {y})"));
    } else if none > 0 {
        let text = format!("{none} pixels are infinite or not a number in both pictures and left out");
        report.find("finite", true, text);
    }
}

fn compare_by_measure(
    image: &Image,
    ours: &Measurement,
    theirs: &Measurement,
    measure: Measure,
    threshold: f64,
    report: &mut Report,
) -> Result<(), CompareError> {
    if threshold.is_nan() {
        return Err(CompareError::Setting { name: "threshold", allowed: "a number", value: threshold });
    }
    report.map = vec![0.0; image.pixel_count()];
    for (a, b) in ours.means.iter().zip(&theirs.means) {
        for ((&a, &b), worst) in a.iter().zip(*b).zip(&mut report.map) {
            *worst = if is_none_in_both(a, b) { *worst } else { worst.max((a - b).abs()) };
        }
    }
    check_finite(image, &ours.means, &theirs.means, report);
    let (value, passed, text) = measured(&ours.means, &theirs.means, measure, threshold);
    report.find("measure", passed && !value.is_nan(), text);
    Ok(())
}

fn measured(ours: &[&[f32]], theirs: &[&[f32]], measure: Measure, threshold: f64) -> (f64, bool, String) {
    let all = || ours.iter().zip(theirs).flat_map(|(a, b)| a.iter().zip(*b));
    let pairs = || all().filter(|(a, b)| !is_none_in_both(**a, **b)).map(|(&a, &b)| (f64::from(a), f64::from(b)));
    let count = pairs().count().max(1) as f64;
    let mse = pairs().map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / count;
    match measure {
        Measure::Mse => (mse, mse <= threshold, format!("MSE {mse:.6e}, at most {threshold:e}")),
        Measure::RelMse => {
            let floor = relative_floor(pairs().map(|(_, b)| b).sum::<f64>() / count);
            let value = pairs().map(|(a, b)| (a - b) * (a - b) / (b * b + floor)).sum::<f64>() / count;
            (value, value <= threshold, format!("relMSE {value:.6e}, at most {threshold:e}"))
        }
        Measure::Psnr => {
            let value = psnr(mse, pairs().map(|(_, b)| b).fold(0.0, f64::max));
            (value, value >= threshold, format!("PSNR {value:.2} dB, at least {threshold} dB"))
        }
        Measure::Max => {
            let value = pairs().map(|(a, b)| (a - b).abs()).fold(0.0, |m, d| if d.is_nan() { d } else { m.max(d) });
            (value, value <= threshold, format!("largest difference {value:.6e}, at most {threshold:e}"))
        }
    }
}

/// What keeps relative errors of dark pixels finite, for a reference of this mean.
fn relative_floor(mean: f64) -> f64 {
    (0.01 * mean * mean).max(f64::MIN_POSITIVE)
}

fn psnr(mse: f64, peak: f64) -> f64 {
    if mse == 0.0 { f64::INFINITY } else { 10.0 * (peak * peak / mse).log10() }
}

/// Standard deviations that the largest of a picture's errors is expected to have.
const LARGEST_ERROR: f64 = 4.0;

/// What is wrong with a reference for a mode: its own noise would break the threshold, or be most of what a test sees. Nothing
/// where its noise is not known.
pub fn reference_noise(image: &Image, reference: &Image, layer: &Layer, mode: Mode) -> Option<String> {
    let variances = layer.variances(reference)?;
    let means = layer.channels(reference)?;
    let all = || means.iter().zip(&variances).flat_map(|(m, v)| m.iter().zip(*v));
    let pairs = || all().map(|(&m, &v)| (f64::from(m), f64::from(v))).filter(|(m, v)| m.is_finite() && v.is_finite());
    let count = pairs().count().max(1) as f64;
    let mse = pairs().map(|(_, v)| v).sum::<f64>() / count;
    let (value, is_too_noisy) = match mode {
        Mode::Exact | Mode::Flip(..) => return None,
        Mode::Measure(Measure::Mse, most) => (format!("an MSE of {mse:.2e}"), mse > most),
        Mode::Measure(Measure::RelMse, most) => {
            let floor = relative_floor(pairs().map(|(m, _)| m).sum::<f64>() / count);
            let value = pairs().map(|(m, v)| v / (m * m + floor)).sum::<f64>() / count;
            (format!("a relMSE of {value:.2e}"), value > most)
        }
        Mode::Measure(Measure::Psnr, least) => {
            let value = psnr(mse, pairs().map(|(m, _)| m).fold(0.0, f64::max));
            (format!("a PSNR of {value:.1} dB"), value < least)
        }
        Mode::Measure(Measure::Max, most) => {
            let value = LARGEST_ERROR * pairs().map(|(_, v)| v).fold(0.0, f64::max).sqrt();
            (format!("differences of {value:.2e}"), value > most)
        }
        Mode::Statistical(_) => {
            let ours = layer.variances(image)?;
            let ours: f64 = ours.iter().flat_map(|v| v.iter()).map(|&v| f64::from(v)).filter(|v| v.is_finite()).sum();
            return (mse * count > ours).then(|| {
                format!("the reference's noise in `{}` is above the picture's, so that little is found", layer.name)
            });
        }
    };
    is_too_noisy.then(|| format!("the reference's own noise in `{}` is {value}, beyond the limit", layer.name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::image::SampleKind;

    fn picture(shift: f32) -> Image {
        let mut image = Image::new([4, 2]);
        let rgb: Vec<[f32; 3]> = (0..8).map(|i| [i as f32 / 8.0 + shift, 0.5, 1.0]).collect();
        image.push_rgb("", SampleKind::Float, &rgb);
        image
    }

    fn verdict(a: &Image, b: &Image, mode: Mode) -> Report {
        compare(a, b, None, mode).unwrap()
    }

    #[test]
    fn exact_means_every_bit_and_says_where() {
        assert!(verdict(&picture(0.0), &picture(0.0), Mode::Exact).passed());
        let mut other = picture(0.0);
        other.channels[1].data[6] += 1e-7;
        let report = verdict(&picture(0.0), &other, Mode::Exact);
        assert!(!report.passed());
        assert!(report.to_string().contains("G: 1 of 8 pixels differ; first at (2, 1)"), "{report}");
        let mut zero = picture(0.0);
        zero.channels[0].data[0] = -0.0;
        assert!(!verdict(&picture(0.0), &zero, Mode::Exact).passed());
        let mut nan = picture(0.0);
        nan.channels[0].data[0] = f32::NAN;
        assert!(verdict(&nan, &nan, Mode::Exact).passed());
    }

    #[test]
    fn another_size_or_channel_differs() {
        let mut extra = picture(0.0);
        extra.push("A", SampleKind::Half, vec![1.0; 8]);
        assert!(!verdict(&extra, &picture(0.0), Mode::Exact).passed());
        let mut crop = Image::cropped([4, 2], [0, 0, 2, 2]);
        crop.push_rgb("", SampleKind::Float, &[[0.0; 3]; 4]);
        assert!(!verdict(&crop, &picture(0.0), Mode::Measure(Measure::Mse, 1e9)).passed());
    }

    #[test]
    fn measures_have_their_values_and_thresholds_their_side() {
        let (a, b) = (picture(0.1), picture(0.0));
        for (measure, close, far) in [
            (Measure::Mse, 0.0034, 0.0033),
            (Measure::RelMse, 0.135, 0.133),
            (Measure::Psnr, 24.7, 24.8),
            (Measure::Max, 0.101, 0.099),
        ] {
            let report = verdict(&a, &b, Mode::Measure(measure, close));
            assert!(report.passed(), "{report}");
            assert!(!verdict(&a, &b, Mode::Measure(measure, far)).passed(), "{measure:?}");
            let same = if measure == Measure::Psnr { f64::INFINITY } else { 0.0 };
            assert!(verdict(&b, &b, Mode::Measure(measure, same)).passed(), "{measure:?}");
        }
    }

    #[test]
    fn a_pixel_that_is_no_number_fails_every_measure() {
        for bad in [f32::NAN, f32::INFINITY] {
            let mut image = picture(0.0);
            image.channels[2].data[3] = bad;
            for measure in [Measure::Mse, Measure::RelMse, Measure::Max] {
                assert!(!verdict(&image, &picture(0.0), Mode::Measure(measure, 1e30)).passed());
                assert!(!verdict(&picture(0.0), &image, Mode::Measure(measure, 1e30)).passed());
            }
        }
    }
}
