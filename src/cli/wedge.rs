//! `curlsmoke wedge`.

use crate::cli::args::InspectArguments;
use crate::cli::frames::{flags, list_of, set_by_hand, start_threads};
use crate::cli::progress::{Reporter, Style};
use crate::cli::render::{Names, RenderArguments, checkpoint_of, conclude, crop_of, overrides_of};
use crate::cli::signals::Signals;
use crate::cli::values::{self, Crop, Resolution};
use crate::cli::vary::Vary;
use crate::cli::{command_line, log, print_result, report};
use crate::error::Error;
use crate::inspect::sheet::{self, SheetSettings};
use crate::output::file::{check_writable, write_atomic};
use crate::output::read_image;
use crate::pipeline::wedge::{Cell, wedge};
use crate::pipeline::{FrameOutcome, RenderJob};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::scene::pattern::Pattern;
use clap::Args;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Most pictures of a wedge.
const CELLS_MAX: usize = 1000;
/// Longest name of a varied setting with its value, in names of files [letters].
const SLUG_MAX: usize = 60;
/// Longest name of a picture before its frame [letters]; file systems end names at 255.
const NAME_MAX: usize = 180;
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
    /// Paths traced through each pixel, instead of film.spp
    #[arg(long, value_name = "COUNT")]
    pub spp: Option<u32>,
    /// Trace through each pixel only until its noise is below this, instead of film.noise_target
    #[arg(long, value_name = "SHARE")]
    pub noise_target: Option<f64>,
    /// Width and height in pixels, or a share of the scene's: 640x360, 50%
    #[arg(long, visible_alias = "res", value_name = "SIZE")]
    pub resolution: Option<Resolution>,
    /// Render a part only: x0,y0,x1,y1 in pixels from the top left, or in percent
    #[arg(long, value_name = "EDGES")]
    pub crop: Option<Crop>,
    /// Leave pictures alone that are finished and made from this very scene and these values,
    /// and go on from checkpoints
    #[arg(long, verbatim_doc_comment)]
    pub resume: bool,
    /// How often to write a checkpoint of an unfinished picture [s]; 0: never
    #[arg(long, value_name = "SECONDS", default_value = "300", value_parser = values::seconds_or_none)]
    pub checkpoint_every: f64,
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
    cells: Vec<Cell>,
    /// What each cell sets: keys and values.
    choices: Vec<Vec<(String, String)>>,
    /// A line for each setting that is varied.
    labels: Vec<String>,
}

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
    let checkpoint = checkpoint_of(&render_arguments(arguments));
    let job = RenderJob { resume: arguments.resume, checkpoint, arguments: command_line(), ..RenderJob::default() };
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
    let result = result.and(printed).and_then(|()| plan.lay_out(arguments, &names));
    conclude(result, &reporter, &signals)
}

impl Plan {
    /// All cells with their scenes checked; the exit code where a value does not fit, which was told then.
    fn of(arguments: &WedgeArguments) -> Result<Result<Self, u8>, Error> {
        let common = arguments.common.to_frame_arguments();
        let choices = choices(&arguments.vary)?;
        let render = render_arguments(arguments);
        let listed = arguments.common.frame.map(|frame| [frame]);
        let listed = listed.as_ref().map(<[i32; 1]>::as_slice);
        let mut base = overrides_of(&render, listed)?;
        base.extend(flags(&common));
        base.extend(set_by_hand(&common));
        let path = &common.scene;
        let (patterns, sheet) = file_names(arguments.output.as_deref().unwrap_or(SHEET), &choices)?;

        let mut told = HashSet::new();
        let mut tell = |text: String, say: &dyn Fn(&str)| {
            if !told.contains(&text) {
                say(&text);
                told.insert(text);
            }
        };
        let mut code = None;
        let mut cells = Vec::new();
        for (choice, pattern) in choices.iter().zip(&patterns) {
            let loaded = scene_of_cell(path, [base.as_slice(), choice].concat(), pattern, listed).and_then(|scene| {
                let frames = list_of(common.frames.as_deref(), &scene)?;
                check_writable(Path::new(&sheet.expand(frames[0], scene.name())))?;
                let crop = arguments.crop.map(|crop| crop_of(crop, &scene)).transpose()?;
                Ok((frames[0], Cell { scene, crop }))
            });
            match loaded {
                Ok((frame, cell)) => {
                    cell.scene.warnings.iter().for_each(|warning| tell(warning.to_string(), &|text| log(text)));
                    cells.push((frame, cell));
                }
                Err(error) => {
                    tell(error.to_string(), &|_| {
                        log(&format!("--vary, in the picture of {}:", spelled(choice)));
                        report(&error);
                    });
                    code.get_or_insert(error.exit_code());
                }
            }
        }
        let (None, Some(&(frame, _))) = (code, cells.first()) else { return Ok(Err(code.unwrap_or(2))) };
        let cells: Vec<Cell> = cells.into_iter().map(|(_, cell)| cell).collect();
        let sheet = sheet.expand(frame, cells[0].scene.name()).into();
        let labels = labels(&choices);
        Ok(Ok(Self { frame, sheet, cells, choices, labels }))
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
    fn lay_out(&self, arguments: &WedgeArguments, names: &[Names]) -> Result<(), Error> {
        let mut pictures = Vec::with_capacity(self.cells.len());
        for ((cell, names), label) in self.cells.iter().zip(names).zip(&self.labels) {
            let settings = &cell.scene.settings;
            let path = names.image(self.frame);
            let image = read_image(&path, (settings.render.memory_limit_gib * f64::from(1 << 30)) as u64)?;
            let output = &settings.output;
            let picture = sheet::Cell::new(label.clone(), &image, output.view.into(), output.exposure_ev)
                .map_err(|error| Error::Usage(format!("{}: {error}", path.display())))?;
            pictures.push(picture.narrowed(arguments.width.unwrap_or(u32::MAX)));
        }
        let columns = arguments.columns.or_else(|| arguments.vary.last().map(|vary| vary.values.len() as u32));
        let mut title = vec![format!("{}, frame {}", self.cells[0].scene.name(), self.frame)];
        let last = arguments.vary.len() - 1;
        title.extend(arguments.vary.iter().enumerate().map(|(i, vary)| match arguments.columns {
            Some(_) => vary.key.clone(),
            None if i == last => format!("across: {}", vary.key),
            None => format!("down: {}", vary.key),
        }));
        let settings = SheetSettings { columns, width: arguments.width, is_labelled: true };
        let canvas = sheet::sheet(pictures, &title, settings).map_err(|error| Error::Usage(error.to_string()))?;
        write_atomic(&self.sheet, &canvas.to_png()?)?;
        let [width, height] = canvas.size;
        print_result(&format!("{}: {width} × {height} pixels", self.sheet.display()))
    }
}

/// The flags as `render` would have them.
fn render_arguments(arguments: &WedgeArguments) -> RenderArguments {
    RenderArguments {
        common: arguments.common.to_frame_arguments(),
        spp: arguments.spp,
        noise_target: arguments.noise_target,
        time_limit: None,
        resolution: arguments.resolution,
        output: None,
        crop: arguments.crop,
        pixel: None,
        samples: None,
        resume: arguments.resume,
        checkpoint_every: arguments.checkpoint_every,
        missing: false,
        dry_run: arguments.dry_run,
        movie: None,
    }
}

/// Every combination of values; those of the last setting change fastest.
fn choices(vary: &[Vary]) -> Result<Vec<Vec<(String, String)>>, Error> {
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
        let with = |choice: &Vec<(String, String)>| {
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
fn file_names(output: &str, choices: &[Vec<(String, String)>]) -> Result<(Vec<String>, Pattern), Error> {
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
fn labels(choices: &[Vec<(String, String)>]) -> Vec<String> {
    let label = |choice: &Vec<(String, String)>| {
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
