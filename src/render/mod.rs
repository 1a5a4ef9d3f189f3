//! Light through smoke.
//!
//! This file turns settings into camera, lights and media; `integrator.rs` traces paths, `tiles.rs` takes pictures.

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
pub mod glow;
pub mod image_texture;
pub mod integrator;
pub mod layers;
pub mod light;
pub mod light_path;
pub mod material;
pub mod media;
pub mod medium;
pub mod panel;
pub mod phase;
pub mod picture;
pub mod sampler;
pub mod spot;
pub mod sun;
pub mod surface_keys;
pub mod surface_light;
pub mod texture;
pub mod through;
pub mod tiles;
pub mod tracking;
pub mod vertex;
pub mod world;

use crate::flow::reproject::{Integrator, Repetition, Reprojection, Trace};
use crate::flow::surface::{CacheSettings, SurfaceFlow, SurfaceFlowSettings};
use crate::flow::turbulence::{Turbulence, TurbulenceSettings};
use crate::geometry::embree::TraceScene;
use crate::geometry::primitive::Primitive;
use crate::geometry::sdf::{PlacedSdf, Sdf};
use crate::geometry::{Geometry, Shape};
use crate::grid::DensityGrid;
use crate::grid::majorant::MajorantGrid;
use crate::math::hash::Seed;
use crate::math::space::{UnitVec3, WorldPoint};
use crate::render::adaptive::Adaptive;
use crate::render::atmosphere::{Atmosphere, SUN_DIAMETER_DEG, direction_to_sun};
use crate::render::ball::Ball;
use crate::render::bsdf::conductor::{Metal, MetalColor};
use crate::render::bsdf::dielectric::Glass;
use crate::render::bsdf::metals::{self, Index};
use crate::render::bsdf::plastic::Plastic;
use crate::render::bsdf::principled::{Principled, PrincipledSettings};
use crate::render::camera::{Camera, Lens};
use crate::render::detail::Detail;
use crate::render::environment::Environment;
use crate::render::even::EvenMedium;
use crate::render::film::PixelBounds;
use crate::render::filter::Filter;
use crate::render::image_texture::{ImageTexture, LatLong, Planar, Projection, Triplanar};
use crate::render::integrator::PathLimits;
use crate::render::layers::{Layer, group_layers};
use crate::render::light::Light;
use crate::render::light_path::{EMISSION_GROUP, OTHER_GROUP, Passage};
use crate::render::material::{Material, MaterialKind, Sight};
use crate::render::medium::{Matter, Medium};
use crate::render::panel::{Outline, Panel};
use crate::render::phase::Phase;
use crate::render::picture::Picture;
use crate::render::spot::Spot;
use crate::render::sun::Sun;
use crate::render::surface_keys::{FlowState, state_at};
use crate::render::surface_light::SurfaceLight;
use crate::render::texture::{FlowNoise, Ramp, Texture};
use crate::render::tiles::View;
use crate::render::world::World;
use crate::scene::settings::Aov;
use crate::scene::{Scene, settings};
use glam::{DQuat, DVec3, Vec3};
use std::collections::BTreeMap;
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
        x: u32,
        /// Row.
        y: u32,
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

/// Width and height of the picture of a clear sky: haze about the sun and the rim of the earth take the most.
const SKY_SIZE: [usize; 2] = [512, 256];

/// What the textures of a scene keep from frame to frame.
#[derive(Debug)]
pub struct TextureStore {
    /// Pictures by the names of their files.
    pictures: BTreeMap<String, Arc<Picture>>,
    /// Of each shape, the flow along its surface as it was last.
    flows: Vec<Option<Arc<SurfaceFlow>>>,
}

impl TextureStore {
    /// Reads the pictures of all textures, each once.
    ///
    /// # Errors
    /// [`RenderError::Texture`] for the first that cannot be used: missing, faulty, no light, or as a reflectance above 1.
    pub fn load(scene: &Scene, load: LoadPicture) -> Result<Self, RenderError> {
        let mut store = Self { pictures: BTreeMap::new(), flows: vec![None; scene.settings.shapes.len()] };
        let limit = (scene.settings.render.memory_limit_gib * f64::from(1 << 30)) as u64;
        for (name, shape) in &scene.settings.shapes {
            for (slot, texture) in shape.material.textures() {
                let settings::Texture::Image(image) = texture else { continue };
                let key = format!("shapes.{name}.material.{slot}.image.file");
                let is_reflectance = !slot.ends_with(".emission");
                store
                    .picture(scene, image, is_reflectance, load, limit)
                    .map_err(|e| RenderError::Texture { key, source: Box::new(e) })?;
            }
        }
        Ok(store)
    }

    fn picture(
        &mut self,
        scene: &Scene,
        image: &settings::ImageTexture,
        is_reflectance: bool,
        load: LoadPicture,
        limit: u64,
    ) -> Result<(), RenderError> {
        let path = scene.resolve(&image.file);
        let no_light = |problem| RenderError::NoLight { path: path.clone(), problem };
        if !self.pictures.contains_key(&image.file) {
            let picture = load(&path).map_err(RenderError::Picture)?;
            picture.check(if is_reflectance { "a reflectance" } else { "radiance" }).map_err(no_light)?;
            self.pictures.insert(image.file.clone(), Arc::new(picture));
            let needed = self.pictures.values().map(|p| size_of_val(p.pixels.as_slice()) as u64).sum();
            if needed > limit {
                return Err(RenderError::TexturesTooLarge { needed, limit });
            }
        }
        let (picture, scale) = (&self.pictures[&image.file], image.scale as f32);
        if is_reflectance { picture.check_reflects(scale) } else { picture.check_glows(scale, SIGMA_MAX as f32) }
            .map_err(no_light)
    }
}

/// Surfaces, materials and lights of a scene: all but the smoke.
///
/// # Errors
/// When Embree refuses the surfaces or a picture of the surroundings cannot be used.
pub fn build_world(
    scene: &Scene,
    geometry: &Geometry,
    materials: Vec<Material>,
    load: LoadPicture,
) -> Result<World, RenderError> {
    debug_assert_eq!(materials.len(), geometry.shapes.len(), "shapes that shine are found by their materials");
    let surfaces = geometry.trace_scene()?;
    let mut lights = build_lights(scene, load)?;
    let shapes = geometry.shapes.iter().zip(&materials).enumerate().filter(|(_, (shape, _))| shape.visible);
    lights.extend(shapes.filter_map(|(i, (shape, material))| glowing_shape(i as u32, shape, material)));
    // What the camera looks at is what is lit.
    let center = world_point(scene.settings.camera.look_at);
    let mut world = World::new(surfaces, materials, lights, center);
    let groups = groups(&scene.settings);
    // Shapes that shine come after the lights of the scene.
    world.groups.fill(EMISSION_GROUP);
    world.groups[..groups.len()].copy_from_slice(&groups);
    Ok(world)
}

/// The number of the group of each light of [`build_lights`], as [`group_layers`] counts them.
fn groups(settings: &settings::Settings) -> Vec<usize> {
    let names = settings.light_groups();
    let number = |light: &settings::Light| {
        let name = light.group()?;
        names.iter().position(|known| known == name)
    };
    let group = |light: &settings::Light| {
        let group = number(light).map_or(OTHER_GROUP, |i| OTHER_GROUP + 1 + i);
        std::iter::repeat_n(group, if sky_with_sun(light).is_some() { 2 } else { 1 })
    };
    settings.lights.iter().flat_map(group).collect()
}

/// A shape as a light, where it gives off the same everywhere and is made of triangles, a ball or a box with sharp edges.
fn glowing_shape(shape_idx: u32, shape: &Shape, material: &Material) -> Option<Light> {
    let Some(Texture::Constant(radiance)) = material.emission else { return None };
    if material.is_one_sided {
        return None;
    }
    if let Some(mesh) = &shape.mesh {
        let corners = (0..mesh.triangles().len()).map(|i| mesh.corners(i));
        return SurfaceLight::triangles(shape_idx, corners, radiance).map(Light::Surface);
    }
    let sdf = shape.sdf.as_ref()?;
    let at = sdf.placement();
    let Sdf::Primitive(primitive) = sdf.sdf() else { return None };
    let surface = match primitive {
        Primitive::Sphere(ball) => {
            let center = at.point_to_world(ball.center.as_vec3());
            Some(SurfaceLight::ball(shape_idx, center, ball.radius as f32 * at.scale, radiance))
        }
        Primitive::Cuboid(cuboid) if cuboid.rounding == 0.0 => {
            let corners = cuboid.triangles().map(|corners| corners.map(|p| at.point_to_world(p.as_vec3()).0));
            SurfaceLight::triangles(shape_idx, corners.into_iter(), radiance)
        }
        _ => None,
    };
    surface.map(Light::Surface)
}

/// The material of each shape, with textures as they are at a time [s]; `geometry` is where shapes are at that time.
pub fn build_materials(scene: &Scene, geometry: &Geometry, store: &mut TextureStore, time: f64) -> Vec<Material> {
    let shapes = scene.settings.shapes.values().zip(&geometry.shapes);
    // A quarter of all memory for all of them.
    let flows = scene.settings.shapes.values().filter(|shape| shape.surface_flow.is_some()).count().max(1);
    let cache_bytes = (scene.settings.render.memory_limit_gib * f64::from(1 << 28)) as u64 / flows as u64;
    let TextureStore { pictures, flows } = store;
    shapes
        .zip(flows)
        .map(|((shape, placed), last)| {
            let color = texture(shape.material.color(), pictures, time);
            let emission = shape.material.emission();
            let emission = (!emission.is_black()).then(|| texture(emission, pictures, time));
            let flow = shape.surface_flow.as_ref().zip(placed.resting.as_ref());
            let flow = flow.map(|(flow, solid)| surface_flow(flow, solid, time, cache_bytes, last));
            Material {
                kind: material_kind(&shape.material),
                color,
                emission,
                moved: placed.moved,
                flow,
                is_one_sided: !shape.two_sided,
                sight: sight(shape),
            }
        })
        .collect()
}

fn sight(shape: &settings::Shape) -> Sight {
    match (shape.invisible_to_camera, shape.holdout, shape.shadow_catcher) {
        (true, ..) => Sight::Through,
        (_, true, _) => Sight::Hole,
        (.., true) => Sight::Shadow,
        _ => Sight::Whole,
    }
}

fn material_kind(material: &settings::Material) -> MaterialKind {
    match material {
        settings::Material::Diffuse(_) => MaterialKind::Diffuse,
        settings::Material::Conductor(c) => {
            let Index { eta, k } = match (c.metal, c.eta, c.k) {
                (None, Some(eta), Some(k)) => Index { eta: vec3(eta), k: vec3(k) },
                (metal, ..) => metal_index(metal.expect("validation refuses conductors without an index")),
            };
            MaterialKind::Conductor {
                metal: Box::new(Metal::new(c.roughness as f32)),
                color: MetalColor::measured(eta, k),
            }
        }
        settings::Material::Dielectric(d) => {
            MaterialKind::Dielectric(Box::new(Glass::new(d.ior as f32, d.roughness as f32)))
        }
        settings::Material::Plastic(p) => {
            MaterialKind::Plastic(Box::new(Plastic::new(p.ior as f32, p.roughness as f32)))
        }
        settings::Material::Principled(p) => MaterialKind::Principled(Box::new(Principled::new(&PrincipledSettings {
            metallic: p.metallic as f32,
            roughness: p.roughness as f32,
            ior: p.ior as f32,
            transmission: p.transmission as f32,
            coat: p.coat as f32,
            coat_roughness: p.coat_roughness as f32,
        }))),
    }
}

fn metal_index(metal: settings::Metal) -> Index {
    match metal {
        settings::Metal::Aluminium => metals::ALUMINIUM,
        settings::Metal::Chromium => metals::CHROMIUM,
        settings::Metal::Copper => metals::COPPER,
        settings::Metal::Gold => metals::GOLD,
        settings::Metal::Iron => metals::IRON,
        settings::Metal::Silver => metals::SILVER,
        settings::Metal::Titanium => metals::TITANIUM,
    }
}

/// The flow along a surface at a time [s]: the last one, if it is the same, with all that was followed of it.
fn surface_flow(
    flow: &settings::SurfaceFlow,
    solid: &Arc<PlacedSdf>,
    time: f64,
    cache_bytes: u64,
    last: &mut Option<Arc<SurfaceFlow>>,
) -> Arc<SurfaceFlow> {
    let settings = surface_flow_settings(flow, time, cache_bytes);
    match last {
        Some(last) if last.is_of(solid, &settings) => last.clone(),
        _ => last.insert(Arc::new(SurfaceFlow::new(solid.clone(), settings))).clone(),
    }
}

fn surface_flow_settings(flow: &settings::SurfaceFlow, time: f64, cache_bytes: u64) -> SurfaceFlowSettings {
    let keys = flow.keys.iter().map(|key| {
        let steps = key.steps.or(flow.steps).map(f64::from);
        let length = key.length_scale.unwrap_or(flow.length_scale);
        (key.time, FlowState { distance: key.distance, length, steps })
    });
    let is_smooth = flow.interpolation == settings::Interpolation::Smooth;
    let own = FlowState {
        distance: flow.distance + flow.speed * time,
        length: flow.length_scale,
        steps: flow.steps.map(f64::from),
    };
    let FlowState { distance, length, steps } = state_at(&keys.collect::<Vec<_>>(), time, is_smooth).unwrap_or(own);
    // So many to a swirl.
    let own_steps = (16.0 * distance.abs() / length).ceil().clamp(16.0, 4096.0) as u32;
    let trace = Trace {
        steps: steps.map_or(own_steps, |steps| steps.round() as u32),
        integrator: match flow.integrator {
            settings::SurfaceIntegrator::Euler => Integrator::Euler,
            settings::SurfaceIntegrator::Rk4 => Integrator::RungeKutta,
        },
        reprojection: Reprojection::Newton(Repetition { steps: flow.reprojections, tolerance: 0.0 }),
    };
    let spacing = flow.cache_spacing.unwrap_or(length / 160.0);
    let cache = (spacing > 0.0).then_some(CacheSettings { spacing, bytes: cache_bytes });
    SurfaceFlowSettings { length, distance, trace, seed: Seed(flow.seed), cache }
}

fn texture(texture: &settings::Texture, pictures: &BTreeMap<String, Arc<Picture>>, time: f64) -> Texture {
    match texture {
        settings::Texture::Constant(color) => Texture::Constant(vec3(*color)),
        settings::Texture::FlowNoise(noise) => flow_noise(noise, time),
        settings::Texture::Stripes(s) => Texture::Stripes { along: s.along, colors: s.colors.map(vec3) },
        settings::Texture::Checker(c) => Texture::Checker { size: c.size, colors: c.colors.map(vec3) },
        settings::Texture::Rings(r) => Texture::Rings { center: r.center, width: r.width, colors: r.colors.map(vec3) },
        settings::Texture::Image(image) => Texture::Image(ImageTexture {
            picture: pictures[&image.file].clone(),
            projection: projection(&image.projection),
            scale: image.scale as f32,
        }),
    }
}

fn projection(projection: &settings::Projection) -> Projection {
    let vector = DVec3::from_array;
    match projection {
        settings::Projection::LatLong(globe) => {
            Projection::LatLong(LatLong::new(vector(globe.center), vector(globe.north), globe.turn_deg))
        }
        settings::Projection::Triplanar(tiles) => Projection::Triplanar(Triplanar {
            tile: tiles.tile,
            offset: vector(tiles.offset),
            sharpness: tiles.sharpness,
        }),
        settings::Projection::Planar(planar) => {
            Projection::Planar(Planar::new(vector(planar.center), vector(planar.half_u), vector(planar.half_v)))
        }
    }
}

fn flow_noise(noise: &settings::FlowNoise, time: f64) -> Texture {
    let turbulence = Turbulence::new(&TurbulenceSettings {
        length_scale: noise.length_scale,
        octaves: noise.octaves,
        lacunarity: noise.lacunarity,
        gain: noise.gain,
        is_folded: noise.folded,
        stretch: noise.stretch,
        spin_rate: noise.spin_rate,
        evolve_rate: noise.evolve_rate,
        displacement: noise.displacement.map(|x| x * noise.memory),
        offset: noise.offset,
        scroll: noise.scroll,
        seed: Seed(noise.seed),
    });
    Texture::FlowNoise(Box::new(FlowNoise {
        turbulence: turbulence.at(time),
        along: noise.along,
        amplitude: noise.amplitude,
        ramp: Ramp::new(noise.ramp.iter().map(|stop| (stop.at, vec3(stop.color))), noise.repeat),
    }))
}

/// The lights of a scene in its order; the sun of a clear sky follows the sky.
///
/// # Errors
/// [`RenderError::Light`] when a picture of the surroundings cannot be used.
pub fn build_lights(scene: &Scene, load: LoadPicture) -> Result<Vec<Light>, RenderError> {
    let mut lights = Vec::new();
    for (light_idx, settings) in scene.settings.lights.iter().enumerate() {
        let built = light(scene, settings, load).map_err(|e| RenderError::Light { light_idx, source: Box::new(e) })?;
        lights.push(built);
        lights.extend(sky_with_sun(settings).map(|(environment, sky)| sun_of(environment, sky)));
    }
    Ok(lights)
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
        container,
        sigma_t: (medium.extinction * most * density) as f32,
        tint: tint(medium),
        emission: vec3(medium.emission) * density as f32,
        matter: Matter { albedo: vec3(medium.albedo), phase: phase(&medium.phase) },
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
    medium.glow_majorants = is_unbound.then(|| glow.each_ref().map(MajorantGrid::new));
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

/// How frame `frame` is taken; `crop` renders a part of it.
///
/// # Panics
/// When the camera looks nowhere, which no valid scene does.
pub fn build_view(scene: &Scene, frame: i32, crop: Option<PixelBounds>) -> View {
    let settings = &scene.settings;
    let (camera, film) = (&settings.camera, &settings.film);
    let seed = Seed(settings.render.seed);
    View {
        camera: Camera::try_new(
            world_point(camera.position),
            world_point(camera.look_at),
            vec3(camera.up),
            camera_projection(camera),
            camera.lens.as_ref().map(|lens| Lens {
                radius: lens.radius as f32,
                focus_distance: lens.focus_distance.unwrap_or_else(|| camera.distance()) as f32,
            }),
            film.resolution,
        )
        .expect("validation refuses cameras that look nowhere"),
        resolution: film.resolution,
        bounds: crop.unwrap_or(PixelBounds::whole(film.resolution)),
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

fn camera_projection(camera: &settings::Camera) -> camera::Projection {
    match camera.projection {
        settings::CameraProjection::Perspective => {
            camera::Projection::Perspective { vertical_fov_deg: camera.vertical_fov_deg as f32 }
        }
        settings::CameraProjection::Orthographic { height } => {
            camera::Projection::Orthographic { height: height as f32 }
        }
        settings::CameraProjection::LatLong => camera::Projection::LatLong,
    }
}

/// The further layers that a scene asks for, each once.
fn layers(settings: &settings::Settings) -> Vec<Layer> {
    let mut layers: Vec<Layer> = Vec::new();
    for aov in &settings.output.aovs {
        let more = match aov {
            Aov::Depth => vec![Layer::Depth],
            Aov::Position => vec![Layer::Position],
            Aov::ShapeId => vec![Layer::ShapeId],
            Aov::Normal => vec![Layer::Normal],
            Aov::Albedo => vec![Layer::Albedo],
            Aov::Variance => vec![Layer::Variance],
            Aov::Transmittance => vec![Layer::Transmittance],
            Aov::VolumeDepth => vec![Layer::VolumeDepth],
            Aov::Passages => Passage::ALL.map(Layer::Light).into(),
            Aov::LightGroups => group_layers(&settings.light_groups()),
            Aov::Cryptomatte => vec![Layer::Cryptomatte(settings.shapes.keys().cloned().collect())],
            Aov::Bounces => vec![Layer::Bounces],
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

fn light(scene: &Scene, light: &settings::Light, load: LoadPicture) -> Result<Light, RenderError> {
    Ok(match light {
        settings::Light::Sun(sun) => Light::Sun(Sun::new(
            UnitVec3::try_new(vec3(sun.direction)).expect("validation refuses directions of length 0"),
            vec3(sun.irradiance),
            sun.angular_diameter_deg,
            sun.visible,
        )),
        settings::Light::Environment(e) => Light::Environment(environment(scene, e, load)?),
        settings::Light::Rectangle(r) => {
            let (center, half_u, half_v) = (world_point(r.center), vec3(r.half_u), vec3(r.half_v));
            let mut panel = Panel::try_new(Outline::Rectangle, center, half_u, half_v, vec3(r.radiance))
                .expect("validation refuses rectangles without area");
            (panel.is_two_sided, panel.is_visible) = (r.two_sided, r.visible);
            Light::Panel(panel)
        }
        settings::Light::Disk(d) => {
            let mut panel = Panel::disk(world_point(d.center), vec3(d.normal), d.radius as f32, vec3(d.radiance))
                .expect("validation refuses disks without a direction");
            (panel.is_two_sided, panel.is_visible) = (d.two_sided, d.visible);
            Light::Panel(panel)
        }
        settings::Light::Sphere(s) => {
            let mut ball = Ball::new(world_point(s.center), s.radius as f32, vec3(s.radiance));
            ball.is_visible = s.visible;
            Light::Ball(ball)
        }
        settings::Light::Spot(s) => Light::Spot(Spot::new(
            world_point(s.position),
            UnitVec3::try_new(vec3(s.direction)).expect("validation refuses directions of length 0"),
            vec3(s.intensity),
            s.cone_deg,
            s.blend,
        )),
        settings::Light::Point(p) => Light::Point { position: world_point(p.position), intensity: vec3(p.intensity) },
    })
}

fn environment(scene: &Scene, e: &settings::Environment, load: LoadPicture) -> Result<Environment, RenderError> {
    let scale = e.scale.unwrap_or(1.0) as f32;
    let is_visible = e.visible.unwrap_or(true);
    if let Some(file) = &e.file {
        let path = scene.resolve(file);
        let fail = |problem| RenderError::NoLight { path: path.clone(), problem };
        let picture = load(&path).map_err(RenderError::Picture)?;
        picture.check("radiance").map_err(fail)?;
        let pixels = picture.pixels.into_iter().map(|p| p * scale).collect();
        return Ok(Environment::picture(picture.width, picture.height, pixels, e.rotate_deg as f32, is_visible));
    }
    if let Some(sky) = &e.sky {
        let pixels = atmosphere(sky).picture(SKY_SIZE[0], SKY_SIZE[1]).into_iter().map(|p| p * scale).collect();
        return Ok(Environment::picture(SKY_SIZE[0], SKY_SIZE[1], pixels, e.rotate_deg as f32, is_visible));
    }
    if let Some(g) = &e.gradient {
        let [zenith, horizon, nadir] = [g.zenith, g.horizon, g.nadir].map(|c| vec3(c) * scale);
        return Ok(Environment::gradient(zenith, horizon, nadir, is_visible));
    }
    Ok(Environment::constant(vec3(e.radiance.unwrap_or([0.0; 3])) * scale, is_visible))
}

fn atmosphere(sky: &settings::Sky) -> Atmosphere {
    let to_sun = direction_to_sun(sky.sun_elevation_deg, sky.sun_azimuth_deg);
    Atmosphere::new(to_sun, sky.turbidity, vec3(sky.ground_albedo))
}

/// The clear sky of a light that comes with its sun.
fn sky_with_sun(light: &settings::Light) -> Option<(&settings::Environment, &settings::Sky)> {
    let settings::Light::Environment(environment) = light else { return None };
    environment.sky.as_ref().filter(|sky| sky.sun).map(|sky| (environment, sky))
}

/// The sun of a clear sky, as much dimmed by the air.
fn sun_of(environment: &settings::Environment, sky: &settings::Sky) -> Light {
    let to_sun = direction_to_sun(sky.sun_elevation_deg, sky.sun_azimuth_deg);
    let turned = DQuat::from_rotation_y(environment.rotate_deg.to_radians()) * to_sun;
    let direction = UnitVec3::new_unchecked(-turned.as_vec3().normalize());
    let irradiance = atmosphere(sky).sun_irradiance() * environment.scale.unwrap_or(1.0) as f32;
    Light::Sun(Sun::new(direction, irradiance, SUN_DIAMETER_DEG, sky.sun_visible))
}

fn vec3(v: [f64; 3]) -> Vec3 {
    Vec3::from(v.map(|x| x as f32))
}

fn world_point(v: [f64; 3]) -> WorldPoint {
    WorldPoint(vec3(v))
}
