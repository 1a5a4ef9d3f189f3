//! Reading: header, list of grids, one grid's metadata, transform, topology and buffers.
//!
//! Nothing in a file is believed before it is checked: every count costs its share of the file's bytes before memory is
//! taken for it, and what tiles expand to is compared with the memory limit first.

use crate::grid::vdb::bytes::Cursor;
use crate::grid::vdb::tree::{LEAF, LOWER, Mask, NodeKind, UPPER, brick_place};
use crate::grid::vdb::{
    COLOR_TREE, COMPRESS_ACTIVE_MASK, COMPRESS_BLOSC, COMPRESS_ZIP, FLOAT_TREE, HALF_SUFFIX, MAGIC, NAME_SEPARATOR,
    NEWEST_VERSION, NODE_MASK_VERSION, OLDEST_VERSION, VdbError, VdbProblem, blosc,
};
use crate::grid::{BRICK_VOXELS, BrickValues, DensityGrid, GridError, MAX_COORDINATE, needed_bytes};
use glam::{DVec3, IVec3, U64Vec3};
use half::f16;
use std::collections::BTreeSet;
use std::io::Read;
use std::path::Path;

/// Negative densities smaller than this part of the largest one are the ringing of somebody's filter, and read as 0.
const NEGLIGIBLE: f32 = 1e-6;

/// One grid of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GridInfo {
    /// Its name.
    pub name: String,
    /// Type of its tree, such as `Tree_float_5_4_3`; ends in `_HalfFloat` where values are stored in half precision.
    pub type_name: String,
}

fn is_float_tree(type_name: &str) -> bool {
    type_name.strip_suffix(HALF_SUFFIX).unwrap_or(type_name) == FLOAT_TREE
}

impl GridInfo {
    /// True for the grids that [`read_float_grid`] reads.
    pub fn is_float(&self) -> bool {
        is_float_tree(&self.type_name)
    }

    /// True for grids of colours, of which [`read_color_grid`] reads each channel.
    pub fn is_color(&self) -> bool {
        self.type_name.strip_suffix(HALF_SUFFIX).unwrap_or(&self.type_name) == COLOR_TREE
    }
}

/// The grids of the file at `path`.
///
/// # Errors
/// [`VdbError`] where the file is missing, larger than the limit, or not a sound `.vdb` file.
pub fn list_grids(path: &Path, memory_limit_bytes: u64) -> Result<Vec<GridInfo>, VdbError> {
    load(path, memory_limit_bytes)
        .and_then(|bytes| parse_grid_list(&bytes))
        .map_err(|problem| VdbError { path: path.to_path_buf(), problem })
}

/// The float grid `name` of the file at `path`.
///
/// All values are taken, active or not, and the background must be 0. Densities below 0 by less than a millionth of the
/// largest one are read as 0; larger negative or non-finite ones are errors.
///
/// # Errors
/// [`VdbError`] as for [`list_grids`], and where the grid is missing, of another type, or does not fit the limit.
pub fn read_float_grid(path: &Path, name: &str, memory_limit_bytes: u64) -> Result<DensityGrid, VdbError> {
    load(path, memory_limit_bytes)
        .and_then(|bytes| {
            let left = memory_limit_bytes.saturating_sub(bytes.len() as u64);
            parse_channel(&bytes, name, None, left)
        })
        // The file is gone by now.
        .and_then(|voxels| voxels.into_grid(name, memory_limit_bytes))
        .map_err(|problem| VdbError { path: path.to_path_buf(), problem })
}

/// Red, green and blue of the grid `name` of the file at `path`: of vectors its components, of a float grid three times the same.
/// The limit is for all three.
///
/// # Errors
/// As for [`read_float_grid`]; no value may be negative here either.
pub fn read_color_grid(path: &Path, name: &str, memory_limit_bytes: u64) -> Result<[DensityGrid; 3], VdbError> {
    load(path, memory_limit_bytes)
        .and_then(|bytes| {
            let left = memory_limit_bytes.saturating_sub(bytes.len() as u64);
            parse_color_grid(&bytes, name, left)
        })
        .map_err(|problem| VdbError { path: path.to_path_buf(), problem })
}

/// The grid `name` of vectors (`vec3s`) of a file: of each component the part above 0, and the part below with its sign turned.
///
/// # Errors
/// As [`read_color_grid`].
pub fn read_vector_grid(path: &Path, name: &str, memory_limit_bytes: u64) -> Result<[[DensityGrid; 2]; 3], VdbError> {
    load(path, memory_limit_bytes)
        .and_then(|bytes| {
            let left = memory_limit_bytes.saturating_sub(bytes.len() as u64);
            parse_vector_grid(&bytes, name, left)
        })
        .map_err(|problem| VdbError { path: path.to_path_buf(), problem })
}

/// The grid `name` of vectors of a file given as bytes; see [`read_vector_grid`].
///
/// # Errors
/// [`VdbProblem`] as for [`read_vector_grid`].
pub fn parse_vector_grid(
    bytes: &[u8],
    name: &str,
    memory_limit_bytes: u64,
) -> Result<[[DensityGrid; 2]; 3], VdbProblem> {
    let limit = memory_limit_bytes / 6;
    let component = |i: usize| {
        let up = parse_channel(bytes, name, Some(i), limit)?;
        let mut down = Voxels { origin: up.origin, voxel_size: up.voxel_size, tree: up.tree.clone() };
        down.tree.values.iter_mut().flatten().for_each(|v| *v = -*v);
        let above = |mut voxels: Voxels| {
            // What is no number stays, and is refused.
            voxels.tree.values.iter_mut().flatten().filter(|v| **v < 0.0).for_each(|v| *v = 0.0);
            voxels.into_grid(name, limit)
        };
        Ok::<_, VdbProblem>([above(up)?, above(down)?])
    };
    Ok([component(0)?, component(1)?, component(2)?])
}

fn load(path: &Path, limit_bytes: u64) -> Result<Vec<u8>, VdbProblem> {
    let file = std::fs::File::open(path)?;
    let file_bytes = file.metadata()?.len();
    if file_bytes > limit_bytes {
        return Err(VdbProblem::TooLarge { file_bytes, limit_bytes });
    }
    let mut bytes = Vec::with_capacity(file_bytes as usize);
    file.take(limit_bytes).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The grids of a file given as bytes.
///
/// # Errors
/// [`VdbProblem`] as for [`list_grids`].
pub fn parse_grid_list(bytes: &[u8]) -> Result<Vec<GridInfo>, VdbProblem> {
    Ok(Header::read(&mut Cursor::new(bytes))?.grids.iter().map(Descriptor::info).collect())
}

/// The float grid `name` of a file given as bytes; see [`read_float_grid`].
///
/// # Errors
/// [`VdbProblem`] as for [`read_float_grid`].
pub fn parse_float_grid(bytes: &[u8], name: &str, memory_limit_bytes: u64) -> Result<DensityGrid, VdbProblem> {
    parse_channel(bytes, name, None, memory_limit_bytes)?.into_grid(name, memory_limit_bytes)
}

/// Red, green and blue of the grid `name` of a file given as bytes; see [`read_color_grid`].
///
/// # Errors
/// [`VdbProblem`] as for [`read_color_grid`].
pub fn parse_color_grid(bytes: &[u8], name: &str, memory_limit_bytes: u64) -> Result<[DensityGrid; 3], VdbProblem> {
    let limit = memory_limit_bytes / 3;
    let mut cursor = Cursor::new(bytes);
    let header = Header::read(&mut cursor)?;
    let found = header.grids.iter().find(|grid| grid.name() == name || grid.unique_name == name);
    if found.is_some_and(|grid| is_float_tree(&grid.type_name)) {
        let grid = parse_float_grid(bytes, name, limit)?;
        return Ok([grid.clone(), grid.clone(), grid]);
    }
    let channel = |i: usize| parse_channel(bytes, name, Some(i), limit)?.into_grid(name, limit);
    Ok([channel(0)?, channel(1)?, channel(2)?])
}

/// What a file holds of a grid.
struct Voxels {
    origin: DVec3,
    voxel_size: f32,
    tree: Tree,
}

impl Voxels {
    fn into_grid(mut self, name: &str, memory_limit_bytes: u64) -> Result<DensityGrid, VdbProblem> {
        clear_negligible(&mut self.tree.values);
        let Tree { bricks, values, .. } = &self.tree;
        DensityGrid::from_bricks(self.origin, self.voxel_size, bricks, values, memory_limit_bytes)
            .map_err(|error| VdbProblem::Grid { name: name.to_owned(), error })
    }
}

/// A float grid, or one `channel` of a grid of colours.
fn parse_channel(
    bytes: &[u8],
    name: &str,
    channel: Option<usize>,
    memory_limit_bytes: u64,
) -> Result<Voxels, VdbProblem> {
    let mut cursor = Cursor::new(bytes);
    let header = Header::read(&mut cursor)?;
    let Some(found) = header.grids.iter().find(|g| g.name() == name || g.unique_name == name) else {
        let available = header.grids.iter().map(|g| format!("\"{}\" ({})", g.name(), g.type_name)).collect();
        return Err(VdbProblem::NoSuchGrid { name: name.to_owned(), available });
    };
    found.check_type(&cursor, channel)?;
    let mut stream = Stream::open(&mut cursor, &header, found, channel)?;
    let transform = read_transform(&mut stream.cursor)?;
    // An instance has its own transform and shares the tree of another grid.
    if !found.parent.is_empty() {
        let parent = header.grids.iter().find(|g| g.unique_name == found.parent && g.parent.is_empty());
        let Some(parent) = parent else {
            return Err(cursor
                .malformed(format!("grid \"{name}\" shares the tree of \"{}\", which is not there", found.parent)));
        };
        parent.check_type(&cursor, channel)?;
        stream = Stream::open(&mut cursor, &header, parent, channel)?;
        read_transform(&mut stream.cursor)?;
    }
    let mut tree = Tree::default();
    tree.read_topology(&mut stream, memory_limit_bytes).map_err(|e| e.into_problem(name))?;
    tree.read_leaves(&mut stream)?;
    let origin = transform.translation - 0.5 * transform.voxel_size;
    Ok(Voxels { origin, voxel_size: transform.voxel_size as f32, tree })
}

fn clear_negligible(bricks: &mut [BrickValues]) {
    let largest = bricks.iter().flatten().copied().fold(0.0, f32::max);
    let bound = -NEGLIGIBLE * largest;
    bricks.iter_mut().flatten().filter(|v| **v < 0.0 && **v >= bound).for_each(|v| *v = 0.0);
}

/// A grid as the file announces it.
struct Descriptor {
    unique_name: String,
    type_name: String,
    /// Unique name of the grid whose tree it shares, or empty.
    parent: String,
    grid_at: i64,
}

impl Descriptor {
    fn name(&self) -> &str {
        self.unique_name.split(NAME_SEPARATOR).next().unwrap_or_default()
    }

    fn info(&self) -> GridInfo {
        GridInfo { name: self.name().to_owned(), type_name: self.type_name.clone() }
    }

    fn check_type(&self, cursor: &Cursor, channel: Option<usize>) -> Result<(), VdbProblem> {
        let info = self.info();
        let (name, found) = (&info.name, &info.type_name);
        match channel {
            None if info.is_float() => Ok(()),
            Some(_) if info.is_color() => Ok(()),
            None => Err(cursor.unsupported(format!(
                "grid \"{name}\" is a {found}; only {FLOAT_TREE} and {FLOAT_TREE}{HALF_SUFFIX} are read as density"
            ))),
            Some(_) => Err(cursor.unsupported(format!(
                "grid \"{name}\" is a {found}; only {COLOR_TREE} and {FLOAT_TREE}, each also with {HALF_SUFFIX}, are read as light"
            ))),
        }
    }
}

struct Header {
    version: u32,
    /// Of all grids, in versions that do not tell it for each.
    compression: u32,
    grids: Vec<Descriptor>,
}

impl Header {
    fn read(cursor: &mut Cursor) -> Result<Self, VdbProblem> {
        let magic = cursor.u64("the magic number")?;
        if magic != MAGIC {
            cursor.seek(0, "the start")?;
            return Err(cursor.malformed(format!("not a .vdb file: it begins with {magic:#018x}, not {MAGIC:#018x}")));
        }
        let version = cursor.u32("the file version")?;
        if !(OLDEST_VERSION..=NEWEST_VERSION).contains(&version) {
            return Err(cursor.unsupported(format!(
                "file version {version}; versions {OLDEST_VERSION} to {NEWEST_VERSION} are read"
            )));
        }
        cursor.take(8, "the library version")?;
        if cursor.u8("the flag for grid offsets")? == 0 {
            return Err(
                cursor.unsupported("the file was written as a stream, without grid offsets; re-save it to a file")
            );
        }
        let mut compression = COMPRESS_ZIP | COMPRESS_ACTIVE_MASK;
        if version < NODE_MASK_VERSION {
            compression = if cursor.u8("the compression flag")? != 0 { COMPRESS_ZIP } else { 0 };
        }
        cursor.take(36, "the file's UUID")?;
        skip_metadata(cursor)?;
        let count = cursor.i32("the number of grids")?;
        let mut grids = Vec::new();
        for _ in 0..count.max(0) {
            let unique_name = cursor.text("a grid's name")?;
            let type_name = cursor.text("a grid's type")?;
            let parent = cursor.text("the name of a grid's instance parent")?;
            let grid_at = cursor.i64("a grid's offset")?;
            cursor.i64("a grid's block offset")?;
            let end = cursor.i64("a grid's end offset")?;
            if usize::try_from(end).map_or(true, |e| e < cursor.offset()) {
                return Err(cursor.malformed(format!("grid \"{unique_name}\" ends at byte {end}, before it begins")));
            }
            cursor.seek(end, "the end of a grid")?;
            grids.push(Descriptor { unique_name, type_name, parent, grid_at });
        }
        Ok(Self { version, compression, grids })
    }
}

fn skip_metadata(cursor: &mut Cursor) -> Result<(), VdbProblem> {
    for _ in 0..cursor.u32("the number of metadata")? {
        cursor.text("the name of a metadatum")?;
        cursor.text("the type of a metadatum")?;
        let size = cursor.u32("the size of a metadatum")?;
        cursor.take(size as usize, "a metadatum")?;
    }
    Ok(())
}

/// Index (i, j, k) lies at `translation + (i, j, k)·voxel_size`.
struct Transform {
    voxel_size: f64,
    translation: DVec3,
}

fn read_transform(cursor: &mut Cursor) -> Result<Transform, VdbProblem> {
    let start = cursor.clone();
    let kind = cursor.text("the type of the transform")?;
    let (mut scale, mut translation) = (DVec3::ONE, DVec3::ZERO);
    // What follows the scale and the translation in each map are numbers derived from them.
    match kind.as_str() {
        "UniformScaleMap" | "ScaleMap" => {
            scale = vector(cursor)?;
            cursor.take(4 * 24, "a scale map")?;
        }
        "UniformScaleTranslateMap" | "ScaleTranslateMap" => {
            translation = vector(cursor)?;
            scale = vector(cursor)?;
            cursor.take(4 * 24, "a scale and translate map")?;
        }
        "TranslationMap" => translation = vector(cursor)?,
        "AffineMap" => {
            let mut rows = [[0.0; 4]; 4];
            for entry in rows.iter_mut().flatten() {
                *entry = cursor.f64("an affine map")?;
            }
            // Row vectors: the translation is the last row.
            let is_diagonal = (0..3).all(|r| (0..4).all(|c| r == c || rows[r][c] == 0.0));
            if !is_diagonal || rows[3][3] != 1.0 {
                return Err(
                    start.unsupported("the transform rotates or shears; resample the grid to an axis-aligned one")
                );
            }
            scale = DVec3::new(rows[0][0], rows[1][1], rows[2][2]);
            translation = DVec3::new(rows[3][0], rows[3][1], rows[3][2]);
        }
        other => {
            return Err(
                start.unsupported(format!("a transform of type {other:?}; uniform scale and translation are read"))
            );
        }
    }
    if !(scale.is_finite() && translation.is_finite() && scale.min_element() > 0.0) {
        return Err(start.malformed(format!("a transform with voxel size {scale} and translation {translation}")));
    }
    if (scale - scale.x).abs().max_element() > 1e-6 * scale.x {
        return Err(start.unsupported(format!("voxels of {scale} m; only cubes are read: resample the grid")));
    }
    Ok(Transform { voxel_size: scale.x, translation })
}

fn vector(cursor: &mut Cursor) -> Result<DVec3, VdbProblem> {
    Ok(DVec3::new(cursor.f64("a transform")?, cursor.f64("a transform")?, cursor.f64("a transform")?))
}

/// The bytes of one grid and how to read them.
struct Stream<'a> {
    cursor: Cursor<'a>,
    version: u32,
    compression: u32,
    is_half: bool,
    /// How many numbers a value has, and which of them is read.
    channels: usize,
    channel: usize,
    background: f32,
    /// Room for a buffer unpacked, and for the active values of a node.
    unpacked: Vec<u8>,
    stored: Vec<f32>,
}

impl<'a> Stream<'a> {
    /// At the transform of `grid`, behind its metadata.
    fn open(
        cursor: &mut Cursor<'a>,
        header: &Header,
        grid: &Descriptor,
        channel: Option<usize>,
    ) -> Result<Self, VdbProblem> {
        let channels = if channel.is_some() { 3 } else { 1 };
        let mut cursor = cursor.clone();
        cursor.seek(grid.grid_at, &format!("grid \"{}\"", grid.name()))?;
        let compression = match header.version {
            ..NODE_MASK_VERSION => header.compression,
            _ => cursor.u32("the grid's compression flags")?,
        };
        let unknown = compression & !(COMPRESS_ZIP | COMPRESS_ACTIVE_MASK | COMPRESS_BLOSC);
        if unknown != 0 {
            return Err(cursor.unsupported(format!("unknown compression flags {unknown:#x}")));
        }
        skip_metadata(&mut cursor)?;
        let is_half = grid.type_name.ends_with(HALF_SUFFIX);
        Ok(Self {
            cursor,
            version: header.version,
            compression,
            is_half,
            channels,
            channel: channel.unwrap_or(0),
            background: 0.0,
            unpacked: vec![0; 4 * channels * UPPER.places()],
            stored: vec![0.0; UPPER.places()],
        })
    }

    fn mask(&mut self, kind: NodeKind, what: &str) -> Result<Mask<'a>, VdbProblem> {
        Ok(Mask(self.cursor.take(kind.places() / 8, what)?))
    }

    /// One value outside of buffers, which is never in half precision.
    fn value(&mut self, what: &str) -> Result<f32, VdbProblem> {
        let mut value = 0.0;
        for i in 0..self.channels {
            let number = self.cursor.f32(what)?;
            if i == self.channel {
                value = number;
            }
        }
        Ok(value)
    }

    /// `out.len()` values, of which only those on in `active` are stored where the grid uses mask compression.
    fn values(&mut self, active: Mask, out: &mut [f32]) -> Result<(), VdbProblem> {
        const ONE_VALUE: [u8; 3] = [2, 4, 5];
        const SELECTION: [u8; 3] = [3, 4, 5];
        const ALL_VALUES: u8 = 6;
        let at = self.cursor.clone();
        let metadata =
            if self.version >= NODE_MASK_VERSION { self.cursor.u8("a node's metadata")? } else { ALL_VALUES };
        if metadata > ALL_VALUES {
            return Err(at.malformed(format!("node metadata {metadata}, at most {ALL_VALUES} expected")));
        }
        let mut inactive = [if metadata == 0 { self.background } else { -self.background }, self.background];
        if ONE_VALUE.contains(&metadata) {
            inactive[0] = self.value("an inactive value")?;
        }
        if metadata == 5 {
            inactive[1] = self.value("an inactive value")?;
        }
        let selection = if SELECTION.contains(&metadata) {
            Some(Mask(self.cursor.take(out.len() / 8, "a selection mask")?))
        } else {
            None
        };
        let is_masked = self.compression & COMPRESS_ACTIVE_MASK != 0 && metadata != ALL_VALUES;
        if !is_masked {
            return self.buffer(out);
        }
        let mut stored = std::mem::take(&mut self.stored);
        let result = self.buffer(&mut stored[..active.count()]);
        let mut next = stored.iter();
        for (place, value) in out.iter_mut().enumerate() {
            *value = if active.is_on(place) {
                next.next().copied().unwrap_or_default()
            } else {
                inactive[usize::from(selection.is_some_and(|s| s.is_on(place)))]
            };
        }
        self.stored = stored;
        result
    }

    /// Values one after another, as one buffer of the file.
    fn buffer(&mut self, out: &mut [f32]) -> Result<(), VdbProblem> {
        // OpenVDB writes nothing, not even a length, for no values in half precision.
        if self.is_half && out.is_empty() {
            return Ok(());
        }
        let size = out.len() * self.channels * if self.is_half { 2 } else { 4 };
        let bytes = if self.compression & (COMPRESS_ZIP | COMPRESS_BLOSC) == 0 {
            self.cursor.take(size, "values")?
        } else {
            let at = self.cursor.clone();
            let length = self.cursor.i64("the length of a compressed buffer")?;
            let packed = usize::try_from(length.unsigned_abs()).unwrap_or(usize::MAX);
            let packed = self.cursor.take(packed, "a compressed buffer")?;
            let unpacked = &mut self.unpacked[..size];
            // A length of 0 or less: stored as it is.
            if length <= 0 {
                if packed.len() != size {
                    return Err(at.malformed(format!("a stored buffer of {} bytes, {size} expected", packed.len())));
                }
                packed
            } else if self.compression & COMPRESS_BLOSC != 0 {
                blosc::decompress(packed, unpacked).map_err(|what| at.malformed(what))?;
                unpacked
            } else {
                let mut decoder = flate2::read::ZlibDecoder::new(packed);
                decoder.read_exact(unpacked).map_err(|e| at.malformed(format!("a broken ZIP buffer: {e}")))?;
                unpacked
            }
        };
        if self.is_half {
            let halves = bytes.as_chunks::<2>().0.iter().skip(self.channel).step_by(self.channels);
            out.iter_mut().zip(halves).for_each(|(v, b)| *v = f16::from_le_bytes(*b).to_f32());
        } else {
            let singles = bytes.as_chunks::<4>().0.iter().skip(self.channel).step_by(self.channels);
            out.iter_mut().zip(singles).for_each(|(v, b)| *v = f32::from_le_bytes(*b));
        }
        Ok(())
    }
}

/// Bricks as they come out of a file.
#[derive(Default, Clone)]
struct Tree {
    /// Low corners of the leaves [bricks], in the file's order.
    leaves: Vec<IVec3>,
    bricks: Vec<IVec3>,
    values: Vec<BrickValues>,
    /// Box around leaves and tiles [bricks].
    bounds: Option<(IVec3, IVec3)>,
    /// Constant cubes: low corner, edge [bricks], value.
    tiles: Vec<(IVec3, i32, f32)>,
    /// Bricks in all tiles.
    tile_bricks: u64,
}

/// Either kind of failure while the tree's shape is read.
enum Failure {
    File(VdbProblem),
    Grid(GridError),
}

impl From<VdbProblem> for Failure {
    fn from(problem: VdbProblem) -> Self {
        Self::File(problem)
    }
}

impl Failure {
    fn into_problem(self, name: &str) -> VdbProblem {
        match self {
            Self::File(problem) => problem,
            Self::Grid(error) => VdbProblem::Grid { name: name.to_owned(), error },
        }
    }
}

impl Tree {
    fn read_topology(&mut self, stream: &mut Stream, limit_bytes: u64) -> Result<(), Failure> {
        stream.cursor.take(4, "the number of buffers")?;
        stream.background = stream.value("the background")?;
        if stream.background != 0.0 {
            let what = format!(
                "the background is {}; a density must be 0 outside (is this a level set? convert it to a fog volume)",
                stream.background
            );
            return Err(stream.cursor.unsupported(what).into());
        }
        let tile_count = stream.cursor.u32("the number of root tiles")?;
        let child_count = stream.cursor.u32("the number of root children")?;
        let mut seen = BTreeSet::new();
        for _ in 0..tile_count {
            let corner = root_corner(&mut stream.cursor, &mut seen)?;
            let value = stream.value("a root tile")?;
            stream.cursor.take(1, "a root tile")?;
            self.add_tile(corner, UPPER.voxels(), value, limit_bytes)?;
        }
        for _ in 0..child_count {
            let corner = root_corner(&mut stream.cursor, &mut seen)?;
            let children = self.read_node(stream, UPPER, corner, limit_bytes)?;
            for place in children.on() {
                let corner = corner + UPPER.child_offset(place);
                let leaves = self.read_node(stream, LOWER, corner, limit_bytes)?;
                for place in leaves.on() {
                    stream.mask(LEAF, "the mask of a leaf")?;
                    let corner = corner + LOWER.child_offset(place);
                    self.leaves.push(corner >> 3);
                    self.widen(corner >> 3, 1);
                }
                self.check_memory(limit_bytes)?;
            }
        }
        self.expand_tiles();
        Ok(())
    }

    /// The node's masks and values; keeps its tiles and returns the mask of its children.
    fn read_node<'a>(
        &mut self,
        stream: &mut Stream<'a>,
        kind: NodeKind,
        corner: IVec3,
        limit_bytes: u64,
    ) -> Result<Mask<'a>, Failure> {
        let children = stream.mask(kind, "a node's child mask")?;
        let active = stream.mask(kind, "a node's value mask")?;
        let mut values = [0.0; UPPER.places()];
        let values = &mut values[..kind.places()];
        if stream.version >= NODE_MASK_VERSION {
            stream.values(active, values)?;
        } else {
            let count = kind.places() - children.count();
            stream.values(active, &mut values[..count])?;
            // Old files leave out the places of children; spread from the end, so that nothing is overwritten unread.
            let mut from = count;
            for place in (0..kind.places()).rev() {
                if children.is_on(place) {
                    values[place] = 0.0;
                } else {
                    from -= 1;
                    values[place] = values[from];
                }
            }
        }
        for (place, &value) in values.iter().enumerate() {
            if !children.is_on(place) {
                self.add_tile(corner + kind.child_offset(place), 1 << kind.log2_child, value, limit_bytes)?;
            }
        }
        Ok(children)
    }

    fn add_tile(&mut self, corner: IVec3, edge: i32, value: f32, limit_bytes: u64) -> Result<(), Failure> {
        if value == 0.0 {
            return Ok(());
        }
        self.tiles.push((corner >> 3, edge >> 3, value));
        self.tile_bricks += (edge as u64 >> 3).pow(3);
        self.widen(corner >> 3, edge >> 3);
        self.check_memory(limit_bytes)
    }

    fn widen(&mut self, corner: IVec3, edge: i32) {
        let (low, high) = self.bounds.unwrap_or((corner, corner));
        self.bounds = Some((low.min(corner), high.max(corner + edge - 1)));
    }

    /// Compares what the grid so far will need with the limit.
    fn check_memory(&self, limit_bytes: u64) -> Result<(), Failure> {
        let Some((low, high)) = self.bounds else { return Ok(()) };
        let dims: U64Vec3 = (high - low + 2).as_u64vec3();
        let brick_count = self.tile_bricks + self.leaves.len() as u64;
        let needed_bytes = needed_bytes(dims, brick_count);
        if needed_bytes > limit_bytes {
            return Err(Failure::Grid(GridError::OverMemory {
                voxels: dims * 8,
                brick_count,
                needed_bytes,
                limit_bytes,
            }));
        }
        Ok(())
    }

    fn expand_tiles(&mut self) {
        for &(corner, edge, value) in &self.tiles {
            for place in 0..edge.pow(3) {
                let offset = IVec3::new(place % edge, place / edge % edge, place / edge / edge);
                self.bricks.push(corner + offset);
                self.values.push([value; BRICK_VOXELS]);
            }
        }
    }

    /// The values of all leaves.
    fn read_leaves(&mut self, stream: &mut Stream) -> Result<(), VdbProblem> {
        for &brick in &self.leaves {
            let active = stream.mask(LEAF, "the mask of a leaf")?;
            let mut extra_buffers = 0;
            if stream.version < NODE_MASK_VERSION {
                stream.cursor.take(12, "the corner of a leaf")?;
                extra_buffers = stream.cursor.u8("the number of a leaf's buffers")?.saturating_sub(1);
            }
            let mut in_file_order = [0.0; BRICK_VOXELS];
            stream.values(active, &mut in_file_order)?;
            for _ in 0..extra_buffers {
                stream.buffer(&mut [0.0; BRICK_VOXELS])?;
            }
            if in_file_order.iter().any(|&v| v != 0.0) {
                let mut values = [0.0; BRICK_VOXELS];
                in_file_order.iter().enumerate().for_each(|(place, &v)| values[brick_place(place)] = v);
                self.bricks.push(brick);
                self.values.push(values);
            }
        }
        Ok(())
    }
}

/// Low corner of a child or tile of the root.
fn root_corner(cursor: &mut Cursor, seen: &mut BTreeSet<[i32; 3]>) -> Result<IVec3, VdbProblem> {
    let at = cursor.clone();
    let corner = [(); 3].map(|_| cursor.i32("the corner of a root child"));
    let [x, y, z] = corner;
    let corner = [x?, y?, z?];
    let is_aligned =
        corner.iter().all(|c| c % UPPER.voxels() == 0 && c.unsigned_abs() <= (MAX_COORDINATE - UPPER.voxels()) as u32);
    if !is_aligned {
        return Err(at.malformed(format!(
            "a root child at voxel {corner:?}; multiples of {} within {MAX_COORDINATE} are read",
            UPPER.voxels()
        )));
    }
    if !seen.insert(corner) {
        return Err(at.malformed(format!("a second root child at voxel {corner:?}")));
    }
    Ok(IVec3::from_array(corner))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file with one grid of colours, as OpenVDB stores it without compression: a leaf whose voxel (x, y, z) is `color`, and a
    /// tile of 16 × 8³ voxels… of the lower node's second place.
    fn color_file(is_half: bool, color: impl Fn([usize; 3]) -> [f32; 3]) -> Vec<u8> {
        let text = |out: &mut Vec<u8>, s: &str| {
            out.extend((s.len() as u32).to_le_bytes());
            out.extend(s.as_bytes());
        };
        let put = |out: &mut Vec<u8>, v: [f32; 3]| {
            for x in v {
                if is_half { out.extend(f16::from_f32(x).to_le_bytes()) } else { out.extend(x.to_le_bytes()) }
            }
        };
        let mask = |places: usize, on: Option<usize>| {
            let mut bytes = vec![0u8; places / 8];
            if let Some(i) = on {
                bytes[i / 8] |= 1 << (i % 8);
            }
            bytes
        };
        let mut out = Vec::new();
        out.extend(MAGIC.to_le_bytes());
        out.extend(224u32.to_le_bytes());
        out.extend([0; 8]);
        out.push(1);
        out.extend([b'0'; 36]);
        out.extend(0u32.to_le_bytes());
        out.extend(1u32.to_le_bytes());
        text(&mut out, "fire");
        text(&mut out, &format!("{COLOR_TREE}{}", if is_half { HALF_SUFFIX } else { "" }));
        text(&mut out, "");
        let offsets_at = out.len();
        out.extend([0; 24]);
        let grid_at = out.len() as i64;
        // No compression, no metadata.
        out.extend(0u32.to_le_bytes());
        out.extend(0u32.to_le_bytes());
        text(&mut out, "UniformScaleMap");
        for x in [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 2.0, 2.0, 2.0, 4.0, 4.0, 4.0, 1.0, 1.0, 1.0f64] {
            out.extend(x.to_le_bytes());
        }
        out.extend(1u32.to_le_bytes());
        [0.0f32; 3].iter().for_each(|x| out.extend(x.to_le_bytes()));
        out.extend(0u32.to_le_bytes());
        out.extend(1u32.to_le_bytes());
        [0i32; 3].iter().for_each(|x| out.extend(x.to_le_bytes()));
        for kind in [UPPER, LOWER] {
            out.extend(mask(kind.places(), Some(0)));
            out.extend(mask(kind.places(), None));
            out.push(6);
            for place in 0..kind.places() {
                let is_tile = kind.places() == LOWER.places() && place == 1;
                put(&mut out, if is_tile { [1.0, 2.0, 3.0] } else { [0.0; 3] });
            }
        }
        out.extend(mask(512, None));
        out.extend(mask(512, None));
        out.push(6);
        // OpenVDB's order: x slowest.
        for i in 0..512 {
            put(&mut out, color([i >> 6, i >> 3 & 7, i & 7]));
        }
        let end = out.len() as i64;
        for (i, offset) in [grid_at, grid_at, end].into_iter().enumerate() {
            out[offsets_at + 8 * i..offsets_at + 8 * i + 8].copy_from_slice(&offset.to_le_bytes());
        }
        out
    }

    #[test]
    fn colours_are_read_channel_by_channel() {
        for is_half in [false, true] {
            let color = |[x, y, z]: [usize; 3]| [x as f32, 10.0 + y as f32, 0.25 * z as f32];
            let file = color_file(is_half, color);
            let grids = parse_color_grid(&file, "fire", 1 << 28).expect("a sound file");
            for (channel, grid) in grids.iter().enumerate() {
                for p in [[0, 0, 0], [1, 2, 3], [7, 7, 7], [5, 0, 6]] {
                    let voxel = IVec3::from_array(p.map(|x| x as i32));
                    assert_eq!(grid.voxel(voxel), color(p)[channel], "{p:?}, channel {channel}");
                }
                // The tile beside it along z.
                assert_eq!(grid.voxel(IVec3::new(3, 3, 9)), 1.0 + channel as f32);
                assert_eq!(grid.voxel_size(), 0.5);
            }
            assert!(parse_float_grid(&file, "fire", 1 << 28).is_err(), "colours are no density");
            assert!(parse_color_grid(&file[..file.len() - 1], "fire", 1 << 28).is_err(), "cut");
            assert!(parse_color_grid(&file, "smoke", 1 << 28).is_err());
        }
    }
}
