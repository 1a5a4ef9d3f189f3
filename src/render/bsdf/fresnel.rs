//! How much light a smooth boundary reflects, for light that is not polarised.

use crate::render::color::Rgb;
use glam::Vec3;

/// Share of light that the boundary to a dielectric reflects (Fresnel 1823); 1 at total reflection.
///
/// `cosine` in [0, 1] is that of the angle to the normal on the side the light comes from, `eta` > 0 the index of
/// refraction of the far side over that of the near side.
#[inline]
pub fn dielectric(cosine: f32, eta: f32) -> f32 {
    let sine_sq = (1.0 - cosine * cosine) / (eta * eta);
    if sine_sq >= 1.0 {
        return 1.0;
    }
    let through = (1.0 - sine_sq).sqrt();
    let parallel = (eta * cosine - through) / (eta * cosine + through);
    let perpendicular = (cosine - eta * through) / (cosine + eta * through);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// Share of light that a metal with index of refraction `eta` + i `k` reflects in each channel: exact, for a boundary to
/// air (Born and Wolf 1999, *Principles of optics*, §14.2).
#[inline]
pub fn conductor(cosine: f32, eta: Rgb, k: Rgb) -> Rgb {
    let cosine_sq = cosine * cosine;
    let sine_sq = 1.0 - cosine_sq;
    let (eta_sq, k_sq) = (eta * eta, k * k);
    let t0 = eta_sq - k_sq - sine_sq;
    let a_sq_b_sq = root(t0 * t0 + 4.0 * eta_sq * k_sq);
    let a = root(0.5 * (a_sq_b_sq + t0).max(Vec3::ZERO));
    let (t1, t2) = (a_sq_b_sq + cosine_sq, 2.0 * cosine * a);
    let perpendicular = (t1 - t2) / (t1 + t2);
    let (t3, t4) = (cosine_sq * a_sq_b_sq + sine_sq * sine_sq, t2 * sine_sq);
    0.5 * perpendicular * (Vec3::ONE + (t3 - t4) / (t3 + t4))
}

fn root(v: Vec3) -> Vec3 {
    Vec3::new(v.x.sqrt(), v.y.sqrt(), v.z.sqrt())
}

/// Share of light that a metal reflects by the approximation of Schlick 1994, *An inexpensive BRDF model for
/// physically-based rendering*, eq. 15, from its reflectance `f0` at normal incidence.
#[inline]
pub fn schlick(cosine: f32, f0: Rgb) -> Rgb {
    let x = 1.0 - cosine;
    let x_sq = x * x;
    f0 + (Vec3::ONE - f0) * (x_sq * x_sq * x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_reflectances() {
        assert!((dielectric(1.0, 1.5) - 0.04).abs() < 1e-6);
        assert!((dielectric(1.0, 1.0 / 1.5) - 0.04).abs() < 1e-6);
        assert_eq!(dielectric(0.0, 1.5), 1.0);
        // At Brewster's angle only light that swings across the plane is reflected: half of (n² − 1)²/(n² + 1)².
        let brewster = (1.0f32 / (1.0 + 1.5 * 1.5)).sqrt();
        assert!((dielectric(brewster, 1.5) - 0.5 * (1.25f32 / 3.25).powi(2)).abs() < 1e-6);
        // Total reflection from glass to air begins at a sine of 1/1.5.
        assert_eq!(dielectric((1.0f32 - 0.445).sqrt(), 1.0 / 1.5), 1.0);
        assert!(dielectric((1.0f32 - 0.440).sqrt(), 1.0 / 1.5) < 0.7);
        assert!(dielectric(0.3, 1.0) < 1e-12);
        // ((n − 1)² + k²)/((n + 1)² + k²)
        let f = conductor(1.0, Vec3::new(0.2, 1.5, 3.0), Vec3::new(3.0, 0.0, 3.0));
        let expected = Vec3::new(9.64 / 10.44, 0.04, 13.0 / 25.0);
        assert!((f - expected).length() < 1e-5, "{f} {expected}");
    }

    #[test]
    fn a_metal_that_does_not_absorb_is_a_dielectric() {
        for i in 0..=20 {
            let cosine = i as f32 / 20.0;
            let metal = conductor(cosine, Vec3::splat(1.5), Vec3::ZERO).x;
            assert!((metal - dielectric(cosine, 1.5)).abs() < 1e-4, "{cosine}: {metal}");
        }
        assert!((conductor(0.0, Vec3::splat(0.2), Vec3::splat(3.0)) - Vec3::ONE).length() < 1e-6);
    }

    #[test]
    fn light_that_goes_in_and_out_is_reflected_alike() {
        for i in 1..=20 {
            let cosine = i as f32 / 20.0;
            let sine_sq = (1.0 - cosine * cosine) / (1.5 * 1.5);
            let inside = dielectric((1.0 - sine_sq).sqrt(), 1.0 / 1.5);
            assert!((dielectric(cosine, 1.5) - inside).abs() < 1e-5);
        }
    }
}
