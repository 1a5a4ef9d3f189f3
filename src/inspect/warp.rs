//! Pictures that flow: warped in their plane by divergence-free vector noise (Bærentzen et al. 2025, section 5.2), which
//! stirs and shears but neither thins nor folds.

use crate::flow::bounded::{Ball, Bounded};
use crate::flow::lift::{Height, Upright};
use crate::flow::pair::RMS_PRODUCT;
use crate::flow::reproject::Trace;
use crate::flow::simplex::Simplex;
use crate::math::hash::Seed;
use crate::math::lanes::{Batch, Kernel, run_kernel};
use crate::math::parallel;
use crate::output::image::Image;

/// How a picture flows. The unit of length is its shorter edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Warp {
    /// Size of the swirls, > 0.
    pub length: f64,
    /// How far things have flowed, as a root mean square while they keep their speed; backwards where negative.
    pub distance: f64,
    /// How ways are followed.
    pub trace: Trace,
    /// Which swirls.
    pub seed: Seed,
    /// A circle, at which swirls end.
    pub circle: Option<Circle>,
}

/// Inside of it a picture swirls; on it and beyond, things only turn about its middle (Bærentzen et al. 2025, figure 7).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Middle, from the top left corner.
    pub center: [f64; 2],
    /// Radius, > 0.
    pub radius: f64,
    /// How deep inside swirls are free, > 0 and at most the radius.
    pub width: f64,
}

impl Warp {
    /// Where what is now in the middle of each pixel of a picture came from [pixels], row after row from the top left
    /// corner; the middle of the first pixel is (0.5, 0.5).
    pub fn origins(&self, size: [u32; 2]) -> Vec<[f32; 2]> {
        self.origins_of_rows(size, &(0..size[1]).collect::<Vec<_>>())
    }

    /// The same of some rows of the picture, counted from 0.
    pub fn origins_of_rows(&self, [width, height]: [u32; 2], rows: &[u32]) -> Vec<[f32; 2]> {
        let edge = f64::from(width.min(height).max(1));
        let noise = [Simplex::new(self.length, self.seed)];
        let mut origins = vec![[0.0; 2]; width as usize * rows.len()];
        parallel::for_each_chunk_mut(&mut origins, width.max(1) as usize, |n, row| {
            let y = f64::from(rows[n]) + 0.5;
            match &self.circle {
                Some(circle) => self.row_about(circle, y, edge, row),
                None => run_kernel(Row { warp: self, noise: &noise, y, edge, row }),
            }
        });
        origins
    }

    /// One pixel after another: a third kernel for all instruction sets is not worth its time to compile.
    fn row_about(&self, circle: &Circle, y: f64, edge: f64, row: &mut [[f32; 2]]) {
        let wall = Upright(Ball { center: circle.center, radius: circle.radius });
        let bound = Bounded { distance: wall, inner: Height, width: circle.width };
        let functions = (Simplex::<3>::new(self.length, self.seed), bound);
        for (i, origin) in row.iter_mut().enumerate() {
            let p = [(i as f64 + 0.5) / edge, y / edge, 0.0];
            let q = self.trace.end(&functions, p, -self.distance / RMS_PRODUCT);
            *origin = [q[0], q[1]].map(|x| (x * edge) as f32);
        }
    }

    /// The picture after the flow: all channels, each read between four pixels; beyond its edges a picture goes on with the
    /// pixels there.
    pub fn apply(&self, image: &Image) -> Image {
        let origins = self.origins(image.data_size);
        let mut warped = image.clone();
        for (channel, from) in warped.channels.iter_mut().zip(&image.channels) {
            parallel::for_each_mut(&mut channel.data, |i, value| {
                *value = value_at(&from.data, image.data_size, origins[i]);
            });
        }
        warped
    }
}

/// The value of a channel at a place between four pixels [pixels]; beyond the edges that of the pixels there.
pub fn value_at(data: &[f32], size: [u32; 2], place: [f32; 2]) -> f32 {
    let [width, height] = size.map(|n| n as usize);
    let ([x0, x1, s], [y0, y1, t]) = (between(place[0], width), between(place[1], height));
    let row = |y: f32| {
        let at = |x: f32| data[y as usize * width + x as usize];
        at(x0) + (at(x1) - at(x0)) * s
    };
    let (top, bottom) = (row(y0), row(y1));
    top + (bottom - top) * t
}

/// The two pixels whose middles are on both sides of a place, and how far it is from the first to the second.
fn between(place: f32, count: usize) -> [f32; 3] {
    let last = count as f32 - 1.0;
    let place = (place - 0.5).clamp(0.0, last);
    let first = place.floor();
    [first, (first + 1.0).min(last), place - first]
}

struct Row<'a> {
    warp: &'a Warp,
    noise: &'a [Simplex<2>; 1],
    y: f64,
    edge: f64,
    row: &'a mut [[f32; 2]],
}

impl Kernel for Row<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Batch>(self, zero: L) {
        let (pixel, edge) = (zero.lit(1.0 / self.edge), zero.lit(self.edge));
        for start in (0..self.row.len()).step_by(L::WIDTH) {
            let x = zero.gather(|lane| (start + lane) as f64 + 0.5);
            let p = [x * pixel, zero.lit(self.y) * pixel];
            let q = self.warp.trace.end(self.noise, p, zero.lit(-self.warp.distance));
            let (x, y) = (q[0] * edge, q[1] * edge);
            for (lane, origin) in self.row[start..].iter_mut().enumerate().take(L::WIDTH) {
                *origin = [x.lane(lane) as f32, y.lane(lane) as f32];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::reproject::{Integrator, Repetition, Reprojection};
    use crate::output::image::SampleKind;

    fn warp(distance: f64, steps: u32, integrator: Integrator, reprojections: u32) -> Warp {
        let reprojection = match reprojections {
            0 => Reprojection::None,
            steps => Reprojection::Newton(Repetition { steps, tolerance: 0.0 }),
        };
        let trace = Trace { steps, integrator, reprojection };
        Warp { length: 0.25, distance, trace, seed: Seed(3), circle: None }
    }

    fn waves(size: [u32; 2]) -> Image {
        let mut image = Image::new(size);
        let wave = |i: u32| 0.5 + 0.5 * ((i % size[0]) as f32 * 0.4).sin();
        image.push("Y", SampleKind::Float, (0..size[0] * size[1]).map(wave).collect());
        image
    }

    #[test]
    fn nothing_moves_without_distance_and_colours_are_never_invented() {
        let image = waves([60, 40]);
        let still = warp(0.0, 8, Integrator::Euler, 1).apply(&image);
        assert!(still.channels[0].data.iter().zip(&image.channels[0].data).all(|(a, b)| (a - b).abs() < 1e-4));
        let warped = warp(0.4, 64, Integrator::RungeKutta, 1).apply(&image);
        assert_ne!(warped, image);
        assert!(warped.channels[0].data.iter().all(|v| (0.0..=1.0).contains(v)));
    }

    #[test]
    fn beyond_a_circle_things_only_turn_about_its_middle() {
        let circle = Circle { center: [0.6, 0.5], radius: 0.4, width: 0.3 };
        let bounded = Warp { circle: Some(circle), ..warp(0.2, 64, Integrator::RungeKutta, 2) };
        let origins = bounded.origins([96, 80]);
        let radius = |x: f64, y: f64| (x / 80.0 - 0.6).hypot(y / 80.0 - 0.5);
        let (mut moved, mut stirred) = (0, 0);
        for (i, origin) in origins.iter().enumerate() {
            let (x, y) = ((i % 96) as f64 + 0.5, (i / 96) as f64 + 0.5);
            let [from_x, from_y] = origin.map(f64::from);
            let (before, after) = (radius(from_x, from_y), radius(x, y));
            if after >= 0.4 {
                assert!((before - after).abs() < 1e-5, "{before} {after}");
                moved += usize::from((from_x - x).hypot(from_y - y) > 1.0);
            } else {
                assert!(before < 0.4 + 1e-5);
                stirred += usize::from((before - after).abs() > 0.02);
            }
        }
        assert!(moved > 500 && stirred > 500, "{moved} {stirred}");
    }

    #[test]
    fn areas_are_kept() {
        // The determinant of the map's derivative is 1 wherever the way back is smooth.
        let (size, origins) = ([256usize, 256], warp(0.03, 64, Integrator::RungeKutta, 2).origins([256, 256]));
        let at = |x: usize, y: usize| origins[y * size[0] + x].map(f64::from);
        let mut determinants: Vec<f64> = (1..255 * 254)
            .map(|i| (i % 254 + 1, i / 254 % 254 + 1))
            .map(|(x, y)| {
                let [a, b] = [at(x + 1, y), at(x - 1, y)];
                let [c, d] = [at(x, y + 1), at(x, y - 1)];
                ((a[0] - b[0]) * (c[1] - d[1]) - (a[1] - b[1]) * (c[0] - d[0])) / 4.0
            })
            .collect();
        determinants.sort_by(f64::total_cmp);
        let (low, middle, high) = (
            determinants[determinants.len() / 20],
            determinants[determinants.len() / 2],
            determinants[determinants.len() * 19 / 20],
        );
        println!("determinants: 5 % below {low:.4}, half below {middle:.4}, 95 % below {high:.4}");
        assert!(low > 0.96 && high < 1.04 && (middle - 1.0).abs() < 1e-3);
    }

    #[test]
    fn reprojection_and_runge_kutta_each_come_closer_to_the_truth() {
        // The order of table 2.
        let size = [128, 72];
        let truth = warp(0.5, 2000, Integrator::RungeKutta, 1).origins(size);
        let error = |steps, integrator, reprojections| {
            let found = warp(0.5, steps, integrator, reprojections).origins(size);
            let square = |(a, b): (&[f32; 2], &[f32; 2])| f64::from((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2));
            (found.iter().zip(&truth).map(square).sum::<f64>() / found.len() as f64).sqrt()
        };
        let euler = [error(64, Integrator::Euler, 0), error(64, Integrator::Euler, 1)];
        let rk4 = [error(64, Integrator::RungeKutta, 0), error(64, Integrator::RungeKutta, 1)];
        let many = error(512, Integrator::Euler, 0);
        println!("64 steps, in pixels: Euler {euler:.3?}, Runge-Kutta {rk4:.3?}; Euler with 512 {many:.3}");
        assert!(euler[1] < euler[0] && rk4[0] < euler[0] && rk4[1] <= rk4[0] && rk4[1] < many);
    }
}
