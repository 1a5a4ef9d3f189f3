//! `.vdb` files of numbers and vectors, in and out.
//!
//! The format is that of OpenVDB, whose sources are its only description: `openvdb/io/{Archive,Compression,GridDescriptor}`
//! and the `readTopology`, `readBuffers` of the tree's nodes. Read are file versions 220 to 225, trees
//! `Tree_float_5_4_3` and `Tree_vec3s_5_4_3` in single and half precision, uncompressed or with ZIP, Blosc (codecs LZ4 and zlib) and active-mask
//! compression, and transforms of uniform scale and translation. Written is version 224, which every OpenVDB since 2017 reads.
//!
//! OpenVDB's sample (i, j, k) sits at the transform of (i, j, k), ours at the centre of its voxel: the transform carries
//! the half voxel.

mod blosc;
mod bytes;
mod read;
mod tree;
mod write;

pub use read::{
    GridInfo, list_grids, parse_color_grid, parse_float_grid, parse_grid_list, parse_vector_grid, read_color_grid,
    read_float_grid, read_vector_grid,
};
pub use write::{VdbGrid, VdbWriteSettings, write_float_grids, write_grids};

use crate::grid::GridError;
use std::path::PathBuf;

/// First eight bytes of a file, as a little-endian number: " BDV" and zeros.
const MAGIC: u64 = 0x5644_4220;
/// What a file is written as.
const WRITTEN_VERSION: u32 = 224;
const OLDEST_VERSION: u32 = 220;
const NEWEST_VERSION: u32 = 225;
/// From this version on compression is told for each grid, and nodes store what their inactive values are.
const NODE_MASK_VERSION: u32 = 222;

/// Bits of a grid's compression flags.
const COMPRESS_ZIP: u32 = 1;
const COMPRESS_ACTIVE_MASK: u32 = 2;
const COMPRESS_BLOSC: u32 = 4;

const FLOAT_TREE: &str = "Tree_float_5_4_3";
const COLOR_TREE: &str = "Tree_vec3s_5_4_3";
const HALF_SUFFIX: &str = "_HalfFloat";
/// Between a grid's name and the number that makes it unique in its file.
const NAME_SEPARATOR: char = '\u{1e}';

/// A `.vdb` file that could not be read.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct VdbError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    #[source]
    pub problem: VdbProblem,
}

/// What is wrong with a `.vdb` file.
#[derive(Debug, thiserror::Error)]
pub enum VdbProblem {
    /// The file could not be opened or read.
    #[error("{0}")]
    Io(#[from] std::io::Error),
    /// The bytes are not those of a sound file.
    #[error("at byte {offset}: {what}")]
    Malformed {
        /// Where, from the start of the file.
        offset: usize,
        /// What was expected and what was found.
        what: String,
    },
    /// The file is sound, but uses what is not read here.
    #[error("at byte {offset}: {what}")]
    Unsupported {
        /// Where, from the start of the file.
        offset: usize,
        /// What it uses, and what to do.
        what: String,
    },
    /// No grid has the name asked for.
    #[error("no grid is named \"{name}\"; the file has {}", if available.is_empty() { "none".into() } else { available.join(", ") })]
    NoSuchGrid {
        /// What was asked for.
        name: String,
        /// The names in the file.
        available: Vec<String>,
    },
    /// The file alone is larger than the memory limit.
    #[error("the file has {file_bytes} bytes, more than the memory limit of {limit_bytes}")]
    TooLarge {
        /// Size of the file [bytes].
        file_bytes: u64,
        /// What is allowed [bytes].
        limit_bytes: u64,
    },
    /// The grid does not make a density grid.
    #[error("grid \"{name}\": {error}")]
    Grid {
        /// Name of the grid.
        name: String,
        /// Why not.
        #[source]
        error: GridError,
    },
}
