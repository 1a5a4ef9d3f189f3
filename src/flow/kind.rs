//! The two kinds of flow that carry smoke.

use crate::flow::field::{FieldSpan, VelocityField};
use crate::flow::tracks::Tracks;

/// What carries smoke.
#[derive(Debug, Clone)]
pub enum Flow {
    /// The curl of potentials, round and inside of walls, in time.
    Curl(VelocityField),
    /// Divergence-free vector noise, steady.
    Tracks(Tracks),
}

/// A flow over a span of time, with everything worked out that depends on time alone.
#[derive(Debug, Clone)]
pub enum FlowSpan<'a> {
    /// Of a curl.
    Curl(FieldSpan<'a>),
    /// Of tracks, and the walls that they are kept inside of.
    Tracks(&'a Tracks, FieldSpan<'a>),
}

impl From<VelocityField> for Flow {
    fn from(field: VelocityField) -> Self {
        Self::Curl(field)
    }
}

impl Flow {
    /// A field with the walls of the flow.
    pub fn walls(&self) -> &VelocityField {
        match self {
            Self::Curl(field) => field,
            Self::Tracks(tracks) => tracks.walls(),
        }
    }

    /// The flow from `start` [s], lasting `duration` [s].
    pub fn span(&self, start: f64, duration: f64) -> FlowSpan<'_> {
        let walls = self.walls().span(start, duration);
        match self {
            Self::Curl(_) => FlowSpan::Curl(walls),
            Self::Tracks(tracks) => FlowSpan::Tracks(tracks, walls),
        }
    }

    /// What one who starts at a point [m] keeps for good, if the flow has such.
    pub fn iso_values(&self, p: [f64; 3]) -> Option<[f64; 2]> {
        match self {
            Self::Curl(_) => None,
            Self::Tracks(tracks) => Some(tracks.iso_values(p)),
        }
    }
}

impl<'a> FlowSpan<'a> {
    /// A field with the walls of the flow.
    pub fn walls(&self) -> &FieldSpan<'a> {
        match self {
            Self::Curl(walls) | Self::Tracks(_, walls) => walls,
        }
    }

    /// Makes this the flow from `start` [s], lasting `duration` [s], in the memory that it has.
    pub fn renew(&mut self, start: f64, duration: f64) {
        match self {
            Self::Curl(walls) | Self::Tracks(_, walls) => walls.renew(start, duration),
        }
    }

    /// Velocity [m/s] at a point [m], in double precision; `phase` runs from 0 at the start of the span to 1 at its end.
    pub fn velocity(&self, p: [f64; 3], phase: f64) -> [f64; 3] {
        match self {
            Self::Curl(field) => field.velocity(p, phase),
            Self::Tracks(tracks, _) => tracks.velocity(p),
        }
    }
}
