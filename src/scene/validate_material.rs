//! What a schema cannot say about materials and textures.

use crate::scene::schema::decimal;
use crate::scene::settings::{Emission, FlowNoise, Material, Reflectance};
use crate::scene::validate::Check;

impl Check<'_, '_, '_> {
    pub(crate) fn material(&mut self, key: &str, material: &Material) {
        let Material::Diffuse(diffuse) = material;
        if let Reflectance::FlowNoise(noise) = &diffuse.reflectance {
            let key = format!("{key}.diffuse.reflectance.flow_noise");
            self.flow_noise(&key, noise);
            for (i, stop) in noise.ramp.iter().enumerate() {
                if let Some(&share) = stop.color.iter().find(|&&share| share > 1.0) {
                    let message = format!("reflects more than it receives: at most 1, found {}", decimal(share));
                    self.error(&format!("{key}.ramp[{i}].color"), &key, message);
                }
            }
        }
        if let Emission::FlowNoise(noise) = &diffuse.emission {
            self.flow_noise(&format!("{key}.diffuse.emission.flow_noise"), noise);
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
