//! The formats, told apart by a line of theirs.

use serde::Serialize;

use super::carmen::{CarmenReader, is_carmen};
use super::dpslam::{DpSlamReader, is_dpslam};
use super::raw::LineReader;
use super::tinyslam::{TinySlamReader, is_tinyslam};
use super::ydlidar::{YdlidarReader, is_ydlidar};
use crate::input::text::Words;

/// The formats told apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum LogFormat {
    /// CARMEN: `FLASER`, `ROBOTLASER1`.
    Carmen,
    /// DP-SLAM: `Odometry`, `Laser`.
    DpSlam,
    /// tinySLAM's URG-04LX sample.
    TinySlam,
    /// Lines of a YDLIDAR X4 on a car.
    Ydlidar,
    /// A bag in MCAP: ROS 2, Foxglove, or this program.
    Mcap,
    /// A bag of ROS 2 in SQLite.
    RosSqlite,
    /// A bag of ROS 1.
    Ros1,
}

impl LogFormat {
    /// What a line that is neither blank nor a comment belongs to, and who reads it.
    pub(super) fn of_line(text: &str) -> Option<(Self, Box<dyn LineReader>)> {
        let first_word = Words::new(text).word()?;
        if is_carmen(first_word) {
            Some((Self::Carmen, Box::<CarmenReader>::default()))
        } else if is_dpslam(first_word) {
            Some((Self::DpSlam, Box::<DpSlamReader>::default()))
        } else if is_ydlidar(text) {
            Some((Self::Ydlidar, Box::<YdlidarReader>::default()))
        } else if is_tinyslam(text) {
            Some((Self::TinySlam, Box::<TinySlamReader>::default()))
        } else {
            None
        }
    }
}
