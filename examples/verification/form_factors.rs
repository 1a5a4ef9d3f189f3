//! Surfaces and lights whose exchange has a closed form.

use crate::report::Report;
use crate::setting::{ray, unit};
use crate::support::{Stage, estimate, estimate_each, stage};
use curlsmoke::geometry::embree::Ray;
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::space::WorldPoint;
use glam::DVec3;
use std::f64::consts::PI;

/// Irradiance over radiance of a ball of `radius` at `distance`, seen by an element whose normal is `cosine` from it: whole
/// above its horizon, or partly (Snyder 1996, *Area light sources for real-time graphics*).
fn ball_over_element(radius: f64, distance: f64, cosine: f64) -> f64 {
    let h = distance / radius;
    if h * cosine > 1.0 {
        return PI * cosine / (h * h);
    }
    let sine = (1.0 - cosine * cosine).sqrt();
    let x = (h * h - 1.0).sqrt();
    let y = -x * cosine / sine;
    let rise = sine * (1.0 - y * y).max(0.0).sqrt();
    (cosine * y.acos() - x * rise) / (h * h) + (rise / x).atan()
}

/// Irradiance over radiance of a polygon above an element's horizon (Lambert 1760, as in Baum, Rushmeier and Winget 1989).
fn polygon_over_element(p: DVec3, normal: DVec3, corners: &[DVec3]) -> f64 {
    let edge = |i: usize| {
        let (a, b) = ((corners[i] - p).normalize(), (corners[(i + 1) % corners.len()] - p).normalize());
        a.dot(b).clamp(-1.0, 1.0).acos() * a.cross(b).normalize().dot(normal)
    };
    0.5 * (0..corners.len()).map(edge).sum::<f64>().abs()
}

/// Share of what a rectangle sends out that meets an equal one face to face (Howell, *A catalog of radiation heat transfer
/// configuration factors*, C-11); edges over distance.
fn facing_rectangles(x: f64, y: f64) -> f64 {
    let (x2, y2) = (1.0 + x * x, 1.0 + y * y);
    let logarithm = 0.5 * (x2 * y2 / (1.0 + x * x + y * y)).ln();
    let arcs = x * y2.sqrt() * (x / y2.sqrt()).atan() + y * x2.sqrt() * (y / x2.sqrt()).atan();
    2.0 / (PI * x * y) * (logarithm + arcs - x * x.atan() - y * y.atan())
}

const FLOOR: &str = "floor: {plane: {point: [0, 0, 0]}, material: {diffuse: {reflectance: [0.6, 0.6, 0.6]}}}";
const BALL: &str =
    "ball: {sphere: {center: [0, 0, 0], radius: 1}, material: {diffuse: {reflectance: [0.6, 0.6, 0.6]}}}";

fn lit(shape: &str, light: &str) -> Stage {
    stage(&format!("camera: {{position: [0, 3, 5], look_at: [0, 0, 0]}}\nshapes: {{{shape}}}\nlights: [{light}]"))
}

pub fn rows(report: &mut Report) {
    report.group(
        "Surfaces in light of a known shape",
        "A diffuse floor or ball of reflectance 0.6. Balls over an element after Snyder, also where the horizon cuts them; \
         rectangles after Lambert; the mean over a square from one face to face with it by the form factor; points and \
         suns by their cosines.",
    );
    let seen = 0.6 / PI;
    let floor_beam = |x: f64| ray([x - 0.5, 1.0, 3.0], [0.5, -1.0, -3.0]);
    let ball_light = "{sphere: {center: [0, 1.2, 0], radius: 0.4, radiance: [3, 3, 3]}}";
    let stage = lit(FLOOR, ball_light);
    for x in [0.0, 1.0, 4.0] {
        let d = f64::hypot(x, 1.2);
        let expected = seen * 3.0 * ball_over_element(0.4, d, 1.2 / d);
        let found = estimate(&stage, None, 400_000, report.seed(), |_| floor_beam(x));
        report.row(&format!("floor, ball above, {x} m aside"), expected, found);
    }
    let stage = lit(FLOOR, "{sphere: {center: [0, 0.1, 0], radius: 0.4, radiance: [3, 3, 3]}}");
    for x in [0.6, 2.0] {
        let d = f64::hypot(x, 0.1);
        let expected = seen * 3.0 * ball_over_element(0.4, d, 0.1 / d);
        let found = estimate(&stage, None, 400_000, report.seed(), |_| floor_beam(x));
        report.row(&format!("floor, ball cut by it, {x} m aside"), expected, found);
    }
    let stage = lit(BALL, "{sphere: {center: [0, 3, 0], radius: 1.2, radiance: [3, 3, 3]}}");
    for angle_deg in [0.0f64, 45.0, 70.0, 90.0] {
        let (sine, cosine) = angle_deg.to_radians().sin_cos();
        let normal = DVec3::new(0.0, cosine, sine);
        let to_light = DVec3::new(0.0, 3.0, 0.0) - normal;
        let d = to_light.length();
        let expected = seen * 3.0 * ball_over_element(1.2, d, normal.dot(to_light) / d);
        // From the side, so that the light is not in the way.
        let from = normal + DVec3::new(2.0, 0.5 * cosine, 2.0 * sine);
        let beam = ray(from.to_array(), (normal - from).to_array());
        let found = estimate(&stage, None, 400_000, report.seed(), |_| beam);
        report.row(&format!("ball under a larger ball, {angle_deg}° from its top"), expected, found);
    }
    rectangles(report, seen, floor_beam);
    for (name, light, expected) in [
        ("point", "{point: {position: [0, 1.2, 0], intensity: [3, 3, 3]}}", 3.0 * 1.2 / f64::hypot(0.7, 1.2).powi(3)),
        ("sun", "{sun: {direction: [3, -4, 0], irradiance: [3, 3, 3]}}", 3.0 * 0.8),
    ] {
        let found = estimate(&lit(FLOOR, light), None, 100_000, report.seed(), |_| floor_beam(0.7));
        report.row(&format!("floor, {name}"), seen * expected, found);
    }
    report.end();
}

fn rectangles(report: &mut Report, seen: f64, floor_beam: impl Fn(f64) -> Ray + Sync) {
    let oblique = "{rectangle: {center: [0, 1.2, 0], half_u: [0.5, 0.2, 0], half_v: [0, 0, 0.7], radiance: [3, 3, 3]}}";
    let (u, v, center) = (DVec3::new(0.5, 0.2, 0.0), DVec3::new(0.0, 0.0, 0.7), DVec3::new(0.0, 1.2, 0.0));
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(a, b)| center + u * a + v * b);
    let stage = lit(FLOOR, oblique);
    for x in [0.0, 0.8] {
        let expected = seen * 3.0 * polygon_over_element(DVec3::new(x, 0.0, 0.0), DVec3::Y, &corners);
        let found = estimate(&stage, None, 400_000, report.seed(), |_| floor_beam(x));
        report.row(&format!("floor, oblique rectangle, {x} m aside"), expected, found);
    }
    let facing = "{rectangle: {center: [0, 1, 0], half_u: [0.5, 0, 0], half_v: [0, 0, 0.5], radiance: [3, 3, 3]}}";
    let stage = lit(FLOOR, facing);
    // Each path looks at its own place of the square, obliquely from below the light.
    let found = estimate_each(&stage, None, 1_000_000, report.seed(), |block, i| {
        let mut rng = CounterRng::new(Seed(57).derive(block as u64).derive(u64::from(i)));
        let place = DVec3::new(f64::from(rng.uniform()) - 0.5, 0.0, f64::from(rng.uniform()) - 0.5);
        let towards = DVec3::new(0.3, -1.0, 0.2);
        Ray { origin: WorldPoint((place - towards * 0.5).as_vec3()), direction: unit(towards) }
    });
    report.row("floor, square above a square, mean", 0.6 * 3.0 * facing_rectangles(1.0, 1.0), found);
}
