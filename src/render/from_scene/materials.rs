//! Materials from what a scene says of its shapes, with the flow along their surfaces.

use crate::flow::reproject::{Integrator, Repetition, Reprojection, Trace};
use crate::flow::surface::{CacheSettings, SurfaceFlow, SurfaceFlowSettings};
use crate::geometry::sdf::PlacedSdf;
use crate::geometry::{Geometry, interpolation};
use crate::math::hash::Seed;
use crate::math::keys::Keys;
use crate::render::bsdf::conductor::{Metal, MetalColor};
use crate::render::bsdf::dielectric::Glass;
use crate::render::bsdf::metals::{self, Index};
use crate::render::bsdf::plastic::Plastic;
use crate::render::bsdf::principled::{Principled, PrincipledSettings};
use crate::render::from_scene::textures::{TextureStore, texture};
use crate::render::from_scene::vec3;
use crate::render::material::{Material, MaterialKind, Sight};
use crate::render::surface_keys::FlowState;
use crate::scene::{Scene, settings};
use std::sync::Arc;

/// The material of each shape, with textures as they are at a time [s]; `geometry` is where shapes are at that time.
pub fn build_materials(scene: &Scene, geometry: &Geometry, store: &mut TextureStore, time: f64) -> Vec<Material> {
    let shapes = scene.settings.shapes.values().zip(&geometry.shapes);
    // A quarter of all memory for all of them.
    let flows = scene.settings.shapes.values().filter(|shape| shape.surface_flow.is_some()).count().max(1);
    let cache_bytes = (scene.settings.render.memory_limit_gib * f64::from(1 << 28)) as u64 / flows as u64;
    let TextureStore { pictures, flows } = store;
    shapes
        .zip(flows)
        .map(|((shape, placed), last)| {
            let color = texture(shape.material.color(), pictures, time);
            let emission = shape.material.emission();
            let emission = (!emission.is_black()).then(|| texture(emission, pictures, time));
            let flow = shape.surface_flow.as_ref().zip(placed.resting.as_ref());
            let flow = flow.map(|(flow, solid)| surface_flow(flow, solid, time, cache_bytes, last));
            Material {
                kind: material_kind(&shape.material),
                color,
                emission,
                moved: placed.moved,
                flow,
                is_one_sided: !shape.two_sided,
                sight: sight(shape),
            }
        })
        .collect()
}

fn sight(shape: &settings::Shape) -> Sight {
    match (shape.invisible_to_camera, shape.holdout, shape.shadow_catcher) {
        (true, ..) => Sight::Through,
        (_, true, _) => Sight::Hole,
        (.., true) => Sight::Shadow,
        _ => Sight::Whole,
    }
}

fn material_kind(material: &settings::Material) -> MaterialKind {
    match material {
        settings::Material::Diffuse(_) => MaterialKind::Diffuse,
        settings::Material::Conductor(c) => {
            let Index { eta, k } = match (c.metal, c.eta, c.k) {
                (None, Some(eta), Some(k)) => Index { eta: vec3(eta), k: vec3(k) },
                (metal, ..) => metal_index(metal.expect("validation refuses conductors without an index")),
            };
            MaterialKind::Conductor {
                metal: Box::new(Metal::new(c.roughness as f32)),
                color: MetalColor::measured(eta, k),
            }
        }
        settings::Material::Dielectric(d) => {
            MaterialKind::Dielectric(Box::new(Glass::new(d.ior as f32, d.roughness as f32)))
        }
        settings::Material::Plastic(p) => {
            MaterialKind::Plastic(Box::new(Plastic::new(p.ior as f32, p.roughness as f32)))
        }
        settings::Material::Principled(p) => MaterialKind::Principled(Box::new(Principled::new(&PrincipledSettings {
            metallic: p.metallic as f32,
            roughness: p.roughness as f32,
            ior: p.ior as f32,
            transmission: p.transmission as f32,
            coat: p.coat as f32,
            coat_roughness: p.coat_roughness as f32,
        }))),
    }
}

fn metal_index(metal: settings::Metal) -> Index {
    match metal {
        settings::Metal::Aluminium => metals::ALUMINIUM,
        settings::Metal::Chromium => metals::CHROMIUM,
        settings::Metal::Copper => metals::COPPER,
        settings::Metal::Gold => metals::GOLD,
        settings::Metal::Iron => metals::IRON,
        settings::Metal::Silver => metals::SILVER,
        settings::Metal::Titanium => metals::TITANIUM,
    }
}

/// The flow along a surface at a time [s]: the last one, if it is the same, with all that was followed of it.
fn surface_flow(
    flow: &settings::SurfaceFlow,
    solid: &Arc<PlacedSdf>,
    time: f64,
    cache_bytes: u64,
    last: &mut Option<Arc<SurfaceFlow>>,
) -> Arc<SurfaceFlow> {
    let settings = surface_flow_settings(flow, time, cache_bytes);
    match last {
        Some(last) if last.is_of(solid, &settings) => last.clone(),
        _ => last.insert(Arc::new(SurfaceFlow::new(solid.clone(), settings))).clone(),
    }
}

fn surface_flow_settings(flow: &settings::SurfaceFlow, time: f64, cache_bytes: u64) -> SurfaceFlowSettings {
    let keys = flow.keys.iter().map(|key| {
        let steps = key.steps.or(flow.steps).map(f64::from);
        let length = key.length_scale.unwrap_or(flow.length_scale);
        (key.time, FlowState { distance: key.distance, length, steps })
    });
    let own = FlowState {
        distance: flow.distance + flow.speed * time,
        length: flow.length_scale,
        steps: flow.steps.map(f64::from),
    };
    let FlowState { distance, length, steps } = match flow.keys.as_slice() {
        [] => own,
        _ => Keys::new(keys.collect(), interpolation(flow.interpolation), false).at(time),
    };
    // So many to a swirl.
    let own_steps = (16.0 * distance.abs() / length).ceil().clamp(16.0, 4096.0) as u32;
    let trace = Trace {
        steps: steps.map_or(own_steps, |steps| steps.round() as u32),
        integrator: match flow.integrator {
            settings::SurfaceIntegrator::Euler => Integrator::Euler,
            settings::SurfaceIntegrator::Rk4 => Integrator::RungeKutta,
        },
        reprojection: Reprojection::Newton(Repetition { steps: flow.reprojections, tolerance: 0.0 }),
    };
    let spacing = flow.cache_spacing.unwrap_or(length / 160.0);
    let cache = (spacing > 0.0).then_some(CacheSettings { spacing, bytes: cache_bytes });
    SurfaceFlowSettings { length, distance, trace, seed: Seed(flow.seed), cache }
}
