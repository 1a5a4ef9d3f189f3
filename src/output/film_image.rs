//! A finished film as a picture with named layers.

use crate::output::image::{Attribute, Image, SampleKind};
use crate::render::camera::Camera;
use crate::render::film::{Film, Pixel};

/// Which further layers a picture carries.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Layers {
    /// Channel `Z`: distance along the view axis to the first surface [m].
    pub depth: bool,
    /// Channels `N.X`, `N.Y`, `N.Z`: normal of the first surface.
    pub normal: bool,
    /// Channels `albedo.R`, `.G`, `.B`: colour of the first surface or smoke.
    pub albedo: bool,
    /// Channels `variance.R`, `.G`, `.B`: variance of the mean.
    pub variance: bool,
}

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

/// The film as a picture: `R G B A` first, in half precision unless `kind` says otherwise, then the layers asked for.
pub fn image_of_film(film: &Film, layers: Layers, kind: SampleKind, origin: &Origin) -> Image {
    let b = film.bounds;
    let mut image = Image::cropped(film.resolution, [b.x0, b.y0, b.x1, b.y1]);
    let rgb = |f: fn(&Pixel) -> glam::Vec3| film.pixels.iter().map(|p| f(p).to_array()).collect::<Vec<_>>();
    image.push_rgb("", kind, &rgb(|p| p.mean));
    image.push("A", kind, film.pixels.iter().map(|p| p.alpha).collect());
    if layers.depth {
        image.push("Z", SampleKind::Float, film.pixels.iter().map(|p| p.depth).collect());
    }
    if layers.normal {
        image.push_xyz("N", SampleKind::Float, &rgb(|p| p.normal));
    }
    if layers.albedo {
        image.push_rgb("albedo", kind, &rgb(|p| p.albedo));
    }
    if layers.variance {
        image.push_rgb("variance", SampleKind::Float, &rgb(|p| p.variance));
    }
    describe(&mut image, film, origin);
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
    image.set_attribute("worldToNDC", Attribute::Matrix(origin.camera.world_to_ndc()));
    image.set_attribute("framesPerSecond", Attribute::Rational((origin.fps * 1000.0).round() as i32, 1000));
}
