//! What a schema cannot say about materials and textures.

use crate::scene::schema::decimal;
use crate::scene::settings::{FlowNoise, Material, Texture};
use crate::scene::validate::Check;

impl Check<'_, '_, '_> {
    pub(crate) fn material(&mut self, key: &str, material: &Material) {
        let Material::Diffuse(diffuse) = material;
        let reflectance = format!("{key}.diffuse.reflectance");
        self.texture(&reflectance, &diffuse.reflectance);
        for (i, color) in diffuse.reflectance.colors().iter().enumerate() {
            let key = match diffuse.reflectance {
                Texture::Constant(_) => reflectance.clone(),
                Texture::FlowNoise(_) => format!("{reflectance}.flow_noise.ramp[{i}].color"),
                Texture::Stripes(_) => format!("{reflectance}.stripes.colors[{i}]"),
                Texture::Checker(_) => format!("{reflectance}.checker.colors[{i}]"),
                Texture::Rings(_) => format!("{reflectance}.rings.colors[{i}]"),
            };
            for (channel, &share) in color.iter().enumerate().filter(|(_, share)| **share > 1.0) {
                let message = format!("must be from 0 to 1, found {}: no more is reflected than comes", decimal(share));
                let key = format!("{key}[{channel}]");
                self.error(&key, &key, message);
            }
        }
        self.texture(&format!("{key}.diffuse.emission"), &diffuse.emission);
    }

    fn texture(&mut self, key: &str, texture: &Texture) {
        if let Texture::FlowNoise(noise) = texture {
            self.flow_noise(&format!("{key}.flow_noise"), noise);
        }
    }

    fn flow_noise(&mut self, key: &str, noise: &FlowNoise) {
        if noise.spin_rate != 0.0 && noise.evolve_rate != 0.0 {
            let message = "features either turn (`spin_rate`) or give way to others (`evolve_rate`), not both";
            self.error(&format!("{key}.evolve_rate"), key, message);
        }
        if let Some(i) = noise.ramp.windows(2).position(|pair| pair[1].at <= pair[0].at) {
            let (before, at) = (decimal(noise.ramp[i].at), decimal(noise.ramp[i + 1].at));
            let message = format!("places must rise: the stop before is at {before}, found {at}");
            self.error(&format!("{key}.ramp[{}].at", i + 1), key, message);
        }
    }
}
