//! Tiles of a picture while it is made: which are done, what each has come to, and how they become a film.
//!
//! A tile holds either finished pixels, or, where the run traces a part of the paths only, the exact sums that such parts are
//! joined by. Both can be written and read, which makes files of parts and checkpoints.

use crate::render::film::{Film, PathCounts, Pixel, PixelBounds, PixelSum};
use crate::render::layers::{Layer, Middle};
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What a picture is cut into tiles by; equal for all parts of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Canvas {
    /// Size of the frame [pixels].
    pub resolution: [u32; 2],
    /// Which pixels are rendered.
    pub bounds: PixelBounds,
    /// Edge of a tile [pixels].
    pub edge: u32,
    /// The further layers of the picture.
    pub layers: Vec<Layer>,
}

/// A part of the picture that is done.
#[derive(Debug, Clone)]
pub struct Tile {
    /// What it has come to.
    pub content: TileContent,
    /// What became of its paths.
    pub counts: PathCounts,
}

/// What a tile has come to.
#[derive(Debug, Clone)]
pub enum TileContent {
    /// Pixels after all their paths.
    Finished {
        /// The pixels, top row first.
        pixels: Vec<Pixel>,
        /// Numbers of the further layers: for each pixel the channels of all layers in their order.
        layer_data: Vec<f32>,
    },
    /// For each pixel its sums, and what its middle meets where a layer asks for it, as they are written.
    Sums(Vec<u8>),
}

/// Who is told of each tile that is done, from any thread.
pub type Watcher<'a> = &'a (dyn Fn(&Ledger) + Sync);

/// Tiles of a picture that are done.
pub struct Ledger<'a> {
    /// The paths of each pixel that the run traces, from 0; all where `None`. Then tiles hold finished pixels, else sums.
    pub samples: Option<Range<u32>>,
    tiles: Mutex<Vec<Option<Arc<Tile>>>>,
    watcher: Option<Watcher<'a>>,
}

impl<'a> Ledger<'a> {
    /// With the tiles that an earlier run has done, if any, in the order of [`Canvas::tiles`].
    pub fn new(samples: Option<Range<u32>>, done: Vec<Option<Arc<Tile>>>, watcher: Option<Watcher<'a>>) -> Self {
        Self { samples, tiles: Mutex::new(done), watcher }
    }

    /// Whether a tile is done.
    pub fn is_done(&self, index: usize) -> bool {
        self.lock().get(index).is_some_and(Option::is_some)
    }

    /// Takes a tile that is done.
    pub fn put(&self, index: usize, tile: Tile) {
        let mut tiles = self.lock();
        if tiles.len() <= index {
            tiles.resize(index + 1, None);
        }
        tiles[index] = Some(Arc::new(tile));
        drop(tiles);
        if let Some(watcher) = self.watcher {
            watcher(self);
        }
    }

    /// All tiles that are done, at their places.
    pub fn tiles(&self) -> Vec<Option<Arc<Tile>>> {
        self.lock().clone()
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Option<Arc<Tile>>>> {
        self.tiles.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Canvas {
    /// The tiles, row by row.
    pub fn tiles(&self) -> Vec<PixelBounds> {
        let (bounds, edge) = (self.bounds, self.edge);
        let rows = (bounds.y0..bounds.y1).step_by(edge as usize);
        let tile = move |x0: i32, y0: i32| PixelBounds {
            x0,
            y0,
            x1: x0.saturating_add_unsigned(edge).min(bounds.x1),
            y1: y0.saturating_add_unsigned(edge).min(bounds.y1),
        };
        rows.flat_map(|y0| (bounds.x0..bounds.x1).step_by(edge as usize).map(move |x0| tile(x0, y0))).collect()
    }

    /// Channels of all further layers.
    pub fn channel_count(&self) -> usize {
        self.layers.iter().map(Layer::channel_count).sum()
    }

    /// Whether a layer asks for what the middle of a pixel meets.
    pub fn needs_middle(&self) -> bool {
        self.layers.iter().any(Layer::is_of_the_middle)
    }

    /// Puts tiles in their places; where one is missing, or is no tile of this canvas, pixels are black and empty. Counts are
    /// added in the order of the tiles, so that their sum has no luck in it either. `spp` is the most paths a pixel.
    pub fn film(&self, spp: u32, tiles: &[Option<Arc<Tile>>]) -> Film {
        let channels = self.channel_count();
        let mut pixels = vec![Pixel::default(); self.bounds.area()];
        let mut layer_data = vec![0.0; self.bounds.area() * channels];
        let mut paths = PathCounts::default();
        let width = self.bounds.width() as usize;
        for (bounds, tile) in self.tiles().iter().zip(tiles) {
            let Some(tile) = tile else { continue };
            let merged;
            let tile = match &tile.content {
                TileContent::Finished { .. } => &**tile,
                TileContent::Sums(bytes) => match self.join(bounds, &[(bytes, tile.counts)]) {
                    Some(tile) => {
                        merged = tile;
                        &merged
                    }
                    None => continue,
                },
            };
            let TileContent::Finished { pixels: own_pixels, layer_data: own_data } = &tile.content else { continue };
            paths.add(&tile.counts);
            let tile_width = bounds.width() as usize;
            for row in 0..bounds.height() as usize {
                let at = self.bounds.index(bounds.x0, bounds.y0) + row * width;
                let own = row * tile_width;
                pixels[at..at + tile_width].copy_from_slice(&own_pixels[own..own + tile_width]);
                layer_data[at * channels..(at + tile_width) * channels]
                    .copy_from_slice(&own_data[own * channels..(own + tile_width) * channels]);
            }
        }
        let (resolution, bounds, layers) = (self.resolution, self.bounds, self.layers.clone());
        Film { resolution, bounds, pixels, layers, layer_data, spp, paths }
    }

    /// The finished tile from the sums of all its parts; `None` where one is not the sums of such a tile.
    pub fn join(&self, bounds: &PixelBounds, parts: &[(&[u8], PathCounts)]) -> Option<Tile> {
        let mut counts = PathCounts::default();
        parts.iter().for_each(|(_, more)| counts.add(more));
        let mut rest: Vec<&[u8]> = parts.iter().map(|(bytes, _)| *bytes).collect();
        let mut pixels = Vec::with_capacity(bounds.area());
        let mut layer_data = Vec::with_capacity(bounds.area() * self.channel_count());
        for _ in 0..bounds.area() {
            let mut sum = PixelSum::new(&self.layers);
            let mut middle = None;
            for bytes in &mut rest {
                let (part, seen) = self.next_sums(bytes)?;
                // What is damaged may claim more than there can be.
                sum.moments().count().checked_add(part.moments().count())?;
                sum.merge(&part);
                middle = middle.or(seen);
            }
            pixels.push(sum.finish());
            sum.finish_layers(&self.layers, middle.as_ref(), &mut layer_data);
        }
        let is_all = rest.iter().all(|bytes| bytes.is_empty());
        is_all.then_some(Tile { content: TileContent::Finished { pixels, layer_data }, counts })
    }

    /// Whether bytes are the sums of a tile whose pixels have so many paths each.
    pub fn holds(&self, bounds: &PixelBounds, mut bytes: &[u8], paths: u32) -> bool {
        let mut is_next = || self.next_sums(&mut bytes).is_some_and(|(sum, _)| sum.moments().count() == paths);
        (0..bounds.area()).all(|_| is_next()) && bytes.is_empty()
    }

    fn next_sums(&self, bytes: &mut &[u8]) -> Option<(PixelSum, Option<Middle>)> {
        let sum = PixelSum::decode(bytes, &self.layers)?;
        let middle = match self.needs_middle() {
            true => Some(Middle::from_words(numbers::<{ Middle::LENGTH }>(bytes)?)),
            false => None,
        };
        Some((sum, middle))
    }
}

impl Tile {
    /// Writes the tile at the end of `out`.
    pub fn encode(&self, out: &mut Vec<u8>) {
        let counts = &self.counts;
        let numbers = [counts.traced, counts.truncated, counts.truncated_throughput.to_bits(), counts.bounces];
        numbers.into_iter().for_each(|n| out.extend(n.to_le_bytes()));
        match &self.content {
            TileContent::Finished { pixels, layer_data } => {
                for pixel in pixels {
                    let numbers =
                        pixel.mean.to_array().into_iter().chain(pixel.variance.to_array()).chain([pixel.alpha]);
                    numbers.for_each(|x| out.extend(x.to_le_bytes()));
                }
                layer_data.iter().for_each(|x| out.extend(x.to_le_bytes()));
            }
            TileContent::Sums(bytes) => out.extend(bytes),
        }
    }

    /// Reads what [`encode`](Self::encode) has written of a tile with `bounds`, sums or finished pixels; `None` where it is
    /// nothing such. Sums are looked at when they are joined.
    pub fn decode(bytes: &[u8], canvas: &Canvas, bounds: &PixelBounds, is_sums: bool) -> Option<Self> {
        let (mut bytes, counts) = sums_of(bytes)?;
        let bytes = &mut bytes;
        if is_sums {
            return Some(Self { content: TileContent::Sums(bytes.to_vec()), counts });
        }
        let (area, channels) = (bounds.area(), canvas.channel_count());
        if bytes.len() != 4 * area * (7 + channels) {
            return None;
        }
        let mut pixels = Vec::with_capacity(area);
        for _ in 0..area {
            let [r, g, b, vr, vg, vb, alpha] = numbers::<7>(bytes)?.map(f32::from_bits);
            pixels.push(Pixel { mean: [r, g, b].into(), variance: [vr, vg, vb].into(), alpha });
        }
        let layer_data = bytes.as_chunks().0.iter().map(|number| f32::from_le_bytes(*number)).collect();
        Some(Self { content: TileContent::Finished { pixels, layer_data }, counts })
    }
}

/// The sums of a tile that was [written](Tile::encode), as they are, and what became of its paths.
pub fn sums_of(mut bytes: &[u8]) -> Option<(&[u8], PathCounts)> {
    let mut long = || {
        let [low, high] = numbers::<2>(&mut bytes)?;
        Some(u64::from(high) << 32 | u64::from(low))
    };
    let (traced, truncated, throughput, bounces) = (long()?, long()?, f64::from_bits(long()?), long()?);
    Some((bytes, PathCounts { traced, truncated, truncated_throughput: throughput, bounces }))
}

/// The next numbers of a file.
fn numbers<const N: usize>(bytes: &mut &[u8]) -> Option<[u32; N]> {
    let (first, rest) = bytes.split_at_checked(4 * N)?;
    *bytes = rest;
    let mut words = [0; N];
    words.iter_mut().zip(first.as_chunks().0).for_each(|(word, bytes)| *word = u32::from_le_bytes(*bytes));
    Some(words)
}
