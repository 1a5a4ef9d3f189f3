//! Detail finer than voxels, and light from files, with known answers.

#[allow(dead_code)]
mod support;

use curlsmoke::geometry::embree::Ray;
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::space::{UnitVec3, WorldPoint};
use curlsmoke::render;
use curlsmoke::render::media::Media;
use curlsmoke::render::medium::Medium;
use curlsmoke::render::sampler::Stream;
use curlsmoke::render::sun_shadow::Shadows;
use glam::Vec3;
use support::{Stage, centered_grid, estimate_colors, stage};

fn smoke(extinction: f64, detail: &str) -> (Stage, Medium) {
    let stage = stage(&format!(
        "
camera: {{position: [0, 0, 5], look_at: [0, 0, 0]}}
film: {{resolution: [16, 12], spp: 16}}
render: {{max_bounces: 100000}}
lights: [{{environment: {{radiance: [1, 1, 1]}}}}]
smoke:
  emitters: [{{point: {{position: [0, 0, 0]}}, count: 1, lifetime: 1}}]
  grid: {{voxel_size: 1}}
  detail: {{{detail}}}
  medium: {{extinction: {extinction}, albedo: [0, 0.5, 1], emission: [2, 0, 0]}}
"
    ));
    let grid = centered_grid([16, 16, 16], 0.1, |p| (1.2 - p.0.length()).clamp(0.0, 1.0));
    let mut medium = render::build_medium(&stage.scene, grid).unwrap().unwrap();
    let settings = stage.scene.settings.smoke.as_ref().unwrap().detail.unwrap();
    render::add_detail(&mut medium, &settings, 0.7).unwrap();
    (stage, medium)
}

fn ray(origin: [f32; 3], direction: [f32; 3]) -> Ray {
    let direction = UnitVec3::try_new(Vec3::from(direction)).expect("not zero");
    Ray { origin: WorldPoint(Vec3::from(origin)), direction }
}

const FINE: &str = "length_scale: 0.25, spin_rate: 0.4, displacement: [0, 0.1, 0], strength: 1, contrast: 3";

#[test]
fn light_through_detail_is_as_quadrature_says() {
    // Thick pieces too, which without detail would be crossed exactly.
    for extinction in [2.0, 200.0] {
        let (stage, medium) = smoke(extinction, FINE);
        let beam = if extinction < 10.0 {
            ray([0.11, 0.07, 5.0], [0.02, 0.01, -1.0])
        } else {
            ray([0.82, 0.82, 5.0], [0.0, 0.0, -1.0])
        };
        let line = medium.ray_to_index(&beam);
        const STEPS: usize = 200_000;
        let dt = 4.0 / STEPS as f64;
        let (mut tau, mut glow) = (0.0, 0.0);
        for i in 0..STEPS {
            let sigma_t = f64::from(medium.sigma_t(line.at(3.0 + ((i as f64 + 0.5) * dt) as f32)));
            glow += 2.0 * sigma_t / extinction * f64::exp(-tau - 0.5 * sigma_t * dt) * dt;
            tau += sigma_t * dt;
        }
        let mut stream = Stream::new(Seed(5));
        let n = 20_000;
        let media = Media::from(Some(&medium));
        let values: Vec<f64> =
            (0..n).map(|_| f64::from(media.transmittance(&beam, 10.0, Shadows::NONE, &mut stream).x)).collect();
        let mean = values.iter().sum::<f64>() / f64::from(n);
        let error = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>()).sqrt() / f64::from(n);
        println!("extinction {extinction}: {mean} ± {error}, expected {}", (-tau).exp());
        assert!((mean - (-tau).exp()).abs() < 4.0 * error + 1e-5, "{mean} ± {error}, expected {}", (-tau).exp());
        // Red absorbs and glows: what comes through of the sky, and what is given off on the way.
        // Many paths, as few of them bring most of what comes through.
        let red = estimate_colors(&stage, media, 100_000, 1, |_| beam)[0];
        assert!(red.z((-tau).exp() + glow) < 4.0, "{red:?}, expected {}", (-tau).exp() + glow);
        // White smoke vanishes in white light.
        let blue = estimate_colors(&stage, media, 15_000, 2, |_| beam)[2];
        assert!(blue.z(1.0) < 4.0, "{blue:?}");
        let view = media.view_through(&beam, 10.0).unwrap();
        assert!((view.transmittance / (-tau).exp()).ln().abs() < 0.02 * (1.0 + tau), "{view:?}");
    }
}

#[test]
fn bounds_hold_and_too_dense_smoke_is_refused() {
    let (stage, medium) = smoke(3.0, FINE);
    let mut rng = CounterRng::new(Seed(2));
    let mut point = |scale: f32| [0; 3].map(|_| (2.0 * rng.uniform() - 1.0) * scale);
    for _ in 0..200 {
        let beam = ray(point(1.5), point(1.0));
        let line = medium.ray_to_index(&beam);
        for piece in medium.majorants(&beam, 5.0) {
            for i in 0..20 {
                let t = piece.t0 + (piece.t1 - piece.t0) * (i as f32 + 0.5) / 20.0;
                assert!(medium.sigma_t(line.at(t)) <= medium.sigma_max(piece.density_max) * 1.0001);
            }
        }
    }
    let grid = centered_grid([8, 8, 8], 0.1, |_| 1e6);
    let mut medium = render::build_medium(&stage.scene, grid).unwrap().unwrap();
    let settings = stage.scene.settings.smoke.as_ref().unwrap().detail.unwrap();
    assert!(render::add_detail(&mut medium, &settings, 0.0).is_err());
}

#[test]
fn light_from_a_file_shines_where_there_is_no_smoke_too() {
    let (stage, mut medium) = smoke(1.5, FINE);
    // Two grids side by side: smoke at z < 0.8 alone, light of its own in a box before it.
    medium.detail = None;
    medium.emission = Vec3::ZERO;
    let light = |value: f32| {
        let origin = WorldPoint::new(-0.5, -0.5, 2.0);
        curlsmoke::grid::DensityGrid::from_fn(origin, 0.125, glam::UVec3::splat(8), 1 << 24, |_| value).unwrap()
    };
    render::kindle(&mut medium, [light(0.5), light(3.0), light(0.0)], true).unwrap();
    let beam = ray([0.06, 0.06, 5.0], [0.0, 0.0, -1.0]);
    let before = ray([0.06, 0.06, 2.5], [0.0, 0.0, 1.0]);
    let mut stream = Stream::new(Seed(5));
    let collected = Media::from(Some(&medium)).collected(&before, f32::INFINITY, &mut stream);
    // Half of a metre, a part of it in the ramp of the last half voxel and as much beyond it.
    let column = 0.5;
    assert!((collected - Vec3::new(0.5, 3.0, 0.0) * column).abs().max_element() < 1e-5, "{collected}");
    let all = estimate_colors(&stage, Some(&medium).into(), 20_000, 1, |_| beam);
    let dark = {
        medium.glow = None;
        medium.glow_majorants = None;
        estimate_colors(&stage, Some(&medium).into(), 20_000, 1, |_| beam)
    };
    // Red is absorbed but not scattered: all of it on the way, and the smoke behind.
    let error = all[0].standard_error.hypot(dark[0].standard_error);
    assert!((all[0].mean - dark[0].mean - 0.5).abs() < 4.0 * error + 1e-5, "{all:?} {dark:?}");
}
