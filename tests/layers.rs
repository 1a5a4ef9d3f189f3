//! The further layers of a picture: those that add to the picture do, and those with known answers have them.

mod support;

use curlsmoke::grid::DensityGrid;
use curlsmoke::math::space::WorldPoint;
use curlsmoke::output::film_image::{Origin, image_of_film};
use curlsmoke::output::image::{Attribute, SampleKind};
use curlsmoke::progress::Silent;
use curlsmoke::render::cryptomatte;
use curlsmoke::render::film::Film;
use curlsmoke::render::medium::Medium;
use curlsmoke::render::{self, tiles};
use support::{Stage, centered_grid, estimate, stage};

/// Smoke that glows, a ball that shines, a floor, three lights in two groups, and a sky.
const SCENE: &str = "
camera: {position: [0, 0.5, 5], look_at: [0, 0, 0], lens: {radius: 0.05}}
film: {resolution: [48, 32], spp: 32}
render: {max_bounces: 1000}
shapes:
  ball: {sphere: {center: [0.7, 0, 0], radius: 0.3}, material: {diffuse: {reflectance: [0.6, 0.4, 0.2], emission: [0.1, 0.5, 0.1]}}}
  floor: {plane: {point: [0, -1, 0]}, material: {diffuse: {reflectance: [0.5, 0.5, 0.5]}}}
smoke: {emitters: [{point: {position: [0, 0, 0]}, count: 1, lifetime: 1}], grid: {voxel_size: 1},
  medium: {extinction: 4, albedo: [0.9, 0.8, 0.7], emission: [0.3, 0.1, 0]}}
lights:
  - sun: {direction: [0.3, -1, -0.4], irradiance: [2, 2, 2], group: key}
  - sphere: {center: [-1, 1, 0], radius: 0.1, radiance: [20, 10, 5], group: fill}
  - point: {position: [0, 1, 1], intensity: [0.5, 0.5, 0.5], group: fill}
  - environment: {radiance: [0.2, 0.3, 0.4]}
output: {aovs: [passages, light_groups, samples, bounces]}
";

fn smoke(stage: &Stage) -> Medium {
    let grid = centered_grid([16, 16, 16], 0.1, |p: WorldPoint| (1.0 - p.0.length() / 0.8).max(0.0));
    render::build_medium(&stage.scene, grid).expect("not too dense").expect("the scene has smoke")
}

fn picture(stage: &Stage, medium: &Medium) -> Film {
    tiles::render(&render::build_view(&stage.scene, 1, None), &stage.world, Some(medium), &Silent).expect("renders")
}

/// The numbers of a channel.
fn channel(film: &Film, name: &str) -> Vec<f32> {
    assert!(film.layers.iter().all(|layer| layer.channels().len() == layer.channel_count()));
    let names: Vec<String> = film.layers.iter().flat_map(|layer| layer.channels()).collect();
    let at = names.iter().position(|known| known == name).unwrap_or_else(|| panic!("{name} among {names:?}"));
    film.layer_data.iter().skip(at).step_by(names.len()).copied().collect()
}

#[test]
fn ways_and_groups_of_light_add_to_the_picture() {
    let stage = stage(SCENE);
    let film = picture(&stage, &smoke(&stage));
    let ways = ["background", "emission", "surface_direct", "surface_indirect", "volume_direct", "volume_indirect"];
    let groups = ["light_emission", "light_other", "light_key", "light_fill"];
    for names in [ways.as_slice(), &groups] {
        let mut sum = vec![0.0f64; film.pixels.len()];
        for name in names {
            let light = channel(&film, &format!("{name}.R"));
            assert!(light.iter().any(|&x| x > 0.0), "{name} is empty");
            sum.iter_mut().zip(light).for_each(|(sum, x)| *sum += f64::from(x));
        }
        for (pixel, sum) in film.pixels.iter().zip(sum) {
            let mean = f64::from(pixel.mean.x);
            assert!((sum - mean).abs() < 1e-5 * mean.max(0.1), "{sum} of {mean}");
        }
    }
}

#[test]
fn a_group_is_what_its_lights_give_alone() {
    let many = SCENE.replace("spp: 32}", "spp: 256}");
    let all = stage(&many);
    let film = picture(&all, &smoke(&all));
    let fill = channel(&film, "light_fill.R");
    let dark = many
        .replace("emission: [0.1, 0.5, 0.1]", "emission: [0, 0, 0]")
        .replace("emission: [0.3, 0.1, 0]", "emission: [0, 0, 0]");
    let alone: String =
        dark.lines().filter(|l| !l.contains("- sun") && !l.contains("- environment")).collect::<Vec<_>>().join("\n");
    let alone = stage(&alone);
    let only = picture(&alone, &smoke(&alone));
    let total: f64 = fill.iter().map(|&x| f64::from(x)).sum();
    let expected: f64 = only.pixels.iter().map(|p| f64::from(p.mean.x)).sum();
    // The whole light group has at most the variance of the whole picture.
    let variance: f64 = film.pixels.iter().chain(&only.pixels).map(|p| f64::from(p.variance.x)).sum();
    let z = (total - expected) / variance.sqrt();
    println!("group {total}, alone {expected}, z {z}");
    assert!(z.abs() < 3.5 && variance.sqrt() < 0.03 * expected, "{z}, {}", variance.sqrt() / expected);
}

#[test]
fn the_middle_of_a_pixel_knows_depths_and_transmittance_of_even_smoke() {
    let stage = stage(
        "
camera: {position: [0, 0, 5], look_at: [0, 0, 0], projection: {orthographic: {height: 1}}}
film: {resolution: [4, 4], spp: 1}
shapes: {wall: {box: {center: [0, 0, -3], size: [9, 9, 2]}}}
smoke: {emitters: [{point: {position: [0, 0, 0]}, count: 1, lifetime: 1}], grid: {voxel_size: 1}, medium: {extinction: 1.5}}
lights: [{environment: {radiance: [1, 1, 1]}}]
output: {aovs: [depth, position, shape_id, transmittance, volume_depth]}
",
    );
    // Even between the outermost centres of voxels, from z = -1 to 1, and falling to 0 a voxel beyond.
    let grid: DensityGrid = centered_grid([21, 21, 21], 0.1, |_| 1.0);
    let medium = render::build_medium(&stage.scene, grid).unwrap().unwrap();
    let film = picture(&stage, &medium);
    let of = |name: &str| f64::from(channel(&film, name)[5]);
    let tau: f64 = 1.5 * (2.0 + 0.1);
    let near =
        |found: f64, expected: f64, error: f64| assert!((found - expected).abs() < error, "{found} of {expected}");
    near(of("Z"), 7.0, 1e-5);
    near(of("P.Z"), -2.0, 1e-5);
    near(of("shape_id"), 1.0, 1e-9);
    near(of("transmittance"), (-tau).exp(), 1e-6);
    near(of("volume_depth.first"), 3.9, 1e-5);
    // The first 0.05 of even smoke's thickness lie in the voxel where it rises.
    near(of("volume_depth.half"), 4.0 + (std::f64::consts::LN_2 / 1.5 - 0.05), 1e-5);
    // ∫ t σ T dt over 1 − T of even smoke that begins at 3.95.
    let thickness = 2.1;
    let mean = 3.95 + 1.0 / 1.5 - thickness * (-tau).exp() / -(-tau).exp_m1();
    near(of("volume_depth.mean"), mean, 2e-3);
}

#[test]
fn transmittance_is_what_paths_find() {
    let dark = SCENE.replace("albedo: [0.9, 0.8, 0.7], emission: [0.3, 0.1, 0]", "albedo: [0, 0, 0]");
    let without_shapes: String = dark
        .lines()
        .filter(|l| !l.contains("ball:") && !l.contains("floor:") && !l.contains("- s") && !l.contains("- p"))
        .collect::<Vec<_>>()
        .join("\n");
    let stage =
        stage(&without_shapes.replace("shapes:\n", "").replace("aovs: [passages", "aovs: [transmittance, passages"));
    let medium = smoke(&stage);
    let view = render::build_view(&stage.scene, 1, None);
    let found = estimate(&stage, Some(&medium), 200_000, 3, |_| view.camera.ray(glam::Vec2::new(20.5, 16.5), [0.5; 2]));
    let film = picture(&stage, &medium);
    let exact = f64::from(channel(&film, "transmittance")[16 * 48 + 20]);
    println!("{found:?} of {}", exact * 0.2);
    assert!(exact > 0.05 && exact < 0.9 && found.z(exact * 0.2) < 4.0, "{found:?} {exact}");
}

#[test]
fn masks_say_what_each_shape_covers() {
    let stage = stage(&SCENE.replace("aovs: [passages", "aovs: [cryptomatte, passages"));
    let film = picture(&stage, &smoke(&stage));
    let [ball, floor] = ["ball", "floor"].map(cryptomatte::id);
    let ranks: Vec<[Vec<f32>; 2]> = ["00.R 00.G", "00.B 00.A", "01.R 01.G"]
        .map(|pair| {
            let names: Vec<&str> = pair.split(' ').collect();
            [names[0], names[1]].map(|name| channel(&film, &format!("{}{name}", cryptomatte::NAME)))
        })
        .to_vec();
    let mut of_ball = 0.0;
    for (i, pixel) in film.pixels.iter().enumerate() {
        let listed: Vec<(u32, f32)> = ranks.iter().map(|[id, share]| (id[i].to_bits(), share[i])).collect();
        let sum: f32 = listed.iter().map(|(_, share)| share).sum();
        // What is not shape is smoke, sky or the shining ball of the lights.
        assert!(sum <= pixel.alpha + 1e-5, "{sum} of {}", pixel.alpha);
        assert!(listed.iter().all(|&(id, share)| share == 0.0 || id == ball || id == floor), "{listed:?}");
        of_ball += listed.iter().filter(|(id, _)| *id == ball).map(|(_, share)| share).sum::<f32>();
    }
    // A ball of radius 0.3 that is 5.1 away, 35 degrees over 32 rows: 28 pixels, some of them behind smoke.
    assert!((22.0..29.0).contains(&of_ball), "{of_ball}");
    let file = image_of_film(&film, SampleKind::Half, &origin(&stage));
    let manifest =
        file.attributes.iter().find(|(key, _)| key.starts_with("cryptomatte/") && key.ends_with("/manifest"));
    assert_eq!(
        manifest.map(|(_, text)| text.clone()),
        Some(Attribute::Text(format!("{{\"ball\":\"{ball:08x}\",\"floor\":\"{floor:08x}\"}}")))
    );
    let id = file.channels.iter().find(|c| c.name == "CryptoObject00.R").expect("written");
    assert_eq!(id.kind, SampleKind::Float, "numbers of shapes have no room to be rounded");
}

fn origin(stage: &Stage) -> Origin {
    let camera = render::build_view(&stage.scene, 1, None).camera;
    Origin { scene_hash: String::new(), seed: 1, frame: 1, fps: 24.0, shutter: [0.0; 2], camera }
}

#[test]
fn a_pixel_ends_when_its_noise_is_small_and_not_before() {
    let adaptive = SCENE.replace("spp: 32}", "spp: 4096, noise_target: 0.1}");
    let ours = stage(&adaptive);
    let medium = smoke(&ours);
    let film = picture(&ours, &medium);
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let again = one_thread.install(|| picture(&ours, &medium));
    assert_eq!((&film.pixels, &film.layer_data), (&again.pixels, &again.layer_data));
    let samples = channel(&film, "samples");
    let (least, most) = samples.iter().fold((f32::INFINITY, 0.0f32), |(a, b), &x| (a.min(x), b.max(x)));
    let errors: Vec<f64> = film
        .pixels
        .iter()
        .map(|p| {
            let [sd, mean] = [p.variance.map(f32::sqrt), p.mean].map(|c| f64::from(render::color::luminance(c)));
            sd / (mean + 0.05)
        })
        .collect();
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
    println!("{least} to {most} paths, error {rms:.3}");
    assert!(least == 32.0 && most > 100.0, "{least} to {most}");
    assert!((0.03..0.11).contains(&rms), "{rms}");
    // The mean of the many pixels that ended early and late is that of as many paths everywhere.
    let even = stage(&SCENE.replace("spp: 32}", "spp: 200}"));
    let even = picture(&even, &smoke(&even));
    let sum = |film: &Film| film.pixels.iter().map(|p| f64::from(p.mean.x)).sum::<f64>();
    let variance: f64 = film.pixels.iter().chain(&even.pixels).map(|p| f64::from(p.variance.x)).sum();
    let z = (sum(&film) - sum(&even)) / variance.sqrt();
    println!("z {z}");
    assert!(z.abs() < 3.5);
}

#[test]
fn a_limit_of_time_gives_all_pixels_equally_many_paths_of_those_asked_for() {
    let scene = |film: &str| stage(&SCENE.replace("spp: 32}", film));
    let all = scene("spp: 37}");
    let all = picture(&all, &smoke(&all));
    // So little time that only the first pass is made, and so much that all are.
    for (limit, expected) in [(0.001, 4), (1000.0, 37)] {
        let limited = scene(&format!("spp: 37, time_limit: {limit}}}"));
        let film = picture(&limited, &smoke(&limited));
        assert_eq!(film.spp, expected);
        assert_eq!(film.paths.traced, film.pixels.len() as u64 * u64::from(expected));
        assert!(channel(&film, "samples").iter().all(|&samples| samples == expected as f32));
        if expected == 37 {
            assert_eq!((&film.pixels, &film.layer_data), (&all.pixels, &all.layer_data));
            assert_eq!(film.paths, all.paths);
        } else {
            let sum = |film: &Film| film.pixels.iter().map(|p| f64::from(p.mean.x)).sum::<f64>();
            let variance: f64 = film.pixels.iter().chain(&all.pixels).map(|p| f64::from(p.variance.x)).sum();
            assert!((sum(&film) - sum(&all)).abs() < 3.5 * variance.sqrt());
        }
    }
}
