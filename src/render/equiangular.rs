//! Distances along a flight where lamps in or near the smoke light it most.
//!
//! Free flight meets smoke in proportion to what is there, however far from a lamp, and flights through thin smoke mostly
//! meet nothing. Beside it, every flight near lamps takes one more distance in proportion to the inverse square of the
//! distance to one of them (Kulla and Fajardo 2012, *Importance Sampling Techniques for Path Tracing in Participating
//! Media*, equations 4 to 6), and asks that lamp for a connection from there. The two ways of finding a distance are weighted by
//! the power heuristic. Both densities are known: that of free flight is extinction times transmittance, and the optical
//! depth along a ray is integrated exactly, see `dense.rs`.

use crate::geometry::embree::Ray;
use crate::render::dense::Columns;
use crate::render::light::Light;
use crate::render::media::Media;
use crate::render::medium::Medium;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

/// Angle under which a lamp must see a flight from the camera for one more distance to be taken for it [rad]. Seen under
/// less, the inverse square changes little along it, and free flight alone does as well for less work.
const LEAST_ANGLE: f32 = FRAC_PI_4;
/// The same for flights after a scattering, which share less of the light of a picture.
const LEAST_ANGLE_LATER: f32 = FRAC_PI_2;
/// Flights for which distances are taken. Later ones mostly run through thick smoke, where free flight finds all.
const FLIGHTS: u32 = 4;

/// Optical depth beyond which a transmittance in single precision is 0.
const OPAQUE: f64 = 104.0;

/// A piece of a flight through smoke, and the lamps near it.
#[derive(Debug, Clone, Copy)]
pub struct Nearby<'a> {
    lights: &'a [Light],
    ray: Ray,
    /// Between these distances there is smoke [m].
    range: [f32; 2],
    /// Under which a lamp must see them [rad].
    least_angle: f32,
    /// Sum of the weights of all lamps.
    total: f32,
}

/// A lamp and the distance at which a flight is lit by it.
#[derive(Debug, Clone, Copy)]
pub struct NearbySample {
    /// Which light.
    pub light_idx: usize,
    /// Distance along the ray [m].
    pub t: f32,
    /// Probability of the lamp times the density of the distance [1/m].
    pub density: f32,
}

/// How a lamp sees a piece of a ray.
#[derive(Debug, Clone, Copy)]
struct View {
    /// Where along the ray the lamp is nearest, and how near [m].
    foot: f32,
    distance: f32,
    /// Angles from there to both ends [rad].
    angles: [f32; 2],
    /// Intensity times the integral of the inverse square.
    weight: f32,
}

impl View {
    /// `None` for a light that gives no light to the piece, or sees it under less than `least_angle`.
    fn of(light: &Light, ray: &Ray, [t0, t1]: [f32; 2], least_angle: f32) -> Option<Self> {
        let (place, radius) = light.place()?;
        let offset = place - ray.origin;
        let foot = offset.dot(*ray.direction);
        // Inside of a lamp of an extent the inverse square of the distance to its middle does not hold, and no lamp is
        // nearer to a ray than the rounding of both.
        let off = offset.cross(*ray.direction).length();
        let distance = off.max(0.5 * radius).max(1e-5 * (1.0 + foot.abs())).max(1e-5 * (t1 - t0));
        let angles_of = |t0: f32, t1: f32| [((t0 - foot) / distance).atan(), ((t1 - foot) / distance).atan()];
        let mut angles = angles_of(t0, t1);
        if angles[1] - angles[0] < least_angle {
            return None;
        }
        if let Light::Spot(spot) = light {
            let [t0, t1] = spot.clip(ray.origin, ray.direction, t0, t1)?;
            angles = angles_of(t0, t1);
        }
        let angle = angles[1] - angles[0];
        let weight = light.peak_intensity() * angle / distance;
        (angle > 0.0 && weight > 0.0 && weight.is_finite()).then_some(Self { foot, distance, angles, weight })
    }

    /// Density at a distance along the ray [1/m].
    fn density(&self, t: f32) -> f32 {
        let along = t - self.foot;
        self.distance / ((self.angles[1] - self.angles[0]) * (self.distance * self.distance + along * along))
    }

    fn contains(&self, t: f32) -> bool {
        let tangent = (t - self.foot) / self.distance;
        let angle = tangent.atan();
        self.angles[0] - 1e-6 <= angle && angle <= self.angles[1] + 1e-6
    }

    fn sample(&self, u: f32) -> f32 {
        let angle = self.angles[0] + u * (self.angles[1] - self.angles[0]);
        self.foot + self.distance * angle.tan()
    }
}

impl<'a> Nearby<'a> {
    /// The lamps among `lights` (all lights, of which `lamps` are the indices of those with a place) near the part of a ray
    /// before `t_max` [m] that is in smoke, for the flight after
    /// `bounce` scatterings; `None` where there are none.
    pub fn find(lights: &'a [Light], lamps: &[u32], media: Media, ray: &Ray, t_max: f32, bounce: u32) -> Option<Self> {
        if lamps.is_empty() || bounce >= FLIGHTS {
            return None;
        }
        let range = media.range(ray, t_max)?;
        let least_angle = if bounce == 0 { LEAST_ANGLE } else { LEAST_ANGLE_LATER };
        let weight = |&i: &u32| View::of(&lights[i as usize], ray, range, least_angle).map_or(0.0, |view| view.weight);
        let total: f32 = lamps.iter().map(weight).sum();
        (total > 0.0 && total.is_finite()).then_some(Self { lights, ray: *ray, range, least_angle, total })
    }

    fn view(&self, light_idx: usize) -> Option<View> {
        View::of(&self.lights[light_idx], &self.ray, self.range, self.least_angle)
    }

    /// A lamp, and a distance along the ray, from two uniform numbers.
    pub fn sample(&self, lamps: &[u32], u: [f32; 2]) -> Option<NearbySample> {
        let mut left = u[0] * self.total;
        let mut chosen = None;
        for &i in lamps {
            let Some(view) = self.view(i as usize) else { continue };
            chosen = Some((i, view));
            if left < view.weight {
                break;
            }
            left -= view.weight;
        }
        let (i, view) = chosen?;
        let t = view.sample(u[1]).clamp(self.range[0], self.range[1]);
        Some(NearbySample { light_idx: i as usize, t, density: view.weight / self.total * view.density(t) })
    }

    /// The density [1/m] with which [`Nearby::sample`] finds light `light_idx` and distance `t`.
    pub fn density(&self, light_idx: usize, t: f32) -> f32 {
        self.view(light_idx)
            .filter(|view| view.contains(t))
            .map_or(0.0, |view| view.weight / self.total * view.density(t))
    }
}

/// Extinction coefficient [1/m] at distance `t` along a ray times the transmittance to there: the density of free flight.
pub fn flight_density(medium: &Medium, ray: &Ray, t: f32) -> f32 {
    let line = medium.ray_to_index(ray);
    let sigma_t = medium.sigma_t(line.at(t));
    if sigma_t <= 0.0 {
        return 0.0;
    }
    let tau = optical_depth(medium, ray, t);
    if tau > OPAQUE { 0.0 } else { sigma_t * (-tau).exp() as f32 }
}

/// Optical depth from the ray's origin to distance `t` [m], of the channel of largest extinction; not all of it where that is
/// so large that nothing comes through.
pub fn optical_depth(medium: &Medium, ray: &Ray, t: f32) -> f64 {
    let columns = Columns::new(medium.grid(), &medium.ray_to_index(ray));
    let mut tau = 0.0;
    for piece in medium.majorants(ray, t).filter(|piece| piece.density_max > 0.0) {
        tau += f64::from(medium.extinction() * columns.between(piece.t0, piece.t1));
        if tau > OPAQUE {
            break;
        }
    }
    tau
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::DensityGrid;
    use crate::math::hash::{CounterRng, Seed};
    use crate::math::space::{UnitVec3, WorldPoint};
    use crate::math::statistics::chi_square_test;
    use crate::render::phase::Phase;
    use crate::render::spot::Spot;
    use glam::{UVec3, Vec3};

    fn smoke(extinction: f32) -> Medium {
        let grid = DensityGrid::from_fn(WorldPoint::new(-1.0, -1.0, -1.0), 0.125, UVec3::splat(16), 1 << 24, |p| {
            1.0 + 0.5 * (3.0 * p.0.x).sin()
        });
        Medium::new(grid.unwrap(), extinction, Vec3::ONE, Phase::HenyeyGreenstein { g: 0.0 })
    }

    fn lights() -> Vec<Light> {
        let point = |x, y, i: f32| Light::Point { position: WorldPoint::new(x, y, 0.1), intensity: Vec3::splat(i) };
        let down = Spot::new(WorldPoint::new(-0.3, 0.9, 0.0), -UnitVec3::Y, Vec3::ONE, 30.0, 0.4);
        vec![point(0.5, 0.1, 1.0), point(-0.6, -0.3, 2.0), Light::Spot(down), point(0.0, 90.0, 1.0)]
    }

    fn ray() -> Ray {
        Ray {
            origin: WorldPoint::new(-3.0, 0.0, 0.0),
            direction: UnitVec3::try_new(Vec3::new(1.0, 0.02, 0.01)).unwrap(),
        }
    }

    #[test]
    fn distances_follow_their_density_which_integrates_to_one() {
        let (medium, lights) = (smoke(1.0), lights());
        let lamps: Vec<u32> = (0..lights.len() as u32).collect();
        let nearby =
            Nearby::find(&lights, &lamps, Some(&medium).into(), &ray(), f32::INFINITY, 0).expect("lamps are near");
        let mut rng = CounterRng::new(Seed(1));
        const BINS: usize = 50;
        let n = 200_000;
        // Cells of the majorant reach beyond the smoke, at most by their edge.
        let (start, length) = (0.5, 5.0);
        let bin = |t: f32| ((t - start) / length * BINS as f32) as usize;
        let mut counts = vec![0.0; BINS * lights.len()];
        for _ in 0..n {
            let s = nearby.sample(&lamps, [rng.uniform(), rng.uniform()]).expect("some lamp");
            counts[s.light_idx * BINS + bin(s.t)] += 1.0;
            assert!((nearby.density(s.light_idx, s.t) / s.density - 1.0).abs() < 1e-3);
        }
        const FINE: usize = 400;
        let expected: Vec<f64> = (0..BINS * lights.len())
            .map(|k| {
                let (light, b) = (k / BINS, k % BINS);
                let t = |j: usize| start + length * (b as f32 + (j as f32 + 0.5) / FINE as f32) / BINS as f32;
                let sum: f64 = (0..FINE).map(|j| f64::from(nearby.density(light, t(j)))).sum();
                sum * f64::from(length) / (BINS * FINE) as f64
            })
            .collect();
        let total: f64 = expected.iter().sum();
        assert!((total - 1.0).abs() < 1e-3, "{total}");
        // A lamp far away is none of them.
        assert_eq!(expected[3 * BINS..].iter().sum::<f64>(), 0.0);
        let often: Vec<usize> = (0..counts.len()).filter(|&k| expected[k] * f64::from(n) > 8.0).collect();
        let of = |v: &[f64], scale: f64| often.iter().map(|&k| v[k] * scale).collect::<Vec<_>>();
        let p = chi_square_test(&of(&counts, 1.0), &of(&expected, f64::from(n)));
        assert!(p > 1e-3, "p {p}");
    }

    #[test]
    fn the_density_of_free_flight_is_the_change_of_transmittance() {
        for extinction in [0.3, 3.0, 300.0] {
            let medium = smoke(extinction);
            // What does not come through has met smoke: the density's integral is 1 − T.
            const N: usize = 4000;
            let sum: f64 = (0..N)
                .map(|i| f64::from(flight_density(&medium, &ray(), 1.8 + 3.0 * (i as f32 + 0.5) / N as f32)))
                .sum::<f64>()
                * 3.0
                / N as f64;
            let line = medium.ray_to_index(&ray());
            let tau = f64::from(extinction) * f64::from(Columns::new(medium.grid(), &line).between(0.0, 10.0));
            assert!(
                (sum / (1.0 - (-tau).exp()) - 1.0).abs() < 2e-2 * (1.0 + f64::from(extinction) / 300.0),
                "{extinction}: {sum} {tau}"
            );
        }
        assert_eq!(flight_density(&smoke(1e6), &ray(), 3.0), 0.0);
    }

    #[test]
    fn flights_far_from_lamps_and_scenes_without_take_no_more() {
        let (medium, lights) = (smoke(1.0), lights());
        assert!(Nearby::find(&lights, &[], Some(&medium).into(), &ray(), 10.0, 0).is_none());
        assert!(Nearby::find(&lights, &[3], Some(&medium).into(), &ray(), 10.0, 0).is_none());
        // Nor what ends before the smoke.
        assert!(Nearby::find(&lights, &[0, 1], Some(&medium).into(), &ray(), 1.0, 0).is_none());
    }
}
