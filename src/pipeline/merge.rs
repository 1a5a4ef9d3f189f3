//! Joins parts of the paths, traced by runs of their own, into the pictures that one run would have written.

use crate::error::Error;
use crate::math::parallel;
use crate::output::frames::check_distinct;
use crate::output::part::PartFile;
use crate::output::sidecar::{MergedPart, Sidecar};
use crate::output::{check_memory, part_set};
use crate::pipeline::frame_files::{Target, check_writable, layer_files, layers_apart, name_of, write_picture};
use crate::pipeline::parse_pattern;
use crate::progress::Progress;
use crate::render::ledger::{Tile, sums_of};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// Tiles that are read before they are joined, on all threads, and their bytes in all parts, unless a single one has more.
const TILES_AT_ONCE: usize = 256;
const BYTES_AT_ONCE: u64 = 64 << 20;

/// What to merge.
#[derive(Debug, Clone)]
pub struct MergeJob<'a> {
    /// Files of parts, of one frame or several, in any order.
    pub parts: Vec<PathBuf>,
    /// Pattern of the pictures' names; previews go beside them.
    pub output: &'a str,
    /// Memory that may be used [bytes].
    pub memory_limit: u64,
    /// What the program was started with, for the sidecars.
    pub arguments: Vec<String>,
}

/// Merges; `on_frame` gets each picture that was written. Nothing is written unless all frames are complete.
///
/// # Errors
/// A part that is unusable or does not belong to the others, paths that are in no part or in two, and what writing meets.
pub fn merge(
    job: &MergeJob,
    progress: &dyn Progress,
    on_frame: &mut dyn FnMut(&PathBuf, &Sidecar),
) -> Result<(), Error> {
    let mut frames: BTreeMap<i32, Vec<PartFile>> = BTreeMap::new();
    let mut held = 0;
    for path in &job.parts {
        let part = PartFile::open(path, job.memory_limit.saturating_sub(held))?;
        part.check_memory()?;
        held += part.memory_bytes();
        frames.entry(part.head.record.frame).or_default().push(part);
    }
    for parts in frames.values_mut() {
        part_set::check(parts)?;
    }
    let pattern = parse_pattern(job.output)?;
    let targets: BTreeMap<i32, Target> = frames
        .iter()
        .map(|(&frame, parts)| {
            let image = PathBuf::from(pattern.expand(frame, &parts[0].head.scene));
            let preview = parts[0].head.finish.preview.map(|_| image.with_extension("png"));
            let head = &parts[0].head;
            let layers = layers_apart(head.finish.layout, &head.layers);
            let layers = layer_files(&pattern, &layers, frame, &head.scene);
            (frame, Target { image, layers, preview })
        })
        .collect();
    let numbers: Vec<i32> = frames.keys().copied().collect();
    check_distinct(&numbers, |frame| targets[&frame].image.clone())?;
    check_writable(targets.values().map(|target| {
        let layers = target.layers.iter().map(|(_, path)| path.clone());
        [target.image.clone()].into_iter().chain(layers).chain(target.preview.clone())
    }))?;
    let count = frames.len();
    for (index, ((frame, parts), target)) in frames.into_iter().zip(targets.values()).enumerate() {
        progress.frame(frame, index, count);
        let tiles = join(&parts, job.memory_limit)?;
        let head = &parts[0].head;
        let film = head.canvas().film(head.spp, &tiles);
        drop(tiles);
        let mut record = record_of(&parts, job);
        let traced = film.paths.traced.max(1) as f64;
        record.truncated_paths = film.paths.truncated as f64 / traced;
        record.truncated_light = film.paths.truncated_throughput / traced;
        let path = write_picture(target, film, head.finish.clone(), progress, &mut record)?;
        on_frame(&path, &record);
    }
    Ok(())
}

/// The finished tiles of a picture.
fn join(parts: &[PartFile], memory_limit: u64) -> Result<Vec<Option<Arc<Tile>>>, Error> {
    let canvas = parts[0].head.canvas();
    let bounds = canvas.tiles();
    let mut tiles = Vec::with_capacity(bounds.len());
    while tiles.len() < bounds.len() {
        let first = tiles.len();
        let bounds = &bounds[first..first + tiles_at_once(parts, first, bounds.len(), memory_limit)?];
        let mut read = vec![Vec::with_capacity(parts.len()); bounds.len()];
        // A part at a time, for so many files cannot be open at once.
        for part in parts {
            let mut reader = part.reader()?;
            for (i, read) in read.iter_mut().enumerate() {
                read.push(reader.tile_bytes(first + i)?.unwrap_or_default());
            }
        }
        let joined = parallel::try_map(read.iter().zip(bounds), |i, (bytes, bounds)| {
            let mut sums = Vec::new();
            for (part, bytes) in parts.iter().zip(bytes) {
                let bad = || part.bad_tile(first + i);
                let own = sums_of(bytes).ok_or_else(bad)?;
                // Alone, so that whichever is at fault is named.
                let [from, to] = part.head.samples.unwrap_or_default();
                if !canvas.holds(bounds, own.0, to - from + 1) {
                    return Err(bad());
                }
                sums.push(own);
            }
            canvas.join(bounds, &sums).ok_or_else(|| parts[0].bad_tile(first + i))
        })?;
        tiles.extend(joined.into_iter().map(|tile| Some(Arc::new(tile))));
    }
    Ok(tiles)
}

/// How many tiles to read, from `first` on, of `count` in all.
fn tiles_at_once(parts: &[PartFile], first: usize, count: usize, memory_limit: u64) -> Result<usize, Error> {
    let bytes_of = |index: usize| parts.iter().map(|part| part.tile_size(index)).sum::<u64>();
    let mut bytes = bytes_of(first);
    check_memory(&parts[0].path, bytes, memory_limit)?;
    let mut end = first + 1;
    while end < count.min(first + TILES_AT_ONCE) {
        bytes += bytes_of(end);
        if bytes > BYTES_AT_ONCE.min(memory_limit) {
            break;
        }
        end += 1;
    }
    Ok(end - first)
}

/// How a merged frame came about.
fn record_of(parts: &[PartFile], job: &MergeJob) -> Sidecar {
    let mut record = parts[0].head.record.clone();
    record.seconds.clear();
    record.samples_per_second = 0.0;
    record.tiles_resumed = 0;
    record.arguments.clone_from(&job.arguments);
    record.files.clear();
    for part in parts {
        let own = &part.head.record;
        own.seconds.iter().for_each(|(stage, seconds)| *record.seconds.entry(stage.clone()).or_default() += seconds);
        record.samples_per_second += own.samples_per_second;
        record.parts.push(MergedPart {
            name: name_of(&part.path),
            samples: part.head.samples.unwrap_or_default(),
            arguments: own.arguments.clone(),
            seconds: own.seconds.clone(),
            host: own.host.clone(),
        });
    }
    record
}
