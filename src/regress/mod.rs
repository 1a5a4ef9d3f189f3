//! Image tests: pictures of a suite are made, compared with their references layer by layer, and reported.
//!
//! The command `regress` and this project's own image tests both come here.

mod command;
pub mod html;
pub mod judge;
pub mod junit;
pub mod picture;
pub mod reference;

use crate::error::Error;
use crate::output::image::Image;
use crate::progress::Progress;
use crate::regress::judge::Judgement;
use crate::regress::picture::Making;
use crate::scene::suite::{Case, Suite, nearest_case};
use std::time::Instant;

/// What to do with a suite.
#[derive(Debug, Clone, Default)]
pub struct RegressJob {
    /// Names of the cases; all where there are none.
    pub only: Vec<String>,
    /// Run the commands of cases that have one.
    pub run_commands: bool,
    /// Most memory that reading a picture may take [bytes].
    pub memory_limit: u64,
}

/// How a case went.
#[derive(Debug)]
pub struct CaseResult {
    /// Its name.
    pub name: String,
    /// Whether the pictures had to differ.
    pub should_fail: bool,
    /// What comparing found, or why there was nothing to compare.
    pub outcome: Result<Compared, String>,
    /// What is likely a mistake.
    pub warnings: Vec<String>,
    /// How long it took [s].
    pub seconds: f64,
    /// The command that makes its reference anew.
    pub update_command: String,
}

/// Both pictures and what was found.
#[derive(Debug)]
pub struct Compared {
    /// The picture under test.
    pub image: Image,
    /// What it should look like, with its variances.
    pub reference: Image,
    /// What was found.
    pub judgement: Judgement,
}

impl CaseResult {
    /// Whether the case is as it should be.
    pub fn passed(&self) -> bool {
        self.outcome.as_ref().is_ok_and(|compared| match self.should_fail {
            // Pictures that cannot be laid over each other differ for another reason than the one that is tested.
            true => compared.judgement.is_comparable() && !compared.judgement.agree(),
            false => compared.judgement.agree(),
        })
    }

    /// In a line what is wrong, or what was found.
    pub fn summary(&self) -> String {
        match &self.outcome {
            Err(error) => error.clone(),
            Ok(compared) if self.should_fail && compared.judgement.agree() => {
                "the pictures agree, and must not".to_string()
            }
            Ok(compared) if self.should_fail && self.passed() => {
                format!("different, as they should be: {}", compared.judgement.summary())
            }
            Ok(compared) => compared.judgement.summary(),
        }
    }
}

/// The cases of a suite that a job is for.
///
/// # Errors
/// A name that no case has.
pub fn selected<'s>(suite: &'s Suite, job: &RegressJob) -> Result<Vec<(&'s str, Case)>, Error> {
    if let Some(name) = job.only.iter().find(|name| !suite.settings.cases.contains_key(*name)) {
        let near = nearest_case(suite, name).map(|near| format!("; did you mean {near}?")).unwrap_or_default();
        return Err(Error::Usage(format!("--only {name}: the suite has no such case{near}")));
    }
    Ok(suite.cases().filter(|(name, _)| job.only.is_empty() || job.only.iter().any(|only| only == name)).collect())
}

/// Makes and compares the pictures of a suite; calls `on_case` after each. What is wrong with a case is in its result.
///
/// # Errors
/// A name that no case has, and stopping.
pub fn run(
    suite: &Suite,
    job: &RegressJob,
    progress: &dyn Progress,
    on_case: &mut dyn FnMut(CaseResult) -> Result<(), Error>,
) -> Result<(), Error> {
    for (name, case) in selected(suite, job)? {
        on_case(run_case(suite, name, &case, job, progress)?)?;
    }
    Ok(())
}

/// Makes and compares the picture of one case.
///
/// # Errors
/// Stopping; all else is in the result.
pub fn run_case(
    suite: &Suite,
    name: &str,
    case: &Case,
    job: &RegressJob,
    progress: &dyn Progress,
) -> Result<CaseResult, Error> {
    let start = Instant::now();
    let mut warnings = Vec::new();
    let outcome = match compared(suite, name, case, job, progress, &mut warnings) {
        Err(error) if error.is_cancelled() => return Err(error),
        outcome => outcome.map_err(|error| error.to_string()),
    };
    Ok(CaseResult {
        name: name.into(),
        should_fail: case.should_fail,
        outcome,
        warnings,
        seconds: start.elapsed().as_secs_f64(),
        update_command: update_command(suite, name, case),
    })
}

fn compared(
    suite: &Suite,
    name: &str,
    case: &Case,
    job: &RegressJob,
    progress: &dyn Progress,
    warnings: &mut Vec<String>,
) -> Result<Compared, Error> {
    // Read first: it takes no time, and without it there is no need for the picture.
    let reference = reference::read(suite, case, job.memory_limit)?;
    let making = Making { suite, name, case, job };
    let mut image = making.picture(case.spp, case.seed.unwrap_or_default(), progress)?;
    reference::reconcile(&mut image, &reference);
    let judgement = judge::judge(&image, &reference, case, warnings).map_err(|e| Error::Usage(e.to_string()))?;
    Ok(Compared { image, reference, judgement })
}

fn update_command(suite: &Suite, name: &str, case: &Case) -> String {
    let commands = if case.command.is_some() { " --run-commands" } else { "" };
    format!("curlsmoke regress {} --only {name} --update --reason \"why\"{commands}", suite.path.display())
}
