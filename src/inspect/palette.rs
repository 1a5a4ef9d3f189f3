//! Colours that stand for numbers, even to the eye: equal steps of a number are equal steps of lightness in Oklab
//! (Ottosson 2020, *A perceptual color space for image processing*).

use std::f64::consts::PI;

/// Linear Rec. 709 light, 0 to 1.
pub type Rgb = [f32; 3];

/// Lightness, chroma and hue [degrees] of the map for magnitudes, evenly spaced from 0 to 1: night blue, sea, pale sun.
const MAGNITUDE: [[f64; 3]; 6] = [
    [0.20, 0.065, 288.0],
    [0.35, 0.110, 270.0],
    [0.50, 0.105, 240.0],
    [0.65, 0.105, 200.0],
    [0.80, 0.120, 160.0],
    [0.95, 0.095, 108.0],
];
/// Of the map for signed numbers, from −1 over 0 to 1: blue, near white, red.
const SIGNED: [[f64; 3]; 5] =
    [[0.42, 0.145, 258.0], [0.69, 0.100, 248.0], [0.96, 0.004, 90.0], [0.69, 0.125, 42.0], [0.42, 0.150, 28.0]];

/// The colour of a magnitude from 0 to 1; beyond, that of the nearer end.
pub fn magnitude(x: f64) -> Rgb {
    rgb_from_oklab(between(&MAGNITUDE, x))
}

/// The colour of a signed number from −1 to 1, near white at 0; beyond, that of the nearer end.
pub fn signed(x: f64) -> Rgb {
    rgb_from_oklab(between(&SIGNED, 0.5 * (x + 1.0)))
}

/// A colour made lighter (or darker) by a change of its Oklab lightness, which stays within 0 and 1.
pub fn lightened(rgb: Rgb, by: f64) -> Rgb {
    let [l, a, b] = oklab_from_rgb(rgb);
    rgb_from_oklab([(l + by).clamp(0.0, 1.0), a, b])
}

/// `a` at 0 to `b` at 1, in light.
pub fn mixed(a: Rgb, b: Rgb, t: f32) -> Rgb {
    std::array::from_fn(|i| a[i] + (b[i] - a[i]) * t)
}

fn between(stops: &[[f64; 3]], x: f64) -> [f64; 3] {
    let place = if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) } * (stops.len() - 1) as f64;
    let low = (place as usize).min(stops.len() - 2);
    let t = place - low as f64;
    let lab = |[l, chroma, hue]: [f64; 3]| {
        let (sin, cos) = (hue * PI / 180.0).sin_cos();
        [l, chroma * cos, chroma * sin]
    };
    let (a, b) = (lab(stops[low]), lab(stops[low + 1]));
    std::array::from_fn(|i| a[i] + (b[i] - a[i]) * t)
}

fn rgb_from_oklab([l, a, b]: [f64; 3]) -> Rgb {
    let [l, m, s] = [
        l + 0.396_337_777_4 * a + 0.215_803_757_3 * b,
        l - 0.105_561_345_8 * a - 0.063_854_172_8 * b,
        l - 0.089_484_177_5 * a - 1.291_485_548 * b,
    ]
    .map(|x| x.powi(3));
    [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701 * s,
    ]
    .map(|x| x.clamp(0.0, 1.0) as f32)
}

fn oklab_from_rgb(rgb: Rgb) -> [f64; 3] {
    let [r, g, b] = rgb.map(f64::from);
    let [l, m, s] = [
        0.412_221_470_8 * r + 0.536_332_536_3 * g + 0.051_445_992_9 * b,
        0.211_903_498_2 * r + 0.680_699_545_1 * g + 0.107_396_956_6 * b,
        0.088_302_461_9 * r + 0.281_718_837_6 * g + 0.629_978_700_5 * b,
    ]
    .map(f64::cbrt);
    [
        0.210_454_255_3 * l + 0.793_617_785 * m - 0.004_072_046_8 * s,
        1.977_998_495_1 * l - 2.428_592_205 * m + 0.450_593_709_9 * s,
        0.025_904_037_1 * l + 0.782_771_766_2 * m - 0.808_675_766 * s,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_steps_are_equally_lighter() {
        let lightness: Vec<f64> = (0..=20).map(|i| oklab_from_rgb(magnitude(f64::from(i) / 20.0))[0]).collect();
        for pair in lightness.windows(2) {
            assert!((pair[1] - pair[0] - 0.75 / 20.0).abs() < 0.012, "{lightness:?}");
        }
    }

    #[test]
    fn opposite_numbers_are_equally_light_and_differ_in_hue() {
        for i in 1..=10 {
            let x = f64::from(i) / 10.0;
            let (low, high) = (oklab_from_rgb(signed(-x)), oklab_from_rgb(signed(x)));
            assert!((low[0] - high[0]).abs() < 0.03, "{x}: {low:?} {high:?}");
            assert!(high[1] - low[1] > 0.1 * x, "{x}: {low:?} {high:?}");
        }
        assert!(signed(0.0).iter().all(|&x| x > 0.85));
    }

    #[test]
    fn colours_stay_on_the_screen_whatever_the_number() {
        for x in [-9.0, f64::NAN, f64::INFINITY, 9.0] {
            assert!(magnitude(x).into_iter().chain(signed(x)).all(|c| (0.0..=1.0).contains(&c)));
        }
        let there_and_back = lightened([0.2, 0.4, 0.6], 0.0);
        assert!(there_and_back.iter().zip([0.2, 0.4, 0.6]).all(|(a, b)| (a - b).abs() < 1e-5));
    }
}
