//! Messages as Foxglove, Lichtblick and others draw them, by Foxglove's well-known schemas, in JSON.
//!
//! JSON and not protobuf: ranges with the digits they have take less than the 8 bytes that `foxglove.LaserScan` gives each in protobuf,
//! a person can read them, and fields of ours stand beside those that the schema has.
//!
//! Frames are ROS's (REP 105): `map`, `base_link`, and `laser`. Source: `@foxglove/schemas`, JSON schemas.
#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

mod base64;
mod read;
mod schemas;
mod write;

pub use read::{ReadScan, read_scan};
pub use schemas::{FRAME_TRANSFORMS, GRID, LASER_SCAN, LOG, POINT_CLOUD, POSE_IN_FRAME};
pub use write::{Seen, cells, log, points, pose, scan, transforms};

/// The frame of the map.
pub const MAP_FRAME: &str = "map";
/// That of the robot.
pub const ROBOT_FRAME: &str = "base_link";
/// That of its laser.
pub const LASER_FRAME: &str = "laser";
/// Cells of a grid: nothing known of it.
pub const UNKNOWN: u8 = 255;
/// Nothing is there.
pub const FREE: u8 = 0;
/// Something is.
pub const OCCUPIED: u8 = 100;

#[cfg(test)]
mod tests;
