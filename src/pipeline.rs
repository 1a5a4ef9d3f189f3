//! Runs the stages in order and times them; the only file that names them all.

mod assemble;
mod bake;
mod fingerprint;
mod frame_files;
mod heat;
pub mod inputs;
mod keeper;
pub mod live;
mod mask_files;
pub mod merge;
mod smoke;
mod studio;
pub mod turntable;
mod volumes;
pub mod wedge;

pub use crate::pipeline::bake::{BakeJob, bake};

use crate::error::Error;
use crate::flow::Flow;
use crate::geometry::Geometry;
use crate::inspect::Inspection;
use crate::output::frames::check_distinct;
use crate::output::sidecar::Sidecar;
use crate::output::{self, OutputError};
use crate::particles::{self, ParticleSystem};
use crate::pipeline::assemble::{in_render, load_lights, load_textures, smoke_heat};
use crate::pipeline::fingerprint::{FileHashes, InputHash};
use crate::pipeline::frame_files::{OutputFiles, check_writable, finish_of, write_part, write_picture};
use crate::pipeline::keeper::Keeper;
use crate::pipeline::mask_files::SceneFiles;
use crate::pipeline::smoke::SmokeSource;
use crate::pipeline::studio::Studio;
use crate::pipeline::volumes::VolumeSources;
use crate::progress::{Progress, Silent, Stage};
use crate::render::film::{Film, PixelBounds};
use crate::render::ledger::Ledger;
use crate::render::tiles::{self, View};
use crate::render::{self, sun_shadow};
use crate::scene::pattern::Pattern;
use crate::scene::{Scene, footprint, settings};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// What to render.
#[derive(Debug, Clone, Default)]
pub struct RenderJob {
    /// Frames, in the order in which they are made.
    pub frames: Vec<i32>,
    /// The part of the picture to render; all of it where `None`.
    pub crop: Option<PixelBounds>,
    /// Leave frames alone that are whole and made from this very scene, and go on from checkpoints.
    pub resume: bool,
    /// The first and the last path of each pixel to trace, from 1, to a file to be merged with others; all, to a picture,
    /// where `None`.
    pub samples: Option<[u32; 2]>,
    /// How often to keep what is done of a frame, where at all.
    pub checkpoint: Option<Duration>,
    /// What the program was started with, for the sidecars.
    pub arguments: Vec<String>,
}

/// What became of a frame.
#[derive(Debug, Clone)]
pub enum FrameOutcome {
    /// It was there already.
    Kept {
        /// Number of the frame.
        frame: i32,
    },
    /// It was made.
    Made {
        /// Its picture, or the file of its part.
        path: PathBuf,
        /// How it came about.
        record: Box<Sidecar>,
    },
}

/// Renders frames and writes their files; calls `on_frame` after each.
///
/// # Errors
/// The first that any stage meets. Frames finished before it stay, and a checkpoint of the one at hand.
pub fn render(
    scene: &Scene,
    job: &RenderJob,
    progress: &dyn Progress,
    on_frame: &mut dyn FnMut(&FrameOutcome),
) -> Result<(), Error> {
    let files = OutputFiles::new(scene, job.samples)?;
    check_distinct(&job.frames, |frame| files.image(frame))?;
    check_writable(job.frames.iter().map(|&frame| files.to_write(frame)))?;
    check_camera(scene, &job.frames)?;
    check_lights(scene, &job.frames)?;
    check_sums(scene, job, &files)?;
    let mut hashes = FileHashes::default();
    let inputs = InputHash::new(scene, job.crop, &mut hashes)?;
    let mut studio: Option<Studio> = None;
    for (index, &frame) in job.frames.iter().enumerate() {
        progress.frame(frame, index, job.frames.len());
        let fingerprint = inputs.fingerprint(scene, frame, &mut hashes)?;
        if job.resume && files.is_complete(frame, &fingerprint) {
            on_frame(&FrameOutcome::Kept { frame });
            continue;
        }
        let shot = Shot { scene, frame, number: frame, fingerprint };
        on_frame(&make(&shot, job, &files, &mut studio, progress)?);
    }
    Ok(())
}

/// Makes sure that the sums of a run that traces a part of the paths fit into memory.
fn check_sums(scene: &Scene, job: &RenderJob, files: &OutputFiles) -> Result<(), OutputError> {
    let (Some(_), Some(&frame)) = (job.samples, job.frames.first()) else { return Ok(()) };
    let needed = footprint::film_bytes(&scene.settings) + footprint::sums_bytes(&scene.settings);
    output::check_memory(&files.image(frame), needed as u64, memory_limit(scene))
}

/// A picture to be made.
struct Shot<'a> {
    scene: &'a Scene,
    /// The frame of the scene.
    frame: i32,
    /// The number in the names of files.
    number: i32,
    fingerprint: String,
}

/// Whoever takes pictures, with all that is kept from one to the next.
trait Photographer {
    /// Fills the ledger; how many paths a pixel has at most.
    fn take_picture(
        &mut self,
        scene: &Scene,
        view: &View,
        frame: i32,
        ledger: &Ledger,
        progress: &dyn Progress,
        record: &mut Sidecar,
    ) -> Result<u32, Error>;
}

/// Makes a picture and writes its files.
fn make(
    shot: &Shot,
    job: &RenderJob,
    files: &OutputFiles,
    photographer: &mut dyn Photographer,
    progress: &dyn Progress,
) -> Result<FrameOutcome, Error> {
    let scene = shot.scene;
    let mut record = Sidecar {
        frame: shot.number,
        fingerprint: shot.fingerprint.clone(),
        version: env!("CARGO_PKG_VERSION").into(),
        arguments: job.arguments.clone(),
        scene: scene.path.to_string_lossy().into_owned(),
        scene_sha256: scene.file_hash.clone(),
        overrides: scene.overrides.clone(),
        seed: scene.settings.render.seed,
        resolution: scene.settings.film.resolution,
        crop: job.crop.map(|crop| [crop.x0, crop.y0, crop.x1, crop.y1]),
        spp: scene.settings.film.spp,
        ..Sidecar::default()
    };
    check_camera(scene, &[shot.frame])?;
    let view = render::build_view(scene, shot.frame, job.crop);
    let keeper = Keeper::new(scene, &view, files, job, &record, progress);
    let done = if job.resume { keeper.load() } else { Vec::new() };
    record.tiles_resumed = done.iter().flatten().count();
    let samples = job.samples.map(|[first, last]| first - 1..last);
    let watcher = |ledger: &Ledger| keeper.look(ledger);
    let ledger = Ledger::new(samples, done, Some(&watcher));
    match photographer.take_picture(scene, &view, shot.frame, &ledger, progress, &mut record) {
        Ok(spp) => record.spp = spp,
        Err(error) => {
            if error.is_cancelled() {
                keeper.save(&ledger);
            }
            return Err(error);
        }
    }
    let tiles = ledger.tiles();
    drop(ledger);
    let path = if job.samples.is_some() {
        write_part(&keeper, files, &tiles, progress, &mut record)?
    } else {
        let film = tiles::canvas(&view).film(record.spp, &tiles);
        drop(tiles);
        let finish = finish_of(scene, &view, &record);
        write_picture(&files.target(shot.number), film, finish, progress, &mut record)?
    };
    keeper.forget();
    Ok(FrameOutcome::Made { path, record: Box::new(record) })
}

/// Frames of a job, of those that it lists, that are not finished or were made from something else.
///
/// # Errors
/// Where an input file cannot be read.
pub fn missing(scene: &Scene, job: &RenderJob) -> Result<Vec<i32>, Error> {
    let files = OutputFiles::new(scene, job.samples)?;
    check_distinct(&job.frames, |frame| files.image(frame))?;
    let mut hashes = FileHashes::default();
    let inputs = InputHash::new(scene, job.crop, &mut hashes)?;
    let mut missing = Vec::new();
    for &frame in &job.frames {
        if !files.is_complete(frame, &inputs.fingerprint(scene, frame, &mut hashes)?) {
            missing.push(frame);
        }
    }
    Ok(missing)
}

/// The light of one frame: what [`render`] writes, for whoever goes on with it in memory.
///
/// # Errors
/// The first that any stage meets.
pub fn film(scene: &Scene, frame: i32, crop: Option<PixelBounds>, progress: &dyn Progress) -> Result<Film, Error> {
    check_camera(scene, &[frame])?;
    let mut record = Sidecar::default();
    let view = render::build_view(scene, frame, crop);
    let ledger = Ledger::new(None, Vec::new(), None);
    let spp = None::<Studio>.take_picture(scene, &view, frame, &ledger, progress, &mut record)?;
    Ok(tiles::canvas(&view).film(spp, &ledger.tiles()))
}

/// The flow of a scene made ready to be looked at, at a frame.
///
/// # Errors
/// Where a mesh or the file of a mask is missing, faulty or too large.
pub fn inspection(scene: &Scene, frame: i32) -> Result<Inspection, Error> {
    check_camera(scene, &[frame])?;
    let geometry = Geometry::build(scene, &Silent)?;
    let flow = build_flow(scene, &geometry)?;
    Ok(Inspection::build(scene, frame, geometry, flow))
}

/// Reads all that a frame of a scene needs, and makes none: what is likely a mistake.
///
/// # Errors
/// The first file that cannot be used: a mesh, a picture of the surroundings or of a texture, the file of a mask, or the density of the
/// first frame.
pub fn check(scene: &Scene) -> Result<Vec<String>, Error> {
    let geometry = Geometry::build_without_distances(scene)?;
    let mut warnings = geometry.warnings.clone();
    warnings.extend(geometry.camera_warning(scene));
    warnings.extend(particles::wall_warnings(scene, &geometry));
    let (first, last) = (scene.settings.frames.first, scene.settings.frames.last);
    let frames: Vec<i32> = (first..=last).collect();
    check_camera(scene, &frames)?;
    check_lights(scene, &frames)?;
    load_lights(scene, 0.0)?;
    load_textures(scene)?;
    // For the files of masks, which scenes have whose smoke is not made of particles.
    let flow = build_flow(scene, &geometry)?;
    match &scene.settings.smoke {
        Some(settings::Smoke { file: Some(_), .. }) => {
            let frame = scene.settings.frames.first;
            let heat = smoke_heat(scene);
            SmokeSource::build(scene, &geometry)?.grid(scene, frame, heat, &Silent, &mut Sidecar::default())?;
        }
        Some(settings::Smoke { grid: Some(_), emitters, .. }) => {
            let system = ParticleSystem::build(scene, &geometry, flow)
                .map_err(|e| in_scene(scene, "smoke.emitters", None, e))?;
            warnings.extend((0..emitters.len()).filter_map(|i| {
                let share = system.share_born_inside(i).filter(|&share| share > BORN_INSIDE_NOTED)?;
                let place = scene.place(&format!("smoke.emitters[{i}]"));
                Some(format!("warning: {place}{}", smoke::born_inside_text(scene, "its particles are", share)))
            }));
        }
        _ => {}
    }
    let volumes = VolumeSources::build(scene, &geometry)?;
    volumes.at_frame(scene, &geometry, scene.settings.frames.first, &Silent, &mut Sidecar::default())?;
    Ok(warnings)
}

/// Share of particles born inside obstacles above which people are told.
const BORN_INSIDE_NOTED: f64 = 0.5;

/// Makes sure that a camera that moves looks somewhere at frames.
fn check_camera(scene: &Scene, frames: &[i32]) -> Result<(), Error> {
    let count = if render::camera_course(scene).varies() { frames.len() } else { frames.len().min(1) };
    frames[..count].iter().try_for_each(|&frame| {
        render::check_camera(scene, frame).map_err(|e| in_scene(scene, "camera.look_at", Some(frame), e))
    })
}

/// Makes sure that no light that moves ceases to be at frames.
fn check_lights(scene: &Scene, frames: &[i32]) -> Result<(), Error> {
    if !scene.settings.lights.iter().any(settings::Light::varies) {
        return Ok(());
    }
    frames.iter().try_for_each(|&frame| {
        render::check_lights(scene, time_of(scene, frame)).map_err(|e| match in_render(scene, e) {
            Error::InScene { place, source, .. } => Error::InScene { place, frame: Some(frame), source },
            error => error,
        })
    })
}

/// Time of a frame [s].
fn time_of(scene: &Scene, frame: i32) -> f64 {
    scene.settings.frames.time(f64::from(frame))
}

fn build_flow(scene: &Scene, geometry: &Geometry) -> Result<Flow, Error> {
    Flow::build(scene, geometry, &SceneFiles { memory_limit: memory_limit(scene) }).map_err(|e| {
        let key = e.key().to_string();
        in_scene(scene, &key, None, e)
    })
}

/// An error with the place in the scene, and the frame, that it comes from.
fn in_scene(scene: &Scene, key: &str, frame: Option<i32>, error: impl Into<Error>) -> Error {
    let error = error.into();
    if error.is_cancelled() {
        return error;
    }
    Error::InScene { place: Box::new(scene.place(key)), frame, source: Box::new(error) }
}

fn parse_pattern(text: &str) -> Result<Pattern, Error> {
    Pattern::parse(text).map_err(|e| Error::Pattern(text.into(), e))
}

fn memory_limit(scene: &Scene) -> u64 {
    (scene.settings.render.memory_limit_gib * f64::from(1 << 30)) as u64
}

/// Memory that the grid of a frame may take beside the picture, `particle_count` particles and tables of the suns' light
/// [bytes].
fn grid_memory_limit(scene: &Scene, particle_count: usize) -> u64 {
    let settings = &scene.settings;
    let suns = settings.lights.iter().filter(|light| matches!(light, settings::Light::Sun(_))).count();
    let grids = usize::from(settings.smoke.is_some()) + settings.volumes.len();
    let others = footprint::film_bytes(settings) + particle_count as f64 * footprint::particle_bytes(&settings.frames);
    memory_limit(scene).saturating_sub(others as u64 + (suns * grids) as u64 * sun_shadow::BYTES_MAX)
}

/// Runs one stage with its progress and notes its time.
fn timed<T, E>(
    progress: &dyn Progress,
    stage: Stage,
    record: &mut Sidecar,
    total: u64,
    work: impl FnOnce() -> Result<T, E>,
) -> Result<T, E> {
    progress.begin(stage, total);
    let start = Instant::now();
    let result = work();
    record.add_time(stage, start.elapsed());
    progress.end(stage);
    result
}
