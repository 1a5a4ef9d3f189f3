//! Everything that light meets but smoke: surfaces, materials and lights, and which light is asked for a connection.

use crate::geometry::embree::{Hit, Ray, TraceScene};
use crate::geometry::moment::Moment;
use crate::math::space::{UnitVec3, WorldPoint};
use crate::render::choice::LightChoice;
use crate::render::color::Rgb;
use crate::render::light::{Light, LightSample};
use crate::render::light_path::OTHER_GROUP;
use crate::render::material::{Material, Sight};
use crate::render::surface_light::SurfaceLight;

/// Surfaces that a ray passes before it counts as lost among them: an end for rays that rounding holds in a place.
const SURFACES_PASSED_MAX: u32 = 10_000;

/// Everything that light meets, but for the smoke, which changes from frame to frame.
pub struct World {
    /// Surfaces.
    pub surfaces: TraceScene,
    /// Material of each shape, by shape index.
    pub materials: Vec<Material>,
    /// Light sources.
    pub lights: Vec<Light>,
    /// Number of the group of each light.
    pub groups: Vec<usize>,
    /// Those lights that have a place, but no surface among `surfaces`, and an extent: rays meet them.
    met: Vec<u32>,
    /// Those lights that have a place.
    lamps: Vec<u32>,
    /// Which light a shape is, for those that are.
    light_of_shape: Vec<Option<u32>>,
    choice: LightChoice,
    /// Whether a connection depends on random numbers: not where the only light is a direction or a point.
    pub asks_by_chance: bool,
}

/// A light that a ray meets.
#[derive(Debug, Clone, Copy)]
pub struct MetLight {
    /// Distance along the ray [m].
    pub t: f32,
    /// Radiance towards the ray's origin [W/(m² sr)].
    pub radiance: Rgb,
    /// Density [1/sr] with which the light itself would have been sampled here.
    pub pdf: f32,
    /// Which.
    pub light_idx: usize,
}

impl World {
    /// Puts surfaces and lights together.
    pub fn new(surfaces: TraceScene, materials: Vec<Material>, lights: Vec<Light>) -> Self {
        let indices = |test: &dyn Fn(&Light) -> bool| {
            (0..lights.len() as u32).filter(|&i| test(&lights[i as usize])).collect::<Vec<_>>()
        };
        let met = indices(&|light| matches!(light, Light::Panel(_) | Light::Ball(_)));
        let lamps = indices(&|light| light.place().is_some() && light.peak_intensity() > 0.0);
        let mut light_of_shape = vec![None; materials.len()];
        for (i, light) in lights.iter().enumerate() {
            if let Light::Surface(surface) = light {
                light_of_shape[surface.shape_idx as usize] = Some(i as u32);
            }
        }
        let choice = LightChoice::new(&lights);
        let asks_by_chance = choice.only().is_none_or(|i| lights[i].has_extent());
        let groups = vec![OTHER_GROUP; lights.len()];
        Self { surfaces, materials, lights, groups, met, lamps, light_of_shape, choice, asks_by_chance }
    }

    /// The nearest surface that a ray of the camera meets at a moment.
    #[inline]
    pub fn seen_by_camera(&self, ray: &Ray, moment: Moment) -> Option<Hit> {
        self.first_hit(ray, f32::INFINITY, moment, |material| material.sight != Sight::Through)
    }

    /// The nearest surface before `t_max` of a material that `stops` the ray; others are as if they were not there.
    #[inline]
    fn first_hit(&self, ray: &Ray, t_max: f32, moment: Moment, stops: impl Fn(&Material) -> bool) -> Option<Hit> {
        let (mut start, mut passed) = (*ray, 0.0);
        for _ in 0..SURFACES_PASSED_MAX {
            let mut hit = self.surfaces.intersect_at(&start, 0.0, t_max - passed, moment)?;
            hit.t += passed;
            if stops(&self.materials[hit.shape_idx as usize]) {
                return Some(hit);
            }
            passed = hit.t;
            start = Ray { origin: hit.offset_origin(ray.direction), direction: ray.direction };
        }
        None
    }

    /// What would be in the way if there were lights and shadow catchers only: the nearest of the latter, before `t_max`.
    pub fn nearest_catcher(&self, ray: &Ray, t_max: f32, moment: Moment) -> Option<Hit> {
        self.first_hit(ray, t_max, moment, |material| material.sight == Sight::Shadow)
    }

    /// The light chosen at a lit point by the uniform number `u`, and the probability of that.
    #[inline]
    pub fn choose_light(&self, at: WorldPoint, u: f32) -> Option<(usize, f32)> {
        self.choice.choose(&self.lights, at, u)
    }

    /// Probability of choosing light `i` at a lit point.
    #[inline]
    pub fn pmf(&self, at: WorldPoint, i: usize) -> f32 {
        self.choice.pmf(&self.lights, at, i)
    }

    /// Lights that have a place, by index.
    #[inline]
    pub fn lamps(&self) -> &[u32] {
        &self.lamps
    }

    /// Lets no flight be lit at a distance taken for a lamp near it: the same light with more noise, to measure against.
    pub fn forget_lamps(&mut self) {
        self.lamps.clear();
    }

    /// The nearest light that the ray meets before `t_max`, but for surfaces; `is_camera` for rays that the camera sends.
    #[inline]
    pub fn nearest_light(&self, ray: &Ray, t_max: f32, is_camera: bool) -> Option<MetLight> {
        if self.met.is_empty() {
            return None;
        }
        let hits = self.met.iter().filter_map(|&i| {
            let light = &self.lights[i as usize];
            let hit = light.intersect(ray).filter(|hit| hit.t < t_max && (light.is_visible() || !is_camera))?;
            Some(MetLight { t: hit.t, radiance: hit.radiance, pdf: hit.pdf, light_idx: i as usize })
        });
        hits.min_by(|a, b| a.t.total_cmp(&b.t))
    }

    /// A direction from `from` towards light `i` at a moment, from two uniform numbers; `None` where no light comes from it.
    #[inline(always)]
    pub fn sample_light(&self, i: usize, from: WorldPoint, u: [f32; 2], moment: Moment) -> Option<LightSample> {
        match &self.lights[i] {
            Light::Surface(surface) => sample_surface(surface, from, u, moment),
            light => light.sample(from, u),
        }
    }

    /// Which light the surface is that a ray from `from` hit at a moment, if it is one, and the density [1/sr] with which the
    /// light itself would have been sampled here.
    pub fn surface_light(
        &self,
        hit: &Hit,
        from: WorldPoint,
        direction: UnitVec3,
        moment: Moment,
    ) -> Option<(usize, f32)> {
        let i = (*self.light_of_shape.get(hit.shape_idx as usize)?)? as usize;
        let Light::Surface(surface) = &self.lights[i] else { return None };
        let pdf = match moment.of(hit.shape_idx) {
            None => surface.pdf(from, direction, hit.t, hit.normal),
            Some(carried) => surface.pdf(
                carried.back(from),
                carried.direction_back(direction),
                hit.t / carried.scale(),
                carried.direction_back(hit.normal),
            ),
        };
        Some((i, pdf))
    }

    /// Whether a surface or a light other than number `target` is in the way at a moment.
    // Asked by every connection, most of which it should cost no call.
    #[inline(always)]
    pub fn is_blocked(&self, ray: &Ray, t_max: f32, target: usize, moment: Moment) -> bool {
        self.surfaces.is_occluded_at(ray, 0.0, t_max, moment) || self.is_behind_light(ray, t_max, target)
    }

    /// Whether a light other than number `target` is in the way.
    #[inline]
    pub fn is_behind_light(&self, ray: &Ray, t_max: f32, target: usize) -> bool {
        let is_before =
            |&i: &u32| i as usize != target && self.lights[i as usize].intersect(ray).is_some_and(|h| h.t < t_max);
        self.met.iter().any(is_before)
    }
}

#[inline(never)]
fn sample_surface(surface: &SurfaceLight, from: WorldPoint, u: [f32; 2], moment: Moment) -> Option<LightSample> {
    let Some(carried) = moment.of(surface.shape_idx) else { return surface.sample(from, u) };
    // Solid angles are the same in the space in which the shape is still at the frame's time.
    let sample = surface.sample(carried.back(from), u)?;
    let (direction, distance) = (carried.direction(sample.direction), sample.distance * carried.scale());
    Some(LightSample { direction, distance, ..sample })
}
