//! The program as people run it: exit codes, messages and files, each test in a fresh folder.

use assert_cmd::Command;
use curlsmoke::math::hash::Seed;
use curlsmoke::output::exr::{self, Compression};
use curlsmoke::output::image::{Image, SampleKind};
use curlsmoke::output::sidecar::{Sidecar, is_complete};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A ball in even light: no smoke, so that a frame takes milliseconds.
const BALL: &str = "\
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

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_curlsmoke"));
        command.current_dir(self.0.path()).args(arguments);
        command
    }

    fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs and demands an exit code; standard output and standard error.
    fn expect(&self, code: i32, arguments: &[&str]) -> [String; 2] {
        let output = self.run(arguments);
        let texts = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
        assert_eq!(output.status.code(), Some(code), "{arguments:?}\n{}\n{}", texts[0], texts[1]);
        texts
    }

    fn files(&self, folder: &str) -> Vec<String> {
        let Ok(entries) = fs::read_dir(self.path(folder)) else { return Vec::new() };
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    fn picture(&self, name: &str, value: f32) {
        let mut image = Image::new([8, 4]);
        image.push_rgb("", SampleKind::Float, &[[value; 3]; 32]);
        fs::write(self.path(name), exr::write(&image, Compression::Zips).unwrap()).unwrap();
    }
}

fn contains(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "`{part}` is missing from:\n{text}");
    }
}

#[test]
fn help_goes_to_standard_output_and_mistakes_to_standard_error() {
    let folder = Folder::new();
    let [out, err] = folder.expect(0, &["--help"]);
    contains(&out, &["render", "check", "schema", "bake", "compare", "flow", "streamlines", "128+n"]);
    assert!(err.is_empty());
    for verb in ["render", "check", "schema", "bake", "compare", "flow", "streamlines"] {
        let [out, _] = folder.expect(0, &[verb, "--help"]);
        contains(&out, &["Example: curlsmoke"]);
    }
    for arguments in [&["rendr"][..], &[], &["render"], &["render", "ball.yaml", "--spp", "many"]] {
        let [out, err] = folder.expect(2, arguments);
        assert!(out.is_empty() && !err.is_empty(), "{arguments:?}");
    }
    folder.expect(0, &["--version"]);
}

#[test]
fn check_tells_good_scenes_from_bad_ones() {
    let folder = Folder::new();
    folder.write("bad.yaml", &BALL.replace("radius: 1", "radios: 1"));
    folder.write("nomesh.yaml", &BALL.replace("sphere: {center: [0, 0, 0], radius: 1}", "mesh: {file: none.obj}"));
    let [out, err] = folder.expect(0, &["check", "ball.yaml"]);
    contains(&out, &["ball.yaml: ok", "24 × 16"]);
    assert!(err.is_empty(), "{err}");
    let [out, err] = folder.expect(3, &["check", "ball.yaml", "bad.yaml"]);
    contains(&out, &["ball.yaml: ok"]);
    contains(&err, &["bad.yaml:7:", "radios", "did you mean", "radius"]);
    folder.write("still.yaml", &BALL.replace("ball.####.exr", "ball.exr"));
    let [_, err] = folder.expect(3, &["render", "still.yaml"]);
    contains(&err, &["still.yaml:10:", "####"]);
    folder.expect(4, &["check", "missing.yaml"]);
    let [_, err] = folder.expect(4, &["check", "nomesh.yaml"]);
    contains(&err, &["nomesh.yaml:7:", "none.obj"]);
    let [_, err] = folder.expect(3, &["check", "ball.yaml", "--set", "camera.fov=40"]);
    contains(&err, &["camera.fov"]);
    let [out, _] = folder.expect(3, &["check", "bad.yaml", "ball.yaml", "--format", "json"]);
    let reports: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&reports[0]["ok"], &reports[1]["ok"]), (&false.into(), &true.into()));
    assert_eq!(reports[0]["problems"][0]["position"]["line"], 7);
}

#[test]
fn holes_in_an_obstacle_are_told_by_every_verb_that_reads_it() {
    let folder = Folder::new();
    folder.write("sheet.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let sheet = BALL.replace("sphere: {center: [0, 0, 0], radius: 1}", "mesh: {file: sheet.obj}");
    folder.write("sheet.yaml", &format!("{sheet}flow: {{obstacles: [ball]}}\n"));
    folder.write("decoration.yaml", &sheet);
    folder.write("torn.obj", "v 0 0 0\nv 1 0 nan\n");
    folder.write("torn.yaml", &sheet.replace("sheet.obj", "torn.obj"));
    for verb in ["check", "render"] {
        let [_, err] = folder.expect(0, &[verb, "sheet.yaml"]);
        contains(&err, &["warning: sheet.yaml:7:", "sheet.obj", "3 open edges"]);
        let [_, err] = folder.expect(0, &[verb, "decoration.yaml"]);
        assert!(!err.contains("open edges"), "{err}");
        let [_, err] = folder.expect(3, &[verb, "torn.yaml"]);
        contains(&err, &["error: torn.yaml:7:", "torn.obj"]);
    }
    let [out, _] = folder.expect(0, &["check", "sheet.yaml", "--format", "json"]);
    contains(&out, &["3 open edges"]);
}

#[test]
fn mass_that_obstacles_move_is_accounted_for() {
    let folder = Folder::new();
    let smoky = BALL.replace("last: 3", "last: 1")
        + "flow: {obstacles: [ball]}\nsmoke:\n  emitters: [{sphere: {center: [1.1, 0, 0], radius: 0.3}, count: 500, lifetime: 1, start: -0.5}]\n  \
           grid: {voxel_size: 0.1, kernel_radius: 0.3}\n";
    folder.write("smoky.yaml", &smoky);
    let [out, _] = folder.expect(0, &["bake", "smoky.yaml"]);
    contains(&out, &["smoky.0001.vdb", "voxels", "% of the mass moved away from obstacles"]);
    folder.expect(0, &["render", "smoky.yaml"]);
    let mass = Sidecar::read(&folder.path("out/ball.0001.json")).unwrap().mass;
    assert!(mass.particles > 0.0 && mass.faded > 0.1 * mass.particles, "{mass:?}");
    assert!(((mass.grid + mass.lost) / mass.particles - 1.0).abs() < 1e-6, "{mass:?}");
    let [out, _] = folder.expect(0, &["bake", "smoky.yaml", "--set", "smoke.grid.soft_radius=0"]);
    assert!(!out.contains("moved"), "{out}");
}

#[test]
fn the_schema_is_json_that_describes_the_keys() {
    let folder = Folder::new();
    let [out, _] = folder.expect(0, &["schema"]);
    let schema: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert!(schema["properties"]["camera"].is_object() && schema["properties"]["smoke"].is_object());
}

#[test]
fn a_reader_that_goes_away_is_a_quiet_success_and_a_full_disk_is_not() {
    let folder = Folder::new();
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_curlsmoke"))
        .arg("schema")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), output.stderr.as_slice()), (Some(0), &b""[..]));
    if let Ok(full) = fs::OpenOptions::new().write(true).open("/dev/full") {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_curlsmoke"))
            .current_dir(folder.0.path())
            .arg("schema")
            .stdout(full)
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(5));
        contains(&String::from_utf8(output.stderr).unwrap(), &["standard output"]);
    }
}

#[test]
fn a_dry_run_says_what_would_be_made_and_makes_nothing() {
    let folder = Folder::new();
    let arguments = ["render", "ball.yaml", "--dry-run", "--frames", "3-1x2", "--spp", "8", "--resolution", "50%"];
    let [out, _] = folder.expect(0, &arguments);
    contains(&out, &["2 frames: 3,1", "12 × 8 pixels, 8 samples", "out/ball.0003.exr\nout/ball.0001.exr"]);
    assert!(folder.files("out").is_empty());
}

#[test]
fn wrong_flags_are_usage_errors_that_say_what_to_write() {
    let folder = Folder::new();
    for (arguments, says) in [
        (&["render", "ball.yaml", "--frames", "1-3y2"][..], "use x for a step"),
        (&["render", "ball.yaml", "--frames", "one"], "1-96x2"),
        (&["render", "ball.yaml", "--frames", "1-9"], "frames.last=4"),
        (&["render", "ball.yaml", "--crop", "0,0,99,9"], "24 × 16"),
        (&["render", "ball.yaml", "--crop", "5,5,5,9"], "no pixels"),
        (&["render", "ball.yaml", "--threads", "0"], "1 to"),
        (&["render", "ball.yaml", "--set", "spp"], "key=value"),
        (&["render", "ball.yaml", "--memory-limit", "much"], "512M"),
        (&["compare", "a.exr"], "REFERENCE"),
    ] {
        let [_, err] = folder.expect(2, arguments);
        contains(&err, &[says]);
    }
    assert!(folder.files("out").is_empty());
}

#[test]
fn compare_gives_verdicts_measures_and_maps() {
    let folder = Folder::new();
    folder.picture("a.exr", 0.5);
    folder.picture("b.exr", 0.5);
    folder.picture("c.exr", 0.6);
    let [out, _] = folder.expect(0, &["compare", "a.exr", "b.exr"]);
    contains(&out, &["the pictures agree"]);
    let [out, _] = folder.expect(7, &["compare", "a.exr", "c.exr", "--heat-map", "heat.exr", "--heat-map", "heat.png"]);
    contains(&out, &["FAIL", "32 of 32 pixels differ; first at (0, 0): 0.5 against 0.6", "the pictures differ"]);
    assert!(folder.path("heat.exr").exists() && folder.path("heat.png").exists());
    for (mode, close, far) in
        [("mse", "0.02", "0.005"), ("relmse", "0.03", "0.02"), ("max", "0.11", "0.09"), ("psnr", "15", "16")]
    {
        folder.expect(0, &["compare", "a.exr", "c.exr", "--mode", mode, "--threshold", close]);
        let [out, _] = folder.expect(7, &["compare", "a.exr", "c.exr", "--mode", mode, "--threshold", far]);
        contains(&out, &["FAIL"]);
    }
    let [_, err] = folder.expect(2, &["compare", "a.exr", "b.exr", "--mode", "mse"]);
    contains(&err, &["--threshold"]);
    let [_, err] = folder.expect(2, &["compare", "a.exr", "b.exr", "--mode", "stat"]);
    contains(&err, &["--variance"]);
}

#[test]
fn compare_says_what_is_wrong_with_files() {
    let folder = Folder::new();
    folder.picture("a.exr", 0.5);
    let bytes = fs::read(folder.path("a.exr")).unwrap();
    fs::write(folder.path("half.exr"), &bytes[..bytes.len() / 2]).unwrap();
    folder.write("text.exr", "not a picture");
    folder.write("a.jpg", "");
    let [_, err] = folder.expect(4, &["compare", "a.exr", "missing.exr"]);
    contains(&err, &["missing.exr: no such file"]);
    for name in ["half.exr", "text.exr", "a.jpg"] {
        let [_, err] = folder.expect(3, &["compare", "a.exr", name]);
        contains(&err, &[name]);
    }
    let [_, err] = folder.expect(6, &["compare", "a.exr", "a.exr", "--memory-limit", "0.0000001"]);
    contains(&err, &["--memory-limit"]);
}

#[test]
fn a_sequence_is_rendered_with_all_its_files() {
    let folder = Folder::new();
    let [out, err] = folder.expect(0, &["render", "ball.yaml", "--frames", "1,3"]);
    contains(&out, &["out/ball.0001.exr", "out/ball.0003.exr"]);
    assert!(!out.contains('\r') && !err.contains('\r') && err.contains("frame 3 (2 of 2): done"), "{out}{err}");
    let expected = ["0001", "0003"].map(|n| ["exr", "json", "png"].map(|e| format!("ball.{n}.{e}"))).concat();
    assert_eq!(folder.files("out"), expected);
    let image = exr::read(&folder.path("out/ball.0001.exr"), 1 << 24).unwrap();
    let names: Vec<&str> = image.channels.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names[..5], ["R", "G", "B", "A", "Z"]);
    assert_eq!(names.len(), 5 + 3 * 3);
    let [out, _] = folder.expect(0, &["compare", "out/ball.0001.exr", "out/ball.0001.exr", "--mode", "stat"]);
    contains(&out, &["the pictures agree"]);
}

#[test]
fn a_picture_depends_on_the_scene_and_on_nothing_else() {
    let folder = Folder::new();
    folder.expect(0, &["render", "ball.yaml", "--threads", "1"]);
    let picture = |name: &str| fs::read(folder.path(name)).unwrap();
    let first = [picture("out/ball.0001.exr"), picture("out/ball.0002.exr")];
    folder.expect(0, &["render", "ball.yaml", "--threads", "3", "--frames", "2"]);
    assert!(picture("out/ball.0002.exr") == first[1]);
    folder.expect(0, &["render", "ball.yaml", "--seed", "2", "--frames", "1"]);
    assert!(picture("out/ball.0001.exr") != first[0]);
}

#[test]
fn a_crop_has_the_pixels_of_the_whole() {
    let folder = Folder::new();
    folder.expect(0, &["render", "ball.yaml", "--frames", "1"]);
    let whole = exr::read(&folder.path("out/ball.0001.exr"), 1 << 24).unwrap();
    folder.expect(0, &["render", "ball.yaml", "--frames", "1", "--crop", "6,3,18,11"]);
    let crop = exr::read(&folder.path("out/ball.0001.exr"), 1 << 24).unwrap();
    assert_eq!((crop.size, crop.data_origin, crop.data_size), ([24, 16], [6, 3], [12, 8]));
    for channel in &crop.channels {
        let all = whole.channel(&channel.name).unwrap();
        for (i, value) in channel.data.iter().enumerate() {
            let [x, y] = crop.position(i);
            assert_eq!(value.to_bits(), all[y as usize * 24 + x as usize].to_bits(), "{} at {x}, {y}", channel.name);
        }
    }
}

#[test]
fn resume_keeps_whole_frames_and_makes_the_others() {
    let folder = Folder::new();
    folder.expect(0, &["render", "ball.yaml"]);
    let [exr, json] = ["out/ball.0002.exr", "out/ball.0003.json"].map(|n| folder.path(n));
    let whole = fs::read(&exr).unwrap();
    fs::write(&exr, &whole[..whole.len() - 1]).unwrap();
    fs::remove_file(json).unwrap();
    let before = modified(&folder.path("out/ball.0001.exr"));
    let [out, err] = folder.expect(0, &["render", "ball.yaml", "--resume"]);
    assert!(!out.contains("0001") && out.contains("0002") && out.contains("0003"), "{out}");
    contains(&err, &["frame 1 is finished already"]);
    assert_eq!(modified(&folder.path("out/ball.0001.exr")), before);
    assert!(fs::read(&exr).unwrap() == whole);
    let [out, _] = folder.expect(0, &["render", "ball.yaml", "--resume", "--spp", "5"]);
    contains(&out, &["0001", "0002", "0003"]);
}

fn modified(path: &Path) -> std::time::SystemTime {
    fs::metadata(path).unwrap().modified().unwrap()
}

#[test]
fn a_place_that_cannot_be_written_is_known_before_rendering() {
    let folder = Folder::new();
    folder.write("out", "a file where the folder should be");
    let start = Instant::now();
    let [_, err] = folder.expect(5, &["render", "ball.yaml", "--spp", "1000000"]);
    contains(&err, &["out", "cannot be written"]);
    assert!(start.elapsed() < Duration::from_secs(20));
}

#[test]
#[cfg(unix)]
fn a_signal_stops_the_work_with_its_own_code_and_leaves_no_part_of_a_frame() {
    use std::io::{BufRead, BufReader};
    let folder = Folder::new();
    for (signal, code) in [("TERM", 143), ("INT", 130)] {
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_curlsmoke"))
            .current_dir(folder.0.path())
            .args(["render", "ball.yaml", "--spp", "200000", "--progress", "json"])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
        assert!(lines.any(|line| line.contains(r#""stage":"render""#)));
        let kill = std::process::Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]).status();
        assert!(kill.unwrap().success());
        let last: Vec<String> = lines.collect();
        assert_eq!(child.wait().unwrap().code(), Some(code), "{last:?}");
        assert!(last.iter().any(|line| line.contains(r#""event":"failed""#)), "{last:?}");
        assert!(folder.files("out").is_empty(), "{:?}", folder.files("out"));
    }
}

/// Kills renders of a sequence at `count` moments and looks at what is left, then lets one finish what they began.
fn kill_at_random(count: u64) {
    let folder = Folder::new();
    folder.write("ball.yaml", &BALL.replace("[24, 16], spp: 4", "[320, 180], spp: 2").replace("last: 3", "last: 8"));
    folder.expect(0, &["render", "ball.yaml"]);
    fs::rename(folder.path("out"), folder.path("whole")).unwrap();
    let mut unfinished = 0;
    for i in 0..count {
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_curlsmoke"))
            .current_dir(folder.0.path())
            .args(["render", "ball.yaml", "--resume"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_micros(Seed(4).word(i) % 300_000));
        child.kill().unwrap();
        child.wait().unwrap();
        for name in folder.files("out").iter().filter(|name| !name.starts_with('.')) {
            let [here, whole] = ["out", "whole"].map(|f| folder.path(&format!("{f}/{name}")));
            if name.ends_with(".json") {
                let print = Sidecar::read(&here).unwrap().fingerprint;
                assert!(is_complete(&here, &print), "kill {i}: {name} stands for a frame that is not whole");
            } else {
                assert!(fs::read(here).unwrap() == fs::read(whole).unwrap(), "kill {i}: {name} is not whole");
            }
        }
        unfinished += usize::from(folder.files("out").len() < 24);
        if i % 8 == 7 {
            // Begin anew, so that later kills find work to interrupt.
            let _ = fs::remove_dir_all(folder.path("out"));
        }
    }
    assert!(unfinished > 0, "every run was finished before it was killed");
    folder.expect(0, &["render", "ball.yaml", "--resume"]);
    assert_eq!(folder.files("out"), folder.files("whole"), "temporary files are left");
    for name in folder.files("whole").iter().filter(|name| !name.ends_with(".json")) {
        let [here, whole] = ["out", "whole"].map(|f| fs::read(folder.path(&format!("{f}/{name}"))).unwrap());
        assert!(here == whole, "{name} differs after resuming");
    }
}

#[test]
fn a_killed_sequence_has_only_whole_frames_and_resumes_to_the_same_bytes() {
    kill_at_random(6);
}

#[test]
#[ignore = "takes a minute; run with --ignored"]
fn fifty_kills_leave_only_whole_frames() {
    kill_at_random(50);
}

#[test]
fn progress_for_programs_is_a_json_object_in_each_line() {
    let folder = Folder::new();
    let [_, err] = folder.expect(0, &["render", "ball.yaml", "--progress", "json", "--frames", "1-2"]);
    let events: Vec<serde_json::Value> = err.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let count = |name: &str| events.iter().filter(|e| e["event"] == name).count();
    assert_eq!((count("frame"), count("completed"), count("failed")), (2, 1, 0));
    assert_eq!(events.last().unwrap()["event"], "completed");
    let [_, err] = folder.expect(0, &["render", "ball.yaml", "--progress", "none"]);
    assert!(err.is_empty(), "{err}");
}
