//! Lambert's law: light that is reflected alike in all directions.

use crate::math::circle::on_circle;
use crate::math::space::UnitVec3;
use crate::render::bsdf::BsdfSample;
use crate::render::color::Rgb;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Scattering function times the cosine [1/sr].
#[inline]
pub fn value(reflectance: Rgb, normal: UnitVec3, outgoing: UnitVec3) -> Rgb {
    reflectance * (normal.dot(*outgoing).max(0.0) * FRAC_1_PI)
}

/// Density [1/sr] with which [`sample`] returns `outgoing`.
#[inline]
pub fn pdf(normal: UnitVec3, outgoing: UnitVec3) -> f32 {
    normal.dot(*outgoing).max(0.0) * FRAC_1_PI
}

/// A direction in proportion to the value.
#[inline]
pub fn sample(reflectance: Rgb, normal: UnitVec3, u: [f32; 2]) -> BsdfSample {
    let local = cosine_direction(u);
    BsdfSample { direction: normal.from_local(local), pdf: Some(local.z * FRAC_1_PI), weight: reflectance }
}

/// A direction about the third axis with density cosine/π.
#[inline]
pub fn cosine_direction(u: [f32; 2]) -> Vec3 {
    let cosine = (1.0 - u[0]).sqrt();
    (u[0].sqrt() * on_circle(u[1])).extend(cosine)
}
