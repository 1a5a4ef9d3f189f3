//! Divergence-free velocity: the curl of potentials that are bent round obstacles.

pub mod curl;
pub mod flow_noise;
pub mod noise;
pub mod octaves;
pub mod potential;
pub mod ramp;
