//! What tells whether a frame on disk was made from this very scene and the files that it names.

use crate::error::Error;
use crate::geometry::gltf_file::buffer_files;
use crate::output::sidecar;
use crate::pipeline::parse_pattern;
use crate::render::film::PixelBounds;
use crate::scene::{Scene, settings};
use std::path::Path;

/// Changes whenever equal scenes get other bits, so that `--resume` does not mix old and new frames.
const PICTURES: &str = "2026-11-23 f";

/// Hash of everything that all frames depend on.
pub(super) struct InputHash {
    settings: Vec<u8>,
    files: String,
}

impl InputHash {
    pub(super) fn new(scene: &Scene, crop: Option<PixelBounds>) -> Result<Self, Error> {
        let mut settings = scene.settings.clone();
        // What changes no pixel of a frame must not make it stale.
        settings.frames.last = settings.frames.first;
        settings.output.image.clear();
        settings.output.volume.clear();
        if let Some(smoke) = &mut settings.smoke {
            smoke.advect.batch = None;
        }
        // That there is a preview matters, its name does not.
        settings.output.preview = settings.output.preview.map(|_| String::new());
        // Nodes of flows along surfaces are made only where there is room for them.
        if settings.shapes.values().all(|shape| shape.surface_flow.is_none()) {
            settings.render.memory_limit_gib = 0.0;
        }
        let mut files = Vec::new();
        for shape in settings.shapes.values() {
            let mesh = shape.mesh.as_ref().map(|m| scene.resolve(&m.file));
            let is_gltf =
                mesh.as_ref().and_then(|path| path.extension()).is_some_and(|e| e.eq_ignore_ascii_case("gltf"));
            files.extend(mesh.iter().filter(|_| is_gltf).flat_map(|path| buffer_files(path)));
            files.extend(mesh);
            for (_, texture) in shape.material.textures() {
                if let settings::Texture::Image(image) = texture {
                    files.push(scene.resolve(&image.file));
                }
            }
        }
        for light in &settings.lights {
            if let settings::Light::Environment(e) = light {
                files.extend(e.file.as_ref().map(|f| scene.resolve(f)));
            }
        }
        for mask in settings.flow.potentials.iter().flat_map(settings::Potential::masks) {
            match mask {
                settings::Mask::Image(mask) => files.push(scene.resolve(&mask.file)),
                settings::Mask::Grid(mask) => files.push(scene.resolve(&mask.file)),
                _ => {}
            }
        }
        let hashes = files.iter().map(|path| file_hash(path)).collect::<Result<Vec<_>, _>>()?;
        let settings = serde_json::to_value(&settings).map_err(|e| Error::Internal(e.to_string()))?;
        Ok(Self { settings: format!("{settings}{crop:?}").into_bytes(), files: hashes.concat() })
    }

    pub(super) fn fingerprint(&self, scene: &Scene, frame: i32) -> Result<String, Error> {
        let mut volume = String::new();
        let smoke = scene.settings.smoke.iter().filter_map(|smoke| smoke.file.as_ref());
        for density in smoke.chain(scene.settings.volumes.values().filter_map(|volume| volume.file.as_ref())) {
            let path = scene.resolve(&parse_pattern(&density.path)?.expand(frame, scene.name()));
            volume += &file_hash(&path)?;
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

fn file_hash(path: &Path) -> Result<String, Error> {
    Ok(sidecar::sha256_of_file(path)?)
}
