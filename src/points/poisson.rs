//! Poisson disks: random points no two of which are closer than a radius (Bridson 2007, *Fast Poisson Disk Sampling in Arbitrary
//! Dimensions*).

use crate::math::hash::{CounterRng, Seed};
use crate::points::PointSet;
use rand_core::Rng;

/// Tries round a point before it is left.
const TRIES: u32 = 30;
/// Axes along which points are sorted into buckets: one would look into too many buckets along more.
const BUCKET_AXES: usize = 4;

struct Buckets {
    axes: usize,
    per_axis: usize,
    /// The coordinates of the points in each, one after another.
    points: Vec<Vec<f64>>,
}

/// At most `count` points of the unit cube, no two of them closer than `radius`, grown from one in its middle: where `count`
/// ends the growth, they fill the middle alone.
pub fn poisson_disks(dimension: usize, count: u64, radius: f64, seed: Seed) -> PointSet {
    let axes = dimension.min(BUCKET_AXES);
    // No finer than the radius, so that only neighbours need be looked at, and no more than some millions.
    let most = [4000.0, 160.0, 40.0][axes - 2];
    let per_axis = (1.0 / radius).floor().clamp(1.0, most) as usize;
    let mut buckets = Buckets { axes, per_axis, points: vec![Vec::new(); per_axis.pow(axes as u32)] };
    let mut rng = CounterRng::new(seed);
    let mut set = PointSet { dimension, coordinates: vec![0.5; dimension] };
    buckets.add(set.point(0));
    let mut active = vec![0usize];
    let mut candidate = vec![0.0; dimension];
    while !active.is_empty() && (set.len() as u64) < count {
        let pick = (rng.next_u64() % active.len() as u64) as usize;
        let mut is_spent = true;
        for _ in 0..TRIES {
            fill_candidate(&mut candidate, set.point(active[pick]), radius, &mut rng);
            let is_inside = candidate.iter().all(|x| (0.0..1.0).contains(x));
            if is_inside && buckets.is_free(&candidate, radius) {
                active.push(set.len());
                set.coordinates.extend_from_slice(&candidate);
                buckets.add(&candidate);
                is_spent = false;
                break;
            }
        }
        if is_spent {
            active.swap_remove(pick);
        }
    }
    set
}

/// Uniform in the shell of one to two radii round a point.
fn fill_candidate(candidate: &mut [f64], center: &[f64], radius: f64, rng: &mut CounterRng) {
    let n = center.len() as f64;
    let mut square = 0.0;
    for x in candidate.iter_mut() {
        // A normal distribution has no preferred direction (Box and Muller 1958).
        let (u, v) = (1.0 - f64::from(rng.uniform()), f64::from(rng.uniform()));
        *x = (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos();
        square += *x * *x;
    }
    let length = radius * (1.0 + f64::from(rng.uniform()) * (2f64.powf(n) - 1.0)).powf(1.0 / n);
    for (x, c) in candidate.iter_mut().zip(center) {
        *x = c + *x * length / square.sqrt();
    }
}

impl Buckets {
    fn cell(&self, x: f64) -> usize {
        ((x * self.per_axis as f64) as usize).min(self.per_axis - 1)
    }

    fn add(&mut self, point: &[f64]) {
        let index = (0..self.axes).fold(0, |index, axis| index * self.per_axis + self.cell(point[axis]));
        self.points[index].extend_from_slice(point);
    }

    /// Whether no point is closer than `radius`.
    fn is_free(&self, point: &[f64], radius: f64) -> bool {
        let mut index = [0; BUCKET_AXES];
        self.is_free_along(0, &mut index, point, radius)
    }

    fn is_free_along(&self, axis: usize, index: &mut [usize; BUCKET_AXES], point: &[f64], radius: f64) -> bool {
        if axis == self.axes {
            let bucket = index[..self.axes].iter().fold(0, |sum, i| sum * self.per_axis + i);
            let square = |q: &[f64]| q.iter().zip(point).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
            return self.points[bucket].chunks_exact(point.len()).all(|q| square(q) >= radius * radius);
        }
        let (low, high) = (self.cell((point[axis] - radius).max(0.0)), self.cell(point[axis] + radius));
        (low..=high).all(|i| {
            index[axis] = i;
            self.is_free_along(axis + 1, index, point, radius)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::points::nearest::nearest_distances;

    #[test]
    fn no_two_are_too_close_and_no_room_is_left() {
        for (dimension, radius, least) in [(2, 0.02, 1400), (3, 0.1, 600), (5, 0.3, 90)] {
            let set = poisson_disks(dimension, 1_000_000, radius, Seed(4));
            let distances = nearest_distances(&set);
            println!("{dimension} dimensions: {} points of radius {radius}", set.len());
            assert!(distances.iter().all(|d| *d >= radius) && set.len() > least, "{dimension}: {}", set.len());
            assert!(set.coordinates.iter().all(|x| (0.0..1.0).contains(x)));
            // Anywhere in the cube is near some point.
            let mut rng = CounterRng::new(Seed(8));
            let mut lonely = 0;
            for _ in 0..300 {
                let p: Vec<f64> = (0..dimension).map(|_| f64::from(rng.uniform())).collect();
                let nearest = (0..set.len())
                    .map(|i| set.point(i).iter().zip(&p).map(|(a, b)| (a - b).powi(2)).sum::<f64>())
                    .fold(f64::INFINITY, f64::min);
                lonely += u32::from(nearest.sqrt() > 1.1 * radius);
            }
            assert!(lonely < 6, "{dimension}: {lonely}");
        }
        assert_eq!(poisson_disks(4, 50, 0.1, Seed(1)).len(), 50);
    }
}
