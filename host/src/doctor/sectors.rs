//! Directions that never change: something fixed to the robot stands in the view, or nothing comes back from there.
//!
//! Beams are gathered by degrees, over windows in which the robot turns or drives. A direction in which the same near range stands in window
//! after window, while the robot turns, sees the robot itself.

use std::f32::consts::TAU;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::Echo;

use super::finding::{Finding, Mark, Stretch};
use crate::scans::log::LogScan;

/// Directions told apart: one a degree.
const BINS: usize = 360;
/// A window ends when the robot has turned so far, rad …
const WINDOW_RAD: f32 = 30.0 * std::f32::consts::PI / 180.0;
/// … or driven so far, m …
const WINDOW_M: f32 = 0.7;
/// … but not before so many scans.
const WINDOW_SCANS: u32 = 5;
/// Only what is nearer can be on the robot, m.
const NEAR_M: f64 = 1.0;
/// It does not move more than this, m: noise.
const STILL_M: f64 = 0.04;
/// It is seen by so many of the scans.
const SEEN: f64 = 0.7;
/// The robot must have turned so far meanwhile, rad: a wall beside it does not turn with it.
const TURNED_RAD: f32 = 70.0 * std::f32::consts::PI / 180.0;
/// And so many windows must have passed.
const WINDOWS: u32 = 5;
/// Directions side by side.
const WIDTH: usize = 3;
/// A direction from which fewer beams than this come back, though many do elsewhere, is dead.
const DEAD: f64 = 0.002;
/// That is, this share at least.
const ALIVE: f64 = 0.3;
/// Scans before which nothing is said about it.
const DEAD_SCANS: u64 = 100;

/// Hits of one direction within a window.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    beams: u32,
    hits: u32,
    sum_m: f64,
    squares_m2: f64,
}

/// A direction that has not changed since.
#[derive(Debug, Clone, Copy)]
struct Still {
    since: Mark,
    until: Mark,
    windows: u32,
    /// Least and greatest heading, rad.
    headings: (f32, f32),
    range_m: f64,
}

/// Gathers beams by direction.
#[derive(Debug)]
pub(super) struct SectorCheck {
    window: Vec<Sums>,
    window_scans: u32,
    began: Option<Mark>,
    /// Since the window began: heading and way.
    moved: (f32, f32),
    heading_rad: f32,
    /// Least and greatest heading of all.
    headings: (f32, f32),
    still: Vec<Option<Still>>,
    longest: Vec<Option<Still>>,
    /// Beams and hits by direction, of all scans.
    totals: Vec<(u64, u64)>,
    scans: u64,
}

impl Default for SectorCheck {
    fn default() -> Self {
        Self {
            window: vec![Sums::default(); BINS],
            window_scans: 0,
            began: None,
            moved: (0.0, 0.0),
            heading_rad: 0.0,
            headings: (0.0, 0.0),
            still: vec![None; BINS],
            longest: vec![None; BINS],
            totals: vec![(0, 0); BINS],
            scans: 0,
        }
    }
}

impl SectorCheck {
    /// * `step` — of the robot since the last scan, as far as it is known
    pub fn see(&mut self, scan: &LogScan, step: Pose2) {
        self.scans += 1;
        self.heading_rad += step.heading;
        self.headings = widened(self.headings, self.heading_rad);
        self.moved = (self.moved.0 + step.heading, self.moved.1 + step.position().norm());
        self.began.get_or_insert(Mark::of(scan));
        self.window_scans += 1;
        for beam in &scan.beams {
            let bin = ((beam.bearing_rad / TAU).rem_euclid(1.0) * BINS as f32).round() as usize % BINS;
            let (sums, total) = (&mut self.window[bin], &mut self.totals[bin]);
            sums.beams += 1;
            total.0 += 1;
            if let Echo::Hit(range_m) = beam.echo {
                let range_m = f64::from(range_m);
                sums.hits += 1;
                sums.sum_m += range_m;
                sums.squares_m2 += range_m * range_m;
                total.1 += 1;
            }
        }
        let has_moved = self.moved.0.abs() > WINDOW_RAD || self.moved.1 > WINDOW_M;
        if has_moved && self.window_scans >= WINDOW_SCANS {
            self.end_window(Mark::of(scan));
        }
    }

    fn end_window(&mut self, until: Mark) {
        let since = self.began.take().unwrap_or(until);
        for bin in 0..BINS {
            let still = std::mem::take(&mut self.window[bin]).still_m();
            let before =
                self.still[bin].take().filter(|before| still.is_some_and(|m| (m - before.range_m).abs() < STILL_M));
            self.still[bin] = still.map(|range_m| match before {
                Some(before) => Still {
                    until,
                    windows: before.windows + 1,
                    headings: widened(before.headings, self.heading_rad),
                    ..before
                },
                None => {
                    let began_rad = self.heading_rad - self.moved.0;
                    let headings = widened((began_rad, began_rad), self.heading_rad);
                    Still { since, until, windows: 1, headings, range_m }
                }
            });
            let longest = self.longest[bin].map_or(0, |longest| longest.windows);
            self.longest[bin] =
                self.still[bin].filter(|still| still.is_fixed() && still.windows > longest).or(self.longest[bin]);
        }
        (self.moved, self.window_scans) = ((0.0, 0.0), 0);
    }

    pub fn report(&self, findings: &mut Vec<Finding>) {
        let blocked: Vec<bool> = self.longest.iter().map(Option::is_some).collect();
        for (from, to) in sectors(&blocked) {
            let bins: Vec<Still> = (from..=to).filter_map(|bin| self.longest[bin % BINS]).collect();
            let ranges = bins.iter().map(|still| still.range_m);
            let (near, far) = ranges.fold((f64::MAX, 0.0), |(near, far), m| (m.min(near), m.max(far)));
            let found =
                format!("{} always the same, {near:.2} to {far:.2} m away, however the robot turns", named(from, to));
            let means =
                "it is part of the robot, a cover, or somebody who walks along: it is drawn wherever the robot goes";
            let advice = "clear the view of the laser, or leave these beams out";
            let longest =
                bins.iter().max_by_key(|still| still.windows).map(|still| Stretch::new(still.since, still.until));
            findings.push(Finding::wrong("blocked-sector", found, means).so(advice).at(longest));
        }
        self.report_dead(findings);
    }

    fn report_dead(&self, findings: &mut Vec<Finding>) {
        let (beams, hits) = self.totals.iter().fold((0, 0), |sum, bin| (sum.0 + bin.0, sum.1 + bin.1));
        let turned_rad = self.headings.1 - self.headings.0;
        if self.scans < DEAD_SCANS || turned_rad < TURNED_RAD || (hits as f64) < ALIVE * beams as f64 {
            return;
        }
        let is_dead = |(beams, hits): &(u64, u64)| *beams >= self.scans / 4 && (*hits as f64) < DEAD * *beams as f64;
        let dead: Vec<bool> = self.totals.iter().map(is_dead).collect();
        for (from, to) in sectors(&dead) {
            let found = format!("nothing ever comes back from {}", named(from, to));
            let means = "part of the view is lost: turns are harder to follow";
            let advice = "is the window of the laser dirty or covered there?";
            findings.push(Finding::unusual("dead-sector", found, means).so(advice));
        }
    }
}

impl Sums {
    /// The range that stands there unchanged, m.
    fn still_m(self) -> Option<f64> {
        let hits = f64::from(self.hits);
        if hits < 3.0 || hits < SEEN * f64::from(self.beams) {
            return None;
        }
        let mean_m = self.sum_m / hits;
        let variance_m2 = (self.squares_m2 / hits - mean_m * mean_m).max(0.0);
        (mean_m < NEAR_M && variance_m2.sqrt() < STILL_M).then_some(mean_m)
    }
}

impl Still {
    fn is_fixed(&self) -> bool {
        self.windows >= WINDOWS && self.headings.1 - self.headings.0 > TURNED_RAD
    }
}

fn widened((least, most): (f32, f32), value: f32) -> (f32, f32) {
    (least.min(value), most.max(value))
}

/// Stretches of at least [`WIDTH`] directions, from and to; one that goes through 0 ends beyond [`BINS`].
fn sectors(marked: &[bool]) -> Vec<(usize, usize)> {
    let bins = marked.len();
    let Some(start) = marked.iter().position(|marked| !marked) else { return vec![(0, bins - 1)] };
    let mut found = Vec::new();
    let mut open = None;
    for bin in start..=start + bins {
        match (open, marked[bin % bins]) {
            (None, true) => open = Some(bin),
            (Some(from), false) => {
                found.extend((bin - from >= WIDTH).then_some((from, bin - 1)));
                open = None;
            }
            _ => {}
        }
    }
    found
}

/// In degrees to the left of straight ahead.
fn named(from: usize, to: usize) -> String {
    let degrees = |bin: usize| (bin as i32 + 180).rem_euclid(BINS as i32) - 180;
    format!("{}° to {}°", degrees(from), degrees(to))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sectors_are_whole_also_behind_the_robot_and_ahead() {
        let marked = |wanted: &[usize]| -> Vec<bool> { (0..BINS).map(|bin| wanted.contains(&bin)).collect() };
        assert_eq!(sectors(&marked(&[1, 2, 5, 6, 7, 8])), [(5, 8)]);
        assert_eq!(sectors(&marked(&[358, 359, 0, 1])), [(358, 361)]);
        assert_eq!(sectors(&[true; BINS]), [(0, 359)]);
        assert_eq!((named(358, 361), named(170, 190)), ("-2° to 1°".to_owned(), "170° to -170°".to_owned()));
    }
}
