//! What the sessions of all families have in common: their outputs in order, waiting, trouble, and what they count.
//!
//! A driver keeps a [`DialogueBase`] and its own state machine beside it: the base reports and sets deadlines, the machine goes on from them.

use super::driver::{Counters, Event, Identity, NEVER, Output};
use super::trouble::{BaudRates, Cause, Step, Trouble};
use lrfslam_scan::RangeScan;
use lrfslam_scan::time::{Duration, Instant};

/// What every session keeps.
#[derive(Debug, Default)]
pub(super) struct DialogueBase {
    pub(super) patience: Patience,
    pub(super) outbox: Outbox,
    pub(super) back_off: BackOff,
    pub(super) counters: Counters,
    pub(super) identity: Identity,
    pub(super) rates: BaudRates,
    pub(super) rate_index: usize,
    pub(super) baud: u32,
    pub(super) last_good_baud: u32,
}

impl DialogueBase {
    /// The next output; `scan` lends the scan that was announced.
    pub(super) fn poll_output<'a>(&'a mut self, scan: impl FnOnce() -> RangeScan<'a>) -> Output<'a> {
        let Some(pending) = self.outbox.pop() else {
            return Output::Timeout(self.patience.deadline);
        };
        Output::Event(match pending {
            Pending::Transmit(bytes) => return Output::Transmit(self.outbox.lend(bytes)),
            Pending::SetBaud(rate) => return Output::SetBaud(rate),
            Pending::Found(baud) => Event::Found { baud },
            Pending::Identified => Event::Identified(&self.identity),
            Pending::Streaming(baud, period) => Event::Streaming { baud, period },
            Pending::Trouble(trouble) => Event::Trouble(trouble),
            Pending::Stopped(laser_off) => Event::Stopped { laser_off },
            Pending::Scan => Event::Scan(scan()),
        })
    }

    /// Counters, with `damaged` that the decoder has found.
    pub(super) fn counters(&self, damaged: u32) -> Counters {
        Counters { damaged: self.counters.damaged.saturating_add(damaged), ..self.counters }
    }

    /// Sets the port to the rate whose turn it is, if the link has rates.
    pub(super) fn set_rate(&mut self) {
        if let Some(rate) = self.rates.get(self.rate_index) {
            self.baud = rate;
            self.outbox.push(Pending::SetBaud(rate));
        }
    }

    /// The sensor answers at this rate.
    pub(super) fn found(&mut self) {
        self.last_good_baud = self.baud;
        self.outbox.push(Pending::Found(self.baud));
    }

    /// A scan is whole.
    pub(super) fn announce_scan(&mut self) {
        self.outbox.push(Pending::Scan);
        self.counters.scans = self.counters.scans.saturating_add(1);
        self.back_off.reset();
    }

    /// Reports trouble with which the session can go on.
    pub(super) fn warn(&mut self, step: Step, cause: Cause, sent: &'static str) {
        self.report(step, cause, sent, Duration::ZERO);
    }

    /// Reports trouble after which the session begins anew, and waits before it does.
    pub(super) fn begin_anew(&mut self, now: Instant, step: Step, cause: Cause, sent: &'static str) {
        let retry_in = self.back_off.advance();
        self.report(step, cause, sent, retry_in);
        self.counters.restarts = self.counters.restarts.saturating_add(1);
        self.patience = Patience::new(now, retry_in, retry_in);
    }

    fn report(&mut self, step: Step, cause: Cause, sent: &'static str, retry_in: Duration) {
        let tried = if step == Step::Find { self.rates } else { BaudRates::default() };
        self.outbox.push(Pending::Trouble(Trouble { step, cause, sent, tried, retry_in }));
    }

    /// The port is gone: waits for nothing.
    pub(super) fn unplugged(&mut self) {
        self.warn(Step::Port, Cause::Unplugged, "");
        self.patience = Patience::FOREVER;
    }

    /// It has stopped: waits for nothing.
    pub(super) fn stopped(&mut self, laser_off: bool) {
        self.outbox.push(Pending::Stopped(laser_off));
        self.patience = Patience::FOREVER;
    }
}

/// Longest message a driver sends.
const MAX_TRANSMIT: usize = 48;

/// An output in waiting; scans and identities stay where they are, only their turn is kept.
#[derive(Debug)]
pub(super) enum Pending {
    Transmit(heapless::Vec<u8, MAX_TRANSMIT>),
    SetBaud(u32),
    Found(u32),
    Identified,
    Streaming(u32, Duration),
    Scan,
    Trouble(Trouble),
    Stopped(bool),
}

/// Outputs in order. One input leads to a handful; the queue holds twice what any state puts in.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    queue: heapless::Deque<Pending, 12>,
    sent: heapless::Vec<u8, MAX_TRANSMIT>,
}

impl Outbox {
    pub(super) fn push(&mut self, output: Pending) {
        debug_assert!(!self.queue.is_full(), "a state puts in more than the queue holds");
        let _ = self.queue.push_back(output);
    }

    pub(super) fn transmit(&mut self, bytes: &[u8]) {
        self.push(Pending::Transmit(heapless::Vec::from_slice(bytes).unwrap_or_default()));
    }

    pub(super) fn is_empty(&self) -> bool {
        self.queue.is_empty()
    }

    pub(super) fn pop(&mut self) -> Option<Pending> {
        self.queue.pop_front()
    }

    /// Keeps the bytes of a transmission while they are lent out.
    pub(super) fn lend(&mut self, bytes: heapless::Vec<u8, MAX_TRANSMIT>) -> &[u8] {
        self.sent = bytes;
        &self.sent
    }
}

/// Waiting times between attempts: none at first, then doubling up to a limit.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct BackOff {
    next: Duration,
}

impl BackOff {
    const FIRST: Duration = Duration::from_millis(100);
    const LONGEST: Duration = Duration::from_millis(2000);

    pub(super) fn advance(&mut self) -> Duration {
        let wait = self.next;
        let doubled = Duration::from_micros(wait.micros * 2).clamp(Self::FIRST, Self::LONGEST);
        self.next = doubled;
        wait
    }

    pub(super) fn reset(&mut self) {
        self.next = Duration::ZERO;
    }
}

/// A deadline that activity on the line may put off, up to a limit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patience {
    pub(super) deadline: Instant,
    limit: Instant,
}

impl Default for Patience {
    fn default() -> Self {
        Self::FOREVER
    }
}

impl Patience {
    pub(super) const FOREVER: Self = Self { deadline: NEVER, limit: NEVER };

    pub(super) fn new(now: Instant, wait: Duration, at_most: Duration) -> Self {
        Self { deadline: now + wait, limit: now + at_most }
    }

    /// Something came: wait at least `gap` from now, if the limit allows.
    pub(super) fn put_off(&mut self, now: Instant, gap: Duration) {
        self.deadline = self.deadline.max(now + gap).min(self.limit);
    }

    pub(super) fn is_over(&self, now: Instant) -> bool {
        now >= self.deadline
    }
}

/// Time that `bytes` take on a line of `baud`, 10 bits a byte; nothing on links without a rate.
pub(super) fn wire_time(bytes: usize, baud: u32) -> Duration {
    if baud == 0 {
        return Duration::ZERO;
    }
    Duration::from_micros(bytes as i64 * 10_000_000 / i64::from(baud))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn back_off_doubles_to_its_limit() {
        let mut back_off = BackOff::default();
        let waits: [i64; 7] = core::array::from_fn(|_| back_off.advance().micros / 1000);
        assert_eq!(waits, [0, 100, 200, 400, 800, 1600, 2000]);
    }
}
