//! Motion blur of density from elsewhere, by a velocity on voxels.
//!
//! What is at `x` at time `t` of the shutter was at the frame at `x − v(x)·t`, as far as the velocity there is the one that
//! brought it: exact of even motion, off by `t²` times how the velocity changes along its way elsewhere. The density of the frame
//! becomes the mean over the shutter, taken at midpoints at most half a voxel of the way apart, on the same voxels.

use crate::grid::{
    BRICK_EDGE, BRICK_VOXELS, BrickValues, DensityGrid, GridError, MAX_COORDINATE, brick_box, check_memory, local_voxel,
};
use crate::math::parallel;
use crate::math::space::WorldPoint;
use crate::progress::Progress;
use glam::{IVec3, U64Vec3, Vec3};
use std::collections::{HashMap, HashSet};

/// Most midpoints of a voxel; longer ways than 256 voxels become dotted.
const SAMPLES_MAX: u32 = 512;
/// Midpoints for each voxel of the way.
const SAMPLES_PER_VOXEL: f32 = 2.0;
/// Bricks between two looks at whether to stop.
const BRICKS_AT_ONCE: usize = 1024;
/// Within so many bricks each is looked at for density; farther ones count as dense where the box round all density begins.
const NEAR: i32 = 3;
/// Memory of a brick whose speed is known, in a table that grows [bytes].
const SPEED_BYTES: u64 = 128;

/// Velocities on voxels: for each axis what is above 0, and what is below with its sign turned, as grids hold no numbers below 0.
#[derive(Debug, Clone)]
pub struct VelocityGrid {
    parts: [[DensityGrid; 2]; 3],
    /// Factor to metres a second.
    factor: f32,
}

impl VelocityGrid {
    /// Velocities from the parts above and below 0 of each component, times `factor` [m/s].
    pub fn new(parts: [[DensityGrid; 2]; 3], factor: f64) -> Self {
        Self { parts, factor: factor as f32 }
    }

    /// Velocity at a point [m/s]; 0 where nothing is stored.
    fn at(&self, p: WorldPoint) -> Vec3 {
        let part = |grid: &DensityGrid| grid.density_at(grid.to_index(p));
        self.factor * Vec3::from(self.parts.each_ref().map(|[up, down]| part(up) - part(down)))
    }

    /// The speeds in those bricks of `density` between the first and the last of `within` where anything moves, without the factor.
    fn speeds(&self, density: &DensityGrid, within: [IVec3; 2], memory_limit_bytes: u64) -> Result<Speeds, GridError> {
        let mut speeds = Speeds::new();
        let brick_size = BRICK_EDGE as f64 * f64::from(density.voxel_size());
        for (axis, grid) in self.parts.iter().enumerate().flat_map(|(axis, parts)| parts.iter().map(move |g| (axis, g)))
        {
            let h = f64::from(grid.voxel_size());
            for (coord, values) in grid.occupied_bricks() {
                let most = values.iter().fold(0.0f32, |a, &b| a.max(b));
                let low = grid.origin() + (coord * BRICK_EDGE as i32).as_dvec3() * h;
                // Voxels are interpolated with their neighbours, and places are rounded.
                let corners = [low - h, low + (BRICK_EDGE as f64 + 1.0) * h];
                let [first, last] = corners.map(|corner| ((corner - density.origin()) / brick_size).floor().as_ivec3());
                let (first, last) = (first.max(within[0]), last.min(within[1]));
                for z in first.z..=last.z {
                    for y in first.y..=last.y {
                        for x in first.x..=last.x {
                            let speed = &mut speeds.entry(IVec3::new(x, y, z)).or_default()[axis];
                            *speed = speed.max(most);
                        }
                        check_memory(U64Vec3::ZERO, 0, speeds.len() as u64 * SPEED_BYTES, memory_limit_bytes)?;
                    }
                }
            }
        }
        Ok(speeds)
    }

    /// No speed is above this [m/s].
    pub fn max_speed(&self) -> f32 {
        let most = |[up, down]: &[DensityGrid; 2]| up.max_density().max(down.max_density());
        self.factor.abs() * Vec3::from(self.parts.each_ref().map(most)).length()
    }
}

/// The mean of `density` over the times of `shutter`, relative to the frame [s]. The grid grows by as far as
/// density goes.
///
/// # Errors
/// [`GridError::OverMemory`] before anything large is allocated, [`GridError::TooFar`], and [`GridError::Cancelled`].
pub fn blurred(
    density: &DensityGrid,
    velocity: &VelocityGrid,
    shutter: [f64; 2],
    memory_limit_bytes: u64,
    progress: &dyn Progress,
) -> Result<DensityGrid, GridError> {
    let h = density.voxel_size();
    let longest = shutter[0].abs().max(shutter[1].abs()) as f32;
    let reach = velocity.max_speed() * longest / h;
    if reach == 0.0 || density.is_empty() {
        return Ok(density.clone());
    }
    let coords = reached(density, velocity, longest, memory_limit_bytes)?;
    let (_, dims) = brick_box(&coords)?;
    check_memory(dims, coords.len() as u64, size_of_val(&coords[..]) as u64, memory_limit_bytes)?;
    let mut values: Vec<BrickValues> = vec![[0.0; BRICK_VOXELS]; coords.len()];
    for (coords, values) in coords.chunks(BRICKS_AT_ONCE).zip(values.chunks_mut(BRICKS_AT_ONCE)) {
        if progress.is_cancelled() {
            return Err(GridError::Cancelled);
        }
        parallel::for_each_mut(values, |n, brick| {
            for (i, value) in brick.iter_mut().enumerate() {
                let voxel = coords[n] * BRICK_EDGE as i32 + local_voxel(i).as_ivec3();
                *value = mean(density, velocity, shutter, voxel);
            }
        });
    }
    DensityGrid::from_bricks(density.origin(), h, &coords, &values, memory_limit_bytes)
}

/// The mean of one voxel.
fn mean(density: &DensityGrid, velocity: &VelocityGrid, shutter: [f64; 2], voxel: IVec3) -> f32 {
    let h = density.voxel_size();
    let center = (density.origin() + (voxel.as_dvec3() + 0.5) * f64::from(h)).as_vec3();
    let v = velocity.at(WorldPoint(center));
    if v == Vec3::ZERO {
        return density.voxel(voxel);
    }
    let [open, close] = shutter.map(|time| time as f32);
    let way = v.length() * (close - open) / h;
    let count = ((way * SAMPLES_PER_VOXEL).ceil() as u32).clamp(1, SAMPLES_MAX);
    let sum: f64 = (0..count)
        .map(|k| {
            let time = open + (close - open) * (k as f32 + 0.5) / count as f32;
            f64::from(density.density_at(density.to_index(WorldPoint(center - v * time))))
        })
        .sum();
    (sum / f64::from(count)) as f32
}

/// Bricks of a lattice and the largest of each component of the velocity in them, up or down [m/s].
type Speeds = HashMap<IVec3, [f32; 3]>;

/// The bricks of `density` in which its mean over at most `longest` [s] may be above 0, in a fixed order: its own, and those from
/// which some velocity in them leads to where there is density. What is fast in one place makes no more of others.
fn reached(
    density: &DensityGrid,
    velocity: &VelocityGrid,
    longest: f32,
    memory_limit_bytes: u64,
) -> Result<Vec<IVec3>, GridError> {
    let own: HashSet<IVec3> = density.occupied_bricks().map(|(coord, _)| coord).collect();
    let low = own.iter().copied().reduce(IVec3::min).unwrap_or_default();
    let high = own.iter().copied().reduce(IVec3::max).unwrap_or_default();
    let bricks_away = |speed: f32| brick_reach(speed * longest / density.voxel_size());
    let far = bricks_away(velocity.max_speed());
    let speeds = velocity.speeds(density, [low - far, high + far], memory_limit_bytes)?;
    let leads_to_density = |(coord, speed): (&IVec3, &[f32; 3])| {
        let away = bricks_away(velocity.factor.abs() * Vec3::from(*speed).length());
        let is_near = |a: IVec3, b: IVec3| (a - b).abs().max_element() <= away;
        if away > NEAR {
            return is_near(*coord, coord.clamp(low, high)).then_some(*coord);
        }
        let edge = -away..=away;
        let mut round = edge.clone().flat_map(|z| edge.clone().map(move |y| (y, z)));
        round.any(|(y, z)| edge.clone().any(|x| own.contains(&(*coord + IVec3::new(x, y, z))))).then_some(*coord)
    };
    let mut coords: Vec<IVec3> = speeds.iter().filter_map(leads_to_density).filter(|c| !own.contains(c)).collect();
    coords.extend(&own);
    coords.sort_unstable_by_key(|coord| [coord.z, coord.y, coord.x]);
    Ok(coords)
}

/// How many bricks away what is up to `reach` voxels away may be, and a voxel more, for what is interpolated.
fn brick_reach(reach: f32) -> i32 {
    // Beyond all grids, and small enough to be added to places in them.
    ((reach + 1.0) / BRICK_EDGE as f32).ceil().min(MAX_COORDINATE as f32) as i32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;
    use glam::UVec3;

    const H: f32 = 0.1;

    fn grid(dims: [u32; 3], value: impl Fn(Vec3) -> f32 + Sync) -> DensityGrid {
        let dims = UVec3::from(dims);
        DensityGrid::from_fn(WorldPoint(dims.as_vec3() * (-0.5 * H)), H, dims, 1 << 30, |p| value(p.0)).unwrap()
    }

    fn even(v: Vec3) -> VelocityGrid {
        let part = |x: f32| grid([64, 64, 32], |_| x.max(0.0));
        VelocityGrid::new(v.to_array().map(|x| [part(x), part(-x)]), 1.0)
    }

    fn blob(p: Vec3) -> f32 {
        (1.0 - (p / Vec3::new(0.8, 0.5, 0.4)).length_squared()).max(0.0)
    }

    #[test]
    fn even_motion_is_the_mean_of_moved_grids_and_keeps_its_mass() {
        let density = grid([24, 24, 16], blob);
        let v = Vec3::new(4.0, -2.0, 0.5);
        for shutter in [[-0.1, 0.1], [0.0, 0.2], [-0.3, -0.1]] {
            let made = blurred(&density, &even(v), shutter, 1 << 30, &Silent).unwrap();
            assert!((made.mass() / density.mass() - 1.0).abs() < 1e-3, "{shutter:?}");
            let mut worst = 0.0f32;
            for i in 0..4000 {
                let a = i as f32;
                let p = Vec3::new((a * 0.71).sin() * 2.0, (a * 1.37).cos() * 1.2, (a * 2.11).sin() * 0.6);
                let voxel = ((p.as_dvec3() - density.origin()) / f64::from(H)).floor().as_ivec3();
                let center = (density.origin() + (voxel.as_dvec3() + 0.5) * f64::from(H)).as_vec3();
                let moved = |k: u32| {
                    let time = shutter[0] + (shutter[1] - shutter[0]) * (f64::from(k) + 0.5) / 64.0;
                    density.density_at(density.to_index(WorldPoint(center - v * time as f32)))
                };
                let mean = (0..64).map(moved).sum::<f32>() / 64.0;
                worst = worst.max((made.voxel(voxel) - mean).abs());
            }
            println!("{shutter:?}: off by at most {worst:.4} of a density of 1");
            assert!(worst < 0.02, "{shutter:?}: {worst}");
        }
    }

    #[test]
    fn what_does_not_move_keeps_its_bits() {
        let density = grid([24, 24, 16], blob);
        assert_eq!(blurred(&density, &even(Vec3::ZERO), [-0.1, 0.1], 1 << 30, &Silent).unwrap(), density);
        // Velocities on the left only: on the right nothing changes.
        let left = |p: Vec3| if p.x < -0.3 { 3.0 } else { 0.0 };
        let none = grid([8, 8, 8], |_| 0.0);
        let parts = [[grid([64, 64, 32], left), none.clone()], [none.clone(), none.clone()], [none.clone(), none]];
        let made = blurred(&density, &VelocityGrid::new(parts, 1.0), [-0.1, 0.1], 1 << 30, &Silent).unwrap();
        let (mut same, mut other) = (0, 0);
        for i in 0..24 * 24 * 16 {
            let voxel = IVec3::new(i % 24, i / 24 % 24, i / 576);
            let is_right = (density.origin().x as f32 + (voxel.x as f32 + 0.5) * H) > -0.15;
            assert!(!is_right || made.voxel(voxel) == density.voxel(voxel));
            same += i32::from(is_right && density.voxel(voxel) > 0.0);
            other += i32::from(made.voxel(voxel) != density.voxel(voxel));
        }
        assert!(same > 300 && other > 100, "{same} {other}");
    }

    /// Velocities to the right, on voxels four times as large as those of the density.
    fn outliers(value: impl Fn(Vec3) -> f32 + Sync) -> VelocityGrid {
        let none = grid([8, 8, 8], |_| 0.0);
        let (dims, h) = (UVec3::new(64, 16, 16), 4.0 * H);
        let fast =
            DensityGrid::from_fn(WorldPoint(dims.as_vec3() * (-0.5 * h)), h, dims, 1 << 30, |p| value(p.0)).unwrap();
        VelocityGrid::new([[fast, none.clone()], [none.clone(), none.clone()], [none.clone(), none]], 1.0)
    }

    #[test]
    fn a_few_voxels_that_are_fast_make_no_large_grid() {
        let density = grid([24, 24, 16], blob);
        let slow = |p: Vec3| if p.length() < 3.0 { 0.5 } else { 0.0 };
        // Two corners of the velocities are absurd, as the edges of simulations are.
        let absurd = |p: Vec3| if p.x.abs() > 12.4 && p.y > 2.8 && p.z > 2.8 { 1e6 } else { slow(p) };
        let limit = 16 << 20;
        for shutter in [[-0.1, 0.1], [0.0, 0.5]] {
            let expected = blurred(&density, &outliers(slow), shutter, limit, &Silent).unwrap();
            let made = blurred(&density, &outliers(absurd), shutter, limit, &Silent).unwrap();
            for i in 0..64 * 48 * 32 {
                let voxel = IVec3::new(i % 64 - 20, i / 64 % 48 - 12, i / 3072 - 8);
                assert_eq!(made.voxel(voxel), expected.voxel(voxel), "{voxel}");
            }
            assert!((made.mass() / density.mass() - 1.0).abs() < 0.05);
        }
    }

    #[test]
    fn density_is_found_wherever_a_velocity_brings_it() {
        // Alone far to the left, all that comes to the right is brought by what is fast there.
        let density = grid([24, 24, 16], blob);
        let right = |p: Vec3| if p.x > 8.0 { 100.0 } else { 0.0 };
        let velocity = outliers(right);
        let made = blurred(&density, &velocity, [0.05, 0.15], 64 << 20, &Silent).unwrap();
        let (mut seen, h) = (0, f64::from(H));
        for i in 0..120 * 24 * 16 {
            let voxel = IVec3::new(i % 120, i / 120 % 24, i / 2880);
            let value = mean(&density, &velocity, [0.05, 0.15], voxel);
            assert_eq!(made.voxel(voxel), value, "{voxel}");
            let x = density.origin().x + (f64::from(voxel.x) + 0.5) * h;
            seen += i32::from(x > 8.5 && value > 0.0);
        }
        assert!(seen > 500, "{seen}");
    }

    #[test]
    fn more_bricks_than_fit_are_refused_before_they_are_made_and_work_can_be_stopped() {
        struct Stopped;
        impl Progress for Stopped {
            fn is_cancelled(&self) -> bool {
                true
            }
        }
        let density = grid([24, 24, 16], blob);
        let wind = outliers(|_| 60.0);
        let error = blurred(&density, &wind, [-0.1, 0.1], 2 << 20, &Silent).unwrap_err();
        let GridError::OverMemory { needed_bytes, brick_count, .. } = error else { panic!("{error}") };
        assert!(needed_bytes > 2 << 20 && brick_count > 1000, "{needed_bytes} {brick_count}");
        let error = blurred(&density, &wind, [-0.1, 0.1], 1 << 30, &Stopped).unwrap_err();
        assert_eq!(error, GridError::Cancelled);
    }
}
