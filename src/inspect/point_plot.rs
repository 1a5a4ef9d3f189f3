//! A picture of how evenly points are spread: their radial distribution function, and the median distance to the closest.

use crate::inspect::canvas::{Canvas, round_step, spelled};
use crate::inspect::palette::Rgb;
use crate::points::nearest::RadialDistribution;

const PAPER: Rgb = [0.9; 3];
const INK: Rgb = [0.02; 3];
const GRID: Rgb = [0.6; 3];
const CURVE: Rgb = [0.02, 0.12, 0.5];
const MEDIAN: Rgb = [0.6, 0.03, 0.03];
/// Room round the diagram [dots]: left, top, right, bottom.
const MARGIN: [u32; 4] = [36, 22, 12, 24];

/// Draws it; `median` is marked by a dashed line.
pub fn paint(title: &str, distribution: &RadialDistribution, median: f64, size: [u32; 2]) -> Canvas {
    let mut canvas = Canvas::from_fn(size, |_| PAPER);
    let dot = (size[0].min(size[1]) / 240).max(1);
    let [left, top, right, bottom] = MARGIN.map(|n| n * dot);
    if size[0] < left + right + 8 || size[1] < top + bottom + 8 {
        return canvas;
    }
    let [width, height] = [size[0] - left - right, size[1] - top - bottom];
    let reach = distribution.bin * distribution.values.len() as f64;
    let highest = distribution.values.iter().fold(2.0f64, |a, b| a.max(*b)).min(8.0);
    let x_of = |x: f64| left + (x / reach * f64::from(width)) as u32;
    let y_of = |y: f64| top + height - (y.min(highest) / highest * f64::from(height)) as u32;

    for (range, is_across) in [(reach, true), (highest, false)] {
        let step = round_step(range, 6.0);
        for k in 0..=(range / step + 1e-9) as u32 {
            let value = f64::from(k) * step;
            let words = spelled(value);
            let columns = words.chars().count() as u32 * crate::inspect::glyphs::ADVANCE * dot;
            if is_across {
                canvas.fill([x_of(value), top], [1, height], GRID, 0.7);
                canvas.text([x_of(value) - columns / 2, top + height + 6 * dot], dot, &words, INK);
            } else {
                canvas.fill([left, y_of(value)], [width, 1], GRID, 0.7);
                canvas.text([left.saturating_sub(columns + 2 * dot), y_of(value) - 3 * dot], dot, &words, INK);
            }
        }
    }
    canvas.text([left, 6 * dot], dot, title, INK);
    for y in (top..top + height).step_by(6 * dot as usize) {
        canvas.fill([x_of(median.min(reach)), y], [dot, 3 * dot], MEDIAN, 1.0);
    }
    let bins = distribution.values.len();
    let mut before = None;
    for column in 0..width {
        let bin = (column as usize * bins / width as usize).min(bins - 1);
        let y = y_of(distribution.values[bin]);
        let (low, high) = before.map_or((y, y), |b: u32| (b.min(y), b.max(y)));
        canvas.fill([left + column, low], [dot, high - low + dot], CURVE, 1.0);
        before = Some(y);
    }
    canvas
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_and_the_median_are_where_they_belong() {
        let values = (0..100).map(|k| if k < 50 { 0.0 } else { 2.0 }).collect();
        let canvas = paint("g", &RadialDistribution { bin: 0.01, values }, 0.25, [480, 240]);
        let is = |x: u32, y: u32, colour: Rgb| canvas.pixels[(y * 480 + x) as usize] == colour;
        // 480 pixels less margins of 36 and 12, 240 less 22 and 24.
        assert!((0..10).any(|k| is(36 + 108, 22 + k, MEDIAN)));
        assert!(is(36 + 100, 22 + 194, CURVE) && is(36 + 400, 22, CURVE) && !is(36 + 100, 22, CURVE));
        assert_eq!(paint("g", &RadialDistribution { bin: 0.01, values: vec![1.0] }, 0.1, [10, 10]).pixels.len(), 100);
    }
}
