//! Log of a car with a YDLIDAR X4, one turn of the laser a line, numbers between commas.
//!
//! ```text
//! distance, turn, elapsed, range, range, …
//! ```
//! Since the line before: mm driven, degrees turned clockwise, seconds. Then the ranges of a turn, m, evenly over 360° and
//! clockwise as this laser spins, the first one backwards. Nearly every line has another number of them. What the first line says of
//! motion and time began with the program, and is not read. Below 0.25 m stands no range: 0 is nothing seen, other values are the
//! laser's when dazzled. It sees 10 m; values beyond all reason are errors. A line after twice the usual time has two turns in order
//! of bearing: the times of its beams are not known.
//!
//! The odometry is poor: distances have no sign and are some 1.7 times too short, turns are late by a line or two, or missing.
//!
//! Source: B. Wood's YDLIDAR X4 data set (columns) and the drive of his robot (units, right is positive); YDLIDAR X4 data sheet.

use std::f32::consts::{PI, TAU};

use lrfslam_core::time::{Duration, Instant};

use super::raw::{BEAMS_MAX, Bearings, Content, LineReader, RawScan};
use crate::input::text::{FieldFault, Line, fault};
use crate::pose_f64::PoseF64;

/// Columns in front of the ranges.
const STATE_COLUMNS: usize = 3;
/// Fewer ranges are no turn of such a laser.
const BEAMS_MIN: usize = 10;
/// Nearer than this is no range, m.
const RANGE_MIN_M: f32 = 0.25;
/// The maker's, m.
const RANGE_MAX_M: f32 = 10.0;
/// Farther than this is no range at all, m.
const RANGE_BELIEVED_M: f32 = 100.0;
/// A turn takes 0.13 s: what takes longer is more than one.
const TURN_S: f64 = 0.18;

/// Adds up lines.
#[derive(Debug, Default)]
pub(super) struct YdlidarReader {
    odometry_from_robot: PoseF64,
    /// When the line before came, s; `None` before the first.
    time_s: Option<f64>,
}

/// True if `text` is a line of this format: numbers between commas, enough of them.
pub(super) fn is_ydlidar(text: &str) -> bool {
    let is_number = |word: &str| word.trim().parse::<f64>().is_ok_and(f64::is_finite);
    text.split(',').count() >= STATE_COLUMNS + BEAMS_MIN && text.split(',').take(STATE_COLUMNS + 1).all(is_number)
}

impl LineReader for YdlidarReader {
    fn read(&mut self, line: &Line<'_>) -> Result<Content, FieldFault> {
        let mut words = line.text.split(',').map(str::trim);
        let mut number = |name: &str| {
            let word = words.next();
            let value = word.and_then(|word| word.parse::<f64>().ok()).filter(|value| value.is_finite());
            value.ok_or_else(|| fault(name.to_owned(), "a finite number", word))
        };
        let (distance_mm, turn_deg) = (number("1 (distance)")?, number("2 (turn)")?);
        let elapsed_s = number("3 (elapsed)")?;
        if elapsed_s < 0.0 {
            return Err(fault("3 (elapsed)".to_owned(), "seconds since the line before", Some(&elapsed_s.to_string())));
        }
        let mut scan = RawScan::new(line.number, ranges(words)?);
        self.advance(distance_mm, turn_deg, elapsed_s);
        let step_rad = TAU / scan.ranges_m.len() as f32;
        scan.bearings = Some(Bearings { first_rad: PI, step_rad: -step_rad });
        let is_one_turn = elapsed_s <= TURN_S;
        let beam_us = 1e6 * elapsed_s / scan.ranges_m.len() as f64;
        scan.beam_interval = if is_one_turn { Duration::from_micros(beam_us as i64) } else { Duration::ZERO };
        scan.stamp = self.time_s.map(Instant::from_secs_f64);
        scan.range_max_m = Some(RANGE_MAX_M);
        scan.odometry_from_robot = Some(self.odometry_from_robot);
        Ok(Content::Scan(Box::new(scan)))
    }
}

impl YdlidarReader {
    /// Moves clock and odometry to where they are at the end of a line.
    fn advance(&mut self, distance_mm: f64, turn_deg: f64, elapsed_s: f64) {
        match &mut self.time_s {
            None => self.time_s = Some(0.0),
            Some(time_s) => {
                *time_s += elapsed_s;
                let step = PoseF64::new(distance_mm / 1000.0, 0.0, -turn_deg.to_radians());
                self.odometry_from_robot = self.odometry_from_robot.then(step);
            }
        }
    }
}

fn ranges<'w>(words: impl Iterator<Item = &'w str>) -> Result<Vec<f32>, FieldFault> {
    let range = |(index, word): (usize, &str)| match word.parse() {
        Ok(range_m) if (RANGE_MIN_M..=RANGE_BELIEVED_M).contains(&range_m) => Ok(range_m),
        Ok(_) => Ok(f32::NAN),
        Err(_) => Err(fault(format!("{} (range)", STATE_COLUMNS + 1 + index), "a number (m)", Some(word))),
    };
    let ranges_m: Vec<f32> = words.enumerate().map(range).collect::<Result<_, _>>()?;
    if (BEAMS_MIN..=BEAMS_MAX).contains(&ranges_m.len()) {
        return Ok(ranges_m);
    }
    let expected = format!("{BEAMS_MIN} to {BEAMS_MAX} of them");
    Err(fault("ranges".to_owned(), &expected, Some(&ranges_m.len().to_string())))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(distance: &str, turn: &str, elapsed: &str, ranges: usize) -> String {
        let ranges: Vec<String> = (0..ranges).map(|i| format!("{}", i as f64 * 0.125)).collect();
        format!("{distance}, {turn}, {elapsed}, {}", ranges.join(", "))
    }

    fn scan(reader: &mut YdlidarReader, text: &str) -> RawScan {
        assert!(is_ydlidar(text));
        let Ok(Content::Scan(scan)) = reader.read(&Line { number: 1, text: text.into(), ended: true }) else {
            panic!()
        };
        *scan
    }

    #[test]
    fn turns_of_any_number_of_ranges_go_all_round_clockwise() {
        let mut reader = YdlidarReader::default();
        for beams in [20, 33, 120] {
            let scan = scan(&mut reader, &line("0.0", "0.0", "0.12", beams));
            let bearings = scan.bearings.unwrap();
            assert_eq!((scan.ranges_m.len(), bearings.first_rad), (beams, PI));
            assert!((bearings.of(beams) + PI).abs() < 1e-4, "the next one would be the first of the next turn");
            assert!(scan.ranges_m[0].is_nan() && scan.ranges_m[1].is_nan() && scan.ranges_m[2] == 0.25);
            assert_eq!(scan.beam_interval.micros, (120_000 / beams) as i64);
        }
        let scan = scan(&mut reader, &line("0.0", "0.0", "0.26", 120));
        assert_eq!(scan.beam_interval, Duration::ZERO, "two turns");
    }

    #[test]
    fn time_and_way_begin_at_the_first_line() {
        let mut reader = YdlidarReader::default();
        let first = scan(&mut reader, &line("500.0", "-754.3", "89.2", 20));
        assert_eq!((first.stamp, first.odometry_from_robot), (Some(Instant::default()), Some(PoseF64::default())));
        let driven = scan(&mut reader, &line("100.0", "0.0", "0.125", 20));
        assert_eq!(driven.stamp, Some(Instant::from_micros(125_000)));
        assert!((driven.odometry_from_robot.unwrap().x - 0.1).abs() < 1e-9);
        let turned = scan(&mut reader, &line("0.0", "90.0", "0.125", 20)).odometry_from_robot.unwrap();
        assert!((turned.heading + std::f64::consts::FRAC_PI_2).abs() < 1e-9, "to the right");
    }

    #[test]
    fn other_lines_are_not_taken_for_it_and_wrong_ones_name_the_field() {
        assert!(!is_ydlidar("1, 2, 3, 4") && !is_ydlidar(&line("x", "0", "0", 20)));
        let wrong = |text: String| {
            let error = YdlidarReader::default().read(&Line { number: 1, text: text.into(), ended: true }).unwrap_err();
            error.to_string()
        };
        assert!(wrong(line("0", "0", "-1", 20)).contains("3 (elapsed)"));
        assert!(wrong(line("0", "y", "1", 20)).contains("2 (turn)"));
        assert!(wrong(line("0", "0", "1", 20).replace(" 0.5,", " z,")).contains("8 (range)"));
        assert!(wrong(line("0", "0", "1", 5)).contains("10 to 20000"));
    }
}
