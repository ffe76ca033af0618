//! Instants and durations in integer microseconds: no clock is read here, time is always an argument.

use serde::{Deserialize, Serialize};

/// A moment on some device's or log's clock, µs since that clock's zero.
///
/// Signed, because logs carry times before their zero and clocks that run backwards.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Instant {
    /// Microseconds since the clock's zero.
    pub micros: i64,
}

/// A signed span of time, µs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Duration {
    /// Microseconds.
    pub micros: i64,
}

impl Instant {
    /// The instant `micros` µs after the clock's zero.
    pub const fn from_micros(micros: i64) -> Self {
        Self { micros }
    }

    /// The instant `seconds` after the clock's zero, rounded to the microsecond; NaN gives zero.
    pub fn from_secs_f64(seconds: f64) -> Self {
        Self { micros: libm::round(seconds * 1e6) as i64 }
    }

    /// Seconds since the clock's zero; exact to the microsecond for dates of this century.
    pub fn as_secs_f64(self) -> f64 {
        self.micros as f64 * 1e-6
    }

    /// Time from `earlier` to here; negative where the clock ran backwards.
    pub const fn since(self, earlier: Self) -> Duration {
        Duration { micros: self.micros.saturating_sub(earlier.micros) }
    }
}

impl Duration {
    /// No time at all.
    pub const ZERO: Self = Self { micros: 0 };

    /// A span of `micros` µs.
    pub const fn from_micros(micros: i64) -> Self {
        Self { micros }
    }

    /// A span of `millis` ms.
    pub const fn from_millis(millis: i64) -> Self {
        Self { micros: millis.saturating_mul(1000) }
    }

    /// Length in seconds.
    pub fn as_secs_f32(self) -> f32 {
        self.micros as f32 * 1e-6
    }
}

impl core::ops::Sub for Duration {
    type Output = Self;
    /// Saturates at the ends of the representable time.
    fn sub(self, other: Self) -> Self {
        Self { micros: self.micros.saturating_sub(other.micros) }
    }
}

impl core::ops::Add<Duration> for Instant {
    type Output = Instant;
    /// Saturates at the ends of the representable time.
    fn add(self, span: Duration) -> Instant {
        Instant { micros: self.micros.saturating_add(span.micros) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unix_time_keeps_its_microseconds() {
        let stamp = Instant::from_secs_f64(976_052_905.167_303);
        assert_eq!(stamp.micros, 976_052_905_167_303);
        assert_eq!(stamp.as_secs_f64(), 976_052_905.167_303);
    }

    #[test]
    fn clock_running_backwards_gives_negative_duration() {
        let span = Instant::from_micros(5).since(Instant::from_micros(8));
        assert_eq!(span, Duration::from_micros(-3));
    }
}
