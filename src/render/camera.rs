//! The pinhole camera.

use crate::math::space::{UnitVec3, WorldPoint};
use glam::{DMat4, DVec3, DVec4, Vec2, Vec3};

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

    /// Matrix from the world to camera space, row after row, for points that are multiplied from the left (as rows):
    /// x to the right, y up, z forwards from the camera, so left-handed, as OpenEXR and RenderMan have it [m].
    pub fn world_to_camera(&self) -> [f32; 16] {
        let [right, up] = [self.right, -self.down].map(|v| v.as_dvec3().normalize());
        let axes = [right, up, self.forward.as_dvec3()];
        let row = |v: DVec3, last: f64| DVec4::new(v.dot(axes[0]), v.dot(axes[1]), v.dot(axes[2]), last);
        let rows = [row(DVec3::X, 0.0), row(DVec3::Y, 0.0), row(DVec3::Z, 0.0), row(-self.position.0.as_dvec3(), 1.0)];
        DMat4::from_cols_array_2d(&rows.map(|row| row.to_array())).as_mat4().to_cols_array()
    }

    /// Matrix from the world to the picture, row after row, for points that are multiplied from the left (as rows) and
    /// divided by their last component: (0, 0) is the upper left corner of the whole picture and (1, 1) the lower right.
    /// The third component, which readers drop, is 1 − 1/z, so that the matrix has an inverse.
    pub fn world_to_ndc(&self) -> [f32; 16] {
        // Half the width and height of the picture at distance 1.
        let corner = self.corner.as_dvec3();
        let half_width = -corner.dot(self.right.as_dvec3().normalize());
        let half_height = -corner.dot(self.down.as_dvec3().normalize());
        // The columns of a glam matrix are rows here.
        let projection = DMat4::from_cols(
            DVec4::new(0.5 / half_width, 0.0, 0.0, 0.0),
            DVec4::new(0.0, -0.5 / half_height, 0.0, 0.0),
            DVec4::new(0.5, 0.5, 1.0, 1.0),
            DVec4::new(0.0, 0.0, -1.0, 0.0),
        );
        let to_camera = DMat4::from_cols_array(&self.world_to_camera().map(f64::from));
        (projection * to_camera).as_mat4().to_cols_array()
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
    fn matrices_say_where_points_are_seen() {
        let position = WorldPoint::new(3.0, 1.0, 5.0);
        let camera = Camera::try_new(position, WorldPoint::new(0.0, 0.5, -1.0), Vec3::Y, 40.0, [200, 100]).unwrap();
        // As a reader would: the point as a row, times the matrix as it is stored.
        let times = |p: Vec3, m: [f32; 16]| -> [f32; 4] {
            let p = [p.x, p.y, p.z, 1.0];
            std::array::from_fn(|column| (0..4).map(|row| p[row] * m[4 * row + column]).sum())
        };
        for (pixel, distance) in [([0.0, 0.0], 2.0), ([200.0, 100.0], 7.0), ([137.0, 21.0], 0.3)] {
            let seen = position.0 + *camera.direction(Vec2::from(pixel)) * distance;
            let [x, y, _, w] = times(seen, camera.world_to_ndc());
            assert!((x / w * 200.0 - pixel[0]).abs() < 1e-2 && (y / w * 100.0 - pixel[1]).abs() < 1e-2, "{pixel:?}");
        }
        let ahead = times(position.0 + *camera.forward() * 3.0, camera.world_to_camera());
        assert!((Vec3::from_slice(&ahead) - Vec3::new(0.0, 0.0, 3.0)).length() < 1e-5, "{ahead:?}");
        let above = times(position.0 + Vec3::Y, camera.world_to_camera());
        assert!(above[1] > 0.9 && above[3] == 1.0, "{above:?}");
        assert!(glam::Mat4::from_cols_array(&camera.world_to_ndc()).determinant().abs() > 1e-3);
    }

    #[test]
    fn a_camera_that_looks_nowhere_is_refused() {
        let p = WorldPoint::new(1.0, 2.0, 3.0);
        assert!(Camera::try_new(p, p, Vec3::Y, 40.0, [1, 1]).is_none());
        assert!(Camera::try_new(p, p + Vec3::Y, Vec3::Y, 40.0, [1, 1]).is_none());
    }
}
