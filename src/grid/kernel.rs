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

/// The kernel of one piece of one particle: where it starts and its weights along each axis, which add up to 1.
pub(crate) struct Kernel {
    low: IVec3,
    width: IVec3,
    weights: [[f32; MAX_WIDTH]; 3],
}

impl Kernel {
    pub fn zeroed() -> Self {
        Self { low: IVec3::ZERO, width: IVec3::ZERO, weights: [[0.0; MAX_WIDTH]; 3] }
    }

    /// Sets the kernel to one of `radius` about `center` [voxels, relative to voxel centres].
    pub fn place(&mut self, center: DVec3, radius: f64) {
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

    /// Where the kernel begins, counted from the first voxel of `brick`, and the voxels of the brick that it reaches.
    fn overlap(&self, brick: IVec3) -> Option<(IVec3, IVec3, IVec3)> {
        let base = self.low - brick * BRICK_EDGE as i32;
        let from = base.max(IVec3::ZERO);
        let to = (base + self.width).min(IVec3::splat(BRICK_EDGE as i32));
        from.cmplt(to).all().then_some((base, from, to))
    }

    /// Calls `visit` with number, place and weight of each voxel of `brick` that the kernel reaches.
    pub fn for_each_voxel(&self, brick: IVec3, mut visit: impl FnMut(usize, IVec3, f64)) {
        let Some((base, from, to)) = self.overlap(brick) else { return };
        let weight = |axis: usize, at: i32| f64::from(self.weights[axis][(at - base[axis]) as usize]);
        for z in from.z..to.z {
            for y in from.y..to.y {
                let factor = weight(2, z) * weight(1, y);
                for x in from.x..to.x {
                    let place = brick * BRICK_EDGE as i32 + IVec3::new(x, y, z);
                    visit(((z * 8 + y) * 8 + x) as usize, place, factor * weight(0, x));
                }
            }
        }
    }

    /// Adds `amount` times the kernel to the voxels of `brick`.
    pub fn add_to(&self, values: &mut [f64; BRICK_VOXELS], brick: IVec3, amount: f64) {
        let Some((base, from, to)) = self.overlap(brick) else { return };
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
pub(crate) fn reach(center: DVec3, radius: f64) -> (IVec3, IVec3) {
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

/// True when a kernel of `radius` about `center` reaches a voxel of `brick`.
pub(crate) fn touches(center: DVec3, radius: f64, brick: IVec3) -> bool {
    let low = (brick * BRICK_EDGE as i32).as_dvec3();
    (center - radius).cmple(low + (BRICK_EDGE - 1) as f64).all() && (center + radius).cmpge(low).all()
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
}
