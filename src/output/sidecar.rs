//! The file beside each frame that says how it came about: written last, so that where it stands the frame is whole.
//!
//! Everything that depends on the machine or the hour is here and not in the picture, whose bytes are a pure function of
//! the scene.

use crate::output::file::{folder_of, write_atomic};
use crate::output::{OutputError, check_regular, read_bytes};
use crate::progress::Stage;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Longest sidecar that is read [bytes]; ours have a few thousand.
const LENGTH_MAX: u64 = 1 << 20;

/// How a frame came about.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Sidecar {
    /// Number of the frame.
    pub frame: i32,
    /// [`fingerprint`] of everything that the frame's pixels depend on.
    pub fingerprint: String,
    /// Version of the program.
    pub version: String,
    /// What the program was started with, its name first.
    pub arguments: Vec<String>,
    /// The scene file, as it was named.
    pub scene: String,
    /// SHA-256 of the scene file, in hexadecimal digits.
    pub scene_sha256: String,
    /// Keys of the scene that flags have set, in order: key and value.
    pub overrides: Vec<(String, String)>,
    /// Seed of the scene.
    pub seed: u64,
    /// Size of the whole picture [pixels].
    pub resolution: [u32; 2],
    /// The part of it that was rendered, where it is a part: first column and row, and one past the last.
    pub crop: Option<[i32; 4]>,
    /// Tiles of the picture that were taken from a checkpoint; the times are without them.
    pub tiles_resumed: usize,
    /// The parts that it was merged from.
    pub parts: Vec<MergedPart>,
    /// The files of the frame, this one not included.
    pub files: Vec<WrittenFile>,
    /// Time spent by stage [s]; of a merged frame, by all its parts together.
    pub seconds: BTreeMap<String, f64>,
    /// Samples per pixel.
    pub spp: u32,
    /// Camera samples per second of rendering.
    pub samples_per_second: f64,
    /// Particles alive in the frame.
    pub particles: u64,
    /// Steps of particles that ended inside an obstacle and were put back on its wall: one particle may have many. Counted
    /// on the way to this frame from the one that the run made before. The first frame of a run, and any that comes before
    /// the one made last, has its run-up in it, from the birth of the oldest particle; its count is larger than that of the
    /// same frame in a sequence, though its particles are the same. Pictures for which particles are kept have the count of the
    /// first of them.
    pub penetrations: u64,
    /// Particles born, counted likewise.
    pub born: u64,
    /// Those of them that were born inside an obstacle and put on its wall.
    pub born_inside: u64,
    /// Share of paths that were cut at `render.max_bounces`, 0 to 1.
    pub truncated_paths: f64,
    /// Light lost so, in units of what every path would bring if all were lit by radiance 1: the throughput that cut
    /// paths still carried, averaged over all paths. 0 to 1; an estimate of the darkening in light that is alike from
    /// everywhere.
    pub truncated_light: f64,
    /// Voxels that hold density, and memory of the grid [bytes].
    pub grid: GridFigures,
    /// Where the particles' mass went [density·m³]; zeros for density from a file.
    pub mass: MassFigures,
    /// Largest memory that the process has had so far [bytes].
    pub memory_peak: u64,
    /// The machine.
    pub host: Host,
}

/// A part of the paths, traced by a run of its own.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct MergedPart {
    /// Name of its file, without the folder.
    pub name: String,
    /// Its first and last path of each pixel, from 1.
    pub samples: [u32; 2],
    /// What its run was started with.
    pub arguments: Vec<String>,
    /// Time spent by stage [s].
    pub seconds: BTreeMap<String, f64>,
    /// The machine.
    pub host: Host,
}

/// A file of the frame, as it was when written.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct WrittenFile {
    /// Name of the file, relative to the folder of the sidecar: `a.exr`, `../png/a.png`.
    pub name: String,
    /// Length [bytes].
    pub bytes: u64,
    /// SHA-256 of its contents, in hexadecimal digits.
    pub sha256: String,
}

/// Size of the density grid.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct GridFigures {
    /// Voxels that hold density.
    pub active_voxels: u64,
    /// Memory [bytes].
    pub bytes: u64,
}

/// Where the mass of the particles went [density·m³].
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct MassFigures {
    /// Of all particles.
    pub particles: f64,
    /// In the grid: `particles − lost`, but for rounding.
    pub grid: f64,
    /// Taken away by obstacles, and then moved within the particles' kernels or lost.
    pub faded: f64,
    /// Lost because nothing of a particle's kernel could be seen from it. Part of `faded`.
    pub lost: f64,
}

/// The machine that a frame was made on.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Host {
    /// Its name.
    pub name: String,
    /// Operating system and processor architecture.
    pub system: String,
    /// Model of the processor.
    pub processor: String,
    /// Threads used.
    pub threads: usize,
    /// When the frame was finished [seconds since 1970].
    pub finished_unix: u64,
}

impl Sidecar {
    /// Adds the time spent in a stage.
    pub fn add_time(&mut self, stage: Stage, time: Duration) {
        *self.seconds.entry(stage.name().to_string()).or_default() += time.as_secs_f64();
    }

    /// Adds a file of the frame that was written with these contents.
    pub fn add_file(&mut self, sidecar: &Path, file: &Path, contents: &[u8]) {
        let name = name_beside(sidecar, file);
        self.files.push(WrittenFile { name, bytes: contents.len() as u64, sha256: sha256(contents) });
    }

    /// Writes the sidecar; call it when all other files of the frame stand.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), OutputError> {
        let mut text = serde_json::to_string_pretty(self)
            .map_err(|e| OutputError::Encoding { format: "JSON", problem: e.to_string() })?;
        text.push('\n');
        write_atomic(path, text.as_bytes())
    }

    /// Reads a sidecar.
    ///
    /// # Errors
    /// When it is missing, unreadable or not a sidecar.
    pub fn read(path: &Path) -> Result<Self, OutputError> {
        let bytes = read_bytes(path, LENGTH_MAX)?;
        serde_json::from_slice(&bytes).map_err(|e| OutputError::Invalid {
            path: path.into(),
            format: "sidecar",
            problem: e.to_string(),
        })
    }
}

/// The sidecar of a picture: the same name with the ending .json.
pub fn sidecar_path(image: &Path) -> PathBuf {
    image.with_extension("json")
}

/// One word for everything that a frame's pixels depend on: give the scene's text, the settings as changed on the
/// command line, the contents of files it names, the program's version and the frame, always in the same order.
pub fn fingerprint(parts: &[&[u8]]) -> String {
    let mut hash = Sha256::new();
    for part in parts {
        // The length keeps `ab, c` apart from `a, bc`.
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part);
    }
    hexadecimal(&hash.finalize())
}

/// SHA-256 in hexadecimal digits.
pub fn sha256(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

/// SHA-256 of a file's contents in hexadecimal digits, read piece by piece.
///
/// # Errors
/// When the file is missing or unreadable.
pub fn sha256_of_file(path: &Path) -> Result<String, OutputError> {
    let unreadable = |cause: std::io::Error| match cause.kind() {
        std::io::ErrorKind::NotFound => OutputError::Missing { path: path.into() },
        _ => OutputError::Unreadable { path: path.into(), cause },
    };
    check_regular(path).map_err(unreadable)?;
    let mut file = std::fs::File::open(path).map_err(unreadable)?;
    let mut hash = Sha256::new();
    let mut piece = vec![0; 1 << 16];
    loop {
        match std::io::Read::read(&mut file, &mut piece).map_err(unreadable)? {
            0 => return Ok(hexadecimal(&hash.finalize())),
            n => hash.update(&piece[..n]),
        }
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// The name of a file as seen from the folder of the sidecar. Absolute where there is no way from one to the other.
fn name_beside(sidecar: &Path, file: &Path) -> String {
    // Links are followed, because `..` behind a link leads out of the folder that the link points to.
    let real = |folder: &Path| std::fs::canonicalize(folder).or_else(|_| std::path::absolute(folder));
    let (Ok(from), Ok(to)) = (real(&folder_of(sidecar)), real(&folder_of(file))) else {
        return file.to_string_lossy().into_owned();
    };
    let shared = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    if shared == 0 {
        // Another drive.
        return to.join(file.file_name().unwrap_or_default()).to_string_lossy().into_owned();
    }
    let up = from.components().skip(shared).map(|_| "..".into());
    let down = to.components().skip(shared).map(|part| part.as_os_str().to_string_lossy());
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    up.chain(down).chain([name]).collect::<Vec<_>>().join("/")
}

/// Whether the frame with this sidecar is finished and would come out the same again: the sidecar stands, has this
/// fingerprint, lists all of `files`, and every file it lists still has its length and contents. Anything unreadable
/// counts as unfinished.
pub fn is_complete(path: &Path, fingerprint: &str, files: &[PathBuf]) -> bool {
    let Ok(sidecar) = Sidecar::read(path) else { return false };
    let is_listed = |file: &PathBuf| {
        let name = name_beside(path, file);
        sidecar.files.iter().any(|listed| listed.name == name)
    };
    if !files.iter().all(is_listed) {
        return false;
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let stands = |file: &WrittenFile| {
        read_bytes(&folder.join(&file.name), file.bytes)
            .is_ok_and(|bytes| bytes.len() as u64 == file.bytes && sha256(&bytes) == file.sha256)
    };
    sidecar.fingerprint == fingerprint && !sidecar.files.is_empty() && sidecar.files.iter().all(stands)
}

/// What is known of this machine, with the number of threads in use.
pub fn this_host(threads: usize) -> Host {
    let line = |file: &str| std::fs::read_to_string(file).ok().map(|text| text.trim().to_string());
    let processor = line("/proc/cpuinfo")
        .and_then(|text| text.lines().find(|l| l.starts_with("model name")).map(str::to_string))
        .and_then(|l| l.split_once(':').map(|(_, model)| model.trim().to_string()));
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    Host {
        name: line("/proc/sys/kernel/hostname").unwrap_or_default(),
        system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        processor: processor.unwrap_or_default(),
        threads,
        finished_unix: now.as_secs(),
    }
}

/// Largest memory that this process has had [bytes]; 0 where the system does not say.
pub fn memory_peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kibibytes = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).and_then(|l| l.split_whitespace().next());
    kibibytes.and_then(|n| n.parse::<u64>().ok()).unwrap_or(0) * 1024
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_frame_is_complete_only_with_its_fingerprint_and_untouched_files() {
        let folder = tempfile::tempdir().unwrap();
        let image = folder.path().join("plume.0001.exr");
        let path = sidecar_path(&image);
        let print = fingerprint(&[b"scene", b"settings"]);
        let files = [image.clone()];
        assert!(!is_complete(&path, &print, &files));
        write_atomic(&image, b"pixels").unwrap();
        let mut sidecar = Sidecar { frame: 1, fingerprint: print.clone(), ..Sidecar::default() };
        sidecar.add_file(&path, &image, b"pixels");
        let preview = folder.path().join("png/small/plume.png");
        write_atomic(&preview, b"few pixels").unwrap();
        sidecar.add_time(Stage::Render, Duration::from_millis(1500));
        sidecar.write(&path).unwrap();
        assert_eq!(Sidecar::read(&path).unwrap(), sidecar);
        assert_eq!(sidecar.files[0].name, "plume.0001.exr");
        assert!(is_complete(&path, &print, &files));
        assert!(!is_complete(&path, &fingerprint(&[b"scene", b"changed"]), &files));
        for damage in [&b"pixelz"[..], b"pixel", b"pixels!"] {
            fs::write(&image, damage).unwrap();
            assert!(!is_complete(&path, &print, &files));
        }
        fs::write(&image, b"pixels").unwrap();
        // A file of this run that the sidecar does not know is still to be made.
        assert!(!is_complete(&path, &print, &[image.clone(), preview.clone()]));
        sidecar.add_file(&path, &preview, b"few pixels");
        assert_eq!(sidecar.files[1].name, "png/small/plume.png");
        sidecar.write(&path).unwrap();
        assert!(is_complete(&path, &print, &[image.clone(), preview]));
        fs::remove_file(&image).unwrap();
        assert!(!is_complete(&path, &print, &files));
        fs::write(&path, "{").unwrap();
        assert!(!is_complete(&path, &print, &files));
    }

    #[test]
    fn a_file_in_another_folder_is_named_from_the_sidecar() {
        let folder = tempfile::tempdir().unwrap();
        let (sidecar, file) = (folder.path().join("exr/a.json"), folder.path().join("png/a.png"));
        for path in [&sidecar, &file] {
            write_atomic(path, b"").unwrap();
        }
        assert_eq!(name_beside(&sidecar, &file), "../png/a.png");
        #[cfg(unix)]
        {
            // From behind a link the way up is that of the folder it points to.
            fs::create_dir_all(folder.path().join("far/away")).unwrap();
            std::os::unix::fs::symlink(folder.path().join("far/away"), folder.path().join("link")).unwrap();
            let name = name_beside(&folder.path().join("link/a.json"), &file);
            assert_eq!(name, "../../png/a.png");
            assert!(folder.path().join("link").join(name).exists());
        }
    }

    #[test]
    fn fingerprints_tell_parts_apart() {
        assert_ne!(fingerprint(&[b"ab", b"c"]), fingerprint(&[b"a", b"bc"]));
        assert_eq!(sha256(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn the_host_is_known() {
        assert!(memory_peak() > 1 << 20);
        assert!(!this_host(2).system.is_empty());
    }
}
