//! The smoke: what emits it, how it is carried, and what it does to light.

use crate::settings::{Rgb, Vec3, density_name, one, up};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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
    /// Hot smoke, which glows. Default cold.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blackbody: Option<Blackbody>,
    /// Changes the density, of particles or of a file, before it is lit or baked. Default as it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remap: Option<Remap>,
    /// Detail finer than the voxels, which light meets and `bake` does not write. Default none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detail: Option<Detail>,
    /// What the smoke does to light.
    #[serde(default)]
    pub medium: Medium,
    /// Which of the many smokes that these settings give: particles and noise. With it, `render.seed` changes the grain
    /// of the picture and not the smoke, for comparing and averaging (docs/verbs.md). Default `render.seed`.
    #[serde(default)]
    pub seed: Option<u64>,
}

impl Smoke {
    /// Whether it gives off light.
    pub fn glows(&self) -> bool {
        self.medium.glows()
            || self.blackbody.is_some()
            || self.file.as_ref().is_some_and(|file| file.emission.is_some())
    }
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
    /// Particles are born at so many fixed points of the source alone, one after the other: with a `rate`, each draws a
    /// strand along the flow. Default all over it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1))]
    pub strands: Option<u64>,
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
    /// Particles that are held at once. Each frame then carries batches of so many from their birth, splats them and forgets
    /// them: memory no longer grows with the number of particles, and every frame of a sequence takes as long as it does
    /// alone. The smoke is the same to the last bit. Default all, carried on from frame to frame.
    #[schemars(range(min = 1000))]
    pub batch: Option<u64>,
}

impl Default for Advect {
    fn default() -> Self {
        Self { integrator: Integrator::Rk4, substeps: 1, batch: None }
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
    /// Distance from the walls of the flow at which kernels begin to fade, so that smoke neither hides in walls nor comes
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
    /// Name of the grid of temperatures in it, for `smoke.blackbody`. Default temperature.
    #[serde(default = "temperature_name", skip_serializing_if = "is_temperature_name")]
    pub temperature: String,
    /// Name of a grid in it of light that is given off [W/(m³ sr)]: of colours (`vec3s`), or of numbers for white. It shines
    /// also where there is no density. Not with `blackbody`. Default none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emission: Option<String>,
    /// Factor on that light. Default 1.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    #[schemars(range(min = 0.0, max = 1e9))]
    pub emission_gain: f64,
    /// Name of a grid of velocities in it (`vec3s`, at voxel centres), by which it is blurred while the shutter is open: what is at
    /// a place is taken to have come straight along the velocity there; where neither it nor density is stored, along that of the smoke
    /// nearby. Default none: no motion blur.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocity: Option<String>,
    /// Unit of these velocities. Default second.
    #[serde(default, skip_serializing_if = "VelocityUnits::is_second")]
    pub velocity_units: VelocityUnits,
}

/// Unit of velocities in a file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum VelocityUnits {
    /// Metres a second.
    #[default]
    Second,
    /// Metres a frame.
    Frame,
}

impl VelocityUnits {
    /// Whether it is the usual one.
    pub fn is_second(&self) -> bool {
        *self == Self::Second
    }
}

fn is_one(factor: &f64) -> bool {
    *factor == 1.0
}

fn temperature_name() -> String {
    "temperature".into()
}

fn is_temperature_name(name: &String) -> bool {
    name == "temperature"
}

/// Light of hot smoke, as much as physics says: what absorbs light, `extinction · (1 − albedo)`, gives off as much at its
/// temperature as a black body; the density is that before `remap`. Smoke of albedo 1 does not glow.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Blackbody {
    /// Of particles: temperature when they are born [K]: embers have 1000, a candle 1900. Default 1500.
    #[schemars(range(min = 0.0, max = 20000.0))]
    pub temperature: f64,
    /// Of particles: after this time the difference of a particle's temperature from `ambient` is 1/e of what it was [s]. Default 0.5.
    #[schemars(range(max = 1e6), extend("exclusiveMinimum" = 0.0))]
    pub cooling_time: f64,
    /// Of particles: temperature that they cool down to [K]. Default 300.
    #[schemars(range(min = 0.0, max = 20000.0))]
    pub ambient: f64,
    /// Of a file: factor that makes its numbers kelvin. Default 1.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub scale: f64,
    /// Of a file: what is added to them then [K]. Default 0.
    #[schemars(range(min = -20000.0, max = 20000.0))]
    pub offset: f64,
    /// Factor on the light: real fire is a hundred times as bright as lights whose numbers are about 1. Default 0.01.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub gain: f64,
}

impl Default for Blackbody {
    fn default() -> Self {
        Self { temperature: 1500.0, cooling_time: 0.5, ambient: 300.0, scale: 1.0, offset: 0.0, gain: 0.01 }
    }
}

/// A new density for each: `out · ((density − low)/(high − low))^gamma`, 0 below `low` and `out` above `high`. What hot smoke
/// (`blackbody`) gives off is that of the density before.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Remap {
    /// Lowest and highest density that are told apart: haze below the first vanishes, lumps above the second are even.
    #[schemars(inner(range(min = 0.0, max = 1e9)))]
    pub in_range: [f64; 2],
    /// What the highest becomes. Default high − low.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1e9))]
    pub out: Option<f64>,
    /// Above 1 thin smoke gets thinner and edges softer, below 1 it thickens. Default 1.
    #[serde(default = "one")]
    #[schemars(range(min = 0.05, max = 20.0))]
    pub gamma: f64,
}

impl Remap {
    /// The new density.
    pub fn apply(&self, density: f32) -> f32 {
        let [low, high] = self.in_range;
        let share = ((f64::from(density) - low) / (high - low)).clamp(0.0, 1.0);
        (self.out.unwrap_or(high - low) * share.powf(self.gamma)) as f32
    }
}

/// Detail finer than voxels: wherever light asks, the density is multiplied by 1 + strength · s, with s between −1 and 1 of
/// noise that flows (Perlin and Neyret 2001). The mean of the factor is 1. All light is unbiased, at a cost: flights take up to
/// twice the steps, each of which asks for the noise; lamps amid the smoke are noisier, and so is light that it gives off.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Detail {
    /// Size of the largest swirls [m]: some voxels.
    #[schemars(range(max = 1e6), extend("exclusiveMinimum" = 0.0))]
    pub length_scale: f64,
    /// Most that the factor differs from 1. Default 0.8.
    #[serde(default = "detail_strength")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub strength: f64,
    /// Factor on the noise, a third of 1 in the mean, before it is cut at −1 and 1: 1 is soft, 10 has edges. Default 2.
    #[serde(default = "two")]
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub contrast: f64,
    /// How many sizes of swirls. Default 3.
    #[serde(default = "three")]
    #[schemars(range(min = 1, max = 8))]
    pub octaves: u32,
    /// Ratio of sizes of swirls. Default 2.
    #[serde(default = "two")]
    #[schemars(range(min = 1.1, max = 10.0))]
    pub lacunarity: f64,
    /// Factor on the strength from one size to the next. Default 0.6.
    #[serde(default = "detail_gain")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub gain: f64,
    /// Turns per second of the largest swirls in place [1/s]. Default 0.
    #[serde(default)]
    #[schemars(range(min = -1000.0, max = 1000.0))]
    pub spin_rate: f64,
    /// How far small swirls are carried along where the sum of the larger ones is 1 [m] (pseudo-advection): a part of
    /// `length_scale` lets them bulge this way like a cauliflower. Default none.
    #[serde(default)]
    pub displacement: Vec3,
    /// Velocity of the pattern [m/s]: about that of the smoke. Default none.
    #[serde(default)]
    pub scroll: Vec3,
    /// Which pattern. Default 0.
    #[serde(default)]
    pub seed: u64,
}

fn detail_strength() -> f64 {
    0.8
}

fn detail_gain() -> f64 {
    0.6
}

fn two() -> f64 {
    2.0
}

fn three() -> u32 {
    3
}

/// What the smoke does to light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Medium {
    /// Extinction coefficient of density 1 [1/m]. Default 10.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub extinction: f64,
    /// Factors on the extinction for red, green and blue, 0 to 1: smoke against the light is brown at [0.6, 0.8, 1], whatever
    /// its albedo. Default white, which is also the fastest.
    #[serde(skip_serializing_if = "is_white")]
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub extinction_tint: Rgb,
    /// Share of the extinction that scatters, 0 to 1. Default 0.9.
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub albedo: Rgb,
    /// Which way light goes on. Default isotropic.
    pub phase: Phase,
    /// Light that density 1 gives off in every direction [W/(m³ sr)]: radiance that a metre of it adds. Also where
    /// `extinction` is 0, of smoke that only glows. Default black.
    #[serde(skip_serializing_if = "is_black")]
    #[schemars(inner(range(min = 0.0, max = 1e9)))]
    pub emission: Rgb,
}

const WHITE: Rgb = [1.0; 3];

fn is_white(color: &Rgb) -> bool {
    *color == WHITE
}

fn is_black(color: &Rgb) -> bool {
    *color == [0.0; 3]
}

impl Medium {
    /// Whether the extinction has a colour.
    pub fn is_tinted(&self) -> bool {
        self.extinction_tint.iter().any(|&factor| factor != self.extinction_tint[0])
    }

    /// Whether the smoke gives off light.
    pub fn glows(&self) -> bool {
        !is_black(&self.emission)
    }
}

impl Default for Medium {
    fn default() -> Self {
        Self {
            extinction: 10.0,
            extinction_tint: WHITE,
            albedo: [0.9; 3],
            phase: Phase::HenyeyGreenstein { g: 0.0 },
            emission: [0.0; 3],
        }
    }
}

/// Which way light goes on after it scattered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Phase {
    /// Alike in all directions.
    Isotropic,
    /// Henyey and Greenstein 1941.
    HenyeyGreenstein {
        /// Mean cosine between the directions of travel before and after: 0 is isotropic, above 0 forward.
        #[schemars(range(min = -0.99, max = 0.99))]
        g: f64,
    },
    /// Two of them: a bright rim against the light and some light thrown back.
    TwoLobes {
        /// Mean cosine of the first lobe.
        #[schemars(range(min = -0.99, max = 0.99))]
        g1: f64,
        /// Mean cosine of the second lobe.
        #[schemars(range(min = -0.99, max = 0.99))]
        g2: f64,
        /// Share of the first.
        #[schemars(range(min = 0.0, max = 1.0))]
        share: f64,
    },
    /// Water droplets, of steam, fog and clouds (Jendersie and d'Eon 2023): a very sharp peak forwards, some light backwards.
    Droplets {
        /// Diameter of the droplets [µm]. Fog has about 10, clouds 20.
        #[schemars(range(min = 5.0, max = 50.0))]
        diameter_um: f64,
    },
}
