//! What every kind of surface promises: samples follow the density, weights are value over density, light goes both ways
//! alike, and no more comes back than came.

use crate::math::hash::{CounterRng, Seed};
use crate::math::space::UnitVec3;
use crate::math::statistics::{Moments, chi_square_test};
use crate::render::bsdf::Bsdf;
use crate::render::bsdf::conductor::{Metal, MetalColor};
use crate::render::bsdf::dielectric::Glass;
use crate::render::bsdf::metals;
use crate::render::bsdf::plastic::Plastic;
use crate::render::bsdf::principled::{Principled, PrincipledSettings};
use glam::Vec3;
use std::f64::consts::TAU;

/// Surfaces to look at: of every kind, or some.
struct Kinds {
    metals: Vec<(f32, Metal)>,
    glasses: Vec<(f32, Glass)>,
    plastics: Vec<(f32, Plastic)>,
    mixes: Vec<(&'static str, Principled)>,
}

fn mix(metallic: f32, roughness: f32, transmission: f32, coat: f32, coat_roughness: f32) -> Principled {
    Principled::new(&PrincipledSettings { metallic, roughness, ior: 1.5, transmission, coat, coat_roughness })
}

impl Kinds {
    fn new(roughnesses: &[f32]) -> Self {
        Self {
            metals: roughnesses.iter().map(|&r| (r, Metal::new(r))).collect(),
            glasses: roughnesses.iter().map(|&r| (r, Glass::new(1.5, r))).collect(),
            plastics: roughnesses.iter().map(|&r| (r, Plastic::new(1.5, r))).collect(),
            mixes: vec![
                ("plastic and metal", mix(0.4, 0.5, 0.0, 0.0, 0.0)),
                ("all", mix(0.3, 0.6, 0.5, 0.7, 0.4)),
                ("under a smooth coat", mix(0.5, 0.4, 0.0, 1.0, 0.0)),
                ("perfectly smooth", mix(0.3, 0.0, 0.5, 0.5, 0.0)),
            ],
        }
    }

    /// All of one colour, by name.
    fn all(&self, color: Vec3) -> Vec<(String, Bsdf<'_>)> {
        let gold = MetalColor::measured(metals::GOLD.eta, metals::GOLD.k);
        let schlick = MetalColor::Schlick { f0: color };
        let mut all = vec![("diffuse".to_string(), Bsdf::Diffuse { reflectance: color })];
        for (r, metal) in &self.metals {
            all.push((format!("gold {r}"), Bsdf::Conductor { metal, color: gold, tint: color }));
            all.push((format!("metal {r}"), Bsdf::Conductor { metal, color: schlick, tint: Vec3::ONE }));
        }
        for (r, glass) in &self.glasses {
            for is_front in [true, false] {
                let bsdf = Bsdf::Dielectric { glass, tint: color, is_front };
                all.push((format!("glass {r}, from outside: {is_front}"), bsdf));
            }
        }
        for (r, plastic) in &self.plastics {
            all.push((format!("plastic {r}"), Bsdf::Plastic { plastic, reflectance: color }));
        }
        for (name, model) in &self.mixes {
            for is_front in [true, false] {
                let bsdf = Bsdf::Principled { model, base_color: color, is_front };
                all.push((format!("mix, {name}, from outside: {is_front}"), bsdf));
            }
        }
        all
    }
}

fn normal() -> UnitVec3 {
    UnitVec3::try_new(Vec3::new(0.2, -0.9, 0.4)).expect("not zero")
}

/// The direction of travel of a path that is seen under this cosine.
fn before(cosine: f32) -> UnitVec3 {
    let sine = (1.0 - cosine * cosine).sqrt();
    -normal().from_local(Vec3::new(sine * 0.6, -sine * 0.8, cosine))
}

#[test]
fn samples_follow_the_density_which_leaves_out_what_is_lost_or_perfect() {
    const BANDS: usize = 20;
    const SECTORS: usize = 20;
    const N: usize = 60_000;
    let kinds = Kinds::new(&[0.4, 1.0]);
    let mut rng = CounterRng::new(Seed(21));
    let mut tests = 0;
    for (name, bsdf) in kinds.all(Vec3::new(0.9, 0.5, 0.2)) {
        for cosine in [0.9, 0.2] {
            let (n, before) = (normal(), before(cosine));
            let (s, t) = n.orthonormal_pair();
            let mut counts = vec![0.0; BANDS * SECTORS];
            let mut without_density = 0.0;
            for _ in 0..N {
                let Some(sample) = bsdf.sample(n, before, [rng.uniform(), rng.uniform(), rng.uniform()]) else {
                    without_density += 1.0;
                    continue;
                };
                let Some(pdf) = sample.pdf else {
                    without_density += 1.0;
                    continue;
                };
                let d = sample.direction;
                // Rounding of the frames matters most where light grazes.
                let found = bsdf.pdf(n, before, d);
                assert!((pdf - found).abs() < 0.02 * pdf + 1e-3, "{name}, {cosine}: density {pdf} and {found}");
                let value = bsdf.value(n, before, d);
                let error = (value - sample.weight * pdf).abs().max_element();
                assert!(
                    error < 0.02 * value.max_element() + 1e-3,
                    "{name}, {cosine}: {value}, {}",
                    sample.weight * pdf
                );
                let band = ((n.dot(*d).clamp(-1.0, 1.0) + 1.0) * 0.5 * BANDS as f32) as usize;
                let phi = f64::from(d.dot(t)).atan2(f64::from(d.dot(s))).rem_euclid(TAU);
                let sector = (phi / TAU * SECTORS as f64) as usize;
                counts[band.min(BANDS - 1) * SECTORS + sector.min(SECTORS - 1)] += 1.0;
            }
            // The density over each cell by the midpoint rule.
            const FINE: usize = 30;
            let mut expected = vec![0.0; BANDS * SECTORS];
            for (cell, sum) in expected.iter_mut().enumerate() {
                for i in 0..FINE * FINE {
                    let (x, y) = ((i % FINE) as f64 + 0.5, (i / FINE) as f64 + 0.5);
                    let z = -1.0 + 2.0 * ((cell / SECTORS) as f64 + y / FINE as f64) / BANDS as f64;
                    let phi = TAU * ((cell % SECTORS) as f64 + x / FINE as f64) / SECTORS as f64;
                    let r = (1.0 - z * z).sqrt();
                    let d = n.from_local(Vec3::new((r * phi.cos()) as f32, (r * phi.sin()) as f32, z as f32));
                    *sum += f64::from(bsdf.pdf(n, before, d));
                }
                *sum *= 2.0 * TAU / (BANDS * SECTORS * FINE * FINE) as f64 * N as f64;
            }
            let integral = expected.iter().sum::<f64>() / N as f64;
            let share = without_density / N as f64;
            let deviation = (share * (1.0 - share) / N as f64).sqrt();
            assert!((integral + share - 1.0).abs() < 4.0 * deviation + 3e-3, "{name}, {cosine}: {integral} + {share}");
            // What the midpoint rule misses is no fault of the samples.
            let scale = (1.0 - share) / integral;
            counts.push(without_density);
            expected.iter_mut().for_each(|e| *e *= scale);
            expected.push(without_density);
            let p = chi_square_test(&counts, &expected);
            assert!(p > 1e-5, "{name}, {cosine}: p = {p}");
            tests += 1;
        }
    }
    assert!(tests > 30);
}

#[test]
fn light_goes_both_ways_alike() {
    let kinds = Kinds::new(&[0.2, 0.5, 1.0]);
    let n = normal();
    let mut rng = CounterRng::new(Seed(5));
    let mut compared = 0;
    for (name, bsdf) in kinds.all(Vec3::new(0.9, 0.5, 0.2)) {
        // Rough glass that loses nothing, and what is under a coat, are not reciprocal, and say so.
        if !(name.starts_with("diffuse")
            || name.starts_with("gold")
            || name.starts_with("metal")
            || name.starts_with("plastic")
            || name.contains("plastic and metal"))
        {
            continue;
        }
        for _ in 0..500 {
            let mut direction = || {
                let (z, phi) = (rng.uniform().max(0.01), rng.uniform() * std::f32::consts::TAU);
                let r = (1.0 - z * z).sqrt();
                n.from_local(Vec3::new(r * phi.cos(), r * phi.sin(), z))
            };
            let (a, b) = (direction(), direction());
            let there = bsdf.value(n, -a, b) / n.dot(*b);
            let back = bsdf.value(n, -b, a) / n.dot(*a);
            assert!((there - back).abs().max_element() < 2e-3 * there.max_element() + 1e-5, "{name}: {there} {back}");
            compared += 1;
        }
    }
    assert!(compared > 4000);
}

/// Mean share of light that goes on, of light from everywhere; radiance behind the surface is counted as that before it.
fn furnace(bsdf: &Bsdf, cosine: f32, count: usize) -> Moments {
    let (n, before) = (normal(), before(cosine));
    let mut rng = CounterRng::new(Seed(3));
    let mut moments = Moments::default();
    for _ in 0..count {
        let sample = bsdf.sample(n, before, [rng.uniform(), rng.uniform(), rng.uniform()]);
        moments.push(sample.map_or(0.0, |s| {
            let eta = if n.dot(*s.direction) < 0.0 { bsdf.eta() } else { 1.0 };
            f64::from(s.weight.x * eta * eta)
        }));
    }
    moments
}

#[test]
fn what_is_white_reflects_all_light_and_never_more() {
    let kinds = Kinds::new(&[0.0, 0.02, 0.1, 0.25, 0.5, 0.75, 1.0]);
    let mut worst: f64 = 0.0;
    for (name, bsdf) in kinds.all(Vec3::ONE) {
        for cosine in [1.0, 0.8, 0.5, 0.25, 0.1, 0.03] {
            let found = furnace(&bsdf, cosine, 40_000);
            let (mean, error) = (found.mean(), found.variance_of_mean().sqrt());
            if name.starts_with("gold") {
                assert!(mean < 1.0 && mean > 0.9, "{name}, {cosine}: {mean}");
                continue;
            }
            assert!((mean - 1.0).abs() < 4.0 * error + 2e-3, "{name}, {cosine}: {mean} ± {error}");
            worst = worst.max((mean - 1.0).abs());
        }
    }
    println!("furnace: at most {worst} off");
}

#[test]
fn coloured_surfaces_stay_below_white() {
    let kinds = Kinds::new(&[0.0, 0.3, 1.0]);
    for (name, bsdf) in kinds.all(Vec3::splat(0.5)) {
        for cosine in [1.0, 0.5, 0.1] {
            let found = furnace(&bsdf, cosine, 20_000);
            let share = found.mean();
            let is_metal = name.starts_with("metal");
            assert!(share < 1.0 + 1e-5 && share > 0.2, "{name}, {cosine}: {share}");
            assert!(!is_metal || cosine < 1.0 || share < 0.52, "{name}: {share}");
        }
    }
}
