//! Properties of density grids: bounds that bound, walks that end, reads that agree with the definition.

use curlsmoke::grid::majorant::{CellEdge, MajorantGrid, MajorantIterator};
use curlsmoke::grid::splat::{SplatInput, SplatSettings, SplatSum, splat};
use curlsmoke::grid::{DensityGrid, GridError};
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
    let gap_is_empty = |from: f32, to: f32, rng: &mut CounterRng| {
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
        let majorants = [CellEdge::Four, CellEdge::Eight].map(|edge| MajorantGrid::new(&grid, edge));
        assert!(majorants.iter().all(|majorants| majorants.max_density() >= grid.max_density()));
        let bounds = grid.bounds();
        for i in 0..12_000 {
            let majorants = &majorants[i % 2];
            let u = Vec3::new(rng.uniform(), rng.uniform(), rng.uniform());
            let mut target = WorldPoint(bounds.min + u * bounds.size());
            if i % 7 == 0 {
                // On the faces between cells, and on the boundary.
                target = origin + ((target - origin) / (4.0 * voxel_size)).round() * 4.0 * voxel_size;
            }
            let direction = random_direction(&mut rng);
            let back = if i % 3 == 0 { 0.0 } else { 120.0 * voxel_size * rng.uniform() };
            let t_max = if i % 2 == 0 { f32::INFINITY } else { 100.0 * voxel_size * rng.uniform() };
            check_ray(&grid, majorants, target - *direction * back, direction, t_max, &mut rng);
        }
    }
}

#[test]
fn a_walk_covers_the_whole_of_a_full_grid_without_gaps() {
    let grid = DensityGrid::from_fn(WorldPoint::default(), 0.1, UVec3::splat(64), LIMIT, |_| 2.0).expect("small");
    let majorants = MajorantGrid::new(&grid, CellEdge::Four);
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
    assert!(first <= 5.0 - 0.05 && first > 4.0 && (11.4..12.3).contains(&last), "{first} {last}");
    assert!(segments.iter().all(|s| s.density_max >= 2.0 && s.density_max < 2.00001));
}

#[test]
fn walks_from_afar_meet_faces_where_they_are() {
    // Errors of a face must not add up to those of the faces before it: a thousand voxels, seen from a kilometre away.
    const VOXEL: f32 = 0.01;
    let size = UVec3::new(1024, 8, 8);
    let grid = DensityGrid::from_fn(WorldPoint::default(), VOXEL, size, LIMIT, |_| 1.0).expect("small");
    let majorants = MajorantGrid::new(&grid, CellEdge::Four);
    for (from, direction, tolerance) in [(-1000.0, Vec3::X, 2e-4), (-20.0, Vec3::X, 5e-6), (1020.0, Vec3::NEG_X, 2e-4)]
    {
        let start = WorldPoint::new(from, 0.0437, 0.0391);
        let direction = UnitVec3::try_new(direction).expect("unit");
        // Faces lie between the middles of voxels.
        let face = |t: f32| {
            (f64::from(from) + f64::from(t) * f64::from(direction.x) - 0.5 * f64::from(VOXEL))
                / (4.0 * f64::from(VOXEL))
        };
        let segments: Vec<_> = MajorantIterator::new(&majorants, start, direction, 0.0, f32::INFINITY).collect();
        assert!(segments.len() >= 256, "{}", segments.len());
        for segment in &segments[..segments.len() - 1] {
            let off = (face(segment.t1) - face(segment.t1).round()).abs() * 4.0 * f64::from(VOXEL);
            assert!(off < tolerance, "from {from}: a face is {off} m beside itself at {}", segment.t1);
        }
    }
}

#[test]
fn walks_end_at_once_on_nonsense_and_on_empty_grids() {
    let full = DensityGrid::from_fn(WorldPoint::default(), 1.0, UVec3::splat(9), LIMIT, |_| 1.0).expect("small");
    let none = DensityGrid::from_fn(WorldPoint::default(), 1.0, UVec3::splat(9), LIMIT, |_| 0.0).expect("small");
    let inside = WorldPoint::new(4.0, 4.0, 4.0);
    assert_eq!(
        MajorantIterator::new(&MajorantGrid::new(&none, CellEdge::Four), inside, UnitVec3::Y, 0.0, f32::INFINITY)
            .count(),
        0
    );
    let majorants = MajorantGrid::new(&full, CellEdge::Four);
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

/// Particles in a ball of `extent` metres.
struct Cloud {
    position: [Vec<f32>; 3],
    velocity: [Vec<f32>; 3],
    mass: Vec<f32>,
    radius: Vec<f32>,
}

impl Cloud {
    fn new(count: usize, extent: f32, radius: f32, speed: f32) -> Self {
        let mut rng = CounterRng::new(Seed(3));
        let mut signed = |scale: f32| (0..count).map(|_| (2.0 * rng.uniform() - 1.0) * scale).collect::<Vec<f32>>();
        let (position, velocity) = (std::array::from_fn(|_| signed(extent)), std::array::from_fn(|_| signed(speed)));
        let mass = signed(1.0).iter().map(|m| 1e-3 * m.abs()).collect();
        let radius = signed(0.5).iter().map(|r| radius * (1.0 + r)).collect();
        Self { position, velocity, mass, radius }
    }

    fn input(&self) -> SplatInput<'_> {
        SplatInput {
            position: self.position.each_ref().map(Vec::as_slice),
            velocity: self.velocity.each_ref().map(Vec::as_slice),
            bends: None,
            mass: &self.mass,
            radius: &self.radius,
            carried: &[],
            obstacles: None,
        }
    }

    /// Those of a range.
    fn part(&self, range: std::ops::Range<usize>) -> SplatInput<'_> {
        SplatInput {
            position: self.position.each_ref().map(|x| &x[range.clone()]),
            velocity: self.velocity.each_ref().map(|x| &x[range.clone()]),
            bends: None,
            mass: &self.mass[range.clone()],
            radius: &self.radius[range],
            carried: &[],
            obstacles: None,
        }
    }

    fn total_mass(&self) -> f64 {
        self.mass.iter().map(|&m| f64::from(m)).sum()
    }
}

fn settings(voxel_size: f32, shutter_seconds: [f64; 2]) -> SplatSettings {
    SplatSettings { voxel_size, shutter_seconds, soft_radius: None, memory_limit_bytes: LIMIT }
}

#[test]
fn splatting_conserves_mass_still_and_smeared_at_every_kernel_size() {
    for (radius, speed, shutter) in
        [(0.001, 0.0, [0.0, 0.0]), (0.03, 3.0, [0.0, 0.0]), (0.06, 3.0, [-0.01, 0.01]), (0.2, 40.0, [0.0, 0.02])]
    {
        let cloud = Cloud::new(20_000, 0.8, radius, speed);
        let grid = splat(&cloud.input(), &settings(0.02, shutter)).expect("in range").grid;
        let relative = grid.mass() / cloud.total_mass() - 1.0;
        assert!(relative.abs() < 3e-7, "radius {radius}: {relative:e}");
    }
}

#[test]
fn a_splat_has_the_same_bits_on_any_number_of_threads() {
    let cloud = Cloud::new(50_000, 0.5, 0.05, 5.0);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| splat(&cloud.input(), &settings(0.02, [-0.01, 0.02])).expect("in range").grid)
    };
    let one = on(1);
    for threads in [2, 3, 7] {
        let other = on(threads);
        assert_eq!(one.brick_count(), other.brick_count());
        for ((a, va), (b, vb)) in one.occupied_bricks().zip(other.occupied_bricks()) {
            assert!(
                a == b && va.iter().zip(&vb).all(|(x, y)| x.to_bits() == y.to_bits()),
                "{threads} threads, brick {a}"
            );
        }
    }
}

#[test]
fn particles_added_some_at_a_time_are_the_same_bits_and_numbered_on() {
    let mut cloud = Cloud::new(30_000, 0.5, 0.05, 5.0);
    let settings = settings(0.02, [-0.01, 0.02]);
    let whole = splat(&cloud.input(), &settings).expect("in range");
    for size in [1_777, 29_999] {
        let mut sum = SplatSum::try_new(settings).expect("a size");
        (0..30_000).step_by(size).for_each(|i| sum.add(&cloud.part(i..30_000.min(i + size))).expect("in range"));
        assert!(sum.finish().expect("within the limit") == whole, "{size} at a time");
    }
    cloud.mass[20_003] = f32::NAN;
    let mut sum = SplatSum::try_new(settings).expect("a size");
    sum.add(&cloud.part(0..20_000)).expect("in range");
    let error = sum.add(&cloud.part(20_000..30_000)).expect_err("a bad mass");
    assert!(matches!(error, GridError::BadParticle { particle_idx: 20_003, .. }), "{error}");
}

#[test]
fn a_grid_that_outgrows_the_limit_is_refused_while_particles_are_added() {
    let cloud = Cloud::new(20_000, 5.0, 0.05, 0.0);
    let settings = SplatSettings { memory_limit_bytes: 64 << 20, ..settings(0.02, [0.0, 0.0]) };
    let mut sum = SplatSum::try_new(settings).expect("a size");
    let refused = (0..20_000).step_by(1_000).find_map(|i| sum.add(&cloud.part(i..i + 1_000)).err());
    let Some(GridError::OverMemory { needed_bytes, brick_count, .. }) = refused else { panic!("{refused:?}") };
    assert!(needed_bytes > 64 << 20 && brick_count > 1_000, "{needed_bytes} {brick_count}");
}

#[test]
fn one_particle_keeps_its_place_and_its_streak_is_even() {
    let (p, v) = (Vec3::new(0.314, -0.271, 0.577), Vec3::new(8.0, 0.0, 0.0));
    let (position, velocity) = (p.to_array().map(|x| [x]), v.to_array().map(|x| [x]));
    let input = SplatInput {
        position: [&position[0], &position[1], &position[2]],
        velocity: [&velocity[0], &velocity[1], &velocity[2]],
        bends: None,
        mass: &[2.0],
        radius: &[0.04],
        carried: &[],
        obstacles: None,
    };
    let center_of = |grid: &DensityGrid| -> Vec3 {
        let (mut sum, mut moment) = (0.0, Vec3::ZERO);
        for (brick, values) in grid.occupied_bricks() {
            for (i, &value) in values.iter().enumerate() {
                let voxel = brick * 8 + curlsmoke::grid::local_voxel(i).as_ivec3();
                moment += value * (voxel.as_vec3() + 0.5) * grid.voxel_size();
                sum += value;
            }
        }
        moment / sum
    };
    let still = splat(&input, &settings(0.01, [0.0, 0.0])).expect("in range").grid;
    assert!((center_of(&still) - p).abs().max_element() < 2e-4, "{}", center_of(&still));
    let smeared = splat(&input, &settings(0.01, [0.0, 0.1])).expect("in range").grid;
    assert!((center_of(&smeared) - p - 0.05 * v).abs().max_element() < 2e-4);
    let along: Vec<f32> = (0..30).map(|i| smeared.density(WorldPoint(p + v * (0.02 + 0.002 * i as f32)))).collect();
    let (low, high) = along.iter().fold((f32::MAX, 0f32), |(a, b), &d| (a.min(d), b.max(d)));
    assert!(low > 0.95 * high, "the streak is dotted: {low} {high}");
}

#[test]
fn bad_particles_are_errors_that_name_them() {
    type Damage = fn(&mut Cloud);
    let cases: [(&str, Damage); 6] = [
        ("position", |c| c.position[1][7] = f32::NAN),
        ("position", |c| c.position[2][7] = 1e30),
        ("velocity", |c| c.velocity[0][7] = f32::INFINITY),
        ("mass", |c| c.mass[7] = -1.0),
        ("radius", |c| c.radius[7] = 0.0),
        ("radius", |c| c.radius[7] = 1e6),
    ];
    for (word, spoil) in cases {
        let mut cloud = Cloud::new(20, 0.5, 0.05, 1.0);
        spoil(&mut cloud);
        let error = splat(&cloud.input(), &settings(0.02, [0.0, 0.1])).expect_err(word);
        assert!(matches!(error, GridError::BadParticle { particle_idx: 7, .. }), "{error}");
        assert!(error.to_string().contains(word), "{error}");
    }
    let mut far = Cloud::new(20, 0.5, 0.05, 1.0);
    far.position = std::array::from_fn(|_| vec![4e4; 20]);
    far.position[0][0] = -4e4;
    far.position[1][0] = -4e4;
    far.position[2][0] = -4e4;
    let error = splat(&far.input(), &settings(0.02, [0.0, 0.0])).expect_err("a box of 10^19 voxels");
    assert!(matches!(error, GridError::OverMemory { .. }), "{error}");
    let mut short = Cloud::new(20, 0.5, 0.05, 1.0);
    short.radius.pop();
    assert_eq!(splat(&short.input(), &settings(0.02, [0.0, 0.0])), Err(GridError::Lengths(20, 19)));
}

#[test]
fn no_particles_are_an_empty_grid() {
    let mut cloud = Cloud::new(5, 0.5, 0.05, 1.0);
    cloud.mass.fill(0.0);
    assert!(splat(&cloud.input(), &settings(0.02, [0.0, 0.0])).expect("in range").grid.is_empty());
}

#[test]
fn densities_are_told_apart_between_the_lowest_and_the_highest_and_bounds_follow() {
    let remap = curlsmoke::scene::settings::Remap { in_range: [0.2, 0.8], out: Some(3.0), gamma: 2.0 };
    for (density, expected) in [(0.0, 0.0), (0.2, 0.0), (0.5, 0.75), (0.8, 3.0), (7.0, 3.0)] {
        assert!((remap.apply(density) - expected).abs() < 1e-6, "{density}: {}", remap.apply(density));
    }
    let grid = blobs(0.1, WorldPoint::new(-1.0, 2.0, 0.5));
    let changed = grid.clone().map(|density| remap.apply(density));
    let mut rng = CounterRng::new(Seed(8));
    let mut compared = 0;
    for (brick, values) in grid.occupied_bricks() {
        for _ in 0..20 {
            let i = (rng.uniform() * 512.0) as usize;
            let voxel = brick * 8 + curlsmoke::grid::local_voxel(i).as_ivec3();
            assert_eq!(changed.voxel(voxel), remap.apply(values[i]));
            // The interpolant too, which reads what bricks share.
            let middle =
                WorldPoint((changed.origin() + (voxel.as_dvec3() + 1.0) * f64::from(changed.voxel_size())).as_vec3());
            let corners = (0..8).map(|c| changed.voxel(voxel + IVec3::new(c & 1, (c >> 1) & 1, c >> 2)));
            let mean = corners.sum::<f32>() / 8.0;
            let found = changed.density(middle);
            assert!((found - mean).abs() < 1e-4, "{found} {mean}");
            compared += i32::from(mean > 0.0);
        }
    }
    assert!(compared > 100, "{compared}");
    assert!(changed.max_density() <= 3.0);
}
