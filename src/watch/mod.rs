//! Looking on while a scene changes: it is read again whenever it, or a file that it names, is saved, and its picture is taken
//! again of what the change did not leave alone.
//!
//! `sentinel.rs` sees files change, `board.rs` holds what is to be seen and what is wished for; `server.rs` shows the board as a local web
//! page, `tev.rs` in the viewer of that name. What is kept from picture to picture is the pipeline's business.

pub mod board;
pub mod sentinel;
pub mod server;
pub mod tev;
pub mod view_table;

use crate::error::Error;
use crate::pipeline::inputs::{self, Part, Stamp};
use crate::pipeline::live::LiveStudio;
use crate::progress::{Progress, Stage};
use crate::render::film::{Film, PixelBounds};
use crate::scene::diagnostic::Diagnostic;
use crate::scene::settings::Settings;
use crate::scene::{Scene, SceneError};
use crate::watch::board::{Board, Picture, Problem, Wishes};
use crate::watch::sentinel::Sentinel;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Pause between two looks at whether there is something to do.
const NAP: Duration = Duration::from_millis(15);
/// A scene with errors is read again so often: a file that it misses may have come.
const RETRY: Duration = Duration::from_secs(1);
/// Least time between two reports of progress.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(100);

/// What to watch and whom to show it.
pub struct Watch<'a> {
    /// The scene file.
    pub path: &'a Path,
    /// Reads the scene, with all flags applied.
    pub load: &'a (dyn Fn() -> Result<Scene, Error> + Sync),
    /// The part of a picture of a size to render, where nobody has wished for another; all of it where `None`.
    pub crop: &'a (dyn Fn([u32; 2]) -> Result<Option<PixelBounds>, Error> + Sync),
    /// What is to be seen, and what people wish.
    pub board: &'a Board,
    /// Who else is shown each picture; must return soon.
    pub show: &'a (dyn Fn(&Picture) + Sync),
    /// Whether to end.
    pub is_stopped: &'a (dyn Fn() -> bool + Sync),
    /// Told what happens.
    pub tell: &'a (dyn Fn(&Event) + Sync),
}

/// What happens while a scene is watched.
#[derive(Debug, Clone)]
pub enum Event {
    /// The scene, or what it names, has errors, as text for people; the last picture stays.
    Faulty(String),
    /// Something that is likely a mistake.
    Note(String),
    /// There is something new to see.
    FirstPixels {
        /// The frame.
        frame: i32,
        /// What was made again.
        made: Vec<Part>,
        /// Time since the change was seen [s].
        seconds: f64,
    },
    /// The picture has all its paths.
    Finished {
        /// The frame.
        frame: i32,
        /// Paths a pixel.
        paths: u32,
        /// Time since the change was seen [s].
        seconds: f64,
    },
}

/// What the last picture was made from, where it was finished.
#[derive(PartialEq)]
struct Finished {
    settings: Settings,
    files: Vec<(PathBuf, Stamp)>,
    serial: u64,
}

impl Watch<'_> {
    /// Watches until stopped. Whatever is wrong with the scene is told, and waited out.
    ///
    /// # Errors
    /// Where no thread can be started.
    pub fn run(&self) -> Result<(), Error> {
        let sentinel = Sentinel::start().map_err(|e| Error::Internal(format!("no thread can be started: {e}")))?;
        let mut studio = LiveStudio::default();
        let mut finished: Option<Finished> = None;
        let mut files = vec![(self.path.to_path_buf(), Stamp::default())];
        let mut told = String::new();
        while !(self.is_stopped)() {
            let since = sentinel.first_stir().unwrap_or_else(Instant::now);
            let wishes = self.board.wishes();
            let own = (self.path.to_path_buf(), Stamp::of(self.path));
            let loaded = (self.load)().and_then(|scene| {
                let frame = frame_of(&scene, &wishes);
                let resolution = scene.settings.film.resolution;
                let crop = match wishes.crop {
                    Some(wished) => wished.and_then(|crop| crop.common(&PixelBounds::whole(resolution))),
                    None => (self.crop)(resolution)?,
                };
                Ok((inputs::files(&scene, frame)?, frame, crop, scene))
            });
            let (scene, frame, crop) = match loaded {
                Ok((mut list, frame, crop, scene)) => {
                    // As it was before it was read.
                    list[0] = own;
                    files = list;
                    (scene, frame, crop)
                }
                Err(error) => {
                    // Those of the last good scene.
                    files[0] = own;
                    sentinel.watch(&files);
                    finished = None;
                    self.fail(&error, &mut told);
                    self.wait(&sentinel, wishes.serial, Some(RETRY));
                    continue;
                }
            };
            sentinel.watch(&files);
            let what = Finished { settings: scene.settings.clone(), files: files.clone(), serial: wishes.serial };
            // Saved without a change.
            if finished.as_ref() != Some(&what) {
                finished = None;
                let warnings = problems(&scene.warnings);
                if warnings.is_empty() {
                    told.clear()
                } else {
                    self.note_once(&scene, &mut told)
                }
                self.board.begin(&scene, frame, crop, warnings);
                let watcher = Watcher::new(self, &sentinel, wishes.serial);
                match self.take(&mut studio, &scene, frame, crop, since, &watcher) {
                    Ok(()) => finished = Some(what),
                    Err(error) if error.is_cancelled() => {}
                    Err(error) => self.fail(&error, &mut told),
                }
            }
            self.wait(&sentinel, wishes.serial, None);
        }
        Ok(())
    }

    /// Takes one picture, unless something comes in between.
    fn take(
        &self,
        studio: &mut LiveStudio,
        scene: &Scene,
        frame: i32,
        crop: Option<PixelBounds>,
        since: Instant,
        watcher: &Watcher,
    ) -> Result<(), Error> {
        let made = studio.prepare(scene, frame, watcher)?;
        let mut is_first = true;
        let mut show = |film: Film, paths: u32| {
            let seconds = since.elapsed().as_secs_f64();
            let first = is_first.then_some(made.as_slice());
            self.board.put(&film, paths, first, seconds, self.show);
            if is_first {
                (self.tell)(&Event::FirstPixels { frame, made: made.clone(), seconds });
            }
            is_first = false;
        };
        // The frame, without overscan.
        let shown = crop.unwrap_or(PixelBounds::whole(scene.settings.film.resolution));
        studio.expose(scene, frame, Some(shown), watcher, &mut show)?;
        self.board.finish();
        let (paths, seconds) = (scene.settings.film.spp, since.elapsed().as_secs_f64());
        (self.tell)(&Event::Finished { frame, paths, seconds });
        Ok(())
    }

    /// Waits for files to change, for a wish, for the end, or for some time.
    fn wait(&self, sentinel: &Sentinel, serial: u64, most: Option<Duration>) {
        let start = Instant::now();
        let is_over = || most.is_some_and(|most| start.elapsed() >= most && sentinel.first_stir().is_none());
        while !(sentinel.is_settled() || (self.is_stopped)() || is_over()) {
            // A wish need not wait for files that are being written, but what is read must be whole.
            if self.board.wishes().serial != serial && sentinel.first_stir().is_none() {
                return;
            }
            thread::sleep(NAP);
        }
    }

    /// Tells of an error, once.
    fn fail(&self, error: &Error, told: &mut String) {
        let text = match error {
            Error::Scene(error) => error.to_string(),
            error => format!("error: {error}"),
        };
        if *told != text {
            self.board.fail(match error {
                Error::Scene(SceneError::Faulty(diagnostics)) => problems(diagnostics),
                error => vec![Problem::of_text(error)],
            });
            (self.tell)(&Event::Faulty(text.clone()));
            *told = text;
        }
    }

    /// Tells of warnings, once.
    fn note_once(&self, scene: &Scene, told: &mut String) {
        let text = scene.warnings.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
        if *told != text {
            (self.tell)(&Event::Note(text.clone()));
            *told = text;
        }
    }
}

/// The frame that is wished for, or the nearest that the scene has.
fn frame_of(scene: &Scene, wishes: &Wishes) -> i32 {
    let frames = &scene.settings.frames;
    wishes.frame.unwrap_or(frames.first).clamp(frames.first, frames.last)
}

fn problems(diagnostics: &[Diagnostic]) -> Vec<Problem> {
    diagnostics.iter().map(Problem::of_diagnostic).collect()
}

/// Tells the work to stop as soon as something has changed, and the board how far it is.
struct Watcher<'a> {
    watch: &'a Watch<'a>,
    sentinel: &'a Sentinel,
    serial: u64,
    done: AtomicU64,
    total: AtomicU64,
    start: Instant,
    last: AtomicU64,
}

impl<'a> Watcher<'a> {
    fn new(watch: &'a Watch<'a>, sentinel: &'a Sentinel, serial: u64) -> Self {
        let zero = || AtomicU64::new(0);
        Self { watch, sentinel, serial, done: zero(), total: zero(), start: Instant::now(), last: zero() }
    }
}

impl Progress for Watcher<'_> {
    fn begin(&self, stage: Stage, total: u64) {
        self.done.store(0, Ordering::Relaxed);
        self.total.store(total, Ordering::Relaxed);
        self.watch.board.progress(Some(stage), 0.0);
    }

    fn advance(&self, units: u64) {
        let done = self.done.fetch_add(units, Ordering::Relaxed) + units;
        let now = self.start.elapsed().as_millis() as u64;
        let last = self.last.load(Ordering::Relaxed);
        let is_due = now - last.min(now) >= PROGRESS_INTERVAL.as_millis() as u64;
        if is_due && self.last.compare_exchange(last, now, Ordering::Relaxed, Ordering::Relaxed).is_ok() {
            let total = self.total.load(Ordering::Relaxed).max(1);
            self.watch.board.progress(None, (done as f64 / total as f64).min(1.0));
        }
    }

    fn note(&self, text: &str) {
        (self.watch.tell)(&Event::Note(text.into()));
    }

    fn is_cancelled(&self) -> bool {
        self.sentinel.is_stirred() || self.watch.board.serial() != self.serial || (self.watch.is_stopped)()
    }
}
