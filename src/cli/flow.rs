//! `curlsmoke flow slice`.

use crate::cli::args::InspectArguments;
use crate::cli::frames::{frames, listed, load_scene, overrides, start_threads};
use crate::cli::places::{Extent, Plane};
use crate::cli::values::Resolution;
use crate::cli::{log, print_result};
use crate::error::Error;
use crate::inspect::plane::{Rectangle, choose};
use crate::inspect::slice::{BYTES_PER_PIXEL, Slice};
use crate::inspect::slice_picture::{Painter, Quantity};
use crate::inspect::{InspectError, Inspection};
use crate::output::exr::{self, Compression};
use crate::output::file::{check_writable, write_atomic};
use crate::output::image::{Attribute, Image, SampleKind};
use crate::pipeline;
use crate::scene::Scene;
use clap::{Args, Subcommand, ValueEnum};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Pixels of a slice where nothing else is said.
const RESOLUTION: [u32; 2] = [640, 360];

/// Ways to look at a flow.
#[derive(Debug, Subcommand)]
pub enum FlowVerb {
    /// Draw the flow on a plane, and write its numbers as an .exr file
    #[command(
        after_help = "Example: curlsmoke flow slice scenes/plume.yaml --plane z=0 --quantity lic,divergence -o out/flow"
    )]
    Slice(SliceArguments),
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

/// Looks at the flow; the exit code.
pub(super) fn run(verb: &FlowVerb) -> Result<u8, Error> {
    match verb {
        FlowVerb::Slice(arguments) => slice(arguments),
    }
}

fn slice(arguments: &SliceArguments) -> Result<u8, Error> {
    let quantities = quantities(&arguments.quantity);
    let files = SliceFiles::new(&arguments.output, &quantities);
    let (scene, frame, inspection) = open(&arguments.common)?;
    let size = resolution(arguments)?;
    let rectangle = rectangle(&inspection, &arguments.plane, size)?;
    check_square(rectangle.size(), size)?;
    let what = format!("a slice of {} × {} pixels", size[0], size[1]);
    let bytes = (u64::from(size[0]) * u64::from(size[1])).saturating_mul(BYTES_PER_PIXEL);
    inspection.check_memory(what, bytes, "choose a smaller --resolution")?;
    if quantities.contains(&Quantity::Distance) && !inspection.has_obstacles() {
        return Err(InspectError::NoObstacles.into());
    }
    files.all().try_for_each(|path| check_writable(path))?;

    let slice = Slice::sample(&inspection.frozen(), inspection.time(), rectangle, size);
    let mut painter = Painter::new(&slice, inspection.seed());
    let mut image = slice.to_image();
    let mut report = format!("{}\n{}", headline(&rectangle, size, frame), slice.summary());
    for (quantity, path) in quantities.iter().zip(&files.pictures) {
        match quantity {
            Quantity::Stream => {
                let stream = painter.stream();
                let explained = 100.0 * stream.explained;
                report += &format!("\nstream function: accounts for {explained:.1} % of the flow in the plane");
                let values = stream.values.iter().map(|&v| v as f32).collect();
                image.push(quantity.name(), SampleKind::Float, values);
            }
            Quantity::Lic => image.push(quantity.name(), SampleKind::Float, painter.lic().to_vec()),
            _ => {}
        }
        write_atomic(path, &painter.paint(*quantity).to_png()?)?;
    }
    describe(&mut image, &scene, frame, &rectangle);
    write_atomic(&files.numbers, &exr::write(&image, Compression::Zip)?)?;
    let names: Vec<String> = files.all().map(|path| path.display().to_string()).collect();
    print_result(&format!("{}: {report}", names.join(", "))).map(|()| 0)
}

/// The scene of a command, the frame it looks at, and what there is to see.
pub(super) fn open(arguments: &InspectArguments) -> Result<(Scene, i32, Inspection), Error> {
    let common = arguments.to_frame_arguments();
    let scene = load_scene(&common.scene, &overrides(&common), listed(common.frames.as_deref())?.as_deref())?;
    let frame = frames(&common, &scene)?.first().copied().unwrap_or(scene.settings.frames.first);
    start_threads(common.threads)?;
    let inspection = pipeline::inspection(&scene, frame)?;
    inspection.warnings().iter().for_each(|warning| log(warning));
    Ok((scene, frame, inspection))
}

/// The rectangle that flags ask for, for a picture of `size` pixels.
pub(super) fn rectangle(
    inspection: &Inspection,
    arguments: &PlaneArguments,
    size: [u32; 2],
) -> Result<Rectangle, Error> {
    let choice = arguments.plane.map(|plane| plane.0).unwrap_or_default();
    let aspect = f64::from(size[0]) / f64::from(size[1]);
    choose(choice, arguments.size.map(|size| size.0), aspect, inspection.camera())
        .ok_or_else(|| Error::Usage("--plane: the normal has no direction; write for example 0,1,0,0,0,1".into()))
}

/// In pixels: those asked for, else the usual width with the height that makes pixels square.
fn resolution(arguments: &SliceArguments) -> Result<[u32; 2], Error> {
    match (arguments.resolution, arguments.plane.size) {
        (Some(resolution), _) => Ok(resolution.pixels(RESOLUTION)),
        (None, None) => Ok(RESOLUTION),
        (None, Some(size)) => {
            let height = (f64::from(RESOLUTION[0]) * size.0[1] / size.0[0]).round();
            Ok([RESOLUTION[0], height.clamp(1.0, f64::from(u32::MAX)) as u32])
        }
    }
}

/// Lines would be bent in a picture that is stretched.
fn check_square([width, height]: [f64; 2], size: [u32; 2]) -> Result<(), Error> {
    let fitting = f64::from(size[0]) * height / width;
    if (fitting - f64::from(size[1])).abs() <= 1.0 {
        return Ok(());
    }
    Err(Error::Usage(format!(
        "{width} × {height} m on {} × {} pixels would be stretched; write --resolution {}x{}, or leave one of --size and \
         --resolution out",
        size[0],
        size[1],
        size[0],
        fitting.round().max(1.0)
    )))
}

/// Each once, in the order typed.
fn quantities(typed: &[SliceQuantity]) -> Vec<Quantity> {
    let mut quantities = Vec::new();
    for quantity in typed.iter().map(|&q| Quantity::from(q)) {
        if !quantities.contains(&quantity) {
            quantities.push(quantity);
        }
    }
    quantities
}

/// Names of the files of a slice.
struct SliceFiles {
    /// One for each quantity.
    pictures: Vec<PathBuf>,
    numbers: PathBuf,
}

impl SliceFiles {
    fn new(output: &Path, quantities: &[Quantity]) -> Self {
        let is_ours =
            output.extension().is_some_and(|e| e.eq_ignore_ascii_case("png") || e.eq_ignore_ascii_case("exr"));
        let stem = if is_ours { output.with_extension("") } else { output.to_path_buf() };
        let named = |ending: String| {
            let mut name: OsString = stem.clone().into_os_string();
            name.push(ending);
            PathBuf::from(name)
        };
        let picture = |q: &Quantity| match quantities.len() {
            1 => named(".png".into()),
            _ => named(format!(".{}.png", q.name())),
        };
        Self { pictures: quantities.iter().map(picture).collect(), numbers: named(".exr".into()) }
    }

    fn all(&self) -> impl Iterator<Item = &PathBuf> {
        self.pictures.iter().chain([&self.numbers])
    }
}

fn headline(rectangle: &Rectangle, size: [u32; 2], frame: i32) -> String {
    let [c, n] = [rectangle.center(), rectangle.normal()];
    let [width, height] = rectangle.size();
    format!(
        "frame {frame}, {width:.3} × {height:.3} m through ({:.3}, {:.3}, {:.3}) facing ({:.3}, {:.3}, {:.3}), {} × {} \
         pixels",
        c.x, c.y, c.z, n.x, n.y, n.z, size[0], size[1]
    )
}

fn describe(image: &mut Image, scene: &Scene, frame: i32, rectangle: &Rectangle) {
    let text = |s: String| Attribute::Text(s);
    let triple = |v: glam::DVec3| format!("{} {} {}", v.x, v.y, v.z);
    let [right, up] = rectangle.axes();
    let [width, height] = rectangle.size();
    image.set_attribute("curlsmoke/version", text(env!("CARGO_PKG_VERSION").into()));
    image.set_attribute("curlsmoke/scene", text(scene.text_hash.clone()));
    image.set_attribute("curlsmoke/frame", Attribute::Int(frame));
    image.set_attribute("curlsmoke/sliceCenter", text(triple(rectangle.center())));
    image.set_attribute("curlsmoke/sliceRight", text(triple(right * width)));
    image.set_attribute("curlsmoke/sliceUp", text(triple(up * height)));
}
