//! Sources of light.

use crate::settings::{Keyed, Rgb, Vec3, yes};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A light source.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Light {
    /// Parallel light, or light from a disk of the sky.
    Sun(Sun),
    /// Light from all around, infinitely far: exactly one of `radiance`, `gradient`, `file`, `sky`.
    Environment(Environment),
    /// A rectangle that shines from its front.
    Rectangle(RectangleLight),
    /// A disk that shines from its front.
    Disk(DiskLight),
    /// A ball that shines.
    Sphere(SphereLight),
    /// A point.
    Point(PointLight),
    /// A point that shines into a cone.
    Spot(SpotLight),
}

impl Light {
    /// Its key in a scene.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Sun(_) => "sun",
            Self::Environment(_) => "environment",
            Self::Rectangle(_) => "rectangle",
            Self::Disk(_) => "disk",
            Self::Spot(_) => "spot",
            Self::Sphere(_) => "sphere",
            Self::Point(_) => "point",
        }
    }

    /// Whether it changes in time.
    pub fn varies(&self) -> bool {
        match self {
            Self::Sun(l) => l.direction.varies() || l.irradiance.varies(),
            Self::Environment(l) => l.rotate_deg.varies() || l.scale.as_ref().is_some_and(Keyed::varies),
            Self::Rectangle(l) => [&l.center, &l.half_u, &l.half_v, &l.radiance].into_iter().any(Keyed::varies),
            Self::Disk(l) => [&l.center, &l.normal, &l.radiance].into_iter().any(Keyed::varies) || l.radius.varies(),
            Self::Sphere(l) => [&l.center, &l.radiance].into_iter().any(Keyed::varies) || l.radius.varies(),
            Self::Point(l) => [&l.position, &l.intensity].into_iter().any(Keyed::varies),
            Self::Spot(l) => {
                [&l.position, &l.direction, &l.intensity].into_iter().any(Keyed::varies)
                    || [&l.cone_deg, &l.blend].into_iter().any(Keyed::varies)
            }
        }
    }

    /// Its group, if it is in one.
    pub fn group(&self) -> Option<&str> {
        let group = match self {
            Self::Sun(light) => &light.group,
            Self::Environment(light) => &light.group,
            Self::Rectangle(light) => &light.group,
            Self::Disk(light) => &light.group,
            Self::Spot(light) => &light.group,
            Self::Sphere(light) => &light.group,
            Self::Point(light) => &light.group,
        };
        group.as_deref()
    }
}

/// Parallel light, or light from a disk of the sky.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sun {
    /// Direction in which the light travels; any length but 0.
    pub direction: Keyed<Vec3>,
    /// Irradiance on a surface that faces it [W/m²]: of a disk, one that faces its middle. Whatever the disk's size, this
    /// is kept; a smaller disk is brighter.
    #[schemars(inner(range(min = 0.0)))]
    pub irradiance: Keyed<Rgb>,
    /// Diameter of its disk in the sky [degrees]: 0, or at least 0.01. Shadows get soft edges of this angle. That of the real
    /// sun is 0.53. Default 0, parallel light.
    #[serde(default, skip_serializing_if = "is_zero")]
    #[schemars(range(min = 0.0, max = 180.0))]
    pub angular_diameter_deg: f64,
    /// Whether camera rays see the disk. Default false.
    #[serde(default, skip_serializing_if = "is_false")]
    pub visible: bool,
    /// Group of lights, with a layer of its own: see `light_groups` of `output.aovs`. Default none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
}

// What is left out is no part of a scene's fingerprint, so that frames of older scenes stay valid.
fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

fn is_false(x: &bool) -> bool {
    !x
}

fn is_true(x: &bool) -> bool {
    *x
}

/// Light from all around. With keys its picture is read, or its sky computed, again for each frame.
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
    /// A clear sky of air and haze, with its sun.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sky: Option<Sky>,
    /// Turns the picture or the sky about +y [degrees]. Default 0.
    pub rotate_deg: Keyed<f64>,
    /// Factor on the picture, the gradient, or the sky and its sun. Default 1.
    #[schemars(range(min = 0.0))]
    pub scale: Option<Keyed<f64>>,
    /// Whether camera rays see it; otherwise the background is black and its alpha 0. Default true.
    pub visible: Option<bool>,
    /// Group of lights, with a layer of its own: see `light_groups` of `output.aovs`. Default none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
}

/// A clear sky of an earth-like planet, seen from the ground, with its sun. Sunlight scatters in air, haze and ozone, once
/// and more often, and comes back from the ground, which is all there is below the horizon. The sun outside of the air is
/// white and has 1361 W/m² in each channel: pictures need a `scale` of about 1/1000, or as much less exposure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sky {
    /// Height of the sun's middle above the horizon [degrees]; below 0 it has set.
    #[schemars(range(min = -10.0, max = 90.0))]
    pub sun_elevation_deg: f64,
    /// Where the sun stands: from −z, towards +x [degrees]. Default 0.
    #[serde(default)]
    pub sun_azimuth_deg: f64,
    /// Optical depth of air and haze over that of air alone, straight up in green light: 1 is pure air, 2 to 3 a clear day,
    /// 10 thick haze. Default 2.5.
    #[serde(default = "turbidity")]
    #[schemars(range(min = 1.0, max = 20.0))]
    pub turbidity: f64,
    /// Share of light that the ground reflects, 0 to 1. Default 0.2.
    #[serde(default = "ground_albedo")]
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub ground_albedo: Rgb,
    /// Whether the sun itself shines, as a disk of 0.53° dimmed by the same air. Default true.
    #[serde(default = "yes")]
    pub sun: bool,
    /// Whether camera rays see the sun's disk. Default false.
    #[serde(default)]
    pub sun_visible: bool,
}

fn turbidity() -> f64 {
    2.5
}

fn ground_albedo() -> Rgb {
    [0.2; 3]
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
    pub center: Keyed<Vec3>,
    /// From the middle to the middle of one edge [m].
    pub half_u: Keyed<Vec3>,
    /// From the middle to the middle of a neighbouring edge [m]. The front is where half_u × half_v points.
    pub half_v: Keyed<Vec3>,
    /// Radiance [W/(m² sr)].
    #[schemars(inner(range(min = 0.0)))]
    pub radiance: Keyed<Rgb>,
    /// Whether its back shines like its front; otherwise the back is black. Default false.
    #[serde(default, skip_serializing_if = "is_false")]
    pub two_sided: bool,
    /// Whether camera rays see it; smoke and surfaces are lit by it in any case. Default true.
    #[serde(default = "yes", skip_serializing_if = "is_true")]
    pub visible: bool,
    /// Group of lights, with a layer of its own: see `light_groups` of `output.aovs`. Default none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
}

/// A disk that shines from its front.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DiskLight {
    /// Middle [m].
    pub center: Keyed<Vec3>,
    /// Direction in which its front looks; any length but 0.
    pub normal: Keyed<Vec3>,
    /// Radius [m].
    #[schemars(range(min = 1e-6, max = 1e6))]
    pub radius: Keyed<f64>,
    /// Radiance [W/(m² sr)].
    #[schemars(inner(range(min = 0.0)))]
    pub radiance: Keyed<Rgb>,
    /// Whether its back shines like its front; otherwise the back is black. Default false.
    #[serde(default, skip_serializing_if = "is_false")]
    pub two_sided: bool,
    /// Whether camera rays see it; smoke and surfaces are lit by it in any case. Default true.
    #[serde(default = "yes", skip_serializing_if = "is_true")]
    pub visible: bool,
    /// Group of lights, with a layer of its own: see `light_groups` of `output.aovs`. Default none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
}

/// A ball that shines.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SphereLight {
    /// Middle [m].
    pub center: Keyed<Vec3>,
    /// Radius [m].
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub radius: Keyed<f64>,
    /// Radiance [W/(m² sr)].
    #[schemars(inner(range(min = 0.0)))]
    pub radiance: Keyed<Rgb>,
    /// Whether camera rays see it; smoke and surfaces are lit by it in any case. Default true.
    #[serde(default = "yes", skip_serializing_if = "is_true")]
    pub visible: bool,
    /// Group of lights, with a layer of its own: see `light_groups` of `output.aovs`. Default none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
}

/// A point that shines alike in all directions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointLight {
    /// Where [m].
    pub position: Keyed<Vec3>,
    /// Radiant intensity [W/sr].
    #[schemars(inner(range(min = 0.0)))]
    pub intensity: Keyed<Rgb>,
    /// Group of lights, with a layer of its own: see `light_groups` of `output.aovs`. Default none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
}

/// A point that shines into a cone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpotLight {
    /// Where [m].
    pub position: Keyed<Vec3>,
    /// Direction of the middle of the cone, away from the light; any length but 0.
    pub direction: Keyed<Vec3>,
    /// Radiant intensity in the middle of the cone [W/sr]. It does not depend on the cone's angle.
    #[schemars(inner(range(min = 0.0)))]
    pub intensity: Keyed<Rgb>,
    /// Angle between opposite sides of the cone [degrees]. Nothing is lit beyond. Default 45.
    #[serde(default = "cone")]
    #[schemars(range(min = 0.01, max = 180.0))]
    pub cone_deg: Keyed<f64>,
    /// Share of half the cone's angle over which light fades to nothing at its sides, 0 to 1. At the share x of that way in
    /// from the side there is x²(3 − 2x) of the light in the middle. Default 0.15.
    #[serde(default = "blend")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub blend: Keyed<f64>,
    /// Group of lights, with a layer of its own: see `light_groups` of `output.aovs`. Default none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
}

fn cone() -> Keyed<f64> {
    45.0.into()
}

fn blend() -> Keyed<f64> {
    0.15.into()
}
