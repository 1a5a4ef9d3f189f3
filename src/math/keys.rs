//! A value over time, given by keys: the one place that says what it is between them, before the first and after the last.

use crate::math::interpolate::cubic_step;
use glam::{DQuat, DVec3};

/// How a value gets from key to key.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// At constant speed, which jumps at keys.
    Linear,
    /// Faster in the middle, at rest at each key: a share `t` of the time is a share `t²(3 − 2t)` of the way.
    #[default]
    Ease,
    /// It stays what it was at the key before.
    Step,
}

/// What has something in between.
pub trait Between {
    /// The value at a share of the way from `self` to `to`, 0 to 1.
    fn between(&self, to: &Self, share: f64) -> Self;
}

/// A value over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Keys<T> {
    /// Times [s], rising, and values; at least one.
    keys: Vec<(f64, T)>,
    interpolation: Interpolation,
    /// Whether the course from the first key to the last goes on and on, backwards too; else the value stays what it is at the
    /// ends.
    repeats: bool,
}

impl<T: Between + Clone> Keys<T> {
    /// The value through `keys` of time [s] and value.
    ///
    /// # Panics
    /// Without keys, and where times do not rise.
    pub fn new(keys: Vec<(f64, T)>, interpolation: Interpolation, repeats: bool) -> Self {
        assert!(!keys.is_empty() && keys.windows(2).all(|k| k[0].0 < k[1].0), "keys must rise in time");
        Self { keys, interpolation, repeats }
    }

    /// The same at all times.
    pub fn constant(value: T) -> Self {
        Self { keys: vec![(0.0, value)], interpolation: Interpolation::Step, repeats: false }
    }

    /// Whether there is more than one key.
    pub fn varies(&self) -> bool {
        self.keys.len() > 1
    }

    /// Whether it jumps from a key to the next.
    pub fn jumps(&self) -> bool
    where
        T: PartialEq,
    {
        self.interpolation == Interpolation::Step && self.keys.windows(2).any(|pair| pair[0].1 != pair[1].1)
    }

    /// The value at the first key.
    pub fn first(&self) -> &T {
        &self.keys[0].1
    }

    /// The value at a time [s].
    pub fn at(&self, time: f64) -> T {
        let time = self.within(time);
        let next = self.keys.partition_point(|key| key.0 <= time);
        if next == 0 || next == self.keys.len() {
            return self.keys[next.saturating_sub(1)].1.clone();
        }
        let ((start, a), (end, b)) = (&self.keys[next - 1], &self.keys[next]);
        let share = (time - start) / (end - start);
        match self.interpolation {
            Interpolation::Linear => a.between(b, share),
            Interpolation::Ease => a.between(b, cubic_step(share)),
            Interpolation::Step => a.clone(),
        }
    }

    /// From when to when [s] the value may change: from the first key to the last, or always where the course goes on.
    pub fn course(&self) -> [f64; 2] {
        let [first, last] = self.ends();
        if self.repeats && last > first { [f64::NEG_INFINITY, f64::INFINITY] } else { [first, last] }
    }

    /// How long the way is that the value takes from `start` to a later `end` [s], there and back counted, where `length` says it of
    /// two keys that follow each other. Jumps have none.
    pub fn way(&self, start: f64, end: f64, length: impl Fn(&T, &T) -> f64) -> f64 {
        let [first, last] = self.ends();
        let from_to = |start: f64, end: f64| -> f64 {
            let next = self.keys.partition_point(|key| key.0 <= start);
            let met = self.keys[next.saturating_sub(1)..].windows(2).take_while(|pair| pair[0].0 < end);
            met.map(|pair| {
                let gone = |time: f64| {
                    let share = ((time - pair[0].0) / (pair[1].0 - pair[0].0)).clamp(0.0, 1.0);
                    match self.interpolation {
                        Interpolation::Linear => share,
                        Interpolation::Ease => cubic_step(share),
                        Interpolation::Step => 0.0,
                    }
                };
                length(&pair[0].1, &pair[1].1) * (gone(end) - gone(start))
            })
            .sum()
        };
        if !(self.repeats && last > first) {
            return from_to(start, end);
        }
        let ([start, start_round], [end, end_round]) = (self.round(start), self.round(end));
        if start_round == end_round {
            return from_to(start, end);
        }
        let whole = end_round - start_round - 1.0;
        from_to(start, last) + if whole > 0.0 { whole * from_to(first, last) } else { 0.0 } + from_to(first, end)
    }

    /// The speed [1/s] that the value never exceeds, where `length` says how long the way from a key to the next is. Jumps
    /// have none.
    pub fn fastest(&self, length: impl Fn(&T, &T) -> f64) -> f64 {
        let factor = match self.interpolation {
            Interpolation::Linear => 1.0,
            // Of t²(3 − 2t), in the middle.
            Interpolation::Ease => 1.5,
            Interpolation::Step => 0.0,
        };
        let speed = |pair: &[(f64, T)]| factor * length(&pair[0].1, &pair[1].1) / (pair[1].0 - pair[0].0);
        self.keys.windows(2).map(speed).fold(0.0, f64::max)
    }

    /// The time of the first round at which a course that repeats is the same.
    fn within(&self, time: f64) -> f64 {
        let [first, last] = self.ends();
        if self.repeats && last > first { self.round(time)[0] } else { time }
    }

    /// The time of the first round at which a course that repeats is the same [s], and the number of the round, from 0.
    fn round(&self, time: f64) -> [f64; 2] {
        let [first, last] = self.ends();
        let gone = (time - first).rem_euclid(last - first);
        // Of the remainder: a quotient near a whole number may be rounded to the other side.
        [first + gone, ((time - first - gone) / (last - first)).round()]
    }

    /// Times of the first key and the last [s].
    fn ends(&self) -> [f64; 2] {
        [self.keys[0].0, self.keys[self.keys.len() - 1].0]
    }
}

impl Between for f64 {
    fn between(&self, to: &Self, share: f64) -> Self {
        self * (1.0 - share) + to * share
    }
}

impl Between for DVec3 {
    fn between(&self, to: &Self, share: f64) -> Self {
        self.lerp(*to, share)
    }
}

/// A rotation that remembers how often it has gone round.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Turn {
    /// About an axis of length 1, by an angle of any size [rad].
    About(DVec3, f64),
    /// A quaternion of length 1.
    Quaternion(DQuat),
}

impl Turn {
    /// None at all.
    pub const NONE: Self = Self::Quaternion(DQuat::IDENTITY);

    /// The rotation.
    pub fn rotation(self) -> DQuat {
        match self {
            Self::About(axis, angle) => DQuat::from_axis_angle(axis, angle),
            Self::Quaternion(rotation) => rotation,
        }
    }

    /// How far it is to another [rad]: the angle of all that is [between](Between::between).
    pub fn way(&self, to: &Self) -> f64 {
        match self.angles(to) {
            Some((_, from, angle)) => (angle - from).abs(),
            None => self.rotation().angle_between(to.rotation()),
        }
    }

    /// The axis that both are about, and the angles [rad].
    fn angles(&self, to: &Self) -> Option<(DVec3, f64, f64)> {
        /// Least cosine of the angle between axes that count as the same.
        const SAME_AXIS: f64 = 1.0 - 1e-12;
        let (Self::About(a, from), Self::About(b, angle)) = (self, to) else { return None };
        // No turn has every axis.
        if *from == 0.0 || a.dot(*b) >= SAME_AXIS {
            return Some((*b, *from, *angle));
        }
        (*angle == 0.0).then_some((*a, *from, *angle))
    }
}

impl Between for Turn {
    /// At constant angular velocity. About one axis it turns by as much as the angles say, be it many times round; otherwise it
    /// takes the shorter way.
    fn between(&self, to: &Self, share: f64) -> Self {
        match self.angles(to) {
            Some((axis, from, angle)) => Self::About(axis, from.between(&angle, share)),
            None => Self::Quaternion(self.rotation().slerp(to.rotation(), share)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;
    use std::f64::consts::{PI, TAU};

    fn course(interpolation: Interpolation, repeats: bool) -> Keys<f64> {
        Keys::new(vec![(1.0, 0.0), (2.0, 1.0), (4.0, -1.0)], interpolation, repeats)
    }

    #[test]
    fn ways_add_up_as_the_value_goes() {
        let length = |a: &f64, b: &f64| (a - b).abs();
        for interpolation in [Interpolation::Linear, Interpolation::Ease] {
            for repeats in [false, true] {
                // Closed, so that a course that repeats does not jump.
                let keys = Keys::new(vec![(1.0, 0.0), (2.0, 1.0), (4.0, -1.0), (5.0, 0.0)], interpolation, repeats);
                for (start, end) in [(1.0, 5.0), (1.3, 1.4), (-8.5, 0.2), (0.0, 3.5), (3.9, 12.1), (6.0, 7.0)] {
                    const STEPS: i32 = 20_000;
                    let time = |i: i32| start + (end - start) * f64::from(i) / f64::from(STEPS);
                    let sum: f64 = (0..STEPS).map(|i| (keys.at(time(i)) - keys.at(time(i + 1))).abs()).sum();
                    let way = keys.way(start, end, length);
                    // A step over a turning point loses up to its own length.
                    assert!((way - sum).abs() < 5e-3, "{interpolation:?} {repeats} {start} {end}: {way} {sum}");
                }
            }
        }
        assert_eq!(course(Interpolation::Step, false).way(0.0, 9.0, length), 0.0);
        // A tenth of a second is a little more than its tenth part of one, and yet 1.0 / 0.1 is 10.
        let round = Keys::new(vec![(0.0, 0.0), (0.1, 6.0)], Interpolation::Linear, true);
        assert!((round.way(0.95, 1.0, length) - 3.0).abs() < 1e-12, "{}", round.way(0.95, 1.0, length));
        let (axis, quarter) = (DVec3::Y, Turn::Quaternion(DQuat::from_rotation_y(0.5 * PI)));
        assert!((Turn::About(axis, 1.0).way(&Turn::About(axis, 1.0 + 5.0 * TAU)) - 5.0 * TAU).abs() < 1e-12);
        assert!((Turn::About(axis, 3.5 * PI).way(&quarter) - PI).abs() < 1e-6);
    }

    #[test]
    fn a_way_asks_for_no_more_keys_than_it_meets() {
        let keys = |repeats| {
            let values = (0..=1000).map(|n| (f64::from(n), f64::from(n % 2)));
            Keys::new(values.collect(), Interpolation::Linear, repeats)
        };
        for (repeats, start, end, met) in [
            (false, 700.25, 702.5, 3),
            (false, -5.0, -1.0, 0),
            (false, 1000.0, 2000.0, 0),
            (true, 5700.25, 5702.5, 3),
            (true, 999.5, 1000.5, 2),
        ] {
            let asked = Cell::new(0);
            let length = |a: &f64, b: &f64| {
                asked.set(asked.get() + 1);
                (a - b).abs()
            };
            let way = keys(repeats).way(start, end, length);
            assert_eq!((way, asked.get()), (if met > 0 { end - start } else { 0.0 }, met), "{repeats} {start} {end}");
        }
    }

    #[test]
    fn no_way_is_longer_than_its_time_at_the_fastest() {
        let length = |a: &f64, b: &f64| (a - b).abs();
        for (interpolation, fastest) in
            [(Interpolation::Linear, 1.0), (Interpolation::Ease, 1.5), (Interpolation::Step, 0.0)]
        {
            for repeats in [false, true] {
                let keys = course(interpolation, repeats);
                assert_eq!(keys.fastest(length), fastest);
                // The middle between two keys, where eased courses are at their fastest.
                let share = keys.way(1.499, 1.501, length) / 0.002;
                assert!((share - fastest).abs() < 1e-5, "{interpolation:?}: {share}");
                for n in 0..400 {
                    let start = -3.0 + 0.03 * f64::from(n);
                    let way = keys.way(start, start + 0.7, length);
                    assert!(way <= 0.7 * fastest * (1.0 + 1e-12), "{interpolation:?} {repeats} {start}: {way}");
                }
                assert_eq!(keys.course() == [1.0, 4.0], !repeats);
            }
        }
    }

    #[test]
    fn keys_are_met_and_the_value_stays_outside_them() {
        for interpolation in [Interpolation::Linear, Interpolation::Ease, Interpolation::Step] {
            let keys = course(interpolation, false);
            for (time, value) in [(-3.0, 0.0), (1.0, 0.0), (2.0, 1.0), (4.0, -1.0), (9.0, -1.0)] {
                assert_eq!(keys.at(time), value, "{interpolation:?} {time}");
            }
        }
    }

    #[test]
    fn ways_between_keys_are_as_their_names_say() {
        let at = |interpolation, time| course(interpolation, false).at(time);
        assert_eq!(at(Interpolation::Linear, 1.25), 0.25);
        assert_eq!(at(Interpolation::Ease, 1.25), 0.0625 * 2.5);
        assert_eq!((at(Interpolation::Step, 1.999), at(Interpolation::Step, 3.999)), (0.0, 1.0));
        let slope = |time: f64| (at(Interpolation::Ease, time + 1e-6) - at(Interpolation::Ease, time - 1e-6)) / 2e-6;
        assert!(slope(2.0).abs() < 1e-5 && slope(1.5) > 1.4, "at rest at keys");
    }

    #[test]
    fn what_repeats_is_the_same_a_round_later_and_earlier() {
        let keys = course(Interpolation::Linear, true);
        for i in 0..60 {
            let time = 1.0 + 0.05 * f64::from(i);
            for rounds in [-2.0, -1.0, 1.0, 7.0] {
                assert!((keys.at(time) - keys.at(time + 3.0 * rounds)).abs() < 1e-12, "{time}");
            }
        }
        assert_eq!(keys.at(4.0), 0.0, "the last key is the first");
    }

    #[test]
    fn a_turn_goes_round_as_often_as_it_says_and_otherwise_the_shorter_way() {
        let axis = DVec3::new(0.0, 0.6, 0.8);
        let at = |from, to, share| Turn::between(&from, &to, share).rotation();
        let whole = at(Turn::NONE, Turn::About(axis, TAU), 0.25);
        assert!((whole.dot(DQuat::IDENTITY) - 1.0).abs() < 1e-12, "a quaternion knows no rounds");
        let whole = at(Turn::About(DVec3::X, 0.0), Turn::About(axis, 5.0 * TAU), 0.05);
        assert!((whole.dot(DQuat::from_axis_angle(axis, 0.25 * TAU)).abs() - 1.0).abs() < 1e-12);
        let shorter = at(Turn::About(DVec3::X, 0.2), Turn::About(DVec3::Y, 1.5 * PI), 1.0);
        assert!((shorter.dot(DQuat::from_axis_angle(DVec3::Y, -0.5 * PI)).abs() - 1.0).abs() < 1e-12);
        // At constant angular velocity: equal shares are equal angles.
        let (a, b) = (Turn::About(DVec3::X, 0.9), Turn::Quaternion(DQuat::from_axis_angle(DVec3::Y, 1.2)));
        let angles: Vec<f64> =
            (0..8).map(|i| at(a, b, f64::from(i) / 8.0).angle_between(at(a, b, f64::from(i + 1) / 8.0))).collect();
        assert!(angles.iter().all(|angle| (angle / angles[0] - 1.0).abs() < 1e-9), "{angles:?}");
    }
}
