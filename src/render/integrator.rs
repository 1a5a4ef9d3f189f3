//! The volumetric path tracer.
//!
//! A path flies freely through the smoke (delta tracking), scatters at smoke and surfaces, and at every scattering asks
//! one light for a direct connection. Directions sampled by the light and by the scattering are weighted against each
//! other by the power heuristic (Veach 1997, *Robust Monte Carlo methods for light transport simulation*, §9.2.4), so
//! every light that a path meets by itself counts with the complementary weight. Flights near lamps are lit at one more
//! distance, see `equiangular.rs`; where that could have found the same connection, it is one more density to be weighted
//! against. What smoke itself gives off is collected along every flight.

use crate::geometry::embree::{Hit, Ray};
use crate::geometry::moment::Moment;
use crate::math::space::{UnitVec3, WorldPoint};
use crate::render::bsdf::microfacet::bent;
use crate::render::catcher::Caught;
use crate::render::chroma::Chroma;
use crate::render::color::Rgb;
use crate::render::equiangular::Nearby;
use crate::render::film::{Contribution, PathCounts};
use crate::render::light::{Light, LightSample};
use crate::render::light_path::{EMISSION_GROUP, FirstEvent, Passage};
use crate::render::material::{Sight, SurfacePoint};
use crate::render::media::Media;
use crate::render::medium::Matter;
use crate::render::sampler::{Dimension, Sampler};
use crate::render::sun_shadow::SunShadows;
use crate::render::vertex::Vertex;
use crate::render::world::World;
use glam::Vec3;

/// How far before a surface smoke ends, relative to the coordinates involved: some rounding errors of a point on a ray.
const CLEARANCE: f32 = 16.0 * f32::EPSILON;

/// Throughput below which roulette may end a path; one that goes on has as much again. In a plume of albedo 0.9, roulette
/// from throughput 1 on doubles the variance and saves a fifth of the time; from 0.1 on it costs nothing.
const WORTH_FOLLOWING: f32 = 0.1;

/// When paths end without having left the scene.
#[derive(Debug, Clone, Copy)]
pub struct PathLimits {
    /// Scatterings after which a path is cut; the only bias there is, and counted.
    pub max_bounces: u32,
    /// Scatterings before Russian roulette may end a path.
    pub roulette_from: u32,
}

/// Traces paths through a world filled with smoke.
#[derive(Clone, Copy)]
pub struct Integrator<'a> {
    /// Surfaces and lights.
    pub world: &'a World,
    /// What light flies through.
    pub media: Media<'a>,
    /// What the media do to light of suns.
    pub sun_shadows: &'a SunShadows,
    /// When paths end.
    pub limits: PathLimits,
    /// Where shapes are that move while the shutter is open; by default all are where they are at the frame.
    pub moment: Moment<'a>,
}

impl<'a> Integrator<'a> {
    /// The same at a moment.
    #[inline]
    pub fn at(&self, moment: Moment<'a>) -> Self {
        Self { moment, media: self.media.at(moment), ..*self }
    }

    /// Traces one path backwards from the camera along `ray`.
    pub fn trace(&self, ray: Ray, sampler: &mut Sampler, counts: &mut PathCounts) -> Contribution {
        let mut contribution = Contribution::default();
        self.trace_into(&mut contribution, ray, sampler, counts);
        contribution
    }

    /// As [`Integrator::trace`], into a contribution that is clear.
    pub fn trace_into(
        &self,
        contribution: &mut Contribution,
        ray: Ray,
        sampler: &mut Sampler,
        counts: &mut PathCounts,
    ) {
        let mut catcher = None;
        self.trace_path(contribution, ray, sampler, counts, &mut catcher);
        if let Some(caught) = catcher {
            caught.out_of(contribution);
        }
    }

    fn trace_path(
        &self,
        contribution: &mut Contribution,
        mut ray: Ray,
        sampler: &mut Sampler,
        counts: &mut PathCounts,
        catcher: &mut Option<Caught>,
    ) {
        let mut throughput = Vec3::ONE;
        // Square of the index of refraction where the path is.
        let mut eta_sq = 1.0;
        // Density of the direction the path follows; None where no light was asked, as at the camera, or none could have
        // answered, as at a mirror.
        let mut direction_pdf: Option<f32> = None;
        let mut asked = Asked { point: ray.origin, flight: None };
        counts.traced += 1;
        let mut chroma: Option<Chroma> = None;
        for bounce in 0.. {
            let numbers = sampler.numbers(Dimension::Event, bounce);
            if bounce == 0 {
                chroma =
                    self.media.tint().map(|ratios| Chroma::new(ratios, sampler.numbers(Dimension::Hero, bounce)[0]));
            }
            // In smoke a flight mostly ends before anything else could be met, and what is near is found sooner. Where a
            // colour or lamps are concerned, the way to the surface counts itself.
            let flies_first = bounce > 0 && chroma.is_none() && self.world.lamps().is_empty();
            let flown = flies_first.then(|| self.fly(&ray, f32::INFINITY, numbers[3], sampler, None));
            let reach = flown.as_ref().map_or(f32::INFINITY, |(_, end)| beyond(*end, &ray));
            let hit = match bounce {
                0 => self.world.seen_by_camera(&ray, self.moment),
                _ => self.world.surfaces.intersect_at(&ray, 0.0, reach, self.moment),
            };
            let surface_t = hit.as_ref().map_or(f32::INFINITY, |h| h.t);
            let light = self.world.nearest_light(&ray, surface_t.min(reach), bounce == 0);
            let t_max = light.as_ref().map_or(surface_t, |met| met.t);
            let (matter, end) = match flown {
                Some((matter, end)) if end < short_of(t_max, &ray) => (matter, end),
                Some(_) => (None, t_max),
                None => self.fly(&ray, t_max, numbers[3], sampler, chroma.as_mut()),
            };
            // What light from here on counts.
            let carried = chroma.as_ref().map_or(throughput, |chroma| throughput * chroma.weight());
            let nearby = self.nearby(&ray, t_max, bounce);
            if let Some(nearby) = &nearby
                && let Some((i, light)) = self.nearby_light(nearby, &ray, carried, bounce, sampler)
            {
                let first = if bounce == 0 { FirstEvent::Smoke } else { contribution.first };
                contribution.add(light, Passage::scattered(first, bounce + 1), self.world.groups[i]);
            }
            if self.media.glows() {
                // No light of the direct connections either.
                let light = self.media.collected(&ray, end, sampler.stream());
                contribution.add_scattered(carried * light, bounce, EMISSION_GROUP);
            }
            let vertex = match matter {
                Some(matter) => Vertex::Smoke { point: ray.at(end), matter, before: ray.direction },
                None => match (light, hit) {
                    (Some(met), _) => {
                        let light_pdf = met.pdf * asked.density(self.world, met.light_idx);
                        let light = carried * met.radiance * met_weight(direction_pdf, light_pdf);
                        contribution.add_scattered(light, bounce, self.world.groups[met.light_idx]);
                        contribution.is_covered = true;
                        return;
                    }
                    (None, Some(hit)) => {
                        let material = &self.world.materials[hit.shape_idx as usize];
                        let is_front = hit.normal.dot(*ray.direction) < 0.0;
                        let (place, normal) = self.moment.at_rest(&hit);
                        let point = material.seen(place, normal, is_front);
                        match material.sight {
                            Sight::Hole if bounce == 0 => return,
                            Sight::Shadow if bounce == 0 => {
                                *catcher = Some(Caught::new(*contribution, carried * point.emitted));
                            }
                            _ => {}
                        }
                        // Textured light is none of the direct connections, so that every path that meets it counts in full.
                        let weight = match self.world.surface_light(&hit, asked.point, ray.direction, self.moment) {
                            Some((i, pdf)) if direction_pdf.is_some() => {
                                met_weight(direction_pdf, pdf * asked.density(self.world, i))
                            }
                            _ => 1.0,
                        };
                        contribution.add_scattered(carried * point.emitted * weight, bounce, EMISSION_GROUP);
                        surface_vertex(hit, ray.direction, &point)
                    }
                    (None, None) => {
                        self.add_background(&ray, carried, direction_pdf, &asked, bounce, contribution);
                        return;
                    }
                },
            };
            if bounce == 0 {
                vertex.describe(contribution);
            }
            contribution.is_covered = true;
            if bounce >= self.limits.max_bounces {
                counts.truncated += 1;
                counts.truncated_throughput += f64::from(carried.max_element());
                return;
            }
            counts.bounces += 1;
            contribution.bounces += 1;
            asked = Asked::at(&vertex, self.media, nearby, &ray, end);
            self.add_direct_light(&vertex, carried, &asked, bounce, sampler, contribution);
            if let Some(caught) = catcher.as_mut().filter(|_| bounce == 0) {
                caught.add_unshadowed(carried * self.direct_light_unshadowed(&vertex, &asked, bounce, sampler));
            }
            let Some(scattering) = vertex.sample([numbers[0], numbers[1], numbers[2]]) else { return };
            throughput *= scattering.weight;
            eta_sq *= scattering.eta_sq;
            let next = Ray { origin: vertex.leave(scattering.direction), direction: scattering.direction };
            if let Some(caught) = catcher.as_mut().filter(|_| bounce == 0) {
                let reflected = carried * scattering.weight;
                caught.add_unshadowed(self.met_unshadowed(&next, reflected, scattering.pdf, &asked));
            }
            if bounce >= self.limits.roulette_from {
                // Inside glass, throughput is small only because radiance is large there.
                let survival = (carried * scattering.weight).max_element() * eta_sq / WORTH_FOLLOWING;
                if survival < 1.0 {
                    if sampler.stream().uniform() >= survival {
                        return;
                    }
                    throughput /= survival;
                }
            }
            if throughput == Vec3::ZERO {
                return;
            }
            direction_pdf = scattering.pdf;
            ray = next;
        }
        unreachable!("the loop ends by returning")
    }

    /// What the ray meets before `t_max`, if it meets smoke, and the distance at which its flight ends [m].
    #[inline(always)]
    fn fly(
        &self,
        ray: &Ray,
        t_max: f32,
        u: f32,
        sampler: &mut Sampler,
        chroma: Option<&mut Chroma>,
    ) -> (Option<Matter>, f32) {
        if self.media.is_empty() {
            return (None, t_max);
        }
        match self.media.first_collision(ray, short_of(t_max, ray), u, sampler.stream(), chroma) {
            Some((t, matter)) => (Some(matter), t),
            None => (None, t_max),
        }
    }

    fn add_background(
        &self,
        ray: &Ray,
        throughput: Rgb,
        pdf: Option<f32>,
        asked: &Asked,
        bounce: u32,
        out: &mut Contribution,
    ) {
        for (i, light) in self.world.lights.iter().enumerate() {
            let Some(radiance) = light.beyond(ray, bounce == 0) else { continue };
            let density = if pdf.is_some() { asked.density(self.world, i) } else { 0.0 };
            let light_pdf = if density > 0.0 { density * light.pdf_beyond(ray.direction) } else { 0.0 };
            let passage = if bounce == 0 { Passage::Background } else { Passage::scattered(out.first, bounce) };
            out.add(throughput * radiance * met_weight(pdf, light_pdf), passage, self.world.groups[i]);
            out.is_covered = true;
        }
    }

    /// Light that reaches the vertex straight from one light, and is scattered back along the path.
    fn add_direct_light(
        &self,
        vertex: &Vertex,
        throughput: Rgb,
        asked: &Asked,
        bounce: u32,
        sampler: &mut Sampler,
        out: &mut Contribution,
    ) {
        let Some((sample, target, factor)) = self.ask(vertex, asked, bounce, sampler) else { return };
        let light = self.connection(vertex, &sample, target, throughput * factor, sampler);
        out.add_scattered(light, bounce + 1, self.world.groups[target]);
    }

    /// One light, as seen from the vertex: which, and what a connection counts.
    fn ask(
        &self,
        vertex: &Vertex,
        asked: &Asked,
        bounce: u32,
        sampler: &mut Sampler,
    ) -> Option<(LightSample, usize, f32)> {
        let u = if self.world.asks_by_chance { sampler.numbers(Dimension::Light, bounce) } else { [0.5; 4] };
        let (target, pmf) = self.world.choose_light(asked.point, u[0])?;
        let sample = self.world.sample_light(target, vertex.point(), [u[1], u[2]], self.moment)?;
        let mis = connection_weight(vertex, &sample, pmf, asked.nearby_density(target));
        Some((sample, target, mis / pmf))
    }

    /// As the direct light of the same numbers, had shapes and smoke no shadow, but for other shadow catchers; shapes that
    /// shine are shapes.
    fn direct_light_unshadowed(&self, vertex: &Vertex, asked: &Asked, bounce: u32, sampler: &mut Sampler) -> Rgb {
        let Some((sample, target, factor)) = self.ask(vertex, asked, bounce, sampler) else { return Vec3::ZERO };
        let ray = Ray { origin: vertex.leave(sample.direction), direction: sample.direction };
        let t_max = sample.distance * (1.0 - 1e-4);
        let is_blocked = matches!(self.world.lights[target], Light::Surface(_))
            || self.world.nearest_catcher(&ray, t_max, self.moment).is_some()
            || self.world.is_behind_light(&ray, t_max, target);
        if is_blocked { Vec3::ZERO } else { vertex.value(sample.direction) * sample.weight * factor }
    }

    /// Light that a path meets by itself were there nothing but lights and shadow catchers.
    fn met_unshadowed(&self, ray: &Ray, throughput: Rgb, direction_pdf: Option<f32>, asked: &Asked) -> Rgb {
        let catcher = self.world.nearest_catcher(ray, f32::INFINITY, self.moment);
        let t_max = catcher.map_or(f32::INFINITY, |hit| hit.t);
        if let Some(met) = self.world.nearest_light(ray, t_max, false) {
            let light_pdf = met.pdf * asked.density(self.world, met.light_idx);
            return throughput * met.radiance * met_weight(direction_pdf, light_pdf);
        }
        let mut met = Contribution::default();
        if catcher.is_none() {
            // As light that was scattered once: lights that the camera does not see shine too.
            self.add_background(ray, throughput, direction_pdf, asked, 1, &mut met);
        }
        met.radiance
    }

    /// The lamps near a flight through smoke.
    fn nearby(&self, ray: &Ray, t_max: f32, bounce: u32) -> Option<Nearby<'a>> {
        if self.world.lamps().is_empty() {
            return None;
        }
        if bounce >= self.limits.max_bounces || !self.media.has_flight_density() {
            return None;
        }
        Nearby::find(&self.world.lights, self.world.lamps(), self.media, ray, t_max, bounce)
    }

    /// Light of one of the lamps near a flight that is scattered once on the way, from a distance taken for that lamp.
    fn nearby_light(
        &self,
        nearby: &Nearby,
        ray: &Ray,
        throughput: Rgb,
        bounce: u32,
        sampler: &mut Sampler,
    ) -> Option<(usize, Rgb)> {
        let u = sampler.numbers(Dimension::Distance, bounce);
        let place = nearby.sample(self.world.lamps(), [u[0], u[1]])?;
        let flight = self.media.flight_density(ray, place.t);
        if flight <= 0.0 || place.density <= 0.0 {
            return None;
        }
        // Where volumes overlap, both ways of finding this place choose between them by their extinctions.
        let matter = self.media.met_at(ray, place.t, sampler.stream())?;
        let vertex = Vertex::Smoke { point: ray.at(place.t), matter, before: ray.direction };
        let sample = self.world.sample_light(place.light_idx, vertex.point(), [u[2], u[3]], self.moment)?;
        // Against free flight to the same place, which then asks the same light.
        let pmf = self.world.pmf(vertex.point(), place.light_idx);
        let mis = connection_weight(&vertex, &sample, place.density / flight, pmf);
        let factor = mis * flight / place.density;
        Some((place.light_idx, self.connection(&vertex, &sample, place.light_idx, throughput * factor, sampler)))
    }

    /// What a connection brings that counts `weight`.
    fn connection(
        &self,
        vertex: &Vertex,
        sample: &LightSample,
        target: usize,
        weight: Rgb,
        sampler: &mut Sampler,
    ) -> Rgb {
        let reflected = vertex.value(sample.direction) * weight;
        if reflected.max_element() <= 0.0 {
            return Vec3::ZERO;
        }
        let ray = Ray { origin: vertex.leave(sample.direction), direction: sample.direction };
        // Deep in thick smoke the shadow is known to be full before anything else is asked.
        let shadows = self.sun_shadows.towards(target, reflected.max_element());
        let mut transmittance = Vec3::ONE;
        if !shadows.is_empty() {
            transmittance = self.media.transmittance(&ray, sample.distance, shadows, sampler.stream());
            if transmittance == Vec3::ZERO {
                return Vec3::ZERO;
            }
        }
        // Stop short of the light itself.
        let t_max = sample.distance * (1.0 - 1e-4);
        if self.world.is_blocked(&ray, t_max, target, self.moment) {
            return Vec3::ZERO;
        }
        if shadows.is_empty() {
            transmittance = self.media.transmittance(&ray, sample.distance, shadows, sampler.stream());
        }
        reflected * sample.weight * transmittance
    }
}

/// Where smoke ends before a surface at distance `t` [m]: a collision that rounding moves behind the surface would be caught
/// inside the solid for good.
#[inline]
fn short_of(t: f32, ray: &Ray) -> f32 {
    t * (1.0 - CLEARANCE) - CLEARANCE * ray.origin.0.abs().max_element()
}

/// How far surfaces may be that a collision at distance `t` [m] is not short of.
#[inline]
fn beyond(t: f32, ray: &Ray) -> f32 {
    t * (1.0 + 2.0 * CLEARANCE) + 2.0 * CLEARANCE * ray.origin.0.abs().max_element()
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

/// Where a path was when it last asked a light, and what else could have found a connection there.
struct Asked<'a> {
    point: WorldPoint,
    /// Lamps near the flight that ended there, its distance and the density of free flight for it.
    flight: Option<(Nearby<'a>, f32, f32)>,
}

impl<'a> Asked<'a> {
    fn at(vertex: &Vertex, media: Media, nearby: Option<Nearby<'a>>, ray: &Ray, t: f32) -> Self {
        // A distance finds smoke, never a surface.
        let nearby = nearby.filter(|_| matches!(vertex, Vertex::Smoke { .. }));
        let flight = nearby.map(|nearby| (nearby, t, media.flight_density(ray, t)));
        Self { point: vertex.point(), flight }
    }

    /// How much more often than free flight and a chosen light a distance taken for light `i` finds this place, times the
    /// probability of that light.
    fn nearby_density(&self, i: usize) -> f32 {
        let Some((nearby, t, flight)) = &self.flight else { return 0.0 };
        // Smoke that was met has a density; one that rounds to 0 is found by nothing else.
        if *flight > 0.0 { nearby.density(i, *t) / flight } else { 0.0 }
    }

    /// Probability with which light `i` is asked, of both ways: the root of the sum of squares, as the power heuristic
    /// weighs them.
    fn density(&self, world: &World, i: usize) -> f32 {
        let pmf = world.pmf(self.point, i);
        match self.nearby_density(i) {
            0.0 => pmf,
            other => pmf.hypot(other),
        }
    }
}

/// Weight of a connection found by asking a light with probability `own`, when another way asks it with `other`, and when
/// the path may meet the light by chance.
fn connection_weight(vertex: &Vertex, sample: &LightSample, own: f32, other: f32) -> f32 {
    let (own, by_chance) = match sample.pdf {
        Some(pdf) => (own * pdf, vertex.pdf(sample.direction)),
        None => (own, 0.0),
    };
    let other = other * sample.pdf.unwrap_or(1.0);
    power_weight(own, if other > 0.0 { other.hypot(by_chance) } else { by_chance })
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
