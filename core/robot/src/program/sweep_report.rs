//! Which scans the host is told with all their beams: those taken some way from the last one told.

use crate::config::ReportConfig;

use super::mapping::Mapped;
use crate::wire::message::FromRobot;
use crate::wire::session::Session;
use crate::wire::sweep::{bytes_at_most, for_each_part};
use lrfslam_core::geometry::Pose2;
use lrfslam_core::sweep::Sweep;

/// Room in the queue that scans and tiles leave to what matters more.
pub(super) const KEPT_FREE: usize = 1200;

/// See the [module](self).
#[derive(Debug, Default)]
pub(super) struct SweepReport {
    told: Option<Pose2>,
}

impl SweepReport {
    /// The host is new, and has nothing.
    pub(super) fn forget(&mut self) {
        self.told = None;
    }

    /// Queues the scan if it is to be told; false if there is no room for it.
    pub(super) fn tell(
        &mut self,
        config: &ReportConfig,
        sweep: &Sweep<'_>,
        mapped: &Mapped,
        link: &mut Session<'_>,
    ) -> bool {
        let odometry = mapped.pose.odometry;
        if mapped.pose.is_lost || !self.is_due(config, odometry) {
            return true;
        }
        if link.queue_room() < bytes_at_most(sweep.scan.beams.len()) + KEPT_FREE {
            return false;
        }
        self.told = Some(odometry);
        for_each_part(sweep, |part| link.send(&FromRobot::Sweep(*part)).map(|_| ())).is_ok()
    }

    fn is_due(&self, config: &ReportConfig, odometry: Pose2) -> bool {
        self.told.is_none_or(|told| {
            let moved = told.between(odometry);
            moved.position().norm() >= config.sweep_distance_m
                || moved.heading.abs() >= config.sweep_rotation_deg.to_radians()
        })
    }
}
