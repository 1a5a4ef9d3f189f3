//! What particles carry, as means over the mass in each voxel.

use crate::grid::{BRICK_EDGE, BrickValues, DensityGrid, local_voxel};
use crate::math::parallel;
use glam::IVec3;

/// Means on the voxels of a [`DensityGrid`], weighted by mass, so that density times mean is what particles bring to a voxel of the
/// quantity: of velocities the momentum. 0 where there is no density.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MeanGrid {
    /// Bricks, z slowest.
    coords: Vec<IVec3>,
    /// Of each quantity the voxels of each brick.
    quantities: Vec<Vec<BrickValues>>,
}

fn order(brick: IVec3) -> [i32; 3] {
    [brick.z, brick.y, brick.x]
}

impl MeanGrid {
    /// From bricks with z slowest and, of each quantity, as many bricks of values.
    ///
    /// # Panics
    /// When bricks are out of order or their numbers differ.
    pub fn new(coords: Vec<IVec3>, quantities: Vec<Vec<BrickValues>>) -> Self {
        assert!(coords.is_sorted_by(|&a, &b| order(a) < order(b)), "bricks out of order");
        assert!(quantities.iter().all(|values| values.len() == coords.len()));
        Self { coords, quantities }
    }

    /// How many quantities.
    pub fn quantity_count(&self) -> usize {
        self.quantities.len()
    }

    /// The last `count` quantities alone, which this one loses.
    ///
    /// # Panics
    /// When it has fewer.
    pub fn split_off(&mut self, count: usize) -> Self {
        let quantities = self.quantities.split_off(self.quantities.len() - count);
        Self { coords: self.coords.clone(), quantities }
    }

    /// Every value of its bricks replaced by what `change` makes of it, also where there is no density.
    pub fn map(mut self, change: impl Fn(f32) -> f32 + Sync) -> Self {
        for values in &mut self.quantities {
            parallel::for_each_mut(values, |_, brick| brick.iter_mut().for_each(|value| *value = change(*value)));
        }
        self
    }

    /// The voxels of a brick, a quantity after the other; none of a brick without any.
    pub(crate) fn brick(&self, brick: IVec3) -> Option<impl Iterator<Item = &BrickValues>> {
        let n = self.coords.binary_search_by_key(&order(brick), |&coord| order(coord)).ok()?;
        Some(self.quantities.iter().map(move |values| &values[n]))
    }

    /// A quantity at voxel (i, j, k); 0 where nothing is stored.
    pub fn voxel(&self, quantity: usize, voxel: IVec3) -> f32 {
        let place = (voxel & (BRICK_EDGE as i32 - 1)).as_uvec3();
        let values = self.brick(voxel >> BRICK_EDGE.ilog2()).and_then(|mut brick| brick.nth(quantity));
        values.map_or(0.0, |values| values[(place.x + 8 * (place.y + 8 * place.z)) as usize])
    }

    /// Σ density · quantity · h³ over all voxels, for each quantity: of velocities the momentum.
    pub fn carried_by(&self, density: &DensityGrid) -> Vec<f64> {
        let volume = f64::from(density.voxel_size()).powi(3);
        let of_brick = |values: &[BrickValues], n: usize| {
            let corner = self.coords[n] * BRICK_EDGE as i32;
            let voxels = values[n].iter().enumerate();
            voxels.map(|(i, &v)| f64::from(v) * f64::from(density.voxel(corner + local_voxel(i).as_ivec3()))).sum()
        };
        let total = |values: &Vec<BrickValues>| {
            let sums: Vec<f64> = parallel::map(values.len(), |n| of_brick(values, n));
            volume * sums.iter().sum::<f64>()
        };
        self.quantities.iter().map(total).collect()
    }

    /// Memory that it holds [bytes].
    pub fn memory_bytes(&self) -> u64 {
        let values = self.quantities.len() * size_of::<BrickValues>();
        (self.coords.len() * (size_of::<IVec3>() + values)) as u64
    }
}
