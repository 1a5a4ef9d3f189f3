//! References: reading them with what is known of their noise, and making them anew.

use crate::error::Error;
use crate::math::statistics::Moments;
use crate::output::agreement::{RUNS_ATTRIBUTE, SPP_ATTRIBUTE, runs_of, spp_of};
use crate::output::exr::{self, Compression};
use crate::output::file::write_atomic;
use crate::output::image::{Attribute, Image, SampleKind};
use crate::output::layers::{layers_of, variance_name};
use crate::output::{OutputError, read_image};
use crate::progress::Progress;
use crate::regress::picture::Making;
use crate::regress::{RegressJob, selected};
use crate::scene::suite::{Case, Suite};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Fewest letters of a reason that somebody can make use of later.
pub const REASON_LENGTH_MIN: usize = 10;

/// Paths of a reference for each of the test's, where one picture makes it and nothing else is said.
const SPP_FACTOR: u32 = 16;

/// Where a reference is kept.
struct Files {
    mean: PathBuf,
    /// None where the variances are layers of the reference.
    variance: Option<PathBuf>,
}

impl Files {
    fn of(suite: &Suite, case: &Case) -> Self {
        let mean = suite.resolve(case.reference.as_deref().unwrap_or_default());
        let beside = mean.file_name().and_then(|name| name.to_str()).and_then(|name| name.strip_suffix(".mean.exr"));
        let beside = beside.map(|stem| mean.with_file_name(format!("{stem}.var.exr")));
        Self { variance: case.variance.as_ref().map(|file| suite.resolve(file)).or(beside), mean }
    }
}

/// The reference of a case with its variances as layers.
///
/// # Errors
/// When a file is missing, unreadable or of other pixels than its mean.
pub fn read(suite: &Suite, case: &Case, memory_limit: u64) -> Result<Image, Error> {
    let files = Files::of(suite, case);
    let missing = |error: OutputError| match error {
        OutputError::Missing { path } => {
            Error::Usage(format!("{}: there is no such reference; --update --reason \"why\" makes it", path.display()))
        }
        error => error.into(),
    };
    let mut reference = read_image(&files.mean, memory_limit).map_err(missing)?;
    // A file that stands in the suite must be there; one that is only looked for need not.
    let Some(path) = files.variance.filter(|path| case.variance.is_some() || path.exists()) else {
        return Ok(reference);
    };
    let variance = read_image(&path, memory_limit).map_err(missing)?;
    if (variance.data_origin, variance.data_size) != (reference.data_origin, reference.data_size) {
        let problem = "it has other pixels than the mean that it is for".to_string();
        return Err(OutputError::Invalid { path, format: "variance", problem }.into());
    }
    for name in [SPP_ATTRIBUTE, RUNS_ATTRIBUTE] {
        if let (None, Some(value)) = (reference.attribute(name), variance.attribute(name)) {
            let value = value.clone();
            reference.set_attribute(name, value);
        }
    }
    for channel in variance.channels {
        let is_named = channel.name.starts_with("variance.");
        let name = if is_named { channel.name.clone() } else { variance_name(&channel.name) };
        if reference.channel(&name).is_none() {
            reference.push(name, SampleKind::Float, channel.data);
        }
    }
    Ok(reference)
}

/// Brings picture and reference to one unit of samples where a reference was measured between pictures: its variance is the real
/// one, so that what the picture says of its own is not asked.
pub fn reconcile(image: &mut Image, reference: &Image) {
    if runs_of(reference).is_none() {
        return;
    }
    let known: Vec<String> = reference.channels.iter().map(|c| c.name.clone()).collect();
    image.channels.retain(|c| !c.name.starts_with("variance.") || !known.contains(&c.name));
    if spp_of(image).is_none() {
        image.set_attribute(SPP_ATTRIBUTE, Attribute::Int(1));
    }
}

/// Makes the references of a job's cases, but of those that should fail; calls `on_file` with each file. Adds the reason to the
/// log of the suite.
///
/// # Errors
/// What making or writing meets; references made before stay.
pub fn update(
    suite: &Suite,
    job: &RegressJob,
    reason: &str,
    progress: &dyn Progress,
    on_file: &mut dyn FnMut(&Path) -> Result<(), Error>,
) -> Result<(), Error> {
    if reason.trim().chars().count() < REASON_LENGTH_MIN {
        let text = format!("--reason must say why the pictures should change, in {REASON_LENGTH_MIN} letters or more");
        return Err(Error::Usage(text));
    }
    let mut made: Vec<(&str, PathBuf)> = Vec::new();
    for (name, case) in selected(suite, job)?.into_iter().filter(|(_, case)| !case.should_fail) {
        let files = Files::of(suite, &case);
        // Cases may share a reference.
        if made.iter().any(|(_, mean)| *mean == files.mean) {
            continue;
        }
        let reference = remade(&Making { suite, name, case: &case, job }, reason, progress)?;
        for (path, image) in files.divide(reference) {
            write_atomic(&path, &exr::write(&image, Compression::Zip)?)?;
            on_file(&path)?;
        }
        made.push((name, files.mean));
    }
    let names: Vec<&str> = made.iter().map(|(name, _)| *name).collect();
    if names.is_empty() {
        return Err(Error::Usage("no case has a reference to be made: all of them should fail".into()));
    }
    let path = suite.resolve(&suite.settings.log);
    let line = format!("- {}: {} ({})", today(), one_line(reason), listed(&names, suite, job));
    append(&path, &line)?;
    on_file(&path)
}

/// The names that were made, or that all were.
fn listed(names: &[&str], suite: &Suite, job: &RegressJob) -> String {
    let which = if job.only.is_empty() { format!("all {}", names.len()) } else { names.join(", ") };
    // Which suite, where a log is for several.
    let file = suite.path.file_name().unwrap_or_default().to_string_lossy();
    format!("{which} of {file}; curlsmoke {}", env!("CARGO_PKG_VERSION"))
}

fn one_line(reason: &str) -> String {
    reason.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn append(path: &Path, line: &str) -> Result<(), Error> {
    let mut text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => "# Why references were remade\n\n".to_string(),
        Err(cause) => return Err(OutputError::Unreadable { path: path.into(), cause }.into()),
    };
    if !text.ends_with('\n') {
        text.push('\n');
    }
    text += line;
    text.push('\n');
    Ok(write_atomic(path, text.as_bytes())?)
}

/// A new reference with its variances as layers.
fn remade(making: &Making, reason: &str, progress: &dyn Progress) -> Result<Image, Error> {
    let case = making.case;
    let remake = case.remake.unwrap_or_default();
    let spp = match (case.scene.is_some(), remake.spp) {
        (false, _) => None,
        (true, Some(spp)) => Some(spp),
        (true, None) => {
            let own = making.scene(case.spp, remake.seed)?.0.settings.film.spp;
            Some(if remake.runs == 1 { own.saturating_mul(SPP_FACTOR) } else { own })
        }
    };
    let mut image = making.picture(spp, remake.seed, progress)?;
    let per_run = spp_of(&image);
    if remake.runs > 1 {
        image = mean_of_runs(making, image, spp, progress)?;
    }
    let ignored = |name: &str| case.ignore.iter().flatten().any(|ignored| ignored == name);
    let kept: Vec<String> =
        layers_of(&image).into_iter().filter(|l| !ignored(&l.name)).flat_map(|l| l.channel_names()).collect();
    let mut reference =
        Image { size: image.size, data_origin: image.data_origin, data_size: image.data_size, ..Image::default() };
    for channel in std::mem::take(&mut image.channels) {
        let of = channel.name.strip_prefix("variance.").unwrap_or(&channel.name);
        if kept.iter().any(|name| name == of) {
            reference.push(channel.name, SampleKind::Float, channel.data);
        }
    }
    let text = |text: &str| Attribute::Text(text.into());
    let samples = per_run.map_or(f64::from(remake.runs), |spp| spp * f64::from(remake.runs));
    if per_run.is_some() || remake.runs > 1 {
        reference.set_attribute(SPP_ATTRIBUTE, Attribute::Int(samples.min(f64::from(i32::MAX)) as i32));
    }
    if remake.runs > 1 {
        reference.set_attribute(RUNS_ATTRIBUTE, Attribute::Int(remake.runs as i32));
    }
    // What the format holds is Latin-1.
    let reason: String = one_line(reason).chars().map(|c| if (c as u32) < 256 { c } else { '?' }).collect();
    reference.set_attribute("curlsmoke/reason", text(&reason));
    reference.set_attribute("curlsmoke/version", text(env!("CARGO_PKG_VERSION")));
    reference.set_attribute("curlsmoke/seed", text(&remake.seed.to_string()));
    Ok(reference)
}

/// Mean over pictures of consecutive seeds, and variance of that mean, of every channel.
fn mean_of_runs(making: &Making, first: Image, spp: Option<u32>, progress: &dyn Progress) -> Result<Image, Error> {
    let remake = making.case.remake.unwrap_or_default();
    let names: Vec<String> = layers_of(&first).iter().flat_map(|layer| layer.channel_names()).collect();
    let mut moments: Vec<Vec<Moments>> = vec![vec![Moments::default(); first.pixel_count()]; names.len()];
    let mut take = |image: &Image, seed: u64| -> Result<(), Error> {
        for (name, moments) in names.iter().zip(&mut moments) {
            let data = image.channel(name).filter(|data| data.len() == moments.len()).ok_or_else(|| {
                Error::Usage(format!("{}: the picture of seed {seed} has other pixels or layers", making.name))
            })?;
            moments.iter_mut().zip(data).for_each(|(m, &x)| m.push(f64::from(x)));
        }
        Ok(())
    };
    take(&first, remake.seed)?;
    for seed in (1..u64::from(remake.runs)).map(|i| remake.seed + i) {
        take(&making.picture(spp, seed, progress)?, seed)?;
    }
    let mut image = Image { channels: Vec::new(), ..first.clone() };
    for (name, moments) in names.iter().zip(moments) {
        // A distance to nothing is infinite in every picture, and sums of it are no numbers.
        let one = first.channel(name).unwrap_or_default();
        let mean = moments.iter().zip(one).map(|(m, &x)| if m.mean().is_finite() { m.mean() as f32 } else { x });
        image.push(name.clone(), SampleKind::Float, mean.collect());
        let variance = moments.iter().map(|m| if m.mean().is_finite() { m.variance_of_mean() as f32 } else { 0.0 });
        image.push(variance_name(name), SampleKind::Float, variance.collect());
    }
    Ok(image)
}

impl Files {
    /// The pictures to write: one, or one without and one of variances.
    fn divide(&self, mut reference: Image) -> Vec<(PathBuf, Image)> {
        let Some(path) = &self.variance else { return vec![(self.mean.clone(), reference)] };
        let mut variance = Image { channels: Vec::new(), ..reference.clone() };
        for channel in std::mem::take(&mut reference.channels) {
            match channel.name.strip_prefix("variance.") {
                Some(of) => variance.push(of, SampleKind::Float, channel.data),
                None => reference.push(channel.name, SampleKind::Float, channel.data),
            }
        }
        let mut files = vec![(self.mean.clone(), reference)];
        if !variance.channels.is_empty() {
            files.push((path.clone(), variance));
        }
        files
    }
}

/// The date, as 2026-11-23, in UTC.
fn today() -> String {
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs());
    let [year, month, day] = civil(seconds / 86_400);
    format!("{year:04}-{month:02}-{day:02}")
}

/// Year, month and day of a number of days since 1970, by counting in eras of 400 years that begin in March.
fn civil(days: u64) -> [u64; 3] {
    let days = days + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year + year / 4 - year / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    [era * 400 + year + u64::from(month <= 2), month, day_of_year - (153 * shifted + 2) / 5 + 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_have_their_dates() {
        assert_eq!(civil(0), [1970, 1, 1]);
        assert_eq!(civil(11_016), [2000, 2, 29]);
        assert_eq!(civil(20_780), [2026, 11, 23]);
    }

    #[test]
    fn variances_go_to_their_own_file_where_there_is_one() {
        let mut image = Image::new([1, 1]);
        for name in ["R", "variance.R", "albedo.R"] {
            image.push(name, SampleKind::Float, vec![0.0]);
        }
        let one = Files { mean: "a.exr".into(), variance: None }.divide(image.clone());
        assert_eq!(one.len(), 1);
        let two = Files { mean: "a.mean.exr".into(), variance: Some("a.var.exr".into()) }.divide(image);
        let names = |i: usize| two[i].1.channels.iter().map(|c| c.name.as_str()).collect::<Vec<_>>();
        assert_eq!((names(0), names(1)), (vec!["R", "albedo.R"], vec!["R"]));
    }
}
