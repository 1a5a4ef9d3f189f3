//! Scalar fields that potentials are multiplied with (curl-noise-2007, section 2.3): the potential is modulated, never the
//! velocity, so that divergence stays zero. All are twice continuously differentiable but for the distances of shapes
//! with ridges.

use crate::flow::octaves::{Octave, OctaveSpan};
use crate::geometry::motion::{Motion, RigidSpan};
use crate::geometry::primitive::Primitive;
use crate::geometry::sdf::{PlacedSdf, Sdf};
use crate::geometry::spline::Spline;
use crate::math::interpolate::quintic_step;
use crate::math::jet::{Jet, Scalar};
use crate::math::lattice::Lattice;
use crate::math::real::{Lane, Real, dot, triple};
use crate::math::space::Similarity;
use glam::{DMat3, DVec3, UVec3};
use std::sync::Arc;

/// Border of samples outside a block, over the inner part of which it fades to 0.
const BORDER: u32 = 3;
/// Unit noise rarely leaves ± this; patches of noise masks go from end to end of their range within it.
const NOISE_REACH: f64 = 0.35;

/// A number at each point.
#[derive(Debug, Clone)]
pub enum Mask {
    /// 0 where the coordinate along `axis` (length 1) is `from`, 1 where it is `to`.
    Height {
        /// Direction.
        axis: DVec3,
        /// Where it is 0 [m].
        from: f64,
        /// Where it is 1 [m].
        to: f64,
    },
    /// 0 at the signed distance `from` of a shape, 1 at `to`.
    Shape {
        /// The shape.
        sdf: Arc<PlacedSdf>,
        /// Where it is 0 [m].
        from: f64,
        /// Where it is 1 [m].
        to: f64,
    },
    /// The wake behind a body.
    Wake(Wake),
    /// Patches at random between two values.
    Noise {
        /// Of unit amplitude, frozen.
        octave: Box<OctaveSpan>,
        /// Least value.
        low: f64,
        /// Largest value.
        high: f64,
    },
    /// Sampled values.
    Block(Arc<Block>),
}

/// A widening tail behind a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wake {
    /// Middle of the body [m].
    pub center: DVec3,
    /// Half its size across the tail [m].
    pub radius: f64,
    /// Where the tail points, length 1.
    pub direction: DVec3,
    /// From the middle to where it has faded [m].
    pub length: f64,
    /// Metres that its edge moves outwards for each metre.
    pub spread: f64,
}

impl Wake {
    #[inline(always)]
    fn value<R: Real>(&self, p: [R; 3]) -> R {
        let (center, direction) = (self.center.to_array(), self.direction.to_array());
        let one = p[0].lit(1.0);
        let r: [R; 3] = triple!(i => p[i] - one.lit(center[i]));
        let behind = dot(r, triple!(i => one.lit(direction[i])));
        let across: [R; 3] = triple!(i => r[i] - behind * one.lit(direction[i]));
        let square = dot(across, across);
        let width = one.lit(self.spread).mul_add(behind.max(one.lit(0.0)), one.lit(self.radius));
        // Full in its middle, nothing at 1.5 times its width; from the middle of the body on, for its last half fading.
        let inside = smooth(square / (width * width), 2.25, 0.25);
        inside * smooth(behind, 0.0, self.radius) * smooth(behind, self.length, 0.5 * self.length)
    }
}

/// Samples on a lattice that may lie anywhere, interpolated by splines; 0 outside.
#[derive(Debug, Clone)]
pub struct Block {
    spline: Spline,
    /// Rows: from world space to lattice coordinates, and what is added.
    to_lattice: DMat3,
    offset: DVec3,
}

impl Block {
    /// The samples, whose lattice coordinates are `to_lattice · x + offset` for world-space points x.
    pub fn new(samples: &Lattice<f32>, to_lattice: DMat3, offset: DVec3) -> Self {
        let dims = samples.dims();
        let mut bordered = Lattice::filled(dims + 2 * BORDER, 0.0);
        for z in 0..dims.z {
            for y in 0..dims.y {
                for x in 0..dims.x {
                    let p = UVec3::new(x, y, z);
                    bordered.set(p + BORDER, samples.at(p));
                }
            }
        }
        Self { spline: Spline::new(DVec3::splat(-f64::from(BORDER)), 1.0, &bordered), to_lattice, offset }
    }

    /// One layer of samples, alike along the lattice's third axis.
    pub fn flat(samples: &Lattice<f32>, to_lattice: DMat3, offset: DVec3) -> Self {
        let dims = samples.dims();
        let layers = 2 * BORDER + 1;
        let mut thick = Lattice::filled(dims.with_z(layers), 0.0);
        for (i, value) in thick.values_mut().iter_mut().enumerate() {
            *value = samples.values()[i % samples.values().len()];
        }
        // Points come to lie in the middle, where nothing fades.
        Self::new(&thick, to_lattice, offset.with_z(f64::from(BORDER)))
    }

    /// Bytes of samples that [`Block::flat`] makes of a layer of this size.
    pub fn flat_memory_bytes(dims: UVec3) -> u64 {
        Self::memory_bytes(dims.with_z(2 * BORDER + 1))
    }

    /// Bytes of samples that [`Block::new`] makes of a lattice of this size.
    pub fn memory_bytes(dims: UVec3) -> u64 {
        (dims + 2 * BORDER + 2).as_u64vec3().element_product() * 12
    }

    #[inline(always)]
    fn at<L: Lane>(&self, p: [L; 3]) -> Scalar<L> {
        let rows: [[L; 3]; 3] = triple!(j => triple!(i => p[0].lit(self.to_lattice.col(i)[j])));
        let q: [L; 3] = triple!(j => dot(rows[j], p) + p[0].lit(self.offset[j]));
        // The spline rings a little round its border, and goes on in straight lines beyond.
        let (min, max) = (self.spline.min(), self.spline.max());
        let along: [(L, L); 3] = triple!(i => {
            let (one, inverse) = (q[i].lit(1.0), q[i].lit(1.0 / (f64::from(BORDER) - 1.0)));
            let (from_min, to_max) = (q[i] - q[i].lit(min[i]), q[i].lit(max[i]) - q[i]);
            let (fade, slope) = quintic_step((from_min.min(to_max) * inverse).clamp(one.lit(0.0), one));
            (fade, slope * from_min.select_lt(to_max, inverse, -inverse))
        });
        let [(x, by_x), (y, by_y), (z, by_z)] = along;
        let fade = Scalar { value: x * y * z, gradient: [by_x * y * z, x * by_y * z, x * y * by_z] };
        let value = self.spline.at(q).times(&fade);
        let gradient = triple!(i => {
            dot([rows[0][i], rows[1][i], rows[2][i]], value.gradient)
        });
        Scalar { value: value.value, gradient }
    }
}

/// 0 where x is `from` or beyond, 1 where it is `to` or beyond, twice continuously differentiable.
#[inline(always)]
fn smooth<R: Real>(x: R, from: f64, to: f64) -> R {
    let t = (x - x.lit(from)) * x.lit(1.0 / (to - from));
    quintic_step(t.clamp(x.lit(0.0), x.lit(1.0))).0
}

/// As [`smooth`], of a field.
#[inline(always)]
fn smooth_field<L: Real>(x: Scalar<L>, from: f64, to: f64) -> Scalar<L> {
    let inverse = x.value.lit(1.0 / (to - from));
    let t = ((x.value - x.value.lit(from)) * inverse).clamp(x.value.lit(0.0), x.value.lit(1.0));
    let (value, slope) = quintic_step(t);
    let slope = slope * inverse;
    Scalar { value, gradient: triple!(i => slope * x.gradient[i]) }
}

/// A mask, and the motion of the shape that it belongs to.
#[derive(Debug, Clone)]
pub struct PlacedMask {
    /// The mask, where the shape rests.
    pub mask: Mask,
    /// The shape's motion and the middle that it turns about [m]; `None` for what is at rest.
    pub motion: Option<(Arc<Motion>, DVec3)>,
}

impl From<Mask> for PlacedMask {
    fn from(mask: Mask) -> Self {
        Self { mask, motion: None }
    }
}

impl PlacedMask {
    /// The mask from `start` [s], lasting `duration` [s].
    pub fn span(&self, start: f64, duration: f64) -> MaskSpan<'_> {
        let motion = self.motion.as_ref().map(|(motion, middle)| motion.span(*middle, start, duration));
        MaskSpan { mask: &self.mask, motion }
    }
}

/// A [`PlacedMask`] over a span of time.
#[derive(Debug, Clone)]
pub struct MaskSpan<'a> {
    mask: &'a Mask,
    motion: Option<RigidSpan>,
}

impl MaskSpan<'_> {
    /// Value and gradient at `p` [m]; `phase` runs from 0 at the start of the span to 1 at its end.
    #[inline(always)]
    pub fn at<L: Lane>(&self, p: [L; 3], phase: L) -> Scalar<L> {
        let Some(motion) = &self.motion else { return self.mask.at(p) };
        if let Mask::Wake(wake) = self.mask {
            // The wind decides where a tail points, however the body turns.
            let center = motion.center(phase);
            return self.mask.at(triple!(i => p[i] - (center[i] - phase.lit(wake.center[i]))));
        }
        let (rest, rotation) = motion.to_rest(p, phase);
        let found = self.mask.at(rest);
        Scalar { value: found.value, gradient: triple!(i => dot(rotation[i], found.gradient)) }
    }
}

impl Mask {
    /// By the distance from a solid in world space: 0 at `from`, 1 at `to` [m].
    pub fn solid(solid: Primitive, from: f64, to: f64) -> Self {
        Self::Shape { sdf: Arc::new(PlacedSdf::new(Sdf::Primitive(solid), Similarity::IDENTITY)), from, to }
    }

    /// Patches of size `length` [m] between `low` and `high`.
    pub fn noise(octave: &Octave, low: f64, high: f64) -> Self {
        Self::Noise { octave: Box::new(octave.span(0.0, 0.0)), low, high }
    }

    /// Value and gradient at `p` [m].
    #[inline(never)]
    pub fn at<L: Lane>(&self, p: [L; 3]) -> Scalar<L> {
        p[0].outlined(
            #[inline(always)]
            || self.at_here(p),
        )
    }

    #[inline(always)]
    fn at_here<L: Lane>(&self, p: [L; 3]) -> Scalar<L> {
        let one = p[0].lit(1.0);
        match self {
            Self::Height { axis, from, to } => {
                let gradient = triple!(i => one.lit(axis[i]));
                smooth_field(Scalar { value: dot(gradient, p), gradient }, *from, *to)
            }
            Self::Shape { sdf, from, to } => smooth_field(sdf.at(p), *from, *to),
            Self::Wake(wake) => wake.value(Jet::point(p)).scalar(),
            Self::Noise { octave, low, high } => {
                let psi = octave.psi(p, one.lit(0.0));
                let unit = Scalar { value: psi.value[0], gradient: psi.jacobian[0] };
                let patches = smooth_field(unit, -NOISE_REACH, NOISE_REACH);
                let range = one.lit(high - low);
                let value = range.mul_add(patches.value, one.lit(*low));
                Scalar { value, gradient: triple!(i => range * patches.gradient[i]) }
            }
            Self::Block(block) => block.at(p),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::noise::RMS_SPEED;
    use crate::flow::octaves::{OctavesSettings, octaves};
    use crate::geometry::primitive::{Cuboid, Sphere};
    use crate::math::hash::{CounterRng, Seed};

    fn unit_octave() -> Octave {
        let settings = OctavesSettings { length_scale: 0.5, speed: RMS_SPEED / 0.5, octaves: 1, ..Default::default() };
        octaves(&settings).remove(0)
    }

    fn masks() -> Vec<Mask> {
        let ball = Primitive::Sphere(Sphere { center: DVec3::new(0.2, 0.0, 0.1), radius: 0.5 });
        let cube = Cuboid { center: DVec3::ZERO, half_size: DVec3::splat(0.4), rounding: 0.0 };
        let samples = (0..5 * 4 * 6).map(|i| (f64::from(i) * 0.7).sin().abs() as f32).collect();
        let samples = Lattice::from_values(UVec3::new(5, 4, 6), samples);
        let turn = DMat3::from_axis_angle(DVec3::new(1.0, 0.3, 0.0).normalize(), 0.8) * 3.0;
        vec![
            Mask::Height { axis: DVec3::new(0.6, 0.8, 0.0), from: -0.3, to: 0.7 },
            Mask::solid(ball, 0.4, -0.1),
            Mask::solid(Primitive::Cuboid(cube), 0.5, 0.0),
            Mask::Wake(Wake {
                center: DVec3::new(-0.5, 0.0, 0.0),
                radius: 0.3,
                direction: DVec3::X,
                length: 1.6,
                spread: 0.2,
            }),
            Mask::noise(&unit_octave(), 0.2, 0.9),
            Mask::Block(Arc::new(Block::new(&samples, turn, DVec3::new(2.0, 1.5, 2.5)))),
        ]
    }

    #[test]
    fn gradients_are_those_of_the_values_and_values_stay_in_their_range() {
        let mut rng = CounterRng::new(Seed(4));
        let h = 1e-4;
        for (i, mask) in masks().into_iter().enumerate() {
            let (mut low, mut high) = (f64::MAX, f64::MIN);
            for _ in 0..2000 {
                let p: [f64; 3] = std::array::from_fn(|_| f64::from(rng.uniform()) * 3.0 - 1.5);
                let found = mask.at(p);
                (low, high) = (low.min(found.value), high.max(found.value));
                for axis in 0..3 {
                    let moved = |by: f64| {
                        let mut q = p;
                        q[axis] += by;
                        mask.at(q).value
                    };
                    let difference = (moved(h) - moved(-h)) / (2.0 * h);
                    assert!((found.gradient[axis] - difference).abs() < 2e-3, "mask {i} at {p:?} along {axis}");
                }
            }
            assert!(low > -0.2 && high < 1.3 && high - low > 0.5, "mask {i}: {low} to {high}");
        }
    }

    #[test]
    fn a_block_has_its_samples_and_nothing_outside() {
        let samples = Lattice::from_values(UVec3::new(4, 3, 2), (0..24).map(|i| i as f32 * 0.1).collect());
        let block = Block::new(&samples, DMat3::from_diagonal(DVec3::splat(2.0)), DVec3::ZERO);
        for (x, y, z) in [(0, 0, 0), (3, 2, 1), (1, 1, 0)] {
            let p = [x, y, z].map(|i| f64::from(i) * 0.5);
            let sample = samples.at(UVec3::new(x as u32, y as u32, z as u32));
            assert!((block.at(p).value - f64::from(sample)).abs() < 1e-5);
        }
        for p in [[-1.6, 0.0, 0.0], [1.0, 2.6, 0.0], [5.0, 5.0, 50.0]] {
            assert_eq!(block.at(p), Scalar { value: 0.0, gradient: [0.0; 3] });
        }
    }
}
