#![doc = include_str!("../README.md")]
//!
//! # Layers
//! A module uses only what stands to its left:
//! `math, random, config | geometry | grid, sweep | filter, ndt, de | matcher | laser_odometry`, and
//! `math, random, config | geometry | grid, chords, ancestry | rays, motion | distributed_map, particles | perception | low_slam`;
//! `slam` joins the two: [`Slam::new`](slam::Slam::new) takes a [`SlamConfig`](slam::SlamConfig), a seed and memory. [`scan`] and
//! [`time`] are those of `lrfslam-scan`, which laser drivers share.
//!
//! # Data flow
//! [`RangeScan`](scan::RangeScan) (polar) → [`filter`] → points → [`ScanMatcher`](matcher::ScanMatcher) against an
//! [`NdtGrid`](ndt::NdtGrid) → [`Match`](matcher::Match) → motion of the particles of [`LowSlam`](low_slam::LowSlam) → pose of the robot.
//!
//! # Frames
//! `map`, `robot`, `lrf`: x forward, y left, z up (REP-103), angles counter-clockwise in (−π, π]. A transform is
//! named `a_from_b`, so that names meet: `map_from_lrf = map_from_robot * robot_from_lrf`.
//! The thesis has y forward and x lateral; its Δy is our forward displacement, its Δx our lateral one.
//!
//! # Units
//! Metres, radians, seconds (times as integer microseconds). Degrees appear in configuration only, and its names
//! say so.
//!
//! # Sources
//! "Thesis" is L. E. Ynoquio Herrera, *Mobile robot simultaneous localization and mapping using DP-SLAM with a
//! single laser range finder*, PUC-Rio 2011. NDT: Biber & Straßer, IROS 2003. Differential evolution: Storn &
//! Price 1997.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing,
        clippy::std_instead_of_core
    )
)]

pub mod ancestry;
pub mod chords;
pub mod config;
pub mod de;
pub mod distributed_map;
pub mod facing;
pub mod filter;
pub mod geometry;
pub mod grid;
pub mod landmark;
pub mod laser_odometry;
pub mod low_slam;
pub mod matcher;
pub mod math;
pub mod motion;
pub mod ndt;
pub mod particles;
pub mod perception;
pub mod random;
pub mod rays;
pub mod slam;
pub mod sweep;

pub use lrfslam_scan as scan;
pub use lrfslam_scan::time;

#[cfg(test)]
mod test_world;
