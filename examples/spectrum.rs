//! Measures the energy spectrum of `gain: kolmogorov` and draws it: `cargo run --release --example spectrum` writes
//! `docs/flow/spectrum.png`.
//!
//! The spectrum is that of the velocity along straight lines, which in the inertial range falls with the same power as
//! the three-dimensional one (Pope 2000, *Turbulent Flows*, section 6.5).

use curlsmoke::flow::field::{Potential, Source, VelocityField};
use curlsmoke::flow::octaves::{OctavesSettings, kolmogorov_gain, octaves};
use curlsmoke::inspect::canvas::Canvas;
use curlsmoke::math::hash::{CounterRng, Seed};
use glam::DVec3;
use std::error::Error;
use std::f64::consts::TAU;
use std::path::Path;

/// Size of the largest swirls [m].
const LENGTH: f64 = 1.0;
const OCTAVES: u32 = 6;
/// Samples of a line, and their distance [m]: 64 of the largest swirls, four samples to the smallest.
const SAMPLES: usize = 8192;
const SPACING: f64 = 64.0 * LENGTH / SAMPLES as f64;
const LINES: u64 = 96;
const WAVENUMBERS: usize = 97;
const SIZE: [u32; 2] = [640, 360];

fn main() -> Result<(), Box<dyn Error>> {
    let settings = OctavesSettings {
        length_scale: LENGTH,
        speed: 1.0,
        octaves: OCTAVES,
        lacunarity: 2.0,
        gain: kolmogorov_gain(2.0),
        seed: Seed(11),
        ..Default::default()
    };
    let sources = octaves(&settings).into_iter().map(|o| Source::from(Potential::Octave(o))).collect();
    let field = VelocityField::new(sources, Vec::new());
    let span = field.span(0.0, 0.0);
    // From a quarter of the first octave's wavenumber to twice the last one's.
    let top = 2.0 * f64::from(1 << (OCTAVES - 1)) / LENGTH;
    let wavenumbers: Vec<f64> = (0..WAVENUMBERS)
        .map(|i| 0.25 / LENGTH * (top * LENGTH * 4.0).powf(i as f64 / (WAVENUMBERS - 1) as f64))
        .collect();
    let mut energy = vec![0.0; WAVENUMBERS];
    for line in 0..LINES {
        let mut rng = CounterRng::new(Seed(line));
        let mut random = || DVec3::from_array([0, 1, 2].map(|_| f64::from(rng.uniform()) - 0.5));
        let (start, along) = (random() * 400.0, random().normalize());
        let speeds: Vec<f64> = (0..SAMPLES)
            .map(|i| {
                let p = start + along * (SPACING * i as f64);
                // A window without steps at its ends, so that no energy leaks from the large to the small.
                let window = (0.5 * TAU * (i as f64 + 0.5) / SAMPLES as f64).sin().powi(2);
                window * along.dot(DVec3::from_array(span.velocity(p.to_array(), 0.0)))
            })
            .collect();
        for (k, sum) in wavenumbers.iter().zip(&mut energy) {
            let (mut re, mut im) = (0.0, 0.0);
            for (i, u) in speeds.iter().enumerate() {
                let (sin, cos) = (TAU * k * SPACING * i as f64).sin_cos();
                re += u * cos;
                im += u * sin;
            }
            *sum += (re * re + im * im) / LINES as f64;
        }
    }
    let points: Vec<[f64; 2]> = wavenumbers.iter().zip(&energy).map(|(k, e)| [k.log10(), e.log10()]).collect();
    // Between the peaks of the first and the last octave.
    let [low, high] = [(1.0 / LENGTH).log10(), (f64::from(1 << (OCTAVES - 1)) / LENGTH).log10()];
    let inertial: Vec<[f64; 2]> = points.iter().copied().filter(|p| (low..=high).contains(&p[0])).collect();
    let (slope, offset) = fit(&inertial);
    eprintln!(
        "slope {slope:.3} between {:.1} and {:.1} cycles/m; Kolmogorov's is -1.667",
        10f64.powf(low),
        10f64.powf(high)
    );
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/flow/spectrum.png");
    std::fs::write(&path, draw(&points, slope, offset, [low, high]).to_png()?)?;
    Ok(())
}

/// The straight line of least squares: slope and value at 0.
fn fit(points: &[[f64; 2]]) -> (f64, f64) {
    let n = points.len() as f64;
    let mean = |f: &dyn Fn(&[f64; 2]) -> f64| points.iter().map(f).sum::<f64>() / n;
    let (x, y) = (mean(&|p| p[0]), mean(&|p| p[1]));
    let slope = mean(&|p| (p[0] - x) * (p[1] - y)) / mean(&|p| (p[0] - x).powi(2));
    (slope, y - slope * x)
}

fn draw(points: &[[f64; 2]], slope: f64, offset: f64, fitted: [f64; 2]) -> Canvas {
    let bound = |axis: usize, pick: fn(f64, f64) -> f64| points.iter().map(|p| p[axis]).reduce(pick).unwrap_or(0.0);
    let (low, high) = ([bound(0, f64::min), bound(1, f64::min)], [bound(0, f64::max), bound(1, f64::max) + 0.3]);
    let [width, height] = SIZE.map(f64::from);
    let place = |p: [f64; 2]| {
        let share = [0, 1].map(|a| (p[a] - low[a]) / (high[a] - low[a]));
        [20.0 + share[0] * (width - 40.0), height - 30.0 - share[1] * (height - 50.0)]
    };
    let mut canvas = Canvas::from_fn(SIZE, |_| [0.006, 0.008, 0.012]);
    for decade in -1..=2 {
        let [x, _] = place([f64::from(decade), low[1]]);
        if (0.0..width).contains(&x) {
            canvas.fill([x as u32, 0], [1, SIZE[1] - 26], [0.05; 3], 1.0);
            canvas.text([x as u32 - 8, SIZE[1] - 20], 1, &format!("{}", 10f64.powi(decade)), [0.6; 3]);
        }
    }
    let line = |x: f64, slope: f64, offset: f64| place([x, slope * x + offset]);
    let mut stroke = |from: [f64; 2], to: [f64; 2], thick: u32, colour: [f32; 3]| {
        for i in 0..=600 {
            let t = f64::from(i) / 600.0;
            let p = [0, 1].map(|a| from[a] + t * (to[a] - from[a]));
            canvas.fill([p[0] as u32, p[1].max(0.0) as u32], [thick, thick], colour, 1.0);
        }
    };
    let kolmogorov = -5.0 / 3.0;
    let middle = 0.5 * (fitted[0] + fitted[1]);
    let lifted = offset + (slope - kolmogorov) * middle + 0.35;
    stroke(line(fitted[0], kolmogorov, lifted), line(fitted[1], kolmogorov, lifted), 1, [0.5, 0.25, 0.05]);
    stroke(line(fitted[0], slope, offset), line(fitted[1], slope, offset), 1, [0.8, 0.8, 0.8]);
    for pair in points.windows(2) {
        stroke(place(pair[0]), place(pair[1]), 2, [0.05, 0.35, 0.8]);
    }
    let ink = [0.85; 3];
    canvas.text([SIZE[0] - 300, 20], 1, "energy of the velocity along a line", ink);
    canvas.text([SIZE[0] - 300, 34], 1, &format!("fitted slope {slope:.3}, orange -5/3"), ink);
    canvas.text([SIZE[0] - 100, SIZE[1] - 20], 1, "cycles per metre", ink);
    canvas
}
