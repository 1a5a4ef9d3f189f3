//! The studio of a run of frames: what stays the same from one to the next is built once.

use crate::error::Error;
use crate::geometry::Geometry;
use crate::output::sidecar::Sidecar;
use crate::particles;
use crate::pipeline::assemble::{
    Exposure, build_geometry, build_medium, load_lights, load_textures, placed, smoke_heat, world_of,
};
use crate::pipeline::smoke::SmokeSource;
use crate::pipeline::volumes::VolumeSources;
use crate::pipeline::{Photographer, time_of, timed};
use crate::progress::{Progress, Stage};
use crate::render::film::PathCounts;
use crate::render::ledger::Ledger;
use crate::render::tiles::{self, View};
use crate::render::world::World;
use crate::render::{self, TextureStore};
use crate::scene::{Scene, settings};
use std::time::Instant;

/// Share of light lost with paths that are cut above which people are told.
const TRUNCATED_LIGHT_NOTED: f64 = 1e-3;

/// What stays the same from frame to frame.
pub(super) struct Studio {
    geometry: Geometry,
    /// Of a scene in which no shape and no light moves; each frame brings its materials.
    world: Option<World>,
    textures: TextureStore,
    smoke: SmokeSource,
    volumes: VolumeSources,
}

impl Studio {
    pub fn build(scene: &Scene, progress: &dyn Progress, record: &mut Sidecar) -> Result<Self, Error> {
        let start = Instant::now();
        let geometry = build_geometry(scene, progress)?;
        geometry.camera_warning(scene).iter().for_each(|warning| progress.note(warning));
        let mut textures = load_textures(scene)?;
        let world = if geometry.moves() || scene.settings.lights.iter().any(settings::Light::varies) {
            None
        } else {
            // Whether a shape shines the same everywhere, and so is a light, does not change with time.
            Some(build_world(scene, &geometry, &mut textures, 0.0)?)
        };
        particles::wall_warnings(scene, &geometry).iter().for_each(|warning| progress.note(warning));
        let smoke = SmokeSource::build(scene, &geometry)?;
        let volumes = VolumeSources::build(scene, &geometry)?;
        record.add_time(Stage::Geometry, start.elapsed());
        Ok(Self { geometry, world, textures, smoke, volumes })
    }

    /// Fills the ledger; how many paths a pixel has at most.
    pub fn take_picture(
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
        let moved;
        let time = time_of(scene, frame);
        let world = match &mut self.world {
            Some(world) => {
                world.materials = render::build_materials(scene, &self.geometry, &mut self.textures, time);
                world
            }
            None => {
                let build = || build_world(scene, &self.geometry, &mut self.textures, time);
                moved = timed(progress, Stage::Geometry, record, 0, build)?;
                &moved
            }
        };
        let exposure =
            Exposure::new(scene, frame, view.clone(), &self.geometry, &self.smoke, medium.as_ref(), &volumes);
        trace(&exposure, world, frame, ledger, progress, record)
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
pub(super) fn trace(
    Exposure { view, media, motion }: &Exposure,
    world: &World,
    frame: i32,
    ledger: &Ledger,
    progress: &dyn Progress,
    record: &mut Sidecar,
) -> Result<u32, Error> {
    let paths = ledger.samples.as_ref().map_or(view.spp as usize, ExactSizeIterator::len);
    let most = view.bounds.area() as u64 * paths as u64;
    let resumed: u64 = ledger.tiles().iter().flatten().map(|tile| tile.counts.traced).sum();
    let spp = timed(progress, Stage::Render, record, most, || {
        tiles::render_to(ledger, view, world, *media, motion.as_ref(), progress)
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

fn build_world(scene: &Scene, geometry: &Geometry, textures: &mut TextureStore, time: f64) -> Result<World, Error> {
    let placed = placed(scene, geometry, time);
    let (surfaces, lights) = (placed.trace_scene()?, load_lights(scene, time)?);
    Ok(world_of(scene, &placed, surfaces, lights, textures, time))
}
