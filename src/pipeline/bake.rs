//! The smoke of frames as files for other programs: densities and what they carry, particles, obstacles.

use crate::error::Error;
use crate::geometry::Geometry;
use crate::grid::level_set::LevelSet;
use crate::grid::vdb::{VdbGrid, VdbWriteSettings, write_grids};
use crate::grid::{DensityGrid, GridError};
use crate::inspect::point_file::{PARTICLE_BYTES, particles_ply};
use crate::output::frames::check_distinct;
use crate::output::sidecar::Sidecar;
use crate::output::{self, file};
use crate::particles;
use crate::pipeline::assemble::build_geometry;
use crate::pipeline::frame_files::check_writable;
use crate::pipeline::heat::kelvin_of_glow;
use crate::pipeline::smoke::{Besides, FrameSmoke, SmokeSource};
use crate::pipeline::{grid_memory_limit, in_scene, parse_pattern, time_of, timed};
use crate::progress::{Progress, Stage};
use crate::scene::pattern::Pattern;
use crate::scene::settings::{VelocityUnits, VolumeGrid};
use crate::scene::{Scene, settings};
use std::path::{Path, PathBuf};

/// Name of the grid of velocities, as Houdini and Blender have it.
const VELOCITY_NAME: &str = "v";

/// What to bake.
#[derive(Debug, Clone, Default)]
pub struct BakeJob<'a> {
    /// Frames, in the order in which they are made.
    pub frames: Vec<i32>,
    /// Pattern of the files' names, instead of `output.volume`.
    pub volume: Option<&'a str>,
    /// Half precision: what is beyond ±65504 is cut.
    pub half: bool,
    /// Grids beside the density, instead of `output.volume_grids`.
    pub grids: Option<Vec<VolumeGrid>>,
    /// Unit of the velocities, instead of `output.velocity_units`.
    pub velocity_units: Option<VelocityUnits>,
    /// Pattern of the names of files for the particles, where they are wanted.
    pub particles: Option<&'a str>,
    /// Pattern of the names of files for the obstacles, where they are wanted; one file without the frame's number in it.
    pub obstacles: Option<&'a str>,
}

/// Writes the smoke of each frame; `on_frame` gets the file of each and how it came about.
///
/// # Errors
/// The first that any stage meets. Files finished before it stay.
pub fn bake(
    scene: &Scene,
    job: &BakeJob,
    progress: &dyn Progress,
    on_frame: &mut dyn FnMut(&Path, &Sidecar),
) -> Result<(), Error> {
    let files = Files::new(scene, job)?;
    let wanted = Wanted::new(scene, job)?;
    let geometry = build_geometry(scene, progress)?;
    files.check_obstacles(scene, job, &geometry)?;
    particles::wall_warnings(scene, &geometry).iter().for_each(|warning| progress.note(warning));
    let mut smoke = SmokeSource::build(scene, &geometry)?;
    if wanted.has_velocity && scene.settings.frames.shutter != [0.0; 2] {
        progress.note("densities beside velocities are those of each frame's own time, for who reads both to blur");
    }
    for (index, &frame) in job.frames.iter().enumerate() {
        progress.frame(frame, index, job.frames.len());
        let mut record = Sidecar { frame, ..Sidecar::default() };
        let made = smoke.grids(scene, frame, wanted.besides(), progress, &mut record)?.ok_or(Error::NothingToBake)?;
        let path = files.of(&files.volume, frame);
        if let (Some(pattern), Some(system)) = (&files.particles, smoke.particles()) {
            let path = files.of(pattern, frame);
            let particles = system.particles();
            let needed = made.memory_bytes() + (particles.len() * PARTICLE_BYTES) as u64;
            output::check_memory(&path, needed, grid_memory_limit(scene, particles.len()))?;
            timed(progress, Stage::Write, &mut record, 0, || {
                file::write_atomic(&path, &particles_ply(particles, |id| system.lifetime(id)))
            })?;
        }
        if let Some(pattern) = files.obstacles.as_ref().filter(|pattern| index == 0 || pattern.has_frame()) {
            let path = files.of(pattern, frame);
            timed(progress, Stage::Write, &mut record, 0, || {
                write_obstacles(scene, frame, &geometry, &made.density, wanted.settings, &path)
            })?;
        }
        timed(progress, Stage::Write, &mut record, 0, || wanted.write(made, &path))?;
        on_frame(&path, &record);
    }
    Ok(())
}

/// Where files go.
struct Files {
    scene_name: String,
    volume: Pattern,
    particles: Option<Pattern>,
    obstacles: Option<Pattern>,
}

impl Files {
    fn new(scene: &Scene, job: &BakeJob) -> Result<Self, Error> {
        let files = Self {
            scene_name: scene.name().into(),
            volume: parse_pattern(job.volume.unwrap_or(&scene.settings.output.volume))?,
            particles: job.particles.map(parse_pattern).transpose()?,
            obstacles: job.obstacles.map(parse_pattern).transpose()?,
        };
        for pattern in files.particles.iter().chain([&files.volume]) {
            check_distinct(&job.frames, |frame| files.of(pattern, frame))?;
        }
        let all = [Some(&files.volume), files.particles.as_ref(), files.obstacles.as_ref()];
        let first = job.frames.first().copied().unwrap_or_default();
        let mut names: Vec<PathBuf> = all.into_iter().flatten().map(|pattern| files.of(pattern, first)).collect();
        names.sort();
        if let Some(same) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            let problem = format!("two kinds of files would be {}; give each a name of its own", same[0].display());
            return Err(Error::Usage(problem));
        }
        check_writable(
            job.frames
                .iter()
                .map(|&frame| all.into_iter().flatten().map(move |pattern| (pattern, frame)))
                .map(|of_frame| of_frame.map(|(pattern, frame)| files.of(pattern, frame)).collect::<Vec<_>>()),
        )?;
        Ok(files)
    }

    fn of(&self, pattern: &Pattern, frame: i32) -> PathBuf {
        PathBuf::from(pattern.expand(frame, &self.scene_name))
    }

    fn check_obstacles(&self, scene: &Scene, job: &BakeJob, geometry: &Geometry) -> Result<(), Error> {
        let Some(pattern) = &self.obstacles else { return Ok(()) };
        let obstacles = &scene.settings.flow.obstacles;
        if obstacles.is_empty() {
            let problem = "--obstacles: the scene has none; name shapes in flow.obstacles, or leave it out";
            return Err(Error::NotInScene(problem.into()));
        }
        let mut shapes = geometry.shapes.iter().filter(|shape| obstacles.contains(&shape.name));
        if let Some(moving) = shapes.find(|shape| shape.motion.is_some())
            && job.frames.len() > 1
            && !pattern.has_frame()
        {
            return Err(Error::Usage(format!(
                "--obstacles: `{}` moves, and all frames would be one file; put #### in the name",
                moving.name
            )));
        }
        Ok(())
    }
}

/// What is asked for.
struct Wanted {
    has_velocity: bool,
    temperature: Option<settings::Blackbody>,
    /// Factor on velocities in m/s.
    velocity_factor: f32,
    settings: VdbWriteSettings,
}

impl Wanted {
    fn new(scene: &Scene, job: &BakeJob) -> Result<Self, Error> {
        let smoke = scene.settings.smoke.as_ref().ok_or(Error::NothingToBake)?;
        let output = &scene.settings.output;
        let grids = job.grids.as_ref().unwrap_or(&output.volume_grids);
        let from_scene = |problem: &str| {
            let problem = Error::NotInScene(problem.into());
            if job.grids.is_some() { problem } else { in_scene(scene, "output.volume_grids", None, problem) }
        };
        if smoke.file.is_some() && !grids.is_empty() {
            return Err(from_scene(
                "the smoke is read from a file, and only particles carry velocities and temperatures; bake the density alone, and \
                 take other grids from that file",
            ));
        }
        let has_temperature = grids.contains(&VolumeGrid::Temperature);
        if has_temperature && smoke.blackbody.is_none() {
            return Err(from_scene(
                "the smoke has no temperature; say in smoke.blackbody how hot its particles are, or leave the grid out",
            ));
        }
        let has_velocity = grids.contains(&VolumeGrid::Velocity);
        if job.velocity_units.is_some() && !has_velocity {
            return Err(Error::Usage("--velocity-units has no effect without velocities; add --grids velocity".into()));
        }
        if job.particles.is_some() && (smoke.file.is_some() || smoke.advect.batch.is_some()) {
            return Err(Error::NotInScene(
                "--particles: all particles of a frame are written at once; that needs smoke of particles without \
                 smoke.advect.batch"
                    .into(),
            ));
        }
        let velocity_factor = match job.velocity_units.unwrap_or(output.velocity_units) {
            VelocityUnits::Second => 1.0,
            VelocityUnits::Frame => (1.0 / scene.settings.frames.fps) as f32,
        };
        let settings = VdbWriteSettings { is_half: job.half, ..VdbWriteSettings::default() };
        let temperature = smoke.blackbody.filter(|_| has_temperature);
        Ok(Self { has_velocity, temperature, velocity_factor, settings })
    }

    fn besides(&self) -> Besides {
        Besides { heat: None, has_velocity: self.has_velocity, temperature: self.temperature }
    }

    fn write(&self, smoke: FrameSmoke, path: &Path) -> Result<(), Error> {
        let FrameSmoke { density, mut means, .. } = smoke;
        let kelvin = |heat| means.split_off(1).map(|glow| kelvin_of_glow(&heat, glow));
        let temperature = self.temperature.map(kelvin);
        let mut grids = vec![("density", VdbGrid::Density(&density))];
        if let Some(mean) = &temperature {
            grids.push(("temperature", VdbGrid::Mean { density: &density, mean, factor: 1.0 }));
        }
        if self.has_velocity {
            let velocity = VdbGrid::Mean { density: &density, mean: &means, factor: self.velocity_factor };
            grids.push((VELOCITY_NAME, velocity));
        }
        Ok(file::write_atomic(path, &write_grids(&grids, self.settings))?)
    }
}

/// The obstacles of a frame as a level set on the voxels of the density. Those without an end are cut where the others and the smoke
/// end.
fn write_obstacles(
    scene: &Scene,
    frame: i32,
    geometry: &Geometry,
    density: &DensityGrid,
    settings: VdbWriteSettings,
    path: &Path,
) -> Result<(), Error> {
    let placed = geometry.at(time_of(scene, frame));
    let obstacles = &scene.settings.flow.obstacles;
    let solids = placed.shapes.iter().filter(|shape| obstacles.contains(&shape.name));
    let solids: Vec<_> = solids.filter_map(|shape| shape.sdf.clone()).collect();
    let bounds = solids.iter().filter_map(|solid| solid.bounds()).fold(density.bounds(), |a, b| a.union(&b));
    if bounds.is_empty() {
        return Err(Error::NotInScene(format!(
            "--obstacles: at frame {frame} there is neither smoke nor an obstacle with an end, and a grid has one; leave it out"
        )));
    }
    let limit = grid_memory_limit(scene, 0).saturating_sub(density.memory_bytes());
    let distance = |p: [f64; 3]| solids.iter().map(|solid| solid.distance(p)).fold(f64::INFINITY, f64::min);
    let [low, high] = [bounds.min, bounds.max].map(|p| p.as_dvec3());
    let level_set = LevelSet::sample(density.origin(), density.voxel_size(), [low, high], limit, distance)
        .map_err(|e: GridError| in_scene(scene, "flow.obstacles", Some(frame), e))?;
    Ok(file::write_atomic(path, &write_grids(&[("surface", VdbGrid::LevelSet(&level_set))], settings))?)
}
