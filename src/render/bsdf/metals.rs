//! Measured indices of refraction of common metals, n + i k.
//!
//! Of gold, silver and copper after Johnson and Christy 1972, *Optical constants of the noble metals*; of iron, chromium
//! and titanium after the same 1974, *Optical constants of transition metals*; of aluminium after Rakić 1995, *Algorithm
//! for the determination of intrinsic optical constants of metal films*. Their reflectance at each wavelength, at fifty
//! angles, was weighed with the CIE 1931 observer and illuminant D65 and brought to linear Rec. 709; for each channel, n and
//! k are those whose reflectance is closest to that at all angles (least squares; within 0.004). The red of gold lies outside
//! of Rec. 709 and is cut to the largest reflectance of gold in the visible.

use crate::render::color::Rgb;
use glam::Vec3;

/// A metal by its index of refraction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Index {
    /// The real part, n.
    pub eta: Rgb,
    /// The imaginary part, k.
    pub k: Rgb,
}

const fn index(eta: [f32; 3], k: [f32; 3]) -> Index {
    Index { eta: Vec3::new(eta[0], eta[1], eta[2]), k: Vec3::new(k[0], k[1], k[2]) }
}

/// Aluminium.
pub const ALUMINIUM: Index = index([1.496, 0.984, 0.604], [7.635, 6.546, 5.342]);
/// Chromium.
pub const CHROMIUM: Index = index([3.248, 3.113, 2.286], [3.287, 3.336, 3.116]);
/// Copper.
pub const COPPER: Index = index([0.218, 1.044, 1.295], [3.315, 2.624, 2.361]);
/// Gold.
pub const GOLD: Index = index([0.131, 0.500, 1.468], [4.062, 2.264, 1.773]);
/// Iron.
pub const IRON: Index = index([2.923, 2.919, 2.546], [3.077, 2.937, 2.750]);
/// Silver.
pub const SILVER: Index = index([0.056, 0.055, 0.043], [4.478, 3.545, 2.589]);
/// Titanium.
pub const TITANIUM: Index = index([2.747, 2.508, 2.239], [3.842, 3.397, 3.014]);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::bsdf::fresnel::conductor;

    #[test]
    fn metals_have_the_colours_of_their_spectra() {
        // Reflectance at normal incidence, integrated over the spectrum.
        for (metal, expected) in [
            (ALUMINIUM, [0.907, 0.916, 0.922]),
            (CHROMIUM, [0.550, 0.556, 0.554]),
            (COPPER, [0.932, 0.623, 0.522]),
            (GOLD, [0.970, 0.728, 0.365]),
            (IRON, [0.530, 0.513, 0.494]),
            (SILVER, [0.989, 0.984, 0.978]),
            (TITANIUM, [0.619, 0.579, 0.543]),
        ] {
            let found = conductor(1.0, metal.eta, metal.k);
            assert!((found - Vec3::from(expected)).abs().max_element() < 4e-3, "{found} {expected:?}");
        }
    }
}
