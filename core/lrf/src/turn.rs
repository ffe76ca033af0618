//! Whole turns out of the samples of a laser that spins all the way round, at angles and times of their own.
//!
//! Turns are cut behind the sensor, so that ahead, where the robot goes, no scan begins or ends. These sensors turn
//! clockwise: bearings fall from π to −π, in the order of time.

use core::f32::consts::PI;

use lrfslam_scan::time::{Duration, Instant};
use lrfslam_scan::{Beam, Echo, RangeScan};

/// Samples of one packet at most.
pub const MAX_PACKET: usize = 40;
/// A gap wider than this is a lost packet, degrees.
const MAX_GAP_DEG: f32 = 12.0;
/// Angles may step back by this much: each is corrected on its own, degrees.
const MAX_BACKSTEP_DEG: f32 = 20.0;

/// One measured point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Clockwise from straight ahead, degrees; any turn.
    pub clockwise_deg: f32,
    /// When it was measured.
    pub at: Instant,
    /// What it says.
    pub echo: Echo,
}

/// Collects samples until a turn is complete. Lost or damaged packets spoil their turn, which is then not handed out.
#[derive(Debug)]
pub struct TurnAssembler<'a> {
    beams: &'a mut [Beam],
    len: usize,
    began: Instant,
    /// Degrees past the cut of the last sample.
    last_deg: f32,
    whole: bool,
    /// The turn in `beams` was handed out: begin the next.
    done: bool,
    carried: heapless::Vec<Sample, MAX_PACKET>,
    spoilt: u32,
}

impl<'a> TurnAssembler<'a> {
    /// An assembler for turns up to `beams.len()` samples.
    pub fn new(beams: &'a mut [Beam]) -> Self {
        Self {
            beams,
            len: 0,
            began: Instant::default(),
            last_deg: 0.0,
            whole: false,
            done: false,
            carried: heapless::Vec::new(),
            spoilt: 0,
        }
    }

    /// Adds the samples of one packet, in order, [`MAX_PACKET`] at most (further ones are lost); true if a whole turn is now
    /// in [`turn`](Self::turn), until the next call.
    pub fn add(&mut self, samples: impl Iterator<Item = Sample>) -> bool {
        self.begin_if_done();
        let mut samples = samples.take(MAX_PACKET);
        while let Some(sample) = samples.next() {
            let degrees = past_cut(sample.clockwise_deg);
            if degrees + 180.0 < self.last_deg {
                self.carried = core::iter::once(sample).chain(samples).collect();
                return self.complete();
            }
            self.store(sample, degrees);
        }
        false
    }

    /// A packet was lost or damaged: the running turn is not whole.
    pub fn spoil(&mut self) {
        self.begin_if_done();
        self.whole = false;
    }

    /// Forgets everything: the stream begins anew.
    pub fn forget(&mut self) {
        (self.len, self.whole, self.done, self.last_deg) = (0, false, false, 0.0);
        self.carried.clear();
    }

    /// Stamp and beams of the turn that [`add`](Self::add) completed.
    pub fn turn(&self) -> (Instant, &[Beam]) {
        (self.began, self.beams.get(..self.len).unwrap_or(&[]))
    }

    /// The same as a scan.
    ///
    /// * `latency` — subtracted from its stamp; `range_max_m` — ranges from here on are misses, m
    pub fn scan(&self, latency: Duration, range_max_m: f32) -> RangeScan<'_> {
        let (began, beams) = self.turn();
        RangeScan { stamp: Instant::from_micros(began.micros - latency.micros), range_max_m, beams }
    }

    /// Turns that were not whole, so far.
    pub fn spoilt(&self) -> u32 {
        self.spoilt
    }

    /// The turn has ended: true if it was whole.
    fn complete(&mut self) -> bool {
        self.done = true;
        let reaches_end = 360.0 - self.last_deg < MAX_GAP_DEG;
        let whole = self.whole && reaches_end && self.len > 0;
        if !whole && self.len > 0 {
            self.spoilt = self.spoilt.saturating_add(1);
        }
        whole
    }

    fn begin_if_done(&mut self) {
        if !self.done {
            return;
        }
        (self.done, self.len, self.last_deg, self.whole) = (false, 0, 0.0, true);
        for sample in core::mem::take(&mut self.carried) {
            self.store(sample, past_cut(sample.clockwise_deg));
        }
    }

    fn store(&mut self, sample: Sample, degrees: f32) {
        if self.len == 0 {
            self.began = sample.at;
        }
        let step = degrees - self.last_deg;
        let Some(beam) = self.beams.get_mut(self.len).filter(|_| (-MAX_BACKSTEP_DEG..MAX_GAP_DEG).contains(&step))
        else {
            self.whole = false;
            self.last_deg = degrees;
            return;
        };
        let bearing_rad = (PI - degrees.to_radians()).clamp(-PI, PI);
        *beam = Beam { bearing_rad, offset: sample.at.since(self.began), echo: sample.echo };
        self.len += 1;
        self.last_deg = self.last_deg.max(degrees);
    }
}

/// Degrees clockwise from straight behind, 0 to 360.
fn past_cut(clockwise_deg: f32) -> f32 {
    let turned = clockwise_deg + 180.0;
    let whole_turns = libm::floorf(turned / 360.0);
    turned - 360.0 * whole_turns
}

/// Time of sample `index` of `count`, if the last was measured at `end` and one takes `each`.
pub fn sample_time(end: Instant, index: usize, count: usize, each: Duration) -> Instant {
    let after = count.saturating_sub(index + 1) as i64;
    Instant::from_micros(end.micros - after * each.micros)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    /// Packets of ten samples, one every 2 degrees and every millisecond, from straight ahead on.
    fn packet(index: i64) -> impl Iterator<Item = Sample> {
        (0..10).map(move |sample| {
            let n = index * 10 + sample;
            Sample {
                clockwise_deg: (n * 2 % 360) as f32,
                at: Instant::from_micros(n * 1000),
                echo: Echo::Hit(1.0 + n as f32),
            }
        })
    }

    #[test]
    fn turns_begin_behind_and_lose_nothing() {
        let mut beams = [Beam::BLANK; 200];
        let mut assembler = TurnAssembler::new(&mut beams);
        let mut turns = Vec::new();
        for index in 0..60 {
            if assembler.add(packet(index)) {
                let (stamp, beams) = assembler.turn();
                turns.push((stamp.micros, beams.len(), beams[0], beams[90]));
            }
        }
        let (stamp, count, first, ahead) = turns[0];
        assert_eq!((stamp, count, turns.len()), (90_000, 180, 2));
        assert!((first.bearing_rad - PI).abs() < 1e-6 && first.offset == Duration::ZERO);
        assert!(ahead.bearing_rad.abs() < 1e-6 && ahead.offset.micros == 90_000);
        assert_eq!((first.echo, turns[1].0), (Echo::Hit(91.0), 270_000));
    }

    #[test]
    fn lost_packet_spoils_its_turn_only() {
        for spoil in [true, false] {
            let mut beams = [Beam::BLANK; 200];
            let mut assembler = TurnAssembler::new(&mut beams);
            let mut turns = 0;
            for index in 0..80 {
                match index {
                    20 if spoil => assembler.spoil(),
                    20 => {}
                    _ => turns += u32::from(assembler.add(packet(index))),
                }
            }
            assert_eq!((turns, assembler.spoilt()), (2, 2), "the first, which began ahead, and that with the gap");
        }
    }

    #[test]
    fn too_many_samples_are_no_turn() {
        let mut beams = [Beam::BLANK; 100];
        let mut assembler = TurnAssembler::new(&mut beams);
        assert!((0..60).all(|index| !assembler.add(packet(index))));
    }
}
