//! Steady flow along the tracks of two functions: divergence-free vector noise in space (Bærentzen et al. 2025), along which
//! both keep their values. Whoever remembers the values at his start can be put back on his track after any step.

use crate::flow::dfvn::{Functions, field};
use crate::flow::field::VelocityField;
use crate::flow::pair::{Pair, RMS_PRODUCT};
use crate::flow::reproject::{Integrator, Reprojection, Trace};
use crate::math::real::{Lane, triple};

/// A steady flow along the tracks of two functions.
#[derive(Debug, Clone)]
pub struct Tracks {
    functions: Pair,
    /// Velocity over the product of the gradients [m/s].
    rate: f64,
    reprojection: Reprojection,
    walls: VelocityField,
}

impl Tracks {
    /// The flow of root mean square speed `speed` [m/s] where no bound is near; `walls` is a field with nothing but the
    /// walls that the functions keep it inside of.
    pub fn new(functions: Pair, speed: f64, reprojection: Reprojection, walls: VelocityField) -> Self {
        Self { functions, rate: speed / RMS_PRODUCT, reprojection, walls }
    }

    /// The walls that it is kept inside of.
    pub fn walls(&self) -> &VelocityField {
        &self.walls
    }

    /// Velocity [m/s] at a point [m].
    #[inline(always)]
    pub fn velocity<L: Lane>(&self, p: [L; 3]) -> [L; 3] {
        let product = field(&self.functions, p);
        triple!(i => product[i] * product[i].lit(self.rate))
    }

    /// The values of both functions at a point [m]: of one who starts there, for good.
    pub fn iso_values(&self, p: [f64; 3]) -> [f64; 2] {
        let [first, second, _] = self.functions.all(p).values;
        [first, second]
    }

    /// A point [m] to which a step of length `step` [m] has brought one, put back to where both functions have the values
    /// `iso_values`.
    pub fn put_back(&self, p: [f64; 3], step: f64, iso_values: [f64; 2]) -> [f64; 3] {
        let [first, second] = iso_values;
        self.reprojection.back(&self.functions, p, &[first, second, first], step * step)
    }

    /// Where one who is at `p` [m], and belongs where the functions have the values `iso_values`, is after `duration` [s].
    #[inline(always)]
    pub fn after<L: Lane>(&self, p: [L; 3], duration: L, integrator: Integrator, iso_values: [L; 2]) -> [L; 3] {
        let [first, second] = iso_values;
        // How often is fixed: to stop where all lanes are close enough would let neighbours decide.
        let trace = Trace { steps: 1, integrator, reprojection: self.reprojection };
        trace.step(&self.functions, p, duration * duration.lit(self.rate), &[first, second, first])
    }
}
