//! Does a log begin where it is said to, in a map made before? If nobody says, where does it begin?
//!
//! A told start is followed through the log's first metres by the tracker: what the laser sees must not contradict the map, and enough
//! of it must be in the map to tell. An untold one is searched for as any lost robot is, and then followed just so.

use lrfslam_core::geometry::Pose2;

use super::finder::Finder;
use super::tracker::{Tracker, way_m};
use super::{KnownMap, LocalizerConfig, LocalizerMemory};
use crate::scans::log::LogScan;

/// A robot is searched for along so much of its way, m; then the log is of another place.
const SEARCH_WAY_M: f32 = 60.0;
/// More of the points in known places than this where the map is free, and the start is wrong, or too much has changed to tell.
const CONTRADICTING_MAX: f32 = 0.05;
/// A told start may be off by so much, m …
const TOLD_WITHIN_M: f32 = 0.6;
/// … and rad.
const TOLD_WITHIN_RAD: f32 = 0.35;
/// Less of what the laser sees than this on the map's walls says nothing about the start.
pub(crate) const ON_WALLS_MIN: f32 = 0.2;

/// Scans of a log, in order, as often as they are wanted.
pub trait ScansAhead {
    /// Scan `index`, from 0; `None` behind the last one.
    ///
    /// # Errors
    /// If the log cannot be read so far.
    fn scan(&mut self, index: usize) -> anyhow::Result<Option<&LogScan>>;
}

/// How the first metres of a log lie in a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StartFit {
    /// Where the first scan was taken, in the map, as it was told.
    pub told: Pose2,
    /// And as it fits the map best near there.
    pub start: Pose2,
    /// It fits only farther off than a told start may be, or not before the robot was searched for.
    pub jumps: bool,
    /// Way that was looked at, m; a turn of a radian counts as half a metre.
    pub way_m: f32,
    /// Mean share of the scans' points on the map's walls.
    pub on_walls: f32,
    /// Mean share of the points in known places that stand where the map is free.
    pub contradicting: f32,
    /// Both are as they are where the start is right.
    pub fits: bool,
}

/// Judges starts; its memory and configuration are those of localisation.
#[derive(Debug)]
pub struct StartJudge<'a> {
    config: &'a LocalizerConfig,
    robot_from_lrf: Pose2,
    seed: u64,
    map: &'a KnownMap,
}

impl<'a> StartJudge<'a> {
    /// One for `map`; `robot_from_lrf` is where the laser sits in logs that do not tell it.
    pub fn new(config: &'a LocalizerConfig, robot_from_lrf: Pose2, seed: u64, map: &'a KnownMap) -> Self {
        Self { config, robot_from_lrf, seed, map }
    }

    /// Follows the log from `start` through its first metres.
    ///
    /// # Errors
    /// If the log cannot be read, or a scan or the map is too large for the memory.
    pub fn follow(&self, start: Pose2, scans: &mut dyn ScansAhead) -> anyhow::Result<StartFit> {
        let mut memory = LocalizerMemory::new(self.config);
        let mut tracker = Tracker::new(self.config, self.seed, memory.tracker.lend_odometry())?;
        tracker.restart_at(self.map, start)?;
        let (mut way, mut sums, mut weight, mut index) = (0.0, [0.0; 2], 0.0, 0);
        let (mut before, mut first, mut jumps) = (start, start, false);
        while let Some(scan) = scans.scan(index)?.filter(|_| way < self.config.localize.search_after_m) {
            let robot_from_lrf = scan.robot_from_lrf.unwrap_or(self.robot_from_lrf);
            let located = tracker.add_scan(self.map, &scan.scan(), robot_from_lrf)?.located;
            let moved = before.between(located.map_from_robot);
            jumps |= moved.position().norm() > TOLD_WITHIN_M || moved.heading.abs() > TOLD_WITHIN_RAD;
            let moved_m = way_m(moved);
            first = if index == 0 { located.map_from_robot } else { first };
            // The first scan speaks even if the robot never moves.
            let share = if index == 0 { 0.1 } else { moved_m };
            sums = [sums[0] + share * located.on_walls, sums[1] + share * located.contradicting];
            (before, way, weight, index) = (located.map_from_robot, way + moved_m, weight + share, index + 1);
        }
        let [on_walls, contradicting] = sums.map(|sum| sum / f32::max(weight, 1e-6));
        let agrees = on_walls >= ON_WALLS_MIN && contradicting <= CONTRADICTING_MAX;
        Ok(StartFit { told: start, start: first, jumps, way_m: way, on_walls, contradicting, fits: agrees && !jumps })
    }

    /// Searches the map for the log's start; `None` if it is nowhere to be found along the first 60 m of way.
    ///
    /// # Errors
    /// As [`follow`](Self::follow).
    pub fn find(&self, scans: &mut dyn ScansAhead) -> anyhow::Result<Option<StartFit>> {
        let mut memory = LocalizerMemory::new(self.config);
        let mut finder = Finder::new(self.config, self.seed, memory.finder.lend_odometry())?;
        finder.restart();
        let mut index = 0;
        while let Some(scan) = scans.scan(index)?.filter(|_| finder.way_m() < SEARCH_WAY_M) {
            let robot_from_lrf = scan.robot_from_lrf.unwrap_or(self.robot_from_lrf);
            if let Some(found) = finder.add_scan(self.map, &scan.scan(), robot_from_lrf)? {
                let start = found * finder.local_from_robot().inverse();
                return self.follow(start, scans).map(Some);
            }
            index += 1;
        }
        Ok(None)
    }
}
