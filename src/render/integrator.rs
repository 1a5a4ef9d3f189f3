//! The volumetric path tracer.
//!
//! A path flies freely through the smoke (delta tracking), scatters at smoke and surfaces, and at every scattering asks
//! one light for a direct connection. Directions sampled by the light and by the scattering are weighted against each
//! other by the power heuristic (Veach 1997, *Robust Monte Carlo methods for light transport simulation*, §9.2.4), so
//! every light that a path meets by itself counts with the complementary weight. What smoke itself gives off is collected
//! along every flight.

use crate::geometry::embree::{Hit, Ray, TraceScene};
use crate::math::space::{UnitVec3, WorldPoint};
use crate::render::color::Rgb;
use crate::render::film::{Contribution, PathCounts};
use crate::render::glow::collected;
use crate::render::light::{Light, LightSample};
use crate::render::material::{Bsdf, Material};
use crate::render::medium::Medium;
use crate::render::sampler::{Dimension, Sampler};
use crate::render::tracking::{Event, estimate_transmittance, sample_collision};
use glam::Vec3;

/// How far before a surface smoke ends, relative to the coordinates involved: some rounding errors of a point on a ray.
const CLEARANCE: f32 = 16.0 * f32::EPSILON;

/// Everything that light meets, but for the smoke, which changes from frame to frame.
pub struct World {
    /// Surfaces.
    pub surfaces: TraceScene,
    /// Material of each shape, by shape index.
    pub materials: Vec<Material>,
    /// Light sources.
    pub lights: Vec<Light>,
    /// Running sums of the probability of choosing each light for a direct connection.
    choice: Vec<f32>,
}

/// When paths end without having left the scene.
#[derive(Debug, Clone, Copy)]
pub struct PathLimits {
    /// Scatterings after which a path is cut; the only bias there is, and counted.
    pub max_bounces: u32,
    /// Scatterings before Russian roulette may end a path.
    pub roulette_from: u32,
}

/// Traces paths through a world filled with smoke.
pub struct Integrator<'a> {
    /// Surfaces and lights.
    pub world: &'a World,
    /// The smoke, if any.
    pub medium: Option<&'a Medium>,
    /// When paths end.
    pub limits: PathLimits,
}

/// A place where light changes direction.
enum Vertex<'a> {
    Smoke { point: WorldPoint, medium: &'a Medium, before: UnitVec3 },
    Surface { hit: Hit, before: UnitVec3, normal: UnitVec3, bsdf: Bsdf },
}

/// A direction to go on along, with its density [1/sr] and the throughput's factor.
struct Scattering {
    direction: UnitVec3,
    pdf: f32,
    weight: Rgb,
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
        Self { surfaces, materials, lights, choice }
    }

    /// The light chosen by the uniform number `u`.
    fn choose_light(&self, u: f32) -> Option<usize> {
        let last = *self.choice.last()?;
        (last > 0.0).then(|| self.choice.partition_point(|&c| c <= u * last).min(self.choice.len() - 1))
    }

    /// Probability of choosing light `i`.
    fn pmf(&self, i: usize) -> f32 {
        self.choice[i] - if i == 0 { 0.0 } else { self.choice[i - 1] }
    }

    /// The nearest light that the ray meets before `t_max`, its density times its probability.
    fn nearest_light(&self, ray: &Ray, t_max: f32) -> Option<(f32, Rgb, f32)> {
        let hits = self.lights.iter().enumerate().filter_map(|(i, light)| Some((i, light.intersect(ray)?)));
        hits.filter(|(_, hit)| hit.t < t_max)
            .min_by(|a, b| a.1.t.total_cmp(&b.1.t))
            .map(|(i, hit)| (hit.t, hit.radiance, hit.pdf * self.pmf(i)))
    }

    /// Whether a surface or a light other than number `target` is in the way.
    fn is_blocked(&self, ray: &Ray, t_max: f32, target: usize) -> bool {
        let behind_light =
            |(i, light): (usize, &Light)| i != target && light.intersect(ray).is_some_and(|h| h.t < t_max);
        self.surfaces.is_occluded(ray, 0.0, t_max) || self.lights.iter().enumerate().any(behind_light)
    }
}

impl<'a> Integrator<'a> {
    /// Traces one path backwards from the camera along `ray`.
    pub fn trace(&self, mut ray: Ray, sampler: &mut Sampler, counts: &mut PathCounts) -> Contribution {
        let mut contribution = Contribution::default();
        let mut throughput = Vec3::ONE;
        // Density of the direction the path follows; None where no light was asked, as at the camera.
        let mut direction_pdf: Option<f32> = None;
        counts.traced += 1;
        for bounce in 0.. {
            let numbers = sampler.numbers(Dimension::Flight, bounce);
            let hit = self.world.surfaces.intersect(&ray, 0.0, f32::INFINITY);
            let surface_t = hit.as_ref().map_or(f32::INFINITY, |h| h.t);
            let light = self.world.nearest_light(&ray, surface_t);
            let t_max = light.map_or(surface_t, |(t, ..)| t);
            let (vertex, end) = self.fly(&ray, t_max, numbers[0], sampler);
            if let Some(medium) = self.medium.filter(|medium| medium.emission != Vec3::ZERO) {
                // No light of the direct connections either.
                contribution.radiance += throughput * collected(medium, &ray, end);
            }
            let vertex = match vertex {
                Some(vertex) => vertex,
                None => match (light, hit) {
                    (Some((_, radiance, light_pdf)), _) => {
                        contribution.radiance += throughput * radiance * met_weight(direction_pdf, light_pdf);
                        contribution.alpha = 1.0;
                        return contribution;
                    }
                    (None, Some(hit)) => {
                        let point = self.world.materials[hit.shape_idx as usize].at(hit.position, hit.shading_normal);
                        // No light of the direct connections, so that every path that meets it counts in full.
                        contribution.radiance += throughput * point.emitted;
                        self.surface_vertex(hit, ray.direction, point.bsdf)
                    }
                    (None, None) => {
                        self.add_background(&ray, throughput, direction_pdf, bounce == 0, &mut contribution);
                        return contribution;
                    }
                },
            };
            if bounce == 0 {
                vertex.describe(&mut contribution);
            }
            contribution.alpha = 1.0;
            if bounce >= self.limits.max_bounces {
                counts.truncated += 1;
                counts.truncated_throughput += f64::from(throughput.max_element());
                return contribution;
            }
            counts.bounces += 1;
            contribution.radiance += throughput * self.direct_light(&vertex, bounce, sampler);
            let u = sampler.numbers(Dimension::Direction, bounce);
            let scattering = vertex.sample([u[0], u[1]]);
            throughput *= scattering.weight;
            if bounce >= self.limits.roulette_from {
                let survival = throughput.max_element();
                if survival < 1.0 {
                    if numbers[1] >= survival {
                        return contribution;
                    }
                    throughput /= survival;
                }
            }
            if throughput == Vec3::ZERO {
                return contribution;
            }
            direction_pdf = Some(scattering.pdf);
            ray = Ray { origin: vertex.leave(scattering.direction), direction: scattering.direction };
        }
        unreachable!("the loop ends by returning")
    }

    /// The place where the ray meets smoke before `t_max`, if it does, and the distance at which its flight ends [m].
    fn fly(&self, ray: &Ray, t_max: f32, u: f32, sampler: &mut Sampler) -> (Option<Vertex<'a>>, f32) {
        let Some(medium) = self.medium else { return (None, t_max) };
        // A collision that rounding moves behind the surface would be caught inside the solid for good.
        let t_max = t_max * (1.0 - CLEARANCE) - CLEARANCE * ray.origin.0.abs().max_element();
        match sample_collision(medium, ray, t_max, u, sampler.stream()) {
            Event::Collision { t } => (Some(Vertex::Smoke { point: ray.at(t), medium, before: ray.direction }), t),
            Event::Escape => (None, t_max),
        }
    }

    fn surface_vertex(&self, hit: Hit, before: UnitVec3, bsdf: Bsdf) -> Vertex<'a> {
        // Materials act alike on both sides: look at the surface from the side the path came from.
        let is_front = hit.normal.dot(*before) < 0.0;
        let shading = if is_front { hit.shading_normal } else { -hit.shading_normal };
        Vertex::Surface { hit, before, normal: shading, bsdf }
    }

    fn add_background(&self, ray: &Ray, throughput: Rgb, pdf: Option<f32>, is_camera: bool, out: &mut Contribution) {
        for (i, light) in self.world.lights.iter().enumerate() {
            let Light::Environment(environment) = light else { continue };
            if is_camera && !environment.is_visible {
                continue;
            }
            let pmf = self.world.pmf(i);
            let light_pdf = if pmf > 0.0 { pmf * environment.pdf(ray.direction) } else { 0.0 };
            out.radiance += throughput * environment.radiance(ray.direction) * met_weight(pdf, light_pdf);
            out.alpha = 1.0;
        }
    }

    /// Light that reaches the vertex straight from one light, and is scattered back along the path.
    fn direct_light(&self, vertex: &Vertex, bounce: u32, sampler: &mut Sampler) -> Rgb {
        let u = sampler.numbers(Dimension::Light, bounce);
        let Some(target) = self.world.choose_light(u[0]) else { return Vec3::ZERO };
        let pmf = self.world.pmf(target);
        let Some(sample) = self.world.lights[target].sample(vertex.point(), [u[1], u[2]]) else { return Vec3::ZERO };
        let mis = sample.pdf.map_or(1.0, |pdf| power_weight(pdf * pmf, vertex.pdf(sample.direction)));
        let unshadowed = vertex.value(sample.direction) * sample.weight * (mis / pmf);
        if unshadowed.max_element() <= 0.0 {
            return Vec3::ZERO;
        }
        unshadowed * self.transmittance_to(vertex, &sample, target, sampler)
    }

    fn transmittance_to(&self, vertex: &Vertex, sample: &LightSample, target: usize, sampler: &mut Sampler) -> f32 {
        let ray = Ray { origin: vertex.leave(sample.direction), direction: sample.direction };
        // Stop short of the light itself.
        let t_max = sample.distance * (1.0 - 1e-4);
        if self.world.is_blocked(&ray, t_max, target) {
            return 0.0;
        }
        self.medium.map_or(1.0, |medium| estimate_transmittance(medium, &ray, sample.distance, sampler.stream()))
    }
}

impl Vertex<'_> {
    fn point(&self) -> WorldPoint {
        match self {
            Vertex::Smoke { point, .. } => *point,
            Vertex::Surface { hit, .. } => hit.position,
        }
    }

    /// Where a ray starts that leaves along `direction`.
    fn leave(&self, direction: UnitVec3) -> WorldPoint {
        match self {
            Vertex::Smoke { point, .. } => *point,
            Vertex::Surface { hit, .. } => hit.offset_origin(direction),
        }
    }

    /// Scattering towards `direction`: albedo times phase function [1/sr], or scattering function times cosine.
    fn value(&self, direction: UnitVec3) -> Rgb {
        match self {
            Vertex::Smoke { medium, before, .. } => medium.albedo * medium.phase.value(*before, direction),
            Vertex::Surface { hit, before, normal, bsdf } => {
                // Shading normals must not let light through the surface.
                let same_side = hit.normal.dot(*direction) * hit.normal.dot(**before) < 0.0;
                if same_side { bsdf.value(*normal, direction) } else { Vec3::ZERO }
            }
        }
    }

    fn pdf(&self, direction: UnitVec3) -> f32 {
        match self {
            Vertex::Smoke { medium, before, .. } => medium.phase.value(*before, direction),
            Vertex::Surface { normal, bsdf, .. } => bsdf.pdf(*normal, direction),
        }
    }

    fn sample(&self, u: [f32; 2]) -> Scattering {
        match self {
            Vertex::Smoke { medium, before, .. } => {
                let s = medium.phase.sample(*before, u);
                Scattering { direction: s.direction, pdf: s.pdf, weight: medium.albedo }
            }
            Vertex::Surface { hit, before, normal, bsdf } => {
                let s = bsdf.sample(*normal, u);
                let same_side = hit.normal.dot(*s.direction) * hit.normal.dot(**before) < 0.0;
                let weight = if same_side { s.weight } else { Vec3::ZERO };
                Scattering { direction: s.direction, pdf: s.pdf, weight }
            }
        }
    }

    /// Notes the first event for the further layers.
    fn describe(&self, out: &mut Contribution) {
        match self {
            Vertex::Smoke { medium, .. } => out.albedo = medium.albedo,
            Vertex::Surface { normal, bsdf, .. } => {
                out.normal = normal.as_vec3();
                out.albedo = bsdf.albedo();
            }
        }
    }
}

/// Weight of a light met by a path whose direction had density `direction_pdf`, when the light itself would have been
/// sampled there with `light_pdf` [1/sr].
fn met_weight(direction_pdf: Option<f32>, light_pdf: f32) -> f32 {
    direction_pdf.map_or(1.0, |pdf| power_weight(pdf, light_pdf))
}

/// The power heuristic with exponent 2: the weight of a sample of density `own` against another way of density `other`.
fn power_weight(own: f32, other: f32) -> f32 {
    if own <= 0.0 {
        return 0.0;
    }
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weights_of_both_ways_add_to_one() {
        for (a, b) in [(1.0, 1.0), (0.1, 7.0), (1e-20, 1e20), (3.0, 0.0)] {
            assert!((power_weight(a, b) + power_weight(b, a) - 1.0f32).abs() < 1e-6, "{a} {b}");
        }
    }
}
