//! Balls that shine, sampled over the cone under which they appear.

use crate::geometry::embree::Ray;
use crate::math::space::{UnitVec3, WorldPoint};
use crate::render::color::Rgb;
use crate::render::light::{LightHit, LightSample};
use crate::render::sun::in_cone;
use std::f32::consts::{FRAC_1_PI, TAU};

/// How far outside a point counts as on the surface, relative to the coordinates involved: twice of what rays that leave a
/// surface are moved off it.
const ON_SURFACE: f32 = 64.0 * f32::EPSILON;

/// A ball that shines.
#[derive(Debug, Clone)]
pub struct Ball {
    center: WorldPoint,
    radius: f32,
    radiance: Rgb,
    /// Whether camera rays see it.
    pub is_visible: bool,
}

impl Ball {
    /// A ball about `center` of `radius` > 0 [m], visible. Radiance in [W/(m² sr)].
    pub fn new(center: WorldPoint, radius: f32, radiance: Rgb) -> Self {
        Self { center, radius, radiance, is_visible: true }
    }

    /// Middle.
    pub fn center(&self) -> WorldPoint {
        self.center
    }

    /// Radius [m].
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Radiance [W/(m² sr)].
    pub fn radiance(&self) -> Rgb {
        self.radiance
    }

    /// One minus the cosine of the half angle under which the ball appears from distance `d` outside, without
    /// cancellation for far balls.
    fn one_minus_cosine(&self, d_sq: f32) -> f32 {
        let sine_sq = (self.radius * self.radius / d_sq).min(1.0);
        sine_sq / (1.0 + (1.0 - sine_sq).sqrt())
    }

    /// Whether a point is inside or, to within the rounding of coordinates, on the surface: a wall that is lit by itself.
    fn is_within(&self, p: WorldPoint) -> bool {
        self.height(p) <= self.rounding(p)
    }

    /// Distance of a point from the surface, negative inside [m].
    fn height(&self, p: WorldPoint) -> f32 {
        (self.center - p).length() - self.radius
    }

    /// Height below which a point cannot be told from one on the surface [m].
    fn rounding(&self, p: WorldPoint) -> f32 {
        ON_SURFACE * (p.0.abs().max(self.center.0.abs()).max_element() + self.radius)
    }

    /// Density [1/sr] with which [`Ball::sample`] returns a direction that meets the ball.
    pub fn pdf(&self, from: WorldPoint) -> f32 {
        let d_sq = (self.center - from).length_squared();
        if self.is_within(from) {
            return 0.25 * FRAC_1_PI;
        }
        1.0 / (TAU * self.one_minus_cosine(d_sq))
    }

    fn distance_along(&self, ray: &Ray) -> Option<f32> {
        let to_center = self.center - ray.origin;
        let along = to_center.dot(*ray.direction);
        // Distance of the ray from the centre from the cross product: exact for far balls where squares cancel.
        let off_sq = to_center.cross(*ray.direction).length_squared();
        let half_chord = (self.radius * self.radius - off_sq).sqrt();
        let (height, rounding) = (self.height(ray.origin), self.rounding(ray.origin));
        let t = match height {
            // From the surface the other side is met, and nothing outwards: a wall does not light itself through its own skin.
            _ if height.abs() <= rounding => 2.0 * along,
            _ if height < 0.0 => along + half_chord,
            _ => along - half_chord,
        };
        (t > 1e-6).then_some(t)
    }

    /// Where a ray meets it, from outside or from inside.
    pub fn intersect(&self, ray: &Ray) -> Option<LightHit> {
        let t = self.distance_along(ray)?;
        Some(LightHit { t, radiance: self.radiance, pdf: self.pdf(ray.origin) })
    }

    /// A direction even over the solid angle of the ball.
    pub fn sample(&self, from: WorldPoint, u: [f32; 2]) -> Option<LightSample> {
        let to_center = self.center - from;
        let d_sq = to_center.length_squared();
        let is_within = self.is_within(from);
        let direction = if is_within {
            in_cone(UnitVec3::Y, 2.0, u)
        } else {
            in_cone(UnitVec3::try_new(to_center)?, self.one_minus_cosine(d_sq), u)
        };
        let pdf = self.pdf(from);
        let distance = match self.distance_along(&Ray { origin: from, direction }) {
            Some(distance) => distance,
            // From the surface half of all directions lead away.
            None if is_within => return None,
            None => to_center.dot(*direction).max(0.0),
        };
        Some(LightSample { direction, distance, weight: self.radiance / pdf, pdf: Some(pdf) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use std::f32::consts::PI;

    #[test]
    fn a_wall_of_a_shining_room_is_lit_by_all_of_it() {
        // Irradiance from inside is π L wherever the wall is, by the luck of rounding on either side of the surface.
        let center = Vec3::new(30.0, -7.0, 12.0);
        let ball = Ball::new(WorldPoint(center), 2.0, Vec3::ONE);
        for (i, off) in [-3e-6f32, -3e-7, 0.0, 3e-7, 3e-6].into_iter().enumerate() {
            let out = UnitVec3::try_new(Vec3::new((i as f32).sin(), 0.4, (i as f32).cos())).expect("not zero");
            let from = WorldPoint(center + *out * (2.0 * (1.0 + off)));
            const N: usize = 128;
            let mut sum = 0.0f64;
            for k in 0..N * N {
                let u = [k % N, k / N].map(|k| (k as f32 + 0.5) / N as f32);
                let Some(s) = ball.sample(from, u) else { continue };
                let cosine = -out.dot(*s.direction);
                // Out through the wall it is near, and of no use.
                let across = 4.0 * cosine.max(0.0);
                assert!((s.distance - across).abs() < 2e-2, "{off}: {} {cosine}", s.distance);
                sum += f64::from(s.weight.x * cosine.max(0.0)) / (N * N) as f64;
            }
            assert!((sum / f64::from(PI) - 1.0).abs() < 1e-2, "{off}: {sum}");
        }
    }

    #[test]
    fn a_far_small_ball_has_the_solid_angle_of_its_disk() {
        let ball = Ball::new(WorldPoint::new(0.0, 1.0e4, 0.0), 1.0, Vec3::ONE);
        let expected = 1.0 / (PI * 1.0e-8);
        assert!((ball.pdf(WorldPoint::default()) / expected - 1.0).abs() < 1e-4);
    }
    #[test]
    fn the_outside_of_a_ball_is_not_lit_by_the_ball() {
        for (center, radius) in [(Vec3::new(100.0, -3.0, 20.0), 2.0f32), (Vec3::new(0.3, 0.1, -4.0), 0.5)] {
            let ball = Ball::new(WorldPoint(center), radius, Vec3::ONE);
            for i in 0..2000 {
                let angle = i as f32;
                let out =
                    UnitVec3::try_new(Vec3::new(angle.sin(), (0.37 * angle).sin(), angle.cos())).expect("not zero");
                // Where a ray hits it, with the rounding of single precision.
                let from = WorldPoint(center + *out * radius);
                let u = [(i % 50) as f32 / 50.0, (i / 50) as f32 / 40.0];
                if let Some(s) = ball.sample(from, u) {
                    assert!(out.dot(*s.direction) < 1e-4, "{from:?}: light from {:?} at {}", s.direction, s.distance);
                }
            }
        }
    }
}
