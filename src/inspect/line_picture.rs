//! Lines as the camera sees them: lit tubes coloured by speed, behind and before the obstacles.
//!
//! Each line has a halo in the colour of the background that lies a little deeper than the line, so that a line in front
//! cuts a gap into those behind it and depth can be read (Everts et al. 2009, *Depth-Dependent Halos: Illustrative
//! Rendering of Dense Line Data*). Lines and obstacles behind fade into the background.

use crate::inspect::canvas::{Canvas, Legend};
use crate::inspect::palette::{Rgb, magnitude, mixed};
use crate::inspect::plane::Perspective;
use crate::inspect::probe::Flow;
use crate::inspect::streamlines::Line;
use crate::math::interpolate::cubic_step;
use crate::math::parallel;
use glam::DVec3;

/// Memory that a pixel of the picture takes while it is drawn [bytes].
pub const BYTES_PER_PIXEL: u64 = SAMPLES * SAMPLES * 48 + 16;
/// Samples along each edge of a pixel.
const SAMPLES: u64 = 3;
/// Radius of a line at the depth of the camera's `look_at`, as a share of the picture's height.
const LINE_RADIUS: f64 = 0.0021;
/// Lines of small pictures are no thinner than this [samples].
const LEAST_RADIUS: f64 = 1.5;
/// Radius of a halo in radii of its line.
const HALO: f64 = 2.1;
/// Colours begin here in the map of magnitudes: what is darker does not stand out from the background.
const DARKEST: f64 = 0.24;
/// How far the deepest lines fade into the background.
const FADE: f64 = 0.72;
/// Light at the top and the foot of the background.
const SKY: [Rgb; 2] = [[0.0045, 0.0065, 0.012], [0.013, 0.017, 0.027]];
/// Reflectance of obstacles.
const STONE: Rgb = [0.27, 0.255, 0.245];
/// Most steps of a ray towards an obstacle.
const MARCH_STEPS: u32 = 160;

/// One sample of the picture.
#[derive(Debug, Clone, Copy)]
struct Texel {
    depth: f64,
    colour: Rgb,
}

/// Draws lines in a picture of `size` pixels; obstacles are those of `flow`.
pub fn paint(lines: &[Line], flow: &impl Flow, camera: &Perspective, size: [u32; 2]) -> Canvas {
    let mut scene = Picture::new(lines, camera, size);
    scene.draw_obstacles(flow);
    for line in lines {
        scene.draw_line(line);
    }
    let mut canvas = scene.resolved(size);
    let top = scene.top_speed;
    let colour = |x: f64| speed_colour(x);
    canvas.legend(&Legend { title: "speed [m/s]", range: [0.0, top], colour: &colour });
    canvas
}

fn speed_colour(share: f64) -> Rgb {
    magnitude(DARKEST + (1.0 - DARKEST) * share.clamp(0.0, 1.0))
}

struct Picture<'a> {
    camera: &'a Perspective,
    size: [usize; 2],
    texels: Vec<Texel>,
    /// Depths at which fading begins and is complete [m].
    depths: [f64; 2],
    focus: f64,
    top_speed: f64,
}

impl<'a> Picture<'a> {
    fn new(lines: &[Line], camera: &'a Perspective, size: [u32; 2]) -> Self {
        let size = size.map(|n| n as usize * SAMPLES as usize);
        let points = || lines.iter().flat_map(|line| &line.points);
        let unit = [1.0, 1.0];
        let focus = camera.project(camera.look_at(), unit).map_or(1.0, |p| p[2]);
        let mut found: Vec<f64> = points().filter_map(|p| camera.project(p.position, unit)).map(|p| p[2]).collect();
        found.sort_unstable_by(f64::total_cmp);
        // A line that strays far away does not decide how the others fade.
        let at = |share: f64| found.get((found.len().saturating_sub(1) as f64 * share) as usize).copied();
        let (near, far) = (at(0.02).unwrap_or(focus), at(0.98).unwrap_or(focus));
        let mut speeds: Vec<f64> = points().map(|p| p.speed).collect();
        speeds.sort_unstable_by(f64::total_cmp);
        let top = speeds.get(speeds.len().saturating_sub(1) * 995 / 1000).copied().filter(|&s| s > 0.0);
        let texels = (0..size[0] * size[1])
            .map(|i| Texel { depth: f64::INFINITY, colour: sky((i / size[0]) as f64 / size[1] as f64) })
            .collect();
        Self {
            camera,
            size,
            texels,
            depths: [near, far.max(near + 1e-6 * focus)],
            focus,
            top_speed: top.unwrap_or(1.0),
        }
    }

    fn size_f64(&self) -> [f64; 2] {
        self.size.map(|n| n as f64)
    }

    /// What a colour looks like at a depth and a row.
    fn faded(&self, colour: Rgb, depth: f64, row: f64) -> Rgb {
        let [near, far] = self.depths;
        let share = ((depth - near) / (far - near)).clamp(0.0, 1.0);
        mixed(colour, sky(row / self.size[1] as f64), (FADE * share) as f32)
    }

    fn draw_obstacles(&mut self, flow: &impl Flow) {
        let (size, width) = (self.size_f64(), self.size[0]);
        let limit = 8.0 * self.depths[1].max(self.focus);
        self.texels = parallel::map(self.texels.len(), |i| {
            let sky = self.texels[i];
            let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let ray = self.camera.ray(x, y, size);
            let Some(depth) = march(flow, self.camera.position(), ray, limit) else { return sky };
            let colour = stone(flow, self.camera.position() + ray * depth, ray.normalize(), 1e-3 * self.focus);
            Texel { depth, colour: self.faded(colour, depth, y) }
        });
    }

    fn draw_line(&mut self, line: &Line) {
        let size = self.size_f64();
        let (count, focus) = (line.points.len(), self.focus);
        let radius_at = |i: usize, depth: f64| {
            // Thin at its beginning and pointed at its end, like a stroke of a brush.
            let (begun, left) = (i as f64 / count as f64, (count - 1 - i) as f64 / count as f64);
            let taper = (0.3 + 0.7 * cubic_step(begun / 0.35)) * (0.12 + 0.88 * cubic_step(left / 0.12));
            (LINE_RADIUS * size[1]).max(LEAST_RADIUS) * (focus / depth).clamp(0.35, 2.5) * taper
        };
        let mut before: Option<End> = None;
        for (i, point) in line.points.iter().enumerate() {
            let here = self.camera.project(point.position, size).map(|[x, y, depth]| End {
                place: [x, y],
                depth,
                radius: radius_at(i, depth),
                speed: point.speed / self.top_speed,
            });
            if let (Some(a), Some(b)) = (before, here) {
                self.draw_segment(&a, &b);
            }
            before = here;
        }
    }

    fn draw_segment(&mut self, a: &End, b: &End) {
        let reach = HALO * a.radius.max(b.radius) + 1.0;
        let columns = range(a.place[0], b.place[0], reach, self.size[0]);
        let along = [b.place[0] - a.place[0], b.place[1] - a.place[1]];
        let length_sq = along[0] * along[0] + along[1] * along[1];
        // Metres that a halo lies deeper for each sample aside: steeper than any line is likely to run into the picture.
        let slope = 4.0 * self.focus / self.size[1] as f64;
        for row in range(a.place[1], b.place[1], reach, self.size[1]) {
            for column in columns.clone() {
                let p = [column as f64 + 0.5 - a.place[0], row as f64 + 0.5 - a.place[1]];
                let t = ((p[0] * along[0] + p[1] * along[1]) / length_sq.max(1e-12)).clamp(0.0, 1.0);
                let aside = (p[0] - t * along[0]).hypot(p[1] - t * along[1]);
                let radius = a.radius + (b.radius - a.radius) * t;
                if aside > HALO * radius {
                    continue;
                }
                let axis = a.depth + (b.depth - a.depth) * t;
                let depth = axis + slope * aside;
                let texel = &self.texels[row * self.size[0] + column];
                if depth >= texel.depth {
                    continue;
                }
                let colour = if aside <= radius {
                    let across = aside / radius;
                    let tube = speed_colour(a.speed + (b.speed - a.speed) * t);
                    // Lit from the camera's side, a little less towards the rim.
                    let lit = tube.map(|c| c * (0.45 + 0.55 * (1.0 - across * across).max(0.0).sqrt()) as f32);
                    self.faded(lit, axis, row as f64)
                } else if texel.depth.is_finite() {
                    // A shadow, not a hole: obstacles and lines behind shine through a little.
                    mixed(texel.colour, sky(row as f64 / self.size[1] as f64), 0.8)
                } else {
                    continue;
                };
                self.texels[row * self.size[0] + column] = Texel { depth, colour };
            }
        }
    }

    fn resolved(&self, size: [u32; 2]) -> Canvas {
        let (n, columns) = (SAMPLES as usize, size[0] as usize);
        Canvas::from_fn(size, |i| {
            let corner = (i / columns * n) * self.size[0] + i % columns * n;
            let mut sum = [0.0; 3];
            for k in 0..n * n {
                let colour = self.texels[corner + k / n * self.size[0] + k % n].colour;
                sum = std::array::from_fn(|c| sum[c] + colour[c]);
            }
            sum.map(|s| s / (n * n) as f32)
        })
    }
}

/// An end of a segment on the picture.
#[derive(Clone, Copy)]
struct End {
    place: [f64; 2],
    depth: f64,
    radius: f64,
    speed: f64,
}

/// Columns or rows that a segment with some room at its sides covers.
fn range(a: f64, b: f64, reach: f64, count: usize) -> std::ops::Range<usize> {
    // Conversions saturate, so that places far outside give nothing.
    let first = (a.min(b) - reach).floor().max(0.0) as usize;
    let last = ((a.max(b) + reach).ceil().max(0.0) as usize).min(count);
    first..last.max(first)
}

fn sky(row_share: f64) -> Rgb {
    mixed(SKY[0], SKY[1], row_share as f32)
}

/// Pictures are of a flow that stands still, which is the same at all times.
const ANY_TIME: f64 = 0.0;

/// Depth at which a ray meets an obstacle, walking by the distance (Hart 1996, *Sphere Tracing*).
fn march(flow: &impl Flow, origin: DVec3, ray: DVec3, limit: f64) -> Option<f64> {
    let length = ray.length();
    let mut depth = 0.0;
    for _ in 0..MARCH_STEPS {
        let distance = flow.distance(origin + ray * depth, ANY_TIME);
        if distance.is_nan() || distance < 4e-4 * depth {
            return (distance.is_finite() && depth > 0.0).then_some(depth);
        }
        depth += distance / length;
        if depth > limit {
            return None;
        }
    }
    None
}

/// Light of an obstacle at a point on its surface: from above and the right, a little from the camera, with a bright
/// rim.
fn stone(flow: &impl Flow, p: DVec3, view: DVec3, step: f64) -> Rgb {
    let difference = |axis: DVec3| flow.distance(p + axis * step, ANY_TIME) - flow.distance(p - axis * step, ANY_TIME);
    let normal = DVec3::from_array(DVec3::AXES.map(difference)).normalize_or(-view);
    let facing = (-normal.dot(view)).clamp(0.0, 1.0);
    let rim = 0.20 * (1.0 - facing).powi(3);
    let above = 0.5 + 0.5 * normal.dot(DVec3::new(0.45, 0.85, 0.3).normalize());
    let light = 0.03 + 0.85 * above.powi(3) + 0.12 * facing + rim;
    STONE.map(|c| c * light as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspect::probe::known::Rotation;
    use crate::inspect::streamlines::{LineEnd, LinePoint};

    fn straight(z: f64) -> Line {
        let point =
            |i: i32| LinePoint { position: DVec3::new(f64::from(i) * 0.02 - 1.0, 0.0, z), speed: 1.0, time: 0.0 };
        Line { points: (0..=100).map(point).collect(), end: LineEnd::Whole }
    }

    fn camera() -> Perspective {
        Perspective::try_new(DVec3::Z * 4.0, DVec3::ZERO, DVec3::Y, 40.0).unwrap()
    }

    fn light(canvas: &Canvas, x: u32, y: u32) -> f32 {
        canvas.pixels[(y * canvas.size[0] + x) as usize].iter().sum()
    }

    #[test]
    fn a_line_is_seen_before_an_obstacle_and_hidden_behind_it() {
        let flow = Rotation { rate: 1.0, ball: Some((DVec3::ZERO, 0.5)) };
        let paint = |z: f64| paint(&[straight(z)], &flow, &camera(), [160, 120]);
        let (front, back, none) = (paint(0.7), paint(-0.7), super::paint(&[], &flow, &camera(), [160, 120]));
        let at = |canvas: &Canvas, x: u32| (58..62).map(|y| light(canvas, x, y)).fold(0.0, f32::max);
        assert!(at(&front, 80) > 2.0 * at(&none, 80), "{} {}", at(&front, 80), at(&none, 80));
        assert_eq!(at(&back, 80), at(&none, 80));
        assert!(at(&back, 110) > 4.0 * at(&none, 110), "beside the ball");
        assert!(light(&none, 80, 50) > 2.0 * light(&none, 20, 50), "the ball is seen");
    }

    #[test]
    fn what_is_behind_the_camera_and_outside_is_left_out() {
        let flow = Rotation { rate: 1.0, ball: None };
        let far = |x: f64, z: f64| {
            let mut line = straight(z);
            line.points.iter_mut().for_each(|p| p.position.x += x);
            line
        };
        let none = paint(&[], &flow, &camera(), [100, 60]);
        for line in [far(0.0, 9.0), far(1e9, 0.0), far(-1e9, 0.0)] {
            assert_eq!(paint(&[line], &flow, &camera(), [100, 60]).pixels, none.pixels);
        }
    }

    #[test]
    fn a_near_line_cuts_a_gap_into_a_far_one() {
        let flow = Rotation { rate: 1.0, ball: None };
        let mut upright = straight(0.8);
        upright.points.iter_mut().for_each(|p| p.position = DVec3::new(0.0, p.position.x, 0.8));
        let alone = paint(&[straight(-0.8)], &flow, &camera(), [320, 240]);
        let crossed = paint(&[straight(-0.8), upright], &flow, &camera(), [320, 240]);
        let row = |canvas: &Canvas, x: u32| (116..124).map(|y| light(canvas, x, y)).fold(0.0, f32::max);
        let beside = 161 + (3.0 * LINE_RADIUS * 240.0 / 2.0).round() as u32;
        let darkest = (beside - 1..=beside + 1).map(|x| row(&crossed, x)).fold(f32::MAX, f32::min);
        assert!(darkest < 0.8 * row(&alone, beside), "{darkest} {}", row(&alone, beside));
    }
}
