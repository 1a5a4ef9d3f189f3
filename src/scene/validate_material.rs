//! What a schema cannot say about materials and textures.

use crate::schema::decimal;
use crate::settings::{Conductor, FlowNoise, ImageTexture, Material, Projection, Shape, SurfaceFlow, Texture};
use crate::validate::{Check, length};

impl Check<'_, '_, '_> {
    pub(crate) fn material(&mut self, key: &str, material: &Material) {
        let [(color_key, color), (emission_key, emission)] = material.textures();
        let color_key = format!("{key}.{color_key}");
        self.texture(&color_key, color);
        for (i, stop) in color.colors().iter().enumerate() {
            let key = match color {
                // A picture has no colours before it is read.
                Texture::Constant(_) | Texture::Image(_) => color_key.clone(),
                Texture::FlowNoise(_) => format!("{color_key}.flow_noise.ramp[{i}].color"),
                Texture::Stripes(_) => format!("{color_key}.stripes.colors[{i}]"),
                Texture::Checker(_) => format!("{color_key}.checker.colors[{i}]"),
                Texture::Rings(_) => format!("{color_key}.rings.colors[{i}]"),
            };
            for (channel, &share) in stop.iter().enumerate().filter(|(_, share)| **share > 1.0) {
                let message = format!("must be from 0 to 1, found {}: no more is reflected than comes", decimal(share));
                let key = format!("{key}[{channel}]");
                self.error(&key, &key, message);
            }
        }
        self.texture(&format!("{key}.{emission_key}"), emission);
        if let Material::Conductor(conductor) = material {
            self.conductor(&format!("{key}.conductor"), conductor);
        }
    }

    /// What the camera sees of a shape, and of its sides.
    pub(crate) fn sight(&mut self, key: &str, shape: &Shape) {
        let flags = [
            ("invisible_to_camera", shape.invisible_to_camera),
            ("holdout", shape.holdout),
            ("shadow_catcher", shape.shadow_catcher),
        ];
        let mut given = flags.into_iter().filter(|(_, flag)| *flag).map(|(name, _)| name);
        let Some(first) = given.next() else { return self.sides(key, shape) };
        for other in given {
            let message = format!("the camera sees a shape in one way, but `{first}` is true too");
            self.error_help(&format!("{key}.{other}"), key, message, format!("leave out `{first}` or `{other}`"));
        }
        if !shape.visible {
            let message = format!("no light meets a shape that is not `visible`, so that `{first}` has no effect");
            self.error_help(&format!("{key}.{first}"), key, message, format!("leave out `visible` or `{first}`"));
        }
        self.sides(key, shape);
    }

    fn sides(&mut self, key: &str, shape: &Shape) {
        let is_clear = match &shape.material {
            Material::Dielectric(_) => true,
            Material::Principled(principled) => principled.transmission > 0.0,
            _ => false,
        };
        if !shape.two_sided && is_clear {
            let message = "light that goes through a surface meets its inside too";
            self.error_help(&format!("{key}.two_sided"), key, message, "leave out `two_sided`");
        }
    }

    fn conductor(&mut self, key: &str, conductor: &Conductor) {
        let (eta, k) = (conductor.eta.is_some(), conductor.k.is_some());
        let help = "for example `metal: gold`, or `eta: [0.2, 0.9, 1.1]` and `k: [3.9, 2.5, 2.1]`";
        match conductor.metal {
            Some(_) if eta || k => {
                let given = if eta { "eta" } else { "k" };
                let message = format!("`{given}` is that of a metal without a name");
                self.error_help(&format!("{key}.{given}"), key, message, "give either `metal`, or `eta` and `k`");
            }
            None if eta != k => {
                let missing = if eta { "k" } else { "eta" };
                self.error_help(key, key, format!("the index of refraction lacks `{missing}`"), help);
            }
            None if !eta => self.error_help(key, key, "a metal needs its index of refraction", help),
            _ => {}
        }
    }

    fn texture(&mut self, key: &str, texture: &Texture) {
        match texture {
            Texture::FlowNoise(noise) => self.flow_noise(&format!("{key}.flow_noise"), noise),
            Texture::Image(image) => self.image(&format!("{key}.image"), image),
            Texture::Constant(_) | Texture::Stripes(_) | Texture::Checker(_) | Texture::Rings(_) => {}
        }
    }

    fn image(&mut self, key: &str, image: &ImageTexture) {
        self.file(&format!("{key}.file"), &image.file, &["png", "exr", "hdr"]);
        match &image.projection {
            Projection::LatLong(globe) => self.direction(&format!("{key}.projection.lat_long.north"), globe.north),
            Projection::Triplanar(_) => {}
            Projection::Planar(planar) => {
                let (u, v) = (planar.half_u, planar.half_v);
                let cosine = (0..3).map(|i| u[i] * v[i]).sum::<f64>() / (length(u) * length(v));
                if cosine.is_nan() || cosine.abs() >= 1e-6 {
                    let message = "`half_u` and `half_v` must be at a right angle, and neither of length 0";
                    let key = format!("{key}.projection.planar");
                    self.error(&format!("{key}.half_v"), &key, message);
                }
            }
        }
    }

    pub(crate) fn surface_flow(&mut self, key: &str, flow: &SurfaceFlow, is_plane: bool) {
        if is_plane {
            self.error_help(key, key, "nothing flows on a plane", "take a `box`, whose face is as flat");
        }
        if flow.keys.is_empty() {
            return;
        }
        for (name, value) in [("distance", flow.distance), ("speed", flow.speed)] {
            if value != 0.0 {
                let message = format!("`{name}` is that of a flow without `keys`, which say how far it has gone");
                self.error_help(
                    &format!("{key}.{name}"),
                    key,
                    message,
                    "give either `keys`, or `distance` and `speed`",
                );
            }
        }
        if let Some(i) = flow.keys.windows(2).position(|pair| pair[1].time <= pair[0].time) {
            let (before, now) = (decimal(flow.keys[i].time), decimal(flow.keys[i + 1].time));
            let message = format!("times must rise, found {now} after {before}");
            self.error(&format!("{key}.keys[{}].time", i + 1), key, message);
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
