//! Rigid bodies from glTF 2.0 files: the triangles of nodes, and how the hierarchy of nodes moves them.
//!
//! Read are `.glb` and `.gltf` with buffers in files beside it: triangles with their normals, and animations of translation,
//! rotation and scale that are linear or in steps. What would come out wrong without it is refused by name: skins, morph targets,
//! cubic splines, compressed or quantised meshes, anything but triangles, scales along one axis of what moves. Materials, cameras,
//! lights and textures are the scene's business and passed over. The library parses; accessors are read here, within their bounds,
//! as its own reader trusts files.

use crate::geometry::mesh_file::{Complaint, read_bytes};
use crate::geometry::motion::Link;
use crate::math::keys::{Interpolation, Keys, Turn};
use glam::{DMat3, DMat4, DQuat, DVec3, Vec3};
use gltf::accessor::{DataType, Dimensions};
use gltf::animation::{Interpolation as GltfInterpolation, Property};
use gltf::json::{Root, validation::Checked};
use std::cell::Cell;
use std::collections::HashSet;
use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// How much single precision may make scales along axes differ that are the same.
const SCALE_SLACK: f64 = 1e-4;

/// Memory that each number of an accessor takes at the worst [bytes]: a double in a vector that grows, and what is made of it.
const MEMORY_PER_NUMBER: u64 = 32;

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

/// The files beside a .glb or .gltf file that hold its buffers; none of what cannot be read within `memory_limit` bytes, which
/// reading it tells.
pub fn buffer_files(path: &Path, memory_limit: u64) -> Vec<PathBuf> {
    let root = read_bytes(path, memory_limit).ok().and_then(|bytes| unchecked(&bytes).ok());
    let uris = root.iter().flat_map(|(root, _)| &root.buffers).filter_map(|buffer| buffer.uri.as_deref());
    uris.filter(|uri| !uri.starts_with("data:")).map(|uri| beside(path, uri)).collect()
}

/// Whether the name of a file says that it is one of those that are read here.
pub fn is_gltf(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf"))
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
    // The library trusts much of what is in files. All of it that is known is checked before; this is for the rest.
    catch_unwind(AssertUnwindSafe(|| parse(bytes, path, node, memory_limit)))
        .unwrap_or_else(|_| fault("the library that reads glTF fails at this file, which is malformed; export it anew"))
}

fn parse(bytes: &[u8], path: &Path, node: Option<&str>, memory_limit: u64) -> Fault<GltfBody> {
    let (document, blob) = checked_document(bytes)?;
    if let Some(extension) = document.extensions_required().next() {
        return fault(format!("needs the extension {extension}, which is not read; export it without"));
    }
    let (buffers, left) = buffers(&document, blob, path, memory_limit)?;
    let file = File { buffers, document: &document, left: Cell::new(left), memory_limit };
    let tree = NodeTree::of(&document)?;
    let channels = file.channels()?;
    let is_chosen = tree.chosen(&document, node)?;
    let carried = tree.carried(&document, &channels)?;
    let mut carrier: Option<(Option<usize>, String)> = None;
    let mut body = GltfBody { positions: Vec::new(), normals: Vec::new(), triangles: Vec::new(), links: Vec::new() };
    let mut bare = false;
    for at in (0..is_chosen.len()).filter(|&at| is_chosen[at]) {
        let node = tree.node(&document, at)?;
        let Some(mesh) = node.mesh() else { continue };
        let name = called(&node);
        if node.skin().is_some() {
            return fault(format!("{name} is bent by a skin, which is not read; bake it to a mesh"));
        }
        let Carried { by, placed } = &carried[at];
        match &carrier {
            Some((other, first)) if other != by => {
                return fault(format!("{first} and {name} move apart; choose one of them with `node`"));
            }
            Some(_) => {}
            None => {
                carrier = Some((*by, name.clone()));
                let moved = by.map_or(Vec::new(), |by| tree.chain(by));
                body.links =
                    moved.iter().map(|at| link(&tree.node(&document, *at)?, &channels[*at])).collect::<Fault<_>>()?;
            }
        }
        for primitive in mesh.primitives() {
            bare |= file.add(&primitive, placed, &name, &mut body)?;
        }
    }
    if bare {
        // Normals for some of the triangles alone are none.
        body.normals.clear();
    }
    Ok(body)
}

/// What a file says, be it so or not, and the buffer inside of it.
fn unchecked(bytes: &[u8]) -> Fault<(Root, Option<Vec<u8>>)> {
    // The library takes the length of the head from that of the whole.
    if bytes.starts_with(b"glTF") && bytes.get(8..12).is_some_and(|length| length[0] < 12 && length[1..] == [0; 3]) {
        return fault("says that it is shorter than its own head; export it anew");
    }
    let gltf = gltf::Gltf::from_slice_without_validation(bytes).map_err(|e| Complaint::new(None, e.to_string()))?;
    Ok((gltf.document.into_json(), gltf.blob))
}

/// What a file says, and the buffer inside of it, where all that the library looks up without asking is there.
fn checked_document(bytes: &[u8]) -> Fault<(gltf::Document, Option<Vec<u8>>)> {
    let (root, blob) = unchecked(bytes)?;
    for (i, mesh) in root.meshes.iter().enumerate() {
        let attributes = mesh.primitives.iter().flat_map(|primitive| primitive.attributes.values());
        if let Some(index) = attributes.map(|index| index.value()).find(|index| *index >= root.accessors.len()) {
            let count = root.accessors.len();
            return fault(format!("mesh {i} asks for accessor {index}, of {count} (counting from 0); export it anew"));
        }
    }
    for (i, animation) in root.animations.iter().enumerate() {
        for channel in &animation.channels {
            let (node, count) = (channel.target.node.value(), root.nodes.len());
            if node >= count {
                return fault(format!("animation {i} moves node {node}, of {count} (counting from 0); export it anew"));
            }
            if matches!(channel.target.path, Checked::Invalid) {
                return fault(format!(
                    "animation {i} moves what no node has; known are translation, rotation and scale"
                ));
            }
        }
    }
    let document = gltf::Document::from_json(root).map_err(|e| Complaint::new(None, e.to_string()))?;
    Ok((document, blob))
}

fn called(node: &gltf::Node) -> String {
    node.name().map_or_else(|| format!("node {}", node.index()), |name| format!("the node `{name}`"))
}

fn matrix(node: &gltf::Node) -> DMat4 {
    DMat4::from_cols_array_2d(&node.transform().matrix().map(|column| column.map(f64::from)))
}

/// All buffers, and how much of the memory they leave [bytes].
fn buffers(
    document: &gltf::Document,
    blob: Option<Vec<u8>>,
    path: &Path,
    memory_limit: u64,
) -> Fault<(Vec<Vec<u8>>, u64)> {
    let mut blob = blob;
    let mut left = memory_limit;
    let mut all = Vec::new();
    for buffer in document.buffers() {
        let bytes = match buffer.source() {
            gltf::buffer::Source::Bin => blob.take().unwrap_or_default(),
            gltf::buffer::Source::Uri(uri) if uri.starts_with("data:") => {
                return fault("has a buffer inside of its text (data:), which is not read; save it as .glb");
            }
            gltf::buffer::Source::Uri(uri) => read_buffer(&beside(path, uri), left)?,
        };
        if bytes.len() < buffer.length() {
            let (found, index) = (bytes.len(), buffer.index());
            return fault(format!("buffer {index} has {found} bytes, {} are announced", buffer.length()));
        }
        left = left.saturating_sub(bytes.len() as u64);
        all.push(bytes);
    }
    Ok((all, left))
}

/// A file of at most `left` bytes.
fn read_buffer(file: &Path, left: u64) -> Fault<Vec<u8>> {
    let unreadable = |e: std::io::Error| Complaint::new(None, format!("{}: {e}", file.display()));
    let data = std::fs::metadata(file).map_err(unreadable)?;
    // To open a pipe waits for its other end, and devices may have no end.
    if !data.is_file() {
        return fault(format!("{}: it is no regular file", file.display()));
    }
    let mut bytes = Vec::new();
    if data.len() <= left {
        let file = std::fs::File::open(file).map_err(unreadable)?;
        file.take(left.saturating_add(1)).read_to_end(&mut bytes).map_err(unreadable)?;
    }
    let size = data.len().max(bytes.len() as u64);
    if size > left {
        return fault(format!(
            "{}: {size} bytes are more than the {left} that the limit of memory leaves",
            file.display()
        ));
    }
    Ok(bytes)
}

/// Who is inside of whom.
struct NodeTree {
    parents: Vec<Option<usize>>,
    /// All nodes, each after the one that it is inside of.
    order: Vec<usize>,
}

/// How a node is in the space of what moves it.
struct Carried {
    /// The innermost node that moves and is it or around it.
    by: Option<usize>,
    /// Where it is in that node's space.
    placed: DMat4,
}

impl NodeTree {
    fn of(document: &gltf::Document) -> Fault<Self> {
        let count = document.nodes().len();
        let mut tree = Self { parents: vec![None; count], order: Vec::with_capacity(count) };
        for node in document.nodes() {
            for child in node.children() {
                if tree.parents[child.index()].replace(node.index()).is_some() {
                    return fault(format!("{} is inside of two nodes", called(&child)));
                }
            }
        }
        tree.order.extend((0..count).filter(|&at| tree.parents[at].is_none()));
        let mut is_reached = vec![false; count];
        let mut next = 0;
        while let Some(&at) = tree.order.get(next) {
            is_reached[at] = true;
            tree.order.extend(tree.node(document, at)?.children().map(|child| child.index()));
            next += 1;
        }
        // What no way down leads to goes round, or is inside of what does.
        match is_reached.iter().position(|is_reached| !is_reached) {
            Some(at) => fault(format!("node {at}, or one that it is in, is inside of itself")),
            None => Ok(tree),
        }
    }

    /// The nodes that one is inside of, the outermost first, and itself.
    fn chain(&self, at: usize) -> Vec<usize> {
        let mut chain: Vec<usize> = std::iter::successors(Some(at), |at| self.parents[*at]).collect();
        chain.reverse();
        chain
    }

    fn node<'a>(&self, document: &'a gltf::Document, at: usize) -> Fault<gltf::Node<'a>> {
        document.nodes().nth(at).ok_or_else(|| Complaint::new(None, format!("there is no node {at}")))
    }

    /// Of each node whether to look for triangles in it: those of the default scene, or one by name and what is inside of it.
    fn chosen(&self, document: &gltf::Document, name: Option<&str>) -> Fault<Vec<bool>> {
        let mut is_chosen = vec![false; self.parents.len()];
        match name {
            Some(name) => {
                for node in document.nodes().filter(|node| node.name() == Some(name)) {
                    is_chosen[node.index()] = true;
                }
                if !is_chosen.contains(&true) {
                    let names: Vec<&str> = document.nodes().filter_map(|node| node.name()).take(20).collect();
                    return fault(format!("has no node `{name}`; there are: {}", names.join(", ")));
                }
            }
            None => match document.default_scene().or_else(|| document.scenes().next()) {
                Some(scene) => scene.nodes().for_each(|node| is_chosen[node.index()] = true),
                None => is_chosen.fill(true),
            },
        }
        for &at in &self.order {
            is_chosen[at] |= self.parents[at].is_some_and(|parent| is_chosen[parent]);
        }
        Ok(is_chosen)
    }

    /// What carries each node; `channels` are those of each.
    fn carried(&self, document: &gltf::Document, channels: &[Vec<Course>]) -> Fault<Vec<Carried>> {
        let mut carried: Vec<Carried> =
            self.parents.iter().map(|_| Carried { by: None, placed: DMat4::IDENTITY }).collect();
        for &at in &self.order {
            // What is inside of the last that moves stands still in it.
            if !channels[at].is_empty() {
                carried[at].by = Some(at);
                continue;
            }
            let own = matrix(&self.node(document, at)?);
            let (by, outer) = self.parents[at].map_or((None, DMat4::IDENTITY), |p| (carried[p].by, carried[p].placed));
            carried[at] = Carried { by, placed: outer * own };
        }
        Ok(carried)
    }
}

/// What animates a property of a node.
enum Course {
    Translation(Keys<DVec3>),
    Rotation(Keys<Turn>),
    Scale(Keys<f64>),
}

/// The space of a node over time.
fn link(node: &gltf::Node, channels: &[Course]) -> Fault<Link> {
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
    for course in channels {
        match course {
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
    /// Memory that is left for what is read from them [bytes].
    left: Cell<u64>,
    memory_limit: u64,
}

impl File<'_> {
    /// Takes of the memory what `count` numbers need.
    fn reserve(&self, count: u64) -> Fault<()> {
        let Some(left) = self.left.get().checked_sub(count.saturating_mul(MEMORY_PER_NUMBER)) else {
            let limit = self.memory_limit;
            return fault(format!(
                "its numbers need more than the memory limit of {limit} bytes; raise render.memory_limit_gib"
            ));
        };
        self.left.set(left);
        Ok(())
    }

    /// All animations of the file, which play together: those of each node.
    fn channels(&self) -> Fault<Vec<Vec<Course>>> {
        let mut channels: Vec<Vec<Course>> = self.document.nodes().map(|_| Vec::new()).collect();
        let mut known = HashSet::new();
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
                    let keys = keys.collect::<Fault<Vec<(f64, f64)>>>()?;
                    // Programs write keys for what stays the same, and round them.
                    let first = keys[0].1;
                    let grows = keys.iter().any(|(_, scale)| (scale / first - 1.0).abs() > SCALE_SLACK);
                    let growth = || Keys::new(keys, interpolation, false);
                    Course::Scale(if grows { growth() } else { Keys::constant(first) })
                }
            };
            if !known.insert((node, std::mem::discriminant(&course))) {
                return fault(format!("two animations move {name}; keep one of them"));
            }
            channels[node].push(course);
        }
        Ok(channels)
    }

    /// Adds triangles, placed in the space of the body; whether they have no normals.
    fn add(&self, primitive: &gltf::Primitive, placed: &DMat4, name: &str, body: &mut GltfBody) -> Fault<bool> {
        if primitive.mode() != gltf::mesh::Mode::Triangles {
            return fault(format!("{name} is made of {:?}; only plain triangles are read", primitive.mode()));
        }
        if primitive.morph_targets().next().is_some() {
            return fault(format!("{name} has morph targets, which are not read; bake it to a mesh"));
        }
        let Some(positions) = primitive.get(&gltf::Semantic::Positions) else {
            return fault(format!("{name} has no positions"));
        };
        let first = body.positions.len() as u32;
        let corners: Vec<u32> = match primitive.indices() {
            Some(indices) => self.numbers(&indices, 1)?.into_iter().map(|i| i as u32).collect(),
            None => {
                self.reserve(positions.count() as u64)?;
                (0..positions.count() as u32).collect()
            }
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
        self.reserve((accessor.count() as u64).saturating_mul(width as u64))?;
        let items = (0..accessor.count()).map(|i| &view[accessor.offset() + i * stride..][..item]);
        Ok(items.flat_map(|item| item.chunks_exact(size)).map(number).collect())
    }
}
