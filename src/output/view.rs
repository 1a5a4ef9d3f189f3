//! How light is mapped to the screen.

use crate::output::View;

/// What the screen shows in a view for linear Rec. 709 light, 0 to 1. Not-a-number shows as 0.
pub fn on_screen(view: View, rgb: [f32; 3]) -> [f32; 3] {
    let light = || rgb.map(|x| if x.is_nan() { 0.0 } else { x.clamp(0.0, 1e9) });
    match view {
        View::Standard => rgb.map(|x| srgb_from_linear(unit(x))),
        View::Neutral => pbr_neutral(light()).map(|x| srgb_from_linear(unit(x))),
        View::Agx => agx(light()).map(|x| srgb_from_linear(unit(x))),
        View::FalseColor => false_color(light()),
        View::Raw => rgb.map(unit),
    }
}

fn unit(x: f32) -> f32 {
    if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) }
}

/// IEC 61966-2-1 transfer curve.
pub(super) fn srgb_from_linear(x: f32) -> f32 {
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// Its inverse.
pub(crate) fn linear_from_srgb(x: f32) -> f32 {
    if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

/// Khronos PBR Neutral tone mapper (2024 specification), for light in [0, ∞).
fn pbr_neutral(rgb: [f32; 3]) -> [f32; 3] {
    /// Light reflected by a dielectric at normal incidence, which the mapper takes off.
    const F90: f32 = 0.04;
    const START: f32 = 0.8 - F90;
    const DESATURATION: f32 = 0.15;
    let low = rgb[0].min(rgb[1]).min(rgb[2]);
    let offset = if low < 2.0 * F90 { low - low * low / (4.0 * F90) } else { F90 };
    let rgb = rgb.map(|x| x - offset);
    let peak = rgb[0].max(rgb[1]).max(rgb[2]);
    if peak < START {
        return rgb;
    }
    let range = 1.0 - START;
    let new_peak = 1.0 - range * range / (peak + range - START);
    let toward_white = 1.0 - 1.0 / (DESATURATION * (peak - new_peak) + 1.0);
    rgb.map(|x| x * new_peak / peak * (1.0 - toward_white) + new_peak * toward_white)
}

type Matrix = [[f32; 3]; 3];

fn product(matrix: &Matrix, c: [f32; 3]) -> [f32; 3] {
    matrix.map(|row| row[0] * c[0] + row[1] * c[1] + row[2] * c[2])
}

/// Middle grey.
const MIDDLE_GREY: f32 = 0.18;

/// AgX (Sobotka 2022) in the form that Blender has since 4.0, for light in [0, ∞): colours are drawn together, each channel goes
/// through a sigmoid of its logarithm, hues are turned back towards what they were, and colours are spread again. The sigmoid is as
/// published; the matrices and how far hues are turned back are fitted to what Blender 5.0 shows, see `tests/interop/agx.py`.
fn agx(rgb: [f32; 3]) -> [f32; 3] {
    /// Linear Rec. 709 to Rec. 2020 and back (ITU-R BT.2087).
    const TO_WIDE: Matrix =
        [[0.627_404, 0.329_283, 0.043_313], [0.069_097, 0.919_540, 0.011_362], [0.016_391, 0.088_013, 0.895_595]];
    const FROM_WIDE: Matrix =
        [[1.660_491, -0.587_641, -0.072_85], [-0.124_551, 1.132_9, -0.008_349], [-0.018_151, -0.100_579, 1.118_73]];
    const INSET: Matrix = [[0.8860, 0.0703, 0.0437], [0.1314, 0.7699, 0.0987], [0.1092, 0.0743, 0.8165]];
    const OUTSET: Matrix =
        [[1.093_738, -0.077_015, -0.016_723], [-0.125_361, 1.137_179, -0.011_818], [-0.133_945, -0.111_658, 1.245_603]];
    /// How far hues are turned back.
    const KEPT_HUE: f32 = 0.5837;
    let drawn = product(&INSET, product(&TO_WIDE, rgb));
    let curved = drawn.map(|x| agx_curve(x).powf(2.4));
    let curved = with_hue_towards(curved, drawn, KEPT_HUE);
    product(&FROM_WIDE, product(&OUTSET, curved))
}

/// The sigmoid of a channel: a straight piece about middle grey with a toe and a shoulder of power 1.5.
fn agx_curve(x: f32) -> f32 {
    /// Binary logarithms of the light that is black and of that which is white.
    const BLACK: f32 = -12.473_93;
    const WHITE: f32 = 4.026_069;
    const SLOPE: f32 = 2.4;
    const POWER: f32 = 1.5;
    let place = |x: f32| ((x.max(1e-12).log2() - BLACK) / (WHITE - BLACK)).clamp(0.0, 1.0);
    let (pivot_x, pivot_y) = (place(MIDDLE_GREY), MIDDLE_GREY.powf(1.0 / 2.4));
    // An arm from the pivot that ends where black or white is.
    let arm = |run: f32, rise: f32, d: f32| {
        let straight = SLOPE * run;
        let scale = (((straight / rise).powf(POWER) - 1.0) * straight.powf(-POWER)).powf(-1.0 / POWER);
        let t = SLOPE * d / scale;
        scale * t * (1.0 + t.powf(POWER)).powf(-1.0 / POWER)
    };
    let d = place(x) - pivot_x;
    let y = if d < 0.0 { pivot_y - arm(pivot_x, pivot_y, -d) } else { pivot_y + arm(1.0 - pivot_x, 1.0 - pivot_y, d) };
    y.clamp(0.0, 1.0)
}

/// `color` with its hue turned by a share of the way to that of `other`; largest and smallest channel keep their values.
fn with_hue_towards(color: [f32; 3], other: [f32; 3], share: f32) -> [f32; 3] {
    let (Some(from), Some(to)) = (hue(color), hue(other)) else { return color };
    // The shorter way round.
    let turn = (to - from + 3.0).rem_euclid(6.0) - 3.0;
    let hue = (from + share * turn).rem_euclid(6.0);
    let high = color[0].max(color[1]).max(color[2]);
    let low = color[0].min(color[1]).min(color[2]);
    let channel = |n: f32| {
        let k = (n + hue) % 6.0;
        high - (high - low) * k.min(4.0 - k).clamp(0.0, 1.0)
    };
    [channel(5.0), channel(3.0), channel(1.0)]
}

/// Hue on a hexagon: red 0, green 2, blue 4; `None` of greys.
fn hue([r, g, b]: [f32; 3]) -> Option<f32> {
    let high = r.max(g).max(b);
    let range = high - r.min(g).min(b);
    if range <= 0.0 {
        return None;
    }
    Some(match high {
        _ if high == r => ((g - b) / range).rem_euclid(6.0),
        _ if high == g => (b - r) / range + 2.0,
        _ => (r - g) / range + 4.0,
    })
}

/// Edges of the bands of false colours [stops from middle grey], and what the screen shows below each; what is above the last is
/// white.
pub const FALSE_COLORS: [(f32, [u8; 3]); 12] = [
    (-8.0, [0, 0, 0]),
    (-6.0, [52, 20, 92]),
    (-5.0, [43, 45, 150]),
    (-4.0, [32, 88, 190]),
    (-3.0, [30, 140, 190]),
    (-2.0, [38, 160, 130]),
    (-0.5, [58, 140, 60]),
    (0.5, [128, 128, 128]),
    (1.5, [190, 190, 70]),
    (2.5, [236, 190, 50]),
    (4.5, [236, 120, 40]),
    (6.5, [214, 40, 40]),
];

/// The colour of the band that luminance falls in: grey at middle grey, greens and blues below, yellow to red above, where `Standard`
/// (at 2.5 stops) and then `Agx` (at 6.5) show white.
pub fn false_color(rgb: [f32; 3]) -> [f32; 3] {
    let luminance = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
    let stops = (luminance / MIDDLE_GREY).log2();
    let band = FALSE_COLORS.iter().find(|(edge, _)| stops < *edge);
    band.map_or([1.0; 3], |(_, color)| color.map(|c| f32::from(c) / 255.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neutral_view_keeps_colours_and_never_cuts_a_highlight() {
        // Above 2·F90 and below 0.8 the mapper only takes 0.04 off.
        let kept = pbr_neutral([0.5, 0.4, 0.3]);
        assert!((kept[0] - 0.46).abs() < 1e-6 && (kept[2] - 0.26).abs() < 1e-6);
        let mut last = 0.0;
        for stop in 0..20 {
            let bright = pbr_neutral([2f32.powi(stop), 0.1, 0.1])[0];
            assert!(bright >= last && bright <= 1.0);
            last = bright;
        }
    }

    /// Light and what Blender 5.0 shows for it.
    const BY_BLENDER: [([f32; 3], [f32; 3]); 13] = [
        ([0.18, 0.18, 0.18], [0.4613, 0.4613, 0.4614]),
        ([0.05, 0.02, 0.3], [0.2086, 0.2184, 0.5812]),
        ([1.0, 0.5, 0.2], [0.7891, 0.6526, 0.5333]),
        ([4.0, 2.0, 0.5], [0.9313, 0.8388, 0.7432]),
        ([0.02, 0.05, 0.01], [0.1316, 0.2139, 0.0675]),
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
        ([1.0, 0.0, 0.0], [0.8580, 0.2241, 0.1292]),
        ([60.0, 60.0, 60.0], [1.0, 1.0, 1.0]),
        ([0.8, 0.8, 0.9], [0.7392, 0.7412, 0.7562]),
        ([0.3, 0.6, 1.2], [0.6118, 0.7031, 0.8056]),
        ([8.0, 0.5, 0.1], [1.0, 0.7599, 0.7060]),
        ([0.001, 0.002, 0.004], [0.0025, 0.0114, 0.0255]),
        ([0.18, 0.3, 0.1], [0.4706, 0.5564, 0.3516]),
    ];

    #[test]
    fn agx_is_what_blender_shows() {
        for (light, expected) in BY_BLENDER {
            let shown = on_screen(View::Agx, light);
            let error = (0..3).map(|i| (shown[i] - expected[i]).abs()).fold(0.0, f32::max);
            assert!(error < 0.6 / 255.0, "{light:?}: {shown:?}, not {expected:?}");
        }
    }

    #[test]
    fn agx_rises_from_black_to_white() {
        let grey = |stops: f32| on_screen(View::Agx, [MIDDLE_GREY * stops.exp2(); 3]);
        let mut last = -1.0;
        for i in -40..27 {
            let shown = grey(i as f32 * 0.25);
            assert!(shown[0] > last && (shown[0] - shown[2]).abs() < 2e-4, "{i}: {shown:?}");
            last = shown[0];
        }
        assert!(grey(-12.0)[0] < 1e-3 && grey(6.6)[0] > 0.9999);
    }

    #[test]
    fn false_colors_change_at_their_edges() {
        for (i, &(edge, below)) in FALSE_COLORS.iter().enumerate() {
            let at = |stops: f32| false_color([MIDDLE_GREY * stops.exp2(); 3]).map(|c| (c * 255.0).round() as u8);
            assert_eq!(at(edge - 0.01), below);
            assert_eq!(at(edge + 0.01), FALSE_COLORS.get(i + 1).map_or([255; 3], |next| next.1));
        }
        assert_eq!(on_screen(View::FalseColor, [0.0; 3]), [0.0; 3]);
        assert!(FALSE_COLORS.is_sorted_by(|a, b| a.0 < b.0));
    }

    #[test]
    fn numbers_that_are_none_do_not_break_a_picture() {
        for view in View::ALL {
            for x in [f32::NAN, f32::INFINITY, -f32::INFINITY, -1.0, 1e30] {
                let shown = on_screen(view, [x, 0.5, 0.5]);
                assert!(shown.iter().all(|s| (0.0..=1.0).contains(s)), "{view:?} {x}: {shown:?}");
            }
        }
    }
}
