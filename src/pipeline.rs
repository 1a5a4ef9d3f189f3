//! Runs the stages in order and times them; the only file that names them all.

mod fingerprint;
mod heat;
pub mod inputs;
pub mod live;
mod mask_files;
mod smoke;
pub mod turntable;
mod volumes;

use crate::error::Error;
use crate::flow::Flow;
use crate::geometry::{Geometry, GeometryError};
use crate::grid::vdb;
use crate::inspect::Inspection;
use crate::math::parallel;
use crate::output::film_image::{Origin, image_of_film};
use crate::output::frames::check_distinct;
use crate::output::image::SampleKind;
use crate::output::sidecar::{self, Sidecar, sidecar_path};
use crate::output::{self, OutputError, exr, file, png};
use crate::particles::ParticleSystem;
use crate::pipeline::fingerprint::InputHash;
use crate::pipeline::heat::Heat;
use crate::pipeline::mask_files::SceneFiles;
use crate::pipeline::smoke::{FrameSmoke, SmokeSource};
use crate::pipeline::volumes::VolumeSources;
use crate::progress::{Progress, Silent, Stage};
use crate::render::film::{Film, PixelBounds};
use crate::render::layers::Layer;
use crate::render::material::Material;
use crate::render::media::Media;
use crate::render::medium::Medium;
use crate::render::motion::FrameMotion;
use crate::render::picture::Picture;
use crate::render::sun_shadow;
use crate::render::world::World;
use crate::render::{self, RenderError, TextureStore, tiles};
use crate::scene::pattern::Pattern;
use crate::scene::{Scene, footprint, settings};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What to render.
#[derive(Debug, Clone)]
pub struct RenderJob {
    /// Frames, in the order in which they are made.
    pub frames: Vec<i32>,
    /// The part of the picture to render; all of it where `None`.
    pub crop: Option<PixelBounds>,
    /// Leave frames alone that are whole and made from this very scene.
    pub resume: bool,
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
    Made(Box<Sidecar>),
}

/// Renders frames and writes their files; calls `on_frame` after each.
///
/// # Errors
/// The first that any stage meets. Frames finished before it stay.
pub fn render(
    scene: &Scene,
    job: &RenderJob,
    progress: &dyn Progress,
    on_frame: &mut dyn FnMut(&FrameOutcome),
) -> Result<(), Error> {
    let files = OutputFiles::new(scene)?;
    check_distinct(&job.frames, |frame| files.image(frame))?;
    let all_files = job.frames.iter().map(|&frame| {
        let files = files.of_frame(frame);
        let sidecar = sidecar_path(&files[0]);
        files.into_iter().chain([sidecar])
    });
    check_writable(all_files)?;
    let inputs = InputHash::new(scene, job.crop)?;
    let mut studio: Option<Studio> = None;
    for (index, &frame) in job.frames.iter().enumerate() {
        progress.frame(frame, index, job.frames.len());
        let sidecar_file = sidecar_path(&files.image(frame));
        let fingerprint = inputs.fingerprint(scene, frame)?;
        if job.resume && sidecar::is_complete(&sidecar_file, &fingerprint, &files.of_frame(frame)) {
            on_frame(&FrameOutcome::Kept { frame });
            continue;
        }
        let mut record = Sidecar {
            frame,
            fingerprint,
            version: env!("CARGO_PKG_VERSION").into(),
            spp: scene.settings.film.spp,
            ..Sidecar::default()
        };
        // Built for the first frame that is made, so that a run with nothing to do ends at once.
        let studio = match &mut studio {
            Some(studio) => studio,
            none => none.insert(Studio::build(scene, progress, &mut record)?),
        };
        let film = studio.take_picture(scene, frame, job.crop, progress, &mut record)?;
        write_frame(scene, &files, film, &sidecar_file, progress, record, on_frame)?;
    }
    Ok(())
}

/// The light of one frame: what [`render`] writes, for whoever goes on with it in memory.
///
/// # Errors
/// The first that any stage meets.
pub fn film(scene: &Scene, frame: i32, crop: Option<PixelBounds>, progress: &dyn Progress) -> Result<Film, Error> {
    let mut record = Sidecar::default();
    Studio::build(scene, progress, &mut record)?.take_picture(scene, frame, crop, progress, &mut record)
}

/// What to bake.
#[derive(Debug, Clone)]
pub struct BakeJob<'a> {
    /// Frames, in the order in which they are made.
    pub frames: Vec<i32>,
    /// Pattern of the files' names, instead of `output.volume`.
    pub volume: Option<&'a str>,
    /// Half precision: densities above 65504 are cut.
    pub half: bool,
}

/// Writes the density of each frame as a .vdb file; `on_frame` gets the file of each and how it came about.
///
/// # Errors
/// The first that any stage meets. Files finished before it stay.
pub fn bake(
    scene: &Scene,
    job: &BakeJob,
    progress: &dyn Progress,
    on_frame: &mut dyn FnMut(&Path, &Sidecar),
) -> Result<(), Error> {
    let pattern = parse_pattern(job.volume.unwrap_or(&scene.settings.output.volume))?;
    let file_of = |frame: i32| PathBuf::from(pattern.expand(frame, scene.name()));
    check_distinct(&job.frames, file_of)?;
    check_writable(job.frames.iter().map(|&frame| [file_of(frame)]))?;
    let settings = vdb::VdbWriteSettings { is_half: job.half, ..Default::default() };
    let geometry = build_geometry(scene, progress)?;
    let mut smoke = SmokeSource::build(scene, &geometry)?;
    for (index, &frame) in job.frames.iter().enumerate() {
        progress.frame(frame, index, job.frames.len());
        let mut record = Sidecar { frame, ..Sidecar::default() };
        let grid = smoke.grid(scene, frame, None, progress, &mut record)?.ok_or(Error::NothingToBake)?.density;
        let path = file_of(frame);
        timed(progress, Stage::Write, &mut record, 0, || {
            let bytes = vdb::write_float_grids(&[("density", &grid)], settings);
            file::write_atomic(&path, &bytes)
        })?;
        on_frame(&path, &record);
    }
    Ok(())
}

/// Largest number of half precision.
const HALF_MAX: f32 = 65504.0;

/// Share of light lost with paths that are cut above which people are told.
const TRUNCATED_LIGHT_NOTED: f64 = 1e-3;

/// The flow of a scene made ready to be looked at, at a frame.
///
/// # Errors
/// Where a mesh or the file of a mask is missing, faulty or too large.
pub fn inspection(scene: &Scene, frame: i32) -> Result<Inspection, Error> {
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
    render::build_lights(scene, &|path| load_picture(path, memory_limit(scene)).map_err(Into::into))
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
    /// Of a scene in which no shape moves; each frame brings its materials.
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
        let world = if geometry.moves() {
            None
        } else {
            // Whether a shape shines the same everywhere, and so is a light, does not change with time.
            let materials = render::build_materials(scene, &geometry, &mut textures, 0.0);
            Some(build_world(scene, &geometry, materials)?)
        };
        let smoke = SmokeSource::build(scene, &geometry)?;
        let volumes = VolumeSources::build(scene, &geometry)?;
        record.add_time(Stage::Geometry, start.elapsed());
        Ok(Self { geometry, world, textures, smoke, volumes })
    }

    fn take_picture(
        &mut self,
        scene: &Scene,
        frame: i32,
        crop: Option<PixelBounds>,
        progress: &dyn Progress,
        record: &mut Sidecar,
    ) -> Result<Film, Error> {
        let grid = self.smoke.grid(scene, frame, smoke_heat(scene), progress, record)?;
        let start = Instant::now();
        let medium = grid.map(|smoke| build_medium(scene, frame, smoke)).transpose()?.flatten();
        record.add_time(Stage::Grid, start.elapsed());
        let volumes = self.volumes.at_frame(scene, &self.geometry, frame, progress, record)?;
        let media = Media::new(medium.as_ref(), &volumes);
        let view = render::build_view(scene, frame, crop);
        let moved;
        let time = time_of(scene, frame);
        let world = match &mut self.world {
            Some(world) => {
                world.materials = render::build_materials(scene, &self.geometry, &mut self.textures, time);
                world
            }
            None => {
                let geometry = self.geometry.at(time);
                let materials = render::build_materials(scene, &geometry, &mut self.textures, time);
                moved = timed(progress, Stage::Geometry, record, 0, || build_world(scene, &geometry, materials))?;
                &moved
            }
        };
        let most = view.bounds.area() as u64 * u64::from(view.spp);
        let motion = view.layers.contains(&Layer::Motion).then(|| {
            let seconds = scene.settings.frames.fps.recip();
            FrameMotion::new(&self.geometry, self.smoke.flow().map(|flow| flow.span(time, seconds)), time, seconds)
        });
        let film = timed(progress, Stage::Render, record, most, || {
            tiles::render_media(&view, world, media, motion.as_ref(), progress)
        })?;
        let seconds = record.seconds.get(Stage::Render.name()).copied().unwrap_or_default();
        let traced = film.paths.traced.max(1) as f64;
        record.samples_per_second = traced / seconds.max(1e-9);
        record.spp = film.spp;
        record.truncated_paths = film.paths.truncated as f64 / traced;
        record.truncated_light = film.paths.truncated_throughput / traced;
        if record.truncated_light > TRUNCATED_LIGHT_NOTED {
            progress.note(&format!(
                "frame {frame}: paths cut at render.max_bounces = {} still carried {:.2} % of the light; raise it for an \
                 unbiased picture",
                view.limits.max_bounces,
                100.0 * record.truncated_light
            ));
        }
        Ok(film)
    }
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
    let frames = &scene.settings.frames;
    (f64::from(frame) - f64::from(frames.first)) / frames.fps
}

fn build_world(scene: &Scene, geometry: &Geometry, materials: Vec<Material>) -> Result<World, Error> {
    render::build_world(scene, geometry, materials, &|path| load_picture(path, memory_limit(scene)).map_err(Into::into))
        .map_err(|e| in_render(scene, e))
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
            in_scene(scene, &format!("lights[{light_idx}].environment.file"), None, error)
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

/// Makes sure that a sequence can be written, from the files of each frame: the first and the last are tried, and none
/// may be the name of a folder.
fn check_writable<F>(frames: impl ExactSizeIterator<Item = F>) -> Result<(), OutputError>
where
    F: IntoIterator<Item = PathBuf>,
{
    let last = frames.len().saturating_sub(1);
    for (i, files) in frames.enumerate() {
        let is_tried = i == 0 || i == last;
        files
            .into_iter()
            .try_for_each(|path| if is_tried { file::check_writable(&path) } else { file::check_no_folder(&path) })?;
    }
    Ok(())
}

/// Names of a sequence's files.
struct OutputFiles {
    image: Pattern,
    preview: Option<Pattern>,
    scene_name: String,
}

impl OutputFiles {
    fn new(scene: &Scene) -> Result<Self, Error> {
        let output = &scene.settings.output;
        Ok(Self {
            image: parse_pattern(&output.image)?,
            preview: output.preview.as_deref().map(parse_pattern).transpose()?,
            scene_name: scene.name().into(),
        })
    }

    fn image(&self, frame: i32) -> PathBuf {
        self.image.expand(frame, &self.scene_name).into()
    }

    fn preview(&self, frame: i32) -> Option<PathBuf> {
        self.preview.as_ref().map(|p| p.expand(frame, &self.scene_name).into())
    }

    /// All files of a frame but the sidecar, the picture first.
    fn of_frame(&self, frame: i32) -> Vec<PathBuf> {
        [self.image(frame)].into_iter().chain(self.preview(frame)).collect()
    }
}

fn write_frame(
    scene: &Scene,
    files: &OutputFiles,
    film: Film,
    sidecar_file: &Path,
    progress: &dyn Progress,
    mut record: Sidecar,
    on_frame: &mut dyn FnMut(&FrameOutcome),
) -> Result<(), Error> {
    let settings = &scene.settings;
    let origin = Origin {
        scene_hash: record.fingerprint.clone(),
        seed: settings.render.seed,
        frame: record.frame,
        fps: settings.frames.fps,
        shutter: settings.frames.shutter,
        camera: render::build_view(scene, record.frame, None).camera,
    };
    let cut = film.pixels.iter().filter(|pixel| pixel.mean.max_element() > HALF_MAX).count();
    if cut > 0 {
        progress.note(&format!(
            "frame {}: {cut} pixels are brighter than {HALF_MAX} W/(m² sr), the most that the picture's half precision holds, and \
             are cut there; dim the lights that are seen, or hide them with `visible: false`",
            record.frame
        ));
    }
    let mut written = Vec::new();
    let start = Instant::now();
    progress.begin(Stage::Write, 0);
    let preview =
        files.preview(record.frame).map(|path| Ok::<_, Error>((path, encode_preview(&film, &settings.output)?)));
    let image = image_of_film(&film, SampleKind::Half, &origin);
    // The picture takes as much again, and the encoder more.
    drop(film);
    written.push((files.image(record.frame), exr::write(&image, settings.output.compression.into())?));
    drop(image);
    written.extend(preview.transpose()?);
    for (path, bytes) in &written {
        file::write_atomic(path, bytes)?;
        record.add_file(sidecar_file, path, bytes);
    }
    progress.end(Stage::Write);
    record.add_time(Stage::Write, start.elapsed());
    record.memory_peak = sidecar::memory_peak();
    record.host = sidecar::this_host(parallel::thread_count());
    // Last: where it stands, the frame is whole.
    record.write(sidecar_file)?;
    on_frame(&FrameOutcome::Made(Box::new(record)));
    Ok(())
}

fn encode_preview(film: &Film, output: &settings::Output) -> Result<Vec<u8>, OutputError> {
    let rgb: Vec<[f32; 3]> = film.pixels.iter().map(|p| p.mean.to_array()).collect();
    png::encode(&rgb, [film.bounds.width(), film.bounds.height()], output.view.into(), output.exposure_ev)
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
    let others = footprint::film_bytes(settings) + particle_count as f64 * footprint::PARTICLE_BYTES;
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
