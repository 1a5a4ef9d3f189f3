//! Light that scatters once, against quadrature.

use crate::gauss;
use crate::report::Report;
use crate::setting::{lumps, medium, ray, scene_of_bounces};
use crate::support::estimate;
use crate::voxels::Voxels;
use curlsmoke::geometry::embree::Ray;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Light that comes to a point: direction to it, how far through smoke, and irradiance on what faces it.
pub struct Arrival {
    pub towards: DVec3,
    pub distance: f64,
    pub irradiance: f64,
}

/// Henyey and Greenstein's phase function [1/sr] of the cosine between directions of travel.
pub fn henyey_greenstein(g: f64) -> impl Fn(f64) -> f64 {
    move |c| (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * c).powf(1.5))
}

/// Radiance that smoke of extinction `sigma` and albedo 1 scatters once into the ray, out of light `at` each point.
pub fn scattered_once(
    voxels: &Voxels,
    sigma: f64,
    phase: impl Fn(f64) -> f64 + Sync,
    beam: &Ray,
    at: impl Fn(DVec3) -> Vec<Arrival> + Sync,
) -> f64 {
    let (origin, direction) = (beam.origin.0.as_dvec3(), beam.direction.as_vec3().as_dvec3());
    let crossings = voxels.crossings(origin, direction);
    // Between two crossings all but the light is smooth, which has a kink wherever its way meets another voxel: pieces of
    // voxels, the finer the fewer ways there are.
    let pieces = (4096 / at(origin).len()).clamp(1, 64);
    let piece = |w: &[f64], i: usize| {
        let [a, b] = [i, i + 1].map(|i| w[0] + (w[1] - w[0]) * i as f64 / pieces as f64);
        gauss::nodes(4, a, b)
    };
    let voxels_crossed = crossings.windows(2).filter(|w| w[1] > w[0]);
    let places: Vec<(f64, f64)> = voxels_crossed.flat_map(|w| (0..pieces).flat_map(|i| piece(w, i))).collect();
    let of_place = |&(t, weight): &(f64, f64)| {
        let p = origin + direction * t;
        let seen = sigma * voxels.density(p) * (-sigma * voxels.column(origin, direction, 0.0, t)).exp();
        if seen == 0.0 {
            return 0.0;
        }
        let scattered = at(p).into_iter().map(|light| {
            let arriving = (-sigma * voxels.column(p, light.towards, 0.0, light.distance)).exp();
            light.irradiance * arriving * phase(light.towards.dot(direction))
        });
        weight * seen * scattered.sum::<f64>()
    };
    places.par_iter().map(of_place).collect::<Vec<_>>().iter().sum()
}

/// Directions to a ball of radiance 1, with their solid angles; the ball is outside smoke.
fn ball(p: DVec3, center: DVec3, radius: f64) -> Vec<Arrival> {
    let axis = (center - p).normalize();
    let (u, v) = axis.any_orthonormal_pair();
    let cosine_max = (1.0 - (radius / (center - p).length()).powi(2)).sqrt();
    const AROUND: usize = 32;
    let rings = gauss::nodes(12, cosine_max, 1.0);
    let directions = rings.iter().flat_map(|&(c, weight)| {
        (0..AROUND).map(move |i| {
            let (sin, cos) = (TAU * (i as f64 + 0.5) / AROUND as f64).sin_cos();
            let towards = axis * c + (u * cos + v * sin) * (1.0 - c * c).sqrt();
            Arrival { towards, distance: f64::INFINITY, irradiance: weight * TAU / AROUND as f64 }
        })
    });
    directions.collect()
}

/// Points of a rectangle of radiance 1 that shines down.
fn rectangle(p: DVec3, center: DVec3, half: [f64; 2]) -> Vec<Arrival> {
    let (across, along) = (gauss::nodes(12, -half[0], half[0]), gauss::nodes(12, -half[1], half[1]));
    let points = across.iter().flat_map(|&(x, wx)| along.iter().map(move |&(z, wz)| (x, z, wx * wz)));
    let arrivals = points.map(|(x, z, area)| {
        let offset = center + DVec3::new(x, 0.0, z) - p;
        let distance = offset.length();
        let towards = offset / distance;
        Arrival { towards, distance, irradiance: area * towards.y.max(0.0) / (distance * distance) }
    });
    arrivals.collect()
}

pub fn rows(report: &mut Report) {
    report.group(
        "Light that scatters once",
        "Lumpy smoke of extinction 2 and 40 per metre, albedo 0.8, g = 0.5, and paths of one scattering, against Gauss' \
         quadrature along the camera ray and over the light, with optical depths integrated exactly between voxel centres.",
    );
    let at = DVec3::new(1.0, 1.5, 0.5);
    let above = DVec3::new(0.0, 1.5, 0.0);
    let to_sun = DVec3::new(-0.5, 1.0, -0.25).normalize();
    type Light<'a> = (&'a str, &'a str, Box<dyn Fn(DVec3) -> Vec<Arrival> + Sync>);
    let lights: [Light; 4] = [
        (
            "sun",
            "{sun: {direction: [0.5, -1, 0.25], irradiance: [3, 3, 3]}}",
            Box::new(move |_| vec![Arrival { towards: to_sun, distance: f64::INFINITY, irradiance: 3.0 }]),
        ),
        (
            "point",
            "{point: {position: [1, 1.5, 0.5], intensity: [3, 3, 3]}}",
            Box::new(move |p| {
                let distance = (at - p).length();
                vec![Arrival { towards: (at - p) / distance, distance, irradiance: 3.0 / (distance * distance) }]
            }),
        ),
        (
            "ball",
            "{sphere: {center: [1, 1.5, 0.5], radius: 0.6, radiance: [3, 3, 3]}}",
            Box::new(move |p| {
                ball(p, at, 0.6).into_iter().map(|a| Arrival { irradiance: 3.0 * a.irradiance, ..a }).collect()
            }),
        ),
        (
            "rectangle",
            "{rectangle: {center: [0, 1.5, 0], half_u: [0.5, 0, 0], half_v: [0, 0, 0.4], radiance: [3, 3, 3]}}",
            Box::new(move |p| {
                let arrivals = rectangle(p, above, [0.5, 0.4]).into_iter();
                arrivals.map(|a| Arrival { irradiance: 3.0 * a.irradiance, ..a }).collect()
            }),
        ),
    ];
    let voxels = Voxels::new([12; 3], 0.1, lumps);
    let beam = ray([0.05, 0.12, 5.0], [0.0, 0.0, -1.0]);
    for (name, light, at) in lights {
        for sigma in [2.0, 40.0] {
            let keys =
                format!("extinction: {sigma}, albedo: [0.8, 0.8, 0.8], phase: {{henyey_greenstein: {{g: 0.5}}}}");
            let stage = scene_of_bounces(1, &keys, &format!("lights: [{light}]"));
            let medium = medium(&stage, voxels.grid());
            let expected = 0.8 * scattered_once(&voxels, sigma, henyey_greenstein(0.5), &beam, &at);
            let found = estimate(&stage, Some(&medium), 1_200_000, report.seed(), |_| beam);
            report.row(&format!("{name}, {sigma} per metre"), expected, found);
        }
    }
    report.end();
}
