//! The kernel that a particle is splatted with.
//!
//! The kernel is the product of (1 − u²)³ along the three axes, u = distance/radius: twice continuously differentiable,
//! zero beyond `radius` along each axis, with standard deviation `radius`/3. As a product it is normalised on the voxels by
//! three short sums, which makes the mass exact at the price of being a little fuller along diagonals than along axes.

use crate::grid::{BRICK_EDGE, BRICK_VOXELS};
use crate::math::lanes::{self, Batch, run_kernel};
use glam::{DVec3, IVec3};

/// Narrowest kernel [voxels]: particles with a smaller radius are widened to it, so that a kernel always reaches a voxel
/// centre, wherever the particle is.
pub const MIN_RADIUS: f64 = 1.0;
/// Widest kernel [voxels]; a wider one is an error, since one particle would cover millions of voxels.
pub const MAX_RADIUS: f64 = 128.0;
/// Largest number of voxel centres within a kernel along one axis.
pub(crate) const MAX_WIDTH: usize = 2 * MAX_RADIUS as usize + 2;

/// A number for each voxel along an edge of a brick.
type Row = [f64; BRICK_EDGE];

/// The weights along an axis of eight voxels, the first of which is at `start` relative to the kernel's centre; not normalised.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
fn weights(start: f64, inverse_radius: f64) -> Row {
    let mut weights = [0.0; BRICK_EDGE];
    for i in 0..BRICK_EDGE {
        let u = (start + i as f64) * inverse_radius;
        let s = (1.0 - u * u).max(0.0);
        weights[i] = s * s * s;
    }
    weights
}

/// What the weights of the kernel of `radius` about `center` [voxels, relative to voxel centres] are multiplied by so that they add
/// up to 1 over all voxels.
pub(crate) fn normalisation(center: DVec3, radius: f64) -> f64 {
    run_kernel(Normalise { center, radius })
}

struct Normalise {
    center: DVec3,
    radius: f64,
}

impl lanes::Kernel for Normalise {
    type Output = f64;

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn run<L: Batch>(self, _: L) -> f64 {
        let inverse_radius = 1.0 / self.radius;
        let mut volume = 1.0;
        for axis in 0..3 {
            let mut start = (self.center[axis] - self.radius).ceil() - self.center[axis];
            let mut sums = weights(start, inverse_radius);
            start += BRICK_EDGE as f64;
            while start <= self.radius {
                let row = weights(start, inverse_radius);
                for i in 0..BRICK_EDGE {
                    sums[i] += row[i];
                }
                start += BRICK_EDGE as f64;
            }
            let [a, b, c, d, e, f, g, h] = sums;
            volume *= ((a + e) + (c + g)) + ((b + f) + (d + h));
        }
        1.0 / volume
    }
}

/// What a kernel is within one brick: its weights along each axis, not normalised.
pub(crate) struct Kernel {
    weights: [Row; 3],
    /// Voxels along y and z that it reaches.
    from: [usize; 2],
    to: [usize; 2],
}

impl Kernel {
    /// The kernel of `radius` about `center` [voxels, relative to voxel centres].
    #[inline(always)]
    pub fn within(brick: IVec3, center: DVec3, radius: f64) -> Self {
        let start = (brick * BRICK_EDGE as i32).as_dvec3() - center;
        let inverse_radius = 1.0 / radius;
        let weights = [0, 1, 2].map(
            #[inline(always)]
            |axis| weights(start[axis], inverse_radius),
        );
        // The casts of negative numbers give 0.
        let [from, to] = [-radius - start, radius - start];
        let end = |last: f64| (last.floor() as usize + 1).min(BRICK_EDGE);
        Self { weights, from: [from.y.ceil() as usize, from.z.ceil() as usize], to: [end(to.y), end(to.z)] }
    }

    /// Calls `visit` with each row of voxels that the kernel reaches: the number y + 8·z, and `scale` times the weights
    /// along x, some of which may be 0. Mark closures `#[inline(always)]`.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    pub fn for_each_row(&self, scale: f64, mut visit: impl FnMut(usize, &Row)) {
        let [along, wy, wz] = &self.weights;
        for z in self.from[1]..self.to[1] {
            let layer = scale * wz[z];
            for y in self.from[0]..self.to[0] {
                let factor = layer * wy[y];
                let mut row = [0.0; BRICK_EDGE];
                for x in 0..BRICK_EDGE {
                    row[x] = factor * along[x];
                }
                visit(z * BRICK_EDGE + y, &row);
            }
        }
    }

    /// Adds `amount` times the weights to the voxels of the brick.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    pub fn add_to(&self, values: &mut [f64; BRICK_VOXELS], amount: f64) {
        let (rows, _) = values.as_chunks_mut::<BRICK_EDGE>();
        self.for_each_row(
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::local_voxel;

    /// Bricks that a kernel reaches.
    fn reached(center: DVec3, radius: f64) -> impl Iterator<Item = IVec3> {
        let (low, high) = reach(center, radius);
        let (low, high): (IVec3, IVec3) = (low >> 3, high >> 3);
        (low.z..=high.z)
            .flat_map(move |z| (low.y..=high.y).flat_map(move |y| (low.x..=high.x).map(move |x| IVec3::new(x, y, z))))
    }

    #[test]
    fn weights_add_up_to_one_over_all_bricks_and_are_never_negative() {
        let wide = [(DVec3::splat(0.5), MAX_RADIUS), (DVec3::new(-7.25, 3.0, 1e6), 40.0)];
        let narrow = (0..10_000).map(|i| {
            let t = f64::from(i) * 0.618;
            (DVec3::new(t.sin() * 50.0, t.cos() * 9.0, t * 0.01), MIN_RADIUS + (t % 1.0) * 5.0)
        });
        for (center, radius) in narrow.chain(wide) {
            let scale = normalisation(center, radius);
            let mut sum = 0.0;
            for brick in reached(center, radius) {
                Kernel::within(brick, center, radius).for_each_row(scale, |_, row| {
                    assert!(row.iter().all(|&weight| weight >= 0.0));
                    sum += row.iter().sum::<f64>();
                });
            }
            assert!((sum - 1.0).abs() < 1e-12, "{center}, {radius}: {sum}");
        }
        let (low, high) = reach(DVec3::splat(0.5), MAX_RADIUS);
        assert!((high - low + 1).max_element() as usize <= MAX_WIDTH);
    }

    #[test]
    fn rows_at_once_add_what_single_voxels_do() {
        for (radius, shift) in [(1.0, 0.0), (1.7, 0.3), (3.4, -0.45), (9.0, 0.21), (40.0, 0.5)] {
            let center = DVec3::new(3.1 + shift, -2.7, 11.9 - shift);
            for brick in reached(center, radius) {
                let mut rows = [0.25; BRICK_VOXELS];
                Kernel::within(brick, center, radius).add_to(&mut rows, 0.7);
                for (i, value) in rows.iter().enumerate() {
                    let u = ((brick * 8 + local_voxel(i).as_ivec3()).as_dvec3() - center) / radius;
                    let weight: f64 = u.to_array().map(|u| (1.0 - u * u).max(0.0).powi(3)).iter().product();
                    assert!((value - 0.25 - 0.7 * weight).abs() < 1e-14, "{brick} at {radius}");
                }
            }
        }
    }
}
