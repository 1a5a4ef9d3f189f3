//! Progress for people and programs, on standard error: a bar on a terminal, whole lines elsewhere.

use crate::cli::signals::Signals;
use crate::progress::{Progress, Stage};
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How progress is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Style {
    /// A bar on a terminal, lines elsewhere
    Auto,
    /// A bar
    Tty,
    /// A line for each event, and every 10 seconds
    Plain,
    /// A JSON object for each event, and every second
    Json,
    /// Lines for workers of Open Job Description, as openjd_progress: 12.5
    Openjd,
    /// Lines for RenderMan's Alfred and what reads its, as ALF_PROGRESS 12%
    Alfred,
    /// Nothing
    None,
}

/// Shows progress and tells the work when a signal came.
pub struct Reporter {
    style: Style,
    signals: Signals,
    bar: ProgressBar,
    done: AtomicU64,
    state: Mutex<State>,
}

struct State {
    frame: i32,
    index: usize,
    count: usize,
    stage: Option<Stage>,
    total: u64,
    start: Instant,
    frame_start: Instant,
    /// As `frame_start`, but for the first frame that is made after what is done once for all.
    work_start: Instant,
    stage_start: Instant,
    last_line: Instant,
    pace: Pace,
    is_set_up: bool,
    /// The line of farms that was shown last, and the share it told, which never falls.
    farm_line: String,
    farm_share: f64,
}

impl Reporter {
    /// A reporter for work that begins now.
    pub fn new(style: Style, signals: Signals) -> Self {
        let is_terminal = std::io::stderr().is_terminal();
        let style = match style {
            Style::Auto if is_terminal => Style::Tty,
            Style::Auto => Style::Plain,
            chosen => chosen,
        };
        let bar = match style {
            Style::Tty => ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr_with_hz(8)),
            _ => ProgressBar::hidden(),
        };
        // A template without colours; it is constant, so it parses.
        if let Ok(template) = ProgressStyle::with_template("{prefix} {wide_bar} {percent:>3} %  {msg}") {
            bar.set_style(template.progress_chars("=> "));
        }
        let now = Instant::now();
        let state = State {
            frame: 0,
            index: 0,
            count: 0,
            stage: None,
            total: 0,
            start: now,
            frame_start: now,
            work_start: now,
            stage_start: now,
            last_line: now,
            pace: Pace::default(),
            is_set_up: false,
            farm_line: String::new(),
            farm_share: 0.0,
        };
        Self { style, signals, bar, done: AtomicU64::new(0), state: Mutex::new(state) }
    }

    /// Prints a result while no bar is in the way.
    pub fn suspend<T>(&self, print: impl FnOnce() -> T) -> T {
        self.bar.suspend(print)
    }

    /// The work is over.
    pub fn finish(&self, exit_code: u8, message: &str) {
        self.bar.finish_and_clear();
        if exit_code == 0 {
            self.show_share(&mut self.lock(), 1.0);
        } else if self.style == Style::Openjd {
            // Messages are lines.
            self.line(&format!("openjd_fail: {}", message.lines().collect::<Vec<_>>().join(" ")));
        }
        let event = if exit_code == 0 { "completed" } else { "failed" };
        self.event(json!({
            "event": event, "exit_code": exit_code, "message": message, "seconds": self.lock().start.elapsed().as_secs_f64(),
        }));
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // A panic elsewhere must not become a second one here.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn line(&self, text: &str) {
        // A reader that went away does not stop the work.
        self.bar.suspend(|| {
            let _ = writeln!(std::io::stderr(), "{text}");
        });
    }

    fn event(&self, event: Value) {
        if self.style == Style::Json {
            self.line(&event.to_string());
        }
    }

    /// Tells farms the share of all work that is done.
    fn show_share(&self, state: &mut State, share: f64) {
        state.farm_share = share.max(state.farm_share);
        let percent = 100.0 * state.farm_share;
        let line = match self.style {
            Style::Openjd => format!("openjd_progress: {percent:.1}"),
            Style::Alfred => format!("ALF_PROGRESS {percent:.0}%"),
            _ => return,
        };
        if line != state.farm_line {
            self.line(&line);
            state.farm_line = line;
        }
    }

    fn show(&self, state: &mut State, done: u64) {
        state.last_line = Instant::now();
        match self.style {
            Style::Tty => {
                self.bar.set_position(done);
                self.bar.set_message(status(state, done));
            }
            Style::Plain => {
                let percent = 100.0 * done as f64 / state.total.max(1) as f64;
                self.line(&format!("frame {}: {percent:.0} % {}", state.frame, status(state, done)));
            }
            Style::Json => self.event(json!({
                "event": "progress", "frame": state.frame, "stage": state.stage.map(Stage::name), "done": done,
                "total": state.total, "fraction": fraction(state, done),
                "seconds_left": seconds_left(state, done),
            })),
            Style::Openjd | Style::Alfred => {
                self.show_share(state, fraction(state, done));
                if self.style == Style::Openjd {
                    self.line(&format!("openjd_status: frame {}: {}", state.frame, status(state, done)));
                }
            }
            Style::Auto | Style::None => {}
        }
    }

    fn interval(&self) -> Duration {
        match self.style {
            Style::Tty => Duration::from_millis(125),
            Style::Json | Style::Openjd | Style::Alfred => Duration::from_secs(1),
            _ => Duration::from_secs(10),
        }
    }
}

impl Progress for Reporter {
    fn frame(&self, frame: i32, index: usize, count: usize) {
        let mut state = self.lock();
        let state = &mut *state;
        (state.frame, state.index, state.count) = (frame, index, count);
        state.frame_start = Instant::now();
        state.work_start = state.frame_start;
        self.bar.set_prefix(format!("frame {frame} ({}/{count})", index + 1));
        self.event(json!({"event": "frame", "frame": frame, "index": index, "count": count}));
        self.show_share(state, index as f64 / count.max(1) as f64);
        if self.style == Style::Openjd {
            self.line(&format!("openjd_status: frame {frame} ({} of {count})", index + 1));
        }
    }

    fn begin(&self, stage: Stage, total: u64) {
        self.signals.set_writing(stage == Stage::Write);
        let mut state = self.lock();
        if stage != Stage::Geometry && !state.is_set_up {
            state.is_set_up = true;
            state.work_start = Instant::now();
        }
        state.stage = Some(stage);
        state.total = total;
        state.stage_start = Instant::now();
        self.done.store(0, Ordering::Relaxed);
        self.bar.set_length(total.max(1));
        self.bar.set_position(0);
        self.bar.set_message(stage.name());
        self.event(json!({"event": "stage", "frame": state.frame, "stage": stage.name(), "total": total}));
    }

    fn advance(&self, units: u64) {
        let done = self.done.fetch_add(units, Ordering::Relaxed) + units;
        // Whoever finds the lock taken leaves the showing to the one who has it.
        if let Ok(mut state) = self.state.try_lock()
            && state.last_line.elapsed() >= self.interval()
        {
            self.show(&mut state, done);
        }
    }

    fn end(&self, stage: Stage) {
        self.signals.set_writing(false);
        let mut state = self.lock();
        let state = &mut *state;
        let seconds = state.stage_start.elapsed().as_secs_f64();
        self.event(json!({"event": "stage_end", "frame": state.frame, "stage": stage.name(), "seconds": seconds}));
        if stage == Stage::Write && state.count > 0 {
            let seconds = state.work_start.elapsed().as_secs_f64();
            state.pace.add(seconds);
        }
        if stage == Stage::Write && self.style == Style::Plain && state.count > 0 {
            let mut text = format!(
                "frame {} ({} of {}): done in {}",
                state.frame,
                state.index + 1,
                state.count,
                duration(state.frame_start.elapsed().as_secs_f64())
            );
            state.stage = None;
            if let Some(left) = seconds_left(state, 0).filter(|&s| s > 0.0) {
                // Writing to a String cannot fail.
                let _ = write!(text, ", {} left", duration(left));
            }
            self.line(&text);
        }
        state.stage = None;
        if stage == Stage::Write && state.count > 0 {
            self.show_share(state, fraction(state, 0));
        }
    }

    fn note(&self, text: &str) {
        match self.style {
            Style::None => {}
            Style::Json => self.event(json!({"event": "note", "message": text})),
            Style::Tty | Style::Plain | Style::Auto | Style::Openjd | Style::Alfred => self.line(text),
        }
    }

    fn set_writing(&self, is_writing: bool) {
        self.signals.set_writing(is_writing);
    }

    fn takes_snapshot(&self) -> bool {
        self.signals.takes_snapshot()
    }

    fn is_cancelled(&self) -> bool {
        self.signals.received().is_some()
    }
}

/// Stage, speed and time left.
fn status(state: &State, done: u64) -> String {
    let Some(stage) = state.stage else { return String::new() };
    let mut text = stage.name().to_string();
    let unit = match stage {
        Stage::Render => " samples/s",
        Stage::Advect => " steps/s",
        Stage::Geometry | Stage::Grid | Stage::Write => "",
    };
    let seconds = state.stage_start.elapsed().as_secs_f64();
    if !unit.is_empty() && done > 0 && seconds > 0.0 {
        // Writing to a String cannot fail.
        let _ = write!(text, ", {}{unit}", count(done as f64 / seconds));
    }
    if let Some(left) = seconds_left(state, done) {
        let _ = write!(text, ", {} left", duration(left));
    }
    text
}

/// Share of the frame's slowest stage that is done.
fn stage_share(state: &State, done: u64) -> f64 {
    match state.stage {
        Some(Stage::Render) => (done as f64 / state.total.max(1) as f64).min(1.0),
        // After the last stage of a frame, and between frames.
        None | Some(Stage::Write) => 1.0,
        Some(_) => 0.0,
    }
}

/// Share of all work that is done, 0 to 1.
fn fraction(state: &State, done: u64) -> f64 {
    if state.count == 0 { 0.0 } else { (state.index as f64 + stage_share(state, done)) / state.count as f64 }
}

/// Time left for all frames [s], once there is something to tell it from.
fn seconds_left(state: &State, done: u64) -> Option<f64> {
    /// Less of a stage says nothing of the rest.
    const SHARE_MIN: f64 = 0.01;
    let after = state.count.checked_sub(state.index + 1)?;
    let of_frame = state.work_start.elapsed().as_secs_f64();
    let rest = match state.stage {
        None => return state.pace.left(None, after),
        Some(Stage::Write) => Some(0.0),
        Some(Stage::Render) => {
            let share = stage_share(state, done);
            (share >= SHARE_MIN).then(|| state.stage_start.elapsed().as_secs_f64() * (1.0 - share) / share)
        }
        Some(_) => None,
    };
    state.pace.left(Some((of_frame, rest)), after)
}

/// How long frames take that are made in this run, without what is done once before them.
#[derive(Debug, Clone, Copy, Default)]
struct Pace {
    made: usize,
    seconds: f64,
}

impl Pace {
    fn add(&mut self, seconds: f64) {
        self.made += 1;
        self.seconds += seconds;
    }

    /// Time left for the frame at work, for which so many seconds have gone and so many are to come (where that is known),
    /// and for `after` frames more.
    fn left(self, frame: Option<(f64, Option<f64>)>, after: usize) -> Option<f64> {
        let mean = |pace: Pace| (pace.made > 0).then(|| pace.seconds / pace.made as f64);
        let Some((gone, rest)) = frame else { return Some(mean(self)? * after as f64) };
        let rest = match rest {
            Some(rest) => rest,
            None => (mean(self)? - gone).max(0.0),
        };
        let mut pace = self;
        pace.add(gone + rest);
        Some(rest + mean(pace)? * after as f64)
    }
}

/// `950`, `1.2 k`, `3.4 M`, `5.6 G`.
pub fn count(n: f64) -> String {
    match n {
        _ if n < 1e3 => format!("{n:.0}"),
        _ if n < 1e6 => format!("{:.1} k", n / 1e3),
        _ if n < 1e9 => format!("{:.1} M", n / 1e6),
        _ => format!("{:.1} G", n / 1e9),
    }
}

/// `4.2 s`, `3 min 05 s`, `2 h 07 min`.
pub fn duration(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    match whole {
        0..60 => format!("{seconds:.1} s"),
        60..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_readable() {
        assert_eq!([duration(4.21), duration(185.0), duration(7620.0)], ["4.2 s", "3 min 05 s", "2 h 07 min"]);
        assert_eq!([count(950.0), count(1234.0), count(3.4e6)], ["950", "1.2 k", "3.4 M"]);
    }

    #[test]
    fn the_time_left_is_told_from_frames_that_were_made() {
        let mut pace = Pace::default();
        // Nothing is known before the light of the first frame.
        assert_eq!(pace.left(Some((7.0, None)), 3), None);
        assert_eq!(pace.left(None, 3), None);
        // 8 of 10 seconds gone, 3 frames of 10 seconds to come; frames that were kept do not count.
        assert_eq!(pace.left(Some((8.0, Some(2.0))), 3), Some(32.0));
        pace.add(10.0);
        assert_eq!(pace.left(None, 3), Some(30.0));
        assert_eq!(pace.left(Some((4.0, None)), 2), Some(26.0));
        assert_eq!(pace.left(Some((14.0, None)), 0), Some(0.0));
        pace.add(20.0);
        assert_eq!(pace.left(Some((10.0, Some(20.0))), 1), Some(40.0));
    }

    #[test]
    fn the_share_of_the_work_grows_from_0_to_1_over_frames_and_stages() {
        let reporter = Reporter::new(Style::None, Signals::default());
        let mut last = 0.0;
        for index in 0..3 {
            reporter.frame(10 + index as i32, index, 3);
            for stage in [Stage::Advect, Stage::Render, Stage::Write] {
                reporter.begin(stage, 10);
                for _ in 0..10 {
                    reporter.advance(1);
                    let now = fraction(&reporter.lock(), reporter.done.load(Ordering::Relaxed));
                    assert!(now >= last && now <= 1.0, "{stage:?}: {now} after {last}");
                    last = now;
                }
                reporter.end(stage);
            }
        }
        assert_eq!(last, 1.0);
        assert!(!reporter.is_cancelled());
    }
}
