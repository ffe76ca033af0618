//! What a demonstration thinks of itself, in words.

use lrfslam_host::pose_f64::PoseF64;
use lrfslam_host::trajectory::{TimedPose, by_time};
use lrfslam_lab::evaluation::Statistics;

/// Wanted at the noise of an LMS200: root mean square of the path's error, m and degrees.
const PATH_M: f64 = 0.03;
const PATH_DEG: f64 = 0.3;
/// Wanted share of the cloud's points near a true surface.
const CLOUD_NEAR: f64 = 0.95;

/// The errors of a demonstration.
pub struct Errors {
    /// Of the positions, after the best rigid motion between map and truth, m.
    pub path_m: Statistics,
    /// Of the headings after it, degrees.
    pub path_deg: Statistics,
    /// Of the positions if the truth begins where the path does, as they are told on the way, m.
    pub from_start_m: Statistics,
    /// From the cloud's points to the nearest true surface, m.
    pub cloud_m: Statistics,
    /// Share of them that are near one.
    pub cloud_near: f64,
}

/// Whether `errors` are as wanted, and where they are worst.
///
/// * `poses`, `truth` — in the same frame; a pose's truth is the one nearest to it in time, in whatever order they stand
pub fn verdict(errors: &Errors, poses: &[TimedPose], truth: &[TimedPose]) -> String {
    let (position_cm, heading_deg) = (errors.path_m.rmse * 100.0, errors.path_deg.rmse);
    let checks = [
        (
            errors.path_m.rmse <= PATH_M,
            format!("position {position_cm:.1} cm RMSE, at most {:.0} wanted", PATH_M * 100.0),
        ),
        (heading_deg <= PATH_DEG, format!("heading {heading_deg:.2}° RMSE, at most {PATH_DEG} wanted")),
        (
            errors.cloud_near >= CLOUD_NEAR || errors.cloud_m.count == 0,
            format!("{:.1} % of the cloud near a surface, {:.0} wanted", errors.cloud_near * 100.0, CLOUD_NEAR * 100.0),
        ),
    ];
    let failed: Vec<&str> = checks.iter().filter(|(is_met, _)| !is_met).map(|(_, text)| text.as_str()).collect();
    let worst = worst(poses, truth);
    if failed.is_empty() {
        return format!("Verdict: GOOD. Path, heading and cloud are as near to the truth as wanted. {worst}");
    }
    let doubled =
        if errors.path_m.max > 0.1 { " Walls seen there and at another time may stand twice in the map." } else { "" };
    format!("Verdict: NOT AS WANTED: {}. {worst}{doubled}", failed.join("; "))
}

/// Where the path is farthest from the truth.
fn worst(poses: &[TimedPose], truth: &[TimedPose]) -> String {
    let error_m = |(pose, truth): &(&TimedPose, &TimedPose)| {
        PoseF64::from(truth.map_from_robot).between(pose.map_from_robot.into()).distance_m()
    };
    let truth = by_time(truth.to_vec());
    let pairs = poses.iter().filter_map(|pose| {
        let after = truth.partition_point(|true_pose| true_pose.stamp < pose.stamp);
        let about = truth[after.saturating_sub(1)..].iter().take(2);
        Some((pose, about.min_by_key(|true_pose| true_pose.stamp.micros.abs_diff(pose.stamp.micros))?))
    });
    let Some(worst) = pairs.max_by(|a, b| error_m(a).total_cmp(&error_m(b))) else { return String::new() };
    let after_s = worst.0.stamp.as_secs_f64() - poses[0].stamp.as_secs_f64();
    let place = worst.0.map_from_robot;
    format!(
        "Worst after {after_s:.0} s, at {:.1}, {:.1} m in the map: {:.1} cm off.",
        place.x,
        place.y,
        error_m(&worst) * 100.0
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::geometry::Pose2;
    use lrfslam_core::time::Instant;

    fn path(y_m: [f32; 3]) -> Vec<TimedPose> {
        let pose = |(i, y): (u8, f32)| TimedPose {
            stamp: Instant::from_micros(5_000_000 + i64::from(i) * 10_000_000),
            map_from_robot: Pose2::new(f32::from(i), y, 0.0),
        };
        (0..).zip(y_m).map(pose).collect()
    }

    fn errors(path_m: f64, heading_deg: f64, cloud_near: f64) -> Errors {
        let of = |value| Statistics::of(&[value]);
        Errors { path_m: of(path_m), path_deg: of(heading_deg), from_start_m: of(0.0), cloud_m: of(0.0), cloud_near }
    }

    #[test]
    fn a_good_drive_is_called_good_and_its_worst_place_told() {
        let text = verdict(&errors(0.02, 0.1, 0.99), &path([0.0, 0.02, 0.01]), &path([0.0; 3]));
        assert!(
            text.starts_with("Verdict: GOOD.")
                && text.ends_with("Worst after 10 s, at 1.0, 0.0 m in the map: 2.0 cm off."),
            "{text}"
        );
    }

    #[test]
    fn scans_that_are_read_at_once_do_not_shift_the_truth() {
        let truth = path([0.0, 0.0, 0.0]);
        let truth = [truth[0], truth[1], truth[0], truth[2], truth[1]];
        let text = verdict(&errors(0.02, 0.1, 0.99), &path([0.0, 0.02, 0.01]), &truth);
        assert!(text.ends_with("Worst after 10 s, at 1.0, 0.0 m in the map: 2.0 cm off."), "{text}");
    }

    #[test]
    fn what_is_not_as_wanted_is_named() {
        let text = verdict(&errors(0.3, 0.1, 0.5), &path([0.0, 0.0, 0.3]), &path([0.0; 3]));
        assert!(
            text.starts_with("Verdict: NOT AS WANTED: position 30.0 cm RMSE, at most 3 wanted; 50.0 % of the cloud"),
            "{text}"
        );
        assert!(
            !text.contains("heading") && text.contains("Worst after 20 s") && text.contains("stand twice"),
            "{text}"
        );
        assert!(verdict(&errors(0.01, 0.4, 0.99), &path([0.0; 3]), &path([0.0; 3])).contains("WANTED: heading 0.40°"));
    }
}
