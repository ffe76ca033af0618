//! The few lines at the end of a run.

use std::fmt::Write as _;
use std::path::Path;

use lrfslam_host::mapping::MatchCounts;
use lrfslam_host::results::quality::{Quality, Stretch};
use lrfslam_host::results::report::{LaserCounts, RobotCounts, RunReport, Source};
use lrfslam_host::scans::log::LogCounts;

/// What was done, how fast, and what was odd.
pub(super) fn summary(report: &RunReport, out: &Path) -> String {
    let mut text = String::new();
    let cost = &report.cost;
    let _ = write!(text, "{} scans in {:.1} s, {:.0} scans/s", cost.scans, cost.wall_s, cost.scans_per_s);
    if cost.driven_s > 0.0 && !has_made_up_times(report) {
        let _ = write!(text, ", {:.0} × real time", cost.driven_s / cost.wall_s.max(1e-6));
    }
    if let Some(bytes) = cost.peak_memory_bytes {
        let _ = write!(text, ", {:.0} MB at most", bytes as f64 / 1e6);
    }
    text.push('\n');
    push_quality(&mut text, &report.quality);
    let source = match &report.source {
        Source::Log { log, .. } => log_notes(log),
        Source::Laser { laser, recording, .. } => {
            let ended = recording.as_ref().and_then(|recording| recording.fault.as_ref());
            let note = ended.map(|why| (true, format!("the recording ends before the run: {why}")));
            laser_notes(laser).into_iter().chain(note).collect()
        }
        Source::Robot { robot, .. } => robot_notes(robot),
    };
    for (_, note) in source.into_iter().chain(map_notes(report)).filter(|(applies, _)| *applies) {
        let _ = writeln!(text, "note: {note}");
    }
    let state = if report.partial { "partial results" } else { "results" };
    let _ = writeln!(text, "{state} in {}", out.display());
    text
}

/// What is said of results that are not whole.
pub(super) fn partial_notice(report: &RunReport, out: &Path) -> String {
    format!("stopped after {} scans; partial results are in {}", report.cost.scans, out.display())
}

/// Path, map, loops, and how far to trust them.
fn push_quality(text: &mut String, quality: &Quality) {
    let _ = write!(text, "path {:.1} m", quality.path_m);
    if let Some([width, height]) = quality.map_size_m {
        let _ = write!(text, ", map {width:.1} m by {height:.1} m");
    }
    if let Some(loops) = quality.loops_closed {
        let _ = write!(text, ", {loops} loops closed");
    }
    let _ = writeln!(text, ", {:.1} % of the scans matched well", 100.0 * quality.matched_well);
    for (what, stretches) in [("lost", &quality.lost), ("an axis undetermined", &quality.undetermined)] {
        let long: Vec<&Stretch> = stretches.iter().filter(|stretch| stretch.scans >= SCANS_SHOWN).collect();
        if long.is_empty() {
            continue;
        }
        let time = |stretch: &Stretch| format!("{:.0} to {:.0} s", stretch.from_s, stretch.to_s);
        let longest: Vec<String> = long.iter().take(STRETCHES_SHOWN).map(|stretch| time(stretch)).collect();
        let more = long.len().saturating_sub(STRETCHES_SHOWN);
        let more = if more > 0 { format!(" and {more} shorter ones (run.json)") } else { String::new() };
        let _ = writeln!(text, "{what} at {}{more}", longest.join(", "));
    }
    let _ = writeln!(text, "{}", quality.trust);
}

/// Stretches that are named, longest first.
const STRETCHES_SHOWN: usize = 3;
/// Shorter ones are in run.json alone.
const SCANS_SHOWN: usize = 5;

fn has_made_up_times(report: &RunReport) -> bool {
    matches!(&report.source, Source::Log { log, .. } if log.synthetic_times)
}

/// A note and whether it applies.
type Note = (bool, String);

fn map_notes(report: &RunReport) -> Vec<Note> {
    let MatchCounts { lost_scans, undetermined_scans, dropped_points, forgotten_tiles, .. } = report.matching;
    vec![
        (report.beams.hits == 0, "no beam hit anything: there is no map".to_owned()),
        (lost_scans > 0, format!("{lost_scans} scans agreed too little with the map to be believed")),
        (
            undetermined_scans > 0,
            format!("{undetermined_scans} scans left an axis undetermined (featureless corridor?)"),
        ),
        (
            dropped_points + forgotten_tiles > 0,
            format!(
                "memory.ndt_tiles is too small: {forgotten_tiles} tiles forgotten, {dropped_points} points found no room"
            ),
        ),
    ]
}

/// What was odd about a log, a line each.
pub(super) fn log_lines(log: &LogCounts) -> String {
    let notes = log_notes(log).into_iter().filter(|(applies, _)| *applies);
    notes.map(|(_, note)| format!("note: {note}\n")).collect()
}

fn log_notes(log: &LogCounts) -> Vec<Note> {
    let (backward, skipped, contradictions) = (log.backward_times, log.skipped_lines, log.mounting_contradictions);
    let (damage, repeated) = (log.damage_note(), log.repeated_times);
    vec![
        (damage.is_some(), damage.unwrap_or_default()),
        (log.synthetic_times, "the log has no times; scans are stamped at a fixed rate".to_owned()),
        (backward > 0, format!("{backward} scans are older than the one before (kept in file order)")),
        (
            repeated > 0,
            format!("{repeated} scans have the time of an earlier one (trajectory.tum has the last one's pose)"),
        ),
        (skipped > 0, format!("{skipped} lines of other kinds skipped")),
        (contradictions > 0, format!("{contradictions} scans contradict the laser's mounting on the robot")),
        (log.cut_last_line, "the last line of the log is cut short and was ignored".to_owned()),
    ]
}

fn laser_notes(laser: &LaserCounts) -> Vec<Note> {
    let LaserCounts { damaged, restarts, overrun, too_fast } = *laser;
    vec![
        (damaged > 0, format!("{damaged} scans or replies were refused as damaged")),
        (restarts > 0, format!("the laser was started anew {restarts} times")),
        (overrun > 0, format!("{overrun} scans were dropped: the computer is too slow for this laser")),
        (too_fast > 0, format!("during {too_fast} scans the robot moved faster than the laser's rate allows")),
    ]
}

fn robot_notes(robot: &RobotCounts) -> Vec<Note> {
    let RobotCounts { missing_scans, untold_sweeps, refused_scans, dropped_particles, tiles_forgotten, .. } = *robot;
    vec![
        (!robot.is_from_start, "the path begins where this host came, not where the robot began".to_owned()),
        (!robot.is_map_complete, "the robot has not told all of its map: robot-map.pgm is what came".to_owned()),
        (missing_scans > 0, format!("{missing_scans} scans were lost while the link was away for too long")),
        (untold_sweeps > 0, format!("{untold_sweeps} scans came without their beams: the link is too slow")),
        (
            tiles_forgotten > 0,
            format!("{tiles_forgotten} tiles of the robot's map are lost: its memory was full while no host was there"),
        ),
        (refused_scans > 0, format!("{refused_scans} scans have more beams than the robot has memory for (--cluster)")),
        (dropped_particles > 0, format!("{dropped_particles} particles went because the robot's memory was full")),
        (robot.restarts > 0, format!("the robot started its laser anew {} times", robot.restarts)),
        (robot.damaged > 0, format!("{} scans or replies of the laser were refused as damaged", robot.damaged)),
    ]
}
