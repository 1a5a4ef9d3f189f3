//! Rigid bodies from glTF 2.0 files: the triangles of nodes, and how the hierarchy of nodes moves them.
//!
//! Read are `.glb` and `.gltf` with buffers in files beside it: triangles with their normals, and animations of translation,
//! rotation and scale that are linear or in steps. What would come out wrong without it is refused by name: skins, morph targets,
//! cubic splines, compressed or quantised meshes, anything but triangles, scales along one axis of what moves. Materials, cameras,
//! lights and textures are the scene's business and passed over. The library parses; accessors are read here, within their bounds,
//! as its own reader trusts files.

use crate::geometry::mesh_file::Complaint;
use crate::geometry::motion::Link;
use crate::math::keys::{Interpolation, Keys, Turn};
use glam::{DMat3, DMat4, DQuat, DVec3, Vec3};
use gltf::accessor::{DataType, Dimensions};
use gltf::animation::{Interpolation as GltfInterpolation, Property};
use std::path::{Path, PathBuf};

/// How much single precision may make scales along axes differ that are the same.
const SCALE_SLACK: f64 = 1e-4;

/// A body as a file has it.
pub struct GltfBody {
    /// In the space of the innermost of `links` [m].
    pub positions: Vec<Vec3>,
    /// As many as positions, or none.
    pub normals: Vec<Vec3>,
    /// Indices of positions.
    pub triangles: Vec<[u32; 3]>,
    /// The spaces that it is in, the outermost first; none where it does not move.
    pub links: Vec<Link>,
}

type Fault<T> = Result<T, Complaint>;

fn fault<T>(reason: impl Into<String>) -> Fault<T> {
    Err(Complaint::new(None, reason))
}

/// The files beside a .gltf file that hold its buffers; none of what cannot be read, which reading it tells.
pub fn buffer_files(path: &Path) -> Vec<PathBuf> {
    let document = std::fs::read(path).ok().and_then(|bytes| gltf::Gltf::from_slice(&bytes).ok());
    let uris = document.iter().flat_map(|document| document.buffers()).filter_map(|buffer| match buffer.source() {
        gltf::buffer::Source::Uri(uri) if !uri.starts_with("data:") => Some(beside(path, uri)),
        _ => None,
    });
    uris.collect()
}

fn beside(path: &Path, uri: &str) -> PathBuf {
    path.parent().unwrap_or(Path::new("")).join(uri.replace("%20", " "))
}

/// Reads the content of a file that is at `path`: all nodes with triangles, or `node` and what is below it. Nothing that needs more
/// than `memory_limit` bytes is started.
pub(in crate::geometry) fn parse_gltf(
    bytes: &[u8],
    path: &Path,
    node: Option<&str>,
    memory_limit: u64,
) -> Fault<GltfBody> {
    let gltf::Gltf { document, blob } =
        gltf::Gltf::from_slice(bytes).map_err(|e| Complaint::new(None, e.to_string()))?;
    if let Some(extension) = document.extensions_required().next() {
        return fault(format!("needs the extension {extension}, which is not read; export it without"));
    }
    let file = File { buffers: buffers(&document, blob, path, memory_limit)?, document: &document };
    let tree = NodeTree::of(&document)?;
    let channels = file.channels()?;
    let chosen = tree.chosen(&document, node)?;
    let mut carrier: Option<(Option<usize>, String)> = None;
    let mut body = GltfBody { positions: Vec::new(), normals: Vec::new(), triangles: Vec::new(), links: Vec::new() };
    let (mut needed, mut bare) = (0u64, false);
    for at in chosen {
        let node = tree.node(&document, at)?;
        let Some(mesh) = node.mesh() else { continue };
        let name = called(&node);
        if node.skin().is_some() {
            return fault(format!("{name} is bent by a skin, which is not read; bake it to a mesh"));
        }
        let chain = tree.chain(at);
        let moving = chain.iter().rposition(|at| channels.iter().any(|channel| channel.node == *at));
        let own = moving.map(|i| chain[i]);
        match &carrier {
            Some((other, first)) if *other != own => {
                return fault(format!("{first} and {name} move apart; choose one of them with `node`"));
            }
            Some(_) => {}
            None => {
                carrier = Some((own, name.clone()));
                let moved = &chain[..moving.map_or(0, |i| i + 1)];
                body.links =
                    moved.iter().map(|at| link(&tree.node(&document, *at)?, *at, &channels)).collect::<Fault<_>>()?;
            }
        }
        // What is inside of the last that moves stands still in it.
        let still = &chain[moving.map_or(0, |i| i + 1)..];
        let matrices = still.iter().map(|at| Ok(matrix(&tree.node(&document, *at)?)));
        let placed = matrices.collect::<Fault<Vec<_>>>()?.into_iter().fold(DMat4::IDENTITY, |all, own| all * own);
        for primitive in mesh.primitives() {
            bare |= file.add(&primitive, &placed, &name, &mut body, &mut needed, memory_limit)?;
        }
    }
    if bare {
        // Normals for some of the triangles alone are none.
        body.normals.clear();
    }
    Ok(body)
}

fn called(node: &gltf::Node) -> String {
    node.name().map_or_else(|| format!("node {}", node.index()), |name| format!("the node `{name}`"))
}

fn matrix(node: &gltf::Node) -> DMat4 {
    DMat4::from_cols_array_2d(&node.transform().matrix().map(|column| column.map(f64::from)))
}

fn buffers(document: &gltf::Document, blob: Option<Vec<u8>>, path: &Path, memory_limit: u64) -> Fault<Vec<Vec<u8>>> {
    let mut blob = blob;
    let mut left = memory_limit;
    let mut all = Vec::new();
    for buffer in document.buffers() {
        let bytes = match buffer.source() {
            gltf::buffer::Source::Bin => blob.take().unwrap_or_default(),
            gltf::buffer::Source::Uri(uri) if uri.starts_with("data:") => {
                return fault("has a buffer inside of its text (data:), which is not read; save it as .glb");
            }
            gltf::buffer::Source::Uri(uri) => {
                let file = beside(path, uri);
                let unreadable = |e: std::io::Error| Complaint::new(None, format!("{}: {e}", file.display()));
                let size = std::fs::metadata(&file).map_err(unreadable)?.len();
                if size > left {
                    return fault(format!("{}: {size} bytes are more than the limit of memory leaves", file.display()));
                }
                std::fs::read(&file).map_err(unreadable)?
            }
        };
        if bytes.len() < buffer.length() {
            let (found, index) = (bytes.len(), buffer.index());
            return fault(format!("buffer {index} has {found} bytes, {} are announced", buffer.length()));
        }
        left = left.saturating_sub(bytes.len() as u64);
        all.push(bytes);
    }
    Ok(all)
}

/// Who is inside of whom.
struct NodeTree {
    parents: Vec<Option<usize>>,
}

impl NodeTree {
    fn of(document: &gltf::Document) -> Fault<Self> {
        let mut parents = vec![None; document.nodes().len()];
        for node in document.nodes() {
            for child in node.children() {
                if parents[child.index()].replace(node.index()).is_some() {
                    return fault(format!("{} is inside of two nodes", called(&child)));
                }
            }
        }
        let tree = Self { parents };
        // A way up that does not end goes round.
        match (0..tree.parents.len()).find(|&at| tree.ancestors(at).count() > tree.parents.len()) {
            Some(at) => fault(format!("node {at} is inside of itself")),
            None => Ok(tree),
        }
    }

    /// A node and those that it is inside of, as many as there are nodes and one more where they go round.
    fn ancestors(&self, at: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(at), |at| self.parents[*at]).take(self.parents.len() + 1)
    }

    /// The nodes that one is inside of, the outermost first, and itself.
    fn chain(&self, at: usize) -> Vec<usize> {
        let mut chain: Vec<usize> = self.ancestors(at).collect();
        chain.reverse();
        chain
    }

    fn node<'a>(&self, document: &'a gltf::Document, at: usize) -> Fault<gltf::Node<'a>> {
        document.nodes().nth(at).ok_or_else(|| Complaint::new(None, format!("there is no node {at}")))
    }

    /// The nodes to look for triangles in: of the default scene, or one by name and what is inside of it.
    fn chosen(&self, document: &gltf::Document, name: Option<&str>) -> Fault<Vec<usize>> {
        let tops: Vec<usize> = match name {
            Some(name) => {
                let tops: Vec<usize> =
                    document.nodes().filter(|node| node.name() == Some(name)).map(|node| node.index()).collect();
                if tops.is_empty() {
                    let names: Vec<&str> = document.nodes().filter_map(|node| node.name()).take(20).collect();
                    return fault(format!("has no node `{name}`; there are: {}", names.join(", ")));
                }
                tops
            }
            None => match document.default_scene().or_else(|| document.scenes().next()) {
                Some(scene) => scene.nodes().map(|node| node.index()).collect(),
                None => (0..self.parents.len()).filter(|&at| self.parents[at].is_none()).collect(),
            },
        };
        Ok((0..self.parents.len()).filter(|&at| self.ancestors(at).any(|above| tops.contains(&above))).collect())
    }
}

/// What animates a property of a node.
struct Channel {
    node: usize,
    course: Course,
}

enum Course {
    Translation(Keys<DVec3>),
    Rotation(Keys<Turn>),
    Scale(Keys<f64>),
}

/// The space of a node over time.
fn link(node: &gltf::Node, at: usize, channels: &[Channel]) -> Fault<Link> {
    let (translation, rotation, scale) = node.transform().decomposed();
    let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
    let own = matrix(node);
    let rebuilt = DMat4::from_scale_rotation_translation(
        vector(scale),
        DQuat::from_array(rotation.map(f64::from)),
        vector(translation),
    );
    let mut link = Link {
        translation: Keys::constant(vector(translation)),
        turn: Keys::constant(Turn::Quaternion(DQuat::from_array(rotation.map(f64::from)).normalize())),
        scale: Keys::constant(1.0),
    };
    let mut scales = false;
    for channel in channels.iter().filter(|channel| channel.node == at) {
        match &channel.course {
            Course::Translation(keys) => link.translation = keys.clone(),
            Course::Rotation(keys) => link.turn = keys.clone(),
            Course::Scale(keys) => (link.scale, scales) = (keys.clone(), true),
        }
    }
    if !scales {
        if !own.abs_diff_eq(rebuilt, SCALE_SLACK * (1.0 + own.to_scale_rotation_translation().0.length())) {
            return fault(format!("{} is sheared, and what moves must not be", called(node)));
        }
        link.scale = Keys::constant(even_scale(vector(scale), &called(node))?);
    }
    Ok(link)
}

fn even_scale(scale: DVec3, name: &str) -> Fault<f64> {
    let most = scale.max_element();
    if !(most > 0.0 && scale.is_finite() && scale.min_element() >= most * (1.0 - SCALE_SLACK)) {
        return fault(format!(
            "{name} is scaled by {scale}, and what moves must be scaled by one number above 0; apply its scale"
        ));
    }
    Ok(most)
}

/// A file with its buffers.
struct File<'a> {
    document: &'a gltf::Document,
    buffers: Vec<Vec<u8>>,
}

impl File<'_> {
    /// All animations of the file; they play together.
    fn channels(&self) -> Fault<Vec<Channel>> {
        let mut channels: Vec<Channel> = Vec::new();
        for channel in self.document.animations().flat_map(|animation| animation.channels()) {
            let (target, sampler) = (channel.target(), channel.sampler());
            let (node, name) = (target.node().index(), called(&target.node()));
            let interpolation = match sampler.interpolation() {
                GltfInterpolation::Linear => Interpolation::Linear,
                GltfInterpolation::Step => Interpolation::Step,
                GltfInterpolation::CubicSpline => {
                    return fault(format!(
                        "{name} moves along cubic splines, which are not read; bake them to linear keys"
                    ));
                }
            };
            let times = self.numbers(&sampler.input(), 1)?;
            let rises = times.windows(2).all(|pair| pair[0] < pair[1]) && times.iter().all(|time| time.is_finite());
            if times.is_empty() || !rises {
                return fault(format!("the times of the keys of {name} do not rise"));
            }
            let width = if target.property() == Property::Rotation { 4 } else { 3 };
            if target.property() == Property::MorphTargetWeights {
                return fault(format!(
                    "{name} changes its form by morph targets, which are not read; bake it to a mesh"
                ));
            }
            let values = self.numbers(&sampler.output(), width)?;
            if values.len() != times.len() * width || values.iter().any(|value| !value.is_finite()) {
                return fault(format!("{name} has {} numbers for {} keys of {width}", values.len(), times.len()));
            }
            let keys = || times.iter().copied().zip(values.chunks_exact(width));
            let vector = |v: &[f64]| DVec3::new(v[0], v[1], v[2]);
            let course = match target.property() {
                Property::Translation => {
                    let keys = keys().map(|(time, v)| (time, vector(v)));
                    Course::Translation(Keys::new(keys.collect(), interpolation, false))
                }
                Property::Rotation => {
                    let turn = |v: &[f64]| DQuat::from_xyzw(v[0], v[1], v[2], v[3]);
                    if values.chunks_exact(4).any(|v| turn(v).length() < 1e-6) {
                        return fault(format!("{name} has a quaternion of length 0, which is no turn"));
                    }
                    let keys = keys().map(|(time, v)| (time, Turn::Quaternion(turn(v).normalize())));
                    Course::Rotation(Keys::new(keys.collect(), interpolation, false))
                }
                _ => {
                    let keys = keys().map(|(time, v)| Ok((time, even_scale(vector(v), &name)?)));
                    Course::Scale(Keys::new(keys.collect::<Fault<_>>()?, interpolation, false))
                }
            };
            let is_same = |known: &Channel| {
                known.node == node && std::mem::discriminant(&known.course) == std::mem::discriminant(&course)
            };
            if channels.iter().any(is_same) {
                return fault(format!("two animations move {name}; keep one of them"));
            }
            channels.push(Channel { node, course });
        }
        Ok(channels)
    }

    /// Adds triangles, placed in the space of the body; whether they have no normals.
    fn add(
        &self,
        primitive: &gltf::Primitive,
        placed: &DMat4,
        name: &str,
        body: &mut GltfBody,
        needed: &mut u64,
        memory_limit: u64,
    ) -> Fault<bool> {
        if primitive.mode() != gltf::mesh::Mode::Triangles {
            return fault(format!("{name} is made of {:?}; only plain triangles are read", primitive.mode()));
        }
        if primitive.morph_targets().next().is_some() {
            return fault(format!("{name} has morph targets, which are not read; bake it to a mesh"));
        }
        let Some(positions) = primitive.get(&gltf::Semantic::Positions) else {
            return fault(format!("{name} has no positions"));
        };
        let index_count = primitive.indices().map_or(positions.count(), |indices| indices.count());
        // Doubles while they are read, vectors that grow, and what is made of them.
        *needed = needed.saturating_add(96 * (positions.count() as u64).saturating_add(index_count as u64));
        if *needed > memory_limit {
            return fault(format!("{name} and those before need more than the memory limit of {memory_limit} bytes"));
        }
        let first = body.positions.len() as u32;
        let corners: Vec<u32> = match primitive.indices() {
            Some(indices) => self.numbers(&indices, 1)?.into_iter().map(|i| i as u32).collect(),
            None => (0..positions.count() as u32).collect(),
        };
        let positions = self.numbers(&positions, 3)?;
        let count = positions.len() / 3;
        if let Some(corner) = corners.iter().find(|&&corner| corner as usize >= count) {
            return fault(format!("{name} uses vertex {corner}, but there are only {count} (counting from 0)"));
        }
        let point = |v: &[f64]| placed.transform_point3(DVec3::new(v[0], v[1], v[2])).as_vec3();
        body.positions.extend(positions.chunks_exact(3).map(point));
        // What is mirrored is turned inside out.
        let turned = placed.determinant() < 0.0;
        body.triangles.extend(corners.chunks_exact(3).map(|c| {
            let [a, b, c] = [c[0], c[1], c[2]].map(|corner| first + corner);
            if turned { [a, c, b] } else { [a, b, c] }
        }));
        let Some(normals) = primitive.get(&gltf::Semantic::Normals) else { return Ok(true) };
        let normals = self.numbers(&normals, 3)?;
        if normals.len() != positions.len() {
            return fault(format!("{name} has {} normals for {count} vertices", normals.len() / 3));
        }
        let to_world = DMat3::from_mat4(*placed).inverse().transpose();
        let normal = |v: &[f64]| (to_world * DVec3::new(v[0], v[1], v[2])).normalize_or_zero().as_vec3();
        body.normals.extend(normals.chunks_exact(3).map(normal));
        Ok(false)
    }

    /// The numbers of an accessor of `width` of them an item: floats, whole numbers, or those that stand for shares of 1.
    fn numbers(&self, accessor: &gltf::Accessor, width: usize) -> Fault<Vec<f64>> {
        let index = accessor.index();
        let found = match accessor.dimensions() {
            Dimensions::Scalar => 1,
            Dimensions::Vec3 => 3,
            Dimensions::Vec4 => 4,
            _ => 0,
        };
        if found != width {
            return fault(format!("accessor {index} has items of another size than {width}"));
        }
        if accessor.sparse().is_some() {
            return fault(format!("accessor {index} is sparse, which is not read; export it plain"));
        }
        let Some(view) = accessor.view() else { return fault(format!("accessor {index} has no data")) };
        let kind = accessor.data_type();
        let size = match kind {
            DataType::I8 | DataType::U8 => 1,
            DataType::I16 | DataType::U16 => 2,
            DataType::U32 | DataType::F32 => 4,
        };
        let item = size * width;
        let stride = view.stride().unwrap_or(item);
        let buffer = &self.buffers[view.buffer().index()];
        let outside = || Complaint::new(None, format!("accessor {index} reaches beyond its buffer"));
        let view_end = view.offset().checked_add(view.length()).filter(|end| *end <= buffer.len());
        let view = &buffer[view.offset()..view_end.ok_or_else(outside)?];
        let last = accessor.count().checked_sub(1).and_then(|last| last.checked_mul(stride));
        let end = last.and_then(|last| last.checked_add(accessor.offset())).and_then(|last| last.checked_add(item));
        if accessor.count() > 0 && end.is_none_or(|end| end > view.len()) {
            return Err(outside());
        }
        let is_share = accessor.normalized();
        let share = |value: f64, most: f64| if is_share { (value / most).max(-1.0) } else { value };
        let number = |b: &[u8]| match kind {
            DataType::F32 => f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            DataType::U32 => f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            DataType::U16 => share(f64::from(u16::from_le_bytes([b[0], b[1]])), 65535.0),
            DataType::I16 => share(f64::from(i16::from_le_bytes([b[0], b[1]])), 32767.0),
            DataType::U8 => share(f64::from(b[0]), 255.0),
            DataType::I8 => share(f64::from(b[0] as i8), 127.0),
        };
        let items = (0..accessor.count()).map(|i| &view[accessor.offset() + i * stride..][..item]);
        Ok(items.flat_map(|item| item.chunks_exact(size)).map(number).collect())
    }
}
