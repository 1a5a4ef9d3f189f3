//! Writing: one file of float grids, the same bytes for the same grids.

use crate::grid::DensityGrid;
use crate::grid::vdb::tree::{LEAF, LOWER, MaskBuilder, NodeKind, UPPER, brick_place};
use crate::grid::vdb::{COMPRESS_ACTIVE_MASK, COMPRESS_ZIP, FLOAT_TREE, HALF_SUFFIX, MAGIC, WRITTEN_VERSION};
use crate::grid::{BRICK_EDGE, BrickValues};
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
    /// Half precision: half the size, three decimal digits, densities above 65504 cut to that. Default false.
    pub is_half: bool,
    /// ZIP compression of every buffer. Default true.
    pub is_zipped: bool,
}

impl Default for VdbWriteSettings {
    fn default() -> Self {
        Self { is_half: false, is_zipped: true }
    }
}

/// The bytes of a `.vdb` file with the given grids under the given names, as fog volumes. Voxels whose density is not 0
/// are active.
///
/// # Panics
/// When a name comes twice.
pub fn write_float_grids(grids: &[(&str, &DensityGrid)], settings: VdbWriteSettings) -> Vec<u8> {
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

fn put_grid(out: &mut Vec<u8>, name: &str, grid: &DensityGrid, settings: VdbWriteSettings) {
    put_text(out, name);
    put_text(out, &format!("{FLOAT_TREE}{}", if settings.is_half { HALF_SUFFIX } else { "" }));
    // No instance parent.
    put_text(out, "");
    let offsets_at = out.len();
    out.extend([0; 24]);
    let grid_at = out.len();
    let leaves: Vec<Leaf> = grid.occupied_bricks().map(|(brick, values)| Leaf::new(brick, &values)).collect();
    out.extend((COMPRESS_ACTIVE_MASK | if settings.is_zipped { COMPRESS_ZIP } else { 0 }).to_le_bytes());
    put_grid_metadata(out, name, &leaves, settings);
    put_transform(out, grid);
    let root = Root::new(&leaves);
    root.put_topology(out, &leaves, settings);
    let blocks_at = out.len();
    root.put_buffers(out, &leaves, settings);
    let end = out.len();
    for (i, offset) in [grid_at, blocks_at, end].into_iter().enumerate() {
        out[offsets_at + 8 * i..offsets_at + 8 * i + 8].copy_from_slice(&(offset as i64).to_le_bytes());
    }
}

fn put_grid_metadata(out: &mut Vec<u8>, name: &str, leaves: &[Leaf], settings: VdbWriteSettings) {
    let corner = |v: IVec3| v.to_array().iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let empty = (IVec3::ZERO, IVec3::ZERO);
    let (low, high) = leaves.iter().map(Leaf::bounds).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or(empty);
    let voxel_count: i64 = leaves.iter().map(|l| l.values.len() as i64).sum();
    let compression = if settings.is_zipped { "zip + active values" } else { "active values" };
    put_metadata(
        out,
        &[
            ("class", "string", b"fog volume".to_vec()),
            ("file_bbox_max", "vec3i", corner(high)),
            ("file_bbox_min", "vec3i", corner(low)),
            ("file_compression", "string", compression.into()),
            ("file_voxel_count", "int64", voxel_count.to_le_bytes().to_vec()),
            ("is_saved_as_half_float", "bool", vec![u8::from(settings.is_half)]),
            ("name", "string", name.into()),
        ],
    );
}

fn put_transform(out: &mut Vec<u8>, grid: &DensityGrid) {
    let h = f64::from(grid.voxel_size());
    let all = DVec3::splat;
    put_text(out, "UniformScaleTranslateMap");
    // Translation, scale, voxel size, then what OpenVDB derives from the scale: 1/s, 1/s² and 1/(2s).
    for v in [grid.origin() + 0.5 * h, all(h), all(h), all(1.0 / h), all(1.0 / (h * h)), all(0.5 / h)] {
        put_vector(out, v);
    }
}

/// One brick as a leaf of the tree.
struct Leaf {
    /// Low corner [voxels].
    corner: IVec3,
    mask: MaskBuilder,
    /// The active values in the file's order.
    values: Vec<f32>,
}

impl Leaf {
    fn new(brick: IVec3, values: &BrickValues) -> Self {
        let mut mask = MaskBuilder::new(LEAF);
        let places = (0..LEAF.places()).map(|place| (place, values[brick_place(place)]));
        let values = places.filter(|&(_, v)| v != 0.0).inspect(|&(place, _)| mask.set(place)).map(|(_, v)| v).collect();
        Self { corner: brick * BRICK_EDGE as i32, mask, values }
    }

    /// First and last active voxel along each axis.
    fn bounds(&self) -> (IVec3, IVec3) {
        let active = (0..LEAF.places()).filter(|p| self.mask.0[p >> 3] >> (p & 7) & 1 != 0);
        let voxels = active.map(|place| self.corner + LEAF.child_offset(place));
        voxels.fold((IVec3::MAX, IVec3::MIN), |(a, b), v| (a.min(v), b.max(v)))
    }
}

/// Numbers of leaves by place in their node, by place of the node in its parent, by corner of the parent.
struct Root(BTreeMap<[i32; 3], BTreeMap<usize, BTreeMap<usize, usize>>>);

impl Root {
    fn new(leaves: &[Leaf]) -> Self {
        let mut children = BTreeMap::<_, BTreeMap<_, BTreeMap<_, _>>>::new();
        for (idx, leaf) in leaves.iter().enumerate() {
            let corner = (leaf.corner & !(UPPER.voxels() - 1)).to_array();
            let upper = children.entry(corner).or_default().entry(UPPER.place_of(leaf.corner)).or_default();
            upper.insert(LOWER.place_of(leaf.corner), idx);
        }
        Self(children)
    }

    fn put_topology(&self, out: &mut Vec<u8>, leaves: &[Leaf], settings: VdbWriteSettings) {
        // One buffer a leaf; background 0, in single precision even in half files; no tiles.
        out.extend(1u32.to_le_bytes());
        out.extend(0f32.to_le_bytes());
        out.extend(0u32.to_le_bytes());
        out.extend((self.0.len() as u32).to_le_bytes());
        for (corner, upper) in &self.0 {
            corner.iter().for_each(|c| out.extend(c.to_le_bytes()));
            put_node(out, UPPER, upper.keys(), settings);
            for lower in upper.values() {
                put_node(out, LOWER, lower.keys(), settings);
                lower.values().for_each(|&idx| out.extend(&leaves[idx].mask.0));
            }
        }
    }

    fn put_buffers(&self, out: &mut Vec<u8>, leaves: &[Leaf], settings: VdbWriteSettings) {
        let in_order: Vec<usize> = self.0.values().flat_map(|u| u.values()).flat_map(|l| l.values()).copied().collect();
        let buffers = parallel::map(in_order.len(), |n| {
            let leaf = &leaves[in_order[n]];
            let mut buffer = leaf.mask.0.clone();
            put_values(&mut buffer, &leaf.values, settings);
            buffer
        });
        buffers.iter().for_each(|b| out.extend(b));
    }
}

/// A node all of whose values are inactive zeros, with children at `places`.
fn put_node<'a>(
    out: &mut Vec<u8>,
    kind: NodeKind,
    places: impl Iterator<Item = &'a usize>,
    settings: VdbWriteSettings,
) {
    let mut children = MaskBuilder::new(kind);
    places.for_each(|&place| children.set(place));
    out.extend(children.0);
    out.extend(MaskBuilder::new(kind).0);
    put_values(out, &[], settings);
}

/// Active values behind the byte that says that inactive ones are the background.
fn put_values(out: &mut Vec<u8>, values: &[f32], settings: VdbWriteSettings) {
    out.push(0);
    let plain: Vec<u8> = if settings.is_half {
        // OpenVDB expects nothing, not even a length, for no values in half precision.
        if values.is_empty() {
            return;
        }
        values.iter().flat_map(|&v| f16::from_f32(v.min(f16::MAX.to_f32())).to_le_bytes()).collect()
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
