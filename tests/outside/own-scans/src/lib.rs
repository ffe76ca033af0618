//! The part for the robot: neither std nor a heap.
#![no_std]

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::grid::Occupancy;
use lrfslam_core::scan::{Beam, Echo, RangeScan};
use lrfslam_core::slam::{Slam, SlamConfig, SlamMemoryError, SmallPools, TILE_SIDE};
use lrfslam_core::time::{Duration, Instant};

pub const BEAMS: usize = 241;
const RANGE_MAX_M: f32 = 8.0;

/// Matches scans, and maps.
pub struct Robot<'m> {
    slam: Slam<'m, TILE_SIDE>,
    scans: i64,
}

/// Where it is, and how well its last scan fitted.
pub struct Place {
    pub pose: Pose2,
    pub is_lost: bool,
    pub score: f32,
}

/// Direction of a beam: 240° from right to left.
pub fn bearing_rad(index: usize) -> f32 {
    (index as f32 - 120.0).to_radians()
}

impl<'m> Robot<'m> {
    pub fn new(memory: &'m mut SmallPools) -> Result<Self, SlamMemoryError> {
        Ok(Self { slam: Slam::new(&SlamConfig::small(), 7, memory.lend())?, scans: 0 })
    }

    /// Takes a scan's ranges, m; `None` if they are too many for the memory.
    pub fn see(&mut self, ranges_m: &[f32; BEAMS]) -> Option<Place> {
        let mut beams = [Beam::BLANK; BEAMS];
        for (index, (beam, range_m)) in beams.iter_mut().zip(ranges_m).enumerate() {
            let echo = Echo::from_range(*range_m, RANGE_MAX_M);
            *beam = Beam { bearing_rad: bearing_rad(index), offset: Duration::ZERO, echo };
        }
        let stamp = Instant::from_micros(self.scans * 100_000);
        self.scans += 1;
        let scan = RangeScan { stamp, range_max_m: RANGE_MAX_M, beams: &beams };
        let step = self.slam.step(&scan, Pose2::IDENTITY).ok()?;
        let (is_lost, score) = (step.odometry.is_lost, step.odometry.matched.score);
        Some(Place { pose: step.map_from_robot, is_lost, score })
    }

    /// May it drive there?
    pub fn is_free(&self, x_m: f32, y_m: f32) -> bool {
        self.slam.occupancy_at(Point2::new(x_m, y_m)) == Occupancy::Free
    }

    /// Is something there?
    pub fn is_occupied(&self, x_m: f32, y_m: f32) -> bool {
        self.slam.occupancy_at(Point2::new(x_m, y_m)) == Occupancy::Occupied
    }
}
