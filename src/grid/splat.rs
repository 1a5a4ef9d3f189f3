//! Particles to voxels, with mass conserved and the same bits whatever the number of threads.
//!
//! Particles come in batches, and may be forgotten batch by batch. Of each batch every (brick, piece) pair is listed and the
//! list sorted; each brick is then summed by one task in the order of the particles. Nothing is added in an order that depends
//! on scheduling or on where batches end.
//!
//! Near obstacles ([`crate::grid::soft`]) a kernel loses what it has in and behind walls. Its mass is given back to what
//! is left, so that mass is conserved: a first pass over the bricks finds the share of each particle that walls leave,
//! and the second divides by it.

use crate::grid::kernel::Kernel;
use crate::grid::means::MeanGrid;
use crate::grid::soft::{BrickDistances, SHARE_MIN, Seen, Sight, SplatMass, gain};
use crate::grid::walls::{BrickPairs, SeenPieces, Walls, piece_of};
use crate::grid::{BRICK_EDGE, BRICK_VOXELS, BrickValues, DensityGrid, GridError, MAX_COORDINATE, check_memory};
use crate::math::lanes::{self, Batch, run_kernel};
use crate::math::parallel;
use glam::{DVec3, IVec3, U64Vec3, UVec3};
use std::collections::BTreeMap;
use std::ops::Range;

use crate::grid::streak::{Extent, PIECE_BYTES, Piece, Pieces, Streaks};
pub use crate::grid::streak::{MAX_PIECES, SplatInput};

/// Most particles of a batch.
const BATCH: usize = 1 << 22;
/// Particles of the first batch, if they make no more pairs than a batch may have.
const FIRST_BATCH: usize = 1 << 17;
/// Pairs of a piece and a brick in a batch, unless it is of a single particle. Bricks that many batches reach are read and written
/// as often; pairs take memory.
const BATCH_TOUCHES: u64 = 3 << 19;
/// The same near obstacles, where pairs take more memory.
const BATCH_TOUCHES_SOFT: u64 = 1 << 20;
/// Memory of a pair while pairs are sorted [bytes].
const TOUCH_BYTES: u64 = 2 * size_of::<u64>() as u64;
/// The same of one near obstacles: its piece, what is seen, and shares as they are found and as they are collected.
const TOUCH_BYTES_SOFT: u64 = TOUCH_BYTES + (size_of::<Piece>() + size_of::<Seen>()) as u64 + 48;
/// Memory of a quantity that is carried in a brick: its sums, its means, and both as they are written to a file [bytes].
const CARRIED_BYTES: usize = BRICK_VOXELS * (8 + 4 + 4 + 4);

/// How to splat.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SplatSettings {
    /// Edge of a voxel [m].
    pub voxel_size: f32,
    /// Opening and closing of the shutter relative to the particles' instant [s]; equal for no motion blur.
    pub shutter_seconds: [f64; 2],
    /// Distance from obstacles at which kernels begin to fade [m], at least 0; each particle's own kernel radius where
    /// `None`. At 0 obstacles are ignored.
    pub soft_radius: Option<f64>,
    /// More memory than this is never asked for [bytes].
    pub memory_limit_bytes: u64,
}

/// The density of the particles, and what became of their mass.
#[derive(Debug, Clone, PartialEq)]
pub struct Splat {
    /// The density.
    pub grid: DensityGrid,
    /// Where the mass went.
    pub mass: SplatMass,
    /// The means of what particles carry, in the order of [`SplatInput::carried`].
    pub means: MeanGrid,
}

/// Splats particles onto the voxels whose low corner (0, 0, 0) is the world's origin. A particle is smeared evenly in time along
/// its way while the shutter is open, straight or bent as its input says, in pieces at most half a kernel radius apart; of its pieces those
/// count that can be seen from its position.
///
/// # Errors
/// [`GridError::BadParticle`] for the first particle with a value out of range, [`GridError::OverMemory`] before anything
/// large is allocated, [`GridError::Lengths`], [`GridError::VoxelSize`].
pub fn splat(input: &SplatInput, settings: &SplatSettings) -> Result<Splat, GridError> {
    let mut sum = SplatSum::try_new(*settings)?;
    sum.add(input)?;
    sum.finish()
}

/// Density while particles are added to it. The order of particles decides on the last bits, how they are spread over calls
/// does not.
#[derive(Debug)]
pub struct SplatSum {
    settings: SplatSettings,
    /// In the order of [`brick_key`].
    bricks: BTreeMap<u64, Box<BrickSum>>,
    /// Of all bricks.
    extent: Option<Extent>,
    particle_count: usize,
    /// How many quantities they carry; known from the first that are added on.
    quantity_count: Option<usize>,
    mass: SplatMass,
}

/// A brick while particles are added to it.
#[derive(Debug)]
struct BrickSum {
    /// Single precision would lose mass where a million particles meet in one voxel.
    values: [f64; BRICK_VOXELS],
    /// Density times what is carried, quantity by quantity.
    carried: Vec<[f64; BRICK_VOXELS]>,
    /// Where a particle near a wall has reached the brick.
    distances: Option<Box<BrickDistances>>,
}

impl SplatSum {
    /// No density yet.
    ///
    /// # Errors
    /// [`GridError::VoxelSize`].
    pub fn try_new(settings: SplatSettings) -> Result<Self, GridError> {
        let h = f64::from(settings.voxel_size);
        if !(h.is_finite() && h > 0.0) {
            return Err(GridError::VoxelSize(h));
        }
        Ok(Self {
            settings,
            bricks: BTreeMap::new(),
            extent: None,
            particle_count: 0,
            quantity_count: None,
            mass: SplatMass::default(),
        })
    }

    /// Adds particles after those that were added before.
    ///
    /// # Errors
    /// [`GridError::BadParticle`], numbered from the first that was ever added, and [`GridError::Lengths`], before anything is added;
    /// [`GridError::OverMemory`] before what is too large is allocated, with the particles so far.
    pub fn add(&mut self, input: &SplatInput) -> Result<(), GridError> {
        let (h, settings) = (f64::from(self.settings.voxel_size), self.settings);
        let streaks = Streaks::try_new(input, h, settings.shutter_seconds, self.particle_count)?;
        let quantity_count = *self.quantity_count.get_or_insert(streaks.quantity_count());
        if quantity_count != streaks.quantity_count() {
            return Err(GridError::Lengths(quantity_count, streaks.quantity_count()));
        }
        let is_soft = settings.soft_radius.is_none_or(|r| r > 0.0);
        let sight = input.obstacles.filter(|_| is_soft).map(|o| Sight::new(o, h, settings.soft_radius));
        let most = if sight.is_some() { BATCH_TOUCHES_SOFT } else { BATCH_TOUCHES };
        let (mut start, mut wanted) = (0, FIRST_BATCH);
        while start < streaks.count() {
            let (end, extent) = next_batch(&streaks, start, wanted, most);
            match extent {
                Some(extent) => self.add_batch(&streaks, sight.as_ref(), start..end, extent)?,
                None => self.account(&streaks, start..end, None),
            }
            wanted = extent.map_or(BATCH, |extent| fitting(end - start, extent.touches, most));
            start = end;
        }
        self.particle_count += streaks.count();
        Ok(())
    }

    fn add_batch(
        &mut self,
        streaks: &Streaks,
        sight: Option<&Sight>,
        range: Range<usize>,
        extent: Extent,
    ) -> Result<(), GridError> {
        let all = self.extent.map_or(extent, |e| e.union(extent));
        let touch_bytes = if sight.is_some() { TOUCH_BYTES_SOFT } else { TOUCH_BYTES };
        let batch_bytes = extent.touches.saturating_mul(touch_bytes).saturating_add(extent.pieces * PIECE_BYTES);
        self.check_memory(all, self.bricks.len(), batch_bytes)?;
        let dims = (extent.high - extent.low + 1).as_uvec3();
        let mut pieces = Pieces::new(streaks, &range);
        let pairs = sorted_pairs(&pieces, extent.low, dims);
        let coord = |pair: u64| extent.low + place_to_brick((pair >> 32) as u32, dims).as_ivec3();
        let groups = pairs.chunk_by(|a, b| a >> 32 == b >> 32);
        let pairs: Vec<BrickPairs> = groups.map(|pairs| BrickPairs { brick: coord(pairs[0]), pairs }).collect();
        let new_count = pairs.iter().filter(|b| !self.bricks.contains_key(&brick_key(b.brick))).count();
        self.check_memory(all, self.bricks.len() + new_count, batch_bytes)?;
        self.extent = Some(all);
        let take = |b: &BrickPairs| {
            self.bricks.remove(&brick_key(b.brick)).unwrap_or_else(|| BrickSum::empty(streaks.quantity_count()))
        };
        let mut sums: Vec<Box<BrickSum>> = pairs.iter().map(take).collect();
        let walls = sight.map(|sight| {
            let mut distances: Vec<&mut Option<Box<BrickDistances>>> =
                sums.iter_mut().map(|sum| &mut sum.distances).collect();
            Walls::apply(&mut pieces, sight, &pairs, &mut distances)
        });
        parallel::for_each_mut(&mut sums, |n, sum| {
            let BrickSum { values, carried, distances } = &mut **sum;
            let walls = walls.as_ref().zip(distances.as_deref());
            let seen = walls.map(|(walls, distances)| walls.of_brick(n, distances));
            run_kernel(AddBrick { pieces: &pieces, pairs: &pairs[n], seen, values, carried });
        });
        for (pairs, sum) in pairs.iter().zip(sums) {
            self.bricks.insert(brick_key(pairs.brick), sum);
        }
        self.account(streaks, range, walls.as_ref());
        Ok(())
    }

    /// The density of all particles.
    ///
    /// # Errors
    /// [`GridError::OverMemory`].
    pub fn finish(self) -> Result<Splat, GridError> {
        let Self { settings, bricks, mut mass, quantity_count, .. } = self;
        let mut coords = Vec::with_capacity(bricks.len());
        let mut values: Vec<BrickValues> = Vec::with_capacity(bricks.len());
        let mut means = vec![Vec::with_capacity(bricks.len()); quantity_count.unwrap_or(0)];
        for (key, sum) in bricks {
            coords.push(brick_of(key));
            values.push(sum.values.map(|v| v as f32));
            means.iter_mut().zip(&sum.carried).for_each(|(means, carried)| means.push(mean(carried, &sum.values)));
        }
        let limit = settings.memory_limit_bytes;
        let grid = DensityGrid::from_bricks(DVec3::ZERO, settings.voxel_size, &coords, &values, limit)?;
        mass.grid = grid.mass();
        Ok(Splat { grid, mass, means: MeanGrid::new(coords, means) })
    }

    /// An error where a grid of so many bricks, and `batch_bytes` besides, do not fit.
    fn check_memory(&self, extent: Extent, brick_count: usize, batch_bytes: u64) -> Result<(), GridError> {
        let of_carried = self.quantity_count.unwrap_or(0) * CARRIED_BYTES;
        let of_sums = brick_count as u64 * (size_of::<BrickSum>() + 64 + of_carried) as u64;
        let of_distances = self.bricks.values().filter(|sum| sum.distances.is_some()).count() as u64;
        let beside = batch_bytes.saturating_add(of_sums + of_distances * size_of::<BrickDistances>() as u64);
        let dims = dims_of(extent);
        check_memory(dims, brick_count as u64, beside, self.settings.memory_limit_bytes)
    }

    /// Where the mass of some particles went, added up in their order; what the grid holds is left as it is.
    fn account(&mut self, streaks: &Streaks, range: Range<usize>, walls: Option<&Walls>) {
        for i in range {
            let m = streaks.mass(i);
            self.mass.particles += m;
            let Some(share) = walls.map(|walls| walls.kept(i)) else { continue };
            // Less is rounding.
            if share < 1.0 - 1e-12 {
                self.mass.faded += m * (1.0 - share);
            }
            if share < SHARE_MIN {
                self.mass.lost += m * (1.0 - share * gain(share));
            }
        }
    }
}

impl BrickSum {
    fn empty(quantity_count: usize) -> Box<Self> {
        let carried = vec![[0.0; BRICK_VOXELS]; quantity_count];
        Box::new(Self { values: [0.0; BRICK_VOXELS], carried, distances: None })
    }
}

/// What is carried over the density that carries it, in voxels that have some.
fn mean(carried: &[f64; BRICK_VOXELS], density: &[f64; BRICK_VOXELS]) -> BrickValues {
    std::array::from_fn(|i| if density[i] as f32 > 0.0 { (carried[i] / density[i]) as f32 } else { 0.0 })
}

/// Where the batch that begins with particle `start` ends, about `wanted` later, and how far it reaches, if it weighs anything.
fn next_batch(streaks: &Streaks, start: usize, wanted: usize, most: u64) -> (usize, Option<Extent>) {
    let mut count = wanted.min(streaks.count() - start);
    loop {
        let extent = streaks.extent(start..start + count);
        let touches = extent.map_or(0, |e| e.touches);
        if touches <= most || count == 1 {
            return (start + count, extent);
        }
        count = fitting(count, touches, most).min(count - 1);
    }
}

/// How many particles make at most `most` pairs where `count` make `touches`: a little less, for they are not all alike.
fn fitting(count: usize, touches: u64, most: u64) -> usize {
    (count as f64 * 0.9 * most as f64 / touches.max(1) as f64).clamp(1.0, BATCH as f64) as usize
}

/// Place of the brick in the box (upper half) and number of the piece (lower half) of every pair, in order.
fn sorted_pairs(pieces: &Pieces, low: IVec3, dims: UVec3) -> Vec<u64> {
    let mut pairs: Vec<u64> = parallel::gather(pieces.all().len(), |n, pairs| {
        pieces.all()[n].for_each_brick(|brick| {
            let p = (brick - low).as_uvec3();
            let place = (p.z * dims.y + p.y) * dims.x + p.x;
            pairs.push(u64::from(place) << 32 | n as u64);
        });
    });
    parallel::sort(&mut pairs);
    pairs
}

fn place_to_brick(place: u32, dims: UVec3) -> UVec3 {
    UVec3::new(place % dims.x, place / dims.x % dims.y, place / dims.x / dims.y)
}

fn dims_of(extent: Extent) -> U64Vec3 {
    (extent.high - extent.low + 1).as_u64vec3()
}

/// Bits of a coordinate of a brick within a key.
const KEY_BITS: u32 = 21;
const KEY_BIAS: i32 = MAX_COORDINATE / BRICK_EDGE as i32 + 1;

/// A word for a brick, ordered by z, then y, then x.
fn brick_key(brick: IVec3) -> u64 {
    let [x, y, z] = (brick + KEY_BIAS).as_u64vec3().to_array();
    z << (2 * KEY_BITS) | y << KEY_BITS | x
}

fn brick_of(key: u64) -> IVec3 {
    let part = |shift: u32| (key >> shift) as i32 & ((1 << KEY_BITS) - 1);
    IVec3::new(part(0), part(KEY_BITS), part(2 * KEY_BITS)) - KEY_BIAS
}

/// Adds its pairs to a brick in their order.
struct AddBrick<'a> {
    pieces: &'a Pieces<'a>,
    pairs: &'a BrickPairs<'a>,
    /// What particles near walls see of the brick, if there are any.
    seen: Option<SeenPieces<'a>>,
    values: &'a mut [f64; BRICK_VOXELS],
    carried: &'a mut [[f64; BRICK_VOXELS]],
}

impl lanes::Kernel for AddBrick<'_> {
    type Output = ();

    // For the instruction set alone: voxels of a row are added side by side by the compiler.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn run<L: Batch>(mut self, _: L) {
        /// Pieces that are fetched before the first of them is added, so that the memory is asked for all at once.
        const TOGETHER: usize = 32;
        let (brick, streaks, first) = (self.pairs.brick, self.pieces.streaks(), self.pieces.range().start);
        let mut fetched = [Piece::default(); TOGETHER];
        for pairs in self.pairs.pairs.chunks(TOGETHER) {
            for n in 0..pairs.len() {
                fetched[n] = self.pieces.all()[piece_of(pairs[n])];
            }
            for piece in &fetched[..pairs.len()] {
                let kernel = Kernel::within(brick, piece.center, piece.radius);
                let carried = self.carried.iter_mut().zip(streaks.carried(first + piece.particle as usize));
                let near = if piece.wall < f64::INFINITY { self.seen.as_mut() } else { None };
                if let Some(seen) = near {
                    let Some(voxels) = seen.next().filter(|voxels| voxels.weight > 0.0) else { continue };
                    seen.add(voxels, &kernel, piece.radius, piece.amount, self.values);
                    for (values, value) in carried {
                        seen.add(voxels, &kernel, piece.radius, piece.amount * value, values);
                    }
                } else {
                    kernel.add_to(self.values, piece.amount);
                    for (values, value) in carried {
                        kernel.add_to(values, piece.amount * value);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_ordered_by_z_y_x_and_come_back() {
        let bricks =
            [[-9, 4, -3], [5, -6, -2], [-1, 0, 0], [0, 0, 0], [1, 0, 0], [-7, 1, 0], [0, 0, 1]].map(IVec3::from);
        let far = IVec3::splat(MAX_COORDINATE / BRICK_EDGE as i32);
        for brick in bricks.into_iter().chain([far, -far, far - 1]) {
            assert_eq!(brick_of(brick_key(brick)), brick);
        }
        assert!(bricks.is_sorted_by_key(|&brick| brick_key(brick)));
    }
}
