//! Whether parts of a picture are all of it, each path once.

use crate::output::part::PartFile;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why parts do not make a picture.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum PartSetError {
    /// A checkpoint of a whole picture.
    #[error(
        "{path}: a checkpoint of a picture that traces all its paths, not a part; `curlsmoke render --resume` goes on from it",
        path = path.display()
    )]
    Checkpoint {
        /// The file.
        path: PathBuf,
    },
    /// A part that was interrupted.
    #[error(
        "{path}: has {done} of {all} tiles; finish it with the `render --samples` that began it and --resume",
        path = path.display()
    )]
    Unfinished {
        /// The file.
        path: PathBuf,
        /// Tiles in it.
        done: usize,
        /// Tiles of the picture.
        all: usize,
    },
    /// Parts of two pictures.
    #[error("{a} and {b} are parts of different pictures of frame {frame}: {difference}", a = a.display(), b = b.display())]
    Foreign {
        /// A file.
        a: PathBuf,
        /// Another.
        b: PathBuf,
        /// Number of the frame.
        frame: i32,
        /// How they differ.
        difference: String,
    },
    /// Paths that are in two parts.
    #[error(
        "frame {frame}: paths {first} to {last} are in both {a} and {b}; leave one out", a = a.display(), b = b.display()
    )]
    Overlap {
        /// Number of the frame.
        frame: i32,
        /// The first path.
        first: u32,
        /// The last.
        last: u32,
        /// A file.
        a: PathBuf,
        /// Another.
        b: PathBuf,
    },
    /// Paths that are in no part.
    #[error(
        "frame {frame}: paths {first} to {last} of {spp} are in no part; make them with `render --samples {first}-{last}`"
    )]
    Gap {
        /// Number of the frame.
        frame: i32,
        /// The first path.
        first: u32,
        /// The last.
        last: u32,
        /// Paths of each pixel.
        spp: u32,
    },
}

/// Sorts the parts of one frame by their paths, and makes sure that they are all of one picture.
///
/// # Errors
/// The first thing that is not so.
pub fn check(parts: &mut [PartFile]) -> Result<(), PartSetError> {
    for part in parts.iter() {
        let path = || part.path.clone();
        if part.head.samples.is_none() {
            return Err(PartSetError::Checkpoint { path: path() });
        }
        let [done, all] = part.tile_counts();
        if done < all {
            return Err(PartSetError::Unfinished { path: path(), done, all });
        }
    }
    parts.sort_by_key(|part| part.head.samples);
    let Some((first, others)) = parts.split_first() else { return Ok(()) };
    let frame = first.head.record.frame;
    for other in others {
        if let Some(difference) = difference(first, other) {
            return Err(PartSetError::Foreign { a: first.path.clone(), b: other.path.clone(), frame, difference });
        }
    }
    let spp = first.head.spp;
    let mut done: (u32, &Path) = (0, &first.path);
    for part in parts.iter() {
        let [begin, end] = part.head.samples.unwrap_or_default();
        if begin <= done.0 {
            let (a, b) = (done.1.to_path_buf(), part.path.clone());
            return Err(PartSetError::Overlap { frame, first: begin, last: end.min(done.0), a, b });
        }
        if begin > done.0 + 1 {
            return Err(PartSetError::Gap { frame, first: done.0 + 1, last: begin - 1, spp });
        }
        done = (end, &part.path);
    }
    if done.0 < spp { Err(PartSetError::Gap { frame, first: done.0 + 1, last: spp, spp }) } else { Ok(()) }
}

/// How two parts of a frame differ in what must be equal.
fn difference(a: &PartFile, b: &PartFile) -> Option<String> {
    let (a, b) = (&a.head, &b.head);
    let differ = |what: &str, a: &dyn ToString, b: &dyn ToString| {
        Some(format!("{what} {} and {}", a.to_string(), b.to_string()))
    };
    if a.record.version != b.record.version {
        return differ("versions of curlsmoke", &a.record.version, &b.record.version);
    }
    if a.spp != b.spp {
        return differ("paths a pixel,", &a.spp, &b.spp);
    }
    if a.resolution != b.resolution {
        let text = |[width, height]: [u32; 2]| format!("{width} × {height}");
        return differ("sizes", &text(a.resolution), &text(b.resolution));
    }
    if a.record.seed != b.record.seed {
        return differ("seeds", &a.record.seed, &b.record.seed);
    }
    let is_equal = (&a.record.fingerprint, a.bounds, a.tile_edge, &a.layers, &a.finish)
        == (&b.record.fingerprint, b.bounds, b.tile_edge, &b.layers, &b.finish);
    let short = |text: &str| text.chars().take(8).collect::<String>();
    let prints = [&a.record.fingerprint, &b.record.fingerprint].map(|text| short(text));
    (!is_equal).then(|| {
        format!("their scenes, or files that these name, differ (fingerprints {}… and {}…)", prints[0], prints[1])
    })
}
