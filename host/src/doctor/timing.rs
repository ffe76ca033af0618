//! When scans come: rate, gaps, bursts, and times that run back.

use super::finding::{Finding, Mark, Stretch, percent, quantile};
use crate::plural::count;

/// An interval so many times the usual one is a gap …
const GAP: f64 = 4.0;
/// … if it is also so much longer, s.
const GAP_S: f64 = 0.5;
/// Scans closer together than this share of a long interval come in a burst.
const BURST: f64 = 0.25;
/// A larger share of them is worth telling.
const BURSTS: f64 = 0.05;
/// Intervals of which the middle 80 % spread over more than this share of the usual one are unsteady.
const UNSTEADY: f64 = 0.7;
/// In a log written in bursts only an interval so many times the mean one is a gap.
const GAP_OF_BURSTS: f64 = 20.0;

/// Collects times.
#[derive(Debug, Default)]
pub(super) struct TimeCheck {
    marks: Vec<Mark>,
}

impl TimeCheck {
    pub fn see(&mut self, mark: Mark) {
        self.marks.push(mark);
    }

    /// The usual time from scan to scan, s; 0 if there is none. Of a log written in bursts, the mean.
    pub fn interval_s(&self) -> f64 {
        let mut steps = self.steps();
        let usual_s = quantile(&mut steps, 0.5).unwrap_or(0.0);
        match self.marks.first().zip(self.marks.last()) {
            Some((first, last)) if bursts(&mut steps) > BURSTS => {
                last.stamp.since(first.stamp).micros as f64 * 1e-6 / (self.marks.len() - 1) as f64
            }
            _ => usual_s,
        }
    }

    /// Intervals that are longer than nothing, s.
    fn steps(&self) -> Vec<f64> {
        self.intervals().map(|(_, _, seconds)| seconds).filter(|step| *step > 0.0).collect()
    }

    fn intervals(&self) -> impl Iterator<Item = (Mark, Mark, f64)> {
        let seconds = |from: Mark, to: Mark| to.stamp.since(from.stamp).micros as f64 * 1e-6;
        self.marks.windows(2).map(move |pair| (pair[0], pair[1], seconds(pair[0], pair[1])))
    }

    /// * `has_times` — the log has times of its own
    pub fn report(&self, has_times: bool, findings: &mut Vec<Finding>) {
        let usual_s = self.interval_s();
        if !has_times {
            let found = format!("no times: scans are taken to come every {usual_s:.3} s");
            let advice = "set log.untimed_scan_interval_s to the laser's interval";
            findings.push(Finding::note("no-times", found).so(advice));
            return;
        }
        if usual_s > 0.0 {
            let scans = count(self.marks.len() as u64, "scan");
            findings.push(Finding::note("rate", format!("{scans}, {:.1} a second", 1.0 / usual_s)));
        }
        self.backward(findings);
        self.repeated(findings);
        self.gaps(usual_s, findings);
        self.unsteady(usual_s, findings);
    }

    fn backward(&self, findings: &mut Vec<Finding>) {
        let back: Vec<_> = self.intervals().filter(|(_, _, seconds)| *seconds < 0.0).collect();
        let Some(worst_s) = back.iter().map(|(_, _, seconds)| -seconds).reduce(f64::max) else { return };
        let times = count(back.len() as u64, "time");
        let found = format!("times run back {times}, by {worst_s:.3} s at most");
        let means =
            "the order of the lines counts, not their times; nothing that needs the time between scans can be trusted";
        let advice = "do not sort the log by time; let the recorder stamp scans when they come";
        let at = back.iter().map(|(_, to, _)| Stretch::new(*to, *to));
        findings.push(Finding::unusual("times-backward", found, means).so(advice).at(at));
    }

    fn repeated(&self, findings: &mut Vec<Finding>) {
        let same: Vec<_> = self.intervals().filter(|(_, _, seconds)| *seconds == 0.0).collect();
        if same.is_empty() {
            return;
        }
        let found = format!("{} the time of the scan before", count(same.len() as u64, "scan") + " with");
        let means = "trajectory.tum has one pose for both";
        let at = same.iter().map(|(_, to, _)| Stretch::new(*to, *to));
        findings.push(Finding::unusual("times-repeated", found, means).at(at));
    }

    fn gaps(&self, usual_s: f64, findings: &mut Vec<Finding>) {
        let factor = if bursts(&mut self.steps()) > BURSTS { GAP_OF_BURSTS } else { GAP };
        let least_s = (factor * usual_s).max(usual_s + GAP_S);
        let is_gap = |seconds: f64| usual_s > 0.0 && seconds > least_s;
        let mut gaps: Vec<_> = self.intervals().filter(|(_, _, seconds)| is_gap(*seconds)).collect();
        gaps.sort_by(|a, b| b.2.total_cmp(&a.2));
        let Some((_, _, worst_s)) = gaps.first() else { return };
        let total_s: f64 = gaps.iter().map(|(_, _, seconds)| seconds).sum();
        let found = format!(
            "no scans for {worst_s:.1} s at most, {} of more than {least_s:.1} s, {total_s:.1} s in all",
            count(gaps.len() as u64, "gap")
        );
        let means = "if the robot moved meanwhile, the matcher must find it again: up to 2 m and 100°";
        let advice = "look for a computer that was busy, a full disk, or a cable";
        let at = gaps.iter().map(|(from, to, _)| Stretch::new(*from, *to));
        findings.push(Finding::unusual("gaps", found, means).so(advice).at(at));
    }

    fn unsteady(&self, usual_s: f64, findings: &mut Vec<Finding>) {
        let mut steps = self.steps();
        let bursts = bursts(&mut steps);
        let means = "the speed of the robot is misjudged, and with it where the next scan is looked for";
        if bursts > BURSTS {
            let found = format!("scans come in bursts: {} within a quarter of a long interval", percent(bursts, 1.0));
            let advice = "stamp scans when the laser took them, not when they are written";
            findings.push(Finding::unusual("bursts", found, means).so(advice));
            return;
        }
        let (Some(low), Some(high)) = (quantile(&mut steps, 0.1), quantile(&mut steps, 0.9)) else { return };
        if high - low > UNSTEADY * usual_s {
            let found = format!("unsteady rate: from scan to scan {low:.3} to {high:.3} s in the middle 80 %");
            findings.push(Finding::unusual("unsteady-rate", found, means));
        }
    }
}

/// Share of the intervals that are far shorter than the long ones.
fn bursts(steps: &mut [f64]) -> f64 {
    let long_s = quantile(steps, 0.9).unwrap_or(0.0);
    steps.iter().filter(|step| **step < BURST * long_s).count() as f64 / steps.len().max(1) as f64
}
