//! Settings of `flow`: what moves the particles.

use crate::settings::{Rgb, Vec3, up};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What moves the particles: the curl of a sum of potentials, bent round obstacles; or `dfvn`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Flow {
    /// Terms of the potential.
    pub potentials: Vec<Potential>,
    /// Names of the shapes that no smoke passes through.
    pub obstacles: Vec<String>,
    /// Names of the shapes that no smoke leaves.
    pub containers: Vec<String>,
    /// A flow in two dimensions, in the planes across this direction, alike in all of them but for the shapes: any length
    /// but 0. Default all three dimensions.
    pub planar: Option<Vec3>,
    /// Which of the obstacles and containers hold the flow fast at their walls; along the others it slips. Default none.
    pub no_slip: Vec<String>,
    /// A steady flow along threads, instead of everything else here. Default none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dfvn: Option<Dfvn>,
}

impl Flow {
    /// Names of the shapes that hold the flow inside.
    pub fn holders(&self) -> impl Iterator<Item = &String> {
        self.containers.iter().chain(self.dfvn.iter().filter_map(|dfvn| dfvn.inside.as_ref()))
    }

    /// Whether the flow asks for the distance of a shape, but for masks.
    pub fn minds(&self, shape: &str) -> bool {
        let along = self.dfvn.iter().filter_map(|dfvn| dfvn.along.as_ref());
        self.obstacles.iter().chain(self.holders()).chain(along).any(|name| name == shape)
    }
}

/// Divergence-free vector noise (Bærentzen et al. 2025): the product ∇f × ∇g of the gradients of two noises. Both keep
/// their values along the flow, so that smoke from one place draws a thread; each particle keeps the values of its birth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Dfvn {
    /// Size of the swirls [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub length_scale: f64,
    /// Root mean square speed [m/s] outside of any `margin`, over all noises: the gradients' lengths are known on average,
    /// and the root mean square of their product is √(2/3) of the product of theirs.
    pub speed: f64,
    /// Which of the many patterns. Default 0; mixed with `smoke.seed`.
    #[serde(default)]
    pub seed: u64,
    /// Name of a closed shape that the flow stays inside of, not a box: near its wall, f is blended with the distance to it
    /// (equation 13). It must be at rest. Default none.
    #[serde(default)]
    pub inside: Option<String>,
    /// Depth below the wall of `inside` over which that is done [m]: at most that of the shape's deepest points, of a union
    /// that of its shallowest part. Default `length_scale`, or that depth where it is less.
    #[serde(default)]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub margin: Option<f64>,
    /// Name of a shape along whose surface smoke flows, or along the surfaces of equal distance to it: g is the distance
    /// instead of a noise. It must be at rest. Default none.
    #[serde(default)]
    pub along: Option<String>,
    /// How often particles are put back on their values of f and g after each step. 0 lets them drift. Default 2.
    #[serde(default = "reprojections")]
    #[schemars(range(min = 0, max = 16))]
    pub reprojections: u32,
    /// How they are put back. Default least_norm.
    #[serde(default)]
    pub reprojection: ReprojectionKind,
}

fn reprojections() -> u32 {
    2
}

/// How a particle is put back on its values.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReprojectionKind {
    /// By the shortest way that mends both to first order (equations 10 and 11).
    #[default]
    LeastNorm,
    /// By a Newton step towards one after the other (equation 12): a little cheaper, and not as close.
    Newton,
}

/// One term of the potential.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Potential {
    /// The same velocity everywhere.
    Uniform(Uniform),
    /// Layers that slide along each other.
    Shear(Shear),
    /// The motion of a rigid body.
    Rigid(Rigid),
    /// A rising column.
    Plume(Plume),
    /// Swirls of many sizes.
    Noise(Noise),
    /// A whirl about a point.
    Vortex(Vortex),
    /// A whirl bent to a circle, such as a smoke ring.
    VortexRing(VortexRing),
    /// A whirl along any line.
    VortexCurve(VortexCurve),
}

impl Potential {
    /// Its key in the scene file.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Uniform(_) => "uniform",
            Self::Shear(_) => "shear",
            Self::Rigid(_) => "rigid",
            Self::Plume(_) => "plume",
            Self::Noise(_) => "noise",
            Self::Vortex(_) => "vortex",
            Self::VortexRing(_) => "vortex_ring",
            Self::VortexCurve(_) => "vortex_curve",
        }
    }

    /// The masks that it is multiplied with.
    pub fn masks(&self) -> &[Mask] {
        match self {
            Self::Uniform(p) => &p.modulate,
            Self::Shear(p) => &p.modulate,
            Self::Rigid(p) => &p.modulate,
            Self::Plume(p) => &p.modulate,
            Self::Noise(p) => &p.modulate,
            Self::Vortex(p) => &p.modulate,
            Self::VortexRing(p) => &p.modulate,
            Self::VortexCurve(p) => &p.modulate,
        }
    }
}

/// The same velocity everywhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Uniform {
    /// Velocity [m/s].
    pub velocity: Vec3,
    /// Distance from obstacles over which the flow bends [m]. Default half the obstacle's middle extent.
    #[serde(default)]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub influence_radius: Option<f64>,
    /// Where the potential is zero [m]; matters only with `modulate`, whose edges are flowed round about this point.
    /// Default the origin.
    #[serde(default)]
    pub origin: Vec3,
    /// Masks that the potential is multiplied with.
    #[serde(default)]
    pub modulate: Vec<Mask>,
}

/// Layers that slide along each other: velocity `rate · (x − origin)·across` along `direction`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Shear {
    /// Where the flow goes; any length but 0.
    pub direction: Vec3,
    /// Where it gets faster; any length but 0, and not along `direction`, whose part in it is left out.
    pub across: Vec3,
    /// How much faster for each metre [1/s].
    pub rate: f64,
    /// A point that stands still [m]. Default the origin.
    #[serde(default)]
    pub origin: Vec3,
    /// Distance from obstacles over which the flow bends [m]. Default half the obstacle's longest extent.
    #[serde(default)]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub influence_radius: Option<f64>,
    /// Masks that the potential is multiplied with.
    #[serde(default)]
    pub modulate: Vec<Mask>,
}

/// The motion of a rigid body: `velocity + angular_velocity × (x − center)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rigid {
    /// A point of the axis [m]. Default the origin.
    #[serde(default)]
    pub center: Vec3,
    /// Velocity of that point [m/s]. Default 0.
    #[serde(default)]
    pub velocity: Vec3,
    /// Axis and speed of the rotation [rad/s].
    pub angular_velocity: Vec3,
    /// Distance from obstacles over which the flow bends [m]. Default half the obstacle's longest extent.
    #[serde(default)]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub influence_radius: Option<f64>,
    /// Masks that the potential is multiplied with.
    #[serde(default)]
    pub modulate: Vec<Mask>,
}

/// A column that rises from a base and pulls in what is round it, as warm air does.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Plume {
    /// Middle of the base [m].
    pub base: Vec3,
    /// Where it rises; any length but 0. Default [0, 1, 0].
    #[serde(default = "up")]
    pub axis: Vec3,
    /// Of the column at its base [m]; beyond it nothing rises.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub radius: f64,
    /// Speed on the axis, once it is reached [m/s].
    pub speed: f64,
    /// Height over which that speed is reached [m]. Default twice `radius`.
    #[serde(default)]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub rise: Option<f64>,
    /// Distance from obstacles over which the flow bends [m]. Default half the obstacle's longest extent.
    #[serde(default)]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub influence_radius: Option<f64>,
    /// Masks that the potential is multiplied with.
    #[serde(default)]
    pub modulate: Vec<Mask>,
}

/// Swirls of many sizes: a sum of octaves of gradient noise, each half as large as the one before.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// Size of the largest swirls [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub length_scale: f64,
    /// Root mean square speed of the largest swirls [m/s].
    #[schemars(range(min = 0.0))]
    pub speed: f64,
    /// Number of sizes. Default 3.
    #[serde(default = "octaves")]
    #[schemars(range(min = 1, max = 16))]
    pub octaves: u32,
    /// How speed falls from one octave to the next. Default kolmogorov.
    #[serde(default)]
    pub gain: Gain,
    /// Ratio of the sizes of neighbouring octaves. Default 2.
    #[serde(default = "lacunarity")]
    #[schemars(range(min = 1.01, max = 16.0))]
    pub lacunarity: f64,
    /// Turns per second of the gradients of the largest swirls; smaller ones turn faster in proportion to their
    /// frequency. Default 0: frozen.
    #[serde(default)]
    #[schemars(range(min = -1000.0, max = 1000.0))]
    pub spin_rate: f64,
    /// How often in a second the largest swirls are replaced by others (noise in four dimensions, the fourth being time);
    /// smaller ones in proportion to their frequency. Not together with `spin_rate`. Default 0: frozen.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub evolve_rate: f64,
    /// Swirls in the planes across this direction only, alike in all of them: a flow in two dimensions. Any length but
    /// 0. Default all three dimensions.
    #[serde(default)]
    pub planar: Option<Vec3>,
    /// How far swirls are carried along by larger ones (pseudo-advection), which draws them out into filaments: 0 not at
    /// all, 1 by an eighth of the size of each larger one. Costs four times as much. Default 0.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub memory: f64,
    /// How the velocity is made of noise. Default curl.
    #[serde(default)]
    pub form: NoiseForm,
    /// Velocity with which the pattern itself moves [m/s]. Default 0.
    #[serde(default)]
    pub scroll: Vec3,
    /// How far the pattern is moved [m]. Default 0.
    #[serde(default)]
    pub offset: Vec3,
    /// Which of the many patterns. Default 0; mixed with `smoke.seed`.
    #[serde(default)]
    pub seed: u64,
    /// Masks that the potential is multiplied with.
    #[serde(default)]
    pub modulate: Vec<Mask>,
}

fn octaves() -> u32 {
    3
}

fn lacunarity() -> f64 {
    2.0
}

/// How a velocity is made of noise.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NoiseForm {
    /// The curl of three noises.
    #[default]
    Curl,
    /// The cross product of the gradients of two noises: cheaper, with sharper jets between wider calm; for what is far.
    Bitangent,
}

/// How the speed of swirls falls with their size.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Gain {
    /// As the cube root of size, as in real turbulence.
    #[default]
    Kolmogorov,
    /// A number: factor on the speed from one octave to the next.
    #[serde(untagged)]
    Speed(#[schemars(range(min = 0.0, max = 4.0))] f64),
}

/// A whirl about a point: rigid rotation in its middle, rest beyond its radius.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Vortex {
    /// Middle at time 0 [m].
    pub center: Vec3,
    /// Axis and speed of the rotation in the middle [rad/s].
    pub angular_velocity: Vec3,
    /// Beyond it nothing moves [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub radius: f64,
    /// With which the whirl travels [m/s]. Default 0.
    #[serde(default)]
    pub velocity: Vec3,
    /// Masks that the potential is multiplied with.
    #[serde(default)]
    pub modulate: Vec<Mask>,
}

/// A whirl bent to a circle. Through the ring the flow goes along `axis`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VortexRing {
    /// Middle of the ring at time 0 [m].
    pub center: Vec3,
    /// Direction of the flow through the ring; any length but 0. Default [0, 1, 0].
    #[serde(default = "up")]
    pub axis: Vec3,
    /// Of the circle [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub radius: f64,
    /// Distance from the circle beyond which nothing moves [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub core: f64,
    /// Largest speed round the circle, were it straight [m/s].
    pub speed: f64,
    /// With which the ring travels [m/s]. Default 0.
    #[serde(default)]
    pub velocity: Vec3,
    /// Masks that the potential is multiplied with.
    #[serde(default)]
    pub modulate: Vec<Mask>,
}

/// A whirl along a line through points. Seen with the line coming at you, it turns counterclockwise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VortexCurve {
    /// Points of the line at time 0 [m]; at least two.
    pub points: Vec<Vec3>,
    /// From point to point in straight lines, or along a smooth curve through all. Default true: smooth.
    #[serde(default = "crate::settings::yes")]
    pub smooth: bool,
    /// Whether it goes on from the last point to the first. Default false.
    #[serde(default)]
    pub closed: bool,
    /// Distance from the line beyond which nothing moves [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub core: f64,
    /// Largest speed round the line, were it straight [m/s].
    pub speed: f64,
    /// With which the line travels [m/s]. Default 0.
    #[serde(default)]
    pub velocity: Vec3,
    /// Masks that the potential is multiplied with.
    #[serde(default)]
    pub modulate: Vec<Mask>,
}

/// A number at each point that a potential is multiplied with, mostly between 0 and 1 and without kinks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Mask {
    /// By height: 0 below, 1 above.
    Height(HeightMask),
    /// By the distance from a shape of the scene; it moves with the shape.
    Shape(ShapeMask),
    /// By the distance from a ball.
    Sphere(SphereMask),
    /// By the distance from a box.
    Box(BoxMask),
    /// The turbulent wake behind a body.
    Wake(WakeMask),
    /// Patches at random.
    Noise(NoiseMask),
    /// Brightness of a picture.
    Image(ImageMask),
    /// Values of a .vdb grid.
    Grid(GridMask),
}

/// 0 at the height `from`, 1 at `to`, which may be lower. Constant beyond both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeightMask {
    /// Height at which the mask is 0 [m].
    pub from: f64,
    /// Height at which it is 1 [m].
    pub to: f64,
    /// Which way is up; any length but 0. Default [0, 1, 0].
    #[serde(default = "up")]
    pub axis: Vec3,
}

/// 0 at the distance `from`, 1 at `to`. Distances inside are negative; `from` may be larger than `to`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ShapeMask {
    /// Name of the shape.
    pub name: String,
    /// Distance at which the mask is 0 [m].
    pub from: f64,
    /// Distance at which it is 1 [m].
    pub to: f64,
}

/// 0 at the distance `from` of the ball, 1 at `to`. Distances inside are negative.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SphereMask {
    /// Middle [m].
    pub center: Vec3,
    /// Radius [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub radius: f64,
    /// Distance at which the mask is 0 [m].
    pub from: f64,
    /// Distance at which it is 1 [m].
    pub to: f64,
}

/// 0 at the distance `from` of the box, 1 at `to`. Distances inside are negative.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxMask {
    /// Middle [m].
    pub center: Vec3,
    /// Edge lengths [m].
    #[schemars(inner(range(min = 1e-9)))]
    pub size: Vec3,
    /// Distance at which the mask is 0 [m].
    pub from: f64,
    /// Distance at which it is 1 [m].
    pub to: f64,
}

/// 1 in a widening tail behind a body, 0 elsewhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WakeMask {
    /// Name of the body.
    pub shape: String,
    /// Where the tail points: with the wind; any length but 0.
    pub direction: Vec3,
    /// From the body's middle to where the tail has faded [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub length: f64,
    /// Half the tail's width at the body [m]. Default half the body's middle extent.
    #[serde(default)]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub radius: Option<f64>,
    /// Metres that the tail's edge moves outwards for each metre behind the body. Default 0.2.
    #[serde(default = "spread")]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub spread: f64,
}

fn spread() -> f64 {
    0.2
}

/// Patches at random: smooth numbers between `low` and `high`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NoiseMask {
    /// Size of the patches [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub length_scale: f64,
    /// Least value. Default 0.
    #[serde(default)]
    pub low: f64,
    /// Largest value. Default 1.
    #[serde(default = "crate::settings::one")]
    pub high: f64,
    /// Which of the many patterns. Default 0; mixed with `smoke.seed`.
    #[serde(default)]
    pub seed: u64,
}

/// Brightness of a picture laid over a rectangle, the same all along the rectangle's normal; 0 outside.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageMask {
    /// An .exr or .hdr file; relative to the scene file.
    pub file: String,
    /// Where the middle of the picture is [m].
    pub center: Vec3,
    /// From the middle to the right edge [m].
    pub half_u: Vec3,
    /// From the middle to the upper edge [m]; at a right angle to `half_u`.
    pub half_v: Vec3,
    /// How bright each colour counts. Default [0.2126, 0.7152, 0.0722].
    #[serde(default = "luminance")]
    pub weights: Rgb,
}

fn luminance() -> Rgb {
    [0.2126, 0.7152, 0.0722]
}

/// Values of a .vdb grid, times `scale`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GridMask {
    /// A .vdb file; relative to the scene file.
    pub file: String,
    /// Name of its grid. Default density.
    #[serde(default = "crate::settings::density_name")]
    pub grid: String,
    /// Factor on its values. Default 1.
    #[serde(default = "crate::settings::one")]
    pub scale: f64,
}
