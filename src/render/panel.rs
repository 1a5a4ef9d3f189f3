//! Flat lights: rectangles, parallelograms and disks, sampled evenly over their area.

use crate::geometry::embree::Ray;
use crate::math::space::{UnitVec3, WorldPoint};
use crate::render::color::Rgb;
use crate::render::light::{LightHit, LightSample};
use glam::Vec3;
use std::f32::consts::{FRAC_PI_4, TAU};

/// What a panel looks like from its front.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outline {
    /// A parallelogram with these half edges.
    Rectangle,
    /// The ellipse that touches it: a disk where the half edges are of one length and at right angles.
    Disk,
}

/// A flat light. It shines from the side where `half_u × half_v` points; its back is black unless it is two-sided.
#[derive(Debug, Clone)]
pub struct Panel {
    outline: Outline,
    center: WorldPoint,
    half_u: Vec3,
    half_v: Vec3,
    normal: UnitVec3,
    area: f32,
    radiance: Rgb,
    /// Whether its back shines like its front.
    pub is_two_sided: bool,
    /// Whether camera rays see it.
    pub is_visible: bool,
}

impl Panel {
    /// A panel about `center` with half edges `half_u` and `half_v` [m], one-sided and visible; `None` where it has no
    /// area. Radiance in [W/(m² sr)].
    pub fn try_new(outline: Outline, center: WorldPoint, half_u: Vec3, half_v: Vec3, radiance: Rgb) -> Option<Self> {
        let across = half_u.cross(half_v);
        let normal = UnitVec3::try_new(across)?;
        let filled = match outline {
            Outline::Rectangle => 1.0,
            Outline::Disk => FRAC_PI_4,
        };
        let area = 4.0 * across.length() * filled;
        Some(Self { outline, center, half_u, half_v, normal, area, radiance, is_two_sided: false, is_visible: true })
    }

    /// A disk about `center` of `radius` [m] that faces `normal`; `None` where either has no size.
    pub fn disk(center: WorldPoint, normal: Vec3, radius: f32, radiance: Rgb) -> Option<Self> {
        let (u, v) = UnitVec3::try_new(normal)?.orthonormal_pair();
        Self::try_new(Outline::Disk, center, u * radius, v * radius, radiance)
    }

    /// Middle.
    pub fn center(&self) -> WorldPoint {
        self.center
    }

    /// Radius of a ball about the middle that holds it [m].
    pub fn bounding_radius(&self) -> f32 {
        self.half_u.length() + self.half_v.length()
    }

    /// Area of one side [m²].
    pub fn area(&self) -> f32 {
        self.area
    }

    /// Radiance of what shines [W/(m² sr)].
    pub fn radiance(&self) -> Rgb {
        self.radiance
    }

    /// Distance of a point from the plane, > 0 where the light shines [m].
    pub fn height(&self, p: WorldPoint) -> f32 {
        let height = (p - self.center).dot(*self.normal);
        if self.is_two_sided { height.abs() } else { height }
    }

    /// Where a ray meets it, from either side.
    pub fn intersect(&self, ray: &Ray) -> Option<LightHit> {
        let cosine = -self.normal.dot(*ray.direction);
        let t = (ray.origin - self.center).dot(*self.normal) / cosine;
        if !t.is_finite() || t <= 1e-6 {
            return None;
        }
        let p = ray.at(t) - self.center;
        // The edges may be oblique: solve for the coordinates along them.
        let n = self.half_u.cross(self.half_v);
        let u = p.cross(self.half_v).dot(n) / n.length_squared();
        let v = self.half_u.cross(p).dot(n) / n.length_squared();
        let is_outside = match self.outline {
            Outline::Rectangle => u.abs() > 1.0 || v.abs() > 1.0,
            Outline::Disk => u * u + v * v > 1.0,
        };
        if is_outside {
            return None;
        }
        let cosine = if self.is_two_sided { cosine.abs() } else { cosine };
        let is_front = cosine > 0.0;
        Some(LightHit {
            t,
            radiance: if is_front { self.radiance } else { Vec3::ZERO },
            pdf: if is_front { t * t / (cosine * self.area) } else { 0.0 },
        })
    }

    /// A direction to a point even over the area; `None` where its black side is seen.
    pub fn sample(&self, from: WorldPoint, u: [f32; 2]) -> Option<LightSample> {
        let [x, y] = match self.outline {
            Outline::Rectangle => [2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0],
            Outline::Disk => {
                let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
                let r = u[0].sqrt();
                [r * cos_phi, r * sin_phi]
            }
        };
        let p = self.center + self.half_u * x + self.half_v * y;
        let offset = p - from;
        let direction = UnitVec3::try_new(offset)?;
        let cosine = -self.normal.dot(*direction);
        let cosine = if self.is_two_sided { cosine.abs() } else { cosine };
        if cosine <= 0.0 {
            return None;
        }
        let distance = offset.length();
        let pdf = distance * distance / (cosine * self.area);
        Some(LightSample { direction, distance, weight: self.radiance / pdf, pdf: Some(pdf) })
    }
}
