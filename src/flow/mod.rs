//! Divergence-free velocity: the curl of potentials that are bent round obstacles.

pub mod build;
pub mod curl;
pub mod elements;
pub mod field;
pub mod flow_noise;
pub mod mask;
pub mod noise;
pub mod obstacles;
pub mod octaves;
pub mod potential;
pub mod ramp;
pub mod vortex;
pub mod walls;

pub use crate::flow::build::FlowError;
pub use crate::flow::field::VelocityField;
