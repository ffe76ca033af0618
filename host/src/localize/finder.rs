//! Finds the robot anywhere in the map.
//!
//! Laser odometry in a frame of its own → submap of the latest way → [`Closer::find_on`], the strict search that loops are closed
//! with, over the whole map and all headings → believed if a second search, some metres farther on, says the same.

use lrfslam_core::filter::PointCapacityError;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::laser_odometry::{LaserOdometry, OdometryMemory};
use lrfslam_core::ndt::NdtMemoryError;
use lrfslam_core::scan::RangeScan;
use lrfslam_core::sweep::Sweep;

use super::tracker::way_m;
use super::{KnownMap, LocalizeConfig, LocalizerConfig};
use crate::places::closing::{Closer, Effort};
use crate::places::submap::Submap;
use crate::scans::store::ScanStore;

/// Scans of the submap are so far apart, by way, m.
const SCANS_APART_M: f32 = 0.1;

/// After the first search, searches are so much way apart, m: chosen.
const SEARCH_EVERY_M: f32 = 2.0;
/// Latest way that is searched for, m: chosen.
const QUERY_TRAVEL_M: f32 = 10.0;
/// Points of its submap that are used; time is in proportion. Chosen.
const SEARCH_POINTS: usize = 150;
/// A second search at least this much farther on must say the same, m …
const CONFIRMED_AFTER_M: f32 = 2.0;
/// … within this, m …
const AGREEMENT_M: f32 = 0.4;
/// … and this, degrees. All chosen.
const AGREEMENT_DEG: f32 = 3.0;

/// A scan of the submap.
#[derive(Debug, Clone, Copy)]
struct Station {
    local_from_robot: Pose2,
    way_m: f32,
    scan: u32,
}

/// Where a search has found the robot.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    map_from_local: Pose2,
    way_m: f32,
}

/// See the [module](self).
#[derive(Debug)]
pub(super) struct Finder<'m> {
    config: LocalizeConfig,
    range_max_m: f32,
    odometry: LaserOdometry<'m>,
    closer: Closer,
    scans: ScanStore,
    stations: Vec<Station>,
    way_m: f32,
    search_at_m: f32,
    candidate: Option<Candidate>,
    searches: u64,
}

impl<'m> Finder<'m> {
    pub(super) fn new(config: &LocalizerConfig, seed: u64, memory: OdometryMemory<'m>) -> Result<Self, NdtMemoryError> {
        Ok(Self {
            config: config.localize,
            range_max_m: config.closure.range_max_m,
            odometry: LaserOdometry::new(&config.slam.laser_odometry(), seed, memory)?,
            closer: Closer::new(&config.slam.ndt),
            scans: ScanStore::default(),
            stations: Vec::new(),
            way_m: 0.0,
            search_at_m: config.localize.search_after_m,
            candidate: None,
            searches: 0,
        })
    }

    /// Searches of the whole map so far.
    pub(super) fn searches(&self) -> u64 {
        self.searches
    }

    /// Way so far, m; a turn of a radian counts as half a metre.
    pub(super) fn way_m(&self) -> f32 {
        self.way_m
    }

    /// Where the robot is now as seen from where it was at the first scan, as laser odometry has it.
    pub(super) fn local_from_robot(&self) -> Pose2 {
        self.odometry.map_from_robot()
    }

    /// Forgets what was seen.
    pub(super) fn restart(&mut self) {
        self.odometry.restart_at(Pose2::IDENTITY);
        (self.scans, self.candidate) = (ScanStore::default(), None);
        self.stations.clear();
        (self.way_m, self.search_at_m) = (0.0, self.config.search_after_m);
    }

    /// Takes a scan; the robot's pose in the map if it has been found.
    pub(super) fn add_scan(
        &mut self,
        map: &KnownMap,
        scan: &RangeScan<'_>,
        robot_from_lrf: Pose2,
    ) -> Result<Option<Pose2>, PointCapacityError> {
        let before = self.odometry.map_from_robot();
        let step = self.odometry.step(scan, robot_from_lrf, None)?;
        let local_from_robot = step.matched.map_from_robot;
        self.way_m += way_m(before.between(local_from_robot));
        if step.is_lost {
            // What was seen before does not hang together with what comes now.
            self.candidate = None;
            self.stations.clear();
            self.search_at_m = self.way_m + self.config.search_after_m;
            return Ok(None);
        }
        if self.stations.last().is_none_or(|last| self.way_m - last.way_m >= SCANS_APART_M) {
            self.scans.add(&Sweep { scan: *scan, robot_from_lrf, motion: step.motion });
            self.stations.push(Station { local_from_robot, way_m: self.way_m, scan: self.scans.len() as u32 - 1 });
        }
        if self.way_m < self.search_at_m {
            return Ok(None);
        }
        self.search_at_m = self.way_m + SEARCH_EVERY_M;
        let found = self.search(map, local_from_robot);
        Ok(found.and_then(|map_from_robot| self.confirmed(map_from_robot, local_from_robot)))
    }

    fn search(&mut self, map: &KnownMap, local_from_robot: Pose2) -> Option<Pose2> {
        let (grid, window) = map.search_space()?;
        self.searches += 1;
        let from_m = self.way_m - QUERY_TRAVEL_M;
        let latest = self.stations.iter().filter(|station| station.way_m >= from_m);
        let robot_from_stations =
            latest.map(|station| (local_from_robot.between(station.local_from_robot), station.scan));
        let query = Submap::new(robot_from_stations, &self.scans, self.range_max_m);
        let LocalizeConfig { likelihood_min, second_share_max, .. } = self.config;
        let effort = Effort { likelihood_min, points: SEARCH_POINTS, second_share_max, second_misfits_min: None };
        let found = self.closer.find_on(grid, &query, map.walls(), window, effort)?;
        found.weak_axis.is_none().then_some(found.pose)
    }

    /// `map_from_robot` if an earlier search has said the same; otherwise it waits for a later one.
    fn confirmed(&mut self, map_from_robot: Pose2, local_from_robot: Pose2) -> Option<Pose2> {
        let new = Candidate { map_from_local: map_from_robot * local_from_robot.inverse(), way_m: self.way_m };
        let agrees = |old: &Candidate| {
            let error = (old.map_from_local * local_from_robot).between(map_from_robot);
            error.position().norm() <= AGREEMENT_M && error.heading.abs() <= AGREEMENT_DEG.to_radians()
        };
        match self.candidate.filter(agrees) {
            Some(old) if self.way_m - old.way_m >= CONFIRMED_AFTER_M => Some(map_from_robot),
            Some(_) => None,
            None => {
                self.candidate = Some(new);
                None
            }
        }
    }
}
