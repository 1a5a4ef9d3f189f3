//! The velocity field: the curl of the sum of all potentials, each bent round all obstacles.

use crate::flow::curl::curl;
use crate::flow::obstacles::{Hole, Obstacle, at_f64};
use crate::flow::octaves::{Octave, OctaveSpan};
use crate::flow::potential::{Psi, uniform};
use crate::flow::ramp::removed;
use crate::flow::walls::{NOTICE, NearWalls};
use crate::math::real::{Lane, Real, cross, dot, triple};
use glam::DVec3;
use std::f64::consts::TAU;

/// Particles are pushed this share of an obstacle's size beyond its wall.
const PUSH: f64 = 1e-4;

/// A potential with one influence radius.
#[derive(Debug, Clone)]
pub enum Source {
    /// The same velocity everywhere [m/s].
    Uniform {
        /// Velocity [m/s].
        velocity: [f64; 3],
        /// Influence radius [m]; the obstacle's own size where `None`.
        influence: Option<f64>,
    },
    /// Swirls of one size, which is also the influence radius.
    Octave(Octave),
}

/// Divergence-free velocity round obstacles.
#[derive(Debug, Clone)]
pub struct VelocityField {
    sources: Vec<Source>,
    obstacles: Vec<Obstacle>,
    notice: f64,
}

/// The field over a span of time, with everything worked out that depends on time alone.
///
/// Within a span the obstacles' constants follow a parabola through their values at start, middle and end: any constant
/// in space keeps walls tight, and this one costs nothing.
#[derive(Debug, Clone)]
pub struct FieldSpan<'a> {
    field: &'a VelocityField,
    sources: Vec<SourceSpan>,
}

#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant, reason = "a dozen of them, made once a step")]
enum SourceSpan {
    Uniform { velocity: [f64; 3], walls: Vec<UniformWall> },
    Octave { span: OctaveSpan, walls: Vec<OctaveWall> },
}

/// What a constant wind loses at a wall: `½V × (x − x_ref)`, with V the wind, or at a plane its normal part alone, for
/// wind along a plane is no excess.
#[derive(Debug, Clone)]
struct UniformWall {
    influence: f64,
    velocity: DVec3,
    reference: DVec3,
    hole: Option<(Hole, Parabola)>,
}

#[derive(Debug, Clone)]
struct OctaveWall {
    influence: f64,
    constant: [Parabola; 3],
    hole: Option<(Hole, Parabola)>,
}

/// `a + phase·(b + phase·c)`.
#[derive(Debug, Clone, Copy)]
struct Parabola {
    coefficients: [f64; 3],
}

impl Parabola {
    fn constant(value: f64) -> Self {
        Self { coefficients: [value, 0.0, 0.0] }
    }

    /// Through the values at phases 0, ½ and 1.
    fn through(v: [f64; 3]) -> Self {
        Self { coefficients: [v[0], -3.0 * v[0] + 4.0 * v[1] - v[2], 2.0 * v[0] - 4.0 * v[1] + 2.0 * v[2]] }
    }

    #[inline(always)]
    fn at<L: Real>(&self, phase: L) -> L {
        let [a, b, c] = triple!(i => phase.lit(self.coefficients[i]));
        phase.mul_add(phase.mul_add(c, b), a)
    }
}

impl VelocityField {
    /// The field of the given potentials round the given obstacles.
    pub fn new(sources: Vec<Source>, obstacles: Vec<Obstacle>) -> Self {
        let notice = sources
            .iter()
            .flat_map(|s| obstacles.iter().map(|o| o.influence(s.wanted_influence(o))))
            .fold(0.0, f64::max)
            * NOTICE;
        Self { sources, obstacles, notice }
    }

    /// The obstacles.
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.obstacles
    }

    /// Signed distance to the closest obstacle [m], negative inside, infinite without obstacles.
    #[inline(never)]
    pub fn distance<L: Lane>(&self, p: [L; 3]) -> L {
        let mut least = p[0].lit(f64::INFINITY);
        for solid in self.obstacles.iter().flat_map(Obstacle::solids) {
            least = least.min(solid.distance(p));
        }
        least
    }

    /// True when any lane may be inside an obstacle; false when certainly none is, by a margin for rounding.
    #[inline(never)]
    pub fn may_be_inside<L: Lane>(&self, p: [L; 3]) -> bool {
        p[0].outlined(
            #[inline(always)]
            || self.may_be_inside_here(p),
        )
    }

    #[inline(always)]
    fn may_be_inside_here<L: Lane>(&self, p: [L; 3]) -> bool {
        for obstacle in &self.obstacles {
            let margin = 1e-3 * obstacle.size();
            if !obstacle.may_be_within(p, margin) {
                continue;
            }
            for solid in obstacle.solids() {
                if solid.distance(p).any_lt(p[0].lit(margin)) {
                    return true;
                }
            }
        }
        false
    }

    /// `p` if it is outside all obstacles, else a point just outside, found along the gradients of the distances;
    /// and whether it moved. A point that no number of corrections brings out stays where the last one left it.
    #[inline(never)]
    pub fn pushed_out(&self, p: [f32; 3]) -> ([f32; 3], bool) {
        let is_outside = |p: [f32; 3]| self.distance(p.map(f64::from)) >= 0.0;
        if is_outside(p) {
            return (p, false);
        }
        let mut q = p.map(f64::from);
        for attempt in 0..32 {
            for (obstacle, solid) in self.obstacles.iter().flat_map(|o| o.solids().iter().map(move |s| (o, s))) {
                let jet = at_f64(solid, DVec3::from_array(q));
                if jet.value < 0.0 {
                    let g = DVec3::from_array(jet.gradient);
                    // Far enough that the next steps' errors do not lead back in at once; farther at each attempt,
                    // for two walls may push against each other, and rounding to single precision may lead back.
                    let coordinate = q.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
                    let margin = f64::from(1u32 << attempt.min(16)) * (PUSH * obstacle.size() + 1e-7 * coordinate);
                    let direction = if g.length_squared() > 1e-12 { g / g.length_squared() } else { DVec3::Y };
                    q = (DVec3::from_array(q) + direction * (margin - jet.value)).to_array();
                }
            }
            let rounded = q.map(|x| x as f32);
            if is_outside(rounded) {
                return (rounded, true);
            }
        }
        (q.map(|x| x as f32), true)
    }

    /// The field from `start` [s], lasting `duration` [s].
    pub fn span(&self, start: f64, duration: f64) -> FieldSpan<'_> {
        let sources = self.sources.iter().map(|s| s.span(&self.obstacles, start, duration)).collect();
        FieldSpan { field: self, sources }
    }

    /// Velocity [m/s] at a point and a time [s], in double precision: the truth that lanes are held against.
    pub fn velocity(&self, p: [f64; 3], time: f64) -> [f64; 3] {
        self.span(time, 0.0).velocity(p, 0.0)
    }
}

impl Source {
    fn wanted_influence(&self, obstacle: &Obstacle) -> f64 {
        match self {
            Self::Uniform { influence, .. } => influence.unwrap_or(obstacle.size()),
            Self::Octave(octave) => octave.length(),
        }
    }

    fn span(&self, obstacles: &[Obstacle], start: f64, duration: f64) -> SourceSpan {
        let influence = |o: &Obstacle| o.influence(self.wanted_influence(o));
        match self {
            Self::Uniform { velocity, .. } => {
                let walls = obstacles.iter().map(|o| uniform_wall(*velocity, o, influence(o))).collect();
                SourceSpan::Uniform { velocity: *velocity, walls }
            }
            Self::Octave(octave) => {
                let span = octave.span(start, duration);
                let walls = obstacles.iter().map(|o| octave_wall(&span, o, influence(o))).collect();
                SourceSpan::Octave { span, walls }
            }
        }
    }
}

fn uniform_wall(velocity: [f64; 3], obstacle: &Obstacle, influence: f64) -> UniformWall {
    let velocity = DVec3::from_array(velocity);
    let hole = obstacle.hole().map(|h| (h, Parabola::constant(0.5 * velocity.dot(h.axis) * h.radius * h.radius)));
    let velocity = obstacle.plane_normal().map_or(velocity, |n| n * n.dot(velocity));
    UniformWall { influence, velocity, reference: obstacle.reference(), hole }
}

fn octave_wall(span: &OctaveSpan, obstacle: &Obstacle, influence: f64) -> OctaveWall {
    // An obstacle larger than the swirls has no use for the potential at one point: its mean is zero.
    let ratio = obstacle.size() / span.octave().length();
    let share = if obstacle.is_endless() { 0.0 } else { 1.0 / (1.0 + ratio * ratio) };
    let reference = obstacle.reference().to_array();
    let values = [0.0, 0.5, 1.0].map(|phase| span.psi(reference, phase).value);
    let constant = std::array::from_fn(|c| Parabola::through(values.map(|v| share * v[c])));
    let hole =
        obstacle.hole().map(|h| (h, Parabola::through([0.0, 0.5, 1.0].map(|phase| circulation(span, &h, phase)))));
    OctaveWall { influence, constant, hole }
}

/// ∮ψ·dl/2π round a hole: the flux through it, divided by 2π.
fn circulation(span: &OctaveSpan, hole: &Hole, phase: f64) -> f64 {
    const POINTS: u32 = 24;
    let (u, v) = hole.axis.any_orthonormal_pair();
    // Right-handed about the axis.
    let v = if u.cross(v).dot(hole.axis) < 0.0 { -v } else { v };
    (0..POINTS)
        .map(|i| {
            let (sin, cos) = (TAU * f64::from(i) / f64::from(POINTS)).sin_cos();
            let p = hole.center + hole.radius * (u * cos + v * sin);
            let psi = DVec3::from_array(span.psi(p.to_array(), phase).value);
            psi.dot(v * cos - u * sin) * hole.radius / f64::from(POINTS)
        })
        .sum()
}

/// `∇φ`, with φ the angle about the hole's axis: no curl, and circulation 2π, so that times a constant it may be kept on
/// the wall of a ring and lets a flux through the hole.
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

#[inline(always)]
fn without_circulation<L: Real>(excess: Psi<L>, hole: &Option<(Hole, Parabola)>, p: [L; 3], phase: L) -> Psi<L> {
    match hole {
        Some((hole, circulation)) => excess.minus(&angle_gradient(hole, p).scaled(circulation.at(phase))),
        None => excess,
    }
}

impl FieldSpan<'_> {
    /// Velocity [m/s] at `p` [m]; `phase` runs from 0 at the start of the span to 1 at its end.
    #[inline(never)]
    pub fn velocity<L: Lane>(&self, p: [L; 3], phase: L) -> [L; 3] {
        phase.outlined(
            #[inline(always)]
            || self.velocity_here(p, phase),
        )
    }

    #[inline(always)]
    fn velocity_here<L: Lane>(&self, p: [L; 3], phase: L) -> [L; 3] {
        let near = NearWalls::find(&self.field.obstacles, p, self.field.notice);
        let zero = phase.lit(0.0);
        let mut velocity = [zero; 3];
        for source in &self.sources {
            let v = match source {
                SourceSpan::Uniform { velocity, walls } => {
                    let mut v = triple!(i => phase.lit(velocity[i]));
                    for near_wall in near.iter() {
                        let own = &walls[near_wall.obstacle_idx];
                        let Some(wall) = near_wall.wall(own.influence) else { continue };
                        let excess = uniform(own.velocity.to_array(), own.reference.to_array(), p);
                        let lost = curl(&removed(&without_circulation(excess, &own.hole, p, phase), &wall));
                        v = triple!(i => v[i] - lost[i]);
                    }
                    v
                }
                SourceSpan::Octave { span, walls } => {
                    let psi = span.psi(p, phase);
                    let mut v = curl(&psi);
                    for near_wall in near.iter() {
                        let own = &walls[near_wall.obstacle_idx];
                        let Some(wall) = near_wall.wall(own.influence) else { continue };
                        let mut excess = psi;
                        for c in 0..3 {
                            excess.value[c] = psi.value[c] - own.constant[c].at(phase);
                        }
                        let lost = curl(&removed(&without_circulation(excess, &own.hole, p, phase), &wall));
                        v = triple!(i => v[i] - lost[i]);
                    }
                    v
                }
            };
            velocity = triple!(i => velocity[i] + v[i]);
        }
        velocity
    }
}
