//! Particles to voxels, with mass conserved and the same bits whatever the number of threads.
//!
//! The kernel is the product of (1 − u²)³ along the three axes, u = distance/radius: twice continuously differentiable,
//! zero beyond `radius` along each axis, with standard deviation `radius`/3. As a product it is normalised on the voxels by
//! three short sums, which makes the mass exact at the price of being a little fuller along diagonals than along axes.
//!
//! Every (brick, particle) pair is listed and the list sorted; each brick is then summed by one task in the order of the
//! particles. Nothing is added in an order that depends on scheduling.

use crate::grid::{BRICK_EDGE, BRICK_VOXELS, BrickValues, DensityGrid, GridError, MAX_COORDINATE, check_memory};
use glam::{DVec3, IVec3, UVec3};
use rayon::prelude::*;

/// Narrowest kernel [voxels]: particles with a smaller radius are widened to it, so that a kernel always reaches a voxel
/// centre, wherever the particle is.
pub const MIN_RADIUS: f64 = 1.0;
/// Widest kernel [voxels]; a wider one is an error, since one particle would cover millions of voxels.
pub const MAX_RADIUS: f64 = 128.0;
/// Most pieces that the streak of one particle is split into; longer streaks than 256 kernel radii become dotted.
pub const MAX_PIECES: u32 = 512;

/// Largest number of voxel centres within a kernel along one axis.
const MAX_WIDTH: usize = 2 * MAX_RADIUS as usize + 2;

/// The particles to splat; all slices have the same length.
#[derive(Debug, Clone, Copy)]
pub struct SplatInput<'a> {
    /// Coordinates [m].
    pub position: [&'a [f32]; 3],
    /// Components [m/s], for motion blur.
    pub velocity: [&'a [f32]; 3],
    /// Mass [density·m³], at least 0.
    pub mass: &'a [f32],
    /// Reach of the kernel along each axis [m], greater than 0.
    pub radius: &'a [f32],
}

/// How to splat.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SplatSettings {
    /// Edge of a voxel [m].
    pub voxel_size: f32,
    /// Opening and closing of the shutter relative to the particles' instant [s]; equal for no motion blur.
    pub shutter_seconds: [f64; 2],
    /// More memory than this is never asked for [bytes].
    pub memory_limit_bytes: u64,
}

/// Splats particles onto the voxels whose low corner (0, 0, 0) is the world's origin. A particle is smeared evenly along
/// position + velocity·t while the shutter is open, in pieces at most half a kernel radius apart.
///
/// # Errors
/// [`GridError::BadParticle`] for the first particle with a value out of range, [`GridError::OverMemory`] before anything
/// large is allocated, [`GridError::Lengths`], [`GridError::VoxelSize`].
pub fn splat(input: &SplatInput, settings: &SplatSettings) -> Result<DensityGrid, GridError> {
    let splatter = Splatter::try_new(input, settings)?;
    let Some((brick_min, brick_max)) = splatter.brick_box() else {
        return DensityGrid::from_bricks(DVec3::ZERO, settings.voxel_size, &[], &[], settings.memory_limit_bytes);
    };
    let dims = (brick_max - brick_min + 1).as_u64vec3();
    let pair_count: u64 = splatter.indices().map(|i| splatter.brick_count(i)).sum();
    let pair_bytes = pair_count.saturating_mul(2 * size_of::<u64>() as u64);
    check_memory(dims, 0, settings.memory_limit_bytes.saturating_sub(pair_bytes))?;
    let dims = dims.as_uvec3();
    let pairs = splatter.sorted_pairs(brick_min, dims);
    let bricks: Vec<&[u64]> = pairs.chunk_by(|a, b| a >> 32 == b >> 32).collect();
    check_memory(dims.as_u64vec3(), bricks.len() as u64, settings.memory_limit_bytes.saturating_sub(pair_bytes))?;
    let coord = |pair: u64| brick_min + place_to_brick((pair >> 32) as u32, dims).as_ivec3();
    let coords: Vec<IVec3> = bricks.iter().map(|b| coord(b[0])).collect();
    let values: Vec<BrickValues> =
        coords.par_iter().zip(&bricks).map(|(&brick, pairs)| splatter.sum_brick(brick, pairs)).collect();
    drop(bricks);
    drop(pairs);
    DensityGrid::from_bricks(DVec3::ZERO, settings.voxel_size, &coords, &values, settings.memory_limit_bytes)
}

fn place_to_brick(place: u32, dims: UVec3) -> UVec3 {
    UVec3::new(place % dims.x, place / dims.x % dims.y, place / dims.x / dims.y)
}

/// The kernel of one piece of one particle: where it starts and its weights along each axis, which add up to 1.
struct Kernel {
    low: IVec3,
    width: IVec3,
    weights: [[f32; MAX_WIDTH]; 3],
}

impl Kernel {
    fn zeroed() -> Self {
        Self { low: IVec3::ZERO, width: IVec3::ZERO, weights: [[0.0; MAX_WIDTH]; 3] }
    }

    /// Sets the kernel to one of `radius` about `center` [voxels, relative to voxel centres].
    fn place(&mut self, center: DVec3, radius: f64) {
        let (low, high) = reach(center, radius);
        self.low = low;
        self.width = high - low + 1;
        let inverse = (1.0 / radius) as f32;
        for axis in 0..3 {
            let start = (f64::from(low[axis]) - center[axis]) as f32;
            let weights = &mut self.weights[axis][..self.width[axis] as usize];
            let mut sum = 0.0f32;
            for (i, weight) in weights.iter_mut().enumerate() {
                let u = (start + i as f32) * inverse;
                let s = (1.0 - u * u).max(0.0);
                *weight = s * s * s;
                sum += *weight;
            }
            let normalise = 1.0 / sum;
            weights.iter_mut().for_each(|w| *w *= normalise);
        }
    }

    /// Adds `amount` times the kernel to the voxels of `brick`.
    fn add_to(&self, values: &mut [f64; BRICK_VOXELS], brick: IVec3, amount: f64) {
        let base = self.low - brick * BRICK_EDGE as i32;
        let from = base.max(IVec3::ZERO);
        let to = (base + self.width).min(IVec3::splat(BRICK_EDGE as i32));
        if from.cmpge(to).any() {
            return;
        }
        let (wx, wy, wz) = (&self.weights[0], &self.weights[1], &self.weights[2]);
        let wx = &wx[(from.x - base.x) as usize..(to.x - base.x) as usize];
        for z in from.z..to.z {
            let layer = amount * f64::from(wz[(z - base.z) as usize]);
            for y in from.y..to.y {
                let factor = layer * f64::from(wy[(y - base.y) as usize]);
                let start = ((z * 8 + y) * 8 + from.x) as usize;
                for (value, w) in values[start..start + wx.len()].iter_mut().zip(wx) {
                    *value += factor * f64::from(*w);
                }
            }
        }
    }
}

/// First and last voxel whose centre is within `radius` of `center` along each axis.
fn reach(center: DVec3, radius: f64) -> (IVec3, IVec3) {
    let (low, high) = (center - radius, center + radius);
    (low.to_array().map(|x| -floor(-x)).into(), high.to_array().map(floor).into())
}

/// The floor of a number in the range of `i32`; the baseline processor has no instruction for it, and the library call
/// would cost more than the kernel.
#[inline]
fn floor(x: f64) -> i32 {
    let truncated = x as i32;
    truncated - i32::from(f64::from(truncated) > x)
}

struct Splatter<'a> {
    input: &'a SplatInput<'a>,
    shutter: [f64; 2],
    inverse_voxel_size: f64,
}

impl<'a> Splatter<'a> {
    fn try_new(input: &'a SplatInput<'a>, settings: &SplatSettings) -> Result<Self, GridError> {
        let h = f64::from(settings.voxel_size);
        if !(h.is_finite() && h > 0.0) {
            return Err(GridError::VoxelSize(h));
        }
        let count = input.mass.len();
        let slices = input.position.iter().chain(&input.velocity).chain([&input.radius]);
        if let Some(other) = slices.map(|s| s.len()).find(|&n| n != count) {
            return Err(GridError::Lengths(count, other));
        }
        let splatter = Self { input, shutter: settings.shutter_seconds, inverse_voxel_size: 1.0 / h };
        match (0..count).into_par_iter().find_map_first(|i| splatter.complaint(i)) {
            Some(error) => Err(error),
            None => Ok(splatter),
        }
    }

    /// What is wrong with particle `i`, if anything.
    fn complaint(&self, i: usize) -> Option<GridError> {
        let bad = |what, value| Some(GridError::BadParticle { particle_idx: i, what, value });
        let limit = f64::from(MAX_COORDINATE - 2 * MAX_WIDTH as i32);
        for axis in 0..3 {
            let (p, v) = (self.input.position[axis][i], self.input.velocity[axis][i]);
            if !p.is_finite() {
                return bad("the position must be finite", p);
            }
            if !v.is_finite() {
                return bad("the velocity must be finite", v);
            }
            for time in self.shutter {
                let reached = (f64::from(p) + f64::from(v) * time) * self.inverse_voxel_size;
                if reached.is_nan() || reached.abs() >= limit {
                    return bad("the position must be within four million voxels of the origin", p);
                }
            }
        }
        let (mass, radius) = (self.input.mass[i], self.input.radius[i]);
        if !(mass >= 0.0 && mass.is_finite()) {
            return bad("the mass must be finite and at least 0", mass);
        }
        if !(radius > 0.0 && f64::from(radius) * self.inverse_voxel_size <= MAX_RADIUS) {
            return bad("the kernel radius must be greater than 0 and at most 128 voxels", radius);
        }
        None
    }

    /// Particles that weigh something.
    fn indices(&self) -> impl ParallelIterator<Item = usize> + '_ {
        (0..self.input.mass.len()).into_par_iter().filter(|&i| self.input.mass[i] > 0.0)
    }

    fn radius(&self, i: usize) -> f64 {
        (f64::from(self.input.radius[i]) * self.inverse_voxel_size).max(MIN_RADIUS)
    }

    fn vector(&self, components: &[&[f32]; 3], i: usize) -> DVec3 {
        DVec3::new(f64::from(components[0][i]), f64::from(components[1][i]), f64::from(components[2][i]))
    }

    fn piece_count(&self, i: usize) -> u32 {
        let length = self.vector(&self.input.velocity, i).length() * (self.shutter[1] - self.shutter[0]).abs();
        let pieces = length * self.inverse_voxel_size / (0.5 * self.radius(i));
        (pieces.ceil() as u32).clamp(1, MAX_PIECES)
    }

    /// Centres of the pieces of particle `i` [voxels, relative to voxel centres].
    fn centers(&self, i: usize) -> impl ExactSizeIterator<Item = DVec3> {
        let (position, velocity) = (self.vector(&self.input.position, i), self.vector(&self.input.velocity, i));
        let (count, [open, close], scale) = (self.piece_count(i), self.shutter, self.inverse_voxel_size);
        (0..count).map(move |k| {
            let time = open + (close - open) * (f64::from(k) + 0.5) / f64::from(count);
            (position + velocity * time) * scale - 0.5
        })
    }

    /// First and last brick that each piece of particle `i` reaches.
    fn brick_ranges(&self, i: usize) -> impl Iterator<Item = (IVec3, IVec3)> {
        let radius = self.radius(i);
        self.centers(i).map(move |c| {
            let (low, high) = reach(c, radius);
            (low >> 3, high >> 3)
        })
    }

    /// Calls `visit` once for each brick that particle `i` reaches.
    fn for_each_brick(&self, i: usize, mut visit: impl FnMut(IVec3)) {
        let (mut seen_low, mut seen_high) = (IVec3::ONE, IVec3::ZERO);
        for (low, high) in self.brick_ranges(i) {
            // Pieces lie in order on a line, so a brick reached by an earlier piece and by this one was reached by the
            // piece between them too: comparing with the last piece is enough.
            if (low, high) != (seen_low, seen_high) {
                for z in low.z..=high.z {
                    for y in low.y..=high.y {
                        for x in low.x..=high.x {
                            let brick = IVec3::new(x, y, z);
                            if brick.cmplt(seen_low).any() || brick.cmpgt(seen_high).any() {
                                visit(brick);
                            }
                        }
                    }
                }
            }
            (seen_low, seen_high) = (low, high);
        }
    }

    fn brick_count(&self, i: usize) -> u64 {
        let mut count = 0;
        self.for_each_brick(i, |_| count += 1);
        count
    }

    /// First and last brick that any particle reaches.
    fn brick_box(&self) -> Option<(IVec3, IVec3)> {
        let widen = |(a, b): (IVec3, IVec3), (c, d): (IVec3, IVec3)| (a.min(c), b.max(d));
        self.indices().filter_map(|i| self.brick_ranges(i).reduce(widen)).reduce_with(widen)
    }

    /// Place of the brick in the box (upper half) and particle (lower half) of every pair, in order.
    fn sorted_pairs(&self, brick_min: IVec3, dims: UVec3) -> Vec<u64> {
        let mut pairs: Vec<u64> = self
            .indices()
            .fold(Vec::new, |mut pairs, i| {
                self.for_each_brick(i, |brick| {
                    let p = (brick - brick_min).as_uvec3();
                    let place = (p.z * dims.y + p.y) * dims.x + p.x;
                    pairs.push(u64::from(place) << 32 | i as u64);
                });
                pairs
            })
            .flatten()
            .collect();
        pairs.par_sort_unstable();
        pairs
    }

    /// Densities of one brick, summed over its pairs in their order.
    fn sum_brick(&self, brick: IVec3, pairs: &[u64]) -> BrickValues {
        // Single precision would lose mass where a million particles meet in one voxel.
        let mut values = [0.0f64; BRICK_VOXELS];
        let mut kernel = Kernel::zeroed();
        let (low, high) = (brick * BRICK_EDGE as i32, brick * BRICK_EDGE as i32 + (BRICK_EDGE as i32 - 1));
        for pair in pairs {
            let i = (pair & u64::from(u32::MAX)) as usize;
            let radius = self.radius(i);
            let centers = self.centers(i);
            let density = f64::from(self.input.mass[i]) * self.inverse_voxel_size.powi(3) / centers.len() as f64;
            for center in centers {
                let (first, last) = (center - radius, center + radius);
                if first.cmple(high.as_dvec3()).all() && last.cmpge(low.as_dvec3()).all() {
                    kernel.place(center, radius);
                    kernel.add_to(&mut values, brick, density);
                }
            }
        }
        values.map(|v| v as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_add_up_to_one_and_are_never_empty() {
        let mut kernel = Kernel::zeroed();
        for i in 0..10_000 {
            let t = f64::from(i) * 0.618;
            let center = DVec3::new(t.sin() * 50.0, t.cos() * 9.0, t * 0.01);
            let radius = MIN_RADIUS + (t % 1.0) * 5.0;
            kernel.place(center, radius);
            for axis in 0..3 {
                let weights = &kernel.weights[axis][..kernel.width[axis] as usize];
                assert!((weights.iter().sum::<f32>() - 1.0).abs() < 3e-7);
                assert!(weights.iter().all(|&w| w >= 0.0));
            }
        }
        kernel.place(DVec3::splat(0.5), MAX_RADIUS);
        assert!(kernel.width.max_element() as usize <= MAX_WIDTH);
    }

    #[test]
    fn every_brick_of_a_streak_is_listed_once() {
        let (position, velocity) = ([[0.3f32], [0.7], [-0.2]], [[100.0f32], [-31.0], [7.7]]);
        let input = SplatInput {
            position: [&position[0], &position[1], &position[2]],
            velocity: [&velocity[0], &velocity[1], &velocity[2]],
            mass: &[1.0],
            radius: &[2.5],
        };
        let settings = SplatSettings { voxel_size: 1.0, shutter_seconds: [-0.5, 0.5], memory_limit_bytes: 1 << 30 };
        let splatter = Splatter::try_new(&input, &settings).unwrap();
        let mut listed = Vec::new();
        splatter.for_each_brick(0, |b| listed.push(b.to_array()));
        let mut expected: Vec<[i32; 3]> = splatter
            .brick_ranges(0)
            .flat_map(|(a, b)| {
                (a.x..=b.x).flat_map(move |x| (a.y..=b.y).flat_map(move |y| (a.z..=b.z).map(move |z| [x, y, z])))
            })
            .collect();
        expected.sort_unstable();
        expected.dedup();
        listed.sort_unstable();
        assert_eq!(listed, expected);
        assert!(splatter.piece_count(0) >= 80);
    }
}
