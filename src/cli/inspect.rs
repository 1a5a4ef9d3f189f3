//! `curlsmoke inspect`.

use crate::cli::print_result;
use crate::cli::values::{Memory, PixelPlace};
use crate::error::Error;
use crate::output::image::{Attribute, Image};
use crate::output::read_image;
use crate::output::survey::survey;
use clap::Args;
use std::path::PathBuf;

/// Flags of `inspect`.
#[derive(Debug, Args)]
pub struct InspectImageArguments {
    /// The picture (.exr, .hdr, .png)
    pub image: PathBuf,
    /// Print all channels of this pixel, from the top left
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true)]
    pub pixel: Option<PixelPlace>,
    /// Print the least, largest and mean number of each channel, and count what should not be there
    #[arg(long)]
    pub stats: bool,
    /// Print the names of all channels and what is known of the picture; also without any flag
    #[arg(long)]
    pub layers: bool,
    /// Refuse pictures that need more memory than this [GiB], as 4, 4G or 512M
    #[arg(long, value_name = "AMOUNT", default_value = "8")]
    pub memory_limit: Memory,
}

/// Prints what a picture holds.
pub(super) fn run(arguments: &InspectImageArguments) -> Result<u8, Error> {
    let image = read_image(&arguments.image, arguments.memory_limit.bytes())?;
    let asks = arguments.pixel.is_some() || arguments.stats || arguments.layers;
    if arguments.layers || !asks {
        print_layers(&image)?;
    }
    if let Some(pixel) = arguments.pixel {
        print_pixel(&image, pixel.0)?;
    }
    if arguments.stats {
        print_statistics(&image)?;
    }
    Ok(0)
}

fn print_layers(image: &Image) -> Result<(), Error> {
    let ([width, height], [x, y], [columns, rows]) = (image.size, image.data_origin, image.data_size);
    print_result(&format!("{width} × {height} pixels"))?;
    if (image.data_origin, image.data_size) != ([0, 0], image.size) {
        print_result(&format!("data at {x}, {y}: {columns} × {rows} pixels"))?;
    }
    for channel in &image.channels {
        print_result(&format!("{:<24} {:>2} bit", channel.name, 8 * channel.kind.bytes()))?;
    }
    for (name, value) in &image.attributes {
        let text = match value {
            Attribute::Text(text) => text.clone(),
            Attribute::Int(n) => n.to_string(),
            Attribute::Float(x) => x.to_string(),
            Attribute::Float2(pair) => format!("{pair:?}"),
            Attribute::Rational(n, d) => format!("{n}/{d}"),
            Attribute::Matrix(numbers) => format!("{numbers:?}"),
        };
        print_result(&format!("{name} = {text}"))?;
    }
    Ok(())
}

fn print_pixel(image: &Image, [x, y]: [i32; 2]) -> Result<(), Error> {
    let ([x0, y0], [width, height]) = (image.data_origin, image.data_size.map(i64::from));
    let (column, row) = (i64::from(x) - i64::from(x0), i64::from(y) - i64::from(y0));
    if !(0..width).contains(&column) || !(0..height).contains(&row) {
        return Err(Error::Usage(format!(
            "--pixel {x},{y}: the picture has pixels from {x0},{y0} to {},{}",
            i64::from(x0) + width - 1,
            i64::from(y0) + height - 1
        )));
    }
    let at = (row * width + column) as usize;
    let mut lines = image.channels.iter().map(|channel| format!("{:<24} {}", channel.name, channel.data[at]));
    lines.try_for_each(|line| print_result(&line))
}

fn print_statistics(image: &Image) -> Result<(), Error> {
    print_result(&format!(
        "{:<24} {:>12} {:>12} {:>12} {:>12} {:>12}  {:<11} {:>8} {:>8} {:>8}",
        "channel", "least", "median", "99 %", "largest", "mean", "at", "below 0", "infinite", "NaN"
    ))?;
    for channel in &image.channels {
        let s = survey(image, channel);
        let [x, y] = s.largest_at;
        print_result(&format!(
            "{:<24} {:>12} {:>12} {:>12} {:>12} {:>12}  {:<11} {:>8} {:>8} {:>8}",
            channel.name,
            short(s.least.into()),
            short(s.median.into()),
            short(s.high.into()),
            short(s.largest.into()),
            short(s.mean),
            format!("{x},{y}"),
            s.negative,
            s.infinite,
            s.nan
        ))?;
    }
    Ok(())
}

/// Five digits.
fn short(x: f64) -> String {
    let size = x.abs();
    if x != 0.0 && !(1e-3..1e6).contains(&size) { format!("{x:.4e}") } else { format!("{x:.5}") }
}
