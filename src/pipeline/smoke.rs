//! Where the density of a frame comes from: particles carried by the flow and splatted, or a file.

use crate::error::Error;
use crate::flow::Flow;
use crate::flow::field::FieldSpan;
use crate::geometry::Geometry;
use crate::grid::drift::{self, VelocityGrid};
use crate::grid::means::MeanGrid;
use crate::grid::soft::ObstacleDistance;
use crate::grid::splat::{Splat, SplatInput, SplatSettings, SplatSum};
use crate::grid::{DensityGrid, GridError, vdb};
use crate::output::sidecar::{MassFigures, Sidecar};
use crate::particles::system::Way;
use crate::particles::{ParticleSystem, Particles, ParticlesError};
use crate::pipeline::heat::{self, Heat};
use crate::pipeline::{BORN_INSIDE_NOTED, build_flow, grid_memory_limit, in_scene, parse_pattern, time_of, timed};
use crate::progress::{Progress, Stage};
use crate::scene::footprint;
use crate::scene::pattern::Pattern;
use crate::scene::{Scene, settings};
use glam::DVec3;
use std::path::Path;
use std::time::{Duration, Instant};

/// The smoke of a frame.
pub(super) struct FrameSmoke {
    pub(super) density: DensityGrid,
    /// Light that it gives off because it is hot, or as a file says [W/(m³ sr)].
    pub(super) glow: Option<[DensityGrid; 3]>,
    /// Whether there may be such light where there is no density.
    pub(super) is_unbound: bool,
    /// What its particles carry, as was asked for: velocities first, then light by temperature.
    pub(super) means: MeanGrid,
}

/// What is made of particles besides their density.
#[derive(Default)]
pub(super) struct Besides {
    /// Light, of hot ones.
    pub(super) heat: Option<Heat>,
    /// The mean of their velocities [m/s]; the density is then that of the frame's own time.
    pub(super) has_velocity: bool,
    /// The mean of their light, from which `heat::kelvin_of_glow` finds a temperature.
    pub(super) temperature: Option<settings::Blackbody>,
}

impl FrameSmoke {
    /// With other densities.
    pub(super) fn remapped(self, remap: Option<settings::Remap>) -> Self {
        match remap {
            Some(remap) => Self { density: self.density.map(|density| remap.apply(density)), ..self },
            None => self,
        }
    }

    /// Memory of its grids [bytes].
    pub(super) fn memory_bytes(&self) -> u64 {
        self.glow.iter().flatten().chain([&self.density]).map(DensityGrid::memory_bytes).sum()
    }
}

/// Where the density of a frame comes from.
pub(super) enum SmokeSource {
    None,
    Particles {
        system: Box<ParticleSystem>,
        splat: SplatSettings,
        /// Whether it was said that most particles are born inside obstacles.
        is_told: bool,
    },
    File(DensityFiles),
}

/// A sequence of .vdb files.
pub(super) struct DensityFiles {
    pattern: Pattern,
    settings: settings::DensityFile,
}

impl DensityFiles {
    pub(super) fn new(settings: &settings::DensityFile) -> Result<Self, Error> {
        Ok(Self { pattern: parse_pattern(&settings.path)?, settings: settings.clone() })
    }

    /// The file of a frame within `limit` bytes of memory; `key` is where the scene has it, `smoke` or a volume.
    #[allow(clippy::too_many_arguments)]
    pub(super) fn read(
        &self,
        scene: &Scene,
        frame: i32,
        heat: Option<&Heat>,
        key: &str,
        limit: u64,
        progress: &dyn Progress,
        record: &mut Sidecar,
    ) -> Result<FrameSmoke, Error> {
        let path = scene.resolve(&self.pattern.expand(frame, scene.name()));
        // Of hot smoke five grids share it, and the bricks of two while the light is made.
        let limit = limit / if heat.is_some() { 7 } else { 1 };
        let read = |name: &str| vdb::read_float_grid(&path, name, limit);
        let density = timed(progress, Stage::Grid, record, 0, || read(&self.settings.density))
            .map_err(|e| in_scene(scene, &format!("{key}.file.path"), Some(frame), e))?;
        let (file_key, key) = (format!("{key}.file"), format!("{key}.blackbody"));
        let glow = match (heat, &self.settings.emission) {
            (None, None) => None,
            (None, Some(name)) => {
                let left = limit.saturating_sub(density.memory_bytes());
                let grids = vdb::read_color_grid(&path, name, left)
                    .map_err(|e| in_scene(scene, &format!("{file_key}.emission"), Some(frame), e))?;
                let gain = self.settings.emission_gain as f32;
                Some(if gain == 1.0 { grids } else { grids.map(|grid| grid.map(|light| gain * light)) })
            }
            (Some(heat), _) => {
                let temperature =
                    read(&self.settings.temperature).map_err(|e| in_scene(scene, &key, Some(frame), e))?;
                let glow = heat.of_grids(&density, &temperature, limit);
                Some(glow.map_err(|e| in_scene(scene, &key, Some(frame), e))?)
            }
        };
        let smoke = FrameSmoke { density, glow, is_unbound: heat.is_none(), means: MeanGrid::default() };
        let frames = &scene.settings.frames;
        match &self.settings.velocity {
            Some(name) if frames.shutter != [0.0; 2] => {
                let left = limit.saturating_sub(smoke.memory_bytes());
                timed(progress, Stage::Grid, record, 0, || self.blurred(smoke, &path, name, frames, left, progress))
                    .map_err(|e| in_scene(scene, &format!("{file_key}.velocity"), Some(frame), e))
            }
            _ => Ok(smoke),
        }
    }

    /// The mean of smoke over the shutter, by the velocities of its file.
    fn blurred(
        &self,
        smoke: FrameSmoke,
        path: &Path,
        name: &str,
        frames: &settings::Frames,
        limit: u64,
        progress: &dyn Progress,
    ) -> Result<FrameSmoke, Error> {
        let factor = match self.settings.velocity_units {
            settings::VelocityUnits::Second => 1.0,
            settings::VelocityUnits::Frame => frames.fps,
        };
        let velocity = VelocityGrid::new(vdb::read_vector_grid(path, name, limit)?, factor);
        let shutter = frames.shutter.map(|share| share / frames.fps);
        let blur = |grid: &DensityGrid| drift::blurred(grid, &velocity, shutter, limit, progress);
        let density = blur(&smoke.density)?;
        let glow = match &smoke.glow {
            Some([red, green, blue]) => Some([blur(red)?, blur(green)?, blur(blue)?]),
            None => None,
        };
        Ok(FrameSmoke { density, glow, ..smoke })
    }
}

impl SmokeSource {
    pub(super) fn build(scene: &Scene, geometry: &Geometry) -> Result<Self, Error> {
        let Some(smoke) = &scene.settings.smoke else { return Ok(Self::None) };
        if let Some(file) = &smoke.file {
            return Ok(Self::File(DensityFiles::new(file)?));
        }
        let Some(grid) = &smoke.grid else { return Ok(Self::None) };
        let frames = &scene.settings.frames;
        let splat = SplatSettings {
            voxel_size: grid.voxel_size as f32,
            shutter_seconds: frames.shutter.map(|s| s / frames.fps),
            soft_radius: grid.soft_radius,
            memory_limit_bytes: grid_memory_limit(scene, 0),
        };
        let system = ParticleSystem::build(scene, geometry, build_flow(scene, geometry)?)
            .map_err(|e| in_scene(scene, "smoke.emitters", None, e))?;
        Ok(Self::Particles { system: Box::new(system), splat, is_told: false })
    }

    /// What carries the smoke, where that is known.
    pub(super) fn flow(&self) -> Option<&Flow> {
        match self {
            Self::Particles { system, .. } => Some(system.flow()),
            Self::None | Self::File { .. } => None,
        }
    }

    /// The particles, of smoke that is made of some.
    pub(super) fn particles(&self) -> Option<&ParticleSystem> {
        match self {
            Self::Particles { system, .. } => Some(system),
            Self::None | Self::File(_) => None,
        }
    }

    pub(super) fn grid(
        &mut self,
        scene: &Scene,
        frame: i32,
        heat: Option<Heat>,
        progress: &dyn Progress,
        record: &mut Sidecar,
    ) -> Result<Option<FrameSmoke>, Error> {
        self.grids(scene, frame, Besides { heat, ..Besides::default() }, progress, record)
    }

    /// As [`SmokeSource::grid`], with what else is asked of particles.
    pub(super) fn grids(
        &mut self,
        scene: &Scene,
        frame: i32,
        besides: Besides,
        progress: &dyn Progress,
        record: &mut Sidecar,
    ) -> Result<Option<FrameSmoke>, Error> {
        let smoke = match self {
            Self::None => return Ok(None),
            Self::Particles { system, splat: settings, is_told } => {
                let (splat, glow) = splat_frame(system, settings, scene, frame, besides, progress, record)?;
                let m = splat.mass;
                record.mass = MassFigures { particles: m.particles, grid: m.grid, faded: m.faded, lost: m.lost };
                let Way { penetrations, born, born_inside } = system.way();
                (record.penetrations, record.born, record.born_inside) = (penetrations, born, born_inside);
                let share = born_inside as f64 / born.max(1) as f64;
                if share > BORN_INSIDE_NOTED && !*is_told {
                    *is_told = true;
                    progress.note(&format!("frame {frame}: {}", born_inside_text(scene, "the particles were", share)));
                }
                FrameSmoke { density: splat.grid, glow, is_unbound: false, means: splat.means }
            }
            Self::File(file) => {
                let limit = grid_memory_limit(scene, 0);
                file.read(scene, frame, besides.heat.as_ref(), "smoke", limit, progress, record)?
            }
        };
        let remap = scene.settings.smoke.as_ref().and_then(|smoke| smoke.remap);
        let smoke = smoke.remapped(remap);
        record.grid.active_voxels = smoke.density.active_voxel_count();
        record.grid.bytes = smoke.memory_bytes();
        Ok(Some(smoke))
    }
}

/// The density of the particles of a frame, and the light of hot ones.
fn splat_frame(
    system: &mut ParticleSystem,
    settings: &SplatSettings,
    scene: &Scene,
    frame: i32,
    besides: Besides,
    progress: &dyn Progress,
    record: &mut Sidecar,
) -> Result<(Splat, Option<[DensityGrid; 3]>), Error> {
    let smoke = scene.settings.smoke.as_ref();
    let batch = smoke.and_then(|smoke| smoke.advect.batch);
    // Shared, since batches are made while walls are asked.
    let flow = system.shared_flow();
    let has_walls = !flow.walls().obstacles().is_empty();
    let walls = has_walls.then(|| FlowObstacles(flow.walls().span(time_of(scene, frame), 0.0)));
    let start = Instant::now();
    if let Some(batch) = batch {
        let count = |emitter| footprint::live_count(emitter, &scene.settings.frames);
        let all: f64 = smoke.map_or(0.0, |smoke| smoke.emitters.iter().map(count).sum());
        let mut sums = SmokeSums::try_new(scene, settings, besides, all.min(batch as f64).ceil() as usize)?;
        let mut grid_time = Duration::ZERO;
        let visited = system.visit_batches(frame, batch, progress, &mut |particles| {
            let start = Instant::now();
            record.particles += particles.len() as u64;
            sums.add(particles, walls.as_ref(), scene, frame).map_err(Visit::Grid)?;
            grid_time += start.elapsed();
            Ok(())
        });
        visited.map_err(|e| match e {
            Visit::Particles(e) => in_scene(scene, "flow", Some(frame), e),
            Visit::Grid(e) => e,
        })?;
        record.add_time(Stage::Advect, start.elapsed().saturating_sub(grid_time));
        record.add_time(Stage::Grid, grid_time);
        return timed(progress, Stage::Grid, record, 0, || sums.finish(scene, frame));
    }
    system.at_frame(frame, progress).map_err(|e| in_scene(scene, "flow", Some(frame), e))?;
    record.add_time(Stage::Advect, start.elapsed());
    let particles = system.particles();
    record.particles = particles.len() as u64;
    timed(progress, Stage::Grid, record, 0, || {
        let mut sums = SmokeSums::try_new(scene, settings, besides, particles.len())?;
        sums.add(particles, walls.as_ref(), scene, frame)?;
        sums.finish(scene, frame)
    })
}

/// Why not all batches were visited.
enum Visit {
    Particles(ParticlesError),
    Grid(Error),
}

impl From<ParticlesError> for Visit {
    fn from(error: ParticlesError) -> Self {
        Self::Particles(error)
    }
}

/// Density, and light of hot smoke, while particles are added.
struct SmokeSums {
    density: SplatSum,
    has_velocity: bool,
    temperature: Option<settings::Blackbody>,
    light: Option<(Heat, [SplatSum; 3])>,
}

impl SmokeSums {
    /// Sums that leave room for so many particles.
    fn try_new(scene: &Scene, settings: &SplatSettings, besides: Besides, held_count: usize) -> Result<Self, Error> {
        let Besides { heat, has_velocity, temperature } = besides;
        let shutter_seconds = if has_velocity { [0.0; 2] } else { settings.shutter_seconds };
        let limit = grid_memory_limit(scene, held_count);
        let limit = match temperature {
            Some(_) => limit.saturating_sub(2 * held_count as u64 * size_of::<f32>() as u64),
            None => limit,
        };
        // Of hot smoke four grids share what is left.
        let limit = match heat {
            Some(_) => limit.saturating_sub(held_count as u64 * heat::PARTICLE_BYTES) / 4,
            None => limit,
        };
        let empty = || {
            SplatSum::try_new(SplatSettings { memory_limit_bytes: limit, shutter_seconds, ..*settings })
                .map_err(|e| in_scene(scene, "smoke.grid", None, e))
        };
        let light = heat.map(|heat| Ok::<_, Error>((heat, [empty()?, empty()?, empty()?]))).transpose()?;
        Ok(Self { density: empty()?, has_velocity, temperature, light })
    }

    fn add(
        &mut self,
        particles: &Particles,
        walls: Option<&FlowObstacles>,
        scene: &Scene,
        frame: i32,
    ) -> Result<(), Error> {
        let temperature = self.temperature.map(|heat| heat::glows(&heat, particles));
        let velocity = particles.velocity.iter().filter(|_| self.has_velocity);
        let carried: Vec<&[f32]> = velocity.chain(&temperature).map(Vec::as_slice).collect();
        let input = SplatInput {
            position: particles.position.each_ref().map(Vec::as_slice),
            velocity: particles.velocity.each_ref().map(Vec::as_slice),
            bends: particles.bends.as_ref().map(|b| b.each_ref().map(|axes| axes.each_ref().map(Vec::as_slice))),
            mass: &particles.mass,
            radius: &particles.radius,
            carried: &carried,
            obstacles: walls.map(|walls| walls as &dyn ObstacleDistance),
        };
        self.density.add(&input).map_err(|e| in_scene(scene, "smoke.grid", Some(frame), e))?;
        let Some((heat, light)) = &mut self.light else { return Ok(()) };
        let channels = heat.of_particles(particles);
        light
            .iter_mut()
            .zip(&channels)
            .try_for_each(|(sum, mass)| sum.add(&SplatInput { mass, carried: &[], ..input }))
            .map_err(|e| in_scene(scene, "smoke.blackbody", Some(frame), e))
    }

    fn finish(self, scene: &Scene, frame: i32) -> Result<(Splat, Option<[DensityGrid; 3]>), Error> {
        let density = self.density.finish().map_err(|e| in_scene(scene, "smoke.grid", Some(frame), e))?;
        let of_light =
            |[red, green, blue]: [SplatSum; 3]| Ok([red.finish()?.grid, green.finish()?.grid, blue.finish()?.grid]);
        let light = self.light.map(|(_, sums)| of_light(sums)).transpose();
        Ok((density, light.map_err(|e: GridError| in_scene(scene, "smoke.blackbody", Some(frame), e))?))
    }
}

/// That most of `whose` particles begin where the flow must not be, and what to do.
pub(super) fn born_inside_text(scene: &Scene, whose: &str, share: f64) -> String {
    let dfvn = scene.settings.flow.dfvn.as_ref();
    if let Some(shape) = dfvn.and_then(|dfvn| dfvn.inside.as_ref()) {
        return format!(
            "{:.0} % of {whose} born outside of `{shape}`, in which flow.dfvn holds them, and put on its wall; move the \
             emitter into it, or make it smaller",
            100.0 * share
        );
    }
    format!(
        "{:.0} % of {whose} born inside obstacles and put on their walls; move the emitter out of the shapes in \
         flow.obstacles (of a mesh, raise its `offset`), or take them off that list",
        100.0 * share
    )
}

/// The obstacles of the flow as splatting asks for them: the one place where the two meet.
#[derive(Debug)]
struct FlowObstacles<'a>(FieldSpan<'a>);

impl ObstacleDistance for FlowObstacles<'_> {
    fn distances(&self, points: &[DVec3], distances: &mut [f64]) {
        self.0.distances(points, 0.0, distances);
    }
}
