//! Light sources: sampling for shadow rays, and what a path that meets one by itself receives.

use crate::geometry::embree::Ray;
use crate::math::space::{UnitVec3, WorldPoint};
use crate::render::color::{Rgb, luminance};
use crate::render::environment::Environment;
use crate::render::sun::Sun;
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, PI, TAU};

/// A source of light.
#[derive(Debug, Clone)]
pub enum Light {
    /// Parallel light, or a disk of the sky.
    Sun(Sun),
    /// Light from infinitely far.
    Environment(Environment),
    /// A rectangle that shines from its front.
    Rectangle(Rectangle),
    /// A ball that shines.
    Sphere(Sphere),
    /// A point.
    Point {
        /// Where.
        position: WorldPoint,
        /// Radiant intensity [W/sr].
        intensity: Rgb,
    },
}

/// A rectangle that shines from the side where `half_u × half_v` points; its back is black.
#[derive(Debug, Clone)]
pub struct Rectangle {
    center: WorldPoint,
    half_u: Vec3,
    half_v: Vec3,
    normal: UnitVec3,
    area: f32,
    radiance: Rgb,
}

/// A ball that shines.
#[derive(Debug, Clone)]
pub struct Sphere {
    center: WorldPoint,
    radius: f32,
    radiance: Rgb,
}

/// A direction towards a light.
#[derive(Debug, Clone, Copy)]
pub struct LightSample {
    /// From the lit point to the light.
    pub direction: UnitVec3,
    /// How far the light is; infinite for sun and environment [m].
    pub distance: f32,
    /// Radiance [W/(m² sr)] over `pdf`; for lights of no extent, irradiance on a surface facing it [W/m²].
    pub weight: Rgb,
    /// Density over solid angle [1/sr], or `None` where the light has no extent and no path can meet it by chance.
    pub pdf: Option<f32>,
}

/// A path meets a light by itself.
#[derive(Debug, Clone, Copy)]
pub struct LightHit {
    /// Distance along the ray [m].
    pub t: f32,
    /// Radiance towards the ray's origin [W/(m² sr)]; black for the back of a rectangle.
    pub radiance: Rgb,
    /// Density [1/sr] with which the light itself would have been sampled here.
    pub pdf: f32,
}

impl Rectangle {
    /// A rectangle about `center` with half edges `half_u` and `half_v` [m]; `None` where it has no area.
    pub fn try_new(center: WorldPoint, half_u: Vec3, half_v: Vec3, radiance: Rgb) -> Option<Self> {
        let across = half_u.cross(half_v);
        let normal = UnitVec3::try_new(across)?;
        Some(Self { center, half_u, half_v, normal, area: 4.0 * across.length(), radiance })
    }

    fn intersect(&self, ray: &Ray) -> Option<LightHit> {
        let cosine = -self.normal.dot(*ray.direction);
        let t = (ray.origin - self.center).dot(*self.normal) / cosine;
        if !t.is_finite() || t <= 1e-6 {
            return None;
        }
        let p = ray.at(t) - self.center;
        // The edges may be oblique: solve for the coordinates along them.
        let n = self.half_u.cross(self.half_v);
        let u = p.cross(self.half_v).dot(n) / n.length_squared();
        let v = self.half_u.cross(p).dot(n) / n.length_squared();
        if u.abs() > 1.0 || v.abs() > 1.0 {
            return None;
        }
        let is_front = cosine > 0.0;
        Some(LightHit {
            t,
            radiance: if is_front { self.radiance } else { Vec3::ZERO },
            pdf: if is_front { t * t / (cosine * self.area) } else { 0.0 },
        })
    }
}

impl Sphere {
    /// A ball about `center` of `radius` > 0 [m].
    pub fn new(center: WorldPoint, radius: f32, radiance: Rgb) -> Self {
        Self { center, radius, radiance }
    }

    /// One minus the cosine of the half angle under which the ball appears from distance `d` outside, without
    /// cancellation for far balls.
    fn one_minus_cosine(&self, d_sq: f32) -> f32 {
        let sine_sq = (self.radius * self.radius / d_sq).min(1.0);
        sine_sq / (1.0 + (1.0 - sine_sq).sqrt())
    }

    fn pdf(&self, from: WorldPoint) -> f32 {
        let d_sq = (self.center - from).length_squared();
        if d_sq <= self.radius * self.radius {
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
        let t = if to_center.length_squared() > self.radius * self.radius {
            along - half_chord
        } else {
            along + half_chord
        };
        (t > 1e-6).then_some(t)
    }

    fn intersect(&self, ray: &Ray) -> Option<LightHit> {
        let t = self.distance_along(ray)?;
        Some(LightHit { t, radiance: self.radiance, pdf: self.pdf(ray.origin) })
    }

    fn sample(&self, from: WorldPoint, u: [f32; 2]) -> Option<LightSample> {
        let to_center = self.center - from;
        let d_sq = to_center.length_squared();
        let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
        let local = |one_minus_cosine: f32| {
            let sine = (one_minus_cosine * (2.0 - one_minus_cosine)).max(0.0).sqrt();
            Vec3::new(sine * cos_phi, sine * sin_phi, 1.0 - one_minus_cosine)
        };
        let direction = if d_sq > self.radius * self.radius {
            UnitVec3::try_new(to_center)?.from_local(local(u[0] * self.one_minus_cosine(d_sq)))
        } else {
            UnitVec3::Y.from_local(local(2.0 * u[0]))
        };
        let pdf = self.pdf(from);
        let distance =
            self.distance_along(&Ray { origin: from, direction }).unwrap_or_else(|| to_center.dot(*direction).max(0.0));
        Some(LightSample { direction, distance, weight: self.radiance / pdf, pdf: Some(pdf) })
    }
}

impl Light {
    /// A direction from `from` towards the light, from two uniform numbers; `None` where no light comes from it.
    pub fn sample(&self, from: WorldPoint, u: [f32; 2]) -> Option<LightSample> {
        match self {
            Light::Sun(sun) => Some(sun.sample(u)),
            Light::Environment(environment) => {
                let s = environment.sample(u);
                (s.pdf > 0.0).then(|| LightSample {
                    direction: s.direction,
                    distance: f32::INFINITY,
                    weight: s.radiance / s.pdf,
                    pdf: Some(s.pdf),
                })
            }
            Light::Rectangle(r) => {
                let p = r.center + r.half_u * (2.0 * u[0] - 1.0) + r.half_v * (2.0 * u[1] - 1.0);
                let offset = p - from;
                let direction = UnitVec3::try_new(offset)?;
                let cosine = -r.normal.dot(*direction);
                if cosine <= 0.0 {
                    return None;
                }
                let distance = offset.length();
                let pdf = distance * distance / (cosine * r.area);
                Some(LightSample { direction, distance, weight: r.radiance / pdf, pdf: Some(pdf) })
            }
            Light::Sphere(sphere) => sphere.sample(from, u),
            Light::Point { position, intensity } => {
                let offset = *position - from;
                let direction = UnitVec3::try_new(offset)?;
                let distance = offset.length();
                Some(LightSample { direction, distance, weight: *intensity / (distance * distance), pdf: None })
            }
        }
    }

    /// Where a ray meets the light, for lights that have a place and an extent.
    pub fn intersect(&self, ray: &Ray) -> Option<LightHit> {
        match self {
            Light::Rectangle(rectangle) => rectangle.intersect(ray),
            Light::Sphere(sphere) => sphere.intersect(ray),
            Light::Sun(_) | Light::Environment(_) | Light::Point { .. } => None,
        }
    }

    /// Radiance [W/(m² sr)] of a light infinitely far that a ray out of the scene meets; `is_camera` for rays that the
    /// camera sends, which may be told not to see it.
    pub fn beyond(&self, ray: &Ray, is_camera: bool) -> Option<Rgb> {
        match self {
            Light::Environment(sky) => (sky.is_visible || !is_camera).then(|| sky.radiance(ray.direction)),
            Light::Sun(sun) if sun.is_visible || !is_camera => sun.met(ray.direction),
            _ => None,
        }
    }

    /// Density [1/sr] with which [`Light::sample`] returns a direction in which a light infinitely far is met.
    pub fn pdf_beyond(&self, direction: UnitVec3) -> f32 {
        match self {
            Light::Environment(sky) => sky.pdf(direction),
            Light::Sun(sun) => sun.pdf(),
            _ => 0.0,
        }
    }

    /// Whether shadow rays towards it are needed (no path can meet it) or lower the noise.
    pub fn is_worth_sampling(&self) -> bool {
        match self {
            Light::Environment(environment) => environment.is_worth_sampling(),
            _ => true,
        }
    }

    /// A rough irradiance [W/m²] at `center` of a scene: its share when one light is chosen among several.
    pub fn rough_irradiance(&self, center: WorldPoint) -> f32 {
        let by_distance = |p: WorldPoint| 1.0 / (p - center).length_squared().max(1e-4);
        // No light of an extent gives more than π times its radiance, however near and large it is.
        let of_disk = |radiance: Rgb, area: f32, p: WorldPoint| luminance(radiance) * (area * by_distance(p)).min(PI);
        match self {
            Light::Sun(sun) => luminance(sun.irradiance()),
            Light::Environment(environment) => PI * environment.mean_luminance(),
            Light::Rectangle(r) => of_disk(r.radiance, r.area, r.center),
            Light::Sphere(s) => of_disk(s.radiance, PI * s.radius * s.radius, s.center),
            Light::Point { position, intensity } => luminance(*intensity) * by_distance(*position),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};

    /// Sampling a light and meeting it by chance must give the same irradiance on a small sphere at `from`.
    fn check_against_uniform_directions(light: &Light, from: WorldPoint) {
        let mut rng = CounterRng::new(Seed(9));
        let n = 300_000;
        let (mut sampled, mut met, mut unit) = (0.0f64, 0.0f64, 0.0f64);
        for _ in 0..n {
            if let Some(s) = light.sample(from, [rng.uniform(), rng.uniform()]) {
                sampled += f64::from(luminance(s.weight)) / n as f64;
                let hit = light.intersect(&Ray { origin: from, direction: s.direction });
                if let Some(hit) = hit {
                    assert!((hit.t / s.distance - 1.0).abs() < 1e-3, "{} {}", hit.t, s.distance);
                    assert!((hit.pdf / s.pdf.expect("has extent") - 1.0).abs() < 1e-2);
                }
            }
            let z = 1.0 - 2.0 * rng.uniform();
            let (sin, cos) = (TAU * rng.uniform()).sin_cos();
            let r = (1.0 - z * z).max(0.0).sqrt();
            let direction = UnitVec3::new_unchecked(Vec3::new(r * cos, z, r * sin));
            if let Some(hit) = light.intersect(&Ray { origin: from, direction }) {
                met += f64::from(luminance(hit.radiance) * 4.0 * PI) / n as f64;
                unit += f64::from(hit.pdf * 4.0 * PI) / n as f64;
            }
        }
        assert!((sampled / met - 1.0).abs() < 0.03, "sampled {sampled}, met {met}");
        assert!((unit - 1.0).abs() < 0.03, "density integrates to {unit}");
    }

    #[test]
    fn a_rectangle_gives_the_same_sampled_and_met() {
        let light = Rectangle::try_new(
            WorldPoint::new(0.0, 2.0, 0.0),
            Vec3::new(1.0, 0.0, 0.2),
            Vec3::new(0.0, 0.3, 0.8),
            Vec3::splat(2.0),
        )
        .expect("has area");
        let below = if light.normal.y < 0.0 { -1.0 } else { 1.0 };
        check_against_uniform_directions(&Light::Rectangle(light), WorldPoint::new(0.2, 2.0 + 1.5 * below, 0.4));
    }

    #[test]
    fn a_sphere_gives_the_same_sampled_and_met_outside_and_inside() {
        let light = Light::Sphere(Sphere::new(WorldPoint::new(1.0, 2.0, 0.0), 0.8, Vec3::splat(2.0)));
        check_against_uniform_directions(&light, WorldPoint::new(0.2, 0.5, 0.4));
        check_against_uniform_directions(&light, WorldPoint::new(1.2, 2.1, 0.4));
    }

    #[test]
    fn a_far_small_sphere_has_the_solid_angle_of_its_disk() {
        let sphere = Sphere::new(WorldPoint::new(0.0, 1.0e4, 0.0), 1.0, Vec3::ONE);
        let expected = 1.0 / (PI * 1.0e-8);
        assert!((sphere.pdf(WorldPoint::default()) / expected - 1.0).abs() < 1e-4);
    }
}
