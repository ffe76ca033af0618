//! The loop over scans that `run` and `replay` share: every scan is mapped, and at the end the results are written.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use clap::Args;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::RangeScan;
use lrfslam_core::sweep::SpeedLimits;
use lrfslam_core::time::{Duration, Instant};

use super::laser::{say, source_failure};
use super::particles::ParticleArgs;
use super::summary::summary;
use super::{Failure, print};
use crate::config::{RunConfig, SpeedConfig};
use crate::live::{Item, ScanSource, SourceReport, for_each_scan};
use crate::map_run::{MapRun, RunMemory};
use crate::run_report::{LaserCounts, Source};

/// How to map, and when to end by itself.
#[derive(Debug, Args)]
pub(super) struct Mapping {
    /// Folder for the results; made if it is not there.
    #[arg(long, value_name = "DIR", default_value = "live-map")]
    out: PathBuf,
    /// Configuration; `lrfslam config` prints one.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Change one value of the configuration; may be given more than once.
    #[arg(long, value_name = "SECTION.KEY=VALUE")]
    set: Vec<String>,
    /// Start of the random numbers: the same seed and scans give the same map.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// End after so many scans.
    #[arg(long, value_name = "N")]
    scans: Option<u64>,
    /// End after so many seconds of scans.
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    #[command(flatten)]
    particles: ParticleArgs,
    /// No lines on the way; only the result.
    #[arg(long, short)]
    quiet: bool,
}

impl Mapping {
    /// Folder for the results.
    pub(super) fn out(&self) -> &Path {
        &self.out
    }
}

/// Maps every scan of `source` called `name`, and writes and prints what came out.
pub(super) fn map_live(name: &str, source: &ScanSource, stop: &AtomicBool, args: &Mapping) -> Result<(), Failure> {
    let config = args.particles.load(args.config.as_deref(), &args.set)?;
    let mut memory = RunMemory::new(&config, args.particles.threads());
    let map = MapRun::open(&args.out, &config, args.seed, &mut memory).map_err(Failure::Start)?;
    let mut session = Session::new(map, &config, args);
    let done = for_each_scan(source, stop, &mut |item| session.take(item));
    let report = done.map_err(source_failure)?;
    session.finish(name, &report)
}

/// One laser, one map.
struct Session<'a, 'm> {
    args: &'a Mapping,
    map: MapRun<'m>,
    robot_from_lrf: Pose2,
    watch: SpeedWatch,
    stamps: Option<(Instant, Instant)>,
    fault: Option<anyhow::Error>,
}

impl<'a, 'm> Session<'a, 'm> {
    fn new(map: MapRun<'m>, config: &RunConfig, args: &'a Mapping) -> Self {
        let robot_from_lrf = config.robot_from_lrf();
        let watch = SpeedWatch { config: config.speed, robot_from_lrf, too_fast: 0, last: None };
        Self { args, map, robot_from_lrf, watch, stamps: None, fault: None }
    }

    fn take(&mut self, item: Item<'_>) -> ControlFlow<()> {
        match item {
            Item::Scan(scan) => self.take_scan(&scan),
            Item::Identified(identity) if !self.args.quiet => say(identity.model.trim()),
            Item::Said(text) if !self.args.quiet => say(text),
            Item::Identified(_) | Item::Said(_) => {}
        }
        if self.fault.is_some() || self.is_enough() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn take_scan(&mut self, scan: &RangeScan<'_>) {
        let first = self.stamps.map_or(scan.stamp, |(first, _)| first);
        self.stamps = Some((first, scan.stamp));
        match self.map.add_scan(scan, self.robot_from_lrf, None) {
            Ok(step) => {
                let is_new = self.watch.is_too_fast(scan, step.odometry.matched.map_from_robot);
                if is_new && !self.args.quiet {
                    say("the robot moves faster than the laser's rate allows: the map suffers");
                }
            }
            Err(error) => self.fault = Some(error),
        }
    }

    fn is_enough(&self) -> bool {
        let seconds = self.stamps.map_or(0.0, |(first, last)| last.since(first).micros as f64 * 1e-6);
        self.args.scans.is_some_and(|scans| self.map.scans() as u64 >= scans)
            || self.args.seconds.is_some_and(|limit| seconds >= limit)
    }

    fn finish(self, name: &str, report: &SourceReport) -> Result<(), Failure> {
        let laser = LaserCounts {
            damaged: report.counters.damaged,
            restarts: report.counters.restarts,
            overrun: report.overrun,
            too_fast: self.watch.too_fast,
        };
        let source = Source::Laser { port: name.to_owned(), laser };
        let input_fault = report.input_fault().map(|fault| anyhow::anyhow!("{name}: {fault}"));
        let fault = self.fault.or(input_fault);
        let report = self.map.finish(source, false, fault.as_ref()).map_err(Failure::Work)?;
        print(&summary(&report, &self.args.out))?;
        fault.map_or(Ok(()), |fault| Err(Failure::Work(fault)))
    }
}

/// Compares the laser's motion with what its rate allows.
struct SpeedWatch {
    config: SpeedConfig,
    robot_from_lrf: Pose2,
    too_fast: u32,
    last: Option<(Instant, Pose2)>,
}

impl SpeedWatch {
    /// Takes the pose of the next scan; true when the robot has just become too fast.
    fn is_too_fast(&mut self, scan: &RangeScan<'_>, map_from_robot: Pose2) -> bool {
        let map_from_lrf = map_from_robot * self.robot_from_lrf;
        let Some((stamp, from)) = self.last.replace((scan.stamp, map_from_lrf)) else { return false };
        let dt = scan.stamp.since(stamp);
        let sweep = scan.beams.iter().map(|beam| beam.offset.micros.abs()).max().filter(|span| *span > 0);
        let period = sweep.map_or(dt, Duration::from_micros);
        // Stamps that lie closer together than half a sweep are jitter, and say nothing about the speed.
        if dt.micros < period.micros / 2 {
            return false;
        }
        let limits = SpeedLimits::new(period, self.config.error_m, self.config.error_deg.to_radians());
        let exceeds = limits.exceeded_by(from.between(map_from_lrf), dt).is_some();
        self.too_fast += u32::from(exceeds);
        exceeds && self.too_fast == 1
    }
}
