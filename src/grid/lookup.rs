//! The trilinear read of a density, the hottest function of the renderer.

use crate::grid::{DensityGrid, STORED_EDGE};
use crate::math::space::{IndexPoint, UnitVec3, WorldPoint};
use glam::{Vec3, Vec3A, Vec4};

/// A ray in the index space of a grid. The parameter `t` is that of the ray in world space [m].
#[derive(Debug, Clone, Copy)]
pub struct IndexRay {
    origin: Vec3,
    direction: Vec3,
}

impl IndexRay {
    /// The point at `t` [m].
    #[inline]
    pub fn at(&self, t: f32) -> IndexPoint {
        IndexPoint(self.origin + self.direction * t)
    }

    /// Start of the ray [voxels].
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// Change of position per metre [voxels/m].
    pub fn direction(&self) -> Vec3 {
        self.direction
    }
}

/// The eight samples at the corners of a cube, between which the density is interpolated.
#[derive(Debug, Clone, Copy)]
pub struct Samples {
    /// Of the lower and of the upper z: x first, then y.
    near: Vec4,
    far: Vec4,
    /// Index coordinates of the low corner.
    low: Vec3,
}

impl Samples {
    /// The trilinear density at a point of the cube; beyond it, what the same polynomial says.
    #[inline]
    pub fn density(&self, p: IndexPoint) -> f32 {
        self.within((p.0 - self.low).into())
    }

    /// The same at a point relative to the cube's low corner.
    #[inline(always)]
    pub fn within(&self, at: Vec3A) -> f32 {
        let rows = self.near + (self.far - self.near) * at.z;
        let (low, high) = (rows.x + (rows.z - rows.x) * at.y, rows.y + (rows.w - rows.y) * at.y);
        low + (high - low) * at.x
    }
}

impl DensityGrid {
    /// Index coordinates of a world point. They are counted from the low corner of the stored bricks, not from
    /// [`DensityGrid::origin`], so that they are small and not negative wherever there is density.
    #[inline]
    pub fn to_index(&self, p: WorldPoint) -> IndexPoint {
        IndexPoint((p.0 - self.corner) * self.inverse_voxel_size - 0.5)
    }

    /// The world point of index coordinates.
    #[inline]
    pub fn to_world(&self, p: IndexPoint) -> WorldPoint {
        WorldPoint(self.corner + (p.0 + 0.5) * self.voxel_size)
    }

    /// Largest index coordinates at which there may be density.
    pub fn extent(&self) -> Vec3 {
        self.extent
    }

    /// The ray in index space.
    #[inline]
    pub fn ray_to_index(&self, origin: WorldPoint, direction: UnitVec3) -> IndexRay {
        IndexRay { origin: self.to_index(origin).0, direction: direction.as_vec3() * self.inverse_voxel_size }
    }

    /// The trilinear density at `p`; 0 outside and where `p` is not a number.
    #[inline]
    pub fn density_at(&self, p: IndexPoint) -> f32 {
        self.samples_round(p).map_or(0.0, |samples| samples.density(p))
    }

    /// The eight samples from which the density is interpolated at `p`; `None` outside.
    #[inline]
    pub fn samples_round(&self, p: IndexPoint) -> Option<Samples> {
        let p = p.0;
        if !(p.cmpge(Vec3::ZERO).all() && p.cmplt(self.extent).all()) {
            return None;
        }
        // Not negative, so truncation is the floor.
        self.samples_at([p.x as i32 as usize, p.y as i32 as usize, p.z as i32 as usize])
    }

    /// The eight samples of the cube whose low corner has these whole numbers, below 2²³, for index coordinates; `None` outside.
    #[inline(always)]
    pub fn samples_from(&self, corner: Vec3A) -> Option<Samples> {
        if !(corner.cmpge(Vec3A::ZERO).all() && corner.cmplt(self.extent.into()).all()) {
            return None;
        }
        // A whole number below 2^23 is in the last bits of its sum with it.
        const ONES: f32 = 8_388_608.0;
        let whole = |x: f32| (x.to_bits() & 0x007f_ffff) as usize;
        let shifted = corner + ONES;
        self.samples_at([whole(shifted.x), whole(shifted.y), whole(shifted.z)])
    }

    #[inline(always)]
    fn samples_at(&self, cell: [usize; 3]) -> Option<Samples> {
        let dims = self.directory.dims();
        let place = ((cell[2] >> 3) * dims.y as usize + (cell[1] >> 3)) * dims.x as usize + (cell[0] >> 3);
        let brick_idx = *self.directory.values().get(place)?;
        let brick = self.bricks.get(brick_idx as usize)?;
        let at = ((cell[2] & 7) * STORED_EDGE + (cell[1] & 7)) * STORED_EDGE + (cell[0] & 7);
        const ROW: usize = STORED_EDGE;
        const LAYER: usize = STORED_EDGE * STORED_EDGE;
        // One check for all eight.
        let corners = brick[at.min(brick.len())..].first_chunk::<{ LAYER + ROW + 2 }>()?;
        let face = |o: usize| Vec4::new(corners[o], corners[o + 1], corners[o + ROW], corners[o + ROW + 1]);
        let low = Vec3::new(cell[0] as i32 as f32, cell[1] as i32 as f32, cell[2] as i32 as f32);
        Some(Samples { near: face(0), far: face(LAYER), low })
    }

    /// The density of one of the eight voxels that [`DensityGrid::density_at`] interpolates, each taken with the probability
    /// of its weight where `u` is uniform in the unit cube. It reads one number where the mean reads eight.
    #[inline]
    pub fn density_nearby(&self, p: IndexPoint, u: Vec3) -> f32 {
        let Some((brick, voxel)) = self.voxel_nearby(p, u) else { return 0.0 };
        self.bricks.get(brick).map_or(0.0, |samples| samples[stored(voxel)])
    }

    /// Whether that density is larger than `bound`, ≥ 0.
    #[inline]
    pub fn exceeds_nearby(&self, p: IndexPoint, u: Vec3, bound: f32) -> bool {
        let Some((brick, voxel)) = self.voxel_nearby(p, u) else { return false };
        let number = (voxel[2] << 6) + (voxel[1] << 3) + voxel[0];
        match self.rough.exceeds(brick, number, bound) {
            Some(exceeds) => exceeds,
            None => self.bricks.get(brick).is_some_and(|samples| samples[stored(voxel)] > bound),
        }
    }

    /// Brick and place in it of the voxel in which `p` lies when it is moved by `u`, both rounded down.
    #[inline(always)]
    fn voxel_nearby(&self, p: IndexPoint, u: Vec3) -> Option<(usize, [usize; 3])> {
        let p = p.0;
        let place = p + u;
        // The floor of a number in [½, 2^23) is in the last bits of what rounds to a multiple of 1; below ½ there is nothing.
        if !(place.cmpge(Vec3::splat(0.5)).all() && place.cmplt(self.extent).all()) {
            return None;
        }
        const ONES: f32 = 8_388_608.0;
        let rounded = (place - 0.5) + ONES;
        let floor = |x: f32| (x.to_bits() & 0x007f_ffff) as usize;
        let [x, y, z] = [floor(rounded.x), floor(rounded.y), floor(rounded.z)];
        let dims = self.directory.dims();
        let place = ((z >> 3) * dims.y as usize + (y >> 3)) * dims.x as usize + (x >> 3);
        let &brick_idx = self.directory.values().get(place)?;
        Some((brick_idx as usize, [x & 7, y & 7, z & 7]))
    }

    /// The trilinear density at a world point.
    #[inline]
    pub fn density(&self, p: WorldPoint) -> f32 {
        self.density_at(self.to_index(p))
    }
}

/// Place of a voxel among the samples of its brick.
#[inline(always)]
fn stored([x, y, z]: [usize; 3]) -> usize {
    (z * STORED_EDGE + y) * STORED_EDGE + x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};
    use glam::{DVec3, IVec3, UVec3};

    /// Plainly from the definition, in double precision, voxel by voxel.
    fn reference(grid: &DensityGrid, p: DVec3) -> f64 {
        let q = (p - grid.origin()) / f64::from(grid.voxel_size()) - 0.5;
        let cell = q.floor();
        let f = q - cell;
        (0..8)
            .map(|c| {
                let step = IVec3::new(c & 1, (c >> 1) & 1, c >> 2);
                let weight = (0..3).map(|a| if step[a] == 1 { f[a] } else { 1.0 - f[a] }).product::<f64>();
                weight * f64::from(grid.voxel(cell.as_ivec3() + step))
            })
            .sum()
    }

    #[test]
    fn equals_the_definition_everywhere() {
        let mut rng = CounterRng::new(Seed(1));
        let origin = WorldPoint::new(-3.0, 0.7, 12.5);
        let grid = DensityGrid::from_fn(origin, 0.25, UVec3::new(19, 25, 8), 1 << 24, |p| {
            (3.0 * p.0.x).sin().max(0.0) + (2.0 * p.0.y).cos().max(0.0) * p.0.z
        })
        .unwrap();
        for _ in 0..100_000 {
            let r = Vec3::new(rng.uniform(), rng.uniform(), rng.uniform());
            let p = origin + (r * 1.4 - 0.2) * Vec3::new(19.0, 25.0, 8.0) * 0.25;
            let (value, expected) = (f64::from(grid.density(p)), reference(&grid, p.0.as_dvec3()));
            assert!((value - expected).abs() < 1e-3, "{p:?}: {value} {expected}");
        }
    }

    /// Both the mean and that nothing but the eight voxels round a point is read.
    #[test]
    fn the_voxels_nearby_have_the_interpolated_mean() {
        let mut rng = CounterRng::new(Seed(4));
        let origin = WorldPoint::new(-1.0, 0.5, 2.0);
        let grid = DensityGrid::from_fn(origin, 0.25, UVec3::new(17, 9, 24), 1 << 24, |p| {
            (3.0 * p.0.x).sin().max(0.0) + (2.0 * p.0.y).cos().max(0.0) * p.0.z
        })
        .unwrap();
        for _ in 0..300 {
            let r = Vec3::new(rng.uniform(), rng.uniform(), rng.uniform());
            let p = grid.to_index(origin + (r * 1.2 - 0.1) * Vec3::new(17.0, 9.0, 24.0) * 0.25);
            let (mut sum, mut square) = (0.0, 0.0);
            const N: u32 = 4000;
            for _ in 0..N {
                let value = f64::from(grid.density_nearby(p, rng.coarse_point()));
                sum += value;
                square += value * value;
            }
            let mean = sum / f64::from(N);
            let error = ((square / f64::from(N) - mean * mean).max(0.0) / f64::from(N)).sqrt();
            let expected = f64::from(grid.density_at(p));
            assert!((mean - expected).abs() <= 4.5 * error + 1e-5, "{p:?}: {mean} {expected} {error}");
        }
    }

    #[test]
    fn nonsense_points_read_zero() {
        let grid = DensityGrid::from_fn(WorldPoint::default(), 1.0, UVec3::splat(8), 1 << 20, |_| 1.0).unwrap();
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1e-30] {
            assert_eq!(grid.density_at(IndexPoint(Vec3::new(bad, 9.0, 9.0))), 0.0);
            assert_eq!(grid.density_at(IndexPoint(Vec3::splat(bad))), 0.0);
            assert_eq!(grid.density_nearby(IndexPoint(Vec3::splat(bad)), Vec3::splat(0.9)), 0.0);
        }
        assert_eq!(grid.density(WorldPoint::new(4.0, 4.0, 4.0)), 1.0);
        assert_eq!(grid.density(WorldPoint::new(0.0, 4.0, 4.0)), 0.5);
        assert_eq!(grid.density(WorldPoint::new(8.0, 4.0, 4.0)), 0.5);
        assert_eq!(grid.density(WorldPoint::new(-0.5, 4.0, 4.0)), 0.0);
    }
}
