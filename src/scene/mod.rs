//! What a scene file says, as plain data.

pub mod settings;
