//! What a scene file says, as plain data.

pub mod pattern;
pub mod settings;
