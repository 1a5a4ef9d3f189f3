//! Plane-parallel layers of scattering matter by doubling (van de Hulst 1980, *Multiple Light Scattering*, chapter 4;
//! de Haan, Bosma and Hovenier 1987, *The adding method*), in f64.
//!
//! Azimuth is averaged out, as fluxes do not need it. R and T are radiances out for radiance in along Gauss' nodes on both
//! half spheres, so that layers add by matrices. A layer so thin that light scatters once or not at all is doubled until it
//! is as thick as wanted.

use crate::gauss;

/// Nodes on a half sphere: Henyey–Greenstein of g = 0.9 needs some forty.
const NODES: usize = 48;
/// Doublings: the thinnest layer has 2⁻²⁶ of the depth, and the error that it brings is of that order.
const DOUBLINGS: u32 = 26;

type Matrix = Vec<Vec<f64>>;

/// What a layer does to light.
pub struct Layer {
    nodes: Vec<(f64, f64)>,
    reflection: Matrix,
    transmission: Matrix,
}

impl Layer {
    /// A layer of optical depth `tau`, single-scattering albedo and mean cosine `g` after Henyey and Greenstein.
    pub fn new(tau: f64, albedo: f64, g: f64) -> Self {
        let nodes = gauss::nodes(NODES, 0.0, 1.0);
        let thin = tau * 0.5f64.powi(DOUBLINGS as i32);
        // Legendre's series of the phase function: its coefficients are powers of g.
        let degree = 2 * NODES;
        let polynomials: Vec<Vec<f64>> = nodes.iter().map(|(mu, _)| gauss::legendre_series(degree, *mu)).collect();
        let phase = |i: usize, j: usize, is_back: bool| -> f64 {
            (0..degree)
                .map(|l| {
                    let sign = if is_back && l % 2 == 1 { -1.0 } else { 1.0 };
                    let product = polynomials[i][l] * polynomials[j][l];
                    sign * (2 * l + 1) as f64 * g.powi(l as i32) * product
                })
                .sum()
        };
        let fill = |f: &dyn Fn(usize, usize) -> f64| -> Matrix {
            (0..NODES).map(|i| (0..NODES).map(|j| f(i, j)).collect()).collect()
        };
        // Radiance along i out of radiance along j, with the weight of j's node.
        let scattered =
            |i: usize, j: usize, is_back| 0.5 * albedo * thin / nodes[i].0 * phase(i, j, is_back) * nodes[j].1;
        let mut reflection = fill(&|i, j| scattered(i, j, true));
        let mut transmission = fill(&|i, j| {
            let straight = if i == j { 1.0 - thin / nodes[i].0 } else { 0.0 };
            straight + scattered(i, j, false)
        });
        for _ in 0..DOUBLINGS {
            // Light between the two halves goes to and fro: (1 − R R)⁻¹.
            let echo = inverse_of_one_minus(&product(&reflection, &reflection));
            let through = product(&transmission, &echo);
            let back = product(&product(&through, &reflection), &transmission);
            transmission = product(&through, &transmission);
            for (row, more) in reflection.iter_mut().zip(back) {
                row.iter_mut().zip(more).for_each(|(r, m)| *r += m);
            }
        }
        Self { nodes, reflection, transmission }
    }

    /// Share of light arriving along `mu` that comes back, in all directions: by reciprocity what is seen along `mu` under
    /// light from all around on this side.
    pub fn reflectance(&self, mu: f64) -> f64 {
        self.interpolate(&self.reflection, mu)
    }

    /// Share of light arriving along `mu` that goes through, scattered or not.
    pub fn transmittance(&self, mu: f64) -> f64 {
        self.interpolate(&self.transmission, mu)
    }

    /// Sums of rows, as radiance 1 comes in along all nodes, by the polynomial through all of them.
    fn interpolate(&self, matrix: &Matrix, mu: f64) -> f64 {
        let n = self.nodes.len();
        (0..n)
            .map(|i| {
                let others = (0..n).filter(|&j| j != i);
                let basis: f64 = others.map(|j| (mu - self.nodes[j].0) / (self.nodes[i].0 - self.nodes[j].0)).product();
                basis * matrix[i].iter().sum::<f64>()
            })
            .sum()
    }
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    a.iter()
        .map(|row| {
            let mut sums = vec![0.0; b[0].len()];
            for (x, line) in row.iter().zip(b) {
                sums.iter_mut().zip(line).for_each(|(sum, y)| *sum += x * y);
            }
            sums
        })
        .collect()
}

/// By Gauss and Jordan; what comes is far from singular.
fn inverse_of_one_minus(m: &Matrix) -> Matrix {
    let n = m.len();
    let one = |i: usize, j: usize| f64::from(u8::from(i == j));
    let mut rows: Matrix =
        (0..n).map(|i| (0..n).map(|j| one(i, j) - m[i][j]).chain((0..n).map(|j| one(i, j))).collect()).collect();
    for k in 0..n {
        let pivot = (k..n).max_by(|&a, &b| rows[a][k].abs().total_cmp(&rows[b][k].abs())).expect("not empty");
        rows.swap(k, pivot);
        let scale = rows[k][k];
        rows[k].iter_mut().for_each(|x| *x /= scale);
        let line = rows[k].clone();
        for (i, row) in rows.iter_mut().enumerate() {
            let factor = row[k];
            if i != k && factor != 0.0 {
                row.iter_mut().zip(&line).for_each(|(x, y)| *x -= factor * y);
            }
        }
    }
    rows.into_iter().map(|row| row[n..].to_vec()).collect()
}
