//! YAML text as a tree in which every key and value knows its place.

use crate::diagnostic::{Place, Position};
use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_yaml::options::{DuplicateKeyPolicy, NonFiniteFloatPolicy};
use serde_yaml::{Location, Options, Spanned};
use std::fmt;

/// Deepest nesting of maps and lists; the schema needs 8.
const DEPTH_MAX: usize = 32;
/// Most keys and values of a scene, with everything that aliases repeat. A scene with a thousand lights has 20 000.
const NODE_COUNT_MAX: usize = 100_000;

/// A value with its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// The value.
    pub value: Value,
    /// Where it is written. For a value that an alias repeats, the place of the original.
    pub place: Place,
}

/// What YAML can say.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// Nothing.
    Null,
    /// `true` or `false`.
    Bool(bool),
    /// A whole number.
    Integer(i128),
    /// Any other number, infinities and NaN included.
    Float(f64),
    /// Text.
    Text(String),
    /// A list.
    List(Vec<Node>),
    /// A map in the order of the text; keys may be repeated.
    Map(Vec<Entry>),
}

/// A key of a map with its value.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// The key.
    pub key: String,
    /// Where the key is written.
    pub key_place: Place,
    /// The value.
    pub node: Node,
}

impl Entry {
    /// The place to point at when the value as a whole is wrong: the value, or the key of a block.
    pub fn place(&self) -> Place {
        if self.node.place.length == 0 { self.key_place } else { self.node.place }
    }
}

/// Why a text is no YAML that a scene may be made of.
#[derive(Debug, Clone, PartialEq)]
pub struct SyntaxError {
    /// Where reading stopped.
    pub place: Place,
    /// What is wrong.
    pub message: String,
    /// A way out, if there is a likely one.
    pub help: Option<String>,
}

/// Reads one YAML document.
///
/// # Errors
/// The first violation of YAML's grammar, or of the limits on depth and size that stop hostile files.
pub fn parse(text: &str, source_idx: usize) -> Result<Node, SyntaxError> {
    let mut options = Options::default();
    options.duplicate_keys = DuplicateKeyPolicy::PassThrough;
    options.non_finite_float_policy = NonFiniteFloatPolicy::PassThrough;
    options.strict_booleans = true;
    options.reject_unsupported_tags = true;
    options.with_snippet = false;
    let mut budget = serde_yaml::budget::Budget::default();
    budget.max_depth = DEPTH_MAX;
    budget.max_nodes = NODE_COUNT_MAX;
    budget.max_events = 4 * NODE_COUNT_MAX;
    budget.max_recorded_anchor_events = 4 * NODE_COUNT_MAX;
    options.budget = Some(budget);
    let source = SourceText { text, source_idx };
    match serde_yaml::from_str_with_options::<Spanned<RawValue>>(text, options) {
        Ok(raw) => Ok(source.node(raw)),
        Err(error) => Err(source.syntax_error(&error)),
    }
}

/// A value as serde hands it over.
enum RawValue {
    Scalar(Value),
    List(Vec<Spanned<RawValue>>),
    Map(Vec<(Spanned<String>, Spanned<RawValue>)>),
}

impl<'de> Deserialize<'de> for RawValue {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(RawVisitor)
    }
}

struct RawVisitor;

impl<'de> Visitor<'de> for RawVisitor {
    type Value = RawValue;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value")
    }
    fn visit_unit<E>(self) -> Result<RawValue, E> {
        Ok(RawValue::Scalar(Value::Null))
    }
    fn visit_none<E>(self) -> Result<RawValue, E> {
        Ok(RawValue::Scalar(Value::Null))
    }
    fn visit_bool<E>(self, value: bool) -> Result<RawValue, E> {
        Ok(RawValue::Scalar(Value::Bool(value)))
    }
    fn visit_i64<E>(self, value: i64) -> Result<RawValue, E> {
        Ok(RawValue::Scalar(Value::Integer(value.into())))
    }
    fn visit_u64<E>(self, value: u64) -> Result<RawValue, E> {
        Ok(RawValue::Scalar(Value::Integer(value.into())))
    }
    fn visit_i128<E>(self, value: i128) -> Result<RawValue, E> {
        Ok(RawValue::Scalar(Value::Integer(value)))
    }
    fn visit_f64<E>(self, value: f64) -> Result<RawValue, E> {
        Ok(RawValue::Scalar(Value::Float(value)))
    }
    fn visit_str<E>(self, value: &str) -> Result<RawValue, E> {
        Ok(RawValue::Scalar(Value::Text(value.into())))
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut access: A) -> Result<RawValue, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = access.next_element()? {
            items.push(item);
        }
        Ok(RawValue::List(items))
    }
    fn visit_map<A: MapAccess<'de>>(self, mut access: A) -> Result<RawValue, A::Error> {
        let mut entries = Vec::new();
        while let Some(entry) = access.next_entry()? {
            entries.push(entry);
        }
        Ok(RawValue::Map(entries))
    }
}

struct SourceText<'a> {
    text: &'a str,
    source_idx: usize,
}

impl SourceText<'_> {
    fn node(&self, raw: Spanned<RawValue>) -> Node {
        let place = self.place(raw.defined);
        let value = match raw.value {
            RawValue::Scalar(value) => value,
            RawValue::List(items) => Value::List(items.into_iter().map(|item| self.node(item)).collect()),
            RawValue::Map(entries) => Value::Map(entries.into_iter().map(|entry| self.entry(entry)).collect()),
        };
        Node { value, place }
    }

    fn entry(&self, (key, value): (Spanned<String>, Spanned<RawValue>)) -> Entry {
        let mut key_place = self.place(key.defined);
        key_place.length = key_place.length.max(key.value.chars().count());
        Entry { key_place, key: key.value, node: self.node(value) }
    }

    fn place(&self, location: Location) -> Place {
        let span = location.span();
        let begin = span.byte_offset().and_then(|b| usize::try_from(b).ok());
        let bytes = span.byte_len().and_then(|b| usize::try_from(b).ok());
        let length = match (begin, bytes) {
            (Some(_), Some(0)) => 0,
            (Some(begin), Some(1)) => self.bracketed(begin).unwrap_or(1),
            (Some(begin), Some(bytes)) => {
                let end = begin.saturating_add(bytes);
                self.text.get(begin..end).map_or(1, |part| part.lines().next().unwrap_or_default().chars().count())
            }
            _ => usize::try_from(span.len()).unwrap_or(1),
        };
        Place { source_idx: self.source_idx, position: self.position(location), length }
    }

    fn position(&self, location: Location) -> Position {
        let narrow = |number: u64| u32::try_from(number).unwrap_or(u32::MAX).max(1);
        Position { line: narrow(location.line()), column: narrow(location.column()) }
    }

    /// Length of a flow map or list that begins here and ends on the same line.
    fn bracketed(&self, begin: usize) -> Option<usize> {
        let line = self.text.get(begin..)?.lines().next()?;
        let mut depth = 0usize;
        for (index, character) in line.chars().enumerate() {
            match character {
                '[' | '{' => depth += 1,
                ']' | '}' => depth = depth.saturating_sub(1),
                '"' | '\'' => return None,
                _ => {}
            }
            if depth == 0 {
                return Some(index + 1);
            }
        }
        None
    }

    fn syntax_error(&self, error: &serde_yaml::Error) -> SyntaxError {
        use serde_yaml::Error;
        use serde_yaml::budget::BudgetBreach;
        let error = error.without_snippet();
        let place = error.location().map_or(Place::START, |location| self.place(location));
        let text = error.to_string();
        let plain = text.split(" at line ").next().unwrap_or_default();
        let mut cause = error;
        while let Error::AliasError { error, .. } = cause {
            cause = error;
        }
        let (message, help) = match cause {
            Error::Budget { breach: BudgetBreach::Depth { .. }, .. } => {
                (format!("nested deeper than {DEPTH_MAX} levels"), None)
            }
            Error::Budget { .. }
            | Error::AliasReplayLimitExceeded { .. }
            | Error::AliasExpansionLimitExceeded { .. } => (
                format!("more than {NODE_COUNT_MAX} keys and values, or too many aliases"),
                Some("aliases are counted each time they are used; write out less".into()),
            ),
            Error::MultipleDocuments { .. } => {
                ("a second document begins here; a scene file holds one".into(), Some("remove the `---`".into()))
            }
            Error::RecursiveReferencesRequireWeakTypes { .. } => ("this alias refers to itself".into(), None),
            Error::UnknownAnchor { .. } => (
                "this alias has no anchor".into(),
                Some(
                    "an anchor `&name` must come before its alias `*name`; put text that begins with * in quotes"
                        .into(),
                ),
            ),
            Error::NullIntoString { .. } | Error::Unexpected { .. } => ("keys must be plain text".into(), None),
            _ if plain.contains("tabs disallowed") => {
                ("a tab in the indentation".into(), Some("indent with spaces".into()))
            }
            _ => {
                let line = self.text.lines().nth(place.position.line as usize - 1).unwrap_or_default();
                let has_placeholder = ["{scene}", "{frame"].iter().any(|name| line.contains(name));
                let help = "inside `{...}` a file name with braces of its own must be in quotes";
                let help = if has_placeholder { Some(help.into()) } else { self.indentation_help(place.position) };
                (format!("not YAML: {plain}"), help)
            }
        };
        SyntaxError { place, message, help }
    }

    /// What may be wrong with a line at whose beginning reading stopped.
    fn indentation_help(&self, position: Position) -> Option<String> {
        let column_of = |line: &str| line.chars().take_while(|c| matches!(c, ' ' | '-')).count() + 1;
        let index = position.line as usize - 1;
        let column = self.text.lines().nth(index).map(column_of)?;
        let is_text = |line: &str| !line.trim().is_empty() && !line.trim_start().starts_with('#');
        let before = self.text.lines().take(index).enumerate().filter(|(_, line)| is_text(line)).last();
        let (before_index, before_column) = before.map(|(i, line)| (i, column_of(line)))?;
        (column == position.column as usize && column != before_column).then(|| {
            format!(
                "keys of one map begin in the same column: this line begins in column {column}, line {} in column \
                 {before_column}",
                before_index + 1
            )
        })
    }
}

/// A step of a key path: the name of a key or the index in a list.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Step<'p> {
    Key(&'p str),
    Index(usize),
}

/// Splits `lights[0].sun.direction`; `lights.0.sun` means the same.
fn steps(key_path: &str) -> Vec<Step<'_>> {
    let parts = key_path.split(['.', '[']).map(|part| part.strip_suffix(']').unwrap_or(part));
    parts.filter(|part| !part.is_empty()).map(|part| part.parse().map_or(Step::Key(part), Step::Index)).collect()
}

impl Node {
    /// The value of a key of a map; the last one if the key is repeated.
    pub fn get(&self, key: &str) -> Option<&Entry> {
        match &self.value {
            Value::Map(entries) => entries.iter().rev().find(|entry| entry.key == key),
            _ => None,
        }
    }

    /// Place of the value at a key path, or of the nearest enclosing key that is written, where a default holds.
    pub fn place_of(&self, key_path: &str) -> Place {
        let mut node = self;
        let mut place = if self.place.length == 0 { Place::START } else { self.place };
        for step in steps(key_path) {
            let next = match (&step, &node.value) {
                (Step::Key(key), Value::Map(_)) => node.get(key).map(|entry| (entry.place(), &entry.node)),
                (Step::Index(index), Value::Map(_)) => {
                    node.get(&index.to_string()).map(|entry| (entry.place(), &entry.node))
                }
                (Step::Index(index), Value::List(items)) => items.get(*index).map(|item| (item.place, item)),
                _ => None,
            };
            match next {
                Some(next) => (place, node) = next,
                None => break,
            }
        }
        place
    }

    /// Puts a value at a key path, making the maps on the way.
    ///
    /// # Errors
    /// A sentence, when the path leads through something that is no map, or past the end of a list.
    pub fn set(&mut self, key_path: &str, value: Node, key_place: Place) -> Result<(), String> {
        let mut node = self;
        for step in steps(key_path) {
            if node.value == Value::Null && matches!(step, Step::Key(_)) {
                *node = Node { value: Value::Map(Vec::new()), place: key_place };
            }
            node = match (step, &mut node.value) {
                (Step::Key(key), Value::Map(entries)) => entry_or_new(entries, key, key_place),
                (Step::Index(index), Value::Map(entries)) => entry_or_new(entries, &index.to_string(), key_place),
                (Step::Index(index), Value::List(items)) => {
                    let count = items.len();
                    items.get_mut(index).ok_or_else(|| match count {
                        0 => format!("there is no item {index}: the list is empty"),
                        _ => format!("there is no item {index}: items are counted from 0 to {}", count - 1),
                    })?
                }
                (Step::Key(key), Value::List(_)) => {
                    return Err(format!("`{key}` is no index of a list; write for example `lights[0]`"));
                }
                (Step::Key(key), _) => return Err(format!("`{key}` is inside a single value, which has no keys")),
                (Step::Index(index), _) => return Err(format!("there is no item {index}: no list is written here")),
            };
        }
        *node = value;
        Ok(())
    }
}

fn entry_or_new<'e>(entries: &'e mut Vec<Entry>, key: &str, key_place: Place) -> &'e mut Node {
    let index = entries.iter().rposition(|entry| entry.key == key).unwrap_or_else(|| {
        let node = Node { value: Value::Null, place: key_place };
        entries.push(Entry { key: key.into(), key_place, node });
        entries.len() - 1
    });
    &mut entries[index].node
}

#[cfg(test)]
mod tests {
    use super::*;

    fn position(line: u32, column: u32) -> Position {
        Position { line, column }
    }

    #[test]
    fn places_are_exact() {
        let tree = parse("a: 1\nb:\n  c: [1, -2.5]\n  ä: \"qü\"\nl:\n  - {x: 1}\n", 0).unwrap();
        assert_eq!(tree.place_of("a").position, position(1, 4));
        assert_eq!(tree.place_of("b.c[1]").position, position(3, 10));
        assert_eq!(tree.place_of("b.c[1]").length, 4);
        assert_eq!(tree.place_of("b.c").length, 9);
        assert_eq!(tree.place_of("b.ä").position, position(4, 6));
        assert_eq!(tree.place_of("b").position, position(2, 1));
        assert_eq!(tree.place_of("l.0.x").position, position(6, 9));
        assert_eq!(tree.place_of("b.missing.too").position, position(2, 1));
        assert_eq!(tree.place_of("nothing").position, position(1, 1));
    }

    #[test]
    fn an_alias_points_at_its_original() {
        let tree = parse("a: &r {p: 7}\nb: *r\nc: {<<: *r}\n", 0).unwrap();
        assert_eq!(tree.place_of("b.p").position, position(1, 11));
        assert_eq!(tree.place_of("c.p").position, position(1, 11));
    }

    #[test]
    fn hostile_files_are_refused_quickly() {
        let mut bomb = String::from("a0: &a0 [x,x,x,x,x,x,x,x,x]\n");
        for level in 1..12 {
            let aliases = vec![format!("*a{}", level - 1); 9].join(",");
            bomb += &format!("a{level}: &a{level} [{aliases}]\n");
        }
        let error = parse(&bomb, 0).unwrap_err();
        assert!(error.message.contains("more than"), "{error:?}");
        let nested = format!("{}{}", "[".repeat(100), "]".repeat(100));
        assert!(parse(&nested, 0).unwrap_err().message.contains("nested deeper"));
        assert!(parse(&"[".repeat(1_000_000), 0).is_err());
        assert!(parse(&"a:\n".repeat(1_000_000), 0).is_err());
        assert!(parse("a: &a [*a]", 0).unwrap_err().message.contains("itself"));
    }

    #[test]
    fn overrides_reach_into_the_tree() {
        let mut tree = parse("a: {b: 1}\nl: [1, 2]\nn:\n", 0).unwrap();
        let value = || parse("5", 1).unwrap();
        for path in ["a.b", "a.new", "l[1]", "n.x.y", "top"] {
            tree.set(path, value(), Place::START).unwrap();
            assert_eq!(tree.place_of(path).source_idx, 1, "{path}");
        }
        for path in ["l[2]", "l.x", "a.b.c", "top[0]"] {
            assert!(tree.set(path, value(), Place::START).is_err(), "{path}");
        }
    }
}
