//! What can be known of the noise of pixels beyond the variance that each says of itself.
//!
//! - *Pooling.* The variance between a few runs is hardly known: of two runs that agree by chance it is zero. The squared deviations
//!   of a pixel are therefore joined with those of its neighbours, as so many degrees of freedom as the picture shows them to be
//!   worth: many where noise is even, few where it differs from pixel to pixel, as at edges. These are the moderated variances of
//!   Smyth 2004 (*Linear Models and Empirical Bayes Methods*), with a prior of the neighbourhood and its degrees by moments.
//! - *Correlation.* Renderers that splat a path into several pixels make errors of neighbours alike, and the mean of a block is then
//!   far noisier than its pixels say. How much is measured in the differences themselves.

/// Half the widths of the squares over which variances are pooled, tried in turn [pixels].
const RADII: [usize; 4] = [2, 4, 8, 16];

/// Degrees of freedom that a square must hold at least.
const DEGREES_MIN: f64 = 8.0;

/// Most that neighbours count for, in degrees of freedom for each of the pixel's own: those of a square of the smallest size, less
/// what they may have in common.
const PRIOR_MAX: f64 = 20.0;

/// Fewest pixels that tell how much the noise of neighbours differs.
const SAMPLE_MIN: usize = 30;

/// Distance up to which errors of pixels may be alike [pixels].
const REACH: usize = 2;

/// Standard deviations by which correlations must stand out to be believed.
const SIGNIFICANT: f64 = 3.0;

/// Variances that are known better than from a pixel alone.
pub(crate) struct Pooled {
    /// For each pixel.
    pub variance: Vec<f64>,
    /// Degrees of freedom of each, more than 4.
    pub degrees: f64,
}

/// Joins variances of `degrees` (≥ 1) degrees of freedom each, of a picture of this width, with those of their neighbours.
pub(crate) fn pooled(variance: &[f64], width: usize, degrees: f64) -> Pooled {
    let squares: Vec<f64> = variance.iter().map(|v| v * v).collect();
    let mean = variance.iter().sum::<f64>() / variance.len().max(1) as f64;
    // Where hardly anything is known even in the largest squares, all of the picture must do.
    let mut prior = vec![f64::NAN; variance.len()];
    let mut deviations = (0.0, 0usize);
    for (step, radius) in RADII.into_iter().enumerate() {
        if prior.iter().all(|p| !p.is_nan()) {
            break;
        }
        let (sums, sums_of_squares) = (box_sums(variance, width, radius), box_sums(&squares, width, radius));
        let areas = box_sums(&vec![1.0; variance.len()], width, radius);
        for (i, own) in variance.iter().enumerate() {
            let mean = sums[i] / areas[i];
            // Also where little is known: squares of even noise alone would tell that all noise is even.
            if step == 0 && mean > 0.0 {
                deviations.0 += (own / mean - 1.0).powi(2);
                deviations.1 += 1;
            }
            let known = sums[i] * sums[i] / sums_of_squares[i] * degrees;
            if prior[i].is_nan() && known >= DEGREES_MIN {
                prior[i] = mean;
            }
            // So many pixels that agree in all runs have no noise, whatever others have.
            if step + 1 == RADII.len() && mean == 0.0 {
                prior[i] = 0.0;
            }
        }
    }
    let own = degrees;
    let from_prior = if deviations.1 < SAMPLE_MIN {
        prior_degrees(f64::INFINITY, own)
    } else {
        prior_degrees(deviations.0 / deviations.1 as f64, own).min(PRIOR_MAX * own)
    };
    let joined = prior.iter().zip(variance).map(|(p, v)| {
        let prior = if p.is_nan() { mean } else { *p };
        (own * v + from_prior * prior) / (own + from_prior)
    });
    Pooled { variance: joined.collect(), degrees: own + from_prior }
}

/// Degrees of freedom d₀ of a prior: ratios of variances of d degrees to it follow F(d, d₀), whose squared coefficient of variation
/// 2 (d + d₀ − 2) / (d (d₀ − 4)) is the measured `spread`. Infinite where they differ no more than by chance, 4 where by any amount.
fn prior_degrees(spread: f64, degrees: f64) -> f64 {
    let product = spread * degrees;
    match product {
        p if p.is_infinite() => 4.0,
        p if p <= 2.0 => f64::INFINITY,
        p => (4.0 * p + 2.0 * degrees - 4.0) / (p - 2.0),
    }
}

/// Sums over the squares of 2 `radius` + 1 pixels about each pixel, as far as they are within the picture. Summed anew for each:
/// running sums would leave the rounding of bright pixels in dark ones.
fn box_sums(values: &[f64], width: usize, radius: usize) -> Vec<f64> {
    let height = values.len() / width.max(1);
    let near = |at: usize, end: usize| at.saturating_sub(radius)..(at + radius + 1).min(end);
    let rows: Vec<f64> = (0..values.len())
        .map(|i| {
            let (x, row) = (i % width, i - i % width);
            values[row..row + width][near(x, width)].iter().sum()
        })
        .collect();
    (0..values.len()).map(|i| near(i / width, height).map(|y| rows[y * width + i % width]).sum()).collect()
}

/// How many times noisier the sum of many pixels is than if errors were independent, measured in errors in units of their standard
/// deviations, of a picture of this width. 1 where errors of neighbours are no more alike than by chance.
///
/// Means over squares of `block` pixels do not count, as they may be what is to be found.
pub(crate) fn correlation(units: &[f64], width: usize, block: usize) -> f64 {
    let height = units.len() / width.max(1);
    let mut errors = units.to_vec();
    for (y0, x0) in (0..height).step_by(block).flat_map(|y| (0..width).step_by(block).map(move |x| (y, x))) {
        let (ys, xs) = (y0..(y0 + block).min(height), x0..(x0 + block).min(width));
        let count = (ys.len() * xs.len()) as f64;
        let mean = ys.clone().flat_map(|y| &units[y * width..][xs.clone()]).sum::<f64>() / count;
        ys.for_each(|y| errors[y * width..][xs.clone()].iter_mut().for_each(|e| *e -= mean));
    }
    let power: f64 = errors.iter().map(|e| e * e).sum();
    let fourth: f64 = errors.iter().map(|e| e.powi(4)).sum();
    // Half of the neighbours; the others are the same pairs.
    let reach = REACH as isize;
    let lags = (0..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy))).filter(|&(dx, dy)| dy > 0 || dx > 0);
    let (mut total, mut count) = (0.0, 0.0);
    for (dx, dy) in lags {
        for y in 0..height.saturating_sub(dy as usize) {
            let (row, other) = (&errors[y * width..][..width], &errors[(y + dy as usize) * width..][..width]);
            let shift = dx.unsigned_abs().min(width);
            let (row, other) = if dx >= 0 {
                (&row[..width - shift], &other[shift..])
            } else {
                (&row[shift..], &other[..width - shift])
            };
            total += row.iter().zip(other).map(|(a, b)| a * b).sum::<f64>();
        }
        count += 1.0;
    }
    if power <= 0.0 {
        return 1.0;
    }
    let factor = 1.0 + 2.0 * total / power;
    // Where errors are independent, each sum of products has a variance of at most Σe⁴.
    let deviation = (4.0 * count * fourth).sqrt() / power;
    if factor > 1.0 + SIGNIFICANT * deviation { factor } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};

    const WIDTH: usize = 64;
    const COUNT: usize = WIDTH * 48;

    /// Variances of two normal numbers, so with one degree of freedom, of standard deviation `of`.
    fn variances(key: u64, of: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut rng = CounterRng::new(Seed(key));
        // Sums of twelve uniform numbers are normal enough.
        let mut normal = || (0..12).map(|_| f64::from(rng.uniform())).sum::<f64>() - 6.0;
        (0..COUNT).map(|i| 0.5 * (of(i) * (normal() - normal())).powi(2)).collect()
    }

    #[test]
    fn even_noise_is_known_from_neighbours_and_uneven_noise_from_each_pixel() {
        let even = pooled(&variances(1, |_| 2.0), WIDTH, 1.0);
        assert!(even.degrees >= 18.0, "{}", even.degrees);
        let error = even.variance.iter().map(|v| (v / 4.0 - 1.0).powi(2)).sum::<f64>() / COUNT as f64;
        assert!(error < 0.15, "{error}: with one degree of freedom it is 2");
        let uneven = pooled(&variances(2, |i| if i % 9 == 0 { 2.0 } else { 0.1 }), WIDTH, 1.0);
        assert!(uneven.degrees < 8.0, "{}", uneven.degrees);
        let mean = |p: &Pooled| p.variance.iter().sum::<f64>() / COUNT as f64;
        assert!((mean(&even) / 4.0 - 1.0).abs() < 0.1 && (mean(&uneven) / 0.453 - 1.0).abs() < 0.2);
    }

    #[test]
    fn a_pixel_without_a_variance_borrows_from_the_nearest_that_have_one() {
        let mut variance = vec![0.0; COUNT];
        let nothing = pooled(&variance, WIDTH, 3.0);
        assert!(nothing.variance.iter().all(|&v| v == 0.0) && nothing.degrees.is_finite());
        (20..30).for_each(|x| variance[10 * WIDTH + x] = 1.0);
        let line = pooled(&variance, WIDTH, 3.0);
        let at = |x: usize, y: usize| line.variance[y * WIDTH + x];
        assert!(at(25, 11) > 0.02 && at(25, 10) > at(25, 11) && at(25, 20) > 0.0 && at(60, 40) == 0.0);
        assert!(pooled(&[], 0, 1.0).variance.is_empty());
    }

    #[test]
    fn errors_of_neighbours_that_are_alike_are_noticed_and_others_not() {
        let mut rng = CounterRng::new(Seed(4));
        let white: Vec<f64> = (0..COUNT).map(|_| f64::from(rng.uniform()) - 0.5).collect();
        assert_eq!(correlation(&white, WIDTH, 16), 1.0);
        // Every error spread over 2 × 2 pixels: the sum is 4 times as noisy as independent ones of the same variance.
        let get = |x: usize, y: usize| white[(y * WIDTH + x) % COUNT];
        let spread: Vec<f64> = (0..COUNT)
            .map(|i| (i % WIDTH, i / WIDTH))
            .map(|(x, y)| get(x, y) + get(x + 1, y) + get(x, y + 1) + get(x + 1, y + 1))
            .collect();
        let factor = correlation(&spread, WIDTH, 16);
        // Less what the means of blocks take with them.
        assert!((2.8..4.6).contains(&factor), "{factor}");
        // What is even within blocks is a difference, and no noise.
        let shifted: Vec<f64> = white.iter().enumerate().map(|(i, e)| e + (i % WIDTH / 16) as f64).collect();
        assert_eq!(correlation(&shifted, WIDTH, 16), 1.0);
        assert_eq!(correlation(&[0.0; 64], 8, 16), 1.0);
        assert_eq!(correlation(&[], 0, 16), 1.0);
    }
}
