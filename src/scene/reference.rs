//! The reference of all keys of a scene file, written from the schema, so that it cannot disagree with the program.

use crate::marked_schema;
use crate::schema::{alternatives, decimal, is_keyed, required, resolve, type_name};
use serde_json::{Map, Value as Json};

/// The source of the schema, for the one thing that the schema does not keep: the order of keys.
const SETTINGS_SOURCE: &str = concat!(
    include_str!("settings.rs"),
    include_str!("settings/shapes.rs"),
    include_str!("settings/materials.rs"),
    include_str!("settings/flow.rs"),
    include_str!("settings/smoke.rs"),
    include_str!("settings/lights.rs"),
    include_str!("settings/output.rs")
);

/// A Markdown section for each kind of map in a scene file, the file itself first: its keys with type, range, default,
/// unit and meaning.
pub fn reference_markdown() -> String {
    let root = marked_schema();
    let mut writer = Writer { root: &root, text: String::new(), seen: Vec::new() };
    writer.section("Settings", &root);
    writer.text
}

struct Writer<'s> {
    root: &'s Json,
    text: String,
    seen: Vec<&'s str>,
}

/// A description taken apart.
struct Meaning {
    text: String,
    default: Option<String>,
    unit: Option<String>,
}

impl<'s> Writer<'s> {
    fn line(&mut self, line: &str) {
        self.text.push_str(line);
        self.text.push('\n');
    }

    /// A section, and after it those of the maps that its keys hold.
    fn section(&mut self, name: &'s str, schema: &'s Json) {
        if self.seen.contains(&name) {
            return;
        }
        self.seen.push(name);
        let title = if name == "Settings" { "The file" } else { name };
        self.line(&format!("\n### {title}\n"));
        self.line(&schema["description"].as_str().unwrap_or_default().replace('\n', " "));
        self.line("");
        if let Some(choices) = alternatives(schema) {
            self.choices(choices);
        } else {
            self.table(name, schema);
        }
        let mut inner = Vec::new();
        references(schema, &mut inner);
        let position = |name: &str| SETTINGS_SOURCE.find(&format!(" {name} {{"));
        inner.sort_by_key(|name| position(name));
        for name in inner {
            self.section(name, &self.root["$defs"][name]);
        }
    }

    fn table(&mut self, name: &str, schema: &'s Json) {
        let Some(properties) = schema["properties"].as_object() else { return };
        self.line("| Key | Value | Default | Unit | Meaning |");
        self.line("|---|---|---|---|---|");
        for key in in_file_order(name, properties) {
            let member = &properties[key];
            let meaning = take_apart(member["description"].as_str().unwrap_or_default());
            let is_required = required(schema).any(|name| name == key);
            let default = match (meaning.default, is_required) {
                (Some(default), _) => default,
                (None, true) => "required".into(),
                (None, false) if member["default"].is_null() => "none".into(),
                (None, false) if is_reference(member) => "as below".into(),
                (None, false) => format!("`{}`", member["default"]),
            };
            let value = self.value(member);
            let unit = meaning.unit.unwrap_or_default();
            self.line(&format!("| `{key}` | {value} | {default} | {unit} | {} |", meaning.text));
        }
    }

    fn choices(&mut self, choices: &'s [Json]) {
        for choice in choices {
            let text = choice["description"].as_str().unwrap_or_default().replace('\n', " ");
            if let Some(name) = choice["const"].as_str() {
                self.line(&format!("- `{name}`: {text}"));
            } else if let Some(name) = required(choice).next() {
                let payload = &choice["properties"][name];
                if is_reference(payload) {
                    self.line(&format!("- `{name}:` {}. {text}", self.value(payload)));
                    continue;
                }
                self.line(&format!("- `{name}:` a map. {text}"));
                for (key, member) in payload["properties"].as_object().into_iter().flatten() {
                    let meaning = take_apart(member["description"].as_str().unwrap_or_default());
                    let unit = meaning.unit.map(|unit| format!(" [{unit}]")).unwrap_or_default();
                    let default = meaning.default.map(|d| format!(" Default {d}.")).unwrap_or_default();
                    let value = self.value(member);
                    self.line(&format!("  - `{key}`: {value}{unit}. {}{default}", meaning.text));
                }
            } else {
                self.line(&format!("- {}: {text}", self.value(choice)));
            }
        }
    }

    /// What may stand behind a key.
    fn value(&self, schema: &Json) -> String {
        let value = self.one_value(schema);
        if is_keyed(schema) { format!("{value}, [keyed](#values-over-time)") } else { value }
    }

    fn one_value(&self, schema: &Json) -> String {
        if let Some(name) = schema["$ref"].as_str().and_then(|r| r.strip_prefix("#/$defs/")) {
            return format!("[{name}](#{})", name.to_lowercase());
        }
        if let Some(choices) = alternatives(schema) {
            let choices = choices.iter().filter(|choice| choice["type"] != "null");
            return choices.map(|choice| self.one_value(choice)).collect::<Vec<_>>().join(" or ");
        }
        let items = &schema["items"];
        match type_name(schema) {
            "number" => format!("number{}", range(schema)),
            "integer" => format!("whole number{}", range(schema)),
            "string" => "text".into(),
            "boolean" => "`true` or `false`".into(),
            "array" => match schema["minItems"].as_u64() {
                Some(count) if schema["maxItems"].is_null() => {
                    format!("list of at least {count} {}", self.value(items))
                }
                Some(count) => {
                    format!("[{}]{}", vec!["number"; count as usize].join(", "), range(resolve(self.root, items)))
                }
                None => format!("list of {}", self.value(items)),
            },
            "object" => format!("map of names to {}", self.value(&schema["additionalProperties"])),
            _ => String::new(),
        }
    }
}

fn is_reference(schema: &Json) -> bool {
    schema["$ref"].is_string()
}

fn range(schema: &Json) -> String {
    let bound = |name: &str| schema[name].as_f64().map(decimal);
    match (bound("minimum"), bound("exclusiveMinimum"), bound("maximum")) {
        (Some(least), _, Some(most)) if least == most => format!(" {least}"),
        (Some(least), _, Some(most)) => format!(", {least} to {most}"),
        (Some(least), _, None) => format!(" ≥ {least}"),
        (_, Some(bound), _) => format!(" > {bound}"),
        (_, _, Some(most)) => format!(" ≤ {most}"),
        _ => String::new(),
    }
}

/// Names of the definitions that a schema refers to.
fn references<'s>(schema: &'s Json, names: &mut Vec<&'s str>) {
    match schema {
        Json::Object(members) => {
            for (key, member) in members {
                match (key.as_str(), member.as_str().and_then(|text| text.strip_prefix("#/$defs/"))) {
                    ("$defs", _) => {}
                    ("$ref", Some(name)) if !names.contains(&name) => names.push(name),
                    _ => references(member, names),
                }
            }
        }
        Json::Array(items) => items.iter().for_each(|item| references(item, names)),
        _ => {}
    }
}

/// Keys in the order in which `settings.rs` declares them.
fn in_file_order<'s>(name: &str, properties: &'s Map<String, Json>) -> Vec<&'s str> {
    let begin = SETTINGS_SOURCE.find(&format!("pub struct {name} {{")).unwrap_or(0);
    let declaration = &SETTINGS_SOURCE[begin..];
    let position = |key: &str| {
        let renamed = declaration.find(&format!("rename = \"{key}\""));
        declaration.find(&format!("\n    pub {key}:")).into_iter().chain(renamed).min()
    };
    let mut keys: Vec<&str> = properties.keys().map(String::as_str).collect();
    keys.sort_by_key(|key| position(key));
    keys
}

/// Separates the default and the unit from a description such as `Radius [m]. Default 1.`
fn take_apart(description: &str) -> Meaning {
    let mut text = description.replace('\n', " ").replace('|', "\\|");
    let mut default = None;
    if let Some(begin) = text.find("Default ") {
        let rest = &text[begin + "Default ".len()..];
        let end = rest.find(". ").unwrap_or(rest.trim_end_matches('.').len());
        default = Some(rest[..end].to_owned());
        let after = rest[end..].trim_start_matches(['.', ' ']).to_owned();
        text = format!("{}{after}", &text[..begin]).trim().to_owned();
    }
    let mut unit = None;
    if let Some((begin, end)) = text.find(" [").and_then(|begin| Some((begin, begin + text[begin..].find(']')?))) {
        unit = Some(text[begin + 2..end].to_owned());
        text.replace_range(begin..=end, "");
    }
    Meaning { text, default, unit }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn descriptions_come_apart() {
        let meaning = take_apart("Angle between edges [degrees]. Default 35. More.");
        assert_eq!(meaning.text, "Angle between edges. More.");
        assert_eq!(meaning.default.as_deref(), Some("35"));
        assert_eq!(meaning.unit.as_deref(), Some("degrees"));
        let meaning = take_apart("Reach [m]. Default 1.5 voxels.");
        assert_eq!((meaning.text.as_str(), meaning.default.as_deref()), ("Reach.", Some("1.5 voxels")));
    }

    /// A documented default that is a plain value is the true one.
    #[test]
    fn documented_defaults_are_true() {
        fn visit(schema: &Json, path: &str, checked: &mut usize) {
            if let (Some(text), default) = (schema["description"].as_str(), &schema["default"])
                && let Some(documented) = take_apart(text).default
            {
                let plain: String = documented.chars().take_while(|c| !matches!(c, ':' | ';')).collect();
                let documented: Option<Json> = serde_yaml::from_str(&plain).ok();
                let is_plain = documented.as_ref().is_some_and(|v| v.is_number() || v.is_boolean() || v.is_array());
                if is_plain && !default.is_null() {
                    let same = match (documented.and_then(|v| v.as_f64()), default.as_f64()) {
                        (Some(a), Some(b)) => a == b,
                        (None, None) => true,
                        _ => default.is_array() || default.is_object(),
                    };
                    assert!(same, "{path}: documented {plain}, is {default}");
                    *checked += 1;
                }
            }
            match schema {
                Json::Object(members) => members.iter().for_each(|(k, v)| visit(v, &format!("{path}/{k}"), checked)),
                Json::Array(items) => items.iter().for_each(|v| visit(v, path, checked)),
                _ => {}
            }
        }
        let mut checked = 0;
        visit(&marked_schema(), "", &mut checked);
        assert!(checked > 25, "only {checked} defaults are documented");
    }

    #[test]
    fn every_key_of_the_schema_is_there() {
        let text = reference_markdown();
        let schema = marked_schema();
        for (name, definition) in schema["$defs"].as_object().unwrap() {
            assert!(text.contains(&format!("\n### {name}\n")), "{name}");
            for key in definition["properties"].as_object().into_iter().flatten().map(|(key, _)| key) {
                assert!(text.contains(&format!("| `{key}` |")), "{name}.{key}");
            }
        }
    }
}
