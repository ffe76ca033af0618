//! The live side: scans as the driver delivers them. Level ones go to the mapper, tilted ones are kept for the cloud.

use std::ops::ControlFlow;
use std::path::Path;

use crate::cli::Failure;
use crate::cli::demo::DemoArgs;
use crate::cli::live_scans::ended;
use crate::cli::monitor::Watched;
use crate::config::About;
use crate::config::RunConfig;
use crate::config::RunReport;
use anyhow::{Result, anyhow};
use lrfslam_core::scan::RangeScan;
use lrfslam_core::slam::StepReport;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_host::output::ResultFolder;
use lrfslam_host::plural::count;
use lrfslam_host::pose_f64::PoseF64;
use lrfslam_host::results::report::{Ending, LaserCounts, Source};
use lrfslam_host::runs::map::{Beside, MapRun};
use lrfslam_host::scans::live::{Item, SourceReport, taken};
use lrfslam_host::scans::log::LogScan;

use super::live_cloud::LiveCloud;
use super::robot::SimulatedRobot;

/// Scans that are mapped before the robot departs.
const SCANS_AT_START: usize = 10;
/// From one line of progress to the next, on the drive's clock.
const PROGRESS: Duration = Duration::from_millis(5000);

/// All that came of a drive.
pub struct DriveRecord {
    /// Scans of the level laser, as they were mapped.
    pub level: Vec<LogScan>,
    /// Scans of the tilted laser.
    pub tilted: Vec<LogScan>,
    /// The mapper's report.
    pub report: RunReport,
}

/// See the [module](self).
pub struct DemoMapping<'a, 'm> {
    args: &'a DemoArgs,
    robot: &'a SimulatedRobot,
    config: RunConfig,
    map: MapRun<'m>,
    level: Vec<LogScan>,
    tilted: Vec<LogScan>,
    /// Where the building's frame is in the map's: the first scan is the map's origin.
    world_from_map: PoseF64,
    next_line: Instant,
    watched: Watched,
    live_cloud: Option<LiveCloud>,
    /// When the robot was seen last, on the drive's clock, and where.
    seen: Option<(Instant, PoseF64)>,
    fault: Option<anyhow::Error>,
}

impl<'a, 'm> DemoMapping<'a, 'm> {
    /// Nothing has come yet.
    pub fn new(
        (config, map): (&RunConfig, MapRun<'m>),
        (robot, mut watched): (&'a SimulatedRobot, Watched),
        args: &'a DemoArgs,
    ) -> Self {
        let (level, tilted) = (Vec::new(), Vec::new());
        let world_from_map = PoseF64::default();
        let next_line = Instant::default();
        let live_cloud = watched.feed().map(|_| LiveCloud::new(robot));
        Self {
            args,
            robot,
            config: *config,
            map,
            level,
            tilted,
            world_from_map,
            next_line,
            watched,
            live_cloud,
            seen: None,
            fault: None,
        }
    }

    /// Takes what the laser's thread delivers.
    pub fn take(&mut self, item: Item<'_>) -> ControlFlow<()> {
        match item {
            Item::Scan(scan) => self.take_scan(&scan),
            Item::Identified(identity) => self.say(identity.model.trim()),
            Item::Said(text) => self.say(text),
        }
        if self.fault.is_some() || self.has_ended() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn take_scan(&mut self, scan: &RangeScan<'_>) {
        let kept = taken(scan, (self.level.len() + self.tilted.len()) as u64 + 1);
        let end = scan.beams.iter().map(|beam| scan.stamp + beam.offset).max().unwrap_or(scan.stamp);
        if !self.robot.is_level(scan.stamp, end) {
            self.tilted.push(kept);
            self.show_tilted(scan);
            return self.tell_progress(scan.stamp, None);
        }
        match self.map.add_scan(scan, self.robot.robot_from_lrf(), None) {
            Ok(step) => {
                self.level.push(kept);
                self.start(scan.stamp);
                self.show(scan, &step);
                self.tell_progress(scan.stamp, Some(PoseF64::from(step.map_from_robot)));
            }
            Err(error) => self.fault = Some(error),
        }
    }

    /// To those who look.
    fn show(&mut self, scan: &RangeScan<'_>, step: &StepReport) {
        self.seen = Some((self.robot.drive_time(scan.stamp), PoseF64::from(step.map_from_robot)));
        let Self { map, watched, robot, tilted, .. } = self;
        let beside = Beside { scans: tilted.len() as u64, ..Beside::default() };
        watched.show(|feed| map.show(feed, Some((scan, robot.robot_from_lrf(), step)), beside));
    }

    /// The same of a scan of the tilted laser, which is no scan of the map.
    fn show_tilted(&mut self, scan: &RangeScan<'_>) {
        let Self { map, watched, robot, tilted, .. } = self;
        if let (Some(feed), Some(cloud), Some(stands)) = (watched.feed(), &mut self.live_cloud, self.seen) {
            let scan = RangeScan { stamp: robot.drive_time(scan.stamp), ..*scan };
            feed.add_cloud(cloud.add(&scan, stands));
        }
        let beside = Beside { scans: tilted.len() as u64, ..Beside::default() };
        watched.show(|feed| map.show(feed, None, beside));
    }

    /// Lets those who look see the end.
    pub fn show_end(&mut self, ending: Ending, folder: &Path) {
        let beside = Beside { scans: self.tilted.len() as u64, ..Beside::default() };
        self.watched.finish(&ended(ending, folder), |feed| self.map.show(feed, None, beside));
    }

    /// The robot departs once the laser has proved that it is there.
    fn start(&mut self, stamp: Instant) {
        match self.level.len() {
            1 => self.world_from_map = self.robot.pose(stamp),
            SCANS_AT_START => self.robot.depart(stamp),
            _ => {}
        }
    }

    /// Something went wrong on the way.
    pub fn has_failed(&self) -> bool {
        self.fault.is_some()
    }

    /// The drive has come to its end.
    pub fn has_ended(&self) -> bool {
        let last = [self.level.last(), self.tilted.last()].into_iter().flatten().map(|scan| scan.stamp).max();
        let driven = last.map_or(Instant::default(), |stamp| self.robot.drive_time(stamp));
        self.robot.scenario.drive().end().is_some_and(|end| driven >= end)
            || self.args.seconds.is_some_and(|seconds| driven.as_secs_f64() >= seconds)
    }

    fn tell_progress(&mut self, stamp: Instant, map_from_robot: Option<PoseF64>) {
        let driven = self.robot.drive_time(stamp);
        if driven < self.next_line {
            return;
        }
        self.next_line = driven + PROGRESS;
        let truth = self.robot.pose(stamp);
        let now = match map_from_robot {
            Some(pose) => {
                let error = truth.between(self.world_from_map.then(pose));
                format!(
                    "{:.1} cm and {:.2}° off since the start",
                    error.distance_m() * 100.0,
                    error.heading.abs().to_degrees()
                )
            }
            None => format!("tilted by {:.0}°", self.robot.scenario.drive().tilt().tilt_rad(driven).to_degrees()),
        };
        let (scans, tilted) = (self.level.len(), self.tilted.len());
        self.say(&format!(
            "{:5.0} s  at {:5.1} {:5.1} m  {} mapped, {tilted} tilted; {now}",
            driven.as_secs_f64(),
            truth.x,
            truth.y,
            count(scans as u64, "scan")
        ));
    }

    fn say(&self, text: &str) {
        self.args.tell.say(text);
    }

    /// Writes the mapper's results into `folder`.
    pub fn finish(&mut self, report: &SourceReport, folder: &Path) -> Result<DriveRecord> {
        let report = self.map.write_into(folder, &about(&self.config, report, Ending::Complete, None))?;
        Ok(DriveRecord { level: self.level.clone(), tilted: self.tilted.clone(), report })
    }

    /// Writes the map of a drive that has not come to its end, where there is nothing to judge; says why it ended.
    pub fn leave(mut self, report: &SourceReport, folder: &mut ResultFolder) -> Failure {
        let fault = self.fault.take();
        let ending = if fault.is_some() { Ending::Failed } else { Ending::Interrupted };
        let about = about(&self.config, report, ending, fault.as_ref());
        let notice = match self.level.len() {
            0 => "no scan came: no results were written".to_owned(),
            scans => match folder.save(|stage| self.map.write_into(stage, &about)) {
                Ok(_) => format!(
                    "stopped after {}; partial results are in {}",
                    count(scans as u64, "scan"),
                    folder.named().display()
                ),
                Err(error) => return Failure::Work(error),
            },
        };
        match fault {
            Some(fault) => Failure::Work(fault.context(notice)),
            None => Failure::Interrupted(anyhow!(notice)),
        }
    }
}

fn about(config: &RunConfig, report: &SourceReport, ending: Ending, fault: Option<&anyhow::Error>) -> About {
    let laser = LaserCounts {
        damaged: report.counters.damaged,
        restarts: report.counters.restarts,
        incomplete: report.counters.incomplete,
        overrun: report.overrun,
        too_fast: 0,
    };
    let source = Source::Laser { port: "simulated".to_owned(), laser, recording: None };
    About { config: *config, source, odometry: false, ending, fault: fault.map(|fault| format!("{fault:#}")) }
}
