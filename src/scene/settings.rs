//! Every setting of a scene file, in file order, with its default, unit and meaning.
//!
//! This is the one place where keys are documented: the doc comments and bounds below become the JSON Schema that
//! `curlsmoke schema` prints and against which every scene is checked. Variants are maps with a single key.

pub mod flow;
pub mod lights;
pub mod materials;
pub mod output;
pub mod shapes;
pub mod smoke;

pub use flow::*;
pub use lights::*;
pub use materials::*;
pub use output::*;
pub use shapes::*;
pub use smoke::*;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Three coordinates, in metres where nothing else is said.
pub type Vec3 = [f64; 3];
/// Linear Rec. 709 red, green and blue.
pub type Rgb = [f64; 3];

/// A whole scene file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Version of the scene format: 1.
    #[schemars(range(min = 1, max = 1))]
    pub version: u32,
    /// Which frames exist, and their timing.
    #[serde(default)]
    pub frames: Frames,
    /// Where the picture is taken from.
    pub camera: Camera,
    /// Size and sampling of the picture.
    #[serde(default)]
    pub film: Film,
    /// Light transport.
    #[serde(default)]
    pub render: Render,
    /// Solid things by name. Names are used by `flow.obstacles`.
    #[serde(default)]
    pub shapes: BTreeMap<String, Shape>,
    /// What moves the particles.
    #[serde(default)]
    pub flow: Flow,
    /// The smoke itself: emitters, or a density file.
    #[serde(default)]
    pub smoke: Option<Smoke>,
    /// Light sources; at least one.
    #[serde(default)]
    pub lights: Vec<Light>,
    /// Files to write.
    #[serde(default)]
    pub output: Output,
}

impl Settings {
    /// What particles and noise are seeded with.
    pub fn smoke_seed(&self) -> u64 {
        self.smoke.as_ref().and_then(|smoke| smoke.seed).unwrap_or(self.render.seed)
    }
}

/// Which frames exist, and their timing. Frame f is at time (f − first)/fps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Frames {
    /// First frame; time 0. Default 1.
    #[schemars(range(min = -100000, max = 1000000))]
    pub first: i32,
    /// Last frame, included. Default 1.
    #[schemars(range(min = -100000, max = 1000000))]
    pub last: i32,
    /// Frames per second. Default 24.
    #[schemars(range(min = 0.001, max = 10000.0))]
    pub fps: f64,
    /// Opening and closing of the shutter, in frames relative to the frame. Default [0, 0]: no motion blur. Smoke is
    /// smeared straight along the velocity it has at the frame; the camera stands still, and solids, even those that move,
    /// are sharp where they are at the frame.
    pub shutter: [f64; 2],
}

impl Default for Frames {
    fn default() -> Self {
        Self { first: 1, last: 1, fps: 24.0, shutter: [0.0, 0.0] }
    }
}

/// A pinhole camera. y is up; pixels are square.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Where the camera stands [m].
    pub position: Vec3,
    /// The point in the middle of the picture [m].
    pub look_at: Vec3,
    /// Which way is up in the picture. Default [0, 1, 0].
    #[serde(default = "up")]
    pub up: Vec3,
    /// Angle between the lower and the upper edge of the picture [degrees]. Default 35.
    #[serde(default = "vertical_fov")]
    #[schemars(range(min = 0.01, max = 175.0))]
    pub vertical_fov_deg: f64,
}

fn up() -> Vec3 {
    [0.0, 1.0, 0.0]
}

fn vertical_fov() -> f64 {
    35.0
}

/// Size and sampling of the picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Film {
    /// Width and height in pixels. Default [640, 360].
    #[schemars(inner(range(min = 1, max = 32768)))]
    pub resolution: [u32; 2],
    /// Paths traced through each pixel. Default 128.
    #[schemars(range(min = 1, max = 16777216))]
    pub spp: u32,
    /// How a sample counts for its pixel. Default a Blackman–Harris window of radius 1.5 pixels.
    pub filter: Filter,
}

impl Default for Film {
    fn default() -> Self {
        Self { resolution: [640, 360], spp: 128, filter: Filter::BlackmanHarris { radius: 1.5 } }
    }
}

/// The weight of a sample by its distance from the middle of the pixel. Sampled in proportion, so every sample of a
/// pixel has weight 1 and pixels stay independent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Filter {
    /// Constant over a square: radius 0.5 is the pixel itself.
    Box {
        /// Half the width [pixels].
        #[schemars(range(min = 0.0, max = 8.0))]
        radius: f64,
    },
    /// Four-term Blackman–Harris window.
    BlackmanHarris {
        /// Half the width [pixels].
        #[schemars(range(min = 0.1, max = 8.0))]
        radius: f64,
    },
}

/// Light transport.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Render {
    /// Paths end after this many scatterings; the sidecar file says how much light was lost so, and above 0.1 % the log
    /// does. Default 64.
    #[schemars(range(min = 0, max = 100000))]
    pub max_bounces: u32,
    /// Scatterings before Russian roulette may end a path. Default 8.
    #[schemars(range(min = 0, max = 100000))]
    pub roulette_from: u32,
    /// The random numbers of light, and of the smoke where `smoke.seed` does not say otherwise. Default 1.
    pub seed: u64,
    /// Same noise pattern in every frame. For regression tests; in animations it looks like a dirty window.
    /// Default false.
    pub lock_seed: bool,
    /// Nothing that needs more memory than this is started [GiB]. Default 8.
    #[schemars(range(min = 0.01, max = 65536.0))]
    pub memory_limit_gib: f64,
}

impl Default for Render {
    fn default() -> Self {
        Self { max_bounces: 64, roulette_from: 8, seed: 1, lock_seed: false, memory_limit_gib: 8.0 }
    }
}

fn yes() -> bool {
    true
}

fn one() -> f64 {
    1.0
}

fn density_name() -> String {
    "density".into()
}
