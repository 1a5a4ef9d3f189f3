//! Solids that the flow goes round: which of them act as one, where each takes its constant, how far it reaches.
//!
//! Every obstacle has a constant of its own for each potential, the potential's value at its reference point, so that
//! wind passes between obstacles (the idea of Ding and Batty 2023, *Differentiable Curl-Noise*, carried to three
//! dimensions). The reference point is the obstacle's middle, drawn towards the gaps to its neighbours: the difference
//! of two obstacles' constants is the flow through their gap, which so stays near the free stream's and does not jet.
//!
//! Obstacles that touch, overlap or leave a gap below [`SLIT`] are one: their distances are joined by Rvachev's
//! conjunction, which has the same walls and no ridge between them, equation 3 takes the place of equation 5 (the joint
//! normal is not smooth where they meet), and the flow between them dies down.

use crate::flow::ramp::{UnitNormal, smooth_min, unit_normal};
use crate::geometry::motion::{Motion, RigidSpan};
use crate::geometry::primitive::{HalfSpace, Primitive};
use crate::geometry::sdf::{PlacedSdf, Sdf};
use crate::math::aabb::Aabb;
use crate::math::jet::Scalar;
use crate::math::real::{Lane, dot, triple};
use glam::DVec3;
use std::sync::Arc;

/// Gaps below this share of the smaller neighbour's size are closed.
const SLIT: f64 = 0.05;
/// The influence of an obstacle without size, such as the ground, where the settings leave it open [m].
const ENDLESS_INFLUENCE: f64 = 1.0;
/// A box whose rounding is below this share of its shortest half edge has sharp edges: near them its normal turns so
/// fast that equation 5 would make a spike, and equation 3 is used.
const SHARP_ROUNDING: f64 = 0.5;
/// Share of the way to an obstacle's own ridge at which its influence must have ended.
const REACH_USED: f64 = 0.8;

/// What the flow does at a wall.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Boundary {
    /// It slides along.
    #[default]
    Slip,
    /// It moves with the wall.
    NoSlip,
}

/// A solid that the flow must not pass.
#[derive(Debug, Clone)]
pub struct Wall {
    /// Its distance, where it rests.
    pub sdf: Arc<PlacedSdf>,
    /// How it moves; at rest where `None`.
    pub motion: Option<Arc<Motion>>,
    /// What the flow does at it.
    pub boundary: Boundary,
    /// Whether the flow is inside.
    pub is_container: bool,
}

impl From<Arc<PlacedSdf>> for Wall {
    fn from(sdf: Arc<PlacedSdf>) -> Self {
        Self { sdf, motion: None, boundary: Boundary::Slip, is_container: false }
    }
}

/// One or several solids that act as one wall.
#[derive(Debug, Clone)]
pub struct Obstacle {
    solids: Vec<Arc<PlacedSdf>>,
    motion: Option<Arc<Motion>>,
    boundary: Boundary,
    is_container: bool,
    reference: DVec3,
    size: f64,
    reach: f64,
    /// Whether equation 5 applies; equation 3 otherwise.
    has_smooth_normal: bool,
    plane_normal: Option<DVec3>,
    hole: Option<Hole>,
    /// Middle and half size of a box around, in every pose; `None` where there is no end.
    bounds: Option<(DVec3, DVec3)>,
}

/// A hole through which an obstacle lets the flow pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hole {
    /// Middle [m].
    pub center: DVec3,
    /// Direction through, length 1.
    pub axis: DVec3,
    /// Of the circle whose flux passes through the hole [m].
    pub radius: f64,
}

impl Obstacle {
    fn new(walls: &[&Wall]) -> Self {
        let solids: Vec<Arc<PlacedSdf>> = walls.iter().map(|wall| wall.sdf.clone()).collect();
        let first = walls[0];
        let bounded: Vec<_> = solids.iter().filter(|s| s.bounds().is_some()).collect();
        let is_endless = bounded.len() < solids.len();
        let middle = |s: &PlacedSdf| s.center().0.as_dvec3();
        let bounds = bounded.iter().filter_map(|s| s.bounds()).reduce(|a, b| a.union(&b));
        let reference = bounds.map_or_else(|| middle(&solids[0]), |b| b.center().as_dvec3());
        let is_plain = solids.len() == 1 && first.motion.is_none() && !first.is_container;
        let half_size = |b: &Aabb| {
            let half = 0.5 * b.size().as_dvec3();
            // Whichever way it turns.
            if first.motion.is_some() { DVec3::splat(half.length()) } else { half }
        };
        Self {
            reference,
            size: bounds.map_or(ENDLESS_INFLUENCE, |b| 0.5 * f64::from(b.size().max_element())),
            reach: solids.iter().map(|s| reach(s, first.is_container)).fold(f64::INFINITY, f64::min),
            has_smooth_normal: solids.len() == 1 && has_smooth_normal(&solids[0]),
            plane_normal: if is_plain { plane_normal(&solids[0]) } else { None },
            hole: if is_plain { hole(&solids[0]) } else { None },
            bounds: bounds.filter(|_| !is_endless).map(|b| (b.center().as_dvec3(), half_size(&b))),
            motion: first.motion.clone(),
            boundary: first.boundary,
            is_container: first.is_container,
            solids: if first.is_container { solids.iter().flat_map(container_walls).collect() } else { solids },
        }
    }

    /// Where the obstacle's constants are taken.
    pub fn reference(&self) -> DVec3 {
        self.reference
    }

    /// Half the longest edge of its box [m]; of endless ones the influence they have by default.
    pub fn size(&self) -> f64 {
        self.size
    }

    /// True where the obstacle has no end.
    pub fn is_endless(&self) -> bool {
        self.bounds.is_none()
    }

    /// The influence radius that comes of a wanted one [m]: it ends before the obstacle's own ridge.
    pub fn influence(&self, wanted: f64) -> f64 {
        wanted.min(REACH_USED * self.reach)
    }

    /// The direction out of a half space that stands alone.
    pub fn plane_normal(&self) -> Option<DVec3> {
        self.plane_normal
    }

    /// The hole of a ring that stands alone.
    pub fn hole(&self) -> Option<Hole> {
        self.hole
    }

    /// What the flow does at its wall.
    pub fn boundary(&self) -> Boundary {
        self.boundary
    }

    /// Its motion over a span of time [s]; `None` where it is at rest.
    pub fn span(&self, start: f64, duration: f64) -> Option<RigidSpan> {
        self.motion.as_ref().map(|motion| motion.span(self.reference, start, duration))
    }

    /// The solids that act as one, where they rest.
    pub fn solids(&self) -> &[Arc<PlacedSdf>] {
        &self.solids
    }

    /// False when every lane is certainly further away than `margin` [m]. `motion` and `phase` say where it is.
    #[inline(always)]
    pub fn may_be_within<L: Lane>(&self, motion: Option<&RigidSpan>, p: [L; 3], phase: L, margin: f64) -> bool {
        let Some((middle, half)) = self.bounds.filter(|_| !self.is_container) else { return true };
        let middle = match motion {
            Some(motion) => motion.center(phase),
            None => triple!(i => p[i].lit(middle[i])),
        };
        let outside: [L; 3] = triple!(i => (p[i] - middle[i]).abs() - p[i].lit(half[i]));
        outside[0].max(outside[1]).max(outside[2]).any_lt(p[0].lit(margin))
    }

    /// Signed distance [m], negative where the flow must not be.
    #[inline(always)]
    pub fn distance<L: Lane>(&self, motion: Option<&RigidSpan>, p: [L; 3], phase: L) -> L {
        let p = match motion {
            Some(motion) => motion.to_rest(p, phase).0,
            None => p,
        };
        let mut least = p[0].lit(f64::INFINITY);
        for solid in &self.solids {
            let own = solid.distance(p);
            least = least.min(if self.is_inverted() { -own } else { own });
        }
        least
    }

    /// Gradient of the distance to the closest of the solids.
    pub fn gradient(&self, motion: Option<&RigidSpan>, p: [f64; 3], phase: f64) -> DVec3 {
        let (rest, m) = motion.map_or((p, triple!(i => DVec3::AXES[i].to_array())), |motion| motion.to_rest(p, phase));
        let sign = if self.is_inverted() { -1.0 } else { 1.0 };
        let all = self.solids.iter().map(|solid| at_f64(solid, DVec3::from_array(rest)));
        let closest = all.min_by(|a, b| (sign * a.value).total_cmp(&(sign * b.value)));
        let own = closest.map_or([0.0; 3], |d| d.gradient);
        DVec3::from_array(triple!(i => sign * dot(m[i], own)))
    }

    /// Containers other than boxes, which are made of planes that face inwards.
    fn is_inverted(&self) -> bool {
        self.is_container && self.solids.len() == 1
    }

    /// Signed distance [m] with its gradient, and the normal with its derivatives where equation 5 applies.
    #[inline(always)]
    pub fn wall<L: Lane>(&self, motion: Option<&RigidSpan>, p: [L; 3], phase: L) -> (Scalar<L>, Option<UnitNormal<L>>) {
        let (rest, m) = match motion {
            Some(motion) => motion.to_rest(p, phase),
            None => (p, [p; 3]),
        };
        let (distance, normal) = self.wall_at_rest(rest);
        if motion.is_none() {
            return (distance, normal);
        }
        let turned = |v: [L; 3]| -> [L; 3] { triple!(i => dot(m[i], v)) };
        let normal = normal.map(|(n, d)| {
            // Mᵀ on the right: how the normal changes along the axes of the world.
            let along: [[L; 3]; 3] = triple!(c => triple!(i => dot(d[c], m[i])));
            let columns: [[L; 3]; 3] = triple!(i => turned([along[0][i], along[1][i], along[2][i]]));
            (turned(n), triple!(c => triple!(i => columns[i][c])))
        });
        (Scalar { value: distance.value, gradient: turned(distance.gradient) }, normal)
    }

    #[inline(always)]
    fn wall_at_rest<L: Lane>(&self, p: [L; 3]) -> (Scalar<L>, Option<UnitNormal<L>>) {
        if self.has_smooth_normal
            && let Some(jet) = self.solids[0].jet(p)
        {
            let jet = if self.is_inverted() { -jet } else { jet };
            return (jet.scalar(), Some(unit_normal(&jet)));
        }
        let mut joint: Option<Scalar<L>> = None;
        for solid in &self.solids {
            let mut own = solid.at(p);
            if self.is_inverted() {
                own = Scalar { value: -own.value, gradient: triple!(i => -own.gradient[i]) };
            }
            joint = Some(match joint {
                None => own,
                Some(a) => {
                    let (value, da, db) = smooth_min(a.value, own.value);
                    Scalar { value, gradient: triple!(i => da.mul_add(a.gradient[i], db * own.gradient[i])) }
                }
            });
        }
        (joint.expect("an obstacle has a solid"), None)
    }
}

/// What a container is made of: a box of six half spaces, whose distances join smoothly where the box's own has a ridge
/// from each edge inwards; anything else of itself.
fn container_walls(solid: &Arc<PlacedSdf>) -> Vec<Arc<PlacedSdf>> {
    let Sdf::Primitive(Primitive::Cuboid(cuboid)) = solid.sdf() else { return vec![solid.clone()] };
    let faces = DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
    faces
        .map(|out| {
            let plane = HalfSpace { point: cuboid.center + out * cuboid.half_size, normal: -out };
            Arc::new(PlacedSdf::new(Sdf::Primitive(Primitive::HalfSpace(plane)), *solid.placement()))
        })
        .collect()
}

/// Distance from the wall at which the solid's outer distance has a ridge of its own [m].
fn reach(solid: &PlacedSdf, is_container: bool) -> f64 {
    let scale = f64::from(solid.placement().scale);
    match (solid.sdf(), is_container) {
        (Sdf::Primitive(Primitive::Torus(t)), false) => scale * (t.major_radius - t.minor_radius).max(1e-6),
        (Sdf::Primitive(Primitive::Torus(t)), true) => scale * t.minor_radius,
        (Sdf::Primitive(Primitive::Sphere(s)), true) => scale * s.radius,
        (Sdf::Primitive(Primitive::Capsule(c)), true) => scale * c.radius,
        (Sdf::Primitive(Primitive::Cuboid(c)), true) => scale * c.half_size.min_element(),
        _ => f64::INFINITY,
    }
}

fn has_smooth_normal(solid: &PlacedSdf) -> bool {
    match solid.sdf() {
        Sdf::Primitive(Primitive::Cuboid(c)) => c.rounding >= SHARP_ROUNDING * c.half_size.min_element(),
        Sdf::Primitive(_) => true,
        // A sampled distance turns within a sample's width at edges and creases.
        Sdf::Mesh(_) => false,
    }
}

fn plane_normal(solid: &PlacedSdf) -> Option<DVec3> {
    match solid.sdf() {
        Sdf::Primitive(Primitive::HalfSpace(h)) => Some((solid.placement().rotation.as_dquat() * h.normal).normalize()),
        _ => None,
    }
}

fn hole(solid: &PlacedSdf) -> Option<Hole> {
    match solid.sdf() {
        Sdf::Primitive(Primitive::Torus(t)) => Some(Hole {
            center: solid.center().0.as_dvec3(),
            axis: (solid.placement().rotation.as_dquat() * t.axis).normalize(),
            radius: f64::from(solid.placement().scale) * (t.major_radius - 0.5 * t.minor_radius),
        }),
        _ => None,
    }
}

/// The gap between two solids [m] (0 where they touch or overlap), and the closest points of both.
///
/// By projecting back and forth from many starts: exact for convex solids, an upper bound for others.
fn gap(a: &PlacedSdf, b: &PlacedSdf) -> (f64, DVec3, DVec3) {
    let mut best = (f64::INFINITY, a.center().0.as_dvec3(), b.center().0.as_dvec3());
    for start in starts(a).chain(starts(b)) {
        let (mut on_a, mut on_b) = (start, start);
        for _ in 0..24 {
            on_b = project(b, on_a);
            on_a = project(a, on_b);
        }
        let overlaps = |p: DVec3| [a, b].into_iter().all(|solid| at_f64(solid, p).value <= 0.0);
        let distance = if overlaps(start) || overlaps(on_a) || overlaps(on_b) { 0.0 } else { (on_a - on_b).length() };
        if distance < best.0 {
            best = (distance, on_a, on_b);
        }
    }
    best
}

/// The middle of a solid's box, and its corners.
fn starts(solid: &PlacedSdf) -> impl Iterator<Item = DVec3> {
    let bounds = solid.bounds();
    let corners = bounds.into_iter().flat_map(|b| {
        (0..8).map(move |i| {
            glam::Vec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), b.max, b.min).as_dvec3()
        })
    });
    bounds.map(|b| b.center().as_dvec3()).into_iter().chain(corners)
}

/// The distance with its gradient in double precision, compiled once.
#[inline(never)]
fn at_f64(solid: &PlacedSdf, p: DVec3) -> Scalar<f64> {
    solid.at(p.to_array())
}

fn project(solid: &PlacedSdf, p: DVec3) -> DVec3 {
    let mut q = p;
    for _ in 0..3 {
        let found = at_f64(solid, q);
        let gradient = DVec3::from_array(found.gradient);
        q -= gradient * (found.value / gradient.length_squared().max(1e-12));
    }
    q
}

/// Joins solids that touch, and draws the reference points of the others towards their gaps. Containers and what moves
/// stay alone: what touches them has its own ramp to the wall, however narrow.
pub fn build_obstacles(walls: impl IntoIterator<Item: Into<Wall>>) -> Vec<Obstacle> {
    let walls: Vec<Wall> = walls.into_iter().map(Into::into).collect();
    let size = |s: &PlacedSdf| f64::from(s.bounding_radius());
    let solids: Vec<&PlacedSdf> = walls.iter().map(|wall| wall.sdf.as_ref()).collect();
    let is_alone = |wall: &Wall| wall.motion.is_some() || wall.is_container;
    let mut group: Vec<usize> = (0..walls.len()).collect();
    let mut gaps = Vec::new();
    for i in 0..walls.len() {
        for j in 0..i {
            if is_alone(&walls[i]) || is_alone(&walls[j]) || walls[i].boundary != walls[j].boundary {
                continue;
            }
            let scale = size(solids[i]).min(size(solids[j]));
            // Two half spaces meet somewhere, or one holds the other, or they never come near: no gap to look after.
            if scale.is_infinite() {
                continue;
            }
            let (width, on_i, on_j) = gap(solids[i], solids[j]);
            if width <= SLIT * scale {
                let (from, to) = (group[i], group[j]);
                group.iter_mut().filter(|g| **g == from).for_each(|g| *g = to);
            } else {
                gaps.push((i, j, (scale / width).powi(2), on_i, on_j));
            }
        }
    }
    let mut labels: Vec<usize> = group.clone();
    labels.sort_unstable();
    labels.dedup();
    labels
        .into_iter()
        .map(|label| {
            let is_mine = |i: usize| group[i] == label;
            let members: Vec<&Wall> = walls.iter().enumerate().filter(|(i, _)| is_mine(*i)).map(|(_, w)| w).collect();
            let mut obstacle = Obstacle::new(&members);
            let (mut sum, mut total) = (obstacle.reference, 1.0);
            for &(i, j, weight, on_i, on_j) in &gaps {
                if is_mine(i) != is_mine(j) && (is_mine(i) || is_mine(j)) {
                    sum += weight * if is_mine(i) { on_i } else { on_j };
                    total += weight;
                }
            }
            obstacle.reference = sum / total;
            obstacle
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitive::Sphere;
    use crate::math::space::Similarity;

    fn sphere(x: f64, radius: f64) -> Arc<PlacedSdf> {
        let center = DVec3::new(x, 0.0, 0.0);
        Arc::new(PlacedSdf::new(Sdf::Primitive(Primitive::Sphere(Sphere { center, radius })), Similarity::IDENTITY))
    }

    fn ground(y: f64) -> Arc<PlacedSdf> {
        let plane = HalfSpace { point: DVec3::new(0.0, y, 0.0), normal: DVec3::Y };
        Arc::new(PlacedSdf::new(Sdf::Primitive(Primitive::HalfSpace(plane)), Similarity::IDENTITY))
    }

    #[test]
    fn the_gap_between_spheres_is_found() {
        let (width, a, b) = gap(&sphere(0.0, 1.0), &sphere(3.0, 0.5));
        assert!((width - 1.5).abs() < 1e-6, "{width}");
        assert!((a - DVec3::X).length() < 1e-3 && (b - DVec3::X * 2.5).length() < 1e-3);
        assert_eq!(gap(&sphere(0.0, 1.0), &sphere(1.2, 0.5)).0, 0.0);
        assert_eq!(gap(&sphere(0.0, 1.0), &sphere(0.2, 0.1)).0, 0.0, "one inside the other");
        assert!((gap(&sphere(0.0, 1.0), &ground(-1.5)).0 - 0.5).abs() < 1e-6);
    }

    #[test]
    fn solids_that_touch_become_one() {
        let obstacles = build_obstacles(vec![sphere(0.0, 1.0), sphere(5.0, 1.0), sphere(1.9, 1.0), ground(-1.0)]);
        // Ground touches all of them.
        assert_eq!(obstacles.len(), 1);
        let obstacles = build_obstacles(vec![sphere(0.0, 1.0), sphere(5.0, 1.0), sphere(1.9, 1.0)]);
        assert_eq!(obstacles.iter().map(|o| o.solids().len()).collect::<Vec<_>>(), [2, 1]);
    }

    #[test]
    fn reference_points_are_drawn_to_the_gap() {
        let far = build_obstacles(vec![sphere(0.0, 1.0), sphere(50.0, 1.0)]);
        assert!(far[0].reference().length() < 1e-3);
        let near = build_obstacles(vec![sphere(0.0, 1.0), sphere(2.2, 1.0)]);
        assert!((near[0].reference().x - 1.0).abs() < 0.05 && (near[1].reference().x - 1.2).abs() < 0.05);
    }

    #[test]
    fn a_joint_distance_is_zero_on_both_walls() {
        let obstacle = &build_obstacles(vec![sphere(0.0, 1.0), sphere(1.5, 1.0)])[0];
        assert!(!obstacle.has_smooth_normal);
        for p in [[-1.0, 0.0, 0.0], [2.5, 0.0, 0.0], [0.0, 1.0, 0.0]] {
            assert!(obstacle.wall::<f64>(None, p, 0.0).0.value.abs() < 1e-12);
        }
        assert!(obstacle.wall(None, [0.75f64, 0.0, 0.0], 0.0).0.value < 0.0);
        assert!(obstacle.wall(None, [0.75f64, 1.5, 0.0], 0.0).0.value > 0.0);
    }
}
