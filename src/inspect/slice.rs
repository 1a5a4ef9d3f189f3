//! The flow on a rectangle, pixel by pixel: velocity, distance, and divergence as a measure of its own truth.

use crate::inspect::plane::Rectangle;
use crate::inspect::probe::Flow;
use crate::math::parallel;
use crate::output::image::{Image, SampleKind};
use glam::DVec3;
use std::fmt;

/// Central differences reach this share of the height of the slice to either side. Noise has a third derivative that
/// jumps at its lattice, where differences err in proportion to their reach; rounding errs in inverse proportion. At this
/// reach both are about a millionth of the gradient or less.
const DIFFERENCE: f64 = 1e-7;
/// Memory that a pixel takes with all quantities and files, by a wide margin [bytes].
pub const BYTES_PER_PIXEL: u64 = 256;

/// The flow at one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Velocity in the axes of the world [m/s], as the field has it: inside obstacles too, where it means nothing.
    pub velocity: DVec3,
    /// Signed distance to the closest obstacle [m], infinite without obstacles.
    pub distance: f64,
    /// Divergence of the velocity [1/s], by central differences in double precision.
    pub divergence: f64,
    /// Squared Frobenius norm of the velocity's gradient [1/s²], by the same differences.
    pub gradient_sq: f64,
}

/// The flow on a rectangle at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Slice {
    /// The rectangle.
    pub rectangle: Rectangle,
    /// Columns and rows.
    pub size: [u32; 2],
    /// The flow at the middle of each pixel, row after row from the top.
    pub samples: Vec<Sample>,
}

impl Slice {
    /// Asks `flow` at a time [s] for each of `size` pixels.
    pub fn sample(flow: &impl Flow, time: f64, rectangle: Rectangle, size: [u32; 2]) -> Self {
        let step = DIFFERENCE * rectangle.size()[1];
        let [width, height] = size.map(|n| n as usize);
        let samples = parallel::map(width * height, |i| {
            let [x, y] = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
            sample_at(flow, time, rectangle.point(x / width as f64, y / height as f64), step)
        });
        Self { rectangle, size, samples }
    }

    /// Edge of a pixel [m]; pixels are square.
    pub fn pixel(&self) -> f64 {
        self.rectangle.size()[1] / f64::from(self.size[1])
    }

    /// Parts of the velocity to the right and up in the plane, 0 inside obstacles [m/s].
    pub fn in_plane(&self) -> Vec<[f64; 2]> {
        let [right, up] = self.rectangle.axes();
        let part = |s: &Sample| if s.is_inside() { [0.0; 2] } else { [s.velocity.dot(right), s.velocity.dot(up)] };
        self.samples.iter().map(part).collect()
    }

    /// The figures of the slice.
    pub fn summary(&self) -> Summary {
        let outside = || self.samples.iter().filter(|s| !s.is_inside());
        let count = outside().count().max(1) as f64;
        // Differences taken through a wall say nothing of the flow.
        let clear = 2.0 * DIFFERENCE * self.rectangle.size()[1];
        Summary {
            rms_speed: (outside().map(|s| s.velocity.length_squared()).sum::<f64>() / count).sqrt(),
            max_speed: outside().map(|s| s.velocity.length()).fold(0.0, f64::max),
            rms_gradient: (outside().map(|s| s.gradient_sq).sum::<f64>() / count).sqrt(),
            max_divergence: outside().filter(|s| s.distance > clear).fold(0.0, |m: f64, s| m.max(s.divergence.abs())),
            inside_share: self.samples.iter().filter(|s| s.is_inside()).count() as f64 / self.samples.len() as f64,
        }
    }

    /// The numbers as a picture of float channels: `velocity.X`, `.Y`, `.Z`, `speed`, `divergence`, `distance`.
    pub fn to_image(&self) -> Image {
        let mut image = Image::new(self.size);
        let velocity: Vec<[f32; 3]> = self.samples.iter().map(|s| s.velocity.as_vec3().to_array()).collect();
        image.push_xyz("velocity", SampleKind::Float, &velocity);
        let mut push = |name: &str, f: fn(&Sample) -> f64| {
            image.push(name, SampleKind::Float, self.samples.iter().map(|s| f(s) as f32).collect());
        };
        push("speed", |s| s.velocity.length());
        push("divergence", |s| s.divergence);
        push("distance", |s| s.distance);
        image
    }
}

impl Sample {
    /// Whether the middle of the pixel is inside an obstacle.
    pub fn is_inside(&self) -> bool {
        self.distance < 0.0
    }
}

fn sample_at(flow: &impl Flow, time: f64, p: DVec3, step: f64) -> Sample {
    let derivatives = DVec3::AXES
        .map(|axis| (flow.velocity(p + axis * step, time) - flow.velocity(p - axis * step, time)) / (2.0 * step));
    Sample {
        velocity: flow.velocity(p, time),
        distance: flow.distance(p, time),
        divergence: (0..3).map(|i| derivatives[i][i]).sum(),
        gradient_sq: derivatives.iter().map(|d| d.length_squared()).sum(),
    }
}

/// Figures of a slice, all of them outside obstacles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Root of the mean square of the speed [m/s].
    pub rms_speed: f64,
    /// Largest speed [m/s].
    pub max_speed: f64,
    /// Root of the mean square of the velocity's gradient, Frobenius norm [1/s].
    pub rms_gradient: f64,
    /// Largest magnitude of the divergence [1/s].
    pub max_divergence: f64,
    /// Share of the slice inside obstacles, 0 to 1.
    pub inside_share: f64,
}

impl Summary {
    /// Largest divergence as a share of the RMS gradient: what is left of it is rounding and the error of differences.
    pub fn relative_divergence(&self) -> f64 {
        if self.rms_gradient > 0.0 { self.max_divergence / self.rms_gradient } else { 0.0 }
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "speed: RMS {:.4} m/s, largest {:.4} m/s", self.rms_speed, self.max_speed)?;
        writeln!(
            f,
            "divergence: largest {:.2e} 1/s, {:.2e} of the RMS gradient of {:.3} 1/s",
            self.max_divergence,
            self.relative_divergence(),
            self.rms_gradient
        )?;
        write!(f, "inside obstacles: {:.1} % of the slice", 100.0 * self.inside_share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspect::probe::known::{Rotation, Uniform};

    fn front(size: [f64; 2]) -> Rectangle {
        Rectangle::try_new(DVec3::ZERO, DVec3::Z, size).unwrap()
    }

    #[test]
    fn a_rotation_has_its_known_figures() {
        let flow = Rotation { rate: 2.0, ball: Some((DVec3::ZERO, 0.5)) };
        let slice = Slice::sample(&flow, 0.0, front([4.0, 2.0]), [80, 40]);
        let s = slice.samples[0];
        assert!(s.velocity.distance(DVec3::Z.cross(DVec3::new(-1.975, 0.975, 0.0)) * 2.0) < 1e-12);
        assert!((s.gradient_sq - 8.0).abs() < 1e-6 && s.divergence.abs() < 1e-7);
        let summary = slice.summary();
        assert!((summary.max_speed - 2.0 * 1.975f64.hypot(0.975)).abs() < 1e-12);
        assert!((summary.rms_gradient - 8f64.sqrt()).abs() < 1e-6 && summary.relative_divergence() < 1e-7);
        assert!((summary.inside_share - std::f64::consts::PI * 0.25 / 8.0).abs() < 0.005, "{}", summary.inside_share);
        assert_eq!(slice.in_plane()[20 * 80 + 40], [0.0; 2]);
    }

    #[test]
    fn channels_are_the_field_in_the_axes_of_the_world() {
        let side = Rectangle::try_new(DVec3::ZERO, DVec3::X, [1.0, 1.0]).unwrap();
        let slice = Slice::sample(&Uniform(DVec3::new(1.0, 2.0, 3.0)), 0.0, side, [3, 3]);
        let image = slice.to_image();
        for (name, value) in [("velocity.X", 1.0), ("velocity.Y", 2.0), ("velocity.Z", 3.0), ("speed", 14f32.sqrt())] {
            assert!(image.channel(name).unwrap().iter().all(|&x| x == value), "{name}");
        }
        // Seen from +x, right is −z.
        assert_eq!(slice.in_plane()[0], [-3.0, 2.0]);
        assert_eq!(image.channel("distance").unwrap()[4], f32::INFINITY);
    }
}
