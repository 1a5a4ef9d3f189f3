//! Pictures, the files they are kept in, and verdicts on whether two of them agree.

pub mod agreement;
pub mod compare;
pub mod denoise;
pub mod exr;
pub mod file;
pub mod film_image;
pub mod flip;
pub mod frames;
pub mod hdr;
pub mod heat_map;
pub mod image;
pub mod layers;
pub mod movie;
mod noise;
pub mod oidn;
pub mod part;
pub mod part_set;
pub mod png;
pub mod sidecar;
pub mod survey;
pub mod view;

/// How the preview maps light to the screen: what a scene may say is all there is. Done in [`view`].
pub use crate::scene::settings::View;
pub(crate) use crate::scene::settings::{OVERSCAN_MAX, RESOLUTION_MAX};

use crate::output::image::Image;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// What can go wrong with a picture or its file.
#[derive(Debug, Error)]
pub enum OutputError {
    /// The file to be read is not there.
    #[error("{path}: no such file", path = path.display())]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// The file is there, but the system does not let us read it.
    #[error("{path}: cannot be read: {cause}", path = path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// The file or its folder cannot be written, or the disk is full. Nothing was left half written.
    #[error("{path}: cannot be written: {cause}; free some space or choose another place in `output`", path = path.display())]
    Unwritable {
        /// The file or folder.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// The contents are not what the format allows, or end too soon.
    #[error("{path}: not a usable {format} file: {problem}", path = path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Name of the format.
        format: &'static str,
        /// What is wrong.
        problem: String,
    },
    /// Reading would need more memory than allowed.
    #[error("{path}: needs {needed} bytes of memory, more than the limit of {limit}; raise it with --memory-limit", path = path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Memory that would be needed [bytes].
        needed: u64,
        /// Memory that is allowed [bytes].
        limit: u64,
    },
    /// A picture that cannot be put into the format.
    #[error("the picture cannot be written as {format}: {problem}")]
    Encoding {
        /// Name of the format.
        format: &'static str,
        /// What is in the way.
        problem: String,
    },
    /// A file name whose ending says no format that we know.
    #[error("{path}: unknown kind of picture; known are .exr, .hdr and .png", path = path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
}

/// Reads an .exr, .hdr or .png picture, by the ending of its name. Light is linear in the result.
///
/// # Errors
/// When the file is missing, unreadable or invalid, or needs more than `memory_limit` bytes.
pub fn read_image(path: &Path, memory_limit: u64) -> Result<Image, OutputError> {
    match extension(path).as_str() {
        "exr" => exr::read(path, memory_limit),
        "hdr" | "pic" => hdr::read(path, memory_limit),
        "png" => png::read(path, memory_limit),
        _ => Err(OutputError::UnknownFormat { path: path.into() }),
    }
}

/// The ending of a file name in small letters, without the dot.
pub(crate) fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

/// The bytes of a file that is at most `memory_limit` bytes long.
pub(crate) fn read_bytes(path: &Path, memory_limit: u64) -> Result<Vec<u8>, OutputError> {
    let unreadable = |cause: std::io::Error| match cause.kind() {
        std::io::ErrorKind::NotFound => OutputError::Missing { path: path.into() },
        _ => OutputError::Unreadable { path: path.into(), cause },
    };
    check_regular(path).map_err(unreadable)?;
    let file = File::open(path).map_err(unreadable)?;
    let length = file.metadata().map_err(unreadable)?.len();
    check_memory(path, length, memory_limit)?;
    let mut bytes = Vec::new();
    // A file that grows while it is read, or a device without a length, stops here too.
    file.take(memory_limit).read_to_end(&mut bytes).map_err(unreadable)?;
    Ok(bytes)
}

/// An error for what is there but no file: opening a pipe waits for its other end, perhaps for ever.
pub(crate) fn check_regular(path: &Path) -> std::io::Result<()> {
    if std::fs::metadata(path)?.is_file() {
        return Ok(());
    }
    Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, "it is no regular file"))
}

/// An error when more bytes are needed than allowed.
pub(crate) fn check_memory(path: &Path, needed: u64, limit: u64) -> Result<(), OutputError> {
    if needed > limit {
        return Err(OutputError::TooLarge { path: path.into(), needed, limit });
    }
    Ok(())
}

impl From<crate::scene::settings::Compression> for exr::Compression {
    fn from(compression: crate::scene::settings::Compression) -> Self {
        match compression {
            crate::scene::settings::Compression::Zips => Self::Zips,
            crate::scene::settings::Compression::Zip => Self::Zip,
            crate::scene::settings::Compression::Piz => Self::Piz,
            crate::scene::settings::Compression::None => Self::None,
            crate::scene::settings::Compression::Dwaa => Self::Dwaa,
            crate::scene::settings::Compression::Dwab => Self::Dwab,
        }
    }
}

impl From<crate::scene::settings::Layout> for exr::Layout {
    fn from(layout: crate::scene::settings::Layout) -> Self {
        match layout {
            crate::scene::settings::Layout::Single => Self::Single,
            crate::scene::settings::Layout::Multipart => Self::Multipart,
            crate::scene::settings::Layout::Separate => Self::Separate,
        }
    }
}
