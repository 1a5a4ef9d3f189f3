//! Pictures of a slice that are made to be read.

use crate::inspect::canvas::{Canvas, Legend, round_step};
use crate::inspect::lic::Directions;
use crate::inspect::palette::{Rgb, lightened, magnitude, mixed, signed};
use crate::inspect::slice::Slice;
use crate::inspect::stream::{StreamFunction, stream_function};
use crate::math::hash::Seed;

/// Half the length over which noise is smeared, as a share of the picture's height.
const LIC_HALF_LENGTH: f64 = 0.045;
/// Change of lightness for one standard deviation of smeared noise: enough to see lines, too little to hide the speed.
const LIC_CONTRAST: f64 = 0.075;
/// Colours end at this share of the sorted magnitudes, so that one bright pixel does not leave the rest in the dark.
const RANGE_SHARE: f64 = 0.998;
/// About so many contour lines.
const CONTOURS: f64 = 48.0;
/// Inside of obstacles and their outline.
const SOLID: Rgb = [0.21, 0.21, 0.22];
const OUTLINE: Rgb = [0.012, 0.012, 0.015];

/// What a picture of a slice shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Speed by colour.
    Speed,
    /// Divergence by colour, both signs.
    Divergence,
    /// Distance to obstacles by colour, with contour lines.
    Distance,
    /// Contour lines of the stream function over the speed.
    Stream,
    /// Smeared noise that shows directions, over the speed.
    Lic,
}

impl Quantity {
    /// Its name in file names and channels.
    pub fn name(self) -> &'static str {
        match self {
            Self::Speed => "speed",
            Self::Divergence => "divergence",
            Self::Distance => "distance",
            Self::Stream => "stream",
            Self::Lic => "lic",
        }
    }
}

/// Draws pictures of a slice; what several of them need is worked out once.
pub struct Painter<'a> {
    slice: &'a Slice,
    seed: Seed,
    top_speed: f64,
    stream: Option<StreamFunction>,
    lic: Option<Vec<f32>>,
}

impl<'a> Painter<'a> {
    /// For a slice; the seed is that of the noise.
    pub fn new(slice: &'a Slice, seed: Seed) -> Self {
        let outside = slice.samples.iter().filter(|s| !s.is_inside());
        let top_speed = top(outside.map(|s| s.velocity.length()).collect());
        Self { slice, seed, top_speed, stream: None, lic: None }
    }

    /// The stream function of the slice.
    pub fn stream(&mut self) -> &StreamFunction {
        let slice = self.slice;
        self.stream.get_or_insert_with(|| stream_function(&slice.in_plane(), slice.size, slice.pixel()))
    }

    /// The picture of a quantity.
    pub fn paint(&mut self, quantity: Quantity) -> Canvas {
        match quantity {
            Quantity::Speed => self.speed(),
            Quantity::Divergence => self.divergence(),
            Quantity::Distance => self.distance(),
            Quantity::Stream => self.stream_lines(),
            Quantity::Lic => self.strokes(),
        }
    }

    /// Smeared noise with mean 0 and standard deviation 1 outside obstacles.
    pub fn lic(&mut self) -> &[f32] {
        let (slice, seed) = (self.slice, self.seed);
        self.lic.get_or_insert_with(|| {
            let is_solid = slice.samples.iter().map(|s| s.is_inside()).collect();
            let directions = Directions::new(&slice.in_plane(), is_solid, slice.size);
            directions.convolve((LIC_HALF_LENGTH * f64::from(slice.size[1])).max(4.0), seed)
        })
    }

    fn speed_colour(&self, pixel: usize) -> Rgb {
        magnitude(self.slice.samples[pixel].velocity.length() / self.top_speed)
    }

    fn speed(&self) -> Canvas {
        let mut canvas = Canvas::from_fn(self.slice.size, |i| self.speed_colour(i));
        self.draw_obstacles(&mut canvas);
        self.speed_legend(&mut canvas);
        canvas
    }

    fn strokes(&mut self) -> Canvas {
        self.lic();
        let values = self.lic.as_deref().unwrap_or_default();
        let mut canvas = Canvas::from_fn(self.slice.size, |i| {
            lightened(self.speed_colour(i), LIC_CONTRAST * f64::from(values[i].clamp(-2.5, 2.5)))
        });
        self.draw_obstacles(&mut canvas);
        self.speed_legend(&mut canvas);
        canvas
    }

    fn stream_lines(&mut self) -> Canvas {
        self.stream();
        let mut canvas = Canvas::from_fn(self.slice.size, |i| dimmed(self.speed_colour(i)));
        if let Some(stream) = &self.stream {
            let (low, high) = bounds(stream.values.iter().copied());
            let width = 1.2 * f64::from(self.slice.size[1]) / 360.0;
            canvas.contours(&stream.values, Some(round_step(high - low, CONTOURS)), width.max(1.0), [0.9; 3], 0.8);
        }
        self.draw_obstacles(&mut canvas);
        let colour = |x: f64| dimmed(magnitude(x));
        let title = "stream lines, speed [m/s]";
        canvas.legend(&Legend { title, range: [0.0, self.top_speed], colour: &colour });
        canvas
    }

    fn divergence(&self) -> Canvas {
        let outside = self.slice.samples.iter().filter(|s| !s.is_inside());
        let range = top(outside.map(|s| s.divergence.abs()).collect());
        let mut canvas = Canvas::from_fn(self.slice.size, |i| signed(self.slice.samples[i].divergence / range));
        self.draw_obstacles(&mut canvas);
        let colour = |x: f64| signed(2.0 * x - 1.0);
        canvas.legend(&Legend { title: "divergence [1/s]", range: [-range, range], colour: &colour });
        canvas
    }

    fn distance(&self) -> Canvas {
        let distances: Vec<f64> = self.slice.samples.iter().map(|s| s.distance).collect();
        let (low, high) = bounds(distances.iter().copied().filter(|d| d.is_finite()));
        // Each side has a range of its own: the inside of an obstacle is small beside the air round it.
        let high = if high > 0.0 { high } else { 1.0 };
        let low = if low < 0.0 { -low } else { high };
        let share = |d: f64| d / if d < 0.0 { low } else { high };
        let mut canvas = Canvas::from_fn(self.slice.size, |i| signed(share(distances[i])));
        canvas.contours(&distances, Some(round_step(high, 0.35 * CONTOURS)), 1.0, OUTLINE, 0.35);
        canvas.contours(&distances, None, self.outline_width() + 0.5, OUTLINE, 1.0);
        let colour = |x: f64| signed(2.0 * x - 1.0);
        canvas.legend(&Legend { title: "distance [m]", range: [-low, high], colour: &colour });
        canvas
    }

    fn outline_width(&self) -> f64 {
        (1.5 * f64::from(self.slice.size[1]) / 360.0).max(1.0)
    }

    fn draw_obstacles(&self, canvas: &mut Canvas) {
        let distances: Vec<f64> = self.slice.samples.iter().map(|s| s.distance).collect();
        for (i, _) in distances.iter().enumerate().filter(|(_, d)| **d < 0.0) {
            canvas.blend(i, SOLID, 1.0);
        }
        canvas.contours(&distances, None, self.outline_width(), OUTLINE, 1.0);
    }

    fn speed_legend(&self, canvas: &mut Canvas) {
        canvas.legend(&Legend { title: "speed [m/s]", range: [0.0, self.top_speed], colour: &magnitude });
    }
}

/// A colour that leaves room for bright lines over it.
fn dimmed(colour: Rgb) -> Rgb {
    mixed(colour, [0.0; 3], 0.35)
}

/// The magnitude at which colours end; above 0 whatever the numbers.
fn top(mut values: Vec<f64>) -> f64 {
    values.retain(|x| x.is_finite());
    values.sort_unstable_by(f64::total_cmp);
    let place = (values.len().saturating_sub(1) as f64 * RANGE_SHARE).round() as usize;
    values.get(place).copied().filter(|&x| x > 0.0).unwrap_or(1.0)
}

fn bounds(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspect::plane::Rectangle;
    use crate::inspect::probe::known::{Rotation, Uniform};
    use glam::DVec3;

    const ALL: [Quantity; 5] =
        [Quantity::Speed, Quantity::Divergence, Quantity::Distance, Quantity::Stream, Quantity::Lic];

    fn slice(size: [u32; 2]) -> Slice {
        let flow = Rotation { rate: 1.0, ball: Some((DVec3::ZERO, 0.3)) };
        let rectangle = Rectangle::try_new(DVec3::ZERO, DVec3::Z, [2.0, 2.0]).unwrap();
        Slice::sample(&flow, 0.0, rectangle, size)
    }

    #[test]
    fn obstacles_are_flat_grey_and_speed_brightens_outwards() {
        let slice = slice([101, 101]);
        let mut painter = Painter::new(&slice, Seed(1));
        for quantity in [Quantity::Speed, Quantity::Divergence, Quantity::Stream, Quantity::Lic] {
            let canvas = painter.paint(quantity);
            assert_eq!(canvas.pixels[50 * 101 + 50], SOLID, "{quantity:?}");
        }
        let canvas = painter.paint(Quantity::Speed);
        let green = |x: usize| canvas.pixels[50 * 101 + x][1];
        assert!(green(70) < green(80) && green(80) < green(95));
    }

    #[test]
    fn the_smallest_pictures_and_still_air_are_drawn_too() {
        for size in [[1, 1], [2, 1], [1, 3]] {
            let slice = slice(size);
            for quantity in ALL {
                assert_eq!(Painter::new(&slice, Seed(1)).paint(quantity).size, size);
            }
        }
        let rectangle = Rectangle::try_new(DVec3::ZERO, DVec3::Z, [2.0, 2.0]).unwrap();
        let still = Slice::sample(&Uniform(DVec3::ZERO), 0.0, rectangle, [8, 8]);
        for quantity in ALL {
            let canvas = Painter::new(&still, Seed(1)).paint(quantity);
            assert!(canvas.pixels.iter().flatten().all(|x| x.is_finite()), "{quantity:?}");
        }
    }

    #[test]
    fn pictures_do_not_depend_on_threads() {
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let slice = slice([60, 40]);
                ALL.map(|quantity| Painter::new(&slice, Seed(1)).paint(quantity))
            })
        };
        assert!(with(1) == with(2));
    }
}
