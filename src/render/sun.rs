//! Light from a small disk infinitely far away, or from a single direction.
//!
//! Angles are small here: half of the sun's 0.53° has a cosine that differs from 1 by 1.07e-5, of which `f32` keeps two
//! digits. All goes by 1 − cosine, which is 2 sin²(α/2) and, between unit vectors, half the square of their difference.

use crate::math::circle::on_circle;
use crate::math::space::UnitVec3;
use crate::render::color::Rgb;
use crate::render::light::LightSample;
use std::f32::consts::{PI, TAU};

/// Parallel light, or light from a disk of the sky.
#[derive(Debug, Clone)]
pub struct Sun {
    /// From the lit point to the middle of the disk.
    towards: UnitVec3,
    /// On a surface that faces the middle [W/m²].
    irradiance: Rgb,
    /// The disk, where there is one.
    disk: Option<Disk>,
    /// Whether camera rays see the disk.
    pub is_visible: bool,
}

/// A disk of the sky, equally bright all over.
#[derive(Debug, Clone)]
struct Disk {
    /// One minus the cosine of half its diameter.
    one_minus_cosine: f32,
    /// [W/(m² sr)].
    radiance: Rgb,
}

impl Sun {
    /// Light that travels along `direction` and gives `irradiance` [W/m²] on a surface that faces the middle of a disk of
    /// `angular_diameter_deg`, 0 to 180. 0 is parallel light.
    ///
    /// A disk of half angle α and radiance L gives π L sin²α, so L is the irradiance over π sin²α.
    pub fn new(direction: UnitVec3, irradiance: Rgb, angular_diameter_deg: f64, is_visible: bool) -> Self {
        let half = 0.5 * angular_diameter_deg.to_radians();
        let disk = (half > 0.0).then(|| Disk {
            one_minus_cosine: (2.0 * (0.5 * half).sin().powi(2)) as f32,
            radiance: irradiance / (PI * half.sin().powi(2) as f32),
        });
        Self { towards: -direction, irradiance, disk, is_visible }
    }

    /// Irradiance on a surface that faces the middle [W/m²].
    pub fn irradiance(&self) -> Rgb {
        self.irradiance
    }

    /// From the lit point to the middle of the disk.
    pub fn towards(&self) -> UnitVec3 {
        self.towards
    }

    /// One minus the cosine of half the diameter of the disk; 0 of parallel light.
    pub fn one_minus_cosine(&self) -> f32 {
        self.disk.as_ref().map_or(0.0, |disk| disk.one_minus_cosine)
    }

    /// A direction towards the disk, even over solid angle, from two uniform numbers.
    #[inline]
    pub fn sample(&self, u: [f32; 2]) -> LightSample {
        let Some(disk) = &self.disk else {
            return LightSample {
                direction: self.towards,
                distance: f32::INFINITY,
                weight: self.irradiance,
                pdf: None,
            };
        };
        let pdf = self.pdf();
        LightSample {
            direction: in_cone(self.towards, disk.one_minus_cosine, u),
            distance: f32::INFINITY,
            weight: disk.radiance / pdf,
            pdf: Some(pdf),
        }
    }

    /// Density [1/sr] with which [`Sun::sample`] returns a direction on the disk; 0 where there is no disk.
    #[inline]
    pub fn pdf(&self) -> f32 {
        self.disk.as_ref().map_or(0.0, |disk| 1.0 / (TAU * disk.one_minus_cosine))
    }

    /// Radiance [W/(m² sr)] that comes from `direction`; `None` beside the disk, and where there is none.
    #[inline]
    pub fn met(&self, direction: UnitVec3) -> Option<Rgb> {
        let disk = self.disk.as_ref()?;
        let one_minus_cosine = 0.5 * (*direction - *self.towards).length_squared();
        (one_minus_cosine <= disk.one_minus_cosine).then_some(disk.radiance)
    }
}

/// A direction even over the solid angle of a cone about `axis`, whose half angle has a cosine of 1 − `one_minus_cosine`.
pub fn in_cone(axis: UnitVec3, one_minus_cosine: f32, u: [f32; 2]) -> UnitVec3 {
    let drop = u[0] * one_minus_cosine;
    let sine = (drop * (2.0 - drop)).max(0.0).sqrt();
    axis.from_local((sine * on_circle(u[1])).extend(1.0 - drop))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};
    use crate::math::statistics::chi_square_test;
    use glam::Vec3;

    fn travelling() -> UnitVec3 {
        UnitVec3::try_new(Vec3::new(0.3, -0.8, 0.45)).expect("not zero")
    }

    #[test]
    fn irradiance_is_kept_whatever_the_size() {
        for diameter in [0.01, 0.1, 0.53, 5.0, 60.0, 180.0] {
            let sun = Sun::new(travelling(), Vec3::new(1.0, 2.0, 3.0), diameter, false);
            // On a stratified square the mean is that of the integral to the square of its spacing.
            const N: usize = 256;
            let mut sum = 0.0f64;
            for i in 0..N * N {
                let u = [(i % N) as f32 + 0.5, (i / N) as f32 + 0.5].map(|x| x / N as f32);
                let s = sun.sample(u);
                sum += f64::from(s.weight.y * -travelling().dot(*s.direction)) / (N * N) as f64;
            }
            assert!((sum / 2.0 - 1.0).abs() < 1e-4, "{diameter}: {sum}");
        }
    }

    #[test]
    fn what_is_sampled_is_met_even_where_the_disk_is_tiny() {
        for diameter in [0.01, 0.1, 0.53, 5.0, 90.0] {
            let sun = Sun::new(travelling(), Vec3::ONE, diameter, false);
            let mut rng = CounterRng::new(Seed(4));
            let n = 20_000;
            let mut rings = [0.0; 10];
            let mut missed = 0;
            for _ in 0..n {
                let s = sun.sample([rng.uniform(), rng.uniform()]);
                let Some(radiance) = sun.met(s.direction) else {
                    missed += 1;
                    continue;
                };
                assert_eq!(sun.pdf(), s.pdf.unwrap());
                assert!((radiance / sun.pdf() / s.weight - 1.0).abs().max_element() < 1e-5);
                // Rings of equal solid angle.
                let drop =
                    0.5 * (*s.direction + *travelling()).length_squared() / sun.disk.as_ref().unwrap().one_minus_cosine;
                rings[((drop * 10.0) as usize).min(9)] += 1.0;
            }
            // The rim is as sharp as unit vectors are.
            assert!(missed < n / 200, "{diameter}: {missed}");
            let p = chi_square_test(&rings, &[f64::from(n - missed) / 10.0; 10]);
            assert!(p > 1e-3, "{diameter}: p {p}, {rings:?}");
        }
    }

    #[test]
    fn the_disk_ends_at_its_diameter_and_parallel_light_is_not_met() {
        let sun = Sun::new(travelling(), Vec3::ONE, 0.53, true);
        let off = |degrees: f64| {
            let (u, _) = (-travelling()).orthonormal_pair();
            let angle = degrees.to_radians();
            UnitVec3::try_new(-*travelling() * angle.cos() as f32 + u * angle.sin() as f32).unwrap()
        };
        assert!(sun.met(off(0.264)).is_some() && sun.met(off(0.266)).is_none());
        assert!(sun.met(travelling()).is_none());
        let parallel = Sun::new(travelling(), Vec3::ONE, 0.0, true);
        assert!(parallel.met(-travelling()).is_none() && parallel.sample([0.3, 0.7]).pdf.is_none());
    }
}
