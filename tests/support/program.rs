//! The program in a fresh folder.

#![allow(dead_code, reason = "each test program uses a part")]

use assert_cmd::Command;
use curlsmoke::output::exr::{self, Compression};
use curlsmoke::output::image::{Image, SampleKind};
use std::fs;
use std::path::PathBuf;
use std::process::Output;
use tempfile::TempDir;

/// A ball in even light: no smoke, so that a frame takes milliseconds.
pub const BALL: &str = "\
version: 1
frames: {first: 1, last: 3}
camera: {position: [0, 0, 4], look_at: [0, 0, 0]}
film: {resolution: [24, 16], spp: 4}
shapes:
  ball:
    sphere: {center: [0, 0, 0], radius: 1}
lights:
  - environment: {radiance: [1, 1, 1]}
output: {image: out/ball.####.exr, preview: out/ball.####.png, aovs: [depth, normal, albedo, variance]}
";

/// A puff in a narrow swirl between two balls, born partly inside one of them: particles, obstacles, light.
pub const SMOKE: &str = "\
version: 1
frames: {first: 1, last: 3}
camera: {position: [0, 0.5, 4], look_at: [0, 0.5, 0]}
film: {resolution: [16, 16], spp: 4}
shapes:
  left: {sphere: {center: [-0.65, 0.5, 0], radius: 0.3}}
  right: {sphere: {center: [0.65, 0.5, 0], radius: 0.3}}
flow:
  potentials:
    - uniform: {velocity: [0.1, 0.4, 0]}
    - noise: {length_scale: 0.5, speed: 0.5, octaves: 2}
  obstacles: [left, right]
smoke:
  emitters: [{sphere: {center: [-0.3, 0.2, 0], radius: 0.3}, rate: 2000, mass: 0.2, lifetime: 2, start: -1}]
  grid: {voxel_size: 0.04}
  medium: {extinction: 20, albedo: [0.9, 0.9, 0.9]}
lights:
  - environment: {radiance: [1, 1, 1]}
output: {image: out/smoke.####.exr}
";

/// `SMOKE` hot and in one gust, so that it glows and drifts.
pub fn hot_smoke() -> String {
    SMOKE.replace("  medium:", "  blackbody: {temperature: 1800, cooling_time: 1.5, gain: 1}\n  medium:")
}

pub fn scene_from_files(scene: &str, file: &str) -> String {
    let start = scene.find("  emitters").unwrap();
    let end = scene.find("  blackbody").or(scene.find("  medium")).unwrap();
    format!("{}  file: {file}\n{}", &scene[..start], &scene[end..])
}

/// A fresh folder with a scene in it.
pub struct Folder(pub TempDir);

impl Folder {
    pub fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        folder.write("ball.yaml", BALL);
        folder
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_curlsmoke"));
        command.current_dir(self.0.path()).args(arguments);
        command
    }

    pub fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs and demands an exit code; standard output and standard error.
    pub fn expect(&self, code: i32, arguments: &[&str]) -> [String; 2] {
        let output = self.run(arguments);
        let texts = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
        assert_eq!(output.status.code(), Some(code), "{arguments:?}\n{}\n{}", texts[0], texts[1]);
        texts
    }

    pub fn files(&self, folder: &str) -> Vec<String> {
        let Ok(entries) = fs::read_dir(self.path(folder)) else { return Vec::new() };
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    pub fn picture(&self, name: &str, value: f32) {
        let mut image = Image::new([8, 4]);
        image.push_rgb("", SampleKind::Float, &[[value; 3]; 32]);
        fs::write(self.path(name), exr::write(&image, Compression::Zips).unwrap()).unwrap();
    }
}

/// Demands that a text has all parts.
pub fn contains(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "`{part}` is missing from:\n{text}");
    }
}
