//! Shared vocabulary of the stages; knows neither smoke nor light.

pub mod aabb;
pub mod circle;
pub mod dual;
pub mod exact_sum;
pub mod hash;
pub mod interpolate;
pub mod jet;
pub mod keys;
pub mod lanes;
pub mod lattice;
pub mod parallel;
pub mod real;
pub mod space;
pub mod statistics;
