//! A finished film as a picture with named layers.

use crate::output::image::{Attribute, Image, SampleKind};
use crate::render::camera::Camera;
use crate::render::cryptomatte;
use crate::render::film::Film;
use crate::render::layers::{Layer, Precision};

/// What a picture says of its making. Nothing of it depends on the machine or the hour.
#[derive(Debug, Clone)]
pub struct Origin {
    /// Fingerprint of the scene and everything it refers to.
    pub scene_hash: String,
    /// Seed of the scene.
    pub seed: u64,
    /// Number of the frame.
    pub frame: i32,
    /// Frames per second.
    pub fps: f64,
    /// Shutter, in frames relative to the frame.
    pub shutter: [f64; 2],
    /// Where it was taken from.
    pub camera: Camera,
}

/// The film as a picture: `R G B A` first, in half precision unless `kind` says otherwise, then its layers.
pub fn image_of_film(film: &Film, kind: SampleKind, origin: &Origin) -> Image {
    image_with(film, kind, attributes(film.spp, &film.layers, origin))
}

/// The windows of a film's picture, without any channels.
pub fn frame_of(film: &Film) -> Image {
    let b = film.bounds;
    Image::cropped(film.resolution, [b.x0, b.y0, b.x1, b.y1])
}

/// As [`image_of_film`], with [`attributes`] that are known already.
pub fn image_with(film: &Film, kind: SampleKind, attributes: Vec<(String, Attribute)>) -> Image {
    let mut image = frame_of(film);
    image.push_rgb("", kind, &film.pixels.iter().map(|p| p.mean.to_array()).collect::<Vec<_>>());
    image.push("A", kind, film.pixels.iter().map(|p| p.alpha).collect());
    let channels: Vec<(String, SampleKind)> = film
        .layers
        .iter()
        .flat_map(|layer| {
            let kind = if layer.precision() == Precision::Color { kind } else { SampleKind::Float };
            layer.channels().into_iter().map(move |name| (name, kind))
        })
        .collect();
    let stride = channels.len();
    for (i, (name, kind)) in channels.into_iter().enumerate() {
        image.push(name, kind, film.layer_data.iter().skip(i).step_by(stride).copied().collect());
    }
    attributes.into_iter().for_each(|(key, value)| image.set_attribute(key, value));
    image
}

/// What a picture says of itself, with at most `spp` paths a pixel.
pub fn attributes(spp: u32, layers: &[Layer], origin: &Origin) -> Vec<(String, Attribute)> {
    let text = |s: &str| Attribute::Text(s.into());
    let mut all = vec![
        ("curlsmoke/version", text(env!("CARGO_PKG_VERSION"))),
        ("curlsmoke/scene", text(&origin.scene_hash)),
        ("curlsmoke/seed", text(&origin.seed.to_string())),
        ("curlsmoke/frame", Attribute::Int(origin.frame)),
        ("curlsmoke/spp", Attribute::Int(spp.min(i32::MAX as u32) as i32)),
        ("curlsmoke/shutter", Attribute::Float2(origin.shutter.map(|x| x as f32))),
        ("software", text(concat!("curlsmoke ", env!("CARGO_PKG_VERSION")))),
        // The name of linear light of Rec. 709 primaries among the colour spaces of the Color Interop Forum.
        ("colorInteropID", text("lin_rec709_scene")),
        ("worldToCamera", Attribute::Matrix(origin.camera.world_to_camera())),
    ];
    all.extend(origin.camera.world_to_ndc().map(|matrix| ("worldToNDC", Attribute::Matrix(matrix))));
    all.push(("framesPerSecond", Attribute::Rational((origin.fps * 1000.0).round() as i32, 1000)));
    let mut all: Vec<(String, Attribute)> = all.into_iter().map(|(key, value)| (key.to_string(), value)).collect();
    for layer in layers {
        if let Layer::Cryptomatte(names) = layer {
            all.extend(cryptomatte::attributes(names).into_iter().map(|(key, text)| (key, Attribute::Text(text))));
        }
    }
    all
}
