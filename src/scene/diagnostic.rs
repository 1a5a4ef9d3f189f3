//! What is wrong with a scene, where, and what would be right.
//!
//! A diagnostic prints the way compilers do: place, message, the line itself with a caret under the exact value, and
//! help. It is plain data too, for editors and programs.

use serde::Serialize;
use std::fmt;

/// Problems after which collecting stops: nobody reads more, and a hostile file can hold millions.
const COUNT_MAX: usize = 200;
/// Characters of a long line that are shown on each side of the caret.
const EXCERPT_RADIUS: usize = 60;

/// A line and column of a scene file, both from 1; columns count characters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Position {
    /// Line, from 1.
    pub line: u32,
    /// Column, from 1, in characters.
    pub column: u32,
}

/// A stretch of one of the sources of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// Which source: 0 is the file, the rest are overrides in order.
    pub source_idx: usize,
    /// Where it begins.
    pub position: Position,
    /// Its length in characters; 0 for maps and lists in block style.
    pub length: usize,
}

impl Place {
    /// The first character of the file.
    pub const START: Self = Self { source_idx: 0, position: Position { line: 1, column: 1 }, length: 0 };
}

/// A text that settings come from.
#[derive(Debug, Clone)]
pub struct Source {
    /// Name of the file, or of the flag.
    pub name: String,
    /// The text.
    pub text: String,
    /// Whether the text is a flag of the command line rather than a file.
    pub is_flag: bool,
}

/// Whether a diagnostic stops the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Nothing is rendered.
    Error,
    /// Likely a mistake, but well defined.
    Warning,
}

/// What sort of fault it is; decides the exit code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// The scene says something that it cannot.
    Invalid,
    /// A file that the scene names is not there.
    MissingFile,
    /// The scene needs more memory than it allows.
    OverMemoryLimit,
}

/// One problem of a scene.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Diagnostic {
    /// Whether it stops the program.
    pub severity: Severity,
    /// What sort of fault it is.
    pub fault: Fault,
    /// Name of the file, or of the flag for an override.
    pub file: String,
    /// Where in the file; absent for an override.
    pub position: Option<Position>,
    /// Length of the faulty text in characters, at least 1.
    pub length: usize,
    /// Path of the key, for example `lights[0].sun.direction`; empty for the whole file.
    pub key: String,
    /// What was found and what is allowed.
    pub message: String,
    /// The line of the source, cut on both sides if very long.
    pub excerpt: String,
    /// Characters of `excerpt` before the faulty text.
    pub caret: usize,
    /// Ways out.
    pub help: Vec<String>,
}

impl Diagnostic {
    /// Adds a way out.
    pub fn help(&mut self, text: impl Into<String>) -> &mut Self {
        self.help.push(text.into());
        self
    }

    /// Changes the sort of fault.
    pub fn fault(&mut self, fault: Fault) -> &mut Self {
        self.fault = fault;
        self
    }
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let severity = match self.severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
        };
        write!(f, "{}", self.file)?;
        if let Some(Position { line, column }) = self.position {
            write!(f, ":{line}:{column}")?;
        }
        write!(f, ": {severity}: {}", self.message)?;
        let number = self.position.map(|p| p.line.to_string()).unwrap_or_default();
        let margin = " ".repeat(number.len());
        if !self.excerpt.trim().is_empty() {
            let carets = "^".repeat(self.length.min(self.excerpt.chars().count().saturating_sub(self.caret)).max(1));
            let indent = " ".repeat(self.caret);
            write!(f, "\n{margin} |\n{number} | {}\n{margin} | {indent}{carets}", self.excerpt)?;
            if !self.key.is_empty() {
                write!(f, " {}", self.key)?;
            }
        } else if !self.key.is_empty() {
            write!(f, "\n{margin} = key: {}", self.key)?;
        }
        for help in &self.help {
            write!(f, "\n{margin} = help: {help}")?;
        }
        Ok(())
    }
}

/// Gathers problems, so that all of them are reported together.
#[derive(Debug)]
pub struct Collector<'a> {
    sources: &'a [Source],
    found: Vec<(Place, Diagnostic)>,
    /// Takes what comes after the limit.
    overflow: Option<Box<Diagnostic>>,
}

impl<'a> Collector<'a> {
    /// Nothing found yet.
    pub fn new(sources: &'a [Source]) -> Self {
        Self { sources, found: Vec::new(), overflow: None }
    }

    /// Adds an error; the caller may add help.
    pub fn error(&mut self, place: Place, key: &str, message: impl Into<String>) -> &mut Diagnostic {
        self.add(Severity::Error, place, key, message.into())
    }

    /// Adds a warning; the caller may add help.
    pub fn warning(&mut self, place: Place, key: &str, message: impl Into<String>) -> &mut Diagnostic {
        self.add(Severity::Warning, place, key, message.into())
    }

    /// Adds a way out of the problem that was added last.
    pub fn help_latest(&mut self, text: impl Into<String>) {
        let latest = self.overflow.as_deref_mut().or_else(|| self.found.last_mut().map(|(_, diagnostic)| diagnostic));
        if let Some(diagnostic) = latest {
            diagnostic.help(text);
        }
    }

    /// Number of problems so far.
    pub fn count(&self) -> usize {
        self.found.len()
    }

    /// Whether there is room for more.
    pub fn is_full(&self) -> bool {
        self.found.len() >= COUNT_MAX
    }

    /// All problems in the order of their places.
    pub fn finish(mut self) -> Vec<Diagnostic> {
        self.found.sort_by_key(|(place, _)| *place);
        let mut all: Vec<_> = self.found.into_iter().map(|(_, diagnostic)| diagnostic).collect();
        if self.overflow.is_some()
            && let Some(last) = all.last_mut()
        {
            last.help(format!("more problems follow; only the first {COUNT_MAX} are shown"));
        }
        all
    }

    fn add(&mut self, severity: Severity, place: Place, key: &str, message: String) -> &mut Diagnostic {
        let source = &self.sources[place.source_idx.min(self.sources.len() - 1)];
        // Of thousands of errors in a long file only the first are shown, and finding a line takes time.
        let (excerpt, caret) = if self.is_full() { Default::default() } else { excerpt(&source.text, place.position) };
        let diagnostic = Diagnostic {
            severity,
            fault: Fault::Invalid,
            file: source.name.clone(),
            position: (!source.is_flag).then_some(place.position),
            length: place.length.max(1),
            key: key.into(),
            message,
            excerpt,
            caret,
            help: Vec::new(),
        };
        if self.is_full() {
            return self.overflow.insert(Box::new(diagnostic));
        }
        self.found.push((place, diagnostic));
        let last = self.found.len() - 1;
        &mut self.found[last].1
    }
}

/// The line of a text and the characters before the caret; a long line is cut round the caret.
fn excerpt(text: &str, position: Position) -> (String, usize) {
    let line = text.lines().nth(position.line.saturating_sub(1) as usize).unwrap_or_default();
    let caret = position.column.saturating_sub(1) as usize;
    let skipped = caret.saturating_sub(EXCERPT_RADIUS);
    let skipped = if line.chars().count() <= 2 * EXCERPT_RADIUS { 0 } else { skipped };
    // Control characters would move the caret, or the terminal.
    let shown = line.chars().skip(skipped).take(2 * EXCERPT_RADIUS);
    (shown.map(|c| if c.is_control() { ' ' } else { c }).collect(), caret - skipped)
}

/// The known name that was most likely meant, if one is near.
pub fn nearest<'n>(typed: &str, known: impl IntoIterator<Item = &'n str>) -> Option<&'n str> {
    let plain = |name: &str| name.to_lowercase().replace('-', "_");
    let typed = plain(&typed.chars().take(64).collect::<String>());
    let score = |name: &str| {
        let name = plain(name);
        let distance = strsim::damerau_levenshtein(&typed, &name);
        // `fov` means `vertical_fov_deg`, although most letters are missing.
        let is_part = typed.len() >= 3 && name.len() >= 3 && (name.contains(&typed) || typed.contains(&name));
        (distance <= typed.chars().count().div_ceil(3)).then_some(distance).or(is_part.then_some(100 + distance))
    };
    known.into_iter().filter_map(|name| Some((score(name)?, name))).min().map(|(_, name)| name)
}

/// Names as a readable list: `a`, `b`, `c`.
pub fn listed<'n>(names: impl IntoIterator<Item = &'n str>) -> String {
    names.into_iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prints_like_a_compiler() {
        let sources = [Source { name: "s.yaml".into(), text: "a: 1\nfilm:\n  spp: -3\n".into(), is_flag: false }];
        let mut collector = Collector::new(&sources);
        let place = Place { source_idx: 0, position: Position { line: 3, column: 8 }, length: 2 };
        collector.error(place, "film.spp", "must be at least 1, found -3").help("write a positive number");
        let printed = collector.finish()[0].to_string();
        assert_eq!(
            printed,
            "s.yaml:3:8: error: must be at least 1, found -3\n  |\n3 |   spp: -3\n  |        ^^ film.spp\n  = help: write a \
             positive number"
        );
    }

    #[test]
    fn the_nearest_name() {
        let known = ["position", "look_at", "up", "vertical_fov_deg"];
        assert_eq!(nearest("positon", known), Some("position"));
        assert_eq!(nearest("lookat", known), Some("look_at"));
        assert_eq!(nearest("Look-At", known), Some("look_at"));
        assert_eq!(nearest("fov", known), Some("vertical_fov_deg"));
        assert_eq!(nearest("banana", known), None);
    }

    #[test]
    fn long_lines_and_many_problems_are_cut() {
        let text = "x".repeat(100_000);
        let sources = [Source { name: "s".into(), text, is_flag: false }];
        let mut collector = Collector::new(&sources);
        for column in 1..=1000 {
            collector.error(Place { source_idx: 0, position: Position { line: 1, column }, length: 1 }, "k", "m");
        }
        let all = collector.finish();
        assert_eq!(all.len(), COUNT_MAX);
        assert!(all.iter().all(|d| d.excerpt.len() <= 2 * EXCERPT_RADIUS && d.caret <= EXCERPT_RADIUS.max(d.caret)));
        assert_eq!(all[199].excerpt.chars().count(), 120);
    }
}
