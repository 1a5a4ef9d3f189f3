//! Where nothing absorbs and everything around has radiance 1, nothing is seen but 1.

use crate::report::Report;
use crate::setting::{lumps, medium, ray, scene};
use crate::support::{centered_grid, estimate};

/// A ball that shines all around: paths meet it, ask it, and weigh both.
const ROOM: &str = "lights: [{sphere: {center: [0, 0, 0], radius: 20, radiance: [1, 1, 1]}}]";
const BALL: &str =
    "shapes: {ball: {sphere: {center: [0.1, 0, 0], radius: 0.15}, material: {diffuse: {reflectance: [1, 1, 1]}}}}";

pub fn rows(report: &mut Report) {
    report.group(
        "White furnaces",
        "Lumpy smoke of albedo 1 and surfaces of reflectance 1 in a shining ball of radiance 1: radiance 1 everywhere, by the \
         conservation of energy. Camera outside, and in the midst of the smoke.",
    );
    let white = |g: f64, extinction: f64| {
        format!("extinction: {extinction}, albedo: [1, 1, 1], phase: {{henyey_greenstein: {{g: {g}}}}}")
    };
    let outside = ray([0.1, 0.05, 5.0], [0.0, 0.0, -1.0]);
    let inside = ray([-0.25, 0.1, 0.1], [0.7, 0.2, -0.3]);
    for g in [-0.9, -0.5, 0.0, 0.5, 0.9] {
        let stage = scene(&white(g, 5.0), ROOM);
        let medium = medium(&stage, centered_grid([8; 3], 0.1, lumps));
        for (name, beam) in [("outside", outside), ("inside", inside)] {
            let found = estimate(&stage, Some(&medium), 800_000, report.seed(), |_| beam);
            report.row(&format!("smoke, g = {g}, camera {name}"), 1.0, found);
        }
    }
    for (name, keys) in [
        ("smoke with a tint of 0.3, 0.7, 1", "extinction_tint: [0.3, 0.7, 1], phase: {henyey_greenstein: {g: 0.5}}"),
        ("smoke of two lobes", "phase: {two_lobes: {g1: 0.8, g2: -0.4, share: 0.6}}"),
        ("smoke of droplets of 10 µm", "phase: {droplets: {diameter_um: 10}}"),
    ] {
        let stage = scene(&format!("extinction: 5, albedo: [1, 1, 1], {keys}"), ROOM);
        let medium = medium(&stage, centered_grid([8; 3], 0.1, lumps));
        for (place, beam) in [("outside", outside), ("inside", inside)] {
            let found = estimate(&stage, Some(&medium), 400_000, report.seed(), |_| beam);
            report.row(&format!("{name}, camera {place}"), 1.0, found);
        }
    }
    for (name, material) in [
        ("metal of roughness 0.6", "principled: {base_color: [1, 1, 1], metallic: 1, roughness: 0.6}"),
        ("clear glass", "dielectric: {ior: 1.5}"),
        ("frosted glass", "dielectric: {ior: 1.5, roughness: 0.4}"),
        ("lacquer", "plastic: {reflectance: [1, 1, 1], roughness: 0.3}"),
    ] {
        let ball = format!(
            "shapes: {{ball: {{sphere: {{center: [0.1, 0, 0], radius: 0.15}}, material: {{{material}}}}}}}\n{ROOM}"
        );
        let stage = scene(&white(0.4, 3.0), &ball);
        let medium = medium(&stage, centered_grid([8; 3], 0.1, lumps));
        let found = estimate(&stage, Some(&medium), 100_000, report.seed(), |_| outside);
        report.row(&format!("a white ball of {name} in smoke"), 1.0, found);
    }
    let stage = scene(&white(0.0, 1.0), &format!("{BALL}\n{ROOM}"));
    report.row("a white ball alone", 1.0, estimate(&stage, None, 800_000, report.seed(), |_| outside));
    for (name, extinction) in [("thin", 3.0), ("thick", 60.0)] {
        let stage = scene(&white(0.4, extinction), &format!("{BALL}\n{ROOM}"));
        let medium = medium(&stage, centered_grid([8; 3], 0.1, lumps));
        for (place, beam) in [("outside", outside), ("inside", inside)] {
            let found = estimate(&stage, Some(&medium), 800_000, report.seed(), |_| beam);
            report.row(&format!("a white ball in {name} smoke, camera {place}"), 1.0, found);
        }
    }
    report.end();
    rooms(report);
}

fn rooms(report: &mut Report) {
    report.group(
        "Echoes of light in closed rooms",
        "A sphere of walls with reflectance ρ. Walls that give off E have radiance E/(1 − ρ), with white smoke or without; a \
         point of intensity I in its middle makes ρ I/(π R² (1 − ρ)) of them.",
    );
    let beam = ray([-0.9, 0.3, 0.2], [0.7, -0.2, -0.1]);
    for reflectance in [0.3, 0.9] {
        let emission = 2.0 * (1.0 - reflectance);
        let room = format!(
            "shapes: {{room: {{sphere: {{center: [0, 0, 0], radius: 2}}, material: {{diffuse: {{reflectance: [{reflectance}, \
             {reflectance}, {reflectance}], emission: [{emission}, {emission}, {emission}]}}}}}}}}"
        );
        let stage = scene("extinction: 3, albedo: [1, 1, 1]", &room);
        let medium = medium(&stage, centered_grid([8; 3], 0.1, lumps));
        let found = estimate(&stage, Some(&medium), 200_000, report.seed(), |_| beam);
        report.row(&format!("glowing walls, smoke, ρ = {reflectance}"), 2.0, found);
    }
    for reflectance in [0.5, 0.9] {
        let room = format!(
            "shapes: {{room: {{sphere: {{center: [0, 0, 0], radius: 2}}, material: {{diffuse: {{reflectance: [{reflectance}, \
             {reflectance}, {reflectance}]}}}}}}}}\nlights: [{{point: {{position: [0, 0, 0], intensity: [5, 5, 5]}}}}]"
        );
        let stage = scene("extinction: 1", &room);
        let expected = reflectance * 5.0 / (std::f64::consts::PI * 4.0 * (1.0 - reflectance));
        let found = estimate(&stage, None, 200_000, report.seed(), |_| beam);
        report.row(&format!("a point in the middle, ρ = {reflectance}"), expected, found);
    }
    report.end();
}
