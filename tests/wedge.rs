//! One frame with several values of some settings: each picture is that of `render`, and what they share is made once.

#[path = "support/program.rs"]
mod program;

use curlsmoke::output::png;
use program::{BALL, Folder, SMOKE, contains, hot_smoke};
use serde_json::Value;
use std::fs;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const LIMIT: u64 = 1 << 26;

fn sidecar(folder: &Folder, name: &str) -> Value {
    serde_json::from_slice(&fs::read(folder.path(name)).unwrap()).unwrap()
}

fn smoke() -> Folder {
    let folder = Folder::new();
    let output = "{image: a.####.exr, preview: b.####.png, aovs: [depth, motion]}";
    folder
        .write("smoke.yaml", &SMOKE.replace("{image: out/smoke.####.exr}", output).replace("rate: 2000", "rate: 200"));
    folder
}

#[test]
fn pictures_have_the_bytes_of_render_and_share_their_smoke() {
    let folder = smoke();
    // The setting that takes new particles stands last, so that the order of pictures is not the order of the sheet.
    let vary = [
        ("smoke.medium.extinction", ["5", "40"], ["extinction=5", "extinction=40"]),
        ("smoke.emitters[0].mass", ["0.2", "0.4"], ["mass=0.2", "mass=0.4"]),
    ];
    let flags: Vec<String> = vary.iter().map(|(key, values, _)| format!("{key}={}", values.join(","))).collect();
    let common = ["wedge", "smoke.yaml", "--frame", "2", "-o", "out/w.png", "--set", "film.noise_target=0.2"];
    let [out, err] = folder.expect(0, &[&common[..], &["--vary", &flags[0], "--vary", &flags[1]]].concat());
    assert_eq!(out.lines().count(), 5, "{out}");
    contains(&out, &["out/w.png: "]);
    contains(&err, &["extinction=5, mass=0.2", "extinction=40, mass=0.4"]);
    let mut simulated = 0;
    for i in 0..2 {
        for j in 0..2 {
            let set: Vec<String> =
                [(0, i), (1, j)].iter().map(|&(k, v)| format!("{}={}", vary[k].0, vary[k].1[v])).collect();
            let own = format!("out/w.{}.{}.0002", vary[0].2[i], vary[1].2[j]);
            let alone = ["--set", "film.noise_target=0.2", "--set", &set[0], "--set", &set[1], "-o", "alone.####.exr"];
            folder.expect(0, &[&["render", "smoke.yaml", "--frames", "2"], &alone[..]].concat());
            for ending in ["exr", "png"] {
                let [a, b] = [format!("{own}.{ending}"), format!("alone.0002.{ending}")];
                assert!(
                    fs::read(folder.path(&a)).unwrap() == fs::read(folder.path(&b)).unwrap(),
                    "{a} differs from render's"
                );
            }
            let [made, alone] = [sidecar(&folder, &format!("{own}.json")), sidecar(&folder, "alone.0002.json")];
            for key in ["particles", "penetrations", "born", "born_inside", "mass", "grid", "fingerprint", "spp"] {
                assert_eq!(made[key], alone[key], "{own}: {key}");
            }
            simulated += usize::from(made["seconds"].get("advect").is_some());
        }
    }
    assert_eq!(simulated, 2, "smoke was made for each picture, not for each mass");
}

/// What happened to particles on their way is told of each picture, also where kept ones are splatted anew.
#[test]
fn sidecars_count_what_happened_to_kept_particles() {
    let folder = Folder::new();
    folder.write("smoke.yaml", &hot_smoke().replace("rate: 2000", "rate: 200"));
    let counts = |name: &str| ["penetrations", "born", "born_inside"].map(|key| sidecar(&folder, name)[key].as_u64());
    folder.expect(0, &["render", "smoke.yaml", "--frames", "2", "-o", "alone.####.exr"]);
    let alone = counts("alone.0002.json");
    assert!(alone[1..].iter().all(|count| count.is_some_and(|count| count > 0)), "{alone:?}");
    let vary = "smoke.blackbody.temperature=1500,1800";
    folder.expect(0, &["wedge", "smoke.yaml", "--frame", "2", "-o", "w.png", "--vary", vary]);
    for temperature in [1500, 1800] {
        assert_eq!(counts(&format!("w.temperature={temperature}.0002.json")), alone, "{temperature} K");
    }
    folder.expect(0, &["turntable", "smoke.yaml", "--at", "2", "--frames", "1-3", "-o", "turn.####.exr"]);
    for view in 1..=3 {
        assert_eq!(counts(&format!("turn.{view:04}.json")), alone, "view {view}");
    }
}

#[test]
fn the_sheet_has_a_row_for_each_value_of_the_first_and_a_column_for_the_second() {
    let folder = Folder::new();
    // All light comes from the ball's surroundings, so that a corner shows it as it is.
    let grey = ["[0.1, 0.1, 0.1]", "[0.3, 0.3, 0.3]", "[0.8, 0.8, 0.8]"].join(",");
    let light = format!("lights[0].environment.radiance={grey}");
    let wedge = ["wedge", "ball.yaml", "--resolution", "160x60", "--spp", "1", "--vary", "output.exposure_ev=0,-1"];
    let [out, _] = folder.expect(0, &[&wedge[..], &["--vary", &light, "-o", "w.png"]].concat());
    let sheet = png::read(&folder.path("w.png"), LIMIT).unwrap();
    let (rgb, [width, height]) = (sheet.to_rgb("").unwrap(), sheet.size);
    contains(&out, &[&format!("w.png: {width} × {height} pixels")]);
    // Gaps of 8 pixels, lines of 11.
    assert_eq!([width, height], [3 * 168 + 8, 8 + 3 * 11 + 8 + 2 * (60 + 8 + 26)]);
    for (row, exposure) in [1.0, 0.5].into_iter().enumerate() {
        for (column, light) in [0.1, 0.3, 0.8].into_iter().enumerate() {
            let (x, y) = (8 + 168 * column + 1, 8 + 33 + 8 + 94 * row + 1);
            let pixel = rgb[y * width as usize + x];
            assert!((pixel[0] - exposure * light).abs() < 0.006, "row {row}, column {column}: {pixel:?}");
        }
    }
    // One setting is one row, or as many columns as are asked for.
    for (more, size) in
        [(&[][..], [3 * 168 + 8, 8 + 22 + 8 + 83]), (&["--columns", "1"], [168 + 8, 8 + 22 + 8 + 3 * 83])]
    {
        let row = ["wedge", "ball.yaml", "--resolution", "160x60", "--spp", "1", "--vary", &light, "-o", "row.png"];
        folder.expect(0, &[&row[..], more].concat());
        assert_eq!(png::read(&folder.path("row.png"), LIMIT).unwrap().size, size);
    }
}

#[test]
fn what_is_finished_is_kept_and_new_values_are_added() {
    let folder = Folder::new();
    let wedge = |vary: &str, count: usize| {
        let [out, err] = folder.expect(0, &["wedge", "ball.yaml", "--vary", vary, "--resume", "-o", "out/w.png"]);
        assert_eq!(out.lines().count(), count + 1, "{out}");
        err
    };
    wedge("camera.vertical_fov_deg=20,40", 2);
    let names = ["20", "30", "40"].map(|fov| format!("w.vertical_fov_deg={fov}.0001"));
    let before = fs::metadata(folder.path(&format!("out/{}.exr", names[2]))).unwrap().modified().unwrap();
    let err = wedge("camera.vertical_fov_deg=20..40:3", 1);
    contains(&err, &["vertical_fov_deg=20: is finished already", "vertical_fov_deg=40: is finished already"]);
    assert_eq!(fs::metadata(folder.path(&format!("out/{}.exr", names[2]))).unwrap().modified().unwrap(), before);
    fs::remove_file(folder.path(&format!("out/{}.png", names[0]))).unwrap();
    wedge("camera.vertical_fov_deg=20,30,40", 1);
    let files = names.iter().flat_map(|name| ["exr", "json", "png"].map(|ending| format!("{name}.{ending}")));
    assert_eq!(folder.files("out"), ["w.png".into()].into_iter().chain(files).collect::<Vec<_>>());
}

#[test]
fn a_signal_leaves_finished_pictures_and_resume_makes_the_rest() {
    let folder = Folder::new();
    let arguments = ["wedge", "ball.yaml", "--vary", "film.spp=4,40000,5", "--resume", "-o", "out/w.png"];
    let mut child = Command::new(env!("CARGO_BIN_EXE_curlsmoke"))
        .current_dir(folder.0.path())
        .args(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while !folder.path("out/w.spp=4.0001.json").exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "{:?}", folder.files("out"));
        std::thread::sleep(Duration::from_millis(2));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let files = folder.files("out");
    assert!(files.contains(&"w.spp=4.0001.exr".into()) && !files.contains(&"w.png".into()), "{files:?}");
    assert!(!files.contains(&"w.spp=5.0001.exr".into()), "{files:?}");
    let less = arguments.map(|word| if word.starts_with("film") { "film.spp=4,5" } else { word });
    let [out, err] = folder.expect(0, &less);
    contains(&err, &["spp=4: is finished already"]);
    contains(&out, &["out/w.spp=5.0001.exr", "out/w.png: "]);
}

#[test]
fn bad_values_are_all_told_with_their_key_before_anything_is_made() {
    let folder = Folder::new();
    let vary = |values: &[&str]| -> Vec<String> {
        let flags = values.iter().flat_map(|value| ["--vary".to_string(), value.to_string()]);
        ["wedge", "ball.yaml", "-o", "out/w.png"].map(String::from).into_iter().chain(flags).collect()
    };
    let cases: [(i32, &[&str], &[&str]); 13] = [
        (
            3,
            &["film.spp=4,-1,many", "render.seed=1..3"],
            &[
                "in 3 pictures of film.spp=-1, render.seed=1; film.spp=-1, render.seed=2; film.spp=-1, render.seed=3:\n",
                "in 3 pictures of film.spp=many, render.seed=1;",
                "--vary film.spp: error: ",
            ],
        ),
        (3, &["film.spp=-1", "render.seed=1..20"], &["in 20 pictures of ", "render.seed=8; and 12 more:\n"]),
        // The frame is that of the first picture, and the second's scene does not have it.
        (2, &["frames.first=1,2"], &["in the picture of frames.first=2:\n", "frame 1 is not one"]),
        (2, &["output.image=a.exr,b.exr"], &["--vary output.image", "-o"]),
        (2, &["output.preview=a.png,b.png"], &["--vary output.preview", "-o"]),
        (3, &["film.sp=4"], &["film.sp", "did you mean"]),
        (2, &["film.spp"], &["film.spp", "varies nothing"]),
        (2, &["film.spp=1,1"], &["film.spp", "twice"]),
        (2, &["film.spp=1", "film.spp=2"], &["--vary film.spp is there twice"]),
        (2, &["film.spp=0..1.5"], &["film.spp", "how many"]),
        (2, &["film.spp=1..40", "render.seed=1..40"], &["1600 pictures", "at most 1000"]),
        (2, &["film.spp=1..2:2:cubic"], &["cubic", "lin or log"]),
        (2, &[], &["--vary"]),
    ];
    for (code, values, parts) in cases {
        let arguments = vary(values);
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let [out, err] = folder.expect(code, &arguments);
        contains(&err, parts);
        // Each problem once, however many pictures have it, and by the flag that was there.
        assert!(err.matches("error: ").count() <= 2 && !err.contains("--set film"), "{err}");
        assert!(out.is_empty() && folder.files("out").is_empty(), "{values:?}");
    }
    let seed = ["--vary", "render.seed=1,2"];
    for (code, more, part) in [
        (2, ["--frame", "9"], "frame 9"),
        (2, ["-o", "w.exr"], ".png"),
        (3, ["-o", "{no}.png"], "{no}"),
        (5, ["-o", "ball.yaml/w.png"], "ball.yaml"),
        (2, ["--crop", "0,0,99,99"], "99"),
        (2, ["--crop", "-4,0,8,8"], "-4,0,8,8"),
    ] {
        let [_, err] = folder.expect(code, &[&["wedge", "ball.yaml"], &seed[..], &more].concat());
        contains(&err, &[part]);
    }
}

#[test]
fn a_sheet_that_cannot_be_is_refused_before_anything_is_made() {
    let folder = Folder::new();
    // Small pictures on a large sheet: each has the room of the widest and the highest.
    let wedge = ["wedge", "ball.yaml", "--vary", "film.resolution=[16,16],[32768,8],[8,32768]", "--columns", "1"];
    for dry in [&[][..], &["--dry-run"]] {
        let [out, err] = folder.expect(2, &[&wedge[..], dry].concat());
        contains(&err, &["the sheet would have 36", "--width"]);
        assert!(out.is_empty() && folder.files("out").is_empty(), "{out}");
    }
    folder.expect(0, &[&wedge[..], &["--width", "4", "--dry-run"]].concat());
    // Pictures of some kilobytes, and a sheet of megabytes.
    let wedge =
        ["wedge", "ball.yaml", "--vary", "film.resolution=[4,4],[4000,1],[1,400]", "--columns", "1", "--dry-run"];
    let [_, err] = folder.expect(6, &[&wedge[..], &["--memory-limit", "100M"]].concat());
    contains(&err, &["out/ball.wedge.png: needs ", "--memory-limit"]);
    folder.expect(0, &[&wedge[..], &["--memory-limit", "1G"]].concat());
}

#[test]
fn shares_of_a_size_are_of_what_is_varied_and_names_that_do_not_count_are_told() {
    let folder = Folder::new();
    let set = ["--set", "output.image=mine.exr", "--set", "film.resolution=[40, 20]"];
    let wedge = ["wedge", "ball.yaml", "--vary", "film.overscan=0,8", "--resolution", "50%", "--crop", "0,0,20,10"];
    let [_, err] = folder.expect(0, &[&wedge[..], &set[..], &["--spp", "1", "-o", "w.png"]].concat());
    contains(&err, &["note: --set output.image gives", "-o names the sheet"]);
    assert!(!folder.path("mine.exr").exists());
    let reach = |overscan: u32, crop: &str| {
        let vary = format!("film.overscan={overscan}");
        let wedge = ["wedge", "ball.yaml", "--vary", &vary, "--resolution", "50%", "--crop", crop, "--dry-run"];
        folder.command(&[&wedge[..], &set[..]].concat()).output().unwrap().status.code()
    };
    assert_eq!((reach(0, "0,0,21,10"), reach(8, "-4,-4,24,14"), reach(8, "-5,0,20,10")), (Some(2), Some(0), Some(2)));
}

#[test]
fn pictures_with_overscan_are_laid_out_by_their_frames() {
    let folder = Folder::new();
    // A crop beside the frame is shown itself.
    for (vary, crop, [width, height]) in [
        ("film.overscan=0,3", "0%,0%,100%,100%", [160, 60]),
        ("film.overscan=3,4", "-2,-3,160,63", [160, 60]),
        ("film.overscan=20,22", "0,60,160,80", [160, 20]),
    ] {
        let wedge = ["wedge", "ball.yaml", "--vary", vary, "--spp", "1", "-o", "w.png", "--resolution", "160x60"];
        folder.expect(0, &[&wedge[..], &["--crop", crop]].concat());
        let size = png::read(&folder.path("w.png"), LIMIT).unwrap().size;
        assert_eq!(size, [2 * (width + 8) + 8, 8 + 2 * 11 + 8 + height + 8 + 15], "{crop}");
    }
}

#[test]
fn a_dry_run_lists_pictures_with_the_flags_that_make_them() {
    let folder = Folder::new();
    folder.write("ball.yaml", &BALL.replace("first: 1", "first: 0"));
    let wedge =
        ["wedge", "ball.yaml", "--vary", "shapes.ball.sphere.radius=0.5,1", "--vary", "camera.position=[0, 0, 4]"];
    let [out, _] = folder.expect(0, &[&wedge[..], &["--dry-run"]].concat());
    let expected = [
        "out/ball.wedge.radius=0.5.position=0_0_4.0000.exr  --set shapes.ball.sphere.radius=0.5 --set 'camera.position=[0, 0, 4]'",
        "out/ball.wedge.radius=1.position=0_0_4.0000.exr  --set shapes.ball.sphere.radius=1 --set 'camera.position=[0, 0, 4]'",
        "out/ball.wedge.png",
    ];
    assert_eq!(out.lines().collect::<Vec<_>>(), expected);
    assert!(folder.files("out").is_empty());
}
