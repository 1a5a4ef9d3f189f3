//! Pictures that light comes from or that are laid on surfaces.

use crate::render::color::Rgb;

/// Colours in rows, the top one first.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width · height` colours: shares of light, or radiances [W/(m² sr)].
    pub pixels: Vec<Rgb>,
}

/// What is beyond the left and right, or the upper and lower edges of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Beyond {
    /// The picture again.
    Again,
    /// The colours of the edge.
    Edge,
}

impl Picture {
    /// Says which pixel, if any, is no light, which `what` must be: "radiance", say.
    ///
    /// # Errors
    /// For a picture without pixels, and a pixel that is negative or no number.
    pub fn check(&self, what: &str) -> Result<(), String> {
        if self.pixels.is_empty() {
            return Err("the picture has no pixels".into());
        }
        match self.pixels.iter().position(|p| !p.is_finite() || p.min_element() < 0.0) {
            None => Ok(()),
            Some(i) => {
                Err(format!("{} is {}: {what} must be a number that is not negative", self.name(i), self.pixels[i]))
            }
        }
    }

    /// Says which pixel, if any, reflects more than all light once it is multiplied by `scale`.
    ///
    /// # Errors
    /// For a pixel above 1.
    pub fn check_reflects(&self, scale: f32) -> Result<(), String> {
        let Some(i) = self.pixels.iter().position(|p| p.max_element() * scale > 1.0) else { return Ok(()) };
        // A little less, or what is written below might be rounded up to too much again.
        let most = 0.999 / self.pixels.iter().fold(0.0, |most: f32, p| most.max(p.max_element()));
        let most = if most < 0.01 { format!("{most:.3e}") } else { format!("{most:.5}") };
        Err(format!(
            "{} times `scale` is {}: no more is reflected than comes; `scale` may be at most {most}",
            self.name(i),
            self.pixels[i] * scale
        ))
    }

    /// Says which pixel, if any, glows too brightly for single precision once it is multiplied by `scale`.
    ///
    /// # Errors
    /// For a pixel above `most` [W/(m² sr)].
    pub fn check_glows(&self, scale: f32, most: f32) -> Result<(), String> {
        match self.pixels.iter().position(|p| p.max_element() > most / scale) {
            None => Ok(()),
            Some(i) => Err(format!("{} times `scale` is more than {most:.0e}", self.name(i))),
        }
    }

    fn name(&self, pixel: usize) -> String {
        format!("pixel ({}, {})", pixel % self.width, pixel / self.width)
    }

    /// The colour at a place between pixels: `u` from 0 at the left edge to 1 at the right, `v` from 0 at the top to 1 at
    /// the bottom; pixels have their colour in their middle. Both may be any finite number, however large.
    pub fn at(&self, u: f64, v: f64, across: Beyond, down: Beyond) -> Rgb {
        let (left, right, x) = neighbours(u, self.width, across);
        let (top, bottom, y) = neighbours(v, self.height, down);
        let pixel = |x: usize, y: usize| self.pixels[y * self.width + x];
        pixel(left, top).lerp(pixel(right, top), x).lerp(pixel(left, bottom).lerp(pixel(right, bottom), x), y)
    }
}

/// The pixels of a row of `count` on both sides of a place, and how far it is from the one to the other.
fn neighbours(place: f64, count: usize, beyond: Beyond) -> (usize, usize, f32) {
    let last = count - 1;
    match beyond {
        Beyond::Again => {
            let x = place.rem_euclid(1.0) * count as f64 - 0.5;
            // The remainder of a tiny negative number is 1.
            let low = x.floor().min(last as f64);
            let first = if low < 0.0 { last } else { low as usize };
            (first, if first == last { 0 } else { first + 1 }, (x - low) as f32)
        }
        Beyond::Edge => {
            let x = (place * count as f64 - 0.5).clamp(0.0, last as f64);
            let first = x as usize;
            (first, (first + 1).min(last), (x - first as f64) as f32)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn picture() -> Picture {
        let pixels = (0..12).map(|i| Vec3::new((i % 4) as f32, (i / 4) as f32, i as f32) * 0.05).collect();
        Picture { width: 4, height: 3, pixels }
    }

    #[test]
    fn pixels_have_their_colour_in_their_middle_and_blend_between() {
        let picture = picture();
        for beyond in [Beyond::Again, Beyond::Edge] {
            for (x, y) in [(0, 0), (3, 0), (1, 1), (3, 2)] {
                let (u, v) = ((x as f64 + 0.5) / 4.0, (y as f64 + 0.5) / 3.0);
                assert!((picture.at(u, v, beyond, beyond) - picture.pixels[y * 4 + x]).length() < 1e-6);
            }
            let between = picture.at(0.375 + 0.25 * 0.25, 0.5, beyond, beyond);
            assert!((between - picture.pixels[5].lerp(picture.pixels[6], 0.25)).length() < 1e-6);
        }
    }

    #[test]
    fn beyond_its_edges_it_begins_again_or_goes_on() {
        let picture = picture();
        for i in -30..30 {
            let u = f64::from(i) * 0.0371;
            let inside = picture.at(u.rem_euclid(1.0), 0.5, Beyond::Again, Beyond::Edge);
            assert!((picture.at(u, 0.5, Beyond::Again, Beyond::Edge) - inside).length() < 1e-6);
            // No step anywhere, over the seam neither.
            let next = picture.at(u + 1e-6, 0.5, Beyond::Again, Beyond::Edge);
            assert!((next - picture.at(u, 0.5, Beyond::Again, Beyond::Edge)).length() < 1e-5);
        }
        let seam = picture.at(0.0, 0.5, Beyond::Again, Beyond::Edge);
        assert!((seam - 0.5 * (picture.pixels[4] + picture.pixels[7])).length() < 1e-6);
        assert_eq!(picture.at(0.125, -5.0, Beyond::Again, Beyond::Edge), picture.pixels[0]);
        assert_eq!(picture.at(0.125, 7.0, Beyond::Again, Beyond::Edge), picture.pixels[8]);
        for place in [-1e-300, 1e300, -1e300, 1.0, -1.0, 0.9999999999999999] {
            assert!(picture.at(place, place, Beyond::Again, Beyond::Edge).is_finite());
        }
    }

    #[test]
    fn what_is_no_light_is_named() {
        let mut picture = picture();
        assert_eq!((picture.check("radiance"), picture.check_reflects(1.0)), (Ok(()), Ok(())));
        assert!(picture.check_reflects(2.0).is_err_and(|e| e.contains("pixel (3, 2)")));
        assert_eq!(picture.check_glows(2.0, 1.2), Ok(()));
        assert!(picture.check_glows(2.0, 1.0).is_err_and(|e| e.starts_with("pixel (3, 2)")));
        assert_eq!(picture.check_glows(0.0, 1.0), Ok(()));
        picture.pixels[6].y = -1.0;
        assert!(picture.check("radiance").is_err_and(|e| e.starts_with("pixel (2, 1)") && e.contains("radiance")));
        picture.pixels[6].y = f32::NAN;
        assert!(picture.check("radiance").is_err());
        assert!(Picture { width: 0, height: 0, pixels: vec![] }.check("radiance").is_err());
    }
}
