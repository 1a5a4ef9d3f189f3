//! Every scene in `tests/invalid` is refused, with exactly the problems that its first lines name:
//!
//! ```text
//! # error: LINE:COLUMN part of the message
//! # warning: LINE:COLUMN part of the message
//! # help: LINE:COLUMN part of a help text of a problem there
//! # fault: missing_file          (or over_memory_limit; invalid if not given)
//! ```
//!
//! Mutations of a valid scene never bring the parser down.

use curlsmoke::scene::diagnostic::{Diagnostic, Fault, Severity};
use curlsmoke::scene::{Scene, SceneError};
use proptest::prelude::*;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A scene with every kind of thing in it.
const VALID: &str = include_str!("invalid/valid.txt");

struct Expectation {
    severity: Severity,
    place: String,
    part: String,
}

fn expectations(text: &str) -> (Vec<Expectation>, Fault) {
    let mut expected = Vec::new();
    let mut fault = Fault::Invalid;
    for line in text.lines() {
        let of = |severity, rest: &str| {
            let (place, part) = rest.trim().split_once(' ').expect("`LINE:COLUMN message`");
            Expectation { severity, place: place.into(), part: part.into() }
        };
        if let Some(rest) = line.strip_prefix("# error:") {
            expected.push(of(Severity::Error, rest));
        } else if let Some(rest) = line.strip_prefix("# warning:") {
            expected.push(of(Severity::Warning, rest));
        } else if let Some(name) = line.strip_prefix("# fault:") {
            fault = match name.trim() {
                "missing_file" => Fault::MissingFile,
                "over_memory_limit" => Fault::OverMemoryLimit,
                other => panic!("unknown fault `{other}`"),
            };
        }
    }
    (expected, fault)
}

/// Places and parts of help texts that a scene's first lines name.
fn expected_help(text: &str) -> Vec<(&str, &str)> {
    let lines = text.lines().filter_map(|line| line.strip_prefix("# help:"));
    lines.map(|rest| rest.trim().split_once(' ').expect("`LINE:COLUMN help`")).collect()
}

fn fits(expectation: &Expectation, found: &Diagnostic) -> bool {
    let position = found.position.expect("a scene without overrides has positions");
    expectation.severity == found.severity
        && expectation.place == format!("{}:{}", position.line, position.column)
        && found.message.contains(&expectation.part)
}

/// What is wrong with the reaction to a file, or nothing.
fn verdict(path: &Path) -> Result<(), String> {
    let bytes = std::fs::read(path).unwrap();
    let (expected, fault) = expectations(&String::from_utf8_lossy(&bytes));
    if !expected.iter().any(|e| e.severity == Severity::Error) {
        return Err("names no error that it should give".into());
    }
    let begin = Instant::now();
    let error = match Scene::load(path) {
        Ok(_) => return Err("is accepted".into()),
        Err(error) => error,
    };
    // Generous: a hostile file may not keep anyone waiting, but the machine may be busy.
    if begin.elapsed() > Duration::from_secs(5) {
        return Err(format!("takes {:?}", begin.elapsed()));
    }
    let found = error.diagnostics();
    let printed = found.iter().map(|d| format!("\n{d}")).collect::<String>();
    for e in &expected {
        if !found.iter().any(|d| fits(e, d)) {
            return Err(format!("lacks `{} {}`; found:{printed}", e.place, e.part));
        }
    }
    for d in found {
        if !expected.iter().any(|e| fits(e, d)) {
            return Err(format!("gives a problem that it does not name:\n{d}"));
        }
    }
    for (place, part) in expected_help(&String::from_utf8_lossy(&bytes)) {
        let is_there = |d: &&Diagnostic| d.position.is_some_and(|p| format!("{}:{}", p.line, p.column) == place);
        if !found.iter().filter(is_there).flat_map(|d| &d.help).any(|help| help.contains(part)) {
            return Err(format!("lacks the help `{place} {part}`; found:{printed}"));
        }
    }
    if expected.len() != found.len() {
        return Err(format!("names {} problems, gives {}:{printed}", expected.len(), found.len()));
    }
    if error.fault() != fault {
        return Err(format!("is a fault {:?}, not {fault:?}", error.fault()));
    }
    Ok(())
}

#[test]
fn invalid_scenes_give_exactly_the_errors_they_name() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/invalid");
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut paths: Vec<PathBuf> = entries.filter(|path| path.extension().is_some_and(|e| e == "yaml")).collect();
    paths.sort();
    assert!(paths.len() >= 40, "only {} scenes", paths.len());
    let failures: Vec<String> =
        paths.iter().filter_map(|path| Some(format!("{} {}", path.display(), verdict(path).err()?))).collect();
    assert!(failures.is_empty(), "{} of {} scenes:\n\n{}", failures.len(), paths.len(), failures.join("\n\n"));
}

#[test]
fn a_file_without_an_expectation_fails() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bare.yaml");
    std::fs::write(&path, "version: 2\n").unwrap();
    assert!(verdict(&path).unwrap_err().contains("names no error"));
    std::fs::write(&path, "# error: 1:1 wrong place\nversion: 2\n").unwrap();
    assert!(verdict(&path).unwrap_err().contains("lacks"));
    let camera = "camera: {position: [0, 1, 5m], look_at: [0, 1, 0]}\nlights: [{environment: {radiance: [1, 1, 1]}}]\n";
    let text = |part: &str| format!("# error: 4:27 number\n# help: 4:27 {part}\nversion: 1\n{camera}");
    std::fs::write(&path, text("write `5`")).unwrap();
    verdict(&path).unwrap();
    std::fs::write(&path, text("write `6`")).unwrap();
    assert!(verdict(&path).unwrap_err().contains("lacks the help"));
}

#[test]
fn the_valid_scene_is_valid() {
    let scene = Scene::from_text(VALID, Path::new("tests/invalid/valid.yaml")).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(scene.name(), "valid");
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
}

#[test]
fn bare_files() {
    let load = |bytes: &[u8]| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.yaml");
        std::fs::write(&path, bytes).unwrap();
        Scene::load(&path).unwrap_err()
    };
    for bytes in [&b""[..], b"\n\n", b"\xef\xbb\xbf", b"\xff\xfe\0\0", b"\0", &[0x80; 10]] {
        let error = load(bytes);
        assert_eq!((error.diagnostics().len(), error.fault()), (1, Fault::Invalid), "{error}");
    }
    assert!(matches!(load(&vec![b'#'; 5 << 20]), SceneError::Unreadable { .. }));
    let missing = Scene::load(Path::new("tests/invalid/valid.tx")).unwrap_err();
    assert_eq!(missing.fault(), Fault::MissingFile);
    assert!(missing.to_string().contains("did you mean valid.txt?"), "{missing}");
    assert!(matches!(Scene::load(Path::new("tests")).unwrap_err(), SceneError::Unreadable { .. }));
    // A device without end.
    assert!(matches!(Scene::load(Path::new("/dev/zero")).unwrap_err(), SceneError::Unreadable { .. }));
}

#[test]
fn diagnostics_are_data_too() {
    let error = Scene::from_text("version: 7\n", Path::new("s.yaml")).unwrap_err();
    let json = serde_json::to_value(error.diagnostics()).unwrap();
    let version = json.as_array().unwrap().iter().find(|d| d["key"] == "version").unwrap();
    assert_eq!(version["severity"], "error");
    assert_eq!(version["position"]["line"], 1);
    assert_eq!(version["position"]["column"], 10);
}

#[test]
fn overrides() {
    let load = |pairs: &[(&str, &str)]| {
        let pairs: Vec<_> = pairs.iter().map(|(k, v)| (k.to_string(), v.to_string())).collect();
        Scene::from_text_with(VALID, Path::new("tests/invalid/valid.yaml"), &pairs)
    };
    let scene = load(&[
        ("film.resolution", "[32, 18]"),
        ("shapes.ball.sphere.radius", "0.25"),
        ("flow.potentials[1].noise.gain", "0.5"),
        ("render.lock_seed", "true"),
    ])
    .unwrap();
    assert_eq!(scene.settings.film.resolution, [32, 18]);
    assert_eq!(scene.settings.shapes["ball"].sphere.as_ref().unwrap().radius, 0.25);
    assert!(scene.settings.render.lock_seed);
    assert_ne!(scene.text_hash, load(&[]).unwrap().text_hash);
    assert!(scene.place("shapes.ball.sphere.radius").position.is_none());
    for (key, value, part) in [
        ("film.sp", "3", "unknown key `sp`"),
        ("film.spp", "many", "expected a whole number"),
        ("film.spp", "0", "must be from 1"),
        ("camera.position", "", "found nothing"),
        ("film.spq", "", "unknown key `spq`"),
        ("film.spp", "[", "not YAML"),
        ("lights[7].sun", "{}", "no item 7"),
        ("film.spp.x", "1", "single value"),
        ("flow.obstacles", "[nobody]", "there is no shape `nobody`"),
    ] {
        let error = load(&[(key, value)]).unwrap_err();
        let flag = format!("--set {key}");
        let found = error.diagnostics().iter().any(|d| d.file == flag && d.message.contains(part));
        assert!(found, "{key}={value}: {error}");
    }
}

#[test]
fn an_empty_override_is_a_key_left_out() {
    let load = |pairs: &[(&str, &str)]| {
        let pairs: Vec<_> = pairs.iter().map(|(k, v)| (k.to_string(), v.to_string())).collect();
        let moving = VALID.replace(
            "sphere: {center: [0, 1.2, 0], radius: 0.35}",
            "sphere: {center: [0, 1.2, 0], radius: 0.35}\n    motion: {keys: [{time: 0}, {time: 1, translate: [0, 1, 0]}]}",
        );
        Scene::from_text_with(&moving, Path::new("tests/invalid/valid.yaml"), &pairs).unwrap_or_else(|e| panic!("{e}"))
    };
    let as_written = load(&[]).settings;
    assert!(as_written.output.preview.is_some() && as_written.shapes["ball"].motion.is_some());
    for empty in ["", "null", "~"] {
        let settings = load(&[
            ("output.preview", empty),
            ("shapes.ball.motion", empty),
            ("film.spp", empty),
            ("smoke.seed", empty),
        ]);
        let settings = settings.settings;
        assert_eq!((settings.output.preview, settings.film.spp), (None, 128), "`{empty}`");
        assert!(settings.shapes["ball"].motion.is_none(), "`{empty}`");
    }
}

#[test]
fn voxels_larger_than_the_smoke_s_source_are_warned_of() {
    let warnings = |voxel_size: f64, emitter: &str| {
        let text = format!(
            "version: 1\ncamera: {{position: [0, 1, 5], look_at: [0, 1, 0]}}\nlights: [{{environment: {{radiance: [1, 1, \
             1]}}}}]\nsmoke:\n  emitters: [{{{emitter}, rate: 1000, lifetime: 2, start: -2}}]\n  grid: {{voxel_size: {voxel_size}}}\n"
        );
        Scene::from_text(&text, Path::new("s.yaml")).unwrap_or_else(|e| panic!("{e}")).warnings
    };
    for emitter in [
        "disk: {center: [0, 1, 0], radius: 0.35}",
        "sphere: {center: [0, 1, 0], radius: 0.35}",
        "box: {center: [0, 1, 0], size: [0.7, 0.1, 0.1]}",
    ] {
        let found = warnings(2.5, emitter);
        assert_eq!((found.len(), found[0].key.as_str()), (1, "smoke.grid.voxel_size"), "{found:?}");
        assert!(found[0].message.contains("2.5 m") && found[0].help[0].contains("0.07"), "{}", found[0]);
        assert!(warnings(0.6, emitter).is_empty(), "{emitter}");
    }
    assert!(warnings(2.5, "point: {position: [0, 1, 0]}").is_empty());
}

#[test]
fn positions_of_settings() {
    let scene = Scene::from_text(VALID, Path::new("s.yaml"));
    // The mesh is relative to the folder of the scene, so it is missing here.
    assert_eq!(scene.unwrap_err().fault(), Fault::MissingFile);
    let scene = Scene::from_text(VALID, Path::new("tests/invalid/valid.yaml")).unwrap();
    let line = VALID.lines().position(|l| l.contains("file: tetrahedron.obj")).unwrap() as u32 + 1;
    assert_eq!(scene.place("shapes.solid.mesh.file").position.unwrap().line, line);
    assert_eq!(scene.resolve("tetrahedron.obj"), Path::new("tests/invalid/tetrahedron.obj"));
}

/// Texts that are likely to upset a parser.
const SPLICES: &[&str] = &[
    "\t",
    "\n",
    ": ",
    "- ",
    "[",
    "]",
    "{",
    "}",
    "&a ",
    "*a",
    "<<: *a",
    "!!int ",
    "!foo ",
    "|",
    ">",
    "'",
    "\"",
    "#",
    "%",
    "@",
    "`",
    "---\n",
    "...\n",
    ".nan",
    ".inf",
    "-.inf",
    "1e999",
    "-1",
    "0",
    "99999999999999999999999",
    "~",
    "null",
    "true",
    "? ",
    "\u{0}",
    "\u{feff}",
    "ä",
    "\r\n",
    "&a [*a]",
    "{a: {a: {a: {}}}}",
    "[[[[[[[[[[",
    "type: sphere",
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn mutated_scenes_never_panic(
        edits in proptest::collection::vec((any::<prop::sample::Index>(), 0usize..3, any::<prop::sample::Index>(), 1usize..12), 1..6),
        flag in any::<prop::sample::Index>(),
    ) {
        let mut text: Vec<char> = VALID.chars().collect();
        for (at, kind, splice, length) in edits {
            let at = at.index(text.len() + 1);
            match kind {
                0 => drop(text.drain(at..(at + length).min(text.len()))),
                1 => drop(text.splice(at..at, splice.get(SPLICES).chars())),
                _ => {
                    let copied: Vec<char> = text[at..(at + 4 * length).min(text.len())].to_vec();
                    drop(text.splice(at..at, copied));
                }
            }
        }
        let text: String = text.into_iter().collect();
        let path = Path::new("tests/invalid/valid.yaml");
        for overrides in [vec![], vec![("film.spp".to_owned(), flag.get(SPLICES).to_string())]] {
            match Scene::from_text_with(&text, path, &overrides) {
                Ok(scene) => prop_assert!(scene.settings.version == 1),
                Err(error) => {
                    prop_assert!(!error.diagnostics().is_empty());
                    prop_assert!(error.to_string().contains("error"));
                }
            }
        }
    }
}
