//! Clear sky of an earth-like planet, computed when a scene is loaded: air, haze and ozone over a ground.
//!
//! Sunlight that scatters once is integrated along each line of sight through exponential layers of air and haze and a
//! tent of ozone (Nishita et al. 1993, *Display of the Earth Taking into Account Atmospheric Scattering*; coefficients of
//! Bruneton and Neyret 2008, *Precomputed Atmospheric Scattering*, and Hillaire 2020). What scatters more often is taken
//! to be the same from all around at each place, and its infinite sum is a geometric series (Hillaire 2020, *A Scalable
//! and Production Ready Sky and Atmosphere Rendering Technique*, equations 5 to 10); light that the ground reflects once
//! more into the air is in it.
//!
//! Three wavelengths, 680, 550 and 440 nm, stand for red, green and blue. Sunlight outside of the air is white and has
//! [`SOLAR_CONSTANT`] in each channel.

use crate::math::parallel;
use crate::render::color::Rgb;
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// Irradiance of the sun outside of the air, of all wavelengths together [W/m²].
pub const SOLAR_CONSTANT: f64 = 1361.0;
/// Diameter of the sun in the sky [degrees].
pub const SUN_DIAMETER_DEG: f64 = 0.53;

/// Radius of the ground and of the upper end of the air [m].
const GROUND: f64 = 6_360_000.0;
const TOP: f64 = 6_460_000.0;
/// Where the sky is seen from, above the ground [m].
const EYE: f64 = 2.0;

/// Scattering by air at the ground [1/m].
const RAYLEIGH: DVec3 = DVec3::new(5.802e-6, 13.558e-6, 33.1e-6);
const RAYLEIGH_HEIGHT: f64 = 8000.0;
/// Absorption by ozone where it is densest, in the middle of a tent [1/m, m].
const OZONE: DVec3 = DVec3::new(0.650e-6, 1.881e-6, 0.085e-6);
const OZONE_MIDDLE: f64 = 25_000.0;
const OZONE_HALF_WIDTH: f64 = 15_000.0;
/// Haze: scale height [m], share of its extinction that scatters, asymmetry, and its change with wavelength by the
/// exponent 1.3 of Ångström (1929), relative to green.
const HAZE_HEIGHT: f64 = 1200.0;
const HAZE_ALBEDO: f64 = 0.9;
const HAZE_G: f64 = 0.8;
const HAZE_COLOR: DVec3 = DVec3::new(0.759, 1.0, 1.337);

/// Steps of the integral along a line of sight. Half as many change the sky by less than 1 %.
const STEPS: usize = 48;
/// Steps and directions of the integrals for light scattered more often, which is smooth.
const FURTHER_STEPS: usize = 20;
const FURTHER_DIRECTIONS: usize = 64;
/// Entries of tables by height and by the cosine of the sun's angle from the zenith.
const TABLE: usize = 48;

/// Air, haze and ground, lit by a sun.
#[derive(Debug)]
pub struct Atmosphere {
    /// Extinction of haze at the ground [1/m].
    haze: DVec3,
    ground_albedo: DVec3,
    /// Towards the sun.
    to_sun: DVec3,
    /// Optical depth to the upper end of the air.
    depth: Table,
    /// Radiance scattered twice or more, for a sun of irradiance 1 [1/sr].
    further: Table,
}

/// A function of height and of the cosine of an angle from the zenith.
#[derive(Debug)]
struct Table(Vec<DVec3>);

impl Atmosphere {
    /// The air under a sun in the direction `to_sun`, of length 1, y up. `turbidity` ≥ 1 is the optical depth of air and haze
    /// over that of air, straight up in green light: 1 is pure air, 2 to 3 a clear day, 10 thick haze. The ground reflects
    /// the share `ground_albedo`, alike in all directions.
    pub fn new(to_sun: DVec3, turbidity: f64, ground_albedo: Rgb) -> Self {
        let haze = HAZE_COLOR * ((turbidity - 1.0) * RAYLEIGH.y * RAYLEIGH_HEIGHT / HAZE_HEIGHT);
        let mut air = Self {
            haze,
            ground_albedo: ground_albedo.as_dvec3(),
            to_sun,
            depth: Table(Vec::new()),
            further: Table(Vec::new()),
        };
        air.depth = Table::of(|height, cosine| air.depth_to_top(GROUND + height, cosine));
        air.further = Table::of(|height, cosine| air.scattered_further(GROUND + height, cosine));
        air
    }

    /// Irradiance on the ground of a surface that faces the sun, of the sun alone [W/m²].
    pub fn sun_irradiance(&self) -> Rgb {
        (self.sunlight(DVec3::Y * (GROUND + EYE), self.to_sun) * SOLAR_CONSTANT).as_vec3()
    }

    /// Radiance of sky and ground from all around, as a picture by longitude and latitude: top row first, the middle −z
    /// [W/(m² sr)].
    pub fn picture(&self, width: usize, height: usize) -> Vec<Rgb> {
        let rows = parallel::map(height, |row| {
            let (sin_theta, y) = (PI * (row as f64 + 0.5) / height as f64).sin_cos();
            let pixel = |column: usize| {
                let (s, c) = (2.0 * PI * ((column as f64 + 0.5) / width as f64 - 0.5)).sin_cos();
                self.radiance(DVec3::new(sin_theta * s, y, -sin_theta * c)).as_vec3()
            };
            (0..width).map(pixel).collect::<Vec<_>>()
        });
        rows.concat()
    }

    /// Radiance from a direction of length 1 [W/(m² sr)], seen from just above the ground; without the sun's disk.
    pub fn radiance(&self, direction: DVec3) -> DVec3 {
        let eye = DVec3::Y * (GROUND + EYE);
        let (end, is_ground) = way(eye, direction);
        let cosine = direction.dot(self.to_sun);
        let (mut radiance, mut transmittance) = (DVec3::ZERO, DVec3::ONE);
        let mut before = 0.0;
        for i in 0..STEPS {
            // Steps grow with the square of the distance: most air is near.
            let next = end * ((i as f64 + 1.0) / STEPS as f64).powi(2);
            let (dt, p) = (next - before, eye + direction * (0.5 * (before + next)));
            before = next;
            let layer = self.layer(p.length() - GROUND);
            let source = self.sunlight(p, self.to_sun)
                * (layer.air * rayleigh(cosine) + layer.haze * henyey_greenstein(cosine))
                + (layer.air + layer.haze) * self.further(p);
            let through = (layer.extinction * -dt).exp();
            // Exact for a source that is even over the step.
            radiance += transmittance * source * (DVec3::ONE - through) / layer.extinction;
            transmittance *= through;
        }
        if is_ground {
            radiance += transmittance * self.ground_radiance(eye + direction * end);
        }
        radiance * SOLAR_CONSTANT
    }

    /// Radiance of the ground at a point of it, for a sun of irradiance 1 [1/sr].
    fn ground_radiance(&self, p: DVec3) -> DVec3 {
        let up = p.normalize();
        // Light from a sky that is taken to be even is π times its radiance.
        let irradiance = self.sunlight(p, self.to_sun) * up.dot(self.to_sun).max(0.0) + self.further(p) * PI;
        self.ground_albedo * irradiance / PI
    }

    /// Share of sunlight that comes straight to a point; none in the shadow of the ground.
    fn sunlight(&self, p: DVec3, to_sun: DVec3) -> DVec3 {
        let r = p.length();
        let cosine = p.dot(to_sun) / r;
        // Over half a degree about the horizon the disk sets.
        let horizon = -(1.0 - (GROUND / r).powi(2)).max(0.0).sqrt();
        let half = (0.5 * SUN_DIAMETER_DEG).to_radians();
        let up = ((cosine - horizon) / half * 0.5 + 0.5).clamp(0.0, 1.0);
        if up <= 0.0 {
            return DVec3::ZERO;
        }
        (-self.depth.at(r - GROUND, cosine.max(horizon))).exp() * (up * up * (3.0 - 2.0 * up))
    }

    fn further(&self, p: DVec3) -> DVec3 {
        let r = p.length();
        self.further.at(r - GROUND, p.dot(self.to_sun) / r)
    }

    fn layer(&self, height: f64) -> Layer {
        let air = RAYLEIGH * (-height / RAYLEIGH_HEIGHT).exp();
        let haze = self.haze * (-height / HAZE_HEIGHT).exp();
        let ozone = OZONE * (1.0 - (height - OZONE_MIDDLE).abs() / OZONE_HALF_WIDTH).max(0.0);
        Layer { air, haze: haze * HAZE_ALBEDO, extinction: air + haze + ozone }
    }

    /// Optical depth from radius `r` to the upper end along a line at this cosine from the zenith.
    fn depth_to_top(&self, r: f64, cosine: f64) -> DVec3 {
        let (p, d) = (DVec3::Y * r, DVec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), cosine, 0.0));
        let end = exit(p, d, TOP);
        const N: usize = 64;
        let step = |i: usize| {
            let [a, b] = [i, i + 1].map(|k| end * (k as f64 / N as f64).powi(2));
            self.layer(((p + d * (0.5 * (a + b))).length() - GROUND).max(0.0)).extinction * (b - a)
        };
        (0..N).map(step).sum()
    }

    /// Radiance scattered twice or more at radius `r`, where the sun is at this cosine from the zenith, for a sun of
    /// irradiance 1 [1/sr].
    fn scattered_further(&self, r: f64, sun_cosine: f64) -> DVec3 {
        let p = DVec3::Y * r;
        let to_sun = DVec3::new((1.0 - sun_cosine * sun_cosine).max(0.0).sqrt(), sun_cosine, 0.0);
        let isotropic = 0.25 / PI;
        let (mut second, mut again) = (DVec3::ZERO, DVec3::ZERO);
        for i in 0..FURTHER_DIRECTIONS {
            // A spiral of directions that share the sphere evenly.
            let y = 1.0 - 2.0 * (i as f64 + 0.5) / FURTHER_DIRECTIONS as f64;
            let (s, c) = (i as f64 * PI * (3.0 - 5f64.sqrt())).sin_cos();
            let direction = DVec3::new((1.0 - y * y).sqrt() * c, y, (1.0 - y * y).sqrt() * s);
            let (end, is_ground) = way(p, direction);
            let (mut transmittance, mut before) = (DVec3::ONE, 0.0);
            for k in 0..FURTHER_STEPS {
                let next = end * ((k as f64 + 1.0) / FURTHER_STEPS as f64).powi(2);
                let (dt, q) = (next - before, p + direction * (0.5 * (before + next)));
                before = next;
                let layer = self.layer(q.length() - GROUND);
                let through = (layer.extinction * -dt).exp();
                let share = transmittance * (layer.air + layer.haze) * (DVec3::ONE - through) / layer.extinction;
                second += share * isotropic * self.sunlight(q, to_sun);
                again += share;
                transmittance *= through;
            }
            if is_ground {
                let q = p + direction * end;
                let irradiance = self.sunlight(q, to_sun) * q.normalize().dot(to_sun).max(0.0);
                second += transmittance * self.ground_albedo * irradiance / PI;
            }
        }
        // Over the sphere with an even phase function: the mean.
        let n = FURTHER_DIRECTIONS as f64;
        (second / n) / (DVec3::ONE - again / n)
    }
}

/// Coefficients at a height [1/m].
struct Layer {
    /// Scattering by air and by haze.
    air: DVec3,
    haze: DVec3,
    extinction: DVec3,
}

impl Table {
    fn of(value: impl Fn(f64, f64) -> DVec3 + Sync) -> Self {
        let entry = |i: usize| {
            let (u, v) = ((i % TABLE) as f64 / (TABLE - 1) as f64, (i / TABLE) as f64 / (TABLE - 1) as f64);
            // Dense near the ground and near the horizon, where all changes.
            let x = 2.0 * u - 1.0;
            value((TOP - GROUND) * v.powi(3), x * x.abs())
        };
        Self(parallel::map(TABLE * TABLE, entry))
    }

    fn at(&self, height: f64, cosine: f64) -> DVec3 {
        let v = (height / (TOP - GROUND)).clamp(0.0, 1.0).cbrt();
        let u = 0.5 + 0.5 * cosine.clamp(-1.0, 1.0).abs().sqrt().copysign(cosine);
        let place = DVec2::new(u, v) * (TABLE - 1) as f64;
        let cell = place.floor().min(DVec2::splat((TABLE - 2) as f64));
        let f = place - cell;
        let (i, j) = (cell.x as usize, cell.y as usize);
        let row = |j: usize| self.0[j * TABLE + i].lerp(self.0[j * TABLE + i + 1], f.x);
        row(j).lerp(row(j + 1), f.y)
    }
}

/// How far a line goes until it meets the ground or leaves the air [m], and which.
fn way(p: DVec3, direction: DVec3) -> (f64, bool) {
    let b = p.dot(direction);
    let off_sq = p.length_squared() - b * b;
    if b < 0.0 && off_sq < GROUND * GROUND {
        return ((-b - (GROUND * GROUND - off_sq).sqrt()).max(1e-3), true);
    }
    (exit(p, direction, TOP), false)
}

/// Where a line from inside leaves the ball of this radius about the planet's middle [m].
fn exit(p: DVec3, direction: DVec3, radius: f64) -> f64 {
    let b = p.dot(direction);
    ((b * b - p.length_squared() + radius * radius).max(0.0).sqrt() - b).max(1e-3)
}

/// Phase function of air [1/sr]; `cosine` between the directions of travel.
fn rayleigh(cosine: f64) -> f64 {
    3.0 / (16.0 * PI) * (1.0 + cosine * cosine)
}

fn henyey_greenstein(cosine: f64) -> f64 {
    let g = HAZE_G;
    (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cosine).powf(1.5))
}

/// Towards a sun at this elevation above the horizon, and this azimuth from −z towards +x [degrees].
pub fn direction_to_sun(elevation_deg: f64, azimuth_deg: f64) -> DVec3 {
    let ((s, c), (sin_a, cos_a)) = (elevation_deg.to_radians().sin_cos(), azimuth_deg.to_radians().sin_cos());
    DVec3::new(c * sin_a, s, -c * cos_a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::color::luminance;
    use glam::Vec3;

    fn air(elevation_deg: f64, turbidity: f64) -> Atmosphere {
        Atmosphere::new(direction_to_sun(elevation_deg, 30.0), turbidity, Vec3::splat(0.2))
    }

    fn bright(radiance: DVec3) -> f64 {
        f64::from(luminance(radiance.as_vec3()))
    }

    /// Irradiance of the sky on level ground [W/m²].
    fn sky_irradiance(air: &Atmosphere) -> DVec3 {
        const N: usize = 48;
        let direction = |i: usize| {
            let y = ((i / N) as f64 + 0.5) / N as f64;
            direction_to_sun(y.asin().to_degrees(), (i % N) as f64 / N as f64 * 360.0)
        };
        (0..N * N).map(|i| air.radiance(direction(i)) * direction(i).y).sum::<DVec3>() * 2.0 * PI / (N * N) as f64
    }

    #[test]
    fn sun_and_sky_are_as_bright_as_is_measured_on_clear_days() {
        // Clear days with the sun at 45°: some 100 to 130 klx facing the sun, of which 134 klx come in; level ground gets
        // 10 to 20 % of its light from the sky. In parts of what comes in:
        for (turbidity, sun, diffuse) in [(2.0, 0.6..0.8, 0.1..0.25), (3.0, 0.5..0.7, 0.15..0.35)] {
            let air = air(45.0, turbidity);
            let direct = f64::from(luminance(air.sun_irradiance()));
            let sky = bright(sky_irradiance(&air));
            let level = direct * 45f64.to_radians().sin();
            println!("turbidity {turbidity}: sun {direct:.0} W/m², sky {sky:.0}, share {:.3}", sky / (sky + level));
            assert!(sun.contains(&(direct / SOLAR_CONSTANT)), "{direct}");
            assert!(diffuse.contains(&(sky / (sky + level))), "{sky} of {level}");
        }
    }

    #[test]
    fn no_more_light_comes_out_than_goes_in() {
        for elevation in [1.0, 10.0, 45.0, 90.0] {
            for turbidity in [1.0, 2.0, 10.0] {
                // A black ground swallows what it gets: direct and scattered light are less than what came in.
                let air = Atmosphere::new(direction_to_sun(elevation, 0.0), turbidity, Vec3::ZERO);
                let level = elevation.to_radians().sin();
                let got = sky_irradiance(&air) + air.sun_irradiance().as_dvec3() * level;
                // Near the horizon the round earth gets light from beside.
                let came = SOLAR_CONSTANT * (level + 0.05);
                assert!(got.max_element() < came, "elevation {elevation}, turbidity {turbidity}: {got} of {came}");
            }
        }
    }

    #[test]
    fn the_sky_is_symmetric_about_the_plane_of_the_sun_and_brightest_near_it() {
        let air = air(35.0, 2.5);
        let at = |elevation: f64, azimuth: f64| air.radiance(direction_to_sun(elevation, azimuth));
        let mut brightest = (0.0, 0.0, 0.0);
        for elevation in (2..90).step_by(3) {
            for off in (0..180).step_by(5) {
                let (right, left) = (at(elevation as f64, 30.0 + off as f64), at(elevation as f64, 30.0 - off as f64));
                assert!((right - left).abs().max_element() < 1e-9 * right.max_element());
                if bright(right) > brightest.0 {
                    brightest = (bright(right), elevation as f64, off as f64);
                }
            }
        }
        assert!((brightest.1 - 35.0).abs() <= 3.0 && brightest.2 == 0.0, "{brightest:?}");
    }

    #[test]
    fn the_zenith_is_blue_low_suns_are_red_and_horizons_pale() {
        let noon = air(50.0, 2.0);
        let zenith = noon.radiance(DVec3::Y);
        assert!(zenith.z > 2.0 * zenith.x, "{zenith}");
        let horizon = noon.radiance(direction_to_sun(1.0, 120.0));
        assert!(bright(horizon) > bright(zenith) && horizon.z / horizon.x < 0.8 * zenith.z / zenith.x);
        let mut before = f32::INFINITY;
        for elevation in [60.0, 30.0, 10.0, 5.0, 2.0, 0.5] {
            let sun = air(elevation, 2.0).sun_irradiance();
            assert!(sun.z / sun.x < before, "{elevation}: {sun}");
            before = sun.z / sun.x;
        }
        assert!(before < 0.1);
        // Towards a low sun the sky is redder than away from it.
        let dusk = air(3.0, 2.5);
        let (towards, away) = (dusk.radiance(direction_to_sun(3.0, 34.0)), dusk.radiance(direction_to_sun(3.0, 210.0)));
        assert!(towards.z / towards.x < 0.5 * away.z / away.x, "{towards} {away}");
    }

    #[test]
    fn thin_air_scatters_once_as_the_integral_says() {
        // Straight up in pure air with the sun at the zenith, red light is scattered once: its integral over exponential
        // layers is known, and light scattered more often adds a little.
        let air = Atmosphere::new(DVec3::Y, 1.0, Vec3::ZERO);
        let tau = RAYLEIGH.x * RAYLEIGH_HEIGHT;
        let ozone = OZONE.x * OZONE_HALF_WIDTH;
        // Down through all and up again through what is below: backwards, the phase function is 3/(8π) at a cosine of 1.
        let once = 3.0 / (8.0 * PI) * tau * (-tau - ozone).exp() * SOLAR_CONSTANT;
        let found = air.radiance(DVec3::Y).x;
        assert!(found > once && found < once * 1.12, "{found}, once {once}");
    }
}
