//! Half spaces of smoke that scatters alike in all directions (Chandrasekhar 1960, *Radiative Transfer*).

use crate::gauss;
use crate::report::Report;
use crate::setting::{grey, medium, ray, scene};
use crate::slabs::half_sky;
use crate::support::{centered_grid, estimate};
use std::f64::consts::PI;

/// Chandrasekhar's H function at `mu` for single-scattering albedo `albedo` (§37): 1/H = √(1 − ω) + ω/2 ∫ x H(x)/(μ + x) dx,
/// the form of the equation that converges for every albedo.
pub fn h(albedo: f64, mu: f64) -> f64 {
    let nodes = gauss::nodes(128, 0.0, 1.0);
    let value = |h: &[f64], mu: f64| {
        let sum: f64 = nodes.iter().zip(h).map(|((x, w), h)| w * x * h / (mu + x)).sum();
        1.0 / ((1.0 - albedo).sqrt() + 0.5 * albedo * sum)
    };
    let mut values = vec![1.0; nodes.len()];
    for _ in 0..2000 {
        let next: Vec<f64> = nodes.iter().map(|(x, _)| value(&values, *x)).collect();
        let change = next.iter().zip(&values).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        values = next;
        if change < 1e-14 {
            break;
        }
    }
    value(&values, mu)
}

pub fn rows(report: &mut Report) {
    report.group(
        "Half spaces after Chandrasekhar",
        "Isotropic scattering. Parallel light of irradiance F at μ₀ leaves along μ with radiance ω F/4π · μ₀/(μ + μ₀) · H(μ) \
         H(μ₀); under a sky of radiance 1, what is seen along μ is the plane albedo 1 − √(1 − ω) H(μ). H is iterated \
         here. The smoke is 256 mean free paths wide and 128 deep.",
    );
    for albedo in [0.5, 0.9, 0.99] {
        for (mu0, mu) in [(0.6f64, 1.0f64), (0.6, 0.3), (0.2, 0.8)] {
            let sine = (1.0 - mu0 * mu0).sqrt();
            let stage = scene(
                &format!("extinction: 4, albedo: {}", grey(albedo)),
                &format!("lights: [{{sun: {{direction: [{sine}, {}, 0], irradiance: [2, 2, 2]}}}}]", -mu0),
            );
            let medium = medium(&stage, centered_grid([64, 32, 64], 1.0, |_| 1.0));
            let expected = albedo * 2.0 / (4.0 * PI) * mu0 / (mu + mu0) * h(albedo, mu) * h(albedo, mu0);
            let found = estimate(&stage, Some(&medium), 400_000, report.seed(), |_| down(mu));
            report.row(&format!("sun, ω = {albedo}, μ₀ = {mu0}, μ = {mu}"), expected, found);
        }
        let mu = 0.5;
        let stage = half_sky(&format!("extinction: 4, albedo: {}", grey(albedo)), true);
        let medium = medium(&stage, centered_grid([64, 32, 64], 1.0, |_| 1.0));
        let expected = 1.0 - (1.0 - albedo).sqrt() * h(albedo, mu);
        let found = estimate(&stage, Some(&medium), 400_000, report.seed(), |_| down(mu));
        report.row(&format!("sky, ω = {albedo}, μ = {mu}"), expected, found);
    }
    report.end();
}

/// A ray that enters the top of smoke near its middle, with `mu` the cosine between it and straight down.
fn down(mu: f64) -> curlsmoke::geometry::embree::Ray {
    let (sine, turn) = ((1.0 - mu * mu).sqrt(), 0.7f64);
    let direction = [sine * turn.cos(), -mu, sine * turn.sin()];
    // Smoke begins half a voxel above the top at 16 m.
    let back = 2.0 / mu;
    ray([0.3 - back * direction[0], 16.5 + 2.0, -0.2 - back * direction[2]], direction)
}
