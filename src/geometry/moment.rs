//! Where moving shapes are at a moment while a shutter is open.
//!
//! Shapes are built where they are at the frame's own time. At another moment a ray is moved into the space in which the shape
//! is still there, and what it meets back into the world: exact for every motion, whatever the shape is made of.

use crate::geometry::embree::{Hit, Ray};
use crate::geometry::motion::{Motion, Placement};
use crate::math::aabb::Aabb;
use crate::math::space::{UnitVec3, WorldPoint};
use glam::{DMat3, DVec3, Vec3};
use std::sync::Arc;

/// Places at which the box round all places of a shape is taken while a shutter is open; between them it is made larger by as
/// much as its corners move from one to the next.
const SWEEP_SAMPLES: u32 = 64;

/// How the shapes of a scene move while a shutter is open.
#[derive(Debug, Clone)]
pub struct Shutter {
    frame_time: f64,
    open: [f64; 2],
    /// Of each shape; `None` for those that stay where they are.
    bodies: Vec<Option<Body>>,
}

#[derive(Debug, Clone)]
struct Body {
    motion: Arc<Motion>,
    pivot: DVec3,
    /// From where it is at the frame's time to where it rests.
    to_rest: Placement,
}

/// From where a body is at the frame's time to where it is at another.
#[derive(Debug, Clone, Copy)]
pub struct Carried {
    scale: f64,
    rotation: DMat3,
    translation: DVec3,
}

/// Where shapes are at a moment, by shape; those that are not listed are where they are at the frame's own time.
#[derive(Debug, Clone, Copy, Default)]
pub struct Moment<'a>(&'a [Option<Carried>]);

impl Shutter {
    /// The shutter is open from the first to the second time of `open` [s]; `shapes` are motions and what they turn about.
    pub(in crate::geometry) fn new(
        shapes: impl Iterator<Item = (Option<Arc<Motion>>, DVec3)>,
        frame_time: f64,
        open: [f64; 2],
    ) -> Self {
        let body = |(motion, pivot): (Option<Arc<Motion>>, DVec3)| {
            let motion = motion?;
            let there = motion.placement(pivot, frame_time);
            let moves = times(open).any(|time| motion.placement(pivot, time) != there);
            moves.then(|| Body { pivot, to_rest: there.inverse(), motion })
        };
        Self { frame_time, open, bodies: shapes.map(body).collect() }
    }

    /// Time of the frame [s].
    pub fn frame_time(&self) -> f64 {
        self.frame_time
    }

    /// Whether any shape moves while it is open.
    pub fn moves(&self) -> bool {
        self.bodies.iter().any(Option::is_some)
    }

    /// The time at a share of the way from opening to closing [s].
    pub fn time(&self, share: f64) -> f64 {
        self.open[0] + (self.open[1] - self.open[0]) * share
    }

    /// Where shapes are at a time [s], into memory that is given.
    pub fn at<'m>(&self, time: f64, memory: &'m mut Vec<Option<Carried>>) -> Moment<'m> {
        memory.clear();
        memory.extend(self.bodies.iter().map(|body| body.as_ref().map(|body| body.carried(time))));
        Moment(memory)
    }

    /// A box round all places that shape `shape_idx` takes; `None` where it stays.
    pub(in crate::geometry) fn swept(&self, shape_idx: usize, bounds: &Aabb) -> Option<Aabb> {
        let body = self.bodies.get(shape_idx)?.as_ref()?;
        let corner = |i: u32| Vec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), bounds.max, bounds.min);
        let mut last: Option<[DVec3; 8]> = None;
        let (mut all, mut furthest) = (Aabb::EMPTY, 0.0f64);
        for time in times(self.open) {
            let carried = body.carried(time);
            let corners: [DVec3; 8] = std::array::from_fn(|i| carried.point(corner(i as u32).as_dvec3()));
            all = all.union(&Aabb::from_points(corners.map(DVec3::as_vec3)));
            if let Some(last) = last {
                furthest = (0..8).map(|i| corners[i].distance(last[i])).fold(furthest, f64::max);
            }
            last = Some(corners);
        }
        // As for boxes at rest, some roundings.
        let size = all.min.abs().max(all.max.abs()).max_element();
        Some(all.dilated(furthest as f32 + 1e-5 * size))
    }
}

/// Times from opening to closing.
fn times(open: [f64; 2]) -> impl Iterator<Item = f64> {
    (0..=SWEEP_SAMPLES).map(move |i| open[0] + (open[1] - open[0]) * f64::from(i) / f64::from(SWEEP_SAMPLES))
}

impl Moment<'_> {
    /// Where the point of a hit and its shading normal are at the frame's own time: patterns move with their shape.
    #[inline]
    pub fn at_rest(&self, hit: &Hit) -> (WorldPoint, UnitVec3) {
        match self.of(hit.shape_idx) {
            None => (hit.position, hit.shading_normal),
            Some(carried) => carried.at_rest(hit),
        }
    }
}

impl Body {
    fn carried(&self, time: f64) -> Carried {
        let moved = self.to_rest.within(&self.motion.placement(self.pivot, time));
        Carried { scale: moved.scale, rotation: DMat3::from_quat(moved.rotation), translation: moved.translation }
    }
}

impl Carried {
    /// Where a point of the body is [m].
    #[inline]
    pub fn point(&self, p: DVec3) -> DVec3 {
        self.rotation * (self.scale * p) + self.translation
    }

    /// Where in the frame's own world a point of the body at this moment is [m].
    #[inline]
    pub fn back(&self, p: WorldPoint) -> WorldPoint {
        WorldPoint((self.rotation.transpose() * (p.0.as_dvec3() - self.translation) / self.scale).as_vec3())
    }

    /// A direction of this moment in the frame's own world.
    #[inline]
    pub fn direction_back(&self, v: UnitVec3) -> UnitVec3 {
        UnitVec3::new_unchecked((self.rotation.transpose() * v.as_vec3().as_dvec3()).normalize().as_vec3())
    }

    #[inline(never)]
    fn at_rest(&self, hit: &Hit) -> (WorldPoint, UnitVec3) {
        (self.back(hit.position), self.direction_back(hit.shading_normal))
    }

    /// A direction of the frame's own world at this moment.
    #[inline]
    pub fn direction(&self, v: UnitVec3) -> UnitVec3 {
        UnitVec3::new_unchecked((self.rotation * v.as_vec3().as_dvec3()).normalize().as_vec3())
    }

    /// A ray of this moment in the frame's own world. Distances along it are [`Carried::scale`] times shorter there.
    #[inline]
    pub fn ray_back(&self, ray: &Ray) -> Ray {
        Ray { origin: self.back(ray.origin), direction: self.direction_back(ray.direction) }
    }

    /// How much larger the body is than at the frame's time.
    #[inline]
    pub fn scale(&self) -> f32 {
        self.scale as f32
    }

    /// What was met in the frame's own world, as it is at this moment.
    #[inline]
    pub fn hit(&self, hit: &Hit) -> Hit {
        let position = self.point(hit.position.0.as_dvec3()).as_vec3();
        hit.moved(
            hit.t * self.scale(),
            WorldPoint(position),
            [self.direction(hit.normal), self.direction(hit.shading_normal)],
            self.scale(),
        )
    }
}

impl Moment<'_> {
    /// Where a shape is carried to.
    #[inline]
    pub fn of(&self, shape_idx: u32) -> Option<&Carried> {
        self.0.get(shape_idx as usize).and_then(Option::as_ref)
    }
}
