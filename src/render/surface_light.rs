//! Glowing shapes as lights: surfaces that light meets anyway, asked for direct connections as well.
//!
//! A shape that gives off the same radiance everywhere is a light like any other. Triangles are sampled evenly over their
//! area, which for one radiance is by power; balls over the cone under which they appear. Both sides shine.

use crate::math::space::{UnitVec3, WorldPoint};
use crate::render::ball::Ball;
use crate::render::color::Rgb;
use crate::render::light::LightSample;
use glam::Vec3;

/// A shape that gives off the same radiance everywhere, to both sides.
#[derive(Debug, Clone)]
pub struct SurfaceLight {
    /// Which shape.
    pub shape_idx: u32,
    radiance: Rgb,
    form: Form,
}

#[derive(Debug, Clone)]
enum Form {
    Ball(Ball),
    Triangles(Triangles),
}

#[derive(Debug, Clone)]
struct Triangles {
    /// First corner and the two edges from it [m].
    corners: Vec<[Vec3; 3]>,
    /// Areas up to and with each [m²].
    sums: Vec<f64>,
    center: WorldPoint,
    bounding_radius: f32,
}

impl SurfaceLight {
    /// A ball about `center` of `radius` > 0 [m]. Radiance in [W/(m² sr)].
    pub fn ball(shape_idx: u32, center: WorldPoint, radius: f32, radiance: Rgb) -> Self {
        Self { shape_idx, radiance, form: Form::Ball(Ball::new(center, radius, radiance)) }
    }

    /// Triangles with these corners [m]; `None` where they have no area. Radiance in [W/(m² sr)].
    pub fn triangles(shape_idx: u32, corners: impl Iterator<Item = [Vec3; 3]>, radiance: Rgb) -> Option<Self> {
        let corners: Vec<[Vec3; 3]> = corners.map(|[a, b, c]| [a, b - a, c - a]).collect();
        let mut area = 0.0;
        let sums = corners.iter().map(|[_, e, f]| {
            area += 0.5 * f64::from(e.cross(*f).length());
            area
        });
        let sums: Vec<f64> = sums.collect();
        let points = || corners.iter().flat_map(|[a, e, f]| [*a, *a + *e, *a + *f]);
        let low = points().fold(Vec3::INFINITY, Vec3::min);
        let high = points().fold(Vec3::NEG_INFINITY, Vec3::max);
        let (center, bounding_radius) = (WorldPoint(0.5 * (low + high)), 0.5 * (high - low).length());
        let is_sound = area > 0.0 && area.is_finite();
        is_sound.then_some(Self {
            shape_idx,
            radiance,
            form: Form::Triangles(Triangles { corners, sums, center, bounding_radius }),
        })
    }

    /// Middle of its box.
    pub fn center(&self) -> WorldPoint {
        match &self.form {
            Form::Ball(ball) => ball.center(),
            Form::Triangles(triangles) => triangles.center,
        }
    }

    /// Radius of a ball about the middle that holds it [m].
    pub fn bounding_radius(&self) -> f32 {
        match &self.form {
            Form::Ball(ball) => ball.radius(),
            Form::Triangles(triangles) => triangles.bounding_radius,
        }
    }

    /// Area as it is seen from afar, on the mean over all directions [m²]: a quarter of the surface of what is convex and
    /// closed (Cauchy), half that of a single sheet.
    pub fn mean_shadow_area(&self) -> f32 {
        match &self.form {
            Form::Ball(ball) => std::f32::consts::PI * ball.radius() * ball.radius(),
            Form::Triangles(triangles) => 0.25 * triangles.area(),
        }
    }

    /// Radiance [W/(m² sr)].
    pub fn radiance(&self) -> Rgb {
        self.radiance
    }

    /// A direction to a point of it. Another part of itself may be in the way, as any other surface.
    pub fn sample(&self, from: WorldPoint, u: [f32; 2]) -> Option<LightSample> {
        match &self.form {
            Form::Ball(ball) => ball.sample(from, u),
            Form::Triangles(triangles) => triangles.sample(from, u, self.radiance),
        }
    }

    /// Density [1/sr] with which [`SurfaceLight::sample`] returns the direction of a ray from `from` that meets it at
    /// distance `t` [m], where its normal is `normal`.
    pub fn pdf(&self, from: WorldPoint, direction: UnitVec3, t: f32, normal: UnitVec3) -> f32 {
        match &self.form {
            Form::Ball(ball) => ball.pdf(from),
            Form::Triangles(triangles) => {
                // A ray along a triangle meets it with a probability of 0: any finite number will do.
                t * t / (direction.dot(*normal).abs().max(f32::MIN_POSITIVE) * triangles.area()).max(f32::MIN_POSITIVE)
            }
        }
    }
}

impl Triangles {
    fn area(&self) -> f32 {
        self.sums[self.sums.len() - 1] as f32
    }

    fn sample(&self, from: WorldPoint, u: [f32; 2], radiance: Rgb) -> Option<LightSample> {
        let target = f64::from(u[0]) * self.sums[self.sums.len() - 1];
        let i = self.sums.partition_point(|&sum| sum <= target).min(self.sums.len() - 1);
        let before = if i == 0 { 0.0 } else { self.sums[i - 1] };
        // What is left of the number that chose the triangle is uniform again.
        let u0 = ((target - before) / (self.sums[i] - before)).clamp(0.0, 1.0) as f32;
        let [a, e, f] = self.corners[i];
        let root = u0.sqrt();
        let p = a + e * (root * (1.0 - u[1])) + f * (root * u[1]);
        let offset = p - from.0;
        let direction = UnitVec3::try_new(offset)?;
        let normal = UnitVec3::try_new(e.cross(f))?;
        let cosine = direction.dot(*normal).abs();
        if cosine <= 0.0 {
            return None;
        }
        let distance = offset.length();
        let pdf = distance * distance / (cosine * self.area());
        Some(LightSample { direction, distance, weight: radiance / pdf, pdf: Some(pdf) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};
    use crate::math::statistics::chi_square_test;
    use std::f32::consts::PI;

    /// Three triangles of areas 1 : 2 : 5 in the plane y = 1, and the quarter of the sky above.
    fn triangles() -> SurfaceLight {
        let at = |x: f32, z: f32| Vec3::new(x, 1.0, z);
        let corners = [
            [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0)],
            [at(0.0, 0.0), at(-2.0, 0.0), at(0.0, 1.0)],
            [at(0.0, 0.0), at(-2.5, 0.0), at(0.0, -2.0)],
        ];
        SurfaceLight::triangles(0, corners.into_iter(), Vec3::splat(2.0)).expect("has area")
    }

    #[test]
    fn triangles_are_chosen_by_area_and_sampled_evenly() {
        let light = triangles();
        let mut rng = CounterRng::new(Seed(3));
        let from = WorldPoint::new(0.1, 0.0, 0.2);
        let n = 80_000;
        // Of each triangle the halves nearer to and farther from the common corner: areas 1 : 3 by half the distance.
        let mut counts = [0.0; 6];
        for _ in 0..n {
            let s = light.sample(from, [rng.uniform(), rng.uniform()]).expect("seen");
            let p = from + *s.direction * s.distance;
            assert!((p.0.y - 1.0).abs() < 1e-5);
            let (x, z) = (p.0.x, p.0.z);
            let (triangle, depth) = if x > 0.0 {
                (0, x + z)
            } else if z > 0.0 {
                (1, z - x / 2.0)
            } else {
                (2, -x / 2.5 - z / 2.0)
            };
            counts[2 * triangle + usize::from(depth > 0.5)] += 1.0;
            let again = light.pdf(from, s.direction, s.distance, UnitVec3::Y);
            assert!((again / s.pdf.unwrap() - 1.0).abs() < 1e-5);
        }
        let expected = [1.0, 3.0, 2.0, 6.0, 5.0, 15.0].map(|share| share / 32.0 * f64::from(n));
        let p = chi_square_test(&counts, &expected);
        assert!(p > 1e-3, "p {p}: {counts:?} {expected:?}");
    }

    #[test]
    fn far_away_it_gives_its_radiance_times_its_solid_angle() {
        let light = triangles();
        let from = WorldPoint::new(-0.5, -200.0, 0.0);
        let mut rng = CounterRng::new(Seed(3));
        let n = 2000;
        let sum: f32 = (0..n).map(|_| light.sample(from, [rng.uniform(), rng.uniform()]).expect("seen").weight.x).sum();
        let expected = 2.0 * 4.0 / (201.0 * 201.0);
        assert!((sum / n as f32 / expected - 1.0).abs() < 1e-3);
        let ball = SurfaceLight::ball(1, WorldPoint::new(0.0, 3.0, 0.0), 0.5, Vec3::ONE);
        let s = ball.sample(WorldPoint::default(), [0.3, 0.8]).expect("seen");
        // The cone of a ball has sin² = r²/d².
        let solid_angle = 2.0 * PI * (1.0 - (1.0f32 - 0.25 / 9.0).sqrt());
        assert!((s.weight.x / solid_angle - 1.0).abs() < 1e-4);
    }

    #[test]
    fn what_has_no_area_is_no_light() {
        let line = [Vec3::ZERO, Vec3::X, Vec3::X * 2.0];
        assert!(SurfaceLight::triangles(0, [line].into_iter(), Vec3::ONE).is_none());
        assert!(SurfaceLight::triangles(0, std::iter::empty(), Vec3::ONE).is_none());
    }
}
