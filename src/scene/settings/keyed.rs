//! Values that may change over time: one value, or one for each of some frames.

use crate::settings::{Frames, Interpolation};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// The mark of values in the schema that may be keyed.
pub const MARK: &str = "x-keyed";

/// What a map of frames and values may hold besides.
pub const OPTIONS: [&str; 2] = ["interpolation", "repeat"];

/// A value that may change over time: in a file a value, or a map of frames and values as `{1: .., 96: ..}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Keyed<T> {
    /// Values at some frames.
    Keys(KeyMap<T>),
    /// The same at all times.
    Constant(T),
}

/// Values at some frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyMap<T> {
    /// Frames, rising, and values; at least one.
    pub keys: Vec<(f64, T)>,
    /// How the value gets from key to key.
    #[serde(default)]
    pub interpolation: Interpolation,
    /// Whether the course from the first key to the last goes on and on.
    #[serde(default)]
    pub repeat: bool,
}

impl<T> Keyed<T> {
    /// The value at the first key.
    pub fn first(&self) -> &T {
        match self {
            Self::Constant(value) => value,
            Self::Keys(map) => &map.keys[0].1,
        }
    }

    /// The value at the last key.
    pub fn last(&self) -> &T {
        match self {
            Self::Constant(value) => value,
            Self::Keys(map) => &map.keys[map.keys.len() - 1].1,
        }
    }

    /// All values.
    pub fn values(&self) -> impl Iterator<Item = &T> {
        let (one, many) = match self {
            Self::Constant(value) => (Some(value), [].as_slice()),
            Self::Keys(map) => (None, map.keys.as_slice()),
        };
        one.into_iter().chain(many.iter().map(|(_, value)| value))
    }

    /// Whether it has several values.
    pub fn varies(&self) -> bool {
        matches!(self, Self::Keys(map) if map.keys.len() > 1)
    }

    /// Whether it jumps: from one key to the next, or from the last to the first.
    pub fn jumps(&self) -> bool
    where
        T: PartialEq,
    {
        match self {
            Self::Constant(_) => false,
            Self::Keys(map) if map.interpolation == Interpolation::Step => self.varies(),
            Self::Keys(map) => map.repeat && self.first() != self.last(),
        }
    }

    /// Times [s], the first frame being at 0, and values: at least one.
    pub fn timed<'k>(&'k self, frames: &'k Frames) -> impl Iterator<Item = (f64, &'k T)> {
        let (one, many) = match self {
            Self::Constant(value) => (Some((0.0, value)), [].as_slice()),
            Self::Keys(map) => (None, map.keys.as_slice()),
        };
        one.into_iter().chain(many.iter().map(move |(frame, value)| (frames.time(*frame), value)))
    }

    /// How it gets from key to key.
    pub fn interpolation(&self) -> Interpolation {
        match self {
            Self::Constant(_) => Interpolation::Step,
            Self::Keys(map) => map.interpolation,
        }
    }

    /// Whether its course goes on and on.
    pub fn repeats(&self) -> bool {
        matches!(self, Self::Keys(map) if map.repeat)
    }
}

impl<T: Default> Default for Keyed<T> {
    fn default() -> Self {
        Self::Constant(T::default())
    }
}

impl<T> From<T> for Keyed<T> {
    fn from(value: T) -> Self {
        Self::Constant(value)
    }
}

// The schema is that of the value itself with a mark, so that bounds that a key adds hold for the values of all frames.
impl<T: JsonSchema> JsonSchema for Keyed<T> {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        format!("Keyed{}", T::schema_name()).into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let mut schema = generator.subschema_for::<T>();
        schema.insert(MARK.into(), true.into());
        schema
    }
}
