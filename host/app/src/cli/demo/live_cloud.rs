//! The 3D map for those who watch, while the laser tilts: each scan from where the robot stands.

use std::collections::HashSet;

use lrfslam_core::scan::RangeScan;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_host::maps::cloud::{Cloud, EdgeFilter, Projection, Track, planar};
use lrfslam_host::pose_f64::PoseF64;

use super::results::mounting;
use super::robot::SimulatedRobot;

/// Side of the cubes of which one point each is shown, m.
const VOXEL_M: f32 = 0.05;

/// See the [module](self).
pub struct LiveCloud {
    projection: Projection,
    shown: HashSet<[i32; 3]>,
}

impl LiveCloud {
    /// Nothing was seen yet.
    pub fn new(robot: &SimulatedRobot) -> Self {
        let tilt = Track::new(robot.tilt_readings(), Duration::from_millis(100));
        let path = Track::new([], Duration::from_millis(60_000));
        let projection = Projection { mounting: mounting(robot), path, tilt, edges: Some(EdgeFilter::default()) };
        Self { projection, shown: HashSet::new() }
    }

    /// Points that were not there before, map frame, m.
    ///
    /// * `scan` — stamped by the drive's clock; `stands` — when the robot was seen last, by the same, and where
    pub fn add(&mut self, scan: &RangeScan<'_>, (at, pose): (Instant, PoseF64)) -> Vec<[f32; 3]> {
        self.projection.path = Track::new([(at, planar(pose))], Duration::from_millis(60_000));
        let mut cloud = Cloud::default();
        self.projection.add(scan, &mut cloud);
        let points = cloud.points.iter().map(|point| [point.position.x, point.position.y, point.position.z]);
        points.filter(|point| self.shown.insert(point.map(|value| (value / VOXEL_M).floor() as i32))).collect()
    }
}
