//! Everything that light meets but smoke: surfaces, materials and lights, and which light is asked for a connection.

use crate::geometry::embree::{Hit, Ray, TraceScene};
use crate::math::space::WorldPoint;
use crate::render::color::Rgb;
use crate::render::light::Light;
use crate::render::light_path::OTHER_GROUP;
use crate::render::material::{Material, Sight};

/// Surfaces that a ray passes before it counts as lost among them: an end for rays that rounding holds in a place.
const SURFACES_PASSED_MAX: u32 = 10_000;

/// Everything that light meets, but for the smoke, which changes from frame to frame.
pub struct World {
    /// Surfaces.
    pub surfaces: TraceScene,
    /// Material of each shape, by shape index.
    pub materials: Vec<Material>,
    /// Light sources.
    pub lights: Vec<Light>,
    /// Number of the group of each light.
    pub groups: Vec<usize>,
    /// Running sums of the probability of choosing each light for a direct connection.
    choice: Vec<f32>,
}

/// A light that a path meets by itself.
#[derive(Debug, Clone, Copy)]
pub struct MetLight {
    /// Which.
    pub light: usize,
    /// Distance along the ray [m].
    pub t: f32,
    /// Radiance towards the ray's origin [W/(m² sr)].
    pub radiance: Rgb,
    /// Density [1/sr] with which it would have been sampled here, times the probability of choosing it.
    pub pdf: f32,
}

impl World {
    /// Puts surfaces and lights together; `center` is the middle of what is lit, from which lights are weighed.
    pub fn new(surfaces: TraceScene, materials: Vec<Material>, lights: Vec<Light>, center: WorldPoint) -> Self {
        let shares: Vec<f32> = lights
            .iter()
            .map(|l| if l.is_worth_sampling() { l.rough_irradiance(center).sqrt() } else { 0.0 })
            .collect();
        let total: f32 = shares.iter().sum();
        let mut sum = 0.0;
        let choice = shares
            .iter()
            .map(|share| {
                sum += if total > 0.0 { share / total } else { 0.0 };
                sum
            })
            .collect();
        let groups = vec![OTHER_GROUP; lights.len()];
        Self { surfaces, materials, lights, groups, choice }
    }

    /// The nearest surface that a ray of the camera meets.
    pub fn seen_by_camera(&self, ray: &Ray) -> Option<Hit> {
        self.first_hit(ray, f32::INFINITY, |material| material.sight != Sight::Through)
    }

    /// The nearest surface before `t_max` of a material that `stops` the ray; others are as if they were not there.
    fn first_hit(&self, ray: &Ray, t_max: f32, stops: impl Fn(&Material) -> bool) -> Option<Hit> {
        let (mut start, mut passed) = (*ray, 0.0);
        for _ in 0..SURFACES_PASSED_MAX {
            let mut hit = self.surfaces.intersect(&start, 0.0, t_max - passed)?;
            hit.t += passed;
            if stops(&self.materials[hit.shape_idx as usize]) {
                return Some(hit);
            }
            passed = hit.t;
            start = Ray { origin: hit.offset_origin(ray.direction), direction: ray.direction };
        }
        None
    }

    /// What would be in the way if there were lights and shadow catchers only: the nearest of the latter, before `t_max`.
    pub fn nearest_catcher(&self, ray: &Ray, t_max: f32) -> Option<Hit> {
        self.first_hit(ray, t_max, |material| material.sight == Sight::Shadow)
    }

    /// The light chosen by the uniform number `u`.
    pub fn choose_light(&self, u: f32) -> Option<usize> {
        let last = *self.choice.last()?;
        (last > 0.0).then(|| self.choice.partition_point(|&c| c <= u * last).min(self.choice.len() - 1))
    }

    /// Probability of choosing light `i`.
    pub fn pmf(&self, i: usize) -> f32 {
        self.choice[i] - if i == 0 { 0.0 } else { self.choice[i - 1] }
    }

    /// The nearest light that the ray meets before `t_max`.
    pub fn nearest_light(&self, ray: &Ray, t_max: f32) -> Option<MetLight> {
        let hits = self.lights.iter().enumerate().filter_map(|(i, light)| Some((i, light.intersect(ray)?)));
        hits.filter(|(_, hit)| hit.t < t_max).min_by(|a, b| a.1.t.total_cmp(&b.1.t)).map(|(light, hit)| MetLight {
            light,
            t: hit.t,
            radiance: hit.radiance,
            pdf: hit.pdf * self.pmf(light),
        })
    }

    /// Whether a surface or a light other than number `target` is in the way.
    pub fn is_blocked(&self, ray: &Ray, t_max: f32, target: usize) -> bool {
        self.surfaces.is_occluded(ray, 0.0, t_max) || self.is_behind_light(ray, t_max, target)
    }

    /// Whether a light other than number `target` is in the way.
    pub fn is_behind_light(&self, ray: &Ray, t_max: f32, target: usize) -> bool {
        let behind_light =
            |(i, light): (usize, &Light)| i != target && light.intersect(ray).is_some_and(|h| h.t < t_max);
        self.lights.iter().enumerate().any(behind_light)
    }
}
