//! Stamps for a sensor that has no clock to read but a steady beat, its mirror's or its sampling's.
//!
//! What arrives is never early, but late whenever the host reads late. So a scan's stamp is that of the scan before plus its beats;
//! arrivals only keep the beat in step. [`BeatClock::stamp`] never goes back.
//!
//! Data flow: arrival, beats since the scan before → predicted stamp → lateness → its least of a while, which corrects phase and length
//! of the beat.

use lrfslam_scan::time::{Duration, Instant};

/// Scans in a row, none with another waiting behind it, after which what is late by whole beats was lost on the way.
const WITNESSES: u8 = 3;
/// Scans and beats of a window, of whose halves the least latenesses count. The first window is shorter.
const WINDOW_SCANS: u32 = 4;
const WINDOW_BEATS: u32 = 64;
const FIRST_BEATS: u32 = 16;
/// Mirrors turn as fast as they should, within one part in this many.
const TOLERANCE: i64 = 33;

/// Follows a beat through late arrivals. Times inside are ns.
#[derive(Debug, Clone)]
pub struct BeatClock {
    nominal: i64,
    beat: i64,
    /// Stamp and arrival of the last scan.
    last: Option<(i64, i64)>,
    /// Scans went missing: the next one's beats are to be counted by its arrival.
    has_gap: bool,
    witnesses: u8,
    witnessed: i64,
    window: Window,
}

#[derive(Debug, Clone, Copy)]
struct Window {
    wanted: u32,
    scans: u32,
    beats: u32,
    /// Of its first and its second half.
    least: [i64; 2],
    /// By how much stamps were moved back in its second half, because scans came early.
    advanced: i64,
}

impl Window {
    const fn new(wanted: u32) -> Self {
        Self { wanted, scans: 0, beats: 0, least: [i64::MAX; 2], advanced: 0 }
    }

    fn is_in_second_half(&self) -> bool {
        self.beats * 2 >= self.wanted && self.scans >= 2
    }
}

impl BeatClock {
    /// For a beat of this length, known to 3 %.
    pub const fn new(beat: Duration) -> Self {
        let nominal = beat.micros * 1000;
        Self {
            nominal,
            beat: nominal,
            last: None,
            has_gap: false,
            witnesses: 0,
            witnessed: i64::MAX,
            window: Window::new(FIRST_BEATS),
        }
    }

    /// What comes next has nothing to do with what came before, but the length of the beat.
    pub fn restart(&mut self) {
        *self = Self { beat: self.beat, ..Self::new(Duration::from_micros(self.nominal / 1000)) };
    }

    /// Something was lost: the next scan may be later than its beats say.
    pub fn gap(&mut self) {
        self.has_gap = true;
    }

    /// The stamp of a scan that came at `arrived` or before, `beats` after the one before if none was lost.
    ///
    /// * returns at least half a beat more than the last time
    pub fn stamp(&mut self, arrived: Instant, beats: u32) -> Instant {
        let arrived = arrived.micros * 1000;
        let beats = beats.max(1);
        let stamp = match self.last {
            None => arrived,
            Some((last, arrived_last)) => self.next(last, arrived_last, arrived, beats),
        };
        self.last = Some((stamp, arrived));
        self.note(arrived - stamp, beats);
        Instant::from_micros(stamp.div_euclid(1000))
    }

    fn next(&mut self, last: i64, arrived_last: i64, arrived: i64, beats: u32) -> i64 {
        let step = i64::from(beats) * self.beat;
        if arrived - arrived_last > step * 3 / 4 {
            self.hear(arrived_last - last);
        }
        let mut stamp = last + step + self.lost_before();
        if core::mem::take(&mut self.has_gap) {
            stamp += self.whole_beats(arrived - stamp).max(0);
        }
        if arrived < stamp {
            let early = stamp - arrived;
            let corrected = arrived.max(last + self.beat / 2);
            if self.window.is_in_second_half() {
                self.window.advanced += early.min(self.beat);
            }
            return corrected;
        }
        stamp
    }

    /// A scan without another waiting behind it was so late: it was not for the reader that it came late.
    fn hear(&mut self, lateness: i64) {
        self.witnessed = self.witnessed.min(lateness);
        self.witnesses = self.witnesses.saturating_add(1);
    }

    /// What all witnesses agree on.
    fn lost_before(&mut self) -> i64 {
        if self.witnesses < WITNESSES {
            return 0;
        }
        let lost = self.whole_beats(self.witnessed);
        (self.witnesses, self.witnessed) = (0, i64::MAX);
        lost
    }

    /// Whole beats in a lateness, of which a tenth may be missing to the last one.
    fn whole_beats(&self, lateness: i64) -> i64 {
        (lateness + self.beat / 10).div_euclid(self.beat.max(1)) * self.beat
    }

    fn note(&mut self, lateness: i64, beats: u32) {
        let window = &mut self.window;
        window.scans += 1;
        window.beats = window.beats.saturating_add(beats);
        let half = usize::from(window.is_in_second_half());
        if let Some(least) = window.least.get_mut(half) {
            *least = lateness.min(*least);
        }
        if window.scans >= WINDOW_SCANS && window.beats >= window.wanted {
            self.close_window();
        }
    }

    /// What is least late in each half of a window says by how much the beat is out of step, and out of length. More than half a beat is
    /// for the witnesses.
    fn close_window(&mut self) {
        let window = core::mem::replace(&mut self.window, Window::new(WINDOW_BEATS));
        let [first, second] = window.least;
        if first.max(second) >= self.beat / 2 {
            return;
        }
        let (is_first, beats) = (window.wanted == FIRST_BEATS, i64::from(window.beats.max(1)));
        let per_beat = (second - first - window.advanced) * 2 / beats;
        let most = self.nominal / TOLERANCE;
        let share = if is_first { 1 } else { 4 };
        self.beat = (self.beat + per_beat / share).clamp(self.nominal - most, self.nominal + most);
        let late = (if is_first { second + per_beat * beats / 4 } else { second }).clamp(0, self.beat / 2);
        self.last = self.last.map(|(stamp, arrived)| (stamp + late, arrived));
    }
}

/// Gaps that a beat is learned from.
const GAPS: usize = 64;

/// Finds the length of a beat that nobody knows: the median of the gaps between arrivals, which reading late now and then does not move.
#[derive(Debug, Clone, Default)]
pub struct BeatFinder {
    gaps: heapless::Vec<u32, GAPS>,
    last: Option<Instant>,
}

impl BeatFinder {
    /// An arrival; the length of the beat once there were enough.
    pub fn hear(&mut self, arrived: Instant) -> Option<Duration> {
        let gap = self.last.replace(arrived).map(|last| arrived.since(last).micros);
        if let Some(gap) = gap.and_then(|gap| u32::try_from(gap).ok()) {
            let _ = self.gaps.push(gap);
        }
        if self.gaps.len() < GAPS {
            return None;
        }
        self.gaps.sort_unstable();
        let median = self.gaps.get(GAPS / 2).copied();
        self.gaps.clear();
        // Read at once: no gaps at all. Listen on.
        median.filter(|gap| *gap >= 500).map(|gap| Duration::from_micros(i64::from(gap)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    const TURN: Duration = Duration::from_micros(13_333);

    /// Errors of the stamps, µs, of scans at true times `at`, read late by `late`.
    fn errors(scans: u32, at: impl Fn(u32) -> i64, late: impl Fn(i64) -> i64) -> Vec<i64> {
        let mut clock = BeatClock::new(TURN);
        let mut stamps = Vec::new();
        let mut read = 0;
        for scan in 0..scans {
            read = read.max(at(scan) + late(at(scan)));
            stamps.push(clock.stamp(Instant::from_micros(read), 1).micros);
        }
        assert!(stamps.windows(2).all(|pair| pair[1] - pair[0] > TURN.micros / 2 - 300), "{stamps:?}");
        stamps.iter().enumerate().map(|(scan, stamp)| stamp - at(scan as u32)).collect()
    }

    fn largest(errors: &[i64]) -> i64 {
        errors.iter().map(|error| error.abs()).max().unwrap()
    }

    /// Stopped for 0.3 s every second.
    fn stopped(at: i64) -> i64 {
        let within = at % 1_000_000;
        if at > 500_000 && within < 300_000 { 300_000 - within } else { 0 }
    }

    #[test]
    fn stopped_reader_moves_no_stamp() {
        let errors = errors(600, |scan| i64::from(scan) * 13_333, stopped);
        assert!(largest(&errors) < 300, "{}", largest(&errors));
    }

    #[test]
    fn mirror_one_percent_off_and_jitter_are_followed() {
        for period in [13_200_i64, 13_466] {
            let jitter = |at: i64| (at * 7919) % 4000 + stopped(at);
            let errors = errors(900, |scan| i64::from(scan) * period, jitter);
            assert!(largest(&errors[80..]) < 3000, "{period}: {}", largest(&errors[80..]));
        }
    }

    #[test]
    fn lost_scans_are_caught_up_with() {
        let errors = errors(100, |scan| i64::from(if scan < 50 { scan } else { scan + 4 }) * 13_333, |_| 0);
        assert!(largest(&errors[..50]) < 20 && largest(&errors[54..]) < 20, "{errors:?}");
    }

    #[test]
    fn known_gap_is_jumped_at_once() {
        let mut clock = BeatClock::new(TURN);
        for scan in 0..20 {
            let _ = clock.stamp(Instant::from_micros(scan * 13_333), 1);
        }
        clock.gap();
        let stamp = clock.stamp(Instant::from_micros(25 * 13_333 + 900), 1);
        assert!((stamp.micros - 25 * 13_333).abs() < 20, "{stamp:?}");
    }

    #[test]
    fn beat_is_found_by_its_median_gap() {
        let mut finder = BeatFinder::default();
        let mut found = None;
        for packet in 0..=64_i64 {
            let at = packet * 8000 + if packet == 20 { 7000 } else { 0 };
            found = found.or(finder.hear(Instant::from_micros(at)));
        }
        assert_eq!(found, Some(Duration::from_micros(8000)));
    }
}
