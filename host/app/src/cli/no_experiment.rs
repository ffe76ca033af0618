//! `lrfslam experiment` of a build without the experiments.

use std::ffi::OsString;

use clap::Args;

use super::{Failure, not_built_in};

/// Measure the methods on scans whose true path is known (not in this build).
#[derive(Debug, Args)]
#[command(disable_help_flag = true)]
pub(super) struct ExperimentArgs {
    /// Whatever the experiment would take, `--help` too.
    #[arg(hide = true, trailing_var_arg = true, allow_hyphen_values = true)]
    any: Vec<OsString>,
}

pub(super) fn run(_: &ExperimentArgs) -> Result<(), Failure> {
    Err(not_built_in("experiments", "experiments"))
}
