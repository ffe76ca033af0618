//! The command `lrfslam`.
#![forbid(unsafe_code)]

#[cfg(feature = "demo")]
mod demo;
#[cfg(not(feature = "demo"))]
#[path = "no_demo.rs"]
mod demo;

use std::process::ExitCode;

fn main() -> ExitCode {
    lrfslam_host::cli::run(std::env::args_os(), &demo::run)
}
