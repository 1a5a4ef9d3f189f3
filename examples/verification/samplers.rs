//! Every sampler against its density.

use crate::report::Report;
use crate::setting::{spherical_unit, unit};
use crate::single_scattering::henyey_greenstein;
use crate::skies;
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::space::{UnitVec3, WorldPoint};
use curlsmoke::math::statistics::chi_square_test;
use curlsmoke::render::ball::Ball;
use curlsmoke::render::bsdf::Bsdf;
use curlsmoke::render::filter::Filter;
use curlsmoke::render::light::Light;
use curlsmoke::render::panel::{Outline, Panel};
use curlsmoke::render::phase::{Lobe, Phase};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

const SAMPLES: usize = 1_000_000;
/// Cells of the sphere by the cosine with +y and by longitude.
const CELLS: [usize; 2] = [16, 32];
/// Points along each side of a cell where the density is taken.
const POINTS: usize = 64;

pub fn rows(report: &mut Report) {
    report.sampler_group(
        "Samplers",
        "Counts in cells of the sphere (or of the pixel's surroundings) against the integral of the density over each cell, by \
         Pearson's chi-square: p is the chance of counts so far off. The densities of phase functions, of diffuse surfaces, \
         of lights and of the film's filter are written here again in f64; that of the sky is its own, which other \
         samplers are weighed against, so that it must be true. The film's filter is taken in cells of equal weight: the sampler \
         spreads the window's first and last thousandth evenly, which finer cells would show.",
    );
    let before = unit(DVec3::new(0.3, -0.5, 0.8));
    let axis = before.as_vec3().as_dvec3();
    for g in [-0.8, 0.0, 0.0005, 0.5, 0.9] {
        let phase = Phase::HenyeyGreenstein { g: g as f32 };
        let density = henyey_greenstein(g);
        sphere(
            report,
            &format!("Henyey–Greenstein, g = {g}"),
            |u| Some(phase.sample(before, u).direction),
            |d| density(axis.dot(d)),
        );
    }
    let [narrow, wide] = [0.8, -0.3].map(henyey_greenstein);
    let two = Phase::two_lobes([0.8, -0.3], 0.7);
    sphere(
        report,
        "two lobes, g = 0.8 and −0.3",
        |u| Some(two.sample(before, u).direction),
        |d| 0.7 * narrow(axis.dot(d)) + 0.3 * wide(axis.dot(d)),
    );
    // Draine 2003, equation 9.
    let (g, alpha) = (0.5, 20.0);
    let draine = Phase::Mixture { lobes: [Lobe::Draine { g: g as f32, alpha: alpha as f32 }; 2], share: 0.4 };
    let base = henyey_greenstein(g);
    sphere(
        report,
        "Draine, g = 0.5, α = 20",
        |u| Some(draine.sample(before, u).direction),
        |d| {
            let c: f64 = axis.dot(d);
            base(c) * (1.0 + alpha * c * c) / (1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0)
        },
    );
    let diffuse = Bsdf::Diffuse { reflectance: Vec3::splat(0.5) };
    sphere(
        report,
        "diffuse surface",
        |u| diffuse.sample(before, -before, [u[0], u[1], 0.5]).map(|s| s.direction),
        |d| axis.dot(d).max(0.0) / PI,
    );
    let sky = skies::sky();
    let own = |d: DVec3| f64::from(sky.pdf(unit(d)));
    sphere(report, "sky", |u| Some(sky.sample(u).direction), own);
    lights(report);
    filters(report);
    report.end();
}

fn lights(report: &mut Report) {
    let from = WorldPoint::new(0.2, 0.3, 0.1);
    let center = DVec3::new(0.9, 1.0, -0.4);
    let near = Light::Ball(Ball::new(WorldPoint(center.as_vec3()), 0.8, Vec3::ONE));
    let offset = center - from.0.as_dvec3();
    let cosine_max = (1.0 - 0.64 / offset.length_squared()).sqrt();
    let towards = |light: &Light, from: WorldPoint, u: [f32; 2]| light.sample(from, u).map(|s| s.direction);
    // Even over the cone under which it is seen.
    sphere(
        report,
        "ball from outside",
        |u| towards(&near, from, u),
        |d| {
            if d.dot(offset.normalize()) > cosine_max { 1.0 / (TAU * (1.0 - cosine_max)) } else { 0.0 }
        },
    );
    let inside = WorldPoint((center + DVec3::new(0.3, -0.2, 0.1)).as_vec3());
    sphere(report, "ball from inside", |u| towards(&near, inside, u), |_| 0.25 / PI);
    let (u, v) = (DVec3::new(0.8, 0.1, 0.0), DVec3::new(0.2, 0.0, 0.9));
    let middle = DVec3::new(0.4, 0.9, 0.0);
    let rectangle =
        Panel::try_new(Outline::Rectangle, WorldPoint(middle.as_vec3()), u.as_vec3(), v.as_vec3(), Vec3::ONE);
    let rectangle = Light::Panel(rectangle.expect("it has an area"));
    // Even over its area: distance squared over cosine and area, per solid angle.
    let across = u.cross(v);
    let origin = from.0.as_dvec3();
    sphere(
        report,
        "rectangle",
        |u| towards(&rectangle, from, u),
        |d| {
            let t = (middle - origin).dot(across) / d.dot(across);
            let p = origin + d * t - middle;
            let (a, b) = (p.cross(v).dot(across), u.cross(p).dot(across));
            let is_met = t > 0.0 && a.abs().max(b.abs()) <= across.length_squared();
            if is_met { t * t * across.length() / (d.dot(across).abs() * 4.0 * across.length()) } else { 0.0 }
        },
    );
}

/// A sampler of directions from two uniform numbers against a density per solid angle.
fn sphere(
    report: &mut Report,
    name: &str,
    sample: impl Fn([f32; 2]) -> Option<UnitVec3> + Sync,
    density: impl Fn(DVec3) -> f64 + Sync,
) {
    let [rows, columns] = CELLS;
    let cell = |d: UnitVec3| {
        let row = ((1.0 - f64::from(d.y)) * 0.5 * rows as f64) as usize;
        let turn = f64::from(d.z).atan2(f64::from(d.x)) / TAU;
        row.min(rows - 1) * columns + ((turn.rem_euclid(1.0) * columns as f64) as usize).min(columns - 1)
    };
    let mut rng = CounterRng::new(Seed(81));
    let mut counts = vec![0.0; rows * columns];
    for _ in 0..SAMPLES {
        if let Some(direction) = sample([rng.uniform(), rng.uniform()]) {
            counts[cell(direction)] += 1.0;
        }
    }
    let expected: Vec<f64> = (0..rows * columns)
        .into_par_iter()
        .map(|i| {
            let (row, column) = (i / columns, i % columns);
            let point = |k: usize| {
                let [down, right] = [k / POINTS, k % POINTS].map(|n| (n as f64 + 0.5) / POINTS as f64);
                let cosine = 1.0 - 2.0 * (row as f64 + down) / rows as f64;
                let longitude = TAU * (column as f64 + right) / columns as f64;
                density(spherical_unit(cosine, longitude).as_vec3().as_dvec3())
            };
            let mean = (0..POINTS * POINTS).map(point).sum::<f64>() / (POINTS * POINTS) as f64;
            mean * 4.0 * PI / (rows * columns) as f64 * SAMPLES as f64
        })
        .collect();
    report.sampler(name, SAMPLES, rows * columns, chi_square_test(&counts, &expected));
}

fn filters(report: &mut Report) {
    // The integral of the four-term window over [0, x], which is 1 wide.
    let window = |x: f64| {
        let [a0, a1, a2, a3] = [0.35875, -0.48829, 0.14128, -0.01168];
        let wave = |a: f64, k: f64| a * (TAU * k * x).sin() / (TAU * k);
        (a0 * x + wave(a1, 1.0) + wave(a2, 2.0) + wave(a3, 3.0)) / a0
    };
    plane(report, "film, Blackman–Harris", &Filter::blackman_harris(1.5), 1.5, window);
    plane(report, "film, box", &Filter::Box { radius: 0.5 }, 0.5, |x| x);
}

/// A filter of half-width `radius` against the integral of its window, which is separable: in cells of equal weight.
fn plane(report: &mut Report, name: &str, filter: &Filter, radius: f64, integral: impl Fn(f64) -> f64) {
    const SIDE: usize = 32;
    let mut rng = CounterRng::new(Seed(82));
    let mut counts = vec![0.0; SIDE * SIDE];
    for _ in 0..SAMPLES {
        let p = filter.sample([rng.uniform(), rng.uniform()]);
        let cell = |x: f32| {
            let share = integral((f64::from(x) / radius * 0.5 + 0.5).clamp(0.0, 1.0));
            ((share * SIDE as f64) as usize).min(SIDE - 1)
        };
        counts[cell(p.y) * SIDE + cell(p.x)] += 1.0;
    }
    let expected = vec![SAMPLES as f64 / (SIDE * SIDE) as f64; SIDE * SIDE];
    report.sampler(name, SAMPLES, SIDE * SIDE, chi_square_test(&counts, &expected));
}
