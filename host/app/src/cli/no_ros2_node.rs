//! `--ros2` and `--lrf ros2:TOPIC` of a build without them.

use std::sync::atomic::AtomicBool;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::RangeScan;
use lrfslam_host::maps::occupancy::Raster;
use lrfslam_host::runs::map::Whereabouts;
use lrfslam_host::runs::scans::Scans;
use lrfslam_host::scans::live::Say;

use super::ros2::Domain;
use super::{Failure, not_built_in};

/// There is none.
pub(super) enum Published {}

impl Published {
    /// Says how to get it.
    pub(super) fn announce(_: Domain, _: bool) -> Result<Self, Failure> {
        Err(missing())
    }

    pub(super) fn step(&mut self, _: RangeScan<'_>, _: Pose2, _: Whereabouts) {
        match *self {}
    }

    pub(super) fn map_if_due(&mut self, _: impl FnOnce() -> Option<Raster>) {
        match *self {}
    }

    pub(super) fn finish(self, _: impl FnOnce() -> Option<Raster>) {
        match self {}
    }
}

fn missing() -> Failure {
    not_built_in("ROS 2", "ros2")
}

/// Says how to get it.
pub(super) fn scans(_: &str, _: (Option<f32>, bool), _: &AtomicBool, _: Say) -> Result<Scans, Failure> {
    Err(missing())
}
