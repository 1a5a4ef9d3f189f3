//! The smooth union of distances: a minimum without a crease.
//!
//! The cubic polynomial of Quílez, *Smooth minimum* (2013): `min(a, b) − k/6·(1 − |a − b|/k)³` where `|a − b| < k`, the
//! plain minimum elsewhere. Unlike the quadratic one it has two continuous derivatives in `a` and `b`, which the normals
//! of walls and of flows along surfaces need. Its derivatives by `a` and `b` are weights from 0 to 1 that add up to 1, so
//! that what two distances hold to, never to change by more than a metre in a metre, their smooth union holds to as well.

use crate::math::real::Real;

/// The smooth union of two distances [m], blended where they differ by less than `width` [m], > 0: at most the smaller
/// one, and smaller than that by at most a sixth of `width`.
#[inline(always)]
pub fn smooth_union<R: Real>(a: R, b: R, width: f64) -> R {
    let overlap = (a.lit(1.0) - (a - b).abs() * a.lit(1.0 / width)).max(a.lit(0.0));
    a.min(b) - overlap * overlap * overlap * a.lit(width / 6.0)
}

/// At most how much smaller the smooth union of `count` distances, taken one after the other, is than the least of them
/// [m].
pub fn deepest(count: usize, width: f64) -> f64 {
    // The k-th is blended with what may be this much smaller than itself already.
    let below = (1..count).fold(0.0, |below: f64, _| below + (1.0 - below).powi(3) / 6.0);
    below * width
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};
    use crate::math::jet::Jet;

    const WIDTH: f64 = 0.3;

    /// Value and derivatives along a line through the space of the two distances.
    fn along(t: f64) -> Jet<f64> {
        let [x, ..] = Jet::point([t, 0.0, 0.0]);
        smooth_union(x, x * x.lit(-0.4) + x.lit(0.2), WIDTH)
    }

    #[test]
    fn two_derivatives_are_continuous_across_the_blend_and_where_both_are_equal() {
        let h = 1e-5;
        let (mut steepest, mut blended) = (0.0f64, 0);
        for i in -60_000..60_000 {
            let (a, b) = (along(f64::from(i) * h), along(f64::from(i + 1) * h));
            blended += usize::from(a.hessian[0] != 0.0);
            // The third derivative is at most 1.4³/k², and jumps; the second must not.
            steepest = steepest.max((b.hessian[0] - a.hessian[0]).abs() / h);
            assert!((b.gradient[0] - a.gradient[0]).abs() < 1.01 * 1.96 / WIDTH * h);
        }
        println!("third derivative at most {steepest:.2}");
        assert!(steepest < 1.01 * 1.4f64.powi(3) / (WIDTH * WIDTH), "{steepest}");
        assert!(blended > 40_000 && blended < 45_000, "{blended}: the blend is 2k wide, at a slope of 1.4");
    }

    #[test]
    fn it_is_the_plain_minimum_away_from_the_blend_and_never_above_it() {
        let mut rng = CounterRng::new(Seed(3));
        let (mut plain, mut deepest_found) = (0, 0.0f64);
        for _ in 0..20_000 {
            let [a, b] = [0, 1].map(|_| f64::from(rng.uniform()) - 0.5);
            let found = smooth_union(a, b, WIDTH);
            if (a - b).abs() >= WIDTH {
                assert_eq!(found, a.min(b));
                plain += 1;
            }
            assert!(found <= a.min(b) && smooth_union(b, a, WIDTH) == found);
            deepest_found = deepest_found.max(a.min(b) - found);
        }
        assert!(plain > 5000 && deepest_found <= deepest(2, WIDTH) && deepest_found > 0.99 * deepest(2, WIDTH));
    }

    #[test]
    fn many_are_no_deeper_than_stated_and_change_no_faster_than_any_of_them() {
        let mut rng = CounterRng::new(Seed(4));
        for count in [2, 3, 5, 9] {
            let union = |d: &[f64]| d[1..].iter().fold(d[0], |all, one| smooth_union(all, *one, WIDTH));
            let mut found = 0.0f64;
            for _ in 0..5000 {
                let a: Vec<f64> = (0..count).map(|_| 0.3 * f64::from(rng.uniform())).collect();
                let b: Vec<f64> = a.iter().map(|x| x + 0.2 * f64::from(rng.uniform()) - 0.1).collect();
                let fastest = a.iter().zip(&b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
                assert!((union(&a) - union(&b)).abs() <= fastest + 1e-15);
                found = found.max(a.iter().copied().fold(f64::INFINITY, f64::min) - union(&a));
            }
            let equal = vec![0.0; count];
            println!("{count} distances: {found:.4} of at most {:.4}", deepest(count, WIDTH));
            assert!(found <= deepest(count, WIDTH) && (union(&equal) + deepest(count, WIDTH)).abs() < 1e-15);
        }
    }
}
