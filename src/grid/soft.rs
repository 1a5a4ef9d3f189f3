//! Soft particles: what obstacles leave of a kernel.
//!
//! Towards a wall the kernel fades by a quartic of the distance (the soft particles of *Noise-Based Particles*, 2011,
//! with the distance to the wall itself in place of the depth behind it), and where the particle cannot see, it puts
//! nothing. A distance alone cannot tell one side of a thin plate from the other, so sight is tested along the straight
//! line from the particle: by the two balls that are known to be empty where they cover it, by more such balls in the gaps elsewhere.
//!
//! All lengths here are in voxels, and places are relative to voxel centres, unless they say otherwise.

use crate::grid::{BRICK_EDGE, BRICK_VOXELS, local_voxel};
use glam::{DVec3, IVec3};

/// Voxels of a layer of a brick.
const LAYER: usize = BRICK_EDGE * BRICK_EDGE;
const _: () = assert!(LAYER == u64::BITS as usize);

/// What a kernel sees of a brick.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Seen {
    /// A bit for each voxel, a word for each layer.
    voxels: [u64; BRICK_EDGE],
    /// The weights of these voxels as walls leave them, added up.
    pub weight: f64,
}

/// The longest part of a line of sight without an empty ball or a place that is asked about [voxels]. A plate thicker than this is never
/// overlooked. Lines that run along a wall closer than half of it take the most questions.
pub const SIGHT_STEP: f64 = 1.0 / 12.0;
/// What a ball round a place outside of walls is taken for at least.
const LEAST_BALL: f64 = 0.5 * SIGHT_STEP;
/// The least share of a particle that is blown up to the whole. Of less, every voxel gets its weight over this much: a
/// particle that sees the corner of one voxel through a crack must not put all its mass there.
pub const SHARE_MIN: f64 = 1.0 / 64.0;

/// How deep in a wall a particle may seem to be that is on it, by the rounding of single precision [voxels].
const ROUNDING: f64 = 1.0 / 1024.0;

/// Where obstacles are.
pub trait ObstacleDistance: Sync + std::fmt::Debug {
    /// Sets `distances` to the signed distance [m] of each of `points` [m] to the nearest obstacle, negative inside;
    /// both slices have the same length. It is finite, at most the true distance outside, or thin walls may be overlooked,
    /// and a pure function of the point.
    fn distances(&self, points: &[DVec3], distances: &mut [f64]);
}

/// Where the mass of the particles has gone [density·m³].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SplatMass {
    /// Of all particles.
    pub particles: f64,
    /// In the grid, as its voxels add up: `particles − lost`, but for rounding.
    pub grid: f64,
    /// Taken away by walls, and then moved to what the particle still sees or lost.
    pub faded: f64,
    /// Lost because the particle sees nothing, or next to nothing, of its kernel. Part of `faded`.
    pub lost: f64,
}

/// Distances of the voxels of a brick.
pub(crate) type BrickDistances = [f32; BRICK_VOXELS];

/// The share of its weight that a kernel keeps at a distance from the wall of `t` times the soft radius: `1 − (1 − t)⁴`
/// from 0 on the wall and inside to 1 from t = 1 on, with three continuous derivatives there.
#[inline(always)]
pub fn fade(t: f64) -> f64 {
    let s = 1.0 - t.clamp(0.0, 1.0);
    1.0 - (s * s) * (s * s)
}

/// What a particle with the share `kept` of its mass multiplies its weights by.
pub(crate) fn gain(kept: f64) -> f64 {
    1.0 / kept.max(SHARE_MIN)
}

/// A place with its distance to the nearest wall.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sounding {
    pub place: DVec3,
    pub distance: f64,
}

/// The obstacles as the splatter sees them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sight<'a> {
    obstacles: &'a dyn ObstacleDistance,
    voxel_size: f64,
    inverse_voxel_size: f64,
    soft_radius: Option<f64>,
}

impl<'a> Sight<'a> {
    /// `soft_radius` [m] is where kernels begin to fade; their own radius where `None`.
    pub fn new(obstacles: &'a dyn ObstacleDistance, voxel_size: f64, soft_radius: Option<f64>) -> Self {
        let inverse_voxel_size = 1.0 / voxel_size;
        Self { obstacles, voxel_size, inverse_voxel_size, soft_radius: soft_radius.map(|r| r * inverse_voxel_size) }
    }

    /// The distance at which a kernel of `radius` begins to fade.
    #[inline(always)]
    pub fn soft_radius(&self, radius: f64) -> f64 {
        self.soft_radius.unwrap_or(radius)
    }

    /// As [`Sight::sound`] of a place that `distance` was found for and a particle is at: flows keep particles out of walls, but on
    /// a wall rounding decides on which side they are.
    pub fn sounding_of_particle(place: DVec3, distance: f64) -> Sounding {
        let is_on_wall = (-ROUNDING..0.0).contains(&distance);
        Sounding { place, distance: if is_on_wall { 0.0 } else { distance } }
    }

    /// The distances of many places at once.
    pub fn sound_all(&self, places: &[DVec3]) -> Vec<f64> {
        let points: Vec<DVec3> = places.iter().map(|&place| (place + 0.5) * self.voxel_size).collect();
        let mut distances = vec![0.0; places.len()];
        self.obstacles.distances(&points, &mut distances);
        distances.iter_mut().for_each(|d| *d *= self.inverse_voxel_size);
        distances
    }

    pub fn sound(&self, place: DVec3) -> Sounding {
        let mut distance = [0.0];
        self.obstacles.distances(&[(place + 0.5) * self.voxel_size], &mut distance);
        Sounding { place, distance: distance[0] * self.inverse_voxel_size }
    }

    /// The distance of every voxel of a brick.
    pub fn of_brick(&self, brick: IVec3) -> Box<BrickDistances> {
        let corner = brick * BRICK_EDGE as i32;
        let points: [DVec3; BRICK_VOXELS] =
            std::array::from_fn(|i| ((corner + local_voxel(i).as_ivec3()).as_dvec3() + 0.5) * self.voxel_size);
        let mut metres = [0.0; BRICK_VOXELS];
        self.obstacles.distances(&points, &mut metres);
        Box::new(metres.map(|d| (d * self.inverse_voxel_size) as f32))
    }

    /// True when no wall is between two places outside of walls; false when one of them is inside.
    #[inline]
    pub fn is_clear(&self, from: Sounding, to: Sounding) -> bool {
        if from.distance < 0.0 || to.distance < 0.0 {
            return false;
        }
        let length = from.place.distance(to.place);
        // The empty balls round both ends meet.
        length < from.distance + to.distance || self.is_clear_along(from, to, length)
    }

    #[inline(never)]
    fn is_clear_along(&self, from: Sounding, to: Sounding, length: f64) -> bool {
        let direction = (to.place - from.place) / length.max(f64::MIN_POSITIVE);
        let mut gaps = vec![Gap { start: from.distance.max(LEAST_BALL), end: length - to.distance, line: 0 }];
        while let Some(gap) = gaps.pop() {
            if gap.start < gap.end {
                let distance = self.sound(from.place + direction * gap.middle()).distance;
                if distance >= 0.0 {
                    gaps.extend(gap.without_ball(distance));
                } else {
                    return false;
                }
            }
        }
        true
    }
}

/// A part of a line of sight that no ball known to be empty covers.
#[derive(Debug, Clone, Copy)]
struct Gap {
    /// Where it begins and ends, distances along the line.
    start: f64,
    end: f64,
    /// Number of the line.
    line: u32,
}

impl Gap {
    /// Where to ask: what is in the way of a line between two places outside is most often in the middle, and an empty ball there
    /// covers it on both sides.
    #[inline(always)]
    fn middle(&self) -> f64 {
        0.5 * (self.start + self.end)
    }

    /// What is left of it on either side of a ball with this radius about its middle; ends before it begins where nothing is.
    #[inline(always)]
    fn without_ball(&self, radius: f64) -> [Self; 2] {
        let (middle, radius) = (self.middle(), radius.max(LEAST_BALL));
        [Self { end: middle - radius, ..*self }, Self { start: middle + radius, ..*self }]
    }
}

/// Lines of sight to voxels of a brick that are not known to be clear yet. They are followed side by side, since obstacles answer for
/// many points at once in little more than the time for one.
#[derive(Debug, Default)]
pub(crate) struct Lines {
    lines: Vec<Line>,
    /// What is yet to be asked about.
    gaps: Vec<Gap>,
    asked: Vec<Gap>,
    points: Vec<DVec3>,
    metres: Vec<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Line {
    from: DVec3,
    direction: DVec3,
    is_clear: bool,
    /// The voxel, its weight as walls leave it, and to which of the kernels it belongs.
    number: usize,
    weight: f64,
    slot: usize,
}

impl Lines {
    /// How many.
    pub fn len(&self) -> usize {
        self.lines.len()
    }

    /// Adds the lines from a place outside of walls to the voxels of row `n` (y + 8·z) of the brick whose first voxel is `corner`, where
    /// `weights`, faded as walls leave them, are not 0; `distances` are those of the row. Lines that are seen to be clear at once
    /// are noted in `seen` instead, of the kernel of number `slot`, and their weights added to `sums`.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    #[allow(clippy::too_many_arguments, reason = "a row of a kernel of a brick")]
    pub fn add_row(
        &mut self,
        from: Sounding,
        corner: DVec3,
        n: usize,
        weights: &[f64; BRICK_EDGE],
        distances: &[f32; BRICK_EDGE],
        slot: usize,
        seen: &mut Seen,
        sums: &mut [f64; BRICK_EDGE],
    ) {
        let first = corner + DVec3::new(0.0, (n % BRICK_EDGE) as f64, (n / BRICK_EDGE) as f64) - from.place;
        let across = first.y * first.y + first.z * first.z;
        let (mut clear, mut unsure) = (0u64, 0u64);
        for x in 0..BRICK_EDGE {
            let dx = first.x + x as f64;
            let reach = from.distance + f64::from(distances[x]);
            // On walls and in them nothing is left of a weight.
            let is_asked = weights[x] > 0.0;
            // The empty balls round both ends meet.
            let is_clear = dx * dx + across < reach * reach;
            sums[x] += if is_clear { weights[x] } else { 0.0 };
            clear |= u64::from(is_asked & is_clear) << x;
            unsure |= u64::from(is_asked & !is_clear) << x;
        }
        seen.voxels[n / BRICK_EDGE] |= clear << (BRICK_EDGE * (n % BRICK_EDGE));
        while unsure != 0 {
            let x = unsure.trailing_zeros() as usize;
            unsure &= unsure - 1;
            let step = first + DVec3::new(x as f64, 0.0, 0.0);
            let length = step.length();
            let (start, end) = (from.distance.max(LEAST_BALL), length - f64::from(distances[x]));
            self.gaps.push(Gap { start, end, line: self.lines.len() as u32 });
            self.lines.push(Line {
                from: from.place,
                direction: step / length.max(f64::MIN_POSITIVE),
                is_clear: true,
                number: n * BRICK_EDGE + x,
                weight: weights[x],
                slot,
            });
        }
    }
}

impl Sight<'_> {
    /// Follows all lines to their ends and notes those that get there in `seen`: as [`Sight::is_clear`] of each.
    pub fn follow(&self, lines: &mut Lines, seen: &mut [Seen]) {
        /// Gaps that are asked about together: enough to fill lanes, few enough to stay in the cache. The last ones come first, so
        /// that a line along a wall never has many.
        const TOGETHER: usize = 1024;
        let Lines { lines, gaps, asked, points, metres } = lines;
        loop {
            asked.clear();
            while asked.len() < TOGETHER
                && let Some(gap) = gaps.pop()
            {
                if gap.start < gap.end && lines[gap.line as usize].is_clear {
                    asked.push(gap);
                }
            }
            if asked.is_empty() {
                break;
            }
            points.clear();
            points.extend(asked.iter().map(|gap| {
                let line = &lines[gap.line as usize];
                (line.from + line.direction * gap.middle() + 0.5) * self.voxel_size
            }));
            metres.resize(points.len(), 0.0);
            self.obstacles.distances(points, metres);
            for (gap, &metres) in asked.iter().zip(&*metres) {
                if metres >= 0.0 {
                    gaps.extend(gap.without_ball(metres * self.inverse_voxel_size));
                } else {
                    lines[gap.line as usize].is_clear = false;
                }
            }
        }
        for line in lines.drain(..).filter(|line| line.is_clear) {
            let seen = &mut seen[line.slot];
            seen.voxels[line.number / LAYER] |= 1 << (line.number % LAYER);
            seen.weight += line.weight;
        }
    }
}

impl Seen {
    /// `weights` of the voxels of row `n` that are seen; 0 of others.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    pub fn of_row(&self, n: usize, weights: &[f64; BRICK_EDGE]) -> [f64; BRICK_EDGE] {
        let bits = self.voxels[n / BRICK_EDGE] >> (BRICK_EDGE * (n % BRICK_EDGE));
        let mut left = [0.0; BRICK_EDGE];
        for x in 0..BRICK_EDGE {
            left[x] = if bits >> x & 1 == 1 { weights[x] } else { 0.0 };
        }
        left
    }
}

/// `weights` of a row of voxels as walls leave them.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
pub(crate) fn faded_row(
    weights: &[f64; BRICK_EDGE],
    distances: &[f32; BRICK_EDGE],
    inverse_soft: f64,
) -> [f64; BRICK_EDGE] {
    let mut left = [0.0; BRICK_EDGE];
    for x in 0..BRICK_EDGE {
        left[x] = weights[x] * fade(f64::from(distances[x]) * inverse_soft);
    }
    left
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An endless plate across x between two places [m].
    #[derive(Debug)]
    struct Plate(f64, f64);

    impl ObstacleDistance for Plate {
        fn distances(&self, points: &[DVec3], distances: &mut [f64]) {
            for (p, d) in points.iter().zip(distances) {
                *d = (self.0 - p.x).max(p.x - self.1);
            }
        }
    }

    #[test]
    fn fading_is_smooth_and_monotone_from_nothing_to_all() {
        assert_eq!((fade(-1.0), fade(0.0), fade(1.0), fade(7.0)), (0.0, 0.0, 1.0, 1.0));
        assert_eq!(fade(f64::INFINITY), 1.0);
        let steps: Vec<f64> = (0..=100).map(|i| fade(f64::from(i) / 100.0)).collect();
        assert!(steps.windows(2).all(|w| w[0] < w[1]));
        assert!((fade(1.0) - fade(1.0 - 1e-3)).abs() < 1e-11, "the slope at the far end is 0");
    }

    #[test]
    fn no_line_of_sight_goes_through_a_plate() {
        for thickness in [1.01 * SIGHT_STEP, 0.1, 3.0] {
            let plate = Plate(0.5, 0.5 + 0.02 * thickness);
            let sight = Sight::new(&plate, 0.02, None);
            for i in 0..2000 {
                let t = f64::from(i);
                let near = DVec3::new(24.5 - 6.0 * (t * 0.618).fract(), (t * 0.37).sin() * 9.0, (t * 0.71).cos() * 9.0);
                let mut far = DVec3::new(24.5 + thickness + 6.0 * (t * 0.414).fract(), 0.0, (t * 0.13).sin() * 9.0);
                let [a, b] = [near, far].map(|p| sight.sound(p));
                assert!(!sight.is_clear(a, b) && !sight.is_clear(b, a), "{near} {far}");
                far.x = 24.5 - 1e-3 - (t * 0.414).fract();
                assert!(sight.is_clear(a, sight.sound(far)), "{near} {far}");
            }
        }
    }

    #[test]
    fn lines_followed_together_reach_what_each_reaches_alone() {
        let mut found = [0, 0];
        for (thickness, shift) in [(0.3, 0.0), (1.0, 2.2), (2.0, 5.0)] {
            let plate = Plate(0.02 * shift, 0.02 * (shift + thickness));
            let sight = Sight::new(&plate, 0.02, None);
            let (brick, mut lines) = (IVec3::ZERO, Lines::default());
            let distances = sight.of_brick(brick);
            let (rows, _) = distances.as_chunks::<BRICK_EDGE>();
            for i in 0..200 {
                let t = f64::from(i);
                let place = DVec3::new((t * 0.618).fract() * 9.0 - 1.0, (t * 0.37).sin() * 9.0, (t * 0.71).cos() * 9.0);
                let from = sight.sound(place);
                let (mut seen, mut sums) = ([Seen::default()], [0.0; BRICK_EDGE]);
                if from.distance >= 0.0 {
                    for (n, row) in rows.iter().enumerate() {
                        let weights = row.map(|distance| if distance > 0.0 { 1.0 } else { 0.0 });
                        lines.add_row(from, DVec3::ZERO, n, &weights, row, 0, &mut seen[0], &mut sums);
                    }
                    sight.follow(&mut lines, &mut seen);
                }
                let weight = seen[0].weight + sums.iter().sum::<f64>();
                let count: u32 = seen[0].voxels.iter().map(|layer| layer.count_ones()).sum();
                assert_eq!(weight, f64::from(count));
                for (number, &distance) in distances.iter().enumerate() {
                    let to = Sounding { place: local_voxel(number).as_dvec3(), distance: f64::from(distance) };
                    let is_clear = from.distance >= 0.0 && distance > 0.0 && sight.is_clear(from, to);
                    assert_eq!(
                        seen[0].voxels[number / LAYER] >> (number % LAYER) & 1 == 1,
                        is_clear,
                        "{place} to {number}"
                    );
                    found[usize::from(is_clear)] += 1;
                }
            }
        }
        assert!(found.iter().all(|&n| n > 10_000), "{found:?}");
    }

    #[test]
    fn gaps_close_whatever_the_distance_found() {
        let gap = Gap { start: 3.0, end: 40.0, line: 0 };
        for distance in [f64::INFINITY, 18.5, 7.0, 0.0, f64::NAN] {
            let [before, after] = gap.without_ball(distance);
            let left = (before.end - before.start).max(0.0) + (after.end - after.start).max(0.0);
            let ball = if distance.is_nan() { LEAST_BALL } else { distance.max(LEAST_BALL) };
            assert_eq!(left, (37.0 - 2.0 * ball).max(0.0));
        }
    }

    #[test]
    fn a_line_along_a_wall_asks_no_more_than_its_length_needs() {
        #[derive(Debug)]
        struct Floor(std::sync::atomic::AtomicUsize);
        impl ObstacleDistance for Floor {
            fn distances(&self, points: &[DVec3], distances: &mut [f64]) {
                self.0.fetch_add(points.len(), std::sync::atomic::Ordering::Relaxed);
                points.iter().zip(distances).for_each(|(p, d)| *d = p.y);
            }
        }
        let floor = Floor(0.into());
        let sight = Sight::new(&floor, 1.0, None);
        // 1/50 of a voxel above it, a hundred voxels long.
        let at = |x: f64| Sounding { place: DVec3::new(x, 0.02 - 0.5, 0.0), distance: 0.02 };
        assert!(sight.is_clear(at(0.0), at(100.0)));
        let asked = floor.0.load(std::sync::atomic::Ordering::Relaxed);
        assert!((1200..=2500).contains(&asked), "{asked}");
    }

    #[test]
    fn a_brick_has_the_distances_of_its_voxels() {
        let plate = Plate(0.1, 0.3);
        let sight = Sight::new(&plate, 0.05, None);
        let brick = IVec3::new(-1, 2, 0);
        let distances = sight.of_brick(brick);
        for (i, &d) in distances.iter().enumerate() {
            let voxel = (brick * 8 + local_voxel(i).as_ivec3()).as_dvec3();
            assert!((f64::from(d) - sight.sound(voxel).distance).abs() < 1e-5);
        }
    }
}
