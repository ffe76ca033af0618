//! `lrfslam replay`: a recording as if live.

use std::path::PathBuf;

use clap::Args;

use super::Failure;
use super::live_scans::Mapping;
use super::record::RecordArgs;
use lrfslam_host::runs::scans::Scans;

/// Run a recording of a laser range finder again, as it was, or as fast as possible, as `lrfslam map` does.
#[derive(Debug, Args)]
pub(super) struct ReplayArgs {
    /// The recording that `lrfslam run` wrote: laser.rec among its results.
    file: PathBuf,
    /// As fast as possible.
    #[arg(long)]
    fast: bool,
    #[command(flatten)]
    record: RecordArgs,
    #[command(flatten)]
    mapping: Mapping,
}

pub(super) fn run(args: &ReplayArgs) -> Result<(), Failure> {
    let bag = args.record.bag(Some(&args.file))?;
    let plan = args.mapping.plan("replay", args.file.display().to_string())?.with_bag(bag);
    let sayer = plan.sayer();
    let scans = Scans::replay(&args.file, args.fast, plan.stop, sayer).map_err(Failure::Start)?;
    let config = plan.config;
    let scans = scans.within(config.log_options().range_max_m);
    plan.map(scans, || args.mapping.folder("run", &config))
}
