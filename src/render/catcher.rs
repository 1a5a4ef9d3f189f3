//! Shadow catchers: what a path brings that meets one first.
//!
//! Two means are kept of a pixel: of the light that its catchers reflect, and of what they would reflect without smoke
//! and other shapes. Both come from the same paths and the same random numbers, so that where there is no shadow they are
//! equal but for rounding, and for light that came by way of other things.

use crate::render::color::{Rgb, luminance};
use crate::render::film::Contribution;

/// A path that met a shadow catcher first.
#[derive(Debug, Clone, Copy)]
pub struct Caught {
    /// What the path had collected on the way there.
    before: Contribution,
    /// Radiance of the catcher without shadows.
    unshadowed: Rgb,
}

impl Caught {
    /// A path that had collected `before` where it met a catcher that gives off `emitted`.
    pub fn new(before: Contribution, emitted: Rgb) -> Self {
        Self { before, unshadowed: emitted }
    }

    /// Adds light that the catcher would reflect.
    pub fn add_unshadowed(&mut self, radiance: Rgb) {
        self.unshadowed += radiance;
    }

    /// Takes what the catcher reflects out of what the path brings.
    pub fn out_of(self, path: &mut Contribution) {
        // Of one path it may be less than nothing, see `sun_shadow.rs`; the mean over all must not be cut.
        let lit = path.radiance - self.before.radiance;
        path.radiance = self.before.radiance;
        path.by_passage = self.before.by_passage;
        path.by_group = self.before.by_group;
        path.is_covered = false;
        path.shadow = Some([luminance(lit), luminance(self.unshadowed)]);
    }
}
