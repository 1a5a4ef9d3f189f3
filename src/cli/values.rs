//! Values that people type after flags, and what they mean.

use crate::render::film::PixelBounds;
use crate::watch::tev;
use std::str::FromStr;

/// A size of picture as typed: in pixels, or a share of the scene's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Resolution {
    /// Width and height [pixels].
    Pixels([u32; 2]),
    /// Share of the scene's own width and height, above 0.
    Share(f64),
}

impl FromStr for Resolution {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let help = || format!("`{text}` is not a resolution; write 640x360 or 50%");
        if let Some(percent) = text.strip_suffix('%') {
            let percent: f64 = percent.trim().parse().map_err(|_| help())?;
            return if percent > 0.0 && percent <= 10_000.0 { Ok(Self::Share(percent / 100.0)) } else { Err(help()) };
        }
        let (width, height) = text.split_once(['x', 'X', '×']).ok_or_else(help)?;
        let number = |side: &str| side.trim().parse::<u32>().ok().filter(|&n| n > 0).ok_or_else(help);
        Ok(Self::Pixels([number(width)?, number(height)?]))
    }
}

impl Resolution {
    /// Width and height, where the scene has `scene` [pixels].
    pub fn pixels(self, scene: [u32; 2]) -> [u32; 2] {
        match self {
            Self::Pixels(size) => size,
            Self::Share(share) => scene.map(|n| ((f64::from(n) * share).round() as u32).max(1)),
        }
    }
}

/// A part of the picture as typed: x0, y0, x1, y1, each in pixels or as a share of the width or height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crop([Edge; 4]);

#[derive(Debug, Clone, Copy, PartialEq)]
enum Edge {
    Pixels(i32),
    Share(f64),
}

impl FromStr for Crop {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let help = || format!("`{text}` is not a crop; write x0,y0,x1,y1 as in 100,50,300,200 or 25%,25%,75%,75%");
        let edge = |part: &str| match part.trim().strip_suffix('%') {
            Some(percent) => match percent.parse::<f64>() {
                Ok(percent) if (0.0..=100.0).contains(&percent) => Ok(Edge::Share(percent / 100.0)),
                _ => Err(help()),
            },
            None => part.trim().parse().map(Edge::Pixels).map_err(|_| help()),
        };
        let edges: Vec<Edge> = text.split(',').map(edge).collect::<Result<_, _>>()?;
        Ok(Self(edges.try_into().map_err(|_| help())?))
    }
}

impl Crop {
    /// The pixels of it in a frame of this size, whose picture has those of `canvas`.
    ///
    /// # Errors
    /// A sentence, when there are none or the crop reaches beyond the picture.
    pub fn bounds(self, size: [u32; 2], canvas: PixelBounds) -> Result<PixelBounds, String> {
        let edge = |i: usize| match self.0[i] {
            Edge::Pixels(n) => n,
            Edge::Share(share) => (f64::from(size[i % 2]) * share).round() as i32,
        };
        let bounds = PixelBounds { x0: edge(0), y0: edge(1), x1: edge(2), y1: edge(3) };
        if bounds.common(&canvas) != Some(bounds) {
            let [width, height] = size;
            let PixelBounds { x0, y0, x1, y1 } = bounds;
            let and_overscan = if canvas == PixelBounds::whole(size) { "" } else { " with its overscan" };
            return Err(format!(
                "the crop {x0},{y0},{x1},{y1} holds no pixels or reaches beyond the picture of {width} × {height}{and_overscan}; \
                 write x0,y0,x1,y1 with {} ≤ x0 < x1 ≤ {} and {} ≤ y0 < y1 ≤ {}",
                canvas.x0, canvas.x1, canvas.y0, canvas.y1
            ));
        }
        Ok(bounds)
    }
}

/// Paths of each pixel as typed: the first and the last, from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Samples(pub [u32; 2]);

impl FromStr for Samples {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let help = || format!("`{text}` are no paths; write the first and the last, counted from 1, as in 1-64");
        let (first, last) = text.split_once('-').ok_or_else(help)?;
        let number = |text: &str| text.trim().parse::<u32>().map_err(|_| help());
        let [first, last] = [number(first)?, number(last)?];
        if first >= 1 && first <= last { Ok(Self([first, last])) } else { Err(help()) }
    }
}

/// A time as typed [s], 0 or more.
pub fn seconds_or_none(text: &str) -> Result<f64, String> {
    let seconds = text.trim().parse::<f64>().ok().filter(|s| s.is_finite() && (0.0..=1e9).contains(s));
    seconds.ok_or_else(|| format!("`{text}` is no time; write seconds, as in 300, or 0 for never"))
}

/// A pixel as typed: column and row from the top left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelPlace(pub [i32; 2]);

impl FromStr for PixelPlace {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let help = || format!("`{text}` is not a pixel; write x,y as in 320,180");
        let (x, y) = text.split_once(',').ok_or_else(help)?;
        let number = |part: &str| part.trim().parse().map_err(|_| help());
        Ok(Self([number(x)?, number(y)?]))
    }
}

/// An amount of memory as typed [GiB].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Memory(pub f64);

impl FromStr for Memory {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let help = || format!("`{text}` is not an amount of memory; write 4, 4G or 512M (GiB where no letter stands)");
        let upper = text.trim().to_ascii_uppercase();
        // MB and MiB are M; a B alone would be bytes, which nobody means.
        let unit = upper.trim_start_matches(|c: char| c.is_ascii_digit() || ".+-E ".contains(c));
        let upper = if unit == "B" { return Err(help()) } else { upper.trim_end_matches('B').trim_end_matches('I') };
        let (number, scale) = match upper.strip_suffix(['M', 'G', 'T']) {
            Some(number) if upper.ends_with('M') => (number, 1.0 / 1024.0),
            Some(number) if upper.ends_with('T') => (number, 1024.0),
            Some(number) => (number, 1.0),
            None => (upper, 1.0),
        };
        let amount = number.trim().parse::<f64>().map_err(|_| help())? * scale;
        if amount.is_finite() && amount > 0.0 { Ok(Self(amount)) } else { Err(help()) }
    }
}

impl Memory {
    /// The amount in bytes.
    pub fn bytes(self) -> u64 {
        (self.0 * f64::from(1 << 30)) as u64
    }
}

/// A viewer as typed: `tev`, or `tev=HOST:PORT`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Display {
    /// Host and port that it listens to.
    pub address: String,
}

impl FromStr for Display {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let help = || format!("`{text}` is not a viewer; write tev, or tev={} with its host and port", tev::ADDRESS);
        let address = match text.split_once('=') {
            None if text == "tev" => tev::ADDRESS,
            Some(("tev", address)) => address,
            _ => return Err(help()),
        };
        let (host, port) = address.rsplit_once(':').ok_or_else(help)?;
        let is_valid = !host.is_empty() && port.parse::<u16>().is_ok_and(|port| port > 0);
        is_valid.then(|| Self { address: address.into() }).ok_or_else(help)
    }
}

/// A setting as typed: `camera.vertical_fov_deg=40`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Override(pub String, pub String);

impl FromStr for Override {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            Some((key, value)) if !key.trim().is_empty() => Ok(Self(key.trim().into(), value.trim().into())),
            _ => Err(format!("`{text}` sets nothing; write key=value as in camera.vertical_fov_deg=40")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resolutions_in_pixels_and_percent() {
        assert_eq!("640x360".parse(), Ok(Resolution::Pixels([640, 360])));
        assert_eq!("50%".parse::<Resolution>().unwrap().pixels([641, 1]), [321, 1]);
        for text in ["", "640", "0x10", "x", "-5%", "0%", "1e9%", "axb", "640x360x2"] {
            assert!(text.parse::<Resolution>().is_err(), "{text}");
        }
    }

    #[test]
    fn crops_in_pixels_and_percent() {
        let frame = PixelBounds::whole([100, 50]);
        let bounds_on = |text: &str, canvas| text.parse::<Crop>().and_then(|crop| crop.bounds([100, 50], canvas));
        let bounds = |text: &str| bounds_on(text, frame);
        assert_eq!(bounds("10, 20,30,40"), Ok(PixelBounds { x0: 10, y0: 20, x1: 30, y1: 40 }));
        assert_eq!(bounds("25%,0%,75%,100%"), Ok(PixelBounds { x0: 25, y0: 0, x1: 75, y1: 50 }));
        for text in ["", "1,2,3", "1,2,3,4,5", "-1,0,10,10", "10,10,10,20", "0,0,101,50", "0,0,50,51", "0,0,200%,1%"] {
            assert!(bounds(text).is_err(), "{text}");
        }
        let canvas = frame.grown([10, 0, 0, 5]);
        assert_eq!(bounds_on("-10,0,-3,55", canvas), Ok(PixelBounds { x0: -10, y0: 0, x1: -3, y1: 55 }));
        for text in ["-11,0,10,10", "0,-1,10,10", "0,0,101,50", "0,0,50,56"] {
            assert!(bounds_on(text, canvas).is_err(), "{text}");
        }
    }

    #[test]
    fn memory_with_and_without_letters() {
        for (text, gib) in [("4", 4.0), ("4G", 4.0), ("4 GiB", 4.0), ("512m", 0.5), ("1TB", 1024.0), ("0.5", 0.5)] {
            assert_eq!(text.parse(), Ok(Memory(gib)), "{text}");
        }
        for text in ["", "G", "-1", "0", "inf", "nan", "4X"] {
            assert!(text.parse::<Memory>().is_err(), "{text}");
        }
        assert_eq!(Memory(0.5).bytes(), 1 << 29);
    }

    #[test]
    fn viewers_have_an_address() {
        let address = |text: &str| text.parse::<Display>().map(|display| display.address);
        assert_eq!(address("tev"), Ok("127.0.0.1:14158".into()));
        assert_eq!(address("tev=pc:1000"), Ok("pc:1000".into()));
        for text in ["", "viewer", "tev=", "tev=:1", "tev=pc", "tev=pc:0", "tev=pc:99999"] {
            assert!(address(text).is_err(), "{text}");
        }
    }

    #[test]
    fn overrides_split_at_the_first_equals_sign() {
        assert_eq!("a.b = c=d".parse(), Ok(Override("a.b".into(), "c=d".into())));
        for text in ["", "a.b", "=1"] {
            assert!(text.parse::<Override>().is_err(), "{text}");
        }
    }
}
