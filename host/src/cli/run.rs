//! `lrfslam run`: live from a laser.

use std::path::PathBuf;

use clap::Args;

use super::Failure;
use super::laser::{LaserArgs, interrupt_flag};
use super::live_scans::{Mapping, map_live};
use crate::live::ScanSource;

/// Map live from a laser range finder until ctrl-C, which stops the laser and writes the map.
#[derive(Debug, Args)]
pub(super) struct RunArgs {
    #[command(flatten)]
    laser: LaserArgs,
    /// Write every byte, both ways, with its time, to this file; `lrfslam replay` runs it again.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    #[command(flatten)]
    mapping: Mapping,
}

pub(super) fn run(args: &RunArgs) -> Result<(), Failure> {
    let stop = interrupt_flag().map_err(Failure::Start)?;
    let laser = args.laser.live(args.record.clone()).map_err(Failure::Start)?;
    let name = laser.address.to_string();
    map_live(&name, &ScanSource::Live(laser), stop, &args.mapping)
}
