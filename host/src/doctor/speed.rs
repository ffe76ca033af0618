//! Motion that is too fast for the rate of the scans.

use std::f32::consts::PI;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::sweep::SpeedLimits;
use lrfslam_core::time::Duration;

use super::finding::{Finding, Stretch, percent};
use super::follow::Step;
use crate::plural::count;

/// From scan to scan a robot may go so far, m: half of what the matcher searches ahead (thesis table 4.4) …
const STEP_M: f32 = 0.5;
/// … and turn so far, rad: three quarters of what it searches to each side.
const STEP_RAD: f32 = 15.0 * PI / 180.0;
/// A larger share of such steps is wrong.
const MANY: f64 = 0.05;
/// With a larger share of them matching cannot follow, and nothing can be said that rests on its steps.
const MOST: f64 = 0.2;
/// Fewer scans than this show nothing.
const SCANS: usize = 4;
/// Fewer than this are not worth a word.
const FEW: f64 = 0.01;
/// A larger share of scans that do not fit is unusual …
const LOST: f64 = 0.02;
/// … and a larger one wrong.
const LOST_MOST: f64 = 0.2;

/// What a sweep may be smeared by, m and rad: the configuration's `[speed]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmearLimits {
    /// m.
    pub error_m: f32,
    /// rad.
    pub error_rad: f32,
}

pub(super) fn report(steps: &[Step], smear: SmearLimits, findings: &mut Vec<Finding>) {
    steps_too_long(steps, findings);
    sweeps_smeared(steps, smear, findings);
    lost(steps, findings);
}

/// By matching, else by odometry: a scan that moved too far may not fit.
fn moved(step: &Step) -> Option<Pose2> {
    step.matched.or(step.odometry)
}

/// By either, farther than the matcher can follow safely.
fn is_long(step: &&Step) -> bool {
    let is_long = |moved: Pose2| moved.position().norm() > STEP_M || moved.heading.abs() > STEP_RAD;
    [step.matched, step.odometry].into_iter().flatten().any(is_long)
}

/// Matching can follow the robot: most scans lie near enough to one another.
pub(super) fn can_follow(steps: &[Step]) -> bool {
    steps.iter().filter(is_long).count() as f64 <= MOST * steps.len() as f64
}

/// Eq. (4.44) and (4.45) of the thesis, with what the matcher can follow as the error allowed from scan to scan.
fn steps_too_long(steps: &[Step], findings: &mut Vec<Finding>) {
    let long: Vec<&Step> = steps.iter().filter(is_long).collect();
    let share = long.len() as f64 / steps.len().max(1) as f64;
    if share < FEW || long.len() < SCANS {
        return;
    }
    let both = || long.iter().flat_map(|step| [step.matched, step.odometry]).flatten();
    let most_m = both().map(|step| step.position().norm()).fold(0.0, f32::max);
    let most_rad = both().map(|step| step.heading.abs()).fold(0.0, f32::max);
    let found = format!(
        "the robot moves more than {STEP_M} m or {:.0}° from one scan to the next: {} ({}), {most_m:.2} m and {:.0}° at most",
        STEP_RAD.to_degrees(),
        count(long.len() as u64, "scan"),
        percent(share, 1.0),
        most_rad.to_degrees()
    );
    let means =
        "the matcher looks 1 m ahead and 20° to each side: scans farther apart may be matched to the wrong place";
    let advice =
        "drive slower, above all in turns, or take more scans a second; for a log of key frames use --odometry";
    let of = if share > MANY { Finding::wrong } else { Finding::unusual };
    findings.push(of("too-fast", found, means).so(advice).at(stretches(&long)));
}

/// The same equations within one sweep, where the beams' times are known.
fn sweeps_smeared(steps: &[Step], smear: SmearLimits, findings: &mut Vec<Finding>) {
    let is_smeared = |step: &&Step| {
        let limits =
            SpeedLimits::new(Duration::from_micros((step.sweep_s * 1e6) as i64), smear.error_m, smear.error_rad);
        let seconds = Duration::from_micros((step.seconds.max(step.sweep_s) * 1e6) as i64);
        step.sweep_s > 0.0 && moved(step).is_some_and(|moved| limits.are_exceeded_by(moved, seconds))
    };
    let smeared: Vec<&Step> = steps.iter().filter(is_smeared).collect();
    let share = smeared.len() as f64 / steps.len().max(1) as f64;
    if share < FEW {
        return;
    }
    let found = format!(
        "{} ({}) in whose sweep the robot moves more than {} m or {:.1}°",
        count(smeared.len() as u64, "scan"),
        percent(share, 1.0),
        smear.error_m,
        smear.error_rad.to_degrees()
    );
    let means = "such scans are bent; beams are set right by the motion, but not by its changes within a sweep";
    let advice = "drive slower, or raise the laser's rate; [speed] in the configuration sets the limits";
    findings.push(Finding::unusual("smeared", found, means).so(advice).at(stretches(&smeared)));
}

/// Scans that fit nowhere.
fn lost(steps: &[Step], findings: &mut Vec<Finding>) {
    let lost: Vec<&Step> = steps.iter().filter(|step| step.matched.is_none()).collect();
    let share = lost.len() as f64 / steps.len().max(1) as f64;
    let found = format!("{} ({}) fit nothing seen before", count(lost.len() as u64, "scan"), percent(share, 1.0));
    if share <= LOST || lost.len() < SCANS {
        findings.push(Finding::note("lost", found).at(stretches(&lost)));
        return;
    }
    let means = "the path is a guess there, and what is mapped after may lie displaced";
    let advice = "look at the other findings at these places first";
    let of = if share > LOST_MOST { Finding::wrong } else { Finding::unusual };
    findings.push(of("lost", found, means).so(advice).at(stretches(&lost)));
}

/// Steps less than 20 lines apart are one stretch; the longest first.
fn stretches(steps: &[&Step]) -> Vec<Stretch> {
    const APART: u64 = 20;
    let runs = steps.chunk_by(|a, b| b.mark.line.saturating_sub(a.mark.line) <= APART);
    let mut runs: Vec<_> = runs.filter_map(|run| Some((run.len(), run.first()?.mark, run.last()?.mark))).collect();
    runs.sort_by_key(|(scans, ..)| std::cmp::Reverse(*scans));
    runs.into_iter().map(|(_, from, to)| Stretch::new(from, to)).collect()
}
