//! Where straight steps of particles may end: outside of all obstacles, and on this side of thin ones.

use crate::flow::field::FieldSpan;
use crate::math::real::{Lane, dot, length, triple};
use glam::DVec3;

/// Sampled distances change by up to so many metres for each metre.
const STEEPEST: f64 = 1.2;
/// Particles are pushed this share of an obstacle's size beyond its wall.
const PUSH: f64 = 1e-4;

impl FieldSpan<'_> {
    /// Negative in lanes whose straight step from `from` at `phase` to `to` at the end of the span [m] may have ended
    /// inside an obstacle or passed through one; `None` where certainly none has.
    #[inline(never)]
    pub fn suspicion<L: Lane>(&self, from: [L; 3], phase: L, to: [L; 3]) -> Option<L> {
        phase.outlined(
            #[inline(always)]
            || self.suspicion_here(from, phase, to),
        )
    }

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn suspicion_here<L: Lane>(&self, from: [L; 3], phase: L, to: [L; 3]) -> Option<L> {
        let (zero, end) = (phase.lit(0.0), phase.lit(1.0));
        let way = length(triple!(i => to[i] - from[i])) * phase.lit(STEEPEST);
        let mut least = end;
        for i in 0..self.motions.len() {
            let (obstacle, motion) = (&self.field.obstacles[i], self.motions[i].as_ref());
            let coordinate = to[0].abs().max(to[1].abs()).max(to[2].abs());
            let rounding = coordinate.mul_add(phase.lit(2e-6), phase.lit(2e-5 * obstacle.size()));
            let reach = way + phase.lit(self.wall_travel(i)) + rounding;
            for solid_idx in 0..obstacle.solids().len() {
                if !obstacle.may_be_within(solid_idx, motion, to, end, reach) {
                    continue;
                }
                let after = obstacle.solid_distance(solid_idx, motion, to, end);
                least = least.min(after - rounding);
                // The empty balls round both ends hold the whole way.
                if !after.any_lt(reach)
                    || !(after + obstacle.solid_distance(solid_idx, motion, from, phase)).any_lt(reach)
                {
                    continue;
                }
                let before = obstacle.wall(solid_idx, motion, from, phase).0;
                let gradient = obstacle.wall(solid_idx, motion, to, end).0.gradient;
                // What comes out on the other side of a wall sees it the other way round.
                let facing = dot(before.gradient, gradient);
                least = least.min((before.value + after).select_lt(reach, facing, end));
            }
        }
        if least.any_lt(zero) { Some(least) } else { None }
    }

    /// At most how far any point of an obstacle moves over the span [m].
    #[inline(always)]
    fn wall_travel(&self, obstacle_idx: usize) -> f64 {
        match &self.motions[obstacle_idx] {
            Some(motion) => motion.travel(2.0 * self.field.obstacles[obstacle_idx].size()),
            None => 0.0,
        }
    }

    /// Where a straight step from `from` at `phase` to `to` at the end of the span [m] may end: outside of all obstacles
    /// and on this side of thin ones; and whether it had to be corrected.
    #[inline(never)]
    pub fn settled(&self, from: [f32; 3], to: [f32; 3], phase: f64) -> ([f32; 3], bool) {
        let (end, moved) = self.pushed_out(to, 1.0);
        match self.stopped(from, end, phase) {
            Some(stopped) => (self.pushed_out(stopped, 1.0).0, true),
            None => (end, moved),
        }
    }

    /// Where the end of the span finds what was stopped by a wall on the straight way between two points on opposite
    /// sides of it; `None` where no wall is between, or where the way begins inside.
    fn stopped(&self, from: [f32; 3], to: [f32; 3], phase: f64) -> Option<[f32; 3]> {
        /// Walls thinner than this share of the way may be missed.
        const FINEST: f64 = 1.0 / 64.0;
        let [a, b] = [from, to].map(|p| DVec3::from_array(p.map(f64::from)));
        let travel = (0..self.motions.len()).map(|i| self.wall_travel(i)).fold(0.0, f64::max);
        let way = STEEPEST * (b - a).length() + travel;
        let at = |t: f64| (a.lerp(b, t).to_array(), phase + t * (1.0 - phase));
        let distance = |t: f64| self.distance(at(t).0, at(t).1);
        let mut d = distance(0.0);
        if d < 0.0 || d + distance(1.0) > way {
            return None;
        }
        let mut t = 0.0;
        loop {
            let last = t;
            t += (d / way).max(FINEST);
            if t >= 1.0 {
                return None;
            }
            d = distance(t);
            if d >= 0.0 {
                continue;
            }
            let (obstacle_idx, solid_idx) = self.solid_between(at(t), from, to, phase)?;
            let (obstacle, motion) = (&self.field.obstacles[obstacle_idx], self.motions[obstacle_idx].as_ref());
            let (mut outside, mut inside) = (last, t);
            for _ in 0..24 {
                let middle = 0.5 * (outside + inside);
                let (p, phase) = at(middle);
                if obstacle.solid_distance(solid_idx, motion, p, phase) < 0.0 {
                    inside = middle;
                } else {
                    outside = middle;
                }
            }
            let (p, phase) = at(outside);
            // From there on with the wall.
            let end = motion.map_or(DVec3::from_array(p), |motion| {
                motion.from_rest(DVec3::from_array(motion.to_rest(p, phase).0), 1.0)
            });
            return Some(end.as_vec3().to_array());
        }
    }

    /// The solid that holds a point at a phase and sees `from` and `to` on opposite sides. The chord of a path round a
    /// convex wall is inside it too, and its ends are on the same side.
    fn solid_between(
        &self,
        (inside, at): ([f64; 3], f64),
        from: [f32; 3],
        to: [f32; 3],
        phase: f64,
    ) -> Option<(usize, usize)> {
        let obstacles = self.field.obstacles.iter().zip(&self.motions).enumerate();
        let solids =
            obstacles.flat_map(|(i, (o, motion))| (0..o.solids().len()).map(move |s| (i, s, o, motion.as_ref())));
        solids
            .filter(|(_, s, o, motion)| {
                let away = |p: [f32; 3], phase| o.wall(*s, *motion, p.map(f64::from), phase).0.gradient;
                o.solid_distance(*s, *motion, inside, at) < 0.0 && dot(away(from, phase), away(to, 1.0)) < 0.0
            })
            .map(|(i, s, ..)| (i, s))
            .next()
    }

    /// The point moved out of all obstacles if it is inside one, just beyond the wall, and whether it moved. A point that
    /// no number of corrections brings out stays where the last one left it.
    #[inline(never)]
    pub fn pushed_out(&self, p: [f32; 3], phase: f64) -> ([f32; 3], bool) {
        let is_outside = |p: [f32; 3]| self.distance(p.map(f64::from), phase) >= 0.0;
        if is_outside(p) {
            return (p, false);
        }
        let mut q = p.map(f64::from);
        for attempt in 0..32 {
            for (obstacle, motion) in self.field.obstacles.iter().zip(&self.motions) {
                let distance = obstacle.distance(motion.as_ref(), q, phase);
                if distance < 0.0 {
                    let g = obstacle.gradient(motion.as_ref(), q, phase);
                    // Far enough that the next steps' errors do not lead back in at once; farther at each attempt,
                    // for two walls may push against each other, and rounding to single precision may lead back.
                    let coordinate = q.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
                    let margin = f64::from(1u32 << attempt.min(16)) * (PUSH * obstacle.size() + 1e-7 * coordinate);
                    let direction = if g.length_squared() > 1e-12 { g / g.length_squared() } else { DVec3::Y };
                    q = (DVec3::from_array(q) + direction * (margin - distance)).to_array();
                }
            }
            let rounded = q.map(|x| x as f32);
            if is_outside(rounded) {
                return (rounded, true);
            }
        }
        (q.map(|x| x as f32), true)
    }
}
