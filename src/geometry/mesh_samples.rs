//! The signed distance of a mesh at the points of a lattice.
//!
//! Distances are exact within two cells of the surface; further out each sample takes the nearest of its neighbours'
//! triangles (Bridson 2015, *Fluid Simulation for Computer Graphics*, section 4.3, after Tsai 2002), which is exact but
//! for rare samples. Inside is where the winding number along lattice lines is not zero; the lines of all three axes,
//! walked from both ends, vote, so that small holes do no harm.

use crate::geometry::mesh::Mesh;
use crate::geometry::triangle::closest_point;
use crate::math::aabb::Aabb;
use crate::math::lattice::Lattice;
use crate::math::parallel;
use glam::{DVec3, UVec3, Vec3};

/// Cells round each triangle in which distances are exact.
const BAND: f32 = 2.0;

/// A lattice that is going to be sampled.
pub(in crate::geometry) struct Plan {
    /// Of its first sample [m].
    pub origin: DVec3,
    /// Between samples [m].
    pub spacing: f64,
    /// As numbers that cannot overflow.
    counts: DVec3,
}

/// Layers of the lattice that are filled by one task.
const SLAB: usize = 8;

/// No triangle known yet.
const NONE: u32 = u32::MAX;

/// A sample: its distance [m] and the triangle that is so far.
type Sample = (f32, u32);

impl Plan {
    /// Of a box and what reaches `margin` [m] beyond it.
    pub fn new(bounds: &Aabb, spacing: f64, margin: f64) -> Self {
        let (min, max) = (bounds.min.as_dvec3() - margin, bounds.max.as_dvec3() + margin);
        let cells = ((max - min) / spacing).ceil().max(DVec3::ONE);
        // The lattice is centred, so that a symmetric mesh keeps its symmetry.
        let origin = (min + max) * 0.5 - cells * spacing * 0.5;
        Self { origin, spacing, counts: cells + 1.0 }
    }

    /// Of all that is held at once while sampling.
    pub fn memory_bytes(&self) -> f64 {
        let bytes = (size_of::<Sample>() + 1 + 2 * size_of::<f32>()) as f64;
        (self.counts + 2.0).element_product() * bytes
    }

    fn dims(&self) -> UVec3 {
        self.counts.as_uvec3()
    }

    fn position(&self, p: UVec3) -> Vec3 {
        (self.origin + p.as_dvec3() * self.spacing).as_vec3()
    }

    /// The signed distances [m] of the mesh.
    pub fn sample(&self, mesh: &Mesh) -> Lattice<f32> {
        let mut samples = Lattice::filled(self.dims(), (f32::INFINITY, NONE));
        let corners: Vec<[Vec3; 3]> = (0..mesh.triangles().len()).map(|i| mesh.corners(i)).collect();
        self.fill_band(&corners, &mut samples);
        self.sweep(&corners, &mut samples);
        let votes = self.vote(&corners);
        let signed = samples.values().iter().zip(votes.values()).map(|(s, votes)| if *votes > 3 { -s.0 } else { s.0 });
        Lattice::from_values(self.dims(), signed.collect())
    }

    /// Exact distances within [`BAND`] cells of the triangles.
    fn fill_band(&self, corners: &[[Vec3; 3]], samples: &mut Lattice<Sample>) {
        let (dims, band) = (self.dims(), BAND * self.spacing as f32);
        let slice = (dims.x * dims.y) as usize;
        let boxes = parallel::map(corners.len(), |i| {
            let bounds = Aabb::from_points(corners[i]).dilated(band);
            let cell = |p: Vec3| (p.as_dvec3() - self.origin) / self.spacing;
            let low = cell(bounds.min).ceil().max(DVec3::ZERO).as_uvec3();
            (low, (cell(bounds.max).floor() + 1.0).max(DVec3::ZERO).as_uvec3().min(dims))
        });
        // Slabs in parallel, each of which sees all triangles in the same order. What is offered to samples beyond the band depends on
        // how boxes are cut: slabs are the same on any number of threads.
        parallel::for_each(samples.values_mut().chunks_mut(slice * SLAB), |slab, values| {
            let z0 = (slab * SLAB) as u32;
            let z1 = z0 + (values.len() / slice) as u32;
            for (i, &(low, high)) in boxes.iter().enumerate() {
                let (low, high) = (low.with_z(low.z.max(z0)), high.with_z(high.z.min(z1)));
                if low.cmplt(high).all() {
                    self.fill_box(low, high, corners[i], i as u32, &mut |p, sample| {
                        let place = ((p.z - z0) * dims.y + p.y) as usize * dims.x as usize + p.x as usize;
                        if sample.0 < values[place].0 {
                            values[place] = sample;
                        }
                    });
                }
            }
        });
    }

    /// Gives `store` the distance of all points in `low .. high` that are near the triangle, halving boxes that large
    /// triangles leave mostly empty.
    fn fill_box(&self, low: UVec3, high: UVec3, triangle: [Vec3; 3], i: u32, store: &mut impl FnMut(UVec3, Sample)) {
        let count = high - low;
        let longest = count.max_element();
        if count.element_product() > 512 {
            let (a, b) = (self.position(low), self.position(high - 1));
            let middle = (a + b) * 0.5;
            if closest_point(middle, triangle).distance(middle) > BAND * self.spacing as f32 + middle.distance(b) {
                return;
            }
            let axis = (0..3).find(|&axis| count[axis] == longest).unwrap_or(0);
            let mut cut = high;
            cut[axis] = low[axis] + longest / 2;
            self.fill_box(low, cut, triangle, i, store);
            let mut from = low;
            from[axis] = cut[axis];
            self.fill_box(from, high, triangle, i, store);
            return;
        }
        for z in low.z..high.z {
            for y in low.y..high.y {
                for x in low.x..high.x {
                    let p = self.position(UVec3::new(x, y, z));
                    store(UVec3::new(x, y, z), (closest_point(p, triangle).distance(p), i));
                }
            }
        }
    }

    /// Offers each sample the triangles of its seven neighbours behind it, in each of the eight directions. Once round
    /// leaves two samples in a thousand wrong, by at most a thirtieth of a cell; more rounds mend little, and with the
    /// three neighbours along the axes alone one in five stays wrong.
    fn sweep(&self, corners: &[[Vec3; 3]], samples: &mut Lattice<Sample>) {
        let dims = self.dims();
        let strides = [1, i64::from(dims.x), i64::from(dims.x) * i64::from(dims.y)];
        for direction in 0..8 {
            let is_down = [direction & 1 > 0, direction & 2 > 0, direction & 4 > 0];
            let at = |axis: usize, i: u32| if is_down[axis] { dims[axis] - 1 - i } else { i };
            // Where the neighbour behind is, and how far, for a step along the axes in the bits of its number.
            let behind: [(i64, f32); 8] = std::array::from_fn(|step| {
                let axes = (0..3).filter(|axis| step >> axis & 1 > 0);
                let offset = axes.clone().map(|axis| if is_down[axis] { strides[axis] } else { -strides[axis] }).sum();
                (offset, (axes.count() as f32).sqrt() * self.spacing as f32)
            });
            for (k, j) in (0..dims.z).flat_map(|k| (0..dims.y).map(move |j| (k, j))) {
                // At the border some neighbours are missing.
                let row: Vec<(i64, f32)> = (2..8)
                    .step_by(2)
                    .filter(|s| (s & 2 == 0 || j > 0) && (s & 4 == 0 || k > 0))
                    .map(|s| behind[s])
                    .collect();
                let diagonal: Vec<(i64, f32)> = (1..8)
                    .step_by(2)
                    .filter(|s| (s & 2 == 0 || j > 0) && (s & 4 == 0 || k > 0))
                    .map(|s| behind[s])
                    .collect();
                for i in 0..dims.x {
                    let p = UVec3::new(at(0, i), at(1, j), at(2, k));
                    let here = samples.offset(p);
                    let neighbours = row.iter().chain(if i > 0 { diagonal.as_slice() } else { &[] });
                    self.improve(corners, samples.values_mut(), here, p, neighbours);
                }
            }
        }
    }

    /// Takes the triangle of a neighbour where that is nearer.
    #[inline]
    fn improve<'a>(
        &self,
        corners: &[[Vec3; 3]],
        samples: &mut [Sample],
        here: usize,
        p: UVec3,
        neighbours: impl Iterator<Item = &'a (i64, f32)>,
    ) {
        let mut best = samples[here];
        let before = best.1;
        for (offset, way) in neighbours {
            let (distance, triangle) = samples[here.wrapping_add_signed(*offset as isize)];
            // Its triangle is no nearer to here than it is to there, less the way.
            if triangle == best.1 || triangle == NONE || distance - way >= best.0 {
                continue;
            }
            let at = self.position(p);
            let distance = closest_point(at, corners[triangle as usize]).distance(at);
            if distance < best.0 {
                best = (distance, triangle);
            }
        }
        if best.1 != before {
            samples[here] = best;
        }
    }

    /// For each sample, how many of six walks (three axes, from both ends) find it inside.
    fn vote(&self, corners: &[[Vec3; 3]]) -> Lattice<u8> {
        let dims = self.dims();
        let mut votes = Lattice::filled(dims, 0u8);
        let local: Vec<[DVec3; 3]> =
            corners.iter().map(|t| t.map(|p| (p.as_dvec3() - self.origin) / self.spacing)).collect();
        for axis in 0..3 {
            let windings = crossings(&local, dims, axis);
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for (b, a) in (0..dims[v]).flat_map(|b| (0..dims[u]).map(move |a| (b, a))) {
                let at = |i: u32| {
                    let mut p = UVec3::ZERO;
                    (p[axis], p[u], p[v]) = (i, a, b);
                    p
                };
                let total: i32 = (0..dims[axis]).map(|i| i32::from(windings.at(at(i)))).sum();
                let mut winding = 0;
                for i in 0..dims[axis] {
                    winding += i32::from(windings.at(at(i)));
                    let inside = u8::from(winding != 0) + u8::from(winding != total);
                    let p = at(i);
                    votes.set(p, votes.at(p) + inside);
                }
            }
        }
        votes
    }
}

/// For each sample, by how much the winding number changes between it and the one before it along `axis`.
fn crossings(triangles: &[[DVec3; 3]], dims: UVec3, axis: usize) -> Lattice<i16> {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut windings = Lattice::filled(dims, 0i16);
    for t in triangles {
        let (low, high) = (t[0].min(t[1]).min(t[2]).ceil().max(DVec3::ZERO), t[0].max(t[1]).max(t[2]).floor());
        let reach = |axis: usize| low[axis] as u32..((high[axis] + 1.0).max(0.0) as u32).min(dims[axis]);
        for b in reach(v) {
            for a in reach(u) {
                let flat = t.map(|p| [p[u] - f64::from(a), p[v] - f64::from(b)]);
                let sides = [side(flat[1], flat[2]), side(flat[2], flat[0]), side(flat[0], flat[1])];
                let signs = sides.map(|(sign, _)| sign);
                if signs[0] != signs[1] || signs[1] != signs[2] {
                    continue;
                }
                let total = sides[0].1 + sides[1].1 + sides[2].1;
                if total == 0.0 {
                    continue;
                }
                let at = (sides[0].1 * t[0][axis] + sides[1].1 * t[1][axis] + sides[2].1 * t[2][axis]) / total;
                let first = at.ceil().max(0.0);
                if first < f64::from(dims[axis]) {
                    let mut p = UVec3::ZERO;
                    (p[axis], p[u], p[v]) = (first as u32, a, b);
                    // A triangle that faces against the walk is entered: +1.
                    windings.set(p, windings.at(p).saturating_sub(signs[0]));
                }
            }
        }
    }
    windings
}

/// Which side of the line from `a` to `b` the origin is on, +1 left or −1 right, never on it: ties are broken as if the
/// origin were moved by an infinitesimal that is the same for all triangles (Edelsbrunner and Mücke 1990), so that of
/// two triangles at an edge exactly one is hit. With it twice the area of the triangle they make.
fn side(a: [f64; 2], b: [f64; 2]) -> (i16, f64) {
    // Exactly opposite for the line walked the other way: the same products, subtracted the other way round.
    let double_area = a[0] * b[1] - a[1] * b[0];
    let tie = if double_area != 0.0 {
        double_area
    } else if a[1] != b[1] {
        b[1] - a[1]
    } else {
        a[0] - b[0]
    };
    (if tie > 0.0 { 1 } else { -1 }, double_area)
}
