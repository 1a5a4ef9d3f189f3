//! `curlsmoke render`.

use crate::cli::args::{FrameArguments, PictureArguments};
use crate::cli::frames::{frames, listed, load_scene, overrides, set_by_hand, start_threads};
use crate::cli::progress::{Reporter, count, duration};
use crate::cli::signals::Signals;
use crate::cli::values::{Crop, PixelPlace, Resolution, Samples};
use crate::cli::watch::WatchArguments;
use crate::cli::{STOPPED, command_line, log, pixel, print_result, report};
use crate::error::Error;
use crate::output::file::check_writable;
use crate::output::frames::check_distinct;
use crate::output::movie;
use crate::pipeline::{self, FrameOutcome, RenderJob};
use crate::progress::Progress;
use crate::render;
use crate::render::film::PixelBounds;
use crate::scene::Scene;
use crate::scene::pattern::{Pattern, spell};
use crate::scene::settings::Film;
use clap::Args;
use std::path::{Path, PathBuf};

/// Flags of `render`.
#[derive(Debug, Args)]
pub struct RenderArguments {
    /// Flags shared with `bake`.
    #[command(flatten)]
    pub common: FrameArguments,
    /// Flags shared by verbs that make pictures.
    #[command(flatten)]
    pub picture: PictureArguments,
    /// Trace light no longer than this many seconds a frame, instead of film.time_limit
    #[arg(long, value_name = "SECONDS", conflicts_with = "noise_target")]
    pub time_limit: Option<f64>,
    /// File names of the pictures (.exr), with #### for the frame, instead of
    /// output.image; previews go beside them
    #[arg(short, long, value_name = "PATTERN", verbatim_doc_comment)]
    pub output: Option<String>,
    /// Render this pixel alone and print all its layers, the ways of its light among them; write nothing
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true, conflicts_with_all = ["crop", "resume", "dry_run", "output", "samples", "missing", "movie"])]
    pub pixel: Option<PixelPlace>,
    /// Trace these paths of each pixel only, counted from 1, as in 1-64, to a .part file
    /// beside the picture; `curlsmoke merge` joins such parts
    #[arg(long, value_name = "FIRST-LAST", conflicts_with_all = ["noise_target", "time_limit", "movie"], verbatim_doc_comment)]
    pub samples: Option<Samples>,
    /// Print the frames that are not finished, or were made from another scene, as a list
    /// for --frames, and make nothing
    #[arg(long, conflicts_with_all = ["dry_run", "resume"], verbatim_doc_comment)]
    pub missing: bool,
    /// Print what would be made, files and all, and make nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Afterwards make a movie of all previews, with the system's ffmpeg: .mp4, .mov, .mkv or .webm
    #[arg(long, value_name = "FILE")]
    pub movie: Option<PathBuf>,
}

/// Renders; the exit code.
pub(super) fn run(arguments: &RenderArguments) -> Result<u8, Error> {
    let scene = scene_of(arguments, listed(arguments.common.frames.as_deref())?.as_deref())?;
    let frames = frames(&arguments.common, &scene)?;
    let crop = arguments.picture.crop.map(|crop| crop_of(crop, &scene)).transpose()?;
    let names = Names::of(&scene)?;
    let samples = arguments.samples.map(|samples| samples_of(samples, &scene)).transpose()?;
    let movie = arguments.movie.as_deref().map(|path| Movie::prepare(path, &scene, &names, &frames)).transpose()?;
    let (resume, checkpoint) = (arguments.picture.resume, arguments.picture.checkpoint());
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
    let path = &arguments.common.scene;
    let mut settings = arguments.picture.settings();
    if let Some(seconds) = arguments.time_limit {
        settings.push(("film.time_limit".to_string(), seconds.to_string()));
    }
    if arguments.pixel.is_some() {
        settings.push(("output.aovs".to_string(), pixel::LAYERS.into()));
    }
    if let Some(image) = &arguments.output {
        // Text in JSON is text in YAML too, whatever it holds.
        let quoted = |text: &str| serde_json::Value::from(text).to_string();
        settings.push(("output.image".to_string(), quoted(image)));
        let scene = Scene::load_for(path, &set_by_hand(&arguments.common), frames)?;
        let has_own_name = arguments.common.overrides.iter().any(|set| set.0 == "output.preview");
        if scene.settings.output.preview.is_some() && !has_own_name {
            let preview = image.strip_suffix(".exr").unwrap_or(image);
            settings.push(("output.preview".to_string(), quoted(&format!("{preview}.png"))));
        }
    }
    settings.extend(overrides(&arguments.common));
    let settings = resized(path, settings, arguments.picture.resolution, frames)?;
    load_scene(path, &settings, frames)
}

/// The scene with the flags of `watch` applied. Its warnings are for the caller to tell, who reads it many times.
pub(super) fn scene_of_watch(arguments: &WatchArguments) -> Result<Scene, Error> {
    let common = arguments.common.to_frame_arguments();
    let mut settings = Vec::new();
    if let Some(spp) = arguments.spp {
        settings.push(("film.spp".to_string(), spp.to_string()));
    }
    if let Some(Resolution::Pixels(size)) = arguments.resolution {
        settings.push(("film.resolution".to_string(), format!("{size:?}")));
    }
    settings.extend(overrides(&common));
    let settings = resized(&common.scene, settings, arguments.resolution, None)?;
    Ok(Scene::load_with(&common.scene, &settings)?)
}

/// Settings of a scene, and after them what makes its pictures a share of the size that they have with these, if that is asked for.
/// A share is one of the overscan too: the picture shows the same.
pub(super) fn resized(
    path: &Path,
    mut settings: Vec<(String, String)>,
    resolution: Option<Resolution>,
    frames: Option<&[i32]>,
) -> Result<Vec<(String, String)>, Error> {
    let Some(resolution @ Resolution::Share(share)) = resolution else { return Ok(settings) };
    let film = Scene::load_for(path, &settings, frames)?.settings.film;
    settings.push(("film.resolution".to_string(), format!("{:?}", resolution.pixels(film.resolution))));
    if !film.overscan.is_none() {
        let sides = film.overscan.sides().map(|pixels| (f64::from(pixels) * share).round() as u32);
        settings.push(("film.overscan".to_string(), format!("{sides:?}")));
    }
    Ok(settings)
}

/// The pixels of a crop in the pictures of a scene.
pub(super) fn crop_of(crop: Crop, scene: &Scene) -> Result<PixelBounds, Error> {
    let film = &scene.settings.film;
    crop.bounds(film.resolution, render::canvas(film)).map_err(Error::Usage)
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

/// The size of pictures, with their overscan.
pub(super) fn size_text(film: &Film) -> String {
    let [width, height] = film.resolution;
    match film.overscan.is_none() {
        true => format!("{width} × {height} pixels"),
        false => {
            let [all_wide, all_high] = film.size();
            format!("{width} × {height} pixels ({all_wide} × {all_high} with overscan)")
        }
    }
}

/// Prints what would be made.
pub(super) fn describe(scene: &Scene, frames: &[i32], names: &Names) -> Result<(), Error> {
    check_distinct(frames, |frame| names.image(frame))?;
    let film = &scene.settings.film;
    let [width, height] = film.size();
    let samples = f64::from(width) * f64::from(height) * f64::from(film.spp) * frames.len() as f64;
    print_result(&format!(
        "{} frame{}: {}\n{}, {} samples per pixel, {} camera samples in all\nseed {}",
        frames.len(),
        if frames.len() == 1 { "" } else { "s" },
        spell(frames),
        size_text(film),
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
