//! Does it keep working? A long log mapped once: what a scan costs and what is kept, stretch after stretch of time.
//!
//! Times are processor times of one thread, so that it does not count what else the machine does. Everything that a scan sets off is in
//! them: matching, particles, closures, drawing anew. Of the path only poses that the run believes are judged.

use std::fmt::Write as _;
use std::path::Path;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::time::{Duration, Instant};
use plotters::prelude::*;
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;

use super::plots::PlotError;
use crate::evaluation::alignment;
use lrfslam_host::mapping::MappingConfig;
use lrfslam_host::output::Aside;
use lrfslam_host::pose_f64::PoseF64;
use lrfslam_host::results::report::resident_memory_bytes;
use lrfslam_host::runs::map::{About, MapRun, RunMemory};
use lrfslam_host::scans::log::LogScan;
use lrfslam_host::trajectory::TimedPose;

/// True and estimated poses belong together if they are no farther apart.
const TOLERANCE: Duration = Duration::from_millis(20);

/// Files with a line for each scan or step.
const PATH_FILES: [&str; 2] = ["trajectory.tum", "steps.csv"];

/// A panel of the figure: its title and its value.
type Panel = (&'static str, fn(&Stretch) -> f64);

/// One stretch of the time.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Stretch {
    /// Since the first scan, at its end, s.
    pub until_s: f64,
    /// Scans in it.
    pub scans: usize,
    /// Processor time of a scan, ms: half of them take less.
    pub p50_ms: f64,
    /// 999 of 1000 take less.
    pub p999_ms: f64,
    /// The longest.
    pub longest_ms: f64,
    /// Memory of the process at its end, bytes; 0 where the system does not tell.
    pub memory_bytes: u64,
    /// Trajectory and steps as they are written at its end, which have a line for each, bytes; …
    pub path_bytes: u64,
    /// … and all other results, bytes.
    pub map_bytes: u64,
    /// Scans kept at its end.
    pub scans_kept: u64,
    /// Closures at its end.
    pub closures: u64,
    /// Root mean square error of the positions in it, m, all of the path being aligned at once.
    pub rmse_m: f64,
    /// The largest error in it, m.
    pub worst_m: f64,
    /// Poses judged: those believed.
    pub judged: usize,
}

/// How a long log is mapped.
#[derive(Debug)]
pub struct LongDrive<'a, C> {
    /// How scans are mapped.
    pub config: &'a MappingConfig,
    /// Where the laser sits on the robot, if a scan does not say.
    pub robot_from_lrf: Pose2,
    /// Of the random numbers.
    pub seed: u64,
    /// Length of a stretch.
    pub every: Duration,
    /// After each stretch the results are written as a run's are, for their sizes; what is not known to it comes from here.
    pub about: About<C>,
}

/// Maps `scans` once and judges the path by `truth`, stretch after stretch.
///
/// # Errors
/// If a scan cannot be read or is too large, a file cannot be written, or no pose has a partner in `truth`.
pub fn run_endurance<C: Serialize + Clone>(
    drive: &LongDrive<'_, C>,
    scans: impl Iterator<Item = anyhow::Result<LogScan>>,
    truth: &[TimedPose],
    mut say: impl FnMut(&Stretch),
) -> anyhow::Result<Vec<Stretch>> {
    let (every, results) = (drive.every, tempfile::tempdir()?);
    let mut memory = RunMemory::new(drive.config, 1);
    let mut run = MapRun::new(drive.config, drive.seed, &mut memory)?;
    run.put_aside(Aside::in_folder(results.path()));
    let (mut stretches, mut times_ms): (Vec<Stretch>, _) = (Vec::new(), Vec::new());
    let mut close = |stretches: &mut Vec<Stretch>, times_ms: &mut Vec<f64>, run: &mut MapRun<'_>, until| {
        let stretch = stretch(times_ms, run, until, (results.path(), &drive.about))?;
        say(&stretch);
        stretches.push(stretch);
        times_ms.clear();
        anyhow::Ok(())
    };
    let mut first: Option<Instant> = None;
    let mut last = Instant::default();
    for scan in scans {
        let scan = scan?;
        let began = *first.get_or_insert(scan.stamp);
        if scan.stamp.since(began).micros >= every.micros * (stretches.len() as i64 + 1) {
            close(&mut stretches, &mut times_ms, &mut run, last.since(began))?;
        }
        last = scan.stamp;
        let before_ms = thread_ms();
        run.add_scan(&scan.scan(), scan.robot_from_lrf.unwrap_or(drive.robot_from_lrf), None)?;
        times_ms.push(thread_ms() - before_ms);
    }
    let began = first.unwrap_or_default();
    close(&mut stretches, &mut times_ms, &mut run, last.since(began))?;
    run.finish();
    judge(&mut stretches, &run.trusted_trajectory(), truth, (began, every))?;
    Ok(stretches)
}

/// Processor time of this thread so far, ms.
fn thread_ms() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    1e3 * time.tv_sec as f64 + 1e-6 * time.tv_nsec as f64
}

/// What the last stretch cost.
fn stretch<C: Serialize + Clone>(
    times_ms: &mut [f64],
    run: &mut MapRun<'_>,
    until: Duration,
    (folder, about): (&Path, &About<C>),
) -> anyhow::Result<Stretch> {
    times_ms.sort_by(f64::total_cmp);
    let share = |share: f64| times_ms.get((share * times_ms.len() as f64) as usize).copied().unwrap_or_default();
    let counts = run.high_counts().unwrap_or_default();
    let memory_bytes = resident_memory_bytes().unwrap_or_default();
    run.write_into(folder, about)?;
    let (mut path_bytes, mut map_bytes) = (0, 0);
    for file in folder.read_dir()? {
        let (file, bytes) = file.and_then(|file| Ok((file.file_name(), file.metadata()?.len())))?;
        let is_path = PATH_FILES.iter().any(|name| file == *name);
        *(if is_path { &mut path_bytes } else { &mut map_bytes }) += bytes;
    }
    Ok(Stretch {
        until_s: f64::from(until.as_secs_f32()),
        scans: times_ms.len(),
        p50_ms: share(0.5),
        p999_ms: share(0.999),
        longest_ms: times_ms.last().copied().unwrap_or_default(),
        memory_bytes,
        path_bytes,
        map_bytes,
        scans_kept: counts.scans_kept,
        closures: counts.closures,
        ..Stretch::default()
    })
}

/// Adds the errors, all of the path being aligned at once.
fn judge(
    stretches: &mut [Stretch],
    poses: &[TimedPose],
    truth: &[TimedPose],
    (began, every): (Instant, Duration),
) -> anyhow::Result<()> {
    let truth_from_estimate = alignment(poses, truth, TOLERANCE)?;
    let mut at = 0;
    for pose in poses {
        // Both are in the order of time.
        while truth.get(at + 1).is_some_and(|next| next.stamp.micros <= pose.stamp.micros + TOLERANCE.micros) {
            at += 1;
        }
        let Some(partner) = truth.get(at).filter(|t| pose.stamp.since(t.stamp).micros.abs() <= TOLERANCE.micros) else {
            continue;
        };
        let estimate = truth_from_estimate.then(PoseF64::from(pose.map_from_robot));
        let truth = PoseF64::from(partner.map_from_robot);
        let error = (estimate.x - truth.x).hypot(estimate.y - truth.y);
        let index = (pose.stamp.since(began).micros / every.micros.max(1)) as usize;
        let last = stretches.len().saturating_sub(1);
        if let Some(stretch) = stretches.get_mut(index.min(last)) {
            stretch.rmse_m += error * error;
            stretch.worst_m = stretch.worst_m.max(error);
            stretch.judged += 1;
        }
    }
    for stretch in stretches {
        stretch.rmse_m = (stretch.rmse_m / stretch.judged.max(1) as f64).sqrt();
    }
    Ok(())
}

/// A line for each stretch.
pub fn endurance_csv(stretches: &[Stretch]) -> String {
    let mut text = String::from(
        "until_s,scans,p50_ms,p999_ms,longest_ms,memory_bytes,path_bytes,map_bytes,scans_kept,closures,rmse_m,worst_m,judged\n",
    );
    for stretch in stretches {
        let Stretch { until_s, scans, p50_ms, p999_ms, longest_ms, .. } = stretch;
        let Stretch { memory_bytes, path_bytes, map_bytes, scans_kept, closures, rmse_m, worst_m, judged, .. } =
            stretch;
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{until_s:.1},{scans},{p50_ms:.3},{p999_ms:.3},{longest_ms:.3},{memory_bytes},{path_bytes},{map_bytes},{scans_kept},{closures},\
             {rmse_m:.4},{worst_m:.4},{judged}"
        );
    }
    text
}

/// The same as a table in Markdown.
pub fn endurance_markdown(stretches: &[Stretch]) -> String {
    let mut text = String::from(
        "| hours | scans | median, ms | 99.9 %, ms | longest, ms | memory, MB | map files, MB | path files, MB | scans kept | closures | RMSE, m | worst, m |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for stretch in stretches {
        let _ = writeln!(
            text,
            "| {:.2} | {} | {:.1} | {:.1} | {:.0} | {:.0} | {:.1} | {:.1} | {} | {} | {:.3} | {:.2} |",
            stretch.until_s / 3600.0,
            stretch.scans,
            stretch.p50_ms,
            stretch.p999_ms,
            stretch.longest_ms,
            stretch.memory_bytes as f64 / 1e6,
            stretch.map_bytes as f64 / 1e6,
            stretch.path_bytes as f64 / 1e6,
            stretch.scans_kept,
            stretch.closures,
            stretch.rmse_m,
            stretch.worst_m
        );
    }
    text
}

/// Time, memory, files and error over the hours, as SVG.
///
/// # Errors
/// If drawing fails.
pub fn plot_endurance(stretches: &[Stretch]) -> Result<String, PlotError> {
    let panels: [Panel; 6] = [
        ("median time of a scan, ms", |s| s.p50_ms),
        ("99.9 % of the scans take less, ms", |s| s.p999_ms),
        ("memory, MB", |s| s.memory_bytes as f64 / 1e6),
        ("files of the map, MB", |s| s.map_bytes as f64 / 1e6),
        ("files of the path, MB", |s| s.path_bytes as f64 / 1e6),
        ("RMSE of the positions, m", |s| s.rmse_m),
    ];
    let hours = stretches.last().map_or(1.0, |stretch| stretch.until_s / 3600.0).max(1e-3);
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (760, 690)).into_drawing_area();
        root.fill(&WHITE)?;
        for (area, (name, of)) in root.split_evenly((3, 2)).iter().zip(panels) {
            let top = 1.15 * stretches.iter().map(of).fold(1e-3, f64::max);
            let mut chart = ChartBuilder::on(area)
                .margin(8)
                .caption(name, ("sans-serif", 14))
                .x_label_area_size(30)
                .y_label_area_size(44)
                .build_cartesian_2d(0.0..hours, 0.0..top)?;
            chart.configure_mesh().disable_mesh().x_desc("hours").draw()?;
            let points = stretches.iter().map(|stretch| (stretch.until_s / 3600.0, of(stretch)));
            chart.draw_series(LineSeries::new(points, super::plots::OURS))?;
        }
        root.present()?;
    }
    Ok(svg)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(seconds: i64, x: f32) -> TimedPose {
        let stamp = Instant::from_micros(1_000_000 * seconds);
        TimedPose { stamp, map_from_robot: Pose2::new(x, (seconds % 7) as f32, 0.0) }
    }

    #[test]
    fn errors_are_those_of_their_stretch() {
        let truth: Vec<TimedPose> = (0..100).map(|s| pose(s, s as f32)).collect();
        let mut poses = truth.clone();
        poses.get_mut(75).unwrap().map_from_robot.x += 0.5;
        let mut stretches = vec![Stretch::default(); 10];
        judge(&mut stretches, &poses, &truth, (Instant::default(), Duration::from_millis(10_000))).unwrap();
        assert!((stretches[7].worst_m - 0.495).abs() < 0.01, "{stretches:?}");
        assert!(stretches[7].rmse_m > 0.1 && stretches[3].rmse_m < 0.02 && stretches.iter().all(|s| s.judged == 10));
        assert_eq!(endurance_csv(&stretches).lines().count(), 11);
        assert!(plot_endurance(&stretches).unwrap().contains("memory, MB"));
        assert!(endurance_markdown(&stretches).contains("| 0.00 |"));
    }
}
