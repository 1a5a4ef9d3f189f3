//! Tables 1 and 2 and figures 4 and 5 of *Improving Curl Noise* (Bærentzen et al. 2025) with our own figures beside those
//! that were published: `make paper-tables` writes docs/paper-tables.md.

#![allow(clippy::print_stdout, reason = "what it is for")]

use curlsmoke::flow::reproject::{Integrator, Repetition, Reprojection, Trace};
use curlsmoke::inspect::point_plot;
use curlsmoke::inspect::warp::Warp;
use curlsmoke::math::hash::Seed;
use curlsmoke::output::file::write_atomic;
use curlsmoke::output::image::{Image, SampleKind};
use curlsmoke::output::png::{self, View};
use curlsmoke::points::PointSet;
use curlsmoke::points::jitter::{CurlJitter, random_jitter};
use curlsmoke::points::nearest::{least_and_median, nearest_distances, radial_distribution};
use curlsmoke::points::poisson::poisson_disks;
use curlsmoke::points::sobol::sobol;
use std::fmt::Write;
use std::path::Path;
use std::time::Instant;

/// Points along each axis in 3 to 7 dimensions.
const PER_AXIS: [u32; 5] = [10, 10, 10, 7, 6];
/// What was published of curl noise jittering, jittering, Poisson disks and Sobol': median, least, seconds.
const TABLE_1: [[[f64; 3]; 4]; 5] = [
    [[0.083, 0.044, 1.0], [0.069, 0.015, 1.0], [0.104, 0.100, 0.0], [0.071, 0.031, 0.0]],
    [[0.081, 0.034, 2.0], [0.069, 0.010, 1.0], [0.104, 0.100, 3.0], [0.074, 0.030, 0.0]],
    [[0.083, 0.023, 21.0], [0.073, 0.011, 8.0], [0.103, 0.092, 104.0], [0.071, 0.019, 10.0]],
    [[0.136, 0.039, 31.0], [0.118, 0.057, 7.0], [0.103, 0.084, 651.0], [0.078, 0.025, 23.0]],
    [[0.176, 0.071, 105.0], [0.146, 0.087, 20.0], [0.102, 0.080, 11_000.0], [0.081, 0.030, 501.0]],
];
const METHODS: [&str; 4] = ["curl", "jitter", "Poisson", "Sobol'"];
/// Published with Poisson disks of this radius in every dimension.
const RADIUS: f64 = 0.1;

/// Integrator, steps, reprojections; frames a second and root mean square error that were published.
const TABLE_2: [(Integrator, u32, u32, f64, f64); 12] = [
    (Integrator::Euler, 64, 0, 158.262, 8.671),
    (Integrator::Euler, 64, 1, 105.269, 7.685),
    (Integrator::Euler, 64, 10, 33.836, 7.444),
    (Integrator::Euler, 512, 0, 46.464, 7.968),
    (Integrator::Euler, 512, 1, 26.615, 3.617),
    (Integrator::Euler, 512, 10, 4.241, 2.777),
    (Integrator::RungeKutta, 64, 0, 70.388, 6.625),
    (Integrator::RungeKutta, 64, 1, 53.717, 3.861),
    (Integrator::RungeKutta, 64, 10, 28.397, 3.882),
    (Integrator::RungeKutta, 512, 0, 16.129, 0.504),
    (Integrator::RungeKutta, 512, 1, 11.976, 0.1),
    (Integrator::RungeKutta, 512, 10, 3.558, 0.098),
];

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    let mut text = String::from(INTRODUCTION);
    points(&folder, &mut text);
    warps(&folder, &mut text);
    write_atomic(&folder.join("paper-tables.md"), text.as_bytes()).expect("docs/ can be written");
}

const INTRODUCTION: &str = "\
# Improving Curl Noise, in figures

Written by `make paper-tables`: what Bærentzen, Martínez, Frisvad and Lefebvre published in 2025, and what this program does. Times
are of the machine that the command ran on, those published of an Apple M1 Max.

";

fn points(folder: &Path, text: &mut String) {
    text.push_str(
        "## Table 1: points of a cube\n\nMedian distance to the closest point (least distance): seconds. Ours, then as \
         published.\n\n| n | points | curl | | jitter | | Poisson | | Sobol' | |\n|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for (i, per_axis) in PER_AXIS.into_iter().enumerate() {
        let dimension = i + 3;
        let count = u64::from(per_axis).pow(dimension as u32);
        let _ = write!(text, "| {dimension} | {per_axis}^{dimension} ");
        for (method, name) in METHODS.into_iter().enumerate() {
            let start = Instant::now();
            let set: PointSet = match method {
                0 => CurlJitter::best(dimension).apply(dimension, per_axis),
                1 => random_jitter(dimension, per_axis, Seed(1)),
                2 => poisson_disks(dimension, count, RADIUS, Seed(1)),
                _ => sobol(dimension, 1 << (count as f64).log2().round() as u32, Seed(1)),
            };
            let seconds = start.elapsed().as_secs_f64();
            let [least, median] = least_and_median(&mut nearest_distances(&set));
            let published = TABLE_1[i][method];
            let _ = write!(text, "| {median:.3} ({least:.3}): {seconds:.2} ");
            let _ = write!(text, "| {:.3} ({:.3}): {} ", published[0], published[1], published[2]);
            println!("{dimension} {name}: {} points, {median:.4} ({least:.4}), {seconds:.2} s", set.len());
            let reach = 3.0 * (1.0 / set.len() as f64).powf(1.0 / dimension as f64);
            let title = format!("{name}, {dimension} dimensions");
            let plot = point_plot::paint(&title, &radial_distribution(&set, reach, 100), median, [320, 220]);
            let file = folder.join(format!("paper/points-{dimension}-{method}.png"));
            write_atomic(&file, &plot.to_png().expect("a small picture")).expect("docs/paper/ can be written");
        }
        text.push_str("|\n");
    }
    text.push_str(AFTER_TABLE_1);
    text.push_str("## Figure 4: radial distribution functions\n\nThe median distance is dashed.\n\n");
    for dimension in 3..8 {
        for method in 0..4 {
            let _ = write!(text, "![](paper/points-{dimension}-{method}.png) ");
        }
        text.push('\n');
    }
    text.push('\n');
}

const AFTER_TABLE_1: &str = "
Where they differ:

- The length of noise and the constant of the step were not published; ours are in `src/points/jitter.rs`. Every step lowers the
  lattice's own median: in three and four dimensions ours is about the longest that still reaches what was published.
- Poisson disks stop at the lattice's number of points; ours are never closer than the radius, where those published are
  from five dimensions on.
- Sobol' points are scrambled after Owen; from six dimensions on the published seconds are of another number of points, as their medians tell.

";

fn waves(size: [u32; 2]) -> Image {
    let mut image = Image::new(size);
    let edge = f64::from(size[1]);
    let wave = |i: u32| {
        let (x, y) = (f64::from(i % size[0]) / edge, f64::from(i / size[0]) / edge);
        (0.5 + 0.5 * (80.0 * (x + 0.04 * (9.0 * y).sin())).sin()) as f32
    };
    image.push("Y", SampleKind::Float, (0..size[0] * size[1]).map(wave).collect());
    image
}

fn warps(folder: &Path, text: &mut String) {
    let warp = |integrator, steps, reprojections| Warp {
        length: 0.25,
        distance: 1.5,
        trace: Trace {
            steps,
            integrator,
            reprojection: Reprojection::Newton(Repetition { steps: reprojections, tolerance: 0.0 }),
        },
        seed: Seed(3),
    };
    let (large, small) = (waves([3840, 2160]), waves([1024, 576]));
    let truth = warp(Integrator::RungeKutta, 1000, 2).apply(&large);
    text.push_str(
        "## Table 2: a picture of waves, warped\n\nRoot mean square error of 3840 × 2160 pixels, in steps of 255, against \
         1000 steps of Runge and Kutta with two reprojections; frames a second of 1024 × 576 pixels. Ours is this machine's \
         processor, theirs a graphics processor.\n\n| | steps | reprojections | RMSE | published | frames/s | \
         published |\n|---|---|---|---|---|---|---|\n",
    );
    for (integrator, steps, reprojections, their_rate, their_error) in TABLE_2 {
        let own = warp(integrator, steps, reprojections);
        let image = own.apply(&large);
        let (a, b) = (&image.channels[0].data, &truth.channels[0].data);
        let square = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / a.len() as f64;
        let error = 255.0 * square.sqrt();
        let start = Instant::now();
        let picture = own.apply(&small);
        let rate = 1.0 / start.elapsed().as_secs_f64();
        let name = if integrator == Integrator::Euler { "Euler" } else { "RK4" };
        println!("{name} {steps} {reprojections}: {error:.3}, {rate:.2} frames a second");
        let _ = writeln!(
            text,
            "| {name} | {steps} | {reprojections} | {error:.3} | {their_error} | {rate:.2} | {their_rate} |"
        );
        if reprojections < 10 {
            let grey: Vec<[f32; 3]> = picture.channels[0].data.iter().map(|v| [*v; 3]).collect();
            let file = folder.join(format!("paper/warp-{}-{steps}-{reprojections}.png", name.to_lowercase()));
            let bytes = png::encode(&grey, picture.data_size, View::Standard, 0.0).expect("a small picture");
            write_atomic(&file, &bytes).expect("docs/paper/ can be written");
        }
    }
    text.push_str("\n## Figure 5: those pictures\n\nWithout reprojection and with one, 64 steps and 512.\n\n");
    for name in ["euler", "rk4"] {
        for (steps, reprojections) in [(64, 0), (64, 1), (512, 0), (512, 1)] {
            let _ = write!(text, "<img src=\"paper/warp-{name}-{steps}-{reprojections}.png\" width=\"220\"> ");
        }
        text.push('\n');
    }
}
