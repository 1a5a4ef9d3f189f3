//! Small scenes against references: means with variances, compared as two measurements of the same light.
//!
//! `make refs REASON="…"` remakes the references; a picture that fails is kept in `tests/failed/` with a map of where.

use curlsmoke::output::agreement::StatisticalSettings;
use curlsmoke::output::compare::{Mode, Report, compare};
use curlsmoke::output::exr::{Compression, write};
use curlsmoke::output::film_image::{Origin, image_of_film};
use curlsmoke::output::image::{Attribute, Image, SampleKind};
use curlsmoke::output::{file::write_atomic, heat_map, read_image};
use curlsmoke::pipeline;
use curlsmoke::progress::Silent;
use curlsmoke::render;
use curlsmoke::scene::Scene;
use std::path::{Path, PathBuf};

/// Paths a pixel of a reference.
const REFERENCE_SPP: u32 = 2048;
/// The seed of references; tests use others, so that two independent measurements are compared.
const REFERENCE_SEED: u64 = 1_000_003;
const LIMIT: u64 = 1 << 30;

/// Frame 1 of a test scene as the program makes it, with its variance. The smoke is that of the scene's own seed, the
/// light takes `seed`.
fn picture(name: &str, spp: Option<u32>, seed: u64, overrides: &[(&str, &str)]) -> Image {
    let path = root().join(format!("scenes/tests/{name}.yaml"));
    let own = Scene::load(&path).unwrap_or_else(|e| panic!("{e}")).settings;
    let mut all: Vec<(String, String)> = overrides.iter().map(|(k, v)| (k.to_string(), v.to_string())).collect();
    if own.smoke.is_some() {
        all.push(("smoke.seed".into(), own.smoke_seed().to_string()));
    }
    all.push(("output.aovs".into(), "[variance]".into()));
    all.push(("render.seed".into(), seed.to_string()));
    all.push(("film.spp".into(), spp.unwrap_or(own.film.spp).to_string()));
    let scene = Scene::load_with(&path, &all).unwrap_or_else(|e| panic!("{e}"));
    let film = pipeline::film(&scene, 1, None, &Silent).unwrap_or_else(|e| panic!("{e}"));
    let camera = render::build_view(&scene, 1, None).camera;
    let origin = Origin { scene_hash: String::new(), seed, frame: 1, fps: 24.0, shutter: [0.0; 2], camera };
    image_of_film(&film, SampleKind::Float, &origin)
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_path_buf()
}

fn reference_files(name: &str) -> [PathBuf; 2] {
    ["mean", "var"].map(|kind| root().join(format!("refs/{name}.{kind}.exr")))
}

/// The reference as one picture with a `variance` layer.
fn reference(name: &str) -> Image {
    let [mean, variance] = reference_files(name)
        .map(|path| read_image(&path, LIMIT).unwrap_or_else(|e| panic!("{e}; `make refs REASON=\"…\"` makes it")));
    let mut image = mean;
    image.push_rgb("variance", SampleKind::Float, &variance.to_rgb("").expect("R, G and B"));
    image
}

fn verdict(image: &Image, reference: &Image) -> Report {
    compare(image, reference, None, Mode::Statistical(StatisticalSettings::default())).expect("comparable")
}

fn remake(name: &str, reason: &str) {
    let image = picture(name, Some(REFERENCE_SPP), REFERENCE_SEED, &[]);
    let [mean_file, variance_file] = reference_files(name);
    for (layer, path) in [("", mean_file), ("variance", variance_file)] {
        let mut part = Image::new(image.size);
        part.push_rgb("", SampleKind::Float, &image.to_rgb(layer).expect("rendered"));
        part.set_attribute("curlsmoke/spp", Attribute::Int(REFERENCE_SPP as i32));
        part.set_attribute("curlsmoke/reason", Attribute::Text(reason.into()));
        write_atomic(&path, &write(&part, Compression::Zip).expect("encodes")).expect("writable");
    }
}

/// Compares a scene with its reference, or makes the reference when `CURLSMOKE_REMAKE_REFS` holds a reason.
fn check(name: &str) {
    if let Ok(reason) = std::env::var("CURLSMOKE_REMAKE_REFS") {
        assert!(reason.trim().len() > 9, "a reference is remade for a reason that can be read later");
        remake(name, &reason);
        return;
    }
    let image = picture(name, None, 17, &[]);
    let report = verdict(&image, &reference(name));
    if !report.passed() {
        let failed = root().join("tests/failed");
        let file = failed.join(format!("{name}.exr"));
        write_atomic(&file, &write(&image, Compression::Zip).expect("encodes")).expect("writable");
        heat_map::write(&failed.join(format!("{name}.heat.png")), &report).expect("writable");
        panic!(
            "{name} differs from its reference:\n{report}\nThe picture and a map of the differences are in {}.\n\
             If the change is meant: make refs REASON=\"why\"",
            failed.display()
        );
    }
}

macro_rules! scenes {
    ($($name:ident),*) => { $(
        #[test]
        fn $name() {
            check(stringify!($name));
        }
    )* };
}

scenes!(
    thin, solids, ring_small, dense, inside, veil, sky, glass, tint, droplets, focus, hot, globe, parallel, lights,
    volumes, detail
);

/// Nothing to prove while references are being made.
fn is_remaking() -> bool {
    std::env::var("CURLSMOKE_REMAKE_REFS").is_ok()
}

#[test]
fn a_per_cent_of_density_is_noticed() {
    if is_remaking() {
        return;
    }
    let denser = picture("thin", Some(768), 23, &[("smoke.medium.extinction", "10.1")]);
    assert!(!verdict(&denser, &reference("thin")).passed());
    let same = picture("thin", Some(768), 23, &[]);
    let report = verdict(&same, &reference("thin"));
    assert!(report.passed(), "{report}");
}

#[test]
fn a_shift_by_one_pixel_is_noticed() {
    if is_remaking() {
        return;
    }
    let image = picture("solids", None, 17, &[]);
    let width = image.size[0] as usize;
    let mut shifted = image.clone();
    for channel in &mut shifted.channels {
        for row in channel.data.chunks_mut(width) {
            row.rotate_right(1);
        }
    }
    assert!(!verdict(&shifted, &reference("solids")).passed());
}

#[test]
fn swapped_channels_are_noticed() {
    if is_remaking() {
        return;
    }
    let image = picture("solids", None, 17, &[]);
    let mut swapped = image.clone();
    for channel in &mut swapped.channels {
        channel.name = match channel.name.as_str() {
            "R" => "B".into(),
            "B" => "R".into(),
            _ => continue,
        };
    }
    swapped.channels.sort_by_key(|c| curlsmoke::output::image::channel_order(&c.name));
    assert!(!verdict(&swapped, &reference("solids")).passed());
}
