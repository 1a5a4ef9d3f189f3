//! `curlsmoke render`.

use crate::cli::args::{RenderArguments, WatchArguments};
use crate::cli::frames::{flags, frames, listed, load_scene, set_by_hand, start_threads};
use crate::cli::progress::{Reporter, count, duration};
use crate::cli::signals::Signals;
use crate::cli::values::Samples;
use crate::cli::{STOPPED, command_line, log, pixel, print_result, report};
use crate::error::Error;
use crate::output::file::check_writable;
use crate::output::frames::check_distinct;
use crate::output::movie;
use crate::pipeline::{self, FrameOutcome, RenderJob};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::scene::pattern::{Pattern, spell};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Renders; the exit code.
pub(super) fn run(arguments: &RenderArguments) -> Result<u8, Error> {
    let scene = scene_of(arguments, listed(arguments.common.frames.as_deref())?.as_deref())?;
    let frames = frames(&arguments.common, &scene)?;
    let resolution = scene.settings.film.resolution;
    let crop = arguments.crop.map(|crop| crop.bounds(resolution)).transpose().map_err(Error::Usage)?;
    let names = Names::of(&scene)?;
    let samples = arguments.samples.map(|samples| samples_of(samples, &scene)).transpose()?;
    let movie = arguments.movie.as_deref().map(|path| Movie::prepare(path, &scene, &names, &frames)).transpose()?;
    let checkpoint = checkpoint_of(arguments);
    let resume = arguments.resume;
    let job = RenderJob { frames, crop, resume, samples, checkpoint, arguments: command_line() };
    if arguments.missing {
        let missing = pipeline::missing(&scene, &job)?;
        log(&format!("{} of {} frames are missing", missing.len(), job.frames.len()));
        // Nothing at all where nothing is missing, so that a shell sees an empty text.
        return if missing.is_empty() { Ok(0) } else { print_result(&spell(&missing)).map(|()| 0) };
    }
    if arguments.dry_run {
        return describe(&scene, &job.frames, &names).map(|()| 0);
    }
    start_threads(arguments.common.threads)?;
    let signals = Signals::listen().map_err(|e| Error::Internal(format!("signals cannot be caught: {e}")))?;
    let reporter = Reporter::new(arguments.common.progress, signals.clone());
    if let Some(pixel) = arguments.pixel {
        return conclude(pixel::run(&scene, &job.frames, pixel, &reporter), &reporter, &signals);
    }
    // What a log needs for making the same again; sidecars have all of it.
    reporter.note(&format!(
        "curlsmoke {}: {} (SHA-256 {}), seed {}, frames {}, {} paths a pixel{}",
        env!("CARGO_PKG_VERSION"),
        scene.path.display(),
        scene.file_hash,
        scene.settings.render.seed,
        spell(&job.frames),
        scene.settings.film.spp,
        samples.map(|[first, last]| format!(", of which {first} to {last}")).unwrap_or_default()
    ));
    let mut printed = Ok(());
    let result = pipeline::render(&scene, &job, &reporter, &mut |outcome| {
        let line = names.line(outcome);
        if let FrameOutcome::Kept { frame } = outcome {
            reporter.note(&format!("frame {frame} is finished already"));
        } else if printed.is_ok() {
            printed = reporter.suspend(|| print_result(&line));
        }
    });
    let result = result.and(printed).and_then(|()| movie.map_or(Ok(()), |movie| movie.make()));
    conclude(result, &reporter, &signals)
}

/// A movie to be made of all previews.
pub(super) struct Movie<'a> {
    path: &'a Path,
    previews: Vec<PathBuf>,
    fps: f64,
}

impl<'a> Movie<'a> {
    /// What can be known before anything is rendered.
    pub(super) fn prepare(path: &'a Path, scene: &Scene, names: &Names, frames: &[i32]) -> Result<Self, Error> {
        movie::check(path)?;
        check_writable(path)?;
        let preview = names.preview.as_ref().ok_or_else(|| {
            Error::Usage(
                "--movie is made of previews, and the scene has none; add --set output.preview=out/{scene}.####.png"
                    .into(),
            )
        })?;
        let previews = frames.iter().map(|&frame| preview.expand(frame, &names.scene).into()).collect();
        Ok(Self { path, previews, fps: scene.settings.frames.fps })
    }

    pub(super) fn make(&self) -> Result<(), Error> {
        movie::make(&self.previews, self.fps, self.path)?;
        print_result(&self.path.display().to_string())
    }
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

/// How often to write a checkpoint, if ever.
pub(super) fn checkpoint_of(arguments: &RenderArguments) -> Option<Duration> {
    Some(arguments.checkpoint_every).filter(|&seconds| seconds > 0.0).map(Duration::from_secs_f64)
}

/// The paths to trace, which must be among those of the scene and known beforehand.
pub(super) fn samples_of(samples: Samples, scene: &Scene) -> Result<[u32; 2], Error> {
    let ([first, last], film) = (samples.0, &scene.settings.film);
    let problem = if film.noise_target.is_some() {
        "does not go with film.noise_target: how many paths a pixel needs is told by its neighbours' noise, which a part of them \
         does not know; leave out the one or the other"
    } else if film.time_limit.is_some() {
        "does not go with film.time_limit: how many paths there is time for is not known beforehand; leave out the one or the \
         other"
    } else if last > film.spp {
        &format!("there are paths 1-{} a pixel (film.spp)", film.spp)
    } else {
        return Ok([first, last]);
    };
    Err(Error::Usage(format!("--samples {first}-{last}: {problem}")))
}

/// The scene with the flags of `render` applied, to make some of its frames, or all where `None`.
pub(super) fn scene_of(arguments: &RenderArguments, frames: Option<&[i32]>) -> Result<Scene, Error> {
    load_scene(&arguments.common, overrides_of(arguments, frames)?, frames)
}

/// What the flags of `render` alone set.
pub(super) fn overrides_of(
    arguments: &RenderArguments,
    frames: Option<&[i32]>,
) -> Result<Vec<(String, String)>, Error> {
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
        let own = Scene::load_for(&arguments.common.scene, &[], frames)?.settings.film.resolution;
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
        let scene = Scene::load_for(&arguments.common.scene, &set_by_hand(&arguments.common), frames)?;
        let has_own_name = arguments.common.overrides.iter().any(|set| set.0 == "output.preview");
        if scene.settings.output.preview.is_some() && !has_own_name {
            let preview = image.strip_suffix(".exr").unwrap_or(image);
            overrides.push(("output.preview".to_string(), quoted(&format!("{preview}.png"))));
        }
    }
    Ok(overrides)
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

    pub(super) fn image(&self, frame: i32) -> PathBuf {
        self.image.expand(frame, &self.scene).into()
    }

    /// What is said of a frame on standard output: its picture, and how it went.
    pub(super) fn line(&self, outcome: &FrameOutcome) -> String {
        match outcome {
            FrameOutcome::Kept { frame } => self.image(*frame).display().to_string(),
            FrameOutcome::Made { path, record } => format!(
                "{}  {}, {} samples/s",
                path.display(),
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
