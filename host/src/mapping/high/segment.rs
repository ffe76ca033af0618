//! Segments: short stretches of the low level's path, the atoms of the high level (thesis §3.2.3.4).
//!
//! Steps of the low level → [`Segment`], cut when it has gone far enough. A segment is believed to be right within itself but for
//! a Gaussian drift of its end, whose covariance is summed up from step to step. The last pose of a segment is
//! the first one of the next.

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::time::Instant;
use nalgebra::{Matrix2, Matrix3, Vector2};

use super::poses::SegmentPoses;
use crate::pose_f64::PoseF64;

/// Travel after which a segment ends, m. The original: 40 scans at least 5 cm apart.
pub(super) const TRAVEL_M: f32 = 4.0;
/// … or this much rotation, both ways added up, degrees.
const ROTATION_DEG: f32 = 360.0;
/// Standard deviation of the drift in position, m per square root of a metre driven: chosen, on the safe side of what is measured
/// (thesis 4.5.2), as all that follow.
const DRIFT_M: f32 = 0.02;
/// Standard deviation of the drift in heading, degrees per square root of a metre driven.
const DRIFT_DEG: f32 = 0.15;
/// The same per square root of a radian turned, degrees.
const DRIFT_TURNING_DEG: f32 = 0.15;
/// Along an axis that the scene left undetermined, as a share of the way driven so.
const DRIFT_UNDETERMINED: f32 = 0.3;
/// Way driven so counts so many times where a correction of the segment's end is spread: about the ratio of the drifts, a metre long.
const SLACK_UNDETERMINED: f32 = 20.0;
/// Of a scan that was lost, m.
const DRIFT_LOST_M: f32 = 0.3;
/// Of a scan that was lost, degrees.
const DRIFT_LOST_DEG: f32 = 3.0;

/// Variances of position, m², and heading, rad², that matching drifts by on a step.
pub(crate) fn drift_variances(step: Pose2) -> (f64, f64) {
    let (travel, turn) = (f64::from(step.position().norm()), f64::from(step.heading.abs()));
    let heading = square(DRIFT_DEG.to_radians()) * travel + square(DRIFT_TURNING_DEG.to_radians()) * turn;
    (square(DRIFT_M) * travel, heading)
}

fn square(value: f32) -> f64 {
    f64::from(value) * f64::from(value)
}

/// What the low level did from one scan to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LowStep {
    /// Of the scan.
    pub stamp: Instant,
    /// Pose of the robot now, seen from where it was.
    pub previous_from_robot: Pose2,
    /// Unit vector in the frame of the pose before about which the scene says nothing.
    pub undetermined: Option<Point2>,
    /// The scan agrees too little with the map for the pose to be believed.
    pub is_lost: bool,
    /// Place of the scan among the stored ones, if it is stored.
    pub scan: Option<u32>,
}

/// A pose of a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentPose {
    /// Of the scan.
    pub stamp: Instant,
    /// Pose of the robot, seen from the segment's start.
    pub start_from_robot: Pose2,
    /// Way from the segment's start, m; that along axes about which the scene said nothing counts several times.
    pub slack_m: f32,
    /// Place of the scan among the stored ones, if it is stored.
    pub scan: Option<u32>,
    /// The scan fits nowhere: the pose is a guess.
    pub is_lost: bool,
}

/// A stretch of the low level's path; see the [module](self).
#[derive(Debug, Clone)]
pub struct Segment {
    /// Poses after the start, in order; the first segment begins with the start itself.
    pub poses: SegmentPoses,
    /// The end seen from the start.
    pub start_from_end: PoseF64,
    /// Covariance of (x, y, heading) of that; m², m rad, rad².
    pub covariance: Matrix3<f64>,
    /// Length of the way, m.
    pub travel_m: f32,
    /// The same with way along which the scene said nothing counted more often: what moves the end is spread in proportion.
    pub slack_m: f32,
    /// Rotation, both ways added up, rad.
    pub(super) rotation_rad: f32,
}

impl Segment {
    /// Nothing yet.
    pub fn empty() -> Self {
        Self {
            poses: SegmentPoses::default(),
            start_from_end: PoseF64::default(),
            covariance: Matrix3::zeros(),
            travel_m: 0.0,
            slack_m: 0.0,
            rotation_rad: 0.0,
        }
    }

    /// Goes on by one step of the low level.
    pub fn push(&mut self, step: &LowStep) {
        let displacement = PoseF64::from(step.previous_from_robot);
        self.covariance = self.drifted(step);
        self.start_from_end = self.start_from_end.then(displacement);
        let way = step.previous_from_robot.position().norm();
        self.travel_m += way;
        self.slack_m += if step.undetermined.is_some() { SLACK_UNDETERMINED * way } else { way };
        self.rotation_rad += step.previous_from_robot.heading.abs();
        self.poses.push(SegmentPose {
            stamp: step.stamp,
            start_from_robot: self.start_from_end.to_f32(),
            slack_m: self.slack_m,
            scan: step.scan,
            is_lost: step.is_lost,
        });
    }

    /// Its poses are these, and its end is there; what the low level told of the way stays with the graph.
    pub(super) fn put(&mut self, poses: SegmentPoses, start_from_end: PoseF64) {
        (self.poses, self.start_from_end) = (poses, start_from_end);
    }

    /// What the low level tells of the way: the end seen from the start, and the inverse of the covariance of that.
    pub(super) fn told(&self) -> (PoseF64, Matrix3<f64>) {
        let information = (self.covariance + Matrix3::from_diagonal_element(1e-8)).try_inverse();
        (self.start_from_end, information.unwrap_or_else(|| Matrix3::from_diagonal_element(1.0)))
    }

    /// True if it has gone as far as a segment should.
    pub fn is_complete(&self) -> bool {
        self.travel_m >= TRAVEL_M || self.rotation_rad >= ROTATION_DEG.to_radians()
    }

    /// The covariance after one more step: Σ' = F Σ Fᵀ + Q, all in the start's axes.
    fn drifted(&self, step: &LowStep) -> Matrix3<f64> {
        let end = self.start_from_end.then(PoseF64::from(step.previous_from_robot));
        let (dx, dy) = (end.x - self.start_from_end.x, end.y - self.start_from_end.y);
        let carried = Matrix3::new(1.0, 0.0, -dy, 0.0, 1.0, dx, 0.0, 0.0, 1.0);
        carried * self.covariance * carried.transpose() + self.step_noise(step)
    }

    fn step_noise(&self, step: &LowStep) -> Matrix3<f64> {
        let travel = f64::from(step.previous_from_robot.position().norm());
        let lost = f64::from(u8::from(step.is_lost));
        let (position, heading) = drift_variances(step.previous_from_robot);
        let position = position + lost * square(DRIFT_LOST_M);
        let heading = heading + lost * square(DRIFT_LOST_DEG.to_radians());
        let mut plane = Matrix2::from_diagonal_element(position);
        if let Some(axis) = step.undetermined {
            let (sin, cos) = self.start_from_end.heading.sin_cos();
            let (x, y) = (f64::from(axis.x), f64::from(axis.y));
            let along = Vector2::new(cos * x - sin * y, sin * x + cos * y);
            // What is guessed wrong for one step is guessed wrong for the next one too: deviations add up, not variances.
            let sigma = f64::from(DRIFT_UNDETERMINED) * travel;
            let so_far = (along.transpose() * self.covariance.fixed_view::<2, 2>(0, 0) * along)[0].max(0.0).sqrt();
            plane += along * along.transpose() * (sigma * sigma + 2.0 * sigma * so_far);
        }
        let mut noise = Matrix3::zeros();
        noise.fixed_view_mut::<2, 2>(0, 0).copy_from(&plane);
        noise[(2, 2)] = heading;
        noise
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(forward: f32, turn: f32) -> LowStep {
        let previous_from_robot = Pose2::new(forward, 0.0, turn);
        LowStep { stamp: Instant::default(), previous_from_robot, undetermined: None, is_lost: false, scan: None }
    }

    #[test]
    fn a_segment_ends_after_its_travel_and_knows_its_end() {
        let mut segment = Segment::empty();
        let mut steps = 0;
        while !segment.is_complete() {
            segment.push(&step(0.5, 0.1));
            steps += 1;
        }
        assert_eq!((steps, segment.poses.len()), (8, 8));
        let end = (0..8).fold(Pose2::IDENTITY, |pose, _| pose * Pose2::new(0.5, 0.0, 0.1));
        let error = segment.poses.last().unwrap().start_from_robot.between(end);
        assert!(error.position().norm() < 1e-5 && error.heading.abs() < 1e-5);
    }

    /// Heading drifts add up to a sideways one as they do when they are drawn.
    #[test]
    fn covariance_is_that_of_drawn_drifts() {
        let mut segment = Segment::empty();
        (0..100).for_each(|_| segment.push(&step(0.1, 0.0)));
        let mut sideways = 0.0;
        for run in 0..2000 {
            let mut rng = lrfslam_core::random::RandomStream::new(1, run, 0);
            let mut pose = Pose2::IDENTITY;
            for _ in 0..100 {
                let mut noise = |sigma: f32| sigma * 0.1_f32.sqrt() * lrfslam_core::math::normal(&mut rng);
                let (x, y) = (noise(DRIFT_M), noise(DRIFT_M));
                pose = pose * Pose2::new(0.1 + x, y, noise(DRIFT_DEG.to_radians()));
            }
            sideways += f64::from(pose.y * pose.y) / 2000.0;
        }
        let expected = segment.covariance[(1, 1)];
        assert!((sideways / expected - 1.0).abs() < 0.12, "{sideways} {expected}");
    }

    #[test]
    fn undetermined_axis_widens_along_itself_only() {
        let (mut plain, mut corridor) = (Segment::empty(), Segment::empty());
        for _ in 0..40 {
            plain.push(&step(0.1, 0.0));
            corridor.push(&LowStep { undetermined: Some(Point2::new(1.0, 0.0)), ..step(0.1, 0.0) });
        }
        let along = corridor.covariance[(0, 0)].sqrt();
        assert!((1.15..1.3).contains(&along), "{along}");
        assert!((corridor.covariance[(1, 1)] - plain.covariance[(1, 1)]).abs() < 1e-12);
    }
}
