//! A scalar field on a lattice, interpolated by tricubic B-splines: twice continuously differentiable, with value and
//! gradient of the very same function.
//!
//! Unser 1999, *Splines: A Perfect Fit for Signal and Image Processing*, equations 6 (the basis) and box 2 (samples to
//! coefficients). At the borders the second derivative is zero, so that the field continues in straight lines outside,
//! still twice continuously differentiable.

use crate::math::jet::Scalar;
use crate::math::lattice::Lattice;
use crate::math::parallel;
use crate::math::real::{Lane, MAX_WIDTH, triple};
use glam::{DVec3, UVec3};

/// A field on a lattice whose first sample sits at `origin`.
#[derive(Debug, Clone)]
pub struct Spline {
    origin: DVec3,
    spacing: f64,
    /// Number of samples along each axis, at least 2.
    dims: UVec3,
    /// One more than the samples on every side.
    coefficients: Lattice<f32>,
}

/// Four neighbouring weights along one axis, and their derivatives by position [1/m].
#[derive(Clone, Copy)]
struct Weights<L> {
    /// Index of the first coefficient.
    first: L,
    value: [L; 4],
    slope: [L; 4],
}

impl Spline {
    /// Distance between samples [m].
    pub fn spacing(&self) -> f64 {
        self.spacing
    }

    /// The spline through `samples`, which lie `spacing` [m] apart.
    ///
    /// # Panics
    /// Where there are fewer than 2 samples along an axis.
    pub fn new(origin: DVec3, spacing: f64, samples: &Lattice<f32>) -> Self {
        let dims = samples.dims();
        assert!(dims.min_element() >= 2, "a spline needs two samples along each axis, not {dims}");
        let (nx, ny) = (dims.x as usize, dims.y as usize);
        let slice = nx * ny;
        let mut values = samples.values().to_vec();
        let [along_x, along_y, along_z] = dims.to_array().map(Filter::new);
        parallel::for_each_chunk_mut(&mut values, slice, |_, plane| {
            plane.chunks_mut(nx).for_each(|row| along_x.apply(row, 1));
            along_y.apply(plane, nx);
        });
        along_z.apply(&mut values, slice);

        let outer = dims + 2;
        let mut coefficients = Lattice::filled(outer, 0.0);
        for z in 0..dims.z {
            for y in 0..dims.y {
                let from = (z as usize * ny + y as usize) * nx;
                let to = coefficients.offset(UVec3::new(1, y + 1, z + 1));
                coefficients.values_mut()[to..to + nx].copy_from_slice(&values[from..from + nx]);
            }
        }
        // Straight continuation, axis after axis so that edges and corners are filled too.
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for a in 0..outer[u] {
                for b in 0..outer[v] {
                    let at = |i: u32| {
                        let mut p = UVec3::ZERO;
                        (p[axis], p[u], p[v]) = (i, a, b);
                        p
                    };
                    let n = outer[axis];
                    let low = 2.0 * coefficients.at(at(1)) - coefficients.at(at(2));
                    let high = 2.0 * coefficients.at(at(n - 2)) - coefficients.at(at(n - 3));
                    coefficients.set(at(0), low);
                    coefficients.set(at(n - 1), high);
                }
            }
        }
        Self { origin, spacing, dims, coefficients }
    }

    /// Where the first sample is [m].
    pub fn min(&self) -> DVec3 {
        self.origin
    }

    /// Where the last sample is [m].
    pub fn max(&self) -> DVec3 {
        self.origin + (self.dims - 1).as_dvec3() * self.spacing
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> u64 {
        4 * self.coefficients.values().len() as u64
    }

    /// The field at `p` [m] with its gradient.
    #[inline(never)]
    pub fn at<L: Lane>(&self, p: [L; 3]) -> Scalar<L> {
        p[0].outlined(
            #[inline(always)]
            || self.at_here(p),
        )
    }

    /// The field at `p` [m], to the bit as [`Spline::at`] has it.
    #[inline(never)]
    pub fn value<L: Lane>(&self, p: [L; 3]) -> L {
        p[0].outlined(
            #[inline(always)]
            || self.value_here(p),
        )
    }

    #[inline(always)]
    fn at_here<L: Lane>(&self, p: [L; 3]) -> Scalar<L> {
        let weights @ [x, y, z]: [Weights<L>; 3] = triple!(axis => self.weights(p[axis], axis));
        let first = self.first(&weights);
        let zero = p[0].lit(0.0);
        let mut sum = Scalar { value: zero, gradient: [zero; 3] };
        for k in 0..4 {
            // Summed along x and y: the field, and its derivatives by x and y.
            let [mut s, mut by_x, mut by_y] = [zero; 3];
            for j in 0..4 {
                let [c0, c1, c2, c3] = self.row(p[0], &first, j, k);
                let value = c0.mul_add(x.value[0], c1.mul_add(x.value[1], c2.mul_add(x.value[2], c3 * x.value[3])));
                let slope = c0.mul_add(x.slope[0], c1.mul_add(x.slope[1], c2.mul_add(x.slope[2], c3 * x.slope[3])));
                s = value.mul_add(y.value[j], s);
                by_y = value.mul_add(y.slope[j], by_y);
                by_x = slope.mul_add(y.value[j], by_x);
            }
            sum.value = s.mul_add(z.value[k], sum.value);
            sum.gradient[0] = by_x.mul_add(z.value[k], sum.gradient[0]);
            sum.gradient[1] = by_y.mul_add(z.value[k], sum.gradient[1]);
            sum.gradient[2] = s.mul_add(z.slope[k], sum.gradient[2]);
        }
        sum
    }

    #[inline(always)]
    fn value_here<L: Lane>(&self, p: [L; 3]) -> L {
        let weights @ [x, y, z]: [Weights<L>; 3] = triple!(axis => self.weights(p[axis], axis));
        let first = self.first(&weights);
        let mut sum = p[0].lit(0.0);
        for k in 0..4 {
            let mut s = p[0].lit(0.0);
            for j in 0..4 {
                let [c0, c1, c2, c3] = self.row(p[0], &first, j, k);
                let value = c0.mul_add(x.value[0], c1.mul_add(x.value[1], c2.mul_add(x.value[2], c3 * x.value[3])));
                s = value.mul_add(y.value[j], s);
            }
            sum = s.mul_add(z.value[k], sum);
        }
        sum
    }

    /// Where the coefficients begin that count for each lane.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn first<L: Lane>(&self, [x, y, z]: &[Weights<L>; 3]) -> [usize; MAX_WIDTH] {
        let dims = self.coefficients.dims();
        let (row, slice) = (dims.x as usize, dims.x as usize * dims.y as usize);
        let mut first = [0; MAX_WIDTH];
        for lane in 0..L::WIDTH {
            let (i, j, k) = (x.first.lane(lane) as usize, y.first.lane(lane) as usize, z.first.lane(lane) as usize);
            first[lane] = i + j * row + k * slice;
        }
        first
    }

    /// Four coefficients along x, the `j`th and `k`th along y and z from the `first` of each lane.
    #[inline(always)]
    fn row<L: Lane>(&self, like: L, first: &[usize; MAX_WIDTH], j: usize, k: usize) -> [L; 4] {
        let dims = self.coefficients.dims();
        let offset = dims.x as usize * (j + k * dims.y as usize);
        let coefficients = self.coefficients.values();
        like.gather_four(
            #[inline(always)]
            |lane| {
                let at = first[lane] + offset;
                &coefficients[at..at + 4]
            },
        )
    }

    #[inline(always)]
    fn weights<L: Lane>(&self, x: L, axis: usize) -> Weights<L> {
        let inverse = x.lit(1.0 / self.spacing);
        let last = f64::from(self.dims[axis] - 1);
        let u = (x - x.lit(self.origin[axis])) * inverse;
        let inside = u.clamp(x.lit(0.0), x.lit(last));
        let first = inside.floor().min(x.lit(last - 1.0));
        let (value, slope) = basis(inside - first);
        let beyond = u - inside;
        let value = [
            slope[0].mul_add(beyond, value[0]),
            slope[1].mul_add(beyond, value[1]),
            slope[2].mul_add(beyond, value[2]),
            slope[3].mul_add(beyond, value[3]),
        ];
        let slope = [slope[0] * inverse, slope[1] * inverse, slope[2] * inverse, slope[3] * inverse];
        Weights { first, value, slope }
    }
}

/// The four cubic B-splines that are not zero at `t` in [0, 1], and their derivatives.
#[inline(always)]
fn basis<L: Lane>(t: L) -> ([L; 4], [L; 4]) {
    let (one, half, sixth) = (t.lit(1.0), t.lit(0.5), t.lit(1.0 / 6.0));
    let s = one - t;
    let (tt, ss) = (t * t, s * s);
    let (near, near_slope) = near_middle(t);
    let (far, far_slope) = near_middle(s);
    ([ss * s * sixth, near, far, tt * t * sixth], [-(ss * half), near_slope, -far_slope, tt * half])
}

/// The cubic B-spline within 1 of its middle, and its derivative.
#[inline(always)]
fn near_middle<L: Lane>(t: L) -> (L, L) {
    let square = t * t;
    let value = square.mul_add(t.mul_add(t.lit(0.5), t.lit(-1.0)), t.lit(2.0 / 3.0));
    (value, square.mul_add(t.lit(1.5), -(t + t)))
}

/// Solves (c[i−1] + 4 c[i] + c[i+1])/6 = f[i] between c = f at both ends.
struct Filter {
    /// Of the forward elimination: 1/(4 − previous factor).
    factors: Vec<f32>,
}

impl Filter {
    fn new(count: u32) -> Self {
        let mut factors = vec![0.0f32; count as usize];
        for i in 1..factors.len() {
            factors[i] = 1.0 / (4.0 - factors[i - 1]);
        }
        Self { factors }
    }

    /// Filters along the axis whose samples lie `stride` apart, all lines in `values` at once.
    fn apply(&self, values: &mut [f32], stride: usize) {
        let n = self.factors.len();
        for i in 1..n - 1 {
            let (before, rest) = values.split_at_mut(i * stride);
            let factor = self.factors[i];
            for (value, previous) in rest[..stride].iter_mut().zip(&before[(i - 1) * stride..]) {
                *value = (6.0 * *value - previous) * factor;
            }
        }
        for i in (1..n - 1).rev() {
            let (before, rest) = values.split_at_mut((i + 1) * stride);
            let factor = self.factors[i];
            for (value, next) in before[i * stride..].iter_mut().zip(&rest[..stride]) {
                *value -= factor * next;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(p: DVec3) -> f64 {
        (1.3 * p.x).sin() * (0.9 * p.y).cos() + 0.3 * p.z * p.x - (0.7 * p.z).sin()
    }

    fn sampled(dims: UVec3, spacing: f64, origin: DVec3) -> Spline {
        let values = (0..dims.element_product())
            .map(|i| {
                let p = UVec3::new(i % dims.x, i / dims.x % dims.y, i / dims.x / dims.y);
                field(origin + p.as_dvec3() * spacing) as f32
            })
            .collect();
        Spline::new(origin, spacing, &Lattice::from_values(dims, values))
    }

    #[test]
    fn the_spline_goes_through_its_samples() {
        let (origin, spacing) = (DVec3::new(-1.0, 0.2, 0.4), 0.3);
        let spline = sampled(UVec3::new(9, 7, 8), spacing, origin);
        for (x, y, z) in [(0, 0, 0), (8, 6, 7), (3, 2, 5), (0, 6, 3)] {
            let p = origin + DVec3::new(f64::from(x), f64::from(y), f64::from(z)) * spacing;
            assert!((spline.at(p.to_array()).value - field(p)).abs() < 1e-6, "{p}");
        }
    }

    #[test]
    fn the_gradient_is_that_of_the_spline_itself_inside_and_outside() {
        let spline = sampled(UVec3::new(9, 7, 8), 0.3, DVec3::ZERO);
        let h = 1e-4;
        for i in 0..300 {
            let a = f64::from(i);
            let p = DVec3::new((a * 0.71).sin() + 1.0, (a * 1.37).cos() + 1.0, (a * 2.11).sin() + 1.0) * 1.6 - 0.4;
            let field = spline.at(p.to_array());
            for axis in 0..3 {
                let step = DVec3::AXES[axis] * h;
                let (up, down) = (spline.at((p + step).to_array()), spline.at((p - step).to_array()));
                assert!((field.gradient[axis] - (up.value - down.value) / (2.0 * h)).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn second_derivatives_are_continuous_across_cells_and_the_border() {
        let spline = sampled(UVec3::new(9, 7, 8), 0.3, DVec3::ZERO);
        let h = 1e-5;
        for plane in [0.0, 0.3, 0.6, 1.5, 1.8] {
            for axis in 0..3 {
                let gradient = |offset: f64| {
                    let mut p = DVec3::new(0.41, 0.77, 0.93);
                    p[axis] = plane + offset;
                    DVec3::from_array(spline.at(p.to_array()).gradient)
                };
                let (before, at, after) = (gradient(-h), gradient(0.0), gradient(h));
                let jump = ((after - at) - (at - before)) / h;
                assert!(jump.abs().max_element() < 1e-3, "axis {axis} at {plane}: {jump}");
            }
        }
    }

    #[test]
    fn the_error_falls_with_the_fourth_power_of_the_spacing() {
        let worst = |n: u32| {
            let spline = sampled(UVec3::splat(n + 1), 4.0 / f64::from(n), DVec3::ZERO);
            let errors = (0..400).map(|i| {
                let a = f64::from(i);
                let p = DVec3::new((a * 0.71).sin(), (a * 1.37).cos(), (a * 2.11).sin()) * 0.5 + 2.0;
                (spline.at(p.to_array()).value - field(p)).abs()
            });
            errors.fold(0.0, f64::max)
        };
        let (coarse, fine) = (worst(8), worst(16));
        assert!(coarse / fine > 10.0, "{coarse} {fine}");
    }
}
