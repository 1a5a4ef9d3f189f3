//! USR1 asks for a picture of what is done so far. The first Ctrl-C, TERM or HUP asks the work to stop at the next safe place; the second ends the program at once, and
//! so does time where the work does not come to such a place soon. No file is ever left half written under its final
//! name.

use crate::cli::{STOPPED, log};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1};
use signal_hook::flag;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

/// What work is allowed to take until it stops by itself.
const GRACE: Duration = Duration::from_secs(3);

/// Which signal came, if any.
#[derive(Debug, Clone, Default)]
pub struct Signals {
    number: Arc<AtomicUsize>,
    is_writing: Arc<AtomicBool>,
    asks_for_snapshot: Arc<AtomicBool>,
}

impl Signals {
    /// Listens from now on.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn listen() -> io::Result<Self> {
        let signals = Self::default();
        let again = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            // Handlers run in the order of registration: the second signal finds the flag that the first has set.
            flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(&again))?;
            flag::register(signal, Arc::clone(&again))?;
            flag::register_usize(signal, Arc::clone(&signals.number), signal as usize)?;
        }
        flag::register(SIGUSR1, Arc::clone(&signals.asks_for_snapshot))?;
        let watched = signals.clone();
        thread::Builder::new().name("signals".into()).spawn(move || watched.watch())?;
        Ok(signals)
    }

    /// The number of the signal that came last.
    pub fn received(&self) -> Option<u8> {
        match self.number.load(Ordering::Relaxed) {
            0 => None,
            number => u8::try_from(number).ok(),
        }
    }

    /// Whether USR1 came since this was last asked.
    pub fn takes_snapshot(&self) -> bool {
        self.asks_for_snapshot.swap(false, Ordering::Relaxed)
    }

    /// Files are being written, which no signal but the second cuts short.
    pub fn set_writing(&self, is_writing: bool) {
        self.is_writing.store(is_writing, Ordering::Relaxed);
    }

    /// Ends the program some time after a signal, should it still run.
    fn watch(&self) {
        let signal = loop {
            match self.received() {
                Some(signal) => break signal,
                None => thread::sleep(Duration::from_millis(100)),
            }
        };
        thread::sleep(GRACE);
        while self.is_writing.load(Ordering::Relaxed) {
            thread::sleep(Duration::from_millis(100));
        }
        log(STOPPED);
        std::process::exit(128 + i32::from(signal));
    }
}
