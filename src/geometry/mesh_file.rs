//! OBJ and PLY files as meshes.
//!
//! Only positions, normals and faces are read; polygons become fans of triangles. Files may be truncated, huge or
//! hostile: every failure is an error with its place, and memory is bounded before anything is read.

use crate::geometry::gltf_file::{GltfBody, parse_gltf};
use crate::geometry::mesh::{Mesh, MeshError};
use crate::geometry::motion::Link;
use glam::Vec3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Encoding, Property, PropertyAccess, PropertyAccessResult};
use std::io::{BufRead, Cursor, ErrorKind, Read};
use std::path::{Path, PathBuf};

/// Memory that reading takes for each byte of the file, at the worst seen: short lines become structs, hash entries
/// and vectors that are doubled while they grow.
const MEMORY_PER_BYTE: u64 = 48;

/// Why a file is not a mesh.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// There is no such file.
    #[error("{}: no such file", path.display())]
    NotFound {
        /// The file.
        path: PathBuf,
    },
    /// It cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// It is of no format that is read.
    #[error("{}: is none of .obj, .ply, .glb and .gltf", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// Reading it could take more memory than allowed.
    #[error("{}: reading {size} bytes can take {needed} bytes of memory, more than the limit of {limit}", path.display())]
    Memory {
        /// The file.
        path: PathBuf,
        /// Its size [bytes].
        size: u64,
        /// What reading it can take [bytes].
        needed: u64,
        /// What is allowed [bytes].
        limit: u64,
    },
    /// Its text does not say what its format wants.
    #[error("{}{}: {reason}", path.display(), line.map(|l| format!(":{l}")).unwrap_or_default())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The line, from 1, where it is known.
        line: Option<usize>,
        /// What is wrong.
        reason: String,
    },
    /// It holds no mesh.
    #[error("{}: {source}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: MeshError,
    },
}

/// A complaint without the file's name.
pub(in crate::geometry) struct Complaint {
    line: Option<usize>,
    reason: String,
}

impl Complaint {
    pub(in crate::geometry) fn new(line: Option<usize>, reason: impl Into<String>) -> Self {
        Self { line, reason: reason.into() }
    }
}

/// Positions, normals (as many, or none) and triangles.
type Parts = (Vec<Vec3>, Vec<Vec3>, Vec<[u32; 3]>);

/// Reads an .obj or .ply file.
///
/// # Errors
/// Where the file is missing, malformed, no mesh, or so large that reading it could take more than `memory_limit` bytes.
pub fn read_mesh(path: &Path, memory_limit: u64) -> Result<Mesh, MeshFileError> {
    parse_mesh(&read_bytes(path, memory_limit)?, path)
}

/// Reads a .glb or .gltf file: its mesh, of `node` and what is inside of it where one is named, and the spaces that move it,
/// the outermost first.
///
/// # Errors
/// As [`read_mesh`], and for what is not read of such files.
pub fn read_body(path: &Path, node: Option<&str>, memory_limit: u64) -> Result<(Mesh, Vec<Link>), MeshFileError> {
    let bytes = read_bytes(path, memory_limit)?;
    let GltfBody { positions, normals, triangles, links } = parse_gltf(&bytes, path, node, memory_limit)
        .map_err(|Complaint { line, reason }| MeshFileError::Malformed { path: path.into(), line, reason })?;
    let mesh = Mesh::try_new(positions, normals, triangles);
    Ok((mesh.map_err(|source| MeshFileError::Invalid { path: path.into(), source })?, links))
}

/// Reads a file from which a mesh can be made within `memory_limit` bytes.
pub(in crate::geometry) fn read_bytes(path: &Path, memory_limit: u64) -> Result<Vec<u8>, MeshFileError> {
    let unreadable = |source: std::io::Error| match source.kind() {
        ErrorKind::NotFound => MeshFileError::NotFound { path: path.into() },
        _ => MeshFileError::Unreadable { path: path.into(), source },
    };
    // To open a pipe waits for its other end, perhaps for ever.
    if !std::fs::metadata(path).map_err(unreadable)?.is_file() {
        return Err(unreadable(std::io::Error::new(ErrorKind::InvalidInput, "it is no regular file")));
    }
    let file = std::fs::File::open(path).map_err(unreadable)?;
    let over = |size: u64| {
        let needed = size.saturating_mul(MEMORY_PER_BYTE);
        MeshFileError::Memory { path: path.into(), size, needed, limit: memory_limit }
    };
    // The size on disk is asked first, and held to while reading: devices have none and files can grow.
    let largest = memory_limit / MEMORY_PER_BYTE;
    let size = file.metadata().map_err(unreadable)?.len();
    if size > largest {
        return Err(over(size));
    }
    let mut bytes = Vec::with_capacity(size as usize);
    file.take(largest + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > largest {
        return Err(over(bytes.len() as u64));
    }
    Ok(bytes)
}

/// Reads the content of a file; `path` names it in errors and says its format.
///
/// # Errors
/// Where it is malformed or no mesh.
pub fn parse_mesh(bytes: &[u8], path: &Path) -> Result<Mesh, MeshFileError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    let parts = match extension.as_deref() {
        Some("ply") => parse_ply(bytes),
        Some("obj") => parse_obj(bytes),
        _ => return Err(MeshFileError::UnknownFormat { path: path.into() }),
    };
    let (positions, normals, triangles) =
        parts.map_err(|Complaint { line, reason }| MeshFileError::Malformed { path: path.into(), line, reason })?;
    Mesh::try_new(positions, normals, triangles).map_err(|source| MeshFileError::Invalid { path: path.into(), source })
}

/// Counts the lines handed out, because the reader of OBJ files does not say where it stopped.
struct LineCounter<'a> {
    rest: Cursor<&'a [u8]>,
    lines: usize,
}

impl Read for LineCounter<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        self.rest.read(out)
    }
}

impl BufRead for LineCounter<'_> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        self.rest.fill_buf()
    }

    fn consume(&mut self, amount: usize) {
        // Lines are taken one at a time.
        self.lines += usize::from(amount > 0);
        self.rest.consume(amount);
    }
}

fn parse_obj(bytes: &[u8]) -> Result<Parts, Complaint> {
    check_obj(bytes)?;
    let options = tobj::LoadOptions { single_index: true, triangulate: true, ignore_points: true, ignore_lines: true };
    let mut reader = LineCounter { rest: Cursor::new(bytes), lines: 0 };
    let no_materials = |_: &Path| Ok((Vec::new(), Default::default()));
    let (models, _) = tobj::load_obj_buf(&mut reader, &options, no_materials)
        .map_err(|error| Complaint::new(Some(reader.lines), error.to_string()))?;

    let (mut positions, mut normals, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    let has_normals = models.iter().all(|m| m.mesh.normals.len() == m.mesh.positions.len());
    for mesh in models.iter().map(|model| &model.mesh) {
        let first = positions.len() as u64;
        let triples = |numbers: &[f32]| -> Vec<Vec3> { numbers.chunks_exact(3).map(Vec3::from_slice).collect() };
        positions.extend(triples(&mesh.positions));
        if has_normals {
            normals.extend(triples(&mesh.normals));
        }
        if positions.len() as u64 > u64::from(u32::MAX) {
            return Err(Complaint::new(None, "more vertices than can be numbered"));
        }
        triangles.extend(mesh.indices.chunks_exact(3).map(|t| [0, 1, 2].map(|i| (first + u64::from(t[i])) as u32)));
    }
    Ok((positions, normals, triangles))
}

/// Finds what the reader would pass over or report without its line: coordinates that are not finite, and faces with
/// vertices that do not exist.
fn check_obj(bytes: &[u8]) -> Result<(), Complaint> {
    let mut vertex_count = 0i64;
    for (i, line) in bytes.split(|b| *b == b'\n').enumerate() {
        let Ok(line) = std::str::from_utf8(line) else {
            return Err(Complaint::new(Some(i + 1), "is not UTF-8 text"));
        };
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some(kind @ ("v" | "vn")) => {
                vertex_count += i64::from(kind == "v");
                let is_bad = |w: &str| w.parse::<f32>().is_ok_and(|x| !x.is_finite());
                if let Some(word) = words.take(3).find(|w| is_bad(w)) {
                    return Err(Complaint::new(Some(i + 1), format!("the coordinate {word} is not a finite number")));
                }
            }
            Some("f") => {
                for word in words {
                    let Ok(index) = word.split('/').next().unwrap_or(word).parse::<i64>() else { continue };
                    if index == 0 || index < -vertex_count {
                        let reason = format!("there is no vertex {index}; {vertex_count} come before this line");
                        return Err(Complaint::new(Some(i + 1), reason));
                    }
                }
            }
            _ => {}
        }
    }
    // Faces may name vertices that come later.
    for (i, line) in
        bytes.split(|b| *b == b'\n').enumerate().filter(|(_, line)| line.trim_ascii_start().starts_with(b"f"))
    {
        let words = std::str::from_utf8(line).unwrap_or_default().split_ascii_whitespace().skip(1);
        let indices = words.filter_map(|w| w.split('/').next().unwrap_or(w).parse::<i64>().ok());
        if let Some(index) = indices.max().filter(|index| *index > vertex_count) {
            let reason = format!("there is no vertex {index}; the file has {vertex_count}");
            return Err(Complaint::new(Some(i + 1), reason));
        }
    }
    Ok(())
}

/// A vertex or a face of a PLY file.
#[derive(Debug, Default)]
struct PlyElement {
    position: [f32; 3],
    normal: [f32; 3],
    corners: Vec<u32>,
}

impl PropertyAccess for PlyElement {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let place = match name {
            "x" => &mut self.position[0],
            "y" => &mut self.position[1],
            "z" => &mut self.position[2],
            "nx" => &mut self.normal[0],
            "ny" => &mut self.normal[1],
            "nz" => &mut self.normal[2],
            "vertex_indices" | "vertex_index" => {
                return match property.to_u32_list() {
                    Some(corners) => {
                        self.corners = corners;
                        PropertyAccessResult::Set
                    }
                    None => PropertyAccessResult::UnsupportedType,
                };
            }
            _ => return PropertyAccessResult::Ignored,
        };
        match property.to_f32_lossy() {
            Some(number) => {
                *place = number;
                PropertyAccessResult::Set
            }
            None => PropertyAccessResult::UnsupportedType,
        }
    }
}

fn parse_ply(bytes: &[u8]) -> Result<Parts, Complaint> {
    let parser = Parser::<PlyElement>::new();
    let mut reader = Reader::new(Cursor::new(bytes));
    let complaint = |e: ply_rs_bw::parser::ParseError| {
        // The first line says what, the second what was found; the rest is the reader's own business.
        let said = e.to_string();
        let said =
            said.split_once(": ").filter(|(start, _)| start.starts_with("Line ")).map_or(said.as_str(), |(_, s)| s);
        let reason: Vec<&str> = said.lines().take(2).map(str::trim).collect();
        Complaint::new(e.line(), reason.join(" ").chars().take(200).collect::<String>())
    };
    let header = parser.read_header(&mut reader).map_err(complaint)?;
    let is_ascii = header.encoding == Encoding::Ascii;
    let line = |reader: &Reader<Cursor<&[u8]>>| is_ascii.then_some(reader.line());
    let (mut positions, mut normals, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    for (name, element) in &header.elements {
        // Every element takes a byte at least, so a larger count is a lie that need not be read to be found out.
        let is_possible = element.count <= bytes.len() && (element.count == 0 || !element.properties.is_empty());
        if !is_possible {
            let reason = format!("{} elements {name:?} cannot fit into {} bytes", element.count, bytes.len());
            return Err(Complaint::new(None, reason));
        }
        let before = line(&reader);
        let elements = parser.read_payload_for_element(&mut reader, element, &header).map_err(complaint)?;
        let has = |names: &[&str]| names.iter().all(|n| element.properties.keys().any(|k| k == n));
        match name.as_str() {
            "vertex" => {
                if !has(&["x", "y", "z"]) {
                    return Err(Complaint::new(None, "its vertices have no x, y and z"));
                }
                positions.extend(elements.iter().map(|e| Vec3::from_array(e.position)));
                if let Some(i) = positions.iter().position(|p: &Vec3| !p.is_finite()) {
                    let reason = format!("vertex {i} (counting from 0) has the coordinates {}", positions[i]);
                    return Err(Complaint::new(before.map(|line| line + i), reason));
                }
                if has(&["nx", "ny", "nz"]) {
                    normals.extend(elements.iter().map(|e| Vec3::from_array(e.normal)));
                }
            }
            "face" => {
                for (i, corners) in elements.iter().map(|e| &e.corners).enumerate() {
                    if let Some(index) = corners.iter().find(|c| **c as usize >= header_count(&header, "vertex")) {
                        let reason = format!("face {i} (counting from 0) uses vertex {index}, which does not exist");
                        return Err(Complaint::new(before.map(|line| line + i), reason));
                    }
                    triangles.extend((2..corners.len()).map(|k| [corners[0], corners[k - 1], corners[k]]));
                }
            }
            _ => {}
        }
    }
    Ok((positions, normals, triangles))
}

fn header_count(header: &ply_rs_bw::ply::Header, name: &str) -> usize {
    header.elements.get(name).map_or(0, |element| element.count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};

    const CUBE_OBJ: &str = "# a cube\no cube\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
        f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 2 3 7 6\nf -8 -4 -1 -5\n";

    const CUBE_FACES: [[u8; 4]; 6] =
        [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [2, 3, 7, 6], [1, 2, 6, 5], [0, 4, 7, 3]];

    fn cube_corner(i: u8) -> [f32; 3] {
        [[0., 0.], [1., 0.], [1., 1.], [0., 1.]].map(|[x, y]| [x, y, f32::from(i / 4)])[usize::from(i % 4)]
    }

    fn cube_ply(format: &str) -> Vec<u8> {
        let mut bytes = format!(
            "ply\nformat {format} 1.0\ncomment a cube\nelement vertex 8\nproperty float x\nproperty float y\n\
             property float z\nproperty uchar red\nelement face 6\nproperty list uchar int vertex_indices\nend_header\n"
        )
        .into_bytes();
        let is_big = format.contains("big");
        let float = |x: f32| if is_big { x.to_be_bytes() } else { x.to_le_bytes() };
        let int = |x: i32| if is_big { x.to_be_bytes() } else { x.to_le_bytes() };
        for i in 0..8 {
            let p = cube_corner(i);
            if format == "ascii" {
                bytes.extend(format!("{} {} {} 255\n", p[0], p[1], p[2]).bytes());
            } else {
                p.iter().for_each(|x| bytes.extend(float(*x)));
                bytes.push(255);
            }
        }
        for face in CUBE_FACES {
            if format == "ascii" {
                bytes.extend(format!("4 {} {} {} {}\n", face[0], face[1], face[2], face[3]).bytes());
            } else {
                bytes.push(4);
                face.iter().for_each(|i| bytes.extend(int(i32::from(*i))));
            }
        }
        bytes
    }

    fn parsed(name: &str, bytes: &[u8]) -> Result<Mesh, MeshFileError> {
        parse_mesh(bytes, Path::new(name))
    }

    fn said(name: &str, text: &str) -> String {
        parsed(name, text.as_bytes()).expect_err("refused").to_string()
    }

    #[test]
    fn a_cube_is_the_same_from_every_format() {
        let mut files = vec![("cube.OBJ", CUBE_OBJ.as_bytes().to_vec())];
        files.extend(["ascii", "binary_little_endian", "binary_big_endian"].map(|f| ("cube.ply", cube_ply(f))));
        for (name, bytes) in files {
            let mesh = parsed(name, &bytes).expect("valid");
            assert_eq!((mesh.triangles().len(), mesh.report().vertex_count), (12, 8));
            assert!(mesh.report().is_clean() && (mesh.signed_volume() - 1.0).abs() < 1e-6, "{}", mesh.report());
        }
    }

    #[test]
    fn normals_come_along_and_models_are_joined() {
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\no a\nf 1//1 2//1 3//1\nv 0 0 5\nv 1 0 5\nv 0 1 5\no b\nf 4//1 5//1 6//1\n";
        let mesh = parsed("two.obj", text.as_bytes()).expect("valid");
        assert_eq!((mesh.triangles().len(), mesh.normals().len()), (2, 6));
        assert!(mesh.normals().iter().all(|n| *n == Vec3::Z));
        assert_eq!(mesh.report().open_edges, 6);
    }

    #[test]
    fn faults_are_reported_with_their_line() {
        assert!(said("a.obj", "v 0 0 0\nv 1 0 nan\n").contains("a.obj:2: the coordinate nan"));
        assert!(said("a.obj", "v 0 0 0\nv 1 0 1e99\n").contains("a.obj:2:"));
        assert!(said("a.obj", "v 0 0 0\nv 1 0 x\n").contains("a.obj:2:"));
        assert!(said("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n").contains("a.obj:4: there is no vertex 4"));
        assert!(said("a.obj", "v 0 0 0\nf -1 -2 -3\nv 1 0 0\nv 0 1 0\n").contains("a.obj:2: there is no vertex -2"));
        assert!(said("a.obj", "v 0 0 0\nf 0 1 1\n").contains("a.obj:2:"));
        assert!(said("a.obj", "").contains("has no triangles"));
        let ascii = String::from_utf8(cube_ply("ascii")).expect("text");
        let header_lines = 11;
        let bad = ascii.replacen("\n0 0 0 255\n1 0 0", "\n0 0 0 255\nnan 0 0", 1);
        assert!(said("a.ply", &bad).contains(&format!("a.ply:{}: ", header_lines + 2)), "{}", said("a.ply", &bad));
        let bad = ascii.replace("4 4 5 6 7", "4 4 5 6 8");
        assert!(
            said("a.ply", &bad).contains(&format!("a.ply:{}: face 1", header_lines + 8 + 2)),
            "{}",
            said("a.ply", &bad)
        );
        assert!(said("a.ply", &ascii.replace("property float z\n", "")).contains("a.ply"));
        assert!(said("a.stl", "solid").contains("none of .obj, .ply"));
    }

    #[test]
    fn counts_that_cannot_be_are_refused_at_once() {
        for (name, count) in [("vertex", u64::MAX), ("vertex", 1 << 40), ("other", 1 << 50)] {
            for property in ["property float x\n", ""] {
                for format in ["ascii", "binary_little_endian"] {
                    let text = format!("ply\nformat {format} 1.0\nelement {name} {count}\n{property}end_header\n0\n");
                    assert!(parsed("a.ply", text.as_bytes()).is_err());
                }
            }
        }
        let list =
            "ply\nformat binary_little_endian 1.0\nelement face 1\nproperty list int int vertex_indices\nend_header\n";
        let mut bytes = list.as_bytes().to_vec();
        bytes.extend(i32::MAX.to_le_bytes());
        assert!(parsed("a.ply", &bytes).is_err());
    }

    #[test]
    fn truncated_and_mangled_files_never_panic() {
        let files: Vec<(&str, Vec<u8>)> = std::iter::once(("a.obj", CUBE_OBJ.as_bytes().to_vec()))
            .chain(["ascii", "binary_little_endian", "binary_big_endian"].map(|f| ("a.ply", cube_ply(f))))
            .collect();
        let mut rng = CounterRng::new(Seed(99));
        let mut below = |n: usize| ((f64::from(rng.uniform()) * n as f64) as usize).min(n - 1);
        for (name, bytes) in files {
            for length in 0..bytes.len() {
                let _ = parsed(name, &bytes[..length]);
            }
            for _ in 0..4000 {
                let mut bad = bytes.clone();
                for _ in 0..=below(6) {
                    let at = below(bad.len());
                    match below(4) {
                        0 => bad[at] = below(256) as u8,
                        1 => bad[at] = b"0123456789-+.e/ \nvfn"[below(20)],
                        2 => drop(bad.remove(at)),
                        _ => bad.insert(at, b"9-/ \n"[below(5)]),
                    }
                }
                let _ = parsed(name, &bad);
            }
        }
    }

    #[test]
    fn missing_and_oversized_files_are_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("cube.obj");
        assert!(matches!(read_mesh(&path, 1 << 20), Err(MeshFileError::NotFound { .. })));
        std::fs::write(&path, CUBE_OBJ).expect("written");
        assert!(read_mesh(&path, 1 << 20).is_ok());
        assert!(matches!(read_mesh(&path, 1 << 10), Err(MeshFileError::Memory { .. })));
    }
}
