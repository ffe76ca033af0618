//! From the first sample to the last.

use super::{Ask, Dialogue, MAX_BAD, RANGE_MAX_M, SILENCE};
use crate::beat::BeatClock;
use crate::dialogue::{State, wire_time};
use crate::rplidar::response::{CAPSULE, Capsule, Measured, parse_sample};
use crate::turn::{Sample, sample_time};
use lrfslam_scan::Echo;
use lrfslam_scan::time::{Duration, Instant};

/// Half a turn of the fastest motor: after a longer loss nobody knows how often it turned meanwhile.
const HALF_A_TURN: Duration = Duration::from_millis(33);
/// After so many packets in a row that do not fit, a second's, the first one was no measure: no motor changes that fast.
const MISFITS: u8 = 100;
/// In the sample mode angles grow from one sample to the next, by no more than this; a little less for their errors, degrees.
const SAMPLE_STEP_DEG: core::ops::Range<f32> = -3.0..12.0;
/// A turn starts within this of straight ahead, degrees.
const START_DEG: f32 = 15.0;

impl Dialogue<'_> {
    pub(super) fn begin_streaming(&mut self, now: Instant, wait: Duration) {
        self.beat = None;
        self.finder = Default::default();
        self.last_sample_deg = None;
        (self.span_deg, self.misfits) = (0.0, 0);
        self.base.begin_streaming(now, self.base.baud, self.base.identity.turn, wait);
    }

    /// The samples of a packet lie between its start and that of the next.
    pub(super) fn on_capsule(&mut self, now: Instant, capsule: Capsule) {
        if self.base.state != State::Streaming {
            return;
        }
        self.base.bad_in_a_row = 0;
        self.base.wait(now, SILENCE);
        if capsule.starts() {
            self.turns.forget();
            self.previous = None;
        }
        let left = Instant::from_micros(now.micros - wire_time(CAPSULE, self.base.baud).micros);
        let end = self.packet_end(left);
        let pause = now.since(core::mem::replace(&mut self.packet_at, now));
        let previous = self.previous.replace(capsule.clone());
        if let Some(previous) = previous.filter(|previous| self.follows(previous, &capsule, pause)) {
            let measured = previous.samples(&capsule);
            let count = measured.len();
            let taken = end.since(self.previous_end).micros.clamp(0, 100_000);
            let each = Duration::from_micros(taken / count.max(1) as i64);
            // When a packet leaves the sensor, its last sample is taken; the samples read now are those of the one before.
            let end = self.previous_end;
            let samples = measured.into_iter().enumerate();
            self.publish(samples.map(|(index, measured)| sample(measured, sample_time(end, index, count, each))));
        } else if pause.micros > HALF_A_TURN.micros {
            self.turns.spoil();
        }
        self.previous_end = end;
    }

    /// False if packets between the two were lost without a trace: the sensor then has turned farther than it does from one to the next.
    /// After a pause it may have turned all the way round, so its angle must fit well.
    fn follows(&mut self, previous: &Capsule, capsule: &Capsule, pause: Duration) -> bool {
        let span_deg = previous.span_deg(capsule);
        let usual_deg = self.span_deg;
        let tolerance = if pause.micros > HALF_A_TURN.micros { 1.02 } else { 1.5 };
        let fits = usual_deg <= 0.0 || (usual_deg / tolerance..usual_deg * tolerance).contains(&span_deg);
        self.misfits = if fits { 0 } else { self.misfits.saturating_add(1) };
        // Losses say nothing of the speed: it is kept, so that several of them never make another one usual.
        if fits || self.misfits >= MISFITS {
            self.span_deg = span_deg;
        }
        fits
    }

    /// When the last sample of the packet that left then was taken: packets have a beat, which is to be found first.
    fn packet_end(&mut self, left: Instant) -> Instant {
        if let Some(beat) = &mut self.beat {
            return beat.stamp(left, 1);
        }
        self.beat = self.finder.hear(left).map(BeatClock::new);
        left
    }

    /// A sample of the old mode, whose two check bits are right. What else can be checked: angles grow, turns start ahead.
    pub(super) fn on_sample(&mut self, now: Instant, bytes: &[u8]) {
        let Some((measured, starts)) = parse_sample(bytes) else { return };
        self.base.wait(now, SILENCE);
        let degrees = measured.clockwise_deg;
        let step = self.last_sample_deg.replace(degrees).map_or(0.0, |last| {
            let step = degrees - last;
            if step < -180.0 { step + 360.0 } else { step }
        });
        let is_ahead = !(START_DEG..360.0 - START_DEG).contains(&degrees);
        if !SAMPLE_STEP_DEG.contains(&step) || (starts && !is_ahead) {
            // Either this one or the one before is wrong: the next shows where it goes on.
            self.last_sample_deg = None;
            self.turns.spoil();
            self.base.count_refused();
            return self.base.bad_scan(now, MAX_BAD);
        }
        self.publish(core::iter::once(sample(measured, now)));
    }

    fn publish(&mut self, samples: impl Iterator<Item = Sample>) {
        if self.turns.add(samples) {
            self.base.announce_scan();
        }
    }

    /// What was damaged leaves a hole; in the old mode, where damage may be anywhere before, it costs the turn.
    ///
    /// A sum of exclusive ors does not see bytes that have moved. A packet with a byte too many or too few passes it now and then, but then
    /// the next does not begin where it ends: so the packet before the damage is not read either.
    pub(super) fn on_damage(&mut self, now: Instant) {
        if self.base.state != State::Streaming {
            return;
        }
        if self.unchecked {
            self.turns.spoil();
            self.last_sample_deg = None;
        }
        self.previous = None;
        self.beat.iter_mut().for_each(BeatClock::gap);
        self.base.bad_scan(now, MAX_BAD);
    }

    /// No express mode: scans in the old way, and says so.
    pub(super) fn scan_unchecked(&mut self, now: Instant) {
        use crate::driver::{Cause, Step};
        use crate::session::Session as _;
        self.unchecked = true;
        self.base.warn(Step::Start, Cause::Unchecked, "");
        self.ask(now, Ask::Scan);
    }
}

fn sample(measured: Measured, at: Instant) -> Sample {
    let range_m = measured.distance_mm / 1000.0;
    // 0 is no measurement: it frees nothing.
    Sample { clockwise_deg: measured.clockwise_deg, at, echo: Echo::from_range(range_m, RANGE_MAX_M) }
}
