//! Steps along the tracks of a steady flow, many particles side by side, each put back on the track that it was born on.

use crate::flow::field::FieldSpan;
use crate::flow::reproject::Integrator;
use crate::flow::tracks::Tracks;
use crate::math::lanes::{Batch, Kernel, run_kernel};
use crate::math::parallel;
use crate::math::real::triple;
use crate::particles::advect::{CHUNK, Coordinates, settle};
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// Values that both functions had where particles were born, an array for each.
pub type IsoValues = [Vec<f32>; 2];

/// A step of time along tracks.
#[derive(Debug, Clone, Copy)]
pub struct Stride<'a, 'b> {
    /// The tracks.
    pub tracks: &'a Tracks,
    /// Their walls during the step.
    pub walls: &'a FieldSpan<'b>,
    /// How the step is taken.
    pub integrator: Integrator,
    /// Its length [s].
    pub duration: f64,
}

/// Both what moves particles and what asks for their velocities: one kernel is half as much to compile as two.
enum Task<'a, 'b> {
    Move {
        stride: Stride<'a, 'b>,
        position: [&'a mut [f32]; 3],
        iso_values: [&'a [f32]; 2],
        /// Where in the step each particle begins, 0 where absent.
        phase: Option<&'a [f32]>,
    },
    Look {
        tracks: &'a Tracks,
        position: [&'a [f32]; 3],
        velocity: [&'a mut [f32]; 3],
    },
}

impl Kernel for Task<'_, '_> {
    type Output = u64;

    #[inline(always)]
    fn run<L: Batch>(self, zero: L) -> u64 {
        let mut corrected = 0;
        match self {
            Self::Move { stride, position: [x, y, z], iso_values, phase } => {
                for start in (0..x.len()).step_by(L::WIDTH) {
                    let p = [zero.load(&x[start..]), zero.load(&y[start..]), zero.load(&z[start..])];
                    let values = [zero.load(&iso_values[0][start..]), zero.load(&iso_values[1][start..])];
                    let phase = match phase {
                        Some(phase) => zero.load(&phase[start..]),
                        None => zero,
                    };
                    let time = (zero.lit(1.0) - phase) * zero.lit(stride.duration);
                    let q = stride.tracks.after(p, time, stride.integrator, values);
                    let ends = [&mut x[start..], &mut y[start..], &mut z[start..]];
                    corrected += settle(stride.walls, p, phase, q, ends);
                }
            }
            Self::Look { tracks, position, velocity: [u, v, w] } => {
                for start in (0..u.len()).step_by(L::WIDTH) {
                    let found = tracks.velocity(triple!(axis => zero.load(&position[axis][start..])));
                    found[0].store(&mut u[start..]);
                    found[1].store(&mut v[start..]);
                    found[2].store(&mut w[start..]);
                }
            }
        }
        corrected
    }
}

/// Moves the particles of indices `range` to the end of the step; those that end outside of the walls are moved in.
/// `phase`, where given, says for each of them where in the step it begins. Returns how many had to be moved in.
pub fn follow(
    stride: Stride,
    position: &mut Coordinates,
    iso_values: &IsoValues,
    range: Range<usize>,
    phase: Option<&[f32]>,
) -> u64 {
    let [x, y, z] = position;
    let [first, second] = [0, 1].map(|i: usize| &iso_values[i][range.clone()]);
    let chunks =
        x[range.clone()].chunks_mut(CHUNK).zip(y[range.clone()].chunks_mut(CHUNK)).zip(z[range].chunks_mut(CHUNK));
    let moved = AtomicU64::new(0);
    parallel::for_each(chunks, |i, ((x, y), z)| {
        let own = i * CHUNK..i * CHUNK + x.len();
        let iso_values = [&first[own.clone()], &second[own.clone()]];
        let phase = phase.map(|p| &p[own]);
        let count = run_kernel(Task::Move { stride, position: [x, y, z], iso_values, phase });
        moved.fetch_add(count, Ordering::Relaxed);
    });
    moved.into_inner()
}

/// Velocities [m/s].
///
/// # Panics
/// When the arrays differ in length.
pub fn velocities(tracks: &Tracks, position: &Coordinates, velocity: &mut Coordinates) {
    let [u, v, w] = velocity;
    let chunks = u.chunks_mut(CHUNK).zip(v.chunks_mut(CHUNK)).zip(w.chunks_mut(CHUNK));
    parallel::for_each(chunks, |i, ((u, v), w)| {
        let position = [0, 1, 2].map(|axis| &position[axis][i * CHUNK..i * CHUNK + u.len()]);
        run_kernel(Task::Look { tracks, position, velocity: [u, v, w] });
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::field::VelocityField;
    use crate::flow::pair::{Pair, Second, Turned};
    use crate::flow::reproject::{Repetition, Reprojection};
    use crate::flow::simplex::Simplex;
    use crate::math::hash::Seed;

    fn tracks() -> Tracks {
        let noise = |seed| Simplex::new(0.4, Seed(seed));
        let functions = Pair::new(noise(1), Second::Noise(Turned::new(noise(2))), None);
        let twice = Reprojection::LeastNorm(Repetition { steps: 2, tolerance: 0.0 });
        Tracks::new(functions, 0.7, twice, VelocityField::new(Vec::new(), Vec::new()))
    }

    fn places(count: usize) -> Coordinates {
        [0.7f32, 1.1, 1.7].map(|a| (0..count).map(|i| (i as f32 * a).sin()).collect())
    }

    fn values(tracks: &Tracks, at: &Coordinates) -> IsoValues {
        let one = |i: usize| tracks.iso_values([0, 1, 2].map(|axis| f64::from(at[axis][i])));
        [0, 1].map(|f: usize| (0..at[0].len()).map(|i| one(i)[f] as f32).collect())
    }

    #[test]
    fn processors_without_lanes_come_to_the_same_places_and_neighbours_change_nothing() {
        let tracks = tracks();
        let walls = tracks.walls().span(0.0, 0.04);
        for integrator in [Integrator::Euler, Integrator::Midpoint, Integrator::RungeKutta] {
            let stride = Stride { tracks: &tracks, walls: &walls, integrator, duration: 0.04 };
            let (mut lanes, mut alone, starts) = (places(1500), places(1500), places(1500));
            let mut tail = places(1500).map(|axis| axis[1234..].to_vec());
            let iso_values = values(&tracks, &starts);
            follow(stride, &mut lanes, &iso_values, 0..1500, None);
            follow(stride, &mut tail, &iso_values.each_ref().map(|v| v[1234..].to_vec()), 0..266, None);
            let [x, y, z] = &mut alone;
            let iso_values = iso_values.each_ref().map(Vec::as_slice);
            Task::Move { stride, position: [x, y, z], iso_values, phase: None }.run(0.0f64);
            let mut errors = Vec::new();
            for axis in 0..3 {
                assert_eq!(lanes[axis][1234..], tail[axis]);
                assert_ne!(lanes[axis], starts[axis]);
                errors.extend(lanes[axis].iter().zip(&alone[axis]).map(|(a, b)| (a - b).abs()));
            }
            errors.sort_by(f32::total_cmp);
            println!("{integrator:?}: lanes are off by {:.1e} m of 99 %", errors[4455]);
            // Where gradients are nearly parallel, the way back hangs on rounding.
            assert!(errors[4455] < 5e-6, "{integrator:?}: {}", errors[4455]);
        }
    }

    #[test]
    fn a_step_from_the_middle_is_half_a_step() {
        let tracks = tracks();
        let walls = tracks.walls().span(0.0, 0.08);
        let stride = |duration| Stride { tracks: &tracks, walls: &walls, integrator: Integrator::RungeKutta, duration };
        let (mut late, mut half) = (places(64), places(64));
        let iso_values = values(&tracks, &late);
        follow(stride(0.08), &mut late, &iso_values, 0..64, Some(&[0.5; 64]));
        follow(stride(0.04), &mut half, &iso_values, 0..64, None);
        assert_eq!(late, half);
        assert_ne!(late, places(64));
    }
}
