//! Walls that are gone: where a scan looks through what stood for two witnesses, the robot is not where it is thought to be.
//!
//! Witnesses look through one another's walls, too: where people stand and go, doors move, or beams are few. Only what a scan looks through beyond that
//! tells something.

use super::KeyScan;
use super::reference::Taken;
use super::witnesses::{Outline, Testimony, outlines};
use crate::geometry::Point2;

/// Fewer points of walls in view say nothing of whether they still stand. Chosen.
const SEEN_MIN: u16 = 16;

/// Share of the walls that a scan looks through, 0 to 1, of those that stand for two witnesses and in its view, and that the witnesses do not look
/// through as well; 0 if too little is in its view.
///
/// * `hits` — of the scan, robot frame, in beam order
/// * `taken` — where it was
/// * `witness_points` — the hits of each witness, robot frame, in beam order
pub(super) fn looked_through(hits: &[Point2], taken: &Taken, witnesses: &[KeyScan], witness_points: &[Point2]) -> f32 {
    let outlines = outlines(witnesses, witness_points);
    let now = Outline::new(taken, hits);
    let mut walls = Walls::default();
    walls.look(&now, outlines.iter(), 1);
    let share = walls.share();
    if share <= 0.0 {
        return 0.0;
    }
    // Each of them in turn changes places with the scan, and looks at its share of the points: together they take as long as the scan.
    let mut before = Walls::default();
    for (own, witness) in outlines.iter().enumerate() {
        let changed = |(index, outline)| if index == own { &now } else { outline };
        before.look(witness, outlines.iter().enumerate().map(changed), outlines.len());
    }
    let usual = before.share();
    if usual < share { (share - usual) / (1.0 - usual) } else { 0.0 }
}

/// Points of walls that stand for two witnesses.
#[derive(Debug, Default)]
struct Walls {
    /// In view.
    seen: u16,
    /// Looked through.
    free: u16,
}

impl Walls {
    /// `looking` looks at the walls of `witnesses`, at one in `every` of their points.
    fn look<'w>(
        &mut self,
        looking: &Outline<'_>,
        witnesses: impl Iterator<Item = &'w Outline<'w>> + Clone,
        every: usize,
    ) {
        for (index, witness) in witnesses.clone().enumerate() {
            for point in witness.points.iter().step_by(every) {
                let in_map = witness.taken.map_from_robot.transform(*point);
                let says = |outline: &Outline<'_>| outline.testimony(outline.place(in_map));
                let seen = says(looking);
                let mut others = witnesses.clone().enumerate().filter(|(other, _)| *other != index);
                if seen != Testimony::None && others.any(|(_, other)| says(other) == Testimony::Near) {
                    self.seen = self.seen.saturating_add(1);
                    self.free = self.free.saturating_add(u16::from(seen == Testimony::Free));
                }
            }
        }
    }

    /// Share that is looked through; 0 if too little is in view.
    fn share(&self) -> f32 {
        if self.seen < SEEN_MIN { 0.0 } else { f32::from(self.free) / f32::from(self.seen) }
    }
}
