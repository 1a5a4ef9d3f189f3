//! Radiance pictures (.hdr), which many skies come as: reading only.
//!
//! Format: Ward, *Real Pixels*, Graphics Gems II (1991), and the manual pages of Radiance. Lines are flat or run-length
//! encoded by component; of the eight orientations only the usual one, top line first, is read.

use crate::output::image::{Image, SampleKind};
use crate::output::{OutputError, check_memory, read_bytes};
use std::path::Path;

/// Reads a Radiance picture into channels R, G, B.
///
/// # Errors
/// When the file is missing, unreadable or invalid, or needs more than `memory_limit` bytes.
pub fn read(path: &Path, memory_limit: u64) -> Result<Image, OutputError> {
    decode(path, &read_bytes(path, memory_limit)?, memory_limit)
}

fn invalid(path: &Path, problem: impl Into<String>) -> OutputError {
    OutputError::Invalid { path: path.into(), format: "Radiance", problem: problem.into() }
}

fn decode(path: &Path, bytes: &[u8], memory_limit: u64) -> Result<Image, OutputError> {
    let mut rest = bytes;
    let [width, height] = header(&mut rest).map_err(|problem| invalid(path, problem))?;
    let pixels = u64::from(width) * u64::from(height);
    check_memory(path, (bytes.len() as u64).saturating_add(pixels.saturating_mul(24)), memory_limit)?;
    // A line of any encoding takes a byte in 127 pixels at least, for each of four components.
    if pixels / 127 > rest.len() as u64 {
        return Err(invalid(path, format!("it ends before its {width} × {height} pixels")));
    }
    let mut rgb = Vec::with_capacity(pixels as usize);
    let mut line = vec![[0u8; 4]; width as usize];
    for y in 0..height {
        scan_line(&mut rest, &mut line).ok_or_else(|| invalid(path, format!("line {y} is damaged or missing")))?;
        rgb.extend(line.iter().map(|&pixel| radiance(pixel)));
    }
    let mut image = Image::new([width, height]);
    image.push_rgb("", SampleKind::Float, &rgb);
    Ok(image)
}

/// Width and height; leaves `rest` at the first line of pixels.
fn header(rest: &mut &[u8]) -> Result<[u32; 2], String> {
    if !text_line(rest).is_some_and(|line| line.starts_with("#?")) {
        return Err("it does not begin with #?RADIANCE".into());
    }
    loop {
        let line = text_line(rest).ok_or("its header has no end")?;
        if line.is_empty() {
            break;
        }
        if let Some(format) = line.strip_prefix("FORMAT=")
            && format != "32-bit_rle_rgbe"
        {
            return Err(format!("its format is {format}; only 32-bit_rle_rgbe is read"));
        }
    }
    let line = text_line(rest).ok_or("its resolution is missing")?;
    let words: Vec<&str> = line.split_ascii_whitespace().collect();
    let ["-Y", height, "+X", width] = words[..] else {
        return Err(format!("its resolution is `{line}`; only `-Y height +X width` is read"));
    };
    match (width.parse(), height.parse()) {
        (Ok(width), Ok(height)) if width > 0 && height > 0 => Ok([width, height]),
        _ => Err(format!("its resolution is `{line}`")),
    }
}

/// Longest line of text that a header may have [bytes].
const LINE_MAX: usize = 4096;

fn text_line(rest: &mut &[u8]) -> Option<String> {
    let end = rest.iter().take(LINE_MAX).position(|&b| b == b'\n')?;
    let line = String::from_utf8_lossy(&rest[..end]).trim_end().to_string();
    *rest = &rest[end + 1..];
    Some(line)
}

fn scan_line(rest: &mut &[u8], line: &mut [[u8; 4]]) -> Option<()> {
    let width = line.len();
    let start = rest.get(..4)?;
    let by_component = (8..0x8000).contains(&width)
        && start[..2] == [2, 2]
        && usize::from(start[2]) << 8 | usize::from(start[3]) == width;
    if !by_component {
        return flat_line(rest, line);
    }
    *rest = &rest[4..];
    for component in 0..4 {
        let mut x = 0;
        while x < width {
            let count = take(rest)?;
            let (run, repeated) = if count > 128 { (count - 128, Some(take(rest)?)) } else { (count, None) };
            if run == 0 {
                return None;
            }
            for pixel in line.get_mut(x..x + usize::from(run))? {
                pixel[component] = match repeated {
                    Some(value) => value,
                    None => take(rest)?,
                };
            }
            x += usize::from(run);
        }
    }
    Some(())
}

/// Pixels one after another; `1, 1, 1, n` repeats the one before n times, and n·256 times when it follows another such.
fn flat_line(rest: &mut &[u8], line: &mut [[u8; 4]]) -> Option<()> {
    let (mut x, mut shift) = (0, 0u32);
    while x < line.len() {
        let pixel = [take(rest)?, take(rest)?, take(rest)?, take(rest)?];
        if pixel[..3] != [1, 1, 1] {
            line[x] = pixel;
            x += 1;
            shift = 0;
            continue;
        }
        let run = usize::from(pixel[3]).checked_shl(shift).filter(|_| shift <= 16)?;
        let before = *line.get(x.checked_sub(1)?)?;
        line.get_mut(x..x + run)?.fill(before);
        x += run;
        shift += 8;
    }
    Some(())
}

fn take(rest: &mut &[u8]) -> Option<u8> {
    let (&first, others) = rest.split_first()?;
    *rest = others;
    Some(first)
}

/// Mantissas with a shared exponent: the middle of each step, as Radiance's own tools read it.
fn radiance([r, g, b, exponent]: [u8; 4]) -> [f32; 3] {
    if exponent == 0 {
        return [0.0; 3];
    }
    let scale = 2f32.powi(i32::from(exponent) - (128 + 8));
    [r, g, b].map(|mantissa| (f32::from(mantissa) + 0.5) * scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::Seed;

    fn file(resolution: &str, pixels: &[u8]) -> Vec<u8> {
        let head = format!("#?RADIANCE\n# made by hand\nFORMAT=32-bit_rle_rgbe\n\n{resolution}\n");
        [head.as_bytes(), pixels].concat()
    }

    fn decoded(bytes: &[u8]) -> Result<Image, OutputError> {
        decode(Path::new("test.hdr"), bytes, 1 << 20)
    }

    #[test]
    fn flat_pixels_and_old_runs_have_their_values() {
        let image = decoded(&file("-Y 1 +X 4", &[128, 64, 0, 129, 1, 1, 1, 2, 0, 0, 0, 0])).unwrap();
        assert_eq!(image.channel("R").unwrap(), [257.0 / 256.0, 257.0 / 256.0, 257.0 / 256.0, 0.0]);
        assert_eq!(image.channel("G").unwrap()[2], 64.5 / 128.0);
    }

    #[test]
    fn runs_by_component_have_their_values() {
        let pixels = [2, 2, 0, 8, 136, 200, 136, 100, 136, 50, 4, 129, 130, 131, 132, 132, 128];
        let image = decoded(&file("-Y 1 +X 8", &pixels)).unwrap();
        assert_eq!(image.channel("R").unwrap()[..3], [200.5 / 128.0, 200.5 / 64.0, 200.5 / 32.0]);
        assert_eq!(image.channel("B").unwrap()[7], 50.5 / 256.0);
    }

    #[test]
    fn bad_files_are_errors() {
        let good = file("-Y 1 +X 8", &[2, 2, 0, 8, 136, 200, 136, 100, 136, 50, 136, 129]);
        assert!(decoded(&good).is_ok());
        for length in 0..good.len() {
            assert!(decoded(&good[..length]).is_err());
        }
        for resolution in ["-Y 0 +X 8", "+X 8 -Y 1", "-Y 99999 +X 99999", "-Y -1 +X 8", "-Y 4294967295 +X 4294967295"] {
            assert!(decoded(&file(resolution, &[0; 64])).is_err(), "{resolution}");
        }
        for i in 0..5000 {
            let mut bad = good.clone();
            let word = Seed(3).word(i);
            let place = (word >> 8) as usize % bad.len();
            bad[place] = word as u8;
            let _ = decoded(&bad);
        }
    }
}
