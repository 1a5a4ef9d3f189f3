//! Particles as the splatter sees them: kernels in a row along the way that each goes while the shutter is open.

use crate::grid::kernel::{MAX_RADIUS, MAX_WIDTH, MIN_RADIUS, normalisation, reach};
use crate::grid::soft::ObstacleDistance;
use crate::grid::{GridError, MAX_COORDINATE};
use crate::math::parallel;
use glam::{DVec3, IVec3};
use std::ops::Range;

/// Most pieces that the streak of one particle is split into; longer streaks than 256 kernel radii become dotted.
pub const MAX_PIECES: u32 = 512;

/// Most voxels by which a way may bend: coordinates with it are far from overflow.
const MAX_BEND: f64 = 1e6;

/// The particles to splat; all slices have the same length.
#[derive(Debug, Clone, Copy)]
pub struct SplatInput<'a> {
    /// Coordinates [m].
    pub position: [&'a [f32]; 3],
    /// Components at the particle's instant [m/s], for motion blur.
    pub velocity: [&'a [f32]; 3],
    /// Accelerations [m/s²] and their changes [m/s³] at that instant, for motion blur along ways that bend; straight without.
    pub bends: Option<[[&'a [f32]; 3]; 2]>,
    /// Mass [density·m³], at least 0.
    pub mass: &'a [f32],
    /// Reach of the kernel along each axis [m], greater than 0.
    pub radius: &'a [f32],
    /// Quantities of which voxels get the mean, weighted by mass; none where only the density is wanted.
    pub carried: &'a [&'a [f32]],
    /// What kernels fade towards and do not reach through.
    pub obstacles: Option<&'a dyn ObstacleDistance>,
}

/// The streaks of particles in units of voxels. Places are relative to voxel centres.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Streaks<'a> {
    input: &'a SplatInput<'a>,
    shutter: [f64; 2],
    inverse_voxel_size: f64,
}

impl<'a> Streaks<'a> {
    /// The particles as they move from the first to the second time of `shutter` [s]; `first` is the number of the first of them,
    /// for errors.
    ///
    /// # Errors
    /// [`GridError::BadParticle`] for the first with a value out of range, [`GridError::Lengths`].
    pub fn try_new(
        input: &'a SplatInput<'a>,
        voxel_size: f64,
        shutter: [f64; 2],
        first: usize,
    ) -> Result<Self, GridError> {
        let count = input.mass.len();
        let bends = input.bends.iter().flatten().flatten();
        let slices =
            input.position.iter().chain(&input.velocity).chain(bends).chain([&input.radius]).chain(input.carried);
        if let Some(other) = slices.map(|s| s.len()).find(|&n| n != count) {
            return Err(GridError::Lengths(count, other));
        }
        let streaks = Self { input, shutter, inverse_voxel_size: 1.0 / voxel_size };
        match parallel::find_first(count, |i| streaks.complaint(i)) {
            Some((i, what, value)) => Err(GridError::BadParticle { particle_idx: first + i, what, value }),
            None => Ok(streaks),
        }
    }

    /// What is wrong with particle `i`, if anything, and the value that is.
    fn complaint(&self, i: usize) -> Option<(usize, &'static str, f32)> {
        let bend = if self.input.bends.is_some() { MAX_BEND } else { 0.0 };
        let limit = f64::from(MAX_COORDINATE - 2 * MAX_WIDTH as i32) - bend;
        for axis in 0..3 {
            let (p, v) = (self.input.position[axis][i], self.input.velocity[axis][i]);
            if !p.is_finite() {
                return Some((i, "the position must be finite", p));
            }
            if !v.is_finite() {
                return Some((i, "the velocity must be finite", v));
            }
            for time in self.shutter {
                let reached = (f64::from(p) + f64::from(v) * time) * self.inverse_voxel_size;
                if reached.is_nan() || reached.abs() >= limit {
                    return Some((i, "the position must be within four million voxels of the origin", p));
                }
            }
        }
        if let Some([acceleration, jerk]) = self.bends(i) {
            let time = self.shutter[0].abs().max(self.shutter[1].abs());
            let bend = time * time * (0.5 * acceleration.length() + time / 6.0 * jerk.length());
            let bend_voxels = bend * self.inverse_voxel_size;
            if bend_voxels.is_nan() || bend_voxels >= MAX_BEND {
                return Some((i, "the way must bend by less than a million voxels, not by these metres", bend as f32));
            }
        }
        if let Some(value) = self.carried(i).find(|value| !value.is_finite()) {
            return Some((i, "what it carries must be finite", value as f32));
        }
        let (mass, radius) = (self.input.mass[i], self.input.radius[i]);
        if !(mass >= 0.0 && mass.is_finite()) {
            return Some((i, "the mass must be finite and at least 0", mass));
        }
        if !(radius > 0.0 && f64::from(radius) * self.inverse_voxel_size <= MAX_RADIUS) {
            return Some((i, "the kernel radius must be greater than 0 and at most 128 voxels", radius));
        }
        None
    }

    /// How many particles.
    pub fn count(&self) -> usize {
        self.input.mass.len()
    }

    /// Whether particle `i` weighs anything.
    pub fn has_mass(&self, i: usize) -> bool {
        self.input.mass[i] > 0.0
    }

    /// Mass of particle `i` [density·m³].
    pub fn mass(&self, i: usize) -> f64 {
        f64::from(self.input.mass[i])
    }

    /// What particle `i` carries, quantity by quantity.
    #[inline(always)]
    pub fn carried(&self, i: usize) -> impl Iterator<Item = f64> {
        self.input.carried.iter().map(move |values| f64::from(values[i]))
    }

    /// How many quantities particles carry.
    pub fn quantity_count(&self) -> usize {
        self.input.carried.len()
    }

    /// Sum of the densities of the voxels that particle `i` makes.
    #[inline(always)]
    pub fn density(&self, i: usize) -> f64 {
        self.mass(i) * self.inverse_voxel_size.powi(3)
    }

    /// Kernel radius of particle `i` [voxels].
    #[inline(always)]
    pub fn radius(&self, i: usize) -> f64 {
        (f64::from(self.input.radius[i]) * self.inverse_voxel_size).max(MIN_RADIUS)
    }

    #[inline(always)]
    fn vector(components: &[&[f32]; 3], i: usize) -> DVec3 {
        DVec3::new(f64::from(components[0][i]), f64::from(components[1][i]), f64::from(components[2][i]))
    }

    /// Acceleration and its change of particle `i`, where its way bends.
    #[inline(always)]
    fn bends(&self, i: usize) -> Option<[DVec3; 2]> {
        let bends = self.input.bends.as_ref()?;
        Some([Self::vector(&bends[0], i), Self::vector(&bends[1], i)])
    }

    /// Velocity of particle `i` at a time of the shutter.
    #[inline(always)]
    fn velocity(&self, i: usize, time: f64) -> DVec3 {
        let velocity = Self::vector(&self.input.velocity, i);
        match self.bends(i) {
            Some([acceleration, jerk]) => velocity + (acceleration + jerk * (0.5 * time)) * time,
            None => velocity,
        }
    }

    /// Where particle `i` is at a time of the shutter [m].
    #[inline(always)]
    fn position(&self, i: usize, time: f64) -> DVec3 {
        let (position, velocity) = (Self::vector(&self.input.position, i), Self::vector(&self.input.velocity, i));
        match self.bends(i) {
            Some([acceleration, jerk]) => {
                position + (velocity + (acceleration * 0.5 + jerk * (time / 6.0)) * time) * time
            }
            None => position + velocity * time,
        }
    }

    /// Into how many pieces the streak of particle `i` is split, at least 1.
    #[inline(always)]
    pub fn piece_count(&self, i: usize) -> u32 {
        let [open, close] = self.shutter;
        let duration = (close - open).abs();
        if duration == 0.0 {
            return 1;
        }
        let speed = if self.input.bends.is_some() {
            // Between two times the speed may be higher than at both, by next to nothing where ways bend as little as these.
            [open, 0.5 * (open + close), close].into_iter().fold(0.0, |most, t| self.velocity(i, t).length().max(most))
        } else {
            self.velocity(i, 0.0).length()
        };
        let pieces = speed * duration * self.inverse_voxel_size / (0.5 * self.radius(i));
        // The ceiling, without the library call that the baseline processor would need.
        let whole = pieces.min(f64::from(MAX_PIECES)) as u32;
        (whole + u32::from(f64::from(whole) < pieces)).clamp(1, MAX_PIECES)
    }

    /// Centre of piece `k` of the `count` of particle `i`. Pieces are equal parts of the time, not of the way.
    #[inline(always)]
    fn center(&self, i: usize, k: u32, count: u32) -> DVec3 {
        let [open, close] = self.shutter;
        let time = open + (close - open) * (f64::from(k) + 0.5) / f64::from(count);
        self.position(i, time) * self.inverse_voxel_size - 0.5
    }

    /// Where particle `i` is at its instant.
    pub fn own_place(&self, i: usize) -> DVec3 {
        Self::vector(&self.input.position, i) * self.inverse_voxel_size - 0.5
    }

    /// Middle of the streak of particle `i`, which consists of `pieces`, and how far from there it reaches.
    pub fn middle(&self, i: usize, pieces: &[Piece]) -> (DVec3, f64) {
        let [open, close] = self.shutter;
        let middle = self.position(i, 0.5 * (open + close)) * self.inverse_voxel_size - 0.5;
        if self.input.bends.is_none() {
            let length = self.velocity(i, 0.0).length() * (close - open).abs();
            return (middle, 0.5 * length * self.inverse_voxel_size);
        }
        (middle, pieces.iter().map(|piece| piece.center.distance(middle)).fold(0.0, f64::max))
    }

    /// The centres of the pieces of particle `i`; none for one that weighs nothing.
    fn centers(&self, i: usize) -> impl Iterator<Item = DVec3> {
        let count = if self.has_mass(i) { self.piece_count(i) } else { 0 };
        (0..count).map(move |k| self.center(i, k, count))
    }

    /// First and last brick that any particle of a range reaches, and how many pairs of a piece and a brick there are.
    pub fn extent(&self, range: Range<usize>) -> Option<Extent> {
        let of_particle = |i: usize| {
            let radius = self.radius(i);
            let of_piece = |center: DVec3| {
                let (low, high) = brick_range(center, radius);
                Extent { low, high, pieces: 1, touches: (high - low + 1).as_u64vec3().element_product() }
            };
            self.centers(i).map(of_piece).reduce(Extent::union)
        };
        parallel::reduce(range.len(), |n| of_particle(range.start + n), Extent::union)
    }
}

/// First and last brick that a kernel of `radius` about `center` reaches.
#[inline(always)]
fn brick_range(center: DVec3, radius: f64) -> (IVec3, IVec3) {
    let (low, high) = reach(center, radius);
    (low >> 3, high >> 3)
}

/// The pieces of the particles of a batch: each is asked for by every brick that it reaches, and what it is made of lies in a dozen
/// arrays.
pub(crate) struct Pieces<'a> {
    streaks: &'a Streaks<'a>,
    /// Number of the first particle.
    first: usize,
    /// Where the pieces of each particle begin, and where those of the last one end.
    starts: Vec<u32>,
    pieces: Vec<Piece>,
}

/// One kernel of a streak: a line of the cache, since bricks find them in no order.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
pub(crate) struct Piece {
    /// Where it is [voxels].
    pub center: DVec3,
    /// Of the kernel [voxels].
    pub radius: f64,
    /// What its weights are multiplied by, so that they add up to the densities of the voxels that it makes.
    pub amount: f64,
    /// Distance of its centre to the nearest wall [voxels]; infinite where no wall is near, negative behind one.
    pub wall: f64,
    /// Particle, counted from the first of the batch.
    pub particle: u32,
}

const _: () = assert!(size_of::<Piece>() == 64);

/// Most memory of a piece in [`Pieces`] while they are collected [bytes].
pub(crate) const PIECE_BYTES: u64 = 2 * size_of::<Piece>() as u64;

impl<'a> Pieces<'a> {
    /// Those of the particles of `range`, far from walls.
    pub fn new(streaks: &'a Streaks<'a>, range: &Range<usize>) -> Self {
        let mut starts = parallel::map(range.len() + 1, |n| {
            let i = range.start + n;
            if n < range.len() && streaks.has_mass(i) { streaks.piece_count(i) } else { 0 }
        });
        let mut next = 0;
        for start in &mut starts {
            next += std::mem::replace(start, next);
        }
        let pieces = parallel::gather(range.len(), |n, pieces| {
            let (i, count) = (range.start + n, starts[n + 1] - starts[n]);
            let (radius, density) = (streaks.radius(i), streaks.density(i) / f64::from(count));
            pieces.extend((0..count).map(|k| {
                let center = streaks.center(i, k, count);
                let amount = density * normalisation(center, radius);
                Piece { center, radius, amount, wall: f64::INFINITY, particle: n as u32 }
            }));
        });
        Self { streaks, first: range.start, starts, pieces }
    }

    /// The particles themselves.
    pub fn streaks(&self) -> &'a Streaks<'a> {
        self.streaks
    }

    /// Numbers of the particles.
    pub fn range(&self) -> Range<usize> {
        self.first..self.first + self.starts.len() - 1
    }

    /// All of them, in the order of particles.
    #[inline(always)]
    pub fn all(&self) -> &[Piece] {
        &self.pieces
    }

    /// As [`Pieces::all`].
    pub fn all_mut(&mut self) -> &mut [Piece] {
        &mut self.pieces
    }

    /// Those of particle `i`; none of one that weighs nothing.
    pub fn of(&self, i: usize) -> &[Piece] {
        let n = i - self.first;
        &self.pieces[self.starts[n] as usize..self.starts[n + 1] as usize]
    }
}

impl Piece {
    /// Calls `visit` with each brick that it reaches.
    pub fn for_each_brick(&self, mut visit: impl FnMut(IVec3)) {
        let (low, high) = brick_range(self.center, self.radius);
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                for x in low.x..=high.x {
                    visit(IVec3::new(x, y, z));
                }
            }
        }
    }
}

/// Where some particles reach.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Extent {
    /// First brick along each axis.
    pub low: IVec3,
    /// Last brick along each axis.
    pub high: IVec3,
    /// Pieces of particles.
    pub pieces: u64,
    /// Pairs of a piece and a brick that it reaches.
    pub touches: u64,
}

impl Extent {
    pub fn union(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            pieces: self.pieces.saturating_add(other.pieces),
            touches: self.touches.saturating_add(other.touches),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_where_the_particle_goes_and_weigh_what_it_weighs() {
        let (position, velocity) = ([[0.3f32; 3], [0.7; 3], [-0.2; 3]], [[0.0f32, 100.0, 100.0], [-31.0; 3], [7.7; 3]]);
        let input = SplatInput {
            position: [&position[0], &position[1], &position[2]],
            velocity: [&velocity[0], &velocity[1], &velocity[2]],
            bends: None,
            mass: &[1.0, 0.0, 3.0],
            radius: &[2.5; 3],
            carried: &[],
            obstacles: None,
        };
        // Straight, and round a bend and back.
        let bends = [[&[-30.0f32; 3][..], &[90.0; 3], &[0.0; 3]], [&[-1900.0; 3], &[-20.0; 3], &[-70.0; 3]]];
        for input in [input, SplatInput { bends: Some(bends), ..input }] {
            let streaks = Streaks::try_new(&input, 1.0, [-0.5, 0.5], 0).unwrap();
            let pieces = Pieces::new(&streaks, &(0..3));
            assert_eq!([0, 1].map(|i| pieces.of(i).len() as u32), [streaks.piece_count(0), 0]);
            let of_last = pieces.of(2);
            assert!(of_last.len() >= 80);
            for pair in of_last.windows(2) {
                let step = pair[0].center.distance(pair[1].center);
                assert!(step > 0.0 && step <= 0.51 * pair[0].radius, "{step}");
            }
            let density: f64 = of_last.iter().map(|p| p.amount / normalisation(p.center, p.radius)).sum();
            assert!((density - 3.0).abs() < 1e-12);
            let mut touches = 0;
            pieces.all().iter().for_each(|piece| piece.for_each_brick(|_| touches += 1));
            let extent = streaks.extent(0..3).unwrap();
            assert_eq!((extent.pieces, extent.touches), (pieces.all().len() as u64, touches));
        }
    }
}
