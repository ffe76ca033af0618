//! Does the loop close (thesis figure 3.11)? A log with its true path, mapped with each number of levels and several seeds.

use std::fmt::Write as _;
use std::path::Path;

use lrfslam_core::time::Duration;
use serde::Serialize;

use crate::config::RunConfig;
use crate::evaluation::evaluate_truth;
use crate::log::LogScan;
use crate::map_run::MapRun;
use crate::mapper::MapperMemory;
use crate::trajectory::TimedPose;

/// One mapping of the log.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LoopRun {
    /// Levels of SLAM.
    pub levels: u16,
    /// Of the random numbers.
    pub seed: u64,
    /// Absolute error of the path after rigid alignment, root of the mean square, m.
    pub rmse_m: f64,
    /// … and at worst, m.
    pub max_m: f64,
    /// Loops that were closed.
    pub closures: u64,
    /// No pose is farther off than what counts as closed.
    pub closed: bool,
}

/// Maps `scans` once with `levels` and `seed`; `folder` takes the results, `closed_m` is the largest error of a loop that counts as closed.
///
/// # Errors
/// If the folder cannot be written, a scan is too large, or no pose has a partner in `truth`.
pub fn run_loop(
    config: &RunConfig,
    (levels, seed): (u16, u64),
    scans: &[LogScan],
    truth: &[TimedPose],
    folder: &Path,
    closed_m: f64,
) -> anyhow::Result<LoopRun> {
    let mut config = *config;
    config.hierarchy.levels = levels;
    let mut memory = MapperMemory::new(&config, 1);
    let mut map = MapRun::open(folder, &config, seed, &mut memory)?;
    for scan in scans {
        map.add_scan(&scan.scan(), scan.robot_from_lrf.unwrap_or_else(|| config.robot_from_lrf()), None)?;
    }
    let error = evaluate_truth(&map.trajectory(), truth, Duration::from_millis(50), 10.0)?.absolute_m;
    let closures = map.high_counts().map_or(0, |counts| counts.closures);
    Ok(LoopRun { levels, seed, rmse_m: error.rmse, max_m: error.max, closures, closed: error.max <= closed_m })
}

/// A line for each run.
pub fn loop_csv(runs: &[LoopRun]) -> String {
    let mut text = String::from("levels,seed,rmse_m,max_m,closures,closed\n");
    for run in runs {
        let LoopRun { levels, seed, rmse_m, max_m, closures, closed } = run;
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{levels},{seed},{rmse_m:.4},{max_m:.4},{closures},{}", u8::from(*closed));
    }
    text
}

/// What came out, level by level, as a table in Markdown.
pub fn loop_markdown(runs: &[LoopRun]) -> String {
    let mut text = String::from("| levels | closed | RMSE, m: best, median, worst |\n| --- | --- | --- |\n");
    let mut levels: Vec<u16> = runs.iter().map(|run| run.levels).collect();
    levels.dedup();
    for level in levels {
        let of: Vec<&LoopRun> = runs.iter().filter(|run| run.levels == level).collect();
        let mut errors: Vec<f64> = of.iter().map(|run| run.rmse_m).collect();
        errors.sort_by(f64::total_cmp);
        let closed = of.iter().filter(|run| run.closed).count();
        let (best, median, worst) = (errors[0], errors[errors.len() / 2], errors[errors.len() - 1]);
        let _ = writeln!(text, "| {level} | {closed} of {} | {best:.3}, {median:.3}, {worst:.3} |", of.len());
    }
    text
}
