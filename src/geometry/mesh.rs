//! Triangles by index, valid by construction, and what is wrong with their topology.

use crate::math::aabb::Aabb;
use crate::math::space::Similarity;
use glam::{DVec3, Vec3};
use std::collections::HashMap;
use std::f64::consts::PI;
use std::fmt;

/// Indexed triangles. Every index is in range, every number finite, no triangle has zero area, and a closed mesh has
/// its triangles counterclockwise seen from outside.
#[derive(Debug, Clone)]
pub struct Mesh {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    report: MeshReport,
}

/// Why something is not a mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// No triangle is left.
    #[error("has no triangles{}", if *degenerate > 0 { format!(" but {degenerate} without area") } else { String::new() })]
    Empty {
        /// Triangles without area.
        degenerate: usize,
    },
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} uses vertex {vertex}, but there are only {count} (counting from 0)")]
    IndexOutOfRange {
        /// The triangle, from 0.
        triangle: usize,
        /// The vertex it names, from 0.
        vertex: u32,
        /// How many there are.
        count: usize,
    },
    /// A coordinate is NaN, infinite, or too large to be squared.
    #[error("{what} {vertex} (counting from 0) has the coordinates {value}; they must be finite and below 1e15")]
    NotFinite {
        /// "vertex" or "normal".
        what: &'static str,
        /// Which, from 0.
        vertex: usize,
        /// The coordinates.
        value: Vec3,
    },
    /// Vertex normals are there for some vertices only.
    #[error("has {normals} vertex normals for {vertices} vertices")]
    NormalCount {
        /// Normals given.
        normals: usize,
        /// Vertices given.
        vertices: usize,
    },
}

/// What a mesh is made of and what is wrong with it. Vertices in the same place count as one.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MeshReport {
    /// Different positions.
    pub vertex_count: usize,
    /// Triangles with an area.
    pub triangle_count: usize,
    /// Edges with a triangle on one side only.
    pub open_edges: usize,
    /// Edges shared by more than two triangles.
    pub non_manifold_edges: usize,
    /// Edges whose two triangles face opposite sides.
    pub flipped_edges: usize,
    /// Triangles without area; left out.
    pub degenerate_triangles: usize,
    /// The mesh was closed and all its triangles faced inwards; they have been turned round.
    pub was_inside_out: bool,
}

impl MeshReport {
    /// True where the triangles bound a solid: nothing open, flipped or shared too often.
    pub fn is_closed(&self) -> bool {
        self.open_edges == 0 && self.non_manifold_edges == 0 && self.flipped_edges == 0
    }

    /// True where there is nothing that a user should know.
    pub fn is_clean(&self) -> bool {
        self.is_closed() && self.degenerate_triangles == 0 && !self.was_inside_out
    }
}

impl fmt::Display for MeshReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} vertices, {} triangles", self.vertex_count, self.triangle_count)?;
        let counts = [
            (self.open_edges, "open edge", "open edges", ": the mesh is not closed, and inside is a guess"),
            (self.non_manifold_edges, "edge", "edges", " shared by more than two triangles"),
            (self.flipped_edges, "edge", "edges", " between triangles that face opposite sides"),
            (self.degenerate_triangles, "triangle", "triangles", " without area, left out"),
        ];
        for (count, one, many, what) in counts.into_iter().filter(|(count, ..)| *count > 0) {
            write!(f, "; {count} {}{what}", if count == 1 { one } else { many })?;
        }
        if self.was_inside_out {
            write!(f, "; all triangles faced inwards and were turned round")?;
        }
        Ok(())
    }
}

/// Beyond this squares and products of coordinates leave the range of `f32` [m].
const LARGEST_COORDINATE: f32 = 1e15;

impl Mesh {
    /// A mesh of `triangles` (indices into `positions`, counterclockwise seen from outside). `normals` are for shading,
    /// one for each position or none; their length does not matter.
    ///
    /// # Errors
    /// Where a number is not finite, an index is out of range, or no triangle has an area.
    pub fn try_new(positions: Vec<Vec3>, normals: Vec<Vec3>, mut triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        for (what, values) in [("vertex", &positions), ("normal", &normals)] {
            if let Some(vertex) = values.iter().position(|v| v.is_nan() || v.abs().max_element() >= LARGEST_COORDINATE)
            {
                return Err(MeshError::NotFinite { what, vertex, value: values[vertex] });
            }
        }
        if !normals.is_empty() && normals.len() != positions.len() {
            return Err(MeshError::NormalCount { normals: normals.len(), vertices: positions.len() });
        }
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&i| i as usize >= positions.len()) {
                return Err(MeshError::IndexOutOfRange { triangle, vertex, count: positions.len() });
            }
        }
        let given = triangles.len();
        triangles.retain(|t| double_area(t.map(|i| positions[i as usize])) > 0.0);
        let degenerate = given - triangles.len();
        if triangles.is_empty() {
            return Err(MeshError::Empty { degenerate });
        }
        let mut report = inspect(&positions, &triangles);
        report.degenerate_triangles = degenerate;
        let mut mesh = Self { positions, normals, triangles, report };
        if mesh.report.is_closed() && mesh.signed_volume() < 0.0 {
            mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
            mesh.report.was_inside_out = true;
        }
        Ok(mesh)
    }

    /// Positions of the vertices [m].
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Normals of the vertices, of any length, or none.
    pub fn normals(&self) -> &[Vec3] {
        &self.normals
    }

    /// Corners of the triangles as places in [`Mesh::positions`].
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Corners of triangle `i` [m].
    #[inline]
    pub fn corners(&self, i: usize) -> [Vec3; 3] {
        self.triangles[i].map(|v| self.positions[v as usize])
    }

    /// What is wrong with it.
    pub fn report(&self) -> &MeshReport {
        &self.report
    }

    /// The smallest box around the triangles.
    pub fn bounds(&self) -> Aabb {
        Aabb::from_points(self.triangles.iter().flatten().map(|&i| self.positions[i as usize]))
    }

    /// Volume inside [m³], where the mesh is closed.
    pub fn signed_volume(&self) -> f64 {
        let middle = self.bounds().center();
        let six = |[a, b, c]: [DVec3; 3]| a.dot(b.cross(c));
        (0..self.triangles.len()).map(|i| six(self.corners(i).map(|p| (p - middle).as_dvec3()))).sum::<f64>() / 6.0
    }

    /// Whether a point [m] is inside, where the mesh is closed: the triangles together fill more than half of what can
    /// be seen from it. Solid angles after Van Oosterom and Strackee 1983.
    pub fn contains(&self, p: DVec3) -> bool {
        let half_angle = |i: usize| {
            let [a, b, c] = self.corners(i).map(|v| v.as_dvec3() - p);
            let (la, lb, lc) = (a.length(), b.length(), c.length());
            let across = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
            a.dot(b.cross(c)).atan2(across)
        };
        (0..self.triangles.len()).map(half_angle).sum::<f64>() > PI
    }

    /// The same mesh scaled, turned and moved.
    pub fn transformed(&self, placement: &Similarity) -> Self {
        let mut mesh = self.clone();
        mesh.positions.iter_mut().for_each(|p| *p = placement.point_to_world(*p).0);
        mesh.normals.iter_mut().for_each(|n| *n = placement.rotation * *n);
        mesh
    }

    /// The same mesh without normals, so that every triangle is shaded flat.
    pub fn without_normals(mut self) -> Self {
        self.normals = Vec::new();
        self
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> u64 {
        (12 * (self.positions.len() + self.normals.len() + self.triangles.len())) as u64
    }
}

/// Twice the area of a triangle [m²], in `f64` so that small ones do not vanish.
fn double_area(corners: [Vec3; 3]) -> f64 {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    (b - a).cross(c - a).length()
}

/// Counts the faults of the topology after vertices in the same place are made one.
fn inspect(positions: &[Vec3], triangles: &[[u32; 3]]) -> MeshReport {
    let mut places = HashMap::with_capacity(positions.len());
    let welded: Vec<u32> = positions
        .iter()
        .map(|p| {
            // Adding zero makes −0 and 0 one place.
            let key = (*p + Vec3::ZERO).to_array().map(f32::to_bits);
            let next = places.len() as u32;
            *places.entry(key).or_insert(next)
        })
        .collect();
    // For each edge how often triangles walk it from its lesser end, and from its greater end.
    let mut edges: HashMap<(u32, u32), (u32, u32)> = HashMap::with_capacity(triangles.len() * 3 / 2);
    for t in triangles {
        let v = t.map(|i| welded[i as usize]);
        for (a, b) in [(v[0], v[1]), (v[1], v[2]), (v[2], v[0])] {
            let walks = edges.entry((a.min(b), a.max(b))).or_default();
            if a < b { walks.0 += 1 } else { walks.1 += 1 }
        }
    }
    let count = |is: fn(u32, u32) -> bool| edges.values().filter(|(up, down)| is(*up, *down)).count();
    MeshReport {
        vertex_count: places.len(),
        triangle_count: triangles.len(),
        open_edges: count(|up, down| up + down == 1),
        non_manifold_edges: count(|up, down| up + down > 2),
        flipped_edges: count(|up, down| up + down == 2 && up != down),
        degenerate_triangles: 0,
        was_inside_out: false,
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A ball of `rings` by `2·rings` quadrilaterals, closed, with normals.
    pub(crate) fn ball(radius: f32, rings: u32) -> Mesh {
        revolved(rings, |polar| (radius * polar.sin(), radius * polar.cos()))
    }

    /// A torus about y, closed.
    pub(crate) fn torus(major: f32, minor: f32, count: u32) -> Mesh {
        let turn = std::f32::consts::TAU;
        let at = |i: u32, j: u32| {
            let (u, v) = (turn * i as f32 / count as f32, turn * j as f32 / count as f32);
            let out = Vec3::new(u.cos(), 0.0, -u.sin());
            (out * (major + minor * v.cos()) + Vec3::Y * minor * v.sin(), out * v.cos() + Vec3::Y * v.sin())
        };
        let (positions, normals) = (0..count * count).map(|k| at(k / count, k % count)).unzip();
        let index = |i: u32, j: u32| (i % count) * count + j % count;
        let triangles = (0..count * count)
            .flat_map(|k| {
                let (i, j) = (k / count, k % count);
                let [a, b, c, d] = [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
                [[a, b, c], [a, c, d]]
            })
            .collect();
        Mesh::try_new(positions, normals, triangles).expect("valid")
    }

    fn revolved(rings: u32, profile: impl Fn(f32) -> (f32, f32)) -> Mesh {
        let around = 2 * rings;
        let mut positions = vec![Vec3::Y * profile(0.0).1];
        for ring in 1..rings {
            let (out, up) = profile(std::f32::consts::PI * ring as f32 / rings as f32);
            positions.extend((0..around).map(|k| {
                let a = std::f32::consts::TAU * k as f32 / around as f32;
                Vec3::new(out * a.cos(), up, -out * a.sin())
            }));
        }
        positions.push(Vec3::Y * profile(std::f32::consts::PI).1);
        let last = positions.len() as u32 - 1;
        let index = |ring: u32, k: u32| match ring {
            0 => 0,
            r if r == rings => last,
            r => 1 + (r - 1) * around + k % around,
        };
        let triangles = (0..rings * around)
            .flat_map(|i| {
                let (ring, k) = (i / around, i % around);
                let [a, b] = [index(ring, k), index(ring + 1, k)];
                let [c, d] = [index(ring + 1, k + 1), index(ring, k + 1)];
                [[a, b, c], [a, c, d]]
            })
            .filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0])
            .collect();
        let normals = positions.clone();
        Mesh::try_new(positions, normals, triangles).expect("valid")
    }

    #[test]
    fn closed_meshes_are_clean_and_have_their_volume() {
        use std::f64::consts::PI;
        let (ball, torus) = (ball(0.5, 64), torus(0.5, 0.2, 96));
        assert!(ball.report().is_clean() && torus.report().is_clean(), "{} / {}", ball.report(), torus.report());
        assert!((ball.signed_volume() / (4.0 / 3.0 * PI * 0.125) - 1.0).abs() < 3e-3);
        assert!((torus.signed_volume() / (2.0 * PI * PI * 0.5 * 0.04) - 1.0).abs() < 3e-3);
    }

    #[test]
    fn faults_of_topology_are_counted() {
        let good = ball(1.0, 8);
        let rebuilt =
            |triangles: Vec<[u32; 3]>| Mesh::try_new(good.positions.clone(), Vec::new(), triangles).expect("valid");
        let open = rebuilt(good.triangles[1..].to_vec());
        assert_eq!((open.report().open_edges, open.report().is_closed()), (3, false));
        assert!(open.report().to_string().contains("3 open edges"), "{}", open.report());

        let mut flipped = good.triangles.clone();
        flipped[5].swap(0, 1);
        assert_eq!(rebuilt(flipped).report().flipped_edges, 3);

        let mut doubled = good.triangles.clone();
        doubled.push(doubled[3]);
        assert_eq!(rebuilt(doubled).report().non_manifold_edges, 3);

        let mut thin = good.triangles.clone();
        thin.push([0, 1, 1]);
        assert_eq!(rebuilt(thin).report().degenerate_triangles, 1);
    }

    #[test]
    fn a_mesh_that_is_inside_out_is_turned_round() {
        let good = ball(1.0, 8);
        let turned = good.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
        let mesh = Mesh::try_new(good.positions.clone(), Vec::new(), turned).expect("valid");
        assert!(mesh.report().was_inside_out && mesh.signed_volume() > 0.0);
    }

    #[test]
    fn what_is_no_mesh_is_refused_with_a_place() {
        let p = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let refused = |p: &[Vec3], t: Vec<[u32; 3]>| Mesh::try_new(p.to_vec(), Vec::new(), t).expect_err("refused");
        assert_eq!(refused(&p, vec![]), MeshError::Empty { degenerate: 0 });
        assert_eq!(refused(&p, vec![[0, 1, 1]]), MeshError::Empty { degenerate: 1 });
        assert_eq!(
            refused(&p, vec![[0, 1, 2], [0, 1, 3]]),
            MeshError::IndexOutOfRange { triangle: 1, vertex: 3, count: 3 }
        );
        for bad in [f32::NAN, f32::INFINITY, 1e30] {
            let error = refused(&[Vec3::ZERO, Vec3::X, Vec3::Y * bad], vec![[0, 1, 2]]);
            assert!(matches!(error, MeshError::NotFinite { vertex: 2, .. }), "{error}");
        }
    }

    #[test]
    fn points_inside_are_told_from_points_outside() {
        let ball = ball(1.0, 12);
        for (p, is_inside) in [(DVec3::ZERO, true), (DVec3::Y * 0.9, true), (DVec3::Y * 1.1, false)] {
            assert_eq!(ball.contains(p), is_inside, "{p}");
        }
        let torus = torus(1.0, 0.3, 24);
        for (p, is_inside) in [(DVec3::ZERO, false), (DVec3::X, true), (DVec3::new(0.0, 0.2, 1.0), true)] {
            assert_eq!(torus.contains(p), is_inside, "{p}");
        }
    }
}
