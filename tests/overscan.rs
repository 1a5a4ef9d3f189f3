//! Pixels beside the frame, as people meet them: windows, crops, parts, checkpoints and pictures to look at.

#[path = "support/program.rs"]
mod program;

use curlsmoke::output::image::Image;
use curlsmoke::output::{exr, png};
use program::{Folder, SMOKE, contains};
use std::fs;

const LIMIT: u64 = 1 << 30;

/// Of 20 x 16 pixels, with layers of all kinds, in parts of files.
fn scene(overscan: &str) -> String {
    let all = "depth, normal, albedo, motion, variance, transmittance, cryptomatte, light_groups, samples";
    let output =
        format!("{{image: out/####.exr, preview: out/####.png, layout: multipart, compression: zip, aovs: [{all}]}}");
    SMOKE
        .replace("[16, 16], spp: 4", &format!("[20, 16], spp: 6{overscan}"))
        .replace("{image: out/smoke.####.exr}", &output)
}

fn folder(overscan: &str) -> Folder {
    let folder = Folder::new();
    folder.write("s.yaml", &scene(overscan));
    folder
}

fn read(folder: &Folder, name: &str) -> Image {
    exr::read(&folder.path(name), LIMIT).unwrap_or_else(|e| panic!("{e}"))
}

/// Demands that all channels of `part` are those of `whole` at the same places.
#[track_caller]
fn is_part_of(part: &Image, whole: &Image) {
    let names = |image: &Image| image.channels.iter().map(|c| c.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(part), names(whole));
    for (own, all) in part.channels.iter().zip(&whole.channels) {
        for (i, x) in own.data.iter().enumerate() {
            let [column, row] = [0, 1].map(|axis| (part.position(i)[axis] - whole.data_origin[axis]) as usize);
            let of_whole = all.data[row * whole.data_size[0] as usize + column];
            assert_eq!(x.to_bits(), of_whole.to_bits(), "{} at {:?}", own.name, part.position(i));
        }
    }
}

#[test]
fn the_frame_is_the_display_window_and_keeps_its_bits() {
    let (plain, more) = (folder(""), folder(", overscan: [5, 3, 2, 40]"));
    for folder in [&plain, &more] {
        folder.expect(0, &["render", "s.yaml", "--frames", "2"]);
    }
    let (frame, picture) = (read(&plain, "out/0002.exr"), read(&more, "out/0002.exr"));
    assert_eq!((picture.size, picture.data_origin, picture.data_size), ([20, 16], [-5, -2], [28, 58]));
    is_part_of(&frame, &picture);
    let preview = |folder: &Folder| fs::read(folder.path("out/0002.png")).unwrap();
    assert!(preview(&plain) == preview(&more), "previews show the frame");

    // One number is for all sides, and a setting from the command line is as one from the file.
    plain.expect(0, &["render", "s.yaml", "--frames", "2", "--set", "film.overscan=4", "-o", "even.####.exr"]);
    let even = read(&plain, "even.0002.exr");
    assert_eq!((even.data_origin, even.data_size), ([-4, -4], [28, 24]));
    is_part_of(&frame, &even);
    let [out, _] = plain.expect(0, &["check", "s.yaml", "--set", "film.overscan=[1, 2, 3, 4]"]);
    contains(&out, &["20 × 16 pixels (23 × 23 with overscan)"]);

    // A share of the size is one of the overscan too.
    more.expect(
        0,
        &["render", "s.yaml", "--frames", "2", "--resolution", "200%", "--spp", "1", "-o", "twice.####.exr"],
    );
    let twice = read(&more, "twice.0002.exr");
    assert_eq!((twice.size, twice.data_origin, twice.data_size), ([40, 32], [-10, -4], [56, 116]));

    // Also of sizes that the command line sets; a size in pixels is what it says.
    let set = ["--set", "film.overscan=[4, 2, 0, 0]", "--set", "film.resolution=[40, 16]", "--resolution", "50%"];
    plain.expect(0, &[&["render", "s.yaml", "--frames", "2", "--spp", "1", "-o", "half.####.exr"], &set[..]].concat());
    let half = read(&plain, "half.0002.exr");
    assert_eq!((half.size, half.data_origin, half.data_size), ([20, 8], [-2, 0], [23, 8]));

    let [out, _] = more.expect(0, &["inspect", "out/0002.exr", "--pixel=-5,55"]);
    contains(&out, &["Z "]);
    let [out, _] = more.expect(0, &["inspect", "out/0002.exr", "--layers"]);
    contains(&out, &["20 × 16 pixels", "data at -5, -2: 28 × 58 pixels"]);
    more.expect(0, &["compare", "out/0002.exr", "out/0002.exr"]);
    more.expect(0, &["sheet", "out/0002.exr", "-o", "sheet.png"]);
    assert_eq!(png::read(&more.path("sheet.png"), LIMIT).unwrap().size, [20, 16]);
    fs::copy(plain.path("out/0002.exr"), more.path("frame.exr")).unwrap();
    let [out, _] = more.expect(7, &["compare", "out/0002.exr", "frame.exr"]);
    contains(&out, &["28 × 58"]);
}

#[test]
fn crops_and_parts_reach_beside_the_frame() {
    let folder = folder(", overscan: [5, 3, 2, 20]");
    folder.expect(0, &["render", "s.yaml", "--frames", "2"]);
    let (whole, bytes) = (read(&folder, "out/0002.exr"), fs::read(folder.path("out/0002.exr")).unwrap());
    let render = |more: &[&str]| folder.expect(0, &[&["render", "s.yaml", "--frames", "2"], more].concat());

    render(&["--crop", "-5,-1,7,30", "-o", "crop.####.exr"]);
    let crop = read(&folder, "crop.0002.exr");
    assert_eq!((crop.size, crop.data_origin, crop.data_size), ([20, 16], [-5, -1], [12, 31]));
    is_part_of(&crop, &whole);
    assert_eq!(png::read(&folder.path("crop.0002.png"), LIMIT).unwrap().size, [7, 16]);
    render(&["--crop", "0,20,20,36", "-o", "strip.####.exr"]);
    assert_eq!(
        png::read(&folder.path("strip.0002.png"), LIMIT).unwrap().size,
        [20, 16],
        "there is nothing else to show"
    );
    render(&["--crop", "50%,0%,100%,100%", "-o", "half.####.exr"]);
    assert_eq!(read(&folder, "half.0002.exr").data_origin, [10, 0], "shares are those of the frame");
    let [_, err] = folder.expect(2, &["render", "s.yaml", "--crop", "-6,0,7,9"]);
    contains(&err, &["-6,0,7,9", "20 × 16 with its overscan", "-5 ≤ x0 < x1 ≤ 23 and -2 ≤ y0 < y1 ≤ 36"]);

    for samples in ["1-2", "3-6"] {
        render(&["--samples", samples, "-o", "joined.####.exr"]);
    }
    let parts = ["joined.0002.samples-3-6.part", "joined.0002.samples-1-2.part"];
    folder.expect(0, &[&["merge", "-o", "joined.exr"], &parts[..]].concat());
    assert!(fs::read(folder.path("joined.exr")).unwrap() == bytes, "parts make another picture");

    // Every number of a pixel beside the frame, as in the picture.
    let [out, _] = render(&["--pixel", "-3,21"]);
    contains(&out, &["pixel -3,21"]);
    let number = |line: &str| line.split_whitespace().last().and_then(|x| x.parse::<f32>().ok());
    let z = out.lines().find(|line| line.starts_with("Z ")).and_then(number).unwrap();
    let [column, row] = [2, 23];
    assert_eq!(z.to_bits(), whole.channel("Z").unwrap()[row * 28 + column].to_bits());
    let [_, err] = folder.expect(2, &["render", "s.yaml", "--pixel=-6,0"]);
    contains(&err, &["--pixel -6,0", "28 × 38 pixels, from -5,-2"]);
}

#[test]
fn noise_targets_and_passes_have_the_same_frame() {
    let (plain, more) = (folder(""), folder(", overscan: 6"));
    let target = ["--noise-target", "0.2", "--spp", "64", "--set", "film.min_spp=8"];
    for folder in [&plain, &more] {
        folder.expect(0, &[&["render", "s.yaml", "--frames", "2"], &target[..]].concat());
    }
    let [frame, picture] = [&plain, &more].map(|folder| read(folder, "out/0002.exr"));
    let samples = picture.channel("samples").unwrap();
    assert!(samples.iter().any(|&n| n != samples[0]), "all pixels have equally many paths");
    is_part_of(&frame, &picture);
    // With time for all paths.
    for folder in [&plain, &more] {
        folder.expect(0, &["render", "s.yaml", "--frames", "2", "--time-limit", "1000"]);
    }
    let [frame, picture] = [&plain, &more].map(|folder| read(folder, "out/0002.exr"));
    is_part_of(&frame, &picture);
}
