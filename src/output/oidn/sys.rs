//! The functions of Open Image Denoise 2 that we use, opened at run time.
//!
//! Handles are opaque, enumerations plain integers, and no struct crosses over, so one set of signatures serves all 2.x: the
//! headers of 2.0 to 2.5 have them alike. `bool` is C's, one byte.

use crate::foreign::{LoadError, Wanted, functions};
use std::ffi::{c_char, c_int, c_void};
use std::sync::OnceLock;

/// A device or a filter.
pub type Handle = *mut c_void;
/// `OIDN_DEVICE_TYPE_CPU`: the same picture on machines with a graphics processor and without.
pub const DEVICE_CPU: c_int = 1;
/// `OIDN_FORMAT_FLOAT3`: three numbers of single precision.
pub const FORMAT_FLOAT3: c_int = 3;

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

#[cfg(target_os = "macos")]
const NAME: &str = "libOpenImageDenoise.dylib";
#[cfg(target_os = "macos")]
const LOADER_NAMES: [&str; 2] = ["libOpenImageDenoise.2.dylib", NAME];
#[cfg(not(target_os = "macos"))]
const NAME: &str = "libOpenImageDenoise.so";
#[cfg(not(target_os = "macos"))]
const LOADER_NAMES: [&str; 2] = ["libOpenImageDenoise.so.2", NAME];

static OIDN: Wanted = Wanted {
    product: "Open Image Denoise 2",
    file: NAME,
    prefix: "libOpenImageDenoise.",
    loader_names: &LOADER_NAMES,
    variable: "OIDN_DIR",
    // The parts of the library look for each other in `../lib`.
    project_folder: ".oidn/lib",
    usual_folders: &["/usr/local/lib", "/usr/lib64", "/opt/homebrew/lib", "/opt/local/lib", "/opt/oidn/lib"],
    install: "run ./bootstrap.sh --denoiser in the source folder, install it (from openimagedenoise.org; macOS: brew install open-image-denoise)",
    repair: "run ./bootstrap.sh --denoiser in the source folder",
};

/// The library, opened at the first call and never closed.
///
/// # Errors
/// Where no usable library is found; the same answer every time.
pub fn functions() -> Result<&'static Functions, LoadError> {
    static FUNCTIONS: OnceLock<Result<Functions, LoadError>> = OnceLock::new();
    FUNCTIONS.get_or_init(|| OIDN.open(Functions::resolve)).as_ref().map_err(Clone::clone)
}
