//! FLIP: how different two pictures look to someone who flips between them, 0 to 1 for each pixel.
//!
//! Andersson et al. 2020 (*FLIP: A Difference Evaluator for Alternating Images*) for what a screen shows, and Andersson et al. 2021
//! (*Visualizing Errors in Rendered High Dynamic Range Images*) for light: the largest difference over exposures from the
//! brightest to the median of the reference, through the same tone curve. Equations are numbered as in the first.
//!
//! Colours are blurred as the eye does and compared (section 4.1), edges and points are found and compared (4.2), and what
//! differs in both counts more (4.3). Filters are separable; the published ones are products of one-dimensional ones.

use crate::math::parallel;
use crate::output::compare::{CompareError, Report, check_finite};
use crate::output::image::Image;
use std::f64::consts::PI;

/// How pictures are looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlipSettings {
    /// Pixels in a degree of the observer's view, above 0.
    pub pixels_per_degree: f64,
    /// The pictures are what a screen shows, not light.
    pub ldr: bool,
}

impl Default for FlipSettings {
    /// Light on a screen of 0.7 m and 3840 pixels, from 0.7 m.
    fn default() -> Self {
        Self { pixels_per_degree: 3840.0_f64.to_radians(), ldr: false }
    }
}

/// A colour, or one of its transforms.
type Colour = [f32; 3];

/// Exponent of differences of colour (q_c), and that of features (q_f).
const COLOUR_EXPONENT: f32 = 0.7;
const FEATURE_EXPONENT: f32 = 0.5;
/// Differences of colour below this share of the largest (p_c) fill this much of the scale (p_t).
const KNEE: [f32; 2] = [0.4, 0.95];
/// Width of the detector of edges and points [degrees].
const FEATURE_WIDTH: f64 = 0.082;
/// What the tone curve makes of the brightest light at the shortest exposure, and of the median at the longest.
const EXPOSED: f64 = 0.85;
/// Least median luminance, for pictures that are mostly black.
const MEDIAN_MIN: f64 = f32::EPSILON as f64;
/// Filters end after this many standard deviations.
const REACH: f64 = 3.0;

/// Compares by the mean of FLIP, which must be at most `threshold`.
///
/// # Errors
/// A setting that makes no sense.
pub(crate) fn test(
    image: &Image,
    ours: [&[f32]; 3],
    theirs: [&[f32]; 3],
    settings: FlipSettings,
    threshold: f64,
    report: &mut Report,
) -> Result<(), CompareError> {
    let ppd = settings.pixels_per_degree;
    if !(1.0..=1000.0).contains(&ppd) {
        return Err(CompareError::Setting { name: "pixels per degree", allowed: "from 1 to 1000", value: ppd });
    }
    if !(0.0..=1.0).contains(&threshold) {
        return Err(CompareError::Setting { name: "threshold", allowed: "from 0 to 1", value: threshold });
    }
    report.map = vec![0.0; image.pixel_count()];
    check_finite(image, &ours, &theirs, report);
    if !report.passed() {
        return Ok(());
    }
    report.map = map(ours, theirs, image.data_size.map(|n| n as usize), settings);
    let mean = report.map.iter().map(|&x| f64::from(x)).sum::<f64>() / report.map.len().max(1) as f64;
    report.find("flip", mean <= threshold, format!("mean FLIP {mean:.6}, at most {threshold}"));
    Ok(())
}

/// FLIP of each pixel of a picture against a reference; `size` is width and height. What is not finite counts as black.
pub fn map(picture: [&[f32]; 3], reference: [&[f32]; 3], size: [usize; 2], settings: FlipSettings) -> Vec<f32> {
    let colours = |channels: [&[f32]; 3]| -> Vec<Colour> {
        let light = |x: f32| if x.is_finite() { x.max(0.0) } else { 0.0 };
        (0..channels[0].len()).map(|i| channels.map(|c| light(c[i]))).collect()
    };
    let (picture, reference) = (colours(picture), colours(reference));
    let eye = Eye::new(settings.pixels_per_degree);
    if settings.ldr {
        return eye.differences(&picture, &reference, size);
    }
    let mut largest = vec![0.0_f32; picture.len()];
    for exposure in exposures(&reference) {
        let gain = exposure.exp2() as f32;
        let shown = |light: &[Colour]| light.iter().map(|c| c.map(|x| tone(x * gain))).collect::<Vec<_>>();
        let differences = eye.differences(&shown(&picture), &shown(&reference), size);
        largest.iter_mut().zip(differences).for_each(|(most, x)| *most = most.max(x));
    }
    largest
}

/// The rational fit of the ACES tone curve, numerator and denominator from the square down; with the exposure that goes with it.
const TONE: [[f64; 3]; 2] = [[0.36 * 2.51, 0.6 * 0.03, 0.0], [0.36 * 2.43, 0.6 * 0.59, 0.14]];

fn tone(x: f32) -> f32 {
    let x = f64::from(x);
    let [up, down] = TONE.map(|[a, b, c]| (a * x + b) * x + c);
    if down.is_finite() { (up / down).clamp(0.0, 1.0) as f32 } else { 1.0 }
}

/// The exposures at which a reference is looked at [stops].
fn exposures(reference: &[Colour]) -> Vec<f64> {
    let luminance = |c: &Colour| 0.2126 * f64::from(c[0]) + 0.7152 * f64::from(c[1]) + 0.0722 * f64::from(c[2]);
    let mut all: Vec<f64> = reference.iter().map(luminance).collect();
    all.sort_unstable_by(f64::total_cmp);
    let Some(&brightest) = all.last().filter(|&&most| most > 0.0) else { return vec![0.0] };
    let middle = all.len() / 2;
    let median = if all.len() % 2 == 1 { all[middle] } else { 0.5 * (all[middle - 1] + all[middle]) };
    // Where the tone curve is EXPOSED: the positive root of a quadratic.
    let [a, b, c]: [f64; 3] = std::array::from_fn(|i| TONE[0][i] - EXPOSED * TONE[1][i]);
    let x = (-b - (b * b - 4.0 * a * c).sqrt()) / (2.0 * a);
    let x = if x > 0.0 { x } else { (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a) };
    let (start, stop) = ((x / brightest).log2(), (x / median.max(MEDIAN_MIN)).log2());
    let count = ((stop - start).ceil() as usize).max(2);
    (0..count).map(|i| start + (stop - start) * i as f64 / (count - 1) as f64).collect()
}

/// The observer: filters for one distance from the screen.
struct Eye {
    /// Blurs of lightness, red against green, and blue against yellow, each a weighted sum of bells.
    blurs: [Vec<(f32, Vec<f32>)>; 3],
    /// A bell, its slope and its curvature, which find features.
    bell: Vec<f32>,
    slope: Vec<f32>,
    curvature: Vec<f32>,
    /// The largest difference of colours, between green and blue.
    largest: f32,
}

impl Eye {
    fn new(pixels_per_degree: f64) -> Self {
        // Heights and widths of the bells of table 1; those of height 0 are left out.
        const BELLS: [&[[f64; 2]]; 3] = [&[[1.0, 0.0047]], &[[1.0, 0.0053]], &[[34.1, 0.04], [13.5, 0.025]]];
        let widest = BELLS.iter().flat_map(|bells| bells.iter()).map(|bell| bell[1]).fold(0.0, f64::max);
        let radius = (REACH * (widest / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as i32;
        let blurs = BELLS.map(|bells| {
            let parts: Vec<(f64, Vec<f64>)> = bells
                .iter()
                .map(|&[height, width]| {
                    let at = |x: i32| (-PI * PI * (f64::from(x) / pixels_per_degree).powi(2) / width).exp();
                    let taps: Vec<f64> = (-radius..=radius).map(at).collect();
                    let sum: f64 = taps.iter().sum();
                    (height * (PI / width).sqrt() * sum * sum, taps.iter().map(|t| t / sum).collect())
                })
                .collect();
            let total: f64 = parts.iter().map(|part| part.0).sum();
            parts.into_iter().map(|(weight, taps)| ((weight / total) as f32, single(&taps))).collect()
        });
        let deviation = 0.5 * FEATURE_WIDTH * pixels_per_degree;
        let radius = (REACH * deviation).ceil() as i32;
        let taps = |shape: &dyn Fn(f64) -> f64| -> Vec<f64> {
            let at = |x: i32| shape(f64::from(x)) * (-f64::from(x).powi(2) / (2.0 * deviation * deviation)).exp();
            (-radius..=radius).map(at).collect()
        };
        let bell = taps(&|_| 1.0);
        let sum: f64 = bell.iter().sum();
        let largest = distance(hunt(lab([0.0, 1.0, 0.0])), hunt(lab([0.0, 0.0, 1.0]))).powf(COLOUR_EXPONENT);
        Self {
            blurs,
            bell: single(&bell.iter().map(|t| t / sum).collect::<Vec<_>>()),
            slope: single(&balanced(taps(&|x| -x))),
            curvature: single(&balanced(taps(&|x| x * x / (deviation * deviation) - 1.0))),
            largest,
        }
    }

    /// FLIP between what a screen shows twice, in linear light from 0 to 1.
    fn differences(&self, picture: &[Colour], reference: &[Colour], size: [usize; 2]) -> Vec<f32> {
        let (ours, theirs) = (self.seen(picture, size), self.seen(reference, size));
        parallel::map(picture.len(), |i| {
            let colour = self.spread(distance(ours.colours[i], theirs.colours[i]).powf(COLOUR_EXPONENT));
            let [edge, point] = [0, 1].map(|k| (ours.features[i][k] - theirs.features[i][k]).abs());
            let feature = (edge.max(point) * std::f32::consts::FRAC_1_SQRT_2).powf(FEATURE_EXPONENT);
            colour.powf(1.0 - feature)
        })
    }

    /// Equation 15: the scale of differences of colour, of which small ones get most.
    fn spread(&self, difference: f32) -> f32 {
        let [share, height] = KNEE;
        let knee = share * self.largest;
        if difference < knee {
            difference * height / knee
        } else {
            height + (difference - knee) / (self.largest - knee) * (1.0 - height)
        }
    }

    fn seen(&self, picture: &[Colour], size: [usize; 2]) -> Seen {
        let opponent: Vec<Colour> = picture.iter().map(|&c| opponent(c)).collect();
        let mut blurred = vec![[0.0; 3]; picture.len()];
        for (c, bells) in self.blurs.iter().enumerate() {
            let channel: Vec<f32> = opponent.iter().map(|o| o[c]).collect();
            for (weight, taps) in bells {
                let filtered = filter(&channel, size, taps, taps);
                blurred.iter_mut().zip(filtered).for_each(|(b, x)| b[c] += weight * x);
            }
        }
        let lightness: Vec<f32> = opponent.iter().map(|o| (o[0] + 16.0) / 116.0).collect();
        let strength = |taps: &[f32]| {
            let across = filter(&lightness, size, taps, &self.bell);
            let down = filter(&lightness, size, &self.bell, taps);
            across.into_iter().zip(down).map(|(x, y)| x.hypot(y)).collect::<Vec<f32>>()
        };
        let (edges, points) = (strength(&self.slope), strength(&self.curvature));
        Seen {
            colours: blurred.into_iter().map(|o| hunt(lab(rgb_of_opponent(o).map(|x| x.clamp(0.0, 1.0))))).collect(),
            features: edges.into_iter().zip(points).map(|(edge, point)| [edge, point]).collect(),
        }
    }
}

/// A picture as an observer takes it in.
struct Seen {
    /// Lightness and colourfulness, after the blur of the eye.
    colours: Vec<Colour>,
    /// Strength of edges and of points.
    features: Vec<[f32; 2]>,
}

fn single(taps: &[f64]) -> Vec<f32> {
    taps.iter().map(|&t| t as f32).collect()
}

/// Taps scaled so that those above 0 sum to 1 and those below to −1.
fn balanced(taps: Vec<f64>) -> Vec<f64> {
    let up: f64 = taps.iter().filter(|&&t| t > 0.0).sum();
    let down: f64 = -taps.iter().filter(|&&t| t < 0.0).sum::<f64>();
    taps.into_iter().map(|t| if t > 0.0 { t / up } else { t / down }).collect()
}

/// Rows with one list of taps, columns with the other; pixels of the rim go on beyond it.
fn filter(channel: &[f32], [width, height]: [usize; 2], across: &[f32], down: &[f32]) -> Vec<f32> {
    let clamped =
        |at: usize, tap: usize, taps: &[f32], size: usize| (at + tap).saturating_sub(taps.len() / 2).min(size - 1);
    let mut rows = vec![0.0; channel.len()];
    parallel::for_each_chunk_mut(&mut rows, width.max(1), |y, row| {
        let line = &channel[y * width..(y + 1) * width];
        for (x, value) in row.iter_mut().enumerate() {
            *value = across.iter().enumerate().map(|(t, w)| w * line[clamped(x, t, across, width)]).sum();
        }
    });
    let mut result = vec![0.0; channel.len()];
    parallel::for_each_chunk_mut(&mut result, width.max(1), |y, row| {
        for (t, w) in down.iter().enumerate() {
            let from = clamped(y, t, down, height) * width;
            row.iter_mut().zip(&rows[from..from + width]).for_each(|(value, x)| *value += w * x);
        }
    });
    result
}

/// CIE XYZ of linear Rec. 709, from its exact chromaticities, over that of white.
fn over_white(rgb: Colour) -> [f64; 3] {
    let (colour, white) = (xyz(rgb.map(f64::from)), xyz([1.0; 3]));
    std::array::from_fn(|i| colour[i] / white[i])
}

const TO_XYZ: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];

fn xyz(rgb: [f64; 3]) -> [f64; 3] {
    TO_XYZ.map(|row| row.iter().zip(rgb).map(|(a, x)| a * x).sum())
}

/// Lightness, red against green, blue against yellow, linear in light (YCxCz).
fn opponent(rgb: Colour) -> Colour {
    let [x, y, z] = over_white(rgb);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)].map(|v| v as f32)
}

fn rgb_of_opponent(o: Colour) -> Colour {
    let [l, cx, cz] = o.map(f64::from);
    let y = (l + 16.0) / 116.0;
    let white = xyz([1.0; 3]);
    let v = glam::DVec3::new((y + cx / 500.0) * white[0], y * white[1], (y - cz / 200.0) * white[2]);
    let matrix = glam::DMat3::from_cols_array_2d(&TO_XYZ).transpose();
    (matrix.inverse() * v).as_vec3().to_array()
}

/// CIE L*a*b*.
fn lab(rgb: Colour) -> Colour {
    const STEP: f64 = 6.0 / 29.0;
    let [x, y, z] =
        over_white(rgb).map(|t| if t > STEP.powi(3) { t.cbrt() } else { t / (3.0 * STEP * STEP) + 4.0 / 29.0 });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)].map(|v| v as f32)
}

/// Colours are less colourful in the dark.
fn hunt([l, a, b]: Colour) -> Colour {
    [l, 0.01 * l * a, 0.01 * l * b]
}

/// HyAB: lightness and colour apart, for large differences.
fn distance(p: Colour, q: Colour) -> f32 {
    (p[0] - q[0]).abs() + (p[1] - q[1]).hypot(p[2] - q[2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::Seed;

    const SIZE: [usize; 2] = [48, 32];

    fn noise(key: u64, scale: f32) -> [Vec<f32>; 3] {
        let n = (SIZE[0] * SIZE[1]) as u64;
        std::array::from_fn(|c| (0..n).map(|i| scale * Seed(key).derive(c as u64).uniform(i)).collect())
    }

    fn flat(value: f32) -> [Vec<f32>; 3] {
        std::array::from_fn(|_| vec![value; SIZE[0] * SIZE[1]])
    }

    fn mean(a: &[Vec<f32>; 3], b: &[Vec<f32>; 3], settings: FlipSettings) -> f64 {
        fn slices(p: &[Vec<f32>; 3]) -> [&[f32]; 3] {
            p.each_ref().map(Vec::as_slice)
        }
        let all = map(slices(a), slices(b), SIZE, settings);
        assert!(all.iter().all(|x| (0.0..=1.0).contains(x)));
        all.iter().map(|&x| f64::from(x)).sum::<f64>() / all.len() as f64
    }

    #[test]
    fn the_same_picture_has_no_difference_and_black_on_white_the_largest_of_greys() {
        let ldr = FlipSettings { ldr: true, ..FlipSettings::default() };
        for settings in [ldr, FlipSettings::default()] {
            assert_eq!(mean(&noise(1, 1.0), &noise(1, 1.0), settings), 0.0);
        }
        // Black and white are 100 apart in lightness; flat pictures have no features.
        let eye = Eye::new(67.0);
        let expected = f64::from(eye.spread(100.0_f32.powf(COLOUR_EXPONENT)));
        assert!((mean(&flat(0.0), &flat(1.0), ldr) - expected).abs() < 1e-4);
        assert!((mean(&flat(1.0), &flat(0.0), ldr) - expected).abs() < 1e-4);
        assert!(expected > 0.95 && expected < 1.0);
    }

    #[test]
    fn light_is_compared_at_the_exposures_of_the_reference() {
        // A picture and its reference, brighter by any factor, differ as much: exposures follow.
        let settings = FlipSettings::default();
        let once = mean(&noise(1, 1.0), &noise(2, 1.0), settings);
        let bright = mean(&noise(1, 1024.0), &noise(2, 1024.0), settings);
        assert!((once - bright).abs() < 1e-5 && once > 0.05, "{once} {bright}");
        let [start, .., stop] = exposures(&[[1.0; 3], [4.0; 3], [64.0; 3]])[..] else { panic!("fewer than two") };
        assert!((stop - start - 4.0).abs() < 1e-12);
        assert!((f64::from(tone(64.0 * start.exp2() as f32)) - EXPOSED).abs() < 1e-5);
        assert_eq!(exposures(&[[0.0; 3]; 9]), [0.0]);
    }

    #[test]
    fn finer_differences_are_seen_from_nearby_alone() {
        let settings = |ppd| FlipSettings { pixels_per_degree: ppd, ldr: true };
        let checker: [Vec<f32>; 3] =
            std::array::from_fn(|_| (0..SIZE[0] * SIZE[1]).map(|i| ((i % SIZE[0] + i / SIZE[0]) % 2) as f32).collect());
        let near = mean(&checker, &flat(0.5), settings(15.0));
        let far = mean(&checker, &flat(0.5), settings(120.0));
        assert!(far < 0.5 * near, "{near} {far}");
    }

    #[test]
    fn colours_come_back_from_their_opponents() {
        for i in 0..50 {
            let colour: Colour = std::array::from_fn(|c| Seed(3).uniform(3 * i + c as u64));
            let back = rgb_of_opponent(opponent(colour));
            assert!((0..3).all(|c| (back[c] - colour[c]).abs() < 1e-5), "{colour:?} {back:?}");
        }
        assert!((lab([1.0; 3])[0] - 100.0).abs() < 1e-4);
    }
}
