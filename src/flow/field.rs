//! The velocity field: the curl of the sum of all potentials, each bent round all obstacles.

use crate::flow::curl::curl;
use crate::flow::elements::{Column, Shear, rigid};
use crate::flow::mask::Mask;
use crate::flow::obstacles::{Boundary, Hole, Obstacle};
use crate::flow::octaves::{Octave, OctaveSpan};
use crate::flow::potential::{Psi, uniform};
use crate::flow::ramp::removed;
use crate::flow::vortex::{Vortex, VortexSpan};
use crate::flow::walls::{NOTICE, NearWall, NearWalls};
use crate::geometry::motion::RigidSpan;
use crate::math::real::{Lane, Real, cross, dot, triple};
use glam::DVec3;
use std::f64::consts::TAU;

/// Particles are pushed this share of an obstacle's size beyond its wall.
const PUSH: f64 = 1e-4;

/// What swirls and streams, before there are walls.
#[derive(Debug, Clone)]
pub enum Potential {
    /// The same velocity everywhere.
    Uniform {
        /// Velocity [m/s].
        velocity: DVec3,
        /// Where the potential is zero [m].
        origin: DVec3,
    },
    /// Layers that slide along each other.
    Shear(Shear),
    /// `velocity + angular_velocity × (x − center)`.
    Rigid {
        /// Velocity of the centre [m/s].
        velocity: DVec3,
        /// Angular velocity [rad/s].
        angular_velocity: DVec3,
        /// A point of the axis [m].
        center: DVec3,
    },
    /// A rising column.
    Column(Column),
    /// A whirl about a point or along a line.
    Vortex(Vortex),
    /// Swirls of one size.
    Octave(Octave),
}

/// A potential with its masks.
#[derive(Debug, Clone)]
pub struct Source {
    /// The potential.
    pub potential: Potential,
    /// What it is multiplied with.
    pub masks: Vec<Mask>,
    /// Distance from obstacles over which it bends [m]; where `None` that is its own length, or for potentials without
    /// one the obstacle's size.
    pub influence: Option<f64>,
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
/// Within a span obstacles move at constant velocity and turn at constant angular velocity, and their constants follow a
/// parabola through their values at start, middle and end: any constant in space keeps walls tight, and this one costs
/// nothing.
#[derive(Debug, Clone)]
pub struct FieldSpan<'a> {
    field: &'a VelocityField,
    sources: Vec<SourceSpan<'a>>,
    /// Of each obstacle, `None` for those at rest.
    motions: Vec<Option<RigidSpan>>,
}

#[derive(Debug, Clone)]
struct SourceSpan<'a> {
    potential: PotentialSpan,
    masks: &'a [Mask],
    walls: Vec<SourceWall>,
}

#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant, reason = "a dozen of them, made once a step")]
enum PotentialSpan {
    Uniform { velocity: DVec3, origin: DVec3 },
    Shear(Shear),
    Rigid { velocity: DVec3, angular_velocity: DVec3, center: DVec3 },
    Column(Column),
    Vortex(VortexSpan),
    Octave(OctaveSpan),
}

/// How a source stands to an obstacle.
#[derive(Debug, Clone)]
struct SourceWall {
    influence: f64,
    gauge: Gauge,
    hole: Option<(Hole, Parabola)>,
}

/// What a potential is compared with at a wall: the excess over it is removed.
#[derive(Debug, Clone)]
enum Gauge {
    /// The excess is the potential less a constant.
    Constant([Parabola; 3]),
    /// The excess of a wind V is `½V × (x − reference)`, where V is only the normal part at a plane, for wind along it is
    /// no excess; `sliding` is that wind's potential for each metre from the plane, where the plane holds it fast.
    Wind { velocity: DVec3, reference: [Parabola; 3], sliding: Option<DVec3> },
}

/// `a + phase·(b + phase·c)`.
#[derive(Debug, Clone, Copy)]
struct Parabola {
    coefficients: [f64; 3],
}

impl Parabola {
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

/// Where parabolas are taken.
const PHASES: [f64; 3] = [0.0, 0.5, 1.0];

impl From<Potential> for Source {
    fn from(potential: Potential) -> Self {
        Self { potential, masks: Vec::new(), influence: None }
    }
}

impl Source {
    /// Wind of the same velocity [m/s] everywhere.
    pub fn wind(velocity: [f64; 3]) -> Self {
        Potential::Uniform { velocity: DVec3::from_array(velocity), origin: DVec3::ZERO }.into()
    }

    fn wanted_influence(&self, obstacle: &Obstacle) -> f64 {
        self.influence.or_else(|| self.potential.length()).unwrap_or(obstacle.size())
    }

    fn span(&self, obstacles: &[Obstacle], motions: &[Option<RigidSpan>], start: f64, duration: f64) -> SourceSpan<'_> {
        let mut span =
            SourceSpan { potential: self.potential.span(start, duration), masks: &self.masks, walls: Vec::new() };
        for (obstacle, motion) in obstacles.iter().zip(motions) {
            let influence = obstacle.influence(self.wanted_influence(obstacle));
            let reference = |phase: f64| motion.map_or(obstacle.reference().to_array(), |motion| motion.center(phase));
            let hole = obstacle.hole().map(|hole| {
                (hole, Parabola::through(PHASES.map(|phase| circulation(|p| span.psi(p, phase).value, &hole))))
            });
            let gauge = match &self.potential {
                Potential::Uniform { velocity, .. } if self.masks.is_empty() => {
                    let normal = obstacle.plane_normal();
                    let across = normal.map_or(*velocity, |n| n * n.dot(*velocity));
                    let is_fast = obstacle.boundary() == Boundary::NoSlip;
                    let sliding = normal.filter(|_| is_fast).map(|n| velocity.cross(n));
                    let references = PHASES.map(reference);
                    let reference = std::array::from_fn(|i| Parabola::through(references.map(|r| r[i])));
                    Gauge::Wind { velocity: across, reference, sliding }
                }
                potential => {
                    let share = potential.constant_share(obstacle);
                    let values = PHASES.map(|phase| span.psi(reference(phase), phase).value);
                    Gauge::Constant(std::array::from_fn(|c| Parabola::through(values.map(|v| share * v[c]))))
                }
            };
            span.walls.push(SourceWall { influence, gauge, hole });
        }
        span
    }
}

impl Potential {
    /// Size of its features, where it has one [m].
    fn length(&self) -> Option<f64> {
        match self {
            Self::Vortex(vortex) => Some(vortex.radius()),
            Self::Octave(octave) => Some(octave.length()),
            _ => None,
        }
    }

    /// How much of the potential at its reference point an obstacle takes for its constant. One that is larger than the
    /// features has no use for their potential at one point: its mean is zero.
    fn constant_share(&self, obstacle: &Obstacle) -> f64 {
        match self.length() {
            None => 1.0,
            Some(_) if obstacle.is_endless() => 0.0,
            Some(length) => 1.0 / (1.0 + (obstacle.size() / length).powi(2)),
        }
    }

    fn span(&self, start: f64, duration: f64) -> PotentialSpan {
        match self {
            Self::Uniform { velocity, origin } => PotentialSpan::Uniform { velocity: *velocity, origin: *origin },
            Self::Shear(shear) => PotentialSpan::Shear(*shear),
            &Self::Rigid { velocity, angular_velocity, center } => {
                PotentialSpan::Rigid { velocity, angular_velocity, center }
            }
            Self::Column(column) => PotentialSpan::Column(*column),
            Self::Vortex(vortex) => PotentialSpan::Vortex(vortex.span(start, duration)),
            Self::Octave(octave) => PotentialSpan::Octave(octave.span(start, duration)),
        }
    }
}

impl SourceSpan<'_> {
    /// The potential with its masks, before there are walls.
    #[inline(always)]
    fn psi<L: Lane>(&self, p: [L; 3], phase: L) -> Psi<L> {
        let lane = |v: &DVec3| -> [L; 3] { triple!(i => phase.lit(v[i])) };
        let mut psi = match &self.potential {
            PotentialSpan::Uniform { velocity, origin } => uniform(lane(velocity), lane(origin), p),
            PotentialSpan::Shear(shear) => shear.psi(p),
            PotentialSpan::Rigid { velocity, angular_velocity, center } => {
                rigid(lane(velocity), lane(angular_velocity), lane(center), p)
            }
            PotentialSpan::Column(column) => column.psi(p),
            PotentialSpan::Vortex(vortex) => vortex.psi(p, phase),
            PotentialSpan::Octave(octave) => octave.psi(p, phase),
        };
        for mask in self.masks {
            psi = psi.modulated(&mask.at(p));
        }
        psi
    }

    /// What of the potential would pass the wall.
    #[inline(always)]
    fn excess<L: Lane>(&self, psi: &Psi<L>, near: &NearWall<L>, p: [L; 3], phase: L) -> Psi<L> {
        let own = &self.walls[near.obstacle_idx];
        let excess = match &own.gauge {
            Gauge::Constant(constant) => {
                let value = triple!(c => psi.value[c] - constant[c].at(phase));
                Psi { value, jacobian: psi.jacobian }
            }
            Gauge::Wind { velocity, reference, sliding } => {
                let across = uniform(triple!(i => phase.lit(velocity[i])), triple!(i => reference[i].at(phase)), p);
                match sliding {
                    None => across,
                    Some(sliding) => {
                        let (w, d) = (triple!(i => phase.lit(sliding[i])), near.distance());
                        across.plus(&Psi {
                            value: triple!(c => w[c] * d.value),
                            jacobian: triple!(c => triple!(i => w[c] * d.gradient[i])),
                        })
                    }
                }
            }
        };
        match &own.hole {
            Some((hole, flux)) => excess.minus(&angle_gradient(hole, p).scaled(flux.at(phase))),
            None => excess,
        }
    }

    fn is_planar(&self) -> bool {
        matches!(&self.potential, PotentialSpan::Octave(octave) if octave.octave().is_planar())
    }
}

impl VelocityField {
    /// The field of the given potentials round the given obstacles.
    pub fn new(sources: Vec<Source>, obstacles: Vec<Obstacle>) -> Self {
        let of_sources = sources.iter().flat_map(|s| obstacles.iter().map(|o| o.influence(s.wanted_influence(o))));
        let of_motions = obstacles.iter().map(|o| o.influence(o.size()));
        let notice = of_sources.chain(of_motions).fold(0.0, f64::max) * NOTICE;
        Self { sources, obstacles, notice }
    }

    /// The obstacles.
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.obstacles
    }

    /// The field from `start` [s], lasting `duration` [s].
    pub fn span(&self, start: f64, duration: f64) -> FieldSpan<'_> {
        let motions: Vec<_> = self.obstacles.iter().map(|o| o.span(start, duration)).collect();
        let sources = self.sources.iter().map(|s| s.span(&self.obstacles, &motions, start, duration)).collect();
        FieldSpan { field: self, sources, motions }
    }

    /// Velocity [m/s] at a point and a time [s], in double precision: the truth that lanes are held against.
    pub fn velocity(&self, p: [f64; 3], time: f64) -> [f64; 3] {
        self.span(time, 0.0).velocity(p, 0.0)
    }

    /// Signed distance to the closest wall [m] at a time [s]. Of many points ask a [`FieldSpan`].
    pub fn distance(&self, p: [f64; 3], time: f64) -> f64 {
        self.span(time, 0.0).distance(p, 0.0)
    }
}

/// ∮ψ·dl/2π round a hole: the flux through it, divided by 2π.
fn circulation(psi: impl Fn([f64; 3]) -> [f64; 3], hole: &Hole) -> f64 {
    const POINTS: u32 = 24;
    let (u, v) = hole.axis.any_orthonormal_pair();
    // Right-handed about the axis.
    let v = if u.cross(v).dot(hole.axis) < 0.0 { -v } else { v };
    (0..POINTS)
        .map(|i| {
            let (sin, cos) = (TAU * f64::from(i) / f64::from(POINTS)).sin_cos();
            let p = hole.center + hole.radius * (u * cos + v * sin);
            DVec3::from_array(psi(p.to_array())).dot(v * cos - u * sin) * hole.radius / f64::from(POINTS)
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
        let near = NearWalls::find(&self.field.obstacles, &self.motions, p, phase, self.field.notice);
        let zero = phase.lit(0.0);
        let mut velocity = [zero; 3];
        for source in &self.sources {
            let psi = source.psi(p, phase);
            let mut v = curl(&psi);
            for near_wall in near.iter() {
                let influence = source.walls[near_wall.obstacle_idx].influence;
                let Some(mut wall) = near_wall.wall(influence) else { continue };
                if source.is_planar() {
                    // Equation 3: a stream function has no part along the normal.
                    wall.normal = None;
                }
                let lost = curl(&removed(&source.excess(&psi, near_wall, p, phase), &wall));
                v = triple!(i => v[i] - lost[i]);
            }
            velocity = triple!(i => velocity[i] + v[i]);
        }
        for near_wall in near.iter() {
            let Some(motion) = &self.motions[near_wall.obstacle_idx] else { continue };
            let obstacle = &self.field.obstacles[near_wall.obstacle_idx];
            let Some(wall) = near_wall.wall(obstacle.influence(obstacle.size())) else { continue };
            let (v, w) = (motion.velocity(), motion.angular_velocity());
            let body = rigid(triple!(i => zero.lit(v[i])), triple!(i => zero.lit(w[i])), motion.center(phase), p);
            let carried = curl(&removed(&body, &wall));
            velocity = triple!(i => velocity[i] + carried[i]);
        }
        velocity
    }

    /// Signed distance to the closest wall [m], negative where the flow must not be, infinite without obstacles.
    #[inline(never)]
    pub fn distance<L: Lane>(&self, p: [L; 3], phase: L) -> L {
        let mut least = p[0].lit(f64::INFINITY);
        for (obstacle, motion) in self.field.obstacles.iter().zip(&self.motions) {
            least = least.min(obstacle.distance(motion.as_ref(), p, phase));
        }
        least
    }

    /// Velocity of the closest wall [m/s] at `p` [m]; 0 where it is at rest, or without obstacles.
    pub fn wall_velocity(&self, p: [f64; 3], phase: f64) -> [f64; 3] {
        let distances = self.field.obstacles.iter().zip(&self.motions);
        let closest = distances
            .map(|(obstacle, motion)| (obstacle.distance(motion.as_ref(), p, phase), motion))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        closest.and_then(|(_, motion)| *motion).map_or([0.0; 3], |motion| motion.velocity_at(p, phase))
    }

    /// True when any lane may be inside an obstacle; false when certainly none is, by a margin for rounding.
    #[inline(never)]
    pub fn may_be_inside<L: Lane>(&self, p: [L; 3], phase: L) -> bool {
        p[0].outlined(
            #[inline(always)]
            || self.may_be_inside_here(p, phase),
        )
    }

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn may_be_inside_here<L: Lane>(&self, p: [L; 3], phase: L) -> bool {
        for i in 0..self.motions.len() {
            let (obstacle, motion) = (&self.field.obstacles[i], self.motions[i].as_ref());
            let margin = 1e-3 * obstacle.size();
            if obstacle.may_be_within(motion, p, phase, margin)
                && obstacle.distance(motion, p, phase).any_lt(p[0].lit(margin))
            {
                return true;
            }
        }
        false
    }

    /// The point moved out of all obstacles if it is inside one, just beyond the wall, and whether it moved. A point that
    /// no number of corrections brings out stays where the last one left it.
    #[inline(never)]
    pub fn pushed_out(&self, p: [f32; 3], phase: f64) -> ([f32; 3], bool) {
        let is_outside = |p: [f32; 3]| self.distance(p.map(f64::from), phase) >= 0.0;
        if is_outside(p) {
            return (p, false);
        }
        let mut q = p.map(f64::from);
        for attempt in 0..32 {
            for (obstacle, motion) in self.field.obstacles.iter().zip(&self.motions) {
                let distance = obstacle.distance(motion.as_ref(), q, phase);
                if distance < 0.0 {
                    let g = obstacle.gradient(motion.as_ref(), q, phase);
                    // Far enough that the next steps' errors do not lead back in at once; farther at each attempt,
                    // for two walls may push against each other, and rounding to single precision may lead back.
                    let coordinate = q.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
                    let margin = f64::from(1u32 << attempt.min(16)) * (PUSH * obstacle.size() + 1e-7 * coordinate);
                    let direction = if g.length_squared() > 1e-12 { g / g.length_squared() } else { DVec3::Y };
                    q = (DVec3::from_array(q) + direction * (margin - distance)).to_array();
                }
            }
            let rounded = q.map(|x| x as f32);
            if is_outside(rounded) {
                return (rounded, true);
            }
        }
        (q.map(|x| x as f32), true)
    }
}
