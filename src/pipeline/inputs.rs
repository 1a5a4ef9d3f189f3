//! What each part of a picture is made from: the one place that says what may be kept when a scene or a file changes.
//!
//! The inputs of a part are all settings *but* those that are listed for it here, and the files that it reads. So a setting of which
//! nobody has said that a part ignores it makes that part again: that is slow, and never stale. What one part takes from
//! another is not said here: `live.rs` makes a part again whenever one that it takes from was made again.

use crate::error::Error;
use crate::geometry::needs_distance;
use crate::pipeline::fingerprint::{light_files, mask_files, mesh_files, smoke_files, texture_files, volume_files};
use crate::scene::{Scene, settings};
use serde_json::{Value, json};
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// A part of a picture that outlives it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// Shapes and their distances.
    Shapes,
    /// Shapes as a target of rays.
    Surfaces,
    /// Pictures of textures.
    Textures,
    /// Lights of the scene, but for shapes that shine.
    Lights,
    /// The flow and the particles in it.
    Particles,
    /// The density of the frame.
    Density,
    /// The smoke as light sees it, with its bounds.
    Medium,
    /// The volumes of the frame.
    Volumes,
}

impl Part {
    /// What people call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Shapes => "shapes",
            Self::Surfaces => "surfaces",
            Self::Textures => "textures",
            Self::Lights => "lights",
            Self::Particles => "particles",
            Self::Density => "density",
            Self::Medium => "smoke",
            Self::Volumes => "volumes",
        }
    }
}

/// No part takes these: how a picture is taken of what is there. How much memory a grid may take depends on the film, but
/// nothing of what is made within it.
const VIEW: [&str; 8] = [
    "version",
    "camera",
    "film",
    "output",
    "frames.last",
    "render.max_bounces",
    "render.roulette_from",
    "render.lock_seed",
];

/// What of a shape decides how it looks, not what it is.
const LOOKS: [&str; 6] = [
    "shapes.*.material",
    "shapes.*.surface_flow",
    "shapes.*.invisible_to_camera",
    "shapes.*.holdout",
    "shapes.*.shadow_catcher",
    "shapes.*.two_sided",
];

/// Everything that a part is made from, but for other parts.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Inputs {
    settings: Value,
    files: Vec<(PathBuf, Stamp)>,
}

impl Inputs {
    /// Those of a part of a frame.
    pub(super) fn of(part: Part, scene: &Scene, frame: i32) -> Result<Self, Error> {
        let all = serde_json::to_value(&scene.settings).map_err(|e| Error::Internal(e.to_string()))?;
        let rest = |ignored: &[&[&str]]| {
            let mut settings = all.clone();
            VIEW.iter().chain(ignored.iter().copied().flatten()).for_each(|path| forget(&mut settings, path));
            settings
        };
        let of_frame = |settings: Value| json!([settings, frame]);
        let smoke = scene.settings.smoke.as_ref();
        let (settings, files) = match part {
            Part::Shapes => {
                // Of the flow only for whom it needs a distance.
                let near: Vec<&String> =
                    scene.settings.shapes.keys().filter(|name| needs_distance(scene, name)).collect();
                let rest = rest(&[&["lights", "smoke", "volumes", "flow", "render.seed"], &LOOKS]);
                (json!([rest, near]), mesh_files(scene))
            }
            // Of shapes alone; `live.rs` adds the frame where any of them moves.
            Part::Surfaces => (rest(&[&["lights", "smoke", "volumes", "flow", "render.seed", "shapes"]]), vec![]),
            Part::Textures => {
                let pictures = |shape: &settings::Shape| -> Vec<Value> {
                    let textures = shape.material.textures().into_iter();
                    let images = textures.filter(|(_, texture)| matches!(texture, settings::Texture::Image(_)));
                    images.map(|(slot, texture)| json!([slot, texture])).collect()
                };
                let shapes: Vec<_> = scene.settings.shapes.iter().map(|(name, s)| json!([name, pictures(s)])).collect();
                (json!([shapes, scene.settings.render.memory_limit_gib]), texture_files(scene))
            }
            Part::Lights => {
                let rest = rest(&[&["smoke", "volumes", "flow", "shapes", "render.seed"]]);
                let varies = scene.settings.lights.iter().any(settings::Light::varies);
                (if varies { of_frame(rest) } else { rest }, light_files(scene))
            }
            Part::Particles => {
                let own = ["lights", "volumes", "smoke.medium", "smoke.blackbody", "smoke.remap", "smoke.detail"];
                match smoke {
                    Some(settings::Smoke { file: Some(_), .. }) | None => {
                        (rest(&[&own, &["flow", "shapes", "render.seed"]]), vec![])
                    }
                    Some(smoke) => {
                        let seed: &[&str] = if smoke.seed.is_some() { &["render.seed"] } else { &[] };
                        // How many are held at once changes none of them.
                        let mut rest = rest(&[&own, &LOOKS, &["shapes.*.visible", "smoke.advect.batch"], seed]);
                        let is_met = |name: &str| {
                            let emits = |e: &settings::Emitter| e.mesh.as_ref().is_some_and(|m| m.shape == name);
                            needs_distance(scene, name)
                                || scene.settings.flow.minds(name)
                                || smoke.emitters.iter().any(emits)
                        };
                        if let Some(shapes) = rest.get_mut("shapes").and_then(Value::as_object_mut) {
                            shapes.retain(|name, _| is_met(name));
                        }
                        (rest, [mesh_files(scene), mask_files(scene)].concat())
                    }
                }
            }
            Part::Density => {
                // Without heat nothing of the medium is in the grids; with it, what hot smoke absorbs.
                let medium: &[&str] = match smoke.map(|smoke| smoke.blackbody.is_some()) {
                    Some(true) => &["smoke.medium.phase", "smoke.medium.emission"],
                    _ => &["smoke.medium"],
                };
                let others = ["lights", "volumes", "shapes", "flow", "render.seed", "smoke.detail"];
                (of_frame(rest(&[&others, medium])), smoke_files(scene, frame)?)
            }
            Part::Medium => (of_frame(rest(&[&["lights", "volumes", "shapes", "flow", "render.seed"]])), vec![]),
            Part::Volumes => {
                (of_frame(rest(&[&["lights", "smoke", "shapes", "flow", "render.seed"]])), volume_files(scene, frame)?)
            }
        };
        Ok(Self { settings, files: stamped(files) })
    }
}

/// Takes what stands at `path` out of a map of maps; `*` is every name.
fn forget(value: &mut Value, path: &str) {
    let Some(map) = value.as_object_mut() else { return };
    match path.split_once('.') {
        None => {
            map.remove(path);
        }
        Some(("*", rest)) => map.values_mut().for_each(|value| forget(value, rest)),
        Some((name, rest)) => {
            if let Some(value) = map.get_mut(name) {
                forget(value, rest);
            }
        }
    }
}

/// All files that a frame of a scene is made from, the scene's own first, with their stamps.
///
/// # Errors
/// Where the name of a sequence of files is no pattern.
pub fn files(scene: &Scene, frame: i32) -> Result<Vec<(PathBuf, Stamp)>, Error> {
    let own = vec![scene.path.clone()];
    let still = [own, mesh_files(scene), texture_files(scene), light_files(scene), mask_files(scene)].concat();
    Ok(stamped([still, smoke_files(scene, frame)?, volume_files(scene, frame)?].concat()))
}

fn stamped(files: Vec<PathBuf>) -> Vec<(PathBuf, Stamp)> {
    files.into_iter().map(|path| (path.clone(), Stamp::of(&path))).collect()
}

/// What changes whenever a file is written or another one takes its name: which file it is, its length, and when it, its name or its
/// attributes were last changed. All zero where there is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Stamp([i64; 7]);

impl Stamp {
    /// That of a file as it is now.
    pub fn of(path: &Path) -> Self {
        let Ok(m) = fs::metadata(path) else { return Self::default() };
        Self([m.dev() as i64, m.ino() as i64, m.size() as i64, m.mtime(), m.mtime_nsec(), m.ctime(), m.ctime_nsec()])
    }

    /// Whether there is such a file.
    pub fn exists(self) -> bool {
        self != Self::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = "\
version: 1
frames: {first: 1, last: 4, fps: 24}
camera: {position: [0, 1, 4], look_at: [0, 1, 0]}
shapes:
  ball: {sphere: {center: [0, 1, 0], radius: 0.2}}
  far: {sphere: {center: [3, 1, 0], radius: 0.2}}
flow: {potentials: [{uniform: {velocity: [0, 1, 0]}}], obstacles: [ball]}
smoke:
  emitters: [{disk: {center: [0, 0, 0], radius: 0.2}, rate: 100, lifetime: 1}]
  grid: {voxel_size: 0.05}
  medium: {extinction: 10, albedo: [0.9, 0.9, 0.9]}
lights: [{sun: {direction: [0, -1, 0], irradiance: [1, 1, 1]}}]
";

    const ALL: [Part; 8] = [
        Part::Shapes,
        Part::Surfaces,
        Part::Textures,
        Part::Lights,
        Part::Particles,
        Part::Density,
        Part::Medium,
        Part::Volumes,
    ];

    fn changed_by(change: (&str, &str)) -> Vec<Part> {
        assert!(SCENE.contains(change.0), "{}", change.0);
        let load = |text: &str| Scene::from_text(text, Path::new("test.yaml")).unwrap_or_else(|e| panic!("{e}"));
        let (old, new) = (load(SCENE), load(&SCENE.replacen(change.0, change.1, 1)));
        let inputs = |part, scene: &Scene| Inputs::of(part, scene, 2).unwrap();
        ALL.into_iter().filter(|&part| inputs(part, &old) != inputs(part, &new)).collect()
    }

    /// Each row is a rule: what a change makes again by itself; what takes from it follows.
    #[test]
    fn a_change_makes_again_what_depends_on_it() {
        use Part::*;
        let rows: [(&str, &str, &[Part]); 11] = [
            ("position: [0, 1, 4]", "position: [0, 1, 5]", &[]),
            ("last: 4", "last: 5", &[]),
            ("irradiance: [1, 1, 1]", "irradiance: [2, 1, 1]", &[Lights]),
            ("albedo: [0.9, 0.9, 0.9]", "albedo: [0.8, 0.9, 0.9]", &[Medium]),
            ("extinction: 10", "extinction: 20", &[Medium]),
            ("velocity: [0, 1, 0]", "velocity: [0, 2, 0]", &[Particles]),
            ("voxel_size: 0.05", "voxel_size: 0.06", &[Particles, Density, Medium]),
            ("radius: 0.2}}\n  far", "radius: 0.2}, material: {diffuse: {reflectance: [0.1, 0.1, 0.1]}}}\n  far", &[]),
            ("center: [3, 1, 0]", "center: [3, 2, 0]", &[Shapes]),
            ("center: [0, 1, 0]", "center: [0, 2, 0]", &[Shapes, Particles]),
            ("fps: 24", "fps: 25", &ALL),
        ];
        for (old, new, parts) in rows {
            // Textures have no clock.
            let expected: Vec<Part> =
                parts.iter().copied().filter(|&part| parts.len() < ALL.len() || part != Textures).collect();
            assert_eq!(changed_by((old, new)), expected, "{old} -> {new}");
        }
    }

    #[test]
    fn stamps_tell_files_apart() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (folder.path().join("a"), folder.path().join("b"));
        assert!(!Stamp::of(&a).exists());
        fs::write(&a, "one").unwrap();
        fs::write(&b, "two").unwrap();
        let first = Stamp::of(&a);
        assert!(first.exists() && first == Stamp::of(&a));
        // As editors save: same length, another file.
        fs::rename(&b, &a).unwrap();
        assert_ne!(first, Stamp::of(&a));
    }
}
