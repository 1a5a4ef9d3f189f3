//! Which layers of a picture a denoiser gets, and where what it makes is kept.
//!
//! No pixel that was rendered is lost: the denoised colours are a layer of their own, or take the place of red, green and
//! blue, which then stand in a layer `noisy`.

use crate::output::image::{Attribute, Image, SampleKind};
use crate::output::oidn::{Denoiser, OidnError};

/// Layer of the denoised colours.
pub const DENOISED: &str = "denoised";
/// Layer of the colours as they were rendered, where the denoised ones took their place.
pub const NOISY: &str = "noisy";

/// How to denoise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DenoiseSettings {
    /// Albedo and normal are denoised first, so that their own noise does not show. Default false.
    pub is_prefiltered: bool,
    /// Red, green and blue become the denoised ones. Default false.
    pub replaces: bool,
}

/// Which layers helped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Guides {
    /// `albedo.R`, `.G`, `.B`.
    pub albedo: bool,
    /// `N.X`, `.Y`, `.Z`.
    pub normal: bool,
}

/// Why a picture was not denoised.
#[derive(Debug, Clone, thiserror::Error)]
pub enum DenoiseError {
    /// The library.
    #[error(transparent)]
    Oidn(#[from] OidnError),
    /// There is nothing to denoise.
    #[error("the picture has no channels R, G and B; denoise a picture that was rendered")]
    NoColor,
    /// It was denoised already.
    #[error("the picture has a layer `{0}` already; denoise the picture as it was rendered")]
    Twice(&'static str),
    /// A pixel that holds no number would spread over its neighbours.
    #[error("channel {channel}, pixel ({x}, {y}): {value} is no light; render the picture anew")]
    NotFinite {
        /// The channel.
        channel: String,
        /// Column in the display window.
        x: i32,
        /// Row in the display window.
        y: i32,
        /// What stands there.
        value: f32,
    },
}

/// Checks that a picture can be denoised.
///
/// # Errors
/// All but [`DenoiseError::Oidn`].
pub fn check(image: &Image) -> Result<(), DenoiseError> {
    if ["R", "G", "B"].iter().any(|name| image.channel(name).is_none()) {
        return Err(DenoiseError::NoColor);
    }
    for layer in [DENOISED, NOISY] {
        if image.rgb(layer).is_some() {
            return Err(DenoiseError::Twice(layer));
        }
    }
    let used = ["R", "G", "B", "albedo.R", "albedo.G", "albedo.B", "N.X", "N.Y", "N.Z"];
    for channel in image.channels.iter().filter(|c| used.contains(&c.name.as_str())) {
        if let Some(i) = channel.data.iter().position(|x| !x.is_finite()) {
            let [x, y] = image.position(i);
            return Err(DenoiseError::NotFinite { channel: channel.name.clone(), x, y, value: channel.data[i] });
        }
    }
    Ok(())
}

/// Denoises a picture by its albedo and normal layers, as far as it has them; all channels that it had stay as they are.
///
/// # Errors
/// When it has no colours or no numbers in them, was denoised before, or the library fails.
pub fn denoise(image: &Image, settings: DenoiseSettings, denoiser: &Denoiser) -> Result<(Image, Guides), DenoiseError> {
    check(image)?;
    let size = image.data_size.map(|n| n as usize);
    let color = image.to_rgb("").ok_or(DenoiseError::NoColor)?;
    let mut albedo = layer(image, ["albedo.R", "albedo.G", "albedo.B"]);
    let mut normal = layer(image, ["N.X", "N.Y", "N.Z"]);
    if settings.is_prefiltered {
        albedo = albedo.map(|a| denoiser.clean_albedo(size, &a)).transpose()?;
        normal = normal.map(|n| denoiser.clean_normal(size, &n)).transpose()?;
    }
    let guides = Guides { albedo: albedo.is_some(), normal: normal.is_some() };
    // The library takes normals only beside albedo.
    let normal = normal.filter(|_| guides.albedo);
    let clean = denoiser.denoise(size, &color, albedo.as_deref(), normal.as_deref(), settings.is_prefiltered)?;
    let guides = Guides { normal: normal.is_some(), ..guides };
    let mut out = with_denoised(image, &clean, settings.replaces);
    let by = format!("Open Image Denoise {}", denoiser.version());
    out.set_attribute("curlsmoke/denoised", Attribute::Text(by));
    Ok((out, guides))
}

/// Three channels interleaved.
fn layer(image: &Image, names: [&str; 3]) -> Option<Vec<[f32; 3]>> {
    let [x, y, z] = names.map(|name| image.channel(name));
    Some(x?.iter().zip(y?).zip(z?).map(|((&x, &y), &z)| [x, y, z]).collect())
}

/// The picture with denoised colours beside or in place of its own.
fn with_denoised(image: &Image, clean: &[[f32; 3]], replaces: bool) -> Image {
    let kind = image.channels.iter().find(|c| c.name == "R").map_or(SampleKind::Half, |c| c.kind);
    let mut out = image.clone();
    if replaces {
        let raw: Vec<_> = ["R", "G", "B"].map(|name| out.channels.iter().position(|c| c.name == name)).into();
        let mut raw: Vec<usize> = raw.into_iter().flatten().collect();
        raw.sort_unstable();
        for place in raw.into_iter().rev() {
            let channel = out.channels.remove(place);
            out.push(format!("{NOISY}.{}", channel.name), channel.kind, channel.data);
        }
    }
    out.push_rgb(if replaces { "" } else { DENOISED }, kind, clean);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::oidn::LoadError;

    fn noisy() -> Image {
        let mut image = Image::cropped([8, 6], [2, 1, 6, 5]);
        let rgb: Vec<[f32; 3]> = (0..16).map(|i| [i as f32, 0.5, 2.0]).collect();
        image.push_rgb("", SampleKind::Float, &rgb);
        image.push("A", SampleKind::Half, vec![1.0; 16]);
        image.push_rgb("albedo", SampleKind::Half, &[[0.3; 3]; 16]);
        image
    }

    #[test]
    fn nothing_that_was_rendered_is_lost() {
        let image = noisy();
        let clean = [[7.0, 8.0, 9.0]; 16];
        let beside = with_denoised(&image, &clean, false);
        assert_eq!(beside.to_rgb("denoised").unwrap(), clean);
        for channel in &image.channels {
            assert!(beside.channels.contains(channel), "{}", channel.name);
        }
        let instead = with_denoised(&image, &clean, true);
        assert_eq!(instead.to_rgb("").unwrap(), clean);
        assert_eq!(instead.to_rgb("noisy"), image.to_rgb(""));
        assert_eq!((instead.channel("A"), instead.rgb("albedo")), (image.channel("A"), image.rgb("albedo")));
        assert_eq!(instead.channels.len(), image.channels.len() + 3);
    }

    #[test]
    fn what_cannot_be_denoised_is_named() {
        assert!(matches!(check(&Image::new([2, 2])), Err(DenoiseError::NoColor)));
        let twice = with_denoised(&noisy(), &[[0.0; 3]; 16], false);
        assert!(matches!(check(&twice), Err(DenoiseError::Twice("denoised"))));
        let mut broken = noisy();
        broken.channels.iter_mut().find(|c| c.name == "albedo.G").unwrap().data[5] = f32::NAN;
        let error = check(&broken).unwrap_err();
        assert!(error.to_string().contains("albedo.G, pixel (3, 2)"), "{error}");
    }

    /// Only where the library is found; without it this says nothing, and the error is tested with the command.
    #[test]
    fn noise_goes_and_edges_stay() {
        let denoiser = match Denoiser::try_new(Some(1)) {
            Ok(denoiser) => denoiser,
            Err(OidnError::Load(LoadError::NotFound { .. })) => {
                return println!("left out: no Open Image Denoise here");
            }
            Err(error) => panic!("{error}"),
        };
        // Two halves of 0.2 and 0.8 with even noise of ± 0.15 about them.
        let (width, height) = (96u32, 64u32);
        let truth = |x: u32| if x < width / 2 { 0.2f32 } else { 0.8 };
        let mut rng = crate::math::hash::CounterRng::new(crate::math::hash::Seed(3));
        let mut image = Image::new([width, height]);
        let pixels = (0..width * height).map(|i| truth(i % width));
        let rgb: Vec<[f32; 3]> = pixels.clone().map(|v| [0; 3].map(|_| v + 0.3 * (rng.uniform() - 0.5))).collect();
        let albedo: Vec<[f32; 3]> = pixels.map(|v| [v; 3]).collect();
        image.push_rgb("", SampleKind::Float, &rgb);
        image.push_rgb("albedo", SampleKind::Float, &albedo);
        image.push_xyz("N", SampleKind::Float, &vec![[0.0, 0.0, 1.0]; rgb.len()]);
        let error = |colors: &[[f32; 3]]| {
            let squares = colors.iter().zip(&albedo).map(|(c, a)| (c[0] - a[0]).powi(2));
            (squares.sum::<f32>() / colors.len() as f32).sqrt()
        };
        for is_prefiltered in [false, true] {
            let settings = DenoiseSettings { is_prefiltered, replaces: false };
            let (out, guides) = denoise(&image, settings, &denoiser).unwrap();
            assert_eq!(guides, Guides { albedo: true, normal: true });
            let (before, after) = (error(&rgb), error(&out.to_rgb("denoised").unwrap()));
            assert!(before > 0.08 && after < 0.25 * before, "{before} became {after}");
            assert_eq!(out.to_rgb("").unwrap(), rgb);
        }
    }
}
