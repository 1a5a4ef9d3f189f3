//! What walls leave of the particles of a batch: the two passes over bricks that soft particles take.
//!
//! The first pass finds which voxels each piece sees and what share of its weight that is; the second adds by the same
//! voxels, so that no line of sight is followed twice.

use crate::grid::kernel::{Kernel, touches};
use crate::grid::soft::{BrickDistances, Lines, Seen, Sight, Sounding, faded_row};
use crate::grid::streak::{Way, Ways};
use crate::grid::{BRICK_EDGE, BRICK_VOXELS};
use crate::math::lanes::{self, Batch, run_kernel};
use crate::math::parallel;
use glam::IVec3;
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
    /// What is left of the particles, found brick by brick and added up in the order of bricks. `distances` get those of
    /// bricks that a particle near a wall reaches.
    pub fn measure(
        ways: &Ways,
        sight: &'a Sight<'a>,
        bricks: &[BrickPairs],
        distances: &mut [&mut Option<Box<BrickDistances>>],
    ) -> Self {
        let first = ways.range().start;
        let Soundings { near, pieces } = Soundings::new(ways, sight);
        let mut kept: Vec<Option<f64>> = near.iter().map(|near| near.map(|_| 0.0)).collect();
        let near_of = |b: &BrickPairs, pair: u64| Some((b.particle(pair), near[b.particle(pair) - first]?));
        let measured = parallel::try_map(bricks.iter().zip(distances), |_, (b, distances)| {
            let near: Vec<(usize, usize)> = b.pairs.iter().filter_map(|&pair| near_of(b, pair)).collect();
            if near.is_empty() {
                return Ok::<_, std::convert::Infallible>((Vec::new(), Vec::new()));
            }
            let distances = distances.get_or_insert_with(|| sight.of_brick(b.brick));
            let mut pass = FirstPass::new(ways, sight, b.brick, distances);
            near.iter().for_each(|&(i, first_piece)| pass.look(i, &pieces[first_piece..]));
            sight.follow(&mut pass.lines, &mut pass.seen);
            let mut next = 0;
            let shares: Vec<(u32, f64)> =
                near.iter().map(|&(i, _)| ((i - first) as u32, pass.share(i, &mut next))).collect();
            Ok((shares, pass.seen))
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

/// What walls are to the particles of a batch, before anything is asked about voxels.
struct Soundings {
    /// Of particles that a wall may take something from, where their pieces begin in `pieces`; `None` of others.
    near: Vec<Option<usize>>,
    /// For each piece of those the distance of its centre to the wall, or `BEHIND`.
    pieces: Vec<f64>,
}

/// Stands for the distance of a piece behind a wall: the streak only nearly follows the particle's path, which went round.
const BEHIND: f64 = -1.0;

impl Soundings {
    fn new(ways: &Ways, sight: &Sight) -> Self {
        /// Particles that are asked for together: enough to fill lanes.
        const TOGETHER: usize = 1024;
        let range = ways.range();
        let found = parallel::map(range.len().div_ceil(TOGETHER), |n| {
            let start = range.start + n * TOGETHER;
            sound_together(ways, sight, start..range.end.min(start + TOGETHER))
        });
        let mut all = Self { near: Vec::with_capacity(range.len()), pieces: Vec::new() };
        for Self { near, pieces } in found {
            let before = all.pieces.len();
            all.near.extend(near.into_iter().map(|first| Some(before + first?)));
            all.pieces.extend(pieces);
        }
        all
    }
}

fn sound_together(ways: &Ways, sight: &Sight, range: Range<usize>) -> Soundings {
    let streaks = ways.streaks();
    let middles: Vec<_> = range.clone().map(|i| streaks.middle(i, ways.of(i).1)).collect();
    let places: Vec<_> = middles.iter().map(|(place, _)| *place).collect();
    let mut near = Vec::with_capacity(range.len());
    let (mut particles, mut centers) = (Vec::new(), Vec::new());
    for ((i, (middle, half_length)), distance) in range.zip(middles).zip(sight.sound_all(&places)) {
        let own = streaks.own_place(i);
        // A shutter that is open at another time than the particle's instant: the line of sight to the pieces counts.
        let (Way { radius, .. }, pieces) = ways.of(i);
        let reach = radius * 3f64.sqrt() + half_length.max(middle.distance(own));
        let is_near = streaks.has_mass(i) && distance < reach + sight.soft_radius(radius);
        near.push(is_near.then_some(centers.len()));
        if is_near {
            let distance = if own == middle { distance } else { sight.sound(own).distance };
            particles.push((Sight::sounding_of_particle(own, distance), pieces.len()));
            centers.extend(pieces);
        }
    }
    let mut pieces = sight.sound_all(&centers);
    let mut first = 0;
    for (own, count) in particles {
        for piece in first..first + count {
            let at = if centers[piece] == own.place {
                own
            } else {
                Sounding { place: centers[piece], distance: pieces[piece] }
            };
            pieces[piece] = if sight.is_clear(own, at) { at.distance } else { BEHIND };
        }
        first += count;
    }
    Soundings { near, pieces }
}

/// Lines of sight that are followed together: enough to fill lanes, few enough to stay in the cache.
const LINES: usize = 1024;

/// The first pass over one brick.
struct FirstPass<'a> {
    ways: &'a Ways<'a>,
    sight: &'a Sight<'a>,
    brick: IVec3,
    distances: &'a BrickDistances,
    /// Of each piece that reaches the brick.
    seen: Vec<Seen>,
    lines: Lines,
    kernel: Kernel,
}

impl<'a> FirstPass<'a> {
    fn new(ways: &'a Ways, sight: &'a Sight, brick: IVec3, distances: &'a BrickDistances) -> Self {
        let (seen, lines, kernel) = (Vec::new(), Lines::default(), Kernel::zeroed());
        Self { ways, sight, brick, distances, seen, lines, kernel }
    }

    /// Adds what each piece of particle `i` sees of the brick, and the lines of sight that are yet to be followed. `distances` are
    /// those of its pieces.
    fn look(&mut self, i: usize, distances: &[f64]) {
        let (Way { radius, .. }, centers) = self.ways.of(i);
        for (&center, &distance) in centers.iter().zip(distances) {
            if !touches(center, radius, self.brick) {
                continue;
            }
            let slot = self.seen.len();
            let mut seen = Seen::default();
            if distance != BEHIND {
                let Self { brick, distances, lines, kernel, .. } = self;
                let from = Sounding { place: center, distance };
                kernel.place(center, radius);
                run_kernel(Ask { kernel, lines, from, brick: *brick, distances, slot, seen: &mut seen });
            }
            self.seen.push(seen);
            if self.lines.len() >= LINES {
                self.sight.follow(&mut self.lines, &mut self.seen);
            }
        }
    }

    /// The share of the weight of particle `i` that is seen of the brick, once all lines are followed. `next` is the number of its
    /// first piece, and of the one after its last afterwards.
    fn share(&mut self, i: usize, next: &mut usize) -> f64 {
        let (Way { radius, .. }, centers) = self.ways.of(i);
        let inverse_soft = 1.0 / self.sight.soft_radius(radius);
        let mut share = 0.0;
        for &center in centers {
            if touches(center, radius, self.brick) {
                let seen = &self.seen[*next];
                *next += 1;
                if *seen != Seen::default() {
                    self.kernel.place(center, radius);
                    let Self { brick, distances, kernel, .. } = self;
                    share += run_kernel(Share { kernel, brick: *brick, distances, inverse_soft, seen });
                }
            }
        }
        share / centers.len() as f64
    }
}

/// Asks for lines of sight to the voxels of a kernel.
struct Ask<'a> {
    kernel: &'a Kernel,
    lines: &'a mut Lines,
    from: Sounding,
    brick: IVec3,
    distances: &'a BrickDistances,
    slot: usize,
    seen: &'a mut Seen,
}

impl lanes::Kernel for Ask<'_> {
    type Output = ();

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn run<L: Batch>(self, _: L) {
        let Self { kernel, lines, from, brick, distances, slot, seen } = self;
        let corner = (brick * BRICK_EDGE as i32).as_dvec3();
        let (distances, _) = distances.as_chunks::<BRICK_EDGE>();
        kernel.for_each_row(
            brick,
            1.0,
            #[inline(always)]
            |n, weights| {
                let mut row = [0.0; BRICK_EDGE];
                for x in 0..BRICK_EDGE {
                    row[x] = f64::from(distances[n][x]);
                }
                lines.add_row(from, corner, n, [weights, &row], slot, seen);
            },
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

impl<'a> SeenPieces<'a> {
    /// As [`Walls::kept`].
    #[inline(always)]
    pub fn share(&self, i: usize) -> Option<f64> {
        self.walls.kept(i)
    }

    /// What the next piece sees.
    #[inline(always)]
    pub fn next(&mut self) -> Option<&'a Seen> {
        self.seen.next()
    }

    /// Adds `amount` times what a piece, with this kernel, leaves at the voxels that it sees.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    pub fn add(
        &self,
        seen: &Seen,
        kernel: &Kernel,
        radius: f64,
        brick: IVec3,
        amount: f64,
        values: &mut [f64; BRICK_VOXELS],
    ) {
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
