//! The smoke as light sees it.

use crate::geometry::embree::Ray;
use crate::grid::DensityGrid;
use crate::grid::lookup::IndexRay;
use crate::grid::majorant::{MajorantGrid, MajorantIterator};
use crate::math::space::IndexPoint;
use crate::render::color::Rgb;
use crate::render::phase::Phase;

/// Smoke: a density grid with coefficients.
#[derive(Debug)]
pub struct Medium {
    grid: DensityGrid,
    majorants: MajorantGrid,
    /// Extinction coefficient of density 1 [1/m], ≥ 0.
    extinction: f32,
    /// Light that density 1 gives off [W/(m³ sr)], each channel ≥ 0.
    pub emission: Rgb,
    /// Share of the extinction that scatters, each channel in [0, 1].
    pub albedo: Rgb,
    /// Directions of scattering.
    pub phase: Phase,
}

impl Medium {
    /// Smoke with `sigma_t = extinction · density` [1/m], which gives off no light.
    pub fn new(grid: DensityGrid, extinction: f32, albedo: Rgb, phase: Phase) -> Self {
        let majorants = MajorantGrid::new(&grid);
        Self { grid, majorants, extinction, emission: Rgb::ZERO, albedo, phase }
    }

    /// Extinction coefficient [1/m] at `p`.
    #[inline]
    pub fn sigma_t(&self, p: IndexPoint) -> f32 {
        self.extinction * self.grid.density_at(p)
    }

    /// Density at `p`.
    #[inline]
    pub fn density(&self, p: IndexPoint) -> f32 {
        self.grid.density_at(p)
    }

    /// The ray in the index space of the density.
    #[inline]
    pub fn ray_to_index(&self, ray: &Ray) -> IndexRay {
        self.grid.ray_to_index(ray.origin, ray.direction)
    }

    /// Upper bounds of the *density* on pieces of the ray between `0` and `t_max`; times
    /// [`Medium::extinction`] they bound `sigma_t`. Pieces without smoke are left out.
    #[inline]
    pub fn majorants(&self, ray: &Ray, t_max: f32) -> MajorantIterator<'_> {
        MajorantIterator::new(&self.majorants, ray.origin, ray.direction, 0.0, t_max)
    }

    /// Extinction coefficient of density 1 [1/m].
    #[inline]
    pub fn extinction(&self) -> f32 {
        self.extinction
    }

    /// The density itself.
    pub fn grid(&self) -> &DensityGrid {
        &self.grid
    }
}
