//! Suites of image tests: which pictures are made, what they are compared with, and how.
//!
//! A suite is read as a scene is: held against the schema of the structs below, all problems at once, each at its line.

use crate::conform::conform_document;
use crate::diagnostic::{Collector, Diagnostic, Severity, nearest};
use crate::validate_suite::validate_suite;
use crate::{SceneError, file_source, parsed, read_text, resolve};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What stands for a case's name in the names of references and pictures.
pub const CASE_PLACEHOLDER: &str = "{case}";
/// Paths of a picture whose case does not say how many a pixel has.
pub const PATHS_DEFAULT: u32 = 4_000_000;

/// What stands in a command for the file that it shall write.
pub const OUTPUT_PLACEHOLDER: &str = "{output}";
/// What stands in a command for the seed of its random numbers.
pub const SEED_PLACEHOLDER: &str = "{seed}";

/// A whole suite file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SuiteSettings {
    /// Version of the suite format: 1.
    #[schemars(range(min = 1, max = 1))]
    pub version: u32,
    /// A text file to which `--update` adds why references were remade, .md or .txt. Default references.md.
    #[serde(default = "log_name")]
    pub log: String,
    /// What holds for every case that does not say otherwise.
    #[serde(default)]
    pub defaults: CaseDefaults,
    /// The cases by name. Files in them are relative to the folder of the suite.
    pub cases: BTreeMap<String, Case>,
}

fn log_name() -> String {
    "references.md".into()
}

/// What holds for every case that does not say otherwise.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CaseDefaults {
    /// The reference, .exr; `{case}` stands for the name of the case. Default {case}.mean.exr.
    pub reference: Option<String>,
    /// The frame of the scene. Default the first of the scene.
    #[schemars(range(min = -100000, max = 1000000))]
    pub frame: Option<i32>,
    /// Paths traced through each pixel. Default as many as make four million in the picture, what finds a change of a per cent.
    #[schemars(range(min = 2, max = 16777216))]
    pub spp: Option<u32>,
    /// Seed of the light; another one than that of references. Default 17.
    pub seed: Option<u64>,
    /// Settings of the scene to change, as `film.resolution=[64, 36]`. Those of a case come after these.
    pub set: Vec<String>,
    /// How pictures are compared. Default `stat` for every layer.
    pub compare: Option<Vec<Check>>,
    /// Layers that are not compared and may be missing.
    pub ignore: Option<Vec<String>>,
    /// How `--update` makes references.
    pub remake: Option<Remake>,
}

/// One picture, and what it should look like.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Case {
    /// The scene to render. Exactly one of `scene`, `image` and `command` is needed.
    #[serde(default)]
    pub scene: Option<String>,
    /// A picture that another program has made, .exr, .hdr or .png; `{case}` stands for the name of the case.
    #[serde(default)]
    pub image: Option<String>,
    /// A line for the shell that makes the picture: it writes the .exr file `{output}`, if it can with the random numbers `{seed}`.
    /// Runs in the folder of the suite, and only with `--run-commands`.
    #[serde(default)]
    pub command: Option<String>,
    /// Settings of the scene to change, as `smoke.medium.extinction=10.1`.
    #[serde(default)]
    pub set: Vec<String>,
    /// The frame of the scene. Default the first of the scene.
    #[serde(default)]
    #[schemars(range(min = -100000, max = 1000000))]
    pub frame: Option<i32>,
    /// Paths traced through each pixel. Default as many as make four million in the picture, what finds a change of a per cent.
    #[serde(default)]
    #[schemars(range(min = 2, max = 16777216))]
    pub spp: Option<u32>,
    /// Seed of the light; another one than that of references. Default 17.
    #[serde(default)]
    pub seed: Option<u64>,
    /// The reference, .exr; `{case}` stands for the name of the case. Default {case}.mean.exr.
    #[serde(default)]
    pub reference: Option<String>,
    /// The variance of the reference's mean, .exr. Default X.var.exr beside X.mean.exr, or the layers `variance` of the reference.
    #[serde(default)]
    pub variance: Option<String>,
    /// How the pictures are compared, instead of those of `defaults`.
    #[serde(default)]
    pub compare: Option<Vec<Check>>,
    /// Layers that are not compared and may be missing, instead of those of `defaults`.
    #[serde(default)]
    pub ignore: Option<Vec<String>>,
    /// The pictures must differ: the case fails where they agree. `--update` leaves its reference alone. Default false.
    #[serde(default)]
    pub should_fail: bool,
    /// How `--update` makes the reference, instead of that of `defaults`.
    #[serde(default)]
    pub remake: Option<Remake>,
}

/// How `--update` makes a reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Remake {
    /// Pictures that are made, each of its own seed. From two on the variance is that between them, of every layer; of one it is
    /// what the picture says in its layers `variance`. Default 1.
    #[schemars(range(min = 1, max = 10000))]
    pub runs: u32,
    /// Paths traced through each pixel of each of them. Default 16 times those of the case with one run, else as many.
    #[schemars(range(min = 2, max = 16777216))]
    pub spp: Option<u32>,
    /// Seed of the first; the others follow. Default 1000003.
    pub seed: u64,
}

impl Default for Remake {
    fn default() -> Self {
        Self { runs: 1, spp: None, seed: 1_000_003 }
    }
}

/// A way to compare layers. The colours R, G and B without a name are the layer `beauty`; other channels are the layer
/// before their last dot, or of their own name: `A`, `Z`, `albedo`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Check {
    /// Same bits in every pixel.
    Exact(ExactCheck),
    /// Differences must be explained by the noise of both pictures.
    Stat(StatCheck),
    /// Mean of (a − b)².
    Mse(LimitCheck),
    /// Mean of (a − b)² / (b² + 0.01 m²), where b is the reference and m its mean.
    Relmse(LimitCheck),
    /// Largest |a − b|.
    Max(LimitCheck),
    /// 10 log₁₀(p² / MSE), where p is the largest value of the reference.
    Psnr(PsnrCheck),
    /// Mean of FLIP: what an observer sees who flips between the pictures, 0 to 1. For layers of three colours.
    Flip(FlipCheck),
}

impl Check {
    /// The layers that it is for; none are all that no other check names.
    pub fn layers(&self) -> &[String] {
        match self {
            Self::Exact(check) => &check.layers,
            Self::Stat(check) => &check.layers,
            Self::Mse(check) | Self::Relmse(check) | Self::Max(check) => &check.layers,
            Self::Psnr(check) => &check.layers,
            Self::Flip(check) => &check.layers,
        }
    }

    /// Its name in a suite.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Exact(_) => "exact",
            Self::Stat(_) => "stat",
            Self::Mse(_) => "mse",
            Self::Relmse(_) => "relmse",
            Self::Max(_) => "max",
            Self::Psnr(_) => "psnr",
            Self::Flip(_) => "flip",
        }
    }
}

/// Same bits.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ExactCheck {
    /// Layers. Default all that no other check names.
    pub layers: Vec<String>,
}

/// A test of hypotheses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StatCheck {
    /// Probability that equal light is called different in a layer. Default 0.01.
    #[schemars(range(min = 1e-9, max = 0.5))]
    pub alpha: f64,
    /// Pixels that must agree one by one [percent]. Default 99.75.
    #[schemars(range(min = 1.0, max = 99.9999))]
    pub pixels: f64,
    /// Layers. Default all that no other check names.
    pub layers: Vec<String>,
}

impl Default for StatCheck {
    fn default() -> Self {
        Self { alpha: 0.01, pixels: 99.75, layers: Vec::new() }
    }
}

/// A measure with an upper limit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LimitCheck {
    /// Largest value that is allowed.
    #[schemars(range(min = 0.0))]
    pub at_most: f64,
    /// Layers. Default all that no other check names.
    #[serde(default)]
    pub layers: Vec<String>,
}

/// The peak signal-to-noise ratio.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PsnrCheck {
    /// Smallest ratio that is allowed [dB].
    #[schemars(range(min = -1000.0, max = 1000.0))]
    pub at_least: f64,
    /// Layers. Default all that no other check names.
    #[serde(default)]
    pub layers: Vec<String>,
}

/// FLIP.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlipCheck {
    /// Largest mean that is allowed, 0 to 1.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub at_most: f64,
    /// Pixels in a degree of the observer's view. Default 67: a screen 0.7 m wide with 3840 pixels, from 0.7 m.
    #[serde(default = "pixels_per_degree")]
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub pixels_per_degree: f64,
    /// Pictures are what a screen shows (8 bits, as .png), not light: without tone mapping at several exposures. Default false.
    #[serde(default)]
    pub ldr: bool,
    /// Layers. Default all that no other check names.
    #[serde(default)]
    pub layers: Vec<String>,
}

/// 3840 pixels in 0.7 m, seen from 0.7 m.
fn pixels_per_degree() -> f64 {
    3840.0_f64.to_radians()
}

/// A suite without errors.
#[derive(Debug, Clone)]
pub struct Suite {
    /// What it says.
    pub settings: SuiteSettings,
    /// The file; names in the suite start from its folder.
    pub path: PathBuf,
    /// What is likely a mistake, but well defined.
    pub warnings: Vec<Diagnostic>,
}

impl Suite {
    /// Reads a suite file.
    ///
    /// # Errors
    /// The file is missing or unreadable, or has errors; all of them are in the error.
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        Self::from_text(&read_text(path)?, path)
    }

    /// Reads a suite from text; `path` names it in messages, and files start from its folder.
    ///
    /// # Errors
    /// All errors of the suite.
    pub fn from_text(text: &str, path: &Path) -> Result<Self, SceneError> {
        let sources = [file_source(path, text.to_owned())];
        let mut collector = Collector::new(&sources);
        let Some(tree) = parsed(text, 0, "", &mut collector) else {
            return Err(SceneError::Faulty(collector.finish()));
        };
        let conformed =
            conform_document(&tree, &suite_schema_json(), "begin with `version: 1` and `cases`", &mut collector);
        let settings = match serde_json::from_value::<SuiteSettings>(conformed.settings) {
            Ok(settings) => settings,
            Err(error) => {
                collector.error(tree.place_of(""), "", error.to_string());
                return Err(SceneError::Faulty(collector.finish()));
            }
        };
        // What was mended may look wrong in ways that nobody wrote.
        if conformed.mended.is_empty() {
            validate_suite(&settings, &tree, &mut collector);
        }
        let diagnostics = collector.finish();
        if diagnostics.iter().any(|d| d.severity == Severity::Error) {
            return Err(SceneError::Faulty(diagnostics));
        }
        Ok(Self { settings, path: path.into(), warnings: diagnostics })
    }

    /// A file that the suite names, from the suite's folder if it is relative.
    pub fn resolve(&self, relative: &str) -> PathBuf {
        resolve(&self.path, relative)
    }

    /// The cases with what `defaults` says, in the order of their names.
    pub fn cases(&self) -> impl Iterator<Item = (&str, Case)> {
        self.settings.cases.iter().map(|(name, case)| (name.as_str(), self.settings.whole(name, case)))
    }
}

impl SuiteSettings {
    /// A case with what `defaults` says where it says nothing itself, and with its name in the names of files.
    pub(crate) fn whole(&self, name: &str, case: &Case) -> Case {
        let defaults = &self.defaults;
        let named = |text: &String| text.replace(CASE_PLACEHOLDER, name);
        let reference = case.reference.as_ref().or(defaults.reference.as_ref()).map_or("{case}.mean.exr", |r| r);
        Case {
            scene: case.scene.as_ref().map(named),
            image: case.image.as_ref().map(named),
            set: defaults.set.iter().chain(&case.set).cloned().collect(),
            frame: case.frame.or(defaults.frame),
            spp: case.spp.or(defaults.spp),
            seed: case.seed.or(defaults.seed).or(Some(DEFAULT_SEED)),
            reference: Some(reference.replace(CASE_PLACEHOLDER, name)),
            variance: case.variance.as_ref().map(named),
            compare: case.compare.clone().or_else(|| defaults.compare.clone()),
            ignore: case.ignore.clone().or_else(|| defaults.ignore.clone()),
            remake: Some(case.remake.or(defaults.remake).unwrap_or_default()),
            ..case.clone()
        }
    }
}

/// Seed of tests that say nothing.
const DEFAULT_SEED: u64 = 17;

/// The JSON Schema of suite files, for editors.
pub fn suite_schema_json() -> serde_json::Value {
    schemars::schema_for!(SuiteSettings).to_value()
}

/// Key and value of a `set`.
pub fn parse_override(text: &str) -> Option<(String, String)> {
    let (key, value) = text.split_once('=')?;
    (!key.trim().is_empty()).then(|| (key.trim().to_string(), value.trim().to_string()))
}

/// The case whose name is most like one that does not exist.
pub fn nearest_case<'s>(suite: &'s Suite, typed: &str) -> Option<&'s str> {
    nearest(typed, suite.settings.cases.keys().map(String::as_str))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faults(text: &str) -> String {
        Suite::from_text(text, Path::new("s.yaml")).map(|_| String::new()).unwrap_or_else(|error| error.to_string())
    }

    #[test]
    fn cases_take_what_the_defaults_say() {
        let text = "version: 1\ndefaults: {spp: 8, reference: 'r/{case}.exr', set: [a.b=1], ignore: [A]}\ncases:\n  x: {scene: \
                    x.yaml, set: [c=2]}\n  y: {image: '{case}.exr', seed: 4, ignore: []}\n";
        let suite = Suite::from_text(text, Path::new("dir/s.yaml")).unwrap();
        let cases: Vec<(&str, Case)> = suite.cases().collect();
        let (x, y) = (&cases[0].1, &cases[1].1);
        assert_eq!((x.spp, x.seed, x.reference.as_deref()), (Some(8), Some(17), Some("r/x.exr")));
        assert_eq!(x.set, ["a.b=1", "c=2"]);
        assert_eq!((y.image.as_deref(), y.seed, y.ignore.as_deref()), (Some("y.exr"), Some(4), Some(&[][..])));
        assert_eq!(suite.resolve("r/x.exr"), Path::new("dir/r/x.exr"));
    }

    #[test]
    fn all_problems_come_at_once_with_their_places() {
        let text = "version: 1\ncases:\n  a: {scene: a.yaml, image: b.exr}\n  b:\n    command: render it\n    set: [nothing]\n  c: \
                    {scene: c.yaml, seed: 1000003}\n  d: {scene: d.yaml, compare: [exact: {layers: [rgb]}]}\n";
        let faults = faults(text);
        for expected in [
            "s.yaml:3:6: error: exactly one of",
            "s.yaml:5:14: error: the command does not say `{output}`",
            "s.yaml:6:10: error: `set` is for cases",
            "s.yaml:6:11: error: `nothing` sets nothing",
            "s.yaml:7:28: error: the seed of the test, 1000003, is one of the reference's",
            "the colours R, G and B are `beauty`",
        ] {
            assert!(faults.contains(expected), "{expected}\n{faults}");
        }
    }

    #[test]
    fn unknown_keys_and_bad_values_are_named() {
        let faults = faults("version: 1\ncases:\n  a: {scen: a.yaml, compare: [relmse: {at_most: -1}]}\n");
        assert!(faults.contains("did you mean `scene`") && faults.contains("must be at least 0"), "{faults}");
        assert!(super::tests::faults("").contains("begin with `version: 1` and `cases`"));
    }
}
