//! Where is the robot in a map made before, and how sure is that? The map is not changed.
//!
//! scan → while the place is unknown: `Finder` (laser odometry on its own → submap of the latest metres → searched for in the whole
//! map) → once found: `Tracker` (scan matched against the map, and against what was seen beyond it in this run) → pose, covariance,
//! certainty. A tracker that is doubted runs beside a finder until either is right.

mod belief;
mod finder;
mod known_map;
mod start;
mod tracker;

use lrfslam_core::filter::PointCapacityError;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::RangeScan;
use lrfslam_core::slam::SlamConfig;
use nalgebra::Matrix3;

pub use known_map::KnownMap;
pub(crate) use start::ON_WALLS_MIN;
pub use start::{ScansAhead, StartFit, StartJudge};

use self::finder::Finder;
use self::tracker::Tracker;
use crate::mapping::{MapperMemory, MemoryConfig};
use crate::places::ClosureConfig;

lrfslam_core::config! {
    /// Localisation in a saved map.
    pub struct LocalizeConfig {
        /// Way after which the robot is searched for in the whole map, m; a turn of a radian counts as half a metre. More is told apart better.
        search_after_m: f32 = 4.0, in 0.0..=100.0;
        /// Mean likelihood of the submap's points, 0 to 1, below which a place is not looked at. Lower: found sooner where much has changed, and
        /// much slower.
        likelihood_min: f32 = 0.55, in 0.1..=1.0;
        /// A second place with this share of the best one's likelihood is a doubt. Higher: found sooner where rooms resemble one another, and
        /// more often in the wrong one.
        second_share_max: f32 = 0.9, in 0.0..=1.0;
    }
}

/// Below this certainty the robot is searched for while it is still tracked: chosen.
const DOUBTED_CERTAINTY: f32 = 0.5;
/// Below this it is lost: no pose is given. Chosen.
const LOST_CERTAINTY: f32 = 0.1;
/// A position is right if it is nearer to the truth than this, m: what the certainty is about.
pub const RIGHT_WITHIN_M: f32 = 0.25;

/// What is known about the robot at a scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Located {
    /// Pose of the robot in the saved map.
    pub map_from_robot: Pose2,
    /// Covariance of (x, y, heading) if the place is right; m², m rad, rad².
    pub covariance: Matrix3<f64>,
    /// Probability that the position is right to within [`RIGHT_WITHIN_M`].
    pub certainty: f32,
    /// Share of the scan's points that lie on the map's walls.
    pub on_walls: f32,
    /// Share of its points in known places that stand where the map is free.
    pub contradicting: f32,
}

/// What happened over a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct LocalizeCounts {
    /// Scans with a pose.
    pub tracked_scans: u64,
    /// Scans without: the robot had not found itself.
    pub searching_scans: u64,
    /// Searches of the whole map.
    pub searches: u64,
    /// Times that the robot found itself.
    pub found: u64,
    /// Times that it was lost.
    pub lost: u64,
}

/// Everything that decides where a robot is found.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LocalizerConfig {
    /// Localisation.
    pub localize: LocalizeConfig,
    /// Of which it matches as mapping does.
    pub slam: SlamConfig,
    /// How places are recognised.
    pub closure: ClosureConfig,
    /// Memory.
    pub memory: MemoryConfig,
}

/// Memory that a [`Localizer`] works in.
#[derive(Debug)]
pub struct LocalizerMemory {
    tracker: MapperMemory,
    finder: MapperMemory,
}

impl LocalizerMemory {
    /// As much as `config` says; it does not grow.
    pub fn new(config: &LocalizerConfig) -> Self {
        let memory = || MapperMemory::of_matching(&config.slam, &config.memory);
        Self { tracker: memory(), finder: memory() }
    }
}

/// Finds and tracks a robot in a map; see the [module](self).
#[derive(Debug)]
pub struct Localizer<'m> {
    map: &'m KnownMap,
    tracker: Tracker<'m>,
    finder: Finder<'m>,
    is_tracking: bool,
    is_finding: bool,
    counts: LocalizeCounts,
}

impl<'m> Localizer<'m> {
    /// A robot somewhere in `map`, or at `start`.
    ///
    /// # Errors
    /// If the memory does not fit the configuration, or a scan of the map is too large for it.
    pub fn new(
        config: &LocalizerConfig,
        seed: u64,
        map: &'m KnownMap,
        start: Option<Pose2>,
        memory: &'m mut LocalizerMemory,
    ) -> anyhow::Result<Self> {
        let LocalizerMemory { tracker, finder } = memory;
        let mut localizer = Self {
            map,
            tracker: Tracker::new(config, seed, tracker.lend_odometry())?,
            finder: Finder::new(config, seed, finder.lend_odometry())?,
            is_tracking: false,
            is_finding: false,
            counts: LocalizeCounts::default(),
        };
        if let Some(start) = start {
            localizer.track_from(start)?;
        }
        Ok(localizer)
    }

    /// What happened so far.
    pub fn counts(&self) -> LocalizeCounts {
        LocalizeCounts { searches: self.finder.searches(), ..self.counts }
    }

    /// Takes the next scan; `None` while the robot has not found itself.
    ///
    /// * `robot_from_lrf` — where the laser sits on the robot
    ///
    /// # Errors
    /// If the scan has more points than the memory.
    pub fn add_scan(
        &mut self,
        scan: &RangeScan<'_>,
        robot_from_lrf: Pose2,
    ) -> Result<Option<Located>, PointCapacityError> {
        let mut located = None;
        if self.is_tracking {
            let tracked = self.tracker.add_scan(self.map, scan, robot_from_lrf)?;
            located = Some(tracked.located).filter(|_| tracked.place_certainty >= LOST_CERTAINTY);
            if located.is_none() {
                (self.is_tracking, self.counts.lost) = (false, self.counts.lost + 1);
            }
            self.search_if(tracked.place_certainty < DOUBTED_CERTAINTY);
        } else {
            self.search_if(true);
        }
        if self.is_finding
            && let Some(found) = self.finder.add_scan(self.map, scan, robot_from_lrf)?
        {
            located = Some(self.take_over(found, scan, robot_from_lrf)?);
        }
        *(if located.is_some() { &mut self.counts.tracked_scans } else { &mut self.counts.searching_scans }) += 1;
        Ok(located)
    }

    /// Starts the finder anew if it is wanted and does not run yet, or stops it.
    fn search_if(&mut self, wanted: bool) {
        if wanted && !self.is_finding {
            self.finder.restart();
        }
        self.is_finding = wanted;
    }

    /// The finder knows better than the tracker.
    fn take_over(
        &mut self,
        found: Pose2,
        scan: &RangeScan<'_>,
        robot_from_lrf: Pose2,
    ) -> Result<Located, PointCapacityError> {
        if !self.is_tracking {
            self.counts.found += 1;
        }
        self.is_finding = false;
        self.track_from(found)?;
        Ok(self.tracker.add_scan(self.map, scan, robot_from_lrf)?.located)
    }

    fn track_from(&mut self, map_from_robot: Pose2) -> Result<(), PointCapacityError> {
        self.is_tracking = true;
        self.tracker.restart_at(self.map, map_from_robot)
    }
}
