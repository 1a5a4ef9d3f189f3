//! What is to be seen: the picture as far as it is, how far that is, and what is wrong; and what people wish for.

use crate::error::Error;
use crate::output::View;
use crate::pipeline::inputs::Part;
use crate::progress::Stage;
use crate::render::film::{Film, PixelBounds};
use crate::render::layers::Precision;
use crate::scene::Scene;
use crate::scene::diagnostic::{Diagnostic, Severity};
use crate::watch::view_table;
use serde::Serialize;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// What people wish to see.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wishes {
    /// Changes with every wish.
    pub serial: u64,
    /// Which frame; that of the scene where `None`.
    pub frame: Option<i32>,
    /// Which part of the picture, `Some(None)` for all of it; what the command line says where `None`.
    pub crop: Option<Option<PixelBounds>>,
}

/// Something that is wrong.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Problem {
    /// `error` or `warning`.
    pub severity: &'static str,
    /// The file, or the flag.
    pub file: String,
    /// Line in it, from 1.
    pub line: Option<u32>,
    /// Column in it, from 1.
    pub column: Option<u32>,
    /// Path of the key.
    pub key: String,
    /// What was found and what is allowed.
    pub message: String,
    /// The line itself.
    pub excerpt: String,
    /// Characters of it before the fault, and how many are at fault.
    pub caret: [usize; 2],
    /// Ways out.
    pub help: Vec<String>,
}

impl Problem {
    /// Of a scene.
    pub fn of_diagnostic(d: &Diagnostic) -> Self {
        Self {
            severity: if d.severity == Severity::Error { "error" } else { "warning" },
            file: d.file.clone(),
            line: d.position.map(|p| p.line),
            column: d.position.map(|p| p.column),
            key: d.key.clone(),
            message: d.message.clone(),
            excerpt: d.excerpt.clone(),
            caret: [d.caret, d.length],
            help: d.help.clone(),
        }
    }

    /// Of any other error, which says itself where it is.
    pub fn of_text(error: &Error) -> Self {
        let position = match error {
            Error::InScene { place, .. } => place.position,
            _ => None,
        };
        Self {
            severity: "error",
            file: String::new(),
            line: position.map(|p| p.line),
            column: position.map(|p| p.column),
            key: String::new(),
            message: error.to_string(),
            excerpt: String::new(),
            caret: [0, 0],
            help: Vec::new(),
        }
    }
}

/// Channels of a picture that are looked at together.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LayerChannels {
    /// What they are called together.
    pub name: String,
    /// Names of the channels, one to four.
    pub channels: Vec<String>,
    /// Place of the first among all channels.
    pub first: usize,
    /// Whether they are light to look at, and no data.
    pub is_color: bool,
}

/// All channels of the whole picture, of which parts may be older than others.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Picture {
    /// Width and height [pixels].
    pub resolution: [u32; 2],
    /// Channels by layer.
    pub layers: Vec<LayerChannels>,
    /// For each pixel all channels.
    pub data: Vec<f32>,
}

impl Picture {
    /// Number of channels.
    pub fn channel_count(&self) -> usize {
        self.layers.iter().map(|layer| layer.channels.len()).sum()
    }

    /// The names of all channels.
    pub fn channels(&self) -> Vec<String> {
        self.layers.iter().flat_map(|layer| layer.channels.iter().cloned()).collect()
    }

    /// All channels of a pixel; none beyond the picture.
    pub fn pixel(&self, [x, y]: [i32; 2]) -> &[f32] {
        let all = PixelBounds::whole(self.resolution);
        if !all.contains(x, y) {
            return &[];
        }
        let count = self.channel_count();
        let at = all.index(x, y) * count;
        self.data.get(at..at + count).unwrap_or_default()
    }

    /// The channels of one layer, for each pixel of a part of the picture.
    pub fn part<'a>(&'a self, layer: &'a LayerChannels, b: PixelBounds) -> impl Iterator<Item = f32> + 'a {
        let pixels = (b.y0..b.y1).flat_map(move |y| (b.x0..b.x1).map(move |x| [x, y]));
        pixels.flat_map(move |place| self.pixel(place)[layer.first..layer.first + layer.channels.len()].iter().copied())
    }

    /// Puts a film of pixels of the frame in its place. What is beyond it stays, if there is anything of this size and these layers.
    fn put(&mut self, film: &Film) {
        let layers = layers_of(film);
        if self.resolution != film.resolution || self.layers != layers {
            let [width, height] = film.resolution.map(|n| n as usize);
            let count: usize = layers.iter().map(|layer| layer.channels.len()).sum();
            *self = Self { resolution: film.resolution, layers, data: vec![0.0; width * height * count] };
        }
        let count = self.channel_count();
        let (all, further) = (PixelBounds::whole(self.resolution), count - 4);
        let b = film.bounds;
        for (i, pixel) in film.pixels.iter().enumerate() {
            let (column, row) = (i as u32 % b.width(), i as u32 / b.width());
            let at = all.index(b.x0.saturating_add_unsigned(column), b.y0.saturating_add_unsigned(row)) * count;
            self.data[at..at + 3].copy_from_slice(&pixel.mean.to_array());
            self.data[at + 3] = pixel.alpha;
            self.data[at + 4..at + count].copy_from_slice(&film.layer_data[i * further..(i + 1) * further]);
        }
    }
}

fn layers_of(film: &Film) -> Vec<LayerChannels> {
    let own = ["R", "G", "B", "A"].map(String::from).into();
    let mut layers = vec![LayerChannels { name: "beauty".into(), channels: own, first: 0, is_color: true }];
    let mut first = 4;
    for layer in &film.layers {
        let is_color = layer.precision() == Precision::Color;
        for channel in layer.channels() {
            let name = channel.split('.').next().unwrap_or_default().to_string();
            match layers.last_mut().filter(|last| last.name == name) {
                Some(last) => last.channels.push(channel),
                None => layers.push(LayerChannels { name, channels: vec![channel], first, is_color }),
            }
            first += 1;
        }
    }
    layers
}

/// How far it is, for whoever looks on.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Status {
    /// Changes with everything.
    pub version: u64,
    /// Changes with the pixels.
    pub picture: u64,
    /// Name of the scene file.
    pub scene: String,
    /// The frame that is worked on, the first and the last.
    pub frame: i32,
    /// First frame of the scene.
    pub first: i32,
    /// Last frame of the scene.
    pub last: i32,
    /// What is being done: `reading`, the name of a stage, `done`, `error`.
    pub activity: &'static str,
    /// How much of that is done, 0 to 1.
    pub fraction: f64,
    /// Paths that each pixel has, 0 for squares, and how many it will have.
    pub paths: u32,
    /// See `paths`.
    pub spp: u32,
    /// Size of the picture; 0 where there is none.
    pub resolution: [u32; 2],
    /// The part that is worked on: x0, y0, x1, y1.
    pub crop: Option<[i32; 4]>,
    /// What can be looked at.
    pub layers: Vec<LayerChannels>,
    /// What is wrong.
    pub problems: Vec<Problem>,
    /// What was made again for this picture.
    pub made: Vec<&'static str>,
    /// Time from the change to the first pixels [s].
    pub first_pixels: f64,
    /// Time from the change to the last pixels [s].
    pub seconds: f64,
    /// The scene's choice of how light is shown.
    pub view: &'static str,
    /// And its exposure [stops].
    pub exposure_ev: f64,
    /// All ways to show light.
    pub views: Vec<&'static str>,
}

/// The board itself; many may look at it at once.
pub struct Board {
    state: Mutex<(Status, Picture)>,
    changed: Condvar,
    wishes: Mutex<Wishes>,
    serial: AtomicU64,
}

impl Board {
    /// An empty board, and the frame to begin with.
    pub fn new(frame: Option<i32>) -> Self {
        let views = view_table::on_page().map(View::name).collect();
        let status = Status { version: 1, activity: "reading", views, ..Status::default() };
        Self {
            state: Mutex::new((status, Picture::default())),
            changed: Condvar::new(),
            wishes: Mutex::new(Wishes { frame, ..Wishes::default() }),
            serial: AtomicU64::new(0),
        }
    }

    /// What is wished for now.
    pub fn wishes(&self) -> Wishes {
        *locked(&self.wishes)
    }

    /// The number of the last wish.
    #[inline]
    pub fn serial(&self) -> u64 {
        self.serial.load(Ordering::Relaxed)
    }

    /// Wishes for another frame.
    pub fn wish_frame(&self, frame: i32) {
        self.wish(|wishes| wishes.frame = Some(frame));
    }

    /// Wishes for a part of the picture, or all of it.
    pub fn wish_crop(&self, crop: Option<PixelBounds>) {
        self.wish(|wishes| wishes.crop = Some(crop));
    }

    fn wish(&self, change: impl FnOnce(&mut Wishes)) {
        let mut wishes = locked(&self.wishes);
        let before = *wishes;
        change(&mut wishes);
        if *wishes != before {
            wishes.serial += 1;
            self.serial.store(wishes.serial, Ordering::Relaxed);
        }
    }

    /// Waits for a status newer than `version`, at most so long; the newest.
    pub fn status_after(&self, version: u64, most: Duration) -> Status {
        let state = locked(&self.state);
        let result = self.changed.wait_timeout_while(state, most, |(status, _)| status.version <= version);
        result.map_or_else(|e| e.into_inner().0.0.clone(), |(state, _)| state.0.clone())
    }

    /// Looks at the picture, which stands still meanwhile.
    pub fn look<T>(&self, look: impl FnOnce(&Status, &Picture) -> T) -> T {
        let state = locked(&self.state);
        look(&state.0, &state.1)
    }

    /// A picture is begun.
    pub fn begin(&self, scene: &Scene, frame: i32, crop: Option<PixelBounds>, problems: Vec<Problem>) {
        let settings = &scene.settings;
        self.change(|status, _| {
            status.scene = scene.path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            (status.frame, status.first, status.last) = (frame, settings.frames.first, settings.frames.last);
            status.spp = settings.film.spp;
            status.crop = crop.map(|b| [b.x0, b.y0, b.x1, b.y1]);
            status.problems = problems;
            let view = settings.output.view;
            status.view = view_table::on_page().find(|known| *known == view).unwrap_or(View::Standard).name();
            status.exposure_ev = settings.output.exposure_ev;
            (status.activity, status.fraction) = ("reading", 0.0);
        });
    }

    /// A stage begins, or is so far.
    pub fn progress(&self, stage: Option<Stage>, fraction: f64) {
        self.change(|status, _| {
            status.activity = stage.map_or(status.activity, Stage::name);
            status.fraction = fraction;
        });
    }

    /// There are more paths, so long after the change [s]; with the first of them comes what was made again for it. `show` sees
    /// the picture with them.
    pub fn put(&self, film: &Film, paths: u32, first: Option<&[Part]>, seconds: f64, show: &dyn Fn(&Picture)) {
        self.change(|status, picture| {
            picture.put(film);
            status.picture += 1;
            status.resolution = picture.resolution;
            status.layers.clone_from(&picture.layers);
            status.paths = paths;
            if let Some(made) = first {
                status.made = made.iter().map(|part| part.name()).collect();
                status.first_pixels = seconds;
            }
            status.seconds = seconds;
            show(picture);
        });
    }

    /// The picture has all its paths.
    pub fn finish(&self) {
        self.change(|status, _| (status.activity, status.fraction) = ("done", 1.0));
    }

    /// There will be no picture as things are; the last one stays.
    pub fn fail(&self, problems: Vec<Problem>) {
        self.change(|status, _| {
            (status.activity, status.fraction) = ("error", 0.0);
            status.problems = problems;
        });
    }

    fn change(&self, change: impl FnOnce(&mut Status, &mut Picture)) {
        let state = &mut *locked(&self.state);
        change(&mut state.0, &mut state.1);
        state.0.version += 1;
        self.changed.notify_all();
    }
}

fn locked<T>(value: &Mutex<T>) -> MutexGuard<'_, T> {
    value.lock().unwrap_or_else(PoisonError::into_inner)
}
