//! `curlsmoke check` and `curlsmoke schema`.

use crate::cli::render::size_text;
use crate::cli::values::Override;
use crate::cli::{log, print_result};
use crate::error::Error;
use crate::pipeline;
use crate::scene::suite::suite_schema_json;
use crate::scene::{Scene, SceneError, schema_json};
use clap::{Args, ValueEnum};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Flags of `check`.
#[derive(Debug, Args)]
pub struct CheckArguments {
    /// The scene files (YAML)
    #[arg(required = true)]
    pub scenes: Vec<PathBuf>,
    /// Change a setting of the scenes, as in --set film.spp=16
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<Override>,
    /// How to print problems
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub format: Format,
}

/// How to print problems.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// For people, with the line of the scene
    Text,
    /// For programs, on standard output
    Json,
}

/// Flags of `schema`.
#[derive(Debug, Args)]
pub struct SchemaArguments {
    /// That of the suites of `regress` instead
    #[arg(long)]
    pub suite: bool,
}

/// Checks all scenes; the exit code of the first that has errors.
pub(super) fn run(arguments: &CheckArguments) -> Result<u8, Error> {
    let overrides: Vec<(String, String)> = arguments.overrides.iter().map(|o| (o.0.clone(), o.1.clone())).collect();
    let mut code = 0;
    let mut reports = Vec::new();
    for path in &arguments.scenes {
        let scene = Scene::load_with(path, &overrides);
        let inputs = scene.as_ref().map_or_else(|_| Ok(Vec::new()), pipeline::check);
        match arguments.format {
            Format::Text => print_text(path, &scene, &inputs)?,
            Format::Json => reports.push(json_report(path, &scene, &inputs)),
        }
        let error = scene.err().map(Error::from).or(inputs.err());
        if let Some(error) = error.filter(|_| code == 0) {
            code = error.exit_code();
        }
    }
    if arguments.format == Format::Json {
        print_result(&format!("{:#}", Value::Array(reports)))?;
    }
    Ok(code)
}

/// Warnings about what a scene is made of: shapes, emitters and files.
type Inputs = Result<Vec<String>, Error>;

fn print_text(path: &Path, scene: &Result<Scene, SceneError>, inputs: &Inputs) -> Result<(), Error> {
    match (scene, inputs) {
        (Err(error), _) => log(&error.to_string()),
        (Ok(_), Err(error)) => log(&format!("error: {error}")),
        (Ok(scene), Ok(warnings)) => {
            scene.warnings.iter().for_each(|warning| log(&format!("{warning}\n")));
            warnings.iter().for_each(|warning| log(warning));
            let (frames, film) = (&scene.settings.frames, &scene.settings.film);
            print_result(&format!(
                "{}: ok, frames {} to {}, {}, {} samples per pixel",
                path.display(),
                frames.first,
                frames.last,
                size_text(film),
                film.spp
            ))?;
        }
    }
    Ok(())
}

fn json_report(path: &Path, scene: &Result<Scene, SceneError>, inputs: &Inputs) -> Value {
    let (problems, message) = match scene {
        Ok(scene) => (json!(scene.warnings), inputs.as_ref().err().map(ToString::to_string)),
        Err(error) => {
            // A file that cannot be read has no problems inside it.
            let inside = error.diagnostics();
            (json!(inside), inside.is_empty().then(|| error.to_string()))
        }
    };
    let ok = scene.is_ok() && inputs.is_ok();
    let warnings = inputs.as_deref().unwrap_or_default();
    json!({"scene": path, "ok": ok, "message": message, "problems": problems, "warnings": warnings})
}

/// Prints the JSON Schema of scene files, or of suites.
pub(super) fn schema(arguments: &SchemaArguments) -> Result<u8, Error> {
    let schema = if arguments.suite { suite_schema_json() } else { schema_json() };
    print_result(&format!("{schema:#}")).map(|()| 0)
}
