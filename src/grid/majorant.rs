//! Upper bounds of the density on a coarse lattice, and the walk of a ray through them.
//!
//! The walk is that of Amanatides and Woo 1987, *A Fast Voxel Traversal Algorithm for Ray Tracing*, on two levels: cells of
//! [`CELL_EDGE`] voxels, and blocks of [`BLOCK_EDGE`] cells whose emptiness lets the walk jump. It knows nothing of
//! random numbers: trackers take the segments and decide what happens on them.

use crate::grid::{BRICK_EDGE, DensityGrid, box_points, stored_offset};
use crate::math::lattice::Lattice;
use crate::math::space::{UnitVec3, WorldPoint};
use glam::{IVec3, UVec3, Vec3};
use rayon::prelude::*;

/// Voxels along the edge of a cell of the majorant: smaller cells bound more tightly, larger ones take fewer steps.
pub const CELL_EDGE: usize = 4;
/// Cells along the edge of a block that is jumped over when it is empty.
pub const BLOCK_EDGE: usize = 4;

const CELLS_PER_BRICK: usize = BRICK_EDGE / CELL_EDGE;
/// A point computed from origin, direction and `t` can lie outside its segment's cell by rounding; bounds hold this far
/// outside [voxels].
const SLACK: f32 = 1.0 / 1024.0;
/// Direction components smaller than this never leave a cell within any representable scene.
const PARALLEL: f32 = 1e-20;

/// Upper bounds of a grid's interpolated density.
#[derive(Debug, Clone)]
pub struct MajorantGrid {
    cells: Lattice<f32>,
    is_block_occupied: Lattice<bool>,
    /// World position of index (0, 0, 0) [m].
    index_origin: Vec3,
    inverse_cell_size: f32,
    max_density: f32,
}

/// A piece of a ray on which the density is at most `density_max`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Start, distance along the ray [m].
    pub t0: f32,
    /// End, at least `t0` [m].
    pub t1: f32,
    /// Upper bound of the trilinear density between them, > 0.
    pub density_max: f32,
}

impl MajorantGrid {
    /// Bounds for all of `grid`.
    pub fn new(grid: &DensityGrid) -> Self {
        let dims = grid.directory.dims() * CELLS_PER_BRICK as u32;
        let exact = cell_maxima(grid, dims);
        let around = neighbour_maxima(&exact);
        let mut cells = exact;
        for (cell, &around) in cells.values_mut().iter_mut().zip(around.values()) {
            if *cell > 0.0 {
                // Outside by at most SLACK along each of three axes, the interpolant mixes in at most 3·SLACK of what
                // lies there; the last factor covers the rounding of the interpolation itself.
                *cell = (*cell + 3.0 * SLACK * (around - *cell)) * (1.0 + 4.0 * f32::EPSILON);
            }
        }
        let max_density = cells.values().iter().copied().fold(0.0, f32::max);
        Self {
            is_block_occupied: occupied_blocks(&cells),
            cells,
            index_origin: grid.corner + 0.5 * grid.voxel_size,
            inverse_cell_size: grid.inverse_voxel_size / CELL_EDGE as f32,
            max_density,
        }
    }

    /// Upper bound of the density anywhere.
    pub fn max_density(&self) -> f32 {
        self.max_density
    }

    /// Memory that the bounds hold [bytes].
    pub fn memory_bytes(&self) -> u64 {
        (size_of_val(self.cells.values()) + size_of_val(self.is_block_occupied.values())) as u64
    }
}

/// Maximum of the samples that any point of a cell interpolates from: its own and the first layer beyond.
fn cell_maxima(grid: &DensityGrid, dims: UVec3) -> Lattice<f32> {
    let place = |i: usize| {
        let (x, rest) = (i as u32 % dims.x, i as u32 / dims.x);
        UVec3::new(x, rest % dims.y, rest / dims.y)
    };
    let values = (0..dims.element_product() as usize)
        .into_par_iter()
        .map(|i| {
            let cell = place(i);
            let brick_idx = grid.directory.at(cell / CELLS_PER_BRICK as u32);
            if brick_idx == 0 {
                return 0.0;
            }
            let brick = &grid.bricks[brick_idx as usize];
            let low = cell % CELLS_PER_BRICK as u32 * CELL_EDGE as u32;
            box_points(UVec3::splat(CELL_EDGE as u32 + 1)).map(|p| brick[stored_offset(low + p)]).fold(0.0, f32::max)
        })
        .collect();
    Lattice::from_values(dims, values)
}

/// Maximum over each cell and its 26 neighbours, one axis at a time.
fn neighbour_maxima(cells: &Lattice<f32>) -> Lattice<f32> {
    let mut result = cells.clone();
    for axis in [IVec3::X, IVec3::Y, IVec3::Z] {
        let before = result.clone();
        for p in box_points(cells.dims()) {
            let at = |q| before.get(q).unwrap_or(0.0);
            let p_signed = p.as_ivec3();
            result.set(p, at(p_signed).max(at(p_signed - axis)).max(at(p_signed + axis)));
        }
    }
    result
}

fn occupied_blocks(cells: &Lattice<f32>) -> Lattice<bool> {
    let mut blocks = Lattice::filled((cells.dims() + (BLOCK_EDGE as u32 - 1)) / BLOCK_EDGE as u32, false);
    for p in box_points(cells.dims()).filter(|&p| cells.at(p) > 0.0) {
        blocks.set(p / BLOCK_EDGE as u32, true);
    }
    blocks
}

/// The segments of a ray on which there may be density, in increasing `t`. Between segments, before the first and after
/// the last there is none.
#[derive(Debug, Clone)]
pub struct MajorantIterator<'a> {
    grid: &'a MajorantGrid,
    /// Start of the ray and its change per metre, in cells.
    origin: [f32; 3],
    direction: [f32; 3],
    /// 1 / direction; 0 along axes the ray is parallel to.
    inverse: [f32; 3],
    cell: [i32; 3],
    /// `t` at which the ray leaves the current cell along each axis.
    exit: [f32; 3],
    t: f32,
    t_max: f32,
}

impl<'a> MajorantIterator<'a> {
    /// The walk along `origin + t·direction` for `t_min ≤ t ≤ t_max`, in metres; `t_max` may be infinite.
    #[inline]
    pub fn new(grid: &'a MajorantGrid, origin: WorldPoint, direction: UnitVec3, t_min: f32, t_max: f32) -> Self {
        let o = (origin.0 - grid.index_origin) * grid.inverse_cell_size;
        let d = direction.as_vec3() * grid.inverse_cell_size;
        let dims = grid.cells.dims();
        let mut walk = Self {
            grid,
            origin: o.to_array(),
            direction: d.to_array(),
            inverse: d.to_array().map(|x| if x.abs() > PARALLEL { 1.0 / x } else { 0.0 }),
            cell: [0; 3],
            exit: [f32::INFINITY; 3],
            t: t_min,
            t_max,
        };
        for axis in 0..3 {
            let (start, end) = (walk.origin[axis], dims[axis] as f32);
            if walk.inverse[axis] == 0.0 {
                if !(start >= 0.0 && start < end) {
                    walk.t_max = f32::NEG_INFINITY;
                }
                continue;
            }
            let (a, b) = (-start * walk.inverse[axis], (end - start) * walk.inverse[axis]);
            walk.t = walk.t.max(a.min(b));
            walk.t_max = walk.t_max.min(a.max(b));
        }
        // Both false where anything was not a number.
        if t_min < t_max && o.is_finite() && walk.t < walk.t_max {
            walk.enter([0; 3], dims.as_ivec3().to_array().map(|n| n - 1));
        } else {
            walk.t_max = f32::NEG_INFINITY;
        }
        walk
    }

    /// Finds the cell at the current `t` within the box of cells `low ..= high`, and when it is left.
    #[inline]
    fn enter(&mut self, low: [i32; 3], high: [i32; 3]) {
        for axis in 0..3 {
            let at = self.origin[axis] + self.direction[axis] * self.t;
            // The cast truncates towards zero, which the lower bound of 0 makes good.
            self.cell[axis] = (at as i32).clamp(low[axis], high[axis]);
            self.exit[axis] = self.exit_of(axis, self.cell[axis]);
        }
    }

    /// `t` at which the ray leaves cell `cell` along `axis`. Computed anew from the cell each time, so that errors do
    /// not add up along the walk.
    #[inline]
    fn exit_of(&self, axis: usize, cell: i32) -> f32 {
        let inverse = self.inverse[axis];
        if inverse == 0.0 {
            return f32::INFINITY;
        }
        let boundary = cell + i32::from(inverse > 0.0);
        (boundary as f32 - self.origin[axis]) * inverse
    }

    #[inline]
    fn first_exit(&self) -> usize {
        let e = &self.exit;
        let xy = usize::from(e[1] < e[0]);
        if e[2] < e[xy] { 2 } else { xy }
    }

    /// Moves over the face at which the ray leaves the cell first; ends the walk outside.
    #[inline]
    fn step(&mut self) {
        let axis = self.first_exit();
        self.t = self.t.max(self.exit[axis]);
        self.cell[axis] += if self.inverse[axis] > 0.0 { 1 } else { -1 };
        if self.cell[axis] as u32 >= self.grid.cells.dims()[axis] {
            self.t_max = f32::NEG_INFINITY;
        }
        self.exit[axis] = self.exit_of(axis, self.cell[axis]);
    }

    /// Moves to where the ray leaves the empty block that the current cell is in.
    #[inline]
    fn jump(&mut self) {
        const EDGE: i32 = BLOCK_EDGE as i32;
        let dims = self.grid.cells.dims();
        let (mut low, mut high) = (self.cell, self.cell);
        for axis in 0..3 {
            // The cells of the block still ahead; the walk never turns back, so it ends whatever rounding does.
            let first = self.cell[axis] & !(EDGE - 1);
            if self.inverse[axis] > 0.0 {
                high[axis] = (first + EDGE).min(dims[axis] as i32) - 1;
                self.exit[axis] = self.exit_of(axis, high[axis]);
            } else if self.inverse[axis] < 0.0 {
                low[axis] = first;
                self.exit[axis] = self.exit_of(axis, first);
            }
        }
        let axis = self.first_exit();
        let last = if self.inverse[axis] > 0.0 { high[axis] } else { low[axis] };
        (low[axis], high[axis]) = (last, last);
        self.t = self.t.max(self.exit[axis]);
        self.enter(low, high);
        // Rounding may have put another axis' exit before; leave over the face that the jump was made to.
        self.exit[axis] = self.t;
        self.cell[axis] += if self.inverse[axis] > 0.0 { 1 } else { -1 };
        if self.cell[axis] as u32 >= dims[axis] {
            self.t_max = f32::NEG_INFINITY;
        }
        self.exit[axis] = self.exit_of(axis, self.cell[axis]);
    }
}

impl Iterator for MajorantIterator<'_> {
    type Item = Segment;

    #[inline]
    fn next(&mut self) -> Option<Segment> {
        while self.t < self.t_max {
            let cell = UVec3::from_array(self.cell.map(|c| c as u32));
            let density_max = self.grid.cells.at(cell);
            if density_max > 0.0 {
                let t0 = self.t;
                let t_max = self.t_max;
                self.step();
                let t1 = self.t.min(t_max);
                if t0 < t1 {
                    return Some(Segment { t0, t1, density_max });
                }
            } else if self.grid.is_block_occupied.at(cell / BLOCK_EDGE as u32) {
                self.step();
            } else {
                self.jump();
            }
        }
        None
    }
}
