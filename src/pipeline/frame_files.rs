//! The files of a frame: their names, whether they are finished, and how they are written.

use crate::error::Error;
use crate::math::parallel;
use crate::output::exr::Layout;
use crate::output::film_image::{Origin, attributes, frame_of, image_with};
use crate::output::image::SampleKind;
use crate::output::part::{self, Finish, PartFile};
use crate::output::sidecar::{self, Sidecar, sidecar_path};
use crate::output::{OutputError, exr, file, png};
use crate::pipeline::keeper::Keeper;
use crate::pipeline::{memory_limit, parse_pattern};
use crate::progress::{Progress, Stage};
use crate::render;
use crate::render::film::Film;
use crate::render::layers::Layer;
use crate::render::ledger::Tile;
use crate::render::tiles::View;
use crate::scene::Scene;
use crate::scene::pattern::Pattern;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Largest number of half precision.
const HALF_MAX: f32 = 65504.0;

/// Makes sure that a sequence can be written, from the files of each frame: the first and the last are tried, and none
/// may be the name of a folder.
pub(super) fn check_writable<F>(frames: impl ExactSizeIterator<Item = F>) -> Result<(), OutputError>
where
    F: IntoIterator<Item = PathBuf>,
{
    let last = frames.len().saturating_sub(1);
    for (i, files) in frames.enumerate() {
        let is_tried = i == 0 || i == last;
        files
            .into_iter()
            .try_for_each(|path| if is_tried { file::check_writable(&path) } else { file::check_no_folder(&path) })?;
    }
    Ok(())
}

/// Names of a sequence's files.
pub(super) struct OutputFiles {
    image: Pattern,
    preview: Option<Pattern>,
    scene_name: String,
    /// Layers with files of their own.
    layers: Vec<String>,
    /// The part of the paths that goes to a file of its own, if it is one.
    samples: Option<[u32; 2]>,
    memory_limit: u64,
}

/// Where a picture goes.
pub(super) struct Target {
    pub(super) image: PathBuf,
    /// Layers with files of their own.
    pub(super) layers: Vec<(String, PathBuf)>,
    pub(super) preview: Option<PathBuf>,
}

impl OutputFiles {
    pub(super) fn new(scene: &Scene, samples: Option<[u32; 2]>) -> Result<Self, Error> {
        let output = &scene.settings.output;
        Ok(Self {
            image: parse_pattern(&output.image)?,
            preview: output.preview.as_deref().map(parse_pattern).transpose()?,
            scene_name: scene.name().into(),
            layers: layers_apart(output.layout.into(), &render::layers(&scene.settings)),
            samples,
            memory_limit: memory_limit(scene),
        })
    }

    pub(super) fn image(&self, frame: i32) -> PathBuf {
        self.image.expand(frame, &self.scene_name).into()
    }

    pub(super) fn target(&self, frame: i32) -> Target {
        let preview = self.preview.as_ref().map(|p| p.expand(frame, &self.scene_name).into());
        let layers = layer_files(&self.image, &self.layers, frame, &self.scene_name);
        Target { image: self.image(frame), layers, preview }
    }

    /// The file of a part of the paths, where this is one: beside the picture, with the paths in its name.
    fn part(&self, frame: i32) -> Option<PathBuf> {
        let [first, last] = self.samples?;
        Some(self.image(frame).with_extension(format!("samples-{first}-{last}.part")))
    }

    /// The file to go on from.
    pub(super) fn checkpoint(&self, frame: i32) -> PathBuf {
        self.part(frame).unwrap_or_else(|| self.image(frame)).with_extension("checkpoint")
    }

    /// A picture of what is done so far.
    pub(super) fn snapshot(&self, frame: i32) -> Target {
        let image = self.part(frame).unwrap_or_else(|| self.image(frame));
        let preview = Some(image.with_extension("snapshot.png"));
        Target { image: image.with_extension("snapshot.exr"), layers: Vec::new(), preview }
    }

    /// All files of a frame but the sidecar, the picture first.
    fn of_frame(&self, frame: i32) -> Vec<PathBuf> {
        let target = self.target(frame);
        let layers = target.layers.into_iter().map(|(_, path)| path);
        [target.image].into_iter().chain(layers).chain(target.preview).collect()
    }

    /// All files of a frame that will be written.
    pub(super) fn to_write(&self, frame: i32) -> Vec<PathBuf> {
        match self.part(frame) {
            Some(part) => vec![part],
            None => self.of_frame(frame).into_iter().chain([sidecar_path(&self.image(frame))]).collect(),
        }
    }

    /// Whether a frame is finished, made from what has this fingerprint.
    pub(super) fn is_complete(&self, frame: i32, fingerprint: &str) -> bool {
        match self.part(frame) {
            Some(part) => PartFile::open(&part, self.memory_limit)
                .is_ok_and(|part| part.head.record.fingerprint == fingerprint && part.head.samples == self.samples),
            None => sidecar::is_complete(&sidecar_path(&self.image(frame)), fingerprint, &self.of_frame(frame)),
        }
    }
}

/// What a picture of a scene is written with.
pub(super) fn finish_of(scene: &Scene, view: &View, record: &Sidecar) -> Finish {
    let settings = &scene.settings;
    let origin = Origin {
        scene_hash: record.fingerprint.clone(),
        seed: settings.render.seed,
        frame: record.frame,
        fps: settings.frames.fps,
        shutter: settings.frames.shutter,
        camera: view.camera.clone(),
    };
    let output = &settings.output;
    Finish {
        attributes: attributes(record.spp, &view.layers, &origin),
        compression: output.compression.into(),
        layout: output.layout.into(),
        preview: output.preview.as_ref().map(|_| (output.view, output.exposure_ev)),
    }
}

/// Writes a picture, its preview and its sidecar; the name of the picture.
pub(super) fn write_picture(
    target: &Target,
    film: Film,
    finish: Finish,
    progress: &dyn Progress,
    record: &mut Sidecar,
) -> Result<PathBuf, Error> {
    let cut = film.pixels.iter().filter(|pixel| pixel.mean.max_element() > HALF_MAX).count();
    if cut > 0 {
        progress.note(&format!(
            "frame {}: {cut} pixels are brighter than {HALF_MAX} W/(m² sr), the most that the picture's half precision holds, and \
             are cut there; dim the lights that are seen, or hide them with `visible: false`",
            record.frame
        ));
    }
    let sidecar_file = sidecar_path(&target.image);
    let start = Instant::now();
    progress.begin(Stage::Write, 0);
    for (path, bytes) in &encode(target, film, finish)? {
        file::write_atomic(path, bytes)?;
        record.add_file(&sidecar_file, path, bytes);
    }
    progress.end(Stage::Write);
    record.add_time(Stage::Write, start.elapsed());
    complete(record);
    // Last: where it stands, the frame is whole.
    record.write(&sidecar_file)?;
    Ok(target.image.clone())
}

/// Writes the file of a part of the paths; its name.
pub(super) fn write_part(
    keeper: &Keeper,
    files: &OutputFiles,
    tiles: &[Option<Arc<Tile>>],
    progress: &dyn Progress,
    record: &mut Sidecar,
) -> Result<PathBuf, Error> {
    let path = files.part(record.frame).ok_or_else(|| Error::Internal("a part without its paths".into()))?;
    complete(record);
    progress.begin(Stage::Write, 0);
    part::write(&path, &part::Head { record: record.clone(), ..keeper.head().clone() }, tiles)?;
    progress.end(Stage::Write);
    Ok(path)
}

/// Notes what is known at the end.
fn complete(record: &mut Sidecar) {
    record.memory_peak = sidecar::memory_peak();
    record.host = sidecar::this_host(parallel::thread_count());
}

/// The files of a picture: names and contents.
pub(super) fn encode(target: &Target, film: Film, finish: Finish) -> Result<Vec<(PathBuf, Vec<u8>)>, OutputError> {
    let preview = target.preview.as_ref().zip(finish.preview);
    let preview = preview.map(|(path, (view, exposure))| {
        let rgb: Vec<[f32; 3]> = film.pixels.iter().map(|p| p.mean.to_array()).collect();
        let (size, rgb) = frame_of(&film).shown(&rgb);
        let bytes = png::encode(&rgb, size, view, exposure)?;
        Ok::<_, OutputError>((path.clone(), bytes))
    });
    let preview = preview.transpose()?;
    let image = image_with(&film, SampleKind::Half, finish.attributes);
    // The picture takes as much again, and the encoder more.
    drop(film);
    let mut files = Vec::new();
    match finish.layout {
        Layout::Single => files.push((target.image.clone(), exr::write(&image, finish.compression)?)),
        Layout::Multipart => files.push((target.image.clone(), exr::write_parts(&image, finish.compression)?)),
        Layout::Separate => {
            for (name, layer) in exr::split(&image) {
                let own = target.layers.iter().find(|(known, _)| *known == name).map(|(_, path)| path);
                files.push((own.unwrap_or(&target.image).clone(), exr::write(&layer, finish.compression)?));
            }
        }
    }
    files.extend(preview);
    Ok(files)
}

/// Names of the layers that have files of their own.
pub(super) fn layers_apart(layout: Layout, layers: &[Layer]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    if layout == Layout::Separate {
        for channel in layers.iter().flat_map(Layer::channels) {
            let name = exr::part_of(&channel);
            if !names.iter().any(|known| known == name) {
                names.push(name.into());
            }
        }
    }
    names
}

/// The files of layers at a frame, where pictures have names of `pattern`.
pub(super) fn layer_files(pattern: &Pattern, layers: &[String], frame: i32, scene: &str) -> Vec<(String, PathBuf)> {
    let file = |layer: &String| (layer.clone(), pattern.of_layer(layer).expand(frame, scene).into());
    layers.iter().map(file).collect()
}

/// Name of a file without its folder.
pub(super) fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
