//! A picture's way to its file, and a frame from the scene's text to the light of all pixels.

use crate::workload::Workload;
use curlsmoke::math::hash::Seed;
use curlsmoke::output::exr::{Compression, write};
use curlsmoke::output::image::{Image, SampleKind};
use curlsmoke::pipeline::film;
use curlsmoke::progress::Silent;
use curlsmoke::scene::Scene;
use std::hint::black_box;
use std::path::Path;

/// A scene with all stages: flow round a ring, particles, splats, light, and surfaces through Embree.
const SCENE: &str = "scenes/tests/ring_small.yaml";

/// A picture with colours, alpha and two layers of data, noisy as such pictures are.
pub fn exr() -> Workload {
    const SIZE: [u32; 2] = [240, 135];
    let pixels = (SIZE[0] * SIZE[1]) as usize;
    let noisy = |i: usize, c: u64| (i % 240) as f32 / 240.0 + 0.1 * Seed(c).uniform(i as u64);
    let mut image = Image::new(SIZE);
    let colors: Vec<[f32; 3]> = (0..pixels).map(|i| [noisy(i, 0), noisy(i, 1), noisy(i, 2)]).collect();
    image.push_rgb("", SampleKind::Half, &colors);
    image.push("A", SampleKind::Half, (0..pixels).map(|i| noisy(i, 3).min(1.0)).collect());
    image.push("Z", SampleKind::Float, (0..pixels).map(|i| 4.0 + noisy(i, 4)).collect());
    image.push_rgb("variance", SampleKind::Float, &colors);
    Workload::new(pixels, move || {
        black_box(write(black_box(&image), Compression::default()).expect("a valid picture"));
    })
}

/// All of a small frame but its file; small enough for callgrind, with about as much light as particles.
pub fn frame() -> Workload {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(SCENE);
    let changes = [("film.resolution", "[48, 27]"), ("film.spp", "16"), ("smoke.emitters[0].rate", "2000")];
    let changes = changes.map(|(key, value)| (key.to_string(), value.to_string()));
    let scene = Scene::load_with(&path, &changes).expect("a scene of the tests");
    let first = scene.settings.frames.first;
    Workload::new(1, move || {
        black_box(film(&scene, first, None, &Silent).expect("nobody cancels it"));
    })
}
