//! Linear Rec. 709 colour.

use glam::Vec3;

/// Linear red, green and blue with Rec. 709 primaries.
pub type Rgb = Vec3;

/// Luminance of a linear Rec. 709 colour, in the unit of its channels (ITU-R BT.709).
pub fn luminance(c: Rgb) -> f32 {
    c.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}
