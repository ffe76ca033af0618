//! Stamps for a sensor that has no clock to read, and sends at a steady pace, whichever that is.
//!
//! A scan that is read in time is stamped by its arrival. One that was read late, which the bytes that wait behind it show, is stamped by
//! the pace since the last in time: a reader that was stopped then finds each scan where it belongs.
//!
//! Data flow: arrival, whether it is late → pace between those in time → stamp of those that are not.

use lrfslam_scan::time::Instant;

/// Gaps that differ by no more than this share of them are the same.
const SAME: i64 = 8;
/// Share of each new gap in the pace.
const SHARE: i64 = 32;
/// Scans in a row, all of them late, after which the least late of them tells where the pace is.
const LATE_IN_A_ROW: u32 = 64;

/// Follows the pace of a sensor. Times inside are ns.
#[derive(Debug, Clone, Default)]
pub struct PaceClock {
    /// From one scan to the next, once two gaps in a row were the same.
    pace: Option<i64>,
    /// The gap before, 0 for none.
    gap: i64,
    /// Arrival of a scan that was in time.
    anchor: Option<i64>,
    /// Scans since then.
    since: u32,
    /// Scans, all late, since the least lateness is listened for; and that.
    late: u32,
    least: i64,
}

impl PaceClock {
    /// What comes next has nothing to do with what came before.
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// A scan was lost: the pace went on.
    pub fn gap(&mut self) {
        self.since = self.since.saturating_add(1);
    }

    /// The stamp of a scan that arrived now, and `is_late` if others wait behind it: never later than its arrival.
    pub fn stamp(&mut self, arrived: Instant, is_late: bool) -> Instant {
        let arrived = arrived.micros * 1000;
        self.since = self.since.saturating_add(1);
        let paced = self.anchor.zip(self.pace).map(|(anchor, pace)| anchor + i64::from(self.since) * pace);
        match paced.filter(|paced| is_late && *paced <= arrived) {
            Some(paced) => {
                self.hear_late(arrived - paced);
                Instant::from_micros(paced.div_euclid(1000))
            }
            None => {
                if !is_late {
                    self.learn(arrived);
                }
                (self.anchor, self.since, self.late) = (Some(arrived), 0, 0);
                Instant::from_micros(arrived.div_euclid(1000))
            }
        }
    }

    /// What comes late for so long shows by the least of its latenesses that the pace is ahead of the sensor.
    fn hear_late(&mut self, lateness: i64) {
        self.least = if self.late == 0 { lateness } else { self.least.min(lateness) };
        self.late += 1;
        if self.late >= LATE_IN_A_ROW {
            self.anchor = self.anchor.map(|anchor| anchor + self.least);
            self.late = 0;
        }
    }

    /// One in time: the gap since the last tells the pace, or where it goes on.
    fn learn(&mut self, arrived: i64) {
        let Some(anchor) = self.anchor else { return };
        let gap = (arrived - anchor) / i64::from(self.since.max(1));
        let is_same = |other: i64| (gap - other).abs() <= other / SAME;
        match self.pace {
            Some(pace) if is_same(pace) => self.pace = Some(pace + (gap - pace) / SHARE),
            // Another pace only if it comes twice, one by one.
            _ if self.since == 1 && self.gap > 0 && is_same(self.gap) => self.pace = Some((gap + self.gap) / 2),
            _ => {}
        }
        self.gap = if self.since == 1 { gap } else { 0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    /// Errors of the stamps, µs, of scans at `at`, read at `read`; late if the next was there, too.
    fn errors(scans: i64, at: impl Fn(i64) -> i64, read: impl Fn(i64) -> i64) -> Vec<i64> {
        let mut clock = PaceClock::default();
        let stamp = |scan: i64| {
            let arrived = read(at(scan));
            (clock.stamp(Instant::from_micros(arrived), at(scan + 1) <= arrived).micros, at(scan))
        };
        let stamps: Vec<(i64, i64)> = (0..scans).map(stamp).collect();
        assert!(stamps.windows(2).all(|pair| pair[0].0 < pair[1].0), "{stamps:?}");
        stamps.into_iter().map(|(stamp, at)| stamp - at).collect()
    }

    /// Stopped for 0.3 s every second and a half.
    fn stopped(at: i64) -> i64 {
        let within = at % 1_500_000;
        if (500_000..800_000).contains(&within) { at - within + 800_000 } else { at }
    }

    fn largest(errors: &[i64]) -> i64 {
        errors.iter().map(|error| error.abs()).max().unwrap()
    }

    #[test]
    fn stopped_reader_moves_a_stamp_by_less_than_the_pace() {
        for (pace, at_most) in [(13_333, 10), (26_667, 20), (106_667, 60)] {
            let errors = errors(600, |scan| scan * pace + 1000, stopped);
            let late = errors.iter().filter(|error| **error > 1000).count();
            assert!(largest(&errors) < pace && late <= at_most, "{pace}: {} us, {late} late", largest(&errors));
        }
    }

    #[test]
    fn what_is_read_in_time_is_stamped_by_its_arrival() {
        let uneven = |scan: i64| scan * 13_333 + scan / 7 * 40_000 + scan * 7919 % 3000;
        assert_eq!(largest(&errors(300, uneven, |at| at)), 0);
    }

    /// A reader that always finds two at once: nobody knows the pace, but by what comes.
    #[test]
    fn reader_that_is_always_late_does_not_drift() {
        let early = |scan: i64| scan * 13_333;
        let twos = |at: i64| if at < 300_000 { at } else { (at / 30_000 + 1) * 30_000 };
        let errors = errors(3000, early, twos);
        assert!(largest(&errors) < 20_000, "{}", largest(&errors));
    }

    #[test]
    fn lost_scans_cost_no_order_and_are_made_up_for() {
        let lossy = |scan: i64| scan * 13_333 + if scan > 80 { 5 * 13_333 } else { 0 };
        let errors = errors(300, lossy, stopped);
        assert!(largest(&errors[200..]) < 13_333, "{errors:?}");
    }
}
