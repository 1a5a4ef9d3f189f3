//! What a schema cannot say about the flow and about shapes that move.

use crate::schema::decimal;
use crate::settings::{Dfvn, Interpolation, Mask, Motion, Noise, NoiseForm, Part, Potential, Shape, Vec3, VortexCurve};
use crate::validate::{Check, difference, is_parallel, length};
use std::collections::BTreeSet;

/// Least difference between two ends of a mask [m].
const MASK_WIDTH_MIN: f64 = 1e-9;
/// Most pieces that a vortex along a line is made of.
const VORTEX_PIECES_MAX: f64 = 20_000.0;
/// Pieces for each core radius of its length.
const VORTEX_PIECES: f64 = 5.0;

/// How deep the deepest points of a shape are below its wall [m]; of a mesh it is not known before it is read.
fn depth(shape: &Shape) -> Option<f64> {
    let own = None
        .or(shape.sphere.as_ref().map(|sphere| sphere.radius))
        .or(shape.capsule.as_ref().map(|capsule| capsule.radius))
        .or(shape.torus.as_ref().map(|torus| torus.minor_radius))
        .or(shape.smooth_union.as_ref().map(|union| union.parts.iter().map(part_depth).fold(f64::INFINITY, f64::min)));
    own.map(|depth: f64| depth * shape.transform.scale.first())
}

/// The same of a part of a union; a box has no place there.
fn part_depth(part: &Part) -> f64 {
    let own = None
        .or(part.sphere.as_ref().map(|sphere| sphere.radius))
        .or(part.capsule.as_ref().map(|capsule| capsule.radius))
        .or(part.torus.as_ref().map(|torus| torus.minor_radius));
    own.map_or(f64::INFINITY, |depth: f64| depth * part.transform.scale.first())
}

impl Check<'_, '_, '_> {
    pub(crate) fn flow(&mut self) {
        let flow = &self.settings.flow;
        let shapes: BTreeSet<&str> = self.settings.shapes.keys().map(String::as_str).collect();
        self.names("flow.obstacles", &flow.obstacles, &shapes);
        self.names("flow.containers", &flow.containers, &shapes);
        if let Some(dfvn) = &flow.dfvn {
            self.dfvn(dfvn, &shapes);
        }
        for (i, name) in flow.containers.iter().enumerate() {
            let key = format!("flow.containers[{i}]");
            if flow.obstacles.contains(name) {
                let message = format!("`{name}` is an obstacle already; the flow is either round it or inside it");
                self.error(&key, &key, message);
            }
            let Some(shape) = self.settings.shapes.get(name) else { continue };
            self.holder(&key, shape, "take a `box`, or name the plane in `obstacles`");
        }
        let walls: BTreeSet<&str> = flow.obstacles.iter().chain(&flow.containers).map(String::as_str).collect();
        for (i, name) in flow.no_slip.iter().enumerate() {
            if !walls.contains(name.as_str()) {
                let key = format!("flow.no_slip[{i}]");
                let message = format!("`{name}` is neither in `flow.obstacles` nor in `flow.containers`");
                self.error_help(&key, "flow", message, "only walls can hold the flow");
            }
        }
        if let Some(normal) = flow.planar {
            self.direction("flow.planar", normal);
            for (i, potential) in flow.potentials.iter().enumerate() {
                self.in_planes(&format!("flow.potentials[{i}].{}", potential.name()), potential, normal);
            }
        }
        for (i, potential) in flow.potentials.iter().enumerate() {
            self.potential(&format!("flow.potentials[{i}]"), potential, &shapes);
        }
    }

    /// What a shape must be like that holds the flow inside.
    fn holder(&mut self, key: &str, shape: &Shape, instead: &str) {
        if shape.plane.is_some() {
            self.error_help(key, key, "a plane contains nothing", instead);
        }
        if shape.cuboid.as_ref().is_some_and(|cuboid| cuboid.rounding > 0.0) {
            self.error(key, key, "the box of a container must have `rounding: 0`");
        }
        if shape.smooth_union.as_ref().is_some_and(|union| union.parts.iter().any(|part| part.cuboid.is_some())) {
            let message =
                "a box among the parts: from its edges on the distance has ridges, at which the flow inside would jump";
            self.error_help(key, key, message, "take balls, capsules and rings, or a `box` alone in `containers`");
        }
    }

    fn dfvn(&mut self, dfvn: &Dfvn, shapes: &BTreeSet<&str>) {
        let flow = &self.settings.flow;
        for (key, is_given) in [
            ("potentials", !flow.potentials.is_empty()),
            ("obstacles", !flow.obstacles.is_empty()),
            ("containers", !flow.containers.is_empty()),
            ("no_slip", !flow.no_slip.is_empty()),
            ("planar", flow.planar.is_some()),
        ] {
            if is_given {
                let message = format!("`dfvn` is a flow of its own, and `{key}` do nothing to it");
                let help = match key {
                    "obstacles" | "containers" => {
                        "name the shape in `flow.dfvn.inside` or `flow.dfvn.along`, or take potentials instead of `dfvn`"
                    }
                    _ => "leave it out, or take potentials instead of `dfvn`",
                };
                let key = format!("flow.{key}");
                self.error_help(&key, &key, message, help);
            }
        }
        for (key, name) in [("inside", &dfvn.inside), ("along", &dfvn.along)] {
            let Some(name) = name else { continue };
            let key = format!("flow.dfvn.{key}");
            let Some(shape) = self.settings.shapes.get(name) else {
                self.unknown_shape(&key, name, shapes);
                continue;
            };
            if shape.motion.is_some() {
                let message = format!("`{name}` moves, and this flow is steady");
                self.error_help(&key, &key, message, "take a shape without `motion`, or potentials in `containers`");
            }
        }
        if let (Some(inside), Some(along)) = (&dfvn.inside, &dfvn.along)
            && inside == along
        {
            let message = format!("`{along}` is in `inside` too: who goes along its surface stays inside anyway");
            self.error_help("flow.dfvn.along", "flow.dfvn", message, "leave out one of both");
        }
        let Some(name) = &dfvn.inside else {
            if dfvn.margin.is_some() {
                let message = "`margin` is the depth below the wall of `inside`, which is not given";
                self.error_help("flow.dfvn.margin", "flow.dfvn", message, "leave it out, or name a shape in `inside`");
            }
            return;
        };
        let Some(shape) = self.settings.shapes.get(name) else { return };
        let key = "flow.dfvn.inside";
        self.holder(key, shape, "take a closed shape, such as a `capsule`");
        if shape.cuboid.is_some() {
            let message = "a box: from its edges on the distance has ridges, at which the flow inside would jump";
            self.error_help(
                key,
                key,
                message,
                "take a ball, a capsule, a ring or a mesh, or potentials in `containers`",
            );
        }
        let (Some(margin), Some(depth)) = (dfvn.margin, depth(shape)) else { return };
        if margin > depth * (1.0 + 1e-9) && self.is_sound(&format!("shapes.{name}")) {
            let depth = decimal(depth);
            let message = format!(
                "must be at most {depth}, the depth of `{name}`, found {}: where the distance has its ridge the flow would jump",
                decimal(margin)
            );
            self.error("flow.dfvn.margin", "flow.dfvn", message);
        }
    }

    /// What a potential of a flow in two dimensions must be like.
    fn in_planes(&mut self, key: &str, potential: &Potential, normal: Vec3) {
        let none = |what: &str| Some(format!("there is no {what} in two dimensions"));
        let outward = |v: Vec3| (0..3).map(|i| v[i] * normal[i]).sum::<f64>().abs() > 1e-9 * length(v) * length(normal);
        let is_out = |v: Vec3| length(v) > 0.0 && is_parallel(v, normal);
        let message = match potential {
            Potential::Plume(_) | Potential::VortexRing(_) | Potential::VortexCurve(_) => none(potential.name()),
            Potential::Noise(noise) if noise.form == NoiseForm::Bitangent => none("bitangent noise"),
            Potential::Noise(noise) => {
                let is_other = noise.planar.is_some_and(|own| length(own) > 0.0 && !is_parallel(own, normal));
                is_other.then(|| "its `planar` must have the direction of `flow.planar`".to_owned())
            }
            Potential::Uniform(uniform) if is_out(uniform.velocity) => {
                Some("points out of the planes of `flow.planar`, and so does nothing".into())
            }
            Potential::Shear(shear) if outward(shear.direction) || outward(shear.across) => {
                Some("`direction` and `across` must be in the planes of `flow.planar`".into())
            }
            Potential::Vortex(vortex) if length(vortex.angular_velocity) > 0.0 && !outward(vortex.angular_velocity) => {
                Some("turns about an axis in the planes of `flow.planar`, and so does nothing".into())
            }
            Potential::Rigid(rigid) if length(rigid.angular_velocity) > 0.0 && !outward(rigid.angular_velocity) => {
                Some("turns about an axis in the planes of `flow.planar`, and so does nothing".into())
            }
            _ => None,
        };
        if let Some(message) = message {
            self.error_help(key, "flow", message, "leave out `flow.planar`, or take another potential");
        }
    }

    fn names(&mut self, list: &str, names: &[String], shapes: &BTreeSet<&str>) {
        let mut seen = BTreeSet::new();
        for (i, name) in names.iter().enumerate() {
            let key = format!("{list}[{i}]");
            if !shapes.contains(name.as_str()) {
                self.unknown_shape(&key, name, shapes);
            } else if !seen.insert(name) {
                self.error(&key, &key, format!("`{name}` is listed twice"));
            }
        }
    }

    fn potential(&mut self, key: &str, potential: &Potential, shapes: &BTreeSet<&str>) {
        let kind = match potential {
            Potential::Uniform(_) => "uniform",
            Potential::Shear(shear) => {
                self.direction(&format!("{key}.shear.direction"), shear.direction);
                self.direction(&format!("{key}.shear.across"), shear.across);
                if length(shear.direction).min(length(shear.across)) > 0.0 && is_parallel(shear.direction, shear.across)
                {
                    let message = "`across` is parallel to `direction`: such a flow would be compressed";
                    self.error(&format!("{key}.shear.across"), &format!("{key}.shear"), message);
                }
                "shear"
            }
            Potential::Rigid(_) => "rigid",
            Potential::Plume(plume) => {
                self.direction(&format!("{key}.plume.axis"), plume.axis);
                "plume"
            }
            Potential::Noise(noise) => {
                self.noise(&format!("{key}.noise"), noise);
                "noise"
            }
            Potential::Vortex(_) => "vortex",
            Potential::VortexRing(ring) => {
                self.direction(&format!("{key}.vortex_ring.axis"), ring.axis);
                let around = std::f64::consts::TAU * ring.radius;
                self.pieces(&format!("{key}.vortex_ring"), around / ring.core);
                "vortex_ring"
            }
            Potential::VortexCurve(curve) => {
                self.curve(&format!("{key}.vortex_curve"), curve);
                "vortex_curve"
            }
        };
        for (i, mask) in potential.masks().iter().enumerate() {
            self.mask(&format!("{key}.{kind}.modulate[{i}]"), mask, shapes);
        }
    }

    fn noise(&mut self, key: &str, noise: &Noise) {
        if noise.spin_rate != 0.0 && noise.evolve_rate != 0.0 {
            let message = "swirls either turn (`spin_rate`) or give way to others (`evolve_rate`), not both";
            self.error(&format!("{key}.evolve_rate"), key, message);
        }
        if let Some(normal) = noise.planar {
            self.direction(&format!("{key}.planar"), normal);
            if noise.form == NoiseForm::Bitangent {
                let key = format!("{key}.planar");
                self.error_help(&key, &key, "`planar` swirls are curls", "leave out `planar`, or `form: bitangent`");
            }
        }
        let smoke = self.settings.smoke.as_ref();
        let Some(voxel) = smoke.and_then(|smoke| smoke.grid.as_ref()).map(|grid| grid.voxel_size) else { return };
        let smallest = noise.length_scale / noise.lacunarity.powi(noise.octaves.saturating_sub(1) as i32);
        if smallest < voxel {
            let message = format!("the smallest swirls, {smallest:.2e} m, are smaller than a voxel");
            let help = "fewer octaves look the same and are faster";
            self.warning(&format!("{key}.octaves"), "smoke.grid", message, help);
        }
    }

    fn curve(&mut self, key: &str, curve: &VortexCurve) {
        let points = &curve.points;
        if points.len() < 2 {
            let message = format!("a line has at least 2 points, found {}", points.len());
            self.error(&format!("{key}.points"), key, message);
        }
        if let Some(i) = points.windows(2).position(|ends| length(difference(ends[1], ends[0])) < 1e-9) {
            let path = format!("{key}.points[{}]", i + 1);
            self.error(&path, key, "the same point as the one before it");
        }
        let whole: f64 = points.windows(2).map(|ends| length(difference(ends[1], ends[0]))).sum();
        self.pieces(key, whole / curve.core);
    }

    fn pieces(&mut self, key: &str, length_in_cores: f64) {
        if VORTEX_PIECES * length_in_cores > VORTEX_PIECES_MAX {
            let most = VORTEX_PIECES_MAX / VORTEX_PIECES;
            let message =
                format!("the line is {length_in_cores:.0} times as long as `core`; at most {most} is allowed");
            self.error_help(&format!("{key}.core"), key, message, "take a thicker core, or a shorter line");
        }
    }

    fn mask(&mut self, key: &str, mask: &Mask, shapes: &BTreeSet<&str>) {
        let ends = |check: &mut Self, kind: &str, from: f64, to: f64| {
            if (from - to).abs() < MASK_WIDTH_MIN {
                let message = format!("`from` and `to` are both {}: the mask would jump", decimal(to));
                check.error(&format!("{key}.{kind}.to"), &format!("{key}.{kind}"), message);
            }
        };
        match mask {
            Mask::Height(mask) => {
                ends(self, "height", mask.from, mask.to);
                self.direction(&format!("{key}.height.axis"), mask.axis);
            }
            Mask::Shape(mask) => {
                ends(self, "shape", mask.from, mask.to);
                self.mask_shape(&format!("{key}.shape.name"), &mask.name, shapes);
            }
            Mask::Sphere(mask) => ends(self, "sphere", mask.from, mask.to),
            Mask::Box(mask) => ends(self, "box", mask.from, mask.to),
            Mask::Wake(mask) => {
                self.direction(&format!("{key}.wake.direction"), mask.direction);
                let path = format!("{key}.wake.shape");
                self.mask_shape(&path, &mask.shape, shapes);
                if self.settings.shapes.get(&mask.shape).is_some_and(|shape| shape.plane.is_some()) {
                    self.error(&path, &path, "a plane has no end, and so nothing is behind it");
                }
            }
            Mask::Noise(_) => {}
            Mask::Image(mask) => {
                self.file(&format!("{key}.image.file"), &mask.file, &["exr", "hdr"]);
                let (u, v): (Vec3, Vec3) = (mask.half_u, mask.half_v);
                let cosine = (0..3).map(|i| u[i] * v[i]).sum::<f64>() / (length(u) * length(v));
                if cosine.is_nan() || cosine.abs() >= 1e-6 {
                    let message = "`half_u` and `half_v` must be at a right angle, and neither of length 0";
                    self.error(&format!("{key}.image.half_v"), &format!("{key}.image"), message);
                }
            }
            Mask::Grid(mask) => self.file(&format!("{key}.grid.file"), &mask.file, &["vdb"]),
        }
    }

    fn mask_shape(&mut self, key: &str, name: &str, shapes: &BTreeSet<&str>) {
        if !shapes.contains(name) {
            self.unknown_shape(key, name, shapes);
        }
    }

    pub(crate) fn motion(&mut self, key: &str, motion: &Motion, is_plane: bool) {
        if is_plane {
            self.error_help(key, key, "a plane cannot move", "take a `box`, whose face is as flat");
        }
        if motion.keys.len() < 2 {
            let message = format!("a motion has at least 2 keys, found {}", motion.keys.len());
            self.error(&format!("{key}.keys"), key, message);
        }
        for (i, pair) in motion.keys.windows(2).enumerate() {
            if pair[1].time <= pair[0].time {
                let (before, now) = (decimal(pair[0].time), decimal(pair[1].time));
                let path = format!("{key}.keys[{}].time", i + 1);
                self.error(&path, key, format!("times must rise, found {now} after {before}"));
            }
        }
        let name = key.strip_prefix("shapes.").and_then(|key| key.strip_suffix(".motion")).unwrap_or_default();
        if motion.interpolation == Interpolation::Step && self.settings.carries(name) {
            let message = "a shape that guides the flow, holds a volume or lets particles start cannot jump";
            self.error_help(&format!("{key}.interpolation"), key, message, "take `linear` or `ease`");
        }
        for (i, pose) in motion.keys.iter().enumerate() {
            self.direction(&format!("{key}.keys[{i}].rotate_deg.axis"), pose.rotate_deg.axis);
        }
    }
}
