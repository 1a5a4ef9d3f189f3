//! The unit circle.

use glam::Vec2;
use std::f32::consts::FRAC_PI_2;

/// The point of the unit circle at `turn` of a full turn, in [0, 1]: (cos 2πu, sin 2πu), to some 1e-7.
///
/// Written out: every direction that is sampled needs one, and the library's functions take any angle and a third more instructions.
#[inline]
pub fn on_circle(turn: f32) -> Vec2 {
    debug_assert!((0.0..=1.0).contains(&turn));
    // The nearest quarter, and the angle from there, at most π/4: both without rounding but for π.
    let quarter = (4.0 * turn).round_ties_even();
    let x = (4.0 * turn - quarter) * FRAC_PI_2;
    let x_sq = x * x;
    // Taylor's series.
    let sine = x + x * x_sq * (-1.0 / 6.0 + x_sq * (1.0 / 120.0 + x_sq * (-1.0 / 5040.0 + x_sq * (1.0 / 362_880.0))));
    let cosine = 1.0 + x_sq * (-0.5 + x_sq * (1.0 / 24.0 + x_sq * (-1.0 / 720.0 + x_sq * (1.0 / 40_320.0))));
    let quarter = quarter as u32;
    let (first, second) = if quarter & 1 == 0 { (cosine, sine) } else { (sine, cosine) };
    let flipped = |x: f32, quarters: u32| f32::from_bits(x.to_bits() ^ (quarters & 2) << 30);
    Vec2::new(flipped(first, quarter + 1), flipped(second, quarter))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_those_of_the_library() {
        let eighths = (0..=8).map(|i| i as f32 / 8.0);
        let beside = eighths.flat_map(|u| [u, u.next_up(), u.next_down()]);
        for u in (0..=1 << 20).map(|i| i as f32 / (1 << 20) as f32).chain(beside).filter(|u| (0.0..=1.0).contains(u)) {
            let (sine, cosine) = (std::f64::consts::TAU * f64::from(u)).sin_cos();
            let p = on_circle(u).as_dvec2();
            assert!((p.x - cosine).abs() < 1.2e-7 && (p.y - sine).abs() < 1.2e-7, "{u}: {p} and {cosine} {sine}");
        }
    }
}
