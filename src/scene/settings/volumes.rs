//! What light flies through besides the smoke.

use crate::settings::{Blackbody, DensityFile, Detail, Medium, Remap};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A volume of smoke or mist: exactly one of `file` and `inside`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Volume {
    /// Density from a .vdb file, where the file has it.
    #[serde(default)]
    pub file: Option<DensityFile>,
    /// Name of a shape that is filled evenly: anything closed, so no plane and no mesh with holes. The shape keeps its surface:
    /// with glass it is a ball of mist, and with `visible: false` it is nothing but the mist. It may move.
    #[serde(default)]
    pub inside: Option<String>,
    /// Density inside of the shape. Default 1.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1e9))]
    pub density: Option<f64>,
    /// Light of hot smoke, of a file. Default cold.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blackbody: Option<Blackbody>,
    /// Changes the density of a file before it is lit. Default as it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remap: Option<Remap>,
    /// Detail finer than the voxels of a file. Default none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detail: Option<Detail>,
    /// What it does to light.
    #[serde(default)]
    pub medium: Medium,
}

impl Volume {
    /// Whether it gives off light.
    pub fn glows(&self) -> bool {
        self.medium.glows()
            || self.blackbody.is_some()
            || self.file.as_ref().is_some_and(|file| file.emission.is_some())
    }
}
