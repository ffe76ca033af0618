//! Does a scan show anything? A covered laser measures its cover, and a frozen one repeats a scan to the bit, which no living one does.

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
    last: u32,
    repeats: u16,
}

impl Sight {
    /// True if `scan` shows nothing; `hits` are its hits and `eye` is the laser, robot frame.
    pub(super) fn is_blind(&mut self, scan: &RangeScan<'_>, hits: &[Point2], eye: Point2) -> bool {
        let print = fingerprint(scan);
        self.repeats = if print == self.last { self.repeats.saturating_add(1) } else { 0 };
        self.last = print;
        let far = hits.iter().filter(|hit| (**hit - eye).norm() > COVER_M).count();
        let is_covered = far < HITS_MIN.max(scan.beams.len() / BEAMS_PER_HIT);
        is_covered || self.repeats >= REPEATS_MAX
    }
}

fn fingerprint(scan: &RangeScan<'_>) -> u32 {
    scan.beams.iter().fold(FNV_OFFSET, |hash, beam| {
        let range = if let Echo::Hit(range_m) = beam.echo { range_m.to_bits() } else { 0 };
        (hash ^ range).wrapping_mul(FNV_PRIME)
    })
}
