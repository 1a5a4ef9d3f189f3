//! Particles to voxels, with mass conserved and the same bits whatever the number of threads.
//!
//! Every (brick, particle) pair is listed and the list sorted; each brick is then summed by one task in the order of the
//! particles. Nothing is added in an order that depends on scheduling.
//!
//! Near obstacles ([`crate::grid::soft`]) a kernel loses what it has in and behind walls. Its mass is given back to what
//! is left, so that mass is conserved: a first pass over the bricks finds the share of each particle that walls leave,
//! and the second divides by it.

use crate::grid::kernel::{Kernel, MAX_RADIUS, MAX_WIDTH, MIN_RADIUS, reach, touches};
use crate::grid::soft::{BrickDistances, ObstacleDistance, SHARE_MIN, Sight, Sounding, SplatMass, fade, gain};
use crate::grid::{BRICK_VOXELS, BrickValues, DensityGrid, GridError, MAX_COORDINATE, check_memory};
use crate::math::parallel;
use glam::{DVec3, IVec3, UVec3};

/// Most pieces that the streak of one particle is split into; longer streaks than 256 kernel radii become dotted.
pub const MAX_PIECES: u32 = 512;

/// The particles to splat; all slices have the same length.
#[derive(Debug, Clone, Copy)]
pub struct SplatInput<'a> {
    /// Coordinates [m].
    pub position: [&'a [f32]; 3],
    /// Components [m/s], for motion blur.
    pub velocity: [&'a [f32]; 3],
    /// Mass [density·m³], at least 0.
    pub mass: &'a [f32],
    /// Reach of the kernel along each axis [m], greater than 0.
    pub radius: &'a [f32],
    /// What kernels fade towards and do not reach through.
    pub obstacles: Option<&'a dyn ObstacleDistance>,
}

/// How to splat.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SplatSettings {
    /// Edge of a voxel [m].
    pub voxel_size: f32,
    /// Opening and closing of the shutter relative to the particles' instant [s]; equal for no motion blur.
    pub shutter_seconds: [f64; 2],
    /// Distance from obstacles at which kernels begin to fade [m], at least 0; each particle's own kernel radius where
    /// `None`. At 0 obstacles are ignored.
    pub soft_radius: Option<f64>,
    /// More memory than this is never asked for [bytes].
    pub memory_limit_bytes: u64,
}

/// The density of the particles, and what became of their mass.
#[derive(Debug, Clone, PartialEq)]
pub struct Splat {
    /// The density.
    pub grid: DensityGrid,
    /// Where the mass went.
    pub mass: SplatMass,
}

/// Splats particles onto the voxels whose low corner (0, 0, 0) is the world's origin. A particle is smeared evenly along
/// position + velocity·t while the shutter is open, in pieces at most half a kernel radius apart; of its pieces those
/// count that can be seen from its position.
///
/// # Errors
/// [`GridError::BadParticle`] for the first particle with a value out of range, [`GridError::OverMemory`] before anything
/// large is allocated, [`GridError::Lengths`], [`GridError::VoxelSize`].
pub fn splat(input: &SplatInput, settings: &SplatSettings) -> Result<Splat, GridError> {
    let splatter = Splatter::try_new(input, settings)?;
    let limit = settings.memory_limit_bytes;
    let Some((brick_min, brick_max)) = splatter.brick_box() else {
        let grid = DensityGrid::from_bricks(DVec3::ZERO, settings.voxel_size, &[], &[], limit)?;
        return Ok(Splat { grid, mass: SplatMass::default() });
    };
    let dims = (brick_max - brick_min + 1).as_u64vec3();
    let pair_count = parallel::sum(input.mass.len(), |i| splatter.brick_count(i));
    let pair_bytes = pair_count.saturating_mul(2 * size_of::<u64>() as u64);
    check_memory(dims, 0, pair_bytes, limit)?;
    let dims = dims.as_uvec3();
    let pairs = splatter.sorted_pairs(brick_min, dims);
    let chunks: Vec<&[u64]> = pairs.chunk_by(|a, b| a >> 32 == b >> 32).collect();
    let coord = |pair: u64| brick_min + place_to_brick((pair >> 32) as u32, dims).as_ivec3();
    let bricks: Vec<BrickPairs> = chunks.iter().map(|&pairs| BrickPairs { brick: coord(pairs[0]), pairs }).collect();
    let held_bytes = pair_bytes.saturating_add(splatter.wall_bytes(&bricks));
    check_memory(dims.as_u64vec3(), bricks.len() as u64, held_bytes, limit)?;
    let walls = splatter.measure_walls(&bricks);
    let mut values: Vec<BrickValues> = vec![[0.0; BRICK_VOXELS]; bricks.len()];
    parallel::for_each_mut(&mut values, |n, values| {
        *values = splatter.sum_brick(&bricks[n], walls.distances.get(n).and_then(Option::as_deref), &walls.kept);
    });
    let coords: Vec<IVec3> = bricks.iter().map(|b| b.brick).collect();
    let mut mass = splatter.account(&walls.kept);
    drop((walls, bricks, chunks));
    drop(pairs);
    let grid = DensityGrid::from_bricks(DVec3::ZERO, settings.voxel_size, &coords, &values, limit)?;
    mass.grid = grid.mass();
    Ok(Splat { grid, mass })
}

/// A brick and its pairs, in the order of particles.
struct BrickPairs<'a> {
    brick: IVec3,
    pairs: &'a [u64],
}

/// What obstacles do to the particles near them.
struct Walls {
    /// The share that they leave of each particle near them, `None` of others; empty when there are no obstacles.
    kept: Vec<Option<f64>>,
    /// For each brick, the distances of its voxels where a particle near a wall reaches it.
    distances: Vec<Option<Box<BrickDistances>>>,
}

fn particle_of(pair: u64) -> usize {
    (pair & u64::from(u32::MAX)) as usize
}

fn place_to_brick(place: u32, dims: UVec3) -> UVec3 {
    UVec3::new(place % dims.x, place / dims.x % dims.y, place / dims.x / dims.y)
}

struct Splatter<'a> {
    input: &'a SplatInput<'a>,
    shutter: [f64; 2],
    inverse_voxel_size: f64,
    sight: Option<Sight<'a>>,
    /// [voxels]
    soft_radius: Option<f64>,
}

impl<'a> Splatter<'a> {
    fn try_new(input: &'a SplatInput<'a>, settings: &SplatSettings) -> Result<Self, GridError> {
        let h = f64::from(settings.voxel_size);
        if !(h.is_finite() && h > 0.0) {
            return Err(GridError::VoxelSize(h));
        }
        let count = input.mass.len();
        let slices = input.position.iter().chain(&input.velocity).chain([&input.radius]);
        if let Some(other) = slices.map(|s| s.len()).find(|&n| n != count) {
            return Err(GridError::Lengths(count, other));
        }
        let is_soft = settings.soft_radius.is_none_or(|r| r > 0.0);
        let splatter = Self {
            input,
            shutter: settings.shutter_seconds,
            inverse_voxel_size: 1.0 / h,
            sight: input.obstacles.filter(|_| is_soft).map(|o| Sight::new(o, h)),
            soft_radius: settings.soft_radius.map(|r| r / h),
        };
        match parallel::find_first(count, |i| splatter.complaint(i)) {
            Some(error) => Err(error),
            None => Ok(splatter),
        }
    }

    /// What is wrong with particle `i`, if anything.
    fn complaint(&self, i: usize) -> Option<GridError> {
        let bad = |what, value| Some(GridError::BadParticle { particle_idx: i, what, value });
        let limit = f64::from(MAX_COORDINATE - 2 * MAX_WIDTH as i32);
        for axis in 0..3 {
            let (p, v) = (self.input.position[axis][i], self.input.velocity[axis][i]);
            if !p.is_finite() {
                return bad("the position must be finite", p);
            }
            if !v.is_finite() {
                return bad("the velocity must be finite", v);
            }
            for time in self.shutter {
                let reached = (f64::from(p) + f64::from(v) * time) * self.inverse_voxel_size;
                if reached.is_nan() || reached.abs() >= limit {
                    return bad("the position must be within four million voxels of the origin", p);
                }
            }
        }
        let (mass, radius) = (self.input.mass[i], self.input.radius[i]);
        if !(mass >= 0.0 && mass.is_finite()) {
            return bad("the mass must be finite and at least 0", mass);
        }
        if !(radius > 0.0 && f64::from(radius) * self.inverse_voxel_size <= MAX_RADIUS) {
            return bad("the kernel radius must be greater than 0 and at most 128 voxels", radius);
        }
        None
    }

    fn radius(&self, i: usize) -> f64 {
        (f64::from(self.input.radius[i]) * self.inverse_voxel_size).max(MIN_RADIUS)
    }

    fn vector(&self, components: &[&[f32]; 3], i: usize) -> DVec3 {
        DVec3::new(f64::from(components[0][i]), f64::from(components[1][i]), f64::from(components[2][i]))
    }

    fn piece_count(&self, i: usize) -> u32 {
        let length = self.vector(&self.input.velocity, i).length() * (self.shutter[1] - self.shutter[0]).abs();
        let pieces = length * self.inverse_voxel_size / (0.5 * self.radius(i));
        (pieces.ceil() as u32).clamp(1, MAX_PIECES)
    }

    /// Centres of the pieces of particle `i` [voxels, relative to voxel centres].
    fn centers(&self, i: usize) -> impl ExactSizeIterator<Item = DVec3> {
        let (position, velocity) = (self.vector(&self.input.position, i), self.vector(&self.input.velocity, i));
        let (count, [open, close], scale) = (self.piece_count(i), self.shutter, self.inverse_voxel_size);
        (0..count).map(move |k| {
            let time = open + (close - open) * (f64::from(k) + 0.5) / f64::from(count);
            (position + velocity * time) * scale - 0.5
        })
    }

    /// First and last brick that each piece of particle `i` reaches; none for one that weighs nothing.
    fn brick_ranges(&self, i: usize) -> impl Iterator<Item = (IVec3, IVec3)> {
        let radius = self.radius(i);
        let centers = (self.input.mass[i] > 0.0).then(|| self.centers(i));
        centers.into_iter().flatten().map(move |c| {
            let (low, high) = reach(c, radius);
            (low >> 3, high >> 3)
        })
    }

    /// Calls `visit` once for each brick that particle `i` reaches.
    fn for_each_brick(&self, i: usize, mut visit: impl FnMut(IVec3)) {
        let (mut seen_low, mut seen_high) = (IVec3::ONE, IVec3::ZERO);
        for (low, high) in self.brick_ranges(i) {
            // Pieces lie in order on a line, so a brick reached by an earlier piece and by this one was reached by the
            // piece between them too: comparing with the last piece is enough.
            if (low, high) != (seen_low, seen_high) {
                for z in low.z..=high.z {
                    for y in low.y..=high.y {
                        for x in low.x..=high.x {
                            let brick = IVec3::new(x, y, z);
                            if brick.cmplt(seen_low).any() || brick.cmpgt(seen_high).any() {
                                visit(brick);
                            }
                        }
                    }
                }
            }
            (seen_low, seen_high) = (low, high);
        }
    }

    fn brick_count(&self, i: usize) -> u64 {
        let mut count = 0;
        self.for_each_brick(i, |_| count += 1);
        count
    }

    /// First and last brick that any particle reaches.
    fn brick_box(&self) -> Option<(IVec3, IVec3)> {
        let widen = |(a, b): (IVec3, IVec3), (c, d): (IVec3, IVec3)| (a.min(c), b.max(d));
        parallel::reduce(self.input.mass.len(), |i| self.brick_ranges(i).reduce(widen), widen)
    }

    /// Place of the brick in the box (upper half) and particle (lower half) of every pair, in order.
    fn sorted_pairs(&self, brick_min: IVec3, dims: UVec3) -> Vec<u64> {
        let mut pairs: Vec<u64> = parallel::gather(self.input.mass.len(), |i, pairs| {
            self.for_each_brick(i, |brick| {
                let p = (brick - brick_min).as_uvec3();
                let place = (p.z * dims.y + p.y) * dims.x + p.x;
                pairs.push(u64::from(place) << 32 | i as u64);
            });
        });
        parallel::sort(&mut pairs);
        pairs
    }

    fn soft_radius(&self, i: usize) -> f64 {
        self.soft_radius.unwrap_or_else(|| self.radius(i))
    }

    /// Middle of the streak of particle `i`, and half its length [voxels].
    fn streak(&self, i: usize) -> (DVec3, f64) {
        let (position, velocity) = (self.vector(&self.input.position, i), self.vector(&self.input.velocity, i));
        let [open, close] = self.shutter;
        let middle = (position + velocity * (0.5 * (open + close))) * self.inverse_voxel_size - 0.5;
        (middle, 0.5 * velocity.length() * (close - open).abs() * self.inverse_voxel_size)
    }

    /// Where particle `i` is at its instant [voxels, relative to voxel centres].
    fn own_place(&self, i: usize) -> DVec3 {
        self.vector(&self.input.position, i) * self.inverse_voxel_size - 0.5
    }

    /// True when a wall may take something of particle `i`.
    fn is_near_wall(&self, sight: &Sight, i: usize) -> bool {
        let (middle, half_length) = self.streak(i);
        // A shutter that is open at another time than the particle's instant: the line of sight to the pieces counts.
        let detour = middle.distance(self.own_place(i));
        let reach = self.radius(i) * 3f64.sqrt() + half_length.max(detour);
        sight.sound(middle).distance < reach + self.soft_radius(i)
    }

    /// The shares that walls leave, found brick by brick and added up in the order of bricks.
    fn measure_walls(&self, bricks: &[BrickPairs]) -> Walls {
        let Some(sight) = &self.sight else { return Walls { kept: Vec::new(), distances: Vec::new() } };
        let count = self.input.mass.len();
        let is_near = parallel::map(count, |i| self.input.mass[i] > 0.0 && self.is_near_wall(sight, i));
        let mut kept: Vec<Option<f64>> = is_near.iter().map(|&near| near.then_some(0.0)).collect();
        let measured = parallel::map(bricks.len(), |n| {
            let b = &bricks[n];
            let near: Vec<usize> = b.pairs.iter().map(|&pair| particle_of(pair)).filter(|&i| is_near[i]).collect();
            if near.is_empty() {
                return (None, Vec::new());
            }
            let distances = sight.of_brick(b.brick);
            let mut kernel = Kernel::zeroed();
            let shares = near.into_iter().map(|i| {
                let mut share = 0.0;
                self.for_each_seen(sight, &mut kernel, b.brick, &distances, i, |_, weight| share += weight);
                (i as u32, share)
            });
            let shares: Vec<(u32, f64)> = shares.collect();
            (Some(distances), shares)
        });
        let mut distances = Vec::with_capacity(bricks.len());
        for (of_brick, shares) in measured {
            for (i, share) in shares {
                kept[i as usize] = kept[i as usize].map(|sum| sum + share);
            }
            distances.push(of_brick);
        }
        Walls { kept, distances }
    }

    /// At most what [`Splatter::measure_walls`] will hold [bytes].
    fn wall_bytes(&self, bricks: &[BrickPairs]) -> u64 {
        if self.sight.is_none() {
            return 0;
        }
        let pair_count: usize = bricks.iter().map(|b| b.pairs.len()).sum();
        let of_bricks = bricks.len() * (size_of::<BrickDistances>() + 64);
        (of_bricks + pair_count * size_of::<(u32, f64)>() + self.input.mass.len() * (1 + size_of::<Option<f64>>()))
            as u64
    }

    /// Calls `visit` with number and weight of each voxel of `brick` that particle `i` reaches and walls leave it; all
    /// weights of a particle that walls take nothing from add up to 1.
    fn for_each_seen(
        &self,
        sight: &Sight,
        kernel: &mut Kernel,
        brick: IVec3,
        distances: &BrickDistances,
        i: usize,
        mut visit: impl FnMut(usize, f64),
    ) {
        let radius = self.radius(i);
        let inverse_soft = 1.0 / self.soft_radius(i);
        let own = sight.sound(self.own_place(i));
        let centers = self.centers(i);
        let piece = 1.0 / centers.len() as f64;
        for center in centers.filter(|&c| touches(c, radius, brick)) {
            let from = if center == own.place { own } else { sight.sound(center) };
            // A piece behind a wall: the streak is straight and the particle's path went round.
            if !sight.is_clear(own, from) {
                continue;
            }
            kernel.place(center, radius);
            kernel.for_each_voxel(brick, |number, voxel, weight| {
                let distance = f64::from(distances[number]);
                let left = piece * weight * fade(distance * inverse_soft);
                if left > 0.0 && sight.is_clear(from, Sounding { place: voxel.as_dvec3(), distance }) {
                    visit(number, left);
                }
            });
        }
    }

    /// Densities of one brick, summed over its pairs in their order. `distances` are there if any particle of the brick
    /// is near a wall, and `kept` are the shares of all particles, or empty.
    fn sum_brick(&self, b: &BrickPairs, distances: Option<&BrickDistances>, kept: &[Option<f64>]) -> BrickValues {
        // Single precision would lose mass where a million particles meet in one voxel.
        let mut values = [0.0f64; BRICK_VOXELS];
        let mut kernel = Kernel::zeroed();
        for &pair in b.pairs {
            let i = particle_of(pair);
            let density = f64::from(self.input.mass[i]) * self.inverse_voxel_size.powi(3);
            let share = kept.get(i).copied().flatten();
            if let (Some(sight), Some(distances), Some(share)) = (&self.sight, distances, share) {
                let amount = density * gain(share);
                self.for_each_seen(sight, &mut kernel, b.brick, distances, i, |number, weight| {
                    values[number] += amount * weight;
                });
                continue;
            }
            let radius = self.radius(i);
            let centers = self.centers(i);
            let amount = density / centers.len() as f64;
            for center in centers.filter(|&c| touches(c, radius, b.brick)) {
                kernel.place(center, radius);
                kernel.add_to(&mut values, b.brick, amount);
            }
        }
        values.map(|v| v as f32)
    }

    /// Where the mass of the particles went, added up in their order; what the grid holds is left at 0.
    fn account(&self, kept: &[Option<f64>]) -> SplatMass {
        let mut mass = SplatMass::default();
        for (i, &m) in self.input.mass.iter().enumerate() {
            let m = f64::from(m);
            mass.particles += m;
            let Some(share) = kept.get(i).copied().flatten() else { continue };
            // Less is the rounding of weights.
            if share < 1.0 - 1e-6 {
                mass.faded += m * (1.0 - share);
            }
            if share < SHARE_MIN {
                mass.lost += m * (1.0 - share * gain(share));
            }
        }
        mass
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_brick_of_a_streak_is_listed_once() {
        let (position, velocity) = ([[0.3f32], [0.7], [-0.2]], [[100.0f32], [-31.0], [7.7]]);
        let input = SplatInput {
            position: [&position[0], &position[1], &position[2]],
            velocity: [&velocity[0], &velocity[1], &velocity[2]],
            mass: &[1.0],
            radius: &[2.5],
            obstacles: None,
        };
        let settings = SplatSettings {
            voxel_size: 1.0,
            shutter_seconds: [-0.5, 0.5],
            soft_radius: None,
            memory_limit_bytes: 1 << 30,
        };
        let splatter = Splatter::try_new(&input, &settings).unwrap();
        let mut listed = Vec::new();
        splatter.for_each_brick(0, |b| listed.push(b.to_array()));
        let mut expected: Vec<[i32; 3]> = splatter
            .brick_ranges(0)
            .flat_map(|(a, b)| {
                (a.x..=b.x).flat_map(move |x| (a.y..=b.y).flat_map(move |y| (a.z..=b.z).map(move |z| [x, y, z])))
            })
            .collect();
        expected.sort_unstable();
        expected.dedup();
        listed.sort_unstable();
        assert_eq!(listed, expected);
        assert!(splatter.piece_count(0) >= 80);
    }
}
