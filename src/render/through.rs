//! What several volumes together do to the view along a ray.

use crate::geometry::embree::Ray;
use crate::grid::lookup::IndexRay;
use crate::render::dense::{self, Crossing, ViewSteps, ViewThrough};
use crate::render::even::EvenMedium;
use crate::render::medium::Medium;

/// Optical depth of a step through even matter, and most steps through a piece of it: so fine is the mean distance.
const EVEN_STEP: f64 = 0.1;
const EVEN_STEPS_MAX: f64 = 256.0;

/// One volume along a ray.
pub enum Column<'a> {
    /// Of voxels.
    Grid {
        /// The volume.
        medium: &'a Medium,
        /// The ray in its index space.
        line: IndexRay,
        /// Distances at which voxels begin and end [m].
        places: Vec<f64>,
    },
    /// Even.
    Even {
        /// Extinction coefficient [1/m].
        sigma_t: f64,
        /// Where it is: distances [m].
        pieces: Vec<[f64; 2]>,
    },
}

impl<'a> Column<'a> {
    /// Smoke up to distance `end` [m].
    pub fn of_grid(medium: &'a Medium, ray: &Ray, end: f32) -> Self {
        let line = medium.ray_to_index(ray);
        let places = dense::voxels(medium, &line, ray, end).flatten().collect();
        Self::Grid { medium, line, places }
    }

    /// Even matter up to distance `end` [m].
    pub fn of_even(medium: &EvenMedium, ray: &Ray, end: f32) -> Self {
        let pieces = medium.pieces(ray, end).map(|piece| piece.map(f64::from)).collect();
        Self::Even { sigma_t: f64::from(medium.sigma_t), pieces }
    }

    /// Distances between which it is smooth [m].
    fn places(&self) -> Vec<f64> {
        match self {
            Self::Grid { places, .. } => places.clone(),
            Self::Even { sigma_t, pieces } => pieces.iter().flat_map(|&[a, b]| steps(a, b, *sigma_t)).collect(),
        }
    }

    /// Optical depth between two distances that are neighbours among the places of all.
    fn depth(&self, a: f64, b: f64) -> f64 {
        match self {
            Self::Grid { medium, line, places } => {
                // Places come in pairs: behind an odd number of them there is a voxel.
                let is_inside = places.partition_point(|&place| place <= 0.5 * (a + b)) % 2 == 1;
                match is_inside.then(|| dense::cross(medium, line, [a, b], f64::INFINITY)) {
                    Some(Crossing::Through(tau)) => tau,
                    _ => 0.0,
                }
            }
            Self::Even { sigma_t, pieces } => {
                let middle = 0.5 * (a + b);
                let is_inside = pieces.iter().any(|piece| piece[0] <= middle && middle <= piece[1]);
                if is_inside { sigma_t * (b - a) } else { 0.0 }
            }
        }
    }
}

fn steps(a: f64, b: f64, sigma_t: f64) -> impl Iterator<Item = f64> {
    let count = (sigma_t * (b - a) / EVEN_STEP).ceil().clamp(1.0, EVEN_STEPS_MAX);
    (0..=count as u32).map(move |i| if f64::from(i) == count { b } else { a + (b - a) * f64::from(i) / count })
}

/// Looks through all volumes at once.
pub fn view_through_all(columns: &[Column]) -> ViewThrough {
    let mut places: Vec<f64> = columns.iter().flat_map(Column::places).collect();
    places.sort_by(f64::total_cmp);
    places.dedup();
    let depth = |a: f64, b: f64| columns.iter().map(|column| column.depth(a, b)).sum::<f64>();
    let mut view = ViewSteps::default();
    for step in places.windows(2) {
        let (a, b) = (step[0], step[1]);
        let goes_on = view.add([a, b], depth(a, b), |tau| {
            let (mut low, mut high) = (a, b);
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                if depth(a, middle) > tau { high = middle } else { low = middle }
            }
            low
        });
        if !goes_on {
            break;
        }
    }
    view.finish()
}
