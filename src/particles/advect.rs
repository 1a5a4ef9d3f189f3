//! Steps of Euler, midpoint and classical Runge–Kutta along the velocity field, many particles side by side.
//!
//! Particles are independent and the arithmetic is elementwise, so neither the number of threads nor which particles
//! share a register changes a bit.

use crate::flow::field::FieldSpan;
use crate::flow::reproject::Integrator;
use crate::math::lanes::{Batch, Kernel, run_kernel};
use crate::math::parallel;
use crate::math::real::{Lane, triple};
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// Particles that a thread takes at a time: some hundred microseconds of work.
pub(in crate::particles) const CHUNK: usize = 1024;

/// A Runge–Kutta scheme in which each stage starts from the one before: nodes and weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scheme {
    nodes: &'static [f64],
    weights: &'static [f64],
    /// The same for steps along tracks.
    pub integrator: Integrator,
}

/// One evaluation, first order.
pub const EULER: Scheme = Scheme { nodes: &[0.0], weights: &[1.0], integrator: Integrator::Euler };
/// The midpoint rule: two evaluations, second order.
pub const MIDPOINT: Scheme = Scheme { nodes: &[0.0, 0.5], weights: &[0.0, 1.0], integrator: Integrator::Midpoint };
/// Classical Runge–Kutta: four evaluations, fourth order.
pub const CLASSICAL: Scheme = Scheme {
    nodes: &[0.0, 0.5, 0.5, 1.0],
    weights: &[1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0],
    integrator: Integrator::RungeKutta,
};

impl Scheme {
    /// Velocity evaluations of a step.
    pub fn stage_count(&self) -> usize {
        self.nodes.len()
    }
}

/// Coordinates of particles, an array for each axis.
pub type Coordinates = [Vec<f32>; 3];

struct Step<'a, 'b> {
    span: &'a FieldSpan<'b>,
    scheme: Scheme,
    /// Of the whole span [s].
    duration: f32,
    position: [&'a mut [f32]; 3],
    /// Where in the span each particle begins, 0 where absent.
    phase: Option<&'a [f32]>,
}

impl Kernel for Step<'_, '_> {
    type Output = u64;
    const HAS_FOUR_LANES: bool = true;

    #[inline(always)]
    fn run<L: Batch>(self, zero: L) -> u64 {
        let [x, y, z] = self.position;
        let mut corrected = 0;
        for start in (0..x.len()).step_by(L::WIDTH) {
            let p = [zero.load(&x[start..]), zero.load(&y[start..]), zero.load(&z[start..])];
            let phase = match self.phase {
                Some(phase) => zero.load(&phase[start..]),
                None => zero,
            };
            let q = advanced(self.span, self.scheme, self.duration, p, phase);
            corrected += settle(self.span, p, phase, q, [&mut x[start..], &mut y[start..], &mut z[start..]]);
        }
        corrected
    }
}

/// Writes the ends `q` of the steps of some lanes; those that may have ended inside an obstacle are looked at one by one.
/// Returns how many had to be moved.
#[inline(always)]
pub(in crate::particles) fn settle<L: Batch>(
    span: &FieldSpan,
    p: [L; 3],
    phase: L,
    q: [L; 3],
    [x, y, z]: [&mut [f32]; 3],
) -> u64 {
    q[0].store(x);
    q[1].store(y);
    q[2].store(z);
    let mut corrected = 0;
    if let Some(suspicion) = span.suspicion(p, phase, q) {
        for lane in 0..L::WIDTH.min(x.len()) {
            // Written so that NaN is looked at too.
            if suspicion.lane(lane) >= 0.0 {
                continue;
            }
            let from = triple!(axis => p[axis].lane(lane) as f32);
            let (to, moved) = span.settled(from, [x[lane], y[lane], z[lane]], phase.lane(lane));
            [x[lane], y[lane], z[lane]] = to;
            corrected += u64::from(moved);
        }
    }
    corrected
}

/// Where particles at `p` are at the end of a span, if they begin at `phase` of it.
#[inline(always)]
pub fn advanced<L: Lane>(span: &FieldSpan, scheme: Scheme, duration: f32, p: [L; 3], phase: L) -> [L; 3] {
    let share = phase.lit(1.0) - phase;
    let h = share * phase.lit(f64::from(duration));
    let mut slope = [phase.lit(0.0); 3];
    let mut sum = slope;
    for stage in 0..scheme.stage_count() {
        let (node, weight) = (phase.lit(scheme.nodes[stage]), phase.lit(scheme.weights[stage]));
        let reach = h * node;
        let q = triple!(i => reach.mul_add(slope[i], p[i]));
        slope = span.velocity(q, node.mul_add(share, phase));
        sum = triple!(i => weight.mul_add(slope[i], sum[i]));
    }
    triple!(i => h.mul_add(sum[i], p[i]))
}

/// Moves the particles of indices `range` to the end of the span; those that end inside an obstacle are moved out of
/// it. `phase`, where given, says for each of them where in the span it begins. Returns how many had to be moved out.
pub fn advance(
    span: &FieldSpan,
    scheme: Scheme,
    duration: f64,
    position: &mut Coordinates,
    range: Range<usize>,
    phase: Option<&[f32]>,
) -> u64 {
    let [x, y, z] = position;
    let chunks =
        x[range.clone()].chunks_mut(CHUNK).zip(y[range.clone()].chunks_mut(CHUNK)).zip(z[range].chunks_mut(CHUNK));
    let moved = AtomicU64::new(0);
    parallel::for_each(chunks, |i, ((x, y), z)| {
        let phase = phase.map(|p| &p[i * CHUNK..i * CHUNK + x.len()]);
        let duration = duration as f32;
        let count = run_kernel(Step { span, scheme, duration, position: [x, y, z], phase });
        moved.fetch_add(count, Ordering::Relaxed);
    });
    moved.into_inner()
}

struct Evaluate<'a, 'b> {
    span: &'a FieldSpan<'b>,
    position: [&'a [f32]; 3],
    velocity: [&'a mut [f32]; 3],
}

impl Kernel for Evaluate<'_, '_> {
    type Output = ();

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn run<L: Batch>(self, zero: L) {
        for start in (0..self.position[0].len()).step_by(L::WIDTH) {
            let p = triple!(axis => zero.load(&self.position[axis][start..]));
            let v = self.span.velocity(p, zero);
            for axis in 0..3 {
                v[axis].store(&mut self.velocity[axis][start..]);
            }
        }
    }
}

/// Velocities [m/s] at the beginning of the span.
///
/// # Panics
/// When the arrays differ in length.
pub fn evaluate(span: &FieldSpan, position: &Coordinates, velocity: &mut Coordinates) {
    let [u, v, w] = velocity;
    let chunks = u.chunks_mut(CHUNK).zip(v.chunks_mut(CHUNK)).zip(w.chunks_mut(CHUNK));
    parallel::for_each(chunks, |i, ((u, v), w)| {
        let position = [0, 1, 2].map(|axis| &position[axis][i * CHUNK..i * CHUNK + u.len()]);
        run_kernel(Evaluate { span, position, velocity: [u, v, w] });
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::field::VelocityField;
    use crate::flow::obstacles::build_obstacles;
    use crate::flow::octaves::{OctavesSettings, octaves};
    use crate::flow::source::Potential;
    use crate::geometry::primitive::{Cuboid, Primitive};
    use crate::geometry::sdf::{PlacedSdf, Sdf};
    use crate::math::hash::{CounterRng, Seed};
    use crate::math::real::length;
    use crate::math::space::Similarity;
    use glam::DVec3;
    use std::sync::Arc;

    fn field() -> VelocityField {
        let settings = OctavesSettings {
            length_scale: 1.5,
            speed: 1.0,
            octaves: 1,
            spin_rate: 0.3,
            scroll: [0.2, 0.0, 0.0],
            seed: Seed(5),
            ..Default::default()
        };
        VelocityField::new(octaves(&settings).into_iter().map(|o| Potential::Octave(o).into()).collect(), Vec::new())
    }

    /// Where a particle is after `steps` steps through half a second.
    fn end(field: &VelocityField, scheme: Scheme, steps: u32) -> [f64; 3] {
        let dt = 0.5 / f64::from(steps);
        (0..steps).fold([0.31, -0.4, 0.8], |p, n| {
            // Powers of two: a step in f32 is then the same number as in f64.
            advanced(&field.span(f64::from(n) * dt, dt), scheme, dt as f32, p, 0.0)
        })
    }

    #[test]
    fn errors_fall_with_the_order_of_the_scheme() {
        let field = field();
        let truth = end(&field, CLASSICAL, 512);
        for (scheme, order, steps) in [(EULER, 1.0, 64), (MIDPOINT, 2.0, 16), (CLASSICAL, 4.0, 4)] {
            let error = |steps| {
                let p = end(&field, scheme, steps);
                length([0, 1, 2].map(|i| p[i] - truth[i]))
            };
            let found = (error(steps) / error(2 * steps)).log2();
            println!("order {order}: measured {found:.2}, error at {steps} steps {:.1e}", error(steps));
            assert!((found - order).abs() < 0.35, "{order}: {found}");
        }
    }

    #[test]
    fn a_step_from_the_middle_of_a_span_is_half_a_step() {
        let field = field();
        let p = [0.31f64, -0.4, 0.8];
        let late = advanced(&field.span(0.0, 0.5), CLASSICAL, 0.5, p, 0.5);
        let half = advanced(&field.span(0.25, 0.25), CLASSICAL, 0.25, p, 0.0);
        for i in 0..3 {
            assert!((late[i] - half[i]).abs() < 1e-6, "{late:?} {half:?}");
        }
    }

    #[test]
    #[allow(clippy::needless_range_loop, reason = "three arrays and a fourth")]
    fn no_step_leads_through_a_thin_plate_however_long_it_is() {
        let half_size = DVec3::new(1.0, 0.005, 1.0);
        let plate = Primitive::Cuboid(Cuboid { center: DVec3::ZERO, half_size, rounding: 0.0 });
        let plate = Arc::new(PlacedSdf::new(Sdf::Primitive(plate), Similarity::IDENTITY));
        let settings =
            OctavesSettings { length_scale: 0.1, speed: 1.0, octaves: 1, seed: Seed(7), ..Default::default() };
        let swirls = octaves(&settings).into_iter().map(|o| Potential::Octave(o).into()).collect();
        let field = VelocityField::new(swirls, build_obstacles([plate]));
        let mut rng = CounterRng::new(Seed(1));
        let mut axis =
            |low: f32, high: f32| (0..4000).map(|_| low + (high - low) * rng.uniform()).collect::<Vec<f32>>();
        let mut p = [axis(-0.5, 0.5), axis(0.006, 0.1), axis(-0.5, 0.5)];
        let (mut would_pass, mut corrected) = (0, 0);
        for _ in 0..5 {
            // Each is as long as the swirls are large.
            let span = field.span(0.0, 0.1);
            for i in 0..4000 {
                let q = advanced(&span, EULER, 0.1, [p[0][i], p[1][i], p[2][i]], 0.0f32);
                would_pass += u32::from(p[1][i] > 0.0 && q[1] < 0.0 && q[0].abs().max(q[2].abs()) < 0.9);
            }
            let before = p[1].clone();
            corrected += advance(&span, EULER, 0.1, &mut p, 0..4000, None);
            for i in 0..4000 {
                let is_beside = p[0][i].abs().max(p[2][i].abs()) > 0.9;
                assert!(is_beside || (before[i] > 0.0) == (p[1][i] > 0.0), "{i}: {} {}", before[i], p[1][i]);
            }
        }
        println!("{would_pass} of 20000 steps would have passed the plate, {corrected} were corrected");
        assert!(would_pass > 100 && corrected >= u64::from(would_pass));
    }

    /// As on a processor without AVX2.
    #[cfg(target_arch = "x86_64")]
    fn run_narrow(step: Step) -> u64 {
        crate::math::lanes::run_four_lanes(step)
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn run_narrow(step: Step) -> u64 {
        run_kernel(step)
    }

    #[test]
    fn processors_with_four_lanes_or_none_come_to_the_same_places() {
        let field = field();
        let span = field.span(0.0, 0.1);
        let axis = |a: f32| (0..500).map(|i| (i as f32 * a).sin()).collect::<Vec<f32>>();
        let mut lanes = [axis(0.7), axis(1.1), axis(1.7)];
        let mut alone = lanes.clone();
        advance(&span, CLASSICAL, 0.1, &mut lanes, 0..500, None);
        let mut four = alone.clone();
        let step = |[x, y, z]: &mut Coordinates, is_scalar: bool| {
            let step = Step { span: &span, scheme: CLASSICAL, duration: 0.1, position: [x, y, z], phase: None };
            let corrected = if is_scalar { step.run(0.0f64) } else { run_narrow(step) };
            assert_eq!(corrected, 0);
        };
        step(&mut alone, true);
        step(&mut four, false);
        for a in 0..3 {
            assert_ne!(alone[a], [axis(0.7), axis(1.1), axis(1.7)][a]);
            assert!(lanes[a].iter().zip(&alone[a]).all(|(p, q)| (p - q).abs() < 2e-6));
            assert!(four[a].iter().zip(&alone[a]).all(|(p, q)| (p - q).abs() < 2e-6));
            // Single precision, and so not the same to the last bit: four lanes were used.
            #[cfg(target_arch = "x86_64")]
            assert_ne!(four[a], alone[a]);
        }
    }

    #[test]
    fn the_place_of_a_particle_among_others_changes_nothing() {
        let field = field();
        let span = field.span(0.0, 0.1);
        let axis = |a: f32| (0..2500).map(|i| (i as f32 * a).sin()).collect::<Vec<f32>>();
        let mut all = [axis(0.7), axis(1.1), axis(1.7)];
        let mut tail = [0, 1, 2].map(|a: usize| all[a][1234..].to_vec());
        advance(&span, CLASSICAL, 0.1, &mut all, 0..2500, None);
        advance(&span, CLASSICAL, 0.1, &mut tail, 0..1266, None);
        for a in 0..3 {
            assert_eq!(all[a][1234..], tail[a]);
        }
    }
}
