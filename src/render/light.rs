//! Light sources: sampling for shadow rays, and what a path that meets one by itself receives.

use crate::geometry::embree::Ray;
use crate::math::space::{UnitVec3, WorldPoint};
use crate::render::ball::Ball;
use crate::render::color::{Rgb, luminance};
use crate::render::environment::Environment;
use crate::render::panel::Panel;
use crate::render::spot::Spot;
use crate::render::sun::Sun;
use crate::render::surface_light::SurfaceLight;
use std::f32::consts::PI;

/// Square of the distance below which a point is not nearer to a lamp where lights are weighed [m²].
const NEAREST_SQ: f32 = 1e-4;

/// A source of light.
#[derive(Debug, Clone)]
pub enum Light {
    /// Parallel light, or a disk of the sky.
    Sun(Sun),
    /// Light from infinitely far.
    Environment(Environment),
    /// A rectangle or a disk.
    Panel(Panel),
    /// A ball that shines.
    Ball(Ball),
    /// A point.
    Point {
        /// Where.
        position: WorldPoint,
        /// Radiant intensity [W/sr].
        intensity: Rgb,
    },
    /// A point that shines into a cone.
    Spot(Spot),
    /// A glowing shape.
    Surface(SurfaceLight),
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
            Light::Panel(panel) => panel.sample(from, u),
            Light::Ball(ball) => ball.sample(from, u),
            Light::Spot(spot) => spot.sample(from),
            Light::Surface(surface) => surface.sample(from, u),
            Light::Point { position, intensity } => {
                let offset = *position - from;
                let direction = UnitVec3::try_new(offset)?;
                let distance = offset.length();
                Some(LightSample { direction, distance, weight: *intensity / (distance * distance), pdf: None })
            }
        }
    }

    /// Where a ray meets the light, for lights that have a place and an extent and are no surface of their own.
    pub fn intersect(&self, ray: &Ray) -> Option<LightHit> {
        match self {
            Light::Panel(panel) => panel.intersect(ray),
            Light::Ball(ball) => ball.intersect(ray),
            Light::Sun(_) | Light::Environment(_) | Light::Point { .. } | Light::Spot(_) | Light::Surface(_) => None,
        }
    }

    /// Whether camera rays see it, where rays meet it at all.
    #[inline]
    pub fn is_visible(&self) -> bool {
        match self {
            Light::Sun(sun) => sun.is_visible,
            Light::Environment(environment) => environment.is_visible,
            Light::Panel(panel) => panel.is_visible,
            Light::Ball(ball) => ball.is_visible,
            Light::Point { .. } | Light::Spot(_) | Light::Surface(_) => true,
        }
    }

    /// Radiance [W/(m² sr)] of a light infinitely far that a ray out of the scene meets; `is_camera` for rays that the
    /// camera sends, which may be told not to see it.
    #[inline]
    pub fn beyond(&self, ray: &Ray, is_camera: bool) -> Option<Rgb> {
        match self {
            _ if is_camera && !self.is_visible() => None,
            Light::Environment(sky) => Some(sky.radiance(ray.direction)),
            Light::Sun(sun) => sun.met(ray.direction),
            _ => None,
        }
    }

    /// Density [1/sr] with which [`Light::sample`] returns a direction in which a light infinitely far is met.
    #[inline]
    pub fn pdf_beyond(&self, direction: UnitVec3) -> f32 {
        match self {
            Light::Environment(sky) => sky.pdf(direction),
            Light::Sun(sun) => sun.pdf(),
            _ => 0.0,
        }
    }

    /// Whether [`Light::sample`] depends on its numbers.
    pub fn has_extent(&self) -> bool {
        match self {
            Light::Sun(sun) => sun.one_minus_cosine() > 0.0,
            Light::Point { .. } | Light::Spot(_) => false,
            Light::Environment(_) | Light::Panel(_) | Light::Ball(_) | Light::Surface(_) => true,
        }
    }

    /// Whether shadow rays towards it are needed (no path can meet it) or lower the noise.
    pub fn is_worth_sampling(&self) -> bool {
        match self {
            Light::Environment(environment) => environment.is_worth_sampling(),
            _ => true,
        }
    }

    /// Middle of a light that has a place, and the radius of a ball about it that holds it [m].
    pub fn place(&self) -> Option<(WorldPoint, f32)> {
        match self {
            Light::Sun(_) | Light::Environment(_) => None,
            Light::Panel(panel) => Some((panel.center(), panel.bounding_radius())),
            Light::Ball(ball) => Some((ball.center(), ball.radius())),
            Light::Point { position, .. } => Some((*position, 0.0)),
            Light::Spot(spot) => Some((spot.position(), 0.0)),
            Light::Surface(surface) => Some((surface.center(), surface.bounding_radius())),
        }
    }

    /// The largest radiant intensity of a light that has a place, in any direction and from afar, as luminance [W/sr]; 0
    /// for others.
    pub fn peak_intensity(&self) -> f32 {
        match self {
            Light::Sun(_) | Light::Environment(_) => 0.0,
            Light::Panel(panel) => luminance(panel.radiance()) * panel.area(),
            Light::Ball(ball) => luminance(ball.radiance()) * PI * ball.radius() * ball.radius(),
            Light::Point { intensity, .. } => luminance(*intensity),
            Light::Spot(spot) => luminance(spot.axial_intensity()),
            Light::Surface(surface) => luminance(surface.radiance()) * surface.mean_shadow_area(),
        }
    }

    /// Irradiance [W/m²] at a point from a light that has a place, as luminance and roughly: without what is in the way,
    /// as if it came from the middle. 0 only where there is no light from it at all, and for lights without a place.
    pub fn irradiance_at(&self, at: WorldPoint) -> f32 {
        let Some((place, radius)) = self.place() else { return 0.0 };
        let offset = at - place;
        // Near or within a light of some extent it grows no more.
        let d_sq = offset.length_squared().max(0.25 * radius * radius).max(NEAREST_SQ);
        let intensity = match self {
            Light::Spot(spot) => UnitVec3::try_new(offset).map_or(0.0, |to| luminance(spot.intensity(*to))),
            Light::Panel(panel) => {
                let height = panel.height(at);
                if height <= 0.0 {
                    return 0.0;
                }
                // Seen from almost beside, other parts than the middle give light too.
                self.peak_intensity() * (height / d_sq.sqrt()).clamp(0.1, 1.0)
            }
            _ => self.peak_intensity(),
        };
        intensity / d_sq
    }

    /// A rough irradiance [W/m²] of a light that has no place, which is alike everywhere: its share when one light is chosen
    /// among several. 0 of others.
    pub fn far_irradiance(&self) -> f32 {
        match self {
            Light::Sun(sun) => luminance(sun.irradiance()),
            Light::Environment(environment) => PI * environment.mean_luminance(),
            Light::Panel(_) | Light::Ball(_) | Light::Point { .. } | Light::Spot(_) | Light::Surface(_) => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};
    use crate::render::panel::Outline;
    use glam::Vec3;
    use std::f32::consts::TAU;

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

    fn oblique(outline: Outline) -> Panel {
        let (u, v) = (Vec3::new(1.0, 0.0, 0.2), Vec3::new(0.0, 0.3, 0.8));
        Panel::try_new(outline, WorldPoint::new(0.0, 2.0, 0.0), u, v, Vec3::splat(2.0)).expect("has area")
    }

    #[test]
    fn panels_give_the_same_sampled_and_met() {
        for outline in [Outline::Rectangle, Outline::Disk] {
            // u × v points down.
            let (front, back) = (WorldPoint::new(0.2, 0.5, 0.4), WorldPoint::new(0.2, 3.5, 0.4));
            let panel = oblique(outline);
            assert!(panel.sample(back, [0.3, 0.6]).is_none());
            check_against_uniform_directions(&Light::Panel(panel.clone()), front);
            let mut both = panel;
            both.is_two_sided = true;
            let both = Light::Panel(both);
            check_against_uniform_directions(&both, front);
            check_against_uniform_directions(&both, back);
        }
    }

    #[test]
    fn a_disk_gives_what_a_disk_gives_on_its_axis() {
        // Irradiance of a surface that faces a disk of radius r from distance h: π L r²/(r² + h²).
        let disk = Panel::disk(WorldPoint::new(0.0, 2.0, 0.0), Vec3::NEG_Y, 0.7, Vec3::splat(3.0)).expect("has area");
        let mut sum = 0.0f64;
        const N: usize = 200;
        for i in 0..N * N {
            let u = [i % N, i / N].map(|k| (k as f32 + 0.5) / N as f32);
            let s = disk.sample(WorldPoint::default(), u).expect("its front is seen");
            sum += f64::from(s.weight.x * s.direction.y) / (N * N) as f64;
        }
        let expected = f64::from(PI) * 3.0 * 0.49 / (0.49 + 4.0);
        assert!((sum / expected - 1.0).abs() < 1e-4, "{sum} {expected}");
    }

    #[test]
    fn a_ball_gives_the_same_sampled_and_met_outside_and_inside() {
        let light = Light::Ball(Ball::new(WorldPoint::new(1.0, 2.0, 0.0), 0.8, Vec3::splat(2.0)));
        check_against_uniform_directions(&light, WorldPoint::new(0.2, 0.5, 0.4));
        check_against_uniform_directions(&light, WorldPoint::new(1.2, 2.1, 0.4));
    }
}
