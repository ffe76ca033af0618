//! What the high level asks of what places scans below it, and what the two tell one another.

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::laser_odometry;
use serde::Serialize;

use crate::scans::store::ScanStore;

/// What places scans.
pub trait LowLevel {
    /// Goes on with a map of nothing but the scans that `correction` names among `scans`; returns the pose from which the next scan will
    /// have moved: in that map, or in a frame of its own that does not jump.
    ///
    /// # Errors
    /// If a scan has more points or beams than there is memory for.
    fn correct(&mut self, correction: &Correction, scans: &ScanStore) -> anyhow::Result<Pose2>;
    /// The same without delaying the next scan: `None` while the map is not drawn yet, until when it goes on in its old one.
    ///
    /// # Errors
    /// As [`correct`](Self::correct).
    fn begin_correction(&mut self, correction: &Correction, scans: &ScanStore) -> anyhow::Result<Option<Pose2>> {
        self.correct(correction, scans).map(Some)
    }
    /// Goes on with a [correction that was begun](Self::begin_correction), once after every scan; `Some` when it has taken it.
    ///
    /// * `newest` — place of that scan among `scans`, if it is there
    ///
    /// # Errors
    /// As [`correct`](Self::correct).
    fn go_on_correcting(&mut self, _newest: Option<u32>, _scans: &ScanStore) -> anyhow::Result<Option<Pose2>> {
        Ok(None)
    }
    /// Poses of the best particle at every step that the filter took; empty for matching alone.
    fn path(&self) -> Vec<Pose2>;
    /// True if particles correct what matching finds.
    fn has_particles(&self) -> bool;
    /// How the matching went.
    fn counts(&self) -> MatchCounts;
    /// Poses and weights of the particles, in the low level's map, for those who watch; none of matching alone.
    fn particles(&self) -> Vec<(Pose2, f32)>;
}

/// What the low level says of a scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LowPose {
    /// Pose of the robot in the low level's map.
    pub map_from_robot: Pose2,
    /// Direction in that map about which the scene says nothing.
    pub undetermined: Option<Point2>,
    /// The scan agrees too little with the map for the pose to be believed, or shows nothing.
    pub is_lost: bool,
    /// The scan shows nothing.
    pub is_blind: bool,
    /// The scan repeats the ones before it to the bit.
    pub is_frozen: bool,
}

/// What the low level is to go on with.
#[derive(Debug, Clone, PartialEq)]
pub struct Correction {
    /// Pose of the robot.
    pub map_from_robot: Pose2,
    /// Its map: poses, and the places of the stored scans taken there.
    pub reference: Vec<(Pose2, u32)>,
}

/// How the matching went, over a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct MatchCounts {
    /// Scans that agreed too little with the reference for their pose to be believed.
    pub lost_scans: u64,
    /// Of these, scans that showed nothing: the laser was covered.
    pub blind_scans: u64,
    /// Scans that repeated the ones before them to the bit.
    pub frozen_scans: u64,
    /// Scans whose scene left an axis undetermined, e.g. a featureless corridor.
    pub undetermined_scans: u64,
    /// Scans that went into the reference.
    pub key_scans: u64,
    /// Generations of the search.
    pub generations: u64,
    /// Points after the filter.
    pub points: u64,
    /// Points that found the pool of cells full.
    pub dropped_points: u64,
    /// Tiles of cells that were forgotten for nearer ones.
    pub forgotten_tiles: u64,
}

impl MatchCounts {
    /// Counts a step.
    pub(crate) fn add(&mut self, step: &laser_odometry::OdometryReport) {
        self.lost_scans += u64::from(step.is_lost);
        self.blind_scans += u64::from(step.is_blind);
        self.frozen_scans += u64::from(step.is_frozen);
        self.undetermined_scans += u64::from(step.matched.undetermined.is_some());
        self.key_scans += u64::from(step.is_key);
        self.generations += u64::from(step.matched.generations);
        self.points += step.points as u64;
        self.dropped_points += u64::from(step.inserted.dropped);
        self.forgotten_tiles += u64::from(step.inserted.evicted);
    }
}
