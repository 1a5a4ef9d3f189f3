//! Units that people write behind numbers, and the number that a key wants instead.

use crate::schema::decimal;
use serde_json::Value as Json;
use std::f64::consts::PI;

/// How a unit is written, the unit of the keys that it can be turned into, and the factor.
const SPELLINGS: [(&str, &str, f64); 51] = [
    ("um", "m", 1e-6),
    ("µm", "m", 1e-6),
    ("mm", "m", 1e-3),
    ("cm", "m", 1e-2),
    ("dm", "m", 1e-1),
    ("m", "m", 1.0),
    ("km", "m", 1e3),
    ("in", "m", 0.0254),
    ("inch", "m", 0.0254),
    ("ft", "m", 0.3048),
    ("us", "s", 1e-6),
    ("µs", "s", 1e-6),
    ("ms", "s", 1e-3),
    ("s", "s", 1.0),
    ("sec", "s", 1.0),
    ("min", "s", 60.0),
    ("h", "s", 3600.0),
    ("°", "degrees", 1.0),
    ("deg", "degrees", 1.0),
    ("degree", "degrees", 1.0),
    ("degrees", "degrees", 1.0),
    ("rad", "degrees", 180.0 / PI),
    ("mm/s", "m/s", 1e-3),
    ("cm/s", "m/s", 1e-2),
    ("m/s", "m/s", 1.0),
    ("km/h", "m/s", 1.0 / 3.6),
    ("kmh", "m/s", 1.0 / 3.6),
    ("mph", "m/s", 0.44704),
    ("Hz", "1/s", 1.0),
    ("/s", "1/s", 1.0),
    ("1/s", "1/s", 1.0),
    ("rad/s", "rad/s", 1.0),
    ("°/s", "rad/s", PI / 180.0),
    ("deg/s", "rad/s", PI / 180.0),
    ("rpm", "rad/s", PI / 30.0),
    ("/cm", "1/m", 1e2),
    ("1/cm", "1/m", 1e2),
    ("/m", "1/m", 1.0),
    ("1/m", "1/m", 1.0),
    ("px", "pixels", 1.0),
    ("pixel", "pixels", 1.0),
    ("pixels", "pixels", 1.0),
    ("M", "GiB", 1.0 / 1024.0),
    ("MB", "GiB", 1.0 / 1024.0),
    ("MiB", "GiB", 1.0 / 1024.0),
    ("G", "GiB", 1.0),
    ("GB", "GiB", 1.0),
    ("GiB", "GiB", 1.0),
    ("T", "GiB", 1024.0),
    ("TB", "GiB", 1024.0),
    ("TiB", "GiB", 1024.0),
];

/// The unit that a key's description gives in brackets: `Radius [m].` Lists of numbers in brackets are none.
pub fn unit_of(schema: &Json) -> Option<&str> {
    let parts = schema["description"].as_str()?.split('[').skip(1).filter_map(|rest| rest.split(']').next());
    let mut units = parts.filter(|part| part.chars().any(char::is_alphabetic));
    units.next()
}

/// What to write instead of a text that may be a number with a unit, for a key in `unit`; `is_share` where it goes from
/// 0 to 1 and has none. Never a number that would mean something else; `None` where there is no number in front.
pub fn advice(text: &str, unit: Option<&str>, is_share: bool) -> Option<String> {
    let text = text.trim();
    // From the longest, so that the `e` of 1e3 is not taken for a unit.
    let ends = (1..text.len()).rev().filter(|end| text.is_char_boundary(*end));
    let numbers = ends.filter_map(|end| Some((text[..end].trim_end().parse::<f64>().ok()?, text[end..].trim())));
    let (number, written) = numbers.into_iter().find(|(number, _)| number.is_finite())?;
    let factor = match unit {
        Some(unit) => SPELLINGS.iter().find(|(name, of, _)| *name == written && *of == unit).map(|(.., f)| *f),
        None => (is_share && written == "%").then_some(0.01),
    };
    Some(match (factor, unit) {
        (Some(factor), Some(unit)) => {
            format!("write `{}`; the unit of this key is always {unit}", tidy(number * factor))
        }
        (Some(factor), None) => format!("write `{}`; this key goes from 0 to 1", tidy(number * factor)),
        (None, Some(unit)) => format!("write a number alone; the unit of this key is always {unit}"),
        (None, None) => "write a number alone, without a unit".into(),
    })
}

/// A number without the digits that conversion made up.
pub fn tidy(value: f64) -> String {
    // A number that was just printed can be read.
    decimal(format!("{value:.9e}").parse().unwrap_or(value))
}

/// Linear Rec. 709 of a colour as pages of the web write it, `#e6e6e6`, in YAML.
pub fn linear_of_hex(text: &str) -> Option<String> {
    let digits = text.trim().strip_prefix('#')?;
    if digits.len() != 6 || !digits.bytes().all(|b| b.is_ascii_hexdigit()) {
        return None;
    }
    let channel = |i: usize| u8::from_str_radix(&digits[i..i + 2], 16).ok().map(linear);
    Some(format!("[{:.3}, {:.3}, {:.3}]", channel(0)?, channel(2)?, channel(4)?))
}

/// Light of an 8-bit value of a screen, by the transfer curve of sRGB.
fn linear(value: u8) -> f64 {
    let v = f64::from(value) / 255.0;
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// What to write instead of a number above 1 for a key from 0 to 1, where it was likely meant in percent or to 255.
pub fn advice_for_share(value: f64) -> Option<String> {
    match value {
        _ if value <= 1.0 || value > 255.0 => None,
        _ if value <= 100.0 => {
            Some(format!("1 is all of it, not 100 or 255: {} % is `{}`", decimal(value), tidy(0.01 * value)))
        }
        _ => Some(format!(
            "1 is all of it, not 255: {} of a screen is `{:.3}` in linear light",
            value.round(),
            linear(value.round() as u8)
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn units_become_those_of_the_key_or_no_number_is_named() {
        for (text, unit, number) in [
            ("20cm", "m", "0.2"),
            ("25 mm", "m", "0.025"),
            ("1e3mm", "m", "1"),
            ("35cm", "m", "0.35"),
            ("2km", "m", "2000"),
            ("500ms", "s", "0.5"),
            ("35°", "degrees", "35"),
            ("-36km/h", "m/s", "-10"),
            ("512 MiB", "GiB", "0.5"),
        ] {
            let advice = advice(text, Some(unit), false).unwrap();
            assert!(advice.starts_with(&format!("write `{number}`;")) && advice.ends_with(unit), "{text}: {advice}");
        }
        for (text, unit) in [("3s", Some("m")), ("3 parsec", Some("m")), ("24fps", None), ("50%", None)] {
            assert!(advice(text, unit, false).unwrap().starts_with("write a number alone"), "{text}");
        }
        assert!(advice("50%", None, true).unwrap().contains("`0.5`"));
        for text in ["", "many", "m", "°", "1,5"] {
            assert!(!advice(text, Some("m"), false).is_some_and(|a| a.contains('`')), "{text}");
        }
    }

    #[test]
    fn descriptions_name_units() {
        let unit = |text: &str| unit_of(&json!({ "description": text })).map(str::to_owned);
        assert_eq!(unit("Radius [m]. Default 1.").as_deref(), Some("m"));
        assert_eq!(unit("Which way is up. Default [0, 1, 0]."), None);
        assert_eq!(unit("How far [m]. Default [0, 1, 0].").as_deref(), Some("m"));
    }

    #[test]
    fn colours_of_screens_become_linear() {
        assert_eq!(linear_of_hex("#ff8000").as_deref(), Some("[1.000, 0.216, 0.000]"));
        for text in ["", "#fff", "ffffff", "#gggggg", "#ä1234"] {
            assert_eq!(linear_of_hex(text), None, "{text}");
        }
        assert!(advice_for_share(90.0).unwrap().contains("`0.9`"));
        assert!(advice_for_share(255.0).unwrap().contains("`1.000`"));
        assert_eq!((advice_for_share(0.5), advice_for_share(1e4)), (None, None));
    }
}
