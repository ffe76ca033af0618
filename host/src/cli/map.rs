//! `lrfslam map`: log in; trajectory, map, picture and report out.

use std::path::{Path, PathBuf};

use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::localize::Start;
use super::particles::ParticleArgs;
use super::summary::summary;
use super::{Failure, print};
use crate::config::RunConfig;
use crate::log::{LogError, LogOptions, LogReader};
use crate::map_run::{MapRun, RunMemory};
use crate::run_report::{Input, RunReport, Source};
use crate::saved_map::SavedMap;

/// Map a recorded laser log.
///
/// LOG is a CARMEN log (FLASER, ROBOTLASER1), a DP-SLAM log or tinySLAM's URG-04LX sample, plain or gzip. Written are
/// trajectory.tum (the robot's pose for every scan, by time), map.pgm and map.yaml (for ROS), map.png (for people), steps.csv
/// (what the particle filter did), run.json and map.lrfslam (for `lrfslam localize`).
#[derive(Debug, Args)]
pub(super) struct MapArgs {
    /// The log; - reads it from standard input.
    log: PathBuf,
    /// Folder for the results; made if it is not there [default: the log's name with -map behind it, here].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Configuration; `lrfslam config` prints one.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Change one value of the configuration; may be given more than once.
    #[arg(long, value_name = "SECTION.KEY=VALUE")]
    set: Vec<String>,
    /// Start of the random numbers: the same seed gives the same map.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Go on with a map made before: its path, scans and configuration stay, and the log is added. Results go to --out.
    #[arg(long = "continue", value_name = "DIR")]
    continued: Option<PathBuf>,
    /// Where the robot starts in that map, m and degrees; `lrfslam localize` finds out [default: "end", where it was last].
    #[arg(long, value_name = "X,Y,DEG", requires = "continued", allow_hyphen_values = true, value_parser = super::localize::start)]
    start: Option<Start>,
    /// Predict motion by the log's odometry; without this none of it is read.
    #[arg(long)]
    odometry: bool,
    #[command(flatten)]
    particles: ParticleArgs,
    /// No progress bar and no summary.
    #[arg(long, short)]
    quiet: bool,
}

pub(super) fn run(args: &MapArgs) -> Result<(), Failure> {
    let saved = args.continued.as_deref().map(SavedMap::read).transpose().map_err(Failure::start)?;
    let defaults = saved.as_ref().map_or_else(RunConfig::default, |saved| saved.config);
    let config = args.particles.load_over(defaults, args.config.as_deref(), &args.set)?;
    let mut log = open_log(&args.log, config.log_options()).map_err(Failure::start)?;
    let out = args.out.clone().unwrap_or_else(|| folder_for(&args.log, "map"));
    let mut memory = RunMemory::new(&config, args.particles.threads());
    let mut map = MapRun::open(&out, &config, args.seed, &mut memory).map_err(Failure::Start)?;
    if let (Some(saved), Some(folder)) = (&saved, &args.continued) {
        map.go_on(saved, folder, args.start.and_then(Start::told)).map_err(Failure::Start)?;
    }
    let progress = progress_bar(log.size_bytes(), args.quiet);
    let fault = map_scans(&mut log, &mut map, &config, args.odometry, &progress).err();
    progress.finish_and_clear();
    let source = Source::Log { input: input(&args.log, &mut log), log: log.counts(), range_max_m: log.range_max_m() };
    let report = map.finish(source, args.odometry, fault.as_ref());
    let report = report.map_err(|error| Failure::Work(with_cause(error, fault.as_ref())))?;
    if !args.quiet {
        print(&summary(&report, &out))?;
    }
    match fault {
        None => Ok(()),
        Some(fault) => Err(Failure::Work(fault.context(partial_notice(&report, &out)))),
    }
}

/// Maps scan after scan until the log ends or a fault ends it early.
fn map_scans(
    log: &mut LogReader,
    map: &mut MapRun<'_>,
    config: &RunConfig,
    odometry: bool,
    progress: &ProgressBar,
) -> anyhow::Result<()> {
    let bytes_read = log.bytes_read();
    for scan in log.by_ref() {
        let scan = scan?;
        let robot_from_lrf = scan.robot_from_lrf.unwrap_or_else(|| config.robot_from_lrf());
        map.add_scan(&scan.scan(), robot_from_lrf, scan.map_from_robot_odometry.filter(|_| odometry))?;
        let rate = map.scans() as f64 / progress.elapsed().as_secs_f64().max(1e-6);
        progress.set_message(format!("{rate:.0} scans/s"));
        progress.set_position(bytes_read.get());
    }
    Ok(())
}

/// The log at `path`, or from standard input.
pub(super) fn open_log(path: &Path, options: LogOptions) -> Result<LogReader, LogError> {
    if is_stdin(path) { LogReader::from_reader("-", std::io::stdin(), options) } else { LogReader::open(path, options) }
}

fn is_stdin(log: &Path) -> bool {
    log.as_os_str() == "-"
}

/// What the log was, when it has been read.
pub(super) fn input(path: &Path, log: &mut LogReader) -> Input {
    let (sha256, format) = (log.sha256(), log.format());
    Input { name: path.display().to_string(), sha256, bytes: log.bytes_read().get(), format }
}

fn partial_notice(report: &RunReport, out: &Path) -> String {
    format!("stopped after {} scans; partial results are in {}", report.cost.scans, out.display())
}

/// A failed last write must not hide what went wrong before it.
fn with_cause(error: anyhow::Error, fault: Option<&anyhow::Error>) -> anyhow::Error {
    match fault {
        Some(fault) => error.context(format!("{fault:#}; then, while writing partial results")),
        None => error,
    }
}

/// `intel.log.gz` and "map" → `intel-map`; standard input → `stdin-map`.
pub(super) fn folder_for(log: &Path, what: &str) -> PathBuf {
    if is_stdin(log) {
        return PathBuf::from(format!("stdin-{what}"));
    }
    let name = log.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.split('.').find(|part| !part.is_empty()).unwrap_or("log");
    PathBuf::from(format!("{stem}-{what}"))
}

/// Bytes read of the log, with scans per second and, if its size is not 0, time left; hidden if stderr is not a terminal.
pub(super) fn progress_bar(size_bytes: u64, quiet: bool) -> ProgressBar {
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(10) };
    let bar = ProgressBar::with_draw_target((size_bytes > 0).then_some(size_bytes), target);
    let template = match size_bytes {
        0 => "{bytes} read  {msg}  {elapsed} gone",
        _ => "{bar:40} {percent:>3} %  {msg}  {elapsed} gone, {eta} left",
    };
    bar.with_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_named_after_the_log() {
        let named = |log: &str| folder_for(Path::new(log), "map").display().to_string();
        assert_eq!(named("data/intel.log.gz"), "intel-map");
        assert_eq!(named(".hidden"), "hidden-map");
        assert_eq!(named("/"), "log-map");
        assert_eq!((named("-"), named("./-")), ("stdin-map".to_owned(), "--map".to_owned()));
    }
}
