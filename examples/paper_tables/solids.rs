//! Pictures of surfaces where a function is 0, seen from far away: enough for figures.

use glam::DVec3;
use rayon::prelude::*;

/// Parts that a ray is cut into, to find where a function changes its sign.
const PARTS: u32 = 240;
/// Rays along each axis of a pixel.
const RAYS: u32 = 2;

/// A view without perspective.
pub struct Camera {
    size: [u32; 2],
    center: DVec3,
    right: DVec3,
    up: DVec3,
    toward: DVec3,
    half_height: f64,
    reach: f64,
}

/// What a ray meets.
#[derive(Clone, Copy)]
pub struct Hit {
    pub place: DVec3,
    /// Towards the eye.
    pub normal: DVec3,
    depth: f64,
}

impl Camera {
    /// Looks at `center` from where it is seen `from`, with z upwards; sees `half_height` above and below it, and `reach` before
    /// and behind it.
    pub fn new(size: [u32; 2], center: DVec3, from: DVec3, half_height: f64, reach: f64) -> Self {
        let toward = -from.normalize();
        let right = toward.cross(DVec3::Z).normalize();
        let size = size.map(|n| n * RAYS);
        Self { size, center, right, up: right.cross(toward), toward, half_height, reach }
    }

    fn ray(&self, i: usize) -> DVec3 {
        let [x, y] = [i as u32 % self.size[0], i as u32 / self.size[0]].map(|n| f64::from(n) + 0.5);
        let scale = 2.0 * self.half_height / f64::from(self.size[1]);
        let (x, y) = (x - 0.5 * f64::from(self.size[0]), 0.5 * f64::from(self.size[1]) - y);
        self.center + (self.right * x + self.up * y) * scale
    }

    /// Where rays first meet the surface `f = 0` within `bounds`; f gives value and gradient.
    pub fn hits(
        &self,
        f: impl Fn(DVec3) -> (f64, DVec3) + Sync,
        bounds: impl Fn(DVec3) -> bool + Sync,
    ) -> Vec<Option<Hit>> {
        let of = |i: usize| {
            let start = self.ray(i);
            let at = |depth: f64| start + self.toward * depth;
            let step = 2.0 * self.reach / f64::from(PARTS);
            let mut before = f(at(-self.reach)).0;
            for part in 1..=PARTS {
                let depth = f64::from(part) * step - self.reach;
                let now = f(at(depth)).0;
                if (before < 0.0) != (now < 0.0) {
                    let (mut low, mut high) = (depth - step, depth);
                    for _ in 0..40 {
                        let middle = 0.5 * (low + high);
                        if (f(at(middle)).0 < 0.0) == (before < 0.0) { low = middle } else { high = middle }
                    }
                    if bounds(at(low)) {
                        let normal = f(at(low)).1.normalize();
                        let normal = if normal.dot(self.toward) > 0.0 { -normal } else { normal };
                        return Some(Hit { place: at(low), normal, depth: low });
                    }
                }
                before = now;
            }
            None
        };
        (0..(self.size[0] * self.size[1]) as usize).into_par_iter().map(of).collect()
    }
}

/// A picture that comes to be.
pub struct Picture<'a> {
    camera: &'a Camera,
    rgb: Vec<[f32; 3]>,
    depth: Vec<f64>,
}

impl<'a> Picture<'a> {
    pub fn new(camera: &'a Camera) -> Self {
        let count = (camera.size[0] * camera.size[1]) as usize;
        Self { camera, rgb: vec![[0.9; 3]; count], depth: vec![f64::MAX; count] }
    }

    /// Paints a surface, lit from above the eye's left.
    pub fn surface(&mut self, hits: &[Option<Hit>], colour: impl Fn(&Hit) -> [f32; 3] + Sync) {
        let camera = self.camera;
        let light = (camera.up * 0.8 - camera.right * 0.5 - camera.toward).normalize();
        let rows = self.rgb.par_iter_mut().zip(self.depth.par_iter_mut()).zip(hits);
        rows.for_each(|((rgb, depth), hit)| {
            let Some(hit) = hit.filter(|hit| hit.depth < *depth) else { return };
            let lit = (0.25 + 0.75 * hit.normal.dot(light).max(0.0)) as f32;
            *depth = hit.depth;
            *rgb = colour(&hit).map(|c| c * lit);
        });
    }

    /// Multiplies all colours by those that are given for each ray.
    pub fn tint(&mut self, colour: impl Fn(usize) -> [f32; 3]) {
        for (i, rgb) in self.rgb.iter_mut().enumerate() {
            let by = colour(i);
            *rgb = [0, 1, 2].map(|c| rgb[c] * by[c]);
        }
    }

    /// Paints a line through points, with a point at least every ray's width.
    pub fn line(&mut self, points: impl Iterator<Item = DVec3>, width: f64, colour: [f32; 3]) {
        let camera = self.camera;
        let scale = f64::from(camera.size[1]) / (2.0 * camera.half_height);
        for p in points {
            let away = p - camera.center;
            let x = away.dot(camera.right) * scale + 0.5 * f64::from(camera.size[0]);
            let y = 0.5 * f64::from(camera.size[1]) - away.dot(camera.up) * scale;
            let (depth, reach) = (away.dot(camera.toward) - 0.5 * width, 0.5 * width * scale);
            for v in (y - reach).max(0.0) as u32..((y + reach).max(0.0) as u32 + 1).min(camera.size[1]) {
                for u in (x - reach).max(0.0) as u32..((x + reach).max(0.0) as u32 + 1).min(camera.size[0]) {
                    let i = (v * camera.size[0] + u) as usize;
                    let off = (f64::from(u) + 0.5 - x).hypot(f64::from(v) + 0.5 - y);
                    if off <= reach && depth < self.depth[i] {
                        self.depth[i] = depth;
                        self.rgb[i] = colour;
                    }
                }
            }
        }
    }

    /// Size and colours, the mean of all rays of each pixel.
    pub fn finish(self) -> ([u32; 2], Vec<[f32; 3]>) {
        let size = self.camera.size.map(|n| n / RAYS);
        let width = self.camera.size[0];
        let pixel = |i: u32| {
            let (x, y) = (i % size[0] * RAYS, i / size[0] * RAYS);
            let rays = (0..RAYS * RAYS).map(|k| self.rgb[((y + k / RAYS) * width + x + k % RAYS) as usize]);
            let sum = rays.fold([0.0; 3], |a: [f32; 3], b| [0, 1, 2].map(|c| a[c] + b[c]));
            sum.map(|c| c / (RAYS * RAYS) as f32)
        };
        (size, (0..size[0] * size[1]).map(pixel).collect())
    }
}
