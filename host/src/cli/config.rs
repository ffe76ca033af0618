//! `lrfslam config`: the whole configuration, explained.

use std::path::PathBuf;

use clap::Args;

use super::{Failure, print};
use crate::config::RunConfig;

/// Print the whole configuration with meaning, unit, bounds and source of every value, ready to edit.
///
/// `lrfslam config > my.toml` makes a file for `lrfslam map --config my.toml`.
#[derive(Debug, Args)]
pub(super) struct ConfigArgs {
    /// Start from this file instead of the defaults.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Change one value; may be given more than once.
    #[arg(long, value_name = "SECTION.KEY=VALUE")]
    set: Vec<String>,
}

pub(super) fn run(args: &ConfigArgs) -> Result<(), Failure> {
    let config = RunConfig::load(args.config.as_deref(), &args.set).map_err(Failure::start)?;
    print(&config.to_commented_toml())
}
