//! What is measured. Each workload stands here once, whether it is timed, counted or made to scale.

use crate::{flow, grid, light, loops, whole};

/// Something to do again and again, always the same.
pub struct Workload {
    /// Operations in a run, of the kind that the kernel's unit names.
    pub operations: u64,
    /// Does all of them on the threads of the current pool.
    pub run: Box<dyn FnMut() + Send>,
}

impl Workload {
    /// A workload of `operations` a run.
    pub fn new(operations: usize, run: impl FnMut() + Send + 'static) -> Self {
        Self { operations: operations as u64, run: Box::new(run) }
    }
}

/// What a kernel is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Compared with what was recorded.
    Compared,
    /// For the roofline and for scaling. Two that do more and less of the same give what one more operation costs.
    Part,
}

/// A workload by name, which nothing is made of before it is asked for.
pub struct Kernel {
    /// By which it is asked for and recorded.
    pub name: &'static str,
    /// What one operation is.
    pub unit: &'static str,
    /// What it is for.
    pub role: Role,
    /// Makes the workload.
    pub prepare: fn() -> Workload,
}

const fn compared(name: &'static str, unit: &'static str, prepare: fn() -> Workload) -> Kernel {
    Kernel { name, unit, role: Role::Compared, prepare }
}

const fn part(name: &'static str, unit: &'static str, prepare: fn() -> Workload) -> Kernel {
    Kernel { name, unit, role: Role::Part, prepare }
}

/// All there are.
pub const KERNELS: &[Kernel] = &[
    compared("noise", "point", flow::noise),
    compared("velocity", "point", || flow::velocity(3, false)),
    compared("velocity by a sphere", "point", || flow::velocity(3, true)),
    compared("velocity by a sphere, scalar", "point", || flow::scalar_velocity(3, true)),
    compared("midpoint step", "particle", || flow::steps(flow::MIDPOINT_STEP, 3, true)),
    compared("Runge-Kutta step", "particle", || flow::steps(flow::CLASSICAL_STEP, 3, true)),
    compared("open midpoint step", "particle", || flow::steps(flow::MIDPOINT_STEP, 4, false)),
    compared("open midpoint step, differences", "particle", flow::difference_steps),
    compared("splat", "particle", || grid::splatting(1.5, 0.0, false)),
    compared("splat, wide", "particle", || grid::splatting(3.0, 0.0, false)),
    compared("splat, wide and soft", "particle", || grid::splatting(3.0, 0.0, true)),
    compared("splat, smeared", "particle", || grid::splatting(1.5, 0.02, false)),
    compared("lookup, scattered", "lookup", grid::scattered_lookups),
    compared("lookup", "lookup", grid::lookups),
    compared("majorant walk", "segment", grid::walk),
    compared("majorants", "voxel", grid::majorants),
    compared("collision", "ray", light::collisions),
    compared("transmittance", "ray", light::transmittances),
    compared("sun transmittance", "ray", light::sun_transmittances),
    compared("sun shadow", "lattice", light::sun_shadow),
    compared("path", "path", || light::paths(light::MAX_BOUNCES)),
    compared("EXR", "pixel", whole::exr),
    compared("frame", "frame", whole::frame),
    part(WALK_FAR, "cell", || grid::full_walk(grid::FAR)),
    part(WALK_NEAR, "cell", || grid::full_walk(grid::NEAR)),
    part(NULLS_MANY, "null collision", || light::null_collisions(light::THICK)),
    part(NULLS_FEW, "null collision", || light::null_collisions(light::THIN)),
    part(VERTICES_MANY, "vertex", || light::vertices(light::MAX_BOUNCES)),
    part(VERTICES_FEW, "vertex", || light::vertices(1)),
    part(PICTURE, "path", light::picture),
    part(INSTRUCTIONS, "link", loops::integer_instructions),
];

/// Walks through cells that are all occupied, to the far end and half as far.
pub const WALK_FAR: &str = "full walk";
/// See [`WALK_FAR`].
pub const WALK_NEAR: &str = "full walk, near";
/// Connections with many null collisions, and with next to none.
pub const NULLS_MANY: &str = "null collisions";
/// See [`NULLS_MANY`].
pub const NULLS_FEW: &str = "null collisions, thin";
/// Paths to their ends, and to the second scattering.
pub const VERTICES_MANY: &str = "vertices";
/// See [`VERTICES_MANY`].
pub const VERTICES_FEW: &str = "vertices, one";
/// A picture of the smoke in tiles, as a frame has it.
pub const PICTURE: &str = "light";

/// Integer instructions at the highest rate.
pub const INSTRUCTIONS: &str = "instructions";

/// The kernel of that name.
pub fn kernel(name: &str) -> Result<&'static Kernel, String> {
    KERNELS.iter().find(|k| k.name == name).ok_or_else(|| {
        let names: Vec<&str> = KERNELS.iter().map(|k| k.name).collect();
        format!("no kernel is named `{name}`; there are: {}", names.join(" · "))
    })
}
