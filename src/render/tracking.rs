//! Free flight and transmittance through smoke of varying density, without a step size.
//!
//! Delta tracking (Woodcock et al. 1965) samples a collision; ratio tracking (Novák et al. 2014, *Residual ratio
//! tracking for estimating attenuation in participating media*) estimates transmittance. Both run over local majorants
//! and are unbiased for every bound that is one.

use crate::geometry::embree::Ray;
use crate::math::hash::CounterRng;
use crate::render::medium::Medium;

/// Transmittance below which a shadow ray plays roulette: lower wastes steps behind thick smoke, higher adds noise to
/// thin shadows.
const ROULETTE_BELOW: f32 = 0.1;

/// How a free flight ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event {
    /// Light meets smoke at distance `t` [m].
    Collision {
        /// Distance from the ray's origin [m].
        t: f32,
    },
    /// Light reaches the end of the ray.
    Escape,
}

/// Samples where light that starts at the ray's origin first meets smoke before `t_max` [m]; `u` in [0, 1) decides the
/// first optical distance and `stream` everything after.
pub fn sample_collision(medium: &Medium, ray: &Ray, t_max: f32, u: f32, stream: &mut CounterRng) -> Event {
    let mut tau_left = optical_distance(u);
    for segment in medium.majorants(ray, t_max) {
        let sigma_maj = segment.density_max * medium.extinction();
        if sigma_maj <= 0.0 {
            continue;
        }
        let mut t = f64::from(segment.t0);
        let end = f64::from(segment.t1);
        loop {
            // In f64: in very dense smoke a step is smaller than the last digit of an f32 distance.
            let next = t + f64::from(tau_left / sigma_maj);
            if next >= end {
                tau_left -= (end - t) as f32 * sigma_maj;
                break;
            }
            t = next;
            let sigma_t = medium.sigma_t(ray.at(t as f32));
            debug_assert!(sigma_t <= sigma_maj * 1.0001, "majorant {sigma_maj} below {sigma_t}");
            if stream.uniform() * sigma_maj < sigma_t {
                return Event::Collision { t: t as f32 };
            }
            tau_left = optical_distance(stream.uniform());
        }
    }
    Event::Escape
}

/// An unbiased estimate, in [0, 1], of the transmittance from the ray's origin to distance `t_max` [m].
pub fn estimate_transmittance(medium: &Medium, ray: &Ray, t_max: f32, stream: &mut CounterRng) -> f32 {
    let mut transmittance = 1.0;
    let mut tau_left = optical_distance(stream.uniform());
    for segment in medium.majorants(ray, t_max) {
        let sigma_maj = segment.density_max * medium.extinction();
        if sigma_maj <= 0.0 {
            continue;
        }
        let mut t = f64::from(segment.t0);
        let end = f64::from(segment.t1);
        loop {
            let next = t + f64::from(tau_left / sigma_maj);
            if next >= end {
                tau_left -= (end - t) as f32 * sigma_maj;
                break;
            }
            t = next;
            transmittance *= 1.0 - (medium.sigma_t(ray.at(t as f32)) / sigma_maj).min(1.0);
            if transmittance < ROULETTE_BELOW {
                if stream.uniform() * ROULETTE_BELOW >= transmittance {
                    return 0.0;
                }
                transmittance = ROULETTE_BELOW;
            }
            tau_left = optical_distance(stream.uniform());
        }
    }
    transmittance
}

/// An exponentially distributed optical distance from a uniform number in [0, 1).
#[inline]
fn optical_distance(u: f32) -> f32 {
    -(1.0 - u).ln()
}
