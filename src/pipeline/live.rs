//! A studio for one who looks on while the scene changes: all that a change leaves alone is kept.
//!
//! Which settings and files each part is made from is said in `inputs.rs`; here parts are put together, and one that takes from
//! another is made again when that was.

use crate::error::Error;
use crate::geometry::Geometry;
use crate::geometry::embree::TraceScene;
use crate::grid::means::MeanGrid;
use crate::output::sidecar::{GridFigures, MassFigures, Sidecar};
use crate::particles::{self, system::Way};
use crate::pipeline::assemble::{
    Exposure, build_geometry, build_medium, load_lights, load_textures, placed, smoke_heat, world_of,
};
use crate::pipeline::inputs::{Inputs, Part};
use crate::pipeline::smoke::{FrameSmoke, SmokeSource};
use crate::pipeline::studio::trace;
use crate::pipeline::volumes::VolumeSources;
use crate::pipeline::{Photographer, check_camera, time_of};
use crate::progress::{Progress, Stage};
use crate::render::film::{Film, PixelBounds};
use crate::render::ledger::Ledger;
use crate::render::light::Light;
use crate::render::media::{Media, Volume};
use crate::render::medium::Medium;
use crate::render::passes::Passes;
use crate::render::sun_shadow::SunShadows;
use crate::render::tiles::View;
use crate::render::world::World;
use crate::render::{self, TextureStore};
use crate::scene::Scene;
use std::time::Instant;

/// Edges of the squares in which a picture is first seen [pixels].
const GLANCES: [u32; 3] = [8, 4, 2];
/// Pictures of fewer pixels are seen whole at once.
const GLANCED_PIXELS: usize = 64 * 64;

/// A part with what it was made from.
struct Slot<K, T> {
    held: Option<(K, T)>,
    /// How often it was made.
    generation: u64,
}

impl<K, T> Default for Slot<K, T> {
    fn default() -> Self {
        Self { held: None, generation: 0 }
    }
}

impl<K: PartialEq, T> Slot<K, T> {
    fn is_made_from(&self, key: &K) -> bool {
        self.held.as_ref().is_some_and(|(held, _)| held == key)
    }

    /// Makes the part unless it was made from this very thing.
    fn renew(&mut self, key: K, make: impl FnOnce() -> Result<T, Error>) -> Result<bool, Error> {
        if self.is_made_from(&key) {
            return Ok(false);
        }
        self.held = None;
        self.generation += 1;
        self.held = Some((key, make()?));
        Ok(true)
    }

    fn get(&self) -> Result<&T, Error> {
        self.held.as_ref().map(|(_, made)| made).ok_or_else(not_ready)
    }

    fn get_mut(&mut self) -> Result<&mut T, Error> {
        self.held.as_mut().map(|(_, made)| made).ok_or_else(not_ready)
    }
}

fn not_ready() -> Error {
    Error::Internal("a picture was asked for before its parts were made".into())
}

/// Shapes where they are at a frame.
struct Placed {
    geometry: Geometry,
    /// The same as a target of rays; only while the world does not have it.
    surfaces: Option<TraceScene>,
}

/// What is kept from picture to picture.
#[derive(Default)]
pub struct LiveStudio {
    shapes: Slot<Inputs, Geometry>,
    placed: Slot<(Inputs, u64, Option<i32>), Placed>,
    textures: Slot<Inputs, TextureStore>,
    /// Only while `world` does not have them.
    lights: Slot<Inputs, Option<Vec<Light>>>,
    particles: Slot<Inputs, SmokeSource>,
    /// Only while `medium` does not have it.
    density: Slot<(Inputs, u64), Option<FrameSmoke>>,
    medium: Slot<(Inputs, u64), Option<Medium>>,
    /// Whether the light of the smoke in `medium` is not bound to its density.
    is_unbound: bool,
    volumes: Slot<(Inputs, u64), Vec<Volume>>,
    shadows: Slot<[u64; 4], SunShadows>,
    world: Option<World>,
    /// What was last said of where the camera is.
    camera_warning: Option<String>,
    /// How many lights of `world` are the scene's own, before shapes that shine.
    own_lights: usize,
    /// Of the density.
    density_figures: Figures,
    /// Of the volumes alone.
    volume_figures: GridFigures,
}

/// What a sidecar tells of parts that may be kept.
#[derive(Clone, Copy, Default)]
struct Figures {
    particles: u64,
    way: Way,
    grid: GridFigures,
    mass: MassFigures,
}

impl Figures {
    fn of(record: &Sidecar) -> Self {
        let Sidecar { particles, penetrations, born, born_inside, grid, mass, .. } = *record;
        Self { particles, way: Way { penetrations, born, born_inside }, grid, mass }
    }

    fn note_in(self, record: &mut Sidecar) {
        let Self { particles, way: Way { penetrations, born, born_inside }, grid, mass } = self;
        *record = Sidecar { particles, penetrations, born, born_inside, grid, mass, ..std::mem::take(record) };
    }
}

impl LiveStudio {
    /// Makes ready for a frame of a scene what is not yet as it says; which parts those were.
    ///
    /// # Errors
    /// The first that any stage meets. Parts that were made before it are kept.
    pub fn prepare(&mut self, scene: &Scene, frame: i32, progress: &dyn Progress) -> Result<Vec<Part>, Error> {
        self.prepare_noting(scene, frame, progress, &mut Sidecar::default())
    }

    /// As [`LiveStudio::prepare`], and notes in `record` what of it is told there: the time that was taken, and the size of what
    /// there is.
    fn prepare_noting(
        &mut self,
        scene: &Scene,
        frame: i32,
        progress: &dyn Progress,
        record: &mut Sidecar,
    ) -> Result<Vec<Part>, Error> {
        let start = Instant::now();
        let mut made = Vec::new();
        let mut note = |part: Part, is_made: bool| made.extend(is_made.then_some(part));
        let inputs = |part| Inputs::of(part, scene, frame);
        self.dismantle();
        let time = time_of(scene, frame);
        check_camera(scene, &[frame])?;

        note(Part::Shapes, self.shapes.renew(inputs(Part::Shapes)?, || Ok(build_geometry(scene, progress)?))?);
        let (geometry, shapes) = (self.shapes.get()?, self.shapes.generation);
        let warning = geometry.camera_warning(scene);
        if warning != self.camera_warning {
            warning.iter().for_each(|warning| progress.note(warning));
            self.camera_warning = warning;
        }
        let place = || {
            let geometry = placed(scene, geometry, time);
            let surfaces = Some(geometry.trace_scene()?);
            Ok(Placed { geometry, surfaces })
        };
        let key = (inputs(Part::Surfaces)?, shapes, geometry.moves().then_some(frame));
        note(Part::Surfaces, self.placed.renew(key, place)?);
        note(Part::Textures, self.textures.renew(inputs(Part::Textures)?, || load_textures(scene))?);
        note(Part::Lights, self.lights.renew(inputs(Part::Lights)?, || load_lights(scene, time).map(Some))?);

        record.add_time(Stage::Geometry, start.elapsed());

        let has_smoke = scene.settings.smoke.is_some();
        let build = || SmokeSource::build(scene, geometry);
        let is_new = self.particles.renew(inputs(Part::Particles)?, build)?;
        note(Part::Particles, is_new && has_smoke);
        if is_new {
            particles::wall_warnings(scene, geometry).iter().for_each(|warning| progress.note(warning));
        }
        let particles = self.particles.generation;
        let source = self.particles.get_mut()?;
        let key = (inputs(Part::Density)?, particles);
        if !self.density.is_made_from(&key) {
            // Two densities might not fit into memory together.
            self.medium.held = None;
        }
        let splat = || source.grid(scene, frame, smoke_heat(scene), progress, record);
        let is_new = self.density.renew(key, splat)?;
        note(Part::Density, is_new && has_smoke);
        if is_new {
            self.density_figures = Figures::of(record);
        } else {
            self.density_figures.note_in(record);
        }
        let start = Instant::now();
        let key = (inputs(Part::Medium)?, self.density.generation);
        if !self.medium.is_made_from(&key) {
            let last = self.medium.held.take().and_then(|(_, medium)| medium);
            let smoke = match last {
                // The density is that of the last medium.
                Some(last) if !is_new => {
                    let (density, glow) = last.into_grids();
                    Some(FrameSmoke { density, glow, is_unbound: self.is_unbound, means: MeanGrid::default() })
                }
                _ => self.density.get_mut()?.take(),
            };
            self.is_unbound = smoke.as_ref().is_some_and(|smoke| smoke.is_unbound);
            let medium = smoke.map(|smoke| build_medium(scene, frame, smoke)).transpose().inspect_err(|_| {
                // It went down with the error.
                self.density.held = None;
            });
            self.medium.generation += 1;
            self.medium.held = Some((key, medium?.flatten()));
            note(Part::Medium, has_smoke);
        }
        record.add_time(Stage::Grid, start.elapsed());
        let before = record.grid;
        let fill = || VolumeSources::build(scene, geometry)?.at_frame(scene, geometry, frame, progress, record);
        let has_volumes = !scene.settings.volumes.is_empty();
        let is_new = self.volumes.renew((inputs(Part::Volumes)?, if has_volumes { shapes } else { 0 }), fill)?;
        note(Part::Volumes, is_new && has_volumes);
        if is_new {
            self.volume_figures = GridFigures {
                active_voxels: record.grid.active_voxels - before.active_voxels,
                bytes: record.grid.bytes - before.bytes,
            };
        } else {
            record.grid.active_voxels += self.volume_figures.active_voxels;
            record.grid.bytes += self.volume_figures.bytes;
        }

        self.assemble(scene, time)?;
        Ok(made)
    }

    /// Takes the picture of the frame that [`LiveStudio::prepare`] made ready: first in squares, then with 1, 2, 4, … paths a pixel up to
    /// `film.spp`, calling `show` with each, where `done` is 0 for squares. All pixels have equally many paths. With all of
    /// them the picture is that of [`film`](crate::pipeline::film), bit for bit, where that has equally many everywhere.
    ///
    /// # Errors
    /// As for `film`.
    pub fn expose(
        &self,
        scene: &Scene,
        frame: i32,
        crop: Option<PixelBounds>,
        progress: &dyn Progress,
        show: &mut dyn FnMut(Film, u32),
    ) -> Result<(), Error> {
        let world = self.world.as_ref().ok_or_else(not_ready)?;
        let view = View { adaptive: None, time_limit: None, ..render::build_view(scene, frame, crop) };
        let (geometry, source) = (self.shapes.get()?, self.particles.get()?);
        let Exposure { view, media, motion } =
            Exposure::new(scene, frame, view, geometry, source, self.medium.get()?.as_ref(), self.volumes.get()?);
        let mut passes = Passes::new(&view, world, media, self.shadows.get()?, motion.as_ref());
        progress.begin(Stage::Render, view.bounds.area() as u64 * u64::from(view.spp));
        if view.bounds.area() > GLANCED_PIXELS {
            for stride in GLANCES {
                show(passes.glance(stride, progress)?, 0);
            }
        }
        while passes.done() < view.spp {
            passes.go_on((2 * passes.done()).max(1), progress)?;
            show(passes.film(progress)?, passes.done());
        }
        progress.end(Stage::Render);
        Ok(())
    }

    /// Takes the world apart into what may be kept of it.
    fn dismantle(&mut self) {
        let Some(mut world) = self.world.take() else { return };
        world.lights.truncate(self.own_lights);
        if let Some((_, lights)) = &mut self.lights.held {
            *lights = Some(world.lights);
        }
        if let Some((_, placed)) = &mut self.placed.held {
            placed.surfaces = Some(world.surfaces);
        }
    }

    /// Puts surfaces, materials and lights together, and works out how much of each sun reaches where.
    fn assemble(&mut self, scene: &Scene, time: f64) -> Result<(), Error> {
        let Placed { geometry, surfaces } = self.placed.get_mut()?;
        let lights = self.lights.get_mut()?.take().ok_or_else(not_ready)?;
        let surfaces = surfaces.take().ok_or_else(not_ready)?;
        self.own_lights = lights.len();
        let world = world_of(scene, geometry, surfaces, lights, self.textures.get_mut()?, time);
        let media = Media::new(self.medium.get()?.as_ref(), self.volumes.get()?);
        let parts =
            [self.medium.generation, self.volumes.generation, self.lights.generation, world.lights.len() as u64];
        self.shadows.renew(parts, || Ok(SunShadows::new(&world.lights, media.grids())))?;
        self.world = Some(world);
        Ok(())
    }
}

/// Takes the very picture that `render` would, with all that is kept from the last one.
impl Photographer for LiveStudio {
    fn take_picture(
        &mut self,
        scene: &Scene,
        view: &View,
        frame: i32,
        ledger: &Ledger,
        progress: &dyn Progress,
        record: &mut Sidecar,
    ) -> Result<u32, Error> {
        self.prepare_noting(scene, frame, progress, record)?;
        let world = self.world.as_ref().ok_or_else(not_ready)?;
        let (medium, volumes) = (self.medium.get()?.as_ref(), self.volumes.get()?);
        let (geometry, source) = (self.shapes.get()?, self.particles.get()?);
        let exposure = Exposure::new(scene, frame, view.clone(), geometry, source, medium, volumes);
        trace(&exposure, world, frame, ledger, progress, record)
    }
}
