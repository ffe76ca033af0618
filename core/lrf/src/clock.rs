//! A sensor's millisecond clock, which wraps → host time.

use lrfslam_scan::time::{Duration, Instant};

/// Period of a 24-bit clock, ms: it wraps after 4 h 39 min 37 s.
pub const PERIOD_24_BIT_MS: i64 = 1 << 24;
/// Steps backwards up to this are jitter, not a reset, ms.
const JITTER_MS: i64 = 1000;
/// Equal stamps in a row after which the clock is called stuck.
const STUCK_AFTER: u8 = 3;

/// What a stamp says beside its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stamp {
    /// ms since the clock's zero, wraps included.
    At(i64),
    /// It jumped backwards, and not by a wrap: the sensor was reset.
    Reset,
    /// It is the same for the third time.
    Stuck,
}

/// Unwraps stamps, and notices a sensor that was reset or whose clock stands still.
#[derive(Debug, Clone, Copy)]
pub struct StampUnwrapper {
    period_ms: i64,
    last: Option<i64>,
    repeats: u8,
}

impl StampUnwrapper {
    /// For a clock that counts from 0 to `period_ms` − 1.
    pub const fn new(period_ms: i64) -> Self {
        Self { period_ms, last: None, repeats: 0 }
    }

    /// The next stamp, ms, taken modulo the period.
    ///
    /// A backward jump by more than half the period is a wrap (drivers); a small one is jitter. After `Reset` or `Stuck` the
    /// unwrapper starts anew.
    pub fn unwrap(&mut self, stamp_ms: u32) -> Stamp {
        let period = self.period_ms.max(1);
        let stamp = i64::from(stamp_ms) % period;
        let Some(last) = self.last else {
            self.last = Some(stamp);
            return Stamp::At(stamp);
        };
        let turns = last.div_euclid(period) * period;
        let step = stamp + turns - last;
        let now = if step < -period / 2 {
            last + step + period
        } else if step > period / 2 && turns > 0 {
            last + step - period
        } else {
            last + step
        };
        if now < last - JITTER_MS {
            *self = Self::new(period);
            return Stamp::Reset;
        }
        self.repeats = if now == last { self.repeats + 1 } else { 0 };
        if self.repeats >= STUCK_AFTER - 1 {
            *self = Self::new(period);
            return Stamp::Stuck;
        }
        self.last = Some(now);
        Stamp::At(now)
    }
}

/// Most exchanges used for the offset.
pub const MAX_EXCHANGES: usize = 11;
/// Stamps over which the smallest delay is taken, if nothing else is said.
const WINDOW: u16 = 64;

/// Estimates what to add to a sensor's time to get the host's.
///
/// First by the median over some exchanges of (middle of the exchange − stamp), which an exchange held up somewhere does
/// not move (drivers). Then it follows the two clocks' drift: the smallest (arrival − stamp) of each window of scans
/// should not change, so its change is the drift. Without exchanges the smallest delay itself serves.
#[derive(Debug, Clone)]
pub struct ClockOffset {
    samples: heapless::Vec<i64, MAX_EXCHANGES>,
    offset_us: Option<i64>,
    /// (smallest delay of the first window, offset then), µs.
    reference: Option<(i64, i64)>,
    window: Option<i64>,
    in_window: u16,
    /// Stamps of a whole window.
    window_stamps: u16,
}

impl Default for ClockOffset {
    fn default() -> Self {
        Self::over(WINDOW)
    }
}

impl ClockOffset {
    /// Follows the drift over windows of `window_stamps`: the reader may be late for many in a row, but not for so many.
    pub const fn over(window_stamps: u16) -> Self {
        Self {
            samples: heapless::Vec::new(),
            offset_us: None,
            reference: None,
            window: None,
            in_window: 0,
            window_stamps,
        }
    }

    /// One exchange: sent, answered, and the stamp that the answer carried.
    pub fn add_exchange(&mut self, sent: Instant, answered: Instant, stamp_ms: i64) {
        let middle = sent.micros + answered.since(sent).micros / 2;
        let _ = self.samples.push(middle - stamp_ms * 1000);
        let mut sorted = self.samples.clone();
        sorted.sort_unstable();
        self.offset_us = sorted.get(sorted.len() / 2).copied();
    }

    /// Number of exchanges so far.
    pub fn exchanges(&self) -> usize {
        self.samples.len()
    }

    /// A scan stamped `stamp_ms` began to arrive at `arrived`, or would have `transit` earlier if nothing took time: its stamp on
    /// the host's clock.
    ///
    /// * `transit` — the shortest time from stamp to first byte, used only where there is no exchange: the first scans may be read late
    pub fn stamp(&mut self, arrived: Instant, stamp_ms: i64, transit: Duration) -> Instant {
        let delay = arrived.micros - stamp_ms * 1000;
        if self.samples.is_empty() && self.reference.is_none() {
            let least = self.offset_us.map_or(delay, |offset| (offset + transit.micros).min(delay));
            self.offset_us = Some(least - transit.micros);
        }
        let offset = self.offset_us.unwrap_or(delay - transit.micros);
        self.window = Some(self.window.map_or(delay, |smallest| smallest.min(delay)));
        self.in_window += 1;
        if self.in_window >= self.window_stamps {
            self.close_window(offset);
        }
        Instant::from_micros(stamp_ms * 1000 + offset)
    }

    fn close_window(&mut self, offset: i64) {
        let smallest = self.window.take().unwrap_or(0);
        self.in_window = 0;
        match self.reference {
            None => self.reference = Some((smallest, offset)),
            Some((reference, offset_then)) => self.offset_us = Some(offset_then + smallest - reference),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrap_is_unwrapped_and_small_steps_back_are_jitter() {
        let mut clock = StampUnwrapper::new(PERIOD_24_BIT_MS);
        let stamps = [16_777_100, 16_777_200, 84, 80, 184];
        let unwrapped = stamps.map(|stamp| clock.unwrap(stamp));
        assert_eq!(unwrapped, [16_777_100, 16_777_200, 16_777_300, 16_777_296, 16_777_400].map(Stamp::At));
    }

    #[test]
    fn jitter_across_the_wrap_goes_back() {
        let mut clock = StampUnwrapper::new(PERIOD_24_BIT_MS);
        clock.unwrap(16_777_215);
        assert_eq!(clock.unwrap(3), Stamp::At(PERIOD_24_BIT_MS + 3));
        assert_eq!(clock.unwrap(16_777_214), Stamp::At(PERIOD_24_BIT_MS - 2));
    }

    #[test]
    fn reset_and_stuck_clock_are_noticed() {
        let mut clock = StampUnwrapper::new(PERIOD_24_BIT_MS);
        clock.unwrap(5_000_000);
        assert_eq!(clock.unwrap(30), Stamp::Reset);
        assert_eq!(
            [clock.unwrap(60), clock.unwrap(60), clock.unwrap(60)],
            [Stamp::At(60), Stamp::At(60), Stamp::Stuck]
        );
    }

    #[test]
    fn median_ignores_a_late_exchange() {
        let mut offset = ClockOffset::default();
        for (sent, took) in [(0, 2000), (10_000, 2000), (20_000, 90_000)] {
            let sent = Instant::from_micros(sent);
            let stamp = (sent.micros + 1000 + 500_000) / 1000;
            offset.add_exchange(sent, sent + Duration::from_micros(took), stamp);
        }
        let stamp = offset.stamp(Instant::from_micros(200_000), 600, Duration::ZERO);
        assert_eq!(stamp.micros, 600_000 - 500_000);
    }

    #[test]
    fn drift_of_a_hundred_ppm_is_followed() {
        let mut offset = ClockOffset::default();
        let mut worst = 0;
        for scan in 0..36_000_i64 {
            let true_us = scan * 100_000;
            let stamp_ms = (true_us + true_us / 10_000) / 1000;
            let jitter = (scan * 7919) % 4000;
            let stamp =
                offset.stamp(Instant::from_micros(true_us + 30_000 + jitter), stamp_ms, Duration::from_millis(30));
            worst = worst.max((stamp.micros - true_us).abs());
        }
        assert!(worst < 6000, "{worst} us in an hour");
    }

    /// A stamp every 4 ms, whose reader is stopped for 0.3 s now and then.
    #[test]
    fn stopped_reader_moves_nothing_over_a_window_that_is_longer() {
        let mut offset = ClockOffset::over(512);
        for scan in 0..4000_i64 {
            let (at_ms, within_ms) = (scan * 4, scan * 4 % 3000);
            let read_ms = if within_ms >= 2700 { at_ms - within_ms + 3000 } else { at_ms };
            let stamp = offset.stamp(Instant::from_micros(read_ms * 1000), at_ms, Duration::ZERO);
            assert_eq!(stamp.micros, at_ms * 1000, "scan {scan}");
        }
    }
}
