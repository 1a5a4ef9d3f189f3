//! The volumes of a scene, frame by frame.

use crate::error::Error;
use crate::geometry::Geometry;
use crate::geometry::embree::TraceScene;
use crate::output::sidecar::Sidecar;
use crate::pipeline::heat::Heat;
use crate::pipeline::smoke::DensityFiles;
use crate::pipeline::{grid_memory_limit, in_scene, time_of};
use crate::progress::Progress;
use crate::render;
use crate::render::media::Volume;
use crate::scene::{Scene, settings};
use std::sync::Arc;

/// Where a volume of the scene comes from.
enum Source {
    File(DensityFiles),
    /// A shape at rest.
    Resting(Arc<TraceScene>),
    /// A shape that moves, by its name.
    Moving(String),
}

/// Where the volumes of a scene come from, in the order of their names.
pub(super) struct VolumeSources(Vec<Source>);

impl VolumeSources {
    pub(super) fn build(scene: &Scene, geometry: &Geometry) -> Result<Self, Error> {
        let sources = scene.settings.volumes.iter().map(|(name, volume)| match (&volume.file, &volume.inside) {
            (Some(file), _) => Ok(Source::File(DensityFiles::new(file)?)),
            (None, Some(shape)) => {
                // Also of one that moves: whether it is closed is told before anything is made.
                let container = container(scene, geometry, name, shape)?;
                let moves = geometry.shapes.iter().any(|s| s.name == *shape && s.motion.is_some());
                Ok(if moves { Source::Moving(shape.clone()) } else { Source::Resting(container) })
            }
            (None, None) => Err(Error::Internal("a volume without a source".into())),
        });
        sources.collect::<Result<_, _>>().map(Self)
    }

    /// The volumes of a frame, within what memory the smoke leaves.
    pub(super) fn at_frame(
        &self,
        scene: &Scene,
        geometry: &Geometry,
        frame: i32,
        progress: &dyn Progress,
        record: &mut Sidecar,
    ) -> Result<Vec<Volume>, Error> {
        let sources = self.0.iter().zip(&scene.settings.volumes);
        let mut placed: Option<Geometry> = None;
        sources
            .map(|(source, (name, volume))| match source {
                Source::File(file) => file_volume(scene, frame, name, volume, file, progress, record),
                Source::Resting(container) => even_volume(scene, name, volume, container.clone()),
                Source::Moving(shape) => {
                    let placed = placed.get_or_insert_with(|| geometry.at(time_of(scene, frame)));
                    let mut made = even_volume(scene, name, volume, container(scene, placed, name, shape)?)?;
                    if let Volume::Even(medium) = &mut made {
                        let shape_idx = geometry.shapes.iter().position(|known| known.name == *shape);
                        medium.shape_idx = shape_idx.map(|i| i as u32);
                    }
                    Ok(made)
                }
            })
            .collect()
    }
}

fn container(scene: &Scene, geometry: &Geometry, name: &str, shape: &str) -> Result<Arc<TraceScene>, Error> {
    let container =
        geometry.container(shape).map_err(|e| in_scene(scene, &format!("volumes.{name}.inside"), None, e))?;
    let container = container.ok_or_else(|| Error::Internal(format!("the shape `{shape}` has no inside")))?;
    Ok(Arc::new(container))
}

fn even_volume(
    scene: &Scene,
    name: &str,
    volume: &settings::Volume,
    container: Arc<TraceScene>,
) -> Result<Volume, Error> {
    let medium = render::even_medium(volume, container);
    medium.map(Volume::Even).map_err(|e| in_scene(scene, &format!("volumes.{name}.medium"), None, e))
}

fn file_volume(
    scene: &Scene,
    frame: i32,
    name: &str,
    volume: &settings::Volume,
    file: &DensityFiles,
    progress: &dyn Progress,
    record: &mut Sidecar,
) -> Result<Volume, Error> {
    let key = format!("volumes.{name}");
    let heat = Heat::new(volume.blackbody, &volume.medium);
    // Particles in batches are gone by now.
    let has_batches = scene.settings.smoke.as_ref().is_some_and(|smoke| smoke.advect.batch.is_some());
    let held_count = if has_batches { 0 } else { record.particles as usize };
    let limit = grid_memory_limit(scene, held_count).saturating_sub(record.grid.bytes);
    let smoke = file.read(scene, frame, heat.as_ref(), &key, limit, progress, record)?.remapped(volume.remap);
    record.grid.active_voxels += smoke.density.active_voxel_count();
    record.grid.bytes += smoke.memory_bytes();
    let mut medium = render::grid_medium(&volume.medium, smoke.density)
        .map_err(|e| in_scene(scene, &format!("{key}.medium"), Some(frame), e))?;
    medium.matter.is_carried = false;
    if let Some(glow) = smoke.glow {
        render::kindle(&mut medium, glow, smoke.is_unbound).map_err(|e| in_scene(scene, &key, Some(frame), e))?;
    }
    if let Some(detail) = &volume.detail {
        render::add_detail(&mut medium, detail, time_of(scene, frame))
            .map_err(|e| in_scene(scene, &format!("{key}.detail"), Some(frame), e))?;
    }
    Ok(Volume::Grid(Box::new(medium)))
}
