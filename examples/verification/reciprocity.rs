//! Light and camera change places.

use crate::report::Report;
use crate::setting::{lumps, medium, scene, spherical_unit, unit};
use crate::support::{Estimate, centered_grid, estimate_each};
use curlsmoke::geometry::embree::Ray;
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::space::WorldPoint;
use glam::{DVec3, Vec3};
use std::f64::consts::TAU;

const SMOKE: &str = "extinction: 6, albedo: [0.9, 0.9, 0.9], phase: {henyey_greenstein: {g: 0.6}}";
const BALL: &str = "shapes: {ball: {sphere: {center: [0.2, 0.1, 0], radius: 0.25}, material: {diffuse: {reflectance: [0.8, 0.8, 0.8]}}}}";

pub fn rows(report: &mut Report) {
    report.group(
        "Light and camera change places",
        "A lumpy cloud with a diffuse ball in it. The flux scattered from direction a into b equals that from −b into −a; what \
         comes from a point at A to one at B, from all around, equals what comes from B to A. Expected is the second, σ is \
         that of the difference.",
    );
    let directions = [
        (DVec3::new(0.3, -0.8, 0.5), DVec3::new(-0.6, 0.1, 0.75)),
        (DVec3::new(0.0, -1.0, 0.1), DVec3::new(0.1, 0.9, -0.3)),
    ];
    for (i, (a, b)) in directions.into_iter().enumerate() {
        let (there, back) = (flux(a, b, 71), flux(-b, -a, 72));
        pair(report, &format!("parallel light, {}", i + 1), there, back);
    }
    let points = [
        (DVec3::new(1.2, 0.3, 0.2), DVec3::new(-0.9, 1.0, 0.4)),
        (DVec3::new(0.0, 1.1, 0.0), DVec3::new(0.3, -1.4, 1.0)),
    ];
    for (i, (a, b)) in points.into_iter().enumerate() {
        let (there, back) = (between(a, b, 73), between(b, a, 74));
        pair(report, &format!("points, {}", i + 1), there, back);
    }
    report.end();
}

fn pair(report: &mut Report, name: &str, there: Estimate, back: Estimate) {
    let standard_error = there.standard_error.hypot(back.standard_error);
    report.row(name, back.mean, Estimate { mean: there.mean, standard_error });
}

fn numbers(seed: u64, block: usize, i: u32) -> [f64; 2] {
    let mut rng = CounterRng::new(Seed(seed).derive(block as u64).derive(u64::from(i)));
    [0, 1].map(|_| f64::from(rng.uniform()))
}

/// Mean radiance along parallel rays all over the cloud's silhouette, lit by parallel light.
fn flux(incoming: DVec3, outgoing: DVec3, seed: u64) -> Estimate {
    let light =
        format!("{{sun: {{direction: [{}, {}, {}], irradiance: [1, 1, 1]}}}}", incoming.x, incoming.y, incoming.z);
    let stage = scene(SMOKE, &format!("{BALL}\nlights: [{light}]"));
    let medium = medium(&stage, centered_grid([12; 3], 0.1, lumps));
    let out = unit(outgoing);
    let (u, v) = out.orthonormal_pair();
    estimate_each(&stage, Some(&medium), 1_500_000, seed, |block, i| {
        let [x, y] = numbers(seed, block, i).map(|u| 2.4 * u as f32 - 1.2);
        Ray { origin: WorldPoint(u * x + v * y + *out * 4.0), direction: -out }
    })
}

/// Mean radiance from all directions at one point, lit by another.
fn between(camera: DVec3, light: DVec3, seed: u64) -> Estimate {
    let light = format!("{{point: {{position: [{}, {}, {}], intensity: [1, 1, 1]}}}}", light.x, light.y, light.z);
    let stage = scene(SMOKE, &format!("{BALL}\nlights: [{light}]"));
    let medium = medium(&stage, centered_grid([12; 3], 0.1, lumps));
    let origin = WorldPoint(Vec3::from_array(camera.as_vec3().to_array()));
    estimate_each(&stage, Some(&medium), 1_500_000, seed, |block, i| {
        let [u, v] = numbers(seed, block, i);
        Ray { origin, direction: spherical_unit(1.0 - 2.0 * u, TAU * v) }
    })
}
