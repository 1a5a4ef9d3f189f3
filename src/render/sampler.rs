//! Random numbers of a path: Owen-scrambled Sobol' points for the decisions that shape the picture most, a counter-based
//! stream for all others.
//!
//! Every number is a function of (seed, pixel, sample, dimension): no order of evaluation changes it.
//!
//! The pixels of a square share one scrambled sequence (Burley 2020, *Practical Hash-based Owen Scrambling*) and take
//! consecutive pieces of it along the Z curve (Ahmed and Wonka 2020, *Screen-Space Blue-Noise Diffusion of Monte Carlo
//! Sampling Error via Hierarchical Ordering of Pixels*). Each piece is as good by itself as a sequence of its own, and those
//! of two, four, … neighbours fill each other's gaps, so that their errors cancel: noise is fine-grained, and blurring,
//! scaling down and the eye remove it.

use crate::math::hash::{CounterRng, Seed};
use glam::Vec3;
use sobol_burley::parts::{Int4, owen_scramble_int4_rev, owen_scramble_rev, sobol_int4_rev};
use std::sync::LazyLock;

/// Bounces whose decisions are taken from Sobol' points; later ones no longer profit from stratification.
const STRATIFIED_BOUNCES: u32 = 4;

/// Longest Sobol' sequence that the generator supports.
const SEQUENCE: u32 = 1 << 16;

/// Key under which pixels have their streams.
const PIXEL: u64 = 0x70_6978_656c;

/// What a group of four numbers decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dimension {
    /// Position on the film (two numbers) and on the lens (two numbers).
    Film,
    /// Direction after an event (two numbers) and which lobe (one number), and the optical distance of the flight that led to
    /// it (the fourth).
    Event,
    /// At the camera, the channel that decides in smoke with a tint (one number).
    Hero,
    /// At the camera, when between opening and closing of the shutter a path sees what moves (one number).
    Time,
    /// Choice of a light (one number) and of a point on it (two numbers).
    Light,
    /// Choice of a lamp near a flight (one number), of a distance (one number) and of a point on the lamp (two numbers).
    Distance,
}

/// The random numbers of the paths of one pixel.
#[derive(Debug, Clone, Copy)]
pub struct PixelSamples {
    /// Key of the square's sequence.
    square: Seed,
    /// Key of the pixel's own streams.
    pixel: Seed,
    points: &'static SobolTable,
    /// Where its piece of the sequence begins.
    start: u32,
    /// Binary logarithm of the length of a piece.
    log2_length: u32,
}

impl PixelSamples {
    /// For up to `spp` paths of the pixel in column `x` and row `y`; further ones are no longer spread among neighbours.
    pub fn new(seed: Seed, spp: u32, x: i32, y: i32) -> Self {
        // Columns and rows beside the frame wrap to numbers that no frame has, and squares go on across its edge.
        let (x, y) = (x as u32, y as u32);
        let log2_sequence = SEQUENCE.trailing_zeros();
        let log2_length = spp.max(1).next_power_of_two().trailing_zeros().min(log2_sequence);
        // As many pixels as the sequence has pieces for.
        let log2_edge = (log2_sequence - log2_length) / 2;
        let (square_x, square_y) = (x >> log2_edge, y >> log2_edge);
        let within = |c: u32| spread_bits(c & ((1 << log2_edge) - 1));
        let key = |x: u32, y: u32| u64::from(y) << 32 | u64::from(x);
        Self {
            square: seed.derive(key(square_x, square_y)),
            pixel: seed.derive(PIXEL).derive(key(x, y)),
            points: &SOBOL,
            start: (within(x) | within(y) << 1) << log2_length,
            log2_length,
        }
    }

    /// For the pixel in column `x` and row `y`, with a sequence of its own.
    pub fn alone(seed: Seed, x: i32, y: i32) -> Self {
        Self::new(seed, SEQUENCE, x, y)
    }

    /// The numbers of one path.
    #[inline]
    pub fn sampler(&self, sample: u32) -> Sampler {
        let (block, index) = (sample >> self.log2_length, sample & ((1 << self.log2_length) - 1));
        Sampler {
            square: Seed(self.square.0 ^ u64::from(block)),
            index: self.start | index,
            points: self.points,
            stream: Stream::new(self.pixel.derive(u64::from(sample))),
        }
    }
}

/// Point `index` of the first four dimensions of Sobol's sequence, its order and its digits scrambled by `key`. Decisions
/// have keys of their own: what is spread evenly are the four numbers of one decision, which is what matters.
#[inline]
fn scrambled_point(table: &SobolTable, index: u32, key: Seed) -> [f32; 4] {
    let order = owen_scramble_rev(index.reverse_bits(), (key.0 >> 32) as u32);
    let (upper, lower) = ((order >> 24) as usize, (order >> 16 & 0xff) as usize);
    let (a, b) = (key.word(0), key.word(1));
    let keys = [a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32];
    let point = Int4::from(table[0][upper]) ^ Int4::from(table[1][lower]);
    owen_scramble_int4_rev(point, keys.into()).reverse_bits().to_f32_norm()
}

/// What the upper and what the lower byte of an index with its bits reversed bring to a point, as the bits are added without
/// carry.
static SOBOL: LazyLock<SobolTable> = LazyLock::new(|| {
    [24, 16].map(|shift| std::array::from_fn(|byte| sobol_int4_rev((byte as u32) << shift, 0).into()))
});

type SobolTable = [[[u32; 4]; 256]; 2];

/// Puts a zero before each of the lower 16 bits.
fn spread_bits(x: u32) -> u32 {
    let x = (x | x << 8) & 0x00ff_00ff;
    let x = (x | x << 4) & 0x0f0f_0f0f;
    let x = (x | x << 2) & 0x3333_3333;
    (x | x << 1) & 0x5555_5555
}

/// Random numbers for decisions of unknown number, and a count of those that changed nothing but the noise.
#[derive(Debug, Clone)]
pub struct Stream {
    rng: CounterRng,
    /// Collisions with nothing that flights and connections had so far, because bounds of the density are not the density.
    pub null_collisions: u32,
}

impl Stream {
    /// The stream of a key from its start.
    #[inline]
    pub fn new(seed: Seed) -> Self {
        Self { rng: CounterRng::new(seed), null_collisions: 0 }
    }

    /// The next number, uniform in [0, 1).
    #[inline]
    pub fn uniform(&mut self) -> f32 {
        self.rng.uniform()
    }

    /// A point of the unit cube.
    #[inline]
    pub fn point(&mut self) -> Vec3 {
        self.rng.coarse_point()
    }
}

/// The random numbers of one path.
#[derive(Debug, Clone)]
pub struct Sampler {
    points: &'static SobolTable,
    square: Seed,
    index: u32,
    stream: Stream,
}

impl Sampler {
    /// The numbers of sample `sample` of a pixel that shares no sequence with others.
    pub fn new(seed: Seed, x: i32, y: i32, sample: u32) -> Self {
        PixelSamples::alone(seed, x, y).sampler(sample)
    }

    /// Four numbers in [0, 1) for a decision at bounce `bounce` (0 at the camera).
    #[inline]
    pub fn numbers(&mut self, dimension: Dimension, bounce: u32) -> [f32; 4] {
        if bounce < STRATIFIED_BOUNCES {
            let set = match dimension {
                Dimension::Film => 0,
                Dimension::Hero => 1,
                Dimension::Event => 2 + bounce * 3,
                Dimension::Light => 3 + bounce * 3,
                Dimension::Distance => 4 + bounce * 3,
                Dimension::Time => 2 + STRATIFIED_BOUNCES * 3,
            };
            scrambled_point(self.points, self.index, Seed(self.square.word(u64::from(set))))
        } else {
            [self.stream.uniform(), self.stream.uniform(), self.stream.uniform(), self.stream.uniform()]
        }
    }

    /// The stream for decisions of unknown number: null collisions and transmittance.
    #[inline]
    pub fn stream(&mut self) -> &mut Stream {
        &mut self.stream
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_points_of_a_pixel_are_stratified() {
        let n = 256;
        let mut cells = vec![0; n];
        for i in 0..n as u32 {
            let u = Sampler::new(Seed(5), 3, 9, i).numbers(Dimension::Film, 0);
            cells[(u[0] * 16.0) as usize * 16 + (u[1] * 16.0) as usize] += 1;
        }
        assert!(cells.iter().all(|&c| c == 1), "a (0, 8, 2)-net has one point in each of 16 x 16 cells");
    }

    #[test]
    fn every_pixel_is_stratified_by_itself() {
        for (x, y) in [(0, 0), (3, 9), (70, 31)] {
            let pixel = PixelSamples::new(Seed(5), 16, x, y);
            let mut cells = [0; 16];
            (0..16).for_each(|i| {
                let u = pixel.sampler(i).numbers(Dimension::Film, 0);
                cells[(u[0] * 4.0) as usize * 4 + (u[1] * 4.0) as usize] += 1;
            });
            assert_eq!(cells, [1; 16]);
        }
    }

    /// Variance of the mean over squares of `edge` x `edge` pixels, times their area: that of single pixels where errors have
    /// nothing to do with each other.
    fn variance_of_squares(error: impl Fn(i32, i32) -> f64, edge: i32) -> f64 {
        const SIZE: i32 = 64;
        let squares = (0..SIZE / edge).flat_map(|j| (0..SIZE / edge).map(move |i| (i, j)));
        let mut sum = 0.0;
        for (i, j) in squares {
            let pixels = (0..edge * edge).map(|k| error(i * edge + k % edge, j * edge + k / edge));
            sum += pixels.sum::<f64>().powi(2);
        }
        sum / f64::from(SIZE * SIZE)
    }

    #[test]
    fn errors_of_neighbours_cancel() {
        // A disk, whose area no small set of points hits well, and a ramp; in the first decision and in a later one.
        let disk = |u: [f32; 4]| f64::from(u8::from(u[0].hypot(u[1]) < 0.8)) - std::f64::consts::PI * 0.16;
        let ramp = |u: [f32; 4]| f64::from(u[2]) * f64::from(u[0]) - 0.25;
        let integrands: [&dyn Fn([f32; 4]) -> f64; 2] = [&disk, &ramp];
        for spp in [1, 4, 16] {
            for (integrand, (dimension, bounce)) in
                integrands.iter().flat_map(|f| [(f, (Dimension::Film, 0)), (f, (Dimension::Event, 1))])
            {
                let mean = |samples: PixelSamples| {
                    let value = |i: u32| integrand(samples.sampler(i).numbers(dimension, bounce));
                    (0..spp).map(value).sum::<f64>() / f64::from(spp)
                };
                let shared = |x, y| mean(PixelSamples::new(Seed(2), spp, x, y));
                let alone = |x, y| mean(PixelSamples::alone(Seed(2), x, y));
                let pixel = variance_of_squares(shared, 1);
                // No worse by themselves …
                assert!(pixel < 1.3 * variance_of_squares(alone, 1), "{spp} {dimension:?}");
                // … and much better together.
                let (four, sixteen) = (variance_of_squares(shared, 2) / pixel, variance_of_squares(shared, 4) / pixel);
                assert!(four < 0.7 && sixteen < 0.45, "{spp} {dimension:?}: {four} {sixteen}");
                assert!(variance_of_squares(alone, 4) / variance_of_squares(alone, 1) > 0.7);
            }
        }
    }

    /// Those beside the frame have numbers of their own and fill the same square's gaps.
    #[test]
    fn sequences_go_on_beside_the_frame() {
        let numbers = |x: i32, y: i32| {
            let pixel = PixelSamples::new(Seed(5), 16, x, y);
            std::array::from_fn::<_, 16, _>(|i| pixel.sampler(i as u32).numbers(Dimension::Film, 0))
        };
        let mut cells = [0; 256];
        for (x, y) in (-16..0).flat_map(|x| (16..17).map(move |y| (x, y))) {
            for u in numbers(x, y) {
                cells[(u[0] * 16.0) as usize * 16 + (u[1] * 16.0) as usize] += 1;
            }
        }
        let first = numbers(0, 0);
        assert!(cells.iter().all(|&count| count <= 4), "{cells:?}");
        for (x, y) in [(-1, 0), (0, -1), (-1, -1), (-64, 0), (0, -64)] {
            assert_ne!(numbers(x, y), first, "{x} {y}");
            let streams = [(x, y), (0, 0)].map(|(x, y)| Sampler::new(Seed(5), x, y, 0).stream().uniform());
            assert_ne!(streams[0], streams[1], "{x} {y}");
        }
    }

    #[test]
    fn pixels_samples_and_dimensions_differ() {
        let at = |x, s, d, b| Sampler::new(Seed(5), x, 0, s).numbers(d, b);
        let base = at(0, 0, Dimension::Film, 0);
        assert_ne!(base, at(1, 0, Dimension::Film, 0));
        assert_ne!(base, at(0, 1, Dimension::Film, 0));
        assert_ne!(base, at(0, SEQUENCE, Dimension::Film, 0));
        assert_ne!(at(0, 0, Dimension::Event, 0), at(0, 0, Dimension::Event, 1));
        assert_ne!(at(0, 0, Dimension::Light, 7), at(0, 1, Dimension::Light, 7));
    }
}
