//! `curlsmoke sheet`.

use crate::cli::print_result;
use crate::cli::values::Memory;
use crate::error::Error;
use crate::inspect::sheet::{Cell, Layout, Picture, SheetError, SheetSettings};
use crate::output::View;
use crate::output::file::{check_writable, write_atomic};
use crate::output::{check_memory, read_image};
use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use std::path::PathBuf;

/// Flags of `sheet`.
#[derive(Debug, Args)]
pub struct SheetArguments {
    /// The pictures (.exr, .hdr, .png), in their order from left to right and top to bottom
    #[arg(required = true)]
    pub images: Vec<PathBuf>,
    /// The sheet (.png)
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Pictures side by side [default: as many as make the sheet about as wide as a screen]
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..))]
    pub columns: Option<u32>,
    /// Scale wider pictures down to this width in pixels
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..))]
    pub width: Option<u32>,
    /// How light is mapped to the screen; .png pictures are shown as they are
    #[arg(long, default_value = View::Standard.name(), value_parser = views())]
    pub view: View,
    /// Stops of exposure; not of .png pictures
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub exposure: f64,
    /// Leave names out
    #[arg(long)]
    pub no_labels: bool,
    /// Refuse pictures that need more memory than this [GiB], as 4, 4G or 512M
    #[arg(long, value_name = "AMOUNT", default_value = "8")]
    pub memory_limit: Memory,
}

/// Views by their names, as scenes know them.
fn views() -> impl TypedValueParser<Value = View> {
    let names = View::ALL.map(|view| PossibleValue::new(view.name()).help(view.summary()));
    PossibleValuesParser::new(names)
        .try_map(|name| View::ALL.into_iter().find(|view| view.name() == name).ok_or("there is no such view"))
}

/// Lays pictures out; the exit code.
pub(super) fn run(arguments: &SheetArguments) -> Result<u8, Error> {
    let output = &arguments.output;
    if crate::output::extension(output) != "png" {
        return Err(Error::Usage(format!("--output {}: the name must end in .png", output.display())));
    }
    check_writable(output)?;
    let limit = arguments.memory_limit.bytes();
    /// A pixel as it was read and on its way to the screen [bytes].
    const PIXEL_BYTES: u64 = 52;
    let (mut cells, mut pictures, mut held) = (Vec::new(), Vec::new(), 0u64);
    for path in &arguments.images {
        let image = read_image(path, limit.saturating_sub(held))?;
        check_memory(path, held.saturating_add(PIXEL_BYTES * image.pixel_count() as u64), limit)?;
        let label = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        // What is on the screen already stays as it is.
        let is_shown = crate::output::extension(path) == "png";
        let (view, exposure) = if is_shown { (View::Standard, 0.0) } else { (arguments.view, arguments.exposure) };
        let picture = Picture::new(&image, view, exposure, arguments.width)
            .map_err(|error| Error::Usage(format!("{}: {error}", path.display())))?;
        held += picture.memory_bytes();
        cells.push(Cell { label, size: picture.size() });
        pictures.push(picture);
    }
    let settings = SheetSettings {
        columns: arguments.columns,
        width: arguments.width,
        is_labelled: arguments.images.len() > 1 && !arguments.no_labels,
    };
    let usage = |error: SheetError| Error::Usage(error.to_string());
    let layout = Layout::new(&cells, &[], settings).map_err(usage)?;
    check_memory(output, held.saturating_add(layout.memory_bytes()), limit)?;
    let mut canvas = layout.blank();
    for (number, picture) in pictures.iter().enumerate() {
        layout.put(&mut canvas, number, picture).map_err(usage)?;
    }
    write_atomic(output, &canvas.to_png()?)?;
    let [width, height] = canvas.size;
    print_result(&format!("{}: {width} × {height} pixels", output.display())).map(|()| 0)
}
