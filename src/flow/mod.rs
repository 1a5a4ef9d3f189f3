//! Divergence-free velocity: the curl of potentials that are bent round obstacles.

pub mod curl;
pub mod field;
pub mod flow_noise;
pub mod noise;
pub mod obstacles;
pub mod octaves;
pub mod potential;
pub mod ramp;
pub mod walls;

pub use crate::flow::field::VelocityField;
