//! A robot's path: poses with times, and the TUM text format for them.
//!
//! TUM: a line `t x y z qx qy qz qw` per pose, seconds, metres and a unit quaternion; in the plane z = qx = qy = 0.
//! Poses stand under the times of their scans, in order of time, each time once ([`by_time`]). The reader takes any order,
//! and also the four columns `t x y θ` (rad) of GMapping's corrected poses.
#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use std::collections::HashMap;
use std::io::{self, Write};
use std::path::Path;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::time::Instant;

use crate::input::table::{TableError, read_table};
use crate::input::text::{FieldFault, Words, fault};
use crate::output::save_by;
use crate::pose_f64::PoseF64;
use crate::scans::log::LogScan;

/// Where the robot was, and when.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedPose {
    /// On the log's clock.
    pub stamp: Instant,
    /// Pose of the robot in the map.
    pub map_from_robot: Pose2,
}

impl TimedPose {
    /// Writes the pose as a line of a TUM file.
    ///
    /// Times are exact to the microsecond, positions to the micrometre, headings to 1e-9.
    ///
    /// # Errors
    /// If `out` fails.
    pub fn write_tum(&self, out: &mut impl Write) -> io::Result<()> {
        let pose = PoseF64::from(self.map_from_robot);
        let (qz, qw) = (pose.heading / 2.0).sin_cos();
        let micros = self.stamp.micros;
        let (sign, seconds, rest) =
            (if micros < 0 { "-" } else { "" }, micros.unsigned_abs() / 1_000_000, micros.unsigned_abs() % 1_000_000);
        writeln!(out, "{sign}{seconds}.{rest:06} {:.6} {:.6} 0 0 0 {qz:.9} {qw:.9}", pose.x, pose.y)
    }
}

/// Poses in order of time, each time once, as tools that read TUM files want them.
///
/// * `poses` — in the order of their scans; of several with the same time the last is kept
pub fn by_time(mut poses: Vec<TimedPose>) -> Vec<TimedPose> {
    poses.sort_by_key(|pose| pose.stamp);
    poses.dedup_by(|later, kept| {
        let repeats = later.stamp == kept.stamp;
        if repeats {
            *kept = *later;
        }
        repeats
    });
    poses
}

/// Scans in their own order with the pose of each; what [`by_time`] has left out is left out.
///
/// * `poses` — in any order; those that are missing leave fewer poses than scans
pub fn with_poses(scans: Vec<LogScan>, poses: &[TimedPose]) -> (Vec<LogScan>, Vec<TimedPose>) {
    let last: HashMap<Instant, u64> = scans.iter().map(|scan| (scan.stamp, scan.line)).collect();
    let found: HashMap<Instant, TimedPose> = poses.iter().map(|pose| (pose.stamp, *pose)).collect();
    let scans: Vec<LogScan> = scans.into_iter().filter(|scan| last.get(&scan.stamp) == Some(&scan.line)).collect();
    let poses = scans.iter().filter_map(|scan| found.get(&scan.stamp).copied()).collect();
    (scans, poses)
}

/// Writes the file `file` in TUM's format: a line for each pose, in order of time, each time once.
///
/// * `poses` — in the order of their scans
///
/// # Errors
/// If it cannot be written; it is named.
pub fn write_trajectory(file: &Path, poses: Vec<TimedPose>) -> anyhow::Result<()> {
    let poses = by_time(poses);
    save_by(file, |out| poses.iter().try_for_each(|pose| pose.write_tum(out)))
}

/// Reads a trajectory: TUM's eight columns or `t x y θ`, plain or gzip, `#` comments.
///
/// # Errors
/// If the file cannot be read, has no pose, or a line that is wrong (named).
pub fn read_trajectory(path: &Path) -> Result<Vec<TimedPose>, TableError> {
    read_table(path, "t x y z qx qy qz qw", |words| match words.left() {
        4 => planar(words),
        8 => tum(words),
        found => Err(fault("count".to_owned(), "8 columns (TUM) or 4 (t x y θ)", Some(&format!("{found} columns")))),
    })
}

fn planar(words: &mut Words<'_>) -> Result<TimedPose, FieldFault> {
    let stamp = Instant::from_secs_f64(words.finite("t")?);
    let pose = PoseF64::new(words.finite("x")?, words.finite("y")?, words.finite("θ")?);
    Ok(TimedPose { stamp, map_from_robot: pose.to_f32() })
}

fn tum(words: &mut Words<'_>) -> Result<TimedPose, FieldFault> {
    let stamp = Instant::from_secs_f64(words.finite("t")?);
    let (x, y, _z) = (words.finite("x")?, words.finite("y")?, words.finite("z")?);
    let (qx, qy, qz, qw) = (words.finite("qx")?, words.finite("qy")?, words.finite("qz")?, words.finite("qw")?);
    // Yaw of a general quaternion; also right if it is not quite of unit length.
    let heading = (2.0 * (qw * qz + qx * qy)).atan2(qw * qw + qx * qx - qy * qy - qz * qz);
    Ok(TimedPose { stamp, map_from_robot: PoseF64::new(x, y, heading).to_f32() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn written(poses: &[TimedPose]) -> Vec<u8> {
        let mut text = Vec::new();
        poses.iter().for_each(|pose| pose.write_tum(&mut text).unwrap());
        text
    }

    fn read(bytes: &[u8]) -> Result<Vec<TimedPose>, TableError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        read_trajectory(file.path())
    }

    #[test]
    fn tum_line_is_as_expected() {
        let stamp = Instant::from_micros(976_052_857_337_530);
        let line = written(&[TimedPose { stamp, map_from_robot: Pose2::new(1.5, -2.25, std::f32::consts::PI) }]);
        let text = String::from_utf8(line).unwrap();
        assert_eq!(text, "976052857.337530 1.500000 -2.250000 0 0 0 1.000000000 -0.000000044\n");
        let before_zero = TimedPose { stamp: Instant::from_micros(-1), map_from_robot: Pose2::IDENTITY };
        assert!(written(&[before_zero]).starts_with(b"-0.000001 "));
    }

    fn pose(micros: i64, x: f32) -> TimedPose {
        TimedPose { stamp: Instant::from_micros(micros), map_from_robot: Pose2::new(x, 0.0, 0.0) }
    }

    #[test]
    fn times_that_run_backwards_or_repeat_come_sorted_and_once() {
        let poses = [pose(10, 0.0), pose(30, 1.0), pose(20, 2.0), pose(30, 3.0), pose(20, 4.0), pose(20, 5.0)];
        assert_eq!(by_time(poses.to_vec()), [pose(10, 0.0), pose(20, 5.0), pose(30, 3.0)]);
        assert!(by_time(Vec::new()).is_empty());
    }

    #[test]
    fn scans_find_their_poses_in_a_sorted_trajectory() {
        let log = [30, 10, 30, 20].map(|s| format!("FLASER 1 {s} 0 0 0 0 0 0 {s} host {s}\n")).concat();
        let log = std::io::Cursor::new(log.into_bytes());
        let scans =
            crate::scans::log::LogReader::from_reader("a.log", log, crate::scans::log::LogOptions::default()).unwrap();
        let scans: Vec<LogScan> = scans.collect::<Result<_, _>>().unwrap();
        let poses = [pose(10_000_000, 1.0), pose(20_000_000, 2.0), pose(30_000_000, 3.0)];
        let (kept, found) = with_poses(scans.clone(), &poses);
        assert_eq!(kept.iter().map(|scan| scan.line).collect::<Vec<_>>(), [2, 3, 4]);
        assert_eq!(found, [poses[0], poses[2], poses[1]]);
        assert_eq!(with_poses(scans, &poses[1..]).1.len(), 2, "one is missing");
    }

    #[test]
    fn four_columns_are_a_planar_pose() {
        let poses = read(b"# t x y theta\n21.0199 0.89 -0.18 -0.454\n").unwrap();
        assert_eq!(poses[0].stamp.micros, 21_019_900);
        assert_eq!(poses[0].map_from_robot, Pose2::new(0.89, -0.18, -0.454));
    }

    #[test]
    fn wrong_lines_are_named() {
        let text = |bytes: &[u8]| read(bytes).unwrap_err().to_string();
        assert!(text(b"1 2 3\n").contains("line 1: field count: expected 8 columns"));
        assert!(text(b"1 2 3 0 0 0 0 1\n1 2 x 0 0 0 0 1\n").contains("line 2: field y"));
        assert!(text(b"# nothing\n").contains("no line of numbers"));
        assert!(read_trajectory(Path::new("not there")).unwrap_err().to_string().contains("not there: cannot be read"));
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_back(
            micros in -10_i64.pow(15)..10_i64.pow(15), x in -900.0..900.0_f32, y in -900.0..900.0_f32, heading in -3.1..3.1_f32,
        ) {
            let pose = TimedPose { stamp: Instant::from_micros(micros), map_from_robot: Pose2::new(x, y, heading) };
            let back = read(&written(&[pose])).unwrap()[0];
            prop_assert_eq!(back.stamp, pose.stamp);
            let error = pose.map_from_robot.between(back.map_from_robot);
            prop_assert!(error.position().norm() < 1e-4 && error.heading.abs() < 1e-6);
        }

        #[test]
        fn arbitrary_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..500)) {
            let _ = read(&bytes);
        }
    }
}
