//! How evenly points are spread: the distance from each to its closest, and how many there are at each distance.

use crate::math::parallel;
use crate::points::{DIMENSIONS, PointSet};

/// Points of a part of the tree that are looked at one by one.
const LEAF: usize = 12;
/// Axes, at most.
const AXES: usize = *DIMENSIONS.end();
/// Points round which others are counted.
const CENTERS: usize = 2048;

/// Points sorted so that those of each half lie on one side of its middle one along the axis of its level.
struct Tree<'a> {
    set: &'a PointSet,
    order: Vec<u32>,
}

/// The distance from each point to the closest other one; infinite for a single point.
pub fn nearest_distances(set: &PointSet) -> Vec<f64> {
    let mut order: Vec<u32> = (0..set.len() as u32).collect();
    sort(set, &mut order, 0);
    let tree = Tree { set, order };
    parallel::map(set.len(), |i| {
        let mut best = f64::INFINITY;
        tree.search(i as u32, &tree.order, 0, &mut best, [0.0; AXES]);
        best.sqrt()
    })
}

fn sort(set: &PointSet, order: &mut [u32], axis: usize) {
    if order.len() <= LEAF {
        return;
    }
    let middle = order.len() / 2;
    let key = |i: &u32| set.point(*i as usize)[axis];
    order.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
    let next = (axis + 1) % set.dimension;
    let (low, high) = order.split_at_mut(middle);
    parallel::join(&mut || sort(set, low, next), &mut || sort(set, &mut high[1..], next));
}

impl Tree<'_> {
    /// Lowers `best` to the square of the distance from point `i` to the closest other one of `part`, which lies in a box
    /// whose distances along the axes have the squares `away`.
    fn search(&self, i: u32, part: &[u32], axis: usize, best: &mut f64, mut away: [f64; AXES]) {
        let point = self.set.point(i as usize);
        let square = |j: u32| {
            let other = self.set.point(j as usize);
            if i == j { f64::INFINITY } else { point.iter().zip(other).map(|(a, b)| (a - b) * (a - b)).sum() }
        };
        if part.len() <= LEAF {
            *best = part.iter().map(|&j| square(j)).fold(*best, f64::min);
            return;
        }
        let middle = part.len() / 2;
        let offset = point[axis] - self.set.point(part[middle] as usize)[axis];
        *best = best.min(square(part[middle]));
        let next = (axis + 1) % self.set.dimension;
        let (low, high) = (&part[..middle], &part[middle + 1..]);
        let (near, far) = if offset < 0.0 { (low, high) } else { (high, low) };
        self.search(i, near, next, best, away);
        away[axis] = offset * offset;
        if away.iter().sum::<f64>() < *best {
            self.search(i, far, next, best, away);
        }
    }
}

/// Least and median of distances, which it sorts.
///
/// # Panics
/// Where there are none.
pub fn least_and_median(distances: &mut [f64]) -> [f64; 2] {
    distances.sort_by(f64::total_cmp);
    let n = distances.len();
    [distances[0], 0.5 * (distances[n / 2] + distances[(n - 1) / 2])]
}

/// The radial distribution function: how many points there are at a distance, relative to as many spread evenly. Of the
/// unit cube, taken for one of many side by side: pairs across opposite faces count, also of sets that do not go on there.
/// Counted round some thousands of points.
#[derive(Debug, Clone, PartialEq)]
pub struct RadialDistribution {
    /// Width of a bin, in edges of the cube.
    pub bin: f64,
    /// A value for each bin from distance 0 on.
    pub values: Vec<f64>,
}

/// The [`RadialDistribution`] of a set in `bins` bins up to distance `reach`, at most half an edge.
pub fn radial_distribution(set: &PointSet, reach: f64, bins: usize) -> RadialDistribution {
    let (reach, n) = (reach.min(0.5), set.len());
    let bin = reach / bins as f64;
    let step = n.div_ceil(CENTERS).max(1);
    let centers: Vec<usize> = (0..n).step_by(step).collect();
    let count = |center: usize| {
        let i = centers[center];
        let mut counts = vec![0u32; bins];
        for j in (0..n).filter(|&j| j != i) {
            let wrapped = |(a, b): (&f64, &f64)| {
                let d = a - b;
                d - d.round()
            };
            let square: f64 = set.point(i).iter().zip(set.point(j)).map(wrapped).map(|d| d * d).sum();
            if square < reach * reach {
                counts[((square.sqrt() / bin) as usize).min(bins - 1)] += 1;
            }
        }
        Some(counts)
    };
    let add = |a: Vec<u32>, b: Vec<u32>| a.iter().zip(&b).map(|(x, y)| x + y).collect();
    let counts = parallel::reduce(centers.len(), count, add).unwrap_or_else(|| vec![0; bins]);
    let ball = ball_volume(set.dimension as u32);
    let shell =
        |k: usize| ((k + 1) as f64 * bin).powi(set.dimension as i32) - (k as f64 * bin).powi(set.dimension as i32);
    let expected = |k: usize| ball * shell(k) * (n as f64 - 1.0).max(1.0) * centers.len().max(1) as f64;
    RadialDistribution { bin, values: (0..bins).map(|k| f64::from(counts[k]) / expected(k)).collect() }
}

/// Volume of the unit ball in n dimensions.
fn ball_volume(n: u32) -> f64 {
    match n {
        0 => 1.0,
        1 => 2.0,
        _ => std::f64::consts::TAU / f64::from(n) * ball_volume(n - 2),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};
    use crate::points::lattice;

    fn random(dimension: usize, count: usize) -> PointSet {
        let mut rng = CounterRng::new(Seed(3));
        PointSet { dimension, coordinates: (0..count * dimension).map(|_| f64::from(rng.uniform())).collect() }
    }

    #[test]
    fn the_tree_finds_what_looking_at_all_finds() {
        for dimension in 2..=7 {
            let set = random(dimension, 700);
            let found = nearest_distances(&set);
            for (i, found) in found.iter().enumerate() {
                let square = |j| set.point(i).iter().zip(set.point(j)).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
                let expected = (0..700).filter(|&j| j != i).map(square).fold(f64::INFINITY, f64::min).sqrt();
                assert!((found - expected).abs() < 1e-12, "{dimension} {i}");
            }
        }
        let [least, median] = least_and_median(&mut nearest_distances(&lattice(3, 8)));
        assert!((least - 0.125).abs() < 1e-12 && (median - 0.125).abs() < 1e-12);
    }

    #[test]
    fn points_by_chance_have_a_distribution_of_one_and_lattices_have_shells() {
        let chance = radial_distribution(&random(3, 20_000), 0.3, 30);
        assert!(chance.values[3..].iter().all(|g| (g - 1.0).abs() < 0.06), "{:?}", chance.values);
        let cells = radial_distribution(&lattice(3, 10), 0.25, 25);
        // The six neighbours of a point are at 0.1, and none nearer: in the bin below or above.
        assert!(cells.values[..9].iter().all(|g| *g == 0.0));
        let near: f64 =
            (9..11).map(|k| cells.values[k] * ((k + 1) as f64).powi(3) - cells.values[k] * (k as f64).powi(3)).sum();
        let neighbours = near * ball_volume(3) * 1e-6 * 999.0;
        assert!((neighbours - 6.0).abs() < 0.01, "{neighbours}");
        assert!((ball_volume(7) - 4.724_765_970_331_401).abs() < 1e-12);
    }
}
