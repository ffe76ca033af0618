//! The hard stretches of a log, found by its odometry: the robot standing still, and turning fastest.
//!
//! Odometry drifts over a building but is right over seconds: where it says that nothing moves the path must not drift,
//! and in a turn no scan's step may depart from it by more than the wheels can slip.

use serde::Serialize;

use super::Statistics;
use lrfslam_host::pose_f64::PoseF64;
use lrfslam_host::scans::log::LogScan;
use lrfslam_host::trajectory::TimedPose;

/// Odometry that stays this near to where it was means standing.
const STANDING_M: f64 = 0.005;
const STANDING_RAD: f64 = 0.004;
/// Shorter stands are passed over, s.
const STANDING_MIN_S: f64 = 20.0;
/// Consecutive scans that make a turn.
const TURN_SCANS: usize = 10;
/// Stretches listed of each kind.
const LISTED: usize = 8;

/// The robot stood.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Standing {
    /// From the log's first scan to the stretch's, s.
    pub from_s: f64,
    /// Length, s.
    pub duration_s: f64,
    /// From the mean pose of the first quarter to that of the last, m.
    pub drift_m: f64,
    /// The same for the heading, deg.
    pub drift_deg: f64,
    /// Farthest pose from the mean pose, m.
    pub spread_m: f64,
}

/// The robot turned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Turn {
    /// From the log's first scan to the stretch's, s.
    pub from_s: f64,
    /// By odometry, over ten scans, deg.
    pub turned_deg: f64,
    /// The path's rotation less the odometry's, deg.
    pub error_deg: f64,
    /// Largest departure of a single scan's step from the odometry's, m.
    pub jump_m: f64,
}

/// What the hard stretches showed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StretchReport {
    /// The longest stands.
    pub standing: Vec<Standing>,
    /// The fastest turns.
    pub turns: Vec<Turn>,
    /// Departure of every scan's step from the odometry's, m.
    pub step_departure_m: Statistics,
    /// The same for the heading, deg.
    pub step_departure_deg: Statistics,
}

/// The log and the trajectory do not go together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "the log has {scans} scans with odometry and the trajectory {poses} poses: expected a pose for every scan, and odometry with each"
)]
pub struct StretchError {
    scans: usize,
    poses: usize,
}

/// Judges `poses`, one for each of `scans` in the same order, on the log's hard stretches.
///
/// # Errors
/// If the numbers differ or the log has no odometry.
pub fn evaluate_stretches(poses: &[TimedPose], scans: &[LogScan]) -> Result<StretchReport, StretchError> {
    let odometry: Vec<PoseF64> =
        scans.iter().filter_map(|scan| scan.map_from_robot_odometry).map(PoseF64::from).collect();
    if odometry.len() != poses.len() || poses.len() <= TURN_SCANS {
        return Err(StretchError { scans: odometry.len(), poses: poses.len() });
    }
    let path = Path { poses: poses.iter().map(|pose| pose.map_from_robot.into()).collect(), odometry, stamps: poses };
    let departures = path.departures();
    Ok(StretchReport {
        standing: path.standing(),
        turns: path.turns(&departures),
        step_departure_m: Statistics::of(&departures.iter().map(|d| d.distance_m()).collect::<Vec<_>>()),
        step_departure_deg: Statistics::of(
            &departures.iter().map(|d| d.heading.abs().to_degrees()).collect::<Vec<_>>(),
        ),
    })
}

struct Path<'a> {
    poses: Vec<PoseF64>,
    odometry: Vec<PoseF64>,
    stamps: &'a [TimedPose],
}

impl Path<'_> {
    fn since_start_s(&self, index: usize) -> f64 {
        self.stamps[index].stamp.since(self.stamps[0].stamp).micros as f64 * 1e-6
    }

    /// For each step from one scan to the next: the path's seen from the odometry's.
    fn departures(&self) -> Vec<PoseF64> {
        let steps = |path: &[PoseF64]| path.windows(2).map(|w| w[0].between(w[1])).collect::<Vec<_>>();
        steps(&self.odometry).into_iter().zip(steps(&self.poses)).map(|(told, found)| told.between(found)).collect()
    }

    fn standing(&self) -> Vec<Standing> {
        let mut found = Vec::new();
        let mut first = 0;
        for index in 1..=self.odometry.len() {
            let stays = self.odometry.get(index).is_some_and(|pose| {
                let moved = self.odometry[first].between(*pose);
                moved.distance_m() <= STANDING_M && moved.heading.abs() <= STANDING_RAD
            });
            if !stays {
                found.extend(self.stand(first, index));
                first = index;
            }
        }
        found.sort_by(|a, b| b.duration_s.total_cmp(&a.duration_s));
        found.truncate(LISTED);
        found
    }

    /// The scans from `first` to before `end` as a stand, if it is long enough.
    fn stand(&self, first: usize, end: usize) -> Option<Standing> {
        let duration_s = self.since_start_s(end - 1) - self.since_start_s(first);
        let poses = &self.poses[first..end];
        let quarter = poses.len() / 4;
        if duration_s < STANDING_MIN_S || quarter == 0 {
            return None;
        }
        let drift = mean(&poses[..quarter]).between(mean(&poses[poses.len() - quarter..]));
        let centre = mean(poses);
        let spread_m = poses.iter().map(|pose| centre.between(*pose).distance_m()).fold(0.0, f64::max);
        Some(Standing {
            from_s: self.since_start_s(first),
            duration_s,
            drift_m: drift.distance_m(),
            drift_deg: drift.heading.abs().to_degrees(),
            spread_m,
        })
    }

    fn turns(&self, departures: &[PoseF64]) -> Vec<Turn> {
        let steps: Vec<f64> = self.odometry.windows(2).map(|w| w[0].between(w[1]).heading).collect();
        let rotation = |first: usize| steps[first..first + TURN_SCANS].iter().sum::<f64>();
        let mut starts: Vec<usize> = (0..steps.len() - TURN_SCANS + 1).collect();
        starts.sort_by(|a, b| rotation(*b).abs().total_cmp(&rotation(*a).abs()));
        let mut chosen: Vec<usize> = Vec::new();
        for start in starts {
            if chosen.len() < LISTED && chosen.iter().all(|other| start.abs_diff(*other) >= TURN_SCANS) {
                chosen.push(start);
            }
        }
        let turn = |start: usize| {
            let part = &departures[start..start + TURN_SCANS];
            Turn {
                from_s: self.since_start_s(start),
                turned_deg: rotation(start).to_degrees(),
                error_deg: part.iter().map(|d| d.heading).sum::<f64>().to_degrees(),
                jump_m: part.iter().map(|d| d.distance_m()).fold(0.0, f64::max),
            }
        };
        chosen.into_iter().map(turn).collect()
    }
}

/// Mean position and heading (of headings near to each other).
fn mean(poses: &[PoseF64]) -> PoseF64 {
    let first = poses[0];
    let n = poses.len() as f64;
    let sum = poses
        .iter()
        .map(|pose| first.between(*pose))
        .fold((0.0, 0.0, 0.0), |sum, step| (sum.0 + step.x, sum.1 + step.y, sum.2 + step.heading));
    first.then(PoseF64::new(sum.0 / n, sum.1 / n, sum.2 / n))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::geometry::Pose2;
    use lrfslam_core::time::Instant;

    /// Thirty seconds of standing, then a turn of 5° a scan, ten scans a second.
    fn log() -> Vec<LogScan> {
        let scan = |i: i64| LogScan {
            stamp: Instant::from_micros(i * 100_000),
            range_max_m: 8.0,
            beams: Vec::new(),
            map_from_robot_odometry: Some(Pose2::new(0.0, 0.0, 0.087 * (i - 300).max(0) as f32)),
            robot_from_lrf: None,
            line: 1,
        };
        (0..330).map(scan).collect()
    }

    fn path(change: impl Fn(usize, Pose2) -> Pose2) -> Vec<TimedPose> {
        let pose = |(i, scan): (usize, &LogScan)| {
            let truth = scan.map_from_robot_odometry.unwrap_or_default();
            TimedPose { stamp: scan.stamp, map_from_robot: change(i, truth) }
        };
        log().iter().enumerate().map(pose).collect()
    }

    #[test]
    fn a_true_path_shows_neither_drift_nor_jumps() {
        let report = evaluate_stretches(&path(|_, pose| pose), &log()).unwrap();
        assert_eq!(report.standing.len(), 1);
        assert!(report.standing[0].duration_s > 29.0 && report.standing[0].drift_m < 1e-9);
        assert!((report.turns[0].turned_deg - 49.85).abs() < 0.1, "{:?}", report.turns[0]);
        assert!(report.turns[0].jump_m < 1e-6 && report.turns[0].error_deg.abs() < 1e-3);
    }

    #[test]
    fn drift_and_jumps_are_found_and_measured() {
        let drifting = path(|i, pose| Pose2::new(0.001 * i as f32, 0.0, pose.heading));
        let stand = evaluate_stretches(&drifting, &log()).unwrap().standing[0];
        assert!((stand.drift_m - 0.225).abs() < 0.01, "{stand:?}");
        let jumping = path(|i, pose| Pose2::new(if i > 315 { 0.4 } else { 0.0 }, 0.0, pose.heading));
        let report = evaluate_stretches(&jumping, &log()).unwrap();
        let worst = report.turns.iter().map(|turn| turn.jump_m).fold(0.0, f64::max);
        assert!((worst - 0.4).abs() < 1e-3, "{worst}");
    }

    #[test]
    fn a_trajectory_of_another_log_is_refused() {
        assert_eq!(evaluate_stretches(&[], &log()).unwrap_err(), StretchError { scans: 330, poses: 0 });
    }
}
