//! The robot's clock, µs since 1970, which never goes back: the system's clock is read once.

use std::time::{Instant as WallInstant, SystemTime, UNIX_EPOCH};

use lrfslam_core::time::Instant;

/// See the [module](self).
#[derive(Debug, Clone, Copy)]
pub(super) struct Clock {
    started: WallInstant,
    unix_us: i64,
}

impl Clock {
    pub(super) fn start() -> Self {
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { started: WallInstant::now(), unix_us: unix.as_micros() as i64 }
    }

    pub(super) fn now(&self) -> Instant {
        Instant::from_micros(self.unix_us + self.started.elapsed().as_micros() as i64)
    }

    /// A number that the next start will not have: ticks of 16 ms since 1970, which repeat after two years.
    pub(super) fn epoch(&self) -> u32 {
        (self.now().micros / 16_000) as u32
    }
}
