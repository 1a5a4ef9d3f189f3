//! A picture is cut into tiles, which threads take one by one; equal inputs give equal bits whatever their number.

use crate::geometry::moment::{Carried, Moment, Shutter};
use crate::math::hash::Seed;
use crate::math::parallel;
use crate::progress::Progress;
use crate::render::RenderError;
use crate::render::adaptive::Adaptive;
use crate::render::camera::Camera;
use crate::render::film::{Contribution, Film, PathCounts, PixelBounds, PixelSum};
use crate::render::filter::Filter;
use crate::render::from_scene::camera::CameraCourse;
use crate::render::integrator::{Integrator, PathLimits};
use crate::render::layers::{Layer, Middle};
use crate::render::ledger::{Canvas, Ledger, Tile, TileContent};
use crate::render::media::Media;
use crate::render::medium::Medium;
use crate::render::motion::FrameMotion;
use crate::render::passes::Passes;
use crate::render::sampler::{Dimension, PixelSamples};
use crate::render::sun_shadow::SunShadows;
use crate::render::world::World;
use glam::Vec2;
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Edge of a tile [pixels]: small enough to balance two hundred threads on a small picture.
pub(crate) const TILE: u32 = 16;
/// The same where paths go where they are needed: pixels round a tile are begun besides, an eighth of it.
const ADAPTIVE_TILE: u32 = 32;

/// Most samples between two looks at whether to stop: a pixel may have millions.
const SAMPLES_A_LOOK: u64 = 256;
/// Most scatterings between two looks: a path may have a hundred thousand.
const BOUNCES_A_LOOK: u64 = 1 << 14;

/// Paths of a pixel in the first pass of a picture whose time is limited.
const FIRST_PASS: u32 = 4;

/// How a picture is taken.
#[derive(Debug, Clone)]
pub struct View {
    /// Where from, at the frame's own time.
    pub camera: Camera,
    /// What moves while the shutter is open, if anything does.
    pub shutter: Option<Arc<ViewShutter>>,
    /// Size of the frame.
    pub resolution: [u32; 2],
    /// All pixels that the picture may have: those of the frame, and of its overscan.
    pub canvas: PixelBounds,
    /// The part of them to render.
    pub bounds: PixelBounds,
    /// Paths a pixel; with `adaptive` the most.
    pub spp: u32,
    /// When a pixel has enough paths before that, if ever.
    pub adaptive: Option<Adaptive>,
    /// Time after which no pass over the picture is begun that would not end within it; then all pixels have equally many
    /// paths, fewer than `spp`. Not with `adaptive`.
    pub time_limit: Option<Duration>,
    /// How samples are spread about a pixel.
    pub filter: Filter,
    /// When paths end.
    pub limits: PathLimits,
    /// Of the random numbers.
    pub seed: Seed,
    /// Further layers to make.
    pub layers: Vec<Layer>,
}

/// What moves while the shutter is open.
#[derive(Debug)]
pub struct ViewShutter {
    /// How shapes move, and when it is open.
    pub shapes: Shutter,
    /// How the camera moves, if it does.
    pub camera: Option<CameraCourse>,
}

/// What paths are traced through, and how it moves where somebody wants to know.
pub(crate) struct Traced<'a> {
    pub(crate) integrator: Integrator<'a>,
    pub(crate) motion: Option<&'a FrameMotion<'a>>,
}

/// Takes the picture, on all threads of the current pool. Equal inputs give equal bits whatever their number, but for
/// how many paths there is time for where that is limited.
///
/// # Errors
/// [`RenderError::Cancelled`] soon after `progress` says so; [`RenderError::NonFinite`] for a path that brings no number.
pub fn render(
    view: &View,
    world: &World,
    smoke: Option<&Medium>,
    progress: &dyn Progress,
) -> Result<Film, RenderError> {
    render_media(view, world, smoke.into(), None, progress)
}

/// As [`render`], through more than smoke and of what moves; without `motion` the layer of motion says that nothing does.
///
/// # Errors
/// As there.
pub fn render_media(
    view: &View,
    world: &World,
    media: Media,
    motion: Option<&FrameMotion>,
    progress: &dyn Progress,
) -> Result<Film, RenderError> {
    let ledger = Ledger::new(None, Vec::new(), None);
    let spp = render_to(&ledger, view, world, media, motion, progress)?;
    Ok(canvas(view).film(spp, &ledger.tiles()))
}

/// The canvas of a picture taken so.
pub fn canvas(view: &View) -> Canvas {
    let edge = if view.adaptive.is_some() { ADAPTIVE_TILE } else { TILE };
    Canvas { resolution: view.resolution, bounds: view.bounds, edge, layers: view.layers.clone() }
}

/// As [`render_media`], with tiles put to a ledger as they are done, and those left alone that it has; returns how many paths
/// a pixel has at most. A ledger of a part of the paths is for views with neither `adaptive` nor `time_limit`, and with
/// `time_limit` all tiles are done at the end.
///
/// # Errors
/// As there.
///
/// # Panics
/// For a part of the paths of a picture whose paths are not known beforehand.
pub fn render_to(
    ledger: &Ledger,
    view: &View,
    world: &World,
    media: Media,
    motion: Option<&FrameMotion>,
    progress: &dyn Progress,
) -> Result<u32, RenderError> {
    let is_part = ledger.samples.is_some();
    assert!(!is_part || (view.adaptive.is_none() && view.time_limit.is_none()), "paths are not known beforehand");
    let start = Instant::now();
    let sun_shadows = SunShadows::new(&world.lights, media.grids());
    let integrator =
        Integrator { world, media, sun_shadows: &sun_shadows, limits: view.limits, moment: Moment::default() };
    let traced = Traced { integrator, motion: motion.filter(|_| view.layers.contains(&Layer::Motion)) };
    let samples = ledger.samples.clone().unwrap_or(0..view.spp);
    if let Some(limit) = view.time_limit {
        let limit = limit.saturating_sub(start.elapsed());
        let (finished, spp) = render_in_passes(view, traced, progress, limit)?;
        finished.into_iter().enumerate().for_each(|(index, tile)| ledger.put(index, tile));
        return Ok(spp);
    }
    parallel::try_map(&canvas(view).tiles(), |index, tile: &PixelBounds| -> Result<(), RenderError> {
        if ledger.is_done(index) {
            progress.advance(samples.len() as u64 * tile.area() as u64);
            return Ok(());
        }
        let made = match &view.adaptive {
            Some(adaptive) => render_adaptively(tile, view, &traced, progress, adaptive)?,
            None => render_tile(tile, view, &traced, progress, is_part, |painter, place| {
                painter.paint(place, PixelSum::new(&view.layers), samples.clone(), samples.len() as u32)
            })?,
        };
        ledger.put(index, made);
        Ok(())
    })?;
    Ok(view.spp)
}

/// Passes over all pixels until the time is up; also how many paths each pixel got.
fn render_in_passes(
    view: &View,
    traced: Traced,
    progress: &dyn Progress,
    limit: Duration,
) -> Result<(Vec<Tile>, u32), RenderError> {
    let start = Instant::now();
    let mut passes = Passes::of(view, traced);
    // A first short pass tells how long a path takes; a pass as long as all before it keeps their number small.
    let mut next = FIRST_PASS.min(view.spp);
    while next > passes.done() {
        passes.go_on(next, progress)?;
        let a_path = start.elapsed().as_secs_f64() / f64::from(next);
        let left = ((limit.as_secs_f64() - start.elapsed().as_secs_f64()) / a_path).max(0.0);
        next = (next + next.min(left as u32)).min(view.spp);
    }
    progress.advance(u64::from(view.spp - passes.done()) * view.bounds.area() as u64);
    Ok((passes.finish(progress)?, passes.done()))
}

/// Begins all pixels of a tile and those round it, and goes on with each of the tile as far as its neighbours say.
fn render_adaptively(
    bounds: &PixelBounds,
    view: &View,
    traced: &Traced,
    progress: &dyn Progress,
    adaptive: &Adaptive,
) -> Result<Tile, RenderError> {
    // Of the whole picture, so that a part of it comes out as it is there.
    let frame = PixelBounds::whole(view.resolution);
    let outer = bounds.grown([1; 4]).common(&view.canvas).unwrap_or(*bounds);
    let mut painter = TilePainter::new(view, traced, progress, PathCounts::default());
    painter.tells = false;
    let (mut begun, mut needed) = (Vec::new(), Vec::with_capacity(outer.area()));
    for y in outer.y0..outer.y1 {
        for x in outer.x0..outer.x1 {
            let mut sum = PixelSum::new(&view.layers);
            painter.add([x, y], &mut sum, 0..adaptive.min_spp)?;
            needed.push(adaptive.needed(&sum));
            if bounds.contains(x, y) {
                begun.push(sum);
            }
        }
    }
    let mut begun = begun.into_iter();
    let tile = render_tile(bounds, view, traced, progress, false, |painter, [x, y]| {
        let around = (-1i32..=1).flat_map(|dy| (-1i32..=1).map(move |dx| (dx, dy))).filter(|&step| step != (0, 0));
        // What is beside the frame has no say in it, so that the frame is the same with overscan and without.
        let asked = if frame.contains(x, y) { outer.common(&frame).unwrap_or(outer) } else { outer };
        let around = around.map(|(dx, dy)| (x + dx, y + dy)).filter(|&(x, y)| asked.contains(x, y));
        let mut needed: Vec<f32> = around.map(|(x, y)| needed[outer.index(x, y)]).collect();
        let begun = begun.next().expect("one for each pixel");
        painter.paint([x, y], begun, adaptive.min_spp..adaptive.paths(view.spp, &mut needed), view.spp)
    })?;
    let mut counts = painter.counts;
    counts.add(&tile.counts);
    Ok(Tile { counts, ..tile })
}

/// Paints the pixels of a tile, and finishes them unless they are a part of their paths: then their sums are kept.
fn render_tile(
    bounds: &PixelBounds,
    view: &View,
    traced: &Traced,
    progress: &dyn Progress,
    is_part: bool,
    mut paint: impl FnMut(&mut TilePainter, [i32; 2]) -> Result<PixelSum, RenderError>,
) -> Result<Tile, RenderError> {
    let mut painter = TilePainter::new(view, traced, progress, PathCounts::default());
    painter.look()?;
    let (mut pixels, mut layer_data, mut sums) = (Vec::new(), Vec::new(), Vec::new());
    let needs_middle = view.layers.iter().any(Layer::is_of_the_middle);
    for y in bounds.y0..bounds.y1 {
        for x in bounds.x0..bounds.x1 {
            let sum = paint(&mut painter, [x, y])?;
            let middle = needs_middle.then(|| {
                let ray = view.camera.ray(middle_of(x, y), [0.5, 0.5]);
                Middle::look(&traced.integrator, &view.camera, &ray)
            });
            if is_part {
                sum.encode(&mut sums);
                middle.iter().flat_map(Middle::to_words).for_each(|word| sums.extend(word.to_le_bytes()));
            } else {
                pixels.push(sum.finish());
                sum.finish_layers(&view.layers, middle.as_ref(), &mut layer_data);
            }
        }
    }
    painter.tell();
    let content = if is_part { TileContent::Sums(sums) } else { TileContent::Finished { pixels, layer_data } };
    Ok(Tile { content, counts: painter.counts })
}

pub(crate) fn middle_of(x: i32, y: i32) -> Vec2 {
    Vec2::new(x as f32 + 0.5, y as f32 + 0.5)
}

/// Traces the paths of a tile, pixel by pixel.
pub(crate) struct TilePainter<'a> {
    view: &'a View,
    traced: &'a Traced<'a>,
    progress: &'a dyn Progress,
    /// What became of the paths so far.
    pub counts: PathCounts,
    /// Paths that `progress` was not told of yet, and whether it is told of any.
    unsaid: u64,
    tells: bool,
    looked_at_bounce: u64,
    /// The path at hand; kept, as it is large.
    contribution: Contribution,
    /// Where shapes are for the path at hand.
    carried: Vec<Option<Carried>>,
}

impl<'a> TilePainter<'a> {
    /// Of a tile whose paths so far are `counts`.
    pub fn new(view: &'a View, traced: &'a Traced<'a>, progress: &'a dyn Progress, counts: PathCounts) -> Self {
        Self {
            view,
            traced,
            progress,
            counts,
            unsaid: 0,
            tells: true,
            looked_at_bounce: counts.bounces,
            contribution: Contribution::new(view.layers.iter().any(Layer::tells_ways)),
            carried: Vec::new(),
        }
    }

    /// Traces these paths; of the pixel, which counts for `most` paths, no more will follow.
    fn paint(
        &mut self,
        place: [i32; 2],
        mut sum: PixelSum,
        samples: Range<u32>,
        most: u32,
    ) -> Result<PixelSum, RenderError> {
        let before = self.counts.traced;
        self.add(place, &mut sum, samples)?;
        // Paths that were not needed are done too.
        self.unsaid += u64::from(most).saturating_sub(self.counts.traced - before);
        Ok(sum)
    }

    /// Says how far it is.
    pub fn tell(&mut self) {
        if self.tells {
            self.progress.advance(self.unsaid);
        }
        self.unsaid = 0;
    }

    /// Says how far it is, and asks whether to stop.
    pub fn look(&mut self) -> Result<(), RenderError> {
        self.tell();
        self.looked_at_bounce = self.counts.bounces;
        if self.progress.is_cancelled() { Err(RenderError::Cancelled) } else { Ok(()) }
    }

    /// Traces these paths of a pixel.
    pub fn add(&mut self, [x, y]: [i32; 2], sum: &mut PixelSum, samples: Range<u32>) -> Result<(), RenderError> {
        let view = self.view;
        let pixel = match view.adaptive {
            Some(_) => PixelSamples::alone(view.seed, x, y),
            None => PixelSamples::new(view.seed, view.spp, x, y),
        };
        for sample in samples {
            if self.unsaid >= SAMPLES_A_LOOK || self.counts.bounces - self.looked_at_bounce >= BOUNCES_A_LOOK {
                self.look()?;
            }
            let mut sampler = pixel.sampler(sample);
            let u = sampler.numbers(Dimension::Film, 0);
            let (moved_camera, moved_integrator);
            let (mut camera, mut integrator) = (&view.camera, &self.traced.integrator);
            if let Some(shutter) = &view.shutter {
                let time = shutter.shapes.time(f64::from(sampler.numbers(Dimension::Time, 0)[0]));
                moved_integrator = integrator.at(shutter.shapes.at(time, &mut self.carried));
                integrator = &moved_integrator;
                if let Some(course) = &shutter.camera {
                    moved_camera = course.at(time)?;
                    camera = &moved_camera;
                }
            }
            let ray = camera.ray(middle_of(x, y) + view.filter.sample([u[0], u[1]]), [u[2], u[3]]);
            let contribution = &mut self.contribution;
            contribution.clear();
            integrator.trace_into(contribution, ray, &mut sampler, &mut self.counts);
            contribution.null_collisions = sampler.stream().null_collisions;
            if let Some(motion) = self.traced.motion {
                // Motion is that from the frame's own time on, wherever in the shutter a shape was seen.
                if let Some(carried) = contribution.shape_idx.and_then(|shape| integrator.moment.of(shape)) {
                    contribution.place = carried.back(contribution.place);
                }
                contribution.motion = view.camera.along_rows(motion.of_path(&view.camera, contribution), y);
            }
            if !contribution.radiance.is_finite() {
                return Err(RenderError::NonFinite { x, y, sample, radiance: contribution.radiance });
            }
            sum.add(&view.layers, contribution);
            self.unsaid += 1;
        }
        Ok(())
    }
}
