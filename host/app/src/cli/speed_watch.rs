//! Whether the robot is too fast for its laser.

use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::RangeScan;
use lrfslam_core::sweep::SpeedLimits;
use lrfslam_core::time::{Duration, Instant};

use crate::config::SpeedConfig;

/// Compares the laser's motion with what its rate allows.
pub(super) struct SpeedWatch {
    config: SpeedConfig,
    robot_from_lrf: Pose2,
    /// Scans taken while it was so.
    pub(super) too_fast: u32,
    last: Option<(Instant, Pose2)>,
}

impl SpeedWatch {
    pub(super) fn new(config: SpeedConfig, robot_from_lrf: Pose2) -> Self {
        Self { config, robot_from_lrf, too_fast: 0, last: None }
    }

    /// Takes the pose of the next scan; true when the robot has just become too fast.
    pub(super) fn is_too_fast(&mut self, scan: &RangeScan<'_>, map_from_robot: Pose2) -> bool {
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
        let exceeds = limits.are_exceeded_by(from.between(map_from_lrf), dt);
        self.too_fast += u32::from(exceeds);
        exceeds && self.too_fast == 1
    }
}
