//! What a schema cannot say: cross references, relations between keys, files that must exist, and whether the whole
//! fits into memory. All problems are collected.

use crate::conform::KeyedFrames;
use crate::diagnostic::{Collector, Diagnostic, Fault, listed, nearest};
use crate::pattern::{Pattern, spell};
use crate::schema::decimal;
use crate::settings::{
    Camera, CameraProjection, Capsule, Compression, Cuboid, Environment, Film, Frames, Interpolation, Keyed, Layout,
    Light, Output, Part, RectangleLight, Rgb, Rotation, Settings, Shape, Smoke, Sun, Torus, Transform, Vec3, Volume,
};
use crate::tree::Node;
use crate::{nearest_file, resolve};
use std::collections::BTreeSet;
use std::path::Path;

/// Most parts of a smooth union, each of which is evaluated at every point.
const UNION_PARTS_MAX: usize = 64;

/// Most named groups of lights.
const LIGHT_GROUPS_MAX: usize = 14;

/// Names of the layers of light without a named group.
const RESERVED_GROUPS: [&str; 2] = ["emission", "other"];

/// Least diameter of a disk in the sky [degrees]: the rim of smaller ones is lost in the rounding of directions.
const SUN_DIAMETER_MIN: f64 = 0.01;

/// Checks settings that fit the schema, whose values over time are `keyed`. Keys in `mended`, and what depends on them, are not
/// judged. Files of frames beyond `frames` need not be there.
pub fn validate(
    settings: &Settings,
    tree: &Node,
    mended: &[String],
    keyed: &[KeyedFrames],
    path: &Path,
    frames: Option<&[i32]>,
    collector: &mut Collector<'_>,
) {
    let mut check = Check { settings, tree, mended, path, frames_to_make: frames, collector };
    check.frames(&settings.frames);
    check.key_times(keyed);
    check.camera(&settings.camera);
    check.film(&settings.film);
    check.shapes();
    check.flow();
    if let Some(smoke) = &settings.smoke {
        check.smoke(smoke);
    }
    for (name, volume) in &settings.volumes {
        check.volume(name, volume);
    }
    check.lights();
    check.output(&settings.output);
    check.footprint();
}

/// The checks under way; those of smoke are in `validate_smoke`.
pub(crate) struct Check<'s, 'c, 'a> {
    pub(crate) settings: &'s Settings,
    tree: &'s Node,
    mended: &'s [String],
    pub(crate) path: &'s Path,
    /// All of the scene where `None`.
    pub(crate) frames_to_make: Option<&'s [i32]>,
    collector: &'c mut Collector<'a>,
}

/// Whether a key path is the scope or lies within it.
fn is_inside(path: &str, scope: &str) -> bool {
    path.strip_prefix(scope).is_some_and(|rest| scope.is_empty() || rest.is_empty() || rest.starts_with(['.', '[']))
}

pub(crate) fn length(v: Vec3) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

pub(crate) fn difference(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Whether a turn that repeats ends as it begins, but for whole rounds.
fn goes_round(turn: &Keyed<Rotation>) -> bool {
    let (first, last) = (turn.first(), turn.last());
    let rounds = (last.angle - first.angle) / 360.0;
    let is_same_axis = first.angle == 0.0 || (is_parallel(first.axis, last.axis) && dot(first.axis, last.axis) > 0.0);
    turn.interpolation() != Interpolation::Step && is_same_axis && (rounds - rounds.round()).abs() < 1e-9
}

/// Whether the last of some quaternions is the same turn as the first.
fn is_same_turn(turn: &Keyed<[f64; 4]>) -> bool {
    let (a, b) = (turn.first(), turn.last());
    let dot = |a: &[f64; 4], b: &[f64; 4]| (0..4).map(|i| a[i] * b[i]).sum::<f64>();
    turn.interpolation() != Interpolation::Step && dot(a, b).powi(2) >= (1.0 - 1e-12) * dot(a, a) * dot(b, b)
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

/// Whether two directions are parallel to within what an f32 can tell.
pub(crate) fn is_parallel(a: Vec3, b: Vec3) -> bool {
    length(cross(a, b)) <= 1e-6 * length(a) * length(b)
}

fn listed_all(names: &BTreeSet<&str>) -> String {
    if names.is_empty() { "none".into() } else { listed(names.iter().copied()) }
}

impl<'s> Check<'s, '_, '_> {
    /// Whether a key and everything around and inside it passed the schema.
    pub(crate) fn is_sound(&self, key: &str) -> bool {
        !self.mended.iter().any(|mended| is_inside(mended, key) || is_inside(key, mended))
    }

    /// Reports an error unless something within `scope` is already known to be wrong.
    pub(crate) fn error(&mut self, key: &str, scope: &str, message: impl Into<String>) -> Option<&mut Diagnostic> {
        if !self.is_sound(key) || !self.is_sound(scope) {
            return None;
        }
        Some(self.collector.error(self.tree.place_of(key), key, message))
    }

    pub(crate) fn error_help(&mut self, key: &str, scope: &str, message: impl Into<String>, help: impl Into<String>) {
        if let Some(diagnostic) = self.error(key, scope, message) {
            diagnostic.help(help);
        }
    }

    pub(crate) fn warning(&mut self, key: &str, scope: &str, message: impl Into<String>, help: impl Into<String>) {
        if self.is_sound(key) && self.is_sound(scope) {
            self.collector.warning(self.tree.place_of(key), key, message).help(help);
        }
    }

    pub(crate) fn direction(&mut self, key: &str, direction: Vec3) {
        if length(direction) < 1e-9 {
            self.error_help(key, key, "a direction of length 0", "give a direction of any other length");
        }
    }

    /// Reports unless exactly one of the named keys is given.
    pub(crate) fn exactly_one(&mut self, key: &str, given: &[(&str, bool)]) {
        let names = listed(given.iter().map(|(name, _)| *name));
        let present: Vec<&str> = given.iter().filter(|(_, is_given)| *is_given).map(|(name, _)| *name).collect();
        match present[..] {
            [_] => {}
            [] => {
                self.error(key, key, format!("exactly one of {names} is needed, found none"));
            }
            [first, second, ..] => {
                let message = format!("`{first}` is given already; exactly one of {names} is allowed");
                self.error(&format!("{key}.{second}"), key, message);
            }
        }
    }

    fn frames(&mut self, frames: &Frames) {
        if frames.last < frames.first {
            let message = format!("the last frame, {}, is before the first, {}", frames.last, frames.first);
            self.error("frames.last", "frames", message);
        }
        let [open, close] = frames.shutter;
        if open > close {
            let message = format!("the shutter closes at {}, before it opens at {}", decimal(close), decimal(open));
            self.error_help("frames.shutter", "frames.shutter", message, "write `[opening, closing]`, in frames");
        } else if open < -1.0 || close > 1.0 {
            let message = "the shutter must open and close within one frame of the frame: from -1 to 1";
            self.error_help("frames.shutter", "frames.shutter", message, "a film camera has about `[-0.25, 0.25]`");
        }
    }

    /// Frames that differ may be at the same time, once the first is taken from them.
    fn key_times(&mut self, keyed: &[KeyedFrames]) {
        if !self.is_sound("frames") {
            return;
        }
        for frames in keyed {
            let times: Vec<f64> = frames.iter().map(|(frame, _)| self.settings.frames.time(*frame)).collect();
            let rises = |pair: &[f64]| pair[0] < pair[1];
            if let Some(i) = times.windows(2).position(|pair| !rises(pair)) {
                let (frame, key) = &frames[i + 1];
                let message = format!("frame {} lies too close to the one before, at the same time", decimal(*frame));
                self.error_help(key, key, message, "put the frames of keys further apart, or remove one of them");
            }
        }
    }

    fn camera(&mut self, camera: &Camera) {
        if camera.lens.is_some() && camera.projection == CameraProjection::LatLong {
            let help = "remove `lens`, or take another projection";
            self.error_help("camera.lens", "camera", "a camera that sees all directions has no lens", help);
        }
        // Light is traced in single precision, in which the points may be the same.
        let single = |v: &Vec3| v.map(|x| f64::from(x as f32));
        for up in camera.up.values() {
            self.direction("camera.up", *up);
        }
        // Where some move, what is between keys is checked for each frame that is made.
        if camera.position.varies() || camera.look_at.varies() || camera.up.varies() {
            return;
        }
        let view = difference(single(camera.look_at.first()), single(camera.position.first()));
        if length(view) < 1e-9 {
            self.error("camera.look_at", "camera", "the camera looks at the point where it stands");
            return;
        }
        if is_parallel(view, *camera.up.first()) {
            let message = "`up` is parallel to the direction of view";
            self.error_help("camera.up", "camera", message, "looking straight up or down, take `up: [0, 0, -1]`");
        }
    }

    fn film(&mut self, film: &Film) {
        if film.noise_target.is_some() && film.time_limit.is_some() {
            let message = "`time_limit` and `noise_target` exclude each other";
            self.error_help("film.time_limit", "film", message, "remove one of them");
        }
        if film.noise_target.is_none() && film.min_spp != Film::default().min_spp {
            let message = "`min_spp` has no effect without `noise_target`";
            self.warning("film.min_spp", "film", message, "add `noise_target`, for example 0.02, or remove it");
        } else if film.min_spp > film.spp && film.min_spp != Film::default().min_spp {
            let message = format!("the fewest paths, {}, are more than the most, `spp: {}`", film.min_spp, film.spp);
            self.error_help("film.min_spp", "film", message, "lower it, or raise `spp`");
        }
        let ([width, height], [left, right, top, bottom]) = (film.resolution, film.overscan.sides());
        let is_all_round = self.settings.camera.projection == CameraProjection::LatLong;
        if is_all_round && (left.max(right) > width || top.max(bottom) > height) {
            let message =
                format!("a `lat_long` camera has seen everything twice {width} × {height} pixels beside the frame");
            self.error_help("film.overscan", "film", message, "lower it; a few pixels are enough for filters");
        }
    }

    /// Whether a name in the map `section` can be part of a key path; reported where not.
    pub(crate) fn is_plain_name(&mut self, section: &str, name: &str) -> bool {
        let is_plain = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
        if is_plain && !name.is_empty() && name.len() <= 64 {
            return true;
        }
        // Such a name may look like a key path, so that its place cannot be found by path.
        let place = self.tree.get(section).and_then(|section| section.node.get(name)).map(|entry| entry.key_place);
        let message = "a name has 1 to 64 letters, digits, `_` and `-`";
        let place = place.unwrap_or_else(|| self.tree.place_of(section));
        self.collector.error(place, &format!("{section}.{name}"), message);
        false
    }

    fn shapes(&mut self) {
        for (name, shape) in &self.settings.shapes {
            let key = format!("shapes.{name}");
            if !self.is_plain_name("shapes", name) {
                continue;
            }
            let given = [
                ("sphere", shape.sphere.is_some()),
                ("box", shape.cuboid.is_some()),
                ("capsule", shape.capsule.is_some()),
                ("torus", shape.torus.is_some()),
                ("plane", shape.plane.is_some()),
                ("smooth_union", shape.smooth_union.is_some()),
                ("mesh", shape.mesh.is_some()),
            ];
            self.exactly_one(&key, &given);
            self.shape(&key, shape);
            if !shape.visible && !self.settings.carries(name) {
                let key_visible = format!("{key}.visible");
                let message =
                    format!("`{name}` has no effect: it is invisible, no obstacle, no emitter and holds no volume");
                self.warning(&key_visible, "flow.obstacles", message, "name it in `flow.obstacles`, or remove it");
            }
        }
    }

    fn shape(&mut self, key: &str, shape: &Shape) {
        self.solids(key, shape.cuboid.as_ref(), shape.capsule.as_ref(), shape.torus.as_ref());
        if let Some(plane) = &shape.plane {
            self.direction(&format!("{key}.plane.normal"), plane.normal);
        }
        if let Some(union) = &shape.smooth_union {
            if union.parts.len() > UNION_PARTS_MAX {
                let message = format!("at most {UNION_PARTS_MAX} parts are allowed, found {}", union.parts.len());
                let key = format!("{key}.smooth_union.parts");
                self.error_help(
                    &key,
                    &key,
                    message,
                    "take a `mesh`, whose distance costs the same however large it is",
                );
            }
            for (i, part) in union.parts.iter().enumerate() {
                self.part(&format!("{key}.smooth_union.parts[{i}]"), part);
            }
        }
        if let Some(mesh) = &shape.mesh {
            self.file(&format!("{key}.mesh.file"), &mesh.file, &["obj", "ply", "glb", "gltf"]);
            let is_gltf = [".glb", ".gltf"].iter().any(|ending| mesh.file.to_lowercase().ends_with(ending));
            if mesh.node.is_some() && !is_gltf {
                let message = "`node` is of .glb and .gltf files; others have no nodes";
                self.error(&format!("{key}.mesh.node"), &format!("{key}.mesh"), message);
            }
            if is_gltf && shape.motion.is_some() {
                let help = "move it by keys of `transform`, which go with the animation of the file";
                self.error_help(&format!("{key}.motion"), key, "glTF shapes have no `motion` besides", help);
            }
        }
        self.material(&format!("{key}.material"), &shape.material);
        self.sight(key, shape);
        if let Some(flow) = &shape.surface_flow {
            self.surface_flow(&format!("{key}.surface_flow"), flow, shape.plane.is_some());
        }
        self.transform(key, &shape.transform);
        self.moving_transform(key, shape);
        if let Some(motion) = &shape.motion {
            self.motion(&format!("{key}.motion"), motion, shape.plane.is_some());
        }
    }

    fn part(&mut self, key: &str, part: &Part) {
        let given = [
            ("sphere", part.sphere.is_some()),
            ("box", part.cuboid.is_some()),
            ("capsule", part.capsule.is_some()),
            ("torus", part.torus.is_some()),
        ];
        self.exactly_one(key, &given);
        self.solids(key, part.cuboid.as_ref(), part.capsule.as_ref(), part.torus.as_ref());
        self.transform(key, &part.transform);
        if part.transform.varies() {
            let key = format!("{key}.transform");
            self.error_help(&key, &key, "a part does not move by itself", "give keys to the shape's own `transform`");
        }
    }

    fn transform(&mut self, key: &str, transform: &Transform) {
        let key = format!("{key}.transform");
        for turn in transform.rotate_deg.values() {
            self.direction(&format!("{key}.rotate_deg.axis"), turn.axis);
        }
        let Some(quaternion) = &transform.quaternion else { return };
        let key_quaternion = format!("{key}.quaternion");
        if quaternion.values().any(|q| q.iter().map(|x| x * x).sum::<f64>() < 1e-18) {
            let help = "write x, y, z, w; no turn is `[0, 0, 0, 1]`";
            self.error_help(&key_quaternion, &key_quaternion, "a quaternion of length 0 is no turn", help);
        }
        if transform.rotate_deg != Rotation::default().into() {
            let message = "`rotate_deg` is given already; at most one of `rotate_deg`, `quaternion` is allowed";
            self.error(&key_quaternion, &key, message);
        }
    }

    /// A transform with keys: what moves so, and what it may not do.
    fn moving_transform(&mut self, key: &str, shape: &Shape) {
        let transform = &shape.transform;
        if !transform.varies() {
            return;
        }
        let key_transform = format!("{key}.transform");
        if shape.plane.is_some() {
            let help = "take a `box`, whose face is as flat";
            self.error_help(&key_transform, key, "a plane cannot move", help);
        }
        if shape.motion.is_some() {
            let help = "put all of it into the keys of `transform`";
            self.error_help(&format!("{key}.motion"), key, "the shape moves by its `transform` already", help);
        }
        let name = key.strip_prefix("shapes.").unwrap_or_default();
        if !self.settings.carries(name) {
            return;
        }
        let scope = "a shape that guides the flow, holds a volume or lets particles start";
        if transform.scale.varies() {
            let key = format!("{key_transform}.scale");
            self.error_help(&key, &key, format!("{scope} cannot grow"), "give one value for all frames");
        }
        let jumps = [
            ("translate", transform.translate.jumps()),
            ("rotate_deg", transform.rotate_deg.jumps() && !goes_round(&transform.rotate_deg)),
            ("quaternion", transform.quaternion.as_ref().is_some_and(|q| q.jumps() && !is_same_turn(q))),
        ];
        for (name, _) in jumps.into_iter().filter(|(_, jumps)| *jumps) {
            let key = format!("{key_transform}.{name}");
            let help = "take `linear` or `ease`; what repeats must end as it begins";
            self.error_help(&key, &key, format!("{scope} cannot jump: its speed would be infinite"), help);
        }
    }

    /// Solids whose numbers must fit each other.
    fn solids(&mut self, key: &str, cuboid: Option<&Cuboid>, capsule: Option<&Capsule>, torus: Option<&Torus>) {
        if let Some(cuboid) = cuboid {
            let shortest = cuboid.size.iter().copied().fold(f64::INFINITY, f64::min);
            if cuboid.rounding > shortest / 2.0 {
                let allowed = decimal(shortest / 2.0);
                let message =
                    format!("must be at most half the shortest edge, {allowed}, found {}", decimal(cuboid.rounding));
                self.error(&format!("{key}.box.rounding"), &format!("{key}.box"), message);
            }
        }
        if let Some(capsule) = capsule
            && length(difference(capsule.start, capsule.end)) < 1e-9
        {
            let scope = format!("{key}.capsule");
            self.error_help(&format!("{scope}.end"), &scope, "both ends are the same point", "use `sphere`");
        }
        if let Some(torus) = torus {
            let scope = format!("{key}.torus");
            self.direction(&format!("{scope}.axis"), torus.axis);
            if torus.minor_radius >= torus.major_radius {
                let major = decimal(torus.major_radius);
                let message =
                    format!("must be less than `major_radius`, {major}, found {}", decimal(torus.minor_radius));
                self.error(&format!("{scope}.minor_radius"), &scope, message);
            }
        }
    }

    pub(crate) fn unknown_shape(&mut self, key: &str, name: &str, names: &BTreeSet<&str>) {
        let Some(diagnostic) = self.error(key, key, format!("there is no shape `{name}`")) else { return };
        if let Some(name) = nearest(name, names.iter().copied()) {
            diagnostic.help(format!("did you mean `{name}`?"));
        }
        diagnostic.help(format!("shapes of this scene: {}", listed_all(names)));
    }

    pub(crate) fn missing(&mut self, key: &str, name: &str) {
        let path = resolve(self.path, name);
        let near = nearest_file(&path);
        self.missing_file(key, &path, near);
    }

    fn missing_file(&mut self, key: &str, path: &Path, near: Option<String>) {
        if path.is_dir() {
            self.error(key, key, format!("`{}` is a folder, not a file", path.display()));
        } else if let Some(diagnostic) = self.error(key, key, format!("there is no file `{}`", path.display())) {
            diagnostic.fault(Fault::MissingFile);
            if let Some(near) = near {
                diagnostic.help(format!("did you mean `{near}`?"));
            }
            diagnostic.help("relative names start from the folder of the scene file");
        }
    }

    /// Files of a sequence that are not there: the frames, of how many, and the name of the first.
    pub(crate) fn missing_frames(&mut self, key: &str, frames: &[i32], count: usize, first_name: &str) {
        let path = resolve(self.path, first_name);
        if path.is_dir() {
            self.missing_file(key, &path, None);
            return;
        }
        let which = match frames {
            [frame] => format!("frame {frame}"),
            _ if frames.len() == count => format!("any of the frames {}", spell(frames)),
            _ => format!("the frames {}", spell(frames)),
        };
        let more = if frames.len() > 1 { " and so on" } else { "" };
        let message = format!("there is no file for {which}: `{}`{more}", path.display());
        // A name that differs in its number alone is another frame, which is not what was meant.
        let letters = |name: &str| name.chars().filter(|c| !c.is_ascii_digit() && *c != '-').collect::<String>();
        let missing = path.file_name().map(|name| letters(&name.to_string_lossy())).unwrap_or_default();
        let near = nearest_file(&path).filter(|near| letters(near) != missing);
        let Some(diagnostic) = self.error(key, key, message) else { return };
        diagnostic.fault(Fault::MissingFile);
        if let Some(near) = near {
            diagnostic.help(format!("did you mean `{near}`?"));
        }
        if frames.len() < count {
            diagnostic.help("make the files, or choose the frames that there are with `frames: {first: …, last: …}`");
        }
        diagnostic.help("relative names start from the folder of the scene file");
    }

    /// A file that must exist and have one of some endings.
    pub(crate) fn file(&mut self, key: &str, name: &str, endings: &[&str]) {
        if self.has_ending(key, name, endings) && !resolve(self.path, name).is_file() {
            self.missing(key, name);
        }
    }

    fn has_ending(&mut self, key: &str, name: &str, endings: &[&str]) -> bool {
        let ending = Path::new(name).extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        let fits = endings.contains(&ending.as_str());
        if !fits {
            let allowed = endings.iter().map(|e| format!("`.{e}`")).collect::<Vec<_>>().join(" or ");
            self.error(key, key, format!("the file name must end in {allowed}"));
        }
        fits
    }

    pub(crate) fn pattern(&mut self, key: &str, text: &str, ending: &str) -> Option<Pattern> {
        match Pattern::parse(text) {
            Ok(pattern) => self.has_ending(key, text, &[ending]).then_some(pattern),
            Err(error) => {
                self.error(key, key, error.to_string());
                None
            }
        }
    }

    fn lights(&mut self) {
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

    fn output(&mut self, output: &Output) {
        let has_many_frames = self.settings.frames.last > self.settings.frames.first && self.is_sound("frames");
        let preview = output.preview.as_deref();
        let files = [
            ("image", Some(output.image.as_str()), "exr"),
            ("preview", preview, "png"),
            ("volume", Some(&output.volume), "vdb"),
        ];
        for (name, text, ending) in files {
            let Some(text) = text else { continue };
            let key = format!("output.{name}");
            let Some(pattern) = self.pattern(&key, text, ending) else { continue };
            if has_many_frames && !pattern.has_frame() {
                let stem = text.strip_suffix(&format!(".{ending}")).unwrap_or(text);
                let message = "all frames would be written to this one file";
                self.error_help(&key, &key, message, format!("put the frame into the name: `{stem}.####.{ending}`"));
            }
        }
        let is_lossy = matches!(output.compression, Compression::Dwaa | Compression::Dwab);
        if is_lossy
            && output.layout == Layout::Single
            && let Some(aov) = output.aovs.iter().find(|aov| !aov.is_colour())
        {
            let message = format!("one part with everything would lose numbers of the layer `{}`", aov.name());
            let help = "write `layout: multipart` or `separate`, or one of zips, zip and piz";
            self.error_help("output.compression", "output.compression", message, help);
        }
        let mut seen = BTreeSet::new();
        for (index, aov) in output.aovs.iter().enumerate() {
            if !seen.insert(format!("{aov:?}")) {
                let key = format!("output.aovs[{index}]");
                self.error(&key, &key, "this layer is listed twice");
            }
        }
    }
}
