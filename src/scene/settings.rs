//! Every setting of a scene file, in file order, with its default, unit and meaning.
//!
//! This is the one place where keys are documented: the doc comments and bounds below become the JSON Schema that
//! `curlsmoke schema` prints and against which every scene is checked. Variants are maps with a single key.

pub mod flow;
pub mod keyed;
pub mod lights;
pub mod materials;
pub mod output;
pub mod shapes;
pub mod smoke;
pub mod volumes;

pub use flow::*;
pub use keyed::{KeyMap, Keyed};
pub use lights::*;
pub use materials::*;
pub use output::*;
pub use shapes::*;
pub use smoke::*;
pub use volumes::*;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

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
    /// More that light flies through, by name: smoke from files and even mist inside shapes. Volumes overlap each other, the
    /// smoke and shapes as they like: where they do, there is as much of all of them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub volumes: BTreeMap<String, Volume>,
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

    /// The names of the groups of lights, in order.
    pub fn light_groups(&self) -> Vec<String> {
        let names: BTreeSet<&str> = self.lights.iter().filter_map(Light::group).collect();
        names.into_iter().map(String::from).collect()
    }

    /// Whether the flow minds a shape: as a wall, or where a mask is.
    pub fn guides_flow(&self, shape: &str) -> bool {
        let is_mask = |mask: &Mask| match mask {
            Mask::Shape(mask) => mask.name == shape,
            Mask::Wake(mask) => mask.shape == shape,
            _ => false,
        };
        self.flow.minds(shape) || self.flow.potentials.iter().flat_map(Potential::masks).any(is_mask)
    }

    /// Whether more than light minds how a shape moves: it guides the flow, holds a volume or lets particles start.
    pub fn carries(&self, shape: &str) -> bool {
        let emitters = self.smoke.iter().flat_map(|smoke| &smoke.emitters);
        let is_emitter = emitters.filter_map(|emitter| emitter.mesh.as_ref()).any(|mesh| mesh.shape == shape);
        let is_filled = self.volumes.values().any(|volume| volume.inside.as_deref() == Some(shape));
        self.guides_flow(shape) || is_emitter || is_filled
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
    /// smeared along the ways of its particles; each path of light sees camera and solids where they are at a time of its
    /// own. Lights are as they are at the frame, but for shapes that shine.
    pub shutter: [f64; 2],
}

impl Frames {
    /// Time of a frame, or of a moment between two [s]; the first frame is at 0.
    pub fn time(&self, frame: f64) -> f64 {
        (frame - f64::from(self.first)) / self.fps
    }
}

impl Default for Frames {
    fn default() -> Self {
        Self { first: 1, last: 1, fps: 24.0, shutter: [0.0, 0.0] }
    }
}

/// A camera. y is up; pixels are square.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Where the camera stands [m].
    pub position: Keyed<Vec3>,
    /// The point in the middle of the picture [m].
    pub look_at: Keyed<Vec3>,
    /// Which way is up in the picture. Default [0, 1, 0].
    #[serde(default = "still_up")]
    pub up: Keyed<Vec3>,
    /// Angle between the lower and the upper edge of the picture [degrees]; of `perspective` only. Default 35.
    #[serde(default = "vertical_fov")]
    #[schemars(range(min = 0.01, max = 175.0))]
    pub vertical_fov_deg: Keyed<f64>,
    /// How the world comes onto the film. Default perspective.
    #[serde(default, skip_serializing_if = "CameraProjection::is_perspective")]
    pub projection: CameraProjection,
    /// A lens, which blurs what is out of focus. Default none: a pinhole, all is sharp.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens: Option<Lens>,
}

impl Camera {
    /// Distance from the camera to where it looks at the first key [m].
    pub fn distance(&self) -> f64 {
        let (from, to) = (self.position.first(), self.look_at.first());
        (0..3).map(|i| (to[i] - from[i]).powi(2)).sum::<f64>().sqrt()
    }
}

/// How the world comes onto the film.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum CameraProjection {
    /// Straight lines through one point.
    #[default]
    Perspective,
    /// Parallel rays, which start in the plane of `position`.
    Orthographic {
        /// Height of what is seen [m].
        #[schemars(range(max = 1e9), extend("exclusiveMinimum" = 0.0))]
        height: f64,
    },
    /// All directions, by longitude and latitude, as pictures of surroundings are: the middle of the picture is forwards, its
    /// left and right edge behind, its top `up`. A picture twice as wide as high has the right proportions.
    LatLong,
}

impl CameraProjection {
    /// Whether it is the usual one.
    pub fn is_perspective(&self) -> bool {
        *self == Self::Perspective
    }
}

/// A thin lens.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Lens {
    /// Radius of its opening [m]: the focal length over twice the f-number. 0.009 is a lens of 50 mm at f/2.8.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub radius: Keyed<f64>,
    /// Distance along the view of what is sharp [m]. Default the distance of `look_at`.
    #[serde(default)]
    #[schemars(range(max = 1e9), extend("exclusiveMinimum" = 0.0))]
    pub focus_distance: Option<Keyed<f64>>,
}

fn up() -> Vec3 {
    [0.0, 1.0, 0.0]
}

fn still_up() -> Keyed<Vec3> {
    up().into()
}

fn vertical_fov() -> Keyed<f64> {
    35.0.into()
}

/// Most pixels of a frame across, and down.
pub const RESOLUTION_MAX: u32 = 32768;
/// Most pixels beside a frame, on each side.
pub const OVERSCAN_MAX: u32 = 16384;

/// Size and sampling of the picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Film {
    /// Width and height in pixels. Default [640, 360].
    #[schemars(inner(range(min = 1, max = RESOLUTION_MAX)))]
    pub resolution: [u32; 2],
    /// Pixels beside the frame that are rendered too, for blurs, lens distortion and shakes in compositing: as many on every side, or
    /// as many at the left, right, top and bottom. The same projection goes on there, the frame keeps its every bit, and a `lat_long` camera goes
    /// on round. In the `.exr` the display window is the frame and the data window has all pixels; previews show the frame.
    /// Default 0.
    #[serde(skip_serializing_if = "Overscan::is_none")]
    pub overscan: Overscan,
    /// Paths traced through each pixel; with `noise_target` the most. Default 128.
    #[schemars(range(min = 1, max = 16777216))]
    pub spp: u32,
    /// Paths go where they are needed: a pixel gets as many as bring those round it to a standard error of their luminance that is
    /// this share of that luminance plus 0.05 W/(m² sr): 0.02 is clean, 0.1 grainy. Unbiased, and the same on every run. What is
    /// but a pixel wide stays noisier. Pixels next to a shadow catcher have all of `spp`. Default none: all pixels have.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0001, max = 10.0))]
    pub noise_target: Option<f64>,
    /// With `noise_target`, fewest paths of a pixel: too few miss what is bright and rare. Default 32.
    #[serde(skip_serializing_if = "is_min_spp")]
    #[schemars(range(min = 4, max = 16777216))]
    pub min_spp: u32,
    /// Time for the light of a frame [s]: passes over the whole picture begin while they are expected to end within it, the first
    /// of 4 paths in any case. All pixels have equally many paths, how many is up to the machine, and the sidecar says it.
    /// Not with `noise_target`. Default none.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.001, max = 1e9))]
    pub time_limit: Option<f64>,
    /// How a sample counts for its pixel. Default a Blackman–Harris window of radius 1.5 pixels.
    pub filter: Filter,
}

impl Default for Film {
    fn default() -> Self {
        Self {
            resolution: [640, 360],
            overscan: Overscan::default(),
            spp: 128,
            noise_target: None,
            min_spp: MIN_SPP,
            time_limit: None,
            filter: Filter::BlackmanHarris { radius: 1.5 },
        }
    }
}

/// Pixels beside the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Overscan {
    /// As many on every side.
    Even(#[schemars(range(min = 0, max = OVERSCAN_MAX))] u32),
    /// At the left, right, top and bottom.
    Sides(#[schemars(inner(range(min = 0, max = OVERSCAN_MAX)))] [u32; 4]),
}

impl Default for Overscan {
    fn default() -> Self {
        Self::Even(0)
    }
}

impl Overscan {
    /// At the left, right, top and bottom [pixels].
    pub fn sides(self) -> [u32; 4] {
        match self {
            Self::Even(pixels) => [pixels; 4],
            Self::Sides(sides) => sides,
        }
    }

    /// Whether there is none.
    pub fn is_none(&self) -> bool {
        self.sides() == [0; 4]
    }
}

impl Film {
    /// Width and height with overscan [pixels].
    pub fn size(&self) -> [u32; 2] {
        let ([width, height], [left, right, top, bottom]) = (self.resolution, self.overscan.sides());
        [width.saturating_add(left).saturating_add(right), height.saturating_add(top).saturating_add(bottom)]
    }
}

const MIN_SPP: u32 = 32;

fn is_min_spp(spp: &u32) -> bool {
    *spp == MIN_SPP
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
    /// Falls straight to 0 at the radius.
    Triangle {
        /// Half the width [pixels].
        #[schemars(range(min = 0.1, max = 8.0))]
        radius: f64,
    },
    /// A bell of standard deviation radius/3 that ends at 0.
    Gaussian {
        /// Half the width [pixels].
        #[schemars(range(min = 0.1, max = 8.0))]
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
    /// Scatterings before Russian roulette may end a path that has less than a tenth of its light left. Default 8.
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
