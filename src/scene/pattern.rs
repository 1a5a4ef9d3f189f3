//! File names that stand for a sequence of files: `out/{scene}.####.exr`.
//!
//! Every spelling of a frame number that compositing and simulation programs use is understood: `####` (a digit each),
//! `%04d`, `$F4` and `{frame:04}`. `{scene}` is the name of the scene file without its ending. Anything else is
//! literal, but an unknown name in braces is an error, because it is never what was meant.

use std::fmt::Write;
use thiserror::Error;

/// Widest frame number that a pattern may ask for [digits].
const WIDTH_MAX: usize = 32;

/// A part of a pattern.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Piece {
    /// Text that is the same in every name.
    Literal(String),
    /// The frame number with zeros in front, at least this many characters wide, a minus sign included.
    Frame {
        /// Least number of characters.
        width: usize,
    },
    /// Name of the scene.
    Scene,
}

/// A file name with places for the frame and the scene's name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    pieces: Vec<Piece>,
}

/// What is wrong with a pattern.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum PatternError {
    /// Nothing at all.
    #[error("a file name cannot be empty")]
    Empty,
    /// Braces around something that is not a placeholder.
    #[error("unknown placeholder `{{{name}}}`; known are `{{frame}}`, `{{frame:04}}` and `{{scene}}`")]
    UnknownPlaceholder {
        /// What the braces hold.
        name: String,
        /// Byte at which the placeholder begins.
        offset: usize,
    },
    /// A brace that is never closed.
    #[error("`{{` without `}}`")]
    Unclosed {
        /// Byte of the brace.
        offset: usize,
    },
    /// A frame number wider than any file name.
    #[error("a frame number of {width} digits; at most 32 are allowed")]
    TooWide {
        /// Digits asked for.
        width: usize,
        /// Byte at which the placeholder begins.
        offset: usize,
    },
}

impl PatternError {
    /// Byte of the pattern at which the fault begins.
    pub fn offset(&self) -> usize {
        match self {
            Self::Empty => 0,
            Self::UnknownPlaceholder { offset, .. } | Self::Unclosed { offset } | Self::TooWide { offset, .. } => {
                *offset
            }
        }
    }
}

impl Pattern {
    /// Reads a pattern.
    ///
    /// # Errors
    /// Empty text, unknown or unclosed braces, a frame number wider than 32 digits.
    pub fn parse(text: &str) -> Result<Self, PatternError> {
        if text.is_empty() {
            return Err(PatternError::Empty);
        }
        let mut pieces: Vec<Piece> = Vec::new();
        let mut rest = text;
        while let Some(first) = rest.chars().next() {
            let offset = text.len() - rest.len();
            let found = match first {
                '#' => Some(hashes(rest)),
                '%' => printf(rest),
                '$' => dollar(rest),
                '{' => Some(braces(rest, offset)?),
                _ => None,
            };
            let (piece, length) = found.unwrap_or_else(|| (Piece::Literal(first.into()), first.len_utf8()));
            if let Piece::Frame { width } = piece
                && width > WIDTH_MAX
            {
                return Err(PatternError::TooWide { width, offset });
            }
            match (pieces.last_mut(), piece) {
                (Some(Piece::Literal(before)), Piece::Literal(more)) => before.push_str(&more),
                (_, piece) => pieces.push(piece),
            }
            rest = &rest[length..];
        }
        Ok(Self { pieces })
    }

    /// The parts in order.
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Whether different frames get different names.
    pub fn has_frame(&self) -> bool {
        self.pieces.iter().any(|piece| matches!(piece, Piece::Frame { .. }))
    }

    /// The pattern for a layer that has files of its own: its name stands before the frame number and what parts that from the
    /// text before, or before the ending.
    pub fn of_layer(&self, layer: &str) -> Self {
        let mut pieces = self.pieces.clone();
        let frame = pieces.iter().rposition(|piece| matches!(piece, Piece::Frame { .. }));
        match (frame, frame.and_then(|i| i.checked_sub(1)).map(|i| &mut pieces[i])) {
            (_, Some(Piece::Literal(before))) => {
                let parted = before.chars().last().filter(|c| ".-_".contains(*c)).unwrap_or('.');
                let more = if before.ends_with(parted) { format!("{layer}{parted}") } else { format!(".{layer}.") };
                before.push_str(&more);
            }
            (Some(frame), _) => pieces.insert(frame, Piece::Literal(format!(".{layer}."))),
            (None, _) => {
                let Some(Piece::Literal(last)) = pieces.last_mut() else {
                    pieces.push(Piece::Literal(format!(".{layer}")));
                    return Self { pieces };
                };
                let at = last.rfind('.').filter(|at| !last[*at..].contains('/')).unwrap_or(last.len());
                last.insert_str(at, &format!(".{layer}"));
            }
        }
        Self { pieces }
    }

    /// The file name of one frame.
    pub fn expand(&self, frame: i32, scene: &str) -> String {
        let mut name = String::new();
        for piece in &self.pieces {
            match piece {
                Piece::Literal(text) => name.push_str(text),
                Piece::Scene => name.push_str(scene),
                Piece::Frame { width } => {
                    // Writing to a String cannot fail.
                    let _ = write!(name, "{frame:0width$}");
                }
            }
        }
        name
    }
}

/// Frames in the shortest common spelling: runs as ranges, `1-3,7`.
pub fn spell(frames: &[i32]) -> String {
    let mut parts: Vec<(i32, i32)> = Vec::new();
    for &frame in frames {
        match parts.last_mut() {
            Some((_, last)) if last.checked_add(1) == Some(frame) => *last = frame,
            _ => parts.push((frame, frame)),
        }
    }
    let spelled = parts.iter().map(|&(a, b)| if a == b { a.to_string() } else { format!("{a}-{b}") });
    spelled.collect::<Vec<_>>().join(",")
}

/// Decimal digits at the start of a text: their value, saturating, and their number.
fn digits(text: &str) -> (usize, usize) {
    let count = text.bytes().take_while(u8::is_ascii_digit).count();
    let value = text[..count].bytes().fold(0usize, |sum, b| sum.saturating_mul(10).saturating_add((b - b'0').into()));
    (value, count)
}

fn hashes(rest: &str) -> (Piece, usize) {
    let width = rest.bytes().take_while(|&b| b == b'#').count();
    (Piece::Frame { width }, width)
}

fn printf(rest: &str) -> Option<(Piece, usize)> {
    let (width, count) = digits(&rest[1..]);
    rest[1 + count..].starts_with('d').then_some((Piece::Frame { width }, count + 2))
}

fn dollar(rest: &str) -> Option<(Piece, usize)> {
    let after = rest.strip_prefix("$F")?;
    let (width, count) = digits(after);
    // `$FOO` is another variable, not a frame followed by two letters.
    let is_longer_name = after[count..].starts_with(|c: char| c.is_ascii_alphanumeric() || c == '_');
    (!is_longer_name).then_some((Piece::Frame { width }, count + 2))
}

fn braces(rest: &str, offset: usize) -> Result<(Piece, usize), PatternError> {
    let end = rest.find('}').ok_or(PatternError::Unclosed { offset })?;
    let name = &rest[1..end];
    let piece = match name.split_once(':') {
        None if name == "scene" => Some(Piece::Scene),
        None if name == "frame" => Some(Piece::Frame { width: 0 }),
        Some(("frame", width)) if !width.is_empty() && digits(width).1 == width.len() => {
            Some(Piece::Frame { width: digits(width).0 })
        }
        _ => None,
    };
    piece.map(|piece| (piece, end + 1)).ok_or_else(|| PatternError::UnknownPlaceholder { name: name.into(), offset })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_are_named_before_the_frame() {
        for (pattern, name) in [
            ("out/{scene}.####.exr", "out/plume.N.0012.exr"),
            ("a_%04d.exr", "a_N_0012.exr"),
            ("a####.exr", "a.N.0012.exr"),
            ("{scene}####.exr", "plume.N.0012.exr"),
            ("out.d/a.exr", "out.d/a.N.exr"),
            ("{scene}.exr", "plume.N.exr"),
            ("{frame}/{scene}", "N.12/plume"),
        ] {
            let pattern = Pattern::parse(pattern).unwrap_or_else(|e| panic!("{pattern}: {e}"));
            let found = pattern.of_layer("N").expand(12, "plume");
            assert_eq!(found.trim_start_matches('.'), name);
        }
    }

    #[test]
    fn every_spelling_of_a_frame_number() {
        for (pattern, name) in [
            ("out/{scene}.####.exr", "out/plume.0012.exr"),
            ("a.%04d.exr", "a.0012.exr"),
            ("a.%d.exr", "a.12.exr"),
            ("a.%5d", "a.00012"),
            ("a.$F4.exr", "a.0012.exr"),
            ("a.$F.exr", "a.12.exr"),
            ("{frame:06}/{frame}", "000012/12"),
            ("#", "12"),
            ("ä#ö", "ä12ö"),
        ] {
            assert_eq!(Pattern::parse(pattern).unwrap().expand(12, "plume"), name, "{pattern}");
        }
        assert_eq!(Pattern::parse("####").unwrap().expand(-5, ""), "-005");
    }

    #[test]
    fn the_rest_is_literal() {
        for text in ["100%/a", "$FOO", "$F4x", "a}b", "%04f", "$"] {
            let pattern = Pattern::parse(text).unwrap();
            assert!(!pattern.has_frame(), "{text}");
            assert_eq!(pattern.expand(1, "s"), text);
        }
    }

    #[test]
    fn faults_say_where() {
        assert_eq!(Pattern::parse(""), Err(PatternError::Empty));
        assert_eq!(Pattern::parse("a{b").unwrap_err().offset(), 1);
        let error = Pattern::parse("out/{frme}.exr").unwrap_err();
        assert_eq!(error.offset(), 4);
        assert!(error.to_string().contains("`{frme}`"), "{error}");
        assert!(matches!(Pattern::parse("%0999999999999999999999d"), Err(PatternError::TooWide { .. })));
        assert!(matches!(Pattern::parse(&"#".repeat(33)), Err(PatternError::TooWide { .. })));
    }

    #[test]
    fn frames_are_spelled_briefly() {
        assert_eq!(spell(&[1, 2, 3, 7, 9, 10, 5]), "1-3,7,9-10,5");
        assert_eq!(spell(&[-2, -1, 0]), "-2-0");
    }
}
