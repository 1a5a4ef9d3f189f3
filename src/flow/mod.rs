//! Divergence-free velocity: the curl of potentials that are bent round obstacles.

pub mod bounded;
pub mod curl;
pub mod dfvn;
pub mod elements;
pub mod field;
pub mod flow_noise;
pub mod gauge;
pub mod kind;
pub mod lift;
pub mod mask;
pub mod noise;
pub mod obstacles;
pub mod octaves;
pub mod pair;
pub mod potential;
pub mod ramp;
pub mod reach;
pub mod reproject;
pub mod settle;
pub mod simplex;
pub mod source;
pub mod surface;
pub mod tracks;
pub mod turbulence;
pub mod vortex;
pub mod walls;

use crate::flow::elements::{Column, Shear};
use crate::flow::mask::{Block, Mask, PlacedMask, Wake};
use crate::flow::noise::RMS_SPEED;
use crate::flow::obstacles::{Boundary, Wall, build_obstacles};
use crate::flow::octaves::{Form, OctavesSettings, kolmogorov_gain, octaves};
use crate::flow::pair::{Bound, Pair, Second, Turned};
use crate::flow::reach::reach;
use crate::flow::reproject::{Repetition, Reprojection};
use crate::flow::simplex::Simplex;
use crate::flow::source::{Potential, Source};
use crate::flow::tracks::Tracks;
use crate::flow::vortex::{Vortex, smooth_curve};
use crate::geometry::primitive::{Cuboid, Primitive, Sphere};
use crate::geometry::sdf::PlacedSdf;
use crate::geometry::{Geometry, Shape};
use crate::math::hash::Seed;
use crate::math::lattice::Lattice;
use crate::scene::{Scene, settings};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

pub use crate::flow::field::VelocityField;
pub use crate::flow::kind::Flow;

/// Noise starts with this word in the derivation of its keys.
const NOISE_KEYS: u64 = 0x6E6F_6973;
/// And the noise of masks with this one.
const MASK_KEYS: u64 = 0x6D61_736B;
/// And that of flows along tracks with this one.
const TRACK_KEYS: u64 = 0x7472_6163;

/// Samples of a file that a mask is made of.
#[derive(Debug, Clone)]
pub struct MaskSamples {
    /// Values; of a picture one layer, its lowest row first, and the weights of its colours already applied.
    pub values: Lattice<f32>,
    /// Middle of the first sample of a grid [m].
    pub origin: DVec3,
    /// Distance between the samples of a grid [m].
    pub spacing: f64,
}

/// Reads the files of masks: the flow itself knows no file formats.
pub trait MaskFiles {
    /// Brightness of a picture.
    ///
    /// # Errors
    /// A sentence that names the file and what is wrong.
    fn picture(&self, path: &Path, weights: [f64; 3]) -> Result<MaskSamples, String>;
    /// Values of a grid in a .vdb file.
    ///
    /// # Errors
    /// A sentence that names the file and what is wrong.
    fn grid(&self, path: &Path, name: &str) -> Result<MaskSamples, String>;
}

/// For scenes whose masks need no files.
#[derive(Debug, Clone, Copy)]
pub struct NoFiles;

impl MaskFiles for NoFiles {
    fn picture(&self, path: &Path, _: [f64; 3]) -> Result<MaskSamples, String> {
        Err(format!("{}: no files are read here", path.display()))
    }
    fn grid(&self, path: &Path, _: &str) -> Result<MaskSamples, String> {
        self.picture(path, [0.0; 3])
    }
}

/// Why there is no velocity field.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FlowError {
    /// The file of a mask could not be read.
    #[error("{problem}")]
    MaskFile {
        /// The key that names it.
        key: String,
        /// A sentence that names the file and what is wrong.
        problem: String,
    },
    /// Two containers have no place in common.
    #[error(
        "the containers `{a}` and `{b}` have no place in common, and the flow must be inside all of them; keep one"
    )]
    Apart {
        /// The one.
        a: String,
        /// The other.
        b: String,
    },
}

impl FlowError {
    /// The key of the scene that it is about.
    pub fn key(&self) -> &str {
        match self {
            Self::MaskFile { key, .. } => key,
            Self::Apart { .. } => "flow.containers",
        }
    }
}

struct Builder<'a> {
    scene: &'a Scene,
    geometry: &'a Geometry,
    files: &'a dyn MaskFiles,
}

impl Flow {
    /// The flow of a scene.
    ///
    /// # Errors
    /// Where the file of a mask cannot be read.
    pub fn build(scene: &Scene, geometry: &Geometry, files: &dyn MaskFiles) -> Result<Self, FlowError> {
        match &scene.settings.flow.dfvn {
            Some(dfvn) => Ok(Self::Tracks(Builder { scene, geometry, files }.tracks(dfvn))),
            None => Ok(Self::Curl(VelocityField::build(scene, geometry, files)?)),
        }
    }
}

impl VelocityField {
    /// The curl of a scene's potentials.
    ///
    /// # Errors
    /// Where the file of a mask cannot be read.
    pub fn build(scene: &Scene, geometry: &Geometry, files: &dyn MaskFiles) -> Result<Self, FlowError> {
        let builder = Builder { scene, geometry, files };
        let seed = Seed(scene.settings.smoke_seed()).derive(NOISE_KEYS);
        let mut sources = Vec::new();
        // Terms of the same seed differ by their order among themselves: what stands between them changes no pattern.
        let mut twins: BTreeMap<u64, u64> = BTreeMap::new();
        for (i, potential) in scene.settings.flow.potentials.iter().enumerate() {
            let mut own = seed;
            if let settings::Potential::Noise(noise) = potential {
                let twin = twins.entry(noise.seed).or_default();
                own = seed.derive(*twin);
                *twin += 1;
            }
            let key = format!("flow.potentials[{i}].{}", potential.name());
            sources.extend(builder.sources(potential, &key, own)?);
        }
        builder.check_containers()?;
        let field = Self::new(sources, build_obstacles(builder.walls()));
        Ok(match scene.settings.flow.planar {
            Some(normal) => field.planar(DVec3::from_array(normal).normalize()),
            None => field,
        })
    }
}

impl Builder<'_> {
    fn shape(&self, name: &str) -> Option<&Shape> {
        self.geometry.shapes.iter().find(|shape| shape.name == name)
    }

    fn tracks(&self, dfvn: &settings::Dfvn) -> Tracks {
        let seed = Seed(self.scene.settings.smoke_seed()).derive(TRACK_KEYS).derive(dfvn.seed);
        let noise = |i| Simplex::new(dfvn.length_scale, seed.derive(i));
        // A mesh has no distance where a scene is only looked at.
        let solid = |name: &Option<String>| self.shape(name.as_deref()?)?.sdf.clone();
        let second = solid(&dfvn.along).map_or_else(|| Second::Noise(Turned::new(noise(1))), Second::Distance);
        let bound = solid(&dfvn.inside)
            .map(|solid| Bound { width: dfvn.margin.unwrap_or(dfvn.length_scale.min(reach(&solid, true))), solid });
        let repetition = Repetition { steps: dfvn.reprojections, tolerance: 0.0 };
        let reprojection = match dfvn.reprojection {
            settings::ReprojectionKind::LeastNorm => Reprojection::LeastNorm(repetition),
            settings::ReprojectionKind::Newton => Reprojection::Newton(repetition),
        };
        let walls = VelocityField::new(Vec::new(), build_obstacles(self.walls()));
        Tracks::new(Pair::new(noise(0), second, bound), dfvn.speed, reprojection, walls)
    }

    fn walls(&self) -> Vec<Wall> {
        let flow = &self.scene.settings.flow;
        let named = flow.obstacles.iter().map(|name| (name, false)).chain(flow.holders().map(|n| (n, true)));
        named
            .filter_map(|(name, is_container)| {
                let shape = self.shape(name)?;
                let is_fast = flow.no_slip.contains(name);
                Some(Wall {
                    sdf: shape.sdf.clone()?,
                    motion: shape.motion.clone(),
                    boundary: if is_fast { Boundary::NoSlip } else { Boundary::Slip },
                    is_container,
                })
            })
            .collect()
    }

    /// An error where the flow would have to be inside two solids that have no place in common.
    fn check_containers(&self) -> Result<(), FlowError> {
        // Those that move may come together.
        let resting = self.scene.settings.flow.containers.iter().filter_map(|name| Some((name, self.shape(name)?)));
        let resting = resting.filter(|(_, shape)| shape.motion.is_none());
        let boxes: Vec<_> = resting.filter_map(|(name, shape)| Some((name, shape.sdf.as_ref()?.bounds()?))).collect();
        for (i, (b, of_b)) in boxes.iter().enumerate() {
            for (a, of_a) in &boxes[..i] {
                if of_a.min.cmpgt(of_b.max).any() || of_b.min.cmpgt(of_a.max).any() {
                    return Err(FlowError::Apart { a: a.to_string(), b: b.to_string() });
                }
            }
        }
        Ok(())
    }

    fn sources(&self, potential: &settings::Potential, key: &str, seed: Seed) -> Result<Vec<Source>, FlowError> {
        let v = DVec3::from_array;
        let (potentials, influence, modulate) = match potential {
            settings::Potential::Uniform(u) => {
                let wind = Potential::Uniform { velocity: v(u.velocity), origin: v(u.origin) };
                (vec![wind], u.influence_radius, &u.modulate)
            }
            settings::Potential::Shear(s) => {
                let shear = Shear::new(v(s.direction), v(s.across), s.rate, v(s.origin));
                (vec![Potential::Shear(shear)], s.influence_radius, &s.modulate)
            }
            settings::Potential::Rigid(r) => {
                let (velocity, angular_velocity, center) = (v(r.velocity), v(r.angular_velocity), v(r.center));
                (vec![Potential::Rigid { velocity, angular_velocity, center }], r.influence_radius, &r.modulate)
            }
            settings::Potential::Plume(p) => {
                let column = Column {
                    base: v(p.base),
                    axis: v(p.axis).normalize(),
                    radius: p.radius,
                    speed: p.speed,
                    rise: p.rise.unwrap_or(2.0 * p.radius),
                };
                (vec![Potential::Column(column)], p.influence_radius, &p.modulate)
            }
            settings::Potential::Noise(n) => {
                // In a flow in two dimensions all noise is.
                let planar = n.planar.or(self.scene.settings.flow.planar);
                let all = octaves(&octaves_settings(&settings::Noise { planar, ..n.clone() }, seed))
                    .into_iter()
                    .map(Potential::Octave)
                    .collect();
                (all, None, &n.modulate)
            }
            settings::Potential::Vortex(w) => {
                let vortex = Vortex::about_point(v(w.center), v(w.angular_velocity), w.radius, v(w.velocity));
                (vec![Potential::Vortex(vortex)], None, &w.modulate)
            }
            settings::Potential::VortexRing(r) => {
                let ring = Vortex::along_circle(v(r.center), v(r.axis), r.radius, r.core, r.speed, v(r.velocity));
                (vec![Potential::Vortex(ring)], None, &r.modulate)
            }
            settings::Potential::VortexCurve(c) => (vec![Potential::Vortex(curve(c))], None, &c.modulate),
        };
        let masks = modulate.iter().enumerate();
        let masks = masks.map(|(j, mask)| self.placed_mask(mask, &format!("{key}.modulate[{j}]")));
        let masks = masks.collect::<Result<Vec<_>, _>>()?;
        Ok(potentials.into_iter().map(|potential| Source { potential, masks: masks.clone(), influence }).collect())
    }

    fn placed_mask(&self, mask: &settings::Mask, key: &str) -> Result<PlacedMask, FlowError> {
        let shape = match mask {
            settings::Mask::Shape(m) => self.shape(&m.name),
            settings::Mask::Wake(m) => self.shape(&m.shape),
            _ => None,
        };
        let motion = shape.and_then(|shape| Some((shape.motion.clone()?, shape.sdf.as_ref()?.center().0.as_dvec3())));
        Ok(PlacedMask { mask: self.mask(mask, key)?, motion })
    }

    fn mask(&self, mask: &settings::Mask, key: &str) -> Result<Mask, FlowError> {
        let v = DVec3::from_array;
        let fail = |kind: &str, problem| FlowError::MaskFile { key: format!("{key}.{kind}.file"), problem };
        // Validation has found all names; of a scene without it, a mask of no shape is 1 everywhere.
        let everywhere = Mask::Height { axis: DVec3::ZERO, from: -1.0, to: 0.0 };
        Ok(match mask {
            settings::Mask::Height(m) => Mask::Height { axis: v(m.axis).normalize(), from: m.from, to: m.to },
            settings::Mask::Shape(m) => match self.shape(&m.name).and_then(|shape| shape.sdf.clone()) {
                Some(sdf) => Mask::Shape { sdf, from: m.from, to: m.to },
                None => everywhere,
            },
            settings::Mask::Sphere(m) => {
                let solid = Primitive::Sphere(Sphere { center: v(m.center), radius: m.radius });
                Mask::solid(solid, m.from, m.to)
            }
            settings::Mask::Box(m) => {
                let solid =
                    Primitive::Cuboid(Cuboid { center: v(m.center), half_size: 0.5 * v(m.size), rounding: 0.0 });
                Mask::solid(solid, m.from, m.to)
            }
            settings::Mask::Wake(m) => match self.shape(&m.shape).and_then(|shape| shape.sdf.as_ref()) {
                Some(sdf) => Mask::Wake(Wake {
                    center: sdf.center().0.as_dvec3(),
                    radius: m.radius.unwrap_or_else(|| girth(sdf)),
                    direction: v(m.direction).normalize(),
                    length: m.length,
                    spread: m.spread,
                }),
                None => everywhere,
            },
            settings::Mask::Noise(m) => {
                let seed = Seed(self.scene.settings.smoke_seed()).derive(MASK_KEYS).derive(m.seed);
                let speed = RMS_SPEED / m.length_scale;
                let settings =
                    OctavesSettings { length_scale: m.length_scale, speed, octaves: 1, seed, ..Default::default() };
                Mask::noise(&octaves(&settings)[0], m.low, m.high)
            }
            settings::Mask::Image(m) => {
                let path = self.scene.resolve(&m.file);
                let samples = self.files.picture(&path, m.weights).map_err(|e| fail("image", e))?.values;
                let (half_u, half_v) = (v(m.half_u), v(m.half_v));
                let count = samples.dims().as_dvec3();
                // From −1 … 1 along both edges to the middles of pixels.
                let rows = [
                    half_u * (0.5 * count.x / half_u.length_squared()),
                    half_v * (0.5 * count.y / half_v.length_squared()),
                    DVec3::ZERO,
                ];
                let to_lattice = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
                let offset = 0.5 * (count - 1.0).with_z(0.0) - to_lattice * v(m.center);
                Mask::Block(Arc::new(Block::flat(&samples, to_lattice, offset)))
            }
            settings::Mask::Grid(m) => {
                let path = self.scene.resolve(&m.file);
                let mut samples = self.files.grid(&path, &m.grid).map_err(|e| fail("grid", e))?;
                samples.values.values_mut().iter_mut().for_each(|x| *x *= m.scale as f32);
                let inverse = 1.0 / samples.spacing;
                let to_lattice = DMat3::from_diagonal(DVec3::splat(inverse));
                Mask::Block(Arc::new(Block::new(&samples.values, to_lattice, -samples.origin * inverse)))
            }
        })
    }
}

/// Half the middle extent of a solid's box [m]; 1 where it has no end.
fn girth(sdf: &PlacedSdf) -> f64 {
    let Some(bounds) = sdf.bounds() else { return 1.0 };
    let mut half = (0.5 * bounds.size().as_dvec3()).to_array();
    half.sort_by(f64::total_cmp);
    half[1]
}

fn curve(settings: &settings::VortexCurve) -> Vortex {
    let mut points: Vec<DVec3> = settings.points.iter().map(|p| DVec3::from_array(*p)).collect();
    if settings.smooth {
        points = smooth_curve(&points, settings.closed, 0.25 * settings.core);
    } else if settings.closed {
        points.push(points[0]);
    }
    Vortex::along_line(&points, settings.core, settings.speed, DVec3::from_array(settings.velocity))
}

fn octaves_settings(n: &settings::Noise, seed: Seed) -> OctavesSettings {
    OctavesSettings {
        length_scale: n.length_scale,
        speed: n.speed,
        octaves: n.octaves,
        lacunarity: n.lacunarity,
        gain: match n.gain {
            settings::Gain::Kolmogorov => kolmogorov_gain(n.lacunarity),
            settings::Gain::Speed(factor) => factor,
        },
        spin_rate: n.spin_rate,
        evolve_rate: n.evolve_rate,
        form: match (n.planar, n.form) {
            (Some(normal), _) => Form::Planar(DVec3::from_array(normal)),
            (None, settings::NoiseForm::Curl) => Form::Curl,
            (None, settings::NoiseForm::Bitangent) => Form::Bitangent,
        },
        memory: n.memory,
        offset: n.offset,
        scroll: n.scroll,
        seed: seed.derive(n.seed),
    }
}
