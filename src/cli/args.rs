//! What was typed. What it means is decided by each verb.

use crate::cli::progress::Style;
use crate::cli::values::{Crop, Memory, Override, Resolution};
use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

const EXIT_CODES: &str = "\
Exit codes: 0 done, 1 render failure, 2 usage, 3 invalid scene or input, 4 missing
file, 5 output not writable or disk full, 6 over the memory limit, 7 pictures
differ, 128+n ended by signal n. Results go to standard output, everything else to
standard error.";

/// Offline renderer of procedural smoke.
#[derive(Debug, Parser)]
#[command(name = "curlsmoke", version, about, after_help = EXIT_CODES, max_term_width = 100)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub verb: Verb,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Render the frames of a scene to EXR and PNG
    #[command(after_help = "Example: curlsmoke render scenes/plume.yaml --frames 1-96x2 --resolution 50% --resume")]
    Render(RenderArguments),
    /// Check scenes and report every problem with its place
    #[command(after_help = "Example: curlsmoke check scenes/*.yaml")]
    Check(CheckArguments),
    /// Print the JSON Schema of scene files, for editors
    #[command(after_help = "Example: curlsmoke schema > curlsmoke.schema.json")]
    Schema,
    /// Write the density of each frame as a .vdb file, without rendering
    #[command(after_help = "Example: curlsmoke bake scenes/plume.yaml --frames 1-96 --output cache/plume.####.vdb")]
    Bake(BakeArguments),
    /// Compare a picture with a reference; exit code 7 when they differ
    #[command(
        after_help = "Example: curlsmoke compare out/ring.exr refs/ring.mean.exr --mode stat --heat-map heat.png"
    )]
    Compare(CompareArguments),
}

/// Flags of everything that makes frames.
#[derive(Debug, Args)]
pub struct FrameArguments {
    /// The scene file (YAML)
    pub scene: PathBuf,
    /// Frames to make, in this order: 1-96, 1-96x2 (every second), 1,3,7-9, 96-1
    /// [default: those of the scene]
    #[arg(short, long, value_name = "LIST", allow_hyphen_values = true, verbatim_doc_comment)]
    pub frames: Option<String>,
    /// Threads [default: one for each processor]; results never depend on it
    #[arg(short = 'j', long, value_name = "COUNT")]
    pub threads: Option<usize>,
    /// Seed of all random numbers, instead of render.seed
    #[arg(long, value_name = "NUMBER")]
    pub seed: Option<u64>,
    /// Change a setting of the scene, as in --set camera.vertical_fov_deg=40
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<Override>,
    /// Refuse what needs more memory than this [GiB], as 4, 4G or 512M, instead of
    /// render.memory_limit_gib
    #[arg(long, value_name = "AMOUNT", verbatim_doc_comment)]
    pub memory_limit: Option<Memory>,
    /// How to show progress on standard error
    #[arg(long, value_enum, default_value_t = Style::Auto)]
    pub progress: Style,
}

/// Flags of `render`.
#[derive(Debug, Args)]
pub struct RenderArguments {
    /// Flags shared with `bake`.
    #[command(flatten)]
    pub common: FrameArguments,
    /// Paths traced through each pixel, instead of film.spp
    #[arg(long, value_name = "COUNT")]
    pub spp: Option<u32>,
    /// Width and height in pixels, or a share of the scene's: 640x360, 50%
    #[arg(long, visible_alias = "res", value_name = "SIZE")]
    pub resolution: Option<Resolution>,
    /// Render a part only: x0,y0,x1,y1 in pixels from the top left, or in percent
    #[arg(long, value_name = "EDGES")]
    pub crop: Option<Crop>,
    /// Leave frames alone that are finished and made from this very scene
    #[arg(long)]
    pub resume: bool,
    /// Print what would be made, and make nothing
    #[arg(long)]
    pub dry_run: bool,
}

/// Flags of `bake`.
#[derive(Debug, Args)]
pub struct BakeArguments {
    /// Flags shared with `render`.
    #[command(flatten)]
    pub common: FrameArguments,
    /// File names, with #### for the frame, instead of output.volume
    #[arg(short, long, value_name = "PATTERN")]
    pub output: Option<String>,
    /// Half precision: half the size, densities above 65504 are cut
    #[arg(long)]
    pub half: bool,
}

/// Flags of `check`.
#[derive(Debug, Args)]
pub struct CheckArguments {
    /// The scene files (YAML)
    #[arg(required = true)]
    pub scenes: Vec<PathBuf>,
    /// Change a setting of the scenes, as in --set film.spp=16
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<Override>,
    /// How to print problems
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub format: Format,
}

/// How to print problems.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// For people, with the line of the scene
    Text,
    /// For programs, on standard output
    Json,
}

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
    /// Largest allowed difference for mse, relmse and max; smallest allowed ratio
    /// [dB] for psnr
    #[arg(short, long, value_name = "NUMBER", allow_hyphen_values = true, verbatim_doc_comment)]
    pub threshold: Option<f64>,
    /// Probability of a false alarm in each test of --mode stat, 0 to 1
    #[arg(long, value_name = "NUMBER", default_value_t = 0.01)]
    pub alpha: f64,
    /// Share of pixels that must agree in --mode stat [percent]
    #[arg(long, value_name = "PERCENT", default_value_t = 99.75)]
    pub pixels: f64,
    /// Variance of the reference's mean. Without it: X.var.exr beside X.mean.exr, or
    /// the `variance` layers of the pictures
    #[arg(long, value_name = "FILE", verbatim_doc_comment)]
    pub variance: Option<PathBuf>,
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn frames_may_begin_with_a_minus() {
        let arguments = Arguments::try_parse_from(["curlsmoke", "render", "a.yaml", "--frames", "-5--1"]).unwrap();
        let Verb::Render(render) = arguments.verb else { panic!("not render") };
        assert_eq!(render.common.frames.as_deref(), Some("-5--1"));
    }
}
