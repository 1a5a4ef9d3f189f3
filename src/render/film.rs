//! What the camera saw: mean and variance for each pixel, and the further layers.

use crate::math::exact_sum::ExactSums;
use crate::math::space::WorldPoint;
use crate::render::color::Rgb;
use crate::render::cryptomatte::Coverage;
use crate::render::layers::{Layer, LayerSums, Middle};
use crate::render::light_path::{FirstEvent, GROUP_MAX, Passage};
use glam::Vec3;

/// A rectangle of pixels: columns `x0..x1`, rows `y0..y1`, counted from the top left of the frame; those of overscan to the
/// left of the frame and above it are negative.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelBounds {
    /// First column.
    pub x0: i32,
    /// First row.
    pub y0: i32,
    /// One past the last column.
    pub x1: i32,
    /// One past the last row.
    pub y1: i32,
}

impl PixelBounds {
    /// All pixels of a frame.
    ///
    /// # Panics
    /// Where it is wider or higher than numbers of pixels go, 2³¹.
    pub fn whole(resolution: [u32; 2]) -> Self {
        let [x1, y1] = resolution.map(|n| i32::try_from(n).expect("no frame is so large"));
        Self { x0: 0, y0: 0, x1, y1 }
    }

    /// With so many pixels more at the left, right, top and bottom.
    pub fn grown(&self, [left, right, top, bottom]: [u32; 4]) -> Self {
        Self {
            x0: self.x0.saturating_sub_unsigned(left),
            y0: self.y0.saturating_sub_unsigned(top),
            x1: self.x1.saturating_add_unsigned(right),
            y1: self.y1.saturating_add_unsigned(bottom),
        }
    }

    /// The pixels that are in both, if any are.
    pub fn common(&self, other: &Self) -> Option<Self> {
        let common = Self {
            x0: self.x0.max(other.x0),
            y0: self.y0.max(other.y0),
            x1: self.x1.min(other.x1),
            y1: self.y1.min(other.y1),
        };
        (common.x0 < common.x1 && common.y0 < common.y1).then_some(common)
    }

    /// Columns.
    pub fn width(&self) -> u32 {
        self.x1.abs_diff(self.x0)
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.y1.abs_diff(self.y0)
    }

    /// Whether a pixel is one of them.
    pub fn contains(&self, x: i32, y: i32) -> bool {
        (self.x0..self.x1).contains(&x) && (self.y0..self.y1).contains(&y)
    }

    /// Number of a pixel among them, row after row.
    pub fn index(&self, x: i32, y: i32) -> usize {
        y.abs_diff(self.y0) as usize * self.width() as usize + x.abs_diff(self.x0) as usize
    }

    /// Pixels.
    pub fn area(&self) -> usize {
        self.width() as usize * self.height() as usize
    }
}

/// One pixel of the finished picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pixel {
    /// Mean radiance [W/(m² sr)].
    pub mean: Rgb,
    /// Estimated variance of that mean.
    pub variance: Rgb,
    /// Share of the pixel that is not background.
    pub alpha: f32,
}

/// What one path brings to its pixel.
#[derive(Debug, Clone, Copy)]
pub struct Contribution {
    /// Radiance [W/(m² sr)].
    pub radiance: Rgb,
    /// Whether the path met something, and not the background alone.
    pub is_covered: bool,
    /// What the camera's ray met first.
    pub first: FirstEvent,
    /// The shape of the surface that it met first, if it met one before smoke.
    pub shape_idx: Option<u32>,
    /// Whether that is smoke which the flow carries.
    pub is_carried: bool,
    /// Where it met that which `first` says, the origin where it met nothing.
    pub place: WorldPoint,
    /// What it brings to the layer of motion, see [`FrameMotion::of_path`](crate::render::motion::FrameMotion::of_path).
    pub motion: Vec3,
    /// Normal of the first surface, or zero.
    pub normal: Vec3,
    /// Colour of the first surface or smoke, or zero.
    pub albedo: Rgb,
    /// Scatterings.
    pub bounces: u32,
    /// Null collisions of its flights and connections.
    pub null_collisions: u32,
    /// Whether the ways of light are told apart: where no layer asks for them, `by_passage` and `by_group` stay black.
    pub tells_ways: bool,
    /// Radiance by the way it came; adds to `radiance`.
    pub by_passage: [Rgb; Passage::ALL.len()],
    /// Radiance by groups of sources; adds to `radiance`.
    pub by_group: [Rgb; GROUP_MAX],
    /// Where the path met a shadow catcher: luminance that it reflects [W/(m² sr)], and luminance that it would reflect
    /// if nothing cast a shadow. They are no part of `radiance` and `alpha`.
    pub shadow: Option<[f32; 2]>,
}

impl Default for Contribution {
    fn default() -> Self {
        Self::new(true)
    }
}

impl Contribution {
    /// Nothing yet; whether the ways of light will be told apart.
    pub fn new(tells_ways: bool) -> Self {
        Self {
            radiance: Rgb::ZERO,
            is_covered: false,
            first: FirstEvent::None,
            shape_idx: None,
            is_carried: false,
            place: WorldPoint::default(),
            motion: Vec3::ZERO,
            normal: Vec3::ZERO,
            albedo: Rgb::ZERO,
            bounces: 0,
            null_collisions: 0,
            tells_ways,
            by_passage: [Rgb::ZERO; Passage::ALL.len()],
            by_group: [Rgb::ZERO; GROUP_MAX],
            shadow: None,
        }
    }

    /// Forgets a path. Most of the size are the ways of light, which most pictures do not ask for.
    #[inline]
    pub fn clear(&mut self) {
        if self.tells_ways {
            *self = Self::new(true);
            return;
        }
        (self.radiance, self.is_covered, self.first, self.shape_idx) = (Rgb::ZERO, false, FirstEvent::None, None);
        self.is_carried = false;
        (self.place, self.motion, self.normal) = (WorldPoint::default(), Vec3::ZERO, Vec3::ZERO);
        (self.albedo, self.bounces, self.null_collisions, self.shadow) = (Rgb::ZERO, 0, 0, None);
    }

    /// Adds light of a group of sources that came to the camera by `passage`.
    #[inline]
    pub fn add(&mut self, light: Rgb, passage: Passage, group: usize) {
        self.radiance += light;
        if self.tells_ways {
            self.by_passage[passage as usize] += light;
            self.by_group[group] += light;
        }
    }

    /// Adds light that was scattered so many times.
    #[inline]
    pub fn add_scattered(&mut self, light: Rgb, scatterings: u32, group: usize) {
        self.add(light, Passage::scattered(self.first, scatterings), group);
    }
}

/// Sums of radiance and of its squares. They are exact, so that a pixel does not depend on how its paths are divided among
/// machines.
#[derive(Debug, Clone, Default)]
pub struct Moments {
    count: u32,
    sums: ExactSums<3>,
    squares: ExactSums<3>,
}

impl Moments {
    #[inline]
    fn add(&mut self, radiance: Rgb) {
        self.count += 1;
        let [x, y, z] = [f64::from(radiance.x), f64::from(radiance.y), f64::from(radiance.z)];
        self.sums.add([x, y, z]);
        self.squares.add([x * x, y * y, z * z]);
    }

    /// Paths.
    #[inline]
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Mean radiance.
    #[inline]
    pub fn mean(&self) -> Rgb {
        let n = f64::from(self.count.max(1));
        Rgb::from_array(self.sums.to_f64().map(|sum| (sum / n) as f32))
    }

    /// Estimated variance of the mean; with one path it is unknown and stands as infinite.
    pub fn variance_of_mean(&self) -> Rgb {
        let n = f64::from(self.count);
        if self.count < 2 {
            return Rgb::INFINITY;
        }
        let variance = |i: usize| (self.sums.spread(&self.squares, i, self.count) / (n * n * (n - 1.0))) as f32;
        Rgb::from_array([0, 1, 2].map(variance))
    }
}

/// What the paths of one pixel add up to: exact sums, which may be added in any order and in parts.
#[derive(Debug, Clone)]
pub struct PixelSum {
    moments: Moments,
    /// Paths that met something.
    covered: u32,
    /// Paths that met shadow catchers, and the sums of what they brought.
    caught: u32,
    shadow: ExactSums<2>,
    coverage: Coverage,
    layers: LayerSums,
}

impl PixelSum {
    /// Nothing yet.
    pub fn new(layers: &[Layer]) -> Self {
        Self {
            moments: Moments::default(),
            covered: 0,
            caught: 0,
            shadow: Default::default(),
            coverage: Coverage::default(),
            layers: LayerSums::new(layers),
        }
    }

    /// Adds one path; `layers` are those that it was made with.
    #[inline]
    pub fn add(&mut self, layers: &[Layer], path: &Contribution) {
        self.moments.add(path.radiance);
        self.covered += u32::from(path.is_covered);
        if let Some(shape_idx) = path.shape_idx {
            self.coverage.add(shape_idx, 1);
        }
        if let Some(shadow) = path.shadow {
            self.caught += 1;
            self.shadow.add(shadow.map(f64::from));
        }
        self.layers.add(layers, path);
    }

    /// Adds the paths of another part of the same pixel, with the same layers.
    ///
    /// # Panics
    /// When they have more than 2³² paths together.
    pub fn merge(&mut self, other: &Self) {
        let (moments, more) = (&mut self.moments, &other.moments);
        moments.count = moments.count.checked_add(more.count).expect("no picture has so many paths a pixel");
        moments.sums.merge(&more.sums);
        moments.squares.merge(&more.squares);
        self.shadow.merge(&other.shadow);
        self.covered = self.covered.saturating_add(other.covered);
        self.caught = self.caught.saturating_add(other.caught);
        for (shape_idx, count) in other.coverage.counts() {
            self.coverage.add(shape_idx, count);
        }
        self.layers.0.iter_mut().zip(&other.layers.0).for_each(|(sums, more)| sums.merge(more));
    }

    /// Writes all of it at the end of `out`.
    pub fn encode(&self, out: &mut Vec<u8>) {
        let coverage = self.coverage.counts();
        let numbers = [self.moments.count, self.covered, self.caught, coverage.len() as u32].into_iter();
        let numbers = numbers.chain(coverage.flat_map(|(shape_idx, count)| [shape_idx, count]));
        numbers.for_each(|n| out.extend(n.to_le_bytes()));
        self.moments.sums.encode(out);
        self.moments.squares.encode(out);
        self.shadow.encode(out);
        self.layers.0.iter().for_each(|sums| sums.encode(out));
    }

    /// Reads what [`encode`](Self::encode) has written, with the same layers, and leaves `bytes` after it; `None` where it is
    /// nothing such.
    pub fn decode(bytes: &mut &[u8], layers: &[Layer]) -> Option<Self> {
        let number = |bytes: &mut &[u8]| {
            let (first, rest) = bytes.split_first_chunk()?;
            *bytes = rest;
            Some(u32::from_le_bytes(*first))
        };
        let mut sum = Self::new(layers);
        (sum.moments.count, sum.covered, sum.caught) = (number(bytes)?, number(bytes)?, number(bytes)?);
        let names = layers
            .iter()
            .find_map(|layer| if let Layer::Cryptomatte(names) = layer { Some(names.len()) } else { None });
        for _ in 0..number(bytes)? {
            let (shape_idx, count) = (number(bytes)?, number(bytes)?);
            if names.is_some_and(|known| shape_idx as usize >= known) {
                return None;
            }
            sum.coverage.add(shape_idx, count);
        }
        sum.moments.sums = ExactSums::decode(bytes)?;
        sum.moments.squares = ExactSums::decode(bytes)?;
        sum.shadow = ExactSums::decode(bytes)?;
        for sums in &mut sum.layers.0 {
            *sums = ExactSums::decode(bytes)?;
        }
        Some(sum)
    }

    /// Moments of the radiance.
    pub fn moments(&self) -> &Moments {
        &self.moments
    }

    /// The pixel after all its paths.
    pub fn finish(&self) -> Pixel {
        let alpha = f64::from(self.covered) + f64::from(self.caught) * self.shadow();
        Pixel {
            mean: self.moments.mean(),
            variance: self.moments.variance_of_mean(),
            alpha: (alpha / f64::from(self.moments.count.max(1))) as f32,
        }
    }

    /// Whether a path met a shadow catcher.
    pub fn has_caught(&self) -> bool {
        self.caught > 0
    }

    /// Share of light that shadows take from catchers, from the means of all paths that met one: the mean of ratios would
    /// be another number. Places without any light have no shadow.
    fn shadow(&self) -> f64 {
        let [lit, unshadowed] = self.shadow.to_f64();
        if unshadowed > 0.0 { (1.0 - lit / unshadowed).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// The numbers of the further layers, channel after channel, at the end of `out`.
    pub fn finish_layers(&self, layers: &[Layer], middle: Option<&Middle>, out: &mut Vec<f32>) {
        for (layer, mean) in layers.iter().zip(self.layers.means(self.moments.count)) {
            layer.finish(mean, &self.moments, &self.coverage, middle, out);
        }
    }
}

/// The finished picture.
#[derive(Debug, Clone)]
pub struct Film {
    /// Size of the frame.
    pub resolution: [u32; 2],
    /// Which pixels were rendered.
    pub bounds: PixelBounds,
    /// The pixels of that part, top row first.
    pub pixels: Vec<Pixel>,
    /// The further layers that it has.
    pub layers: Vec<Layer>,
    /// Their numbers: for each pixel the channels of all layers in their order.
    pub layer_data: Vec<f32>,
    /// Most paths a pixel.
    pub spp: u32,
    /// What became of the paths.
    pub paths: PathCounts,
}

/// What became of the paths of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PathCounts {
    /// Paths traced.
    pub traced: u64,
    /// Paths cut at the limit of bounces.
    pub truncated: u64,
    /// Sum of the throughput that the cut paths still carried; over `traced`, a bound on the relative loss in light of
    /// radiance 1.
    pub truncated_throughput: f64,
    /// Scatterings in smoke and at surfaces.
    pub bounces: u64,
}

impl PathCounts {
    /// Adds another count.
    pub fn add(&mut self, other: &Self) {
        // What files say may be anything.
        self.traced = self.traced.saturating_add(other.traced);
        self.truncated = self.truncated.saturating_add(other.truncated);
        self.truncated_throughput += other.truncated_throughput;
        self.bounces = self.bounces.saturating_add(other.bounces);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_variance_are_those_of_the_samples() {
        let samples = [1.0f32, 4.0, 2.0, 9.0];
        let layers = [Layer::Bounces, Layer::Variance, Layer::Samples];
        let mut sum = PixelSum::new(&layers);
        for x in samples {
            sum.add(
                &layers,
                &Contribution { radiance: Vec3::splat(x), is_covered: x < 3.0, bounces: 3, ..Default::default() },
            );
        }
        let pixel = sum.finish();
        let mut data = Vec::new();
        sum.finish_layers(&layers, None, &mut data);
        assert_eq!(data, [3.0, pixel.variance.x, pixel.variance.y, pixel.variance.z, 4.0]);
        // Mean 4, squared deviations 9 + 0 + 4 + 25 = 38, over 3 and over 4.
        assert!((pixel.mean.x - 4.0).abs() < 1e-6);
        assert!((pixel.variance.y - 38.0 / 12.0).abs() < 1e-5);
        assert!((pixel.alpha - 0.5).abs() < 1e-6);
    }
}
