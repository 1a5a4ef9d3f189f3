//! Holds a scene's tree against the schema that `settings.rs` generates, and turns it into settings.
//!
//! All violations are collected. Where one is found the tree is mended (an unknown key dropped, a bad value replaced by
//! a default or the smallest legal one), so that the checks of meaning still run on the rest; `Conformed::mended` says
//! which keys they must not judge.

use crate::diagnostic::{Collector, Place, listed, nearest};
use crate::schema::{
    KEY_OPTIONS, Variants, alternatives, decimal, expected, first_sentence, is_keyed, member_is_optional, required,
    resolve, stand_in, type_name, variants,
};
use crate::settings::keyed::OPTIONS;
use crate::tree::{Entry, Node, Value};
use crate::unit::{advice, advice_for_share, linear_of_hex, unit_of};
use serde_json::{Map as JsonMap, Value as Json, json};
use std::collections::HashMap;

/// Largest number that is not a count. Its square still fits an f32.
const MAGNITUDE_MAX: f64 = 1e12;
/// Least positive length, time and so on. Its square is still far above the smallest f32.
const POSITIVE_MIN: f64 = 1e-9;

/// Largest number of a frame in a map of frames and values, either way.
const FRAME_MAX: f64 = 1e7;

/// Keys of other programs and what they are called here.
const SYNONYMS: [(&str, &str); 10] = [
    ("start", "first"),
    ("begin", "first"),
    ("end", "last"),
    ("stop", "last"),
    ("color", "reflectance"),
    ("colour", "reflectance"),
    ("target", "look_at"),
    ("samples", "spp"),
    ("size", "radius"),
    ("position", "center"),
];

/// A tree that fits the schema.
pub struct Conformed {
    /// The settings, ready for serde.
    pub settings: Json,
    /// Key paths at which something was wrong.
    pub mended: Vec<String>,
    /// Of each value over time its frames.
    pub keyed: Vec<KeyedFrames>,
}

/// Frames of the keys of a value, rising, and the key paths at which they stand.
pub type KeyedFrames = Vec<(f64, String)>;

/// Compares a tree with a JSON Schema of the subset that schemars makes of plain structs, externally tagged enums,
/// options, lists and maps.
pub fn conform(tree: &Node, schema: &Json, collector: &mut Collector<'_>) -> Conformed {
    conform_document(tree, schema, "begin with `version: 1`, `camera` and `lights`", collector)
}

/// As [`conform`], for another kind of file than scenes; `beginning` is the help where a file is empty.
pub fn conform_document(tree: &Node, schema: &Json, beginning: &str, collector: &mut Collector<'_>) -> Conformed {
    let mut walk = Walk { root: schema, collector, mended: Vec::new(), keyed: Vec::new(), unit: None, beginning };
    let settings = walk.value(tree, schema, Place::START, "");
    Conformed { settings, mended: walk.mended, keyed: walk.keyed }
}

/// Key path of a member.
pub fn join(parent: &str, key: &str) -> String {
    if parent.is_empty() { key.into() } else { format!("{parent}.{key}") }
}

struct Walk<'s, 'c, 'a> {
    root: &'s Json,
    collector: &'c mut Collector<'a>,
    mended: Vec<String>,
    keyed: Vec<KeyedFrames>,
    /// Of the key that is being looked at.
    unit: Option<&'s str>,
    /// How such a file begins.
    beginning: &'c str,
}

impl<'s> Walk<'s, '_, '_> {
    fn resolve(&self, schema: &'s Json) -> &'s Json {
        resolve(self.root, schema)
    }

    /// Reports, remembers the path, and returns what to go on with.
    fn wrong(&mut self, place: Place, path: &str, message: String, help: Option<String>, schema: &'s Json) -> Json {
        let diagnostic = self.collector.error(place, path, message);
        diagnostic.help.extend(help);
        self.mended.push(path.into());
        self.stand_in(schema)
    }

    fn value(&mut self, node: &Node, schema: &'s Json, at: Place, path: &str) -> Json {
        if let Some(entries) = self.keys_of(node, schema) {
            return self.keyed(entries, schema, at, path);
        }
        let faults = self.mended.len();
        let value = self.unkeyed(node, schema, at, path);
        let is_map = matches!(node.value, Value::Map(_)) && type_name(self.resolve(schema)) != "object";
        if is_keyed(schema) && is_map && self.mended.len() > faults {
            self.collector.help_latest("a value over time is a map of frames and values, as in `{1: .., 96: ..}`");
        }
        value
    }

    /// The entries of a map of frames and values, where one may be and this is not the value itself.
    fn keys_of<'n>(&self, node: &'n Node, schema: &'s Json) -> Option<&'n [Entry]> {
        let Value::Map(entries) = &node.value else { return None };
        let properties = self.resolve(schema)["properties"].as_object();
        let is_value = |entry: &Entry| properties.is_some_and(|p| p.contains_key(&entry.key));
        let tells_frames = |entry: &Entry| frame_of(&entry.key).is_some() || OPTIONS.contains(&entry.key.as_str());
        let is_keys = match properties {
            // Of what is itself a map, one of its own keys tells that it is the value.
            Some(_) => entries.iter().any(tells_frames) && !entries.iter().any(is_value),
            None => entries.is_empty() || entries.iter().any(tells_frames),
        };
        (is_keyed(schema) && is_keys).then_some(entries)
    }

    /// A map of frames and values.
    fn keyed(&mut self, entries: &[Entry], schema: &'s Json, at: Place, path: &str) -> Json {
        let mut keys: Vec<(f64, Json)> = Vec::new();
        let mut frames = KeyedFrames::new();
        let mut options = JsonMap::new();
        for entry in entries {
            if self.collector.is_full() {
                break;
            }
            let key_path = join(path, &entry.key);
            if OPTIONS.contains(&entry.key.as_str()) {
                let member = &self.root[KEY_OPTIONS][&entry.key];
                options.insert(entry.key.clone(), self.unkeyed(&entry.node, member, entry.place(), &key_path));
                continue;
            }
            let Some(frame) = frame_of(&entry.key) else {
                let message = format!("`{}` is no frame", short(&entry.key));
                let diagnostic = self.collector.error(entry.key_place, &key_path, message);
                diagnostic.help("a value over time is a map of frames and values, as in `{1: .., 96: ..}`");
                diagnostic.help(format!("besides frames are allowed here: {}", listed(OPTIONS)));
                self.mended.push(path.into());
                continue;
            };
            if keys.iter().any(|(known, _)| *known == frame) {
                self.collector.error(entry.key_place, &key_path, format!("frame {} is given twice", decimal(frame)));
                self.mended.push(path.into());
                continue;
            }
            keys.push((frame, self.unkeyed(&entry.node, schema, entry.place(), &key_path)));
            frames.push((frame, key_path));
        }
        if keys.is_empty() {
            let message = "there is no frame in this map".into();
            let help = Some("write a value, or values at frames as in `{1: .., 96: ..}`".into());
            return self.wrong(at, path, message, help, schema);
        }
        // Keys may stand in any order.
        keys.sort_by(|a, b| a.0.total_cmp(&b.0));
        frames.sort_by(|a, b| a.0.total_cmp(&b.0));
        self.keyed.push(frames);
        options.insert("keys".into(), json!(keys));
        Json::Object(options)
    }

    fn unkeyed(&mut self, node: &Node, schema: &'s Json, at: Place, path: &str) -> Json {
        let schema = self.resolve(schema);
        if let Some(choices) = alternatives(schema) {
            let is_option = choices.iter().any(|choice| choice["type"] == "null");
            let inner = choices.iter().find(|choice| choice["type"] != "null").filter(|_| is_option);
            return match inner {
                Some(inner) => self.value(node, inner, at, path),
                None => self.variant(node, schema, at, path),
            };
        }
        match type_name(schema) {
            "object" => self.object(node, schema, at, path),
            "array" => self.array(node, schema, at, path),
            "number" => self.number(node, schema, at, path),
            "integer" => self.integer(node, schema, at, path),
            "string" => match &node.value {
                Value::Text(text) => json!(text),
                Value::Integer(_) | Value::Float(_) | Value::Bool(_) => {
                    let help = Some("put it in quotes".into());
                    self.wrong_type(node, schema, at, path, help)
                }
                _ => self.wrong_type(node, schema, at, path, None),
            },
            "boolean" => match &node.value {
                Value::Bool(value) => json!(value),
                Value::Text(text) => {
                    let help = match text.to_lowercase().as_str() {
                        "yes" | "on" | "y" => Some("write `true`".into()),
                        "no" | "off" | "n" => Some("write `false`".into()),
                        _ => None,
                    };
                    self.wrong_type(node, schema, at, path, help)
                }
                _ => self.wrong_type(node, schema, at, path, None),
            },
            _ => Json::Null,
        }
    }

    fn wrong_type(&mut self, node: &Node, schema: &'s Json, at: Place, path: &str, help: Option<String>) -> Json {
        let message = format!("expected {}, found {}", expected(self.root, schema), found(node));
        self.wrong(at, path, message, help, schema)
    }

    fn object(&mut self, node: &Node, schema: &'s Json, at: Place, path: &str) -> Json {
        let entries: &[Entry] = match &node.value {
            Value::Map(entries) => entries,
            Value::Null if path.is_empty() => {
                let message = "the file holds no settings".into();
                let help = Some(self.beginning.into());
                return self.wrong(at, path, message, help, schema);
            }
            Value::Null => {
                let help = Some("its own keys go on the lines below it, indented further than it is".into());
                return self.wrong_type(node, schema, at, path, help);
            }
            _ => return self.wrong_type(node, schema, at, path, None),
        };
        let mut result = JsonMap::new();
        let mut first_place: HashMap<&str, Place> = HashMap::new();
        // Keys that are there under a wrong name, so that they are not reported as missing too.
        let mut meant: Vec<&str> = Vec::new();
        let properties = schema["properties"].as_object();
        for entry in entries {
            if self.collector.is_full() {
                break;
            }
            let key_path = join(path, &entry.key);
            if let Some(first) = first_place.get(entry.key.as_str()) {
                let line = first.position.line;
                let message = format!("the key `{}` is repeated; it was first given in line {line}", entry.key);
                self.collector.error(entry.key_place, &key_path, message);
                self.mended.push(key_path);
                continue;
            }
            first_place.insert(&entry.key, entry.key_place);
            let member = properties.and_then(|p| p.get(&entry.key));
            let Some(member) = member.or_else(|| Some(&schema["additionalProperties"]).filter(|s| s.is_object()))
            else {
                meant.extend(self.unknown_key(entry, schema, &key_path));
                self.mended.push(key_path);
                continue;
            };
            // A key whose settings are all commented out means its default.
            if entry.node.value == Value::Null && member_is_optional(schema, &entry.key) {
                continue;
            }
            let outer = std::mem::replace(&mut self.unit, unit_of(member));
            let value = self.value(&entry.node, member, entry.place(), &key_path);
            self.unit = outer;
            if value != Json::Null {
                result.insert(entry.key.clone(), value);
            }
        }
        for key in required(schema) {
            if first_place.contains_key(key) || self.collector.is_full() {
                continue;
            }
            let member = &schema["properties"][key];
            if meant.contains(&key) {
                self.mended.push(join(path, key));
                result.insert(key.into(), self.stand_in(member));
                continue;
            }
            let help = first_sentence(member).map(|text| format!("`{key}`: {text}"));
            let stand_in = self.wrong(at, &join(path, key), format!("the key `{key}` is missing"), help, member);
            result.insert(key.into(), stand_in);
        }
        Json::Object(result)
    }

    /// Reports the key and returns the one that was probably meant.
    fn unknown_key(&mut self, entry: &Entry, schema: &'s Json, key_path: &str) -> Option<&'s str> {
        let known: Vec<&str> =
            schema["properties"].as_object().into_iter().flatten().map(|(k, _)| k.as_str()).collect();
        let other = SYNONYMS.iter().find(|(name, own)| *name == entry.key && known.contains(own));
        let meant = other.and_then(|(_, own)| known.iter().copied().find(|name| name == own));
        let meant = meant.or_else(|| nearest(&entry.key, known.iter().copied()));
        let diagnostic =
            self.collector.error(entry.key_place, key_path, format!("unknown key `{}`", short(&entry.key)));
        match &entry.node.value {
            Value::Text(kind) if is_tag(&entry.key) && known.contains(&kind.as_str()) => {
                diagnostic.help(format!("the kind is itself the key: `{kind}: {{...}}`"));
            }
            _ => diagnostic.help.extend(meant.map(|name| format!("did you mean `{name}`?"))),
        }
        diagnostic.help(format!("allowed here: {}", listed(known)));
        meant
    }

    fn array(&mut self, node: &Node, schema: &'s Json, at: Place, path: &str) -> Json {
        let Value::List(items) = &node.value else {
            let help = match (&node.value, schema["minItems"].as_u64()) {
                (Value::Map(_), None) => Some("begin every item with `- `".into()),
                (Value::Integer(_) | Value::Float(_), Some(count)) => {
                    Some(format!("write `[{}]`", vec![found(node); count as usize].join(", ")))
                }
                (Value::Text(text), Some(3)) => Some(match linear_of_hex(text) {
                    Some(list) => format!("write red, green and blue in linear light: `{list}`"),
                    None => "write three numbers, as in `[0.9, 0.9, 0.9]`".into(),
                }),
                _ => None,
            };
            return self.wrong_type(node, schema, at, path, help);
        };
        let least = schema["minItems"].as_u64().unwrap_or(0) as usize;
        let most = schema["maxItems"].as_u64().map_or(usize::MAX, |n| n as usize);
        if !(least..=most).contains(&items.len()) {
            let message = format!("expected {}, found {} of them", expected(self.root, schema), items.len());
            return self.wrong(at, path, message, None, schema);
        }
        let mut values = Vec::with_capacity(items.len());
        for (index, item) in items.iter().enumerate() {
            if self.collector.is_full() {
                break;
            }
            let place = if item.place.length == 0 && item.value == Value::Null { at } else { item.place };
            values.push(self.value(item, &schema["items"], place, &format!("{path}[{index}]")));
        }
        Json::Array(values)
    }

    fn number(&mut self, node: &Node, schema: &'s Json, at: Place, path: &str) -> Json {
        let value = match &node.value {
            Value::Integer(value) => *value as f64,
            Value::Float(value) => *value,
            _ => return self.not_a_number(node, schema, at, path),
        };
        if !value.is_finite() {
            let message = format!("expected a finite number, found {}", found(node));
            return self.wrong(at, path, message, None, schema);
        }
        self.in_range(value, node, schema, at, path).unwrap_or_else(|| json!(value))
    }

    fn integer(&mut self, node: &Node, schema: &'s Json, at: Place, path: &str) -> Json {
        let value = match &node.value {
            Value::Integer(value) => *value,
            // 1e6 is a fine way to write a million.
            Value::Float(value) if value.fract() == 0.0 => *value as i128,
            Value::Float(value) if value.is_finite() => return self.wrong_type(node, schema, at, path, None),
            Value::Float(_) => {
                let message = format!("expected a whole number, found {}", found(node));
                return self.wrong(at, path, message, None, schema);
            }
            _ => return self.not_a_number(node, schema, at, path),
        };
        if let Some(stand_in) = self.in_range(value as f64, node, schema, at, path) {
            return stand_in;
        }
        let (least, most): (i128, i128) = match schema["format"].as_str() {
            Some("uint32") => (0, u32::MAX.into()),
            Some("int32") => (i32::MIN.into(), i32::MAX.into()),
            Some("int64") => (i64::MIN.into(), i64::MAX.into()),
            _ => (0, u64::MAX.into()),
        };
        if value < least || value > most {
            let message = format!("must be from {least} to {most}, found {value}");
            return self.wrong(at, path, message, None, schema);
        }
        u64::try_from(value).map_or_else(|_| json!(value as i64), |value| json!(value))
    }

    fn not_a_number(&mut self, node: &Node, schema: &'s Json, at: Place, path: &str) -> Json {
        let help = match &node.value {
            Value::Text(text) => number_help(text, self.unit, is_share(schema)),
            _ => None,
        };
        self.wrong_type(node, schema, at, path, help)
    }

    /// A stand-in if the number is out of its range.
    fn in_range(&mut self, value: f64, node: &Node, schema: &'s Json, at: Place, path: &str) -> Option<Json> {
        let minimum = schema["minimum"].as_f64();
        let above = schema["exclusiveMinimum"].as_f64();
        let maximum = schema["maximum"].as_f64();
        let is_count = type_name(schema) == "integer";
        let allowed = match (minimum, above, maximum) {
            (Some(only), _, Some(most)) if only == most && value != only => decimal(only),
            (Some(least), _, Some(most)) if value < least || value > most => {
                format!("from {} to {}", decimal(least), decimal(most))
            }
            (Some(least), _, _) if value < least => format!("at least {}", decimal(least)),
            (_, Some(bound), _) if value <= bound => format!("more than {}", decimal(bound)),
            (_, Some(0.0), _) if value < POSITIVE_MIN => format!("at least {}", decimal(POSITIVE_MIN)),
            (_, _, Some(most)) if value > most => format!("at most {}", decimal(most)),
            _ if value.abs() > MAGNITUDE_MAX && !is_count => {
                format!("from -{0} to {0}", decimal(MAGNITUDE_MAX))
            }
            _ => return None,
        };
        let help = if is_share(schema) { advice_for_share(value) } else { None };
        Some(self.wrong(at, path, format!("must be {allowed}, found {}", found(node)), help, schema))
    }

    fn variant(&mut self, node: &Node, schema: &'s Json, at: Place, path: &str) -> Json {
        let variants = variants(schema);
        let names: Vec<&str> = variants.units.iter().copied().chain(variants.maps.iter().map(|v| v.0)).collect();
        match &node.value {
            Value::Text(text) if variants.units.contains(&text.as_str()) => json!(text),
            Value::Text(text) if variants.maps.iter().any(|v| v.0 == text) => {
                let help = Some(format!("write it as a map with one key: `{text}: {{...}}`"));
                self.wrong(at, path, format!("`{text}` needs settings"), help, schema)
            }
            Value::Text(_) if variants.units.is_empty() && !variants.others.is_empty() => {
                self.value(node, variants.others[0], at, path)
            }
            Value::Text(text) => {
                let message = format!("unknown name `{}`", short(text));
                let stand_in = self.wrong(at, path, message, None, schema);
                self.help_names(text, &names, schema);
                stand_in
            }
            Value::Map(entries) if !variants.maps.is_empty() => self.single_key(entries, &variants, schema, at, path),
            Value::Integer(_) | Value::Float(_) | Value::List(_) if !variants.others.is_empty() => {
                // One of them may be a list, and another not.
                let is_list = matches!(node.value, Value::List(_));
                let fits = |other: &&&Json| (type_name(resolve(self.root, other)) == "array") == is_list;
                let other = variants.others.iter().find(fits).unwrap_or(&variants.others[0]);
                self.value(node, other, at, path)
            }
            _ => self.wrong_type(node, schema, at, path, None),
        }
    }

    /// Help for an unknown name, on the latest problem.
    fn help_names(&mut self, typed: &str, names: &[&str], schema: &'s Json) {
        let mut allowed = listed(names.iter().copied());
        for other in variants(schema).others {
            allowed += &format!(", or {}", expected(self.root, other));
        }
        if let Some(name) = nearest(typed, names.iter().copied()) {
            self.collector.help_latest(format!("did you mean `{name}`?"));
        }
        self.collector.help_latest(format!("allowed here: {allowed}"));
    }

    fn single_key(
        &mut self,
        entries: &[Entry],
        variants: &Variants<'s>,
        schema: &'s Json,
        at: Place,
        path: &str,
    ) -> Json {
        let names: Vec<&str> = variants.maps.iter().map(|v| v.0).collect();
        let mut result = None;
        let mut known_count = 0;
        for entry in entries {
            let key_path = join(path, &entry.key);
            if let Some((name, member)) = variants.maps.iter().find(|v| v.0 == entry.key) {
                known_count += 1;
                if known_count == 2 {
                    let first = entries.iter().map(|e| e.key.as_str()).find(|key| names.contains(key)).unwrap_or("");
                    let message = format!("`{first}` is given already; exactly one is allowed here");
                    self.collector.error(entry.key_place, &key_path, message);
                    self.mended.push(path.into());
                }
                let value = self.value(&entry.node, member, entry.place(), &key_path);
                result.get_or_insert_with(|| json!({ *name: value }));
                continue;
            }
            self.mended.push(path.into());
            self.collector.error(entry.key_place, &key_path, format!("unknown key `{}`", entry.key));
            match &entry.node.value {
                Value::Text(kind) if is_tag(&entry.key) && names.contains(&kind.as_str()) => {
                    self.collector.help_latest(format!("the kind is itself the key: `{kind}: {{...}}`"));
                }
                // A setting of the variant, written beside it instead of inside it.
                _ if entries.len() > 1 && entries.iter().any(|e| names.contains(&e.key.as_str())) => {
                    let kind = entries.iter().map(|e| e.key.as_str()).find(|key| names.contains(key)).unwrap_or("");
                    self.collector.help_latest(format!("settings go inside: `{kind}: {{{}: ...}}`", entry.key));
                }
                _ => self.help_names(&entry.key, &names, schema),
            }
        }
        if entries.is_empty() {
            let message = format!("expected exactly one of {}, found none", listed(names));
            return self.wrong(at, path, message, None, schema);
        }
        result.unwrap_or_else(|| self.stand_in(schema))
    }

    /// Something legal in place of something wrong.
    fn stand_in(&self, schema: &'s Json) -> Json {
        stand_in(self.root, schema, 0)
    }
}

/// The frame that a key of a map of frames and values stands for.
fn frame_of(key: &str) -> Option<f64> {
    key.trim().parse::<f64>().ok().filter(|frame| frame.abs() <= FRAME_MAX)
}

/// Keys with which other programs name the kind of a thing.
fn is_tag(key: &str) -> bool {
    matches!(key, "type" | "kind")
}

/// In words what a tree holds.
fn found(node: &Node) -> String {
    match &node.value {
        Value::Null => "nothing".into(),
        Value::Bool(value) => format!("`{value}`"),
        Value::Integer(value) => value.to_string(),
        Value::Float(value) if value.is_nan() => ".nan".into(),
        Value::Float(value) if value.is_infinite() => if *value > 0.0 { ".inf" } else { "-.inf" }.into(),
        Value::Float(value) => decimal(*value),
        Value::Text(text) => format!("the text `{}`", short(text)),
        Value::List(items) => format!("a list of {}", items.len()),
        Value::Map(_) => "a map".into(),
    }
}

fn short(text: &str) -> String {
    let line: String = text.chars().take(40).map(|c| if c.is_control() { ' ' } else { c }).collect();
    if text.chars().count() > 40 { format!("{line}…") } else { line }
}

/// Whether a number is a share of something: from 0 to 1.
fn is_share(schema: &Json) -> bool {
    schema["minimum"].as_f64() == Some(0.0) && schema["maximum"].as_f64() == Some(1.0)
}

/// What a text that stands for a number should have been.
fn number_help(text: &str, unit: Option<&str>, is_share: bool) -> Option<String> {
    let text = text.trim();
    if text.parse::<f64>().is_ok_and(f64::is_finite) {
        return Some("remove the quotes".into());
    }
    let dotted = text.replacen(',', ".", 1);
    if dotted != text && dotted.parse::<f64>().is_ok() {
        return Some(format!("write `{dotted}`, with a point"));
    }
    advice(&dotted, unit, is_share)
}
