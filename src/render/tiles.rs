//! A picture is cut into tiles, which threads take one by one; equal inputs give equal bits whatever their number.

use crate::geometry::embree::Ray;
use crate::math::hash::Seed;
use crate::progress::Progress;
use crate::render::RenderError;
use crate::render::camera::Camera;
use crate::render::film::{Film, PathCounts, Pixel, PixelBounds, PixelSum};
use crate::render::filter::Filter;
use crate::render::integrator::{Integrator, PathLimits};
use crate::render::medium::Medium;
use crate::render::sampler::{Dimension, Sampler};
use crate::render::world::World;
use glam::Vec2;
use rayon::prelude::*;

/// Edge of a tile [pixels]: small enough to balance two hundred threads on a small picture.
const TILE: u32 = 16;

/// Most samples between two looks at whether to stop: a pixel may have millions.
const SAMPLES_A_LOOK: u32 = 256;
/// Most scatterings between two looks: a path may have a hundred thousand.
const BOUNCES_A_LOOK: u64 = 1 << 14;

/// How a picture is taken.
#[derive(Debug, Clone)]
pub struct View {
    /// Where from.
    pub camera: Camera,
    /// Size of the whole picture.
    pub resolution: [u32; 2],
    /// The part of it to render.
    pub bounds: PixelBounds,
    /// Paths a pixel.
    pub spp: u32,
    /// How samples are spread about a pixel.
    pub filter: Filter,
    /// When paths end.
    pub limits: PathLimits,
    /// Of the random numbers.
    pub seed: Seed,
}

/// Takes the picture, on all threads of the current pool. Equal inputs give equal bits whatever their number.
///
/// # Errors
/// [`RenderError::Cancelled`] soon after `progress` says so; [`RenderError::NonFinite`] for a path that brings no number.
pub fn render(
    view: &View,
    world: &World,
    medium: Option<&Medium>,
    progress: &dyn Progress,
) -> Result<Film, RenderError> {
    let integrator = Integrator { world, medium, limits: view.limits };
    let rows: Vec<u32> = (view.bounds.y0..view.bounds.y1).step_by(TILE as usize).collect();
    let columns: Vec<u32> = (view.bounds.x0..view.bounds.x1).step_by(TILE as usize).collect();
    let tiles: Vec<PixelBounds> = rows
        .iter()
        .flat_map(|&y0| columns.iter().map(move |&x0| (x0, y0)))
        .map(|(x0, y0)| PixelBounds {
            x0,
            y0,
            x1: (x0 + TILE).min(view.bounds.x1),
            y1: (y0 + TILE).min(view.bounds.y1),
        })
        .collect();
    let finished: Vec<(Vec<Pixel>, PathCounts)> =
        tiles.par_iter().map(|tile| render_tile(tile, view, &integrator, progress)).collect::<Result<_, _>>()?;
    Ok(assemble(view, &tiles, &finished))
}

fn render_tile(
    tile: &PixelBounds,
    view: &View,
    integrator: &Integrator,
    progress: &dyn Progress,
) -> Result<(Vec<Pixel>, PathCounts), RenderError> {
    let mut counts = PathCounts::default();
    let mut pixels = Vec::with_capacity(tile.area());
    for y in tile.y0..tile.y1 {
        for x in tile.x0..tile.x1 {
            pixels.push(render_pixel(x, y, view, integrator, &mut counts, progress)?);
        }
    }
    Ok((pixels, counts))
}

fn render_pixel(
    x: u32,
    y: u32,
    view: &View,
    integrator: &Integrator,
    counts: &mut PathCounts,
    progress: &dyn Progress,
) -> Result<Pixel, RenderError> {
    let middle = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
    let ray_at = |p: Vec2| Ray { origin: view.camera.position(), direction: view.camera.direction(p) };
    let mut sum = PixelSum::default();
    let (mut looked_at_sample, mut looked_at_bounce) = (0, counts.bounces);
    if progress.is_cancelled() {
        return Err(RenderError::Cancelled);
    }
    for sample in 0..view.spp {
        if sample - looked_at_sample >= SAMPLES_A_LOOK || counts.bounces - looked_at_bounce >= BOUNCES_A_LOOK {
            progress.advance(u64::from(sample - looked_at_sample));
            if progress.is_cancelled() {
                return Err(RenderError::Cancelled);
            }
            (looked_at_sample, looked_at_bounce) = (sample, counts.bounces);
        }
        let mut sampler = Sampler::new(view.seed, x, y, sample);
        let u = sampler.numbers(Dimension::Film, 0);
        let ray = ray_at(middle + view.filter.sample([u[0], u[1]]));
        let contribution = integrator.trace(ray, &mut sampler, counts);
        if !contribution.radiance.is_finite() {
            return Err(RenderError::NonFinite { x, y, sample, radiance: contribution.radiance });
        }
        sum.add(&contribution);
    }
    progress.advance(u64::from(view.spp - looked_at_sample));
    let ray = ray_at(middle);
    let depth = integrator
        .world
        .seen_by_camera(&ray)
        .map_or(f32::INFINITY, |hit| hit.t * ray.direction.dot(*view.camera.forward()));
    Ok(sum.finish(depth))
}

/// Puts tiles in their places; counts are added in the order of the tiles, so that their sum has no luck in it either.
fn assemble(view: &View, tiles: &[PixelBounds], finished: &[(Vec<Pixel>, PathCounts)]) -> Film {
    let mut pixels = vec![Pixel::default(); view.bounds.area()];
    let mut paths = PathCounts::default();
    let width = view.bounds.width() as usize;
    for (tile, (tile_pixels, tile_paths)) in tiles.iter().zip(finished) {
        paths.add(tile_paths);
        for (row, line) in tile_pixels.chunks(tile.width() as usize).enumerate() {
            let start = (tile.y0 - view.bounds.y0) as usize + row;
            let at = start * width + (tile.x0 - view.bounds.x0) as usize;
            pixels[at..at + line.len()].copy_from_slice(line);
        }
    }
    Film { resolution: view.resolution, bounds: view.bounds, pixels, spp: view.spp, paths }
}
