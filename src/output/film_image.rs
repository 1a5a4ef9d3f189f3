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
    let b = film.bounds;
    let mut image = Image::cropped(film.resolution, [b.x0, b.y0, b.x1, b.y1]);
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
    describe(&mut image, film, origin);
    for layer in &film.layers {
        if let Layer::Cryptomatte(names) = layer {
            for (key, text) in cryptomatte::attributes(names) {
                image.set_attribute(key, Attribute::Text(text));
            }
        }
    }
    image
}

fn describe(image: &mut Image, film: &Film, origin: &Origin) {
    let text = |s: &str| Attribute::Text(s.into());
    image.set_attribute("curlsmoke/version", text(env!("CARGO_PKG_VERSION")));
    image.set_attribute("curlsmoke/scene", text(&origin.scene_hash));
    image.set_attribute("curlsmoke/seed", text(&origin.seed.to_string()));
    image.set_attribute("curlsmoke/frame", Attribute::Int(origin.frame));
    image.set_attribute("curlsmoke/spp", Attribute::Int(film.spp.min(i32::MAX as u32) as i32));
    image.set_attribute("curlsmoke/shutter", Attribute::Float2(origin.shutter.map(|x| x as f32)));
    image.set_attribute("software", text(concat!("curlsmoke ", env!("CARGO_PKG_VERSION"))));
    // The name of linear light of Rec. 709 primaries among the colour spaces of the Color Interop Forum.
    image.set_attribute("colorInteropID", text("lin_rec709_scene"));
    image.set_attribute("worldToCamera", Attribute::Matrix(origin.camera.world_to_camera()));
    if let Some(matrix) = origin.camera.world_to_ndc() {
        image.set_attribute("worldToNDC", Attribute::Matrix(matrix));
    }
    image.set_attribute("framesPerSecond", Attribute::Rational((origin.fps * 1000.0).round() as i32, 1000));
}
