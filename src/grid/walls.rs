//! What walls leave of the particles of a batch: the two passes over bricks that soft particles take.
//!
//! The first pass finds which voxels each piece sees and what share of its weight that is; the second adds by the same
//! voxels, so that no line of sight is followed twice.

use crate::grid::kernel::Kernel;
use crate::grid::soft::{BrickDistances, Lines, Seen, Sight, Sounding, faded_row, gain};
use crate::grid::streak::{Piece, Pieces};
use crate::grid::{BRICK_EDGE, BRICK_VOXELS};
use crate::math::lanes::{self, Batch, run_kernel};
use crate::math::parallel;
use glam::IVec3;
use std::ops::Range;

/// A brick and its pairs, in the order of pieces.
pub(crate) struct BrickPairs<'a> {
    pub brick: IVec3,
    /// In the lower half of each the number of the piece.
    pub pairs: &'a [u64],
}

/// Number of the piece of a pair.
#[inline(always)]
pub(crate) fn piece_of(pair: u64) -> usize {
    (pair & u64::from(u32::MAX)) as usize
}

/// What walls do to the particles of a batch.
pub(crate) struct Walls<'a> {
    sight: &'a Sight<'a>,
    first: usize,
    /// The share that is left of each particle; 1 where no wall is near.
    kept: Vec<f64>,
    /// For each brick, what pieces near walls see of it, in the order of pairs.
    seen: Vec<Vec<Seen>>,
}

impl<'a> Walls<'a> {
    /// What is left of the particles, found brick by brick and added up in the order of bricks. `pieces` get their distances to walls
    /// and the mass of what walls take away, `distances` those of bricks that a piece near a wall reaches.
    pub fn apply(
        pieces: &mut Pieces,
        sight: &'a Sight<'a>,
        bricks: &[BrickPairs],
        distances: &mut [&mut Option<Box<BrickDistances>>],
    ) -> Self {
        let range = pieces.range();
        let sounded = sound(pieces, sight);
        parallel::for_each_mut(pieces.all_mut(), |n, piece| piece.wall = sounded[n]);
        let measured = parallel::try_map(bricks.iter().zip(distances), |_, (b, distances)| {
            let piece = |&pair: &u64| &pieces.all()[piece_of(pair)];
            let near_count = b.pairs.iter().map(piece).filter(|piece| piece.wall < f64::INFINITY).count();
            if near_count == 0 {
                return Ok::<_, std::convert::Infallible>((Vec::new(), Vec::new()));
            }
            let mut near = Vec::with_capacity(near_count);
            near.extend(b.pairs.iter().map(piece).filter(|piece| piece.wall < f64::INFINITY));
            let distances = distances.get_or_insert_with(|| sight.of_brick(b.brick));
            let seen = run_kernel(Look { sight, brick: b.brick, distances, near: &near });
            let left = near.iter().zip(&seen).map(|(piece, seen)| (piece.particle, piece.amount * seen.weight));
            Ok((left.collect(), seen))
        });
        let Ok(measured) = measured;
        let mut left = vec![0.0; range.len()];
        let mut seen = Vec::with_capacity(bricks.len());
        for (of_particles, of_brick) in measured {
            for (particle, density) in of_particles {
                left[particle as usize] += density;
            }
            seen.push(of_brick);
        }
        let streaks = pieces.streaks();
        let share = |n: usize| {
            let is_near = pieces.of(range.start + n).first().is_some_and(|piece| piece.wall < f64::INFINITY);
            if is_near { left[n] / streaks.density(range.start + n) } else { 1.0 }
        };
        let kept = parallel::map(range.len(), share);
        parallel::for_each_mut(pieces.all_mut(), |_, piece| {
            if piece.wall < f64::INFINITY {
                piece.amount *= gain(kept[piece.particle as usize]);
            }
        });
        Self { sight, first: range.start, kept, seen }
    }

    /// The share that is left of particle `i`.
    pub fn kept(&self, i: usize) -> f64 {
        self.kept[i - self.first]
    }

    /// What was seen of brick `n`, to go through once.
    pub fn of_brick(&'a self, n: usize, distances: &'a BrickDistances) -> SeenPieces<'a> {
        SeenPieces { walls: self, distances, seen: self.seen[n].iter() }
    }
}

/// Stands for the distance of a piece behind a wall: the streak only nearly follows the particle's path, which went round.
const BEHIND: f64 = -1.0;

/// For each piece its distance to the wall, `BEHIND`, or infinity where walls take nothing from its particle.
fn sound(pieces: &Pieces, sight: &Sight) -> Vec<f64> {
    /// Particles that are asked for together: enough to fill lanes.
    const TOGETHER: usize = 1024;
    let range = pieces.range();
    parallel::gather(range.len().div_ceil(TOGETHER), |n, distances| {
        let start = range.start + n * TOGETHER;
        sound_together(pieces, sight, start..range.end.min(start + TOGETHER), distances);
    })
}

/// Adds the distances of the pieces of some particles.
fn sound_together(pieces: &Pieces, sight: &Sight, range: Range<usize>, distances: &mut Vec<f64>) {
    let streaks = pieces.streaks();
    let middles: Vec<_> = range.clone().map(|i| streaks.middle(i, pieces.of(i))).collect();
    let places: Vec<_> = middles.iter().map(|(place, _)| *place).collect();
    let (mut particles, mut centers) = (Vec::new(), Vec::new());
    for ((i, (middle, half_length)), distance) in range.zip(middles).zip(sight.sound_all(&places)) {
        let (first, of_particle) = (distances.len(), pieces.of(i));
        distances.resize(first + of_particle.len(), f64::INFINITY);
        let own = streaks.own_place(i);
        // A shutter that is open at another time than the particle's instant: the line of sight to the pieces counts.
        let radius = streaks.radius(i);
        let reach = radius * 3f64.sqrt() + half_length.max(middle.distance(own));
        if streaks.has_mass(i) && distance < reach + sight.soft_radius(radius) {
            let distance = if own == middle { distance } else { sight.sound(own).distance };
            particles.push((Sight::sounding_of_particle(own, distance), first..distances.len()));
            centers.extend(of_particle.iter().map(|piece| piece.center));
        }
    }
    let mut soundings = centers.iter().zip(sight.sound_all(&centers));
    for (own, of_particle) in particles {
        for (found, (&place, distance)) in distances[of_particle].iter_mut().zip(&mut soundings) {
            let at = if place == own.place { own } else { Sounding { place, distance } };
            *found = if sight.is_clear(own, at) { at.distance.min(f64::MAX) } else { BEHIND };
        }
    }
}

/// Lines of sight that are followed together: enough to fill lanes.
const LINES: usize = 1024;

/// The first pass over one brick: what each piece near a wall sees of it.
struct Look<'a> {
    sight: &'a Sight<'a>,
    brick: IVec3,
    distances: &'a BrickDistances,
    near: &'a [Piece],
}

impl lanes::Kernel for Look<'_> {
    type Output = Vec<Seen>;

    #[inline(always)]
    fn run<L: Batch>(self, _: L) -> Vec<Seen> {
        let Self { sight, brick, distances, near } = self;
        let corner = (brick * BRICK_EDGE as i32).as_dvec3();
        let (distances, _) = distances.as_chunks::<BRICK_EDGE>();
        let (mut lines, mut seen) = (Lines::default(), vec![Seen::default(); near.len()]);
        for (slot, piece) in near.iter().enumerate() {
            if piece.wall == BEHIND {
                continue;
            }
            let from = Sounding { place: piece.center, distance: piece.wall };
            let inverse_soft = 1.0 / sight.soft_radius(piece.radius);
            let (mut own, mut sums) = (Seen::default(), [0.0; BRICK_EDGE]);
            Kernel::within(brick, piece.center, piece.radius).for_each_row(
                1.0,
                #[inline(always)]
                |n, weights| {
                    let weights = faded_row(weights, &distances[n], inverse_soft);
                    lines.add_row(from, corner, n, &weights, &distances[n], slot, &mut own, &mut sums);
                },
            );
            let [a, b, c, d, e, f, g, h] = sums;
            own.weight = ((a + e) + (c + g)) + ((b + f) + (d + h));
            seen[slot] = own;
            if lines.len() >= LINES {
                sight.follow(&mut lines, &mut seen);
            }
        }
        sight.follow(&mut lines, &mut seen);
        seen
    }
}

/// What pieces near walls see of a brick, one after the other.
pub(crate) struct SeenPieces<'a> {
    walls: &'a Walls<'a>,
    distances: &'a BrickDistances,
    seen: std::slice::Iter<'a, Seen>,
}

impl<'a> SeenPieces<'a> {
    /// What the next piece sees.
    #[inline(always)]
    pub fn next(&mut self) -> Option<&'a Seen> {
        self.seen.next()
    }

    /// Adds `amount` times what a piece, with this kernel, leaves at the voxels that it sees.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    pub fn add(&self, seen: &Seen, kernel: &Kernel, radius: f64, amount: f64, values: &mut [f64; BRICK_VOXELS]) {
        let inverse_soft = 1.0 / self.walls.sight.soft_radius(radius);
        let (rows, _) = values.as_chunks_mut::<BRICK_EDGE>();
        let (distances, _) = self.distances.as_chunks::<BRICK_EDGE>();
        kernel.for_each_row(
            amount,
            #[inline(always)]
            |n, weights| {
                let left = seen.of_row(n, &faded_row(weights, &distances[n], inverse_soft));
                let row = &mut rows[n];
                for x in 0..BRICK_EDGE {
                    row[x] += left[x];
                }
            },
        );
    }
}
