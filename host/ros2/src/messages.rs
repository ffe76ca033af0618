//! Messages of ROS 2, made: each is its bytes in CDR with a head of four, as bags have them.
//!
//! Units and frames are those of REP 103 and REP 105: m, rad, x forward, y left; `map`, `odom`, `base_link`, `laser`.
//! Source: `sensor_msgs`, `nav_msgs`, `geometry_msgs` and `tf2_msgs` of ROS 2 Humble to Jazzy, which agree in these types.

use lrfslam_core::scan::{Beam, Echo, RangeScan};
use lrfslam_core::time::{Duration, Instant};
use lrfslam_host::foxglove::{LASER_FRAME, MAP_FRAME, ROBOT_FRAME};
use lrfslam_host::maps::occupancy::{Occupancy, Raster};
use lrfslam_host::pose_f64::PoseF64;
use nalgebra::Matrix3;

use crate::cdr::Cdr;

/// The frame in which the robot's path has no jumps.
pub const ODOM_FRAME: &str = "odom";

/// Where the frames lie.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Frames {
    /// The robot in the map.
    pub map_from_robot: PoseF64,
    /// The robot by its odometry.
    pub odom_from_robot: PoseF64,
    /// The laser on the robot; `None` if somebody else tells it.
    pub robot_from_lrf: Option<PoseF64>,
}

fn header(message: &mut Cdr, stamp: Instant, frame: &str) {
    time(message, stamp);
    message.text(frame);
}

/// Before 1970 there is no time.
fn time(message: &mut Cdr, stamp: Instant) {
    let micros = stamp.micros.max(0);
    let seconds = i32::try_from(micros / 1_000_000).unwrap_or(i32::MAX);
    message.i32(seconds).u32((micros % 1_000_000) as u32 * 1000);
}

/// Position, then a unit quaternion, as `geometry_msgs/Pose` and `Transform` have them.
fn pose(message: &mut Cdr, pose: PoseF64) {
    let (z, w) = (pose.heading / 2.0).sin_cos();
    message.f64s([pose.x, pose.y, 0.0, 0.0, 0.0, z, w]);
}

/// (x, y, heading) among (x, y, z, roll, pitch, yaw). What a robot in the plane cannot do has no uncertainty.
fn covariance(message: &mut Cdr, covariance: &Matrix3<f32>) {
    let place = |index: usize| [0, 1, 5].iter().position(|of| *of == index);
    let entry = |index: usize| {
        let found = place(index / 6).zip(place(index % 6));
        found.map_or(0.0, |(row, column)| f64::from(covariance[(row, column)]))
    };
    message.f64s((0..36).map(entry));
}

/// `sensor_msgs/LaserScan`.
///
/// The message knows even angles only. Beams that lie unevenly come to the nearest of as many even ones; of two at one, the nearer range
/// stays, and where none comes is NaN. Nothing seen is +∞, no measurement NaN (REP 117).
///
/// * `scan_time` — from the scan before to this one; zero if it is not known
pub fn scan(scan: &RangeScan<'_>, scan_time: Duration) -> Vec<u8> {
    let Even { first_rad, step_rad, ranges_m } = even(scan.beams);
    let offset = |beam: Option<&Beam>| beam.map_or(0, |beam| beam.offset.micros);
    let (first_us, last_us) = (offset(scan.beams.first()), offset(scan.beams.last()));
    let steps = ranges_m.len().saturating_sub(1);
    let mut message = Cdr::new();
    header(&mut message, Instant::from_micros(scan.stamp.micros.saturating_add(first_us)), LASER_FRAME);
    message.f32(first_rad).f32(first_rad + step_rad * steps as f32).f32(step_rad);
    message.f32((last_us - first_us) as f32 / 1e6 / steps.max(1) as f32);
    message.f32(scan_time.as_secs_f32()).f32(0.0).f32(scan.range_max_m).f32s(&ranges_m).f32s(&[]);
    message.finish()
}

struct Even {
    first_rad: f32,
    step_rad: f32,
    ranges_m: Vec<f32>,
}

fn even(beams: &[Beam]) -> Even {
    let (Some(first), Some(last)) = (beams.first(), beams.last()) else {
        return Even { first_rad: 0.0, step_rad: 0.0, ranges_m: Vec::new() };
    };
    let steps = beams.len() - 1;
    let step_rad = (last.bearing_rad - first.bearing_rad) / steps.max(1) as f32;
    let mut ranges_m = vec![f32::NAN; beams.len()];
    for beam in beams {
        let range_m = match beam.echo {
            Echo::Hit(range_m) => range_m,
            Echo::Miss => f32::INFINITY,
            Echo::Invalid => continue,
        };
        let place = ((beam.bearing_rad - first.bearing_rad) / step_rad.max(f32::MIN_POSITIVE)).round() as usize;
        let there = &mut ranges_m[place.min(steps)];
        *there = there.min(range_m);
    }
    Even { first_rad: first.bearing_rad, step_rad, ranges_m }
}

/// `nav_msgs/OccupancyGrid`: 0 free, 100 occupied, −1 unknown, row by row from the lower left corner.
///
/// * `stamp` — of the newest scan in it
pub fn map(stamp: Instant, raster: &Raster) -> Vec<u8> {
    let mut message = Cdr::new();
    header(&mut message, stamp, MAP_FRAME);
    time(&mut message, stamp);
    let side = |cells: usize| u32::try_from(cells).unwrap_or(u32::MAX);
    message.f32(raster.pixel_size_m as f32).u32(side(raster.width)).u32(side(raster.height));
    pose(&mut message, PoseF64::new(raster.origin_m.0, raster.origin_m.1, 0.0));
    let cell = |occupancy: &Occupancy| match occupancy {
        Occupancy::Free => 0,
        Occupancy::Unknown => -1,
        Occupancy::Occupied => 100,
    };
    // Rows go up, where those of the image go down.
    let cells: Vec<i8> = raster.pixels.chunks(raster.width.max(1)).rev().flatten().map(cell).collect();
    message.i8s(cells.into_iter());
    message.finish()
}

/// `tf2_msgs/TFMessage`: `map` → `odom` → `base_link`, and → `laser` if that is known.
pub fn transforms(stamp: Instant, frames: &Frames) -> Vec<u8> {
    let robot_from_odom = frames.odom_from_robot.between(PoseF64::default());
    let odom = (MAP_FRAME, ODOM_FRAME, frames.map_from_robot.then(robot_from_odom));
    let robot = (ODOM_FRAME, ROBOT_FRAME, frames.odom_from_robot);
    let laser = frames.robot_from_lrf.map(|robot_from_lrf| (ROBOT_FRAME, LASER_FRAME, robot_from_lrf));
    let mut message = Cdr::new();
    message.u32(2 + u32::from(laser.is_some()));
    for (parent, child, parent_from_child) in [odom, robot].into_iter().chain(laser) {
        header(&mut message, stamp, parent);
        message.text(child);
        pose(&mut message, parent_from_child);
    }
    message.finish()
}

/// How a robot moves.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Motion {
    /// Displacement since the scan before, in the robot's frame then.
    pub moved: PoseF64,
    /// The time that took; zero if it is not known, which stands for a robot that stands.
    pub duration: Duration,
    /// Of a match: (x, y, heading), robot frame. A displacement has two of these.
    pub covariance: Matrix3<f32>,
}

/// `nav_msgs/Odometry`: pose in `odom`, velocity in `base_link`.
///
/// The covariance of the pose is that of the last match: how far the path has drifted, nobody knows.
pub fn odometry(stamp: Instant, odom_from_robot: PoseF64, motion: &Motion) -> Vec<u8> {
    let mut message = Cdr::new();
    header(&mut message, stamp, ODOM_FRAME);
    message.text(ROBOT_FRAME);
    pose(&mut message, odom_from_robot);
    let (sin, cos) = (odom_from_robot.heading as f32).sin_cos();
    let turn = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
    covariance(&mut message, &(turn * motion.covariance * turn.transpose()));
    let seconds = motion.duration.micros as f64 / 1e6;
    let rate = if seconds > 0.0 { 1.0 / seconds } else { 0.0 };
    let PoseF64 { x, y, heading } = motion.moved;
    message.f64s([x * rate, y * rate, 0.0, 0.0, 0.0, heading * rate]);
    covariance(&mut message, &(motion.covariance * (2.0 * rate * rate) as f32));
    message.finish()
}

/// `geometry_msgs/PoseWithCovarianceStamped`, in `map`.
///
/// * `of_pose` — covariance of (x, y, heading), map frame; m², m rad, rad²
pub fn pose_in_map(stamp: Instant, map_from_robot: PoseF64, of_pose: &Matrix3<f32>) -> Vec<u8> {
    let mut message = Cdr::new();
    header(&mut message, stamp, MAP_FRAME);
    pose(&mut message, map_from_robot);
    covariance(&mut message, of_pose);
    message.finish()
}

#[cfg(test)]
mod tests;
