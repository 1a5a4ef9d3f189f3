//! Transmittance towards a sun from a lattice, and what it misses put right now and then.
//!
//! Every scattering asks the sun, always along the same direction. So the transmittance is worked out once on a lattice whose
//! columns run along that direction: each column is one walk through the smoke, and no error adds up along it. A connection
//! reads the lattice, T̃, and with probability p adds (T − T̃)/p, T being the exact transmittance along its own ray. The mean is
//! T whatever the lattice holds: it is a control variate, and only how often T must be worked out depends on it. p grows with
//! the differences in the lattice nearby, where interpolation may err.

use crate::geometry::embree::Ray;
use crate::grid::BRICK_EDGE;
use crate::math::parallel;
use crate::math::space::{IndexPoint, UnitVec3, WorldPoint};
use crate::render::equiangular::optical_depth;
use crate::render::light::Light;
use crate::render::medium::Medium;
use crate::render::sampler::Stream;
use glam::{Mat3A, UVec3, Vec2, Vec3, Vec3A};
use std::f32::consts::PI;

/// Voxels between columns, and between points of a column along the axis nearest to the sun's direction.
const SPACING: f32 = 2.0;
/// Points of a lattice as they are meant to be at most; of larger smoke they lie further apart.
const POINTS_MAX: f32 = 16e6;
/// Most memory of a lattice [bytes]: rounded up to whole points it may have more of them.
pub const BYTES_MAX: u64 = 32_000_000;
/// Probability with which the exact transmittance is worked out where a lattice of this spacing is flat.
const LEAST_PROBABILITY: f32 = 1.0 / 128.0;
/// What is added to it for the range r of the eight transmittances about a point, times r and times r³: where r is small the
/// lattice resolves what there is and errs little, where it is 1 a shadow's edge lies between its points.
const PER_RANGE: f32 = 1.0 / 8.0;
const PER_CUBED_RANGE: f32 = 1.0 / 2.0;
/// Least probability of all, far above the spacing of uniform numbers.
const PROBABILITY_MIN: f32 = 1.0 / 4096.0;
/// Spacing beyond which a lattice overlooks too much to be of use [voxels].
const SPACING_MAX: f32 = 4.0;

/// Transmittances of one volume towards one sun.
pub struct SunShadow {
    /// At each point as a fraction of 255, along columns first.
    values: Vec<u8>,
    /// Points of the lattice: along columns, and of columns along the two other axes.
    dims: UVec3,
    /// The axis along which the columns' points are numbered, and the two others.
    axes: [usize; 3],
    /// Index coordinates of the first point of the first column.
    low: Vec3,
    /// Change of the other two coordinates along a column for a voxel along its axis.
    slope: Vec2,
    spacing: f32,
    /// Probability with which the exact transmittance is worked out where the lattice is flat.
    least_probability: f32,
    /// Where the first point of the first column is [m], and from offsets to it to places in the lattice.
    start: Vec3A,
    to_place: Mat3A,
}

impl SunShadow {
    /// The shadow that `medium` casts away from the direction `towards` a sun, from whose middle its light comes within an angle
    /// of `half_angle` [rad]. `None` where a lattice is of no use: without smoke, where optical depths are not known exactly, where
    /// points would lie too far apart, and where light from a rim of the sun goes past other points of the lattice than
    /// that from the middle.
    pub fn new(medium: &Medium, towards: UnitVec3, half_angle: f32) -> Option<Self> {
        if medium.grid().is_empty() || !medium.has_exact_depths() || medium.tint.is_some() {
            return None;
        }
        let axis = towards.abs().max_position();
        let axes = [axis, (axis + 1) % 3, (axis + 2) % 3];
        let slope = Vec2::new(towards[axes[1]], towards[axes[2]]) / towards[axis];
        // Index coordinates between which there may be density.
        let (low, high) = (Vec3::splat(BRICK_EDGE as f32 - 1.0), medium.grid().extent());
        let size = high - low;
        // Columns through the near face stand before those through the far one by as much as they lean.
        let lean = slope * size[axis];
        let own_low = Vec2::new(low[axes[1]], low[axes[2]]) - lean.max(Vec2::ZERO);
        let own_size = Vec2::new(size[axes[1]], size[axes[2]]) + lean.abs();
        let volume = size[axis] * own_size.x * own_size.y;
        let spacing = SPACING.max((volume / POINTS_MAX).cbrt());
        if spacing > SPACING_MAX || half_angle * size.length() > spacing {
            return None;
        }
        let dims = Vec3::new(size[axis], own_size.x, own_size.y) / spacing;
        let dims = dims.ceil().as_uvec3() + 1;
        if dims.as_u64vec3().element_product() > BYTES_MAX {
            return None;
        }
        // What lies between points further apart is overlooked more often.
        let least_probability = LEAST_PROBABILITY * (spacing / SPACING).powi(3);
        let mut shadow = Self {
            values: vec![u8::MAX; dims.element_product() as usize],
            dims,
            axes,
            low: Vec3::new(low[axis], own_low.x, own_low.y),
            slope,
            spacing,
            least_probability,
            start: Vec3A::ZERO,
            to_place: Mat3A::IDENTITY,
        };
        shadow.start = medium.grid().to_world(shadow.point(UVec3::ZERO)).0.into();
        let [along, across_u, across_v] = axes.map(|axis| Vec3A::AXES[axis]);
        let rows = [along, across_u - slope.x * along, across_v - slope.y * along];
        let scale = 1.0 / (spacing * medium.grid().voxel_size());
        shadow.to_place = Mat3A::from_cols(rows[0], rows[1], rows[2]).transpose() * scale;
        let from_sun = -towards;
        let is_first_nearest = towards[axis] < 0.0;
        let mut values = std::mem::take(&mut shadow.values);
        parallel::for_each_chunk_mut(&mut values, dims.x as usize, |column, values| {
            let column = UVec3::new(0, column as u32 % dims.y, column as u32 / dims.y);
            let start = UVec3 { x: if is_first_nearest { 0 } else { dims.x - 1 }, ..column };
            let ray = Ray { origin: medium.grid().to_world(shadow.point(start)), direction: from_sun };
            let between = spacing * medium.grid().voxel_size() / towards[axis].abs();
            let at = |i: usize, value: u8| {
                let n = values.len();
                values[if is_first_nearest { i } else { n - 1 - i }] = value;
            };
            fill_column(medium, &ray, between, dims.x as usize, at);
        });
        shadow.values = values;
        Some(shadow)
    }

    /// Index coordinates of a point of the lattice.
    fn point(&self, place: UVec3) -> IndexPoint {
        let along = place.x as f32 * self.spacing;
        let across = Vec2::new(self.low.y, self.low.z) + Vec2::new(place.y as f32, place.z as f32) * self.spacing;
        let across = across + self.slope * along;
        let mut p = Vec3::ZERO;
        p[self.axes[0]] = self.low.x + along;
        p[self.axes[1]] = across.x;
        p[self.axes[2]] = across.y;
        IndexPoint(p)
    }

    /// The transmittance from `p` to the sun by the lattice, and the range of the values that it was interpolated from.
    #[inline]
    fn read(&self, p: WorldPoint) -> (f32, f32) {
        let place = self.to_place * (Vec3A::from(p.0) - self.start);
        let last = self.dims.as_vec3a() - 1.0;
        // What lies beside the lattice has no smoke before the sun; before and behind it all of a column's or none.
        if !(place.y >= 0.0 && place.z >= 0.0 && place.y < last.y && place.z < last.z) {
            return (1.0, 0.0);
        }
        let x = place.x.clamp(0.0, last.x.next_down());
        let cell = [x as i32 as usize, place.y as i32 as usize, place.z as i32 as usize];
        let (u, v, w) = (x - cell[0] as i32 as f32, place.y - cell[1] as i32 as f32, place.z - cell[2] as i32 as f32);
        let (row, layer) = (self.dims.x as usize, self.dims.x as usize * self.dims.y as usize);
        let at = cell[0] + cell[1] * row + cell[2] * layer;
        let Some(values) = self.values.get(at..at + layer + row + 2) else { return (1.0, 1.0) };
        let value = |o: usize| f32::from(values[o]);
        let [a, b, c, d] = [value(0), value(1), value(row), value(row + 1)];
        let [e, f, g, h] = [value(layer), value(layer + 1), value(layer + row), value(layer + row + 1)];
        let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let near = lerp(lerp(a, b, u), lerp(c, d, u), v);
        let far = lerp(lerp(e, f, u), lerp(g, h, u), v);
        let most = a.max(b).max(c.max(d)).max(e.max(f).max(g.max(h)));
        let least = a.min(b).min(c.min(d)).min(e.min(f).min(g.min(h)));
        const UNIT: f32 = 1.0 / u8::MAX as f32;
        (lerp(near, far, w) * UNIT, (most - least) * UNIT)
    }

    /// An unbiased estimate of the transmittance of `medium`, of which this is the shadow, along a ray to the sun. It may lie
    /// outside of [0, 1]. `worth` is what light from there counts over what it counts after a first even scattering that
    /// takes nothing away: errors of what counts little may be larger.
    #[inline]
    pub fn estimate_transmittance(&self, medium: &Medium, ray: &Ray, worth: f32, stream: &mut Stream) -> f32 {
        let (rough, range) = self.read(ray.origin);
        let wanted = worth * (self.least_probability + (PER_RANGE + PER_CUBED_RANGE * range * range) * range);
        let probability = wanted.clamp(PROBABILITY_MIN, 1.0);
        if stream.uniform() >= probability {
            return rough;
        }
        let exact = (-optical_depth(medium, ray, f32::INFINITY)).exp() as f32;
        rough + (exact - rough) / probability
    }
}

/// Hands the transmittances at `count` points, `between` [m] from one to the next along a ray from the sun, to `at`.
fn fill_column(medium: &Medium, ray: &Ray, between: f32, count: usize, mut at: impl FnMut(usize, u8)) {
    /// Pieces in which the density is taken at the middle [voxels].
    const PIECE: f32 = 1.5;
    let line = medium.ray_to_index(ray);
    let longest = PIECE * medium.grid().voxel_size();
    let value = |tau: f32| ((-tau).exp() * f32::from(u8::MAX) + 0.5) as u8;
    let (mut next, mut tau) = (0, 0.0f32);
    for segment in medium.majorants(ray, f32::INFINITY) {
        let pieces = ((segment.t1 - segment.t0) / longest).ceil().max(1.0);
        let dt = (segment.t1 - segment.t0) / pieces;
        for i in 0..pieces as u32 {
            let t = segment.t0 + i as f32 * dt;
            while next < count && next as f32 * between <= t {
                at(next, value(tau));
                next += 1;
            }
            tau += medium.sigma_t(line.at(t + 0.5 * dt)) * dt;
        }
    }
    (next..count).for_each(|i| at(i, value(tau)));
}

/// The shadows of all volumes towards all suns.
#[derive(Default)]
pub struct SunShadows {
    /// For each light and each volume with voxels.
    by_light: Vec<Vec<Option<SunShadow>>>,
}

impl SunShadows {
    /// Those that `media` cast away from such of `lights` as are suns.
    pub fn new<'a>(lights: &[Light], media: impl Iterator<Item = &'a Medium> + Clone) -> Self {
        let of_light = |light: &Light| match light {
            Light::Sun(sun) => {
                let half_angle = (2.0 * sun.one_minus_cosine()).sqrt();
                let all: Vec<_> =
                    media.clone().map(|medium| SunShadow::new(medium, sun.towards(), half_angle)).collect();
                if all.iter().any(Option::is_some) { all } else { Vec::new() }
            }
            _ => Vec::new(),
        };
        Self { by_light: lights.iter().map(of_light).collect() }
    }

    /// Those towards light `i`, for light of which a path scatters the share `scattered` [1/sr] to the camera.
    #[inline]
    pub fn towards(&self, i: usize, scattered: f32) -> Shadows<'_> {
        let of_volumes = self.by_light.get(i).map_or(&[][..], |shadows| shadows);
        Shadows { of_volumes, worth: scattered * (4.0 * PI) }
    }
}

/// The shadows towards one light, as a path asks for them.
#[derive(Clone, Copy)]
pub struct Shadows<'a> {
    /// One for each volume with voxels, or none at all where none of them has one.
    of_volumes: &'a [Option<SunShadow>],
    worth: f32,
}

impl<'a> Shadows<'a> {
    /// Those towards a light that is no sun.
    pub const NONE: Self = Self { of_volumes: &[], worth: 1.0 };

    /// Whether no volume has one.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.of_volumes.is_empty()
    }

    /// That of the volume that is number `i` of those with voxels.
    #[inline]
    pub fn of_volume(&self, i: usize) -> Option<ShadowFor<'a>> {
        Some(ShadowFor { shadow: self.of_volumes.get(i)?.as_ref()?, worth: self.worth })
    }
}

/// A shadow as a path asks for it.
#[derive(Clone, Copy)]
pub struct ShadowFor<'a> {
    shadow: &'a SunShadow,
    worth: f32,
}

impl ShadowFor<'_> {
    /// See [`SunShadow::estimate_transmittance`].
    #[inline]
    pub fn estimate_transmittance(&self, medium: &Medium, ray: &Ray, stream: &mut Stream) -> f32 {
        self.shadow.estimate_transmittance(medium, ray, self.worth, stream)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::DensityGrid;
    use crate::math::hash::{CounterRng, Seed};
    use crate::render::phase::Phase;

    fn medium(corner: Vec3, density: impl Fn(Vec3) -> f32 + Sync) -> Medium {
        let dims = UVec3::new(40, 24, 32);
        let grid = DensityGrid::from_fn(WorldPoint(corner), 0.05, dims, 1 << 24, |p| density(p.0 - corner));
        Medium::new(grid.expect("small"), 6.0, Vec3::ONE, Phase::HenyeyGreenstein { g: 0.0 })
    }

    /// Within a box of 2, 1.2 and 1.6 metres, towards whose faces they fade.
    fn lumps(p: Vec3) -> f32 {
        let q = p / Vec3::new(2.0, 1.2, 1.6);
        let fade = (q * (1.0 - q)).max(Vec3::ZERO).element_product() * 40.0;
        fade * ((5.0 * p.x).sin() * (6.0 * p.y + 1.0).cos() + (4.0 * p.z).sin() + 0.5).max(0.0)
    }

    fn directions() -> impl Iterator<Item = UnitVec3> {
        let axes = Vec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
        let oblique = [Vec3::new(0.6, 0.7, 0.35), Vec3::new(-0.9, 0.3, -0.4), Vec3::new(0.2, -0.3, 0.9), Vec3::ONE];
        axes.chain(oblique).map(|d| UnitVec3::try_new(d).expect("not zero"))
    }

    fn points(corner: Vec3, seed: u64) -> impl Iterator<Item = WorldPoint> {
        let mut rng = CounterRng::new(Seed(seed));
        std::iter::repeat_with(move || WorldPoint(corner + (rng.coarse_point() * 1.6 - 0.3) * Vec3::new(2.0, 1.2, 1.6)))
    }

    fn exact(medium: &Medium, ray: &Ray) -> f32 {
        (-optical_depth(medium, ray, f32::INFINITY)).exp() as f32
    }

    #[test]
    fn the_lattice_is_near_the_transmittance_in_the_smoke_and_about_it() {
        for corner in [Vec3::new(-1.0, 0.4, 0.0), Vec3::new(900.0, -700.0, 400.0)] {
            let medium = medium(corner, lumps);
            for direction in directions() {
                let shadow = SunShadow::new(&medium, direction, 0.0).expect("there is smoke");
                let (mut square, mut shaded) = (0.0, 0);
                const N: usize = 2000;
                for origin in points(corner, 3).take(N) {
                    let expected = exact(&medium, &Ray { origin, direction });
                    let (rough, range) = shadow.read(origin);
                    square += (rough - expected).powi(2) / N as f32;
                    shaded += u32::from(expected < 0.7);
                    assert!((rough - expected).abs() < 0.05 + range, "{origin:?} {direction:?}: {rough} {expected}");
                }
                assert!(shaded > 200 && square.sqrt() < 0.02, "{direction:?}: {shaded} {square}");
            }
        }
    }

    /// Whatever the lattice holds: its own shadow, and that of other smoke.
    #[test]
    fn estimates_have_the_transmittance_as_their_mean() {
        let corner = Vec3::new(-1.0, 0.4, 0.0);
        let (smoke, other) = (medium(corner, lumps), medium(corner, |p| 0.6 * lumps(Vec3::new(2.0, 1.2, 1.6) - p)));
        let mut stream = Stream::new(Seed(8));
        for (holder, worth) in [(&smoke, 1.0), (&other, 1.0), (&other, 0.3), (&other, 2.5)] {
            for direction in directions().step_by(3) {
                let shadow = SunShadow::new(holder, direction, 0.0).expect("there is smoke");
                let (mut sum, mut square) = (0.0, 0.0);
                const N: u32 = 60_000;
                for origin in points(corner, 5).take(N as usize) {
                    let ray = Ray { origin, direction };
                    let error = shadow.estimate_transmittance(&smoke, &ray, worth, &mut stream) - exact(&smoke, &ray);
                    sum += f64::from(error);
                    square += f64::from(error).powi(2);
                }
                let mean = sum / f64::from(N);
                let deviation = (square / f64::from(N) - mean * mean).sqrt();
                assert!(mean.abs() < 4.0 * deviation / f64::from(N).sqrt(), "{direction:?}: {mean} of {deviation}");
                // The other smoke's shadow is wrong almost everywhere.
                let is_own = std::ptr::eq(holder, &smoke);
                assert!(
                    if is_own { deviation < 0.12 } else { deviation > 0.2 / f64::from(worth) },
                    "{deviation} {worth}"
                );
            }
        }
    }

    #[test]
    fn a_sun_too_wide_and_smoke_without_exact_depths_have_no_shadow() {
        use crate::render::sun::Sun;
        let smoke = medium(Vec3::ZERO, lumps);
        let sun = |degrees: f64| Light::Sun(Sun::new(-UnitVec3::Y, Vec3::ONE, degrees, false));
        let shadows = SunShadows::new(&[sun(0.53), sun(30.0)], std::iter::once(&smoke));
        assert!(shadows.towards(0, 1.0).of_volume(0).is_some() && (1..8).all(|i| shadows.towards(i, 1.0).is_empty()));
        let none = medium(Vec3::ZERO, |_| 0.0);
        assert!(SunShadow::new(&none, UnitVec3::Y, 0.0).is_none());
    }
}
