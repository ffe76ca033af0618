//! Where the robot is now, for those who are told at every scan.

use lrfslam_core::geometry::Pose2;
use lrfslam_core::slam::StepReport;
use nalgebra::Matrix3;

use super::MapRun;
use crate::mapping::LowLevel as _;
use crate::mapping::high::HighSlam;
use crate::pose_f64::PoseF64;
use crate::runs::live::spread;

/// Where the robot is by the map, and by its laser odometry alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Whereabouts {
    /// In the map, as its highest level has it; it jumps when a loop closes.
    pub map_from_robot: Pose2,
    /// Of it: (x, y, heading) in the map's frame, m², m rad, rad².
    pub covariance: Matrix3<f32>,
    /// By laser odometry: it drifts, and never jumps. It begins at the origin.
    pub odom_from_robot: PoseF64,
    /// How the robot moved since the scan before, in its own frame then.
    pub moved: PoseF64,
    /// Of the last match: (x, y, heading) in the robot's own frame.
    pub match_covariance: Matrix3<f32>,
}

impl MapRun<'_> {
    /// Where the robot is after the `step` that was taken last.
    pub fn whereabouts(&self, step: &StepReport) -> Whereabouts {
        let matched = &step.odometry.matched;
        Whereabouts {
            map_from_robot: self.high.as_ref().map_or(step.map_from_robot, HighSlam::map_from_robot),
            covariance: matched.covariance + spread(&self.low.particles()),
            odom_from_robot: self.odom_from_robot,
            moved: self.moved,
            match_covariance: turned(matched.covariance, -matched.map_from_robot.heading),
        }
    }
}

/// Covariance of (x, y, heading) in a frame that is turned by `angle_rad` against its own.
fn turned(covariance: Matrix3<f32>, angle_rad: f32) -> Matrix3<f32> {
    let (sin, cos) = angle_rad.sin_cos();
    let turn = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
    turn * covariance * turn.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_uncertain_ahead_is_uncertain_to_the_left_of_who_looks_right() {
        let ahead = Matrix3::from_diagonal(&nalgebra::Vector3::new(4.0, 1.0, 0.5));
        let turned = turned(ahead, std::f32::consts::FRAC_PI_2);
        assert!((turned - Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, 4.0, 0.5))).norm() < 1e-6, "{turned}");
    }
}
