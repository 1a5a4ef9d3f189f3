//! Solid things: shapes, their meshes, places and motions.

use crate::settings::{Keyed, Material, SurfaceFlow, Vec3, up, yes};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A solid: exactly one of `sphere`, `box`, `capsule`, `torus`, `plane`, `smooth_union`, `mesh`.
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
    /// Solids that melt into one.
    // What is left out is no part of a scene's fingerprint, so that frames of older scenes stay valid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smooth_union: Option<SmoothUnion>,
    /// Triangles from a file.
    #[serde(default)]
    pub mesh: Option<Mesh>,
    /// Moves, turns and scales the shape.
    #[serde(default)]
    pub transform: Transform,
    /// How the shape moves in time from where `transform` puts it; not with a `transform` that has keys. Default not at all.
    #[serde(default)]
    pub motion: Option<Motion>,
    /// What the surface does to light. Default diffuse grey 0.5.
    #[serde(default)]
    pub material: Material,
    /// A flow along its surface, that carries its textures. Not for planes. Default none.
    #[serde(default)]
    pub surface_flow: Option<SurfaceFlow>,
    /// Whether light meets it; an invisible shape still guides the flow. Default true.
    #[serde(default = "yes")]
    pub visible: bool,
    /// Whether the inside of its surface is as the outside. Otherwise it is black there: it reflects and gives off light
    /// outwards only. Not for what light goes through. Default true.
    #[serde(default = "yes", skip_serializing_if = "is_yes")]
    pub two_sided: bool,
    /// Whether the camera looks through it, as if it were not there; light still meets it. Default false.
    #[serde(default, skip_serializing_if = "is_no")]
    pub invisible_to_camera: bool,
    /// Whether it is cut out of the picture, black and with alpha 0 where the camera sees it without a mirror or glass in
    /// between; light still meets it. Laid `over` a picture of the shape itself, this is the whole picture. Default false.
    #[serde(default, skip_serializing_if = "is_no")]
    pub holdout: bool,
    /// Whether the camera sees only the shadow on it: black, with an alpha that darkens a picture it is laid `over`. Alpha is 1
    /// − (luminance that it reflects)/(luminance that it would reflect without smoke and other shapes), at least 0: light that
    /// they add, and colours of shadows, are lost. It is a ratio of two means over the paths of a pixel, which some dozen paths
    /// make good enough. Other catchers, and the surroundings behind them, are as they are: give `environment` with `visible:
    /// false`. Default false.
    #[serde(default, skip_serializing_if = "is_no")]
    pub shadow_catcher: bool,
}

fn is_yes(flag: &bool) -> bool {
    *flag
}

fn is_no(flag: &bool) -> bool {
    !*flag
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

/// Solids that melt into one, without a crease where they meet (a polynomial with two continuous derivatives).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SmoothUnion {
    /// How far along two parts that meet at a right angle the blend between them reaches [m]: they are blended where their
    /// distances differ by less. It bulges out by at most a sixth of this where two parts meet, more where many do.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub width: f64,
    /// What it is made of: at least two, at most 64; blended in this order, which matters a little where three meet.
    #[schemars(length(min = 2))]
    pub parts: Vec<Part>,
}

/// A part of a smooth union: exactly one of `sphere`, `box`, `capsule`, `torus`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Part {
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
    /// Moves, turns and scales the part, before the shape's own transform.
    #[serde(default)]
    pub transform: Transform,
}

/// Triangles from a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Mesh {
    /// An .obj, .ply, .glb or .gltf file; relative to the scene file. Of glTF the triangles are read, and animations of nodes move
    /// the shape, from time 0 at frame `first` on; skins, morph targets and cubic splines are errors, and materials passed over.
    pub file: String,
    /// Of glTF, the node by its name that is the shape, with what is inside of it. Default all of the file, which must move as one.
    // What is left out is no part of a scene's fingerprint, so that frames of older scenes stay valid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub node: Option<String>,
    /// Distance between the samples of the mesh's signed distance [m], for flow round it. Default a 96th of its
    /// longest edge.
    #[serde(default)]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub distance_voxel: Option<f64>,
    /// Interpolate the vertex normals of the file for shading. Default true.
    #[serde(default = "yes")]
    pub smooth: bool,
}

/// Scale first, then rotation, then translation. With keys the shape moves: at constant velocity and angular velocity between
/// keys that are `linear`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Transform {
    /// Added last [m]. Default the origin.
    pub translate: Keyed<Vec3>,
    /// Turn about an axis through the origin. Between keys with the same axis it turns by as much as the angles say, be it
    /// many times round; otherwise it takes the shorter way. Default none.
    pub rotate_deg: Keyed<Rotation>,
    /// The turn as a quaternion x, y, z, w of any length but 0, in place of `rotate_deg`. Between keys it takes the shorter
    /// way. Default none.
    // What is left out is no part of a scene's fingerprint, so that frames of older scenes stay valid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quaternion: Option<Keyed<[f64; 4]>>,
    /// Uniform factor. With keys not for shapes that guide the flow, hold a volume or let particles start. Default 1.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub scale: Keyed<f64>,
}

impl Transform {
    /// Whether it changes in time.
    pub fn varies(&self) -> bool {
        let turns = self.quaternion.as_ref().is_some_and(Keyed::varies);
        self.translate.varies() || self.rotate_deg.varies() || turns || self.scale.varies()
    }
}

impl Default for Transform {
    fn default() -> Self {
        Self { translate: [0.0; 3].into(), rotate_deg: Rotation::default().into(), quaternion: None, scale: 1.0.into() }
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
    /// How it gets from key to key. Default ease.
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

/// How a value gets from key to key.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Interpolation {
    /// At constant speed, which jumps at keys.
    Linear,
    /// Faster in the middle, at rest at each key.
    #[default]
    Ease,
    /// It stays what it was at the key before.
    Step,
}
