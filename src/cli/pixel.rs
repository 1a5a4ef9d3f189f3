//! `curlsmoke render --pixel`: one pixel, and where its light comes from.

use crate::cli::print_result;
use crate::cli::values::PixelPlace;
use crate::error::Error;
use crate::pipeline;
use crate::progress::Progress;
use crate::render;
use crate::render::film::{Film, PixelBounds};
use crate::scene::Scene;

/// All layers that say something of a single pixel, as a value of `output.aovs`.
pub const LAYERS: &str = "[depth, position, shape_id, normal, albedo, motion, variance, transmittance, volume_depth, \
                          passages, light_groups, bounces, null_collisions, samples]";

/// Renders one pixel of each frame and prints what it holds; writes nothing.
pub(super) fn run(scene: &Scene, frames: &[i32], pixel: PixelPlace, progress: &dyn Progress) -> Result<(), Error> {
    let [x, y] = pixel.0;
    let canvas = render::canvas(&scene.settings.film);
    if !canvas.contains(x, y) {
        let (width, height) = (canvas.width(), canvas.height());
        let from = format!("{},{}", canvas.x0, canvas.y0);
        return Err(Error::Usage(format!("--pixel {x},{y}: the picture has {width} × {height} pixels, from {from}")));
    }
    let crop = PixelBounds { x0: x, y0: y, x1: x + 1, y1: y + 1 };
    for &frame in frames {
        let film = pipeline::film(scene, frame, Some(crop), progress)?;
        print_result(&format!("frame {frame}, pixel {x},{y}"))?;
        lines(&film).iter().try_for_each(|line| print_result(line))?;
    }
    Ok(())
}

fn lines(film: &Film) -> Vec<String> {
    let own = film.pixels.iter().flat_map(|p| [p.mean.x, p.mean.y, p.mean.z, p.alpha]);
    let names = film.layers.iter().flat_map(|layer| layer.channels());
    let further = names.zip(film.layer_data.iter().copied());
    let channels = ["R", "G", "B", "A"].map(String::from).into_iter().zip(own).chain(further);
    let mut lines: Vec<String> = channels.map(|(name, x)| format!("{name:<24} {x}")).collect();
    let paths = &film.paths;
    lines.push(format!(
        "{} paths, {} scatterings, {} cut at render.max_bounces",
        paths.traced, paths.bounces, paths.truncated
    ));
    lines
}
