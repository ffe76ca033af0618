//! The few lines at the end of a run.

use std::fmt::Write as _;
use std::path::Path;

use crate::config::RunReport;
use lrfslam_host::mapping::MatchCounts;
use lrfslam_host::output::Hole;
use lrfslam_host::plural::count;
use lrfslam_host::results::quality::{Quality, Stretch};
use lrfslam_host::results::report::{LaserCounts, RobotCounts, Source};
use lrfslam_host::scans::log::LogCounts;

/// What was done, how fast, and what was odd.
pub(super) fn summary(report: &RunReport, out: &Path) -> String {
    let mut text = String::new();
    let cost = &report.cost;
    let scans = count(cost.scans, "scan");
    if let Source::Robot { .. } = report.source {
        // The robot did the work: how long this host took for its part says nothing about it.
        let _ = write!(text, "{scans} over {:.0} s", cost.driven_s);
    } else {
        let _ = write!(text, "{scans} in {:.1} s, {:.0} scans/s", cost.wall_s, cost.scans_per_s);
        if cost.driven_s > 0.0 && !has_made_up_times(report) {
            let _ = write!(text, ", {:.0} × real time", cost.driven_s / cost.wall_s.max(1e-6));
        }
    }
    if let Some(bytes) = cost.peak_memory_bytes {
        let _ = write!(text, ", {:.0} MB at most", bytes as f64 / 1e6);
    }
    text.push('\n');
    push_quality(&mut text, &report.quality);
    text.push_str(&lines(source_notes(&report.source).into_iter().chain(map_notes(report))));
    // What ended it early is told by who ends it.
    report.fault.iter().filter(|_| !report.partial).for_each(|fault| text.push_str(&lines([(true, fault.clone())])));
    let state = if report.partial { "partial results" } else { "results" };
    let _ = writeln!(text, "{state} in {}", out.display());
    text
}

/// What is said of results that are not whole.
pub(super) fn partial_notice(report: &RunReport, out: &Path) -> String {
    format!("stopped after {}; partial results are in {}", count(report.cost.scans, "scan"), out.display())
}

/// Path, map, loops, and how far to trust them.
fn push_quality(text: &mut String, quality: &Quality) {
    let _ = write!(text, "path {:.1} m", quality.path_m);
    if let Some([width, height]) = quality.map_size_m {
        let _ = write!(text, ", map {width:.1} m by {height:.1} m");
    }
    if let Some(loops) = quality.loops_closed {
        let _ = write!(text, ", {} closed", count(loops, "loop"));
    }
    let _ = writeln!(text, ", {:.1} % of the scans matched well", 100.0 * quality.matched_well);
    for (what, stretches) in [("lost", &quality.lost), ("an axis undetermined", &quality.undetermined)] {
        let long: Vec<&Stretch> = stretches.iter().filter(|stretch| stretch.scans >= SCANS_SHOWN).collect();
        if long.is_empty() {
            continue;
        }
        let longest: Vec<String> = long.iter().take(STRETCHES_SHOWN).map(|stretch| stretch.in_words()).collect();
        let more = long.len().saturating_sub(STRETCHES_SHOWN);
        let more =
            if more > 0 { format!(" and {} (run.json)", count(more as u64, "shorter one")) } else { String::new() };
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
    let MatchCounts {
        lost_scans, blind_scans, frozen_scans, undetermined_scans, dropped_points, forgotten_tiles, ..
    } = report.matching;
    let (tiles, points) = (count(forgotten_tiles, "tile"), count(dropped_points, "point"));
    let (dropped, left_out) =
        report.particles.as_ref().map_or((0, 0), |particles| (particles.dropped, particles.squares_left_out));
    vec![
        (report.beams.hits == 0, "no beam hit anything: there is no map".to_owned()),
        (lost_scans > 0, format!("{} agreed too little with the map to be believed", count(lost_scans, "scan"))),
        (
            blind_scans > 0,
            format!("{} showed nothing: the laser was covered, or nothing is in reach", count(blind_scans, "scan")),
        ),
        (
            frozen_scans > 0,
            format!("{} repeat the ones before to the bit: is the laser frozen?", count(frozen_scans, "scan")),
        ),
        (
            undetermined_scans > 0,
            format!("{} left an axis undetermined (featureless corridor?)", count(undetermined_scans, "scan")),
        ),
        (
            dropped_points + forgotten_tiles > 0,
            format!("memory.ndt_tiles is too small: {tiles} forgotten, {points} found no room"),
        ),
        (
            dropped + left_out > 0,
            format!(
                "memory.map_tiles is too small: {} went, {} left out",
                count(dropped, "particle"),
                count(left_out, "square")
            ),
        ),
    ]
}

/// What was odd about the scans, a line each.
pub(super) fn source_lines(source: &Source) -> String {
    lines(source_notes(source))
}

fn lines(notes: impl IntoIterator<Item = Note>) -> String {
    let notes = notes.into_iter().filter(|(applies, _)| *applies);
    notes.map(|(_, note)| format!("note: {note}\n")).collect()
}

fn source_notes(source: &Source) -> Vec<Note> {
    match source {
        Source::Log { log, .. } => log_notes(log),
        Source::Laser { laser, recording, .. } => {
            let ended = recording.as_ref().and_then(|recording| recording.fault.as_ref());
            let note = ended.map(|why| (true, format!("the recording ends before the run: {why}")));
            let holes = recording.iter().flat_map(|recording| hole_note("the recording", &recording.holes));
            laser_notes(laser).into_iter().chain(note).chain(holes).collect()
        }
        Source::Robot { robot, .. } => robot_notes(robot),
    }
}

/// When the disk had no room for what is written besides the results.
fn hole_note(what: &str, holes: &[Hole]) -> Option<Note> {
    let (first, more) = holes.split_first()?;
    let more = if more.is_empty() { String::new() } else { format!(" and {} more (run.json)", more.len()) };
    Some((true, format!("{what} lacks what came when the disk had no room: {first}{more}; the map has it")))
}

fn log_notes(log: &LogCounts) -> Vec<Note> {
    let (backward, skipped, contradictions) = (log.backward_times, log.skipped_lines, log.mounting_contradictions);
    let (damage, repeated) = (log.damage_note(), log.repeated_times);
    let scans = |number| count(number, "scan");
    vec![
        (damage.is_some(), damage.unwrap_or_default()),
        (log.synthetic_times, "the log has no times; scans are stamped at a fixed rate".to_owned()),
        (backward > 0, format!("{} older than the one before (kept in file order)", scans(backward))),
        (
            repeated > 0,
            format!("{} with the time of an earlier one (trajectory.tum has the last one's pose)", scans(repeated)),
        ),
        (skipped > 0, format!("{} of other kinds skipped", count(skipped, "line"))),
        (contradictions > 0, format!("{} at odds with the laser's mounting on the robot", scans(contradictions))),
        (log.cut_last_line, "the last line of the log is cut short and was ignored".to_owned()),
    ]
}

fn laser_notes(laser: &LaserCounts) -> Vec<Note> {
    let LaserCounts { damaged, restarts, incomplete, overrun, too_fast } = *laser;
    let scans = |number: u32| count(number.into(), "scan");
    vec![
        (damaged > 0, format!("{damaged} of the laser's scans and replies refused as damaged")),
        (restarts > 0, format!("the laser was started anew {}", count(restarts.into(), "time"))),
        (incomplete > 0, format!("{} of the laser with beams missing", count(incomplete.into(), "turn"))),
        (overrun > 0, format!("{} dropped: the computer is too slow for this laser", scans(overrun))),
        (too_fast > 0, format!("during {} the robot moved faster than the laser's rate allows", scans(too_fast))),
    ]
}

fn robot_notes(robot: &RobotCounts) -> Vec<Note> {
    let RobotCounts { missing_scans, untold_sweeps, refused_scans, dropped_particles, tiles_forgotten, .. } = *robot;
    let scans = |number: u32| count(number.into(), "scan");
    let (tiles, particles) = (count(tiles_forgotten.into(), "tile"), count(dropped_particles.into(), "particle"));
    vec![
        (!robot.is_from_start, "the path begins where this host came, not where the robot began".to_owned()),
        (!robot.is_map_complete, "the robot has not told all of its map: robot-map.pgm is what came".to_owned()),
        (missing_scans > 0, format!("{} lost while the link was away for too long", scans(missing_scans))),
        (untold_sweeps > 0, format!("{} came without their beams: the link is too slow", scans(untold_sweeps))),
        (robot.late_scans > 0, format!("{} left out: the robot is too slow for its laser", scans(robot.late_scans))),
        (tiles_forgotten > 0, format!("{tiles} of the robot's map lost: its memory was full while no host was there")),
        (
            refused_scans > 0,
            format!("{} with more beams than the robot has memory for (--cluster)", scans(refused_scans)),
        ),
        (dropped_particles > 0, format!("{particles} went because the robot's memory was full")),
        (
            robot.squares_left_out > 0,
            format!(
                "the robot's memory was full: {} of its map left out",
                count(robot.squares_left_out.into(), "square")
            ),
        ),
        (robot.restarts > 0, format!("the robot started its laser anew {}", count(robot.restarts.into(), "time"))),
        (robot.damaged > 0, format!("{} of the laser's scans and replies refused as damaged", robot.damaged)),
        (
            robot.journal_missing > 0,
            format!("{} missing in the journal that was gone on with", count(robot.journal_missing.into(), "message")),
        ),
    ]
    .into_iter()
    .chain(hole_note("the journal", &robot.journal_holes))
    .collect()
}
