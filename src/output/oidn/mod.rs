//! Intel's Open Image Denoise 2 behind safe types of our own: one picture in, one out.
#![allow(unsafe_code)]

#[allow(missing_docs)]
mod sys;

pub use crate::foreign::LoadError;

use std::ffi::{CStr, c_void};
use std::ptr::null;
use sys::{Functions, Handle};

/// Why a picture was not denoised.
#[derive(Debug, Clone, thiserror::Error)]
pub enum OidnError {
    /// The library is missing or unusable.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The library is not of a version whose functions we know.
    #[error(
        "Open Image Denoise {0} was found, but version 2 is needed; run ./bootstrap.sh --denoiser in the source folder, or set OIDN_DIR"
    )]
    Version(String),
    /// The library refuses.
    #[error("Open Image Denoise cannot go on: {0}")]
    Failed(String),
}

/// Red, green and blue, or the three parts of a vector, of each pixel.
pub type Pixels = [[f32; 3]];

/// The library, ready.
pub struct Denoiser {
    functions: &'static Functions,
    device: Handle,
}

impl Denoiser {
    /// Opens the library, for work on so many threads of this machine's processor.
    ///
    /// # Errors
    /// Where none can be used.
    pub fn try_new(threads: Option<usize>) -> Result<Self, OidnError> {
        let functions = sys::functions()?;
        // SAFETY: a number that the library knows.
        let device = unsafe { (functions.new_device)(sys::DEVICE_CPU) };
        // Asking with no device gives the reason why none could be made; owning none, it must not be released.
        if device.is_null() {
            return Err(OidnError::Failed(message(functions, device).unwrap_or("no device".into())));
        }
        let denoiser = Self { functions, device };
        let version = denoiser.number(c"version");
        if !(20_000..30_000).contains(&version) {
            return Err(OidnError::Version(dotted(version)));
        }
        // SAFETY: the device is ours, names are C strings, and settings come before the commit.
        unsafe {
            if let Some(threads) = threads {
                let threads = i32::try_from(threads).unwrap_or(i32::MAX);
                (functions.set_device_int)(device, c"numThreads".as_ptr(), threads);
            }
            // Threads that are tied to processors fight with other programs for them.
            (functions.set_device_bool)(device, c"setAffinity".as_ptr(), false);
            (functions.commit_device)(device);
        }
        denoiser.check()?;
        Ok(denoiser)
    }

    /// The version of the library, as "2.5.1".
    pub fn version(&self) -> String {
        dotted(self.number(c"version"))
    }

    /// A picture of `width · height` radiances without its noise. `albedo` in [0, 1] and unit `normal`s, where there are
    /// any, tell edges from noise; `is_clean` where they themselves have none.
    ///
    /// # Errors
    /// What the library says.
    ///
    /// # Panics
    /// When a picture has not `width · height` pixels.
    pub fn denoise(
        &self,
        [width, height]: [usize; 2],
        color: &Pixels,
        albedo: Option<&Pixels>,
        normal: Option<&Pixels>,
        is_clean: bool,
    ) -> Result<Vec<[f32; 3]>, OidnError> {
        let images = [(c"color", Some(color)), (c"albedo", albedo), (c"normal", normal)];
        self.run([width, height], &images, &[(c"hdr", true), (c"cleanAux", is_clean && albedo.is_some())])
    }

    /// A layer of albedos without its noise.
    ///
    /// # Errors
    /// What the library says.
    pub fn clean_albedo(&self, size: [usize; 2], albedo: &Pixels) -> Result<Vec<[f32; 3]>, OidnError> {
        self.run(size, &[(c"albedo", Some(albedo))], &[])
    }

    /// A layer of normals without its noise.
    ///
    /// # Errors
    /// What the library says.
    pub fn clean_normal(&self, size: [usize; 2], normal: &Pixels) -> Result<Vec<[f32; 3]>, OidnError> {
        self.run(size, &[(c"normal", Some(normal))], &[])
    }

    fn run(
        &self,
        [width, height]: [usize; 2],
        images: &[(&CStr, Option<&Pixels>)],
        flags: &[(&CStr, bool)],
    ) -> Result<Vec<[f32; 3]>, OidnError> {
        let mut output = vec![[0.0f32; 3]; width * height];
        let f = self.functions;
        // SAFETY: the device is ours; "RT" is the filter of pictures that were traced.
        let filter = Filter { functions: f, handle: unsafe { (f.new_filter)(self.device, c"RT".as_ptr()) } };
        self.check()?;
        let set = |name: &CStr, pixels: *mut c_void| {
            // SAFETY: `pixels` has width · height times three numbers without gaps, and outlives the filter's work.
            unsafe { (f.set_image)(filter.handle, name.as_ptr(), pixels, sys::FORMAT_FLOAT3, width, height, 0, 0, 0) }
        };
        for (name, pixels) in images {
            let Some(pixels) = pixels else { continue };
            assert_eq!(pixels.len(), width * height, "one entry for each pixel");
            // The library only reads what it is given as input.
            set(name, pixels.as_ptr().cast_mut().cast());
        }
        set(c"output", output.as_mut_ptr().cast());
        // SAFETY: the filter is ours, and names are C strings.
        unsafe {
            for (name, value) in flags {
                (f.set_filter_bool)(filter.handle, name.as_ptr(), *value);
            }
            (f.commit_filter)(filter.handle);
            (f.execute_filter)(filter.handle);
        }
        drop(filter);
        self.check()?;
        Ok(output)
    }

    fn number(&self, name: &CStr) -> i32 {
        // SAFETY: the device is ours, and the name a C string.
        unsafe { (self.functions.get_device_int)(self.device, name.as_ptr()) }
    }

    fn check(&self) -> Result<(), OidnError> {
        message(self.functions, self.device).map_or(Ok(()), |text| Err(OidnError::Failed(text)))
    }
}

impl Drop for Denoiser {
    fn drop(&mut self) {
        // SAFETY: made by us and released once, after all its filters.
        unsafe { (self.functions.release_device)(self.device) }
    }
}

/// A filter at work.
struct Filter {
    functions: &'static Functions,
    handle: Handle,
}

impl Drop for Filter {
    fn drop(&mut self) {
        if !self.handle.is_null() {
            // SAFETY: made by us and released once.
            unsafe { (self.functions.release_filter)(self.handle) }
        }
    }
}

/// What the library complains of since it was last asked.
fn message(functions: &Functions, device: Handle) -> Option<String> {
    let mut text = null();
    // SAFETY: a device or none, and a place for the message.
    let code = unsafe { (functions.device_error)(device, &mut text) };
    if code == 0 {
        return None;
    }
    // SAFETY: where it is not null it is a C string that lives until the next call.
    let text = (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned());
    Some(text.unwrap_or_else(|| format!("error {code}")))
}

/// "2.5.1" out of 20501.
fn dotted(version: i32) -> String {
    format!("{}.{}.{}", version / 10_000, version / 100 % 100, version % 100)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_dotted() {
        assert_eq!(dotted(20_501), "2.5.1");
    }
}
