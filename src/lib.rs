//! curlsmoke renders procedural smoke: curl-noise particles, splatted into a sparse density grid, lit by an unbiased
//! volumetric path tracer.
//!
//! Data flows left to right, and a module imports only from modules to its left:
//!
//! ```text
//! math · progress · foreign | scene → geometry → flow → points · particles → grid → render → output → inspect | error → pipeline → watch · regress → cli → main
//! ```

pub mod foreign;
pub mod math;
pub mod progress;

/// What a scene file says: a crate of its own in `src/scene/`, which knows none of the other stages.
pub use curlsmoke_scene as scene;

pub mod geometry;

pub mod flow;

pub mod points;

pub mod particles;

pub mod grid;

pub mod render;

pub mod output;

pub mod inspect;

pub mod error;

pub mod pipeline;

pub mod regress;
pub mod watch;

pub mod cli;
