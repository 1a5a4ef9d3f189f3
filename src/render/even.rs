//! Even matter inside a closed surface: mist in a ball of glass, haze in a room.
//!
//! A ray is inside from where it crosses the surface inwards to where it crosses it outwards. Which way it crosses is told by
//! the side of the surface, so that nothing is counted: where surfaces of a mesh overlap, all is inside that is inside of one
//! of them. On the pieces inside optical depth is length times extinction, so that flights and transmittances are exact.

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
        Pieces {
            container: &self.container,
            ray: *ray,
            searched: 0.0,
            passed: 0.0,
            before: if may_be_inside { Before::Unknown } else { Before::Outside },
            left: if is_met { CROSSINGS_MAX } else { 0 },
            t_max,
        }
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

/// Where a ray was before a crossing.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Before {
    /// Inside of the surface crossed last.
    Inside,
    /// Not inside of that.
    Outside,
    /// It began there.
    Unknown,
}

/// The pieces of a ray inside a closed surface, in order.
pub struct Pieces<'a> {
    container: &'a TraceScene,
    ray: Ray,
    /// Distance from which on the next crossing is looked for [m].
    searched: f32,
    /// Distance of that crossing [m].
    passed: f32,
    before: Before,
    /// Crossings that are still looked for.
    left: u32,
    t_max: f32,
}

impl Iterator for Pieces<'_> {
    type Item = [f32; 2];

    fn next(&mut self) -> Option<[f32; 2]> {
        while self.left > 0 && self.passed < self.t_max {
            self.left -= 1;
            // Not only up to `t_max`: what crosses there or beyond says whether the last piece is inside. After the last
            // crossing all is outside.
            let hit = self.container.intersect(&self.ray, self.searched, f32::INFINITY)?;
            let goes_out = hit.normal.dot(*self.ray.direction) > 0.0;
            let start = self.passed;
            // A way out that had no way in: only a ray from outside that rounding let in at an edge. After other ways out, of
            // overlapping surfaces, there is one more to leave.
            let is_inside =
                self.before == Before::Inside || goes_out && (self.before == Before::Unknown || start > 0.0);
            self.passed = hit.t;
            // On along the same line: a new start beside the surface would be another, and a grazing chord much longer or shorter.
            // To cross the same place twice adds a piece of the length of some roundings.
            self.searched = hit.t * (1.0 + CLEARANCE) + f32::MIN_POSITIVE;
            self.before = if goes_out { Before::Outside } else { Before::Inside };
            let end = self.passed.min(self.t_max);
            if is_inside && start < end {
                return Some([start, end]);
            }
        }
        None
    }
}
