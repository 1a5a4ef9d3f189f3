//! Colours that differ from place to place on surfaces.

use crate::flow::turbulence::TurbulenceSpan;
use crate::render::color::Rgb;
use crate::render::image_texture::ImageTexture;
use glam::{DVec3, Vec3};

/// A colour at each point of space.
#[derive(Debug, Clone)]
pub enum Texture {
    /// The same everywhere.
    Constant(Rgb),
    /// Flow noise through a ramp of colours.
    FlowNoise(Box<FlowNoise>),
    /// Layers of two colours.
    Stripes {
        /// Pairs of layers that go by along each axis [1/m].
        along: [f64; 3],
        /// The two.
        colors: [Rgb; 2],
    },
    /// Cubes of two colours.
    Checker {
        /// Edge [m].
        size: f64,
        /// The two.
        colors: [Rgb; 2],
    },
    /// Shells of two colours.
    Rings {
        /// Their middle [m].
        center: [f64; 3],
        /// Thickness [m].
        width: f64,
        /// The two, the innermost first.
        colors: [Rgb; 2],
    },
    /// A picture.
    Image(ImageTexture),
}

/// Flow noise through a ramp of colours: C(x + I·t(x)) (Perlin and Neyret 2001), with t the turbulence.
#[derive(Debug, Clone)]
pub struct FlowNoise {
    /// t at the moment of the picture.
    pub turbulence: TurbulenceSpan,
    /// How much of the ramp goes by along each axis [1/m].
    pub along: [f64; 3],
    /// How far t moves the place in the ramp.
    pub amplitude: f64,
    /// C.
    pub ramp: Ramp,
}

/// Colours along a line, blended between stops.
#[derive(Debug, Clone)]
pub struct Ramp {
    places: Vec<f64>,
    colors: Vec<Rgb>,
    repeats: bool,
}

impl Texture {
    /// The colour at a point of world space, where the shape rests [m]; `normal` gives the surface's there, of any length
    /// but 0.
    pub fn at(&self, p: [f64; 3], normal: impl FnOnce() -> DVec3) -> Rgb {
        match self {
            Self::Constant(color) => *color,
            Self::FlowNoise(noise) => {
                let along: f64 = (0..3).map(|i| noise.along[i] * p[i]).sum();
                noise.ramp.at(along + noise.amplitude * noise.turbulence.value(p))
            }
            Self::Stripes { along, colors } => {
                let place: f64 = (0..3).map(|i| along[i] * p[i]).sum();
                colors[usize::from(place.rem_euclid(1.0) >= 0.5)]
            }
            Self::Checker { size, colors } => {
                let cell: f64 = p.iter().map(|x| (x / size).floor()).sum();
                colors[usize::from(cell.rem_euclid(2.0) >= 1.0)]
            }
            Self::Rings { center, width, colors } => {
                let square: f64 = (0..3).map(|i| (p[i] - center[i]).powi(2)).sum();
                colors[usize::from((square.sqrt() / width).rem_euclid(2.0) >= 1.0)]
            }
            Self::Image(image) => image.at(DVec3::from_array(p), normal),
        }
    }

    /// Whether the colour is the same everywhere.
    pub fn is_constant(&self) -> bool {
        matches!(self, Self::Constant(_))
    }
}

impl Ramp {
    /// The ramp through stops of rising places; beyond its ends it begins again, or goes on with the last colours.
    ///
    /// # Panics
    /// When there is no stop.
    pub fn new(stops: impl IntoIterator<Item = (f64, Rgb)>, repeats: bool) -> Self {
        let (places, colors): (Vec<_>, Vec<_>) = stops.into_iter().unzip();
        assert!(!places.is_empty(), "a ramp has a stop");
        Self { places, colors, repeats }
    }

    /// The colour at a place.
    pub fn at(&self, place: f64) -> Rgb {
        let (first, last) = (self.places[0], self.places[self.places.len() - 1]);
        let place = if self.repeats && last > first { first + (place - first).rem_euclid(last - first) } else { place };
        let above = self.places.partition_point(|&at| at <= place);
        if above == 0 {
            return self.colors[0];
        }
        if above == self.places.len() {
            return self.colors[above - 1];
        }
        let (low, high) = (self.places[above - 1], self.places[above]);
        Vec3::lerp(self.colors[above - 1], self.colors[above], ((place - low) / (high - low)) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::turbulence::{Turbulence, TurbulenceSettings};

    fn stops() -> [(f64, Rgb); 3] {
        [(-1.0, Vec3::ZERO), (0.0, Vec3::new(0.5, 0.0, 0.0)), (1.0, Vec3::ONE)]
    }

    #[test]
    fn ramps_blend_between_stops_and_end_or_repeat() {
        let ramp = Ramp::new(stops(), false);
        assert_eq!(ramp.at(-0.5), Vec3::new(0.25, 0.0, 0.0));
        assert_eq!(ramp.at(0.5), Vec3::new(0.75, 0.5, 0.5));
        assert_eq!((ramp.at(-7.0), ramp.at(7.0)), (Vec3::ZERO, Vec3::ONE));
        let ramp = Ramp::new(stops(), true);
        assert!((ramp.at(2.5) - ramp.at(0.5)).length() < 1e-6 && (ramp.at(-3.7) - ramp.at(0.3)).length() < 1e-6);
        let single = Ramp::new([(0.0, Vec3::X)], true);
        assert_eq!(single.at(3.0), Vec3::X);
    }

    #[test]
    fn without_noise_the_ramp_goes_by_along_its_axis() {
        let texture = Texture::FlowNoise(Box::new(FlowNoise {
            turbulence: Turbulence::new(&TurbulenceSettings::default()).at(0.0),
            along: [0.0, 2.0, 0.0],
            amplitude: 0.0,
            ramp: Ramp::new(stops(), false),
        }));
        assert_eq!(texture.at([5.0, 0.25, -3.0], || unreachable!()), Vec3::new(0.75, 0.5, 0.5));
    }
}
