//! Density between voxel centres as the file format promises it, in f64: trilinear, and zero outside.

use curlsmoke::grid::DensityGrid;
use curlsmoke::math::space::WorldPoint;
use glam::{DVec3, IVec3};

/// Cubic voxels about the origin, with values at their centres.
pub struct Voxels {
    dims: IVec3,
    edge: f64,
    values: Vec<f64>,
}

impl Voxels {
    /// Voxels of a density.
    pub fn new(dims: [u32; 3], edge: f32, density: impl Fn(WorldPoint) -> f32) -> Self {
        let d = glam::UVec3::from(dims);
        let origin = d.as_vec3() * (-0.5 * edge);
        let mut values = Vec::with_capacity((d.x * d.y * d.z) as usize);
        for k in 0..d.z {
            for j in 0..d.y {
                for i in 0..d.x {
                    let centre = (glam::UVec3::new(i, j, k).as_vec3() + 0.5) * edge;
                    values.push(f64::from(density(WorldPoint(origin + centre))));
                }
            }
        }
        Self { dims: d.as_ivec3(), edge: f64::from(edge), values }
    }

    /// The same as the renderer has it.
    pub fn grid(&self) -> DensityGrid {
        let dims = self.dims.as_uvec3();
        let origin = WorldPoint((dims.as_dvec3() * (-0.5 * self.edge)).as_vec3());
        let value = |p: WorldPoint| {
            let i = ((p.0 - origin.0).as_dvec3() / self.edge).floor().as_ivec3();
            self.voxel(i) as f32
        };
        DensityGrid::from_fn(origin, self.edge as f32, dims, 1 << 30, value).expect("small")
    }

    fn voxel(&self, i: IVec3) -> f64 {
        if i.cmplt(IVec3::ZERO).any() || i.cmpge(self.dims).any() {
            return 0.0;
        }
        self.values[(i.x + self.dims.x * (i.y + self.dims.y * i.z)) as usize]
    }

    /// Density at a place.
    pub fn density(&self, p: DVec3) -> f64 {
        let q = p / self.edge + 0.5 * self.dims.as_dvec3() - 0.5;
        let (low, f) = (q.floor(), q - q.floor());
        let share = |high: bool, f: f64| if high { f } else { 1.0 - f };
        (0..8)
            .map(|corner| {
                let [x, y, z] = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
                let weight = share(x == 1, f.x) * share(y == 1, f.y) * share(z == 1, f.z);
                weight * self.voxel(low.as_ivec3() + IVec3::new(x, y, z))
            })
            .sum()
    }

    /// Where a ray passes from one cell between centres to the next, from `t = 0` to where smoke ends [m]: between two
    /// of these the density is a cubic.
    pub fn crossings(&self, origin: DVec3, direction: DVec3) -> Vec<f64> {
        let half = 0.5 * (self.dims.as_dvec3() + 1.0) * self.edge;
        let (mut near, mut far) = (0.0f64, f64::INFINITY);
        for axis in 0..3 {
            let (o, d) = (origin[axis], direction[axis]);
            if d.abs() < 1e-14 {
                if o.abs() > half[axis] {
                    return Vec::new();
                }
                continue;
            }
            let (a, b) = ((-half[axis] - o) / d, (half[axis] - o) / d);
            (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
        }
        if near >= far {
            return Vec::new();
        }
        let mut places = vec![near, far];
        for axis in (0..3).filter(|&axis| direction[axis].abs() >= 1e-14) {
            for plane in 0..=self.dims[axis] + 1 {
                let t = (f64::from(plane) * self.edge - half[axis] - origin[axis]) / direction[axis];
                if t > near && t < far {
                    places.push(t);
                }
            }
        }
        places.sort_by(f64::total_cmp);
        places
    }

    /// The density of the ray between two distances, added up [density · m]: Gauss' rule of two points is exact for cubics.
    pub fn column(&self, origin: DVec3, direction: DVec3, from: f64, to: f64) -> f64 {
        const NODE: f64 = 0.577_350_269_189_625_8;
        let mut sum = 0.0;
        for pair in self.crossings(origin, direction).windows(2) {
            let (a, b) = (pair[0].max(from), pair[1].min(to));
            if b > a {
                let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
                let at = |t: f64| self.density(origin + direction * t);
                sum += half * (at(middle - NODE * half) + at(middle + NODE * half));
            }
        }
        sum
    }
}
