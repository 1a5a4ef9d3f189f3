//! Reads the pictures and grids that masks of the flow are made of.

use crate::flow::mask::Block;
use crate::flow::{MaskFiles, MaskSamples};
use crate::grid::{BRICK_EDGE, DensityGrid, local_voxel, vdb};
use crate::math::lattice::Lattice;
use crate::output;
use glam::{DVec3, IVec3, UVec3};
use std::path::Path;

/// Files on disk, within a limit of memory.
pub struct SceneFiles {
    /// Bytes.
    pub memory_limit: u64,
}

impl MaskFiles for SceneFiles {
    fn picture(&self, path: &Path, weights: [f64; 3]) -> Result<MaskSamples, String> {
        let image = output::read_image(path, self.memory_limit).map_err(|e| e.to_string())?;
        let rgb = image.to_rgb("").ok_or_else(|| format!("{}: has no channels R, G and B", path.display()))?;
        let [width, height] = image.data_size;
        check_memory(path, Block::flat_memory_bytes(UVec3::new(width, height, 1)), self.memory_limit)?;
        // Rows of pictures go down.
        let brightness = |i: usize| {
            let (x, y) = (i % width as usize, height as usize - 1 - i / width as usize);
            let pixel = rgb[y * width as usize + x];
            (0..3).map(|c| weights[c] * f64::from(pixel[c])).sum::<f64>() as f32
        };
        let values: Vec<f32> = (0..rgb.len()).map(brightness).collect();
        if values.iter().any(|x| !x.is_finite()) {
            return Err(format!("{}: has pixels that are not finite", path.display()));
        }
        let dims = UVec3::new(width, height, 1);
        Ok(MaskSamples { values: Lattice::from_values(dims, values), origin: DVec3::ZERO, spacing: 1.0 })
    }

    fn grid(&self, path: &Path, name: &str) -> Result<MaskSamples, String> {
        let grid = vdb::read_float_grid(path, name, self.memory_limit).map_err(|e| e.to_string())?;
        let voxels = dense_box(&grid).ok_or_else(|| format!("{}: the grid is empty", path.display()))?;
        check_memory(path, Block::memory_bytes(voxels.1), self.memory_limit)?;
        Ok(dense(&grid, voxels))
    }
}

/// An error where a mask takes more memory than allowed.
fn check_memory(path: &Path, needed: u64, limit: u64) -> Result<(), String> {
    if needed > limit {
        let path = path.display();
        return Err(format!("{path}: as a mask it takes {needed} bytes of memory, more than the limit of {limit}"));
    }
    Ok(())
}

/// First voxel and size of the box of occupied bricks; `None` of an empty grid.
fn dense_box(grid: &DensityGrid) -> Option<(IVec3, UVec3)> {
    let bricks: Vec<IVec3> = grid.occupied_bricks().map(|(coord, _)| coord).collect();
    let (low, high) = (bricks.iter().copied().reduce(IVec3::min)?, bricks.iter().copied().reduce(IVec3::max)?);
    let edge = BRICK_EDGE as i32;
    Some((low * edge, ((high - low + 1) * edge).as_uvec3()))
}

/// All voxels of a box.
fn dense(grid: &DensityGrid, (low, dims): (IVec3, UVec3)) -> MaskSamples {
    let mut values = Lattice::filled(dims, 0.0);
    for (coord, brick) in grid.occupied_bricks() {
        for (i, value) in brick.into_iter().enumerate() {
            values.set((coord * BRICK_EDGE as i32 - low).as_uvec3() + local_voxel(i), value);
        }
    }
    let spacing = f64::from(grid.voxel_size());
    let origin = grid.origin() + (low.as_dvec3() + 0.5) * spacing;
    MaskSamples { values, origin, spacing }
}
