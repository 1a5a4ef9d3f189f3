//! The parts of a picture, and how they are put together: the same for a run of frames, which builds them one after the other, as
//! for one who looks on, where most are there already.

use crate::error::Error;
use crate::geometry::embree::TraceScene;
use crate::geometry::moment::Shutter;
use crate::geometry::{Geometry, GeometryError};
use crate::output::{self, OutputError};
use crate::pipeline::heat::Heat;
use crate::pipeline::smoke::{FrameSmoke, SmokeSource};
use crate::pipeline::{in_scene, memory_limit, time_of};
use crate::progress::Progress;
use crate::render::layers::Layer;
use crate::render::light::Light;
use crate::render::media::{Media, Volume};
use crate::render::medium::Medium;
use crate::render::motion::FrameMotion;
use crate::render::picture::Picture;
use crate::render::tiles::View;
use crate::render::world::World;
use crate::render::{self, RenderError, TextureStore};
use crate::scene::{Scene, settings};
use std::path::Path;

/// Builds the shapes, which say themselves when the stage begins and ends.
pub(super) fn build_geometry(scene: &Scene, progress: &dyn Progress) -> Result<Geometry, GeometryError> {
    let geometry = Geometry::build(scene, progress)?;
    geometry.warnings.iter().for_each(|warning| progress.note(warning));
    Ok(geometry)
}

/// Shapes where they are at a time [s], and while the shutter of that frame is open.
pub(super) fn placed(scene: &Scene, geometry: &Geometry, time: f64) -> Geometry {
    if geometry.moves() { geometry.at_shutter(&shutter_of(scene, geometry, time)) } else { geometry.clone() }
}

pub(super) fn load_textures(scene: &Scene) -> Result<TextureStore, Error> {
    TextureStore::load(scene, &|path| load_picture(path, memory_limit(scene)).map_err(Into::into))
        .map_err(|e| in_render(scene, e))
}

/// The scene's own lights at a time [s].
pub(super) fn load_lights(scene: &Scene, time: f64) -> Result<Vec<Light>, Error> {
    render::build_lights(scene, time, &|path| load_picture(path, memory_limit(scene)).map_err(Into::into))
        .map_err(|e| in_render(scene, e))
}

/// Everything that light meets but smoke, of shapes that are [`placed`], what rays find of them, and the lights of the same time [s].
pub(super) fn world_of(
    scene: &Scene,
    placed: &Geometry,
    surfaces: TraceScene,
    lights: Vec<Light>,
    textures: &mut TextureStore,
    time: f64,
) -> World {
    let materials = render::build_materials(scene, placed, textures, time);
    render::assemble_world(scene, placed, surfaces, lights, materials)
}

/// The smoke of a frame as light sees it.
pub(super) fn build_medium(scene: &Scene, frame: i32, smoke: FrameSmoke) -> Result<Option<Medium>, Error> {
    let build = || {
        let mut medium = render::build_medium(scene, smoke.density)?;
        if let (Some(medium), Some(glow)) = (&mut medium, smoke.glow) {
            render::kindle(medium, glow, smoke.is_unbound)?;
        }
        let detail = scene.settings.smoke.as_ref().and_then(|smoke| smoke.detail);
        if let (Some(medium), Some(detail)) = (&mut medium, detail) {
            render::add_detail(medium, &detail, time_of(scene, frame))?;
        }
        Ok(medium)
    };
    build().map_err(|e: RenderError| {
        let key = match e {
            RenderError::TooHot { .. } if smoke_heat(scene).is_some() => "smoke.blackbody",
            RenderError::TooHot { .. } => "smoke.file.emission_gain",
            RenderError::TooDenseForDetail { .. } => "smoke.detail",
            _ => "smoke.medium.extinction",
        };
        in_scene(scene, key, Some(frame), e)
    })
}

/// What the smoke of a scene gives off because it is hot.
pub(super) fn smoke_heat(scene: &Scene) -> Option<Heat> {
    scene.settings.smoke.as_ref().and_then(|smoke| Heat::new(smoke.blackbody, &smoke.medium))
}

/// What a picture of a frame is taken with, beside the world.
pub(super) struct Exposure<'a> {
    /// What the camera sees, and while what moves.
    pub view: View,
    /// What light flies through.
    pub media: Media<'a>,
    /// How things move to the next frame, where a layer shows it.
    pub motion: Option<FrameMotion<'a>>,
}

impl<'a> Exposure<'a> {
    /// Of `view`, with the shapes at rest and the smoke's source.
    pub fn new(
        scene: &Scene,
        frame: i32,
        mut view: View,
        geometry: &'a Geometry,
        source: &'a SmokeSource,
        medium: Option<&'a Medium>,
        volumes: &'a [Volume],
    ) -> Self {
        let time = time_of(scene, frame);
        render::take_time(&mut view, scene, shutter_of(scene, geometry, time));
        let motion = view.layers.contains(&Layer::Motion).then(|| frame_motion(scene, geometry, source, time));
        Self { view, media: Media::new(medium, volumes), motion }
    }
}

/// How shapes move while the shutter of a frame is open.
fn shutter_of(scene: &Scene, geometry: &Geometry, time: f64) -> Shutter {
    let frames = &scene.settings.frames;
    geometry.shutter(time, frames.shutter.map(|share| time + share / frames.fps))
}

/// How all things move from the frame at `time` [s] to the next.
fn frame_motion<'a>(scene: &Scene, geometry: &'a Geometry, smoke: &'a SmokeSource, time: f64) -> FrameMotion<'a> {
    let seconds = scene.settings.frames.fps.recip();
    let course = render::camera_course(scene);
    let mut motion = FrameMotion::new(geometry, smoke.flow().map(|flow| flow.span(time, seconds)), time, seconds);
    motion.next_camera = if course.varies() { course.at(time + seconds).ok() } else { None };
    motion
}

/// An error of surfaces and lights, with its place in the scene where a light or a texture is at fault.
pub(super) fn in_render(scene: &Scene, error: RenderError) -> Error {
    match error {
        RenderError::Texture { ref key, .. } => {
            let key = key.clone();
            in_scene(scene, &key, None, error)
        }
        RenderError::Light { light_idx, .. } => {
            let is_picture = matches!(scene.settings.lights.get(light_idx), Some(settings::Light::Environment(_)));
            let part = if is_picture { ".environment.file" } else { "" };
            in_scene(scene, &format!("lights[{light_idx}]{part}"), None, error)
        }
        _ => error.into(),
    }
}

fn load_picture(path: &Path, memory_limit: u64) -> Result<Picture, OutputError> {
    let image = output::read_image(path, memory_limit)?;
    let rgb = image.to_rgb("").ok_or_else(|| OutputError::Invalid {
        path: path.into(),
        format: "picture",
        problem: "it has no channels R, G and B".into(),
    })?;
    let [width, height] = image.data_size.map(|n| n as usize);
    Ok(Picture { width, height, pixels: rgb.into_iter().map(glam::Vec3::from).collect() })
}
