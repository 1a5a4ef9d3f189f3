//! Sets of points in the unit cube of two to seven dimensions: a lattice jittered along divergence-free vector noise
//! (Bærentzen et al. 2025, section 5.1), and the usual sets that one compares it with.

pub mod jitter;
pub mod nearest;
pub mod poisson;
pub mod sobol;

/// Fewest and most dimensions.
pub const DIMENSIONS: std::ops::RangeInclusive<usize> = 2..=7;

/// Points of some dimensions.
#[derive(Debug, Clone, PartialEq)]
pub struct PointSet {
    /// Numbers of a point.
    pub dimension: usize,
    /// The numbers of all points, one after another.
    pub coordinates: Vec<f64>,
}

impl PointSet {
    /// How many points.
    pub fn len(&self) -> usize {
        self.coordinates.len() / self.dimension
    }

    /// True when there is none.
    pub fn is_empty(&self) -> bool {
        self.coordinates.is_empty()
    }

    /// Point `i`.
    pub fn point(&self, i: usize) -> &[f64] {
        &self.coordinates[i * self.dimension..(i + 1) * self.dimension]
    }
}

/// The middles of the cells of a cube cut `per_axis` times along each axis; the first axis goes fastest.
pub fn lattice(dimension: usize, per_axis: u32) -> PointSet {
    let count = u64::from(per_axis).pow(dimension as u32);
    let place = |mut i: u64| {
        (0..dimension).map(move |_| {
            let cell = i % u64::from(per_axis);
            i /= u64::from(per_axis);
            (cell as f64 + 0.5) / f64::from(per_axis)
        })
    };
    PointSet { dimension, coordinates: (0..count).flat_map(place).collect() }
}
