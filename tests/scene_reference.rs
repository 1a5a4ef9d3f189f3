//! `docs/scene.md` holds the reference that the schema gives, and an example that is a valid scene.
//!
//! After a change of `src/scene/settings.rs`: `BLESS=1 cargo test --test scene_reference`.

use curlsmoke::scene::Scene;
use curlsmoke::scene::reference::reference_markdown;
use std::path::Path;

/// What follows this line is generated.
const MARKER: &str = "<!-- Generated from src/scene/settings.rs by `BLESS=1 cargo test --test scene_reference`. -->\n";

fn page() -> (std::path::PathBuf, String) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/scene.md");
    let text = std::fs::read_to_string(&path).unwrap();
    (path, text)
}

#[test]
fn the_reference_is_up_to_date() {
    let (path, text) = page();
    let (by_hand, generated) = text.split_once(MARKER).expect("docs/scene.md has lost its marker");
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&path, format!("{by_hand}{MARKER}{}", reference_markdown())).unwrap();
        return;
    }
    assert!(generated == reference_markdown(), "out of date; run BLESS=1 cargo test --test scene_reference");
}

#[test]
fn the_examples_are_valid() {
    let (_, text) = page();
    let blocks: Vec<&str> = text.split("```yaml\n").skip(1).filter_map(|rest| rest.split("```").next()).collect();
    let scenes: Vec<&&str> = blocks.iter().filter(|block| block.contains("version: 1")).collect();
    assert!(!scenes.is_empty());
    for scene in scenes {
        let scene = Scene::from_text(scene, Path::new("docs/example.yaml")).unwrap_or_else(|error| panic!("{error}"));
        assert!(scene.warnings.is_empty(), "{}", scene.warnings[0]);
    }
}
