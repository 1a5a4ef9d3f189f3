//! `curlsmoke check` and `curlsmoke schema`.

use crate::cli::args::{CheckArguments, Format};
use crate::cli::{log, print_result};
use crate::error::Error;
use crate::scene::{Scene, SceneError, schema_json};
use serde_json::{Value, json};
use std::path::Path;

/// Checks all scenes; the exit code of the first that has errors.
pub(super) fn run(arguments: &CheckArguments) -> Result<u8, Error> {
    let overrides: Vec<(String, String)> = arguments.overrides.iter().map(|o| (o.0.clone(), o.1.clone())).collect();
    let mut code = 0;
    let mut reports = Vec::new();
    for path in &arguments.scenes {
        let result = Scene::load_with(path, &overrides);
        match arguments.format {
            Format::Text => print_text(path, &result)?,
            Format::Json => reports.push(json_report(path, &result)),
        }
        if let Err(error) = result
            && code == 0
        {
            code = Error::from(error).exit_code();
        }
    }
    if arguments.format == Format::Json {
        print_result(&format!("{:#}", Value::Array(reports)))?;
    }
    Ok(code)
}

fn print_text(path: &Path, result: &Result<Scene, SceneError>) -> Result<(), Error> {
    match result {
        Err(error) => log(&error.to_string()),
        Ok(scene) => {
            for warning in &scene.warnings {
                log(&format!("{warning}\n"));
            }
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

fn json_report(path: &Path, result: &Result<Scene, SceneError>) -> Value {
    let (problems, message) = match result {
        Ok(scene) => (json!(scene.warnings), None),
        Err(error) => {
            // A file that cannot be read has no problems inside it.
            let inside = error.diagnostics();
            (json!(inside), inside.is_empty().then(|| error.to_string()))
        }
    };
    json!({"scene": path, "ok": result.is_ok(), "message": message, "problems": problems})
}

/// Prints the JSON Schema of scene files.
pub(super) fn schema() -> Result<u8, Error> {
    print_result(&format!("{:#}", schema_json())).map(|()| 0)
}
