//! A picture to draw on: fills, contour lines, words and legends.

use crate::inspect::glyphs::{ADVANCE, GLYPH_HEIGHT, is_set};
use crate::inspect::palette::{Rgb, mixed};
use crate::output::OutputError;
use crate::output::View;
use crate::output::png;

/// Pictures narrower than this have no room for a legend [pixels].
const LEGEND_MIN_WIDTH: u32 = 240;

/// Linear light on pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct Canvas {
    /// Width and height [pixels].
    pub size: [u32; 2],
    /// The colours, row after row from the top.
    pub pixels: Vec<Rgb>,
}

/// What colours mean.
pub struct Legend<'a> {
    /// The quantity with its unit.
    pub title: &'a str,
    /// Numbers at both ends of the bar.
    pub range: [f64; 2],
    /// The colour at a share of the bar.
    pub colour: &'a dyn Fn(f64) -> Rgb,
}

impl Canvas {
    /// A picture whose pixels have the given colours by number.
    pub fn from_fn(size: [u32; 2], colour: impl Fn(usize) -> Rgb) -> Self {
        Self { size, pixels: (0..size[0] as usize * size[1] as usize).map(colour).collect() }
    }

    /// Lays a colour over a pixel; `cover` 0 leaves it, 1 replaces it.
    pub fn blend(&mut self, pixel: usize, colour: Rgb, cover: f32) {
        if cover >= 1.0 {
            self.pixels[pixel] = colour;
        } else if cover > 0.0 {
            self.pixels[pixel] = mixed(self.pixels[pixel], colour, cover);
        }
    }

    /// Lays a colour over the lines where `field` is a multiple of `spacing`, or 0 alone without one; `width` [pixels].
    /// Pixels whose neighbours are not finite have no line.
    pub fn contours(&mut self, field: &[f64], spacing: Option<f64>, width: f64, colour: Rgb, opacity: f32) {
        let [columns, rows] = self.size.map(|n| n as usize);
        for i in 0..field.len() {
            let (x, y) = (i % columns, i / columns);
            let slope = |low: usize, high: usize, steps: usize| {
                if steps == 0 { 0.0 } else { (field[high] - field[low]) / steps as f64 }
            };
            let (left, right) = (x.saturating_sub(1), (x + 1).min(columns - 1));
            let (top, bottom) = (y.saturating_sub(1), (y + 1).min(rows - 1));
            let steepness = slope(y * columns + left, y * columns + right, right - left).hypot(slope(
                top * columns + x,
                bottom * columns + x,
                bottom - top,
            ));
            let from_level = spacing.map_or(field[i], |s| field[i] - (field[i] / s).round() * s).abs();
            let cover = 0.5 * width + 0.5 - from_level / steepness;
            if cover.is_finite() {
                self.blend(i, colour, opacity * cover.clamp(0.0, 1.0) as f32);
            }
        }
    }

    /// Lays a colour over a rectangle; what is beyond the picture is left out.
    pub fn fill(&mut self, [x, y]: [u32; 2], [width, height]: [u32; 2], colour: Rgb, opacity: f32) {
        for row in y..(y + height).min(self.size[1]) {
            for column in x..(x + width).min(self.size[0]) {
                self.blend(row as usize * self.size[0] as usize + column as usize, colour, opacity);
            }
        }
    }

    /// Writes words with their top left corner at a pixel, each dot `dot` pixels wide.
    pub fn text(&mut self, [x, y]: [u32; 2], dot: u32, words: &str, colour: Rgb) {
        for (n, letter) in words.chars().enumerate() {
            for row in 0..GLYPH_HEIGHT {
                for column in (0..ADVANCE - 1).filter(|&column| is_set(letter, column, row)) {
                    let at = [x + (n as u32 * ADVANCE + column) * dot, y + row * dot];
                    self.fill(at, [dot, dot], colour, 1.0);
                }
            }
        }
    }

    /// Draws a legend in the lower left corner, where there is room for one.
    pub fn legend(&mut self, legend: &Legend) {
        if self.size[0] < LEGEND_MIN_WIDTH {
            return;
        }
        let dot = (self.size[1].min(self.size[0]) / 360).max(1);
        let labels = legend.range.map(spelled);
        let columns = |words: &str| words.chars().count() as u32 * ADVANCE;
        let needed = columns(legend.title).max(columns(&labels[0]) + columns(&labels[1]) + 2 * ADVANCE);
        let (pad, bar_height, line) = (6 * dot, 6 * dot, (GLYPH_HEIGHT + 4) * dot);
        let bar_width = needed.max(120) * dot;
        let panel = [bar_width + 2 * pad, 2 * line + bar_height + 2 * pad - 4 * dot];
        let margin = 8 * dot;
        if panel[1] + margin > self.size[1] || panel[0] + margin > self.size[0] {
            return;
        }
        let corner = [margin, self.size[1] - margin - panel[1]];
        let [x, y] = corner.map(|c| c + pad);
        let ink = [0.85; 3];
        self.fill(corner, panel, [0.006, 0.008, 0.012], 0.8);
        self.text([x, y], dot, legend.title, ink);
        for column in 0..bar_width {
            let colour = (legend.colour)(f64::from(column) / f64::from(bar_width - 1));
            self.fill([x + column, y + line], [1, bar_height], colour, 1.0);
        }
        let below = y + line + bar_height + 4 * dot;
        self.text([x, below], dot, &labels[0], ink);
        self.text([x + bar_width + dot - columns(&labels[1]) * dot, below], dot, &labels[1], ink);
    }

    /// The bytes of a .png file.
    ///
    /// # Errors
    /// When the picture is larger than the format allows.
    pub fn to_png(&self) -> Result<Vec<u8>, OutputError> {
        png::encode(&self.pixels, self.size, View::Standard, 0.0)
    }
}

/// A number with three digits that count, as people write it: `0.125`, `1.24`, `3.1e-9`.
pub fn spelled(x: f64) -> String {
    if x == 0.0 {
        return "0".into();
    }
    if !(1e-3..1e4).contains(&x.abs()) {
        return format!("{x:.1e}");
    }
    let before = x.abs().log10().floor() as i32;
    let text = format!("{x:.*}", (2 - before).max(0) as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

/// 1, 2 or 5 times a power of ten: the least such step of which at most `count` fit into `range`. 1 where the range is
/// empty or not finite.
pub fn round_step(range: f64, count: f64) -> f64 {
    let raw = range / count;
    if !(raw.is_finite() && raw > 1e-300) {
        return 1.0;
    }
    let power = 10f64.powf(raw.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|f| f * power >= raw).unwrap_or(10.0);
    factor * power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_spelled_briefly() {
        let cases = [(0.0, "0"), (1.2345, "1.23"), (-0.5, "-0.5"), (123.4, "123"), (3.14e-9, "3.1e-9"), (20.0, "20")];
        for (x, text) in cases {
            assert_eq!(spelled(x), text);
        }
        assert_eq!((round_step(10.0, 20.0), round_step(0.7, 10.0), round_step(0.0, 5.0)), (0.5, 0.1, 1.0));
    }

    #[test]
    fn a_contour_is_as_wide_as_asked_wherever_the_field_is_steep() {
        let field: Vec<f64> = (0..100 * 10).map(|i| f64::from(i % 100) * 0.01 - 0.5).collect();
        let mut canvas = Canvas::from_fn([100, 10], |_| [0.0; 3]);
        canvas.contours(&field, Some(0.25), 2.0, [1.0; 3], 1.0);
        let ink: f32 = canvas.pixels[500..600].iter().map(|p| p[0]).sum();
        // Levels −½, −¼, 0, ¼; that at the edge is cut in half.
        assert!((ink - 7.5).abs() < 0.6, "{ink}");
        let mut untouched = Canvas::from_fn([100, 10], |_| [0.0; 3]);
        untouched.contours(&[f64::INFINITY; 1000], Some(0.25), 2.0, [1.0; 3], 1.0);
        assert!(untouched.pixels.iter().all(|p| *p == [0.0; 3]));
    }

    #[test]
    fn a_legend_stays_inside_and_is_left_out_of_small_pictures() {
        let legend = Legend { title: "speed [m/s]", range: [0.0, 1.24], colour: &|x| [x as f32; 3] };
        for (size, is_drawn) in [([640, 360], true), ([240, 60], true), ([100, 100], false), ([300, 20], false)] {
            let mut canvas = Canvas::from_fn(size, |_| [0.5; 3]);
            canvas.legend(&legend);
            assert_eq!(canvas.pixels.iter().any(|p| *p != [0.5; 3]), is_drawn, "{size:?}");
        }
    }
}
