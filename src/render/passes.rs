//! A picture in passes over all of its pixels: each adds paths to what is there, so that there is something to look at soon.

use crate::geometry::moment::Moment;
use crate::math::parallel;
use crate::progress::Progress;
use crate::render::RenderError;
use crate::render::film::{Film, PathCounts, PixelBounds, PixelSum};
use crate::render::integrator::Integrator;
use crate::render::layers::{Layer, Middle};
use crate::render::ledger::{Canvas, Tile, TileContent};
use crate::render::media::Media;
use crate::render::motion::FrameMotion;
use crate::render::sun_shadow::SunShadows;
use crate::render::tiles::{TILE, TilePainter, Traced, View, middle_of};
use crate::render::world::World;
use std::sync::Arc;

/// A picture that is being taken. Equal paths give equal bits, in however many passes they are traced.
pub struct Passes<'a> {
    view: &'a View,
    traced: Traced<'a>,
    canvas: Canvas,
    bounds: Vec<PixelBounds>,
    tiles: Vec<Sums>,
    done: u32,
}

/// What the pixels of a tile have so far.
#[derive(Default)]
struct Sums {
    /// Sums of each pixel as they are written, which takes a tenth of their memory.
    written: Vec<u8>,
    /// What rays through the middles of pixels meet: one for each pixel as soon as layers want them.
    middles: Vec<Middle>,
    counts: PathCounts,
}

impl Sums {
    /// The sums of each pixel.
    fn read<'b>(&'b self, view: &'b View) -> impl Iterator<Item = PixelSum> + 'b {
        let mut rest = &self.written[..];
        std::iter::repeat_with(move || match rest {
            [] => PixelSum::new(&view.layers),
            _ => PixelSum::decode(&mut rest, &view.layers).expect("what was written here can be read"),
        })
    }
}

impl<'a> Passes<'a> {
    /// A picture without any paths yet. All its pixels will have equally many: `adaptive` and `time_limit` of the view
    /// are for others. Without `motion` the layer of motion says that nothing moves.
    pub fn new(
        view: &'a View,
        world: &'a World,
        media: Media<'a>,
        sun_shadows: &'a SunShadows,
        motion: Option<&'a FrameMotion<'a>>,
    ) -> Self {
        let integrator = Integrator { world, media, sun_shadows, limits: view.limits, moment: Moment::default() };
        Self::of(view, Traced { integrator, motion: motion.filter(|_| view.layers.contains(&Layer::Motion)) })
    }

    pub(crate) fn of(view: &'a View, traced: Traced<'a>) -> Self {
        let canvas =
            Canvas { resolution: view.resolution, bounds: view.bounds, edge: TILE, layers: view.layers.clone() };
        let bounds = canvas.tiles();
        let tiles = bounds.iter().map(|_| Sums::default()).collect();
        Self { view, traced, canvas, bounds, tiles, done: 0 }
    }

    /// Paths that each pixel has.
    pub fn done(&self) -> u32 {
        self.done
    }

    /// Traces paths until each pixel has `paths`, at most as many as the view says.
    ///
    /// # Errors
    /// [`RenderError::Cancelled`] soon after `progress` says so, [`RenderError::NonFinite`] for a path that brings no number.
    pub fn go_on(&mut self, paths: u32, progress: &dyn Progress) -> Result<(), RenderError> {
        let paths = paths.min(self.view.spp);
        self.trace(paths, 1, progress)?;
        self.done = self.done.max(paths);
        Ok(())
    }

    /// Traces the first path of every `stride`-th pixel of every `stride`-th row, and what they see as a picture in squares of
    /// that size: a glance at what is to come. The paths are none more than [`Passes::go_on`] would trace.
    ///
    /// # Errors
    /// As [`Passes::go_on`].
    ///
    /// # Panics
    /// Where `stride` does not divide the edge of a tile, 16 pixels.
    pub fn glance(&mut self, stride: u32, progress: &dyn Progress) -> Result<Film, RenderError> {
        assert!(TILE.is_multiple_of(stride), "squares that lie in one tile");
        self.trace(1, stride, progress)?;
        let tiles = parallel::map(self.tiles.len(), |n| self.square_tile(n, stride));
        Ok(self.film_of(1, tiles))
    }

    /// The picture as it is.
    ///
    /// # Errors
    /// [`RenderError::Cancelled`].
    pub fn film(&mut self, progress: &dyn Progress) -> Result<Film, RenderError> {
        let tiles = self.finish(progress)?;
        Ok(self.film_of(self.done, tiles))
    }

    /// The tiles of the picture as it is.
    pub(crate) fn finish(&mut self, progress: &dyn Progress) -> Result<Vec<Tile>, RenderError> {
        let (view, traced) = (self.view, &self.traced);
        let needs_middle = self.canvas.needs_middle();
        let work = self.bounds.iter().zip(&mut self.tiles);
        parallel::try_map(work, |_, (bounds, sums)| -> Result<Tile, RenderError> {
            if needs_middle && sums.middles.is_empty() {
                sums.middles = middles(bounds, view, traced, progress)?;
            }
            let (mut pixels, mut layer_data) = (Vec::with_capacity(bounds.area()), Vec::new());
            for (i, sum) in sums.read(view).take(bounds.area()).enumerate() {
                pixels.push(sum.finish());
                sum.finish_layers(&view.layers, sums.middles.get(i), &mut layer_data);
            }
            Ok(Tile { content: TileContent::Finished { pixels, layer_data }, counts: sums.counts })
        })
    }

    fn film_of(&self, spp: u32, tiles: Vec<Tile>) -> Film {
        self.canvas.film(spp, &tiles.into_iter().map(|tile| Some(Arc::new(tile))).collect::<Vec<_>>())
    }

    fn trace(&mut self, paths: u32, stride: u32, progress: &dyn Progress) -> Result<(), RenderError> {
        let (view, traced) = (self.view, &self.traced);
        let work = self.bounds.iter().zip(&mut self.tiles);
        parallel::try_map(work, |_, (tile, sums)| -> Result<(), RenderError> {
            // Taken over at the end, so that a pass that is cancelled leaves what was there.
            let mut written = Vec::with_capacity(sums.written.len());
            let mut painter = TilePainter::new(view, traced, progress, sums.counts);
            painter.look()?;
            for (i, mut sum) in sums.read(view).take(tile.area()).enumerate() {
                let (column, row) = (i as u32 % tile.width(), i as u32 / tile.width());
                if column.is_multiple_of(stride) && row.is_multiple_of(stride) {
                    let place = [tile.x0.saturating_add_unsigned(column), tile.y0.saturating_add_unsigned(row)];
                    let has = sum.moments().count();
                    painter.add(place, &mut sum, has..paths.max(has))?;
                }
                sum.encode(&mut written);
            }
            painter.tell();
            (sums.written, sums.counts) = (written, painter.counts);
            Ok(())
        })?;
        Ok(())
    }

    /// A tile of which only the upper left pixel of each square has paths.
    fn square_tile(&self, n: usize, stride: u32) -> Tile {
        let (bounds, sums) = (&self.bounds[n], &self.tiles[n]);
        let width = bounds.width();
        let read: Vec<PixelSum> = sums.read(self.view).take(bounds.area()).collect();
        let (mut pixels, mut layer_data) = (Vec::with_capacity(bounds.area()), Vec::new());
        for i in 0..bounds.area() as u32 {
            let (column, row) = (i % width, i / width);
            let sum = &read[((row - row % stride) * width + column - column % stride) as usize];
            pixels.push(sum.finish());
            sum.finish_layers(&self.view.layers, None, &mut layer_data);
        }
        Tile { content: TileContent::Finished { pixels, layer_data }, counts: sums.counts }
    }
}

fn middles(
    bounds: &PixelBounds,
    view: &View,
    traced: &Traced,
    progress: &dyn Progress,
) -> Result<Vec<Middle>, RenderError> {
    let mut middles = Vec::with_capacity(bounds.area());
    for y in bounds.y0..bounds.y1 {
        if progress.is_cancelled() {
            return Err(RenderError::Cancelled);
        }
        for x in bounds.x0..bounds.x1 {
            let ray = view.camera.ray(middle_of(x, y), [0.5, 0.5]);
            middles.push(Middle::look(&traced.integrator, &view.camera, &ray));
        }
    }
    Ok(middles)
}
