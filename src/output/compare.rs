//! Whether two pictures agree: to the bit, by a measure of difference, or as two measurements of the same light.
//!
//! The command `compare` and the image tests of this project ask here, so that they give the same verdict.

use crate::output::agreement::{self, StatisticalSettings};
use crate::output::image::{Image, channel_order};
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
    match mode {
        Mode::Exact => compare_exactly(image, reference, &mut report),
        Mode::Measure(measure, threshold) => compare_by_measure(image, reference, measure, threshold, &mut report)?,
        Mode::Statistical(settings) => agreement::test(image, reference, variance, settings, &mut report)?,
    }
    Ok(report)
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
    report.map = vec![0.0; image.pixel_count()];
    for channel in &image.channels {
        let Some(other) = reference.channel(&channel.name) else { continue };
        let different = |i: usize| channel.data[i].to_bits() != other[i].to_bits();
        let mut count = 0u64;
        let mut first = None;
        for i in (0..other.len()).filter(|&i| different(i)) {
            count += 1;
            first = first.or(Some(i));
            let difference = (channel.data[i] - other[i]).abs();
            report.map[i] = report.map[i].max(if difference.is_nan() { f32::INFINITY } else { difference });
        }
        if let Some(i) = first {
            let [x, y] = image.position(i);
            let text = format!(
                "{}: {count} of {} pixels differ; first at ({x}, {y}): {} against {}",
                channel.name,
                other.len(),
                channel.data[i],
                other[i]
            );
            report.find("pixels", false, text);
        }
    }
    if report.passed() {
        report.find("pixels", true, format!("all {} are the same to the bit", image.pixel_count()));
    }
}

/// Fails on pixels that are infinite or not a number, in either picture.
pub(crate) fn check_finite(image: &Image, colours: [[&[f32]; 3]; 2], report: &mut Report) {
    let bad = |i: usize| colours.iter().flatten().any(|channel| !channel[i].is_finite());
    let mut count = 0u64;
    let mut first = None;
    for i in (0..image.pixel_count()).filter(|&i| bad(i)) {
        report.map[i] = f32::INFINITY;
        first = first.or(Some(i));
        count += 1;
    }
    if let Some(i) = first {
        let [x, y] = image.position(i);
        report.find("finite", false, format!("{count} pixels are infinite or not a number, first ({x}, {y})"));
    }
}

fn compare_by_measure(
    image: &Image,
    reference: &Image,
    measure: Measure,
    threshold: f64,
    report: &mut Report,
) -> Result<(), CompareError> {
    if threshold.is_nan() {
        return Err(CompareError::Setting { name: "threshold", allowed: "a number", value: threshold });
    }
    let ours = image.rgb("").ok_or(CompareError::NoColour("the picture"))?;
    let theirs = reference.rgb("").ok_or(CompareError::NoColour("the reference"))?;
    report.map = vec![0.0; image.pixel_count()];
    for (a, b) in ours.into_iter().zip(theirs) {
        for ((a, b), worst) in a.iter().zip(b).zip(&mut report.map) {
            *worst = worst.max((a - b).abs());
        }
    }
    check_finite(image, [ours, theirs], report);
    let (value, passed, text) = measured(ours, theirs, measure, threshold);
    report.find("measure", passed && !value.is_nan(), text);
    Ok(())
}

fn measured(ours: [&[f32]; 3], theirs: [&[f32]; 3], measure: Measure, threshold: f64) -> (f64, bool, String) {
    let pairs =
        || ours.into_iter().zip(theirs).flat_map(|(a, b)| a.iter().zip(b).map(|(&a, &b)| (f64::from(a), f64::from(b))));
    let count = pairs().count().max(1) as f64;
    let mse = pairs().map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / count;
    match measure {
        Measure::Mse => (mse, mse <= threshold, format!("MSE {mse:.6e}, at most {threshold:e}")),
        Measure::RelMse => {
            let mean = pairs().map(|(_, b)| b).sum::<f64>() / count;
            let floor = (0.01 * mean * mean).max(f64::MIN_POSITIVE);
            let value = pairs().map(|(a, b)| (a - b) * (a - b) / (b * b + floor)).sum::<f64>() / count;
            (value, value <= threshold, format!("relMSE {value:.6e}, at most {threshold:e}"))
        }
        Measure::Psnr => {
            let peak = pairs().map(|(_, b)| b).fold(0.0, f64::max);
            let value = if mse == 0.0 { f64::INFINITY } else { 10.0 * (peak * peak / mse).log10() };
            (value, value >= threshold, format!("PSNR {value:.2} dB, at least {threshold} dB"))
        }
        Measure::Max => {
            let value = pairs().map(|(a, b)| (a - b).abs()).fold(0.0, |m, d| if d.is_nan() { d } else { m.max(d) });
            (value, value <= threshold, format!("largest difference {value:.6e}, at most {threshold:e}"))
        }
    }
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
