//! What tells whether a frame on disk was made from this very scene and the files that it names.

use crate::error::Error;
use crate::geometry::gltf_file::{buffer_files, is_gltf};
use crate::output::sidecar;
use crate::pipeline::inputs::Stamp;
use crate::pipeline::{memory_limit, parse_pattern};
use crate::render::film::PixelBounds;
use crate::scene::{Scene, settings};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Changes whenever equal scenes get other bits, so that `--resume` does not mix old and new frames.
const PICTURES: &str = "2026-11-23 k";

/// Hash of everything that all frames depend on.
pub(super) struct InputHash {
    settings: Vec<u8>,
    files: String,
}

impl InputHash {
    pub(super) fn new(scene: &Scene, crop: Option<PixelBounds>, known: &mut FileHashes) -> Result<Self, Error> {
        let mut settings = scene.settings.clone();
        // What changes no pixel of a frame must not make it stale.
        settings.frames.last = settings.frames.first;
        settings.output.image.clear();
        settings.output.volume.clear();
        settings.output.volume_grids.clear();
        settings.output.velocity_units = settings::VelocityUnits::Second;
        if let Some(smoke) = &mut settings.smoke {
            smoke.advect.batch = None;
        }
        // That there is a preview matters, its name does not.
        settings.output.preview = settings.output.preview.map(|_| String::new());
        // Nodes of flows along surfaces are made only where there is room for them.
        if settings.shapes.values().all(|shape| shape.surface_flow.is_none()) {
            settings.render.memory_limit_gib = 0.0;
        }
        let files = [mesh_files(scene), texture_files(scene), light_files(scene), mask_files(scene)].concat();
        let hashes = files.into_iter().map(|path| known.of(path)).collect::<Result<Vec<_>, _>>()?;
        let settings = serde_json::to_value(&settings).map_err(|e| Error::Internal(e.to_string()))?;
        Ok(Self { settings: format!("{settings}{crop:?}").into_bytes(), files: hashes.concat() })
    }

    pub(super) fn fingerprint(&self, scene: &Scene, frame: i32, known: &mut FileHashes) -> Result<String, Error> {
        let mut volume = String::new();
        for path in smoke_files(scene, frame)?.into_iter().chain(volume_files(scene, frame)?) {
            volume += &known.of(path)?;
        }
        let version = concat!(env!("CARGO_PKG_VERSION"), "/");
        let parts = [
            version.as_bytes(),
            PICTURES.as_bytes(),
            &self.settings,
            self.files.as_bytes(),
            volume.as_bytes(),
            &frame.to_le_bytes(),
        ];
        Ok(sidecar::fingerprint(&parts))
    }
}

/// Meshes that a scene names.
pub(super) fn mesh_files(scene: &Scene) -> Vec<PathBuf> {
    let meshes = scene.settings.shapes.values().filter_map(|shape| Some(scene.resolve(&shape.mesh.as_ref()?.file)));
    let limit = memory_limit(scene);
    let with_buffers = |path: PathBuf| {
        let buffers = if is_gltf(&path) { buffer_files(&path, limit) } else { Vec::new() };
        buffers.into_iter().chain([path])
    };
    meshes.flat_map(with_buffers).collect()
}

/// Pictures of textures.
pub(super) fn texture_files(scene: &Scene) -> Vec<PathBuf> {
    let textures = scene.settings.shapes.values().flat_map(|shape| shape.material.textures());
    let file = |texture: &settings::Texture| match texture {
        settings::Texture::Image(image) => Some(scene.resolve(&image.file)),
        _ => None,
    };
    textures.filter_map(|(_, texture)| file(texture)).collect()
}

/// Pictures of the surroundings.
pub(super) fn light_files(scene: &Scene) -> Vec<PathBuf> {
    let file = |light: &settings::Light| match light {
        settings::Light::Environment(e) => e.file.as_ref().map(|f| scene.resolve(f)),
        _ => None,
    };
    scene.settings.lights.iter().filter_map(file).collect()
}

/// Files of the masks of the flow.
pub(super) fn mask_files(scene: &Scene) -> Vec<PathBuf> {
    let masks = scene.settings.flow.potentials.iter().flat_map(settings::Potential::masks);
    let file = |mask: &settings::Mask| match mask {
        settings::Mask::Image(mask) => Some(scene.resolve(&mask.file)),
        settings::Mask::Grid(mask) => Some(scene.resolve(&mask.file)),
        _ => None,
    };
    masks.filter_map(file).collect()
}

/// Density of the smoke of a frame, where it comes from a file.
pub(super) fn smoke_files(scene: &Scene, frame: i32) -> Result<Vec<PathBuf>, Error> {
    density_files(scene, frame, scene.settings.smoke.iter().filter_map(|smoke| smoke.file.as_ref()))
}

/// Densities of the volumes of a frame.
pub(super) fn volume_files(scene: &Scene, frame: i32) -> Result<Vec<PathBuf>, Error> {
    density_files(scene, frame, scene.settings.volumes.values().filter_map(|volume| volume.file.as_ref()))
}

fn density_files<'a>(
    scene: &Scene,
    frame: i32,
    files: impl Iterator<Item = &'a settings::DensityFile>,
) -> Result<Vec<PathBuf>, Error> {
    files.map(|file| Ok(scene.resolve(&parse_pattern(&file.path)?.expand(frame, scene.name())))).collect()
}

/// Hashes of files, each read once as long as it stays what it is.
#[derive(Default)]
pub(super) struct FileHashes(HashMap<PathBuf, (Stamp, String)>);

impl FileHashes {
    fn of(&mut self, path: PathBuf) -> Result<String, Error> {
        self.with(path, |path| Ok(sidecar::sha256_of_file(path)?))
    }

    fn with(&mut self, path: PathBuf, hash: impl FnOnce(&Path) -> Result<String, Error>) -> Result<String, Error> {
        // Taken before the file is read, so that one that changes meanwhile is read again.
        let stamp = Stamp::of(&path);
        match self.0.get(&path) {
            Some((known, hash)) if *known == stamp && stamp.exists() => Ok(hash.clone()),
            _ => {
                let hash = hash(&path)?;
                self.0.insert(path, (stamp, hash.clone()));
                Ok(hash)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_file_is_hashed_again_only_when_it_has_changed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let (mut hashes, mut count) = (FileHashes::default(), 0);
        for (text, expected) in [(Some("one"), 1), (None, 1), (Some("other"), 2), (None, 2)] {
            text.iter().for_each(|text| fs::write(&path, text).unwrap());
            let hash = |path: &Path| {
                count += 1;
                Ok(sidecar::sha256_of_file(path)?)
            };
            let hash = hashes.with(path.clone(), hash).unwrap();
            assert_eq!((hash, count), (sidecar::sha256_of_file(&path).unwrap(), expected));
        }
        assert!(hashes.of(folder.path().join("none")).is_err());
    }
}
