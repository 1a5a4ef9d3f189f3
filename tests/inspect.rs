//! `curlsmoke flow slice` and `curlsmoke streamlines` as people run them, and their numbers against the field.

use curlsmoke::flow::{Flow, NoFiles, VelocityField};
use curlsmoke::geometry::Geometry;
use curlsmoke::output::exr;
use curlsmoke::output::image::{Attribute, Image};
use curlsmoke::progress::Silent;
use curlsmoke::scene::Scene;
use glam::DVec3;
use std::fs;
use std::path::PathBuf;
use std::process::Command;
use tempfile::TempDir;

/// A draught with swirls round a ball; the first frame is not frame 0.
const BALL: &str = "\
version: 1
frames: {first: 3, last: 9, fps: 10}
camera: {position: [1, 2, 4], look_at: [0, 1, 0], vertical_fov_deg: 38}
film: {resolution: [32, 18], spp: 1}
shapes:
  ball:
    sphere: {center: [0, 1.1, 0], radius: 0.3}
flow:
  potentials:
    - uniform: {velocity: [0, 0.7, 0]}
    - noise: {length_scale: 0.5, speed: 0.3, octaves: 2, spin_rate: 0.5, scroll: [0, 0.4, 0]}
  obstacles: [ball]
lights:
  - environment: {radiance: [1, 1, 1]}
smoke:
  emitters:
    - disk: {center: [0, 0.1, 0], radius: 0.2}
      rate: 100
      mass: 1
      lifetime: 2
  grid: {voxel_size: 0.1}
  medium: {extinction: 1, albedo: [1, 1, 1], phase: {henyey_greenstein: {g: 0}}}
";

struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        folder.write("ball.yaml", BALL);
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    fn exr(&self, name: &str) -> Image {
        exr::read(&self.path(name), 1 << 30).unwrap()
    }

    /// Runs and demands an exit code; standard output and standard error.
    fn expect(&self, code: i32, arguments: &[&str]) -> [String; 2] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_curlsmoke"));
        let output = command.current_dir(self.0.path()).args(arguments).output().unwrap();
        let texts = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
        assert_eq!(output.status.code(), Some(code), "{arguments:?}\n{}\n{}", texts[0], texts[1]);
        texts
    }

    /// Names of files in the folder, hidden ones too.
    fn files(&self) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(self.0.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

fn contains(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "`{part}` is missing from:\n{text}");
    }
}

fn field() -> VelocityField {
    let scene = Scene::from_text(BALL, "ball.yaml".as_ref()).unwrap_or_else(|e| panic!("{e}"));
    VelocityField::build(&scene, &Geometry::build(&scene, &Silent).unwrap(), &NoFiles).unwrap()
}

fn vector(image: &Image, name: &str) -> DVec3 {
    let Some(Attribute::Text(text)) = image.attribute(name) else { panic!("{name} is not there") };
    let numbers: Vec<f64> = text.split(' ').map(|n| n.parse().unwrap()).collect();
    DVec3::from_slice(&numbers)
}

#[test]
fn channels_of_a_slice_are_the_field_of_the_frame() {
    let folder = Folder::new();
    let arguments = ["flow", "slice", "ball.yaml", "--frame", "5", "--resolution", "64x36", "-q", "lic,stream"];
    let [out, err] = folder.expect(0, &[&arguments[..], &["-o", "a/b.png"]].concat());
    contains(&out, &["frame 5", "speed: RMS", "divergence: largest", "inside obstacles:", "stream function", "b.exr"]);
    assert!(err.is_empty(), "{err}");
    let (image, field) = (folder.exr("a/b.exr"), field());
    let corner = ["curlsmoke/sliceCenter", "curlsmoke/sliceRight", "curlsmoke/sliceUp"].map(|n| vector(&image, n));
    let channel = |name: &str| image.channel(name).unwrap_or_else(|| panic!("{name}"));
    let mut inside = 0;
    for i in 0..64 * 36 {
        let (x, y) = ((i % 64) as f64 + 0.5, (i / 64) as f64 + 0.5);
        let p = (corner[0] + corner[1] * (x / 64.0 - 0.5) + corner[2] * (0.5 - y / 36.0)).to_array();
        let v = field.velocity(p, 0.2);
        for (axis, name) in ["velocity.X", "velocity.Y", "velocity.Z"].into_iter().enumerate() {
            assert!((f64::from(channel(name)[i]) - v[axis]).abs() < 1e-6, "{name} at {p:?}");
        }
        let distance = field.distance(p, 0.2);
        assert!((f64::from(channel("distance")[i]) - distance).abs() < 1e-6);
        assert!((f64::from(channel("speed")[i]) - DVec3::from_array(v).length()).abs() < 1e-6);
        if distance > 0.01 {
            assert!(channel("divergence")[i].abs() < 1e-4, "{} at {p:?}", channel("divergence")[i]);
        }
        inside += usize::from(distance < 0.0);
    }
    assert!(inside > 20, "the ball is in the slice");
    assert_eq!((channel("lic").len(), channel("stream").len()), (64 * 36, 64 * 36));
    assert!(folder.path("a/b.lic.png").exists() && folder.path("a/b.stream.png").exists());
}

#[test]
fn flows_along_tracks_are_seen_and_their_lines_stay_on_them() {
    let folder = Folder::new();
    let start = BALL.find("  potentials:").unwrap();
    let end = BALL.find("lights:").unwrap();
    let dfvn = "  dfvn: {length_scale: 0.3, speed: 0.5, inside: ball}\n";
    let text = format!("{}{dfvn}{}", &BALL[..start], &BALL[end..])
        .replace("disk: {center: [0, 0.1, 0], radius: 0.2}", "sphere: {center: [0, 1.1, 0], radius: 0.25}");
    folder.write("tracks.yaml", &text);
    let scene = Scene::from_text(&text, "tracks.yaml".as_ref()).unwrap_or_else(|e| panic!("{e}"));
    let flow = Flow::build(&scene, &Geometry::build(&scene, &Silent).unwrap(), &NoFiles).unwrap();

    let slice = ["flow", "slice", "tracks.yaml", "--plane", "z=0", "--size", "0.8x0.45", "--resolution", "64x36"];
    let [out, _] = folder.expect(0, &[&slice[..], &["-q", "lic,distance,stream", "-o", "a.png"]].concat());
    contains(&out, &["speed: RMS", "inside obstacles:", "stream function: accounts for"]);
    let image = folder.exr("a.exr");
    let channel = |name: &str| image.channel(name).unwrap_or_else(|| panic!("{name}"));
    for i in 0..64 * 36 {
        let (x, y) = ((i % 64) as f64 + 0.5, (i / 64) as f64 + 0.5);
        let p = [0.8 * (x / 64.0 - 0.5), 1.0 + 0.45 * (0.5 - y / 36.0), 0.0];
        let v = flow.span(0.0, 0.0).velocity(p, 0.0);
        assert!((f64::from(channel("velocity.X")[i]) - v[0]).abs() < 1e-5, "at {p:?}");
        let depth = 0.3 - DVec3::from_array(p).distance(DVec3::Y * 1.1);
        // Positive where smoke may be, as for containers.
        assert!((f64::from(channel("distance")[i]) - depth).abs() < 1e-6, "at {p:?}");
    }

    folder.expect(0, &["streamlines", "tracks.yaml", "-n", "20", "--length", "3m", "--step", "0.01", "-o", "a.obj"]);
    let lines = polylines(&String::from_utf8(folder.read("a.obj")).unwrap());
    let mut worst = 0.0f64;
    for line in &lines {
        let born = flow.iso_values(line[0].to_array()).unwrap();
        for p in line {
            let values = flow.iso_values(p.to_array()).unwrap();
            worst = worst.max((values[0] - born[0]).abs()).max((values[1] - born[1]).abs());
        }
    }
    println!("{} lines: values change by {worst:.1e} at most", lines.len());
    // Files have single precision.
    assert!(lines.len() > 15 && lines.iter().all(|line| line.len() > 50) && worst < 1e-6);
}

#[test]
fn files_do_not_depend_on_threads_and_repeat() {
    let folder = Folder::new();
    for (name, threads) in [("one", "1"), ("two", "2")] {
        let slice = ["flow", "slice", "ball.yaml", "--resolution", "96x54", "-j", threads, "-o", name];
        folder.expect(0, &slice);
        let (lines, preview) = (format!("{name}.ply"), format!("{name}.lines.png"));
        let trace = ["streamlines", "ball.yaml", "-n", "20", "-j", threads, "--preview", &preview, "--res", "96x54"];
        folder.expect(0, &[&trace[..], &["-o", &lines]].concat());
    }
    for ending in ["png", "exr", "ply", "lines.png"] {
        assert!(folder.read(&format!("one.{ending}")) == folder.read(&format!("two.{ending}")), "{ending}");
    }
    let seeded = ["streamlines", "ball.yaml", "-n", "20", "--set", "render.seed=9", "-o", "seeded.ply"];
    folder.expect(0, &seeded);
    assert!(folder.read("one.ply") != folder.read("seeded.ply"));
}

/// Polylines of an .obj file.
fn polylines(text: &str) -> Vec<Vec<DVec3>> {
    let mut vertices = Vec::new();
    let mut lines = Vec::new();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => vertices.push(DVec3::from_slice(&words.map(|w| w.parse().unwrap()).collect::<Vec<f64>>())),
            Some("l") => lines.push(words.map(|w| vertices[w.parse::<usize>().unwrap() - 1]).collect()),
            _ => {}
        }
    }
    lines
}

#[test]
fn stream_lines_are_along_the_field_and_outside_of_obstacles() {
    let folder = Folder::new();
    let arguments = ["streamlines", "ball.yaml", "-f", "6", "--seeds", "plane", "-n", "60", "--length", "0.8m"];
    let [out, _] = folder.expect(0, &[&arguments[..], &["--step", "0.005", "-o", "lines.obj"]].concat());
    contains(&out, &["stream lines at frame 6", "lines of"]);
    let field = field();
    let lines = polylines(&String::from_utf8(folder.read("lines.obj")).unwrap());
    assert!(lines.len() > 50, "{}", lines.len());
    for line in &lines {
        for pair in line.windows(2) {
            let (chord, middle) = (pair[1] - pair[0], 0.5 * (pair[0] + pair[1]));
            let v = DVec3::from_array(field.velocity(middle.to_array(), 0.3));
            // Positions are in single precision.
            assert!((chord.normalize() - v.normalize()).length() * chord.length() < 2e-5, "{chord} {v}");
            assert!(field.distance(pair[1].to_array(), 0.3) > -1e-6);
        }
        let way: f64 = line.windows(2).map(|pair| pair[1].distance(pair[0])).sum();
        assert!(way < 0.8001, "{way}");
    }
}

#[test]
fn path_lines_move_with_time_and_stream_lines_do_not() {
    let folder = Folder::new();
    let end = |name: &str, more: &[&str]| {
        folder
            .expect(0, &[&["streamlines", "ball.yaml", "-n", "4", "--length", "1.5s", "-o", name][..], more].concat());
        polylines(&String::from_utf8(folder.read(name)).unwrap())
    };
    let (still, moving) = (end("still.obj", &[]), end("moving.obj", &["--pathlines"]));
    assert_eq!((still.len(), moving.len()), (4, 4));
    for (a, b) in still.iter().zip(&moving) {
        assert_eq!((a[0], a.len()), (b[0], b.len()));
        assert!(a.last().unwrap().distance(*b.last().unwrap()) > 1e-3);
    }
    // The same by hand, in small steps of the midpoint rule.
    let field = field();
    let (mut p, steps) = (moving[0][0], 3000);
    for n in 0..steps {
        let (time, h) = (1.5 * f64::from(n) / f64::from(steps), 1.5 / f64::from(steps));
        let v = |p: DVec3, time: f64| DVec3::from_array(field.velocity(p.to_array(), time));
        p += h * v(p + 0.5 * h * v(p, time), time + 0.5 * h);
    }
    assert!(p.distance(*moving[0].last().unwrap()) < 1e-4, "{p} {}", moving[0].last().unwrap());
}

#[test]
fn wrong_flags_are_usage_errors_that_say_what_to_write() {
    let folder = Folder::new();
    let slice = &["flow", "slice", "ball.yaml", "-o", "out"][..];
    let lines = &["streamlines", "ball.yaml", "-o", "out.ply"][..];
    for (verb, more, says) in [
        (slice, &["--plane", "up"][..], "0,1,0,0,0.5,1"),
        (slice, &["--plane", "0,0,0,0,0,0"], "no direction"),
        (slice, &["--quantity", "vorticity"], "divergence"),
        (slice, &["--size", "3"], "3.2x1.8"),
        (slice, &["--size", "2x2", "--resolution", "640x360"], "--resolution 640x640"),
        (slice, &["--frame", "99"], "frames 3-9"),
        (slice, &["--resolution", "0x9"], "640x360"),
        (lines, &["--length", "3"], "1.5m"),
        (lines, &["--step", "0"], "0.01"),
        (lines, &["--count", "0"], "count"),
        (lines, &["--seeds", "moon"], "emitters"),
        (lines, &["--preview", "a.jpg"], ".png"),
        (lines, &["-o", "lines.usd"], ".obj or .ply"),
    ] {
        // A flag given twice is an error of its own.
        let verb = if more[0] == "-o" { &verb[..2] } else { verb };
        let [_, err] = folder.expect(2, &[verb, more].concat());
        contains(&err, &[says]);
    }
    assert_eq!(folder.files(), ["ball.yaml"]);
}

#[test]
fn what_cannot_be_looked_at_has_its_exit_code_and_leaves_nothing() {
    let folder = Folder::new();
    folder.write("bare.yaml", &BALL[..BALL.find("smoke:").unwrap()].replace("  obstacles: [ball]\n", ""));
    folder.write("file", "");
    let before = folder.files();
    for (code, arguments, says) in [
        (3, &["flow", "slice", "bare.yaml", "-q", "distance", "-o", "out"][..], "flow.obstacles"),
        (3, &["streamlines", "bare.yaml", "-o", "out.obj"], "--seeds plane"),
        (4, &["flow", "slice", "none.yaml", "-o", "out"], "none.yaml"),
        (5, &["flow", "slice", "ball.yaml", "-o", "file/out"], "file"),
        (5, &["streamlines", "ball.yaml", "-o", "file/out.ply"], "file"),
        (5, &["streamlines", "ball.yaml", "-o", "out.ply", "--preview", "file/out.png"], "file"),
        (
            6,
            &["flow", "slice", "ball.yaml", "--memory-limit", "64M", "--res", "4000x2250", "-o", "out"],
            "--resolution",
        ),
        (6, &["flow", "slice", "ball.yaml", "--res", "4000000000x2250000000", "-o", "out"], "--resolution"),
        (6, &["streamlines", "ball.yaml", "-n", "4000000000", "-o", "out.ply"], "--count"),
        (6, &["streamlines", "ball.yaml", "--length", "1e300s", "-o", "out.ply"], "--length"),
    ] {
        let [out, err] = folder.expect(code, arguments);
        assert!(out.is_empty(), "{out}");
        contains(&err, &[says]);
    }
    let inside = ["streamlines", "ball.yaml", "--seeds", "plane", "--plane", "0,1.1,0,0,0,1", "--size", "0.1x0.1"];
    let [_, err] = folder.expect(3, &[&inside[..], &["-n", "4", "-o", "out.ply"]].concat());
    contains(&err, &["inside obstacles", "--seeds"]);
    assert_eq!(folder.files(), before);
}

#[test]
fn help_says_how_with_an_example() {
    let folder = Folder::new();
    let [out, _] = folder.expect(0, &["flow", "slice", "--help"]);
    contains(&out, &["Example: curlsmoke flow slice", "--plane", "line integral convolution"]);
    let [out, _] = folder.expect(0, &["streamlines", "--help"]);
    contains(&out, &["Example: curlsmoke streamlines", "--pathlines", "1.5m"]);
}
