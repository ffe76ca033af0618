//! Messages read: scans, odometry and frames.
//!
//! Source: `sensor_msgs/LaserScan`, `nav_msgs/Odometry`, `tf2_msgs/TFMessage`; REP 117: +∞ is nothing seen, −∞ too near, NaN no measurement.

use lrfslam_core::time::{Duration, Instant};

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use super::frames::Transform;
use super::wire::{Short, Wire};
use super::{BagScan, Ranges};
use crate::foxglove::read_scan;
use crate::input::text::FieldFault;
use crate::pose_f64::PoseF64;
use crate::scans::mcap::Message;

const LASER_SCAN: &str = "sensor_msgs/LaserScan";
const FOXGLOVE_SCAN: &str = "foxglove.LaserScan";
const ODOMETRY: &str = "nav_msgs/Odometry";
/// The second is what ROS 1 had before tf2.
const TF: [&str; 2] = ["tf2_msgs/TFMessage", "tf/tfMessage"];
/// A transform has at least so many bytes: two names, and seven numbers.
const TRANSFORM_BYTES_MIN: usize = 72;
/// Longer names of frames are not believed.
const NAME_BYTES_MAX: usize = 256;
/// More beams than any planar laser range finder has.
const BEAMS_MAX: usize = 20_000;
/// A turn, and what rounding adds to it, rad.
const TURN_RAD: f32 = std::f32::consts::TAU * 1.02;

/// A type as ROS 1 writes it: ROS 2 has `/msg/` in it.
pub(super) fn plain_type(schema: &str) -> String {
    schema.replace("/msg/", "/")
}

pub(super) fn is_scan(schema: &str) -> bool {
    schema == FOXGLOVE_SCAN || plain_type(schema) == LASER_SCAN
}

pub(super) fn is_odometry(schema: &str) -> bool {
    plain_type(schema) == ODOMETRY
}

pub(super) fn is_tf(schema: &str) -> bool {
    TF.contains(&plain_type(schema).as_str())
}

/// What is wrong with a message: its topic and type, and what was expected.
fn fault(message: &Message, expected: &str, found: impl ToString) -> FieldFault {
    let field = format!("{} ({})", message.channel.topic, message.channel.schema);
    FieldFault { field, expected: expected.to_owned(), found: found.to_string() }
}

/// A scan out of its message.
///
/// * `number` — of the message in the bag
pub(crate) fn scan(number: u64, message: &Message) -> Result<BagScan, FieldFault> {
    if message.channel.schema == FOXGLOVE_SCAN {
        return foxglove_scan(number, message);
    }
    let mut wire = wire(message)?;
    let read = laser_scan(&mut wire).map_err(|Short| short(message))?;
    let count = read.ranges_m.len();
    if !(1..=BEAMS_MAX).contains(&count) {
        return Err(fault(message, "1 to 20000 ranges", count));
    }
    let [start, step] = [read.start, read.step];
    let is_even = start.is_finite() && step != 0.0 && (step.abs() * (count - 1) as f32) <= TURN_RAD;
    if !is_even && count > 1 {
        return Err(fault(message, "an angle_increment that spans a turn at most", step));
    }
    Ok(BagScan {
        number,
        stamp: read.stamp.unwrap_or(Instant::from_micros((message.time_ns / 1000) as i64)),
        ranges: read.ranges(),
        odometry_from_robot: None,
        robot_from_lrf: None,
    })
}

fn short(message: &Message) -> FieldFault {
    fault(message, "a whole message", format!("{} bytes that end too soon", message.data.len()))
}

fn wire(message: &Message) -> Result<Wire<'_>, FieldFault> {
    match message.channel.encoding.as_str() {
        "cdr" => Wire::cdr(&message.data).map_err(|Short| short(message)),
        "ros1" => Ok(Wire::ros1(&message.data)),
        other => Err(fault(message, "messages in cdr or ros1", other)),
    }
}

struct LaserScan {
    stamp: Option<Instant>,
    /// Rad.
    start: f32,
    step: f32,
    /// s.
    interval: f32,
    /// m.
    range_min: f32,
    range_max: f32,
    ranges_m: Vec<f32>,
}

/// Stamp of a header, `None` if it is zero, and its frame.
fn header<'a>(wire: &mut Wire<'a>) -> Result<(Option<Instant>, &'a [u8]), Short> {
    if !wire.is_cdr() {
        wire.u32()?;
    }
    let (seconds, nanoseconds) = (wire.u32()?, wire.u32()?);
    let frame = wire.text()?;
    let micros = i64::from(seconds) * 1_000_000 + i64::from(nanoseconds / 1000);
    Ok(((micros > 0).then(|| Instant::from_micros(micros)), frame))
}

/// A frame's name; ROS 1 wrote it with a stroke before it, too.
fn frame_name(bytes: &[u8]) -> Option<String> {
    let name = str::from_utf8(bytes).ok()?.trim_start_matches('/');
    (name.len() <= NAME_BYTES_MAX).then(|| name.to_owned())
}

/// The frame of a scan; empty if it says none.
pub(super) fn frame_of_scan(message: &Message) -> Result<String, FieldFault> {
    if message.channel.schema == FOXGLOVE_SCAN {
        return Ok(String::new());
    }
    let (_, frame) = header(&mut wire(message)?).map_err(|Short| short(message))?;
    frame_name(frame).ok_or_else(|| fault(message, "a name of a frame", format!("{} bytes", frame.len())))
}

/// Frames in their parents.
pub(super) fn transforms(message: &Message) -> Result<Vec<Transform>, FieldFault> {
    let mut wire = wire(message)?;
    let count = wire.u32().map_err(|Short| short(message))? as usize;
    if count > wire.left() / TRANSFORM_BYTES_MIN {
        return Err(short(message));
    }
    (0..count).map(|_| transform(&mut wire, message)).collect()
}

fn transform(wire: &mut Wire<'_>, message: &Message) -> Result<Transform, FieldFault> {
    let read = |wire: &mut Wire<'_>| {
        let (stamp, parent) = header(wire)?;
        let (parent, child) = (frame_name(parent), frame_name(wire.text()?));
        let mut numbers = [0.0; 7];
        for number in &mut numbers {
            *number = wire.f64()?;
        }
        Ok((stamp, parent.zip(child), numbers))
    };
    let (stamp, names, numbers) = read(wire).map_err(|Short| short(message))?;
    let [x, y, z, qx, qy, qz, qw] = numbers;
    let turn = UnitQuaternion::try_new(Quaternion::new(qw, qx, qy, qz), 1e-3);
    let turn = turn.filter(|_| numbers.iter().all(|number| number.is_finite() && number.abs() < 1e9));
    let (Some((parent, child)), Some(turn)) = (names, turn) else {
        return Err(fault(message, "names of frames, and a transform of numbers", "others"));
    };
    Ok(Transform {
        stamp: stamp.unwrap_or(Instant::from_micros((message.time_ns / 1000) as i64)),
        parent,
        child,
        parent_from_child: Isometry3::from_parts(Translation3::new(x, y, z), turn),
    })
}

fn laser_scan(wire: &mut Wire<'_>) -> Result<LaserScan, Short> {
    let (stamp, _) = header(wire)?;
    let [start, _, step, interval, _, range_min, range_max] = {
        let mut numbers = [0.0; 7];
        for number in &mut numbers {
            *number = wire.f32()?;
        }
        numbers
    };
    Ok(LaserScan { stamp, start, step, interval, range_min, range_max, ranges_m: wire.f32s()? })
}

impl LaserScan {
    /// In order of bearing, whichever way the laser turns.
    fn ranges(mut self) -> Ranges {
        let last = self.ranges_m.len() - 1;
        let is_known = (0.0..1.0).contains(&self.interval.abs());
        let interval_us = if is_known { f64::from(self.interval) * 1e6 } else { 0.0 };
        let (mut first, mut each) = (0.0, interval_us);
        if self.step < 0.0 {
            self.ranges_m.reverse();
            (self.start, self.step) = (self.start + self.step * last as f32, -self.step);
            (first, each) = (interval_us * last as f64, -interval_us);
        }
        for range in &mut self.ranges_m {
            // Nearer than the laser can see: no measurement.
            if *range < self.range_min {
                *range = f32::NAN;
            }
        }
        Ranges::Even {
            ranges_m: self.ranges_m,
            bearings_rad: [self.start, self.step],
            offsets: [first, each].map(|micros| Duration::from_micros(micros.round() as i64)),
            range_max_m: Some(self.range_max).filter(|range| range.is_finite() && *range > 0.0),
        }
    }
}

fn foxglove_scan(number: u64, message: &Message) -> Result<BagScan, FieldFault> {
    if message.channel.encoding != "json" {
        return Err(fault(message, "messages in json", &message.channel.encoding));
    }
    let read = read_scan(&message.data).map_err(|why| fault(message, "a foxglove.LaserScan", why))?;
    let count = read.beams.len();
    if !(1..=BEAMS_MAX).contains(&count) {
        return Err(fault(message, "1 to 20000 ranges", count));
    }
    let of_pose = |pose: lrfslam_core::geometry::Pose2| PoseF64::new(pose.x.into(), pose.y.into(), pose.heading.into());
    let ranges = match read.range_max_m {
        Some(range_max_m) => Ranges::Exact { beams: read.beams, range_max_m },
        None => {
            let bearing = |index: usize| read.beams.get(index).map_or(0.0, |beam| beam.bearing_rad);
            let range = |beam: &lrfslam_core::scan::Beam| match beam.echo {
                lrfslam_core::scan::Echo::Hit(range_m) => range_m,
                lrfslam_core::scan::Echo::Miss => f32::INFINITY,
                lrfslam_core::scan::Echo::Invalid => f32::NAN,
            };
            let step = (bearing(count - 1) - bearing(0)) / (count - 1).max(1) as f32;
            let (interval, range_max) = (0.0, f32::NAN);
            let ranges_m = read.beams.iter().map(range).collect();
            let scan =
                LaserScan { stamp: None, start: bearing(0), step, interval, range_min: 0.0, range_max, ranges_m };
            scan.ranges()
        }
    };
    Ok(BagScan {
        number,
        stamp: Instant::from_micros((read.time_ns / 1000) as i64),
        ranges,
        odometry_from_robot: read.odometry.map(of_pose),
        robot_from_lrf: read.robot_from_lrf,
    })
}

/// When, and where the robot was in the odometry's frame.
pub(super) fn odometry(message: &Message) -> Result<(Instant, PoseF64), FieldFault> {
    let mut wire = wire(message)?;
    let (stamp, pose) = planar_pose(&mut wire).map_err(|Short| short(message))?;
    if !pose.is_finite() {
        return Err(fault(message, "a pose of numbers", "one that is not"));
    }
    Ok((stamp.unwrap_or(Instant::from_micros((message.time_ns / 1000) as i64)), pose))
}

fn planar_pose(wire: &mut Wire<'_>) -> Result<(Option<Instant>, PoseF64), Short> {
    let (stamp, _) = header(wire)?;
    wire.text()?;
    let (x, y, _) = (wire.f64()?, wire.f64()?, wire.f64()?);
    let (qx, qy, qz, qw) = (wire.f64()?, wire.f64()?, wire.f64()?, wire.f64()?);
    let heading = (2.0 * (qw * qz + qx * qy)).atan2(1.0 - 2.0 * (qy * qy + qz * qz));
    Ok((stamp, PoseF64::new(x, y, heading)))
}
