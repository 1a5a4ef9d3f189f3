//! The velocity field: the curl of the sum of all potentials, each bent round all obstacles.

use crate::flow::curl::curl;
use crate::flow::elements::{Column, Shear, rigid};
use crate::flow::gauge::{HoleFlux, Parabola, WindExcess, reference_at};
use crate::flow::mask::Mask;
use crate::flow::obstacles::{Boundary, Ground, Obstacle};
use crate::flow::octaves::{Drift, Form, Octave, OctaveSpan};
use crate::flow::potential::{Psi, uniform};
use crate::flow::ramp::removed;
use crate::flow::vortex::{Vortex, VortexSpan};
use crate::flow::walls::{NOTICE, NearObstacle, NearWalls};
use crate::geometry::motion::RigidSpan;
use crate::math::jet::Scalar;
use crate::math::real::{Lane, cross, dot, length, triple};
use glam::DVec3;

/// Sampled distances change by up to so many metres for each metre.
const STEEPEST: f64 = 1.2;
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
    /// one the obstacle's girth or size.
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
    carriers: Vec<Option<Carrier>>,
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
    hole: Option<HoleFlux>,
}

/// What a potential is compared with at a wall: the excess over it is removed.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant, reason = "a few of them, made once a step")]
enum Gauge {
    /// The excess is the potential less a constant.
    Constant([Parabola; 3]),
    /// Over a ground with this normal and height along it, what the potential does with height moves along the ground, and
    /// slides: there the excess is the potential along the ground at the point below, less a constant.
    Sliding { normal: DVec3, offset: f64, constant: [Parabola; 3] },
    /// The excess is that of a wind.
    Wind(WindExcess),
}

/// A moving obstacle, and what its motion carries along.
#[derive(Debug, Clone)]
struct Carrier {
    motion: RigidSpan,
    wind: WindExcess,
    hole: Option<HoleFlux>,
    influence: f64,
}

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
        self.influence.or_else(|| self.potential.length()).unwrap_or_else(|| {
            let is_fitted = self.is_wind() && !obstacle.holds_what_stands_on_it();
            if is_fitted { obstacle.girth() } else { obstacle.size() }
        })
    }

    /// Whether it is a uniform velocity, whose excess is fitted to obstacles. The excess of others grows away from the
    /// reference point of a slender body, and a narrow ramp would make a jet of it.
    fn is_wind(&self) -> bool {
        matches!(self.potential, Potential::Uniform { .. }) && self.masks.is_empty()
    }

    fn span(&self, obstacles: &[Obstacle], motions: &[Option<RigidSpan>], start: f64, duration: f64) -> SourceSpan<'_> {
        let mut span =
            SourceSpan { potential: self.potential.span(start, duration), masks: &self.masks, walls: Vec::new() };
        for (obstacle, motion) in obstacles.iter().zip(motions) {
            let motion = motion.as_ref();
            let influence = obstacle.influence(self.wanted_influence(obstacle));
            let hole = obstacle.hole().filter(|_| span.is_vector());
            let hole = hole.map(|hole| HoleFlux::new(hole, motion, |p, phase| span.psi(p, phase).value));
            let gauge = match &self.potential {
                Potential::Uniform { velocity, .. } if self.is_wind() => {
                    Gauge::Wind(WindExcess::new(*velocity, obstacle, motion))
                }
                potential => {
                    let share = potential.constant_share(obstacle);
                    let value = |phase| span.psi(reference_at(obstacle, motion, phase), phase).value;
                    let constant = std::array::from_fn(|c| Parabola::through(|phase| share * value(phase)[c]));
                    let is_sliding = obstacle.boundary() == Boundary::Slip && potential.length().is_none();
                    match obstacle.ground().filter(|_| is_sliding) {
                        Some(Ground { normal, .. }) => {
                            Gauge::Sliding { normal, offset: normal.dot(obstacle.reference()), constant }
                        }
                        None => Gauge::Constant(constant),
                    }
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

/// Not on a ground.
const NOWHERE: Scalar<f64> = Scalar { value: 0.0, gradient: [0.0; 3] };

impl Carrier {
    fn new(obstacle: &Obstacle, motion: RigidSpan) -> Self {
        let wind = WindExcess::new(motion.velocity(), obstacle, Some(&motion));
        // Only the potential of a translation is fitted to the body.
        let is_turning = motion.angular_velocity().length_squared() > 0.0;
        let influence = if is_turning { obstacle.size() } else { obstacle.girth() };
        let mut carrier = Self { motion, wind, hole: None, influence };
        // What a ring moves is itself: the air in its hole stays where it is, on the whole.
        carrier.hole = obstacle
            .hole()
            .map(|hole| HoleFlux::new(hole, Some(&motion), |p, phase| carrier.psi(p, phase, &NOWHERE).value));
        carrier
    }

    fn influence(&self) -> f64 {
        self.influence
    }

    /// The potential of the body's own motion (eq. 6 with the corrected linear term), less the flux through its hole.
    #[inline(always)]
    fn psi<L: Lane>(&self, p: [L; 3], phase: L, on_ground: &Scalar<L>) -> Psi<L> {
        let w = self.motion.angular_velocity();
        let at_rest = [phase.lit(0.0); 3];
        let turning = rigid(at_rest, triple!(i => phase.lit(w[i])), self.motion.center(phase), p);
        let body = turning.plus(&self.wind.at(p, phase, on_ground));
        match &self.hole {
            Some(hole) => body.minus(&hole.at(Some(&self.motion), p, phase)),
            None => body,
        }
    }
}

impl SourceSpan<'_> {
    /// As [`SourceSpan::psi`], carried by the larger octaves of the same noise that came before it.
    #[inline(always)]
    fn carried_psi<L: Lane>(&self, p: [L; 3], phase: L, drift: &mut Drift<L>) -> Psi<L> {
        let PotentialSpan::Octave(octave) = &self.potential else { return self.psi(p, phase) };
        if !octave.octave().has_memory() {
            return self.psi(p, phase);
        }
        if octave.octave().is_largest() {
            *drift = Drift::none(phase);
        }
        let (psi, more) = octave.carried(p, phase, drift);
        *drift = more;
        self.masked(psi, p)
    }

    /// The potential with its masks, before there are walls. Of bitangents the two scalars, the first of them masked.
    #[inline(never)]
    fn psi<L: Lane>(&self, p: [L; 3], phase: L) -> Psi<L> {
        phase.outlined(
            #[inline(always)]
            || self.psi_here(p, phase),
        )
    }

    #[inline(always)]
    fn psi_here<L: Lane>(&self, p: [L; 3], phase: L) -> Psi<L> {
        let lane = |v: &DVec3| -> [L; 3] { triple!(i => phase.lit(v[i])) };
        let psi = match &self.potential {
            PotentialSpan::Uniform { velocity, origin } => uniform(lane(velocity), lane(origin), p),
            PotentialSpan::Shear(shear) => shear.psi(p),
            PotentialSpan::Rigid { velocity, angular_velocity, center } => {
                rigid(lane(velocity), lane(angular_velocity), lane(center), p)
            }
            PotentialSpan::Column(column) => column.psi(p),
            PotentialSpan::Vortex(vortex) => vortex.psi(p, phase),
            PotentialSpan::Octave(octave) => octave.psi(p, phase),
        };
        self.masked(psi, p)
    }

    #[inline(always)]
    fn masked<L: Lane>(&self, mut psi: Psi<L>, p: [L; 3]) -> Psi<L> {
        for mask in self.masks {
            let modulated = psi.modulated(&mask.at(p));
            psi = match &self.potential {
                PotentialSpan::Octave(octave) if octave.octave().form() == Form::Bitangent => Psi {
                    value: [modulated.value[0], psi.value[1], psi.value[2]],
                    jacobian: [modulated.jacobian[0], psi.jacobian[1], psi.jacobian[2]],
                },
                _ => modulated,
            };
        }
        psi
    }

    /// What of the potential would pass the wall.
    #[inline(always)]
    fn excess<L: Lane>(
        &self,
        psi: &Psi<L>,
        near: &NearObstacle<L>,
        motion: Option<&RigidSpan>,
        p: [L; 3],
        phase: L,
    ) -> Psi<L> {
        let own = &self.walls[near.obstacle_idx];
        let less = |psi: &Psi<L>, constant: &[Parabola; 3]| Psi {
            value: triple!(c => psi.value[c] - constant[c].at(phase)),
            jacobian: psi.jacobian,
        };
        let excess = match &own.gauge {
            Gauge::Constant(constant) => less(psi, constant),
            Gauge::Sliding { normal, offset, constant } => {
                let n: [L; 3] = triple!(i => phase.lit(normal[i]));
                let height = dot(n, p) - phase.lit(*offset);
                let below = self.psi(triple!(i => p[i] - height * n[i]), phase);
                // The point below moves along the ground alone, and what points out of the ground has a flow along it.
                // So all but the rest may stay, and at what stands on the ground it is zero.
                let jacobian: [[L; 3]; 3] = triple!(c => {
                    let along = dot(below.jacobian[c], n);
                    triple!(i => below.jacobian[c][i] - along * n[i])
                });
                let out = dot(n, below.value);
                let d_out: [L; 3] = triple!(i => {
                    dot(n, [jacobian[0][i], jacobian[1][i], jacobian[2][i]])
                });
                let along = Psi {
                    value: triple!(c => below.value[c] - out * n[c]),
                    jacobian: triple!(c => triple!(i => jacobian[c][i] - d_out[i] * n[c])),
                };
                less(psi, constant).minus(&psi.minus(&along).modulated(near.on_ground()))
            }
            Gauge::Wind(wind) => wind.at(p, phase, near.on_ground()),
        };
        match &own.hole {
            Some(hole) => excess.minus(&hole.at(motion, p, phase)),
            None => excess,
        }
    }

    /// Whether the potential is a vector, and no stream function or pair of scalars.
    #[inline(always)]
    fn is_vector(&self) -> bool {
        match &self.potential {
            PotentialSpan::Octave(octave) => octave.octave().form() == Form::Curl,
            _ => true,
        }
    }

    /// The velocity [m/s] of what walls have left of a potential.
    #[inline(always)]
    fn velocity<L: Lane>(&self, psi: &Psi<L>, kept: &Psi<L>) -> [L; 3] {
        match &self.potential {
            // Of the two scalars walls and masks bend the first alone.
            PotentialSpan::Octave(octave) if octave.octave().form() == Form::Bitangent => {
                cross(kept.jacobian[0], psi.jacobian[1])
            }
            _ => curl(kept),
        }
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
        let carriers = self.obstacles.iter().zip(&motions).map(|(o, m)| m.map(|m| Carrier::new(o, m))).collect();
        FieldSpan { field: self, sources, motions, carriers }
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
        let mut drift = Drift::none(phase);
        for source in &self.sources {
            let psi = source.carried_psi(p, phase, &mut drift);
            let mut kept = psi;
            let mut first = 0;
            while let Some(obstacle_idx) = near.obstacle(first) {
                let influence = source.walls[obstacle_idx].influence;
                let (found, next) = near.near_obstacle(first, influence);
                first = next;
                let Some(mut found) = found else { continue };
                if !source.is_vector() {
                    // Equation 3: a scalar has no part along the normal.
                    found.wall.normal = None;
                }
                let motion = self.motions[obstacle_idx].as_ref();
                kept = kept.minus(&removed(&source.excess(&psi, &found, motion, p, phase), &found.wall));
            }
            let v = source.velocity(&psi, &kept);
            velocity = triple!(i => velocity[i] + v[i]);
        }
        let mut first = 0;
        while let Some(obstacle_idx) = near.obstacle(first) {
            let obstacle = &self.field.obstacles[obstacle_idx];
            let reach = self.carriers[obstacle_idx].as_ref().map_or(1.0, Carrier::influence);
            let (found, next) = near.near_obstacle(first, obstacle.influence(reach));
            first = next;
            let (Some(carrier), Some(found)) = (&self.carriers[obstacle_idx], found) else { continue };
            let carried = curl(&removed(&carrier.psi(p, phase, found.on_ground()), &found.wall));
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

    /// Negative in lanes whose straight step from `from` at `phase` to `to` at the end of the span [m] may have ended
    /// inside an obstacle or passed through one; `None` where certainly none has.
    #[inline(never)]
    pub fn suspicion<L: Lane>(&self, from: [L; 3], phase: L, to: [L; 3]) -> Option<L> {
        phase.outlined(
            #[inline(always)]
            || self.suspicion_here(from, phase, to),
        )
    }

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn suspicion_here<L: Lane>(&self, from: [L; 3], phase: L, to: [L; 3]) -> Option<L> {
        let (zero, end) = (phase.lit(0.0), phase.lit(1.0));
        let way = length(triple!(i => to[i] - from[i])) * phase.lit(STEEPEST);
        let mut least = end;
        for i in 0..self.motions.len() {
            let (obstacle, motion) = (&self.field.obstacles[i], self.motions[i].as_ref());
            let coordinate = to[0].abs().max(to[1].abs()).max(to[2].abs());
            let rounding = coordinate.mul_add(phase.lit(2e-6), phase.lit(2e-5 * obstacle.size()));
            let reach = way + phase.lit(self.wall_travel(i)) + rounding;
            for solid_idx in 0..obstacle.solids().len() {
                if !obstacle.may_be_within(solid_idx, motion, to, end, reach) {
                    continue;
                }
                let after = obstacle.solid_distance(solid_idx, motion, to, end);
                least = least.min(after - rounding);
                // The empty balls round both ends hold the whole way.
                if !after.any_lt(reach)
                    || !(after + obstacle.solid_distance(solid_idx, motion, from, phase)).any_lt(reach)
                {
                    continue;
                }
                let before = obstacle.wall(solid_idx, motion, from, phase).0;
                let gradient = obstacle.wall(solid_idx, motion, to, end).0.gradient;
                // What comes out on the other side of a wall sees it the other way round.
                let facing = dot(before.gradient, gradient);
                least = least.min((before.value + after).select_lt(reach, facing, end));
            }
        }
        if least.any_lt(zero) { Some(least) } else { None }
    }

    /// At most how far any point of an obstacle moves over the span [m].
    #[inline(always)]
    fn wall_travel(&self, obstacle_idx: usize) -> f64 {
        match &self.motions[obstacle_idx] {
            Some(motion) => motion.travel(2.0 * self.field.obstacles[obstacle_idx].size()),
            None => 0.0,
        }
    }

    /// Where a straight step from `from` at `phase` to `to` at the end of the span [m] may end: outside of all obstacles
    /// and on this side of thin ones; and whether it had to be corrected.
    #[inline(never)]
    pub fn settled(&self, from: [f32; 3], to: [f32; 3], phase: f64) -> ([f32; 3], bool) {
        let (end, moved) = self.pushed_out(to, 1.0);
        match self.stopped(from, end, phase) {
            Some(stopped) => (self.pushed_out(stopped, 1.0).0, true),
            None => (end, moved),
        }
    }

    /// Where the end of the span finds what was stopped by a wall on the straight way between two points on opposite
    /// sides of it; `None` where no wall is between, or where the way begins inside.
    fn stopped(&self, from: [f32; 3], to: [f32; 3], phase: f64) -> Option<[f32; 3]> {
        /// Walls thinner than this share of the way may be missed.
        const FINEST: f64 = 1.0 / 64.0;
        let [a, b] = [from, to].map(|p| DVec3::from_array(p.map(f64::from)));
        let travel = (0..self.motions.len()).map(|i| self.wall_travel(i)).fold(0.0, f64::max);
        let way = STEEPEST * (b - a).length() + travel;
        let at = |t: f64| (a.lerp(b, t).to_array(), phase + t * (1.0 - phase));
        let distance = |t: f64| self.distance(at(t).0, at(t).1);
        let mut d = distance(0.0);
        if d < 0.0 || d + distance(1.0) > way {
            return None;
        }
        let mut t = 0.0;
        loop {
            let last = t;
            t += (d / way).max(FINEST);
            if t >= 1.0 {
                return None;
            }
            d = distance(t);
            if d >= 0.0 {
                continue;
            }
            let (obstacle_idx, solid_idx) = self.solid_between(at(t), from, to, phase)?;
            let (obstacle, motion) = (&self.field.obstacles[obstacle_idx], self.motions[obstacle_idx].as_ref());
            let (mut outside, mut inside) = (last, t);
            for _ in 0..24 {
                let middle = 0.5 * (outside + inside);
                let (p, phase) = at(middle);
                if obstacle.solid_distance(solid_idx, motion, p, phase) < 0.0 {
                    inside = middle;
                } else {
                    outside = middle;
                }
            }
            let (p, phase) = at(outside);
            // From there on with the wall.
            let end = motion.map_or(DVec3::from_array(p), |motion| {
                motion.from_rest(DVec3::from_array(motion.to_rest(p, phase).0), 1.0)
            });
            return Some(end.as_vec3().to_array());
        }
    }

    /// The solid that holds a point at a phase and sees `from` and `to` on opposite sides. The chord of a path round a
    /// convex wall is inside it too, and its ends are on the same side.
    fn solid_between(
        &self,
        (inside, at): ([f64; 3], f64),
        from: [f32; 3],
        to: [f32; 3],
        phase: f64,
    ) -> Option<(usize, usize)> {
        let obstacles = self.field.obstacles.iter().zip(&self.motions).enumerate();
        let solids =
            obstacles.flat_map(|(i, (o, motion))| (0..o.solids().len()).map(move |s| (i, s, o, motion.as_ref())));
        solids
            .filter(|(_, s, o, motion)| {
                let away = |p: [f32; 3], phase| o.wall(*s, *motion, p.map(f64::from), phase).0.gradient;
                o.solid_distance(*s, *motion, inside, at) < 0.0 && dot(away(from, phase), away(to, 1.0)) < 0.0
            })
            .map(|(i, s, ..)| (i, s))
            .next()
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
