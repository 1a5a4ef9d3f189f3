//! Rigid motion over time, and over a short span of it.

use crate::math::keys::{Between, Interpolation, Keys, Turn};
use crate::math::real::{Lane, Real, cross, dot, triple};
use glam::{DMat3, DQuat, DVec3};

/// Over this time velocities at an instant are taken [s].
const INSTANT: f64 = 1e-5;

/// Where a body is at a time, relative to where it rests: turned about its own middle, then moved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// How far the middle has moved [m].
    pub displacement: DVec3,
    /// How far the body has turned about its middle.
    pub rotation: DQuat,
}

/// Where a space is in another: scaled, then turned, then moved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Factor on lengths, > 0.
    pub scale: f64,
    /// Applied after the scale.
    pub rotation: DQuat,
    /// Applied last [m].
    pub translation: DVec3,
}

/// A placement over time. Where its keys are linear, between them the space moves at constant velocity and turns at constant
/// angular velocity: along geodesics of the group of rigid motions, taken as the product of translations and rotations.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Applied last [m].
    pub translation: Keys<DVec3>,
    /// Applied after the scale.
    pub turn: Keys<Turn>,
    /// Factor on lengths, > 0.
    pub scale: Keys<f64>,
}

/// The course of a body.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion(Course);

#[derive(Debug, Clone, PartialEq)]
enum Course {
    /// By poses.
    Poses(Keys<Pose>),
    /// By the spaces that it is in, the outermost first. It rests at `rest`, and its middle there is `pivot` [m].
    Links { links: Vec<Link>, rest: Placement, pivot: DVec3 },
}

impl Pose {
    /// At rest.
    pub const REST: Self = Self { displacement: DVec3::ZERO, rotation: DQuat::IDENTITY };
}

impl Between for Pose {
    fn between(&self, to: &Self, share: f64) -> Self {
        Self {
            displacement: self.displacement.lerp(to.displacement, share),
            rotation: self.rotation.slerp(to.rotation, share),
        }
    }
}

impl Placement {
    /// The same space.
    pub const IDENTITY: Self = Self { scale: 1.0, rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// Where a point is [m].
    pub fn point(&self, p: DVec3) -> DVec3 {
        self.rotation * (self.scale * p) + self.translation
    }

    /// This one first, then `outer`.
    pub fn within(&self, outer: &Self) -> Self {
        Self {
            scale: self.scale * outer.scale,
            rotation: (outer.rotation * self.rotation).normalize(),
            translation: outer.point(self.translation),
        }
    }

    /// The way back.
    pub fn inverse(&self) -> Self {
        let (scale, rotation) = (1.0 / self.scale, self.rotation.inverse());
        Self { scale, rotation, translation: rotation * (-scale * self.translation) }
    }
}

impl Link {
    /// Where the space is at its first keys.
    pub fn first(&self) -> Placement {
        let rotation = self.turn.first().rotation();
        Placement { scale: *self.scale.first(), rotation, translation: *self.translation.first() }
    }

    /// Where the space is at a time [s].
    pub fn at(&self, time: f64) -> Placement {
        let rotation = self.turn.at(time).rotation();
        Placement { scale: self.scale.at(time), rotation, translation: self.translation.at(time) }
    }
}

fn placement_at(links: &[Link], time: f64) -> Placement {
    links.iter().rev().fold(Placement::IDENTITY, |inner, link| inner.within(&link.at(time)))
}

impl Motion {
    /// The motion through `keys` of time [s] and pose; the body rests at each key where it `is_smooth`.
    ///
    /// # Panics
    /// Without keys, or where times do not rise.
    pub fn new(keys: Vec<(f64, Pose)>, is_smooth: bool) -> Self {
        Self::through(Keys::new(keys, if is_smooth { Interpolation::Ease } else { Interpolation::Linear }, false))
    }

    /// The motion through poses.
    pub fn through(poses: Keys<Pose>) -> Self {
        Self(Course::Poses(poses))
    }

    /// The motion of a body that is in all of `links`, the outermost first. It rests where it is at the first of all keys, and
    /// there its middle is `pivot` [m].
    pub fn of_links(links: Vec<Link>, pivot: DVec3) -> Self {
        let rest = links.iter().rev().fold(Placement::IDENTITY, |inner, link| inner.within(&link.first()));
        Self(Course::Links { links, rest, pivot })
    }

    /// The pose at a time [s].
    pub fn pose(&self, time: f64) -> Pose {
        match &self.0 {
            Course::Poses(keys) => keys.at(time),
            Course::Links { rest, pivot, links } => {
                let moved = rest.inverse().within(&placement_at(links, time));
                Pose { displacement: moved.point(*pivot) - *pivot, rotation: moved.rotation }
            }
        }
    }

    /// How much larger than at rest it is at a time [s].
    pub fn scale(&self, time: f64) -> f64 {
        match &self.0 {
            Course::Poses(_) => 1.0,
            Course::Links { links, rest, .. } => placement_at(links, time).scale / rest.scale,
        }
    }

    /// What takes the body from where it rests to where it is at a time [s]; `pivot` is its middle where it rests [m].
    pub fn placement(&self, pivot: DVec3, time: f64) -> Placement {
        let (pose, scale) = (self.pose(time), self.scale(time));
        let translation = pivot + pose.displacement - pose.rotation * (scale * pivot);
        Placement { scale, rotation: pose.rotation, translation }
    }

    /// How far the body turns from `start` to `end` [s], there and back counted; in spaces that turn in each other, at most so
    /// far [rad]. A [span](Motion::span) takes the shorter way, and so knows no more than half a turn.
    pub fn turning(&self, start: f64, end: f64) -> f64 {
        match &self.0 {
            Course::Poses(keys) => keys.way(start, end, |a, b| a.rotation.angle_between(b.rotation)),
            Course::Links { links, .. } => links.iter().map(|link| link.turn.way(start, end, Turn::way)).sum(),
        }
    }

    /// The angular velocity that no [turning](Motion::turning) exceeds [rad/s].
    pub fn fastest_turning(&self) -> f64 {
        match &self.0 {
            Course::Poses(keys) => keys.fastest(|a, b| a.rotation.angle_between(b.rotation)),
            Course::Links { links, .. } => links.iter().map(|link| link.turn.fastest(Turn::way)).sum(),
        }
    }

    /// From when to when [s] the body may turn.
    pub fn turning_course(&self) -> [f64; 2] {
        match &self.0 {
            Course::Poses(keys) => keys.course(),
            Course::Links { links, .. } => {
                let courses = links.iter().map(|link| link.turn.course());
                courses.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], [c, d]| [a.min(c), b.max(d)])
            }
        }
    }

    /// The motion from `start` [s] on for `duration` [s], of a body whose middle rests at `center`. A span without
    /// duration has the velocity at its instant.
    pub fn span(&self, center: DVec3, start: f64, duration: f64) -> RigidSpan {
        let soon = if duration > 0.0 { duration } else { INSTANT };
        let span = RigidSpan::between(center, self.pose(start), self.pose(start + soon), soon);
        if duration > 0.0 { span } else { RigidSpan { displacement: DVec3::ZERO, angle: 0.0, ..span } }
    }
}

/// A rigid motion over a span of time at constant velocity and constant angular velocity, from one pose to another.
#[derive(Debug, Clone, Copy)]
pub struct RigidSpan {
    center: DVec3,
    start: Pose,
    /// Of the middle over the span [m].
    displacement: DVec3,
    axis: DVec3,
    /// Over the span [rad], at most π.
    angle: f64,
    /// Of the middle [m/s].
    velocity: DVec3,
    /// [rad/s].
    angular_velocity: DVec3,
}

/// A rotation that may differ from lane to lane: rows of its matrix.
pub type Rotation<L> = [[L; 3]; 3];

impl RigidSpan {
    /// From `start` to `end` in `duration` [s].
    fn between(center: DVec3, start: Pose, end: Pose, duration: f64) -> Self {
        let mut turn = end.rotation * start.rotation.inverse();
        if turn.w < 0.0 {
            turn = -turn;
        }
        let (axis, angle) = turn.normalize().to_axis_angle();
        let displacement = end.displacement - start.displacement;
        let (velocity, angular_velocity) = (displacement / duration, axis * (angle / duration));
        Self { center, start, displacement, axis, angle, velocity, angular_velocity }
    }

    /// The middle at `phase` of the span, 0 to 1 [m].
    #[inline(always)]
    pub fn center<L: Real>(&self, phase: L) -> [L; 3] {
        let start = self.center + self.start.displacement;
        triple!(i => phase.mul_add(phase.lit(self.displacement[i]), phase.lit(start[i])))
    }

    /// At most how far any point of the body within `radius` [m] of its middle moves over the span [m].
    pub fn travel(&self, radius: f64) -> f64 {
        self.displacement.length() + self.angle * radius
    }

    /// Angular velocity [rad/s].
    pub fn angular_velocity(&self) -> DVec3 {
        self.angular_velocity
    }

    /// Velocity of the middle [m/s].
    pub fn velocity(&self) -> DVec3 {
        self.velocity
    }

    /// How far the body has turned from rest at `phase`.
    #[inline(always)]
    pub fn rotation<L: Real>(&self, phase: L) -> Rotation<L> {
        let start = DMat3::from_quat(self.start.rotation);
        let (sin, cos) = sin_cos(phase * phase.lit(self.angle));
        let rest = phase.lit(1.0) - cos;
        let k = triple!(i => phase.lit(self.axis[i]));
        // Rodrigues' formula.
        let turn: Rotation<L> = [
            [cos + rest * k[0] * k[0], rest * k[0] * k[1] - sin * k[2], rest * k[0] * k[2] + sin * k[1]],
            [rest * k[1] * k[0] + sin * k[2], cos + rest * k[1] * k[1], rest * k[1] * k[2] - sin * k[0]],
            [rest * k[2] * k[0] - sin * k[1], rest * k[2] * k[1] + sin * k[0], cos + rest * k[2] * k[2]],
        ];
        triple!(i => triple!(j => dot(turn[i], triple!(m => phase.lit(start.col(j)[m])))))
    }

    /// Where a point would be, had the body not moved from where it rests, and how the body has turned.
    #[inline(always)]
    pub fn to_rest<L: Lane>(&self, p: [L; 3], phase: L) -> ([L; 3], Rotation<L>) {
        let m = self.rotation(phase);
        let center = self.center(phase);
        let v = triple!(i => p[i] - center[i]);
        let rest = triple!(i => {
            p[0].lit(self.center[i]) + dot([m[0][i], m[1][i], m[2][i]], v)
        });
        (rest, m)
    }

    /// Where a point of the body at rest is at `phase`: the inverse of [`RigidSpan::to_rest`].
    pub fn from_rest(&self, p: DVec3, phase: f64) -> DVec3 {
        let m = self.rotation(phase);
        let turned = triple!(i => DVec3::from_array(m[i]).dot(p - self.center));
        DVec3::from_array(self.center(phase)) + DVec3::from_array(turned)
    }

    /// Velocity of the body's material at `p` [m/s].
    #[inline(always)]
    pub fn velocity_at<L: Real>(&self, p: [L; 3], phase: L) -> [L; 3] {
        let (v, w) = (self.velocity, self.angular_velocity);
        let center = self.center(phase);
        let turning = cross(triple!(i => phase.lit(w[i])), triple!(i => p[i] - center[i]));
        triple!(i => phase.lit(v[i]) + turning[i])
    }
}

/// The derivatives `[c][i]` of a vector field that is turned with its body, from those at rest.
#[inline(always)]
pub fn turned_derivatives<L: Real>(rest: &[[L; 3]; 3], m: &Rotation<L>) -> [[L; 3]; 3] {
    // Mᵀ on the right: how the field changes along the axes of the world.
    let along: [[L; 3]; 3] = triple!(c => triple!(i => dot(rest[c], m[i])));
    triple!(c => triple!(i => dot(m[c], [along[0][i], along[1][i], along[2][i]])))
}

/// Sine and cosine of |x| ≤ π: Taylor polynomials of half the angle, absolute error below 4e-9, doubled.
#[inline(always)]
fn sin_cos<L: Real>(x: L) -> (L, L) {
    let h = x * x.lit(0.5);
    let s = h * h;
    let sin = s
        .mul_add(x.lit(1.0 / 6_227_020_800.0), x.lit(-1.0 / 39_916_800.0))
        .mul_add(s, x.lit(1.0 / 362_880.0))
        .mul_add(s, x.lit(-1.0 / 5040.0))
        .mul_add(s, x.lit(1.0 / 120.0))
        .mul_add(s, x.lit(-1.0 / 6.0))
        .mul_add(s, x.lit(1.0))
        * h;
    let cos = s
        .mul_add(x.lit(-1.0 / 87_178_291_200.0), x.lit(1.0 / 479_001_600.0))
        .mul_add(s, x.lit(-1.0 / 3_628_800.0))
        .mul_add(s, x.lit(1.0 / 40_320.0))
        .mul_add(s, x.lit(-1.0 / 720.0))
        .mul_add(s, x.lit(1.0 / 24.0))
        .mul_add(s, x.lit(-0.5))
        .mul_add(s, x.lit(1.0));
    (sin * cos * x.lit(2.0), cos * cos - sin * sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(is_smooth: bool) -> Motion {
        let pose = |x: f64, turn: f64| Pose {
            displacement: DVec3::new(x, 0.3 * x, 0.0),
            rotation: DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -1.0).normalize(), turn),
        };
        Motion::new(vec![(0.0, pose(0.0, 0.0)), (1.0, pose(1.0, 2.0)), (3.0, pose(-1.0, 3.5))], is_smooth)
    }

    #[test]
    fn sines_are_sines() {
        for i in -100..=100 {
            let x = std::f64::consts::PI * f64::from(i) / 100.0;
            let (sin, cos) = sin_cos(x);
            assert!((sin - x.sin()).abs() < 1e-8 && (cos - x.cos()).abs() < 1e-8, "{x}");
        }
    }

    #[test]
    fn keys_are_met_and_the_body_stands_still_outside_them() {
        for is_smooth in [true, false] {
            let m = motion(is_smooth);
            assert_eq!(m.pose(-5.0), m.pose(0.0));
            assert_eq!(m.pose(9.0).displacement.x, -1.0);
            assert!((m.pose(1.0).displacement.x - 1.0).abs() < 1e-12);
            assert!((m.pose(0.5).displacement.x - 0.5).abs() < 1e-12, "both are symmetric");
        }
        assert!(motion(true).pose(0.01).displacement.x < 0.2 * motion(false).pose(0.01).displacement.x);
    }

    #[test]
    fn spaces_in_spaces_move_together_and_a_line_of_keys_is_a_geodesic() {
        let axis = DVec3::new(0.0, 0.6, 0.8);
        let link = |to: DVec3, angle: f64, scale: f64| Link {
            translation: Keys::new(vec![(0.0, DVec3::ZERO), (2.0, to)], Interpolation::Linear, false),
            turn: Keys::new(
                vec![(0.0, Turn::About(axis, 0.3)), (2.0, Turn::About(axis, 0.3 + angle))],
                Interpolation::Linear,
                false,
            ),
            scale: Keys::new(vec![(0.0, 1.5), (2.0, 1.5 * scale)], Interpolation::Linear, false),
        };
        let (outer, inner) = (link(DVec3::X, 9.0, 1.0), link(DVec3::Y, -2.0, 2.0));
        let pivot = DVec3::new(0.4, -0.2, 0.7);
        let motion = Motion::of_links(vec![outer.clone(), inner.clone()], pivot);
        let there = |p: DVec3, time: f64| outer.at(time).point(inner.at(time).point(p));
        for time in [-1.0, 0.0, 0.3, 1.1, 2.0, 5.0] {
            let p = DVec3::new(0.1, 0.9, -0.5);
            let moved = motion.placement(pivot, time).point(there(p, 0.0));
            assert!((moved - there(p, time)).length() < 1e-12, "{time}: {moved}");
        }
        assert_eq!((motion.scale(0.0), motion.scale(2.0)), (1.0, 2.0));
        // A space alone, about its own origin: the same change in every tenth of the time.
        let alone = Motion::of_links(vec![outer], DVec3::ZERO);
        let step = |i: i32| {
            let [a, b] = [i, i + 1].map(|i| alone.pose(0.2 * f64::from(i)));
            (b.displacement - a.displacement, b.rotation * a.rotation.inverse())
        };
        for i in 1..10 {
            assert!((step(i).0 - step(0).0).length() < 1e-12 && step(i).1.angle_between(step(0).1) < 1e-6);
        }
        assert!(
            Placement::IDENTITY.within(&inner.at(0.7)).within(&inner.at(0.7).inverse()).translation.length() < 1e-12
        );
    }

    #[test]
    fn a_span_begins_and_ends_where_the_motion_does_and_moves_as_it_says() {
        let center = DVec3::new(0.2, 0.1, -0.4);
        let span = motion(true).span(center, 0.4, 0.3);
        let material = DVec3::new(0.9, -0.3, 0.2);
        for (phase, time) in [(0.0, 0.4), (1.0, 0.7)] {
            let pose = motion(true).pose(time);
            let there = pose.rotation * (material - center) + center + pose.displacement;
            let (rest, _) = span.to_rest(there.to_array(), phase);
            assert!((DVec3::from_array(rest) - material).length() < 1e-7);
        }
        let there = |phase: f64| {
            let m = span.rotation(phase);
            let v = (material - center).to_array();
            DVec3::from_array(triple!(i => dot(m[i], v) + span.center(phase)[i]))
        };
        let h = 1e-4;
        let difference = (there(0.5 + h) - there(0.5 - h)) / (2.0 * h * 0.3);
        let velocity = DVec3::from_array(span.velocity_at(there(0.5).to_array(), 0.5));
        assert!((difference - velocity).length() < 1e-6, "{difference} {velocity}");
        let [instant, short] = [0.0, 1e-4].map(|duration| motion(true).span(center, 0.5, duration));
        let p = [0.9, -0.3, 0.2];
        let [a, b] = [instant, short].map(|span| DVec3::from_array(span.velocity_at(p, 0.0)));
        assert!(a.length() > 1.0 && (a - b).length() < 1e-3, "at an instant: {a} {b}");
    }
}
