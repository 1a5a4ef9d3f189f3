//! Settings with several values, as people type them after `--vary`.

use std::str::FromStr;

/// Most values of a setting.
const VALUES_MAX: usize = 1000;
/// Values between the ends of a range are rounded to so many digits of the step to the one before; its ends are as they were typed.
const DIGITS: i32 = 6;

/// A setting and its values as typed: `smoke.medium.extinction=5,20,80`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Vary {
    /// Where the setting is in the scene.
    pub key: String,
    /// Its values in YAML, each once and at least one.
    pub values: Vec<String>,
}

impl FromStr for Vary {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let help = "write key=values, as in smoke.medium.extinction=5,20,80 or smoke.medium.extinction=5..80:4";
        let (key, list) = text.split_once('=').ok_or_else(|| format!("`{text}` varies nothing; {help}"))?;
        let key = key.trim();
        if key.is_empty() {
            return Err(format!("`{text}` names no key; {help}"));
        }
        let mut values: Vec<String> = Vec::new();
        for item in items(list) {
            if item.is_empty() {
                return Err(format!("{key}: a value is missing in `{list}`; {help}"));
            }
            for value in expanded(item).map_err(|problem| format!("{key}: `{item}`: {problem}"))? {
                if values.contains(&value) {
                    return Err(format!("{key}: the value {value} is there twice; leave one out"));
                }
                values.push(value);
            }
            if values.len() > VALUES_MAX {
                return Err(format!("{key}: more than {VALUES_MAX} values; take fewer"));
            }
        }
        Ok(Self { key: key.into(), values })
    }
}

/// What stands between commas that are in no bracket and no quotes.
fn items(list: &str) -> Vec<&str> {
    let (mut items, mut start, mut depth, mut quote) = (Vec::new(), 0, 0_u32, None);
    for (at, c) in list.char_indices() {
        match (quote, c) {
            (Some(open), c) if c == open => quote = None,
            (Some(_), _) => {}
            (None, '"' | '\'') => quote = Some(c),
            (None, '[' | '{') => depth += 1,
            (None, ']' | '}') => depth = depth.saturating_sub(1),
            (None, ',') if depth == 0 => {
                items.push(list[start..at].trim());
                start = at + 1;
            }
            _ => {}
        }
    }
    items.push(list[start..].trim());
    items
}

/// The values of `1..4`, `0..0.6:4` and `1..100:3:log`; of anything else the thing itself, such as a path with `..` in it.
fn expanded(item: &str) -> Result<Vec<String>, String> {
    let range = item.split_once("..").and_then(|(first, rest)| {
        let (last, how) = rest.split_once(':').map_or((rest, None), |(last, how)| (last, Some(how)));
        Some(([number(first)?, number(last)?], [first.trim(), last.trim()], how))
    });
    let Some(([a, b], ends, how)) = range else { return Ok(vec![item.into()]) };
    let whole = a.fract() == 0.0 && b.fract() == 0.0;
    let (count, is_log) = match how.map(|how| how.split_once(':').unwrap_or((how, ""))) {
        None if whole && (b - a).abs() < VALUES_MAX as f64 => ((b - a).abs() as usize + 1, false),
        None if whole => return Err(format!("more than {VALUES_MAX} values; say how many, as in {item}:5")),
        None => return Err(format!("say how many values, as in {item}:5")),
        Some((count, spacing)) => {
            let count = count.trim().parse().ok().filter(|count| (2..=VALUES_MAX).contains(count));
            let count = count.ok_or_else(|| format!("after the colon stands how many values, 2 to {VALUES_MAX}"))?;
            match spacing.trim() {
                "" | "lin" => (count, false),
                "log" if a > 0.0 && b > 0.0 => (count, true),
                "log" => return Err("equal ratios need two numbers above 0".into()),
                other => return Err(format!("`{other}` is no spacing; write lin or log, as in 1..100:3:log")),
            }
        }
    };
    let span = if is_log { b / a } else { b - a };
    if !(span.is_finite() && (span > 0.0 || !is_log)) {
        return Err("the ends are too far apart".into());
    }
    let parts = (count - 1).max(1) as f64;
    let ratio = (b / a).powf(1.0 / parts);
    let value = |i: usize| match i {
        0 => ends[0].into(),
        _ if i == count - 1 => ends[1].into(),
        _ if is_log => {
            let x = a * (b / a).powf(i as f64 / parts);
            rounded(x, x * (1.0 - ratio.min(1.0 / ratio)))
        }
        _ => match a + (b - a) * i as f64 / parts {
            x if whole && x.fract() == 0.0 => x.to_string(),
            x => rounded(x, (b - a) / parts),
        },
    };
    let values: Vec<String> = (0..count).map(value).collect();
    // Numbers have so many digits and no more.
    let is_step = |pair: &[String]| match (number(&pair[0]), number(&pair[1])) {
        (Some(x), Some(y)) => {
            if a < b {
                x < y
            } else {
                y < x
            }
        }
        _ => false,
    };
    if !values.windows(2).all(is_step) {
        return Err("the steps are too fine: some of the values are the same; take fewer, or ends further apart".into());
    }
    Ok(values)
}

fn number(text: &str) -> Option<f64> {
    text.trim().parse::<f64>().ok().filter(|x| x.is_finite())
}

/// A number to [`DIGITS`] digits of `step`; 0 where it has none of them.
fn rounded(x: f64, step: f64) -> String {
    /// Digits that tell all numbers apart.
    const ALL: i32 = 17;
    let order = |x: f64| x.abs().log10().floor() as i32;
    let digits = DIGITS.saturating_add(order(x).saturating_sub(order(step))).min(ALL);
    if digits < 1 {
        return "0".into();
    }
    // What was written as a number is one.
    format!("{x:.*e}", digits as usize - 1).parse::<f64>().unwrap_or(x).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(text: &str) -> Vec<String> {
        format!("a.b={text}").parse::<Vary>().unwrap_or_else(|e| panic!("{e}")).values
    }

    #[test]
    fn lists_split_at_commas_outside_of_brackets() {
        assert_eq!(values("5, 20 ,80"), ["5", "20", "80"]);
        assert_eq!(values("[1, 2],{a: [3, 4], b: 5}"), ["[1, 2]", "{a: [3, 4], b: 5}"]);
        assert_eq!(values("'a,b',\"c]\",d"), ["'a,b'", "\"c]\"", "d"]);
        assert_eq!(values("../sky.exr,a..b"), ["../sky.exr", "a..b"]);
    }

    #[test]
    fn ranges_are_even_geometric_or_of_whole_numbers() {
        assert_eq!(values("-0.3..0.6:4"), ["-0.3", "0", "0.3", "0.6"]);
        assert_eq!(values("0.6..0:3"), ["0.6", "0.3", "0"]);
        assert_eq!(values("5..80:3:log"), ["5", "20", "80"]);
        assert_eq!(values("1..2:3:lin"), ["1", "1.5", "2"]);
        assert_eq!(values("1..4"), ["1", "2", "3", "4"]);
        assert_eq!(values("2..0"), ["2", "1", "0"]);
        assert_eq!(values("0,1..100:3:log"), ["0", "1", "10", "100"]);
        assert_eq!(values("0..1:4"), ["0", "0.333333", "0.666667", "1"]);
        assert_eq!(values("7..7"), ["7"]);
    }

    #[test]
    fn fine_steps_far_from_zero_stay_in_their_range() {
        assert_eq!(values("1000001..1000003:3"), ["1000001", "1000002", "1000003"]);
        assert_eq!(values("40..40.0001:5"), ["40", "40.000025", "40.00005", "40.000075", "40.0001"]);
        assert_eq!(values("1000001..5000000001:3")[1], "2500500001");
        assert_eq!(values("0..1000000000:4")[1], "333333000");
        assert_eq!(values("1000000..1000002:3:log")[1], "1000001");
        for text in ["-40.0001..-40:7", "40.0001..40:7", "1e-9..2e-9:9:log", "1000003..1000001:900:log", "1e9..1e9:2"] {
            let parsed = format!("a.b={text}").parse::<Vary>();
            let Ok(Vary { values, .. }) = parsed else {
                assert!(text == "1e9..1e9:2" && parsed.unwrap_err().contains("too fine"), "{text}");
                continue;
            };
            let numbers: Vec<f64> = values.iter().map(|value| value.parse().unwrap()).collect();
            let is_rising = numbers[0] < numbers[1];
            assert!(
                numbers.windows(2).all(|pair| pair[0] != pair[1] && (pair[0] < pair[1]) == is_rising),
                "{values:?}"
            );
        }
    }

    #[test]
    fn what_is_wrong_is_said_with_the_key() {
        let cases = [
            ("a.b", "varies nothing"),
            ("=1", "names no key"),
            ("a.b=", "missing"),
            ("a.b=1,,2", "missing"),
            ("a.b=1,2,1", "1 is there twice"),
            ("a.b=0..0.5", "how many"),
            ("a.b=0..1000000", "1000"),
            ("a.b=40..40.00000000000001:9", "too fine"),
            ("a.b=9007199254740993..9007199254740999", "too fine"),
            ("a.b=0..1:1", "2 to 1000"),
            ("a.b=0..1:x", "2 to 1000"),
            ("a.b=0..1:4:log", "above 0"),
            ("a.b=1e-200..1e200:3:log", "too far apart"),
            ("a.b=1e200..1e-200:3:log", "too far apart"),
            ("a.b=-1e308..1e308:3", "too far apart"),
            ("a.b=1..2:4:cubic", "`cubic`"),
        ];
        for (text, part) in cases {
            let error = text.parse::<Vary>().unwrap_err();
            assert!(error.contains(part) && (error.contains("a.b") || text == "=1"), "{text}: {error}");
        }
    }
}
