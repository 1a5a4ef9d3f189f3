//! Signed distances of all kinds of solids, and where they stand in the world.

use crate::geometry::mesh_sdf::MeshSdf;
use crate::geometry::primitive::Primitive;
use crate::geometry::smooth_union::{deepest, smooth_union};
use crate::math::aabb::Aabb;
use crate::math::dual::Dual;
use crate::math::jet::{Jet, Scalar};
use crate::math::real::{Lane, Real, dot, triple};
use crate::math::space::{Similarity, WorldPoint};
use glam::{DMat3, Vec3};
use std::sync::Arc;

/// The signed distance of a solid in its own space.
#[derive(Debug, Clone)]
pub enum Sdf {
    /// By a formula, exact.
    Primitive(Primitive),
    /// Of solids with formulas, blended into one.
    SmoothUnion(Arc<SmoothUnion>),
    /// Of a mesh, sampled and interpolated.
    Mesh(Arc<MeshSdf>),
}

impl Sdf {
    /// Signed distance [m], negative inside.
    #[inline(always)]
    pub fn distance<L: Lane>(&self, p: [L; 3]) -> L {
        match self {
            Self::Primitive(primitive) => primitive.distance(p),
            Self::SmoothUnion(union) => union.distance(p),
            Self::Mesh(mesh) => mesh.distance(p),
        }
    }

    /// A box that holds the solid, or `None` where it has no end.
    pub fn bounds(&self) -> Option<Aabb> {
        match self {
            Self::Primitive(primitive) => primitive.bounds(),
            Self::SmoothUnion(union) => Some(union.bounds),
            Self::Mesh(mesh) => Some(mesh.bounds()),
        }
    }
}

/// Solids with formulas, blended one after the other where they meet: a solid without creases. Its distance is never
/// larger than the true one, and smaller beside the blend and inside it, where its gradient is shorter than 1.
#[derive(Debug, Clone)]
pub struct SmoothUnion {
    /// Placed in the union's own space; at least one.
    parts: Vec<PlacedSdf>,
    width: f64,
    bounds: Aabb,
}

impl SmoothUnion {
    /// The union of `parts`, each placed in the union's own space, blended where their distances differ by less than
    /// `width` [m], > 0.
    ///
    /// # Panics
    /// Without a part, and where one has no end.
    pub fn new(parts: impl IntoIterator<Item = (Primitive, Similarity)>, width: f64) -> Self {
        let parts = parts.into_iter().map(|(solid, at)| PlacedSdf::new(Sdf::Primitive(solid), at));
        let parts: Vec<_> = parts.collect();
        let boxes = parts.iter().map(|part| part.bounds().expect("parts of a union have an end"));
        let bounds = boxes.reduce(|a, b| a.union(&b)).expect("a union has parts");
        // The blend bulges out of all parts.
        let bulge = (deepest(parts.len(), width) as f32).next_up();
        Self { bounds: bounds.dilated(bulge), parts, width }
    }

    /// What it is made of.
    pub fn parts(&self) -> &[PlacedSdf] {
        &self.parts
    }

    /// Below this difference of their distances parts are blended [m].
    pub fn width(&self) -> f64 {
        self.width
    }

    // Three loops instead of one over a closure, which would not be certain to be inlined. Each part's distance is a
    // function that is compiled for plain solids anyhow.

    #[inline(always)]
    fn distance<L: Lane>(&self, p: [L; 3]) -> L {
        let mut all = self.parts[0].distance(p);
        for part in &self.parts[1..] {
            all = smooth_union(all, part.distance(p), self.width);
        }
        all
    }

    #[inline(always)]
    fn slope<L: Lane>(&self, p: [L; 3]) -> Scalar<L> {
        let dual = |found: Scalar<L>| Dual { value: found.value, gradient: found.gradient };
        let mut all = dual(self.parts[0].slope(p));
        for part in &self.parts[1..] {
            all = smooth_union(all, dual(part.slope(p)), self.width);
        }
        Scalar { value: all.value, gradient: all.gradient }
    }

    #[inline(always)]
    fn jet<L: Lane>(&self, p: [L; 3]) -> Jet<L> {
        let mut all = self.parts[0].formula_jet(p);
        for part in &self.parts[1..] {
            all = smooth_union(all, part.formula_jet(p), self.width);
        }
        all
    }
}

/// A solid placed in the world. Distances and derivatives are those of world space.
#[derive(Debug, Clone)]
pub struct PlacedSdf {
    sdf: Sdf,
    placement: Similarity,
    /// Columns are the own space's axes in the world; `f64` so that the scalar truth is no coarser than its lanes.
    rotation: DMat3,
    /// Most shapes are not turned, and turning a Hessian costs more than most distances.
    is_turned: bool,
    bounds: Option<Aabb>,
}

impl PlacedSdf {
    /// The solid `sdf`, scaled, turned and moved by `placement`.
    pub fn new(sdf: Sdf, placement: Similarity) -> Self {
        let rotation = DMat3::from_quat(placement.rotation.as_dquat().normalize());
        let bounds = sdf.bounds().map(|b| {
            let corners = (0..8).map(|i| Vec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), b.max, b.min));
            let loose = Aabb::from_points(corners.map(|c| placement.point_to_world(c).0));
            // The corners are rounded; a box may be larger than it must.
            loose.dilated(loose.size().max_element().max(loose.max.abs().max_element()) * 1e-6)
        });
        Self { sdf, placement, rotation, is_turned: rotation != DMat3::IDENTITY, bounds }
    }

    /// The solid in its own space.
    pub fn sdf(&self) -> &Sdf {
        &self.sdf
    }

    /// Where it stands.
    pub fn placement(&self) -> &Similarity {
        &self.placement
    }

    /// A world-space box that holds the solid, or `None` where it has no end.
    pub fn bounds(&self) -> Option<Aabb> {
        self.bounds
    }

    /// Middle of the bounds; of a half space, the point of its plane that it is given by.
    pub fn center(&self) -> WorldPoint {
        match (&self.sdf, self.bounds) {
            (_, Some(bounds)) => WorldPoint(bounds.center()),
            (Sdf::Primitive(Primitive::HalfSpace(h)), None) => self.placement.point_to_world(h.point.as_vec3()),
            (_, None) => WorldPoint(self.placement.translation),
        }
    }

    /// Half the longest edge of the bounds [m]; infinite for an endless solid.
    pub fn bounding_radius(&self) -> f32 {
        self.bounds.map_or(f32::INFINITY, |b| 0.5 * b.size().max_element())
    }

    /// Signed distance [m] of a world-space point, negative inside.
    #[inline(never)]
    pub fn distance<L: Lane>(&self, p: [L; 3]) -> L {
        p[0].outlined(
            #[inline(always)]
            || self.distance_here(p),
        )
    }

    #[inline(always)]
    fn distance_here<L: Lane>(&self, p: [L; 3]) -> L {
        let scale = p[0].lit(f64::from(self.placement.scale));
        self.sdf.distance(self.to_local(p)) * scale
    }

    /// Signed distance [m] of a world-space point with its gradient: outward, of length 1 for primitives, at most 1 for
    /// unions.
    #[inline(never)]
    pub fn at<L: Lane>(&self, p: [L; 3]) -> Scalar<L> {
        p[0].outlined(
            #[inline(always)]
            || self.at_here(p),
        )
    }

    #[inline(always)]
    fn at_here<L: Lane>(&self, p: [L; 3]) -> Scalar<L> {
        let mesh = match &self.sdf {
            // The Hessian comes along for nothing; walls ask for it next, most often.
            Sdf::Primitive(_) => return self.formula_jet(p).scalar(),
            Sdf::SmoothUnion(_) => return self.slope(p),
            Sdf::Mesh(mesh) => mesh,
        };
        self.to_world(mesh.at(self.to_local(p)))
    }

    /// As [`PlacedSdf::at`], without a Hessian on the way.
    #[inline(never)]
    pub fn slope<L: Lane>(&self, p: [L; 3]) -> Scalar<L> {
        p[0].outlined(
            #[inline(always)]
            || self.slope_here(p),
        )
    }

    #[inline(always)]
    fn slope_here<L: Lane>(&self, p: [L; 3]) -> Scalar<L> {
        match &self.sdf {
            Sdf::Primitive(primitive) => {
                let local = primitive.distance(Dual::point(self.to_local(p)));
                self.to_world(Scalar { value: local.value, gradient: local.gradient })
            }
            Sdf::SmoothUnion(union) => self.to_world(union.slope(self.to_local(p))),
            Sdf::Mesh(_) => self.at(p),
        }
    }

    /// A distance and its gradient in the solid's own space, as they are in the world.
    #[inline(always)]
    fn to_world<L: Lane>(&self, local: Scalar<L>) -> Scalar<L> {
        let value = local.value * local.value.lit(f64::from(self.placement.scale));
        if !self.is_turned {
            return Scalar { value, gradient: local.gradient };
        }
        let rows: [[L; 3]; 3] = triple!(i => triple!(j => value.lit(self.rotation.col(j)[i])));
        Scalar { value, gradient: triple!(i => dot(rows[i], local.gradient)) }
    }

    /// As [`PlacedSdf::at`] with the Hessian [1/m]; `None` for a sampled distance, whose curvature is not the solid's.
    #[inline(always)]
    pub fn jet<L: Lane>(&self, p: [L; 3]) -> Option<Jet<L>> {
        (!matches!(self.sdf, Sdf::Mesh(_))).then(|| self.formula_jet(p))
    }

    #[inline(never)]
    fn formula_jet<L: Lane>(&self, p: [L; 3]) -> Jet<L> {
        p[0].outlined(
            #[inline(always)]
            || self.formula_jet_here(p),
        )
    }

    #[inline(always)]
    fn formula_jet_here<L: Lane>(&self, p: [L; 3]) -> Jet<L> {
        let local = match &self.sdf {
            Sdf::Primitive(primitive) => primitive.distance(Jet::point(self.to_local(p))),
            Sdf::SmoothUnion(union) => union.jet(self.to_local(p)),
            Sdf::Mesh(_) => return Jet::constant(p[0].lit(f64::NAN)),
        };
        let scale = p[0].lit(f64::from(self.placement.scale));
        let inverse = p[0].lit(1.0 / f64::from(self.placement.scale));
        let (value, g) = (local.value * scale, local.gradient);
        let [xx, yy, zz, xy, xz, yz] = local.hessian;
        let h = [xx * inverse, yy * inverse, zz * inverse, xy * inverse, xz * inverse, yz * inverse];
        if !self.is_turned {
            return Jet { value, gradient: g, hessian: h };
        }
        let rows: [[L; 3]; 3] = triple!(i => triple!(j => p[0].lit(self.rotation.col(j)[i])));
        // R H Rᵀ, row by row.
        let second = [[h[0], h[3], h[4]], [h[3], h[1], h[5]], [h[4], h[5], h[2]]];
        let half: [[L; 3]; 3] = triple!(i => triple!(j => dot(rows[i], second[j])));
        let gradient = triple!(i => dot(rows[i], g));
        Jet {
            value,
            gradient,
            hessian: [
                dot(half[0], rows[0]),
                dot(half[1], rows[1]),
                dot(half[2], rows[2]),
                dot(half[0], rows[1]),
                dot(half[0], rows[2]),
                dot(half[1], rows[2]),
            ],
        }
    }

    /// A world-space point in the solid's own space.
    #[inline(always)]
    pub fn to_local<R: Real>(&self, p: [R; 3]) -> [R; 3] {
        let t = self.placement.translation.as_dvec3().to_array();
        let inverse = p[0].lit(1.0 / f64::from(self.placement.scale));
        let v: [R; 3] = triple!(i => (p[i] - p[i].lit(t[i])) * inverse);
        if !self.is_turned {
            return v;
        }
        triple!(i => {
            let axis = self.rotation.col(i);
            dot(v, triple!(j => v[j].lit(axis[j])))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitive::{Cuboid, Sphere, Torus};
    use crate::math::real::length;
    use glam::{DVec3, Quat};

    fn placed() -> Vec<PlacedSdf> {
        let torus = Torus { center: DVec3::ZERO, axis: DVec3::Y, major_radius: 0.5, minor_radius: 0.2 };
        let cuboid = Cuboid { center: DVec3::X * 0.1, half_size: DVec3::new(0.4, 0.3, 0.6), rounding: 0.1 };
        let placement = Similarity {
            scale: 1.7,
            rotation: Quat::from_axis_angle(Vec3::new(1.0, 2.0, -0.5).normalize(), 0.9),
            translation: Vec3::new(0.3, -0.2, 0.6),
        };
        [Primitive::Torus(torus), Primitive::Cuboid(cuboid)]
            .into_iter()
            .flat_map(|p| [placement, Similarity::IDENTITY].map(|at| PlacedSdf::new(Sdf::Primitive(p), at)))
            .collect()
    }

    #[test]
    fn jets_in_the_world_equal_central_differences_in_the_world() {
        let h = 1e-5;
        for sdf in placed() {
            for i in 1..300 {
                let a = f64::from(i);
                let p = [(a * 0.71).sin() * 1.5, (a * 1.37).cos() * 1.2, (a * 2.11).sin() * 1.4];
                let jet = sdf.jet(p).expect("a primitive");
                assert_eq!(jet.value, sdf.distance(p));
                assert_eq!(jet.scalar(), sdf.at(p));
                assert!((length(jet.gradient) - 1.0).abs() < 1e-9);
                for axis in 0..3 {
                    let moved = |by: f64| {
                        let mut q = p;
                        q[axis] += by;
                        sdf.jet(q).expect("a primitive")
                    };
                    let (up, down) = (moved(h), moved(-h));
                    if (0..6).any(|k| (up.hessian[k] - down.hessian[k]).abs() > 0.01) {
                        continue;
                    }
                    assert!((jet.gradient[axis] - (up.value - down.value) / (2.0 * h)).abs() < 1e-7);
                    for j in 0..3 {
                        let second = (up.gradient[j] - down.gradient[j]) / (2.0 * h);
                        assert!((jet.second(j, axis) - second).abs() < 1e-5, "{p:?} {j}{axis}");
                    }
                }
            }
        }
    }

    #[test]
    fn single_precision_agrees_with_double() {
        for sdf in placed() {
            for i in 0..200 {
                let a = f64::from(i);
                let p = [(a * 0.71).sin() * 1.5, (a * 1.37).cos() * 1.2, (a * 2.11).sin() * 1.4];
                let (exact, single) = (sdf.distance(p), sdf.distance(p.map(|x| x as f32)));
                assert!((exact - f64::from(single)).abs() < 2e-6);
            }
        }
    }

    /// A ball, a ring and a ball, one after the other blended; turned, moved and scaled.
    fn melted() -> PlacedSdf {
        let ball = |x: f64| Primitive::Sphere(Sphere { center: DVec3::X * x, radius: 0.35 });
        let ring = Torus { center: DVec3::Y * 0.2, axis: DVec3::X, major_radius: 0.5, minor_radius: 0.15 };
        let parts = [ball(-0.3), Primitive::Torus(ring), ball(0.4)].map(|part| (part, Similarity::IDENTITY));
        PlacedSdf::new(Sdf::SmoothUnion(Arc::new(SmoothUnion::new(parts, 0.25))), *placed()[0].placement())
    }

    #[test]
    fn a_smooth_union_has_two_continuous_derivatives_where_its_parts_have() {
        let (union, h) = (melted(), 1e-5);
        let (mut fastest, mut blended) = (0.0f64, 0);
        for i in 0..4000 {
            let a = f64::from(i);
            let p = [(a * 0.71).sin() * 1.5, (a * 1.37).cos() * 1.2, (a * 2.11).sin() * 1.4];
            let jet = union.jet(p).expect("a formula");
            assert!((jet.value - union.distance(p)).abs() < 1e-12);
            let slope = union.slope(p);
            assert!((0..3).all(|i| (jet.gradient[i] - slope.gradient[i]).abs() < 1e-12));
            // Beside middles and the axis of the ring, where parts have no derivatives themselves.
            if jet.value < -0.2 || jet.hessian.iter().any(|x| x.abs() > 30.0) {
                continue;
            }
            blended += usize::from(length(jet.gradient) < 0.999);
            for axis in 0..3 {
                let moved = |by: f64| {
                    let mut q = p;
                    q[axis] += by;
                    union.jet(q).expect("a formula")
                };
                let (up, down) = (moved(h), moved(-h));
                assert!((jet.gradient[axis] - (up.value - down.value) / (2.0 * h)).abs() < 1e-7);
                for k in 0..6 {
                    fastest = fastest.max((up.hessian[k] - down.hessian[k]).abs() / (2.0 * h));
                }
            }
        }
        println!("{blended} points in the blend, third derivatives at most {fastest:.0} 1/m²");
        assert!(blended > 500 && fastest < 2000.0, "{blended} {fastest}");
    }

    #[test]
    fn a_smooth_union_is_no_steeper_than_its_parts_and_its_bulge_is_in_its_bounds() {
        let union = melted();
        let bounds = union.bounds().expect("finite");
        let (mut bulging, mut last) = (0, [0.0; 3]);
        for i in 0..20_000 {
            let a = f64::from(i);
            let p = [(a * 0.71).sin() * 1.5, (a * 1.37).cos() * 1.2, (a * 2.11).sin() * 1.4];
            let (d, apart) = (union.distance(p), length([0, 1, 2].map(|i| p[i] - last[i])));
            assert!((d - union.distance(last)).abs() <= apart + 1e-12);
            last = p;
            assert!(d > 0.0 || bounds.contains(Vec3::from_array(p.map(|x| x as f32))));
            let Sdf::SmoothUnion(of) = union.sdf() else { unreachable!() };
            let local = union.to_local(p);
            let least = of.parts().iter().map(|part| part.distance(local)).fold(f64::INFINITY, f64::min);
            bulging += usize::from(d < 0.0 && least > 0.0);
            assert!((d - f64::from(union.distance(p.map(|x| x as f32)))).abs() < 3e-6);
        }
        assert!(bulging > 20, "{bulging} points in the bulge alone");
    }

    #[test]
    fn bounds_in_the_world_hold_the_solid() {
        for sdf in placed() {
            let bounds = sdf.bounds().expect("finite");
            for i in 0..5000 {
                let a = i as f32;
                let p = Vec3::new((a * 0.71).sin() * 2.0, (a * 1.37).cos() * 2.0, (a * 2.11).sin() * 2.0);
                assert!(sdf.distance(p.to_array()) > 0.0 || bounds.contains(p));
            }
        }
    }
}
