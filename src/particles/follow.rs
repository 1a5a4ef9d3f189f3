//! Steps along the tracks of a steady flow, many particles side by side, each put back on the track that it was born on.

use crate::flow::field::FieldSpan;
use crate::flow::reproject::Integrator;
use crate::flow::tracks::Tracks;
use crate::math::lanes::{Batch, Kernel, run_kernel};
use crate::math::real::triple;
use crate::particles::advect::{CHUNK, Coordinates, settle};
use rayon::prelude::*;
use std::ops::Range;

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
    let chunks = x[range.clone()]
        .par_chunks_mut(CHUNK)
        .zip(y[range.clone()].par_chunks_mut(CHUNK))
        .zip(z[range].par_chunks_mut(CHUNK));
    chunks
        .enumerate()
        .map(|(i, ((x, y), z))| {
            let own = i * CHUNK..i * CHUNK + x.len();
            let iso_values = [&first[own.clone()], &second[own.clone()]];
            let phase = phase.map(|p| &p[own]);
            run_kernel(Task::Move { stride, position: [x, y, z], iso_values, phase })
        })
        .sum()
}

/// Velocities [m/s].
///
/// # Panics
/// When the arrays differ in length.
pub fn velocities(tracks: &Tracks, position: &Coordinates, velocity: &mut Coordinates) {
    let [u, v, w] = velocity;
    u.par_chunks_mut(CHUNK).zip(v.par_chunks_mut(CHUNK)).zip(w.par_chunks_mut(CHUNK)).enumerate().for_each(
        |(i, ((u, v), w))| {
            let position = [0, 1, 2].map(|axis| &position[axis][i * CHUNK..i * CHUNK + u.len()]);
            run_kernel(Task::Look { tracks, position, velocity: [u, v, w] });
        },
    );
}
