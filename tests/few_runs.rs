//! Pictures compared with references of few runs, and pictures whose paths are splatted: the statistical test must hold its rate of
//! false alarms, and still see what is wrong.

use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::statistics::Moments;
use curlsmoke::output::agreement::{RUNS_ATTRIBUTE, SPP_ATTRIBUTE, StatisticalSettings};
use curlsmoke::output::compare::{Mode, Report, compare};
use curlsmoke::output::image::{Attribute, Image, SampleKind};

const WIDTH: usize = 64;
const HEIGHT: usize = 48;
/// Paths of a pixel.
const PATHS: u32 = 8;

/// What a run sees: a white disk on black, without any noise but at its edge, where a path meets it by chance; on the right a slope
/// of light as noisy as smoke. `fault` changes the light of a pixel.
fn run(key: u64, fault: impl Fn(usize, usize, f64) -> f64) -> Vec<f64> {
    let mut rng = CounterRng::new(Seed(key));
    let mut uniform = || f64::from(rng.uniform());
    let mut pixel = |x: usize, y: usize| {
        let path = |_| match x {
            44.. => -(0.05 + 0.01 * y as f64) * (1.0 - uniform()).ln(),
            _ => f64::from((x as f64 + uniform() - 21.3).hypot(y as f64 + uniform() - 24.7) < 15.2),
        };
        fault(x, y, (0..PATHS).map(path).sum::<f64>() / f64::from(PATHS))
    };
    (0..WIDTH * HEIGHT).map(|i| pixel(i % WIDTH, i / WIDTH)).collect()
}

fn sound(_: usize, _: usize, light: f64) -> f64 {
    light
}

fn picture(values: &[f64], samples: u32) -> Image {
    let mut image = Image::new([WIDTH as u32, HEIGHT as u32]);
    let rgb: Vec<[f32; 3]> = values.iter().map(|&v| [v as f32; 3]).collect();
    image.push_rgb("", SampleKind::Float, &rgb);
    image.set_attribute(SPP_ATTRIBUTE, Attribute::Int(samples as i32));
    image
}

/// The mean of so many runs, with the variance between them.
fn reference(of: impl Fn(u64) -> Vec<f64>, key: u64, runs: u32) -> Image {
    let mut moments = vec![Moments::default(); WIDTH * HEIGHT];
    for i in 0..u64::from(runs) {
        moments.iter_mut().zip(of(key + i)).for_each(|(m, value)| m.push(value));
    }
    let mut image = picture(&moments.iter().map(Moments::mean).collect::<Vec<_>>(), runs);
    let variance: Vec<[f32; 3]> = moments.iter().map(|m| [m.variance_of_mean() as f32; 3]).collect();
    image.push_rgb("variance", SampleKind::Float, &variance);
    image.set_attribute(RUNS_ATTRIBUTE, Attribute::Int(runs as i32));
    image
}

fn verdict(values: &[f64], reference: &Image) -> Report {
    compare(&picture(values, 1), reference, None, Mode::Statistical(StatisticalSettings::default())).unwrap()
}

fn failed(report: &Report, check: &str) -> bool {
    report.findings.iter().any(|finding| finding.check == check && !finding.passed)
}

/// False alarms of so many comparisons, each with a reference of its own.
fn alarms(of: impl Fn(u64) -> Vec<f64>, runs: u32, count: u64) -> usize {
    let is_alarm = |i: &u64| !verdict(&of(1000 * i), &reference(&of, 1000 * i + 1, runs)).passed();
    (0..count).filter(is_alarm).count()
}

#[test]
fn few_runs_that_agree_by_chance_at_edges_raise_no_alarm() {
    for runs in [2, 3, 4, 8, 16] {
        // At 1 %, 0.8 are expected, and more than 5 with a probability of 0.03 %.
        let alarms = alarms(|key| run(key, sound), runs, 80);
        assert!(alarms <= 5, "{alarms} false alarms of 80 with {runs} runs");
    }
}

#[test]
fn few_runs_see_single_pixels_a_region_and_a_little_light_everywhere() {
    for runs in [2, 4, 16] {
        let reference = reference(|key| run(key, sound), 1, runs);
        // Of 3072 pixels 8 may fail: ten in the noise, in the dark, at the edge.
        let some = |x0: usize, y0: usize| move |x: usize, y: usize| (x0..x0 + 10).contains(&x) && y == y0;
        for (place, by) in [(some(50, 20), 4.0), (some(1, 2), 0.3), (some(16, 10), -1.0)] {
            let report = verdict(&run(500, |x, y, light| light + if place(x, y) { by } else { 0.0 }), &reference);
            // Of two runs the blocks of some of these are seen, of many the pixels.
            assert!(!report.passed(), "{runs} runs, {by}: {report}");
            assert!(runs < 16 || failed(&report, "pixels"), "{runs} runs, {by}: {report}");
        }
        let region = |x: usize, y: usize, light: f64| if x >= 48 && y >= 32 { 0.7 * light } else { light };
        assert!(failed(&verdict(&run(501, region), &reference), "blocks"), "{runs}");
        let brighter = verdict(&run(502, |_, _, light| 1.05 * light), &reference);
        assert!(!brighter.passed(), "{runs} runs: {brighter}");
    }
}

/// Noise of which every pixel gets a part of its neighbours', as of a renderer that splats.
fn splatted(key: u64, scale: f64) -> Vec<f64> {
    let mut rng = CounterRng::new(Seed(key ^ 0x5eed));
    let light: Vec<f64> = (0..(WIDTH + 2) * (HEIGHT + 2))
        .map(|_| (0..PATHS).map(|_| -(1.0 - f64::from(rng.uniform())).ln()).sum::<f64>() / f64::from(PATHS))
        .collect();
    let weights = [0.25, 0.5, 0.25];
    let part = |x: usize, y: usize| {
        let pairs = (0..3).flat_map(|dy| (0..3).map(move |dx| (dx, dy)));
        pairs.map(|(dx, dy)| weights[dx] * weights[dy] * light[(y + dy) * (WIDTH + 2) + x + dx]).sum::<f64>()
    };
    (0..WIDTH * HEIGHT).map(|i| scale * (0.3 + 0.01 * (i % WIDTH) as f64) * part(i % WIDTH, i / WIDTH)).collect()
}

#[test]
fn errors_that_neighbours_share_raise_no_alarm_and_hide_little() {
    for runs in [2, 4, 16] {
        let alarms = alarms(|key| splatted(key, 1.0), runs, 60);
        assert!(alarms <= 4, "{alarms} false alarms of 60 with {runs} runs");
        let reference = reference(|key| splatted(key, 1.0), 1, runs);
        assert!(failed(&verdict(&splatted(700, 1.1), &reference), "image"), "{runs} runs");
    }
}
