//! What the sessions of all families have in common: their state, their outputs in order, waiting, trouble, and what they count.
//!
//! A family keeps a [`DialogueBase`] and what is its own beside it; how a session goes from state to state is in [`session`](super::session).

use super::driver::{BaudPolicy, Counters, Event, Identity, NEVER, Output};
use super::trouble::{BaudRates, Cause, Step, Trouble};
use lrfslam_scan::time::{Duration, Instant};
use lrfslam_scan::{Beam, RangeScan};

/// Damaged scans in a row after which a session begins anew, where each is a message of its own.
pub(super) const MAX_BAD: u8 = 8;

/// Where a session is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum State<Ask> {
    /// No port, or stopped.
    #[default]
    Idle,
    /// Waiting before the next look for the sensor.
    BackOff,
    /// The line becomes quiet, or a new rate settles on both sides; then this is asked.
    Pausing(Ask),
    /// This was asked.
    Asking(Ask),
    Streaming,
}

/// What every session keeps.
#[derive(Debug, Default)]
pub(super) struct DialogueBase<Ask> {
    pub(super) state: State<Ask>,
    /// Times that the question may be asked again.
    pub(super) attempts_left: u8,
    pub(super) patience: Patience,
    pub(super) outbox: Outbox,
    pub(super) back_off: BackOff,
    pub(super) counters: Counters,
    pub(super) bad_in_a_row: u8,
    pub(super) damaged_before: u32,
    pub(super) identity: Identity,
    /// Of the last scan.
    pub(super) stamp: Option<Instant>,
    pub(super) rates: BaudRates,
    pub(super) rate_index: usize,
    pub(super) baud: u32,
    pub(super) last_good_baud: u32,
    pub(super) raise_failures: u8,
    /// To be stopped once what was asked is answered.
    pub(super) stop_wanted: bool,
}

impl<Ask: Copy + PartialEq> DialogueBase<Ask> {
    /// The next output; `scan` lends the scan that was announced.
    pub(super) fn poll_output<'a>(&'a mut self, scan: impl FnOnce() -> RangeScan<'a>) -> Output<'a> {
        let Some(pending) = self.outbox.pop() else { return Output::Timeout(self.patience.deadline) };
        Output::Event(match pending {
            Pending::Transmit(bytes) => return Output::Transmit(self.outbox.lend(bytes)),
            Pending::SetBaud(rate) => return Output::SetBaud(rate),
            Pending::Found(baud) => Event::Found { baud },
            Pending::Identified => Event::Identified(&self.identity),
            Pending::Streaming(baud, period) => Event::Streaming { baud, period },
            Pending::Trouble(trouble) => Event::Trouble(trouble),
            Pending::Stopped(laser_off) => Event::Stopped { laser_off },
            Pending::Scan => Event::Scan(self.in_order(scan())),
        })
    }

    /// Whatever was estimated anew between two scans: none is at or before the last.
    fn in_order<'a>(&mut self, scan: RangeScan<'a>) -> RangeScan<'a> {
        let after = |last: Instant| Instant::from_micros(last.micros.saturating_add(1));
        let stamp = self.stamp.map_or(scan.stamp, |last| scan.stamp.max(after(last)));
        self.stamp = Some(stamp);
        RangeScan { stamp, ..scan }
    }

    /// Counters, with `damaged` that the decoder has found, and turns that are `incomplete`.
    pub(super) fn counters(&self, damaged: u32, incomplete: u32) -> Counters {
        Counters { damaged: self.counters.damaged.saturating_add(damaged), incomplete, ..self.counters }
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

    /// True if the rate is to be changed, and that has not failed too often; a rate that is not among `all` is told, once.
    pub(super) fn wants_raise(&mut self, policy: BaudPolicy, all: &[u32]) -> bool {
        let is_wanted = policy.wants_change(self.baud) && self.raise_failures < 2;
        let exists = all.contains(&policy.wanted());
        if is_wanted && !exists {
            self.raise_failures = u8::MAX;
            self.warn(Step::RaiseBaud, Cause::NoSuchRate(policy.wanted()), "");
        }
        is_wanted && exists
    }

    /// The sensor goes to another rate: so does the port, then both sides settle before `verify` is asked.
    pub(super) fn change_rate(&mut self, now: Instant, baud: u32, settle: Duration, verify: Ask) {
        self.baud = baud;
        self.outbox.push(Pending::SetBaud(baud));
        self.state = State::Pausing(verify);
        self.wait(now, settle);
    }

    /// Scans are on their way, one every `period`; the first within `wait`.
    pub(super) fn begin_streaming(&mut self, now: Instant, baud: u32, period: Duration, wait: Duration) {
        self.state = State::Streaming;
        self.bad_in_a_row = 0;
        self.outbox.push(Pending::Streaming(baud, period));
        self.wait(now, wait);
    }

    /// A scan is whole; the next is to come within this `period`, or not much later.
    pub(super) fn publish(&mut self, now: Instant, period: Duration) {
        self.announce_scan();
        self.wait(now, scan_wait(period, Duration::from_millis(500)));
    }

    /// A scan is whole.
    pub(super) fn announce_scan(&mut self) {
        self.outbox.push(Pending::Scan);
        self.counters.scans = self.counters.scans.saturating_add(1);
        self.bad_in_a_row = 0;
        self.back_off.reset();
    }

    /// A scan or reply whose sum is right, but whose content is not what was asked for.
    pub(super) fn count_refused(&mut self) {
        self.counters.damaged = self.counters.damaged.saturating_add(1);
    }

    /// True if the decoder has found damage since the last call; `damaged` is its count.
    pub(super) fn is_damage_new(&mut self, damaged: u32) -> bool {
        core::mem::replace(&mut self.damaged_before, damaged) != damaged
    }

    /// A damaged scan: the session begins anew if it was the last of `most` in a row.
    pub(super) fn bad_scan(&mut self, now: Instant, most: u8) {
        self.bad_in_a_row = self.bad_in_a_row.saturating_add(1);
        if self.bad_in_a_row >= most {
            self.lose(now, Cause::Damaged);
        }
    }

    /// Waits this long, whatever comes.
    pub(super) fn wait(&mut self, now: Instant, wait: Duration) {
        self.patience = Patience::new(now, wait, wait);
    }

    /// Reports trouble with which the session can go on.
    pub(super) fn warn(&mut self, step: Step, cause: Cause, sent: &'static str) {
        self.report(step, cause, sent, Duration::ZERO);
    }

    /// Reports trouble after which the session begins anew, and waits before it does.
    // Called from everywhere: one copy of it saves a kilobyte of flash.
    #[inline(never)]
    pub(super) fn begin_anew(&mut self, now: Instant, step: Step, cause: Cause, sent: &'static str) {
        let retry_in = self.back_off.advance();
        self.report(step, cause, sent, retry_in);
        self.counters.restarts = self.counters.restarts.saturating_add(1);
        self.state = State::BackOff;
        self.wait(now, retry_in);
    }

    /// No more scans, or none of use: begins anew.
    pub(super) fn lose(&mut self, now: Instant, cause: Cause) {
        self.begin_anew(now, Step::Stream, cause, "");
    }

    fn report(&mut self, step: Step, cause: Cause, sent: &'static str, retry_in: Duration) {
        let tried = if step == Step::Find { self.rates } else { BaudRates::default() };
        self.outbox.push(Pending::Trouble(Trouble { step, cause, sent, tried, retry_in }));
    }

    /// The port is gone: waits for nothing.
    pub(super) fn unplugged(&mut self) {
        if self.state != State::Idle {
            self.warn(Step::Port, Cause::Unplugged, "");
            self.rest();
        }
    }

    /// It has stopped: waits for nothing.
    pub(super) fn stopped(&mut self, laser_off: bool) {
        self.stop_wanted = false;
        self.outbox.push(Pending::Stopped(laser_off));
        self.rest();
    }

    fn rest(&mut self) {
        self.state = State::Idle;
        self.patience = Patience::FOREVER;
    }
}

/// The last scan, in memory that the caller lends.
#[derive(Debug)]
pub(super) struct ScanMemory<'a> {
    pub(super) beams: &'a mut [Beam],
    len: usize,
    stamp: Instant,
    range_max_m: f32,
}

impl<'a> ScanMemory<'a> {
    pub(super) fn new(beams: &'a mut [Beam]) -> Self {
        Self { beams, len: 0, stamp: Instant::default(), range_max_m: 0.0 }
    }

    /// The first `len` beams are a scan; ranges from `range_max_m` on are misses, m.
    pub(super) fn keep(&mut self, len: usize, stamp: Instant, range_max_m: f32) {
        (self.len, self.stamp, self.range_max_m) = (len, stamp, range_max_m);
    }

    pub(super) fn scan(&self) -> RangeScan<'_> {
        let beams = self.beams.get(..self.len).unwrap_or(&[]);
        RangeScan { stamp: self.stamp, range_max_m: self.range_max_m, beams }
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

/// How long to wait for a scan that comes every `period`: three may be damaged before it is called silence.
pub(super) fn scan_wait(period: Duration, allowance: Duration) -> Duration {
    Duration::from_micros(4 * period.micros + allowance.micros)
}

/// When the first byte of a message of so many `bytes` left the sensor, of which one was first heard at `heard`, and the last `now`.
///
/// Both guesses are no earlier than the truth: reading late makes the first late, reading in pieces the second.
pub(super) fn departure(heard: Instant, now: Instant, bytes: usize, baud: u32) -> Instant {
    heard.min(Instant::from_micros(now.micros - wire_time(bytes, baud).micros))
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
