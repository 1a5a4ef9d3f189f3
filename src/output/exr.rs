//! OpenEXR files, both ways: scan lines, half or float channels, ZIPS unless told otherwise.
//!
//! The bytes are a pure function of the picture: attributes are sorted, and nothing about the host or the time is
//! written. The codec is the crate `exr`; this module adds order, limits and our own picture type.

use crate::output::image::{Attribute, Channel, Image, SampleKind, channel_order};
use crate::output::{OutputError, check_memory, read_bytes};
use crate::render::cryptomatte;
use ::exr::block::reader::Reader;
use ::exr::image::write::WritableImage;
use ::exr::meta::attribute::Chromaticities;
use ::exr::prelude as codec;
use ::exr::prelude::{ReadChannels, ReadLayers};
use half::f16;
use serde::{Deserialize, Serialize};
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// How pixels are packed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Compression {
    /// Not at all.
    None,
    /// Deflate, one line at a time: quick to read in part, a little larger than `Zip`.
    #[default]
    Zips,
    /// Deflate, 16 lines at a time.
    Zip,
    /// Wavelets: smallest for noisy pictures.
    Piz,
    /// Cosines of 8 × 8 pixels, with loss; of channels in single precision, which hold numbers, without.
    Dwaa,
    /// The same, 256 lines at a time.
    Dwab,
}

/// How layers are put into files.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Layout {
    /// All channels in one part.
    #[default]
    Single,
    /// A part for each layer.
    Multipart,
    /// A file for each layer.
    Separate,
}

/// Name of the part and the file of a picture's own colours.
pub const COLOUR_PART: &str = "rgba";

/// The part, and where layers have files of their own the file, that a channel belongs to.
pub fn part_of(channel: &str) -> &str {
    match channel.rsplit_once('.') {
        // Its ranks are of no use without each other.
        Some((layer, _)) if layer.starts_with(cryptomatte::NAME) => cryptomatte::NAME,
        Some((layer, _)) => layer,
        None if matches!(channel, "R" | "G" | "B" | "A") => COLOUR_PART,
        None => channel,
    }
}

impl Compression {
    fn codec(self) -> codec::Compression {
        match self {
            Self::None => codec::Compression::Uncompressed,
            Self::Zips => codec::Compression::ZIP1,
            Self::Zip => codec::Compression::ZIP16,
            Self::Piz => codec::Compression::PIZ,
            Self::Dwaa => codec::Compression::DWAA(None),
            Self::Dwab => codec::Compression::DWAB(None),
        }
    }

    /// The same for a part with these channels: numbers are packed without loss.
    fn of_part<'a>(self, channels: impl IntoIterator<Item = &'a Channel>) -> Self {
        let has_numbers = channels.into_iter().any(|channel| channel.kind == SampleKind::Float);
        if has_numbers && matches!(self, Self::Dwaa | Self::Dwab) { Self::Zips } else { self }
    }
}

/// Primaries and white of Rec. 709, which all our colours have.
const REC_709: Chromaticities = Chromaticities {
    red: codec::Vec2(0.64, 0.33),
    green: codec::Vec2(0.3, 0.6),
    blue: codec::Vec2(0.15, 0.06),
    white: codec::Vec2(0.3127, 0.329),
};

/// The bytes of an .exr file with one part that holds all channels of `image`.
///
/// # Errors
/// A picture without pixels or channels, two channels of one name, names or texts that the format cannot hold.
pub fn write(image: &Image, compression: Compression) -> Result<Vec<u8>, OutputError> {
    check(image)?;
    let all: Vec<&Channel> = image.channels.iter().collect();
    let file = codec::Image { attributes: image_attributes(image), layer_data: part(image, &all, compression, None)? };
    finished(image, |bytes| file.write().non_parallel().to_buffered(bytes))
}

/// The bytes of an .exr file with a part for each layer of `image`, its own colours first. Channels keep their names, and each part has
/// all attributes.
///
/// # Errors
/// As for [`write`].
pub fn write_parts(image: &Image, compression: Compression) -> Result<Vec<u8>, OutputError> {
    check(image)?;
    let parts = layers(image).into_iter().map(|(name, channels)| part(image, &channels, compression, Some(name)));
    let file = codec::Image::from_layers(image_attributes(image), parts.collect::<Result<Vec<_>, _>>()?);
    finished(image, |bytes| file.write().non_parallel().to_buffered(bytes))
}

/// A picture for each layer of `image`, by name, its own colours first; each has all attributes.
pub fn split(image: &Image) -> Vec<(String, Image)> {
    let alone = |(name, channels): (&str, Vec<&Channel>)| {
        let channels = channels.into_iter().cloned().collect();
        let image = Image {
            size: image.size,
            data_origin: image.data_origin,
            data_size: image.data_size,
            channels,
            attributes: image.attributes.clone(),
        };
        (name.to_string(), image)
    };
    layers(image).into_iter().map(alone).collect()
}

/// The channels of each part, in the order of the parts.
fn layers(image: &Image) -> Vec<(&str, Vec<&Channel>)> {
    let mut layers: Vec<(&str, Vec<&Channel>)> = Vec::new();
    for channel in &image.channels {
        let name = part_of(&channel.name);
        match layers.iter_mut().find(|(known, _)| *known == name) {
            Some((_, channels)) => channels.push(channel),
            None => layers.push((name, vec![channel])),
        }
    }
    // What a program that knows no parts shows is the first.
    layers.sort_by_key(|(name, _)| *name != COLOUR_PART);
    layers
}

type Part = codec::Layer<codec::AnyChannels<codec::FlatSamples>>;

fn part(
    image: &Image,
    channels: &[&Channel],
    compression: Compression,
    name: Option<&str>,
) -> Result<Part, OutputError> {
    let encoded = channels.iter().map(|channel| encoded_channel(channel)).collect::<Result<_, _>>()?;
    let size = codec::Vec2(image.data_size[0] as usize, image.data_size[1] as usize);
    let encoding = codec::Encoding {
        compression: compression.of_part(channels.iter().copied()).codec(),
        blocks: codec::Blocks::ScanLines,
        line_order: codec::LineOrder::Increasing,
    };
    let mut attributes = layer_attributes(image)?;
    attributes.layer_name = name.map(text).transpose()?;
    Ok(codec::Layer::new(size, attributes, encoding, codec::AnyChannels::sort(encoded)))
}

fn image_attributes(image: &Image) -> codec::ImageAttributes {
    let display = codec::IntegerBounds::new((0, 0), (image.size[0] as usize, image.size[1] as usize));
    let mut attributes = codec::ImageAttributes::new(display);
    attributes.chromaticities = Some(REC_709);
    attributes
}

fn finished(
    image: &Image,
    write: impl FnOnce(&mut Cursor<Vec<u8>>) -> ::exr::error::UnitResult,
) -> Result<Vec<u8>, OutputError> {
    // At most what the pixels take, and a header: growing on the way would hold half as much again.
    let length =
        image.channels.iter().map(|c| c.data.len() * c.kind.bytes()).sum::<usize>() + image.data_size[1] as usize * 16;
    let mut bytes = Cursor::new(Vec::with_capacity(length + 4096));
    write(&mut bytes).map_err(|e| encoding_error(e.to_string()))?;
    let mut bytes = bytes.into_inner();
    sort_headers(&mut bytes);
    Ok(bytes)
}

fn check(image: &Image) -> Result<(), OutputError> {
    if image.channels.is_empty() || image.pixel_count() == 0 || image.size.contains(&0) {
        return Err(encoding_error("it has no pixels".into()));
    }
    let mut names: Vec<&str> = image.channels.iter().map(|c| c.name.as_str()).collect();
    names.sort_unstable();
    if let Some(twice) = names.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(encoding_error(format!("it has two channels `{}`", twice[0])));
    }
    match image.channels.iter().find(|c| c.data.len() != image.pixel_count()) {
        Some(c) => Err(encoding_error(format!("channel `{}` has {} numbers", c.name, c.data.len()))),
        None => Ok(()),
    }
}

fn encoding_error(problem: String) -> OutputError {
    OutputError::Encoding { format: "EXR", problem }
}

fn text(value: &str) -> Result<codec::Text, OutputError> {
    codec::Text::new_or_none(value).ok_or_else(|| encoding_error(format!("`{value}` holds characters beyond Latin-1")))
}

fn encoded_channel(channel: &Channel) -> Result<codec::AnyChannel<codec::FlatSamples>, OutputError> {
    let samples = match channel.kind {
        SampleKind::Float => codec::FlatSamples::F32(channel.data.clone()),
        SampleKind::Half => codec::FlatSamples::F16(channel.data.iter().map(|&x| to_half(x)).collect()),
    };
    Ok(codec::AnyChannel::new(text(&channel.name)?, samples))
}

/// Largest finite 16-bit number instead of infinity for finite values beyond it: a very bright pixel is not a wrong one.
fn to_half(x: f32) -> f16 {
    if x.is_finite() { f16::from_f32(x.clamp(-65504.0, 65504.0)) } else { f16::from_f32(x) }
}

fn layer_attributes(image: &Image) -> Result<codec::LayerAttributes, OutputError> {
    let mut layer = codec::LayerAttributes {
        layer_position: codec::Vec2(image.data_origin[0], image.data_origin[1]),
        ..Default::default()
    };
    for (name, value) in &image.attributes {
        match (name.as_str(), value) {
            ("framesPerSecond", Attribute::Rational(n, d)) => layer.frames_per_second = Some((*n, *d)),
            ("worldToCamera", Attribute::Matrix(m)) => layer.world_to_camera = Some(*m),
            ("worldToNDC", Attribute::Matrix(m)) => layer.world_to_normalized_device = Some(*m),
            ("software", Attribute::Text(t)) => layer.software_name = Some(text(t)?),
            ("comments", Attribute::Text(t)) => layer.comments = Some(text(t)?),
            (_, value) => {
                let value = match value {
                    Attribute::Text(t) => codec::AttributeValue::Text(text(t)?),
                    Attribute::Int(i) => codec::AttributeValue::I32(*i),
                    Attribute::Float(x) => codec::AttributeValue::F32(*x),
                    Attribute::Float2([x, y]) => codec::AttributeValue::FloatVec2(codec::Vec2(*x, *y)),
                    Attribute::Rational(n, d) => codec::AttributeValue::Rational((*n, *d)),
                    Attribute::Matrix(m) => codec::AttributeValue::Matrix4x4(*m),
                };
                layer.other.insert(text(name)?, value);
            }
        }
    }
    Ok(layer)
}

/// Sorts the attributes of each part by name. The codec keeps them in a hash map, whose order changes from
/// run to run; the length of headers stays, so every offset in the file stays valid.
fn sort_headers(bytes: &mut [u8]) {
    // Magic number and version come first, then headers. With several parts an empty header ends them.
    const START: usize = 8;
    const HAS_PARTS: u32 = 1 << 12;
    let Some(version) = bytes.get(4..START) else { return };
    let has_parts = u32::from_le_bytes([version[0], version[1], version[2], version[3]]) & HAS_PARTS != 0;
    let mut at = START;
    while let Some(end) = sort_header(bytes, at) {
        at = end + 1;
        if !has_parts || bytes.get(at).is_none_or(|&b| b == 0) {
            return;
        }
    }
}

/// Sorts the attributes of the header at `start`; where it ends.
fn sort_header(bytes: &mut [u8], start: usize) -> Option<usize> {
    // Attributes up to an empty name: name, 0, type, 0, length, value.
    let zero_after = |from: usize| bytes[from..].iter().position(|&b| b == 0).map(|n| from + n);
    let mut attributes: Vec<&[u8]> = Vec::new();
    let mut at = start;
    while *bytes.get(at)? != 0 {
        let name_end = zero_after(at)?;
        let type_end = zero_after(name_end + 1)?;
        let length = bytes.get(type_end + 1..type_end + 5)?;
        let length = u32::from_le_bytes([length[0], length[1], length[2], length[3]]) as usize;
        let end = type_end + 5 + length;
        attributes.push(bytes.get(at..end)?);
        at = end;
    }
    attributes.sort_unstable();
    let sorted = attributes.concat();
    bytes[start..at].copy_from_slice(&sorted);
    Some(at)
}

/// Reads an .exr file of any make: scan lines or tiles, one or several parts, without deep data. Parts come together in
/// one picture whose data window covers all of theirs, 0 where a part has no pixels; channels of later parts whose names
/// are taken get the name of their part in front.
///
/// # Errors
/// When the file is missing, unreadable, invalid, or of an unsupported kind, or needs more than `memory_limit` bytes.
pub fn read(path: &Path, memory_limit: u64) -> Result<Image, OutputError> {
    let bytes = read_bytes(path, memory_limit)?;
    // The codec promises errors for bad input; a panic in it would be a fault that must not take a sequence down.
    catch_unwind(AssertUnwindSafe(|| decode(path, &bytes, memory_limit)))
        .unwrap_or_else(|_| Err(invalid(path, "its contents contradict each other".into())))
}

fn invalid(path: &Path, problem: String) -> OutputError {
    OutputError::Invalid { path: path.into(), format: "EXR", problem }
}

/// Rectangle of pixels: from the first corner up to but not including the second.
#[derive(Clone, Copy)]
struct Window {
    min: [i64; 2],
    max: [i64; 2],
}

impl Window {
    fn new(position: codec::Vec2<i32>, size: codec::Vec2<usize>) -> Self {
        let min = [i64::from(position.0), i64::from(position.1)];
        let extent = |n: usize| i64::try_from(n).unwrap_or(i64::MAX / 4).min(i64::MAX / 4);
        Self { min, max: [min[0] + extent(size.0), min[1] + extent(size.1)] }
    }

    fn union(self, other: Self) -> Self {
        Self {
            min: [self.min[0].min(other.min[0]), self.min[1].min(other.min[1])],
            max: [self.max[0].max(other.max[0]), self.max[1].max(other.max[1])],
        }
    }

    fn width(self) -> u64 {
        self.max[0].abs_diff(self.min[0])
    }

    fn height(self) -> u64 {
        self.max[1].abs_diff(self.min[1])
    }

    fn area(self) -> u64 {
        self.width().saturating_mul(self.height())
    }
}

fn decode(path: &Path, bytes: &[u8], memory_limit: u64) -> Result<Image, OutputError> {
    let codec_error = |e: ::exr::error::Error| invalid(path, e.to_string());
    let chunks = ::exr::block::read(Cursor::new(bytes), false).map_err(codec_error)?;
    let window = check_headers(path, &chunks, bytes.len() as u64, memory_limit)?;
    let file = codec::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .non_parallel()
        .from_chunks(chunks)
        .map_err(codec_error)?;
    let display = file.attributes.display_window;
    let shifted = |edge: i64, by: i32| i32::try_from(edge - i64::from(by)).unwrap_or(i32::MAX);
    let mut image = Image {
        size: [display.size.0 as u32, display.size.1 as u32],
        data_origin: [shifted(window.min[0], display.position.0), shifted(window.min[1], display.position.1)],
        data_size: [window.width() as u32, window.height() as u32],
        ..Image::default()
    };
    for layer in file.layer_data {
        take_layer(&mut image, layer, window);
    }
    image.channels.sort_by_key(|c| channel_order(&c.name));
    image.attributes.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(image)
}

/// The window of all parts together, after checking that they fit into memory: once as stored and once as 32-bit numbers.
fn check_headers(
    path: &Path,
    chunks: &Reader<Cursor<&[u8]>>,
    file_length: u64,
    memory_limit: u64,
) -> Result<Window, OutputError> {
    let windows = chunks.headers().iter().map(|h| Window::new(h.own_attributes.layer_position, h.layer_size));
    let window = windows.reduce(Window::union).ok_or_else(|| invalid(path, "it has no parts".into()))?;
    let mut needed = file_length;
    for header in chunks.headers() {
        let own = Window::new(header.own_attributes.layer_position, header.layer_size);
        for channel in &header.channels.list {
            if channel.sampling != codec::Vec2(1, 1) {
                return Err(invalid(path, format!("channel `{}` has fewer samples than pixels", channel.name)));
            }
            let stored = own.area().saturating_mul(channel.sample_type.bytes_per_sample() as u64);
            needed = needed.saturating_add(stored).saturating_add(window.area().saturating_mul(4));
        }
    }
    check_memory(path, needed, memory_limit)?;
    if window.width() > i32::MAX as u64 || window.height() > i32::MAX as u64 {
        return Err(invalid(path, "its parts are too far apart".into()));
    }
    Ok(window)
}

fn take_layer(image: &mut Image, layer: codec::Layer<codec::AnyChannels<codec::FlatSamples>>, window: Window) {
    let part = layer.attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default();
    let own = Window::new(layer.attributes.layer_position, layer.size);
    for channel in layer.channel_data.list {
        let mut name = channel.name.to_string();
        if image.channel(&name).is_some() {
            name = format!("{part}.{name}");
        }
        let kind = match channel.sample_data {
            codec::FlatSamples::F16(_) => SampleKind::Half,
            codec::FlatSamples::F32(_) | codec::FlatSamples::U32(_) => SampleKind::Float,
        };
        let stored: Vec<f32> = match channel.sample_data {
            codec::FlatSamples::F16(samples) => samples.into_iter().map(f16::to_f32).collect(),
            codec::FlatSamples::F32(samples) => samples,
            codec::FlatSamples::U32(samples) => samples.into_iter().map(|x| x as f32).collect(),
        };
        let data = if own.area() == window.area() { stored } else { placed(&stored, own, window) };
        image.channels.push(Channel { name, kind, data });
    }
    let attributes = layer.attributes;
    let mut known = |name: &str, value: Option<Attribute>| {
        if let (Some(value), None) = (value, image.attribute(name)) {
            image.attributes.push((name.to_string(), value));
        }
    };
    known("framesPerSecond", attributes.frames_per_second.map(|(n, d)| Attribute::Rational(n, d)));
    known("worldToCamera", attributes.world_to_camera.map(Attribute::Matrix));
    known("worldToNDC", attributes.world_to_normalized_device.map(Attribute::Matrix));
    known("software", attributes.software_name.map(|t| Attribute::Text(t.to_string())));
    known("comments", attributes.comments.map(|t| Attribute::Text(t.to_string())));
    for (name, value) in attributes.other {
        known(&name.to_string(), decoded_attribute(value));
    }
}

/// The numbers of a part in the window of all parts, 0 outside its own.
fn placed(stored: &[f32], own: Window, window: Window) -> Vec<f32> {
    let mut data = vec![0.0; window.area() as usize];
    let (width, stride) = (own.width() as usize, window.width() as usize);
    let x = own.min[0].abs_diff(window.min[0]) as usize;
    let y = own.min[1].abs_diff(window.min[1]) as usize;
    for (row, line) in stored.chunks_exact(width.max(1)).enumerate() {
        let start = (y + row) * stride + x;
        data[start..start + width].copy_from_slice(line);
    }
    data
}

fn decoded_attribute(value: codec::AttributeValue) -> Option<Attribute> {
    Some(match value {
        codec::AttributeValue::Text(t) => Attribute::Text(t.to_string()),
        codec::AttributeValue::I32(i) => Attribute::Int(i),
        codec::AttributeValue::F32(x) => Attribute::Float(x),
        codec::AttributeValue::FloatVec2(codec::Vec2(x, y)) => Attribute::Float2([x, y]),
        codec::AttributeValue::Rational((n, d)) => Attribute::Rational(n, d),
        codec::AttributeValue::Matrix4x4(m) => Attribute::Matrix(m),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::Seed;

    const LIMIT: u64 = 1 << 26;

    fn sample() -> Image {
        let mut image = Image::cropped([20, 10], [3, 2, 16, 9]);
        let n = image.pixel_count();
        let noise = |key: u64| (0..n as u64).map(|i| Seed(key).uniform(i) * 4.0 - 1.0).collect::<Vec<f32>>();
        for (i, name) in ["R", "G", "B", "A"].into_iter().enumerate() {
            let half = noise(i as u64).into_iter().map(|x| f16::from_f32(x).to_f32()).collect();
            image.push(name, SampleKind::Half, half);
        }
        let mut depth = noise(9);
        depth[0] = f32::INFINITY;
        image.push("Z", SampleKind::Float, depth);
        image.push("variance.R", SampleKind::Float, noise(10));
        image.set_attribute("curlsmoke/seed", Attribute::Text(u64::MAX.to_string()));
        image.set_attribute("curlsmoke/frame", Attribute::Int(-3));
        image.set_attribute("curlsmoke/shutter", Attribute::Float2([-0.25, 0.25]));
        image.set_attribute("framesPerSecond", Attribute::Rational(24000, 1001));
        image.set_attribute("worldToCamera", Attribute::Matrix(std::array::from_fn(|i| i as f32)));
        image.attributes.sort_by(|a, b| a.0.cmp(&b.0));
        image
    }

    fn decoded(bytes: &[u8]) -> Result<Image, OutputError> {
        decode(Path::new("test.exr"), bytes, LIMIT)
    }

    #[test]
    fn what_is_written_is_read_back_exactly_with_every_compression() {
        for compression in [Compression::None, Compression::Zips, Compression::Zip, Compression::Piz] {
            let bytes = write(&sample(), compression).unwrap();
            assert_eq!(decoded(&bytes).unwrap(), sample(), "{compression:?}");
        }
    }

    #[test]
    fn parts_and_files_of_their_own_have_the_same_channels() {
        let bytes = write_parts(&sample(), Compression::Zip).unwrap();
        assert_eq!(decoded(&bytes).unwrap(), sample());
        let names: Vec<String> = split(&sample()).into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["rgba", "Z", "variance"]);
        for (name, image) in split(&sample()) {
            let back = decoded(&write(&image, Compression::Zips).unwrap()).unwrap();
            assert_eq!(back, image);
            assert!(
                image.channels.iter().all(|c| part_of(&c.name) == name && sample().channel(&c.name) == Some(&c.data))
            );
        }
    }

    #[test]
    fn loss_is_for_colours_alone() {
        let mut image = sample();
        // Smooth, as colours mostly are.
        for channel in image.channels.iter_mut().filter(|c| c.kind == SampleKind::Half) {
            let smooth = (0..channel.data.len()).map(|i| f16::from_f32((i as f32 * 0.1).sin() + 1.5).to_f32());
            channel.data = smooth.collect();
        }
        for compression in [Compression::Dwaa, Compression::Dwab] {
            let back = decoded(&write_parts(&image, compression).unwrap()).unwrap();
            for channel in &image.channels {
                let found = back.channel(&channel.name).unwrap();
                let worst = channel.data.iter().zip(found).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                let is_kept = channel.kind == SampleKind::Float || channel.name == "A";
                assert!(if is_kept { found == channel.data } else { worst < 0.1 }, "{}: {worst}", channel.name);
            }
        }
    }

    #[test]
    fn the_same_picture_gives_the_same_bytes_every_time() {
        for writer in [write, write_parts] {
            let first = writer(&sample(), Compression::Zips).unwrap();
            for _ in 0..20 {
                assert!(writer(&sample(), Compression::Zips).unwrap() == first);
            }
        }
    }

    #[test]
    fn a_half_too_bright_stays_finite_and_nan_stays_nan() {
        let mut image = Image::new([3, 1]);
        image.push("R", SampleKind::Half, vec![1e9, f32::NAN, f32::INFINITY]);
        let back = decoded(&write(&image, Compression::Zips).unwrap()).unwrap();
        let r = back.channel("R").unwrap();
        assert!(r[0] == 65504.0 && r[1].is_nan() && r[2].is_infinite());
    }

    #[test]
    fn a_second_part_brings_its_channels_and_its_window() {
        let part = |name: &str, position: (i32, i32), value: f32| codec::Layer {
            channel_data: codec::AnyChannels::sort(
                [codec::AnyChannel::new("R", codec::FlatSamples::F32(vec![value; 4]))].into_iter().collect(),
            ),
            attributes: codec::LayerAttributes::named(name).with_position(codec::Vec2(position.0, position.1)),
            size: codec::Vec2(2, 2),
            encoding: codec::Encoding::FAST_LOSSLESS,
        };
        let layers = [part("beauty", (0, 0), 1.0), part("fog", (1, 1), 2.0)];
        let display = codec::IntegerBounds::new((0, 0), (3, 3));
        let file = codec::Image::from_layers(codec::ImageAttributes::new(display), layers.to_vec());
        let mut bytes = Cursor::new(Vec::new());
        file.write().non_parallel().to_buffered(&mut bytes).unwrap();
        let image = decoded(bytes.get_ref()).unwrap();
        assert_eq!((image.size, image.data_size), ([3, 3], [3, 3]));
        assert_eq!(image.channel("R").unwrap(), [1.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(image.channel("fog.R").unwrap(), [0.0, 0.0, 0.0, 0.0, 2.0, 2.0, 0.0, 2.0, 2.0]);
    }

    #[test]
    fn truncated_and_damaged_files_are_errors_or_pictures_but_never_panics() {
        let good = write(&sample(), Compression::Zips).unwrap();
        for length in 0..good.len() {
            assert!(decoded(&good[..length]).is_err(), "{length} of {} bytes were enough", good.len());
        }
        for i in 0..4000u64 {
            let mut bad = good.clone();
            for j in 0..1 + i % 3 {
                let word = Seed(77).derive(i).word(j);
                // Most damage goes into the header, where sizes and counts are.
                let range = if word & 1 == 0 { bad.len() } else { 700.min(bad.len()) };
                let place = (word >> 16) as usize % range;
                bad[place] = (word >> 8) as u8;
            }
            let _ = decoded(&bad);
        }
    }

    #[test]
    fn a_huge_picture_in_a_small_file_is_refused_before_memory_is_taken() {
        let mut bytes = write(&sample(), Compression::Zips).unwrap();
        let at = bytes.windows(10).position(|w| w == b"dataWindow").unwrap() + 10 + 1 + 6 + 4;
        bytes[at..at + 16].copy_from_slice(&[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0]);
        let error = decoded(&bytes).unwrap_err();
        assert!(matches!(error, OutputError::TooLarge { .. } | OutputError::Invalid { .. }), "{error}");
    }

    #[test]
    fn pictures_that_make_no_sense_are_refused() {
        assert!(write(&Image::new([4, 4]), Compression::Zips).is_err());
        let mut twice = Image::new([1, 1]);
        twice.push("R", SampleKind::Half, vec![0.0]);
        twice.push("R", SampleKind::Half, vec![0.0]);
        assert!(write(&twice, Compression::Zips).unwrap_err().to_string().contains("two channels `R`"));
    }
}
