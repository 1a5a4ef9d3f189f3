//! The layers of a picture: channels that belong together.
//!
//! R, G and B without a name are the layer `beauty`; any other channel is of the layer before its last dot, or a layer of its own
//! name. Layers whose names begin with `variance` say how noisy others are: `variance.R` is for `R`, `variance.albedo.R` for
//! `albedo.R`. They are no layers to be compared.

use crate::output::image::Image;

/// Name of the layer of R, G and B.
pub const BEAUTY: &str = "beauty";

/// What stands before the name of a channel whose noise another one tells.
const VARIANCE: &str = "variance.";

/// Channels that belong together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layer {
    /// Its name.
    pub name: String,
    /// What stands behind the last dot of its channels, in the order of the picture; empty for a layer of one channel without a
    /// dot.
    pub parts: Vec<String>,
}

impl Layer {
    /// Full names of its channels.
    pub fn channel_names(&self) -> Vec<String> {
        match self.name.as_str() {
            BEAUTY => self.parts.clone(),
            name if self.parts.is_empty() => vec![name.into()],
            name => self.parts.iter().map(|part| format!("{name}.{part}")).collect(),
        }
    }

    /// The numbers of its channels, if the picture has them all.
    pub fn channels<'i>(&self, image: &'i Image) -> Option<Vec<&'i [f32]>> {
        self.channel_names().iter().map(|name| image.channel(name)).collect()
    }

    /// The variances of its channels, if the picture has them all.
    pub fn variances<'i>(&self, image: &'i Image) -> Option<Vec<&'i [f32]>> {
        self.channel_names().iter().map(|name| image.channel(&variance_name(name))).collect()
    }
}

/// The channel that says how noisy another one is.
pub fn variance_name(channel: &str) -> String {
    format!("{VARIANCE}{channel}")
}

/// The layers of a picture but those of variances, `beauty` first.
pub fn layers_of(image: &Image) -> Vec<Layer> {
    let mut layers: Vec<Layer> = Vec::new();
    for channel in image.channels.iter().filter(|c| !c.name.starts_with(VARIANCE)) {
        let (name, part) = match channel.name.rsplit_once('.') {
            Some((layer, part)) => (layer, Some(part)),
            None if ["R", "G", "B"].contains(&channel.name.as_str()) => (BEAUTY, Some(channel.name.as_str())),
            None => (channel.name.as_str(), None),
        };
        let parts = part.map(String::from);
        match layers.iter_mut().find(|layer| layer.name == name) {
            Some(layer) => layer.parts.extend(parts),
            None => layers.push(Layer { name: name.into(), parts: parts.into_iter().collect() }),
        }
    }
    layers
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::image::SampleKind;

    #[test]
    fn channels_find_their_layers_and_their_variances() {
        let mut image = Image::new([1, 1]);
        for name in
            ["B", "G", "R", "A", "Z", "albedo.R", "albedo.G", "albedo.B", "key.specular.R", "variance.R", "variance.Z"]
        {
            image.push(name, SampleKind::Float, vec![0.0]);
        }
        let layers = layers_of(&image);
        let names: Vec<&str> = layers.iter().map(|layer| layer.name.as_str()).collect();
        assert_eq!(names, ["beauty", "A", "Z", "albedo", "key.specular"]);
        assert_eq!(layers[0].channel_names(), ["R", "G", "B"]);
        assert_eq!(layers[3].channel_names(), ["albedo.R", "albedo.G", "albedo.B"]);
        assert!(layers[2].variances(&image).is_some() && layers[0].variances(&image).is_none());
    }
}
