//! What becomes of a robot that is told where it starts in a map, rightly and wrongly? A log cut into starts, each told.

use std::fmt::Write as _;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::time::Instant;

use super::starts::StartsConfig;
use lrfslam_host::localize::{KnownMap, Localizer, LocalizerConfig, LocalizerMemory, ScansAhead, StartJudge};
use lrfslam_host::pose_f64::PoseF64;
use lrfslam_host::scans::log::LogScan;
use lrfslam_host::trajectory::TimedPose;

/// What is told, and how far off it is: metres ahead and to the left, degrees.
const TOLD: [(&str, [f32; 3]); 6] = [
    ("rightly", [0.0, 0.0, 0.0]),
    ("1.5 m ahead", [1.5, 0.0, 0.0]),
    ("3 m behind", [-3.0, 0.0, 0.0]),
    ("1 m to the left", [0.0, 1.0, 0.0]),
    ("a quarter turn off", [0.0, 0.0, 90.0]),
    ("half a turn off", [0.0, 0.0, 180.0]),
];

/// What became of all starts that were told alike.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ToldStarts {
    /// What was told.
    pub told: &'static str,
    /// Starts.
    pub starts: u32,
    /// Of these, that [fit](lrfslam_host::localize::StartFit::fits), nearer to the truth than what is wrong: a start that is told about is put right …
    pub taken_rightly: u32,
    /// … and farther.
    pub taken_wrongly: u32,
    /// Scans of localisation, whose true pose is known.
    pub scans: u32,
    /// Of these, with a pose.
    pub with_pose: u32,
    /// Of these, with a wrong one.
    pub wrong: u32,
    /// Times that the robot was lost.
    pub lost: u64,
}

/// Scans that a judge may read as often as it wants.
struct Ahead<'a>(&'a [LogScan]);

impl ScansAhead for Ahead<'_> {
    fn scan(&mut self, index: usize) -> anyhow::Result<Option<&LogScan>> {
        Ok(self.0.get(index))
    }
}

/// Starts the robot in `map` at every so many seconds of `scans`, told where it is, rightly and wrongly; `truth` has a pose for each scan, in the map's frame.
///
/// # Errors
/// If a scan is too large for the memory.
pub fn try_told_starts(
    (config, robot_from_lrf): (&LocalizerConfig, Pose2),
    starts: &StartsConfig,
    map: &KnownMap,
    scans: &[LogScan],
    truth: &[TimedPose],
) -> anyhow::Result<Vec<ToldStarts>> {
    let none = |(told, _)| ToldStarts {
        told,
        starts: 0,
        taken_rightly: 0,
        taken_wrongly: 0,
        scans: 0,
        with_pose: 0,
        wrong: 0,
        lost: 0,
    };
    let mut all = TOLD.map(none);
    let mut memory = LocalizerMemory::new(config);
    let judge = StartJudge::new(config, robot_from_lrf, starts.seed, map);
    let pose_at = |stamp: Instant| truth.iter().find(|pose| pose.stamp == stamp).map(|pose| pose.map_from_robot);
    let mut next: Option<Instant> = None;
    for (index, first) in scans.iter().enumerate() {
        let Some(true_start) = pose_at(first.stamp).filter(|_| next.is_none_or(|next| first.stamp >= next)) else {
            continue;
        };
        next = Some(Instant::from_micros(first.stamp.micros + starts.every.micros));
        let ahead = &scans[index..];
        for ((_, [x, y, turn_deg]), sum) in TOLD.iter().zip(&mut all) {
            let told = true_start * Pose2::new(*x, *y, turn_deg.to_radians());
            let fit = judge.follow(told, &mut Ahead(ahead))?;
            sum.starts += 1;
            let taken =
                if is_wrong(starts, true_start, fit.start) { &mut sum.taken_wrongly } else { &mut sum.taken_rightly };
            *taken += u32::from(fit.fits);
            let mut localizer = Localizer::new(config, starts.seed, map, Some(told), &mut memory)?;
            for scan in ahead.iter().take_while(|scan| scan.stamp.since(first.stamp) <= starts.patience) {
                let located = localizer.add_scan(&scan.scan(), scan.robot_from_lrf.unwrap_or(robot_from_lrf))?;
                let Some(true_pose) = pose_at(scan.stamp) else { continue };
                sum.scans += 1;
                sum.with_pose += u32::from(located.is_some());
                sum.wrong += u32::from(located.is_some_and(|at| is_wrong(starts, true_pose, at.map_from_robot)));
            }
            sum.lost += localizer.counts().lost;
        }
    }
    Ok(all.to_vec())
}

fn is_wrong(starts: &StartsConfig, true_pose: Pose2, pose: Pose2) -> bool {
    let error = PoseF64::from(true_pose).between(PoseF64::from(pose));
    error.distance_m() > starts.wrong_m || error.heading.abs().to_degrees() > starts.wrong_deg
}

/// A line for each way of telling, as Markdown.
pub fn told_starts_markdown(all: &[ToldStarts]) -> String {
    let mut text = String::from(
        "| told | starts | taken to go on with, rightly | wrongly | scans with a pose, % | of these wrong, % | lost |\n\
         | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for ToldStarts { told, starts, taken_rightly, taken_wrongly, scans, with_pose, wrong, lost } in all {
        let share = |part: u32, of: u32| 100.0 * f64::from(part) / f64::from(of.max(1));
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "| {told} | {starts} | {taken_rightly} | {taken_wrongly} | {:.1} | {:.1} | {lost} |",
            share(*with_pose, *scans),
            share(*wrong, *with_pose)
        );
    }
    text
}
