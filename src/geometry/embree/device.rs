//! The library made ready, and what can be wrong with it.

use crate::foreign::LoadError;
use crate::geometry::embree::sys::{self, Functions, Handle};

/// Why no scene could be made.
#[derive(Debug, Clone, thiserror::Error)]
pub enum EmbreeError {
    /// The library is missing or unusable.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The library is not of a version whose layout we know.
    #[error("Embree {}.{}.{} was found, but version 4 is needed; run ./bootstrap.sh in the source folder", version / 10000, version / 100 % 100, version % 100)]
    Version {
        /// major · 10000 + minor · 100 + patch.
        version: isize,
    },
    /// The library could not do what it was asked.
    #[error("Embree failed while {doing}: {}", code_name(*code))]
    Failed {
        /// What it was asked for.
        doing: &'static str,
        /// `RTCError`.
        code: i32,
    },
}

fn code_name(code: i32) -> String {
    match code {
        2 => "invalid argument".into(),
        3 => "invalid operation".into(),
        4 => "out of memory".into(),
        5 => "this processor is not supported".into(),
        code => format!("error {code}"),
    }
}

/// The library, ready.
pub(super) struct Device {
    /// What it can be asked.
    pub functions: &'static Functions,
    /// Its name for the library.
    pub handle: Handle,
}

// SAFETY: Embree's devices, scenes and geometries may be used from several threads; those that change are reached
// through `&mut` or by value only.
unsafe impl Send for Device {}
// SAFETY: as above.
unsafe impl Sync for Device {}

impl Device {
    pub fn try_new() -> Result<Self, EmbreeError> {
        let functions = sys::functions()?;
        // One thread: the tree, and so which of two equally near triangles is reported, must not depend on the machine's
        // load. Half a second for a million triangles.
        let config = c"threads=1,set_affinity=0";
        // SAFETY: a valid C string.
        let handle = unsafe { (functions.new_device)(config.as_ptr()) };
        if handle.is_null() {
            // SAFETY: asking with no device gives the reason why none could be made.
            let code = unsafe { (functions.device_error)(std::ptr::null_mut()) };
            return Err(EmbreeError::Failed { doing: "starting", code });
        }
        let device = Self { functions, handle };
        let version = device.version();
        if !(40000..50000).contains(&version) {
            return Err(EmbreeError::Version { version });
        }
        Ok(device)
    }

    pub fn version(&self) -> isize {
        // SAFETY: the device lives as long as `self`.
        unsafe { (self.functions.device_property)(self.handle, sys::PROPERTY_VERSION) }
    }

    pub fn check(&self, doing: &'static str) -> Result<(), EmbreeError> {
        // SAFETY: the device lives as long as `self`.
        match unsafe { (self.functions.device_error)(self.handle) } {
            0 => Ok(()),
            code => Err(EmbreeError::Failed { doing, code }),
        }
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: made by us, released once, and every scene on it is gone by then.
        unsafe { (self.functions.release_device)(self.handle) }
    }
}

/// The version of the library that would be used, as "4.4.0".
///
/// # Errors
/// Where none can be used.
pub fn version() -> Result<String, EmbreeError> {
    let v = Device::try_new()?.version();
    Ok(format!("{}.{}.{}", v / 10000, v / 100 % 100, v % 100))
}
