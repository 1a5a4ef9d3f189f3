//! Shapes: distances and hits.

pub mod embree;
pub mod mesh;
pub mod mesh_sdf;
pub mod primitive;
pub mod sdf;
pub mod spline;
pub mod trace;
pub mod triangle;
