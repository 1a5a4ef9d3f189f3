//! Pages for people who have a task: every command on them that needs no other program is run, in its order, so that they stay true.

#[path = "support/program.rs"]
mod program;

use program::{Folder, SMOKE, hot_smoke, scene_from_files};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What is made small so that a page takes seconds.
const SMALL: [(&str, &str); 9] = [
    ("resolution: [640, 360]", "resolution: [32, 18]"),
    ("spp: 64}", "spp: 2}"),
    ("rate: 40000", "rate: 40"),
    ("voxel_size: 0.015, kernel_radius: 0.034", "voxel_size: 0.1, kernel_radius: 0.2"),
    ("--spp 1024", "--spp 8"),
    ("--spp 64", "--spp 4"),
    ("--pixel 320,180", "--pixel 16,9"),
    ("-o out/flow", "-o out/flow --resolution 64x36"),
    ("last: 48", "last: 25"),
];

/// Stands for a mesh of somebody's own.
const MESH: &str = "v 0.3 0 0\nv -0.3 0 0\nv 0 0.3 0\nv 0 -0.3 0\nv 0 0 0.3\nv 0 0 -0.3\n\
                    f 1 3 5\nf 3 2 5\nf 2 4 5\nf 4 1 5\nf 3 1 6\nf 2 3 6\nf 4 2 6\nf 1 4 6\n";

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn page(name: &str) -> String {
    fs::read_to_string(root().join("docs").join(name)).unwrap_or_else(|e| panic!("docs/{name}: {e}"))
}

/// Writes the files that a page shows and runs its commands: all lines of blocks in `sh`, and of indented ones those of this program. How
/// many there were.
fn follow(folder: &Folder, page: &str) -> usize {
    let program = Path::new(env!("CARGO_BIN_EXE_curlsmoke")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap());
    let run = |line: &str| {
        let shell = Command::new("sh").arg("-c").arg(line).current_dir(folder.0.path()).env("PATH", &path).output();
        let shell = shell.unwrap();
        let said = [shell.stdout, shell.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
        assert!(shell.status.success(), "{line}\n{said}");
    };
    let mut count = 0;
    for (i, block) in page.split("```").enumerate() {
        let commands: Vec<&str> = if i % 2 == 0 {
            block.lines().filter_map(|line| line.strip_prefix("    ")).filter(|l| l.starts_with("curlsmoke ")).collect()
        } else {
            let (kind, text) = block.split_once('\n').unwrap();
            match kind.split_once(' ') {
                Some(("yaml", name)) => {
                    folder.write(name, text);
                    continue;
                }
                None if kind == "sh" => text.lines().collect(),
                // A part of a scene, for the test of its page.
                None if kind == "yaml" => continue,
                _ => panic!("a block of `{kind}`"),
            }
        };
        commands.iter().for_each(|line| run(line));
        count += commands.len();
    }
    count
}

/// The guides in the order in which they build on one another, in one folder.
#[test]
fn guides_do_what_they_say() {
    let folder = Folder::new();
    folder.write("stone.obj", MESH);
    let guides: [(&str, usize, &[&str]); 4] = [
        ("first-plume", 5, &["plume.0024.png", "thick.0024.exr", "plume.wedge.png", "plume.0025.exr"]),
        ("own-mesh", 3, &["flow.png", "past.0024.exr"]),
        ("bring-a-vdb", 4, &["density.png", "cloud.0001.png"]),
        ("lookdev-still", 9, &["look.png", "part.0024.exr", "stops.png", "still.0024.exr"]),
    ];
    let mut unused = SMALL.to_vec();
    for (name, commands, files) in guides {
        let mut text = page(&format!("guides/{name}.md"));
        unused.retain(|(large, _)| !text.contains(large));
        SMALL.iter().for_each(|(large, small)| text = text.replace(large, small));
        assert_eq!(follow(&folder, &text), commands, "commands of {name}");
        for file in files {
            assert!(folder.path(&format!("out/{file}")).exists(), "{name}: {file} is not in {:?}", folder.files("out"));
        }
    }
    assert!(unused.is_empty(), "no page has {unused:?}");
}

#[test]
fn every_guide_is_followed() {
    let names = fs::read_dir(root().join("docs/guides")).unwrap().map(|entry| entry.unwrap().path());
    let mut pages: Vec<PathBuf> = names.filter(|path| path.extension().is_some_and(|e| e == "md")).collect();
    pages.sort();
    let names: Vec<_> = pages.iter().map(|path| path.file_stem().unwrap().to_str().unwrap()).collect();
    assert_eq!(
        names,
        ["bring-a-vdb", "first-plume", "lookdev-still", "own-mesh"],
        "name it in guides_do_what_they_say"
    );
}

#[test]
fn regression_tests_work_as_their_page_says() {
    let folder = Folder::new();
    assert!(follow(&folder, &page("regression.md")) >= 4);
    assert_eq!(folder.files("out/report"), ["index.html"]);
}

#[test]
fn smoke_goes_to_other_programs_and_back_as_its_page_says() {
    let scene = hot_smoke().replace("last: 3", "last: 2");
    let folder = Folder::new();
    folder.write("smoke.yaml", &scene);
    let text = page("vdb.md");
    let yaml = text.split("```yaml\n").nth(1).and_then(|text| text.split("```").next()).expect("the scene of the page");
    folder.write("files.yaml", &scene_from_files(&scene, "{path: x}").replace("  file: {path: x}\n", yaml));
    assert_eq!(follow(&folder, &text), 5);
    assert_eq!(folder.files("cache").len(), 7, "{:?}", folder.files("cache"));
    assert_eq!(folder.files("out").len(), 4, "{:?}", folder.files("out"));
}

#[test]
fn farms_are_fed_as_their_page_says() {
    let folder = Folder::new();
    fs::create_dir(folder.path("scenes")).unwrap();
    let scene = SMOKE.replace("resolution: [16, 16]", "resolution: [8, 8]").replace("rate: 2000", "rate: 200");
    let scene = scene.replace("image: out/smoke.####.exr", "image: \"out/{scene}.####.exr\"");
    folder.write("scenes/plume.yaml", &scene.replace("last: 3", "last: 96"));
    folder.write("scenes/ring.yaml", &scene.replace("last: 3", "last: 1").replace("spp: 4", "spp: 192"));
    // Two halves of a sequence, what is missing, two parts and their merging, two farms.
    assert_eq!(follow(&folder, &page("farm.md")), 8);
    let files = folder.files("out");
    assert_eq!(files.iter().filter(|name| name.starts_with("plume.") && name.ends_with(".exr")).count(), 96);
    assert!(files.contains(&"ring.0001.exr".into()), "{files:?}");
    for (name, part) in [("plume.template.yaml", "jobtemplate-2023-09"), ("plume.sbatch", "#SBATCH --array=0-11")] {
        let text = fs::read_to_string(folder.path(name)).unwrap();
        assert!(text.contains(part), "{text}");
    }
}

/// Files that a page names, from its own folder.
#[test]
fn links_lead_somewhere() {
    let mut pages = vec![root().join("README.md")];
    for folder in ["docs", "docs/guides"] {
        let entries = fs::read_dir(root().join(folder)).unwrap().map(|entry| entry.unwrap().path());
        pages.extend(entries.filter(|path| path.extension().is_some_and(|e| e == "md")));
    }
    let mut count = 0;
    for path in &pages {
        let text = fs::read_to_string(path).unwrap();
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let file = link.split('#').next().unwrap();
            if file.is_empty() || file.contains("://") {
                continue;
            }
            assert!(path.parent().unwrap().join(file).exists(), "{}: {link}", path.display());
            count += 1;
        }
    }
    assert!(count > 40, "{count} links");
}
