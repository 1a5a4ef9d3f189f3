//! Light that smoke gives off along a flight, by line integration (Simon, Hanika, Zirr and Dachsbacher 2017, *Line
//! Integration for Rendering Heterogeneous Emissive Volumes*).
//!
//! A flight reaches distance t with the probability that is the transmittance to there. So all that is given off on its
//! way, from its start to where it ends, is on average ∫ T ε ρ dt, what arrives at its start. Nothing is drawn at random
//! for it, the density is integrated exactly, and unlike an estimate at collisions it is right in smoke too thin to collide
//! with: with no extinction at all it has no noise. Only where there is detail finer than voxels, a density is taken at one
//! random point of the way through each voxel.

use crate::geometry::embree::Ray;
use crate::grid::DensityGrid;
use crate::grid::majorant::MajorantIterator;
use crate::render::color::Rgb;
use crate::render::dense::{self, Columns};
use crate::render::detail::Detail;
use crate::render::medium::Medium;
use crate::render::sampler::Stream;

/// Light given off towards the ray's origin between it and distance `end` [m], where the flight ended [W/(m² sr)]. `stream` is
/// used by detail alone.
pub fn collected(medium: &Medium, ray: &Ray, end: f32, stream: &mut Stream) -> Rgb {
    if let Some(detail) = &medium.detail {
        return sampled(medium, detail, ray, end, stream);
    }
    let mut light = Rgb::ZERO;
    if medium.emission != Rgb::ZERO {
        light += medium.emission * column(medium, medium.grid(), ray, end);
    }
    light + glow_of_grids(medium, ray, end)
}

fn glow_of_grids(medium: &Medium, ray: &Ray, end: f32) -> Rgb {
    match (&medium.glow, &medium.glow_majorants) {
        (None, _) => Rgb::ZERO,
        (Some(grids), None) => Rgb::from(grids.each_ref().map(|grid| column(medium, grid, ray, end))),
        (Some(grids), Some(majorants)) => Rgb::from([0, 1, 2].map(|i| {
            let pieces = MajorantIterator::new(&majorants[i], ray.origin, ray.direction, 0.0, end);
            sum_over(pieces, &grids[i], ray)
        })),
    }
}

/// A grid added up along the ray where there is smoke.
fn column(medium: &Medium, grid: &DensityGrid, ray: &Ray, end: f32) -> f32 {
    sum_over(medium.majorants(ray, end), grid, ray)
}

/// A grid added up on those pieces of the ray on which there is something.
fn sum_over(pieces: MajorantIterator, grid: &DensityGrid, ray: &Ray) -> f32 {
    let line = grid.ray_to_index(ray.origin, ray.direction);
    let pieces = pieces.filter(|piece| piece.density_max > 0.0);
    let columns = Columns::new(grid, &line);
    pieces.map(|piece| columns.between(piece.t0, piece.t1)).sum()
}

/// As [`collected`], with one random point for each voxel.
#[cold]
fn sampled(medium: &Medium, detail: &Detail, ray: &Ray, end: f32, stream: &mut Stream) -> Rgb {
    let line = medium.ray_to_index(ray);
    let voxels = dense::voxels(medium, &line, ray, end);
    let light = voxels.map(|[a, b]| {
        let p = ray.at((a + (b - a) * f64::from(stream.uniform())) as f32);
        let mut light = medium.emission * medium.grid().density(p);
        if let (Some(grids), None) = (&medium.glow, &medium.glow_majorants) {
            light += Rgb::from(grids.each_ref().map(|grid| grid.density(p)));
        }
        if light == Rgb::ZERO { light } else { light * (detail.factor(p) * (b - a) as f32) }
    });
    // What is not bound to the density has no detail of it.
    let unbound = if medium.glow_majorants.is_some() { glow_of_grids(medium, ray, end) } else { Rgb::ZERO };
    light.fold(unbound, |sum, light| sum + light)
}
