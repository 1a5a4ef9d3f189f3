//! Pictures of the surroundings, .exr or .hdr.

use crate::render::RenderError;
use crate::render::color::Rgb;
use exr::prelude::{ReadChannels, ReadLayers, read as read_image};
use glam::Vec3;
use std::path::Path;
use zune_core::bytestream::ZCursor;

/// Radiances by longitude and latitude, top row first.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width · height` radiances [W/(m² sr)], finite and not negative.
    pub pixels: Vec<Rgb>,
}

/// Reads a picture that takes at most `memory_limit` bytes.
///
/// # Errors
/// When the file is missing, damaged, too large, of another kind, or holds a radiance that is negative or no number.
pub fn read(path: &Path, memory_limit: u64) -> Result<Picture, RenderError> {
    let fail = |problem: String| RenderError::Environment { path: path.to_owned(), problem };
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let picture = match extension.as_str() {
        "exr" => read_exr(path, memory_limit).map_err(&fail)?,
        "hdr" => read_hdr(path, memory_limit).map_err(&fail)?,
        other => return Err(fail(format!("the surroundings must be an .exr or .hdr picture, not `.{other}`"))),
    };
    let bad = picture.pixels.iter().position(|p| !p.is_finite() || p.min_element() < 0.0);
    if let Some(i) = bad {
        let (x, y) = (i % picture.width, i / picture.width);
        return Err(fail(format!(
            "pixel ({x}, {y}) is {}: radiance must be a number that is not negative",
            picture.pixels[i]
        )));
    }
    Ok(picture)
}

fn check_size(width: usize, height: usize, memory_limit: u64) -> Result<(), String> {
    let bytes = width as u64 * height as u64 * size_of::<Rgb>() as u64 * 2;
    if width == 0 || height == 0 {
        return Err("the picture has no pixels".into());
    }
    if bytes > memory_limit {
        return Err(format!("{width} x {height} pixels need {bytes} bytes, above the limit of {memory_limit}"));
    }
    Ok(())
}

fn read_exr(path: &Path, memory_limit: u64) -> Result<Picture, String> {
    let meta = exr::meta::MetaData::read_from_file(path, false).map_err(|e| e.to_string())?;
    for header in &meta.headers {
        check_size(header.layer_size.width(), header.layer_size.height(), memory_limit)?;
    }
    let image = read_image()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size, _| Picture {
                width: size.width(),
                height: size.height(),
                pixels: vec![Vec3::ZERO; size.width() * size.height()],
            },
            |picture: &mut Picture, at, (r, g, b): (f32, f32, f32)| {
                picture.pixels[at.y() * picture.width + at.x()] = Vec3::new(r, g, b);
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(|e| e.to_string())?;
    Ok(image.layer_data.channel_data.pixels)
}

fn read_hdr(path: &Path, memory_limit: u64) -> Result<Picture, String> {
    let bytes = std::fs::read(path).map_err(|e| e.to_string())?;
    let mut decoder = zune_hdr::HdrDecoder::new(ZCursor::new(bytes));
    decoder.decode_headers().map_err(|e| format!("{e:?}"))?;
    let (width, height) = decoder.dimensions().ok_or("the header has no size")?;
    check_size(width, height, memory_limit)?;
    let floats = decoder.decode().map_err(|e| format!("{e:?}"))?;
    Ok(Picture { width, height, pixels: floats.chunks_exact(3).map(Vec3::from_slice).collect() })
}
