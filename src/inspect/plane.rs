//! A rectangle in space that is looked at as a picture, and the camera that pictures of lines are taken with.

use crate::math::hash::Seed;
use glam::DVec3;

/// Which plane to look at.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum PlaneChoice {
    /// Upright, through the point that the camera looks at, facing the camera.
    #[default]
    FacingCamera,
    /// Where the coordinate of an axis (0 to 2) has a value [m].
    Axis(usize, f64),
    /// Through a point [m], facing along a normal of any length but 0.
    PointNormal(DVec3, DVec3),
}

/// A rectangle in space, seen from the side that its normal points to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rectangle {
    center: DVec3,
    right: DVec3,
    up: DVec3,
    size: [f64; 2],
}

impl Rectangle {
    /// A rectangle of the given width and height [m] about `center`. In it up is the world's up where the plane is not
    /// level, else away from a viewer who looks down with −z ahead.
    ///
    /// Returns `None` where the normal has no direction.
    pub fn try_new(center: DVec3, normal: DVec3, size: [f64; 2]) -> Option<Self> {
        let normal = normal.try_normalize()?;
        let hint = if normal.y.abs() > 0.999 { DVec3::NEG_Z } else { DVec3::Y };
        let right = hint.cross(normal).normalize();
        Some(Self { center, right, up: normal.cross(right), size })
    }

    /// The middle [m].
    pub fn center(&self) -> DVec3 {
        self.center
    }

    /// Directions to the right and up, length 1.
    pub fn axes(&self) -> [DVec3; 2] {
        [self.right, self.up]
    }

    /// The direction towards the viewer, length 1.
    pub fn normal(&self) -> DVec3 {
        self.right.cross(self.up)
    }

    /// Width and height [m].
    pub fn size(&self) -> [f64; 2] {
        self.size
    }

    /// The point [m] at shares of the width from the left and of the height from the top.
    pub fn point(&self, x: f64, y: f64) -> DVec3 {
        self.center + self.right * ((x - 0.5) * self.size[0]) + self.up * ((0.5 - y) * self.size[1])
    }
}

/// A pinhole camera that says where a point appears.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Perspective {
    position: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    /// Half the height of the picture at distance 1.
    half_height: f64,
    look_at: DVec3,
}

impl Perspective {
    /// A camera at `position` with `look_at` in the middle of its picture, whose lower and upper edge are
    /// `vertical_fov_deg` apart.
    ///
    /// Returns `None` where it looks nowhere or along `up`.
    pub fn try_new(position: DVec3, look_at: DVec3, up: DVec3, vertical_fov_deg: f64) -> Option<Self> {
        let forward = (look_at - position).try_normalize()?;
        let right = forward.cross(up).try_normalize()?;
        let half_height = (0.5 * vertical_fov_deg.to_radians()).tan();
        Some(Self { position, right, up: right.cross(forward), forward, half_height, look_at })
    }

    /// Where the camera is [m].
    pub fn position(&self) -> DVec3 {
        self.position
    }

    /// The point in the middle of the picture [m].
    pub fn look_at(&self) -> DVec3 {
        self.look_at
    }

    /// Height of what the picture shows at the distance of a point [m].
    pub fn height_at(&self, p: DVec3) -> f64 {
        2.0 * self.half_height * p.distance(self.position)
    }

    /// Column and row [pixels] in a picture of `size` pixels, and depth along the view [m]; `None` behind the camera.
    pub fn project(&self, p: DVec3, size: [f64; 2]) -> Option<[f64; 3]> {
        let offset = p - self.position;
        let depth = offset.dot(self.forward);
        if depth.is_nan() || depth <= 1e-6 {
            return None;
        }
        let pixels = size[1] / (2.0 * self.half_height * depth);
        Some([0.5 * size[0] + offset.dot(self.right) * pixels, 0.5 * size[1] - offset.dot(self.up) * pixels, depth])
    }

    /// The direction through a column and row [pixels] of a picture of `size` pixels, with length 1 along the view, so
    /// that multiples of it are depths.
    pub fn ray(&self, x: f64, y: f64, size: [f64; 2]) -> DVec3 {
        let scale = 2.0 * self.half_height / size[1];
        self.forward + self.right * ((x - 0.5 * size[0]) * scale) + self.up * ((0.5 * size[1] - y) * scale)
    }
}

/// The rectangle that was asked for, where the camera decides what is left open: a plane along an axis faces it, and
/// the height is what it sees at the distance of the middle.
///
/// Returns `None` where a normal has no direction.
pub fn choose(choice: PlaneChoice, size: Option<[f64; 2]>, aspect: f64, camera: &Perspective) -> Option<Rectangle> {
    let (center, normal) = match choice {
        PlaneChoice::FacingCamera => {
            let back = camera.position - camera.look_at;
            let level = DVec3::new(back.x, 0.0, back.z);
            // Seen from right above no upright plane faces the camera; the level one does.
            (camera.look_at, if level.length() > 1e-3 * back.length() { level } else { DVec3::Y * back.y.signum() })
        }
        PlaneChoice::Axis(axis, value) => {
            let mut center = camera.look_at;
            let mut normal = DVec3::ZERO;
            center[axis] = value;
            normal[axis] = if camera.position[axis] < value { -1.0 } else { 1.0 };
            (center, normal)
        }
        PlaneChoice::PointNormal(point, normal) => (point, normal),
    };
    let size = size.unwrap_or_else(|| {
        let height = camera.height_at(center).max(1e-9);
        [height * aspect, height]
    });
    Rectangle::try_new(center, normal, size)
}

/// About `count` points on a rectangle, one at a random place in each field of a grid: rows of square fields, or nearly so.
pub fn jittered(rectangle: &Rectangle, count: usize, seed: Seed) -> Vec<DVec3> {
    let [width, height] = rectangle.size();
    let columns = ((count as f64 * width / height).sqrt().round() as usize).clamp(1, count.max(1));
    let rows = (count as f64 / columns as f64).round().max(1.0) as usize;
    (0..columns * rows)
        .map(|i| {
            let jitter = |axis: u64| f64::from(seed.derive(i as u64).uniform(axis));
            let (x, y) = ((i % columns) as f64 + jitter(0), (i / columns) as f64 + jitter(1));
            rectangle.point(x / columns as f64, y / rows as f64)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Perspective {
        Perspective::try_new(DVec3::new(1.0, 3.0, 4.0), DVec3::new(0.0, 1.0, 0.0), DVec3::Y, 40.0).unwrap()
    }

    #[test]
    fn a_rectangle_is_seen_upright_from_its_normal() {
        let front = Rectangle::try_new(DVec3::ZERO, DVec3::Z * 3.0, [4.0, 2.0]).unwrap();
        assert_eq!(front.axes(), [DVec3::X, DVec3::Y]);
        assert_eq!((front.normal(), front.point(0.0, 0.0)), (DVec3::Z, DVec3::new(-2.0, 1.0, 0.0)));
        let level = Rectangle::try_new(DVec3::ZERO, DVec3::Y, [1.0, 1.0]).unwrap();
        assert_eq!(level.axes(), [DVec3::X, DVec3::NEG_Z]);
        assert!(Rectangle::try_new(DVec3::ZERO, DVec3::ZERO, [1.0, 1.0]).is_none());
    }

    #[test]
    fn the_plane_of_the_camera_is_upright_and_fills_its_view() {
        let plane = choose(PlaneChoice::FacingCamera, None, 2.0, &camera()).unwrap();
        assert!(plane.axes()[1].distance(DVec3::Y) < 1e-12 && plane.normal().dot(DVec3::new(1.0, 0.0, 4.0)) > 0.0);
        assert!((plane.size()[1] - 2.0 * 21f64.sqrt() * 20f64.to_radians().tan()).abs() < 1e-12);
        assert_eq!(plane.size()[0], 2.0 * plane.size()[1]);
        let above = Perspective::try_new(DVec3::Y * 5.0, DVec3::ZERO, DVec3::X, 40.0).unwrap();
        assert_eq!(choose(PlaneChoice::FacingCamera, None, 1.0, &above).unwrap().normal(), DVec3::Y);
        let side = choose(PlaneChoice::Axis(0, 2.0), Some([1.0, 1.0]), 1.0, &camera()).unwrap();
        assert_eq!((side.normal(), side.center()), (DVec3::NEG_X, DVec3::new(2.0, 1.0, 0.0)));
    }

    #[test]
    fn a_point_appears_where_the_ray_to_it_starts() {
        let (camera, size) = (camera(), [200.0, 100.0]);
        let p = DVec3::new(0.3, 0.8, -0.7);
        let [x, y, depth] = camera.project(p, size).unwrap();
        assert!((camera.position() + camera.ray(x, y, size) * depth).distance(p) < 1e-12);
        let [x, y, _] = camera.project(camera.look_at(), size).unwrap();
        assert!((x - 100.0).abs() < 1e-9 && (y - 50.0).abs() < 1e-9);
        assert!(camera.project(camera.position() * 2.0, size).is_none());
    }

    #[test]
    fn seeds_of_a_plane_cover_it_evenly() {
        let rectangle = Rectangle::try_new(DVec3::ZERO, DVec3::Z, [4.0, 1.0]).unwrap();
        let seeds = jittered(&rectangle, 400, Seed(1));
        assert_eq!(seeds.len(), 400);
        let left = seeds.iter().filter(|p| p.x < 0.0).count();
        assert_eq!(left, 200);
        assert!(seeds.iter().all(|p| p.x.abs() <= 2.0 && p.y.abs() <= 0.5 && p.z == 0.0));
        for count in [1, 2, 3, 7, 1000] {
            let found = jittered(&rectangle, count, Seed(1)).len();
            assert!(found.abs_diff(count) <= 1 + count / 5, "{count}: {found}");
        }
    }
}
