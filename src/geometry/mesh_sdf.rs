//! The signed distance of a mesh, sampled on two nested lattices and interpolated by splines.
//!
//! The inner lattice holds the mesh closely; the outer one, four times as coarse, reaches a longest edge further, for
//! flows that feel a body from afar. Between them the distance passes smoothly from one to the other.
//!
//! Distances are exact within two cells of the surface; further out each sample takes the nearest of its neighbours'
//! triangles (Bridson 2015, *Fluid Simulation for Computer Graphics*, section 4.3, after Tsai 2002), which is exact but
//! for rare samples. Inside is where the winding number along lattice lines is not zero; the lines of all three axes,
//! walked from both ends, vote, so that small holes do no harm.

use crate::geometry::mesh::Mesh;
use crate::geometry::primitive::Cuboid;
use crate::geometry::spline::Spline;
use crate::geometry::triangle::closest_point;
use crate::math::aabb::Aabb;
use crate::math::jet::{Jet, Scalar};
use crate::math::lattice::Lattice;
use crate::math::parallel;
use crate::math::real::{Lane, Real, triple};
use glam::{DVec3, UVec3, Vec3};

/// Cells of the inner lattice along the longest edge, where the spacing is not given. Twice as many take eight times
/// the time and memory; at 96 the walls of a ball are right to a 20,000th of its size.
pub const DEFAULT_CELLS: f64 = 96.0;

/// Cells that the inner lattice reaches beyond the mesh.
const INNER_MARGIN: f64 = 9.0;

/// Cells round the mesh in which the inner lattice counts alone.
const INNER_ALONE: f64 = 3.0;

/// Spacing of the outer lattice over that of the inner one.
const OUTER_RATIO: f64 = 4.0;

/// How far the outer lattice reaches beyond the mesh, in longest edges. Flows feel a body to at most half a longest edge
/// by default.
const OUTER_MARGIN: f64 = 1.0;

/// Cells round each triangle in which distances are exact.
const BAND: f32 = 2.0;

/// A sampled signed distance in the mesh's own space.
#[derive(Debug, Clone)]
pub struct MeshSdf {
    bounds: Aabb,
    inner: Spline,
    outer: Spline,
    /// Width of the layer over which the inner lattice gives way to the outer one [m].
    blend: f64,
    inside_samples: usize,
}

/// Why a mesh's distance could not be sampled.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeshSdfError {
    /// Too fine for the memory limit.
    #[error(
        "sampling the mesh's distance every {spacing:.3e} m over {size:?} m takes {needed_gib:.2} GiB, more than the limit of {limit_gib:.2} GiB; make distance_voxel larger"
    )]
    Memory {
        /// Spacing asked for [m].
        spacing: f64,
        /// Size of the mesh [m].
        size: [f32; 3],
        /// What it would take.
        needed_gib: f64,
        /// What is allowed.
        limit_gib: f64,
    },
    /// The mesh has no extent along any axis, or more than can be sampled.
    #[error("a mesh of {size:?} m has no distance that can be sampled")]
    Extent {
        /// Size of the mesh [m].
        size: [f32; 3],
    },
}

impl MeshSdf {
    /// Samples the distance of `mesh` every `spacing` [m], by default a [`DEFAULT_CELLS`]th of its longest edge.
    ///
    /// # Errors
    /// Where that takes more than `memory_limit` bytes; nothing has been allocated then.
    pub fn sample(mesh: &Mesh, spacing: Option<f64>, memory_limit: u64) -> Result<Self, MeshSdfError> {
        let bounds = mesh.bounds();
        let size = bounds.size().to_array();
        let longest = f64::from(bounds.size().max_element());
        let spacing = spacing.unwrap_or(longest / DEFAULT_CELLS);
        if !(longest > 0.0 && longest.is_finite() && spacing > 0.0) {
            return Err(MeshSdfError::Extent { size });
        }
        let inner = Plan::new(&bounds, spacing, INNER_MARGIN * spacing);
        let outer = Plan::new(&bounds, spacing * OUTER_RATIO, OUTER_MARGIN * longest + INNER_MARGIN * spacing);
        let needed = inner.memory_bytes() + outer.memory_bytes();
        if needed > memory_limit as f64 {
            let gib = f64::from(1 << 30);
            let (needed_gib, limit_gib) = (needed / gib, memory_limit as f64 / gib);
            return Err(MeshSdfError::Memory { spacing, size, needed_gib, limit_gib });
        }
        let samples = parallel::map(2, |i| [&inner, &outer][i].sample(mesh));
        let inside_samples = samples[0].values().iter().filter(|d| **d < 0.0).count();
        Ok(Self {
            bounds,
            inner: Spline::new(inner.origin, inner.spacing, &samples[0]),
            outer: Spline::new(outer.origin, outer.spacing, &samples[1]),
            blend: (INNER_MARGIN - INNER_ALONE) * spacing,
            inside_samples,
        })
    }

    /// The smallest box around the mesh.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Samples of the inner lattice that lie inside the mesh.
    pub fn inside_samples(&self) -> usize {
        self.inside_samples
    }

    /// Distance between samples of the inner lattice [m].
    pub fn spacing(&self) -> f64 {
        self.inner.spacing()
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> u64 {
        self.inner.memory_bytes() + self.outer.memory_bytes()
    }

    /// Signed distance [m], to the bit as [`MeshSdf::at`] has it.
    #[inline(always)]
    pub fn distance<L: Lane>(&self, p: [L; 3]) -> L {
        p[0].outlined(
            #[inline(always)]
            || self.distance_here(p),
        )
    }

    /// Signed distance [m] with its gradient, that of the interpolated field itself: continuously differentiable, and
    /// only nearly of length 1.
    #[inline(always)]
    pub fn at<L: Lane>(&self, p: [L; 3]) -> Scalar<L> {
        p[0].outlined(
            #[inline(always)]
            || self.at_here(p),
        )
    }

    /// The result in a lane depends on that lane alone, whichever lattices the others need.
    #[inline(always)]
    fn at_here<L: Lane>(&self, p: [L; 3]) -> Scalar<L> {
        let (zero, blend) = (p[0].lit(0.0), p[0].lit(self.blend));
        let inward = self.inward(p);
        if !inward.any_lt(blend) {
            return self.inner.at(p);
        }
        let outer = self.beyond_all_samples(p, self.outer.at(p));
        if !zero.any_lt(inward) {
            return outer;
        }
        let inner = self.inner.at(p);
        let weight = self.inner_weight(Jet::point(p)).scalar();
        let difference = inner.minus(&outer);
        let mixed = outer.plus(&difference.times(&weight));
        Scalar::select_lt(inward, blend, Scalar::select_lt(zero, inward, mixed, outer), inner)
    }

    /// As [`MeshSdf::at_here`], of which it takes the values alone: derivatives that nobody reads are not computed.
    #[inline(always)]
    fn distance_here<L: Lane>(&self, p: [L; 3]) -> L {
        let (zero, blend) = (p[0].lit(0.0), p[0].lit(self.blend));
        let inward = self.inward(p);
        if !inward.any_lt(blend) {
            return self.inner.value(p);
        }
        let outer = Scalar { value: self.outer.value(p), gradient: [zero; 3] };
        let outer = self.beyond_all_samples(p, outer).value;
        if !zero.any_lt(inward) {
            return outer;
        }
        let inner = self.inner.value(p);
        let mixed = outer + (inner - outer) * self.inner_weight(Jet::point(p)).value;
        inward.select_lt(blend, zero.select_lt(inward, mixed, outer), inner)
    }

    /// How deep inside the inner lattice a point lies [m].
    #[inline(always)]
    fn inward<L: Real>(&self, p: [L; 3]) -> L {
        let (min, max) = (self.inner.min(), self.inner.max());
        let along: [L; 3] = triple!(axis => {
            let x = p[axis];
            (x - x.lit(min[axis])).min(x.lit(max[axis]) - x)
        });
        along[0].min(along[1]).min(along[2])
    }

    /// Outside the outer lattice its straight continuation can fall again; the distance to the bounds never exceeds the
    /// true one and takes over.
    #[inline(always)]
    fn beyond_all_samples<L: Lane>(&self, p: [L; 3], outer: Scalar<L>) -> Scalar<L> {
        let (min, max) = (self.outer.min(), self.outer.max());
        let zero = p[0].lit(0.0);
        let along: [L; 3] = triple!(axis => {
            let x = p[axis];
            (x.lit(min[axis]) - x).max(x - x.lit(max[axis]))
        });
        let outward = along[0].max(along[1]).max(along[2]);
        if !zero.any_lt(outward) {
            return outer;
        }
        let bounds = self.bounds_distance(Jet::point(p)).scalar();
        let larger = Scalar::select_lt(outer.value, bounds.value, bounds, outer);
        Scalar::select_lt(zero, outward, larger, outer)
    }

    /// 1 near the mesh, 0 outside the inner lattice, twice continuously differentiable between.
    #[inline(always)]
    fn inner_weight<R: Real>(&self, p: [R; 3]) -> R {
        let (min, max) = (self.inner.min(), self.inner.max());
        let along: [R; 3] = triple!(axis => {
            let x = p[axis];
            let inward = (x - x.lit(min[axis])).min(x.lit(max[axis]) - x);
            let t = (inward / x.lit(self.blend)).clamp(x.lit(0.0), x.lit(1.0));
            t.squared() * t * (t * (t * x.lit(6.0) - x.lit(15.0)) + x.lit(10.0))
        });
        along[0] * along[1] * along[2]
    }

    #[inline(always)]
    fn bounds_distance<R: Real>(&self, p: [R; 3]) -> R {
        let (min, max) = (self.bounds.min.as_dvec3(), self.bounds.max.as_dvec3());
        Cuboid { center: (min + max) * 0.5, half_size: (max - min) * 0.5, rounding: 0.0 }.distance(p)
    }
}

/// A lattice that is going to be sampled.
struct Plan {
    origin: DVec3,
    spacing: f64,
    /// As numbers that cannot overflow.
    counts: DVec3,
}

/// No triangle known yet.
const NONE: u32 = u32::MAX;

/// A sample: its distance [m] and the triangle that is so far.
type Sample = (f32, u32);

impl Plan {
    fn new(bounds: &Aabb, spacing: f64, margin: f64) -> Self {
        let (min, max) = (bounds.min.as_dvec3() - margin, bounds.max.as_dvec3() + margin);
        let cells = ((max - min) / spacing).ceil().max(DVec3::ONE);
        // The lattice is centred, so that a symmetric mesh keeps its symmetry.
        let origin = (min + max) * 0.5 - cells * spacing * 0.5;
        Self { origin, spacing, counts: cells + 1.0 }
    }

    /// Of all that is held at once while sampling.
    fn memory_bytes(&self) -> f64 {
        let bytes = (size_of::<Sample>() + 1 + 2 * size_of::<f32>()) as f64;
        (self.counts + 2.0).element_product() * bytes
    }

    fn dims(&self) -> UVec3 {
        self.counts.as_uvec3()
    }

    fn position(&self, p: UVec3) -> Vec3 {
        (self.origin + p.as_dvec3() * self.spacing).as_vec3()
    }

    fn sample(&self, mesh: &Mesh) -> Lattice<f32> {
        let mut samples = Lattice::filled(self.dims(), (f32::INFINITY, NONE));
        let corners: Vec<[Vec3; 3]> = (0..mesh.triangles().len()).map(|i| mesh.corners(i)).collect();
        self.fill_band(&corners, &mut samples);
        self.sweep(&corners, &mut samples);
        let votes = self.vote(&corners);
        let signed = samples.values().iter().zip(votes.values()).map(|(s, votes)| if *votes > 3 { -s.0 } else { s.0 });
        Lattice::from_values(self.dims(), signed.collect())
    }

    /// Exact distances within [`BAND`] cells of the triangles.
    fn fill_band(&self, corners: &[[Vec3; 3]], samples: &mut Lattice<Sample>) {
        let (dims, band) = (self.dims(), BAND * self.spacing as f32);
        let slice = (dims.x * dims.y) as usize;
        // Slabs of a few layers in parallel: each sees all triangles, in the same order.
        let depth = (dims.z as usize).div_ceil(4 * parallel::thread_count()).max(4);
        parallel::for_each(samples.values_mut().chunks_mut(slice * depth), |slab, values| {
            let z0 = (slab * depth) as u32;
            let z1 = z0 + (values.len() / slice) as u32;
            for (i, triangle) in corners.iter().enumerate() {
                let bounds = Aabb::from_points(*triangle).dilated(band);
                let cell = |p: Vec3| (p.as_dvec3() - self.origin) / self.spacing;
                let low = cell(bounds.min).ceil().max(DVec3::ZERO).as_uvec3();
                let high = (cell(bounds.max).floor() + 1.0).max(DVec3::ZERO).as_uvec3().min(dims);
                let (low, high) = (low.with_z(low.z.max(z0)), high.with_z(high.z.min(z1)));
                if low.cmplt(high).all() {
                    self.fill_box(low, high, *triangle, i as u32, &mut |p, sample| {
                        let place = ((p.z - z0) * dims.y + p.y) as usize * dims.x as usize + p.x as usize;
                        if sample.0 < values[place].0 {
                            values[place] = sample;
                        }
                    });
                }
            }
        });
    }

    /// Gives `store` the distance of all points in `low .. high` that are near the triangle, halving boxes that large
    /// triangles leave mostly empty.
    fn fill_box(&self, low: UVec3, high: UVec3, triangle: [Vec3; 3], i: u32, store: &mut impl FnMut(UVec3, Sample)) {
        let count = high - low;
        let longest = count.max_element();
        if count.element_product() > 512 {
            let (a, b) = (self.position(low), self.position(high - 1));
            let middle = (a + b) * 0.5;
            if closest_point(middle, triangle).distance(middle) > BAND * self.spacing as f32 + middle.distance(b) {
                return;
            }
            let axis = (0..3).find(|&axis| count[axis] == longest).unwrap_or(0);
            let mut cut = high;
            cut[axis] = low[axis] + longest / 2;
            self.fill_box(low, cut, triangle, i, store);
            let mut from = low;
            from[axis] = cut[axis];
            self.fill_box(from, high, triangle, i, store);
            return;
        }
        for z in low.z..high.z {
            for y in low.y..high.y {
                for x in low.x..high.x {
                    let p = self.position(UVec3::new(x, y, z));
                    store(UVec3::new(x, y, z), (closest_point(p, triangle).distance(p), i));
                }
            }
        }
    }

    /// Offers each sample the triangles of its seven neighbours behind it, in each of the eight directions. Once round
    /// leaves two samples in a thousand wrong, by at most a thirtieth of a cell; more rounds mend little, and with the
    /// three neighbours along the axes alone one in five stays wrong.
    fn sweep(&self, corners: &[[Vec3; 3]], samples: &mut Lattice<Sample>) {
        let dims = self.dims();
        let strides = [1, i64::from(dims.x), i64::from(dims.x) * i64::from(dims.y)];
        for direction in 0..8 {
            let is_down = [direction & 1 > 0, direction & 2 > 0, direction & 4 > 0];
            let at = |axis: usize, i: u32| if is_down[axis] { dims[axis] - 1 - i } else { i };
            // Where the neighbour behind is, and how far, for a step along the axes in the bits of its number.
            let behind: [(i64, f32); 8] = std::array::from_fn(|step| {
                let axes = (0..3).filter(|axis| step >> axis & 1 > 0);
                let offset = axes.clone().map(|axis| if is_down[axis] { strides[axis] } else { -strides[axis] }).sum();
                (offset, (axes.count() as f32).sqrt() * self.spacing as f32)
            });
            for (k, j) in (0..dims.z).flat_map(|k| (0..dims.y).map(move |j| (k, j))) {
                // At the border some neighbours are missing.
                let row: Vec<(i64, f32)> = (2..8)
                    .step_by(2)
                    .filter(|s| (s & 2 == 0 || j > 0) && (s & 4 == 0 || k > 0))
                    .map(|s| behind[s])
                    .collect();
                let diagonal: Vec<(i64, f32)> = (1..8)
                    .step_by(2)
                    .filter(|s| (s & 2 == 0 || j > 0) && (s & 4 == 0 || k > 0))
                    .map(|s| behind[s])
                    .collect();
                for i in 0..dims.x {
                    let p = UVec3::new(at(0, i), at(1, j), at(2, k));
                    let here = samples.offset(p);
                    let neighbours = row.iter().chain(if i > 0 { diagonal.as_slice() } else { &[] });
                    self.improve(corners, samples.values_mut(), here, p, neighbours);
                }
            }
        }
    }

    /// Takes the triangle of a neighbour where that is nearer.
    #[inline]
    fn improve<'a>(
        &self,
        corners: &[[Vec3; 3]],
        samples: &mut [Sample],
        here: usize,
        p: UVec3,
        neighbours: impl Iterator<Item = &'a (i64, f32)>,
    ) {
        let mut best = samples[here];
        let before = best.1;
        for (offset, way) in neighbours {
            let (distance, triangle) = samples[here.wrapping_add_signed(*offset as isize)];
            // Its triangle is no nearer to here than it is to there, less the way.
            if triangle == best.1 || triangle == NONE || distance - way >= best.0 {
                continue;
            }
            let at = self.position(p);
            let distance = closest_point(at, corners[triangle as usize]).distance(at);
            if distance < best.0 {
                best = (distance, triangle);
            }
        }
        if best.1 != before {
            samples[here] = best;
        }
    }

    /// For each sample, how many of six walks (three axes, from both ends) find it inside.
    fn vote(&self, corners: &[[Vec3; 3]]) -> Lattice<u8> {
        let dims = self.dims();
        let mut votes = Lattice::filled(dims, 0u8);
        let local: Vec<[DVec3; 3]> =
            corners.iter().map(|t| t.map(|p| (p.as_dvec3() - self.origin) / self.spacing)).collect();
        for axis in 0..3 {
            let windings = crossings(&local, dims, axis);
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for (b, a) in (0..dims[v]).flat_map(|b| (0..dims[u]).map(move |a| (b, a))) {
                let at = |i: u32| {
                    let mut p = UVec3::ZERO;
                    (p[axis], p[u], p[v]) = (i, a, b);
                    p
                };
                let total: i32 = (0..dims[axis]).map(|i| i32::from(windings.at(at(i)))).sum();
                let mut winding = 0;
                for i in 0..dims[axis] {
                    winding += i32::from(windings.at(at(i)));
                    let inside = u8::from(winding != 0) + u8::from(winding != total);
                    let p = at(i);
                    votes.set(p, votes.at(p) + inside);
                }
            }
        }
        votes
    }
}

/// For each sample, by how much the winding number changes between it and the one before it along `axis`.
fn crossings(triangles: &[[DVec3; 3]], dims: UVec3, axis: usize) -> Lattice<i16> {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut windings = Lattice::filled(dims, 0i16);
    for t in triangles {
        let (low, high) = (t[0].min(t[1]).min(t[2]).ceil().max(DVec3::ZERO), t[0].max(t[1]).max(t[2]).floor());
        let reach = |axis: usize| low[axis] as u32..((high[axis] + 1.0).max(0.0) as u32).min(dims[axis]);
        for b in reach(v) {
            for a in reach(u) {
                let flat = t.map(|p| [p[u] - f64::from(a), p[v] - f64::from(b)]);
                let sides = [side(flat[1], flat[2]), side(flat[2], flat[0]), side(flat[0], flat[1])];
                let signs = sides.map(|(sign, _)| sign);
                if signs[0] != signs[1] || signs[1] != signs[2] {
                    continue;
                }
                let total = sides[0].1 + sides[1].1 + sides[2].1;
                if total == 0.0 {
                    continue;
                }
                let at = (sides[0].1 * t[0][axis] + sides[1].1 * t[1][axis] + sides[2].1 * t[2][axis]) / total;
                let first = at.ceil().max(0.0);
                if first < f64::from(dims[axis]) {
                    let mut p = UVec3::ZERO;
                    (p[axis], p[u], p[v]) = (first as u32, a, b);
                    // A triangle that faces against the walk is entered: +1.
                    windings.set(p, windings.at(p).saturating_sub(signs[0]));
                }
            }
        }
    }
    windings
}

/// Which side of the line from `a` to `b` the origin is on, +1 left or −1 right, never on it: ties are broken as if the
/// origin were moved by an infinitesimal that is the same for all triangles (Edelsbrunner and Mücke 1990), so that of
/// two triangles at an edge exactly one is hit. With it twice the area of the triangle they make.
fn side(a: [f64; 2], b: [f64; 2]) -> (i16, f64) {
    // Exactly opposite for the line walked the other way: the same products, subtracted the other way round.
    let double_area = a[0] * b[1] - a[1] * b[0];
    let tie = if double_area != 0.0 {
        double_area
    } else if a[1] != b[1] {
        b[1] - a[1]
    } else {
        a[0] - b[0]
    };
    (if tie > 0.0 { 1 } else { -1 }, double_area)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::mesh::tests::{ball, torus};
    use crate::math::hash::{CounterRng, Seed};
    use crate::math::lanes::{Batch, Kernel, run_kernel};
    use crate::math::real::length;

    const LIMIT: u64 = 1 << 30;

    fn sampled(mesh: &Mesh, cells: f64) -> MeshSdf {
        let longest = f64::from(mesh.bounds().size().max_element());
        MeshSdf::sample(mesh, Some(longest / cells), LIMIT).expect("small enough")
    }

    fn points(count: usize, half: f64) -> impl Iterator<Item = [f64; 3]> {
        let mut rng = CounterRng::new(Seed(4));
        (0..count).map(move |_| std::array::from_fn(|_| (f64::from(rng.uniform()) * 2.0 - 1.0) * half))
    }

    fn torus_distance(p: [f64; 3]) -> f64 {
        (p[0].hypot(p[2]) - 0.6).hypot(p[1]) - 0.25
    }

    #[test]
    fn distances_are_those_of_the_solid_near_and_far() {
        let ball = sampled(&ball(0.5, 90), 48.0);
        let ring = sampled(&torus(0.6, 0.25, 160), 64.0);
        for p in points(4000, 2.0) {
            let (found, exact) = (ball.distance(p), length(p) - 0.5);
            // Near the centre the distance has a ridge that no smooth field follows; beyond 1.5 m ends the lattice.
            if length(p) > 0.1 {
                let is_close = exact < 0.1;
                let allowed = if is_close {
                    1.5e-3
                } else if p.iter().all(|x| x.abs() < 1.5) {
                    8e-3
                } else {
                    0.1
                };
                assert!((found - exact).abs() < allowed, "ball at {p:?}: {found} {exact}");
            }
            let (found, exact) = (ring.distance(p), torus_distance(p));
            if p[0].hypot(p[2]) > 0.15 && (-0.2..1.5).contains(&exact) {
                let allowed = if exact.abs() < 0.1 { 6e-4 } else { 8e-3 };
                assert!((found - exact).abs() < allowed, "torus at {p:?}: {found} {exact}");
            }
        }
    }

    #[test]
    fn the_gradient_belongs_to_the_same_field_and_is_nearly_of_length_one() {
        let ring = sampled(&torus(0.6, 0.25, 160), 64.0);
        let h = 1e-5;
        for p in points(600, 1.3) {
            let found = ring.at(p);
            assert_eq!(found.value, ring.distance(p));
            for axis in 0..3 {
                let moved = |by: f64| {
                    let mut q = p;
                    q[axis] += by;
                    ring.distance(q)
                };
                assert!((found.gradient[axis] - (moved(h) - moved(-h)) / (2.0 * h)).abs() < 1e-6);
            }
            if torus_distance(p).abs() < 0.1 {
                assert!((length(found.gradient) - 1.0).abs() < 0.04, "{}", length(found.gradient));
            }
        }
    }

    #[test]
    fn no_derivative_jumps_anywhere_along_a_way_from_far_to_inside() {
        let ring = sampled(&torus(0.6, 0.25, 96), 40.0);
        let step = 2e-5;
        let at = |i: u32| ring.at([0.6 + 0.03, f64::from(i) * step, 0.02]);
        let mut before = at(0);
        let mut bend_before = None;
        for i in 1..120_000 {
            let now = at(i);
            let bend: [f64; 3] = std::array::from_fn(|k| (now.gradient[k] - before.gradient[k]) / step);
            assert!((now.value - before.value).abs() < 2.0 * step, "{i}");
            assert!(length(bend) < 60.0, "{i}");
            if let Some(bend_before) = bend_before.replace(bend) {
                let jump: [f64; 3] = std::array::from_fn(|k| bend[k] - bend_before[k]);
                assert!(length(jump) < 3000.0 * step, "{i}: {jump:?}");
            }
            before = now;
        }
    }

    #[test]
    fn the_share_of_samples_inside_is_the_volume() {
        for (mesh, cells) in [(ball(0.5, 40), 40.0), (torus(0.6, 0.25, 60), 50.0)] {
            let sdf = sampled(&mesh, cells);
            let voxel = (f64::from(mesh.bounds().size().max_element()) / cells).powi(3);
            let volume = sdf.inside_samples() as f64 * voxel;
            assert!((volume / mesh.signed_volume() - 1.0).abs() < 0.02, "{volume} {}", mesh.signed_volume());
        }
    }

    #[test]
    fn holes_do_not_turn_the_inside_out() {
        let whole = ball(0.5, 40);
        let open = |skip: usize| {
            let triangles = whole.triangles().iter().enumerate().filter(|(i, _)| i % skip != 0).map(|(_, t)| *t);
            Mesh::try_new(whole.positions().to_vec(), Vec::new(), triangles.collect()).expect("valid")
        };
        let holes = open(50);
        assert!(!holes.report().is_closed());
        let (closed, holed) = (sampled(&whole, 32.0), sampled(&holes, 32.0));
        let wrong = closed.inside_samples().abs_diff(holed.inside_samples());
        assert!(wrong * 200 < closed.inside_samples(), "{wrong} of {}", closed.inside_samples());
    }

    struct LaneByLane<'a>(&'a MeshSdf);

    impl Kernel for LaneByLane<'_> {
        type Output = ();
        #[inline(always)]
        fn run<L: Batch>(self, zero: L) {
            let all: Vec<[f32; 3]> = points(1600, 3.0).map(|p| p.map(|x| x as f32)).collect();
            for group in all.chunks(L::WIDTH) {
                let axis = |a: usize| group.iter().map(|p| p[a]).collect::<Vec<_>>();
                let p = triple!(a => zero.load(&axis(a)));
                let (found, distance) = (self.0.at(p), self.0.distance(p));
                for (i, p) in group.iter().enumerate() {
                    // Whatever its neighbours are, a lane comes out to the bit as among copies of itself.
                    let alone = self.0.at(triple!(a => zero.lit(f64::from(p[a]))));
                    let exact = self.0.at(p.map(f64::from));
                    assert_eq!(found.value.lane(i), alone.value.lane(0));
                    assert_eq!(found.value.lane(i), distance.lane(i));
                    assert_eq!(exact.value, self.0.distance(p.map(f64::from)));
                    assert!((found.value.lane(i) - exact.value).abs() < 2e-6, "{p:?}");
                    for a in 0..3 {
                        assert_eq!(found.gradient[a].lane(i), alone.gradient[a].lane(0));
                        assert!((found.gradient[a].lane(i) - exact.gradient[a]).abs() < 1e-4, "{p:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn lanes_give_what_scalars_give_whatever_their_neighbours() {
        run_kernel(LaneByLane(&sampled(&torus(0.6, 0.25, 48), 24.0)));
    }

    #[test]
    fn what_needs_too_much_memory_is_refused_before_it_is_allocated() {
        for spacing in [1e-4, 1e-30, 5e-324] {
            let error = MeshSdf::sample(&ball(0.5, 8), Some(spacing), LIMIT).expect_err("too fine");
            assert!(matches!(error, MeshSdfError::Memory { .. }), "{error}");
        }
        assert!(MeshSdf::sample(&ball(0.5, 8), Some(1e9), LIMIT).is_ok());
    }
}
