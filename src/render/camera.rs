//! Cameras: which ray a place on the film and a place on the lens belong to.

use crate::geometry::embree::Ray;
use crate::math::space::{UnitVec3, WorldPoint};
use glam::{DMat4, DVec2, DVec3, DVec4, Vec2, Vec3};
use std::f32::consts::{FRAC_PI_4, PI, TAU};

/// A camera: pixel (0, 0) is top left, pixels are square.
#[derive(Debug, Clone)]
pub struct Camera {
    position: WorldPoint,
    forward: UnitVec3,
    /// One pixel to the right and one down, and the upper left corner from the position: at distance 1 before the camera, or
    /// for parallel rays where they start [m].
    right: Vec3,
    down: Vec3,
    corner: Vec3,
    projection: Projection,
    lens: Option<Lens>,
    /// Pixels of the whole picture.
    resolution: Vec2,
}

/// How the world comes onto the film.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// Straight lines through one point; the upper and lower edge are so far apart [degrees].
    Perspective {
        /// Angle between the lower and the upper edge [degrees].
        vertical_fov_deg: f32,
    },
    /// Parallel rays.
    Orthographic {
        /// Height of what is seen [m].
        height: f32,
    },
    /// All directions, by longitude and latitude: the middle is forwards, the left edge behind, the top up.
    LatLong,
}

/// A thin lens: what is nearer or farther than the plane of focus is blurred.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Radius of its opening [m].
    pub radius: f32,
    /// Distance of the plane of focus along the view axis [m].
    pub focus_distance: f32,
}

impl Camera {
    /// A camera at `position` that has `look_at` in the middle of its picture of `resolution` pixels.
    ///
    /// Returns `None` where `look_at` equals `position` or `up` is parallel to the view.
    pub fn try_new(
        position: WorldPoint,
        look_at: WorldPoint,
        up: Vec3,
        projection: Projection,
        lens: Option<Lens>,
        resolution: [u32; 2],
    ) -> Option<Self> {
        let forward = UnitVec3::try_new(look_at - position)?;
        let right = UnitVec3::try_new(forward.cross(up))?;
        let down = forward.cross(*right);
        let (width, height) = (resolution[0] as f32, resolution[1] as f32);
        let (pixel, ahead) = match projection {
            Projection::Perspective { vertical_fov_deg } => {
                (2.0 * (vertical_fov_deg.to_radians() * 0.5).tan() / height, *forward)
            }
            Projection::Orthographic { height: seen } => (seen / height, Vec3::ZERO),
            Projection::LatLong => (1.0 / height, Vec3::ZERO),
        };
        let corner = ahead - *right * (pixel * width * 0.5) - down * (pixel * height * 0.5);
        Some(Self {
            position,
            forward,
            right: *right * pixel,
            down: down * pixel,
            corner,
            projection,
            lens,
            resolution: Vec2::new(width, height),
        })
    }

    /// The ray through the film position `p` [pixels], (0, 0) being the top left corner of the picture, and the place on the
    /// lens that two uniform numbers choose: ½, ½ is its middle.
    #[inline]
    pub fn ray(&self, p: Vec2, lens: [f32; 2]) -> Ray {
        let ray = match self.projection {
            Projection::Perspective { .. } => {
                let direction = UnitVec3::new_unchecked((self.corner + self.right * p.x + self.down * p.y).normalize());
                Ray { origin: self.position, direction }
            }
            Projection::Orthographic { .. } => {
                let start = self.corner + self.right * p.x + self.down * p.y;
                Ray { origin: self.position + start, direction: self.forward }
            }
            Projection::LatLong => Ray { origin: self.position, direction: self.around(p) },
        };
        match self.lens {
            Some(lens_settings) => self.through(lens_settings, ray, lens),
            None => ray,
        }
    }

    /// The direction at longitude and latitude.
    fn around(&self, p: Vec2) -> UnitVec3 {
        let (right, down) = (self.right.normalize(), self.down.normalize());
        let (sin_long, cos_long) = (TAU * (p.x / self.resolution.x - 0.5)).sin_cos();
        let (sin_lat, cos_lat) = (PI * (p.y / self.resolution.y - 0.5)).sin_cos();
        let level = *self.forward * cos_long + right * sin_long;
        UnitVec3::new_unchecked((level * cos_lat + down * sin_lat).normalize())
    }

    /// The ray that meets `ray` in the plane of focus, from another place on the lens.
    fn through(&self, lens: Lens, ray: Ray, u: [f32; 2]) -> Ray {
        let place = disk(u) * lens.radius;
        let offset = self.right.normalize() * place.x + self.down.normalize() * place.y;
        let t = lens.focus_distance / ray.direction.dot(*self.forward);
        let direction = UnitVec3::new_unchecked((*ray.direction * t - offset).normalize());
        Ray { origin: ray.origin + offset, direction }
    }

    /// How far a place at distance `t` [m] along a ray of this camera is: along the view axis, or where all directions are
    /// seen from the camera itself [m].
    pub fn depth(&self, ray: &Ray, t: f32) -> f32 {
        match self.projection {
            Projection::LatLong => t,
            _ => t * ray.direction.dot(*self.forward),
        }
    }

    /// Where on the film a point [m] is seen through the middle of the lens [pixels]: the inverse of [`Camera::ray`]. `None`
    /// behind the camera.
    pub fn place(&self, p: DVec3) -> Option<DVec2> {
        let [right, down] = [self.right, self.down].map(|v| v.as_dvec3());
        let (forward, corner) = (self.forward.as_dvec3(), self.corner.as_dvec3());
        let v = p - self.position.0.as_dvec3();
        let ahead = v.dot(forward);
        let v = match self.projection {
            Projection::Perspective { .. } if ahead > 0.0 => v / ahead,
            Projection::Perspective { .. } => return None,
            Projection::Orthographic { .. } => v,
            Projection::LatLong => {
                let v = v.try_normalize()?;
                let long = v.dot(right.normalize()).atan2(v.dot(forward));
                let lat = v.dot(down.normalize()).clamp(-1.0, 1.0).asin();
                let share = DVec2::new(long / std::f64::consts::TAU + 0.5, lat / std::f64::consts::PI + 0.5);
                return Some(share * self.resolution.as_dvec2());
            }
        };
        let v = v - corner;
        Some(DVec2::new(v.dot(right) / right.length_squared(), v.dot(down) / down.length_squared()))
    }

    /// A way on the film [pixels], or one that ends at the same place and is shorter: what sees all directions goes round.
    pub fn shorter(&self, way: DVec2) -> DVec2 {
        let width = f64::from(self.resolution.x);
        match self.projection {
            Projection::LatLong => DVec2::new(way.x - width * (way.x / width).round(), way.y),
            _ => way,
        }
    }

    /// Turns motion seen at a row of pixels as the rows go there: beyond a pole, where what sees all directions goes on over
    /// it, they go down for what goes up.
    pub fn along_rows(&self, way: Vec3, y: i32) -> Vec3 {
        let is_over = self.projection == Projection::LatLong && !(0.0..self.resolution.y).contains(&(y as f32));
        if is_over { way * Vec3::new(1.0, -1.0, 1.0) } else { way }
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
    /// The third component, which readers drop, is 1 − 1/z, so that the matrix has an inverse; z of parallel rays. `None`
    /// where no matrix says it.
    pub fn world_to_ndc(&self) -> Option<[f32; 16]> {
        // Half the width and height of the picture, at distance 1 where rays part.
        let corner = self.corner.as_dvec3();
        let half_width = -corner.dot(self.right.as_dvec3().normalize());
        let half_height = -corner.dot(self.down.as_dvec3().normalize());
        // The columns of a glam matrix are rows here.
        let [across, upwards] = [DVec4::X * (0.5 / half_width), DVec4::Y * (-0.5 / half_height)];
        let [depth, last] = match self.projection {
            Projection::Perspective { .. } => [DVec4::new(0.5, 0.5, 1.0, 1.0), DVec4::new(0.0, 0.0, -1.0, 0.0)],
            Projection::Orthographic { .. } => [DVec4::Z, DVec4::new(0.5, 0.5, 0.0, 1.0)],
            Projection::LatLong => return None,
        };
        let to_camera = DMat4::from_cols_array(&self.world_to_camera().map(f64::from));
        Some((DMat4::from_cols(across, upwards, depth, last) * to_camera).as_mat4().to_cols_array())
    }
}

/// A place in the unit disk from two uniform numbers, neighbours staying neighbours (Shirley and Chiu 1997, *A low
/// distortion map between disk and square*).
fn disk(u: [f32; 2]) -> Vec2 {
    let [a, b] = u.map(|u| 2.0 * u - 1.0);
    if a == 0.0 && b == 0.0 {
        return Vec2::ZERO;
    }
    let (radius, angle) =
        if a.abs() > b.abs() { (a, FRAC_PI_4 * b / a) } else { (b, 2.0 * FRAC_PI_4 - FRAC_PI_4 * a / b) };
    radius * Vec2::from_angle(angle)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MIDDLE: [f32; 2] = [0.5, 0.5];
    const FOV: Projection = Projection::Perspective { vertical_fov_deg: 40.0 };

    fn camera(projection: Projection, lens: Option<Lens>) -> Camera {
        let look_at = WorldPoint::new(0.0, 0.5, -1.0);
        Camera::try_new(WorldPoint::new(3.0, 1.0, 5.0), look_at, Vec3::Y, projection, lens, [200, 100]).unwrap()
    }

    #[test]
    fn the_middle_looks_forward_and_the_edges_span_the_field_of_view() {
        let camera = Camera::try_new(
            WorldPoint::new(0.0, 1.0, 5.0),
            WorldPoint::new(0.0, 1.0, 0.0),
            Vec3::Y,
            FOV,
            None,
            [200, 100],
        )
        .expect("looks somewhere");
        let direction = |x: f32, y: f32| camera.ray(Vec2::new(x, y), MIDDLE).direction;
        assert!((*direction(100.0, 50.0) - Vec3::NEG_Z).length() < 1e-6);
        let (top, bottom) = (direction(100.0, 0.0), direction(100.0, 100.0));
        assert!(top.y > 0.0 && (top.angle_between(*bottom).to_degrees() - 40.0).abs() < 1e-3);
        assert!(direction(200.0, 50.0).x > 0.0);
    }

    #[test]
    fn matrices_say_where_points_are_seen() {
        // As a reader would: the point as a row, times the matrix as it is stored.
        let times = |p: Vec3, m: [f32; 16]| -> [f32; 4] {
            let p = [p.x, p.y, p.z, 1.0];
            std::array::from_fn(|column| (0..4).map(|row| p[row] * m[4 * row + column]).sum())
        };
        for projection in [FOV, Projection::Orthographic { height: 3.0 }] {
            let camera = camera(projection, None);
            let matrix = camera.world_to_ndc().unwrap();
            for (pixel, distance) in [([0.0, 0.0], 2.0), ([200.0, 100.0], 7.0), ([137.0, 21.0], 0.3)] {
                let seen = camera.ray(Vec2::from(pixel), MIDDLE).at(distance);
                let [x, y, _, w] = times(seen.0, matrix);
                assert!(
                    (x / w * 200.0 - pixel[0]).abs() < 1e-2 && (y / w * 100.0 - pixel[1]).abs() < 1e-2,
                    "{pixel:?}"
                );
                let depth = times(seen.0, camera.world_to_camera())[2];
                assert!((depth - camera.depth(&camera.ray(Vec2::from(pixel), MIDDLE), distance)).abs() < 1e-4);
            }
            let ahead = times(camera.position.0 + *camera.forward * 3.0, camera.world_to_camera());
            assert!((Vec3::from_slice(&ahead) - Vec3::new(0.0, 0.0, 3.0)).length() < 1e-5, "{ahead:?}");
            let above = times(camera.position.0 + Vec3::Y, camera.world_to_camera());
            assert!(above[1] > 0.9 && above[3] == 1.0, "{above:?}");
            assert!(glam::Mat4::from_cols_array(&matrix).determinant().abs() > 1e-3);
        }
        assert!(camera(Projection::LatLong, None).world_to_ndc().is_none());
    }

    #[test]
    fn places_are_where_rays_go_through() {
        for projection in [FOV, Projection::Orthographic { height: 3.0 }, Projection::LatLong] {
            let camera = camera(projection, None);
            for (pixel, distance) in [([0.5, 1.0], 2.0), ([199.0, 99.0], 7.0), ([137.0, 21.0], 0.3)] {
                let seen = camera.ray(Vec2::from(pixel), MIDDLE).at(distance);
                let found = camera.place(seen.0.as_dvec3()).expect("before the camera");
                assert!((found.as_vec2() - Vec2::from(pixel)).length() < 2e-3, "{projection:?} {pixel:?} {found}");
            }
        }
        let (all, some) = (camera(Projection::LatLong, None), camera(FOV, None));
        assert!(some.place((some.position.0 - *some.forward).as_dvec3()).is_none());
        // Across the edge behind the camera it is two pixels to the right, not nearly all to the left.
        assert!((all.shorter(DVec2::new(-198.0, 1.0)) - DVec2::new(2.0, 1.0)).length() < 1e-12);
        assert_eq!(some.shorter(DVec2::new(-198.0, 1.0)), DVec2::new(-198.0, 1.0));
    }

    #[test]
    fn all_directions_are_seen_once_by_longitude_and_latitude() {
        let camera = camera(Projection::LatLong, None);
        let at = |x: f32, y: f32| *camera.ray(Vec2::new(x, y), MIDDLE).direction;
        assert!((at(100.0, 50.0) - *camera.forward).length() < 1e-5);
        assert!((at(0.0, 50.0) + *camera.forward).length() < 1e-5);
        assert!((at(150.0, 50.0) - camera.right.normalize()).length() < 1e-5);
        assert!((at(31.0, 0.0) + camera.down.normalize()).length() < 1e-5);
        // Solid angles of pixels, by finite differences, add to the sphere.
        let mut sum = 0.0;
        for y in 0..100 {
            let (x, y) = (73.5f32, y as f32 + 0.5);
            let [across, along] =
                [at(x + 0.5, y) - at(x - 0.5, y), at(x, y + 0.5) - at(x, y - 0.5)].map(|v| v.as_dvec3());
            sum += 200.0 * across.cross(along).length();
        }
        assert!((sum / (4.0 * std::f64::consts::PI) - 1.0).abs() < 1e-3, "{sum}");
    }

    #[test]
    fn rays_through_a_lens_meet_in_the_plane_of_focus_and_fill_its_opening() {
        let lens = Lens { radius: 0.2, focus_distance: 4.0 };
        for projection in [FOV, Projection::Orthographic { height: 3.0 }] {
            let camera = camera(projection, Some(lens));
            let p = Vec2::new(31.0, 77.0);
            let sharp = camera.ray(p, MIDDLE);
            let focus = sharp.at(4.0 / sharp.direction.dot(*camera.forward));
            let (n, mut within_half) = (64, 0);
            for i in 0..n * n {
                let u = [(i % n) as f32 + 0.5, (i / n) as f32 + 0.5].map(|u| u / n as f32);
                let ray = camera.ray(p, u);
                let offset = ray.origin - sharp.origin;
                assert!(offset.length() < 0.2 + 1e-6 && offset.dot(*camera.forward).abs() < 1e-6);
                within_half += u32::from(offset.length() < 0.1);
                assert!((ray.at((focus - ray.origin).length()) - focus).length() < 1e-5, "{u:?}");
            }
            let share = f64::from(within_half) / f64::from(n * n);
            assert!((share - 0.25).abs() < 0.01, "half the radius holds a quarter of the disk: {share}");
        }
    }

    #[test]
    fn a_camera_that_looks_nowhere_is_refused() {
        let p = WorldPoint::new(1.0, 2.0, 3.0);
        assert!(Camera::try_new(p, p, Vec3::Y, FOV, None, [1, 1]).is_none());
        assert!(Camera::try_new(p, p + Vec3::Y, Vec3::Y, FOV, None, [1, 1]).is_none());
    }
}
