//! Contact sheets and movies.

#[path = "support/program.rs"]
mod program;

use curlsmoke::output::png;
use program::{BALL, Folder, contains};
use std::fs;
use std::os::unix::fs::PermissionsExt;

#[test]
fn pictures_are_laid_out_with_their_names() {
    let folder = Folder::new();
    for (name, value) in [("a.exr", 0.2), ("b.exr", 0.5), ("c.exr", 4.0)] {
        folder.picture(name, value);
    }
    let [out, _] = folder.expect(0, &["sheet", "a.exr", "b.exr", "c.exr", "-o", "out/sheet.png", "--columns", "3"]);
    contains(&out, &["out/sheet.png: "]);
    let sheet = png::read(&folder.path("out/sheet.png"), 1 << 24).unwrap();
    let rgb = sheet.to_rgb("").unwrap();
    for shown in [0.2, 0.5, 1.0] {
        let count = rgb.iter().filter(|c| c.iter().all(|x| (x - shown).abs() < 0.004)).count();
        assert_eq!(count, 32, "{shown}");
    }
}

#[test]
fn one_picture_becomes_a_png_as_the_screen_shows_it() {
    let folder = Folder::new();
    folder.picture("a.exr", 0.18);
    folder.expect(0, &["sheet", "a.exr", "-o", "a.png", "--view", "agx"]);
    let shown = png::read(&folder.path("a.png"), 1 << 24).unwrap();
    assert_eq!(shown.size, [8, 4]);
    // Middle grey stays what it is.
    assert!(shown.to_rgb("").unwrap().iter().flatten().all(|x| (x - 0.18).abs() < 0.004));
    folder.expect(0, &["sheet", "a.exr", "-o", "b.png", "--exposure", "-1"]);
    let darker = png::read(&folder.path("b.png"), 1 << 24).unwrap();
    assert!(darker.to_rgb("").unwrap().iter().flatten().all(|x| (x - 0.09).abs() < 0.004));
}

#[test]
fn what_cannot_be_laid_out_is_said() {
    let folder = Folder::new();
    folder.picture("a.exr", 0.18);
    let [_, err] = folder.expect(2, &["sheet", "a.exr", "-o", "a.exr"]);
    contains(&err, &["a.exr", ".png"]);
    let [_, err] = folder.expect(4, &["sheet", "no.exr", "-o", "a.png"]);
    contains(&err, &["no.exr: no such file"]);
    let [_, err] = folder.expect(2, &["sheet", "a.exr", "-o", "a.png", "--columns", "0"]);
    contains(&err, &["--columns"]);
    // Each picture is small; their sheet is not.
    let many = ["a.exr"; 200].join(" ");
    let many = format!("sheet {many} -o a.png --columns 1 --memory-limit 0.2M");
    let [_, err] = folder.expect(6, &many.split(' ').collect::<Vec<_>>());
    contains(&err, &["a.png: needs ", "--memory-limit"]);
    folder.write("odd.png", "no picture");
    folder.expect(3, &["sheet", "odd.png", "-o", "a.png"]);
    assert!(!folder.path("a.png").exists());
}

/// Stands for ffmpeg: keeps what it is fed and told, and writes something where the movie is to be.
fn fake_ffmpeg(folder: &Folder, script: &str) -> String {
    fs::create_dir(folder.path("bin")).unwrap();
    folder.write("bin/ffmpeg", script);
    fs::set_permissions(folder.path("bin/ffmpeg"), fs::Permissions::from_mode(0o755)).unwrap();
    format!("{}:/usr/bin:/bin", folder.path("bin").display())
}

#[test]
fn a_movie_is_made_of_all_previews_in_order() {
    let folder = Folder::new();
    let path = fake_ffmpeg(
        &folder,
        "#!/bin/sh\n[ \"$1\" = -version ] && exit 0\necho \"$@\" > told\ncat > fed\nfor last; do :; done\necho movie > \"$last\"\n",
    );
    let arguments = ["render", "ball.yaml", "--frames", "3,1", "--movie", "out/ball.mp4"];
    folder.command(&arguments).env("PATH", &path).assert().success();
    assert_eq!(fs::read_to_string(folder.path("out/ball.mp4")).unwrap(), "movie\n");
    let frame = |n: u32| fs::read(folder.path(&format!("out/ball.000{n}.png"))).unwrap();
    assert_eq!(fs::read(folder.path("fed")).unwrap(), [frame(3), frame(1)].concat());
    contains(&fs::read_to_string(folder.path("told")).unwrap(), &["-framerate 24 ", "libx264"]);
    assert!(folder.files("out").iter().all(|name| !name.starts_with('.')));
}

#[test]
fn a_movie_that_cannot_be_made_is_told_before_or_afterwards() {
    let folder = Folder::new();
    let path = folder.0.path().display().to_string();
    let render = |path: &str, more: &[&str]| {
        let output =
            folder.command(&[&["render", "ball.yaml", "--frames", "1"], more].concat()).env("PATH", path).output();
        let output = output.unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let (code, err) = render(&path, &["--movie", "out/ball.mp4"]);
    assert_eq!(code, Some(4), "{err}");
    contains(&err, &["ffmpeg cannot be run", "install"]);
    let (code, err) = render(&path, &["--movie", "out/ball.gif"]);
    assert_eq!(code, Some(2), "{err}");
    contains(&err, &["out/ball.gif", ".mp4"]);
    assert!(folder.files("out").is_empty());
    let path = fake_ffmpeg(&folder, "#!/bin/sh\n[ \"$1\" = -version ] && exit 0\necho no such encoder >&2\nexit 1\n");
    let (code, err) = render(&path, &["--movie", "out/ball.mp4"]);
    assert_eq!(code, Some(1), "{err}");
    contains(&err, &["out/ball.mp4", "no such encoder"]);
    assert_eq!(folder.files("out"), ["ball.0001.exr", "ball.0001.json", "ball.0001.png"]);
    folder.write("bare.yaml", &BALL.replace("preview: out/ball.####.png, ", ""));
    let output = folder.command(&["render", "bare.yaml", "--movie", "out/x.mp4"]).env("PATH", &path).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    contains(&String::from_utf8(output.stderr).unwrap(), &["previews", "output.preview"]);
}
