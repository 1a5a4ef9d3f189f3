//! The program `curlsmoke`.

use std::process::ExitCode;

fn main() -> ExitCode {
    curlsmoke::cli::run().into()
}
