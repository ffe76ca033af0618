//! Whole turns out of the samples of a laser that spins all the way round, at angles and times of their own.
//!
//! Turns are cut behind the sensor, so that ahead, where the robot goes, no scan begins or ends. These sensors turn
//! clockwise: bearings fall from π to −π, in the order of time, but for corrections of single angles.
//!
//! Where samples are missing a turn has beams without a measurement; one with too many of them is not handed out.

use core::f32::consts::PI;

use lrfslam_scan::time::{Duration, Instant};
use lrfslam_scan::{Beam, Echo, RangeScan};

/// Samples of one packet at most.
pub const MAX_PACKET: usize = 40;
/// A turn that misses more than this, in all, is none, degrees.
const MAX_MISSING_DEG: f32 = 120.0;
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

/// Collects samples until a turn is complete.
#[derive(Debug)]
pub struct TurnAssembler<'a> {
    beams: &'a mut [Beam],
    /// A step wider than this is a hole, degrees.
    hole_deg: f32,
    len: usize,
    began: Instant,
    /// Degrees past the cut, and time, of the last sample.
    last_deg: f32,
    last_at: Instant,
    /// The usual step, degrees.
    step_deg: f32,
    missing_deg: f32,
    whole: bool,
    /// It began behind, where turns begin.
    from_cut: bool,
    /// The turn in `beams` was handed out: begin the next.
    done: bool,
    carried: heapless::Vec<Sample, MAX_PACKET>,
    incomplete: u32,
}

impl<'a> TurnAssembler<'a> {
    /// An assembler for turns up to `beams.len()` samples.
    ///
    /// * `hole_deg` — more than the widest step between samples, less than what a lost packet leaves
    pub fn new(beams: &'a mut [Beam], hole_deg: f32) -> Self {
        Self {
            beams,
            hole_deg,
            len: 0,
            began: Instant::default(),
            last_deg: 0.0,
            last_at: Instant::default(),
            step_deg: 1.0,
            missing_deg: 0.0,
            whole: false,
            from_cut: false,
            done: false,
            carried: heapless::Vec::new(),
            incomplete: 0,
        }
    }

    /// Adds the samples of one packet, in order, [`MAX_PACKET`] at most (further ones are lost); true if a turn is now in
    /// [`turn`](Self::turn), until the next call.
    pub fn add(&mut self, samples: impl Iterator<Item = Sample>) -> bool {
        self.begin_if_done();
        let mut samples = samples.take(MAX_PACKET);
        while let Some(sample) = samples.next() {
            let degrees = past_cut(sample.clockwise_deg);
            if degrees + 180.0 < self.last_deg {
                self.fill_hole(degrees + 360.0, sample.at, 360.0);
                self.carried = core::iter::once(sample).chain(samples).collect();
                return self.complete();
            }
            self.store(sample);
        }
        false
    }

    /// So much was lost that nobody knows how often it turned meanwhile: the running turn is none.
    pub fn spoil(&mut self) {
        self.begin_if_done();
        self.whole = false;
    }

    /// Forgets everything: the stream begins anew.
    pub fn forget(&mut self) {
        (self.len, self.whole, self.from_cut, self.done, self.last_deg) = (0, false, false, false, 0.0);
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

    /// Turns with holes, and turns that were not handed out, so far. That in which the stream began is not counted.
    pub fn incomplete(&self) -> u32 {
        self.incomplete
    }

    /// The turn has ended: true if it is one.
    fn complete(&mut self) -> bool {
        self.done = true;
        let is_turn = self.whole && self.missing_deg <= MAX_MISSING_DEG && self.len > 0;
        if self.from_cut && (!is_turn || self.missing_deg > 0.0) {
            self.incomplete = self.incomplete.saturating_add(1);
        }
        is_turn
    }

    fn begin_if_done(&mut self) {
        if !self.done {
            return;
        }
        (self.done, self.len, self.whole, self.from_cut) = (false, 0, true, true);
        (self.last_deg, self.missing_deg) = (self.last_deg - 360.0, 0.0);
        for sample in core::mem::take(&mut self.carried) {
            self.store(sample);
        }
    }

    fn store(&mut self, sample: Sample) {
        let mut degrees = past_cut(sample.clockwise_deg);
        // A correction took it back over the cut.
        if degrees > 360.0 - MAX_BACKSTEP_DEG && self.last_deg < MAX_BACKSTEP_DEG && self.whole {
            degrees -= 360.0;
        }
        let step = degrees - self.last_deg;
        if step < -MAX_BACKSTEP_DEG {
            self.whole = false;
            self.last_deg = degrees;
        }
        self.fill_hole(degrees, sample.at, 360.0);
        if (0.0..self.hole_deg).contains(&step) {
            self.step_deg += 0.1 * (step - self.step_deg);
        }
        self.push(degrees, sample.at, sample.echo);
        self.last_deg = self.last_deg.max(degrees);
        self.last_at = sample.at;
    }

    /// Beams without a measurement between the last sample and the next one, up to `end_deg`, if they are a hole apart.
    fn fill_hole(&mut self, next_deg: f32, next_at: Instant, end_deg: f32) {
        let (from_deg, gap_deg) = (self.last_deg, next_deg - self.last_deg);
        if !self.whole || gap_deg < self.hole_deg {
            return;
        }
        self.missing_deg += next_deg.min(end_deg) - from_deg.max(0.0);
        let (from_at, count) = (self.last_at, libm::roundf(gap_deg / self.step_deg.max(0.05)) as i64);
        let took = next_at.since(from_at).micros.max(0);
        for index in 1..count {
            let degrees = from_deg + gap_deg * index as f32 / count as f32;
            if (0.0..end_deg).contains(&degrees) {
                let at = Instant::from_micros(from_at.micros + took * index / count);
                self.push(degrees, at, Echo::Invalid);
            }
        }
    }

    fn push(&mut self, degrees: f32, at: Instant, echo: Echo) {
        if self.len == 0 {
            self.began = at;
        }
        let Some(beam) = self.beams.get_mut(self.len) else {
            self.whole = false;
            return;
        };
        *beam = Beam { bearing_rad: bearing_rad(degrees), offset: at.since(self.began), echo };
        self.len += 1;
    }
}

/// Degrees clockwise from straight behind, 0 to 360.
fn past_cut(clockwise_deg: f32) -> f32 {
    let turned = clockwise_deg + 180.0;
    let whole_turns = libm::floorf(turned / 360.0);
    turned - 360.0 * whole_turns
}

/// Bearing of an angle past the cut; one before it looks to the other side of straight behind.
fn bearing_rad(past_cut_deg: f32) -> f32 {
    let bearing_deg = 180.0 - past_cut_deg;
    (if bearing_deg > 180.0 { bearing_deg - 360.0 } else { bearing_deg }).to_radians().clamp(-PI, PI)
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
        let mut assembler = TurnAssembler::new(&mut beams, 5.0);
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

    /// Beams and beams without a measurement of the turns of 80 packets without those in `lost`.
    fn turns_without(lost: core::ops::Range<i64>) -> (Vec<(usize, usize)>, u32) {
        let mut beams = [Beam::BLANK; 200];
        let mut assembler = TurnAssembler::new(&mut beams, 5.0);
        let mut turns = Vec::new();
        for index in (0..80).filter(|index| !lost.contains(index)) {
            if assembler.add(packet(index)) {
                let (_, beams) = assembler.turn();
                turns.push((beams.len(), beams.iter().filter(|beam| beam.echo == Echo::Invalid).count()));
                assert!(beams.windows(2).all(|pair| pair[0].bearing_rad > pair[1].bearing_rad));
                assert!(beams.windows(2).all(|pair| pair[0].offset < pair[1].offset));
            }
        }
        (turns, assembler.incomplete())
    }

    #[test]
    fn lost_packet_is_a_hole_without_a_measurement() {
        assert_eq!(turns_without(0..0), (vec![(180, 0); 3], 0));
        let (turns, incomplete) = turns_without(30..31);
        assert_eq!((turns[0].0 / 2, turns[1], turns[2], incomplete), (90, (180, 10), (180, 0), 1));
    }

    #[test]
    fn hole_over_the_cut_is_in_both_turns() {
        let (turns, incomplete) = turns_without(26..28);
        let holes: Vec<usize> = turns.iter().map(|turn| turn.1).collect();
        assert_eq!((holes.iter().sum::<usize>(), holes[0] > 0 && holes[1] > 0, incomplete), (20, true, 2), "{turns:?}");
    }

    #[test]
    fn too_wide_a_hole_costs_the_turn() {
        let (turns, incomplete) = turns_without(30..37);
        assert_eq!((turns.len(), incomplete), (2, 1));
    }

    /// Corrections may take single angles back over the cut.
    #[test]
    fn turns_are_whole_however_angles_are_corrected() {
        let mut beams = [Beam::BLANK; 200];
        let mut assembler = TurnAssembler::new(&mut beams, 12.0);
        let corrected = |sample: Sample| {
            let n = sample.at.micros / 1000;
            let correction_deg = ((n * 7919) % 60) as f32 / 8.0;
            Sample { clockwise_deg: sample.clockwise_deg - correction_deg, ..sample }
        };
        let turns = (0..200).filter(|index| assembler.add(packet(*index).map(corrected))).count();
        assert_eq!((turns, assembler.incomplete()), (10, 0));
    }

    #[test]
    fn too_many_samples_are_no_turn() {
        let mut beams = [Beam::BLANK; 100];
        let mut assembler = TurnAssembler::new(&mut beams, 5.0);
        assert!((0..60).all(|index| !assembler.add(packet(index))));
    }
}
