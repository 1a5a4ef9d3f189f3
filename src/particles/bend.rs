//! How the way of a particle bends while a shutter is open.
//!
//! About the frame's instant the way is `p + v s + a s²/2 + j s³/6`: the integral of the parabola through the velocity there and
//! at two other times of the shutter, each taken where a step of Heun's leads. It is off by the fourth power of the time that
//! the shutter is open. A particle whose way bends by next to nothing keeps its straight one, which costs half as much to find.

use crate::flow::kind::Flow;
use crate::particles::advect::{Coordinates, evaluate};
use crate::particles::follow::velocities;

/// Share of a kernel's radius by which a way may be off and still be called straight.
pub const STRAIGHT: f32 = 1.0 / 32.0;

/// Where the nearer end of the shutter is nearer to the instant than this share of the farther one, it tells nothing new.
const NEAR_END: f64 = 0.125;

/// Accelerations [m/s²] and their changes [m/s³] over a shutter, an array for each axis.
pub type Bends = [Coordinates; 2];

/// The two times beside 0 at which velocities are asked, for a shutter that is open between two times relative to the instant
/// [s].
fn nodes([open, close]: [f64; 2]) -> [f64; 2] {
    let far = if close.abs() >= open.abs() { close } else { open };
    let near = open + close - far;
    if near * far < 0.0 && near.abs() > NEAR_END * far.abs() { [near, far] } else { [0.5 * far, far] }
}

/// How the ways of particles bend that are at `position` [m] with `velocity` [m/s] at `time` [s], while a shutter is open between
/// two times relative to it [s]; `radius` is that of their kernels [m]. What is straight has zeros.
///
/// Each particle's numbers are its own: they do not depend on which others there are.
pub fn bends(
    flow: &Flow,
    time: f64,
    shutter: [f64; 2],
    position: &Coordinates,
    velocity: &Coordinates,
    radius: &[f32],
) -> Bends {
    let count = radius.len();
    let mut bends: Bends = std::array::from_fn(|_| std::array::from_fn(|_| vec![0.0; count]));
    let times = nodes(shutter);
    if times[1] == 0.0 {
        return bends;
    }
    let there = |s: f64, from: &Coordinates, along: &dyn Fn(usize, usize) -> f32| -> Coordinates {
        std::array::from_fn(|axis| from[axis].iter().enumerate().map(|(i, p)| p + along(axis, i) * s as f32).collect())
    };
    let predicted = times.map(|s| asked(flow, time + s, &there(s, position, &|axis, i| velocity[axis][i])));
    let is_bent = |i: usize| {
        let off = |n: usize| {
            let turn = (0..3).map(|axis| (predicted[n][axis][i] - velocity[axis][i]).powi(2)).sum::<f32>().sqrt();
            0.5 * turn * times[n].abs() as f32
        };
        // Written so that what is no number counts as straight.
        off(0).max(off(1)) > STRAIGHT * radius[i]
    };
    let bent: Vec<usize> = (0..count).filter(|&i| is_bent(i)).collect();
    let of_bent = |all: &Coordinates| -> Coordinates { all.each_ref().map(|x| bent.iter().map(|&i| x[i]).collect()) };
    let (from, first) = (of_bent(position), of_bent(velocity));
    let [v1, v2] = [0, 1].map(|n| {
        let last = of_bent(&predicted[n]);
        let mean = |axis: usize, i: usize| 0.5 * (first[axis][i] + last[axis][i]);
        asked(flow, time + times[n], &there(times[n], &from, &mean))
    });
    let [s1, s2] = times.map(|s| s as f32);
    for axis in 0..3 {
        for (n, &i) in bent.iter().enumerate() {
            let v0 = first[axis][n];
            let (d1, d2) = ((v1[axis][n] - v0) / s1, (v2[axis][n] - v0) / s2);
            let change = (d2 - d1) / (s2 - s1);
            (bends[0][axis][i], bends[1][axis][i]) = (d1 - change * s1, 2.0 * change);
        }
    }
    bends
}

fn asked(flow: &Flow, time: f64, position: &Coordinates) -> Coordinates {
    let mut velocity: Coordinates = position.each_ref().map(|x| vec![0.0; x.len()]);
    match flow {
        Flow::Curl(field) => evaluate(&field.span(time, 0.0), position, &mut velocity),
        Flow::Tracks(tracks) => velocities(tracks, position, &mut velocity),
    }
    velocity
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::field::VelocityField;
    use crate::flow::octaves::{OctavesSettings, octaves};
    use crate::flow::source::Potential;
    use crate::math::hash::Seed;
    use crate::math::real::length;
    use crate::particles::advect::{CLASSICAL, advanced};

    /// Swirls that change in time.
    fn field() -> VelocityField {
        let settings = OctavesSettings {
            length_scale: 1.0,
            speed: 1.0,
            octaves: 1,
            spin_rate: 0.5,
            scroll: [0.2, 0.4, 0.0],
            seed: Seed(5),
            ..Default::default()
        };
        VelocityField::new(octaves(&settings).into_iter().map(|o| Potential::Octave(o).into()).collect(), Vec::new())
    }

    /// Root mean square distances at both ends of the shutter from the true way: of the bent way, and of the straight one.
    fn errors(shutter: [f64; 2]) -> [f64; 2] {
        const STEPS: i32 = 64;
        let (flow, time) = (Flow::from(field()), 3.0);
        let field = field();
        let position: Coordinates = [0.7f32, 1.1, 1.7].map(|a| (0..400).map(|i| (i as f32 * a).sin()).collect());
        let velocity = asked(&flow, time, &position);
        // Nothing is straight for kernels of no size.
        let [a, j] = bends(&flow, time, shutter, &position, &velocity, &[1e-12; 400]);
        let mut sums = [0.0; 2];
        for i in 0..400 {
            let at = |x: &Coordinates| [0, 1, 2].map(|axis| f64::from(x[axis][i]));
            let (p, v, a, j) = (at(&position), at(&velocity), at(&a), at(&j));
            // From the opening to the instant and on: backwards by steps of the reversed field, which is v(−t) in −t.
            let truth = |s: f64| {
                let dt = s / f64::from(STEPS);
                (0..STEPS).fold(p, |p, n| {
                    let start = time + f64::from(n) * dt;
                    let k = |p: [f64; 3], at: f64| field.velocity(p, at);
                    let along = |v: [f64; 3], by: f64| [0, 1, 2].map(|axis| p[axis] + v[axis] * by);
                    let k1 = k(p, start);
                    let k2 = k(along(k1, 0.5 * dt), start + 0.5 * dt);
                    let k3 = k(along(k2, 0.5 * dt), start + 0.5 * dt);
                    let k4 = k(along(k3, dt), start + dt);
                    [0, 1, 2].map(|x| p[x] + dt / 6.0 * (k1[x] + 2.0 * (k2[x] + k3[x]) + k4[x]))
                })
            };
            for s in shutter {
                let truth = truth(s);
                let straight = [0, 1, 2].map(|x| p[x] + v[x] * s);
                let bent = [0, 1, 2].map(|x| straight[x] + s * s * (0.5 * a[x] + s / 6.0 * j[x]));
                for (sum, end) in sums.iter_mut().zip([bent, straight]) {
                    *sum += length([0, 1, 2].map(|x| end[x] - truth[x])).powi(2) / 800.0;
                }
            }
        }
        sums.map(f64::sqrt)
    }

    #[test]
    fn bent_ways_are_the_true_ones_to_the_fourth_order_and_straight_ones_are_not() {
        for shutter in [[-1.0, 1.0], [0.0, 1.0], [-1.0, -0.25], [-0.3, 0.7]] {
            let at = |seconds: f64| errors(shutter.map(|s| s * seconds));
            let [[bent, straight], [bent_half, straight_half]] = [0.08, 0.04].map(at);
            let order = |a: f64, b: f64| (a / b).log2();
            println!(
                "{shutter:?}: bent {bent:.1e} m, order {:.2}; straight {straight:.1e} m, order {:.2}",
                order(bent, bent_half),
                order(straight, straight_half)
            );
            assert!(order(bent, bent_half) > 2.7 && (order(straight, straight_half) - 2.0).abs() < 0.4);
            assert!(bent < 0.25 * straight, "{shutter:?}: {bent} {straight}");
        }
    }

    #[test]
    fn what_is_nearly_straight_stays_so_and_the_others_do_not_mind() {
        let (flow, shutter) = (Flow::from(field()), [-0.01, 0.01]);
        let position: Coordinates = [0.7f32, 1.1, 1.7].map(|a| (0..400).map(|i| (i as f32 * a).sin()).collect());
        let velocity = asked(&flow, 0.0, &position);
        let of = |radius: f32| bends(&flow, 0.0, shutter, &position, &velocity, &[radius; 400]);
        let (all, some, none) = (of(1e-12), of(0.01), of(10.0));
        assert!(none.iter().flatten().flatten().all(|x| *x == 0.0));
        let straight = (0..400).filter(|&i| (0..3).all(|axis| some[0][axis][i] == 0.0)).count();
        assert!((20..380).contains(&straight), "{straight}");
        for i in 0..400 {
            let is_straight = (0..3).all(|axis| some[0][axis][i] == 0.0);
            for axis in 0..3 {
                assert!(is_straight || some[0][axis][i] == all[0][axis][i]);
                let off = 0.5 * all[0][axis][i].abs() * 1e-4;
                assert!(!is_straight || off < 2.0 * STRAIGHT * 0.01, "{off}");
            }
        }
    }

    #[test]
    fn forwards_it_is_where_a_step_leads() {
        let (flow, field) = (Flow::from(field()), field());
        let position: Coordinates = [vec![0.3f32], vec![-0.2], vec![0.9]];
        let velocity = asked(&flow, 0.0, &position);
        let [a, j] = bends(&flow, 0.0, [0.0, 0.02], &position, &velocity, &[1e-12]);
        let p = [0, 1, 2].map(|axis| f64::from(position[axis][0]));
        let step = advanced(&field.span(0.0, 0.02), CLASSICAL, 0.02, p, 0.0);
        for axis in 0..3 {
            let [v, a, j] = [&velocity, &a, &j].map(|x| f64::from(x[axis][0]));
            let there = p[axis] + 0.02 * (v + 0.02 * (0.5 * a + 0.02 / 6.0 * j));
            assert!((there - step[axis]).abs() < 1e-5, "{there} {}", step[axis]);
        }
    }
}
