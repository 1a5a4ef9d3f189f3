//! The command line: one file for each verb, and what they share. Standard output is for results, standard error for
//! everything else.

mod args;
mod bake;
mod check;
mod compare;
mod denoise;
mod farm;
mod flow;
mod frames;
mod inspect;
mod merge;
mod pixel;
mod places;
mod points;
pub mod progress;
mod regress;
mod render;
mod sheet;
mod signals;
mod streamlines;
mod turntable;
mod values;
mod vary;
mod warp;
mod watch;
mod wedge;

use crate::cli::args::{Arguments, Verb};
use crate::error::Error;
use crate::output::OutputError;
use crate::scene::SceneError;
use clap::Parser;
use std::io::{ErrorKind, Write};

/// What is said when a signal has ended the work.
const STOPPED: &str = "stopped; finished frames are whole, and --resume goes on from there";

/// Exit code for pictures that differ.
const DIFFERENT: u8 = 7;

/// Runs the program with the arguments it was started with; returns its exit code.
pub fn run() -> u8 {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            return match error.print() {
                Err(cause) if !error.use_stderr() && cause.kind() != ErrorKind::BrokenPipe => {
                    let error = unprintable(cause);
                    report(&error);
                    error.exit_code()
                }
                // Help that nobody reads to the end is no failure.
                _ => u8::try_from(error.exit_code()).unwrap_or(2),
            };
        }
    };
    let result = match arguments.verb {
        Verb::Render(arguments) => render::run(&arguments),
        Verb::Merge(arguments) => merge::run(&arguments),
        Verb::Farm(verb) => farm::run(&verb),
        Verb::Watch(arguments) => watch::run(&arguments),
        Verb::Turntable(arguments) => turntable::run(arguments),
        Verb::Wedge(arguments) => wedge::run(&arguments),
        Verb::Check(arguments) => check::run(&arguments),
        Verb::Schema(arguments) => check::schema(&arguments),
        Verb::Bake(arguments) => bake::run(&arguments),
        Verb::Compare(arguments) => compare::run(&arguments),
        Verb::Inspect(arguments) => inspect::run(&arguments),
        Verb::Regress(arguments) => regress::run(&arguments),
        Verb::Denoise(arguments) => denoise::run(&arguments),
        Verb::Flow(verb) => flow::run(&verb),
        Verb::Streamlines(arguments) => streamlines::run(&arguments),
        Verb::Sheet(arguments) => sheet::run(&arguments),
        Verb::Warp(arguments) => warp::run(&arguments),
        Verb::Points(arguments) => points::run(&arguments),
    };
    match result {
        Ok(code) => code,
        Err(error) => {
            report(&error);
            error.exit_code()
        }
    }
}

/// Prints an error with all its causes.
fn report(error: &Error) {
    match error {
        // Says `error:` at each of its places.
        Error::Scene(error) => log(&error.to_string()),
        error => log(&format!("error: {error}")),
    }
}

/// Prints a line on standard error. A reader that went away is no failure.
fn log(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// What the program was started with.
fn command_line() -> Vec<String> {
    std::env::args_os().map(|argument| argument.to_string_lossy().into_owned()).collect()
}

/// Prints a result on standard output. A reader that went away is no failure, a full disk is.
fn print_result(text: &str) -> Result<(), Error> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(cause) if cause.kind() != ErrorKind::BrokenPipe => Err(unprintable(cause)),
        _ => Ok(()),
    }
}

fn unprintable(cause: std::io::Error) -> Error {
    OutputError::Unwritable { path: "standard output".into(), cause }.into()
}

/// Prints the warnings of a scene, or the scene's errors are the command's.
fn warn_about<T>(scene: Result<T, SceneError>, warnings: impl Fn(&T) -> Vec<String>) -> Result<T, Error> {
    let scene = scene?;
    for warning in warnings(&scene) {
        log(&warning);
    }
    Ok(scene)
}
