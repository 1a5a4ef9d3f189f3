//! Cameras from what a scene says, at any time.

use crate::geometry::{keys, vector};
use crate::math::keys::Keys;
use crate::math::space::WorldPoint;
use crate::render::RenderError;
use crate::render::camera::{Camera, Lens, Projection};
use crate::scene::{Scene, settings};
use glam::DVec3;

/// A camera over time.
#[derive(Debug, Clone)]
pub struct CameraCourse {
    position: Keys<DVec3>,
    look_at: Keys<DVec3>,
    up: Keys<DVec3>,
    vertical_fov_deg: Keys<f64>,
    projection: settings::CameraProjection,
    lens: Option<LensCourse>,
    resolution: [u32; 2],
}

/// A lens over time.
#[derive(Debug, Clone)]
struct LensCourse {
    radius: Keys<f64>,
    /// The distance of what the camera looks at where `None`.
    focus_distance: Option<Keys<f64>>,
}

impl CameraCourse {
    /// The camera of a scene.
    pub fn new(scene: &Scene) -> Self {
        let (camera, frames) = (&scene.settings.camera, &scene.settings.frames);
        let number = |keyed: &settings::Keyed<f64>| keys(keyed, frames, |x| *x);
        Self {
            position: keys(&camera.position, frames, vector),
            look_at: keys(&camera.look_at, frames, vector),
            up: keys(&camera.up, frames, vector),
            vertical_fov_deg: number(&camera.vertical_fov_deg),
            projection: camera.projection,
            lens: camera.lens.as_ref().map(|lens| LensCourse {
                radius: number(&lens.radius),
                focus_distance: lens.focus_distance.as_ref().map(number),
            }),
            resolution: scene.settings.film.resolution,
        }
    }

    /// Whether it changes at all.
    pub fn varies(&self) -> bool {
        let points = [&self.position, &self.look_at, &self.up].into_iter().any(Keys::varies);
        let lens = self
            .lens
            .as_ref()
            .is_some_and(|lens| lens.radius.varies() || lens.focus_distance.as_ref().is_some_and(Keys::varies));
        points || lens || self.vertical_fov_deg.varies()
    }

    /// The camera at a time [s].
    ///
    /// # Errors
    /// [`RenderError::CameraNowhere`] where it looks at where it stands, or along its `up`.
    pub fn at(&self, time: f64) -> Result<Camera, RenderError> {
        let (position, look_at) = (self.position.at(time), self.look_at.at(time));
        let lens = self.lens.as_ref().map(|lens| Lens {
            radius: lens.radius.at(time) as f32,
            focus_distance: match &lens.focus_distance {
                Some(distance) => distance.at(time) as f32,
                None => distance(position, look_at) as f32,
            },
        });
        let projection = match self.projection {
            settings::CameraProjection::Perspective => {
                Projection::Perspective { vertical_fov_deg: self.vertical_fov_deg.at(time) as f32 }
            }
            settings::CameraProjection::Orthographic { height } => Projection::Orthographic { height: height as f32 },
            settings::CameraProjection::LatLong => Projection::LatLong,
        };
        let [position, look_at] = [position, look_at].map(|p| WorldPoint(p.as_vec3()));
        Camera::try_new(position, look_at, self.up.at(time).as_vec3(), projection, lens, self.resolution)
            .ok_or(RenderError::CameraNowhere { time })
    }
}

fn distance(a: DVec3, b: DVec3) -> f64 {
    (b - a).to_array().map(|x| x * x).iter().sum::<f64>().sqrt()
}
