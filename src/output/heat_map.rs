//! Pictures of where two pictures differ.

use crate::output::compare::Report;
use crate::output::exr::{self, Compression};
use crate::output::file::write_atomic;
use crate::output::image::{Image, SampleKind};
use crate::output::{OutputError, extension, png};
use std::path::Path;

/// Colours from no difference to the largest shown: black, blue, red, yellow, white.
const RAMP: [[f32; 3]; 5] = [[0.0, 0.0, 0.0], [0.1, 0.1, 0.8], [0.9, 0.1, 0.1], [1.0, 0.9, 0.1], [1.0, 1.0, 1.0]];

/// Whether the ending of a name is one of a map.
pub fn is_known(path: &Path) -> bool {
    matches!(extension(path).as_str(), "exr" | "png")
}

/// Writes how bad each pixel is: as numbers in channel Y of an .exr file, or as colours, white from the 99.9th
/// percentile up, in a .png file.
///
/// # Errors
/// When the ending is neither, the report has no map (windows of different size), or the file cannot be written.
pub fn write(path: &Path, report: &Report) -> Result<(), OutputError> {
    if report.map.is_empty() {
        let problem = "the pictures do not have the same size, so there is no map of differences".to_string();
        return Err(OutputError::Encoding { format: "heat map", problem });
    }
    let bytes = match extension(path).as_str() {
        "exr" => {
            let mut image = Image::new(report.map_size);
            image.push("Y", SampleKind::Float, report.map.clone());
            exr::write(&image, Compression::default())?
        }
        "png" => png::encode_bytes(&colours(&report.map), report.map_size)?,
        _ => return Err(OutputError::UnknownFormat { path: path.into() }),
    };
    write_atomic(path, &bytes)
}

/// The bytes of a .png of the map, and the number that is white.
///
/// # Errors
/// When the report has no map.
pub fn encode_png(report: &Report) -> Result<(Vec<u8>, f32), OutputError> {
    Ok((png::encode_bytes(&colours(&report.map), report.map_size)?, white(&report.map)))
}

/// The 99.9th percentile, or 1 where that is 0.
fn white(map: &[f32]) -> f32 {
    let mut sorted: Vec<f32> = map.iter().copied().filter(|x| x.is_finite()).collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let top = sorted.len().saturating_sub(1) * 999 / 1000;
    sorted.get(top).copied().filter(|&s| s > 0.0).unwrap_or(1.0)
}

fn colours(map: &[f32]) -> Vec<u8> {
    let scale = white(map);
    map.iter().flat_map(|&x| ramp(if x.is_finite() { (x / scale).clamp(0.0, 1.0) } else { 1.0 })).collect()
}

fn ramp(x: f32) -> [u8; 3] {
    let place = x * (RAMP.len() - 1) as f32;
    let low = (place as usize).min(RAMP.len() - 2);
    let t = place - low as f32;
    std::array::from_fn(|i| ((RAMP[low][i] * (1.0 - t) + RAMP[low + 1][i] * t) * 255.0).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_kinds_are_written_and_can_be_read() {
        let folder = tempfile::tempdir().unwrap();
        let mut report = Report { map_size: [2, 2], map: vec![0.0, 1.0, 2.0, f32::INFINITY], ..Report::default() };
        for name in ["map.exr", "map.png"] {
            let path = folder.path().join(name);
            write(&path, &report).unwrap();
            assert_eq!(crate::output::read_image(&path, 1 << 20).unwrap().size, [2, 2]);
        }
        assert!(write(&folder.path().join("map.jpg"), &report).is_err());
        report.map.clear();
        assert!(write(&folder.path().join("map.exr"), &report).is_err());
    }

    #[test]
    fn worse_is_brighter() {
        let bytes = colours(&[0.0, 0.5, 1.0, f32::NAN]);
        assert_eq!((&bytes[..3], &bytes[9..]), (&[0, 0, 0][..], &[255, 255, 255][..]));
    }
}
