//! What a schema cannot say about volumes.

use crate::settings::Volume;
use crate::validate::Check;

impl Check<'_, '_, '_> {
    pub(crate) fn volume(&mut self, name: &str, volume: &Volume) {
        if !self.is_plain_name("volumes", name) {
            return;
        }
        let key = format!("volumes.{name}");
        self.exactly_one(&key, &[("file", volume.file.is_some()), ("inside", volume.inside.is_some())]);
        if let Some(file) = &volume.file {
            self.density_file(&format!("{key}.file"), file, volume.blackbody.is_some());
            if volume.density.is_some() {
                let message = "a file has a density of its own";
                let help = "a factor on it is `medium.extinction`; the name of its grid is `file.density`";
                self.error_help(&format!("{key}.density"), &key, message, help);
            }
        }
        if let Some(shape) = &volume.inside {
            self.filled(&format!("{key}.inside"), shape);
            for (of_file, is_given) in [
                ("blackbody", volume.blackbody.is_some()),
                ("remap", volume.remap.is_some()),
                ("detail", volume.detail.is_some()),
            ] {
                if is_given {
                    let message = format!("`{of_file}` is for the density of a file; inside of a shape it is even");
                    let help = "what is even is said by `density` and `medium`";
                    self.error_help(&format!("{key}.{of_file}"), &key, message, help);
                }
            }
        }
        self.matter(&key, &volume.medium, volume.blackbody.is_some(), volume.remap.as_ref());
        let medium = &volume.medium;
        if !volume.glows() && (medium.extinction == 0.0 || medium.extinction_tint == [0.0; 3]) {
            let scope = format!("{key}.medium");
            let message = "a volume of extinction 0 is invisible";
            self.warning(&format!("{scope}.extinction"), &scope, message, "the default is 10");
        }
    }

    /// A shape that can be filled, as far as that is known without its file.
    fn filled(&mut self, key: &str, name: &str) {
        let shapes = &self.settings.shapes;
        match shapes.get(name) {
            None => {
                let names = shapes.iter().filter(|(_, shape)| shape.plane.is_none()).map(|(name, _)| name.as_str());
                let names = names.collect();
                self.unknown_shape(key, name, &names);
            }
            Some(shape) if shape.plane.is_some() => {
                let message = format!("the shape `{name}` is a plane, behind which there is no end");
                self.error_help(key, key, message, "take a `box`");
            }
            Some(shape) if shape.visible && !shape.material.is_clear() => {
                let message =
                    format!("the surface of `{name}` is opaque: from outside nothing is seen of what is in it");
                self.warning(
                    key,
                    key,
                    message,
                    format!("say `shapes.{name}.visible: false`, or take `material: {{dielectric: {{}}}}`"),
                );
            }
            _ => {}
        }
    }
}
