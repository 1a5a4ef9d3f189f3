//! Several pictures on one: contact sheets.

use crate::inspect::canvas::Canvas;
use crate::inspect::glyphs::{ADVANCE, GLYPH_HEIGHT};
use crate::output::View;
use crate::output::image::Image;
use crate::output::view::{linear_from_srgb, on_screen};
use thiserror::Error;

/// Most pixels of a sheet.
const PIXELS_MAX: u64 = 1 << 28;
/// What lies between pictures.
const GROUND: [f32; 3] = [0.012; 3];
const INK: [f32; 3] = [0.6; 3];

/// Memory of a pixel of a sheet [bytes]: of its light, of what the screen shows, and of the file, which grows while it is packed.
const PIXEL_BYTES: u64 = 12 + 3 + 6;

/// What is known of a picture before it is there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cell {
    /// What is written below it, in lines.
    pub label: String,
    /// Its own width and height [pixels].
    pub size: [u32; 2],
}

/// A picture as the screen shows it.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    size: [u32; 2],
    /// Light that the view `Standard` shows as it is meant, row after row from the top.
    pixels: Vec<[f32; 3]>,
}

/// Where everything is on a sheet.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    size: [u32; 2],
    /// Edge of the dots that letters are made of [pixels].
    dot: u32,
    /// Lines of text, each with its top left corner.
    lines: Vec<([u32; 2], String)>,
    /// Top left corner and size of each picture.
    places: Vec<([u32; 2], [u32; 2])>,
}

/// Why there is no sheet.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SheetError {
    /// Nothing to show.
    #[error("there are no pictures")]
    Empty,
    /// A picture without colours.
    #[error("there are no channels R, G and B")]
    NoColour,
    /// Too large.
    #[error("the sheet would have {} × {} pixels; make pictures narrower with --width, or take fewer", .0[0], .0[1])]
    TooLarge([u64; 2]),
    /// Another size than its place on the sheet.
    #[error("the picture is {} × {} pixels on the sheet, and was to be {} × {}", .found[0], .found[1], .expected[0], .expected[1])]
    OtherSize {
        /// That of the picture [pixels].
        found: [u32; 2],
        /// That of its place [pixels].
        expected: [u32; 2],
    },
}

/// How pictures are laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SheetSettings {
    /// Pictures side by side; as many as make the sheet about as wide as a screen where `None`.
    pub columns: Option<u32>,
    /// Width of a picture [pixels]; wider ones are scaled down to it. Their own where `None`.
    pub width: Option<u32>,
    /// Whether each has its label below.
    pub is_labelled: bool,
}

impl Picture {
    /// A picture in linear light as `view` shows it with `exposure_ev` stops of exposure, scaled down to `width` [pixels] if it is
    /// wider.
    ///
    /// # Errors
    /// [`SheetError::NoColour`].
    pub fn new(image: &Image, view: View, exposure_ev: f64, width: Option<u32>) -> Result<Self, SheetError> {
        let gain = exposure_ev.exp2() as f32;
        let rgb = image.to_rgb("").ok_or(SheetError::NoColour)?;
        let shown = |c: &[f32; 3]| on_screen(view, c.map(|x| x * gain)).map(linear_from_srgb);
        let (size, rgb) = image.shown(&rgb);
        Ok(Self { size, pixels: rgb.iter().map(shown).collect() }.narrowed(width))
    }

    /// Width and height [pixels].
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Memory that it takes [bytes].
    pub fn memory_bytes(&self) -> u64 {
        size_of_val(self.pixels.as_slice()) as u64
    }

    /// Scaled down to a width: each pixel is the mean of the light on its area.
    fn narrowed(self, width: Option<u32>) -> Self {
        let [width, height] = narrowed_size(self.size, width);
        let [own_width, own_height] = self.size;
        if width == own_width {
            return self;
        }
        let rows = weights(own_height, height);
        let columns = weights(own_width, width);
        let mut pixels = Vec::with_capacity(width as usize * height as usize);
        for row in &rows {
            for column in &columns {
                let mut sum = [0.0; 3];
                for &(y, weight_y) in row {
                    for &(x, weight_x) in column {
                        let pixel = self.pixels[y as usize * own_width as usize + x as usize];
                        (0..3).for_each(|c| sum[c] += weight_x * weight_y * pixel[c]);
                    }
                }
                pixels.push(sum);
            }
        }
        Self { size: [width, height], pixels }
    }
}

/// The size of a picture that is no wider than `width` [pixels].
fn narrowed_size([own_width, own_height]: [u32; 2], width: Option<u32>) -> [u32; 2] {
    match width {
        Some(width) if width < own_width => {
            let height = (f64::from(own_height) * f64::from(width) / f64::from(own_width)).round() as u32;
            [width, height.max(1)]
        }
        _ => [own_width, own_height],
    }
}

/// The pixels, and their shares, that each of `to` pixels has of `from`.
fn weights(from: u32, to: u32) -> Vec<Vec<(u32, f32)>> {
    let scale = f64::from(from) / f64::from(to);
    let of_pixel = |i: u32| {
        let (low, high) = (f64::from(i) * scale, f64::from(i + 1) * scale);
        let last = (high.ceil() as u32).min(from);
        let share = |x: u32| ((high.min(f64::from(x) + 1.0) - low.max(f64::from(x))) / scale) as f32;
        (low as u32..last).map(|x| (x, share(x))).collect()
    };
    (0..to).map(of_pixel).collect()
}

impl Layout {
    /// Pictures in rows, below the lines of a title.
    ///
    /// # Errors
    /// [`SheetError::Empty`], [`SheetError::TooLarge`].
    pub fn new(cells: &[Cell], title: &[String], settings: SheetSettings) -> Result<Self, SheetError> {
        let sizes: Vec<[u32; 2]> = cells.iter().map(|cell| narrowed_size(cell.size, settings.width)).collect();
        let width = sizes.iter().map(|size| size[0]).max().ok_or(SheetError::Empty)?;
        let tallest = sizes.iter().map(|size| size[1]).max().ok_or(SheetError::Empty)?;
        let dot = dot_size(cells, width);
        let line = (GLYPH_HEIGHT + 4) * dot;
        let line_count = cells.iter().map(|cell| cell.label.lines().count() as u32).max().unwrap_or(0);
        let (gap, strip) = if settings.is_labelled { (8 * dot, line_count * line + 4 * dot) } else { (0, 0) };
        let head = title.len() as u32 * line + if title.is_empty() { 0 } else { gap };
        let columns =
            settings.columns.unwrap_or_else(|| columns_of_screen(cells.len(), width + gap, tallest + gap + strip));
        let columns = (columns as usize).clamp(1, cells.len());
        let heights: Vec<u32> =
            sizes.chunks(columns).map(|row| row.iter().map(|size| size[1]).max().unwrap_or(0)).collect();
        let full = [
            columns as u64 * u64::from(width + gap) + u64::from(gap),
            heights.iter().map(|&h| u64::from(h + gap + strip)).sum::<u64>() + u64::from(gap + head),
        ];
        if full[0].saturating_mul(full[1]) > PIXELS_MAX {
            return Err(SheetError::TooLarge(full));
        }
        let size = full.map(|n| n as u32);
        let letters = |width: u32| (width / dot / ADVANCE) as usize;
        let mut lines: Vec<_> = (0..)
            .zip(title)
            .map(|(i, words)| ([gap, gap + i * line], fitting(words, letters(size[0].saturating_sub(2 * gap)))))
            .collect();
        let mut places = Vec::with_capacity(cells.len());
        let mut top = gap + head;
        for ((row, sizes), height) in cells.chunks(columns).zip(sizes.chunks(columns)).zip(heights) {
            for (i, (cell, own)) in (0..).zip(row.iter().zip(sizes)) {
                let left = gap + i * (width + gap);
                // In the middle of its place, on the line of its label.
                places.push(([left + (width - own[0]) / 2, top + height - own[1]], *own));
                if settings.is_labelled {
                    let first = top + height + 4 * dot;
                    let labels = (0..).zip(cell.label.lines());
                    lines.extend(labels.map(|(i, words)| ([left, first + i * line], fitting(words, letters(width)))));
                }
            }
            top += height + gap + strip;
        }
        Ok(Self { size, dot, lines, places })
    }

    /// Memory that it takes to draw the sheet and to write it [bytes].
    pub fn memory_bytes(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.size[1]) * PIXEL_BYTES
    }

    /// The sheet with all its words and no picture.
    pub fn blank(&self) -> Canvas {
        let mut canvas = Canvas::from_fn(self.size, |_| GROUND);
        for (corner, words) in &self.lines {
            canvas.text(*corner, self.dot, words, INK);
        }
        canvas
    }

    /// Puts the picture with a number, from 0, in its place on the sheet.
    ///
    /// # Errors
    /// [`SheetError::OtherSize`].
    ///
    /// # Panics
    /// Where there is no such number, or the canvas is not of this layout.
    pub fn put(&self, canvas: &mut Canvas, number: usize, picture: &Picture) -> Result<(), SheetError> {
        let (corner, expected) = self.places[number];
        if picture.size != expected {
            return Err(SheetError::OtherSize { found: picture.size, expected });
        }
        for (y, line) in picture.pixels.chunks(expected[0] as usize).enumerate() {
            let start = (corner[1] as usize + y) * self.size[0] as usize + corner[0] as usize;
            canvas.pixels[start..start + line.len()].copy_from_slice(line);
        }
        Ok(())
    }
}

/// Letters as large as lets every line of the labels fit, within what looks well beside pictures of a width: the size of their
/// dots [pixels].
fn dot_size(cells: &[Cell], width: u32) -> u32 {
    let longest = cells.iter().flat_map(|cell| cell.label.lines()).map(|line| line.chars().count()).max().unwrap_or(0);
    let fits = width / (ADVANCE * (longest as u32).max(1));
    fits.clamp((width / 320).max(1), (width / 160).max(1))
}

/// As many pictures side by side as make a sheet of 16 to 9, or a little wider.
fn columns_of_screen(count: usize, width: u32, height: u32) -> u32 {
    let columns = (count as f64 * f64::from(height) / f64::from(width) * 16.0 / 9.0).sqrt();
    (columns.round() as u32).max(1)
}

/// Small letters, which are those that there are, and as many as fit: the end says most.
fn fitting(label: &str, count: usize) -> String {
    let label = label.to_lowercase();
    let length = label.chars().count();
    if length <= count {
        return label;
    }
    let kept: String = label.chars().skip(length - count.saturating_sub(2)).collect();
    format!("..{kept}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(label: &str, size: [u32; 2]) -> Cell {
        Cell { label: label.into(), size }
    }

    /// The sheet of pictures that are of one colour each.
    fn sheet(cells: &[(Cell, f32)], title: &[String], settings: SheetSettings) -> Canvas {
        let layout = Layout::new(&cells.iter().map(|(cell, _)| cell.clone()).collect::<Vec<_>>(), title, settings);
        let layout = layout.unwrap_or_else(|e| panic!("{e}"));
        let mut canvas = layout.blank();
        assert!(layout.memory_bytes() > size_of_val(canvas.pixels.as_slice()) as u64);
        for (i, (Cell { size, .. }, value)) in cells.iter().enumerate() {
            let picture = Picture { size: *size, pixels: vec![[*value; 3]; (size[0] * size[1]) as usize] };
            layout.put(&mut canvas, i, &picture.narrowed(settings.width)).unwrap_or_else(|e| panic!("{e}"));
        }
        canvas
    }

    #[test]
    fn scaling_down_keeps_the_mean() {
        let pixels: Vec<[f32; 3]> = (0..7 * 5).map(|i| [(i * i % 11) as f32, 1.0, 0.5]).collect();
        let mean = |pixels: &[[f32; 3]]| pixels.iter().map(|p| p[0]).sum::<f32>() / pixels.len() as f32;
        let own = Picture { size: [7, 5], pixels };
        let wanted = mean(&own.pixels);
        // A height of 2.857 is 3: only whole ratios keep it exactly, so both edges are asked for at once.
        let small = own.clone().narrowed(Some(4));
        assert_eq!(small.size, [4, 3]);
        assert!((mean(&small.pixels) - wanted).abs() < 1e-4, "{} {wanted}", mean(&small.pixels));
        assert!(small.pixels.iter().all(|p| (p[1] - 1.0).abs() < 1e-5));
        assert_eq!(own.clone().narrowed(Some(9)), own);
        assert_eq!(own.clone().narrowed(None), own);
    }

    #[test]
    fn every_picture_and_label_is_on_the_sheet() {
        let cells = [(cell("a=1", [40, 20]), 0.9), (cell("b", [30, 10]), 0.8), (cell("c", [40, 20]), 0.7)];
        let settings = SheetSettings { columns: Some(2), width: None, is_labelled: true };
        let canvas = sheet(&cells, &[], settings);
        let count = |canvas: &Canvas, value: f32| canvas.pixels.iter().filter(|p| (p[0] - value).abs() < 1e-5).count();
        assert_eq!([0.9, 0.8, 0.7].map(|value| count(&canvas, value)), [800, 300, 800]);
        assert!(count(&canvas, INK[0]) > 20);
        let narrow = sheet(&cells, &[], SheetSettings { width: Some(20), ..settings });
        assert_eq!([0.9, 0.8, 0.7].map(|value| count(&narrow, value)), [200, 140, 200]);
        let bare = SheetSettings { is_labelled: false, columns: None, width: None };
        assert_eq!(sheet(&cells[..1], &[], bare).size, [40, 20]);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let bare = SheetSettings::default();
        assert_eq!(Layout::new(&[], &[], bare).unwrap_err(), SheetError::Empty);
        let large = vec![cell("", [1 << 16, 1 << 15]); 3];
        assert!(matches!(Layout::new(&large, &[], bare), Err(SheetError::TooLarge(_))));
        Layout::new(&large, &[], SheetSettings { width: Some(320), ..bare }).unwrap();
        let layout = Layout::new(&[cell("", [4, 4])], &[], bare).unwrap();
        let other = Picture { size: [4, 3], pixels: vec![[0.0; 3]; 12] };
        let error = layout.put(&mut layout.blank(), 0, &other).unwrap_err();
        assert_eq!(error, SheetError::OtherSize { found: [4, 3], expected: [4, 4] });
    }

    #[test]
    fn titles_and_further_lines_have_room_of_their_own() {
        let settings = SheetSettings { columns: Some(1), width: None, is_labelled: true };
        let of = |label: &str, title: &[String]| sheet(&[(cell(label, [200, 20]), 0.9)], title, settings);
        let ink = |canvas: &Canvas| canvas.pixels.iter().filter(|p| **p == INK).count();
        let one = of("a=1", &[]);
        let two = of("a=1\na=1", &[]);
        assert_eq!((ink(&two), two.size[1]), (2 * ink(&one), one.size[1] + GLYPH_HEIGHT + 4));
        let titled = of("a=1", &["a=1".into()]);
        assert_eq!(ink(&titled), 2 * ink(&one));
        assert_eq!(titled.pixels.iter().filter(|p| p[0] == 0.9).count(), 4000);
    }

    #[test]
    fn letters_grow_as_long_as_all_fit() {
        assert_eq!(dot_size(&[cell("a=1", [640, 9])], 640), 4);
        assert_eq!(dot_size(&[cell("a=1", [640, 9]), cell(&"x".repeat(40), [640, 9])], 640), 2);
        assert_eq!(dot_size(&[cell(&"x".repeat(99), [100, 9])], 100), 1);
    }

    #[test]
    fn a_sheet_is_about_as_wide_as_a_screen() {
        for (count, columns) in [(1, 1), (4, 2), (9, 3), (16, 4)] {
            assert_eq!(columns_of_screen(count, 160, 90), columns);
        }
        assert_eq!(fitting("A_long_name", 6), "..name");
    }
}
