//! Shapes: distances and hits.

pub mod primitive;
pub mod sdf;
