//! Messages made.

use std::fmt::{Display, Write as _};

use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::{Beam, Echo, RangeScan};

use super::base64::encode;
use super::{LASER_FRAME, MAP_FRAME, ROBOT_FRAME};

/// What is known beside a scan, so that it can be read back.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Seen {
    /// Pose of the robot by its odometry.
    pub odometry: Option<Pose2>,
    /// Pose of the laser on the robot.
    pub robot_from_lrf: Pose2,
    /// Bearings and times of the beams are written if they are not even, for there is nothing else to know them from.
    pub is_exact: bool,
}

fn timestamp(time_ns: u64) -> String {
    format!("{{\"sec\":{},\"nsec\":{}}}", time_ns / 1_000_000_000, time_ns % 1_000_000_000)
}

/// Half of the heading's sine and cosine, as the quaternion has them.
fn rotation(pose: Pose2) -> String {
    let (z, w) = (f64::from(pose.heading) / 2.0).sin_cos();
    format!("{{\"x\":0,\"y\":0,\"z\":{z},\"w\":{w}}}")
}

fn position(x: impl Display, y: impl Display) -> String {
    format!("{{\"x\":{x},\"y\":{y},\"z\":0}}")
}

fn posed(pose: Pose2) -> String {
    format!("{{\"position\":{},\"orientation\":{}}}", position(pose.x, pose.y), rotation(pose))
}

/// Numbers between commas; one that is not finite, which JSON does not have, is 0.
fn numbers(values: impl Iterator<Item = f32>) -> String {
    let mut text = String::from("[");
    for value in values {
        if text.len() > 1 {
            text.push(',');
        }
        // Writing to a string cannot fail.
        let _ = write!(text, "{}", if value.is_finite() { value } else { 0.0 });
    }
    text + "]"
}

/// `foxglove.LaserScan`, with fields of ours behind those of the schema.
///
/// A beam without a hit has range 0. `misses` lists those that saw nothing up to `range_max`: index of the first, and how many.
pub fn scan(time_ns: u64, scan: &RangeScan<'_>, seen: Seen) -> Vec<u8> {
    let beams = scan.beams;
    let bearing = |beam: Option<&Beam>| beam.map_or(0.0, |beam| beam.bearing_rad);
    let (start, end) = (bearing(beams.first()), bearing(beams.last()));
    let range = |beam: &Beam| if let Echo::Hit(range_m) = beam.echo { range_m } else { 0.0 };
    let mut text = format!(
        "{{\"timestamp\":{},\"frame_id\":\"{LASER_FRAME}\",\"pose\":{},\"start_angle\":{start},\"end_angle\":{end},\
         \"ranges\":{},\"intensities\":[],\"range_max\":{},\"misses\":{}",
        timestamp(time_ns),
        posed(Pose2::IDENTITY),
        numbers(beams.iter().map(range)),
        if scan.range_max_m.is_finite() { scan.range_max_m } else { 0.0 },
        misses(beams),
    );
    let pose = |pose: Pose2| numbers([pose.x, pose.y, pose.heading].into_iter());
    let _ = write!(text, ",\"base_link_from_laser\":{}", pose(seen.robot_from_lrf));
    if let Some(odometry) = seen.odometry {
        let _ = write!(text, ",\"odometry\":{}", pose(odometry));
    }
    if seen.is_exact {
        let even = |(index, beam): (usize, &Beam)| {
            super::read::even_bearing(start, end, beams.len(), index) == beam.bearing_rad
        };
        if !beams.iter().enumerate().all(even) {
            let _ = write!(text, ",\"bearings\":{}", numbers(beams.iter().map(|beam| beam.bearing_rad)));
        }
        if beams.iter().any(|beam| beam.offset.micros != 0) {
            let offsets: Vec<_> = beams.iter().map(|beam| beam.offset.micros.to_string()).collect();
            let _ = write!(text, ",\"offsets_us\":[{}]", offsets.join(","));
        }
    }
    (text + "}").into_bytes()
}

fn misses(beams: &[Beam]) -> String {
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for (index, _) in beams.iter().enumerate().filter(|(_, beam)| beam.echo == Echo::Miss) {
        match runs.last_mut() {
            Some([first, count]) if *first + *count == index => *count += 1,
            _ => runs.push([index, 1]),
        }
    }
    let runs: Vec<_> = runs.iter().map(|[first, count]| format!("[{first},{count}]")).collect();
    format!("[{}]", runs.join(","))
}

/// `foxglove.PoseInFrame`: the robot in the map.
pub fn pose(time_ns: u64, map_from_robot: Pose2) -> Vec<u8> {
    let (time, pose) = (timestamp(time_ns), posed(map_from_robot));
    format!("{{\"timestamp\":{time},\"frame_id\":\"{MAP_FRAME}\",\"pose\":{pose}}}").into_bytes()
}

/// `foxglove.FrameTransforms`: the robot in the map, the laser on the robot if that is known.
pub fn transforms(time_ns: u64, map_from_robot: Pose2, robot_from_lrf: Option<Pose2>) -> Vec<u8> {
    let transform = |parent: &str, child: &str, pose: Pose2| {
        let (time, place, turn) = (timestamp(time_ns), position(pose.x, pose.y), rotation(pose));
        format!(
            "{{\"timestamp\":{time},\"parent_frame_id\":\"{parent}\",\"child_frame_id\":\"{child}\",\"translation\":{place},\
             \"rotation\":{turn}}}"
        )
    };
    let laser = robot_from_lrf.map(|pose| transform(ROBOT_FRAME, LASER_FRAME, pose));
    let all = std::iter::once(transform(MAP_FRAME, ROBOT_FRAME, map_from_robot)).chain(laser);
    format!("{{\"transforms\":[{}]}}", all.collect::<Vec<_>>().join(",")).into_bytes()
}

/// `foxglove.Grid` of a map: [`FREE`](super::FREE), [`OCCUPIED`](super::OCCUPIED) or [`UNKNOWN`](super::UNKNOWN) for each cell, row by row from below.
///
/// * `origin_m` — lower left corner of the first cell in the map
/// * `size_m` — edge of a cell
/// * `columns` — cells of a row, and all cells
pub fn cells(
    time_ns: u64,
    origin_m: (f64, f64),
    size_m: f64,
    (columns, cells): (usize, impl Iterator<Item = u8>),
) -> Vec<u8> {
    let mut text = format!(
        "{{\"timestamp\":{},\"frame_id\":\"{MAP_FRAME}\",\"pose\":{{\"position\":{},\"orientation\":{}}},\"column_count\":{columns},\
         \"cell_size\":{{\"x\":{size_m},\"y\":{size_m}}},\"row_stride\":{columns},\"cell_stride\":1,\
         \"fields\":[{{\"name\":\"occupancy\",\"offset\":0,\"type\":1}}],\"data\":\"",
        timestamp(time_ns),
        position(origin_m.0, origin_m.1),
        rotation(Pose2::IDENTITY),
    );
    encode(cells, &mut text);
    (text + "\"}").into_bytes()
}

/// `foxglove.PointCloud` of points in the map, m.
pub fn points(time_ns: u64, points: impl Iterator<Item = [f32; 3]>) -> Vec<u8> {
    let field = |name: &str, offset: usize| format!("{{\"name\":\"{name}\",\"offset\":{offset},\"type\":7}}");
    let mut text = format!(
        "{{\"timestamp\":{},\"frame_id\":\"{MAP_FRAME}\",\"pose\":{},\"point_stride\":12,\"fields\":[{},{},{}],\"data\":\"",
        timestamp(time_ns),
        posed(Pose2::IDENTITY),
        field("x", 0),
        field("y", 4),
        field("z", 8),
    );
    encode(points.flatten().flat_map(f32::to_le_bytes), &mut text);
    (text + "\"}").into_bytes()
}

/// `foxglove.Log`, level "info".
pub fn log(time_ns: u64, words: &str) -> Vec<u8> {
    let (time, words) = (timestamp(time_ns), serde_json::Value::from(words));
    format!("{{\"timestamp\":{time},\"level\":2,\"message\":{words},\"name\":\"lrfslam\",\"file\":\"\",\"line\":0}}")
        .into_bytes()
}
