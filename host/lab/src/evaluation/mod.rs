//! How good a trajectory is: against relations between poses, or against the true path.
//!
//! All in `f64`. Times are matched exactly or to the nearest within a tolerance that the report states, and what has no
//! partner is counted, never dropped silently. Standard deviations divide by n.

mod relations;
mod statistics;
mod stretches;
mod triangles;
mod truth;

use lrfslam_core::time::{Duration, Instant};

pub use relations::{
    Relation, RelationReport, displacement_errors, evaluate_relations, read_relations, relation_errors_m,
    relations_of_path,
};
pub use statistics::{Distribution, Statistics};
pub use stretches::{Standing, StretchError, StretchReport, Turn, evaluate_stretches};
pub use triangles::OwnNoise;
pub use truth::{RelativeError, TruthReport, alignment, evaluate_in_frame, evaluate_truth};

use lrfslam_host::pose_f64::PoseF64;
use lrfslam_host::trajectory::TimedPose;

/// Nothing to judge: no pose of the trajectory has a partner.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EvaluationError {
    /// Times do not meet.
    #[error(
        "no pose of the trajectory ({poses} poses, {from_s:.3} to {to_s:.3} s) lies within {tolerance_s} s of a time of \
         the reference ({reference_from_s:.3} to {reference_to_s:.3} s)"
    )]
    NothingMatches {
        /// Poses in the trajectory.
        poses: usize,
        /// Its first time, s.
        from_s: f64,
        /// Its last time, s.
        to_s: f64,
        /// The reference's first time, s.
        reference_from_s: f64,
        /// The reference's last time, s.
        reference_to_s: f64,
        /// Allowed distance, s.
        tolerance_s: f64,
    },
}

impl EvaluationError {
    fn nothing_matches(
        poses: &[TimedPose],
        reference: impl Iterator<Item = Instant> + Clone,
        tolerance: Duration,
    ) -> Self {
        let ends = |times: &mut dyn Iterator<Item = Instant>| {
            let (from, to) = times.fold((i64::MAX, i64::MIN), |(a, b), t| (a.min(t.micros), b.max(t.micros)));
            (from as f64 * 1e-6, to as f64 * 1e-6)
        };
        let (from_s, to_s) = ends(&mut poses.iter().map(|pose| pose.stamp));
        let (reference_from_s, reference_to_s) = ends(&mut reference.clone());
        let tolerance_s = tolerance.micros as f64 / 1e6;
        Self::NothingMatches { poses: poses.len(), from_s, to_s, reference_from_s, reference_to_s, tolerance_s }
    }
}

/// Poses by time. Of several with the same time the first in the file counts.
struct PosesByTime {
    sorted: Vec<(i64, PoseF64)>,
}

impl PosesByTime {
    fn new(poses: &[TimedPose]) -> Self {
        let mut sorted: Vec<_> = poses.iter().map(|p| (p.stamp.micros, PoseF64::from(p.map_from_robot))).collect();
        sorted.sort_by_key(|&(micros, _)| micros);
        sorted.dedup_by_key(|&mut (micros, _)| micros);
        Self { sorted }
    }

    /// The pose nearest in time to `stamp`, if within `tolerance`, and how far that is.
    fn nearest(&self, stamp: Instant, tolerance: Duration) -> Option<(PoseF64, Duration)> {
        let after = self.sorted.partition_point(|&(micros, _)| micros < stamp.micros);
        let candidates = self.sorted.get(after.saturating_sub(1)..(after + 1).min(self.sorted.len()))?;
        let away = |micros: i64| micros.abs_diff(stamp.micros);
        let &(micros, pose) = candidates.iter().min_by_key(|&&(micros, _)| away(micros))?;
        let distance = Duration::from_micros(i64::try_from(away(micros)).unwrap_or(i64::MAX));
        (distance <= tolerance).then_some((pose, distance))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::geometry::Pose2;

    #[test]
    fn nearest_pose_is_found_on_either_side() {
        let pose = |micros: i64, x: f32| TimedPose {
            stamp: Instant::from_micros(micros),
            map_from_robot: Pose2::new(x, 0.0, 0.0),
        };
        let poses = PosesByTime::new(&[pose(200, 2.0), pose(100, 1.0), pose(100, 9.0)]);
        let near = |micros| {
            poses.nearest(Instant::from_micros(micros), Duration::from_micros(30)).map(|(p, d)| (p.x, d.micros))
        };
        assert_eq!(near(100), Some((1.0, 0)));
        assert_eq!(near(80), Some((1.0, 20)));
        assert_eq!(near(171), Some((2.0, 29)));
        assert_eq!(near(230), Some((2.0, 30)));
        assert_eq!((near(150), near(231), near(i64::MIN)), (None, None, None));
        assert!(PosesByTime::new(&[]).nearest(Instant::default(), Duration::ZERO).is_none());
    }
}
