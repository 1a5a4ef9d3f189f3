//! Properties of density grids: bounds that bound, walks that end, reads that agree with the definition.

use curlsmoke::grid::DensityGrid;
use curlsmoke::grid::majorant::{MajorantGrid, MajorantIterator};
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::space::{UnitVec3, WorldPoint};
use glam::{IVec3, UVec3, Vec3};

const LIMIT: u64 = 1 << 28;

/// Blobs of noise with empty space around and between them.
fn blobs(voxel_size: f32, origin: WorldPoint) -> DensityGrid {
    let size = Vec3::new(90.0, 61.0, 77.0) * voxel_size;
    DensityGrid::from_fn(origin, voxel_size, UVec3::new(90, 61, 77), LIMIT, |p| {
        let q = (p - origin) / size;
        let blob = |c: Vec3, r: f32| (1.0 - (q - c).length_squared() / (r * r)).max(0.0);
        let jitter = Seed(5).uniform(u64::from((q.x * 1e4) as u32) * 77 + u64::from((q.y * 1e4) as u32) * 31);
        (blob(Vec3::splat(0.2), 0.15) + blob(Vec3::new(0.8, 0.5, 0.7), 0.1)) * (0.1 + jitter)
    })
    .expect("a small grid")
}

fn random_direction(rng: &mut CounterRng) -> UnitVec3 {
    loop {
        let v = Vec3::new(rng.uniform(), rng.uniform(), rng.uniform()) * 2.0 - 1.0;
        // A third of the rays run along an axis or in an axis-aligned plane.
        let mask = match (rng.uniform() * 18.0) as u32 {
            0 => Vec3::X,
            1 => Vec3::Y,
            2 => Vec3::NEG_Z,
            3 => Vec3::new(1.0, 1.0, 0.0),
            4 => Vec3::new(0.0, 1.0, 1.0),
            5 => Vec3::new(1.0, -0.0, 1.0),
            _ => Vec3::ONE,
        };
        if let Some(d) = UnitVec3::try_new(v * mask) {
            return d;
        }
    }
}

/// Walks the ray and checks it against the grid at points of every segment and every gap.
fn check_ray(
    grid: &DensityGrid,
    majorants: &MajorantGrid,
    o: WorldPoint,
    d: UnitVec3,
    t_max: f32,
    rng: &mut CounterRng,
) {
    let ray = grid.ray_to_index(o, d);
    let far = t_max.min(1e4 * grid.voxel_size());
    let peak = grid.max_density();
    let mut end = 0.0;
    let mut gap_is_empty = |from: f32, to: f32, rng: &mut CounterRng| {
        for _ in 0..if to > from { 20 } else { 0 } {
            let t = from + (to - from) * rng.uniform();
            // Rounding of the position may reach over the boundary by a thousandth of a voxel.
            assert!(grid.density_at(ray.at(t)) <= 3e-3 * peak, "density outside all segments, {o:?} {d:?} t={t}");
        }
    };
    for (count, s) in MajorantIterator::new(majorants, o, d, 0.0, t_max).enumerate() {
        assert!(count < 10_000, "the walk does not end");
        assert!(s.t0 >= end && s.t1 > s.t0 && s.t1 <= t_max, "{s:?} after {end}");
        assert!(s.density_max > 0.0 && s.density_max <= majorants.max_density());
        gap_is_empty(end, s.t0, rng);
        for i in 0..8 {
            let t = s.t0 + (s.t1 - s.t0) * [0.0, 1.0, rng.uniform()][i.min(2)];
            let density = grid.density_at(ray.at(t));
            assert!(density <= s.density_max, "{density} above {s:?} at {t}, {o:?} {d:?}");
        }
        end = s.t1;
    }
    gap_is_empty(end, far, rng);
}

#[test]
fn densities_never_exceed_the_majorant_of_their_segment_and_are_zero_in_the_gaps() {
    let mut rng = CounterRng::new(Seed(11));
    for (voxel_size, origin) in [(0.05, WorldPoint::new(-2.0, 0.3, 7.0)), (1.0, WorldPoint::default())] {
        let grid = blobs(voxel_size, origin);
        let majorants = MajorantGrid::new(&grid);
        assert!(majorants.max_density() >= grid.max_density());
        let bounds = grid.bounds();
        for i in 0..8000 {
            let u = Vec3::new(rng.uniform(), rng.uniform(), rng.uniform());
            let mut target = WorldPoint(bounds.min + u * bounds.size());
            if i % 4 == 0 {
                // On the faces between cells, and on the boundary.
                target = origin + ((target - origin) / (4.0 * voxel_size)).round() * 4.0 * voxel_size;
            }
            let direction = random_direction(&mut rng);
            let back = if i % 3 == 0 { 0.0 } else { 120.0 * voxel_size * rng.uniform() };
            let t_max = if i % 2 == 0 { f32::INFINITY } else { 100.0 * voxel_size * rng.uniform() };
            check_ray(&grid, &majorants, target - *direction * back, direction, t_max, &mut rng);
        }
    }
}

#[test]
fn a_walk_covers_the_whole_of_a_full_grid_without_gaps() {
    let grid = DensityGrid::from_fn(WorldPoint::default(), 0.1, UVec3::splat(64), LIMIT, |_| 2.0).expect("small");
    let majorants = MajorantGrid::new(&grid);
    let segments: Vec<_> = MajorantIterator::new(
        &majorants,
        WorldPoint::new(-5.0, 3.3, 3.3),
        UnitVec3::try_new(Vec3::X).expect("unit"),
        0.0,
        1e9,
    )
    .collect();
    assert!(segments.windows(2).all(|w| w[0].t1 == w[1].t0));
    let (first, last) = (segments[0].t0, segments[segments.len() - 1].t1);
    assert!(first <= 5.0 - 0.05 && first > 4.0 && last >= 11.4 && last < 12.3, "{first} {last}");
    assert!(segments.iter().all(|s| s.density_max >= 2.0 && s.density_max < 2.00001));
}

#[test]
fn walks_end_at_once_on_nonsense_and_on_empty_grids() {
    let full = DensityGrid::from_fn(WorldPoint::default(), 1.0, UVec3::splat(9), LIMIT, |_| 1.0).expect("small");
    let none = DensityGrid::from_fn(WorldPoint::default(), 1.0, UVec3::splat(9), LIMIT, |_| 0.0).expect("small");
    let inside = WorldPoint::new(4.0, 4.0, 4.0);
    assert_eq!(MajorantIterator::new(&MajorantGrid::new(&none), inside, UnitVec3::Y, 0.0, f32::INFINITY).count(), 0);
    let majorants = MajorantGrid::new(&full);
    for t_max in [0.0, -1.0, f32::NAN] {
        assert_eq!(MajorantIterator::new(&majorants, inside, UnitVec3::Y, 0.0, t_max).count(), 0);
    }
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30] {
        for axis in 0..3 {
            let mut origin = inside;
            origin.0[axis] = bad;
            assert!(MajorantIterator::new(&majorants, origin, UnitVec3::Y, 0.0, f32::INFINITY).count() < 100);
        }
    }
}

#[test]
fn a_dense_lattice_reads_back_voxel_by_voxel() {
    let grid = blobs(0.5, WorldPoint::default());
    let total: f64 = grid
        .occupied_bricks()
        .flat_map(|(brick, values)| {
            let grid = &grid;
            values.into_iter().enumerate().map(move |(i, v)| {
                let voxel = brick * 8 + curlsmoke::grid::local_voxel(i).as_ivec3();
                assert_eq!(grid.voxel(voxel), v);
                assert!(voxel.cmpge(IVec3::ZERO).all() && voxel.cmplt(IVec3::new(90, 61, 77)).all() || v == 0.0);
                f64::from(v)
            })
        })
        .sum();
    assert!((grid.mass() - total * 0.125).abs() < 1e-9 * total);
}
