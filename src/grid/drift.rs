//! Motion blur of density from elsewhere, by a velocity on voxels.
//!
//! What is at `x` at time `t` of the shutter was at the frame at `x − v(x)·t`, as far as the velocity there is the one that
//! brought it: exact of even motion, off by `t²` times how the velocity changes along its way elsewhere. The density of the frame
//! becomes the mean over the shutter, taken at midpoints at most half a voxel of the way apart, on the same voxels.
//!
//! Many programs store velocities only where smoke is, and smoke drifts beyond. Where neither is stored, the velocity is the mean of
//! the smoke nearby, weighted by mass, in cubes that grow until they hold some.

use crate::grid::{
    BRICK_EDGE, BRICK_VOXELS, BrickValues, DensityGrid, GridError, brick_box, check_memory, local_voxel, needed_bytes,
};
use crate::math::parallel;
use crate::math::space::WorldPoint;
use crate::progress::Progress;
use glam::{DVec3, IVec3, Vec3};
use std::collections::BTreeMap;

/// Bricks between two looks at whether to stop.
const BRICKS_AT_ONCE: usize = 1024;

/// Most midpoints of a voxel; longer ways than 256 voxels become dotted.
const SAMPLES_MAX: u32 = 512;
/// Midpoints for each voxel of the way.
const SAMPLES_PER_VOXEL: f32 = 2.0;

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

    /// No speed is above this [m/s].
    pub fn max_speed(&self) -> f32 {
        let most = |[up, down]: &[DensityGrid; 2]| up.max_density().max(down.max_density());
        self.factor.abs() * Vec3::from(self.parts.each_ref().map(most)).length()
    }
}

/// The mean of `density` over the times of `shutter`, relative to the frame [s]. The grid grows by as much as the fastest goes.
///
/// # Errors
/// [`GridError::OverMemory`] before anything large is allocated, and where velocities reach too far; [`GridError::Cancelled`].
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
    let occupied: Vec<IVec3> = density.occupied_bricks().map(|(coord, _)| coord).collect();
    let coords = dilated(&occupied, reach, memory_limit_bytes)?;
    let nearby = Nearby::new(density, velocity, reach);
    let (_, dims) = brick_box(&coords)?;
    let held = coords.len() * (size_of::<BrickValues>() + size_of::<IVec3>());
    check_memory(dims, coords.len() as u64, held as u64, memory_limit_bytes)?;
    let mut values: Vec<BrickValues> = vec![[0.0; BRICK_VOXELS]; coords.len()];
    for (coords, values) in coords.chunks(BRICKS_AT_ONCE).zip(values.chunks_mut(BRICKS_AT_ONCE)) {
        if progress.is_cancelled() {
            return Err(GridError::Cancelled);
        }
        parallel::for_each_mut(values, |n, brick| {
            for (i, value) in brick.iter_mut().enumerate() {
                let voxel = coords[n] * BRICK_EDGE as i32 + local_voxel(i).as_ivec3();
                *value = mean(density, velocity, &nearby, shutter, voxel);
            }
        });
    }
    DensityGrid::from_bricks(density.origin(), h, &coords, &values, memory_limit_bytes)
}

/// The mean of one voxel.
fn mean(density: &DensityGrid, velocity: &VelocityGrid, nearby: &Nearby, shutter: [f64; 2], voxel: IVec3) -> f32 {
    let h = density.voxel_size();
    let center = center_of(density, voxel);
    let mut v = velocity.at(WorldPoint(center));
    if v == Vec3::ZERO {
        let own = density.voxel(voxel);
        if own > 0.0 {
            return own;
        }
        v = nearby.velocity(voxel);
        if v == Vec3::ZERO {
            return 0.0;
        }
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

fn center_of(density: &DensityGrid, voxel: IVec3) -> Vec3 {
    (density.origin() + (voxel.as_dvec3() + 0.5) * f64::from(density.voxel_size())).as_vec3()
}

/// Memory of what is nearby for each brick of the density [bytes].
const NEARBY_BYTES: u64 = 6 << 10;

/// Mass and momentum of the smoke in cubes of 2, 4, 8 … voxels, where there is some.
struct Nearby(Vec<BTreeMap<[i32; 3], [f64; 4]>>);

impl Nearby {
    /// In cubes up to `reach` voxels.
    fn new(density: &DensityGrid, velocity: &VelocityGrid, reach: f32) -> Self {
        let bricks: Vec<_> = density.occupied_bricks().collect();
        let smallest = parallel::gather(bricks.len(), |n, cubes: &mut Vec<([i32; 3], [f64; 4])>| {
            let (brick, values) = &bricks[n];
            let mut of_brick = BTreeMap::<_, [f64; 4]>::new();
            for (i, &mass) in values.iter().enumerate().filter(|&(_, &mass)| mass > 0.0) {
                let voxel = *brick * BRICK_EDGE as i32 + local_voxel(i).as_ivec3();
                let v = velocity.at(WorldPoint(center_of(density, voxel))).as_dvec3() * f64::from(mass);
                let cube: IVec3 = voxel >> 1;
                let cube = of_brick.entry(cube.to_array()).or_default();
                [f64::from(mass), v.x, v.y, v.z].iter().zip(cube).for_each(|(value, sum)| *sum += value);
            }
            cubes.extend(of_brick);
        });
        let mut levels = vec![BTreeMap::from_iter(smallest)];
        for _ in 1..=reach.log2().ceil().clamp(0.0, 22.0) as u32 {
            let mut larger = BTreeMap::<_, [f64; 4]>::new();
            for (cube, values) in levels.last().into_iter().flatten() {
                let sums = larger.entry(cube.map(|x| x >> 1)).or_default();
                values.iter().zip(sums).for_each(|(value, sum)| *sum += value);
            }
            levels.push(larger);
        }
        Self(levels)
    }

    /// The velocity about a voxel without smoke; 0 where none is nearby.
    fn velocity(&self, voxel: IVec3) -> Vec3 {
        for (level, cubes) in self.0.iter().enumerate() {
            let edge = f64::from(2u32 << level);
            let place = (voxel.as_dvec3() + 0.5) / edge - 0.5;
            let (low, share) = (place.floor(), place - place.floor());
            let mut sums = [0.0; 4];
            for corner in 0..8 {
                let step = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
                let Some(values) = cubes.get(&(low.as_ivec3() + step).to_array()) else { continue };
                let weight = DVec3::select(step.cmpeq(IVec3::ONE), share, 1.0 - share).element_product();
                values.iter().zip(&mut sums).for_each(|(value, sum)| *sum += weight * value);
            }
            let [mass, x, y, z] = sums;
            if mass > 0.0 {
                return (DVec3::new(x, y, z) / mass).as_vec3();
            }
        }
        Vec3::ZERO
    }
}

/// All bricks within `reach` voxels of some.
fn dilated(bricks: &[IVec3], reach: f32, memory_limit_bytes: u64) -> Result<Vec<IVec3>, GridError> {
    // A voxel more, for what is interpolated.
    let far = ((f64::from(reach) + 1.0) / BRICK_EDGE as f64).ceil();
    let edge = 2.0 * far + 1.0;
    // A list of that many is held before it is known how many are the same.
    let brick_count = (bricks.len() as f64 * edge.powi(3)).min(1e18) as u64;
    let low = bricks.iter().copied().reduce(IVec3::min).unwrap_or_default();
    let high = bricks.iter().copied().reduce(IVec3::max).unwrap_or_default();
    let dims = (high - low).as_dvec3() + edge + 1.0;
    let dims = dims.min(DVec3::splat(4e9)).as_u64vec3();
    let needed_bytes = needed_bytes(dims, 0)
        .saturating_add(brick_count.saturating_mul(8))
        .saturating_add(bricks.len() as u64 * NEARBY_BYTES);
    if needed_bytes > memory_limit_bytes {
        let voxels = dims.saturating_mul(glam::U64Vec3::splat(BRICK_EDGE as u64));
        return Err(GridError::OverMemory { voxels, brick_count, needed_bytes, limit_bytes: memory_limit_bytes });
    }
    let (far, dims) = (far as i32, dims.as_i64vec3());
    let first = low - far;
    let mut places: Vec<u64> = parallel::gather(bricks.len(), |n, places| {
        for z in -far..=far {
            for y in -far..=far {
                for x in -far..=far {
                    let p = (bricks[n] + IVec3::new(x, y, z) - first).as_i64vec3();
                    places.push(((p.z * dims.y + p.y) * dims.x + p.x) as u64);
                }
            }
        }
    });
    parallel::sort(&mut places);
    places.dedup();
    let coord = |place: &u64| {
        let place = *place as i64;
        let p = glam::I64Vec3::new(place % dims.x, place / dims.x % dims.y, place / dims.x / dims.y);
        first + p.as_ivec3()
    };
    Ok(places.iter().map(coord).collect())
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

    #[test]
    fn speeds_beyond_all_memory_are_refused() {
        let density = grid([24, 24, 16], blob);
        let error = blurred(&density, &even(Vec3::X * 1e9), [-1.0, 1.0], 1 << 30, &Silent).unwrap_err();
        assert!(matches!(error, GridError::OverMemory { .. }), "{error}");
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
        let wind = even(Vec3::X * 60.0);
        let error = blurred(&density, &wind, [-0.1, 0.1], 12 << 20, &Silent).unwrap_err();
        assert!(matches!(error, GridError::OverMemory { needed_bytes, .. } if needed_bytes > 12 << 20), "{error}");
        let error = blurred(&density, &wind, [-0.1, 0.1], 1 << 30, &Stopped).unwrap_err();
        assert_eq!(error, GridError::Cancelled);
    }
}
