//! Potentials in closed form that have no end: shear, rigid motion, rising columns.

use crate::flow::potential::{Psi, uniform};
use crate::math::interpolate::quintic_step;
use crate::math::jet::Scalar;
use crate::math::real::{Real, cross, dot, triple};
use glam::DVec3;

/// Layers that slide along each other: velocity `rate · (x − origin)·across` along `direction`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shear {
    /// A point that stands still [m].
    origin: DVec3,
    /// Across the layers, length 1.
    across: DVec3,
    /// The potential's direction, times the rate [1/s].
    potential: DVec3,
}

impl Shear {
    /// A shear of `rate` [1/s]. The part of `across` along `direction` is left out, for it would not be free of
    /// divergence.
    pub fn new(direction: DVec3, across: DVec3, rate: f64, origin: DVec3) -> Self {
        let direction = direction.normalize();
        let across = across.reject_from_normalized(direction).normalize();
        // ∇×(½ s² a) = s ∇s × a, with s = x·across and across × (direction × across) = direction.
        Self { origin, across, potential: rate * direction.cross(across) }
    }

    /// The potential at `p` [m].
    #[inline(always)]
    pub fn psi<L: Real>(&self, p: [L; 3]) -> Psi<L> {
        let across = triple!(i => p[0].lit(self.across[i]));
        let s = dot(across, triple!(i => p[i] - p[i].lit(self.origin[i])));
        let a: [L; 3] = triple!(c => s * p[0].lit(self.potential[c]));
        let half = s * p[0].lit(0.5);
        Psi {
            value: triple!(c => half * p[0].lit(self.potential[c]) * s),
            jacobian: triple!(c => triple!(i => a[c] * across[i])),
        }
    }
}

/// The motion of a rigid body: `velocity + angular_velocity × (x − center)`.
///
/// Curl-noise-2007, eq. 6, with ½V × r in place of the printed V × r, whose curl is 2V.
#[inline(always)]
pub fn rigid<L: Real>(velocity: [L; 3], angular_velocity: [L; 3], center: [L; 3], p: [L; 3]) -> Psi<L> {
    let half = p[0].lit(0.5);
    let r: [L; 3] = triple!(i => p[i] - center[i]);
    let v = triple!(i => half * velocity[i]);
    let zero = p[0].lit(0.0);
    let linear = cross(v, r);
    let d_linear = [[zero, -v[2], v[1]], [v[2], zero, -v[0]], [-v[1], v[0], zero]];
    let square = half * dot(r, r);
    Psi {
        value: triple!(c => linear[c] - square * angular_velocity[c]),
        jacobian: triple!(c => triple!(i => d_linear[c][i] - angular_velocity[c] * r[i])),
    }
}

/// A column of fluid that rises along an axis from a base, and draws in its surroundings where it gets faster.
///
/// On the axis it rises with `speed`, at a distance d < radius with speed·(1 − d²/radius²)³, beyond not at all; over the
/// height `rise` above the base it comes up to that speed from rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Column {
    /// Middle of the base [m].
    pub base: DVec3,
    /// Direction, length 1.
    pub axis: DVec3,
    /// Radius [m], > 0.
    pub radius: f64,
    /// Speed on the axis [m/s].
    pub speed: f64,
    /// Height over which it is reached [m], > 0.
    pub rise: f64,
}

impl Column {
    /// The potential at `p` [m]: h(d²)·(axis × r), whose curl is (d² h)'·2 along the axis.
    #[inline(always)]
    pub fn psi<L: Real>(&self, p: [L; 3]) -> Psi<L> {
        let one = p[0].lit(1.0);
        let axis = self.axis.to_array();
        let a = triple!(i => one.lit(axis[i]));
        let r: [L; 3] = triple!(i => p[i] - one.lit(self.base[i]));
        let height = dot(a, r);
        let across: [L; 3] = triple!(i => r[i] - height * a[i]);
        let inverse = one.lit(1.0 / (self.radius * self.radius));
        let u = dot(across, across) * inverse;
        let eighth = one.lit(self.speed / 8.0);
        // Inside the integral of the profile over the area, outside the flux through all of it.
        let inside = u.mul_add(u.mul_add(one.lit(4.0) - u, one.lit(-6.0)), one.lit(4.0));
        let inside_slope = u.mul_add(u.mul_add(one.lit(-3.0), one.lit(8.0)), one.lit(-6.0));
        let far = one / u.max(one);
        let h = eighth * u.select_lt(one, inside, far);
        let slope = eighth * inverse * u.select_lt(one, inside_slope, -far * far);
        let radial = Scalar { value: h, gradient: triple!(i => (slope + slope) * across[i]) };
        let t = (height * one.lit(1.0 / self.rise)).clamp(one.lit(0.0), one);
        let (weight, weight_slope) = quintic_step(t);
        let weight_slope = weight_slope * one.lit(1.0 / self.rise);
        let risen = Scalar { value: weight, gradient: triple!(i => weight_slope * a[i]) };
        let twice = triple!(i => a[i] + a[i]);
        uniform(twice, triple!(i => one.lit(self.base[i])), p).modulated(&radial.times(&risen))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::curl::{central_jacobian, curl};
    use crate::math::hash::{CounterRng, Seed};

    fn points(count: usize) -> impl Iterator<Item = [f64; 3]> {
        let mut rng = CounterRng::new(Seed(7));
        (0..count).map(move |_| std::array::from_fn(|_| f64::from(rng.uniform()) * 4.0 - 2.0))
    }

    fn is_near(a: [f64; 3], b: [f64; 3], allowed: f64) -> bool {
        (0..3).all(|i| (a[i] - b[i]).abs() < allowed)
    }

    fn jacobian_is_right(psi: impl Fn([f64; 3]) -> Psi<f64>) {
        for p in points(100) {
            let difference = central_jacobian(|q| psi(q).value, p, 1e-4);
            for (exact, difference) in psi(p).jacobian.into_iter().zip(difference) {
                assert!(is_near(exact, difference, 1e-6), "{p:?}: {exact:?} {difference:?}");
            }
        }
    }

    #[test]
    fn a_shear_has_the_velocity_it_promises() {
        let shear = Shear::new(DVec3::X * 3.0, DVec3::new(0.7, 2.0, 0.0), 0.5, DVec3::new(0.0, 1.0, 0.0));
        for p in points(50) {
            assert!(is_near(curl(&shear.psi(p)), [0.5 * (p[1] - 1.0), 0.0, 0.0], 1e-12));
        }
        jacobian_is_right(|p| shear.psi(p));
    }

    #[test]
    fn a_rigid_motion_has_no_factor_of_two() {
        let (v, w, c) = ([0.3, -0.2, 0.9], [1.0, 0.5, -2.0], [0.1, 0.7, 0.2]);
        for p in points(50) {
            let r = std::array::from_fn(|i| p[i] - c[i]);
            let turning = cross(w, r);
            assert!(is_near(curl(&rigid(v, w, c, p)), std::array::from_fn(|i| v[i] + turning[i]), 1e-12));
        }
        jacobian_is_right(|p| rigid(v, w, c, p));
    }

    #[test]
    fn a_column_rises_in_its_middle_and_draws_in_its_surroundings() {
        let column = Column { base: DVec3::new(0.2, -0.5, 0.0), axis: DVec3::Y, radius: 0.6, speed: 1.5, rise: 1.0 };
        let v = |x: f64, y: f64, z: f64| curl(&column.psi([0.2 + x, y - 0.5, z]));
        assert!(is_near(v(0.0, 1.2, 0.0), [0.0, 1.5, 0.0], 1e-12));
        assert!(is_near(v(0.3, 1.2, 0.0), [0.0, 1.5 * 0.75f64.powi(3), 0.0], 1e-12));
        assert!(is_near(v(0.0, -0.1, 0.0), [0.0; 3], 1e-12), "below the base");
        assert!(is_near(v(0.9, 1.2, 0.4), [0.0; 3], 1e-12), "beside the column, above the rise");
        assert!(v(0.9, 0.5, 0.0)[0] < -0.01, "inflow from the right where the column gets faster");
        jacobian_is_right(|p| column.psi(p));
    }
}
