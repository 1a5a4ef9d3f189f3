//! Gauss–Legendre quadrature.

use std::f64::consts::PI;

/// Nodes and weights of `count` points on [a, b], by Newton's iteration on the Legendre polynomial.
pub fn nodes(count: usize, a: f64, b: f64) -> Vec<(f64, f64)> {
    (0..count)
        .map(|i| {
            let mut x = -(PI * (i as f64 + 0.75) / (count as f64 + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..100 {
                let (value, derivative) = legendre(count, x);
                slope = derivative;
                let step = value / derivative;
                x -= step;
                if step.abs() < 1e-15 {
                    break;
                }
            }
            let weight = 2.0 / ((1.0 - x * x) * slope * slope);
            (0.5 * (a + b) + 0.5 * (b - a) * x, 0.5 * (b - a) * weight)
        })
        .collect()
}

/// The Legendre polynomial of a degree ≥ 1, and its derivative.
fn legendre(degree: usize, x: f64) -> (f64, f64) {
    let (mut before, mut value) = (1.0, x);
    for l in 1..degree {
        let l = l as f64;
        (before, value) = (value, ((2.0 * l + 1.0) * x * value - l * before) / (l + 1.0));
    }
    (value, degree as f64 * (before - x * value) / (1.0 - x * x))
}

/// Legendre polynomials of degrees 0 to `count - 1` at x.
pub fn legendre_series(count: usize, x: f64) -> Vec<f64> {
    let mut values = vec![1.0, x];
    for l in 1..count.saturating_sub(1) {
        let (n, m) = (l as f64, values.len());
        values.push(((2.0 * n + 1.0) * x * values[m - 1] - n * values[m - 2]) / (n + 1.0));
    }
    values.truncate(count);
    values
}
