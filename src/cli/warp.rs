//! `curlsmoke warp`.

use crate::cli::print_result;
use crate::cli::values::Memory;
use crate::error::Error;
use crate::flow::reproject::{Integrator, Repetition, Reprojection, Trace};
use crate::inspect::warp::{Circle, Warp};
use crate::math::hash::Seed;
use crate::output::View;
use crate::output::exr::{self, Compression};
use crate::output::file::{check_writable, write_atomic};
use crate::output::{png, read_image};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Least size of swirls: smaller ones are no picture.
const LENGTH_MIN: f64 = 1e-4;
/// Furthest way.
const DISTANCE_MAX: f64 = 1e4;

/// Least radius of a circle.
const RADIUS_MIN: f64 = 1e-3;

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

/// How a step is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum WarpIntegrator {
    /// One evaluation
    Euler,
    /// Four: classical Runge–Kutta
    Rk4,
}

/// Warps; the exit code.
pub(super) fn run(arguments: &WarpArguments) -> Result<u8, Error> {
    let usage = |text: String| Err(Error::Usage(text));
    if !(LENGTH_MIN..=1e6).contains(&arguments.length) {
        return usage(format!("--length {}: write a share from {LENGTH_MIN} to 1000000", arguments.length));
    }
    if !(-DISTANCE_MAX..=DISTANCE_MAX).contains(&arguments.distance) {
        return usage(format!(
            "--distance {}: write a share from -{DISTANCE_MAX} to {DISTANCE_MAX}",
            arguments.distance
        ));
    }
    if let Err(text) = check_circle(arguments) {
        return usage(text);
    }
    let ending = arguments.output.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    if !["exr", "png"].contains(&ending.as_str()) {
        return usage(format!("--output {}: the name must end in .exr or .png", arguments.output.display()));
    }
    check_writable(&arguments.output)?;
    let image = read_image(&arguments.image, arguments.memory_limit.bytes())?;
    let trace = Trace {
        steps: arguments.steps,
        integrator: match arguments.integrator {
            WarpIntegrator::Euler => Integrator::Euler,
            WarpIntegrator::Rk4 => Integrator::RungeKutta,
        },
        reprojection: Reprojection::Newton(Repetition { steps: arguments.reprojections, tolerance: 0.0 }),
    };
    let circle = arguments.circle.map(|radius| {
        let edge = f64::from(image.data_size[0].min(image.data_size[1]));
        let center = [0, 1].map(|i| arguments.center[i] * f64::from(image.data_size[i]) / edge);
        Circle { center, radius, width: arguments.fade.unwrap_or(0.8 * radius) }
    });
    let seed = Seed(arguments.seed);
    let warp = Warp { length: arguments.length, distance: arguments.distance, trace, seed, circle };
    let warped = warp.apply(&image);
    let bytes = if ending == "exr" {
        exr::write(&warped, Compression::Zip)?
    } else {
        let Some(rgb) = warped.to_rgb("") else {
            let name = arguments.image.display();
            return usage(format!("{name}: has no channels R, G and B for a .png; write an .exr"));
        };
        png::encode(&rgb, warped.data_size, View::Standard, 0.0)?
    };
    write_atomic(&arguments.output, &bytes)?;
    let [width, height] = warped.data_size;
    print_result(&format!("{}: {width} × {height} pixels", arguments.output.display())).map(|()| 0)
}

/// What the flags of the circle ask for that cannot be, in a sentence.
fn check_circle(arguments: &WarpArguments) -> Result<(), String> {
    let Some(radius) = arguments.circle else { return Ok(()) };
    if !(RADIUS_MIN..=1e6).contains(&radius) {
        return Err(format!("--circle {radius}: write a share from {RADIUS_MIN} to 1000000"));
    }
    let [x, y] = arguments.center[..] else {
        return Err(format!("--center: {} numbers, where two belong: --center 0.5,0.5", arguments.center.len()));
    };
    if ![x, y].iter().all(|share| (-1e6..=1e6).contains(share)) {
        return Err(format!("--center {x},{y}: write two shares from -1000000 to 1000000"));
    }
    match arguments.fade {
        Some(fade) if !(fade > 0.0 && fade <= radius) => {
            Err(format!("--fade {fade}: write a share above 0 and up to the circle's {radius}"))
        }
        _ => Ok(()),
    }
}
