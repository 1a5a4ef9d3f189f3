//! Swirls of many sizes: octaves of noise, each with its length, speed, spin, place and orientation.

use crate::flow::curl::curl;
use crate::flow::flow_noise::Spin;
use crate::flow::noise::{NoiseSeed, RMS_BITANGENT, RMS_SPEED, evolving_noise, gradient_noise, noise_pair, seed_words};
use crate::flow::potential::Psi;
use crate::math::dual::Dual;
use crate::math::hash::{CounterRng, Seed};
use crate::math::real::{Lane, cross, dot, triple};
use glam::DVec3;
use rand_core::Rng;

/// What a noise term is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct OctavesSettings {
    /// Size of the largest swirls [m], > 0.
    pub length_scale: f64,
    /// Root mean square speed of the largest swirls [m/s].
    pub speed: f64,
    /// Number of sizes.
    pub octaves: u32,
    /// Ratio of neighbouring sizes, > 1.
    pub lacunarity: f64,
    /// Factor on the speed from one size to the next.
    pub gain: f64,
    /// Turns per second of the gradients of the largest swirls.
    pub spin_rate: f64,
    /// Replacements per second of the largest swirls by others: noise in four dimensions. Excludes `spin_rate`.
    pub evolve_rate: f64,
    /// How swirls are made of noise.
    pub form: Form,
    /// How far smaller swirls are carried along by larger ones, 0 to 1.
    pub memory: f64,
    /// How far the pattern is moved [m].
    pub offset: [f64; 3],
    /// Velocity of the pattern [m/s].
    pub scroll: [f64; 3],
    /// Which pattern.
    pub seed: Seed,
}

impl Default for OctavesSettings {
    fn default() -> Self {
        Self {
            length_scale: 1.0,
            speed: 1.0,
            octaves: 3,
            lacunarity: 2.0,
            gain: kolmogorov_gain(2.0),
            spin_rate: 0.0,
            evolve_rate: 0.0,
            form: Form::Curl,
            memory: 0.0,
            offset: [0.0; 3],
            scroll: [0.0; 3],
            seed: Seed(0),
        }
    }
}

/// How a velocity is made of noise.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Form {
    /// The curl of three components.
    #[default]
    Curl,
    /// The curl of one component along this direction, that does not change along it: swirls in the planes across.
    Planar(DVec3),
    /// `∇f × ∇g` of two components: cheaper, and a wall needs to bend f alone.
    Bitangent,
}

/// The factor on speed from one octave to the next in Kolmogorov's inertial range, where the speed of swirls of size L
/// goes as L^(1/3); the potential, speed times length, falls as L^(4/3).
pub fn kolmogorov_gain(lacunarity: f64) -> f64 {
    lacunarity.powf(-1.0 / 3.0)
}

/// Swirls of one size.
#[derive(Debug, Clone, PartialEq)]
pub struct Octave {
    length: f64,
    /// Root mean square [m/s].
    speed: f64,
    /// Time over which it carries the smaller octaves along [s], and whether it is the largest.
    memory: f64,
    is_largest: bool,
    is_smallest: bool,
    /// Factor on unit noise: [m²/s] for the curl, [m³/s] for bitangents.
    amplitude: f64,
    time: Time,
    form: Form,
    scroll: [f64; 3],
    offset: [f64; 3],
    /// Rows: the axes of this octave's lattice.
    axes: [[f64; 3]; 3],
    /// Lattice coordinates of the world's origin at time 0.
    origin: [f64; 3],
    seed: NoiseSeed,
}

/// How swirls change.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Time {
    /// Their gradients turn, so many times a second.
    Spin(f64),
    /// They give way to others, so many times a second, and have done so for a random part of a time before.
    Evolve { rate: f64, before: f64 },
}

/// An [`Octave`] over a span of time.
#[derive(Debug, Clone)]
pub struct OctaveSpan {
    octave: Octave,
    /// Whole and fractional lattice coordinates of the world's origin at the start: only the latter meets f32.
    cell: [u32; 3],
    fraction: [f64; 3],
    /// Of the origin over the span, in lattice units.
    motion: [f64; 3],
    change: Change,
}

/// How swirls change over a span.
#[derive(Debug, Clone)]
enum Change {
    /// Turned so far at the start, and by so many turns more over the span.
    Spin { start: Spin<f64>, turns: f64 },
    /// Between patterns `step` and the next, at the share `start` of the way and over the span by `more` further.
    Evolve { step: u32, start: f64, more: f64 },
}

/// The octaves of a noise term, largest first.
///
/// Each has a lattice of its own, turned at random and far from the others', so that they are uncorrelated and no
/// direction is preferred.
pub fn octaves(settings: &OctavesSettings) -> Vec<Octave> {
    (0..settings.octaves)
        .map(|k| {
            let mut rng = CounterRng::new(settings.seed.derive(u64::from(k)));
            let frequency = settings.lacunarity.powi(k as i32);
            let length = settings.length_scale / frequency;
            let speed = settings.speed * settings.gain.powi(k as i32);
            Octave {
                length,
                amplitude: match settings.form {
                    Form::Curl | Form::Planar(_) => speed * length / RMS_SPEED,
                    // On f alone; both gradients are by lattice units.
                    Form::Bitangent => speed * length * length / RMS_BITANGENT,
                },
                speed,
                // At a memory of 1 an eighth of a swirl's size, in the root mean square.
                memory: if speed > 0.0 { 0.125 * settings.memory * length / speed } else { 0.0 },
                is_largest: k == 0,
                is_smallest: k + 1 == settings.octaves,
                form: match settings.form {
                    Form::Planar(normal) => Form::Planar(normal.normalize()),
                    form => form,
                },
                scroll: settings.scroll,
                offset: settings.offset,
                axes: random_axes(&mut rng),
                origin: std::array::from_fn(|_| f64::from(rng.next_u32() >> 12) + f64::from(rng.uniform())),
                seed: [rng.next_u32(), rng.next_u32()],
                // One octave lingers while another hurries: without the random part all would at the same moments.
                time: if settings.evolve_rate > 0.0 {
                    Time::Evolve { rate: settings.evolve_rate * frequency, before: f64::from(rng.uniform()) }
                } else {
                    Time::Spin(settings.spin_rate * frequency)
                },
            }
        })
        .collect()
}

/// A uniformly distributed rotation (Shoemake 1992).
fn random_axes(rng: &mut CounterRng) -> [[f64; 3]; 3] {
    let [u, a, b] = std::array::from_fn(|_| f64::from(rng.uniform()));
    let (near, far) = ((1.0 - u).sqrt(), u.sqrt());
    let (a, b) = (std::f64::consts::TAU * a, std::f64::consts::TAU * b);
    let q = glam::DQuat::from_xyzw(near * a.sin(), near * a.cos(), far * b.sin(), far * b.cos()).normalize();
    glam::DMat3::from_quat(q).to_cols_array_2d()
}

impl Octave {
    /// Size of the swirls [m].
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Root mean square speed [m/s].
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Whether larger octaves carry smaller ones along.
    pub fn has_memory(&self) -> bool {
        self.memory > 0.0
    }

    /// Whether it is the first of its octaves.
    pub fn is_largest(&self) -> bool {
        self.is_largest
    }

    /// How its velocity is made.
    pub fn form(&self) -> Form {
        self.form
    }

    /// The octave from `start` [s], lasting `duration` [s].
    pub fn span(&self, start: f64, duration: f64) -> OctaveSpan {
        let to_lattice = |v: [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|j| -(0..3).map(|i| self.axes[j][i] * v[i]).sum::<f64>() / self.length)
        };
        let (scroll, offset) = (to_lattice(self.scroll), to_lattice(self.offset));
        let origin: [f64; 3] = std::array::from_fn(|j| self.origin[j] + offset[j] + scroll[j] * start);
        OctaveSpan {
            octave: self.clone(),
            cell: origin.map(|x| x.floor() as i64 as u32),
            fraction: origin.map(|x| x - x.floor()),
            motion: scroll.map(|x| x * duration),
            change: match self.time {
                Time::Spin(rate) => Change::Spin { start: Spin::from_turns(rate * start), turns: rate * duration },
                Time::Evolve { rate, before } => {
                    let now = rate * start + before;
                    Change::Evolve { step: now.floor() as i64 as u32, start: now - now.floor(), more: rate * duration }
                }
            },
        }
    }
}

impl OctaveSpan {
    /// The octave that this is a span of.
    pub fn octave(&self) -> &Octave {
        &self.octave
    }

    /// The potential at `p` [m], or of bitangents the two scalars in the first two components; `phase` runs from 0 at
    /// the start of the span to 1 at its end.
    #[inline(never)]
    pub fn psi<L: Lane>(&self, p: [L; 3], phase: L) -> Psi<L> {
        phase.outlined(
            #[inline(always)]
            || self.psi_here(p, phase),
        )
    }

    #[inline(always)]
    fn psi_here<L: Lane>(&self, p: [L; 3], phase: L) -> Psi<L> {
        let octave = &self.octave;
        let p = match octave.form {
            Form::Planar(normal) => {
                let n: [L; 3] = triple!(i => phase.lit(normal[i]));
                let height = dot(n, p);
                triple!(i => p[i] - height * n[i])
            }
            Form::Curl | Form::Bitangent => p,
        };
        let inverse = 1.0 / octave.length;
        let to_lattice: [[L; 3]; 3] = triple!(j => triple!(i => phase.lit(octave.axes[j][i] * inverse)));
        let q: [L; 3] = triple!(j => {
            let moved = phase.lit(self.motion[j]).mul_add(phase, phase.lit(self.fraction[j]));
            let row = to_lattice[j];
            row[0].mul_add(p[0], row[1].mul_add(p[1], row[2].mul_add(p[2], moved)))
        });
        let unit = match &self.change {
            Change::Spin { start, turns } => {
                let spin = Spin::advanced(*start, phase.lit(*turns) * phase);
                match octave.form {
                    Form::Bitangent => noise_pair(q, self.cell, seed_words(phase, octave.seed), spin),
                    _ => gradient_noise(q, self.cell, seed_words(phase, octave.seed), spin),
                }
            }
            Change::Evolve { step, start, more } => {
                let time = phase.mul_add(phase.lit(*more), phase.lit(*start));
                evolving_noise(q, self.cell, octave.seed, *step, time)
            }
        };
        match octave.form {
            Form::Curl => self.scaled(&unit, &to_lattice),
            Form::Planar(normal) => self.scaled(&self.planar(&unit, normal), &to_lattice),
            Form::Bitangent => self.pair(&unit, &to_lattice),
        }
    }

    /// [m²/s] from unit noise, differentiated along the axes of the world.
    #[inline(always)]
    fn scaled<L: Lane>(&self, unit: &Psi<L>, to_lattice: &[[L; 3]; 3]) -> Psi<L> {
        let amplitude = unit.value[0].lit(self.octave.amplitude);
        let scaled: [[L; 3]; 3] = triple!(j => triple!(i => to_lattice[j][i] * amplitude));
        Psi {
            value: triple!(c => unit.value[c] * amplitude),
            jacobian: triple!(c => {
                let row = unit.jacobian[c];
                triple!(i => {
                    row[0].mul_add(scaled[0][i], row[1].mul_add(scaled[1][i], row[2] * scaled[2][i]))
                })
            }),
        }
    }
}

/// How far a pattern is displaced at a point [m], and `[c][i]`, the derivative of component c along axis i.
#[derive(Debug, Clone, Copy)]
pub struct Drift<L> {
    /// Displacement [m].
    pub value: [L; 3],
    /// Its derivatives.
    pub jacobian: [[L; 3]; 3],
}

impl<L: Lane> Drift<L> {
    /// No displacement; `like` says which kind of number.
    #[inline(always)]
    pub fn none(like: L) -> Self {
        let zero = like.lit(0.0);
        Self { value: [zero; 3], jacobian: [[zero; 3]; 3] }
    }
}

impl OctaveSpan {
    /// The velocity of the octave alone [m/s].
    #[inline(always)]
    fn velocity<L: Lane>(&self, p: [L; 3], phase: L) -> [L; 3] {
        let psi = self.psi(p, phase);
        match self.octave.form {
            Form::Bitangent => cross(psi.jacobian[0], psi.jacobian[1]),
            Form::Curl | Form::Planar(_) => curl(&psi),
        }
    }

    /// The potential where larger octaves have carried it, and `drift` with what this octave does to smaller ones.
    ///
    /// Pseudo-advection after Perlin and Neyret 2001 (section 4), for potentials: ψ(x − d(x)), where d is the time
    /// that structures last times the velocity of all larger octaves.
    #[inline(never)]
    pub fn carried<L: Lane>(&self, p: [L; 3], phase: L, drift: &Drift<L>) -> (Psi<L>, Drift<L>) {
        phase.outlined(
            #[inline(always)]
            || self.carried_here(p, phase, drift),
        )
    }

    #[inline(always)]
    fn carried_here<L: Lane>(&self, p: [L; 3], phase: L, drift: &Drift<L>) -> (Psi<L>, Drift<L>) {
        let there = self.psi(triple!(i => p[i] - drift.value[i]), phase);
        let jacobian = triple!(c => {
            let row = there.jacobian[c];
            triple!(i => {
                row[i]
                    - dot(row, triple!(j => drift.jacobian[j][i]))
            })
        });
        let moved = Psi { value: there.value, jacobian };
        if self.octave.is_smallest {
            return (moved, *drift);
        }
        let (own, time) = (self.velocity(Dual::point(p), Dual::constant(phase)), phase.lit(self.octave.memory));
        let more = Drift {
            value: triple!(c => time.mul_add(own[c].value, drift.value[c])),
            jacobian: triple!(c => triple!(i => time.mul_add(own[c].gradient[i], drift.jacobian[c][i]))),
        };
        (moved, more)
    }

    /// f [m³/s] and g from the first two components.
    #[inline(always)]
    fn pair<L: Lane>(&self, unit: &Psi<L>, to_lattice: &[[L; 3]; 3]) -> Psi<L> {
        let one = unit.value[0].lit(1.0);
        let factors = [one.lit(self.octave.amplitude), one, one.lit(0.0)];
        Psi {
            value: triple!(c => unit.value[c] * factors[c]),
            jacobian: triple!(c => {
                let row: [L; 3] = triple!(j => unit.jacobian[c][j] * factors[c]);
                triple!(i => {
                    row[0].mul_add(to_lattice[0][i], row[1].mul_add(to_lattice[1][i], row[2] * to_lattice[2][i]))
                })
            }),
        }
    }

    /// The first component alone, along `normal` and without its change along it: a stream function in the planes
    /// across, with a third of the mean square speed that all three components have.
    #[inline(always)]
    fn planar<L: Lane>(&self, unit: &Psi<L>, normal: DVec3) -> Psi<L> {
        let one = unit.value[0];
        // The jacobian is along lattice axes.
        let n: [L; 3] = triple!(j => {
            let axis = self.octave.axes[j];
            one.lit(axis[0] * normal.x + axis[1] * normal.y + axis[2] * normal.z)
        });
        let along = dot(unit.jacobian[0], n);
        let flat: [L; 3] = triple!(j => unit.jacobian[0][j] - along * n[j]);
        let factor = one.lit(3f64.sqrt());
        Psi {
            value: triple!(c => unit.value[0] * factor * one.lit(normal[c])),
            jacobian: triple!(c => triple!(j => flat[j] * factor * one.lit(normal[c]))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::curl::{central_jacobian, curl};
    use crate::math::real::cross;

    fn settings() -> OctavesSettings {
        OctavesSettings {
            length_scale: 0.7,
            speed: 1.3,
            spin_rate: 0.4,
            scroll: [0.3, -0.2, 0.5],
            seed: Seed(3),
            ..Default::default()
        }
    }

    #[test]
    fn every_octave_has_the_speed_that_its_gain_says_whatever_the_length() {
        for (k, octave) in octaves(&settings()).into_iter().enumerate() {
            let expected = 1.3 * 2f64.powf(-(k as f64) / 3.0);
            assert!((octave.speed() - expected).abs() < 1e-12);
            let span = octave.span(1.7, 0.1);
            let mut rng = CounterRng::new(Seed(8));
            let n = 60_000;
            let mean_sq = (0..n)
                .map(|_| {
                    let p = std::array::from_fn(|_| f64::from(rng.uniform()) * 2000.0 - 1000.0);
                    curl(&span.psi(p, 0.5)).iter().map(|x| x * x).sum::<f64>()
                })
                .sum::<f64>()
                / f64::from(n);
            println!("octave {k}: rms speed {:.4} m/s, wanted {expected:.4}", mean_sq.sqrt());
            assert!((mean_sq.sqrt() / expected - 1.0).abs() < 0.015);
        }
    }

    #[test]
    fn speed_stays_the_same_while_swirls_are_replaced_and_in_the_plane() {
        let n = 40_000;
        let across = DVec3::new(0.2, 1.0, 0.3);
        let forms = [(Form::Curl, 0.7), (Form::Planar(across), 0.0), (Form::Bitangent, 0.0)];
        for (form, evolve_rate) in forms {
            let settings = OctavesSettings { form, evolve_rate, spin_rate: 0.0, ..settings() };
            let octave = &octaves(&settings)[0];
            for time in [0.0, 0.5, 0.714] {
                let span = octave.span(time, 0.3);
                let mut rng = CounterRng::new(Seed(8));
                let mut square = 0.0;
                for _ in 0..n {
                    let p = std::array::from_fn(|_| f64::from(rng.uniform()) * 2000.0 - 1000.0);
                    let psi = span.psi(p, 0.6);
                    let v = DVec3::from_array(match form {
                        Form::Bitangent => cross(psi.jacobian[0], psi.jacobian[1]),
                        _ => curl(&psi),
                    });
                    square += v.length_squared() / f64::from(n);
                    assert!(form != Form::Planar(across) || v.dot(across.normalize()).abs() < 1e-12);
                }
                assert!((square.sqrt() / 1.3 - 1.0).abs() < 0.02, "{form:?} at {time} s: {}", square.sqrt());
            }
        }
    }

    #[test]
    fn replacement_goes_on_smoothly_from_pattern_to_pattern() {
        let settings = OctavesSettings { evolve_rate: 1.0, spin_rate: 0.0, scroll: [0.0; 3], ..settings() };
        let octave = &octaves(&settings)[0];
        let p = [0.3f64, 0.1, -2.0];
        let value = |t: f64| octave.span(t, 0.0).psi(p, 0.0).value[0];
        let steps: Vec<f64> = (0..4000).map(|i| value(f64::from(i) * 1e-3)).collect();
        let fastest = steps.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
        let range = steps.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        assert!(fastest < 0.02 * range, "{fastest} {range}");
        let across = octave.span(0.9, 0.4).psi(p, 0.5).value[0];
        assert!((across - value(1.1)).abs() < 1e-5, "within a span that crosses into the next pattern");
        assert!((value(0.0) - value(1.0)).abs() > 1e-3, "patterns differ");
    }

    #[test]
    fn at_full_memory_swirls_are_carried_by_an_eighth_of_a_larger_one() {
        let settings = OctavesSettings { memory: 1.0, scroll: [0.0; 3], ..settings() };
        let all = octaves(&settings);
        let spans: Vec<OctaveSpan> = all.iter().map(|o| o.span(0.3, 0.1)).collect();
        let (n, mut rng) = (20_000, CounterRng::new(Seed(4)));
        let (mut first, mut stretched) = (0.0, 0.0);
        for _ in 0..n {
            let p: [f64; 3] = std::array::from_fn(|_| f64::from(rng.uniform()) * 2000.0 - 1000.0);
            let (largest, drift) = spans[0].carried(p, 0.5, &Drift::none(0.0));
            assert_eq!(largest.value, spans[0].psi(p, 0.5).value, "nothing carries the largest");
            first += DVec3::from_array(drift.value).length_squared() / f64::from(n);
            let (second, _) = spans[1].carried(p, 0.5, &drift);
            let there = [0, 1, 2].map(|i| p[i] - drift.value[i]);
            assert_eq!(second.value, spans[1].psi(there, 0.5).value);
            stretched += DVec3::from_array(curl(&second)).length_squared() / f64::from(n);
        }
        let rms = first.sqrt() / all[0].length();
        println!(
            "carried by {rms:.4} of the largest swirl; speed {:.3} of the plain one",
            stretched.sqrt() / all[1].speed()
        );
        assert!((rms / 0.125 - 1.0).abs() < 0.02, "{rms}");
        assert!((1.0..1.6).contains(&(stretched.sqrt() / all[1].speed())), "drawn out, and not torn");
    }

    #[test]
    fn an_offset_moves_the_pattern() {
        let moved = OctavesSettings { offset: [0.5, 0.2, -0.1], ..settings() };
        let (a, b) = (octaves(&settings()).remove(0), octaves(&moved).remove(0));
        let (here, there) = (a.span(0.3, 0.0).psi([0.1f64, 0.2, 0.3], 0.0), b.span(0.3, 0.0).psi([0.6, 0.4, 0.2], 0.0));
        assert!((0..3).all(|i| (here.value[i] - there.value[i]).abs() < 1e-9));
    }

    #[test]
    fn the_jacobian_is_that_of_the_world() {
        let octave = &octaves(&settings())[1];
        let span = octave.span(0.2, 0.1);
        let p = [0.3f64, 0.1, -2.0];
        let exact = span.psi(p, 0.3).jacobian;
        let difference = central_jacobian(|q| span.psi(q, 0.3).value, p, 1e-5);
        for c in 0..3 {
            for i in 0..3 {
                assert!((exact[c][i] - difference[c][i]).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn spans_meet_in_time_and_scroll_carries_the_pattern() {
        let octave = &octaves(&OctavesSettings { spin_rate: 0.0, ..settings() })[0];
        let p = [0.3f64, 0.1, -2.0];
        let (a, b) = (octave.span(1.0, 0.5).psi(p, 1.0), octave.span(1.5, 0.5).psi(p, 0.0));
        let moved = std::array::from_fn(|i| p[i] + 2.0 * [0.3, -0.2, 0.5][i]);
        let c = octave.span(3.5, 0.1).psi(moved, 0.0);
        for i in 0..3 {
            assert!((a.value[i] - b.value[i]).abs() < 1e-5);
            assert!((b.value[i] - c.value[i]).abs() < 1e-9);
        }
    }
}
