//! What a run hands to those who watch it, see [`monitor`](crate::monitor): nothing is computed unless somebody does.

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::slam::StepReport;
use lrfslam_core::sweep::Sweep;
use nalgebra::Matrix3;

use crate::mapping::high::{HighSlam, SegmentPose, SegmentPoses, Stretch};
use crate::monitor::{Batch, Cursor, Now, State};
use crate::pose_f64::PoseF64;

/// Adds what a high level has come to know since `cursor`.
///
/// * `is_old` — it is a map made before
pub(super) fn show_high(high: &HighSlam<'_>, is_old: bool, batch: &mut Batch, cursor: &mut Cursor) {
    batch.stretches.extend(high.stretches());
    batch.map_piece = high.map_piece();
    batch.closures.extend(high.closures());
    let last = batch.stretches.len() - 1;
    let mut beams = Vec::new();
    loop {
        let poses = high.stretch_poses(cursor.stretch).into_iter().flat_map(SegmentPoses::iter);
        for pose in poses.skip(cursor.poses) {
            if !batch.push(cursor, (cursor.stretch, &pose, is_old), |scan| high.scans().sweep(scan, &mut beams)) {
                return;
            }
        }
        if cursor.stretch >= last {
            return;
        }
        (cursor.stretch, cursor.poses) = (cursor.stretch + 1, 0);
    }
}

/// A stretch that begins at a pose and does not bend.
pub(super) fn stiff(map_from_start: Pose2, piece: usize) -> Stretch {
    Stretch { map_from_start: PoseF64::from(map_from_start), bend: PoseF64::default(), slack_m: 0.0, piece }
}

/// A pose on it.
pub(super) fn pose_on(
    stamp: lrfslam_core::time::Instant,
    start_from_robot: Pose2,
    is_lost: bool,
    scan: Option<u32>,
) -> SegmentPose {
    SegmentPose { stamp, start_from_robot, slack_m: 0.0, scan, is_lost }
}

/// Hits of a scan, robot frame, m, where they lie in the middle of the sweep.
pub(super) fn hits(sweep: &Sweep<'_>) -> Vec<Point2> {
    let at_middle = sweep.scan.beams.iter().map(sweep.middle_beam());
    at_middle.filter_map(|beam| Point2::of_hit(&beam)).map(|hit| sweep.robot_from_lrf.transform(hit)).collect()
}

/// What a step of SLAM says of the robot, with its particles.
pub(super) fn now_of_step(sweep: &Sweep<'_>, step: &StepReport, particles: Vec<(Pose2, f32)>) -> Now {
    let odometry = &step.odometry;
    let state = match (odometry.is_blind, odometry.is_lost, odometry.is_frozen) {
        (true, ..) => State::Blind,
        (_, true, _) => State::Lost,
        (_, _, true) => State::Frozen,
        _ => State::Tracking,
    };
    Now {
        stamp: sweep.scan.stamp,
        map_from_robot: Some(step.map_from_robot),
        low_from_robot: step.map_from_robot,
        covariance: odometry.matched.covariance + spread(&particles),
        undetermined: odometry.matched.undetermined,
        state,
        hits: hits(sweep),
        effective_sample_size: step.filter.map(|filter| filter.effective_sample_size),
        particles,
        ..Now::default()
    }
}

/// Covariance of weighted poses: (x, y, heading), m², m rad, rad².
pub(super) fn spread(particles: &[(Pose2, f32)]) -> Matrix3<f32> {
    let total: f32 = particles.iter().map(|(_, weight)| weight).sum();
    let Some((first, _)) = particles.first().filter(|_| total > 0.0 && total.is_finite()) else {
        return Matrix3::zeros();
    };
    // Seen from one of them: headings do not wrap.
    let apart = |pose: &Pose2| {
        let turn = first.between(*pose).heading;
        nalgebra::Vector3::new(pose.x - first.x, pose.y - first.y, turn)
    };
    let mean = particles.iter().map(|(pose, weight)| apart(pose) * (weight / total)).sum::<nalgebra::Vector3<f32>>();
    let squares = particles.iter().map(|(pose, weight)| {
        let off = apart(pose) - mean;
        off * off.transpose() * (weight / total)
    });
    squares.sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_is_that_about_the_mean() {
        let at = |x: f32, heading: f32| (Pose2::new(x, 5.0, heading), 0.5);
        let spread = spread(&[at(1.0, 3.1), at(3.0, -3.1)]);
        assert!((spread[(0, 0)] - 1.0).abs() < 1e-5 && spread[(1, 1)].abs() < 1e-6, "{spread}");
        assert!(spread[(2, 2)] < 0.002, "{spread}");
        assert_eq!(super::spread(&[]), Matrix3::zeros());
    }
}
