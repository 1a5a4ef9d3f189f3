//! Solids that the flow goes round: which of them act as one, where each takes its constant, how far it reaches.
//!
//! Every obstacle has a constant of its own for each potential, the potential's value at its reference point, so that
//! wind passes between obstacles (the idea of Ding and Batty 2023, *Differentiable Curl-Noise*, carried to three
//! dimensions). The reference point is the obstacle's middle, drawn towards the gaps to its neighbours: the difference
//! of two obstacles' constants is the flow through their gap, which so stays near the free stream's and does not jet.
//!
//! Solids that touch, overlap or leave a gap below [`SLIT`] are one obstacle with one constant: their ramps are
//! multiplied, which has the same walls and no ridge between them, equation 3 takes the place of equation 5 (the joint
//! normal is not smooth where they meet), and the flow between them dies down. The faces of a box that holds the flow
//! are such solids too.

use crate::flow::ramp::{UnitNormal, unit_normal};
use crate::flow::reach::{has_smooth_normal, reach};
use crate::geometry::motion::{Motion, RigidSpan, turned_derivatives};
use crate::geometry::primitive::{HalfSpace, Primitive};
use crate::geometry::sdf::{PlacedSdf, Sdf};
use crate::math::jet::Scalar;
use crate::math::real::{Lane, dot, triple};
use glam::{DMat3, DVec3};
use std::sync::Arc;

/// Gaps below this share of the smaller neighbour's size are closed.
const SLIT: f64 = 0.05;
/// The influence of an obstacle without size, such as the ground, where the settings leave it open [m].
const ENDLESS_INFLUENCE: f64 = 1.0;
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
    /// Middle and half size of a box around each solid, in every pose; `None` of those that have no end.
    boxes: Vec<Option<(DVec3, DVec3)>>,
    motion: Option<Arc<Motion>>,
    boundary: Boundary,
    is_container: bool,
    reference: DVec3,
    size: f64,
    girth: f64,
    reach: f64,
    is_endless: bool,
    /// Whether equation 5 applies; equation 3 otherwise.
    has_smooth_normal: bool,
    ground: Option<Ground>,
    spread: Spread,
    hole: Option<Hole>,
}

/// The half space among the solids of an obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ground {
    /// Which solid.
    pub solid_idx: usize,
    /// Out of it, length 1.
    pub normal: DVec3,
}

/// How far a body reaches along its own axes: columns of length 1, and half its size along each [m]. Of a half space,
/// which has no size, 0 along the normal and 1 across.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Spread {
    axes: DMat3,
    half: DVec3,
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

impl Spread {
    const EVEN: Self = Self { axes: DMat3::IDENTITY, half: DVec3::ONE };

    fn of(solid: &PlacedSdf) -> Self {
        let turn = DMat3::from_quat(solid.placement().rotation.as_dquat());
        let about = |axis: DVec3, along: f64, across: f64| {
            let axis = (turn * axis).normalize();
            let (u, v) = axis.any_orthonormal_pair();
            Self { axes: DMat3::from_cols(axis, u, v), half: DVec3::new(along, across, across) }
        };
        let own = match solid.sdf() {
            Sdf::Primitive(Primitive::Sphere(s)) => Self { half: DVec3::splat(s.radius), ..Self::EVEN },
            Sdf::Primitive(Primitive::Cuboid(c)) => Self { axes: turn, half: c.half_size },
            Sdf::Primitive(Primitive::Capsule(c)) => {
                let along = c.end - c.start;
                about(along.normalize_or(DVec3::Y), 0.5 * along.length() + c.radius, c.radius)
            }
            Sdf::Primitive(Primitive::Torus(t)) => about(t.axis, t.minor_radius, t.major_radius + t.minor_radius),
            Sdf::Primitive(Primitive::HalfSpace(h)) => about(h.normal, 0.0, 1.0),
            Sdf::SmoothUnion(_) | Sdf::Mesh(_) => {
                let size = solid.sdf().bounds().map_or(DVec3::ONE, |bounds| bounds.size().as_dvec3());
                Self { axes: turn, half: 0.5 * size }
            }
        };
        Self { half: own.half * f64::from(solid.placement().scale), ..own }
    }
}

impl Spread {
    /// Half sizes along the axes of a body that stands on a ground with the given normal, as seen from the point of the
    /// ground below its middle, which is at `middle` from any point of the ground.
    fn on_ground(&self, normal: DVec3, middle: DVec3) -> Self {
        let along = |axis: DVec3| (self.axes.transpose() * axis).abs().dot(self.half);
        let (u, v) = normal.any_orthonormal_pair();
        let height = normal.dot(middle).abs() + along(normal);
        Self { axes: DMat3::from_cols(normal, u, v), half: DVec3::new(height, along(u), along(v)) }
    }

    /// The middle one of the half sizes: how far round a bar, a plate or a lump the flow must give way.
    fn girth(&self) -> f64 {
        let [x, y, z] = self.half.to_array();
        x.max(y).min(x.max(z)).min(y.max(z))
    }
}

impl Obstacle {
    fn new(walls: &[&Wall]) -> Self {
        let given: Vec<Arc<PlacedSdf>> = walls.iter().map(|wall| wall.sdf.clone()).collect();
        let first = walls[0];
        let bounds = given.iter().filter_map(|s| s.bounds()).reduce(|a, b| a.union(&b));
        let is_endless = given.iter().any(|s| s.bounds().is_none());
        let is_plain = first.motion.is_none() && !first.is_container;
        let solids: Vec<_> = if first.is_container { given.iter().flat_map(container_walls).collect() } else { given };
        let ground = solids.iter().enumerate().find_map(|(solid_idx, solid)| match solid.sdf() {
            Sdf::Primitive(Primitive::HalfSpace(h)) if is_plain => {
                let normal = (solid.placement().rotation.as_dquat() * h.normal).normalize();
                Some(Ground { solid_idx, normal })
            }
            _ => None,
        });
        let own_spread = match (bounds, solids.as_slice()) {
            (_, [solid]) => Spread::of(solid),
            (Some(b), _) => Spread { axes: DMat3::IDENTITY, half: 0.5 * b.size().as_dvec3() },
            (None, _) => Spread::EVEN,
        };
        let spread = match (&ground, bounds) {
            (Some(ground), Some(b)) if first.boundary == Boundary::Slip => {
                let foot = solids[ground.solid_idx].center().0.as_dvec3();
                own_spread.on_ground(ground.normal, b.center().as_dvec3() - foot)
            }
            (Some(ground), Some(_)) => Spread::of(&solids[ground.solid_idx]),
            _ => own_spread,
        };
        let boxes = solids.iter().map(|solid| {
            let bounds = solid.bounds().filter(|_| !first.is_container)?;
            let half = 0.5 * bounds.size().as_dvec3();
            // Whichever way it turns.
            let half = if first.motion.is_some() { DVec3::splat(half.length()) } else { half };
            Some((bounds.center().as_dvec3(), half))
        });
        let mut obstacle = Self {
            reference: bounds.map_or_else(|| solids[0].center().0.as_dvec3(), |b| b.center().as_dvec3()),
            size: bounds.map_or(ENDLESS_INFLUENCE, |b| 0.5 * f64::from(b.size().max_element())),
            reach: walls.iter().map(|wall| reach(&wall.sdf, first.is_container)).fold(f64::INFINITY, f64::min),
            is_endless,
            has_smooth_normal: solids.len() == 1 && has_smooth_normal(&solids[0], first.is_container),
            hole: if solids.len() == 1 && !first.is_container { hole(&solids[0]) } else { None },
            boxes: boxes.collect(),
            motion: first.motion.clone(),
            boundary: first.boundary,
            is_container: first.is_container,
            girth: bounds.map_or(ENDLESS_INFLUENCE, |_| own_spread.girth()),
            ground,
            spread,
            solids,
        };
        obstacle.set_reference(obstacle.reference);
        obstacle
    }

    /// The reference point, or of what has a ground the point of the ground below it: there the potentials of winds along
    /// the ground are zero all over it.
    fn set_reference(&mut self, reference: DVec3) {
        self.reference = match self.ground {
            Some(Ground { solid_idx, normal }) => {
                let height = normal.dot(reference - self.solids[solid_idx].center().0.as_dvec3());
                reference - height * normal
            }
            None => reference,
        };
    }

    /// Where the obstacle's constants are taken.
    pub fn reference(&self) -> DVec3 {
        self.reference
    }

    /// Half the longest edge of its box [m]; of endless ones the influence they have by default.
    pub fn size(&self) -> f64 {
        self.size
    }

    /// Whether the flow is held fast both by a ground and by what stands on it: one potential must do for both.
    pub fn holds_what_stands_on_it(&self) -> bool {
        self.boundary == Boundary::NoSlip && self.ground.is_some() && self.solids.len() > 1
    }

    /// Half its middle extent [m]: how far round it a wind gives way by default.
    pub fn girth(&self) -> f64 {
        self.girth
    }

    /// True where the obstacle has no end.
    pub fn is_endless(&self) -> bool {
        self.is_endless
    }

    /// The influence radius that comes of a wanted one [m]: it ends before the obstacle's own ridge.
    pub fn influence(&self, wanted: f64) -> f64 {
        wanted.min(REACH_USED * self.reach)
    }

    /// The half space among its solids, where it rests.
    pub fn ground(&self) -> Option<Ground> {
        self.ground
    }

    /// Derivatives `[c][i]` of the linear potential with the curl `velocity` [m/s] whose square is smallest on the body,
    /// turned by `rotation`.
    ///
    /// With half sizes hᵢ the curl along axis k is `M[j][i] − M[i][j]`, (i, j, k) cyclic, and of all such pairs the one
    /// with the least `M[j][i]²·hᵢ² + M[i][j]²·hⱼ²` has the shares `hⱼ²` and `hᵢ²`: a wind across a bar becomes
    /// a potential along the bar alone, which is as small at its ends as in its middle.
    pub fn wind_potential(&self, velocity: DVec3, rotation: DMat3) -> [[f64; 3]; 3] {
        let axes = rotation * self.spread.axes;
        let (v, h) = (axes.transpose() * velocity, self.spread.half * self.spread.half);
        let mut own = DMat3::ZERO;
        for k in 0..3 {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            let share = if h[i] + h[j] > 0.0 { h[j] / (h[i] + h[j]) } else { 0.5 };
            own.col_mut(i)[j] = v[k] * share;
            own.col_mut(j)[i] = -v[k] * (1.0 - share);
        }
        let world = axes * own * axes.transpose();
        std::array::from_fn(|c| std::array::from_fn(|i| world.col(i)[c]))
    }

    /// The hole of a ring that stands alone, where it rests.
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

    /// False when every lane is certainly further away than `margin` [m] from a solid of the obstacle. `motion` and
    /// `phase` say where it is.
    #[inline(always)]
    pub fn may_be_within<L: Lane>(
        &self,
        solid_idx: usize,
        motion: Option<&RigidSpan>,
        p: [L; 3],
        phase: L,
        margin: L,
    ) -> bool {
        let Some((middle, half)) = self.boxes[solid_idx] else { return true };
        let middle = match motion {
            Some(motion) => motion.center(phase),
            None => triple!(i => p[i].lit(middle[i])),
        };
        let outside: [L; 3] = triple!(i => (p[i] - middle[i]).abs() - p[i].lit(half[i]));
        outside[0].max(outside[1]).max(outside[2]).any_lt(margin)
    }

    /// Signed distance [m], negative where the flow must not be.
    #[inline(always)]
    pub fn distance<L: Lane>(&self, motion: Option<&RigidSpan>, p: [L; 3], phase: L) -> L {
        let mut least = phase.lit(f64::INFINITY);
        for solid_idx in 0..self.solids.len() {
            least = least.min(self.solid_distance(solid_idx, motion, p, phase));
        }
        least
    }

    /// As [`Obstacle::distance`] of one of the solids.
    #[inline(always)]
    pub fn solid_distance<L: Lane>(&self, solid_idx: usize, motion: Option<&RigidSpan>, p: [L; 3], phase: L) -> L {
        let p = match motion {
            Some(motion) => motion.to_rest(p, phase).0,
            None => p,
        };
        let own = self.solids[solid_idx].distance(p);
        if self.is_inverted() { -own } else { own }
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

    /// Signed distance [m] of a solid with its gradient, and the normal with its derivatives where equation 5 applies.
    #[inline(always)]
    pub fn wall<L: Lane>(
        &self,
        solid_idx: usize,
        motion: Option<&RigidSpan>,
        p: [L; 3],
        phase: L,
    ) -> (Scalar<L>, Option<UnitNormal<L>>) {
        let (rest, m) = match motion {
            Some(motion) => motion.to_rest(p, phase),
            None => (p, [p; 3]),
        };
        let (distance, normal) = self.wall_at_rest(solid_idx, rest);
        if motion.is_none() {
            return (distance, normal);
        }
        let turned = |v: [L; 3]| -> [L; 3] { triple!(i => dot(m[i], v)) };
        let normal = normal.map(|(n, d)| (turned(n), turned_derivatives(&d, &m)));
        (Scalar { value: distance.value, gradient: turned(distance.gradient) }, normal)
    }

    #[inline(always)]
    fn wall_at_rest<L: Lane>(&self, solid_idx: usize, p: [L; 3]) -> (Scalar<L>, Option<UnitNormal<L>>) {
        let solid = &self.solids[solid_idx];
        if self.has_smooth_normal
            && let Some(jet) = solid.jet(p)
        {
            let jet = if self.is_inverted() { -jet } else { jet };
            return (jet.scalar(), Some(unit_normal(&jet)));
        }
        let own = solid.at(p);
        if self.is_inverted() {
            return (Scalar { value: -own.value, gradient: triple!(i => -own.gradient[i]) }, None);
        }
        (own, None)
    }
}

/// What a container is made of: a box of six half spaces, whose ramps multiply where the box's own distance has a ridge
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
            obstacle.set_reference(sum / total);
            obstacle
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitive::{Capsule, Sphere};
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
    fn solids_that_act_as_one_have_no_normal_of_their_own_and_the_ground_keeps_its_reference() {
        let obstacle = &build_obstacles(vec![sphere(0.0, 1.0), sphere(1.5, 1.0), ground(-1.0)])[0];
        assert!(!obstacle.has_smooth_normal && obstacle.is_endless());
        assert_eq!(obstacle.ground().unwrap(), Ground { solid_idx: 2, normal: DVec3::Y });
        assert!((obstacle.reference().y + 1.0).abs() < 1e-6, "{}", obstacle.reference());
    }

    #[test]
    fn the_potential_of_a_wind_has_its_curl_and_stays_small_on_slender_bodies() {
        let bar = Capsule { start: DVec3::Y * -3.0, end: DVec3::Y * 3.0, radius: 0.05 };
        let bar = Arc::new(PlacedSdf::new(Sdf::Primitive(Primitive::Capsule(bar)), Similarity::IDENTITY));
        let obstacle = &build_obstacles(vec![bar])[0];
        let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.8);
        for velocity in DVec3::AXES {
            let m = obstacle.wind_potential(velocity, turn);
            let curl = DVec3::new(m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]);
            assert!(curl.distance(velocity) < 1e-12, "{curl}");
            // At the end of the bar, which is 3 m from the middle.
            let end = turn * DVec3::new(0.05, 3.0, 0.0);
            let value = DVec3::from_array(m.map(|row| DVec3::from_array(row).dot(end)));
            assert!(value.length() < 0.06, "{velocity}: {value}");
        }
    }
}
