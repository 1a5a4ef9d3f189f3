//! Densities to the nearest 255th of their brick's largest, for decisions that seldom need more.
//!
//! A free flight compares a voxel's density with a random bound. A byte says on which side it is but once in some hundred
//! times, and the bytes of a plume fit into a cache that its samples do not fit into: waiting for memory was a third of the
//! time of flights.

use crate::grid::{BRICK_VOXELS, StoredBrick, own_voxels};
use crate::math::parallel;

/// A brick's densities, rounded down.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RoughBrick {
    /// Density per step.
    unit: f32,
    /// A density is at least so many steps and less than one more.
    steps: [u8; BRICK_VOXELS],
}

/// All bricks of a grid, rounded down.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RoughBricks(Vec<RoughBrick>);

impl RoughBricks {
    /// Of `bricks`, in their order.
    pub fn new(bricks: &[StoredBrick]) -> Self {
        Self(parallel::map(bricks.len(), |i| RoughBrick::new(&bricks[i])))
    }

    /// Whether voxel number `voxel` of brick number `brick` has a larger density than `bound`; `None` where a byte cannot say.
    #[inline]
    pub fn exceeds(&self, brick: usize, voxel: usize, bound: f32) -> Option<bool> {
        let brick = self.0.get(brick)?;
        let steps = f32::from(*brick.steps.get(voxel)?);
        if bound < steps * brick.unit {
            return Some(true);
        }
        (bound >= (steps + 1.0) * brick.unit).then_some(false)
    }

    /// Memory [bytes].
    pub fn memory_bytes(&self) -> usize {
        size_of_val(self.0.as_slice())
    }
}

impl RoughBrick {
    fn new(brick: &StoredBrick) -> Self {
        let largest = own_voxels(brick).fold(0.0, |largest: f32, (_, v)| largest.max(v));
        // Such that the largest has 255 steps whatever is rounded.
        let unit = largest / 255.5;
        let mut rough = Self { unit, steps: [0; BRICK_VOXELS] };
        // Of next to nothing a byte says nothing; of nothing it says all, with steps of 0.
        if unit < f32::MIN_POSITIVE {
            rough.unit = if largest > 0.0 { f32::INFINITY } else { 0.0 };
            return rough;
        }
        for (i, v) in own_voxels(brick) {
            let mut steps = (v / unit) as u8;
            // The division rounds.
            if v < f32::from(steps) * unit {
                steps -= 1;
            } else if v >= (f32::from(steps) + 1.0) * unit {
                steps += 1;
            }
            debug_assert!(f32::from(steps) * unit <= v && v < (f32::from(steps) + 1.0) * unit);
            rough.steps[i] = steps;
        }
        rough
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{DensityGrid, STORED_SAMPLES};
    use crate::math::hash::{CounterRng, Seed};
    use crate::math::space::{IndexPoint, WorldPoint};
    use glam::{UVec3, Vec3};

    /// For bounds at and next to every density and step, where rounding could tell.
    #[test]
    fn a_byte_that_says_something_is_right() {
        let mut rng = CounterRng::new(Seed(2));
        for scale in [1.0, 0.3, 1e-30, 1e-42, 1e20, 0.0] {
            let mut brick = [0.0f32; STORED_SAMPLES];
            brick.iter_mut().for_each(|v| *v = scale * (rng.uniform() - 0.3).max(0.0));
            let rough = RoughBricks::new(&[brick]);
            let unit = rough.0[0].unit;
            let mut said = 0;
            for (i, v) in own_voxels(&brick) {
                let steps = f32::from(rough.0[0].steps[i]);
                let bounds = [v, v.next_up(), v.next_down(), steps * unit, (steps + 1.0) * unit, scale * rng.uniform()];
                for bound in bounds.into_iter().filter(|bound| *bound >= 0.0) {
                    if let Some(exceeds) = rough.exceeds(0, i, bound) {
                        assert_eq!(exceeds, v > bound, "{v:e} {bound:e} {steps} {unit:e}");
                        said += 1;
                    }
                }
            }
            assert!(scale < 1e-38 || said > 512, "{scale}: {said}");
        }
    }

    #[test]
    fn grids_decide_as_their_densities_do() {
        let grid = DensityGrid::from_fn(WorldPoint::default(), 0.1, UVec3::new(19, 9, 30), 1 << 24, |p| {
            ((7.0 * p.0.x).sin() + (5.0 * p.0.z).cos()).max(0.0)
        })
        .unwrap();
        let mut rng = CounterRng::new(Seed(3));
        for _ in 0..200_000 {
            let p = IndexPoint(rng.coarse_point() * Vec3::new(40.0, 30.0, 50.0) - 2.0);
            let (u, bound) = (rng.coarse_point(), 2.0 * rng.uniform());
            assert_eq!(grid.exceeds_nearby(p, u, bound), grid.density_nearby(p, u) > bound);
        }
    }
}
