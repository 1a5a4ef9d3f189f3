//! What a schema cannot say about lights.

use crate::schema::decimal;
use crate::settings::{Environment, Interpolation, Keyed, Light, RectangleLight, Rgb, Smoke, Sun, Vec3, Volume};
use crate::validate::{Check, dot, is_parallel, length};

/// Most named groups of lights.
const LIGHT_GROUPS_MAX: usize = 14;

/// Names of the layers of light without a named group.
const RESERVED_GROUPS: [&str; 2] = ["emission", "other"];

/// Least diameter of a disk in the sky [degrees]: the rim of smaller ones is lost in the rounding of directions.
const SUN_DIAMETER_MIN: f64 = 0.01;

impl Check<'_, '_, '_> {
    pub(crate) fn lights(&mut self) {
        let lights = &self.settings.lights;
        let has_unknown_section = self.mended.iter().any(|path| !path.contains(['.', '[']));
        let glows = self.settings.shapes.values().any(|shape| shape.visible && !shape.material.emission().is_black())
            || self.settings.smoke.as_ref().is_some_and(Smoke::glows)
            || self.settings.volumes.values().any(Volume::glows);
        if lights.is_empty() && !has_unknown_section && !glows {
            let help = "for example `lights: [{environment: {radiance: [1, 1, 1]}}]`";
            self.error_help("lights", "lights", "without a light the picture is black", help);
        }
        let mut is_dark = !lights.is_empty() && !glows;
        for (index, light) in lights.iter().enumerate() {
            let key = format!("lights[{index}]");
            let black = |light: &Keyed<Rgb>| light.values().all(|power| *power == [0.0; 3]);
            is_dark &= match light {
                Light::Sun(sun) => {
                    self.sun(&format!("{key}.sun"), sun);
                    black(&sun.irradiance)
                }
                Light::Environment(environment) => {
                    self.environment(&format!("{key}.environment"), environment) == [0.0; 3]
                }
                Light::Rectangle(rectangle) => {
                    self.rectangle(&format!("{key}.rectangle"), rectangle);
                    black(&rectangle.radiance)
                }
                Light::Disk(disk) => {
                    self.directions(&format!("{key}.disk.normal"), &disk.normal);
                    black(&disk.radiance)
                }
                Light::Sphere(sphere) => black(&sphere.radiance),
                Light::Spot(spot) => {
                    self.directions(&format!("{key}.spot.direction"), &spot.direction);
                    black(&spot.intensity)
                }
                Light::Point(point) => black(&point.intensity),
            };
        }
        self.light_groups();
        if is_dark {
            self.warning("lights", "lights", "all lights are black", "raise one of them above 0");
        }
    }

    /// Groups become names of channels, and there is room for so many.
    fn light_groups(&mut self) {
        let settings = self.settings;
        for (index, light) in settings.lights.iter().enumerate() {
            let Some(name) = light.group() else { continue };
            let key = format!("lights[{index}].{}.group", light.kind());
            let is_plain = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
            if !is_plain || name.is_empty() || name.len() > 32 {
                let message = "the name of a group has 1 to 32 letters, digits and `_`";
                self.error_help(&key, &key, message, "it becomes the name of a layer, `light_NAME`");
            } else if RESERVED_GROUPS.contains(&name) {
                let message = format!("`{name}` is the layer of what is in no group");
                self.error_help(&key, &key, message, "take another name");
            }
        }
        let count = settings.light_groups().len();
        if count > LIGHT_GROUPS_MAX {
            let message = format!("{count} groups of lights; at most {LIGHT_GROUPS_MAX} are allowed");
            self.error_help("lights", "lights", message, "give lights the same `group`, or none");
        }
    }

    fn rectangle(&mut self, key: &str, rectangle: &RectangleLight) {
        let edges = [&rectangle.half_u, &rectangle.half_v];
        // Edges that do not turn are compared; what is between keys is checked for each frame that is made.
        let is_flat = edges.iter().all(|edge| !edge.varies()) && is_parallel(*edges[0].first(), *edges[1].first());
        let is_odd = |edge: &&Keyed<Vec3>| edge.values().any(|half| !(1e-6..=1e6).contains(&length(*half)));
        if is_flat {
            let message = "`half_u` and `half_v` are parallel, so that the rectangle has no area";
            self.error(&format!("{key}.half_v"), key, message);
        } else if let Some(i) = edges.iter().position(is_odd) {
            let message = "half an edge must be between 1e-6 and 1e6 m long";
            self.error(&format!("{key}.half_{}", ["u", "v"][i]), key, message);
        }
    }

    /// Directions over time: none of length 0, and none opposite to the next, between which there would be one.
    fn directions(&mut self, key: &str, directions: &Keyed<Vec3>) {
        let values: Vec<Vec3> = directions.values().copied().collect();
        for direction in &values {
            self.direction(key, *direction);
        }
        let is_opposite = |pair: &[Vec3]| is_parallel(pair[0], pair[1]) && dot(pair[0], pair[1]) < 0.0;
        if directions.interpolation() != Interpolation::Step && values.windows(2).any(is_opposite) {
            let message = "a direction turns into its opposite, through one of length 0";
            self.error_help(key, key, message, "put a key in between that says which way it turns");
        }
    }

    fn sun(&mut self, key: &str, sun: &Sun) {
        self.directions(&format!("{key}.direction"), &sun.direction);
        let diameter = sun.angular_diameter_deg;
        let diameter_key = format!("{key}.angular_diameter_deg");
        if diameter > 0.0 && diameter < SUN_DIAMETER_MIN {
            let message = format!("must be 0, or at least {SUN_DIAMETER_MIN}, found {}", decimal(diameter));
            self.error_help(&diameter_key, &diameter_key, message, "0 is parallel light; the real sun has 0.53");
        } else if sun.visible && diameter == 0.0 {
            let message = "parallel light cannot be seen: it has no disk";
            self.warning(&format!("{key}.visible"), key, message, "set `angular_diameter_deg`; the real sun has 0.53");
        }
    }

    /// Checks it and returns how bright it is.
    fn environment(&mut self, key: &str, environment: &Environment) -> [f64; 3] {
        let given = [
            ("radiance", environment.radiance.is_some()),
            ("gradient", environment.gradient.is_some()),
            ("file", environment.file.is_some()),
            ("sky", environment.sky.is_some()),
        ];
        self.exactly_one(key, &given);
        if let Some(file) = &environment.file {
            self.file(&format!("{key}.file"), file, &["exr", "hdr"]);
        }
        environment.radiance.unwrap_or([1.0; 3])
    }
}
