//! `curlsmoke sheet`.

use crate::cli::args::SheetArguments;
use crate::cli::print_result;
use crate::error::Error;
use crate::inspect::sheet::{Cell, SheetSettings, sheet};
use crate::output::file::{check_writable, write_atomic};
use crate::output::read_image;
use crate::output::view::View;

/// Lays pictures out; the exit code.
pub(super) fn run(arguments: &SheetArguments) -> Result<u8, Error> {
    let output = &arguments.output;
    if crate::output::extension(output) != "png" {
        return Err(Error::Usage(format!("--output {}: the name must end in .png", output.display())));
    }
    check_writable(output)?;
    let mut cells = Vec::with_capacity(arguments.images.len());
    for path in &arguments.images {
        let image = read_image(path, arguments.memory_limit.bytes())?;
        let label = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        // What is on the screen already stays as it is.
        let is_shown = crate::output::extension(path) == "png";
        let (view, exposure) =
            if is_shown { (View::Standard, 0.0) } else { (arguments.view.into(), arguments.exposure) };
        let usage = |error| Error::Usage(format!("{}: {error}", path.display()));
        cells.push(Cell::new(label, &image, view, exposure).map_err(usage)?);
    }
    let settings = SheetSettings {
        columns: arguments.columns,
        width: arguments.width,
        is_labelled: arguments.images.len() > 1 && !arguments.no_labels,
    };
    let canvas = sheet(cells, &[], settings).map_err(|error| Error::Usage(error.to_string()))?;
    write_atomic(output, &canvas.to_png()?)?;
    let [width, height] = canvas.size;
    print_result(&format!("{}: {width} × {height} pixels", output.display())).map(|()| 0)
}
