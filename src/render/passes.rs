//! A picture in passes over all of its pixels: each adds paths to what is there, so that there is something to look at soon.

use crate::math::parallel;
use crate::progress::Progress;
use crate::render::RenderError;
use crate::render::film::{Film, PathCounts, Pixel, PixelBounds, PixelSum};
use crate::render::integrator::Integrator;
use crate::render::layers::{Layer, Middle};
use crate::render::media::Media;
use crate::render::motion::FrameMotion;
use crate::render::sun_shadow::SunShadows;
use crate::render::tiles::{PixelPainter, TILE, Tile, Traced, View, assemble, cut, middle_of};
use crate::render::world::World;

/// A picture that is being taken. Equal paths give equal bits, in however many passes they are traced.
pub struct Passes<'a> {
    view: &'a View,
    traced: Traced<'a>,
    bounds: Vec<PixelBounds>,
    tiles: Vec<Sums>,
    done: u32,
}

/// What the pixels of a tile have so far.
struct Sums {
    pixels: Vec<PixelSum>,
    /// What rays through the middles of pixels meet: one for each pixel as soon as layers want them.
    middles: Vec<Middle>,
    counts: PathCounts,
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
        let integrator = Integrator { world, media, sun_shadows, limits: view.limits };
        Self::of(view, Traced { integrator, motion: motion.filter(|_| view.layers.contains(&Layer::Motion)) })
    }

    pub(crate) fn of(view: &'a View, traced: Traced<'a>) -> Self {
        let bounds = cut(view.bounds, TILE);
        let sums = |tile: &PixelBounds| Sums {
            pixels: vec![PixelSum::new(&view.layers); tile.area()],
            middles: Vec::new(),
            counts: PathCounts::default(),
        };
        Self { view, traced, tiles: bounds.iter().map(sums).collect(), bounds, done: 0 }
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
        let tiles: Vec<Tile> = parallel::map(self.tiles.len(), |n| self.square_tile(n, stride));
        Ok(Film { spp: 1, ..assemble(self.view, &self.bounds, &tiles) })
    }

    /// The picture as it is.
    ///
    /// # Errors
    /// [`RenderError::Cancelled`].
    pub fn film(&mut self, progress: &dyn Progress) -> Result<Film, RenderError> {
        let (view, traced) = (self.view, &self.traced);
        let needs_middle = view.layers.iter().any(Layer::is_of_the_middle);
        let work = self.bounds.iter().zip(&mut self.tiles);
        let tiles = parallel::try_map(work, |_, (bounds, sums)| -> Result<Tile, RenderError> {
            if needs_middle && sums.middles.is_empty() {
                sums.middles = middles(bounds, view, traced, progress)?;
            }
            let mut tile = Tile { pixels: Vec::new(), layer_data: Vec::new(), counts: sums.counts };
            for (i, sum) in sums.pixels.iter().enumerate() {
                tile.pixels.push(sum.finish());
                sum.finish_layers(&view.layers, sums.middles.get(i), &mut tile.layer_data);
            }
            Ok(tile)
        })?;
        Ok(Film { spp: self.done, ..assemble(view, &self.bounds, &tiles) })
    }

    fn trace(&mut self, paths: u32, stride: u32, progress: &dyn Progress) -> Result<(), RenderError> {
        let (view, traced) = (self.view, &self.traced);
        let work = self.bounds.iter().zip(&mut self.tiles);
        parallel::try_map(work, |_, (tile, sums)| -> Result<(), RenderError> {
            for (i, sum) in sums.pixels.iter_mut().enumerate() {
                let (column, row) = (i as u32 % tile.width(), i as u32 / tile.width());
                if !(column.is_multiple_of(stride) && row.is_multiple_of(stride)) {
                    continue;
                }
                let place = [tile.x0 + column, tile.y0 + row];
                let mut painter = PixelPainter::new(place, view, traced, progress, &mut sums.counts);
                let has = sum.moments().count();
                painter.add(sum, has..paths.max(has))?;
                painter.look()?;
            }
            Ok(())
        })?;
        Ok(())
    }

    /// A tile of which only the upper left pixel of each square has paths.
    fn square_tile(&self, n: usize, stride: u32) -> Tile {
        let (bounds, sums) = (&self.bounds[n], &self.tiles[n]);
        let width = bounds.width();
        let mut tile = Tile { pixels: Vec::new(), layer_data: Vec::new(), counts: sums.counts };
        for i in 0..bounds.area() as u32 {
            let (column, row) = (i % width, i / width);
            let sum = &sums.pixels[((row - row % stride) * width + column - column % stride) as usize];
            let pixel: Pixel = sum.finish();
            tile.pixels.push(pixel);
            sum.finish_layers(&self.view.layers, None, &mut tile.layer_data);
        }
        tile
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
