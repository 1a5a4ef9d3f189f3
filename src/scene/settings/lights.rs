//! Sources of light.

use crate::settings::{Rgb, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A light source.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Light {
    /// Parallel light, or light from a disk of the sky.
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

/// Parallel light, or light from a disk of the sky.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sun {
    /// Direction in which the light travels; any length but 0.
    pub direction: Vec3,
    /// Irradiance on a surface that faces it [W/m²]: of a disk, one that faces its middle. Whatever the disk's size, this
    /// is kept; a smaller disk is brighter.
    #[schemars(inner(range(min = 0.0)))]
    pub irradiance: Rgb,
    /// Diameter of its disk in the sky [degrees]: 0, or at least 0.01. Shadows get soft edges of this angle. That of the real
    /// sun is 0.53. Default 0, parallel light.
    #[serde(default, skip_serializing_if = "is_zero")]
    #[schemars(range(min = 0.0, max = 180.0))]
    pub angular_diameter_deg: f64,
    /// Whether camera rays see the disk. Default false.
    #[serde(default, skip_serializing_if = "is_false")]
    pub visible: bool,
}

// What is left out is no part of a scene's fingerprint, so that frames of older scenes stay valid.
fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

fn is_false(x: &bool) -> bool {
    !x
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
