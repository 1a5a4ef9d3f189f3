//! All that light flies through, where volumes overlap as they like.
//!
//! Collisions with each volume happen by themselves. So the nearest of the volumes' own first collisions is distributed as the
//! first collision with their sum, and the volume that it belongs to is the one that scatters; transmittances multiply; what is
//! given off adds up along the flight. Volumes therefore know nothing of each other, and each is tracked as if it were alone.
//!
//! With tints (`chroma.rs`) all volumes are flown through by the same hero. A volume that was flown through before a nearer
//! collision was found has passed, or met, more than the flight did in the end. That stays in the probabilities of the
//! path: it is one of the things that may happen beyond the end, and all that may happen there adds up to 1 for every channel.

use crate::geometry::embree::Ray;
use crate::geometry::moment::Moment;
use crate::render::chroma::Chroma;
use crate::render::color::Rgb;
use crate::render::dense::{self, ViewThrough};
use crate::render::equiangular::{flight_density, optical_depth};
use crate::render::even::EvenMedium;
use crate::render::glow;
use crate::render::medium::{Matter, Medium};
use crate::render::sampler::Stream;
use crate::render::sun_shadow::{ShadowFor, Shadows};
use crate::render::through::{Column, view_through_all};
use crate::render::tracking::{
    Event, estimate_tinted_transmittance, estimate_transmittance, optical_distance, sample_collision,
};
use glam::Vec3;

/// A volume beside the smoke.
pub enum Volume {
    /// Density on voxels.
    Grid(Box<Medium>),
    /// Even density inside a surface.
    Even(EvenMedium),
}

/// All that light flies through.
#[derive(Clone, Copy, Default)]
pub struct Media<'a> {
    /// The smoke, if any.
    smoke: Option<&'a Medium>,
    /// What there is besides.
    volumes: &'a [Volume],
    /// Where shapes are that hold some of it.
    moment: Moment<'a>,
}

impl<'a> From<Option<&'a Medium>> for Media<'a> {
    fn from(smoke: Option<&'a Medium>) -> Self {
        Self { smoke, volumes: &[], moment: Moment::default() }
    }
}

/// One of the media.
#[derive(Clone, Copy)]
enum Each<'a> {
    Grid(&'a Medium),
    Even(Held<'a>),
}

/// Even matter in a shape that may be elsewhere than at the frame's own time. Shapes that hold matter keep their size, so that
/// distances are the same in the space in which the shape is still.
#[derive(Clone, Copy)]
struct Held<'a> {
    medium: &'a EvenMedium,
    moment: Moment<'a>,
}

impl Held<'_> {
    #[inline]
    fn ray(&self, ray: &Ray) -> Ray {
        let carried = self.medium.shape_idx.and_then(|shape_idx| self.moment.of(shape_idx));
        carried.map_or(*ray, |carried| carried.ray_back(ray))
    }
}

impl<'a> Media<'a> {
    /// Smoke and volumes.
    pub fn new(smoke: Option<&'a Medium>, volumes: &'a [Volume]) -> Self {
        Self { smoke, volumes, moment: Moment::default() }
    }

    /// The same where the shapes that hold some of it are elsewhere.
    #[inline]
    pub fn at(self, moment: Moment<'a>) -> Self {
        Self { moment, ..self }
    }

    /// Whether light flies through nothing.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.smoke.is_none() && self.volumes.is_empty()
    }

    fn each(&self) -> impl Iterator<Item = Each<'a>> {
        let moment = self.moment;
        let volumes = self.volumes.iter().map(move |volume| match volume {
            Volume::Grid(medium) => Each::Grid(medium),
            Volume::Even(medium) => Each::Even(Held { medium, moment }),
        });
        self.smoke.map(Each::Grid).into_iter().chain(volumes)
    }

    /// Where a path must reckon with extinction that has a colour, the ratios of its channels that it begins with.
    #[inline]
    pub fn tint(&self) -> Option<Vec3> {
        if self.volumes.is_empty() {
            return self.smoke.and_then(|medium| medium.tint);
        }
        self.each().any(|each| each.tint().is_some()).then_some(Vec3::ONE)
    }

    /// Whether the density of free flight is known: of smoke with a tint each channel has another, and along a ray through detail
    /// it has no closed form.
    #[inline]
    pub fn has_flight_density(&self) -> bool {
        let has = |medium: &Medium| medium.tint.is_none() && medium.has_exact_depths();
        self.smoke.is_none_or(has)
            && self.volumes.iter().all(|volume| match volume {
                Volume::Grid(medium) => has(medium),
                Volume::Even(medium) => medium.tint.is_none(),
            })
    }

    /// Whether any of it gives off light.
    #[inline]
    pub fn glows(&self) -> bool {
        if self.volumes.is_empty() {
            return self.smoke.is_some_and(Medium::glows);
        }
        self.each().any(|each| match each {
            Each::Grid(medium) => medium.glows(),
            Each::Even(held) => held.medium.emission != Rgb::ZERO,
        })
    }

    /// Samples where light that starts at the ray's origin first meets any of it before `t_max` [m], and what it meets there.
    /// Numbers and `chroma` are as for [`sample_collision`].
    #[inline]
    pub fn first_collision(
        &self,
        ray: &Ray,
        t_max: f32,
        u: f32,
        stream: &mut Stream,
        chroma: Option<&mut Chroma>,
    ) -> Option<(f32, &'a Matter)> {
        if !self.volumes.is_empty() {
            return self.nearest_collision(ray, t_max, u, stream, chroma);
        }
        let medium = self.smoke?;
        match sample_collision(medium, ray, t_max, u, stream, chroma) {
            Event::Collision { t } => Some((t, &medium.matter)),
            Event::Escape => None,
        }
    }

    #[inline(never)]
    fn nearest_collision(
        &self,
        ray: &Ray,
        t_max: f32,
        u: f32,
        stream: &mut Stream,
        mut chroma: Option<&mut Chroma>,
    ) -> Option<(f32, &'a Matter)> {
        let mut nearest = None;
        let mut end = t_max;
        // The number of the path's own decides for the first volume, those of the stream for the others.
        let mut u = Some(u);
        for each in self.each() {
            if let Some(chroma) = chroma.as_deref_mut() {
                chroma.enter(each.tint().unwrap_or(Vec3::ONE));
            }
            let u = u.take().unwrap_or_else(|| stream.uniform());
            let met = match each {
                Each::Grid(medium) => match sample_collision(medium, ray, end, u, stream, chroma.as_deref_mut()) {
                    Event::Collision { t } => Some(t),
                    Event::Escape => None,
                },
                Each::Even(held) => {
                    held.medium.sample_collision(&held.ray(ray), end, optical_distance(u), chroma.as_deref_mut())
                }
            };
            if let Some(t) = met {
                end = t;
                nearest = Some((t, each.matter()));
            }
        }
        nearest
    }

    /// Those with voxels, in order.
    pub fn grids(&self) -> impl Iterator<Item = &'a Medium> + Clone {
        let volumes = self.volumes.iter().filter_map(|volume| match volume {
            Volume::Grid(medium) => Some(&**medium),
            Volume::Even(_) => None,
        });
        self.smoke.into_iter().chain(volumes)
    }

    /// An unbiased estimate of the transmittance from the ray's origin to distance `t_max` [m]. `shadows` are those of
    /// [`Media::grids`] where the ray goes to a sun, and make it cheaper; without, each channel is in [0, 1].
    #[inline]
    pub fn transmittance(&self, ray: &Ray, t_max: f32, shadows: Shadows, stream: &mut Stream) -> Rgb {
        if self.volumes.is_empty() {
            let shadow = shadows.of_volume(0);
            return self.smoke.map_or(Vec3::ONE, |medium| grid_transmittance(medium, ray, t_max, shadow, stream));
        }
        // What is exact and costs little first: where nothing comes through, nothing else is asked.
        let even = self.each().map(|each| match each {
            Each::Even(held) => held.medium.transmittance(&held.ray(ray), t_max),
            Each::Grid(_) => Vec3::ONE,
        });
        let mut all = even.fold(Vec3::ONE, |a, b| a * b);
        for (i, medium) in self.grids().enumerate() {
            if all != Vec3::ZERO {
                let shadow = shadows.of_volume(i);
                all *= grid_transmittance(medium, ray, t_max, shadow, stream);
            }
        }
        all
    }

    /// Light given off towards the ray's origin between it and distance `end` [m], where the flight ended [W/(m² sr)].
    #[inline]
    pub fn collected(&self, ray: &Ray, end: f32, stream: &mut Stream) -> Rgb {
        if let (Some(medium), []) = (self.smoke, self.volumes) {
            return glow::collected(medium, ray, end, stream);
        }
        let of_each = |each: Each| match each {
            Each::Grid(medium) if medium.glows() => glow::collected(medium, ray, end, stream),
            Each::Even(held) if held.medium.emission != Rgb::ZERO => {
                held.medium.emission * held.medium.length_inside(&held.ray(ray), end) as f32
            }
            _ => Rgb::ZERO,
        };
        self.each().map(of_each).fold(Rgb::ZERO, |a, b| a + b)
    }

    /// The part of the ray before `t_max` in which there may be any of it: between these distances [m].
    pub fn range(&self, ray: &Ray, t_max: f32) -> Option<[f32; 2]> {
        self.each().filter_map(|each| each.range(ray, t_max)).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
    }

    /// Extinction coefficient [1/m] at distance `t` along a ray times the transmittance to there: the density of free flight,
    /// where [`Media::has_flight_density`].
    pub fn flight_density(&self, ray: &Ray, t: f32) -> f32 {
        match (self.smoke, self.volumes) {
            (Some(medium), []) => flight_density(medium, ray, t),
            _ => {
                let (sigma_t, tau) =
                    self.each().map(|each| each.at(ray, t)).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
                sigma_t * (-tau).exp() as f32
            }
        }
    }

    /// What a collision at distance `t` of the ray is with; chosen by the extinctions there where volumes overlap. `None` where
    /// there is nothing.
    pub fn met_at(&self, ray: &Ray, t: f32, stream: &mut Stream) -> Option<&'a Matter> {
        if self.volumes.is_empty() {
            return self.smoke.map(|medium| &medium.matter);
        }
        let (mut total, mut chosen) = (0.0, None);
        for each in self.each() {
            let sigma_t = each.sigma_t(ray, t);
            total += sigma_t;
            // Each replaces those before with its share of all so far.
            if sigma_t > 0.0 && stream.uniform() * total < sigma_t {
                chosen = Some(each.matter());
            }
        }
        chosen
    }

    /// What it does to the view along the ray up to distance `end` [m]; `None` where there is nothing at all.
    pub fn view_through(&self, ray: &Ray, end: f32) -> Option<ViewThrough> {
        match (self.smoke, self.volumes) {
            (None, []) => None,
            (Some(medium), []) => Some(dense::view_through(medium, ray, end)),
            _ => {
                let columns = self.each().map(|each| match each {
                    Each::Grid(medium) => Column::of_grid(medium, ray, end),
                    Each::Even(held) => Column::of_even(held.medium, &held.ray(ray), end),
                });
                Some(view_through_all(&columns.collect::<Vec<_>>()))
            }
        }
    }
}

impl<'a> Each<'a> {
    fn tint(self) -> Option<Vec3> {
        match self {
            Self::Grid(medium) => medium.tint,
            Self::Even(held) => held.medium.tint,
        }
    }

    fn matter(self) -> &'a Matter {
        match self {
            Self::Grid(medium) => &medium.matter,
            Self::Even(held) => &held.medium.matter,
        }
    }

    fn range(self, ray: &Ray, t_max: f32) -> Option<[f32; 2]> {
        match self {
            Self::Grid(medium) => medium.range(ray, t_max),
            Self::Even(held) => {
                let mut pieces = held.medium.pieces(&held.ray(ray), t_max);
                let first = pieces.next()?;
                Some([first[0], pieces.last().map_or(first[1], |last| last[1])])
            }
        }
    }

    /// Extinction coefficient at distance `t` of the ray [1/m], and the optical depth to there.
    fn at(self, ray: &Ray, t: f32) -> (f32, f64) {
        match self {
            Self::Grid(medium) => (self.sigma_t(ray, t), optical_depth(medium, ray, t)),
            Self::Even(held) => held.medium.at(&held.ray(ray), t),
        }
    }

    /// Extinction coefficient at distance `t` of the ray [1/m].
    fn sigma_t(self, ray: &Ray, t: f32) -> f32 {
        match self {
            Self::Grid(medium) => medium.sigma_t(medium.ray_to_index(ray).at(t)),
            Self::Even(held) => held.medium.at(&held.ray(ray), t).0,
        }
    }
}

fn grid_transmittance(medium: &Medium, ray: &Ray, t_max: f32, shadow: Option<ShadowFor>, stream: &mut Stream) -> Rgb {
    if let Some(shadow) = shadow {
        return Vec3::splat(shadow.estimate_transmittance(medium, ray, stream));
    }
    match medium.tint {
        None => Vec3::splat(estimate_transmittance(medium, ray, t_max, stream)),
        Some(ratios) => estimate_tinted_transmittance(medium, ratios, ray, t_max, stream),
    }
}
