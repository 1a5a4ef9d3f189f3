//! Light through smoke.
//!
//! This file and `from_scene/` turn settings into camera, lights, materials and media; `integrator.rs` traces paths,
//! `tiles.rs` takes pictures.

pub mod adaptive;
pub mod atmosphere;
pub mod ball;
pub mod blackbody;
pub mod bsdf;
pub mod camera;
pub mod catcher;
pub mod choice;
pub mod chroma;
pub mod color;
pub mod cryptomatte;
pub mod dense;
pub mod detail;
pub mod environment;
pub mod equiangular;
pub mod even;
pub mod film;
pub mod filter;
pub mod from_scene;
pub mod glow;
pub mod image_texture;
pub mod integrator;
pub mod layers;
pub mod ledger;
pub mod light;
pub mod light_path;
pub mod material;
pub mod media;
pub mod medium;
pub mod motion;
pub mod panel;
pub mod passes;
pub mod phase;
pub mod picture;
pub mod sampler;
pub mod spot;
pub mod sun;
pub mod sun_shadow;
pub mod surface_keys;
pub mod surface_light;
pub mod texture;
pub mod through;
pub mod tiles;
pub mod tracking;
pub mod vertex;
pub mod world;

pub use crate::render::from_scene::lights::{build_lights, check_lights};
pub use crate::render::from_scene::materials::build_materials;
pub use crate::render::from_scene::textures::TextureStore;

use crate::flow::turbulence::{Turbulence, TurbulenceSettings};
use crate::geometry::Geometry;
use crate::geometry::embree::TraceScene;
use crate::geometry::moment::Shutter;
use crate::grid::DensityGrid;
use crate::grid::majorant::{CellEdge, MajorantGrid};
use crate::math::hash::Seed;
use crate::render::adaptive::Adaptive;
use crate::render::detail::Detail;
use crate::render::even::EvenMedium;
use crate::render::film::PixelBounds;
use crate::render::filter::Filter;
use crate::render::from_scene::camera::CameraCourse;
use crate::render::from_scene::lights::{glowing_shape, groups};
use crate::render::from_scene::vec3;
use crate::render::integrator::PathLimits;
use crate::render::layers::{Layer, group_layers};
use crate::render::light::Light;
use crate::render::light_path::{EMISSION_GROUP, Passage};
use crate::render::material::Material;
use crate::render::medium::{Matter, Medium};
use crate::render::phase::Phase;
use crate::render::picture::Picture;
use crate::render::tiles::{View, ViewShutter};
use crate::render::world::World;
use crate::scene::settings::Aov;
use crate::scene::{Scene, settings};
use glam::Vec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// What can stop a picture.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The caller asked to stop.
    #[error("cancelled")]
    Cancelled,
    /// A picture cannot be read. The error is that of whoever read it, and names the file.
    #[error(transparent)]
    Picture(Box<dyn std::error::Error + Send + Sync>),
    /// A picture holds what is no light.
    #[error("{path}: {problem}", path = path.display())]
    NoLight {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// A light cannot be made.
    #[error("{source}")]
    Light {
        /// Which, from 0.
        light_idx: usize,
        /// What is wrong with it.
        source: Box<RenderError>,
    },
    /// A light over time is none at some of it.
    #[error("at {time:.6} s, the first frame being at 0, there is no such light: {what}")]
    LightNowhere {
        /// When [s].
        time: f64,
        /// What is wrong with it, and a way out.
        what: &'static str,
    },
    /// A camera that moves looks at where it stands, or along its `up`.
    #[error(
        "at {time:.6} s, the first frame being at 0, the camera stands where it looks, or looks along `up`; change the keys of \
         camera.position, look_at or up"
    )]
    CameraNowhere {
        /// When [s].
        time: f64,
    },
    /// A texture cannot be made.
    #[error("{source}")]
    Texture {
        /// The key of its file in the scene.
        key: String,
        /// What is wrong with it.
        source: Box<RenderError>,
    },
    /// The pictures of all textures take too much memory.
    #[error(
        "the pictures of all textures take {needed} bytes of memory, more than the limit of {limit}; make them smaller, or raise render.memory_limit_gib"
    )]
    TexturesTooLarge {
        /// Memory that they need, up to the first that is too much [bytes].
        needed: u64,
        /// Memory that is allowed [bytes].
        limit: u64,
    },
    /// Smoke too dense for single precision.
    #[error(
        "the density reaches {density:.3e}; times medium.{what}, {factor:.3e}, this is {:.3e}, at most {SIGMA_MAX:.0e} is \
         allowed; lower medium.{what} or the density, which of smoke is the mass of its emitters",
        f64::from(*density) * factor
    )]
    TooDense {
        /// Largest density of the frame.
        density: f32,
        /// The key of the medium that it is too dense for.
        what: &'static str,
        /// Its value: extinction coefficient or emission of density 1 [1/m, W/(m³ sr)].
        factor: f64,
    },
    /// Smoke too hot for single precision.
    #[error(
        "the smoke gives off {light:.3e} W/(m³ sr), at most {SIGMA_MAX:.0e} is allowed; lower the gain of its light or its \
         temperature"
    )]
    TooHot {
        /// Most that it gives off [W/(m³ sr)].
        light: f32,
    },
    /// Smoke too dense for detail, through which there is no exact way.
    #[error(
        "with detail, a voxel of the densest smoke has an optical depth of {depth:.3e}, at most {DETAIL_DEPTH_MAX} is allowed: \
         so dense smoke is a wall, and flights through it would not end; lower medium.extinction, make voxels smaller, or \
         leave out detail"
    )]
    TooDenseForDetail {
        /// Of the densest voxel.
        depth: f64,
    },
    /// The ray-tracing scene cannot be built.
    #[error(transparent)]
    Geometry(#[from] crate::geometry::GeometryError),
    /// A path brought infinity or NaN: a fault of the program, never painted over.
    #[error(
        "pixel ({x}, {y}), sample {sample}: radiance is {radiance}; this is a fault of curlsmoke, please report it with the scene"
    )]
    NonFinite {
        /// Column.
        x: i32,
        /// Row.
        y: i32,
        /// Number of the path in its pixel.
        sample: u32,
        /// What it brought.
        radiance: glam::Vec3,
    },
}

/// Reads a picture, or says what is wrong with it: file formats are not this stage's business.
pub type LoadPicture<'a> = &'a dyn Fn(&Path) -> Result<Picture, Box<dyn std::error::Error + Send + Sync>>;

/// Largest extinction coefficient and emission that light is traced through [1/m, W/(m³ sr)]: far beyond any matter, and far
/// from overflow.
pub const SIGMA_MAX: f64 = 1e20;

/// Largest optical depth of a voxel that may have detail. Flights take as many steps as bounds are optical depths thick, at
/// most some ten voxels' worth of it where density falls from the most to next to nothing.
pub const DETAIL_DEPTH_MAX: f64 = 1000.0;

/// Surfaces, materials and lights of a scene at time 0: all but the smoke. `geometry` is where shapes are then.
///
/// # Errors
/// When Embree refuses the surfaces or a picture of the surroundings cannot be used.
pub fn build_world(
    scene: &Scene,
    geometry: &Geometry,
    materials: Vec<Material>,
    load: LoadPicture,
) -> Result<World, RenderError> {
    let (surfaces, lights) = (geometry.trace_scene()?, build_lights(scene, 0.0, load)?);
    Ok(assemble_world(scene, geometry, surfaces, lights, materials))
}

/// As [`build_world`] at any time, of surfaces and lights of the scene that are there already: those of [`Geometry::trace_scene`] and
/// [`build_lights`].
pub fn assemble_world(
    scene: &Scene,
    geometry: &Geometry,
    surfaces: TraceScene,
    mut lights: Vec<Light>,
    materials: Vec<Material>,
) -> World {
    debug_assert_eq!(materials.len(), geometry.shapes.len(), "shapes that shine are found by their materials");
    let shapes = geometry.shapes.iter().zip(&materials).enumerate().filter(|(_, (shape, _))| shape.visible);
    lights.extend(shapes.filter_map(|(i, (shape, material))| glowing_shape(i as u32, shape, material)));
    let mut world = World::new(surfaces, materials, lights);
    let groups = groups(&scene.settings);
    // Shapes that shine come after the lights of the scene.
    world.groups.fill(EMISSION_GROUP);
    world.groups[..groups.len()].copy_from_slice(&groups);
    world
}

/// The smoke of a frame; `None` for a scene without any.
///
/// # Errors
/// [`RenderError::TooDense`] where density times extinction, or times emission, passes [`SIGMA_MAX`].
pub fn build_medium(scene: &Scene, grid: DensityGrid) -> Result<Option<Medium>, RenderError> {
    let Some(smoke) = &scene.settings.smoke else { return Ok(None) };
    grid_medium(&smoke.medium, grid).map(Some)
}

/// Smoke or a volume of density on voxels, by what it does to light.
///
/// # Errors
/// As [`build_medium`].
pub fn grid_medium(medium: &settings::Medium, grid: DensityGrid) -> Result<Medium, RenderError> {
    check_density(medium, grid.max_density())?;
    let most = medium.extinction_tint.iter().copied().fold(0.0, f64::max);
    let mut built = Medium::new(grid, (medium.extinction * most) as f32, vec3(medium.albedo), phase(&medium.phase));
    built.tint = tint(medium);
    built.emission = vec3(medium.emission);
    Ok(built)
}

/// Even matter inside of a closed surface.
///
/// # Errors
/// As [`build_medium`].
pub fn even_medium(volume: &settings::Volume, container: Arc<TraceScene>) -> Result<EvenMedium, RenderError> {
    let (medium, density) = (&volume.medium, volume.density.unwrap_or(1.0));
    check_density(medium, density as f32)?;
    let most = medium.extinction_tint.iter().copied().fold(0.0, f64::max);
    Ok(EvenMedium {
        shape_idx: None,
        container,
        sigma_t: (medium.extinction * most * density) as f32,
        tint: tint(medium),
        emission: vec3(medium.emission) * density as f32,
        matter: Matter { albedo: vec3(medium.albedo), phase: phase(&medium.phase), is_carried: false },
    })
}

fn check_density(medium: &settings::Medium, density: f32) -> Result<(), RenderError> {
    let emission = medium.emission.iter().copied().fold(0.0, f64::max);
    for (what, factor) in [("extinction", medium.extinction), ("emission", emission)] {
        if f64::from(density) * factor > SIGMA_MAX {
            return Err(RenderError::TooDense { density, what, factor });
        }
    }
    Ok(())
}

fn phase(phase: &settings::Phase) -> Phase {
    match *phase {
        settings::Phase::Isotropic => Phase::HenyeyGreenstein { g: 0.0 },
        settings::Phase::HenyeyGreenstein { g } => Phase::HenyeyGreenstein { g: g as f32 },
        settings::Phase::TwoLobes { g1, g2, share } => Phase::two_lobes([g1 as f32, g2 as f32], share as f32),
        settings::Phase::Droplets { diameter_um } => Phase::droplets(diameter_um),
    }
}

/// Extinction of each channel over the largest, where it has a colour.
fn tint(medium: &settings::Medium) -> Option<Vec3> {
    let most = medium.extinction_tint.iter().copied().fold(0.0, f64::max);
    medium.is_tinted().then(|| vec3(medium.extinction_tint.map(|factor| factor / most)))
}

/// Lets smoke give off light besides: red, green and blue [W/(m³ sr)], 0 where there is no density unless it `is_unbound`.
///
/// # Errors
/// [`RenderError::TooHot`] where that passes [`SIGMA_MAX`].
pub fn kindle(medium: &mut Medium, glow: [DensityGrid; 3], is_unbound: bool) -> Result<(), RenderError> {
    let light = glow.iter().map(DensityGrid::max_density).fold(0.0, f32::max);
    if f64::from(light) > SIGMA_MAX {
        return Err(RenderError::TooHot { light });
    }
    medium.glow_majorants = is_unbound.then(|| glow.each_ref().map(|grid| MajorantGrid::new(grid, CellEdge::Four)));
    medium.glow = Some(glow);
    Ok(())
}

/// Gives density detail finer than its voxels, as it is at a time [s].
///
/// # Errors
/// [`RenderError::TooDenseForDetail`] where a voxel of the densest smoke is thicker than [`DETAIL_DEPTH_MAX`].
pub fn add_detail(medium: &mut Medium, settings: &settings::Detail, time: f64) -> Result<(), RenderError> {
    let turbulence = Turbulence::new(&TurbulenceSettings {
        length_scale: settings.length_scale,
        octaves: settings.octaves,
        lacunarity: settings.lacunarity,
        gain: settings.gain,
        spin_rate: settings.spin_rate,
        displacement: settings.displacement,
        scroll: settings.scroll,
        seed: Seed(settings.seed),
        ..Default::default()
    });
    let (strength, contrast) = (settings.strength as f32, settings.contrast);
    let detail = Detail { turbulence: turbulence.at(time), strength, contrast };
    let sigma_max = f64::from(medium.grid().max_density()) * f64::from(medium.extinction() * detail.most());
    let depth = sigma_max * f64::from(medium.grid().voxel_size());
    if depth > DETAIL_DEPTH_MAX {
        return Err(RenderError::TooDenseForDetail { depth });
    }
    medium.detail = Some(Box::new(detail));
    Ok(())
}

/// All pixels of a picture: those of the frame and of its overscan.
pub fn canvas(film: &settings::Film) -> PixelBounds {
    PixelBounds::whole(film.resolution).grown(film.overscan.sides())
}

/// How frame `frame` is taken; `crop` renders a part of it. Of what moves it shows one instant: see [`take_time`].
///
/// # Panics
/// When the camera looks nowhere, which no valid scene does whose camera is at rest; see [`check_camera`].
pub fn build_view(scene: &Scene, frame: i32, crop: Option<PixelBounds>) -> View {
    let settings = &scene.settings;
    let film = &settings.film;
    let seed = Seed(settings.render.seed);
    View {
        camera: CameraCourse::new(scene).at(settings.frames.time(f64::from(frame))).expect("was checked before"),
        shutter: None,
        resolution: film.resolution,
        canvas: canvas(film),
        bounds: crop.unwrap_or(canvas(film)),
        spp: film.spp,
        adaptive: film.noise_target.map(|noise| Adaptive { noise: noise as f32, min_spp: film.min_spp.min(film.spp) }),
        time_limit: film.time_limit.map(Duration::from_secs_f64),
        filter: match film.filter {
            settings::Filter::Box { radius } => Filter::Box { radius: radius as f32 },
            settings::Filter::Triangle { radius } => Filter::triangle(radius as f32),
            settings::Filter::Gaussian { radius } => Filter::gaussian(radius as f32),
            settings::Filter::BlackmanHarris { radius } => Filter::blackman_harris(radius as f32),
        },
        limits: PathLimits { max_bounces: settings.render.max_bounces, roulette_from: settings.render.roulette_from },
        seed: if settings.render.lock_seed { seed } else { seed.derive(frame as u32 as u64) },
        layers: layers(settings),
    }
}

/// How the camera of a scene moves.
pub fn camera_course(scene: &Scene) -> CameraCourse {
    CameraCourse::new(scene)
}

/// Makes sure that the camera of a scene that moves looks somewhere at a frame.
///
/// # Errors
/// [`RenderError::CameraNowhere`] where it does not.
pub fn check_camera(scene: &Scene, frame: i32) -> Result<(), RenderError> {
    CameraCourse::new(scene).at(scene.settings.frames.time(f64::from(frame))).map(|_| ())
}

/// Lets the paths of a view see camera and shapes at times of their own while the shutter is open; a view in which nothing
/// moves then stays as it is.
pub fn take_time(view: &mut View, scene: &Scene, shapes: Shutter) {
    let course = CameraCourse::new(scene);
    let is_instant = [0.0, 1.0].iter().all(|&share| shapes.time(share) == shapes.frame_time());
    if shapes.moves() || (course.varies() && !is_instant) {
        view.shutter = Some(Arc::new(ViewShutter { shapes, camera: course.varies().then_some(course) }));
    }
}

/// The further layers that a scene asks for, each once.
pub(crate) fn layers(settings: &settings::Settings) -> Vec<Layer> {
    let mut layers: Vec<Layer> = Vec::new();
    for aov in &settings.output.aovs {
        let more = match aov {
            Aov::Depth => vec![Layer::Depth],
            Aov::Position => vec![Layer::Position],
            Aov::ShapeId => vec![Layer::ShapeId],
            Aov::Normal => vec![Layer::Normal],
            Aov::Albedo => vec![Layer::Albedo],
            Aov::Motion => vec![Layer::Motion],
            Aov::Variance => vec![Layer::Variance],
            Aov::Transmittance => vec![Layer::Transmittance],
            Aov::VolumeDepth => vec![Layer::VolumeDepth],
            Aov::Passages => Passage::ALL.map(Layer::Light).into(),
            Aov::LightGroups => group_layers(&settings.light_groups()),
            Aov::Cryptomatte => vec![Layer::Cryptomatte(settings.shapes.keys().cloned().collect())],
            Aov::Bounces => vec![Layer::Bounces],
            Aov::NullCollisions => vec![Layer::NullCollisions],
            Aov::Samples => vec![Layer::Samples],
        };
        for layer in more {
            if !layers.contains(&layer) {
                layers.push(layer);
            }
        }
    }
    layers
}
