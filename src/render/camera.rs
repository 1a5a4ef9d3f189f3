//! The pinhole camera.

use crate::math::space::{UnitVec3, WorldPoint};
use glam::{Vec2, Vec3};

/// A pinhole camera: pixel (0, 0) is top left, pixels are square.
#[derive(Debug, Clone)]
pub struct Camera {
    position: WorldPoint,
    forward: UnitVec3,
    right: Vec3,
    down: Vec3,
    corner: Vec3,
}

impl Camera {
    /// A camera at `position` that has `look_at` in the middle of its picture of `resolution` pixels, whose upper and
    /// lower edge are `vertical_fov_deg` apart.
    ///
    /// Returns `None` where `look_at` equals `position` or `up` is parallel to the view.
    pub fn try_new(
        position: WorldPoint,
        look_at: WorldPoint,
        up: Vec3,
        vertical_fov_deg: f32,
        resolution: [u32; 2],
    ) -> Option<Self> {
        let forward = UnitVec3::try_new(look_at - position)?;
        let right = UnitVec3::try_new(forward.cross(up))?;
        let down = forward.cross(*right);
        let half_height = (vertical_fov_deg.to_radians() * 0.5).tan();
        let pixel = 2.0 * half_height / resolution[1] as f32;
        let (width, height) = (resolution[0] as f32, resolution[1] as f32);
        let corner = *forward - *right * (pixel * width * 0.5) - down * (pixel * height * 0.5);
        Some(Self { position, forward, right: *right * pixel, down: down * pixel, corner })
    }

    /// The direction through the film position `p` [pixels], (0, 0) being the top left corner of the picture.
    pub fn direction(&self, p: Vec2) -> UnitVec3 {
        UnitVec3::new_unchecked((self.corner + self.right * p.x + self.down * p.y).normalize())
    }

    /// Where the camera is.
    pub fn position(&self) -> WorldPoint {
        self.position
    }

    /// The direction through the middle of the picture.
    pub fn forward(&self) -> UnitVec3 {
        self.forward
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_looks_forward_and_the_edges_span_the_field_of_view() {
        let camera =
            Camera::try_new(WorldPoint::new(0.0, 1.0, 5.0), WorldPoint::new(0.0, 1.0, 0.0), Vec3::Y, 40.0, [200, 100])
                .expect("looks somewhere");
        assert!((*camera.direction(Vec2::new(100.0, 50.0)) - Vec3::NEG_Z).length() < 1e-6);
        let top = camera.direction(Vec2::new(100.0, 0.0));
        let bottom = camera.direction(Vec2::new(100.0, 100.0));
        assert!(top.y > 0.0 && (top.angle_between(*bottom).to_degrees() - 40.0).abs() < 1e-3);
        assert!(camera.direction(Vec2::new(200.0, 50.0)).x > 0.0);
    }

    #[test]
    fn a_camera_that_looks_nowhere_is_refused() {
        let p = WorldPoint::new(1.0, 2.0, 3.0);
        assert!(Camera::try_new(p, p, Vec3::Y, 40.0, [1, 1]).is_none());
        assert!(Camera::try_new(p, p + Vec3::Y, Vec3::Y, 40.0, [1, 1]).is_none());
    }
}
