//! Materials and the textures on them.

use crate::settings::{Interpolation, Rgb, Vec3, up};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What a surface does to light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Material {
    /// Reflects alike in all directions, and may glow.
    Diffuse(Diffuse),
    /// A metal.
    Conductor(Conductor),
    /// Glass, water: light goes through and is bent.
    Dielectric(Dielectric),
    /// A diffuse base under a clear coat: plastic, lacquer, glazed clay.
    Plastic(Plastic),
    /// A mix of metal, plastic and glass under a coat, by the parameters that most programs share.
    Principled(Principled),
}

impl Default for Material {
    fn default() -> Self {
        Self::Diffuse(Diffuse { reflectance: Texture::Constant([0.5; 3]), emission: dark() })
    }
}

impl Material {
    /// Whether light goes through it, so that a camera inside sees out.
    pub fn is_clear(&self) -> bool {
        match self {
            Self::Dielectric(_) => true,
            Self::Principled(principled) => principled.transmission > 0.0,
            _ => false,
        }
    }

    /// Its textures by their keys: its colour, of at most 1, and what it gives off.
    pub fn textures(&self) -> [(&'static str, &Texture); 2] {
        match self {
            Self::Diffuse(m) => [("diffuse.reflectance", &m.reflectance), ("diffuse.emission", &m.emission)],
            Self::Conductor(m) => [("conductor.tint", &m.tint), ("conductor.emission", &m.emission)],
            Self::Dielectric(m) => [("dielectric.tint", &m.tint), ("dielectric.emission", &m.emission)],
            Self::Plastic(m) => [("plastic.reflectance", &m.reflectance), ("plastic.emission", &m.emission)],
            Self::Principled(m) => [("principled.base_color", &m.base_color), ("principled.emission", &m.emission)],
        }
    }

    /// Its colour.
    pub fn color(&self) -> &Texture {
        self.textures()[0].1
    }

    /// What it gives off.
    pub fn emission(&self) -> &Texture {
        self.textures()[1].1
    }
}

/// A matt surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Diffuse {
    /// Share of light reflected, 0 to 1: a colour, or a texture.
    pub reflectance: Texture,
    /// Light that the surface gives off [W/(m² sr)], to both sides: a colour, or a texture. Balls, boxes with sharp edges and
    /// meshes of one colour are lights like those under `lights`. Textures, and other shapes, are met by chance alone: the
    /// light is the same, and noisy where they are small and bright. Default none.
    #[serde(default = "dark")]
    pub emission: Texture,
}

/// A metal, by name or by index of refraction n + i k: give `metal`, or `eta` and `k`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Conductor {
    /// A metal whose index was measured.
    #[serde(default)]
    pub metal: Option<Metal>,
    /// n of red, green and blue.
    #[serde(default)]
    #[schemars(inner(range(min = 0.001, max = 1000.0)))]
    pub eta: Option<Rgb>,
    /// k of red, green and blue.
    #[serde(default)]
    #[schemars(inner(range(min = 0.0, max = 1000.0)))]
    pub k: Option<Rgb>,
    /// How rough it looks, 0 to 1: the root of alpha of GGX. Below 0.01 a perfect mirror. Default 0.2.
    #[serde(default = "roughness")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub roughness: f64,
    /// Share of what the bare metal reflects, 0 to 1: a colour, or a texture. Default [1, 1, 1].
    #[serde(default = "white")]
    pub tint: Texture,
    /// As that of a diffuse surface. Default none.
    #[serde(default = "dark")]
    pub emission: Texture,
}

/// A metal with a measured index of refraction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Metal {
    /// Aluminium.
    Aluminium,
    /// Chromium.
    Chromium,
    /// Copper.
    Copper,
    /// Gold.
    Gold,
    /// Iron.
    Iron,
    /// Silver.
    Silver,
    /// Titanium.
    Titanium,
}

/// A body that light goes through, in air. Each of its surfaces is one between it and air: bodies that touch or overlap have
/// two. Shadow rays do not go through: lights with an extent are found by paths, but no path finds a `point` or a `sun` behind
/// glass, which then casts a full shadow.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Dielectric {
    /// Index of refraction inside over that outside: glass 1.5, water 1.33, a bubble of air in water 0.75. Default 1.5.
    #[serde(default = "ior")]
    #[schemars(range(min = 0.2, max = 5.0))]
    pub ior: f64,
    /// How rough it looks, 0 to 1: the root of alpha of GGX. Below 0.01 perfectly smooth. Default 0.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub roughness: f64,
    /// Share let through at the surface of light that is not reflected, 0 to 1: a colour, or a texture. Light that goes in and
    /// out meets it twice. Default [1, 1, 1].
    #[serde(default = "white")]
    pub tint: Texture,
    /// As that of a diffuse surface. Default none.
    #[serde(default = "dark")]
    pub emission: Texture,
}

/// A diffuse base under a clear coat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Plastic {
    /// Share that the base reflects of light that passes the coat, 0 to 1: a colour, or a texture.
    pub reflectance: Texture,
    /// Index of refraction of the coat. Default 1.5.
    #[serde(default = "ior")]
    #[schemars(range(min = 1.0, max = 5.0))]
    pub ior: f64,
    /// How rough the coat looks, 0 to 1: the root of alpha of GGX. Below 0.01 perfectly smooth. Default 0.2.
    #[serde(default = "roughness")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub roughness: f64,
    /// As that of a diffuse surface. Default none.
    #[serde(default = "dark")]
    pub emission: Texture,
}

/// A mix of metal, plastic and glass under a coat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Principled {
    /// What the base of plastic and metal (at normal incidence) reflects, and what glass lets through at its surface, 0 to 1: a
    /// colour, or a texture.
    pub base_color: Texture,
    /// Share of metal, 0 to 1. Default 0.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub metallic: f64,
    /// How rough all but the coat looks, 0 to 1: the root of alpha of GGX. Below 0.01 perfectly smooth. Default 0.5.
    #[serde(default = "half")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub roughness: f64,
    /// Index of refraction of what is no metal. Default 1.5.
    #[serde(default = "ior")]
    #[schemars(range(min = 1.0, max = 5.0))]
    pub ior: f64,
    /// Share of glass in what is no metal, 0 to 1. Default 0.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub transmission: f64,
    /// Strength of a clear coat on top, 0 to 1. Default 0.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub coat: f64,
    /// How rough the coat looks, 0 to 1. Default 0.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub coat_roughness: f64,
    /// As that of a diffuse surface. Default none.
    #[serde(default = "dark")]
    pub emission: Texture,
}

fn roughness() -> f64 {
    0.2
}

fn half() -> f64 {
    0.5
}

fn ior() -> f64 {
    1.5
}

fn white() -> Texture {
    Texture::Constant([1.0; 3])
}

fn dark() -> Texture {
    Texture::Constant([0.0; 3])
}

/// A colour at each point of space, seen where surfaces are: one colour, or a pattern.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Texture {
    /// Colours that swirl and flow.
    FlowNoise(Box<FlowNoise>),
    /// Layers of two colours.
    Stripes(Stripes),
    /// Cubes of two colours.
    Checker(Checker),
    /// Shells of two colours round a point.
    Rings(Rings),
    /// A picture from a file.
    Image(Box<ImageTexture>),
    /// One colour.
    #[serde(untagged)]
    Constant(#[schemars(inner(range(min = 0.0)))] Rgb),
}

impl Texture {
    /// All colours that it blends; of a picture none, whose colours are in its file.
    pub fn colors(&self) -> Vec<Rgb> {
        match self {
            Self::FlowNoise(noise) => noise.ramp.iter().map(|stop| stop.color).collect(),
            Self::Stripes(stripes) => stripes.colors.to_vec(),
            Self::Checker(checker) => checker.colors.to_vec(),
            Self::Rings(rings) => rings.colors.to_vec(),
            Self::Image(_) => Vec::new(),
            Self::Constant(color) => vec![*color],
        }
    }

    /// Whether it is black everywhere, whatever a picture shows.
    pub fn is_black(&self) -> bool {
        if let Self::Image(image) = self {
            return image.scale == 0.0;
        }
        self.colors().iter().all(|color| *color == [0.0; 3])
    }
}

/// Layers of two colours.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Stripes {
    /// How many pairs of layers go by in a metre along each axis [1/m].
    pub along: Vec3,
    /// The two colours.
    #[schemars(inner(inner(range(min = 0.0))))]
    pub colors: [Rgb; 2],
}

/// Cubes of two colours, whose corners meet at the origin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Checker {
    /// Edge of a cube [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub size: f64,
    /// The two colours.
    #[schemars(inner(inner(range(min = 0.0))))]
    pub colors: [Rgb; 2],
}

/// Shells of two colours round a point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rings {
    /// The point [m].
    pub center: Vec3,
    /// Thickness of a shell [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub width: f64,
    /// The two colours, the innermost first.
    #[schemars(inner(inner(range(min = 0.0))))]
    pub colors: [Rgb; 2],
}

/// A picture laid on a shape where it rests; between its pixels colours blend.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageTexture {
    /// A .png, .exr or .hdr file; relative to the scene file. Numbers of a .png are those of a screen (sRGB), those of the
    /// others are light already.
    pub file: String,
    /// How it is laid on.
    pub projection: Projection,
    /// Factor on its colours. Default 1.
    #[serde(default = "one")]
    #[schemars(range(min = 0.0))]
    pub scale: f64,
}

/// How a picture is laid on a shape.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Projection {
    /// By longitude and latitude, as on a globe.
    LatLong(LatLong),
    /// Tiles along the three axes, each seen where the surface faces it.
    Triplanar(Triplanar),
    /// From one side, through and through.
    Planar(Planar),
}

/// A picture by longitude and latitude about a point: north at its top, its middle towards +z, east to its right as seen
/// from outside. Round the globe it closes; at the poles it ends with its first and last row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LatLong {
    /// The point [m].
    pub center: Vec3,
    /// Where north is; any length but 0. Default [0, 1, 0].
    #[serde(default = "up")]
    pub north: Vec3,
    /// Turn about the axis towards east [degrees]. Default 0.
    #[serde(default)]
    pub turn_deg: f64,
}

/// A picture in tiles along the three axes, blended where the surface turns from one to the other. It is upright on sides
/// and not mirrored from behind.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Triplanar {
    /// Width of a tile [m]; its height is that of the picture.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub tile: f64,
    /// A corner of a tile [m]. Default the origin.
    #[serde(default)]
    pub offset: Vec3,
    /// How abruptly one side gives way to the next: the power of the normal's parts that weigh them. Default 4.
    #[serde(default = "sharpness")]
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub sharpness: f64,
}

fn sharpness() -> f64 {
    4.0
}

/// A picture laid on from one side, the same all along the rectangle's normal, repeated round it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Planar {
    /// Where the middle of the picture is [m].
    pub center: Vec3,
    /// From the middle to the right edge [m].
    pub half_u: Vec3,
    /// From the middle to the upper edge [m]; at a right angle to `half_u`.
    pub half_v: Vec3,
}

/// A flow along the surface of a shape, which carries its textures along (Bærentzen et al. 2025): without divergence, so that
/// nothing is thinned out, drawn out into swirls instead.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SurfaceFlow {
    /// Size of the swirls [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub length_scale: f64,
    /// How far things have been carried at time 0 [m]: the length of their ways at the root mean square speed; backwards
    /// where negative. Default 0.
    #[serde(default)]
    pub distance: f64,
    /// How much farther each second [m/s]. Default 0.
    #[serde(default)]
    pub speed: f64,
    /// How far things have been carried when, in place of `distance` and `speed`; times rise. Default none.
    // What is left out is no part of a scene's fingerprint, so that frames of older scenes stay valid.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub keys: Vec<SurfaceFlowKey>,
    /// How the flow gets from key to key. Default ease.
    #[serde(default, skip_serializing_if = "is_eased")]
    pub interpolation: Interpolation,
    /// Steps that the way is cut into. Default 16 for each `length_scale` of the way, at least 16 and at most 4096.
    #[serde(default)]
    #[schemars(range(min = 1, max = 4096))]
    pub steps: Option<u32>,
    /// How each step is taken. Default rk4.
    #[serde(default)]
    pub integrator: SurfaceIntegrator,
    /// How often a point is put back on the surface, and on its line, after each step. Default 1.
    #[serde(default = "reprojections")]
    #[schemars(range(min = 0, max = 16))]
    pub reprojections: u32,
    /// Distance between the nodes at which the flow is followed [m]; between them it is interpolated, which is many times
    /// as fast from some dozen paths a pixel on; filaments finer than this are broken up. 0 follows every point by itself,
    /// and so do shapes of more than a thousand nodes along an edge, or whose nodes would need more than a quarter of
    /// `render.memory_limit_gib`. Default a 160th of `length_scale`.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub cache_spacing: Option<f64>,
    /// Which of the many patterns. Default 0.
    #[serde(default)]
    pub seed: u64,
}

/// How far a flow along a surface has gone at a time. Before the first key and after the last it stands still.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SurfaceFlowKey {
    /// When [s]; frame `first` is at 0.
    pub time: f64,
    /// How far things have been carried [m]: the length of their ways at the root mean square speed; backwards where
    /// negative.
    pub distance: f64,
    /// Size of the swirls [m]; where it changes, the pattern grows from the origin. Default that of the flow.
    #[serde(default)]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub length_scale: Option<f64>,
    /// Steps that the way is cut into; in between, those of both keys blend. Default that of the flow.
    #[serde(default)]
    #[schemars(range(min = 1, max = 4096))]
    pub steps: Option<u32>,
}

/// How a step along a surface is taken.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceIntegrator {
    /// One evaluation a step.
    Euler,
    /// Four evaluations a step: classical Runge–Kutta.
    #[default]
    Rk4,
}

fn is_eased(interpolation: &Interpolation) -> bool {
    *interpolation == Interpolation::Ease
}

fn reprojections() -> u32 {
    1
}

/// A texture of flow noise (Perlin and Neyret 2001): octaves of noise, whose gradients may turn and the larger of which may
/// carry the smaller along, added up and looked up in a ramp of colours. It fills space and is seen where surfaces are; on
/// a shape that moves it moves along.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlowNoise {
    /// Size of the largest features [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub length_scale: f64,
    /// Number of sizes. Default 4.
    #[serde(default = "octaves")]
    #[schemars(range(min = 1, max = 16))]
    pub octaves: u32,
    /// Factor on the strength from one octave to the next. Default 0.5.
    #[serde(default = "gain")]
    #[schemars(range(min = 0.0, max = 4.0))]
    pub gain: f64,
    /// Ratio of the sizes of neighbouring octaves. Default 2.
    #[serde(default = "lacunarity")]
    #[schemars(range(min = 1.01, max = 16.0))]
    pub lacunarity: f64,
    /// Add up the absolute values of octaves, which makes creases where they change sign: crusts, cracks, billows.
    /// Default false.
    #[serde(default)]
    pub folded: bool,
    /// How many times longer features are along each axis. Default [1, 1, 1].
    #[serde(default = "ones")]
    #[schemars(inner(range(min = 0.001, max = 1000.0)))]
    pub stretch: Vec3,
    /// Turns per second of the gradients of the largest features; smaller ones turn faster in proportion to their
    /// frequency. Default 0: frozen.
    #[serde(default)]
    #[schemars(range(min = -1000.0, max = 1000.0))]
    pub spin_rate: f64,
    /// How often in a second the largest features are replaced by others; smaller ones in proportion to their frequency.
    /// Not together with `spin_rate`. Default 0: frozen.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub evolve_rate: f64,
    /// Velocity of the whole pattern [m/s]. Default 0.
    #[serde(default)]
    pub scroll: Vec3,
    /// How far the pattern is moved [m]. Default 0.
    #[serde(default)]
    pub offset: Vec3,
    /// How far features are displaced where the sum of all larger ones is 1 [m] (pseudo-advection), times `memory`.
    /// Default [0, 0, 0].
    #[serde(default)]
    pub displacement: Vec3,
    /// How much of `displacement` is applied, the structure memory of the paper: 1 for features that last and are drawn
    /// out, 0 for such as are always made anew. Default 1.
    #[serde(default = "one")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub memory: f64,
    /// How much of the ramp goes by in a metre along each axis, whatever the noise [1/m]. Default [0, 0, 0].
    #[serde(default)]
    pub along: Vec3,
    /// How far the noise moves the place in the ramp. The noise itself has a root mean square of a third and hardly leaves
    /// −1 to 1; folded it goes from 0 to about 1, with a mean of a quarter. Default 1.
    #[serde(default = "one")]
    pub amplitude: f64,
    /// Begin the ramp again beyond its ends, instead of going on with its last colours. Default false.
    #[serde(default)]
    pub repeat: bool,
    /// Colours at places that rise: at least two.
    #[schemars(length(min = 2))]
    pub ramp: Vec<Stop>,
    /// Which of the many patterns. Default 0.
    #[serde(default)]
    pub seed: u64,
}

/// A colour of a ramp.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Stop {
    /// Where in the ramp.
    pub at: f64,
    /// The colour there; between stops they blend.
    #[schemars(inner(range(min = 0.0)))]
    pub color: Rgb,
}

fn octaves() -> u32 {
    4
}

fn gain() -> f64 {
    0.5
}

fn lacunarity() -> f64 {
    2.0
}

fn one() -> f64 {
    1.0
}

fn ones() -> Vec3 {
    [1.0; 3]
}
