//! What every laser range finder's driver has in common: the contract with the one that runs it.
//!
//! # Contract
//! Give one input, then drain [`poll_output`](LrfDriver::poll_output) until it answers [`Output::Timeout`]; only then the
//! next input. [`Input::Bytes`] may be taken in part: drain, then give the rest ([`run_input`] does all of this). Extra calls do
//! no harm. Give all bytes that wait at once, as far as memory goes: that some wait behind a scan shows that it was read late. No scan is
//! stamped at or before the one before it. A driver never blocks, reads no clock and keeps no thread: the same inputs at the same instants give the same
//! outputs, so a recording of the inputs replays exactly.

pub use super::trouble::{BaudRates, Cause, MAX_BAUD_RATES, Step, Trouble};
use lrfslam_scan::RangeScan;
use lrfslam_scan::time::{Duration, Instant};

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
        /// From one scan to the next if the line is fast enough; zero if the sensor does not say.
        period: Duration,
    },
    /// How bright the echoes of the next scan are, beam by beam, from 0 to 255; only if the sensor tells, and memory was lent for it.
    Brightness(&'a [u8]),
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
    /// From one turn of the mirror to the next; zero if the sensor does not say.
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

    /// The rates to look at: the `last_good` one, the wanted one if the sensor may have it, then `all`; none on a link without rates.
    pub(super) fn rates(self, last_good: u32, all: &[u32]) -> BaudRates {
        let wanted = Some(self.wanted()).filter(|wanted| all.contains(wanted));
        match self {
            BaudPolicy::NoRate => BaudRates::default(),
            _ => BaudRates::new([last_good].into_iter().chain(wanted).chain(all.iter().copied())),
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
    /// Turns of a laser that spins in which samples were missing: published with beams without a measurement in their place, or, if they were
    /// too many, not at all.
    pub incomplete: u32,
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

/// Gives any input to `driver`, all of its bytes if it has some, and every output but timeouts to `sink`; returns the next deadline.
pub fn run_input<D: LrfDriver + ?Sized>(
    driver: &mut D,
    now: Instant,
    input: Input<'_>,
    sink: &mut dyn FnMut(Output<'_>),
) -> Instant {
    if let Input::Bytes(bytes) = input {
        return run_bytes(driver, now, bytes, sink);
    }
    let _ = driver.handle_input(now, input);
    drain(driver, sink)
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
