//! PNG: pictures to look at, mapped from light to the screen, and textures to read.

use crate::output::View;
use crate::output::image::{Image, SampleKind};
use crate::output::view::{linear_from_srgb, on_screen};
use crate::output::{OutputError, check_memory, read_bytes};
use ::png::{BitDepth, ColorType, Compression, Decoder, Encoder, Limits, SrgbRenderingIntent, Transformations};
use std::io::Cursor;
use std::path::Path;

fn encoding_error(problem: impl ToString) -> OutputError {
    OutputError::Encoding { format: "PNG", problem: problem.to_string() }
}

/// The bytes of an 8-bit PNG, tagged sRGB, of linear light with `exposure_ev` stops of exposure. Colour that is
/// premultiplied by alpha appears over black.
///
/// # Errors
/// When `rgb` has not one colour for each of the `size[0] * size[1]` pixels, or there are none.
pub fn encode(rgb: &[[f32; 3]], size: [u32; 2], view: View, exposure_ev: f64) -> Result<Vec<u8>, OutputError> {
    if rgb.len() as u64 != u64::from(size[0]) * u64::from(size[1]) {
        return Err(encoding_error(format!("{} colours for {} × {} pixels", rgb.len(), size[0], size[1])));
    }
    let gain = exposure_ev.exp2() as f32;
    let pixels: Vec<u8> =
        rgb.iter().flat_map(|c| on_screen(view, c.map(|x| x * gain)).map(|x| (x * 255.0).round() as u8)).collect();
    encode_bytes(&pixels, size)
}

/// The bytes of an 8-bit PNG, tagged sRGB, of pixels that are already what the screen shows.
pub(crate) fn encode_bytes(pixels: &[u8], size: [u32; 2]) -> Result<Vec<u8>, OutputError> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, size[0], size[1]);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::Balanced);
    encoder.set_source_srgb(SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header().map_err(encoding_error)?;
    writer.write_image_data(pixels).map_err(encoding_error)?;
    writer.finish().map_err(encoding_error)?;
    Ok(bytes)
}

/// Reads a PNG of any kind into linear channels R, G, B and, where the file has it, A (not premultiplied).
///
/// # Errors
/// When the file is missing, unreadable or invalid, or needs more than `memory_limit` bytes.
pub fn read(path: &Path, memory_limit: u64) -> Result<Image, OutputError> {
    decode(path, &read_bytes(path, memory_limit)?, memory_limit)
}

fn decode(path: &Path, bytes: &[u8], memory_limit: u64) -> Result<Image, OutputError> {
    let invalid =
        |e: ::png::DecodingError| OutputError::Invalid { path: path.into(), format: "PNG", problem: e.to_string() };
    let limit = usize::try_from(memory_limit).unwrap_or(usize::MAX);
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: limit });
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(invalid)?;
    let size = [reader.info().width, reader.info().height];
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    // At most 4 components of 16 bits as stored, then 4 of 32 bits.
    check_memory(path, (bytes.len() as u64).saturating_add(pixels.saturating_mul(24)), memory_limit)?;
    let length = reader.output_buffer_size().ok_or_else(|| OutputError::Invalid {
        path: path.into(),
        format: "PNG",
        problem: "it is too large".into(),
    })?;
    let mut samples = vec![0; length];
    let info = reader.next_frame(&mut samples).map_err(invalid)?;
    let values: Vec<f32> = match info.bit_depth {
        BitDepth::Sixteen => {
            samples.chunks_exact(2).map(|b| f32::from(u16::from_be_bytes([b[0], b[1]])) / 65535.0).collect()
        }
        _ => samples.iter().map(|&b| f32::from(b) / 255.0).collect(),
    };
    let parts = info.color_type.samples();
    let component = |i: usize| values.iter().skip(i).step_by(parts).take(pixels as usize).copied();
    let mut image = Image::new(size);
    let colours = if parts < 3 { [0; 3] } else { [0, 1, 2] };
    for (name, i) in ["R", "G", "B"].into_iter().zip(colours) {
        image.push(name, SampleKind::Half, component(i).map(linear_from_srgb).collect());
    }
    if parts % 2 == 0 {
        image.push("A", SampleKind::Half, component(parts - 1).collect());
    }
    Ok(image)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::Seed;

    fn decoded(bytes: &[u8]) -> Result<Image, OutputError> {
        decode(Path::new("test.png"), bytes, 1 << 24)
    }

    #[test]
    fn standard_view_is_srgb_and_exposure_counts_in_stops() {
        let middle = on_screen(View::Standard, [0.2158605, 0.0, 2.0]);
        assert!((middle[0] - 128.0 / 255.0).abs() < 1e-4 && middle[1] == 0.0 && middle[2] > 0.9999);
        let one = encode(&[[0.5; 3]], [1, 1], View::Standard, 0.0).unwrap();
        let two = encode(&[[0.125; 3]], [1, 1], View::Standard, 2.0).unwrap();
        assert_eq!(one, two);
    }

    #[test]
    fn what_is_written_is_tagged_and_read_back() {
        let rgb: Vec<[f32; 3]> = (0..12).map(|i| [i as f32 / 11.0, 0.25, 1.0 - i as f32 / 11.0]).collect();
        let bytes = encode(&rgb, [4, 3], View::Standard, 0.0).unwrap();
        assert!(bytes.windows(4).any(|w| w == b"sRGB"));
        let back = decoded(&bytes).unwrap();
        for (c, expected) in back.to_rgb("").unwrap().iter().zip(&rgb) {
            assert!((0..3).all(|i| (c[i] - expected[i]).abs() < 5e-3));
        }
        assert!(encode(&rgb, [5, 3], View::Standard, 0.0).is_err());
    }

    #[test]
    fn bad_files_are_errors_or_pictures_but_never_panics() {
        let good = encode(&[[0.3; 3]; 64], [8, 8], View::Standard, 0.0).unwrap();
        for length in 0..good.len() - 16 {
            assert!(decoded(&good[..length]).is_err());
        }
        for i in 0..3000 {
            let mut bad = good.clone();
            let word = Seed(8).word(i);
            let place = (word >> 8) as usize % bad.len();
            bad[place] = word as u8;
            let _ = decoded(&bad);
        }
    }
}
