//! Light from infinitely far: a constant, or a picture by longitude and latitude sampled by its brightness.
//!
//! The picture's middle is −z, its top +y; longitude grows to the right (so +x is three quarters along).

use crate::math::circle::on_circle;
use crate::math::space::UnitVec3;
use crate::render::color::{Rgb, luminance};
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, PI, TAU};

/// Ratio of the brightest to the mean radiance above which sampling the picture pays: below it, light that leaves the
/// smoke by itself finds the sky with as little noise, and a shadow ray less.
const CONTRAST_WORTH_SAMPLING: f32 = 4.0;

/// Light from all around.
#[derive(Debug, Clone)]
pub struct Environment {
    content: Content,
    /// Sine and cosine of the turn about +y.
    turn: (f32, f32),
    /// Whether camera rays see it.
    pub is_visible: bool,
}

#[derive(Debug, Clone)]
enum Content {
    Constant(Rgb),
    Picture(Box<Picture>),
}

#[derive(Debug, Clone)]
struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<Rgb>,
    /// For each row, running sums of the sampling weights of its pixels; `width + 1` entries a row.
    columns: Vec<f32>,
    /// Running sums of the rows' weights; `height + 1` entries.
    rows: Vec<f32>,
    is_worth_sampling: bool,
}

/// A direction towards the environment.
#[derive(Debug, Clone, Copy)]
pub struct EnvironmentSample {
    /// Direction from the lit point to the light.
    pub direction: UnitVec3,
    /// Radiance from there [W/(m² sr)].
    pub radiance: Rgb,
    /// Density over solid angle [1/sr], > 0.
    pub pdf: f32,
}

impl Environment {
    /// The same radiance [W/(m² sr)] from everywhere.
    pub fn constant(radiance: Rgb, is_visible: bool) -> Self {
        Self { content: Content::Constant(radiance), turn: (0.0, 1.0), is_visible }
    }

    /// A picture of `width · height` radiances, top row first, turned about +y by `rotate_deg`.
    ///
    /// # Panics
    /// When the number of pixels is not `width · height`, or zero.
    pub fn picture(width: usize, height: usize, pixels: Vec<Rgb>, rotate_deg: f32, is_visible: bool) -> Self {
        assert!(width * height == pixels.len() && !pixels.is_empty(), "pixels do not fill {width} x {height}");
        Self {
            content: Content::Picture(Box::new(Picture::new(width, height, pixels))),
            turn: rotate_deg.to_radians().sin_cos(),
            is_visible,
        }
    }

    /// A sky of three colours by height, blended smoothly: `zenith` above, `horizon`, `nadir` below.
    pub fn gradient(zenith: Rgb, horizon: Rgb, nadir: Rgb, is_visible: bool) -> Self {
        const HEIGHT: usize = 256;
        let pixels = (0..HEIGHT)
            .flat_map(|row| {
                let y = (PI * (row as f32 + 0.5) / HEIGHT as f32).cos();
                let end = if y > 0.0 { zenith } else { nadir };
                // The square root keeps the horizon's colour near the horizon, as haze does.
                [horizon.lerp(end, y.abs().sqrt()); 2]
            })
            .collect();
        Self::picture(2, HEIGHT, pixels, 0.0, is_visible)
    }

    /// Radiance [W/(m² sr)] from `direction`.
    #[inline]
    pub fn radiance(&self, direction: UnitVec3) -> Rgb {
        match &self.content {
            Content::Constant(radiance) => *radiance,
            Content::Picture(picture) => {
                let (u, v) = self.to_picture(direction);
                picture.bilinear(u, v)
            }
        }
    }

    /// Whether shadow rays towards it lower the noise.
    pub fn is_worth_sampling(&self) -> bool {
        matches!(&self.content, Content::Picture(p) if p.is_worth_sampling)
    }

    /// Mean radiance over all directions, weighted for luminance: its part in choosing between lights.
    pub fn mean_luminance(&self) -> f32 {
        match &self.content {
            Content::Constant(radiance) => luminance(*radiance),
            Content::Picture(p) => p.rows[p.height] / (p.width as f32 * p.height as f32) * PI * 0.5,
        }
    }

    /// A direction sampled by brightness, from two uniform numbers.
    pub fn sample(&self, u: [f32; 2]) -> EnvironmentSample {
        match &self.content {
            Content::Constant(radiance) => {
                let z = 1.0 - 2.0 * u[0];
                let level = (1.0 - z * z).max(0.0).sqrt() * on_circle(u[1]);
                let direction = UnitVec3::new_unchecked(Vec3::new(level.x, z, level.y));
                EnvironmentSample { direction, radiance: *radiance, pdf: 0.25 * FRAC_1_PI }
            }
            Content::Picture(picture) => {
                let (x, y) = picture.sample(u);
                let direction = self.from_picture(x, y);
                let (sx, sy) = self.to_picture(direction);
                EnvironmentSample { direction, radiance: picture.bilinear(sx, sy), pdf: self.pdf(direction) }
            }
        }
    }

    /// Density [1/sr] with which [`Environment::sample`] returns `direction`.
    pub fn pdf(&self, direction: UnitVec3) -> f32 {
        match &self.content {
            Content::Constant(_) => 0.25 * FRAC_1_PI,
            Content::Picture(picture) => {
                let (u, v) = self.to_picture(direction);
                let sine = (v * PI).sin().max(1e-6);
                picture.density(u, v) / (2.0 * PI * PI * sine)
            }
        }
    }

    /// Picture coordinates in [0, 1] of a direction.
    fn to_picture(&self, d: UnitVec3) -> (f32, f32) {
        let (s, c) = self.turn;
        let (x, z) = (d.x * c - d.z * s, d.x * s + d.z * c);
        let u = 0.5 + x.atan2(-z) / TAU;
        (u.clamp(0.0, 1.0), d.y.clamp(-1.0, 1.0).acos() * FRAC_1_PI)
    }

    #[allow(clippy::wrong_self_convention, reason = "the inverse of to_picture")]
    fn from_picture(&self, u: f32, v: f32) -> UnitVec3 {
        let (sin_theta, y) = (v * PI).sin_cos();
        let (sin_phi, cos_phi) = ((u - 0.5) * TAU).sin_cos();
        let (x, z) = (sin_theta * sin_phi, -sin_theta * cos_phi);
        let (s, c) = self.turn;
        UnitVec3::new_unchecked(Vec3::new(x * c + z * s, y, -x * s + z * c).normalize())
    }
}

impl Picture {
    fn new(width: usize, height: usize, pixels: Vec<Rgb>) -> Self {
        let (mut columns, mut rows) = (Vec::with_capacity((width + 1) * height), vec![0.0; height + 1]);
        let mut brightest = 0.0f32;
        for y in 0..height {
            let sine = (PI * (y as f32 + 0.5) / height as f32).sin();
            let mut sum = 0.0f64;
            columns.push(0.0);
            for x in 0..width {
                brightest = brightest.max(luminance(pixels[y * width + x]));
                sum += f64::from(brightest_around(&pixels, width, height, x, y) * sine);
                columns.push(sum as f32);
            }
            rows[y + 1] = rows[y] + sum as f32;
        }
        let mean = rows[height] / (width * height) as f32 * PI * 0.5;
        let is_worth_sampling = mean > 0.0 && brightest > CONTRAST_WORTH_SAMPLING * mean;
        Self { width, height, pixels, columns, rows, is_worth_sampling }
    }

    fn bilinear(&self, u: f32, v: f32) -> Rgb {
        let x = u * self.width as f32 - 0.5;
        let y = (v * self.height as f32 - 0.5).clamp(0.0, (self.height - 1) as f32);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let column = |i: i64| i.rem_euclid(self.width as i64) as usize;
        let (left, right) = (column(x0 as i64), column(x0 as i64 + 1));
        let (top, bottom) = (y0 as usize, (y0 as usize + 1).min(self.height - 1));
        let at = |x, y| self.pixels[y * self.width + x];
        at(left, top).lerp(at(right, top), fx).lerp(at(left, bottom).lerp(at(right, bottom), fx), fy)
    }

    /// Density over the unit square.
    fn density(&self, u: f32, v: f32) -> f32 {
        let x = ((u * self.width as f32) as usize).min(self.width - 1);
        let y = ((v * self.height as f32) as usize).min(self.height - 1);
        let row = &self.columns[y * (self.width + 1)..(y + 1) * (self.width + 1)];
        let total = self.rows[self.height];
        if total <= 0.0 {
            return 1.0;
        }
        (row[x + 1] - row[x]) / total * (self.width * self.height) as f32
    }

    fn sample(&self, u: [f32; 2]) -> (f32, f32) {
        if self.rows[self.height] <= 0.0 {
            return (u[0], u[1]);
        }
        let (y, fy) = invert(&self.rows, u[1]);
        let (x, fx) = invert(&self.columns[y * (self.width + 1)..(y + 1) * (self.width + 1)], u[0]);
        ((x as f32 + fx) / self.width as f32, (y as f32 + fy) / self.height as f32)
    }
}

/// The brightest of a pixel and its neighbours: the interpolated picture is nowhere bright where this is zero.
fn brightest_around(pixels: &[Rgb], width: usize, height: usize, x: usize, y: usize) -> f32 {
    let mut brightest = 0.0f32;
    for dy in [-1i64, 0, 1] {
        let row = (y as i64 + dy).clamp(0, height as i64 - 1) as usize;
        for dx in [-1i64, 0, 1] {
            let column = (x as i64 + dx).rem_euclid(width as i64) as usize;
            brightest = brightest.max(luminance(pixels[row * width + column]));
        }
    }
    brightest
}

/// The interval of running sums in which `u` times the total falls, and the place inside it in [0, 1].
fn invert(sums: &[f32], u: f32) -> (usize, f32) {
    let target = u * sums[sums.len() - 1];
    let i = (sums.partition_point(|&s| s <= target).max(1) - 1).min(sums.len() - 2);
    let width = sums[i + 1] - sums[i];
    (i, if width > 0.0 { ((target - sums[i]) / width).clamp(0.0, 1.0) } else { 0.5 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};

    fn sky() -> Environment {
        let (w, h) = (16, 8);
        let pixels = (0..w * h)
            .map(|i| if i == 37 { Vec3::splat(50.0) } else { Vec3::new(0.1, 0.2, (i % 5) as f32 * 0.1) })
            .collect();
        Environment::picture(w, h, pixels, 33.0, true)
    }

    #[test]
    fn picture_coordinates_and_directions_are_inverse() {
        let e = sky();
        for i in 1..200 {
            let (u, v) = ((i as f32 * 0.618).fract(), 0.02 + 0.96 * (i as f32 * 0.414).fract());
            let (u2, v2) = e.to_picture(e.from_picture(u, v));
            assert!((u - u2).abs() < 1e-4 && (v - v2).abs() < 1e-4, "{u} {v} -> {u2} {v2}");
        }
        let plain = Environment::picture(4, 2, vec![Vec3::ONE; 8], 0.0, true);
        assert!((*plain.from_picture(0.5, 0.5) - Vec3::NEG_Z).length() < 1e-6);
        assert!((*plain.from_picture(0.75, 0.5) - Vec3::X).length() < 1e-6);
    }

    #[test]
    fn a_turn_is_about_the_upward_axis_from_minus_z_to_minus_x() {
        // One bright pixel in the middle of the picture, which is −z.
        let pixels = (0..8 * 5).map(|i| if i == 2 * 8 + 4 { Vec3::ONE } else { Vec3::ZERO }).collect::<Vec<_>>();
        let off = 0.5 / 8.0 * TAU;
        for turn in [0.0f32, 90.0, 200.0] {
            let e = Environment::picture(8, 5, pixels.clone(), turn, true);
            let angle = turn.to_radians() - off;
            let towards = UnitVec3::try_new(Vec3::new(-angle.sin(), 0.0, -angle.cos())).expect("not zero");
            assert!((e.radiance(towards) - 1.0).abs().max_element() < 1e-4, "{turn}");
            let mean = (0..64).map(|i| *e.sample([(i as f32 + 0.5) / 64.0, 0.5]).direction).sum::<Vec3>();
            assert!(mean.normalize().dot(*towards) > 0.999, "{turn}: {mean}");
        }
    }

    #[test]
    fn samples_follow_the_density() {
        let e = sky();
        // Cells of half a pixel's edge, so that the density within each is smooth.
        const BANDS: usize = 16;
        const SECTORS: usize = 32;
        let (s, c) = 33f32.to_radians().sin_cos();
        let cell = |d: Vec3| {
            let longitude = (d.x * c - d.z * s).atan2(-(d.x * s + d.z * c)) / TAU + 0.5;
            let (band, sector) = (d.y.acos() * FRAC_1_PI * BANDS as f32, longitude * SECTORS as f32);
            (band as usize).min(BANDS - 1) * SECTORS + (sector as usize).min(SECTORS - 1)
        };
        let direction = |u: f32, v: f32| {
            let ((sin, y), (a, b)) = ((v * PI).sin_cos(), ((u - 0.5) * TAU).sin_cos());
            let (x, z) = (sin * a, -sin * b);
            UnitVec3::new_unchecked(Vec3::new(x * c + z * s, y, -x * s + z * c))
        };
        let n = 200_000;
        let mut rng = CounterRng::new(Seed(6));
        let mut counts = vec![0.0; BANDS * SECTORS];
        (0..n).for_each(|_| counts[cell(*e.sample([rng.uniform(), rng.uniform()]).direction)] += 1.0);
        const FINE: usize = 8;
        let expected: Vec<f64> = (0..BANDS * SECTORS)
            .map(|i| {
                let share = |k: usize| {
                    let u = ((i % SECTORS) as f32 + ((k % FINE) as f32 + 0.5) / FINE as f32) / SECTORS as f32;
                    let v = ((i / SECTORS) as f32 + ((k / FINE) as f32 + 0.5) / FINE as f32) / BANDS as f32;
                    f64::from(e.pdf(direction(u, v)) * (v * PI).sin())
                };
                let mean = (0..FINE * FINE).map(share).sum::<f64>() / (FINE * FINE) as f64;
                mean * f64::from(2.0 * PI * PI) / (BANDS * SECTORS) as f64 * f64::from(n)
            })
            .collect();
        let p = crate::math::statistics::chi_square_test(&counts, &expected);
        assert!(p > 1e-3, "p {p}");
    }

    #[test]
    fn sampling_integrates_the_radiance_like_uniform_directions_do() {
        let e = sky();
        let n = 400_000;
        let mut rng = CounterRng::new(Seed(1));
        let (mut by_brightness, mut uniform, mut unit) = (0.0f64, 0.0f64, 0.0f64);
        for _ in 0..n {
            let s = e.sample([rng.uniform(), rng.uniform()]);
            assert!(s.pdf > 0.0);
            by_brightness += f64::from(luminance(s.radiance) / s.pdf) / n as f64;
            let z = 1.0 - 2.0 * rng.uniform();
            let (sin, cos) = (TAU * rng.uniform()).sin_cos();
            let r = (1.0 - z * z).max(0.0).sqrt();
            let d = UnitVec3::new_unchecked(Vec3::new(r * cos, z, r * sin));
            uniform += f64::from(luminance(e.radiance(d)) * 4.0 * PI) / n as f64;
            unit += f64::from(e.pdf(d) * 4.0 * PI) / n as f64;
        }
        assert!((by_brightness / uniform - 1.0).abs() < 0.03, "{by_brightness} {uniform}");
        assert!((unit - 1.0).abs() < 0.03, "density integrates to {unit}");
    }
}
