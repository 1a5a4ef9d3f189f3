//! A term of the flow: a potential with its masks, and what of it walls must take away.

use crate::flow::curl::curl;
use crate::flow::elements::{Column, Shear, rigid};
use crate::flow::gauge::{HoleFlux, Parabola, WindExcess, reference_at};
use crate::flow::mask::{MaskSpan, PlacedMask};
use crate::flow::obstacles::{Boundary, Ground, Obstacle};
use crate::flow::octaves::{Drift, Form, Octave, OctaveSpan};
use crate::flow::potential::{Psi, flattened, uniform};
use crate::flow::vortex::{Vortex, VortexSpan};
use crate::flow::walls::NearObstacle;
use crate::geometry::motion::RigidSpan;
use crate::math::real::{Lane, cross, dot, triple};
use glam::DVec3;

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
    pub masks: Vec<PlacedMask>,
    /// Distance from obstacles over which it bends [m]; where `None` that is its own length, or for potentials without
    /// one the obstacle's girth or size.
    pub influence: Option<f64>,
}

#[derive(Debug, Clone)]
pub(in crate::flow) struct SourceSpan<'a> {
    potential: PotentialSpan<'a>,
    masks: Vec<MaskSpan<'a>>,
    /// Across which a flow in two dimensions goes on; `None` too for noise that is two-dimensional by itself.
    planar: Option<DVec3>,
    pub(in crate::flow) walls: Vec<SourceWall>,
}

#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant, reason = "a dozen of them, made once a step")]
enum PotentialSpan<'a> {
    Uniform { velocity: DVec3, origin: DVec3 },
    Shear(Shear),
    Rigid { velocity: DVec3, angular_velocity: DVec3, center: DVec3 },
    Column(Column),
    Vortex(VortexSpan<'a>),
    Octave(OctaveSpan),
}

/// How a source stands to an obstacle.
#[derive(Debug, Clone)]
pub(in crate::flow) struct SourceWall {
    pub(in crate::flow) influence: f64,
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

    pub(in crate::flow) fn wanted_influence(&self, obstacle: &Obstacle, planar: Option<DVec3>) -> f64 {
        self.influence.or_else(|| self.potential.length()).unwrap_or_else(|| {
            let is_fitted = self.is_wind() && !obstacle.holds_what_stands_on_it();
            if is_fitted || planar.is_some() { obstacle.girth() } else { obstacle.size() }
        })
    }

    /// Whether it is noise in the planes across `normal` by itself.
    fn is_planar_noise(&self, normal: DVec3) -> bool {
        let Potential::Octave(octave) = &self.potential else { return false };
        matches!(octave.form(), Form::Planar(own) if own.cross(normal).length_squared() < 1e-24)
    }

    /// Whether it is a uniform velocity, whose excess is fitted to obstacles. The excess of others grows away from the
    /// reference point of a slender body, and a narrow ramp would make a jet of it.
    fn is_wind(&self) -> bool {
        matches!(self.potential, Potential::Uniform { .. }) && self.masks.is_empty()
    }

    /// A span that must be renewed before it is used.
    pub(in crate::flow) fn unready_span(&self, planar: Option<DVec3>) -> SourceSpan<'_> {
        SourceSpan {
            potential: self.potential.span(0.0, 0.0),
            masks: Vec::new(),
            planar: planar.filter(|normal| !self.is_planar_noise(*normal)),
            walls: Vec::new(),
        }
    }

    /// Makes `span` the one from `start` [s], lasting `duration` [s], in the memory that it has.
    pub(in crate::flow) fn renew<'a>(
        &'a self,
        span: &mut SourceSpan<'a>,
        obstacles: &[Obstacle],
        motions: &[Option<RigidSpan>],
        planar: Option<DVec3>,
        start: f64,
        duration: f64,
    ) {
        span.potential = self.potential.span(start, duration);
        span.masks.clear();
        span.masks.extend(self.masks.iter().map(|mask| mask.span(start, duration)));
        // Walls ask for the potential without them.
        let mut walls = std::mem::take(&mut span.walls);
        walls.clear();
        for (obstacle, motion) in obstacles.iter().zip(motions) {
            let motion = motion.as_ref();
            let influence = obstacle.influence(self.wanted_influence(obstacle, planar));
            let hole = obstacle.hole().filter(|_| span.is_vector());
            let hole = hole.map(|hole| HoleFlux::new(hole, motion, |p, phase| span.psi(p, phase).value));
            let gauge = match &self.potential {
                Potential::Uniform { velocity, .. } if self.is_wind() && planar.is_none() => {
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
            walls.push(SourceWall { influence, gauge, hole });
        }
        span.walls = walls;
    }
}

impl Potential {
    /// Puts what has a place into the plane through the origin across `normal` (length 1), where two-dimensional flows are
    /// looked up.
    pub(in crate::flow) fn flatten(&mut self, normal: DVec3) {
        match self {
            Self::Rigid { center, .. } => *center -= normal * normal.dot(*center),
            Self::Vortex(vortex) => vortex.flatten(normal),
            Self::Uniform { .. } | Self::Shear(_) | Self::Column(_) | Self::Octave(_) => {}
        }
    }

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

    fn span(&self, start: f64, duration: f64) -> PotentialSpan<'_> {
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
    /// As [`SourceSpan::psi`], carried by the larger octaves of the same noise that came before it.
    #[inline(always)]
    pub(in crate::flow) fn carried_psi<L: Lane>(&self, p: [L; 3], phase: L, drift: &mut Drift<L>) -> Psi<L> {
        let PotentialSpan::Octave(octave) = &self.potential else { return self.psi(p, phase) };
        if !octave.octave().has_memory() {
            // Most noise is plain: it need not be handed on once more.
            let is_plain = self.planar.is_none() && self.masks.is_empty();
            return if is_plain { octave.psi(p, phase) } else { self.psi(p, phase) };
        }
        if octave.octave().is_largest() {
            *drift = Drift::none(phase);
        }
        let (psi, more) = octave.carried(self.in_plane(p), phase, drift);
        *drift = more;
        self.masked(self.stream_function(psi), p, phase)
    }

    /// The velocity whose linear potential ½ V × x is taken: of that potential a single component has only half.
    fn linear(&self, velocity: &DVec3) -> DVec3 {
        if self.planar.is_some() { 2.0 * *velocity } else { *velocity }
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
        let psi = self.unmasked(self.in_plane(p), phase);
        self.masked(self.stream_function(psi), p, phase)
    }

    /// The point itself, or in two dimensions the one below or above it in the plane through the origin.
    #[inline(always)]
    fn in_plane<L: Lane>(&self, mut p: [L; 3]) -> [L; 3] {
        if let Some(normal) = self.planar {
            p = flattened(triple!(i => p[0].lit(normal[i])), p);
        }
        p
    }

    /// The potential itself, or in two dimensions its part across the planes.
    #[inline(always)]
    fn stream_function<L: Lane>(&self, mut psi: Psi<L>) -> Psi<L> {
        if let Some(normal) = self.planar {
            psi = psi.along(triple!(i => psi.value[0].lit(normal[i])));
        }
        psi
    }

    #[inline(always)]
    fn unmasked<L: Lane>(&self, p: [L; 3], phase: L) -> Psi<L> {
        let lane = |v: &DVec3| -> [L; 3] { triple!(i => phase.lit(v[i])) };
        match &self.potential {
            PotentialSpan::Uniform { velocity, origin } => uniform(lane(&self.linear(velocity)), lane(origin), p),
            PotentialSpan::Shear(shear) => shear.psi(p),
            PotentialSpan::Rigid { velocity, angular_velocity, center } => {
                rigid(lane(&self.linear(velocity)), lane(angular_velocity), lane(center), p)
            }
            PotentialSpan::Column(column) => column.psi(p),
            PotentialSpan::Vortex(vortex) => vortex.psi(p, phase),
            PotentialSpan::Octave(octave) => octave.psi(p, phase),
        }
    }

    #[inline(always)]
    fn masked<L: Lane>(&self, mut psi: Psi<L>, p: [L; 3], phase: L) -> Psi<L> {
        for mask in &self.masks {
            let modulated = psi.modulated(&mask.at(p, phase));
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
    pub(in crate::flow) fn excess<L: Lane>(
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
    pub(in crate::flow) fn is_vector(&self) -> bool {
        match &self.potential {
            _ if self.planar.is_some() => false,
            PotentialSpan::Octave(octave) => octave.octave().form() == Form::Curl,
            _ => true,
        }
    }

    /// The velocity [m/s] of what walls have left of a potential.
    #[inline(always)]
    pub(in crate::flow) fn velocity<L: Lane>(&self, psi: &Psi<L>, kept: &Psi<L>) -> [L; 3] {
        match &self.potential {
            // Of the two scalars walls and masks bend the first alone.
            PotentialSpan::Octave(octave) if octave.octave().form() == Form::Bitangent => {
                cross(kept.jacobian[0], psi.jacobian[1])
            }
            _ => curl(kept),
        }
    }
}
