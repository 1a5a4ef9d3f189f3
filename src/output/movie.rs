//! Movies of previews, by the system's ffmpeg.

use crate::output::OutputError;
use crate::output::file::{folder_of, write_atomic};
use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use thiserror::Error;

/// Why there is no movie.
#[derive(Debug, Error)]
pub enum MovieError {
    /// The program is not there.
    #[error(
        "ffmpeg cannot be run: {0}; install it (apt-get install ffmpeg, brew install ffmpeg), or leave --movie out"
    )]
    NoFfmpeg(io::Error),
    /// It did not make a movie.
    #[error("{path}: ffmpeg made no movie: {said}", path = path.display())]
    Failed {
        /// The movie.
        path: PathBuf,
        /// What it said last.
        said: String,
    },
    /// A name that no movie has.
    #[error("{path}: a movie's name ends in .mp4, .mov, .mkv or .webm", path = path.display())]
    Name {
        /// The movie.
        path: PathBuf,
    },
    /// A frame, or the movie's own file.
    #[error(transparent)]
    File(#[from] OutputError),
}

/// Makes sure, before hours are spent, that there is an ffmpeg and that it knows the kind of file.
///
/// # Errors
/// [`MovieError::NoFfmpeg`], [`MovieError::Name`].
pub fn check(path: &Path) -> Result<(), MovieError> {
    codec(path)?;
    let asked = Command::new("ffmpeg").arg("-version").stdin(Stdio::null()).output();
    asked.map(|_| ()).map_err(MovieError::NoFfmpeg)
}

/// The encoder for a kind of file: what players on all systems show.
fn codec(path: &Path) -> Result<&'static [&'static str], MovieError> {
    match crate::output::extension(path).as_str() {
        "mp4" | "mov" | "mkv" => Ok(&["-c:v", "libx264", "-crf", "16", "-preset", "medium", "-movflags", "+faststart"]),
        "webm" => Ok(&["-c:v", "libvpx-vp9", "-crf", "24", "-b:v", "0"]),
        _ => Err(MovieError::Name { path: path.into() }),
    }
}

/// Makes a movie of .png pictures in their order, each shown for 1/`fps` s. It appears whole or not at all.
///
/// # Errors
/// Those of [`MovieError`].
pub fn make(frames: &[PathBuf], fps: f64, path: &Path) -> Result<(), MovieError> {
    let unwritable = |cause| OutputError::Unwritable { path: path.into(), cause };
    let folder = folder_of(path);
    fs::create_dir_all(&folder).map_err(unwritable)?;
    let kind = crate::output::extension(path);
    let beside = folder.join(format!(".movie.{}.{kind}", std::process::id()));
    let made = encode(frames, fps, path, &beside);
    let taken = made.and_then(|()| Ok(fs::read(&beside).map_err(unwritable)?));
    // It is not there where nothing was made.
    let _ = fs::remove_file(&beside);
    Ok(write_atomic(path, &taken?)?)
}

fn encode(frames: &[PathBuf], fps: f64, path: &Path, to: &Path) -> Result<(), MovieError> {
    let mut child = Command::new("ffmpeg")
        .args(["-hide_banner", "-loglevel", "error", "-y", "-f", "image2pipe", "-c:v", "png"])
        .args(["-framerate", &format!("{fps}"), "-i", "-"])
        // Players want even sizes and colours at half the resolution; the matrix is said, as it would be guessed otherwise.
        .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv,format=yuv420p"])
        .args(["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1"])
        .args(codec(path)?)
        .arg(to)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(MovieError::NoFfmpeg)?;
    let errors = child.stderr.take();
    // Read beside, so that neither waits for the other for ever.
    let listener = thread::spawn(move || {
        let mut said = String::new();
        errors.map(|mut errors| errors.read_to_string(&mut said));
        said
    });
    let fed = feed(&mut child, frames);
    let status = child.wait().map_err(MovieError::NoFfmpeg)?;
    let said = listener.join().unwrap_or_default();
    // A pipe that broke tells less than what was said.
    if !status.success() {
        let said = said.lines().last().unwrap_or("it said nothing").to_string();
        return Err(MovieError::Failed { path: path.into(), said });
    }
    fed
}

fn feed(child: &mut Child, frames: &[PathBuf]) -> Result<(), MovieError> {
    let Some(mut pipe) = child.stdin.take() else { return Ok(()) };
    for frame in frames {
        let bytes = fs::read(frame).map_err(|cause| match cause.kind() {
            io::ErrorKind::NotFound => OutputError::Missing { path: frame.clone() },
            _ => OutputError::Unreadable { path: frame.clone(), cause },
        })?;
        if pipe.write_all(&bytes).is_err() {
            break;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_what_kind_of_movie() {
        assert!(codec(Path::new("a/b.MP4")).is_ok() && codec(Path::new("b.webm")).is_ok());
        let error = check(Path::new("b.exr")).unwrap_err().to_string();
        assert!(error.contains("b.exr") && error.contains(".mp4"), "{error}");
    }
}
