//! The numbers of a channel at a glance: what there is, where it is most, and what should not be there.

use crate::output::image::{Channel, Image};

/// What the numbers of a channel are like. Least, largest, mean and shares are those of finite numbers, and not-a-number where there is
/// none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Survey {
    /// Least number.
    pub least: f32,
    /// Number that half of all are below.
    pub median: f32,
    /// Number that 99 % of all are below.
    pub high: f32,
    /// Largest number.
    pub largest: f32,
    /// Where the first of the largest is, in the display window.
    pub largest_at: [i32; 2],
    /// Mean.
    pub mean: f64,
    /// Numbers below 0.
    pub negative: usize,
    /// Numbers that are infinite.
    pub infinite: usize,
    /// What is no number.
    pub nan: usize,
}

/// Surveys a channel of a picture.
pub fn survey(image: &Image, channel: &Channel) -> Survey {
    let mut finite: Vec<f32> = channel.data.iter().copied().filter(|x| x.is_finite()).collect();
    finite.sort_unstable_by(f32::total_cmp);
    let nan = channel.data.iter().filter(|x| x.is_nan()).count();
    let at = |share: f64| finite.get(((finite.len() as f64 * share) as usize).min(finite.len().saturating_sub(1)));
    let number = |x: Option<&f32>| x.copied().unwrap_or(f32::NAN);
    let largest = number(finite.last());
    let place = channel.data.iter().position(|x| *x == largest).unwrap_or(0);
    Survey {
        least: number(finite.first()),
        median: number(at(0.5)),
        high: number(at(0.99)),
        largest,
        largest_at: image.position(place),
        mean: finite.iter().map(|&x| f64::from(x)).sum::<f64>() / finite.len() as f64,
        negative: finite.iter().filter(|x| **x < 0.0).count(),
        infinite: channel.data.len() - finite.len() - nan,
        nan,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::image::SampleKind;

    #[test]
    fn what_should_not_be_there_is_counted_and_left_out() {
        let mut image = Image::cropped([100, 50], [10, 20, 20, 30]);
        let mut data: Vec<f32> = (0..100).map(|i| i as f32).collect();
        (data[0], data[1], data[2], data[50]) = (f32::NAN, f32::INFINITY, -4.0, 1000.0);
        image.push("R", SampleKind::Float, data);
        let found = survey(&image, &image.channels[0]);
        assert_eq!((found.nan, found.infinite, found.negative), (1, 1, 1));
        assert_eq!((found.least, found.largest, found.largest_at), (-4.0, 1000.0, [10, 25]));
        assert_eq!((found.median, found.high), (52.0, 1000.0));
        let sum: f64 = (3..100).filter(|i| *i != 50).map(f64::from).sum::<f64>() + 996.0;
        assert!((found.mean - sum / 98.0).abs() < 1e-9);
        image.channels[0].data.fill(f32::NAN);
        let found = survey(&image, &image.channels[0]);
        assert!(found.least.is_nan() && found.mean.is_nan() && found.nan == 100);
    }
}
