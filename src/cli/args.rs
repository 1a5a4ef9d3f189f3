//! The verbs, and the flags that several of them share. Flags of one verb stand in its own file; what they mean is decided there.

use crate::cli::bake::BakeArguments;
use crate::cli::check::{CheckArguments, SchemaArguments};
use crate::cli::compare::CompareArguments;
use crate::cli::denoise::DenoiseArguments;
use crate::cli::farm::FarmVerb;
use crate::cli::flow::FlowVerb;
use crate::cli::inspect::InspectImageArguments;
use crate::cli::merge::MergeArguments;
use crate::cli::points::PointsArguments;
use crate::cli::progress::Style;
use crate::cli::regress::RegressArguments;
use crate::cli::render::RenderArguments;
use crate::cli::sheet::SheetArguments;
use crate::cli::streamlines::StreamlinesArguments;
use crate::cli::turntable::TurntableArguments;
use crate::cli::values::{self, Crop, Memory, Override, Resolution};
use crate::cli::warp::WarpArguments;
use crate::cli::watch::WatchArguments;
use crate::cli::wedge::WedgeArguments;
use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;
use std::time::Duration;

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
    /// Join parts of pictures that `render --samples` made into what one run would have written
    #[command(after_help = "Example: curlsmoke merge out/ring.*.part -o out/ring.exr")]
    Merge(MergeArguments),
    /// Print a ready job for a render farm
    #[command(subcommand, after_help = "Example: curlsmoke farm slurm scenes/plume.yaml --chunk 8 > plume.sbatch")]
    Farm(FarmVerb),
    /// Look on while a scene changes: render again whenever it is saved, on a local page or in tev
    #[command(after_help = "Example: curlsmoke watch scenes/plume.yaml --serve --resolution 50%")]
    Watch(WatchArguments),
    /// Render one frame from all round
    #[command(after_help = "Example: curlsmoke turntable scenes/plume.yaml --at 12 --frames 1-48 --spp 64")]
    Turntable(TurntableArguments),
    /// Render one frame with several values of some settings, to a sheet of all
    #[command(
        after_help = "Example: curlsmoke wedge scenes/plume.yaml --frame 12 --vary smoke.medium.extinction=15,60,240 --resolution 50%"
    )]
    Wedge(WedgeArguments),
    /// Check scenes and report every problem with its place
    #[command(after_help = "Example: curlsmoke check scenes/*.yaml")]
    Check(CheckArguments),
    /// Print the JSON Schema of scene files, for editors
    #[command(after_help = "Example: curlsmoke schema > curlsmoke.schema.json")]
    Schema(SchemaArguments),
    /// Write the density of each frame as a .vdb file, without rendering
    #[command(after_help = "Example: curlsmoke bake scenes/plume.yaml --frames 1-96 --output cache/plume.####.vdb")]
    Bake(BakeArguments),
    /// Compare a picture with a reference; exit code 7 when they differ
    #[command(
        after_help = "Example: curlsmoke compare out/ring.exr refs/ring.mean.exr --mode stat --heat-map heat.png"
    )]
    Compare(CompareArguments),
    /// Tell what a picture holds: its layers, one pixel, or what its numbers are like
    #[command(after_help = "Example: curlsmoke inspect out/ring.0001.exr --pixel 320,180 --stats")]
    Inspect(InspectImageArguments),
    /// Make the pictures of a suite and compare them with references; exit code 7 when any case fails
    #[command(after_help = "Example: curlsmoke regress refs/suite.yaml --report out/regress --junit out/regress.xml")]
    Regress(RegressArguments),
    /// Take the noise out of a rendered picture, with Intel's Open Image Denoise; keeps what was rendered
    #[command(
        after_help = "Example: curlsmoke denoise out/ring.exr -o out/ring.denoised.exr --preview out/ring.denoised.png"
    )]
    Denoise(DenoiseArguments),
    /// Look at the flow of a scene without smoke
    #[command(subcommand, after_help = "Example: curlsmoke flow slice scenes/plume.yaml -o out/flow")]
    Flow(FlowVerb),
    /// Trace lines along the flow of a scene, to .obj or .ply
    #[command(
        after_help = "Example: curlsmoke streamlines scenes/ring.yaml -o out/ring.ply --preview out/ring.lines.png"
    )]
    Streamlines(StreamlinesArguments),
    /// Lay pictures out on one sheet with their names; of a single .exr, a .png as the screen shows it
    #[command(after_help = "Example: curlsmoke sheet out/plume.00*.exr -o out/sheet.png --width 320 --view agx")]
    Sheet(SheetArguments),
    /// Let a picture flow: warp it by noise that stirs and never thins or folds
    #[command(after_help = "Example: curlsmoke warp waves.png -o out/warped.png --length 0.3 --distance 0.5")]
    Warp(WarpArguments),
    /// Make points of a cube in two to seven dimensions, and tell how evenly they are spread
    #[command(after_help = "Example: curlsmoke points --dim 3 --per-axis 20 -o out/points.ply --plot out/points.png")]
    Points(PointsArguments),
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
    /// Seed of the random numbers, instead of render.seed
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

/// Flags of everything that looks at one frame.
#[derive(Debug, Args)]
pub struct InspectArguments {
    /// The scene file (YAML)
    pub scene: PathBuf,
    /// The frame to look at [default: the first of the scene]
    #[arg(short, long, value_name = "NUMBER", allow_negative_numbers = true)]
    pub frame: Option<i32>,
    /// Threads [default: one for each processor]; results never depend on it
    #[arg(short = 'j', long, value_name = "COUNT")]
    pub threads: Option<usize>,
    /// Seed of the random numbers, instead of render.seed
    #[arg(long, value_name = "NUMBER")]
    pub seed: Option<u64>,
    /// Change a setting of the scene, as in --set render.seed=2
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<Override>,
    /// Refuse what needs more memory than this [GiB], as 4, 4G or 512M, instead of
    /// render.memory_limit_gib
    #[arg(long, value_name = "AMOUNT", verbatim_doc_comment)]
    pub memory_limit: Option<Memory>,
}

/// Flags of everything that makes pictures of smoke and light.
#[derive(Debug, Args)]
pub struct PictureArguments {
    /// Paths traced through each pixel, instead of film.spp
    #[arg(long, value_name = "COUNT")]
    pub spp: Option<u32>,
    /// Trace through each pixel only until its noise is below this, instead of film.noise_target: 0.02 is clean, 0.1 grainy
    #[arg(long, value_name = "SHARE")]
    pub noise_target: Option<f64>,
    /// Width and height in pixels, instead of film.resolution, or a share of what they would be,
    /// and of the overscan: 640x360, 50%
    #[arg(long, visible_alias = "res", value_name = "SIZE", verbatim_doc_comment)]
    pub resolution: Option<Resolution>,
    /// Render a part only: x0,y0,x1,y1 in pixels from the top left of the frame, negative in
    /// overscan, or in percent of the frame
    #[arg(long, value_name = "EDGES", allow_hyphen_values = true, verbatim_doc_comment)]
    pub crop: Option<Crop>,
    /// Leave pictures alone that are finished and made from these very settings, and go on
    /// from checkpoints
    #[arg(long, verbatim_doc_comment)]
    pub resume: bool,
    /// How often to write a checkpoint of an unfinished picture beside it [s], for --resume
    /// to go on from; a signal that ends the run writes one too. 0: never
    #[arg(long, value_name = "SECONDS", default_value = "300", value_parser = values::seconds_or_none, verbatim_doc_comment)]
    pub checkpoint_every: f64,
}

impl PictureArguments {
    /// What they set, but for a share of the size.
    pub fn settings(&self) -> Vec<(String, String)> {
        let pixels = match self.resolution {
            Some(Resolution::Pixels(size)) => Some(format!("{size:?}")),
            _ => None,
        };
        let settings = [
            ("film.noise_target", self.noise_target.map(|noise| noise.to_string())),
            ("film.spp", self.spp.map(|spp| spp.to_string())),
            ("film.resolution", pixels),
        ];
        settings.into_iter().filter_map(|(key, value)| Some((key.to_string(), value?))).collect()
    }

    /// How often to write a checkpoint, if ever.
    pub fn checkpoint(&self) -> Option<Duration> {
        Some(self.checkpoint_every).filter(|&seconds| seconds > 0.0).map(Duration::from_secs_f64)
    }
}

impl InspectArguments {
    /// The same for verbs that make frames: a list of one.
    pub fn to_frame_arguments(&self) -> FrameArguments {
        FrameArguments {
            scene: self.scene.clone(),
            frames: self.frame.map(|frame| frame.to_string()),
            threads: self.threads,
            seed: self.seed,
            overrides: self.overrides.clone(),
            memory_limit: self.memory_limit,
            progress: Style::None,
        }
    }
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
    fn crops_may_begin_with_a_minus() {
        for verb in [&["render", "a.yaml"][..], &["wedge", "a.yaml", "--vary", "a=1"], &["watch", "a.yaml"]] {
            let arguments = [&["curlsmoke"], verb, &["--crop", "-4,0,8,8"]].concat();
            Arguments::try_parse_from(&arguments).unwrap_or_else(|e| panic!("{e}"));
        }
    }

    #[test]
    fn frames_may_begin_with_a_minus() {
        let arguments = Arguments::try_parse_from(["curlsmoke", "render", "a.yaml", "--frames", "-5--1"]).unwrap();
        let Verb::Render(render) = arguments.verb else { panic!("not render") };
        assert_eq!(render.common.frames.as_deref(), Some("-5--1"));
    }
}
