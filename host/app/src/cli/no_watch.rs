//! `lrfslam watch` of a build without the live page.

use clap::Args;

use super::{Failure, not_built_in};

/// Watch several robots on one page (not in this build).
#[derive(Debug, Args)]
pub(super) struct WatchArgs {
    #[arg(hide = true, num_args = 0.., trailing_var_arg = true, allow_hyphen_values = true)]
    rest: Vec<String>,
}

/// Says how to get it.
pub(super) fn run(_: &WatchArgs) -> Result<(), Failure> {
    Err(not_built_in("live page", "monitor"))
}
