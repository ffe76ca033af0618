//! `lrfslam map`: log in; trajectory, map, picture and report out.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::Failure;
use super::continuing::{ReadAhead, in_words, verified_start};
use super::laser::{interrupt_flag, say};
use super::localize::Start;
use super::out::{OutArgs, SaveArgs};
use super::particles::ParticleArgs;
use super::shared::{ConfigArgs, START, SeedArgs, TellArgs};
use super::summary::{partial_notice, summary};
use lrfslam_host::config::RunConfig;
use lrfslam_host::mapping::saved_map::SavedMap;
use lrfslam_host::output::ResultFolder;
use lrfslam_host::results::report::{Ending, Input, Source};
use lrfslam_host::runs::map::{About, MapRun, RunMemory};
use lrfslam_host::scans::log::{LogError, LogOptions, LogReader};

/// Map a recorded laser log.
///
/// LOG is a CARMEN log (FLASER, ROBOTLASER1), a DP-SLAM log or tinySLAM's URG-04LX sample, plain or gzip. Written are
/// trajectory.tum (the robot's pose for every scan, by time), map.pgm and map.yaml (for ROS), map.png (for people), steps.csv
/// (what the particle filter did), run.json and map.lrfslam (for `lrfslam localize`). Ctrl-C ends the run early; what was
/// mapped until then is written.
///
/// With --continue the robot starts where it was last, if that fits the map, else where it finds itself; a --start that does not fit is refused.
#[derive(Debug, Args)]
pub(super) struct MapArgs {
    /// The log; - reads it from standard input.
    log: PathBuf,
    #[command(flatten)]
    out: OutArgs,
    #[command(flatten)]
    save: SaveArgs,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    seed: SeedArgs,
    /// Go on with a map made before: its path, scans and configuration stay, and the log is added. Results go to --out.
    #[arg(long = "continue", value_name = "DIR")]
    continued: Option<PathBuf>,
    #[arg(long, value_name = "X,Y,DEG", help = START, requires = "continued", allow_hyphen_values = true, value_parser = super::localize::start)]
    start: Option<Start>,
    /// Believe --start without a look at the map: for a robot that begins where the map knows little.
    #[arg(long, requires = "start")]
    trust_start: bool,
    /// Predict motion by the log's odometry; without this none of it is read.
    #[arg(long)]
    odometry: bool,
    #[command(flatten)]
    particles: ParticleArgs,
    #[command(flatten)]
    tell: TellArgs,
}

pub(super) fn run(args: &MapArgs) -> Result<(), Failure> {
    let stop = interrupt_flag().map_err(Failure::Start)?;
    let saved = args.continued.as_deref().map(SavedMap::read).transpose().map_err(Failure::start)?;
    let defaults = saved.as_ref().map_or_else(RunConfig::default, |saved| saved.config);
    let config = args.particles.load_over(defaults, &args.config)?;
    let log = open_log(&args.log, config.log_options()).map_err(Failure::start)?;
    let mut scans = ReadAhead::new(log);
    let mut memory = RunMemory::new(&config, args.particles.threads());
    let mut map = MapRun::new(&config, args.seed.seed, &mut memory).map_err(Failure::Start)?;
    let mut start = args.start.and_then(Start::told);
    if let (Some(saved), Some(folder), false) = (&saved, &args.continued, args.trust_start) {
        let found = verified_start(saved, folder, (&config, args.seed.seed), args.start, &mut scans)?;
        if start.is_none() {
            args.tell.say(&format!("the log begins at {} in the map", in_words(found)));
        }
        start = Some(found);
    }
    let mut folder = args.out.folder(&stem(&args.log, "map"))?;
    if let (Some(saved), Some(folder)) = (&saved, &args.continued) {
        map.go_on(saved, folder, start).map_err(Failure::Start)?;
    }
    let progress = progress_bar(scans.log().size_bytes(), args.tell.is_quiet());
    let mut mapping = Mapping { args, config: &config, scans, folder: &mut folder, stop };
    let (ending, fault) = mapping.map_scans(&mut map, &progress);
    progress.finish_and_clear();
    let about = mapping.about(ending, fault.as_ref());
    let report = mapping.folder.save(|stage| map.write_into(stage, &about));
    let report = report.map_err(|error| Failure::Work(with_cause(error, fault.as_ref())))?;
    args.tell.print(&report, || summary(&report, folder.named()))?;
    let notice = || partial_notice(&report, folder.named());
    match (ending, fault) {
        (_, Some(fault)) => Err(Failure::Work(fault.context(notice()))),
        (Ending::Interrupted, None) => Err(Failure::Interrupted(anyhow::anyhow!(notice()))),
        _ => Ok(()),
    }
}

/// A log on its way into a map.
struct Mapping<'a> {
    args: &'a MapArgs,
    config: &'a RunConfig,
    scans: ReadAhead,
    folder: &'a mut ResultFolder,
    stop: &'a AtomicBool,
}

impl Mapping<'_> {
    /// Maps scan after scan until the log ends, the user has seen enough, or a fault ends it.
    fn map_scans(&mut self, map: &mut MapRun<'_>, progress: &ProgressBar) -> (Ending, Option<anyhow::Error>) {
        let bytes_read = self.scans.log().bytes_read();
        while let Some(scan) = self.scans.next() {
            let robot_from_lrf = |of: Option<_>| of.unwrap_or_else(|| self.config.robot_from_lrf());
            let added = scan.map_err(anyhow::Error::new).and_then(|scan| {
                let odometry = scan.map_from_robot_odometry.filter(|_| self.args.odometry);
                map.add_scan(&scan.scan(), robot_from_lrf(scan.robot_from_lrf), odometry)
            });
            if let Err(fault) = added {
                return (Ending::Failed, Some(fault));
            }
            if self.stop.load(Ordering::Relaxed) {
                return (Ending::Interrupted, None);
            }
            self.save_if_due(map);
            let rate = map.scans() as f64 / progress.elapsed().as_secs_f64().max(1e-6);
            progress.set_message(format!("{rate:.0} scans/s"));
            progress.set_position(bytes_read.get());
        }
        (Ending::Complete, None)
    }

    fn save_if_due(&mut self, map: &mut MapRun<'_>) {
        if self.folder.is_due(self.args.save.every()) {
            let about = self.about(Ending::Running, None);
            let saved = self.folder.save(|stage| map.write_into(stage, &about));
            self.folder.news(&saved).iter().for_each(|news| say(news));
        }
    }

    fn about(&mut self, ending: Ending, fault: Option<&anyhow::Error>) -> About {
        let log = self.scans.log();
        let input = match ending {
            Ending::Running => input_so_far(&self.args.log, log),
            _ => input(&self.args.log, log),
        };
        let source = Source::Log { input, log: log.counts(), range_max_m: log.range_max_m() };
        About { source, odometry: self.args.odometry, ending, fault: fault.map(|error| format!("{error:#}")) }
    }
}

/// The log at `path`, or from standard input.
pub(super) fn open_log(path: &Path, options: LogOptions) -> Result<LogReader, LogError> {
    if is_stdin(path) { LogReader::from_reader("-", std::io::stdin(), options) } else { LogReader::open(path, options) }
}

fn is_stdin(log: &Path) -> bool {
    log.as_os_str() == "-"
}

/// What the log is, while it is read.
fn input_so_far(path: &Path, log: &LogReader) -> Input {
    Input { name: path.display().to_string(), sha256: None, bytes: log.bytes_read().get(), format: log.format() }
}

/// What the log was, when it has been read.
pub(super) fn input(path: &Path, log: &mut LogReader) -> Input {
    let sha256 = Some(log.sha256());
    Input { sha256, ..input_so_far(path, log) }
}

/// A failed last write must not hide what went wrong before it.
fn with_cause(error: anyhow::Error, fault: Option<&anyhow::Error>) -> anyhow::Error {
    match fault {
        Some(fault) => error.context(format!("{fault:#}; then, while writing partial results")),
        None => error,
    }
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
        let named = |log: &str| stem(Path::new(log), "map");
        assert_eq!(named("data/intel.log.gz"), "intel-map");
        assert_eq!(named(".hidden"), "hidden-map");
        assert_eq!(named("/"), "log-map");
        assert_eq!((named("-"), named("./-")), ("stdin-map".to_owned(), "--map".to_owned()));
    }
}
