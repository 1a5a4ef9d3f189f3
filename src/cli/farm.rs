//! `curlsmoke farm`: jobs for render farms, printed as text that needs no more than a look.

use crate::cli::frames::{list_of, listed};
use crate::cli::values::Override;
use crate::cli::{print_result, warn_about};
use crate::error::Error;
use crate::scene::pattern::{Pattern, Piece, spell};
use crate::scene::{Scene, settings};
use clap::{Args, Subcommand};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Farms.
#[derive(Debug, Subcommand)]
pub enum FarmVerb {
    /// Print a template of Open Job Description, in YAML
    #[command(after_help = "Example: curlsmoke farm openjd scenes/plume.yaml --chunk 8 --bake > plume.openjd.yaml")]
    Openjd(FarmArguments),
    /// Print a script for Slurm's sbatch
    #[command(after_help = "Example: curlsmoke farm slurm scenes/plume.yaml --chunk 8 > plume.sbatch")]
    Slurm(FarmArguments),
}

/// Flags of `farm`.
#[derive(Debug, Args)]
pub struct FarmArguments {
    /// The scene file (YAML)
    pub scene: PathBuf,
    /// Frames to make: 1-96, 1-96x2 (every second), 1,3,7-9 [default: those of the scene]
    #[arg(short, long, value_name = "LIST", allow_hyphen_values = true)]
    pub frames: Option<String>,
    /// Frames that a task makes one after the other
    #[arg(long, value_name = "COUNT", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub chunk: u32,
    /// Bake the density to .vdb files (output.volume) first, and render from those
    #[arg(long)]
    pub bake: bool,
    /// Change a setting of the scene, as in --set film.spp=64
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<Override>,
}

/// Prints a job; the exit code.
pub(super) fn run(verb: &FarmVerb) -> Result<u8, Error> {
    let text = match verb {
        FarmVerb::Openjd(arguments) => openjd(&Job::new(arguments)?)?,
        FarmVerb::Slurm(arguments) => slurm(&Job::new(arguments)?),
    };
    print_result(text.trim_end()).map(|()| 0)
}

/// What the tasks of a job run. Tasks may begin in any folder, so that all names of files are absolute.
struct Job {
    name: String,
    scene: String,
    /// In rising order, which is how farms hand them out.
    frames: Vec<i32>,
    chunk: usize,
    /// Arguments after the scene and its frames.
    render: Vec<String>,
    /// Likewise, of the bake that comes first, if any.
    bake: Option<Vec<String>>,
}

impl Job {
    fn new(arguments: &FarmArguments) -> Result<Self, Error> {
        let overrides: Vec<(String, String)> =
            arguments.overrides.iter().map(|set| (set.0.clone(), set.1.clone())).collect();
        let scene = warn_about(
            Scene::load_for(&arguments.scene, &overrides, listed(arguments.frames.as_deref())?.as_deref()),
            |scene| scene.warnings.iter().map(ToString::to_string).collect(),
        )?;
        let mut frames = list_of(arguments.frames.as_deref(), &scene)?;
        frames.sort_unstable();
        let output = &scene.settings.output;
        let text = |path: &str| absolute_pattern(path).map(|path| Value::from(path).to_string());
        let own = overrides.iter().flat_map(|(key, value)| set(key, value));
        let mut render: Vec<String> = own.clone().collect();
        render.extend(set("output.image", &text(&output.image)?));
        if let Some(preview) = &output.preview {
            render.extend(set("output.preview", &text(preview)?));
        }
        let mut bake = None;
        if arguments.bake {
            let volume = absolute_pattern(&output.volume)?;
            render.extend(set("smoke", &baked_smoke(&scene, &volume)?));
            let mut words: Vec<String> = own.chain(["--output".to_string(), volume]).collect();
            if !scene.settings.output.volume_grids.is_empty() {
                // Beside velocities the density would be that of an instant, and pictures of it sharp.
                words.extend(set("output.volume_grids", "[]"));
            }
            bake = Some(words);
        }
        let scene_file = absolute(&arguments.scene)?;
        let (name, chunk) = (scene.name().to_string(), arguments.chunk as usize);
        Ok(Self { name, scene: scene_file, frames, chunk, render, bake })
    }
}

fn absolute(path: &Path) -> Result<String, Error> {
    let absolute = std::path::absolute(path).map_err(|e| Error::Usage(format!("{}: {e}", path.display())))?;
    absolute.into_os_string().into_string().map_err(|path| {
        let path = path.to_string_lossy();
        Error::Usage(format!("{path}: jobs are text, and this name is not UTF-8; start from a folder whose name is"))
    })
}

/// The same of names that stand for a sequence of files: nothing in the folder that comes before may then stand for a frame.
fn absolute_pattern(pattern: &str) -> Result<String, Error> {
    let whole = absolute(Path::new(pattern))?;
    if Path::new(pattern).is_relative() {
        let folder = absolute(Path::new("."))? + "/";
        if Pattern::parse(&folder).is_ok_and(|read| *read.pieces() != [Piece::Literal(folder.clone())])
            || folder.contains('{')
        {
            return Err(Error::Usage(format!(
                "{pattern}: its place, {folder}, holds what would stand for a frame or a scene in names of files (#, %d, $F, \
                 {{…}}); start from another folder, or write a whole name that begins elsewhere"
            )));
        }
    }
    Ok(whole)
}

fn set(key: &str, value: &str) -> [String; 2] {
    ["--set".into(), format!("{key}={value}")]
}

/// The smoke of a scene, read from files that were baked of it.
fn baked_smoke(scene: &Scene, volume: &str) -> Result<String, Error> {
    if scene.settings.output.aovs.contains(&settings::Aov::Motion) {
        let problem = "--bake: the layer `motion` shows how smoke moves, which baked files do not hold; leave out the one or the other";
        return Err(Error::Usage(problem.into()));
    }
    let smoke = match &scene.settings.smoke {
        Some(smoke) if smoke.file.is_some() => {
            return Err(Error::Usage("--bake: the scene reads its smoke from files already; leave it out".into()));
        }
        Some(smoke) => smoke,
        None => return Err(Error::NothingToBake),
    };
    if smoke.blackbody.is_some() {
        let problem = "--bake: the light of hot smoke is made of its particles, and of baked temperatures its colour would differ; \
                       leave it out";
        return Err(Error::Usage(problem.into()));
    }
    let internal = |e: serde_json::Error| Error::Internal(e.to_string());
    let file: settings::DensityFile =
        serde_json::from_value(json!({"path": volume, "density": "density"})).map_err(internal)?;
    let mut value = json!({
        "file": serde_json::to_value(file).map_err(internal)?,
        "medium": serde_json::to_value(&smoke.medium).map_err(internal)?,
    });
    if let Some(detail) = &smoke.detail {
        value["detail"] = serde_json::to_value(detail).map_err(internal)?;
    }
    if let Some(seed) = smoke.seed {
        value["seed"] = seed.into();
    }
    Ok(value.to_string())
}

/// A template of Open Job Description, version 2023-09, with the extension for chunks.
fn openjd(job: &Job) -> Result<String, Error> {
    let call = |verb: &str, frames: &str, more: &[String]| -> Result<Vec<String>, Error> {
        if let Some(argument) = more.iter().find(|argument| argument.contains("{{")) {
            return Err(Error::Usage(format!("`{argument}`: {{{{ stands for parameters in Open Job Description")));
        }
        let start = [verb, "{{Param.Scene}}", "--frames", frames, "--progress", "openjd"].map(String::from);
        // What ends a parameter may not stand alone either; twice, because three in a row are two pairs. Spaces between braces
        // change nothing in YAML.
        let apart = |argument: &String| argument.replace("}}", "} }").replace("}}", "} }");
        Ok(start.into_iter().chain(more.iter().map(apart)).collect())
    };
    let mut steps = Vec::new();
    let action = |args: Vec<String>| {
        let cancel = json!({"mode": "NOTIFY_THEN_TERMINATE", "notifyPeriodInSeconds": 60});
        json!({"actions": {"onRun": {"command": "{{Param.Curlsmoke}}", "args": args, "cancelation": cancel}}})
    };
    let frames = spell(&job.frames);
    if let Some(bake) = &job.bake {
        // One task: each frame goes on from the one before.
        steps.push(json!({"name": "bake", "script": action(call("bake", &frames, bake)?)}));
    }
    let render = [vec!["--resume".to_string()], job.render.clone()].concat();
    let chunks = json!({"defaultTaskCount": job.chunk, "rangeConstraint": "NONCONTIGUOUS"});
    let mut step = json!({
        "name": "render",
        "parameterSpace": {"taskParameterDefinitions": [
            {"name": "Frames", "type": "CHUNK[INT]", "range": frames, "chunks": chunks},
        ]},
        "script": action(call("render", "{{Task.Param.Frames}}", &render)?),
    });
    if job.bake.is_some() {
        step["dependencies"] = json!([{"dependsOn": "bake"}]);
    }
    steps.push(step);
    let template = json!({
        "specificationVersion": "jobtemplate-2023-09",
        "extensions": ["TASK_CHUNKING"],
        "name": job.name,
        "parameterDefinitions": [
            // Not a PATH, whose default would have to be relative to wherever the template will be.
            {"name": "Scene", "type": "STRING", "default": job.scene, "description": "The scene file"},
            {"name": "Curlsmoke", "type": "STRING", "default": "curlsmoke", "description": "The program"},
        ],
        "steps": steps,
    });
    let mut out = String::from("# Open Job Description: a file of YAML, or of JSON, which is YAML too.\n");
    out += &serde_json::to_string_pretty(&template).map_err(|e| Error::Internal(e.to_string()))?;
    Ok(out)
}

/// What each task of a Slurm array runs, `ARGUMENTS` aside.
const SLURM_TASK: &str = r#"child=$!
# Slurm signals this script; the renderer then writes a checkpoint and ends.
trap 'kill -TERM "$child" 2>/dev/null' TERM INT
wait "$child"; code=$?
# A signal ends the wait, not the renderer.
while kill -0 "$child" 2>/dev/null; do wait "$child"; code=$?; done
case $code in
129|130|137|143)
    # Stopped or killed: once more, from the checkpoint, unless that happens again and again.
    if [ "${SLURM_RESTART_COUNT:-0}" -lt 5 ] && scontrol requeue "$SLURM_JOB_ID"; then exit 75; fi;;
esac
exit "$code"
"#;

/// A script for `sbatch`; with a bake a script for `sh` that submits both.
fn slurm(job: &Job) -> String {
    let call = |verb: &str, frames: &str, more: &[String]| {
        let more: Vec<String> = more.iter().map(|argument| quoted(argument)).collect();
        format!(
            "\"${{CURLSMOKE:-curlsmoke}}\" {verb} {} --frames {frames} --progress plain \\\n    \
             ${{SLURM_CPUS_PER_TASK:+--threads \"$SLURM_CPUS_PER_TASK\"}} {} &\n",
            quoted(&job.scene),
            more.join(" ")
        )
    };
    let head = |name: String| {
        format!(
            "#!/bin/bash\n#SBATCH --job-name={}\n#SBATCH --requeue\n#SBATCH --open-mode=append\n#SBATCH --signal=B:TERM@120\n",
            quoted(&name)
        )
    };
    let chunks: Vec<String> = job.frames.chunks(job.chunk).map(|chunk| quoted(&spell(chunk))).collect();
    let mut array = head(job.name.clone());
    // Writing to a String cannot fail.
    let _ = write!(array, "#SBATCH --array=0-{}\n#SBATCH --output=%x.%A_%a.log\n\n", chunks.len() - 1);
    let _ = write!(array, "# Frames of each task.\nframes=(\n{}\n)\n", chunks.join("\n"));
    let render = [vec!["--resume".to_string()], job.render.clone()].concat();
    array += &call("render", "\"${frames[$SLURM_ARRAY_TASK_ID]}\"", &render);
    array += SLURM_TASK;
    let Some(bake) = &job.bake else { return array };
    let mut first = head(format!("{}-bake", job.name));
    first += "#SBATCH --output=%x.%j.log\n\n";
    first += &call("bake", &quoted(&spell(&job.frames)), bake);
    first += SLURM_TASK;
    format!(
        "#!/bin/sh\n# Submits a job that bakes the density, and an array that renders when that is done.\nset -e\n\
         bake=$(sbatch --parsable <<'END_OF_BAKE'\n{first}END_OF_BAKE\n)\n\
         sbatch --parsable --dependency=\"afterok:$bake\" <<'END_OF_RENDER'\n{array}END_OF_RENDER\n"
    )
}

/// A word for a shell, whatever it holds.
fn quoted(text: &str) -> String {
    if !text.is_empty() && text.chars().all(|c| c.is_ascii_alphanumeric() || "-_./=,:+@%".contains(c)) {
        return text.into();
    }
    format!("'{}'", text.replace('\'', r"'\''"))
}
