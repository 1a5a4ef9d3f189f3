//! How much light layers of smoke send back and let through.

use crate::adding_doubling::Layer;
use crate::report::Report;
use crate::setting::{grey, medium, ray, scene, with_lights};
use crate::support::{Stage, centered_grid, estimate};
use curlsmoke::render::environment::Environment;
use curlsmoke::render::light::Light;
use glam::Vec3;

/// Published for τ = 2, ω = 0.9, g = 0.75 and light straight from above: van de Hulst 1980, table 35, as in Wang, Jacques
/// and Zheng 1995, *MCML — Monte Carlo modeling of light transport in multi-layered tissues*, table 1.
const PUBLISHED: [f64; 2] = [0.09739, 0.66096];

/// The lights of a scene that gets others.
pub const SKY: &str = "lights: [{environment: {radiance: [1, 1, 1]}}]";

/// A scene with radiance 1 from above alone, or from below alone.
pub fn half_sky(medium: &str, is_above: bool) -> Stage {
    // So many rows that the blend of two of them at the horizon, where next to no light comes from, does not matter.
    const ROWS: usize = 4096;
    let radiance = |row: usize| Vec3::splat(f32::from(u8::from((row < ROWS / 2) == is_above)));
    let pixels = (0..ROWS).map(radiance).collect();
    with_lights(scene(medium, SKY), vec![Light::Environment(Environment::picture(1, ROWS, pixels, 0.0, true))])
}

pub fn rows(report: &mut Report) {
    report.group(
        "Layers",
        "Reflectance and transmittance of a layer, scattered and straight, for light arriving along μ: by reciprocity what is \
         seen along μ under a sky of radiance 1 on the one side or the other. Published: van de Hulst's of τ = 2, ω = 0.9, \
         g = 0.75 as MCML's paper quotes them. All others by doubling of layers in f64, 48 directions a half sphere, which \
         gives those published to all five digits. The smoke is two voxels thick and 512 wide.",
    );
    let own = Layer::new(2.0, 0.9, 0.75);
    for (own, published) in [own.reflectance(1.0), own.transmittance(1.0)].into_iter().zip(PUBLISHED) {
        assert!((own - published).abs() < 6e-6, "doubling gives {own}, published is {published}");
    }
    layer(report, "published", [2.0, 0.9, 0.75, 1.0], PUBLISHED);
    for [tau, albedo, g] in [[1.0, 0.8, 0.0], [4.0, 0.99, 0.0], [1.0, 0.95, 0.75], [4.0, 0.9, -0.5], [16.0, 0.99, 0.9]]
    {
        let own = Layer::new(tau, albedo, g);
        for mu in [1.0, 0.5] {
            layer(report, "doubling", [tau, albedo, g, mu], [own.reflectance(mu), own.transmittance(mu)]);
        }
    }
    report.end();
}

fn layer(report: &mut Report, source: &str, [tau, albedo, g, mu]: [f64; 4], expected: [f64; 2]) {
    let keys = format!("extinction: {}, albedo: {}, phase: {{henyey_greenstein: {{g: {g}}}}}", tau / 2.0, grey(albedo));
    let sine = (1.0 - mu * mu).sqrt();
    let back = 2.0 / mu;
    let beam = ray([0.3 - back * sine, 2.0, 0.2], [sine, -mu, 0.0]);
    for (is_above, what, expected) in [(true, "reflected", expected[0]), (false, "let through", expected[1])] {
        let stage = half_sky(&keys, is_above);
        let medium = medium(&stage, centered_grid([512, 2, 512], 1.0, |_| 1.0));
        let found = estimate(&stage, Some(&medium), 600_000, report.seed(), |_| beam);
        report.row(&format!("{source}: {what}, τ = {tau}, ω = {albedo}, g = {g}, μ = {mu}"), expected, found);
    }
}
