//! The velocity field: the curl of the sum of all potentials, each bent round all obstacles.

use crate::flow::curl::curl;
use crate::flow::elements::rigid;
use crate::flow::gauge::{HoleFlux, WindExcess};
use crate::flow::obstacles::Obstacle;
use crate::flow::octaves::Drift;
use crate::flow::potential::{Psi, flattened};
use crate::flow::ramp::removed;
use crate::flow::source::{Source, SourceSpan};
use crate::flow::walls::{NOTICE, NearWalls};
use crate::geometry::motion::RigidSpan;
use crate::math::jet::Scalar;
use crate::math::lanes::{Batch, Kernel, run_kernel};
use crate::math::real::{Lane, triple};
use glam::DVec3;

/// Divergence-free velocity round obstacles.
#[derive(Debug, Clone)]
pub struct VelocityField {
    sources: Vec<Source>,
    pub(in crate::flow) obstacles: Vec<Obstacle>,
    notice: f64,
    /// Across which all of the flow is two-dimensional.
    planar: Option<DVec3>,
}

/// The field over a span of time, with everything worked out that depends on time alone.
///
/// Within a span obstacles move at constant velocity and turn at constant angular velocity, and their constants follow a
/// parabola through their values at start, middle and end: any constant in space keeps walls tight, and this one costs
/// nothing.
#[derive(Debug, Clone)]
pub struct FieldSpan<'a> {
    pub(in crate::flow) field: &'a VelocityField,
    sources: Vec<SourceSpan<'a>>,
    /// Of each obstacle, `None` for those at rest.
    pub(in crate::flow) motions: Vec<Option<RigidSpan>>,
    carriers: Vec<Option<Carrier>>,
}

/// A moving obstacle, and what its motion carries along.
#[derive(Debug, Clone)]
struct Carrier {
    motion: RigidSpan,
    wind: WindExcess,
    hole: Option<HoleFlux>,
    influence: f64,
    planar: Option<DVec3>,
}

/// Not on a ground.
const NOWHERE: Scalar<f64> = Scalar { value: 0.0, gradient: [0.0; 3] };

impl Carrier {
    fn new(obstacle: &Obstacle, motion: RigidSpan, planar: Option<DVec3>) -> Self {
        let wind = WindExcess::new(motion.velocity(), obstacle, Some(&motion));
        // Only the potential of a translation is fitted to the body.
        let is_turning = motion.angular_velocity().length_squared() > 0.0;
        let influence = if is_turning && planar.is_none() { obstacle.size() } else { obstacle.girth() };
        let mut carrier = Self { motion, wind, hole: None, influence, planar };
        if planar.is_some() {
            return carrier;
        }
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
        if let Some(normal) = self.planar {
            // A single component of the linear potential has only half of the velocity.
            let (n, v) = (triple!(i => phase.lit(normal[i])), 2.0 * self.motion.velocity());
            let (v, w) = (triple!(i => phase.lit(v[i])), triple!(i => phase.lit(w[i])));
            let center = self.motion.center(phase);
            let r = flattened(n, triple!(i => p[i] - center[i]));
            return rigid(v, w, [phase.lit(0.0); 3], r).along(n);
        }
        let at_rest = [phase.lit(0.0); 3];
        let turning = rigid(at_rest, triple!(i => phase.lit(w[i])), self.motion.center(phase), p);
        let body = turning.plus(&self.wind.at(p, phase, on_ground));
        match &self.hole {
            Some(hole) => body.minus(&hole.at(Some(&self.motion), p, phase)),
            None => body,
        }
    }
}

impl VelocityField {
    /// The field of the given potentials round the given obstacles.
    pub fn new(sources: Vec<Source>, obstacles: Vec<Obstacle>) -> Self {
        let notice = notice(&sources, &obstacles, None);
        Self { sources, obstacles, notice, planar: None }
    }

    /// The field in two dimensions, alike in all planes across `normal` (length 1) but for the obstacles: of every
    /// potential the component along it is taken for a stream function (curl-noise-2007, equations 2 and 3). What has a
    /// place has it in each plane.
    pub fn planar(mut self, normal: DVec3) -> Self {
        self.sources.iter_mut().for_each(|source| source.potential.flatten(normal));
        self.planar = Some(normal);
        self.notice = notice(&self.sources, &self.obstacles, self.planar);
        self
    }

    /// The obstacles.
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.obstacles
    }

    /// The field from `start` [s], lasting `duration` [s].
    pub fn span(&self, start: f64, duration: f64) -> FieldSpan<'_> {
        let sources = self.sources.iter().map(|source| source.unready_span(self.planar)).collect();
        let mut span = FieldSpan { field: self, sources, motions: Vec::new(), carriers: Vec::new() };
        span.renew(start, duration);
        span
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

/// Distance [m] beyond which no obstacle bends anything.
fn notice(sources: &[Source], obstacles: &[Obstacle], planar: Option<DVec3>) -> f64 {
    let of_sources =
        sources.iter().flat_map(|s| obstacles.iter().map(move |o| o.influence(s.wanted_influence(o, planar))));
    let of_motions = obstacles.iter().map(|o| o.influence(o.size()));
    of_sources.chain(of_motions).fold(0.0, f64::max) * NOTICE
}

impl FieldSpan<'_> {
    /// Makes this the field from `start` [s], lasting `duration` [s], in the memory that it has.
    pub fn renew(&mut self, start: f64, duration: f64) {
        let field = self.field;
        self.motions.clear();
        self.motions.extend(field.obstacles.iter().map(|o| o.span(start, duration)));
        for (span, source) in self.sources.iter_mut().zip(&field.sources) {
            source.renew(span, &field.obstacles, &self.motions, field.planar, start, duration);
        }
        let moving = field.obstacles.iter().zip(&self.motions);
        self.carriers.clear();
        self.carriers.extend(moving.map(|(o, motion)| motion.map(|m| Carrier::new(o, m, field.planar))));
    }

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
        let mut near = NearWalls::none();
        if !self.field.obstacles.is_empty() {
            near.find(&self.field.obstacles, &self.motions, p, phase, self.field.notice);
        }
        let zero = phase.lit(0.0);
        let mut velocity = [zero; 3];
        let mut drift = Drift::none(phase);
        for source in &self.sources {
            let psi = source.carried_psi(p, phase, &mut drift);
            let mut first = 0;
            let mut kept = psi;
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
            let (Some(carrier), Some(mut found)) = (&self.carriers[obstacle_idx], found) else { continue };
            if self.field.planar.is_some() {
                found.wall.normal = None;
            }
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

    /// As [`FieldSpan::distance`] of many points, in single precision where this processor has lanes for it.
    ///
    /// # Panics
    /// Where the slices differ in length.
    pub fn distances(&self, points: &[DVec3], phase: f64, distances: &mut [f64]) {
        assert_eq!(points.len(), distances.len());
        run_kernel(Distances { span: self, points, phase, distances });
    }

    /// Velocity of the closest wall [m/s] at `p` [m]; 0 where it is at rest, or without obstacles.
    pub fn wall_velocity(&self, p: [f64; 3], phase: f64) -> [f64; 3] {
        let distances = self.field.obstacles.iter().zip(&self.motions);
        let closest = distances
            .map(|(obstacle, motion)| (obstacle.distance(motion.as_ref(), p, phase), motion))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        closest.and_then(|(_, motion)| *motion).map_or([0.0; 3], |motion| motion.velocity_at(p, phase))
    }
}

struct Distances<'a, 'b> {
    span: &'a FieldSpan<'b>,
    points: &'a [DVec3],
    phase: f64,
    distances: &'a mut [f64],
}

impl Kernel for Distances<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Batch>(self, zero: L) {
        let (span, phase) = (self.span, zero.lit(self.phase));
        for start in (0..self.points.len()).step_by(L::WIDTH) {
            let count = L::WIDTH.min(self.points.len() - start);
            let p = triple!(axis => zero.gather(|lane| self.points[start + lane.min(count - 1)][axis]));
            let mut least = zero.lit(f64::INFINITY);
            for (obstacle, motion) in span.field.obstacles.iter().zip(&span.motions) {
                least = least.min(obstacle.distance(motion.as_ref(), p, phase));
            }
            for lane in 0..count {
                self.distances[start + lane] = least.lane(lane);
            }
        }
    }
}
