//! Follows the robot in the map.

use lrfslam_core::filter::{PointCapacityError, hits};
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::laser_odometry::{LaserOdometry, OdometryMemory, part_lone};
use lrfslam_core::ndt::NdtMemoryError;
use lrfslam_core::scan::RangeScan;
use lrfslam_core::sweep::Sweep;

use super::belief::{Belief, FOUND_CERTAINTY};
use super::{KnownMap, LocalizerConfig, Located};
use crate::places::submap::Agreement;

/// The matcher's map is drawn from scans so far apart, m, or so far turned, rad.
const REFERENCE_APART: (f32, f32) = (0.05, 0.035);
/// Way after which a scan counts as a new witness for or against a place, m.
const WITNESS_APART_M: f32 = 0.1;

/// Laser odometry whose reference is the map and what was seen beyond it; see the [module](self).
#[derive(Debug)]
pub(super) struct Tracker<'m> {
    odometry: LaserOdometry<'m>,
    belief: Belief,
    agreement: Agreement,
    way_m: f32,
}

/// What a scan has told.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tracked {
    pub(super) located: Located,
    /// Probability that the place is right, wherever exactly.
    pub(super) place_certainty: f32,
}

impl<'m> Tracker<'m> {
    pub(super) fn new(config: &LocalizerConfig, seed: u64, memory: OdometryMemory<'m>) -> Result<Self, NdtMemoryError> {
        Ok(Self {
            odometry: LaserOdometry::new(&config.slam.laser_odometry(), seed, memory)?,
            belief: Belief::new(FOUND_CERTAINTY),
            agreement: Agreement::default(),
            way_m: 0.0,
        })
    }

    /// Puts the robot into the map as it was saved.
    pub(super) fn restart_at(&mut self, map: &KnownMap, map_from_robot: Pose2) -> Result<(), PointCapacityError> {
        self.odometry.restart_at(map_from_robot);
        let (scans, mut beams) = (map.high().scans(), Vec::new());
        for (map_from_scan, scan) in map.high().placed_scans(REFERENCE_APART) {
            if let Some(sweep) = scans.sweep(scan as usize, &mut beams) {
                self.odometry.refer_to(&sweep, map_from_scan)?;
            }
        }
        self.odometry.freeze_reference();
        self.belief = Belief::new(FOUND_CERTAINTY);
        self.way_m = WITNESS_APART_M;
        Ok(())
    }

    pub(super) fn add_scan(
        &mut self,
        map: &KnownMap,
        scan: &RangeScan<'_>,
        robot_from_lrf: Pose2,
    ) -> Result<Tracked, PointCapacityError> {
        let before = self.odometry.map_from_robot();
        let step = self.odometry.step(scan, robot_from_lrf, None)?;
        let map_from_robot = step.matched.map_from_robot;
        let moved = before.between(map_from_robot);
        self.way_m += way_m(moved);
        self.belief.drift(moved, before.heading);
        if self.way_m >= WITNESS_APART_M {
            let mut memory = vec![Point2::default(); scan.beams.len()];
            let count = hits(&Sweep { scan: *scan, robot_from_lrf, motion: step.motion }, &mut memory)?.len();
            memory.truncate(count);
            leave_out_people(&mut memory, (scan, robot_from_lrf), map, map_from_robot);
            self.agreement = map.walls().agreement(&memory, map_from_robot);
            let moved_m = std::mem::take(&mut self.way_m).min(1.0);
            self.belief.observe(self.agreement, &step.matched.covariance, moved_m);
        }
        let located = Located {
            map_from_robot,
            covariance: self.belief.covariance(),
            certainty: self.belief.certainty(),
            on_walls: self.agreement.on_walls,
            contradicting: self.agreement.contradicting,
        };
        Ok(Tracked { located, place_certainty: self.belief.place_certainty() })
    }
}

/// Leaves out those of `hits` (robot frame) that stand alone where the map has no wall: people hide walls, and say nothing about the place.
fn leave_out_people(
    hits: &mut Vec<Point2>,
    (scan, robot_from_lrf): (&RangeScan<'_>, Pose2),
    map: &KnownMap,
    map_from_robot: Pose2,
) {
    let standing = part_lone(hits, scan, robot_from_lrf);
    let lone = hits.split_off(standing);
    hits.extend(lone.iter().filter(|hit| map.walls().is_on_wall(map_from_robot.transform(**hit))));
}

/// Way of a step: a turn of a radian shows as much that is new as half a metre.
pub(super) fn way_m(step: Pose2) -> f32 {
    step.position().norm() + 0.5 * step.heading.abs()
}
