//! `curlsmoke check` and `curlsmoke schema`.

use crate::cli::args::{CheckArguments, Format};
use crate::cli::{log, print_result};
use crate::error::Error;
use crate::geometry::{GeometryError, check_meshes};
use crate::scene::{Scene, SceneError, schema_json};
use serde_json::{Value, json};
use std::path::Path;

/// Checks all scenes; the exit code of the first that has errors.
pub(super) fn run(arguments: &CheckArguments) -> Result<u8, Error> {
    let overrides: Vec<(String, String)> = arguments.overrides.iter().map(|o| (o.0.clone(), o.1.clone())).collect();
    let mut code = 0;
    let mut reports = Vec::new();
    for path in &arguments.scenes {
        let scene = Scene::load_with(path, &overrides);
        let meshes = scene.as_ref().map_or_else(|_| Ok(Vec::new()), check_meshes);
        match arguments.format {
            Format::Text => print_text(path, &scene, &meshes)?,
            Format::Json => reports.push(json_report(path, &scene, &meshes)),
        }
        let error = scene.err().map(Error::from).or(meshes.err().map(Error::from));
        if let Some(error) = error.filter(|_| code == 0) {
            code = error.exit_code();
        }
    }
    if arguments.format == Format::Json {
        print_result(&format!("{:#}", Value::Array(reports)))?;
    }
    Ok(code)
}

/// Warnings about the meshes of a scene.
type Meshes = Result<Vec<String>, GeometryError>;

fn print_text(path: &Path, scene: &Result<Scene, SceneError>, meshes: &Meshes) -> Result<(), Error> {
    match (scene, meshes) {
        (Err(error), _) => log(&error.to_string()),
        (Ok(_), Err(error)) => log(&format!("error: {error}")),
        (Ok(scene), Ok(meshes)) => {
            scene.warnings.iter().for_each(|warning| log(&format!("{warning}\n")));
            meshes.iter().for_each(|warning| log(warning));
            let (frames, film) = (&scene.settings.frames, &scene.settings.film);
            let [width, height] = film.resolution;
            print_result(&format!(
                "{}: ok, frames {} to {}, {width} × {height} pixels, {} samples per pixel",
                path.display(),
                frames.first,
                frames.last,
                film.spp
            ))?;
        }
    }
    Ok(())
}

fn json_report(path: &Path, scene: &Result<Scene, SceneError>, meshes: &Meshes) -> Value {
    let (problems, message) = match scene {
        Ok(scene) => (json!(scene.warnings), meshes.as_ref().err().map(ToString::to_string)),
        Err(error) => {
            // A file that cannot be read has no problems inside it.
            let inside = error.diagnostics();
            (json!(inside), inside.is_empty().then(|| error.to_string()))
        }
    };
    let ok = scene.is_ok() && meshes.is_ok();
    let meshes = meshes.as_deref().unwrap_or_default();
    json!({"scene": path, "ok": ok, "message": message, "problems": problems, "meshes": meshes})
}

/// Prints the JSON Schema of scene files.
pub(super) fn schema() -> Result<u8, Error> {
    print_result(&format!("{:#}", schema_json())).map(|()| 0)
}
