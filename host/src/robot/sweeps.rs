//! Scans put together from the parts in which a robot tells them.

use lrfslam_core::scan::{Beam, RangeScan};
use lrfslam_core::sweep::SweepMotion;
use lrfslam_core::time::Instant;
use lrfslam_robot::wire::sweep::SweepPart;

/// A scan that is told.
#[derive(Debug, Clone, PartialEq)]
pub struct ToldSweep {
    stamp: Instant,
    range_max_m: f32,
    /// How the robot moved while it was taken.
    pub motion: SweepMotion,
    beams: Vec<Beam>,
    is_complete: bool,
}

impl ToldSweep {
    /// The scan.
    pub fn scan(&self) -> RangeScan<'_> {
        RangeScan { stamp: self.stamp, range_max_m: self.range_max_m, beams: &self.beams }
    }
}

/// Scans that wait for a pose that does not come: more are not kept.
const WAITING_MAX: usize = 64;
/// Most beams of a scan.
const BEAMS_MAX: usize = 16_384;

/// Scans whose poses have not come yet.
#[derive(Debug, Clone, Default)]
pub struct Sweeps {
    waiting: Vec<ToldSweep>,
}

impl Sweeps {
    /// Takes a part.
    pub fn take_part(&mut self, part: &SweepPart<'_>) {
        if self.waiting.last().is_none_or(|last| last.is_complete || last.stamp != part.stamp) {
            let SweepPart { stamp, range_max_m, motion, .. } = *part;
            if self.waiting.len() >= WAITING_MAX {
                self.waiting.remove(0);
            }
            self.waiting.push(ToldSweep { stamp, range_max_m, motion, beams: Vec::new(), is_complete: false });
        }
        if let Some(last) = self.waiting.last_mut() {
            let room = BEAMS_MAX.saturating_sub(last.beams.len());
            last.beams.extend(part.beams().take(room));
            last.is_complete = part.is_last;
        }
    }

    /// The scan taken at `stamp`, if it was told; older ones are forgotten, their poses were lost.
    pub fn taken_at(&mut self, stamp: Instant) -> Option<ToldSweep> {
        let place = self.waiting.iter().position(|sweep| sweep.stamp == stamp && sweep.is_complete)?;
        self.waiting.drain(..=place).next_back()
    }
}
