//! Flags of `wedge`.

use crate::cli::args::InspectArguments;
use crate::cli::progress::Style;
use crate::cli::values::{self, Crop, Resolution};
use crate::cli::vary::Vary;
use clap::Args;

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
