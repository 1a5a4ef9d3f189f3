//! Sees files change, by asking for their stamps again and again.
//!
//! Asking is cheap for the few files of a scene, and unlike notices of the system it is the same on every disk and sees it when another
//! file takes a name, as editors do when they save.

use crate::pipeline::inputs::Stamp;
use std::io;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Time between two looks.
const PERIOD: Duration = Duration::from_millis(25);
/// Looks without any change after which files count as written.
const QUIET_LOOKS: u32 = 2;
/// The same where the first file is not there: some programs take it away before they put a new one in its place.
const GONE_LOOKS: u32 = 20;

/// Looks at files in a thread of its own, which ends with it.
pub struct Sentinel(Arc<Shared>);

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    is_stirred: AtomicBool,
    is_settled: AtomicBool,
    is_over: AtomicBool,
}

#[derive(Default)]
struct State {
    files: Vec<(PathBuf, Stamp)>,
    first_stir: Option<Instant>,
    quiet: u32,
}

impl Sentinel {
    /// Looks at nothing yet.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn start() -> io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let own = shared.clone();
        thread::Builder::new().name("sentinel".into()).spawn(move || {
            while !own.is_over.load(Ordering::Relaxed) {
                own.look();
                thread::sleep(PERIOD);
            }
        })?;
        Ok(Self(shared))
    }

    /// Looks at these from now on, the first of which should always be there; stamps are those of what was read.
    pub fn watch(&self, files: &[(PathBuf, Stamp)]) {
        let mut state = self.0.lock();
        *state = State { files: files.into(), first_stir: None, quiet: 0 };
        self.0.is_stirred.store(false, Ordering::Relaxed);
        self.0.is_settled.store(false, Ordering::Relaxed);
    }

    /// Whether a file is no longer what it was.
    #[inline]
    pub fn is_stirred(&self) -> bool {
        self.0.is_stirred.load(Ordering::Relaxed)
    }

    /// Whether one was changed and then left alone for a moment.
    pub fn is_settled(&self) -> bool {
        self.0.is_settled.load(Ordering::Relaxed)
    }

    /// When a file was first seen changed.
    pub fn first_stir(&self) -> Option<Instant> {
        self.0.lock().first_stir
    }
}

impl Drop for Sentinel {
    fn drop(&mut self) {
        self.0.is_over.store(true, Ordering::Relaxed);
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn look(&self) {
        let state = &mut *self.lock();
        let mut has_changed = false;
        for (path, last) in &mut state.files {
            let now = Stamp::of(path);
            has_changed |= now != *last;
            *last = now;
        }
        if has_changed {
            state.quiet = 0;
            state.first_stir.get_or_insert_with(Instant::now);
            self.is_stirred.store(true, Ordering::Relaxed);
            self.is_settled.store(false, Ordering::Relaxed);
        } else if state.first_stir.is_some() {
            state.quiet += 1;
            let is_there = state.files.first().is_none_or(|(_, stamp)| stamp.exists());
            if state.quiet >= if is_there { QUIET_LOOKS } else { GONE_LOOKS } {
                self.is_settled.store(true, Ordering::Relaxed);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn settles_within(sentinel: &Sentinel, time: Duration) -> bool {
        let start = Instant::now();
        while !sentinel.is_settled() && start.elapsed() < time {
            thread::sleep(Duration::from_millis(5));
        }
        sentinel.is_settled()
    }

    #[test]
    fn writing_renaming_and_removing_are_seen_and_waited_out() {
        let folder = tempfile::tempdir().unwrap();
        let [file, other, draft] = ["scene", "mesh", "draft"].map(|name| folder.path().join(name));
        fs::write(&file, "one").unwrap();
        let sentinel = Sentinel::start().unwrap();
        let watch = || sentinel.watch(&[&file, &other].map(|path| (path.clone(), Stamp::of(path))));
        watch();
        assert!(!settles_within(&sentinel, Duration::from_millis(200)), "nothing has happened");
        let changes: [&dyn Fn(); 5] = [
            &|| fs::write(&file, "two").unwrap(),
            &|| {
                fs::write(&draft, "new").unwrap();
                fs::rename(&draft, &file).unwrap();
            },
            // Backup first, then a new file.
            &|| {
                fs::rename(&file, &draft).unwrap();
                thread::sleep(Duration::from_millis(60));
                fs::write(&file, "three").unwrap();
            },
            &|| fs::write(&other, "appears").unwrap(),
            &|| fs::remove_file(&other).unwrap(),
        ];
        for change in changes {
            watch();
            change();
            assert!(settles_within(&sentinel, Duration::from_secs(10)));
            assert!(sentinel.is_stirred() && sentinel.first_stir().is_some());
            watch();
            assert!(!sentinel.is_stirred(), "what was read is the state to compare with");
        }
    }
}
