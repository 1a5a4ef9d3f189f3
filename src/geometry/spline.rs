//! A scalar field on a lattice, interpolated by tricubic B-splines: twice continuously differentiable, with value,
//! gradient and Hessian of the very same function.
//!
//! Unser 1999, *Splines: A Perfect Fit for Signal and Image Processing*, equations 6 (the basis) and box 2 (samples to
//! coefficients). At the borders the second derivative is zero, so that the field continues in straight lines outside,
//! still twice continuously differentiable.

use crate::math::jet::Jet;
use crate::math::lattice::Lattice;
use glam::{DVec3, DVec4, UVec3, Vec4};
use rayon::prelude::*;

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

/// Four neighbouring weights along one axis, and their first and second derivatives by position [1, 1/m, 1/m²].
struct Weights {
    /// Index of the first coefficient.
    first: u32,
    value: DVec4,
    slope: DVec4,
    bend: DVec4,
}

impl Spline {
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
        values.par_chunks_mut(slice).for_each(|plane| {
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

    /// The field at `p`.
    #[inline]
    pub fn value(&self, p: DVec3) -> f64 {
        let [x, y, z] = self.weights(p);
        let first = self.coefficients.offset(UVec3::new(x.first, y.first, z.first));
        let mut sum = DVec4::ZERO;
        for j in 0..4 {
            let column = self.column(first, j);
            sum += contract(&column, z.value) * y.value[j];
        }
        sum.dot(x.value)
    }

    /// The field at `p` with its gradient and Hessian.
    #[inline]
    pub fn jet(&self, p: DVec3) -> Jet<f64> {
        let [x, y, z] = self.weights(p);
        let first = self.coefficients.offset(UVec3::new(x.first, y.first, z.first));
        // Sums over y and z of the rows: no derivative, by y, z, yy, zz, yz.
        let [mut s, mut sy, mut sz, mut syy, mut szz, mut syz] = [DVec4::ZERO; 6];
        for j in 0..4 {
            let column = self.column(first, j);
            let (value, slope) = (contract(&column, z.value), contract(&column, z.slope));
            s += value * y.value[j];
            sy += value * y.slope[j];
            syy += value * y.bend[j];
            sz += slope * y.value[j];
            syz += slope * y.slope[j];
            szz += contract(&column, z.bend) * y.value[j];
        }
        Jet {
            value: s.dot(x.value),
            gradient: [s.dot(x.slope), sy.dot(x.value), sz.dot(x.value)],
            hessian: [
                s.dot(x.bend),
                syy.dot(x.value),
                szz.dot(x.value),
                sy.dot(x.slope),
                sz.dot(x.slope),
                syz.dot(x.value),
            ],
        }
    }

    /// The four rows of coefficients along x at row `j` behind `first`, one for each of four z.
    #[inline]
    fn column(&self, first: usize, j: usize) -> [DVec4; 4] {
        let dims = self.coefficients.dims();
        let (row, slice) = (dims.x as usize, dims.x as usize * dims.y as usize);
        let values = self.coefficients.values();
        // Spelt out: a closure here stays a call, at a third of the time of the whole read.
        let at = first + j * row;
        [
            Vec4::from_slice(&values[at..at + 4]).as_dvec4(),
            Vec4::from_slice(&values[at + slice..at + slice + 4]).as_dvec4(),
            Vec4::from_slice(&values[at + 2 * slice..at + 2 * slice + 4]).as_dvec4(),
            Vec4::from_slice(&values[at + 3 * slice..at + 3 * slice + 4]).as_dvec4(),
        ]
    }

    #[inline]
    fn weights(&self, p: DVec3) -> [Weights; 3] {
        let inverse = 1.0 / self.spacing;
        let u = (p - self.origin) * inverse;
        [
            Self::axis_weights(u.x, self.dims.x, inverse),
            Self::axis_weights(u.y, self.dims.y, inverse),
            Self::axis_weights(u.z, self.dims.z, inverse),
        ]
    }

    #[inline]
    fn axis_weights(u: f64, count: u32, inverse: f64) -> Weights {
        let last = f64::from(count - 1);
        let inside = u.clamp(0.0, last);
        // Not negative, so truncation is the floor.
        let cell = (inside as u32).min(count - 2);
        let (value, slope, bend) = basis(inside - f64::from(cell));
        let beyond = u - inside;
        Weights {
            first: cell,
            value: value + slope * beyond,
            slope: slope * inverse,
            bend: if beyond == 0.0 { bend * (inverse * inverse) } else { DVec4::ZERO },
        }
    }
}

#[inline]
fn contract(column: &[DVec4; 4], weights: DVec4) -> DVec4 {
    column[0] * weights.x + column[1] * weights.y + column[2] * weights.z + column[3] * weights.w
}

/// The four cubic B-splines that are not zero at `t` in [0, 1], with first and second derivative.
#[inline]
fn basis(t: f64) -> (DVec4, DVec4, DVec4) {
    let s = 1.0 - t;
    let (tt, ss) = (t * t, s * s);
    (
        DVec4::new(ss * s, 4.0 - 6.0 * tt + 3.0 * tt * t, 4.0 - 6.0 * ss + 3.0 * ss * s, tt * t) / 6.0,
        DVec4::new(-0.5 * ss, 1.5 * tt - 2.0 * t, 2.0 * s - 1.5 * ss, 0.5 * tt),
        DVec4::new(s, 3.0 * t - 2.0, 3.0 * s - 2.0, t),
    )
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
            assert!((spline.value(p) - field(p)).abs() < 1e-6, "{p}");
        }
    }

    #[test]
    fn derivatives_are_those_of_the_spline_itself_inside_and_outside() {
        let spline = sampled(UVec3::new(9, 7, 8), 0.3, DVec3::ZERO);
        let h = 1e-4;
        for i in 0..300 {
            let a = f64::from(i);
            let p = DVec3::new((a * 0.71).sin() + 1.0, (a * 1.37).cos() + 1.0, (a * 2.11).sin() + 1.0) * 1.6 - 0.4;
            let jet = spline.jet(p);
            assert!((jet.value - spline.value(p)).abs() < 1e-12);
            for axis in 0..3 {
                let (up, down) = (spline.jet(p + DVec3::AXES[axis] * h), spline.jet(p - DVec3::AXES[axis] * h));
                assert!((jet.gradient[axis] - (up.value - down.value) / (2.0 * h)).abs() < 1e-5);
                for j in 0..3 {
                    let second = (up.gradient[j] - down.gradient[j]) / (2.0 * h);
                    assert!((jet.second(j, axis) - second).abs() < 1e-2, "{p} {j}{axis}");
                }
            }
        }
    }

    #[test]
    fn second_derivatives_are_continuous_across_cells_and_the_border() {
        let spline = sampled(UVec3::new(9, 7, 8), 0.3, DVec3::ZERO);
        for plane in [0.0, 0.3, 0.6, 1.5, 1.8] {
            for axis in 0..3 {
                let mut p = DVec3::new(0.41, 0.77, 0.93);
                p[axis] = plane;
                let (before, after) = (spline.jet(p - 1e-9), spline.jet(p + 1e-9));
                for k in 0..6 {
                    assert!((before.hessian[k] - after.hessian[k]).abs() < 1e-5, "axis {axis} at {plane}: {k}");
                }
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
                (spline.value(p) - field(p)).abs()
            });
            errors.fold(0.0, f64::max)
        };
        let (coarse, fine) = (worst(8), worst(16));
        assert!(coarse / fine > 10.0, "{coarse} {fine}");
    }
}
