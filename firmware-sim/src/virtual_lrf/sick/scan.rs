//! Scans: what the scene holds, as telegrams, at 75 mirror turns a second.

use lrfslam_core::time::{Duration, Instant};
use lrfslam_lrf::sick_lms::measurement::{ValueFormat, count_word, level};
use lrfslam_lrf::sick_lms::{OperatingMode, Unit};

use super::VirtualSick;
use crate::lrf_model::Reading;

/// Mirror turns per second.
const TURNS_PER_SECOND: i64 = 75;

/// Measuring modes whose values are reflectivities instead of ranges.
const GIVES_REFLECTIVITY: [u8; 3] = [0x0D, 0x0E, 0x3F];

/// When turn `turn` of the mirror passes 0° of the sensor's own scale.
fn turn_start(turn: i64) -> Instant {
    Instant::from_micros(turn * 1_000_000 / TURNS_PER_SECOND)
}

impl VirtualSick {
    /// Turns that make one telegram.
    fn group_turns(&self) -> i64 {
        let scan = i64::from(self.variant.turns());
        match self.mode {
            OperatingMode::StreamPartial if !self.single => 1,
            OperatingMode::StreamMean(scans) | OperatingMode::StreamMeanSubrange(scans, ..) if !self.single => {
                scan * i64::from(scans.max(1))
            }
            _ => scan,
        }
    }

    /// When the last sweep of the next group is complete, if it is wanted.
    pub(super) fn scan_due(&self) -> Option<Instant> {
        if !self.single && !self.is_streaming() {
            return None;
        }
        let first = self.next_group * self.group_turns();
        let last = first + self.group_turns() - 1;
        let begins = self.sight.next_at(turn_start(first))?;
        Some(begins + turn_start(last).since(turn_start(first)) + self.sweep())
    }

    /// Time from 0° to the last beam.
    fn sweep(&self) -> Duration {
        let end_deg = i64::from(self.variant.start_deg() + self.variant.angle_deg);
        Duration::from_micros(1_000_000 / TURNS_PER_SECOND * end_deg / 360)
    }

    /// Lets pass all groups that begin before `at`.
    pub(super) fn skip_to(&mut self, at: Instant) {
        let turn = at.micros * TURNS_PER_SECOND / 1_000_000 + 1;
        self.next_group = turn.div_euclid(self.group_turns()) + 1;
        self.next_part = None;
        if self.is_streaming() {
            self.sight.stream_from(at);
        }
    }

    /// A group of turns is complete: it goes out if the line is free; a sensor does not queue.
    pub(super) fn finish_group(&mut self, now: Instant) {
        let first_turn = self.next_group * self.group_turns();
        self.next_group += 1;
        if !self.line.is_free(now) || !self.is_next_part(first_turn) {
            self.sight.advance();
            return;
        }
        let payload = self.payload(first_turn);
        self.sight.advance();
        if std::mem::take(&mut self.single) {
            self.skip_to(now);
        }
        self.send(now, &payload);
    }

    /// Drivers speak of a sequence of parts (sicktoolbox): none is sent twice before the others.
    fn is_next_part(&mut self, turn: i64) -> bool {
        if self.single || self.mode != OperatingMode::StreamPartial {
            return true;
        }
        let turns = i64::from(self.variant.turns());
        let part = turn.rem_euclid(turns);
        let is_next = self.next_part.is_none_or(|next| next == part);
        if is_next {
            self.next_part = Some((part + 1) % turns);
        }
        is_next
    }

    fn payload(&mut self, first_turn: i64) -> Vec<u8> {
        let mode = if self.single { OperatingMode::StreamAll } else { self.mode };
        let unit = self.config.unit().unwrap_or(Unit::Centimetre);
        let word = |count: usize, turn: Option<u8>| count_word(count as u16, unit, turn).to_le_bytes();
        match mode {
            OperatingMode::StreamPartial => {
                let turns = i64::from(self.variant.turns());
                let index = first_turn.rem_euclid(turns) as u16;
                let values = self.measure_turn(first_turn, index);
                let quarter = (index * self.variant.resolution_cdeg / 25) as u8;
                self.finish(vec![0xB0], word(values.len(), Some(quarter)), &values)
            }
            OperatingMode::StreamMean(scans) => {
                let values = self.measure_mean(first_turn, scans.max(1));
                self.finish(vec![0xB6, scans], word(values.len(), None), &values)
            }
            OperatingMode::StreamSubrange(first, last) => {
                let all = self.measure(first_turn);
                let values = &all[usize::from(first) - 1..usize::from(last).min(all.len())];
                let [a, b] = first.to_le_bytes();
                let [c, d] = last.to_le_bytes();
                self.finish(vec![0xB7, a, b, c, d], word(values.len(), None), values)
            }
            OperatingMode::StreamMeanSubrange(scans, first, last) => {
                let all = self.measure_mean(first_turn, scans.max(1));
                let values = &all[usize::from(first) - 1..usize::from(last).min(all.len())];
                let [a, b] = first.to_le_bytes();
                let [c, d] = last.to_le_bytes();
                self.finish(vec![0xBF, scans, a, b, c, d], word(values.len(), None), values)
            }
            OperatingMode::StreamRemission(first, last) => self.with_remission(first_turn, first, last),
            OperatingMode::StreamReflectivity(first, last) => {
                let values = self.measure(first_turn);
                let mut payload = self.finish(vec![0xC4], word(values.len(), None), &values);
                payload.extend((last - first + 1).to_le_bytes());
                payload.extend(first.to_le_bytes());
                payload.extend(last.to_le_bytes());
                payload.extend((first..=last).map(|index| self.remission(values[usize::from(index) - 1]) as u8));
                payload
            }
            _ => {
                let values = self.measure(first_turn);
                self.finish(vec![0xB0], word(values.len(), None), &values)
            }
        }
    }

    /// The number of parts, first and last value, count word; range and remission of each value.
    fn with_remission(&mut self, first_turn: i64, first: u16, last: u16) -> Vec<u8> {
        let values = self.measure(first_turn);
        let values = &values[usize::from(first) - 1..usize::from(last).min(values.len())];
        let unit = self.config.unit().unwrap_or(Unit::Centimetre);
        let words = [1, first, last, count_word(values.len() as u16, unit, None)];
        let pairs = values.iter().flat_map(|value| [*value, self.remission(*value)]);
        std::iter::once(0xF5).chain(words.into_iter().chain(pairs).flat_map(u16::to_le_bytes)).collect()
    }

    /// Brightness of what was hit, 0 to 255, as a plain falling function of distance; 0 for nothing.
    fn remission(&self, value: u16) -> u16 {
        let per_metre = self.config.unit().unwrap_or(Unit::Centimetre).per_metre();
        let range_m = f32::from(value) / per_metre;
        if value >= self.format().beyond_maximum() { 0 } else { (255.0 - 25.0 * range_m).max(10.0) as u16 }
    }

    /// How ranges are written; where the measuring mode has none, as in mode 0.
    fn format(&self) -> ValueFormat {
        ValueFormat::of_mode(self.config.measuring_mode()).unwrap_or(ValueFormat { mask: 0x1FFF })
    }

    /// Count word, values, and the real-time index if it is switched on.
    fn finish(&mut self, mut payload: Vec<u8>, word: [u8; 2], values: &[u16]) -> Vec<u8> {
        payload.extend(word);
        payload.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        if self.config.availability() & 2 != 0 {
            self.telegrams = (self.next_group * self.group_turns()) as u8;
            payload.push(self.telegrams);
        }
        payload
    }

    /// A whole scan, its turns interlaced.
    fn measure(&mut self, first_turn: i64) -> Vec<u16> {
        let turns = self.variant.turns();
        let by_turn: Vec<Vec<u16>> =
            (0..turns).map(|index| self.measure_turn(first_turn + i64::from(index), index)).collect();
        (0..usize::from(self.variant.values()))
            .map(|value| by_turn[value % usize::from(turns)][value / usize::from(turns)])
            .collect()
    }

    fn measure_mean(&mut self, first_turn: i64, scans: u8) -> Vec<u16> {
        let turns = i64::from(self.variant.turns());
        let all: Vec<Vec<u16>> = (0..i64::from(scans)).map(|scan| self.measure(first_turn + scan * turns)).collect();
        let mask = self.format().mask;
        let mean = |value: usize| all.iter().map(|scan| u32::from(scan[value] & mask)).sum::<u32>() / u32::from(scans);
        (0..usize::from(self.variant.values())).map(|value| mean(value) as u16).collect()
    }

    /// One turn: a beam every degree, `index` steps of the resolution after whole degrees.
    fn measure_turn(&mut self, turn: i64, index: u16) -> Vec<u16> {
        let start_cdeg = self.variant.start_deg() * 100 + index * self.variant.resolution_cdeg;
        let quarter = (index * self.variant.resolution_cdeg / 25) as u8;
        let count = self.variant.values_of_turn(quarter);
        (0..count).map(|beam| self.measure_beam(turn, start_cdeg + beam * 100)).collect()
    }

    fn measure_beam(&mut self, turn: i64, angle_cdeg: u16) -> u16 {
        let within = 1_000_000 / TURNS_PER_SECOND * i64::from(angle_cdeg) / 36_000;
        let at = turn_start(turn) + Duration::from_micros(within);
        let bearing_rad = (f64::from(angle_cdeg) / 100.0 - 90.0).to_radians();
        let format = self.format();
        let beyond = format.beyond_maximum();
        let per_metre = f64::from(self.config.unit().unwrap_or(Unit::Centimetre).per_metre());
        let range = match self.sight.measure(at, bearing_rad) {
            Reading::Nothing => beyond,
            // Dazzled, or a weak signal.
            Reading::Failed(pick) => format.mask - if pick % 4 == 0 { 1 } else { 4 },
            Reading::Range(range_m) => ((range_m * per_metre).round().max(1.0) as u32).min(u32::from(beyond)) as u16,
        };
        let mode = self.config.measuring_mode();
        if GIVES_REFLECTIVITY.contains(&mode) {
            return self.remission(range);
        }
        // What is no reflector stays in the lowest quarter.
        let brightness = match range < beyond {
            true if self.sight.is_reflector(at, bearing_rad) => u8::MAX,
            true => (self.remission(range) / 4) as u8,
            false => 0,
        };
        range | level(mode, brightness)
    }
}
