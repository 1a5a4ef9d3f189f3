//! What way light came: over which first scattering, after how many, and from which group of sources.

use serde::{Deserialize, Serialize};

/// Most groups of lights, those of emission and of lights without a group among them.
pub const GROUP_MAX: usize = 16;

/// Group of light that surfaces and smoke give off themselves.
pub const EMISSION_GROUP: usize = 0;

/// Group of lights that are in none.
pub const OTHER_GROUP: usize = 1;

/// Ways for light, every path taking exactly one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Passage {
    /// Straight from the surroundings to the camera.
    Background,
    /// Straight from lights, glowing surfaces and glowing smoke.
    Emission,
    /// Scattered once, by a surface.
    SurfaceDirect,
    /// Scattered more than once, on the camera's side by a surface.
    SurfaceIndirect,
    /// Scattered once, by smoke.
    VolumeDirect,
    /// Scattered more than once, on the camera's side by smoke.
    VolumeIndirect,
}

/// What the camera's ray met first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FirstEvent {
    /// Nothing that scatters.
    #[default]
    None,
    /// A surface.
    Surface,
    /// Smoke.
    Smoke,
}

impl Passage {
    /// All of them, whose sum is the picture.
    pub const ALL: [Self; 6] = [
        Self::Background,
        Self::Emission,
        Self::SurfaceDirect,
        Self::SurfaceIndirect,
        Self::VolumeDirect,
        Self::VolumeIndirect,
    ];

    /// Name of its layer.
    pub fn name(self) -> &'static str {
        match self {
            Self::Background => "background",
            Self::Emission => "emission",
            Self::SurfaceDirect => "surface_direct",
            Self::SurfaceIndirect => "surface_indirect",
            Self::VolumeDirect => "volume_direct",
            Self::VolumeIndirect => "volume_indirect",
        }
    }

    /// The way of light that was scattered so many times, `first` being what the camera's ray met.
    #[inline]
    pub fn scattered(first: FirstEvent, scatterings: u32) -> Self {
        match (scatterings, first) {
            (0, _) | (_, FirstEvent::None) => Self::Emission,
            (1, FirstEvent::Surface) => Self::SurfaceDirect,
            (_, FirstEvent::Surface) => Self::SurfaceIndirect,
            (1, FirstEvent::Smoke) => Self::VolumeDirect,
            (_, FirstEvent::Smoke) => Self::VolumeIndirect,
        }
    }
}
