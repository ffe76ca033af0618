//! Laser odometry: scan after scan is matched, and the matches give the robot's path without any odometry.
//!
//! filter → predict (constant velocity, or odometry) → match against the reference → extend the reference. The
//! reference is the previous scan (the thesis), the recent key scans together, or the whole map so far.

use crate::de::{DeConfig, Member};
use crate::facing::face;
use crate::filter::{self, FilterConfig, PointCapacityError};
use crate::geometry::{Point2, Pose2};
use crate::matcher::{Match, MatcherConfig, RecoveryConfig, ScanMatcher, SearchConfig};
use crate::ndt::{DirectoryEntry, InsertReport, NdtConfig, NdtGrid, NdtMemoryError, NdtTile};
use crate::random::RandomStream;
use crate::scan::RangeScan;
use crate::sweep::{Sweep, SweepMotion};
use crate::time::{Duration, Instant};

mod agreement;
mod change;
mod course;
mod expectation;
mod finding;
#[cfg(feature = "witnesses")]
mod lone;
#[cfg(feature = "witnesses")]
mod new_ground;
mod open_axis;
mod pace;
mod reference;
mod sight;
#[cfg(feature = "witnesses")]
mod through;
mod walls;
#[cfg(feature = "witnesses")]
mod witnesses;

use self::course::{Course, Forecast};
use self::finding::Found;
#[cfg(feature = "witnesses")]
pub use self::lone::part_lone;
pub use self::reference::KeyScan;
use self::reference::Taken;
use self::sight::Sight;

crate::config_choice! {
    /// What a scan is matched against.
    pub enum Reference {
        /// The previous scan alone (the thesis).
        PreviousScan = "previous-scan",
        /// The scans of the last 60 m together. Particles close loops then, each in its own map.
        RecentScans = "recent-scans",
        /// Everything seen so far.
        WholeMap = "whole-map",
    }
    choices "\"previous-scan\", \"recent-scans\" or \"whole-map\""
}

crate::config! {
    /// Laser odometry.
    pub struct OdometryConfig {
        /// What a scan is matched against. The thesis: "previous-scan".
        reference: Reference = Reference::WholeMap;
        /// Corrects each beam for the robot's motion during the sweep, where the scan tells the beams' times. The pose is then
        /// that of the middle of the sweep.
        deskew: bool = true;
        /// Earlier scans that are asked whether a hit stands where nothing was: what moves stays out of the whole map. 0: all is map.
        witnesses: u16 = 4, in 0..=16;
    }
}

/// Key scans kept with [`Reference::RecentScans`], fewer if there is memory for fewer: those of 60 m at 0.05 m, and of turns.
const RECENT_SCANS: usize = 1500;
/// The reference is extended after this much travel, m …
const KEY_DISTANCE_M: f32 = 0.05;
/// … or this much rotation, degrees: chosen; the thesis extends it by every scan.
const KEY_ROTATION_DEG: f32 = 2.0;
/// The first so many scans all go into the reference: the first one alone is thin and noisy. Chosen.
const SETTLING_SCANS: u32 = 10;
/// After so long without a scan that fits the robot may be anywhere.
const GAP: Duration = Duration::from_millis(5000);
/// While lost the reference is left alone, for this many scans at most: chosen.
const PATIENCE_SCANS: u16 = 10;
/// Score per point that the first scans are measured by: chosen.
const SCORE_FIRST: f32 = 0.5;
/// Share of a scan's score per point in the usual one: it follows over about ten scans.
const SCORE_SHARE: f32 = 0.1;

impl OdometryConfig {
    /// Scans that are kept, to be removed again or as witnesses, for which there must be memory.
    pub fn key_scans(&self) -> usize {
        match self.reference {
            Reference::WholeMap => usize::from(self.witnesses),
            Reference::PreviousScan => 1,
            Reference::RecentScans => RECENT_SCANS,
        }
    }
}

/// The configuration of laser odometry with all its parts.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LaserOdometryConfig {
    /// Scan filter.
    pub filter: FilterConfig,
    /// Reference cells.
    pub ndt: NdtConfig,
    /// Search box.
    pub search: SearchConfig,
    /// Search effort.
    pub de: DeConfig,
    /// Matcher.
    pub matcher: MatcherConfig,
    /// Pipeline.
    pub odometry: OdometryConfig,
    /// When lost.
    pub recovery: RecoveryConfig,
}

/// Memory that [`LaserOdometry`] works in, lent by the caller.
#[derive(Debug)]
pub struct OdometryMemory<'m> {
    /// See [`NdtGrid::new`].
    pub directory: &'m mut [DirectoryEntry],
    /// See [`NdtGrid::new`].
    pub tiles: &'m mut [NdtTile],
    /// DE's population.
    pub population: &'m mut [Member<3>],
    /// Points of one filtered scan.
    pub points: &'m mut [Point2],
    /// Hits of one scan.
    pub hits: &'m mut [Point2],
    /// Scans that are kept: [`OdometryConfig::key_scans`], each as long as `points`.
    pub key_points: &'m mut [Point2],
    /// One for each of these scans.
    pub key_scans: &'m mut [KeyScan],
}

/// What one step did.
#[derive(Debug, Clone, Copy)]
pub struct OdometryReport {
    /// The match; its pose is where the robot is now.
    pub matched: Match,
    /// Where it was expected.
    pub predicted: Pose2,
    /// Points after the filter.
    pub points: usize,
    /// True if this scan went into the reference.
    pub is_key: bool,
    /// True if the scan agrees too little with the reference for the pose to be believed, or shows nothing.
    pub is_lost: bool,
    /// True if the scan shows nothing: the laser is covered.
    pub is_blind: bool,
    /// True if the scan repeats the ones before it to the bit: the laser is frozen, unless it is a simulated one that stands.
    pub is_frozen: bool,
    /// What the reference could not keep.
    pub inserted: InsertReport,
    /// How the robot was taken to move during the sweep.
    pub motion: SweepMotion,
}

/// Tracks a robot by its laser alone; see the [module](self).
#[derive(Debug)]
pub struct LaserOdometry<'m> {
    config: LaserOdometryConfig,
    /// Of the search.
    rng: RandomStream,
    ndt: NdtGrid<'m>,
    matcher: ScanMatcher<'m>,
    points: &'m mut [Point2],
    hits: &'m mut [Point2],
    key_points: &'m mut [Point2],
    key_scans: &'m mut [KeyScan],
    key_count: usize,
    /// Scans that rays were looked along of.
    turn: u32,
    map_from_robot: Pose2,
    map_from_key: Pose2,
    /// From key scan to key scan, m.
    way_m: f32,
    course: Course,
    last_stamp: Option<Instant>,
    last_interval: Duration,
    /// When a scan showed something last …
    seen_at: Option<Instant>,
    /// … and when one fitted.
    fitted_at: Option<Instant>,
    /// From scan to scan in the mean, s.
    usual_interval_s: f32,
    score_per_point: f32,
    scans: u32,
    lost_scans: u16,
    sight: Sight,
    /// Nobody knows whether the robot is still where it was.
    doubts: bool,
    /// Somebody else tells where it is then.
    is_told: bool,
    /// A scan fits best where the robot cannot have driven, or where witnesses contradict it: until one fits elsewhere, or somebody else finds it, the
    /// robot is kept where it was.
    is_held: bool,
}

impl<'m> LaserOdometry<'m> {
    /// A robot at the map's origin that has seen nothing yet; `seed` starts the random numbers of its search.
    ///
    /// # Errors
    /// [`NdtMemoryError`] if the directory or the pool is not of the right form.
    pub fn new(config: &LaserOdometryConfig, seed: u64, memory: OdometryMemory<'m>) -> Result<Self, NdtMemoryError> {
        let kept = config.odometry.key_scans().min(memory.key_scans.len());
        Ok(Self {
            config: *config,
            rng: RandomStream::new(seed, 0, 0),
            ndt: NdtGrid::new(&config.ndt, memory.directory, memory.tiles)?,
            matcher: ScanMatcher::new(&config.search, &config.de, &config.matcher, memory.population),
            points: memory.points,
            hits: memory.hits,
            key_points: memory.key_points,
            key_scans: memory.key_scans.get_mut(..kept).unwrap_or_default(),
            key_count: 0,
            turn: 0,
            map_from_robot: Pose2::IDENTITY,
            map_from_key: Pose2::IDENTITY,
            way_m: 0.0,
            course: Course::default(),
            last_stamp: None,
            last_interval: Duration::ZERO,
            seen_at: None,
            fitted_at: None,
            usual_interval_s: 0.0,
            score_per_point: SCORE_FIRST,
            scans: 0,
            lost_scans: 0,
            sight: Sight::default(),
            doubts: false,
            is_told: false,
            is_held: false,
        })
    }

    /// Where the robot is.
    pub fn map_from_robot(&self) -> Pose2 {
        self.map_from_robot
    }

    /// Whoever knows better says where the robot is; the next scan is expected and matched from there. The reference stays as it is.
    pub fn correct(&mut self, map_from_robot: Pose2) {
        if map_from_robot.is_finite() {
            self.map_from_robot = map_from_robot;
        }
    }

    /// The reference.
    pub fn ndt(&self) -> &NdtGrid<'m> {
        &self.ndt
    }

    /// Matches the next scan.
    ///
    /// * `robot_from_lrf` — where the laser sits on the robot
    /// * `displacement` — the robot's displacement since the last scan by odometry, if there is any; else the last
    ///   displacement is expected to repeat
    ///
    /// # Errors
    /// [`PointCapacityError`] if the scan has more points than the memory lent; nothing has changed then.
    pub fn step(
        &mut self,
        scan: &RangeScan<'_>,
        robot_from_lrf: Pose2,
        displacement: Option<Pose2>,
    ) -> Result<OdometryReport, PointCapacityError> {
        let motion = self.motion_during(scan, displacement);
        let eye = robot_from_lrf.position();
        let (count, hits) = self.take(&Sweep { scan: *scan, robot_from_lrf, motion })?;
        let is_frozen = self.sight.is_frozen(scan);
        self.doubts |= is_frozen || self.fitted_at.is_some_and(|fitted| scan.stamp.since(fitted) > GAP);
        if sight::is_covered(scan, self.hits.get(..hits).unwrap_or_default(), eye) {
            let coasted = self.course.coast(self.usual_interval_s);
            self.map_from_robot = self.map_from_robot * self.course.trusted(displacement).unwrap_or(coasted);
            return Ok(self.blind_step(scan, count, motion, is_frozen));
        }
        self.course.look(scan, self.usual_interval_s);
        let forecast = self.forecast(scan, count, displacement);
        let predicted = self.map_from_robot * forecast.step;
        let first = self.ndt.tiles_used() == 0;
        if first {
            (self.scans, self.score_per_point, self.doubts, self.is_held) = (0, SCORE_FIRST, false, false);
        }
        let found = self.find(&Taken::new(scan, robot_from_lrf, predicted), (count, hits), &forecast);
        let Found { matched, fits, .. } = found;
        let is_lost = !first && !fits;
        self.doubts &= is_lost;
        self.lost_scans = if is_lost { self.lost_scans.saturating_add(1) } else { 0 };
        let map_from_robot = if first { self.map_from_robot } else { self.believed(&matched, is_lost, displacement) };
        let is_trusted = !is_lost || self.lost_scans > PATIENCE_SCANS;
        let is_key = self.scans < SETTLING_SCANS || (is_trusted && self.is_key(map_from_robot));
        self.scans = self.scans.saturating_add(1);
        let taken = || Taken::new(scan, robot_from_lrf, map_from_robot);
        let inserted = if is_key { self.extend(taken(), (count, hits)) } else { InsertReport::default() };
        self.go_on(map_from_robot, &forecast, &found, is_lost);
        self.pass(scan.stamp);
        self.note_sight(is_lost);
        if !first && is_trusted {
            self.score_per_point += SCORE_SHARE * (matched.score_per_point - self.score_per_point);
        }
        Ok(OdometryReport {
            // Against nothing, every axis is undetermined; that says nothing about the scene.
            matched: Match { map_from_robot, undetermined: matched.undetermined.filter(|_| !first), ..matched },
            predicted,
            points: count,
            is_key,
            is_lost,
            is_blind: false,
            is_frozen,
            inserted,
            motion,
        })
    }

    /// Takes the hits of the next scan, without those on what covers the laser; returns how many points are left of them, and how many hits.
    fn take(&mut self, sweep: &Sweep<'_>) -> Result<(usize, usize), PointCapacityError> {
        let all = self.hits_of(sweep)?;
        let all = self.hits.get_mut(..all).unwrap_or_default();
        let hits = sight::look_past_cover(all, sweep.robot_from_lrf.position());
        self.sight.is_half_covered = hits < all.len();
        let points = filter::thin(&self.config.filter, all.get(..hits).unwrap_or_default(), self.points)?;
        Ok((points.len(), hits))
    }

    /// Takes all hits of a scan, with the way that their walls face if that matters; returns how many.
    fn hits_of(&mut self, sweep: &Sweep<'_>) -> Result<usize, PointCapacityError> {
        let count = filter::hits(sweep, self.hits)?.len();
        if self.config.ndt.facings > 1 {
            face(self.hits.get_mut(..count).unwrap_or_default(), sweep.robot_from_lrf.position());
        }
        Ok(count)
    }

    /// Where the robot is: where the scan fits, or where odometry that has agreed so far says if it fits nowhere, or nowhere it can have driven.
    fn believed(&self, matched: &Match, is_lost: bool, odometry: Option<Pose2>) -> Pose2 {
        let told = self.course.trusted(odometry).filter(|_| is_lost);
        let best = if self.is_held { self.map_from_robot } else { matched.map_from_robot };
        told.map_or(best, |step| self.map_from_robot * step)
    }

    /// The robot is at `map_from_robot` now; what that says of its motion is learned, and its speed if it was driven there.
    fn go_on(&mut self, map_from_robot: Pose2, forecast: &Forecast, found: &Found, is_lost: bool) {
        let step = self.map_from_robot.between(map_from_robot);
        match (is_lost, found.leaps) {
            (true, _) => self.course.rest(),
            (false, true) => self.course.leap(forecast, step, &found.matched),
            (false, false) => self.course.advance(forecast, step, &found.matched, self.usual_interval_s),
        }
        self.map_from_robot = map_from_robot;
    }

    /// Time goes on to that of the scan.
    fn pass(&mut self, stamp: Instant) {
        self.last_interval = self.last_stamp.map_or(Duration::ZERO, |last| stamp.since(last));
        self.last_stamp = Some(stamp);
    }

    /// The last scan showed something.
    fn note_sight(&mut self, is_lost: bool) {
        self.seen_at = self.last_stamp;
        self.fitted_at = if is_lost { self.fitted_at } else { self.last_stamp };
    }

    /// A step by a scan that shows nothing: the robot is where it coasts to, or where odometry says, as far as anybody knows.
    fn blind_step(
        &mut self,
        scan: &RangeScan<'_>,
        points: usize,
        motion: SweepMotion,
        is_frozen: bool,
    ) -> OdometryReport {
        self.is_held = false;
        self.pass(scan.stamp);
        OdometryReport {
            matched: Match::none(self.map_from_robot),
            predicted: self.map_from_robot,
            points,
            is_key: false,
            is_lost: true,
            is_blind: true,
            is_frozen,
            inserted: InsertReport::default(),
            motion,
        }
    }

    fn is_key(&self, map_from_robot: Pose2) -> bool {
        let step = self.map_from_key.between(map_from_robot);
        step.position().norm() >= KEY_DISTANCE_M || step.heading.abs() >= KEY_ROTATION_DEG.to_radians()
    }
}

#[cfg(test)]
mod tests;
