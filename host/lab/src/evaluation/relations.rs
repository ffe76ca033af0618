//! The relation metric: errors of displacements between pairs of poses, blind to where the map as a whole lies.
//!
//! For a relation (t1, t2, T) and the estimated poses p1 and p2 at these times, e = T⁻¹ ⊕ (p1⁻¹ ⊕ p2); reported are
//! |translation| and |rotation| of e.
//!
//! Source: Kümmerle et al., *On measuring the accuracy of SLAM algorithms*, Autonomous Robots 27, 2009.

use std::path::Path;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::time::{Duration, Instant};
use serde::Serialize;

use super::{EvaluationError, OwnNoise, PosesByTime, Statistics};
use crate::calibration::DisplacementError;
use lrfslam_host::input::table::{TableError, read_table};
use lrfslam_host::pose_f64::PoseF64;
use lrfslam_host::trajectory::TimedPose;

/// A relation is bad from this translation error on, m.
const BAD_M: f64 = 0.10;

/// The true displacement between two times.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relation {
    /// When it begins.
    pub start: Instant,
    /// When it ends.
    pub end: Instant,
    /// The later pose seen from the earlier one, of the robot.
    pub start_from_end: PoseF64,
}

/// Reads `t1 t2 x y z roll pitch yaw` lines (s, m, rad), plain or gzip. z, roll and pitch are not used.
///
/// # Errors
/// If the file cannot be read, has no relation, or a line that is wrong (named).
pub fn read_relations(path: &Path) -> Result<Vec<Relation>, TableError> {
    read_table(path, "t1 t2 x y z roll pitch yaw", |words| {
        let start = Instant::from_secs_f64(words.finite("t1")?);
        let end = Instant::from_secs_f64(words.finite("t2")?);
        let (x, y, _z) = (words.finite("x")?, words.finite("y")?, words.finite("z")?);
        let (_roll, _pitch, yaw) = (words.finite("roll")?, words.finite("pitch")?, words.finite("yaw")?);
        Ok(Relation { start, end, start_from_end: PoseF64::new(x, y, yaw) })
    })
}

/// Errors of all relations.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RelationReport {
    /// Relations in the file.
    pub relations: usize,
    /// Of these, not judged: no pose near enough to one of their times.
    pub unmatched: usize,
    /// Of those judged, with a pose that is near in time but not at the very microsecond.
    pub inexact_times: usize,
    /// How far from a relation's time a pose may lie, s.
    pub tolerance_s: f64,
    /// |translation|, m.
    pub translation_m: Statistics,
    /// |rotation|, degrees.
    pub rotation_deg: Statistics,
    /// Share of those judged whose translation error is above 0.10 m, 0 to 1.
    pub share_above_10_cm: f64,
    /// Times of the worst relation by translation, s.
    pub worst_at_s: (f64, f64),
    /// What the relations are worth themselves, if any three tell.
    pub own_noise: Option<OwnNoise>,
}

/// Judges `poses` by `relations`; a pose may lie up to `tolerance` from a relation's time.
///
/// # Errors
/// If no relation has poses near both its times.
pub fn evaluate_relations(
    poses: &[TimedPose],
    relations: &[Relation],
    tolerance: Duration,
) -> Result<RelationReport, EvaluationError> {
    let judged = judged(poses, relations, tolerance);
    let inexact_times = judged.iter().filter(|(_, _, is_exact)| !is_exact).count();
    let errors: Vec<_> = judged.into_iter().map(|(relation, error, _)| (error, relation)).collect();
    let worst = errors.iter().max_by(|a, b| a.0.distance_m().total_cmp(&b.0.distance_m()));
    let Some((_, worst)) = worst else {
        let times = relations.iter().flat_map(|r| [r.start, r.end]);
        return Err(EvaluationError::nothing_matches(poses, times, tolerance));
    };
    let translations: Vec<f64> = errors.iter().map(|(e, _)| e.distance_m()).collect();
    let rotations: Vec<f64> = errors.iter().map(|(e, _)| e.heading.abs().to_degrees()).collect();
    Ok(RelationReport {
        relations: relations.len(),
        unmatched: relations.len() - errors.len(),
        inexact_times,
        tolerance_s: tolerance.micros as f64 / 1e6,
        translation_m: Statistics::of(&translations),
        rotation_deg: Statistics::of(&rotations),
        share_above_10_cm: translations.iter().filter(|&&t| t > BAD_M).count() as f64 / errors.len() as f64,
        worst_at_s: (worst.start.as_secs_f64(), worst.end.as_secs_f64()),
        own_noise: OwnNoise::of(relations),
    })
}

/// The relations that have poses near both their times, the error of each, and whether these are at the very microsecond.
fn judged<'r>(
    poses: &[TimedPose],
    relations: &'r [Relation],
    tolerance: Duration,
) -> Vec<(&'r Relation, PoseF64, bool)> {
    let by_time = PosesByTime::new(poses);
    let judge = |relation: &'r Relation| {
        let near = |stamp| by_time.nearest(stamp, tolerance);
        let ((first, d1), (second, d2)) = near(relation.start).zip(near(relation.end))?;
        let is_exact = d1 == Duration::ZERO && d2 == Duration::ZERO;
        Some((relation, relation.start_from_end.between(first.between(second)), is_exact))
    };
    relations.iter().filter_map(judge).collect()
}

/// The relations that `poses` have both times of, to the microsecond, and how far each is off, m.
pub fn relation_errors_m<'r>(
    poses: &[TimedPose],
    relations: &'r [Relation],
) -> impl Iterator<Item = (&'r Relation, f64)> {
    judged(poses, relations, Duration::ZERO).into_iter().map(|(relation, error, _)| (relation, error.distance_m()))
}

/// The known displacements of a true path: from every pose to those 1, 2, 4, 8 … poses later.
pub fn relations_of_path(truth: &[TimedPose]) -> Vec<Relation> {
    let lags = std::iter::successors(Some(1_usize), |lag| Some(2 * lag)).take_while(|lag| *lag < truth.len());
    let relation = |(start, end): (&TimedPose, &TimedPose)| {
        let start_from_end = PoseF64::from(start.map_from_robot).between(PoseF64::from(end.map_from_robot));
        Relation { start: start.stamp, end: end.stamp, start_from_end }
    };
    lags.flat_map(|lag| truth.iter().zip(&truth[lag..]).map(relation)).collect()
}

/// Error of every displacement that `path` has within `tolerance` of a relation's times; `steps` up to each of its poses.
pub fn displacement_errors(
    path: &[TimedPose],
    steps: &[u32],
    relations: &[Relation],
    tolerance: Duration,
) -> Vec<DisplacementError> {
    let poses = PosesByTime::new(path);
    // Steps are looked up like poses, as if they were a coordinate.
    let counted: Vec<TimedPose> = path
        .iter()
        .zip(steps)
        .map(|(pose, steps)| TimedPose { map_from_robot: Pose2::new(*steps as f32, 0.0, 0.0), ..*pose })
        .collect();
    let counts = PosesByTime::new(&counted);
    let error = |relation: &Relation| {
        let (first, second) = (poses.nearest(relation.start, tolerance)?.0, poses.nearest(relation.end, tolerance)?.0);
        let (from, to) = (counts.nearest(relation.start, tolerance)?.0.x, counts.nearest(relation.end, tolerance)?.0.x);
        let error = relation.start_from_end.between(first.between(second));
        Some(DisplacementError { steps: (to - from).abs(), error })
    };
    relations.iter().filter_map(error).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(seconds: i64, x: f32, heading: f32) -> TimedPose {
        TimedPose { stamp: Instant::from_micros(seconds * 1_000_000), map_from_robot: Pose2::new(x, 0.0, heading) }
    }

    fn relation(start: i64, end: i64, x: f64) -> Relation {
        let at = |seconds: i64| Instant::from_micros(seconds * 1_000_000);
        Relation { start: at(start), end: at(end), start_from_end: PoseF64::new(x, 0.0, 0.0) }
    }

    #[test]
    fn errors_are_those_of_the_displacements() {
        let poses = [pose(0, 5.0, 0.0), pose(1, 6.5, 0.0), pose(2, 7.0, 0.5)];
        let relations = [relation(0, 1, 1.0), relation(1, 2, 0.5), relation(2, 9, 1.0)];
        let report = evaluate_relations(&poses, &relations, Duration::from_millis(10)).unwrap();
        assert_eq!((report.relations, report.unmatched, report.inexact_times), (3, 1, 0));
        assert!((report.translation_m.mean - 0.25).abs() < 1e-6 && (report.translation_m.max - 0.5).abs() < 1e-6);
        assert!((report.rotation_deg.max - 0.5_f64.to_degrees()).abs() < 1e-5);
        assert_eq!((report.share_above_10_cm, report.worst_at_s), (0.5, (0.0, 1.0)));
    }

    #[test]
    fn times_that_never_meet_are_an_error() {
        let error = evaluate_relations(&[pose(0, 0.0, 0.0)], &[relation(50, 51, 1.0)], Duration::ZERO).unwrap_err();
        assert!(error.to_string().contains("(50.000 to 51.000 s)"), "{error}");
    }
}
