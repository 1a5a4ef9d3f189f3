//! Points as files: CSV with a line for each, NPY as NumPy reads it, and binary PLY in two or three dimensions; particles as PLY.

use crate::particles::Particles;
use crate::points::PointSet;
use std::fmt::Write;

/// Kinds of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PointFormat {
    /// Text: a first line `x0,x1,…`, then a point a line.
    Csv,
    /// A NumPy array of double precision, points by dimensions.
    Npy,
    /// Stanford PLY, binary little-endian, single precision: `x y z`, where z is 0 of points in the plane.
    Ply,
}

impl PointFormat {
    /// By the ending of a file name, without the dot and in small letters.
    pub fn from_extension(extension: &str) -> Option<Self> {
        match extension {
            "csv" => Some(Self::Csv),
            "npy" => Some(Self::Npy),
            "ply" => Some(Self::Ply),
            _ => None,
        }
    }

    /// The bytes of a file. Of more than three dimensions PLY has the first three.
    pub fn encode(self, set: &PointSet) -> Vec<u8> {
        match self {
            Self::Csv => csv(set).into_bytes(),
            Self::Npy => npy(set),
            Self::Ply => ply(set),
        }
    }
}

fn csv(set: &PointSet) -> String {
    let mut text = (0..set.dimension).map(|i| format!("x{i}")).collect::<Vec<_>>().join(",");
    text.push('\n');
    for i in 0..set.len() {
        for (axis, x) in set.point(i).iter().enumerate() {
            let _ = write!(text, "{}{x}", if axis > 0 { "," } else { "" });
        }
        text.push('\n');
    }
    text
}

fn npy(set: &PointSet) -> Vec<u8> {
    let shape = format!("({}, {})", set.len(), set.dimension);
    let mut header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}");
    // Ten bytes come before; all of it is a multiple of 64 and ends with a new line.
    let padded = (10 + header.len() + 1).next_multiple_of(64) - 10;
    header.extend(std::iter::repeat_n(' ', padded - header.len() - 1));
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(set.coordinates.iter().flat_map(|x| x.to_le_bytes()));
    bytes
}

fn ply(set: &PointSet) -> Vec<u8> {
    let mut bytes = ply_header("points", set.len(), &["x", "y", "z"]);
    for i in 0..set.len() {
        let point = set.point(i);
        for axis in 0..3 {
            bytes.extend((point.get(axis).copied().unwrap_or(0.0) as f32).to_le_bytes());
        }
    }
    bytes
}

fn ply_header(what: &str, count: usize, properties: &[&str]) -> Vec<u8> {
    let mut text =
        format!("ply\nformat binary_little_endian 1.0\ncomment {what} from curlsmoke\nelement vertex {count}\n");
    properties.iter().for_each(|name| text += &format!("property float {name}\n"));
    text += "end_header\n";
    text.into_bytes()
}

/// What is written of a particle: place [m], velocity [m/s], time since birth and length of its life [s], mass [density unit · m³] and
/// kernel radius [m].
const PARTICLE_PROPERTIES: [&str; 10] = ["x", "y", "z", "vx", "vy", "vz", "age", "lifetime", "mass", "radius"];

/// Size of a particle in a file of [`particles_ply`] [bytes].
pub const PARTICLE_BYTES: usize = PARTICLE_PROPERTIES.len() * size_of::<f32>();

/// Particles as binary little-endian PLY, single precision, in their order; `lifetime` is asked with the identity of each.
pub fn particles_ply(particles: &Particles, lifetime: impl Fn(u64) -> f32) -> Vec<u8> {
    let mut bytes = ply_header("particles", particles.len(), &PARTICLE_PROPERTIES);
    bytes.reserve_exact(particles.len() * PARTICLE_BYTES);
    for i in 0..particles.len() {
        let axes = particles.position.iter().chain(&particles.velocity).map(|axis| axis[i]);
        let others = [particles.age[i], lifetime(particles.id[i]), particles.mass[i], particles.radius[i]];
        bytes.extend(axes.chain(others).flat_map(f32::to_le_bytes));
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set() -> PointSet {
        PointSet { dimension: 2, coordinates: vec![0.25, 0.5, 0.75, 1.0 / 3.0] }
    }

    #[test]
    fn files_are_as_their_formats_say() {
        let text = String::from_utf8(PointFormat::Csv.encode(&set())).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[..2], ["x0,x1", "0.25,0.5"]);
        assert_eq!(lines[2].split(',').nth(1).unwrap().parse::<f64>().unwrap(), 1.0 / 3.0);
        let npy = PointFormat::Npy.encode(&set());
        let header_end = 10 + usize::from(u16::from_le_bytes([npy[8], npy[9]]));
        assert_eq!((header_end % 64, npy[header_end - 1], npy.len()), (0, b'\n', header_end + 32));
        assert_eq!(f64::from_le_bytes(npy[header_end + 16..header_end + 24].try_into().unwrap()), 0.75);
        let ply = PointFormat::Ply.encode(&set());
        let end = ply.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        assert_eq!(ply.len() - end, 24);
        assert_eq!(f32::from_le_bytes(ply[end + 12..end + 16].try_into().unwrap()), 0.75);
    }
}
