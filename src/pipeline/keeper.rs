//! Keeps what is done of a frame while it is made: checkpoints to go on from, and pictures of it for whoever asks.

use crate::output::OutputError;
use crate::output::View as ScreenView;
use crate::output::exr::Layout;
use crate::output::file::write_atomic;
use crate::output::part::{self, Finish, Head, PartFile};
use crate::output::sidecar::Sidecar;
use crate::pipeline::frame_files::{OutputFiles, Target, encode, finish_of};
use crate::pipeline::{RenderJob, memory_limit};
use crate::progress::Progress;
use crate::render::ledger::{Ledger, Tile};
use crate::render::tiles::{self, View};
use crate::scene::Scene;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Keeps what is done of one frame.
pub(super) struct Keeper<'a> {
    head: Head,
    checkpoint: PathBuf,
    snapshot: Target,
    every: Option<Duration>,
    /// Passes over all tiles leave none done before the end.
    is_in_passes: bool,
    memory_limit: u64,
    last: Mutex<Instant>,
    progress: &'a dyn Progress,
}

impl<'a> Keeper<'a> {
    /// For a frame that is about to be made; `record` says how.
    pub(super) fn new(
        scene: &Scene,
        view: &View,
        files: &OutputFiles,
        job: &RenderJob,
        record: &Sidecar,
        progress: &'a dyn Progress,
    ) -> Self {
        let canvas = tiles::canvas(view);
        let b = view.bounds;
        let head = Head {
            scene: scene.name().into(),
            record: record.clone(),
            resolution: view.resolution,
            bounds: [b.x0, b.y0, b.x1, b.y1],
            tile_edge: canvas.edge,
            layers: canvas.layers,
            spp: view.spp,
            samples: job.samples,
            finish: finish_of(scene, view, record),
        };
        Self {
            head,
            checkpoint: files.checkpoint(record.frame),
            snapshot: files.snapshot(record.frame),
            every: job.checkpoint,
            is_in_passes: view.time_limit.is_some(),
            memory_limit: memory_limit(scene),
            last: Mutex::new(Instant::now()),
            progress,
        }
    }

    pub(super) fn head(&self) -> &Head {
        &self.head
    }

    /// The tiles of the checkpoint that an earlier run left, if it is of this very frame.
    pub(super) fn load(&self) -> Vec<Option<Arc<Tile>>> {
        if self.is_in_passes {
            return Vec::new();
        }
        let frame = self.head.record.frame;
        let unused = |why: &str| {
            self.progress
                .note(&format!("frame {frame}: the checkpoint {} is not used: {why}", self.checkpoint.display()));
            Vec::new()
        };
        let file = match PartFile::open(&self.checkpoint, self.memory_limit) {
            Ok(file) => file,
            Err(OutputError::Missing { .. }) => return Vec::new(),
            Err(error) => return unused(&error.to_string()),
        };
        let [own, other] = [&self.head, &file.head];
        if (&own.record.fingerprint, own.samples, own.canvas())
            != (&other.record.fingerprint, other.samples, other.canvas())
        {
            return unused("the scene, a file that it names, or the program has changed since");
        }
        match file.tiles() {
            Ok(tiles) => {
                let done = tiles.iter().flatten().count();
                self.progress
                    .note(&format!("frame {frame}: goes on from a checkpoint with {done} of {} tiles", tiles.len()));
                tiles
            }
            Err(error) => unused(&error.to_string()),
        }
    }

    /// A tile is done: writes what is due.
    pub(super) fn look(&self, ledger: &Ledger) {
        // Whoever finds another one at it has nothing to do.
        let Ok(mut last) = self.last.try_lock() else { return };
        if self.progress.takes_snapshot() {
            self.take_snapshot(ledger);
        }
        if self.every.is_some_and(|every| last.elapsed() >= every) && !self.is_in_passes {
            self.save(ledger);
            *last = Instant::now();
        }
    }

    /// Writes a checkpoint of what is done. That it cannot be written ends no render, for there may be space by the next time.
    pub(super) fn save(&self, ledger: &Ledger) {
        let tiles = ledger.tiles();
        let done = tiles.iter().flatten().count();
        if self.every.is_none() || self.is_in_passes || done == 0 {
            return;
        }
        self.progress.set_writing(true);
        let written = part::write(&self.checkpoint, &self.head, &tiles);
        self.progress.set_writing(false);
        let frame = self.head.record.frame;
        self.progress.note(&match written {
            Ok(()) => format!("frame {frame}: checkpoint of {done} tiles in {}", self.checkpoint.display()),
            Err(error) => format!("frame {frame}: no checkpoint: {error}"),
        });
    }

    /// Removes the checkpoint of a frame that is finished.
    pub(super) fn forget(&self) {
        if self.checkpoint.exists()
            && let Err(cause) = std::fs::remove_file(&self.checkpoint)
        {
            self.progress.note(&format!("{}: cannot be removed: {cause}", self.checkpoint.display()));
        }
    }

    fn take_snapshot(&self, ledger: &Ledger) {
        let head = &self.head;
        let tiles = ledger.tiles();
        let [done, all] = [tiles.iter().flatten().count(), head.canvas().tiles().len()];
        let film = head.canvas().film(head.spp, &tiles);
        // Whoever asks wants to look at it.
        let preview = head.finish.preview.or(Some((ScreenView::Standard, 0.0)));
        // One file, whatever the picture will have.
        let finish = Finish { preview, layout: Layout::Single, ..head.finish.clone() };
        self.progress.set_writing(true);
        let written = encode(&self.snapshot, film, finish)
            .and_then(|files| files.iter().try_for_each(|(path, bytes)| write_atomic(path, bytes)));
        self.progress.set_writing(false);
        let frame = head.record.frame;
        self.progress.note(&match written {
            Ok(()) => format!("frame {frame}: {done} of {all} tiles in {}", self.snapshot.image.display()),
            Err(error) => format!("frame {frame}: no picture of what is done: {error}"),
        });
    }
}
