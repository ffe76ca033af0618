//! Laser SLAM on a computer: logs in, maps and trajectories out.
//!
//! # Data flow
//! [`log`] (scans of a recorded file), or [`link`] → [`driver`] → [`live`] (scans as they come) → [`mapper`] (poses) → [`high_slam`] (loops closed) → [`trajectory`], [`occupancy_map`] → files; [`evaluation`]
//! compares a trajectory with ground truth.
#![forbid(unsafe_code)]

pub mod calibration;
pub mod cli;
pub mod cloud;
pub mod config;
pub mod driver;
pub mod evaluation;
#[cfg(feature = "experiments")]
pub mod experiment;
pub mod genealogy;
pub mod high_slam;
pub mod link;
pub mod live;
pub mod localize;
pub mod localize_run;
pub mod log;
pub mod map_io;
pub mod map_run;
pub mod mapper;
pub mod occupancy_map;
pub mod output;
pub mod picture;
pub mod pose_f64;
#[cfg(feature = "experiments")]
pub mod prove;
pub mod recording;
pub mod robot;
pub mod run_report;
pub mod saved_map;
pub mod scan_store;
pub mod step_table;
pub mod table;
pub mod text_input;
pub mod trajectory;
