//! PLACEHOLDER, to be replaced as a whole by the one that matches scans.
//!
//! The seam between the log and the SLAM: scans in, poses of the robot out. For now it believes the log's odometry, or
//! stands still.

use lrfslam_core::geometry::Pose2;

use crate::config::{RunConfig, RunConfigError};
use crate::log::LogScan;

/// Turns scans into poses.
#[derive(Debug)]
pub struct Mapper {
    start_from_odometry: Option<Pose2>,
}

/// What one scan led to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepOutcome {
    /// Pose of the robot when the scan was taken; the first scan's is the origin.
    pub map_from_robot: Pose2,
}

impl Mapper {
    /// A mapper that has seen nothing; `seed` starts its random numbers.
    ///
    /// # Errors
    /// If the configuration cannot work.
    pub fn new(_config: &RunConfig, _seed: u64) -> Result<Self, RunConfigError> {
        Ok(Self { start_from_odometry: None })
    }

    /// Takes the next scan; only with `odometry` is the log's odometry looked at.
    pub fn add_scan(&mut self, scan: &LogScan, odometry: bool) -> StepOutcome {
        let pose = scan.map_from_robot_odometry.filter(|_| odometry).unwrap_or(Pose2::IDENTITY);
        let start = *self.start_from_odometry.get_or_insert(pose.inverse());
        StepOutcome { map_from_robot: start * pose }
    }
}
