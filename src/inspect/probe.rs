//! What inspection asks of a flow: velocity and distance at a point. The only file here that calls `flow`.

use crate::flow::VelocityField;
use crate::flow::field::FieldSpan;
use glam::DVec3;

/// A flow round obstacles that can be asked from any thread.
pub trait Flow: Sync {
    /// Velocity [m/s] at a point [m] and a time [s].
    fn velocity(&self, p: DVec3, time: f64) -> DVec3;

    /// Signed distance to the closest wall [m] at a time [s]: negative where the flow must not be, infinite without walls.
    /// Never more than the true distance, so that a ball of this radius holds no wall.
    fn distance(&self, p: DVec3, time: f64) -> f64;
}

/// The flow of a scene, with what depends on time alone worked out beforehand.
pub struct SceneFlow<'a> {
    spans: Vec<FieldSpan<'a>>,
    start: f64,
    step: f64,
}

impl<'a> SceneFlow<'a> {
    /// The flow as it stands still at a time [s]; it looks the same at any time it is asked about.
    pub fn frozen(field: &'a VelocityField, time: f64) -> Self {
        Self { spans: vec![field.span(time, 0.0)], start: time, step: 0.0 }
    }

    /// The flow from `start` [s] over `count` steps of `step` [s]. Before and after it goes on as in its first and last
    /// step.
    ///
    /// # Panics
    /// Without a step, or where `step` is not above 0.
    pub fn moving(field: &'a VelocityField, start: f64, step: f64, count: usize) -> Self {
        assert!(count > 0 && step > 0.0, "a flow that moves takes time");
        let spans = (0..count).map(|n| field.span(start + n as f64 * step, step)).collect();
        Self { spans, start, step }
    }

    fn at(&self, time: f64) -> (&FieldSpan<'a>, f64) {
        if self.step == 0.0 {
            return (&self.spans[0], 0.0);
        }
        let steps = (time - self.start) / self.step;
        let n = steps.floor().clamp(0.0, (self.spans.len() - 1) as f64);
        (&self.spans[n as usize], steps - n)
    }
}

impl Flow for SceneFlow<'_> {
    fn velocity(&self, p: DVec3, time: f64) -> DVec3 {
        let (span, phase) = self.at(time);
        DVec3::from_array(span.velocity(p.to_array(), phase))
    }

    fn distance(&self, p: DVec3, time: f64) -> f64 {
        let (span, phase) = self.at(time);
        span.distance(p.to_array(), phase)
    }
}

/// Flows with known answers.
#[cfg(test)]
pub(crate) mod known {
    use super::*;

    /// The same velocity everywhere, without obstacles.
    pub struct Uniform(pub DVec3);

    impl Flow for Uniform {
        fn velocity(&self, _: DVec3, _: f64) -> DVec3 {
            self.0
        }

        fn distance(&self, _: DVec3, _: f64) -> f64 {
            f64::INFINITY
        }
    }

    /// Turns as a solid about the z axis with so many radians a second; a ball of a radius [m] stands about a point.
    pub struct Rotation {
        pub rate: f64,
        pub ball: Option<(DVec3, f64)>,
    }

    impl Flow for Rotation {
        fn velocity(&self, p: DVec3, _: f64) -> DVec3 {
            DVec3::Z.cross(p) * self.rate
        }

        fn distance(&self, p: DVec3, _: f64) -> f64 {
            self.ball.map_or(f64::INFINITY, |(center, radius)| p.distance(center) - radius)
        }
    }
}
