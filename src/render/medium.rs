//! The smoke as light sees it.

use crate::geometry::embree::Ray;
use crate::grid::DensityGrid;
use crate::grid::lookup::IndexRay;
use crate::grid::majorant::{CellEdge, MajorantGrid, MajorantIterator};
use crate::math::space::IndexPoint;
use crate::render::color::Rgb;
use crate::render::detail::Detail;
use crate::render::phase::Phase;
use glam::Vec3;

/// What scatters in a volume, wherever there is how much of it.
#[derive(Debug, Clone, Copy)]
pub struct Matter {
    /// Share of the extinction that scatters, each channel in [0, 1].
    pub albedo: Rgb,
    /// Directions of scattering.
    pub phase: Phase,
    /// Whether the flow carries it along, as it does smoke and no other volume.
    pub is_carried: bool,
}

/// Smoke: a density grid with coefficients.
#[derive(Debug)]
pub struct Medium {
    grid: DensityGrid,
    majorants: MajorantGrid,
    /// Extinction coefficient of density 1 [1/m], ≥ 0; of the channel that has most.
    extinction: f32,
    /// One over it; infinite where it is 0.
    inverse_extinction: f32,
    /// Where extinction has a colour, that of each channel over the largest.
    pub tint: Option<Vec3>,
    /// Light that density 1 gives off [W/(m³ sr)], each channel ≥ 0.
    pub emission: Rgb,
    /// Light that it gives off besides in red, green and blue [W/(m³ sr)]; 0 where there is no density, unless `glow_majorants`
    /// say where it is.
    pub glow: Option<[DensityGrid; 3]>,
    /// Where `glow` is, of light that is not bound to the density.
    pub glow_majorants: Option<[MajorantGrid; 3]>,
    /// What scatters.
    pub matter: Matter,
    /// What multiplies the density between voxels, if anything does.
    pub detail: Option<Box<Detail>>,
}

impl Medium {
    /// Smoke with `sigma_t = extinction · density` [1/m], without a tint, which gives off no light.
    pub fn new(grid: DensityGrid, extinction: f32, albedo: Rgb, phase: Phase) -> Self {
        let voxel_tau = extinction * grid.max_density() * grid.voxel_size();
        let majorants = MajorantGrid::new(&grid, CellEdge::for_light(voxel_tau));
        Self {
            grid,
            majorants,
            extinction,
            inverse_extinction: 1.0 / extinction,
            tint: None,
            emission: Rgb::ZERO,
            glow: None,
            glow_majorants: None,
            matter: Matter { albedo, phase, is_carried: true },
            detail: None,
        }
    }

    /// Extinction coefficient [1/m] at `p`, of the channel that has most.
    #[inline]
    pub fn sigma_t(&self, p: IndexPoint) -> f32 {
        let sigma_t = self.extinction * self.grid.density_at(p);
        if self.detail.is_some() { self.detailed(sigma_t, p) } else { sigma_t }
    }

    /// Whether [`Medium::sigma_t_nearby`] is larger than `bound` [1/m], ≥ 0.
    #[inline]
    pub fn exceeds_nearby(&self, p: IndexPoint, u: Vec3, bound: f32) -> bool {
        if self.detail.is_some() {
            return self.sigma_t_nearby(p, u) > bound;
        }
        self.grid.exceeds_nearby(p, u, bound * self.inverse_extinction)
    }

    /// The extinction coefficient [1/m] at one of the eight voxels round `p`, of which a uniform point `u` of the unit cube
    /// picks one so that the mean is [`Medium::sigma_t`]: for decisions whose probability is proportional to it.
    #[inline]
    pub fn sigma_t_nearby(&self, p: IndexPoint, u: Vec3) -> f32 {
        let sigma_t = self.extinction * self.grid.density_nearby(p, u);
        if self.detail.is_some() { self.detailed(sigma_t, p) } else { sigma_t }
    }

    #[cold]
    fn detailed(&self, sigma_t: f32, p: IndexPoint) -> f32 {
        match &self.detail {
            // Nothing is nothing in detail too, at less cost.
            Some(detail) if sigma_t > 0.0 => sigma_t * detail.factor(self.grid.to_world(p)),
            _ => sigma_t,
        }
    }

    /// The ray in the index space of the density.
    #[inline]
    pub fn ray_to_index(&self, ray: &Ray) -> IndexRay {
        self.grid.ray_to_index(ray.origin, ray.direction)
    }

    /// Upper bounds of the *density* on pieces of the ray between `0` and `t_max`; by
    /// [`Medium::sigma_max`] they bound `sigma_t`. Pieces without smoke are left out.
    #[inline(always)]
    pub fn majorants(&self, ray: &Ray, t_max: f32) -> MajorantIterator<'_> {
        MajorantIterator::new(&self.majorants, ray.origin, ray.direction, 0.0, t_max)
    }

    /// The part of the ray before `t_max` in which there may be smoke: between these distances [m].
    #[inline]
    pub fn range(&self, ray: &Ray, t_max: f32) -> Option<[f32; 2]> {
        let mut pieces = self.majorants(ray, t_max).filter(|piece| piece.density_max > 0.0);
        let first = pieces.next()?;
        Some([first.t0, pieces.last().map_or(first.t1, |last| last.t1)])
    }

    /// Extinction coefficient of density 1 [1/m].
    #[inline]
    pub fn extinction(&self) -> f32 {
        self.extinction
    }

    /// Upper bound of the extinction coefficient where the density is at most `density_max` [1/m].
    #[inline]
    pub fn sigma_max(&self, density_max: f32) -> f32 {
        let sigma_max = density_max * self.extinction;
        match &self.detail {
            None => sigma_max,
            Some(detail) => sigma_max * detail.most(),
        }
    }

    /// Whether optical depths along rays are known exactly.
    #[inline]
    pub fn has_exact_depths(&self) -> bool {
        self.detail.is_none()
    }

    /// Whether it gives off light.
    #[inline]
    pub fn glows(&self) -> bool {
        self.emission != Rgb::ZERO || self.glow.is_some()
    }

    /// The density, and light that is given off besides, for another medium to be made of.
    pub fn into_grids(self) -> (DensityGrid, Option<[DensityGrid; 3]>) {
        (self.grid, self.glow)
    }

    /// The density itself.
    pub fn grid(&self) -> &DensityGrid {
        &self.grid
    }
}
