//! Runs the stages in order and times them; the only file that names them all.

mod mask_files;

use crate::error::Error;
use crate::flow::VelocityField;
use crate::flow::field::FieldSpan;
use crate::geometry::{Geometry, GeometryError};
use crate::grid::soft::ObstacleDistance;
use crate::grid::splat::{SplatInput, SplatSettings, splat};
use crate::grid::{DensityGrid, vdb};
use crate::inspect::Inspection;
use crate::output::film_image::{Layers, Origin, image_of_film};
use crate::output::frames::check_distinct;
use crate::output::image::SampleKind;
use crate::output::sidecar::{self, MassFigures, Sidecar, sidecar_path};
use crate::output::{self, OutputError, exr, file, png};
use crate::particles::ParticleSystem;
use crate::pipeline::mask_files::SceneFiles;
use crate::progress::{Progress, Silent, Stage};
use crate::render::environment::RadiancePicture;
use crate::render::film::{Film, PixelBounds};
use crate::render::integrator::World;
use crate::render::{self, RenderError, tiles};
use crate::scene::pattern::Pattern;
use crate::scene::settings::Aov;
use crate::scene::{Scene, footprint, settings};
use glam::DVec3;
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
    for &frame in job.frames.first().into_iter().chain(job.frames.last()) {
        let written = files.of_frame(frame);
        written.iter().chain([&sidecar_path(&written[0])]).try_for_each(|path| file::check_writable(path))?;
    }
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
    for &frame in job.frames.first().into_iter().chain(job.frames.last()) {
        file::check_writable(&file_of(frame))?;
    }
    let settings = vdb::VdbWriteSettings { is_half: job.half, ..Default::default() };
    let geometry = build_geometry(scene, progress)?;
    let mut smoke = SmokeSource::build(scene, &geometry)?;
    for (index, &frame) in job.frames.iter().enumerate() {
        progress.frame(frame, index, job.frames.len());
        let mut record = Sidecar { frame, ..Sidecar::default() };
        let grid = smoke.grid(scene, frame, progress, &mut record)?.ok_or(Error::NothingToBake)?;
        let path = file_of(frame);
        timed(progress, Stage::Write, &mut record, 0, || {
            let bytes = vdb::write_float_grids(&[("density", &grid)], settings);
            file::write_atomic(&path, &bytes)
        })?;
        on_frame(&path, &record);
    }
    Ok(())
}

/// Share of light lost with paths that are cut above which people are told.
const TRUNCATED_LIGHT_NOTED: f64 = 1e-3;

/// The flow of a scene made ready to be looked at, at a frame.
///
/// # Errors
/// Where a mesh or the file of a mask is missing, faulty or too large.
pub fn inspection(scene: &Scene, frame: i32) -> Result<Inspection, Error> {
    let geometry = Geometry::build(scene, &Silent)?;
    let field = VelocityField::build(scene, &geometry, &SceneFiles { memory_limit: memory_limit(scene) })?;
    Ok(Inspection::build(scene, frame, geometry, field))
}

/// What stays the same from frame to frame.
struct Studio {
    geometry: Geometry,
    /// Of a scene in which no shape moves.
    world: Option<World>,
    smoke: SmokeSource,
}

impl Studio {
    fn build(scene: &Scene, progress: &dyn Progress, record: &mut Sidecar) -> Result<Self, Error> {
        let start = Instant::now();
        let geometry = build_geometry(scene, progress)?;
        let world = if geometry.moves() { None } else { Some(build_world(scene, &geometry)?) };
        let smoke = SmokeSource::build(scene, &geometry)?;
        record.add_time(Stage::Geometry, start.elapsed());
        Ok(Self { geometry, world, smoke })
    }

    fn take_picture(
        &mut self,
        scene: &Scene,
        frame: i32,
        crop: Option<PixelBounds>,
        progress: &dyn Progress,
        record: &mut Sidecar,
    ) -> Result<Film, Error> {
        let grid = self.smoke.grid(scene, frame, progress, record)?;
        let medium = grid.map(|grid| render::build_medium(scene, grid)).transpose()?.flatten();
        let view = render::build_view(scene, frame, crop);
        let moved;
        let world = match &self.world {
            Some(world) => world,
            None => {
                let geometry = self.geometry.at(time_of(scene, frame));
                moved = timed(progress, Stage::Geometry, record, 0, || build_world(scene, &geometry))?;
                &moved
            }
        };
        let samples = view.bounds.area() as u64 * u64::from(view.spp);
        let film =
            timed(progress, Stage::Render, record, samples, || tiles::render(&view, world, medium.as_ref(), progress))?;
        let seconds = record.seconds.get(Stage::Render.name()).copied().unwrap_or_default();
        record.samples_per_second = samples as f64 / seconds.max(1e-9);
        let traced = film.paths.traced.max(1) as f64;
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

/// Time of a frame [s].
fn time_of(scene: &Scene, frame: i32) -> f64 {
    let frames = &scene.settings.frames;
    (f64::from(frame) - f64::from(frames.first)) / frames.fps
}

fn build_world(scene: &Scene, geometry: &Geometry) -> Result<World, RenderError> {
    render::build_world(scene, geometry, &|path| load_picture(path, memory_limit(scene)).map_err(Into::into))
}

/// Builds the shapes, which say themselves when the stage begins and ends.
fn build_geometry(scene: &Scene, progress: &dyn Progress) -> Result<Geometry, GeometryError> {
    let geometry = Geometry::build(scene, progress)?;
    geometry.warnings.iter().for_each(|warning| progress.note(warning));
    Ok(geometry)
}

/// Where the density of a frame comes from.
enum SmokeSource {
    None,
    Particles { system: Box<ParticleSystem>, splat: SplatSettings },
    File { pattern: Pattern, grid_name: String },
}

impl SmokeSource {
    fn build(scene: &Scene, geometry: &Geometry) -> Result<Self, Error> {
        let Some(smoke) = &scene.settings.smoke else { return Ok(Self::None) };
        if let Some(density) = &smoke.file {
            let pattern = parse_pattern(&density.path)?;
            return Ok(Self::File { pattern, grid_name: density.density.clone() });
        }
        let Some(grid) = &smoke.grid else { return Ok(Self::None) };
        let frames = &scene.settings.frames;
        let splat = SplatSettings {
            voxel_size: grid.voxel_size as f32,
            shutter_seconds: frames.shutter.map(|s| s / frames.fps),
            soft_radius: grid.soft_radius,
            memory_limit_bytes: grid_memory_limit(scene, 0),
        };
        let field = VelocityField::build(scene, geometry, &SceneFiles { memory_limit: memory_limit(scene) })?;
        Ok(Self::Particles { system: Box::new(ParticleSystem::build(scene, geometry, field)?), splat })
    }

    fn grid(
        &mut self,
        scene: &Scene,
        frame: i32,
        progress: &dyn Progress,
        record: &mut Sidecar,
    ) -> Result<Option<DensityGrid>, Error> {
        let grid = match self {
            Self::None => return Ok(None),
            Self::Particles { system, splat: settings } => {
                let before = [system.penetrations(), system.born_inside()];
                let start = Instant::now();
                system.at_frame(frame, progress)?;
                let particles = system.particles();
                record.add_time(Stage::Advect, start.elapsed());
                record.particles = particles.mass.len() as u64;
                let walls = FlowObstacles(system.field().span(time_of(scene, frame), 0.0));
                let has_walls = !system.field().obstacles().is_empty();
                let input = SplatInput {
                    position: particles.position.each_ref().map(Vec::as_slice),
                    velocity: particles.velocity.each_ref().map(Vec::as_slice),
                    mass: &particles.mass,
                    radius: &particles.radius,
                    obstacles: has_walls.then_some(&walls),
                };
                let count = particles.mass.len();
                let settings = SplatSettings { memory_limit_bytes: grid_memory_limit(scene, count), ..*settings };
                let splat = timed(progress, Stage::Grid, record, 0, || splat(&input, &settings))?;
                let m = splat.mass;
                record.mass = MassFigures { particles: m.particles, grid: m.grid, faded: m.faded, lost: m.lost };
                record.penetrations = system.penetrations() - before[0];
                record.born_inside = system.born_inside() - before[1];
                splat.grid
            }
            Self::File { pattern, grid_name } => {
                let path = scene.resolve(&pattern.expand(frame, scene.name()));
                timed(progress, Stage::Grid, record, 0, || {
                    vdb::read_float_grid(&path, grid_name, grid_memory_limit(scene, 0))
                })?
            }
        };
        record.grid.active_voxels = grid.active_voxel_count();
        record.grid.bytes = grid.memory_bytes();
        Ok(Some(grid))
    }
}

/// The obstacles of the flow as splatting asks for them: the one place where the two meet.
#[derive(Debug)]
struct FlowObstacles<'a>(FieldSpan<'a>);

impl ObstacleDistance for FlowObstacles<'_> {
    fn distances(&self, points: &[DVec3], distances: &mut [f64]) {
        for (point, distance) in points.iter().zip(distances) {
            *distance = self.0.distance(point.to_array(), 0.0);
        }
    }
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
    let mut written = Vec::new();
    let start = Instant::now();
    progress.begin(Stage::Write, 0);
    let preview =
        files.preview(record.frame).map(|path| Ok::<_, Error>((path, encode_preview(&film, &settings.output)?)));
    let image = image_of_film(&film, layers(&settings.output.aovs), SampleKind::Half, &origin);
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
    record.host = sidecar::this_host(rayon::current_num_threads());
    // Last: where it stands, the frame is whole.
    record.write(sidecar_file)?;
    on_frame(&FrameOutcome::Made(Box::new(record)));
    Ok(())
}

fn encode_preview(film: &Film, output: &settings::Output) -> Result<Vec<u8>, OutputError> {
    let rgb: Vec<[f32; 3]> = film.pixels.iter().map(|p| p.mean.to_array()).collect();
    png::encode(&rgb, [film.bounds.width(), film.bounds.height()], output.view.into(), output.exposure_ev)
}

/// Hash of everything that all frames depend on.
struct InputHash {
    settings: Vec<u8>,
    files: String,
}

impl InputHash {
    fn new(scene: &Scene, crop: Option<PixelBounds>) -> Result<Self, Error> {
        let mut settings = scene.settings.clone();
        // What changes no pixel of a frame must not make it stale.
        settings.frames.last = settings.frames.first;
        settings.output.image.clear();
        settings.output.volume.clear();
        // That there is a preview matters, its name does not.
        settings.output.preview = settings.output.preview.map(|_| String::new());
        settings.render.memory_limit_gib = 0.0;
        let mut files = Vec::new();
        for shape in settings.shapes.values() {
            files.extend(shape.mesh.as_ref().map(|m| scene.resolve(&m.file)));
        }
        for light in &settings.lights {
            if let settings::Light::Environment(e) = light {
                files.extend(e.file.as_ref().map(|f| scene.resolve(f)));
            }
        }
        for mask in settings.flow.potentials.iter().flat_map(settings::Potential::masks) {
            match mask {
                settings::Mask::Image(mask) => files.push(scene.resolve(&mask.file)),
                settings::Mask::Grid(mask) => files.push(scene.resolve(&mask.file)),
                _ => {}
            }
        }
        let hashes = files.iter().map(|path| file_hash(path)).collect::<Result<Vec<_>, _>>()?;
        let mut text = serde_json::to_vec(&settings).map_err(|e| Error::Internal(e.to_string()))?;
        text.extend(format!("{crop:?}").bytes());
        Ok(Self { settings: text, files: hashes.concat() })
    }

    fn fingerprint(&self, scene: &Scene, frame: i32) -> Result<String, Error> {
        let mut volume = String::new();
        if let Some(density) = scene.settings.smoke.as_ref().and_then(|s| s.file.as_ref()) {
            let path = scene.resolve(&parse_pattern(&density.path)?.expand(frame, scene.name()));
            volume = file_hash(&path)?;
        }
        let version = env!("CARGO_PKG_VERSION");
        let parts =
            [version.as_bytes(), &self.settings, self.files.as_bytes(), volume.as_bytes(), &frame.to_le_bytes()];
        Ok(sidecar::fingerprint(&parts))
    }
}

fn file_hash(path: &Path) -> Result<String, Error> {
    Ok(sidecar::sha256_of_file(path)?)
}

fn parse_pattern(text: &str) -> Result<Pattern, Error> {
    Pattern::parse(text).map_err(|e| Error::Pattern(text.into(), e))
}

fn memory_limit(scene: &Scene) -> u64 {
    (scene.settings.render.memory_limit_gib * f64::from(1 << 30)) as u64
}

/// Memory that the grid of a frame may take beside the picture and `particle_count` particles [bytes].
fn grid_memory_limit(scene: &Scene, particle_count: usize) -> u64 {
    let others = footprint::film_bytes(&scene.settings.film) + particle_count as f64 * footprint::PARTICLE_BYTES;
    memory_limit(scene).saturating_sub(others as u64)
}

fn load_picture(path: &Path, memory_limit: u64) -> Result<RadiancePicture, OutputError> {
    let image = output::read_image(path, memory_limit)?;
    let rgb = image.to_rgb("").ok_or_else(|| OutputError::Invalid {
        path: path.into(),
        format: "picture",
        problem: "it has no channels R, G and B".into(),
    })?;
    let [width, height] = image.data_size.map(|n| n as usize);
    Ok(RadiancePicture { width, height, pixels: rgb.into_iter().map(glam::Vec3::from).collect() })
}

fn layers(aovs: &[Aov]) -> Layers {
    Layers {
        depth: aovs.contains(&Aov::Depth),
        normal: aovs.contains(&Aov::Normal),
        albedo: aovs.contains(&Aov::Albedo),
        variance: aovs.contains(&Aov::Variance),
    }
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
