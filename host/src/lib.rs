//! Laser SLAM on a computer: logs in, maps and trajectories out.
//!
//! # Data flow
//! [`log`] (scans of a recorded file), or [`link`] → [`driver`] → [`live`] (scans as they come) → [`mapper`] (poses) → [`high_slam`] (loops closed) → [`trajectory`], [`occupancy_map`] → files; [`evaluation`]
//! compares a trajectory with ground truth.
#![forbid(unsafe_code)]

pub mod input;
pub mod localize;
pub mod mapping;
pub mod maps;
pub mod output;
pub mod places;
pub mod plural;
pub mod pose_f64;
pub mod program;
pub mod results;
pub mod robot;
pub mod runs;
pub mod scans;
pub mod trajectory;
