//! Roughness: a surface of tiny mirrors whose normals follow the distribution of Trowbridge and Reitz 1975, known as GGX
//! (Walter et al. 2007, *Microfacet models for refraction through rough surfaces*).
//!
//! Directions are in a frame whose third axis is the surface's normal, and point away from the surface.

use crate::math::circle::on_circle;
use crate::math::space::UnitVec3;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Roughness below which a surface is taken for perfectly smooth: its highlight would be narrower than what single
/// precision tells apart.
pub const SMOOTH_BELOW: f32 = 0.01;

/// A rough surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ggx {
    alpha: f32,
}

impl Ggx {
    /// The surface of a roughness in [0, 1] as the eye judges it: alpha, the slope of the mirrors, is its square (Burley
    /// 2012, *Physically-based shading at Disney*, §5.4). `None` for a perfectly smooth one, below [`SMOOTH_BELOW`].
    pub fn of_roughness(roughness: f32) -> Option<Self> {
        (roughness >= SMOOTH_BELOW).then_some(Self { alpha: roughness * roughness })
    }

    /// Density of the mirrors' normals [1/sr]: its integral times the cosine to the surface's normal is 1.
    #[inline]
    pub fn density(self, h: Vec3) -> f32 {
        let alpha_sq = self.alpha * self.alpha;
        // In this form nothing cancels near the pole.
        let stretched = (h.x * h.x + h.y * h.y) / alpha_sq + h.z * h.z;
        FRAC_1_PI / (alpha_sq * stretched * stretched)
    }

    /// Λ: mirrors hidden by others for each one that is seen from `w` (Heitz 2014, *Understanding the masking-shadowing
    /// function in microfacet-based BRDFs*, eq. 72).
    #[inline]
    pub fn lambda(self, w: Vec3) -> f32 {
        let x = self.alpha * self.alpha * (w.x * w.x + w.y * w.y) / (w.z * w.z);
        0.5 * x / ((1.0 + x).sqrt() + 1.0)
    }

    /// Share of the mirrors that face `w` which can be seen from there.
    #[inline]
    pub fn seen(self, w: Vec3) -> f32 {
        1.0 / (1.0 + self.lambda(w))
    }

    /// Share of mirrors seen from both directions on one side, which is larger than the product because deep ones are
    /// hidden from both (eq. 99 of the same paper).
    #[inline]
    pub fn seen_from_both(self, wo: Vec3, wi: Vec3) -> f32 {
        1.0 / (1.0 + self.lambda(wo) + self.lambda(wi))
    }

    /// Density [1/sr] with which [`Ggx::sample_seen`] returns the normal `h`.
    #[inline]
    pub fn seen_density(self, wo: Vec3, h: Vec3) -> f32 {
        self.seen(wo) * wo.dot(h).max(0.0) * self.density(h) / wo.z
    }

    /// The normal of a mirror, each with the area under which it is seen from `wo`, from two uniform numbers (Dupuy and
    /// Benyoub 2023, *Sampling visible GGX normals with spherical caps*). `wo.z` > 0.
    #[inline]
    pub fn sample_seen(self, wo: Vec3, u: [f32; 2]) -> Vec3 {
        let stretched = Vec3::new(wo.x * self.alpha, wo.y * self.alpha, wo.z).normalize();
        // On a hemisphere of unit size, reflected light fills a cap evenly.
        let z = (1.0 - u[0]) * (1.0 + stretched.z) - stretched.z;
        let sine = (1.0 - z * z).max(0.0).sqrt();
        let h = (sine * on_circle(u[1])).extend(z) + stretched;
        Vec3::new(h.x * self.alpha, h.y * self.alpha, h.z.max(1e-7)).normalize()
    }

    /// Width of the highlight, for tests and tables.
    pub fn alpha(self) -> f32 {
        self.alpha
    }
}

/// The direction `w` mirrored at a normal; both point away.
#[inline]
pub fn mirrored(w: Vec3, h: Vec3) -> Vec3 {
    2.0 * w.dot(h) * h - w
}

/// The direction in which light that comes from `w` goes on behind a boundary with normal `h` on the side of `w`; `None`
/// at total reflection. `eta` is the index of refraction behind it over that before.
#[inline]
pub fn refracted(w: Vec3, h: Vec3, eta: f32) -> Option<Vec3> {
    let cosine = w.dot(h);
    let sine_sq = (1.0 - cosine * cosine).max(0.0) / (eta * eta);
    (sine_sq < 1.0).then(|| (h * (cosine / eta - (1.0 - sine_sq).sqrt()) - w / eta).normalize())
}

/// The normal to shade with, bent so far towards the surface's own that light mirrored at it does not go into the
/// surface (Keller et al. 2017, *The Iray light transport simulation and rendering system*, §A.3); `normal` and
/// `shading` are on the side of `toward`, which points to the viewer.
pub fn bent(normal: UnitVec3, shading: UnitVec3, toward: UnitVec3) -> UnitVec3 {
    let (n, w) = (normal.as_vec3(), toward.as_vec3());
    let r = mirrored(w, shading.as_vec3());
    let below = n.dot(r);
    if below >= 0.0 && w.dot(*shading) > 0.0 {
        return shading;
    }
    // The mirrored direction, lifted along the surface's normal until it grazes.
    let lift = below.min(0.0) - 1e-3;
    let grazing = (r - n * lift).normalize_or(n);
    UnitVec3::try_new(w + grazing).filter(|bent| bent.dot(w) > 0.0).unwrap_or(normal)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};

    #[test]
    fn normals_cover_the_surface_once_and_are_seen_as_it_is() {
        // ∫ D(h) cos dh = 1, and ∫ G1 max(0, o·h) D(h) dh = cos o.
        for roughness in [0.2, 0.5, 1.0] {
            let ggx = Ggx::of_roughness(roughness).expect("rough");
            for wo in [Vec3::Z, Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.1, 0.97, 0.2).normalize()] {
                let (mut cover, mut seen) = (0.0, 0.0);
                let n = 1000;
                for i in 0..n {
                    // Half the nodes where the density is: tan² = alpha² u/(1 − u).
                    let u = (i as f64 + 0.5) / n as f64;
                    let a_sq = f64::from(ggx.alpha).powi(2);
                    let cosine = ((1.0 - u) / (1.0 - u + a_sq * u)).sqrt();
                    let sine = (1.0 - cosine * cosine).sqrt();
                    // Of that density, times the cosine, the nodes are spread.
                    for j in 0..64 {
                        let phi = (f64::from(j) + 0.5) / 64.0 * std::f64::consts::TAU;
                        let h = Vec3::new((sine * phi.cos()) as f32, (sine * phi.sin()) as f32, cosine as f32);
                        let spread = a_sq / (std::f64::consts::PI * (cosine.powi(2) * (a_sq - 1.0) + 1.0).powi(2));
                        let weight = 1.0 / (spread * cosine * 64.0 * n as f64);
                        cover += f64::from(ggx.density(h)) * cosine * weight;
                        seen += f64::from(ggx.seen(wo) * wo.dot(h).max(0.0) * ggx.density(h)) * weight;
                    }
                }
                assert!((cover - 1.0).abs() < 1e-4, "{roughness}: {cover}");
                assert!((seen - f64::from(wo.z)).abs() < 5e-3, "{roughness} {wo}: {seen}");
            }
        }
    }

    #[test]
    fn bent_normals_mirror_light_outwards() {
        let mut rng = CounterRng::new(Seed(4));
        let mut direction = || Vec3::from_array(std::array::from_fn(|_| rng.uniform() - 0.5));
        let mut bends = 0;
        for _ in 0..2000 {
            let Some(n) = UnitVec3::try_new(direction()) else { continue };
            let flip = |v: UnitVec3| if v.dot(*n) < 0.0 { -v } else { v };
            let (Some(s), Some(w)) = (UnitVec3::try_new(direction()), UnitVec3::try_new(direction())) else { continue };
            let (s, w) = (flip(s), flip(w));
            let b = bent(n, s, w);
            assert!(w.dot(*b) > 0.0 && mirrored(*w, *b).dot(*n) > -1e-4, "{n:?} {s:?} {w:?}");
            bends += usize::from(b != s);
        }
        assert!(bends > 100 && bends < 1900);
    }

    #[test]
    fn refraction_follows_snell() {
        let w = Vec3::new(0.6, 0.0, 0.8);
        let t = refracted(w, Vec3::Z, 1.5).expect("not total");
        assert!((t.x + 0.4).abs() < 1e-6 && t.z < 0.0 && (t.length() - 1.0).abs() < 1e-6);
        assert_eq!(refracted(w, Vec3::Z, 0.5), None);
    }
}
