//! The stream function of a flow in a plane, whose contour lines are stream lines: `u = ∂ψ/∂y`, `v = −∂ψ/∂x`.
//!
//! It is found from the flux through the edges between pixels. Only a flow without a part across the plane that changes
//! along the normal has one; for others this is the best in the sense of least squares. Least squares give a Poisson equation with free edges; it is solved exactly, by a cosine
//! transform down the columns and a tridiagonal system along each row (Hockney 1965, *A Fast Direct Solution of
//! Poisson's Equation Using Fourier Analysis*).

use crate::math::parallel;
use std::f64::consts::PI;

/// A stream function on pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct StreamFunction {
    /// Values with mean 0, row after row from the top [m²/s].
    pub values: Vec<f64>,
    /// Share of the in-plane flow, by mean square, that it accounts for; 1 where the flow is planar.
    pub explained: f64,
}

/// Finds the stream function of in-plane velocities `[right, up]` [m/s] on `size` square pixels of edge `pixel` [m].
///
/// # Panics
/// When there is not one velocity for each pixel, or no pixel.
pub fn stream_function(velocity: &[[f64; 2]], size: [u32; 2], pixel: f64) -> StreamFunction {
    let [width, height] = size.map(|n| n as usize);
    assert!(width * height > 0 && velocity.len() == width * height, "one velocity for each pixel");
    let flux = Flux { velocity, width, pixel };
    let rhs = divergence_of_flux(&flux, width, height);
    let mut spectrum = cosine_transform(&rhs, width, height, |row, k| cosine(k, row, height));
    parallel::for_each_chunk_mut(&mut spectrum, width, |k, row| {
        if k == 0 {
            integrate(row);
        } else {
            solve(row, 2.0 - 2.0 * (PI * k as f64 / height as f64).cos());
        }
    });
    let scale = 1.0 / height as f64;
    let back = |k: usize, row: usize| if k == 0 { scale } else { 2.0 * scale * cosine(k, row, height) };
    let mut values = cosine_transform(&spectrum, width, height, back);
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter_mut().for_each(|v| *v -= mean);
    let explained = explained(&flux, &values, width, height);
    StreamFunction { values, explained }
}

/// Flux through the edges between pixels: the differences of the stream function that are wanted.
struct Flux<'a> {
    velocity: &'a [[f64; 2]],
    width: usize,
    pixel: f64,
}

impl Flux<'_> {
    /// From a pixel to the one at its right.
    fn right(&self, i: usize) -> f64 {
        -0.5 * (self.velocity[i][1] + self.velocity[i + 1][1]) * self.pixel
    }

    /// From a pixel to the one below.
    fn below(&self, i: usize) -> f64 {
        -0.5 * (self.velocity[i][0] + self.velocity[i + self.width][0]) * self.pixel
    }
}

fn divergence_of_flux(flux: &Flux, width: usize, height: usize) -> Vec<f64> {
    let mut rhs = vec![0.0; width * height];
    for y in 0..height {
        for x in 0..width {
            let i = y * width + x;
            if x + 1 < width {
                let g = flux.right(i);
                rhs[i] -= g;
                rhs[i + 1] += g;
            }
            if y + 1 < height {
                let g = flux.below(i);
                rhs[i] -= g;
                rhs[i + width] += g;
            }
        }
    }
    rhs
}

fn cosine(k: usize, row: usize, height: usize) -> f64 {
    // The remainder keeps the angle small, and so exact, for any size.
    let turns = k * (2 * row + 1) % (4 * height);
    (PI * turns as f64 / (2 * height) as f64).cos()
}

/// Row `k` of the result is the sum of the rows of the input, each times `factor(row, k)`. Quadratic in the height, but
/// whole rows at a time: a second for a picture of a few million pixels is not worth a library.
fn cosine_transform(
    rows: &[f64],
    width: usize,
    height: usize,
    factor: impl Fn(usize, usize) -> f64 + Sync,
) -> Vec<f64> {
    let mut result = vec![0.0; width * height];
    parallel::for_each_chunk_mut(&mut result, width, |k, out| {
        for (row, values) in rows.chunks(width).enumerate() {
            let factor = factor(row, k);
            out.iter_mut().zip(values).for_each(|(o, v)| *o += factor * v);
        }
    });
    result
}

/// Solves the free-edged second difference along a row for its mean part, which has a solution as its right side sums
/// to 0: twice a running sum.
fn integrate(row: &mut [f64]) {
    let (mut slope, mut value) = (0.0, 0.0);
    for r in row {
        let here = value;
        slope -= *r;
        value += slope;
        *r = here;
    }
}

/// Solves `(λ + second difference with free ends) x = row` in place (Thomas's algorithm), λ > 0.
fn solve(row: &mut [f64], lambda: f64) {
    let n = row.len();
    let diagonal = |i: usize| lambda + f64::from(u8::from(i > 0) + u8::from(i + 1 < n));
    let mut upper = vec![0.0; n];
    for i in 0..n {
        let (before, value) = if i > 0 { (upper[i - 1], row[i - 1]) } else { (0.0, 0.0) };
        let pivot = diagonal(i) + before;
        upper[i] = -1.0 / pivot;
        row[i] = (row[i] + value) / pivot;
    }
    for i in (0..n.saturating_sub(1)).rev() {
        row[i] -= upper[i] * row[i + 1];
    }
}

fn explained(flux: &Flux, values: &[f64], width: usize, height: usize) -> f64 {
    let (mut all, mut left) = (0.0, 0.0);
    for y in 0..height {
        for x in 0..width {
            let i = y * width + x;
            if x + 1 < width {
                all += flux.right(i).powi(2);
                left += (values[i + 1] - values[i] - flux.right(i)).powi(2);
            }
            if y + 1 < height {
                all += flux.below(i).powi(2);
                left += (values[i + width] - values[i] - flux.below(i)).powi(2);
            }
        }
    }
    if all > 0.0 { 1.0 - left / all } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Velocities of a flow `[right, up]` given by position [m] with y up.
    fn on_pixels(size: [u32; 2], pixel: f64, f: impl Fn(f64, f64) -> [f64; 2]) -> Vec<[f64; 2]> {
        let [width, height] = size;
        (0..width * height).map(|i| f(f64::from(i % width) * pixel, -f64::from(i / width) * pixel)).collect()
    }

    #[test]
    fn a_rotation_has_a_parabola_and_is_explained_whole() {
        for size in [[31, 20], [20, 31], [1, 7], [7, 1], [1, 1]] {
            let pixel = 0.1;
            let velocity = on_pixels(size, pixel, |x, y| [-2.0 * y, 2.0 * x]);
            let stream = stream_function(&velocity, size, pixel);
            let expected = |i: u32| {
                let (x, y) = (f64::from(i % size[0]) * pixel, f64::from(i / size[0]) * pixel);
                -(x * x + y * y)
            };
            let count = size[0] * size[1];
            let mean = (0..count).map(expected).sum::<f64>() / f64::from(count);
            for i in 0..count {
                let found = stream.values[i as usize];
                assert!((found - expected(i) + mean).abs() < 1e-9, "{size:?} {i}: {found}");
            }
            assert!((stream.explained - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn a_source_has_no_stream_function() {
        // The gradient of sin(πx) sin(πy) on the unit square, which has no flow along the border: then the two parts of
        // a flow are orthogonal on pixels too.
        let angle = |x: f64| std::f64::consts::PI * (x + 0.5 / 40.0);
        let velocity = on_pixels([40, 40], 1.0 / 40.0, |x, y| {
            let ((sx, cx), (sy, cy)) = (angle(x).sin_cos(), angle(-y).sin_cos());
            [cx * sy, -sx * cy]
        });
        let stream = stream_function(&velocity, [40, 40], 1.0 / 40.0);
        assert!(stream.explained < 1e-9, "{}", stream.explained);
        assert!(stream.values.iter().all(|v| v.abs() < 1e-9));
    }
}
