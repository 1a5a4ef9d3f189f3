//! The functions of Open Image Denoise 2 that we use, opened at run time.
//!
//! Handles are opaque, enumerations plain integers, and no struct crosses over, so one set of signatures serves all 2.x: the
//! headers of 2.0 to 2.5 have them alike. `bool` is C's, one byte.

use libloading::Library;
use std::error::Error;
use std::ffi::{OsString, c_char, c_int, c_void};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A device or a filter.
pub type Handle = *mut c_void;
/// `OIDN_DEVICE_TYPE_CPU`: the same picture on machines with a graphics processor and without.
pub const DEVICE_CPU: c_int = 1;
/// `OIDN_FORMAT_FLOAT3`: three numbers of single precision.
pub const FORMAT_FLOAT3: c_int = 3;

macro_rules! functions {
    ($($field:ident = $symbol:literal: fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// The functions of the library, resolved once.
        pub struct Functions {
            $(pub $field: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
        }

        impl Functions {
            fn resolve(library: &Library) -> Result<Self, libloading::Error> {
                // SAFETY: the signatures are those of the headers of Open Image Denoise 2, and the library is never closed, so
                // the pointers stay valid.
                unsafe { Ok(Self { $($field: *library.get($symbol.as_slice())?,)* }) }
            }
        }
    };
}

functions! {
    new_device = b"oidnNewDevice\0": fn(c_int) -> Handle;
    commit_device = b"oidnCommitDevice\0": fn(Handle);
    release_device = b"oidnReleaseDevice\0": fn(Handle);
    get_device_int = b"oidnGetDeviceInt\0": fn(Handle, *const c_char) -> c_int;
    set_device_int = b"oidnSetDeviceInt\0": fn(Handle, *const c_char, c_int);
    set_device_bool = b"oidnSetDeviceBool\0": fn(Handle, *const c_char, bool);
    // Writes where the message begins; it stays valid until the next call on the device.
    device_error = b"oidnGetDeviceError\0": fn(Handle, *mut *const c_char) -> c_int;
    new_filter = b"oidnNewFilter\0": fn(Handle, *const c_char) -> Handle;
    release_filter = b"oidnReleaseFilter\0": fn(Handle);
    // Filter, name, pixels, format, width, height, then offset and strides [bytes], 0 for pixels without gaps.
    set_image = b"oidnSetSharedFilterImage\0":
        fn(Handle, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize);
    set_filter_bool = b"oidnSetFilterBool\0": fn(Handle, *const c_char, bool);
    commit_filter = b"oidnCommitFilter\0": fn(Handle);
    execute_filter = b"oidnExecuteFilter\0": fn(Handle);
}

/// Where no library could be opened: what was tried, for people.
#[derive(Debug, Clone, thiserror::Error)]
pub enum LoadError {
    /// No file of that name anywhere.
    #[error(
        "Open Image Denoise 2 was not found; run ./bootstrap.sh --denoiser in the source folder, install it (from \
         openimagedenoise.org; macOS: brew install open-image-denoise), or set OIDN_DIR to a folder that holds {NAME}"
    )]
    NotFound,
    /// A file is there but cannot be used.
    #[error("{} cannot be used as Open Image Denoise 2: {reason}; run ./bootstrap.sh --denoiser in the source folder, or set OIDN_DIR to a folder that holds {NAME}", path.display())]
    Unusable {
        /// The file.
        path: PathBuf,
        /// What the loader says.
        reason: String,
    },
    /// OIDN_DIR names a folder without the library.
    #[error("OIDN_DIR is {}, but neither it nor its lib folder holds {NAME}; correct it or unset it", path.display())]
    WrongFolder {
        /// What OIDN_DIR says.
        path: PathBuf,
    },
}

#[cfg(target_os = "macos")]
const NAME: &str = "libOpenImageDenoise.dylib";
#[cfg(target_os = "macos")]
const NAMES: [&str; 2] = ["libOpenImageDenoise.2.dylib", NAME];
#[cfg(not(target_os = "macos"))]
const NAME: &str = "libOpenImageDenoise.so";
#[cfg(not(target_os = "macos"))]
const NAMES: [&str; 2] = ["libOpenImageDenoise.so.2", NAME];

/// Folders that package managers fill and loaders do not always search.
const USUAL_FOLDERS: [&str; 5] =
    ["/usr/local/lib", "/usr/lib64", "/opt/homebrew/lib", "/opt/local/lib", "/opt/oidn/lib"];

/// The folder of a checkout that `bootstrap.sh --denoiser` fills; the parts of the library look for each other in `../lib`.
const PROJECT_FOLDER: &str = ".oidn/lib";

/// The library, opened at the first call and never closed.
///
/// # Errors
/// Where no usable library is found; the same answer every time.
pub fn functions() -> Result<&'static Functions, LoadError> {
    static FUNCTIONS: OnceLock<Result<Functions, LoadError>> = OnceLock::new();
    FUNCTIONS.get_or_init(|| open(std::env::var_os("OIDN_DIR"))).as_ref().map_err(Clone::clone)
}

fn open(oidn_dir: Option<OsString>) -> Result<Functions, LoadError> {
    if let Some(folder) = oidn_dir.filter(|f| !f.is_empty()).map(PathBuf::from) {
        return first_in(&[folder.clone(), folder.join("lib"), folder.join("lib64")])
            .unwrap_or(Err(LoadError::WrongFolder { path: folder }));
    }
    let mut folders = Vec::new();
    if let Some(beside) = std::env::current_exe().ok().as_deref().and_then(Path::parent) {
        folders.extend([beside.to_owned(), beside.join("../lib")]);
        folders.extend(beside.ancestors().map(|a| a.join(PROJECT_FOLDER)));
    }
    folders.push(Path::new(env!("CARGO_MANIFEST_DIR")).join(PROJECT_FOLDER));
    if let Some(found) = first_in(&folders) {
        return found;
    }
    // The loader's own search.
    if let Some(functions) = NAMES.iter().find_map(|name| load(Path::new(name)).ok()) {
        return Ok(functions);
    }
    first_in(&USUAL_FOLDERS.map(PathBuf::from)).unwrap_or(Err(LoadError::NotFound))
}

/// The library in the first of the folders that hold one.
fn first_in(folders: &[PathBuf]) -> Option<Result<Functions, LoadError>> {
    let path = folders.iter().flat_map(|folder| NAMES.map(|name| folder.join(name))).find(|path| path.exists())?;
    Some(load(&path).map_err(|error| {
        // What the loader says comes as the cause.
        let reason = error.source().map_or(error.to_string(), ToString::to_string);
        LoadError::Unusable { path, reason }
    }))
}

fn load(path: &Path) -> Result<Functions, libloading::Error> {
    // SAFETY: running the library's initialisers is what opening it means; it is opened with local visibility, so that its
    // threading library is not mixed up with another one's.
    let library = unsafe { Library::new(path) }?;
    let functions = Functions::resolve(&library)?;
    std::mem::forget(library);
    Ok(functions)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_without_the_library_is_named() {
        let empty = tempfile::tempdir().expect("a folder");
        let error = open(Some(empty.path().into())).err().expect("nothing there");
        assert!(error.to_string().contains(&empty.path().display().to_string()), "{error}");
    }

    #[test]
    fn a_file_that_is_no_library_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join(NAME), "not a library").expect("written");
        let error = open(Some(folder.path().into())).err().expect("not loadable");
        assert!(matches!(error, LoadError::Unusable { .. }) && error.to_string().contains("--denoiser"), "{error}");
    }
}
