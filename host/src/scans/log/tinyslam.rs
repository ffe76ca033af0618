//! tinySLAM's sample log: a Hokuyo URG-04LX on a robot with two driven wheels, one scan a line, all numbers.
//!
//! Column 1 is the time in µs, columns 3 and 4 are ticks of the left and the right wheel, columns 26 to 707 the 682
//! ranges in mm. (683 numbers follow the 24 columns of the robot's state, the first of them always zero and set apart
//! by a second blank; tinySLAM reads from there and drops the last one, which turns its scans by 0.35°.)
//! Below 20 mm stands not a range but an error code of the device: an invalid beam, and so is 0, since this URG sees
//! 5.6 m at most and says 0 where it is dazzled as well as where there is nothing.
//!
//! Odometry is integrated from the ticks: a wheel of 77 mm makes one turn in 2000 of them (checked against ranges ahead
//! on straight stretches), wheels 2 · 165 mm apart, midpoint rule. The laser sits 145 mm ahead of the axle.
//!
//! Source: tinySLAM's `test` data and BreezySLAM's `mines` robot (wheels, 145 mm); Hokuyo URG-04LX communication
//! protocol SCIP 2.0 (682 steps of 1/1024 turn, error codes below 20, 100 ms a turn).

use std::f64::consts::TAU;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::time::{Duration, Instant};

use super::raw::{Content, LineReader, RawScan};
use crate::input::text::{FieldFault, Line, Words, fault};
use crate::pose_f64::PoseF64;

const BEAMS: usize = 682;
/// Columns in front of the ranges.
const STATE_COLUMNS: usize = 25;
const RANGE_MAX_M: f32 = 5.6;
/// Smaller values are error codes.
const RANGE_MIN_MM: f32 = 20.0;
/// 100 ms / 1024 steps.
const BEAM_INTERVAL: Duration = Duration::from_micros(98);
const WHEEL_RADIUS_M: f64 = 0.077;
const TICKS_PER_TURN: f64 = 2000.0;
const HALF_AXLE_M: f64 = 0.165;
const ROBOT_FROM_LRF: Pose2 = Pose2 { x: 0.145, y: 0.0, heading: 0.0 };

#[derive(Debug, Default)]
pub(super) struct TinySlamReader {
    odometry_from_robot: PoseF64,
    ticks: Option<[f64; 2]>,
}

/// True if `text` is a line of this format: as many columns, and numbers where it matters.
pub(super) fn is_tinyslam(text: &str) -> bool {
    let mut words = Words::new(text);
    words.left() == STATE_COLUMNS + BEAMS && (0..4).all(|_| words.finite("").is_ok())
}

impl LineReader for TinySlamReader {
    fn read(&mut self, line: &Line<'_>) -> Result<Content, FieldFault> {
        let mut words = Words::new(&line.text);
        let stamp = words.parse(|| "1 (time)".to_owned(), "a whole number of µs").map(Instant::from_micros)?;
        let _status = words.finite("2")?;
        let ticks = [words.finite("3 (left wheel)")?, words.finite("4 (right wheel)")?];
        for column in 5..=STATE_COLUMNS {
            let _state = words.finite(&column.to_string())?;
        }
        let mut scan = RawScan::new(line.number, ranges(&mut words)?);
        self.advance(ticks);
        scan.stamp = Some(stamp);
        scan.range_max_m = Some(RANGE_MAX_M);
        scan.beam_interval = BEAM_INTERVAL;
        scan.odometry_from_robot = Some(self.odometry_from_robot);
        scan.robot_from_lrf = Some(ROBOT_FROM_LRF);
        Ok(Content::Scan(Box::new(scan)))
    }
}

impl TinySlamReader {
    /// Moves the odometry to where the wheels stand at `ticks` (left, right).
    fn advance(&mut self, ticks: [f64; 2]) {
        let before = self.ticks.replace(ticks).unwrap_or(ticks);
        let rolled = |ticks: f64, before: f64| (ticks - before) * TAU * WHEEL_RADIUS_M / TICKS_PER_TURN;
        let (left_m, right_m) = (rolled(ticks[0], before[0]), rolled(ticks[1], before[1]));
        let forward_m = (left_m + right_m) / 2.0;
        let turn_rad = (right_m - left_m) / (2.0 * HALF_AXLE_M);
        let (sin, cos) = (turn_rad / 2.0).sin_cos();
        let step = PoseF64::new(forward_m * cos, forward_m * sin, turn_rad);
        self.odometry_from_robot = self.odometry_from_robot.then(step);
    }
}

fn ranges(words: &mut Words<'_>) -> Result<Vec<f32>, FieldFault> {
    let range = |column: usize| words.parse::<f32>(|| format!("{column} (range)"), "a number (mm)");
    let ranges_mm: Vec<f32> = (STATE_COLUMNS + 1..=STATE_COLUMNS + BEAMS).map(range).collect::<Result<_, _>>()?;
    if let Some(more) = words.word() {
        return Err(fault((STATE_COLUMNS + BEAMS + 1).to_string(), "the end of the line", Some(more)));
    }
    Ok(ranges_mm.into_iter().map(|mm| if mm < RANGE_MIN_MM { f32::NAN } else { mm / 1000.0 }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(left: i32, right: i32) -> String {
        let ranges: Vec<String> = (0..BEAMS).map(|i| (i * 5).to_string()).collect();
        format!("5000 1 {left} {right} {}0  {}", "0 ".repeat(20), ranges.join(" "))
    }

    fn scan(reader: &mut TinySlamReader, text: &str) -> RawScan {
        assert!(is_tinyslam(text));
        let Ok(Content::Scan(scan)) = reader.read(&Line { number: 1, text: text.into(), ended: true }) else {
            panic!()
        };
        *scan
    }

    #[test]
    fn line_gives_time_ranges_and_mounting() {
        let scan = scan(&mut TinySlamReader::default(), &line(0, 0));
        assert_eq!(scan.stamp, Some(Instant::from_micros(5000)));
        assert!(scan.ranges_m[3].is_nan(), "15 is an error code");
        assert_eq!((scan.ranges_m.len(), scan.ranges_m[4], scan.ranges_m[681]), (682, 0.02, 3.405));
        assert_eq!(scan.robot_from_lrf, Some(ROBOT_FROM_LRF));
    }

    #[test]
    fn one_turn_of_both_wheels_drives_their_circumference() {
        let mut reader = TinySlamReader::default();
        scan(&mut reader, &line(100, 200));
        let moved = scan(&mut reader, &line(2100, 2200)).odometry_from_robot.unwrap();
        assert!((moved.x - TAU * 0.077).abs() < 1e-9 && moved.y.abs() < 1e-9 && moved.heading.abs() < 1e-9);
        let turned = scan(&mut reader, &line(2000, 2300)).odometry_from_robot.unwrap();
        assert!((turned.heading - 200.0 * TAU * 0.077 / 2000.0 / 0.33).abs() < 1e-9, "right wheel ahead turns left");
    }

    #[test]
    fn other_lines_are_not_taken_for_it() {
        assert!(!is_tinyslam("1 2 3 4"));
        assert!(!is_tinyslam(&line(0, 0).replacen("5000", "FLASER", 1)));
        let short = line(0, 0).replace(" 3405", " x");
        let error = TinySlamReader::default().read(&Line { number: 1, text: short.into(), ended: true }).unwrap_err();
        assert_eq!(error.field, "707 (range)");
    }
}
