//! What a schema cannot say about suites of image tests.

use crate::diagnostic::{Collector, listed};
use crate::schema::decimal;
use crate::suite::{Case, Check, OUTPUT_PLACEHOLDER, SEED_PLACEHOLDER, SuiteSettings, parse_override};
use crate::tree::Node;

/// Checks a suite that fits the schema; all problems are collected.
pub(crate) fn validate_suite(settings: &SuiteSettings, tree: &Node, collector: &mut Collector<'_>) {
    Validation { settings, tree, collector }.run();
}

/// The checks under way.
struct Validation<'s, 'c, 'a> {
    settings: &'s SuiteSettings,
    tree: &'s Node,
    collector: &'c mut Collector<'a>,
}

impl Validation<'_, '_, '_> {
    fn error(&mut self, key: &str, message: impl Into<String>, help: impl Into<String>) {
        self.collector.error(self.tree.place_of(key), key, message).help(help);
    }

    fn run(&mut self) {
        if self.settings.cases.is_empty() {
            self.error("cases", "there are no cases", "name one, with a `scene` or an `image`");
        }
        let log = self.settings.log.to_ascii_lowercase();
        if !log.ends_with(".md") && !log.ends_with(".txt") {
            self.error("log", "the log must be a .md or .txt file", "for example `log: references.md`");
        }
        let defaults = &self.settings.defaults;
        self.checks("defaults", defaults.compare.as_deref(), defaults.ignore.as_deref());
        self.overrides("defaults", &defaults.set);
        if let Some(reference) = &defaults.reference {
            self.exr("defaults.reference", reference);
        }
        for (name, case) in &self.settings.cases {
            self.case(name, case);
        }
    }

    fn case(&mut self, name: &str, case: &Case) {
        let key = format!("cases.{name}");
        let is_plain = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
        if !is_plain || name.is_empty() || name.len() > 64 {
            let place = self.tree.get("cases").and_then(|cases| cases.node.get(name)).map(|entry| entry.key_place);
            let place = place.unwrap_or_else(|| self.tree.place_of("cases"));
            self.collector.error(place, &key, "a name has 1 to 64 letters, digits, `_` and `-`");
            return;
        }
        let sources = [("scene", &case.scene), ("image", &case.image), ("command", &case.command)];
        let given: Vec<&str> = sources.iter().filter(|(_, s)| s.is_some()).map(|(name, _)| *name).collect();
        if given.len() != 1 {
            let found = if given.is_empty() { "none".into() } else { listed(given.iter().copied()) };
            let message = format!("exactly one of `scene`, `image` and `command` is needed, found {found}");
            self.error(&key, message, "`scene` renders here, the others are for pictures of other programs");
        }
        if case.scene.is_none() {
            let frame = case.frame.is_some();
            let spp = case.spp.is_some();
            let of_scenes = [("set", !case.set.is_empty()), ("frame", frame), ("spp", spp)];
            for (member, _) in of_scenes.iter().filter(|(_, is_given)| *is_given) {
                let message = format!("`{member}` is for cases with a `scene`");
                self.error(&format!("{key}.{member}"), message, "remove it; the other program decides");
            }
        }
        if let Some(command) = &case.command
            && !command.contains(OUTPUT_PLACEHOLDER)
        {
            let message = format!("the command does not say `{OUTPUT_PLACEHOLDER}`, the file that it shall write");
            self.error(&format!("{key}.command"), message, format!("for example `render -o {OUTPUT_PLACEHOLDER}`"));
        }
        for (member, file) in [("reference", &case.reference), ("variance", &case.variance)] {
            if let Some(file) = file {
                self.exr(&format!("{key}.{member}"), file);
            }
        }
        self.overrides(&key, &case.set);
        self.checks(&key, case.compare.as_deref(), case.ignore.as_deref());
        self.seeds(name, case);
    }

    /// A reference of the test's own random numbers would agree with it whatever noise both have.
    fn seeds(&mut self, name: &str, case: &Case) {
        let whole = self.settings.whole(name, case);
        let (Some(seed), Some(remake)) = (whole.seed, whole.remake) else { return };
        let key = format!("cases.{name}");
        if seed.checked_sub(remake.seed).is_some_and(|ahead| ahead < u64::from(remake.runs)) {
            let message = format!("the seed of the test, {seed}, is one of the reference's, from {} on", remake.seed);
            self.error(&format!("{key}.seed"), message, "take another: two measurements must be independent");
        }
        if remake.seed.checked_add(u64::from(remake.runs)).is_none() {
            self.error(&format!("{key}.remake.seed"), "the seeds of the runs do not fit", "take a smaller one");
        }
        let command = case.command.as_deref().unwrap_or(SEED_PLACEHOLDER);
        if remake.runs > 1 && (case.image.is_some() || !command.contains(SEED_PLACEHOLDER)) && !case.should_fail {
            let message = format!("{} runs need pictures of other seeds", remake.runs);
            let help = format!("write `{SEED_PLACEHOLDER}` in a `command`, or set `remake: {{runs: 1}}` here");
            self.error(&format!("{key}.remake"), message, help);
        }
    }

    fn exr(&mut self, key: &str, file: &str) {
        if !file.to_ascii_lowercase().ends_with(".exr") {
            self.error(key, format!("`{file}` is no .exr file"), "references hold light in .exr files");
        }
    }

    fn overrides(&mut self, key: &str, set: &[String]) {
        for (i, text) in set.iter().enumerate() {
            if parse_override(text).is_none() {
                let message = format!("`{text}` sets nothing");
                self.error(&format!("{key}.set[{i}]"), message, "write key=value, as in film.spp=64");
            }
        }
    }

    fn checks(&mut self, key: &str, checks: Option<&[Check]>, ignored: Option<&[String]>) {
        let Some(checks) = checks else { return };
        if checks.is_empty() {
            self.error(&format!("{key}.compare"), "nothing is compared", "name a check, as `- stat: {}`");
        }
        let mut seen: Vec<(&str, &str)> = Vec::new();
        let all = [String::new()];
        for (i, check) in checks.iter().enumerate() {
            let layers = if check.layers().is_empty() { &all[..] } else { check.layers() };
            for layer in layers {
                if seen.contains(&(check.name(), layer.as_str())) {
                    let message = format!("`{}` is given already for these layers", check.name());
                    self.error(&format!("{key}.compare[{i}]"), message, "remove one of them");
                }
                seen.push((check.name(), layer));
                if ignored.is_some_and(|ignored| ignored.contains(layer)) {
                    let message = format!("the layer `{layer}` is both compared and ignored");
                    self.error(&format!("{key}.compare[{i}]"), message, "remove it from `layers` or from `ignore`");
                }
                // What everybody calls it first.
                if ["rgb", "RGB", "color", "colour", "RGBA", "rgba"].contains(&layer.as_str()) {
                    let message = format!("there is no layer `{layer}`");
                    self.error(&format!("{key}.compare[{i}]"), message, "the colours R, G and B are `beauty`");
                }
            }
            if let Check::Mse(limit) | Check::Relmse(limit) | Check::Max(limit) = check
                && limit.at_most == 0.0
            {
                let message = format!("`at_most: {}` lets nothing but equal pictures pass", decimal(0.0));
                let key = format!("{key}.compare[{i}].{}.at_most", check.name());
                self.collector.warning(self.tree.place_of(&key), &key, message).help("write `exact: {}`");
            }
        }
    }
}
