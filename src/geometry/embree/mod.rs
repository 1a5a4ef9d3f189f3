//! Embree 4 behind safe types of our own: hits, occlusion and closest points.
//!
//! A [`SceneBuilder`] is consumed by [`SceneBuilder::commit`]; only the [`TraceScene`] that comes out can be asked, from
//! any number of threads, and it can no longer change. What the library points to (solids, meshes) is kept alive by the
//! scene. Errors are checked while building; asking cannot fail.
#![allow(unsafe_code)]

mod device;
mod hit;
#[allow(missing_docs)]
mod sys;

pub use crate::foreign::LoadError;
pub use device::{EmbreeError, version};
pub use hit::{Hit, Ray};

use crate::geometry::closed::Closed;
use crate::geometry::mesh::Mesh;
use crate::geometry::moment::Moment;
use crate::geometry::trace::Solid;
use crate::geometry::triangle::closest_point;
use crate::math::aabb::Aabb;
use crate::math::space::WorldPoint;
use device::Device;
use glam::Vec3;
use hit::{hit_on_solid, triangle_hit};
use std::ptr::{from_mut, null};
use std::sync::Arc;
use sys::{Functions, Handle, INVALID_ID};

/// Most solids that are asked one after the other before the tree is.
const OUTSIDE_THE_TREE: usize = 4;

/// One geometry of a scene.
enum Part {
    Triangles(Arc<Mesh>),
    Solid(Arc<Solid>),
}

/// Fields are dropped in order: the scene before the parts it points to and before its device.
struct Scene {
    functions: &'static Functions,
    handle: Handle,
    parts: Vec<(u32, Part)>,
    device: Device,
}

// SAFETY: see `Device`; the parts are `Send` and `Sync`.
unsafe impl Send for Scene {}
// SAFETY: a committed scene is only read.
unsafe impl Sync for Scene {}

impl Drop for Scene {
    fn drop(&mut self) {
        // SAFETY: made by us and released once.
        unsafe { (self.functions.release_scene)(self.handle) }
    }
}

/// A scene that is being put together.
pub struct SceneBuilder {
    /// Nothing to hit needs no library.
    scene: Option<Scene>,
    outside: Vec<Outside>,
    moving: Vec<Moving>,
    bounds: Aabb,
}

/// A shape that is elsewhere at other moments.
struct Moving {
    shape_idx: u32,
    /// The shape alone, at the frame's own time.
    alone: TraceScene,
    /// A box round all places that it takes.
    swept: Aabb,
}

impl Default for SceneBuilder {
    fn default() -> Self {
        Self::new()
    }
}

impl SceneBuilder {
    /// An empty scene.
    pub fn new() -> Self {
        Self { scene: None, outside: Vec::new(), moving: Vec::new(), bounds: Aabb::EMPTY }
    }

    /// Adds triangles that hits report as shape `shape_idx`.
    ///
    /// # Errors
    /// Where the library is missing or out of memory.
    pub fn add_mesh(&mut self, mesh: Arc<Mesh>, shape_idx: u32) -> Result<(), EmbreeError> {
        self.bounds = self.bounds.union(&mesh.bounds());
        let scene = self.scene()?;
        let f = scene.functions;
        let (vertex_count, triangle_count) = (mesh.positions().len(), mesh.triangles().len());
        // SAFETY: the buffers that Embree hands out hold the number of items asked for, aligned for them; they are
        // filled before the geometry is committed.
        unsafe {
            let geometry = (f.new_geometry)(scene.device.handle, sys::GEOMETRY_TRIANGLE);
            let vertices =
                (f.new_buffer)(geometry, sys::BUFFER_VERTEX, 0, sys::FORMAT_FLOAT3, size_of::<Vec3>(), vertex_count);
            let indices = (f.new_buffer)(
                geometry,
                sys::BUFFER_INDEX,
                0,
                sys::FORMAT_UINT3,
                size_of::<[u32; 3]>(),
                triangle_count,
            );
            if vertices.is_null() || indices.is_null() {
                (f.release_geometry)(geometry);
                scene.device.check("storing triangles")?;
                return Err(EmbreeError::Failed { doing: "storing triangles", code: 4 });
            }
            vertices.cast::<Vec3>().copy_from_nonoverlapping(mesh.positions().as_ptr(), vertex_count);
            indices.cast::<[u32; 3]>().copy_from_nonoverlapping(mesh.triangles().as_ptr(), triangle_count);
            scene.attach(geometry, shape_idx, Part::Triangles(mesh));
        }
        scene.device.check("storing triangles")
    }

    /// Adds a solid with a formula that hits report as shape `shape_idx`.
    ///
    /// # Errors
    /// Where the library is missing or out of memory.
    pub fn add_solid(&mut self, solid: Arc<Solid>, shape_idx: u32) -> Result<(), EmbreeError> {
        self.bounds = self.bounds.union(&solid.bounds());
        if let (Some(&closed), true) = (solid.closed(), self.outside.len() < OUTSIDE_THE_TREE) {
            self.outside.push(Outside { shape_idx, closed, bounds: solid.bounds() });
            return Ok(());
        }
        let scene = self.scene()?;
        let f = scene.functions;
        // SAFETY: the callbacks fit the user pointer, and the scene keeps what it points to alive.
        unsafe {
            let geometry = (f.new_geometry)(scene.device.handle, sys::GEOMETRY_USER);
            (f.set_primitive_count)(geometry, 1);
            (f.set_user_data)(geometry, Arc::as_ptr(&solid).cast());
            (f.set_bounds)(geometry, Some(solid_bounds), null());
            (f.set_intersect)(geometry, Some(solid_intersect));
            (f.set_occluded)(geometry, Some(solid_occluded));
            scene.attach(geometry, shape_idx, Part::Solid(solid));
        }
        scene.device.check("storing a solid")
    }

    /// Adds shape `shape_idx`, which moves within the box `swept`; `alone` is the shape at the frame's own time. Such shapes are
    /// asked one after the other, those whose box a ray meets.
    pub fn add_moving(&mut self, alone: TraceScene, shape_idx: u32, swept: Aabb) {
        self.bounds = self.bounds.union(&swept);
        self.moving.push(Moving { shape_idx, alone, swept });
    }

    /// Builds the tree over everything added.
    ///
    /// # Errors
    /// Where the library is out of memory.
    pub fn commit(self) -> Result<TraceScene, EmbreeError> {
        if let Some(scene) = &self.scene {
            // SAFETY: the scene is complete and nobody else uses it.
            unsafe { (scene.functions.commit_scene)(scene.handle) };
            scene.device.check("building the tree")?;
        }
        Ok(TraceScene { scene: self.scene, outside: self.outside, moving: self.moving, bounds: self.bounds })
    }

    fn scene(&mut self) -> Result<&mut Scene, EmbreeError> {
        if self.scene.is_none() {
            let device = Device::try_new()?;
            let functions = device.functions;
            // SAFETY: the device is valid.
            let handle = unsafe { (functions.new_scene)(device.handle) };
            device.check("making a scene")?;
            let scene = self.scene.insert(Scene { functions, handle, parts: Vec::new(), device });
            // SAFETY: the scene is valid.
            unsafe { (functions.set_scene_flags)(scene.handle, sys::SCENE_ROBUST) };
        }
        Ok(self.scene.as_mut().expect("made just above"))
    }
}

impl Scene {
    /// # Safety
    /// `geometry` is complete but for its commit, and `part` holds what it points to.
    unsafe fn attach(&mut self, geometry: Handle, shape_idx: u32, part: Part) {
        let id = self.parts.len() as u32;
        self.parts.push((shape_idx, part));
        // SAFETY: by the caller's promise; the scene holds its own reference from here on.
        unsafe {
            (self.functions.commit_geometry)(geometry);
            (self.functions.attach_geometry)(self.handle, geometry, id);
            (self.functions.release_geometry)(geometry);
        }
    }
}

/// A solid with a closed form that is met outside of the tree.
struct Outside {
    shape_idx: u32,
    closed: Closed,
    /// What tells most rays past it.
    bounds: Aabb,
}

impl Outside {
    /// As [`Closed::crossing`], of a ray that ends at `end` or before.
    #[inline]
    fn crossing(&self, ray: &Ray, end: WorldPoint, t_min: f32, t_max: f32) -> Option<f32> {
        if self.bounds.is_beside(ray.origin.0, end.0) {
            return None;
        }
        self.closed.crossing(ray.origin.0, ray.direction.as_vec3(), t_min, t_max)
    }
}

impl Moving {
    #[inline]
    fn is_near(&self, ray: &Ray, t_min: f32, t_max: f32) -> bool {
        self.swept.ray_interval(ray.origin.0, ray.direction.as_vec3(), t_min, t_max).is_some()
    }
}

/// A scene that rays can be sent through. Finds the same hits whatever thread asks.
pub struct TraceScene {
    scene: Option<Scene>,
    outside: Vec<Outside>,
    moving: Vec<Moving>,
    bounds: Aabb,
}

impl TraceScene {
    /// Whether there are triangles, which may have parts that overlap.
    pub fn has_meshes(&self) -> bool {
        let is_mesh = |part: &(u32, Part)| matches!(part.1, Part::Triangles(_));
        self.scene.as_ref().is_some_and(|scene| scene.parts.iter().any(is_mesh))
            || self.moving.iter().any(|moving| moving.alone.has_meshes())
    }

    /// As [`TraceScene::intersect`], of shapes where they are at a moment.
    #[inline]
    pub fn intersect_at(&self, ray: &Ray, t_min: f32, t_max: f32, moment: Moment) -> Option<Hit> {
        // Not one after the other: hits are large, and most scenes have nothing that moves.
        if self.moving.is_empty() {
            return self.intersect(ray, t_min, t_max);
        }
        self.intersect_with_moving(ray, t_min, t_max, moment)
    }

    #[inline(never)]
    fn intersect_with_moving(&self, ray: &Ray, t_min: f32, t_max: f32, moment: Moment) -> Option<Hit> {
        let mut nearest = self.intersect(ray, t_min, t_max);
        for moving in &self.moving {
            let t_max = nearest.as_ref().map_or(t_max, |hit| hit.t);
            if !moving.is_near(ray, t_min, t_max) {
                continue;
            }
            let found = match moment.of(moving.shape_idx) {
                Some(carried) => {
                    let scale = carried.scale();
                    let hit = moving.alone.intersect(&carried.ray_back(ray), t_min / scale, t_max / scale);
                    hit.map(|hit| carried.hit(&hit))
                }
                None => moving.alone.intersect(ray, t_min, t_max),
            };
            nearest = found.or(nearest);
        }
        nearest
    }

    /// As [`TraceScene::is_occluded`], by shapes where they are at a moment.
    #[inline]
    pub fn is_occluded_at(&self, ray: &Ray, t_min: f32, t_max: f32, moment: Moment) -> bool {
        self.is_occluded(ray, t_min, t_max)
            || (!self.moving.is_empty() && self.is_occluded_by_moving(ray, t_min, t_max, moment))
    }

    #[inline(never)]
    fn is_occluded_by_moving(&self, ray: &Ray, t_min: f32, t_max: f32, moment: Moment) -> bool {
        self.moving.iter().any(|moving| {
            moving.is_near(ray, t_min, t_max)
                && match moment.of(moving.shape_idx) {
                    Some(carried) => {
                        let scale = carried.scale();
                        moving.alone.is_occluded(&carried.ray_back(ray), t_min / scale, t_max / scale)
                    }
                    None => moving.alone.is_occluded(ray, t_min, t_max),
                }
        })
    }

    /// A world-space box that holds all surfaces; empty where there are none.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// The nearest surface between `t_min` and `t_max` [m] along the ray, of those that stay where they are.
    ///
    /// A ray that leaves a surface starts at [`Hit::offset_origin`], with `t_min` 0.
    #[inline]
    pub fn intersect(&self, ray: &Ray, t_min: f32, t_max: f32) -> Option<Hit> {
        let (mut t_nearest, mut nearest) = (t_max, None);
        let end = ray.at(t_max);
        for candidate in &self.outside {
            if let Some(t) = candidate.crossing(ray, end, t_min, t_nearest) {
                (t_nearest, nearest) = (t, Some(candidate));
            }
        }
        self.intersect_tree(ray, t_min, t_nearest).or_else(|| {
            let Outside { shape_idx, closed, .. } = nearest?;
            Some(hit_on_solid(ray, t_nearest, *shape_idx, |position| closed.normal_at(position)))
        })
    }

    #[inline]
    fn intersect_tree(&self, ray: &Ray, t_min: f32, t_max: f32) -> Option<Hit> {
        let scene = self.scene.as_ref()?;
        let mut ray_hit = ray_hit(ray, t_min, t_max);
        // SAFETY: the scene is committed, and the struct is as large as any version of the library writes.
        unsafe { (scene.functions.intersect1)(scene.handle, &mut ray_hit, null()) };
        if ray_hit.hit.geom_id == INVALID_ID {
            return None;
        }
        let (shape_idx, part) = &scene.parts[ray_hit.hit.geom_id as usize];
        Some(match part {
            Part::Triangles(mesh) => triangle_hit(mesh, ray, &ray_hit, *shape_idx),
            Part::Solid(solid) => hit_on_solid(ray, ray_hit.ray.tfar, *shape_idx, |position| {
                solid.normal_at(position).unwrap_or(-ray.direction)
            }),
        })
    }

    /// True where any surface lies between `t_min` and `t_max` [m] along the ray.
    #[inline]
    pub fn is_occluded(&self, ray: &Ray, t_min: f32, t_max: f32) -> bool {
        let end = ray.at(t_max);
        if self.outside.iter().any(|solid| solid.crossing(ray, end, t_min, t_max).is_some()) {
            return true;
        }
        let Some(scene) = &self.scene else { return false };
        let mut ray = ray_hit(ray, t_min, t_max).ray;
        // SAFETY: the scene is committed.
        unsafe { (scene.functions.occluded1)(scene.handle, &mut ray, null()) };
        ray.tfar < 0.0
    }

    /// Distance [m] from `p` to the nearest triangle, if that is less than `radius`. Solids are not looked at.
    pub fn closest_triangle(&self, p: WorldPoint, radius: f32) -> Option<f32> {
        let scene = self.scene.as_ref()?;
        let mut query = sys::PointQuery { p: p.0.to_array(), time: 0.0, radius };
        let mut context = sys::PointQueryContext {
            world_to_instance: [0.0; 16],
            instance_to_world: [0.0; 16],
            inst_id: INVALID_ID,
            tail: [0; 7],
        };
        let mut search = Search { scene, p: p.0, radius };
        // SAFETY: the callback casts the pointer back to what it is, and both live until the call returns.
        unsafe {
            let user = from_mut(&mut search).cast();
            (scene.functions.point_query)(scene.handle, &mut query, &mut context, Some(nearer), user);
        }
        (search.radius < radius).then_some(search.radius)
    }
}

#[inline]
fn ray_hit(ray: &Ray, t_min: f32, t_max: f32) -> sys::RtcRayHit {
    sys::RtcRayHit {
        ray: sys::RtcRay {
            org: ray.origin.0.to_array(),
            tnear: t_min,
            dir: ray.direction.to_array(),
            time: 0.0,
            tfar: t_max,
            mask: u32::MAX,
            id: 0,
            flags: 0,
        },
        hit: sys::RtcHit {
            ng: [0.0; 3],
            u: 0.0,
            v: 0.0,
            prim_id: INVALID_ID,
            geom_id: INVALID_ID,
            inst_id: INVALID_ID,
            inst_prim_id: INVALID_ID,
        },
    }
}

// The callbacks below are plain arithmetic on valid memory. Should one panic all the same, `extern "C"` makes that an
// abort: it never unwinds through the library.

/// # Safety
/// Called by Embree for a geometry made by `add_solid`.
unsafe extern "C" fn solid_bounds(arguments: *const sys::BoundsArguments) {
    // SAFETY: Embree's arguments are valid during the call; the user pointer is that of an `Arc<Solid>` kept by the scene.
    unsafe {
        let solid = &*(*arguments).user.cast::<Solid>();
        let (bounds, out) = (solid.bounds(), (*arguments).bounds);
        (*out).lower = bounds.min.to_array();
        (*out).upper = bounds.max.to_array();
    }
}

#[inline]
fn solid_crossing(solid: &Solid, ray: &sys::RtcRay) -> Option<f32> {
    solid.crossing(Vec3::from_array(ray.org), Vec3::from_array(ray.dir), ray.tnear, ray.tfar)
}

/// # Safety
/// Called by Embree for a geometry made by `add_solid`, with packets of one ray: only `rtcIntersect1` is used.
unsafe extern "C" fn solid_intersect(arguments: *const sys::IntersectArguments) {
    // SAFETY: as for the bounds; a packet of one ray has the layout of `RtcRayHit`.
    unsafe {
        let arguments = &*arguments;
        if arguments.n != 1 || *arguments.valid == 0 {
            return;
        }
        let ray_hit = &mut *arguments.ray_hit;
        if let Some(t) = solid_crossing(&*arguments.user.cast::<Solid>(), &ray_hit.ray) {
            ray_hit.ray.tfar = t;
            ray_hit.hit.prim_id = arguments.prim_id;
            ray_hit.hit.geom_id = arguments.geom_id;
        }
    }
}

/// # Safety
/// As for `solid_intersect`, from `rtcOccluded1`.
unsafe extern "C" fn solid_occluded(arguments: *const sys::OccludedArguments) {
    // SAFETY: as for `solid_intersect`; a packet of one ray has the layout of `RtcRay`.
    unsafe {
        let arguments = &*arguments;
        if arguments.n != 1 || *arguments.valid == 0 {
            return;
        }
        let ray = &mut *arguments.ray;
        if solid_crossing(&*arguments.user.cast::<Solid>(), ray).is_some() {
            ray.tfar = f32::NEG_INFINITY;
        }
    }
}

/// A search for the nearest triangle under way.
struct Search<'a> {
    scene: &'a Scene,
    p: Vec3,
    radius: f32,
}

/// # Safety
/// Called by Embree from `closest_triangle`.
unsafe extern "C" fn nearer(arguments: *mut sys::PointQueryArguments) -> bool {
    // SAFETY: the user pointer is the `Search` of the caller, which nobody else touches meanwhile; ids are those of the
    // parts that were attached.
    unsafe {
        let arguments = &*arguments;
        let search = &mut *arguments.user.cast::<Search>();
        let Some((_, Part::Triangles(mesh))) = search.scene.parts.get(arguments.geom_id as usize) else { return false };
        let distance = closest_point(search.p, mesh.corners(arguments.prim_id as usize)).distance(search.p);
        if distance >= search.radius {
            return false;
        }
        search.radius = distance;
        (*arguments.query).radius = distance;
        true
    }
}

#[cfg(test)]
mod tests;
