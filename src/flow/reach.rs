//! How far from a wall its distance is smooth: what a flow round it, or inside it, may make use of.

use crate::geometry::primitive::Primitive;
use crate::geometry::sdf::{PlacedSdf, Sdf, SmoothUnion};
use crate::geometry::smooth_union::deepest;
use crate::math::jet::Scalar;
use glam::{DVec3, UVec3};

/// Blends narrower than this part of a union's longest edge are creases to the flow.
const BLEND_MIN: f64 = 1.0 / 16.0;
/// Nodes across a blend's width, where a union's distance is looked at.
const NODES: f64 = 6.0;
/// Share of the blend's width that a union's distance must be smooth for from the wall on.
const STILL_MIN: f64 = 0.5;
/// Below this length the gradient of a union says little about where its wall is. On the node next to where it vanishes
/// it is at most a third.
const SHORT: f64 = 0.4;

/// Distance from the wall at which the solid's distance has a ridge of its own, or no direction [m].
pub fn reach(solid: &PlacedSdf, is_container: bool) -> f64 {
    let scale = f64::from(solid.placement().scale);
    match solid.sdf() {
        Sdf::Primitive(primitive) => scale * primitive_reach(primitive, is_container),
        Sdf::SmoothUnion(union) => {
            let bulge = if is_container { 0.0 } else { deepest(union.parts().len(), union.width()) };
            let parts = union.parts().iter().map(|part| reach(part, is_container) - bulge);
            let own = scale * parts.fold(f64::INFINITY, f64::min);
            smoothness(solid, is_container).map_or(own, |still| own.min(still)).max(1e-6 * scale)
        }
        Sdf::Mesh(_) => f64::INFINITY,
    }
}

fn primitive_reach(primitive: &Primitive, is_container: bool) -> f64 {
    match (primitive, is_container) {
        (Primitive::Torus(t), false) => (t.major_radius - t.minor_radius).max(1e-6),
        (Primitive::Torus(t), true) => t.minor_radius,
        (Primitive::Sphere(s), true) => s.radius,
        (Primitive::Capsule(c), true) => c.radius,
        (Primitive::Cuboid(c), true) => c.half_size.min_element(),
        _ => f64::INFINITY,
    }
}

/// Whether equation 5 applies, which differentiates the normal: it must change smoothly for the velocity not to jump. A
/// capsule's bends suddenly where its caps begin, a rounded box's where the rounding does, a mesh's at every edge.
///
/// That of a union turns too fast where its blend is narrow, and where its gradient vanishes close to the wall, as in
/// the neck of a vessel of two balls.
pub fn has_smooth_normal(solid: &PlacedSdf, is_container: bool) -> bool {
    smoothness(solid, is_container).is_some()
}

/// Of a solid with a smooth normal, the distance from the wall at which its gradient first all but vanishes [m].
fn smoothness(solid: &PlacedSdf, is_container: bool) -> Option<f64> {
    match solid.sdf() {
        Sdf::Primitive(Primitive::Sphere(_) | Primitive::Torus(_) | Primitive::HalfSpace(_)) => Some(f64::INFINITY),
        Sdf::Primitive(Primitive::Cuboid(_) | Primitive::Capsule(_)) | Sdf::Mesh(_) => None,
        Sdf::SmoothUnion(union) => {
            let width = union.width() * f64::from(solid.placement().scale);
            let is_wide = width >= BLEND_MIN * 2.0 * f64::from(solid.bounding_radius());
            if !is_wide || !union.parts().iter().all(|part| has_smooth_normal(part, is_container)) {
                return None;
            }
            Some(stillness(solid, union, is_container)).filter(|still| *still >= STILL_MIN * width)
        }
    }
}

/// Least distance from the wall of a union at which its gradient all but vanishes, as in the middle between two parts
/// [m]: looked for on a lattice. Beyond its bounds there is no such place.
fn stillness(solid: &PlacedSdf, union: &SmoothUnion, is_container: bool) -> f64 {
    let Some(bounds) = solid.bounds() else { return f64::INFINITY };
    let spacing = union.width() * f64::from(solid.placement().scale) / NODES;
    let counts = (bounds.size().as_dvec3() / spacing).ceil().as_uvec3() + 1;
    let mut least = f64::INFINITY;
    for z in 0..counts.z {
        for y in 0..counts.y {
            for x in 0..counts.x {
                let p = bounds.min.as_dvec3() + UVec3::new(x, y, z).as_dvec3() * spacing;
                let found: Scalar<f64> = solid.slope(p.to_array());
                let outward = if is_container { -found.value } else { found.value };
                if outward > 0.0 && outward < least && DVec3::from_array(found.gradient).length() < SHORT {
                    least = outward;
                }
            }
        }
    }
    // The place itself is between nodes.
    least - 0.5 * spacing
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitive::{Cuboid, Sphere};
    use crate::math::space::Similarity;
    use std::sync::Arc;

    fn union(parts: &[Primitive], width: f64, scale: f32) -> PlacedSdf {
        let parts = parts.iter().map(|&part| (part, Similarity::IDENTITY));
        let placement = Similarity { scale, ..Similarity::IDENTITY };
        PlacedSdf::new(Sdf::SmoothUnion(Arc::new(SmoothUnion::new(parts, width))), placement)
    }

    fn ball(x: f64) -> Primitive {
        Primitive::Sphere(Sphere { center: DVec3::X * x, radius: 1.0 })
    }

    #[test]
    fn between_two_balls_the_distance_has_no_direction_half_way() {
        for scale in [1.0f32, 0.1] {
            let apart = union(&[ball(-1.75), ball(1.75)], 0.6, scale);
            let found = reach(&apart, false) / f64::from(scale);
            println!("between balls 1.5 m apart: {found:.3} m");
            // The blend brings the middle, at 0.75 m, nearer by a sixth of its width.
            assert!(found < 0.65 && found > 0.4, "{found}");
            // Where they have melted together nothing outside is still, and inside the neck is.
            let together = union(&[ball(-0.8), ball(0.8)], 0.6, scale);
            assert_eq!(reach(&together, false), f64::INFINITY);
            assert!(has_smooth_normal(&together, false) && !has_smooth_normal(&together, true));
            assert!((reach(&together, true) / f64::from(scale) - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn narrow_blends_and_parts_with_edges_have_no_smooth_normal() {
        let cube = Primitive::Cuboid(Cuboid { center: DVec3::ZERO, half_size: DVec3::ONE, rounding: 0.2 });
        assert!(has_smooth_normal(&union(&[ball(-0.5), ball(0.5)], 0.3, 2.0), false));
        assert!(!has_smooth_normal(&union(&[ball(-0.5), ball(0.5)], 0.1, 2.0), false));
        assert!(!has_smooth_normal(&union(&[ball(-0.5), cube], 0.5, 2.0), false));
        assert_eq!(reach(&union(&[ball(-0.5), cube], 0.5, 2.0), false), f64::INFINITY);
    }
}
