//! What is wrong or unusual with a log, a recording or a live laser, in plain words, and what to set. **One pass over the scans.**
//!
//! Data flow: scans → checks that each look at every scan (beams, times, ranges, stillness, sectors) and a cheap laser odometry that
//! follows the robot → [`Diagnosis`]: findings, each with its figure, places, meaning and advice.
//!
//! A finding is what the log shows, not what may be: thresholds are such that a clean log has notes only. What cannot be seen is not told: a
//! log without odometry whose scans are all mirrored maps well, into a mirror image.

mod beams;
mod finding;
mod follow;
mod odometry;
mod ranges;
mod sectors;
mod speed;
mod stillness;
mod timing;

use lrfslam_core::geometry::Pose2;
use serde::Serialize;

pub use finding::{Finding, STRETCHES_MAX, Severity, Stretch};
pub use follow::FollowerMemory;
pub use speed::SmearLimits;

use self::beams::BeamCheck;
use self::finding::{Mark, percent};
use self::follow::{Follower, Step};
use self::ranges::RangeCheck;
use self::sectors::SectorCheck;
use self::stillness::StillnessCheck;
use self::timing::TimeCheck;
use crate::plural::count;
use crate::results::report::{LaserCounts, Source};
use crate::scans::log::{LimitOrigin, LogCounts, LogScan, RangeNotes};

/// A robot that has moved less than this, m, stands.
const STANDS_M: f32 = 0.1;
/// The same for a turn, rad.
const STANDS_RAD: f32 = 0.09;

/// All that was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Diagnosis {
    /// The worst first, notes last.
    pub findings: Vec<Finding>,
}

impl Diagnosis {
    /// The worst there is.
    pub fn severity(&self) -> Severity {
        self.findings.iter().map(|finding| finding.severity).max().unwrap_or(Severity::Note)
    }

    /// Findings as bad as this.
    pub fn count(&self, severity: Severity) -> usize {
        self.findings.iter().filter(|finding| finding.severity == severity).count()
    }
}

/// Looks at scans, one after the other; see the [module](self).
#[derive(Debug)]
pub struct Doctor<'m> {
    follower: Follower<'m>,
    smear: SmearLimits,
    steps: Vec<Step>,
    beams: BeamCheck,
    times: TimeCheck,
    ranges: RangeCheck,
    stillness: StillnessCheck,
    sectors: SectorCheck,
}

impl<'m> Doctor<'m> {
    /// A doctor that has seen nothing.
    ///
    /// # Errors
    /// If the memory does not fit its configuration.
    pub fn new(smear: SmearLimits, memory: &'m mut FollowerMemory) -> anyhow::Result<Self> {
        Ok(Self {
            follower: Follower::new(memory)?,
            smear,
            steps: Vec::new(),
            beams: BeamCheck::default(),
            times: TimeCheck::default(),
            ranges: RangeCheck::default(),
            stillness: StillnessCheck::default(),
            sectors: SectorCheck::default(),
        })
    }

    /// Looks at the next scan.
    ///
    /// * `robot_from_lrf` — where the laser is said to sit on the robot
    ///
    /// # Errors
    /// If the scan has more points than there is memory for.
    pub fn add_scan(&mut self, scan: &LogScan, robot_from_lrf: Pose2) -> anyhow::Result<()> {
        self.beams.see(scan);
        self.times.see(Mark::of(scan));
        self.ranges.see(scan);
        self.stillness.see(scan);
        let step = self.follower.step(scan, robot_from_lrf)?;
        let moved = step.and_then(|step| step.matched.or(step.odometry)).unwrap_or(Pose2::IDENTITY);
        self.sectors.see(scan, moved);
        self.steps.extend(step);
        Ok(())
    }

    /// Says what was found in scans from `source`.
    pub fn finish(self, source: &Source) -> Diagnosis {
        let mut findings = Vec::new();
        let steps = &self.steps;
        let (log, range_notes) = about(source);
        log_findings(log, &mut findings);
        if let Source::Laser { laser, .. } = source {
            laser_findings(laser, &mut findings);
        }
        self.beams.report(log.map_or(0, |log| log.guessed_angles), &mut findings);
        self.times.report(source.has_times(), &mut findings);
        self.ranges.report(&range_notes, stands(steps), &mut findings);
        let hit_share = self.ranges.hit_share();
        self.stillness.report(hit_share, |stretch| has_moved(steps, stretch), &mut findings);
        self.sectors.report(&mut findings);
        mirrored(steps, &mut findings);
        speed::report(steps, self.smear, &mut findings);
        if speed::can_follow(steps) {
            odometry::report(steps, self.times.interval_s(), &mut findings);
        }
        findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
        Diagnosis { findings }
    }
}

/// What the log's reader has counted, and what ranges are like; a laser says how far it sees.
fn about(source: &Source) -> (Option<&LogCounts>, RangeNotes) {
    match source {
        Source::Log { log, .. } => (Some(log), log.ranges),
        _ => (None, RangeNotes { limit: LimitOrigin::Declared, ..RangeNotes::default() }),
    }
}

fn log_findings(log: Option<&LogCounts>, findings: &mut Vec<Finding>) {
    let Some(log) = log else { return };
    if log.damaged_lines > 0 {
        let all = (log.scans + log.damaged_lines) as f64;
        let first = log.damaged.first().map_or_else(String::new, |first| format!("; the first is {first}"));
        let lines = count(log.damaged_lines, "damaged line");
        let found = format!("{lines}, {} of all{first}", percent(log.damaged_lines as f64, all));
        let means = "what they saw is missing";
        let of = if log.is_badly_damaged() { Finding::wrong } else { Finding::unusual };
        findings.push(of("damaged-lines", found, means).so("look at how the log is written and copied"));
    }
    if log.cut_last_line {
        let found = "the last line is cut: the log was not closed, or not copied to its end".to_owned();
        findings.push(Finding::unusual("cut-log", found, "what came after is missing"));
    }
    if log.skipped_lines > 0 {
        findings.push(Finding::note("other-lines", count(log.skipped_lines, "line") + " of other kinds, not read"));
    }
    if log.mounting_contradictions > 0 {
        let scans = count(log.mounting_contradictions, "scan");
        let found =
            format!("{scans} in which the laser sits elsewhere on the robot than in the others, by the log's poses");
        let means = "their beams are placed by the mounting of the others: laser and odometry were stamped at different times, or the \
                     laser was moved";
        let advice = "measure where the laser sits, and set [mounting] with from_log=false";
        findings.push(Finding::wrong("mounting-contradictions", found, means).so(advice));
    }
}

fn laser_findings(laser: &LaserCounts, findings: &mut Vec<Finding>) {
    if laser.damaged > 0 {
        let found = count(laser.damaged.into(), "damaged scan") + " from the laser";
        let advice = "look at the cable, the converter and the rate of the port";
        findings.push(Finding::unusual("damaged-scans", found, "what they saw is missing").so(advice));
    }
    if laser.restarts > 0 {
        let found = format!("the laser had to be started again {}", count(laser.restarts.into(), "time"));
        let advice = "look at its power supply and at the cable";
        findings.push(Finding::wrong("restarts", found, "scans are missing").so(advice));
    }
    if laser.incomplete > 0 {
        let found = count(laser.incomplete.into(), "turn") + " of the laser with beams missing";
        let advice = "look at the cable, the converter and the rate of the port";
        findings.push(Finding::unusual("incomplete-turns", found, "what they saw is missing").so(advice));
    }
    if laser.overrun > 0 {
        let found = count(laser.overrun.into(), "scan") + " came faster than this computer takes them";
        findings.push(Finding::unusual("overrun", found, "they were left out"));
    }
}

/// True if the robot has been where it began at every scan.
fn stands(steps: &[Step]) -> bool {
    let mut at = Pose2::IDENTITY;
    steps.iter().all(|step| {
        at = at * step.matched.or(step.odometry).unwrap_or(Pose2::IDENTITY);
        at.position().norm() <= STANDS_M && at.heading.abs() <= STANDS_RAD
    })
}

/// True if the robot moves in `stretch` by odometry, or has moved when it is over by matching.
fn has_moved(steps: &[Step], stretch: &Stretch) -> bool {
    let is_inside = |step: &&Step| (stretch.from_line..=stretch.to_line).contains(&step.mark.line);
    let moves = |pose: Pose2| pose.position().norm() > STANDS_M || pose.heading.abs() > STANDS_RAD;
    let odometry = steps.iter().filter(is_inside).filter_map(|step| step.odometry);
    let by_odometry = odometry.fold(Pose2::IDENTITY, |sum, step| sum * step);
    let next = steps.iter().find(|step| step.mark.line > stretch.to_line);
    moves(by_odometry)
        || next
            .is_some_and(|step| step.matched.is_none_or(|jump| moves(jump) && jump.position().norm() > 3.0 * STANDS_M))
}

/// Moments from which on the scans are mirrored.
fn mirrored(steps: &[Step], findings: &mut Vec<Finding>) {
    let switches: Vec<_> = steps.iter().filter(|step| step.is_mirrored).map(|step| step.mark).collect();
    if switches.is_empty() {
        return;
    }
    let found = format!("the scans change to their mirror image {}", count(switches.len() as u64, "time"));
    let means =
        "the order of the beams was turned around, or the laser upside down, at that moment: the two parts do not fit";
    let advice = "map the parts by themselves, or turn the beams of one of them around";
    findings.push(
        Finding::wrong("mirrored", found, means)
            .so(advice)
            .at(switches.into_iter().map(|mark| Stretch::new(mark, mark))),
    );
}

#[cfg(test)]
mod tests;
