//! Finding the range from which on a log's ranges mean "nothing seen".
//!
//! Most logs do not say it, yet a wall taken from such a value ruins a map. The rules, strongest first:
//! 1. what the caller says;
//! 2. a value that the device uses for "nothing" ([`BANDS`]), when the largest range of a scan lies there and at least
//!    [`BAND_BEAMS`] of its beams do;
//! 3. any value that is the largest so far and stands in neighbouring beams over [`RUN_RAD`] unchanged: only a circle
//!    around the laser would look so;
//! 4. what the log declares; where 2 or 3 find less than that, the smaller value counts (CARMEN logs declare 81.92 m
//!    and contain 81.83);
//! 5. with no sign at all: [`FALLBACK_M`].
//!
//! The rules look at every scan, the first ones before the first is handed out. A value once found yields only to a
//! clearly larger one. Comparisons allow for [`TOLERANCE_M`], half of the finest unit in logs.

/// Ranges this near to the limit reach it, m.
pub(super) const TOLERANCE_M: f32 = 0.000_5;

/// What devices say for "nothing seen", from–to in m; the limit is the lower end.
///
/// SICK LMS2xx codes (the last nine values of the 13, 14 and 15 bit ranges, in mm or cm: telegram manual, measured
/// value overflow and errors); 30, 50, 80 m as capped by recorders; Hokuyo UTM-30LX 65.533 m.
const BANDS: [(f32, f32); 8] = [
    (8.183, 8.192),
    (16.375, 16.384),
    (30.0, 30.0),
    (32.759, 32.768),
    (50.0, 50.0),
    (65.533, 65.535),
    (80.0, 80.0),
    (81.83, 81.92),
];

const BAND_BEAMS: usize = 5;
const RUN_RAD: f32 = 10.0 * std::f32::consts::PI / 180.0;
const RUN_BEAMS: usize = 6;

/// The farthest that a SICK LMS2xx can say.
const FALLBACK_M: f32 = 81.83;

/// A limit found replaces one that is smaller by this factor.
const CLEARLY_LARGER: f32 = 1.05;

/// The limit, as far as it is known.
#[derive(Debug, Clone, Default)]
pub(super) struct RangeLimit {
    given_m: Option<f32>,
    declared_m: Option<f32>,
    found_m: Option<f32>,
    largest_m: f32,
}

impl RangeLimit {
    /// `given_m`: what the caller says.
    pub fn new(given_m: Option<f32>) -> Self {
        Self { given_m, ..Self::default() }
    }

    /// Takes a scan into account: its ranges (m), angle between beams and what the log declares.
    pub fn observe(&mut self, ranges_m: &[f32], step_rad: f32, declared_m: Option<f32>) {
        self.declared_m = declared_m.or(self.declared_m);
        let largest_m = ranges_m.iter().copied().filter(|r| r.is_finite()).fold(0.0, f32::max);
        if largest_m < self.largest_m - TOLERANCE_M {
            return;
        }
        self.largest_m = self.largest_m.max(largest_m);
        let found = in_band(ranges_m, largest_m).or_else(|| in_run(ranges_m, largest_m, step_rad));
        if found.is_some_and(|new| self.found_m.is_none_or(|old| new > old * CLEARLY_LARGER)) {
            self.found_m = found;
        }
    }

    /// Ranges from here on are misses, m.
    pub fn range_max_m(&self) -> f32 {
        let read = [self.declared_m, self.found_m].into_iter().flatten().reduce(f32::min);
        self.given_m.or(read).unwrap_or(FALLBACK_M)
    }
}

/// Rule 2.
fn in_band(ranges_m: &[f32], largest_m: f32) -> Option<f32> {
    let inside = |range: f32, (from, to): (f32, f32)| range >= from - TOLERANCE_M && range <= to + TOLERANCE_M;
    let band = BANDS.into_iter().find(|&band| inside(largest_m, band))?;
    (ranges_m.iter().filter(|&&range| inside(range, band)).count() >= BAND_BEAMS).then_some(band.0)
}

/// Rule 3.
fn in_run(ranges_m: &[f32], largest_m: f32, step_rad: f32) -> Option<f32> {
    let needed = ((RUN_RAD / step_rad.abs()) as usize).saturating_add(1).max(RUN_BEAMS);
    let same = |a: &f32, b: &f32| a == b;
    ranges_m.chunk_by(same).any(|run| run.first() == Some(&largest_m) && run.len() >= needed).then_some(largest_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f32 = std::f32::consts::PI / 180.0;

    fn limit(scans: &[Vec<f32>], declared: Option<f32>) -> f32 {
        let mut limit = RangeLimit::new(None);
        scans.iter().for_each(|scan| limit.observe(scan, STEP, declared));
        limit.range_max_m()
    }

    fn scan(tail: &[f32]) -> Vec<f32> {
        let mut ranges: Vec<f32> = (0..90).map(|i| 2.0 + 0.01 * i as f32).collect();
        ranges.extend(tail);
        ranges
    }

    #[test]
    fn usual_values_are_recognised() {
        assert_eq!(limit(&[scan(&[81.83; 5])], None), 81.83);
        assert_eq!(limit(&[scan(&[50.0; 7])], None), 50.0);
        assert_eq!(limit(&[scan(&[8.183, 8.183_001, 8.187, 8.191, 8.183])], None), 8.183);
        assert_eq!(limit(&[scan(&[8.191; 5]), scan(&[81.91; 5])], None), 81.83, "the larger band wins");
    }

    #[test]
    fn unusual_value_is_recognised_by_its_circle() {
        assert_eq!(limit(&[scan(&[29.99; 11])], None), 29.99);
        assert_eq!(limit(&[scan(&[29.99; 9])], None), FALLBACK_M, "a wall could look so");
        assert_eq!(limit(&[scan(&[12.0]), scan(&[7.0; 30])], None), FALLBACK_M, "farther ranges were seen");
        assert_eq!(limit(&[scan(&[29.99; 11]), scan(&[30.01; 11])], None), 29.99);
    }

    #[test]
    fn declared_maximum_is_lowered_but_never_raised() {
        assert_eq!(limit(&[scan(&[81.83; 9])], Some(81.92)), 81.83);
        assert_eq!(limit(&[scan(&[81.91; 9])], Some(50.0)), 50.0);
        assert_eq!(limit(&[scan(&[])], Some(20.0)), 20.0);
        let mut given = RangeLimit::new(Some(12.0));
        given.observe(&scan(&[81.83; 9]), STEP, Some(50.0));
        assert_eq!(given.range_max_m(), 12.0);
    }

    #[test]
    fn strange_numbers_are_passed_over() {
        let odd = vec![f32::NAN, f32::INFINITY, -1.0, 0.0];
        assert_eq!(limit(&[odd, vec![]], None), FALLBACK_M);
        RangeLimit::new(None).observe(&[1.0; 50], 0.0, None);
    }
}
