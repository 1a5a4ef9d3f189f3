//! What a schema cannot say about smoke: its sources, its kernels, its files, and whether it fits into memory.

use crate::diagnostic::Fault;
use crate::schema::decimal;
use crate::settings::{CameraProjection, DensityFile, Emitter, Medium, Phase, Remap, Smoke};
use crate::unit::tidy;
use crate::validate::Check;
use crate::{footprint, resolve};

/// Least ratio of a kernel's reach to the edge of a voxel: below it, particles between voxel centres lose their shape.
const KERNEL_VOXELS_MIN: f64 = 1.5;
/// Largest such ratio. A kernel of 64 voxels touches a million of them for each particle.
const KERNEL_VOXELS_MAX: f64 = 64.0;
/// Most steps of a particle's clock from the first birth to the last frame.
const STEP_COUNT_MAX: f64 = 1e7;
/// Frames of a density sequence that are looked for.
const FILE_COUNT_MAX: usize = 10_000;
/// Beyond this asymmetry, light paths become so rare that pictures hardly converge.
const G_SENSIBLE: f64 = 0.95;
/// Mean optical depth over the picture below which no eye sees the smoke.
const OPTICAL_DEPTH_VISIBLE: f64 = 1e-3;

impl Check<'_, '_, '_> {
    pub(crate) fn smoke(&mut self, smoke: &Smoke) {
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
                self.voxel(smoke, grid.voxel_size);
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
            self.density_file("smoke.file", file, smoke.blackbody.is_some());
        }
        self.matter("smoke", &smoke.medium, smoke.blackbody.is_some(), smoke.remap.as_ref());
        // Hot smoke gives off as much as it absorbs.
        if !smoke.medium.glows() {
            self.visibility(smoke);
        }
    }

    /// What smoke and volumes have in common; `key` is that of either.
    pub(crate) fn matter(&mut self, key: &str, medium: &Medium, is_hot: bool, remap: Option<&Remap>) {
        let scope = format!("{key}.medium");
        let lobes: &[(&str, f64)] = match medium.phase {
            Phase::Isotropic | Phase::Droplets { .. } => &[],
            Phase::HenyeyGreenstein { g } => &[("henyey_greenstein.g", g)],
            Phase::TwoLobes { g1, g2, .. } => &[("two_lobes.g1", g1), ("two_lobes.g2", g2)],
        };
        for (lobe, g) in lobes {
            if g.abs() > G_SENSIBLE {
                let message = format!("|g| above {G_SENSIBLE} is very noisy");
                let help = "smoke looks right from 0 to 0.8";
                self.warning(&format!("{scope}.phase.{lobe}"), &scope, message, help);
            }
        }
        if is_hot && medium.albedo.iter().all(|&albedo| albedo == 1.0) {
            let message = "smoke of albedo 1 absorbs nothing, and so does not glow";
            self.warning(&format!("{key}.blackbody"), &scope, message, format!("lower `{scope}.albedo`"));
        }
        if let Some(remap) = remap {
            let [low, high] = remap.in_range;
            if low >= high {
                let message =
                    format!("the lowest density, {}, is not below the highest, {}", decimal(low), decimal(high));
                let scope = format!("{key}.remap");
                self.error_help(&format!("{scope}.in_range"), &scope, message, "write `[lowest, highest]`");
            }
        }
    }

    /// Warns of smoke that nobody will see, the commonest cause of an empty picture.
    fn visibility(&mut self, smoke: &Smoke) {
        let medium = &smoke.medium;
        if medium.extinction == 0.0 || medium.extinction_tint == [0.0; 3] {
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
        let height = match camera.projection {
            CameraProjection::Perspective => {
                2.0 * camera.distance() * (camera.vertical_fov_deg.first().to_radians() / 2.0).tan()
            }
            CameraProjection::Orthographic { height } => height,
            CameraProjection::LatLong => 2.0 * camera.distance(),
        };
        let [width_px, height_px] = self.settings.film.resolution.map(f64::from);
        let most = medium.extinction_tint.iter().copied().fold(0.0, f64::max);
        let optical_depth = mass * medium.extinction * most / (height * height * width_px / height_px);
        if optical_depth < OPTICAL_DEPTH_VISIBLE && self.is_sound("camera") && self.is_sound("film") {
            let message = format!(
                "the smoke is practically invisible: spread over the picture its optical depth is {optical_depth:.1e}"
            );
            let help = "raise `smoke.medium.extinction`, or the `mass` of the emitters";
            self.warning("smoke.medium.extinction", "smoke", message, help);
        }
    }

    /// Warns of voxels so large that the smoke begins as a single one.
    fn voxel(&mut self, smoke: &Smoke, voxel_size: f64) {
        let widths = smoke.emitters.iter().filter_map(|emitter| {
            let radius = emitter.disk.as_ref().map(|s| s.radius).or(emitter.sphere.as_ref().map(|s| s.radius));
            let longest_edge = emitter.cuboid.as_ref().map(|s| s.size.iter().copied().fold(0.0, f64::max));
            radius.map(|radius| 2.0 * radius).or(longest_edge)
        });
        let Some(widest) = widths.max_by(f64::total_cmp) else { return };
        // Meshes have no size before they are read.
        if voxel_size > widest && smoke.emitters.iter().all(|emitter| emitter.mesh.is_none()) {
            let message = format!(
                "a voxel of {} m is larger than the widest emitter, {} m: the smoke will have no shape",
                decimal(voxel_size),
                decimal(widest)
            );
            let help = format!("a tenth of the emitter shows its shape: `voxel_size: {}`", tidy(widest / 10.0));
            self.warning("smoke.grid.voxel_size", "smoke", message, help);
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
        if emitter.strands.is_some() && emitter.count.is_some() {
            let key = format!("{key}.strands");
            let help = "take a `rate`: a strand is drawn by particles that are born one after the other";
            self.error_help(&key, &key, "all particles of a strand would be at the same point", help);
        }
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

    /// The .vdb files of all frames to make, which must be there.
    pub(crate) fn density_file(&mut self, key: &str, file: &DensityFile, is_hot: bool) {
        if is_hot && file.emission.is_some() {
            let message = "smoke glows by its temperature or as the file says, not both";
            self.error_help(&format!("{key}.emission"), key, message, "leave out `blackbody` or `emission`");
        }
        if file.emission.is_none() && file.emission_gain != 1.0 {
            let message = "`emission_gain` has no effect without `emission`, the name of a grid";
            self.error(&format!("{key}.emission_gain"), key, message);
        }
        if file.velocity.is_none() && !file.velocity_units.is_second() {
            let message = "`velocity_units` has no effect without `velocity`, the name of a grid";
            self.error(&format!("{key}.velocity_units"), key, message);
        }
        let key = &format!("{key}.path");
        let Some(pattern) = self.pattern(key, &file.path, "vdb") else { return };
        let frames = &self.settings.frames;
        if !self.is_sound("frames") || frames.last < frames.first {
            return;
        }
        let scene = self.path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        if !pattern.has_frame() {
            let name = pattern.expand(frames.first, &scene);
            if !resolve(self.path, &name).is_file() {
                self.missing(key, &name);
            }
            return;
        }
        let all = frames.first..=frames.last;
        let looked: Vec<i32> = match self.frames_to_make {
            // Those that the scene does not have are somebody else's to refuse.
            Some(some) => some.iter().copied().filter(|frame| all.contains(frame)).take(FILE_COUNT_MAX).collect(),
            None => all.take(FILE_COUNT_MAX).collect(),
        };
        let name_of = |frame: &i32| pattern.expand(*frame, &scene);
        let is_missing = |frame: &i32| !resolve(self.path, &name_of(frame)).is_file();
        let missing: Vec<i32> = looked.iter().copied().filter(is_missing).collect();
        if let Some(first) = missing.first() {
            self.missing_frames(key, &missing, looked.len(), &name_of(first));
        }
    }

    /// Refuses what cannot fit, before anything is allocated.
    pub(crate) fn footprint(&mut self) {
        let limit = self.settings.render.memory_limit_gib * (1u64 << 30) as f64;
        let gib = |bytes: f64| match bytes / (1u64 << 30) as f64 {
            size if size < 1.0 => format!("{:.0} MiB", size * 1024.0),
            size => format!("{size:.1} GiB"),
        };
        let film = footprint::film_bytes(self.settings);
        if !self.is_sound("render.memory_limit_gib") {
            return;
        }
        if film > limit {
            let [width, height] = self.settings.film.size();
            let message = format!("{width} × {height} pixels need {}; the limit is {}", gib(film), gib(limit));
            let help = match self.settings.film.overscan.is_none() {
                true => "lower the resolution, or raise `render.memory_limit_gib`",
                false => "lower the resolution or `film.overscan`, or raise `render.memory_limit_gib`",
            };
            if let Some(diagnostic) = self.error("film.resolution", "film.resolution", message) {
                diagnostic.fault(Fault::OverMemoryLimit).help(help);
            }
        }
        let Some(smoke) = &self.settings.smoke else { return };
        if !self.is_sound("frames") || !self.is_sound("smoke.emitters") {
            return;
        }
        let counts: Vec<f64> = smoke.emitters.iter().map(|e| footprint::live_count(e, &self.settings.frames)).collect();
        let total: f64 = counts.iter().sum();
        let bytes = footprint::held_count(total, &smoke.advect) * footprint::particle_bytes(&self.settings.frames);
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
                    .help("or set `smoke.advect.batch` to hold only so many at once; every frame then takes them from their birth")
                    .help("more particles make the smoke smoother, not denser: `mass` does that");
            }
        }
    }
}
