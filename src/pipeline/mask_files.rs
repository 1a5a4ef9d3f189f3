//! Reads the pictures and grids that masks of the flow are made of.

use crate::flow::mask::Block;
use crate::flow::{MaskFiles, MaskSamples};
use crate::grid::{BRICK_EDGE, DensityGrid, local_voxel, vdb};
use crate::math::lattice::Lattice;
use crate::output;
use crate::scene::Scene;
use crate::scene::settings::Mask;
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
        dense(&grid, self.memory_limit).map_err(|problem| format!("{}: {problem}", path.display()))
    }
}

/// The key of the file that a message about masks begins with; that of all potentials where there is none.
pub fn key_of(scene: &Scene, message: &str) -> String {
    for (i, potential) in scene.settings.flow.potentials.iter().enumerate() {
        for (j, mask) in potential.masks().iter().enumerate() {
            let (kind, file) = match mask {
                Mask::Image(mask) => ("image", &mask.file),
                Mask::Grid(mask) => ("grid", &mask.file),
                _ => continue,
            };
            if message.starts_with(&scene.resolve(file).display().to_string()) {
                return format!("flow.potentials[{i}].{}.modulate[{j}].{kind}.file", potential.name());
            }
        }
    }
    "flow.potentials".into()
}

/// All voxels of the box of occupied bricks.
fn dense(grid: &DensityGrid, memory_limit: u64) -> Result<MaskSamples, String> {
    let edge = BRICK_EDGE as i32;
    let bricks: Vec<IVec3> = grid.occupied_bricks().map(|(coord, _)| coord).collect();
    let low = bricks.iter().copied().reduce(IVec3::min).ok_or("the grid is empty")?;
    let high = bricks.iter().copied().reduce(IVec3::max).ok_or("the grid is empty")?;
    let dims = ((high - low + 1) * edge).as_uvec3();
    let needed = Block::memory_bytes(dims);
    if needed > memory_limit {
        return Err(format!("as a mask its box of {dims} voxels takes {needed} bytes, more than the memory limit"));
    }
    let mut values = Lattice::filled(dims, 0.0);
    for (coord, brick) in grid.occupied_bricks() {
        for (i, value) in brick.into_iter().enumerate() {
            values.set(((coord - low) * edge).as_uvec3() + local_voxel(i), value);
        }
    }
    let spacing = f64::from(grid.voxel_size());
    let origin = grid.origin() + ((low * edge).as_dvec3() + 0.5) * spacing;
    Ok(MaskSamples { values, origin, spacing })
}
