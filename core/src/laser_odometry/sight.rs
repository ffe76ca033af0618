//! Does a scan show anything? A covered laser measures its cover. A frozen one repeats a scan to the bit, as only a simulated one does that stands.

use crate::geometry::Point2;
use crate::scan::{Echo, RangeScan};

/// What is nearer to the laser than this covers it, m.
const COVER_M: f32 = 0.3;
/// A scan shows something if so many hits lie farther away …
const HITS_MIN: usize = 3;
/// … and one of so many beams.
const BEAMS_PER_HIT: usize = 50;
/// A scan repeated to the bit this many times in a row is frozen: of 29,000 of the logs used here, one is repeated more than once.
const REPEATS_MAX: u16 = 4;
/// FNV-1a, 32 bits.
const FNV_OFFSET: u32 = 0x811C_9DC5;
const FNV_PRIME: u32 = 0x0100_0193;

/// What is known of the scans before.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sight {
    /// Hits on what stands against the laser were left out of the last scan, and they were half of it or more.
    pub(super) is_half_covered: bool,
    last: u32,
    repeats: u16,
}

impl Sight {
    /// True if `scan` repeats the ones before it.
    pub(super) fn is_frozen(&mut self, scan: &RangeScan<'_>) -> bool {
        let print = fingerprint(scan);
        self.repeats = if print == self.last { self.repeats.saturating_add(1) } else { 0 };
        self.last = print;
        self.repeats >= REPEATS_MAX
    }
}

/// Moves the hits that cover nothing to the front, in order, and returns how many these are: what stands against the laser and takes half of
/// its hits, as somebody who walks into the robot, would outvote the little that is seen past it. All hits else.
///
/// * `hits` — robot frame, in beam order
/// * `eye` — the laser, robot frame
pub(super) fn look_past_cover(hits: &mut [Point2], eye: Point2) -> usize {
    let far = count_far(hits, eye);
    if far >= hits.len() - far {
        return hits.len();
    }
    let mut kept = 0;
    for index in 0..hits.len() {
        let Some(hit) = hits.get(index).copied().filter(|hit| is_far(*hit, eye)) else { continue };
        if let Some(place) = hits.get_mut(kept) {
            *place = hit;
            kept += 1;
        }
    }
    kept
}

/// True if `scan` shows nothing; `hits` are its hits and `eye` is the laser, robot frame.
pub(super) fn is_covered(scan: &RangeScan<'_>, hits: &[Point2], eye: Point2) -> bool {
    count_far(hits, eye) < HITS_MIN.max(scan.beams.len() / BEAMS_PER_HIT)
}

fn count_far(hits: &[Point2], eye: Point2) -> usize {
    hits.iter().filter(|hit| is_far(**hit, eye)).count()
}

fn is_far(hit: Point2, eye: Point2) -> bool {
    (hit - eye).norm() > COVER_M
}

fn fingerprint(scan: &RangeScan<'_>) -> u32 {
    scan.beams.iter().fold(FNV_OFFSET, |hash, beam| {
        let range = if let Echo::Hit(range_m) = beam.echo { range_m.to_bits() } else { 0 };
        (hash ^ range).wrapping_mul(FNV_PRIME)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan::Beam;
    use crate::time::{Duration, Instant};

    fn scan_of(ranges: impl Fn(usize) -> Echo) -> [Beam; 180] {
        core::array::from_fn(|i| Beam { bearing_rad: 0.01 * i as f32, offset: Duration::ZERO, echo: ranges(i) })
    }

    fn is_covered_by(beams: &[Beam]) -> bool {
        let hits: std::vec::Vec<Point2> = beams.iter().filter_map(Point2::of_hit).collect();
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams };
        is_covered(&scan, &hits, Point2::default())
    }

    #[test]
    fn a_hand_covers_a_laser_and_a_few_far_hits_uncover_it() {
        assert!(is_covered_by(&scan_of(|_| Echo::Hit(0.1))));
        assert!(is_covered_by(&scan_of(|_| Echo::Miss)));
        assert!(!is_covered_by(&scan_of(|i| Echo::Hit(if i % 30 == 0 { 2.0 } else { 0.1 }))));
    }

    #[test]
    fn what_stands_against_the_laser_does_not_outvote_the_rest() {
        let past = |far: usize| {
            let beams = scan_of(|i| Echo::Hit(if i % 20 < far { 2.0 } else { 0.2 }));
            let mut hits: std::vec::Vec<Point2> = beams.iter().filter_map(Point2::of_hit).collect();
            let count = look_past_cover(&mut hits, Point2::default());
            (count, hits.iter().take(count).all(|hit| hit.norm() > 1.0))
        };
        assert_eq!([past(20), past(11), past(9), past(0)], [(180, true), (180, false), (81, true), (0, true)]);
    }

    #[test]
    fn only_what_repeats_to_the_bit_is_frozen() {
        let mut sight = Sight::default();
        let mut repeats = |noise_m: f32, times: usize| {
            let beams = scan_of(|i| Echo::Hit(2.0 + 0.01 * i as f32 + noise_m));
            let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
            (0..times).filter(|_| sight.is_frozen(&scan)).count()
        };
        assert_eq!((repeats(0.0, 10), repeats(0.001, 4), repeats(0.0, 6)), (6, 0, 2));
    }
}
