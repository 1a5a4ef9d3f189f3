//! Reads the JSON Schema that schemars makes of `settings.rs`: structs, externally tagged enums, options, lists, maps.

use crate::diagnostic::listed;
use crate::settings::keyed::MARK;
use serde_json::{Value as Json, json};

/// Where the schema keeps what a map of frames and values may hold besides.
pub const KEY_OPTIONS: &str = "x-keyed-options";

/// The alternatives of an enum.
pub struct Variants<'s> {
    /// Plain names.
    pub units: Vec<&'s str>,
    /// Names that are the single key of a map, with the schema of its value.
    pub maps: Vec<(&'s str, &'s Json)>,
    /// Alternatives without a name.
    pub others: Vec<&'s Json>,
}

/// Whether a value may be given for several frames.
pub fn is_keyed(schema: &Json) -> bool {
    let marked = |schema: &Json| schema[MARK].as_bool() == Some(true);
    marked(schema) || schema["anyOf"].as_array().is_some_and(|choices| choices.iter().any(marked))
}

/// Says in JSON Schema's own words what the mark of keyed values means: the value, or a map of frames and values.
pub fn spell_out_keys(schema: &mut Json, interpolation: &Json) {
    match schema {
        Json::Array(items) => items.iter_mut().for_each(|item| spell_out_keys(item, interpolation)),
        Json::Object(members) => {
            members.values_mut().for_each(|member| spell_out_keys(member, interpolation));
            if members.remove(MARK).is_some() {
                let mut outer = serde_json::Map::new();
                for name in ["description", "default"] {
                    outer.extend(members.remove(name).map(|value| (name.to_owned(), value)));
                }
                let value = Json::Object(std::mem::take(members));
                let map = json!({
                    "type": "object",
                    "properties": { "interpolation": interpolation, "repeat": { "type": "boolean" } },
                    "patternProperties": { r"^-?[0-9]+(\.[0-9]+)?$": value },
                    "additionalProperties": false,
                });
                outer.insert("anyOf".into(), json!([value, map]));
                *members = outer;
            }
        }
        _ => {}
    }
}

/// Follows a reference to the definitions.
pub fn resolve<'s>(root: &'s Json, schema: &'s Json) -> &'s Json {
    let reference = schema["$ref"].as_str().and_then(|r| r.strip_prefix('#'));
    reference.and_then(|pointer| root.pointer(pointer)).unwrap_or(schema)
}

/// The choices of an enum or an option.
pub fn alternatives(schema: &Json) -> Option<&Vec<Json>> {
    schema["oneOf"].as_array().or_else(|| schema["anyOf"].as_array())
}

/// Name of the type, `null` left aside.
pub fn type_name(schema: &Json) -> &str {
    match &schema["type"] {
        Json::String(name) => name,
        Json::Array(names) => names.iter().filter_map(Json::as_str).find(|name| *name != "null").unwrap_or(""),
        _ => "",
    }
}

/// Names of the keys that must be given.
pub fn required(schema: &Json) -> impl Iterator<Item = &str> {
    schema["required"].as_array().into_iter().flatten().filter_map(Json::as_str)
}

/// Whether a struct has a key that need not be given.
pub fn member_is_optional(schema: &Json, key: &str) -> bool {
    schema["properties"].get(key).is_some() && !required(schema).any(|name| name == key)
}

/// Takes the alternatives of an enum apart.
pub fn variants(schema: &Json) -> Variants<'_> {
    let mut variants = Variants { units: Vec::new(), maps: Vec::new(), others: Vec::new() };
    for choice in alternatives(schema).into_iter().flatten() {
        let names = choice["enum"].as_array().into_iter().flatten();
        let mut names: Vec<&str> = names.chain([&choice["const"]]).filter_map(Json::as_str).collect();
        if names.is_empty() {
            match required(choice).next() {
                Some(name) => variants.maps.push((name, &choice["properties"][name])),
                None => variants.others.push(choice),
            }
        }
        variants.units.append(&mut names);
    }
    variants
}

/// The least that a schema allows; `depth` is 0.
pub fn stand_in(root: &Json, schema: &Json, depth: usize) -> Json {
    let schema = resolve(root, schema);
    // The schema does not recurse; this only makes sure that a mistake there cannot hang the program.
    if depth > 16 {
        return Json::Null;
    }
    if let Some(choices) = alternatives(schema) {
        return choices.first().map_or(Json::Null, |choice| match choice["const"].as_str() {
            Some(name) => json!(name),
            None => stand_in(root, choice, depth + 1),
        });
    }
    match type_name(schema) {
        "object" => {
            let member = |key: &str| (key.to_owned(), stand_in(root, &schema["properties"][key], depth + 1));
            Json::Object(required(schema).map(member).collect())
        }
        "array" => {
            let count = schema["minItems"].as_u64().unwrap_or(0) as usize;
            Json::Array(vec![stand_in(root, &schema["items"], depth + 1); count])
        }
        "integer" => json!(schema["minimum"].as_i64().unwrap_or(0).max(1).min(schema["maximum"].as_i64().unwrap_or(1))),
        "number" => {
            let least = schema["minimum"].as_f64().unwrap_or(0.0);
            json!(schema["maximum"].as_f64().unwrap_or(1.0).min(1.0).max(least))
        }
        "string" => json!(""),
        "boolean" => json!(false),
        _ => Json::Null,
    }
}

/// In words what a schema allows.
pub fn expected(root: &Json, schema: &Json) -> String {
    let schema = resolve(root, schema);
    if alternatives(schema).is_some() {
        let variants = variants(schema);
        let mut words = Vec::new();
        if !variants.units.is_empty() {
            words.push(format!("one of {}", listed(variants.units.iter().copied())));
        }
        if !variants.maps.is_empty() {
            words.push(format!("a map with one key of {}", listed(variants.maps.iter().map(|v| v.0))));
        }
        words.extend(variants.others.iter().map(|other| expected(root, other)));
        return words.join(", or ");
    }
    match type_name(schema) {
        "object" => "a map of keys and values".into(),
        "array" => match (schema["minItems"].as_u64(), type_name(resolve(root, &schema["items"]))) {
            (Some(count), _) if schema["maxItems"].is_null() => format!("a list of at least {count}"),
            (Some(count), "integer") => format!("a list of {count} whole numbers"),
            (Some(count), _) => format!("a list of {count} numbers"),
            _ => "a list".into(),
        },
        "number" => "a number".into(),
        "integer" => "a whole number".into(),
        "string" => "text".into(),
        "boolean" => "`true` or `false`".into(),
        _ => "something else".into(),
    }
}

/// A number as people write it.
pub fn decimal(value: f64) -> String {
    if value != 0.0 && !(1e-4..1e9).contains(&value.abs()) { format!("{value:e}") } else { format!("{value}") }
}

/// First sentence of a description.
pub fn first_sentence(schema: &Json) -> Option<String> {
    let text = schema["description"].as_str()?.replace('\n', " ");
    let end = text.find(". ").map_or(text.len(), |end| end + 1);
    Some(text[..end].into())
}
