//! `curlsmoke compare`.

use crate::cli::values::Memory;
use crate::cli::{DIFFERENT, log, print_result};
use crate::error::Error;
use crate::output::agreement::StatisticalSettings;
use crate::output::compare::{Measure, Mode, compare};
use crate::output::flip::FlipSettings;
use crate::output::{heat_map, read_image};
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};

/// Flags of `compare`.
#[derive(Debug, Args)]
pub struct CompareArguments {
    /// The picture (.exr, .hdr, .png)
    pub image: PathBuf,
    /// What it should look like
    pub reference: PathBuf,
    /// What counts as a difference
    #[arg(short, long, value_enum, default_value_t = CompareMode::Exact)]
    pub mode: CompareMode,
    /// Largest allowed difference for mse, relmse, max and flip; smallest allowed ratio
    /// [dB] for psnr
    #[arg(short, long, value_name = "NUMBER", allow_hyphen_values = true, verbatim_doc_comment)]
    pub threshold: Option<f64>,
    /// Probability of a false alarm of --mode stat, 0 to 1
    #[arg(long, value_name = "NUMBER", default_value_t = 0.01)]
    pub alpha: f64,
    /// Share of pixels that must agree in --mode stat [percent]
    #[arg(long, value_name = "PERCENT", default_value_t = 99.75)]
    pub pixels: f64,
    /// Variance of the reference's mean. Without it: X.var.exr beside X.mean.exr, or
    /// the `variance` layers of the pictures
    #[arg(long, value_name = "FILE", verbatim_doc_comment)]
    pub variance: Option<PathBuf>,
    /// Look with --mode flip at what a screen shows, not at light
    #[arg(long)]
    pub ldr: bool,
    /// Write how bad each pixel is, to .exr (numbers) or .png (colours); repeatable
    #[arg(long, value_name = "FILE")]
    pub heat_map: Vec<PathBuf>,
    /// Refuse pictures that need more memory than this [GiB], as 4, 4G or 512M
    #[arg(long, value_name = "AMOUNT", default_value = "8")]
    pub memory_limit: Memory,
}

/// What counts as a difference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CompareMode {
    /// Any bit of any pixel
    Exact,
    /// What noise does not explain: tests against mean and variance
    Stat,
    /// Mean squared error
    Mse,
    /// Mean squared error relative to the reference
    Relmse,
    /// Peak signal-to-noise ratio [dB]
    Psnr,
    /// Largest difference of any pixel
    Max,
    /// What an observer sees who flips between the pictures: the mean of FLIP, 0 to 1
    Flip,
}

/// Compares; 0 when the pictures agree, else [`DIFFERENT`].
pub(super) fn run(arguments: &CompareArguments) -> Result<u8, Error> {
    let mode = mode_of(arguments)?;
    if let Some(path) = arguments.heat_map.iter().find(|path| !heat_map::is_known(path)) {
        return Err(Error::Usage(format!("--heat-map {}: the name must end in .exr or .png", path.display())));
    }
    let limit = arguments.memory_limit.bytes();
    let image = read_image(&arguments.image, limit)?;
    let reference = read_image(&arguments.reference, limit)?;
    let variance = match (&arguments.variance, mode) {
        (Some(path), _) => Some(read_image(path, limit)?),
        (None, Mode::Statistical(_)) => {
            variance_beside(&arguments.reference).map(|path| read_image(&path, limit)).transpose()?
        }
        (None, _) => None,
    };
    let report =
        compare(&image, &reference, variance.as_ref(), mode).map_err(|error| Error::Usage(error.to_string()))?;
    print_result(&report.to_string())?;
    if report.map.is_empty() && !arguments.heat_map.is_empty() {
        log("note: the pictures differ in size, so there is no map of where they differ");
        return Ok(DIFFERENT);
    }
    for path in &arguments.heat_map {
        heat_map::write(path, &report)?;
    }
    Ok(if report.passed() { 0 } else { DIFFERENT })
}

fn mode_of(arguments: &CompareArguments) -> Result<Mode, Error> {
    let measure = match arguments.mode {
        CompareMode::Exact => return Ok(Mode::Exact),
        CompareMode::Stat => {
            let settings = StatisticalSettings { alpha: arguments.alpha, pixel_share: arguments.pixels / 100.0 };
            return Ok(Mode::Statistical(settings));
        }
        CompareMode::Flip => {
            let settings = FlipSettings { ldr: arguments.ldr, ..FlipSettings::default() };
            let needed =
                "this mode needs a limit; add --threshold with the largest mean of FLIP: for example --threshold 0.02";
            let threshold = arguments.threshold.ok_or_else(|| Error::Usage(needed.into()))?;
            return Ok(Mode::Flip(settings, threshold));
        }
        CompareMode::Mse => Measure::Mse,
        CompareMode::Relmse => Measure::RelMse,
        CompareMode::Psnr => Measure::Psnr,
        CompareMode::Max => Measure::Max,
    };
    let example = match measure {
        Measure::Psnr => "the least ratio in dB: for example --threshold 40",
        Measure::Max => "the largest difference of a pixel: for example --threshold 0.01",
        Measure::Mse | Measure::RelMse => "the largest mean squared error: for example --threshold 1e-3",
    };
    let needed = || Error::Usage(format!("this mode needs a limit; add --threshold with {example}"));
    arguments.threshold.map(|threshold| Mode::Measure(measure, threshold)).ok_or_else(needed)
}

/// `x.var.exr` beside `x.mean.exr`, if it is there.
fn variance_beside(reference: &Path) -> Option<PathBuf> {
    let stem = reference.file_name()?.to_str()?.strip_suffix(".mean.exr")?;
    Some(reference.with_file_name(format!("{stem}.var.exr"))).filter(|path| path.exists())
}
