//! The walls near a point: distances, and ramps that have reached 1 before the ridge between two obstacles.
//!
//! The ridge (medial axis) is where the closest obstacle changes and a ramp of the closest distance has a kink, hence
//! the velocity a jump. So the influence radius of obstacle i is d0, but smoothly at most `clearance − dᵢ`, where
//! clearance is a smooth minimum of the other obstacles' distances: at most the distance to the closest one. The ramp
//! is 1 wherever `2dᵢ ≥ clearance`, that is before the ridge; the regions where ramps are below 1 are disjoint, so
//! that the constraints compose. After Ding and Batty 2023, with smooth minima that vanish where their smaller argument
//! does.

use crate::flow::obstacles::{Boundary, Obstacle};
use crate::flow::ramp::{UnitNormal, WallRamp, flat_ramp, ramp, smooth_min};
use crate::geometry::motion::RigidSpan;
use crate::math::jet::Scalar;
use crate::math::real::{Lane, triple};

/// Obstacles do not notice each other beyond this many of the largest influence radius: far enough that up to that
/// radius the clearance, which fades out, still ends before the ridge.
pub const NOTICE: f64 = 4.0;
/// Places on the stack; more walls than this near one point go to the heap.
const INLINE: usize = 12;

/// One solid of an obstacle near a point.
#[derive(Debug, Clone, Copy)]
struct NearWall<L> {
    obstacle_idx: usize,
    is_ground: bool,
    distance: Scalar<L>,
    normal: Option<UnitNormal<L>>,
    boundary: Boundary,
    /// Clearance less distance, `None` where there is no other obstacle.
    room: Option<Scalar<L>>,
}

/// The walls near a point (or near any of a batch of points), those of an obstacle one after another.
#[derive(Debug)]
pub struct NearWalls<L> {
    inline: [Option<NearWall<L>>; INLINE],
    spilled: Vec<NearWall<L>>,
    count: usize,
}

/// An obstacle as a potential meets it.
#[derive(Debug, Clone, Copy)]
pub struct NearObstacle<L> {
    /// Which.
    pub obstacle_idx: usize,
    /// The ramps of its walls, multiplied.
    pub wall: WallRamp<L>,
    on_ground: Scalar<L>,
}

impl<L: Lane> NearWalls<L> {
    /// No walls.
    #[inline(always)]
    pub fn none() -> Self {
        Self { inline: [None; INLINE], spilled: Vec::new(), count: 0 }
    }

    /// Adds the walls whose distance at `p` is below `notice` [m] in any lane. `motions` has that of each obstacle, and
    /// `phase` says how far on it is. In place, for walls are kilobytes.
    #[inline(never)]
    pub fn find(&mut self, obstacles: &[Obstacle], motions: &[Option<RigidSpan>], p: [L; 3], phase: L, notice: f64) {
        p[0].outlined(
            #[inline(always)]
            || self.find_here(obstacles, motions, p, phase, notice),
        );
    }

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn find_here(&mut self, obstacles: &[Obstacle], motions: &[Option<RigidSpan>], p: [L; 3], phase: L, notice: f64) {
        for obstacle_idx in 0..obstacles.len() {
            let (obstacle, motion) = (&obstacles[obstacle_idx], motions[obstacle_idx].as_ref());
            let ground_idx = obstacle.ground().map(|ground| ground.solid_idx);
            for solid_idx in 0..obstacle.solids().len() {
                if !obstacle.may_be_within(solid_idx, motion, p, phase, p[0].lit(notice)) {
                    continue;
                }
                let (distance, normal) = obstacle.wall(solid_idx, motion, p, phase);
                if !distance.value.any_lt(p[0].lit(notice)) {
                    continue;
                }
                let (is_ground, boundary) = (ground_idx == Some(solid_idx), obstacle.boundary());
                self.push(NearWall { obstacle_idx, is_ground, distance, normal, boundary, room: None });
            }
        }
        // Not `count > 1`: which walls are near depends on the whole batch, and no lane may depend on its neighbours.
        if obstacles.len() > 1 {
            for i in 0..self.count {
                let room = self.room(i, notice);
                self.at_mut(i).room = Some(room);
            }
        }
    }

    /// The obstacle of the walls that begin with number `first`; `None` after the last.
    #[inline(always)]
    pub fn obstacle(&self, first: usize) -> Option<usize> {
        if first < self.count { Some(self.at(first).obstacle_idx) } else { None }
    }

    /// The obstacle of the walls that begin with number `first` as a potential of influence radius `influence` [m] meets
    /// it, or `None` where its ramp is 1 in all lanes; and the number of the first wall of the next obstacle.
    #[inline(always)]
    pub fn near_obstacle(&self, first: usize, influence: f64) -> (Option<NearObstacle<L>>, usize) {
        let start = self.at(first);
        let obstacle_idx = start.obstacle_idx;
        let one = start.distance.value.lit(1.0);
        let unbent = Scalar { value: one, gradient: [one.lit(0.0); 3] };
        // The ramps of all walls, and of all but the ground.
        let (mut alpha, mut on_ground) = (unbent, unbent);
        let (mut is_bent, mut next) = (false, first);
        while next < self.count && self.at(next).obstacle_idx == obstacle_idx {
            let wall = self.at(next);
            if let Some(own) = wall.ramp(influence) {
                alpha = if is_bent { alpha.times(&own) } else { own };
                is_bent = true;
                if !wall.is_ground {
                    on_ground = on_ground.times(&own);
                }
            }
            next += 1;
        }
        if !is_bent {
            return (None, next);
        }
        let wall = WallRamp { alpha, normal: start.tangential() };
        (Some(NearObstacle { obstacle_idx, wall, on_ground }), next)
    }

    #[inline(always)]
    fn push(&mut self, wall: NearWall<L>) {
        if self.count < INLINE {
            self.inline[self.count] = Some(wall);
        } else {
            self.spilled.push(wall);
        }
        self.count += 1;
    }

    #[inline(always)]
    fn at(&self, i: usize) -> &NearWall<L> {
        if i < INLINE { self.inline[i].as_ref().expect("filled up to the count") } else { &self.spilled[i - INLINE] }
    }

    #[inline(always)]
    fn at_mut(&mut self, i: usize) -> &mut NearWall<L> {
        if i < INLINE {
            self.inline[i].as_mut().expect("filled up to the count")
        } else {
            &mut self.spilled[i - INLINE]
        }
    }

    /// Clearance less distance of wall `i`. Clearance is (Σ qⱼ²)^(−1/2) over the walls of other obstacles with
    /// q = (1 − (d/notice)²)²/d, so that walls come and go without a jump.
    #[inline(always)]
    fn room(&self, i: usize, notice: f64) -> Scalar<L> {
        let (own, obstacle_idx) = (&self.at(i).distance, self.at(i).obstacle_idx);
        let (one, zero) = (own.value.lit(1.0), own.value.lit(0.0));
        let inverse_notice = one.lit(1.0 / notice);
        let mut sum = Scalar { value: one.lit((1e-3 / notice).powi(2)), gradient: [zero; 3] };
        for j in 0..self.count {
            if self.at(j).obstacle_idx == obstacle_idx {
                continue;
            }
            let other = &self.at(j).distance;
            let d = other.value.max(one.lit(1e-6 * notice));
            let x = d * inverse_notice;
            let fade = (one - x * x).max(zero);
            let inverse = one / d;
            let q = fade * fade * inverse;
            // dq/dd = −4 d fade/notice²/d − q/d.
            let slope = -(one.lit(4.0) * fade * inverse_notice * inverse_notice + q * inverse);
            let factor = one.lit(2.0) * q * slope;
            sum.value = q.mul_add(q, sum.value);
            for axis in 0..3 {
                sum.gradient[axis] = factor.mul_add(other.gradient[axis], sum.gradient[axis]);
            }
        }
        let clearance = one / sum.value.sqrt();
        let factor = one.lit(-0.5) * clearance / sum.value;
        Scalar {
            value: clearance - own.value,
            gradient: triple!(axis => factor.mul_add(sum.gradient[axis], -own.gradient[axis])),
        }
    }
}

impl<L: Lane> NearWall<L> {
    /// The ramp for a potential of influence radius `influence` [m], or `None` where it is 1 in all lanes.
    #[inline(always)]
    fn ramp(&self, influence: f64) -> Option<Scalar<L>> {
        let d = &self.distance;
        let one = d.value.lit(1.0);
        let d0 = one.lit(influence);
        let Some(room) = &self.room else {
            let r = d.value / d0;
            if !r.any_lt(one) {
                return None;
            }
            let (value, slope) = self.ramp_of(r);
            let factor = slope / d0;
            return Some(Scalar { value, gradient: triple!(i => d.gradient[i] * factor) });
        };
        let (radius, _, by_room) = smooth_min(d0, room.value);
        // Where there is no room left the point is past the ridge, or inside another obstacle.
        let least = one.lit(influence * 1e-6);
        let inverse = one / radius.max(least);
        let r = radius.select_lt(least, one, (d.value * inverse).min(one));
        if !r.any_lt(one) {
            return None;
        }
        let (value, slope) = self.ramp_of(r);
        let factor = slope * inverse;
        let turn = r * by_room;
        Some(Scalar { value, gradient: triple!(i => factor * (d.gradient[i] - turn * room.gradient[i])) })
    }

    /// The normal for equation 5. No slip needs the whole potential to go, and its first derivatives too.
    #[inline(always)]
    fn tangential(&self) -> Option<UnitNormal<L>> {
        if self.boundary == Boundary::Slip { self.normal } else { None }
    }

    #[inline(always)]
    fn ramp_of(&self, r: L) -> (L, L) {
        if self.boundary == Boundary::Slip { ramp(r) } else { flat_ramp(r) }
    }
}

impl<L: Lane> NearObstacle<L> {
    /// The ramps of all its walls but the ground, multiplied: 1 where the ground alone is near.
    #[inline(always)]
    pub fn on_ground(&self) -> &Scalar<L> {
        &self.on_ground
    }
}
