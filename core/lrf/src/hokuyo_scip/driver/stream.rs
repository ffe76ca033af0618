//! From the first scan to the last.

use super::{Ask, Dialogue};
use crate::clock::Stamp;
use crate::dialogue::{MAX_BAD, State, departure, scan_wait, wire_time};
use crate::driver::{Cause, Step};
use crate::hokuyo_scip::reply::{BLOCK, Reply, Status};
use crate::hokuyo_scip::scan::read_scan;
use lrfslam_scan::time::{Duration, Instant};

/// Characters of an `Mx` echo whose last two count down.
const STREAM_ECHO: usize = 15;

impl Dialogue<'_> {
    pub(super) fn begin_streaming(&mut self, now: Instant) {
        let period = self.scan_period();
        let first = scan_wait(period, Duration::from_millis(1500));
        self.base.begin_streaming(now, self.line_baud(), period, first);
    }

    /// A frame while scans are expected.
    pub(super) fn on_scan_frame(&mut self, now: Instant, frame: &[u8]) {
        let command = self.command(Ask::Stream).emit();
        match Reply::find(frame, &command, STREAM_ECHO) {
            Ok(reply) if reply.status == Status::SCAN => self.on_scan(now, &reply),
            Ok(reply) if reply.status.is_hardware_fault() => self.report_fault(reply.status),
            // The start's own reply again, or "resumed".
            Ok(_) => {}
            Err(_) => self.refuse(now),
        }
    }

    pub(super) fn on_scan(&mut self, now: Instant, reply: &Reply<'_>) {
        if self.base.state != State::Streaming {
            self.begin_streaming(now);
        }
        let Some(parameters) = &self.parameters else { return };
        let Ok(header) = read_scan(reply, parameters, &self.acquire, self.memory.beams) else {
            return self.refuse(now);
        };
        let transit = parameters.step_time(self.acquire.last);
        let stamp_ms = match self.stamps.unwrap(header.stamp_ms) {
            Stamp::At(stamp_ms) => stamp_ms,
            Stamp::Reset => return self.base.lose(now, Cause::Reset),
            Stamp::Stuck => return self.base.lose(now, Cause::StuckClock),
        };
        let left = departure(self.frame_began, now, self.scan_bytes(), self.line_baud());
        let stamp = self.offset.stamp(left, stamp_ms, transit);
        let stamp = Instant::from_micros(stamp.micros - self.config.latency.micros);
        self.memory.keep(header.beams, stamp, self.base.identity.range_max_m);
        self.base.publish(now, self.scan_period());
    }

    fn refuse(&mut self, now: Instant) {
        self.base.count_refused();
        self.base.bad_scan(now, MAX_BAD);
    }

    fn report_fault(&mut self, status: Status) {
        self.base.warn(Step::Stream, Cause::HardwareFault(status.bytes()), "");
    }

    /// Bytes of a scan on the wire.
    ///
    /// Source: manual; echo, status, stamp, then lines of 64 characters, each with sum and line feed.
    fn scan_bytes(&self) -> usize {
        let characters = usize::from(self.acquire.value_counts().1) * self.acquire.encoding.width();
        STREAM_ECHO + 1 + 4 + 6 + characters + 2 * characters.div_ceil(BLOCK) + 1
    }

    /// From one scan to the next: whole turns, as many as the line needs.
    fn scan_period(&self) -> Duration {
        let turn = self.base.identity.turn.micros.max(1);
        let wire = wire_time(self.scan_bytes(), self.line_baud()).micros;
        let turns = (wire / turn + 1).max(i64::from(self.config.interval) + 1);
        Duration::from_micros(turns * turn)
    }
}
