//! Laser odometry: scan after scan is matched, and the matches give the robot's path without any odometry.
//!
//! filter → predict (constant velocity, or odometry) → match against the reference → extend the reference. The
//! reference is the previous scan (the thesis), the recent key scans together, or the whole map so far.

use crate::de::{DeConfig, Member};
use crate::filter::{self, FilterConfig, PointCapacityError};
use crate::geometry::{Point2, Pose2};
use crate::matcher::{Match, MatcherConfig, Prediction, RecoveryConfig, ScanMatcher, SearchConfig};
use crate::ndt::{DirectoryEntry, InsertReport, NdtConfig, NdtGrid, NdtMemoryError, NdtTile};
use crate::random::RandomStream;
use crate::scan::RangeScan;
use crate::sweep::{Sweep, SweepMotion};
use crate::time::{Duration, Instant};

mod sight;
mod walls;
mod witnesses;

use self::sight::Sight;

crate::config_choice! {
    /// What a scan is matched against.
    pub enum Reference {
        /// The previous scan alone (the thesis).
        PreviousScan = "previous-scan",
        /// The last key scans together.
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

/// Key scans kept with [`Reference::RecentScans`]: chosen.
const RECENT_SCANS: usize = 10;
/// The reference is extended after this much travel, m …
const KEY_DISTANCE_M: f32 = 0.05;
/// … or this much rotation, degrees: chosen; the thesis extends it by every scan.
const KEY_ROTATION_DEG: f32 = 2.0;
/// The first so many scans all go into the reference: the first one alone is thin and noisy. Chosen.
const SETTLING_SCANS: u32 = 10;
/// A place found by a wider search is believed if its score per point is at least this share of the usual one: chosen …
const FOUND_SHARE: f32 = 0.6;
/// … and its score is so many times that of the place where the robot was expected.
const FOUND_BETTER: f32 = 1.2;
/// While lost the reference is left alone, for this many scans at most: chosen.
const PATIENCE_SCANS: u16 = 10;
/// Score per point that the first scans are measured by: chosen.
const SCORE_FIRST: f32 = 0.5;
/// Share of a scan's score per point in the usual one: it follows over about ten scans.
const SCORE_SHARE: f32 = 0.1;
/// The search box and the prior are those of scans so far apart, s; with the time between scans they grow as a random walk does.
const INTERVAL_S: f32 = 0.25;
/// Longer gaps count as this long, s.
const INTERVAL_MAX_S: f32 = 4.0;
/// Share of an interval in the mean of the last ones.
const INTERVAL_SHARE: f32 = 0.05;
/// A step that turns more than this, rad, is not expected again.
const STEADY_RAD: f32 = 0.5;
/// A step is stretched by the time that has passed, from so many …
const STRETCH_MIN: f32 = 0.2;
/// … to so many times.
const STRETCH_MAX: f32 = 4.0;
/// Score per point by which a stretched step must agree better than the last one again.
const STRETCH_BETTER: f32 = 0.1;

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

/// A scan that is kept: it will be removed from the reference again, or is a witness.
#[derive(Debug, Clone, Copy, Default)]
pub struct KeyScan {
    map_from_robot: Pose2,
    /// Where the laser was, robot frame.
    eye: Point2,
    count: usize,
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
    /// True if the scan shows nothing: the laser is covered, or its scans are frozen.
    pub is_blind: bool,
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
    velocity: Pose2,
    last_stamp: Option<Instant>,
    last_interval: Duration,
    /// From scan to scan in the mean, s.
    usual_interval_s: f32,
    score_per_point: f32,
    scans: u32,
    lost_scans: u16,
    sight: Sight,
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
            velocity: Pose2::IDENTITY,
            last_stamp: None,
            last_interval: Duration::ZERO,
            usual_interval_s: 0.0,
            score_per_point: SCORE_FIRST,
            scans: 0,
            lost_scans: 0,
            sight: Sight::default(),
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

    /// Puts the robot at `map_from_robot` and forgets the reference; to be followed by [`refer_to`](Self::refer_to). What is known of
    /// its motion stays.
    ///
    /// For a high level that has corrected the map.
    pub fn restart_at(&mut self, map_from_robot: Pose2) {
        self.ndt.clear();
        (self.key_count, self.turn) = (0, 0);
        self.key_scans.fill(KeyScan::default());
        self.map_from_robot = map_from_robot;
        self.map_from_key = map_from_robot;
    }

    /// Extends the reference by a scan that was taken at `map_from_scan`; returns how many points found no room.
    ///
    /// # Errors
    /// [`PointCapacityError`] if the scan has more points than the memory lent; nothing has changed then.
    pub fn refer_to(&mut self, sweep: &Sweep<'_>, map_from_scan: Pose2) -> Result<u32, PointCapacityError> {
        let hits = filter::hits(sweep, self.hits)?;
        let points = filter::thin(&self.config.filter, hits, self.points)?.len();
        let hits = hits.len();
        let hits = self.keep_standing(map_from_scan, hits);
        Ok(self.extend_map(map_from_scan, sweep.robot_from_lrf.position(), (points, hits)).dropped)
    }

    /// Cells of the reference that count now stay as they are; see [`NdtGrid::freeze`]. For a robot in a map that shall not change.
    pub fn freeze_reference(&mut self) {
        self.ndt.freeze();
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
        let hits = filter::hits(&Sweep { scan: *scan, robot_from_lrf, motion }, self.hits)?;
        let count = filter::thin(&self.config.filter, hits, self.points)?.len();
        let hits = hits.len();
        if self.sight.is_blind(scan, self.hits.get(..hits).unwrap_or_default(), robot_from_lrf.position()) {
            return Ok(self.blind_step(scan, count, motion));
        }
        let predicted = self.map_from_robot * displacement.unwrap_or_else(|| self.expected_step(scan, count));
        let first = self.ndt.tiles_used() == 0;
        if first {
            (self.scans, self.score_per_point) = (0, SCORE_FIRST);
        }
        let score_expected = self.score_per_point * count as f32;
        let prediction = Prediction { map_from_robot: predicted, score_expected, spread: self.spread(scan.stamp) };
        let matched = self.find(count, &prediction);
        let hits = self.keep_standing(matched.map_from_robot, hits);
        let is_lost = !first && matched.score_per_point < self.config.recovery.lost_share * self.score_per_point;
        self.lost_scans = if is_lost { self.lost_scans.saturating_add(1) } else { 0 };
        let map_from_robot = if first { self.map_from_robot } else { matched.map_from_robot };
        let is_trusted = !is_lost || self.lost_scans > PATIENCE_SCANS;
        let is_settling = self.scans < SETTLING_SCANS;
        self.scans = self.scans.saturating_add(1);
        let is_key = is_settling || (is_trusted && self.is_key(map_from_robot));
        let robot_from_lrf = robot_from_lrf.position();
        let inserted =
            if is_key { self.extend(map_from_robot, robot_from_lrf, (count, hits)) } else { InsertReport::default() };
        let step = self.map_from_robot.between(map_from_robot);
        self.velocity = if is_lost || step.heading.abs() > STEADY_RAD { Pose2::IDENTITY } else { step };
        self.map_from_robot = map_from_robot;
        self.last_interval = self.last_stamp.map_or(Duration::ZERO, |last| scan.stamp.since(last));
        self.last_stamp = Some(scan.stamp);
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
            inserted,
            motion,
        })
    }

    /// A step by a scan that shows nothing: the robot is where it was, as far as anybody knows.
    fn blind_step(&mut self, scan: &RangeScan<'_>, points: usize, motion: SweepMotion) -> OdometryReport {
        self.velocity = Pose2::IDENTITY;
        self.last_interval = self.last_stamp.map_or(Duration::ZERO, |last| scan.stamp.since(last));
        self.last_stamp = Some(scan.stamp);
        OdometryReport {
            matched: Match::none(self.map_from_robot),
            predicted: self.map_from_robot,
            points,
            is_key: false,
            is_lost: true,
            is_blind: true,
            inserted: InsertReport::default(),
            motion,
        }
    }

    /// The last step again, unless the scan agrees clearly better with a step in proportion to the time that has passed.
    ///
    /// Scans come at a steady rate while their stamps may be wrong (logs written in bursts), or scans are missing and the stamps
    /// are right. Only the scene can tell.
    fn expected_step(&self, scan: &RangeScan<'_>, count: usize) -> Pose2 {
        let points = self.points.get(..count).unwrap_or_default();
        let elapsed = self.last_stamp.map_or(0.0, |last| scan.stamp.since(last).as_secs_f32());
        let usual = self.last_interval.as_secs_f32();
        if elapsed <= 0.0 || usual <= 0.0 {
            return self.velocity;
        }
        let factor = (elapsed / usual).clamp(STRETCH_MIN, STRETCH_MAX);
        let Pose2 { x, y, heading } = self.velocity;
        let in_proportion = Pose2::new(factor * x, factor * y, factor * heading);
        let score = |step| self.ndt.search_score(points, self.map_from_robot * step, 0.0);
        if score(in_proportion) > score(self.velocity) + STRETCH_BETTER * count as f32 {
            in_proportion
        } else {
            self.velocity
        }
    }

    /// How much farther than usual the robot may be from where it is expected at `stamp`: the slower the scans, the farther. Stamps may
    /// come in bursts, so their mean distance counts as well.
    fn spread(&mut self, stamp: Instant) -> f32 {
        let Some(last) = self.last_stamp else { return 1.0 };
        let interval_s = stamp.since(last).as_secs_f32().clamp(0.0, INTERVAL_MAX_S);
        let share = INTERVAL_SHARE.max(1.0 / self.scans.max(1) as f32);
        self.usual_interval_s += share * (interval_s - self.usual_interval_s);
        libm::sqrtf((interval_s.max(self.usual_interval_s) / INTERVAL_S).max(1.0))
    }

    /// How the robot is expected to move while `scan` is taken: at the speed of the last step.
    ///
    /// Stamps may jitter, but a step cannot have taken less time than a sweep.
    fn motion_during(&self, scan: &RangeScan<'_>, displacement: Option<Pose2>) -> SweepMotion {
        let Some(last) = self.last_stamp.filter(|_| self.config.odometry.deskew) else {
            return SweepMotion::default();
        };
        let sweep = match (scan.beams.first(), scan.beams.last()) {
            (Some(first), Some(last)) => last.offset.micros.abs_diff(first.offset.micros) as i64,
            _ => 0,
        };
        let (displacement, taken) = match displacement {
            Some(displacement) => (displacement, scan.stamp.since(last)),
            None => (self.velocity, self.last_interval),
        };
        SweepMotion { displacement, duration: taken.max(Duration::from_micros(sweep)) }
    }

    /// Matches the current points, with a wider search if the robot is not where it was expected.
    fn find(&mut self, count: usize, prediction: &Prediction) -> Match {
        let points = self.points.get(..count).unwrap_or_default();
        let matched = self.matcher.align(&self.ndt, points, prediction, &mut self.rng);
        if matched.score_per_point >= self.config.recovery.lost_share * self.score_per_point {
            return matched;
        }
        let wide = self.matcher.align_anywhere(&self.ndt, points, prediction, &self.config.recovery, &mut self.rng);
        let is_found = wide.score_per_point >= FOUND_SHARE * self.score_per_point;
        if is_found && wide.score > FOUND_BETTER * matched.score { wide } else { matched }
    }

    /// Brings the hits that stand still to the front of all, and returns how many these are.
    fn keep_standing(&mut self, map_from_robot: Pose2, hits: usize) -> usize {
        if self.config.odometry.reference != Reference::WholeMap {
            return hits;
        }
        let hits = self.hits.get_mut(..hits).unwrap_or_default();
        witnesses::keep_standing(hits, map_from_robot, self.key_scans, self.key_points)
    }

    fn is_key(&self, map_from_robot: Pose2) -> bool {
        let step = self.map_from_key.between(map_from_robot);
        step.position().norm() >= KEY_DISTANCE_M || step.heading.abs() >= KEY_ROTATION_DEG.to_radians()
    }

    /// Puts the current scan into the reference, and takes the oldest out where the reference is a few scans only.
    fn extend(&mut self, map_from_robot: Pose2, eye: Point2, (points, hits): (usize, usize)) -> InsertReport {
        self.map_from_key = map_from_robot;
        if self.config.odometry.reference == Reference::WholeMap {
            return self.extend_map(map_from_robot, eye, (points, hits));
        }
        let hits = self.hits.get(..hits).unwrap_or_default();
        let Self { ndt, key_points, key_scans, .. } = self;
        if let Some((key, memory)) = next_slot(key_scans, key_points, &mut self.key_count) {
            ndt.remove(memory.get(..key.count).unwrap_or_default(), key.map_from_robot);
            key.keep(memory, hits, map_from_robot, eye);
        }
        ndt.insert(hits, map_from_robot)
    }

    /// The same for the whole map: what moves is not map.
    fn extend_map(&mut self, map_from_robot: Pose2, eye: Point2, (points, hits): (usize, usize)) -> InsertReport {
        let points = self.points.get(..points).unwrap_or_default();
        let hits = self.hits.get(..hits).unwrap_or_default();
        let Self { ndt, key_points, key_scans, .. } = self;
        ndt.look_through(hits, eye, map_from_robot, self.turn);
        self.turn = self.turn.wrapping_add(1);
        let newest = self.key_count.checked_sub(1).and_then(|index| key_scans.get(index % key_scans.len().max(1)));
        let is_due = newest.is_none_or(|newest| witnesses::is_due(newest.map_from_robot.between(map_from_robot)));
        if is_due && let Some((witness, memory)) = next_slot(key_scans, key_points, &mut self.key_count) {
            witness.keep(memory, points, map_from_robot, eye);
        }
        let inserted = ndt.insert(hits, map_from_robot);
        walls::between(hits, |wall| {
            ndt.insert(wall, map_from_robot);
        });
        inserted
    }
}

impl KeyScan {
    /// Becomes the scan with these `points`, as far as there is `memory` for them.
    fn keep(&mut self, memory: &mut [Point2], points: &[Point2], map_from_robot: Pose2, eye: Point2) {
        *self = Self { map_from_robot, eye, count: points.len().min(memory.len()) };
        memory.iter_mut().zip(points).for_each(|(to, from)| *to = *from);
    }
}

/// The place of the oldest scan that is kept, with the memory for its points; `None` if none is kept.
fn next_slot<'s>(
    scans: &'s mut [KeyScan],
    points: &'s mut [Point2],
    count: &mut usize,
) -> Option<(&'s mut KeyScan, &'s mut [Point2])> {
    let room = points.len().checked_div(scans.len())?;
    let slot = *count % scans.len();
    *count += 1;
    Some((scans.get_mut(slot)?, points.chunks_mut(room.max(1)).nth(slot)?))
}

#[cfg(test)]
mod tests;
