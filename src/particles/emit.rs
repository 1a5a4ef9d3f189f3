//! Where, when and for how long particles live: pure functions of (seed, index).

use crate::geometry::motion::Motion;
use crate::math::hash::Seed;
use glam::{DVec3, Vec3};
use std::f64::consts::TAU;
use std::ops::Range;
use std::sync::Arc;

/// A source of particles.
#[derive(Debug, Clone)]
pub struct Emitter {
    /// Where particles start.
    pub place: Place,
    /// Where in it: at so many points, one particle after the other, or all over it where `None`.
    pub strands: Option<u64>,
    /// How many there are.
    pub schedule: Schedule,
    /// When the first may be born [s].
    pub start: f64,
    /// No particle is born at or after this time [s].
    pub stop: f64,
    /// Life of a particle [s], > 0.
    pub lifetime: f64,
    /// Lives are spread evenly over `lifetime·(1 ± lifetime_spread)`.
    pub lifetime_spread: f64,
    /// Mass of a grown particle.
    pub particle_mass: f64,
    /// Time until the full mass [s].
    pub fade_in: f64,
    /// Time over which the mass goes, at the end of life [s].
    pub fade_out: f64,
    /// Key of all of the emitter's random numbers.
    pub seed: Seed,
    /// The motion of the place, and the point that it turns about where it rests [m].
    pub motion: Option<(Arc<Motion>, DVec3)>,
}

/// How many particles are born.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Schedule {
    /// So many each second, particle i within second (i, i+1)/rate after the start.
    Rate(f64),
    /// So many at once.
    Count(u64),
}

/// Where particles start.
#[derive(Debug, Clone)]
pub enum Place {
    /// One point.
    Point(DVec3),
    /// All over a disk.
    Disk {
        /// Middle [m].
        center: DVec3,
        /// Direction it faces, length 1.
        normal: DVec3,
        /// Radius [m].
        radius: f64,
    },
    /// All over a ball.
    Ball {
        /// Middle [m].
        center: DVec3,
        /// Radius [m].
        radius: f64,
    },
    /// All over a box along the axes.
    Cuboid {
        /// Middle [m].
        center: DVec3,
        /// Edge lengths [m].
        size: DVec3,
    },
    /// All over a surface.
    Surface(Surface),
}

/// Triangles from which points are drawn in proportion to area.
#[derive(Debug, Clone)]
pub struct Surface {
    triangles: Vec<[Vec3; 3]>,
    /// Area of each triangle and all before it.
    cumulative_area: Vec<f64>,
    offset: f64,
}

/// The beginning of a particle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Birth {
    /// When [s].
    pub time: f64,
    /// Where [m].
    pub position: [f32; 3],
    /// How long it lives [s].
    pub lifetime: f32,
}

/// What each random number of a particle is for.
#[derive(Clone, Copy)]
enum Draw {
    Time,
    Lifetime,
    First,
    Second,
    Third,
}

impl Surface {
    /// Points on the triangles, moved outwards by `offset` [m]; `None` where they have no area.
    pub fn try_new(triangles: Vec<[Vec3; 3]>, offset: f64) -> Option<Self> {
        let mut total = 0.0;
        let cumulative_area: Vec<f64> = triangles
            .iter()
            .map(|t| {
                total += 0.5 * area_vector(t).length();
                total
            })
            .collect();
        (total > 0.0 && total.is_finite()).then_some(Self { triangles, cumulative_area, offset })
    }

    fn point(&self, [pick, a, b]: [f64; 3]) -> DVec3 {
        let total = *self.cumulative_area.last().expect("a surface has triangles");
        let i = self.cumulative_area.partition_point(|&c| c <= pick * total).min(self.triangles.len() - 1);
        let triangle = &self.triangles[i];
        let [p, q, r] = triangle.map(|v| v.as_dvec3());
        // Turk 1990: the square root makes the density even.
        let root = a.sqrt();
        let on = p * (1.0 - root) + q * (root * (1.0 - b)) + r * (root * b);
        on + area_vector(triangle).normalize_or_zero() * self.offset
    }
}

fn area_vector(t: &[Vec3; 3]) -> DVec3 {
    let [p, q, r] = t.map(|v| v.as_dvec3());
    (q - p).cross(r - p)
}

impl Place {
    fn point(&self, [a, b, c]: [f64; 3]) -> DVec3 {
        match self {
            Self::Point(p) => *p,
            Self::Disk { center, normal, radius } => {
                let (s, t) = normal.any_orthonormal_pair();
                let (sin, cos) = (TAU * b).sin_cos();
                *center + (s * cos + t * sin) * (radius * a.sqrt())
            }
            Self::Ball { center, radius } => {
                let z = 2.0 * a - 1.0;
                let (sin, cos) = (TAU * b).sin_cos();
                let across = (1.0 - z * z).max(0.0).sqrt();
                *center + DVec3::new(across * cos, across * sin, z) * (radius * c.cbrt())
            }
            Self::Cuboid { center, size } => *center + (DVec3::new(a, b, c) - 0.5) * *size,
            Self::Surface(surface) => surface.point([a, b, c]),
        }
    }
}

impl Emitter {
    /// The longest life [s].
    pub fn longest_life(&self) -> f64 {
        self.lifetime * (1.0 + self.lifetime_spread)
    }

    /// Indices of which all particles born in `(after, until]` [s] are some; at most four too many.
    pub fn candidates(&self, after: f64, until: f64) -> Range<u64> {
        let until = until.min(self.stop);
        if until < self.start || until < after {
            return 0..0;
        }
        match self.schedule {
            Schedule::Count(count) => 0..if after < self.start { count } else { 0 },
            Schedule::Rate(rate) => {
                // Saturating conversions: a time before the start gives 0.
                let first = ((after - self.start) * rate - 2.0).floor() as u64;
                let end = ((until - self.start) * rate + 2.0).floor() as u64;
                first..end.max(first)
            }
        }
    }

    /// When particle `index` is born [s], or `None` where it never is.
    pub fn birth_time(&self, index: u64) -> Option<f64> {
        let time = match self.schedule {
            Schedule::Count(count) => (index < count).then_some(self.start)?,
            Schedule::Rate(rate) if rate > 0.0 => self.start + (index as f64 + self.draw(index, Draw::Time)) / rate,
            Schedule::Rate(_) => return None,
        };
        (time < self.stop).then_some(time)
    }

    /// A time [s] before which neither particle `index` nor any after it is born.
    pub fn earliest_birth(&self, index: u64) -> f64 {
        match self.schedule {
            Schedule::Rate(rate) if rate > 0.0 => self.start + index as f64 / rate,
            Schedule::Rate(_) | Schedule::Count(_) => self.start,
        }
    }

    /// How particle `index` begins.
    pub fn birth(&self, index: u64) -> Option<Birth> {
        let time = self.birth_time(index)?;
        let spread = self.lifetime_spread * (2.0 * self.draw(index, Draw::Lifetime) - 1.0);
        // The first particle of a strand draws the place of all that follow.
        let placed = self.strands.map_or(index, |strands| index % strands.max(1));
        let draws = [Draw::First, Draw::Second, Draw::Third].map(|d| self.draw(placed, d));
        let rest = self.place.point(draws);
        let position = match &self.motion {
            Some((motion, pivot)) => {
                let pose = motion.pose(time);
                *pivot + pose.displacement + pose.rotation * (rest - *pivot)
            }
            None => rest,
        };
        Some(Birth { time, position: position.as_vec3().to_array(), lifetime: (self.lifetime * (1.0 + spread)) as f32 })
    }

    /// The mass of a particle of that age and life [s]: grows and goes by a cubic step.
    pub fn mass(&self, age: f32, lifetime: f32) -> f32 {
        let fade =
            |time: f64, over: f64| if over > 0.0 { crate::math::interpolate::cubic_step(time / over) } else { 1.0 };
        let fade = fade(f64::from(age), self.fade_in) * fade(f64::from(lifetime - age), self.fade_out);
        (self.particle_mass * fade) as f32
    }

    /// About how many particles are alive at a time [s].
    pub fn expected_live(&self, time: f64) -> f64 {
        match self.schedule {
            Schedule::Rate(rate) => {
                let first = self.start.max(time - self.lifetime);
                rate * (time.min(self.stop) - first).max(0.0)
            }
            Schedule::Count(count) => {
                if time >= self.start && time < self.start + self.lifetime {
                    count as f64
                } else {
                    0.0
                }
            }
        }
    }

    /// Uniform in [0, 1), with all 53 bits.
    fn draw(&self, index: u64, draw: Draw) -> f64 {
        (self.seed.derive(index).word(draw as u64) >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) fn emitter(place: Place, schedule: Schedule) -> Emitter {
        Emitter {
            place,
            strands: None,
            schedule,
            start: -0.5,
            stop: 3.0,
            lifetime: 2.0,
            lifetime_spread: 0.25,
            particle_mass: 2.0,
            fade_in: 0.5,
            fade_out: 0.5,
            seed: Seed(11),
            motion: None,
        }
    }

    #[test]
    fn candidates_hold_all_births_of_a_window_and_few_others() {
        let e = emitter(Place::Point(DVec3::ZERO), Schedule::Rate(97.0));
        let all: Vec<(u64, f64)> = (0..1000).filter_map(|i| Some((i, e.birth_time(i)?))).collect();
        assert!((339..=340).contains(&all.len()), "3.5 s of 97 a second: {}", all.len());
        assert!(all.is_sorted_by(|a, b| a.1 <= b.1));
        for (after, until) in [(-2.0, -0.4), (0.0, 0.1), (2.9, 3.4), (1.0, 1.0)] {
            let range = e.candidates(after, until);
            let born: Vec<u64> = all.iter().filter(|(_, t)| *t > after && *t <= until).map(|(i, _)| *i).collect();
            assert!(born.iter().all(|i| range.contains(i)));
            assert!(range.end - range.start <= born.len() as u64 + 5);
        }
        let once = emitter(Place::Point(DVec3::ZERO), Schedule::Count(9));
        assert_eq!((once.candidates(-1.0, -0.5), once.candidates(-0.5, 1.0)), (0..9, 0..0));
    }

    #[test]
    fn points_fill_their_place_evenly() {
        let center = DVec3::new(1.0, -2.0, 3.0);
        let square = [Vec3::ZERO, Vec3::X, Vec3::ONE - Vec3::Z, Vec3::Y];
        let surface = Surface::try_new(vec![[square[0], square[1], square[2]], [square[0], square[2], square[3]]], 0.5);
        let places = [
            (Place::Ball { center, radius: 2.0 }, center, 4.0 / 5.0),
            (Place::Disk { center, normal: DVec3::Y, radius: 2.0 }, center, 4.0 / 3.0),
            (Place::Cuboid { center, size: DVec3::splat(2.0) }, center, 1.0 / 3.0),
            (Place::Surface(surface.unwrap()), DVec3::new(0.5, 0.5, 0.5), 1.0 / 12.0),
            (Place::Point(center), center, 0.0),
        ];
        for (place, middle, variance) in places {
            let e = emitter(place, Schedule::Count(20_000));
            let points: Vec<DVec3> =
                (0..20_000).map(|i| Vec3::from_array(e.birth(i).unwrap().position).as_dvec3()).collect();
            let mean = points.iter().sum::<DVec3>() / 20_000.0;
            assert!((mean - middle).length() < 0.03, "{mean} {middle}");
            // Of x for all, which for the disk and the ball is not that of a box.
            let found = points.iter().map(|p| (p.x - middle.x).powi(2)).sum::<f64>() / 20_000.0;
            let expected = match e.place {
                Place::Disk { .. } => 1.0,
                _ => variance,
            };
            assert!((found - expected).abs() < 0.02 * expected.max(0.5), "{found} {expected}");
        }
    }

    #[test]
    fn strands_begin_at_fixed_points_that_fill_the_place_and_take_turns() {
        let ball = Place::Ball { center: DVec3::ZERO, radius: 1.0 };
        let whole = emitter(ball, Schedule::Rate(1000.0));
        let strands = Emitter { strands: Some(300), ..whole.clone() };
        for i in 0..900 {
            let (birth, first) = (strands.birth(i).unwrap(), whole.birth(i % 300).unwrap());
            assert_eq!(birth.position, first.position);
            // Only the place is shared.
            assert_eq!((birth.time, birth.lifetime), (whole.birth(i).unwrap().time, whole.birth(i).unwrap().lifetime));
        }
        let mean = (0..300).map(|i| Vec3::from_array(strands.birth(i).unwrap().position)).sum::<Vec3>() / 300.0;
        assert!(mean.length() < 0.1, "{mean}");
    }

    #[test]
    fn lives_and_masses_stay_in_their_bounds() {
        let e = emitter(Place::Point(DVec3::ZERO), Schedule::Count(1000));
        for i in 0..1000 {
            let life = e.birth(i).unwrap().lifetime;
            assert!((1.5..=2.5).contains(&life));
        }
        assert_eq!((e.mass(0.0, 2.0), e.mass(1.0, 2.0), e.mass(2.0, 2.0), e.mass(0.25, 2.0)), (0.0, 2.0, 0.0, 1.0));
    }
}
