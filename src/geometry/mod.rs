//! Shapes: distances and hits.

pub mod embree;
pub mod mesh;
pub mod primitive;
pub mod sdf;
pub mod trace;
pub mod triangle;
