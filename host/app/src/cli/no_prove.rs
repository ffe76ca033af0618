//! `lrfslam prove` of a build without the experiments.

use std::ffi::OsString;

use clap::Args;

use super::{Failure, not_built_in};

/// Repeat every published figure (not in this build).
#[derive(Debug, Args)]
#[command(disable_help_flag = true)]
pub(super) struct ProveArgs {
    /// Whatever it would take, `--help` too.
    #[arg(hide = true, trailing_var_arg = true, allow_hyphen_values = true)]
    any: Vec<OsString>,
}

pub(super) fn run(_: &ProveArgs) -> Result<(), Failure> {
    Err(not_built_in("prove", "experiments"))
}
