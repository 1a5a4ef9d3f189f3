//! Lines as files: OBJ with `l` elements, and binary PLY with edges and the speed at each vertex.

use crate::inspect::streamlines::Line;
use std::fmt::Write;

/// Kinds of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineFormat {
    /// Wavefront OBJ: positions, and a polyline for each line.
    Obj,
    /// Stanford PLY, binary little-endian: vertices with `x y z speed time`, and `edge` elements.
    Ply,
}

impl LineFormat {
    /// By the ending of a file name, without the dot and in small letters.
    pub fn from_extension(extension: &str) -> Option<Self> {
        match extension {
            "obj" => Some(Self::Obj),
            "ply" => Some(Self::Ply),
            _ => None,
        }
    }

    /// The bytes of a file. Positions [m], speeds [m/s] and times [s] are in single precision.
    pub fn encode(self, lines: &[Line]) -> Vec<u8> {
        match self {
            Self::Obj => obj(lines).into_bytes(),
            Self::Ply => ply(lines),
        }
    }
}

fn obj(lines: &[Line]) -> String {
    let mut text = String::from("# Lines of a flow, from curlsmoke. Metres.\n");
    for point in lines.iter().flat_map(|line| &line.points) {
        let p = point.position.as_vec3();
        let _ = writeln!(text, "v {} {} {}", p.x, p.y, p.z);
    }
    let mut first = 1;
    for line in lines {
        text.push('l');
        for i in 0..line.points.len() {
            let _ = write!(text, " {}", first + i);
        }
        text.push('\n');
        first += line.points.len();
    }
    text
}

fn ply(lines: &[Line]) -> Vec<u8> {
    let vertices: usize = lines.iter().map(|line| line.points.len()).sum();
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\ncomment lines of a flow, from curlsmoke; metres and seconds\n\
         element vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\nproperty float speed\n\
         property float time\nelement edge {}\nproperty int vertex1\nproperty int vertex2\nend_header\n",
        vertices - lines.len()
    )
    .into_bytes();
    for point in lines.iter().flat_map(|line| &line.points) {
        let [x, y, z] = point.position.to_array();
        bytes.extend([x, y, z, point.speed, point.time].iter().flat_map(|v| (*v as f32).to_le_bytes()));
    }
    let mut first = 0u32;
    for line in lines {
        let count = line.points.len() as u32;
        for i in first..first + count - 1 {
            bytes.extend(i.to_le_bytes());
            bytes.extend((i + 1).to_le_bytes());
        }
        first += count;
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspect::probe::known::Rotation;
    use crate::inspect::streamlines::{Reach, TraceSettings, trace};
    use glam::DVec3;
    use ply_rs_bw::parser::Parser;
    use ply_rs_bw::ply::{DefaultElement, Property};

    fn lines() -> Vec<Line> {
        let settings = TraceSettings { reach: Reach::Seconds(1.0), step: 0.25, start: 0.5 };
        trace(&Rotation { rate: 1.0, ball: None }, &[DVec3::X, DVec3::new(0.0, 2.0, 1.0)], &settings)
    }

    #[test]
    fn a_ply_file_read_again_has_the_same_lines() {
        let lines = lines();
        let bytes = LineFormat::Ply.encode(&lines);
        let ply = Parser::<DefaultElement>::new().read_ply(&mut bytes.as_slice()).unwrap();
        let points: Vec<_> = lines.iter().flat_map(|line| &line.points).collect();
        let vertices = &ply.payload["vertex"];
        assert_eq!(vertices.len(), points.len());
        for (vertex, point) in vertices.iter().zip(points) {
            let [x, y, z] = point.position.to_array();
            for (key, value) in [("x", x), ("y", y), ("z", z), ("speed", point.speed), ("time", point.time)] {
                assert!(matches!(vertex[key], Property::Float(v) if v == value as f32), "{key}");
            }
        }
        let edges: Vec<_> = ply.payload["edge"].iter().map(|e| (e["vertex1"].clone(), e["vertex2"].clone())).collect();
        let expected = [0, 1, 2, 3, 5, 6, 7, 8].map(|i| (Property::Int(i), Property::Int(i + 1)));
        assert_eq!(edges, expected);
    }

    #[test]
    fn an_obj_file_read_again_has_the_same_lines() {
        let lines = lines();
        let text = String::from_utf8(LineFormat::Obj.encode(&lines)).unwrap();
        let numbers = |line: &str| line.split(' ').skip(1).map(|n| n.parse::<f32>().unwrap()).collect::<Vec<_>>();
        let of_kind = |kind: &str| text.lines().filter(|l| l.starts_with(kind)).map(numbers).collect::<Vec<_>>();
        let (vertices, polylines) = (of_kind("v "), of_kind("l "));
        assert_eq!(polylines, [[1.0, 2.0, 3.0, 4.0, 5.0], [6.0, 7.0, 8.0, 9.0, 10.0]]);
        for (v, point) in vertices.iter().zip(lines.iter().flat_map(|line| &line.points)) {
            assert_eq!(v.as_slice(), point.position.as_vec3().to_array());
        }
    }

    #[test]
    fn no_lines_are_a_valid_file() {
        let bytes = LineFormat::Ply.encode(&[]);
        assert!(Parser::<DefaultElement>::new().read_ply(&mut bytes.as_slice()).is_ok());
        assert!(LineFormat::Obj.encode(&[]).starts_with(b"#"));
    }
}
