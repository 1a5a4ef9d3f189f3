//! The further layers of a picture: what each holds, and where it comes from.
//!
//! Most are means over the paths of a pixel, like the picture itself. Those that a mean would spoil (a depth between two
//! things is the depth of neither) are taken along the ray through the pixel's middle.

use crate::geometry::embree::Ray;
use crate::math::exact_sum::ExactSums;
use crate::render::camera::Camera;
use crate::render::color::Rgb;
use crate::render::cryptomatte::{self, Coverage};
use crate::render::film::{Contribution, Moments};
use crate::render::integrator::Integrator;
use crate::render::light_path::{GROUP_MAX, Passage};
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A further layer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Layer {
    /// Distance along the view axis to the first surface through the pixel's middle [m]; infinite where there is none.
    Depth,
    /// Where that surface is, in the world [m]; 0 where there is none.
    Position,
    /// Number of its shape, from 1 in the order of names; 0 where there is none.
    ShapeId,
    /// Share of light that the smoke before that surface lets through, along the ray through the pixel's middle.
    Transmittance,
    /// Distances along the view axis at which smoke begins, at which on average it stops the view, and at which it has
    /// stopped half of the view [m]; infinite where it does not.
    VolumeDepth,
    /// Normal of the first surface, mean over paths.
    Normal,
    /// Colour of the first surface or smoke, mean over paths.
    Albedo,
    /// How far what is seen first moves on the picture to the next frame [pixels], mean over paths that met something.
    Motion,
    /// Variance of the mean of the picture.
    Variance,
    /// Light that came one way.
    Light(Passage),
    /// Light of one group of sources: its name and its number.
    LightGroup(String, usize),
    /// Masks of shapes by name: names and numbers of all shapes, in order.
    Cryptomatte(Vec<String>),
    /// Scatterings of a path, mean over paths.
    Bounces,
    /// Null collisions of a path, mean over paths: how much work it was, and where bounds of the density are far from it.
    NullCollisions,
    /// Paths of the pixel.
    Samples,
}

/// How the numbers of a layer may be kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// Colour to look at.
    Color,
    /// Data: never rounded further than single precision.
    Data,
}

/// What the ray through the middle of a pixel meets.
#[derive(Debug, Clone, Copy)]
pub struct Middle {
    depth: f32,
    position: Vec3,
    shape_id: u32,
    transmittance: f32,
    volume_depth: [f32; 3],
}

impl Layer {
    /// Names of its channels in a file.
    pub fn channels(&self) -> Vec<String> {
        let parts =
            |name: &str, parts: &[&str]| -> Vec<String> { parts.iter().map(|part| format!("{name}.{part}")).collect() };
        match self {
            Self::Depth => vec!["Z".into()],
            Self::Position => parts("P", &["X", "Y", "Z"]),
            Self::ShapeId => vec!["shape_id".into()],
            Self::Transmittance => vec!["transmittance".into()],
            Self::VolumeDepth => parts("volume_depth", &["first", "mean", "half"]),
            Self::Normal => parts("N", &["X", "Y", "Z"]),
            Self::Albedo => parts("albedo", &["R", "G", "B"]),
            Self::Motion => parts("motion", &["X", "Y"]),
            Self::Variance => parts("variance", &["R", "G", "B"]),
            Self::Light(passage) => parts(passage.name(), &["R", "G", "B"]),
            Self::LightGroup(name, _) => parts(&format!("light_{name}"), &["R", "G", "B"]),
            Self::Cryptomatte(_) => (0..cryptomatte::RANKS / 2)
                .flat_map(|level| parts(&format!("{}{level:02}", cryptomatte::NAME), &["R", "G", "B", "A"]))
                .collect(),
            Self::Bounces => vec!["bounces".into()],
            Self::NullCollisions => vec!["null_collisions".into()],
            Self::Samples => vec!["samples".into()],
        }
    }

    /// How many channels it has.
    pub fn channel_count(&self) -> usize {
        match self {
            Self::Depth
            | Self::ShapeId
            | Self::Transmittance
            | Self::Bounces
            | Self::NullCollisions
            | Self::Samples => 1,
            Self::Cryptomatte(_) => 2 * cryptomatte::RANKS,
            Self::Motion => 2,
            _ => 3,
        }
    }

    /// How its numbers may be kept.
    pub fn precision(&self) -> Precision {
        match self {
            Self::Albedo | Self::Light(_) | Self::LightGroup(..) => Precision::Color,
            _ => Precision::Data,
        }
    }

    /// Whether it needs [`Middle`].
    pub fn is_of_the_middle(&self) -> bool {
        matches!(self, Self::Depth | Self::Position | Self::ShapeId | Self::Transmittance | Self::VolumeDepth)
    }

    /// Whether it needs the ways of light told apart.
    pub fn tells_ways(&self) -> bool {
        matches!(self, Self::Light(_) | Self::LightGroup(..))
    }

    /// What one path brings to it, for layers that are means over paths.
    #[inline]
    pub fn of_path(&self, path: &Contribution) -> Vec3 {
        match self {
            Self::Normal => path.normal,
            Self::Albedo => path.albedo,
            Self::Motion => path.motion,
            Self::Light(passage) => path.by_passage[*passage as usize],
            Self::LightGroup(_, group) => path.by_group[*group],
            Self::Bounces => Vec3::splat(path.bounces as f32),
            Self::NullCollisions => Vec3::splat(path.null_collisions as f32),
            _ => Vec3::ZERO,
        }
    }

    /// Its numbers at the end of `out`, as many as it has channels: from the mean over the paths of what each brought, the
    /// moments of the picture, the shapes that were met first, and the pixel's middle.
    pub fn finish(
        &self,
        mean: Vec3,
        moments: &Moments,
        coverage: &Coverage,
        middle: Option<&Middle>,
        out: &mut Vec<f32>,
    ) {
        let values = match (self, middle) {
            (Self::Cryptomatte(names), _) => {
                let ids: Vec<u32> = names.iter().map(|name| cryptomatte::id(name)).collect();
                out.extend(coverage.ranked(&ids, f64::from(moments.count())));
                return;
            }
            // The third number counts the paths that brought one.
            (Self::Motion, _) if mean.z > 0.0 => mean / mean.z,
            (Self::Variance, _) => moments.variance_of_mean(),
            (Self::Samples, _) => Vec3::splat(moments.count() as f32),
            (Self::Depth, Some(middle)) => Vec3::splat(middle.depth),
            (Self::Position, Some(middle)) => middle.position,
            (Self::ShapeId, Some(middle)) => Vec3::splat(middle.shape_id as f32),
            (Self::Transmittance, Some(middle)) => Vec3::splat(middle.transmittance),
            (Self::VolumeDepth, Some(middle)) => Vec3::from(middle.volume_depth),
            _ => mean,
        };
        out.extend(values.to_array().into_iter().take(self.channel_count()));
    }
}

impl Middle {
    /// How many numbers it is.
    pub const LENGTH: usize = 9;

    /// All of it as plain numbers.
    pub fn to_words(&self) -> [u32; Self::LENGTH] {
        let [x, y, z] = self.position.to_array();
        let [first, mean, half] = self.volume_depth;
        let [a, b, c, d, e, f, g, h] = [self.depth, x, y, z, self.transmittance, first, mean, half].map(f32::to_bits);
        [a, b, c, d, e, f, g, h, self.shape_id]
    }

    /// What [`to_words`](Self::to_words) has told.
    pub fn from_words(words: [u32; Self::LENGTH]) -> Self {
        let [depth, x, y, z, transmittance, first, mean, half, _] = words.map(f32::from_bits);
        let [.., shape_id] = words;
        let (position, volume_depth) = (Vec3::new(x, y, z), [first, mean, half]);
        Self { depth, position, shape_id, transmittance, volume_depth }
    }

    /// Looks along the ray through the middle of a pixel.
    pub fn look(integrator: &Integrator, camera: &Camera, ray: &Ray) -> Self {
        let hit = integrator.world.seen_by_camera(ray, integrator.moment);
        let end = hit.as_ref().map_or(f32::INFINITY, |hit| hit.t);
        let view = integrator.media.view_through(ray, end);
        let depth = |t: f32| if t.is_finite() { camera.depth(ray, t) } else { t };
        Self {
            depth: depth(end),
            position: hit.as_ref().map_or(Vec3::ZERO, |hit| hit.position.0),
            shape_id: hit.as_ref().map_or(0, |hit| hit.shape_idx + 1),
            transmittance: view.as_ref().map_or(1.0, |view| view.transmittance as f32),
            volume_depth: view
                .map_or([f32::INFINITY; 3], |view| [view.first, view.mean, view.half].map(|t| depth(t as f32))),
        }
    }
}

/// Sums of what the paths of a pixel bring to further layers.
#[derive(Debug, Clone)]
pub struct LayerSums(pub Vec<ExactSums<3>>);

impl LayerSums {
    /// Nothing yet.
    pub fn new(layers: &[Layer]) -> Self {
        Self(vec![Default::default(); layers.len()])
    }

    /// Adds one path.
    #[inline]
    pub fn add(&mut self, layers: &[Layer], path: &Contribution) {
        for (i, layer) in layers.iter().enumerate() {
            let value = layer.of_path(path);
            // Layers that are no means have none, and of ways of light a path goes few.
            if value != Vec3::ZERO {
                self.0[i].add(value.to_array().map(f64::from));
            }
        }
    }

    /// Means over `count` paths.
    pub fn means(&self, count: u32) -> impl Iterator<Item = Rgb> + '_ {
        let n = f64::from(count.max(1));
        self.0.iter().map(move |sums| Rgb::from_array(sums.to_f64().map(|sum| (sum / n) as f32)))
    }
}

/// The layers of all groups of lights: `emission` of surfaces and smoke, `other` of lights without a group, then the
/// named ones, which together are the picture.
///
/// # Panics
/// With more than [`GROUP_MAX`] groups in all.
pub fn group_layers(names: &[String]) -> Vec<Layer> {
    let all = ["emission", "other"].into_iter().chain(names.iter().map(String::as_str));
    let layers: Vec<Layer> = all.enumerate().map(|(i, name)| Layer::LightGroup(name.into(), i)).collect();
    assert!(layers.len() <= GROUP_MAX, "validation refuses so many groups");
    layers
}
