//! Scans read: those of this program exactly, those of others as far as the schema goes.

use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::time::Duration;
use serde::Deserialize;

/// A scan and what stood beside it.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadScan {
    /// Of its stamp, ns since 1970.
    pub time_ns: u64,
    /// None unless this program wrote it: then it is known what a range of 0 means.
    pub range_max_m: Option<f32>,
    /// In order of bearing.
    pub beams: Vec<Beam>,
    /// Pose of the robot by its odometry.
    pub odometry: Option<Pose2>,
    /// Pose of the laser on the robot, if this program wrote it.
    pub robot_from_lrf: Option<Pose2>,
}

#[derive(Deserialize)]
struct Time {
    sec: u64,
    nsec: u64,
}

#[derive(Deserialize)]
struct Scan {
    timestamp: Time,
    start_angle: f64,
    end_angle: f64,
    /// Others write `null` for what is not a number.
    ranges: Vec<Option<f64>>,
    range_max: Option<f64>,
    #[serde(default)]
    misses: Vec<[usize; 2]>,
    bearings: Option<Vec<f64>>,
    offsets_us: Option<Vec<i64>>,
    odometry: Option<[f64; 3]>,
    base_link_from_laser: Option<[f64; 3]>,
}

/// Bearing of a beam of `count` that lie evenly from `start` to `end`, rad.
pub(super) fn even_bearing(start: f32, end: f32, count: usize, index: usize) -> f32 {
    let (start, end) = (f64::from(start), f64::from(end));
    (start + (end - start) * index as f64 / count.saturating_sub(1).max(1) as f64) as f32
}

/// Reads `foxglove.LaserScan` in JSON.
///
/// # Errors
/// What is wrong with it, in words.
pub fn read_scan(json: &[u8]) -> Result<ReadScan, String> {
    let scan: Scan = serde_json::from_slice(json).map_err(|error| error.to_string())?;
    let count = scan.ranges.len();
    let is_short = |length: Option<usize>| length.is_some_and(|length| length != count);
    if is_short(scan.bearings.as_ref().map(Vec::len)) || is_short(scan.offsets_us.as_ref().map(Vec::len)) {
        return Err(format!("as many bearings and offsets as ranges, {count}"));
    }
    let range_max_m = scan.range_max.map(|range| range as f32);
    let beam = |(index, range): (usize, &Option<f64>)| {
        let even = even_bearing(scan.start_angle as f32, scan.end_angle as f32, count, index);
        let echo = range.map_or(Echo::Invalid, |range| match range_max_m {
            // It was written as a hit.
            Some(_) if range > 0.0 => Echo::Hit(range as f32),
            _ => Echo::from_range(range as f32, f32::INFINITY),
        });
        Beam {
            bearing_rad: scan
                .bearings
                .as_ref()
                .and_then(|bearings| bearings.get(index))
                .map_or(even, |bearing| *bearing as f32),
            offset: Duration::from_micros(
                scan.offsets_us.as_ref().and_then(|offsets| offsets.get(index)).copied().unwrap_or(0),
            ),
            echo,
        }
    };
    let mut beams: Vec<Beam> = scan.ranges.iter().enumerate().map(beam).collect();
    for [first, length] in &scan.misses {
        let run = beams.iter_mut().skip(*first).take(*length);
        run.for_each(|beam| beam.echo = Echo::Miss);
    }
    let pose = |[x, y, heading]: [f64; 3]| Pose2 { x: x as f32, y: y as f32, heading: heading as f32 };
    Ok(ReadScan {
        time_ns: scan.timestamp.sec.saturating_mul(1_000_000_000).saturating_add(scan.timestamp.nsec),
        range_max_m,
        beams,
        odometry: scan.odometry.map(pose),
        robot_from_lrf: scan.base_link_from_laser.map(pose),
    })
}
