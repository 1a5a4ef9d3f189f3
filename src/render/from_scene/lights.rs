//! Lights from what a scene says: its own, the suns of its skies, and shapes that shine.

use crate::geometry::primitive::Primitive;
use crate::geometry::sdf::Sdf;
use crate::geometry::{Shape, keys, vector};
use crate::math::space::{UnitVec3, WorldPoint};
use crate::render::atmosphere::{Atmosphere, SUN_DIAMETER_DEG, direction_to_sun};
use crate::render::ball::Ball;
use crate::render::environment::Environment;
use crate::render::from_scene::vec3;
use crate::render::light::Light;
use crate::render::light_path::OTHER_GROUP;
use crate::render::material::Material;
use crate::render::panel::{Outline, Panel};
use crate::render::spot::Spot;
use crate::render::sun::Sun;
use crate::render::surface_light::SurfaceLight;
use crate::render::texture::Texture;
use crate::render::{LoadPicture, RenderError};
use crate::scene::{Scene, settings};
use glam::{DQuat, Vec3};

/// Width and height of the picture of a clear sky: haze about the sun and the rim of the earth take the most.
const SKY_SIZE: [usize; 2] = [512, 256];

/// The lights of a scene as they are at a time [s], in its order; the sun of a clear sky follows the sky.
///
/// # Errors
/// [`RenderError::Light`] when a picture of the surroundings cannot be used.
pub fn build_lights(scene: &Scene, time: f64, load: LoadPicture) -> Result<Vec<Light>, RenderError> {
    let at = At { scene, time };
    let mut lights = Vec::new();
    for (light_idx, settings) in scene.settings.lights.iter().enumerate() {
        let built = match settings {
            settings::Light::Environment(e) => environment(at, e, load).map(|e| Some(Light::Environment(e))),
            _ => lamp(at, settings),
        };
        lights.extend(built.map_err(|e| RenderError::Light { light_idx, source: Box::new(e) })?);
        lights.extend(sky_with_sun(settings).map(|(environment, sky)| sun_of(at, environment, sky)));
    }
    Ok(lights)
}

/// Makes sure that the lights of a scene are somewhere at a time [s], without their pictures.
///
/// # Errors
/// [`RenderError::Light`] with the first that is not: a keyed rectangle without an area, a keyed direction of length 0.
pub fn check_lights(scene: &Scene, time: f64) -> Result<(), RenderError> {
    let at = At { scene, time };
    scene.settings.lights.iter().enumerate().try_for_each(|(light_idx, settings)| {
        lamp(at, settings).map(drop).map_err(|e| RenderError::Light { light_idx, source: Box::new(e) })
    })
}

/// The number of the group of each light of [`build_lights`], as [`group_layers`](crate::render::layers::group_layers) counts them.
pub fn groups(settings: &settings::Settings) -> Vec<usize> {
    let names = settings.light_groups();
    let number = |light: &settings::Light| {
        let name = light.group()?;
        names.iter().position(|known| known == name)
    };
    let group = |light: &settings::Light| {
        let group = number(light).map_or(OTHER_GROUP, |i| OTHER_GROUP + 1 + i);
        std::iter::repeat_n(group, if sky_with_sun(light).is_some() { 2 } else { 1 })
    };
    settings.lights.iter().flat_map(group).collect()
}

/// A scene at a time [s].
#[derive(Clone, Copy)]
struct At<'a> {
    scene: &'a Scene,
    time: f64,
}

impl At<'_> {
    fn vector(self, keyed: &settings::Keyed<settings::Vec3>) -> Vec3 {
        keys(keyed, &self.scene.settings.frames, vector).at(self.time).as_vec3()
    }

    fn point(self, keyed: &settings::Keyed<settings::Vec3>) -> WorldPoint {
        WorldPoint(self.vector(keyed))
    }

    fn number(self, keyed: &settings::Keyed<f64>) -> f64 {
        keys(keyed, &self.scene.settings.frames, |x| *x).at(self.time)
    }

    fn direction(self, keyed: &settings::Keyed<settings::Vec3>) -> Result<UnitVec3, RenderError> {
        UnitVec3::try_new(self.vector(keyed)).ok_or(RenderError::LightNowhere {
            time: self.time,
            what: "its direction has length 0; put a key in between that says which way it turns",
        })
    }
}

/// A light that needs no picture; `None` for surroundings.
fn lamp(at: At, light: &settings::Light) -> Result<Option<Light>, RenderError> {
    Ok(Some(match light {
        settings::Light::Environment(_) => return Ok(None),
        settings::Light::Sun(sun) => Light::Sun(Sun::new(
            at.direction(&sun.direction)?,
            at.vector(&sun.irradiance),
            sun.angular_diameter_deg,
            sun.visible,
        )),
        settings::Light::Rectangle(r) => {
            let (center, half_u, half_v) = (at.point(&r.center), at.vector(&r.half_u), at.vector(&r.half_v));
            let panel = Panel::try_new(Outline::Rectangle, center, half_u, half_v, at.vector(&r.radiance));
            let what = "half_u and half_v are parallel there, so that it has no area";
            let mut panel = panel.ok_or(RenderError::LightNowhere { time: at.time, what })?;
            (panel.is_two_sided, panel.is_visible) = (r.two_sided, r.visible);
            Light::Panel(panel)
        }
        settings::Light::Disk(d) => {
            let (center, normal) = (at.point(&d.center), at.direction(&d.normal)?.as_vec3());
            let panel = Panel::disk(center, normal, at.number(&d.radius) as f32, at.vector(&d.radiance));
            let mut panel = panel.ok_or(RenderError::LightNowhere { time: at.time, what: "it has no area" })?;
            (panel.is_two_sided, panel.is_visible) = (d.two_sided, d.visible);
            Light::Panel(panel)
        }
        settings::Light::Sphere(s) => {
            let mut ball = Ball::new(at.point(&s.center), at.number(&s.radius) as f32, at.vector(&s.radiance));
            ball.is_visible = s.visible;
            Light::Ball(ball)
        }
        settings::Light::Spot(s) => Light::Spot(Spot::new(
            at.point(&s.position),
            at.direction(&s.direction)?,
            at.vector(&s.intensity),
            at.number(&s.cone_deg),
            at.number(&s.blend),
        )),
        settings::Light::Point(p) => {
            Light::Point { position: at.point(&p.position), intensity: at.vector(&p.intensity) }
        }
    }))
}

fn environment(at: At, e: &settings::Environment, load: LoadPicture) -> Result<Environment, RenderError> {
    let scale = scale_of(at, e);
    let turn = at.number(&e.rotate_deg) as f32;
    let is_visible = e.visible.unwrap_or(true);
    if let Some(file) = &e.file {
        let path = at.scene.resolve(file);
        let fail = |problem| RenderError::NoLight { path: path.clone(), problem };
        let picture = load(&path).map_err(RenderError::Picture)?;
        picture.check("radiance").map_err(fail)?;
        let pixels = picture.pixels.into_iter().map(|p| p * scale).collect();
        return Ok(Environment::picture(picture.width, picture.height, pixels, turn, is_visible));
    }
    if let Some(sky) = &e.sky {
        let pixels = atmosphere(sky).picture(SKY_SIZE[0], SKY_SIZE[1]).into_iter().map(|p| p * scale).collect();
        return Ok(Environment::picture(SKY_SIZE[0], SKY_SIZE[1], pixels, turn, is_visible));
    }
    if let Some(g) = &e.gradient {
        let [zenith, horizon, nadir] = [g.zenith, g.horizon, g.nadir].map(|c| vec3(c) * scale);
        return Ok(Environment::gradient(zenith, horizon, nadir, is_visible));
    }
    Ok(Environment::constant(vec3(e.radiance.unwrap_or([0.0; 3])) * scale, is_visible))
}

fn scale_of(at: At, environment: &settings::Environment) -> f32 {
    environment.scale.as_ref().map_or(1.0, |scale| at.number(scale) as f32)
}

fn atmosphere(sky: &settings::Sky) -> Atmosphere {
    let to_sun = direction_to_sun(sky.sun_elevation_deg, sky.sun_azimuth_deg);
    Atmosphere::new(to_sun, sky.turbidity, vec3(sky.ground_albedo))
}

/// The clear sky of a light that comes with its sun.
fn sky_with_sun(light: &settings::Light) -> Option<(&settings::Environment, &settings::Sky)> {
    let settings::Light::Environment(environment) = light else { return None };
    environment.sky.as_ref().filter(|sky| sky.sun).map(|sky| (environment, sky))
}

/// The sun of a clear sky, as much dimmed by the air.
fn sun_of(at: At, environment: &settings::Environment, sky: &settings::Sky) -> Light {
    let to_sun = direction_to_sun(sky.sun_elevation_deg, sky.sun_azimuth_deg);
    let turned = DQuat::from_rotation_y(at.number(&environment.rotate_deg).to_radians()) * to_sun;
    let direction = UnitVec3::new_unchecked(-turned.as_vec3().normalize());
    let irradiance = atmosphere(sky).sun_irradiance() * scale_of(at, environment);
    Light::Sun(Sun::new(direction, irradiance, SUN_DIAMETER_DEG, sky.sun_visible))
}

/// A shape as a light, where it gives off the same everywhere and is made of triangles, a ball or a box with sharp edges.
pub fn glowing_shape(shape_idx: u32, shape: &Shape, material: &Material) -> Option<Light> {
    let Some(Texture::Constant(radiance)) = material.emission else { return None };
    if material.is_one_sided {
        return None;
    }
    if let Some(mesh) = &shape.mesh {
        let corners = (0..mesh.triangles().len()).map(|i| mesh.corners(i));
        return SurfaceLight::triangles(shape_idx, corners, radiance).map(Light::Surface);
    }
    let sdf = shape.sdf.as_ref()?;
    let at = sdf.placement();
    let Sdf::Primitive(primitive) = sdf.sdf() else { return None };
    let surface = match primitive {
        Primitive::Sphere(ball) => {
            let center = at.point_to_world(ball.center.as_vec3());
            Some(SurfaceLight::ball(shape_idx, center, ball.radius as f32 * at.scale, radiance))
        }
        Primitive::Cuboid(cuboid) if cuboid.rounding == 0.0 => {
            let corners = cuboid.triangles().map(|corners| corners.map(|p| at.point_to_world(p.as_vec3()).0));
            SurfaceLight::triangles(shape_idx, corners.into_iter(), radiance)
        }
        _ => None,
    };
    surface.map(Light::Surface)
}
