//! The signed distance of a mesh, sampled on two nested lattices and interpolated by splines.
//!
//! The inner lattice holds the mesh closely; the outer one, four times as coarse, reaches a longest edge further, for
//! flows that feel a body from afar. Between them the distance passes smoothly from one to the other. How samples come about
//! is in `mesh_samples.rs`.

use crate::geometry::mesh::Mesh;
use crate::geometry::mesh_samples::Plan;
use crate::geometry::primitive::Cuboid;
use crate::geometry::spline::Spline;
use crate::math::aabb::Aabb;
use crate::math::jet::{Jet, Scalar};
use crate::math::parallel;
use crate::math::real::{Lane, Real, triple};

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
    fn samples_do_not_depend_on_threads() {
        // Of triangles smaller than a cell, as large as some, and larger than whole slabs.
        for (mesh, cells) in [(ball(0.5, 90), 40.0), (torus(0.6, 0.25, 24), 96.0), (ball(0.5, 6), 96.0)] {
            let plan = Plan::new(&mesh.bounds(), f64::from(mesh.bounds().size().max_element()) / cells, 0.1);
            let on = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                pool.install(|| plan.sample(&mesh)).values().iter().map(|d| d.to_bits()).collect::<Vec<_>>()
            };
            let one = on(1);
            for threads in [2, 3, 16] {
                let differ = one.iter().zip(on(threads)).filter(|(a, b)| **a != *b).count();
                assert_eq!(differ, 0, "of {} on {threads} threads", one.len());
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
