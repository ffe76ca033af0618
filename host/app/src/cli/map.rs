//! `lrfslam map`: log or recording in; trajectory, map, picture and report out.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;

use super::Failure;
use super::live_scans::Mapping;
use super::record::{RecordArgs, TfOdometryArgs, TopicArgs};
use super::shared::LOG;
use lrfslam_host::runs::scans::{Scans, is_stdin};
use lrfslam_host::scans::live::Say;
use lrfslam_host::scans::log::LogOptions;

/// Map a recorded laser log.
///
/// LOG is a CARMEN log (FLASER, ROBOTLASER1), a DP-SLAM log, tinySLAM's URG-04LX sample or one of a YDLIDAR X4, plain or gzip, a bag of ROS 2
/// (MCAP, .db3, or its folder) or ROS 1 (.bag), or a recording that `lrfslam run` has written. Written are trajectory.tum (the robot's pose for every scan, by time), map.pgm and map.yaml (for
/// ROS), map.png (for people), steps.csv (what the particle filter did), run.json and map.lrfslam (for `lrfslam localize`).
/// Ctrl-C ends the run early; what was mapped until then is written.
///
/// With --continue the robot starts where it was last, if that fits the map, else where it finds itself; a --start that does not fit is refused.
#[derive(Debug, Args)]
pub(super) struct MapArgs {
    #[arg(help = LOG)]
    log: PathBuf,
    /// Predict motion by the log's odometry; without this none of it is read.
    #[arg(long)]
    odometry: bool,
    #[command(flatten)]
    tf: TfOdometryArgs,
    #[command(flatten)]
    topic: TopicArgs,
    #[command(flatten)]
    record: RecordArgs,
    #[command(flatten)]
    mapping: Mapping,
}

pub(super) fn run(args: &MapArgs) -> Result<(), Failure> {
    let bag = args.record.bag(Some(&args.log))?;
    let odometry = args.odometry || args.tf.is_wanted();
    let plan = args.mapping.plan("map", args.log.display().to_string())?.with_odometry(odometry).with_bag(bag);
    let options = args.tf.with_odometry(args.topic.log_options(&plan.config)).map_err(Failure::Start)?;
    let scans = open_scans(&args.log, options, plan.stop, plan.sayer())?;
    let config = plan.config;
    plan.map(scans, || args.mapping.folder(&stem(&args.log, "map"), &config))
}

/// The scans of a log or a recording.
pub(super) fn open_scans(
    path: &Path,
    options: LogOptions,
    stop: &'static AtomicBool,
    say: Say,
) -> Result<Scans, Failure> {
    let scans = Scans::open(path, options, stop, say);
    scans.map_err(|error| match stop.load(Ordering::Relaxed) {
        true => Failure::Interrupted(anyhow::anyhow!("no scan came: no results were written")),
        false => Failure::Start(error),
    })
}

/// `intel.log.gz` and "map" → `intel-map`; standard input → `stdin-map`.
pub(super) fn stem(log: &Path, what: &str) -> String {
    if is_stdin(log) {
        return format!("stdin-{what}");
    }
    let name = log.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.split('.').find(|part| !part.is_empty()).unwrap_or("log");
    format!("{stem}-{what}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_named_after_the_log() {
        let named = |log: &str| stem(Path::new(log), "map");
        assert_eq!(named("data/intel.log.gz"), "intel-map");
        assert_eq!(named(".hidden"), "hidden-map");
        assert_eq!(named("/"), "log-map");
        assert_eq!((named("-"), named("./-")), ("stdin-map".to_owned(), "--map".to_owned()));
    }
}
