//! What a scene says of lights, materials and textures, turned into the values that light transport works on.
//!
//! The files of this folder know settings, and the rest of the stage knows them only through these files and
//! `render/mod.rs`. They compute nothing of light: what a value means is said where its type is.

pub mod camera;
pub mod lights;
pub mod materials;
pub mod textures;

use glam::Vec3;

/// In single precision.
pub fn vec3(v: [f64; 3]) -> Vec3 {
    Vec3::from(v.map(|x| x as f32))
}
