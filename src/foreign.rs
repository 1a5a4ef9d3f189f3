//! Libraries of others, opened at run time: where they are looked for, and what is said where none can be used.
#![allow(unsafe_code)]

use libloading::Library;
use std::error::Error;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// A library to be opened.
#[derive(Debug)]
pub struct Wanted {
    /// Its name and version, for people.
    pub product: &'static str,
    /// The plain name of its file.
    pub file: &'static str,
    /// How names of its file begin, with a version in them or without.
    pub prefix: &'static str,
    /// Names by which the system's loader may know it, the first first.
    pub loader_names: &'static [&'static str],
    /// The variable that names its folder.
    pub variable: &'static str,
    /// The folder of a checkout that `bootstrap.sh` fills.
    pub project_folder: &'static str,
    /// Folders that package managers fill and loaders do not always search.
    pub usual_folders: &'static [&'static str],
    /// How to come by it.
    pub install: &'static str,
    /// How to come by one that works.
    pub repair: &'static str,
}

/// Where no library could be opened: what was tried, for people.
#[derive(Debug, Clone, thiserror::Error)]
pub enum LoadError {
    /// No file of that name anywhere.
    #[error("{} was not found; {}, or set {} to a folder that holds {}", wanted.product, wanted.install, wanted.variable, wanted.file)]
    NotFound {
        /// What was looked for.
        wanted: &'static Wanted,
    },
    /// A file is there but cannot be used.
    #[error(
        "{} cannot be used as {}: {reason}; {}, or set {} to a folder that holds {}",
        path.display(), wanted.product, wanted.repair, wanted.variable, wanted.file
    )]
    Unusable {
        /// What was looked for.
        wanted: &'static Wanted,
        /// The file.
        path: PathBuf,
        /// What the loader says.
        reason: String,
    },
    /// The variable names a folder without the library.
    #[error(
        "{} is {}, but neither it nor its lib folder holds {}; correct it or unset it",
        wanted.variable, path.display(), wanted.file
    )]
    WrongFolder {
        /// What was looked for.
        wanted: &'static Wanted,
        /// What the variable says.
        path: PathBuf,
    },
}

/// Declares the struct `Functions` of a library's functions, with `resolve`, which finds them all. The signatures are those of the
/// library's headers, or calling them is undefined.
macro_rules! functions {
    ($($field:ident = $symbol:literal: fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// The functions of the library, resolved once.
        pub struct Functions {
            $(pub $field: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
        }

        impl Functions {
            fn resolve(library: &libloading::Library) -> Result<Self, libloading::Error> {
                // SAFETY: the signatures are those of the library's headers, and it is never closed, so the pointers stay valid.
                unsafe { Ok(Self { $($field: *library.get($symbol.as_slice())?,)* }) }
            }
        }
    };
}
pub(crate) use functions;

impl Wanted {
    /// Opens the library, never to close it, and finds its functions by `resolve`.
    ///
    /// # Errors
    /// Where no usable library is found.
    pub fn open<F>(&'static self, resolve: impl Fn(&Library) -> Result<F, libloading::Error>) -> Result<F, LoadError> {
        self.open_in(std::env::var_os(self.variable), resolve)
    }

    /// In the folder that people chose, or wherever it may be.
    fn open_in<F>(
        &'static self,
        chosen: Option<OsString>,
        resolve: impl Fn(&Library) -> Result<F, libloading::Error>,
    ) -> Result<F, LoadError> {
        if let Some(folder) = chosen.filter(|f| !f.is_empty()).map(PathBuf::from) {
            return self
                .first_in(&[folder.clone(), folder.join("lib"), folder.join("lib64")], &resolve)
                .unwrap_or(Err(LoadError::WrongFolder { wanted: self, path: folder }));
        }
        let mut folders = Vec::new();
        if let Some(beside) = std::env::current_exe().ok().as_deref().and_then(Path::parent) {
            folders.extend([beside.to_owned(), beside.join("../lib")]);
            folders.extend(beside.ancestors().map(|a| a.join(self.project_folder)));
        }
        folders.push(Path::new(env!("CARGO_MANIFEST_DIR")).join(self.project_folder));
        let found = self.first_in(&folders, &resolve);
        if let Some(Ok(functions)) = found {
            return Ok(functions);
        }
        if let Some(functions) = self.loader_names.iter().find_map(|name| load(Path::new(name), &resolve).ok()) {
            return Ok(functions);
        }
        let usual: Vec<PathBuf> = self.usual_folders.iter().map(PathBuf::from).collect();
        found.or_else(|| self.first_in(&usual, &resolve)).unwrap_or(Err(LoadError::NotFound { wanted: self }))
    }

    /// The library in the first of the folders that hold one that works; else the complaint about the first that does not.
    fn first_in<F>(
        &'static self,
        folders: &[PathBuf],
        resolve: &impl Fn(&Library) -> Result<F, libloading::Error>,
    ) -> Option<Result<F, LoadError>> {
        let mut complaint = None;
        for path in folders.iter().flat_map(|folder| self.candidates(folder)) {
            match load(&path, resolve) {
                Ok(functions) => return Some(Ok(functions)),
                Err(error) => {
                    // What the loader says comes as the cause.
                    let reason = error.source().map_or(error.to_string(), ToString::to_string);
                    complaint.get_or_insert(LoadError::Unusable { wanted: self, path, reason });
                }
            }
        }
        complaint.map(Err)
    }

    /// Files of the folder that are named as the library is, with or without a version, the plain name first.
    fn candidates(&self, folder: &Path) -> Vec<PathBuf> {
        let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
        let mut names: Vec<OsString> = entries
            .flatten()
            .map(|entry| entry.file_name())
            .filter(|name| {
                let name = name.to_string_lossy();
                let is_library =
                    if cfg!(target_os = "macos") { name.ends_with(".dylib") } else { name.contains(".so") };
                name.starts_with(self.prefix) && is_library
            })
            .collect();
        names.sort_by_key(|name| (name != self.file, name.clone()));
        names.into_iter().map(|name| folder.join(name)).collect()
    }
}

fn load<F>(path: &Path, resolve: &impl Fn(&Library) -> Result<F, libloading::Error>) -> Result<F, libloading::Error> {
    // SAFETY: running the library's initialisers is what opening it means; it is opened with local visibility, so that its
    // threading library is not mixed up with another one's.
    let library = unsafe { Library::new(path) }?;
    let functions = resolve(&library)?;
    std::mem::forget(library);
    Ok(functions)
}

#[cfg(test)]
mod tests {
    use super::*;

    static NOTHING: Wanted = Wanted {
        product: "Nothing 1",
        file: "libnothing.so",
        prefix: "libnothing.",
        loader_names: &["libnothing.so.1"],
        variable: "NOTHING_DIR",
        project_folder: ".nothing",
        usual_folders: &["/usr/lib"],
        install: "buy it",
        repair: "mend it",
    };

    fn opened(folder: &Path) -> String {
        NOTHING.open_in(Some(folder.into()), |_| Ok(())).expect_err("nothing there").to_string()
    }

    #[test]
    fn a_folder_without_the_library_is_named() {
        let empty = tempfile::tempdir().expect("a folder");
        let error = opened(empty.path());
        let start = format!("NOTHING_DIR is {}, but neither", empty.path().display());
        assert!(error.starts_with(&start) && error.contains("libnothing.so"), "{error}");
    }

    #[test]
    fn a_file_that_is_no_library_is_named_with_what_to_do() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = if cfg!(target_os = "macos") { "libnothing.1.dylib" } else { "libnothing.so.1" };
        // Parts of the same library are not it.
        for name in [file, "libnothing_part.so"] {
            std::fs::write(folder.path().join(name), "not a library").expect("written");
        }
        let error = opened(folder.path());
        let start = format!("{} cannot be used as Nothing 1: ", folder.path().join(file).display());
        assert!(error.starts_with(&start) && error.contains("; mend it, or set NOTHING_DIR"), "{error}");
    }

    #[test]
    fn what_is_nowhere_is_not_found() {
        let error = NOTHING.open_in(None, |_| Ok(())).expect_err("nothing there");
        assert!(matches!(error, LoadError::NotFound { .. }) && error.to_string().contains("buy it"), "{error}");
    }
}
