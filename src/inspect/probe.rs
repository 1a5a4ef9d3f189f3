//! What inspection asks of a flow: velocity and distance at a point. The only file here that calls `flow`.

use crate::flow;
use crate::flow::kind::FlowSpan;
use glam::DVec3;

/// A flow round obstacles that can be asked from any thread.
pub trait Flow: Sync {
    /// Velocity [m/s] at a point [m] and a time [s].
    fn velocity(&self, p: DVec3, time: f64) -> DVec3;

    /// Signed distance to the closest wall [m] at a time [s]: negative where the flow must not be, infinite without walls.
    /// Never more than the true distance, so that a ball of this radius holds no wall.
    fn distance(&self, p: DVec3, time: f64) -> f64;

    /// What a line that starts at a point [m] keeps for good; of most flows nothing.
    fn iso_values(&self, _: DVec3) -> Option<[f64; 2]> {
        None
    }

    /// A point [m] to which a step of length `step` [m] has brought a line, put back to where it has its values.
    fn put_back(&self, p: DVec3, _step: f64, _iso_values: [f64; 2]) -> DVec3 {
        p
    }
}

/// The flow of a scene, with what depends on time alone worked out beforehand.
pub struct SceneFlow<'a> {
    spans: Vec<FlowSpan<'a>>,
    start: f64,
    step: f64,
}

impl<'a> SceneFlow<'a> {
    /// The flow as it stands still at a time [s]; it looks the same at any time it is asked about.
    pub fn frozen(flow: &'a flow::Flow, time: f64) -> Self {
        Self { spans: vec![flow.span(time, 0.0)], start: time, step: 0.0 }
    }

    /// The flow from `start` [s] over `count` steps of `step` [s]. Before and after it goes on as in its first and last
    /// step.
    ///
    /// # Panics
    /// Without a step, or where `step` is not above 0.
    pub fn moving(flow: &'a flow::Flow, start: f64, step: f64, count: usize) -> Self {
        assert!(count > 0 && step > 0.0, "a flow that moves takes time");
        let spans = (0..count).map(|n| flow.span(start + n as f64 * step, step)).collect();
        Self { spans, start, step }
    }

    fn at(&self, time: f64) -> (&FlowSpan<'a>, f64) {
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
        span.walls().distance(p.to_array(), phase)
    }

    fn iso_values(&self, p: DVec3) -> Option<[f64; 2]> {
        match &self.spans[0] {
            FlowSpan::Curl(_) => None,
            FlowSpan::Tracks(tracks, _) => Some(tracks.iso_values(p.to_array())),
        }
    }

    fn put_back(&self, p: DVec3, step: f64, iso_values: [f64; 2]) -> DVec3 {
        match &self.spans[0] {
            FlowSpan::Curl(_) => p,
            FlowSpan::Tracks(tracks, _) => DVec3::from_array(tracks.put_back(p.to_array(), step, iso_values)),
        }
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
