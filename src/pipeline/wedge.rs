//! One frame of many scenes that differ in a few settings: what they have in common is made once.

use crate::error::Error;
use crate::pipeline::fingerprint::{FileHashes, InputHash};
use crate::pipeline::inputs::{Inputs, Part};
use crate::pipeline::live::LiveStudio;
use crate::pipeline::{FrameOutcome, OutputFiles, RenderJob, Shot, check_camera, check_lights, check_writable, make};
use crate::progress::Progress;
use crate::render::film::PixelBounds;
use crate::scene::Scene;

/// Parts from the dearest to the cheapest.
const BY_COST: [Part; 7] =
    [Part::Particles, Part::Shapes, Part::Density, Part::Volumes, Part::Medium, Part::Lights, Part::Textures];

/// A scene with its own settings and names of files.
#[derive(Debug, Clone)]
pub struct Cell {
    /// The scene.
    pub scene: Scene,
    /// The part of its picture to render; all of it where `None`.
    pub crop: Option<PixelBounds>,
}

/// Renders a frame of each cell and writes its files; calls `on_cell` with the number of the cell, from 0, before (`None`) and after
/// each. Of `job` only `resume`, `checkpoint` and `arguments` count. A picture has the bytes that [`render`](crate::pipeline::render)
/// gives it. Cells are made in an order in which those follow one another that share what is dear to make.
///
/// # Errors
/// The first that any stage meets. Cells finished before it stay, and a checkpoint of the one at hand.
pub fn wedge(
    cells: &[Cell],
    frame: i32,
    job: &RenderJob,
    progress: &dyn Progress,
    on_cell: &mut dyn FnMut(usize, Option<&FrameOutcome>),
) -> Result<(), Error> {
    let files = cells.iter().map(|cell| OutputFiles::new(&cell.scene, None)).collect::<Result<Vec<_>, _>>()?;
    check_writable(files.iter().map(|files| files.to_write(frame)))?;
    for Cell { scene, .. } in cells {
        check_camera(scene, &[frame])?;
        check_lights(scene, &[frame])?;
    }
    let (mut studio, mut hashes) = (LiveStudio::default(), FileHashes::default());
    for (index, &number) in order(cells, frame)?.iter().enumerate() {
        let (Cell { scene, crop }, files) = (&cells[number], &files[number]);
        progress.frame(frame, index, cells.len());
        let fingerprint = InputHash::new(scene, *crop, &mut hashes)?.fingerprint(scene, frame, &mut hashes)?;
        if job.resume && files.is_complete(frame, &fingerprint) {
            on_cell(number, Some(&FrameOutcome::Kept { frame }));
            continue;
        }
        on_cell(number, None);
        let job = RenderJob { frames: vec![frame], crop: *crop, ..job.clone() };
        let shot = Shot { scene, frame, number: frame, fingerprint };
        on_cell(number, Some(&make(&shot, &job, files, &mut studio, progress)?));
    }
    Ok(())
}

/// Numbers of cells, sorted by the parts that they have in common: by the dearest first, and each in the order of its first cell.
fn order(cells: &[Cell], frame: i32) -> Result<Vec<usize>, Error> {
    let mut seen: [Vec<Inputs>; BY_COST.len()] = Default::default();
    let mut keyed = Vec::with_capacity(cells.len());
    for (number, cell) in cells.iter().enumerate() {
        let mut key = [0; BY_COST.len()];
        for ((part, seen), place) in BY_COST.into_iter().zip(&mut seen).zip(&mut key) {
            let inputs = Inputs::of(part, &cell.scene, frame)?;
            *place = seen.iter().position(|other| *other == inputs).unwrap_or_else(|| {
                seen.push(inputs);
                seen.len() - 1
            });
        }
        keyed.push((key, number));
    }
    keyed.sort_unstable();
    Ok(keyed.into_iter().map(|(_, number)| number).collect())
}
