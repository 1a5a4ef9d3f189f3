//! Tracking through lumpy smoke: one collision, one transmittance, one whole path.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use curlsmoke::geometry::embree::{Ray, SceneBuilder};
use curlsmoke::grid::DensityGrid;
use curlsmoke::math::hash::Seed;
use curlsmoke::math::space::{UnitVec3, WorldPoint};
use curlsmoke::render::environment::Environment;
use curlsmoke::render::film::PathCounts;
use curlsmoke::render::integrator::{Integrator, PathLimits};
use curlsmoke::render::light::Light;
use curlsmoke::render::medium::Medium;
use curlsmoke::render::phase::Phase;
use curlsmoke::render::sampler::{Sampler, Stream};
use curlsmoke::render::sun::Sun;
use curlsmoke::render::tracking::{estimate_transmittance, sample_collision};
use curlsmoke::render::world::World;
use glam::{UVec3, Vec3};
use std::hint::black_box;

const RAYS: u32 = 4096;

fn medium() -> Medium {
    let origin = WorldPoint::new(-1.0, -1.0, -1.0);
    let grid = DensityGrid::from_fn(origin, 1.0 / 64.0, UVec3::splat(128), 1 << 30, |p| {
        let q = p.0 * 6.0;
        (q.x.sin() + q.y.sin() + q.z.sin() - 0.8).max(0.0)
    })
    .expect("small");
    Medium::new(grid, 20.0, Vec3::splat(0.9), Phase::HenyeyGreenstein { g: 0.3 })
}

fn ray(i: u32) -> Ray {
    let seed = Seed(5).derive(u64::from(i));
    let target = Vec3::new(seed.uniform(0), seed.uniform(1), seed.uniform(2)) * 2.0 - 1.0;
    let origin = Vec3::new(0.5, 0.4, 4.0);
    Ray { origin: WorldPoint(origin), direction: UnitVec3::try_new(target - origin).expect("apart") }
}

fn tracking(c: &mut Criterion) {
    let medium = medium();
    let rays: Vec<Ray> = (0..RAYS).map(ray).collect();
    let mut group = c.benchmark_group("tracking");
    group.throughput(Throughput::Elements(u64::from(RAYS)));
    group.bench_function("collision", |b| {
        b.iter(|| {
            for (i, ray) in rays.iter().enumerate() {
                let mut stream = Stream::new(Seed(1).derive(i as u64));
                let u = stream.uniform();
                black_box(sample_collision(&medium, ray, f32::INFINITY, u, &mut stream, None));
            }
        });
    });
    group.bench_function("transmittance", |b| {
        b.iter(|| {
            for (i, ray) in rays.iter().enumerate() {
                let mut stream = Stream::new(Seed(1).derive(i as u64));
                black_box(estimate_transmittance(&medium, ray, f32::INFINITY, &mut stream));
            }
        });
    });
    let lights = vec![
        Light::Sun(Sun::new(-UnitVec3::Y, Vec3::splat(3.0), 0.0, false)),
        Light::Environment(Environment::constant(Vec3::splat(0.5), true)),
    ];
    let surfaces = SceneBuilder::new().commit().expect("Embree; run ./bootstrap.sh");
    let world = World::new(surfaces, Vec::new(), lights, WorldPoint::default());
    let limits = PathLimits { max_bounces: 64, roulette_from: 8 };
    let integrator = Integrator { world: &world, media: Some(&medium).into(), sun_shadows: Default::default(), limits };
    group.bench_function("path", |b| {
        b.iter(|| {
            for (i, ray) in rays.iter().enumerate() {
                let mut sampler = Sampler::new(Seed(1), i as u32, 0, 0);
                black_box(integrator.trace(*ray, &mut sampler, &mut PathCounts::default()));
            }
        });
    });
    group.finish();
}

criterion_group!(benches, tracking);
criterion_main!(benches);
