//! `curlsmoke points`.

use crate::cli::print_result;
use crate::cli::progress::count as spelled;
use crate::cli::values::Memory;
use crate::error::Error;
use crate::inspect::point_file::PointFormat;
use crate::inspect::{InspectError, point_plot};
use crate::math::hash::Seed;
use crate::output::file::{check_writable, write_atomic};
use crate::output::{extension, frames};
use crate::points::jitter::{BallBound, CurlJitter, random_jitter};
use crate::points::nearest::{least_and_median, nearest_distances, radial_distribution};
use crate::points::poisson::poisson_disks;
use crate::points::sobol::sobol;
use crate::points::{PointSet, lattice};
use crate::scene::pattern::Pattern;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use std::time::Instant;

/// Of the plot [pixels].
const PLOT: [u32; 2] = [640, 400];
/// How far the plot goes [mean distances between points], and its bins.
const REACH: f64 = 3.0;
const BINS: usize = 150;

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

/// Makes points; the exit code.
pub(super) fn run(arguments: &PointsArguments) -> Result<u8, Error> {
    let usage = |text: String| Err(Error::Usage(text));
    let dimension = usize::from(arguments.dim);
    if let Err(text) = check(arguments) {
        return usage(text);
    }
    let ending = extension(&PathBuf::from(&arguments.output));
    let Some(format) = PointFormat::from_extension(&ending) else {
        return usage(format!("--output {}: the name must end in .csv, .npy or .ply", arguments.output));
    };
    if format == PointFormat::Ply && dimension > 3 {
        return usage(format!("--output {}: .ply has three dimensions; write .csv or .npy", arguments.output));
    }
    if let Some(plot) = arguments.plot.as_ref().filter(|plot| extension(plot) != "png") {
        return usage(format!("--plot {}: the name must end in .png", plot.display()));
    }
    check_memory(arguments)?;
    let pattern =
        Pattern::parse(&arguments.output).map_err(|e| Error::Pattern(format!("--output {}", arguments.output), e))?;
    let list = match &arguments.frames {
        Some(text) => frames::parse(text)?.frames,
        None => vec![1],
    };
    let file_of = |frame| PathBuf::from(pattern.expand(frame, "points"));
    frames::check_distinct(&list, file_of)?;
    let files = list.iter().map(|&frame| file_of(frame));
    files.chain(arguments.plot.clone()).try_for_each(|path| check_writable(&path))?;

    for &frame in &list {
        let start = Instant::now();
        let set = points(arguments, frame);
        let seconds = start.elapsed().as_secs_f64();
        let file = file_of(frame);
        if set.len() < 2 {
            let advice = "choose more with --per-axis, a larger --ball or a smaller --radius";
            return usage(format!("{} points have no distances: {advice}", set.len()));
        }
        let [least, median] = least_and_median(&mut nearest_distances(&set));
        write_atomic(&file, &format.encode(&set))?;
        let count = spelled(set.len() as f64);
        print_result(&format!(
            "{}: {count} points in {seconds:.2} s; distance to the closest: median {median:.4}, least {least:.4}",
            file.display()
        ))?;
        if let Some(plot) = arguments.plot.as_ref().filter(|_| Some(&frame) == list.last()) {
            let mean = (1.0 / set.len() as f64).powf(1.0 / dimension as f64);
            let distribution = radial_distribution(&set, REACH * mean, BINS);
            let title = format!("{dimension} dimensions, {count} points");
            write_atomic(plot, &point_plot::paint(&title, &distribution, median, PLOT).to_png()?)?;
        }
    }
    Ok(0)
}

/// What the flags ask for that cannot be, in a sentence.
fn check(arguments: &PointsArguments) -> Result<(), String> {
    let is_curl = arguments.method == PointsMethod::Curl;
    let of_curl = [
        ("--length", arguments.length.is_some()),
        ("--step", arguments.step.is_some()),
        ("--ball", arguments.ball.is_some()),
        ("--frames", arguments.frames.is_some()),
    ];
    if let Some((flag, _)) = of_curl.iter().find(|(_, is_given)| *is_given && !is_curl) {
        return Err(format!("{flag} belongs to --method curl"));
    }
    if arguments.radius.is_some() && arguments.method != PointsMethod::Poisson {
        return Err("--radius belongs to --method poisson".into());
    }
    let within = |flag: &str, value: Option<f64>, low: f64, high: f64| match value {
        Some(x) if !(low..=high).contains(&x) => Err(format!("{flag} {x}: write a number from {low} to {high}")),
        _ => Ok(()),
    };
    within("--length", arguments.length, 1e-3, 1e6)?;
    within("--step", arguments.step, -1e3, 1e3)?;
    within("--ball", arguments.ball, 1e-3, 0.5)?;
    within("--fade", arguments.fade, 1e-6, arguments.ball.unwrap_or(0.5))?;
    within("--speed", Some(arguments.speed), -1e3, 1e3)?;
    // Buckets are not much finer than the lattice.
    within("--radius", arguments.radius, 0.25 / f64::from(arguments.per_axis), 1.0)?;
    if arguments.ball.is_some() {
        // What keeps points inside are steps shorter than the noise is long.
        within("--step with --ball", arguments.step, -10.0, 10.0)?;
        within("--length with --ball", arguments.length, 0.5, 1e6)?;
    }
    if arguments.ball.is_some() && arguments.plot.is_some() {
        return Err("--plot is of points that fill the cube: leave out --ball".into());
    }
    Ok(())
}

fn check_memory(arguments: &PointsArguments) -> Result<(), Error> {
    const GIB: f64 = (1u64 << 30) as f64;
    // The lattice, what becomes of it, the tree and the file.
    let bytes_per_point = 40.0 + 45.0 * f64::from(arguments.dim);
    // Sobol' rounds to a power of two.
    let rounding = if arguments.method == PointsMethod::Sobol { std::f64::consts::SQRT_2 } else { 1.0 };
    let count = f64::from(arguments.per_axis).powi(i32::from(arguments.dim)) * rounding;
    let (needed_gib, limit_gib) = (count * bytes_per_point / GIB, arguments.memory_limit.bytes() as f64 / GIB);
    if needed_gib > limit_gib || count >= f64::from(u32::MAX) {
        return Err(InspectError::OverMemoryLimit {
            what: format!("{count:.1e} points in {} dimensions", arguments.dim),
            needed_gib,
            limit_gib,
            advice: "choose a smaller --per-axis",
        }
        .into());
    }
    Ok(())
}

fn points(arguments: &PointsArguments, frame: i32) -> PointSet {
    let (dimension, per_axis, seed) = (usize::from(arguments.dim), arguments.per_axis, Seed(arguments.seed));
    // Below 2^32, as the memory for them was checked.
    let count = u64::from(per_axis).pow(dimension as u32);
    match arguments.method {
        PointsMethod::Lattice => lattice(dimension, per_axis),
        PointsMethod::Jitter => random_jitter(dimension, per_axis, 1.0, seed),
        PointsMethod::Poisson => {
            poisson_disks(dimension, count, arguments.radius.unwrap_or(1.0 / f64::from(per_axis)), seed)
        }
        PointsMethod::Sobol => sobol(dimension, 1 << (count as f64).log2().round() as u32, seed),
        PointsMethod::Curl => {
            let best = CurlJitter::best(dimension);
            let ball = arguments.ball.map(|radius| BallBound { radius, width: arguments.fade.unwrap_or(0.8 * radius) });
            let drift = if arguments.frames.is_some() { f64::from(frame) * arguments.speed } else { 0.0 };
            let (length, step) = (arguments.length.unwrap_or(best.length), arguments.step.unwrap_or(best.step));
            CurlJitter { length, step, seed, drift, ball }.apply(dimension, per_axis)
        }
    }
}
