//! Free flight and transmittance through smoke of varying density, without a step size.
//!
//! Delta tracking (Woodcock et al. 1965) samples a collision; ratio tracking (Novák et al. 2014, *Residual ratio
//! tracking for estimating attenuation in participating media*) estimates transmittance. Both run over local majorants
//! and are unbiased for every bound that is one. Pieces on which they would take very many steps are crossed exactly,
//! see `dense.rs`.

use crate::geometry::embree::Ray;
use crate::grid::lookup::IndexRay;
use crate::grid::majorant::Segment;
use crate::math::space::IndexPoint;
use crate::render::chroma::Chroma;
use crate::render::color::Rgb;
use crate::render::dense::{self, Crossing};
use crate::render::medium::Medium;
use crate::render::sampler::Stream;
use glam::Vec3;

/// Transmittance below which a shadow ray plays roulette: lower wastes steps behind thick smoke, higher adds noise to
/// thin shadows.
const ROULETTE_BELOW: f32 = 0.1;

/// Optical depth of a piece by its bound above which it is crossed voxel by voxel. A piece crosses some 6 voxels, which
/// cost as much as this many fictitious collisions; thinner pieces, which are all of ordinary smoke, end sooner by chance.
const DENSE: f32 = 64.0;

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
/// first optical distance and `stream` everything after. In smoke with a tint `chroma` says which channel decides, and
/// notes how likely the way is for each.
pub fn sample_collision(
    medium: &Medium,
    ray: &Ray,
    t_max: f32,
    u: f32,
    stream: &mut Stream,
    mut chroma: Option<&mut Chroma>,
) -> Event {
    let mut flight = Flight { tau_left: optical_distance(u) };
    let (line, sigma_max) = (medium.ray_to_index(ray), medium.sigma_max(1.0));
    for segment in medium.majorants(ray, t_max) {
        let mut piece = Piece::new(medium, line, sigma_max, &segment);
        if piece.is_dense() {
            if let Some(chroma) = chroma.as_deref_mut() {
                if let Some(t) = cross_in_color(&piece, &mut flight, chroma) {
                    return Event::Collision { t };
                }
                continue;
            }
            match piece.cross(f64::from(flight.tau_left)) {
                Crossing::Collision(t) => return Event::Collision { t: t as f32 },
                // The difference of two large numbers may round below 0.
                Crossing::Through(tau) => flight.tau_left = (flight.tau_left - tau as f32).max(0.0),
            }
            continue;
        }
        while let Some(p) = flight.next_candidate(&mut piece) {
            // Met or passed with a probability proportional to the extinction: that of any voxel with the mean will do.
            let (near, bound) = (stream.point(), stream.uniform() * piece.sigma_maj);
            if let Some(chroma) = chroma.as_deref_mut() {
                let sigma_t = piece.bounded(medium.sigma_t_nearby(p, near));
                if bound < sigma_t * chroma.hero_ratio() {
                    chroma.collide();
                    return Event::Collision { t: piece.t };
                }
                chroma.pass(sigma_t / piece.sigma_maj);
            } else if medium.exceeds_nearby(p, near, bound) {
                return Event::Collision { t: piece.t };
            }
            stream.null_collisions += 1;
            flight.tau_left = optical_distance(stream.uniform());
        }
    }
    Event::Escape
}

/// Crosses a dense piece by the optical depth of the channel that decides; the distance where it ends there [m].
#[cold]
fn cross_in_color(piece: &Piece, flight: &mut Flight, chroma: &mut Chroma) -> Option<f32> {
    let ratio = chroma.hero_ratio();
    // The optical distance left counts for the channel of largest extinction; nothing stops a channel without any.
    let left = if ratio > 0.0 { f64::from(flight.tau_left / ratio) } else { f64::INFINITY };
    match piece.cross(left) {
        Crossing::Collision(t) => {
            chroma.pass_exactly(left as f32);
            chroma.collide();
            Some(t as f32)
        }
        Crossing::Through(tau) => {
            chroma.pass_exactly(tau as f32);
            flight.tau_left = (flight.tau_left - tau as f32 * ratio).max(0.0);
            None
        }
    }
}

/// As [`estimate_transmittance`], for each channel of smoke with a tint: `ratios` are the extinctions over the largest.
pub fn estimate_tinted_transmittance(medium: &Medium, ratios: Vec3, ray: &Ray, t_max: f32, stream: &mut Stream) -> Rgb {
    let mut transmittance = Vec3::ONE;
    let (line, sigma_max) = (medium.ray_to_index(ray), medium.sigma_max(1.0));
    let mut flight = Flight { tau_left: optical_distance(stream.uniform()) };
    for segment in medium.majorants(ray, t_max) {
        let mut piece = Piece::new(medium, line, sigma_max, &segment);
        if piece.is_dense() {
            if let Crossing::Through(tau) = piece.cross(f64::INFINITY) {
                transmittance *= (ratios * -tau as f32).exp();
            }
            if !survives_in_color(&mut transmittance, stream) {
                return Vec3::ZERO;
            }
            continue;
        }
        while let Some(p) = flight.next_candidate(&mut piece) {
            let sigma_t = piece.bounded(medium.sigma_t(p));
            transmittance *= Vec3::ONE - sigma_t / piece.sigma_maj * ratios;
            stream.null_collisions += 1;
            if !survives_in_color(&mut transmittance, stream) {
                return Vec3::ZERO;
            }
            flight.tau_left = optical_distance(stream.uniform());
        }
    }
    transmittance
}

/// Plays roulette for the largest channel, the others keeping their ratios to it.
fn survives_in_color(transmittance: &mut Rgb, stream: &mut Stream) -> bool {
    let largest = transmittance.max_element();
    let mut kept = largest;
    if !survives(&mut kept, stream) {
        return false;
    }
    *transmittance *= kept / largest;
    true
}

/// An unbiased estimate, in [0, 1], of the transmittance from the ray's origin to distance `t_max` [m].
pub fn estimate_transmittance(medium: &Medium, ray: &Ray, t_max: f32, stream: &mut Stream) -> f32 {
    let mut transmittance = 1.0;
    let mut flight: Option<Flight> = None;
    let (line, sigma_max) = (medium.ray_to_index(ray), medium.sigma_max(1.0));
    for segment in medium.majorants(ray, t_max) {
        let mut piece = Piece::new(medium, line, sigma_max, &segment);
        if piece.is_dense() {
            if let Crossing::Through(tau) = piece.cross(f64::INFINITY) {
                transmittance *= (-tau).exp() as f32;
            }
            if !survives(&mut transmittance, stream) {
                return 0.0;
            }
            continue;
        }
        // Drawn only where there is smoke: an empty grid must leave the stream as it is.
        let flight = flight.get_or_insert_with(|| Flight { tau_left: optical_distance(stream.uniform()) });
        while let Some(p) = flight.next_candidate(&mut piece) {
            let sigma_t = piece.bounded(medium.sigma_t(p));
            transmittance *= 1.0 - sigma_t / piece.sigma_maj;
            stream.null_collisions += 1;
            if !survives(&mut transmittance, stream) {
                return 0.0;
            }
            flight.tau_left = optical_distance(stream.uniform());
        }
    }
    transmittance
}

/// Plays roulette for a small transmittance; false where it is lost, which makes it 0.
#[inline]
fn survives(transmittance: &mut f32, stream: &mut Stream) -> bool {
    if *transmittance < ROULETTE_BELOW {
        if stream.uniform() * ROULETTE_BELOW >= *transmittance {
            return false;
        }
        *transmittance = ROULETTE_BELOW;
    }
    true
}

/// A flight through homogenised smoke, real and fictitious: `tau_left` is the optical distance to its next collision.
struct Flight {
    tau_left: f32,
}

/// A piece of the ray on which the majorant is constant, and how far along it the flight is.
struct Piece<'a> {
    medium: &'a Medium,
    line: IndexRay,
    sigma_maj: f32,
    t: f32,
    end: f32,
}

impl<'a> Piece<'a> {
    #[inline(always)]
    fn new(medium: &'a Medium, line: IndexRay, sigma_max: f32, segment: &Segment) -> Self {
        let sigma_maj = sigma_max * segment.density_max;
        Self { medium, line, sigma_maj, t: segment.t0, end: segment.t1 }
    }

    /// Optical depth by the bound of what is left of it.
    #[inline(always)]
    fn tau_maj(&self) -> f32 {
        (self.end - self.t) * self.sigma_maj
    }

    /// An extinction that was read on it, for which its bound holds but for rounding.
    #[inline(always)]
    fn bounded(&self, sigma_t: f32) -> f32 {
        debug_assert!(sigma_t <= self.sigma_maj * 1.0001, "majorant {} below {sigma_t}", self.sigma_maj);
        if sigma_t < self.sigma_maj { sigma_t } else { self.sigma_maj }
    }

    #[inline(always)]
    fn is_dense(&self) -> bool {
        self.tau_maj() > DENSE && self.medium.has_exact_depths()
    }

    #[cold]
    fn cross(&self, tau_left: f64) -> Crossing {
        dense::cross(self.medium, &self.line, [self.t, self.end].map(f64::from), tau_left)
    }
}

impl Flight {
    /// Flies to the next collision on the piece, real or fictitious, and returns where that is; `None` where the piece ends
    /// first.
    // Inlined, as most pieces end first and should cost no more than this comparison.
    #[inline(always)]
    fn next_candidate(&mut self, piece: &mut Piece) -> Option<IndexPoint> {
        let tau_maj = piece.tau_maj();
        if self.tau_left >= tau_maj {
            self.tau_left -= tau_maj;
            return None;
        }
        piece.t += self.tau_left / piece.sigma_maj;
        Some(piece.line.at(piece.t))
    }
}

/// An exponentially distributed optical distance from a uniform number in [0, 1): −ln(1 − u).
///
/// Written out: a call of the library's logarithm in the middle of a flight costs more than the logarithm, as nothing stays
/// in registers over it.
#[inline(always)]
pub fn optical_distance(u: f32) -> f32 {
    debug_assert!((0.0..1.0).contains(&u));
    // 1 − u = 2^e · m with m in [√½, √2).
    const ROOT_HALF: u32 = std::f32::consts::FRAC_1_SQRT_2.to_bits();
    let bits = (1.0 - u).to_bits().wrapping_sub(ROOT_HALF);
    let e = (bits as i32 >> 23) as f32;
    let m = f32::from_bits((bits & 0x007f_ffff) + ROOT_HALF);
    // ln m = 2 artanh s, an odd series in s.
    let s = (m - 1.0) / (m + 1.0);
    let s_sq = s * s;
    let series = 1.0 + s_sq * (1.0 / 3.0 + s_sq * (0.2 + s_sq * (1.0 / 7.0 + s_sq * (1.0 / 9.0))));
    -(e * std::f32::consts::LN_2 + 2.0 * s * series)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::DensityGrid;
    use crate::math::hash::Seed;
    use crate::math::space::{UnitVec3, WorldPoint};
    use crate::render::phase::Phase;
    use glam::UVec3;

    #[test]
    fn optical_distances_are_logarithms() {
        for i in (0..1u32 << 24).step_by(7).chain([1, (1 << 24) - 1]) {
            let u = i as f32 / (1 << 24) as f32;
            let expected = -(1.0 - f64::from(u)).ln();
            let error = f64::from(optical_distance(u)) - expected;
            assert!(error.abs() <= 4e-7 * expected, "{u}: {error:e} of {expected:e}");
        }
        assert_eq!(optical_distance(0.0), 0.0);
    }

    /// Of a flight the bound exceeds the extinction at, on average, as many collisions as the difference of both along the
    /// ray says, weighed with the chance to get there; of a connection, which goes on, at as many as the bound says.
    #[test]
    fn null_collisions_are_as_many_as_bounds_exceed_densities() {
        let corner = WorldPoint::new(-0.8, -0.8, -0.8);
        let grid = DensityGrid::from_fn(corner, 0.1, UVec3::splat(16), 1 << 24, |p| {
            (7.0 * p.0.x).sin().max(0.0) * (5.0 * p.0.y).cos().max(0.0)
        });
        let medium = Medium::new(grid.expect("small"), 3.0, Vec3::ONE, Phase::HenyeyGreenstein { g: 0.0 });
        let direction = UnitVec3::try_new(Vec3::new(0.9, 0.2, 0.3)).expect("not zero");
        let ray = Ray { origin: WorldPoint::new(-1.3, -0.1, -0.2), direction };
        let line = medium.ray_to_index(&ray);
        let (mut tau, mut flights, mut connections) = (0.0, 0.0, 0.0);
        for piece in medium.majorants(&ray, f32::INFINITY) {
            const STEPS: usize = 400;
            let dt = f64::from(piece.t1 - piece.t0) / STEPS as f64;
            let sigma_maj = f64::from(piece.density_max * medium.extinction());
            for i in 0..STEPS {
                let t = f64::from(piece.t0) + (i as f64 + 0.5) * dt;
                let sigma_t = f64::from(medium.sigma_t(line.at(t as f32)));
                tau += sigma_t * dt;
                flights += (sigma_maj - sigma_t) * (-tau).exp() * dt;
                connections += sigma_maj * dt;
            }
        }
        assert!(tau > 0.3 && tau < 2.0, "{tau}: no roulette may end a connection");
        let n = 200_000;
        let mean = |walk: &dyn Fn(&mut Stream)| {
            let counts = (0..n).map(|i| {
                let mut stream = Stream::new(Seed(5).derive(i));
                walk(&mut stream);
                f64::from(stream.null_collisions)
            });
            counts.sum::<f64>() / n as f64
        };
        let flown = mean(&|stream| {
            let u = stream.uniform();
            sample_collision(&medium, &ray, f32::INFINITY, u, stream, None);
        });
        let connected = mean(&|stream| {
            estimate_transmittance(&medium, &ray, f32::INFINITY, stream);
        });
        // Five standard errors of a count that is nearly Poisson's; a connection plays roulette where little is left.
        let error = |expected: f64| 5.0 * (expected / n as f64).sqrt();
        assert!((flown - flights).abs() < error(flights), "{flown} {flights}");
        assert!(
            connected <= connections + error(connections) && connected > 0.8 * connections,
            "{connected} {connections}"
        );
    }
}
