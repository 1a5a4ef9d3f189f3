//! What a potential is compared with at an obstacle: only the excess over it is removed there.
//!
//! What stays on the wall must have a flow along it. That holds for a constant, for the gradient of anything, for what is
//! zero on the wall and for what a ground lets slide along; the closer it comes to the potential itself, the less the
//! wall disturbs the flow.

use crate::flow::obstacles::{Boundary, Hole, Obstacle};
use crate::flow::potential::Psi;
use crate::geometry::motion::{RigidSpan, turned_derivatives};
use crate::math::jet::Scalar;
use crate::math::real::{Lane, Real, cross, dot, triple};
use glam::{DMat3, DVec3};
use std::f64::consts::TAU;

/// `a + phase·(b + phase·c)`.
#[derive(Debug, Clone, Copy)]
pub struct Parabola {
    coefficients: [f64; 3],
}

impl Parabola {
    /// Through the values at phases 0, ½ and 1.
    pub fn through(value: impl Fn(f64) -> f64) -> Self {
        let v = [value(0.0), value(0.5), value(1.0)];
        Self { coefficients: [v[0], -3.0 * v[0] + 4.0 * v[1] - v[2], 2.0 * v[0] - 4.0 * v[1] + 2.0 * v[2]] }
    }

    /// Its value.
    #[inline(always)]
    pub fn at<L: Real>(&self, phase: L) -> L {
        let [a, b, c] = triple!(i => phase.lit(self.coefficients[i]));
        phase.mul_add(phase.mul_add(c, b), a)
    }
}

/// The point at which an obstacle takes its constants, which moves with it [m].
pub fn reference_at(obstacle: &Obstacle, motion: Option<&RigidSpan>, phase: f64) -> [f64; 3] {
    motion.map_or(obstacle.reference().to_array(), |motion| motion.center(phase))
}

/// The excess of a uniform velocity: the linear potential with that curl which is smallest on the obstacle, about its
/// reference point.
#[derive(Debug, Clone)]
pub struct WindExcess {
    rows: Rows,
    /// The part of the wind along the ground, which is an excess at what stands on the ground alone.
    sliding: Option<Rows>,
    reference: [Parabola; 3],
}

/// Derivatives `[c][i]` of a linear potential.
type Rows = [[Parabola; 3]; 3];

impl WindExcess {
    /// Of the wind `velocity` [m/s] at an obstacle.
    pub fn new(velocity: DVec3, obstacle: &Obstacle, motion: Option<&RigidSpan>) -> Self {
        let ground = obstacle.ground().filter(|_| obstacle.boundary() == Boundary::Slip);
        let across = ground.map_or(velocity, |ground| ground.normal * ground.normal.dot(velocity));
        let rotation = |phase: f64| {
            motion.map_or(DMat3::IDENTITY, |motion| {
                let rows = motion.rotation(phase).map(DVec3::from_array);
                DMat3::from_cols(rows[0], rows[1], rows[2]).transpose()
            })
        };
        let rows = |velocity: DVec3| -> Rows {
            let entry = |c: usize, i: usize| {
                Parabola::through(|phase| obstacle.wind_potential(velocity, rotation(phase))[c][i])
            };
            std::array::from_fn(|c| std::array::from_fn(|i| entry(c, i)))
        };
        Self {
            rows: rows(across),
            sliding: ground.filter(|_| obstacle.solids().len() > 1).map(|_| rows(velocity - across)),
            reference: std::array::from_fn(|i| Parabola::through(|phase| reference_at(obstacle, motion, phase)[i])),
        }
    }

    /// The excess at `p` [m]. `on_ground` is 1 where the ground alone is near, and 0 at what stands on it.
    ///
    /// The wind along the ground times `on_ground` may stay: on the ground its flow is along it, as both halves of its
    /// potential are, height times a vector along the ground and a vector along the normal; elsewhere it is zero.
    #[inline(always)]
    pub fn at<L: Real>(&self, p: [L; 3], phase: L, on_ground: &Scalar<L>) -> Psi<L> {
        let r: [L; 3] = triple!(i => p[i] - self.reference[i].at(phase));
        let linear = |rows: &Rows| {
            let jacobian: [[L; 3]; 3] = triple!(c => triple!(i => rows[c][i].at(phase)));
            Psi { value: triple!(c => dot(jacobian[c], r)), jacobian }
        };
        let excess = linear(&self.rows);
        let Some(sliding) = &self.sliding else { return excess };
        let standing =
            Scalar { value: phase.lit(1.0) - on_ground.value, gradient: triple!(i => -on_ground.gradient[i]) };
        excess.plus(&linear(sliding).modulated(&standing))
    }
}

/// The potential of the flux through the hole of an obstacle.
#[derive(Debug, Clone)]
pub struct HoleFlux {
    hole: Hole,
    /// Over 2π [m³/s].
    flux: Parabola,
}

impl HoleFlux {
    /// Of the flow with potential `psi`, given at points [m] and phases.
    pub fn new(hole: Hole, motion: Option<&RigidSpan>, psi: impl Fn([f64; 3], f64) -> [f64; 3]) -> Self {
        Self { hole, flux: Parabola::through(|phase| circulation(&hole, motion, phase, |p| psi(p, phase))) }
    }

    /// `flux·∇φ`, with φ the angle about the hole's axis: no curl and the circulation of the flux, so that it may stay on
    /// the wall of a ring and lets the flux through.
    #[inline(always)]
    pub fn at<L: Lane>(&self, motion: Option<&RigidSpan>, p: [L; 3], phase: L) -> Psi<L> {
        let flux = self.flux.at(phase);
        let Some(motion) = motion else { return angle_gradient(&self.hole, p).scaled(flux) };
        let (rest, m) = motion.to_rest(p, phase);
        let own = angle_gradient(&self.hole, rest);
        let turned = Psi { value: triple!(c => dot(m[c], own.value)), jacobian: turned_derivatives(&own.jacobian, &m) };
        turned.scaled(flux)
    }
}

/// ∮ψ·dl/2π round a hole: the flux through it, divided by 2π.
fn circulation(hole: &Hole, motion: Option<&RigidSpan>, phase: f64, psi: impl Fn([f64; 3]) -> [f64; 3]) -> f64 {
    const POINTS: u32 = 24;
    let (u, v) = hole.axis.any_orthonormal_pair();
    // Right-handed about the axis.
    let v = if u.cross(v).dot(hole.axis) < 0.0 { -v } else { v };
    let placed = |p: DVec3| motion.map_or(p, |motion| motion.from_rest(p, phase));
    let center = placed(hole.center);
    (0..POINTS)
        .map(|i| {
            let (sin, cos) = (TAU * f64::from(i) / f64::from(POINTS)).sin_cos();
            let p = placed(hole.center + hole.radius * (u * cos + v * sin));
            let along = placed(hole.center + (v * cos - u * sin)) - center;
            DVec3::from_array(psi(p.to_array())).dot(along) * hole.radius / f64::from(POINTS)
        })
        .sum()
}

#[inline(always)]
fn angle_gradient<L: Real>(hole: &Hole, p: [L; 3]) -> Psi<L> {
    let one = p[0].lit(1.0);
    let a = triple!(i => one.lit(hole.axis[i]));
    let r: [L; 3] = triple!(i => p[i] - one.lit(hole.center[i]));
    let along = dot(a, r);
    let radial: [L; 3] = triple!(i => r[i] - along * a[i]);
    // On the axis the ramp is 1, and only finiteness matters.
    let square = dot(radial, radial).max(one.lit(1e-6 * hole.radius * hole.radius));
    let inverse = one / square;
    let turned = cross(a, radial);
    let zero = one.lit(0.0);
    // Derivative of a × r: rows of the cross-product matrix of a.
    let d_turned = [[zero, -a[2], a[1]], [a[2], zero, -a[0]], [-a[1], a[0], zero]];
    let two = one.lit(2.0);
    Psi {
        value: triple!(c => turned[c] * inverse),
        jacobian: triple!(c => {
            triple!(i => (d_turned[c][i] - two * turned[c] * radial[i] * inverse) * inverse)
        }),
    }
}
