//! The volumetric path tracer.
//!
//! A path flies freely through the smoke (delta tracking), scatters at smoke and surfaces, and at every scattering asks
//! one light for a direct connection. Directions sampled by the light and by the scattering are weighted against each
//! other by the power heuristic (Veach 1997, *Robust Monte Carlo methods for light transport simulation*, §9.2.4), so
//! every light that a path meets by itself counts with the complementary weight. What smoke itself gives off is collected
//! along every flight.

use crate::geometry::embree::{Hit, Ray};
use crate::math::space::UnitVec3;
use crate::render::bsdf::microfacet::bent;
use crate::render::catcher::Caught;
use crate::render::chroma::Chroma;
use crate::render::color::Rgb;
use crate::render::film::{Contribution, PathCounts};
use crate::render::glow::collected;
use crate::render::light::{Light, LightSample};
use crate::render::light_path::{EMISSION_GROUP, Passage};
use crate::render::material::{Sight, SurfacePoint};
use crate::render::medium::Medium;
use crate::render::sampler::{Dimension, Sampler};
use crate::render::tracking::{Event, estimate_tinted_transmittance, estimate_transmittance, sample_collision};
use crate::render::vertex::Vertex;
use crate::render::world::World;
use glam::Vec3;

/// How far before a surface smoke ends, relative to the coordinates involved: some rounding errors of a point on a ray.
const CLEARANCE: f32 = 16.0 * f32::EPSILON;

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

impl<'a> Integrator<'a> {
    /// Traces one path backwards from the camera along `ray`.
    pub fn trace(&self, ray: Ray, sampler: &mut Sampler, counts: &mut PathCounts) -> Contribution {
        let mut catcher = None;
        let contribution = self.trace_path(ray, sampler, counts, &mut catcher);
        catcher.map_or(contribution, |caught: Caught| caught.out_of(contribution))
    }

    fn trace_path(
        &self,
        mut ray: Ray,
        sampler: &mut Sampler,
        counts: &mut PathCounts,
        catcher: &mut Option<Caught>,
    ) -> Contribution {
        let mut contribution = Contribution::default();
        let mut throughput = Vec3::ONE;
        // Square of the index of refraction where the path is.
        let mut eta_sq = 1.0;
        // Density of the direction the path follows; None where no light was asked, as at the camera, or none could have
        // answered, as at a mirror.
        let mut direction_pdf: Option<f32> = None;
        counts.traced += 1;
        let mut chroma: Option<Chroma> = None;
        for bounce in 0.. {
            let numbers = sampler.numbers(Dimension::Flight, bounce);
            if bounce == 0 {
                let tint = self.medium.and_then(|medium| medium.tint);
                chroma = tint.map(|ratios| Chroma::new(ratios, numbers[2]));
            }
            let hit = match bounce {
                0 => self.world.seen_by_camera(&ray),
                _ => self.world.surfaces.intersect(&ray, 0.0, f32::INFINITY),
            };
            let surface_t = hit.as_ref().map_or(f32::INFINITY, |h| h.t);
            let light = self.world.nearest_light(&ray, surface_t);
            let t_max = light.as_ref().map_or(surface_t, |met| met.t);
            let (vertex, end) = self.fly(&ray, t_max, numbers[0], sampler, chroma.as_mut());
            // What light from here on counts.
            let carried = chroma.as_ref().map_or(throughput, |chroma| throughput * chroma.weight());
            if let Some(medium) = self.medium.filter(|medium| medium.glows()) {
                // No light of the direct connections either.
                contribution.add_scattered(carried * collected(medium, &ray, end), bounce, EMISSION_GROUP);
            }
            let vertex = match vertex {
                Some(vertex) => vertex,
                None => match (light, hit) {
                    (Some(met), _) => {
                        let light = carried * met.radiance * met_weight(direction_pdf, met.pdf);
                        contribution.add_scattered(light, bounce, self.world.groups[met.light]);
                        contribution.alpha = 1.0;
                        return contribution;
                    }
                    (None, Some(hit)) => {
                        let material = &self.world.materials[hit.shape_idx as usize];
                        let is_front = hit.normal.dot(*ray.direction) < 0.0;
                        let point = material.seen(hit.position, hit.shading_normal, is_front);
                        match material.sight {
                            Sight::Hole if bounce == 0 => return contribution,
                            Sight::Shadow if bounce == 0 => {
                                *catcher = Some(Caught::new(contribution, carried * point.emitted));
                            }
                            _ => {}
                        }
                        // No light of the direct connections, so that every path that meets it counts in full.
                        contribution.add_scattered(carried * point.emitted, bounce, EMISSION_GROUP);
                        surface_vertex(hit, ray.direction, &point)
                    }
                    (None, None) => {
                        self.add_background(&ray, carried, direction_pdf, bounce, &mut contribution);
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
                counts.truncated_throughput += f64::from(carried.max_element());
                return contribution;
            }
            counts.bounces += 1;
            contribution.bounces += 1;
            self.add_direct_light(&vertex, carried, bounce, sampler, &mut contribution);
            if let Some(caught) = catcher.as_mut().filter(|_| bounce == 0) {
                caught.add_unshadowed(carried * self.direct_light_unshadowed(&vertex, bounce, sampler));
            }
            let u = sampler.numbers(Dimension::Direction, bounce);
            let Some(scattering) = vertex.sample([u[0], u[1], u[2]]) else { return contribution };
            throughput *= scattering.weight;
            eta_sq *= scattering.eta_sq;
            let next = Ray { origin: vertex.leave(scattering.direction), direction: scattering.direction };
            if let Some(caught) = catcher.as_mut().filter(|_| bounce == 0) {
                caught.add_unshadowed(self.met_unshadowed(&next, carried * scattering.weight, scattering.pdf));
            }
            if bounce >= self.limits.roulette_from {
                // Inside glass, throughput is small only because radiance is large there.
                let survival = (carried * scattering.weight).max_element() * eta_sq;
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
            direction_pdf = scattering.pdf;
            ray = next;
        }
        unreachable!("the loop ends by returning")
    }

    /// The place where the ray meets smoke before `t_max`, if it does, and the distance at which its flight ends [m].
    fn fly(
        &self,
        ray: &Ray,
        t_max: f32,
        u: f32,
        sampler: &mut Sampler,
        chroma: Option<&mut Chroma>,
    ) -> (Option<Vertex<'a>>, f32) {
        let Some(medium) = self.medium else { return (None, t_max) };
        // A collision that rounding moves behind the surface would be caught inside the solid for good.
        let t_max = t_max * (1.0 - CLEARANCE) - CLEARANCE * ray.origin.0.abs().max_element();
        match sample_collision(medium, ray, t_max, u, sampler.stream(), chroma) {
            Event::Collision { t } => (Some(Vertex::Smoke { point: ray.at(t), medium, before: ray.direction }), t),
            Event::Escape => (None, t_max),
        }
    }

    fn add_background(&self, ray: &Ray, throughput: Rgb, pdf: Option<f32>, bounce: u32, out: &mut Contribution) {
        for (i, light) in self.world.lights.iter().enumerate() {
            let Light::Environment(environment) = light else { continue };
            if bounce == 0 && !environment.is_visible {
                continue;
            }
            let pmf = self.world.pmf(i);
            let light_pdf = if pmf > 0.0 { pmf * environment.pdf(ray.direction) } else { 0.0 };
            let light = throughput * environment.radiance(ray.direction) * met_weight(pdf, light_pdf);
            let passage = if bounce == 0 { Passage::Background } else { Passage::scattered(out.first, bounce) };
            out.add(light, passage, self.world.groups[i]);
            out.alpha = 1.0;
        }
    }

    /// Light that reaches the vertex straight from one light, and is scattered back along the path.
    fn add_direct_light(
        &self,
        vertex: &Vertex,
        throughput: Rgb,
        bounce: u32,
        sampler: &mut Sampler,
        out: &mut Contribution,
    ) {
        let Some((unshadowed, sample, target)) = self.connection(vertex, bounce, sampler) else { return };
        let light = throughput * (unshadowed * self.transmittance_to(vertex, &sample, target, sampler));
        out.add_scattered(light, bounce + 1, self.world.groups[target]);
    }

    /// One light, as seen from the vertex: what would be scattered back along the path were nothing in the way.
    fn connection(&self, vertex: &Vertex, bounce: u32, sampler: &mut Sampler) -> Option<(Rgb, LightSample, usize)> {
        let u = sampler.numbers(Dimension::Light, bounce);
        let target = self.world.choose_light(u[0])?;
        let pmf = self.world.pmf(target);
        let sample = self.world.lights[target].sample(vertex.point(), [u[1], u[2]])?;
        let mis = sample.pdf.map_or(1.0, |pdf| power_weight(pdf * pmf, vertex.pdf(sample.direction)));
        let unshadowed = vertex.value(sample.direction) * sample.weight * (mis / pmf);
        (unshadowed.max_element() > 0.0).then_some((unshadowed, sample, target))
    }

    /// As the direct light of the same numbers, had shapes and smoke no shadow, but for other shadow catchers.
    fn direct_light_unshadowed(&self, vertex: &Vertex, bounce: u32, sampler: &mut Sampler) -> Rgb {
        let Some((unshadowed, sample, target)) = self.connection(vertex, bounce, sampler) else { return Vec3::ZERO };
        let ray = Ray { origin: vertex.leave(sample.direction), direction: sample.direction };
        let t_max = sample.distance * (1.0 - 1e-4);
        let is_blocked = self.world.nearest_catcher(&ray, t_max).is_some();
        if is_blocked || self.world.is_behind_light(&ray, t_max, target) { Vec3::ZERO } else { unshadowed }
    }

    /// Light that a path meets by itself were there nothing but lights and shadow catchers.
    fn met_unshadowed(&self, ray: &Ray, throughput: Rgb, direction_pdf: Option<f32>) -> Rgb {
        let catcher = self.world.nearest_catcher(ray, f32::INFINITY);
        let t_max = catcher.map_or(f32::INFINITY, |hit| hit.t);
        if let Some(met) = self.world.nearest_light(ray, t_max) {
            return throughput * met.radiance * met_weight(direction_pdf, met.pdf);
        }
        let mut met = Contribution::default();
        if catcher.is_none() {
            // As light that was scattered once: lights that the camera does not see shine too.
            self.add_background(ray, throughput, direction_pdf, 1, &mut met);
        }
        met.radiance
    }

    fn transmittance_to(&self, vertex: &Vertex, sample: &LightSample, target: usize, sampler: &mut Sampler) -> Rgb {
        let ray = Ray { origin: vertex.leave(sample.direction), direction: sample.direction };
        // Stop short of the light itself.
        let t_max = sample.distance * (1.0 - 1e-4);
        if self.world.is_blocked(&ray, t_max, target) {
            return Vec3::ZERO;
        }
        let Some(medium) = self.medium else { return Vec3::ONE };
        match medium.tint {
            None => Vec3::splat(estimate_transmittance(medium, &ray, sample.distance, sampler.stream())),
            Some(ratios) => estimate_tinted_transmittance(medium, ratios, &ray, sample.distance, sampler.stream()),
        }
    }
}

fn surface_vertex<'a>(hit: Hit, before: UnitVec3, point: &SurfacePoint<'a>) -> Vertex<'a> {
    // Look at the surface from the side the path came from.
    let is_front = hit.normal.dot(*before) < 0.0;
    let mut normal = if is_front { hit.shading_normal } else { -hit.shading_normal };
    if point.bsdf.is_glossy() {
        normal = bent(if is_front { hit.normal } else { -hit.normal }, normal, -before);
    }
    Vertex::Surface { hit, before, normal, bsdf: point.bsdf }
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
