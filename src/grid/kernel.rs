//! The kernel that a particle is splatted with.
//!
//! The kernel is the product of (1 − u²)³ along the three axes, u = distance/radius: twice continuously differentiable,
//! zero beyond `radius` along each axis, with standard deviation `radius`/3. As a product it is normalised on the voxels by
//! three short sums, which makes the mass exact at the price of being a little fuller along diagonals than along axes.

use crate::grid::{BRICK_EDGE, BRICK_VOXELS};
use glam::{DVec3, IVec3};

/// Narrowest kernel [voxels]: particles with a smaller radius are widened to it, so that a kernel always reaches a voxel
/// centre, wherever the particle is.
pub const MIN_RADIUS: f64 = 1.0;
/// Widest kernel [voxels]; a wider one is an error, since one particle would cover millions of voxels.
pub const MAX_RADIUS: f64 = 128.0;
/// Largest number of voxel centres within a kernel along one axis.
pub(crate) const MAX_WIDTH: usize = 2 * MAX_RADIUS as usize + 2;
/// Zeros on both sides of the weights, so that a row of any brick that the kernel reaches is a plain read.
const MARGIN: usize = BRICK_EDGE;
const STORED_WIDTH: usize = MAX_WIDTH.next_multiple_of(BRICK_EDGE) + 2 * MARGIN;

/// A number for each voxel along an edge of a brick.
type Row = [f32; BRICK_EDGE];

/// The kernel of one piece of one particle: where it starts and its weights along each axis, which add up to 1.
pub(crate) struct Kernel {
    low: IVec3,
    width: IVec3,
    /// From `MARGIN` on; 0 before and for at least as many after.
    weights: [[f32; STORED_WIDTH]; 3],
}

/// The part of a brick that a kernel reaches.
struct Overlap<'a> {
    /// First voxel and the one after the last, counted from the first of the brick.
    from: IVec3,
    to: IVec3,
    /// Weights along each axis, for all voxels along the brick's edge.
    weights: [&'a Row; 3],
}

impl Kernel {
    pub fn zeroed() -> Self {
        Self { low: IVec3::ZERO, width: IVec3::ZERO, weights: [[0.0; STORED_WIDTH]; 3] }
    }

    /// Sets the kernel to one of `radius` about `center` [voxels, relative to voxel centres].
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    pub fn place(&mut self, center: DVec3, radius: f64) {
        let (low, high) = reach(center, radius);
        self.low = low;
        self.width = high - low + 1;
        let inverse = (1.0 / radius) as f32;
        for axis in 0..3 {
            let start = (f64::from(low[axis]) - center[axis]) as f32;
            let width = self.width[axis] as usize;
            let weights = &mut self.weights[axis][MARGIN..][..width.next_multiple_of(BRICK_EDGE) + MARGIN];
            // Whole rows, which the compiler computes side by side; what is beyond the kernel is 0 afterwards.
            let (rows, _) = weights.as_chunks_mut::<BRICK_EDGE>();
            for n in 0..rows.len() - 1 {
                for i in 0..BRICK_EDGE {
                    let u = (start + (n * BRICK_EDGE + i) as f32) * inverse;
                    let s = (1.0 - u * u).max(0.0);
                    rows[n][i] = s * s * s;
                }
            }
            let weights = &mut self.weights[axis][MARGIN..][..width.next_multiple_of(BRICK_EDGE) + MARGIN];
            let mut sum = 0.0f32;
            for i in 0..width {
                sum += weights[i];
            }
            let normalise = 1.0 / sum;
            let (rows, _) = weights.as_chunks_mut::<BRICK_EDGE>();
            for n in 0..rows.len() - 1 {
                for i in 0..BRICK_EDGE {
                    rows[n][i] *= normalise;
                }
            }
            let weights = &mut self.weights[axis][MARGIN..][..width.next_multiple_of(BRICK_EDGE) + MARGIN];
            weights[width..].fill(0.0);
        }
    }

    #[inline(always)]
    fn overlap(&self, brick: IVec3) -> Option<Overlap<'_>> {
        let base = self.low - brick * BRICK_EDGE as i32;
        let from = base.max(IVec3::ZERO);
        let to = (base + self.width).min(IVec3::splat(BRICK_EDGE as i32));
        if from.cmpge(to).any() {
            return None;
        }
        let row = |axis: usize| self.weights[axis][(MARGIN as i32 - base[axis]) as usize..].first_chunk();
        Some(Overlap { from, to, weights: [row(0)?, row(1)?, row(2)?] })
    }

    /// Calls `visit` with each row of voxels of `brick` that the kernel reaches: the number y + 8·z, and `scale` times the weights
    /// along x, some of which may be 0. Mark closures `#[inline(always)]`.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    pub fn for_each_row(&self, brick: IVec3, scale: f64, mut visit: impl FnMut(usize, &[f64; BRICK_EDGE])) {
        let Some(Overlap { from, to, weights: [wx, wy, wz] }) = self.overlap(brick) else { return };
        let mut along = [0.0; BRICK_EDGE];
        for x in 0..BRICK_EDGE {
            along[x] = f64::from(wx[x]);
        }
        for z in from.z as usize..to.z as usize {
            let layer = scale * f64::from(wz[z]);
            for y in from.y as usize..to.y as usize {
                let factor = layer * f64::from(wy[y]);
                let mut row = [0.0; BRICK_EDGE];
                for x in 0..BRICK_EDGE {
                    row[x] = factor * along[x];
                }
                visit(z * BRICK_EDGE + y, &row);
            }
        }
    }

    /// Adds `amount` times the kernel to the voxels of `brick`.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    pub fn add_to(&self, values: &mut [f64; BRICK_VOXELS], brick: IVec3, amount: f64) {
        let (rows, _) = values.as_chunks_mut::<BRICK_EDGE>();
        self.for_each_row(
            brick,
            amount,
            #[inline(always)]
            |n, weights| {
                // All of the row: adding nothing costs less than finding out where to begin.
                let row = &mut rows[n];
                for x in 0..BRICK_EDGE {
                    row[x] += weights[x];
                }
            },
        );
    }
}

/// First and last voxel whose centre is within `radius` of `center` along each axis.
#[inline(always)]
pub(crate) fn reach(center: DVec3, radius: f64) -> (IVec3, IVec3) {
    ((center - radius).ceil().as_ivec3(), (center + radius).floor().as_ivec3())
}

/// True when a kernel of `radius` about `center` reaches a voxel of `brick`.
#[inline(always)]
pub(crate) fn touches(center: DVec3, radius: f64, brick: IVec3) -> bool {
    let low = (brick * BRICK_EDGE as i32).as_dvec3();
    (center - radius).cmple(low + (BRICK_EDGE - 1) as f64).all() && (center + radius).cmpge(low).all()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::local_voxel;

    #[test]
    fn weights_add_up_to_one_and_are_never_empty() {
        let mut kernel = Kernel::zeroed();
        for i in 0..10_000 {
            let t = f64::from(i) * 0.618;
            let center = DVec3::new(t.sin() * 50.0, t.cos() * 9.0, t * 0.01);
            let radius = MIN_RADIUS + (t % 1.0) * 5.0;
            kernel.place(center, radius);
            for axis in 0..3 {
                let (before, weights) = kernel.weights[axis].split_at(MARGIN);
                let (weights, after) = weights.split_at(kernel.width[axis] as usize);
                assert!((weights.iter().sum::<f32>() - 1.0).abs() < 3e-7);
                assert!(weights.iter().all(|&w| w >= 0.0));
                assert!(before.iter().chain(&after[..MARGIN]).all(|&w| w == 0.0));
            }
        }
        kernel.place(DVec3::splat(0.5), MAX_RADIUS);
        assert!(kernel.width.max_element() as usize <= MAX_WIDTH);
    }

    #[test]
    fn rows_at_once_add_what_single_voxels_do() {
        let mut kernel = Kernel::zeroed();
        for (radius, shift) in [(1.0, 0.0), (1.7, 0.3), (3.4, -0.45), (9.0, 0.21), (40.0, 0.5)] {
            kernel.place(DVec3::new(3.1 + shift, -2.7, 11.9 - shift), radius);
            let (low, high): (IVec3, IVec3) = (kernel.low >> 3, (kernel.low + kernel.width - 1) >> 3);
            let mut sum = 0.0;
            for brick in (low.z..=high.z)
                .flat_map(|z| (low.y..=high.y).flat_map(move |y| (low.x..=high.x).map(move |x| IVec3::new(x, y, z))))
            {
                let (mut rows, mut plain) = ([0.25; BRICK_VOXELS], [0.25; BRICK_VOXELS]);
                kernel.add_to(&mut rows, brick, 0.7);
                for (i, value) in plain.iter_mut().enumerate() {
                    let at = brick * 8 + local_voxel(i).as_ivec3() - kernel.low;
                    if at.cmpge(IVec3::ZERO).all() && at.cmplt(kernel.width).all() {
                        let weight = |axis: usize| f64::from(kernel.weights[axis][MARGIN + at[axis] as usize]);
                        *value += 0.7 * weight(0) * weight(1) * weight(2);
                    }
                }
                assert!(rows.iter().zip(&plain).all(|(a, b)| (a - b).abs() < 1e-15), "{brick} at {radius}");
                sum += plain.iter().map(|v| v - 0.25).sum::<f64>();
            }
            assert!((sum - 0.7).abs() < 1e-6, "{radius}: {sum}");
        }
    }
}
