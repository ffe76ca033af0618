//! Does a robot find itself in a map, wherever it is switched on? A log cut into starts, each from nowhere.

use std::fmt::Write as _;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::time::{Duration, Instant};

use lrfslam_host::localize::{KnownMap, Localizer, LocalizerConfig, LocalizerMemory};
use lrfslam_host::pose_f64::PoseF64;
use lrfslam_host::scans::log::LogScan;
use lrfslam_host::trajectory::TimedPose;

/// How the log is cut, and what counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StartsConfig {
    /// From start to start.
    pub every: Duration,
    /// Until it is given up.
    pub patience: Duration,
    /// A pose farther than this from the truth is wrong, m …
    pub wrong_m: f64,
    /// … or this, degrees.
    pub wrong_deg: f64,
    /// Of the random numbers.
    pub seed: u64,
}

/// What became of a start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StartOutcome {
    /// Of its first scan.
    pub stamp: Instant,
    /// When and where the robot found itself, if it did.
    pub found: Option<StartFound>,
    /// Way driven by the true path until it was found or given up, m.
    pub way_m: f64,
    /// It went on so long.
    pub lasted: Duration,
}

/// Where a robot has found itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StartFound {
    /// From the first scan on.
    pub after: Duration,
    /// Distance from the truth, m.
    pub error_m: f64,
    /// … and in heading, degrees.
    pub error_deg: f64,
    /// The certainty that was stated.
    pub certainty: f32,
}

/// Starts the robot in `map` at every so many seconds of `scans`; `truth` has a pose for each scan, in the map's frame.
///
/// # Errors
/// If a scan is too large for the memory.
pub fn try_starts(
    (config, robot_from_lrf): (&LocalizerConfig, Pose2),
    starts: &StartsConfig,
    map: &KnownMap,
    scans: &[LogScan],
    truth: &[TimedPose],
) -> anyhow::Result<Vec<StartOutcome>> {
    let mut memory = LocalizerMemory::new(config);
    let mut outcomes = Vec::new();
    let mut next = None;
    for index in 0..scans.len() {
        let stamp = scans[index].stamp;
        if next.is_some_and(|next| stamp < next) {
            continue;
        }
        next = Some(Instant::from_micros(stamp.micros + starts.every.micros));
        let mut localizer = Localizer::new(config, starts.seed, map, None, &mut memory)?;
        outcomes.push(try_start(robot_from_lrf, starts, &mut localizer, &scans[index..], truth)?);
    }
    Ok(outcomes)
}

fn try_start(
    robot_from_lrf: Pose2,
    starts: &StartsConfig,
    localizer: &mut Localizer<'_>,
    scans: &[LogScan],
    truth: &[TimedPose],
) -> anyhow::Result<StartOutcome> {
    let stamp = scans[0].stamp;
    let mut outcome = StartOutcome { stamp, found: None, way_m: 0.0, lasted: Duration::ZERO };
    let mut before: Option<Pose2> = None;
    for scan in scans {
        outcome.lasted = scan.stamp.since(stamp);
        if outcome.lasted > starts.patience {
            break;
        }
        let true_pose = truth.iter().find(|pose| pose.stamp == scan.stamp).map(|pose| pose.map_from_robot);
        if let Some((before, now)) = before.zip(true_pose) {
            outcome.way_m += f64::from((now.position() - before.position()).norm());
        }
        before = true_pose.or(before);
        let robot_from_lrf = scan.robot_from_lrf.unwrap_or(robot_from_lrf);
        let located = localizer.add_scan(&scan.scan(), robot_from_lrf)?;
        if let Some((located, true_pose)) = located.zip(true_pose) {
            let error = PoseF64::from(true_pose).between(PoseF64::from(located.map_from_robot));
            outcome.found = Some(StartFound {
                after: outcome.lasted,
                error_m: error.distance_m(),
                error_deg: error.heading.abs().to_degrees(),
                certainty: located.certainty,
            });
            break;
        }
    }
    Ok(outcome)
}

/// A line for each start.
pub fn starts_csv(outcomes: &[StartOutcome]) -> String {
    let mut text = String::from("start_s,found_after_s,error_m,error_deg,certainty,way_m,lasted_s\n");
    for StartOutcome { stamp, found, way_m, lasted } in outcomes {
        // Writing to a string cannot fail.
        let _ = write!(text, "{:.6},", stamp.as_secs_f64());
        let _ = match found {
            None => write!(text, ",,,"),
            Some(found) => {
                let StartFound { after, error_m, error_deg, certainty } = found;
                write!(text, "{:.3},{error_m:.4},{error_deg:.3},{certainty:.3}", after.micros as f64 / 1e6)
            }
        };
        let _ = writeln!(text, ",{way_m:.2},{:.3}", lasted.micros as f64 / 1e6);
    }
    text
}

/// How many were found, rightly and wrongly, and how soon.
pub fn starts_summary(starts: &StartsConfig, outcomes: &[StartOutcome]) -> String {
    let is_wrong = |found: &StartFound| found.error_m > starts.wrong_m || found.error_deg > starts.wrong_deg;
    let found: Vec<(&StartOutcome, StartFound)> = outcomes.iter().filter_map(|o| Some((o, o.found?))).collect();
    let wrong = found.iter().filter(|(_, found)| is_wrong(found)).count();
    let within = |seconds: i64| {
        let soon = found.iter().filter(|(_, f)| !is_wrong(f) && f.after.micros <= seconds * 1_000_000);
        soon.count()
    };
    let mut text = format!(
        "{} starts: {} found rightly ({} within 30 s), {wrong} wrongly, {} not\n",
        outcomes.len(),
        found.len() - wrong,
        within(30),
        outcomes.len() - found.len()
    );
    let mut after: Vec<f64> = found.iter().map(|(_, found)| found.after.micros as f64 / 1e6).collect();
    let mut way: Vec<f64> = found.iter().map(|(outcome, _)| outcome.way_m).collect();
    after.sort_by(f64::total_cmp);
    way.sort_by(f64::total_cmp);
    let at = |sorted: &[f64], share: f64| sorted.get(((sorted.len() as f64 - 1.0) * share).round() as usize).copied();
    if let (Some(half), Some(most), Some(half_m), Some(most_m)) =
        (at(&after, 0.5), at(&after, 0.9), at(&way, 0.5), at(&way, 0.9))
    {
        let _ = writeln!(
            text,
            "found after {half:.1} s and {half_m:.1} m (median), {most:.1} s and {most_m:.1} m (90 % of them)"
        );
    }
    text
}
