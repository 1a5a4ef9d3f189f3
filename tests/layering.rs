//! The rules between modules, read off the sources: data flows one way and imports point one way.

use std::fs;
use std::path::{Path, PathBuf};

/// From left to right; a module imports only from modules to its left.
const ORDER: [&str; 17] = [
    "math",
    "progress",
    "foreign",
    "scene",
    "geometry",
    "flow",
    "points",
    "particles",
    "grid",
    "render",
    "output",
    "inspect",
    "error",
    "pipeline",
    "watch",
    "regress",
    "cli",
];

/// Stages whose files take typed values; only their `mod.rs`, and files of [`FROM_SCENE`], may know what a scene says.
const SCENE_BLIND: [&str; 8] = ["geometry", "flow", "points", "particles", "grid", "render", "output", "inspect"];

/// The folder of a stage that takes work off its `mod.rs`, where that would be long: it turns settings into values, and does
/// nothing else. A file for each kind of value.
const FROM_SCENE: &str = "from_scene/";

/// The only places for foreign code.
const UNSAFE: [&str; 3] = ["foreign.rs", "geometry/embree/", "output/oidn/"];

/// Names of drawers.
const DRAWERS: [&str; 6] = ["util", "common", "core", "types", "helpers", "misc"];

struct Source {
    /// Relative to `src`, with forward slashes.
    name: String,
    stage: String,
    /// Number from 1, text, and whether it belongs to the unit tests.
    lines: Vec<(usize, String, bool)>,
}

fn sources() -> Vec<Source> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    collect(&root, &mut files);
    files.sort();
    assert!(files.len() > 20, "the sources were not found");
    files.iter().map(|file| source(&root, file)).collect()
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
}

fn source(root: &Path, file: &Path) -> Source {
    let name = file.strip_prefix(root).unwrap().to_string_lossy().replace('\\', "/");
    let stage = name.split('/').next().unwrap().trim_end_matches(".rs").to_string();
    // A module of tests stands at the foot of its file, or in a file of that name.
    let mut in_tests = name.ends_with("/tests.rs");
    let mut after_marker = false;
    let mut lines = Vec::new();
    for (i, line) in fs::read_to_string(file).unwrap().lines().enumerate() {
        in_tests |= after_marker && line.contains("mod ") && line.ends_with('{');
        after_marker = line == "#[cfg(test)]";
        if !line.trim_start().starts_with("//") {
            lines.push((i + 1, line.to_string(), in_tests));
        }
    }
    Source { name, stage, lines }
}

/// Modules named after `crate::`, and inside `crate::{…}`, with the number of the line of the `crate::`. Lists may go on
/// over several lines and hold lists themselves.
fn crate_paths<'a>(lines: impl IntoIterator<Item = (usize, &'a str)>) -> Vec<(usize, String)> {
    let lines: Vec<(usize, &str)> = lines.into_iter().collect();
    let text = lines.iter().map(|(_, line)| *line).collect::<Vec<_>>().join("\n");
    let word = |text: &str| text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let mut found = Vec::new();
    // The stage that is a crate of its own has one name alone.
    let text = text.replace("curlsmoke_scene::", "crate::scene::");
    for (at, prefix) in text.match_indices("crate::") {
        // `$crate::` and `mycrate::` are not ours.
        let before = text[..at].chars().next_back();
        if before.is_some_and(|c| c.is_alphanumeric() || c == '_') {
            continue;
        }
        let number = lines[text[..at].matches('\n').count()].0;
        let rest = &text[at + prefix.len()..];
        match rest.strip_prefix('{') {
            Some(list) => found.extend(heads(list).iter().map(|part| (number, word(part)))),
            None => found.push((number, word(rest))),
        }
    }
    found.retain(|(_, module)| !module.is_empty());
    found
}

/// The entries of a list up to its closing brace, without the lists inside them.
fn heads(list: &str) -> Vec<String> {
    let mut parts = vec![String::new()];
    let mut depth = 0;
    for c in list.chars() {
        match c {
            '{' => depth += 1,
            '}' if depth == 0 => break,
            '}' => depth -= 1,
            ',' if depth == 0 => parts.push(String::new()),
            c if depth == 0 => parts.last_mut().unwrap().push(c),
            _ => {}
        }
    }
    parts.iter().map(|part| part.trim().to_string()).collect()
}

fn paths_of(source: &Source) -> Vec<(usize, String)> {
    crate_paths(source.lines.iter().map(|(number, line, _)| (*number, line.as_str())))
}

fn complain(problems: Vec<String>) {
    assert!(problems.is_empty(), "\n{}\n", problems.join("\n"));
}

#[test]
fn imports_point_left() {
    let rank = |module: &str| ORDER.iter().position(|known| *known == module);
    let mut problems = Vec::new();
    for source in sources() {
        let Some(own) = rank(&source.stage) else { continue };
        for (number, module) in paths_of(&source) {
            if rank(&module).is_some_and(|other| other > own) {
                problems.push(format!("src/{}:{number}: {} imports {module}, to its right", source.name, source.stage));
            }
        }
    }
    complain(problems);
}

#[test]
fn every_module_has_its_place_in_the_order() {
    let mut problems = Vec::new();
    for source in sources() {
        if !ORDER.contains(&source.stage.as_str()) && !["lib", "main"].contains(&source.stage.as_str()) {
            problems.push(format!("src/{}: where does `{}` stand in the order?", source.name, source.stage));
        }
        let parts = source.name.trim_end_matches(".rs").split('/');
        problems.extend(
            parts
                .filter(|part| DRAWERS.contains(part))
                .map(|part| format!("src/{}: `{part}` is a drawer", source.name)),
        );
    }
    complain(problems);
}

#[test]
fn only_mod_files_and_from_scene_know_the_scene() {
    let mut problems = Vec::new();
    for source in sources() {
        let stage = &source.stage;
        let may = source.name == format!("{stage}/mod.rs") || source.name.starts_with(&format!("{stage}/{FROM_SCENE}"));
        if !SCENE_BLIND.contains(&stage.as_str()) || may {
            continue;
        }
        for (number, _) in paths_of(&source).iter().filter(|(_, module)| module == "scene") {
            problems.push(format!(
                "src/{}:{number}: only {stage}/mod.rs and {stage}/{FROM_SCENE} may know the scene",
                source.name
            ));
        }
    }
    complain(problems);
}

#[test]
fn siblings_are_imported_by_their_full_name() {
    let mut problems = Vec::new();
    for source in sources() {
        for (number, line, in_tests) in &source.lines {
            if line.contains("super::") && !in_tests {
                problems.push(format!("src/{}:{number}: write crate::{}::… instead", source.name, source.stage));
            }
        }
    }
    complain(problems);
}

#[test]
fn unsafe_code_stays_with_the_foreign_libraries() {
    let mut problems = Vec::new();
    for source in sources().iter().filter(|s| !UNSAFE.iter().any(|place| s.name.starts_with(place))) {
        for (number, line, _) in &source.lines {
            let words = line.split(|c: char| !c.is_alphanumeric() && c != '_');
            if words.into_iter().any(|word| word == "unsafe" || word == "unsafe_code") && !line.contains("deny(") {
                problems.push(format!("src/{}:{number}: unsafe outside {UNSAFE:?}", source.name));
            }
        }
    }
    complain(problems);
}

#[test]
fn work_is_shared_out_in_one_place() {
    // The command line makes the pool; all else that names the library is compiled once more for each type it is used with.
    let places = ["math/parallel.rs", "cli/frames.rs"];
    let mut problems = Vec::new();
    for source in sources().iter().filter(|s| !places.contains(&s.name.as_str())) {
        for (number, _, _) in source.lines.iter().filter(|(_, line, in_tests)| line.contains("rayon::") && !in_tests) {
            problems.push(format!("src/{}:{number}: rayon outside {places:?}", source.name));
        }
    }
    complain(problems);
}

#[test]
fn only_the_command_line_prints() {
    const PRINTING: [&str; 7] = ["println!", "eprintln!", "print!", "eprint!", "dbg!", "stdout()", "stderr()"];
    let mut problems = Vec::new();
    for source in sources().iter().filter(|s| s.stage != "cli" && s.stage != "main") {
        for (number, line, in_tests) in &source.lines {
            if let Some(what) = PRINTING.iter().find(|p| line.contains(*p)).filter(|_| !in_tests) {
                problems.push(format!("src/{}:{number}: {what} outside cli/ and main.rs", source.name));
            }
        }
    }
    complain(problems);
}

#[test]
fn the_reader_of_imports_sees_all_spellings() {
    let modules = |text: &str| -> Vec<(usize, String)> {
        crate_paths(text.lines().enumerate().map(|(i, line)| (i + 1, line))).into_iter().collect()
    };
    let named = |text: &str| modules(text).into_iter().map(|(_, module)| module).collect::<Vec<_>>();
    assert_eq!(named("use crate::math::hash::Seed;"), ["math"]);
    assert_eq!(named("use crate::{math::hash, scene};"), ["math", "scene"]);
    assert_eq!(
        named("use crate::{\n    math::{hash, lattice},\n    scene,\n};\nuse std::{fs, io};"),
        ["math", "scene"]
    );
    assert_eq!(named("    let x: crate::grid::Grid = crate::flow::f();"), ["grid", "flow"]);
    assert_eq!(modules("\n\nuse crate::{\n    cli,\n};"), [(3, "cli".to_string())]);
    assert!(named("use othercrate::math;").is_empty());
}
