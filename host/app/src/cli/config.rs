//! `lrfslam config`: the whole configuration, explained.

use clap::Args;

use super::shared::ConfigArgs;
use super::{Failure, print};

/// Print the whole configuration with meaning, unit, bounds and source of every value, ready to edit.
///
/// `lrfslam config > my.toml` makes a file for `lrfslam map --config my.toml`.
#[derive(Debug, Args)]
pub(super) struct PrintArgs {
    #[command(flatten)]
    config: ConfigArgs,
}

pub(super) fn run(args: &PrintArgs) -> Result<(), Failure> {
    print(&args.config.load()?.to_commented_toml())
}
