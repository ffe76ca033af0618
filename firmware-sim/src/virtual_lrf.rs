//! Laser range finders that are not there: command bytes and time in, telegram bytes out, on a virtual clock.
//!
//! Made from the protocol, not from our driver: whatever a real sensor answers, these answer, also to what our driver never
//! says. They know nothing of terminals or sockets; [`Cable`](crate::cable::Cable) carries their bytes at the pace of the line.

pub mod hokuyo;
pub mod ldrobot;
pub mod recording;
pub mod rplidar;
mod sensor_model;
pub mod sick;

pub use sensor_model::SensorModel;

use lrfslam_core::time::{Duration, Instant};

/// Bytes that a device writes at once: one reply, or one scan.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Emission {
    /// What it writes.
    pub bytes: Vec<u8>,
    /// When the first bit leaves.
    pub begins: Instant,
    /// Rate, bit/s; `None` on USB.
    pub baud: Option<u32>,
}

/// A sensor: see the [module](self).
///
/// After each call that takes `now`, drain [`poll`](Self::poll); call [`timeout`](Self::timeout) at [`deadline`](Self::deadline).
pub trait VirtualLrf: Send {
    /// Power comes on (again): everything that is not permanent is forgotten.
    fn power_on(&mut self, now: Instant);

    /// Bytes arrive, as the device's own receiver reads them.
    fn receive(&mut self, now: Instant, bytes: &[u8]);

    /// Lets the device do what is due.
    fn timeout(&mut self, now: Instant);

    /// What goes out next, in order.
    fn poll(&mut self) -> Option<Emission>;

    /// When [`timeout`](Self::timeout) is due.
    fn deadline(&self) -> Instant;

    /// The rate at which it listens, bit/s; `None` on USB, which has none.
    fn baud(&self, now: Instant) -> Option<u32>;
}

/// The device's end of the line: what is being sent, and at which rate.
#[derive(Debug, Clone)]
pub(crate) struct Line {
    baud: Option<u32>,
    /// A new rate, and from when it holds: after what was being sent.
    change: Option<(Instant, u32)>,
    free_at: Instant,
    out: std::collections::VecDeque<Emission>,
}

/// What USB full speed delivers, bytes per second.
const USB_BYTES_PER_SECOND: i64 = 1_000_000;

impl Line {
    pub(crate) fn new(baud: Option<u32>) -> Self {
        Self { baud, change: None, free_at: Instant::default(), out: Default::default() }
    }

    /// Sends at `at`, or when the line is free.
    pub(crate) fn send(&mut self, at: Instant, bytes: Vec<u8>) {
        let begins = at.max(self.free_at);
        let baud = self.baud(begins);
        self.free_at = begins + wire_time(bytes.len(), baud);
        self.out.push_back(Emission { bytes, begins, baud });
    }

    /// Changes the rate once everything said so far is out.
    pub(crate) fn change_rate(&mut self, baud: u32) {
        if self.baud.is_some() {
            self.change = Some((self.free_at, baud));
        }
    }

    pub(crate) fn baud(&self, now: Instant) -> Option<u32> {
        match self.change {
            Some((from, baud)) if now >= from => Some(baud),
            _ => self.baud,
        }
    }

    pub(crate) fn is_free(&self, now: Instant) -> bool {
        now >= self.free_at
    }

    pub(crate) fn poll(&mut self) -> Option<Emission> {
        self.out.pop_front()
    }

    /// Cuts off what was being said, and goes on at `baud`.
    pub(crate) fn reset(&mut self, now: Instant, baud: Option<u32>) {
        *self = Self { free_at: now, ..Self::new(baud) };
    }
}

/// Time on the line, 10 bits a byte.
pub(crate) fn wire_time(bytes: usize, baud: Option<u32>) -> Duration {
    let bytes = bytes as i64;
    Duration::from_micros(match baud {
        Some(baud) => bytes * 10_000_000 / i64::from(baud.max(1)),
        None => bytes * 1_000_000 / USB_BYTES_PER_SECOND,
    })
}
