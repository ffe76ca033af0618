//! `lrfslam map`: log in; trajectory, map, picture and report out.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration as WallDuration, Instant as WallInstant};

use anyhow::Context as _;
use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use lrfslam_core::scan::Echo;

use super::summary::summary;
use super::{Failure, print};
use crate::config::RunConfig;
use crate::log::{LogReader, LogScan};
use crate::map_io::{PGM_SIDE_MAX, write_map};
use crate::mapper::{Mapper, MapperMemory, MatchCounts};
use crate::occupancy_map::OccupancyMap;
use crate::output::{PendingFile, write_file};
use crate::picture::write_picture;
use crate::run_report::{BeamCounts, Cost, Input, Program, RunReport, peak_memory_bytes, sha256_of_file};
use crate::trajectory::TimedPose;

/// Map a recorded laser log.
///
/// LOG is a CARMEN log (FLASER, ROBOTLASER1), a DP-SLAM log or tinySLAM's URG-04LX sample, plain or gzip. Written are
/// trajectory.tum (the robot's pose for every scan), map.pgm and map.yaml (for ROS), map.png (for people) and run.json.
#[derive(Debug, Args)]
pub(super) struct MapArgs {
    /// The log.
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
    /// Predict motion by the log's odometry; without this none of it is read.
    #[arg(long)]
    odometry: bool,
    /// No progress bar and no summary.
    #[arg(long, short)]
    quiet: bool,
}

pub(super) fn run(args: &MapArgs) -> Result<(), Failure> {
    let mut job = Job::prepare(args).map_err(Failure::Start)?;
    let fault = job.work();
    let report = job.write_results(fault.as_ref()).map_err(|error| Failure::Work(with_cause(error, fault.as_ref())))?;
    if !args.quiet {
        print(&summary(&report, &job.out))?;
    }
    match fault {
        None => Ok(()),
        Some(fault) => Err(Failure::Work(fault.context(partial_notice(&report, &job.out)))),
    }
}

fn partial_notice(report: &RunReport, out: &Path) -> String {
    format!("stopped after {} scans; partial results are in {}", report.log.scans, out.display())
}

/// A failed last write must not hide what went wrong before it.
fn with_cause(error: anyhow::Error, fault: Option<&anyhow::Error>) -> anyhow::Error {
    match fault {
        Some(fault) => error.context(format!("{fault:#}; then, while writing partial results")),
        None => error,
    }
}

/// A run under way.
struct Job {
    args: JobArgs,
    config: RunConfig,
    input: Input,
    out: PathBuf,
    log: LogReader,
    matching: MatchCounts,
    map: OccupancyMap,
    trajectory_file: Option<PendingFile>,
    trajectory: Vec<TimedPose>,
    beams: BeamCounts,
    progress: ProgressBar,
    wall: WallDuration,
}

/// What the loop needs of the arguments.
struct JobArgs {
    seed: u64,
    odometry: bool,
}

impl Job {
    /// Everything that can be wrong from the start is found here, before the first scan is matched.
    fn prepare(args: &MapArgs) -> Result<Self, anyhow::Error> {
        let config = RunConfig::load(args.config.as_deref(), &args.set)?;
        let log = LogReader::open(&args.log, config.log_options())?;
        let out = args.out.clone().unwrap_or_else(|| default_folder(&args.log));
        let trajectory_file = open_folder(&out)?;
        let name = args.log.display().to_string();
        let sha256 = sha256_of_file(&args.log).with_context(|| format!("{name}: cannot be read"))?;
        let input = Input { name, sha256, bytes: log.size_bytes(), format: log.format() };
        Ok(Self {
            args: JobArgs { seed: args.seed, odometry: args.odometry },
            map: OccupancyMap::new(config.map),
            progress: progress_bar(log.size_bytes(), args.quiet),
            config,
            input,
            out,
            log,
            matching: MatchCounts::default(),
            trajectory_file: Some(trajectory_file),
            trajectory: Vec::new(),
            beams: BeamCounts::default(),
            wall: WallDuration::ZERO,
        })
    }

    /// Maps scan after scan until the log ends; returns the fault that ended it early.
    fn work(&mut self) -> Option<anyhow::Error> {
        let started = WallInstant::now();
        let mut memory = MapperMemory::new(&self.config);
        let fault = self.map_scans(&mut memory).err();
        self.wall = started.elapsed();
        self.progress.finish_and_clear();
        fault
    }

    fn map_scans(&mut self, memory: &mut MapperMemory) -> Result<(), anyhow::Error> {
        let mut mapper = Mapper::new(&self.config, self.args.seed, memory)?;
        let bytes_read = self.log.bytes_read();
        while let Some(scan) = self.log.next() {
            self.step(&scan?, &mut mapper)?;
            self.matching = mapper.counts();
            self.progress.set_position(bytes_read.get());
        }
        Ok(())
    }

    fn step(&mut self, scan: &LogScan, mapper: &mut Mapper<'_>) -> Result<(), anyhow::Error> {
        let robot_from_lrf = scan.robot_from_lrf.unwrap_or_else(|| self.config.robot_from_lrf());
        let step = mapper.add_scan(scan, robot_from_lrf, self.args.odometry)?;
        let map_from_robot = step.matched.map_from_robot;
        if !step.is_lost {
            self.map.insert(&scan.scan(), map_from_robot * robot_from_lrf);
        }
        self.beams.add(scan);
        let pose = TimedPose { stamp: scan.stamp, map_from_robot };
        self.trajectory.push(pose);
        if let Some(file) = &mut self.trajectory_file {
            pose.write_tum(file).with_context(|| cannot_write(&self.out.join("trajectory.tum")))?;
        }
        let rate = self.trajectory.len() as f64 / self.progress.elapsed().as_secs_f64().max(1e-6);
        self.progress.set_message(format!("{rate:.0} scans/s"));
        Ok(())
    }

    fn write_results(&mut self, fault: Option<&anyhow::Error>) -> Result<RunReport, anyhow::Error> {
        let out = &self.out;
        if let Some(file) = self.trajectory_file.take() {
            file.finish().with_context(|| cannot_write(&out.join("trajectory.tum")))?;
        }
        // Without a known cell there is nothing to draw; the report says how many beams hit.
        if let Some(raster) = self.map.raster(PGM_SIDE_MAX) {
            write_map(out, &raster).with_context(|| cannot_write(&out.join("map.pgm")))?;
        }
        if let Some(raster) = self.map.raster(self.config.map.picture_px) {
            let file = out.join("map.png");
            write_picture(&file, &raster, &self.trajectory).with_context(|| cannot_write(&file))?;
        }
        let report = self.report(fault);
        let file = out.join("run.json");
        let text = serde_json::to_string_pretty(&report)? + "\n";
        write_file(&file, text.as_bytes()).with_context(|| cannot_write(&file))?;
        Ok(report)
    }

    fn report(&self, fault: Option<&anyhow::Error>) -> RunReport {
        RunReport {
            program: Program::THIS,
            input: self.input.clone(),
            config: self.config,
            seed: self.args.seed,
            odometry: self.args.odometry,
            log: self.log.counts(),
            beams: self.beams,
            matching: self.matching,
            range_max_m: self.log.range_max_m(),
            cost: self.cost(),
            partial: fault.is_some(),
            fault: fault.map(|error| format!("{error:#}")),
        }
    }

    fn cost(&self) -> Cost {
        let stamps = self.trajectory.first().zip(self.trajectory.last()).map(|(a, b)| b.stamp.since(a.stamp));
        let timed = stamps.filter(|_| !self.log.counts().synthetic_times);
        let wall_s = self.wall.as_secs_f64();
        Cost {
            wall_s,
            scans_per_s: self.trajectory.len() as f64 / wall_s.max(1e-6),
            log_s: timed.map_or(0.0, |span| span.micros as f64 / 1e6),
            peak_memory_bytes: peak_memory_bytes(),
        }
    }
}

impl BeamCounts {
    fn add(&mut self, scan: &LogScan) {
        for beam in &scan.beams {
            match beam.echo {
                Echo::Hit(_) => self.hits += 1,
                Echo::Miss => self.misses += 1,
                Echo::Invalid => self.invalid += 1,
            }
        }
    }
}

/// `intel.log.gz` → `intel-map`.
fn default_folder(log: &Path) -> PathBuf {
    let name = log.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.split('.').find(|part| !part.is_empty()).unwrap_or("log");
    PathBuf::from(format!("{stem}-map"))
}

/// Makes the folder and starts the trajectory in it, which shows that it can be written to.
fn open_folder(out: &Path) -> Result<PendingFile, anyhow::Error> {
    let unusable = || format!("{}: cannot be used as output folder", out.display());
    fs::create_dir_all(out).with_context(unusable)?;
    PendingFile::create(&out.join("trajectory.tum")).with_context(unusable)
}

fn cannot_write(file: &Path) -> String {
    format!("{}: cannot be written", file.display())
}

/// Bytes read of the log, with scans per second and time left; hidden if stderr is not a terminal.
fn progress_bar(size_bytes: u64, quiet: bool) -> ProgressBar {
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(10) };
    let bar = ProgressBar::with_draw_target(Some(size_bytes), target);
    let template = "{bar:40} {percent:>3} %  {msg}  {elapsed} gone, {eta} left";
    bar.with_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_named_after_the_log() {
        let named = |log: &str| default_folder(Path::new(log)).display().to_string();
        assert_eq!(named("data/intel.log.gz"), "intel-map");
        assert_eq!(named(".hidden"), "hidden-map");
        assert_eq!(named("/"), "log-map");
    }
}
