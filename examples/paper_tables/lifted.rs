//! Flows of the plane by surfaces: figures 9 and 10.

use crate::Report;
use crate::solids::{Camera, Picture};
use curlsmoke::flow::dfvn::{FromFn, Function};
use curlsmoke::flow::lift::{Lifted, Ramped};
use curlsmoke::flow::reproject::{Integrator, Repetition, Reprojection, Trace};
use curlsmoke::flow::simplex::{Simplex, Slope};
use curlsmoke::math::hash::{CounterRng, Seed};
use glam::DVec3;

/// Of a picture [pixels]; the plane seen is a square of edge 2 about the origin.
const EDGE: u32 = 320;
const PARTICLES: u32 = 700;
const STEPS: u32 = 400;

type Height = fn([f64; 2]) -> Slope<f64, 2>;

/// Falls along x, with a hollow in the middle.
fn slide([x, y]: [f64; 2]) -> Slope<f64, 2> {
    let bowl = -0.45 * (-6.0 * (x * x + y * y)).exp();
    let steep = -12.0 * bowl;
    Slope { value: -0.45 * x + bowl, gradient: [-0.45 + steep * x, steep * y] }
}

/// Ridges across y, steeper from left to right.
fn ridges([x, y]: [f64; 2]) -> Slope<f64, 2> {
    let (rise, wave) = (0.09 * (1.0 + x), (9.0 * y).sin());
    Slope { value: rise * wave, gradient: [0.09 * wave, rise * 9.0 * (9.0 * y).cos()] }
}

pub fn figure_9(report: &mut Report) {
    report.say(
        "## Figure 9: flow by the design of a surface\n\nParticles follow noise with a vertical ramp along the surface below, \
         and are seen from above: across the slope everywhere, as fast as it is steep, so downwards in the picture and round the \
         hollow, stirred by the noise.\n\n",
    );
    show(report, "slide", slide, Ramped { inner: Simplex::new(0.35, Seed(2)), slope: 2.5 }, 0.6);
}

pub fn figure_10(report: &mut Report) {
    report.say(
        "## Figure 10: anisotropy by the design of a surface\n\nThe same without a ramp: noise alone along a surface whose ridges \
         are steeper to the right, where swirls are drawn out along them.\n\n",
    );
    show(report, "ridges", ridges, Ramped { inner: Simplex::new(0.35, Seed(2)), slope: 0.0 }, 0.6);
}

fn show(report: &mut Report, name: &str, height: Height, field: Ramped<Simplex<3>>, time: f64) {
    let lifted = Lifted { field, height: FromFn(height) };
    report.picture(&format!("{name}-traces.png"), [EDGE; 2], &traces(&lifted, time));
    let camera = Camera::new([EDGE; 2], DVec3::new(0.0, 0.0, -0.1), DVec3::new(0.4, -1.0, 0.9), 1.25, 2.0);
    let hits = camera.hits(
        |p| {
            let found = height([p.x, p.y]);
            (p.z - found.value, DVec3::new(-found.gradient[0], -found.gradient[1], 1.0))
        },
        |p| p.x.abs() <= 1.0 && p.y.abs() <= 1.0,
    );
    let mut picture = Picture::new(&camera);
    picture.surface(&hits, |hit| {
        let is_line = [hit.place.x, hit.place.y].iter().any(|x| (x * 8.0 - (x * 8.0).round()).abs() < 0.04);
        if is_line { [0.2, 0.3, 0.45] } else { [0.45, 0.6, 0.8] }
    });
    let (size, rgb) = picture.finish();
    report.picture(&format!("{name}-surface.png"), size, &rgb);
    report.say("\n\n");
}

/// Ways of many particles, seen from above, y upwards: bright where they come from, dark where they are.
fn traces<H: Function<2>>(lifted: &Lifted<Ramped<Simplex<3>>, H>, time: f64) -> Vec<[f32; 3]> {
    let step = Trace {
        steps: 1,
        integrator: Integrator::RungeKutta,
        reprojection: Reprojection::Newton(Repetition { steps: 1, tolerance: 0.0 }),
    };
    let mut ink = vec![0.0f32; (EDGE * EDGE) as usize];
    let mut rng = CounterRng::new(Seed(12));
    for _ in 0..PARTICLES {
        let start = [0, 1].map(|_| 2.4 * f64::from(rng.uniform()) - 1.2);
        let mut p = lifted.lift(start);
        for n in 0..STEPS {
            p = step.end(lifted, p, time / f64::from(STEPS));
            let [x, y] = [p[0] + 1.0, 1.0 - p[1]].map(|x| 0.5 * x * f64::from(EDGE) - 0.5);
            let (left, top) = (x.floor(), y.floor());
            for k in 0..4u32 {
                let (u, v) = (left + f64::from(k & 1), top + f64::from(k >> 1));
                if u < 0.0 || v < 0.0 || u >= f64::from(EDGE) || v >= f64::from(EDGE) {
                    continue;
                }
                let share = (1.0 - (u - x).abs()) * (1.0 - (v - y).abs());
                ink[(v as u32 * EDGE + u as u32) as usize] += (share * f64::from(n + 1) / f64::from(STEPS)) as f32;
            }
        }
    }
    ink.into_iter().map(|ink| [0.35, 0.25, 0.12].map(|dye: f32| 0.92 * (-ink / dye * 0.16).exp())).collect()
}
