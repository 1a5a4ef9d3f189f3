//! Tracking through lumpy smoke: collisions, transmittances, whole paths, a picture of them.

use crate::workload::Workload;
use curlsmoke::geometry::embree::{Ray, SceneBuilder};
use curlsmoke::grid::DensityGrid;
use curlsmoke::math::hash::Seed;
use curlsmoke::math::lattice::Lattice;
use curlsmoke::math::space::{UnitVec3, WorldPoint};
use curlsmoke::progress::Silent;
use curlsmoke::render::camera::{Camera, Projection};
use curlsmoke::render::environment::Environment;
use curlsmoke::render::film::{PathCounts, PixelBounds};
use curlsmoke::render::filter::Filter;
use curlsmoke::render::integrator::{Integrator, PathLimits};
use curlsmoke::render::light::Light;
use curlsmoke::render::medium::Medium;
use curlsmoke::render::phase::Phase;
use curlsmoke::render::sampler::{Sampler, Stream};
use curlsmoke::render::sun::Sun;
use curlsmoke::render::sun_shadow::SunShadows;
use curlsmoke::render::tiles::{View, render};
use curlsmoke::render::tracking::{estimate_transmittance, sample_collision};
use curlsmoke::render::world::World;
use glam::{UVec3, Vec3};
use std::f32::consts::FRAC_1_PI;
use std::hint::black_box;

const RAYS: u32 = 4096;
/// Extinction of density 1 [1/m].
const EXTINCTION: f32 = 20.0;
/// Extinction at which there is next to no null collision in [`spikes`], so that the walk is all there is [1/m].
pub const THIN: f32 = 0.01;
/// Extinction at which there are some ten null collisions on a ray [1/m].
pub const THICK: f32 = 5.0;
/// Most scatterings of a path, which none comes near.
pub const MAX_BOUNCES: u32 = 64;

/// A cube of 2 m, a third of it filled.
pub fn smoke() -> DensityGrid {
    const EDGE: u32 = 128;
    // Tables, so that callgrind does not spend its time on sines of millions of voxels.
    let wave: Vec<f32> = (0..EDGE).map(|i| (6.0 * ((i as f32 + 0.5) / 64.0 - 1.0)).sin()).collect();
    let rows = wave.iter().flat_map(|z| wave.iter().map(move |y| y + z - 0.8));
    let values = rows.flat_map(|yz| wave.iter().map(move |x| (x + yz).max(0.0))).collect();
    let values = Lattice::from_values(UVec3::splat(EDGE), values);
    DensityGrid::from_dense(WorldPoint::new(-1.0, -1.0, -1.0), 1.0 / 64.0, &values, 1 << 30).expect("within the limit")
}

/// One voxel in 64 is full and all bounds are, so that next to all collisions are null, weigh nearly 1 and are followed by more:
/// in other smoke roulette soon ends what they make dim, and takes its walk along.
fn spikes() -> DensityGrid {
    let is_spike = |p: Vec3| ((p + 1.0) * 32.0).as_uvec3() % 4 == UVec3::ONE;
    let density = |p: WorldPoint| f32::from(u8::from(is_spike(p.0)));
    let corner = WorldPoint::new(-1.0, -1.0, -1.0);
    DensityGrid::from_fn(corner, 1.0 / 32.0, UVec3::splat(64), 1 << 30, density).expect("within the limit")
}

fn medium() -> Medium {
    Medium::new(smoke(), EXTINCTION, Vec3::splat(0.9), Phase::HenyeyGreenstein { g: 0.3 })
}

/// From a camera before the cube to anywhere in it.
pub fn rays() -> Vec<Ray> {
    (0..RAYS).map(ray).collect()
}

fn ray(i: u32) -> Ray {
    let seed = Seed(5).derive(u64::from(i));
    let target = Vec3::new(seed.uniform(0), seed.uniform(1), seed.uniform(2)) * 2.0 - 1.0;
    let origin = Vec3::new(0.5, 0.4, 4.0);
    Ray { origin: WorldPoint(origin), direction: UnitVec3::try_new(target - origin).expect("apart") }
}

/// Free flights.
pub fn collisions() -> Workload {
    let (medium, rays) = (medium(), rays());
    Workload::new(rays.len(), move || {
        for (i, ray) in rays.iter().enumerate() {
            let mut stream = Stream::new(Seed(1).derive(i as u64));
            let u = stream.uniform();
            black_box(sample_collision(&medium, ray, f32::INFINITY, u, &mut stream, None));
        }
    })
}

fn transmit(medium: &Medium, rays: &[Ray]) -> u64 {
    let mut null_collisions = 0;
    for (i, ray) in rays.iter().enumerate() {
        let mut stream = Stream::new(Seed(1).derive(i as u64));
        black_box(estimate_transmittance(medium, ray, f32::INFINITY, &mut stream));
        null_collisions += u64::from(stream.null_collisions);
    }
    null_collisions
}

/// Connections to a light beyond the smoke.
pub fn transmittances() -> Workload {
    let (medium, rays) = (medium(), rays());
    Workload::new(rays.len(), move || {
        transmit(&medium, &rays);
    })
}

/// The lattice that says how much of a sun's light reaches where.
pub fn sun_shadow() -> Workload {
    let (world, medium) = (world(), medium());
    Workload::new(1, move || {
        black_box(SunShadows::new(&world.lights, std::iter::once(&medium)));
    })
}

/// Connections from within the smoke to a sun, by its lattice.
pub fn sun_transmittances() -> Workload {
    let (world, medium) = (world(), medium());
    let sun_shadows = SunShadows::new(&world.lights, std::iter::once(&medium));
    Workload::new(RAYS as usize, move || {
        let shadow = sun_shadows.towards(0, 0.25 * FRAC_1_PI).of_volume(0).expect("there is smoke");
        for i in 0..RAYS {
            let seed = Seed(5).derive(u64::from(i));
            let origin = WorldPoint(Vec3::new(seed.uniform(0), seed.uniform(1), seed.uniform(2)) * 2.0 - 1.0);
            let ray = Ray { origin, direction: UnitVec3::Y };
            black_box(shadow.estimate_transmittance(&medium, &ray, &mut Stream::new(seed)));
        }
    })
}

/// Connections through [`spikes`]; an operation is a null collision.
pub fn null_collisions(extinction: f32) -> Workload {
    let medium = Medium::new(spikes(), extinction, Vec3::ONE, Phase::HenyeyGreenstein { g: 0.0 });
    let rays = rays();
    let operations = transmit(&medium, &rays);
    Workload::new(operations as usize, move || {
        transmit(&medium, &rays);
    })
}

fn world() -> World {
    let lights = vec![
        Light::Sun(Sun::new(-UnitVec3::Y, Vec3::splat(3.0), 0.0, false)),
        Light::Environment(Environment::constant(Vec3::splat(0.5), true)),
    ];
    let surfaces = SceneBuilder::new().commit().expect("Embree; run ./bootstrap.sh");
    World::new(surfaces, Vec::new(), lights)
}

fn trace(world: &World, medium: &Medium, sun_shadows: &SunShadows, rays: &[Ray], max_bounces: u32) -> PathCounts {
    let limits = PathLimits { max_bounces, roulette_from: 8 };
    let integrator = Integrator { world, media: Some(medium).into(), sun_shadows, limits, moment: Default::default() };
    let mut counts = PathCounts::default();
    for (i, ray) in rays.iter().enumerate() {
        let mut sampler = Sampler::new(Seed(1), i as i32, 0, 0);
        black_box(integrator.trace(*ray, &mut sampler, &mut counts));
    }
    counts
}

/// Paths from the camera to their ends.
pub fn paths(max_bounces: u32) -> Workload {
    let (world, medium, rays) = (world(), medium(), rays());
    let sun_shadows = SunShadows::new(&world.lights, std::iter::once(&medium));
    Workload::new(rays.len(), move || {
        trace(&world, &medium, &sun_shadows, &rays, max_bounces);
    })
}

/// As [`paths`]; an operation is a scattering.
pub fn vertices(max_bounces: u32) -> Workload {
    let (world, medium, rays) = (world(), medium(), rays());
    let sun_shadows = SunShadows::new(&world.lights, std::iter::once(&medium));
    let operations = trace(&world, &medium, &sun_shadows, &rays, max_bounces).bounces;
    Workload::new(operations as usize, move || {
        trace(&world, &medium, &sun_shadows, &rays, max_bounces);
    })
}

/// A picture of the smoke, in tiles.
pub fn picture() -> Workload {
    const RESOLUTION: [u32; 2] = [128, 128];
    const SPP: u32 = 16;
    let (world, medium) = (world(), medium());
    let eye = WorldPoint::new(0.5, 0.4, 4.0);
    let projection = Projection::Perspective { vertical_fov_deg: 36.0 };
    let view = View {
        camera: Camera::try_new(eye, WorldPoint::default(), Vec3::Y, projection, None, RESOLUTION).expect("apart"),
        shutter: None,
        resolution: RESOLUTION,
        canvas: PixelBounds::whole(RESOLUTION),
        bounds: PixelBounds::whole(RESOLUTION),
        spp: SPP,
        adaptive: None,
        time_limit: None,
        filter: Filter::blackman_harris(1.5),
        limits: PathLimits { max_bounces: MAX_BOUNCES, roulette_from: 8 },
        seed: Seed(1),
        layers: Vec::new(),
    };
    Workload::new((RESOLUTION[0] * RESOLUTION[1] * SPP) as usize, move || {
        black_box(render(&view, &world, Some(&medium), &Silent).expect("nobody cancels it"));
    })
}
