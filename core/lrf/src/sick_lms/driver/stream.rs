//! From the first scan to the last.

use super::{Ask, Dialogue};
use crate::dialogue::{MAX_BAD, State, departure, scan_wait, wire_time};
use crate::driver::Cause;
use crate::session::Session as _;
use crate::sick_lms::measurement::Measurement;
use crate::sick_lms::reply::{Reply, ReplyBody};
use crate::sick_lms::request::Variant;
use crate::sick_lms::scan::TURN;
use crate::sick_lms::telegram::OVERHEAD;
use lrfslam_scan::time::{Duration, Instant};

impl Dialogue<'_> {
    pub(super) fn begin_streaming(&mut self, now: Instant) {
        let period = self.scan_period();
        let first = scan_wait(period, Duration::from_millis(1500));
        self.pace.restart();
        self.base.begin_streaming(now, self.base.baud, period, first);
    }

    pub(super) fn on_stream(&mut self, now: Instant, reply: &Reply<'_>, length: usize) {
        match &reply.body {
            ReplyBody::Scan(measurement) => {
                self.judge(reply.status);
                self.on_scan(now, measurement, length);
            }
            ReplyBody::PowerOn(_) | ReplyBody::Reset => self.base.lose(now, Cause::Reset),
            _ => {}
        }
    }

    fn on_scan(&mut self, now: Instant, measurement: &Measurement<'_>, length: usize) {
        // A sensor that did not say its field of view shows it: each has another number of values.
        if let Some(variant) = Variant::with_values(measurement.len()).filter(|_| !self.variant_known) {
            (self.variant, self.variant_known) = (variant, true);
            if self.streams_turns() {
                return self.ask(now, Ask::StreamTurns);
            }
        }
        let Some(layout) = self.layout() else { return };
        let Ok(shape) = layout.read(measurement, self.memory.beams) else {
            return self.refuse(now);
        };
        self.keep_brightness(measurement);
        let left = departure(self.telegram_began, now, length + OVERHEAD, self.base.baud);
        let began = Instant::from_micros(left.micros - shape.sweep.micros);
        let is_late = self.is_late || now < self.late_until;
        if self.is_late {
            self.late_until = now + wire_time(length + OVERHEAD, self.base.baud);
        }
        let stamp = self.pace.stamp(began, is_late);
        let stamp = Instant::from_micros(stamp.micros - self.config.latency.micros);
        self.memory.keep(shape.beams, stamp, shape.range_max_m);
        self.base.publish(now, self.scan_period());
    }

    fn keep_brightness(&mut self, measurement: &Measurement<'_>) {
        let Some(levels) = measurement.brightness(self.measuring_mode) else { return };
        let Some(kept) = self.brightness.get_mut(..measurement.len()) else { return };
        kept.iter_mut().zip(levels).for_each(|(kept, level)| *kept = level);
        self.brightness_untold = kept.len();
    }

    /// A telegram whose sum is right, but whose content is not what was asked for.
    pub(super) fn refuse(&mut self, now: Instant) {
        self.base.count_refused();
        self.bad(now);
    }

    /// Takes note of telegrams that the decoder found damaged.
    pub(super) fn count_damaged(&mut self, now: Instant, damaged: u32) {
        if self.base.is_damage_new(damaged) {
            self.bad(now);
        }
    }

    fn bad(&mut self, now: Instant) {
        if self.base.state == State::Streaming {
            self.pace.gap();
            self.base.bad_scan(now, MAX_BAD);
        }
    }

    pub(super) fn streams_turns(&self) -> bool {
        let wire = wire_time(2 * usize::from(self.variant.values_of_turn(0)) + 4 + OVERHEAD, self.base.baud);
        let line_suffices = wire.micros < TURN.micros;
        self.config.each_turn && self.variant.turns() > 1 && !self.turns_refused && line_suffices
    }

    /// From one scan to the next: whole mirror turns, as many as the line needs.
    fn scan_period(&self) -> Duration {
        let (values, turns) = match self.streams_turns() {
            true => (self.variant.values_of_turn(0), 1),
            false => (self.variant.values(), i64::from(self.variant.turns())),
        };
        let wire = wire_time(2 * usize::from(values) + 4 + OVERHEAD, self.base.baud).micros;
        let unit = TURN.micros * turns;
        Duration::from_micros((wire / unit + 1) * unit)
    }
}
