//! The files that the program leaves: the same whatever way they came about, and whole whatever happens.

#[path = "support/program.rs"]
mod program;

use curlsmoke::math::hash::Seed;
use curlsmoke::output::exr;
use curlsmoke::output::sidecar::{Sidecar, is_complete};
use curlsmoke::progress::Stage;
use program::{BALL, Folder, SMOKE, contains};
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

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
    for name in ["worldToCamera", "worldToNDC", "software", "colorInteropID", "framesPerSecond", "curlsmoke/seed"] {
        assert!(image.attribute(name).is_some(), "{name}: {:?}", image.attributes);
    }
    let lengths = ["zips", "zip", "piz", "none"].map(|compression| {
        let set = format!("output.compression={compression}");
        folder.expect(0, &["render", "ball.yaml", "--frames", "2", "--set", &set]);
        folder.expect(0, &["compare", "out/ball.0002.exr", "out/ball.0002.exr", "--mode", "stat"]);
        fs::metadata(folder.path("out/ball.0002.exr")).unwrap().len()
    });
    assert!(lengths[..3].iter().all(|length| *length < lengths[3]), "{lengths:?}");
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
fn smoke_depends_on_the_scene_and_on_nothing_else() {
    let folder = Folder::new();
    folder.write("smoke.yaml", SMOKE);
    folder.expect(0, &["render", "smoke.yaml", "--threads", "1"]);
    let picture = |frame: i32| fs::read(folder.path(&format!("out/smoke.000{frame}.exr"))).unwrap();
    let sequence = [1, 2, 3].map(picture);
    let differ = |how: &str| {
        let differing: Vec<i32> = (1..=3).filter(|&f| picture(f) != sequence[f as usize - 1]).collect();
        assert!(differing.is_empty(), "{how}: frames {differing:?} differ");
    };
    folder.expect(0, &["render", "smoke.yaml", "--threads", "3", "--frames", "3"]);
    differ("the last frame alone, on three threads");
    folder.expect(0, &["render", "smoke.yaml", "--frames", "3-1"]);
    differ("backwards");
    fs::remove_file(folder.path("out/smoke.0002.json")).unwrap();
    folder.expect(0, &["render", "smoke.yaml", "--resume"]);
    differ("resumed");
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

#[test]
fn resume_finds_a_preview_in_another_folder_and_makes_one_under_another_name() {
    let folder = Folder::new();
    let render = |preview: &str, more: &[&str]| {
        let preview = format!("output.preview={preview}");
        folder.expect(0, &[&["render", "ball.yaml", "--frames", "1", "--set", &preview], more].concat())
    };
    render("png/ball.####.png", &[]);
    let sidecar = Sidecar::read(&folder.path("out/ball.0001.json")).unwrap();
    assert_eq!(sidecar.files[1].name, "../png/ball.0001.png");
    let [_, err] = render("png/ball.####.png", &["--resume"]);
    contains(&err, &["frame 1 is finished already"]);
    let [out, _] = render("png/other.####.png", &["--resume"]);
    contains(&out, &["ball.0001.exr"]);
    assert_eq!(folder.files("png"), ["ball.0001.png", "other.0001.png"]);
    let [_, err] = render("png/other.####.png", &["--resume"]);
    contains(&err, &["frame 1 is finished already"]);
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
    folder.write("busy", "a file where the folder of the previews should be");
    let image = ["--set", "output.image=free/ball.####.exr", "--set", "output.preview=busy/ball.####.png"];
    let [_, err] = folder.expect(5, &[&["render", "ball.yaml", "--spp", "1000000"], &image[..]].concat());
    contains(&err, &["busy", "cannot be written"]);
    for name in ["x".repeat(300), "a\\0b".into()] {
        let set = format!("output.image=\"free/{name}.####.exr\"");
        let preview = "output.preview=free/ball.####.png";
        let [_, err] = folder.expect(5, &["render", "ball.yaml", "--spp", "1000000", "--set", &set, "--set", preview]);
        contains(&err, &["free/", "cannot be written"]);
    }
    fs::create_dir_all(folder.path("free/ball.0002.exr")).unwrap();
    let image = ["--set", image[1], "--set", "output.preview=free/ball.####.png"];
    let [_, err] = folder.expect(5, &[&["render", "ball.yaml", "--spp", "1000000"], &image[..]].concat());
    contains(&err, &["free/ball.0002.exr", "it is a folder"]);
    folder.write("smoke.yaml", SMOKE);
    let [_, err] = folder.expect(5, &["bake", "smoke.yaml", "--output", "busy/a.####.vdb", "--progress", "json"]);
    contains(&err, &["busy", "cannot be written"]);
    assert!(!err.contains(r#""stage":"#), "work was done before: {err}");
    assert!(start.elapsed() < Duration::from_secs(60));
}

#[test]
#[cfg(unix)]
fn the_densest_smoke_ends_and_heeds_signals() {
    let folder = Folder::new();
    folder.write("smoke.yaml", SMOKE);
    let dense = ["render", "smoke.yaml", "--frames", "1", "--spp", "1"];
    for (mass, extinction) in [("1e12", "1000"), ("0.02", "1e9")] {
        let [mass, extinction] =
            [format!("smoke.emitters[0].mass={mass}"), format!("smoke.medium.extinction={extinction}")];
        let start = Instant::now();
        folder.expect(0, &[&dense[..], &["--set", &mass, "--set", &extinction]].concat());
        assert!(start.elapsed() < Duration::from_secs(60), "{mass} {extinction}");
    }
    let beyond = ["--set", "smoke.emitters[0].mass=1e12", "--set", "smoke.medium.extinction=1e9"];
    let [_, err] = folder.expect(3, &[&dense[..], &beyond].concat());
    contains(&err, &["smoke.medium.extinction", "at most 1e20", "lower"]);
    // A single pixel of which would take hours.
    let long = ["render", "smoke.yaml", "--frames", "1", "--spp", "16777216", "--threads", "1", "--progress", "json"];
    let (code, last) = stopped_in(Stage::Render, &folder, &long, "TERM");
    assert!(code == Some(143) && last.contains(r#""event":"failed""#), "{code:?} {last}");
}

#[test]
#[cfg(unix)]
fn work_that_does_not_look_up_is_stopped_by_time() {
    let folder = Folder::new();
    folder.write("tetrahedron.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n");
    let shapes = "shapes:\n  left: {mesh: {file: tetrahedron.obj, distance_voxel: 0.003}}\n";
    folder.write(
        "fine.yaml",
        &SMOKE.replace("shapes:\n  left: {sphere: {center: [-0.65, 0.5, 0], radius: 0.3}}\n", shapes),
    );
    let (code, last) = stopped_in(Stage::Geometry, &folder, &["render", "fine.yaml", "--progress", "json"], "INT");
    assert!(code == Some(130) && last.contains("stopped; finished frames are whole"), "{code:?} {last}");
}

/// Runs until a stage begins, sends a signal, and waits; the exit code, and what was said after the signal.
#[cfg(unix)]
fn stopped_in(stage: Stage, folder: &Folder, arguments: &[&str], signal: &str) -> (Option<i32>, String) {
    use std::io::{BufRead, BufReader};
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_curlsmoke"))
        .current_dir(folder.0.path())
        .args(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    let begins = format!(r#""stage":"{}""#, stage.name());
    assert!(lines.any(|line| line.contains(&begins)));
    let start = Instant::now();
    let kill = std::process::Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]).status();
    assert!(kill.unwrap().success());
    let last: Vec<String> = lines.collect();
    let code = child.wait().unwrap().code();
    assert!(start.elapsed() < Duration::from_secs(30), "{:?}", start.elapsed());
    (code, last.join("\n"))
}

#[test]
#[cfg(unix)]
fn a_signal_stops_the_work_with_its_own_code_and_leaves_no_part_of_a_frame() {
    let folder = Folder::new();
    for (signal, code) in [("TERM", 143), ("INT", 130)] {
        let arguments = ["render", "ball.yaml", "--spp", "200000", "--progress", "json"];
        let (found, last) = stopped_in(Stage::Render, &folder, &arguments, signal);
        assert!(found == Some(code) && last.contains(r#""event":"failed""#), "{found:?} {last}");
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
                assert!(is_complete(&here, &print, &[]), "kill {i}: {name} stands for a frame that is not whole");
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
#[cfg(target_os = "linux")]
fn the_memory_limit_is_kept() {
    // A block of smoke of millions of voxels, where bricks count, and two puffs far apart, where their directory does; both
    // from few particles.
    let block = "{box: {center: [0, 0.5, 0], size: [1, 1, 1]}, count: 150000, start: -0.1, lifetime: 10}";
    let puff =
        |at: &str| format!("{{box: {{center: {at}, size: [0.2, 0.2, 0.2]}}, count: 1000, start: -0.1, lifetime: 10}}");
    let puffs = [puff("[-2.5, -2.5, -2.5]"), puff("[2.5, 2.5, 2.5]")].join(", ");
    for (name, emitters, edge) in [("block", block, 512), ("puffs", &puffs, 64)] {
        let folder = Folder::new();
        let line = SMOKE.lines().find(|line| line.contains("emitters")).unwrap();
        let flow = &SMOKE[SMOKE.find("flow:").unwrap()..SMOKE.find("smoke:").unwrap()];
        let scene = SMOKE.replace(line, &format!("  emitters: [{emitters}]")).replace(flow, "");
        let scene = scene.replace("voxel_size: 0.04", "voxel_size: 0.004");
        folder.write("smoke.yaml", &scene.replace("[16, 16], spp: 4", &format!("[{edge}, {edge}], spp: 1")));
        let mut limit = 100.0;
        let all = "output.aovs=[depth, normal, albedo, variance]";
        let sidecar = loop {
            let arguments = ["render", "smoke.yaml", "--frames", "1", "--set", all, "--set", "render.max_bounces=2"];
            let output = folder.run(&[&arguments[..], &["--memory-limit", &format!("{limit}M")]].concat());
            match output.status.code() {
                Some(0) => break Sidecar::read(&folder.path("out/smoke.0001.json")).unwrap(),
                Some(6) => limit *= 1.05,
                code => panic!("{code:?} {}", String::from_utf8_lossy(&output.stderr)),
            }
            assert!(limit < 2000.0);
        };
        let peak = sidecar.memory_peak as f64 / f64::from(1 << 20);
        println!("{name}: limit {limit:.0} MiB, peak {peak:.0} MiB, {} voxels", sidecar.grid.active_voxels);
        assert!(limit > 120.0 && peak <= 1.1 * limit, "{name}: limit {limit:.0} MiB, peak {peak:.0} MiB");
    }
}

#[test]
fn points_are_written_and_told_of_in_every_format() {
    let folder = Folder::new();
    let [out, _] =
        folder.expect(0, &["points", "--dim", "3", "--per-axis", "6", "-o", "out/p.csv", "--plot", "out/g.png"]);
    assert!(
        out.starts_with("out/p.csv: 216 points in ") && out.contains("distance to the closest: median 0.1"),
        "{out}"
    );
    let text = fs::read_to_string(folder.path("out/p.csv")).unwrap();
    assert_eq!((text.lines().count(), text.lines().next()), (217, Some("x0,x1,x2")));
    assert!(fs::read(folder.path("out/g.png")).unwrap().starts_with(b"\x89PNG"));
    folder.expect(0, &["points", "--dim", "7", "--per-axis", "2", "--method", "jitter", "-o", "out/p.npy"]);
    assert_eq!(fs::read(folder.path("out/p.npy")).unwrap().len(), 128 + 128 * 7 * 8);
    for method in ["poisson", "sobol", "lattice"] {
        let [out, _] =
            folder.expect(0, &["points", "--dim", "2", "--per-axis", "8", "--method", method, "-o", "out/p.ply"]);
        assert!(out.contains(" points in "), "{out}");
    }
    // An animation in a ball: as many points in every frame.
    let ball = ["points", "--dim", "3", "--per-axis", "8", "--ball", "0.4", "--frames", "1-3", "-o", "out/b.####.csv"];
    let [out, _] = folder.expect(0, &ball);
    let counts: Vec<_> = out.lines().map(|line| line.split(' ').nth(1)).collect();
    assert!(counts.len() == 3 && counts.iter().all(|c| *c == counts[0]), "{out}");
    assert_ne!(fs::read(folder.path("out/b.0001.csv")).unwrap(), fs::read(folder.path("out/b.0002.csv")).unwrap());
}

#[test]
fn points_that_cannot_be_are_refused_with_advice() {
    let folder = Folder::new();
    let cases: [(i32, &[&str], &str); 11] = [
        (2, &["--dim", "8", "-o", "p.csv"], "8 is not in 2..=7"),
        (2, &["--dim", "3", "-o", "p.txt"], "must end in .csv, .npy or .ply"),
        (2, &["--dim", "4", "-o", "p.ply"], "write .csv or .npy"),
        (2, &["--dim", "3", "--method", "sobol", "--step", "1", "-o", "p.csv"], "--step belongs to --method curl"),
        (2, &["--dim", "3", "--radius", "0.1", "-o", "p.csv"], "--radius belongs to --method poisson"),
        (2, &["--dim", "3", "--ball", "0.9", "-o", "p.csv"], "--ball 0.9: write a number from 0.001 to 0.5"),
        (2, &["--dim", "3", "--length", "nan", "-o", "p.csv"], "--length NaN"),
        (2, &["--dim", "2", "--frames", "1-3", "-o", "p.csv"], "frames 1 and 2"),
        (2, &["--dim", "2", "--ball", "0.4", "--step", "-20", "-o", "p.csv"], "--step with --ball -20"),
        (2, &["--dim", "2", "--method", "poisson", "--radius", "1e-6", "-o", "p.csv"], "--radius 0.000001"),
        (6, &["--dim", "7", "--per-axis", "1000", "-o", "p.csv"], "choose a smaller --per-axis"),
    ];
    for (code, arguments, words) in cases {
        let [_, error] = folder.expect(code, &[&["points"], arguments].concat());
        assert!(error.contains(words), "{arguments:?}: {error}");
    }
    assert!(
        fs::read_dir(folder.path(".")).unwrap().all(|f| !f.unwrap().file_name().to_string_lossy().starts_with("p."))
    );
}

#[test]
fn layers_go_to_parts_or_files_of_their_own() {
    let folder = Folder::new();
    let render = |name: &str, more: &[&str]| {
        let output = format!("out/{name}.####.exr");
        folder.expect(0, &[&["render", "ball.yaml", "--frames", "2", "-o", &output], more].concat());
        exr::read(&folder.path(&format!("out/{name}.0002.exr")), 1 << 24).unwrap()
    };
    let single = render("a", &[]);
    assert_eq!(render("b", &["--set", "output.layout=multipart"]).channels, single.channels);
    let colours = render("c", &["--set", "output.layout=separate"]);
    assert_eq!(colours.channels.len(), 4);
    for layer in ["Z", "N", "albedo", "variance"] {
        let own = exr::read(&folder.path(&format!("out/c.{layer}.0002.exr")), 1 << 24).unwrap();
        assert!(!own.channels.is_empty() && own.channels.iter().all(|c| single.channel(&c.name) == Some(&c.data)));
    }
    // All of them are part of the frame: one that is gone is made again.
    let again =
        ["render", "ball.yaml", "--frames", "2", "-o", "out/c.####.exr", "--set", "output.layout=separate", "--resume"];
    let [_, err] = folder.expect(0, &again);
    contains(&err, &["frame 2 is finished already"]);
    fs::remove_file(folder.path("out/c.N.0002.exr")).unwrap();
    folder.expect(0, &again);
    assert!(folder.path("out/c.N.0002.exr").exists());
    // Parts of the paths are joined into the same files.
    for samples in ["1-1", "2-4"] {
        folder.expect(0, &[&again[..8], &["--samples", samples]].concat());
    }
    let parts = ["out/c.0002.samples-1-1.part", "out/c.0002.samples-2-4.part"];
    folder.expect(0, &["merge", parts[0], parts[1], "-o", "out/d.####.exr"]);
    for (ours, theirs) in [("d.0002.exr", "c.0002.exr"), ("d.N.0002.exr", "c.N.0002.exr")] {
        let bytes = |name: &str| fs::read(folder.path(&format!("out/{name}"))).unwrap();
        assert!(bytes(ours) == bytes(theirs), "{ours}");
    }
    let [_, err] = folder.expect(3, &["check", "ball.yaml", "--set", "output.compression=dwaa"]);
    contains(&err, &["output.compression", "layer `depth`", "multipart"]);
    render("e", &["--set", "output.compression=dwaa", "--set", "output.layout=multipart"]);
}

#[test]
fn walls_that_turn_too_far_in_a_step_are_told_of() {
    let turning = |degrees: u32| {
        let keys = format!(
            "{{interpolation: linear, 1: {{axis: [0, 1, 0], angle: 0}}, 3: {{axis: [0, 1, 0], angle: {degrees}}}}}"
        );
        SMOKE.replace(
            "left: {sphere: {center: [-0.65, 0.5, 0], radius: 0.3}}",
            &format!(
                "left: {{box: {{center: [-0.65, 0.5, 0], size: [0.5, 0.5, 0.5]}}, transform: {{rotate_deg: {keys}}}}}"
            ),
        )
    };
    let folder = Folder::new();
    folder.write("smoke.yaml", &turning(1000));
    // Half a thousand degrees a frame are 2.8 half turns.
    let told = ["smoke.yaml:6:", "`left` turns by 500°", "frame 2", "`smoke.advect.substeps` to 3 or more"];
    for command in [&["check"][..], &["render", "--frames", "1", "--spp", "1"], &["bake", "--frames", "1"]] {
        let [verb, more @ ..] = command else { unreachable!() };
        let [_, err] = folder.expect(0, &[&[*verb, "smoke.yaml"], more].concat());
        contains(&err, &told);
    }
    let [_, err] = folder.expect(0, &["check", "smoke.yaml", "--set", "smoke.advect.substeps=3"]);
    assert!(!err.contains("turns"), "{err}");
    let [_, err] = folder.expect(0, &["check", "smoke.yaml", "--set", "smoke.advect.substeps=2"]);
    contains(&err, &["`left` turns by 250°"]);
    for (degrees, is_told) in [(350, false), (360, true)] {
        folder.write("smoke.yaml", &turning(degrees));
        let [_, err] = folder.expect(0, &["check", "smoke.yaml"]);
        assert_eq!(err.contains("turns"), is_told, "{degrees}: {err}");
    }
    // Nine million steps and a thousand keys: it takes minutes to look at all of them from each step.
    let keys = |degrees: u32| -> String {
        let further = (2..=1000).map(|n| format!(", {n}: {{axis: [0, 1, 0], angle: {}}}", (n - 1) * degrees));
        turning(0)
            .replace(", 3: {axis: [0, 1, 0], angle: 0}", &further.collect::<String>())
            .replace("last: 3}", "last: 100000}")
    };
    let start = Instant::now();
    for (degrees, is_told) in [(18_000, true), (100, false)] {
        folder.write("smoke.yaml", &keys(degrees));
        let [_, err] = folder.expect(0, &["check", "smoke.yaml", "--set", "smoke.advect.substeps=90"]);
        assert_eq!(err.contains("`left` turns by 200°"), is_told, "{degrees}: {err}");
    }
    assert!(start.elapsed() < Duration::from_secs(10), "{:?}", start.elapsed());
    // The first of steps that are alike but for rounding.
    folder.write(
        "smoke.yaml",
        &turning(1080).replace("last: 3}", "last: 3000}").replace("linear, 1", "linear, repeat: true, 1"),
    );
    let [_, err] = folder.expect(0, &["check", "smoke.yaml"]);
    contains(&err, &["`left` turns by 540°", "frame -22"]);
    // What is no wall drags nothing.
    folder.write("smoke.yaml", &turning(1000).replace("[left, right]", "[right]"));
    let [_, err] = folder.expect(0, &["check", "smoke.yaml"]);
    assert!(!err.contains("turns"), "{err}");
}
