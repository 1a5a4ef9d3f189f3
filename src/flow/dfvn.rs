//! Divergence-free vector noise (Bærentzen, Martínez, Frisvad and Lefebvre 2025, *Improving Curl Noise*): the product of
//! the gradients of n − 1 functions in n dimensions. It is along the curves on which none of the functions changes.

use crate::flow::simplex::{Simplex, Slope};
use crate::math::real::Lane;

/// A twice continuously differentiable function with its gradient.
pub trait Function<const N: usize> {
    /// Value and gradient at a point.
    fn at<L: Lane>(&self, p: [L; N]) -> Slope<L, N>;
}

/// The n − 1 functions that a field in n dimensions is made of.
pub trait Functions<const N: usize> {
    /// Function `i`, below N − 1, at a point.
    fn one<L: Lane>(&self, i: usize, p: [L; N]) -> Slope<L, N>;

    /// All functions at a point: values and gradients, of which the last is unused.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn all<L: Lane>(&self, p: [L; N]) -> Slopes<L, N> {
        let zero = p[0].lit(0.0);
        let mut all = Slopes { values: [zero; N], gradients: [[zero; N]; N] };
        for i in 0..N - 1 {
            let found = self.one(i, p);
            all.values[i] = found.value;
            all.gradients[i] = found.gradient;
        }
        all
    }
}

/// The values of all functions, and their gradients as rows; of both the last is unused.
#[derive(Debug, Clone, Copy)]
pub struct Slopes<L, const N: usize> {
    /// f.
    pub values: [L; N],
    /// ∇f.
    pub gradients: [[L; N]; N],
}

impl<const N: usize> Function<N> for Simplex<N> {
    #[inline(always)]
    fn at<L: Lane>(&self, p: [L; N]) -> Slope<L, N> {
        Simplex::at(self, p)
    }
}

/// A function of plain numbers, asked for each lane.
pub struct FromFn<F>(pub F);

impl<F: Fn([f64; N]) -> Slope<f64, N>, const N: usize> Function<N> for FromFn<F> {
    fn at<L: Lane>(&self, p: [L; N]) -> Slope<L, N> {
        let mut found = [Slope { value: 0.0, gradient: [0.0; N] }; crate::math::real::MAX_WIDTH];
        for (lane, slope) in found.iter_mut().enumerate().take(L::WIDTH) {
            *slope = self.0(p.map(|x| x.lane(lane)));
        }
        let value = p[0].gather(|lane| found[lane].value);
        Slope { value, gradient: std::array::from_fn(|i| p[0].gather(|lane| found[lane].gradient[i])) }
    }
}

impl<F: Function<N>, const N: usize, const M: usize> Functions<N> for [F; M] {
    #[inline(always)]
    fn one<L: Lane>(&self, i: usize, p: [L; N]) -> Slope<L, N> {
        const { assert!(M + 1 == N, "a field in n dimensions is made of n - 1 functions") };
        self[i].at(p)
    }
}

/// Two functions of different kinds: a field in space.
impl<F: Function<3>, G: Function<3>> Functions<3> for (F, G) {
    #[inline(always)]
    fn one<L: Lane>(&self, i: usize, p: [L; 3]) -> Slope<L, 3> {
        if i == 0 { self.0.at(p) } else { self.1.at(p) }
    }
}

/// The product of the first n − 1 rows (equation 1): at right angles to all of them, with cross(v₁, …)·v = det[v|v₁|…].
///
/// All minors are built up from those of one row less, with no division: what is smooth in the rows is smooth here too,
/// and where rows are parallel the product is 0.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
pub fn cross<L: Lane, const N: usize>(rows: &[[L; N]; N]) -> [L; N] {
    const { assert!(N >= 2 && N <= 7) };
    let one = rows[0][0].lit(1.0);
    let mut minors = [one; 128];
    for columns in 1..(1usize << N) - 1 {
        let row = columns.count_ones() as usize - 1;
        let mut sum = one.lit(0.0);
        let mut place = 0;
        for column in 0..N {
            if columns & (1 << column) == 0 {
                continue;
            }
            let minor = minors[columns & !(1 << column)];
            let signed = if (row + place).is_multiple_of(2) { minor } else { -minor };
            sum = rows[row][column].mul_add(signed, sum);
            place += 1;
        }
        minors[columns] = sum;
    }
    let mut product = rows[0];
    for i in 0..N {
        let minor = minors[((1 << N) - 1) & !(1 << i)];
        product[i] = if i.is_multiple_of(2) { minor } else { -minor };
    }
    product
}

/// The field at a point (equation 8).
#[inline(always)]
pub fn field<L: Lane, const N: usize>(functions: &impl Functions<N>, p: [L; N]) -> [L; N] {
    values_and_field(functions, p).1
}

/// The values of the functions at a point, the last unused, and the field there. Compiled once for each kind of functions: the
/// product has up to 126 minors.
#[inline(never)]
pub fn values_and_field<L: Lane, const N: usize>(functions: &impl Functions<N>, p: [L; N]) -> ([L; N], [L; N]) {
    p[0].outlined(
        #[inline(always)]
        || {
            let all = functions.all(p);
            (all.values, cross(&all.gradients))
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::bounded::{Ball, Bounded, BoundedByBall};
    use crate::geometry::primitive::{Primitive, Torus};
    use crate::geometry::sdf::{PlacedSdf, Sdf};
    use crate::math::dual::Dual;
    use crate::math::hash::{CounterRng, Seed};
    use crate::math::space::Similarity;
    use glam::DVec3;

    fn random<const N: usize>(rng: &mut CounterRng, size: f64) -> [f64; N] {
        std::array::from_fn(|_| (f64::from(rng.uniform()) - 0.5) * size)
    }

    fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    /// Determinant by elimination.
    #[allow(clippy::needless_range_loop, reason = "rows and columns")]
    fn determinant<const N: usize>(mut m: [[f64; N]; N]) -> f64 {
        let mut det = 1.0;
        for k in 0..N {
            let pivot = (k..N).max_by(|&a, &b| m[a][k].abs().total_cmp(&m[b][k].abs())).unwrap();
            if pivot != k {
                m.swap(pivot, k);
                det = -det;
            }
            det *= m[k][k];
            for i in k + 1..N {
                let factor = m[i][k] / m[k][k];
                for j in k..N {
                    m[i][j] -= factor * m[k][j];
                }
            }
        }
        det
    }

    fn check_cross<const N: usize>() {
        let mut rng = CounterRng::new(Seed(N as u64));
        for _ in 0..100 {
            let rows: [[f64; N]; N] = std::array::from_fn(|_| random(&mut rng, 2.0));
            let product = cross(&rows);
            for row in &rows[..N - 1] {
                assert!(dot(&product, row).abs() < 1e-13);
            }
            // v first, then the rows.
            let mut with_v = rows;
            with_v.rotate_right(1);
            let v: [f64; N] = random(&mut rng, 2.0);
            with_v[0] = v;
            assert!((dot(&product, &v) - determinant(with_v)).abs() < 1e-12);
        }
        let mut parallel: [[f64; N]; N] = std::array::from_fn(|_| random(&mut rng, 2.0));
        if N > 2 {
            parallel[1] = parallel[0].map(|x| -2.0 * x);
            assert!(cross(&parallel).iter().all(|x| x.abs() < 1e-15));
        }
    }

    #[test]
    fn the_product_is_at_right_angles_and_its_length_is_the_volume() {
        check_cross::<2>();
        check_cross::<3>();
        check_cross::<4>();
        check_cross::<5>();
        check_cross::<6>();
        check_cross::<7>();
        let rows = [[1.0, 2.0, 3.0], [-2.0, 0.5, 4.0], [0.0; 3]];
        assert_eq!(cross(&rows), crate::math::real::cross(rows[0], rows[1]));
    }

    /// Largest divergence against the root mean square of the field's derivatives, both differentiated to rounding.
    fn relative_divergence<const N: usize>(functions: &impl Functions<N>, size: f64) -> f64 {
        let mut rng = CounterRng::new(Seed(9));
        let (mut worst, mut square, count) = (0.0f64, 0.0, 300);
        for _ in 0..count {
            let p: [f64; N] = random(&mut rng, size);
            let mut trace = 0.0;
            // Three directions at a time.
            for first in (0..N).step_by(3) {
                let q = std::array::from_fn(|i| Dual {
                    value: p[i],
                    gradient: std::array::from_fn(|k| f64::from(u8::from(i == first + k))),
                });
                let c: [Dual<f64>; N] = field(functions, q);
                for k in 0..3.min(N - first) {
                    trace += c[first + k].gradient[k];
                    square += c.iter().map(|x| x.gradient[k].powi(2)).sum::<f64>() / f64::from(count);
                }
            }
            worst = worst.max(trace.abs());
        }
        worst / square.sqrt()
    }

    fn noises<const N: usize, const M: usize>() -> [Simplex<N>; M] {
        std::array::from_fn(|i| Simplex::new(0.8, Seed(40 + i as u64)))
    }

    fn in_a_ball<const N: usize>() -> BoundedByBall<Simplex<N>, N> {
        let inner = std::array::from_fn(|i| Simplex::new(0.8, Seed(60 + i as u64)));
        BoundedByBall { inner, bound: Some((Ball { center: [0.1; N], radius: 1.2 }, 0.9)) }
    }

    #[test]
    fn walls_make_no_divergence_in_any_dimension() {
        let torus = Torus { center: DVec3::ZERO, axis: DVec3::Y, major_radius: 1.0, minor_radius: 0.4 };
        let torus = PlacedSdf::new(Sdf::Primitive(Primitive::Torus(torus)), Similarity::IDENTITY);
        let noise = |seed| Simplex::<3>::new(0.8, Seed(seed));
        let along = (noise(1), torus.clone());
        let inside = (noise(1), Bounded { distance: torus, inner: noise(2), width: 0.3 });
        let found = [
            relative_divergence::<2>(&in_a_ball(), 2.0),
            relative_divergence::<3>(&in_a_ball(), 2.0),
            relative_divergence::<4>(&in_a_ball(), 2.0),
            relative_divergence::<5>(&in_a_ball(), 2.0),
            relative_divergence::<6>(&in_a_ball(), 2.0),
            relative_divergence::<7>(&in_a_ball(), 2.0),
            relative_divergence::<3>(&along, 2.5),
            relative_divergence::<3>(&inside, 2.5),
        ];
        println!("|∇·c| over RMS |∇c|: in balls of 2 to 7 dimensions, along a torus, in a torus {found:?}");
        assert!(found.iter().all(|worst| *worst < 1e-12), "{found:?}");
    }

    #[test]
    fn nothing_makes_divergence_in_any_dimension() {
        let found = [
            relative_divergence::<2>(&noises::<2, 1>(), 20.0),
            relative_divergence::<3>(&noises::<3, 2>(), 20.0),
            relative_divergence::<4>(&noises::<4, 3>(), 20.0),
            relative_divergence::<5>(&noises::<5, 4>(), 20.0),
            relative_divergence::<6>(&noises::<6, 5>(), 20.0),
            relative_divergence::<7>(&noises::<7, 6>(), 20.0),
        ];
        for (i, worst) in found.into_iter().enumerate() {
            println!("{} dimensions: |∇·c| at most {worst:.1e} of RMS |∇c|", i + 2);
            assert!(worst < 1e-12, "{} dimensions: {worst}", i + 2);
        }
    }
}
