//! The command `lrfslam`.
use std::process::ExitCode;

fn main() -> ExitCode {
    lrfslam_host::cli::run(std::env::args_os())
}
