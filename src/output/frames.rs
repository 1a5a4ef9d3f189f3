//! Lists of frames as people write them: `1-100`, `1-100x2`, `1,3,7-9`, `-5--1`, `10-1`.
//!
//! `x` and `:` are both a step, as on render farms. A `y` (in some tools "all but every n-th") is refused rather than
//! guessed at.

use std::collections::HashSet;
use std::path::PathBuf;
use thiserror::Error;

/// Most frames that a list may have.
pub const FRAMES_MAX: usize = 1_000_000;

/// Frames in the order in which they are to be made, each once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameList {
    /// The frames.
    pub frames: Vec<i32>,
    /// How many were listed again and dropped.
    pub duplicate_count: usize,
}

/// What is wrong with a list of frames.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum FramesError {
    /// A part that is neither a number nor a range.
    #[error("`{part}` is not a frame or range of frames; write for example 1-96, 1-96x2 or 1,3,7-9")]
    Syntax {
        /// The part.
        part: String,
    },
    /// The letter y, which tools do not agree on.
    #[error("`{part}`: y is not supported; use x for a step, as in 1-96x2")]
    Fill {
        /// The part.
        part: String,
    },
    /// A step of zero or below.
    #[error("`{part}`: a step is 1 or more; to go backwards write the larger frame first")]
    Step {
        /// The part.
        part: String,
    },
    /// More frames than anyone renders.
    #[error("`{part}`: more than {FRAMES_MAX} frames")]
    TooMany {
        /// The part.
        part: String,
    },
    /// Two frames whose files would have one name.
    #[error(
        "frames {first} and {second} would both be written to {path}; put #### where the frame number goes",
        path = path.display()
    )]
    SameFile {
        /// A frame.
        first: i32,
        /// Another.
        second: i32,
        /// The name they share.
        path: PathBuf,
    },
}

/// Reads a list of frames.
///
/// # Errors
/// See [`FramesError`]; all but `SameFile`.
pub fn parse(text: &str) -> Result<FrameList, FramesError> {
    let mut list = FrameList { frames: Vec::new(), duplicate_count: 0 };
    let mut seen = HashSet::new();
    for part in text.split(',').map(str::trim) {
        let (first, last, step) = range(part)?;
        let count = (i64::from(first) - i64::from(last)).unsigned_abs() / u64::from(step) + 1;
        if count > FRAMES_MAX as u64 || list.frames.len() + count as usize > FRAMES_MAX {
            return Err(FramesError::TooMany { part: part.into() });
        }
        let direction = if last >= first { 1 } else { -1 };
        for i in 0..count as i64 {
            // Between two frames, so it fits.
            let frame = (i64::from(first) + direction * i * i64::from(step)) as i32;
            if seen.insert(frame) {
                list.frames.push(frame);
            } else {
                list.duplicate_count += 1;
            }
        }
    }
    Ok(list)
}

/// First frame, last frame, step.
fn range(part: &str) -> Result<(i32, i32, u32), FramesError> {
    let syntax = || FramesError::Syntax { part: part.into() };
    if part.contains(['y', 'Y']) {
        return Err(FramesError::Fill { part: part.into() });
    }
    let (span, step) = match part.split_once(['x', 'X', ':']) {
        Some((span, step)) => {
            let step: i64 = step.trim().parse().map_err(|_| syntax())?;
            let step = u32::try_from(step).ok().filter(|&s| s > 0).ok_or(FramesError::Step { part: part.into() })?;
            (span.trim(), step)
        }
        None => (part, 1),
    };
    let number = |text: &str| text.trim().parse::<i32>().map_err(|_| syntax());
    // A minus at the start belongs to the number; the one that makes a range follows a digit.
    match span.char_indices().skip(1).find(|&(_, c)| c == '-') {
        Some((dash, _)) => Ok((number(&span[..dash])?, number(&span[dash + 1..])?, step)),
        None if step == 1 => number(span).map(|frame| (frame, frame, 1)),
        None => Err(syntax()),
    }
}

/// Makes sure that frames go to different files.
///
/// # Errors
/// [`FramesError::SameFile`] with the first two that do not.
pub fn check_distinct(frames: &[i32], file_of: impl Fn(i32) -> PathBuf) -> Result<(), FramesError> {
    let mut seen = std::collections::HashMap::new();
    for &second in frames {
        let path = file_of(second);
        if let Some(first) = seen.insert(path.clone(), second) {
            return Err(FramesError::SameFile { first, second, path });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_common_spellings_are_understood() {
        let cases: [(&str, &[i32]); 12] = [
            ("7", &[7]),
            ("-7", &[-7]),
            ("1-4", &[1, 2, 3, 4]),
            ("1-6x2", &[1, 3, 5]),
            ("1-6:2", &[1, 3, 5]),
            ("1,3,7-9", &[1, 3, 7, 8, 9]),
            ("4-1", &[4, 3, 2, 1]),
            ("9-1x4", &[9, 5, 1]),
            ("-2-1", &[-2, -1, 0, 1]),
            ("-5--3", &[-5, -4, -3]),
            (" 1 - 3 , 5 ", &[1, 2, 3, 5]),
            ("1-1x5", &[1]),
        ];
        for (text, frames) in cases {
            assert_eq!(parse(text).map(|list| list.frames).as_deref(), Ok(frames), "{text}");
        }
    }

    #[test]
    fn a_frame_listed_twice_is_made_once_where_it_first_stands() {
        assert_eq!(parse("3,1-4").unwrap(), FrameList { frames: vec![3, 1, 2, 4], duplicate_count: 1 });
    }

    #[test]
    fn nonsense_is_refused_with_what_to_write_instead() {
        for text in ["", "a", "1-", "-", "1--", "1,,2", "1-2-3", "1.5", "5x2", "1-5x", "99999999999", "1-5xx2"] {
            assert!(matches!(parse(text), Err(FramesError::Syntax { .. })), "{text}: {:?}", parse(text));
        }
        assert!(matches!(parse("1-9y2"), Err(FramesError::Fill { .. })));
        for text in ["1-9x0", "1-9x-2"] {
            assert!(matches!(parse(text), Err(FramesError::Step { .. })), "{text}");
        }
        for text in ["1-1000001", "-2147483648-2147483647", "1-600000,700000-1300000"] {
            assert!(matches!(parse(text), Err(FramesError::TooMany { .. })), "{text}");
        }
        assert_eq!(parse("-2147483648-2147483647x4294967295").unwrap().frames, [i32::MIN, i32::MAX]);
    }

    #[test]
    fn two_frames_cannot_share_a_file() {
        let error = check_distinct(&[1, 2], |_| "out.exr".into()).unwrap_err();
        assert_eq!(error, FramesError::SameFile { first: 1, second: 2, path: "out.exr".into() });
        assert!(check_distinct(&[1, 2], |f| format!("{f}.exr").into()).is_ok());
    }
}
