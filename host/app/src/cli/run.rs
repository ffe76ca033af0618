//! `lrfslam run`: live from a laser.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::Args;

use super::Failure;
use super::laser::LaserArgs;
use super::live_scans::Mapping;
use super::shared::RECORD;
use lrfslam_host::output::{RECORDING, ResultFolder, keep_latest};
use lrfslam_host::runs::bag::{RunBag, is_mcap_name};
use lrfslam_host::runs::scans::Scans;
use lrfslam_host::scans::live::LiveLaser;
use lrfslam_host::scans::recording::RecordPlan;

/// Folders of runs begin so.
const STEM: &str = "run";

/// Map live from a laser range finder until ctrl-C, which stops the laser and writes the map.
#[derive(Debug, Args)]
pub(super) struct RunArgs {
    #[command(flatten)]
    laser: LaserArgs,
    #[arg(long, value_name = "FILE", conflicts_with = "no_record", help = RECORD)]
    record: Option<PathBuf>,
    /// Record nothing.
    #[arg(long, conflicts_with = "resume")]
    no_record: bool,
    /// Largest recording, megabytes (an hour of a SICK at 38400 baud fills 15, of a UTM-30LX 500); a full one ends, and the run goes on.
    #[arg(long, value_name = "MB", default_value_t = 2000, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    record_max: u64,
    /// Remove the oldest folders of earlier runs here, so that N are left with the one of this run.
    #[arg(long, value_name = "N", conflicts_with = "out", value_parser = clap::value_parser!(u16).range(1..))]
    keep_runs: Option<u16>,
    #[command(flatten)]
    mapping: Mapping,
}

impl RunArgs {
    /// Makes room for the folder of this run.
    fn remove_old_runs(&self) -> anyhow::Result<()> {
        let Some(keep) = self.keep_runs else { return Ok(()) };
        let removed = keep_latest(Path::new("."), STEM, usize::from(keep) - 1);
        for name in removed.context("runs of earlier cannot be removed")? {
            self.mapping.say(&format!("{name}: removed, since later runs are kept"));
        }
        Ok(())
    }

    /// One for the laser's bytes and all else.
    fn bag(&self) -> Option<RunBag> {
        self.record.as_deref().filter(|path| is_mcap_name(path)).map(|_| RunBag::live())
    }

    fn record(&self, folder: &ResultFolder, bag: Option<&RunBag>) -> anyhow::Result<Option<RecordPlan>> {
        if self.no_record {
            return Ok(None);
        }
        let path = self.record.clone().unwrap_or_else(|| folder.growing(RECORDING));
        self.mapping.tell_where(&path, folder);
        let (max_bytes, overwrite) = (self.record_max * 1_000_000, self.mapping.overwrites());
        let goes_on = self.mapping.resumes();
        anyhow::ensure!(!goes_on || bag.is_none(), "--resume goes on in a recording such as laser.rec, not in MCAP");
        anyhow::ensure!(!goes_on || path.exists(), "nothing to resume: there is no {}", path.display());
        let bag = bag.map(|bag| bag.file().clone());
        Ok(Some(RecordPlan { max_bytes, overwrite, goes_on, bag, ..RecordPlan::new(path) }))
    }
}

pub(super) fn run(args: &RunArgs) -> Result<(), Failure> {
    if args.laser.topic().is_some() {
        return of_topic(args);
    }
    let laser = args.laser.live().map_err(Failure::Start)?;
    let plan = args.mapping.plan("run", laser.address.to_string())?.with_bag(args.bag());
    args.remove_old_runs().map_err(Failure::Start)?;
    let folder = args.mapping.folder(STEM, &plan.config)?;
    let laser = LiveLaser { record: args.record(&folder, plan.bag.as_ref()).map_err(Failure::Start)?, ..laser };
    let sayer = plan.sayer();
    let scans = Scans::live(laser, plan.stop, sayer).within(plan.config.log_options().range_max_m);
    plan.map(scans, || Ok(folder))
}

/// A topic has no bytes of a laser: its scans are recorded as such, if that is asked for.
fn of_topic(args: &RunArgs) -> Result<(), Failure> {
    if args.mapping.resumes() {
        return Err(Failure::Start(anyhow::anyhow!("--resume goes on in a recording of a laser: a topic has none")));
    }
    let bag = args.record.as_deref().map(RunBag::at).transpose().map_err(Failure::Start)?;
    let plan = args.mapping.plan("run", args.laser.name())?.with_bag(bag).of_ros2();
    let scans = args.laser.scans(plan.config.log_options().range_max_m, plan.stop, plan.sayer())?;
    args.remove_old_runs().map_err(Failure::Start)?;
    let config = plan.config;
    plan.map(scans, || args.mapping.folder(STEM, &config))
}
