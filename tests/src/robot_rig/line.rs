//! The line between robot and host, one direction of it: slow, and as bad as it is told to be.

use std::collections::VecDeque;

use lrfslam_core::math::uniform;
use lrfslam_core::random::RandomStream;
use lrfslam_core::time::{Duration, Instant};
use rand_core::Rng as _;

/// Rate, bytes a second: 921,600 baud.
const BYTES_PER_SECOND: i64 = 92_160;
/// Bytes that the sender's end holds.
const BUFFER: usize = 4096;

/// Chance of each fault per frame, 0–1.
#[derive(Debug, Clone, Copy, Default)]
pub struct LineFaults {
    /// One bit is flipped.
    pub flip: f32,
    /// One byte is missing.
    pub lose_byte: f32,
    /// One byte comes twice.
    pub double_byte: f32,
    /// All of it is missing.
    pub lose: f32,
    /// It comes twice.
    pub double: f32,
}

impl LineFaults {
    /// Everything, each with this chance.
    pub fn all(chance: f32) -> Self {
        Self { flip: chance, lose_byte: chance, double_byte: chance, lose: chance, double: chance }
    }
}

/// See the [module](self).
pub(super) struct Line {
    faults: LineFaults,
    rng: RandomStream,
    under_way: VecDeque<(Instant, Vec<u8>)>,
    free_at: Instant,
    /// Faults so far.
    pub(super) struck: u32,
}

impl Line {
    pub(super) fn new(faults: LineFaults, seed: u64) -> Self {
        let rng = RandomStream::new(seed, 0, 0);
        Self { faults, rng, under_way: VecDeque::new(), free_at: Instant::default(), struck: 0 }
    }

    fn strikes(&mut self, chance: f32) -> bool {
        let strikes = uniform(&mut self.rng) < chance;
        self.struck += u32::from(strikes);
        strikes
    }

    pub(super) fn send(&mut self, now: Instant, frame: &[u8]) {
        let LineFaults { flip, lose_byte, double_byte, lose, double } = self.faults;
        let mut bytes = frame.to_vec();
        let at = |rng: &mut RandomStream, length: usize| rng.next_u32() as usize % length.max(1);
        if self.strikes(flip) {
            let place = at(&mut self.rng, bytes.len());
            bytes[place] ^= 1 << (self.rng.next_u32() % 8);
        }
        if self.strikes(lose_byte) {
            let place = at(&mut self.rng, bytes.len());
            bytes.remove(place);
        }
        if self.strikes(double_byte) {
            let place = at(&mut self.rng, bytes.len());
            bytes.insert(place, bytes[place]);
        }
        let copies = 1 + usize::from(self.strikes(double));
        if self.strikes(lose) {
            return;
        }
        for _ in 0..copies {
            let took = Duration::from_micros(bytes.len() as i64 * 1_000_000 / BYTES_PER_SECOND);
            self.free_at = self.free_at.max(now) + took;
            self.under_way.push_back((self.free_at, bytes.clone()));
        }
    }

    pub(super) fn room(&self) -> usize {
        BUFFER.saturating_sub(self.under_way.iter().map(|(_, bytes)| bytes.len()).sum())
    }

    pub(super) fn arrived(&mut self, now: Instant) -> Option<Vec<u8>> {
        let (at, _) = self.under_way.front()?;
        if *at <= now { self.under_way.pop_front().map(|(_, bytes)| bytes) } else { None }
    }

    pub(super) fn next_arrival(&self) -> Option<Instant> {
        self.under_way.front().map(|(at, _)| *at)
    }
}
