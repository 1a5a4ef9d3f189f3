//! What a schema cannot say: cross references, relations between keys, files that must exist, and whether the whole
//! fits into memory. All problems are collected.

use crate::scene::conform::decimal;
use crate::scene::diagnostic::{Collector, Diagnostic, Fault, listed, nearest};
use crate::scene::pattern::Pattern;
use crate::scene::settings::{
    Camera, Emitter, Environment, Frames, Light, Output, Phase, Potential, Settings, Shape, Smoke, Vec3,
};
use crate::scene::tree::Node;
use crate::scene::{footprint, nearest_file, resolve};
use std::collections::BTreeSet;
use std::path::Path;

/// Least ratio of a kernel's reach to the edge of a voxel: below it, particles between voxel centres lose their shape.
const KERNEL_VOXELS_MIN: f64 = 1.5;
/// Largest such ratio. A kernel of 64 voxels touches a million of them for each particle.
const KERNEL_VOXELS_MAX: f64 = 64.0;
/// Most steps of a particle's clock from the first birth to the last frame.
const STEP_COUNT_MAX: f64 = 1e7;
/// Frames of a density sequence that are looked for.
const FILE_COUNT_MAX: i64 = 10_000;
/// Beyond this asymmetry, light paths become so rare that pictures hardly converge.
const G_SENSIBLE: f64 = 0.95;
/// Mean optical depth over the picture below which no eye sees the smoke.
const OPTICAL_DEPTH_VISIBLE: f64 = 1e-3;

/// Checks settings that fit the schema. Keys in `mended`, and what depends on them, are not judged.
pub fn validate(settings: &Settings, tree: &Node, mended: &[String], path: &Path, collector: &mut Collector<'_>) {
    let mut check = Check { settings, tree, mended, path, collector };
    check.frames(&settings.frames);
    check.camera(&settings.camera);
    check.shapes();
    check.flow();
    if let Some(smoke) = &settings.smoke {
        check.smoke(smoke);
    }
    check.lights();
    check.output(&settings.output);
    check.footprint();
}

struct Check<'s, 'c, 'a> {
    settings: &'s Settings,
    tree: &'s Node,
    mended: &'s [String],
    path: &'s Path,
    collector: &'c mut Collector<'a>,
}

/// Whether a key path is the scope or lies within it.
fn is_inside(path: &str, scope: &str) -> bool {
    path.strip_prefix(scope).is_some_and(|rest| scope.is_empty() || rest.is_empty() || rest.starts_with(['.', '[']))
}

fn length(v: Vec3) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn difference(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Whether two directions are parallel to within what an f32 can tell.
fn is_parallel(a: Vec3, b: Vec3) -> bool {
    length(cross(a, b)) <= 1e-6 * length(a) * length(b)
}

fn listed_all(names: &BTreeSet<&str>) -> String {
    if names.is_empty() { "none".into() } else { listed(names.iter().copied()) }
}

impl<'s> Check<'s, '_, '_> {
    /// Whether a key and everything around and inside it passed the schema.
    fn is_sound(&self, key: &str) -> bool {
        !self.mended.iter().any(|mended| is_inside(mended, key) || is_inside(key, mended))
    }

    /// Reports an error unless something within `scope` is already known to be wrong.
    fn error(&mut self, key: &str, scope: &str, message: impl Into<String>) -> Option<&mut Diagnostic> {
        if !self.is_sound(key) || !self.is_sound(scope) {
            return None;
        }
        Some(self.collector.error(self.tree.place_of(key), key, message))
    }

    fn error_help(&mut self, key: &str, scope: &str, message: impl Into<String>, help: impl Into<String>) {
        if let Some(diagnostic) = self.error(key, scope, message) {
            diagnostic.help(help);
        }
    }

    fn warning(&mut self, key: &str, scope: &str, message: impl Into<String>, help: impl Into<String>) {
        if self.is_sound(key) && self.is_sound(scope) {
            self.collector.warning(self.tree.place_of(key), key, message).help(help);
        }
    }

    fn direction(&mut self, key: &str, direction: Vec3) {
        if length(direction) < 1e-9 {
            self.error_help(key, key, "a direction of length 0", "give a direction of any other length");
        }
    }

    /// Reports unless exactly one of the named keys is given.
    fn exactly_one(&mut self, key: &str, given: &[(&str, bool)]) {
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

    fn camera(&mut self, camera: &Camera) {
        let view = difference(camera.look_at, camera.position);
        if length(view) < 1e-9 {
            self.error("camera.look_at", "camera", "the camera looks at the point where it stands");
            return;
        }
        if length(camera.up) < 1e-9 {
            self.direction("camera.up", camera.up);
        } else if is_parallel(view, camera.up) {
            let message = "`up` is parallel to the direction of view";
            self.error_help("camera.up", "camera", message, "looking straight up or down, take `up: [0, 0, -1]`");
        }
    }

    fn shapes(&mut self) {
        for (name, shape) in &self.settings.shapes {
            let key = format!("shapes.{name}");
            let is_plain = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
            if !is_plain || name.is_empty() || name.len() > 64 {
                // Such a name may look like a key path, so that its place cannot be found by path.
                let place =
                    self.tree.get("shapes").and_then(|shapes| shapes.node.get(name)).map(|shape| shape.key_place);
                let message = "a name has 1 to 64 letters, digits, `_` and `-`";
                self.collector.error(place.unwrap_or_else(|| self.tree.place_of("shapes")), &key, message);
                continue;
            }
            let given = [
                ("sphere", shape.sphere.is_some()),
                ("box", shape.cuboid.is_some()),
                ("capsule", shape.capsule.is_some()),
                ("torus", shape.torus.is_some()),
                ("plane", shape.plane.is_some()),
                ("mesh", shape.mesh.is_some()),
            ];
            self.exactly_one(&key, &given);
            self.shape(&key, shape);
            if !shape.visible && !self.settings.flow.obstacles.contains(name) && !self.is_emitter(name) {
                let key_visible = format!("{key}.visible");
                let message = format!("`{name}` has no effect: it is invisible, no obstacle and no emitter");
                self.warning(&key_visible, "flow.obstacles", message, "name it in `flow.obstacles`, or remove it");
            }
        }
    }

    fn is_emitter(&self, shape: &str) -> bool {
        let emitters = self.settings.smoke.iter().flat_map(|smoke| &smoke.emitters);
        emitters.filter_map(|emitter| emitter.mesh.as_ref()).any(|mesh| mesh.shape == shape)
    }

    fn shape(&mut self, key: &str, shape: &Shape) {
        if let Some(cuboid) = &shape.cuboid {
            let shortest = cuboid.size.iter().copied().fold(f64::INFINITY, f64::min);
            if cuboid.rounding > shortest / 2.0 {
                let allowed = decimal(shortest / 2.0);
                let message =
                    format!("must be at most half the shortest edge, {allowed}, found {}", decimal(cuboid.rounding));
                self.error(&format!("{key}.box.rounding"), &format!("{key}.box"), message);
            }
        }
        if let Some(capsule) = &shape.capsule
            && length(difference(capsule.start, capsule.end)) < 1e-9
        {
            let scope = format!("{key}.capsule");
            self.error_help(&format!("{scope}.end"), &scope, "both ends are the same point", "use `sphere`");
        }
        if let Some(torus) = &shape.torus {
            let scope = format!("{key}.torus");
            self.direction(&format!("{scope}.axis"), torus.axis);
            if torus.minor_radius >= torus.major_radius {
                let major = decimal(torus.major_radius);
                let message =
                    format!("must be less than `major_radius`, {major}, found {}", decimal(torus.minor_radius));
                self.error(&format!("{scope}.minor_radius"), &scope, message);
            }
        }
        if let Some(plane) = &shape.plane {
            self.direction(&format!("{key}.plane.normal"), plane.normal);
        }
        if let Some(mesh) = &shape.mesh {
            self.file(&format!("{key}.mesh.file"), &mesh.file, &["obj", "ply"]);
        }
        self.direction(&format!("{key}.transform.rotate_deg.axis"), shape.transform.rotate_deg.axis);
    }

    fn flow(&mut self) {
        let names: BTreeSet<&str> = self.settings.shapes.keys().map(String::as_str).collect();
        let mut seen = BTreeSet::new();
        for (index, name) in self.settings.flow.obstacles.iter().enumerate() {
            let key = format!("flow.obstacles[{index}]");
            if !names.contains(name.as_str()) {
                self.unknown_shape(&key, name, &names);
            } else if !seen.insert(name) {
                self.error(&key, &key, format!("`{name}` is listed twice"));
            }
        }
        let voxel = self.settings.smoke.as_ref().and_then(|smoke| smoke.grid.as_ref()).map(|grid| grid.voxel_size);
        for (index, potential) in self.settings.flow.potentials.iter().enumerate() {
            let (Potential::Noise(noise), Some(voxel)) = (potential, voxel) else { continue };
            let smallest = noise.length_scale / noise.lacunarity.powi(noise.octaves.saturating_sub(1) as i32);
            if smallest < voxel {
                let key = format!("flow.potentials[{index}].noise.octaves");
                let message = format!("the smallest swirls, {smallest:.2e} m, are smaller than a voxel");
                self.warning(&key, "smoke.grid", message, "fewer octaves look the same and are faster");
            }
        }
    }

    fn unknown_shape(&mut self, key: &str, name: &str, names: &BTreeSet<&str>) {
        let Some(diagnostic) = self.error(key, key, format!("there is no shape `{name}`")) else { return };
        if let Some(name) = nearest(name, names.iter().copied()) {
            diagnostic.help(format!("did you mean `{name}`?"));
        }
        diagnostic.help(format!("shapes of this scene: {}", listed_all(names)));
    }

    fn smoke(&mut self, smoke: &Smoke) {
        match (&smoke.file, smoke.emitters.is_empty()) {
            (Some(_), false) => {
                let message = "smoke comes from `emitters` or from a `file`, not from both";
                self.error("smoke.file", "smoke.file", message);
            }
            (None, true) => {
                self.error_help(
                    "smoke",
                    "smoke",
                    "smoke needs `emitters` or a `file`",
                    "without smoke, leave `smoke` out",
                );
            }
            _ => {}
        }
        match &smoke.grid {
            None if !smoke.emitters.is_empty() => {
                let help = "for example `grid: {voxel_size: 0.02}`";
                self.error_help("smoke", "smoke.grid", "`emitters` need a `grid`", help);
            }
            Some(grid) => {
                let reach = grid.kernel_radius.unwrap_or(KERNEL_VOXELS_MIN * grid.voxel_size);
                if reach < KERNEL_VOXELS_MIN * grid.voxel_size * (1.0 - 1e-9) {
                    let least = decimal(KERNEL_VOXELS_MIN * grid.voxel_size);
                    let message = format!("must be at least 1.5 voxels, {least}, found {}", decimal(reach));
                    self.error("smoke.grid.kernel_radius", "smoke.grid", message);
                }
                let oldest = smoke.emitters.iter().map(|e| e.lifetime * (1.0 + e.lifetime_spread)).fold(0.0, f64::max);
                let widest = (reach * reach + grid.expansion * grid.expansion * oldest).sqrt() / grid.voxel_size;
                if widest > KERNEL_VOXELS_MAX {
                    let is_expanding = grid.expansion * grid.expansion * oldest > reach * reach;
                    let key = if is_expanding { "smoke.grid.expansion" } else { "smoke.grid.kernel_radius" };
                    let message = format!("kernels reach {widest:.0} voxels; at most {KERNEL_VOXELS_MAX} are allowed");
                    self.error_help(key, "smoke", message, "take larger voxels, or smaller kernels");
                }
            }
            _ => {}
        }
        for (index, emitter) in smoke.emitters.iter().enumerate() {
            self.emitter(&format!("smoke.emitters[{index}]"), emitter);
        }
        if let Some(file) = &smoke.file {
            self.density_file(&file.path);
        }
        let Phase::HenyeyGreenstein { g } = smoke.medium.phase;
        if g.abs() > G_SENSIBLE {
            let message = format!("|g| above {G_SENSIBLE} is very noisy");
            let help = "smoke looks right from 0 to 0.8";
            self.warning("smoke.medium.phase.henyey_greenstein.g", "smoke.medium", message, help);
        }
        self.visibility(smoke);
    }

    /// Warns of smoke that nobody will see, the commonest cause of an empty picture.
    fn visibility(&mut self, smoke: &Smoke) {
        let medium = &smoke.medium;
        if medium.extinction == 0.0 {
            let message = "smoke of extinction 0 is invisible";
            self.warning("smoke.medium.extinction", "smoke.medium", message, "the default is 10");
            return;
        }
        if smoke.emitters.is_empty() {
            return;
        }
        // All smoke spread evenly over the picture: mass [density · m³] times extinction [1/m] over area [m²].
        let mass: f64 =
            smoke.emitters.iter().map(|e| if e.rate.is_some() { e.mass * e.lifetime } else { e.mass }).sum();
        let camera = &self.settings.camera;
        let distance = length(difference(camera.look_at, camera.position));
        let height = 2.0 * distance * (camera.vertical_fov_deg.to_radians() / 2.0).tan();
        let [width_px, height_px] = self.settings.film.resolution.map(f64::from);
        let optical_depth = mass * medium.extinction / (height * height * width_px / height_px);
        if optical_depth < OPTICAL_DEPTH_VISIBLE && self.is_sound("camera") && self.is_sound("film") {
            let message = format!(
                "the smoke is practically invisible: spread over the picture its optical depth is {optical_depth:.1e}"
            );
            let help = "raise `smoke.medium.extinction`, or the `mass` of the emitters";
            self.warning("smoke.medium.extinction", "smoke", message, help);
        }
    }

    fn emitter(&mut self, key: &str, emitter: &Emitter) {
        let given = [
            ("point", emitter.point.is_some()),
            ("disk", emitter.disk.is_some()),
            ("sphere", emitter.sphere.is_some()),
            ("box", emitter.cuboid.is_some()),
            ("mesh", emitter.mesh.is_some()),
        ];
        self.exactly_one(key, &given);
        self.exactly_one(key, &[("rate", emitter.rate.is_some()), ("count", emitter.count.is_some())]);
        if let Some(disk) = &emitter.disk {
            self.direction(&format!("{key}.disk.normal"), disk.normal);
        }
        if let Some(mesh) = &emitter.mesh {
            self.emitter_mesh(&format!("{key}.mesh.shape"), &mesh.shape);
        }
        let key_stop = format!("{key}.stop");
        let key_start = format!("{key}.start");
        match emitter.stop {
            Some(_) if emitter.count.is_some() => {
                self.error(&key_stop, &key_stop, "`stop` goes with `rate`; a `count` is born all at once");
            }
            Some(stop) if stop <= emitter.start => {
                let message = format!("must be after `start`, {}, found {}", decimal(emitter.start), decimal(stop));
                self.error(&key_stop, &key_start, message);
                return;
            }
            _ => {}
        }
        let frames = &self.settings.frames;
        if !self.is_sound("frames") || !self.is_sound("smoke.advect") {
            return;
        }
        let end = f64::from(frames.last.saturating_sub(frames.first)) / frames.fps;
        let substeps = self.settings.smoke.as_ref().map_or(1, |smoke| smoke.advect.substeps);
        let step_count = (end - emitter.start) * frames.fps * f64::from(substeps);
        if step_count > STEP_COUNT_MAX {
            let message = format!("{step_count:.1e} time steps from here to the last frame; at most 1e7 are allowed");
            let help = "particles live for `lifetime`, so that nothing changes by starting earlier than that";
            self.error_help(&key_start, &key_start, message, help);
        }
        let amount = match (emitter.rate, emitter.count) {
            (Some(_), None) => "rate",
            (None, Some(_)) => "count",
            _ => return,
        };
        if footprint::live_count(emitter, frames) < 1.0 {
            let message = "no particle of this emitter is alive in any frame";
            let help = format!("check `{amount}`, `start` and `lifetime`; the first frame is at 0 s");
            self.warning(&format!("{key}.{amount}"), key, message, help);
        }
    }

    fn emitter_mesh(&mut self, key: &str, name: &str) {
        match self.settings.shapes.get(name) {
            None => {
                let meshes = self.settings.shapes.iter().filter(|(_, shape)| shape.mesh.is_some());
                let names = meshes.map(|(name, _)| name.as_str()).collect();
                self.unknown_shape(key, name, &names);
            }
            Some(shape) if shape.mesh.is_none() && self.is_sound(&format!("shapes.{name}")) => {
                let message = format!("the shape `{name}` is not a mesh");
                self.error_help(key, key, message, "for smoke from a simple solid take `disk`, `sphere` or `box`");
            }
            _ => {}
        }
    }

    fn density_file(&mut self, pattern: &str) {
        let key = "smoke.file.path";
        let Some(pattern) = self.pattern(key, pattern, "vdb") else { return };
        let frames = &self.settings.frames;
        let count = i64::from(frames.last) - i64::from(frames.first) + 1;
        if !self.is_sound("frames") || count < 1 {
            return;
        }
        let scene = self.path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        let looked = if pattern.has_frame() { count.min(FILE_COUNT_MAX) } else { 1 };
        for frame in (i64::from(frames.first)..).take(looked as usize) {
            let name = pattern.expand(frame as i32, &scene);
            if !resolve(self.path, &name).is_file() {
                self.missing(key, &name);
                return;
            }
        }
    }

    fn missing(&mut self, key: &str, name: &str) {
        let path = resolve(self.path, name);
        let near = nearest_file(&path);
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

    /// A file that must exist and have one of some endings.
    fn file(&mut self, key: &str, name: &str, endings: &[&str]) {
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

    fn pattern(&mut self, key: &str, text: &str, ending: &str) -> Option<Pattern> {
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
        if lights.is_empty() && !has_unknown_section {
            let help = "for example `lights: [{environment: {radiance: [1, 1, 1]}}]`";
            self.error_help("lights", "lights", "without a light the picture is black", help);
        }
        let mut is_dark = !lights.is_empty();
        for (index, light) in lights.iter().enumerate() {
            let key = format!("lights[{index}]");
            let power = match light {
                Light::Sun(sun) => {
                    self.direction(&format!("{key}.sun.direction"), sun.direction);
                    sun.irradiance
                }
                Light::Environment(environment) => self.environment(&format!("{key}.environment"), environment),
                Light::Rectangle(rectangle) => {
                    let key = format!("{key}.rectangle");
                    if is_parallel(rectangle.half_u, rectangle.half_v) {
                        let message = "`half_u` and `half_v` are parallel, so that the rectangle has no area";
                        self.error(&format!("{key}.half_v"), &key, message);
                    }
                    rectangle.radiance
                }
                Light::Sphere(sphere) => sphere.radiance,
                Light::Point(point) => point.intensity,
            };
            is_dark &= power == [0.0; 3];
        }
        if is_dark {
            self.warning("lights", "lights", "all lights are black", "raise one of them above 0");
        }
    }

    /// Checks it and returns how bright it is.
    fn environment(&mut self, key: &str, environment: &Environment) -> [f64; 3] {
        let given = [
            ("radiance", environment.radiance.is_some()),
            ("gradient", environment.gradient.is_some()),
            ("file", environment.file.is_some()),
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
        let mut seen = BTreeSet::new();
        for (index, aov) in output.aovs.iter().enumerate() {
            if !seen.insert(format!("{aov:?}")) {
                let key = format!("output.aovs[{index}]");
                self.error(&key, &key, "this layer is listed twice");
            }
        }
    }

    /// Refuses what cannot fit, before anything is allocated.
    fn footprint(&mut self) {
        let limit = self.settings.render.memory_limit_gib * (1u64 << 30) as f64;
        let gib = |bytes: f64| match bytes / (1u64 << 30) as f64 {
            size if size < 1.0 => format!("{:.0} MiB", size * 1024.0),
            size => format!("{size:.1} GiB"),
        };
        let film = footprint::film_bytes(&self.settings.film);
        if !self.is_sound("render.memory_limit_gib") {
            return;
        }
        if film > limit {
            let [width, height] = self.settings.film.resolution;
            let message = format!("{width} × {height} pixels need {}; the limit is {}", gib(film), gib(limit));
            if let Some(diagnostic) = self.error("film.resolution", "film.resolution", message) {
                diagnostic
                    .fault(Fault::OverMemoryLimit)
                    .help("lower the resolution, or raise `render.memory_limit_gib`");
            }
        }
        let Some(smoke) = &self.settings.smoke else { return };
        if !self.is_sound("frames") || !self.is_sound("smoke.emitters") {
            return;
        }
        let counts: Vec<f64> = smoke.emitters.iter().map(|e| footprint::live_count(e, &self.settings.frames)).collect();
        let total: f64 = counts.iter().sum();
        let bytes = total * footprint::PARTICLE_BYTES;
        if bytes > limit {
            // The greatest emitter is the one to change.
            let largest = (0..counts.len()).max_by(|&a, &b| counts[a].total_cmp(&counts[b])).unwrap_or(0);
            let amount = if smoke.emitters[largest].rate.is_some() { "rate" } else { "count" };
            let key = format!("smoke.emitters[{largest}].{amount}");
            let message = format!(
                "up to {} particles would be alive at once and need {}; the limit is {}",
                decimal(total.round()),
                gib(bytes),
                gib(limit)
            );
            if let Some(diagnostic) = self.error(&key, &key, message) {
                diagnostic
                    .fault(Fault::OverMemoryLimit)
                    .help(format!("lower `{amount}` or `lifetime`, or raise `render.memory_limit_gib`"))
                    .help("more particles make the smoke smoother, not denser: `mass` does that");
            }
        }
    }
}
