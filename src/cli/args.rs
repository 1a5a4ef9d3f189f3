//! What was typed. What it means is decided by each verb.

pub mod wedge;

use crate::cli::args::wedge::WedgeArguments;
use crate::cli::places::{self, Extent, Length, Plane};
use crate::cli::progress::Style;
use crate::cli::values::{self, Crop, Display, Memory, Override, PixelPlace, Resolution, Samples};
use crate::inspect::slice_picture::Quantity;
use crate::output::view::View;
use crate::scene::settings::{VelocityUnits, VolumeGrid};
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

/// Ways to look at a flow.
#[derive(Debug, Subcommand)]
pub enum FlowVerb {
    /// Draw the flow on a plane, and write its numbers as an .exr file
    #[command(
        after_help = "Example: curlsmoke flow slice scenes/plume.yaml --plane z=0 --quantity lic,divergence -o out/flow"
    )]
    Slice(SliceArguments),
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

/// Flags of `render`.
#[derive(Debug, Args)]
pub struct RenderArguments {
    /// Flags shared with `bake`.
    #[command(flatten)]
    pub common: FrameArguments,
    /// Paths traced through each pixel, instead of film.spp
    #[arg(long, value_name = "COUNT")]
    pub spp: Option<u32>,

    /// Trace through each pixel only until its noise is below this, instead of film.noise_target: 0.02 is clean, 0.1 grainy
    #[arg(long, value_name = "SHARE")]
    pub noise_target: Option<f64>,

    /// Trace light no longer than this many seconds a frame, instead of film.time_limit
    #[arg(long, value_name = "SECONDS", conflicts_with = "noise_target")]
    pub time_limit: Option<f64>,
    /// Width and height in pixels, or a share of the scene's: 640x360, 50%
    #[arg(long, visible_alias = "res", value_name = "SIZE")]
    pub resolution: Option<Resolution>,
    /// File names of the pictures (.exr), with #### for the frame, instead of
    /// output.image; previews go beside them
    #[arg(short, long, value_name = "PATTERN", verbatim_doc_comment)]
    pub output: Option<String>,
    /// Render a part only: x0,y0,x1,y1 in pixels from the top left, or in percent
    #[arg(long, value_name = "EDGES")]
    pub crop: Option<Crop>,
    /// Render this pixel alone and print all its layers, the ways of its light among them; write nothing
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true, conflicts_with_all = ["crop", "resume", "dry_run", "output", "samples", "missing", "movie"])]
    pub pixel: Option<PixelPlace>,
    /// Trace these paths of each pixel only, counted from 1, as in 1-64, to a .part file
    /// beside the picture; `curlsmoke merge` joins such parts
    #[arg(long, value_name = "FIRST-LAST", conflicts_with_all = ["noise_target", "time_limit", "movie"], verbatim_doc_comment)]
    pub samples: Option<Samples>,
    /// Leave frames alone that are finished and made from this very scene, and go on
    /// from checkpoints
    #[arg(long, verbatim_doc_comment)]
    pub resume: bool,
    /// How often to write a checkpoint of an unfinished frame beside the picture [s], for
    /// --resume to go on from; a signal that ends the run writes one too. 0: never
    #[arg(long, value_name = "SECONDS", default_value = "300", value_parser = values::seconds_or_none, verbatim_doc_comment)]
    pub checkpoint_every: f64,
    /// Print the frames that are not finished, or were made from another scene, as a list
    /// for --frames, and make nothing
    #[arg(long, conflicts_with_all = ["dry_run", "resume"], verbatim_doc_comment)]
    pub missing: bool,
    /// Print what would be made, files and all, and make nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Afterwards make a movie of all previews, with the system's ffmpeg: .mp4, .mov, .mkv or .webm
    #[arg(long, value_name = "FILE")]
    pub movie: Option<PathBuf>,
}

/// Flags of `merge`.
#[derive(Debug, Args)]
pub struct MergeArguments {
    /// The parts (.part), of one frame or several, in any order
    #[arg(required = true)]
    pub parts: Vec<PathBuf>,
    /// The picture (.exr), with #### for the frame where there are several; a preview
    /// that the scene asks for goes beside it
    #[arg(short, long, value_name = "PATTERN", verbatim_doc_comment)]
    pub output: String,
    /// Threads [default: one for each processor]; results never depend on it
    #[arg(short = 'j', long, value_name = "COUNT")]
    pub threads: Option<usize>,
    /// Refuse pictures that need more memory than this [GiB], as 4, 4G or 512M
    #[arg(long, value_name = "AMOUNT", default_value = "8")]
    pub memory_limit: Memory,
}

/// Farms.
#[derive(Debug, Subcommand)]
pub enum FarmVerb {
    /// Print a template of Open Job Description, in YAML
    #[command(after_help = "Example: curlsmoke farm openjd scenes/plume.yaml --chunk 8 --bake > plume.openjd.yaml")]
    Openjd(FarmArguments),
    /// Print a script for Slurm's sbatch
    #[command(after_help = "Example: curlsmoke farm slurm scenes/plume.yaml --chunk 8 > plume.sbatch")]
    Slurm(FarmArguments),
}

/// Flags of `farm`.
#[derive(Debug, Args)]
pub struct FarmArguments {
    /// The scene file (YAML)
    pub scene: PathBuf,
    /// Frames to make: 1-96, 1-96x2 (every second), 1,3,7-9 [default: those of the scene]
    #[arg(short, long, value_name = "LIST", allow_hyphen_values = true)]
    pub frames: Option<String>,
    /// Frames that a task makes one after the other
    #[arg(long, value_name = "COUNT", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub chunk: u32,
    /// Bake the density to .vdb files (output.volume) first, and render from those
    #[arg(long)]
    pub bake: bool,
    /// Change a setting of the scene, as in --set film.spp=64
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<Override>,
}

/// Flags of `watch`.
#[derive(Debug, Args)]
pub struct WatchArguments {
    /// Flags shared by verbs that look at one frame.
    #[command(flatten)]
    pub common: InspectArguments,
    /// Show the picture on a page of this machine alone, on this port [default: 7640];
    /// 0 is any that is free. The page is served without the flag too, unless
    /// --display is there
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "7640", verbatim_doc_comment)]
    pub serve: Option<u16>,
    /// Show the picture in the viewer tev: tev, or tev=HOST:PORT
    #[arg(long, value_name = "VIEWER")]
    pub display: Option<Display>,
    /// Paths traced through each pixel at most, instead of film.spp
    #[arg(long, value_name = "COUNT")]
    pub spp: Option<u32>,
    /// Width and height in pixels, or a share of the scene's: 640x360, 50%
    #[arg(long, visible_alias = "res", value_name = "SIZE")]
    pub resolution: Option<Resolution>,
    /// Render a part only: x0,y0,x1,y1 in pixels from the top left, or in percent
    #[arg(long, value_name = "EDGES")]
    pub crop: Option<Crop>,
}

/// Flags of `turntable`.
#[derive(Debug, Args)]
pub struct TurntableArguments {
    /// Flags shared with `render`; --frames lists the views, 1-48 unless it says otherwise, of which the
    /// least to the one after the largest are a turn.
    #[command(flatten)]
    pub render: RenderArguments,
    /// The frame of the scene to look at [default: its first]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    pub at: Option<i32>,
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
    /// Half precision: half the size, what is beyond ±65504 is cut
    #[arg(long)]
    pub half: bool,
    /// Grids beside the density, several with commas, instead of output.volume_grids; with velocity the density is that of one
    /// instant
    #[arg(long, value_enum, value_delimiter = ',', value_name = "GRIDS")]
    pub grids: Option<Vec<GridName>>,
    /// Unit of the velocities: metres a second or a frame [default: output.velocity_units]
    #[arg(long, value_enum, value_name = "UNIT")]
    pub velocity_units: Option<UnitName>,
    /// Write the particles too, as PLY: place, velocity, age, lifetime, mass, radius; #### is the frame
    #[arg(long, value_name = "PATTERN")]
    pub particles: Option<String>,
    /// Write the obstacles too, as a level set [m] on the voxels of the density; with #### of each frame, else of the first
    #[arg(long, value_name = "PATTERN")]
    pub obstacles: Option<String>,
}

/// A grid beside the density.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum GridName {
    /// Velocities, named v
    Velocity,
    /// Temperatures [K], named temperature, of smoke with smoke.blackbody
    Temperature,
}

impl From<GridName> for VolumeGrid {
    fn from(name: GridName) -> Self {
        match name {
            GridName::Velocity => Self::Velocity,
            GridName::Temperature => Self::Temperature,
        }
    }
}

/// Unit of velocities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum UnitName {
    /// Metres a second
    Second,
    /// Metres a frame
    Frame,
}

impl From<UnitName> for VelocityUnits {
    fn from(name: UnitName) -> Self {
        match name {
            UnitName::Second => Self::Second,
            UnitName::Frame => Self::Frame,
        }
    }
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

/// Flags that choose a rectangle in space.
#[derive(Debug, Args)]
pub struct PlaneArguments {
    /// Where the plane is: x=0.5, y=1 or z=0, or a point on it and the normal that
    /// faces the viewer, PX,PY,PZ,NX,NY,NZ [default: upright through
    /// camera.look_at, facing the camera]
    #[arg(long, value_name = "PLANE", allow_hyphen_values = true, verbatim_doc_comment)]
    pub plane: Option<Plane>,
    /// Width and height [m], as in 3.2x1.8 [default: what the camera sees there]
    #[arg(long, value_name = "SIZE")]
    pub size: Option<Extent>,
}

/// Flags of `flow slice`.
#[derive(Debug, Args)]
pub struct SliceArguments {
    /// Flags shared by verbs that look at one frame.
    #[command(flatten)]
    pub common: InspectArguments,
    /// Where to write: OUT.exr with the numbers, and OUT.png, or OUT.QUANTITY.png for
    /// several quantities
    #[arg(short, long, value_name = "OUT", verbatim_doc_comment)]
    pub output: PathBuf,
    /// Which part of space to look at.
    #[command(flatten)]
    pub plane: PlaneArguments,
    /// Width and height in pixels [default: 640x360, or 640 wide and as high as --size]
    #[arg(long, visible_alias = "res", value_name = "SIZE")]
    pub resolution: Option<Resolution>,
    /// What to draw; several with commas
    #[arg(short, long, value_enum, value_delimiter = ',', default_value = "lic")]
    pub quantity: Vec<SliceQuantity>,
}

/// What a picture of a slice shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SliceQuantity {
    /// Speed by colour
    Speed,
    /// Divergence by colour: how far the flow is from preserving volume
    Divergence,
    /// Distance to obstacles, with contour lines
    Distance,
    /// Contour lines of the stream function, exact where the flow is planar
    Stream,
    /// Directions as brush strokes (line integral convolution), speed by colour
    Lic,
}

impl From<SliceQuantity> for Quantity {
    fn from(quantity: SliceQuantity) -> Self {
        match quantity {
            SliceQuantity::Speed => Self::Speed,
            SliceQuantity::Divergence => Self::Divergence,
            SliceQuantity::Distance => Self::Distance,
            SliceQuantity::Stream => Self::Stream,
            SliceQuantity::Lic => Self::Lic,
        }
    }
}

/// Flags of `streamlines`.
#[derive(Debug, Args)]
pub struct StreamlinesArguments {
    /// Flags shared by verbs that look at one frame.
    #[command(flatten)]
    pub common: InspectArguments,
    /// Where to write the lines: .obj, or .ply with speed and time at each vertex
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Draw the lines from the scene's camera, to a .png file
    #[arg(long, value_name = "FILE")]
    pub preview: Option<PathBuf>,
    /// Width and height of the preview in pixels [default: 960x540]
    #[arg(long, visible_alias = "res", value_name = "SIZE")]
    pub resolution: Option<Resolution>,
    /// Let time go on along the lines, as for particles, instead of holding it still
    #[arg(long)]
    pub pathlines: bool,
    /// Where lines begin
    #[arg(long, value_enum, default_value_t = SeedPlace::Emitters)]
    pub seeds: SeedPlace,
    /// How many lines; on a plane about as many
    #[arg(short = 'n', long, value_name = "COUNT", default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..))]
    pub count: u32,
    /// How long lines are, in seconds as in 2s or in metres as in 1.5m [default: the
    /// height that the camera sees at camera.look_at]
    #[arg(long, value_name = "LENGTH", verbatim_doc_comment)]
    pub length: Option<Length>,
    /// Longest step [s] [default: a quarter of a frame]
    #[arg(long, value_name = "SECONDS", value_parser = places::seconds)]
    pub step: Option<f64>,
    /// Where the plane of --seeds plane is.
    #[command(flatten)]
    pub plane: PlaneArguments,
}

/// Where lines begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SeedPlace {
    /// All over the emitters of the scene
    Emitters,
    /// All over a plane, one line in each field of a grid
    Plane,
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

/// Flags of `inspect`.
#[derive(Debug, Args)]
pub struct InspectImageArguments {
    /// The picture (.exr, .hdr, .png)
    pub image: PathBuf,
    /// Print all channels of this pixel, from the top left
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true)]
    pub pixel: Option<PixelPlace>,
    /// Print the least, largest and mean number of each channel, and count what should not be there
    #[arg(long)]
    pub stats: bool,
    /// Print the names of all channels and what is known of the picture; also without any flag
    #[arg(long)]
    pub layers: bool,
    /// Refuse pictures that need more memory than this [GiB], as 4, 4G or 512M
    #[arg(long, value_name = "AMOUNT", default_value = "8")]
    pub memory_limit: Memory,
}

/// Flags of `schema`.
#[derive(Debug, Args)]
pub struct SchemaArguments {
    /// That of the suites of `regress` instead
    #[arg(long)]
    pub suite: bool,
}

/// Flags of `regress`.
#[derive(Debug, Args)]
pub struct RegressArguments {
    /// The suite file (YAML)
    pub suite: PathBuf,
    /// Cases to run [default: all]; several with commas
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    pub only: Vec<String>,
    /// Make the references anew instead of comparing
    #[arg(long, conflicts_with_all = ["report", "junit"])]
    pub update: bool,
    /// Why the pictures should change, which references and their log keep
    #[arg(long, value_name = "TEXT", requires = "update")]
    pub reason: Option<String>,
    /// Write a page with all pictures and figures to this folder, and the pictures of
    /// cases that fail
    #[arg(long, value_name = "FOLDER", verbatim_doc_comment)]
    pub report: Option<PathBuf>,
    /// Write the verdicts as JUnit XML
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// Run the commands of cases that have one, by the shell
    #[arg(long)]
    pub run_commands: bool,
    /// Threads [default: one for each processor]; results never depend on it
    #[arg(short = 'j', long, value_name = "COUNT")]
    pub threads: Option<usize>,
    /// How to show progress on standard error
    #[arg(long, value_enum, default_value_t = Style::None)]
    pub progress: Style,
    /// Refuse pictures that need more memory than this [GiB], as 4, 4G or 512M
    #[arg(long, value_name = "AMOUNT", default_value = "8")]
    pub memory_limit: Memory,
}

/// Flags of `denoise`.
#[derive(Debug, Args)]
pub struct DenoiseArguments {
    /// The picture (.exr), best with layers of albedo and normal (output.aovs)
    pub image: PathBuf,
    /// The picture with a layer more: all channels of the first, and denoised.R, .G, .B
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Also a .png of the denoised colours
    #[arg(long, value_name = "FILE")]
    pub preview: Option<PathBuf>,
    /// Make R, G and B the denoised ones; those that were rendered become noisy.R, .G, .B
    #[arg(long)]
    pub replace: bool,
    /// Denoise albedo and normal first: for few paths a pixel, blur of motion or lens
    #[arg(long)]
    pub prefilter: bool,
    /// Threads [default: one for each processor]
    #[arg(short = 'j', long, value_name = "COUNT", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub threads: Option<u16>,
    /// Refuse pictures that need more memory than this [GiB], as 4, 4G or 512M
    #[arg(long, value_name = "AMOUNT", default_value = "8")]
    pub memory_limit: Memory,
}

/// Flags of `sheet`.
#[derive(Debug, Args)]
pub struct SheetArguments {
    /// The pictures (.exr, .hdr, .png), in their order from left to right and top to bottom
    #[arg(required = true)]
    pub images: Vec<PathBuf>,
    /// The sheet (.png)
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Pictures side by side [default: as many as make the sheet about as wide as a screen]
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..))]
    pub columns: Option<u32>,
    /// Scale wider pictures down to this width in pixels
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..))]
    pub width: Option<u32>,
    /// How light is mapped to the screen; .png pictures are shown as they are
    #[arg(long, value_enum, default_value_t = ViewChoice::Standard)]
    pub view: ViewChoice,
    /// Stops of exposure; not of .png pictures
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub exposure: f64,
    /// Leave names out
    #[arg(long)]
    pub no_labels: bool,
    /// Refuse pictures that need more memory than this [GiB], as 4, 4G or 512M
    #[arg(long, value_name = "AMOUNT", default_value = "8")]
    pub memory_limit: Memory,
}

/// How light is mapped to the screen: those of `output.view`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
pub enum ViewChoice {
    /// Cut at 1, sRGB transfer curve
    Standard,
    /// Khronos PBR Neutral: highlights rolled off above 0.8
    Neutral,
    /// AgX as Blender shows it
    Agx,
    /// A colour for each stop of luminance
    FalseColor,
    /// Cut at 1, no transfer curve
    Raw,
}

impl From<ViewChoice> for View {
    fn from(choice: ViewChoice) -> Self {
        match choice {
            ViewChoice::Standard => Self::Standard,
            ViewChoice::Neutral => Self::Neutral,
            ViewChoice::Agx => Self::Agx,
            ViewChoice::FalseColor => Self::FalseColor,
            ViewChoice::Raw => Self::Raw,
        }
    }
}

/// Flags of `warp`.
#[derive(Debug, Args)]
pub struct WarpArguments {
    /// The picture (.exr, .hdr, .png)
    pub image: PathBuf,
    /// The warped picture: .exr with all channels, or .png
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Size of the swirls, as a share of the picture's shorter edge
    #[arg(long, value_name = "SHARE", default_value_t = 0.25)]
    pub length: f64,
    /// Length of ways at the root mean square speed, as a share of the shorter edge;
    /// backwards where negative
    #[arg(long, value_name = "SHARE", default_value_t = 0.25, allow_negative_numbers = true, verbatim_doc_comment)]
    pub distance: f64,
    /// Steps that the way is cut into
    #[arg(long, value_name = "COUNT", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub steps: u32,
    /// How each step is taken
    #[arg(long, value_enum, default_value_t = WarpIntegrator::Rk4)]
    pub integrator: WarpIntegrator,
    /// How often a point is put back on its line after each step
    #[arg(long, value_name = "COUNT", default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=100))]
    pub reprojections: u32,
    /// Which swirls
    #[arg(long, value_name = "NUMBER", default_value_t = 0)]
    pub seed: u64,
    /// Let swirls end at a circle of this radius, as a share of the shorter edge; beyond
    /// it things only turn about its middle
    #[arg(long, value_name = "RADIUS", verbatim_doc_comment)]
    pub circle: Option<f64>,
    /// Middle of the circle from the top left corner, in shares of the picture's width
    /// and height
    #[arg(
        long,
        value_name = "X,Y",
        default_value = "0.5,0.5",
        value_delimiter = ',',
        allow_hyphen_values = true,
        requires = "circle",
        verbatim_doc_comment
    )]
    pub center: Vec<f64>,
    /// How deep inside the circle swirls are free [default: 0.8 of its radius]
    #[arg(long, value_name = "DEPTH", requires = "circle")]
    pub fade: Option<f64>,
    /// Refuse pictures that need more memory than this [GiB], as 4, 4G or 512M
    #[arg(long, value_name = "AMOUNT", default_value = "8")]
    pub memory_limit: Memory,
}

/// Flags of `points`.
#[derive(Debug, Args)]
pub struct PointsArguments {
    /// Dimensions of the cube
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u8).range(2..=7))]
    pub dim: u8,
    /// How points are chosen
    #[arg(long, value_enum, default_value_t = PointsMethod::Curl)]
    pub method: PointsMethod,
    /// Lattice points along each axis; methods without a lattice make as many in all
    #[arg(long, value_name = "COUNT", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub per_axis: u32,
    /// Where to write: .csv, .npy or .ply, with #### for the frame of --frames
    #[arg(short, long, value_name = "FILE")]
    pub output: String,
    /// Draw the radial distribution function (of the last frame), to a .png file
    #[arg(long, value_name = "FILE")]
    pub plot: Option<PathBuf>,
    /// Which of many sets
    #[arg(long, value_name = "NUMBER", default_value_t = 0)]
    pub seed: u64,
    /// curl: size of the noise in lattice spacings [default: the best by measurement]
    #[arg(long, value_name = "SPACINGS")]
    pub length: Option<f64>,
    /// curl: how far points move, in mean distances to the neighbours on the lattice, at
    /// the root mean square of the noise's gradients [default: the best by measurement]
    #[arg(long, value_name = "DISTANCES", allow_negative_numbers = true, verbatim_doc_comment)]
    pub step: Option<f64>,
    /// curl: keep points in a ball of this radius in the middle of the cube (edges of
    /// the cube); only those that begin in it are made
    #[arg(long, value_name = "RADIUS", verbatim_doc_comment)]
    pub ball: Option<f64>,
    /// curl: how deep below the wall of the ball noise is free [default: 0.8 of its radius]
    #[arg(long, value_name = "DEPTH", requires = "ball")]
    pub fade: Option<f64>,
    /// curl: frames of an animation, each to a file of its own
    #[arg(short, long, value_name = "LIST", allow_hyphen_values = true)]
    pub frames: Option<String>,
    /// curl: how far the noise moves from frame to frame, in lattice spacings
    #[arg(long, value_name = "SPACINGS", default_value_t = 0.005, requires = "frames", allow_negative_numbers = true)]
    pub speed: f64,
    /// poisson: least distance between points [default: one lattice spacing]
    #[arg(long, value_name = "DISTANCE")]
    pub radius: Option<f64>,
    /// Refuse what needs more memory than this [GiB], as 4, 4G or 512M
    #[arg(long, value_name = "AMOUNT", default_value = "8")]
    pub memory_limit: Memory,
}

/// How points of a cube are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PointsMethod {
    /// A lattice moved along divergence-free vector noise
    Curl,
    /// A lattice, each point anywhere in its cell
    Jitter,
    /// At random, but none closer to another than a radius
    Poisson,
    /// The sequence of Sobol', scrambled; the nearest power of two of points
    Sobol,
    /// A lattice as it is
    Lattice,
}

/// How a step is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum WarpIntegrator {
    /// One evaluation
    Euler,
    /// Four: classical Runge–Kutta
    Rk4,
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
