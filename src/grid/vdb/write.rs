//! Writing: one file of grids, the same bytes for the same grids.

use crate::grid::DensityGrid;
use crate::grid::level_set::LevelSet;
use crate::grid::means::MeanGrid;
use crate::grid::vdb::tree::{LEAF, LOWER, MaskBuilder, NodeKind, UPPER, brick_place};
use crate::grid::vdb::{
    COLOR_TREE, COMPRESS_ACTIVE_MASK, COMPRESS_ZIP, FLOAT_TREE, HALF_SUFFIX, MAGIC, WRITTEN_VERSION,
};
use crate::grid::{BRICK_EDGE, BRICK_VOXELS, BrickValues};
use crate::math::parallel;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use glam::{DVec3, IVec3};
use half::f16;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::io::Write;

/// How to write.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VdbWriteSettings {
    /// Half precision: half the size, three decimal digits, what is beyond ±65504 cut to that. Default false.
    pub is_half: bool,
    /// ZIP compression of every buffer. Default true.
    pub is_zipped: bool,
}

impl Default for VdbWriteSettings {
    fn default() -> Self {
        Self { is_half: false, is_zipped: true }
    }
}

/// A grid to be written.
#[derive(Debug, Clone, Copy)]
pub enum VdbGrid<'a> {
    /// A fog volume, active where it is not 0.
    Density(&'a DensityGrid),
    /// What the density carries, times a factor, active where the density is: a number as a fog volume, three as vectors that go
    /// the way they point at (velocities).
    Mean {
        /// The density.
        density: &'a DensityGrid,
        /// One or three quantities.
        mean: &'a MeanGrid,
        /// What they are multiplied by.
        factor: f32,
    },
    /// Signed distances [m], active near surfaces.
    LevelSet(&'a LevelSet),
}

impl VdbGrid<'_> {
    /// Low corner of voxel (0, 0, 0), and the edge of a voxel [m].
    fn place(&self) -> (DVec3, f64) {
        match self {
            Self::Density(density) | Self::Mean { density, .. } => (density.origin(), f64::from(density.voxel_size())),
            Self::LevelSet(level_set) => (level_set.origin, f64::from(level_set.voxel_size)),
        }
    }

    /// The value where nothing is stored.
    fn background(&self) -> f32 {
        match self {
            Self::Density(_) | Self::Mean { .. } => 0.0,
            Self::LevelSet(level_set) => level_set.band,
        }
    }

    /// What OpenVDB takes it for.
    fn class(&self) -> &'static str {
        match self {
            Self::Density(_) => "fog volume",
            Self::Mean { .. } if self.channel_count() == 1 => "fog volume",
            Self::Mean { .. } => "unknown",
            Self::LevelSet(_) => "level set",
        }
    }

    /// Numbers of a value.
    fn channel_count(&self) -> usize {
        match self {
            Self::Density(_) | Self::LevelSet(_) => 1,
            Self::Mean { mean, .. } => mean.quantity_count(),
        }
    }

    fn leaves(&self) -> Vec<Leaf> {
        match self {
            Self::Density(density) => {
                let bricks: Vec<_> = density.occupied_bricks().collect();
                parallel::map(bricks.len(), |n| {
                    let (brick, values) = &bricks[n];
                    Leaf::new(*brick, |i| values[i] != 0.0, &[values], 1.0)
                })
            }
            Self::Mean { density, mean, factor } => {
                let bricks: Vec<_> = density.occupied_bricks().collect();
                let none = [0.0; BRICK_VOXELS];
                parallel::map(bricks.len(), |n| {
                    let (brick, density) = &bricks[n];
                    let values: Vec<&BrickValues> = match mean.brick(*brick) {
                        Some(values) => values.collect(),
                        None => vec![&none; mean.quantity_count()],
                    };
                    Leaf::new(*brick, |i| density[i] != 0.0, &values, *factor)
                })
            }
            Self::LevelSet(level_set) => parallel::map(level_set.near.len(), |n| {
                let (brick, values) = &level_set.near[n];
                let leaf = Leaf::new(*brick, |i| values[i].abs() < level_set.band, &[values], 1.0);
                leaf.with_outside(|i| values[i] > 0.0)
            }),
        }
    }

    /// Bricks that hold the background with its sign turned.
    fn inside(&self) -> &[IVec3] {
        match self {
            Self::Density(_) | Self::Mean { .. } => &[],
            Self::LevelSet(level_set) => &level_set.inside,
        }
    }
}

/// [`write_grids`] of densities alone.
///
/// # Panics
/// When a name comes twice.
pub fn write_float_grids(grids: &[(&str, &DensityGrid)], settings: VdbWriteSettings) -> Vec<u8> {
    let grids: Vec<_> = grids.iter().map(|&(name, grid)| (name, VdbGrid::Density(grid))).collect();
    write_grids(&grids, settings)
}

/// The bytes of a `.vdb` file with the given grids under the given names.
///
/// # Panics
/// When a name comes twice, or a mean has neither one nor three quantities.
pub fn write_grids(grids: &[(&str, VdbGrid)], settings: VdbWriteSettings) -> Vec<u8> {
    let mut out = Vec::new();
    out.extend(MAGIC.to_le_bytes());
    out.extend(WRITTEN_VERSION.to_le_bytes());
    // The library version whose files look like this.
    out.extend(10u32.to_le_bytes());
    out.extend(0u32.to_le_bytes());
    // Grid offsets are present.
    out.push(1);
    let uuid_at = out.len();
    out.extend([b'0'; UUID_LENGTH]);
    let creator = concat!("curlsmoke ", env!("CARGO_PKG_VERSION"));
    put_metadata(&mut out, &[("creator", "string", creator.as_bytes().to_vec())]);
    out.extend((grids.len() as u32).to_le_bytes());
    for (i, (name, grid)) in grids.iter().enumerate() {
        assert!(grids[..i].iter().all(|(other, _)| other != name), "two grids are named {name:?}");
        put_grid(&mut out, name, grid, settings);
    }
    let uuid = uuid_of(&out);
    out[uuid_at..uuid_at + UUID_LENGTH].copy_from_slice(uuid.as_bytes());
    out
}

const UUID_LENGTH: usize = 36;

/// An identifier that is a function of the content, in the form of a version 8 UUID (RFC 9562).
fn uuid_of(content: &[u8]) -> String {
    let mut id: [u8; 16] = std::array::from_fn({
        let hash = Sha256::digest(content);
        move |i| hash[i]
    });
    id[6] = id[6] & 0x0f | 0x80;
    id[8] = id[8] & 0x3f | 0x80;
    let hex: String = id.iter().map(|b| format!("{b:02x}")).collect();
    [&hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..]].join("-")
}

fn put_text(out: &mut Vec<u8>, text: &str) {
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(text.as_bytes());
}

/// Name, type and value of each.
fn put_metadata(out: &mut Vec<u8>, entries: &[(&str, &str, Vec<u8>)]) {
    out.extend((entries.len() as u32).to_le_bytes());
    for (name, kind, value) in entries {
        put_text(out, name);
        put_text(out, kind);
        out.extend((value.len() as u32).to_le_bytes());
        out.extend(value);
    }
}

fn put_vector(out: &mut Vec<u8>, v: DVec3) {
    v.to_array().iter().for_each(|x| out.extend(x.to_le_bytes()));
}

fn put_grid(out: &mut Vec<u8>, name: &str, grid: &VdbGrid, settings: VdbWriteSettings) {
    let channel_count = grid.channel_count();
    assert!([1, 3].contains(&channel_count), "{channel_count} numbers a value");
    put_text(out, name);
    let tree = if channel_count == 3 { COLOR_TREE } else { FLOAT_TREE };
    put_text(out, &format!("{tree}{}", if settings.is_half { HALF_SUFFIX } else { "" }));
    // No instance parent.
    put_text(out, "");
    let offsets_at = out.len();
    out.extend([0; 24]);
    let grid_at = out.len();
    let leaves = grid.leaves();
    out.extend((COMPRESS_ACTIVE_MASK | if settings.is_zipped { COMPRESS_ZIP } else { 0 }).to_le_bytes());
    put_grid_metadata(out, name, grid, &leaves, settings);
    put_transform(out, grid.place());
    let root = Root::new(&leaves, grid.inside());
    root.put_topology(out, &leaves, grid, settings);
    let blocks_at = out.len();
    root.put_buffers(out, &leaves, settings);
    let end = out.len();
    for (i, offset) in [grid_at, blocks_at, end].into_iter().enumerate() {
        out[offsets_at + 8 * i..offsets_at + 8 * i + 8].copy_from_slice(&(offset as i64).to_le_bytes());
    }
}

fn put_grid_metadata(out: &mut Vec<u8>, name: &str, grid: &VdbGrid, leaves: &[Leaf], settings: VdbWriteSettings) {
    let channel_count = grid.channel_count();
    let corner = |v: IVec3| v.to_array().iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let empty = (IVec3::ZERO, IVec3::ZERO);
    let (low, high) = leaves.iter().map(Leaf::bounds).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or(empty);
    let voxel_count: i64 = leaves.iter().map(|l| (l.values.len() / channel_count) as i64).sum();
    let compression = if settings.is_zipped { "zip + active values" } else { "active values" };
    let mut entries = vec![
        ("class", "string", grid.class().into()),
        ("file_bbox_max", "vec3i", corner(high)),
        ("file_bbox_min", "vec3i", corner(low)),
        ("file_compression", "string", compression.into()),
        ("file_voxel_count", "int64", voxel_count.to_le_bytes().to_vec()),
        ("is_saved_as_half_float", "bool", vec![u8::from(settings.is_half)]),
        ("name", "string", name.into()),
    ];
    if channel_count == 3 {
        // Turns with what it is in, and stays the same where that is moved: a displacement or a velocity.
        entries.push(("vector_type", "string", b"contravariant relative".to_vec()));
    }
    put_metadata(out, &entries);
}

fn put_transform(out: &mut Vec<u8>, (corner, h): (DVec3, f64)) {
    let all = DVec3::splat;
    put_text(out, "UniformScaleTranslateMap");
    // Translation, scale, voxel size, then what OpenVDB derives from the scale: 1/s, 1/s² and 1/(2s).
    for v in [corner + 0.5 * h, all(h), all(h), all(1.0 / h), all(1.0 / (h * h)), all(0.5 / h)] {
        put_vector(out, v);
    }
}

/// One brick as a leaf of the tree.
struct Leaf {
    /// Low corner [voxels].
    corner: IVec3,
    mask: MaskBuilder,
    /// The active values in the file's order, all numbers of each together.
    values: Vec<f32>,
    /// Where inactive values are the background; everywhere where `None`. Elsewhere they are it with its sign turned.
    outside: Option<MaskBuilder>,
}

impl Leaf {
    fn new(brick: IVec3, is_active: impl Fn(usize) -> bool, channels: &[&BrickValues], factor: f32) -> Self {
        let mut mask = MaskBuilder::new(LEAF);
        let mut values = Vec::new();
        for place in (0..LEAF.places()).filter(|&place| is_active(brick_place(place))) {
            mask.set(place);
            values.extend(channels.iter().map(|values| factor * values[brick_place(place)]));
        }
        Self { corner: brick * BRICK_EDGE as i32, mask, values, outside: None }
    }

    /// With the background's sign turned where a voxel is not outside.
    fn with_outside(self, is_outside: impl Fn(usize) -> bool) -> Self {
        let mut outside = MaskBuilder::new(LEAF);
        (0..LEAF.places()).filter(|&place| is_outside(brick_place(place))).for_each(|place| outside.set(place));
        Self { outside: Some(outside), ..self }
    }

    /// First and last active voxel along each axis.
    fn bounds(&self) -> (IVec3, IVec3) {
        let active = (0..LEAF.places()).filter(|p| self.mask.0[p >> 3] >> (p & 7) & 1 != 0);
        let voxels = active.map(|place| self.corner + LEAF.child_offset(place));
        voxels.fold((IVec3::MAX, IVec3::MIN), |(a, b), v| (a.min(v), b.max(v)))
    }
}

/// What is at a place of the lowest nodes.
#[derive(Clone, Copy, PartialEq)]
enum Child {
    /// A leaf, by its number.
    Leaf(usize),
    /// The background with its sign turned.
    Inside,
}

impl Child {
    fn leaf(&self) -> Option<usize> {
        match self {
            Self::Leaf(idx) => Some(*idx),
            Self::Inside => None,
        }
    }
}

/// What is at the places of the lowest nodes, by place of the node in its parent, by corner of the parent.
struct Root(BTreeMap<[i32; 3], BTreeMap<usize, BTreeMap<usize, Child>>>);

impl Root {
    fn new(leaves: &[Leaf], inside: &[IVec3]) -> Self {
        let mut children = BTreeMap::<_, BTreeMap<_, BTreeMap<_, _>>>::new();
        let leaves = leaves.iter().enumerate().map(|(idx, leaf)| (leaf.corner, Child::Leaf(idx)));
        let inside = inside.iter().map(|&brick| (brick * BRICK_EDGE as i32, Child::Inside));
        for (voxel, child) in leaves.chain(inside) {
            let corner = (voxel & !(UPPER.voxels() - 1)).to_array();
            let upper = children.entry(corner).or_default().entry(UPPER.place_of(voxel)).or_default();
            upper.insert(LOWER.place_of(voxel), child);
        }
        Self(children)
    }

    fn put_topology(&self, out: &mut Vec<u8>, leaves: &[Leaf], grid: &VdbGrid, settings: VdbWriteSettings) {
        // One buffer a leaf; the background, in single precision even in half files; no tiles.
        out.extend(1u32.to_le_bytes());
        (0..grid.channel_count()).for_each(|_| out.extend(grid.background().to_le_bytes()));
        out.extend(0u32.to_le_bytes());
        out.extend((self.0.len() as u32).to_le_bytes());
        for (corner, upper) in &self.0 {
            corner.iter().for_each(|c| out.extend(c.to_le_bytes()));
            put_node(out, UPPER, upper.keys().map(|&place| (place, true)), settings);
            for lower in upper.values() {
                put_node(out, LOWER, lower.iter().map(|(&place, child)| (place, child.leaf().is_some())), settings);
                lower.values().filter_map(Child::leaf).for_each(|idx| out.extend(&leaves[idx].mask.0));
            }
        }
    }

    fn put_buffers(&self, out: &mut Vec<u8>, leaves: &[Leaf], settings: VdbWriteSettings) {
        let lowest = self.0.values().flat_map(|u| u.values()).flat_map(|l| l.values());
        let in_order: Vec<usize> = lowest.filter_map(Child::leaf).collect();
        let buffers = parallel::map(in_order.len(), |n| {
            let leaf = &leaves[in_order[n]];
            let mut buffer = leaf.mask.0.clone();
            put_values(&mut buffer, &leaf.values, leaf.outside.as_ref(), settings);
            buffer
        });
        buffers.iter().for_each(|b| out.extend(b));
    }
}

/// A node all of whose values are inactive: of its places some hold a child, some are inside (`false`), and all others outside.
fn put_node(
    out: &mut Vec<u8>,
    kind: NodeKind,
    places: impl Iterator<Item = (usize, bool)>,
    settings: VdbWriteSettings,
) {
    let (mut children, mut inside) = (MaskBuilder::new(kind), MaskBuilder::new(kind));
    places.for_each(|(place, is_child)| if is_child { children.set(place) } else { inside.set(place) });
    out.extend(children.0);
    out.extend(MaskBuilder::new(kind).0);
    let has_inside = inside.0.iter().any(|&bits| bits != 0);
    inside.0.iter_mut().for_each(|bits| *bits = !*bits);
    put_values(out, &[], has_inside.then_some(&inside), settings);
}

/// Inactive values are the background.
const ALL_BACKGROUND: u8 = 0;
/// Inactive values are the background where a mask says so, and it with its sign turned elsewhere.
const BACKGROUND_BY_MASK: u8 = 3;

/// Active values, behind what says which the inactive ones are.
fn put_values(out: &mut Vec<u8>, values: &[f32], outside: Option<&MaskBuilder>, settings: VdbWriteSettings) {
    out.push(if outside.is_some() { BACKGROUND_BY_MASK } else { ALL_BACKGROUND });
    outside.into_iter().for_each(|mask| out.extend(&mask.0));
    let plain: Vec<u8> = if settings.is_half {
        // OpenVDB expects nothing, not even a length, for no values in half precision.
        if values.is_empty() {
            return;
        }
        values
            .iter()
            .flat_map(|&v| f16::from_f32(v.clamp(f16::MIN.to_f32(), f16::MAX.to_f32())).to_le_bytes())
            .collect()
    } else {
        values.iter().flat_map(|v| v.to_le_bytes()).collect()
    };
    if !settings.is_zipped {
        out.extend(plain);
        return;
    }
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    let packed = encoder.write_all(&plain).and_then(|()| encoder.finish());
    match packed {
        Ok(packed) if packed.len() < plain.len() => {
            out.extend((packed.len() as i64).to_le_bytes());
            out.extend(packed);
        }
        // Stored as it is under a negative length where compression gains nothing.
        _ => {
            out.extend((-(plain.len() as i64)).to_le_bytes());
            out.extend(plain);
        }
    }
}
