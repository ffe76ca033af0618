//! What a run hands over: all that is new since it did so last, and how things stand now.

use std::time::Duration as WallDuration;

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::time::Instant;
use nalgebra::Matrix3;

use crate::mapping::high::{SegmentPose, Stretch};
use crate::scans::store::ScanStore;

/// A pose of the path, new to the watchers.
#[derive(Debug, Clone, Copy)]
pub struct GivenPose {
    /// Index of its stretch.
    pub stretch: usize,
    /// The pose in it; its `scan` is a place in [`Batch::scans`].
    pub pose: SegmentPose,
    /// It is of a map made before, not of this run's path.
    pub is_old: bool,
}

/// What one scan adds to the live state.
#[derive(Debug, Clone, Default)]
pub struct Batch {
    /// What was given before is of another run.
    pub begins_anew: bool,
    /// Where all stretches lie now.
    pub stretches: Vec<Stretch>,
    /// The piece that is the map.
    pub map_piece: usize,
    /// Closures believed now: the starts of two stretches each.
    pub closures: Vec<[usize; 2]>,
    /// New poses, in order.
    pub poses: Vec<GivenPose>,
    /// Scans of some of them: enough to draw a map from.
    pub scans: ScanStore,
    /// New points of a 3D map, map frame, m.
    pub cloud: Vec<[f32; 3]>,
    /// How things stand; `None` before the first scan.
    pub now: Option<Now>,
    /// There is more to give than fits in one batch.
    pub has_more: bool,
}

/// What is known of the robot.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum State {
    /// The scan fits.
    #[default]
    Tracking,
    /// The scan fits nowhere.
    Lost,
    /// The scan shows nothing.
    Blind,
    /// The scan repeats the ones before it to the bit.
    Frozen,
    /// The robot has not found itself in a map.
    Searching,
    /// All has come, and is fitted together.
    Fitting,
}

/// What was counted so far.
#[derive(Debug, Clone, Copy, Default)]
pub struct Counts {
    /// Scans taken.
    pub scans: u64,
    /// Scans that fitted nowhere.
    pub lost_scans: u64,
    /// Closures believed.
    pub closures: u64,
    /// Pieces of map that are not joined to it.
    pub pieces_apart: u64,
    /// Times that a robot found itself in a map.
    pub found: u64,
}

/// What laser and link have suffered.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Health {
    /// Telegrams of the laser, or frames of a robot's link, that came damaged.
    pub damaged: u64,
    /// Times that the laser was started anew.
    pub restarts: u64,
    /// Scans that came too fast to be taken, or that a robot's link has lost.
    pub missed: u64,
}

/// How things stand at the last scan.
#[derive(Debug, Clone, Default)]
pub struct Now {
    /// Of the scan.
    pub stamp: Instant,
    /// Where the robot is; `None` while nobody knows.
    pub map_from_robot: Option<Pose2>,
    /// The same in the frame in which particles and directions are told.
    pub low_from_robot: Pose2,
    /// Covariance of (x, y, heading); m², m rad, rad².
    pub covariance: Matrix3<f32>,
    /// Direction about which the scene says nothing, low frame, a unit vector.
    pub undetermined: Option<Point2>,
    /// What is known of the robot.
    pub state: State,
    /// Probability that the position is right, where it is known.
    pub certainty: Option<f32>,
    /// Hits of the scan, robot frame, m.
    pub hits: Vec<Point2>,
    /// Poses and weights of the particles, low frame.
    pub particles: Vec<(Pose2, f32)>,
    /// Landmarks: x, y (m), and their covariance, xx, xy, yy (m²); map frame.
    pub landmarks: Vec<[f32; 5]>,
    /// Of the last step of the particle filter.
    pub effective_sample_size: Option<f32>,
    /// Counted so far.
    pub counts: Counts,
    /// Laser and link, where something is known of them.
    pub health: Option<Health>,
    /// Time that the run has worked.
    pub working: WallDuration,
    /// From the scan's stamp to when it was mapped; `None` of what is not live.
    pub late: Option<WallDuration>,
}
