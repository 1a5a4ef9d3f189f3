//! The program as people run it: exit codes and messages, each test in a fresh folder.

#[path = "support/program.rs"]
mod program;

use curlsmoke::output::exr::{self, Compression};
use curlsmoke::output::image::{Image, SampleKind};
use curlsmoke::output::sidecar::Sidecar;
use program::{BALL, Folder, SMOKE, contains};
use std::fs;
use std::process::Stdio;

#[test]
fn help_goes_to_standard_output_and_mistakes_to_standard_error() {
    let folder = Folder::new();
    let [out, err] = folder.expect(0, &["--help"]);
    contains(&out, &["render", "check", "schema", "bake", "compare", "flow", "streamlines", "128+n"]);
    assert!(err.is_empty());
    for verb in [
        "render",
        "watch",
        "turntable",
        "check",
        "schema",
        "bake",
        "compare",
        "regress",
        "inspect",
        "denoise",
        "flow",
        "streamlines",
    ] {
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
fn inspect_tells_what_a_picture_holds() {
    let folder = Folder::new();
    let mut image = Image::cropped([8, 4], [2, 1, 4, 3]);
    image.push_rgb("", SampleKind::Float, &[[0.5, -1.0, 2.0], [1.5, 0.0, f32::NAN], [3.5, 0.0, 0.0], [0.5; 3]]);
    image.push("Z", SampleKind::Float, vec![f32::INFINITY, 1.0, 2.0, 3.0]);
    std::fs::write(folder.path("a.exr"), exr::write(&image, Compression::Zips).unwrap()).unwrap();
    let [out, _] = folder.expect(0, &["inspect", "a.exr"]);
    contains(&out, &["8 × 4 pixels", "data at 2, 1: 2 × 2 pixels", "Z ", "32 bit"]);
    let [out, _] = folder.expect(0, &["inspect", "a.exr", "--pixel", "3,1"]);
    let lines: Vec<Vec<&str>> = out.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(lines, [["R", "1.5"], ["G", "0"], ["B", "NaN"], ["Z", "1"]]);
    let [out, _] = folder.expect(0, &["inspect", "a.exr", "--stats"]);
    let row =
        |name: &str| out.lines().find(|line| line.starts_with(name)).unwrap().split_whitespace().collect::<Vec<_>>();
    assert_eq!(row("R "), ["R", "0.50000", "1.50000", "3.50000", "3.50000", "1.50000", "2,2", "0", "0", "0"]);
    assert_eq!((row("G ")[7], row("B ")[9], row("Z ")[8]), ("1", "1", "1"));
    let [_, err] = folder.expect(2, &["inspect", "a.exr", "--pixel", "0,0"]);
    contains(&err, &["from 2,1 to 3,2"]);
    folder.expect(2, &["inspect", "a.exr", "--pixel", "1"]);
    folder.expect(4, &["inspect", "none.exr"]);
}

#[test]
fn one_pixel_is_that_of_the_picture() {
    let folder = Folder::new();
    let arguments = ["render", "ball.yaml", "--frames", "2", "--progress", "none"];
    let [out, _] = folder.expect(0, &[&arguments[..], &["--pixel", "12,8"]].concat());
    contains(&out, &["frame 2, pixel 12,8", "surface_direct.R", "null_collisions", "4 paths,"]);
    assert!(folder.files("out").is_empty(), "nothing is written");
    let value = |name: &str| -> f32 {
        let line = out.lines().find(|line| line.split_whitespace().next() == Some(name)).unwrap();
        line.split_whitespace().nth(1).unwrap().parse().unwrap()
    };
    folder.expect(0, &arguments);
    let image = exr::read(&folder.path("out/ball.0002.exr"), 1 << 30).unwrap();
    let at = 8 * 24 + 12;
    for name in ["Z", "N.X", "variance.G"] {
        assert_eq!(value(name), image.channel(name).unwrap()[at], "{name}");
    }
    let [_, err] = folder.expect(2, &[&arguments[..], &["--pixel", "24,0"]].concat());
    contains(&err, &["24 × 16"]);
}

#[test]
fn a_turntable_begins_where_the_camera_stands() {
    let folder = Folder::new();
    // Lit from one side, so that views differ.
    let sun = "sun: {direction: [-1, 0, 0], irradiance: [3, 3, 3]}";
    folder.write("ball.yaml", &BALL.replace("environment: {radiance: [1, 1, 1]}", sun));
    let arguments = ["turntable", "ball.yaml", "--at", "2", "--frames", "1-4", "--progress", "none"];
    let [out, _] = folder.expect(0, &arguments);
    assert_eq!(out.lines().count(), 4, "{out}");
    let mean = |name: &str| -> f32 {
        let image = exr::read(&folder.path(name), 1 << 30).unwrap();
        let red = image.channel("R").unwrap();
        red.iter().sum::<f32>() / red.len() as f32
    };
    let views: Vec<f32> = (1..=4).map(|view| mean(&format!("out/ball.turn.{view:04}.exr"))).collect();
    // The sun comes from the right, where the camera is after a quarter of the turn.
    assert!(views[1] > 1.5 * views[0] && views[3] < 0.1 * views[0], "{views:?}");
    assert!((views[2] / views[0] - 1.0).abs() < 0.3, "{views:?}");
    folder.expect(0, &["render", "ball.yaml", "--frames", "2", "--progress", "none"]);
    assert!((mean("out/ball.0002.exr") / views[0] - 1.0).abs() < 0.3, "the same view with other noise");
    let [_, err] = folder.expect(0, &[&arguments[..], &["--resume"]].concat());
    assert!(!err.contains("error"), "{err}");
    let parts = ["--samples", "1-2", "--memory-limit", "0.01", "--set", "film.resolution=[200, 150]"];
    let [_, err] = folder.expect(6, &[&["turntable", "ball.yaml"], &parts[..]].concat());
    contains(&err, &["ball.turn.0001"]);
    let [_, err] = folder.expect(2, &["turntable", "ball.yaml", "--at", "9"]);
    contains(&err, &["--at 9", "1 to 3"]);
}

#[test]
fn lights_that_cease_to_be_are_found_before_anything_is_rendered() {
    let folder = Folder::new();
    let panel = "rectangle: {center: [0, 3, 0], half_u: [1, 0, 0], half_v: {1: [0, 0, 1], 3: [0, 0, -1], interpolation: linear}, radiance: [1, 1, 1]}";
    folder.write("lamp.yaml", &BALL.replace("environment: {radiance: [1, 1, 1]}", panel));
    for arguments in [&["check", "lamp.yaml"][..], &["render", "lamp.yaml"]] {
        let [_, err] = folder.expect(3, arguments);
        contains(&err, &["frame 2", "lights[0]", "no area"]);
    }
    assert!(folder.files("out").is_empty(), "{:?}", folder.files("out"));
    folder.expect(0, &["render", "lamp.yaml", "--frames", "1,3"]);
}

#[test]
fn watch_refuses_what_it_cannot_do() {
    let folder = Folder::new();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let [_, err] = folder.expect(2, &["watch", "ball.yaml", "--serve", &port]);
    contains(&err, &["--serve", &port, "another port"]);
    let [_, err] = folder.expect(2, &["watch", "ball.yaml", "--display", "xv"]);
    contains(&err, &["write tev, or tev=127.0.0.1:14158"]);
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
fn a_camera_inside_a_solid_is_warned_of() {
    let folder = Folder::new();
    folder.write("tetrahedron.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n");
    let solid = "sphere: {center: [0, 0, 0], radius: 1}";
    let moves = "motion: {keys: [{time: 0, translate: [0, 0, 4]}, {time: 1}]}";
    for (name, shape, is_inside) in [
        ("ball", "sphere: {center: [0, 0.5, 4], radius: 0.6}".to_string(), true),
        ("near", "sphere: {center: [0, 0.5, 4], radius: 0.4}".to_string(), false),
        ("unseen", "sphere: {center: [0, 0.5, 4], radius: 0.6}\n    visible: false".to_string(), false),
        ("arriving", format!("{solid}\n    {moves}"), true),
        ("ground", "plane: {point: [0, 0.1, 0]}".to_string(), true),
        ("below", "plane: {point: [0, -0.1, 0]}".to_string(), false),
        ("mesh", "mesh: {file: tetrahedron.obj}\n    transform: {translate: [-0.2, -0.2, 3.8]}".to_string(), true),
        ("beside", "mesh: {file: tetrahedron.obj}\n    transform: {translate: [-0.5, -0.5, 3.5]}".to_string(), false),
    ] {
        let scene = format!("{name}.yaml");
        folder.write(&scene, &BALL.replace(solid, &shape));
        for verb in [&["check", &scene][..], &["render", &scene, "--frames", "2"]] {
            let [_, err] = folder.expect(0, verb);
            let warning = format!("warning: {scene}:3:20: camera.position: the camera stands");
            assert_eq!(err.contains(&warning) && err.contains("`ball`"), is_inside, "{verb:?}: {err}");
        }
    }
    let room = BALL.replace(solid, "box: {center: [0, 0, 0], size: [9, 9, 9]}") + "flow: {containers: [ball]}\n";
    folder.write("room.yaml", &room);
    let [_, err] = folder.expect(0, &["check", "room.yaml"]);
    assert!(err.is_empty(), "{err}");
}

#[test]
fn an_emitter_inside_an_obstacle_is_told_once() {
    let folder = Folder::new();
    let place = "sphere: {center: [-0.3, 0.2, 0], radius: 0.3}";
    let swallowed = SMOKE.replace(place, "disk: {center: [-0.65, 0.5, 0], radius: 0.2}");
    folder.write("swallowed.yaml", &swallowed);
    folder.write("free.yaml", SMOKE);
    let ground = "shapes:\n  ground: {plane: {point: [0, 0.3, 0]}}\n";
    let sunk = SMOKE.replace("shapes:\n", ground).replace("[left, right]", "[left, right, ground]");
    folder.write("sunk.yaml", &sunk.replace(place, "disk: {center: [0, 0.2, 0], radius: 0.35}"));
    for scene in ["swallowed.yaml", "sunk.yaml"] {
        let [_, err] = folder.expect(0, &["check", scene]);
        contains(
            &err,
            &[": smoke.emitters[0]: 100 % of its particles are born inside obstacles", "move the emitter out"],
        );
        for verb in ["render", "bake"] {
            let [_, err] = folder.expect(0, &[verb, scene]);
            contains(&err, &["frame 1: 100 % of the particles were born inside obstacles", "move the emitter out"]);
            assert_eq!(err.matches("born inside").count(), 1, "{err}");
        }
    }
    for verb in ["check", "render"] {
        let [_, err] = folder.expect(0, &[verb, "free.yaml"]);
        assert!(!err.contains("born inside"), "{err}");
    }
    let sidecar = Sidecar::read(&folder.path("out/smoke.0001.json")).unwrap();
    assert!(sidecar.born_inside > 0 && sidecar.born > 2 * sidecar.born_inside, "{sidecar:?}");
}

#[test]
fn pictures_of_textures_are_read_and_judged_and_seen_to_change() {
    let folder = Folder::new();
    let texture = |slot: &str, file: &str, scale: f64| {
        let image =
            format!("{{image: {{file: {file}, scale: {scale}, projection: {{lat_long: {{center: [0, 0, 0]}}}}}}}}");
        let diffuse = match slot {
            "reflectance" => format!("{{reflectance: {image}}}"),
            _ => format!("{{reflectance: [0, 0, 0], emission: {image}}}"),
        };
        BALL.replace("radius: 1}", &format!("radius: 1}}\n    material: {{diffuse: {diffuse}}}"))
    };
    folder.picture("grey.exr", 0.5);
    let grey = fs::read(folder.path("grey.exr")).unwrap();
    fs::write(folder.path("short.exr"), &grey[..grey.len() - 9]).unwrap();
    fs::write(folder.path("no.png"), "no picture").unwrap();
    folder.picture("negative.exr", -0.5);
    for (code, name, slot, file, scale, part) in [
        (0, "a", "reflectance", "grey.exr", 2.0, ""),
        (0, "b", "emission", "grey.exr", 50.0, ""),
        (3, "c", "reflectance", "short.exr", 1.0, "short.exr"),
        (3, "d", "emission", "no.png", 1.0, "not a usable PNG file"),
        (3, "e", "emission", "negative.exr", 1.0, "radiance must be a number that is not negative"),
        (3, "f", "reflectance", "grey.exr", 2.1, "no more is reflected than comes; `scale` may be at most 1.998"),
        (4, "g", "reflectance", "gray.exr", 1.0, "did you mean `grey.exr`?"),
    ] {
        let scene = format!("{name}.yaml");
        folder.write(&scene, &texture(slot, file, scale));
        for verb in ["check", "render"] {
            let [_, err] = folder.expect(code, &[verb, &scene, "--set", "output.image=out/ball.####.exr"]);
            contains(&err, &[part]);
            let place = format!("{scene}:8:");
            let key = format!("shapes.ball.material.diffuse.{slot}.image.file: ");
            assert!(code == 0 || err.contains(&place) && (code == 4 || err.contains(&key)), "{err}");
        }
    }
    // A picture that needs more than the limit.
    let mut large = Image::new([800, 800]);
    large.push_rgb("", SampleKind::Half, &[[0.5; 3]; 640_000]);
    fs::write(folder.path("large.exr"), exr::write(&large, Compression::Zips).unwrap()).unwrap();
    folder.write("large.yaml", &texture("reflectance", "large.exr", 1.0));
    folder.expect(6, &["check", "large.yaml", "--set", "render.memory_limit_gib=0.01"]);
    folder.expect(0, &["check", "large.yaml"]);
    let fingerprint = || {
        folder.expect(0, &["render", "a.yaml", "--resume", "--frames", "1"]);
        Sidecar::read(&folder.path("out/ball.0001.json")).unwrap().fingerprint
    };
    let first = fingerprint();
    assert_eq!(fingerprint(), first);
    folder.picture("grey.exr", 0.25);
    assert!(fingerprint() != first, "a changed picture makes frames stale");
}

#[test]
fn check_reads_what_render_reads() {
    let folder = Folder::new();
    folder.write("smoke.yaml", SMOKE);
    folder.expect(0, &["bake", "smoke.yaml", "--frames", "1-2", "--output", "cache/smoke.####.vdb"]);
    let whole = fs::read(folder.path("cache/smoke.0001.vdb")).unwrap();
    fs::write(folder.path("short.vdb"), &whole[..whole.len() / 2]).unwrap();
    folder.picture("sky.exr", 0.5);
    let sky = fs::read(folder.path("sky.exr")).unwrap();
    fs::write(folder.path("short.exr"), &sky[..sky.len() - 9]).unwrap();
    fs::write(folder.path("png.hdr"), b"\x89PNG\r\n\x1a\n").unwrap();
    fs::write(folder.path("short.hdr"), "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\nabc").unwrap();
    let light = |file: &str| BALL.replace("{radiance: [1, 1, 1]}", &format!("{{file: {file}}}"));
    let mask = |kind: &str| {
        let flow = format!("flow:\n  potentials:\n    - uniform: {{velocity: [0, 1, 0], modulate: [{{{kind}}}]}}\n");
        format!("{BALL}{flow}")
    };
    let volume = |file: &str| format!("{BALL}smoke:\n  file:\n    path: {file}\n").replace("last: 3", "last: 2");
    let picture =
        |file: &str| mask(&format!("image: {{file: {file}, center: [0, 0, 0], half_u: [1, 0, 0], half_v: [0, 1, 0]}}"));
    for (name, scene, parts) in [
        ("a", light("short.exr"), ["a.yaml:9:25: lights[0].environment.file: ", "short.exr"]),
        ("b", light("short.hdr"), ["b.yaml:9:25: lights[0].environment.file: ", "line 0 is damaged"]),
        ("c", light("png.hdr"), ["c.yaml:9:25: lights[0].environment.file: ", "does not begin with #?RADIANCE"]),
        ("d", picture("short.exr"), ["d.yaml:13:", "flow.potentials[0].uniform.modulate[0].image.file: "]),
        ("e", mask("grid: {file: short.vdb}"), ["e.yaml:13:", "flow.potentials[0].uniform.modulate[0].grid.file: "]),
        ("f", volume("short.vdb"), ["f.yaml:13:11: smoke.file.path: frame 1: ", "short.vdb"]),
    ] {
        let file = format!("{name}.yaml");
        folder.write(&file, &scene);
        let [out, err] = folder.expect(3, &["check", &file]);
        contains(&err, &parts);
        assert!(out.is_empty(), "{out}");
        let [json, _] = folder.expect(3, &["check", &file, "--format", "json"]);
        contains(&json, &[r#""ok": false"#, parts[1]]);
    }
    for (name, scene) in [
        ("g", light("sky.exr")),
        ("h", picture("sky.exr")),
        ("i", mask("grid: {file: cache/smoke.0001.vdb}")),
        ("j", volume("cache/smoke.####.vdb")),
    ] {
        let file = format!("{name}.yaml");
        folder.write(&file, &scene);
        let [out, err] = folder.expect(0, &["check", &file]);
        contains(&out, &[": ok"]);
        assert!(err.is_empty(), "{err}");
    }
}

#[test]
fn missing_frames_of_a_sequence_are_all_named() {
    let folder = Folder::new();
    fs::create_dir(folder.path("cache")).unwrap();
    let scene = |pattern: &str| format!("{BALL}smoke: {{file: {{path: {pattern}}}}}\n").replace("last: 3", "last: 9");
    for frame in [1, 2, 5, 9] {
        folder.write(&format!("cache/smoke.{frame:04}.vdb"), "");
    }
    folder.write("gaps.yaml", &scene("cache/smoke.####.vdb"));
    let [_, err] = folder.expect(4, &["check", "gaps.yaml"]);
    contains(&err, &["no file for the frames 3-4,6-8: `cache/smoke.0003.vdb` and so on", "frames: {first"]);
    assert!(!err.contains("did you mean"), "{err}");
    folder.write("typo.yaml", &scene("cache/smok.####.vdb"));
    let [_, err] = folder.expect(4, &["check", "typo.yaml"]);
    contains(&err, &["any of the frames 1-9", "did you mean `smoke.0001.vdb`?"]);
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
    for arguments in [["schema"], ["--help"]] {
        let Ok(full) = fs::OpenOptions::new().write(true).open("/dev/full") else { continue };
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_curlsmoke"))
            .current_dir(folder.0.path())
            .args(arguments)
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
    let files = "out/ball.0003.exr\nout/ball.0003.png\nout/ball.0001.exr\nout/ball.0001.png\n";
    contains(&out, &["2 frames: 3,1", "12 × 8 pixels, 8 samples", files]);
    let [out, _] = folder.expect(0, &["render", "ball.yaml", "--dry-run", "--frames", "2", "--set", "output.preview="]);
    contains(&out, &["1 frame: 2\n", "out/ball.0002.exr\n"]);
    assert!(!out.contains(".png"), "{out}");
    assert!(folder.files("out").is_empty());
}

#[test]
fn pictures_go_where_output_says_with_their_previews() {
    let folder = Folder::new();
    let named = |more: &[&str]| {
        let arguments = ["render", "ball.yaml", "--dry-run", "--frames", "2", "-o", "a b/{scene}.#.exr"];
        folder.expect(0, &[&arguments, more].concat())[0].clone()
    };
    contains(&named(&[]), &["\na b/ball.2.exr\na b/ball.2.png\n"]);
    contains(&named(&["--set", "output.preview=p.#.png"]), &["\na b/ball.2.exr\np.2.png\n"]);
    assert!(!named(&["--set", "output.preview="]).contains(".png"));
    folder.write("bare.yaml", &BALL.replace("preview: out/ball.####.png, ", ""));
    let [out, _] = folder.expect(0, &["render", "bare.yaml", "--frames", "1", "--output", "other/x.##.exr"]);
    contains(&out, &["other/x.01.exr"]);
    assert_eq!(folder.files("other"), ["x.01.exr", "x.01.json"]);
    let [_, err] = folder.expect(3, &["render", "ball.yaml", "-o", "x.exr"]);
    contains(&err, &["output.image", "all frames would be written to this one file"]);
}

#[test]
fn wrong_flags_are_usage_errors_that_say_what_to_write() {
    let folder = Folder::new();
    for (arguments, says) in [
        (&["render", "ball.yaml", "--frames", "1-3y2"][..], "use x for a step"),
        (&["render", "ball.yaml", "--frames", "one"], "1-96x2"),
        (&["render", "ball.yaml", "--frames", "2-20x3"], "to go on longer, --set frames.last=20\n"),
        (&["render", "ball.yaml", "--frames", "3--2"], "--set frames.first=-2 moves it there and changes every frame"),
        (&["render", "ball.yaml", "--frames", "0,9"], "frames.last=9; time 0 is at the first frame"),
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
    for (mode, example) in
        [("mse", "--threshold 1e-3"), ("max", "--threshold 0.01"), ("psnr", "in dB: for example --threshold 40")]
    {
        let [_, err] = folder.expect(2, &["compare", "a.exr", "b.exr", "--mode", mode]);
        contains(&err, &[example]);
    }
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
fn a_stage_begins_and_ends_once() {
    let folder = Folder::new();
    for arguments in [&["render", "ball.yaml"][..], &["bake", "smoke.yaml"]] {
        folder.write("smoke.yaml", SMOKE);
        let more = ["--frames", "1", "--progress", "json"];
        let [_, err] = folder.expect(0, &[arguments, &more].concat());
        let mut open = None;
        for event in err.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()) {
            match event["event"].as_str() {
                Some("stage") => assert_eq!(open.replace(event["stage"].clone()), None, "{err}"),
                Some("stage_end") => assert_eq!(open.take(), Some(event["stage"].clone()), "{err}"),
                _ => {}
            }
        }
        let begins = |line: &&str| line.contains(r#""event":"stage","#) && line.contains(r#""stage":"geometry""#);
        assert_eq!(err.lines().filter(begins).count(), 1, "{err}");
    }
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

#[test]
fn a_sky_that_is_too_large_or_bad_ends_with_its_own_code() {
    let folder = Folder::new();
    let bright = Image { size: [1024, 512], data_size: [1024, 512], ..Image::default() };
    let write = |name: &str, mut image: Image, layer: &str| {
        image.push_rgb(layer, SampleKind::Float, &[[1.0; 3]; 1024 * 512]);
        fs::write(folder.path(name), exr::write(&image, Compression::None).unwrap()).unwrap();
    };
    write("sky.exr", bright.clone(), "");
    write("layer.exr", bright, "other");
    let scene = |file: &str| BALL.replace("{radiance: [1, 1, 1]}", &format!("{{file: {file}}}"));
    for (name, file) in [("sky.yaml", "sky.exr"), ("layer.yaml", "layer.exr")] {
        folder.write(name, &scene(file));
    }
    let [_, err] = folder.expect(6, &["render", "sky.yaml", "--memory-limit", "0.011"]);
    contains(&err, &["sky.yaml:9:25: lights[0].environment.file: ", "sky.exr", "--memory-limit"]);
    assert_eq!(err.matches("sky.exr").count(), 1, "{err}");
    let [_, err] = folder.expect(3, &["render", "layer.yaml"]);
    contains(&err, &["layer.exr", "no channels R, G and B"]);
    folder.expect(0, &["render", "sky.yaml", "--frames", "1"]);
}

#[test]
fn what_was_cut_and_where_particles_were_born_is_said() {
    let folder = Folder::new();
    folder.write("smoke.yaml", SMOKE);
    let [_, err] = folder.expect(0, &["render", "smoke.yaml", "--set", "render.max_bounces=1"]);
    contains(&err, &["frame 1: paths cut at render.max_bounces = 1 still carried"]);
    let sidecar = Sidecar::read(&folder.path("out/smoke.0001.json")).unwrap();
    assert!(sidecar.truncated_light > 0.001 && sidecar.truncated_light <= sidecar.truncated_paths);
    assert!(sidecar.born_inside > 0 && sidecar.particles > 0);
    let [_, err] = folder.expect(0, &["render", "smoke.yaml", "--set", "render.max_bounces=1000"]);
    assert!(!err.contains("max_bounces"), "{err}");
    let [out, _] = folder.expect(0, &["bake", "smoke.yaml", "--frames", "1"]);
    contains(&out, &["out/smoke.0001.vdb", "voxels", "; on the way here", "particles were born in an obstacle"]);
    let whole = fs::metadata(folder.path("out/smoke.0001.vdb")).unwrap().len();
    folder.expect(0, &["bake", "smoke.yaml", "--frames", "1", "--half", "--output", "out/half.####.vdb"]);
    assert!(fs::metadata(folder.path("out/half.0001.vdb")).unwrap().len() < whole);
}
