//! Whirls: about a point (curl-noise-2007, eq. 7), or along a line (eq. 8).
//!
//! The paper measures the distance to the closest point of the line, which has a ridge wherever two points are equally
//! close. Here a line is a row of blobs, each with the potential (1 − d²/R²)⁴ along the line's direction: the sum is
//! three times continuously differentiable everywhere, ends of lines and middles of rings included, and zero beyond R.

use crate::flow::potential::Psi;
use crate::math::real::{Lane, triple};
use glam::DVec3;
use std::f64::consts::TAU;

/// Blobs along a line lie this share of their radius apart; the ripple in speed is then below 1e-5.
const SPACING: f64 = 0.2;
/// Largest speed round a straight row of blobs of strength 1 for each metre: 9·B·x·(1 − x²)^3.5 at its maximum x² = 1/8,
/// with B = ∫(1 − t²)⁴dt = 256/315.
const PEAK_SPEED: f64 = 1.620_497_26;
/// A whirl about a point or along a line.
#[derive(Debug, Clone, PartialEq)]
pub struct Vortex {
    /// Middles at time 0 [m].
    centers: Vec<DVec3>,
    /// Potentials in the middles [m²/s].
    strengths: Vec<DVec3>,
    radius: f64,
    velocity: DVec3,
    /// Middle and half size of a box round all that moves, at time 0 [m].
    bounds: (DVec3, DVec3),
}

/// A [`Vortex`] over a span of time.
#[derive(Debug, Clone)]
pub struct VortexSpan<'a> {
    vortex: &'a Vortex,
    /// How far it has travelled at the start, and travels over the span [m].
    start: DVec3,
    displacement: DVec3,
}

impl Vortex {
    fn new(centers: Vec<DVec3>, strengths: Vec<DVec3>, radius: f64, velocity: DVec3) -> Self {
        let low = centers.iter().copied().reduce(DVec3::min).unwrap_or_default() - radius;
        let high = centers.iter().copied().reduce(DVec3::max).unwrap_or_default() + radius;
        Self { centers, strengths, radius, velocity, bounds: (0.5 * (low + high), 0.5 * (high - low)) }
    }

    /// A whirl about `center` [m] that turns with `angular_velocity` [rad/s] in its middle and not at all beyond
    /// `radius` [m]; travels with `velocity` [m/s].
    pub fn about_point(center: DVec3, angular_velocity: DVec3, radius: f64, velocity: DVec3) -> Self {
        // ∇×(A(1−u)⁴ω) = 8A/R²·(1−u)³·ω×r.
        Self::new(vec![center], vec![angular_velocity * (radius * radius / 8.0)], radius, velocity)
    }

    /// A whirl along the lines from point to point [m], of largest speed `speed` [m/s] were it straight, up to `core` [m]
    /// from the line.
    pub fn along_line(points: &[DVec3], core: f64, speed: f64, velocity: DVec3) -> Self {
        let (mut centers, mut strengths) = (Vec::new(), Vec::new());
        for ends in points.windows(2) {
            let pieces = ((ends[1] - ends[0]).length() / (SPACING * core)).ceil().max(1.0);
            let piece = (ends[1] - ends[0]) / pieces;
            for i in 0..pieces as usize {
                centers.push(ends[0] + piece * (i as f64 + 0.5));
                strengths.push(piece * (speed / PEAK_SPEED));
            }
        }
        Self::new(centers, strengths, core, velocity)
    }

    /// A whirl along a circle, through which it flows along `axis`.
    pub fn along_circle(center: DVec3, axis: DVec3, radius: f64, core: f64, speed: f64, velocity: DVec3) -> Self {
        let (u, v) = axis.normalize().any_orthonormal_pair();
        let v = if u.cross(v).dot(axis) < 0.0 { -v } else { v };
        let pieces = (TAU * radius / (SPACING * core)).ceil().max(16.0);
        let at = |i: f64| {
            let (sin, cos) = (TAU * i / pieces).sin_cos();
            (u * cos + v * sin, v * cos - u * sin)
        };
        let places = || (0..pieces as usize).map(|i| at(i as f64));
        let centers = places().map(|(out, _)| center + out * radius).collect();
        let strength = TAU * radius / pieces * speed / PEAK_SPEED;
        Self::new(centers, places().map(|(_, along)| along * strength).collect(), core, velocity)
    }

    /// Beyond this distance from its line nothing moves [m].
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Puts all of it into the plane through the origin across `normal` (length 1), where it stays.
    pub fn flatten(&mut self, normal: DVec3) {
        let flat = |v: &DVec3| *v - normal * normal.dot(*v);
        let centers = self.centers.iter().map(flat).collect();
        *self = Self::new(centers, std::mem::take(&mut self.strengths), self.radius, flat(&self.velocity));
    }

    /// The vortex from `start` [s], lasting `duration` [s].
    pub fn span(&self, start: f64, duration: f64) -> VortexSpan<'_> {
        VortexSpan { vortex: self, start: self.velocity * start, displacement: self.velocity * duration }
    }
}

/// A smooth curve through all points (Catmull and Rom 1974), as points at most `spacing` [m] apart.
pub fn smooth_curve(points: &[DVec3], is_closed: bool, spacing: f64) -> Vec<DVec3> {
    let n = points.len() as i64;
    let at = |i: i64| {
        if is_closed {
            points[i.rem_euclid(n) as usize]
        } else if i < 0 {
            2.0 * points[0] - points[1]
        } else if i >= n {
            2.0 * points[n as usize - 1] - points[n as usize - 2]
        } else {
            points[i as usize]
        }
    };
    let mut curve = vec![points[0]];
    for i in 0..if is_closed { n } else { n - 1 } {
        let [a, b, c, d] = [-1, 0, 1, 2].map(|k| at(i + k));
        let pieces = ((c - b).length() / spacing).ceil().max(4.0);
        for k in 1..=pieces as usize {
            let t = k as f64 / pieces;
            curve.push(b + 0.5 * t * ((c - a) + t * ((2.0 * a - 5.0 * b + 4.0 * c - d) + t * (3.0 * (b - c) + d - a))));
        }
    }
    curve
}

impl VortexSpan<'_> {
    /// The potential at `p` [m]; `phase` runs from 0 at the start of the span to 1 at its end.
    #[inline(never)]
    pub fn psi<L: Lane>(&self, p: [L; 3], phase: L) -> Psi<L> {
        phase.outlined(
            #[inline(always)]
            || self.psi_here(p, phase),
        )
    }

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn psi_here<L: Lane>(&self, p: [L; 3], phase: L) -> Psi<L> {
        let one = phase.lit(1.0);
        let zero = phase.lit(0.0);
        let mut psi = Psi::zero(one);
        let p: [L; 3] = triple!(i => p[i] - phase.mul_add(one.lit(self.displacement[i]), one.lit(self.start[i])));
        let (middle, half) = self.vortex.bounds;
        let outside: [L; 3] = triple!(i => (p[i] - one.lit(middle[i])).abs() - one.lit(half[i]));
        if !outside[0].max(outside[1]).max(outside[2]).any_lt(zero) {
            return psi;
        }
        let inverse = one.lit(1.0 / (self.vortex.radius * self.vortex.radius));
        let slope = one.lit(-8.0) * inverse;
        for k in 0..self.vortex.centers.len() {
            let (center, strength) = (self.vortex.centers[k], self.vortex.strengths[k]);
            let r: [L; 3] = triple!(i => p[i] - one.lit(center[i]));
            let free = (one - (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) * inverse).max(zero);
            let (square, w) = (free * free, triple!(c => one.lit(strength[c])));
            let (value, slope) = (square * square, slope * square * free);
            psi.value = triple!(c => value.mul_add(w[c], psi.value[c]));
            psi.jacobian = triple!(c => {
                let along = slope * w[c];
                triple!(i => along.mul_add(r[i], psi.jacobian[c][i]))
            });
        }
        psi
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::curl::{central_jacobian, curl};
    use crate::math::real::length;

    fn velocity(vortex: &Vortex, p: [f64; 3]) -> DVec3 {
        DVec3::from_array(curl(&vortex.span(0.0, 0.0).psi(p, 0.0)))
    }

    #[test]
    fn a_point_vortex_turns_rigidly_in_its_middle_and_rests_beyond_its_radius() {
        let (center, omega) = (DVec3::new(0.1, 0.2, 0.3), DVec3::new(0.0, 2.0, 1.0));
        let vortex = Vortex::about_point(center, omega, 0.5, DVec3::ZERO);
        let r = DVec3::new(0.004, -0.002, 0.003);
        assert!((velocity(&vortex, (center + r).to_array()) - omega.cross(r)).length() < 1e-5);
        assert_eq!(velocity(&vortex, (center + DVec3::X * 0.5001).to_array()), DVec3::ZERO);
    }

    #[test]
    fn a_straight_line_has_the_speed_it_promises_and_turns_counterclockwise() {
        let line = Vortex::along_line(&[DVec3::Z * -2.0, DVec3::Z * 2.0], 0.3, 0.7, DVec3::ZERO);
        let speeds: Vec<DVec3> = (1..30).map(|i| velocity(&line, [0.01 * f64::from(i), 0.0, 0.013])).collect();
        let fastest = speeds.iter().map(|v| v.length()).fold(0.0, f64::max);
        assert!((fastest / 0.7 - 1.0).abs() < 2e-3, "{fastest}");
        assert!(speeds.iter().all(|v| v.y > 0.0 && v.x.abs() < 1e-6 && v.z.abs() < 1e-6));
        let ripple = |z: f64| velocity(&line, [0.1, 0.0, z]).y;
        let values: Vec<f64> = (0..50).map(|i| ripple(0.002 * f64::from(i))).collect();
        let (low, high) = values.iter().fold((f64::MAX, 0.0f64), |(l, h), v| (l.min(*v), h.max(*v)));
        assert!(high / low - 1.0 < 1e-4, "{}", high / low - 1.0);
    }

    #[test]
    fn a_ring_blows_along_its_axis_and_travels() {
        let axis = DVec3::new(1.0, 2.0, 0.0);
        let ring = Vortex::along_circle(DVec3::ZERO, axis, 0.5, 0.6, 1.0, DVec3::X);
        let through = velocity(&ring, [0.0; 3]);
        assert!(through.normalize().dot(axis.normalize()) > 0.999_999 && through.length() > 0.1);
        let later = ring.span(1.0, 2.0);
        let moved = curl(&later.psi([2.0, 0.0, 0.0], 0.5));
        assert!((DVec3::from_array(moved) - through).length() < 1e-12);
    }

    #[test]
    fn the_jacobian_equals_differences() {
        let points = [DVec3::ZERO, DVec3::new(0.5, 0.3, 0.0), DVec3::new(0.7, -0.2, 0.6)];
        let vortex = Vortex::along_line(&smooth_curve(&points, true, 0.05), 0.3, 1.0, DVec3::ZERO);
        let span = vortex.span(0.0, 0.0);
        for i in 0..100 {
            let a = f64::from(i);
            let p = [0.4 + 0.4 * (a * 0.7).sin(), 0.3 * (a * 1.3).cos(), 0.3 + 0.3 * (a * 2.1).sin()];
            let difference = central_jacobian(|q| span.psi(q, 0.0).value, p, 1e-4);
            for (exact, difference) in span.psi(p, 0.0).jacobian.into_iter().zip(difference) {
                assert!(length(std::array::from_fn(|k| exact[k] - difference[k])) < 1e-6);
            }
        }
    }

    #[test]
    fn smooth_curves_go_through_their_points() {
        let points = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.5)];
        for is_closed in [false, true] {
            let curve = smooth_curve(&points, is_closed, 0.1);
            assert!(points.iter().all(|p| curve.iter().any(|q| (*p - *q).length() < 1e-12)));
            assert!(curve.windows(2).all(|w| (w[1] - w[0]).length() < 0.2));
            assert_eq!((curve[0] - curve[curve.len() - 1]).length() < 1e-12, is_closed);
        }
    }
}
