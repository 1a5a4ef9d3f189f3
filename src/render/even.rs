//! Even matter inside a closed surface: mist in a ball of glass, haze in a room.
//!
//! A ray is inside from where it crosses the surface inwards to where it crosses it outwards. Which way it crosses is told by
//! the side of the surface. Parts of a mesh may overlap: inside is what is inside of one of them, so ways in and out are counted
//! there, first those ahead of the ray, as behind the last of them all is outside. On the pieces inside optical depth is length times extinction, so that flights and transmittances are exact.

use crate::geometry::embree::{Ray, TraceScene};
use crate::render::chroma::Chroma;
use crate::render::color::Rgb;
use crate::render::medium::Matter;
use glam::Vec3;
use std::sync::Arc;

/// Crossings after which a ray counts as outside: an end for rays that rounding holds in a place.
const CROSSINGS_MAX: u32 = 10_000;

/// By how much of its distance a crossing is passed before the next is looked for: some roundings.
const CLEARANCE: f32 = 4.0 * f32::EPSILON;

/// Even matter inside a closed surface.
pub struct EvenMedium {
    /// The surface, alone.
    pub container: Arc<TraceScene>,
    /// Which shape of the scene the surface is, if it may move while a shutter is open.
    pub shape_idx: Option<u32>,
    /// Extinction coefficient [1/m], ≥ 0; of the channel that has most.
    pub sigma_t: f32,
    /// Where extinction has a colour, that of each channel over the largest.
    pub tint: Option<Vec3>,
    /// Light that it gives off [W/(m³ sr)], each channel ≥ 0.
    pub emission: Rgb,
    /// What scatters.
    pub matter: Matter,
}

impl EvenMedium {
    /// The pieces of the ray before `t_max` that are inside: distances from its origin, in order [m].
    pub fn pieces(&self, ray: &Ray, t_max: f32) -> Pieces<'_> {
        let bounds = self.container.bounds();
        let origin = ray.origin.0;
        let may_be_inside = origin.cmpge(bounds.min).all() && origin.cmple(bounds.max).all();
        let is_met = bounds.ray_interval(origin, ray.direction.as_vec3(), 0.0, t_max).is_some();
        // From some roundings on: a ray that starts on the surface does not meet it there, but where it leaves.
        let searched = CLEARANCE * origin.abs().max_element();
        let crossings =
            Crossings { container: &self.container, ray: *ray, searched, left: if is_met { CROSSINGS_MAX } else { 0 } };
        let has_parts = self.container.has_meshes();
        let depth = match (may_be_inside, has_parts) {
            (false, _) => 0,
            (true, true) => crossings.clone().map(|(_, goes_out)| if goes_out { 1 } else { -1 }).sum::<i32>().max(0),
            (true, false) => i32::from(crossings.clone().next().is_some_and(|(_, goes_out)| goes_out)),
        };
        Pieces { crossings, has_parts, passed: 0.0, depth, t_max }
    }

    /// How much of the ray before `t_max` is inside [m].
    pub fn length_inside(&self, ray: &Ray, t_max: f32) -> f64 {
        self.pieces(ray, t_max).map(|[a, b]| f64::from(b) - f64::from(a)).sum()
    }

    /// Extinction coefficient at distance `t` of the ray [1/m], and the optical depth to there.
    pub fn at(&self, ray: &Ray, t: f32) -> (f32, f64) {
        let (mut inside, mut end) = (0.0, -1.0);
        for [a, b] in self.pieces(ray, t) {
            inside += f64::from(b) - f64::from(a);
            end = b;
        }
        (if end >= t { self.sigma_t } else { 0.0 }, inside * f64::from(self.sigma_t))
    }

    /// Samples where light that starts at the ray's origin first meets it before `t_max` [m], from an exponentially distributed
    /// optical distance. `chroma` is as for smoke in grids.
    pub fn sample_collision(&self, ray: &Ray, t_max: f32, tau: f32, chroma: Option<&mut Chroma>) -> Option<f32> {
        let Some(chroma) = chroma else { return self.fly(ray, t_max, f64::from(tau)).ok().map(|(t, _)| t) };
        // The distance counts for the channel that decides; nothing stops a channel without any extinction.
        let ratio = chroma.hero_ratio();
        let left = if ratio > 0.0 { f64::from(tau / ratio) } else { f64::INFINITY };
        match self.fly(ray, t_max, left) {
            Ok((t, tau)) => {
                chroma.pass_exactly(tau as f32);
                chroma.collide();
                Some(t)
            }
            Err(tau) => {
                chroma.pass_exactly(tau as f32);
                None
            }
        }
    }

    /// The distance at which optical depth `tau` is reached [m] and that depth, or else all the depth there is.
    fn fly(&self, ray: &Ray, t_max: f32, tau: f64) -> Result<(f32, f64), f64> {
        let sigma_t = f64::from(self.sigma_t);
        let mut passed = 0.0;
        for [a, b] in self.pieces(ray, t_max) {
            let depth = (f64::from(b) - f64::from(a)) * sigma_t;
            if passed + depth > tau {
                return Ok(((f64::from(a) + (tau - passed) / sigma_t) as f32, tau));
            }
            passed += depth;
        }
        Err(passed)
    }

    /// Share of light that comes through from the ray's origin to distance `t_max` [m].
    pub fn transmittance(&self, ray: &Ray, t_max: f32) -> Rgb {
        let tau = self.length_inside(ray, t_max) * f64::from(self.sigma_t);
        match self.tint {
            None => Vec3::splat((-tau).exp() as f32),
            Some(ratios) => (ratios.as_dvec3() * -tau).exp().as_vec3(),
        }
    }
}

/// Where a ray crosses a surface, in order: distances [m], and whether outwards.
#[derive(Clone)]
struct Crossings<'a> {
    container: &'a TraceScene,
    ray: Ray,
    /// Distance from which on the next crossing is looked for [m].
    searched: f32,
    /// Crossings that are still looked for.
    left: u32,
}

impl Iterator for Crossings<'_> {
    type Item = (f32, bool);

    fn next(&mut self) -> Option<(f32, bool)> {
        self.left = self.left.checked_sub(1)?;
        let hit = self.container.intersect(&self.ray, self.searched, f32::INFINITY)?;
        // On along the same line: a new start beside the surface would be another, and a grazing chord much longer or shorter.
        self.searched = hit.t * (1.0 + CLEARANCE) + f32::MIN_POSITIVE;
        Some((hit.t, hit.normal.dot(*self.ray.direction) > 0.0))
    }
}

/// The pieces of a ray inside a closed surface, in order.
pub struct Pieces<'a> {
    crossings: Crossings<'a>,
    /// Whether the surface may have parts that overlap.
    has_parts: bool,
    /// Distance of the last crossing [m].
    passed: f32,
    /// Parts that the ray is inside of behind it.
    depth: i32,
    t_max: f32,
}

impl Iterator for Pieces<'_> {
    type Item = [f32; 2];

    fn next(&mut self) -> Option<[f32; 2]> {
        while self.passed < self.t_max {
            // Also one beyond `t_max`: without any the rest is outside, whatever rounding has made of the count.
            let (t, goes_out) = self.crossings.next()?;
            let (start, is_inside) = (self.passed, self.depth > 0);
            let change = if goes_out { -1 } else { 1 };
            // A way out that had no way in is one that rounding found at an edge.
            self.depth = if self.has_parts { (self.depth + change).max(0) } else { i32::from(!goes_out) };
            self.passed = t;
            let end = t.min(self.t_max);
            if is_inside && start < end {
                return Some([start, end]);
            }
        }
        None
    }
}
