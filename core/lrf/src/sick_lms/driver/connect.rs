//! From an open port to a sensor that answers.

use super::{Ask, Dialogue};
use crate::dialogue::{DialogueBase, Patience, State, wire_time};
use crate::driver::{BaudRates, Cause, Step};
use crate::session::{Question as _, Session};
use crate::sick_lms::reply::{DeviceStatus, ModeResult, Reply, ReplyBody};
use crate::sick_lms::telegram::MAX_TELEGRAM;
use lrfslam_scan::time::{Duration, Instant};

/// Rates in the order of their likelihood: power-up, the fastest on RS-232, on RS-422, bit/s.
pub const RATES: [u32; 4] = [9_600, 38_400, 500_000, 19_200];

impl Session for Dialogue<'_> {
    type Ask = Ask;

    fn base(&mut self) -> &mut DialogueBase<Ask> {
        &mut self.base
    }

    fn forget(&mut self) -> BaudRates {
        self.turns_refused = false;
        self.variant_known = false;
        self.fault_reported = false;
        self.config.baud.rates(self.base.last_good_baud, &RATES)
    }

    fn look(&mut self, now: Instant) {
        self.base.set_rate();
        self.ask(now, Ask::Quiet);
    }

    fn changes_rate(&self, ask: Ask) -> bool {
        ask == Ask::Rate
    }

    fn attempts(&self, ask: Ask) -> u8 {
        match ask {
            // The first may complete half a telegram in the sensor's buffer and be lost with it.
            Ask::Quiet | Ask::SetConfig => 1,
            // Without it nobody knows which beams a scan has.
            Ask::Status => 4,
            _ => 2,
        }
    }

    /// A wrong rate makes much noise and no telegram.
    fn is_hopeless(&self, ask: Ask) -> bool {
        ask == Ask::Quiet && self.noise > 60 && !self.heard_scan
    }

    fn send(&mut self, now: Instant, ask: Ask) {
        let telegram = self.request(ask).emit();
        self.base.outbox.transmit(&telegram);
        (self.noise, self.heard_scan) = (0, false);
        let (wait, at_most) = ask.waits();
        let at_most = match ask {
            Ask::Quiet => Duration::from_micros(wait.micros + 2 * self.longest_telegram().micros),
            _ => at_most,
        };
        self.base.patience = Patience::new(now, wait, at_most);
    }

    fn on_no_reply(&mut self, now: Instant, ask: Ask) {
        match ask {
            Ask::Quiet => self.try_next_rate(now),
            // Not every firmware knows these.
            Ask::Type => self.ask(now, Ask::Status),
            Ask::Status => self.ask(now, Ask::Config),
            Ask::Config => self.after_config(now),
            Ask::StreamTurns => self.without_turns(now),
            Ask::Stop => self.base.stopped(false),
            _ => self.fail(now, ask, Cause::NoReply),
        }
    }
}

impl Dialogue<'_> {
    /// Bytes, perhaps of a long telegram: wait for its end. At a wrong rate there is no end of bytes, so there is a limit.
    pub(super) fn on_bytes(&mut self, now: Instant, count: usize) {
        self.noise = self.noise.saturating_add(count as u32);
        if let State::Asking(_) = self.base.state {
            self.base.patience.put_off(now, self.longest_telegram());
        }
    }

    /// Time on the wire of the longest telegram, and a little.
    pub(super) fn longest_telegram(&self) -> Duration {
        Duration::from_micros(100_000 + wire_time(MAX_TELEGRAM, self.base.baud).micros)
    }

    /// The sensor took the request; a change of mode may take 3 s.
    pub(super) fn on_ack(&mut self, now: Instant) {
        if let State::Asking(_) = self.base.state {
            // In garbage any byte may look like an ACK: the limit holds.
            self.base.patience.put_off(now, Duration::from_millis(1000));
        }
    }

    /// The sensor could not read the request: send it again at once.
    pub(super) fn on_nak(&mut self, now: Instant) {
        if let State::Asking(ask) = self.base.state
            && ask != Ask::Quiet
        {
            self.ask_again(now, ask);
        }
    }

    pub(super) fn on_reply(&mut self, now: Instant, ask: Ask, reply: &Reply<'_>, length: usize) {
        match (ask, &reply.body) {
            (_, ReplyBody::PowerOn(_)) => self.on_power_on(now, ask),
            // The stream goes on for a while after it was stopped.
            (Ask::StreamTurns | Ask::StreamAll, ReplyBody::Scan(_)) => {
                self.begin_streaming(now);
                self.on_stream(now, reply, length);
            }
            (Ask::Quiet | Ask::Stop, ReplyBody::Scan(_)) => self.on_late_scan(now),
            (_, ReplyBody::Scan(_)) => {}
            (Ask::Quiet, ReplyBody::Mode(_) | ReplyBody::Refused) => {
                self.base.found();
                self.ask(now, Ask::Type);
            }
            (Ask::Stop, ReplyBody::Mode(ModeResult::Done)) => self.base.stopped(true),
            (_, ReplyBody::Refused) => self.on_refused(now, ask, Cause::Refused([0x92, 0])),
            _ => self.on_setup_reply(now, ask, reply),
        }
    }

    /// It streams, so the rate is right: a change of mode may take 3 s.
    fn on_late_scan(&mut self, now: Instant) {
        if !self.heard_scan {
            self.heard_scan = true;
            self.base.wait(now, Duration::from_millis(3000));
        }
    }

    /// It has just been switched on: whatever was set is gone.
    fn on_power_on(&mut self, now: Instant, ask: Ask) {
        match ask {
            Ask::Quiet => self.send(now, ask),
            Ask::Stop => self.base.stopped(true),
            _ => self.base.begin_anew(now, ask.step(), Cause::Reset, ""),
        }
    }

    /// Reports a fault that a sensor states in its status byte, once.
    pub(super) fn judge(&mut self, status: DeviceStatus) {
        if status.severity() < 3 {
            self.fault_reported = false;
        } else if !self.fault_reported {
            self.fault_reported = true;
            self.base.warn(Step::Stream, Cause::FaultCode(u16::from(status.0)), "");
        }
    }
}
