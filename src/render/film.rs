//! What the camera saw: mean and variance for each pixel, and the further layers.

use crate::render::color::Rgb;
use glam::Vec3;

/// A rectangle of pixels: columns `x0..x1`, rows `y0..y1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelBounds {
    /// First column.
    pub x0: u32,
    /// First row.
    pub y0: u32,
    /// One past the last column.
    pub x1: u32,
    /// One past the last row.
    pub y1: u32,
}

impl PixelBounds {
    /// All pixels of a picture.
    pub fn whole(resolution: [u32; 2]) -> Self {
        Self { x0: 0, y0: 0, x1: resolution[0], y1: resolution[1] }
    }

    /// Columns.
    pub fn width(&self) -> u32 {
        self.x1 - self.x0
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.y1 - self.y0
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
    /// Mean normal of the first surface; zero where there is none.
    pub normal: Vec3,
    /// Mean colour of the first surface or smoke.
    pub albedo: Rgb,
    /// Distance along the view axis to the first surface through the pixel's middle [m]; infinite where there is none.
    pub depth: f32,
}

/// What one path brings to its pixel.
#[derive(Debug, Clone, Copy, Default)]
pub struct Contribution {
    /// Radiance [W/(m² sr)].
    pub radiance: Rgb,
    /// 1 where the path met something, 0 where it met the background.
    pub alpha: f32,
    /// Normal of the first surface, or zero.
    pub normal: Vec3,
    /// Colour of the first surface or smoke, or zero.
    pub albedo: Rgb,
    /// Where the path met a shadow catcher: luminance that it reflects [W/(m² sr)], and luminance that it would reflect
    /// if nothing cast a shadow. They are no part of `radiance` and `alpha`.
    pub shadow: Option<[f32; 2]>,
}

/// Running moments of one pixel (Welford 1962), in f64 so that millions of samples do not stall.
#[derive(Debug, Clone, Default)]
pub struct PixelSum {
    count: u32,
    mean: glam::DVec3,
    squares: glam::DVec3,
    alpha: f64,
    normal: glam::DVec3,
    albedo: glam::DVec3,
    /// Paths that met shadow catchers, and the sums of what they brought.
    caught: u32,
    shadow: [f64; 2],
}

impl PixelSum {
    /// Adds one path.
    pub fn add(&mut self, c: &Contribution) {
        self.count += 1;
        let x = c.radiance.as_dvec3();
        let delta = x - self.mean;
        self.mean += delta / f64::from(self.count);
        self.squares += delta * (x - self.mean);
        self.alpha += f64::from(c.alpha);
        self.normal += c.normal.as_dvec3();
        self.albedo += c.albedo.as_dvec3();
        if let Some([lit, unshadowed]) = c.shadow {
            self.caught += 1;
            self.shadow[0] += f64::from(lit);
            self.shadow[1] += f64::from(unshadowed);
        }
    }

    /// Share of light that shadows take from catchers, from the means of all paths that met one: the mean of ratios would
    /// be another number. Places without any light have no shadow.
    fn shadow(&self) -> f64 {
        let [lit, unshadowed] = self.shadow;
        if unshadowed > 0.0 { (1.0 - lit / unshadowed).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// The pixel after all its paths; with one path the variance is unknown and stands as infinite.
    pub fn finish(&self, depth: f32) -> Pixel {
        let n = f64::from(self.count.max(1));
        let variance = if self.count > 1 { self.squares / (n * (n - 1.0)) } else { glam::DVec3::INFINITY };
        Pixel {
            mean: self.mean.as_vec3(),
            variance: variance.as_vec3(),
            alpha: ((self.alpha + f64::from(self.caught) * self.shadow()) / n) as f32,
            normal: (self.normal / n).as_vec3(),
            albedo: (self.albedo / n).as_vec3(),
            depth,
        }
    }
}

/// The finished picture.
#[derive(Debug, Clone)]
pub struct Film {
    /// Size of the whole picture.
    pub resolution: [u32; 2],
    /// Which part of it was rendered.
    pub bounds: PixelBounds,
    /// The pixels of that part, top row first.
    pub pixels: Vec<Pixel>,
    /// Paths a pixel.
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
        self.traced += other.traced;
        self.truncated += other.truncated;
        self.truncated_throughput += other.truncated_throughput;
        self.bounces += other.bounces;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_variance_are_those_of_the_samples() {
        let samples = [1.0f32, 4.0, 2.0, 9.0];
        let mut sum = PixelSum::default();
        for x in samples {
            sum.add(&Contribution { radiance: Vec3::splat(x), alpha: 0.5, ..Default::default() });
        }
        let pixel = sum.finish(1.0);
        // Mean 4, squared deviations 9 + 0 + 4 + 25 = 38, over 3 and over 4.
        assert!((pixel.mean.x - 4.0).abs() < 1e-6);
        assert!((pixel.variance.y - 38.0 / 12.0).abs() < 1e-5);
        assert!((pixel.alpha - 0.5).abs() < 1e-6);
    }
}
