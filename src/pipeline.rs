//! Runs the stages in order and times them; the only file that names them all.

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
pub mod turntable;
mod volumes;
pub mod wedge;

pub use crate::pipeline::bake::{BakeJob, bake};

use crate::error::Error;
use crate::flow::Flow;
use crate::geometry::moment::Shutter;
use crate::geometry::{Geometry, GeometryError};
use crate::inspect::Inspection;
use crate::output::frames::check_distinct;
use crate::output::sidecar::Sidecar;
use crate::output::{self, OutputError};
use crate::particles::ParticleSystem;
use crate::pipeline::fingerprint::InputHash;
use crate::pipeline::frame_files::{OutputFiles, check_writable, finish_of, write_part, write_picture};
use crate::pipeline::heat::Heat;
use crate::pipeline::keeper::Keeper;
use crate::pipeline::mask_files::SceneFiles;
use crate::pipeline::smoke::{FrameSmoke, SmokeSource};
use crate::pipeline::volumes::VolumeSources;
use crate::progress::{Progress, Silent, Stage};
use crate::render::film::{Film, PathCounts, PixelBounds};
use crate::render::layers::Layer;
use crate::render::ledger::Ledger;
use crate::render::material::Material;
use crate::render::media::Media;
use crate::render::medium::Medium;
use crate::render::motion::FrameMotion;
use crate::render::picture::Picture;
use crate::render::sun_shadow;
use crate::render::tiles::View;
use crate::render::world::World;
use crate::render::{self, RenderError, TextureStore, tiles};
use crate::scene::pattern::Pattern;
use crate::scene::{Scene, footprint, settings};
use std::path::{Path, PathBuf};
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
    let inputs = InputHash::new(scene, job.crop)?;
    let mut studio: Option<Studio> = None;
    for (index, &frame) in job.frames.iter().enumerate() {
        progress.frame(frame, index, job.frames.len());
        let fingerprint = inputs.fingerprint(scene, frame)?;
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
    let inputs = InputHash::new(scene, job.crop)?;
    let mut missing = Vec::new();
    for &frame in &job.frames {
        if !files.is_complete(frame, &inputs.fingerprint(scene, frame)?) {
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

/// Share of light lost with paths that are cut above which people are told.
const TRUNCATED_LIGHT_NOTED: f64 = 1e-3;

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
    let (first, last) = (scene.settings.frames.first, scene.settings.frames.last);
    let frames: Vec<i32> = (first..=last).collect();
    check_camera(scene, &frames)?;
    check_lights(scene, &frames)?;
    render::build_lights(scene, 0.0, &|path| load_picture(path, memory_limit(scene)).map_err(Into::into))
        .map_err(|e| in_render(scene, e))?;
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

/// What stays the same from frame to frame.
struct Studio {
    geometry: Geometry,
    /// Of a scene in which no shape and no light moves; each frame brings its materials.
    world: Option<World>,
    textures: TextureStore,
    smoke: SmokeSource,
    volumes: VolumeSources,
}

impl Studio {
    fn build(scene: &Scene, progress: &dyn Progress, record: &mut Sidecar) -> Result<Self, Error> {
        let start = Instant::now();
        let geometry = build_geometry(scene, progress)?;
        geometry.camera_warning(scene).iter().for_each(|warning| progress.note(warning));
        let mut textures = load_textures(scene)?;
        let world = if geometry.moves() || scene.settings.lights.iter().any(settings::Light::varies) {
            None
        } else {
            // Whether a shape shines the same everywhere, and so is a light, does not change with time.
            let materials = render::build_materials(scene, &geometry, &mut textures, 0.0);
            Some(build_world(scene, &geometry, materials, 0.0)?)
        };
        let smoke = SmokeSource::build(scene, &geometry)?;
        let volumes = VolumeSources::build(scene, &geometry)?;
        record.add_time(Stage::Geometry, start.elapsed());
        Ok(Self { geometry, world, textures, smoke, volumes })
    }

    /// Fills the ledger; how many paths a pixel has at most.
    fn take_picture(
        &mut self,
        scene: &Scene,
        view: &View,
        frame: i32,
        ledger: &Ledger,
        progress: &dyn Progress,
        record: &mut Sidecar,
    ) -> Result<u32, Error> {
        let grid = self.smoke.grid(scene, frame, smoke_heat(scene), progress, record)?;
        let start = Instant::now();
        let medium = grid.map(|smoke| build_medium(scene, frame, smoke)).transpose()?.flatten();
        record.add_time(Stage::Grid, start.elapsed());
        let volumes = self.volumes.at_frame(scene, &self.geometry, frame, progress, record)?;
        let media = Media::new(medium.as_ref(), &volumes);
        let moved;
        let time = time_of(scene, frame);
        let shutter = shutter_of(scene, &self.geometry, time);
        let world = match &mut self.world {
            Some(world) => {
                world.materials = render::build_materials(scene, &self.geometry, &mut self.textures, time);
                world
            }
            None => {
                let geometry = self.geometry.at_shutter(&shutter);
                let materials = render::build_materials(scene, &geometry, &mut self.textures, time);
                let build = || build_world(scene, &geometry, materials, time);
                moved = timed(progress, Stage::Geometry, record, 0, build)?;
                &moved
            }
        };
        let mut view = view.clone();
        render::take_time(&mut view, scene, shutter);
        let motion =
            view.layers.contains(&Layer::Motion).then(|| frame_motion(scene, &self.geometry, &self.smoke, time));
        trace(&view, world, media, motion.as_ref(), frame, ledger, progress, record)
    }
}

/// Built for the first picture, so that a run with nothing to do ends at once.
impl Photographer for Option<Studio> {
    fn take_picture(
        &mut self,
        scene: &Scene,
        view: &View,
        frame: i32,
        ledger: &Ledger,
        progress: &dyn Progress,
        record: &mut Sidecar,
    ) -> Result<u32, Error> {
        let studio = match self {
            Some(studio) => studio,
            none => none.insert(Studio::build(scene, progress, record)?),
        };
        studio.take_picture(scene, view, frame, ledger, progress, record)
    }
}

/// Traces the light of a frame into the ledger and notes how that went; how many paths a pixel has at most.
#[allow(clippy::too_many_arguments)]
fn trace(
    view: &View,
    world: &World,
    media: Media,
    motion: Option<&FrameMotion>,
    frame: i32,
    ledger: &Ledger,
    progress: &dyn Progress,
    record: &mut Sidecar,
) -> Result<u32, Error> {
    let paths = ledger.samples.as_ref().map_or(view.spp as usize, ExactSizeIterator::len);
    let most = view.bounds.area() as u64 * paths as u64;
    let resumed: u64 = ledger.tiles().iter().flatten().map(|tile| tile.counts.traced).sum();
    let spp = timed(progress, Stage::Render, record, most, || {
        tiles::render_to(ledger, view, world, media, motion, progress)
    })?;
    let mut paths = PathCounts::default();
    ledger.tiles().iter().flatten().for_each(|tile| paths.add(&tile.counts));
    let seconds = record.seconds.get(Stage::Render.name()).copied().unwrap_or_default();
    let traced = paths.traced.max(1) as f64;
    record.samples_per_second = (paths.traced - resumed) as f64 / seconds.max(1e-9);
    record.truncated_paths = paths.truncated as f64 / traced;
    record.truncated_light = paths.truncated_throughput / traced;
    if record.truncated_light > TRUNCATED_LIGHT_NOTED {
        progress.note(&format!(
            "frame {frame}: paths cut at render.max_bounces = {} still carried {:.2} % of the light; raise it for an \
             unbiased picture",
            view.limits.max_bounces,
            100.0 * record.truncated_light
        ));
    }
    Ok(spp)
}

/// How shapes move while the shutter of a frame is open.
fn shutter_of(scene: &Scene, geometry: &Geometry, time: f64) -> Shutter {
    let frames = &scene.settings.frames;
    geometry.shutter(time, frames.shutter.map(|share| time + share / frames.fps))
}

/// How all things move from the frame at `time` [s] to the next.
fn frame_motion<'a>(scene: &Scene, geometry: &'a Geometry, smoke: &'a SmokeSource, time: f64) -> FrameMotion<'a> {
    let seconds = scene.settings.frames.fps.recip();
    let course = render::camera_course(scene);
    let mut motion = FrameMotion::new(geometry, smoke.flow().map(|flow| flow.span(time, seconds)), time, seconds);
    motion.next_camera = if course.varies() { course.at(time + seconds).ok() } else { None };
    motion
}

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

/// The smoke of a frame as light sees it.
fn build_medium(scene: &Scene, frame: i32, smoke: FrameSmoke) -> Result<Option<Medium>, Error> {
    let build = || {
        let mut medium = render::build_medium(scene, smoke.density)?;
        if let (Some(medium), Some(glow)) = (&mut medium, smoke.glow) {
            render::kindle(medium, glow, smoke.is_unbound)?;
        }
        let detail = scene.settings.smoke.as_ref().and_then(|smoke| smoke.detail);
        if let (Some(medium), Some(detail)) = (&mut medium, detail) {
            render::add_detail(medium, &detail, time_of(scene, frame))?;
        }
        Ok(medium)
    };
    build().map_err(|e: RenderError| {
        let key = match e {
            RenderError::TooHot { .. } if smoke_heat(scene).is_some() => "smoke.blackbody",
            RenderError::TooHot { .. } => "smoke.file.emission_gain",
            RenderError::TooDenseForDetail { .. } => "smoke.detail",
            _ => "smoke.medium.extinction",
        };
        in_scene(scene, key, Some(frame), e)
    })
}

/// What the smoke of a scene gives off because it is hot.
fn smoke_heat(scene: &Scene) -> Option<Heat> {
    scene.settings.smoke.as_ref().and_then(|smoke| Heat::new(smoke.blackbody, &smoke.medium))
}

/// Time of a frame [s].
fn time_of(scene: &Scene, frame: i32) -> f64 {
    scene.settings.frames.time(f64::from(frame))
}

fn build_world(scene: &Scene, geometry: &Geometry, materials: Vec<Material>, time: f64) -> Result<World, Error> {
    let load = |path: &Path| load_picture(path, memory_limit(scene)).map_err(Into::into);
    render::build_world_at(scene, geometry, materials, time, &load).map_err(|e| in_render(scene, e))
}

fn load_textures(scene: &Scene) -> Result<TextureStore, Error> {
    TextureStore::load(scene, &|path| load_picture(path, memory_limit(scene)).map_err(Into::into))
        .map_err(|e| in_render(scene, e))
}

/// An error of surfaces and lights, with its place in the scene where a light or a texture is at fault.
fn in_render(scene: &Scene, error: RenderError) -> Error {
    match error {
        RenderError::Texture { ref key, .. } => {
            let key = key.clone();
            in_scene(scene, &key, None, error)
        }
        RenderError::Light { light_idx, .. } => {
            let is_picture = matches!(scene.settings.lights.get(light_idx), Some(settings::Light::Environment(_)));
            let part = if is_picture { ".environment.file" } else { "" };
            in_scene(scene, &format!("lights[{light_idx}]{part}"), None, error)
        }
        _ => error.into(),
    }
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

/// Builds the shapes, which say themselves when the stage begins and ends.
fn build_geometry(scene: &Scene, progress: &dyn Progress) -> Result<Geometry, GeometryError> {
    let geometry = Geometry::build(scene, progress)?;
    geometry.warnings.iter().for_each(|warning| progress.note(warning));
    Ok(geometry)
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

fn load_picture(path: &Path, memory_limit: u64) -> Result<Picture, OutputError> {
    let image = output::read_image(path, memory_limit)?;
    let rgb = image.to_rgb("").ok_or_else(|| OutputError::Invalid {
        path: path.into(),
        format: "picture",
        problem: "it has no channels R, G and B".into(),
    })?;
    let [width, height] = image.data_size.map(|n| n as usize);
    Ok(Picture { width, height, pixels: rgb.into_iter().map(glam::Vec3::from).collect() })
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
