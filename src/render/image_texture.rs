//! Pictures on surfaces, and how they are laid on.

use crate::render::color::Rgb;
use crate::render::picture::{Beyond, Picture};
use glam::{DMat3, DVec3, Vec3};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// A picture laid on surfaces.
#[derive(Debug, Clone)]
pub struct ImageTexture {
    /// The picture.
    pub picture: Arc<Picture>,
    /// How it is laid on.
    pub projection: Projection,
    /// Factor on its colours.
    pub scale: f32,
}

/// How a picture is laid on surfaces.
#[derive(Debug, Clone, PartialEq)]
pub enum Projection {
    /// By longitude and latitude about a point, as on a globe.
    LatLong(LatLong),
    /// From three sides, each where surfaces face it.
    Triplanar(Triplanar),
    /// From one side.
    Planar(Planar),
}

/// Longitude and latitude: the picture's top is north, its middle the prime meridian; east is to the right as seen from
/// outside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LatLong {
    center: DVec3,
    /// Rows: to the east of the prime meridian, north, to the prime meridian.
    axes: DMat3,
}

/// Tiles along the axes, blended by the normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triplanar {
    /// Width of a tile [m], > 0.
    pub tile: f64,
    /// A corner of a tile [m].
    pub offset: DVec3,
    /// Power of the normal's parts that are the weights, >= 1.
    pub sharpness: f64,
}

/// A rectangle that the picture covers, repeated round it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Planar {
    center: DVec3,
    /// What u and v grow by in a metre [1/m].
    u: DVec3,
    v: DVec3,
}

impl LatLong {
    /// About `center` [m], the north pole along `north`; the prime meridian along +z, where that is no pole, turned to the
    /// east by `turn_deg`. The direction of length 0 is taken for +y.
    pub fn new(center: DVec3, north: DVec3, turn_deg: f64) -> Self {
        let north = north.normalize_or(DVec3::Y);
        let prime = north.cross(DVec3::Z).cross(north);
        let prime = if prime.length() > 1e-6 { prime.normalize() } else { north.any_orthonormal_vector() };
        let east = north.cross(prime);
        let (sin, cos) = turn_deg.to_radians().sin_cos();
        let axes = DMat3::from_cols(east * cos - prime * sin, north, prime * cos + east * sin).transpose();
        Self { center, axes }
    }

    /// Place in the picture, from its upper left corner.
    fn place(&self, p: DVec3) -> (f64, f64) {
        let d = self.axes * (p - self.center);
        let length = d.length();
        if length == 0.0 {
            return (0.5, 0.5);
        }
        (0.5 + d.x.atan2(d.z) / TAU, (d.y / length).clamp(-1.0, 1.0).acos() / PI)
    }
}

impl Triplanar {
    /// Shares of the pictures along x, y and z where the surface has a normal, of any length but 0: they add up to 1, and
    /// change smoothly.
    pub fn weights(&self, normal: DVec3) -> DVec3 {
        let sides = normal.abs() / normal.abs().max_element();
        let powers = DVec3::from_array(sides.to_array().map(|x| x.powf(self.sharpness)));
        let weights = powers / powers.element_sum();
        if weights.is_finite() { weights } else { DVec3::Y }
    }

    /// Places in the picture as seen along x, y and z, mirrored where it is seen from behind: writing stays legible.
    fn places(&self, p: DVec3, normal: DVec3, aspect: f64) -> [(f64, f64); 3] {
        let DVec3 { x, y, z } = (p - self.offset) / self.tile;
        let facing = |n: f64| if n < 0.0 { -1.0 } else { 1.0 };
        // Rows of pictures go down.
        let down = |v: f64| -v * aspect;
        [(-z * facing(normal.x), down(y)), (x, down(-z * facing(normal.y))), (x * facing(normal.z), down(y))]
    }
}

impl Planar {
    /// The picture's middle at `center`, its right edge `half_u` from there, its upper edge `half_v` [m].
    pub fn new(center: DVec3, half_u: DVec3, half_v: DVec3) -> Self {
        Self { center, u: 0.5 * half_u / half_u.length_squared(), v: 0.5 * half_v / half_v.length_squared() }
    }

    fn place(&self, p: DVec3) -> (f64, f64) {
        let from_center = p - self.center;
        (0.5 + self.u.dot(from_center), 0.5 - self.v.dot(from_center))
    }
}

impl ImageTexture {
    /// The colour at a point [m] where the surface has a normal of any length but 0.
    pub fn at(&self, p: DVec3, normal: impl FnOnce() -> DVec3) -> Rgb {
        let again = |(u, v)| self.picture.at(u, v, Beyond::Again, Beyond::Again);
        let color = match &self.projection {
            Projection::LatLong(globe) => {
                let (u, v) = globe.place(p);
                self.picture.at(u, v, Beyond::Again, Beyond::Edge)
            }
            Projection::Planar(planar) => again(planar.place(p)),
            Projection::Triplanar(tiles) => {
                let normal = normal();
                let weights = tiles.weights(normal).to_array();
                let aspect = self.picture.width as f64 / self.picture.height as f64;
                let sides = tiles.places(p, normal, aspect).into_iter().zip(weights);
                let seen = sides.filter(|(_, weight)| *weight > 0.0);
                seen.fold(Vec3::ZERO, |sum, (place, weight)| sum + again(place) * weight as f32)
            }
        };
        color * self.scale
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};

    /// Each pixel of another colour.
    fn picture(width: usize, height: usize) -> Arc<Picture> {
        let color = |i: usize| Vec3::new((i % width) as f32, (i / width) as f32, 1.0);
        Arc::new(Picture { width, height, pixels: (0..width * height).map(color).collect() })
    }

    fn texture(projection: Projection, width: usize, height: usize) -> ImageTexture {
        ImageTexture { picture: picture(width, height), projection, scale: 1.0 }
    }

    #[test]
    fn known_pixels_are_seen_in_known_directions() {
        let center = DVec3::new(1.0, 2.0, 3.0);
        let globe = texture(Projection::LatLong(LatLong::new(center, DVec3::Y, 0.0)), 5, 3);
        let seen = |direction: DVec3| globe.at(center + direction * 0.7, || unreachable!());
        // The middle towards +z, east to the right of who looks at it from there: towards +x.
        assert!((seen(DVec3::Z) - Vec3::new(2.0, 1.0, 1.0)).length() < 1e-6);
        let fifth = TAU / 5.0;
        for (column, angle) in [(3.0, fifth), (4.0, 2.0 * fifth), (0.0, -2.0 * fifth), (1.0, -fifth)] {
            let found = seen(DVec3::new(angle.sin(), 0.0, angle.cos()));
            assert!((found - Vec3::new(column, 1.0, 1.0)).length() < 1e-6, "{column}: {found}");
        }
        assert!((seen(DVec3::new(0.0, 5.0, 0.001)).y, seen(DVec3::NEG_Y).y) == (0.0, 2.0));
        // Turned by a quarter, the prime meridian is where east was; north is where it is told to be.
        let turned = texture(Projection::LatLong(LatLong::new(center, DVec3::Y, 90.0)), 5, 3);
        assert!((turned.at(center + DVec3::X, || unreachable!()) - Vec3::new(2.0, 1.0, 1.0)).length() < 1e-6);
        let tilted = texture(Projection::LatLong(LatLong::new(center, DVec3::X, 0.0)), 5, 3);
        assert_eq!(tilted.at(center + DVec3::X, || unreachable!()).y, 0.0);
        assert!((tilted.at(center + DVec3::Z, || unreachable!()) - Vec3::new(2.0, 1.0, 1.0)).length() < 1e-6);
    }

    #[test]
    fn a_globe_has_no_seam_and_its_poles_are_of_the_first_and_last_row() {
        let globe = texture(Projection::LatLong(LatLong::new(DVec3::ZERO, DVec3::Y, 0.0)), 8, 4);
        for height in [-0.9, 0.0, 0.5] {
            let [east, west] = [1e-7, -1e-7].map(|x| globe.at(DVec3::new(x, height, -1.0), || unreachable!()));
            assert!((east - west).length() < 1e-4, "{east} {west}");
        }
        for (pole, row) in [(DVec3::Y, 0.0), (DVec3::NEG_Y, 3.0)] {
            assert_eq!(globe.at(pole, || unreachable!()).y, row);
        }
        assert!(globe.at(DVec3::ZERO, || unreachable!()).is_finite());
    }

    #[test]
    fn weights_of_three_sides_add_up_to_one_and_a_face_has_one_picture_alone() {
        let mut rng = CounterRng::new(Seed(8));
        for sharpness in [1.0, 4.0, 64.0] {
            let tiles = Triplanar { tile: 0.4, offset: DVec3::ZERO, sharpness };
            let texture = texture(Projection::Triplanar(tiles), 6, 3);
            for _ in 0..500 {
                let mut unit = || f64::from(rng.uniform()) * 2.0 - 1.0;
                let (normal, p) = (DVec3::new(unit(), unit(), unit()), DVec3::new(unit(), unit(), unit()));
                let weights = tiles.weights(normal);
                assert!((weights.element_sum() - 1.0).abs() < 1e-12 && weights.min_element() >= 0.0);
                // On a face the picture lies as one that is laid on from there.
                let half = |right: DVec3, up: DVec3| (right * 0.2, up * 0.1);
                for (face, (u, v)) in [
                    (DVec3::Z, half(DVec3::X, DVec3::Y)),
                    (DVec3::NEG_Z, half(DVec3::NEG_X, DVec3::Y)),
                    (DVec3::X, half(DVec3::NEG_Z, DVec3::Y)),
                    (DVec3::NEG_X, half(DVec3::Z, DVec3::Y)),
                    (DVec3::Y, half(DVec3::X, DVec3::NEG_Z)),
                    (DVec3::NEG_Y, half(DVec3::X, DVec3::Z)),
                ] {
                    assert!(u.cross(v).dot(face) > 0.0, "seen from outside, right is right");
                    let plane =
                        ImageTexture { projection: Projection::Planar(Planar::new(u + v, u, v)), ..texture.clone() };
                    let (a, b) = (texture.at(p, || face), plane.at(p, || unreachable!()));
                    assert!((a - b).length() < 1e-4, "{face} at {p}: {a} {b}");
                }
            }
            // Where a normal's part changes its sign the mirrored picture has no weight.
            let [a, b] = [1e-9, -1e-9].map(|x| texture.at(DVec3::new(0.1, 0.23, 0.4), || DVec3::new(x, 0.5, 0.6)));
            assert!((a - b).length() < 1e-6, "{a} {b}");
        }
        assert_eq!(Triplanar { tile: 1.0, offset: DVec3::ZERO, sharpness: 4.0 }.weights(DVec3::ZERO), DVec3::Y);
    }
}
