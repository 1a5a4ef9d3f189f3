//! Density on voxels.
//!
//! **Voxel convention, said once.** Voxel (i, j, k) stores the density *at its centre*, world position
//! `origin + (i + ½, j + ½, k + ½)·h`. Between centres the field is trilinear; outside the stored voxels it is zero.
//! In index space sample (i, j, k) sits at exactly (i, j, k), so a world point is at index
//! `(point − origin)/h − ½`.
//!
//! Voxels are kept in bricks of 8³. A brick stores 9³ samples: its own and the first layer of the next bricks, so that
//! every one of the 8 samples that a point interpolates from is in the brick of its cell, and a read touches one brick.

pub mod drift;
pub mod kernel;
pub mod level_set;
pub mod lookup;
pub mod majorant;
pub mod means;
mod rough;
pub mod soft;
pub mod splat;
mod streak;
pub mod vdb;
mod walls;

use crate::grid::rough::{RoughBrick, RoughBricks};
use crate::math::aabb::Aabb;
use crate::math::lattice::Lattice;
use crate::math::parallel;
use crate::math::space::WorldPoint;
use glam::{DVec3, IVec3, UVec3, Vec3};

/// Voxels along the edge of a brick.
pub const BRICK_EDGE: usize = 8;
/// Samples along the stored edge of a brick: one more, shared with the next brick.
const STORED_EDGE: usize = BRICK_EDGE + 1;
/// Voxels of a brick.
pub const BRICK_VOXELS: usize = BRICK_EDGE * BRICK_EDGE * BRICK_EDGE;
const STORED_SAMPLES: usize = STORED_EDGE * STORED_EDGE * STORED_EDGE;

/// Samples of one brick and of the layer behind it, x fastest.
pub(crate) type StoredBrick = [f32; STORED_SAMPLES];
/// Densities of the voxels of one brick, x fastest.
pub type BrickValues = [f32; BRICK_VOXELS];

/// Furthest voxel from the world's origin: beyond it single precision cannot tell neighbouring voxels apart well.
pub const MAX_COORDINATE: i32 = 1 << 22;

/// What can go wrong while a density grid is made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GridError {
    /// The grid would need more memory than allowed; nothing was allocated.
    #[error(
        "a grid of {}×{}×{} voxels ({brick_count} occupied bricks) and making it need {:.1} MiB, more than the {:.1} MiB that \
         particles, picture and tables of suns leave within the limit; use larger voxels or a smaller region, or raise --memory-limit",
        voxels.x, voxels.y, voxels.z, *needed_bytes as f64 / 1048576.0, *limit_bytes as f64 / 1048576.0
    )]
    OverMemory {
        /// Voxels along the edges of the box around all occupied bricks.
        voxels: glam::U64Vec3,
        /// Bricks that hold density.
        brick_count: u64,
        /// What it would take [bytes].
        needed_bytes: u64,
        /// What is allowed [bytes].
        limit_bytes: u64,
    },
    /// The voxel edge is not a positive number.
    #[error("the voxel size must be a positive number of metres, found {0}")]
    VoxelSize(f64),
    /// A density is negative, infinite or not a number.
    #[error("the density of voxel ({}, {}, {}) is {value}; densities must be finite and at least 0", voxel.x, voxel.y, voxel.z)]
    BadDensity {
        /// The voxel.
        voxel: IVec3,
        /// What it holds.
        value: f32,
    },
    /// A particle has a value that is infinite, not a number, or out of range.
    #[error("particle {particle_idx}: {what}, found {value}")]
    BadParticle {
        /// Position in the arrays.
        particle_idx: usize,
        /// What is required.
        what: &'static str,
        /// What was found.
        value: f32,
    },
    /// Voxels further from the world's origin than single precision resolves.
    #[error(
        "density at voxel ({}, {}, {}) is more than {MAX_COORDINATE} voxels from the origin; use larger voxels or move the scene",
        voxel.x, voxel.y, voxel.z
    )]
    TooFar {
        /// The voxel.
        voxel: glam::I64Vec3,
    },
    /// Arrays that describe the same particles have different lengths.
    #[error("the particle arrays have different lengths: {0} and {1}")]
    Lengths(usize, usize),
    /// The caller asked to stop.
    #[error("stopped while making a grid")]
    Cancelled,
}

/// Density on a sparse set of voxels; see the module for where voxels sit.
#[derive(Debug, Clone, PartialEq)]
pub struct DensityGrid {
    voxel_size: f32,
    origin: DVec3,
    /// Brick coordinates of the lattice's first brick, counted from `origin`.
    brick_min: IVec3,
    /// Number of the brick at each place of the box around all occupied bricks; 0 where there is none.
    directory: Lattice<u32>,
    /// Brick 0 is empty and answers for all places without one.
    bricks: Vec<StoredBrick>,
    /// The same bricks in bytes.
    rough: RoughBricks,
    /// World position of the low corner of the directory [m].
    corner: Vec3,
    inverse_voxel_size: f32,
    /// Voxels along the edges of the directory.
    extent: Vec3,
}

impl DensityGrid {
    /// A grid from the bricks that hold density, in any order: `coords` in units of bricks (voxel (i, j, k) is in
    /// brick (⌊i/8⌋, ⌊j/8⌋, ⌊k/8⌋)) and the voxels of each. `origin` [m] is the low corner of voxel (0, 0, 0).
    ///
    /// # Errors
    /// [`GridError::OverMemory`] before anything large is allocated; [`GridError::BadDensity`],
    /// [`GridError::VoxelSize`], [`GridError::TooFar`].
    ///
    /// # Panics
    /// When a brick comes twice, or the slices differ in length.
    pub fn from_bricks(
        origin: DVec3,
        voxel_size: f32,
        coords: &[IVec3],
        values: &[BrickValues],
        memory_limit_bytes: u64,
    ) -> Result<Self, GridError> {
        assert_eq!(coords.len(), values.len());
        if !(voxel_size.is_finite() && voxel_size > 0.0) {
            return Err(GridError::VoxelSize(f64::from(voxel_size)));
        }
        check_values(coords, values)?;
        let (brick_min, dims) = brick_box(coords)?;
        check_memory(dims, coords.len() as u64, 0, memory_limit_bytes)?;
        let dims = dims.as_uvec3();
        let sources = place_sources(coords, brick_min, dims);
        let (directory, occupied) = occupied_bricks(&sources, coords, values, brick_min);
        check_memory(dims.as_u64vec3(), occupied.len() as u64, 0, memory_limit_bytes)?;
        let mut bricks = vec![[0.0; STORED_SAMPLES]; occupied.len() + 1];
        parallel::for_each_mut(&mut bricks[1..], |i, brick| fill_brick(brick, occupied[i], &sources, values));
        let h = f64::from(voxel_size);
        Ok(Self {
            voxel_size,
            origin,
            brick_min,
            directory,
            rough: RoughBricks::new(&bricks),
            bricks,
            corner: (origin + (brick_min * BRICK_EDGE as i32).as_dvec3() * h).as_vec3(),
            inverse_voxel_size: (1.0 / h) as f32,
            extent: (dims * BRICK_EDGE as u32).as_vec3(),
        })
    }

    /// A grid of the values of a dense lattice: point (i, j, k) of `values` is voxel (i, j, k), and `origin` [m] is the
    /// low corner of voxel (0, 0, 0).
    ///
    /// # Errors
    /// As for [`DensityGrid::from_bricks`].
    pub fn from_dense(
        origin: WorldPoint,
        voxel_size: f32,
        values: &Lattice<f32>,
        memory_limit_bytes: u64,
    ) -> Result<Self, GridError> {
        let dims = values.dims();
        let bricks_each = (dims.as_u64vec3() + (BRICK_EDGE as u64 - 1)) / BRICK_EDGE as u64;
        check_memory(bricks_each, bricks_each.element_product(), 0, memory_limit_bytes)?;
        let coords: Vec<IVec3> = box_points(bricks_each.as_uvec3()).map(|p| p.as_ivec3()).collect();
        let mut bricks = vec![[0.0; BRICK_VOXELS]; coords.len()];
        parallel::for_each_mut(&mut bricks, |n, brick| {
            for (i, value) in brick.iter_mut().enumerate() {
                let voxel = coords[n] * BRICK_EDGE as i32 + local_voxel(i).as_ivec3();
                *value = values.get(voxel).unwrap_or_default();
            }
        });
        Self::from_bricks(origin.0.as_dvec3(), voxel_size, &coords, &bricks, memory_limit_bytes)
    }

    /// A grid of `dims` voxels whose values are `density` at the voxels' centres.
    ///
    /// # Errors
    /// As for [`DensityGrid::from_bricks`].
    pub fn from_fn(
        origin: WorldPoint,
        voxel_size: f32,
        dims: UVec3,
        memory_limit_bytes: u64,
        density: impl Fn(WorldPoint) -> f32 + Sync,
    ) -> Result<Self, GridError> {
        let bricks_each = (dims.as_u64vec3() + (BRICK_EDGE as u64 - 1)) / BRICK_EDGE as u64;
        check_memory(bricks_each, bricks_each.element_product(), 0, memory_limit_bytes)?;
        let mut values = Lattice::filled(dims, 0.0);
        parallel::for_each_chunk_mut(values.values_mut(), dims.x.max(1) as usize, |n, row| {
            let (j, k) = (n as u32 % dims.y, n as u32 / dims.y);
            for (i, value) in row.iter_mut().enumerate() {
                *value = density(origin + (UVec3::new(i as u32, j, k).as_vec3() + 0.5) * voxel_size);
            }
        });
        Self::from_dense(origin, voxel_size, &values, memory_limit_bytes)
    }

    /// Every density replaced by what `change` makes of it: finite, at least 0, and 0 of 0, since there is smoke nowhere else.
    pub fn map(mut self, change: impl Fn(f32) -> f32 + Sync) -> Self {
        debug_assert_eq!(change(0.0), 0.0, "what is outside of the grid cannot become smoke");
        parallel::for_each_mut(&mut self.bricks, |_, brick| brick.iter_mut().for_each(|value| *value = change(*value)));
        self.rough = RoughBricks::new(&self.bricks);
        self
    }

    /// Edge of a voxel [m].
    pub fn voxel_size(&self) -> f32 {
        self.voxel_size
    }

    /// Low corner of voxel (0, 0, 0) [m].
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// The box [m] outside of which the interpolated density is zero: of the occupied bricks, not of each voxel.
    pub fn bounds(&self) -> Aabb {
        if self.is_empty() {
            return Aabb::EMPTY;
        }
        // The lowest layer of bricks holds no voxel, only the cells that reach up to the next layer's first voxels; index
        // 0 is half a voxel inside the corner.
        let low = self.corner + (BRICK_EDGE as f32 - 0.5) * self.voxel_size;
        Aabb::new(low, self.corner + (self.extent + 0.5) * self.voxel_size)
    }

    /// True when no voxel holds density.
    pub fn is_empty(&self) -> bool {
        self.bricks.len() <= 1
    }

    /// Total mass, Σ density·h³ [density·m³], summed in a fixed order.
    pub fn mass(&self) -> f64 {
        let sum = |n: usize| own_voxels(&self.bricks[n]).map(|(_, v)| f64::from(v)).sum::<f64>();
        let sums = parallel::map(self.bricks.len(), sum);
        sums.iter().sum::<f64>() * f64::from(self.voxel_size).powi(3)
    }

    /// Voxels whose density is not zero.
    pub fn active_voxel_count(&self) -> u64 {
        let count = |n: usize| own_voxels(&self.bricks[n]).filter(|&(_, v)| v != 0.0).count() as u64;
        parallel::sum(self.bricks.len(), count)
    }

    /// Stored bricks.
    pub fn brick_count(&self) -> usize {
        self.bricks.len() - 1
    }

    /// Largest density of all voxels.
    pub fn max_density(&self) -> f32 {
        let largest = |n: usize| self.bricks[n].iter().copied().fold(0.0, f32::max);
        parallel::map(self.bricks.len(), largest).into_iter().fold(0.0, f32::max)
    }

    /// Memory that the grid holds [bytes].
    pub fn memory_bytes(&self) -> u64 {
        (size_of_val(self.bricks.as_slice()) + self.rough.memory_bytes() + size_of_val(self.directory.values())) as u64
    }

    /// Brick coordinates and voxels of every brick that has a voxel with density, z slowest.
    pub fn occupied_bricks(&self) -> impl Iterator<Item = (IVec3, BrickValues)> + '_ {
        box_points(self.directory.dims()).filter_map(|p| {
            let brick = &self.bricks[self.directory.at(p) as usize];
            let mut values = [0.0; BRICK_VOXELS];
            own_voxels(brick).for_each(|(i, v)| values[i] = v);
            values.iter().any(|&v| v != 0.0).then(|| (self.brick_min + p.as_ivec3(), values))
        })
    }

    /// Density of voxel (i, j, k) counted from [`DensityGrid::origin`]; 0 where nothing is stored.
    pub fn voxel(&self, voxel: IVec3) -> f32 {
        let local = voxel - self.brick_min * BRICK_EDGE as i32;
        let brick_idx = self.directory.get(local.div_euclid(IVec3::splat(BRICK_EDGE as i32))).unwrap_or(0);
        self.bricks[brick_idx as usize][stored_offset((local & 7).as_uvec3())]
    }
}

/// Points of the box `0 .. dims`, x fastest.
fn box_points(dims: UVec3) -> impl Iterator<Item = UVec3> {
    (0..dims.z).flat_map(move |z| (0..dims.y).flat_map(move |y| (0..dims.x).map(move |x| UVec3::new(x, y, z))))
}

/// Place within its brick of voxel number `i` of [`BrickValues`].
pub fn local_voxel(i: usize) -> UVec3 {
    UVec3::new(i as u32 & 7, (i as u32 >> 3) & 7, i as u32 >> 6)
}

fn stored_offset(p: UVec3) -> usize {
    (p.z as usize * STORED_EDGE + p.y as usize) * STORED_EDGE + p.x as usize
}

/// The brick's own voxels without the layer shared with the next: number in [`BrickValues`] and density.
fn own_voxels(brick: &StoredBrick) -> impl Iterator<Item = (usize, f32)> + '_ {
    (0..BRICK_VOXELS).map(|i| (i, brick[stored_offset(local_voxel(i))]))
}

fn check_values(coords: &[IVec3], values: &[BrickValues]) -> Result<(), GridError> {
    let bad = |b: &BrickValues| b.iter().position(|v| !(*v >= 0.0 && v.is_finite()));
    match parallel::find_first(values.len(), |idx| Some((idx, bad(&values[idx])?))) {
        None => Ok(()),
        Some((idx, i)) => {
            let voxel =
                coords[idx].saturating_mul(IVec3::splat(BRICK_EDGE as i32)).saturating_add(local_voxel(i).as_ivec3());
            Err(GridError::BadDensity { voxel, value: values[idx][i] })
        }
    }
}

/// First brick and size of the box around all bricks and those below them, which hold the cells that reach up to them.
fn brick_box(coords: &[IVec3]) -> Result<(IVec3, glam::U64Vec3), GridError> {
    let Some(&first) = coords.first() else { return Ok((IVec3::ZERO, glam::U64Vec3::ZERO)) };
    let (min, max) = coords.iter().fold((first, first), |(a, b), &c| (a.min(c), b.max(c)));
    for corner in [min, max] {
        let voxel = corner.as_i64vec3() * BRICK_EDGE as i64;
        if voxel.abs().max_element() > i64::from(MAX_COORDINATE) {
            return Err(GridError::TooFar { voxel });
        }
    }
    Ok((min - 1, (max - min + 2).as_u64vec3()))
}

/// Bytes of a directory of `dims` bricks with `brick_count` occupied, with its majorants and what assembling it takes.
pub(crate) fn needed_bytes(dims: glam::U64Vec3, brick_count: u64) -> u64 {
    // Directory, the sources' directory while assembling, majorants on cells of 4³.
    let per_place = 4 + 4 + 8 * 4;
    // What is stored, what it is made of, places that may be occupied, and bounds of occupied cells twice while they are collected.
    let per_brick = (size_of::<StoredBrick>()
        + size_of::<RoughBrick>()
        + size_of::<BrickValues>()
        + 9 * size_of::<UVec3>()
        + 2 * 8 * 4) as u64;
    let places = [dims.x, dims.y, dims.z].iter().fold(1u64, |a, &b| a.saturating_mul(b));
    places.saturating_mul(per_place).saturating_add(brick_count.saturating_mul(per_brick))
}

/// An error where a grid and `beside_bytes` of other things do not fit.
fn check_memory(dims: glam::U64Vec3, brick_count: u64, beside_bytes: u64, limit_bytes: u64) -> Result<(), GridError> {
    let needed_bytes = needed_bytes(dims, brick_count).saturating_add(beside_bytes);
    let places = dims.x.checked_mul(dims.y).and_then(|p| p.checked_mul(dims.z));
    // Offsets into the finer majorant lattice are 32 bits wide.
    if needed_bytes > limit_bytes || places.is_none_or(|p| p > u64::from(u32::MAX) / 8) {
        let voxels = dims.saturating_mul(glam::U64Vec3::splat(BRICK_EDGE as u64));
        return Err(GridError::OverMemory { voxels, brick_count, needed_bytes, limit_bytes });
    }
    Ok(())
}

/// For each place of the box, 1 + the number of the brick given for it, or 0.
fn place_sources(coords: &[IVec3], brick_min: IVec3, dims: UVec3) -> Lattice<u32> {
    let mut sources = Lattice::filled(dims, 0u32);
    for (idx, &c) in coords.iter().enumerate() {
        let place = (c - brick_min).as_uvec3();
        assert_eq!(sources.at(place), 0, "brick {c} comes twice");
        sources.set(place, idx as u32 + 1);
    }
    sources
}

/// The directory, and the places of bricks 1, 2, … : those of which any stored sample is not zero.
fn occupied_bricks(
    sources: &Lattice<u32>,
    coords: &[IVec3],
    values: &[BrickValues],
    brick_min: IVec3,
) -> (Lattice<u32>, Vec<UVec3>) {
    let dims = sources.dims();
    // Bit (x, y, z): some voxel of the brick's low faces along the axes set is not zero (bit 0: any voxel at all).
    let faces: Vec<u8> = parallel::map(values.len(), |idx| low_faces(&values[idx]));
    let is_occupied = |p: UVec3| {
        (0..8u32).any(|towards| {
            let step = UVec3::new(towards & 1, (towards >> 1) & 1, towards >> 2);
            match sources.get((p + step).as_ivec3()) {
                Some(idx) if idx > 0 => faces[idx as usize - 1] & (1 << towards) != 0,
                _ => false,
            }
        })
    };
    // Only a given brick and those below it can be: the box around a few far bricks is large and empty.
    let mut below: Vec<u64> = parallel::gather(coords.len(), |n, offsets| {
        let own = (coords[n] - brick_min).as_uvec3();
        offsets.extend(box_points(UVec3::splat(2)).map(|step| sources.offset(own - step) as u64));
    });
    parallel::sort(&mut below);
    below.dedup();
    let occupied: Vec<UVec3> = parallel::gather(below.len(), |n, places| {
        places.extend(Some(sources.point(below[n] as usize)).filter(|&p| is_occupied(p)));
    });
    let mut directory = Lattice::filled(dims, 0u32);
    for (i, &p) in occupied.iter().enumerate() {
        directory.set(p, i as u32 + 1);
    }
    (directory, occupied)
}

/// Bit `a` (a set of axes, x = 1, y = 2, z = 4) says that a voxel whose coordinates along these axes are 0 is not zero.
fn low_faces(brick: &BrickValues) -> u8 {
    let mut faces = 0;
    for (i, _) in brick.iter().enumerate().filter(|(_, v)| **v != 0.0) {
        let p = local_voxel(i);
        let zero_axes = u8::from(p.x == 0) | u8::from(p.y == 0) << 1 | u8::from(p.z == 0) << 2;
        for axes in 0..8u8 {
            faces |= u8::from(axes & !zero_axes == 0) << axes;
        }
    }
    faces
}

fn fill_brick(brick: &mut StoredBrick, place: UVec3, sources: &Lattice<u32>, values: &[BrickValues]) {
    for towards in 0..8u32 {
        let step = UVec3::new(towards & 1, (towards >> 1) & 1, towards >> 2);
        let Some(idx @ 1..) = sources.get((place + step).as_ivec3()) else { continue };
        let source = &values[idx as usize - 1];
        let n = (UVec3::ONE - step) * (BRICK_EDGE as u32 - 1) + 1;
        for p in box_points(n) {
            let to = stored_offset(p + step * BRICK_EDGE as u32);
            brick[to] = source[((p.z * 8 + p.y) * 8 + p.x) as usize];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sloped(dims: UVec3) -> Lattice<f32> {
        let mut l = Lattice::filled(dims, 0.0);
        for p in box_points(dims) {
            l.set(p, 1.0 + p.x as f32 + 100.0 * p.y as f32 + 10_000.0 * p.z as f32);
        }
        l
    }

    #[test]
    fn voxels_come_back_as_they_were_and_are_zero_outside() {
        let dims = UVec3::new(17, 9, 8);
        let dense = sloped(dims);
        let grid = DensityGrid::from_dense(WorldPoint::new(1.0, 2.0, 3.0), 0.5, &dense, 1 << 20).unwrap();
        for p in box_points(dims + 4) {
            let p = p.as_ivec3() - 2;
            assert_eq!(grid.voxel(p), dense.get(p).unwrap_or(0.0), "{p}");
        }
        assert_eq!(grid.active_voxel_count(), 17 * 9 * 8);
        let sum: f64 = dense.values().iter().map(|&v| f64::from(v)).sum();
        assert!((grid.mass() - sum * 0.125).abs() < 1e-9 * sum);
    }

    #[test]
    fn a_far_voxel_is_refused_with_the_figure_before_allocating() {
        let one = [[1.0; BRICK_VOXELS]; 2];
        let far = IVec3::splat(100_000);
        let error = DensityGrid::from_bricks(DVec3::ZERO, 1.0, &[IVec3::ZERO, far], &one, 1 << 30).unwrap_err();
        assert!(matches!(error, GridError::OverMemory { needed_bytes, .. } if needed_bytes > 1 << 50), "{error}");
        let error = DensityGrid::from_bricks(DVec3::ZERO, 1.0, &[IVec3::MAX, IVec3::ZERO], &one, 1 << 30).unwrap_err();
        assert!(matches!(error, GridError::TooFar { .. }), "{error}");
    }

    #[test]
    fn bad_values_are_named_by_voxel() {
        let mut dense = sloped(UVec3::splat(10));
        dense.set(UVec3::new(9, 8, 7), f32::NAN);
        let error = DensityGrid::from_dense(WorldPoint::default(), 1.0, &dense, 1 << 20).unwrap_err();
        assert!(matches!(error, GridError::BadDensity { voxel, .. } if voxel == IVec3::new(9, 8, 7)), "{error}");
        let error = DensityGrid::from_dense(WorldPoint::default(), 0.0, &sloped(UVec3::ONE), 1 << 20).unwrap_err();
        assert_eq!(error, GridError::VoxelSize(0.0));
    }

    #[test]
    fn nothing_at_all_is_an_empty_grid() {
        let grid = DensityGrid::from_bricks(DVec3::ZERO, 1.0, &[], &[], 1 << 20).unwrap();
        assert!(grid.is_empty() && grid.bounds().is_empty() && grid.mass() == 0.0);
        let zeros = Lattice::filled(UVec3::splat(20), 0.0);
        let grid = DensityGrid::from_dense(WorldPoint::default(), 1.0, &zeros, 1 << 20).unwrap();
        assert!(grid.is_empty());
    }
}
