//! Soft particles: kernels fade towards obstacles, never reach through them, and every gram is accounted for.

use curlsmoke::grid::soft::ObstacleDistance;
use curlsmoke::grid::splat::{Splat, SplatInput, SplatSettings, SplatSum, splat};
use curlsmoke::grid::{DensityGrid, local_voxel};
use curlsmoke::math::hash::{CounterRng, Seed};
use glam::{DVec3, IVec3};
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

const VOXEL: f32 = 0.02;

/// Solids by formula.
#[derive(Debug)]
enum Solid {
    Ball {
        center: DVec3,
        radius: f64,
    },
    Cuboid {
        center: DVec3,
        half: DVec3,
    },
    /// Below a height.
    Ground(f64),
}

impl Solid {
    fn distance(&self, p: DVec3) -> f64 {
        match self {
            Self::Ball { center, radius } => p.distance(*center) - radius,
            Self::Cuboid { center, half } => {
                let q = (p - center).abs() - half;
                q.max(DVec3::ZERO).length() + q.max_element().min(0.0)
            }
            Self::Ground(height) => p.y - height,
        }
    }
}

impl ObstacleDistance for Solid {
    fn distances(&self, points: &[DVec3], distances: &mut [f64]) {
        points.iter().zip(distances).for_each(|(&p, d)| *d = self.distance(p));
    }
}

struct Cloud {
    position: [Vec<f32>; 3],
    velocity: [Vec<f32>; 3],
    mass: Vec<f32>,
    radius: Vec<f32>,
}

impl Cloud {
    /// Particles in a cube of `2·extent` about the origin where `keep` holds.
    fn new(count: usize, extent: f64, radius: f32, speed: f32, keep: impl Fn(DVec3) -> bool) -> Self {
        let mut rng = CounterRng::new(Seed(11));
        let mut cloud =
            Self { position: Default::default(), velocity: Default::default(), mass: vec![], radius: vec![] };
        for _ in 0..count {
            let mut signed = |scale: f32| (2.0 * rng.uniform() - 1.0) * scale;
            let p: [f32; 3] = std::array::from_fn(|_| signed(extent as f32));
            let v: [f32; 3] = std::array::from_fn(|_| signed(speed));
            let (mass, radius) = (1e-3 * (1.1 + signed(1.0)), radius * (1.0 + signed(0.5)));
            if keep(DVec3::from_array(p.map(f64::from))) {
                (0..3).for_each(|a| (cloud.position[a].push(p[a]), cloud.velocity[a].push(v[a])).0);
                cloud.mass.push(mass);
                cloud.radius.push(radius);
            }
        }
        cloud
    }

    fn splat(&self, obstacles: Option<&dyn ObstacleDistance>, soft_radius: Option<f64>) -> Splat {
        splat(&self.input(0..self.mass.len(), &[], obstacles), &settings(soft_radius)).expect("in range")
    }

    fn input<'a>(
        &'a self,
        range: Range<usize>,
        carried: &'a [&'a [f32]],
        obstacles: Option<&'a dyn ObstacleDistance>,
    ) -> SplatInput<'a> {
        let part = |values: &'a Vec<f32>| &values[range.clone()];
        SplatInput {
            position: self.position.each_ref().map(part),
            velocity: self.velocity.each_ref().map(part),
            bends: None,
            mass: part(&self.mass),
            radius: part(&self.radius),
            carried,
            obstacles,
        }
    }

    fn total_mass(&self) -> f64 {
        self.mass.iter().map(|&m| f64::from(m)).sum()
    }
}

fn settings(soft_radius: Option<f64>) -> SplatSettings {
    SplatSettings { voxel_size: VOXEL, shutter_seconds: [-0.01, 0.01], soft_radius, memory_limit_bytes: 1 << 29 }
}

/// Centres [m] and densities of all voxels that hold some.
fn voxels(grid: &DensityGrid) -> Vec<(DVec3, f32)> {
    let of_brick = |(brick, values): (IVec3, curlsmoke::grid::BrickValues)| {
        let center = move |i| ((brick * 8 + local_voxel(i).as_ivec3()).as_dvec3() + 0.5) * f64::from(VOXEL);
        values.into_iter().enumerate().filter(|(_, v)| *v > 0.0).map(move |(i, v)| (center(i), v)).collect::<Vec<_>>()
    };
    grid.occupied_bricks().flat_map(of_brick).collect()
}

fn assert_same_bits(a: &DensityGrid, b: &DensityGrid) {
    assert_eq!(a.brick_count(), b.brick_count());
    for ((ca, va), (cb, vb)) in a.occupied_bricks().zip(b.occupied_bricks()) {
        assert!(ca == cb && va.iter().zip(&vb).all(|(x, y)| x.to_bits() == y.to_bits()), "brick {ca}");
    }
}

#[test]
fn far_from_walls_and_at_soft_radius_0_the_bytes_are_those_without_obstacles() {
    for speed in [0.0, 10.0] {
        let cloud = Cloud::new(5_000, 0.5, 0.05, speed, |_| true);
        let plain = cloud.splat(None, None);
        let far = cloud.splat(Some(&Solid::Ground(-1.0)), None);
        assert_same_bits(&plain.grid, &far.grid);
        assert_eq!((far.mass.faded, far.mass.lost), (0.0, 0.0));
        let off = cloud.splat(Some(&Solid::Ground(0.0)), Some(0.0));
        assert_same_bits(&plain.grid, &off.grid);
        let near = cloud.splat(Some(&Solid::Ground(0.0)), None);
        assert!(near.mass.faded > 0.0);
    }
}

#[test]
fn mass_adds_up_and_no_voxel_inside_has_any() {
    let ball = Solid::Ball { center: DVec3::new(0.1, 0.0, -0.05), radius: 0.3 };
    for (speed, soft_radius) in [(0.0, None), (8.0, None), (8.0, Some(0.01)), (0.0, Some(0.15))] {
        // A few particles are inside, and lost.
        let cloud = Cloud::new(6_000, 0.5, 0.04, speed, |p| ball.distance(p) > 0.0 || p.x < -0.1);
        let Splat { grid, mass, .. } = cloud.splat(Some(&ball), soft_radius);
        assert!((mass.particles / cloud.total_mass() - 1.0).abs() < 1e-12);
        assert!(((mass.grid + mass.lost) / mass.particles - 1.0).abs() < 1e-6, "{mass:?}");
        assert!((mass.grid / grid.mass() - 1.0).abs() < 1e-12);
        assert!(mass.lost > 0.0 && mass.faded > mass.lost && mass.faded < mass.particles, "{mass:?}");
        let inside = voxels(&grid).iter().filter(|(p, _)| ball.distance(*p) <= 0.0).count();
        assert_eq!(inside, 0, "speed {speed}, soft {soft_radius:?}");
    }
}

#[test]
fn a_particle_outside_loses_nothing_at_a_flat_wall() {
    let ground = Solid::Ground(-0.101);
    let cloud = Cloud::new(8_000, 0.3, 0.05, 0.0, |p| ground.distance(p) >= 0.0);
    let mass = cloud.splat(Some(&ground), None).mass;
    assert!(mass.faded > 0.01 * mass.particles, "{mass:?}");
    assert!(mass.lost < 1e-3 * mass.particles, "{mass:?}");
}

#[test]
fn nothing_comes_out_behind_a_plate_a_tenth_of_a_voxel_thick() {
    let half = DVec3::new(0.05 * f64::from(VOXEL), 9.0, 9.0);
    for (place, speed) in [(0.013, 0.0), (0.02, 0.0), (0.0101, 15.0)] {
        let plate = Solid::Cuboid { center: DVec3::new(place, 0.0, 0.0), half };
        let cloud = Cloud::new(6_000, 0.25, 0.06, speed, |p| p.x < place - half.x);
        for soft_radius in [None, Some(0.005)] {
            let splat = cloud.splat(Some(&plate), soft_radius);
            let behind = voxels(&splat.grid).iter().filter(|(p, _)| p.x > place).count();
            assert_eq!(behind, 0, "plate at {place}, speed {speed}");
            assert!(splat.mass.faded > 0.0 && splat.grid.mass() > 0.9 * cloud.total_mass());
        }
        let through = voxels(&cloud.splat(None, None).grid).iter().filter(|(p, _)| p.x > place).count();
        assert!(through > 100, "without the plate there is smoke behind it");
    }
}

#[test]
fn a_particle_fades_towards_the_wall_voxel_by_voxel() {
    // Against the kernel without a wall, what is left falls with the distance.
    let one = |obstacles: Option<&dyn ObstacleDistance>| {
        let cloud = Cloud {
            position: [vec![0.01], vec![0.09], vec![0.01]],
            velocity: [vec![0.0], vec![0.0], vec![0.0]],
            mass: vec![1.0],
            radius: vec![0.1],
        };
        cloud.splat(obstacles, None).grid
    };
    let (plain, soft) = (one(None), one(Some(&Solid::Ground(0.003))));
    let ratios: Vec<f32> =
        (-1..9).map(|j| IVec3::new(0, j, 0)).map(|v| soft.voxel(v) / plain.voxel(v).max(f32::MIN_POSITIVE)).collect();
    assert_eq!(ratios[0], 0.0, "below the ground: {ratios:?}");
    assert!(ratios.windows(2).take(5).all(|w| w[0] < w[1]), "{ratios:?}");
    assert!(ratios[9] > 1.0 && (ratios[9] - ratios[8]).abs() < 1e-4, "beyond the soft radius all alike: {ratios:?}");
}

#[test]
fn particles_near_walls_added_some_at_a_time_are_the_same_bits() {
    // Several batches.
    const COUNT: usize = 60_000;
    let ball = Solid::Ball { center: DVec3::new(0.1, 0.0, 0.0), radius: 0.3 };
    let mut cloud = Cloud::new(COUNT, 0.5, 0.06, 4.0, |_| true);
    // In between some that weigh nothing, so that pieces and particles are numbered apart.
    cloud.mass.iter_mut().step_by(7).for_each(|mass| *mass = 0.0);
    // What is carried everywhere alike is its own mean.
    let (alike, place) = (vec![2.5f32; COUNT], cloud.position[1].clone());
    let bent: [Vec<f32>; 2] = [cloud.velocity[0].clone(), cloud.velocity[2].iter().map(|v| 300.0 * v).collect()];
    let splat_in = |size: usize| {
        let mut sum = SplatSum::try_new(settings(None)).expect("a size");
        for start in (0..COUNT).step_by(size) {
            let range = start..COUNT.min(start + size);
            let carried = [&alike[range.clone()], &place[range.clone()]];
            let bends = bent.each_ref().map(|values| [&values[range.clone()]; 3]);
            let input = cloud.input(range, &carried, Some(&ball));
            sum.add(&SplatInput { bends: Some(bends), ..input }).expect("in range");
        }
        sum.finish().expect("within the limit")
    };
    let whole = splat_in(COUNT);
    assert!(splat_in(17_777) == whole);
    assert!(whole.mass.faded > 0.1 * whole.mass.particles, "walls take some: {:?}", whole.mass);
    let relative = whole.grid.mass() / (whole.mass.particles - whole.mass.lost) - 1.0;
    assert!(relative.abs() < 3e-7, "{relative:e}");
    let [alike, place] = whole.means.carried_by(&whole.grid)[..] else { panic!("two quantities") };
    assert!((alike / (2.5 * whole.grid.mass()) - 1.0).abs() < 1e-6 && place != alike, "{alike}");
}

#[test]
fn the_bits_do_not_depend_on_threads() {
    let ball = Solid::Ball { center: DVec3::ZERO, radius: 0.25 };
    let cloud = Cloud::new(20_000, 0.5, 0.05, 5.0, |p| ball.distance(p) >= 0.0);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| cloud.splat(Some(&ball), None))
    };
    let one = on(1);
    for threads in [2, 5] {
        let other = on(threads);
        assert_same_bits(&one.grid, &other.grid);
        assert_eq!(one.mass, other.mass);
    }
}

/// Counts the questions it is asked.
#[derive(Debug, Default)]
struct FarAway(AtomicUsize);

impl ObstacleDistance for FarAway {
    fn distances(&self, points: &[DVec3], distances: &mut [f64]) {
        self.0.fetch_add(points.len(), Ordering::Relaxed);
        distances.fill(100.0);
    }
}

#[test]
fn a_particle_far_from_walls_costs_one_distance() {
    let cloud = Cloud::new(3_000, 0.5, 0.05, 5.0, |_| true);
    let far = FarAway::default();
    cloud.splat(Some(&far), None);
    assert_eq!(far.0.load(Ordering::Relaxed), cloud.mass.len());
}
