//! Extinction and emission without scattering, and where light first meets smoke.

use crate::report::Report;
use crate::setting::{lumps, mean_of, medium, ray, scene};
use crate::slabs::SKY;
use crate::support::{centered_grid, estimate};
use crate::voxels::Voxels;
use curlsmoke::math::hash::Seed;
use curlsmoke::math::statistics::chi_square_test;
use curlsmoke::render::sampler::Stream;
use curlsmoke::render::tracking::{Event, estimate_transmittance, sample_collision};

pub fn rows(report: &mut Report) {
    beer_lambert(report);
    emission(report);
    flights(report);
}

fn beer_lambert(report: &mut Report) {
    report.group(
        "Beer and Lambert",
        "Light from behind through smoke that only absorbs: exp(−τ). The box is homogeneous, 16 voxels of 0.1 m, so that τ \
         is 1.6 m times the extinction; lumps are integrated exactly between voxel centres. What shadow rays see is \
         estimated in another way than what the camera sees.",
    );
    for tau in [0.1, 1.0, 4.0, 9.0] {
        let stage = scene(&format!("extinction: {}, albedo: [0, 0, 0]", tau / 1.6), SKY);
        let medium = medium(&stage, centered_grid([16; 3], 0.1, |_| 1.0));
        let beam = ray([0.01, 0.02, 5.0], [0.0, 0.0, -1.0]);
        let found = estimate(&stage, Some(&medium), 2_000_000, report.seed(), |_| beam);
        report.row(&format!("homogeneous, camera, τ = {tau}"), f64::exp(-tau), found);
    }
    let voxels = Voxels::new([16; 3], 0.1, lumps);
    let beam = ray([0.11, 0.07, 5.0], [0.02, 0.01, -1.0]);
    let column = voxels.column(beam.origin.0.as_dvec3(), beam.direction.as_vec3().as_dvec3(), 0.0, 10.0);
    for tau in [1.0, 5.0, 9.0] {
        let stage = scene(&format!("extinction: {}, albedo: [0, 0, 0]", tau / column), SKY);
        let medium = medium(&stage, voxels.grid());
        let shadow = |rng: &mut Stream| f64::from(estimate_transmittance(&medium, &beam, 10.0, rng));
        report.row(&format!("lumps, shadow ray, τ = {tau}"), f64::exp(-tau), mean_of(6_000_000, report.seed(), shadow));
        if tau < 6.0 {
            let found = estimate(&stage, Some(&medium), 2_000_000, report.seed(), |_| beam);
            report.row(&format!("lumps, camera, τ = {tau}"), f64::exp(-tau), found);
        }
    }
    report.end();
}

fn emission(report: &mut Report) {
    report.group(
        "Smoke that glows",
        "Emission e per density against extinction σ per density: e/σ · (1 − exp(−τ)) without scattering, whatever the lumps; \
         deep inside with albedo ω, e/(σ (1 − ω)).",
    );
    for tau in [0.5, 50.0, 5000.0] {
        let stage = scene(&format!("extinction: {}, albedo: [0, 0, 0], emission: [3, 3, 3]", tau / 1.6), "");
        let medium = medium(&stage, centered_grid([16; 3], 0.1, |_| 1.0));
        let beam = ray([0.01, 0.02, 5.0], [0.0, 0.0, -1.0]);
        let expected = 3.0 * 1.6 / tau * -f64::exp_m1(-tau);
        let found = estimate(&stage, Some(&medium), 400_000, report.seed(), |_| beam);
        report.row(&format!("homogeneous, τ = {tau}"), expected, found);
    }
    for (albedo, g) in [(0.5, 0.0), (0.9, 0.5)] {
        let medium_keys = format!(
            "extinction: 4, albedo: [{albedo}, {albedo}, {albedo}], emission: [3, 3, 3], phase: {{henyey_greenstein: {{g: {g}}}}}"
        );
        let stage = scene(&medium_keys, "");
        let medium = medium(&stage, centered_grid([64; 3], 1.0, |_| 1.0));
        let beam = ray([0.3, 0.1, 0.2], [0.3, 0.5, -1.0]);
        let found = estimate(&stage, Some(&medium), 800_000, report.seed(), |_| beam);
        report.row(&format!("deep inside, ω = {albedo}, g = {g}"), 3.0 / (4.0 * (1.0 - albedo)), found);
    }
    report.end();
}

fn flights(report: &mut Report) {
    report.sampler_group(
        "Where light first meets smoke",
        "exp(−τ) between the ray's start and the collision is uniform between 1 and that of the whole way. Counts in cells \
         of equal probability; τ is integrated exactly between voxel centres. Past an optical depth of 64 a piece is \
         crossed in another way than below.",
    );
    let voxels = Voxels::new([16; 3], 0.1, lumps);
    for (i, sigma) in [1.0, 10.0, 100.0, 1e4].into_iter().enumerate() {
        let stage = scene(&format!("extinction: {sigma}, albedo: [0, 0, 0]"), SKY);
        let medium = medium(&stage, voxels.grid());
        // Close to smoke, so that single precision of distances is enough for the shortest flights.
        let beam = ray([0.11, 0.07, 0.01], [0.02, 0.01, -1.0]);
        let (origin, direction) = (beam.origin.0.as_dvec3(), beam.direction.as_vec3().as_dvec3());
        let depth = |t: f64| sigma * voxels.column(origin, direction, 0.0, t);
        const CELLS: usize = 40;
        const SAMPLES: usize = 200_000;
        let escape = (-depth(10.0)).exp();
        let mut counts = [0.0; CELLS + 1];
        let mut rng = Stream::new(Seed(6).derive(i as u64));
        for _ in 0..SAMPLES {
            let u = rng.uniform();
            let cell = match sample_collision(&medium, &beam, 10.0, u, &mut rng, None) {
                Event::Collision { t } => {
                    let share = -(-depth(f64::from(t))).exp_m1() / (1.0 - escape);
                    ((share * CELLS as f64) as usize).min(CELLS - 1)
                }
                Event::Escape => CELLS,
            };
            counts[cell] += 1.0;
        }
        let mut expected = [(1.0 - escape) * SAMPLES as f64 / CELLS as f64; CELLS + 1];
        expected[CELLS] = escape * SAMPLES as f64;
        let p = chi_square_test(&counts, &expected);
        report.sampler(&format!("lumps, τ = {:.3} in all", depth(10.0)), SAMPLES, CELLS + 1, p);
    }
    report.end();
}
