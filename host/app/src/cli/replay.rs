//! `lrfslam replay`: a recording as if live.

use std::path::PathBuf;

use clap::Args;

use super::Failure;
use super::laser::interrupt_flag;
use super::live_scans::{Mapping, map_live};
use lrfslam_host::output::ResultFolder;
use lrfslam_host::scans::live::ScanSource;

/// Run a recording of a laser range finder again, as it was, or as fast as possible.
#[derive(Debug, Args)]
pub(super) struct ReplayArgs {
    /// The recording that `lrfslam run` wrote: laser.rec among its results.
    file: PathBuf,
    /// As fast as possible.
    #[arg(long)]
    fast: bool,
    #[command(flatten)]
    mapping: Mapping,
}

pub(super) fn run(args: &ReplayArgs) -> Result<(), Failure> {
    let stop = interrupt_flag().map_err(Failure::Start)?;
    let name = args.file.display().to_string();
    let source = |folder: &mut ResultFolder| {
        // Results of a recording may replace those beside it.
        folder.keep(&args.file);
        ScanSource::Recording { path: args.file.clone(), fast: args.fast }
    };
    map_live(&name, source, stop, &args.mapping)
}
