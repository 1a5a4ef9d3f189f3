//! The grid's hot routines: splatting particles, reading densities, stepping through majorants.

use crate::light::{rays, smoke};
use crate::workload::Workload;
use curlsmoke::grid::DensityGrid;
use curlsmoke::grid::majorant::{CellEdge, MajorantGrid, MajorantIterator};
use curlsmoke::grid::soft::ObstacleDistance;
use curlsmoke::grid::splat::{SplatInput, SplatSettings, splat};
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::space::{IndexPoint, UnitVec3, WorldPoint};
use glam::{DVec3, UVec3, Vec3};
use std::hint::black_box;

const LIMIT: u64 = 1 << 30;
const LOOKUPS: usize = 1 << 16;
/// Lookups on one ray, evenly over the smoke.
const LOOKUPS_A_RAY: usize = 64;
/// How far walks go through occupied cells [m].
pub const FAR: f32 = 1.6;
/// See [`FAR`].
pub const NEAR: f32 = 0.8;

fn look_up(points: impl FnOnce(&DensityGrid) -> Vec<IndexPoint>) -> Workload {
    let grid = smoke();
    let points = points(&grid);
    Workload::new(points.len(), move || {
        black_box(black_box(&points).iter().map(|&p| grid.density_at(p)).sum::<f32>());
    })
}

/// Densities anywhere, in no order.
pub fn scattered_lookups() -> Workload {
    let mut rng = CounterRng::new(Seed(2));
    let mut point = || Vec3::new(rng.uniform(), rng.uniform(), rng.uniform()) * 2.0 - 1.0;
    look_up(|grid| (0..LOOKUPS).map(|_| grid.to_index(WorldPoint(point()))).collect())
}

/// Densities along rays.
pub fn lookups() -> Workload {
    let along = |grid: &DensityGrid| {
        let rays = rays().into_iter().take(LOOKUPS / LOOKUPS_A_RAY);
        rays.flat_map(|r| {
            let line = grid.ray_to_index(r.origin, r.direction);
            let t = ((Vec3::ZERO - r.origin.0).dot(*r.direction) - 1.0).max(0.0);
            (0..LOOKUPS_A_RAY).map(move |i| line.at(t + 2.0 * i as f32 / LOOKUPS_A_RAY as f32))
        })
        .collect()
    };
    look_up(along)
}

/// Walks of the given rays as far as `t_max`; an operation is a segment.
fn walk_along(majorants: MajorantGrid, rays: Vec<(WorldPoint, UnitVec3)>, t_max: f32) -> Workload {
    let walk = move |majorants: &MajorantGrid, o: WorldPoint, d: UnitVec3| -> (usize, f32) {
        MajorantIterator::new(majorants, o, d, 0.0, t_max)
            .fold((0, 0.0), |(count, sum), s| (count + 1, sum + (s.t1 - s.t0) * s.density_max))
    };
    let segments = rays.iter().map(|&(o, d)| walk(&majorants, o, d).0).sum();
    Workload::new(segments, move || {
        black_box(black_box(&rays).iter().map(|&(o, d)| walk(&majorants, o, d).1).sum::<f32>());
    })
}

/// Walks through the bounds of the smoke, empty parts and all.
pub fn walk() -> Workload {
    let rays = rays().into_iter().map(|r| (r.origin, r.direction)).collect();
    walk_along(MajorantGrid::new(&smoke(), CellEdge::Eight), rays, f32::INFINITY)
}

/// Walks from the middle of one face through cells that are all occupied, so that each is a segment.
pub fn full_walk(t_max: f32) -> Workload {
    let corner = WorldPoint::new(-1.0, -1.0, -1.0);
    let full = DensityGrid::from_fn(corner, 1.0 / 64.0, UVec3::splat(128), LIMIT, |_| 1.0).expect("within the limit");
    // Before the face, within a right angle: all of them are inside for at least `FAR`.
    let start = WorldPoint::new(0.0, 0.0, 0.99);
    let inward = |d: UnitVec3| UnitVec3::try_new(Vec3::new(d.x * 0.5, d.y * 0.5, -1.0)).expect("not zero");
    let rays = rays().into_iter().map(|r| (start, inward(r.direction))).collect();
    walk_along(MajorantGrid::new(&full, CellEdge::Eight), rays, t_max)
}

/// The bounds themselves.
pub fn majorants() -> Workload {
    let grid = smoke();
    Workload::new(1 << 21, move || {
        black_box(MajorantGrid::new(black_box(&grid), CellEdge::Eight));
    })
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

/// Particles in a cube of half a metre with kernels of `radius` [voxels], smeared over `shutter` [s], perhaps near walls.
pub fn splatting(radius: f32, shutter: f64, is_soft: bool) -> Workload {
    const COUNT: usize = 25_000;
    const VOXEL: f32 = 0.01;
    let mut rng = CounterRng::new(Seed(3));
    let mut column = |scale: f32| (0..COUNT).map(|_| (rng.uniform() - 0.5) * scale).collect::<Vec<f32>>();
    let position: [Vec<f32>; 3] = std::array::from_fn(|_| column(0.5));
    let velocity: [Vec<f32>; 3] = std::array::from_fn(|_| column(4.0));
    let (mass, radius) = (vec![1e-5; COUNT], vec![radius * VOXEL; COUNT]);
    let settings = SplatSettings {
        voxel_size: VOXEL,
        shutter_seconds: [0.0, shutter],
        soft_radius: None,
        memory_limit_bytes: LIMIT,
    };
    Workload::new(COUNT, move || {
        let input = SplatInput {
            position: position.each_ref().map(Vec::as_slice),
            velocity: velocity.each_ref().map(Vec::as_slice),
            bends: None,
            mass: &mass,
            radius: &radius,
            carried: &[],
            obstacles: is_soft.then_some(&Balls as &dyn ObstacleDistance),
        };
        black_box(splat(&input, &settings).expect("within the limit"));
    })
}

/// Memory of the smoke's voxels [bytes].
pub fn memory_bytes() -> usize {
    smoke().memory_bytes() as usize
}
