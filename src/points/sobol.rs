//! The sequence of Sobol' with scrambling after Owen, as many points as one likes.
//!
//! Direction numbers are those of Joe and Kuo 2008 (*Constructing Sobol sequences with better two-dimensional projections*);
//! scrambling is by hash, each bit flipped by all bits above it (Burley 2020, *Practical Hash-based Owen Scrambling*, with the
//! hash of Vegdahl 2021, *Building a Better LK Hash*).

use crate::math::hash::Seed;
use crate::math::parallel;
use crate::points::PointSet;

/// Degree, coefficients and first direction numbers of the primitive polynomials, for the second dimension and on.
const POLYNOMIALS: [(u32, u32, [u32; 4]); 6] = [
    (1, 0, [1, 0, 0, 0]),
    (2, 1, [1, 3, 0, 0]),
    (3, 1, [1, 3, 1, 0]),
    (3, 2, [1, 1, 1, 0]),
    (4, 1, [1, 1, 3, 3]),
    (4, 4, [1, 3, 5, 13]),
];

/// The first `count` points.
pub fn sobol(dimension: usize, count: u64, seed: Seed) -> PointSet {
    let directions: Vec<[u32; 32]> = (0..dimension).map(directions).collect();
    let mut coordinates = vec![0.0; count as usize * dimension];
    parallel::for_each_chunk_mut(&mut coordinates, dimension, |i, point| {
        for (axis, x) in point.iter_mut().enumerate() {
            let word = (0..32).filter(|bit| i >> bit & 1 == 1).fold(0, |word, bit| word ^ directions[axis][bit]);
            let scrambled = scramble(word, seed.word(axis as u64) as u32);
            *x = (f64::from(scrambled) + 0.5) / 2f64.powi(32);
        }
    });
    PointSet { dimension, coordinates }
}

/// Direction numbers of an axis, by the recurrence of its polynomial.
fn directions(axis: usize) -> [u32; 32] {
    let mut v = std::array::from_fn(|k| 1 << (31 - k));
    let Some(&(degree, coefficients, first)) = axis.checked_sub(1).map(|i| &POLYNOMIALS[i]) else { return v };
    let degree = degree as usize;
    for k in 0..32 {
        if k < degree {
            v[k] = first[k] << (31 - k);
            continue;
        }
        v[k] = v[k - degree] ^ (v[k - degree] >> degree);
        for j in 1..degree {
            if coefficients >> (degree - 1 - j) & 1 == 1 {
                v[k] ^= v[k - j];
            }
        }
    }
    v
}

/// Each bit flipped or not, as a hash of the bits above it says.
fn scramble(word: u32, seed: u32) -> u32 {
    // In reversed words the bits above are those below, and carries go upwards only.
    let mut x = word.reverse_bits();
    x ^= x.wrapping_mul(0x3D20_ADEA);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6C56);
    x ^= x.wrapping_mul(0x53A2_2864);
    x.reverse_bits()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_axis_and_the_first_two_together_are_stratified() {
        let (m, count) = (10, 1u64 << 10);
        let set = sobol(7, count, Seed(5));
        for axis in 0..7 {
            let mut cells: Vec<usize> = (0..set.len()).map(|i| (set.point(i)[axis] * count as f64) as usize).collect();
            cells.sort_unstable();
            assert!(cells.iter().enumerate().all(|(i, c)| i == *c), "{axis}");
        }
        for split in 0..=m {
            let mut hits = vec![0; count as usize];
            for i in 0..set.len() {
                let p = set.point(i);
                let (x, y) = ((p[0] * f64::from(1 << split)) as usize, (p[1] * f64::from(1 << (m - split))) as usize);
                hits[x << (m - split) | y] += 1;
            }
            assert!(hits.iter().all(|n| *n == 1), "{split}");
        }
        assert_ne!(sobol(3, 64, Seed(1)), sobol(3, 64, Seed(2)));
    }

    #[test]
    fn direction_numbers_are_those_of_joe_and_kuo() {
        // The first that each recurrence makes, worked out by hand.
        for (axis, k, number) in [(1, 4, 17), (2, 2, 3), (3, 3, 5), (4, 3, 11), (5, 4, 25), (6, 4, 11)] {
            assert_eq!(directions(axis)[k] >> (31 - k), number, "{axis}");
        }
        let first = |axis: usize, count: usize| (0..count).map(|k| directions(axis)[k] >> (31 - k)).collect::<Vec<_>>();
        assert_eq!((first(5, 4), first(6, 4)), (vec![1, 1, 3, 3], vec![1, 3, 5, 13]));
    }

    #[test]
    fn integrals_converge_faster_than_by_chance() {
        // The mean of a product over the cube of seven dimensions is 1.
        let mut squares = 0.0;
        for seed in 0..8 {
            let set = sobol(7, 1 << 12, Seed(seed));
            let value = |i| set.point(i).iter().map(|x| 1.0 + (x - 0.5)).product::<f64>();
            let mean = (0..set.len()).map(value).sum::<f64>() / set.len() as f64;
            squares += (mean - 1.0f64).powi(2) / 8.0;
        }
        // By chance: √((13/12)^7 − 1) / 64.
        assert!(squares.sqrt() < 0.1 * 0.0135, "{}", squares.sqrt());
    }
}
