//! The command `lrfslam`.
#![forbid(unsafe_code)]

mod demo;

use std::process::ExitCode;

fn main() -> ExitCode {
    lrfslam_host::cli::run(std::env::args_os(), &demo::run)
}
