//! Pictures that are made in parts, or that are interrupted: the bytes are those of one undisturbed run.

#[path = "support/program.rs"]
mod program;

use curlsmoke::math::hash::Seed;
use curlsmoke::output::exr;
use curlsmoke::output::image::Image;
use curlsmoke::output::sidecar::{Sidecar, sha256};
use curlsmoke::pipeline::merge::{MergeJob, merge};
use curlsmoke::progress::Silent;
use program::{Folder, SMOKE, contains};
use std::fs;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Every kind of layer, a shadow catcher, and emission of several groups: whatever a pixel sums up.
fn layered(spp: u32) -> String {
    let all = "depth, position, shape_id, normal, albedo, motion, variance, transmittance, volume_depth, passages, light_groups, \
               cryptomatte, bounces, null_collisions, samples";
    SMOKE
        .replace("[16, 16], spp: 4", &format!("[40, 24], spp: {spp}"))
        .replace(
            "shapes:\n",
            "shapes:\n  floor: {plane: {point: [0, 0.1, 0], normal: [0, 1, 0]}, shadow_catcher: true}\n",
        )
        .replace(
            "radiance: [1, 1, 1]}",
            "radiance: [1, 0.7, 0.3]}\n  - sun: {direction: [0.4, -1, 0.1], irradiance: [2, 2, 3], group: key}",
        )
        .replace(
            "{image: out/smoke.####.exr}",
            &format!("{{image: out/smoke.####.exr, preview: out/smoke.####.png, aovs: [{all}]}}"),
        )
}

fn folder_of(scene: &str) -> Folder {
    let folder = Folder::new();
    folder.write("smoke.yaml", scene);
    folder
}

/// Renders frame 1 undisturbed; its picture and its preview, which then are no longer there.
fn whole(folder: &Folder) -> [Vec<u8>; 2] {
    folder.expect(0, &["render", "smoke.yaml", "--frames", "1", "--threads", "2"]);
    let bytes = ["exr", "png"].map(|ending| fs::read(folder.path(&format!("out/smoke.0001.{ending}"))).unwrap());
    fs::remove_dir_all(folder.path("out")).unwrap();
    bytes
}

fn has_bytes(folder: &Folder, name: &str, [picture, preview]: &[Vec<u8>; 2]) {
    assert!(fs::read(folder.path(&format!("{name}.exr"))).unwrap() == *picture, "{name}.exr differs");
    assert!(fs::read(folder.path(&format!("{name}.png"))).unwrap() == *preview, "{name}.png differs");
}

#[test]
fn parts_in_any_order_make_the_picture_of_one_run() {
    let folder = folder_of(&layered(10));
    let whole = whole(&folder);
    let render = |samples: &str, threads: &str| {
        let [out, _] =
            folder.expect(0, &["render", "smoke.yaml", "--frames", "1", "--samples", samples, "--threads", threads]);
        contains(&out, &[&format!("out/smoke.0001.samples-{samples}.part")]);
        format!("out/smoke.0001.samples-{samples}.part")
    };
    let parts = [render("1-3", "1"), render("4-4", "3"), render("5-9", "2"), render("10-10", "7")];
    assert_eq!(folder.files("out").len(), 4, "{:?}", folder.files("out"));
    let read = |name: &str| fs::read(folder.path(name)).unwrap();
    let first = read(&parts[2]);
    render("5-9", "5");
    let (a, b) = (tiles_of(&first), tiles_of(&read(&parts[2])));
    assert!(a == b, "the sums of a part depend on the number of threads");
    for (order, threads) in [([0, 1, 2, 3], "1"), ([3, 2, 1, 0], "2"), ([1, 3, 0, 2], "5")] {
        let order = order.map(|i| parts[i].as_str());
        let [out, _] = folder.expect(0, &[&["merge", "-j", threads, "-o", "out/smoke.0001.exr"], &order[..]].concat());
        contains(&out, &["out/smoke.0001.exr", "4 parts"]);
        has_bytes(&folder, "out/smoke.0001", &whole);
    }
    let sidecar = Sidecar::read(&folder.path("out/smoke.0001.json")).unwrap();
    assert_eq!(sidecar.parts.iter().map(|part| part.samples).collect::<Vec<_>>(), [[1, 3], [4, 4], [5, 9], [10, 10]]);
    assert!(sidecar.parts[2].arguments.contains(&"5-9".to_string()) && sidecar.spp == 10 && sidecar.files.len() == 2);
    // The sidecar stands for the same frame.
    let [_, err] = folder.expect(0, &["render", "smoke.yaml", "--frames", "1", "--resume"]);
    contains(&err, &["frame 1 is finished already"]);
    let [_, err] = folder.expect(0, &["render", "smoke.yaml", "--frames", "1", "--samples", "4-4", "--resume"]);
    contains(&err, &["frame 1 is finished already"]);
    // A part of the picture in parts.
    folder.expect(0, &["render", "smoke.yaml", "--frames", "1", "--crop", "5,3,31,20"]);
    let crop = read("out/smoke.0001.exr");
    for samples in ["1-7", "8-10"] {
        folder.expect(0, &["render", "smoke.yaml", "--frames", "1", "--crop", "5,3,31,20", "--samples", samples]);
    }
    let [a, b] = ["1-7", "8-10"].map(|samples| format!("out/smoke.0001.samples-{samples}.part"));
    folder.expect(0, &["merge", &b, &a, "-o", "crop.exr"]);
    assert!(read("crop.exr") == crop, "a crop in parts differs");
}

/// The tiles of a part, without its head, which has times, and the hash at the end.
fn tiles_of(part: &[u8]) -> Vec<u8> {
    let length = u64::from_le_bytes(part[17..25].try_into().unwrap()) as usize;
    part[25 + length..part.len() - 32].to_vec()
}

#[test]
fn several_frames_are_merged_at_once() {
    let folder = folder_of(SMOKE);
    folder.expect(0, &["render", "smoke.yaml", "--frames", "1-2"]);
    fs::rename(folder.path("out"), folder.path("whole")).unwrap();
    for samples in ["3-4", "1-2"] {
        folder.expect(0, &["render", "smoke.yaml", "--frames", "1-2", "--samples", samples]);
    }
    let parts: Vec<String> = folder.files("out").iter().map(|name| format!("out/{name}")).collect();
    let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
    assert_eq!(parts.len(), 4);
    let [_, err] = folder.expect(2, &[&["merge", "-o", "merged/one.exr"], &parts[..]].concat());
    contains(&err, &["frames 1 and 2 would both be written to merged/one.exr"]);
    folder.expect(0, &[&["merge", "-o", "merged/{scene}.####.exr"], &parts[..]].concat());
    for frame in ["0001", "0002"] {
        let [a, b] = ["whole", "merged"].map(|f| fs::read(folder.path(&format!("{f}/smoke.{frame}.exr"))).unwrap());
        assert!(a == b, "frame {frame}");
    }
    assert_eq!(folder.files("merged").len(), 4, "no previews were asked for: {:?}", folder.files("merged"));
}

#[test]
fn parts_that_make_no_picture_are_refused_by_name() {
    let folder = folder_of(SMOKE);
    let render = |more: &[&str]| {
        folder.expect(0, &[&["render", "smoke.yaml", "--frames", "1"], more].concat());
    };
    for samples in ["1-1", "2-3", "3-4", "4-4"] {
        render(&["--samples", samples]);
    }
    render(&["--samples", "2-4", "--seed", "2", "-o", "seed/smoke.####.exr"]);
    render(&["--samples", "2-4", "--set", "camera.vertical_fov_deg=30", "-o", "fov/smoke.####.exr"]);
    render(&["--samples", "2-4", "--spp", "8", "-o", "spp/smoke.####.exr"]);
    render(&["--samples", "2-4", "--resolution", "50%", "-o", "half/smoke.####.exr"]);
    render(&["-o", "picture/smoke.####.exr"]);
    let part = |folder: &str, samples: &str| format!("{folder}/smoke.0001.samples-{samples}.part");
    let [a, b, c, d] = ["1-1", "2-3", "3-4", "4-4"].map(|samples| part("out", samples));
    let [seed, fov, spp, half] = ["seed", "fov", "spp", "half"].map(|folder| part(folder, "2-4"));
    let whole = fs::read(folder.path(&a)).unwrap();
    let write = |name: &str, bytes: &[u8]| fs::write(folder.path(name), bytes).unwrap();
    write("short.part", &whole[..whole.len() - 100]);
    write("shorter.part", &whole[..30]);
    write("empty.part", b"");
    let mut damaged = whole.clone();
    damaged[whole.len() / 2] ^= 4;
    write("damaged.part", &damaged);
    // Sums of the first format have the same heads and other bytes.
    write("older.part", &[b"curlsmoke part 1\n", &whole[17..]].concat());
    write("newer.part", &[b"curlsmoke part 9\n", &whole[17..]].concat());
    let cases: [(i32, &[&str], &[&str]); 17] = [
        (3, &[&a, &b], &["paths 4 to 4 of 4 are in no part", "--samples 4-4"]),
        (3, &[&c, &a], &["paths 2 to 2 of 4 are in no part"]),
        (3, &[&d], &["paths 1 to 3 of 4"]),
        (3, &[&a, &b, &c], &["paths 3 to 3 are in both", &b, &c]),
        (3, &[&a, &b, &d, &a], &["paths 1 to 1 are in both"]),
        (3, &[&a, &seed], &["different pictures of frame 1", "seeds 1 and 2", &a, &seed]),
        (3, &[&a, &fov], &["different pictures of frame 1", "fingerprints"]),
        (3, &[&a, &spp], &["paths a pixel, 4 and 8"]),
        (3, &[&a, &half], &["sizes 16 × 16 and 8 × 8"]),
        (3, &[&a, "picture/smoke.0001.exr"], &["picture/smoke.0001.exr", "not a usable part file"]),
        (3, &["short.part"], &["short.part", "cut short or damaged"]),
        (3, &["shorter.part"], &["shorter.part", "cut short or damaged"]),
        (3, &["empty.part"], &["empty.part", "does not begin as one"]),
        (3, &["damaged.part"], &["damaged.part", "cut short or damaged"]),
        (3, &["older.part"], &["older.part", "another format"]),
        (3, &["newer.part"], &["newer.part", "another format"]),
        (4, &["none.part"], &["none.part: no such file"]),
    ];
    for (code, parts, words) in cases {
        let [_, err] = folder.expect(code, &[&["merge", "-o", "merged/a.exr"], parts].concat());
        contains(&err, words);
    }
    assert!(folder.files("merged").is_empty(), "{:?}", folder.files("merged"));
    let [_, err] = folder.expect(6, &["merge", "-o", "merged/a.exr", "--memory-limit", "0.00001", &a, &b, &d]);
    contains(&err, &["--memory-limit"]);
    folder.expect(2, &["merge", "-o", "merged/a.png", &a, &b, &d]);
    folder.expect(0, &["merge", "-o", "merged/a.exr", &a, &b, &d]);
}

/// A hash keeps accidents out and nobody else: whatever stands before a right one is read without a panic, and within the
/// memory limit.
#[test]
fn parts_with_a_right_hash_and_wrong_contents_are_no_panic() {
    let folder = folder_of(&layered(2).replace("[40, 24]", "[20, 12]"));
    folder.expect(0, &["render", "smoke.yaml", "--frames", "1", "--samples", "1-2"]);
    let whole = fs::read(folder.path("out/smoke.0001.samples-1-2.part")).unwrap();
    let body = &whole[..whole.len() - 32];
    let output = folder.path("merged.exr").display().to_string();
    let mut merged = 0;
    for i in 0..600 {
        let mut damaged = body.to_vec();
        let at = 17 + (Seed(3).word(2 * i) % (body.len() as u64 - 17)) as usize;
        // Every third in the head, which is a small part of the file.
        let at = if i % 3 == 0 { 17 + at % 2500 } else { at };
        damaged[at] = Seed(3).word(2 * i + 1) as u8;
        let hash = sha256(&damaged);
        damaged.extend((0..32).map(|k| u8::from_str_radix(&hash[2 * k..2 * k + 2], 16).unwrap()));
        fs::write(folder.path("damaged.part"), damaged).unwrap();
        let parts = vec![folder.path("damaged.part")];
        let job = MergeJob { parts, output: &output, memory_limit: 64 << 20, arguments: Vec::new() };
        merged += usize::from(merge(&job, &Silent, &mut |_, _| {}).is_ok());
    }
    assert!(merged > 0 && merged < 600, "{merged}");
}

/// Most address space and most open files of this program's child; both inherited.
fn with_limits(folder: &Folder, limits: &str, arguments: &[&str]) -> std::process::Output {
    let mut command = Command::new("bash");
    command.args(["-c", &format!("ulimit {limits} && exec \"$0\" \"$@\""), env!("CARGO_BIN_EXE_curlsmoke")]);
    command.args(arguments).current_dir(folder.0.path()).output().unwrap()
}

#[test]
fn there_may_be_more_parts_than_files_may_be_open() {
    let folder = folder_of(&SMOKE.replace("spp: 4", "spp: 80"));
    let part = |i: u32| format!("out/smoke.0001.samples-{i}-{i}.part");
    for i in 1..=80 {
        let samples = format!("{i}-{i}");
        folder.expect(0, &["render", "smoke.yaml", "--frames", "1", "--samples", &samples, "-j", "1"]);
    }
    folder.expect(0, &["render", "smoke.yaml", "--frames", "1"]);
    let parts: Vec<String> = (1..=80).map(part).collect();
    let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
    let output = with_limits(&folder, "-n 40", &[&["merge", "-o", "merged.exr", "-j", "2"], &parts[..]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let [a, b] = ["out/smoke.0001.exr", "merged.exr"].map(|name| fs::read(folder.path(name)).unwrap());
    assert!(a == b, "the merged picture differs");
}

#[test]
fn parts_of_pictures_larger_than_a_scene_may_have_are_refused() {
    let folder = folder_of(SMOKE);
    folder.expect(0, &["render", "smoke.yaml", "--frames", "1", "--samples", "1-4"]);
    let whole = fs::read(folder.path("out/smoke.0001.samples-1-4.part")).unwrap();
    let head_length = u64::from_le_bytes(whole[17..25].try_into().unwrap()) as usize;
    let head = String::from_utf8(whole[25..25 + head_length].to_vec()).unwrap();
    let (frame, bounds) = ("\"resolution\":[16,16]", "\"bounds\":[0,0,16,16]");
    assert!(head.matches(frame).count() >= 1 && head.matches(bounds).count() == 1, "{head}");
    let merged = |size: [i64; 2], [x, y]: [i64; 2]| {
        let head = head
            .replace(frame, &format!("\"resolution\":{size:?}"))
            .replace(bounds, &format!("\"bounds\":{:?}", [x, y, x + 16, y + 16]));
        let mut bytes = whole[..17].to_vec();
        bytes.extend((head.len() as u64).to_le_bytes());
        bytes.extend(head.as_bytes());
        bytes.extend(&whole[25 + head_length..whole.len() - 32]);
        let hash = sha256(&bytes);
        bytes.extend((0..32).map(|k| u8::from_str_radix(&hash[2 * k..2 * k + 2], 16).unwrap()));
        fs::write(folder.path("hostile.part"), bytes).unwrap();
        folder.run(&["merge", "-o", "merged.exr", "hostile.part"])
    };
    let largest = i64::from(i32::MAX);
    for (size, place) in [
        ([largest, 16], [largest - 16, 0]),
        ([largest, largest], [largest - 16, largest - 16]),
        ([32769, 16], [0, 0]),
        ([16, 16], [-16385, 0]),
        ([16, 16], [0, 16385]),
    ] {
        let output = merged(size, place);
        let err = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{size:?} {place:?}: {err}");
        contains(&err, &["hostile.part", "larger than that of a scene may be"]);
    }
    // The corners of what may be are read.
    for (size, place) in [([32768, 32768], [49136, 49136]), ([16, 16], [-16384, -16384])] {
        let output = merged(size, place);
        assert!(output.status.success(), "{size:?} {place:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn heads_with_layers_twice_or_with_lists_of_nothing_are_refused() {
    let folder = folder_of(SMOKE);
    folder.expect(0, &["render", "smoke.yaml", "--frames", "1", "--samples", "1-4"]);
    let whole = fs::read(folder.path("out/smoke.0001.samples-1-4.part")).unwrap();
    let head_length = u64::from_le_bytes(whole[17..25].try_into().unwrap()) as usize;
    let head = String::from_utf8(whole[25..25 + head_length].to_vec()).unwrap();
    let masks = r#"{"Cryptomatte":["a","b"]},{"Cryptomatte":["a"]}"#;
    let cases = [
        ("\"layers\":[", format!("\"layers\":[{masks}"), 3, "a layer twice"),
        ("\"parts\":[", format!("\"parts\":[{{}}{}", ",{}".repeat(200_000)), 6, "memory"),
    ];
    for (from, to, code, words) in cases {
        let at = head.find(from).unwrap_or_else(|| panic!("{from} in {head}")) + from.len();
        // Whatever stands there already follows.
        let rest = if head[at..].starts_with(']') { head[at..].to_string() } else { format!(",{}", &head[at..]) };
        let head = format!("{}{to}{rest}", &head[..at - from.len()]);
        let mut bytes = whole[..17].to_vec();
        bytes.extend((head.len() as u64).to_le_bytes());
        bytes.extend(head.as_bytes());
        bytes.extend(&whole[25 + head_length..whole.len() - 32]);
        let hash = sha256(&bytes);
        bytes.extend((0..32).map(|k| u8::from_str_radix(&hash[2 * k..2 * k + 2], 16).unwrap()));
        fs::write(folder.path("hostile.part"), bytes).unwrap();
        let arguments = ["merge", "-o", "merged.exr", "--memory-limit", "0.1", "-j", "1", "hostile.part"];
        contains(&folder.expect(code, &arguments)[1], &[words]);
    }
}

/// A small file that says that it has a tile far away, and a large one of tiles without end, take no memory to refuse.
#[test]
fn hostile_parts_keep_to_the_memory_limit() {
    let folder = folder_of(SMOKE);
    folder.expect(0, &["render", "smoke.yaml", "--frames", "1", "--samples", "1-4"]);
    let whole = fs::read(folder.path("out/smoke.0001.samples-1-4.part")).unwrap();
    let head_length = u64::from_le_bytes(whole[17..25].try_into().unwrap()) as usize;
    let head = String::from_utf8(whole[25..25 + head_length].to_vec()).unwrap();
    assert!(head.contains("\"resolution\":[16,16]") && head.contains("\"bounds\":[0,0,16,16]"), "{head}");
    // Millions of tiles of a pixel.
    let head = head.replace("[16,16]", "[32768,32768]").replace("[0,0,16,16]", "[-16384,-16384,49152,49152]");
    let edge = head.find("\"tile_edge\":").unwrap() + 12;
    let end = edge + head[edge..].find(',').unwrap();
    let head = format!("{}1{}", &head[..edge], &head[end..]);
    let file = |tiles: &mut dyn Iterator<Item = (u64, u64)>| {
        let mut bytes = whole[..17].to_vec();
        bytes.extend((head.len() as u64).to_le_bytes());
        bytes.extend(head.as_bytes());
        for (index, size) in tiles {
            bytes.extend(index.to_le_bytes());
            bytes.extend(size.to_le_bytes());
            bytes.resize(bytes.len() + size as usize, 0);
        }
        let hash = sha256(&bytes);
        bytes.extend((0..32).map(|k| u8::from_str_radix(&hash[2 * k..2 * k + 2], 16).unwrap()));
        bytes
    };
    let cases: [(Vec<u8>, i32, &str); 4] = [
        (file(&mut [(60_000_000, 60_000_000)].into_iter()), 6, "memory"),
        (file(&mut (0..1_000_000).map(|i| (i, 33))), 6, "memory"),
        (file(&mut (0..1_000_000).map(|i| (i, 0))), 3, "too short"),
        (file(&mut (0..1_000_000).map(|_| (7, 33))), 3, "out of order"),
    ];
    for (i, (bytes, code, words)) in cases.into_iter().enumerate() {
        fs::write(folder.path("hostile.part"), bytes).unwrap();
        let arguments = ["merge", "-o", "merged.exr", "--memory-limit", "0.01", "-j", "1", "hostile.part"];
        let output = with_limits(&folder, "-v 900000", &arguments);
        let err = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{i}: {err}");
        contains(&err, &[words]);
    }
}

#[test]
fn paths_that_are_not_known_beforehand_are_not_made_in_parts() {
    let folder = folder_of(SMOKE);
    let cases: [(&[&str], &str); 7] = [
        (&["--set", "film.noise_target=0.05"], "does not go with film.noise_target"),
        (&["--set", "film.time_limit=5"], "does not go with film.time_limit"),
        (&["--noise-target", "0.1"], "cannot be used with"),
        (&["--time-limit", "1"], "cannot be used with"),
        (&["--spp", "3"], "there are paths 1-3 a pixel"),
        (&["--samples", "0-4"], "counted from 1"),
        (&["--samples", "4-1"], "counted from 1"),
    ];
    for (more, words) in cases {
        let samples: &[&str] = if more[0] == "--samples" { &[] } else { &["--samples", "1-4"] };
        let [_, err] = folder.expect(2, &[&["render", "smoke.yaml"], more, samples].concat());
        contains(&err, &[words]);
    }
    assert!(folder.files("out").is_empty());
}

fn start(folder: &Folder, more: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_curlsmoke"))
        .current_dir(folder.0.path())
        .args(["render", "smoke.yaml", "--frames", "1", "--resume", "--progress", "plain"])
        .args(more)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Waits until a file is there, at most a minute.
fn wait_for(folder: &Folder, name: &str) {
    let start = Instant::now();
    while !folder.path(name).exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "{name} never came: {:?}", folder.files("out"));
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status().unwrap().success());
}

#[test]
fn a_still_that_is_killed_again_and_again_ends_with_the_same_bytes() {
    let folder = folder_of(&layered(600));
    let whole = whole(&folder);
    let mut resumed = 0;
    for i in 0.. {
        assert!(i < 200, "it never ends");
        let mut child = start(&folder, &["--checkpoint-every", "0.02"]);
        if i > 0 {
            std::thread::sleep(Duration::from_millis(Seed(7).word(i) % 500));
        }
        // However fast the machine is, some tiles are done when the first run is killed, and not all.
        while i == 0 && !folder.path("out/smoke.0001.checkpoint").exists() {
            assert!(child.try_wait().unwrap().is_none(), "it was done before anything was kept");
            std::thread::sleep(Duration::from_millis(2));
        }
        let is_over = child.try_wait().unwrap().is_some();
        child.kill().unwrap();
        child.wait().unwrap();
        if folder.path("out/smoke.0001.json").exists() && is_over {
            break;
        }
        resumed += usize::from(folder.path("out/smoke.0001.checkpoint").exists());
    }
    assert!(resumed > 0, "no run was killed between two tiles");
    has_bytes(&folder, "out/smoke.0001", &whole);
    assert_eq!(folder.files("out"), ["smoke.0001.exr", "smoke.0001.json", "smoke.0001.png"], "the checkpoint is left");
}

#[test]
fn a_signal_leaves_a_checkpoint_to_go_on_from() {
    let folder = folder_of(&layered(600));
    let whole = whole(&folder);
    for (name, code, more) in
        [("TERM", 143, &[][..]), ("INT", 130, &["--samples", "1-400"]), ("TERM", 143, &["--noise-target", "1e-4"])]
    {
        let checkpoint = match more {
            ["--samples", _] => "out/smoke.0001.samples-1-400.checkpoint",
            _ => "out/smoke.0001.checkpoint",
        };
        // The first comes by itself, so that there is something to write when the signal comes.
        let mut child = start(&folder, &[more, &["--checkpoint-every", "0.01", "-j", "1"]].concat());
        wait_for(&folder, checkpoint);
        fs::remove_file(folder.path(checkpoint)).unwrap();
        signal(&child, name);
        assert_eq!(child.wait().unwrap().code(), Some(code));
        assert!(folder.path(checkpoint).exists(), "{name}: {:?}", folder.files("out"));
        assert!(!folder.path("out/smoke.0001.exr").exists());
        let [_, err] =
            folder.expect(0, &[&["render", "smoke.yaml", "--frames", "1", "--resume", "-j", "3"], more].concat());
        contains(&err, &["frame 1: goes on from a checkpoint with ", " of "]);
        assert!(!folder.path(checkpoint).exists());
        match more {
            [] => has_bytes(&folder, "out/smoke.0001", &whole),
            ["--samples", _] => {
                folder.expect(0, &["render", "smoke.yaml", "--frames", "1", "--samples", "401-600"]);
                let [a, b] = ["1-400", "401-600"].map(|samples| format!("out/smoke.0001.samples-{samples}.part"));
                folder.expect(0, &["merge", &a, &b, "-o", "merged.exr"]);
                has_bytes(&folder, "merged", &whole);
            }
            _ => {
                let adaptive = fs::read(folder.path("out/smoke.0001.exr")).unwrap();
                folder.expect(0, &[&["render", "smoke.yaml", "--frames", "1"], more].concat());
                assert!(fs::read(folder.path("out/smoke.0001.exr")).unwrap() == adaptive);
            }
        }
        let sidecar = Sidecar::read(&folder.path("out/smoke.0001.json"));
        assert!(more.is_empty() != sidecar.as_ref().map_or(true, |s| s.tiles_resumed == 0), "{sidecar:?}");
        let _ = fs::remove_dir_all(folder.path("out"));
    }
}

#[test]
fn a_checkpoint_of_something_else_is_told_of_and_not_used() {
    let folder = folder_of(&layered(600));
    let mut child = start(&folder, &["--checkpoint-every", "0.01", "--seed", "2"]);
    wait_for(&folder, "out/smoke.0001.checkpoint");
    child.kill().unwrap();
    child.wait().unwrap();
    let checkpoint = fs::read(folder.path("out/smoke.0001.checkpoint")).unwrap();
    let [_, err] = folder.expect(3, &["merge", "out/smoke.0001.checkpoint", "-o", "a.exr"]);
    contains(&err, &["a checkpoint of a picture that traces all its paths"]);
    let resume = ["render", "smoke.yaml", "--frames", "1", "--resume", "--spp", "2"];
    let [_, err] = folder.expect(0, &resume);
    contains(&err, &["out/smoke.0001.checkpoint is not used", "has changed since"]);
    assert!(!folder.path("out/smoke.0001.checkpoint").exists(), "it is of no use to the finished frame");
    fs::remove_file(folder.path("out/smoke.0001.json")).unwrap();
    fs::write(folder.path("out/smoke.0001.checkpoint"), &checkpoint[..checkpoint.len() / 2]).unwrap();
    let [_, err] = folder.expect(0, &resume);
    contains(&err, &["is not used", "cut short or damaged"]);
}

#[test]
fn a_running_render_shows_what_it_has_when_asked() {
    let folder = folder_of(&layered(600));
    let whole = whole(&folder);
    let mut child = start(&folder, &["-j", "1", "--checkpoint-every", "0.01"]);
    wait_for(&folder, "out/smoke.0001.checkpoint");
    signal(&child, "USR1");
    wait_for(&folder, "out/smoke.0001.snapshot.png");
    let snapshot = exr::read(&folder.path("out/smoke.0001.snapshot.exr"), 1 << 26).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(0));
    has_bytes(&folder, "out/smoke.0001", &whole);
    let finished = exr::read(&folder.path("out/smoke.0001.exr"), 1 << 26).unwrap();
    assert_eq!(snapshot.size, finished.size);
    // Tiles that were done have their light, the others none.
    let samples = |image: &Image| image.channel("samples").unwrap().to_vec();
    let (own, all) = (samples(&snapshot), samples(&finished));
    let done = own.iter().filter(|&&n| n > 0.0).count();
    assert!(done > 0 && done < own.len(), "{done} of {}", own.len());
    assert!(own.iter().zip(&all).all(|(a, b)| *a == 0.0 || a == b));
}

#[test]
fn missing_frames_are_listed_for_another_run() {
    let folder = Folder::new();
    let missing = |more: &[&str]| folder.expect(0, &[&["render", "ball.yaml", "--missing"], more].concat());
    assert_eq!(missing(&[])[0], "1-3\n");
    folder.expect(0, &["render", "ball.yaml", "--frames", "2"]);
    let [out, err] = missing(&[]);
    assert_eq!(out, "1,3\n");
    contains(&err, &["2 of 3 frames are missing"]);
    folder.expect(0, &["render", "ball.yaml", "--frames", out.trim()]);
    assert_eq!(missing(&[])[0], "");
    assert_eq!(missing(&["--seed", "2"])[0], "1-3\n", "made from other settings");
    assert_eq!(missing(&["--samples", "1-2"])[0], "1-3\n");
    folder.expect(0, &["render", "ball.yaml", "--frames", "1", "--samples", "1-2"]);
    assert_eq!(missing(&["--samples", "1-2", "--frames", "1-2"])[0], "2\n");
    fs::write(folder.path("out/ball.0002.png"), "damaged").unwrap();
    assert_eq!(missing(&["--frames", "1-2"])[0], "2\n");
}

#[test]
fn farms_are_told_a_share_that_only_grows() {
    let folder = Folder::new();
    folder.expect(0, &["render", "ball.yaml", "--frames", "1"]);
    for (style, start, end) in [("openjd", "openjd_progress: ", ""), ("alfred", "ALF_PROGRESS ", "%")] {
        let spp = ["--spp", "4", "--set", "film.resolution=[24, 16]"];
        let [_, err] =
            folder.expect(0, &[&["render", "ball.yaml", "--resume", "--progress", style], &spp[..]].concat());
        assert!(!err.contains('\r'), "{err}");
        let number = |line: &str| line.strip_prefix(start)?.strip_suffix(end)?.parse::<f64>().ok();
        let shares: Vec<f64> = err.lines().filter_map(number).collect();
        assert!(shares.windows(2).all(|pair| pair[0] < pair[1]), "{err}");
        assert_eq!(shares.last(), Some(&100.0), "{err}");
        assert!(shares.iter().any(|share| (33.0..34.0).contains(share)), "a frame that was there counts: {err}");
        fs::remove_file(folder.path("out/ball.0002.json")).unwrap();
        fs::remove_file(folder.path("out/ball.0003.json")).unwrap();
    }
}

#[test]
fn a_farm_is_told_why_a_task_failed() {
    let folder = Folder::new();
    folder.write("smoke.yaml", SMOKE);
    let beyond = ["--set", "smoke.emitters[0].mass=1e12", "--set", "smoke.medium.extinction=1e9"];
    let [_, err] = folder.expect(3, &[&["render", "smoke.yaml", "--progress", "openjd"], &beyond[..]].concat());
    assert!(err.lines().any(|line| line.starts_with("openjd_fail: ") && line.contains("extinction")), "{err}");
}

#[test]
fn a_script_for_slurm_renders_what_its_task_is_for() {
    let folder = folder_of(SMOKE);
    folder.expect(0, &["render", "smoke.yaml"]);
    fs::rename(folder.path("out"), folder.path("whole")).unwrap();
    let [script, _] = folder.expect(0, &["farm", "slurm", "smoke.yaml", "--chunk", "2", "--frames", "1-3"]);
    contains(&script, &["#SBATCH --array=0-1\n", "#SBATCH --requeue\n", "#SBATCH --signal=B:TERM@", "\n1-2\n3\n"]);
    folder.write("job.sh", &script);
    for task in ["0", "1"] {
        let mut bash = Command::new("bash");
        bash.args(["job.sh"]).env("SLURM_ARRAY_TASK_ID", task).env("CURLSMOKE", env!("CARGO_BIN_EXE_curlsmoke"));
        let output = bash.current_dir(folder.0.path()).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    for frame in 1..=3 {
        let [a, b] = ["whole", "out"].map(|f| fs::read(folder.path(&format!("{f}/smoke.000{frame}.exr"))).unwrap());
        assert!(a == b, "frame {frame}");
    }
}

/// Frames of some of the scene, so that there are no files of the others.
#[test]
fn a_job_that_bakes_renders_what_it_has_baked() {
    let folder = folder_of(SMOKE);
    folder.expect(0, &["render", "smoke.yaml", "--frames", "2-3"]);
    fs::rename(folder.path("out"), folder.path("whole")).unwrap();
    let [script, _] = folder.expect(0, &["farm", "slurm", "smoke.yaml", "--bake", "--frames", "2-3"]);
    contains(&script, &["--dependency=\"afterok:$bake\"", " bake ", "smoke={"]);
    folder.write("job.sh", &script);
    // Runs what is submitted at once, all tasks of an array in turn.
    let sbatch = "#!/bin/bash\nset -e\ncat > task.sh\nlast=$(sed -n 's/^#SBATCH --array=0-//p' task.sh)\n\
                  for i in $(seq 0 \"${last:-0}\"); do SLURM_ARRAY_TASK_ID=$i bash task.sh >&2; done\necho 1\n";
    folder.write("sbatch", sbatch);
    assert!(Command::new("chmod").args(["+x"]).arg(folder.path("sbatch")).status().unwrap().success());
    let path = format!("{}:{}", folder.0.path().display(), std::env::var("PATH").unwrap());
    let mut job = Command::new("sh");
    job.arg("job.sh").current_dir(folder.0.path()).env("PATH", path).env("CURLSMOKE", env!("CARGO_BIN_EXE_curlsmoke"));
    let output = job.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(
        folder.files("out").iter().filter(|name| name.ends_with(".vdb")).count(),
        2,
        "{:?}",
        folder.files("out")
    );
    for frame in 2..=3 {
        let [a, b] = ["whole", "out"].map(|f| fs::read(folder.path(&format!("{f}/smoke.000{frame}.exr"))).unwrap());
        let [a, b] = [a, b].map(|bytes| {
            fs::write(folder.path("one.exr"), bytes).unwrap();
            exr::read(&folder.path("one.exr"), 1 << 26).unwrap()
        });
        for channel in ["R", "G", "B", "A"] {
            assert!(a.channel(channel) == b.channel(channel), "frame {frame}, {channel}");
        }
    }
    // A frame that was not baked is still missed, and only that.
    let smoke = "smoke={file: {path: out/smoke.####.vdb}}";
    let baked = folder.files("out").into_iter().find(|name| name.ends_with("0002.vdb")).unwrap();
    let smoke = smoke.replace("out/smoke.####.vdb", &format!("out/{}", baked.replace("0002", "####")));
    let [_, err] = folder.expect(4, &["render", "smoke.yaml", "--set", &smoke, "--frames", "1-2"]);
    contains(&err, &["there is no file for frame 1:"]);
    // What files do not hold is not asked of them.
    let [_, err] = folder.expect(2, &["farm", "slurm", "smoke.yaml", "--bake", "--set", "output.aovs=[motion]"]);
    contains(&err, &["`motion`", "leave out"]);
}

#[test]
fn folders_whose_names_would_stand_for_frames_are_refused() {
    let folder = folder_of(SMOKE);
    for (name, is_refused) in
        [("sh#1", true), ("a%04d", true), ("b{frame}", true), ("c{d", true), ("$F", true), ("100%", false)]
    {
        fs::create_dir(folder.path(name)).unwrap();
        for verb in ["slurm", "openjd"] {
            let mut command = folder.command(&["farm", verb, "../smoke.yaml"]);
            let output = command.current_dir(folder.path(name)).output().unwrap();
            let err = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(if is_refused { 2 } else { 0 }), "{name}: {err}");
            if is_refused {
                contains(&err, &[name, "start from another folder"]);
            }
        }
    }
}

#[test]
fn a_template_for_open_job_description_is_json() {
    let folder = folder_of(SMOKE);
    let [text, _] = folder.expect(0, &["farm", "openjd", "smoke.yaml", "--chunk", "2", "--frames", "3,1"]);
    let body = text.split_once('\n').unwrap().1;
    let template: serde_json::Value = serde_json::from_str(body).unwrap();
    assert_eq!(template["specificationVersion"], "jobtemplate-2023-09");
    let task = &template["steps"][0]["parameterSpace"]["taskParameterDefinitions"][0];
    assert_eq!((task["range"].as_str(), task["chunks"]["defaultTaskCount"].as_u64()), (Some("1,3"), Some(2)));
    let [text, _] = folder.expect(0, &["farm", "openjd", "smoke.yaml", "--bake"]);
    contains(&text, &["\"dependsOn\": \"bake\"", "smoke={"]);
    assert_eq!(text.matches("{{").count(), text.matches("}}").count(), "{text}");
    let [_, err] = folder.expect(2, &["farm", "openjd", "smoke.yaml", "--set", "film.spp=4 # {{b"]);
    contains(&err, &["film.spp=4 # {{b", "stands for parameters"]);
    let [_, err] = folder.expect(3, &["farm", "openjd", "ball.yaml", "--bake"]);
    contains(&err, &["no smoke"]);
}

#[test]
fn a_sidecar_says_how_to_make_the_frame_again() {
    let folder = Folder::new();
    let arguments = ["render", "ball.yaml", "--frames", "2", "--set", "camera.vertical_fov_deg=40", "--seed", "9"];
    folder.expect(0, &arguments);
    let sidecar = Sidecar::read(&folder.path("out/ball.0002.json")).unwrap();
    assert_eq!(sidecar.arguments[1..], arguments);
    assert_eq!((sidecar.scene.as_str(), sidecar.seed, sidecar.spp, sidecar.frame), ("ball.yaml", 9, 4, 2));
    assert_eq!(sidecar.scene_sha256, sha256(program::BALL.as_bytes()));
    let set = |key: &str, value: &str| (key.to_string(), value.to_string());
    assert_eq!(sidecar.overrides, [set("render.seed", "9"), set("camera.vertical_fov_deg", "40")]);
    assert_eq!((sidecar.resolution, sidecar.crop), ([24, 16], None));
    let before = fs::read(folder.path("out/ball.0002.exr")).unwrap();
    fs::remove_dir_all(folder.path("out")).unwrap();
    let again: Vec<&str> = sidecar.arguments[1..].iter().map(String::as_str).collect();
    folder.expect(0, &again);
    assert!(fs::read(folder.path("out/ball.0002.exr")).unwrap() == before);
}
