//! How far things move on the picture from one frame to the next: what compositing programs blur by, and what denoisers
//! find the last picture by.
//!
//! Shapes go where their keys bring them by the next frame. Smoke goes with the flow that carries it, along one classical
//! Runge–Kutta step as long as a frame, from where the path first scattered: so a pixel that sees deep into smoke has the
//! mean over the depths that it sees. The camera goes where its keys bring it by the next frame.

use crate::flow::kind::FlowSpan;
use crate::geometry::motion::Placement;
use crate::geometry::{Geometry, Shape};
use crate::math::space::WorldPoint;
use crate::render::camera::Camera;
use crate::render::film::Contribution;
use crate::render::light_path::FirstEvent;
use glam::{DVec3, Vec3};

/// How everything in a scene moves from a frame to the next.
#[derive(Debug)]
pub struct FrameMotion<'a> {
    /// What takes each shape from where it is to where it is at the next frame, `None` for those at rest.
    shapes: Vec<Option<Placement>>,
    /// The camera of the next frame, where it moves.
    pub next_camera: Option<Camera>,
    /// What carries the smoke, if that is known.
    flow: Option<FlowSpan<'a>>,
    /// From a frame to the next [s].
    seconds: f64,
}

impl<'a> FrameMotion<'a> {
    /// The motion from `time` [s] on for `seconds`, > 0: that of shapes where they rest and of the flow, which lasts as long
    /// and is `None` for smoke of which nobody knows what carries it.
    pub fn new(geometry: &Geometry, flow: Option<FlowSpan<'a>>, time: f64, seconds: f64) -> Self {
        let step = |shape: &Shape| {
            let [now, next] =
                [time, time + seconds].map(|time| Some(shape.motion.as_ref()?.placement(shape.pivot, time)));
            Some(now?.inverse().within(&next?))
        };
        Self { shapes: geometry.shapes.iter().map(step).collect(), next_camera: None, flow, seconds }
    }

    /// What a path brings to the layer: how far what it met first moves on the picture [pixels], to the right and down, and
    /// 1; zeros where it met nothing that scatters, or what goes where the camera does not look.
    pub fn of_path(&self, camera: &Camera, path: &Contribution) -> Vec3 {
        let next = match (path.first, path.shape_idx) {
            (FirstEvent::None, _) | (FirstEvent::Surface, None) => return Vec3::ZERO,
            (FirstEvent::Surface, Some(shape_idx)) => {
                self.shapes[shape_idx as usize].map(|step| step.point(path.place.0.as_dvec3()))
            }
            (FirstEvent::Smoke, _) => {
                let flow = self.flow.as_ref().filter(|_| path.is_carried);
                flow.map(|flow| carried(flow, path.place, self.seconds))
            }
        };
        if next.is_none() && self.next_camera.is_none() {
            return Vec3::Z;
        }
        let next = next.unwrap_or(path.place.0.as_dvec3());
        let from = camera.place(path.place.0.as_dvec3());
        match from
            .zip(self.next_camera.as_ref().unwrap_or(camera).place(next))
            .map(|(from, to)| camera.shorter(to - from).as_vec2())
        {
            Some(way) if way.is_finite() => way.extend(1.0),
            _ => Vec3::ZERO,
        }
    }
}

/// Where the flow carries a point over all of its span, `seconds` long [m].
fn carried(flow: &FlowSpan, from: WorldPoint, seconds: f64) -> DVec3 {
    let from = from.0.as_dvec3();
    let velocity = |p: DVec3, phase: f64| DVec3::from_array(flow.velocity(p.to_array(), phase));
    let first = velocity(from, 0.0);
    let second = velocity(from + first * (0.5 * seconds), 0.5);
    let third = velocity(from + second * (0.5 * seconds), 0.5);
    let fourth = velocity(from + third * seconds, 1.0);
    from + (first + 2.0 * (second + third) + fourth) * (seconds / 6.0)
}
