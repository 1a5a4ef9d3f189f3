//! A dense three-dimensional array, x fastest.

use glam::{IVec3, UVec3};

/// Values at integer points `(0,0,0) ..= dims-1`, stored with x fastest, then y, then z.
#[derive(Debug, Clone, PartialEq)]
pub struct Lattice<T> {
    dims: UVec3,
    values: Vec<T>,
}

impl<T: Copy> Lattice<T> {
    /// All points set to `value`.
    pub fn filled(dims: UVec3, value: T) -> Self {
        Self { dims, values: vec![value; dims.x as usize * dims.y as usize * dims.z as usize] }
    }

    /// Takes the values, x fastest.
    ///
    /// # Panics
    /// When the number of values is not the product of `dims`.
    pub fn from_values(dims: UVec3, values: Vec<T>) -> Self {
        assert_eq!(values.len(), dims.x as usize * dims.y as usize * dims.z as usize, "values do not fill {dims}");
        Self { dims, values }
    }

    /// Number of points along each axis.
    #[inline]
    pub fn dims(&self) -> UVec3 {
        self.dims
    }

    /// Place of a point in [`Lattice::values`].
    #[inline]
    pub fn offset(&self, p: UVec3) -> usize {
        (p.z as usize * self.dims.y as usize + p.y as usize) * self.dims.x as usize + p.x as usize
    }

    /// The point at a place in [`Lattice::values`].
    #[inline]
    pub fn point(&self, offset: usize) -> UVec3 {
        let (nx, ny) = (self.dims.x as usize, self.dims.y as usize);
        UVec3::new((offset % nx) as u32, (offset / nx % ny) as u32, (offset / nx / ny) as u32)
    }

    /// The value at a point inside.
    #[inline]
    pub fn at(&self, p: UVec3) -> T {
        self.values[self.offset(p)]
    }

    /// The value at `p`, or `None` outside.
    #[inline]
    pub fn get(&self, p: IVec3) -> Option<T> {
        let inside = p.cmpge(IVec3::ZERO).all() && p.cmplt(self.dims.as_ivec3()).all();
        inside.then(|| self.at(p.as_uvec3()))
    }

    /// Sets the value at a point inside.
    #[inline]
    pub fn set(&mut self, p: UVec3, value: T) {
        let offset = self.offset(p);
        self.values[offset] = value;
    }

    /// All values, x fastest.
    #[inline]
    pub fn values(&self) -> &[T] {
        &self.values
    }

    /// All values, x fastest, to change in place.
    pub fn values_mut(&mut self) -> &mut [T] {
        &mut self.values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn x_is_fastest_and_outside_is_none() {
        let mut l = Lattice::filled(UVec3::new(2, 3, 4), 0);
        l.set(UVec3::new(1, 2, 3), 7);
        assert_eq!(l.values()[23], 7);
        assert_eq!(l.get(IVec3::new(1, 2, 3)), Some(7));
        assert_eq!(l.get(IVec3::new(2, 0, 0)), None);
        assert_eq!(l.get(IVec3::new(0, -1, 0)), None);
    }
}
