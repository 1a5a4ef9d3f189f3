//! The grid's hot routines: splatting particles, reading densities, stepping through majorants.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use curlsmoke::grid::DensityGrid;
use curlsmoke::grid::majorant::{CellEdge, MajorantGrid, MajorantIterator};
use curlsmoke::grid::soft::ObstacleDistance;
use curlsmoke::grid::splat::{SplatInput, SplatSettings, splat};
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::space::{IndexPoint, UnitVec3, WorldPoint};
use glam::{DVec3, UVec3, Vec3};
use std::hint::black_box;

const VOXELS: u32 = 192;
const LIMIT: u64 = 1 << 30;

/// Wisps that fill a third of a cube of 1 m.
fn wisps() -> DensityGrid {
    let h = 1.0 / VOXELS as f32;
    DensityGrid::from_fn(WorldPoint::default(), h, UVec3::splat(VOXELS), LIMIT, |p| {
        let q = p.0 * 9.0;
        let swirl =
            (q.x + (q.y * 0.7).sin() * 2.0).sin() + (q.y + (q.z * 0.9).cos() * 2.0).sin() + (q.z + q.x.sin()).cos();
        let edge = (0.5 - (p.0 - 0.5).length()).max(0.0) * 4.0;
        (swirl - 0.3).max(0.0) * edge
    })
    .expect("within the limit")
}

fn rays(count: usize) -> Vec<(WorldPoint, UnitVec3)> {
    let mut rng = CounterRng::new(Seed(1));
    let mut point = || Vec3::new(rng.uniform(), rng.uniform(), rng.uniform());
    (0..count)
        .filter_map(|_| {
            let (from, to) = (point() * 4.0 - 1.5, point() * 0.6 + 0.2);
            UnitVec3::try_new(to - from).map(|d| (WorldPoint(from), d))
        })
        .collect()
}

fn lookup(c: &mut Criterion) {
    let grid = wisps();
    let mut rng = CounterRng::new(Seed(2));
    let scattered: Vec<IndexPoint> = (0..65_536)
        .map(|_| grid.to_index(WorldPoint(Vec3::new(rng.uniform(), rng.uniform(), rng.uniform()))))
        .collect();
    let along: Vec<IndexPoint> = rays(1024)
        .into_iter()
        .flat_map(|(o, d)| {
            let ray = grid.ray_to_index(o, d);
            let t = ((Vec3::splat(0.5) - o.0).dot(*d) - 0.5).max(0.0);
            (0..64).map(move |i| ray.at(t + i as f32 / 64.0))
        })
        .collect();
    let mut group = c.benchmark_group("lookup");
    group.throughput(Throughput::Elements(65_536));
    for (name, points) in [("scattered", &scattered), ("along rays", &along)] {
        group.bench_function(name, |b| b.iter(|| points.iter().map(|&p| grid.density_at(p)).sum::<f32>()));
    }
}

fn majorant(c: &mut Criterion) {
    let grid = wisps();
    let majorants = MajorantGrid::new(&grid, CellEdge::Four);
    let rays = rays(4096);
    let walk = |(o, d): &(WorldPoint, UnitVec3)| MajorantIterator::new(&majorants, *o, *d, 0.0, f32::INFINITY);
    let segments: usize = rays.iter().map(|r| walk(r).count()).sum();
    let mut group = c.benchmark_group("majorant");
    group.throughput(Throughput::Elements(segments as u64));
    group.bench_function("segments", |b| {
        b.iter(|| rays.iter().flat_map(walk).map(|s| (s.t1 - s.t0) * s.density_max).sum::<f32>())
    });
    group.throughput(Throughput::Elements(rays.len() as u64));
    group.bench_function("rays", |b| {
        b.iter(|| rays.iter().flat_map(walk).map(|s| (s.t1 - s.t0) * s.density_max).sum::<f32>())
    });
    group.throughput(Throughput::Elements(u64::from(VOXELS).pow(3)));
    group.sample_size(20).bench_function("build", |b| b.iter(|| MajorantGrid::new(black_box(&grid), CellEdge::Four)));
}

/// Balls that a tenth of the particles are near.
#[derive(Debug)]
struct Balls;

impl ObstacleDistance for Balls {
    fn distances(&self, points: &[DVec3], distances: &mut [f64]) {
        for (p, d) in points.iter().zip(distances) {
            let cell = (p * 2.5).fract_gl() - 0.5;
            *d = cell.length() / 2.5 - 0.05;
        }
    }
}

fn splatting(c: &mut Criterion) {
    let mut rng = CounterRng::new(Seed(3));
    const COUNT: usize = 200_000;
    const VOXEL: f32 = 0.01;
    let mut column = |scale: f32| (0..COUNT).map(|_| (rng.uniform() - 0.5) * scale).collect::<Vec<f32>>();
    let position: [Vec<f32>; 3] = std::array::from_fn(|_| column(1.0));
    let velocity: [Vec<f32>; 3] = std::array::from_fn(|_| column(4.0));
    let mass = vec![1e-5; COUNT];
    let mut group = c.benchmark_group("splat");
    group.throughput(Throughput::Elements(COUNT as u64)).sample_size(10);
    for (name, radius, shutter, obstacles) in [
        ("radius 1.5", 1.5, 0.0, None),
        ("radius 3", 3.0, 0.0, None),
        ("radius 3, soft", 3.0, 0.0, Some(&Balls as &dyn ObstacleDistance)),
        ("radius 1.5, smeared", 1.5, 0.02, None),
    ] {
        let radius = vec![radius * VOXEL; COUNT];
        let input = SplatInput {
            position: position.each_ref().map(Vec::as_slice),
            velocity: velocity.each_ref().map(Vec::as_slice),
            mass: &mass,
            radius: &radius,
            obstacles,
        };
        let settings = SplatSettings {
            voxel_size: VOXEL,
            shutter_seconds: [0.0, shutter],
            soft_radius: None,
            memory_limit_bytes: LIMIT,
        };
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            group.bench_with_input(BenchmarkId::new(name, threads), &threads, |b, _| {
                b.iter(|| pool.install(|| splat(&input, &settings)));
            });
        }
    }
}

criterion_group!(benches, lookup, majorant, splatting);
criterion_main!(benches);
