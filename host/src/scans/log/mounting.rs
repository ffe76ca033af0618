//! The laser's place on the robot, from the two odometry poses that a CARMEN scan carries.
//!
//! robot⁻¹ ⊕ laser is a constant of the robot, printed with rounding, and nonsense in a scan that was logged before
//! either pose was known. So: the median, number by number, over the first scans whose values are sane (finite, at most
//! [`OFFSET_MAX_M`] apart), rounded to 0.1 mm and 0.0001 rad. Later scans do not change it; those that disagree are
//! counted.

use lrfslam_core::geometry::Pose2;

use super::raw::RawScan;
use crate::pose_f64::{PoseF64, wrap};

/// No small robot carries its laser farther from its centre.
const OFFSET_MAX_M: f64 = 3.0;

/// A scan that disagrees by more (m, rad) is counted.
const AGREEMENT: f64 = 0.02;

/// Collects, then decides.
#[derive(Debug, Default)]
pub(super) struct Mounting {
    samples: Vec<PoseF64>,
    decided: Option<Option<PoseF64>>,
}

impl Mounting {
    /// Takes a scan into account, unless the decision has been made.
    pub fn observe(&mut self, scan: &RawScan) {
        if self.decided.is_none() {
            self.samples.extend(offset(scan));
        }
    }

    /// The mounting; the first call decides. `None` if no scan told it.
    pub fn robot_from_lrf(&mut self) -> Option<Pose2> {
        let decided = self.decided.get_or_insert_with(|| median_pose(&self.samples));
        decided.map(PoseF64::to_f32)
    }

    /// True if `scan` says something else than was decided.
    pub fn contradicted_by(&self, scan: &RawScan) -> bool {
        let (Some(Some(decided)), Some(offset)) = (self.decided, offset(scan)) else { return false };
        let error = decided.between(offset);
        error.distance_m() > AGREEMENT || error.heading.abs() > AGREEMENT
    }
}

/// What one scan says, if it is sane.
fn offset(scan: &RawScan) -> Option<PoseF64> {
    let offset = scan.odometry_from_robot?.between(scan.odometry_from_lrf?);
    (offset.is_finite() && offset.distance_m() <= OFFSET_MAX_M).then_some(offset)
}

fn median_pose(samples: &[PoseF64]) -> Option<PoseF64> {
    let first = samples.first()?;
    let middle = |number: &dyn Fn(&PoseF64) -> f64| {
        let mut values: Vec<f64> = samples.iter().map(number).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or_default()
    };
    // Headings relative to the first one, so that ±180° do not tear apart.
    let heading = first.heading + middle(&|sample| wrap(sample.heading - first.heading));
    let rounded = |value: f64| (value * 1e4).round() / 1e4 + 0.0;
    Some(PoseF64::new(rounded(middle(&|s| s.x)), rounded(middle(&|s| s.y)), rounded(wrap(heading))))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan(robot: PoseF64, mounting: PoseF64) -> RawScan {
        let mut scan = RawScan::new(1, vec![1.0]);
        scan.odometry_from_robot = Some(robot);
        scan.odometry_from_lrf = Some(robot.then(mounting));
        scan
    }

    #[test]
    fn median_survives_rounding_and_a_wrong_first_scan() {
        let mut mounting = Mounting::default();
        mounting.observe(&scan(PoseF64::new(0.0, 0.0, 0.0), PoseF64::new(900.0, 0.0, 0.0)));
        mounting.observe(&scan(PoseF64::new(0.0, 0.0, 0.0), PoseF64::new(0.0, 0.0, 0.0)));
        for i in 0..5 {
            let robot = PoseF64::new(10.0 * f64::from(i), -3.0, f64::from(i));
            mounting.observe(&scan(robot, PoseF64::new(0.250_003, -0.000_004, 0.000_002)));
        }
        assert_eq!(mounting.robot_from_lrf(), Some(Pose2::new(0.25, 0.0, 0.0)));
        assert!(!mounting.contradicted_by(&scan(PoseF64::default(), PoseF64::new(0.26, 0.0, 0.0))));
        assert!(mounting.contradicted_by(&scan(PoseF64::default(), PoseF64::new(0.3, 0.0, 0.0))));
    }

    #[test]
    fn laser_looking_backwards_keeps_its_heading() {
        let mut mounting = Mounting::default();
        let back = std::f64::consts::PI - 3e-6;
        for heading in [back, -back, -back] {
            mounting.observe(&scan(PoseF64::default(), PoseF64::new(-0.1, 0.0, heading)));
        }
        let heading = mounting.robot_from_lrf().unwrap().heading;
        assert!((heading.abs() - std::f32::consts::PI).abs() < 2e-4);
    }

    #[test]
    fn log_without_poses_has_no_mounting() {
        let mut mounting = Mounting::default();
        mounting.observe(&RawScan::new(1, vec![1.0]));
        assert_eq!(mounting.robot_from_lrf(), None);
    }
}
