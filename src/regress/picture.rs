//! The pictures under test: rendered here, made by a command, or found.

use crate::error::Error;
use crate::output::film_image::{Origin, image_of_film};
use crate::output::image::{Image, SampleKind};
use crate::output::{OutputError, read_image};
use crate::pipeline;
use crate::progress::Progress;
use crate::regress::{RegressJob, command};
use crate::render;
use crate::scene::Scene;
use crate::scene::settings::Aov;
use crate::scene::suite::{Case, OUTPUT_PLACEHOLDER, PATHS_DEFAULT, SEED_PLACEHOLDER, Suite, parse_override};
use std::path::{Path, PathBuf};

/// What a picture is made from.
#[derive(Debug, Clone, Copy)]
pub struct Making<'a> {
    /// The suite.
    pub suite: &'a Suite,
    /// Name of the case.
    pub name: &'a str,
    /// The case, with what the defaults say.
    pub case: &'a Case,
    /// What is allowed.
    pub job: &'a RegressJob,
}

impl Making<'_> {
    /// The picture of a seed, with `spp` paths a pixel where it is rendered here, or [`PATHS_DEFAULT`] in all.
    ///
    /// # Errors
    /// What rendering, the command or reading meets.
    pub fn picture(&self, spp: Option<u32>, seed: u64, progress: &dyn Progress) -> Result<Image, Error> {
        if self.case.scene.is_some() {
            return self.render(spp, seed, progress);
        }
        match &self.case.command {
            Some(command) => self.run(command, seed, progress),
            None => self.found(),
        }
    }

    /// The scene of the case, with its variance among the layers. The smoke is that of the scene's own seed, whatever that of the
    /// light: two pictures must show the same thing.
    ///
    /// # Errors
    /// Those of the scene, and a frame that it does not have.
    pub fn scene(&self, spp: Option<u32>, seed: u64) -> Result<(Scene, i32), Error> {
        let path = self.suite.resolve(self.case.scene.as_deref().unwrap_or_default());
        let mut overrides: Vec<(String, String)> =
            self.case.set.iter().filter_map(|text| parse_override(text)).collect();
        let own = Scene::load_with(&path, &overrides)?.settings;
        if own.smoke.is_some() {
            overrides.push(("smoke.seed".into(), own.smoke_seed().to_string()));
        }
        let mut aovs = own.output.aovs;
        if !aovs.contains(&Aov::Variance) {
            aovs.push(Aov::Variance);
        }
        let aovs = serde_json::to_string(&aovs).map_err(|e| Error::Internal(e.to_string()))?;
        overrides.push(("output.aovs".into(), aovs));
        overrides.push(("render.seed".into(), seed.to_string()));
        overrides.push(("film.spp".into(), spp.unwrap_or_else(|| default_spp(own.film.size())).to_string()));
        let scene = Scene::load_with(&path, &overrides)?;
        let (first, last) = (scene.settings.frames.first, scene.settings.frames.last);
        let frame = self.case.frame.unwrap_or(first);
        if !(first..=last).contains(&frame) {
            let text = format!("{}: the scene has the frames {first} to {last}, not {frame}", path.display());
            return Err(Error::Usage(text));
        }
        Ok((scene, frame))
    }

    fn render(&self, spp: Option<u32>, seed: u64, progress: &dyn Progress) -> Result<Image, Error> {
        let (scene, frame) = self.scene(spp, seed)?;
        let film = pipeline::film(&scene, frame, None, progress)?;
        let frames = &scene.settings.frames;
        let origin = Origin {
            scene_hash: scene.text_hash.clone(),
            seed,
            frame,
            fps: frames.fps,
            shutter: frames.shutter,
            camera: render::build_view(&scene, frame, None).camera,
        };
        Ok(image_of_film(&film, SampleKind::Float, &origin))
    }

    fn run(&self, command: &str, seed: u64, progress: &dyn Progress) -> Result<Image, Error> {
        if !self.job.run_commands {
            let text = format!("the case runs `{command}`; allow that with --run-commands if you trust the suite");
            return Err(Error::Usage(text));
        }
        let place = Leftover::new(self.name, seed)?;
        let file = place.0.join("picture.exr");
        let quoted = format!("'{}'", file.display().to_string().replace('\'', "'\\''"));
        let line = command.replace(OUTPUT_PLACEHOLDER, &quoted).replace(SEED_PLACEHOLDER, &seed.to_string());
        let folder = self.suite.path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let (status, telling) = command::run(&line, folder, progress)?;
        if !status.success() {
            return Err(Error::Usage(format!("`{line}` ended with {status}: {telling}")));
        }
        Ok(read_image(&file, self.job.memory_limit)?)
    }

    fn found(&self) -> Result<Image, Error> {
        let path = self.suite.resolve(self.case.image.as_deref().unwrap_or_default());
        read_image(&path, self.job.memory_limit).map_err(|error| match error {
            OutputError::Missing { .. } => {
                Error::Usage(format!("{}: there is no such picture yet; render it first", path.display()))
            }
            error => error.into(),
        })
    }
}

/// Paths of a pixel that make the default of a picture of this size, at least as many as have a variance worth the name.
fn default_spp([width, height]: [u32; 2]) -> u32 {
    const SPP_MIN: u32 = 16;
    PATHS_DEFAULT.div_ceil(width.saturating_mul(height).max(1)).max(SPP_MIN)
}

/// A folder of its own for what a command writes, which goes with all that the command has left there.
struct Leftover(PathBuf);

impl Leftover {
    fn new(name: &str, seed: u64) -> Result<Self, Error> {
        let process = std::process::id();
        let folder = std::env::temp_dir().join(format!("curlsmoke-regress-{process}-{name}-{seed}"));
        std::fs::create_dir_all(&folder).map_err(|cause| OutputError::Unwritable { path: folder.clone(), cause })?;
        Ok(Self(folder))
    }
}

impl Drop for Leftover {
    fn drop(&mut self) {
        // What cannot be removed there is for the system to clean up.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_beside_the_frame_take_their_share_of_all_paths() {
        let folder = tempfile::tempdir().unwrap();
        let scene = "version: 1\ncamera: {position: [0, 0, 4], look_at: [0, 0, 0]}\nfilm: {resolution: [200, 100], overscan: \
                     100}\nlights: [{environment: {radiance: [1, 1, 1]}}]\n";
        std::fs::write(folder.path().join("a.yaml"), scene).unwrap();
        let text = "version: 1\ncases:\n  even: {scene: a.yaml, set: [film.overscan=0]}\n  wide: {scene: a.yaml}\n";
        let suite = Suite::from_text(text, &folder.path().join("s.yaml")).unwrap();
        let job = RegressJob { only: Vec::new(), run_commands: false, memory_limit: 1 << 20 };
        let spp: Vec<(String, u32)> = suite
            .cases()
            .map(|(name, case)| {
                let making = Making { suite: &suite, name, case: &case, job: &job };
                (name.into(), making.scene(None, 1).unwrap().0.settings.film.spp)
            })
            .collect();
        let paths = PATHS_DEFAULT;
        assert_eq!(spp, [("even".into(), paths / (200 * 100)), ("wide".into(), paths.div_ceil(400 * 300))]);
    }
}
