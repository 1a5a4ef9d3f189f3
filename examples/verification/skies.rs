//! Skies sampled by their brightness, against sums over all directions.

use crate::report::Report;
use crate::setting::{lumps, medium, ray, scene_of_bounces, spherical, with_lights};
use crate::single_scattering::{Arrival, henyey_greenstein, scattered_once};
use crate::slabs::SKY;
use crate::support::estimate;
use crate::voxels::Voxels;
use curlsmoke::render::environment::Environment;
use curlsmoke::render::light::Light;
use glam::{DVec3, Vec3};
use std::f64::consts::{PI, TAU};

const SIZE: [usize; 2] = [16, 8];
const TURN_DEG: f64 = 33.0;

/// Pixels of a sky: one of them holds a sun.
pub fn pixels() -> Vec<Vec3> {
    (0..SIZE[0] * SIZE[1]).map(|i| Vec3::splat(if i == 37 { 50.0 } else { (i % 5) as f32 * 0.1 })).collect()
}

/// That sky as the renderer has it; the camera does not see it.
pub fn sky() -> Environment {
    Environment::picture(SIZE[0], SIZE[1], pixels(), TURN_DEG as f32, false)
}

/// Radiance from a direction as docs/scene.md has it: the picture's middle is −z, its top +y, longitude grows to the right,
/// the whole is turned about +y, and between the middles of pixels it is bilinear.
fn radiance(pixels: &[Vec3], direction: DVec3) -> f64 {
    let (sin, cos) = TURN_DEG.to_radians().sin_cos();
    let (x, z) = (direction.x * cos - direction.z * sin, direction.x * sin + direction.z * cos);
    let column = (0.5 + x.atan2(-z) / TAU) * SIZE[0] as f64 - 0.5;
    let row = direction.y.clamp(-1.0, 1.0).acos() / PI * SIZE[1] as f64 - 0.5;
    let (column, row) = (column + SIZE[0] as f64, row.clamp(0.0, (SIZE[1] - 1) as f64));
    let at = |i: usize, j: usize| f64::from(pixels[j.min(SIZE[1] - 1) * SIZE[0] + i % SIZE[0]].x);
    let (i, j) = (column as usize, row as usize);
    let (fx, fy) = (column.fract(), row.fract());
    let line = |j: usize| at(i, j) * (1.0 - fx) + at(i + 1, j) * fx;
    line(j) * (1.0 - fy) + line(j + 1) * fy
}

/// Light from `count` · 2 `count` directions of equal solid angle.
fn arrivals(count: usize) -> Vec<(DVec3, f64)> {
    let pixels = pixels();
    let solid_angle = 4.0 * PI / (2 * count * count) as f64;
    let direction = |i: usize| {
        let cosine = 1.0 - 2.0 * ((i / (2 * count)) as f64 + 0.5) / count as f64;
        spherical(cosine, TAU * ((i % (2 * count)) as f64 + 0.5) / (2 * count) as f64)
    };
    (0..2 * count * count).map(direction).map(|d| (d, solid_angle * radiance(&pixels, d))).collect()
}

pub fn rows(report: &mut Report) {
    report.group(
        "Skies sampled by brightness",
        "A picture of 16 by 8 pixels with a sun in one of them, sampled by the light and met by paths, against sums over all \
         directions evenly, without any sampling: half a million for a diffuse ball, where all bounces are in it as it is \
         convex, and twenty thousand for light that smoke scatters once.",
    );
    let ball =
        "shapes: {ball: {sphere: {center: [0, 0, 0], radius: 1}, material: {diffuse: {reflectance: [0.7, 0.7, 0.7]}}}}";
    let directions = arrivals(512);
    let stage =
        with_lights(scene_of_bounces(100, "extinction: 1", &format!("{ball}\n{SKY}")), vec![Light::Environment(sky())]);
    for normal in [DVec3::new(0.0, 0.0, 1.0), DVec3::new(-0.6, 0.64, 0.48), DVec3::new(0.8, -0.6, 0.0)] {
        let lit: f64 = directions.iter().map(|(d, weight)| weight * d.dot(normal).max(0.0)).sum();
        let beam = ray(
            (normal * 3.0 + DVec3::new(0.5, 0.0, 0.2)).to_array(),
            (-normal * 2.0 - DVec3::new(0.5, 0.0, 0.2)).to_array(),
        );
        let found = estimate(&stage, None, 1_000_000, report.seed(), |_| beam);
        report.row(&format!("diffuse ball, normal {normal}"), 0.7 / PI * lit, found);
    }
    let directions = arrivals(100);
    let voxels = Voxels::new([12; 3], 0.1, lumps);
    let beam = ray([0.05, 0.12, 5.0], [0.0, 0.0, -1.0]);
    for g in [0.0, 0.6] {
        let keys = format!("extinction: 2, albedo: [0.8, 0.8, 0.8], phase: {{henyey_greenstein: {{g: {g}}}}}");
        let stage = with_lights(scene_of_bounces(1, &keys, SKY), vec![Light::Environment(sky())]);
        let medium = medium(&stage, voxels.grid());
        let all = |_| {
            let lights = directions.iter();
            lights.map(|&(towards, irradiance)| Arrival { towards, distance: f64::INFINITY, irradiance }).collect()
        };
        let expected = 0.8 * scattered_once(&voxels, 2.0, henyey_greenstein(g), &beam, all);
        let found = estimate(&stage, Some(&medium), 1_000_000, report.seed(), |_| beam);
        report.row(&format!("smoke, one scattering, g = {g}"), expected, found);
    }
    report.end();
}
