//! Signed distances near surfaces, on voxels where other programs want them: level sets.

use crate::grid::{BRICK_EDGE, BRICK_VOXELS, BrickValues, GridError, MAX_COORDINATE, local_voxel};
use crate::math::parallel;
use glam::{DVec3, I64Vec3, IVec3, U64Vec3};

/// Half of the width of the band [voxels], as OpenVDB's own tools have it.
const BAND_VOXELS: f64 = 3.0;
/// Memory of a brick of the box: its class, twice while bricks are listed [bytes].
const PLACE_BYTES: u64 = 2;
/// Memory of a brick near a surface, with what writing it takes [bytes].
const BRICK_BYTES: u64 = 3 * size_of::<BrickValues>() as u64 + 256;

/// Distances [m], negative inside, at the centres of the voxels within three voxels of a surface; elsewhere only the side is known.
#[derive(Debug, Clone, PartialEq)]
pub struct LevelSet {
    /// Low corner of voxel (0, 0, 0) [m].
    pub(crate) origin: DVec3,
    /// Edge of a voxel [m].
    pub(crate) voxel_size: f32,
    /// Half of the width of the band [m].
    pub(crate) band: f32,
    /// Bricks with a voxel in the band.
    pub(crate) near: Vec<(IVec3, BrickValues)>,
    /// Bricks that are inside as a whole.
    pub(crate) inside: Vec<IVec3>,
}

/// What is known of a brick by the distance of its middle.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    Outside,
    Near,
    Inside,
}

impl LevelSet {
    /// Samples `distance` [m], which changes by no more than the way does, for surfaces within the box from `low` to `high` [m], on the
    /// voxels of edge `voxel_size` [m] of which (0, 0, 0) has its low corner at `origin`.
    ///
    /// # Errors
    /// [`GridError::VoxelSize`], [`GridError::TooFar`]; [`GridError::OverMemory`] before anything large is allocated.
    pub fn sample(
        origin: DVec3,
        voxel_size: f32,
        [low, high]: [DVec3; 2],
        memory_limit_bytes: u64,
        distance: impl Fn([f64; 3]) -> f64 + Sync,
    ) -> Result<Self, GridError> {
        let h = f64::from(voxel_size);
        if !(h.is_finite() && h > 0.0) {
            return Err(GridError::VoxelSize(h));
        }
        let edge = BRICK_EDGE as f64 * h;
        let brick_of = |p: DVec3, aside: f64| ((p + aside * h - origin) / edge).floor();
        let (first, last) = (brick_of(low, -BAND_VOXELS - 1.0), brick_of(high, BAND_VOXELS + 1.0));
        let furthest = first.abs().max(last.abs()).max_element() * BRICK_EDGE as f64;
        if furthest.is_nan() || furthest > f64::from(MAX_COORDINATE) {
            let corner = if first.abs().max_element() > last.abs().max_element() { first } else { last };
            return Err(GridError::TooFar { voxel: (corner * BRICK_EDGE as f64).as_i64vec3() });
        }
        let (first, dims) = (first.as_ivec3(), (last - first).as_i64vec3() + 1);
        let places = dims.element_product() as u64;
        check_memory(dims, places, 0, memory_limit_bytes)?;
        let coord = |n: usize| {
            let n = n as i64;
            first + I64Vec3::new(n % dims.x, n / dims.x % dims.y, n / dims.x / dims.y).as_ivec3()
        };
        let center = |brick: IVec3, i: usize| {
            let voxel = brick * BRICK_EDGE as i32 + local_voxel(i).as_ivec3();
            origin + (voxel.as_dvec3() + 0.5) * h
        };
        // From the middle of a brick to the centres of its corner voxels.
        let reach = 3f64.sqrt() * 0.5 * (BRICK_EDGE - 1) as f64 * h;
        let band = BAND_VOXELS * h;
        let sides = parallel::map(places as usize, |n| {
            let middle = origin + (coord(n).as_dvec3() + 0.5) * edge;
            match distance(middle.to_array()) {
                d if d >= band + reach => Side::Outside,
                d if d <= -band - reach => Side::Inside,
                _ => Side::Near,
            }
        });
        let of_side = |side: Side| (0..sides.len()).filter(|&n| sides[n] == side).map(coord).collect::<Vec<_>>();
        let (candidates, mut inside) = (of_side(Side::Near), of_side(Side::Inside));
        check_memory(dims, places, candidates.len() as u64, memory_limit_bytes)?;
        let values: Vec<BrickValues> = parallel::map(candidates.len(), |n| {
            std::array::from_fn::<f32, BRICK_VOXELS, _>(|i| distance(center(candidates[n], i).to_array()) as f32)
        });
        let band = band as f32;
        let (near, far): (Vec<_>, Vec<_>) =
            candidates.into_iter().zip(values).partition(|(_, values)| values.iter().any(|d| d.abs() < band));
        // No surface passes between neighbours that are so far from all.
        inside.extend(far.iter().filter(|(_, values)| values[0] < 0.0).map(|&(brick, _)| brick));
        Ok(Self { origin, voxel_size, band, near, inside })
    }

    /// Voxels in the band.
    pub fn active_voxel_count(&self) -> u64 {
        let in_band = |values: &BrickValues| values.iter().filter(|d| d.abs() < self.band).count() as u64;
        parallel::sum(self.near.len(), |n| in_band(&self.near[n].1))
    }
}

fn check_memory(dims: I64Vec3, places: u64, near: u64, limit_bytes: u64) -> Result<(), GridError> {
    let needed_bytes = places.saturating_mul(PLACE_BYTES).saturating_add(near.saturating_mul(BRICK_BYTES));
    if needed_bytes <= limit_bytes {
        return Ok(());
    }
    let voxels = dims.as_u64vec3() * U64Vec3::splat(BRICK_EDGE as u64);
    Err(GridError::OverMemory { voxels, brick_count: near, needed_bytes, limit_bytes })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball(limit: u64) -> Result<LevelSet, GridError> {
        let distance = |p: [f64; 3]| DVec3::from(p).length() - 1.0;
        LevelSet::sample(DVec3::ZERO, 0.05, [DVec3::splat(-1.0), DVec3::splat(1.0)], limit, distance)
    }

    #[test]
    fn the_band_of_a_ball_is_whole_and_no_more_than_three_voxels_to_either_side() {
        let level_set = ball(1 << 30).unwrap();
        let h = f64::from(level_set.voxel_size);
        let mut expected = 0;
        for x in -30..30 {
            for y in -30..30 {
                for z in -30..30 {
                    let d = ((IVec3::new(x, y, z).as_dvec3() + 0.5) * h).length() - 1.0;
                    expected += u64::from((d as f32).abs() < level_set.band);
                }
            }
        }
        assert_eq!(level_set.active_voxel_count(), expected);
        // All of the inside is near a surface or a brick inside: its volume is right.
        let inside = |values: &BrickValues| values.iter().filter(|&&d| d < 0.0).count();
        let voxels = level_set.near.iter().map(|(_, values)| inside(values)).sum::<usize>()
            + level_set.inside.len() * BRICK_VOXELS;
        let volume = voxels as f64 * h.powi(3);
        assert!((volume / (4.0 / 3.0 * std::f64::consts::PI) - 1.0).abs() < 0.01, "{volume}");
        assert!(!level_set.inside.is_empty());
    }

    #[test]
    fn boxes_beyond_all_memory_or_sense_are_refused() {
        assert!(matches!(ball(1 << 12), Err(GridError::OverMemory { .. })));
        let far = [DVec3::splat(-1e30), DVec3::splat(1e30)];
        let error = LevelSet::sample(DVec3::ZERO, 0.05, far, 1 << 30, |_| 0.0);
        assert!(matches!(error, Err(GridError::TooFar { .. })));
        assert!(matches!(LevelSet::sample(DVec3::ZERO, 0.0, far, 1 << 30, |_| 0.0), Err(GridError::VoxelSize(_))));
    }
}
