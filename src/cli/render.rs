//! `curlsmoke render`.

use crate::cli::args::{RenderArguments, WatchArguments};
use crate::cli::frames::{flags, frames, load_scene, set_by_hand, start_threads};
use crate::cli::progress::{Reporter, count, duration};
use crate::cli::signals::Signals;
use crate::cli::{STOPPED, log, pixel, print_result, report};
use crate::error::Error;
use crate::output::frames::check_distinct;
use crate::pipeline::{self, FrameOutcome, RenderJob};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::scene::pattern::{Pattern, spell};
use std::path::PathBuf;

/// Renders; the exit code.
pub(super) fn run(arguments: &RenderArguments) -> Result<u8, Error> {
    let scene = scene_of(arguments)?;
    let frames = frames(&arguments.common, &scene)?;
    let resolution = scene.settings.film.resolution;
    let crop = arguments.crop.map(|crop| crop.bounds(resolution)).transpose().map_err(Error::Usage)?;
    let names = Names::of(&scene)?;
    if arguments.dry_run {
        return describe(&scene, &frames, &names).map(|()| 0);
    }
    start_threads(&arguments.common)?;
    let signals = Signals::listen().map_err(|e| Error::Internal(format!("signals cannot be caught: {e}")))?;
    let reporter = Reporter::new(arguments.common.progress, signals.clone());
    if let Some(pixel) = arguments.pixel {
        return conclude(pixel::run(&scene, &frames, pixel, &reporter), &reporter, &signals);
    }
    let job = RenderJob { frames, crop, resume: arguments.resume };
    let mut printed = Ok(());
    let result = pipeline::render(&scene, &job, &reporter, &mut |outcome| {
        let line = names.line(outcome);
        if let FrameOutcome::Kept { frame } = outcome {
            reporter.note(&format!("frame {frame} is finished already"));
        } else if printed.is_ok() {
            printed = reporter.suspend(|| print_result(&line));
        }
    });
    conclude(result.and(printed), &reporter, &signals)
}

/// Ends a run of frames: the exit code, with the signal's if one came.
pub(super) fn conclude(result: Result<(), Error>, reporter: &Reporter, signals: &Signals) -> Result<u8, Error> {
    let code = match (&result, signals.received()) {
        (Ok(()), _) => 0,
        (Err(error), Some(signal)) if error.is_cancelled() => 128 + signal,
        (Err(error), _) => error.exit_code(),
    };
    let message = result.as_ref().err().map(ToString::to_string).unwrap_or_default();
    reporter.finish(code, &message);
    if let Err(error) = &result {
        if error.is_cancelled() {
            log(STOPPED);
        } else {
            report(error);
        }
    }
    Ok(code)
}

/// The scene with the flags of `render` applied.
pub(super) fn scene_of(arguments: &RenderArguments) -> Result<Scene, Error> {
    let mut overrides = Vec::new();
    if let Some(noise) = arguments.noise_target {
        overrides.push(("film.noise_target".to_string(), noise.to_string()));
    }
    if let Some(seconds) = arguments.time_limit {
        overrides.push(("film.time_limit".to_string(), seconds.to_string()));
    }
    if let Some(spp) = arguments.spp {
        overrides.push(("film.spp".to_string(), spp.to_string()));
    }
    if let Some(resolution) = arguments.resolution {
        // A share needs to know of what. Errors of the scene come out here as well as below.
        let own = Scene::load(&arguments.common.scene)?.settings.film.resolution;
        let [width, height] = resolution.pixels(own);
        overrides.push(("film.resolution".to_string(), format!("[{width}, {height}]")));
    }
    if arguments.pixel.is_some() {
        overrides.push(("output.aovs".to_string(), pixel::LAYERS.into()));
    }
    if let Some(image) = &arguments.output {
        // Text in JSON is text in YAML too, whatever it holds.
        let quoted = |text: &str| serde_json::Value::from(text).to_string();
        overrides.push(("output.image".to_string(), quoted(image)));
        let scene = Scene::load_with(&arguments.common.scene, &set_by_hand(&arguments.common))?;
        let has_own_name = arguments.common.overrides.iter().any(|set| set.0 == "output.preview");
        if scene.settings.output.preview.is_some() && !has_own_name {
            let preview = image.strip_suffix(".exr").unwrap_or(image);
            overrides.push(("output.preview".to_string(), quoted(&format!("{preview}.png"))));
        }
    }
    load_scene(&arguments.common, overrides)
}

/// The scene with the flags of `watch` applied. Its warnings are for the caller to tell, who reads it many times.
pub(super) fn scene_of_watch(arguments: &WatchArguments) -> Result<Scene, Error> {
    let common = arguments.common.to_frame_arguments();
    let mut overrides = flags(&common);
    if let Some(spp) = arguments.spp {
        overrides.push(("film.spp".to_string(), spp.to_string()));
    }
    if let Some(resolution) = arguments.resolution {
        let own = Scene::load(&common.scene)?.settings.film.resolution;
        let [width, height] = resolution.pixels(own);
        overrides.push(("film.resolution".to_string(), format!("[{width}, {height}]")));
    }
    overrides.extend(set_by_hand(&common));
    Ok(Scene::load_with(&common.scene, &overrides)?)
}

/// Names of the pictures of a scene.
pub(super) struct Names {
    image: Pattern,
    preview: Option<Pattern>,
    scene: String,
}

impl Names {
    pub(super) fn of(scene: &Scene) -> Result<Self, Error> {
        let parse = |text: &str| Pattern::parse(text).map_err(|e| Error::Pattern(text.into(), e));
        let output = &scene.settings.output;
        let preview = output.preview.as_deref().map(parse).transpose()?;
        Ok(Self { image: parse(&output.image)?, preview, scene: scene.name().into() })
    }

    fn image(&self, frame: i32) -> PathBuf {
        self.image.expand(frame, &self.scene).into()
    }

    /// What is said of a frame on standard output: its picture, and how it went.
    pub(super) fn line(&self, outcome: &FrameOutcome) -> String {
        match outcome {
            FrameOutcome::Kept { frame } => self.image(*frame).display().to_string(),
            FrameOutcome::Made(record) => format!(
                "{}  {}, {} samples/s",
                self.image(record.frame).display(),
                duration(record.seconds.values().sum()),
                count(record.samples_per_second)
            ),
        }
    }
}

/// Prints what would be made.
pub(super) fn describe(scene: &Scene, frames: &[i32], names: &Names) -> Result<(), Error> {
    check_distinct(frames, |frame| names.image(frame))?;
    let film = &scene.settings.film;
    let [width, height] = film.resolution;
    let samples = f64::from(width) * f64::from(height) * f64::from(film.spp) * frames.len() as f64;
    print_result(&format!(
        "{} frame{}: {}\n{width} × {height} pixels, {} samples per pixel, {} camera samples in all\nseed {}",
        frames.len(),
        if frames.len() == 1 { "" } else { "s" },
        spell(frames),
        film.spp,
        count(samples),
        scene.settings.render.seed
    ))?;
    for &frame in frames {
        print_result(&names.image(frame).display().to_string())?;
        if let Some(preview) = &names.preview {
            print_result(&preview.expand(frame, &names.scene))?;
        }
    }
    Ok(())
}
