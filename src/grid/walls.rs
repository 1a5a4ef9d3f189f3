//! What walls leave of the particles of a batch: the two passes over bricks that soft particles take.
//!
//! The first pass finds which voxels each piece sees and what share of its weight that is; the second adds by the same
//! voxels, so that no line of sight is followed twice.

use crate::grid::kernel::{Kernel, touches};
use crate::grid::soft::{BrickDistances, Lines, Seen, Sight, Sounding, faded_row};
use crate::grid::streak::Streaks;
use crate::grid::{BRICK_EDGE, BRICK_VOXELS};
use crate::math::lanes::{self, Batch, run_kernel};
use crate::math::parallel;
use glam::{DVec3, IVec3};
use std::ops::Range;

/// A brick and its pairs, in the order of particles.
pub(crate) struct BrickPairs<'a> {
    pub brick: IVec3,
    /// Number of the batch's first particle.
    pub first: usize,
    /// In the lower half of each the particle, counted from the first.
    pub pairs: &'a [u64],
}

impl BrickPairs<'_> {
    /// Number of the particle of a pair.
    #[inline(always)]
    pub fn particle(&self, pair: u64) -> usize {
        self.first + (pair & u64::from(u32::MAX)) as usize
    }
}

/// What walls do to the particles of a batch.
pub(crate) struct Walls<'a> {
    sight: &'a Sight<'a>,
    first: usize,
    /// The share that is left of each particle near a wall; `None` of others.
    kept: Vec<Option<f64>>,
    /// For each brick, what pieces near walls see of it, in the order of pairs and pieces.
    seen: Vec<Vec<Seen>>,
}

impl<'a> Walls<'a> {
    /// What is left of the particles of `range`, found brick by brick and added up in the order of bricks. `distances` get those of
    /// bricks that a particle near a wall reaches.
    pub fn measure(
        streaks: &Streaks,
        sight: &'a Sight<'a>,
        range: Range<usize>,
        bricks: &[BrickPairs],
        distances: &mut [&mut Option<Box<BrickDistances>>],
    ) -> Self {
        let first = range.start;
        let near = soundings(streaks, sight, range);
        let mut kept: Vec<Option<f64>> = near.iter().map(|near| near.map(|_| 0.0)).collect();
        let near_of = |b: &BrickPairs, pair: u64| Some((b.particle(pair), near[b.particle(pair) - first]?));
        let measured = parallel::try_map(bricks.iter().zip(distances), |_, (b, distances)| {
            let mut found = (Vec::new(), Vec::new());
            let mut pass =
                FirstPass { streaks, sight, brick: b.brick, lines: Lines::default(), kernel: Kernel::zeroed() };
            for (i, own) in b.pairs.iter().filter_map(|&pair| near_of(b, pair)) {
                let distances = distances.get_or_insert_with(|| sight.of_brick(b.brick));
                let share = pass.look(i, own, distances, &mut found.1);
                found.0.push(((i - first) as u32, share));
            }
            Ok::<_, std::convert::Infallible>(found)
        });
        let Ok(measured) = measured;
        let mut seen = Vec::with_capacity(bricks.len());
        for (shares, of_brick) in measured {
            for (n, share) in shares {
                kept[n as usize] = kept[n as usize].map(|sum| sum + share);
            }
            seen.push(of_brick);
        }
        Self { sight, first, kept, seen }
    }

    /// The share that is left of particle `i`; `None` where no wall is near.
    pub fn kept(&self, i: usize) -> Option<f64> {
        self.kept[i - self.first]
    }

    /// What was seen of brick `n`, to go through once.
    pub fn of_brick(&'a self, n: usize, distances: &'a BrickDistances) -> SeenPieces<'a> {
        SeenPieces { walls: self, distances, seen: self.seen[n].iter() }
    }
}

/// The place of each particle of `range` with its distance to the wall, of those that a wall may take something from.
fn soundings(streaks: &Streaks, sight: &Sight, range: Range<usize>) -> Vec<Option<Sounding>> {
    /// Enough to fill lanes.
    const PIECE: usize = 1024;
    let mut near: Vec<Option<Sounding>> = vec![None; range.len()];
    parallel::for_each_chunk_mut(&mut near, PIECE, |n, near| {
        let first = range.start + n * PIECE;
        let middles: Vec<_> = (first..first + near.len()).map(|i| streaks.middle(i)).collect();
        let places: Vec<_> = middles.iter().map(|(place, _)| *place).collect();
        let distances = sight.sound_all(&places);
        for (at, near) in near.iter_mut().enumerate() {
            let (i, (middle, half_length)) = (first + at, middles[at]);
            let own = streaks.own_place(i);
            // A shutter that is open at another time than the particle's instant: the line of sight to the pieces counts.
            let radius = streaks.radius(i);
            let reach = radius * 3f64.sqrt() + half_length.max(middle.distance(own));
            if streaks.has_mass(i) && distances[at] < reach + sight.soft_radius(radius) {
                let is_same = own == middle;
                *near = Some(if is_same { Sounding { place: own, distance: distances[at] } } else { sight.sound(own) });
            }
        }
    });
    near
}

/// The first pass over one brick.
struct FirstPass<'a> {
    streaks: &'a Streaks<'a>,
    sight: &'a Sight<'a>,
    brick: IVec3,
    lines: Lines,
    kernel: Kernel,
}

impl FirstPass<'_> {
    /// Adds to `seen` what each piece of particle `i` sees of the brick; returns the share of the particle's weight in it.
    fn look(&mut self, i: usize, own: Sounding, distances: &BrickDistances, seen: &mut Vec<Seen>) -> f64 {
        let (radius, count) = (self.streaks.radius(i), self.streaks.piece_count(i));
        let inverse_soft = 1.0 / self.sight.soft_radius(radius);
        let mut share = 0.0;
        for k in 0..count {
            let center = self.streaks.center(i, k, count);
            if !touches(center, radius, self.brick) {
                continue;
            }
            let from = if center == own.place { own } else { self.sight.sound(center) };
            let mut of_piece = Seen::default();
            // A piece behind a wall: the streak is straight and the particle's path went round.
            if self.sight.is_clear(own, from) {
                self.lines.begin(from, self.brick);
                let (kernel, lines, brick) = (&mut self.kernel, &mut self.lines, self.brick);
                run_kernel(Ask { kernel, lines, center, radius, brick, distances, seen: &mut of_piece });
                self.sight.follow(&mut self.lines, &mut of_piece);
                let kernel = &self.kernel;
                share += run_kernel(Share { kernel, brick, distances, inverse_soft, seen: &of_piece });
            }
            seen.push(of_piece);
        }
        share / f64::from(count)
    }
}

/// Places a kernel and asks for lines of sight to its voxels.
struct Ask<'a> {
    kernel: &'a mut Kernel,
    lines: &'a mut Lines,
    center: DVec3,
    radius: f64,
    brick: IVec3,
    distances: &'a BrickDistances,
    seen: &'a mut Seen,
}

impl lanes::Kernel for Ask<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Batch>(self, _: L) {
        let Self { kernel, lines, center, radius, brick, distances, seen } = self;
        kernel.place(center, radius);
        let (distances, _) = distances.as_chunks::<BRICK_EDGE>();
        kernel.for_each_row(
            brick,
            1.0,
            #[inline(always)]
            |n, weights| lines.add_row(n, weights, &distances[n], seen),
        );
    }
}

/// The share of a kernel's weight that is seen of a brick.
struct Share<'a> {
    kernel: &'a Kernel,
    brick: IVec3,
    distances: &'a BrickDistances,
    inverse_soft: f64,
    seen: &'a Seen,
}

impl lanes::Kernel for Share<'_> {
    type Output = f64;

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn run<L: Batch>(self, _: L) -> f64 {
        let Self { kernel, brick, distances, inverse_soft, seen } = self;
        let (distances, _) = distances.as_chunks::<BRICK_EDGE>();
        let mut sums = [0.0; BRICK_EDGE];
        kernel.for_each_row(
            brick,
            1.0,
            #[inline(always)]
            |n, weights| {
                let left = faded_row(n, weights, &distances[n], inverse_soft, seen);
                for x in 0..BRICK_EDGE {
                    sums[x] += left[x];
                }
            },
        );
        sums.iter().sum()
    }
}

/// What pieces near walls see of a brick, one after the other.
pub(crate) struct SeenPieces<'a> {
    walls: &'a Walls<'a>,
    distances: &'a BrickDistances,
    seen: std::slice::Iter<'a, Seen>,
}

impl SeenPieces<'_> {
    /// As [`Walls::kept`].
    #[inline(always)]
    pub fn share(&self, i: usize) -> Option<f64> {
        self.walls.kept(i)
    }

    /// Adds `amount` times what the next piece, with this kernel, leaves at the voxels that it sees.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    pub fn add_next(
        &mut self,
        kernel: &Kernel,
        radius: f64,
        brick: IVec3,
        amount: f64,
        values: &mut [f64; BRICK_VOXELS],
    ) {
        let Some(seen) = self.seen.next() else { return };
        let inverse_soft = 1.0 / self.walls.sight.soft_radius(radius);
        let (rows, _) = values.as_chunks_mut::<BRICK_EDGE>();
        let (distances, _) = self.distances.as_chunks::<BRICK_EDGE>();
        kernel.for_each_row(
            brick,
            amount,
            #[inline(always)]
            |n, weights| {
                let left = faded_row(n, weights, &distances[n], inverse_soft, seen);
                let row = &mut rows[n];
                for x in 0..BRICK_EDGE {
                    row[x] += left[x];
                }
            },
        );
    }
}
