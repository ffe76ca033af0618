//! Scans that cannot be what a laser in the open sees: the same bits again and again, all near, or nothing at all.

use lrfslam_core::scan::{Beam, Echo};

use super::finding::{Finding, Mark, Stretch};
use crate::plural::count;
use crate::scans::log::LogScan;

/// So many scans in a row with the same bits are more than chance.
const FROZEN_SCANS: u64 = 5;
/// A scan that is nearly all nearer than this is covered, m.
const COVERED_M: f32 = 0.3;
/// Nearly all.
const COVERED: f64 = 0.8;
/// And so many in a row.
const COVERED_SCANS: u64 = 3;
/// A scan with a smaller share of hits than this saw nothing …
const BLIND: f64 = 0.02;
/// … in a log whose beams usually hit something more often than this.
const SEEING: f64 = 0.2;
/// And so many in a row.
const BLIND_SCANS: u64 = 5;

/// Stretches of scans of which something holds.
#[derive(Debug, Default)]
struct Runs {
    open: Option<(Mark, Mark, u64)>,
    done: Vec<(Mark, Mark, u64)>,
}

impl Runs {
    fn see(&mut self, mark: Mark, holds: bool, least: u64) {
        match (&mut self.open, holds) {
            (Some((_, to, scans)), true) => (*to, *scans) = (mark, *scans + 1),
            (None, true) => self.open = Some((mark, mark, 1)),
            (_, false) => self.close(least),
        }
    }

    fn close(&mut self, least: u64) {
        self.done.extend(self.open.take().filter(|(_, _, scans)| *scans >= least));
    }

    fn scans(&self) -> u64 {
        self.done.iter().map(|(_, _, scans)| scans).sum()
    }

    fn stretches(&self) -> impl Iterator<Item = Stretch> {
        self.done.iter().map(|(from, to, _)| Stretch::new(*from, *to))
    }
}

/// Looks at scan after scan.
#[derive(Debug, Default)]
pub(super) struct StillnessCheck {
    last: Vec<Beam>,
    frozen: Runs,
    covered: Runs,
    blind: Runs,
}

impl StillnessCheck {
    pub fn see(&mut self, scan: &LogScan) {
        let mark = Mark::of(scan);
        let same = scan.beams.len() == self.last.len()
            && scan.beams.iter().zip(&self.last).all(|(now, before)| now.echo == before.echo);
        let hits =
            || scan.beams.iter().filter_map(|beam| if let Echo::Hit(range) = beam.echo { Some(range) } else { None });
        let (beams, seen) = (scan.beams.len() as f64, hits().count() as f64);
        let near = hits().filter(|range| *range < COVERED_M).count() as f64;
        self.frozen.see(mark, same && seen > 0.0, FROZEN_SCANS);
        self.covered.see(mark, near >= COVERED * beams, COVERED_SCANS);
        self.blind.see(mark, seen <= BLIND * beams, BLIND_SCANS);
        self.last.clone_from(&scan.beams);
    }

    /// * `hit_share` — of the whole log's beams
    /// * `moves` — whether the robot moves from a scan to another by all that is known
    pub fn report(mut self, hit_share: f64, moves: impl Fn(&Stretch) -> bool, findings: &mut Vec<Finding>) {
        self.frozen.close(FROZEN_SCANS);
        self.covered.close(COVERED_SCANS);
        self.blind.close(BLIND_SCANS);
        self.report_frozen(moves, findings);
        if !self.covered.done.is_empty() {
            let scans = count(self.covered.scans(), "scan");
            let found = format!("{scans} with four of five beams nearer than {COVERED_M} m: the laser was covered");
            let means = "nothing can be matched, and the map has walls where the cover was";
            let advice = "leave these scans out, and map the parts before and after by themselves or with --continue";
            findings.push(Finding::wrong("covered", found, means).so(advice).at(self.covered.stretches()));
        }
        if !self.blind.done.is_empty() && hit_share > SEEING {
            let found = format!("{} in which nearly no beam hit anything", count(self.blind.scans(), "scan"));
            let means = "nothing can be matched there: the path is a guess";
            let advice = "was the laser covered, or outside? look at its window and at its power supply";
            findings.push(Finding::wrong("sees-nothing", found, means).so(advice).at(self.blind.stretches()));
        }
    }

    fn report_frozen(&self, moves: impl Fn(&Stretch) -> bool, findings: &mut Vec<Finding>) {
        if self.frozen.done.is_empty() {
            return;
        }
        let moved: Vec<Stretch> = self.frozen.stretches().filter(|stretch| moves(stretch)).collect();
        let scans = count(self.frozen.scans(), "scan");
        let found = format!("{scans} with the same bits as the one before: even a laser at rest shows noise");
        let advice = "look for a driver that repeats its last scan when none comes";
        findings.push(match moved.is_empty() {
            true => Finding::unusual("frozen-scans", found, "the robot is taken to stand").at(self.frozen.stretches()),
            false => {
                let means = "the robot moves meanwhile, and is taken to stand: the map folds there";
                Finding::wrong("frozen-scans", found, means).at(moved)
            }
        });
        if let Some(last) = findings.last_mut() {
            last.advice = advice.to_owned();
        }
    }
}
