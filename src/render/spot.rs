//! A point that shines into a cone.

use crate::math::space::{UnitVec3, WorldPoint};
use crate::render::color::Rgb;
use crate::render::light::LightSample;
use glam::Vec3;

/// A point that shines into a cone with a smooth edge.
///
/// Its radiant intensity at angle θ from the axis is I s((α − θ)/(b α)) with half the cone's angle α, the share of it `b`
/// over which light fades, and s(x) = x²(3 − 2x) for x in [0, 1], 0 below and 1 above. The fade goes by the angle itself,
/// so that its width on a wall does not depend on that of the cone.
#[derive(Debug, Clone)]
pub struct Spot {
    position: WorldPoint,
    axis: UnitVec3,
    intensity: Rgb,
    /// Half the angle of the cone [rad].
    half_angle: f32,
    /// Where light begins to fade [rad].
    inner_angle: f32,
    cosine: f32,
}

impl Spot {
    /// A spot at `position` that shines along `axis` with `intensity` [W/sr] in the middle of a cone whose sides are
    /// `cone_deg` apart, more than 0 and at most 180; over the outer share `blend` in [0, 1] of it light fades to nothing.
    pub fn new(position: WorldPoint, axis: UnitVec3, intensity: Rgb, cone_deg: f64, blend: f64) -> Self {
        let half = 0.5 * cone_deg.to_radians();
        Self {
            position,
            axis,
            intensity,
            half_angle: half as f32,
            inner_angle: (half * (1.0 - blend)) as f32,
            cosine: half.cos() as f32,
        }
    }

    /// Where it is.
    pub fn position(&self) -> WorldPoint {
        self.position
    }

    /// Radiant intensity along its axis [W/sr].
    pub fn axial_intensity(&self) -> Rgb {
        self.intensity
    }

    /// Radiant intensity along a direction of travel from it [W/sr].
    pub fn intensity(&self, direction: Vec3) -> Rgb {
        // From the chord, which keeps its digits where the angle is small and the cosine nearly 1.
        let angle = 2.0 * (0.5 * (direction - *self.axis).length()).min(1.0).asin();
        if angle >= self.half_angle {
            return Vec3::ZERO;
        }
        let x = ((self.half_angle - angle) / (self.half_angle - self.inner_angle).max(f32::MIN_POSITIVE)).min(1.0);
        self.intensity * (x * x * (3.0 - 2.0 * x))
    }

    /// The direction towards it; `None` outside of the cone.
    pub fn sample(&self, from: WorldPoint) -> Option<LightSample> {
        let offset = self.position - from;
        let direction = UnitVec3::try_new(offset)?;
        let intensity = self.intensity(-*direction);
        let distance = offset.length();
        (intensity != Vec3::ZERO).then(|| LightSample {
            direction,
            distance,
            weight: intensity / (distance * distance),
            pdf: None,
        })
    }

    /// The part of the line through `origin` along `direction` between `t0` and `t1` [m] that is in the cone, a convex set; a
    /// little more where rounding does not tell. `None` where none is.
    pub fn clip(&self, origin: WorldPoint, direction: UnitVec3, t0: f32, t1: f32) -> Option<[f32; 2]> {
        // In f64, as a grazing line's crossings are the difference of nearly equal squares.
        let (axis, d) = (self.axis.as_dvec3(), direction.as_dvec3());
        let from = (origin - self.position).as_dvec3();
        let (along, slope) = (axis.dot(from), axis.dot(d));
        let cos_sq = f64::from(self.cosine) * f64::from(self.cosine);
        // Inside where along(t) ≥ 0 and f(t) = along(t)² − cos² |p(t)|² = a t² + 2 b t + c ≥ 0.
        let a = slope * slope - cos_sq;
        let b = along * slope - cos_sq * from.dot(d);
        let c = along * along - cos_sq * from.length_squared();
        let is_ahead = |t: f64| along + slope * t >= 0.0;
        let (mut low, mut high) = (f64::from(t0), f64::from(t1));
        let discriminant = b * b - a * c;
        if discriminant > 0.0 && a != 0.0 {
            let root = discriminant.sqrt();
            let q = -(b + root.copysign(b));
            let (mut near, mut far) = (q / a, c / q);
            if near > far {
                std::mem::swap(&mut near, &mut far);
            }
            match (a < 0.0, is_ahead(near), is_ahead(far)) {
                // Between both crossings of this half of the double cone.
                (true, true, true) => (low, high) = (low.max(near), high.min(far)),
                (true, ..) => return None,
                // The line runs to infinity inside: behind the crossing that is ahead of the tip.
                (false, false, true) => low = low.max(far),
                (false, true, false) => high = high.min(near),
                // Rounding at the tip: keep all.
                (false, ..) => {}
            }
        } else if a < 0.0 {
            return None;
        } else if slope != 0.0 {
            // Through the tip, or across the half space of a cone of 180°.
            let tip = -along / slope;
            if slope > 0.0 { low = low.max(tip) } else { high = high.min(tip) }
        }
        let slack = 1e-5 * low.abs().max(high.abs());
        let (low, high) = ((low - slack) as f32, (high + slack) as f32);
        let clipped = [low.max(t0), high.min(t1)];
        (clipped[0] < clipped[1]).then_some(clipped)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};

    fn spot(cone_deg: f64, blend: f64) -> Spot {
        let axis = UnitVec3::try_new(Vec3::new(0.2, -0.9, 0.3)).expect("not zero");
        Spot::new(WorldPoint::new(0.5, 2.0, -0.3), axis, Vec3::new(1.0, 2.0, 4.0), cone_deg, blend)
    }

    #[test]
    fn light_falls_from_the_axis_to_the_edge_as_stated() {
        for (cone, blend) in [(40.0, 0.25), (1.0, 0.5), (170.0, 1.0), (60.0, 0.0)] {
            let spot = spot(cone, blend);
            let (u, _) = spot.axis.orthonormal_pair();
            let at = |degrees: f64| {
                let angle = degrees.to_radians();
                spot.intensity(*spot.axis * angle.cos() as f32 + u * angle.sin() as f32).x
            };
            let half = 0.5 * cone;
            assert!((at(0.0) - 1.0).abs() < 1e-6 && (at(0.98 * half * (1.0 - blend)) - 1.0).abs() < 1e-4);
            assert_eq!(at(half * 1.001), 0.0);
            assert_eq!(at(179.0), 0.0);
            // Half way through the fade, half the light; a quarter of the way in, 5/32.
            if blend > 0.0 {
                assert!((at(half * (1.0 - 0.5 * blend)) - 0.5).abs() < 1e-3, "{cone} {blend}");
                assert!((at(half * (1.0 - 0.25 * blend)) - 5.0 / 32.0).abs() < 1e-3, "{cone} {blend}");
            }
        }
    }

    #[test]
    fn clipping_a_line_keeps_all_that_is_lit_and_little_else() {
        let mut rng = CounterRng::new(Seed(7));
        let mut point = |scale: f32| Vec3::from([0; 3].map(|_| (rng.uniform() * 2.0 - 1.0) * scale));
        for cone in [5.0, 40.0, 120.0, 180.0] {
            let spot = spot(cone, 0.3);
            let (mut lit, mut kept) = (0, 0);
            for _ in 0..500 {
                let (origin, direction) = (WorldPoint(point(4.0)), UnitVec3::try_new(point(1.0)).expect("not zero"));
                let clipped = spot.clip(origin, direction, 0.0, 8.0);
                for i in 0..400 {
                    let t = (i as f32 + 0.5) * 0.02;
                    let is_lit = spot.sample(origin + *direction * t).is_some();
                    let is_kept = clipped.is_some_and(|[a, b]| (a..=b).contains(&t));
                    assert!(is_kept || !is_lit, "cone {cone}: {origin:?} {direction:?} at {t}, {clipped:?}");
                    lit += u32::from(is_lit);
                    kept += u32::from(is_kept);
                }
            }
            assert!(lit > 100 && kept < lit + lit / 20, "cone {cone}: {kept} kept for {lit} lit");
        }
    }
}
