//! The light that hot smoke gives off, as grids of red, green and blue.
//!
//! Each particle glows with its own temperature, so what particles give off is splatted as their mass is; temperatures are never
//! averaged. Of files the product of density and black body's radiance is taken at every voxel of the density.

use crate::grid::{BRICK_EDGE, BrickValues, DensityGrid, GridError, local_voxel};
use crate::math::parallel;
use crate::math::space::WorldPoint;
use crate::particles::Particles;
use crate::render::blackbody::Blackbody;
use crate::scene::settings;
use glam::Vec3;

/// Memory that a particle takes besides while its light is splatted [bytes].
pub(super) const PARTICLE_BYTES: u64 = 28;

/// Light that density 1 gives off at a temperature [W/(m³ sr)].
pub(super) struct Heat {
    table: Blackbody,
    settings: settings::Blackbody,
    /// Absorption coefficients of density 1 [1/m] times the gain.
    factor: Vec3,
}

impl Heat {
    /// Of smoke or a volume that has a temperature.
    pub(super) fn new(settings: Option<settings::Blackbody>, medium: &settings::Medium) -> Option<Self> {
        let settings = settings?;
        let absorption = |i: usize| medium.extinction * medium.extinction_tint[i] * (1.0 - medium.albedo[i]);
        let factor = [0, 1, 2].map(|i| (settings.gain * absorption(i)) as f32);
        Some(Self { table: Blackbody::new(), settings, factor: Vec3::from(factor) })
    }

    fn at(&self, kelvin: f32) -> Vec3 {
        self.factor * self.table.at(kelvin)
    }

    /// What particles give off in red, green and blue, to be splatted as their mass is.
    pub(super) fn of_particles(&self, particles: &Particles) -> [Vec<f32>; 3] {
        let kelvin = temperatures(&self.settings, particles);
        let light = parallel::map(kelvin.len(), |i| particles.mass[i] * self.at(kelvin[i]));
        [0, 1, 2].map(|channel| light.iter().map(|light| light[channel]).collect())
    }

    /// What the density of a file gives off at the temperatures of another grid.
    pub(super) fn of_grids(
        &self,
        density: &DensityGrid,
        temperature: &DensityGrid,
        memory_limit: u64,
    ) -> Result<[DensityGrid; 3], GridError> {
        let (scale, offset) = (self.settings.scale as f32, self.settings.offset as f32);
        let (coords, densities): (Vec<_>, Vec<BrickValues>) = density.occupied_bricks().unzip();
        let h = f64::from(density.voxel_size());
        try_channels(|channel| {
            let mut values = densities.clone();
            parallel::for_each_mut(&mut values, |n, values| {
                for (i, value) in values.iter_mut().enumerate() {
                    let voxel = (coords[n] * BRICK_EDGE as i32 + local_voxel(i).as_ivec3()).as_dvec3();
                    let middle = WorldPoint((density.origin() + (voxel + 0.5) * h).as_vec3());
                    *value *= self.at(scale * temperature.density(middle) + offset)[channel];
                }
            });
            DensityGrid::from_bricks(density.origin(), density.voxel_size(), &coords, &values, memory_limit)
        })
    }
}

/// Second constant of radiation over 600 nm, where hot smoke is about as bright to the eye as anywhere [K].
const GLOW_KELVIN: f64 = 0.014_387_768_775 / 600e-9;

/// What particles give off at 600 nm by Wien's law, the hottest there may be having 1: what their mean temperature is found from.
pub(super) fn glows(heat: &settings::Blackbody, particles: &Particles) -> Vec<f32> {
    let hottest = heat.temperature.max(heat.ambient);
    temperatures(heat, particles)
        .iter()
        .map(|&kelvin| (GLOW_KELVIN / hottest - GLOW_KELVIN / f64::from(kelvin)).exp() as f32)
        .collect()
}

/// The temperature [K] at which smoke has the mean of [`glows`].
pub(super) fn kelvin_of_glow(heat: &settings::Blackbody, glow: f32) -> f32 {
    let hottest = heat.temperature.max(heat.ambient);
    let kelvin = GLOW_KELVIN / (GLOW_KELVIN / hottest - f64::from(glow).ln());
    // No particle is cooler; what is far cooler than any glow has none in single precision.
    kelvin.max(heat.temperature.min(heat.ambient)) as f32
}

/// Temperatures of particles [K], which cool with their age.
fn temperatures(heat: &settings::Blackbody, particles: &Particles) -> Vec<f32> {
    parallel::map(particles.age.len(), |i| {
        let cooled = (-f64::from(particles.age[i]) / heat.cooling_time).exp();
        (heat.ambient + (heat.temperature - heat.ambient) * cooled) as f32
    })
}

fn try_channels<E>(mut grid: impl FnMut(usize) -> Result<DensityGrid, E>) -> Result<[DensityGrid; 3], E> {
    Ok([grid(0)?, grid(1)?, grid(2)?])
}
