//! `lrfslam replay`: a recording as if live.

use std::path::PathBuf;

use clap::Args;

use super::Failure;
use super::laser::interrupt_flag;
use super::live_scans::{Limits, deliver};
use crate::live::ScanSource;

/// Run a recording of a laser range finder again, as it was, or as fast as possible.
#[derive(Debug, Args)]
pub(super) struct ReplayArgs {
    /// The recording that `lrfslam run --record` wrote.
    file: PathBuf,
    /// As fast as possible.
    #[arg(long)]
    fast: bool,
    #[command(flatten)]
    limits: Limits,
}

pub(super) fn run(args: &ReplayArgs) -> Result<(), Failure> {
    let stop = interrupt_flag().map_err(Failure::Start)?;
    deliver(&ScanSource::Recording { path: args.file.clone(), fast: args.fast }, stop, &args.limits)
}
