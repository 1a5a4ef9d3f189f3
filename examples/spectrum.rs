//! Measures the energy spectrum of `gain: kolmogorov` and draws it: `cargo run --release --example spectrum` writes
//! `docs/flow/spectrum.png`.
//!
//! The velocity in a box, under a window without steps at its faces, is taken apart into waves; the energy of all waves
//! of about the same length is one point of the spectrum.

use curlsmoke::flow::field::VelocityField;
use curlsmoke::flow::octaves::{OctavesSettings, kolmogorov_gain, octaves};
use curlsmoke::flow::source::{Potential, Source};
use curlsmoke::inspect::canvas::Canvas;
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::particles::advect::evaluate;
use rayon::prelude::*;
use std::error::Error;
use std::f32::consts::PI;
use std::path::Path;

/// Size of the largest swirls [m].
const LENGTH: f32 = 1.0;
const OCTAVES: u32 = 6;
/// Samples along each edge of the box, a power of two, and its edge [m]: four samples to the smallest swirls.
const SAMPLES: usize = 256;
const EDGE: f32 = 2.0 * LENGTH;
const BOXES: u64 = 4;
/// Points of the spectrum for each doubling of the wave number.
const PER_OCTAVE: f64 = 6.0;
const SIZE: [u32; 2] = [640, 360];

fn main() -> Result<(), Box<dyn Error>> {
    let settings = OctavesSettings {
        length_scale: f64::from(LENGTH),
        speed: 1.0,
        octaves: OCTAVES,
        lacunarity: 2.0,
        gain: kolmogorov_gain(2.0),
        seed: Seed(11),
        ..Default::default()
    };
    let sources = octaves(&settings).into_iter().map(|o| Source::from(Potential::Octave(o))).collect();
    let field = VelocityField::new(sources, Vec::new());
    // Energy of all waves of a class of wave numbers.
    let class = |k: f64| (k.log2() * PER_OCTAVE).round() as i32;
    let lowest = class(1.0 / f64::from(EDGE));
    let class_count = (class(SAMPLES as f64 / f64::from(EDGE)) - lowest) as usize + PER_OCTAVE as usize;
    let (mut energy, mut waves) = (vec![0.0f64; class_count], vec![0u64; class_count]);
    for n in 0..BOXES {
        for component in velocity_in_box(&field, n) {
            let power = powers(component);
            for (i, power) in power.iter().enumerate().skip(1) {
                let k = wave_number(i);
                let class = (class(k) - lowest) as usize;
                energy[class] += f64::from(*power);
                waves[class] += 1;
            }
        }
    }
    // Mean energy of a wave times the area of the sphere of such waves.
    let points: Vec<[f64; 2]> = (0..class_count)
        .filter(|&c| waves[c] > 100)
        .map(|c| {
            let k = 2f64.powf(f64::from(c as i32 + lowest) / PER_OCTAVE);
            [k.log10(), (energy[c] / waves[c] as f64 * k * k).log10()]
        })
        .filter(|p| p[0] <= (0.5 * SAMPLES as f64 / f64::from(EDGE)).log10())
        .collect();
    // From the size of the largest to that of the smallest swirls.
    let [low, high] = [1.0 / LENGTH, (1 << (OCTAVES - 1)) as f32 / LENGTH].map(|k| f64::from(k).log10());
    let inertial: Vec<[f64; 2]> =
        points.iter().copied().filter(|p| (low - 0.01..=high + 0.01).contains(&p[0])).collect();
    let (slope, offset) = fit(&inertial);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/flow/spectrum.png");
    std::fs::write(&path, draw(&points, slope, offset, [low, high]).to_png()?)?;
    if (slope + 5.0 / 3.0).abs() > 0.1 {
        return Err(format!("the slope is {slope:.3} and not Kolmogorov's −5/3").into());
    }
    Ok(())
}

/// Frequency along an axis of number `i` of a transform [cycles/m].
fn frequency(i: usize) -> f64 {
    let signed = if i < SAMPLES / 2 { i as f64 } else { i as f64 - SAMPLES as f64 };
    signed / f64::from(EDGE)
}

/// Of number `i` of the three-dimensional transform [cycles/m].
fn wave_number(i: usize) -> f64 {
    let [x, y, z] = [i % SAMPLES, i / SAMPLES % SAMPLES, i / SAMPLES / SAMPLES].map(frequency);
    (x * x + y * y + z * z).sqrt()
}

/// The components of the velocity at the samples of a box somewhere.
fn velocity_in_box(field: &VelocityField, n: u64) -> [Vec<f32>; 3] {
    let mut rng = CounterRng::new(Seed(n));
    let corner: [f32; 3] = std::array::from_fn(|_| (rng.uniform() - 0.5) * 200.0);
    let step = EDGE / SAMPLES as f32;
    let count = SAMPLES.pow(3);
    let axis = |stride: usize, a: usize| (0..count).map(|i| corner[a] + (i / stride % SAMPLES) as f32 * step).collect();
    let position = [axis(1, 0), axis(SAMPLES, 1), axis(SAMPLES * SAMPLES, 2)];
    let mut velocity = [0; 3].map(|_| vec![0.0; count]);
    evaluate(&field.span(0.0, 0.0), &position, &mut velocity);
    velocity
}

/// Squares of the absolute values of the transform under a window.
fn powers(samples: Vec<f32>) -> Vec<f32> {
    let window: Vec<f32> = (0..SAMPLES).map(|i| (PI * (i as f32 + 0.5) / SAMPLES as f32).sin().powi(2)).collect();
    let at = |i: usize| window[i % SAMPLES] * window[i / SAMPLES % SAMPLES] * window[i / SAMPLES / SAMPLES];
    let mut data: Vec<[f32; 2]> = samples.into_par_iter().enumerate().map(|(i, x)| [x * at(i), 0.0]).collect();
    for _ in 0..3 {
        data.par_chunks_mut(SAMPLES).for_each(transform);
        // The next axis comes to lie contiguous: (x, y, z) goes to (y, z, x).
        let plane = SAMPLES * SAMPLES;
        let turned = |i: usize| {
            let (y, z, x) = (i % SAMPLES, i / SAMPLES % SAMPLES, i / plane);
            data[z * plane + y * SAMPLES + x]
        };
        data = (0..data.len()).into_par_iter().map(turned).collect();
    }
    data.into_par_iter().map(|[re, im]| re * re + im * im).collect()
}

/// The fast Fourier transform of a power of two of complex numbers (Cooley and Tukey 1965).
fn transform(line: &mut [[f32; 2]]) {
    let n = line.len();
    for i in 0..n {
        let j = i.reverse_bits() >> (usize::BITS - n.trailing_zeros());
        if i < j {
            line.swap(i, j);
        }
    }
    let mut half = 1;
    while half < n {
        for start in (0..n).step_by(2 * half) {
            for i in 0..half {
                let (sin, cos) = (-PI * i as f32 / half as f32).sin_cos();
                let ([a, b], [c, d]) = (line[start + i], line[start + i + half]);
                let [re, im] = [c * cos - d * sin, c * sin + d * cos];
                line[start + i] = [a + re, b + im];
                line[start + i + half] = [a - re, b - im];
            }
        }
        half *= 2;
    }
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
    canvas.text([SIZE[0] - 300, 20], 1, "energy by wave number", ink);
    canvas.text([SIZE[0] - 300, 34], 1, &format!("fitted slope {slope:.3}, orange -5/3"), ink);
    canvas.text([SIZE[0] - 100, SIZE[1] - 20], 1, "cycles per metre", ink);
    canvas
}
