//! The few lines at the end of a run.

use std::fmt::Write as _;
use std::path::Path;

use crate::run_report::RunReport;

/// What was done, how fast, and what was odd about the log.
pub(super) fn summary(report: &RunReport, out: &Path) -> String {
    let mut text = String::new();
    let cost = &report.cost;
    let _ = write!(text, "{} scans in {:.1} s, {:.0} scans/s", report.log.scans, cost.wall_s, cost.scans_per_s);
    if cost.log_s > 0.0 {
        let _ = write!(text, ", {:.0} × real time", cost.log_s / cost.wall_s.max(1e-6));
    }
    if let Some(bytes) = cost.peak_memory_bytes {
        let _ = write!(text, ", {:.0} MB at most", bytes as f64 / 1e6);
    }
    text.push('\n');
    notes(report).into_iter().for_each(|note| {
        let _ = writeln!(text, "note: {note}");
    });
    let state = if report.partial { "partial results" } else { "results" };
    let _ = writeln!(text, "{state} in {}", out.display());
    text
}

fn notes(report: &RunReport) -> Vec<String> {
    let log = &report.log;
    let all = [
        (report.beams.hits == 0, "no beam hit anything: there is no map".to_owned()),
        (log.synthetic_times, "the log has no times; scans are stamped at a fixed rate".to_owned()),
        (
            log.backward_times > 0,
            format!("{} scans are older than the one before (kept in file order)", log.backward_times),
        ),
        (log.skipped_lines > 0, format!("{} lines of other kinds skipped", log.skipped_lines)),
        (
            log.mounting_contradictions > 0,
            format!("{} scans contradict the laser's mounting on the robot", log.mounting_contradictions),
        ),
        (
            report.matching.lost_scans > 0,
            format!("{} scans agreed too little with the map to be believed", report.matching.lost_scans),
        ),
        (
            report.matching.undetermined_scans > 0,
            format!("{} scans left an axis undetermined (featureless corridor?)", report.matching.undetermined_scans),
        ),
        (
            report.matching.dropped_points > 0,
            format!("memory.ndt_tiles is too small: {} points found no room", report.matching.dropped_points),
        ),
        (log.cut_last_line, "the last line of the log is cut short and was ignored".to_owned()),
    ];
    all.into_iter().filter(|(applies, _)| *applies).map(|(_, note)| note).collect()
}
