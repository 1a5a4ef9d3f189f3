//! Files to write.

use crate::settings::VelocityUnits;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Files to write. In patterns `####`, `%04d`, `$F4` or `{frame:04}` stands for the frame and `{scene}` for the name of
/// the scene file; they are relative to the working directory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Output {
    /// Picture in linear light, .exr: colours in half precision, right to one in 4096, data in single precision. Default out/{scene}.####.exr.
    pub image: String,
    /// How the pixels of the picture are packed. Default zips.
    pub compression: Compression,
    /// How the layers are put into files. Default single.
    pub layout: Layout,
    /// Picture to look at, .png. Default none.
    pub preview: Option<String>,
    /// Density, .vdb, written by `curlsmoke bake`. Default out/{scene}.####.vdb.
    pub volume: String,
    /// Further grids of that file. Default none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub volume_grids: Vec<VolumeGrid>,
    /// Unit of its velocities. Default second.
    #[serde(skip_serializing_if = "VelocityUnits::is_second")]
    pub velocity_units: VelocityUnits,
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
            layout: Layout::Single,
            preview: None,
            volume: "out/{scene}.####.vdb".into(),
            volume_grids: Vec::new(),
            velocity_units: VelocityUnits::Second,
            aovs: Vec::new(),
            view: View::Standard,
            exposure_ev: 0.0,
        }
    }
}

/// A grid beside the density: the mean of what the particles about a voxel carry, weighted by their mass; none where there is no
/// density.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum VolumeGrid {
    /// Velocities at the frame's time: vectors, named `v`. The density is then that of this one time, whatever the shutter, so that
    /// who reads both can blur it.
    Velocity,
    /// Temperatures [K], named `temperature`, of smoke with `blackbody`: those at which the smoke of a voxel glows at 600 nm as its
    /// particles do together.
    Temperature,
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
    /// With some loss, cosines of 8 × 8 pixels: several times smaller. For colours alone; layers with numbers stay as they are and
    /// need a `layout` in parts or files of their own.
    Dwaa,
    /// As `dwaa`, 256 lines at a time: a little smaller, slower to read in part.
    Dwab,
}

/// How layers are put into files. Channels have the same names in all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Layout {
    /// One part with all channels: what every program reads.
    Single,
    /// A part for each layer, named as it; the first is `rgba`.
    Multipart,
    /// A file for each layer, its name before the frame number: `plume.0001.exr`, `plume.albedo.0001.exr`.
    Separate,
}

/// A further layer of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Aov {
    /// Distance along the view axis (with `projection: lat_long` from the camera) to the first surface [m]; infinite where there is
    /// none. Through the middle of the pixel.
    /// Channel Z.
    Depth,
    /// Where that surface is in the world [m]; 0 where there is none. Channels P.X, P.Y, P.Z.
    Position,
    /// Number of its shape, from 1 in the order of the shapes' names; 0 where there is none. Channel shape_id.
    ShapeId,
    /// Normal of the first surface. Channels N.X, N.Y, N.Z.
    Normal,
    /// Colour of the first surface or smoke. Channels albedo.R, albedo.G, albedo.B.
    Albedo,
    /// How far what is seen first moves on the picture from this frame to the next [pixels], x to the right and y down: shapes by
    /// their `motion`, smoke by the flow at the place where light scatters, the mean over paths that met either. 0 where there is
    /// nothing but background and lights, and of smoke from files and of `volumes`, of which nobody says what carries them. What counts rows upwards wants y
    /// with the other sign. Channels motion.X, motion.Y.
    Motion,
    /// Variance of the mean of the picture, as if samples were independent: an upper bound, since they are stratified.
    /// Infinite with one sample per pixel. Channels variance.R, variance.G, variance.B.
    Variance,
    /// Share of light that the smoke before the first surface lets through, exact along the ray through the middle of the pixel;
    /// of smoke with a tint, and for `volume_depth` too, of the channel that has most extinction. Channel transmittance.
    Transmittance,
    /// Distances along the view axis at which smoke begins, at which on average it stops the view, and at which it has stopped
    /// half of it [m]; infinite where it does not. Channels volume_depth.first, volume_depth.mean, volume_depth.half.
    VolumeDepth,
    /// Light by the way it came: `background`, `emission` (seen straight), and scattered once or more often, by what the camera
    /// saw first: `surface_direct`, `surface_indirect`, `volume_direct`, `volume_indirect`. Six layers whose sum is the picture.
    Passages,
    /// Light by groups of sources: `light_emission` of glowing surfaces and smoke, `light_other` of lights without a group, and
    /// `light_NAME` for each `group`. Layers whose sum is the picture.
    LightGroups,
    /// Masks of shapes by name, for compositing programs that know Cryptomatte: the six shapes that cover most of a pixel, smoke
    /// before them taking its share. Channels CryptoObject00.R to CryptoObject02.A.
    Cryptomatte,
    /// Scatterings of a path, on average. Channel bounces.
    Bounces,
    /// Null collisions of a path, on average: how much work the smoke was, and where bounds of the density are far above it.
    /// Channel null_collisions.
    NullCollisions,
    /// Paths of the pixel: differ with `film.noise_target`. Channel samples.
    Samples,
}

impl Aov {
    /// Its name in a scene.
    pub fn name(self) -> String {
        serde_json::to_value(self).ok().and_then(|value| value.as_str().map(str::to_string)).unwrap_or_default()
    }

    /// Whether it holds colours of light or things, which may lose a little, and no numbers.
    pub fn is_colour(self) -> bool {
        matches!(self, Self::Albedo | Self::Passages | Self::LightGroups)
    }

    /// Most channels that it has.
    pub fn channel_count(self, group_count: usize) -> usize {
        match self {
            Self::Depth
            | Self::ShapeId
            | Self::Transmittance
            | Self::Bounces
            | Self::NullCollisions
            | Self::Samples => 1,
            Self::Motion => 2,
            Self::Position | Self::Normal | Self::Albedo | Self::Variance | Self::VolumeDepth => 3,
            Self::Passages => 18,
            Self::Cryptomatte => 12,
            Self::LightGroups => 3 * (group_count + 2),
        }
    }
}

/// How the preview maps light to the screen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum View {
    /// Cut at 1, sRGB transfer curve.
    Standard,
    /// Khronos PBR Neutral: colours as they are up to 0.8, highlights rolled off.
    Neutral,
    /// AgX as Blender shows it: light rolls off over sixteen stops, and bright colours fade to white as on film.
    Agx,
    /// A colour for each stop of luminance, to judge exposure by: grey about middle grey (0.18), green and blue down to black 8
    /// stops below, yellow from half a stop above, orange where `standard` is white (2.5 stops) and white where `agx` is (6.5).
    FalseColor,
    /// Cut at 1, no transfer curve.
    Raw,
}

impl View {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Standard, Self::Neutral, Self::Agx, Self::FalseColor, Self::Raw];

    /// Its name in a scene.
    pub fn name(self) -> &'static str {
        self.entry().0
    }

    /// What it does, in a few words.
    pub fn summary(self) -> &'static str {
        self.entry().1
    }

    fn entry(self) -> (&'static str, &'static str) {
        match self {
            Self::Standard => ("standard", "Cut at 1, sRGB transfer curve"),
            Self::Neutral => ("neutral", "Khronos PBR Neutral: highlights rolled off above 0.8"),
            Self::Agx => ("agx", "AgX as Blender shows it"),
            Self::FalseColor => ("false_color", "A colour for each stop of luminance"),
            Self::Raw => ("raw", "Cut at 1, no transfer curve"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_have_the_names_that_scenes_know() {
        for view in View::ALL {
            assert_eq!(serde_json::to_value(view).unwrap(), view.name());
        }
    }
}
