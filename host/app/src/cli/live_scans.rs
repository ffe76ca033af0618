//! The loop over scans that `run` and `replay` share: every scan is mapped, and the results are written on the way and at the end.

use std::io::IsTerminal as _;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration as WallDuration, Instant as WallInstant};

use anyhow::anyhow;
use clap::Args;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::RangeScan;
use lrfslam_core::sweep::SpeedLimits;
use lrfslam_core::time::{Duration, Instant};

use super::Failure;
use super::laser::{EndArgs, say, source_failure};
use super::out::{OutArgs, SaveArgs};
use super::particles::ParticleArgs;
use super::shared::{ConfigArgs, SeedArgs, TellArgs};
use super::summary::{partial_notice, summary};
use lrfslam_host::config::{RunConfig, SpeedConfig};
use lrfslam_host::output::{RECORDING, ResultFolder, shown};
use lrfslam_host::results::report::{Ending, LaserCounts, RecordingCounts, Source};
use lrfslam_host::runs::map::{About, MapRun, RunMemory};
use lrfslam_host::scans::driver::HostClock;
use lrfslam_host::scans::live::{Item, ScanSource, SourceReport, for_each_scan};

/// How to map, and when to end by itself.
#[derive(Debug, Args)]
pub(super) struct Mapping {
    #[command(flatten)]
    out: OutArgs,
    #[command(flatten)]
    save: SaveArgs,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    seed: SeedArgs,
    #[command(flatten)]
    end: EndArgs,
    #[command(flatten)]
    particles: ParticleArgs,
    #[command(flatten)]
    tell: TellArgs,
}

impl Mapping {
    /// Older results, and an older recording, may go.
    pub(super) fn overwrites(&self) -> bool {
        self.out.overwrites()
    }
}

impl Mapping {
    /// Says where a recording is that does not begin among the results: a kill would leave it there.
    pub(super) fn tell_where(&self, recording: &Path, folder: &ResultFolder) {
        let beside = folder.growing(RECORDING);
        if !self.tell.is_quiet() && recording == beside && beside.parent().is_some_and(|home| home != folder.place()) {
            say(&format!("recording to {} until there are results", shown(&beside).display()));
        }
    }
}

/// Maps every scan of a source called `name`, and writes and prints what came out.
///
/// * `source` — is told the folder of the results, once it is there
pub(super) fn map_live(
    name: &str,
    source: impl FnOnce(&mut ResultFolder) -> ScanSource,
    stop: &AtomicBool,
    args: &Mapping,
) -> Result<(), Failure> {
    let config = args.particles.load_over(RunConfig::default(), &args.config)?;
    let mut memory = RunMemory::new(&config, args.particles.threads());
    let map = MapRun::new(&config, args.seed.seed, &mut memory).map_err(Failure::Start)?;
    let mut folder = args.out.folder("run")?;
    let source = source(&mut folder);
    let mut session = Session::new(name, map, folder, &config, args);
    let done = for_each_scan(&source, stop, &mut |item| session.take(item));
    let report = done.map_err(source_failure)?;
    // A laser goes on until ctrl-C; what has an end of its own is ended early by it.
    let has_end = matches!(source, ScanSource::Recording { .. }) || args.end.has_end();
    let is_early = stop.load(Ordering::Relaxed) && has_end && report.input.is_none() && !session.is_enough();
    if session.map.scans() == 0 {
        let nothing = anyhow!("no scan came: no results were written");
        return Err(if stop.load(Ordering::Relaxed) { Failure::Interrupted(nothing) } else { Failure::Work(nothing) });
    }
    session.finish(&report, is_early)
}

/// From one line about a live run to the next.
const TELL_EVERY: WallDuration = WallDuration::from_secs(2);

/// One laser, one map.
struct Session<'a, 'm> {
    name: &'a str,
    args: &'a Mapping,
    map: MapRun<'m>,
    folder: ResultFolder,
    robot_from_lrf: Pose2,
    watch: SpeedWatch,
    stamps: Option<(Instant, Instant)>,
    clock: HostClock,
    /// When a line was last told, and how many scans there were then.
    told: (WallInstant, usize),
    fault: Option<anyhow::Error>,
}

impl<'a, 'm> Session<'a, 'm> {
    fn new(name: &'a str, map: MapRun<'m>, folder: ResultFolder, config: &RunConfig, args: &'a Mapping) -> Self {
        let robot_from_lrf = config.robot_from_lrf();
        let watch = SpeedWatch { config: config.speed, robot_from_lrf, too_fast: 0, last: None };
        let (clock, told) = (HostClock::default(), (WallInstant::now(), 0));
        Self { name, args, map, folder, robot_from_lrf, watch, stamps: None, clock, told, fault: None }
    }

    fn say(&self, text: &str) {
        self.args.tell.say(text);
    }

    fn take(&mut self, item: Item<'_>) -> ControlFlow<()> {
        match item {
            Item::Scan(scan) => self.take_scan(&scan),
            Item::Identified(identity) => self.say(identity.model.trim()),
            Item::Said(text) => self.say(text),
        }
        if self.fault.is_some() || self.is_enough() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn take_scan(&mut self, scan: &RangeScan<'_>) {
        let first = self.stamps.map_or(scan.stamp, |(first, _)| first);
        self.stamps = Some((first, scan.stamp));
        match self.map.add_scan(scan, self.robot_from_lrf, None) {
            Ok(step) => {
                if self.watch.is_too_fast(scan, step.odometry.matched.map_from_robot) {
                    self.say("the robot moves faster than the laser's rate allows: the map suffers");
                }
                self.tell_now_and_then(scan.stamp, step.map_from_robot);
                self.save_if_due();
            }
            Err(error) => self.fault = Some(error),
        }
    }

    /// On a terminal: where the robot is, how many scans a second, and how late they are mapped.
    fn tell_now_and_then(&mut self, stamp: Instant, map_from_robot: Pose2) {
        let ((at, scans_then), scans) = (self.told, self.map.scans());
        if self.args.tell.is_quiet() || at.elapsed() < TELL_EVERY || !std::io::stderr().is_terminal() {
            return;
        }
        self.told = (WallInstant::now(), scans);
        let rate = (scans - scans_then) as f64 / at.elapsed().as_secs_f64();
        let late_ms = self.clock.now().since(stamp).micros as f64 / 1e3;
        // A recording is not late.
        let late = if late_ms < 60_000.0 { format!(", mapped after {late_ms:.0} ms") } else { String::new() };
        let loops = self.map.high_counts().map_or(String::new(), |high| format!(", {} loops closed", high.closures));
        let Pose2 { x, y, heading } = map_from_robot;
        say(&format!(
            "{scans} scans, {rate:.1} a second{late}; robot at {x:.2} m, {y:.2} m, {:.0}°{loops}",
            heading.to_degrees()
        ));
    }

    fn save_if_due(&mut self) {
        if self.folder.is_due(self.args.save.every()) {
            // What the driver has counted is told at the end.
            let about =
                self.about(LaserCounts { too_fast: self.watch.too_fast, ..LaserCounts::default() }, Ending::Running);
            let saved = self.folder.save(|stage| self.map.write_into(stage, &about));
            self.folder.news(&saved).iter().for_each(|news| say(news));
        }
    }

    fn is_enough(&self) -> bool {
        let seconds = self.stamps.map_or(0.0, |(first, last)| last.since(first).micros as f64 * 1e-6);
        self.args.end.is_reached(self.map.scans(), seconds)
    }

    fn about(&self, laser: LaserCounts, ending: Ending) -> About {
        let source = Source::Laser { port: self.name.to_owned(), laser, recording: None };
        About { source, odometry: false, ending, fault: self.fault.as_ref().map(|error| format!("{error:#}")) }
    }

    /// Writes the results of at least one scan.
    fn finish(mut self, report: &SourceReport, is_early: bool) -> Result<(), Failure> {
        let laser = LaserCounts {
            damaged: report.counters.damaged,
            restarts: report.counters.restarts,
            overrun: report.overrun,
            too_fast: self.watch.too_fast,
        };
        let input_fault = report.input_fault().map(|fault| anyhow!("{}: {fault}", self.name));
        self.fault = self.fault.take().or(input_fault);
        let ending = match (&self.fault, is_early) {
            (Some(_), _) => Ending::Failed,
            (None, true) => Ending::Interrupted,
            (None, false) => Ending::Complete,
        };
        let mut about = self.about(laser, ending);
        if let Source::Laser { recording, .. } = &mut about.source {
            *recording = report.recording.as_ref().map(RecordingCounts::from);
        }
        let map = &mut self.map;
        let report = self.folder.save(|stage| map.write_into(stage, &about)).map_err(Failure::Work)?;
        self.args.tell.print(&report, || summary(&report, self.folder.named()))?;
        let notice = partial_notice(&report, self.folder.named());
        match self.fault {
            Some(fault) => Err(Failure::Work(fault.context(notice))),
            None if is_early => Err(Failure::Interrupted(anyhow!(notice))),
            None => Ok(()),
        }
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
