//! The command `lrfslam`.
#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    lrfslam_app::cli::run(std::env::args_os())
}
