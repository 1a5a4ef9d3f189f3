//! Lines along a flow, by the classical Runge–Kutta method: stream lines of one instant, or path lines as time goes on.

use crate::inspect::probe::Flow;
use crate::math::parallel;
use glam::DVec3;

/// A line that is to have a length in space ends after so many steps at the latest: where the air stands still it would
/// never come to its end.
pub const STEPS_MAX: usize = 10_000;
/// Memory that a point of a line takes with its files and picture [bytes].
pub const BYTES_PER_POINT: u64 = 160;
/// Halvings of the step that meets an obstacle: to a thousandth of a thousandth of it.
const HALVINGS: u32 = 20;
/// The search for a wall along a step goes on by at least this share of the step, or it would creep along walls; what is
/// thinner may be missed.
const LEAST_PART: f64 = 1.0 / 256.0;
/// Distances are trusted up to this share: those of meshes are interpolated, and may be a little too large.
const TRUST: f64 = 0.8;

/// How long lines are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reach {
    /// So much time [s].
    Seconds(f64),
    /// So much way [m].
    Metres(f64),
}

/// How lines are traced.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TraceSettings {
    /// Where lines end.
    pub reach: Reach,
    /// Longest step [s], > 0; a reach in seconds is cut into equal steps.
    pub step: f64,
    /// Time at the beginning of each line [s].
    pub start: f64,
}

impl TraceSettings {
    /// Most steps that a line may take.
    pub fn step_count(&self) -> usize {
        match self.reach {
            // Saturates, so that a length beyond all memory is still found to be so.
            Reach::Seconds(seconds) => ((seconds / self.step - 1e-9).ceil() as usize).max(1),
            Reach::Metres(_) => STEPS_MAX,
        }
    }

    /// The step that is taken [s].
    pub fn even_step(&self) -> f64 {
        match self.reach {
            Reach::Seconds(seconds) => seconds / self.step_count() as f64,
            Reach::Metres(_) => self.step,
        }
    }
}

/// A point of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinePoint {
    /// Where [m].
    pub position: DVec3,
    /// Speed there and then [m/s].
    pub speed: f64,
    /// When [s].
    pub time: f64,
}

/// Why a line ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineEnd {
    /// It is as long as asked.
    Whole,
    /// It came to an obstacle.
    Obstacle,
    /// The air is too slow to come further in [`STEPS_MAX`] steps, or stands still.
    Still,
    /// The speed is not finite.
    NotFinite,
}

/// A line along a flow.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Two points or more.
    pub points: Vec<LinePoint>,
    /// Why it ends.
    pub end: LineEnd,
}

/// Lines from `seeds`, in their order. Seeds inside obstacles and where nothing moves give no line.
pub fn trace(flow: &impl Flow, seeds: &[DVec3], settings: &TraceSettings) -> Vec<Line> {
    parallel::gather(seeds.len(), |i, lines| lines.extend(line(flow, seeds[i], settings)))
}

fn line(flow: &impl Flow, seed: DVec3, settings: &TraceSettings) -> Option<Line> {
    let mut clearance = flow.distance(seed, settings.start);
    if clearance.is_nan() || clearance < 0.0 {
        return None;
    }
    let step = settings.even_step();
    let iso_values = flow.iso_values(seed);
    let mut points = vec![point(flow, seed, settings.start)];
    let (mut way, mut end) = (0.0, None);
    for n in 0..settings.step_count() {
        let last = points[points.len() - 1];
        let time = settings.start + n as f64 * step;
        let (mut next, mut taken) = (advanced(flow, last.position, time, step, iso_values), step);
        if !next.is_finite() {
            end = Some(LineEnd::NotFinite);
            break;
        }
        let mut length = next.distance(last.position);
        if let Reach::Metres(metres) = settings.reach
            && way + length >= metres
        {
            taken *= (metres - way) / length;
            next = advanced(flow, last.position, time, taken, iso_values);
            length = next.distance(last.position);
            end = Some(LineEnd::Whole);
        }
        if length <= 1e-12 * (1.0 + last.position.length()) {
            end = Some(LineEnd::Still);
            break;
        }
        if let Some(share) = entry(flow, last.position, next, clearance, time + taken) {
            // The wall is found on the chord, from which the arc of one step does not stray far.
            points.push(point(flow, last.position.lerp(next, share), time + taken * share));
            end = Some(LineEnd::Obstacle);
            break;
        }
        points.push(point(flow, next, time + taken));
        clearance = flow.distance(next, time + taken);
        way += length;
        if end.is_some() {
            break;
        }
    }
    let end = end.unwrap_or(match settings.reach {
        Reach::Seconds(_) => LineEnd::Whole,
        Reach::Metres(_) => LineEnd::Still,
    });
    (points.len() > 1).then_some(Line { points, end })
}

fn point(flow: &impl Flow, position: DVec3, time: f64) -> LinePoint {
    LinePoint { position, speed: flow.velocity(position, time).length(), time }
}

/// One step of the classical Runge–Kutta method, put back to where the flow keeps its values.
fn advanced(flow: &impl Flow, p: DVec3, time: f64, step: f64, iso_values: Option<[f64; 2]>) -> DVec3 {
    let k1 = flow.velocity(p, time);
    let k2 = flow.velocity(p + k1 * (0.5 * step), time + 0.5 * step);
    let k3 = flow.velocity(p + k2 * (0.5 * step), time + 0.5 * step);
    let k4 = flow.velocity(p + k3 * step, time + step);
    let way = (k1 + 2.0 * (k2 + k3) + k4) * (step / 6.0);
    match iso_values {
        Some(values) => flow.put_back(p + way, way.length(), values),
        None => p + way,
    }
}

/// The share of the way from `a` to `b` at which an obstacle is entered, just outside of it; `clearance` is the
/// distance at `a`.
fn entry(flow: &impl Flow, a: DVec3, b: DVec3, clearance: f64, time: f64) -> Option<f64> {
    let length = a.distance(b);
    let (mut outside, mut distance) = (0.0, clearance);
    let least = LEAST_PART * length;
    loop {
        let share = (outside + (TRUST * distance).max(least) / length).min(1.0);
        distance = flow.distance(a.lerp(b, share), time);
        if distance < 0.0 {
            return Some(bisected(|share| flow.distance(a.lerp(b, share), time), outside, share));
        }
        outside = share;
        if share >= 1.0 {
            return None;
        }
    }
}

fn bisected(distance: impl Fn(f64) -> f64, mut outside: f64, mut inside: f64) -> f64 {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (outside + inside);
        if distance(middle) < 0.0 { inside = middle } else { outside = middle }
    }
    outside
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspect::probe::known::{Rotation, Uniform};
    use std::f64::consts::TAU;

    fn settings(reach: Reach, step: f64) -> TraceSettings {
        TraceSettings { reach, step, start: 2.0 }
    }

    #[test]
    fn lines_of_a_uniform_flow_are_straight_and_as_long_as_asked() {
        let flow = Uniform(DVec3::new(3.0, 0.0, 4.0));
        for (reach, length) in [(Reach::Seconds(1.5), 7.5), (Reach::Metres(7.3), 7.3)] {
            let lines = trace(&flow, &[DVec3::ZERO, DVec3::Y], &settings(reach, 0.04));
            for (line, seed) in lines.iter().zip([DVec3::ZERO, DVec3::Y]) {
                let last = line.points[line.points.len() - 1];
                assert!(last.position.distance(seed + flow.0 * (length / 5.0)) < 1e-12);
                assert!((last.time - 2.0 - length / 5.0).abs() < 1e-12 && last.speed == 5.0);
                assert_eq!((line.end, line.points[0].position), (LineEnd::Whole, seed));
            }
        }
    }

    #[test]
    fn lines_of_a_rotation_are_circles_that_close() {
        let flow = Rotation { rate: 1.0, ball: None };
        let errors = [0.1, 0.05].map(|step| {
            let lines = trace(&flow, &[DVec3::X], &settings(Reach::Seconds(TAU), step));
            lines[0].points.last().unwrap().position.distance(DVec3::X)
        });
        assert!(errors[0] < 1e-4 && errors[0] / errors[1] > 14.0, "fourth order: {errors:?}");
    }

    #[test]
    fn path_lines_follow_the_time() {
        struct Gust;
        impl Flow for Gust {
            fn velocity(&self, _: DVec3, time: f64) -> DVec3 {
                DVec3::X * time.powi(3)
            }
            fn distance(&self, _: DVec3, _: f64) -> f64 {
                f64::INFINITY
            }
        }
        let lines = trace(&Gust, &[DVec3::ZERO], &settings(Reach::Seconds(2.0), 0.3));
        for point in &lines[0].points {
            assert!((point.position.x - (point.time.powi(4) - 16.0) / 4.0).abs() < 1e-12, "{point:?}");
        }
        assert_eq!(lines[0].points.len(), 8, "seven even steps of at most 0.3 s");
    }

    #[test]
    fn lines_end_at_obstacles_however_thin() {
        struct Sheet;
        impl Flow for Sheet {
            fn velocity(&self, _: DVec3, _: f64) -> DVec3 {
                DVec3::X
            }
            fn distance(&self, p: DVec3, _: f64) -> f64 {
                (p.x - 0.77).abs() - 5e-4
            }
        }
        let lines = trace(&Sheet, &[DVec3::ZERO, DVec3::X * 0.77], &settings(Reach::Seconds(2.0), 0.1));
        assert_eq!((lines.len(), lines[0].end), (1, LineEnd::Obstacle));
        let end = lines[0].points.last().unwrap();
        assert!((end.position.x - 0.7695).abs() < 1e-6 && end.position.x <= 0.7695, "{}", end.position.x);
        assert!((end.time - 2.0 - end.position.x).abs() < 1e-9);
    }

    #[test]
    fn still_air_gives_no_line_and_slow_air_a_short_one() {
        assert!(trace(&Uniform(DVec3::ZERO), &[DVec3::ZERO], &settings(Reach::Metres(1.0), 0.1)).is_empty());
        let lines = trace(&Uniform(DVec3::X * 1e-6), &[DVec3::ZERO], &settings(Reach::Metres(1.0), 0.1));
        assert_eq!((lines[0].end, lines[0].points.len()), (LineEnd::Still, STEPS_MAX + 1));
        let lines = trace(&Uniform(DVec3::X * f64::NAN), &[DVec3::ZERO], &settings(Reach::Metres(1.0), 0.1));
        assert!(lines.is_empty());
    }
}
