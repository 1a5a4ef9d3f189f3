//! `curlsmoke denoise` as people run it, without the library and, where it is found, with it.

#[path = "support/program.rs"]
mod program;

use curlsmoke::output::denoise::DENOISED;
use curlsmoke::output::exr::{self, Compression};
use curlsmoke::output::image::{Image, SampleKind};
use curlsmoke::output::oidn::{Denoiser, LoadError, OidnError};
use program::{Folder, contains};
use std::fs;

/// Noise enough to take out: few paths, a sun and a shadow.
const SCENE: &str = "\
version: 1
camera: {position: [0, 1.5, 5], look_at: [0, 0.3, 0]}
film: {resolution: [64, 48], spp: 8}
shapes:
  floor: {plane: {point: [0, -0.5, 0]}, material: {diffuse: {reflectance: [0.5, 0.5, 0.5]}}}
  ball: {sphere: {center: [0, 0.3, 0], radius: 0.8}, material: {diffuse: {reflectance: [0.8, 0.3, 0.2]}}}
lights:
  - sphere: {center: [2, 3, 1], radius: 1, radiance: [5, 5, 5]}
  - environment: {radiance: [0.2, 0.2, 0.3]}
output: {image: out/shadow.exr, aovs: [normal, albedo, variance]}
";

fn rendered() -> Folder {
    let folder = Folder::new();
    folder.write("shadow.yaml", SCENE);
    folder.expect(0, &["render", "shadow.yaml"]);
    folder
}

#[test]
fn a_missing_library_is_an_error_that_says_how_to_get_it() {
    let folder = rendered();
    let mut command = folder.command(&["denoise", "out/shadow.exr", "-o", "out/clean.exr"]);
    let output = command.env("OIDN_DIR", folder.path("nowhere")).output().unwrap();
    assert_eq!(output.status.code(), Some(4));
    contains(&String::from_utf8(output.stderr).unwrap(), &["OIDN_DIR is", "nowhere", "libOpenImageDenoise"]);
    assert!(!folder.path("out/clean.exr").exists());
}

#[test]
fn what_cannot_be_denoised_is_refused_before_the_library_is_asked_for() {
    let folder = rendered();
    let nowhere = folder.path("nowhere");
    let mut depth = Image::new([4, 2]);
    depth.push("Z", SampleKind::Float, vec![1.0; 8]);
    fs::write(folder.path("depth.exr"), exr::write(&depth, Compression::Zips).unwrap()).unwrap();
    let expect = |code: i32, arguments: &[&str], parts: &[&str]| {
        let output = folder.command(arguments).env("OIDN_DIR", &nowhere).output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{arguments:?}");
        contains(&String::from_utf8(output.stderr).unwrap(), parts);
    };
    expect(2, &["denoise", "out/shadow.exr", "-o", "clean.png"], &["clean.png", "must end in .exr"]);
    expect(2, &["denoise", "ball.yaml", "-o", "clean.exr"], &["ball.yaml", "must end in .exr"]);
    expect(4, &["denoise", "none.exr", "-o", "clean.exr"], &["none.exr", "no such file"]);
    expect(3, &["denoise", "depth.exr", "-o", "clean.exr"], &["depth.exr", "no channels R, G and B"]);
}

#[test]
fn with_the_library_every_channel_stays_and_one_layer_comes() {
    let denoiser = match Denoiser::try_new(None) {
        Ok(denoiser) => denoiser,
        Err(OidnError::Load(LoadError::NotFound { .. })) => return println!("left out: no Open Image Denoise here"),
        Err(error) => panic!("{error}"),
    };
    assert!(denoiser.version().starts_with("2."), "{}", denoiser.version());
    let folder = rendered();
    let clean = ["denoise", "out/shadow.exr", "-o", "out/clean.exr", "--preview", "out/clean.png", "--prefilter"];
    let [out, err] = folder.expect(0, &clean);
    contains(&out, &["out/clean.exr", "64 × 48", "Open Image Denoise 2."]);
    assert!(err.is_empty(), "{err}");
    let read = |name: &str| exr::read(&folder.path(name), 1 << 30).unwrap();
    let (raw, beside) = (read("out/shadow.exr"), read("out/clean.exr"));
    for channel in &raw.channels {
        assert!(beside.channels.contains(channel), "{}", channel.name);
    }
    assert_eq!(beside.channels.len(), raw.channels.len() + 3);
    let denoised = beside.to_rgb(DENOISED).unwrap();
    assert_eq!(beside.attribute("curlsmoke/scene"), raw.attribute("curlsmoke/scene"));
    // As bright as before, and nearer to what many paths show.
    let noisy = raw.to_rgb("").unwrap();
    let mean = |rgb: &[[f32; 3]]| rgb.iter().map(|c| c[1]).sum::<f32>() / rgb.len() as f32;
    assert!((mean(&denoised) / mean(&noisy) - 1.0).abs() < 0.02, "{} {}", mean(&denoised), mean(&noisy));
    folder.expect(0, &["render", "shadow.yaml", "--spp", "128", "--seed", "2", "-o", "out/fine.exr"]);
    let fine = read("out/fine.exr").to_rgb("").unwrap();
    let error = |rgb: &[[f32; 3]]| rgb.iter().zip(&fine).map(|(a, b)| (a[1] - b[1]).powi(2)).sum::<f32>().sqrt();
    let (before, after) = (error(&noisy), error(&denoised));
    println!("error {before} became {after}");
    assert!(after < 0.7 * before, "{before} became {after}");
    folder.expect(0, &["denoise", "out/shadow.exr", "-o", "out/instead.exr", "--prefilter", "--replace"]);
    let instead = read("out/instead.exr");
    assert_eq!(instead.to_rgb("noisy").unwrap(), noisy);
    assert_eq!(instead.to_rgb("").unwrap(), denoised);
    let [_, err] = folder.expect(3, &["denoise", "out/clean.exr", "-o", "out/twice.exr"]);
    contains(&err, &["out/clean.exr", "a layer `denoised` already"]);
}
