//! Which scans the host is told with all their beams: those taken some way from the last one told.

use super::mapping::Mapped;
use crate::geometry::Pose2;
use crate::sweep::Sweep;
use crate::wire::message::FromRobot;
use crate::wire::session::Session;
use crate::wire::sweep::{bytes_at_most, for_each_part};

crate::config! {
    /// What a robot that does the SLAM itself tells its host.
    pub struct ReportConfig {
        /// A scan is told with its beams if the robot has moved so far since the last one told, m …
        sweep_distance_m: f32 = 0.05, in 0.0..=10.0;
        /// … or turned so far, degrees. Closing of loops and the drawn map live on these; a beam costs a byte or two on the link.
        sweep_rotation_deg: f32 = 2.0, in 0.0..=180.0;
    }
}

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
