//! How much of what the laser sees changes: next to nothing while the robot stands.

use crate::scan::{Beam, Echo, RangeScan};
use crate::time::Instant;

/// Parts of a scan that are compared, at most: their mean ranges are less noisy than a beam's.
const SECTORS: usize = 32;
/// Views are kept so far apart, s, …
const APART_S: f32 = 0.15;
/// … this many of them, …
const KEPT: usize = 8;
/// … so that compared is with what was seen so long ago, s: in less a slow robot in a corridor changes next to nothing. Slow scans: with the oldest.
const BEFORE_S: f32 = 1.0;
/// A sector has changed if its mean range has, by this, m, …
const CHANGED_M: f32 = 0.01;
/// … and this share of it: the error of a beam may be 3 % (URG-04LX), that of the mean of a few is less.
const CHANGED_SHARE: f32 = 0.02;
/// Fewer sectors with as many hits as before say nothing.
const SECTORS_MIN: u16 = 3;
/// Share of the newest comparison in the mean of the last ones.
const NEWEST_SHARE: f32 = 0.5;
/// The robot moves if more than this share changes. Chosen: with ranges cut at 4 m, nineteen of twenty comparisons are below 0.14 where the robots
/// of Intel and ACES stand (0.22 with 3 % of noise).
const MOVES_FROM: f32 = 0.25;
/// It stands if no more than this share of the newest view has. Chosen: of the comparisons while Intel's robot drives a thousandth are such, a hundredth
/// with ranges cut at 4 m, and half of those while it stands.
const STANDS_TO: f32 = 0.1;

/// Hits of neighbouring beams.
#[derive(Debug, Clone, Copy, Default)]
struct Sector {
    hits: u16,
    /// In the mean.
    range_m: f32,
}

impl Sector {
    fn of(beams: &[Beam]) -> Self {
        let (mut hits, mut sum_m) = (0_u16, 0.0);
        for beam in beams {
            if let Echo::Hit(range_m) = beam.echo {
                hits = hits.saturating_add(1);
                sum_m += range_m;
            }
        }
        Self { hits, range_m: sum_m / f32::from(hits.max(1)) }
    }

    fn has_changed(&self, before: &Self) -> bool {
        (self.range_m - before.range_m).abs() > CHANGED_M + CHANGED_SHARE * self.range_m
    }
}

/// What was seen once.
#[derive(Debug, Clone, Copy, Default)]
struct View {
    at: Instant,
    sectors: [Sector; SECTORS],
}

impl View {
    #[inline(never)]
    fn of(scan: &RangeScan<'_>) -> Self {
        let beams = scan.beams.len().div_ceil(SECTORS).max(1);
        let mut parts = scan.beams.chunks(beams);
        Self { at: scan.stamp, sectors: core::array::from_fn(|_| parts.next().map(Sector::of).unwrap_or_default()) }
    }

    /// Share of the sectors that have changed since `before`; `None` if there is too little to compare.
    #[inline(never)]
    fn changed_since(&self, before: &Self) -> Option<f32> {
        let (mut known, mut changed) = (0_u16, 0_u16);
        for (now, before) in self.sectors.iter().zip(&before.sectors) {
            if now.hits > 0 && now.hits == before.hits {
                known = known.saturating_add(1);
                changed = changed.saturating_add(u16::from(now.has_changed(before)));
            }
        }
        (known >= SECTORS_MIN).then(|| f32::from(changed) / f32::from(known))
    }

    fn age_s(&self, now: Instant) -> f32 {
        now.since(self.at).as_secs_f32()
    }
}

/// See the [module](self).
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Change {
    views: [View; KEPT],
    /// Views taken so far; the newest is in the place before the next one's.
    taken: usize,
    /// Of the sectors, in the mean of the last comparisons; `None` if nothing could be compared last.
    share: Option<f32>,
    /// Of the newest comparison.
    newest: Option<f32>,
}

impl Change {
    /// Takes the next scan.
    #[inline(never)]
    pub(super) fn look(&mut self, scan: &RangeScan<'_>) {
        let newest = self.taken.checked_sub(1).and_then(|newest| self.views.get(newest % KEPT));
        if newest.is_some_and(|newest| (0.0..APART_S).contains(&newest.age_s(scan.stamp))) {
            return;
        }
        let view = View::of(scan);
        if let Some(before) = self.before(scan.stamp) {
            self.newest = view.changed_since(before);
            self.share = self.newest.map(|now| match self.share {
                Some(share) => share + NEWEST_SHARE * (now - share),
                None => now,
            });
        }
        if let Some(place) = self.views.get_mut(self.taken % KEPT) {
            *place = view;
        }
        self.taken = self.taken.wrapping_add(1);
    }

    /// The newest view that is old enough to be compared with; the oldest one if all are too new.
    fn before(&self, now: Instant) -> Option<&View> {
        let views = self.views.get(..self.taken.min(KEPT)).unwrap_or_default();
        let old_enough = views.iter().filter(|view| view.age_s(now) >= BEFORE_S);
        let oldest =
            || views.iter().filter(|_| self.taken >= KEPT).max_by(|a, b| a.age_s(now).total_cmp(&b.age_s(now)));
        old_enough.min_by(|a, b| a.age_s(now).total_cmp(&b.age_s(now))).or_else(oldest)
    }

    /// True if so much changes as while the robot moves; what it turns by changes as much.
    pub(super) fn says_that_it_moves(&self) -> bool {
        self.share.is_some_and(|share| share > MOVES_FROM)
    }

    /// True if next to nothing changes, as while the robot stands.
    pub(super) fn says_that_it_stands(&self) -> bool {
        self.newest.is_some_and(|share| share <= STANDS_TO)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::normal;
    use crate::random::RandomStream;
    use crate::time::Duration;
    use std::vec::Vec;

    /// What a laser sees in a corridor 2 m wide with a niche every metre, `noise` of the range off.
    fn after(speed_mps: f32, noise: f32, beams: usize) -> Change {
        let mut change = Change::default();
        let mut rng = RandomStream::new(1, 0, 0);
        for scan in 0..20 {
            let x = 0.2 * scan as f32 * speed_mps;
            let seen: Vec<Beam> = (0..beams)
                .map(|beam| {
                    let bearing = core::f32::consts::PI * (beam as f32 / (beams - 1) as f32 - 0.5);
                    let (sin, cos) = (libm::sinf(bearing).abs().max(1e-3), libm::cosf(bearing).max(0.0));
                    let depth = if (x + cos / sin).rem_euclid(1.0) < 0.5 { 1.2 } else { 1.0 };
                    let range = depth / sin * (1.0 + noise * normal(&mut rng));
                    let echo = if range < 6.0 { Echo::Hit(range) } else { Echo::Miss };
                    Beam { bearing_rad: bearing, offset: Duration::ZERO, echo }
                })
                .collect();
            let stamp = Instant::from_micros(200_000 * scan);
            change.look(&RangeScan { stamp, range_max_m: 8.0, beams: &seen });
        }
        change
    }

    #[test]
    fn a_view_changes_for_who_moves_and_not_for_who_stands() {
        for (beams, noise) in [(181, 0.002), (181, 0.017), (23, 0.002), (683, 0.01)] {
            assert!(after(0.5, noise, beams).says_that_it_moves(), "{beams} beams, noise {noise}");
            assert!(!after(0.5, noise, beams).says_that_it_stands(), "{beams} beams, noise {noise}");
            assert!(!after(0.0, noise, beams).says_that_it_moves(), "{beams} beams, noise {noise}");
        }
        for (beams, noise) in [(181, 0.002), (23, 0.002), (683, 0.01)] {
            assert!(after(0.0, noise, beams).says_that_it_stands(), "{beams} beams, noise {noise}");
        }
    }
}
