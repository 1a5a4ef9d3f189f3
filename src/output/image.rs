//! A picture: named channels over a rectangle of pixels, and what is known about it.

use serde::{Deserialize, Serialize};

/// How a channel's numbers are kept in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleKind {
    /// 16 bits: colour that people look at. Finite values beyond ±65504 are stored as ±65504.
    Half,
    /// 32 bits: depth, normals, variance, data, references.
    Float,
}

impl SampleKind {
    /// Length of a number in a file [bytes].
    pub fn bytes(self) -> usize {
        match self {
            Self::Half => 2,
            Self::Float => 4,
        }
    }
}

/// One number for each pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// `R`, `Z`, `albedo.G`; what stands before the last dot is the layer.
    pub name: String,
    /// How the numbers are kept in a file.
    pub kind: SampleKind,
    /// The numbers, row after row from the top, of the data window.
    pub data: Vec<f32>,
}

/// What is known about a picture besides its pixels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Attribute {
    /// Text.
    Text(String),
    /// A whole number.
    Int(i32),
    /// A number.
    Float(f32),
    /// Two numbers.
    Float2([f32; 2]),
    /// A fraction: numerator and denominator.
    Rational(i32, u32),
    /// A matrix, row after row.
    Matrix([f32; 16]),
}

/// A picture. The display window is the whole frame, the data window the part of it that has pixels: smaller for a
/// crop, larger for overscan.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Image {
    /// Width and height of the display window [pixels]. Its top left corner is (0, 0).
    pub size: [u32; 2],
    /// Top left corner of the data window, from that of the display window [pixels].
    pub data_origin: [i32; 2],
    /// Width and height of the data window [pixels].
    pub data_size: [u32; 2],
    /// The channels, in the order of [`channel_order`]; each holds as many numbers as the data window has pixels.
    pub channels: Vec<Channel>,
    /// What else is known, by name.
    pub attributes: Vec<(String, Attribute)>,
}

impl Image {
    /// A picture without channels whose data window is the whole frame.
    pub fn new(size: [u32; 2]) -> Self {
        Self { size, data_size: size, ..Self::default() }
    }

    /// A picture without channels with pixels only inside `[x0, y0, x1, y1]`, the right and lower edges excluded.
    ///
    /// # Panics
    /// When the rectangle is empty.
    pub fn cropped(size: [u32; 2], [x0, y0, x1, y1]: [i32; 4]) -> Self {
        assert!(x0 < x1 && y0 < y1, "a crop holds at least one pixel");
        Self { size, data_origin: [x0, y0], data_size: [x1.abs_diff(x0), y1.abs_diff(y0)], ..Self::default() }
    }

    /// Adds a channel and keeps the order.
    ///
    /// # Panics
    /// When `data` has not one number for each pixel of the data window.
    pub fn push(&mut self, name: impl Into<String>, kind: SampleKind, data: Vec<f32>) {
        assert_eq!(data.len(), self.pixel_count(), "one number for each pixel");
        let name = name.into();
        let place = self.channels.partition_point(|c| channel_order(&c.name) <= channel_order(&name));
        self.channels.insert(place, Channel { name, kind, data });
    }

    /// Adds three channels `layer.R`, `layer.G`, `layer.B`, or bare ones when `layer` is empty, from interleaved
    /// colours.
    ///
    /// # Panics
    /// When `rgb` has not one colour for each pixel of the data window.
    pub fn push_rgb(&mut self, layer: &str, kind: SampleKind, rgb: &[[f32; 3]]) {
        self.push_vector(layer, ["R", "G", "B"], kind, rgb);
    }

    /// Adds three channels `layer.X`, `layer.Y`, `layer.Z` from interleaved vectors.
    ///
    /// # Panics
    /// When `xyz` has not one vector for each pixel of the data window.
    pub fn push_xyz(&mut self, layer: &str, kind: SampleKind, xyz: &[[f32; 3]]) {
        self.push_vector(layer, ["X", "Y", "Z"], kind, xyz);
    }

    fn push_vector(&mut self, layer: &str, parts: [&str; 3], kind: SampleKind, values: &[[f32; 3]]) {
        for (i, part) in parts.into_iter().enumerate() {
            let name = if layer.is_empty() { part.to_string() } else { format!("{layer}.{part}") };
            self.push(name, kind, values.iter().map(|v| v[i]).collect());
        }
    }

    /// Adds or replaces what is known under a name.
    pub fn set_attribute(&mut self, name: impl Into<String>, value: Attribute) {
        let name = name.into();
        self.attributes.retain(|(known, _)| *known != name);
        self.attributes.push((name, value));
    }

    /// What is known under a name.
    pub fn attribute(&self, name: &str) -> Option<&Attribute> {
        self.attributes.iter().find(|(known, _)| known == name).map(|(_, value)| value)
    }

    /// Number of pixels in the data window.
    pub fn pixel_count(&self) -> usize {
        self.data_size[0] as usize * self.data_size[1] as usize
    }

    /// The numbers of a channel.
    pub fn channel(&self, name: &str) -> Option<&[f32]> {
        self.channels.iter().find(|c| c.name == name).map(|c| c.data.as_slice())
    }

    /// Red, green and blue of a layer (bare when `layer` is empty); a bare `Y` serves as all three.
    pub fn rgb(&self, layer: &str) -> Option<[&[f32]; 3]> {
        let named = |part: &str| {
            if layer.is_empty() { self.channel(part) } else { self.channel(&format!("{layer}.{part}")) }
        };
        match (named("R"), named("G"), named("B"), named("Y")) {
            (Some(r), Some(g), Some(b), _) => Some([r, g, b]),
            (.., Some(y)) => Some([y; 3]),
            _ => None,
        }
    }

    /// Red, green and blue interleaved, see [`Image::rgb`].
    pub fn to_rgb(&self, layer: &str) -> Option<Vec<[f32; 3]>> {
        let [r, g, b] = self.rgb(layer)?;
        Some(r.iter().zip(g).zip(b).map(|((&r, &g), &b)| [r, g, b]).collect())
    }

    /// What of numbers for each pixel of the data window is within the display window, and its width and height: what people
    /// look at. All of them where nothing is within it.
    pub fn shown<T: Copy>(&self, pixels: &[T]) -> ([u32; 2], Vec<T>) {
        let [(left, columns), (top, rows)] = self.within();
        let lines = pixels.chunks_exact((self.data_size[0] as usize).max(1)).skip(top as usize).take(rows as usize);
        let (first, end) = (left as usize, left as usize + columns as usize);
        ([columns, rows], lines.flat_map(|line| &line[first..end]).copied().collect())
    }

    /// Width and height of what people look at, see [`Image::shown`] [pixels].
    pub fn shown_size(&self) -> [u32; 2] {
        self.within().map(|(_, length)| length)
    }

    /// Columns, and rows, of the data window that people look at: from where on, and how many.
    fn within(&self) -> [(u32, u32); 2] {
        let within = [0, 1].map(|i| {
            let (from, length) = (i64::from(self.data_origin[i]), i64::from(self.data_size[i]));
            let (first, end) = (from.max(0), (from + length).min(i64::from(self.size[i])));
            ((first - from) as u32, (end - first).max(0) as u32)
        });
        let is_empty = within.iter().any(|(_, length)| *length == 0);
        if is_empty { self.data_size.map(|length| (0, length)) } else { within }
    }

    /// Position in the display window of the pixel with the given number in the data window.
    pub fn position(&self, pixel: usize) -> [i32; 2] {
        let width = (self.data_size[0] as usize).max(1);
        [self.data_origin[0] + (pixel % width) as i32, self.data_origin[1] + (pixel / width) as i32]
    }
}

/// Sorts channel names for people: bare R, G, B, A, Z first, then by layer, colours and vectors in their usual order.
pub fn channel_order(name: &str) -> (String, usize, String) {
    let (layer, part) = name.rsplit_once('.').unwrap_or(("", name));
    let place = ["R", "G", "B", "A", "X", "Y", "Z"].iter().position(|known| *known == part).unwrap_or(7);
    (layer.to_string(), place, part.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beauty_comes_first_whatever_the_order_of_arrival() {
        let mut image = Image::new([2, 1]);
        image.push_xyz("N", SampleKind::Float, &[[0.0; 3]; 2]);
        image.push_rgb("albedo", SampleKind::Half, &[[0.0; 3]; 2]);
        for name in ["Z", "A"] {
            image.push(name, SampleKind::Half, vec![0.0; 2]);
        }
        image.push_rgb("", SampleKind::Half, &[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        let names: Vec<&str> = image.channels.iter().map(|c| c.name.as_str()).collect();
        assert_eq!(names, "R G B A Z N.X N.Y N.Z albedo.R albedo.G albedo.B".split(' ').collect::<Vec<_>>());
        assert_eq!(image.to_rgb("").unwrap(), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        assert!(image.rgb("missing").is_none());
    }

    #[test]
    fn pixels_of_a_crop_know_their_place_in_the_frame() {
        let image = Image::cropped([100, 50], [10, 20, 14, 22]);
        assert_eq!((image.pixel_count(), image.position(5)), (8, [11, 21]));
    }

    #[test]
    fn the_frame_is_shown_without_what_is_beside_it() {
        let shown = |bounds| {
            let image = Image::cropped([3, 2], bounds);
            let places: Vec<[i32; 2]> = (0..image.pixel_count()).map(|i| image.position(i)).collect();
            image.shown(&places)
        };
        assert_eq!(shown([-2, -1, 4, 5]), ([3, 2], vec![[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]]));
        assert_eq!(shown([1, -1, 2, 3]), ([1, 2], vec![[1, 0], [1, 1]]));
        // A strip beside the frame is all that there is to look at.
        assert_eq!(shown([-2, 0, 0, 1]), ([2, 1], vec![[-2, 0], [-1, 0]]));
        assert_eq!(shown([i32::MAX - 1, 0, i32::MAX, 1]).0, [1, 1]);
    }

    #[test]
    fn an_attribute_has_one_value() {
        let mut image = Image::new([1, 1]);
        image.set_attribute("frame", Attribute::Int(1));
        image.set_attribute("frame", Attribute::Int(2));
        assert_eq!(image.attribute("frame"), Some(&Attribute::Int(2)));
        assert_eq!(image.attributes.len(), 1);
    }
}
