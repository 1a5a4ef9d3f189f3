//! Files that appear whole or not at all, however the program ends.
//!
//! Bytes go to a temporary name in the same folder, are synced, and then take the final name in one step of the file
//! system. A run that is killed leaves at most a temporary file, which the next run of the same target on the same machine
//! removes: its name holds machine and process, and processes of other machines cannot be looked up.

use crate::output::OutputError;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Writes a file whole; makes its folders. Whoever looks sees the old contents or the new, never a part.
///
/// # Errors
/// [`OutputError::Unwritable`] when the folder cannot be made or written or the disk is full; the temporary file is
/// removed and what was under the final name before is untouched.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    write_atomic_with(path, &mut |file| file.write_all(bytes))
}

/// As [`write_atomic`], for what is too large to be held at once: `write` is called once.
///
/// # Errors
/// As there, and with what `write` says.
pub fn write_atomic_with(
    path: &Path,
    write: &mut dyn FnMut(&mut dyn Write) -> io::Result<()>,
) -> Result<(), OutputError> {
    let unwritable = |cause: io::Error| OutputError::Unwritable { path: path.into(), cause };
    let name = path.file_name().ok_or_else(|| unwritable(io::ErrorKind::InvalidInput.into()))?.to_string_lossy();
    let folder = folder_of(path);
    fs::create_dir_all(&folder).map_err(|cause| OutputError::Unwritable { path: folder.clone(), cause })?;
    remove_stale(&folder, &name);
    let temporary = folder.join(temporary_name(&name, std::process::id()));
    let written = File::create(&temporary).and_then(|mut file| {
        write(&mut file)?;
        file.sync_all()
    });
    if let Err(cause) = written.and_then(|()| fs::rename(&temporary, path)) {
        // Nothing can be done about a failure here, and the first one is what matters.
        let _ = fs::remove_file(&temporary);
        return Err(unwritable(cause));
    }
    // Without this the name itself could be lost in a power cut. Some file systems cannot sync folders; the file is
    // whole either way.
    let _ = File::open(&folder).and_then(|folder| folder.sync_all());
    Ok(())
}

/// Makes sure, before hours are spent, that a file can be written: makes its folders and tries the temporary file.
///
/// # Errors
/// [`OutputError::Unwritable`] when not.
pub fn check_writable(path: &Path) -> Result<(), OutputError> {
    let folder = folder_of(path);
    let unwritable = |cause: io::Error| OutputError::Unwritable { path: path.into(), cause };
    check_no_folder(path)?;
    fs::create_dir_all(&folder).map_err(|cause| OutputError::Unwritable { path: folder.clone(), cause })?;
    let name = path.file_name().ok_or_else(|| unwritable(io::ErrorKind::InvalidInput.into()))?.to_string_lossy();
    let probe = folder.join(temporary_name(&name, std::process::id()));
    File::create(&probe).and_then(|_| fs::remove_file(&probe)).map_err(unwritable)
}

/// Makes sure that there is no folder where a file is to be.
///
/// # Errors
/// [`OutputError::Unwritable`] when there is.
pub fn check_no_folder(path: &Path) -> Result<(), OutputError> {
    if !path.is_dir() {
        return Ok(());
    }
    let cause = io::Error::new(io::ErrorKind::IsADirectory, "it is a folder");
    Err(OutputError::Unwritable { path: path.into(), cause })
}

/// The folder of a file, `.` where its path has none.
pub(crate) fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.into(),
        _ => PathBuf::from("."),
    }
}

/// `.NAME.tmp.MACHINE.PROCESS`.
fn temporary_name(name: &str, process: u32) -> String {
    format!(".{name}.tmp.{}.{process}", machine())
}

/// Name of this machine, of letters, digits and dashes alone; empty where the system does not say.
fn machine() -> String {
    let name = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    name.trim().chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).take(64).collect()
}

/// Removes temporary files of this target that runs on this machine left which no longer live.
fn remove_stale(folder: &Path, name: &str) {
    let prefix = format!(".{name}.tmp.{}.", machine());
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let file_name = entry.file_name();
        let writer = file_name.to_str().and_then(|f| f.strip_prefix(&prefix)).and_then(|pid| pid.parse::<u32>().ok());
        if writer.is_some_and(|pid| pid != std::process::id() && !is_running(pid)) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Whether a process lives on this machine; unknown counts as living.
fn is_running(pid: u32) -> bool {
    !Path::new("/proc/self").exists() || Path::new("/proc").join(pid.to_string()).exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_is_written_into_folders_that_did_not_exist_and_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b/c.exr");
        write_atomic(&path, b"one").unwrap();
        write_atomic(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(names(path.parent().unwrap()), ["c.exr"]);
    }

    #[test]
    fn leftovers_of_dead_runs_go_and_those_of_living_ones_stay() {
        let folder = tempfile::tempdir().unwrap();
        // Process numbers end far below the first; process 1 always lives.
        let dead = 4_000_000_000;
        // On another machine that number may well live.
        let elsewhere = format!(".c.exr.tmp.{}x.{dead}", machine());
        let mut kept = vec![temporary_name("c.exr", 1), temporary_name("d.exr", dead), elsewhere, "c.exr".to_string()];
        for leftover in kept[..3].iter().chain([&temporary_name("c.exr", dead)]) {
            fs::write(folder.path().join(leftover), b"half").unwrap();
        }
        write_atomic(&folder.path().join("c.exr"), b"whole").unwrap();
        kept.sort();
        assert_eq!(names(folder.path()), kept);
    }

    #[test]
    fn a_place_that_cannot_be_written_is_named() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("file"), b"").unwrap();
        let below_a_file = folder.path().join("file/c.exr");
        for result in
            [write_atomic(&below_a_file, b""), check_writable(&below_a_file), write_atomic(folder.path(), b"")]
        {
            let error = result.unwrap_err();
            assert!(matches!(error, OutputError::Unwritable { .. }));
            assert!(error.to_string().contains(folder.path().to_str().unwrap()), "{error}");
        }
        assert!(check_writable(&folder.path().join("new/c.exr")).is_ok());
        assert_eq!(names(&folder.path().join("new")), Vec::<String>::new());
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_is_an_error_and_leaves_nothing() {
        // Writes to /dev/full fail as on a full disk; the temporary name is made to point there.
        let folder = tempfile::tempdir().unwrap();
        let temporary = folder.path().join(temporary_name("c.exr", std::process::id()));
        std::os::unix::fs::symlink("/dev/full", &temporary).unwrap();
        let error = write_atomic(&folder.path().join("c.exr"), b"whole").unwrap_err();
        assert!(error.to_string().contains("space"), "{error}");
        assert_eq!(names(folder.path()), Vec::<String>::new());
    }
}
