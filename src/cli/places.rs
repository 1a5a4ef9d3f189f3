//! Planes, extents and lengths that people type after flags, and what they mean.

use crate::inspect::plane::PlaneChoice;
use crate::inspect::streamlines::Reach;
use glam::DVec3;
use std::str::FromStr;

/// A plane as typed: `z=0`, or a point and a normal as six numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane(pub PlaneChoice);

impl FromStr for Plane {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let help = || {
            format!(
                "`{text}` is not a plane; write x=0.5, y=1, z=0, or a point and the normal that faces you, as in \
                 0,1,0,0,0.5,1"
            )
        };
        if let Some((axis, value)) = text.split_once('=') {
            let axis = ["x", "y", "z"].iter().position(|a| axis.trim().eq_ignore_ascii_case(a)).ok_or_else(help)?;
            return Ok(Self(PlaneChoice::Axis(axis, number(value).ok_or_else(help)?)));
        }
        let numbers: Vec<f64> = text.split(',').map(|n| number(n).ok_or_else(help)).collect::<Result<_, _>>()?;
        let [px, py, pz, nx, ny, nz] = numbers.try_into().map_err(|_| help())?;
        let normal = DVec3::new(nx, ny, nz);
        if normal.try_normalize().is_none() {
            return Err(format!("`{text}`: the normal {nx},{ny},{nz} has no direction; write for example 0,0,1"));
        }
        Ok(Self(PlaneChoice::PointNormal(DVec3::new(px, py, pz), normal)))
    }
}

/// Width and height as typed [m].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent(pub [f64; 2]);

impl FromStr for Extent {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let help = || format!("`{text}` is not a size in metres; write width and height, as in 3.2x1.8");
        let (width, height) = text.split_once(['x', 'X', '×']).ok_or_else(help)?;
        let side = |side: &str| number(side).filter(|s| (1e-6..=1e6).contains(s)).ok_or_else(help);
        Ok(Self([side(width)?, side(height)?]))
    }
}

/// A length of lines as typed: `2s` or `1.5m`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Length(pub Reach);

impl FromStr for Length {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let help = || format!("`{text}` is not a length of lines; write seconds as in 2s, or metres as in 1.5m");
        let above_zero = |n: &str| number(n).filter(|&n| n > 0.0).ok_or_else(help);
        let text = text.trim();
        match (text.strip_suffix('s'), text.strip_suffix('m')) {
            (Some(seconds), _) => Ok(Self(Reach::Seconds(above_zero(seconds)?))),
            (_, Some(metres)) => Ok(Self(Reach::Metres(above_zero(metres)?))),
            _ => Err(help()),
        }
    }
}

/// A time as typed [s], above 0.
pub fn seconds(text: &str) -> Result<f64, String> {
    let digits = text.trim().trim_end_matches('s');
    number(digits).filter(|&s| s > 0.0).ok_or_else(|| format!("`{text}` is not a time; write seconds, as in 0.01"))
}

fn number(text: &str) -> Option<f64> {
    text.trim().parse::<f64>().ok().filter(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_by_axis_and_by_point_and_normal() {
        assert_eq!("z = -0.5".parse(), Ok(Plane(PlaneChoice::Axis(2, -0.5))));
        let tilted = PlaneChoice::PointNormal(DVec3::Y, DVec3::new(0.0, 0.5, 1.0));
        assert_eq!("0, 1, 0, 0, 0.5, 1".parse(), Ok(Plane(tilted)));
        for text in ["", "w=1", "x=", "x=nan", "0,0,0", "0,0,0,0,0,inf", "1,2,3,0,0,0"] {
            assert!(text.parse::<Plane>().is_err(), "{text}");
        }
    }

    #[test]
    fn sizes_and_lengths_have_units() {
        assert_eq!("3.2x1.8".parse(), Ok(Extent([3.2, 1.8])));
        assert_eq!("2s".parse(), Ok(Length(Reach::Seconds(2.0))));
        assert_eq!("1.5 m".parse(), Ok(Length(Reach::Metres(1.5))));
        for text in ["", "2", "0s", "-1m", "s", "nans", "1e999s"] {
            assert!(text.parse::<Length>().is_err(), "{text}");
        }
        for text in ["", "1", "0x1", "1x-1", "1x1e9", "axb"] {
            assert!(text.parse::<Extent>().is_err(), "{text}");
        }
        assert_eq!((seconds("0.01"), seconds("2s"), seconds("0").is_err()), (Ok(0.01), Ok(2.0), true));
    }
}
