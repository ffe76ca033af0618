//! Does a run say where it is off? While it runs it calls scans lost, or says that the scene leaves an axis undetermined, as along a
//! bare corridor. **What is off, and what of it was told.**

use lrfslam_core::time::Instant;
use lrfslam_host::results::quality::{Quality, Stretch};
use lrfslam_host::trajectory::TimedPose;
use serde::Serialize;

use crate::evaluation::{Relation, relation_errors_m};

/// A relation that is off by more than this ought to be told, m.
const OFF_M: f64 = 0.5;

/// Relations that are off, and what the run said between their two times.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Told {
    /// Relations off by more than 0.5 m.
    pub off: usize,
    /// Of these, with a stretch between their times in which the run said that it does not know where it is, or how far it goes.
    pub off_told: usize,
    /// The same share of all others, 0 to 1: a run that says so all the time tells nothing.
    pub others_told_share: f64,
}

impl Told {
    /// Of a run with this path, from its first scan on.
    pub(super) fn of(path: &[TimedPose], relations: &[Relation], quality: &Quality) -> Self {
        let start = path.first().map(|pose| pose.stamp).unwrap_or_default();
        let seconds = |stamp: Instant| stamp.since(start).micros as f64 / 1e6;
        let is_told = |relation: &Relation| {
            let (from_s, to_s) = (seconds(relation.start), seconds(relation.end));
            let meets = |stretch: &Stretch| stretch.from_s <= to_s && stretch.to_s >= from_s;
            quality.lost.iter().chain(&quality.undetermined).any(meets)
        };
        let (mut told, mut others, mut others_told) = (Self::default(), 0_usize, 0_usize);
        for (relation, error_m) in relation_errors_m(path, relations) {
            if error_m > OFF_M {
                told.off += 1;
                told.off_told += usize::from(is_told(relation));
            } else {
                others += 1;
                others_told += usize::from(is_told(relation));
            }
        }
        Self { others_told_share: others_told as f64 / others.max(1) as f64, ..told }
    }
}

#[cfg(test)]
mod tests {
    use lrfslam_core::geometry::Pose2;
    use lrfslam_host::pose_f64::PoseF64;

    use super::*;

    fn at(seconds: i64) -> Instant {
        Instant::from_micros(1_000_000 * seconds)
    }

    #[test]
    fn what_is_off_is_told_if_its_time_meets_a_stretch() {
        // Stretches count from the first scan.
        let pose = |s: i64| TimedPose { stamp: at(100 + s), map_from_robot: Pose2::new(s as f32, 0.0, 0.0) };
        let path: Vec<TimedPose> = (0..20).map(pose).collect();
        let relation = |from: i64, to: i64, x: f64| Relation {
            start: at(100 + from),
            end: at(100 + to),
            start_from_end: PoseF64::new(x, 0.0, 0.0),
        };
        let stretch = |from_s, to_s| Stretch { from_s, to_s, scans: 3, path_m: 1.0 };
        let quality =
            Quality { lost: vec![stretch(4.0, 5.0)], undetermined: vec![stretch(9.5, 9.7)], ..Quality::default() };
        let relations = [
            relation(0, 3, 4.0),
            relation(3, 4, 2.0),
            relation(9, 10, 0.0),
            relation(5, 6, 1.1),
            relation(11, 12, 1.0),
            relation(0, 50, 1.0),
        ];
        let told = Told::of(&path, &relations, &quality);
        assert_eq!(told, Told { off: 3, off_told: 2, others_told_share: 0.5 });
    }
}
