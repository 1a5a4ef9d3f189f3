//! Shapes: distances and hits, built from the scene's settings.

pub mod along;
pub mod closed;
pub mod embree;
pub mod gltf_file;
pub mod mesh;
pub mod mesh_file;
mod mesh_samples;
pub mod mesh_sdf;
pub mod moment;
pub mod motion;
pub mod primitive;
pub mod sdf;
pub mod smooth_union;
pub mod spline;
pub mod trace;
pub mod trace_union;
pub mod triangle;

use crate::geometry::embree::{EmbreeError, SceneBuilder, TraceScene};
use crate::geometry::mesh::Mesh;
use crate::geometry::mesh_file::{MeshFileError, read_body, read_mesh};
use crate::geometry::mesh_sdf::{MeshSdf, MeshSdfError};
use crate::geometry::moment::Shutter;
use crate::geometry::motion::{Link, Motion, Placement, Pose};
use crate::geometry::primitive::{Capsule, Cuboid, HalfSpace, Primitive, Sphere, Torus};
use crate::geometry::sdf::{PlacedSdf, Sdf, SmoothUnion};
use crate::geometry::trace::Solid;
use crate::math::aabb::Aabb;
use crate::math::keys::{Between, Interpolation, Keys, Turn};
use crate::math::space::Similarity;
use crate::progress::{Progress, Silent, Stage};
use crate::scene::{PlaceInScene, Scene, settings};
use glam::{DQuat, DVec3, Quat};
use std::sync::Arc;

/// All shapes of a scene.
#[derive(Debug, Clone)]
pub struct Geometry {
    /// In the order of their names, which is that of `settings.shapes`.
    pub shapes: Vec<Shape>,
    /// What is likely a mistake in a mesh, but well defined.
    pub warnings: Vec<String>,
}

/// A solid in the world.
#[derive(Debug, Clone)]
pub struct Shape {
    /// Its key in the scene.
    pub name: String,
    /// Its signed distance where it rests. Of meshes only where the flow needs it.
    pub sdf: Option<Arc<PlacedSdf>>,
    /// How it moves.
    pub motion: Option<Arc<Motion>>,
    /// What it turns about: the middle of its box where it rests [m].
    pub pivot: DVec3,
    /// Its triangles, in world space, where it is a mesh.
    pub mesh: Option<Arc<Mesh>>,
    /// Whether light meets it.
    pub visible: bool,
    /// How far its motion has brought it.
    pub moved: Similarity,
    /// Its signed distance where it rests, as `sdf` before it moved.
    pub resting: Option<Arc<PlacedSdf>>,
    /// A box round all places that it takes while the shutter is open, where it moves then.
    swept: Option<Aabb>,
    /// What light meets, where it is not a mesh.
    solid: Option<Arc<Solid>>,
}

/// Why there is no geometry.
#[derive(Debug, thiserror::Error)]
pub enum GeometryError {
    /// A mesh could not be read.
    #[error("{place}{source}")]
    MeshFile {
        /// Where the scene names it.
        place: Box<PlaceInScene>,
        /// What is wrong.
        source: MeshFileError,
    },
    /// A mesh's distance could not be sampled.
    #[error("{place}{source}")]
    Distance {
        /// Where the scene names it.
        place: Box<PlaceInScene>,
        /// What is wrong.
        source: MeshSdfError,
    },
    /// A file lets a shape move as a shape that carries something must not.
    #[error("{place}{file}: its animation lets `{name}` {what}; {advice}")]
    Animation {
        /// Where the scene names it.
        place: Box<PlaceInScene>,
        /// The file, as the scene names it.
        file: String,
        /// Key of the shape in the scene.
        name: String,
        /// What it does, and why it must not.
        what: &'static str,
        /// What to do.
        advice: &'static str,
    },
    /// What should be filled has holes.
    #[error("the mesh `{name}` is not closed, so that nothing is inside of it: it has {report}")]
    Open {
        /// Key of the shape in the scene.
        name: String,
        /// What is wrong with it.
        report: String,
    },
    /// The ray-tracing library failed.
    #[error(transparent)]
    Embree(#[from] EmbreeError),
    /// The caller asked to stop.
    #[error("stopped while building the geometry")]
    Cancelled,
}

impl Shape {
    /// Lets rays meet it, as shape `shape_idx`.
    fn add_to(&self, builder: &mut SceneBuilder, shape_idx: u32) -> Result<(), EmbreeError> {
        match (&self.mesh, &self.solid) {
            (Some(mesh), _) => builder.add_mesh(mesh.clone(), shape_idx),
            (None, Some(solid)) => builder.add_solid(solid.clone(), shape_idx),
            (None, None) => Ok(()),
        }
    }

    /// A box round what light meets.
    fn bounds(&self) -> Option<Aabb> {
        self.mesh.as_ref().map(|mesh| mesh.bounds()).or_else(|| self.solid.as_ref().map(|solid| solid.bounds()))
    }

    /// Whether a point [m] is inside; a mesh that is not closed has no inside.
    fn contains(&self, p: DVec3) -> bool {
        match (&self.mesh, &self.sdf) {
            (Some(mesh), _) => mesh.report().is_closed() && mesh.contains(p),
            (None, Some(sdf)) => sdf.distance(p.to_array()) < 0.0,
            (None, None) => false,
        }
    }

    /// The shape where its motion has brought it at a time [s].
    fn at(&self, time: f64) -> Self {
        let Some(motion) = &self.motion else { return self.clone() };
        let placement = motion.placement(self.pivot, time);
        let moved = Similarity {
            scale: placement.scale as f32,
            rotation: placement.rotation.as_quat(),
            translation: placement.translation.as_vec3(),
        };
        let sdf =
            self.sdf.as_ref().map(|sdf| Arc::new(PlacedSdf::new(sdf.sdf().clone(), sdf.placement().then(&moved))));
        let solid = self.solid.as_ref().zip(sdf.as_ref()).and_then(|(solid, sdf)| solid.moved(sdf)).map(Arc::new);
        let mesh = self.mesh.as_ref().map(|mesh| Arc::new(mesh.transformed(&moved)));
        Self { sdf, solid, mesh, moved, motion: None, ..self.clone() }
    }
}

impl Geometry {
    /// Whether any shape moves.
    pub fn moves(&self) -> bool {
        self.shapes.iter().any(|shape| shape.motion.is_some())
    }

    /// All shapes where they are at a time [s].
    pub fn at(&self, time: f64) -> Self {
        Self { shapes: self.shapes.iter().map(|shape| shape.at(time)).collect(), warnings: Vec::new() }
    }

    /// As [`Geometry::at`], where those that move while a shutter is open are met at any [`Moment`](moment::Moment) of it.
    pub fn at_shutter(&self, shutter: &Shutter) -> Self {
        let mut placed = self.at(shutter.frame_time());
        for (i, shape) in placed.shapes.iter_mut().enumerate() {
            shape.swept = shape.bounds().and_then(|bounds| shutter.swept(i, &bounds));
        }
        placed
    }

    /// How all shapes move while the shutter is open between `open` [s], against the frame's own time [s].
    pub fn shutter(&self, frame_time: f64, open: [f64; 2]) -> Shutter {
        Shutter::new(self.shapes.iter().map(|shape| (shape.motion.clone(), shape.pivot)), frame_time, open)
    }

    /// Reads the meshes of a scene and samples the distances of those that the flow must go round.
    ///
    /// # Errors
    /// Where a mesh is missing, faulty or too large.
    pub fn build(scene: &Scene, progress: &dyn Progress) -> Result<Self, GeometryError> {
        Self::build_with(scene, progress, true)
    }

    /// As `build`, but no mesh has a distance, which is what takes time: for looking at a scene without making frames.
    ///
    /// # Errors
    /// Where a mesh is missing, faulty or too large.
    pub fn build_without_distances(scene: &Scene) -> Result<Self, GeometryError> {
        Self::build_with(scene, &Silent, false)
    }

    fn build_with(scene: &Scene, progress: &dyn Progress, with_distances: bool) -> Result<Self, GeometryError> {
        let mut geometry = Self { shapes: Vec::new(), warnings: Vec::new() };
        progress.begin(Stage::Geometry, scene.settings.shapes.len() as u64);
        for (name, shape) in &scene.settings.shapes {
            if progress.is_cancelled() {
                return Err(GeometryError::Cancelled);
            }
            let placement = similarity(&shape.transform);
            // The spaces inside of the shape's own that move it.
            let mut links = Vec::new();
            let built = match &shape.mesh {
                Some(mesh) => {
                    let (built, moved) = geometry.mesh_shape(scene, name, mesh, &placement, with_distances)?;
                    links = moved;
                    Shape { visible: shape.visible, ..built }
                }
                None => formula_shape(name, shape, placement),
            };
            let motion = match &shape.motion {
                Some(motion) => Some(rigid_motion(motion)),
                None if shape.transform.varies() || !links.is_empty() => {
                    links.insert(0, link(&shape.transform, &scene.settings.frames));
                    Some(Motion::of_links(links, built.pivot))
                }
                None => None,
            };
            geometry.shapes.push(Shape { motion: motion.map(Arc::new), ..built });
            progress.advance(1);
        }
        progress.end(Stage::Geometry);
        Ok(geometry)
    }

    fn mesh_shape(
        &mut self,
        scene: &Scene,
        name: &str,
        settings: &settings::Mesh,
        placement: &Similarity,
        with_distance: bool,
    ) -> Result<(Shape, Vec<Link>), GeometryError> {
        let limit = memory_limit(scene);
        let (mesh, links, warning) = read(scene, name, settings)?;
        check_course(scene, name, &settings.file, &links)?;
        self.warnings.extend(warning);
        // It rests where it is at the first of all keys.
        let inner = links.iter().rev().fold(Placement::IDENTITY, |inner, link| inner.within(&link.first()));
        let placement = &if links.is_empty() {
            *placement
        } else {
            Similarity {
                scale: inner.scale as f32,
                rotation: inner.rotation.as_quat(),
                translation: inner.translation.as_vec3(),
            }
            .then(placement)
        };
        let sdf = if with_distance && needs_distance(scene, name) {
            let spacing = settings.distance_voxel.map(|voxel| voxel / f64::from(placement.scale));
            let sampled = MeshSdf::sample(&mesh, spacing, limit)
                .map_err(|source| GeometryError::Distance { place: place(scene, name, "distance_voxel"), source })?;
            self.warnings.extend(thin_warning(scene, name, settings, &mesh, &sampled));
            Some(Arc::new(PlacedSdf::new(Sdf::Mesh(Arc::new(sampled)), *placement)))
        } else {
            None
        };
        let middle = placement.point_to_world(mesh.bounds().center());
        let pivot = sdf.as_ref().map_or(middle, |sdf: &Arc<PlacedSdf>| sdf.center()).0.as_dvec3();
        let mesh = if settings.smooth { mesh } else { mesh.without_normals() };
        let mesh = Some(Arc::new(mesh.transformed(placement)));
        let shape = Shape {
            name: name.into(),
            resting: sdf.clone(),
            sdf,
            motion: None,
            pivot,
            mesh,
            visible: true,
            moved: Similarity::IDENTITY,
            swept: None,
            solid: None,
        };
        Ok((shape, links))
    }

    /// A warning where the camera stands inside a visible solid at the first frame: a primitive, or a closed mesh.
    pub fn camera_warning(&self, scene: &Scene) -> Option<String> {
        let camera = keys(&scene.settings.camera.position, &scene.settings.frames, vector).at(0.0);
        // A container may be the room that the camera stands in.
        let is_seen = |shape: &Shape| {
            let settings = &scene.settings.shapes[&shape.name];
            // Nothing is hidden by glass, nor by the wall of a room that shines or is meant to be a hole.
            let hides = !settings.material.is_clear() && settings.material.emission().is_black() && !settings.holdout;
            shape.visible && hides && !settings.invisible_to_camera
        };
        let is_solid = |shape: &Shape| is_seen(shape) && !scene.settings.flow.holders().any(|name| *name == shape.name);
        let around = self.at(0.0).shapes.into_iter().find(|shape| is_solid(shape) && shape.contains(camera))?;
        let place = scene.place("camera.position");
        let is_plane = scene.settings.shapes.get(&around.name).is_some_and(|shape| shape.plane.is_some());
        let where_it_is = if is_plane { "behind the plane" } else { "inside the shape" };
        Some(format!(
            "warning: {place}the camera stands {where_it_is} `{name}`, whose surface hides everything; move the camera, or \
             hide the shape with `visible: false`",
            name = around.name
        ))
    }

    /// One shape alone as a target of rays, visible or not; `None` where there is no such shape, or none with an inside.
    ///
    /// # Errors
    /// Where it is a mesh with holes, and where the ray-tracing library is missing or fails.
    pub fn container(&self, name: &str) -> Result<Option<TraceScene>, GeometryError> {
        let Some(shape) = self.shapes.iter().find(|shape| shape.name == name) else { return Ok(None) };
        let mut builder = SceneBuilder::new();
        match (&shape.mesh, &shape.solid) {
            (Some(mesh), _) if mesh.report().is_closed() => builder.add_mesh(mesh.clone(), 0)?,
            (Some(mesh), _) => {
                return Err(GeometryError::Open { name: name.into(), report: mesh.report().to_string() });
            }
            (None, Some(solid)) => builder.add_solid(solid.clone(), 0)?,
            (None, None) => return Ok(None),
        }
        Ok(Some(builder.commit()?))
    }

    /// The visible shapes as a target of rays.
    ///
    /// # Errors
    /// Where the ray-tracing library is missing or fails; never without a visible shape.
    pub fn trace_scene(&self) -> Result<TraceScene, GeometryError> {
        let mut builder = SceneBuilder::new();
        for (i, shape) in self.shapes.iter().enumerate().filter(|(_, shape)| shape.visible) {
            if let Some(swept) = shape.swept {
                let mut alone = SceneBuilder::new();
                shape.add_to(&mut alone, i as u32)?;
                builder.add_moving(alone.commit()?, i as u32, swept);
                continue;
            }
            shape.add_to(&mut builder, i as u32)?;
        }
        Ok(builder.commit()?)
    }
}
/// A mesh as its file has it, and what is likely a mistake in it.
fn read(
    scene: &Scene,
    name: &str,
    settings: &settings::Mesh,
) -> Result<(Mesh, Vec<Link>, Option<String>), GeometryError> {
    let place = place(scene, name, "file");
    let (path, limit) = (scene.resolve(&settings.file), memory_limit(scene));
    let found = if gltf_file::is_gltf(&path) {
        read_body(&path, settings.node.as_deref(), limit)
    } else {
        read_mesh(&path, limit).map(|mesh| (mesh, Vec::new()))
    };
    let (mesh, links) = match found {
        Ok(found) => found,
        Err(source) => return Err(GeometryError::MeshFile { place, source }),
    };
    let report = mesh.report();
    let matters = needs_distance(scene, name) || report.was_inside_out || report.degenerate_triangles > 0;
    let warning = (!report.is_clean() && matters).then(|| format!("warning: {place}{} has {report}", settings.file));
    Ok((mesh, links, warning))
}

/// An error where the course that a file has for a shape is none for what the shape carries: as `transform` of the scene is checked.
fn check_course(scene: &Scene, name: &str, file: &str, links: &[Link]) -> Result<(), GeometryError> {
    let (what, advice) = if !scene.settings.carries(name) {
        return Ok(());
    } else if links.iter().any(|link| link.scale.varies()) {
        let what = "grow, and a shape that guides the flow, holds a volume or lets particles start cannot";
        (what, "remove the keys of scale from the file")
    } else if links.iter().any(|link| link.translation.jumps() || link.turn.jumps()) {
        let what = "jump, and a shape that guides the flow, holds a volume or lets particles start cannot, as its speed \
                    would be infinite";
        (what, "export the keys as linear ones (`LINEAR`), not in steps")
    } else {
        return Ok(());
    };
    Err(GeometryError::Animation {
        place: place(scene, name, "file"),
        file: file.into(),
        name: name.into(),
        what,
        advice,
    })
}

fn place(scene: &Scene, name: &str, key: &str) -> Box<PlaceInScene> {
    Box::new(scene.place(&format!("shapes.{name}.mesh.{key}")))
}

/// A warning where parts of a mesh are too thin for the samples of its distance.
fn thin_warning(
    scene: &Scene,
    name: &str,
    settings: &settings::Mesh,
    mesh: &Mesh,
    sampled: &MeshSdf,
) -> Option<String> {
    /// Of the volume; meshes of usual thickness have all of it within some per cent.
    const SEEN_MIN: f64 = 0.7;
    let volume = mesh.signed_volume();
    let seen = sampled.inside_samples() as f64 * sampled.spacing().powi(3) / volume;
    (mesh.report().is_closed() && seen < SEEN_MIN).then(|| {
        format!(
            "warning: {}{}: its distance, sampled every {:.3e} m, sees {:.0} % of its volume: parts that are thinner \
             than that let the flow through; make distance_voxel smaller",
            place(scene, name, "distance_voxel"),
            settings.file,
            sampled.spacing() * scale_of(scene, name),
            100.0 * seen
        )
    })
}

fn scale_of(scene: &Scene, name: &str) -> f64 {
    scene.settings.shapes.get(name).map_or(1.0, |shape| *shape.transform.scale.first())
}

/// Whether the flow, or what flows on it, needs the distance of a shape.
pub fn needs_distance(scene: &Scene, name: &str) -> bool {
    let has_flow = scene.settings.shapes.get(name).is_some_and(|shape| shape.surface_flow.is_some());
    has_flow || scene.settings.guides_flow(name)
}

fn memory_limit(scene: &Scene) -> u64 {
    (scene.settings.render.memory_limit_gib * f64::from(1 << 30)) as u64
}

fn formula_shape(name: &str, settings: &settings::Shape, placement: Similarity) -> Shape {
    let sdf = formula(settings).map(|sdf| Arc::new(PlacedSdf::new(sdf, placement)));
    let extent = settings.plane.as_ref().map_or(0.0, |plane| plane.extent);
    let solid = sdf.as_deref().and_then(|sdf| Solid::try_new(sdf, extent)).map(Arc::new);
    let pivot = sdf.as_ref().map_or(DVec3::ZERO, |sdf| sdf.center().0.as_dvec3());
    Shape {
        name: name.into(),
        resting: sdf.clone(),
        sdf,
        motion: None,
        pivot,
        mesh: None,
        visible: settings.visible,
        moved: Similarity::IDENTITY,
        swept: None,
        solid,
    }
}

/// The distance of a shape that has a formula, in its own space.
fn formula(shape: &settings::Shape) -> Option<Sdf> {
    if let Some(union) = &shape.smooth_union {
        let parts = union.parts.iter().filter_map(|part| Some((part_solid(part)?, similarity(&part.transform))));
        return Some(Sdf::SmoothUnion(Arc::new(SmoothUnion::new(parts, union.width))));
    }
    let solid = if let Some(s) = &shape.sphere {
        sphere(s)
    } else if let Some(s) = &shape.cuboid {
        cuboid(s)
    } else if let Some(s) = &shape.capsule {
        capsule(s)
    } else if let Some(s) = &shape.torus {
        torus(s)
    } else {
        let s = shape.plane.as_ref()?;
        Primitive::HalfSpace(HalfSpace { point: DVec3::from_array(s.point), normal: direction(s.normal) })
    };
    Some(Sdf::Primitive(solid))
}

fn part_solid(part: &settings::Part) -> Option<Primitive> {
    let round = part.sphere.as_ref().map(sphere).or_else(|| part.capsule.as_ref().map(capsule));
    round.or_else(|| part.cuboid.as_ref().map(cuboid)).or_else(|| part.torus.as_ref().map(torus))
}

fn sphere(s: &settings::Sphere) -> Primitive {
    Primitive::Sphere(Sphere { center: DVec3::from_array(s.center), radius: s.radius })
}

fn cuboid(s: &settings::Cuboid) -> Primitive {
    let half_size = DVec3::from_array(s.size) * 0.5;
    let rounding = s.rounding.clamp(0.0, half_size.min_element());
    Primitive::Cuboid(Cuboid { center: DVec3::from_array(s.center), half_size, rounding })
}

fn capsule(s: &settings::Capsule) -> Primitive {
    let [start, end] = [s.start, s.end].map(DVec3::from_array);
    Primitive::Capsule(Capsule { start, end, radius: s.radius })
}

fn torus(s: &settings::Torus) -> Primitive {
    Primitive::Torus(Torus {
        center: DVec3::from_array(s.center),
        axis: direction(s.axis),
        major_radius: s.major_radius,
        minor_radius: s.minor_radius,
    })
}

fn direction(v: settings::Vec3) -> DVec3 {
    DVec3::from_array(v).try_normalize().unwrap_or(DVec3::Y)
}

fn rigid_motion(settings: &settings::Motion) -> Motion {
    let keys = settings.keys.iter().map(|key| {
        let axis = DVec3::from_array(key.rotate_deg.axis).try_normalize().unwrap_or(DVec3::Y);
        let rotation = DQuat::from_axis_angle(axis, key.rotate_deg.angle.to_radians());
        (key.time, Pose { displacement: DVec3::from_array(key.translate), rotation })
    });
    Motion::through(Keys::new(keys.collect(), interpolation(settings.interpolation), false))
}

/// A value of a scene over time, each key made by `make`.
pub fn keys<T, U: Between + Clone>(
    keyed: &settings::Keyed<T>,
    frames: &settings::Frames,
    make: impl Fn(&T) -> U,
) -> Keys<U> {
    let keys = keyed.timed(frames).map(|(time, value)| (time, make(value)));
    Keys::new(keys.collect(), interpolation(keyed.interpolation()), keyed.repeats())
}

/// How a value of a scene gets from key to key.
pub fn interpolation(settings: settings::Interpolation) -> Interpolation {
    match settings {
        settings::Interpolation::Linear => Interpolation::Linear,
        settings::Interpolation::Ease => Interpolation::Ease,
        settings::Interpolation::Step => Interpolation::Step,
    }
}

/// Three numbers of a scene.
pub fn vector(v: &settings::Vec3) -> DVec3 {
    DVec3::from_array(*v)
}

/// The space of a shape over time.
fn link(transform: &settings::Transform, frames: &settings::Frames) -> Link {
    let turn = match &transform.quaternion {
        Some(quaternion) => keys(quaternion, frames, |q| Turn::Quaternion(quaternion_of(*q))),
        None => keys(&transform.rotate_deg, frames, |turn| Turn::About(direction(turn.axis), turn.angle.to_radians())),
    };
    Link {
        translation: keys(&transform.translate, frames, vector),
        turn,
        scale: keys(&transform.scale, frames, |s| *s),
    }
}

fn quaternion_of(q: [f64; 4]) -> DQuat {
    DQuat::from_vec4(glam::DVec4::from_array(q).normalize_or(glam::DVec4::W))
}

/// Where a transform puts a shape at the first keys.
fn similarity(transform: &settings::Transform) -> Similarity {
    let turn = transform.rotate_deg.first();
    let rotation = match (&transform.quaternion, turn.angle) {
        (Some(quaternion), _) => quaternion_of(*quaternion.first()).as_quat(),
        (None, 0.0) => Quat::IDENTITY,
        (None, angle) => Quat::from_axis_angle(direction(turn.axis).as_vec3().normalize(), angle.to_radians() as f32),
    };
    let translation = vector(transform.translate.first()).as_vec3();
    Similarity { scale: *transform.scale.first() as f32, rotation, translation }
}
