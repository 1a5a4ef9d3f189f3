//! What a schema cannot say about shapes.

use crate::schema::decimal;
use crate::settings::{Capsule, Cuboid, Interpolation, Keyed, Part, Rotation, Shape, Torus, Transform};
use crate::validate::{Check, difference, dot, is_parallel, length};

/// Most parts of a smooth union, each of which is evaluated at every point.
const UNION_PARTS_MAX: usize = 64;

impl Check<'_, '_, '_> {
    pub(crate) fn shapes(&mut self) {
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
