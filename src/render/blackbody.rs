//! The light of what is hot.

use crate::render::color::Rgb;
use glam::DVec3;

/// Hottest that is told apart [K].
pub const KELVIN_MAX: f64 = 20_000.0;
/// Between entries of the table [K]: what is interpolated linearly is right to a thousandth from 800 K on.
const KELVIN_STEP: f64 = 2.0;

/// Radiance of black bodies by temperature.
#[derive(Debug, Clone)]
pub struct Blackbody {
    table: Vec<Rgb>,
}

impl Blackbody {
    /// All temperatures up to [`KELVIN_MAX`].
    pub fn new() -> Self {
        let count = (KELVIN_MAX / KELVIN_STEP) as usize + 1;
        Self { table: (0..count).map(|i| radiance(i as f64 * KELVIN_STEP)).collect() }
    }

    /// Radiance in linear Rec. 709, whose luminance is the radiance weighted by the luminous efficiency of the eye
    /// [W/(m² sr)]; 683 times it are candela per square metre. What is redder than red can be, below some 1900 K, has its
    /// negative blue cut.
    pub fn at(&self, kelvin: f32) -> Rgb {
        let place = (kelvin / KELVIN_STEP as f32).clamp(0.0, (self.table.len() - 1) as f32);
        let i = (place as usize).min(self.table.len() - 2);
        self.table[i].lerp(self.table[i + 1], place - i as f32)
    }
}

impl Default for Blackbody {
    fn default() -> Self {
        Self::new()
    }
}

/// Planck's law against the colour matching functions of 1931, by the midpoint rule over visible light.
fn radiance(kelvin: f64) -> Rgb {
    const STEP: f64 = 5.0;
    let mut xyz = DVec3::ZERO;
    let mut nanometres = 360.0 + 0.5 * STEP;
    while nanometres < 830.0 {
        xyz += matching(nanometres) * planck(nanometres * 1e-9, kelvin) * STEP * 1e-9;
        nanometres += STEP;
    }
    // IEC 61966-2-1: from XYZ to linear Rec. 709.
    let rows = [
        DVec3::new(3.2406, -1.5372, -0.4986),
        DVec3::new(-0.9689, 1.8758, 0.0415),
        DVec3::new(0.0557, -0.2040, 1.0570),
    ];
    Rgb::from(rows.map(|row| row.dot(xyz).max(0.0) as f32))
}

/// Spectral radiance of a black body [W/(m² sr m)] at a wavelength [m].
fn planck(wavelength: f64, kelvin: f64) -> f64 {
    // The constants of the SI, exact since 2019.
    const H: f64 = 6.626_070_15e-34;
    const C: f64 = 299_792_458.0;
    const K: f64 = 1.380_649e-23;
    if kelvin <= 0.0 {
        return 0.0;
    }
    2.0 * H * C * C / wavelength.powi(5) / (H * C / (wavelength * K * kelvin)).exp_m1()
}

/// The CIE 1931 colour matching functions at a wavelength [nm], as Wyman, Sloan and Shirley 2013 fit them (*Simple analytic
/// approximations to the CIE XYZ color matching functions*, equation 4).
fn matching(wavelength: f64) -> DVec3 {
    let lobe = |height: f64, middle: f64, below: f64, above: f64| {
        let width = if wavelength < middle { below } else { above };
        height * (-0.5 * ((wavelength - middle) / width).powi(2)).exp()
    };
    DVec3::new(
        lobe(1.056, 599.8, 37.9, 31.0) + lobe(0.362, 442.0, 16.0, 26.7) + lobe(-0.065, 501.1, 20.4, 26.2),
        lobe(0.821, 568.8, 46.9, 40.5) + lobe(0.286, 530.9, 16.3, 31.1),
        lobe(1.217, 437.0, 11.8, 36.0) + lobe(0.681, 459.0, 26.0, 13.8),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::color::luminance;

    #[test]
    fn platinum_at_its_melting_point_has_sixty_candela_per_square_centimetre() {
        // The definition of the candela from 1948 to 1979.
        let found = luminance(Blackbody::new().at(2041.4)) * 683.0;
        assert!((found / 6e5 - 1.0).abs() < 0.02, "{found} cd/m2");
    }

    #[test]
    fn what_is_hotter_is_brighter_and_bluer() {
        let table = Blackbody::new();
        let colors: Vec<Rgb> = (1..=19).map(|i| table.at(1000.0 * i as f32)).collect();
        for pair in colors.windows(2) {
            assert!(pair[1].cmpgt(pair[0]).all(), "{pair:?}");
            assert!(pair[1].z / pair[1].x > pair[0].z / pair[0].x || pair[0].z == 0.0, "{pair:?}");
        }
        // Daylight of 6500 K is white but for what the sun's light and a black body differ.
        let white = table.at(6504.0);
        assert!((white / white.y - Rgb::ONE).abs().max_element() < 0.08, "{}", white / white.y);
        assert_eq!(table.at(0.0), Rgb::ZERO);
        assert_eq!(table.at(1e9), table.at(20_000.0));
    }

    #[test]
    fn the_table_is_fine_enough() {
        let table = Blackbody::new();
        for kelvin in [801.0, 1233.3, 1999.0, 5001.0, 12_345.6] {
            let (found, exact) = (table.at(kelvin as f32), radiance(kelvin));
            assert!((found - exact).abs().max_element() <= 1e-3 * exact.max_element(), "{kelvin}: {found} {exact}");
        }
    }
}
