//! `curlsmoke regress`.

use crate::cli::frames::start_threads;
use crate::cli::progress::{Reporter, Style};
use crate::cli::render::conclude;
use crate::cli::signals::Signals;
use crate::cli::values::Memory;
use crate::cli::{DIFFERENT, log, print_result, warn_about};
use crate::error::Error;
use crate::output::exr::{self, Compression};
use crate::output::file::{check_writable, write_atomic};
use crate::progress::Progress;
use crate::regress::html::HtmlReport;
use crate::regress::junit::JunitReport;
use crate::regress::{self, CaseResult, RegressJob, reference, selected};
use crate::scene::suite::Suite;
use clap::Args;
use std::path::PathBuf;

/// The page of a report.
const PAGE: &str = "index.html";

/// Flags of `regress`.
#[derive(Debug, Args)]
pub struct RegressArguments {
    /// The suite file (YAML)
    pub suite: PathBuf,
    /// Cases to run [default: all]; several with commas
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    pub only: Vec<String>,
    /// Make the references anew instead of comparing
    #[arg(long, conflicts_with_all = ["report", "junit"])]
    pub update: bool,
    /// Why the pictures should change, which references and their log keep
    #[arg(long, value_name = "TEXT", requires = "update")]
    pub reason: Option<String>,
    /// Write a page with all pictures and figures to this folder, and the pictures of
    /// cases that fail
    #[arg(long, value_name = "FOLDER", verbatim_doc_comment)]
    pub report: Option<PathBuf>,
    /// Write the verdicts as JUnit XML
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// Run the commands of cases that have one, by the shell
    #[arg(long)]
    pub run_commands: bool,
    /// Threads [default: one for each processor]; results never depend on it
    #[arg(short = 'j', long, value_name = "COUNT")]
    pub threads: Option<usize>,
    /// How to show progress on standard error
    #[arg(long, value_enum, default_value_t = Style::None)]
    pub progress: Style,
    /// Refuse pictures that need more memory than this [GiB], as 4, 4G or 512M
    #[arg(long, value_name = "AMOUNT", default_value = "8")]
    pub memory_limit: Memory,
}

/// Runs a suite, or remakes its references; 0 when all cases pass, else [`DIFFERENT`].
pub(super) fn run(arguments: &RegressArguments) -> Result<u8, Error> {
    let suite =
        warn_about(Suite::load(&arguments.suite), |suite| suite.warnings.iter().map(ToString::to_string).collect())?;
    let job = RegressJob {
        only: arguments.only.clone(),
        run_commands: arguments.run_commands,
        memory_limit: arguments.memory_limit.bytes(),
    };
    selected(&suite, &job)?;
    start_threads(arguments.threads)?;
    let signals = Signals::listen().map_err(|e| Error::Internal(format!("signals cannot be caught: {e}")))?;
    let reporter = Reporter::new(arguments.progress, signals.clone());
    if arguments.update {
        let Some(reason) = &arguments.reason else {
            let text =
                "--update needs --reason \"why the pictures should change\", which references and their log keep";
            return Err(Error::Usage(text.into()));
        };
        let result = reference::update(&suite, &job, reason, &reporter, &mut |path| {
            reporter.suspend(|| print_result(&path.display().to_string()))
        });
        return conclude(result, &reporter, &signals);
    }
    let mut reports = Reports::new(arguments)?;
    let mut failed = 0usize;
    let result = regress::run(&suite, &job, &reporter, &mut |result| {
        failed += usize::from(!result.passed());
        result.warnings.iter().for_each(|warning| reporter.note(&format!("{}: warning: {warning}", result.name)));
        reporter.suspend(|| print_result(&line(&result)))?;
        reports.add(&result)
    });
    let code = conclude(result.and_then(|()| reports.write()), &reporter, &signals)?;
    Ok(if code == 0 && failed > 0 { DIFFERENT } else { code })
}

/// What is said of a case on standard output.
fn line(result: &CaseResult) -> String {
    let verdict = if result.passed() { "pass" } else { "FAIL" };
    let text = format!("{verdict}  {:<20} {:>6.2} s  {}", result.name, result.seconds, result.summary());
    if result.passed() || result.should_fail {
        return text;
    }
    format!("{text}\n      to accept it: {}", result.update_command)
}

/// The files that tell how it went.
struct Reports {
    page: Option<(PathBuf, HtmlReport)>,
    junit: Option<(PathBuf, JunitReport)>,
}

impl Reports {
    fn new(arguments: &RegressArguments) -> Result<Self, Error> {
        let title = arguments.suite.display().to_string();
        let page = arguments.report.as_ref().map(|folder| (folder.join(PAGE), HtmlReport::new(&title)));
        let junit = arguments.junit.as_ref().map(|path| (path.clone(), JunitReport::new(&title)));
        // Said before hours are spent.
        let paths = page.iter().map(|(path, _)| path).chain(junit.iter().map(|(path, _)| path));
        paths.into_iter().try_for_each(|path| check_writable(path))?;
        Ok(Self { page, junit })
    }

    fn add(&mut self, result: &CaseResult) -> Result<(), Error> {
        if let Some((_, report)) = &mut self.junit {
            report.add(result);
        }
        let Some((path, report)) = &mut self.page else { return Ok(()) };
        report.add(result)?;
        if let (false, Ok(compared)) = (result.passed(), &result.outcome) {
            let bytes = exr::write(&compared.image, Compression::Zip)?;
            write_atomic(&path.with_file_name(format!("{}.exr", result.name)), &bytes)?;
        }
        Ok(())
    }

    fn write(self) -> Result<(), Error> {
        if let Some((path, report)) = self.page {
            write_atomic(&path, report.finish().as_bytes())?;
            log(&format!("report: {}", path.display()));
        }
        if let Some((path, report)) = self.junit {
            write_atomic(&path, report.finish().as_bytes())?;
        }
        Ok(())
    }
}
