//! What a schema cannot say: cross references, relations between keys, files that must exist, and whether the whole
//! fits into memory. All problems are collected.

use crate::conform::KeyedFrames;
use crate::diagnostic::{Collector, Diagnostic, Fault, listed, nearest};
use crate::pattern::{Pattern, spell};
use crate::schema::decimal;
use crate::settings::{Camera, CameraProjection, Compression, Film, Frames, Layout, Output, Settings, Vec3};
use crate::tree::Node;
use crate::{nearest_file, resolve};
use std::collections::BTreeSet;
use std::path::Path;

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

/// The checks under way; those of a larger section are in a file of their own, `validate_smoke.rs` and its like.
pub(crate) struct Check<'s, 'c, 'a> {
    pub(crate) settings: &'s Settings,
    tree: &'s Node,
    pub(crate) mended: &'s [String],
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

pub(crate) fn dot(a: Vec3, b: Vec3) -> f64 {
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
