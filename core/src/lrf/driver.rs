//! What every laser range finder's driver has in common: the contract with the one that runs it.
//!
//! # Contract
//! Give one input, then drain [`poll_output`](LrfDriver::poll_output) until it answers [`Output::Timeout`]; only then the
//! next input. [`Input::Bytes`] may be taken in part: drain, then give the rest ([`run_bytes`] does both). Extra calls do
//! no harm. A driver never blocks, reads no clock and keeps no thread: the same inputs at the same instants give the same
//! outputs, so a recording of the inputs replays exactly.

pub use super::trouble::{BaudRates, Cause, MAX_BAUD_RATES, Step, Trouble};
use crate::scan::RangeScan;
use crate::time::{Duration, Instant};

/// What happened in the world.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Input<'a> {
    /// The port is open (again).
    Connected,
    /// The port is gone.
    Disconnected,
    /// Bytes arrived.
    Bytes(&'a [u8]),
    /// The instant of the last [`Output::Timeout`] has come.
    Timeout,
    /// Stop, and switch the laser off; ends with [`Event::Stopped`].
    Stop,
}

/// What is to be done.
#[derive(Debug, Clone, Copy)]
pub enum Output<'a> {
    /// Send these bytes.
    Transmit(&'a [u8]),
    /// Set the port to this rate, bit/s, after all bytes given before are out.
    SetBaud(u32),
    /// Tell the user.
    Event(Event<'a>),
    /// Nothing more; give [`Input::Timeout`] at this instant. [`NEVER`] if there is nothing to wait for.
    Timeout(Instant),
}

/// The deadline of a driver that waits for nothing.
pub const NEVER: Instant = Instant::from_micros(i64::MAX);

/// What the user may want to know.
#[derive(Debug, Clone, Copy)]
pub enum Event<'a> {
    /// The sensor answers at this rate, bit/s (0 on links without one).
    Found {
        /// Rate, bit/s.
        baud: u32,
    },
    /// What the sensor says of itself.
    Identified(&'a Identity),
    /// Scans are on their way.
    Streaming {
        /// Rate, bit/s (0 on links without one).
        baud: u32,
        /// From one scan to the next if the line is fast enough.
        period: Duration,
    },
    /// A scan, whole and verified.
    Scan(RangeScan<'a>),
    /// Something failed; the driver goes on by itself.
    Trouble(Trouble),
    /// It has stopped. `laser_off` is false if the sensor did not confirm.
    Stopped {
        /// The sensor confirmed.
        laser_off: bool,
    },
}

/// What a sensor says of itself; texts are cut where they do not fit, and empty where the family has none.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Identity {
    /// Model.
    pub model: heapless::String<64>,
    /// Serial number.
    pub serial: heapless::String<32>,
    /// Firmware version.
    pub firmware: heapless::String<32>,
    /// The sensor's own words on how it is.
    pub state: heapless::String<64>,
    /// First bearing, rad.
    pub angle_min_rad: f32,
    /// Last bearing, rad.
    pub angle_max_rad: f32,
    /// Beams of a full scan; 0 if that varies.
    pub beams: u16,
    /// From one turn of the mirror to the next.
    pub turn: Duration,
    /// Ranges from here on are misses, m.
    pub range_max_m: f32,
}

/// What to do about the line's rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BaudPolicy {
    /// The link has none: TCP.
    NoRate,
    /// Find the sensor's rate and keep it.
    Keep,
    /// Find it, then change to this one, bit/s, if the sensor and the line can.
    Raise(u32),
    /// Find it, and if it is slower than this one, bit/s, change to it.
    AtLeast(u32),
}

impl BaudPolicy {
    /// The rate to look at first, and to change to; 0 for none.
    pub(super) fn wanted(self) -> u32 {
        match self {
            BaudPolicy::Raise(rate) | BaudPolicy::AtLeast(rate) => rate,
            BaudPolicy::NoRate | BaudPolicy::Keep => 0,
        }
    }

    /// True if the rate found is to be changed to the one wanted.
    pub(super) fn wants_change(self, found: u32) -> bool {
        match self {
            BaudPolicy::Raise(rate) => rate != found,
            BaudPolicy::AtLeast(rate) => found < rate,
            BaudPolicy::NoRate | BaudPolicy::Keep => false,
        }
    }
}

/// Counters since the driver was made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counters {
    /// Scans published.
    pub scans: u32,
    /// Scans and replies refused because something in them was wrong.
    pub damaged: u32,
    /// Sessions begun anew after trouble.
    pub restarts: u32,
}

/// A driver for one family of laser range finders: see the [module](self) for the contract.
pub trait LrfDriver {
    /// Takes one input; returns how many bytes of it were taken (0 for inputs without).
    #[must_use]
    fn handle_input(&mut self, now: Instant, input: Input<'_>) -> usize;

    /// The next thing to do.
    fn poll_output(&mut self) -> Output<'_>;

    /// Counters since it was made.
    fn counters(&self) -> Counters;
}

/// Gives all `bytes` to `driver`, and every output but timeouts to `sink`; returns the next deadline.
pub fn run_bytes<D: LrfDriver + ?Sized>(
    driver: &mut D,
    now: Instant,
    bytes: &[u8],
    sink: &mut dyn FnMut(Output<'_>),
) -> Instant {
    let mut rest = bytes;
    loop {
        let taken = driver.handle_input(now, Input::Bytes(rest));
        rest = rest.get(taken..).unwrap_or(b"");
        let deadline = drain(driver, sink);
        if rest.is_empty() {
            return deadline;
        }
    }
}

/// Gives every output but timeouts to `sink`; returns the next deadline.
pub fn drain<D: LrfDriver + ?Sized>(driver: &mut D, sink: &mut dyn FnMut(Output<'_>)) -> Instant {
    loop {
        match driver.poll_output() {
            Output::Timeout(deadline) => return deadline,
            output => sink(output),
        }
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
