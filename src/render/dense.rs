//! Exact flight through smoke too dense for fictitious collisions: regular tracking (Sutton et al. 1999), voxel by voxel.
//!
//! Between eight samples the density along a ray is a product of three linear functions, a cubic. Gauss' rule with two
//! points integrates a cubic exactly, so optical depths are exact and a collision is found by halving. The cost is that
//! of the voxels crossed, whatever the density; delta tracking would take as many steps as the bound is optical depths
//! thick, and smoke that is thick in one voxel and absent in the next would hold it for ever.

use crate::geometry::embree::Ray;
use crate::grid::DensityGrid;
use crate::grid::lookup::IndexRay;
use crate::render::medium::Medium;
use glam::{BVec3A, DVec3, Vec3A};
use std::f64::consts::LN_2;

/// What becomes of a flight over a piece of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Crossing {
    /// It ends at this distance [m].
    Collision(f64),
    /// It goes on, after this optical depth.
    Through(f64),
}

/// Crosses the piece of the ray between distances `t0` and `t1` [m] with `tau_left` to the collision, in optical depth;
/// infinite for none.
pub fn cross(medium: &Medium, line: &IndexRay, [t0, t1]: [f64; 2], tau_left: f64) -> Crossing {
    let mut tau = 0.0;
    for [a, b] in VoxelWalk::new(line, t0, t1) {
        let piece = optical_depth(medium, line, a, b);
        if tau + piece > tau_left {
            return Crossing::Collision(collision(medium, line, [a, b], tau_left - tau));
        }
        tau += piece;
    }
    Crossing::Through(tau)
}

/// Sums of a grid's values along a ray by the same rule, in single precision: what rounding changes is far below the noise of any
/// light, and lanes take a quarter less time.
pub struct Columns<'a> {
    grid: &'a DensityGrid,
    origin: Vec3A,
    direction: Vec3A,
    inverse: Vec3A,
    is_forward: BVec3A,
}

impl<'a> Columns<'a> {
    /// Along `line`.
    #[inline]
    pub fn new(grid: &'a DensityGrid, line: &IndexRay) -> Self {
        /// Components of the direction smaller than this [voxels/m] never leave a voxel.
        const PARALLEL: f32 = 1e-20;
        let direction = Vec3A::from(line.direction());
        let is_parallel = direction.abs().cmple(Vec3A::splat(PARALLEL));
        let direction = Vec3A::select(is_parallel, Vec3A::splat(PARALLEL), direction);
        let is_forward = direction.cmpgt(Vec3A::ZERO);
        Self { grid, origin: line.origin().into(), direction, inverse: direction.recip(), is_forward }
    }

    /// Of the piece between distances `t0` and `t1` [m] the values added up along it [value · m], at least 0. The piece lies where the
    /// grid's bounds are, give or take rounding.
    #[inline]
    pub fn between(&self, t0: f32, t1: f32) -> f32 {
        // Half the distance between the nodes of Gauss' rule over [−1, 1].
        const NODE: f32 = 0.577_350_26;
        let Self { grid, origin, direction, inverse, is_forward } = *self;
        let start = origin + direction * t0;
        let mut voxel = Vec3A::select(is_forward, start.floor(), start.ceil() - 1.0);
        let to_far = Vec3A::select(is_forward, Vec3A::ONE, Vec3A::ZERO);
        let step = Vec3A::select(is_forward, Vec3A::ONE, Vec3A::NEG_ONE);
        let (mut t, mut sum) = (t0, 0.0);
        while t < t1 {
            let exits = (voxel + to_far - origin) * inverse;
            let exit = exits.min_element();
            let end = if exit < t1 { exit } else { t1 };
            // Rounding may put a face behind the last one.
            if end > t {
                if let Some(samples) = grid.samples_from(voxel) {
                    let half = 0.5 * (end - t);
                    let (at, node) = (origin - voxel + direction * (t + half), direction * (half * NODE));
                    // From afar, places are rounded out of the voxel.
                    let density = |at: Vec3A| samples.within(at.max(Vec3A::ZERO).min(Vec3A::ONE));
                    sum += half * (density(at - node) + density(at + node));
                }
                t = end;
            }
            let crossed = exits.cmple(Vec3A::splat(exit));
            voxel += Vec3A::select(crossed, step, Vec3A::ZERO);
        }
        sum
    }
}

/// What smoke does to the view along a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewThrough {
    /// Distance at which smoke begins [m]; infinite where there is none.
    pub first: f64,
    /// Mean distance at which it stops the view, to a voxel [m]; infinite where it stops nothing.
    pub mean: f64,
    /// Distance at which it has stopped half of the view [m]; infinite where it does not.
    pub half: f64,
    /// Share of the view that it does not stop.
    pub transmittance: f64,
}

/// Optical depth behind which nothing is seen any more.
const OPAQUE: f64 = 60.0;

/// A look through smoke, step by step.
#[derive(Debug, Clone, Copy)]
pub struct ViewSteps {
    first: f64,
    half: f64,
    stopped_at: f64,
    tau: f64,
}

impl Default for ViewSteps {
    fn default() -> Self {
        Self { first: f64::INFINITY, half: f64::INFINITY, stopped_at: 0.0, tau: 0.0 }
    }
}

impl ViewSteps {
    /// The next step, between two distances [m], of an optical depth; `reached` is the distance at which a part of that is
    /// reached. False where nothing is seen behind it.
    pub fn add(&mut self, [a, b]: [f64; 2], depth: f64, reached: impl FnOnce(f64) -> f64) -> bool {
        if depth <= 0.0 {
            return true;
        }
        self.first = self.first.min(a);
        if self.half == f64::INFINITY && self.tau + depth >= LN_2 {
            self.half = reached(LN_2 - self.tau);
        }
        self.stopped_at += (-self.tau).exp() * -(-depth).exp_m1() * 0.5 * (a + b);
        self.tau += depth;
        self.tau <= OPAQUE
    }

    /// What was seen.
    pub fn finish(self) -> ViewThrough {
        let stopped = -(-self.tau).exp_m1();
        let mean = if stopped > 0.0 { self.stopped_at / stopped } else { f64::INFINITY };
        ViewThrough { first: self.first, mean, half: self.half, transmittance: (-self.tau).exp() }
    }
}

/// Looks through smoke along the ray up to distance `end` [m].
pub fn view_through(medium: &Medium, ray: &Ray, end: f32) -> ViewThrough {
    let line = medium.ray_to_index(ray);
    let mut view = ViewSteps::default();
    for [a, b] in voxels(medium, &line, ray, end) {
        let depth = optical_depth(medium, &line, a, b);
        if !view.add([a, b], depth, |tau| collision(medium, &line, [a, b], tau)) {
            break;
        }
    }
    view.finish()
}

/// The pieces of a ray up to distance `end` [m] within voxels that may have smoke, in order; `line` is the ray too.
pub fn voxels<'a>(
    medium: &'a Medium,
    line: &'a IndexRay,
    ray: &Ray,
    end: f32,
) -> impl Iterator<Item = [f64; 2]> + use<'a> {
    let pieces = medium.majorants(ray, end).filter(|piece| piece.density_max > 0.0);
    pieces.flat_map(|piece| VoxelWalk::new(line, f64::from(piece.t0), f64::from(piece.t1)))
}

/// Optical depth between two distances within one voxel.
fn optical_depth(medium: &Medium, line: &IndexRay, a: f64, b: f64) -> f64 {
    let sigma_t = |t: f64| f64::from(medium.sigma_t(line.at(t as f32)));
    if medium.has_exact_depths() { integral(sigma_t, a, b) } else { quadrature(sigma_t, a, b) }
}

/// The integral from `a` to `b` within a voxel of what is no cubic, nearly: for looking, not for light.
#[cold]
fn quadrature(value: impl Fn(f64) -> f64, a: f64, b: f64) -> f64 {
    const PIECES: u32 = 8;
    let h = (b - a) / f64::from(PIECES);
    (0..PIECES).map(|i| integral(&value, a + h * f64::from(i), a + h * f64::from(i + 1))).sum()
}

/// The integral of a cubic from `a` to `b`.
fn integral(cubic: impl Fn(f64) -> f64, a: f64, b: f64) -> f64 {
    // Half the distance between the nodes of Gauss' rule over [−1, 1].
    const NODE: f64 = 0.577_350_269_189_625_8;
    let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
    half * (cubic(middle - NODE * half) + cubic(middle + NODE * half))
}

/// Where on [a, b] within one voxel the optical depth from `a` reaches `tau`.
fn collision(medium: &Medium, line: &IndexRay, [a, b]: [f64; 2], tau: f64) -> f64 {
    let (mut low, mut high) = (a, b);
    // Beyond the last digit of the f32 distance that comes out there is nothing to find.
    while high - low > high * 1e-8 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if optical_depth(medium, line, a, middle) > tau { high = middle } else { low = middle }
    }
    low
}

/// The pieces of a ray between planes of voxel centres, in order.
struct VoxelWalk {
    /// Distances at which the next plane of each axis is crossed, and between planes [m].
    next: DVec3,
    between: DVec3,
    t: f64,
    end: f64,
}

impl VoxelWalk {
    fn new(line: &IndexRay, t0: f64, t1: f64) -> Self {
        let (origin, direction) = (line.origin().as_dvec3(), line.direction().as_dvec3());
        let start = origin + direction * t0;
        let mut walk = Self { next: DVec3::INFINITY, between: DVec3::INFINITY, t: t0, end: t1 };
        for axis in 0..3 {
            let speed = direction[axis];
            let plane = if speed > 0.0 { start[axis].floor() + 1.0 } else { start[axis].ceil() - 1.0 };
            let next = (plane - origin[axis]) / speed;
            // A ray along the planes crosses none; one almost along them, none in reach.
            if next.is_finite() {
                walk.next[axis] = next;
                walk.between[axis] = (1.0 / speed).abs();
            }
        }
        walk
    }
}

impl Iterator for VoxelWalk {
    type Item = [f64; 2];

    fn next(&mut self) -> Option<[f64; 2]> {
        if self.t >= self.end {
            return None;
        }
        let start = self.t;
        let nearest = self.next.min_element();
        if nearest >= self.end {
            self.t = self.end;
        } else {
            self.t = nearest.max(start);
            let crossed = self.next.cmple(DVec3::splat(nearest));
            // Each step adds a voxel's crossing time, which is far above the last digit of an f64: the walk ends.
            self.next += DVec3::select(crossed, self.between, DVec3::ZERO);
        }
        Some([start, self.t])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};
    use crate::math::space::{UnitVec3, WorldPoint};
    use crate::render::phase::Phase;
    use crate::render::sampler::Stream;
    use crate::render::tracking::{Event, estimate_transmittance, sample_collision};
    use glam::{UVec3, Vec3};

    fn medium(extinction: f32, density: impl Fn(WorldPoint) -> f32 + Sync) -> Medium {
        let grid = DensityGrid::from_fn(WorldPoint::new(-0.8, -0.8, -0.8), 0.1, UVec3::splat(16), 1 << 24, density);
        Medium::new(grid.unwrap(), extinction, Vec3::ONE, Phase::HenyeyGreenstein { g: 0.0 })
    }

    fn lumps(p: WorldPoint) -> f32 {
        let p = p.0 * 9.0;
        (p.x.sin() * p.y.cos() + (p.z + 0.3).sin()).max(0.0)
    }

    fn rays() -> impl Iterator<Item = Ray> {
        let mut rng = CounterRng::new(Seed(5));
        let mut point = move |scale: f32| Vec3::from([0; 3].map(|_| (rng.uniform() * 2.0 - 1.0) * scale));
        let axes = [Vec3::X, Vec3::NEG_Y, Vec3::Z].map(|d| (Vec3::new(0.05, 0.05, 0.05) - d * 2.0, d));
        let random = (0..200).map(move |_| (point(1.0), point(1.0)));
        let all = axes.into_iter().chain(random.collect::<Vec<_>>());
        all.map(|(o, d)| Ray { origin: WorldPoint(o), direction: UnitVec3::try_new(d).unwrap() })
    }

    #[test]
    fn optical_depths_are_exact_and_collisions_stand_where_they_are_reached() {
        let medium = medium(10.0, lumps);
        for ray in rays() {
            let line = medium.ray_to_index(&ray);
            const STEPS: usize = 40_000;
            let dt = 3.0 / STEPS as f64;
            let sigma = |t: f64| f64::from(medium.sigma_t(line.at(t as f32)));
            let expected = (0..STEPS).map(|i| sigma((i as f64 + 0.5) * dt)).sum::<f64>() * dt;
            let Crossing::Through(tau) = cross(&medium, &line, [0.0, 3.0], f64::INFINITY) else {
                panic!("no collision")
            };
            assert!((tau - expected).abs() < 1e-4 * (1.0 + expected), "{ray:?}: {tau}, expected {expected}");
            let columns = Columns::new(medium.grid(), &line);
            let in_one = f64::from(medium.extinction() * columns.between(0.0, 3.0));
            assert!((in_one - tau).abs() < 1e-5 * (1.0 + tau), "{ray:?}: {in_one}, expected {tau}");
            let in_parts = f64::from(columns.between(0.0, 1.23) + columns.between(1.23, 3.0));
            assert!((f64::from(medium.extinction()) * in_parts - tau).abs() < 1e-5 * (1.0 + tau), "{ray:?}");
            if tau > 0.0 {
                let Crossing::Collision(t) = cross(&medium, &line, [0.0, 3.0], 0.3 * tau) else {
                    panic!("a collision")
                };
                let Crossing::Through(before) = cross(&medium, &line, [0.0, t], f64::INFINITY) else { panic!() };
                assert!((before - 0.3 * tau).abs() < 1e-4 * (1.0 + tau), "{before} of {tau}");
            }
        }
    }

    #[test]
    fn sums_from_afar_are_off_by_no_more_than_places_are_rounded() {
        let medium = medium(10.0, lumps);
        let mut rng = CounterRng::new(Seed(8));
        // In voxels of 0.1 m.
        for (distance, tolerance) in [(1e2f32, 1e-3), (1e3, 1e-2), (1e4, 0.1)] {
            for _ in 0..200 {
                let mut point = |scale: f32| Vec3::from([0; 3].map(|_| (rng.uniform() * 2.0 - 1.0) * scale));
                let direction = UnitVec3::try_new(point(1.0)).unwrap();
                let ray = Ray { origin: WorldPoint(point(0.5) - direction.as_vec3() * distance), direction };
                let line = medium.ray_to_index(&ray);
                let columns = Columns::new(medium.grid(), &line);
                let (mut tau, mut expected) = (0.0, 0.0);
                for piece in medium.majorants(&ray, f32::INFINITY) {
                    tau += f64::from(medium.extinction() * columns.between(piece.t0, piece.t1));
                    let range = [piece.t0, piece.t1].map(f64::from);
                    let Crossing::Through(more) = cross(&medium, &line, range, f64::INFINITY) else { panic!() };
                    expected += more;
                }
                assert!(tau >= 0.0 && (tau - expected).abs() < tolerance * (1.0 + expected), "{tau}, {expected}");
            }
        }
        // Shorter than half of it can be told.
        let ray = rays().next().unwrap();
        let columns = Columns::new(medium.grid(), &medium.ray_to_index(&ray));
        assert_eq!(columns.between(0.0, f32::from_bits(1)), 0.0);
        assert_eq!(columns.between(f32::NAN, 1.0), 0.0);
    }

    #[test]
    fn flights_in_dense_smoke_follow_the_law_of_light() {
        // Thick enough for the exact walk, with a thin mantle in which most flights end: the law is seen, not just a wall.
        let medium = medium(3000.0, |p| if p.0.x < 0.0 { 0.001 * lumps(p) } else { 1.0 });
        let ray = Ray { origin: WorldPoint::new(-2.0, 0.03, 0.11), direction: UnitVec3::try_new(Vec3::X).unwrap() };
        let line = medium.ray_to_index(&ray);
        let mut stream = Stream::new(Seed(9));
        let n = 100_000;
        let mut depths: Vec<f64> = (0..n)
            .map(|_| {
                let u = stream.uniform();
                let Event::Collision { t } = sample_collision(&medium, &ray, 10.0, u, &mut stream, None) else {
                    panic!()
                };
                let Crossing::Through(tau) = cross(&medium, &line, [0.0, f64::from(t)], f64::INFINITY) else {
                    panic!()
                };
                1.0 - (-tau).exp()
            })
            .collect();
        // Uniform if optical depths are exponential: Kolmogorov and Smirnov's statistic, 1.95 at a level of 0.1 %. Distances
        // are single precision, which blurs optical depths by 0.1 % here.
        depths.sort_by(f64::total_cmp);
        let worst = depths.iter().enumerate().map(|(i, d)| (d - i as f64 / n as f64).abs()).fold(0.0, f64::max);
        assert!(worst * f64::from(n).sqrt() < 1.95 + 0.3, "{worst}");
        let half = 1.62;
        let Crossing::Through(tau) = cross(&medium, &line, [0.0, half], f64::INFINITY) else { panic!() };
        let mean =
            (0..n).map(|_| f64::from(estimate_transmittance(&medium, &ray, half as f32, &mut stream))).sum::<f64>()
                / f64::from(n);
        assert!((mean - (-tau).exp()).abs() < 5e-3, "{mean} for {tau}");
    }

    #[test]
    fn no_density_holds_a_flight_for_long() {
        // One voxel thick beyond measure, none about it: the bound of its cell holds where the density is nothing.
        let start = std::time::Instant::now();
        for extinction in [1e3, 1e9, 1e15, 1e20] {
            let spot = medium(extinction, |p| f32::from(p.0.abs().max_element() < 0.06));
            let mut stream = Stream::new(Seed(3));
            for ray in rays() {
                let u = stream.uniform();
                sample_collision(&spot, &ray, f32::INFINITY, u, &mut stream, None);
                let t = estimate_transmittance(&spot, &ray, 3.0, &mut stream);
                assert!((0.0..=1.0).contains(&t));
            }
        }
        assert!(start.elapsed().as_secs_f64() < 20.0);
    }
}
