//! Every sampler against its density.

use crate::report::Report;
use crate::setting::{spherical_unit, unit};
use crate::single_scattering::henyey_greenstein;
use crate::skies;
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::space::{UnitVec3, WorldPoint};
use curlsmoke::math::statistics::chi_square_test;
use curlsmoke::render::ball::Ball;
use curlsmoke::render::bsdf::conductor::{Metal, MetalColor};
use curlsmoke::render::bsdf::dielectric::Glass;
use curlsmoke::render::bsdf::plastic::Plastic;
use curlsmoke::render::bsdf::principled::{Principled, PrincipledSettings};
use curlsmoke::render::bsdf::{Bsdf, metals};
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
         of lights and of the film's filter are written here again in f64; those of the sky and of other surfaces are their own, \
         which other samplers are weighed against, so that they must be true. The film's filter is taken in cells of equal weight: the sampler \
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
            |[a, b, _]| Some(phase.sample(before, [a, b]).direction),
            |d| density(axis.dot(d)),
        );
    }
    let [narrow, wide] = [0.8, -0.3].map(henyey_greenstein);
    let two = Phase::two_lobes([0.8, -0.3], 0.7);
    sphere(
        report,
        "two lobes, g = 0.8 and −0.3",
        |[a, b, _]| Some(two.sample(before, [a, b]).direction),
        |d| 0.7 * narrow(axis.dot(d)) + 0.3 * wide(axis.dot(d)),
    );
    // Draine 2003, equation 9.
    let (g, alpha) = (0.5, 20.0);
    let draine = Phase::Mixture { lobes: [Lobe::Draine { g: g as f32, alpha: alpha as f32 }; 2], share: 0.4 };
    let base = henyey_greenstein(g);
    sphere(
        report,
        "Draine, g = 0.5, α = 20",
        |[a, b, _]| Some(draine.sample(before, [a, b]).direction),
        |d| {
            let c: f64 = axis.dot(d);
            base(c) * (1.0 + alpha * c * c) / (1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0)
        },
    );
    let diffuse = Bsdf::Diffuse { reflectance: Vec3::splat(0.5) };
    sphere(
        report,
        "diffuse surface",
        |u| diffuse.sample(before, -before, u).map(|s| s.direction),
        |d| axis.dot(d).max(0.0) / PI,
    );
    let sky = skies::sky();
    let own = |d: DVec3| f64::from(sky.pdf(unit(d)));
    sphere(report, "sky", |[a, b, _]| Some(sky.sample([a, b]).direction), own);
    surfaces(report, before);
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
    let towards =
        |light: &Light, from: WorldPoint, [a, b, _]: [f32; 3]| light.sample(from, [a, b]).map(|s| s.direction);
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
    // Where a direction meets the plane, in halves of its edges, and the density for an area [m²] of it.
    let met = |d: DVec3, area: f64| {
        let t = (middle - origin).dot(across) / d.dot(across);
        let p = origin + d * t - middle;
        let place = [p.cross(v).dot(across), u.cross(p).dot(across)].map(|x| x / across.length_squared());
        (place, if t > 0.0 { t * t * across.length() / (d.dot(across).abs() * area) } else { 0.0 })
    };
    sphere(
        report,
        "rectangle",
        |u| towards(&rectangle, from, u),
        |d| {
            let ([a, b], density) = met(d, 4.0 * across.length());
            if a.abs().max(b.abs()) <= 1.0 { density } else { 0.0 }
        },
    );
}

/// Surfaces against the densities that other samplers are weighed with.
fn surfaces(report: &mut Report, before: UnitVec3) {
    let normal = unit(DVec3::new(-0.2, 0.9, -0.4));
    let (metal, glass, plastic) = (Metal::new(0.3), Glass::new(1.5, 0.4), Plastic::new(1.5, 0.3));
    let mix = Principled::new(&PrincipledSettings {
        metallic: 0.3,
        roughness: 0.6,
        ior: 1.5,
        transmission: 0.5,
        coat: 0.7,
        coat_roughness: 0.4,
    });
    let gold = MetalColor::measured(metals::GOLD.eta, metals::GOLD.k);
    let color = Vec3::new(0.8, 0.5, 0.2);
    let all = [
        ("gold, roughness 0.3", Bsdf::Conductor { metal: &metal, color: gold, tint: Vec3::ONE }),
        ("glass, roughness 0.4, from outside", Bsdf::Dielectric { glass: &glass, tint: color, is_front: true }),
        ("glass, roughness 0.4, from inside", Bsdf::Dielectric { glass: &glass, tint: color, is_front: false }),
        ("plastic, roughness 0.3", Bsdf::Plastic { plastic: &plastic, reflectance: color }),
        ("principled, of all parts", Bsdf::Principled { model: &mix, base_color: color, is_front: true }),
    ];
    for (name, bsdf) in all {
        sphere(
            report,
            name,
            |u| bsdf.sample(normal, before, u).map(|s| s.direction),
            |d| f64::from(bsdf.pdf(normal, before, unit(d))),
        );
    }
}

/// A sampler of directions from up to three uniform numbers against a density per solid angle.
fn sphere(
    report: &mut Report,
    name: &str,
    sample: impl Fn([f32; 3]) -> Option<UnitVec3> + Sync,
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
        if let Some(direction) = sample([rng.uniform(), rng.uniform(), rng.uniform()]) {
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
