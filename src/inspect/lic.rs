//! Line integral convolution: white noise smeared along the flow, so that its direction can be seen everywhere at once
//! (Cabral and Leedom 1993, *Imaging Vector Fields Using Line Integral Convolution*).
//!
//! Lines take steps of half a pixel by the midpoint rule through the bilinear interpolation of the directions, and are
//! weighted by a window that falls to 0 at both ends. The noise has no edges; lines that leave the picture go on with
//! the direction at its border, so the border looks like the rest.

use crate::math::hash::Seed;
use crate::math::parallel;
use std::f64::consts::PI;

/// Length of a step [pixels].
const STEP: f64 = 0.5;

/// Directions of a flow on pixels.
#[derive(Debug, Clone)]
pub struct Directions {
    size: [usize; 2],
    /// Right and down, length 1 or 0.
    unit: Vec<[f64; 2]>,
    is_solid: Vec<bool>,
}

impl Directions {
    /// From velocities `[right, up]` and whether each pixel is inside an obstacle, where lines end.
    ///
    /// # Panics
    /// When there is not one of both for each pixel, or no pixel.
    pub fn new(velocity: &[[f64; 2]], is_solid: Vec<bool>, size: [u32; 2]) -> Self {
        let size = size.map(|n| n as usize);
        let count = size[0] * size[1];
        assert!(count > 0 && velocity.len() == count && is_solid.len() == count, "one velocity for each pixel");
        let unit = velocity
            .iter()
            .map(|&[right, up]| {
                let length = right.hypot(up);
                if length > 0.0 && length.is_finite() { [right / length, -up / length] } else { [0.0; 2] }
            })
            .collect();
        Self { size, unit, is_solid }
    }

    fn pixel(&self, p: [f64; 2]) -> usize {
        let [x, y] = [0, 1].map(|i| (p[i].max(0.0) as usize).min(self.size[i] - 1));
        y * self.size[0] + x
    }

    /// The direction at a place [pixels], length 1 or 0.
    fn at(&self, p: [f64; 2]) -> [f64; 2] {
        let [(x0, x1, tx), (y0, y1, ty)] = [0, 1].map(|i| {
            let last = self.size[i] - 1;
            let place = (p[i] - 0.5).clamp(0.0, last as f64);
            let low = place as usize;
            (low, (low + 1).min(last), place - low as f64)
        });
        let row = |y: usize| {
            let (a, b) = (self.unit[y * self.size[0] + x0], self.unit[y * self.size[0] + x1]);
            [0, 1].map(|i| a[i] * (1.0 - tx) + b[i] * tx)
        };
        let (top, bottom) = (row(y0), row(y1));
        let d = [0, 1].map(|i| top[i] * (1.0 - ty) + bottom[i] * ty);
        let length = d[0].hypot(d[1]);
        if length > 1e-9 { d.map(|x| x / length) } else { [0.0; 2] }
    }

    /// The place a step further along the flow, or against it.
    fn step(&self, p: [f64; 2], sign: f64) -> Option<[f64; 2]> {
        let along = |d: [f64; 2], length: f64| [0, 1].map(|i| p[i] + sign * length * d[i]);
        let middle = self.at(along(self.at(p), 0.5 * STEP));
        let next = along(middle, STEP);
        (middle != [0.0; 2] && !self.is_solid[self.pixel(next)]).then_some(next)
    }

    /// Smears the noise of `seed` over `half_length` pixels to either side. The result has mean 0 and standard deviation
    /// 1 over all pixels outside obstacles, and is 0 inside; it does not depend on threads.
    pub fn convolve(&self, half_length: f64, seed: Seed) -> Vec<f32> {
        let steps = (half_length / STEP).ceil().max(1.0) as usize;
        let window: Vec<f64> = (0..=steps).map(|n| 0.5 + 0.5 * (PI * n as f64 / (steps + 1) as f64).cos()).collect();
        let width = self.size[0];
        let mut values = parallel::map(self.unit.len(), |i| {
            if self.is_solid[i] {
                return 0.0;
            }
            let start = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
            self.smear(start, &window, seed) as f32
        });
        normalise(&mut values, &self.is_solid);
        values
    }

    fn smear(&self, start: [f64; 2], window: &[f64], seed: Seed) -> f64 {
        let (mut sum, mut weight) = (window[0] * noise(start, seed), window[0]);
        for sign in [1.0, -1.0] {
            let mut p = start;
            for w in &window[1..] {
                let Some(next) = self.step(p, sign) else { break };
                p = next;
                sum += w * noise(p, seed);
                weight += w;
            }
        }
        sum / weight
    }
}

/// White noise, one value in [−½, ½) for each pixel of an endless plane.
fn noise(p: [f64; 2], seed: Seed) -> f64 {
    let [x, y] = p.map(|x| x.floor() as i64 as u64);
    f64::from(seed.derive(y).uniform(x)) - 0.5
}

fn normalise(values: &mut [f32], is_solid: &[bool]) {
    let outside = || values.iter().zip(is_solid).filter(|(_, solid)| !**solid).map(|(v, _)| f64::from(*v));
    let count = outside().count().max(1) as f64;
    let mean = outside().sum::<f64>() / count;
    let deviation = (outside().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt();
    let scale = if deviation > 0.0 { 1.0 / deviation } else { 0.0 };
    for (v, _) in values.iter_mut().zip(is_solid).filter(|(_, solid)| !**solid) {
        *v = ((f64::from(*v) - mean) * scale) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [96, 64];

    fn turning() -> Directions {
        let velocity: Vec<[f64; 2]> =
            (0..SIZE[0] * SIZE[1]).map(|i| [f64::from(i / SIZE[0]) - 31.5, f64::from(i % SIZE[0]) - 47.5]).collect();
        Directions::new(&velocity, vec![false; velocity.len()], SIZE)
    }

    /// Mean square difference of places one pixel apart in a direction, relative to that of independent values, 2.
    fn change(values: &[f32], by: impl Fn(f64, f64) -> [f64; 2]) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for y in 4..60 {
            for x in 4..92 {
                let [dx, dy] = by(f64::from(x), f64::from(y));
                let (x1, y1) = ((f64::from(x) + dx).round() as usize, (f64::from(y) + dy).round() as usize);
                let here = values[y as usize * 96 + x as usize];
                sum += f64::from(here - values[y1 * 96 + x1]).powi(2);
                count += 1.0;
            }
        }
        0.5 * sum / count
    }

    #[test]
    fn values_stay_along_lines_and_change_across_them() {
        let level = Directions::new(&[[1.0, 0.0]; 96 * 64], vec![false; 96 * 64], SIZE).convolve(16.0, Seed(1));
        let (along, across) = (change(&level, |_, _| [1.0, 0.0]), change(&level, |_, _| [0.0, 1.0]));
        assert!(along < 0.05 && across > 0.8, "{along} {across}");
        let turned = turning().convolve(16.0, Seed(1));
        let radial = |x: f64, y: f64| {
            let (dx, dy) = (x - 47.5, y - 31.5);
            let r = dx.hypot(dy);
            [3.0 * dx / r, 3.0 * dy / r]
        };
        let along = change(&turned, |x, y| {
            let [dx, dy] = radial(x, y);
            [-dy, dx]
        });
        let across = change(&turned, radial);
        assert!(along < 0.5 * across && across > 0.6, "{along} {across}");
    }

    #[test]
    fn threads_do_not_matter_and_the_seed_does() {
        let with = |threads: usize, seed: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| turning().convolve(12.0, Seed(seed)))
        };
        assert_eq!(with(1, 5), with(2, 5));
        assert_ne!(with(1, 5), with(1, 6));
    }

    #[test]
    fn obstacles_and_still_air_stay_finite() {
        let mut solid = vec![false; 96 * 64];
        solid[..96 * 20].fill(true);
        let values = Directions::new(&[[0.0, 1.0]; 96 * 64], solid, SIZE).convolve(16.0, Seed(1));
        assert!(values[..96 * 20].iter().all(|&v| v == 0.0) && values.iter().all(|v| v.is_finite()));
        let still = Directions::new(&[[0.0; 2]; 96 * 64], vec![false; 96 * 64], SIZE).convolve(16.0, Seed(1));
        assert!(still.iter().all(|v| v.is_finite()));
    }
}
