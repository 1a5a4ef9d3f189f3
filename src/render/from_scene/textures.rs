//! Textures from what a scene says, and what is kept of them from frame to frame.

use crate::flow::surface::SurfaceFlow;
use crate::flow::turbulence::{Turbulence, TurbulenceSettings};
use crate::math::hash::Seed;
use crate::render::from_scene::vec3;
use crate::render::image_texture::{ImageTexture, LatLong, Planar, Projection, Triplanar};
use crate::render::picture::Picture;
use crate::render::texture::{FlowNoise, Ramp, Texture};
use crate::render::{LoadPicture, RenderError, SIGMA_MAX};
use crate::scene::{Scene, settings};
use glam::DVec3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// What the textures of a scene keep from frame to frame.
#[derive(Debug)]
pub struct TextureStore {
    /// Pictures by the names of their files.
    pub pictures: BTreeMap<String, Arc<Picture>>,
    /// Of each shape, the flow along its surface as it was last.
    pub flows: Vec<Option<Arc<SurfaceFlow>>>,
}

impl TextureStore {
    /// Reads the pictures of all textures, each once.
    ///
    /// # Errors
    /// [`RenderError::Texture`] for the first that cannot be used: missing, faulty, no light, or as a reflectance above 1.
    pub fn load(scene: &Scene, load: LoadPicture) -> Result<Self, RenderError> {
        let mut store = Self { pictures: BTreeMap::new(), flows: vec![None; scene.settings.shapes.len()] };
        let limit = (scene.settings.render.memory_limit_gib * f64::from(1 << 30)) as u64;
        for (name, shape) in &scene.settings.shapes {
            for (slot, texture) in shape.material.textures() {
                let settings::Texture::Image(image) = texture else { continue };
                let key = format!("shapes.{name}.material.{slot}.image.file");
                let is_reflectance = !slot.ends_with(".emission");
                store
                    .picture(scene, image, is_reflectance, load, limit)
                    .map_err(|e| RenderError::Texture { key, source: Box::new(e) })?;
            }
        }
        Ok(store)
    }

    fn picture(
        &mut self,
        scene: &Scene,
        image: &settings::ImageTexture,
        is_reflectance: bool,
        load: LoadPicture,
        limit: u64,
    ) -> Result<(), RenderError> {
        let path = scene.resolve(&image.file);
        let no_light = |problem| RenderError::NoLight { path: path.clone(), problem };
        if !self.pictures.contains_key(&image.file) {
            let picture = load(&path).map_err(RenderError::Picture)?;
            picture.check(if is_reflectance { "a reflectance" } else { "radiance" }).map_err(no_light)?;
            self.pictures.insert(image.file.clone(), Arc::new(picture));
            let needed = self.pictures.values().map(|p| size_of_val(p.pixels.as_slice()) as u64).sum();
            if needed > limit {
                return Err(RenderError::TexturesTooLarge { needed, limit });
            }
        }
        let (picture, scale) = (&self.pictures[&image.file], image.scale as f32);
        if is_reflectance { picture.check_reflects(scale) } else { picture.check_glows(scale, SIGMA_MAX as f32) }
            .map_err(no_light)
    }
}

/// A texture as it is at a time [s]; `pictures` holds what [`TextureStore::load`] read.
pub fn texture(texture: &settings::Texture, pictures: &BTreeMap<String, Arc<Picture>>, time: f64) -> Texture {
    match texture {
        settings::Texture::Constant(color) => Texture::Constant(vec3(*color)),
        settings::Texture::FlowNoise(noise) => flow_noise(noise, time),
        settings::Texture::Stripes(s) => Texture::Stripes { along: s.along, colors: s.colors.map(vec3) },
        settings::Texture::Checker(c) => Texture::Checker { size: c.size, colors: c.colors.map(vec3) },
        settings::Texture::Rings(r) => Texture::Rings { center: r.center, width: r.width, colors: r.colors.map(vec3) },
        settings::Texture::Image(image) => Texture::Image(ImageTexture {
            picture: pictures[&image.file].clone(),
            projection: projection(&image.projection),
            scale: image.scale as f32,
        }),
    }
}

fn projection(projection: &settings::Projection) -> Projection {
    let vector = DVec3::from_array;
    match projection {
        settings::Projection::LatLong(globe) => {
            Projection::LatLong(LatLong::new(vector(globe.center), vector(globe.north), globe.turn_deg))
        }
        settings::Projection::Triplanar(tiles) => Projection::Triplanar(Triplanar {
            tile: tiles.tile,
            offset: vector(tiles.offset),
            sharpness: tiles.sharpness,
        }),
        settings::Projection::Planar(planar) => {
            Projection::Planar(Planar::new(vector(planar.center), vector(planar.half_u), vector(planar.half_v)))
        }
    }
}

fn flow_noise(noise: &settings::FlowNoise, time: f64) -> Texture {
    let turbulence = Turbulence::new(&TurbulenceSettings {
        length_scale: noise.length_scale,
        octaves: noise.octaves,
        lacunarity: noise.lacunarity,
        gain: noise.gain,
        is_folded: noise.folded,
        stretch: noise.stretch,
        spin_rate: noise.spin_rate,
        evolve_rate: noise.evolve_rate,
        displacement: noise.displacement.map(|x| x * noise.memory),
        offset: noise.offset,
        scroll: noise.scroll,
        seed: Seed(noise.seed),
    });
    Texture::FlowNoise(Box::new(FlowNoise {
        turbulence: turbulence.at(time),
        along: noise.along,
        amplitude: noise.amplitude,
        ramp: Ramp::new(noise.ramp.iter().map(|stop| (stop.at, vec3(stop.color))), noise.repeat),
    }))
}
