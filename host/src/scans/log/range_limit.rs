//! Finding the range from which on a log's ranges mean "nothing seen".
//!
//! Most logs do not say it, yet a wall taken from such a value ruins a map. The rules, strongest first:
//! 1. what the caller says;
//! 2. a value that devices use for "nothing" ([`BANDS`]), when it is the largest seen so far, [`BAND_BEAMS`] times;
//! 3. any value from [`RUN_FROM_M`] on that is the largest so far and stands in neighbouring beams over [`RUN_RAD`]
//!    unchanged: only a circle around the laser would look so;
//! 4. what the log declares; where 2 or 3 find less than that, the smaller value counts (CARMEN logs declare 81.92 m
//!    and contain 81.83);
//! 5. with no sign at all: [`FALLBACK_M`].
//!
//! The rules look at every scan, the first ones before the first is handed out. What 2 or 3 found is dropped when a
//! clearly larger range turns up: the device can say more. Comparisons allow for [`TOLERANCE_M`], half of the finest
//! unit in logs.

/// Ranges this near to the limit reach it, m.
pub(super) const TOLERANCE_M: f32 = 0.000_5;

/// What devices say for "nothing seen", from–to in m; the limit is the lower end.
///
/// SICK LMS2xx codes (the last nine values of the 13, 14 and 15 bit ranges, in mm or cm: telegram manual, measured
/// value overflow and errors); 30, 50, 51.15 (51.14 to 51.25), 80 m as capped by recorders; Hokuyo UTM-30LX 65.533 m.
const BANDS: [Band; 9] = [
    (8.183, 8.192),
    (16.375, 16.384),
    (30.0, 30.0),
    (32.759, 32.768),
    (50.0, 50.0),
    (51.14, 51.25),
    (65.533, 65.535),
    (80.0, 80.0),
    (81.83, 81.92),
];

const BAND_BEAMS: usize = 5;
const RUN_RAD: f32 = 10.0 * std::f32::consts::PI / 180.0;
const RUN_BEAMS: usize = 6;
/// No laser range finder sees less far (Hokuyo URG-04LX: 4 m guaranteed).
const RUN_FROM_M: f32 = 4.0;

/// The farthest that a SICK LMS2xx can say.
const FALLBACK_M: f32 = 81.83;

/// Values that mean "nothing" lie within this factor of each other, if no band says more.
const SAME_KIND: f32 = 1.05;

/// Larger ranges are errors of the log, and prove nothing.
const BELIEVED_M: f32 = 200.0;

/// From–to, m: these values mean "nothing seen".
type Band = (f32, f32);

/// What the range from which on nothing was seen is known from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum LimitOrigin {
    /// The caller says it.
    Told,
    /// The log declares it.
    Declared,
    /// The ranges show it.
    Shown,
    /// Nothing tells it: the farthest that any laser here can say.
    #[default]
    Guessed,
}

/// What a log's ranges are like, as they stand there.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RangeNotes {
    /// Where the limit comes from.
    pub limit: LimitOrigin,
    /// Median of the positive ranges of the first scan that has any, m if the log has metres; 0 if none has.
    pub typical: f32,
    /// Ranges that are finite.
    pub finite: u64,
    /// Of these, those farther than any laser sees.
    pub beyond: u64,
}

/// The limit, as far as it is known.
#[derive(Debug, Clone, Default)]
pub(super) struct RangeLimit {
    given_m: Option<f32>,
    declared_m: Option<f32>,
    found: Option<Band>,
    /// Of all scans, m.
    largest_m: f32,
    /// The band in which the largest range lies, and how many ranges did so far.
    counted: Option<(Band, usize)>,
    notes: RangeNotes,
}

impl RangeLimit {
    /// `given_m`: what the caller says.
    pub fn new(given_m: Option<f32>) -> Self {
        Self { given_m, ..Self::default() }
    }

    /// Takes a scan into account: its ranges (m), angle between beams and what the log declares.
    pub fn observe(&mut self, ranges_m: &[f32], step_rad: f32, declared_m: Option<f32>) {
        self.declared_m = declared_m.or(self.declared_m);
        self.note(ranges_m);
        let largest_m = ranges_m.iter().copied().filter(|&range| range <= BELIEVED_M).fold(0.0, f32::max);
        self.largest_m = self.largest_m.max(largest_m);
        if self.found.is_some_and(|(_, to)| largest_m > to + TOLERANCE_M) {
            self.found = None;
        }
        if self.found.is_none() {
            self.found = self.in_band(ranges_m).or_else(|| in_run(ranges_m, self.largest_m, step_rad));
        }
    }

    /// Ranges from here on are misses, m.
    pub fn range_max_m(&self) -> f32 {
        let found_m = self.found.map(|(from, _)| from);
        let read = [self.declared_m, found_m].into_iter().flatten().reduce(f32::min);
        self.given_m.or(read).unwrap_or(FALLBACK_M)
    }

    /// What the ranges are like, so far.
    pub fn notes(&self) -> RangeNotes {
        let found_m = self.found.map(|(from, _)| from);
        let limit = match (self.given_m, self.declared_m, found_m) {
            (Some(_), ..) => LimitOrigin::Told,
            (None, Some(declared_m), Some(found_m)) if declared_m <= found_m => LimitOrigin::Declared,
            (None, Some(_), None) => LimitOrigin::Declared,
            (None, _, Some(_)) => LimitOrigin::Shown,
            (None, None, None) => LimitOrigin::Guessed,
        };
        RangeNotes { limit, ..self.notes }
    }

    fn note(&mut self, ranges_m: &[f32]) {
        let finite = ranges_m.iter().filter(|range| range.is_finite());
        self.notes.finite += finite.clone().count() as u64;
        self.notes.beyond += finite.clone().filter(|&&range| range > BELIEVED_M).count() as u64;
        if self.notes.typical == 0.0 {
            let mut positive: Vec<f32> = finite.copied().filter(|&range| range > 0.0).collect();
            positive.sort_by(f32::total_cmp);
            self.notes.typical = positive.get(positive.len() / 2).copied().unwrap_or(0.0);
        }
    }

    /// Rule 2.
    fn in_band(&mut self, ranges_m: &[f32]) -> Option<Band> {
        let band = BANDS.into_iter().find(|&band| inside(self.largest_m, band))?;
        let before = self.counted.filter(|&(counted, _)| counted == band).map_or(0, |(_, count)| count);
        let count = before + ranges_m.iter().filter(|&&range| inside(range, band)).count();
        self.counted = Some((band, count));
        (count >= BAND_BEAMS).then_some(band)
    }
}

fn inside(range_m: f32, (from, to): Band) -> bool {
    range_m >= from - TOLERANCE_M && range_m <= to + TOLERANCE_M
}

/// Rule 3.
fn in_run(ranges_m: &[f32], largest_m: f32, step_rad: f32) -> Option<Band> {
    if largest_m < RUN_FROM_M {
        return None;
    }
    let needed = ((RUN_RAD / step_rad.abs()) as usize).saturating_add(1).max(RUN_BEAMS);
    let mut runs = ranges_m.chunk_by(|a, b| a == b);
    let found = runs.any(|run| run.first() == Some(&largest_m) && run.len() >= needed);
    found.then_some((largest_m, largest_m * SAME_KIND))
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
        assert_eq!(limit(&[scan(&[50.0]), scan(&[50.0; 2]), scan(&[9.0]), scan(&[50.0; 2])], None), 50.0);
        assert_eq!(limit(&[scan(&[50.0; 4])], None), FALLBACK_M);
    }

    #[test]
    fn larger_ranges_refute_what_was_found() {
        assert_eq!(limit(&[scan(&[8.191; 5]), scan(&[81.91; 5])], None), 81.83);
        assert_eq!(limit(&[scan(&[8.19; 5]), scan(&[12.0])], None), FALLBACK_M, "the room was just 8.19 m long");
        assert_eq!(limit(&[scan(&[29.99; 11]), scan(&[40.0])], None), FALLBACK_M);
        assert_eq!(limit(&[scan(&[50.0; 5]), scan(&[1e5])], None), 50.0, "an error of the log");
    }

    #[test]
    fn unusual_value_is_recognised_by_its_circle() {
        assert_eq!(limit(&[scan(&[29.99; 11])], None), 29.99);
        assert_eq!(limit(&[scan(&[29.99; 9])], None), FALLBACK_M, "a wall could look so");
        assert_eq!(limit(&[vec![3.0; 90]], None), FALLBACK_M, "no laser ends there");
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
