//! `curlsmoke wedge`.

use crate::cli::args::{InspectArguments, PictureArguments};
use crate::cli::frames::{list_of, overrides, start_threads};
use crate::cli::progress::{Reporter, Style};
use crate::cli::render::{Names, conclude, crop_of, resized};
use crate::cli::signals::Signals;
use crate::cli::vary::Vary;
use crate::cli::{command_line, log, print_result, report};
use crate::error::Error;
use crate::inspect::canvas::Canvas;
use crate::inspect::sheet::{self, Layout, Picture, SheetSettings};
use crate::output::file::{check_writable, write_atomic};
use crate::output::image::Image;
use crate::output::{check_memory, read_image};
use crate::pipeline::wedge::{Cell, wedge};
use crate::pipeline::{FrameOutcome, RenderJob};
use crate::progress::Progress;
use crate::render;
use crate::scene::diagnostic::Diagnostic;
use crate::scene::footprint::film_bytes;
use crate::scene::pattern::Pattern;
use crate::scene::{Scene, SceneError};
use clap::Args;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Most pictures of a wedge.
const CELLS_MAX: usize = 1000;
/// Longest name of a varied setting with its value, in names of files [letters].
const SLUG_MAX: usize = 60;
/// Longest name of a picture before its frame [letters]; file systems end names at 255.
const NAME_MAX: usize = 180;
/// Most pictures that are named where several have the same fault.
const NAMED_MAX: usize = 8;
/// Names of files, which are made of what is varied.
const NAMES: [&str; 2] = ["output.image", "output.preview"];
const SHEET: &str = "out/{scene}.wedge.png";

/// Flags of `wedge`.
#[derive(Debug, Args)]
pub struct WedgeArguments {
    /// Flags shared by verbs that look at one frame.
    #[command(flatten)]
    pub common: InspectArguments,
    /// What to vary, as --set takes it, with several values: a list (KEY=5,20,80), so many from
    /// one number to another (KEY=0..0.6:4), at equal ratios (KEY=1..100:3:log), or each whole
    /// number (KEY=1..8). One such flag makes a row, a second one rows and columns
    #[arg(long = "vary", value_name = "KEY=VALUES", required = true, verbatim_doc_comment)]
    pub vary: Vec<Vary>,
    /// The sheet (.png); pictures go beside it, with what was varied in their names
    /// [default: out/{scene}.wedge.png]
    #[arg(short, long, value_name = "FILE", verbatim_doc_comment)]
    pub output: Option<String>,
    /// Pictures side by side on the sheet [default: one for each value of the last --vary]
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..))]
    pub columns: Option<u32>,
    /// Scale wider pictures down to this width in pixels on the sheet
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..))]
    pub width: Option<u32>,
    /// Flags shared by verbs that make pictures.
    #[command(flatten)]
    pub picture: PictureArguments,
    /// Print what would be made, and make nothing
    #[arg(long)]
    pub dry_run: bool,
    /// How to show progress on standard error
    #[arg(long, value_enum, default_value_t = Style::Auto)]
    pub progress: Style,
}

/// What is made.
struct Plan {
    frame: i32,
    sheet: PathBuf,
    layout: Layout,
    cells: Vec<Cell>,
    /// What each cell sets: keys and values.
    choices: Vec<Choice>,
    /// A line for each setting that is varied.
    labels: Vec<String>,
    /// Memory that a picture and the sheet may take together [bytes].
    memory_limit: u64,
}

/// Keys and values of a cell.
type Choice = Vec<(String, String)>;

/// Renders a wedge and its sheet; the exit code.
pub(super) fn run(arguments: &WedgeArguments) -> Result<u8, Error> {
    let plan = match Plan::of(arguments)? {
        Ok(plan) => plan,
        Err(code) => return Ok(code),
    };
    if arguments.dry_run {
        return plan.describe().map(|()| 0);
    }
    start_threads(arguments.common.threads)?;
    let signals = Signals::listen().map_err(|e| Error::Internal(format!("signals cannot be caught: {e}")))?;
    let reporter = Reporter::new(arguments.progress, signals.clone());
    let (resume, checkpoint) = (arguments.picture.resume, arguments.picture.checkpoint());
    let job = RenderJob { resume, checkpoint, arguments: command_line(), ..RenderJob::default() };
    let names = plan.cells.iter().map(|cell| Names::of(&cell.scene)).collect::<Result<Vec<_>, _>>()?;
    let mut printed = Ok(());
    let result = wedge(&plan.cells, plan.frame, &job, &reporter, &mut |number, outcome| {
        let cell = plan.labels[number].replace('\n', ", ");
        match outcome {
            None => reporter.note(&cell),
            Some(FrameOutcome::Kept { .. }) => reporter.note(&format!("{cell}: is finished already")),
            Some(outcome) if printed.is_ok() => {
                printed = reporter.suspend(|| print_result(&names[number].line(outcome)));
            }
            Some(_) => {}
        }
    });
    let result = result.and(printed).and_then(|()| plan.lay_out(arguments.width, &names));
    conclude(result, &reporter, &signals)
}

impl Plan {
    /// All cells with their scenes checked; the exit code where a value does not fit, which was told then.
    fn of(arguments: &WedgeArguments) -> Result<Result<Self, u8>, Error> {
        let common = arguments.common.to_frame_arguments();
        let choices = choices(&arguments.vary)?;
        for key in NAMES.into_iter().filter(|&key| common.overrides.iter().any(|set| set.0 == key)) {
            log(&format!(
                "note: --set {key} gives pictures of a wedge no name: -o names the sheet, and they go beside it"
            ));
        }
        let mut base = [arguments.picture.settings(), overrides(&common)].concat();
        // That of a preview says at least that there is one.
        base.retain(|(key, _)| key != "output.image");
        let (patterns, sheet) = file_names(arguments.output.as_deref().unwrap_or(SHEET), &choices)?;
        let load = |(choice, pattern): (&Choice, &String), frames: Option<&[i32]>| {
            let overrides = [base.as_slice(), choice].concat();
            let overrides = resized(&common.scene, overrides, arguments.picture.resolution, frames)?;
            scene_of_cell(&common.scene, overrides, pattern, frames)
        };
        let cells = || choices.iter().zip(&patterns);
        // Without a frame the first scene has faults, which are told below.
        let first = || Some(load(cells().next()?, Some(&[])).ok()?.settings.frames.first);
        let frame = arguments.common.frame.or_else(first);
        let listed = Some(frame.as_slice());
        let (made, faults) = gathered(cells().map(|cell| {
            let load = || {
                let scene = load(cell, listed)?;
                list_of(frame.map(|frame| frame.to_string()).as_deref(), &scene)?;
                let crop = arguments.picture.crop.map(|crop| crop_of(crop, &scene)).transpose()?;
                Ok(Cell { scene, crop })
            };
            (cell.0, load())
        }));
        let code = faults.first().map(|fault| fault.error.exit_code());
        faults.iter().for_each(Fault::tell);
        let (None, Some(frame), [first, ..]) = (code, frame, made.as_slice()) else {
            return Ok(Err(code.unwrap_or(2)));
        };
        let sheet: PathBuf = sheet.expand(frame, first.scene.name()).into();
        check_writable(&sheet)?;

        let labels = labels(&choices);
        let layout = layout(arguments, &made, &labels, frame)?;
        let settings = || made.iter().map(|cell| &cell.scene.settings);
        let memory_limit = settings().map(|settings| settings.render.memory_limit_gib).fold(f64::INFINITY, f64::min);
        let memory_limit = (memory_limit * f64::from(1 << 30)) as u64;
        // The largest picture is read again while the sheet is there.
        let picture = settings().map(film_bytes).fold(0.0, f64::max) as u64;
        check_memory(&sheet, layout.memory_bytes().saturating_add(picture), memory_limit)?;
        Ok(Ok(Self { frame, sheet, layout, cells: made, choices, labels, memory_limit }))
    }

    /// Prints what would be made.
    fn describe(&self) -> Result<(), Error> {
        for (cell, choice) in self.cells.iter().zip(&self.choices) {
            let image = Names::of(&cell.scene)?.image(self.frame);
            print_result(&format!("{}  {}", image.display(), spelled(choice)))?;
        }
        print_result(&self.sheet.display().to_string())
    }

    /// Writes the sheet of pictures that are there.
    fn lay_out(&self, width: Option<u32>, names: &[Names]) -> Result<(), Error> {
        let mut canvas = self.layout.blank();
        let memory_limit = self.memory_limit.saturating_sub(self.layout.memory_bytes());
        for (number, (cell, names)) in self.cells.iter().zip(names).enumerate() {
            let path = names.image(self.frame);
            let image = read_image(&path, memory_limit)?;
            let output = &cell.scene.settings.output;
            Picture::new(&image, output.view, output.exposure_ev, width)
                .and_then(|picture| self.layout.put(&mut canvas, number, &picture))
                .map_err(|error| Error::Usage(format!("{}: {error}", path.display())))?;
        }
        write_atomic(&self.sheet, &canvas.to_png()?)?;
        let Canvas { size: [width, height], .. } = canvas;
        print_result(&format!("{}: {width} × {height} pixels", self.sheet.display()))
    }
}

/// What the sheet will look like.
fn layout(arguments: &WedgeArguments, cells: &[Cell], labels: &[String], frame: i32) -> Result<Layout, Error> {
    let shown = |Cell { scene, crop }: &Cell| {
        let film = &scene.settings.film;
        let bounds = crop.unwrap_or_else(|| render::canvas(film));
        Image::cropped(film.resolution, [bounds.x0, bounds.y0, bounds.x1, bounds.y1]).shown_size()
    };
    let name = cells.first().map_or("", |cell| cell.scene.name());
    let cells: Vec<sheet::Cell> =
        cells.iter().zip(labels).map(|(cell, label)| sheet::Cell { label: label.clone(), size: shown(cell) }).collect();
    let columns = arguments.columns.or_else(|| arguments.vary.last().map(|vary| vary.values.len() as u32));
    let mut title = vec![format!("{name}, frame {frame}")];
    let last = arguments.vary.len() - 1;
    title.extend(arguments.vary.iter().enumerate().map(|(i, vary)| match arguments.columns {
        Some(_) => vary.key.clone(),
        None if i == last => format!("across: {}", vary.key),
        None => format!("down: {}", vary.key),
    }));
    let settings = SheetSettings { columns, width: arguments.width, is_labelled: true };
    Layout::new(&cells, &title, settings).map_err(|error| Error::Usage(error.to_string()))
}

/// What is wrong with some cells.
struct Fault<'a> {
    error: Error,
    /// The error as it is told.
    text: String,
    choices: Vec<&'a Choice>,
}

impl Fault<'_> {
    fn tell(&self) {
        let cell = |choice: &&Choice| {
            choice.iter().map(|(key, value)| format!("{key}={value}")).collect::<Vec<_>>().join(", ")
        };
        let count = self.choices.len();
        let mut cells = self.choices.iter().take(NAMED_MAX).map(cell).collect::<Vec<_>>().join("; ");
        if count > NAMED_MAX {
            cells += &format!("; and {} more", count - NAMED_MAX);
        }
        let pictures = if count == 1 { "the picture".into() } else { format!("{count} pictures") };
        log(&format!("--vary, in {pictures} of {cells}:"));
        report(&self.error);
    }
}

/// The cells that can be made, after telling each of their warnings once, and each fault with all cells that have it.
fn gathered<'a>(loaded: impl Iterator<Item = (&'a Choice, Result<Cell, Error>)>) -> (Vec<Cell>, Vec<Fault<'a>>) {
    let (mut cells, mut faults): (Vec<Cell>, Vec<Fault>) = Default::default();
    let mut told = HashSet::new();
    for (choice, cell) in loaded {
        match cell {
            Ok(mut cell) => {
                name_vary(&mut cell.scene.warnings, choice);
                let warnings = cell.scene.warnings.iter().map(ToString::to_string);
                warnings.filter(|warning| told.insert(warning.clone())).for_each(|warning| log(&warning));
                cells.push(cell);
            }
            Err(mut error) => {
                if let Error::Scene(SceneError::Faulty(diagnostics)) = &mut error {
                    name_vary(diagnostics, choice);
                }
                let text = error.to_string();
                match faults.iter_mut().find(|fault| fault.text == text) {
                    Some(fault) => fault.choices.push(choice),
                    None => faults.push(Fault { error, text, choices: vec![choice] }),
                }
            }
        }
    }
    (cells, faults)
}

/// Names the flag that a value came from, which is `--set` to a scene.
fn name_vary(diagnostics: &mut [Diagnostic], choice: &Choice) {
    for diagnostic in diagnostics {
        let key = diagnostic.file.strip_prefix("--set ");
        if let Some(key) = key.filter(|&key| choice.iter().any(|(own, _)| own == key)) {
            diagnostic.file = format!("--vary {key}");
        }
    }
}

/// Every combination of values; those of the last setting change fastest.
fn choices(vary: &[Vary]) -> Result<Vec<Choice>, Error> {
    let count = vary.iter().fold(1_usize, |count, vary| count.saturating_mul(vary.values.len()));
    if count > CELLS_MAX {
        return Err(Error::Usage(format!(
            "--vary: {count} pictures; a wedge has at most {CELLS_MAX}: take fewer values"
        )));
    }
    let mut choices = vec![Vec::new()];
    for (i, Vary { key, values }) in vary.iter().enumerate() {
        if vary[..i].iter().any(|other| other.key == *key) {
            return Err(Error::Usage(format!("--vary {key} is there twice; give all its values at once")));
        }
        if NAMES.contains(&key.as_str()) {
            return Err(Error::Usage(format!(
                "--vary {key}: pictures of a wedge are named after what is varied, and -o says where they go; vary something else"
            )));
        }
        let with = |choice: &Choice| {
            values.iter().map(|value| [choice.as_slice(), &[(key.clone(), value.clone())]].concat()).collect::<Vec<_>>()
        };
        choices = choices.iter().flat_map(with).collect();
    }
    Ok(choices)
}

/// The scene of a cell, whose pictures have the names of `pattern`.
fn scene_of_cell(
    path: &Path,
    mut overrides: Vec<(String, String)>,
    pattern: &str,
    frames: Option<&[i32]>,
) -> Result<Scene, Error> {
    // Text in JSON is text in YAML too, whatever it holds.
    let quoted = |text: &str| serde_json::Value::from(text).to_string();
    overrides.push(("output.image".into(), quoted(&format!("{pattern}.exr"))));
    let scene = Scene::load_for(path, &overrides, frames)?;
    if scene.settings.output.preview.is_none() {
        return Ok(scene);
    }
    overrides.push(("output.preview".into(), quoted(&format!("{pattern}.png"))));
    Ok(Scene::load_for(path, &overrides, frames)?)
}

/// Patterns of all cells' pictures without their endings, and that of the sheet.
fn file_names(output: &str, choices: &[Choice]) -> Result<(Vec<String>, Pattern), Error> {
    let sheet = Pattern::parse(output).map_err(|e| Error::Pattern(output.into(), e))?;
    let stem = output
        .strip_suffix(".png")
        .ok_or_else(|| Error::Usage(format!("--output {output}: the name must end in .png")))?;
    let frame = if sheet.has_frame() { "" } else { ".####" };
    let mut taken = HashSet::new();
    let mut patterns = Vec::with_capacity(choices.len());
    for choice in choices {
        let parts: Vec<String> =
            short_names(choice).iter().zip(choice).map(|(name, (_, value))| slug(name, value)).collect();
        let name: String = parts.join(".").chars().take(NAME_MAX).collect();
        // Values that differ only in what names leave out.
        let mut own = name.clone();
        let mut count = 1;
        while !taken.insert(own.clone()) {
            count += 1;
            own = format!("{name}-{count}");
        }
        patterns.push(format!("{stem}.{own}{frame}"));
    }
    Ok((patterns, sheet))
}

/// A setting and its value in letters that names of files may have anywhere, and that stand for no frame.
fn slug(name: &str, value: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "+-.=".contains(c);
    let mut slug = String::new();
    for c in format!("{name}={value}").chars() {
        match is_plain(c) {
            true => slug.push(c),
            false if !slug.ends_with(['_', '=']) => slug.push('_'),
            false => {}
        }
    }
    slug.trim_end_matches('_').chars().take(SLUG_MAX).collect()
}

/// The shortest ends of key paths that tell them apart.
fn short_names(choice: &[(String, String)]) -> Vec<String> {
    let end = |key: &str, count: usize| {
        let parts: Vec<&str> = key.split('.').collect();
        parts[parts.len().saturating_sub(count)..].join(".")
    };
    let is_clear =
        |key: &str, count: usize| choice.iter().all(|(other, _)| other == key || end(other, count) != end(key, count));
    let shortest = |key: &str| (1..).find(|&count| is_clear(key, count) || end(key, count) == *key).unwrap_or(1);
    choice.iter().map(|(key, _)| end(key, shortest(key))).collect()
}

/// What is written below each picture: a line for each setting.
fn labels(choices: &[Choice]) -> Vec<String> {
    let label = |choice: &Choice| {
        let lines = short_names(choice).into_iter().zip(choice).map(|(name, (_, value))| format!("{name}={value}"));
        lines.collect::<Vec<_>>().join("\n")
    };
    choices.iter().map(label).collect()
}

/// As flags of `render` that make the same picture.
fn spelled(choice: &[(String, String)]) -> String {
    let flag = |(key, value): &(String, String)| {
        let is_plain = value.chars().all(|c| c.is_ascii_alphanumeric() || "+-._/:".contains(c));
        let quote = if is_plain && !key.contains('[') { "" } else { "'" };
        format!("--set {quote}{key}={}{quote}", value.replace('\'', "'\\''"))
    };
    choice.iter().map(flag).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vary(texts: &[&str]) -> Vec<Vary> {
        texts.iter().map(|text| text.parse().unwrap()).collect()
    }

    #[test]
    fn the_last_setting_changes_fastest() {
        let choices = choices(&vary(&["a.x=1,2", "b.x=3,4,5"])).unwrap();
        assert_eq!(choices.len(), 6);
        assert_eq!(labels(&choices)[..4], ["a.x=1\nb.x=3", "a.x=1\nb.x=4", "a.x=1\nb.x=5", "a.x=2\nb.x=3"]);
        assert_eq!(spelled(&choices[5]), "--set a.x=2 --set b.x=5");
    }

    #[test]
    fn too_many_and_one_twice_are_refused() {
        assert!(choices(&vary(&["a=1..40", "b=1..40"])).is_err());
        assert!(choices(&vary(&["a=1", "a=2"])).is_err());
    }

    #[test]
    fn names_of_files_tell_what_was_varied_and_are_all_different() {
        let all = choices(&vary(&["lights[0].sun.irradiance=[1, 2, 3],[1 2 3],'{frame}#'", "g=-0.3"])).unwrap();
        let (names, _) = file_names("out/w.png", &all).unwrap();
        let wanted = [
            "out/w.irradiance=1_2_3.g=-0.3.####",
            "out/w.irradiance=1_2_3.g=-0.3-2.####",
            "out/w.irradiance=frame.g=-0.3.####",
        ];
        assert_eq!(names, wanted);
        assert_eq!(file_names("w.%04d.png", &all).unwrap().0[0], "w.%04d.irradiance=1_2_3.g=-0.3");
        assert!(file_names("w.exr", &all).is_err() && file_names("{no}.png", &all).is_err());
        let long = choices(&vary(&[&format!("a={0}1,{0}2", "x".repeat(500))])).unwrap();
        let (names, _) = file_names("w.png", &long).unwrap();
        assert!(names[0] != names[1] && names.iter().all(|name| name.len() < 200));
    }
}
