//! Files of pictures that are not done: a part of the paths of each pixel, to be merged with others, or a checkpoint of the
//! tiles that are done, to go on from.
//!
//! One format for both: a line that says so, a head in JSON with all that the finished picture needs, the tiles, and the
//! SHA-256 of everything before. Numbers are little-endian. A file is of use only whole, and to programs that make the very
//! same picture: the fingerprint in the head, which holds the version, tells.

use crate::output::View;
use crate::output::file::write_atomic_with;
use crate::output::image::Attribute;
use crate::output::sidecar::Sidecar;
use crate::output::{OVERSCAN_MAX, OutputError, RESOLUTION_MAX, check_memory, check_regular, exr};
use crate::render::film::PixelBounds;
use crate::render::layers::Layer;
use crate::render::ledger::{Canvas, Tile};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::HashSet;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What each file begins with; the number is that of the format.
const MAGIC: &[u8; 17] = b"curlsmoke part 2\n";
/// Length of the hash at the end [bytes].
const HASH_LENGTH: u64 = 32;
/// Longest head that is read [bytes]: names of shapes make up most of it.
const HEAD_MAX: u64 = 64 << 20;
/// Memory that a head takes for each byte of its text, at most, and the sums of a pixel for its layers [bytes]: three bytes are
/// an empty entry of a list of parts.
const HEAD_FACTOR: u64 = 256;
/// Shortest tile, of which there is one pixel [bytes].
const TILE_MIN: u64 = 33;
/// Largest edge of a tile that is read [pixels].
const EDGE_MAX: u32 = 4096;

/// What a file is of, and what the picture will need besides its pixels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Head {
    /// Name of the scene.
    pub scene: String,
    /// How the frame comes about; its fingerprint is that of the whole picture.
    pub record: Sidecar,
    /// Size of the frame [pixels].
    pub resolution: [u32; 2],
    /// Which pixels: first column and row, and one past the last; overscan is beyond the frame.
    pub bounds: [i32; 4],
    /// Edge of a tile [pixels].
    pub tile_edge: u32,
    /// Further layers.
    pub layers: Vec<Layer>,
    /// Paths a pixel of the whole picture, at most.
    pub spp: u32,
    /// The first and the last path of each pixel that is in the file, from 1; then tiles hold sums. Finished pixels where `None`.
    pub samples: Option<[u32; 2]>,
    /// What the picture will be written with.
    pub finish: Finish,
}

/// What a picture is written with, besides its pixels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finish {
    /// What the picture says of itself.
    pub attributes: Vec<(String, Attribute)>,
    /// How its pixels are packed.
    pub compression: exr::Compression,
    /// How its layers are put into files.
    pub layout: exr::Layout,
    /// How it looks in its preview, and the exposure there [stops], if it has one.
    pub preview: Option<(View, f64)>,
}

impl Head {
    /// The canvas of the picture.
    pub fn canvas(&self) -> Canvas {
        let [x0, y0, x1, y1] = self.bounds;
        let bounds = PixelBounds { x0, y0, x1, y1 };
        Canvas { resolution: self.resolution, bounds, edge: self.tile_edge, layers: self.layers.clone() }
    }

    /// Tiles of the picture.
    fn tile_count(&self) -> u64 {
        let bounds = self.canvas().bounds;
        let across = |pixels: u32| u64::from(pixels.div_ceil(self.tile_edge));
        across(bounds.width()) * across(bounds.height())
    }

    /// What is wrong with it, if anything: nothing else may be done with a head that was read before this was asked.
    fn problem(&self) -> Option<&'static str> {
        let ([x0, y0, x1, y1], [width, height]) = (self.bounds, self.resolution);
        let is_near = |low: i32, high: i32, size: u32| {
            let (beside, size_max) = (i64::from(OVERSCAN_MAX), i64::from(RESOLUTION_MAX));
            let (low, high, size) = (i64::from(low), i64::from(high), i64::from(size));
            (1..=size_max).contains(&size) && low >= -beside && high <= size + beside
        };
        if x0 >= x1 || y0 >= y1 || !is_near(x0, x1, width) || !is_near(y0, y1, height) {
            return Some("its part of the picture is empty, or larger than that of a scene may be");
        }
        if !(1..=EDGE_MAX).contains(&self.tile_edge) {
            return Some("its tiles have no size");
        }
        if self.samples.is_some_and(|[first, last]| first < 1 || first > last || last > self.spp) {
            return Some("its paths are not those of the picture");
        }
        let mut names = HashSet::new();
        if !self.layers.iter().flat_map(Layer::channels).all(|name| names.insert(name)) {
            return Some("it has a layer twice");
        }
        None
    }
}

/// A file that was found whole. It is not held open: there may be more of them than a program may open.
#[derive(Debug)]
pub struct PartFile {
    /// Where it is.
    pub path: PathBuf,
    /// What it is of.
    pub head: Head,
    identity: Identity,
    memory_limit: u64,
    places: Vec<TilePlace>,
}

/// Where a tile is in a file.
#[derive(Debug, Clone, Copy)]
struct TilePlace {
    index: u64,
    start: u64,
    size: u64,
}

/// What tells that a file is still the one that was found whole.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Identity([i64; 5]);

impl Identity {
    fn of(file: &File) -> io::Result<Self> {
        let m = file.metadata()?;
        Ok(Self([m.dev() as i64, m.ino() as i64, m.size() as i64, m.mtime(), m.mtime_nsec()]))
    }
}

/// A file of a part that is open for its tiles.
pub struct TileReader<'a> {
    part: &'a PartFile,
    file: File,
}

/// Writes a file of the tiles that are done.
///
/// # Errors
/// [`OutputError::Unwritable`] when the file cannot be written.
pub fn write(path: &Path, head: &Head, tiles: &[Option<Arc<Tile>>]) -> Result<(), OutputError> {
    let text =
        serde_json::to_vec(head).map_err(|e| OutputError::Encoding { format: "part", problem: e.to_string() })?;
    write_atomic_with(path, &mut |file| {
        let mut out = Hashing { file: io::BufWriter::with_capacity(1 << 20, file), hash: Sha256::new() };
        out.put(MAGIC)?;
        out.put(&(text.len() as u64).to_le_bytes())?;
        out.put(&text)?;
        let mut bytes = Vec::new();
        for (index, tile) in tiles.iter().enumerate() {
            let Some(tile) = tile else { continue };
            bytes.clear();
            tile.encode(&mut bytes);
            out.put(&(index as u64).to_le_bytes())?;
            out.put(&(bytes.len() as u64).to_le_bytes())?;
            out.put(&bytes)?;
        }
        let hash = out.hash.finalize();
        out.file.write_all(&hash)?;
        out.file.flush()
    })
}

struct Hashing<W> {
    file: W,
    hash: Sha256,
}

impl<W: Write> Hashing<W> {
    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hash.update(bytes);
        self.file.write_all(bytes)
    }
}

impl PartFile {
    /// Reads the head of a file and where its tiles are, and makes sure that it is whole. No more memory is taken for it, now or later,
    /// than `memory_limit` [bytes], whatever it holds.
    ///
    /// # Errors
    /// When it is missing, unreadable, no such file, of another format, cut short or damaged, or would take more memory.
    pub fn open(path: &Path, memory_limit: u64) -> Result<Self, OutputError> {
        let unreadable = |cause: io::Error| match cause.kind() {
            io::ErrorKind::NotFound => OutputError::Missing { path: path.into() },
            _ => OutputError::Unreadable { path: path.into(), cause },
        };
        let invalid =
            |problem: &str| OutputError::Invalid { path: path.into(), format: "part", problem: problem.into() };
        check_regular(path).map_err(unreadable)?;
        let mut file = File::open(path).map_err(unreadable)?;
        let length = file.metadata().map_err(unreadable)?.len();
        let mut magic = Vec::new();
        (&mut file).take(MAGIC.len() as u64).read_to_end(&mut magic).map_err(unreadable)?;
        if magic != MAGIC {
            return Err(invalid(match magic.starts_with(b"curlsmoke part ") {
                true => "it is of another format, which only the program that made it reads",
                false => "it does not begin as one; parts are what `curlsmoke render --samples` writes",
            }));
        }
        const DAMAGED: &str = "it is cut short or damaged; render it again";
        let end = length.checked_sub(HASH_LENGTH).ok_or_else(|| invalid(DAMAGED))?;
        if !is_whole(&mut file, end).map_err(unreadable)? {
            return Err(invalid(DAMAGED));
        }
        let mut at = MAGIC.len() as u64;
        let number = |file: &mut File, at: &mut u64| -> Result<u64, OutputError> {
            let mut bytes = [0; 8];
            file.seek(SeekFrom::Start(*at)).and_then(|_| file.read_exact(&mut bytes)).map_err(unreadable)?;
            *at += 8;
            Ok(u64::from_le_bytes(bytes))
        };
        let head_length = number(&mut file, &mut at)?;
        if head_length > HEAD_MAX || head_length > end.saturating_sub(at) {
            return Err(invalid("its head is too long"));
        }
        check_memory(path, HEAD_FACTOR * head_length, memory_limit)?;
        let mut text = vec![0; head_length as usize];
        file.read_exact(&mut text).map_err(unreadable)?;
        at += head_length;
        let head: Head = serde_json::from_slice(&text).map_err(|e| invalid(&format!("its head: {e}")))?;
        if let Some(problem) = head.problem() {
            return Err(invalid(problem));
        }
        let tiles = head.tile_count();
        let mut places: Vec<TilePlace> = Vec::new();
        while at < end {
            if end - at < 16 {
                return Err(invalid("its tiles do not end where it does"));
            }
            let (index, size) = (number(&mut file, &mut at)?, number(&mut file, &mut at)?);
            let is_next = places.last().is_none_or(|last| index > last.index);
            if index >= tiles || !is_next || !(TILE_MIN..=end - at).contains(&size) {
                return Err(invalid("its tiles are out of order, too short or too long"));
            }
            places.push(TilePlace { index, start: at, size });
            check_memory(path, (places.capacity() * size_of::<TilePlace>()) as u64, memory_limit)?;
            at += size;
        }
        let identity = Identity::of(&file).map_err(unreadable)?;
        Ok(Self { path: path.into(), head, identity, memory_limit, places })
    }

    /// Memory that it takes to know where its tiles are [bytes].
    pub fn memory_bytes(&self) -> u64 {
        (self.places.capacity() * size_of::<TilePlace>()) as u64
    }

    /// Tiles in the file, and in the picture.
    pub fn tile_counts(&self) -> [usize; 2] {
        [self.places.len(), self.head.canvas().tiles().len()]
    }

    /// Length of a tile [bytes]; 0 where it is not in the file.
    pub fn tile_size(&self, index: usize) -> u64 {
        self.place(index).map_or(0, |place| place.size)
    }

    fn place(&self, index: usize) -> Option<TilePlace> {
        self.places.binary_search_by_key(&(index as u64), |place| place.index).ok().map(|i| self.places[i])
    }

    /// Opens the file again, for its tiles.
    ///
    /// # Errors
    /// When it can no longer be read, or is another one by now.
    pub fn reader(&self) -> Result<TileReader<'_>, OutputError> {
        let unreadable = |cause| OutputError::Unreadable { path: self.path.clone(), cause };
        let file = File::open(&self.path).map_err(unreadable)?;
        if Identity::of(&file).map_err(unreadable)? != self.identity {
            let problem = "it was written anew while it was read; start again".into();
            return Err(OutputError::Invalid { path: self.path.clone(), format: "part", problem });
        }
        Ok(TileReader { part: self, file })
    }

    /// All tiles at their places.
    ///
    /// # Errors
    /// When a tile is not what the head says, or all of them take too much memory.
    pub fn tiles(&self) -> Result<Vec<Option<Arc<Tile>>>, OutputError> {
        let canvas = self.head.canvas();
        let is_sums = self.head.samples.is_some();
        check_memory(&self.path, self.places.iter().map(|place| place.size).sum(), self.memory_limit)?;
        let mut reader = self.reader()?;
        let mut tiles = Vec::new();
        for (index, bounds) in canvas.tiles().iter().enumerate() {
            let tile = match reader.tile_bytes(index)? {
                Some(bytes) => {
                    Some(Tile::decode(&bytes, &canvas, bounds, is_sums).ok_or_else(|| self.bad_tile(index))?)
                }
                None => None,
            };
            tiles.push(tile.map(Arc::new));
        }
        Ok(tiles)
    }

    /// Makes sure that the picture of this file fits into memory.
    ///
    /// # Errors
    /// [`OutputError::TooLarge`] when not.
    pub fn check_memory(&self) -> Result<(), OutputError> {
        /// A pixel in tiles, in the film and in the picture, a number of a further layer, and a tile besides its pixels [bytes].
        const PIXEL_BYTES: u64 = 96;
        const LAYER_BYTES: u64 = 12;
        const TILE_BYTES: u64 = 256;
        let canvas = self.head.canvas();
        let channels = canvas.channel_count() as u64;
        let pixels = canvas.bounds.area() as u64;
        let needed = pixels.saturating_mul(PIXEL_BYTES + channels.saturating_mul(LAYER_BYTES));
        let tiles = self.head.tile_count().saturating_mul(TILE_BYTES);
        check_memory(&self.path, needed.saturating_add(tiles), self.memory_limit)
    }

    /// The error of a tile whose bytes are not those of such a tile.
    pub fn bad_tile(&self, index: usize) -> OutputError {
        let problem = format!("tile {index} is not what its head says; render it again");
        OutputError::Invalid { path: self.path.clone(), format: "part", problem }
    }
}

impl TileReader<'_> {
    /// The bytes of a tile; `None` where it is not in the file.
    ///
    /// # Errors
    /// When the file can no longer be read.
    pub fn tile_bytes(&mut self, index: usize) -> Result<Option<Vec<u8>>, OutputError> {
        let Some(TilePlace { start, size, .. }) = self.part.place(index) else { return Ok(None) };
        let mut bytes = vec![0; size as usize];
        let read = self.file.seek(SeekFrom::Start(start)).and_then(|_| self.file.read_exact(&mut bytes));
        read.map_err(|cause| OutputError::Unreadable { path: self.part.path.clone(), cause })?;
        Ok(Some(bytes))
    }
}

/// Whether a file ends with the hash of its first `end` bytes.
fn is_whole(file: &mut File, end: u64) -> io::Result<bool> {
    file.seek(SeekFrom::Start(0))?;
    let mut hash = Sha256::new();
    let mut piece = vec![0; 1 << 18];
    let mut left = end;
    while left > 0 {
        let wanted = left.min(piece.len() as u64) as usize;
        let read = file.read(&mut piece[..wanted])?;
        if read == 0 {
            return Ok(false);
        }
        hash.update(&piece[..read]);
        left -= read as u64;
    }
    let mut written = [0; HASH_LENGTH as usize];
    file.read_exact(&mut written)?;
    Ok(hash.finalize()[..] == written[..])
}
