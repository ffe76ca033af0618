//! CARMEN's text logs: one message a line, its name first.
//!
//! ```text
//! FLASER n r… laser_x laser_y laser_θ robot_x robot_y robot_θ t host logger_t
//! ROBOTLASER1 type start_angle fov angular_res max_range accuracy remission_mode n r… m remission… laser_pose(3)
//!             robot_pose(3) tv rv forward_safety side_safety turn_axis t host logger_t
//! PARAM name value … t host logger_t
//! ODOM x y θ tv rv accel t host logger_t
//! ```
//! Metres, radians, seconds; beams counter-clockwise. The poses are odometry. A log that carries both kinds of scan
//! carries each scan twice: the kind met first is read, the other one skipped. Of `PARAM` only a name that ends in
//! `laser_max_range` matters; `ODOM` repeats what the scans carry. Everything else (`SYNC`, `RAWLASER1`, `RLASER`, …)
//! is counted as skipped.
//!
//! Source: the comment block that CARMEN's logger writes at the head of its files; `logger_playback` manual.

use super::raw::{Bearings, Content, LineReader, RawScan, beam_count, pose, ranges};
use crate::input::text::{FieldFault, Line, Words, fault};
use lrfslam_core::time::Instant;

/// Message names that prove a file to be a CARMEN log.
const KINDS: [&str; 12] = [
    "FLASER",
    "RLASER",
    "ROBOTLASER1",
    "ROBOTLASER2",
    "RAWLASER1",
    "RAWLASER2",
    "LASER3",
    "LASER4",
    "ODOM",
    "PARAM",
    "SYNC",
    "TRUEPOS",
];

/// Fields of a `FLASER` line behind its ranges, without and with host and logger's time.
const FLASER_TAIL: std::ops::RangeInclusive<usize> = 7..=9;
/// As many if the host is the last of them.
const HOST_LAST: usize = 8;

#[derive(Debug, Default)]
pub(super) struct CarmenReader {
    scan_kind: Option<&'static str>,
    range_max_m: Option<f32>,
}

/// True if `first_word` is the name of a CARMEN message.
pub(super) fn is_carmen(first_word: &str) -> bool {
    KINDS.contains(&first_word)
}

impl LineReader for CarmenReader {
    fn read(&mut self, line: &Line<'_>) -> Result<Content, FieldFault> {
        let mut words = Words::new(&line.text);
        match words.word() {
            Some("FLASER") if self.takes("FLASER") => self.scan(flaser(&mut words, line)?),
            Some("ROBOTLASER1") if self.takes("ROBOTLASER1") => self.scan(robot_laser(&mut words, line.number)?),
            Some("PARAM") => Ok(self.parameter(&mut words)),
            Some("ODOM") => Ok(Content::Other),
            _ => Ok(Content::Unknown),
        }
    }
}

impl CarmenReader {
    /// True if scans are of this `kind`: the first one decides.
    fn takes(&mut self, kind: &'static str) -> bool {
        *self.scan_kind.get_or_insert(kind) == kind
    }

    fn scan(&self, mut scan: RawScan) -> Result<Content, FieldFault> {
        scan.range_max_m = scan.range_max_m.or(self.range_max_m);
        Ok(Content::Scan(Box::new(scan)))
    }

    fn parameter(&mut self, words: &mut Words<'_>) -> Content {
        if words.word().is_some_and(|name| name.ends_with("laser_max_range")) {
            let value = words.word().and_then(|word| word.parse().ok());
            self.range_max_m = value.filter(|&range: &f32| range.is_finite() && range > 0.0).or(self.range_max_m);
        }
        Content::Other
    }
}

fn flaser(words: &mut Words<'_>, line: &Line<'_>) -> Result<RawScan, FieldFault> {
    let count = beam_count(words)?;
    let mut scan = RawScan::new(line.number, ranges(words, count)?);
    // A wrong count of beams would else shift every field behind them; and a last line without its end was perhaps
    // cut in the midst of its time.
    let needed = if line.ended { *FLASER_TAIL.start() } else { *FLASER_TAIL.end() };
    let left = words.left();
    if !(needed..=*FLASER_TAIL.end()).contains(&left) {
        let expected = "7 to 9 fields behind the ranges (two poses, time, host, time)";
        return Err(fault(format!("{} and on", count + 3), expected, Some(&format!("{left} fields"))));
    }
    poses(words, &mut scan)?;
    scan.stamp = Some(time(words)?);
    // One range too many in a line that ends with its time looks like a line that ends with the host.
    if left == HOST_LAST && words.word().is_some_and(|host| host.parse::<f64>().is_ok()) {
        return Err(fault("host".to_owned(), "a name", Some("a number")));
    }
    Ok(scan)
}

fn robot_laser(words: &mut Words<'_>, line: u64) -> Result<RawScan, FieldFault> {
    let _device = words.finite("laser_type")?;
    let start_rad = words.finite("start_angle")?;
    let _field_of_view = words.finite("field of view")?;
    let step_rad = words.finite("angular resolution")?;
    let range_max_m = words.finite("max_range")? as f32;
    let _accuracy = words.finite("accuracy")?;
    let _remission_mode = words.finite("remission_mode")?;
    let count = beam_count(words)?;
    let mut scan = RawScan::new(line, ranges(words, count)?);
    let remissions: usize = words.parse(|| "number of remissions".to_owned(), "a whole number")?;
    for i in 1..=remissions {
        let _remission: f32 = words.parse(|| format!("remission {i} of {remissions}"), "a number")?;
    }
    poses(words, &mut scan)?;
    for name in ["laser_tv", "laser_rv", "forward_safety_dist", "side_safety_dist", "turn_axis"] {
        let _ignored = words.finite(name)?;
    }
    scan.stamp = Some(time(words)?);
    let _host = words.parse::<String>(|| "host".to_owned(), "a name")?;
    let left = words.left();
    if left > 1 {
        return Err(fault("behind host".to_owned(), "at most the logger's time", Some(&format!("{left} fields"))));
    }
    scan.range_max_m = Some(range_max_m).filter(|&range| range > 0.0);
    // Some loggers left the angles zero.
    let sane = (1e-4..0.2).contains(&step_rad) && start_rad.abs() <= std::f64::consts::TAU;
    scan.bearings = sane.then_some(Bearings { first_rad: start_rad as f32, step_rad: step_rad as f32 });
    Ok(scan)
}

fn poses(words: &mut Words<'_>, scan: &mut RawScan) -> Result<(), FieldFault> {
    scan.odometry_from_lrf = pose(words, "laser pose")?;
    scan.odometry_from_robot = pose(words, "robot pose")?;
    Ok(())
}

fn time(words: &mut Words<'_>) -> Result<Instant, FieldFault> {
    words.finite("time").map(Instant::from_secs_f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose_f64::PoseF64;

    fn read(reader: &mut CarmenReader, text: &str, ended: bool) -> Result<Content, FieldFault> {
        reader.read(&Line { number: 7, text: text.into(), ended })
    }

    fn scan(text: &str) -> RawScan {
        match read(&mut CarmenReader::default(), text, true).unwrap() {
            Content::Scan(scan) => *scan,
            other => panic!("no scan but {other:?}"),
        }
    }

    const FLASER: &str = "FLASER 3 1.5 nan 81.83 1.1 2 0.5 1 2 0.5 976052857.337530 host 0.25";

    #[test]
    fn flaser_gives_ranges_poses_and_time() {
        let scan = scan(FLASER);
        assert_eq!((scan.line, scan.ranges_m[0], scan.ranges_m[2]), (7, 1.5, 81.83));
        assert!(scan.ranges_m[1].is_nan());
        assert_eq!(scan.odometry_from_lrf, Some(PoseF64::new(1.1, 2.0, 0.5)));
        assert_eq!(scan.odometry_from_robot, Some(PoseF64::new(1.0, 2.0, 0.5)));
        assert_eq!(scan.stamp, Some(Instant::from_micros(976_052_857_337_530)));
    }

    #[test]
    fn poses_that_are_not_known_leave_the_scan_good() {
        let scan = scan("FLASER 1 1.5 nan nan nan 1 2 inf 12.5 host 0.25");
        assert_eq!((scan.odometry_from_lrf, scan.odometry_from_robot), (None, None));
    }

    #[test]
    fn robotlaser_gives_angles_and_maximum() {
        let scan =
            scan("ROBOTLASER1 0 -1.5 3 0.5 40.0 0.01 0 3 1 2 3 2 10 11 1 0 0 1 0 0 0.1 0.2 0.3 0.4 0.5 12.5 host 12.6");
        assert_eq!(scan.ranges_m, [1.0, 2.0, 3.0]);
        assert_eq!(scan.range_max_m, Some(40.0));
        assert_eq!(scan.stamp, Some(Instant::from_secs_f64(12.5)));
        assert_eq!(scan.bearings, None, "a step of 0.5 rad is nonsense");
        let text = "ROBOTLASER1 0 -1.5 3 0.1 40.0 0.01 0 1 1 0 1 0 0 1 0 0 0 0 0 0 0 12.5 host 12.6";
        let Ok(Content::Scan(scan)) = read(&mut CarmenReader::default(), text, true) else { panic!() };
        assert_eq!(scan.bearings, Some(Bearings { first_rad: -1.5, step_rad: 0.1 }));
    }

    #[test]
    fn param_gives_the_maximum_and_the_first_kind_of_scan_decides() {
        let mut reader = CarmenReader::default();
        assert!(matches!(read(&mut reader, "PARAM laser_max_range 50.0 0 h 0", true), Ok(Content::Other)));
        assert!(matches!(read(&mut reader, "PARAM robot_front_laser_max 3.0 0 h 0", true), Ok(Content::Other)));
        let Ok(Content::Scan(scan)) = read(&mut reader, FLASER, true) else { panic!() };
        assert_eq!(scan.range_max_m, Some(50.0));
        assert!(matches!(read(&mut reader, "ROBOTLASER1 whatever", true), Ok(Content::Unknown)));
        assert!(matches!(read(&mut reader, "NEWKIND 1 2 3", true), Ok(Content::Unknown)));
        assert!(matches!(read(&mut reader, "ODOM 1 2 3 0 0 0 1 h 1", true), Ok(Content::Other)));
    }

    #[test]
    fn wrong_lines_name_the_field() {
        let wrong = |text: &str, ended| read(&mut CarmenReader::default(), text, ended).unwrap_err().to_string();
        assert!(wrong("FLASER 3 1 2 x 0 0 0 0 0 0 1 h 1", true).contains("range 3 of 3"));
        assert!(wrong("FLASER 0 0 0 0 0 0 0 1 h 1", true).contains("number of beams"));
        assert!(wrong("FLASER 2 1 2 3 0 0 0 0 0 0 1 h 1", true).contains("10 fields"));
        assert!(wrong("FLASER 3 1 2 3 0 0 0 0 0 0 nan h 1", true).contains("time"));
        assert!(wrong("FLASER 3 1 2 3 4 0 0 0 0 0 0 97605", true).contains("field host: expected a name"));
        assert!(wrong("FLASER 3 1 2 3 0 0 0 0 0 0 97605", false).contains("7 fields"));
        assert!(wrong("ROBOTLASER1 0 -1.5 3", true).contains("angular resolution"));
        let two = "ROBOTLASER1 0 -1.5 3 0.1 40.0 0.01 0 1 1 0 1 0 0 1 0 0 0 0 0 0 0 12.5 host 12.6 ".repeat(2);
        assert!(wrong(&two, true).contains("behind host"), "a lost line end");
    }
}
