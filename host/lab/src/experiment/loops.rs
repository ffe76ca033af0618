//! Does the loop close (thesis figure 3.11)? A log with its true path, mapped with each number of levels and several seeds.

use std::fmt::Write as _;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::time::Duration;
use serde::Serialize;

use crate::evaluation::evaluate_truth;
use lrfslam_host::mapping::MappingConfig;
use lrfslam_host::runs::map::{MapRun, RunMemory};
use lrfslam_host::scans::log::LogScan;
use lrfslam_host::trajectory::TimedPose;

/// One mapping of the log.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LoopRun {
    /// Levels of SLAM.
    pub levels: u16,
    /// Of the random numbers.
    pub seed: u64,
    /// Absolute error of the path after rigid alignment, root of the mean square, m.
    pub rmse_m: f64,
    /// Largest error of a pose as seen from the robot's earlier visit to the place, m.
    pub revisit_m: f64,
    /// Loops that were closed.
    pub closures: u64,
    /// That is no larger than what counts as closed.
    pub closed: bool,
}

/// Maps `scans` once with `levels` and `seed`; `closed_m` is the largest error at a place revisited of a loop that counts as closed.
///
/// # Errors
/// If a scan is too large, no pose has a partner in `truth`, or the true path
/// never comes back to a place.
pub fn run_loop(
    (config, robot_from_lrf): (&MappingConfig, Pose2),
    (levels, seed): (u16, u64),
    scans: &[LogScan],
    truth: &[TimedPose],
    closed_m: f64,
) -> anyhow::Result<LoopRun> {
    let mut config = *config;
    config.hierarchy.levels = levels;
    let mut memory = RunMemory::new(&config, 1);
    let mut map = MapRun::new(&config, seed, &mut memory)?;
    for scan in scans {
        map.add_scan(&scan.scan(), scan.robot_from_lrf.unwrap_or(robot_from_lrf), None)?;
    }
    map.finish();
    let report = evaluate_truth(&map.trajectory(), truth, Duration::from_millis(50), 10.0)?;
    anyhow::ensure!(report.revisit_m.count > 0, "the true path never comes back to a place: there is no loop to close");
    let (rmse_m, revisit_m) = (report.absolute_m.rmse, report.revisit_m.max);
    let closures = map.high_counts().map_or(0, |counts| counts.closures);
    Ok(LoopRun { levels, seed, rmse_m, revisit_m, closures, closed: revisit_m <= closed_m })
}

/// A line for each run.
pub fn loop_csv(runs: &[LoopRun]) -> String {
    let mut text = String::from("levels,seed,rmse_m,revisit_m,closures,closed\n");
    for run in runs {
        let LoopRun { levels, seed, rmse_m, revisit_m, closures, closed } = run;
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{levels},{seed},{rmse_m:.4},{revisit_m:.4},{closures},{}", u8::from(*closed));
    }
    text
}

/// What came out, level by level, as a table in Markdown.
pub fn loop_markdown(runs: &[LoopRun]) -> String {
    let mut text = String::from(
        "| levels | closed | RMSE, m: best, median, worst | revisits, m: best, median, worst |\n| --- | --- | --- | --- |\n",
    );
    let mut levels: Vec<u16> = runs.iter().map(|run| run.levels).collect();
    levels.dedup();
    for level in levels {
        let of: Vec<&LoopRun> = runs.iter().filter(|run| run.levels == level).collect();
        let spread = |error: fn(&LoopRun) -> f64| {
            let mut errors: Vec<f64> = of.iter().map(|run| error(run)).collect();
            errors.sort_by(f64::total_cmp);
            format!("{:.3}, {:.3}, {:.3}", errors[0], errors[errors.len() / 2], errors[errors.len() - 1])
        };
        let (paths, revisits) = (spread(|run| run.rmse_m), spread(|run| run.revisit_m));
        let closed = of.iter().filter(|run| run.closed).count();
        let _ = writeln!(text, "| {level} | {closed} of {} | {paths} | {revisits} |", of.len());
    }
    text
}
