//! Errors against a true path: absolute, after the best rigid alignment, and relative, over stretches of the way.
//!
//! Alignment: rotation and translation of the plane that bring the estimated positions nearest to the true ones in the
//! mean square, no scale. Source: Umeyama, IEEE PAMI 13(4), 1991, in the plane, where the rotation is an `atan2`.
//! The two errors are those of Sturm et al., IROS 2012 (TUM's benchmark), the relative one over distance as in KITTI's.

use lrfslam_core::time::Duration;
use serde::Serialize;

use super::{EvaluationError, PosesByTime, Statistics};
use lrfslam_host::pose_f64::{PoseF64, wrap};
use lrfslam_host::trajectory::TimedPose;

/// So near, m, a robot is back at a place …
const REVISIT_M: f64 = 1.0;
/// … after so much way, m.
const REVISIT_WAY_M: f64 = 20.0;
/// Poses looked at for that.
const REVISITS_MAX: usize = 2000;

/// Errors against the true path.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TruthReport {
    /// Poses of the true path.
    pub truth_poses: usize,
    /// Of these, without an estimated pose near enough in time.
    pub unmatched: usize,
    /// How far apart in time partners may lie, s.
    pub tolerance_s: f64,
    /// True if the error below is taken after rigid alignment, false if both paths were taken to be in the same frame.
    pub aligned: bool,
    /// Absolute trajectory error: distance of the positions, m.
    pub absolute_m: Statistics,
    /// Share of the poses that are within 0.10 m.
    pub share_within_10_cm: f64,
    /// Difference of the headings, degrees.
    pub absolute_deg: Statistics,
    /// Error of the displacement over stretches of the true path.
    pub relative: RelativeError,
    /// Error of a pose as seen from an earlier one where the robot truly was within a metre, at least 20 m of way before: how well loops
    /// close. Of each pose, the worst; none if the robot never came back. m.
    pub revisit_m: Statistics,
}

/// Drift over stretches of equal length.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RelativeError {
    /// Length of a stretch along the true path, m; one begins at every pose.
    pub stretch_m: f64,
    /// |translation| of the error per metre of way.
    pub translation_m_per_m: Statistics,
    /// |rotation| of the error per metre of way, degrees.
    pub rotation_deg_per_m: Statistics,
}

/// Judges `poses` by the path `truth`; partners may lie up to `tolerance` apart in time.
///
/// # Errors
/// If no pose has a partner.
pub fn evaluate_truth(
    poses: &[TimedPose],
    truth: &[TimedPose],
    tolerance: Duration,
    stretch_m: f64,
) -> Result<TruthReport, EvaluationError> {
    let pairs = partners(poses, truth, tolerance)?;
    let truth_from_estimate = align(&pairs);
    Ok(TruthReport { aligned: true, ..judge(&pairs, truth_from_estimate, truth.len(), tolerance, stretch_m) })
}

/// The same for paths in one frame: nothing is aligned.
///
/// # Errors
/// If no pose has a partner.
pub fn evaluate_in_frame(
    poses: &[TimedPose],
    truth: &[TimedPose],
    tolerance: Duration,
    stretch_m: f64,
) -> Result<TruthReport, EvaluationError> {
    let pairs = partners(poses, truth, tolerance)?;
    Ok(judge(&pairs, PoseF64::default(), truth.len(), tolerance, stretch_m))
}

fn judge(
    pairs: &[(PoseF64, PoseF64)],
    truth_from_estimate: PoseF64,
    truth_poses: usize,
    tolerance: Duration,
    stretch_m: f64,
) -> TruthReport {
    let errors = pairs.iter().map(|&(truth, estimate)| (truth, truth_from_estimate.then(estimate)));
    let distances: Vec<f64> = errors.clone().map(|(t, e)| (e.x - t.x).hypot(e.y - t.y)).collect();
    let angles: Vec<f64> = errors.map(|(t, e)| wrap(e.heading - t.heading).abs().to_degrees()).collect();
    let within = distances.iter().filter(|distance| **distance <= 0.1).count();
    TruthReport {
        truth_poses,
        unmatched: truth_poses - pairs.len(),
        tolerance_s: tolerance.micros as f64 / 1e6,
        aligned: false,
        absolute_m: Statistics::of(&distances),
        share_within_10_cm: within as f64 / pairs.len() as f64,
        absolute_deg: Statistics::of(&angles),
        relative: relative(pairs, stretch_m),
        revisit_m: revisits(pairs),
    }
}

/// The rigid motion that brings `poses` nearest to the path `truth`, as [`evaluate_truth`] takes it out.
///
/// # Errors
/// If no pose has a partner.
pub fn alignment(poses: &[TimedPose], truth: &[TimedPose], tolerance: Duration) -> Result<PoseF64, EvaluationError> {
    partners(poses, truth, tolerance).map(|pairs| align(&pairs))
}

/// True poses (first) with the estimated ones nearest in time (second).
fn partners(
    poses: &[TimedPose],
    truth: &[TimedPose],
    tolerance: Duration,
) -> Result<Vec<(PoseF64, PoseF64)>, EvaluationError> {
    let by_time = PosesByTime::new(poses);
    let partner =
        |t: &TimedPose| by_time.nearest(t.stamp, tolerance).map(|(pose, _)| (PoseF64::from(t.map_from_robot), pose));
    let pairs: Vec<(PoseF64, PoseF64)> = truth.iter().filter_map(partner).collect();
    if pairs.is_empty() {
        return Err(EvaluationError::nothing_matches(poses, truth.iter().map(|t| t.stamp), tolerance));
    }
    Ok(pairs)
}

/// The rigid motion that carries the estimates (second) onto the truth (first).
fn align(pairs: &[(PoseF64, PoseF64)]) -> PoseF64 {
    let n = pairs.len() as f64;
    let mean = |of: &dyn Fn(&(PoseF64, PoseF64)) -> f64| pairs.iter().map(of).sum::<f64>() / n;
    let (tx, ty) = (mean(&|p| p.0.x), mean(&|p| p.0.y));
    let (ex, ey) = (mean(&|p| p.1.x), mean(&|p| p.1.y));
    let dot = mean(&|(t, e)| (e.x - ex) * (t.x - tx) + (e.y - ey) * (t.y - ty));
    let cross = mean(&|(t, e)| (e.x - ex) * (t.y - ty) - (e.y - ey) * (t.x - tx));
    let heading = cross.atan2(dot);
    let (sin, cos) = heading.sin_cos();
    PoseF64::new(tx - (cos * ex - sin * ey), ty - (sin * ex + cos * ey), heading)
}

/// One stretch from every pose to the first one at least `stretch_m` farther along the true path.
fn relative(pairs: &[(PoseF64, PoseF64)], stretch_m: f64) -> RelativeError {
    let way_m = true_way_m(pairs);
    let (mut translations, mut rotations) = (Vec::new(), Vec::new());
    for start in 0..pairs.len() {
        let end = way_m.partition_point(|&way| way < way_m[start] + stretch_m);
        let Some(&(truth, estimate)) = pairs.get(end).filter(|_| end > start) else { continue };
        let error = pairs[start].0.between(truth).between(pairs[start].1.between(estimate));
        let length_m = way_m[end] - way_m[start];
        translations.push(error.distance_m() / length_m);
        rotations.push(error.heading.abs().to_degrees() / length_m);
    }
    let (translation_m_per_m, rotation_deg_per_m) = (Statistics::of(&translations), Statistics::of(&rotations));
    RelativeError { stretch_m, translation_m_per_m, rotation_deg_per_m }
}

/// Way along the true path up to every pose, m.
fn true_way_m(pairs: &[(PoseF64, PoseF64)]) -> Vec<f64> {
    let mut way_m = vec![0.0; pairs.len()];
    for i in 1..pairs.len() {
        way_m[i] = way_m[i - 1] + pairs[i - 1].0.between(pairs[i].0).distance_m();
    }
    way_m
}

fn revisits(pairs: &[(PoseF64, PoseF64)]) -> Statistics {
    let way_m = true_way_m(pairs);
    let worst = |newer: usize| {
        let (truth, estimate) = pairs[newer];
        let older = way_m[..newer].partition_point(|&way| way <= way_m[newer] - REVISIT_WAY_M);
        let visits = pairs[..older].iter().filter(|(before, _)| before.between(truth).distance_m() <= REVISIT_M);
        let errors =
            visits.map(|(before, estimated)| before.between(truth).between(estimated.between(estimate)).distance_m());
        errors.max_by(f64::total_cmp)
    };
    Statistics::of(&(0..pairs.len()).step_by(pairs.len() / REVISITS_MAX + 1).filter_map(worst).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::time::Instant;

    fn path(motion: PoseF64, stretch: f64) -> Vec<TimedPose> {
        let on_circle = |i: i32| {
            let angle = f64::from(i) * 0.1;
            PoseF64::new(5.0 * angle.cos() * stretch, 5.0 * angle.sin() * stretch, wrap(angle + 1.57))
        };
        (0..50)
            .map(|i| TimedPose {
                stamp: Instant::from_micros(i64::from(i) * 1000),
                map_from_robot: motion.then(on_circle(i)).to_f32(),
            })
            .collect()
    }

    #[test]
    fn moved_path_has_no_error() {
        let moved = path(PoseF64::new(30.0, -7.0, 2.9), 1.0);
        let report = evaluate_truth(&moved, &path(PoseF64::default(), 1.0), Duration::ZERO, 2.0).unwrap();
        assert!(report.absolute_m.max < 1e-5 && report.absolute_deg.max < 1e-4, "{report:?}");
        let in_frame = evaluate_in_frame(&moved, &path(PoseF64::default(), 1.0), Duration::ZERO, 2.0).unwrap();
        assert!(in_frame.absolute_m.mean > 20.0 && in_frame.share_within_10_cm == 0.0, "{in_frame:?}");
        assert_eq!(report.share_within_10_cm, 1.0);
        assert!(report.relative.translation_m_per_m.max < 1e-5);
        assert_eq!((report.unmatched, report.absolute_m.count), (0, 50));
    }

    #[test]
    fn stretched_path_is_not_scaled_away() {
        let report =
            evaluate_truth(&path(PoseF64::default(), 1.1), &path(PoseF64::default(), 1.0), Duration::ZERO, 2.0)
                .unwrap();
        assert!(report.absolute_m.mean > 0.3);
        assert!((report.relative.translation_m_per_m.mean - 0.1).abs() < 0.002, "{:?}", report.relative);
        assert!((report.relative.translation_m_per_m.count as i32 - 46).abs() <= 1);
    }

    /// Five metres of radius: once round is 31 m. The second round is estimated 0.3 m beside the first.
    #[test]
    fn revisits_tell_how_well_the_loop_closes() {
        let pose = |i: i32, beside: f64| {
            let angle = f64::from(i) * 0.1;
            let pose = PoseF64::new((5.0 + beside) * angle.cos(), (5.0 + beside) * angle.sin(), wrap(angle + 1.57));
            TimedPose { stamp: Instant::from_micros(i64::from(i) * 1000), map_from_robot: pose.to_f32() }
        };
        let truth: Vec<TimedPose> = (0..90).map(|i| pose(i, 0.0)).collect();
        let estimate: Vec<TimedPose> = (0..90).map(|i| pose(i, if i < 63 { 0.0 } else { 0.3 })).collect();
        let report = evaluate_truth(&estimate, &truth, Duration::ZERO, 2.0).unwrap();
        assert!(report.revisit_m.count > 20 && (report.revisit_m.max - 0.3).abs() < 0.07, "{:?}", report.revisit_m);
        assert_eq!(evaluate_truth(&truth[..50], &truth, Duration::ZERO, 2.0).unwrap().revisit_m.count, 0);
    }

    #[test]
    fn path_without_partners_is_an_error() {
        let late = [TimedPose { stamp: Instant::from_micros(9_000_000), ..path(PoseF64::default(), 1.0)[0] }];
        assert!(evaluate_truth(&late, &path(PoseF64::default(), 1.0), Duration::ZERO, 1.0).is_err());
    }
}
