//! Light that smoke gives off along a flight, by line integration (Simon, Hanika, Zirr and Dachsbacher 2017, *Line
//! Integration for Rendering Heterogeneous Emissive Volumes*).
//!
//! A flight reaches distance t with the probability that is the transmittance to there. So all that is given off on its
//! way, from its start to where it ends, is on average ∫ T ε ρ dt, what arrives at its start. Nothing is drawn at random
//! for it, the density is integrated exactly, and unlike an estimate at collisions it is right in smoke too thin to collide
//! with: with no extinction at all it has no noise.

use crate::geometry::embree::Ray;
use crate::grid::DensityGrid;
use crate::render::color::Rgb;
use crate::render::dense;
use crate::render::medium::Medium;

/// Light given off towards the ray's origin between it and distance `end` [m], where the flight ended [W/(m² sr)].
pub fn collected(medium: &Medium, ray: &Ray, end: f32) -> Rgb {
    let mut light = Rgb::ZERO;
    if medium.emission != Rgb::ZERO {
        light += medium.emission * column(medium, medium.grid(), ray, end);
    }
    if let Some(grids) = &medium.glow {
        light += Rgb::from(grids.each_ref().map(|grid| column(medium, grid, ray, end)));
    }
    light
}

/// A grid added up along the ray where there is smoke.
fn column(medium: &Medium, grid: &DensityGrid, ray: &Ray, end: f32) -> f32 {
    let line = grid.ray_to_index(ray.origin, ray.direction);
    let pieces = medium.majorants(ray, end).filter(|piece| piece.density_max > 0.0);
    pieces.map(|piece| dense::column(grid, &line, [piece.t0, piece.t1].map(f64::from))).sum::<f64>() as f32
}
