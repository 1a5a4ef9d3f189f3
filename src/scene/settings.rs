//! Every setting of a scene file, in file order, with its default, unit and meaning.
//!
//! This is the one place where keys are documented: the doc comments and bounds below become the JSON Schema that
//! `curlsmoke schema` prints and against which every scene is checked. Variants are maps with a single key.

pub mod flow;

pub use flow::*;

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
    /// smeared straight along the velocity it has at the frame; the camera stands still.
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
    /// The picture's random numbers, and those of the particles. Default 1.
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

/// A solid: exactly one of `sphere`, `box`, `capsule`, `torus`, `plane`, `mesh`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Shape {
    /// A ball.
    #[serde(default)]
    pub sphere: Option<Sphere>,
    /// A box, with rounded edges if wanted.
    #[serde(default, rename = "box")]
    pub cuboid: Option<Cuboid>,
    /// All points within a distance of a segment.
    #[serde(default)]
    pub capsule: Option<Capsule>,
    /// A ring.
    #[serde(default)]
    pub torus: Option<Torus>,
    /// A half space.
    #[serde(default)]
    pub plane: Option<Plane>,
    /// Triangles from a file.
    #[serde(default)]
    pub mesh: Option<Mesh>,
    /// Moves, turns and scales the shape.
    #[serde(default)]
    pub transform: Transform,
    /// How the shape moves in time. Default not at all.
    #[serde(default)]
    pub motion: Option<Motion>,
    /// What the surface does to light. Default diffuse grey 0.5.
    #[serde(default)]
    pub material: Material,
    /// Whether light meets it; an invisible shape still guides the flow. Default true.
    #[serde(default = "yes")]
    pub visible: bool,
}

fn yes() -> bool {
    true
}

/// A ball.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sphere {
    /// Middle [m].
    pub center: Vec3,
    /// Radius [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub radius: f64,
}

/// A box.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Cuboid {
    /// Middle [m].
    pub center: Vec3,
    /// Edge lengths, rounding included [m].
    #[schemars(inner(range(min = 1e-9)))]
    pub size: Vec3,
    /// Radius of edges and corners [m], at most half the shortest edge. Default 0.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub rounding: f64,
}

/// All points within a distance of a segment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Capsule {
    /// One end of the segment [m].
    pub start: Vec3,
    /// The other end [m].
    pub end: Vec3,
    /// Distance [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub radius: f64,
}

/// A ring.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Torus {
    /// Middle of the hole [m].
    pub center: Vec3,
    /// Direction of the hole; any length but 0. Default [0, 1, 0].
    #[serde(default = "up")]
    pub axis: Vec3,
    /// From the middle of the hole to the middle of the tube [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub major_radius: f64,
    /// Of the tube [m]; less than `major_radius`.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub minor_radius: f64,
}

/// A half space: everything behind the plane is solid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Plane {
    /// A point of the plane [m]. Default the origin.
    #[serde(default)]
    pub point: Vec3,
    /// Direction out of the solid; any length but 0. Default [0, 1, 0].
    #[serde(default = "up")]
    pub normal: Vec3,
    /// Half the width of the square of it that light meets [m]. Default 1000.
    #[serde(default = "plane_extent")]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub extent: f64,
}

fn plane_extent() -> f64 {
    1000.0
}

/// Triangles from a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Mesh {
    /// An .obj or .ply file; relative to the scene file.
    pub file: String,
    /// Distance between the samples of the mesh's signed distance [m], for flow round it. Default a 96th of its
    /// longest edge.
    #[serde(default)]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub distance_voxel: Option<f64>,
    /// Interpolate the vertex normals of the file for shading. Default true.
    #[serde(default = "yes")]
    pub smooth: bool,
}

/// Scale first, then rotation, then translation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Transform {
    /// Added last [m]. Default the origin.
    pub translate: Vec3,
    /// Turn about an axis through the origin. Default none.
    pub rotate_deg: Rotation,
    /// Uniform factor. Default 1.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub scale: f64,
}

impl Default for Transform {
    fn default() -> Self {
        Self { translate: [0.0; 3], rotate_deg: Rotation::default(), scale: 1.0 }
    }
}

/// Turn about an axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rotation {
    /// Direction of the axis; any length but 0.
    pub axis: Vec3,
    /// Angle [degrees], counterclockwise when the axis points at the viewer.
    pub angle: f64,
}

impl Default for Rotation {
    fn default() -> Self {
        Self { axis: up(), angle: 0.0 }
    }
}

/// How a shape moves: rigidly, from key to key. Before the first key and after the last it stands still.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Where it is when; times rise. At least two.
    pub keys: Vec<Key>,
    /// How it gets from key to key. Default smooth.
    #[serde(default)]
    pub interpolation: Interpolation,
}

/// Where a shape is at a time, relative to where `transform` puts it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Key {
    /// When [s]; frame `first` is at 0.
    pub time: f64,
    /// How far it has moved [m]. Default [0, 0, 0].
    #[serde(default)]
    pub translate: Vec3,
    /// How far it has turned about its own middle. Default none. From key to key it takes the shorter way: give a key at
    /// least every half turn.
    #[serde(default)]
    pub rotate_deg: Rotation,
}

/// How a shape gets from key to key.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Interpolation {
    /// At constant velocity, which jumps at keys.
    Linear,
    /// Faster in the middle, at rest at each key.
    #[default]
    Smooth,
}

/// What a surface does to light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Material {
    /// Reflects alike in all directions.
    Diffuse {
        /// Share of light reflected, 0 to 1.
        #[schemars(inner(range(min = 0.0, max = 1.0)))]
        reflectance: Rgb,
    },
}

impl Default for Material {
    fn default() -> Self {
        Self::Diffuse { reflectance: [0.5; 3] }
    }
}

/// The smoke: either `emitters` (with `advect` and `grid`), or `file`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Smoke {
    /// Sources of particles.
    #[serde(default)]
    pub emitters: Vec<Emitter>,
    /// How particles follow the flow.
    #[serde(default)]
    pub advect: Advect,
    /// The voxels that particles are splatted into; required with `emitters`.
    #[serde(default)]
    pub grid: Option<Grid>,
    /// Density from a .vdb file instead.
    #[serde(default)]
    pub file: Option<DensityFile>,
    /// What the smoke does to light.
    #[serde(default)]
    pub medium: Medium,
}

/// A source of particles: exactly one of `point`, `disk`, `sphere`, `box`, `mesh`; and either `rate` or `count`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Emitter {
    /// From one point.
    #[serde(default)]
    pub point: Option<PointSource>,
    /// From all over a disk.
    #[serde(default)]
    pub disk: Option<DiskSource>,
    /// From all over a ball.
    #[serde(default)]
    pub sphere: Option<SphereSource>,
    /// From all over a box.
    #[serde(default, rename = "box")]
    pub cuboid: Option<BoxSource>,
    /// From the surface of a shape that is a mesh.
    #[serde(default)]
    pub mesh: Option<MeshSource>,
    /// Particles born per second. More make the smoke smoother, not denser.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub rate: Option<f64>,
    /// Particles that are all born at `start`, instead of `rate`.
    #[serde(default)]
    pub count: Option<u64>,
    /// Mass given off: per second with `rate`, in all with `count` [density unit · m³, /s]. Default 1.
    #[serde(default = "one")]
    #[schemars(range(min = 0.0))]
    pub mass: f64,
    /// When it begins [s]; frame `first` is at 0, and smoke that should be there by then begins earlier. Default 0.
    #[serde(default)]
    pub start: f64,
    /// When it ends [s]. Default never.
    #[serde(default)]
    pub stop: Option<f64>,
    /// Life of a particle [s].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub lifetime: f64,
    /// Lives are spread evenly over `lifetime · (1 ± lifetime_spread)`. Default 0.2.
    #[serde(default = "lifetime_spread")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub lifetime_spread: f64,
    /// A new particle grows to its full mass over this time [s]. Default 0.1.
    #[serde(default = "fade_in")]
    #[schemars(range(min = 0.0))]
    pub fade_in: f64,
    /// A particle loses its mass over this last part of its life [s]. Default 0.5.
    #[serde(default = "fade_out")]
    #[schemars(range(min = 0.0))]
    pub fade_out: f64,
}

fn one() -> f64 {
    1.0
}

fn lifetime_spread() -> f64 {
    0.2
}

fn fade_in() -> f64 {
    0.1
}

fn fade_out() -> f64 {
    0.5
}

/// From one point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointSource {
    /// The point [m].
    pub position: Vec3,
}

/// From all over a disk.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DiskSource {
    /// Middle [m].
    pub center: Vec3,
    /// Direction it faces; any length but 0. Default [0, 1, 0].
    #[serde(default = "up")]
    pub normal: Vec3,
    /// Radius [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub radius: f64,
}

/// From all over a ball.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SphereSource {
    /// Middle [m].
    pub center: Vec3,
    /// Radius [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub radius: f64,
}

/// From all over a box.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxSource {
    /// Middle [m].
    pub center: Vec3,
    /// Edge lengths [m].
    #[schemars(inner(range(min = 1e-9)))]
    pub size: Vec3,
}

/// From the surface of a mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeshSource {
    /// Name of a shape that is a mesh.
    pub shape: String,
    /// Distance from the surface, outwards, at which particles start [m]. Default 0.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub offset: f64,
}

/// How particles follow the flow.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Advect {
    /// Scheme of a step. Default rk4.
    pub integrator: Integrator,
    /// Steps per frame. Default 1.
    #[schemars(range(min = 1, max = 1000))]
    pub substeps: u32,
}

impl Default for Advect {
    fn default() -> Self {
        Self { integrator: Integrator::Rk4, substeps: 1 }
    }
}

/// Scheme of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Integrator {
    /// One evaluation, first order.
    Euler,
    /// Midpoint: two evaluations, second order.
    Rk2,
    /// Classical Runge–Kutta: four evaluations, fourth order.
    Rk4,
}

/// The voxels that particles are splatted into.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    /// Edge of a voxel [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub voxel_size: f64,
    /// Reach of a new particle's kernel [m]. Default 1.5 voxels, which is also the least.
    #[serde(default)]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub kernel_radius: Option<f64>,
    /// The kernel of a particle widens with the square root of its age: radius² = kernel_radius² + expansion² · age
    /// [m/√s]. Default 0.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub expansion: f64,
    /// Distance from `flow.obstacles` at which kernels begin to fade, so that smoke neither hides in walls nor comes
    /// out behind thin ones [m]. 0 lets kernels ignore obstacles. Default each particle's kernel radius.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub soft_radius: Option<f64>,
}

/// Density from .vdb files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DensityFile {
    /// File; relative to the scene file. `####`, `%04d`, `$F4` or `{frame:04}` stands for the frame.
    pub path: String,
    /// Name of the grid in it. Default density.
    #[serde(default = "density_name")]
    pub density: String,
}

fn density_name() -> String {
    "density".into()
}

/// What the smoke does to light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Medium {
    /// Extinction coefficient of density 1 [1/m]. Default 10.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub extinction: f64,
    /// Share of the extinction that scatters, 0 to 1. Default 0.9.
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub albedo: Rgb,
    /// Which way light goes on. Default isotropic.
    pub phase: Phase,
}

impl Default for Medium {
    fn default() -> Self {
        Self { extinction: 10.0, albedo: [0.9; 3], phase: Phase::HenyeyGreenstein { g: 0.0 } }
    }
}

/// Which way light goes on after it scattered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Phase {
    /// Henyey and Greenstein 1941.
    HenyeyGreenstein {
        /// Mean cosine between the directions of travel before and after: 0 is isotropic, above 0 forward.
        #[schemars(range(min = -0.99, max = 0.99))]
        g: f64,
    },
}

/// A light source.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Light {
    /// Parallel light.
    Sun(Sun),
    /// Light from all around, infinitely far: exactly one of `radiance`, `gradient`, `file`.
    Environment(Environment),
    /// A rectangle that shines from its front.
    Rectangle(RectangleLight),
    /// A ball that shines.
    Sphere(SphereLight),
    /// A point.
    Point(PointLight),
}

/// Parallel light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sun {
    /// Direction in which the light travels; any length but 0.
    pub direction: Vec3,
    /// Irradiance on a surface that faces it [W/m²].
    #[schemars(inner(range(min = 0.0)))]
    pub irradiance: Rgb,
}

/// Light from all around.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Environment {
    /// The same from everywhere [W/(m² sr)].
    #[schemars(inner(range(min = 0.0)))]
    pub radiance: Option<Rgb>,
    /// A simple sky.
    pub gradient: Option<Gradient>,
    /// An .exr or .hdr picture by longitude and latitude; relative to the scene file. Its middle is −z, its top +y.
    pub file: Option<String>,
    /// Turns the picture about +y [degrees]. Default 0.
    pub rotate_deg: f64,
    /// Factor on the picture or gradient. Default 1.
    #[schemars(range(min = 0.0))]
    pub scale: Option<f64>,
    /// Whether camera rays see it; otherwise the background is black and its alpha 0. Default true.
    pub visible: Option<bool>,
}

/// A simple sky: colours by height, blended smoothly.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Gradient {
    /// Straight up [W/(m² sr)].
    #[schemars(inner(range(min = 0.0)))]
    pub zenith: Rgb,
    /// At the horizon [W/(m² sr)].
    #[schemars(inner(range(min = 0.0)))]
    pub horizon: Rgb,
    /// Straight down [W/(m² sr)].
    #[schemars(inner(range(min = 0.0)))]
    pub nadir: Rgb,
}

/// A rectangle that shines from its front.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RectangleLight {
    /// Middle [m].
    pub center: Vec3,
    /// From the middle to the middle of one edge [m].
    pub half_u: Vec3,
    /// From the middle to the middle of a neighbouring edge [m]. The front is where half_u × half_v points.
    pub half_v: Vec3,
    /// Radiance [W/(m² sr)].
    #[schemars(inner(range(min = 0.0)))]
    pub radiance: Rgb,
}

/// A ball that shines.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SphereLight {
    /// Middle [m].
    pub center: Vec3,
    /// Radius [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub radius: f64,
    /// Radiance [W/(m² sr)].
    #[schemars(inner(range(min = 0.0)))]
    pub radiance: Rgb,
}

/// A point that shines alike in all directions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointLight {
    /// Where [m].
    pub position: Vec3,
    /// Radiant intensity [W/sr].
    #[schemars(inner(range(min = 0.0)))]
    pub intensity: Rgb,
}

/// Files to write. In patterns `####`, `%04d`, `$F4` or `{frame:04}` stands for the frame and `{scene}` for the name of
/// the scene file; they are relative to the working directory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Output {
    /// Picture in linear light, .exr. Default out/{scene}.####.exr.
    pub image: String,
    /// How the pixels of the picture are packed; never with loss. Default zips.
    pub compression: Compression,
    /// Picture to look at, .png. Default none.
    pub preview: Option<String>,
    /// Density, .vdb, written by `curlsmoke bake`. Default out/{scene}.####.vdb.
    pub volume: String,
    /// Further layers of the picture. Default none.
    pub aovs: Vec<Aov>,
    /// How the preview maps light to the screen. Default standard.
    pub view: View,
    /// Stops of exposure for the preview. Default 0.
    #[schemars(range(min = -32.0, max = 32.0))]
    pub exposure_ev: f64,
}

impl Default for Output {
    fn default() -> Self {
        Self {
            image: "out/{scene}.####.exr".into(),
            compression: Compression::Zips,
            preview: None,
            volume: "out/{scene}.####.vdb".into(),
            aovs: Vec::new(),
            view: View::Standard,
            exposure_ev: 0.0,
        }
    }
}

/// How pixels are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Compression {
    /// Deflate, line by line: what compositing programs read fastest.
    Zips,
    /// Deflate, 16 lines at a time: some percent smaller.
    Zip,
    /// Wavelets: often smallest for noisy pictures, slower to read.
    Piz,
    /// Not at all.
    None,
}

/// A further layer of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Aov {
    /// Distance along the view axis to the first surface [m]; infinite where there is none. Channel Z.
    Depth,
    /// Normal of the first surface. Channels N.X, N.Y, N.Z.
    Normal,
    /// Colour of the first surface or smoke. Channels albedo.R, albedo.G, albedo.B.
    Albedo,
    /// Variance of the mean of the picture, as if samples were independent: an upper bound, since they are stratified.
    /// Infinite with one sample per pixel. Channels variance.R, variance.G, variance.B.
    Variance,
}

/// How the preview maps light to the screen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum View {
    /// Cut at 1, sRGB transfer curve.
    Standard,
    /// Khronos PBR Neutral: colours as they are up to 0.8, highlights rolled off.
    Neutral,
    /// Cut at 1, no transfer curve.
    Raw,
}
