//! The point of a triangle nearest to a given one.

use glam::Vec3;

/// The point of the triangle `abc` that is nearest to `p`, by Voronoi regions (Ericson 2005, *Real-Time Collision
/// Detection*, section 5.1.5). Degenerate triangles are treated as the segments or points that they are.
#[inline]
pub fn closest_point(p: Vec3, [a, b, c]: [Vec3; 3]) -> Vec3 {
    let (ab, ac) = (b - a, c - a);
    let ap = p - a;
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 > d6 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    let (to_c, to_b) = (d4 - d3, d5 - d6);
    if va <= 0.0 && to_c >= 0.0 && to_b >= 0.0 && to_c + to_b > 0.0 {
        return b + (c - b) * (to_c / (to_c + to_b));
    }
    let sum = va + vb + vc;
    if sum > 0.0 { a + ab * (vb / sum) + ac * (vc / sum) } else { a }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};

    fn by_search(p: Vec3, [a, b, c]: [Vec3; 3]) -> f32 {
        let n = 60;
        let points = (0..=n).flat_map(|i| (0..=n - i).map(move |j| (i as f32 / n as f32, j as f32 / n as f32)));
        points.map(|(u, v)| (a + (b - a) * u + (c - a) * v).distance(p)).fold(f32::INFINITY, f32::min)
    }

    #[test]
    fn no_point_of_the_triangle_is_nearer() {
        let mut rng = CounterRng::new(Seed(1));
        let mut point = || Vec3::from_array(std::array::from_fn(|_| rng.uniform() * 2.0 - 1.0));
        for _ in 0..300 {
            let (p, triangle) = (point() * 2.0, [point(), point(), point()]);
            let found = closest_point(p, triangle).distance(p);
            let searched = by_search(p, triangle);
            assert!(found <= searched + 1e-5 && searched - found < 0.05, "{found} {searched}");
        }
    }

    #[test]
    fn degenerate_triangles_give_finite_points() {
        let p = Vec3::new(0.3, 0.4, 0.5);
        for triangle in [[Vec3::ONE; 3], [Vec3::ZERO, Vec3::X, Vec3::X], [Vec3::ZERO, Vec3::X, Vec3::X * 2.0]] {
            let found = closest_point(p, triangle);
            assert!(found.is_finite() && (found.distance(p) - by_search(p, triangle)).abs() < 0.02, "{triangle:?}");
        }
    }
}
