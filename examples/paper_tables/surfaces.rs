//! Surfaces: figures 3 and 6, and the ball of figure 7.

use crate::Report;
use crate::solids::{Camera, Hit, Picture};
use curlsmoke::flow::bounded::{Ball, Bounded};
use curlsmoke::flow::dfvn::{FromFn, Function};
use curlsmoke::flow::pair::RMS_PRODUCT;
use curlsmoke::flow::reproject::{Integrator, Repetition, Reprojection, Trace};
use curlsmoke::flow::simplex::{Simplex, Slope};
use curlsmoke::flow::surface::{SurfaceFlow, SurfaceFlowSettings};
use curlsmoke::geometry::primitive::{Primitive, Torus};
use curlsmoke::geometry::sdf::{PlacedSdf, Sdf};
use curlsmoke::math::hash::Seed;
use curlsmoke::math::space::Similarity;
use glam::DVec3;
use rayon::prelude::*;
use std::sync::Arc;

const ORANGE: [f32; 3] = [0.9, 0.3, 0.04];
const BLUE: [f32; 3] = [0.03, 0.15, 0.7];
const CREAM: [f32; 3] = [0.85, 0.75, 0.55];

fn trace(steps: u32, integrator: Integrator, reprojections: u32) -> Trace {
    let reprojection = Reprojection::Newton(Repetition { steps: reprojections, tolerance: 0.0 });
    Trace { steps, integrator, reprojection }
}

pub fn figure_3(report: &mut Report) {
    report.say(
        "## Figure 3: two surfaces and where they meet\n\nx² + y² + z² (orange) and x³ − y² + z³ (blue) have the values they \
         have at (½, ½, ½). The line on which both keep them is followed from there (white) by Runge and Kutta with \
         reprojection; arrows are the gradients and their product.\n\n",
    );
    let ball = |[x, y, z]: [f64; 3]| Slope { value: x * x + y * y + z * z, gradient: [2.0 * x, 2.0 * y, 2.0 * z] };
    let sheet = |[x, y, z]: [f64; 3]| Slope {
        value: x * x * x - y * y + z * z * z,
        gradient: [3.0 * x * x, -2.0 * y, 3.0 * z * z],
    };
    let start = [0.5; 3];
    let camera = Camera::new([420, 360], DVec3::ZERO, DVec3::new(1.5, 2.2, 1.0), 1.3, 2.6);
    let mut picture = Picture::new(&camera);
    let within = |p: DVec3| p.abs().max_element() <= 1.1;
    for (f, colour) in [(&ball as &(dyn Fn([f64; 3]) -> Slope<f64, 3> + Sync), ORANGE), (&sheet, BLUE)] {
        let level = f(start).value;
        let hits = camera.hits(
            |p| {
                let found = f(p.to_array());
                (found.value - level, DVec3::from_array(found.gradient))
            },
            within,
        );
        picture.surface(&hits, |_| colour);
    }
    let line = (FromFn(ball), FromFn(sheet));
    let walker = trace(400, Integrator::RungeKutta, 2);
    for time in [2.0, -2.0] {
        let step = Trace { steps: 1, ..walker };
        let mut p = start;
        let points = (0..4000).map(|_| {
            p = step.end(&line, p, time / 2000.0);
            DVec3::from_array(p)
        });
        picture.line(points.take_while(|p| within(*p)), 0.02, [0.95; 3]);
    }
    let (a, b) = (DVec3::from_array(ball(start).gradient), DVec3::from_array(sheet(start).gradient));
    for (way, colour) in [(a, ORANGE.map(|c| 0.5 * c)), (b, BLUE.map(|c| 0.5 * c)), (a.cross(b), [0.02; 3])] {
        let (from, way) = (DVec3::from_array(start), 0.6 * way.normalize());
        picture.line((0..600).map(|i| from + way * f64::from(i) / 600.0), 0.025, colour);
        for i in 0..60 {
            let share = f64::from(i) / 60.0;
            picture.line(std::iter::once(from + way * (1.0 + 0.15 * share)), 0.08 * (1.0 - share) + 0.01, colour);
        }
    }
    let (size, rgb) = picture.finish();
    report.picture("two-surfaces.png", size, &rgb);
    report.say("\n\n");
}

/// Stripes round the torus' axis, of the place where what is at a point came from.
fn stripes(p: [f64; 3]) -> [f32; 3] {
    if (7.0 * p[2].atan2(p[0])).sin() * (14.0 * p[1]).cos() > 0.0 { [0.75, 0.1, 0.05] } else { CREAM }
}

/// Size of swirls, and the longest way [m].
const LENGTH: f64 = 0.5;
const DISTANCE: f64 = 1.2;
/// Of what is taken for the truth.
const MANY: u32 = 2048;

pub fn figure_6(report: &mut Report) {
    let torus = Torus { center: DVec3::ZERO, axis: DVec3::Y, major_radius: 1.0, minor_radius: 0.45 };
    let solid = Arc::new(PlacedSdf::new(Sdf::Primitive(Primitive::Torus(torus)), Similarity::IDENTITY));
    let camera = Camera::new([180, 130], DVec3::ZERO, DVec3::new(0.3, 1.0, 0.8), 1.25, 1.6);
    let hits = camera.hits(
        |p| {
            let found = Function::at(&*solid, p.to_array());
            (found.value, DVec3::from_array(found.gradient))
        },
        |_| true,
    );
    let origins = |distance: f64, trace: Trace| -> Vec<Option<[f64; 3]>> {
        let flow = SurfaceFlow::new(
            solid.clone(),
            SurfaceFlowSettings { length: LENGTH, distance, trace, seed: Seed(4), cache: None },
        );
        hits.par_iter().map(|hit| hit.map(|hit| flow.origin(hit.place.to_array()))).collect()
    };
    let save = |report: &mut Report, name: &str, origins: &[Option<[f64; 3]>]| {
        let mut picture = Picture::new(&camera);
        picture.surface(&hits, |_| [1.0; 3]);
        picture.tint(|i| origins[i].map_or([1.0; 3], stripes));
        let (size, rgb) = picture.finish();
        report.picture(name, size, &rgb);
    };
    report.say(&format!(
        "## Figure 6: a pattern that flows on a torus\n\nAfter ways of 0, 0.3, 0.6 and {DISTANCE} m, by up to {MANY} steps of Runge \
         and Kutta with reprojection.\n\n"
    ));
    for share in [0.0, 0.25, 0.5] {
        let steps = ((f64::from(MANY) * share) as u32).max(1);
        let ends = origins(share * DISTANCE, trace(steps, Integrator::RungeKutta, 1));
        save(report, &format!("torus-{:.0}.png", 100.0 * share), &ends);
    }
    let truth = origins(DISTANCE, trace(MANY, Integrator::RungeKutta, 1));
    save(report, "torus-100.png", &truth);
    report.say("\n\nWith 32 and 128 steps of Euler, each without reprojection and with one.\n\n");
    let mut rows = String::new();
    for (integrator, name) in [(Integrator::Euler, "Euler"), (Integrator::RungeKutta, "RK4")] {
        for steps in [16, 32, 64, 128, 256] {
            let mut errors = [[0.0; 2]; 2];
            for reprojections in [0, 1] {
                let ends = origins(DISTANCE, trace(steps, integrator, reprojections));
                errors[reprojections as usize] = error(&ends, &truth);
                if integrator == Integrator::Euler && [32, 128].contains(&steps) {
                    save(report, &format!("torus-{steps}-{reprojections}.png"), &ends);
                }
            }
            let [[without, colour_without], [with, colour_with]] = errors;
            println!("torus, {name} {steps}: {without:.2e} m without reprojection, {with:.2e} with");
            rows.push_str(&format!(
                "| {name} | {steps} | {without:.2e} | {with:.2e} | {colour_without:.1} | {colour_with:.1} |\n"
            ));
        }
    }
    report.say(
        "\n\nRoot mean square error of places [m], and of colours [steps of 255], against that.\n\n| | steps | places without \
         | with reprojection | colours without | with |\n|---|---|---|---|---|---|\n",
    );
    report.say(&rows);
    report.say("\n");
}

/// Root mean square differences of places and of their colours.
fn error(ends: &[Option<[f64; 3]>], truth: &[Option<[f64; 3]>]) -> [f64; 2] {
    let mut sums = [0.0; 2];
    let mut count = 0.0;
    for (a, b) in ends.iter().zip(truth) {
        let (Some(a), Some(b)) = (a, b) else { continue };
        sums[0] += (DVec3::from_array(*a) - DVec3::from_array(*b)).length_squared();
        let (p, q) = (stripes(*a), stripes(*b));
        sums[1] += (0..3).map(|c| f64::from(255.0 * (p[c] - q[c])).powi(2)).sum::<f64>() / 3.0;
        count += 1.0;
    }
    sums.map(|sum| (sum / count).sqrt())
}

pub fn figure_7(report: &mut Report) {
    report.say(
        "A ball with shells, cut open. Its inside is warped in all three dimensions, and its surface along itself: the outermost \
         shell stays outermost.\n\n",
    );
    let ball = Ball { center: [0.0; 3], radius: 1.0 };
    let noise = |seed| Simplex::<3>::new(0.5, Seed(seed));
    let functions = (noise(5), Bounded { distance: ball, inner: noise(6), width: 0.8 });
    let camera = Camera::new([220, 220], DVec3::ZERO, DVec3::new(1.0, 1.3, 0.9), 1.1, 1.4);
    // Where the eighth towards the eye is left out, its faces are the surface.
    let cut = |p: DVec3| {
        let (distance, corner) = (p.length() - 1.0, p.min_element());
        if distance > corner {
            (distance, p.normalize_or(DVec3::X))
        } else {
            let axis = if corner == p.x {
                DVec3::X
            } else if corner == p.y {
                DVec3::Y
            } else {
                DVec3::Z
            };
            (corner, axis)
        }
    };
    let hits = camera.hits(cut, |_| true);
    for distance in [0.0, 0.15, 0.5] {
        let walker = trace(256, Integrator::RungeKutta, 2);
        let of = |hit: &Hit| {
            let origin = walker.end(&functions, hit.place.to_array(), -distance / RMS_PRODUCT);
            let radius = DVec3::from_array(origin).length();
            let shell = (radius * 5.0).floor() as i32;
            if radius > 0.93 {
                BLUE
            } else if shell % 2 == 0 {
                ORANGE
            } else {
                CREAM
            }
        };
        let mut picture = Picture::new(&camera);
        picture.surface(&hits, of);
        let (size, rgb) = picture.finish();
        report.picture(&format!("ball-{:.0}.png", 100.0 * distance), size, &rgb);
    }
    report.say("\n\n");
}
