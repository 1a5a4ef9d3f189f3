//! The tree that a file stores: a root of 4096³ voxels a child, children of 32³ nodes of 16³ leaves of 8³ voxels, and how
//! the places inside a node are numbered (z fastest, unlike our bricks).

use glam::IVec3;

/// Side lengths of one kind of node, as powers of two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NodeKind {
    /// Children along an edge.
    pub(super) log2_edge: u32,
    /// Voxels along an edge of a child.
    pub(super) log2_child: u32,
}

/// The nodes below the root.
pub(super) const UPPER: NodeKind = NodeKind { log2_edge: 5, log2_child: 7 };
/// The nodes below those.
pub(super) const LOWER: NodeKind = NodeKind { log2_edge: 4, log2_child: 3 };
/// The leaves, whose children are voxels.
pub(super) const LEAF: NodeKind = NodeKind { log2_edge: 3, log2_child: 0 };

impl NodeKind {
    /// Number of places for children.
    pub(super) const fn places(self) -> usize {
        1 << (3 * self.log2_edge)
    }

    /// Voxels along an edge of the node.
    pub(super) const fn voxels(self) -> i32 {
        1 << (self.log2_edge + self.log2_child)
    }

    /// Low corner of child number `place`, from the low corner of the node [voxels].
    pub(super) fn child_offset(self, place: usize) -> IVec3 {
        let (place, mask) = (place as i32, (1 << self.log2_edge) - 1);
        IVec3::new(place >> (2 * self.log2_edge), (place >> self.log2_edge) & mask, place & mask) << self.log2_child
    }

    /// Number of the child that voxel `p` is in.
    pub(super) fn place_of(self, p: IVec3) -> usize {
        let mask = (1 << self.log2_edge) - 1;
        let c = (p >> self.log2_child) & mask;
        (((c.x << self.log2_edge | c.y) << self.log2_edge) | c.z) as usize
    }
}

/// Place in a brick of ours (x fastest) of voxel `place` of a leaf (z fastest).
pub(super) fn brick_place(place: usize) -> usize {
    (place >> 6) | (place & 0o70) | (place & 7) << 6
}

/// One bit for each place of a node, as it is in the file.
#[derive(Clone, Copy)]
pub(super) struct Mask<'a>(pub(super) &'a [u8]);

impl<'a> Mask<'a> {
    pub(super) fn is_on(self, place: usize) -> bool {
        self.0[place >> 3] >> (place & 7) & 1 != 0
    }

    pub(super) fn count(self) -> usize {
        self.0.iter().map(|b| b.count_ones() as usize).sum()
    }

    /// The places whose bit is set, in increasing order.
    pub(super) fn on(self) -> impl Iterator<Item = usize> + 'a {
        (0..self.0.len() * 8).filter(move |&i| self.is_on(i))
    }
}

/// A [`Mask`] to be written.
#[derive(Clone)]
pub(super) struct MaskBuilder(pub(super) Vec<u8>);

impl MaskBuilder {
    pub(super) fn new(kind: NodeKind) -> Self {
        Self(vec![0; kind.places() / 8])
    }

    pub(super) fn set(&mut self, place: usize) {
        self.0[place >> 3] |= 1 << (place & 7);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_offsets_are_inverse() {
        for kind in [UPPER, LOWER, LEAF] {
            for place in (0..kind.places()).step_by(7) {
                let corner = kind.child_offset(place) - IVec3::splat(3 * kind.voxels());
                assert_eq!(kind.place_of(corner), place);
            }
        }
        assert_eq!((UPPER.voxels(), LOWER.voxels(), LEAF.voxels()), (4096, 128, 8));
    }

    #[test]
    fn a_leaf_counts_z_fastest_and_a_brick_x_fastest() {
        assert_eq!(LEAF.child_offset(0b001_010_011), IVec3::new(1, 2, 3));
        assert_eq!(brick_place(0b001_010_011), 0b011_010_001);
    }
}
