//! Two functions in space, the product of whose gradients is a flow (Bærentzen et al. 2025, equations 8 and 13): a noise, and
//! a second noise or the distance to a solid. One kind for all that flows so, since each kind is compiled for itself.

use crate::flow::bounded::Bounded;
use crate::flow::dfvn::{Function, Functions};
use crate::flow::simplex::{Simplex, Slope};
use crate::geometry::sdf::PlacedSdf;
use crate::math::real::{Lane, dot, triple};
use glam::{DMat3, DVec3};
use std::sync::Arc;

/// Root mean square of the product of the gradients of two noises, or of a noise and a distance: √(2/3).
///
/// The gradients of noises have root mean square length 1, that of a distance has length 1. |a × b|² = |a|²|b|² − (a·b)²,
/// and where a points everywhere alike and knows nothing of b, the mean of (a·b)² is a third of the first term.
pub const RMS_PRODUCT: f64 = 0.816_496_580_927_726;

/// Two functions in space.
#[derive(Debug, Clone)]
pub struct Pair {
    first: First,
    second: Second,
}

#[derive(Debug, Clone)]
enum First {
    Noise(Simplex<3>),
    Bounded(Bounded<Arc<PlacedSdf>, Simplex<3>>),
}

/// The other of two functions.
#[derive(Debug, Clone)]
pub enum Second {
    /// A noise: the flow is free.
    Noise(Turned),
    /// The signed distance of a solid: the flow is along its level surfaces.
    Distance(Arc<PlacedSdf>),
}

/// A noise whose lattice is turned against that of others. On one lattice, all noises are weak at the same places, where
/// they are all 0, and their product has 1.05 times the mean square.
#[derive(Debug, Clone)]
pub struct Turned {
    noise: Simplex<3>,
    rotation: [[f64; 3]; 3],
}

impl Turned {
    /// The same noise, turned.
    pub fn new(noise: Simplex<3>) -> Self {
        // By any angle that is no symmetry of the lattice, about any axis that is none.
        let turn = DMat3::from_axis_angle(DVec3::new(0.3, 0.5, -0.8).normalize(), 1.0);
        Self { noise, rotation: turn.to_cols_array_2d() }
    }
}

impl Function<3> for Turned {
    #[inline(always)]
    fn at<L: Lane>(&self, p: [L; 3]) -> Slope<L, 3> {
        let columns: [[L; 3]; 3] = triple!(i => triple!(j => p[0].lit(self.rotation[i][j])));
        let Slope { value, gradient } = self.noise.at(triple!(i => dot(columns[i], p)));
        let rows: [[L; 3]; 3] = triple!(i => triple!(j => columns[j][i]));
        Slope { value, gradient: triple!(i => dot(rows[i], gradient)) }
    }
}

/// What the flow stays inside of.
#[derive(Debug, Clone)]
pub struct Bound {
    /// The solid.
    pub solid: Arc<PlacedSdf>,
    /// Depth below its wall from which on the flow is as if it were not there [m], > 0.
    pub width: f64,
}

impl Pair {
    /// A noise and another function, with a bound that the first is given (equation 13).
    pub fn new(noise: Simplex<3>, second: Second, bound: Option<Bound>) -> Self {
        let first = match bound {
            Some(Bound { solid, width }) => First::Bounded(Bounded { distance: solid, inner: noise, width }),
            None => First::Noise(noise),
        };
        Self { first, second }
    }
}

impl Functions<3> for Pair {
    #[inline(always)]
    fn one<L: Lane>(&self, i: usize, p: [L; 3]) -> Slope<L, 3> {
        if i == 0 {
            return match &self.first {
                First::Noise(noise) => noise.at(p),
                First::Bounded(bounded) => bounded.at(p),
            };
        }
        match &self.second {
            Second::Noise(noise) => noise.at(p),
            Second::Distance(solid) => Function::at(solid, p),
        }
    }
}
