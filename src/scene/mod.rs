//! What a scene file says, as plain data.
//!
//! Text becomes a tree that knows the place of every value (`tree`), the tree is held against the schema (`conform`),
//! and what fits it against its own meaning (`validate`). All problems are reported together, each at its line.

pub mod conform;
pub mod diagnostic;
pub mod footprint;
pub mod pattern;
pub mod reference;
pub mod schema;
pub mod settings;
pub mod suite;
pub mod tree;
pub mod unit;
pub mod validate;
mod validate_flow;
mod validate_light;
mod validate_material;
mod validate_shape;
mod validate_smoke;
mod validate_suite;
mod validate_volume;

use crate::conform::conform;
use crate::diagnostic::{Collector, Diagnostic, Fault, Place, Position, Severity, Source, nearest};
use crate::settings::Settings;
use crate::tree::{Node, Value};
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Largest scene file [bytes].
const FILE_SIZE_MAX: u64 = 4 << 20;

/// A scene without errors.
#[derive(Debug, Clone)]
pub struct Scene {
    /// What it says.
    pub settings: Settings,
    /// The file; relative names in the scene start from its folder.
    pub path: PathBuf,
    /// SHA-256 of the file's text and of all overrides, in hexadecimal.
    pub text_hash: String,
    /// SHA-256 of the file alone, in hexadecimal.
    pub file_hash: String,
    /// Keys that were set besides, and to what.
    pub overrides: Vec<(String, String)>,
    /// What is likely a mistake, but well defined.
    pub warnings: Vec<Diagnostic>,
    tree: Node,
    name: String,
}

/// Why there is no scene.
#[derive(Debug, Error)]
pub enum SceneError {
    /// The scene file is not there.
    #[error("{}: error: no such file{}", path.display(), nearest.as_ref().map(|n| format!("; did you mean {n}?")).unwrap_or_default())]
    NotFound {
        /// The file.
        path: PathBuf,
        /// A file of a similar name in the same folder.
        nearest: Option<String>,
    },
    /// The scene file cannot be read.
    #[error("{}: error: cannot be read: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The scene has errors.
    #[error("{}", printed(.0))]
    Faulty(
        /// All errors and warnings, in the order of the file.
        Vec<Diagnostic>,
    ),
}

impl SceneError {
    /// The worst sort of fault: `Invalid`, else `MissingFile`, else `OverMemoryLimit`.
    pub fn fault(&self) -> Fault {
        let has = |fault| self.diagnostics().iter().any(|d| d.severity == Severity::Error && d.fault == fault);
        match self {
            Self::NotFound { .. } => Fault::MissingFile,
            Self::Unreadable { .. } => Fault::Invalid,
            Self::Faulty(_) if has(Fault::Invalid) => Fault::Invalid,
            Self::Faulty(_) if has(Fault::MissingFile) => Fault::MissingFile,
            Self::Faulty(_) => Fault::OverMemoryLimit,
        }
    }

    /// All problems inside the scene; none if the file itself could not be read.
    pub fn diagnostics(&self) -> &[Diagnostic] {
        match self {
            Self::Faulty(diagnostics) => diagnostics,
            _ => &[],
        }
    }
}

/// Diagnostics as text, with their number at the end.
fn printed(diagnostics: &[Diagnostic]) -> String {
    let mut text = String::new();
    for diagnostic in diagnostics {
        // Writing to a String cannot fail.
        let _ = write!(text, "{diagnostic}\n\n");
    }
    let count = diagnostics.iter().filter(|d| d.severity == Severity::Error).count();
    let warnings = diagnostics.len() - count;
    let _ = write!(text, "{count} error{}", if count == 1 { "" } else { "s" });
    if warnings > 0 {
        let _ = write!(text, ", {warnings} warning{}", if warnings == 1 { "" } else { "s" });
    }
    text
}

impl Scene {
    /// Reads a scene file.
    ///
    /// # Errors
    /// The file is missing or unreadable, or has errors; all of them are in the error.
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        Self::load_with(path, &[])
    }

    /// Reads a scene file and sets some of its keys: pairs of a key path such as `lights[0].sun.direction` and a value
    /// in YAML.
    ///
    /// # Errors
    /// As `load`; problems in an override name it as `--set KEY`.
    pub fn load_with(path: &Path, overrides: &[(String, String)]) -> Result<Self, SceneError> {
        Self::load_for(path, overrides, None)
    }

    /// As `load_with`, to make some of its frames alone: files of other frames need not be there. All frames where `None`.
    ///
    /// # Errors
    /// As `load_with`.
    pub fn load_for(path: &Path, overrides: &[(String, String)], frames: Option<&[i32]>) -> Result<Self, SceneError> {
        Self::from_text_for(&read_text(path)?, path, overrides, frames)
    }

    /// Reads a scene from text; `path` names it in messages, and relative files start from its folder.
    ///
    /// # Errors
    /// All errors of the scene.
    pub fn from_text(text: &str, path: &Path) -> Result<Self, SceneError> {
        Self::from_text_with(text, path, &[])
    }

    /// As `from_text`, with overrides as in `load_with`.
    ///
    /// # Errors
    /// All errors of the scene.
    pub fn from_text_with(text: &str, path: &Path, overrides: &[(String, String)]) -> Result<Self, SceneError> {
        Self::from_text_for(text, path, overrides, None)
    }

    fn from_text_for(
        text: &str,
        path: &Path,
        overrides: &[(String, String)],
        frames: Option<&[i32]>,
    ) -> Result<Self, SceneError> {
        let mut sources = vec![file_source(path, text.to_owned())];
        for (key, value) in overrides {
            sources.push(Source { name: format!("--set {key}"), text: value.clone(), is_flag: true });
        }
        let mut collector = Collector::new(&sources);
        let Some(mut tree) = parsed(text, 0, "", &mut collector) else {
            return Err(SceneError::Faulty(collector.finish()));
        };
        for (index, (key, value)) in overrides.iter().enumerate() {
            apply_override(&mut tree, key, value, index + 1, &mut collector);
        }
        let conformed = conform(&tree, &marked_schema(), &mut collector);
        let settings = match serde_json::from_value::<Settings>(conformed.settings) {
            Ok(settings) => settings,
            Err(error) => {
                collector.error(Place::START, "", error.to_string());
                return Err(SceneError::Faulty(collector.finish()));
            }
        };
        validate::validate(&settings, &tree, &conformed.mended, &conformed.keyed, path, frames, &mut collector);
        let diagnostics = collector.finish();
        if diagnostics.iter().any(|d| d.severity == Severity::Error) {
            return Err(SceneError::Faulty(diagnostics));
        }
        let name = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        Ok(Self {
            settings,
            path: path.into(),
            text_hash: hash(text, overrides),
            file_hash: hexadecimal(&Sha256::digest(text)),
            overrides: overrides.to_vec(),
            warnings: diagnostics,
            tree,
            name,
        })
    }

    /// A file that the scene names, from the scene's folder if it is relative.
    pub fn resolve(&self, relative: &str) -> PathBuf {
        resolve(&self.path, relative)
    }

    /// Name of the scene: that of its file without the ending.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Where the value of a key path such as `shapes.ball.mesh.file` is written, or the nearest enclosing key that is,
    /// if the value is a default.
    pub fn place(&self, key_path: &str) -> PlaceInScene {
        let place = self.tree.place_of(key_path);
        let position = (place.source_idx == 0).then_some(place.position);
        PlaceInScene { path: self.path.clone(), position, key: key_path.into() }
    }
}

/// Where in a scene file something is said: `FILE:LINE:COLUMN: KEY: `.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaceInScene {
    /// The scene file.
    pub path: PathBuf,
    /// Where in it; none for what the command line said.
    pub position: Option<Position>,
    /// The key.
    pub key: String,
}

impl std::fmt::Display for PlaceInScene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:", self.path.display())?;
        if let Some(Position { line, column }) = self.position {
            write!(f, "{line}:{column}:")?;
        }
        write!(f, " {}: ", self.key)
    }
}

/// The JSON Schema of scene files, for editors.
pub fn schema_json() -> serde_json::Value {
    let mut schema = marked_schema();
    let interpolation = schema["$defs"]["Interpolation"].clone();
    if let Some(members) = schema.as_object_mut() {
        members.remove(schema::KEY_OPTIONS);
    }
    schema::spell_out_keys(&mut schema, &interpolation);
    schema
}

/// The schema as scenes are held against it: values that may be given for several frames are marked.
pub(crate) fn marked_schema() -> serde_json::Value {
    let mut schema = schemars::schema_for!(Settings).to_value();
    schema[schema::KEY_OPTIONS] = serde_json::json!({
        "interpolation": { "$ref": "#/$defs/Interpolation" },
        "repeat": { "type": "boolean" },
    });
    schema
}

/// A file that a scene names, from the folder of the scene if it is relative.
pub(crate) fn resolve(scene: &Path, relative: &str) -> PathBuf {
    scene.parent().unwrap_or(Path::new("")).join(relative)
}

/// A file of a similar name in the same folder.
pub(crate) fn nearest_file(path: &Path) -> Option<String> {
    /// Names looked at; a folder may hold a million frames.
    const ENTRY_COUNT_MAX: usize = 10_000;
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder).ok()?.take(ENTRY_COUNT_MAX).filter_map(Result::ok);
    let mut names: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.sort();
    nearest(&path.file_name()?.to_string_lossy(), names.iter().map(String::as_str)).map(str::to_owned)
}

fn file_source(path: &Path, text: String) -> Source {
    Source { name: path.display().to_string(), text, is_flag: false }
}

fn read(path: &Path) -> Result<Vec<u8>, SceneError> {
    let unreadable = |source: std::io::Error| match source.kind() {
        std::io::ErrorKind::NotFound => SceneError::NotFound { path: path.into(), nearest: nearest_file(path) },
        _ => SceneError::Unreadable { path: path.into(), source },
    };
    let mut bytes = Vec::new();
    // One byte more than allowed, so that a file that is too long shows; sizes of devices cannot be asked for.
    File::open(path).and_then(|file| file.take(FILE_SIZE_MAX + 1).read_to_end(&mut bytes)).map_err(unreadable)?;
    if bytes.len() as u64 > FILE_SIZE_MAX {
        let text = format!("longer than {} MiB, the most that a scene file may have", FILE_SIZE_MAX >> 20);
        let source = std::io::Error::new(std::io::ErrorKind::FileTooLarge, text);
        return Err(SceneError::Unreadable { path: path.into(), source });
    }
    Ok(bytes)
}

/// The text of a file, which must be UTF-8.
fn read_text(path: &Path) -> Result<String, SceneError> {
    String::from_utf8(read(path)?).map_err(|error| {
        let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let valid = String::from_utf8_lossy(valid).into_owned();
        let line = valid.split('\n').count();
        let column = valid.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
        let position = Position { line: line as u32, column: column as u32 };
        let sources = [file_source(path, valid)];
        let mut collector = Collector::new(&sources);
        let place = Place { source_idx: 0, position, length: 1 };
        collector.error(place, "", "this byte is not UTF-8").help("save the file as UTF-8 text");
        SceneError::Faulty(collector.finish())
    })
}

fn parsed(text: &str, source_idx: usize, key: &str, collector: &mut Collector<'_>) -> Option<Node> {
    match tree::parse(text, source_idx) {
        Ok(node) => Some(node),
        Err(error) => {
            collector.error(error.place, key, error.message).help.extend(error.help);
            None
        }
    }
}

fn apply_override(tree: &mut Node, key: &str, value: &str, source_idx: usize, collector: &mut Collector<'_>) {
    let place = Place { source_idx, position: Place::START.position, length: value.chars().count().max(1) };
    let Some(mut node) = parsed(value, source_idx, key, collector) else { return };
    if node.place.length == 0 && node.value == Value::Null {
        // Nothing has no length, and the key in the file would be blamed.
        node.place = place;
    }
    if let Err(message) = tree.set(key, node, place) {
        collector.error(place, key, message);
    }
}

fn hash(text: &str, overrides: &[(String, String)]) -> String {
    let mut hasher = Sha256::new();
    let mut part = |bytes: &[u8]| {
        hasher.update((bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    part(text.as_bytes());
    for (key, value) in overrides {
        part(key.as_bytes());
        part(value.as_bytes());
    }
    hexadecimal(&hasher.finalize())
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut hex, byte| {
        // Writing to a String cannot fail.
        let _ = write!(hex, "{byte:02x}");
        hex
    })
}
