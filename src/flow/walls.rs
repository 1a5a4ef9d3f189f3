//! The walls near a point: distances, and ramps that have reached 1 before the ridge between two obstacles.
//!
//! The ridge (medial axis) is where the closest obstacle changes and a ramp of the closest distance has a kink, hence
//! the velocity a jump. So the influence radius of obstacle i is d0, but smoothly at most `clearance − dᵢ`, where
//! clearance is a smooth minimum of the other obstacles' distances: at most the distance to the closest one. The ramp
//! is 1 wherever `2dᵢ ≥ clearance`, that is before the ridge; the regions where ramps are below 1 are disjoint, so
//! that the constraints compose. After Ding and Batty 2023, with smooth minima that vanish where their smaller argument
//! does.

use crate::flow::obstacles::Obstacle;
use crate::flow::ramp::{UnitNormal, Wall, ramp, smooth_min};
use crate::math::jet::Scalar;
use crate::math::real::{Lane, triple};

/// Obstacles do not notice each other beyond this many of the largest influence radius: far enough that up to that
/// radius the clearance, which fades out, still ends before the ridge.
pub const NOTICE: f64 = 4.0;
/// Places on the stack; more walls than this near one point go to the heap.
const INLINE: usize = 6;

/// One wall near a point.
#[derive(Debug, Clone, Copy)]
pub struct NearWall<L> {
    /// Which obstacle.
    pub obstacle_idx: usize,
    distance: Scalar<L>,
    normal: Option<UnitNormal<L>>,
    /// Clearance less distance, `None` where no other obstacle is near.
    room: Option<Scalar<L>>,
}

/// The walls near a point (or near any of a batch of points).
#[derive(Debug)]
pub struct NearWalls<L> {
    inline: [Option<NearWall<L>>; INLINE],
    spilled: Vec<NearWall<L>>,
}

impl<L: Lane> NearWalls<L> {
    /// Finds the walls whose distance at `p` is below `notice` [m] in any lane.
    #[inline(never)]
    pub fn find(obstacles: &[Obstacle], p: [L; 3], notice: f64) -> Self {
        p[0].outlined(
            #[inline(always)]
            || Self::find_here(obstacles, p, notice),
        )
    }

    #[inline(always)]
    fn find_here(obstacles: &[Obstacle], p: [L; 3], notice: f64) -> Self {
        let mut walls = Self { inline: [None; INLINE], spilled: Vec::new() };
        let mut count = 0;
        for (obstacle_idx, obstacle) in obstacles.iter().enumerate() {
            if !obstacle.may_be_within(p, notice) {
                continue;
            }
            let (distance, normal) = obstacle.wall(p);
            if !distance.value.any_lt(p[0].lit(notice)) {
                continue;
            }
            let wall = NearWall { obstacle_idx, distance, normal, room: None };
            if count < INLINE {
                walls.inline[count] = Some(wall);
            } else {
                walls.spilled.push(wall);
            }
            count += 1;
        }
        if count > 1 {
            for i in 0..count {
                let room = walls.room(i, count, notice);
                walls.at_mut(i).room = Some(room);
            }
        }
        walls
    }

    /// All of them.
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = &NearWall<L>> {
        self.inline.iter().flatten().chain(&self.spilled)
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

    /// Clearance less distance of wall `i`. Clearance is (Σ qⱼ²)^(−1/2) over the others with
    /// q = (1 − (d/notice)²)²/d, so that walls come and go without a jump.
    #[inline(always)]
    fn room(&self, i: usize, count: usize, notice: f64) -> Scalar<L> {
        let own = &self.at(i).distance;
        let (one, zero) = (own.value.lit(1.0), own.value.lit(0.0));
        let inverse_notice = one.lit(1.0 / notice);
        let mut sum = Scalar { value: one.lit((1e-3 / notice).powi(2)), gradient: [zero; 3] };
        for j in 0..count {
            if j == i {
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
    /// The wall as a potential of influence radius `influence` [m] meets it, or `None` where its ramp is 1 in all lanes.
    #[inline(always)]
    pub fn wall(&self, influence: f64) -> Option<Wall<L>> {
        let d = &self.distance;
        let one = d.value.lit(1.0);
        let d0 = one.lit(influence);
        let Some(room) = &self.room else {
            let r = d.value / d0;
            if !r.any_lt(one) {
                return None;
            }
            let (value, slope) = ramp(r);
            let factor = slope / d0;
            let gradient = triple!(i => d.gradient[i] * factor);
            return Some(Wall { alpha: Scalar { value, gradient }, normal: self.normal });
        };
        let (radius, _, by_room) = smooth_min(d0, room.value);
        // Where there is no room left the point is past the ridge, or inside another obstacle.
        let least = one.lit(influence * 1e-6);
        let inverse = one / radius.max(least);
        let r = radius.select_lt(least, one, (d.value * inverse).min(one));
        if !r.any_lt(one) {
            return None;
        }
        let (value, slope) = ramp(r);
        let factor = slope * inverse;
        let turn = r * by_room;
        let gradient = triple!(i => factor * (d.gradient[i] - turn * room.gradient[i]));
        Some(Wall { alpha: Scalar { value, gradient }, normal: self.normal })
    }
}
